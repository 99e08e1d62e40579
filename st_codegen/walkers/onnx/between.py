"""Constants that a graph computes of others, where each library rounds in its own way: limits that hold for all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import AnyArray, FloatArray, Operator, reference
from st_codegen.walkers.onnx.operands import FLOAT32, FLOAT64, BetweenOperand, ConstantOperand, Operand

#: Roundings of one function, in units of roundoff: libraries document up to 4 ulp (8 units) for vectorised versions.
FUNCTION = 12


def as_between(operand: Operand) -> BetweenOperand | None:
    """Floating-point constants with their limits; None for other operands."""
    if isinstance(operand, ConstantOperand) and operand.dtype in (FLOAT32, FLOAT64):
        numbers = operand.array.astype(np.float64)
        return BetweenOperand(numbers, numbers, operand.dtype)
    return operand if isinstance(operand, BetweenOperand) else None


def _around(ends: list[FloatArray], roundings: int, like: BetweenOperand) -> BetweenOperand:
    """Limits around numbers with so many roundings of a library, and as many here."""
    low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
    unit = float(np.finfo(like.dtype).epsneg) + 2.0**-53
    room = roundings * unit * np.maximum(np.abs(low), np.abs(high)) + roundings * float(np.finfo(like.dtype).tiny)
    if not np.all(np.maximum(np.abs(low), np.abs(high)) + room < np.finfo(like.dtype).max):
        raise UnsupportedModelError("computes a constant that is or may be infinite or NaN")
    return BetweenOperand(low - room, high + room, like.dtype)


def function_of(function: Callable[[FloatArray], FloatArray], given: BetweenOperand) -> BetweenOperand:
    """A function that only rises or only falls."""
    with np.errstate(all="ignore"):
        return _around([function(given.low), function(given.high)], FUNCTION, given)


def arithmetic_of(code: Operator, left: BetweenOperand, right: BetweenOperand) -> BetweenOperand:
    """Sums, differences, products and quotients, number by number."""
    if code is Operator.DIVIDE and np.any((right.low <= 0) & (right.high >= 0)):
        raise UnsupportedModelError("divides by a constant that may be 0; fold constants when exporting")
    with np.errstate(all="ignore"):
        pairs = [(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
        return _around([np.asarray(reference.OPERATORS[code](a, b)) for a, b in pairs], 2, left)


def sum_of(rows: BetweenOperand) -> BetweenOperand:
    """The sum of each row, in any order."""
    total = np.sum(np.maximum(np.abs(rows.low), np.abs(rows.high)), axis=1)
    size = BetweenOperand(-total, total, rows.dtype)
    room = _around([size.low, size.high], rows.shape[1], size).high - total
    return BetweenOperand(np.sum(rows.low, axis=1) - room, np.sum(rows.high, axis=1) + room, rows.dtype)


def joined_constants(parts: list[BetweenOperand], axis: int) -> BetweenOperand:
    """The parts laid end to end along an axis."""
    low, high = (np.concatenate([getattr(part, name) for part in parts], axis) for name in ("low", "high"))
    return BetweenOperand(low, high, parts[0].dtype)


def as_doubted(operand: BetweenOperand) -> tuple[AnyArray, FloatArray]:
    """Numbers of the type of the constants, and how far a library's own may lie from them."""
    numbers = ((operand.low + operand.high) / 2).astype(operand.dtype)
    wide = numbers.astype(np.float64)
    return numbers, np.maximum(operand.high - wide, wide - operand.low) * (1 + 2.0**-50)
