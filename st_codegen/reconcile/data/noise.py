"""Noise floor and bad runs, from the data alone: how far a run lies from what others let expect.

Runs at about the same speed and neighbouring torques and temperatures predict each run by a local plane. What is left
is noise, whatever the model lacks, as long as that varies smoothly with torque and temperature. Runs that lie anywhere
are compared with a smooth function of the conditions: a Gaussian process. How fast it changes along each condition and
how loud the noise beside it is are not chosen but averaged over, by how likely the data are under each choice, so that
a plane, a bend and nothing at all compete on equal terms (MacKay, Information Theory, Inference, and Learning
Algorithms, 2003, chapters 28 and 45).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, fdtrc

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import (
    Undecided,
    along_axes,
    contrasts,
    of_whole_levels,
    repeats,
    speed_levels,
)
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions

#: median of |x| for a normal x, and of the length of a vector of two: 0.6745, sqrt(2*ln 2)
MEDIAN_1, MEDIAN_2 = 0.67449, 1.17741


def middle_of(values: FloatArray) -> tuple[float, float]:
    """The median of values (n,), and its standard error where they scatter about it as normal numbers do."""
    middle = float(np.median(values))
    return middle, float(np.median(np.abs(values - middle))) / MEDIAN_1 * float(np.sqrt(np.pi / 2 / len(values)))


def sigma_of(values: ComplexArray, orders: IntArray) -> FloatArray:
    """Robust standard deviation of one component (real or imaginary) per order, float64 (K,)."""
    if not len(values):
        return np.zeros(len(orders))
    size = np.abs(np.where(orders == 0, values.real, values))
    # np.median takes twice as long for the few values of a speed, which this is mostly asked of
    middle = sorted({(len(size) - 1) // 2, len(size) // 2})
    median = np.partition(size, middle, axis=0)[middle].mean(axis=0)
    return np.asarray(median / np.where(orders == 0, MEDIAN_1, MEDIAN_2))


@dataclass(frozen=True)
class Noise:
    """What the data say about their noise.

    sigma: float64 (n, K), standard deviation of one component, by row (direction) and order; floor_rms: float64 (K,),
    RMS of one component, tails included; good: bool (n,); suspects: rows and their distance (1 is usual); kinds: by
    order what the floor is made of (`plane`, `smooth`, `speed`, `torque`, `temperature`, `repeats`,
    `law`, `rig`); undecided: rows that are not good either, and not called bad, since the machine may be the cause.
    """

    sigma: FloatArray
    floor_rms: FloatArray
    good: BoolArray
    suspects: tuple[tuple[int, float], ...]
    kinds: tuple[str, ...] = ()
    undecided: tuple[Undecided, ...] = ()

    @property
    def with_the_undecided(self) -> Noise:
        """The noise with the undecided rows among the good ones: what they have is no noise."""
        good = self.good.copy()
        good[[row for group in self.undecided for row in group.rows]] = True
        return replace(self, good=good)


def estimate(data: Observations, residual: ComplexArray, known_bad: BoolArray | None = None) -> Noise:
    """Noise from the contrasts of residuals (n, K); bad runs are found one after the other and left out."""
    if data.angle_rad is not None:
        return _of_samples(data, residual)
    if data.seen is not None:
        # an order that was not measured has no deviation: the median of those that were stands for it
        residual = np.where(data.seen, residual, np.median(np.where(data.seen, residual, 0), axis=0))
    good = np.ones(len(data), bool) if known_bad is None else ~known_bad
    if data.left_out is not None:
        good &= ~data.left_out
    suspects: dict[int, float] = {}
    for _ in range(6):
        local = contrasts(data.at, good)
        if local.usable.sum() < SETTINGS.least_planes:
            break
        e = local.apply(residual)
        sigma = _sigma_by_direction(data, e, good & local.usable)
        distance = _distances(e, sigma, local.usable)
        usual = np.median(distance[local.usable & good])
        found = np.flatnonzero(good & local.usable & (distance > SETTINGS.suspect_distance * max(usual, 1e-30)))
        # a bad run also moves its neighbours: take the worst of each neighbourhood first
        worst = [
            row for row in found if distance[row] >= max(distance[[*local.index[row][local.weight[row] != 0], row]])
        ]
        deviation = e / sigma
        worst = [row for row in worst if not repeats(data.at, deviation, int(row))]
        if not worst or (~good).sum() + len(worst) > SETTINGS.most_suspects * len(data):
            break
        for row in map(int, worst):
            good[row] = False
            suspects[row] = float(distance[row] / usual)
    level = of_whole_levels(data.at, np.isin(np.arange(len(data)), list(suspects)))
    for row in [row for row in suspects if level[row]]:
        good[row] = True
        del suspects[row]
    local = contrasts(data.at, good)
    rows = good & local.usable
    if rows.sum() >= SETTINGS.least_planes:
        e = local.apply(residual)
        sigma = _sigma_by_direction(data, e, rows)
        floor, kinds = _rms_of(data, e[rows]), ["plane"] * len(data.orders)
        sigma, floor = _smallest(data, residual, good, sigma, floor, kinds)
    else:
        sigma = np.broadcast_to(sigma_of(residual, data.orders), residual.shape).copy()
        floor, kinds = sigma_of(residual, data.orders), ["rig"] * len(data.orders)
        _take_of_laws(data, residual, good, sigma, floor, kinds)
    sigma = _louder_by_themselves(data, sigma)
    ranked = tuple(sorted(suspects.items(), key=lambda item: -item[1]))
    least = np.maximum(_between_orders(data), SETTINGS.least_noise_deg)
    if data.few_points and data.spectral_deg is not None:
        # by chance few runs lie nearer to each other than the noise within each of them lets them
        sigma = np.maximum(sigma, data.spectral_deg)
    return Noise(np.maximum(sigma, least), np.maximum(floor, least), good, ranked, tuple(kinds))


def _louder_by_themselves(data: Observations, sigma: FloatArray) -> FloatArray:
    """Noise (n, K), no smaller in a run than that of the middle one by as much as its own curve is louder.

    What noise there is between the orders of curves may be another than that of orders: only how much louder than
    others a curve is counts, from where the noise of speeds does.
    """
    if data.spectral_deg is None:
        return sigma
    found = sigma.copy()
    for rows in data.at.by_direction():
        own = np.sqrt((data.spectral_deg[rows] ** 2).mean(axis=1))
        louder = own / max(float(np.median(own)), 1e-300)
        louder = np.where(louder > SETTINGS.louder_speed, louder, 1.0)
        found[rows] = np.maximum(sigma[rows], louder[:, None] * np.median(sigma[rows], axis=0))
    return found


def _between_orders(data: Observations) -> FloatArray:
    """The noise between the orders of the curves that tell an order, float64 (K,), where some do not; else 0.

    Rows that stand in for those that were not measured have no noise, and contrasts with them too little.
    """
    if data.seen is None or data.spectral_deg is None:
        return np.zeros(len(data.orders))
    count = data.seen.sum(axis=0)
    power = (np.where(data.seen, data.spectral_deg, 0.0) ** 2).sum(axis=0) / np.maximum(count, 1)
    return np.where(count < len(data), np.sqrt(power), 0.0)


def _rms_of(data: Observations, e: ComplexArray) -> FloatArray:
    """RMS of one component of contrasts (m, K), float64 (K,)."""
    power = np.where(data.orders == 0, e.real**2, np.abs(e) ** 2 / 2)
    return np.asarray(np.sqrt(power.mean(axis=0)))


def _smallest(
    data: Observations, residual: ComplexArray, good: BoolArray, sigma: FloatArray, floor: FloatArray, kinds: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Noise and floor by the kind of contrast that is clearly the smallest, order by order.

    Each kind bounds the noise from above: neighbours whose differences are smaller than those of the plane's show that
    what the plane took for noise is sharp structure.
    """

    def take(name: str, own: FloatArray, own_floor: FloatArray, count: int) -> None:
        # the smallest of several estimates is too small by their scatter: only what is clearly smaller counts
        smaller = own < (1.0 - SETTINGS.clearly_smaller / np.sqrt(count / 2)) * sigma
        for k in np.flatnonzero(smaller.mean(axis=0) > 0.5):
            kinds[k] = name
            floor[k] = min(floor[k], own_floor[k])
        sigma[smaller] = own[smaller]

    beside = np.full(residual.shape, np.inf)
    for side in data.at.by_direction():
        beside[side] = noise_beside(data.at.rows(good & side), residual[good & side], data.orders)
    take("smooth", beside, np.sqrt((beside[good] ** 2).mean(axis=0)), int(good.sum()))
    for name, local in along_axes(data.at, good):
        rows = good & local.usable
        if rows.sum() >= SETTINGS.least_contrasts:
            e = local.apply(residual)
            take(name, _sigma_by_direction(data, e, rows), _rms_of(data, e[rows]), int(rows.sum()))
    return sigma, floor


