"""Reconcile: rig and measured data in, what is missing out."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from st_codegen.campaign.orders import listed
from st_codegen.errors import InputError, Problems
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.processes import Progress
from st_codegen.reconcile.data.checks import check, check_channels
from st_codegen.reconcile.data.noise import Noise, estimate
from st_codegen.reconcile.data.observations import Observations, rms_deg
from st_codegen.reconcile.data.reading import read_measured
from st_codegen.reconcile.data.recordings import (
    ANGLES,
    Recording,
    is_recording,
    observations,
    read_recordings,
)
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.parameters import Piece, piece_of
from st_codegen.reconcile.fit.state import State
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.claims import Conclusions, Retuned
from st_codegen.reconcile.judge.conclusions import conclude, gone, unchanged
from st_codegen.reconcile.judge.faint import faint
from st_codegen.reconcile.judge.links import (
    changed_with_unmeasured_links,
    coupling_link,
    servo_link,
    with_unmeasured_links,
)
from st_codegen.reconcile.judge.lookalikes import doubted, unlike_friction
from st_codegen.reconcile.judge.misread import Misread, in_place_of_the_rest, refined
from st_codegen.reconcile.mistakes.examine import Examined, examine
from st_codegen.reconcile.mistakes.recorded import check_accepted, check_recordings
from st_codegen.reconcile.mistakes.single_runs import AS_IS, Mistake, mistaken_runs
from st_codegen.reconcile.outcome import Outcome
from st_codegen.reconcile.rest.in_time import wander_over_runs
from st_codegen.reconcile.rest.lines import lines_in_samples
from st_codegen.reconcile.rest.structure import (
    floors,
    is_lacking,
    loud_and_foreign,
    scatter_of_encoder,
    scatter_within_turns,
)
from st_codegen.reconcile.rest.suspects import bad_runs, excused, without_structure
from st_codegen.reconcile.rest.unexplained import Signature, beside_the_rigs, loudest, of_a_hum, signatures
from st_codegen.reconcile.rest.unseen import below_noise, cannot_show
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.search.held_out import between_states, held_out_rms, untested_axes
from st_codegen.reconcile.search.plausible import lack_of_forms
from st_codegen.reconcile.search.selection import search, with_noise_of
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Effect, Stage
from st_codegen.rig.effects.base import BACKWARD
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread


@dataclass(frozen=True)
class Gap:
    """RMS in deg between model and measurement over all good runs and angles, and what noise alone gives."""

    before: float
    after: float
    noise_floor: float


@dataclass(frozen=True)
class OrderGap:
    """RMS in deg between model and measurement of one order; held_out: after, on conditions that the fit left out."""

    order: int
    before: float
    after: float
    noise_floor: float
    held_out: float


@dataclass(frozen=True)
class TakenBack:
    """Effects that explained the runs that were fitted and predicted others worse: gap (deg) before and with them."""

    names: tuple[str, ...]
    before: float
    after: float


@dataclass(frozen=True)
class Reconciliation:
    """What `reconcile` found, with the data and the fits that it comes from.

    unseen_curves: from how many that no search saw the held-out gap comes (0: none); between_deg: RMS by which a
    resonance may be off at temperatures between two that were measured, in the held-out gap; carriers: how many curves
    that leave equally much would tell the held-out gap as well.
    """

    rig: RigModel
    new_rig: RigModel
    data: Observations
    target: FitData
    noise: Noise
    conclusions: Conclusions
    judged: tuple[tuple[Candidate, Evidence], ...]
    unexplained: tuple[Signature, ...]
    fitted: Gap
    held_out: Gap
    orders: tuple[OrderGap, ...]
    mistakes: tuple[Mistake, ...] = ()
    cannot_show: tuple[str, ...] = ()
    unseen_curves: int = 0
    taken_back: TakenBack | None = None
    between_deg: float = 0.0
    carriers: float = math.inf
    untested: tuple[str, ...] = ()

    @property
    def held_out_is_bound(self) -> bool:
        """Whether the held-out gap may be larger: few runs say too little, or at other speeds a hum meets other orders.

        Where few of many curves carry it, there may be more such places between them; where the levels of a condition
        are too few to leave one out, nothing was predicted between them.
        """
        few = self.data.few_points or (self.held_out_scatters and self.few_carry)
        return few or bool(self.untested) or any(one.frequency_Hz for one in self.data.hums)

    @property
    def few_carry(self) -> bool:
        """Whether fewer of the curves that tell the held-out gap carry it than do so by chance where all are alike."""
        return not self.carriers > self.unseen_curves / SETTINGS.carried_by_one_in > 0

    @property
    def held_out_scatters(self) -> bool:
        """Whether so few curves tell the held-out gap that others may well have another, larger or smaller."""
        return self.carriers < SETTINGS.least_curves

    @property
    def verdict(self) -> Outcome:
        """Whether what differs is named, and whether more than noise is left."""
        named = bool(self.conclusions.claims or self.conclusions.retuned or self.conclusions.offset_changed)
        found = Outcome.of(named=named, is_more_left=bool(self.unexplained) or self._is_more_than_noise)
        # what a few runs leave may be noise, or what their model lacks between them
        few = found is Outcome.EXPLAINED and self.data.few_points
        return Outcome.PARTLY_EXPLAINED if few else found

    @property
    def _is_more_than_noise(self) -> bool:
        """Whether more than noise is left: few runs, or samples over time, can leave that without a pattern."""
        return self.fitted.after > SETTINGS.clearly_larger * self.fitted.noise_floor

    @property
    def floor_is_bound(self) -> bool:
        """Whether the noise floor may be smaller.

        What runs differ by from others holds what is unexplained, or varies between few runs, as well as the noise.
        """
        return bool(self.unexplained) or self.data.few_points or self._is_more_than_noise

    @property
    def scatter_beside_floor_deg(self) -> float:
        """RMS of what differs from run to run by more than the floor, without a pattern over the conditions.

        Of the mean and the lowest orders the floor holds it.
        """
        return self._scatter(lambda order: order > SETTINGS.wander_orders)

    @property
    def scatter_in_floor_deg(self) -> float:
        """RMS of what differs from run to run without a pattern over the conditions and is a part of the floor."""
        return self._scatter(lambda order: order <= SETTINGS.wander_orders)

    def _scatter(self, chosen: Callable[[int], bool]) -> float:
        """RMS over the chosen orders, less what a hum that was taken out of the curves has in them."""
        hums = [hum.by_order for hum in self.data.hums]
        left = [one for one in self.unexplained if "scatter" in one.dependence and chosen(one.order)]
        of_hums = (sum(float(made[one.order]) ** 2 for made in hums) for one in left)
        return math.sqrt(sum(max(one.rms_deg**2 - hum, 0.0) for one, hum in zip(left, of_hums, strict=True)))


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
        others = [file.name for file in sorted(measured.glob("*.csv")) if file.is_file() and file not in files]
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
        check(data, rig, measured, units=False)
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
    return reconcile_observations(rig, examined.data, known, progress, examined)


def _read_anew(result: Reconciliation, examined: Examined, measured: Path, accept: Collection[str]) -> Examined | None:
    """What was examined, read as `accept` and the result say; None where there is nothing to change."""
    found = result.conclusions
    # what a correction that was accepted is off by is nothing new to ask about
    named = {*accept} | {
        one.reading.name
        for one in found.misread
        if one.is_asked and ("all" in accept or one.reading.refines in examined.corrected & set(accept))
    }
    taken = next((one for one in found.misread if one.reading.name in named), None)
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
    does += [f"leaves nothing but noise of what no effect was found for (orders {rest})"] * bool(rest)
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
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    return [file for file in files if file.is_file() and is_recording(file)]


def reconcile_recordings(
    rig: RigModel, recordings: Sequence[Recording], known: Catalogue, progress: Progress | None = None
) -> Reconciliation:
    """Links of the axis, then the reducer's transmission error sample by sample."""
    result = reconcile_observations(rig, observations(recordings, rig), known, progress)
    links = [link for link in (servo_link(recordings, rig), coupling_link(recordings, rig)) if link is not None]
    claims = tuple(link.claim for link in links if link.claim is not None)
    retuned = tuple(link.retuned for link in links if link.retuned is not None)
    found = result.conclusions
    conclusions = replace(
        found,
        claims=(*with_unmeasured_links(found.claims, recordings), *claims),
        retuned=(*changed_with_unmeasured_links(found.retuned, recordings), *retuned),
    )
    changed = {entry.before: entry.after for entry in retuned}
    effects = [changed.get(effect, effect) for effect in result.new_rig.effects]
    new_rig = replace(result.new_rig, effects=(*effects, *(claim.piece.effect for claim in claims)))
    rest = tuple(
        Signature(0, link.after, link.after**2, {"constant": 1.0}, "both", link.unexplained, share=1.0)
        for link in links
        if link.unexplained
    )

    def whole(gap: Gap) -> Gap:
        """The gap of all links together, at the output."""
        sums = [
            math.hypot(own, *others)
            for own, others in (
                (gap.before, [link.before for link in links]),
                (gap.after, [link.after for link in links]),
                (gap.noise_floor, [link.floor for link in links]),
            )
        ]
        return Gap(*sums)

    return replace(
        result,
        conclusions=conclusions,
        new_rig=new_rig,
        unexplained=(*result.unexplained, *rest),
        fitted=whole(result.fitted),
        held_out=whole(result.held_out),
    )


