"""Where a resonance lies whatever its line shape: each of its orders is loudest at the measured speed next to it."""

from __future__ import annotations

import numpy as np

from st_codegen.ir.arrays import ComplexArray
from st_codegen.reconcile.data.contrasts import speed_levels
from st_codegen.reconcile.fit.target import FitData
from st_codegen.rig.effects import Effect, Stage


def has_a_frequency(effect: Effect) -> bool:
    """Whether an effect peaks at a frequency; one of the structure that a user adds need not."""
    return effect.stage is Stage.STRUCTURE and effect.orders_key == "orders" and "frequency_Hz" in effect.values


def bracket(target: FitData, residual: ComplexArray, effect: Effect) -> tuple[float, float] | None:
    """The frequencies (Hz) between which the peaks of an effect's orders put it; None where they do not agree.

    residual: complex (n, K), measured less a model without the effect. An order that is loudest at one measured speed
    peaks nearer to it than to its neighbours: between the middles to both. What orders and directions have in common
    counts.
    """
    at, data = target.data.at, target.data
    level = speed_levels(at.speed_rpm)
    low, high = 0.0, np.inf
    for order in effect.orders:
        column = np.flatnonzero(data.orders == order)
        for sign in (1.0, -1.0):
            rows = target.good & (at.sign == sign)
            numbers = np.unique(level[rows])
            if not len(column) or len(numbers) < 3:
                continue
            size = [float(np.median(np.abs(residual[rows & (level == n), column[0]]))) for n in numbers]
            speed = np.array([float(np.median(at.speed_rpm[rows & (level == n)])) for n in numbers])
            middles = np.concatenate([[0.0], (speed[1:] + speed[:-1]) / 2, [np.inf]])
            hertz = middles * order / (60 * target.reduction_ratio)
            loudest = int(np.argmax(size))
            low, high = max(low, float(hertz[loudest])), min(high, float(hertz[loudest + 1]))
    return (low, high) if 0.0 < low < high < np.inf else None


def spread(frequency: float, between: tuple[float, float]) -> float:
    """RMS distance (Hz) of a frequency from those of a bracket, all taken as equally likely."""
    low, high = between
    return float(np.sqrt((high - low) ** 2 / 12 + ((high + low) / 2 - frequency) ** 2))
