"""`st-codegen train`: measured curves or a harmonic table in, a bundle of models out."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from st_codegen.cli.choices import MODEL_FORMS
from st_codegen.cli.console import (
    FILE,
    FOLDER,
    PLACE,
    Number,
    Whole,
    console,
    progress_bar,
    quiet_option,
    refuse_unused,
    say,
    say_next,
    table_of,
    tell,
)
from st_codegen.cli.training import search_options
from st_codegen.errors import InputError, counted
from st_codegen.files.number_text import parse_whole, plain_number
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.training.export import BundleHead
    from st_codegen.training.learn import Lesson
    from st_codegen.training.search import Backend
    from st_codegen.training.study import SearchSettings


@click.command(
    "train",
    epilog="""\b
Examples:
  st-codegen train harmonics.csv --out models/
  st-codegen train campaign/ --orders auto --reduction-ratio 81 --skip-bad
  st-codegen train harmonics.csv --orders 0,1,39,40 --families ERT,LGBM,SVM --limit-us 200
  st-codegen train harmonics.csv --backend dask --scheduler tcp://host:8786""",
)
@click.argument("campaign", type=PLACE)
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=Path("models"),
    help="Folder of the bundle, in place of an earlier one; st-codegen compiles it.",
)
@click.option("--report", type=FILE, help="HTML page about what was learned.")
@click.option(
    "--orders",
    default="auto",
    metavar="LIST",
    help="Orders to model, with commas between; auto: all of a table, the ones that stand out of a campaign.",
)
@click.option("--most-orders", type=Whole(min=1), default=15, help="How many orders auto takes at most.")
@click.option("--reduction-ratio", type=Number(min=1e-6, max=1e6), default=81.0, help="Input speed over output speed.")
@click.option("--name", default="reducer", help="Name of the bundle.")
@click.option("--format", "form", type=click.Choice(MODEL_FORMS), default=MODEL_FORMS[0], help="Model files.")
@click.option(
    "--limit-us",
    type=Number(min=0),
    help="Worst case of all models of one direction in microseconds (a quick estimate; verify counts the text).",
)
@click.option("--test-share", type=Number(0.01, 0.9), default=0.2, help="Share of operating points kept for testing.")
@click.option("--repeats", type=Whole(min=0), default=0, help="Further random splits.")
@click.option("--keep-faulty", is_flag=True, help="Learn from runs that robust statistics call faulty, too.")
@click.option("--skip-bad", is_flag=True, help="Leave out curve files that cannot be read, after reporting them.")
@click.option(
    "--cache", type=FILE, default=Path("build/curves.parquet"), help="Parquet file of what was read of curve files."
)
@click.option("--table", "table_out", type=FILE, help="Write the harmonic table.")
@click.option("--json", "as_json", is_flag=True, help="Print what was chosen and its errors as JSON.")
@search_options
@quiet_option
def command(
    campaign: Path,
    out: Path,
    report: Path | None,
    orders: str,
    most_orders: int,
    reduction_ratio: float,
    name: str,
    form: str,
    limit_us: float | None,
    test_share: float,
    repeats: int,
    keep_faulty: bool,
    skip_bad: bool,
    cache: Path,
    table_out: Path | None,
    as_json: bool,
    settings: SearchSettings,
    where: Backend,
    work: Path,
    quiet: bool,
) -> None:
    """Learn from CAMPAIGN, a folder of curve files or a harmonic table (.csv), and write a bundle of models.

    Each direction is split, faulty runs are found in the training part, all families are cross-validated, and for each
    order the best pair of models is chosen whose worst-case cost fits.
    """
    from st_codegen.campaign.harmonic_table import joined, write_table
    from st_codegen.emit.literals import identifier
    from st_codegen.training.export import check_place, write_bundle
    from st_codegen.training.learn import LearningPlan, bundle_head, check_learnable, learn, only_exportable
    from st_codegen.training.measured import measured_table
    from st_codegen.training.page import training_page
    from st_codegen.training.search import Fitting
    from st_codegen.training.store import FitStore

    if campaign.is_file():
        refuse_unused(f"on a harmonic table ({campaign})", "most_orders", "skip_bad", "cache")
    elif orders != "auto":
        refuse_unused("where --orders are given", "most_orders")
    for option, file in (("--table", table_out), ("--report", report)):
        if file is not None and _is_measured(file, campaign):
            what = f"is the measured table {campaign}" if campaign.is_file() else f"lies among the curves of {campaign}"
            raise click.BadParameter(f"{file} {what}; give another file.", param_hint=f"'{option}'")
    check_place(out)
    identifier(name, "--name")
    settings = only_exportable(settings, form)
    plan = LearningPlan(settings, test_share, None, math.inf if limit_us is None else limit_us, repeats, keep_faulty)
    wanted = _orders(orders)
    with progress_bar("reading", quiet=quiet) as progress:
        measured = measured_table(
            campaign, wanted, most_orders, skip_bad=skip_bad, where=where, cache=cache, progress=progress
        )
    for text in measured.left_out:
        tell(f"left out: {text}")
    check_learnable(measured.table, str(campaign))
    lessons = []
    with FitStore(work) as store:
        for direction in measured.table.directions():
            with progress_bar(f"{direction}: fits", quiet=quiet) as progress:
                lessons.append(learn(measured.table, direction, plan, Fitting(store, where, progress)))
    head = bundle_head(joined([lesson.learned_from for lesson in lessons]), name, reduction_ratio)
    dropped = write_bundle(out, head, [model for lesson in lessons for model in lesson.models], form)
    if table_out:
        write_table(measured.table, table_out)
    if report:
        write_text(report, training_page(name, measured, lessons))
    if as_json:
        click.echo(json.dumps([_facts(lesson) for lesson in lessons], indent=1))
    _print(lessons, head, "kept" if keep_faulty else "left out", quiet=quiet)
    if dropped:
        say(f"{out}: left out, since made for the models of the bundle that was replaced: {', '.join(dropped)}")
    if not quiet:
        tell(f"{out}: {counted(sum(len(lesson.models) for lesson in lessons), 'model')}")
        say_next("generate", out)


