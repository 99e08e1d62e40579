"""Mistakes of measuring that are a few numbers for all orders: ramps over the turn, zeros of the angle, its distortion.

So the orders can be asked, each by a vote: no effect turns every order k by k times one angle in some runs and not in
others, gives every order k a part in proportion to 1/k, or gives every order sidebands that grow with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.ramps import ramp, ramp_waves
from st_codegen.reconcile.settings import SETTINGS


def ramps(gap: ComplexArray, noise: FloatArray, orders: IntArray, start: float) -> FloatArray:
    """The ramp over a turn (deg) of each row that all its orders share, (n,); 0 in all rows where the orders disagree.

    gap, noise: what the rig leaves of coefficients, and the power of their noise, (n, K); start: angle (rad) at which
    the ramps begin.
    """
    waves = orders > 0
    k, own, power = orders[waves], gap[:, waves] * np.exp(1j * start * orders[waves]), noise[:, waves]
    found = ramp(own, power, k)
    left = own - ramp_waves(found[:, None], k)
    # of a random walk within the turn a ramp is half the power of each order
    return found if _most_gain(own, left, power, 2 * SETTINGS.vote) else np.zeros(len(gap))


@dataclass(frozen=True)
class OwnSteps:
    """By how much a number of each run is off: off (n,), by all orders; others (n, K), by all but one; error (n,)."""

    off: FloatArray
    others: FloatArray
    error: FloatArray


def own_steps(
    gap: ComplexArray,
    slope: ComplexArray,
    noise: FloatArray,
    number: IntArray,
    least: float,
    off: FloatArray | None = None,
) -> OwnSteps:
    """What the orders say of a number of each run (its torque, a factor), whose rows have the same place (n,).

    gap, noise: what the rig leaves of coefficients, and the power of their noise, (n, K); slope: d(rig)/d(number),
    (n, K); least: the error below which no order says more than another; off: by how much the number is off where gap
    and slope are taken, (n,), of which each order had its say. What all but one order say is brought nearer to nothing
    by their error, against how far the runs differ. An order whose gap has another cause says little.
    """
    told, along = np.zeros((2, number.max() + 1, gap.shape[1]))
    np.add.at(told, number, np.abs(slope) ** 2 / np.maximum(noise, 1e-300))
    np.add.at(along, number, (gap * slope.conj()).real / np.maximum(noise, 1e-300))
    weight = 1.0 / (1.0 / np.maximum(told, 1e-300) + least**2)
    begun = np.zeros(len(told))
    if off is not None:
        begun[number] = off
    says = begun[:, None] + along / np.maximum(told, 1e-300)
    weight = without_strays(says, weight)
    sums = weight * says
    whole, all_of = weight.sum(axis=1, keepdims=True), sums.sum(axis=1, keepdims=True)
    power = max(float(((all_of / whole) ** 2 - 1.0 / whole).mean()), 0.0)
    rest = np.maximum(whole - weight, 1e-300)
    others = (all_of - sums) / rest * power / (power + 1.0 / rest)
    return OwnSteps((all_of / whole)[number, 0], others[number], np.sqrt(1.0 / whole)[number, 0])


def without_strays(says: FloatArray, weight: FloatArray) -> FloatArray:
    """Weights (.., K) of what orders say, one over their errors squared, less of those far from the middle one.

    Their gap has another cause.
    """
    middle = np.quantile(says, 0.5, axis=-1, method="inverted_cdf", weights=weight, keepdims=True)
    far = np.abs(says - middle) * np.sqrt(weight)
    return np.asarray(weight * np.minimum(1.0, SETTINGS.told / np.maximum(far, 1e-300)) ** 2)


def zeros(
    values: ComplexArray,
    model: ComplexArray,
    noise: FloatArray,
    orders: IntArray,
    run: IntArray,
    speed: FloatArray,
    is_sure: bool,
) -> tuple[FloatArray, float]:
    """The angle by which the zero of each row's run differs from the rig's, rad (n,), and the error of it.

    It is 0 where the orders disagree, and everywhere where the runs do not differ, or by no more than a delay makes
    runs of one direction differ: then it is no matter of single runs. values, model, noise: measured coefficients, the
    rig's, and the power of their noise, (n, K); run, speed: the number of each row's run, and its speed, negative
    backward, (n,); is_sure: noise is known by more than how far runs differ, so that orders that it hides have their
    say.
    """
    told = (orders > 0) & ((np.abs(model) ** 2).mean(axis=0) > SETTINGS.told * noise.mean(axis=0))
    hidden = told.sum() < SETTINGS.least_orders_of_zero
    if hidden:
        told = (orders > 0) & is_sure
    k, v, m, power = orders[told], values[:, told], model[:, told], np.maximum(noise[:, told], 1e-300)
    if len(k) < SETTINGS.least_votes or not m.any():
        return np.zeros(len(values)), 0.0
    numbers, place = np.unique(run, return_inverse=True)
    grid = np.arange(0.0, 2 * np.pi, 2 * np.pi / (8 * int(k.max())))
    turns, each = np.exp(1j * np.outer(k, grid)), (run == number for number in numbers)
    its = [_zero_of_run(v[rows], m[rows], power[rows], k, grid, turns, hidden) for rows in each]
    angle, sure, likely = (np.array([getattr(one, key) for one in its]) for key in ("angle", "is_sure", "is_likely"))
    errors = np.array([one.error for one in its])
    error = float(np.median(errors))
    if hidden:
        # where most runs have one, those have one too that tell it less
        sure |= sure[place].mean() > SETTINGS.most_orders
        others = np.arange(len(k)) != (np.abs(m) ** 2 / power).mean(axis=0).argmax()
        sure &= _others_agree(np.sum([one.gains for one in its], axis=0)[others])
    least = np.radians(SETTINGS.least_home_deg)
    off = sure & (np.abs(angle) > least)
    apart = _apart(angle, np.maximum(least, SETTINGS.told * errors), off, np.bincount(place, speed).astype(np.float64))
    if min(int(off.sum()), apart) < SETTINGS.least_block:
        return np.zeros(len(values)), error
    # where several runs have it for sure, it is the likely cause in others too
    turned = (sure | likely) & (np.abs(angle) > least)
    return _as_one(angle[place], turned[place]), error


def _apart(angle: FloatArray, least: FloatArray, off: BoolArray, speed: FloatArray) -> int:
    """How many runs have another zero than the one of those that are off for sure, be they sure themselves or not.

    A delay turns every order by k times an angle as well, in proportion to the speed: only runs of both directions,
    which it turns against each other, tell it from a zero of their own. least: by how much the angle of a run must be
    off, rad, (n,); speed: of both together, 0 where they are.
    """
    common = [np.full(len(angle), np.median(angle[off]))] if off.any() else []
    if common and speed.all():
        common.append(np.median(angle[off] / speed[off]) * speed)
    return min((int((np.abs(angle - one) > least).sum()) for one in common), default=0)


@dataclass(frozen=True)
class _ZeroOfRun:
    """The zero of one run: by how much (rad) it is off, its error, and whether that is sure, or likely.

    gains: what each order saves by the angle that the others tell, (K,); 0 where noise hides none.
    """

    angle: float
    error: float
    is_sure: bool
    is_likely: bool
    gains: FloatArray


def _zero_of_run(
    v: ComplexArray,
    m: ComplexArray,
    power: FloatArray,
    k: IntArray,
    grid: FloatArray,
    turns: ComplexArray,
    hidden: bool,
) -> _ZeroOfRun:
    """The zero of the rows of one run, of coefficients v, those of the rig m, and the power of the noise, (rows, K).

    grid, turns: angles that are tried (rad), and by what each turns the orders k, (K, angles); hidden: noise hides most
    orders.
    """
    gains, is_sure, is_likely = np.zeros(len(k)), False, False
    if not m.any():
        return _ZeroOfRun(0.0, np.inf, is_sure, is_likely, gains)
    # what each order leaves at each angle is `whole` less twice the real part of `both`, turned
    whole, both = np.abs(v) ** 2 + np.abs(m) ** 2 + power, v * m.conj()
    if hidden:
        # by how much noise hides an order is what its vote counts; what the others say of each is asked as well
        loss = (whole / power).sum(axis=0)[:, None] - 2 * _real_part((both / power).sum(axis=0)[:, None], turns)
        of_all = loss.sum(axis=0)
        angle = float(grid[of_all.argmin()])
        gains = loss[:, 0] - loss[np.arange(len(k)), (of_all - loss).argmin(axis=1)]
        # of so many angles the best gains twice the logarithm by chance
        beyond = of_all[0] - of_all.min() - 2.0 * np.log(len(grid))
        is_sure, is_likely = bool(beyond > SETTINGS.order_gain), bool(beyond > 0.0)
    else:
        # one vote an order, however large it is
        left = whole[..., None] - 2 * _real_part(both[..., None], turns)
        angle = float(grid[np.argmin(np.log(np.maximum(left, power[..., None])).sum(axis=(0, 1)))])
    for _ in range(3):  # between the angles of the grid
        turned = m * np.exp(-1j * k * angle)
        # an order that does not agree is off by more than its noise, and says the less
        spread = np.maximum(np.abs(v - turned) ** 2, power)
        pull = (k * (turned.conj() * v).imag / spread).sum()
        angle -= float(pull / (k**2 * np.abs(turned) ** 2 / spread).sum())
    before, after = v - m, v - m * np.exp(-1j * k * angle)
    if not hidden:
        is_sure = _most_gain(before, after, power, SETTINGS.vote)
    is_likely |= bool((np.abs(after) ** 2 / power).sum() < 0.5 * (np.abs(before) ** 2 / power).sum())
    error = float(1.0 / np.sqrt(2.0 * (k**2 * np.abs(m) ** 2 / power).sum()))
    return _ZeroOfRun(float(np.angle(np.exp(1j * angle))), error, is_sure, is_likely, gains)


def _real_part(a: ComplexArray, b: ComplexArray) -> FloatArray:
    """The real part of a product, in half the time of the whole."""
    return np.asarray(a.real * b.real - a.imag * b.imag)


def _others_agree(gains: FloatArray) -> bool:
    """Whether what the other orders say of each, in all runs, is right for all orders but one.

    gains: of all orders but the loudest, which alone could have any cause.
    """
    agreed = np.sort(gains)
    clear = agreed[np.abs(agreed) > SETTINGS.order_gain]
    most = (clear > 0.0).mean() >= SETTINGS.most_orders if len(clear) else False
    return bool(most and agreed[:-1].sum() > SETTINGS.order_gain and agreed[-1] > SETTINGS.order_gain)


def _as_one(angle: FloatArray, turned: BoolArray) -> FloatArray:
    """The angles of the rows, (n,), 0 where they are not turned: of those of one start of the machine one for all.

    What each run says alone is off by its noise and by what is missing there: a start is where many lie together, and
    what lies not far from one, be it turned for what it says alone or not, is taken for one of its runs.
    """
    least, own = np.radians(SETTINGS.least_home_deg), np.sort(angle[turned])
    groups = np.split(own, np.flatnonzero(np.diff(own) > least) + 1)
    middles = [(float(np.median(group)), group) for group in groups if len(group) >= 2 * SETTINGS.least_block]
    near = np.radians(SETTINGS.one_zero_deg)
    starts = np.array([middle for middle, group in middles if np.median(np.abs(group - middle)) < near])
    if not len(starts):
        return angle * turned
    nearest = starts[np.abs(angle[:, None] - starts).argmin(axis=1)]
    is_near = np.abs(angle - nearest) < SETTINGS.one_zero * np.abs(nearest)
    return np.where(is_near, nearest, angle * turned)


def _most_gain(before: ComplexArray, after: ComplexArray, noise: FloatArray, vote: float) -> bool:
    """Whether most orders that show a gap before or after lose a factor of exp(vote) of its power, over all rows."""
    left, right = ((np.abs(part) ** 2).mean(axis=0) for part in (before, after))
    least = np.maximum(noise.mean(axis=0), 1e-300)
    # an order whose gap could neither fall nor rise by as much has no vote
    told: BoolArray = np.maximum(left, right) > max(SETTINGS.told, float(np.exp(vote))) * least
    # noise stays; how much of it there is many rows tell
    unsure = min(1.0, SETTINGS.told / np.sqrt(len(noise))) * least
    gain = np.log((np.maximum(left - least, 0.0) + unsure)[told] / (np.maximum(right - least, 0.0) + unsure)[told])
    return bool(told.sum() >= SETTINGS.least_votes and (gain > vote).mean() > SETTINGS.most_orders)


@dataclass(frozen=True)
class Distorted:
    """An angle that is read as theta + Re(b1 exp(i theta) + b2 exp(2 i theta)); error: (b1, b2), rad.

    Every order k has sidebands then, k * error / 2 times as large as itself, and is smaller itself.
    """

    error: ComplexArray

    def seen(self, values: ComplexArray, orders: IntArray, wanted: IntArray) -> ComplexArray:
        """What the orders (K,) of curves, (n, K), give the wanted ones where the angle is read so."""
        grid = _grid(int(max(orders.max(), wanted.max())))
        true = grid
        for _ in range(_ROUNDS):
            true = grid - self._off(true)
        return _over(values, orders, wanted, true)

    def corrected(self, values: ComplexArray, orders: IntArray) -> ComplexArray:
        """The orders of the curves over the true angle."""
        grid = _grid(int(orders.max()))
        return _over(values, orders, orders, grid + self._off(grid))

    def _off(self, theta: FloatArray) -> FloatArray:
        return np.asarray((self.error @ np.exp(1j * np.outer((1, 2), theta))).real)


def distortion(
    values: ComplexArray, noise: FloatArray, orders: IntArray, rig: ComplexArray, its: IntArray
) -> Distorted | None:
    """How the angle of measured coefficients (n, K) is distorted, if it is; None where a fit does not find it.

    noise: power, (n, K); rig: coefficients (n, R) of its orders (R,).
    """
    found, least = Distorted(np.zeros(2, np.complex128)), noise.mean(axis=0)
    expected = found.seen(rig, its, orders)
    for _ in range(_ROUNDS):
        left = values - expected
        # what each part of the error changes; one vote an order, however large its gap is
        parts = [Distorted(found.error + step).seen(rig, its, orders) - expected for step in _STEPS]
        weight = 1.0 / np.sqrt((np.abs(left) ** 2).mean(axis=0) + np.maximum(least, 1e-300))
        columns, seen = np.stack([(part * weight).ravel() for part in parts], axis=1), (left * weight).ravel()
        real, right = (np.concatenate([part.real, part.imag]) for part in (columns, seen))
        found = Distorted(found.error + np.linalg.lstsq(real, right, rcond=None)[0] @ np.array(_STEPS))
        # a linear fit misses it
        if not float(np.abs(found.error).sum()) * int(orders.max()) < MOST_TURN:
            return None
        expected = found.seen(rig, its, orders)
    return found


#: rad; by how much an angle that is read wrong may turn the highest order: half a wave
MOST_TURN = np.pi
#: rounds of a fit that is linear in the error of the angle, and the steps (rad) of its derivative
_ROUNDS = 6
_STEPS = tuple(np.array(step) for step in ([1e-5, 0], [1e-5j, 0], [0, 1e-5], [0, 1e-5j]))


def _grid(highest: int) -> FloatArray:
    count = 1 << (8 * highest + 16).bit_length()
    return 2 * np.pi * np.arange(count) / count


def _over(values: ComplexArray, orders: IntArray, wanted: IntArray, angle: FloatArray) -> ComplexArray:
    """The wanted orders of curves with coefficients (n, K) whose angle is `angle` at even steps of a turn."""
    waves = np.exp(1j * np.outer(orders, angle))
    spectrum = np.fft.fft(waves, axis=1) / len(angle)
    same, mirrored = spectrum[:, wanted], spectrum[:, -wanted].conj()
    found = values @ same + values.conj() @ mirrored
    found[:, wanted == 0] /= 2
    return np.asarray(found)
