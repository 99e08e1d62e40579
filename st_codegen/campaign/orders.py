"""Order analysis: complex coefficients of a curve by least squares on the measured angle.

The samples of a curve are equidistant in time, the speed fluctuates, and so they are not equidistant in angle: an FFT
over the number of the sample (`Sums.plain_fft`, the paper's way) turns the phases of high orders and leaks. The least
squares need of a curve only its sums over exp(-i*m*theta), so a campaign is read once and fitted to any set of orders.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from st_codegen.campaign.curves import Curve
from st_codegen.campaign.moments import moments
from st_codegen.campaign.rounded import without_steps
from st_codegen.campaign.spikes import LEAST_ROW, longest_row, off_deg
from st_codegen.errors import InputError
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray

#: highest order that is looked at, unless more is asked for
BAND = 400
#: noise alone is above its own floor by this factor once in a million orders: P(A > x) = exp(-(x/floor)^2)
SIGNIFICANT = math.sqrt(-math.log(1e-6))
#: neighbours on each side that tell the noise at an order
_NEIGHBOURS = 12
#: waves whose product is one at all samples but for so much are the same there
_SAME_WAVE = 1e-6
#: of the samples, as many hold an order above the band at what is expected where there is no noise
_LEAST_BELIEF = 1e-9
#: turns from which on a curve holds more than one: below, a quarter of its samples is no alias of an order
_SEVERAL_TURNS = 1.5
#: larger TE is none, and the squares of some have no float64
_LARGEST_TE_DEG = 1e15
#: rounds of finding what else is in a curve
_ROUNDS = 3


@dataclass(frozen=True)
class Sums:
    """All that least squares need of one curve, for orders 0..K.

    samples: number N; angle: complex128 (2*K + 1,), sum of exp(-i*m*theta); te: complex128 (K + 1,), sum of
    TE*exp(-i*k*theta) in deg; te_square: sum of TE^2 in deg^2; plain_fft: complex128 (band + 1,), deg, the
    coefficients of an FFT over the number of the sample, of the whole turns that it holds (of the first, where it is
    less than one and a half); ends: float64 (2, 4), the lowest and the highest TE in deg,
    each with the most samples in a row that have it, the most that have the value next to it, and the number of values;
    spikes: float64 (4, s), the samples that are in none of the sums: angle in rad, TE in deg, by how much that is off
    what the FFT has in their places, and their numbers in order of time; begin: the angle of the first sample, rad;
    turns: how many the curve holds, 1 for less than one; moved_deg: by how much angles are off those that
    were read, at most, where these are rounded.
    """

    samples: int
    angle: ComplexArray
    te: ComplexArray
    te_square: float
    plain_fft: ComplexArray
    ends: FloatArray
    spikes: FloatArray
    begin: float
    turns: float
    moved_deg: float = 0.0

    @property
    def taken(self) -> int:
        """The number of samples that were taken, with those that were left out."""
        return self.samples + int(self.spikes.shape[1])

    @property
    def in_turn(self) -> int:
        """How many of these a turn has: they tell which orders are told, and as which others a higher one shows."""
        return round(self.taken / self.turns)

    @property
    def holds_several(self) -> bool:
        """Whether the curve holds more than one turn, and does not just end a little behind where it began."""
        return self.turns >= _SEVERAL_TURNS

    @property
    def row_left_out(self) -> int:
        """How many samples of a turn were left out in a row, at most, where no other turn of the curve has any."""
        there = np.bincount(np.arange(self.taken) % self.in_turn)
        np.subtract.at(there, self.spikes[3].astype(np.intp) % self.in_turn, 1)
        return longest_row(np.flatnonzero(there == 0))

    def with_spikes(self, chosen: BoolArray) -> Sums:
        """The sums with some of the samples that were left out, bool (s,)."""
        angle, te = self.spikes[:2, chosen]
        return replace(
            self,
            samples=self.samples + len(te),
            angle=self.angle + np.exp(-1j * np.arange(len(self.angle))[:, None] * angle).sum(axis=1),
            te=self.te + np.exp(-1j * np.arange(len(self.te))[:, None] * angle) @ te,
            te_square=self.te_square + float(te @ te),
            spikes=self.spikes[:, ~chosen],
        )

    @property
    def values(self) -> int:
        """How many values TE has."""
        return int(self.ends[0, 3])

    @property
    def band(self) -> int:
        """The highest order that the curve tells: a quarter of the samples, where there are few."""
        return max(1, min(len(self.te) - 1, self.in_turn // 4))


@dataclass(frozen=True)
class OrderFit:
    """The coefficients of one curve: TE(theta) = Re(sum of c_k * exp(i*k*theta)), deg.

    coefficients: complex128 (orders,); noise_floor: float64 (orders,), the root mean square amplitude in deg that noise
    alone would have there; waves: complex128 (band + 1,), of orders that stand above the noise their coefficients, of
    the others what all these leave; spectrum_floor: float64 (band + 1,), as noise_floor for every order;
    residual_rms_deg: what is left of the curve after the wanted orders.
    """

    orders: tuple[int, ...]
    coefficients: ComplexArray
    noise_floor: FloatArray
    waves: ComplexArray
    spectrum_floor: FloatArray
    residual_rms_deg: float

    @property
    def spectrum(self) -> FloatArray:
        """Amplitudes of all orders, float64 (band + 1,), deg."""
        return np.abs(self.waves)


def listed(orders: Sequence[int]) -> str:
    """The first of some orders, for messages."""
    return ", ".join(map(str, orders[:12])) + (", .." if len(orders) > 12 else "")


def curve_sums(curve: Curve, band: int = BAND) -> Sums:
    """The sums of a curve for orders up to `band`; those that it does not tell leak where it has gaps.

    Samples far from those around them are left out. Angles are taken without the steps that they are rounded to, unless
    all orders leave clearly less of the curve as it is read: those of a curve that was thinned out have steps as well,
    and are exact. What steps make of a curve may be less than its noise, and is the same in all curves.
    """
    sums = _sums_over(curve.angle_deg, curve, band)
    angle = without_steps(curve.angle_deg, min(band, len(curve.te_deg) // 4))
    if angle is curve.angle_deg:
        return sums
    smooth = replace(_sums_over(angle, curve, band), moved_deg=float(np.abs(angle - curve.angle_deg).max()))
    # the odds of two curves with as many numbers each
    more = math.log(_left_of_all(smooth) / _left_of_all(sums)) * (sums.samples - 2 * sums.band - 1) / 2.0
    return sums if more > SIGNIFICANT**2 else smooth


def _left_of_all(sums: Sums) -> float:
    """The sum of squares that all orders of the band leave of a curve, as far as it tells them."""
    orders = np.arange(sums.band + 1)
    held = np.full(len(orders), _LEAST_BELIEF * sums.samples)
    least = np.finfo(np.float64).eps * max(sums.te_square, np.finfo(np.float64).tiny)
    return max(_square_error(sums, orders, _solve(sums, orders, held)), least)


def _sums_over(angle_deg: FloatArray, curve: Curve, band: int) -> Sums:
    """The sums of a curve with these angles."""
    theta, te = np.deg2rad(angle_deg), np.asarray(curve.te_deg, np.float64)
    off, begin = off_deg(te), float(theta[0])
    far = off != 0.0
    # an angle that begins anew at 360 deg may end where it began, or a little beyond
    turns = abs(float(np.unwrap(theta)[-1]) - begin) / (2.0 * np.pi) * len(te) / (len(te) - 1)
    whole, turns = te - off, max(turns, 1.0)
    in_turn = round(len(te) / turns)
    # less than a sample more than a turn is what angles are off by
    turns = turns if in_turn < len(te) else 1.0
    forward = whole if theta[0] <= theta[-1] else whole[::-1]
    forward = forward if turns >= _SEVERAL_TURNS else forward[:in_turn]
    fft = np.fft.rfft(forward) * (2.0 / len(forward))
    fft[0] /= 2.0
    left_out = np.stack([theta[far], te[far], off[far], np.flatnonzero(far)])
    theta, te = theta[~far], te[~far]
    if (largest := float(np.abs(te).max())) > _LARGEST_TE_DEG:
        raise InputError(f"TE is up to {largest:.3g} deg; no more than {_LARGEST_TE_DEG:g} is read: an error code?")
    both = moments(theta, np.stack([np.ones(len(te)), te]), 2 * band)
    sums = Sums(
        len(te),
        both[0],
        both[1, : band + 1],
        float(te @ te),
        fft,
        _ends(te),
        left_out,
        begin,
        turns,
    )
    return replace(sums, plain_fft=fft[: sums.band + 1])


def _ends(te: FloatArray) -> FloatArray:
    """`Sums.ends` of samples (n,)."""
    first = np.flatnonzero(np.append(True, te[1:] != te[:-1]))
    values, which = np.unique(te[first], return_inverse=True)
    longest = np.zeros(len(values))
    np.maximum.at(longest, which, np.diff(np.append(first, len(te))))
    both = ((values, longest), (values[::-1], longest[::-1]))
    return np.array([[own[0], held[0], held[1] if len(held) > 1 else 0.0, len(own)] for own, held in both])


def fit_orders(curve: Curve | Sums, orders: Sequence[int], beyond: Mapping[int, complex] | None = None) -> OrderFit:
    """Fit a set of orders to a curve, together with every other order up to the band that stands above the noise.

    Of waves that are the same at the angles of the samples the lowest, or the wanted one, is fitted.
    Fitting the others too keeps them from leaking into the wanted ones where the angles are uneven, or have a gap.
    beyond: coefficients that are expected of orders above the band, deg. They are fitted as well, each believed to its
    own size; those that the sums do not reach do not count.
    Raises InputError for an order above the band (a quarter of the samples, or what the sums were made for), and for
    samples at too few different angles.
    """
    wanted = tuple(sorted(set(orders)))
    sums = curve if isinstance(curve, Sums) else curve_sums(curve, max([BAND, *wanted]))
    if wanted and (wanted[-1] > sums.band or wanted[0] < 0):
        raise InputError(
            f"orders {listed([k for k in wanted if not 0 <= k <= sums.band])} cannot be fitted: the curve's "
            f"{sums.samples} samples tell 0 to {sums.band}"
        )
    fitted = np.array(sorted({0, *wanted}))
    expected = {k: c for k, c in (beyond or {}).items() if sums.band < k < len(sums.te) and c}
    whole, sums = sums, _without(sums, expected)
    own, coefficients, residual, floor = fitted, *_fitted(sums, fitted)
    for _ in range(_ROUNDS):
        new = _no_images(sums, fitted, np.setdiff1d(np.flatnonzero(np.abs(residual) > SIGNIFICANT * floor), fitted))
        if not len(new) and len(own) == len(fitted) + len(expected):
            break
        more = np.union1d(fitted, new)
        beside = np.concatenate([more, np.array(sorted(expected), np.intp)])
        # an amplitude has 4/N of the variance of a sample
        variance = sums.samples * floor[-1] ** 2 / 4.0
        belief = [max(variance / abs(expected[k]) ** 2, _LEAST_BELIEF * sums.samples) for k in sorted(expected)]
        try:
            coefficients, residual, floor = _fitted(sums, beside, np.array([0.0] * len(more) + belief))
        except InputError:
            # so many waves the samples do not tell apart, as where a part of the turn is missing
            break
        fitted, own = more, beside
    residual[fitted] = coefficients[: len(fitted)]
    columns = np.searchsorted(fitted, wanted)
    chosen = coefficients[columns]
    left = math.sqrt(square_error(whole, wanted, chosen))
    return OrderFit(wanted, chosen, floor[list(wanted)], residual, floor, left)


def _fitted(
    sums: Sums, orders: npt.NDArray[np.intp], belief: FloatArray | None = None
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Coefficients of orders, what they leave of the band, and its noise."""
    coefficients = _solve(sums, orders, belief)
    residual = _residual(sums, orders, coefficients)
    return coefficients, residual, _noise_floor(sums, residual, orders, coefficients)


