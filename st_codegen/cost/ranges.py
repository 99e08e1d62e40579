"""What integers can be: intervals, followed through assignments as far as bounds of loops need it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from st_codegen.st import tree as t
from st_codegen.st.types import Elementary, Kind, Type


class Interval(NamedTuple):
    """The integers from `low` to `high`, both included."""

    low: int
    high: int

    def hull(self, other: Interval) -> Interval:
        """The smallest interval around both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))


def _products(a: Interval, b: Interval) -> Interval:
    values = [x * y for x in a for y in b]
    return Interval(min(values), max(values))


def _quotients(a: Interval, b: Interval) -> Interval | None:
    """Division that drops the rest, as IEC 61131-3 has it."""
    if b.low <= 0 <= b.high:
        return None
    values = [int(abs(x) // abs(y)) * (1 if (x < 0) == (y < 0) else -1) for x in a for y in b]
    return Interval(min(values), max(values))


def is_counted(type_: Type) -> bool:
    """Whether intervals are kept for a type: integers and bit strings."""
    return isinstance(type_, Elementary) and type_.kind in (Kind.SIGNED, Kind.UNSIGNED, Kind.BITS)


class Ranges:
    """The interval of each variable of a unit that has a known one."""

    def __init__(self, known: dict[t.Variable, Interval] | None = None) -> None:
        self._known = known or {}

    def copy(self) -> Ranges:
        """The intervals, copied for a branch that then goes its own way."""
        return Ranges(dict(self._known))

    def set(self, variable: t.Variable, interval: Interval | None) -> None:
        """Take note of what a variable can be after an assignment; None when nothing is known."""
        if interval is None:
            self._known.pop(variable, None)
        else:
            self._known[variable] = interval

    def forget(self, variables: Iterable[t.Variable] | None = None) -> None:
        """Forget what is known of variables that may have been assigned; None stands for all of them."""
        if variables is None:
            self._known.clear()
            return
        for variable in variables:
            self._known.pop(variable, None)

    def keep_common(self, others: Iterable[Ranges]) -> None:
        """Keep only what is known behind this branch and all the others."""
        for other in others:
            for variable in list(self._known):
                found = other._known.get(variable)
                self.set(variable, None if found is None else self._known[variable].hull(found))

    def of(self, node: t.Expression) -> Interval | None:
        """The interval of an expression, None when nothing is known."""
        if not is_counted(node.type):
            return None
        found = self._of(node)
        if found is None or not isinstance(node.type, Elementary):
            return None
        is_inside = node.type.lower <= found.low and found.high <= node.type.upper
        return found if is_inside else None

    def _of(self, node: t.Expression) -> Interval | None:  # noqa: PLR0911 - one return a case
        match node:
            case t.Constant(value=value):
                return Interval(int(value), int(value)) if isinstance(value, int) else None
            case t.VariableRef(variable=variable):
                if variable.is_constant and isinstance(variable.initial, int):
                    return Interval(variable.initial, variable.initial)
                return self._known.get(variable)
            case t.ElementRef():
                return _of_table(node)
            case t.Unary(operator="NEG", operand=operand):
                inner = self.of(operand)
                return None if inner is None else Interval(-inner.high, -inner.low)
            case t.Conversion(operand=operand):
                return self.of(operand)
            case t.Binary():
                return self._of_binary(node)
            case t.StandardCall():
                return self._of_call(node)
            case _:
                return None

    def _of_binary(self, node: t.Binary) -> Interval | None:  # noqa: PLR0911 - one return a case
        a, b = self.of(node.left), self.of(node.right)
        if node.operator == "MOD" and b is not None and b.low > 0:
            return Interval(0 if a is not None and a.low >= 0 else -b.high + 1, b.high - 1)
        if a is None or b is None:
            return None
        match node.operator:
            case "ADD":
                return Interval(a.low + b.low, a.high + b.high)
            case "SUB":
                return Interval(a.low - b.high, a.high - b.low)
            case "MUL":
                return _products(a, b)
            case "DIV":
                return _quotients(a, b)
            case _:
                return None

    def _of_call(self, node: t.StandardCall) -> Interval | None:
        """MIN, MAX and LIMIT bound their result even where only one argument is known."""
        known = [self.of(argument) for argument in node.arguments]
        type_ = node.type
        if not isinstance(type_, Elementary) or node.function not in ("MIN", "MAX", "LIMIT", "SEL", "ABS"):
            return None
        whole = Interval(type_.lower, type_.upper)
        lows = [(interval or whole).low for interval in known]
        highs = [(interval or whole).high for interval in known]
        if node.function == "MIN":
            return Interval(min(lows), min(highs))
        if node.function == "MAX":
            return Interval(max(lows), max(highs))
        if node.function == "LIMIT":
            return Interval(max(lows[0], min(lows[1], highs[2])), min(highs[2], max(highs[1], lows[0])))
        if node.function == "SEL":
            return Interval(min(lows[1:]), max(highs[1:]))
        return None if known[0] is None else Interval(0, max(abs(known[0].low), abs(known[0].high)))


def _of_table(node: t.ElementRef) -> Interval | None:
    """The smallest and the largest element of a constant table."""
    base = node.base
    if isinstance(base, t.VariableRef) and base.variable.is_constant and isinstance(base.variable.initial, np.ndarray):
        table = base.variable.initial
        if table.dtype.kind in "iu" and table.size:
            return Interval(int(table.min()), int(table.max()))
    return None
