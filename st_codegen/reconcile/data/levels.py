"""Levels of the conditions: which runs count as run at the same speed, torque or temperature."""

from __future__ import annotations

import numpy as np

from st_codegen.ir.arrays import FloatArray, IntArray


def in_steps(values: FloatArray) -> FloatArray:
    """Values in steps of their grid (or a twentieth of their range)."""
    levels = np.unique(values)
    if len(levels) < 2:
        return np.zeros(len(values))
    step = max(float(np.median(np.diff(levels))), float(np.ptp(levels)) / 20)
    found: FloatArray = values / step
    return found


def speed_levels(speed_rpm: FloatArray) -> IntArray:
    """The speed level of each run: the grid's, or 12 groups of equal size where speeds do not repeat."""
    levels, index = np.unique(speed_rpm, return_inverse=True)
    if len(levels) <= 40:
        return index.astype(np.int64)
    cuts = np.quantile(speed_rpm, np.linspace(0, 1, 13)[1:-1])
    return np.searchsorted(cuts, speed_rpm).astype(np.int64)


def levels_of(values: FloatArray) -> IntArray:
    """The level of each value: those that there are, or eight groups of equal size where there are more."""
    levels, index = np.unique(values, return_inverse=True)
    if len(levels) <= 8:
        return index.astype(np.int64)
    cuts = np.quantile(values, np.linspace(0, 1, 9)[1:-1])
    return np.searchsorted(cuts, values, side="right").astype(np.int64)