def _take_of_laws(
    data: Observations, residual: ComplexArray, good: BoolArray, sigma: FloatArray, floor: FloatArray, kinds: list[str]
) -> None:
    """Write in place how far runs lie from a simple law of each direction, where that is no chance.

    The laws are a constant, and straight lines over the torque, or over all conditions. What runs have in common is no
    noise: of runs that are too few for neighbours that is all that can be compared.
    """
    at, parts = data.at, data.parts
    y = data.with_real_mean(residual)
    least = np.full(len(data.orders), np.inf)
    for columns in ((), (at.torque_Nm,), at.axes):
        varied = [(x - x.mean()) / np.ptp(x) for x in columns if np.ptp(x) > 0.0]
        design, told, left, numbers, freedom = np.stack([np.ones(len(data)), *varied], axis=1), 0.0, 0.0, 0, 0
        for rows in (good & side for side in at.by_direction()):
            q = np.linalg.qr(design[rows])[0]
            law = q @ (q.T @ y[rows])
            told, left = told + (np.abs(law) ** 2).sum(axis=0), left + (np.abs(y[rows] - law) ** 2).sum(axis=0)
            numbers, freedom = numbers + q.shape[1], freedom + int(rows.sum()) - q.shape[1]
        if freedom < SETTINGS.least_beside_a_law:
            continue
        noise = np.asarray(left) / freedom
        chance = fdtrc(numbers * parts, freedom * parts, np.asarray(told) / numbers / np.maximum(noise, 1e-300))
        # so few may be nearer to a law than runs are, and both directions of a run may share what they differ by
        fewest = freedom // 2 * parts
        for k in np.flatnonzero((chance < SETTINGS.p_law) & (noise < least)):
            least[k], kinds[k], sigma[:, k] = noise[k], "law", np.sqrt(noise[k] / parts[k])
            floor[k] = sigma[0, k] * np.sqrt(fewest[k] / chdtri(fewest[k], 0.95))