def _no_images(sums: Sums, fitted: npt.NDArray[np.intp], new: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """The new orders without those whose waves are, at the angles of the samples, those of lower ones or half of one.

    Angles that are rounded to 360 steps a turn show order 359 where there is order 1, and of order 180 no sine.
    """
    kept = fitted
    if np.abs(sums.angle[1:]).max(initial=0.0) <= (1.0 - _SAME_WAVE) * sums.samples:
        return new  # the usual case: no two waves are the same
    for order in new:
        others = np.concatenate([order - kept, order + kept, [2 * order] if order else []]).astype(np.intp)
        alike = np.abs(_angle_sum(sums, others)).max(initial=0.0)
        kept = kept if alike > (1.0 - _SAME_WAVE) * sums.samples else np.append(kept, order)
    return np.setdiff1d(kept, fitted)


def _without(sums: Sums, expected: Mapping[int, complex]) -> Sums:
    """The sums of a curve without these coefficients."""
    if not expected:
        return sums
    orders, coefficients = np.array(list(expected), np.intp), np.array(list(expected.values()))
    left = _square_error(sums, orders, coefficients)
    return replace(sums, te=_left(sums, orders, coefficients, len(sums.te) - 1), te_square=left)


def square_error(sums: Sums, orders: Sequence[int], coefficients: ComplexArray) -> float:
    """Mean square in deg^2 between a curve and coefficients, be they fitted or predicted. No samples are needed."""
    return _square_error(sums, np.array(orders, np.intp), coefficients) / sums.samples


def _angle_sum(sums: Sums, m: npt.NDArray[np.intp]) -> ComplexArray:
    """Sum of exp(-i*m*theta) for positive and negative m."""
    at = sums.angle[np.abs(m)]
    return np.where(m < 0, at.conj(), at)


def _normal_matrix(sums: Sums, orders: npt.NDArray[np.intp]) -> FloatArray:
    """Scalar products of cos(k*theta) and -sin(k*theta), (2*orders, 2*orders): cosines first."""
    minus = _angle_sum(sums, orders[:, None] - orders)
    plus = _angle_sum(sums, orders[:, None] + orders)
    cos_cos, sin_sin = (minus + plus).real / 2.0, (minus - plus).real / 2.0
    # cos(k)*sin(l) = (sin(k + l) - sin(k - l))/2, and the imaginary part of a sum is minus that of the sines
    cos_sin = (plus - minus).imag / 2.0
    return np.block([[cos_cos, cos_sin], [cos_sin.T, sin_sin]])


def _unknowns(orders: npt.NDArray[np.intp]) -> BoolArray:
    """All cosines, and sines except that of order 0."""
    return np.concatenate([np.ones(len(orders), np.bool_), orders > 0])


def _solve(sums: Sums, orders: npt.NDArray[np.intp], belief: FloatArray | None) -> ComplexArray:
    """Least squares; belief: by how much each order is held at zero, variance of a sample over that of the order."""
    mask = _unknowns(orders)
    right = np.concatenate([sums.te[orders].real, sums.te[orders].imag])
    solution = np.zeros(len(mask))
    matrix = _normal_matrix(sums, orders) + np.diag(np.tile(np.zeros(len(orders)) if belief is None else belief, 2))
    matrix = matrix[np.ix_(mask, mask)]
    known = np.linspace(1.0, 2.0, len(matrix))  # a solution that is known tells how many digits are lost
    try:
        found, again = np.linalg.solve(matrix, np.stack([right[mask], matrix @ known], axis=1)).T
        # what is believed of an order holds it where the samples do not
        own = np.full(len(matrix), True) if belief is None else np.tile(belief == 0.0, 2)[mask]
        least = math.sqrt(np.finfo(np.float64).eps)
        # a wave that is nothing at all angles, as a sine of two steps a period, may have any size
        is_told = np.abs(again - known)[own].max(initial=0.0) <= least
        is_told = is_told and np.diag(matrix)[own].min(initial=np.inf) > least * sums.samples
    except np.linalg.LinAlgError:
        is_told = False
    if not is_told:
        new = _no_images(sums, orders[:0], orders)
        same = np.setdiff1d(orders, new).tolist()
        which = f"{listed(same)} from others" if same else f"{listed(orders.tolist())} apart"
        row = sums.row_left_out
        why = "are their steps coarse, or has the turn a gap?"
        if row >= LEAST_ROW:
            why = f"{row} samples in a row are left out, which lie far from those around them"
        raise InputError(f"the angles of the samples do not tell the orders {which}: {why}")
    solution[mask] = found
    return solution[: len(orders)] + 1j * solution[len(orders) :]


def _residual(sums: Sums, orders: npt.NDArray[np.intp], coefficients: ComplexArray) -> ComplexArray:
    """What the coefficients leave, as the wave of each order 0..band, complex128 (band + 1,), deg."""
    waves: ComplexArray = _left(sums, orders, coefficients, sums.band) * (2.0 / sums.samples)
    waves[0] /= 2.0
    return waves


def _left(sums: Sums, orders: npt.NDArray[np.intp], coefficients: ComplexArray, highest: int) -> ComplexArray:
    """The sums of TE*exp(-i*k*theta) for k = 0..highest that coefficients leave."""
    half, zero = coefficients / 2.0, len(sums.angle) - 1
    # what each wave adds to the sums of all k is a piece of one row of sums, of -m to m
    pieces = sliding_window_view(np.concatenate([sums.angle[:0:-1].conj(), sums.angle]), highest + 1)
    made = half @ pieces[zero - orders] + half.conj() @ pieces[zero + orders]
    return np.asarray(sums.te[: highest + 1] - made)


def _noise_floor(
    sums: Sums, residual: ComplexArray, fitted: npt.NDArray[np.intp], coefficients: ComplexArray
) -> FloatArray:
    """Root mean square amplitude of noise at each order, from the median of the neighbours that are not fitted.

    Amplitudes of noise have a Rayleigh distribution: its root mean square is its median over sqrt(ln 2). The mean
    (order 0) is one real number with a quarter of the variance of an amplitude. Where every order of the band is
    fitted, what all of them leave of the samples is the noise, as much at every order.
    """
    free = np.setdiff1d(np.arange(1, len(residual)), fitted)
    if len(free):
        width = min(2 * _NEIGHBOURS, len(free))
        start = np.searchsorted(free, np.arange(len(residual))) - width // 2
        windows = np.clip(start, 0, len(free) - width)[:, None] + np.arange(width)
        floor: FloatArray = np.median(np.abs(residual[free[windows]]), axis=1) / math.sqrt(math.log(2.0))
    else:
        # an amplitude has 4/N of the variance of a sample; the band is a quarter of the samples at most
        left = _square_error(sums, fitted, coefficients) / max(sums.samples - 2 * len(fitted) + 1, 1)
        floor = np.full(len(residual), math.sqrt(4.0 * left / sums.samples))
    floor[0] /= 2.0
    return floor


def _square_error(sums: Sums, orders: npt.NDArray[np.intp], coefficients: ComplexArray) -> float:
    """Sum of (TE - curve of the coefficients)^2."""
    x = np.concatenate([coefficients.real, coefficients.imag])
    right = np.concatenate([sums.te[orders].real, sums.te[orders].imag])
    return max(float(sums.te_square - 2.0 * (right @ x) + x @ _normal_matrix(sums, orders) @ x), 0.0)
