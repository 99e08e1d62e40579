"""The standard functions on lanes."""

from __future__ import annotations

from typing import Any

import numpy as np

from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.run.storage import Array, ndarray
from st_codegen.st.run.vector import Operation, check_ordered, entry, locate
from st_codegen.st.types import REAL, Elementary

# For each function NumPy's name for it and the arguments at which it cannot fail: all that are in lower..upper
_DOMAINS: dict[str, tuple[Any, float, float]] = {
    "SQRT": (np.sqrt, 0.0, np.inf),
    "EXP": (np.exp, -np.inf, a.EXP_LIMIT),
    "LN": (np.log, np.nextafter(0.0, 1.0), np.inf),
    "LOG": (np.log10, np.nextafter(0.0, 1.0), np.inf),
    "SIN": (np.sin, -np.finfo(float).max, np.finfo(float).max),
    "COS": (np.cos, -np.finfo(float).max, np.finfo(float).max),
    "TAN": (np.tan, -np.finfo(float).max, np.finfo(float).max),
    "ASIN": (np.arcsin, -1.0, 1.0),
    "ACOS": (np.arccos, -1.0, 1.0),
    "ATAN": (np.arctan, -np.inf, np.inf),
}


def standard_function(name: str, type_: Elementary, arity: int) -> Operation:  # noqa: PLR0911 - one return a case
    """The operation of a standard function whose result has a given type."""
    if name in _DOMAINS:
        return _real_function(name, type_)
    match name:
        case "ABS":
            return _absolute(type_)
        case "EXPT" | "ATAN2":
            return _binary_function(name, type_)
        case "TRUNC":
            return _truncation(type_)
        case "MIN" | "MAX":
            return _extreme(name, type_)
        case "LIMIT":
            return _limit(type_)
        case "SEL":
            return lambda g, in0, in1: _choose(g, (in0, in1), type_)
        case "MUX":
            return lambda k, *choices: _choose(_selector(k, arity - 1), choices, type_)
        case _:
            return _shift(name, type_)


def _real_function(name: str, type_: Elementary) -> Operation:
    ufunc, lower, upper = _DOMAINS[name]
    single = a.single(a.FUNCTIONS[name]) if type_ is REAL else a.FUNCTIONS[name]

    def operation(x: Any) -> Any:
        if type(x) is not ndarray:
            return single(x)
        wide = x if type_ is not REAL else x.astype(np.float64)
        if wide.min() >= lower and wide.max() <= upper:
            result = ufunc(wide)
        else:
            # A NaN makes both comparisons false: it may pass, unless it is a signalling one
            locate(single, ~((wide >= lower) & (wide <= upper)), x)
            with np.errstate(all="ignore"):
                result = ufunc(wide)
        return result if type_ is not REAL else _rounded(result, single, x)

    return operation


def _rounded(result: Array, single: Operation, *operands: Any) -> Array:
    with np.errstate(all="ignore"):
        narrow = result.astype(np.float32)
    bad = ~np.isfinite(narrow)
    if bad.any():
        locate(single, bad, *operands)
    return narrow


def _binary_function(name: str, type_: Elementary) -> Operation:
    ufunc, function = (np.power, a.expt) if name == "EXPT" else (np.arctan2, a.atan2)
    single = a.single(function) if type_ is REAL else function

    def operation(x: Any, y: Any) -> Any:
        if type(x) is not ndarray and type(y) is not ndarray:
            return single(x, y)
        with np.errstate(all="ignore"):
            result = np.asarray(ufunc(_wide(x), _wide(y)))
            if type_ is REAL:
                result = result.astype(np.float32)
        bad = ~np.isfinite(result)
        if bad.any():
            locate(single, bad, x, y)
        return result

    return operation


def _wide(x: Any) -> Any:
    return x.astype(np.float64) if type(x) is ndarray else x


