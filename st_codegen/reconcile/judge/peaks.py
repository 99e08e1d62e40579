"""Where a resonance lies whatever its line shape: each of its orders is loudest at the measured speed next to it."""

from __future__ import annotations

from collections.abc import Sequence

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
    at, data = target.data.at, target.data
    level, shown = speed_levels(at.speed_rpm), set()
    low, high = 0.0, np.inf
    for order in effect.orders:
        column = np.flatnonzero(data.orders == order)
        for sign in (1.0, -1.0):
            rows = some & (at.sign == sign)
            numbers = np.unique(level[rows])
            if not len(column) or len(numbers) < 3:
                continue
            size = [float(np.median(np.abs(residual[rows & (level == n), column[0]]))) for n in numbers]
            speed = np.array([float(np.median(at.speed_rpm[rows & (level == n)])) for n in numbers])
            hertz = _edges(speed) * order / (60 * target.reduction_ratio)
            loudest = int(np.argmax(size))
            if size[loudest] ** 2 < loud * float(np.median(target.sigma[rows, column[0]])) ** 2:
                continue
            shown.add(order)
            low, high = max(low, float(hertz[loudest])), min(high, float(hertz[loudest + 1]))
    return low, high, len(shown)


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