def _sigma_by_direction(data: Observations, e: ComplexArray, rows: BoolArray) -> FloatArray:
    """Noise by direction and order, and by speed where it is clearly louder there (near a resonance).

    Of a dozen runs both directions together tell it: where one seems quieter by chance a fit that is weighed by it
    would follow that direction alone, and make it quieter still.
    """
    sigma = np.zeros((len(data), len(data.orders)))
    level = speed_levels(data.at.speed_rpm)
    for of_sign in data.at.by_direction():
        own = rows & of_sign
        common = sigma_of(e[rows if data.few_points or own.sum() < SETTINGS.rows_of_noise else own], data.orders)
        sigma[of_sign] = common
        for number in np.unique(level):
            here = own & (level == number)
            if here.sum() >= SETTINGS.rows_of_noise:
                louder = sigma_of(e[here], data.orders)
                # the median of 12 or more scatters by a third: only what is beyond that counts
                is_louder = louder > SETTINGS.louder_speed * common
                sigma[of_sign & (level == number)] = np.where(is_louder, louder, common)
    return np.maximum(sigma, 1e-12)


def _of_samples(data: Observations, residual: ComplexArray) -> Noise:
    """Noise of samples over time, of each recording: from third differences of neighbours, and the residual itself."""
    files = data.number_of_recording
    sigma, floor = np.empty(residual.shape), np.empty(residual.shape)
    for n in np.unique(files):
        own = files == n
        # of a handful of samples there are no differences: all tell them
        part = residual[own if own.sum() >= SETTINGS.least_contrasts else ...].real
        smooth = np.diff(part, n=3, axis=0) / np.sqrt(20.0)
        size = np.median(np.abs(smooth), axis=0) / MEDIAN_1
        # what is rounded may differ little from one sample to the next
        least = 1e-12 if data.rounded_by is None else max(float(data.rounded_by[own][0]), 1e-12)
        sigma[own] = np.maximum(np.minimum(size, np.median(np.abs(part), axis=0) / MEDIAN_1), least)
        tails = np.sqrt((np.minimum(np.abs(smooth), 6 * size) ** 2).mean(axis=0))
        floor[own] = np.minimum(np.maximum(tails, least), 1.3 * sigma[own])
    return Noise(sigma, np.sqrt((floor**2).mean(axis=0)), np.ones(len(data), bool), ())


