"""Noise that lasts over runs: how many it is the same in, and which mean it may have."""

from __future__ import annotations

from collections.abc import Collection
from statistics import NormalDist

import numpy as np
from scipy.linalg import orth

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import levels_by_condition
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.shapes import steps_and_ramps
from st_codegen.reconcile.settings import SETTINGS


def alike(series: list[ComplexArray]) -> FloatArray:
    """The correlation of runs that follow each other, of series (runs, K) about zero: (K,)."""
    up = sum((one[1:] * one[:-1].conj()).real.sum(axis=0) for one in series)
    return np.asarray(up / np.maximum(sum((np.abs(one) ** 2).sum(axis=0) for one in series), 1e-300))


def length(rho: FloatArray) -> FloatArray:
    """How many runs noise of this correlation lasts."""
    known = np.clip(rho, 0.0, 0.98)
    return np.asarray((1.0 + known) / (1.0 - known))


def runs_noise_lasts(target: FitData, residual: ComplexArray) -> float:
    """How many runs noise lasts, by the middle one of some orders (n, K); 1 where the runs' order is not known."""
    series = _in_their_order(target, residual)
    return float(length(np.median(alike(series), keepdims=True))[0]) if series else 1.0


def without_lasting(target: FitData, residual: ComplexArray) -> ComplexArray:
    """A residual (n, K) without the mean of each order and direction that noise which lasts over runs may have."""
    found, lasting = residual.copy(), lasting_mean(target, residual)
    for sign in np.unique(target.data.at.sign[target.good]):
        rows = target.data.at.sign == sign
        mean = residual[rows & target.good].mean(axis=0)
        found[rows] -= np.where(np.abs(mean) < lasting, mean, 0.0)
    return found


def _in_their_order(target: FitData, residual: ComplexArray) -> list[ComplexArray]:
    """A residual (n, K) of good runs about its mean in the order of the runs, by direction; none if that is unknown."""
    run, good, series = target.data.run, target.good, list[ComplexArray]()
    if run is None or good.sum() < SETTINGS.least_in_time:
        return series
    for rows in map(np.flatnonzero, target.data.at.by_direction(good)):
        own = residual[rows[np.argsort(run[rows], kind="stable")]]
        series.append(own - own.mean(axis=0))
    return series


def changes_with_time(target: FitData, residual: ComplexArray) -> BoolArray:
    """Whether most of what an order varies by is the same in runs that follow each other, bool (K,)."""
    series = _in_their_order(target, residual)
    if not series:
        return np.zeros(residual.shape[1], bool)
    # beyond what a correlation of so many runs is by chance
    least = 0.5 + SETTINGS.told / np.sqrt(sum(len(one) for one in series))
    return np.asarray(alike(series) > least)


def wander_over_runs(target: FitData, residual: ComplexArray, named: Collection[int]) -> tuple[str, ...]:
    """What is said of a mean that changes with the time and counts as noise: it is not among the orders `named`."""
    mean, series = target.data.orders == 0, _in_their_order(target, residual)
    if 0 in named or not mean.any() or not series:
        return ()
    correlation = float(alike(series)[mean][0])
    # less is not worth a sentence, and of so many runs there is some by chance
    if correlation < SETTINGS.least_alike + SETTINGS.told / np.sqrt(sum(len(one) for one in series)):
        return ()
    size = float(np.sqrt((residual[target.good][:, mean].real ** 2).mean()))
    return (
        f"the means of runs that follow each other are alike (a correlation of {correlation:.2f}; {size:.2g} deg RMS "
        "over all runs): something changes with the time, slowly, and counts as noise",
    )


def lasting_mean(target: FitData, residual: ComplexArray) -> FloatArray:
    """By how much (deg) the mean of an order may be off where its noise lasts over runs, (K,); see `power_of_mean`."""
    errors = NormalDist().inv_cdf(1.0 - SETTINGS.p_changed / 2)
    return np.asarray(errors * np.sqrt(power_of_mean(target, residual)))


def power_of_mean(target: FitData, residual: ComplexArray, *, at_most: bool = False) -> FloatArray:
    """The power of one component (deg^2) that the mean of noise which lasts over runs has in an order, (K,).

    0 where runs that follow each other are no more alike than by chance, and do not wander, or their order is not
    known; and, but for what the mean has at most, where what is told by the conditions and a course leaves no such
    noise.
    """
    series = _in_their_order(target, residual)
    if not series:
        return np.zeros(residual.shape[1])
    found = _power_of_mean(series, target.data.parts)
    asked = np.flatnonzero(found)
    if len(asked) and not at_most:
        left = _beside_what_is_told(target, [one[:, asked] for one in series])
        found[asked] *= _power_of_mean(left, target.data.parts[asked]) > 0.0
    return found


def _power_of_mean(series: list[ComplexArray], parts: IntArray) -> FloatArray:
    """See `power_of_mean`; series: of each direction (runs, K), about its mean."""
    rho, count = alike(series), sum(len(one) for one in series)
    power = sum((np.abs(one) ** 2).sum(axis=0) for one in series) / count / parts
    sure = rho > SETTINGS.told / np.sqrt(count)
    lasting = np.where(sure, power * length(rho) * len(series) / count, 0.0)
    return np.maximum(lasting, _mean_of_a_wander(series, parts))


