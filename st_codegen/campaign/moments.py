"""Sums over samples at any angles: sum over j of w_j * exp(-i*m*theta_j) for all m from 0 to M at once.

A sum over samples that are not equidistant has no plain FFT. Each angle is the nearest point of a fine grid plus a
small rest d, and exp(-i*m*d) is its Taylor series: the sum is a few FFTs of the binned w_j*d_j^p. The grid is so fine
that m*d stays below 0.8 and some fifteen terms reach the last bit; the work hardly depends on M.
"""

from __future__ import annotations

import math

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray

#: grid points a period of the highest order, at least
_POINTS_A_PERIOD = 4
#: samples in one step, so that the work stays in the cache
_CHUNK = 16384


def moments(theta_rad: FloatArray, weights: FloatArray, highest: int, *, off_rad: float | None = None) -> ComplexArray:
    """The sums for m = 0..highest, complex128 (rows, highest + 1), of weights (rows, n) at theta_rad (n,), float64.

    off_rad: by how much the angles differ at most from even steps of a turn, of which there are a power of two and no
    more than `4 * highest`, where they hardly do: fewer terms are enough then.
    """
    size = 1 << max(6, (_POINTS_A_PERIOD * highest - 1).bit_length())
    terms = _terms(highest * min(math.pi / size, math.inf if off_rad is None else off_rad))
    binned = np.zeros((len(weights), terms, size))
    for start in range(0, len(theta_rad), _CHUNK):
        part = slice(start, start + _CHUNK)
        position = theta_rad[part] * (size / (2.0 * math.pi))
        nearest = np.rint(position)
        rest = (position - nearest) * (2.0 * math.pi / size)
        index = nearest.astype(np.intp) & (size - 1)
        for row, weight in enumerate(weights):
            value = weight[part]
            for power in range(terms):
                binned[row, power] += np.bincount(index, value, size)
                value = value * rest
    m = np.arange(highest + 1)
    sums = np.zeros((len(weights), highest + 1), np.complex128)
    # Horner's scheme over the terms (-i*m)^p/p!
    for power in reversed(range(terms)):
        sums *= -1j * m / (power + 1)
        sums += np.fft.rfft(binned[:, power], axis=1)[:, : highest + 1]
    return sums


def _terms(largest: float) -> int:
    """How many terms of exp(i*x) reach 1e-16 for abs(x) <= largest."""
    terms, term = 1, largest
    while term > 1e-16:
        terms += 1
        term *= largest / terms
    return terms
