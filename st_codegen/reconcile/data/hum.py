"""A hum: a wave of one frequency in time that runs through all curves, of the mains, another drive, the building.

At each speed it has another order, f * 60 * ratio / speed, mostly between two whole ones, and leaks into those beside
it: what an effect or a bad run would have to explain is one frequency for all runs. The samples of a curve are even in
time, so that over their number a hum is a single line, below the highest order or mirrored at it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from st_codegen.campaign.orders import Sums, fit_orders
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.settings import SETTINGS

#: median of the sum of two exponential numbers
_MEDIAN_OF_TWO = 1.678
#: curves of which waves at several orders are held at once
_AT_ONCE = 256


@dataclass(frozen=True)
class Hum:
    """A wave of one frequency in time, or of no whole number of periods a turn, that was taken out of curves.

    frequency_Hz: 0 where it has a number of periods a turn, `order`, instead; amplitude_deg: root mean square over the
    curves in which it was seen; curves: how many these are, and all; by_order: (highest band + 1,) RMS over angle and
    all curves of what it had made of each order, as far as each curve tells it, deg; is_faint: too few curves show it
    by themselves for it to be taken out of them; sizes_deg: between which nine in ten of the curves lie.
    """

    frequency_Hz: float
    amplitude_deg: float
    curves: tuple[int, int]
    by_order: FloatArray
    is_faint: bool = False
    order: float = 0.0
    sizes_deg: tuple[float, float] = (0.0, 0.0)

    @property
    def varies(self) -> bool:
        """Whether it is clearly larger in some curves than in others."""
        return self.sizes_deg[1] > 2.0 * self.sizes_deg[0] > 0.0

    @property
    def _size_text(self) -> str:
        low, high = self.sizes_deg
        return f"{low:.2g} to {high:.2g} deg" if self.varies else f"{self.amplitude_deg:.2g} deg"

    @property
    def power(self) -> float:
        """What was taken out, as mean square over the angle and all curves, deg^2; 0 where it was not."""
        seen, of = self.curves
        return 0.0 if self.is_faint else self.amplitude_deg**2 * seen / of / 2

    def scaled(self, factor: float) -> Hum:
        """This wave in another unit."""
        low, high = (abs(factor) * size for size in self.sizes_deg)
        return replace(
            self, amplitude_deg=self.amplitude_deg * factor, by_order=self.by_order * factor, sizes_deg=(low, high)
        )

    def among(self, curves: int) -> Hum:
        """This wave as one of so many curves, of which those that were looked at are a part."""
        seen, of = self.curves
        return replace(self, curves=(seen, curves), by_order=self.by_order * float(np.sqrt(of / curves)))

    @property
    def text(self) -> str:
        """The sentence on this wave: its frequency, its size, in how many curves it was found."""
        seen, of = self.curves
        if self.order:
            return (
                f"a wave of {self.order:.1f} periods a turn, {self._size_text} in {seen} of {of} curves: it "
                "does not come back to where it began, as of a bearing, a belt or another shaft; it was taken out of "
                "these curves"
            )
        if self.is_faint:
            return (
                f"at {self.frequency_Hz:.3g} Hz there is more than at others, {self.amplitude_deg:.2g} deg in "
                f"the mean of {seen} of {of} curves: a wave of that frequency whatever the speed, as of the mains or "
                "another drive, or a resonance that lifts many orders; too few curves show it by themselves, and it "
                "was not taken out"
            )
        others = " (in others it is weaker, or outside of the orders that were looked at)" if seen < of else ""
        return (
            f"a wave of {self.frequency_Hz:.4g} Hz whatever the speed, {self._size_text} in {seen} of {of} "
            f"curves{others}: it does not turn with the "
            "machine, as the mains or another drive would make it; it was taken out of these curves"
        )


class _Seen(NamedTuple):
    """A wave in a curve: its size (deg; 0 where none shows), its order there, coefficients of the orders it makes.

    wave: over one turn; whole: over all samples of the curve.
    """

    size: float
    order: float
    wave: ComplexArray
    whole: ComplexArray


def _taken_out(
    sums: Sequence[Sums], seen: Sequence[_Seen], frequency_Hz: float = 0.0, order: float = 0.0
) -> tuple[list[Sums], Hum]:
    """Curves without a wave of one frequency, or of one number of periods a turn, and that wave."""
    kept = [_less(one, own) for one, own in zip(sums, seen, strict=True)]
    sizes = np.array([own.size for own in seen if own.size])
    low, high = np.quantile(sizes, (0.05, 0.95))
    size, made = float(np.sqrt((sizes**2).mean())), _by_order(kept, [own.wave for own in seen])
    ends = (float(low), float(high))
    return kept, Hum(frequency_Hz, size, (len(sizes), len(kept)), made, order=order, sizes_deg=ends)


def without_hums(
    sums: Sequence[Sums], turns_Hz: FloatArray, known: Collection[int]
) -> tuple[list[Sums], tuple[Hum, ...]]:
    """Curves without the waves of a frequency of their own that run through them, and these waves.

    turns_Hz: turns a second of each curve, (n,); known: orders of the rig, where a wave may be the machine's.
    """
    kept, found = list(sums), list[Hum]()
    while len(found) < SETTINGS.most_hums:
        band = min(one.band for one in kept)
        lines = np.stack([one.plain_fft[: band + 1] for one in kept])
        power = np.abs(lines) ** 2
        power /= np.maximum(np.median(power, axis=1, keepdims=True) / np.log(2.0), 1e-300)
        free = np.median(power, axis=0) < SETTINGS.stands_out
        free[[order for order in (*range(SETTINGS.wander_orders), *known) if order <= band]] = False
        frequency = _frequency(power, free, np.array([one.in_turn for one in kept]), turns_Hz)
        if frequency is None:
            faint = None if found else _faint(kept, turns_Hz, known)
            return kept, (*found, *([] if faint is None else [faint]))
        told = _waves(kept, lines, frequency / turns_Hz, free)
        sizes, orders = np.array([own.size for own in told]), np.array([own.order for own in told])
        seen = sizes > 0
        # an order of the machine that a resonance lifts near this frequency is a whole number
        if not seen.any() or np.median(np.abs(orders - frequency / turns_Hz)[seen]) > SETTINGS.near_an_order:
            break
        frequency = float(np.average((orders * turns_Hz)[seen], weights=turns_Hz[seen] ** -2))
        most = float(sizes.max())
        fits = _waves(kept, lines, frequency / turns_Hz, free, most)
        kept, hum = _taken_out(kept, fits, frequency_Hz=frequency)
        found.append(hum)
    return kept, tuple(found)


def without_waves_between(
    sums: Sequence[Sums], known: Collection[int], sign: FloatArray | None = None
) -> tuple[list[Sums], tuple[Hum, ...]]:
    """Curves without waves of no whole number of periods a turn, about the same number in most curves.

    Over a turn such a wave jumps, and leaks into all orders: what lies around would be called an effect of an angle.
    known: orders of the rig; sign: the direction of each curve, (n,): what loads one flank, or one side of a bearing,
    has its waves in one direction alone, and is looked for in most curves of each as well.
    """
    kept, found = _without_most(sums, known)
    for own in () if sign is None else (np.flatnonzero(sign == one) for one in np.unique(sign)):
        if len(own) < len(kept):
            left, waves = _without_most([kept[row] for row in own], known)
            for row, one in zip(own, left, strict=True):
                kept[row] = one
            found += [wave.among(len(kept)) for wave in waves]
    return kept, tuple(found)


def _without_most(sums: Sequence[Sums], known: Collection[int]) -> tuple[list[Sums], list[Hum]]:
    """`without_waves_between` of waves that most of these curves have."""
    kept, found = list(sums), list[Hum]()
    band = min(one.band for one in kept)
    free = np.ones(band + 1, bool)
    free[[order for order in (0, 1, *known) if order <= band]] = False
    some = slice(None, None, -(-len(kept) // SETTINGS.curves_that_tell))
    for _ in range(SETTINGS.most_tried_between):
        lines = np.stack([one.plain_fft[: band + 1] for one in kept])
        power = np.abs(lines) ** 2
        noise = np.median(power, axis=1) / np.log(2.0)
        usual = np.where(free, np.median(power / np.maximum(noise[:, None], 1e-300), axis=0), 0.0)
        top = int(usual.argmax())
        if usual[top] < SETTINGS.loud_line:
            break
        told = _between(kept[some], lines[some], noise[some], free, top)
        if np.mean([own.size > 0.0 for own in told]) >= SETTINGS.most_orders:
            told = _between(kept, lines, noise, free, top)
        sizes, orders = np.array([own.size for own in told]), np.array([own.order for own in told])
        seen = sizes > 0.0
        middle = float(np.median(orders[seen])) if seen.any() else 0.0
        spread = float(np.median(np.abs(orders[seen] - middle))) if seen.any() else 0.0
        is_between = abs(middle - round(middle)) >= SETTINGS.near_an_order >= spread
        if not is_between or seen.mean() < SETTINGS.most_orders or not _over_the_angle(kept[some], known, top):
            free[top] = False  # it may be louder than a wave between others
            continue
        # in curves that do not tell its order well by themselves it has that of the others
        told = _waves(kept, lines, np.full(len(kept), middle), free, reach=spread, least=SETTINGS.least_between)
        is_seen = np.mean([own.size > 0.0 for own in told]) >= SETTINGS.most_orders
        if not is_seen or not _leaks_as_it_should(lines, told, free, middle):
            free[top] = False
            continue
        kept, hum = _taken_out(kept, told, order=middle)
        found.append(hum)
        # what is left of it is none of its own
        free[max(top - 1, 0) : top + 2] = False
    return kept, found


def _over_the_angle(sums: Sequence[Sums], known: Collection[int], top: int) -> bool:
    """Whether curves are loud near an order over the measured angle as well as over the number of the sample.

    Where the speed ripples within the turn the samples are uneven in angle, and orders of the rig (`known`) leak into
    others over their number.
    """
    shares = []
    for one in sums:
        near = [order for order in range(max(top - 3, 1), min(top + 4, one.band + 1)) if order not in known]
        over_angle = fit_orders(one, [order for order in known if order <= one.band]).waves[near]
        shares.append(float(np.abs(over_angle).max() / max(float(np.abs(one.plain_fft[near]).max()), 1e-300)))
    return float(np.median(shares)) > SETTINGS.stays_over_angle


def _between(sums: Sequence[Sums], lines: ComplexArray, noise: FloatArray, free: BoolArray, top: int) -> list[_Seen]:
    """A wave near a loud order in each curve.

    It is one where the orders around it hold nothing else.
    """
    found = list[_Seen]()
    for first in range(0, len(sums), _AT_ONCE):
        own = slice(first, first + _AT_ONCE)
        found += _some_between(sums[own], lines[own], noise[own], free, top)
    return found


def _some_between(
    sums: Sequence[Sums], lines: ComplexArray, noise: FloatArray, free: BoolArray, top: int
) -> list[_Seen]:
    """`_between` of so few curves that their waves near all orders that are tried fit into the memory."""
    places, found, reach = np.arange(len(free)), [], 0.5 - SETTINGS.near_an_order
    tried = [
        _waves(sums, lines, np.full(len(sums), low + 0.5), free, reach=reach, least=SETTINGS.least_between)
        for low in range(max(top - 3, 1), top + 3)
    ]
    for line, floor, *fits in zip(lines, noise, *tried, strict=True):
        best = max(fits, key=lambda fit: fit.size and float((np.abs(fit.wave[: len(free)][free]) ** 2).sum()))
        near = free & (np.abs(places - best.order) <= SETTINGS.orders_beside_wave)
        left, whole = (float((np.abs(part[near]) ** 2).sum()) for part in (line - best.wave[: len(free)], line))
        is_one = near.sum() > 2 and left - int(near.sum()) * floor < SETTINGS.left_of_unit * whole
        found.append(best if is_one else _none_seen(best.order, len(best.wave)))
    return found


def _leaks_as_it_should(lines: ComplexArray, told: Sequence[_Seen], free: BoolArray, order: float) -> bool:
    """Whether the orders beside the one next to a wave hold what leaks from it, in the mean of the curves.

    A jump falls as one over the distance from its order; sidebands of whole orders (a mesh whose phase another wave
    moves) fall faster, and two of them beside each other look like one wave between them. What noise could be is no
    leak. lines: (n, band + 1).
    """
    places = np.arange(len(free))
    beside = free & (np.abs(places - order) <= SETTINGS.orders_of_line) & (places != round(order))
    waves = np.stack([own.wave[: len(free)] for own in told if own.size > 0.0])
    lines = lines[[own.size > 0.0 for own in told]]
    left = np.abs(lines - waves) ** 2
    near = free & (np.abs(places - order) <= SETTINGS.noise_beside_wave)
    noise = float((np.median(left[:, near], axis=1) / np.log(2.0)).mean())
    whole, leaks, rest = (
        float(power[:, beside].sum(axis=1).mean()) for power in (np.abs(lines) ** 2, np.abs(waves) ** 2, left)
    )
    # of exponential powers the deviation is their mean
    by_chance = noise * float(np.sqrt(beside.sum() / len(lines)))
    return (
        rest - int(beside.sum()) * noise < SETTINGS.left_beside_wave * leaks
        and whole - rest > SETTINGS.sure_beside_wave * by_chance
    )


def _by_order(sums: Sequence[Sums], waves: Sequence[ComplexArray]) -> FloatArray:
    """RMS over the angle and all curves of what waves made of each order up to the highest band."""
    power = np.zeros(max(one.band for one in sums) + 1)
    for one, wave in zip(sums, waves, strict=True):
        power[: one.band + 1] += np.abs(wave[: one.band + 1]) ** 2 / len(sums)
    power[1:] /= 2
    return np.asarray(np.sqrt(power))


def _faint(sums: Sequence[Sums], turns_Hz: FloatArray, known: Collection[int]) -> Hum | None:
    """A wave of a frequency of its own that curves show together and too few of them by themselves, if there is one.

    Over the noise the power of two orders beside each other is Gamma distributed: of n curves with mean 2 n.
    """
    band, rows = min(one.band for one in sums), np.arange(len(sums))
    lines = np.stack([one.plain_fft[: band + 1] for one in sums])
    noise = np.median(np.abs(lines) ** 2, axis=1) / np.log(2.0)
    lines /= np.sqrt(np.maximum(noise[:, None], 1e-300))
    # an order that is louder than others in most curves is one of the machine, or its noise
    lines /= np.sqrt(np.maximum(np.median(np.abs(lines) ** 2, axis=0) / np.log(2.0), 1.0))
    power = np.minimum(np.abs(lines) ** 2, SETTINGS.loud_line)
    free = np.ones(band + 1, bool)
    free[[order for order in (*range(SETTINGS.wander_orders + 1), *known) if order <= band]] = False
    samples = np.array([one.in_turn for one in sums])
    lowest, highest = (SETTINGS.wander_orders + 1) * float(turns_Hz.min()), band * float(turns_Hz.max())
    # a quarter of an order in the slowest curve that could show it
    tried = lowest * (1.0 + 0.25 / band) ** np.arange(np.log(max(highest / lowest, 1.0)) / np.log1p(0.25 / band))
    least, best, shown = float(np.log(max(len(tried), 1) / SETTINGS.p_chance)), 0.0, np.zeros(len(rows), bool)
    for frequency in tried.tolist():
        low = _mirrored(frequency / turns_Hz, samples).astype(np.int64)
        could = low < band
        could[could] = free[low[could]] & free[low[could] + 1]
        both = power[rows[could], low[could]] + power[rows[could], low[could] + 1]
        sure = _beyond_noise(both)
        if sure > least and _is_alike(both, low[could], turns_Hz[could]):
            least, best, shown = sure, frequency, could
    if not best:
        return None

    def told(frequency: float) -> FloatArray:
        """The amplitude (square, over the noise) that each curve has of a frequency, with its noise."""
        found = []
        for row in np.flatnonzero(shown):
            order = float(_mirrored(np.array(frequency / turns_Hz[row]), samples[row]))
            near = np.arange(max(int(order) - 1, 1), min(int(order) + 3, band + 1))
            leaks = _leaks(order, near, int(samples[row]))
            shows = float(np.abs(np.vdot(leaks, lines[row, near])) ** 2) / _power(leaks)
            found.append(float((shows - 1.0) / _power(leaks)))
        return np.array(found)

    # the two orders beside a line are the same over a whole order
    reach = 0.5 * float(turns_Hz[shown].max())
    step = max(0.1 * float(turns_Hz[shown].min()), reach / SETTINGS.steps_of_frequency)
    best = max(np.arange(best - reach, best + reach, step), key=lambda frequency: float(told(frequency).sum()))
    size = float(np.sqrt(max(float((told(best) * noise[shown]).mean()), 0.0)))
    return Hum(float(best), size, (int(shown.sum()), len(sums)), np.zeros(max(one.band for one in sums) + 1), True)


def _beyond_noise(both: FloatArray) -> float:
    """How sure the sum of powers of two orders each is no noise: Chernoff's bound on its chance, as -log."""
    usual, whole = 2.0 * len(both), float(both.sum())
    return whole - usual - usual * float(np.log(whole / usual)) if whole > usual else 0.0


