"""Whether an order keeps more than noise, and how large that noise is.

Three questions are put to the residual of an order: does it differ between levels of speed, torque and temperature;
do neighbouring runs share it (structure that is sharper than any level); does it step or drift in the order of the
runs. Decisions are made on cut residuals, so that single wild runs make no structure.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth
from scipy.special import gammaincc, ndtr

from st_codegen.campaign.orders import BAND, listed
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.chances import f_tail, false_discoveries
from st_codegen.reconcile.data.contrasts import levels_by_condition, neighbours
from st_codegen.reconcile.data.kept import KeptAnswers
from st_codegen.reconcile.data.noise import MEDIAN_1, estimate
from st_codegen.reconcile.data.observations import Observations, rms_deg
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.in_time import Course, course_of
from st_codegen.reconcile.rest.lasting import runs_noise_lasts, without_lasting
from st_codegen.reconcile.settings import SETTINGS


@dataclass(frozen=True)
class ResidualStructure:
    """How much of a residual is structure.

    orders: int (K,); chance: of noise that has as much, (K,), 1 where it is too little to be told from an error of the
    noise's estimate; courses: by order the step or trend over the runs, or None.
    """

    orders: IntArray
    chance: FloatArray
    courses: tuple[Course | None, ...]

    @property
    def significant(self) -> BoolArray:
        """Which orders keep structure, after control of the false discovery rate over all of them, (K,)."""
        in_time = np.array([course is not None for course in self.courses], dtype=bool)
        return np.asarray(false_discoveries(self.chance, SETTINGS.discovery_rate) | in_time)

    def significant_among(self, asked: BoolArray) -> BoolArray:
        """Which orders keep structure, (K,), among all, or among those `asked`, (K,): few are not weighed down by many.

        The false discovery rate holds for all orders, and once more for those.
        """
        found = self.significant.copy()
        found[asked] |= false_discoveries(self.chance[asked], SETTINGS.discovery_rate)
        return found


def structure(target: FitData, residual: ComplexArray) -> ResidualStructure:
    """Test the residual (n, K) of every order for what noise that is independent from run to run has not.

    Neither is to be changed afterwards: several questions are asked of the same residual, whose answer is kept.
    """
    return _KEPT.of((target, residual), lambda: _structure(target, residual))


#: of the last residuals that were asked
_KEPT = KeptAnswers[ResidualStructure](2)


def _structure(target: FitData, residual: ComplexArray, most_known: float = np.inf) -> ResidualStructure:
    """The tests of `structure`, of noise that is known by no more than so many degrees of freedom."""
    data, good = target.data, target.good
    parts = data.parts
    r = data.with_real_mean(residual)
    sigma, known = _scale_of(target)
    whole: ComplexArray = without_lasting(target, r) / sigma * good[:, None]
    z: ComplexArray = whole * np.minimum(1.0, SETTINGS.cut / np.maximum(np.abs(whole), 1e-300))
    p_levels, excess, scale = _between_levels(target, z[good], parts, np.minimum(known, most_known))
    p_shared, shared = _between_neighbours(target, z, parts)
    large = np.maximum(excess / scale, shared) > SETTINGS.least_excess * parts
    courses = course_of(target, z, whole, parts)
    p = np.where(large, np.minimum(np.minimum(2 * p_levels, 2 * p_shared), 1.0), 1.0)
    return ResidualStructure(data.orders, p, tuple(courses))


def _scale_of(target: FitData) -> tuple[FloatArray, FloatArray]:
    """The noise by which a residual is tested, (n, K), and of how many degrees of freedom it is known, (K,).

    That of contrasts is a median, of as many as there are runs. By its variance it tells as much as the squares of 0.96
    as many numbers do for waves (Rayleigh's distribution), and of 0.37 as many for the mean (the normal one). Of a
    dozen runs it may be half of what it should be. What there is between the orders of a curve is in an order as well,
    and known far better; so is what the orders beside it have, where it is not louder than they are.
    """
    orders, own = target.data.orders, np.sqrt((target.sigma[target.good] ** 2).mean(axis=0))
    spectral, known = target.data.spectral_deg, np.where(orders == 0, 0.37, 0.96) * int(target.good.sum())
    if spectral is not None and target.data.few_points:
        return np.maximum(target.sigma, spectral), np.full(len(orders), np.inf)
    waves = np.flatnonzero(orders > SETTINGS.wander_orders)
    if len(waves) < SETTINGS.orders_beside:
        return target.sigma, known
    away = np.abs(orders[waves][:, None] - orders[waves])
    beside = np.argsort(away, axis=1, kind="stable")[:, : SETTINGS.orders_beside]
    usual = own.copy()
    usual[waves] = np.median(own[waves][beside], axis=1)
    usual_too = (orders > SETTINGS.wander_orders) & (own < SETTINGS.louder_speed * usual)
    return target.sigma * np.maximum(1.0, usual / own), np.where(usual_too, np.inf, known)


def beyond_loud_runs(target: FitData, residual: ComplexArray) -> BoolArray:
    """Whether the residual of an order holds more than noise that is louder in some runs than in others may, (K,).

    Of curves each run's own noise is known. Of tables two things tell: where orders keep no more than noise, these say
    how loud each run is; and phases, which noise has at random, however loud each run is. Noise that lasts over runs
    says as much as fewer of them.
    """
    data = target.data
    if data.spectral_deg is not None or data.angle_rad is not None:
        return np.ones(len(data.orders), bool)
    quiet = ~structure(target, residual).significant & (data.orders > 0)
    if quiet.sum() < SETTINGS.orders_beside:
        return _is_alike_in_phase(target, residual, runs_noise_lasts(target, residual / target.sigma))
    loud = np.sqrt((np.abs(residual[:, quiet] / target.sigma[:, quiet]) ** 2).mean(axis=1) / 2.0)
    sigma = target.sigma * np.maximum(loud, 1e-9)[:, None]
    lasts = runs_noise_lasts(target, (residual / sigma)[:, quiet])
    even = replace(target, sigma=sigma * np.sqrt(lasts))
    found = _structure(even, residual, 2.0 * quiet.sum()).significant
    return found | _is_alike_in_phase(target, residual, lasts)


def _is_alike_in_phase(target: FitData, residual: ComplexArray, lasts: float) -> BoolArray:
    """Whether the runs of levels are more alike than their sizes with phases at random make them, (K,).

    The sum of squares over levels is then a sum of products of two runs each, whose mean and variance are known; the
    gamma distribution that has both is taken for it. Of the mean it is signs that are at random. lasts: so many runs
    noise is the same, which makes sums of its squares so many times as large.
    """
    good, parts = target.good, target.data.parts
    r = target.data.with_real_mean(residual)[good]
    power = np.abs(r) ** 2
    chance = np.ones(len(parts))
    designs = level_designs(target)
    for levels in designs.values():
        count = np.maximum(levels.sum(axis=0), 1.0)[:, None]
        q = (np.abs(levels.T @ r) ** 2 / count).sum(axis=0) / lasts
        mean = (levels.T @ power / count).sum(axis=0)
        variance = (2.0 / parts) * (((levels.T @ power) ** 2 - levels.T @ power**2) / count**2).sum(axis=0)
        # levels of one run each hold no products
        variance = np.maximum(variance, 1e-9 * mean**2)
        p = gammaincc(mean**2 / np.maximum(variance, 1e-300), q * mean / np.maximum(variance, 1e-300))
        chance = np.minimum(chance, len(designs) * np.where(q > mean, p, 1.0))
    return false_discoveries(chance, SETTINGS.discovery_rate)


def is_lacking(target: FitData, residual: ComplexArray) -> BoolArray:
    """Whether an order keeps more than noise, with a pattern or without one, bool (K,)."""
    found = structure(target, residual).significant.copy()
    found[scatter(target, residual)] = True
    return found


def loud_and_foreign(target: FitData, residual: ComplexArray, made: Sequence[int]) -> BoolArray:
    """Orders of curves that no effect makes (`made`: those of the rig) and that are louder than noise, bool (K,).

    They are looked at since they are: in a few runs, or in no phase with the output. What a walk within a turn makes of
    the low ones is noise.
    """
    orders = target.data.orders
    if target.data.spectral_deg is None or not target.good.any():
        return np.zeros(len(orders), bool)
    times = _times_spectral(target, residual)
    loud = times > sure_times(target) * _wandering(target, residual)
    return loud & ~np.isin(orders, made) & (orders > SETTINGS.wander_orders)


def _between_levels(
    target: FitData, z: ComplexArray, parts: IntArray, known: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chance of the differences between levels; their power in noises; the noise that is left, each (K,).

    known: by how many degrees of freedom the noise of z is, (K,).
    """
    basis = orth(np.concatenate(list(level_designs(target).values()), axis=1), rcond=1e-8)
    rows, rank = len(basis), basis.shape[1]
    explained = (np.abs(basis.T @ z) ** 2).sum(axis=0)
    left = np.maximum((np.abs(z) ** 2).sum(axis=0) - explained, 1e-12) / np.maximum(parts * (rows - rank), 1)
    # noise that is larger than believed must not look like structure
    scale = np.maximum(left, 1.0)
    known = np.where(left > 1.0, np.minimum(known, np.maximum(parts * (rows - rank), 1)), known)
    times = explained / scale / (parts * rank)
    return f_tail(times, parts * rank, known), np.maximum(explained - parts * rank * scale, 0.0) / rows, scale


def _between_neighbours(target: FitData, z: ComplexArray, parts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Chance that neighbours along an axis share as much by noise alone, and the power that they share, each (K,).

    Noise that is independent from run to run gives products of neighbours any phase: their sum over its own root mean
    square is normal.
    """
    best, power = np.ones(z.shape[1]), np.zeros(z.shape[1])
    kinds = [pairs for _, pairs in neighbours(target.data.at, target.good) if len(pairs) >= SETTINGS.least_contrasts]
    for pairs in kinds:
        products = (z[pairs[:, 0]] * z[pairs[:, 1]].conj()).real
        spread = np.sqrt(((np.abs(z[pairs[:, 0]]) * np.abs(z[pairs[:, 1]])) ** 2).sum(axis=0) / parts)
        score = products.sum(axis=0) / np.maximum(spread, 1e-300)
        own = ndtr(-score) * len(kinds)
        power = np.where(own < best, products.mean(axis=0), power)
        best = np.minimum(best, own)
    return best, power


def level_designs(target: FitData) -> dict[str, FloatArray]:
    """For each factor one column a level and direction, of good rows."""
    at, good = target.data.at, target.good
    levels = {"constant": np.zeros(len(at), np.int64), **levels_by_condition(at)}
    return {name: _dummies(level, at.sign)[good] for name, level in levels.items()}


def _dummies(level: IntArray, sign: FloatArray) -> FloatArray:
    code = level * 2 + (sign > 0)
    return np.asarray((code[:, None] == np.unique(code)[None, :]).astype(np.float64))


def rms_of_component(target: FitData, residual: ComplexArray) -> FloatArray:
    """RMS of one component of a residual by order, (K,)."""
    power = (np.abs(residual[target.good]) ** 2).mean(axis=0) / target.data.parts
    return np.asarray(np.sqrt(power))


def loudest_column(target: FitData, residual: ComplexArray, floor: FloatArray) -> int:
    """The column of the order that keeps most power beyond its floor (RMS of one component, (K,))."""
    return int(np.argmax((rms_of_component(target, residual) ** 2 - floor**2) * target.data.parts))


def is_left(target: FitData, residual: ComplexArray) -> BoolArray:
    """Which orders would be said to be unexplained, bool (K,).

    Those that keep more than noise, or the loudest one where all together are clearly above their floors.
    """
    left = is_lacking(target, residual)
    if not left.any() and target.data.angle_rad is None:
        floor = floors(target, residual, estimate(target.data, residual).floor_rms)
        after = rms_deg(residual[target.good], target.data.orders)
        left[loudest_column(target, residual, floor)] = after > SETTINGS.clearly_larger * float(np.linalg.norm(floor))
    return left


def sure_times(target: FitData) -> FloatArray:
    """From how many times the noise on what so many runs leave is more than noise, (K,)."""
    count = target.data.parts * int(target.good.sum())
    return np.asarray(np.maximum(SETTINGS.clearly_larger, 1.0 + SETTINGS.told / np.sqrt(2.0 * count)))


def floors(target: FitData, residual: ComplexArray, of_contrasts: FloatArray) -> FloatArray:
    """RMS of one component of the noise by order, (K,), from that of contrasts between runs.

    Of curves it is that between their orders, but where noise lasts over a turn or comes from the lines of an encoder.
    Contrasts hold what structure is left; where there is some, the noise is that of the orders next to it. A mean that
    keeps none has as much as is known that runs differ by. No order has more noise than there is in it.
    """
    found = of_contrasts.copy()
    if not target.good.any():
        return found
    known = np.minimum(_known_noise(target, residual, found), _most_noise(target, residual))
    as_is_known = (target.between_runs > 0.0) & ~is_lacking(target, residual)
    most = np.minimum(target.between_runs, rms_of_component(target, residual))
    return np.where(as_is_known, np.maximum(known, most), known)


def _most_noise(target: FitData, residual: ComplexArray) -> FloatArray:
    """The RMS of one component of a residual, and by how much that of so many numbers scatters beside, (K,)."""
    count = target.data.parts * int(target.good.sum())
    return np.asarray(rms_of_component(target, residual) * (1.0 + SETTINGS.told / np.sqrt(2.0 * count)))


def _known_noise(target: FitData, residual: ComplexArray, found: FloatArray) -> FloatArray:
    """RMS of one component of the noise by what knows it best, (K,); found: that of contrasts."""
    data, own = target.data, noise_within(target)
    if data.spectral_deg is not None:
        lasts = (data.orders <= SETTINGS.wander_orders) & (found < _beyond(target, residual) * own)
        lasts |= (of_an_encoder(target, residual) > 0) | ~np.isfinite(own)
        # what orders beside each other have holds a walk already
        walking = own * np.where(told_beside(data), 1.0, _wandering(target, residual))
        return np.where(lasts, found, np.where(data.orders > 0, walking, own))
    left = is_lacking(target, residual)
    return np.where(left, np.minimum(np.minimum(found, own), by_directions(target, residual)[1]), found)


def _told_from_afar(data: Observations) -> BoolArray:
    """Orders of curves beside which no quiet ones lie, (K,): noise that is coloured may be many times as loud there.

    The noise of an order is that of some two dozen quiet ones around it; where they are more than an octave away it
    says nothing, and where every order of the band is loud it is that of the samples, above the band.
    """
    orders = data.orders
    # of curves of different lengths nobody knows the band that they share
    band = min(data.samples // 4, BAND) if data.samples else BAND
    quiet = np.setdiff1d(np.arange(1, max(band, int(orders.max(initial=0))) + 1), orders)
    # what the lowest ones have beyond it a walk within the turn explains
    high = orders > SETTINGS.wander_orders
    if not len(quiet):
        return high
    away = np.sort(np.abs(orders[:, None] - quiet[None, :]), axis=1)
    count = min(SETTINGS.quiet_beside, len(quiet))
    return np.asarray(high & (away[:, count - 1] > np.maximum(2 * count, orders)))


def noise_within(target: FitData) -> FloatArray:
    """RMS of one component of the noise that is no structure, (K,): that within the curves, of tables that beside.

    The orders beside an order differ from run to run by about as much; those of the mean say nothing of it (inf), nor
    do quiet orders of a curve that are far away.
    """
    data, good = target.data, target.good
    if data.spectral_deg is not None:
        within = np.sqrt((data.spectral_deg[good] ** 2).mean(axis=0))
        within[_told_from_afar(data)] = np.inf
        return np.where(told_beside(data), _of_orders_beside(target), within)
    return _of_orders_beside(target)


def told_beside(data: Observations) -> BoolArray:
    """Orders whose noise those beside them tell, (K,): all of a table; of curves, where no quiet one is near any."""
    if data.spectral_deg is None:
        return np.ones(len(data.orders), bool)
    high = data.orders > SETTINGS.wander_orders
    return np.asarray(high & _told_from_afar(data)[high].all())


def _of_orders_beside(target: FitData) -> FloatArray:
    """RMS of one component of the noise of the orders beside each order, (K,); infinite of the mean, and of few."""
    data, good = target.data, target.good
    sizes, found = np.sqrt((target.sigma[good] ** 2).mean(axis=0)), np.full(len(data.orders), np.inf)
    waves = np.flatnonzero(data.orders > 0)
    for k in waves if len(waves) > SETTINGS.near_floors else ():
        others = waves[waves != k]
        near = np.argsort(np.abs(data.orders[others] - data.orders[k]), kind="stable")[: SETTINGS.near_floors]
        found[k] = np.median(sizes[others[near]])
    return found


def scatter(target: FitData, residual: ComplexArray) -> IntArray:
    """Columns of orders whose residual is larger than the noise can be, or alike in both directions of the runs."""
    if not target.good.any():
        return np.zeros(0, np.int64)
    # single wild runs are no structure of the mean, which has no peaks that few runs meet
    mean, near = target.data.orders == 0, residual.copy()
    near[:, mean] *= np.minimum(1.0, SETTINGS.cut * target.sigma[:, mean] / np.maximum(np.abs(near[:, mean]), 1e-300))
    loud = _times_spectral(target, near) > _beyond(target, near)
    return np.flatnonzero(loud | by_directions(target, residual)[0])


def by_directions(target: FitData, residual: ComplexArray) -> tuple[BoolArray, FloatArray]:
    """Whether both directions of runs are more alike than noise makes them, and the noise by what they differ, (K,).

    What a run has in both directions is no noise of the measurement, whatever its pattern over the conditions.
    """
    data, pairs = target.data, pairs_of(target)
    if data.angle_rad is not None or len(pairs) < SETTINGS.least_contrasts:
        return np.zeros(len(data.orders), bool), np.full(len(data.orders), np.inf)
    parts = data.parts
    r = data.with_real_mean(residual)
    differ = np.sqrt((np.abs(r[pairs[:, 0]] - r[pairs[:, 1]]) ** 2).mean(axis=0) / (2 * parts))
    # the mean differs from run to run as the rig says
    sigma = target.sigma * _loudness(data, r / target.sigma)[:, None]
    known = np.where(data.orders == 0, target.run_offset_deg, 0.0) / sigma
    z = r / sigma
    z *= np.minimum(1.0, SETTINGS.cut / np.maximum(np.abs(z), 1e-300))
    first, second = z[pairs[:, 0]], z[pairs[:, 1]]
    alike = (first * second.conj()).real - known[pairs[:, 0]] * known[pairs[:, 1]]
    # the mean has no peaks that few runs meet: what no more of them have than there can be bad ones is their own
    carried = (alike.sum(axis=0) ** 2) / np.maximum((alike**2).sum(axis=0), 1e-300)
    shared = (carried > SETTINGS.most_suspects * len(pairs)) | (data.orders > 0)
    sizes = np.sqrt((np.abs(first) ** 2).mean(axis=0) * (np.abs(second) ** 2).mean(axis=0))
    # Fisher's transform of a correlation is normal
    correlation = np.clip(alike.mean(axis=0) / np.maximum(sizes, 1e-300), 1e-9 - 1.0, 1.0 - 1e-9)
    p = ndtr(-np.arctanh(correlation) * np.sqrt(parts * len(pairs)) / _by_chance(first, second, sizes, parts))
    large = alike.mean(axis=0) > SETTINGS.least_excess * parts
    return false_discoveries(p, SETTINGS.discovery_rate) & large & shared, differ


def _loudness(data: Observations, z: ComplexArray) -> FloatArray:
    """How many times louder than usual, at least 1, the middle one of many orders is in each run, (n,).

    Runs of which all orders are loud are so in both directions, and the few products that they have say little.
    """
    waves = data.orders > 0
    if waves.sum() < SETTINGS.orders_beside:
        return np.ones(len(z))
    loud = np.median(np.abs(z[:, waves]), axis=1)
    return np.asarray(np.maximum(1.0, loud / max(float(np.median(loud)), 1e-300)))


def _by_chance(
    first: ComplexArray | FloatArray, second: ComplexArray | FloatArray, sizes: FloatArray, parts: IntArray
) -> FloatArray:
    """How many times as alike as white noise makes them two series of runs (n, K) are by chance, (K,), at least 1.

    Noise that lasts over runs is alike in both directions without sharing anything: so it is with one direction shifted
    against the other by any number of runs.
    """
    turned = np.fft.ifft(np.fft.fft(first, axis=0) * np.fft.fft(second, axis=0).conj(), axis=0).real[1:]
    alike = np.sqrt((turned**2).mean(axis=0)) / len(first) / np.maximum(sizes, 1e-300)
    return np.asarray(np.maximum(1.0, alike * np.sqrt(parts * len(first))))


def pairs_of(target: FitData) -> IntArray:
    """The rows of good runs that have two, (n, 2)."""
    rows = [rows for rows in target.data.runs if len(rows) == 2 and target.good[rows].all()]
    return np.array(rows, np.int64).reshape(-1, 2)


def in_both_directions(target: FitData, residual: ComplexArray) -> FloatArray:
    """RMS over the angle (deg) of what runs have alike in both directions, by order (K,); 0 where too few runs tell."""
    pairs = pairs_of(target)
    if target.data.angle_rad is not None or len(pairs) < SETTINGS.least_contrasts:
        return np.zeros(residual.shape[1])
    alike = (residual[pairs[:, 0]] * residual[pairs[:, 1]].conj()).real.mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(alike, 0.0) / target.data.parts))


def _times_spectral(target: FitData, residual: ComplexArray) -> FloatArray:
    """How many times the noise that is no structure a residual is, by order (K,)."""
    return rms_of_component(target, residual) / np.maximum(noise_within(target), 1e-150)


def _beyond(target: FitData, residual: ComplexArray) -> FloatArray:
    """How many times the noise that is no structure a residual may be, (K,).

    No farther above it than orders usually are, from run to run and beside each other. Of curves that is at most twice
    what a slow wander makes of it, which reaches beyond the lowest orders; of tables more, and most for the lowest
    orders, where a wander would show and no curve tells how strong it is.
    """
    orders, usual = target.data.orders, _usual_times(_times_spectral(target, residual), target.data.orders)
    if target.data.spectral_deg is not None:
        walking = _wandering(target, residual)
        found = SETTINGS.beyond_spectral * walking
        differ = np.maximum(1.0, target.between_runs / np.maximum(noise_within(target), 1e-150))
        by_chance = 1.0 + SETTINGS.beyond_usual / np.sqrt(4.0 * max(int(target.good.sum()), 1))
        near = np.clip(usual, np.maximum(SETTINGS.clearly_larger, by_chance), SETTINGS.beyond_spectral)
        return np.asarray(np.where(orders > SETTINGS.wander_orders, near * walking, found) * differ)
    if not np.isfinite(usual):
        return np.full(len(orders), SETTINGS.beyond_beside)
    usual = float(np.clip(usual, SETTINGS.beyond_spectral, SETTINGS.beyond_beside))
    return np.where(orders > SETTINGS.wander_orders, usual, SETTINGS.beyond_beside)


def _usual_times(times: FloatArray, orders: IntArray) -> float:
    """How many times the noise orders are at most, by how they scatter about it; infinite where too few tell."""
    apart = np.abs(np.log(times[(orders > 0) & (times > 0)]))
    if len(apart) < SETTINGS.least_orders_beside:
        return np.inf
    return float(np.exp(SETTINGS.beyond_usual * np.median(apart) / MEDIAN_1))


def _wandering(target: FitData, residual: ComplexArray) -> FloatArray:
    """How much louder than the noise between orders a walk within one turn makes each order, (K,).

    How strong it is the lowest orders say where they are clearly louder. Those that follow the conditions, or the order
    of the runs, do not walk.
    """
    orders = target.data.orders
    # the mean power of n runs of noise scatters by 1/sqrt(n)
    scatters = SETTINGS.clearly_smaller / np.sqrt(max(int(target.good.sum()), 1))
    power = _times_spectral(target, residual) ** 2 - 1.0 - scatters
    low = (orders > 0) & (orders <= SETTINGS.wander_orders)
    return lifted_by_a_walk(orders, power, low & ~structure(target, residual).significant)


def lifted_by_a_walk(orders: IntArray, power: FloatArray, low: BoolArray) -> FloatArray:
    """The factor on the noise of each order (K,) by a walk within the turn, of the power beyond noise of low ones.

    The power of a walk falls with the square of the order, that of flicker with the order; the mean of a walk over a
    turn has 2 pi^2 / 3 times the power of order 1. Which of them it is, and how strong, the others of the low orders
    say.
    """
    found = np.ones(len(orders))
    for k, order in enumerate(orders):
        others = np.flatnonzero(low & (np.arange(len(orders)) != k))
        if len(others) > 1:
            at_one = {n: np.maximum(power[others], 1e-300) * orders[others] ** n for n in (2, 1)}
            falls = min(at_one, key=lambda n: float(np.std(np.log(at_one[n]))))
            walk = max(0.0, float(np.median(power[others] * orders[others] ** falls)))
            found[k] = np.sqrt(1.0 + walk * (2 * np.pi**2 / 3 if order == 0 else 1.0 / order**falls))
    return found


def of_an_encoder(target: FitData, residual: ComplexArray) -> IntArray:
    """The number of lines of an encoder whose error between two lines shows at an order as it was sampled, (K,), or 0.

    With n samples a turn, order L of the lines shows as the distance of L from the next multiple of n, and so do its
    multiples, of which steps have many; the waves of the lowest orders make sidebands of it. What is louder right
    beside all these, without a law of its own, is not the encoder's, nor is what some of the runs alone have, as those
    of one speed. The loudest lines come first: what they make is not that of others.
    """
    data = target.data
    found = np.zeros(len(data.orders), np.int64)
    if not data.samples or not target.good.any():
        return found
    noises = np.abs(residual / target.sigma)[target.good] ** 2
    in_most = np.median(noises, axis=0) > SETTINGS.in_most_runs * noises.mean(axis=0)
    power = (np.abs(residual[target.good]) ** 2).mean(axis=0) * in_most
    power *= ~structure(target, residual).significant
    high, places = data.orders > SETTINGS.wander_orders, list[tuple[float, int, BoolArray]]()
    for lines in SETTINGS.encoder_lines:
        alias, *multiples = (min(m * lines % data.samples, -m * lines % data.samples)
                             for m in range(1, SETTINGS.multiples_of_lines + 1))  # fmt: skip
        off = np.abs(data.orders - alias)
        near, beside = off <= SETTINGS.sidebands_of_lines, off <= 3 * SETTINGS.sidebands_of_lines
        loudest = float(power[near].max(initial=0.0))
        if loudest >= power[beside & ~near].max(initial=0.0):
            steps = np.isin(data.orders, multiples) & (power <= loudest)
            own = near | steps if steps.sum() >= SETTINGS.least_multiples else near
            places.append((loudest, lines, own))
    for _, lines, own in sorted(places, key=lambda place: -place[0]):
        found[own & high & in_most & (found == 0)] = lines
    return found


def scatter_of_encoder(target: FitData, residual: ComplexArray) -> tuple[str, ...]:
    """What is said of orders that differ from run to run as the error of an encoder between its lines does."""
    data, lines = target.data, of_an_encoder(target, residual)
    follows = structure(target, residual).significant
    columns = [k for k in scatter(target, residual) if lines[k] and not follows[k]]
    found = []
    # within a turn a wave that lies less than one order away is not told from it: each takes of the other
    for wave in (hum.order for hum in data.hums if hum.order):
        beside = [k for k in columns if abs(data.orders[k] - wave) < 1.0]
        columns = [k for k in columns if k not in beside]
        found += [
            f"order {data.orders[k]} differs from run to run, as far as one turn tells it from the wave of {wave:.1f} "
            "periods a turn: it counts as noise"
            for k in beside
        ]
    for number in np.unique(lines[columns]):
        own = [int(data.orders[k]) for k in columns if lines[k] == number]
        which = f"order {own[0]} differs" if len(own) == 1 else f"orders {listed(own)} differ"
        found.append(
            f"{which} from run to run, as the error of an encoder of {number} lines between two of them would at "
            f"{data.samples} samples a turn: it counts as noise"
        )
    return tuple(found)


def wander_within_turns(target: FitData, residual: ComplexArray) -> float:
    """How many times the noise within curves the lowest orders are, where a walk within the turn makes them; else 0.

    Such a curve does not end where it began: it has a jump at the zero of the angle.
    """
    data = target.data
    if data.spectral_deg is None or not target.good.any():
        return 0.0
    # what all runs of a direction have does not wander
    differs = residual.copy()
    for sign in np.unique(data.at.sign[target.good]):
        rows = data.at.sign == sign
        differs[rows] -= residual[rows & target.good].mean(axis=0)
    times = _times_spectral(target, differs)
    low = (data.orders > 0) & (data.orders <= SETTINGS.wander_orders)
    walks = low & (_wandering(target, residual) > SETTINGS.beyond_spectral) & (times > SETTINGS.beyond_spectral)
    return float(times[walks].max(initial=0.0))


def scatter_within_turns(target: FitData, residual: ComplexArray) -> tuple[str, ...]:
    """What is said of the lowest orders of curves where they differ from run to run as a walk within a turn does."""
    times = wander_within_turns(target, residual)
    if not times:
        return ()
    return (
        f"the lowest orders differ from run to run by up to {times:.2g} times the noise within curves, "
        "as where TE wanders within a turn, or jumps in some of them: it counts as noise; look at single curves",
    )


def scatter_of_a_table(target: FitData, left: Collection[int]) -> tuple[str, ...]:
    """What is said of orders of a table whose runs differ by far more than those of most orders below and above do.

    A table has no noise between its orders to tell what differs without a pattern from noise: a wave of no whole number
    of periods a turn, of another size and phase in each run, looks like it. Noise that falls or rises with the order is
    louder than others on one side alone. left: orders that are unexplained.
    """
    data, found = target.data, list[str]()
    if data.spectral_deg is not None or data.angle_rad is not None or not target.good.any():
        return ()
    power = (target.sigma[target.good] ** 2).mean(axis=0)
    waves = data.orders > 0
    for k in np.flatnonzero((data.orders > SETTINGS.wander_orders) & ~np.isin(data.orders, list(left))):
        sides = [power[waves & side] for side in (data.orders < data.orders[k], data.orders > data.orders[k])]
        if min(map(len, sides)) < SETTINGS.least_on_a_side:
            continue
        times = power[k] / max(*(float(np.median(side)) for side in sides), 1e-300)
        if times > SETTINGS.stands_out:
            found.append(
                f"order {data.orders[k]} differs from run to run by {np.sqrt(times):.2g} times what most orders below "
                "and above it do, without a pattern over the conditions that was found: it counts as noise; look at "
                "curves"
            )
    return tuple(found)