def _beside_what_is_told(target: FitData, series: list[ComplexArray]) -> list[ComplexArray]:
    """Series (runs, K) without the levels of the conditions and, where that is likelier than a walk, one step or ramp.

    A law of a condition that the runs go through once, a step and a trend have the low waves of noise that wanders, and
    a mean that everyone can tell. The likelihoods are those of a walk's waves over the runs, and of what the best step
    or ramp leaves, each with its best scale. What a step has more of numbers, its size in each direction and its place,
    weighs as in Schwarz (1978).
    """
    run, good, likelier = target.data.run, target.good, np.zeros(series[0].shape[1])
    assert run is not None
    beside, rest = list[ComplexArray](), list[ComplexArray]()
    for rows, one in zip(map(np.flatnonzero, target.data.at.by_direction(good)), series, strict=True):
        in_time, count = rows[np.argsort(run[rows], kind="stable")], len(one)
        base = [np.ones((count, 1))]
        for level in levels_by_condition(target.data.at).values():
            own = level[in_time]
            # what changes faster has no low waves
            if SETTINGS.runs_of_a_level * np.count_nonzero(np.diff(own)) <= count:
                base.append((own[:, None] == np.unique(own)).astype(np.float64))
        q = orth(np.concatenate(base, axis=1), rcond=1e-8)
        profiles = steps_and_ramps(count)
        x, y = profiles - q @ (q.T @ profiles), one - q @ (q.T @ one)
        square = (x * x).sum(axis=0)
        # what the levels follow tells nothing beside them
        slopes = (x.T @ y) * (square > 1e-6 * count)[:, None] / np.maximum(square, 1e-300)[:, None]
        best = (np.abs(slopes) ** 2 * square[:, None]).argmax(axis=0)
        beside.append(y)
        rest.append(y - x[:, best] * slopes[best, np.arange(y.shape[1])])
        # so few runs as a step has numbers fit it exactly, and say nothing
        if count <= 2 * (q.shape[1] + 2):
            continue
        likelier += _log_likelihood_of_a_walk(y)
        likelier += count * np.log(np.maximum((np.abs(rest[-1]) ** 2).mean(axis=0), 1e-300))
        likelier += np.log(count) / 2 + np.log(len(square))
    return [np.where(likelier > 0.0, one, other) for one, other in zip(beside, rest, strict=True)]


#: powers of a walk's first wave over that of the noise of single runs
_WALKS = np.geomspace(0.01, 1e6, 33)


def _log_likelihood_of_a_walk(series: ComplexArray) -> FloatArray:
    """The logarithm of the likelihood of series (runs, K) about zero as a walk beside noise of single runs, (K,).

    Of the size of the walk, and of the noise, that make it largest; beside a constant that depends on the runs alone.
    """
    count = len(series)
    power = np.abs(np.fft.fft(series, axis=0)[1:]) ** 2 / count
    # the waves of a walk of single steps
    walk = (np.sin(np.pi / count) / np.sin(np.pi * np.arange(1, count) / count)) ** 2
    usual = 1.0 + _WALKS[:, None] * walk
    scale = np.maximum((1.0 / usual) @ power / count, 1e-300)
    return np.asarray((-count * np.log(scale) - np.log(usual).sum(axis=1)[:, None]).max(axis=0))


def _mean_of_a_wander(series: list[ComplexArray], parts: IntArray) -> FloatArray:
    """The power of one component of the mean of noise that wanders through all the runs, (K,); 0 where none does.

    Such noise lasts as long as the campaign, which no runs that follow each other tell, however alike they are. Of
    waves over the runs the lowest ones then are louder than most, the more so the lower they are: the power of a walk
    falls with the square of their number, that of flicker with their number, and that of what lasts some runs not at
    all. The mean of a walk has 2 pi^2 / 3 times the power of its first wave.
    """
    low = SETTINGS.waves_of_a_wander
    # a direction of a few runs has no waves that tell
    series = [one for one in series if len(one) > 2 * low + 1]
    if not series:
        return np.zeros(len(parts))
    spectra = [np.abs(np.fft.fft(one, axis=0) / len(one)) ** 2 for one in series]
    powers = np.mean([(one[1 : low + 1] + one[: -low - 1 : -1]) / 2 for one in spectra], axis=0)
    white = np.mean([one[low + 1 : -low].mean(axis=0) for one in spectra], axis=0)
    # both directions may wander together: the waves of one say how loud they are by chance
    wanders = powers.mean(axis=0) > white * (1.0 + SETTINGS.told / np.sqrt(low * parts))
    numbers = np.arange(1.0, low + 1)[:, None]
    by_law = [np.maximum(powers - white, SETTINGS.faintest_wave * white) * numbers**falls for falls in (2, 1, 0)]
    uneven = np.stack([np.log(np.maximum(one, 1e-300)).std(axis=0) for one in by_law])
    first = np.stack([np.median(one, axis=0) for one in by_law]) * np.array([[2 * np.pi**2 / 3]] * 2 + [[1.0]])
    found = np.take_along_axis(first, uneven.argmin(axis=0)[None], axis=0)[0]
    return np.where(wanders, found / parts, 0.0)
