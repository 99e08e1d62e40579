"""`st-codegen record`: a measured campaign from a running controller."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.console import (
    FOLDER,
    PLACE,
    Number,
    Whole,
    controller_options,
    generated_option,
    progress_bar,
    quiet_option,
    tell,
)
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.number_text import parse_number

if TYPE_CHECKING:
    from st_codegen.live.controller import Controller


@click.command(
    "record",
    epilog="""\b
Examples:
  st-codegen record --ads 192.168.0.5.1.1:851 --plan conditions.csv --out campaign
  st-codegen record --ads 192.168.0.5.1.1:851 --plan conditions.csv --out campaign --set fAcceleration_rpm_s=500
  st-codegen train campaign/ --out models/

\b
conditions.csv:
  speed_rpm,torque_Nm,temperature_C
  1000,300,30""",
)
@generated_option("Folder that `generate --with-comparison` wrote for a bundle, and that the controller runs.")
@controller_options
@click.option(
    "--plan",
    type=PLACE,
    required=True,
    help="CSV with the columns speed_rpm,torque_Nm,temperature_C: one measurement a row, both directions.",
)
@click.option(
    "--out",
    type=FOLDER,
    required=True,
    help="Folder for the curve files; one that was begun with the same plan is continued.",
)
@click.option("--samples", type=Whole(min=100), default=4096, help="Samples of a revolution, at least.")
@click.option("--set", "inputs", multiple=True, metavar="NAME=VALUE", help="Another input of PRG_Experiment.")
@click.option(
    "--alive",
    type=Number(min=0.1, max=3600),
    default=5.0,
    help="Seconds of the controller without a word from here, after which it ends a measurement by itself.",
)
@quiet_option
def command(
    generated: Path,
    connect: Callable[[], Controller],
    plan: Path,
    out: Path,
    samples: int,
    inputs: tuple[str, ...],
    alive: float,
    quiet: bool,
) -> None:
    """Measure a campaign: drive FB_Experiment on a controller through a plan and write the files that `train` reads.

    A measurement that is finished is a file; the same command goes on where it was stopped. Whatever goes wrong stops
    the axis first, unless another client has taken it over, and ends with exit code 2 and the reason; a controller that
    no longer hears of this command stops the axis by itself.
    """
    from st_codegen.live.compare import generated_folder
    from st_codegen.live.record import RecordSettings, planned, record, recorded_project
    from st_codegen.rig.campaign import read_conditions

    runs = planned(read_conditions(plan))
    project = recorded_project(generated_folder(generated))
    recording = RecordSettings(samples, _settings(inputs), alive)

    with connect() as controller, progress_bar("recording", quiet=quiet) as progress:
        made = record(controller, project, runs, out, recording, progress)
    if not quiet:
        tell(f"{out}: {counted(made, 'run')} measured now, {len(runs)} in all, both directions")


def _settings(texts: Sequence[str]) -> dict[str, float]:
    """The inputs that are set, by name. One InputError lists all that is wrong."""
    problems, found = Problems("record"), dict[str, float]()
    for text in texts:
        with problems.collect():
            name, value = _setting(text)
            if name in found:
                raise InputError(f"--set {text}: {name} is set twice")
            found[name] = value
    problems.raise_if_any()
    return found


def _setting(text: str) -> tuple[str, float]:
    name, mark, value = text.partition("=")
    try:
        name = name.strip()
        if not mark or not re.fullmatch(r"[fF]\w+", name, re.ASCII):
            raise ValueError("NAME=VALUE is expected, of a number: an input whose name begins with f")
        if name.lower() in ("fspeed_rpm", "ftorque_nm", "ftemperature_c"):
            raise ValueError("the plan gives it, and the files say what the plan says")
        return name, parse_number(value)
    except ValueError as error:
        raise InputError(f"--set {text}: {error}") from None
