"""`st-codegen predict`: the same numbers by three ways."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.choices import EVALUATORS
from st_codegen.cli.console import FILE, PLACE, GivenModels, models_options, outputs_option, reading_options, say
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.ir import OutputKind


@click.command(
    "predict",
    epilog="""\b
Examples:
  st-codegen predict models/ --input X.csv --output Y.csv
  st-codegen predict models/ --input X.csv --output Y.csv --engine source     by the library itself""",
)
@models_options
@click.option(
    "-i",
    "--input",
    "source",
    type=PLACE,
    required=True,
    help="CSV with a header of feature names (f0, f1, .. by place), other columns are passed over; nan and inf are "
    "allowed.",
)
@click.option("-o", "--output", "result", type=FILE, required=True, help="CSV to write, - for output.")
@click.option(
    "-e",
    "--engine",
    type=click.Choice(EVALUATORS),
    default=EVALUATORS[0],
    help="Who computes: the generated text as machine code, the reference in NumPy, or the source library.",
)
@outputs_option
@reading_options
def command(given: GivenModels, source: Path, result: Path, engine: str, outputs: Collection[OutputKind]) -> None:
    """Predict MODELS for the rows of a table. A row that a model does not take gives nan.

    Inputs outside of a declared range are limited to it before any engine computes, as in the block.

    A classifier gives the library's own labels, and further outputs beside them.
    """
    from st_codegen.driver import Evaluator, predict
    from st_codegen.project.bundle import READERS
    from st_codegen.project.configuration import CONFIGURATION_FILE
    from st_codegen.proof.predict import columns_of, limits, read_table, table_text

    if result.exists() and result.samefile(source):
        raise click.BadParameter(f"{result} is the table of inputs; give another file.", param_hint="'--output'")
    bundle = given.load(outputs, real=False)
    folder = given.models if given.models.is_dir() else given.models.parent
    read = [name for ir in bundle.irs for name in (ir.source.file, *dict(ir.source.data_files))]
    paths = [folder / name for name in (*read, *READERS, CONFIGURATION_FILE)]
    if result.exists() and any(path.is_file() and result.samefile(path) for path in paths):
        raise click.BadParameter(f"{result} is a file of the models; give another one.", param_hint="'--output'")
    table = read_table(source, columns_of(bundle.irs))
    text = table_text(predict(bundle, table, Evaluator(engine), table=str(source)))
    if str(result) == "-":
        click.echo(text, nl=False)
    else:
        write_text(result, text)
    if not given.quiet and (limited := limits(bundle.irs, table)):
        say(f"outside of the declared range, computed with its nearest end as in the block: {', '.join(limited)}")
