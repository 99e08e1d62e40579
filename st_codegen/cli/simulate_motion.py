"""`st-codegen simulate motion`: a motion of the simulated rig with the generated code in its loop."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from st_codegen.cli.choices import DIALECTS, TASK_FORMS
from st_codegen.cli.console import (
    FOLDER,
    PLACE,
    Number,
    Whole,
    build_options,
    console,
    effects_option,
    progress_bar,
    quiet_option,
    say,
    table_of,
    trust_option,
)
from st_codegen.errors import Problems

if TYPE_CHECKING:
    from st_codegen.rig.effects import Effect
    from st_codegen.rig.motion_files import MotionStudy


@click.command(
    "motion",
    epilog="""\b
Examples:
  st-codegen simulate motion --models models/ --rig rig.toml --profile cycloidal --out build/motion
  st-codegen simulate motion --models models/ --rig rig.toml --profile robot --out build/motion \\
      --orders 0,1,39 --orders all --tasks split --lead auto --law full
  st-codegen simulate motion --models models/ --rig rig.toml --profile mine.csv --out out --json""",
)
@click.option("--models", type=PLACE, required=True, help="Bundle of models, a folder with bundle.toml.")
@click.option("--rig", type=PLACE, required=True, help="Rig model, rig.toml.")
@click.option(
    "--profile", required=True, help="cycloidal, robot, or a CSV with the columns t,theta_out,torque_Nm (s, deg, N m)."
)
@click.option("--out", type=FOLDER, required=True, help="Folder for results.")
@click.option(
    "--orders",
    multiple=True,
    metavar="LIST",
    help="Orders to compensate, as in 0,1,39; may be repeated. Default: all of the bundle.",
)
@click.option(
    "--law",
    type=click.Choice(["published", "continuous", "full", "both"]),
    default="both",
    help="Weight at low speed: Eq. 6; speed / 100 rpm below 100 rpm; full correction everywhere; both: the first two.",
)
@click.option(
    "--tasks",
    type=click.Choice(TASK_FORMS),
    multiple=True,
    help="one: blocks in the main task; two: in the slow task, as published; split: models in the slow task, their "
    "sum in the main one. May be repeated. Default: two and one.",
)
@click.option(
    "--lead", default="0", metavar="US", help="Take the angle ahead by so many microseconds; auto: by all known delays."
)
@click.option(
    "--load",
    "load_source",
    type=click.Choice(["none", "setpoint", "measured"]),
    default="none",
    help="The load with its sign, for bundles with [play]: that of the load side's set point, or as it is.",
)
@click.option("--ahead", is_flag=True, help="Give the blocks the set points that the profile has a lead later.")
@click.option(
    "--set",
    "inputs",
    multiple=True,
    metavar="NAME=VALUE",
    help="Another input of FB_Compensator, as fBlendTime_s=0.05.",
)
@click.option("--temperature", type=Number(-40, 150), help="Oil at the start, degC (default: the rig's).")
@click.option("--drift", type=Number(-60, 60), help="Its drift, K a minute (default: the rig's).")
@click.option("--seed", type=Whole(min=0), default=0, help="Seed of noise and jitter.")
@click.option("--target", type=click.Choice(DIALECTS), default=DIALECTS[0], help="Target that is generated and run.")
@build_options("outputs_per_cycle")
@click.option(
    "--recording", is_flag=True, help="Also write recording.csv, the uncompensated motion as reconcile reads it."
)
@effects_option
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@trust_option
@quiet_option
def command(
    models: Path,
    rig: Path,
    profile: str,
    out: Path,
    orders: tuple[str, ...],
    law: str,
    tasks: tuple[str, ...],
    lead: str,
    load_source: str,
    ahead: bool,
    inputs: tuple[str, ...],
    temperature: float | None,
    drift: float | None,
    seed: int,
    target: str,
    outputs_per_cycle: int | None,
    recording: bool,
    known: Mapping[str, type[Effect]],
    as_json: bool,
    trust_pickle: bool,
    quiet: bool,
) -> None:
    """Simulate a motion with and without compensation by the generated Structured Text.

    Writes motion.json, motion.csv (a row a case: RMS and maximum of the error before and after), curves.csv and
    report.html.
    """
    from st_codegen.project.bundle import load
    from st_codegen.rig import motion_files, study
    from st_codegen.rig.machine import read_machine
    from st_codegen.rig.motion import LoadSource
    from st_codegen.rig.profiles import profile_named
    from st_codegen.rig.tasks import TaskForm

    _, machine = read_machine(rig, known)
    machine = study.with_oil(machine, temperature, drift)
    with progress_bar("loading", quiet=quiet) as progress:
        bundle = load(models, trust_pickle=trust_pickle, progress=progress)
    problems, motion = Problems(), None
    sets, lead_s, given = tuple[tuple[int, ...], ...](), 0.0, dict[str, float]()
    with problems.collect():
        sets = study.parse_orders(orders, bundle)
    with problems.collect():
        lead_s = study.parse_lead(lead)
    with problems.collect():
        given = study.parse_inputs(inputs)
    with problems.collect():
        motion = profile_named(profile, machine.tasks.main_us * 1e-6)
    problems.raise_if_any()
    wish = study.MotionWish(
        orders=sets,
        laws=("published", "continuous") if law == "both" else (law,),
        forms=tuple(TaskForm(name) for name in tasks) or (TaskForm.TWO, TaskForm.ONE),
        lead=lead_s,
        target=target,
        inputs=given,
        load=LoadSource(load_source),
        ahead=ahead,
        outputs_per_cycle=outputs_per_cycle,
    )
    with progress_bar("moving", quiet=quiet) as progress:
        result = study.simulate(machine, bundle, motion or profile, wish, seed=seed, progress=progress)
    motion_files.write(result, out, recording=recording)
    rows = [motion_files.row(result, outcome) for outcome in result.outcomes]
    if as_json:
        click.echo(json.dumps(rows, indent=1))
    if not quiet:
        console.print(_table(f"simulated, in deg: {out}/report.html", result, rows))
        for text in motion_files.remarks(result):
            say(text)


def _table(title: str, result: MotionStudy, rows: list[dict[str, Any]]) -> Table:
    """A row a case: the errors before and after, and what of them is gone."""
    from st_codegen.rig.motion_files import label

    numbers = (">RMS before", ">after", ">gone", ">max before", ">after", ">gone", ">latency")
    table = table_of(title, "case", *numbers)
    for entry, outcome in zip(rows, result.outcomes, strict=True):
        cells = [label(result, outcome)]
        for kind in ("rms", "max"):
            cells += [f"{entry[f'{kind}_{when}']:.5f}" for when in ("before", "after")]
            gone = entry[f"{kind}_reduction"]
            cells.append("-" if gone is None else f"{100 * gone:.1f} %")
        table.add_row(*cells, f"{entry['latency_us']:.1f} us")
    return table
