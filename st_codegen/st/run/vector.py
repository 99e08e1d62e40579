"""Operations on lanes: each takes single values or arrays with one entry for each active lane.

Single values go through `arithmetic`. Arrays go through NumPy with its divide, overflow and invalid errors raised
(`TRAPS`); where one is raised, `arithmetic` finds the first lane that caused it and says why.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.run.storage import Array, ndarray
from st_codegen.st.tree import Overflow
from st_codegen.st.types import BOOL, REAL, Elementary, Kind

Operation = Callable[..., Any]
TRAPS: dict[str, Any] = {"divide": "raise", "over": "raise", "invalid": "raise", "under": "ignore"}
_UFUNCS: dict[str, Any] = {"ADD": np.add, "SUB": np.subtract, "MUL": np.multiply, "DIV": np.divide}
_SINGLES: dict[str, Operation] = {"ADD": a.real_add, "SUB": a.real_sub, "MUL": a.real_mul, "DIV": a.real_div}


def entry(value: Any, index: int) -> Any:
    """What one lane sees of a value, as a Python value."""
    return value[index].item() if type(value) is ndarray else value


def locate(operation: Operation, candidates: Array, *operands: Any) -> None:
    """Raise the `Fault` of the first candidate lane in which an operation on single values has one."""
    for index in np.flatnonzero(candidates):
        try:
            operation(*(entry(operand, int(index)) for operand in operands))
        except Fault as fault:
            raise Fault(fault.kind, fault.operands, fault.detail, int(index)) from None


def real_operation(operator: str, type_: Elementary) -> Operation:
    """ADD, SUB, MUL or DIV of LREAL or REAL values."""
    ufunc = _UFUNCS[operator]
    single = a.single(_SINGLES[operator]) if type_ is REAL else _SINGLES[operator]

    def operation(x: Any, y: Any) -> Any:
        if type(x) is ndarray or type(y) is ndarray:
            try:
                return ufunc(x, y)
            except FloatingPointError:
                with np.errstate(all="ignore"):
                    result = ufunc(x, y)
                locate(single, ~np.isfinite(result), x, y)
                return result
        return single(x, y)

    return operation


def _check_range(result: Array, type_: Elementary, x: Any, y: Any) -> Array:
    """An intermediate result in 64 bits as one of its type. Raises `Fault` where it does not fit."""
    outside = (result > type_.upper) if result.dtype == np.uint64 else (result > type_.upper) | (result < type_.lower)
    if outside.any():
        index = int(np.flatnonzero(outside)[0])
        raise Fault(a.INTEGER_OVERFLOW, (entry(x, index), entry(y, index)), "", index)
    return result.astype(type_.dtype)


def ring_operation(operator: str, type_: Elementary, overflow: Overflow) -> Operation:
    """ADD, SUB or MUL of integers or durations."""
    ufunc = _UFUNCS[operator]
    lower, upper, dtype = type_.lower, type_.upper, type_.dtype
    is_exact = overflow is Overflow.ERROR
    # 64 bits hold every exact result of 32-bit operands; only products of unsigned ones need the unsigned type
    wide = np.uint64 if operator == "MUL" and not type_.is_signed and type_.kind is not Kind.TIME else np.int64
    python: Operation = {"ADD": int.__add__, "SUB": int.__sub__, "MUL": int.__mul__}[operator]

    def operation(x: Any, y: Any) -> Any:
        if type(x) is ndarray or type(y) is ndarray:
            if is_exact:
                return _check_range(ufunc(x, y, dtype=wide), type_, x, y)
            return ufunc(_as(x, dtype), _as(y, dtype))
        result = python(x, y)
        if lower <= result <= upper:
            return result
        return a.exact(result, lower, upper, x, y) if is_exact else a.wrap(result, lower, upper)

    return operation


def _as(value: Any, dtype: Any) -> Any:
    """An operand in the type of the result: the factor of a duration comes as DINT."""
    if type(value) is ndarray:
        return value if value.dtype == dtype else value.astype(dtype)
    return value if dtype.kind == "i" or value >= 0 else int(np.int64(value).astype(dtype))


def negation(type_: Elementary, overflow: Overflow) -> Operation:
    """The sign of a number changed; of a real number only the sign bit."""
    if type_.is_real:
        return lambda x: -x
    subtract = ring_operation("SUB", type_, overflow)
    return lambda x: subtract(0, x)


def integer_division(operator: str, type_: Elementary) -> Operation:
    """DIV (cuts towards zero) or MOD (sign of the dividend) of integers; the divisor of a duration is DINT."""
    upper, lower, dtype = type_.upper, type_.lower, type_.dtype
    single = a.integer_div if operator == "DIV" else a.integer_mod

    def one(x: int, y: int) -> int:
        if y < lower:
            raise Fault(a.INTEGER_OVERFLOW, (x, y))
        return single(x, y, upper)

    def operation(x: Any, y: Any) -> Any:
        if type(x) is not ndarray and type(y) is not ndarray:
            return one(x, y)
        dividend = np.asarray(x, dtype)
        bad = np.asarray(y == 0)
        bad = bad | ((np.asarray(y) == -1) & (dividend == lower) if type_.is_signed else np.asarray(y < 0))
        if bad.any():
            locate(one, np.broadcast_to(bad, np.broadcast(dividend, y).shape), x, y)
        divisor = np.asarray(y).astype(dtype)
        rest = np.fmod(dividend, divisor)
        return rest if operator == "MOD" else (dividend - rest) // divisor

    return operation


BITWISE: dict[str, Operation] = {"AND": lambda x, y: x & y, "OR": lambda x, y: x | y, "XOR": lambda x, y: x ^ y}


def inversion(type_: Elementary) -> Operation:
    """NOT."""
    lower, upper = type_.lower if type_ is not BOOL else 0, type_.upper if type_ is not BOOL else 0

    def operation(x: Any) -> Any:
        if type(x) is ndarray:
            return ~x
        return not x if type_ is BOOL else a.wrap(~x, lower, upper)

    return operation


_COMPARISONS: dict[str, Operation] = {
    "EQ": lambda x, y: x == y,
    "NE": lambda x, y: x != y,
    "LT": lambda x, y: x < y,
    "LE": lambda x, y: x <= y,
    "GT": lambda x, y: x > y,
    "GE": lambda x, y: x >= y,
}


def comparison(operator: str, check_left: bool, check_right: bool) -> Operation:
    """A comparison; the flags say which side is a real number that could be a NaN."""
    compare = _COMPARISONS[operator]
    if not (check_left or check_right):
        return compare

    def operation(x: Any, y: Any) -> Any:
        if check_left:
            check_ordered(x, y, x)
        if check_right:
            check_ordered(x, y, y)
        return compare(x, y)

    return operation


def check_ordered(x: Any, y: Any, checked: Any) -> None:
    """Raise `Fault` where `checked`, one side of a comparison, is a NaN."""
    if type(checked) is ndarray:
        # The maximum of values with a NaN among them is a NaN
        largest = checked.max()
        if np.isnan(largest):
            index = int(np.flatnonzero(np.isnan(checked))[0])
            raise Fault(a.NAN_COMPARED, (entry(x, index), entry(y, index)), "", index)
    elif math.isnan(checked):
        raise Fault(a.NAN_COMPARED, (entry(x, 0), entry(y, 0)))


def and_then(left: Any, right: Any) -> Any:
    """AND_THEN; `right` has entries where `left` holds."""
    if type(left) is not ndarray:
        return right if left else False
    if not left.any():
        return False
    result = left.copy()
    result[left] = right
    return result


def or_else(left: Any, right: Any) -> Any:
    """OR_ELSE; `right` has entries where `left` does not hold."""
    if type(left) is not ndarray:
        return True if left else right
    if left.all():
        return True
    result = left.copy()
    result[~left] = right
    return result


def conversion(source: Elementary, target: Elementary) -> Operation:
    """An explicit or implicit conversion."""
    from st_codegen.st.check.constants import convert

    dtype, length = target.dtype, target.bits
    if target.kind is Kind.STRING:
        return _cut(length)

    def array_conversion(x: Array) -> Array:
        if target is BOOL:
            return np.asarray(x != 0)
        if not source.is_real:
            return x.astype(dtype)
        if target.is_real and target is not REAL:
            return x.astype(dtype)
        return _from_real(x, source, target)

    def operation(x: Any) -> Any:
        if type(x) is ndarray:
            return array_conversion(x)
        return convert(x, source, target)

    return operation


def _from_real(x: Array, source: Elementary, target: Elementary) -> Array:
    """LREAL to REAL, or a real number to the nearest integer."""
    from st_codegen.st.check.constants import convert

    wide = x.astype(np.float64)
    with np.errstate(all="ignore"):
        if target is REAL:
            result: Array = wide.astype(np.float32)
            bad = ~np.isfinite(result)
        else:
            rounded = np.rint(wide)
            # The bounds are powers of two, or next to them, and exact as LREAL up to 32 bits; above, < is needed
            bad = ~((rounded >= float(target.lower)) & (rounded < float(target.upper + 1)))
            result = np.where(bad, 0.0, rounded).astype(target.dtype)
    if bad.any():
        locate(lambda v: convert(v, source, target), bad, x)
    return result


@cache
def _cut(length: int) -> Operation:
    """A string cut to the length of a variable."""

    def operation(x: Any) -> Any:
        if type(x) is ndarray:
            return np.array([text[:length] for text in x], dtype=object)
        return x[:length]

    return operation