def _absolute(type_: Elementary) -> Operation:
    if type_.is_real:
        return lambda x: np.abs(x) if type(x) is ndarray else abs(x)
    lower = type_.lower

    def operation(x: Any) -> Any:
        if type_.is_signed and np.any(x == lower):
            index = int(np.flatnonzero(np.atleast_1d(x == lower))[0])
            raise Fault(a.INTEGER_OVERFLOW, (lower,), "", index)
        return np.abs(x) if type(x) is ndarray else abs(x)

    return operation


def _truncation(type_: Elementary) -> Operation:
    lower, upper = type_.lower, type_.upper

    def operation(x: Any) -> Any:
        if type(x) is not ndarray:
            return a.truncate(x, lower, upper)
        with np.errstate(all="ignore"):
            cut = np.trunc(x.astype(np.float64))
            bad = ~((cut >= lower) & (cut <= upper))
            if bad.any():
                locate(lambda v: a.truncate(v, lower, upper), bad, x)
            return cut.astype(type_.dtype)

    return operation


def _extreme(name: str, type_: Elementary) -> Operation:
    is_real = type_.is_real

    def pair(x: Any, y: Any) -> Any:
        if is_real:
            check_ordered(x, y, x)
            check_ordered(x, y, y)
        return _choose(y < x if name == "MIN" else y > x, (x, y), type_)

    def operation(first: Any, *others: Any) -> Any:
        result = first
        for other in others:
            result = pair(result, other)
        return result

    return operation


def _limit(type_: Elementary) -> Operation:
    smaller, larger = _extreme("MIN", type_), _extreme("MAX", type_)
    return lambda low, value, high: smaller(larger(value, low), high)


def _selector(k: Any, count: int) -> Any:
    if type(k) is not ndarray:
        if not 0 <= k < count:
            raise Fault(a.INDEX, (k,), f"MUX has no input {k}")
    elif (bad := (k < 0) | (k >= count)).any():
        index = int(np.flatnonzero(bad)[0])
        raise Fault(a.INDEX, (entry(k, index),), f"MUX has no input {k[index]}", index)
    return k


def _choose(k: Any, choices: tuple[Any, ...], type_: Elementary) -> Any:
    """The choice of each lane; a single one belongs to whoever it came from."""
    if type(k) is not ndarray:
        return choices[k]
    result = np.empty(k.size, type_.dtype)
    result[...] = choices[0]
    for number, choice in enumerate(choices[1:], start=1):
        where = k == number
        result[where] = choice[where] if type(choice) is ndarray else choice
    return result


_SHIFTS: dict[str, Operation] = {
    "SHL": a.shift_left,
    "SHR": a.shift_right,
    "ROL": a.rotate_left,
    "ROR": a.rotate_right,
}


def _shift(name: str, type_: Elementary) -> Operation:
    bits, dtype = type_.bits, type_.dtype
    mask = (1 << bits) - 1
    unsigned = np.dtype(f"u{bits // 8}")
    single = _SHIFTS[name]
    is_arithmetic = name == "SHR" and type_.is_signed

    def one(x: int, n: int) -> int:
        result = single(x if is_arithmetic else x & mask, n, bits, mask)
        return a.wrap(result, type_.lower, type_.upper)

    def operation(x: Any, n: Any) -> Any:
        if type(x) is not ndarray and type(n) is not ndarray:
            return one(x, n)
        bad = (n < 0) if name in ("ROL", "ROR") else (n < 0) | (n >= bits)
        if np.any(bad):
            locate(one, np.broadcast_to(bad, np.broadcast(x, n).shape), x, n)
        count = np.asarray(n).astype(np.uint64) % np.uint64(bits)
        value = np.asarray(x, dtype)
        if is_arithmetic:
            return value >> count.astype(dtype)
        wide, turn = value.view(unsigned), count.astype(unsigned)
        back = ((np.uint64(bits) - count) % np.uint64(bits)).astype(unsigned)
        match name:
            case "SHL":
                result = wide << turn
            case "SHR":
                result = wide >> turn
            case "ROL":
                result = np.where(turn == 0, wide, (wide << turn) | (wide >> back))
            case _:
                result = np.where(turn == 0, wide, (wide >> turn) | (wide << back))
        return result.astype(unsigned).view(dtype)

    return operation