def reconcile_observations(
    rig: RigModel,
    data: Observations,
    known: Catalogue,
    progress: Progress | None = None,
    examined: Examined | None = None,
) -> Reconciliation:
    """The statistical core on observations; `examined`: what is known of mistakes of measuring in them."""
    with one_thread("scipy.linalg"):
        return _reconcile(rig, known, progress, examined or Examined(data))


def _reconcile(
    rig: RigModel,
    known: Catalogue,
    progress: Progress | None,
    examined: Examined,
    without: tuple[Retuned, ...] = (),
) -> Reconciliation:
    """The core; without: effects of the rig of which the data show nothing, as a first pass over all of it found."""
    whole, left_out = rig, {one.before for one in without}
    rig = rig.with_effects(effect for effect in rig.effects if effect not in left_out)
    data = examined.data
    model = data.observed(rig.coefficients(data.at, data.model_orders()))
    bad = np.zeros(len(data), bool)
    bad[list(examined.left_out)] = True
    data = replace(data, left_out=bad) if bad.any() else data
    apart = _apart(data)
    shown = data if not apart.any() else replace(data, left_out=apart | bad)
    noise = estimate(shown, data.values - model)
    target = FitData(shown, noise.sigma, noise.good, groups_of(data.at), *_of(rig), corrected=examined.corrected)
    state = State(rig, rig.zero_offset_deg, tuple(map(_own, (e for e in rig.effects if e.stage is not Stage.AXIS))))
    last, judged = search(target, state, known, progress)
    # which effects there may be is decided; whether they stand, and how large they are, all runs say
    last = fit(with_noise_of(replace(last, target=replace(target, data=data)))[0], last.state)
    # a run that is bad as a whole would keep what stands from leaving nothing but noise
    noise = _with_suspects(last.target, last, with_noise_of(last)[1])
    if (noise.good != last.target.good).any():
        last = fit(replace(last.target, sigma=noise.sigma, good=noise.good).about(last.residual), last.state)
    conclusions = conclude(rig, last, known)
    if not without and (more := gone(last, conclusions)):
        # what the rig has too much bends what is beside it
        return _reconcile(whole, known, progress, examined, more)
    conclusions = replace(conclusions, retuned=(*without, *conclusions.retuned))
    result = _result(whole, data, conclusions, tuple(judged), examined, apart)
    worse = result.held_out.after > SETTINGS.worse * result.held_out.before
    result = _with_between_states(result)
    if worse and result.new_rig is not whole:
        nothing = replace(conclusions, final=unchanged(last), claims=(), retuned=without, offset_changed=False)
        names = tuple(dict.fromkeys(claim.piece.effect.name for claim in conclusions.claims))
        gap = (result.held_out.before, result.held_out.after)
        result = _result(whole, data, nothing, tuple(judged), examined, apart)
        result = replace(result, taken_back=TakenBack(names, *gap))
    return result