def _is_alike(both: FloatArray, order: IntArray, turns_Hz: FloatArray) -> bool:
    """Whether most curves show it, slow ones and fast ones, at many orders: what turns with the machine does not."""
    slow = turns_Hz < np.median(turns_Hz)
    halves = [both[slow], both[~slow]]
    return (
        len(np.unique(order)) >= SETTINGS.shared_orders
        and float(np.mean(both > _MEDIAN_OF_TWO)) > 0.5 + 0.5 * SETTINGS.told / np.sqrt(len(both))
        and all(_beyond_noise(half) > SETTINGS.half_of_hum for half in halves)
    )


def _frequency(power: FloatArray, free: BoolArray, samples: IntArray, turns_Hz: FloatArray) -> float | None:
    """The frequency (Hz) at which most curves that could show it have a line, or None.

    power: over the noise, (n, band + 1); free: orders at which a line is not the machine's; samples, turns_Hz: of each
    curve, (n,).
    """
    rows, band = np.arange(len(power)), power.shape[1] - 1
    # where there is little noise a hum is loud far beside its line: it is where it is louder than at both sides
    around = np.pad(power, ((0, 0), (1, 1)))
    loud = free & (power > SETTINGS.loud_line) & (power >= np.maximum(around[:, :-2], around[:, 2:]))
    power = np.where(free, power, 0.0)
    top = np.clip(power.argmax(axis=1), 1, band - 1)
    size, left, right = (np.sqrt(power[rows, top + step]) for step in (0, -1, 1))
    beside = np.where(right > left, right, -left)
    line = top + beside / np.maximum(size + np.abs(beside), 1e-300)
    told = loud[rows, top]
    mirrored = [times * samples[told] + side * line[told] for times in range(3) for side in (1, -1)]
    tried = np.unique(np.concatenate(mirrored) * np.tile(turns_Hz[told], len(mirrored)))
    tried = tried[tried > 0]
    if not len(tried):
        return None
    order = _mirrored(tried[:, None] / turns_Hz, samples)
    low = np.clip(order.astype(np.int64), 1, band - 1)
    could = (order < band) & (power[rows, low] > 0) & (power[rows, low + 1] > 0)
    shown = could & (loud[rows, low] | loud[rows, low + 1])
    # how often two orders of a curve hold a line by chance, and Chernoff's bound of so many doing so at a frequency
    chance = min(0.5, 2.0 * max(float(loud[power > 0].mean()), 1.0 / power.size))
    number, share = could.sum(axis=1), shown.sum(axis=1) / np.maximum(could.sum(axis=1), 1)
    apart = np.array([len(np.unique(own[is_shown])) for own, is_shown in zip(low, shown, strict=True)])
    share = np.clip(share, 1e-12, 1 - 1e-12)
    sure = number * (share * np.log(share / chance) + (1 - share) * np.log((1 - share) / (1 - chance)))
    sure[(share < max(SETTINGS.most_orders, chance)) | (apart < SETTINGS.least_block)] = 0.0
    best = float(sure.max(initial=0.0))
    if best < np.log(len(tried) / SETTINGS.p_chance):
        return None
    return float(np.median(tried[sure > SETTINGS.as_likely * best]))


