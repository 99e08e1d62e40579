"""`st-codegen reconcile`: what the rig model lacks, named, added, and the smaller gap."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from st_codegen.cli.choices import ALL, AS_IS, MISTAKES, UPDATED_CODE, UPDATED_MODELS
from st_codegen.cli.console import (
    PLACE,
    Number,
    effects_option,
    progress_bar,
    quiet_option,
    refuse_unused,
    tell,
    trust_option,
)
from st_codegen.errors import InputError, meant
from st_codegen.files.folders import write_texts
from st_codegen.files.temporary import temporary_folder
from st_codegen.files.text import make_folder

if TYPE_CHECKING:
    from st_codegen.reconcile.models.update import Update, Wish
    from st_codegen.reconcile.plan.next_runs import NextRuns
    from st_codegen.reconcile.result import Reconciliation
    from st_codegen.rig.effects import Effect
    from st_codegen.rig.model import RigModel


_NAMES = [f"{what}: {', '.join(names)}" for what, names in MISTAKES.items()]
_NAMES.append(f"{ALL}: all that is asked about; {AS_IS}: none but those named; a unit is answered by --scale alone")


def _accepted(_context: click.Context, _option: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
    """The names after --accept; for one that is none the nearest is proposed, and all are listed."""
    known = [*itertools.chain(*MISTAKES.values()), ALL, AS_IS]
    for name in given:
        if name not in known:
            first = f"'{name}' is none{meant(name, known) or '.'} By what is wrong, there are"
            raise click.BadParameter("\n  ".join([first, *_NAMES]))
    return given


@click.command(
    "reconcile",
    epilog="""\b
Examples:
  st-codegen reconcile --rig rig.toml --measured campaign/ --out found
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --effects my_effects.py
  st-codegen reconcile --rig rig.toml --measured harmonics.csv --out found --scale 57.29578   measured in rad
  st-codegen reconcile --rig rig.toml --measured campaign/ --out found --models models/ --update-models
  st-codegen reconcile --measured joint.csv --out found                   a robot's joint: t,q,dq,tau

