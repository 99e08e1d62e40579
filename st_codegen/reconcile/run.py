"""Reconcile: rig and measured data in, what is missing out."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from st_codegen.campaign.orders import listed
from st_codegen.errors import InputError, Problems
from st_codegen.files.csv_tables import csv_files
from st_codegen.processes import Progress
from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.checks import check, check_channels
from st_codegen.reconcile.data.reading import read_measured
from st_codegen.reconcile.data.recordings import (
    ANGLES,
    Recording,
    is_recording,
    is_whole_turn,
    observations,
    read_recordings,
)
from st_codegen.reconcile.judge.claims import Conclusions
from st_codegen.reconcile.judge.links import coupling_link, servo_link, with_unmeasured_links
from st_codegen.reconcile.judge.misread import Misread, refined
from st_codegen.reconcile.judge.recorded import with_doubts
from st_codegen.reconcile.mistakes.examine import Examined, examine
from st_codegen.reconcile.mistakes.recorded import check_accepted, check_recordings
from st_codegen.reconcile.mistakes.single_runs import AS_IS, Mistake, mistaken_runs
from st_codegen.reconcile.outcome import Gap
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue
from st_codegen.rig.effects.base import BACKWARD
from st_codegen.rig.model import RigModel


def reconcile_files(
    rig: RigModel,
    measured: Path,
    known: Catalogue,
    *,
    scale: float | None = None,
    accept: Collection[str] = (),
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> Reconciliation:
    """Read measured data and reconcile. Raises InputError for data that cannot be compared with the rig."""
    rig = rig.of_effects()
    files = recordings_in(measured)
    if files:
        recordings = read_recordings(files)
        check_accepted(scale, accept, measured)
        if AS_IS not in accept:
            check_recordings(recordings, rig, measured)
        others = [file.name for file in csv_files(measured) if file.is_file() and file not in files]
        result = reconcile_recordings(rig, recordings, known, progress)
        if not others:
            return result
        aside = f"{', '.join(others)}: no recordings, which have the column t and one of {', '.join(ANGLES)}"
        return replace(result, data=replace(result.data, not_looked_at=(*result.data.not_looked_at, aside)))
    data = read_measured(measured, rig, progress, skip_bad=skip_bad, scale=scale or 1.0).without_copies()
    if scale is not None:
        data = data.scaled(scale)
    check_channels(data, measured)
    problems, examined = Problems(str(measured)), Examined(data)
    with problems.collect():
        check(data, rig, measured)
    with problems.collect():
        examined = examine(data, rig, measured, scale=scale, accept=accept)
    problems.raise_if_any()
    return _reread(rig, examined, measured, known, accept, progress)


def _reread(
    rig: RigModel,
    examined: Examined,
    measured: Path,
    known: Catalogue,
    accept: Collection[str] = (),
    progress: Progress | None = None,
) -> Reconciliation:
    """The result, of data that are read as `accept` says. Raises InputError where one number of the measurement would
    do what several changes of the rig do, until it is accepted or the data are taken as they are.
    """
    for _ in range(SETTINGS.rereadings):
        result = reconcile_observations(rig, examined.data, known, progress, examined)
        better = _read_anew(result, examined, measured, accept)
        if better is None:
            return result
        examined = better
    return reconcile_observations(rig, examined.data, known, progress, replace(examined, as_is=True))


def _read_anew(result: Reconciliation, examined: Examined, measured: Path, accept: Collection[str]) -> Examined | None:
    """What was examined, read as `accept` and the result say; None where there is nothing to change."""
    found = result.conclusions
    # what a correction that was accepted is off by is nothing new to ask about
    named = {*accept} | {
        one.reading.name
        for one in found.misread
        if one.is_asked and ("all" in accept or one.reading.refines in examined.corrected & set(accept))
    }
    # what nobody asks about is taken once: the next reading of that name stands for what else was found
    done = {mistake.name for mistake in examined.mistakes if mistake.is_taken_out}
    taken = next(
        (one for one in found.misread if one.reading.name in named and (one.is_asked or one.reading.name not in done)),
        None,
    )
    if taken is None and AS_IS not in accept:
        asked = next((one for one in found.misread if one.is_asked), None)
        if asked is not None:
            raise InputError(f"{measured}: {_question(asked, found)}")
        taken = refined(found.final, examined.corrected)
    if taken is None:
        return _cleared(result, examined)
    again = examine(
        taken.meant(examined.data), result.rig, measured, scale=1.0, accept=accept, corrected=examined.corrected
    )
    read = Mistake(taken.reading.name, f"{taken.text} (corrected)", is_taken_out=True)
    kept = (mistake for mistake in examined.mistakes if not mistake.rows)
    return replace(again, mistakes=(*kept, read, *again.mistakes), untold=again.untold or examined.untold)


def _question(one: Misread, found: Conclusions) -> str:
    """What is asked about a reading that stands for several changes of the rig, or for what is unexplained."""
    changes, rest = found.changes_for(one), listed(sorted(one.unexplained))
    many = "a change" if len(one.instead_of) == 1 else f"{len(one.instead_of)} changes"
    does = [f"does what {many} of the rig would have to do ({', '.join(changes)})"] * bool(changes)
    does += [f"leaves {one.leaves} of what no effect was found for (orders {rest})"] * bool(rest)
    return (
        f"it looks like {one.text}: that alone {' and '.join(does)}; give --accept {one.reading.name} to correct it, "
        f"or --accept {AS_IS} to take the data as they are"
    )


def _cleared(result: Reconciliation, examined: Examined) -> Examined | None:
    """What was examined, with the wrong labels of the new rig; None where they hold all of the old rig's."""
    if not examined.left_out or result.new_rig is result.rig:
        return None
    again = mistaken_runs(examined.data, result.new_rig)
    rows = {row for mistake in again or () for row in mistake.rows}
    if again is None or rows >= set(examined.left_out):
        return None
    kept = (mistake for mistake in examined.mistakes if not mistake.rows)
    return replace(examined, mistakes=(*kept, *again), left_out=tuple(sorted(rows)))


