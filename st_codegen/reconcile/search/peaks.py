"""Where a resonance lies whatever its line shape: each of its orders is loudest at the measured speed next to it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.contrasts import levels_of, speed_levels
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect, Stage
from st_codegen.rig.effects.resonance import LOAD_PART, StructuralResonance

#: random peaks whose agreement is counted: a share of one in 100 is known to a sixth
_DRAWS = 4000


def has_a_frequency(effect: Effect) -> bool:
    """Whether an effect peaks at a frequency; one of the structure that a user adds need not."""
    return effect.stage is Stage.STRUCTURE and effect.orders_key == "orders" and "frequency_Hz" in effect.values


def follows_load(effect: type[Effect], key: str) -> bool:
    """Whether a key is that of the part of a resonance's heights that follows the load."""
    return issubclass(effect, StructuralResonance) and key == LOAD_PART


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
