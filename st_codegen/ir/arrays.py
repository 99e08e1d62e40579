"""Types of arrays and the order of floating-point numbers, for the whole package."""

from __future__ import annotations

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


def next_single(values: FloatArray, *, up: bool, strict: bool = False) -> Float32Array:
    """The nearest float32 that is not below (`up`) or not above each number; with `strict` it is not the number either.

    It is infinite where there is none.
    """
    end = np.float32(np.inf if up else -np.inf)
    with np.errstate(over="ignore"):
        single = np.asarray(values, np.float64).astype(np.float32)
        wrong = (single < values if up else single > values) | (strict & (single == values))
        return np.where(wrong, np.nextafter(single, end), single)
