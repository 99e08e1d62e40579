"""Chances of noise: tails of the distributions that sums and quotients of squares of noise have.

SciPy is imported where it is needed: it takes a tenth of a second.
"""

from __future__ import annotations

import math

import numpy as np

from st_codegen.ir.arrays import BoolArray, FloatArray


def chi_square_tail(x: float, count: int) -> float:
    """Chance that a chi-square of `count` degrees of freedom exceeds x."""
    from scipy.special import chdtrc

    return float(chdtrc(count, x)) if x > 0 else 1.0


def normal_tail(x: FloatArray) -> FloatArray:
    """Chance that a normal number exceeds x, element by element."""
    from scipy.special import ndtr

    return ndtr(-x)


def f_tail(x: float, count: int, rest: float) -> float:
    """Chance that an F with these degrees of freedom exceeds x; rest may be infinite."""
    if rest == np.inf:
        return chi_square_tail(x * count, count)
    from scipy.special import fdtrc

    return float(fdtrc(count, rest, x)) if x > 0 else 1.0


def false_discoveries(p: FloatArray, rate: float) -> BoolArray:
    """Which of several tests stand at a false discovery rate (Benjamini and Hochberg)."""
    from scipy.stats import false_discovery_control

    return false_discovery_control(p) <= rate if len(p) else np.zeros(0, bool)


def digits(p: float) -> float:
    """-log10 of a chance, at most 300: for reports."""
    return min(300.0, -math.log10(max(p, 1e-300)))
