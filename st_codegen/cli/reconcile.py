"""`st-codegen reconcile`: what the rig model lacks, named, added, and the smaller gap."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path

import click

from st_codegen.bundle_file import BUNDLE_FILE
from st_codegen.cli.console import console, progress_bar, quiet_option, trust_option
from st_codegen.errors import InputError
from st_codegen.reconcile.output import report, report_text, rig_diff
from st_codegen.reconcile.run import Result, reconcile_files
from st_codegen.reconcile.update import CODE, MODELS, Update, Wish, check_models, update_models
from st_codegen.reconcile.words import summary, update_summary
from st_codegen.rig.effects import catalogue
from st_codegen.rig.model import read_rig


@click.command(
    "reconcile",
    epilog="""\b
Examples:
  st-codegen reconcile --rig rig.toml --measured campaign/ --out found
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --effects my_effects.py
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --scale 57.29578   measured in rad
  st-codegen reconcile --rig rig.toml --measured campaign/ --out found --models models/ --update-models""",
)
@click.option("--rig", type=click.Path(path_type=Path), required=True, help="Rig model, rig.toml.")
@click.option(
    "--measured",
    type=click.Path(path_type=Path),
    required=True,
    help="Campaign folder, harmonic table, order spectrum, or recording over time.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder for rig.toml, report.json, report.html."
)
@click.option("--effects", type=click.Path(path_type=Path), multiple=True, help="Python file with effects of your own.")
@click.option("--scale", type=float, help="Factor on the measured TE; 1 to accept it as it is.")
@click.option("--models", type=click.Path(path_type=Path), help="Bundle of models that --update-models starts from.")
@click.option(
    "--update-models",
    "update",
    is_flag=True,
    help=f"Put what was found into the bundle: OUT/{MODELS}, compiled and verified in OUT/{CODE}, moved by the rig.",
)
@click.option("--target", default="twincat", show_default=True, help="Dialect of the updated models' text.")
@click.option(
    "--profile",
    default="cycloidal",
    show_default=True,
    help="Motion with the old and the new compensator: cycloidal, robot, a CSV (t,theta_out,torque_Nm), or none.",
)
@click.option("--json", "as_json", is_flag=True, help="Print report.json to standard output as well.")
@trust_option
@quiet_option
def command(
    rig: Path,
    measured: Path,
    out: Path,
    effects: tuple[Path, ...],
    scale: float | None,
    models: Path | None,
    update: bool,
    target: str,
    profile: str,
    as_json: bool,
    trust_pickle: bool,
    quiet: bool,
) -> None:
    """Find what the rig model lacks: compare it with measured data, name the missing effects, and add them."""
    known = catalogue(effects)
    model = read_rig(rig, known)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; the report needs a folder")
    wish = _wish(models, update, target, profile, trust_pickle, out)
    if wish is not None:
        check_models(model, wish)
    with progress_bar("reconciling", quiet=quiet) as progress:
        result = reconcile_files(model, measured, known, scale=scale, progress=progress)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".st-codegen-", dir=out.parent) as name:
        stage, changes = Path(name), None
        if wish is not None:
            with progress_bar("updating models", quiet=quiet) as progress:
                changes = update_models(result, wish, stage, progress)
        _write(result, changes, stage, out)
    if not quiet:
        console.print(summary(result), highlight=False)
        if changes is not None:
            console.print(update_summary(changes), highlight=False)
    if as_json:
        click.echo(json.dumps(report(result, changes)))


def _wish(models: Path | None, update: bool, target: str, profile: str, trust_pickle: bool, out: Path) -> Wish | None:
    """What is to be done with a bundle; faults are named before anything is computed."""
    if update != (models is not None):
        raise InputError("--models DIR and --update-models go together: which bundle is to get what is found?")
    if models is None:
        return None
    if not (models / BUNDLE_FILE).is_file():
        raise InputError(f"{models}: no bundle; --models wants a folder with {BUNDLE_FILE}")
    for name, holds in ((MODELS, BUNDLE_FILE), (CODE, "")):
        place = out / name
        if place.exists() and (place.resolve() == models.resolve() or not (place / holds).exists()):
            raise InputError(f"{place} exists and would be replaced: name another --out")
    return Wish(models, target, "" if profile == "none" else profile, trust_pickle=trust_pickle)


def _write(result: Result, update: Update | None, stage: Path, out: Path) -> None:
    """All files or none: written beside their places first."""
    from st_codegen.reconcile.pages import report_page

    texts = {
        "rig.toml": result.new_rig.text(),
        "rig.diff": rig_diff(result),
        "report.json": report_text(result, update),
        "report.html": report_page(result, update),
    }
    for file, text in texts.items():
        (stage / file).write_text(text, encoding="utf-8", newline="\n")
    out.mkdir(exist_ok=True)
    for name in (MODELS, CODE):
        if update is not None and (stage / name).exists():
            if (out / name).exists():
                (out / name).rename(stage / f"old_{name}")
            shutil.move(stage / name, out / name)
    for file in texts:
        os.replace(stage / file, out / file)  # noqa: PTH105
