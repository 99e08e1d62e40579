"""`st-codegen verify`: library = reference = emitted text."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from st_codegen.cli.codes import show_codes
from st_codegen.cli.console import (
    FILE,
    GivenModels,
    Whole,
    console,
    generated_option,
    models_options,
    progress_bar,
    reading_options,
    rows_options,
    say,
    say_next,
    table_of,
)
from st_codegen.cli.costs import cycle_option, entry_option, print_budget, print_verdict, profile_option
from st_codegen.errors import counted
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.project.bundle import Bundle
    from st_codegen.proof.verify_report import ModelReport, VerifyReport


@click.command(
    "verify",
    epilog="""\b
Examples:
  st-codegen verify models/ --generated generated
  st-codegen verify models/ --generated generated --rows 100000 --json report.json
  st-codegen verify models/ --cycle-us 250 --profile cx5140      fail when a cycle may take longer
  st-codegen verify models/ --cycle-us 250 --profile mine.toml --entry FB_TEPredict""",
)
@models_options
@generated_option("Folder that `generate` wrote; every target in it is verified.")
@rows_options(
    "Rows a model, or as many more as special values and thresholds with their neighbours take; blocks around models "
    "have rows of their own."
)
@click.option(
    "-j", "--jobs", type=Whole(min=1), default=None, help="Models at the same time (default: one a processor)."
)
@cycle_option
@profile_option
@entry_option
@click.option("--json", "json_file", type=FILE, help="Write the report to this file.")
@click.option("--html", type=FILE, help="Write a page, with what prove says of the text, to this file.")
@reading_options
def command(
    given: GivenModels,
    generated: Path,
    rows: int,
    seed: int,
    jobs: int | None,
    cycle_us: float | None,
    profile: str,
    entries: tuple[str, ...],
    json_file: Path | None,
    html: Path | None,
) -> None:
    """Compare the numbers of the generated text with those of MODELS, on a sample of inputs.

    Library, reference and emitted text are compared in the range of the inputs, on thresholds and their neighbours, on
    NaN, infinities and values outside the range. With --cycle-us the worst case of a cycle, from the emitted text and
    with cold caches, must fit as well. Exit code 0 when all agree and fit, 1 when not, or when a proof for the page
    finds an input that differs.
    """
    from st_codegen.cost.profile import load_profile
    from st_codegen.proof.runner import changes_by_hand
    from st_codegen.proof.verify import Budget, verify

    budget = Budget(load_profile(profile), cycle_us, entries)
    bundle = given.load_generated(generated)
    with progress_bar("verifying", quiet=given.quiet) as progress:
        report = verify(bundle, generated, rows=rows, seed=seed, budget=budget, progress=progress, jobs=jobs)
    if json_file is not None:
        write_text(json_file, json.dumps(report.as_json(), indent=1) + "\n")
    refuted = html is not None and _write_page(html, given, generated, report, bundle)
    if not given.quiet:
        console.print(agreement_table("library, reference and generated text compared", report.models))
        for target, note in report.notes.items():
            say(f"{target}: {note}")
        _print_remarks(report, bundle, rows)
        for line in changes_by_hand(generated):
            say(line)
        if served := bundle.purpose.served(bundle.irs) if bundle.purpose else ():
            say("what each file is used for; no comparison of numbers sees two files that are exchanged:")
        for line in served:
            say(f"  {line}")
    for model in report.models:
        for remark in () if given.quiet and model.passed else model.remarks:
            say(remark)
        for line in _failures(model):
            say(Text.assemble((model.name, "red"), f": {line}"))
    _print_times(report, cycle_us, quiet=given.quiet)
    show_codes([*_codes(report), *(["STC2101"] if refuted else [])])
    passed = report.passed and not refuted
    if passed and report.followed and html is None and not given.quiet:  # the page has what prove says
        say_next(*given.asked_next("prove", generated))
    sys.exit(0 if passed else 1)


def _codes(report: VerifyReport) -> Iterator[str]:
    """The codes of what is not as it should be."""
    if any(model.failures for model in report.models):
        yield "STC2001"
    if any(model.refusal is not None for model in report.models):
        yield "STC1206"
    if any(model.nothing_compared for model in report.models):
        yield "STC2004"
    if report.over_budget:
        yield "STC2002"


def _failures(model: ModelReport) -> list[str]:
    """Why the library has no answer, or the first rows that differ."""
    refusal = [] if model.refusal is None else [model.refusal]
    return refusal + [str(failure) for failure in model.failures[:3]]


def _print_times(report: VerifyReport, cycle_us: float | None, *, quiet: bool) -> None:
    """Who spends what in the cycles that do not fit, a line for those that do."""
    for target, cost in report.over_budget.items():
        print_budget(target, cost, report.cycle_us)
    if cycle_us is not None and not quiet:
        for target, cost in report.costs.items():
            if target not in report.over_budget:
                print_verdict(target, cost, cycle_us)


def _write_page(path: Path, given: GivenModels, generated: Path, report: VerifyReport, bundle: Bundle) -> bool:
    """Write the page, with proofs. Returns whether one of them found an input that refutes it, which is printed."""
    from st_codegen.cli.pages import verify_sections, write_pages
    from st_codegen.cli.prove import sentence
    from st_codegen.proof.prove.prove import Verdict, prove

    with progress_bar("proving", quiet=given.quiet) as progress:
        proof = prove(bundle, generated, progress=progress)
    summary, sections = verify_sections(report, proof, bundle, generated)
    write_pages(f"Verification of {given.models}", sections, summary, path, None)
    refuted = [result for result in proof.results if result.verdict is Verdict.REFUTED]
    for result in refuted:
        say(sentence(result))
    return bool(refuted)


def _print_remarks(report: VerifyReport, bundle: Bundle, rows: int) -> None:
    """What `prove` answers for instead of rows, which ranges are guesses, and where not as many rows as asked for."""
    followed: dict[str, list[str]] = {}
    for model in report.models:
        followed.setdefault(model.proof, []).append(model.name)
    for words, names in followed.items():
        if words:
            say(f"{words} for all inputs, and compared with the library on a sample of rows: {', '.join(names)}")
    if report.guessed:
        say(report.guessed)
    models = {ir.name for ir in bundle.irs}
    others = [model for model in report.models if model.n != rows]
    if more := [model.name for model in others if model.n > rows and model.name in models]:
        say(f"special values and thresholds take more than {counted(rows, 'row')}: {', '.join(more)}")
    if around := [f"{model.name} {model.n:,}" for model in others if model.name not in models]:
        say(f"blocks around models have numbers of rows that --rows does not change: {', '.join(around)}")


def agreement_table(title: str, models: Iterable[ModelReport]) -> Table:
    """How many models have which result, and how far the answers for each lie apart; what failed stands first."""
    ranked = sorted(models, key=lambda model: model.passed)
    counts = Counter(model.verdict for model in sorted(ranked, key=lambda model: (model.passed, model.verdict)))
    said = ", ".join(f"{words}: {count}" for words, count in counts.items())
    named = f"{title} ({said})" if said else title
    table = table_of(named, "model", ">rows", ">max error", ">allowed", ">ulp", "result")
    for model in ranked:
        table.add_row(*model.cells, Text(model.verdict, "green" if model.passed else "bold red"))
    return table
