"""`st-codegen prove`: the emitted text equals the model for every input."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from st_codegen.cli.codes import show_codes
from st_codegen.cli.console import (
    PLACE,
    GivenModels,
    console,
    generated_option,
    models_options,
    progress_bar,
    reading_options,
    say,
    table_of,
)
from st_codegen.errors import at_most
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.proof.prove.prove import ProofResult, ProveReport

#: Verdicts that are no proof, and their codes.
_CODES = (("refuted", "STC2101"), ("not proved", "STC2102"))


@click.command(
    "prove",
    epilog="""\b
Examples:
  st-codegen prove models/ --generated generated
  st-codegen prove models/ --generated generated --certificate certificate.json
  python checker/check_certificate.py certificate.json models/ generated/""",
)
@models_options
@generated_option("Folder that `generate` wrote; every target in it is proved.")
@click.option(
    "--certificate",
    "certificate_file",
    type=PLACE,
    help="Write what was proved to this file, for checker/check_certificate.py.",
)
@reading_options
def command(given: GivenModels, generated: Path, certificate_file: Path | None) -> None:
    """Prove that the generated text computes what MODELS demand, for every float64 input.

    The text is executed on intervals and boxes of inputs, which together are all inputs: NaN, infinities, denormals and
    both zeros included. "proved": it gives the model's bits, as of trees and tables; "trees" counts a tree once for
    each output that it adds to. "same expression": it computes the model's operations one by one, and none can fail;
    "bound" is how far that lies from the library at most, anywhere in the declared ranges. "never fails": no call of a
    block around models stops a controller. docs/proof.md says what is assumed and what is not covered. Exit code 0 when
    every text has one of these words, 1 when one is refuted (an input is named for which the executed text differs) or
    not proved.
    """
    from st_codegen.proof.prove.certificate import certificate
    from st_codegen.proof.prove.prove import prove
    from st_codegen.proof.runner import changes_by_hand

    bundle = given.load_generated(generated)
    with progress_bar("proving", quiet=given.quiet) as progress:
        report = prove(bundle, generated, progress=progress)
    if certificate_file is not None:
        content = certificate(bundle, given.models, generated, report)
        write_text(certificate_file, json.dumps(content, indent=1, sort_keys=True) + "\n")
    if not given.quiet:
        console.print(_table(report))
        for result in report.results:
            for claim in result.claims:
                say(f"{result.block}, {result.target}: {claim}")
        for line in changes_by_hand(generated):
            say(line)
    for result in report.results:
        if not result.is_proved:
            say(sentence(result))
    verdicts = {result.verdict for result in report.results}
    show_codes(code for verdict, code in _CODES if verdict in verdicts)
    sys.exit(0 if report.proved else 1)


def _table(report: ProveReport) -> Table:
    numbers = (f">{name}" for name in VERDICT_COLUMNS[4:])
    table = table_of(f"the generated text, asked of all inputs: {report.summary}", *VERDICT_COLUMNS[:4], *numbers)
    colours = {"refuted": "bold red", "not proved": "yellow"}
    for model, target, verdict, *others in verdict_rows(report):
        table.add_row(model, target, Text(verdict, colours.get(verdict, "green")), *others)
    return table


#: What `verdict_rows` gives of each verdict.
VERDICT_COLUMNS = ("model", "target", "verdict", "how", "trees", "boxes", "operations", "bound")


def verdict_rows(report: ProveReport) -> Iterator[tuple[str, ...]]:
    """The verdicts in words."""
    for result in report.results:
        counts = [f"{count:,}" if count else "" for count in (result.trees, result.boxes, result.operations)]
        bound = at_most(max(result.bound)) if result.bound else "no range known" if result.operations else ""
        bound = "none known" if bound == "inf" else bound
        yield result.model, result.target, result.words, result.method, *counts, bound


def sentence(result: ProofResult) -> str:
    """Why there is no proof of a text, and the input that refutes it if there is one."""
    text = f"{result.model}, {result.target}: {result.verdict.value}: {result.reason}"
    found = result.counterexample
    if found is None:
        return text
    if found.stops:
        return f"{text}\n  at {list(found.input)} {found.stops}"
    expected = "no answer" if found.expected is None else list(found.expected)
    got = "bValid = FALSE" if found.got is None else list(found.got)
    if not found.by_expression:
        return f"{text}\n  at {list(found.input)}: the model demands {expected}, the executed text gives {got}"
    text += f"\n  at {list(found.input)}: the model's expression is {expected}, the executed text gives {got}"
    if any(found.allowed):
        text += f"\n  so far the library, which leaves its last digits open, may lie from it: {list(found.allowed)}"
    return text
