"""Intervals of floating point numbers, and operations on numbers and on intervals as a controller rounds them.

Rounding to nearest is monotone, so the rounded results of the ends enclose the rounded results in between, and nothing
has to be widened. Only EXP, LN, SQRT, SIN, COS and ATAN are widened, by what they may err (`FUNCTION_ERROR`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import OPERATIONS
from st_codegen.st.types import Elementary, Type

#: The largest relative error of EXP, LN, SQRT, SIN, COS and ATAN that is assumed of a controller.
FUNCTION_ERROR = 1e-14

LARGEST = float(np.finfo(np.float64).max)
_SINGLE = 3.4028234663852886e38

#: An interval, and whether the value may be NaN; low > high: no number.
Interval = tuple[float, float, bool]

WHOLE: Interval = (-math.inf, math.inf, True)


def hull(one: Interval, other: Interval) -> Interval:
    """The smallest interval that holds two."""
    return min(one[0], other[0]), max(one[1], other[1]), one[2] or other[2]


def cut(one: Interval, other: Interval) -> Interval:
    """The interval of what lies in both of two; NaN stays possible where it is in both."""
    return max(one[0], other[0]), min(one[1], other[1]), one[2] and other[2]


def rounds(bounds: Sequence[Any], counter: Type) -> range:
    """The numbers that the counter of a loop (start, stop, step) has. Raises NotProvedError where it never ends."""
    start, stop, step = map(int, bounds)
    found = range(start, stop + (1 if step > 0 else -1), step)
    last = start + len(found) * step
    if not isinstance(counter, Elementary) or not counter.lower <= last <= counter.upper:
        raise NotProvedError(f"a loop whose counter, of type {counter}, never passes {stop}")
    return found


def compute(operation: str, *values: float) -> float:
    """One operation on numbers, rounded to nearest. Raises NotProvedError where it would stop a controller."""
    if operation in FUNCTIONS or operation not in OPERATIONS:
        raise NotProvedError(f"{operation} of a constant")
    with np.errstate(all="ignore"):
        result = float(OPERATIONS[operation](*map(np.float64, values)))
    if not math.isfinite(result) and all(map(math.isfinite, values)):
        raise NotProvedError(f"the operation {operation} overflows")
    return result


def ends(operation: str, given: list[Interval]) -> tuple[float, float]:  # noqa: PLR0911 - one return an operation
    """The ends of the interval of a result. Raises NotProvedError where a conversion to REAL may overflow."""
    (a, b, _), (c, d, _) = given[0], given[-1]
    if operation == "neg":
        return -b, -a
    if operation == "abs":
        return (0.0 if a <= 0 <= b else min(abs(a), abs(b))), max(abs(a), abs(b))
    if operation in ("min", "max"):
        choose = min if operation == "min" else max
        return choose(a, c), choose(b, d)
    if operation == "single":
        if max(abs(a), abs(b)) > _SINGLE:
            raise NotProvedError("a conversion to REAL may overflow")
        return float(np.float32(a)), float(np.float32(b))
    if operation == "add":
        return a + c, b + d
    if operation == "sub":
        return a - d, b - c
    if operation == "mul":
        products = [x * y if x and y else 0.0 for x in (a, b) for y in (c, d)]
        return min(products), max(products)
    raise NotProvedError(f"{operation} is not followed")


def _widened(low: float, high: float) -> tuple[float, float]:
    return low - abs(low) * FUNCTION_ERROR - 5e-324, high + abs(high) * FUNCTION_ERROR + 5e-324


def _exp(low: float, high: float) -> tuple[float, float]:
    if high > 709.0:
        raise NotProvedError("an exponential may overflow")
    found = _widened(math.exp(low) if low > -745 else 0.0, math.exp(high) if high > -745 else 0.0)
    return max(found[0], 0.0), found[1]


def _ln(low: float, high: float) -> tuple[float, float]:
    if low <= 0:
        raise NotProvedError("a logarithm of what may not be above zero")
    return _widened(math.log(low), math.log(high))


def _sqrt(low: float, high: float) -> tuple[float, float]:
    if low < 0:
        raise NotProvedError("a root of what may be negative")
    found = _widened(math.sqrt(low), math.sqrt(high))
    return max(found[0], 0.0), found[1]


def _wave(low: float, high: float) -> tuple[float, float]:
    if not (math.isfinite(low) and math.isfinite(high)):
        raise NotProvedError("SIN or COS of what may not be finite")
    return _widened(-1.0, 1.0)


#: Functions of one number, on the ends of an interval.
FUNCTIONS: dict[str, Callable[[float, float], tuple[float, float]]] = {
    "exp": _exp,
    "ln": _ln,
    "sqrt": _sqrt,
    "sin": _wave,
    "cos": _wave,
    "atan": lambda low, high: _widened(math.atan(low), math.atan(high)),
}


def _truncated(given: Interval) -> tuple[float, float]:
    if not (math.isfinite(given[0]) and math.isfinite(given[1])):
        raise NotProvedError("TRUNC of what may not be finite")
    return float(math.trunc(given[0])), float(math.trunc(given[1]))


def _remainder(one: Interval, other: Interval) -> tuple[float, float]:
    if other[0] != other[1] or other[0] <= 0 or one[0] < 0:
        raise NotProvedError("MOD of what may be negative, or by what is no constant")
    if one[0] == one[1]:
        rest = one[0] % other[0]
        return rest, rest
    return 0.0, min(other[0] - 1, one[1])


INTEGER: dict[str, Callable[..., tuple[float, float]]] = {
    "iadd": lambda one, other: (one[0] + other[0], one[1] + other[1]),
    "isub": lambda one, other: (one[0] - other[1], one[1] - other[0]),
    "imul": lambda one, other: (
        min(x * y for x in one[:2] for y in other[:2]),
        max(x * y for x in one[:2] for y in other[:2]),
    ),
    "imod": _remainder,
    "itrunc": _truncated,
    "ireal": lambda one: (one[0], one[1]),
}
