"""Where resonances lie: by the speeds at which their orders are loudest, and by what peaks at a frequency would save.

The first holds whatever the line shape. For the second, over a grid of frequencies, orders are taken one by one and by
direction; a structure that stiffens under load, or softens as it warms, has another frequency at each level, and there
the frequencies of all levels are searched together.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import levels_of, speed_levels
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect, Form, Stage
from st_codegen.rig.effects.resonance import LOAD_PART, StructuralResonance

#: random peaks whose agreement is counted: a share of one in 100 is known to a sixth
_DRAWS = 4000


def has_a_frequency(effect: Effect) -> bool:
    """Whether an effect peaks at a frequency; one of the structure that a user adds need not."""
    return effect.stage is Stage.STRUCTURE and effect.orders_key == "orders" and "frequency_Hz" in effect.values


def follows_load(effect: type[Effect], key: str) -> bool:
    """Whether a key is that of the part of a resonance's heights that follows the load."""
    return issubclass(effect, StructuralResonance) and key == LOAD_PART


def load_keys(effect: type[Effect]) -> set[str]:
    """The keys of the part of a resonance's heights that follows the load; none of other effects."""
    own = [phasor for phasor in effect.phasors if follows_load(effect, phasor.key)]
    return {key for phasor in own for side in (False, True) for key in phasor.keys(side)}


def frequencies_in(effect: Effect, at: Conditions) -> tuple[float, float]:
    """The lowest and the highest frequency (Hz) that a resonance has at operating points."""
    moves = effect.shift(at.torque_Nm, at.temperature_C) if isinstance(effect, StructuralResonance) else np.ones(1)
    hertz = effect.scalar("frequency_Hz") * moves
    return float(hertz.min()), float(hertz.max())


def where_there(effect: Effect, at: Conditions) -> BoolArray:
    """The operating points at whose temperatures a resonance is there, (n,)."""
    presence = effect.presence(at) if isinstance(effect, StructuralResonance) else 1.0
    return np.broadcast_to(presence > 0.5, len(at))


def bracket(target: FitData, residual: ComplexArray, effect: Effect) -> tuple[float, float] | None:
    """The frequencies (Hz) between which the peaks of an effect's orders put it; None where they do not agree.

    residual: complex (n, K), measured less a model without the effect. An order that is loudest at one measured speed
    peaks nearer to it than to its neighbours: between the middles to both. What orders and directions have in common
    counts. Where it lies elsewhere at one load or temperature, it has no frequency of all.
    """
    at, there = target.data.at, target.good & where_there(effect, target.data.at)
    low, high, _ = _between(target, residual, effect, there)
    for level in (levels_of(np.abs(at.torque_Nm)), levels_of(at.temperature_C)):
        for number in np.unique(level):
            rows = there & (level == number)
            own_low, own_high, shown = _between(target, residual, effect, rows, SETTINGS.loud_order)
            if shown > 1 and own_low < own_high and not (own_low < high and low < own_high):
                return None
    return (low, high) if 0.0 < low < high < np.inf else None


def _between(
    target: FitData, residual: ComplexArray, effect: Effect, some: BoolArray, loud: float = 0.0
) -> tuple[float, float, int]:
    """The largest lower and the smallest upper end of where orders peak in some rows, and how many orders say so.

    They agree where the upper end is larger. loud: power over the noise from which on a peak is one.
    """
    shown, low, high = set(), 0.0, np.inf
    for order, below, above in _loudest(target, residual, effect.orders, some, loud):
        shown.add(order)
        hertz = order / (60 * target.reduction_ratio)
        low, high = max(low, below * hertz), min(high, above * hertz)
    return low, high, len(shown)


def _loudest(
    target: FitData, residual: ComplexArray, orders: Iterable[int], some: BoolArray, loud: float
) -> Iterator[tuple[int, float, float]]:
    """Each order and direction whose loudest level of speed stands out, and the speeds (rpm) around that level."""
    at, level = target.data.at, speed_levels(target.data.at.speed_rpm)
    for order, sign in itertools.product(orders, (1.0, -1.0)):
        column, rows = np.flatnonzero(target.data.orders == order), some & (at.sign == sign)
        numbers = np.unique(level[rows])
        if not len(column) or len(numbers) < 3:
            continue
        size = [float(np.median(np.abs(residual[rows & (level == n), column[0]]))) for n in numbers]
        edges = _edges(np.array([float(np.median(at.speed_rpm[rows & (level == n)])) for n in numbers]))
        loudest = int(np.argmax(size))
        if size[loudest] ** 2 >= loud * float(np.median(target.sigma[rows, column[0]])) ** 2:
            yield order, float(edges[loudest]), float(edges[loudest + 1])


