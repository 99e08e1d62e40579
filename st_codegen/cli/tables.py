"""`st-codegen tables`: the paper's tables 2 to 6, ours beside theirs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.console import FOLDER, PLACE, Whole, progress_bar, quiet_option, tell
from st_codegen.cli.training import search_options
from st_codegen.errors import InputError

if TYPE_CHECKING:
    from st_codegen.training.search import Backend
    from st_codegen.training.study import SearchSettings

TABLE = "rv160n_harmonics.csv"
PREDICTIONS = "rv160n_paper_test_predictions_hgbm.csv"
ERRORS = "rv160n_paper_errors.csv"


@click.command(
    "tables",
    epilog=f"""\b
DATA holds three files: {TABLE} (the measured harmonic table),
{PREDICTIONS} (the authors' test points, with their
predictions) and {ERRORS} (their errors).

\b
Examples:
  st-codegen tables measured/ --out build/tables
  st-codegen tables measured/ --folds 3 --families SVM,ERT,LGBM""",
)
@click.argument("data", type=PLACE)
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=Path("build/tables"),
    help="Folder of errors.csv, authors.csv, tables.md and tables.html.",
)
@click.option("--repeats", type=Whole(min=0), default=5, help="Further random splits.")
@search_options
@quiet_option
def command(
    data: Path,
    out: Path,
    repeats: int,
    settings: SearchSettings,
    where: Backend,
    work: Path,
    quiet: bool,
) -> None:
    """Train on the paper's training points and write its tables 2 to 6 with our errors beside the authors'.

    Long: some thousand fits. Finished ones are kept (--work), so that a second run takes seconds.
    """
    from st_codegen.campaign.harmonic_table import read_table
    from st_codegen.training.learn import LearningPlan
    from st_codegen.training.paper import compare, read_paper
    from st_codegen.training.search import Fitting
    from st_codegen.training.store import FitStore
    from st_codegen.training.tables import write_tables

    missing = [name for name in (TABLE, PREDICTIONS, ERRORS) if not (data / name).is_file()]
    if missing:
        raise InputError(
            f"{data}: {', '.join(missing)} not found. The measured tables are not part of this project: get them and "
            "name their folder (make tables DATA=FOLDER)"
        )
    plan = LearningPlan(settings, repeats=repeats)
    table, paper = read_table(data / TABLE), read_paper(data / ERRORS, data / PREDICTIONS)
    with FitStore(work) as store, progress_bar("fits", quiet=quiet) as progress:
        comparison = compare(table, paper, plan, Fitting(store, where, progress))
    for path in write_tables(comparison, out):
        if not quiet:
            tell(f"{path}")
