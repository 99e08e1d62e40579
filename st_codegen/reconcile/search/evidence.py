"""Whether an effect is there: significance, held-out conditions, stability. All must agree before a name is given.

Of held-out conditions whole levels of speed, torque or temperature are left out in turn. Each fold is predicted by
parameters fitted to the other runs, within their bounds. A fold whose runs alone tell some combination of parameters
cannot be predicted by anybody: it says so and does not vote.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.data.chances import chi_square_tail, f_tail
from st_codegen.reconcile.data.contrasts import AXES
from st_codegen.reconcile.fit.fitting import Fit, Fold
from st_codegen.reconcile.fit.normal import by_group, inverse
from st_codegen.reconcile.fit.target import Groups
from st_codegen.reconcile.rest.lasting import without_lasting
from st_codegen.reconcile.search.peaks import has_a_frequency
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect, Form, Stage

_SMALL = "smaller than the noise of one coefficient"


@dataclass(frozen=True)
class Evidence:
    """What speaks for an effect.

    loss_saved: of twice the loss; parameters: how many it has; p_chance: of that much saved by noise that is
    independent from run to run; p_clusters: of that much where runs of about the same speed and temperature may have
    noise in common; held_out: loss saved (per run) on conditions that were left out of the fit, by axis; votes: how
    many of the folds that the others identify it saves loss in, and how many there are; stability: share of resampled
    data sets in which the effect keeps its size and sign; size_in_noise: RMS of its contribution to the coefficients
    that it touches over the noise of one of them.
    """

    loss_saved: float
    parameters: int
    p_chance: float
    p_clusters: float
    held_out: Mapping[str, float]
    votes: tuple[int, int]
    stability: float
    size_in_noise: float

    @property
    def failed(self) -> tuple[str, ...]:
        """The tests that refuse it, in words."""
        losses = list(self.held_out.values())
        # one axis may fail: a level can hold all that is known of something
        held = not losses or (
            sum(x > 0 for x in losses) >= max(1, len(losses) - 1) and 2 * self.votes[0] > self.votes[1]
        )
        likely = self.p_chance < SETTINGS.p_chance
        tests = (
            (likely, "noise could look like it"),
            (not likely or self.p_clusters < SETTINGS.p_clusters, "noise that lasts over runs could look like it"),
            (held, "left-out runs are predicted no better"),
            (self.stability >= SETTINGS.stable, "its size changes when runs are resampled"),
            (self.size_in_noise >= SETTINGS.least_size, _SMALL),
        )
        return tuple(text for passes, text in tests if not passes)

    @property
    def passed(self) -> bool:
        """Whether all tests agree."""
        return not self.failed

    @property
    def passed_but_for_size(self) -> bool:
        """Whether only the size speaks against it."""
        return self.failed == (_SMALL,)


def judge(without: Fit, with_it: Fit, places: list[int], number: int) -> Evidence:
    """Compare two fits of the same data; `places`: coordinates of the effect in the larger one, `number`: its piece."""
    saved = without.loss - with_it.loss
    count = len(places)
    held, votes = held_out(without, with_it)
    # errors are those of the larger model: how far coefficients scatter about it, not about what lacks the effect
    own = replace(with_it, target=with_it.target.about(with_it.residual))
    # noise that lasts over runs has a mean of its own
    left = [own.target.losses(without_lasting(own.target, one.residual)).sum() for one in (without, with_it)]
    lasting = chi_square_tail(float(left[0] - left[1]), count)
    return Evidence(
        loss_saved=saved,
        parameters=count,
        p_chance=_p_of_chance(without, own, places),
        p_clusters=max(lasting, p_of_clusters(own, places, with_it.state.vector()[places])),
        held_out=held,
        votes=votes,
        stability=stability(own, places),
        size_in_noise=size_in_noise(with_it, places, number),
    )


def _p_of_chance(without: Fit, with_it: Fit, places: list[int]) -> float:
    """Chance of what coordinates save by noise that is independent from run to run, of the size that the fit leaves."""
    target = with_it.target
    saved = float((target.losses(without.residual) - target.losses(with_it.residual)).sum())
    touched = np.unique(np.concatenate([with_it.columns[i][0] for i in places]))
    numbers = (target.counts * target.data.parts)[:, touched].sum()
    rest = max(int(numbers) - len(places), 1)
    return float(f_tail(saved / len(places), len(places), rest))


def size_in_noise(fit: Fit, places: list[int], number: int) -> float:
    """RMS of what coordinates contribute, in standard deviations of one measured number, over the orders they touch.

    What stands at one angle is in all its orders alike: these tell it together, as a curve does.
    """
    piece, place = fit.state.pieces[number], fit.state.slices()[number]
    vector = piece.vector()
    without = vector.copy()
    defaults = {scalar.key: scalar.default for scalar in piece.effect.scalars}
    for i, c in enumerate(piece.coordinates()):
        neutral = c.linear or defaults.get(c.key) == 0.0
        if place.start + i in places and neutral:
            without[i] = c.lower if c.form is Form.INVERSE else 0.0
    propagation = fit.propagation
    changes = [propagation.change(p.effect) for p in (piece, piece.with_vector(without))]
    if all(not c.linear for c in piece.coordinates()):
        changes[1] = np.zeros_like(changes[0])
    part = propagation.measured(changes[0] - changes[1], piece.effect.stage)[fit.target.good]
    squares = ((np.abs(part) / fit.target.sigma[fit.target.good]) ** 2).mean(axis=0)
    parts = fit.target.data.parts
    touched = squares / parts > SETTINGS.touched * (squares / parts).max(initial=0.0)
    count = parts[touched].sum()
    # and so is what a chain of measurement does, which turns all of them by one number
    count = min(count, 2) if piece.effect.least_foreign or piece.effect.stage is Stage.MEASURING else count
    return float(np.sqrt(squares[touched].sum() / max(count, 1)))


def p_of_clusters(fit: Fit, places: list[int], difference: FloatArray, covariance: FloatArray | None = None) -> float:
    """Chance of a difference from zero by noise that is shared within clusters of runs (Hotelling's T squared).

    covariance: of all coordinates, (p, p), where it is to allow for more than that noise.
    """
    covariance = fit.covariance if covariance is None else covariance
    square = float(difference @ inverse(covariance[np.ix_(places, places)]) @ difference)
    gradient = by_group(fit.normal.gradient, fit.target.groups.clusters)
    clusters, count = int((np.abs(gradient).sum(axis=1) > 0).sum()), len(places)
    if clusters <= count + 1 or (fit.target.data.few_points and clusters < 2 * count):
        # fewer clusters than tell so many parameters: independent runs, of which few are alike, are all that can be
        # assumed
        return chi_square_tail(square, count)
    chance = float(f_tail(square * (clusters - count) / (count * (clusters - 1)), count, clusters - count))
    if clusters >= 2 * count:
        return chance
    # hardly more clusters than parameters bound no sum of all: one that is no chance by itself is none among so many
    alone = float((difference**2 / np.diagonal(covariance)[places]).max())
    return min(chance, count * float(f_tail(alone, 1, clusters - 1)))


def stability(fit: Fit, places: list[int]) -> float:
    """Share of bootstrap samples of the clusters in which the effect keeps at least half its size and its sign."""
    clusters = fit.target.groups.clusters
    matrix, gradient = by_group(fit.normal.matrix, clusters), by_group(fit.normal.gradient, clusters)
    random = np.random.default_rng(0)
    vector = fit.state.vector()[places]
    metric = inverse(fit.inverse[np.ix_(places, places)])
    norm = float(vector @ metric @ vector)
    kept = 0
    for _ in range(SETTINGS.resamplings):
        times = np.bincount(random.integers(0, len(matrix), len(matrix)), minlength=len(matrix)).astype(float)
        step = inverse(np.tensordot(times, matrix, 1) + np.diag(fit.prior)) @ (times @ gradient)
        kept += float(vector @ metric @ (vector + step[places])) > 0.5 * norm
    return kept / SETTINGS.resamplings


def p_of_more(fewer: Fit, more: Fit) -> float:
    """Chance that noise saves what one fit has less loss than another one with fewer numbers."""
    return chi_square_tail(fewer.loss - more.loss, len(more.prior) - len(fewer.prior))


def predicted(fit: Fit, fold: Fold) -> ComplexArray:
    """What the parameters fitted without a fold leave of its own rows, complex128 (rows of the fold, K), deg.

    Of the model in its linear form, in which they were fitted: a size times a size that both move would be neither.
    """
    found = fit.residual[fold.rows].copy()
    for (places, values), moved in zip(fit.columns, fold.vector - fit.state.vector(), strict=True):
        found[:, places] -= values[fold.rows] * moved
    return found


def held_out(without: Fit, with_it: Fit) -> tuple[dict[str, float], tuple[int, int]]:
    """Loss saved per run on left-out levels of speed, torque and temperature, and the votes of the folds: for, of.

    Of the folds that both fits identify.
    """
    found, votes = {}, []
    for axis in AXES:
        folds = []
        for smaller, larger in zip(without.folds(axis), with_it.folds(axis), strict=True):
            if smaller.identified and larger.identified:
                before, after = (
                    float(fit.target.losses(predicted(fit, fold), fold.rows).sum())
                    for fit, fold in ((without, smaller), (with_it, larger))
                )
                folds.append((int((larger.rows & with_it.target.good).sum()), before - after))
        if folds:
            found[axis] = sum(saved for _, saved in folds) / sum(rows for rows, _ in folds)
            votes += [saved > 0 for _, saved in folds]
    return found, (sum(votes), len(votes))


def held_out_rms(fit: Fit) -> FloatArray:
    """RMS (deg) of each order on left-out levels that the others identify, float64 (K,), of the axis with the most."""
    weight = 1.0 / fit.target.data.parts
    powers = []
    for axis in AXES:
        parts = [predicted(fit, fold)[fit.target.good[fold.rows]] for fold in fit.folds(axis) if fold.identified]
        if parts:
            powers.append(weight * (np.abs(np.concatenate(parts)) ** 2).mean(axis=0))
    if not powers:
        powers = [weight * (np.abs(fit.residual[fit.target.good]) ** 2).mean(axis=0)]
    return np.asarray(np.sqrt(max(powers, key=lambda power: float(power.sum()))))


def untested_axes(fit: Fit) -> tuple[str, ...]:
    """The axes of which most left-out levels cannot be predicted by anybody: each of them tells some number by itself.

    A load tells what the same one of the other sign does.
    """
    found, sizes = [], np.unique(np.abs(fit.target.data.at.torque_Nm), return_inverse=True)[1].astype(np.int64)
    levels = np.arange(sizes.max() + 1)
    by_size = replace(fit.target, groups=Groups(sizes, levels, {"torque": levels}))
    if len(levels) == 2 and any(p.effect.values.get("frequency_per_kNm") for p in fit.state.pieces):
        # of two none can be left out, and a peak that moves from the one to the other is somewhere between them
        found.append("torque")
    for axis in AXES:
        few = axis == "torque" and len(levels) < SETTINGS.many_levels
        folds = (replace(fit, target=by_size) if few else fit).folds(axis)
        unknown = sum(int(fold.rows.sum()) for fold in folds if not fold.identified)
        if axis not in found and 2 * unknown > sum(int(fold.rows.sum()) for fold in folds):
            found.append(axis)
    return tuple(found)


def unmeasured_states(at: Conditions, effects: Sequence[Effect]) -> list[tuple[float, float]]:
    """Neighbouring measured temperatures (degC) between which resonances change their frequency, no run says how."""
    levels = np.unique(at.temperature_C)
    edges = {effect.scalar(key) for effect in effects for key in ("above_C", "below_C") if key in effect.values}
    if len(levels) == 2 and any("frequency_per_10K" in effect.values for effect in effects):
        edges.add(float(levels.mean()))
    inside = [edge for edge in edges if levels[0] < edge < levels[-1]]
    return sorted({(float(levels[levels < edge].max()), float(levels[levels > edge].min())) for edge in inside})


def between_states(fit: Fit) -> FloatArray:
    """Power (deg^2), by order (K,), by which a resonance may be off between temperatures where nothing was measured.

    Its frequency is known on both sides; where between them it changes, and whether in a step, no run says. On average
    half the temperatures between them have the one while the rig has the other.
    """
    at, orders = fit.target.data.at.rows(fit.target.good), fit.target.data.orders
    found = np.zeros(len(orders))
    own = [piece.effect for piece in fit.state.pieces if piece.added and has_a_frequency(piece.effect)]
    for low, high in unmeasured_states(at, own) if fit.target.data.angle_rad is None else ():
        sides = [replace(at, temperature_C=np.full(len(at), level)) for level in (low, high)]
        apart = sum(effect.contribution(sides[0], orders) - effect.contribution(sides[1], orders) for effect in own)
        share = (high - low) / float(np.ptp(at.temperature_C))
        found += 0.5 * share * (1.0 / fit.target.data.parts) * (np.abs(apart) ** 2).mean(axis=0)
    return found
