"""`st-codegen calibrate`: a profile from times that were measured on the controller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.console import FILE, PLACE, console, quiet_option, say, table_of
from st_codegen.cli.costs import profile_option
from st_codegen.errors import InputError
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.cost.calibrate import Measurement
    from st_codegen.cost.profile import Profile


@click.command(
    "calibrate",
    epilog="""\b
Examples:
  st-codegen calibrate generated --measured times.csv --out mine.toml
  st-codegen verify models/ --cycle-us 250 --profile mine.toml

\b
times.csv:
  block,caches,us
  FB_TEPredict,warm,41.3
  FB_TEPredict,cold,97.0""",
)
@click.argument("generated", type=PLACE)
@click.option(
    "-m",
    "--measured",
    type=PLACE,
    required=True,
    help="CSV with the columns block,caches,us: the longest call of a block that was seen (compare --times: of 99 %), "
    "caches warm or cold.",
)
@profile_option
@click.option("-o", "--out", type=FILE, required=True, help="Profile to write.")
@quiet_option
def command(generated: Path, measured: Path, profile: str, out: Path, quiet: bool) -> None:
    """Fit a profile to times measured on the controller, for the text in GENERATED.

    Two factors are found by least squares of relative errors: one for computing, one for waiting for memory. Of several
    targets in GENERATED the first is taken: name its folder to choose.
    """
    from st_codegen.cost.calibrate import read_measurements
    from st_codegen.cost.profile import load_profile
    from st_codegen.proof.runner import target_folders

    must_be_a_profile(out)
    base = load_profile(profile)
    measurements = read_measurements(measured)
    write_profile(target_folders(generated)[0], base, measurements, out, quiet=quiet)


def must_be_a_profile(out: Path) -> None:
    """Raises InputError for a file to write that no other command would take for a profile."""
    if out.suffix != ".toml":
        raise InputError(f"{out}: a profile is a .toml file")


def write_profile(
    folder: Path, base: Profile, measurements: tuple[Measurement, ...], out: Path, *, quiet: bool
) -> None:
    """Fit a profile to times of the blocks of a generated folder, write it, and show how near it comes."""
    from st_codegen.cost.calibrate import calibrate, with_factors
    from st_codegen.proof.runner import GeneratedCode

    fit = calibrate(GeneratedCode(folder).project, base, measurements)
    write_text(out, with_factors(base, fit, out.stem))
    if quiet:
        return
    title = f"{out}: compute x {fit.compute:.3g}, memory x {fit.memory:.3g}"
    table = table_of(title, "block", "caches", ">measured us", ">model us", ">error")
    for measurement, modelled in zip(measurements, fit.modelled, strict=True):
        error = f"{modelled / measurement.microseconds - 1.0:+.1%}"
        caches = "cold" if measurement.is_cold else "warm"
        table.add_row(measurement.block, caches, f"{measurement.microseconds:.4g}", f"{modelled:.4g}", error)
    console.print(table)
    for text in fit.remarks(measurements):
        say(text)