def _mirrored(order: FloatArray, samples: IntArray) -> FloatArray:
    """The order, between 0 and half the samples of a turn, as which a wave of any order shows."""
    return np.asarray(np.abs(order - samples * np.round(order / samples)))


def _leaks(order: FloatArray | float, at: IntArray | FloatArray, samples: IntArray | int) -> ComplexArray:
    """What exp(i*order*phi) over `samples` even steps of a turn gives the orders `at`, as part of its size."""
    x = order - at
    return np.asarray(np.exp(1j * np.pi * x * (1 - 1 / samples)) * np.sinc(x) / np.sinc(x / samples))


def _waves(
    sums: Sequence[Sums],
    lines: ComplexArray,
    orders: FloatArray,
    free: BoolArray,
    most: float = 0.0,
    reach: float = 0.5,
    least: float = SETTINGS.shared_least,
) -> list[_Seen]:
    """A wave in each of n curves, near an order.

    lines: (n, band + 1), the orders of the curves over the number of the sample; orders: (n,), of the waves, which the
    speed tells to less than half an order; free: (band + 1,), those orders that are not the machine's; most: the
    largest size that a wave may have of which little is seen, beside an order of the machine or beyond the band; 0 for
    none; reach: how far their orders may be from these; least: part of its power that a wave must show for its order to
    be looked for.
    """
    samples = np.array([one.in_turn for one in sums])
    beyond = orders - samples * np.round(orders / samples)
    shown = np.abs(beyond)
    # beyond the band its leaks into the highest orders tell it
    places = np.flatnonzero(free)
    nearest = np.argsort(np.abs(places - shown[:, None]), axis=1, kind="stable")
    near = places[nearest[:, : 2 * SETTINGS.orders_of_line]]
    seen = np.take_along_axis(lines, near, axis=1)
    clear = _power(_leaks(shown[:, None], near, samples[:, None])) > least
    # where little of it is seen only the speed tells its order
    middle, looked = shown.copy(), np.flatnonzero(clear)
    for _ in range(6 if len(looked) else 0):
        trials = middle[looked, None] + reach * np.arange(-2, 3) / 2
        power = _told(seen[looked], trials, near[looked], samples[looked])[1]
        middle[looked] = trials[np.arange(len(looked)), power.argmax(axis=1)]
        reach /= 3
    sizes, told = (values[:, 0] for values in _told(seen, middle[:, None], near, samples))
    sizes = np.where(clear, sizes, sizes * np.minimum(1.0, most / np.maximum(np.abs(sizes), 1e-300)))
    found, moved = [], np.sign(beyond) * (middle - shown)
    for row, one in enumerate(sums):
        wave = _made(sizes[row], middle[row], len(one.te), one.in_turn)
        noise = float(np.median(np.abs(lines[row] - wave[: len(free)])[free] ** 2)) / np.log(2.0)
        if _start(one) is None or told[row] < SETTINGS.loud_line * noise:
            found.append(_none_seen(float(orders[row]), len(wave)))
        else:
            whole = _made(sizes[row], middle[row], len(one.te), one.taken, one.taken / one.in_turn)
            found.append(_Seen(float(abs(sizes[row])), float(orders[row] + moved[row]), wave, whole))
    return found