\b
Names that --accept takes, by what is wrong:
  """
    + "\n  ".join(_NAMES),
)
@click.option("--rig", type=PLACE, help="Rig model, rig.toml; recordings of joints do without one.")
@click.option(
    "--measured",
    type=PLACE,
    required=True,
    help="Campaign folder, harmonic table, order spectrum, recording over time, or recordings of a joint (t,q,dq,tau).",
)
@click.option(
    "--out",
    type=PLACE,
    required=True,
    help="Folder for report.html, report.json, rig.toml, rig.diff, next_runs.csv; of joints for the report alone.",
)
@effects_option
@click.option(
    "--scale", type=Number(), help="Factor on the measured TE, or on a joint's torque; 1 to accept it as it is."
)
@click.option(
    "--accept",
    multiple=True,
    callback=_accepted,
    metavar="NAME",
    help="Correct a mistake of measuring that was asked about, and go on; see below for the names.",
)
@click.option("--empirical", is_flag=True, help="Add what has a formula but no name to the rig, as it is.")
@click.option("--skip-bad", is_flag=True, help="Leave out files that cannot be read, and say which.")
@click.option("--models", type=PLACE, help="Bundle of models that --update-models starts from.")
@click.option(
    "--update-models",
    "update",
    is_flag=True,
    help=f"Put what was found into the bundle: OUT/{UPDATED_MODELS}, compiled and verified in OUT/{UPDATED_CODE}, "
    "moved by the rig.",
)
@click.option("--target", default="twincat", help="Target of the updated models' text.")
@click.option(
    "--profile",
    default="cycloidal",
    help="Motion with the old and the new compensator: cycloidal, robot, a CSV (t,theta_out,torque_Nm), or none.",
)
@click.option("--json", "as_json", is_flag=True, help="Print report.json to standard output as well.")
@trust_option
@quiet_option
def command(
    rig: Path | None,
    measured: Path,
    out: Path,
    known: Mapping[str, type[Effect]],
    scale: float | None,
    accept: tuple[str, ...],
    empirical: bool,
    skip_bad: bool,
    models: Path | None,
    update: bool,
    target: str,
    profile: str,
    as_json: bool,
    trust_pickle: bool,
    quiet: bool,
) -> None:
    """Find what the rig model lacks: compare it with measured data, name the missing effects, and add them."""
    from st_codegen.reconcile.joint.reading import joint_files
    from st_codegen.reconcile.plan.next_runs import next_runs
    from st_codegen.reconcile.report.output import report
    from st_codegen.reconcile.report.summary import next_runs_summary, summary, update_summary
    from st_codegen.reconcile.run import reconcile_files, with_empirical
    from st_codegen.reconcile.spectrum import is_spectrum
    from st_codegen.rig.model import RigModel, read_rig

    joints = joint_files(measured)
    if rig is None and not joints:
        raise click.UsageError(
            "Missing option '--rig': only recordings of joints do without one, whose first line names the columns "
            f"t,q,dq,tau{_first_line(measured)}."
        )
    _refuse_unused(measured, accept, joints=bool(joints), without_rig=rig is None)
    model = RigModel() if rig is None else read_rig(rig, known)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; the report needs a folder")
    wish = _wish(model, models, update, target, profile, trust_pickle, out)
    if joints:
        content, text = _joints(joints, None if rig is None else model, out, scale, accept)
    elif is_spectrum(measured):
        content, text = _spectrum(model, measured, out, scale)
    else:
        with progress_bar("reconciling", quiet=quiet) as progress:
            result = reconcile_files(
                model, measured, known, scale=scale, accept=accept, skip_bad=skip_bad, progress=progress
            )
        result = with_empirical(result, known) if empirical else result
        ahead = next_runs(result)
        changes = _written(result, ahead, wish, out, quiet)
        following = [] if changes is None else [update_summary(changes)]
        following += [next_runs_summary(ahead, result), _page(out)]
        content, text = report(result, changes, ahead), summary(result, following)
    if not quiet:
        tell(text)
    if as_json:
        click.echo(json.dumps(content))


#: Parameters that say how models are updated, and which.
_OF_UPDATES = ("target", "profile", "trust_pickle", "features", "max_model_bytes")


def _refuse_unused(measured: Path, accept: tuple[str, ...], *, joints: bool, without_rig: bool) -> None:
    """Raise UsageError that lists the options without effect on this kind of measured data."""
    from st_codegen.reconcile.run import recordings_in
    from st_codegen.reconcile.spectrum import is_spectrum

    def others(*corrected: str) -> list[str]:
        return [f"--accept {name}" for name in accept if name not in corrected]

    if joints:
        where = f"on recordings of joints ({measured}), which say nothing of a bundle's transmission error"
        unused = ("effects", "empirical") if without_rig else ("empirical",)
        refuse_unused(where, *unused, "skip_bad", "models", "update", *_OF_UPDATES, others=others("sign", ALL))
    elif is_spectrum(measured):
        where = f"on an order spectrum ({measured}), which is one file without phases"
        refuse_unused(where, "accept", "empirical", "skip_bad", "models", "update", *_OF_UPDATES)
    elif recordings_in(measured):
        refuse_unused(
            f"on recordings over time ({measured}), which are taken as they are (convert columns, take out bad files)",
            *("scale", "skip_bad"),
            others=others(AS_IS),
        )
    elif measured.is_file():
        refuse_unused(f"on a harmonic table ({measured}), which is one file", "skip_bad")


def _first_line(measured: Path) -> str:
    """What stands in the first line of a file in place of the names that are wanted.

    Raises InputError for a file that is no text.
    """
    from st_codegen.files.csv_tables import header_of
    from st_codegen.files.text import read_text

    names = header_of(measured) if measured.is_file() else ()
    if measured.is_file() and not names and not read_text(measured):
        return f"; {measured} is empty"
    return f"; that of {measured} has {','.join(names)[:60]}" if any(names) else ""


def _wish(
    model: RigModel, models: Path | None, update: bool, target: str, profile: str, trust_pickle: bool, out: Path
) -> Wish | None:
    """What is to be done with a bundle; faults are named before anything is computed."""
    from st_codegen.te.bundle_file import BUNDLE_FILE

    if update != (models is not None):
        raise InputError("--models DIR and --update-models go together: which bundle is to get what is found?")
    if models is None:
        refuse_unused("without --models DIR and --update-models, which they are for", *_OF_UPDATES)
        return None
    if not (models / BUNDLE_FILE).is_file():
        raise InputError(f"{models}: no bundle; --models wants a folder with {BUNDLE_FILE}")
    for name, holds in ((UPDATED_MODELS, BUNDLE_FILE), (UPDATED_CODE, "")):
        replaced = out / name
        if replaced.exists() and (replaced.resolve() == models.resolve() or not (replaced / holds).exists()):
            raise InputError(f"{replaced} exists and would be replaced: name another --out")
    # what is loaded for it nobody else waits for
    from st_codegen.reconcile.models.update import Wish, check_models

    wish = Wish(models, target, "" if profile == "none" else profile, trust_pickle=trust_pickle)
    check_models(model, wish)
    return wish


def _written(result: Reconciliation, ahead: NextRuns, wish: Wish | None, out: Path, quiet: bool) -> Update | None:
    """Update the models, and write everything at once."""
    from st_codegen.reconcile.report.pages import report_texts

    parent = out if out.is_dir() else out.parent
    make_folder(parent)
    with temporary_folder(parent) as temporary:
        changes = None
        if wish is not None:
            from st_codegen.reconcile.models.update import update_models

            with progress_bar("updating models", quiet=quiet) as progress:
                changes = update_models(result, wish, temporary, progress)
        made = {folder: temporary / folder for folder in (UPDATED_MODELS, UPDATED_CODE)}
        folders = {folder: path for folder, path in made.items() if path.exists()}
        write_texts(out, report_texts(result, ahead, changes), folders)
    return changes


def _page(out: Path) -> str:
    """Where to go on reading."""
    return f"Read next: {out / 'report.html'}"


def _joints(
    files: list[Path], rig: RigModel | None, out: Path, scale: float | None, accept: tuple[str, ...]
) -> tuple[dict[str, Any], str]:
    """Reconcile recordings of joints and write the report: what report.json holds, and the text."""
    from st_codegen.reconcile.joint.findings import joint_report
    from st_codegen.reconcile.joint.page import joint_summary, joint_texts
    from st_codegen.reconcile.joint.reading import read_joints
    from st_codegen.reconcile.joint.run import reconcile_joints

    results = reconcile_joints(read_joints(files), scale, accept)
    content = joint_report(results, None if rig is None else rig.constants)
    write_texts(out, joint_texts(results, content))
    return content, f"{joint_summary(content)}\n{_page(out)}"


def _spectrum(model: RigModel, measured: Path, out: Path, scale: float | None) -> tuple[dict[str, Any], str]:
    """Compare an order spectrum and write the report: what report.json holds, and the text."""
    from st_codegen.reconcile.plan.next_runs import NextRuns
    from st_codegen.reconcile.report.pages import spectrum_page
    from st_codegen.reconcile.spectrum import read_spectrum, reconcile_spectrum, spectrum_report, spectrum_summary

    found = reconcile_spectrum(model, read_spectrum(measured), scale)
    content = spectrum_report(found)
    texts = {
        "rig.toml": found.rig.text(),
        "rig.diff": "",
        "report.json": json.dumps(content, indent=1, allow_nan=False) + "\n",
        "report.html": spectrum_page(found),
        "next_runs.csv": NextRuns().csv_text(),
    }
    write_texts(out, texts)
    return content, f"{spectrum_summary(found)}\n{_page(out)}"
