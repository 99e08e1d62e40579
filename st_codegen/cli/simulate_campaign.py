"""`st-codegen simulate campaign`: curve files of the simulated rig."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.console import FOLDER, PLACE, Number, Whole, effects_option, progress_bar, quiet_option, tell
from st_codegen.errors import Problems, counted

if TYPE_CHECKING:
    from st_codegen.rig.effects import Effect


@click.command(
    "campaign",
    epilog="""\b
Examples:
  st-codegen simulate campaign --rig examples/rv160n/rig.toml --conditions C.csv --out campaign --samples 4096
  st-codegen simulate campaign --rig rig.toml --conditions C.csv --out campaign --noise 0.0005 --seed 7""",
)
@click.option("--rig", type=PLACE, required=True, help="Rig model, rig.toml.")
@click.option(
    "--conditions",
    type=PLACE,
    required=True,
    help="CSV with the columns speed_rpm,torque_Nm,temperature_C: one run a row, both directions.",
)
@click.option("--out", type=FOLDER, required=True, help="New folder for the curve files.")
@click.option("--samples", type=Whole(min=1), help="Samples of a revolution (default: 4000 a second, as on the rig).")
@click.option("--noise", type=Number(min=0, max=1e3), help="Noise of a sample, deg (default: [noise] of the rig).")
@click.option("--seed", type=Whole(min=0), default=0, help="Seed of the noise.")
@effects_option
@quiet_option
def command(
    rig: Path,
    conditions: Path,
    out: Path,
    samples: int | None,
    noise: float | None,
    seed: int,
    known: Mapping[str, type[Effect]],
    quiet: bool,
) -> None:
    """Write a measured campaign of the simulated rig: the files that `train` and `reconcile` read."""
    from st_codegen.rig.campaign import Measuring, read_conditions, simulate_campaign
    from st_codegen.rig.model import read_rig

    problems = Problems("the campaign's files")
    with problems.collect():
        model = read_rig(rig, known)
    with problems.collect():
        points = read_conditions(conditions)
    problems.raise_if_any()
    with progress_bar("simulating", quiet=quiet) as progress:
        simulate_campaign(model, points, out, Measuring(samples, noise, seed), progress)
    if not quiet:
        tell(f"{out}: {counted(len(points), 'run')}, both directions")
