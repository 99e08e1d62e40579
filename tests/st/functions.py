"""Functions that only running text needs, on single values: what `check.arithmetic` is for constants."""

from __future__ import annotations

import math
from collections.abc import Callable

from st_codegen.st.check import arithmetic as a


def truncate(value: float, lower: int, upper: int) -> int:
    """A real number to the next integer towards zero."""
    return a.to_integer(value if value - value else float(math.trunc(value)), lower, upper)


def shift_left(value: int, count: int, bits: int, mask: int) -> int:
    """SHL of a value that is not negative."""
    if not 0 <= count < bits:
        raise a.Fault(a.SHIFT, (value, count))
    return (value << count) & mask


def rotate_left(value: int, count: int, bits: int, mask: int) -> int:
    """ROL of a value that is not negative."""
    if count < 0:
        raise a.Fault(a.SHIFT, (value, count))
    turn = count % bits
    return ((value << turn) | (value >> (bits - turn))) & mask


def rotate_right(value: int, count: int, bits: int, mask: int) -> int:
    """ROR of a value that is not negative."""
    if count < 0:
        raise a.Fault(a.SHIFT, (value, count))
    return rotate_left(value, bits - count % bits, bits, mask)


def expt(x: float, y: float) -> float:
    """EXPT, also written `**`."""
    if x == 0.0 and y < 0.0 and not math.isinf(y):
        raise a.Fault(a.DIVISION, (x, y))
    if x < 0.0 and math.isfinite(x) and math.isfinite(y) and y != math.floor(y):
        raise a.Fault(a.INVALID, (x, y))
    try:
        result = math.pow(x, y)
    except OverflowError:
        raise a.Fault(a.OVERFLOW, (x, y)) from None
    if result - result and not math.isnan(x) and not math.isnan(y):
        return a.check_float(result, x, y)
    return result


def atan2(y: float, x: float) -> float:
    """ATAN2 of two LREAL values."""
    if math.isnan(x) or math.isnan(y):
        return a.check_float(math.nan, x, y)
    return math.atan2(y, x)


def single(function: Callable[..., float]) -> Callable[..., float]:
    """A function of REAL values: evaluated as LREAL, then rounded."""

    def evaluate(*arguments: float) -> float:
        return a.round_single(function(*arguments), *arguments)

    return evaluate
