"""Chances of noise: tails of the distributions that sums and quotients of squares of noise have."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtrc, fdtrc

from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray

_Numbers = FloatArray | IntArray


def chi_square_tail(x: float, count: int) -> float:
    """Chance that a chi-square of `count` degrees of freedom exceeds x."""
    return float(chdtrc(count, x)) if x > 0 else 1.0


def f_tail(x: FloatArray | float, count: _Numbers | float, rest: _Numbers | float) -> FloatArray:
    """Chance that an F with these degrees of freedom exceeds x, element by element; rest may be infinite.

    It is 1 where x is not above 0, or no number.
    """
    return np.where(np.greater(x, 0.0), np.where(np.isinf(rest), chdtrc(count, x * count), fdtrc(count, rest, x)), 1.0)


def false_discoveries(p: FloatArray, rate: float) -> BoolArray:
    """Which of several tests stand at a false discovery rate (Benjamini and Hochberg)."""
    from scipy.stats import false_discovery_control

    return false_discovery_control(p) <= rate if len(p) else np.zeros(0, bool)


def digits(p: float) -> float:
    """-log10 of a chance, at most 300: for reports."""
    return min(300.0, -math.log10(max(p, 1e-300)))