def _none_seen(order: float, count: int) -> _Seen:
    """What is told of a curve that shows no wave of an order."""
    nothing = np.zeros(count, np.complex128)
    return _Seen(0.0, order, nothing, nothing)


def _made(size: complex, order: float, count: int, samples: int, turns: float = 1.0) -> ComplexArray:
    """The coefficients of the first orders that a wave makes over so many samples, which are so many turns."""
    at = np.asarray(np.arange(count) * turns, np.float64)
    made = size * _leaks(order * turns, at, samples) + np.conj(size * _leaks(order * turns, -at, samples))
    made[0] /= 2
    return np.asarray(made)


def _told(lines: ComplexArray, orders: FloatArray, at: IntArray, samples: IntArray) -> tuple[ComplexArray, FloatArray]:
    """The waves of T orders that explain most of each of n lines at K orders: their sizes, and the power they explain.

    A real wave is one of the negative order as well, which leaks into the same orders. lines, at: (n, K); orders:
    (n, T); samples: (n,). Both answers are (n, T).
    """
    order, place, count = orders[:, :, None], at[:, None, :], samples[:, None, None]
    plus, minus = _leaks(order, place, count), _leaks(order, -place, count).conj()
    columns = np.stack([plus + minus, 1j * (plus - minus)], axis=2)
    matrix = (columns @ columns.conj().swapaxes(2, 3)).real
    pull = (columns.conj() @ lines[:, None, :, None]).real
    # at order 0 and at half the samples one of the two is no wave
    parts = np.linalg.pinv(matrix, rcond=1e-12, hermitian=True) @ pull
    return parts[:, :, 0, 0] + 1j * parts[:, :, 1, 0], (parts * pull).sum(axis=(2, 3))