def recordings_in(path: Path) -> list[Path]:
    """The recordings that a path names: the file itself, or those of a folder; none where it is something else."""
    files = csv_files(path) if path.is_dir() else [path]
    return [file for file in files if file.is_file() and is_recording(file)]


def reconcile_recordings(
    rig: RigModel, recordings: Sequence[Recording], known: Catalogue, progress: Progress | None = None
) -> Reconciliation:
    """Links of the axis, then the reducer's transmission error sample by sample."""
    result = reconcile_observations(rig, observations(recordings, rig), known, progress)
    links = [link for link in (servo_link(recordings, rig), coupling_link(recordings, rig)) if link is not None]
    claims = tuple(link.claim for link in links if link.claim is not None)
    retuned = tuple(link.retuned for link in links if link.retuned is not None)
    is_whole = any(is_whole_turn(r, rig) for r in recordings if "theta_out" in r.angles)
    found = with_doubts(result.conclusions, is_whole_turn=is_whole, is_more_left=_is_left_of_mean(result))
    found = with_unmeasured_links(found, recordings)
    conclusions = replace(found, claims=(*found.claims, *claims), retuned=(*found.retuned, *retuned))
    changed = {entry.before: entry.after for entry in retuned}
    effects = [changed.get(effect, effect) for effect in result.new_rig.effects]
    new_rig = replace(result.new_rig, effects=(*effects, *(claim.piece.effect for claim in claims)))
    rest = tuple(
        Signature(0, link.gap.after, link.gap.after**2, {"constant": 1.0}, "both", link.unexplained, share=1.0)
        for link in links
        if link.unexplained
    )

    def whole(gap: Gap) -> Gap:
        """The gap of all links together, at the output."""
        return Gap(*map(math.hypot, *map(astuple, (gap, *(link.gap for link in links)))))

    return replace(
        result,
        conclusions=conclusions,
        new_rig=new_rig,
        unexplained=(*result.unexplained, *rest),
        fitted=whole(result.fitted),
        held_out=whole(result.held_out),
    )


def _is_left_of_mean(result: Reconciliation) -> bool:
    """Whether beside the waves that stay unexplained clearly more than noise is left."""
    waves = sum(one.rms_deg**2 for one in result.unexplained if one.order != 0)
    return result.fitted.after**2 - waves > (SETTINGS.clearly_larger * result.fitted.noise_floor) ** 2


def with_empirical(result: Reconciliation, known: Catalogue) -> Reconciliation:
    """The result with what has a formula and no name in the new rig, as effects `empirical`."""
    added = []
    for signature in result.unexplained:
        if signature.formula is None:
            continue
        values: dict[str, float] = {"order": signature.order}
        for name, sides in signature.formula.terms.items():
            for front, side in zip(("", BACKWARD), sides, strict=True):
                values |= {f"{front}{name}_deg": abs(side), f"{front}{name}_phase_rad": float(np.angle(side))}
        added.append(known["empirical"](values, result.rig.constants))
    return replace(result, new_rig=replace(result.new_rig, effects=(*result.new_rig.effects, *added)))
