"""`st-codegen reconcile`: what the rig model lacks, named, added, and the smaller gap."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import click

from st_codegen.cli.console import console, progress_bar, quiet_option
from st_codegen.errors import InputError
from st_codegen.reconcile.output import report, report_text, rig_diff
from st_codegen.reconcile.run import Result, reconcile_files
from st_codegen.reconcile.words import summary
from st_codegen.rig.effects import catalogue
from st_codegen.rig.model import read_rig


@click.command(
    "reconcile",
    epilog="""\b
Examples:
  st-codegen reconcile --rig rig.toml --measured campaign/ --out found
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --effects my_effects.py
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --scale 57.29578   measured in rad""",
)
@click.option("--rig", type=click.Path(path_type=Path), required=True, help="Rig model, rig.toml.")
@click.option(
    "--measured",
    type=click.Path(path_type=Path),
    required=True,
    help="Campaign folder, harmonic table, or recording over time.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder for rig.toml, report.json, report.html."
)
@click.option("--effects", type=click.Path(path_type=Path), multiple=True, help="Python file with effects of your own.")
@click.option("--scale", type=float, help="Factor on the measured TE; 1 to accept it as it is.")
@click.option("--json", "as_json", is_flag=True, help="Print report.json to standard output as well.")
@quiet_option
def command(
    rig: Path,
    measured: Path,
    out: Path,
    effects: tuple[Path, ...],
    scale: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find what the rig model lacks: compare it with measured data, name the missing effects, and add them."""
    known = catalogue(effects)
    model = read_rig(rig, known)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; the report needs a folder")
    with progress_bar("reconciling", quiet=quiet) as progress:
        result = reconcile_files(model, measured, known, scale=scale, progress=progress)
    _write(result, out)
    if not quiet:
        console.print(summary(result), highlight=False)
    if as_json:
        click.echo(json.dumps(report(result)))


def _write(result: Result, out: Path) -> None:
    """All files or none: written beside their places first."""
    from st_codegen.reconcile.pages import report_page

    texts = {
        "rig.toml": result.new_rig.text(),
        "rig.diff": rig_diff(result),
        "report.json": report_text(result),
        "report.html": report_page(result),
    }
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".st-codegen-", dir=out) as name:
        for file, text in texts.items():
            (Path(name) / file).write_text(text, encoding="utf-8", newline="\n")
        for file in texts:
            os.replace(Path(name) / file, out / file)  # noqa: PTH105