def _with_between_states(result: Reconciliation) -> Reconciliation:
    """The held-out gap with what a resonance may be off by where no temperature was measured, no more than before.

    What was kept from the search may hold little of a peak: before, all runs say what the rig leaves.
    """
    gap, between = result.held_out, float(between_states(result.conclusions.final).sum())
    if not between:
        return result
    before = max(gap.before, result.fitted.before)
    after = min(math.sqrt(gap.after**2 + between), max(before, gap.after))
    return replace(result, held_out=replace(gap, before=before, after=after), between_deg=math.sqrt(between))


def _apart(data: Observations) -> BoolArray:
    """Rows of operating points that the search does not see, bool (n,): none where there are few points."""
    kinds, number = np.unique(data.at.points, axis=0, return_inverse=True)
    count = len(kinds)
    if data.angle_rad is not None or count < SETTINGS.least_points_apart:
        return np.zeros(len(data), bool)
    chosen = np.random.default_rng(0).permutation(count)[: count // SETTINGS.one_apart_in]
    found: BoolArray = np.isin(number.ravel(), chosen)
    return found


def _result(
    rig: RigModel,
    data: Observations,
    conclusions: Conclusions,
    judged: tuple[tuple[Candidate, Evidence], ...],
    examined: Examined,
    apart: BoolArray,
) -> Reconciliation:
    """Gaps, and what is left, of a fit."""
    target, noise = with_noise_of(conclusions.final)
    noise = _with_suspects(target, conclusions.final, noise)
    target = replace(target, good=noise.good)
    final = replace(conclusions.final, target=target)
    before, after, good = target.residual(rig), final.residual, noise.good
    hums = _OfHums.of(data)
    floor_rms, left = _left_over(final, before, noise, judged)
    gap_power = hums.with_all(rms_deg(before[good], data.orders)) ** 2
    # what noise is left where the noise holds what is unexplained as well nobody knows
    told = [one.order for one in left if not (one.at_least or "scatter" in one.dependence)]
    conclusions = conclusions.with_misread(in_place_of_the_rest(final, told))
    unseen = _held_out(final, before, apart)

    def whole(before: float, after: float) -> Gap:
        return Gap(hums.with_all(before), hums.with_all(after), float(np.linalg.norm(floor_rms)))

    def of_order(k: int) -> OrderGap:
        fitted = [rms_deg(values[good][:, [k]], data.orders[[k]]) for values in (before, after)]
        own = [hums.with_own(rms, k) for rms in (*fitted, float(unseen.by_order[k]))]
        return OrderGap(int(data.orders[k]), own[0], own[1], float(floor_rms[k]), own[2])

    orders = [one.order for one in left if one.order >= 0]
    return Reconciliation(
        rig=rig,
        new_rig=_new_rig(rig, final, conclusions),
        data=data,
        target=target,
        noise=noise,
        conclusions=doubted(
            conclusions,
            orders,
            beside_the_rigs(orders, rig.orders()),
            rig.orders(),
            in_samples=data.angle_rad is not None,
        ),
        judged=judged,
        unexplained=tuple(one.of_gap(gap_power) for one in left),
        fitted=whole(rms_deg(before[good], data.orders), rms_deg(after[good], data.orders)),
        held_out=whole(unseen.before, float(np.linalg.norm(unseen.by_order))),
        orders=tuple(map(of_order, range(len(data.orders)))),
        mistakes=examined.mistakes,
        cannot_show=(
            *cannot_show(data),
            *unlike_friction(conclusions.final, conclusions.effects),
            *below_noise(target),
            *examined.untold,
            *scatter_of_encoder(target, after),
            *scatter_within_turns(target, after),
            *wander_over_runs(target, after, [one.order for one in left]),
        ),
        unseen_curves=unseen.curves,
        untested=untested_axes(conclusions.final) if data.angle_rad is None else (),
        carriers=math.inf
        if data.angle_rad is not None
        else _alike((np.abs(unseen.left) ** 2 / data.parts).sum(axis=1)),
    )


@dataclass(frozen=True)
class _OfHums:
    """The power (deg^2) that hums had in the gap before they were taken out of the curves.

    by_order: of the orders that are looked at, (K,); elsewhere: of all others together.
    """

    by_order: FloatArray
    elsewhere: float

    @classmethod
    def of(cls, data: Observations) -> _OfHums:
        """The power of the hums that were taken out of the data."""
        by_order = sum((one.by_order[data.orders] ** 2 for one in data.hums), np.zeros(len(data.orders)))
        return cls(by_order, max(0.0, sum(one.power for one in data.hums) - float(by_order.sum())))

    def with_all(self, rms: float) -> float:
        """The RMS of the curves from what all orders have, with all that was taken out."""
        return math.hypot(rms, math.sqrt(float(self.by_order.sum()) + self.elsewhere))

    def with_own(self, rms: float, k: int) -> float:
        """The RMS of one order, by its place, with what was taken out of it."""
        return math.hypot(rms, math.sqrt(float(self.by_order[k])))


@dataclass(frozen=True)
class _Unseen:
    """What rows that were left out keep: RMS by order (K,), what the rig leaves of them in all, the residual, curves.

    curves: how many no search has seen; 0 where whole levels were left out of the fit alone.
    """

    by_order: FloatArray
    before: float
    left: ComplexArray
    curves: int = 0


def _held_out(final: Fit, before: ComplexArray, apart: BoolArray) -> _Unseen:
    """The larger of the gaps of left-out levels, and of rows that no search has seen (apart, (n,)).

    before: what the rig leaves, (n, K).
    """
    target, orders = final.target, final.target.data.orders
    levels = _Unseen(held_out_rms(final), rms_deg(before[target.good], orders), final.residual[target.good])
    kept = apart & target.good
    if not kept.any():
        return levels
    left = target.residual(fit(target.subset(~apart), final.state).state.model(), kept)
    by_order = np.sqrt((np.abs(left) ** 2).mean(axis=0) / target.data.parts)
    # runs between those seen say nothing of levels between them: a gap that is clearly larger there counts
    if np.linalg.norm(levels.by_order) < SETTINGS.clearly_larger * np.linalg.norm(by_order):
        return _Unseen(by_order, rms_deg(before[kept], orders), left, int(kept.sum()))
    return levels


def _left_over(
    final: Fit,
    before: ComplexArray,
    noise: Noise,
    judged: Sequence[tuple[Candidate, Evidence]],
) -> tuple[FloatArray, list[Signature]]:
    """The noise floor (K,), and what is left of a gap with a pattern, faintly, or without any.

    before: what the rig leaves, (n, K).
    """
    target, data = final.target, final.target.data
    floor_rms, left = _unexplained(target, final, before, noise)
    left = left or faint(final, judged)
    # the noise within the curves says nothing of the mean, and little of the lowest orders, in which noise wanders:
    # what runs differ by holds what these keep as well, and is the most that it can be
    kept = [one.order for one in left if one.order <= SETTINGS.wander_orders]
    floor_rms = np.where(np.isin(data.orders, kept), np.maximum(floor_rms, noise.floor_rms), floor_rms)
    after = rms_deg(final.residual[target.good], data.orders)
    if not left and data.angle_rad is None and after > SETTINGS.clearly_larger * float(np.linalg.norm(floor_rms)):
        left = [loudest(target, final.residual, floor_rms)]
    return floor_rms, left


def _unexplained(target: FitData, final: Fit, before: ComplexArray, noise: Noise) -> tuple[FloatArray, list[Signature]]:
    """The noise floor (K,) and what is left of a gap; before: what the rig leaves, (n, K)."""
    data, after = target.data, final.residual
    if data.angle_rad is not None:
        lines = lines_in_samples(target, after)
        # the samples that were looked at are so far apart that waves change from one to the next
        rest = float((after.real**2).mean()) - sum(one.rms_deg**2 for one in lines)
        return np.minimum(noise.floor_rms, np.sqrt(max(rest, data.neighbours_deg**2, data.rounded_deg**2))), lines
    floor_rms = floors(target, after, noise.floor_rms)
    kept = excused(data, after, noise, is_lacking(target, after))
    kept |= loud_and_foreign(target, after, final.state.rig.orders())
    left = signatures(target, after, floor_rms, (before != after).any(axis=0), kept)
    return floor_rms, [*map(of_a_hum, data.hums), *left]


def _alike(powers: FloatArray) -> float:
    """As many equal numbers as these have a mean that is as sure as that of these."""
    share = powers / max(float(powers.max(initial=0.0)), 1e-300)
    return float(share.sum() ** 2 / (share**2).sum()) if share.any() else math.inf


def _with_suspects(target: FitData, final: Fit, noise: Noise) -> Noise:
    """The noise with the bad runs that only the fitted model shows: they are named, and stay out of gap and rest."""
    data = target.data
    # what the model lacks is no fault of a run
    lacking = is_lacking(target, final.residual)
    lacking |= loud_and_foreign(target, final.residual, final.state.rig.orders())
    noise = without_structure(data, final.residual, noise, lacking)
    found = bad_runs(data, final.residual, noise.sigma, lacking, lack_of_forms(final))
    if not found:
        return noise
    bad = ~noise.good
    bad[list(found)] = True
    again = without_structure(data, final.residual, estimate(data, final.residual, bad), lacking)
    ranked = sorted((dict(noise.suspects) | found | dict(again.suspects)).items(), key=lambda entry: -entry[1])
    return replace(again, suspects=tuple(ranked))


def _of(rig: RigModel) -> tuple[float, float, float]:
    return rig.constants.reduction_ratio, rig.constants.reference_temperature_C, rig.noise.run_offset_deg


def _own(effect: Effect) -> Piece:
    return piece_of(effect, added=False, origin=effect)


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


def _new_rig(rig: RigModel, final: Fit, conclusions: Conclusions) -> RigModel:
    """The rig with what was found: changed parameters in place, new effects at the end."""
    if not (conclusions.claims or conclusions.retuned or conclusions.offset_changed):
        return rig
    without = {one.before for one in conclusions.retuned if one.is_gone}
    fitted = iter(piece for piece in final.state.pieces if not piece.added)
    kept = [
        effect if effect.stage is Stage.AXIS else next(fitted).effect for effect in rig.effects if effect not in without
    ]
    new = [claim.piece.effect for claim in conclusions.claims]
    offset = final.state.offset if conclusions.offset_changed else rig.zero_offset_deg
    return replace(rig, zero_offset_deg=offset, effects=(*kept, *new))