def _power(leaks: ComplexArray) -> FloatArray:
    return np.asarray((np.abs(leaks) ** 2).sum(axis=-1))


def _less(one: Sums, own: _Seen) -> Sums:
    """The curve without a wave, given by the coefficients of its orders over the number of the sample."""
    turned = own.whole * np.exp(-1j * (_start(one) or 0.0) * np.arange(len(own.whole))) * one.taken / 2
    turned[0] *= 2
    left = one.plain_fft - own.wave[: one.band + 1]
    # of the samples it leaves the square as well, or it would be looked for above the band
    power = np.abs(left) ** 2 - np.abs(one.plain_fft) ** 2
    square = one.te_square + one.taken * float(power[0] + power[1:].sum() / 2)
    return replace(one, te=one.te - turned, te_square=max(square, 0.0), plain_fft=left)


def _start(one: Sums) -> float | None:
    """The angle (rad) of the first sample, or None where the samples are no even turn from there on."""
    orders = np.arange(1, one.band + 1)
    te, even = one.te[orders], _repeated(one)[1:]
    product = te * even.conj()
    start = -float(np.angle(product[0]))
    if one.taken > one.in_turn:
        # beside whole turns a wave of any frequency reaches order 1: the angle that was read tells better
        ends = one.begin - 2.0 * np.pi * np.array([0.0, one.taken - 1.0]) / one.in_turn
        start = float(ends[np.abs(np.exp(1j * ends) - np.exp(1j * start)).argmin()])
    turned = product * np.exp(1j * start * orders)
    whole = np.sqrt((np.abs(te) ** 2).sum() * (np.abs(even) ** 2).sum())
    return start if turned.real.sum() > SETTINGS.stable * whole else None


def _repeated(one: Sums) -> ComplexArray:
    """The coefficients over all samples of a curve of which each turn is what its FFT has, if they are even."""
    if one.taken <= one.in_turn:
        return one.plain_fft
    waves = one.plain_fft * np.where(np.arange(one.band + 1) > 0, 1.0, 2.0)
    turn = np.fft.irfft(np.pad(waves, (0, one.in_turn // 2 - one.band)), one.in_turn)
    turn[: one.taken - one.in_turn] *= 2.0
    return np.asarray(np.fft.rfft(turn)[: one.band + 1])
