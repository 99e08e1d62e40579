"""Whether an effect is there: significance, held-out conditions, stability. All must agree before a name is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.chances import chi_square_tail, f_tail
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.normal import by_group, inverse
from st_codegen.reconcile.search.held_out import held_out
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Form


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
    def passed(self) -> bool:
        """Whether all tests agree."""
        return self._likely and self.size_in_noise >= SETTINGS.least_size

    @property
    def passed_but_for_size(self) -> bool:
        """Whether only the size speaks against it."""
        return self._likely and self.size_in_noise < SETTINGS.least_size

    @property
    def _likely(self) -> bool:
        losses = list(self.held_out.values())
        # one axis may fail: a level can hold all that is known of something
        held = not losses or (
            sum(x > 0 for x in losses) >= max(1, len(losses) - 1) and 2 * self.votes[0] > self.votes[1]
        )
        likely = self.p_chance < SETTINGS.p_chance and self.p_clusters < SETTINGS.p_clusters
        return likely and held and self.stability >= SETTINGS.stable


def judge(without: Fit, with_it: Fit, places: list[int], number: int) -> Evidence:
    """Compare two fits of the same data; `places`: coordinates of the effect in the larger one, `number`: its piece."""
    saved = without.loss - with_it.loss
    count = len(places)
    held, votes = held_out(without, with_it)
    # errors are those of the larger model: how far coefficients scatter about it, not about what lacks the effect
    own = replace(with_it, target=with_it.target.about(with_it.residual))
    return Evidence(
        loss_saved=saved,
        parameters=count,
        p_chance=_p_of_chance(without, own, places),
        p_clusters=p_of_clusters(own, places, with_it.state.vector()[places]),
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
    return f_tail(saved / len(places), len(places), rest)


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
    touched = squares / parts > 0.1 * (squares / parts).max(initial=0.0)
    count = 2 if piece.effect.least_foreign else parts[touched].sum()
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
    return f_tail(square * (clusters - count) / (count * (clusters - 1)), count, clusters - count)


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