def is_of_one_speed(target: FitData, residual: ComplexArray, effect: Effect, others: Sequence[int]) -> bool:
    """Whether the orders of an effect, and most of others that it has not, are loudest at one speed of the input.

    residual: complex (n, K), measured less a model without the effect; others: orders that keep more than noise. Each
    is at another frequency there, so that none of these makes them loud. At the lowest or the highest speed, where
    whatever falls or grows with it is loudest, this says nothing.
    """
    some = target.good & where_there(effect, target.data.at)
    own = list(_loudest(target, residual, effect.orders, some, SETTINGS.loud_order))
    low, high = max((below for _, below, _ in own), default=0.0), min((above for *_, above in own), default=np.inf)
    if not 0.0 < low < high < np.inf:
        return False
    hertz = max(order * below for order, below, _ in own), min(order * above for order, _, above in own)
    foreign = [
        (order, below < high and low < above)
        for order, below, above in _loudest(target, residual, others, some, SETTINGS.loud_order)
        if not (order * below < hertz[1] and hertz[0] < order * above)
    ]
    # one of them may well be a resonance of its own that peaks there
    several = len({order for order, there in foreign if there}) > 1
    return several and 2 * sum(there for _, there in foreign) > len(foreign)


def lost_over_the_speed(current: Fit, effect: Effect) -> float:
    """By how much more its orders lose where all of a resonance peak at one speed of the input, not at one frequency.

    In steps of loss by which one name is as good as another, of the noise that is left; infinite where a part of the
    gear makes each of its orders, since these are what a structure can be excited by. Of one order both are the same.
    """
    # only here: few campaigns come here
    from scipy.optimize import minimize

    constants, at = effect.constants, current.target.data.at
    made = {k + side for k in constants.mesh_orders() for side in (-constants.cranks, 0, constants.cranks)}
    places = [int(k) for k in np.flatnonzero(np.isin(current.target.data.orders, effect.orders))]
    if made.issuperset(effect.orders):
        return np.inf
    if len(places) < 2:
        return 0.0
    own, orders = current.explained(effect), current.target.data.orders
    middle, damping = float(np.median(orders[places])), effect.scalar("damping_ratio")
    rows = [np.flatnonzero(side) for side in at.by_direction(current.target.good)]

    def left(k: int, waves: ComplexArray) -> float:
        """What waves (n,), of any height in each direction, leave of the order in a column, in noises squared."""
        found = 0.0
        for side in rows:
            sigma = current.target.sigma[side, k]
            wanted, wave = (current.residual[side, k] + own[side, k]) / sigma, waves[side] / sigma
            height = np.vdot(wave, wanted) / max(float(np.vdot(wave, wave).real), 1e-300)
            found += float((np.abs(wanted - height * wave) ** 2).sum())
        return found

    def over_the_speed(moved: FloatArray) -> float:
        """What is left where all orders peak where the middle one would; moved: logarithms of frequency and damping."""
        move, width = np.exp(moved).tolist()
        values = {"frequency_Hz": effect.scalar("frequency_Hz") * move, "damping_ratio": damping * width}
        form = effect.with_values({**effect.values, **values})
        whole = 0.0
        for k in places:
            alike = replace(at, speed_rpm=at.speed_rpm * (middle / float(orders[k])))
            whole += left(k, form.contribution(alike, orders[k : k + 1])[:, 0])
        return whole

    # the peak is at a speed of some run, and at one that the frequency gives one of the orders
    hertz = at.speed_rpm[current.target.good] * (middle / 60.0 / constants.reduction_ratio)
    moves = np.log(np.maximum(hertz, 1e-300) / effect.scalar("frequency_Hz"))
    span = float(np.log(orders[places].max() / orders[places].min())) + damping
    steps = np.unique(np.round(moves[np.abs(moves) <= span] / (damping / 2)))
    if not len(steps):
        return np.inf
    starts = [np.array([step * damping / 2, 0.0]) for step in steps.tolist()]
    corners = np.array([[0.0, 0.0], [damping / 2, 0.0], [0.0, 0.2]]) + min(starts, key=over_the_speed)
    speed = float(minimize(over_the_speed, corners[0], method="Nelder-Mead", options={"initial_simplex": corners}).fun)
    frequency = sum(left(k, own[:, k]) for k in places)
    numbers = 2.0 * len(places) * sum(map(len, rows))
    # what neither explains is as much noise to both
    return (speed - frequency) / SETTINGS.as_good / max(1.0, min(speed, frequency) / numbers)