def _is_measured(file: Path, campaign: Path) -> bool:
    """Whether a file is the measured table, or would be read as one of the curves, or replace one."""
    inside = file.resolve().is_relative_to(campaign.resolve()) and (file.exists() or file.suffix.lower() == ".csv")
    return inside or (file.exists() and file.samefile(campaign))


def _print(lessons: list[Lesson], head: BundleHead, faulty_are: str, *, quiet: bool) -> None:
    """What was learned, unless `quiet`, what is doubtful in it, and what is the same in all runs."""
    for lesson in lessons:
        if not quiet:
            console.print(_summary(lesson, faulty_are))
        for remark in lesson.remarks():
            say(remark)
        if beyond := lesson.beyond_limit(head.reduction_ratio):
            say(beyond)
    for lesson in lessons:
        if narrower := head.narrower(lesson.learned_from.conditions):
            say(
                f"{lesson.direction}, learned from less than the bundle's range, which is that of both directions: "
                f"{', '.join(narrower)}"
            )
    for feature, value in head.constant().items():
        tell(
            f"{feature} was {plain_number(value)} in all runs learned from: the blocks compute with "
            f"{plain_number(value)}, and bInRange is FALSE at any other value"
        )


def _orders(text: str) -> tuple[int, ...] | None:
    """The orders asked for; None for auto. Raises InputError."""
    if text == "auto":
        return None
    try:
        orders = tuple(sorted({parse_whole(part) for part in text.split(",")}))
    except ValueError:
        orders = (-1,)
    if min(orders) < 0:
        raise InputError(f"--orders {text}: give whole numbers from 0 with commas between, or auto")
    return orders


def _facts(lesson: Lesson) -> dict[str, Any]:
    return {
        "direction": lesson.direction.value,
        "faulty": [list(map(float, row)) for row in lesson.train.conditions[lesson.faulty.rows]],
        "cost_us": round(lesson.cost_us, 3),
        "orders": [
            {
                "order": solution.order,
                "learned": solution.kind.value,
                "families": [candidate.family for candidate in solution.candidates],
                "parameters": [dict(candidate.params) for candidate in solution.candidates],
                "validation_complex_mae_deg": solution.errors.complex_mae,
                "constant_complex_mae_deg": lesson.constant_mae(solution.order),
                "test_complex_mae_deg": lesson.test_errors[solution.order].complex_mae,
                "test_amplitude_mae_deg": lesson.test_errors[solution.order].amplitude_mae,
                "test_phase_mae_rad": lesson.test_errors[solution.order].phase_mae if solution.order else None,
            }
            for solution in lesson.choice.solutions
        ],
    }


def _summary(lesson: Lesson, faulty_are: str) -> Table:
    faulty = int(lesson.faulty.rows.sum())
    others = (
        "" if faulty_are == "kept" or lesson.left_out == faulty else f" ({lesson.left_out} of all runs for the models)"
    )
    unknown = lesson.faulty.not_judged and not faulty
    told = "faulty runs not looked for" if unknown else f"{counted(faulty, 'faulty run')} {faulty_are}"
    title = (
        f"{lesson.direction}: worst case {lesson.cost_us:.3g} us (a quick estimate; verify counts the text), "
        f"{told}{others}; errors at the operating points of "
        f"{counted(len(lesson.study.test), 'run')} that were kept apart"
    )
    table = table_of(title, ">order", "models", ">amplitude MAE, deg", ">phase MAE, rad", ">complex MAE, deg")
    for solution in lesson.choice.solutions:
        errors = lesson.test_errors[solution.order]
        phase = f"{errors.phase_mae:.3g}" if solution.order else ""
        table.add_row(
            str(solution.order), solution.name, f"{errors.amplitude_mae:.3g}", phase, f"{errors.complex_mae:.3g}"
        )
    return table
