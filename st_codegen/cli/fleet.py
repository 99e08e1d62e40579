"""`st-codegen fleet`: many axes trained, compiled, proved and reconciled, and compared with each other."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from st_codegen.cli.console import FOLDER, PLACE, progress_bar, quiet_option, say
from st_codegen.cli.training import place_options

if TYPE_CHECKING:
    from st_codegen.fleet.stages import AxisResult
    from st_codegen.training.search import Backend


@click.command(
    "fleet",
    epilog="""\b
Examples:
  st-codegen fleet fleet.toml --out fleet
  st-codegen fleet fleet.toml --out fleet --jobs 2
  st-codegen fleet fleet.toml --backend dask --scheduler tcp://host:8786""",
)
@click.argument("file", metavar="FLEET", type=PLACE)
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=Path("fleet"),
    help="Folder of the results: one for each axis, and fleet.html, fleet.csv, effects.csv, fleet.json.",
)
@place_options
@quiet_option
def command(file: Path, out: Path, where: Backend, quiet: bool) -> None:
    """Train, compile, check and reconcile every axis of FLEET, a fleet.toml, and compare them with each other.

    Shows how far the effects of axes of a type spread, who stands out, and what has grown since earlier campaigns. What
    is done already is not done again; an axis that fails stops no other. Exit code 0 when all axes are done and their
    text has passed its check, 1 when not.
    """
    from st_codegen.fleet.axes import read_fleet
    from st_codegen.fleet.output import PAGE, FleetReport
    from st_codegen.fleet.run import run_fleet

    axes = read_fleet(file)
    with progress_bar("axes", quiet=quiet) as bar:

        def progress(done: int, total: int, name: str, result: AxisResult) -> None:
            bar(done, total, name)
            if not quiet:
                say(f"{name}: {result.line()}")

        try:
            results = run_fleet(axes, out, where, progress)
        except KeyboardInterrupt:
            say(f"what is done is kept in {out}: the same command goes on from there")
            raise
    report = FleetReport.of(axes, results)
    report.write(out)
    if not quiet:
        say(f"{report.summary()}\n{out / PAGE}")
    if any(result.defect for result in results.values()):
        sys.exit(70)
    sys.exit(0 if report.passed else 1)
