"""Types of arrays and the order of floating-point numbers, for the whole package."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
BoolArray = NDArray[np.bool_]
#: Numbers of any type, such as those that a library hands over.
AnyArray = NDArray[Any]


def to_order(x: AnyArray) -> IntArray:
    """Integers in the order of float64 or float32 numbers, one apart for neighbours; both zeros are 0."""
    x = np.ascontiguousarray(x)
    bits = x.view(f"i{x.itemsize}").astype(np.int64)
    return np.where(bits < 0, np.int64(-(2 ** (8 * x.itemsize - 1))) - bits, bits)


def from_order(key: IntArray) -> FloatArray:
    """The float64 numbers of the integers that `to_order` gives."""
    return to_order(key.view(np.float64)).view(np.float64)


def bisected(decide: Callable[[IntArray], BoolArray], low: IntArray, high: IntArray) -> IntArray:
    """The last integer from `low` towards `high`, of each pair, that is decided as `low` is.

    That of each pair changes over once between its ends.
    """
    first = decide(low)
    while np.any(((middle := (low & high) + ((low ^ high) >> 1)) != low) & (middle != high)):  # low + high may overflow
        same = decide(middle) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return low


def next_single(values: FloatArray, *, up: bool, strict: bool = False) -> Float32Array:
    """The nearest float32 that is not below (`up`) or not above each number; with `strict` it is not the number either.

    It is infinite where there is none.
    """
    end = np.float32(np.inf if up else -np.inf)
    with np.errstate(over="ignore"):
        single = np.asarray(values, np.float64).astype(np.float32)
        wrong = (single < values if up else single > values) | (strict & (single == values))
        return np.where(wrong, np.nextafter(single, end), single)
