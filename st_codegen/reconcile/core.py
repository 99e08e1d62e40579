"""The statistical core: observations and a rig in, what is missing out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.processes import Progress
from st_codegen.reconcile.data.contrasts import speed_levels
from st_codegen.reconcile.data.noise import Noise, estimate
from st_codegen.reconcile.data.observations import Observations, rms_deg
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.state import State, piece_of
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.claims import Conclusions, Retuned
from st_codegen.reconcile.judge.conclusions import conclude, gone, unchanged
from st_codegen.reconcile.judge.few_runs import with_scatter, without_scatter
from st_codegen.reconcile.judge.lookalikes import doubted, of_one_angle, unlike_friction
from st_codegen.reconcile.judge.misread import in_place_of_the_rest
from st_codegen.reconcile.mistakes.examine import Examined
from st_codegen.reconcile.outcome import Gap
from st_codegen.reconcile.rest.lasting import wander_over_runs
from st_codegen.reconcile.rest.lines import lines_in_samples
from st_codegen.reconcile.rest.structure import (
    floors,
    is_lacking,
    loud_and_foreign,
    scatter_of_a_table,
    scatter_of_encoder,
    scatter_within_turns,
)
from st_codegen.reconcile.rest.suspects import (
    bad_runs,
    excused,
    undecided_runs,
    with_beside,
    with_rest,
    without_structure,
)
from st_codegen.reconcile.rest.unexplained import Signature, loudest, of_a_hum, signatures
from st_codegen.reconcile.rest.unseen import below_noise, cannot_show
from st_codegen.reconcile.result import OrderGap, Reconciliation, TakenBack
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.evidence import Evidence, between_states, held_out_rms, untested_axes
from st_codegen.reconcile.search.plausible import lack_of_forms
from st_codegen.reconcile.search.selection import faint, search, with_noise_of
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Stage
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread


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
    rig: RigModel, known: Catalogue, progress: Progress | None, examined: Examined, without: tuple[Retuned, ...] = ()
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
    target = FitData(
        shown,
        noise.sigma,
        noise.good,
        groups_of(data.at),
        rig.constants.reduction_ratio,
        rig.constants.reference_temperature_C,
        rig.noise.run_offset_deg,
        corrected=examined.corrected,
    )
    own = (piece_of(effect, added=False, origin=effect) for effect in rig.effects if effect.stage is not Stage.AXIS)
    state = State(rig, rig.zero_offset_deg, tuple(own))
    last, judged = search(target, state, known, progress)
    # which effects there may be is decided; whether they stand, and how large they are, all runs say
    last = fit(with_noise_of(replace(last, target=replace(target, data=data)))[0], last.state)
    # a run that is bad as a whole would keep what stands from leaving nothing but noise
    noise = _with_suspects(last.target, last, with_noise_of(last)[1])
    if (noise.good != last.target.good).any():
        last = fit(replace(last.target, sigma=noise.sigma, good=noise.good).about(last.residual), last.state)
    conclusions = conclude(rig, with_scatter(last), known)
    # whether data were read wrong is asked before it is said what is none of the machine
    asked = not examined.as_is and any(one.is_asked for one in conclusions.misread)
    if not without and not asked and (more := gone(conclusions.joint, conclusions)):
        # what the rig has too much bends what is beside it
        found = _reconcile(whole, known, progress, examined, more)
        # left-out runs that the rig as it was predicts better: then it is there
        if found.held_out.after <= SETTINGS.worse * found.held_out.before:
            return found
    conclusions = without_scatter(replace(conclusions, retuned=(*without, *conclusions.retuned)))
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
    return np.isin(number.ravel(), chosen)


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
    to_these, before = conclusions.final.target.good, target.residual(rig)
    noise = with_beside(data, _with_suspects(target, conclusions.final, noise), to_these)
    last = replace(conclusions.final, target=target)
    final, floor_rms, left = _ended(last, before, noise, judged)
    if left and noise.suspects:
        noise = with_rest(data, final.residual, noise, to_these, [one.order for one in left])
        final, floor_rms, left = _ended(last, before, noise, judged)
    fitted = replace(last, target=replace(target, good=noise.good))
    noise = noise.with_the_undecided
    target, after, good = final.target, final.residual, noise.good
    # what hums had in the gap before they were taken out: the power of each order, and the RMS of all, also of others
    of_hums = data.hum_power(data.orders)
    all_hums = math.sqrt(float(of_hums.sum()) + max(0.0, sum(one.power for one in data.hums) - float(of_hums.sum())))
    gap_power = math.hypot(rms_deg(before[good], data.orders), all_hums) ** 2
    # what noise is left where the noise holds what is unexplained as well nobody knows
    told = [one.order for one in left if not (one.at_least or one.is_scatter)]
    conclusions = conclusions.with_misread(in_place_of_the_rest(final, told))
    unseen = _held_out(fitted, before, apart)

    def whole(before: float, after: float) -> Gap:
        return Gap(math.hypot(before, all_hums), math.hypot(after, all_hums), float(np.linalg.norm(floor_rms)))

    def of_order(k: int) -> OrderGap:
        fitted = [rms_deg(values[good][:, [k]], data.orders[[k]]) for values in (before, after)]
        own = [math.hypot(rms, math.sqrt(of_hums[k])) for rms in (*fitted, float(unseen.by_order[k]))]
        return OrderGap(int(data.orders[k]), own[0], own[1], float(floor_rms[k]), own[2])

    orders, in_samples = [one.order for one in left if one.order >= 0], data.angle_rad is not None
    expressed = {k for effect in rig.effects if effect.name == "empirical" for k in effect.touched_orders()}
    by_load = [one.order for one in left if one.depends_on_the_load]
    return Reconciliation(
        rig=rig,
        new_rig=_new_rig(rig, final, conclusions),
        data=data,
        target=target,
        noise=noise,
        conclusions=doubted(
            conclusions, orders, by_load, rig.orders(), of_one_angle(final, before), expressed, in_samples=in_samples
        ),
        judged=judged,
        unexplained=tuple(one.of_gap(gap_power).of_machine(rig.constants) for one in left),
        fitted=whole(rms_deg(before[good], data.orders), rms_deg(after[good], data.orders)),
        held_out=whole(unseen.before, float(np.linalg.norm(unseen.by_order))),
        orders=tuple(map(of_order, range(len(data.orders)))),
        mistakes=examined.mistakes,
        cannot_show=(
            *cannot_show(data),
            *unlike_friction(conclusions.final, conclusions.effects),
            *undecided_runs(data, noise),
            *below_noise(target),
            *examined.untold,
            *scatter_of_encoder(target, after),
            *scatter_within_turns(target, after),
            *scatter_of_a_table(target, [one.order for one in left]),
            *wander_over_runs(target, after, [one.order for one in left]),
        ),
        unseen_curves=unseen.curves,
        untested=() if in_samples else untested_axes(conclusions.final),
        carriers=math.inf if in_samples else _carriers(_powers(data, unseen.left)),
        testers=math.inf if in_samples else _points_that_test(data, before, unseen, conclusions),
    )


@dataclass(frozen=True)
class _Unseen:
    """What rows that were left out keep: RMS by order (K,), what the rig leaves of them in all, the residual, curves.

    rows: which they are, bool (n,); curves: how many no search has seen; 0 where whole levels were left out of the fit
    alone.
    """

    by_order: FloatArray
    before: float
    left: ComplexArray
    rows: BoolArray
    curves: int = 0


def _held_out(final: Fit, before: ComplexArray, apart: BoolArray) -> _Unseen:
    """The larger of the gaps of left-out levels, and of rows that no search has seen (apart, (n,)).

    before: what the rig leaves, (n, K).
    """
    target, orders = final.target, final.target.data.orders
    good = target.good
    levels = _Unseen(held_out_rms(final), rms_deg(before[good], orders), final.residual[good], good)
    kept = apart & good
    if not kept.any():
        return levels
    left = target.residual(fit(target.subset(~apart), final.state).state.model(), kept)
    by_order = np.sqrt((np.abs(left) ** 2).mean(axis=0) / target.data.parts)
    # runs between those seen say nothing of levels between them: a gap that is clearly larger there counts
    if np.linalg.norm(levels.by_order) < SETTINGS.clearly_larger * np.linalg.norm(by_order):
        return _Unseen(by_order, rms_deg(before[kept], orders), left, kept, int(kept.sum()))
    return levels


def _ended(
    final: Fit, before: ComplexArray, noise: Noise, judged: Sequence[tuple[Candidate, Evidence]]
) -> tuple[Fit, FloatArray, list[Signature]]:
    """The fit with the runs that count in what is left of it, the noise floor (K,), and what is left.

    What undecided runs have is no part of the fit, and one of what is left.
    """
    noise = noise.with_the_undecided
    final = replace(final, target=replace(final.target, good=noise.good))
    return final, *_left_over(final, before, noise, judged)


def _left_over(
    final: Fit, before: ComplexArray, noise: Noise, judged: Sequence[tuple[Candidate, Evidence]]
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


def _powers(data: Observations, values: ComplexArray) -> FloatArray:
    """The power of each of some rows, (m,), from their values at all orders, (m, K)."""
    powers: FloatArray = (np.abs(values) ** 2 / data.parts).sum(axis=1)
    return powers


def _points_that_test(data: Observations, before: ComplexArray, unseen: _Unseen, found: Conclusions) -> float:
    """How many equal operating points would tell as well what the new rig takes off those that were left out.

    Of a resonance how many speeds, where they are fewer: all points at one speed see the same flank of it. before: what
    the old rig leaves, (n, K).
    """
    taken, at = _powers(data, before[unseen.rows] - unseen.left), data.at.points[unseen.rows]
    changed = [*(one.piece.effect for one in found.claims), *(one.after for one in found.retuned)]
    places = [np.unique(at, axis=0, return_inverse=True)[1].ravel()]
    if any(effect.stage is Stage.STRUCTURE for effect in changed):
        places.append(speed_levels(data.at.speed_rpm)[unseen.rows])
    return min(_carriers(np.bincount(place, taken).astype(np.float64)) for place in places)


def _carriers(powers: FloatArray) -> float:
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