def _edges(speed: FloatArray) -> FloatArray:
    """The middles between speeds, and the ends of all speeds."""
    return np.concatenate([[0.0], (speed[1:] + speed[:-1]) / 2, [np.inf]])


def chance_of_bracket(target: FitData, orders: Sequence[int]) -> float:
    """How often orders that are each loudest at any one of the measured speeds would agree on a frequency.

    No order always does: a resonance that lost all of its own has no peaks that say something.
    """
    if not orders:
        return 1.0
    speed = target.data.at.speed_rpm[target.good]
    level = speed_levels(speed)
    edges = _edges(np.array([float(np.median(speed[level == n])) for n in np.unique(level)]))
    drawn = np.random.default_rng(0).integers(len(edges) - 1, size=(_DRAWS, len(orders)))
    low, high = ((edges[drawn + side] * np.array(orders)) for side in (0, 1))
    return float((low.max(axis=1) < high.min(axis=1)).mean())


def spread(frequency: float, between: tuple[float, float]) -> float:
    """RMS distance (Hz) of a frequency from those of a bracket, all taken as equally likely."""
    low, high = between
    return float(np.sqrt((high - low) ** 2 / 12 + ((high + low) / 2 - frequency) ** 2))


#: by how many steps of the grid the frequency at the highest level lies from that at the lowest one, at most: a factor
#: of 1.6 with the narrowest peaks, four with those of a damping ratio of 0.03
_MOST_STEPS = 64
#: how far a frequency has levelled off at the largest load: load over the load of half the change
_LEVELS_OFF = (0.0, 1.0, 5.0)


@dataclass(frozen=True)
class Start:
    """Where a resonance is started: what it takes off twice the loss, its values but for the sizes, and its orders."""

    gain: float
    values: dict[str, float]
    orders: tuple[int, ...]


@dataclass(frozen=True)
class _Along:
    """A condition that a frequency may follow: its key, the values in the key's unit, and how far it may level off."""

    key: str
    values: FloatArray
    bends: tuple[float, ...] = (0.0,)