def _distances(e: ComplexArray, sigma: FloatArray, usable: BoolArray) -> FloatArray:
    """Distance of a run from its neighbours: RMS over orders of deviations in noise units, each at most 30.

    The largest fifth of the orders does not count: a bad run is bad in several.
    """
    z = np.sort(np.minimum(np.abs(e) / sigma, 30.0), axis=1)
    z = z[:, : max(1, z.shape[1] - max(1, z.shape[1] // 5))]
    found = np.zeros(len(e))
    found[usable] = np.sqrt((z[usable] ** 2).mean(axis=1))
    return found


#: over how much of its range a function changes along speed, torque and temperature; inf: not at all. What changes
#: faster than a fifth of a range looks like noise to runs that are scattered
_LENGTHS = ((0.2, 0.5, 1.5, np.inf), (0.2, 0.5, 1.5, np.inf), (0.7, 2.0, np.inf))
#: variance of the noise over that of the function
_RATIOS = np.geomspace(1e-8, 1e2, 31)


def noise_beside(at: Conditions, values: ComplexArray, orders: IntArray) -> FloatArray:
    """Standard deviation of one component of the noise of runs of one direction, float64 (K,); inf if not told.

    values: complex128 (n, K), deg.
    """
    count = len(values)
    if not SETTINGS.least_scattered <= count <= SETTINGS.most_scattered:
        return np.full(len(orders), np.inf)
    is_mean = orders == 0
    parts = np.where(is_mean, 1, 2)
    apart = np.hstack([values.real, np.where(is_mean, 0.0, values.imag)])
    evidence, variance = [], []
    for roots, basis in _spectra(at):
        squares = (basis.T @ apart) ** 2
        power = squares[:, : len(orders)] + squares[:, len(orders) :]
        size = roots[:, None] + _RATIOS
        scale = power.T @ (1.0 / size) / (len(roots) * parts)[:, None]
        scale = np.maximum(scale, 1e-300)
        evidence.append(-0.5 * parts[:, None] * (len(roots) * np.log(scale) + np.log(size).sum(axis=0)))
        variance.append(scale * _RATIOS)
    logs, values_of = np.concatenate(evidence, axis=1), np.concatenate(variance, axis=1)
    weight = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(np.sqrt((weight * values_of).sum(axis=1) / weight.sum(axis=1)))


#: of the last conditions: their own bytes, and the spectra of all kernels
_KEPT: dict[bytes, list[tuple[FloatArray, FloatArray]]] = {}


def _spectra(at: Conditions) -> list[tuple[FloatArray, FloatArray]]:
    """For each choice of lengths the eigenvalues (n - 1,) and vectors (n, n - 1) of the kernel, the mean taken out."""
    columns = at.axes
    key = b"".join(column.tobytes() for column in columns)
    if key not in _KEPT:
        if len(_KEPT) >= 4:
            _KEPT.clear()
        count = len(at)
        apart = [((c[:, None] - c[None]) / max(float(np.ptp(c)), 1e-9)) ** 2 for c in columns]
        # a basis of all that is not the mean
        free = np.linalg.qr(np.column_stack([np.ones(count), np.eye(count)[:, 1:]]))[0][:, 1:]
        varied = [lengths if np.ptp(c) > 0 else (np.inf,) for lengths, c in zip(_LENGTHS, columns, strict=True)]
        _KEPT[key] = []
        for lengths in itertools.product(*varied):
            kernel = np.exp(-0.5 * sum(square / length**2 for square, length in zip(apart, lengths, strict=True)))
            roots, vectors = np.linalg.eigh(free.T @ kernel @ free)
            _KEPT[key].append((np.maximum(roots, 0.0), free @ vectors))
    return _KEPT[key]