class Frequencies:
    """The starts of one effect that peaks at a frequency."""

    def __init__(
        self,
        effect: type[Effect],
        fit: Fit,
        weights: FloatArray,
        powers: Callable[[IntArray], tuple[FloatArray, FloatArray, IntArray]],
    ) -> None:
        """weights: float64 (n, K), of coefficients of the fit; powers: of orders (their places), see `worth`."""
        self.effect, self.fit, self.weights, self.powers = effect, fit, weights, powers
        self.target, self.data = fit.target, fit.target.data
        self.constants = fit.state.rig.constants
        self.frequency = next(scalar for scalar in effect.scalars if scalar.unit == "Hz")
        self.orders = [int(k) for k in self.data.orders if k > 0]
        self.loud = self._loud_orders()

    def starts(self) -> list[Start]:
        """The frequencies that gain most, the best first."""
        named = [piece.effect for piece in self.fit.state.pieces if piece.effect.name == self.effect.name]
        found = list[Start]()
        for fixed, grid in self._forms():
            found += self._promising(self._gains(fixed, grid, self.target.good), fixed, grid)
        return self._apart(sorted((one for one in found if not self._is_known(one, named)), key=lambda one: -one.gain))

    def moved(self) -> list[Start]:
        """The frequency that moves with the load or the oil temperature and gains most, if there is one.

        Of orders that a resonance has already none: how it lacks what they keep is not told by another one.
        """
        taken = {order for piece in self.fit.state.pieces if piece.effect.name == self.effect.name
                 for order in piece.effect.orders}  # fmt: skip
        found = [
            one for fixed, grid in self._forms() for along in self._axes for one in self._moved(fixed, grid, along)
            if not taken & set(one.orders)
        ]  # fmt: skip
        return [max(found, key=lambda one: one.gain)] if found else []

    def _forms(self) -> Iterator[tuple[dict[str, float], FloatArray]]:
        """The starts of all that shapes a peak but its frequency, each with a grid as fine as it asks."""
        shapes = [s for s in self.effect.scalars if s.form is Form.SHAPE and s.default is None]
        others = [s for s in shapes if s is not self.frequency]
        for values in itertools.product(*(s.starts for s in others)):
            grid = self._grid(0.7 * min(values))
            if len(grid):
                yield {s.key: v for s, v in zip(others, values, strict=True)}, grid

    @property
    def _axes(self) -> tuple[_Along, ...]:
        """What a structure's frequency follows."""
        at = self.data.at
        warmer = (at.temperature_C - self.constants.reference_temperature_C) / 10.0
        load = np.abs(at.torque_Nm) / 1000.0
        return _Along("frequency_per_kNm", load, _LEVELS_OFF), _Along("frequency_per_10K", warmer)

    def _grid(self, step: float) -> FloatArray:
        """Frequencies (Hz) that orders have at some speed, by equal ratios; none where no order is loud."""
        if not self.loud:
            return np.empty(0)
        turn = self.data.at.speed_rpm / (60 * self.constants.reduction_ratio)
        low = max(min(self.orders) * turn.min(), self.frequency.lower)
        high = min(max(self.orders) * turn.max(), self.frequency.upper)
        return np.exp(np.arange(np.log(low), np.log(high), step))

    def _gains(self, fixed: dict[str, float], grid: FloatArray, some: BoolArray) -> FloatArray:
        """What each order gains by each frequency in some rows, (frequencies, orders)."""
        at, key = self.data.at, self.frequency.key
        gains = np.zeros((len(grid), len(self.orders)))
        for rows in map(np.flatnonzero, at.by_direction(some)):
            speeds, inverse = np.unique(at.speed_rpm[rows], return_inverse=True)
            point = at.rows(rows[np.unique(inverse, return_index=True)[1]])
            places = np.searchsorted(self.data.orders, [self.orders[j] for j in self.loud])
            w = self.weights[np.ix_(rows, places)]
            level = (inverse[:, None] == np.arange(len(speeds))).astype(float)
            weight, sums = level.T @ w, level.T @ (w * self.fit.residual[np.ix_(rows, places)])
            loud = np.array([self.orders[j] for j in self.loud])
            h = self._unit_responses([fixed | {key: float(f)} for f in grid], point)[:, :, self.loud]
            power = h.real**2 + h.imag**2
            gain = np.abs((h.conj() * sums).sum(axis=1)) ** 2 / np.maximum((weight * power).sum(axis=1), 1e-300)
            turns = grid[:, None] / loud * 60 * self.constants.reduction_ratio
            slowest, fastest = (1.0 - SETTINGS.beyond_speeds) * speeds[0], (1.0 + SETTINGS.beyond_speeds) * speeds[-1]
            gains[:, self.loud] += gain * ((turns > slowest) & (turns < fastest))
        return gains

    def _promising(self, gains: FloatArray, fixed: dict[str, float], grid: FloatArray) -> Iterator[Start]:
        """A start at each frequency that some orders gain by."""
        gains = self._worth(gains)
        clear = gains > SETTINGS.order_gain
        for i in np.flatnonzero(clear.any(axis=1)):
            chosen = tuple(np.array(self.orders)[clear[i]].tolist())
            yield Start(float(gains[i][clear[i]].sum()), fixed | {self.frequency.key: float(grid[i])}, chosen)

    def _worth(self, gains: FloatArray) -> FloatArray:
        if not self.data.few_points:
            return gains
        return np.asarray(worth(gains, *self.powers(np.searchsorted(self.data.orders, self.orders))))

    def _moved(self, fixed: dict[str, float], grid: FloatArray, along: _Along) -> list[Start]:
        """The best start of each way in which a frequency may move along a condition; none where there is one level.

        Between the lowest and the highest level it follows the law of `StructuralResonance.shift`.
        """
        level = levels_of(along.values)
        used = np.unique(level[self.target.good])
        if self.effect is not StructuralResonance or len(used) < 2:
            return []
        rows = [self.target.good & (level == number) for number in used]
        means = np.array([along.values[own].mean() for own in rows])
        gains = np.stack([self._gains(fixed, grid, own) for own in rows])
        # each level has sizes of its own here, two numbers of each direction, which gain by chance
        least = SETTINGS.order_gain + 4.0 * (len(means) - 1)
        found, step = list[Start](), 0.7 * min(fixed.values())
        for bend, steps in itertools.product(along.bends, range(-_MOST_STEPS, _MOST_STEPS + 1, 2)):
            law = means / (1.0 + bend * means / means[-1])
            change = np.expm1(steps * step) / (law[-1] - law[0])
            moved = np.rint(np.log1p(change * (law - law[0])) / step).astype(np.int64)
            first = np.arange(max(0, -moved.min()), len(grid) - max(0, moved.max()))
            of_orders = self._worth(gains[np.arange(len(means)), first[:, None] + moved].sum(axis=1))
            sums = (of_orders * (of_orders > least)).sum(axis=1)
            if not sums.max(initial=0.0) > 0.0:
                continue
            best = int(np.argmax(sums))
            of_none = 1.0 - change * law[0]
            values = {self.frequency.key: float(grid[first[best]] * of_none), along.key: float(change / of_none)}
            values |= {"levels_off_per_kNm": float(bend / means[-1])} if bend else {}
            orders = tuple(np.array(self.orders)[of_orders[best] > least].tolist())
            found.append(Start(float(sums[best]), fixed | values, orders))
        return [one for one in found if _is_inside(self.effect, one.values)]

    def _unit_responses(self, starts: Sequence[dict[str, float]], point: Conditions) -> ComplexArray:
        """What amplitudes of 1 contribute at each start, complex128 (starts, points, orders). The last few are kept."""
        key = (self.effect.name, len(starts), *starts[0].items(), point.speed_rpm.tobytes(), point.sign[:1].tobytes())
        kept = self.target.responses
        if key not in kept:
            places = np.array(self.orders)
            ones = {"orders": tuple(self.orders), self.effect.phasors[0].key: (1.0,) * len(self.orders)}
            found = np.empty((len(starts), len(point), len(self.orders)), np.complex128)
            for i, values in enumerate(starts):
                found[i] = self.effect(ones | values, self.constants, check=False).contribution(point, places)
            if sum(array.nbytes for array in kept.values()) > SETTINGS.most_kept_bytes:
                kept.clear()
            kept[key] = found
        return kept[key]

    def _loud_orders(self) -> list[int]:
        """Places of orders whose residual could hold a gain at all."""
        # weighed by how far they scatter themselves, few runs are never loud
        weights = self.target.counts / self.target.sigma**2 if self.data.few_points else self.weights
        z2 = weights * np.abs(self.fit.residual) ** 2
        rows = max(int(self.target.good.sum()), 1)
        excess = z2.sum(axis=0) - 2 * rows
        loud = excess > max(SETTINGS.order_gain, 2 * np.sqrt(rows))
        return [j for j, order in enumerate(self.orders) if loud[np.searchsorted(self.data.orders, order)]]

    def _apart(self, starts: Sequence[Start]) -> list[Start]:
        """The best starts whose frequencies differ by more than 2 %."""
        found, key = list[Start](), self.frequency.key
        for start in starts:
            if all(abs(np.log(start.values[key] / other.values[key])) > SETTINGS.other_start for other in found):
                found.append(start)
            if len(found) == SETTINGS.resonance_starts:
                break
        return found

    def _is_known(self, start: Start, named: Sequence[Effect]) -> bool:
        """Whether a resonance of the same orders is there already: what is left of it is no second one."""
        return any(
            self._apart_by(start.values[self.frequency.key], other) < SETTINGS.same_resonance
            and set(start.orders) & set(other.orders)
            for other in named
        )

    def _apart_by(self, hertz: float, other: Effect) -> float:
        """How far (logarithm of the ratio) a frequency lies from those that a resonance has in these runs."""
        low, high = np.log(frequencies_in(other, self.data.at))
        return float(max(low - np.log(hertz), np.log(hertz) - high, 0.0))


def _is_inside(effect: type[Effect], values: dict[str, float]) -> bool:
    known = {scalar.key: scalar for scalar in effect.scalars}
    return all(known[key].lower <= x <= known[key].upper for key, x in values.items())


def worth(saved: Any, whole: Any, noise: Any, numbers: Any) -> Any:
    """What loss saved is worth where few runs have told the scatter that it is weighed by; arrays element by element.

    Orders are weighed by how far they scatter about a model that lacks what is looked for, so that of few runs
    nothing could save much. With an unknown scatter likelihoods differ by the logarithm of what is left.
    """
    left = np.maximum(whole - saved, np.maximum(np.minimum(whole, noise), 1e-300))
    return numbers * np.log(np.maximum(whole, left) / left)
