"""How often a loop goes round, at most."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from st_codegen.cost.ranges import Interval, Ranges
from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.types import ArrayType


def of_for(loop: t.For, ranges: Ranges) -> int | None:
    """Rounds of a FOR, exact for constant bounds; None when its bounds are not known."""
    start, stop, step = (ranges.of(node) for node in (loop.start, loop.stop, loop.step))
    if start is None or stop is None or step is None or step.low <= 0 <= step.high:
        return None
    if step == (1, 1) and (longest := _longest_row(loop.start, loop.stop)) is not None:
        return max(longest, 0)
    if step.low > 0:
        return max((stop.high - start.low) // step.low + 1, 0)
    return max((start.high - stop.low) // -step.high + 1, 0)


def _longest_row(start: t.Expression, stop: t.Expression) -> int | None:
    """Rounds of `FOR i := FIRST[k] TO FIRST[k + 1] - 1`: rows of a table, of which another table says where they start.

    The largest difference at one k, not of the largest and the smallest number of the table.
    """
    first, last = _entry(start), _entry(stop)
    if first is None or last is None or first.at != last.at:
        return None
    low = max(-first.distance, -last.distance)
    high = min(len(first.table) - first.distance, len(last.table) - last.distance)
    if high <= low:
        return None
    starts = first.table[low + first.distance : high + first.distance]
    stops = last.table[low + last.distance : high + last.distance]
    return int(np.max(stops.astype(np.int64) - starts.astype(np.int64))) + last.added - first.added + 1


class _Entry(NamedTuple):
    """`table[at + distance] + added`, the table counted from 0."""

    table: NDArray[np.generic]
    at: t.Expression
    distance: int
    added: int


def _entry(node: t.Expression) -> _Entry | None:
    node, added = _split(node)
    if not isinstance(node, t.ElementRef) or not isinstance(node.base, t.VariableRef):
        return None
    type_, table = node.base.type, node.base.variable.initial
    if not (node.base.variable.is_constant and isinstance(type_, ArrayType) and isinstance(table, np.ndarray)):
        return None
    if len(type_.bounds) != 1 or table.dtype.kind not in "iu":
        return None
    index, distance = _split(node.indices[0])
    return _Entry(table, index, distance - type_.bounds[0][0], added)


def _split(node: t.Expression) -> tuple[t.Expression, int]:
    """Splits a sum into an expression and a constant number, which is 0 for anything but a sum."""
    match node:
        case t.Binary(operator="ADD", left=left, right=t.Constant(value=int() as number)):
            return left, number
        case t.Binary(operator="SUB", left=left, right=t.Constant(value=int() as number)):
            return left, -number
        case _:
            return node, 0


def of_condition(
    condition: t.Expression, body: tuple[t.Statement, ...], ranges: Ranges, *, is_negated: bool
) -> int | None:
    """Rounds of a loop that goes on while a condition holds (REPEAT: until, `is_negated`), as far as can be derived.

    Two shapes are understood, each also as one part of an AND: a variable that every round moves by a constant towards
    a limit, and a search that halves `high - low` in every round.
    """
    if _writes_unseen(body):
        return None
    found = [
        rounds
        for part in _parts(condition, is_negated)
        for rounds in (_counting(part, body, ranges), _halving(part, body, ranges))
        if rounds is not None
    ]
    return min(found, default=None)


def _writes_unseen(body: tuple[t.Statement, ...]) -> bool:
    """Whether a body may assign variables where it does not show: in its own methods, or through pointers."""
    return any(isinstance(call.receiver, t.ThisRef) for call in walk.calls(body)) or any(
        isinstance(part, t.PointerTarget) for place in walk.assigned_places(body) for part in walk.expressions(place)
    )


_NEGATED = {"LT": "GE", "GE": "LT", "GT": "LE", "LE": "GT", "EQ": "NE", "NE": "EQ"}
_MIRRORED = {"LT": "GT", "GT": "LT", "LE": "GE", "GE": "LE"}

#: operator, left, right of a comparison that holds in every round but the first of REPEAT
_Part = tuple[str, t.Expression, t.Expression]


def _parts(condition: t.Expression, is_negated: bool) -> list[_Part]:
    """Comparisons that all must hold for another round."""
    match condition:
        case t.Unary(operator="NOT", operand=operand):
            return _parts(operand, not is_negated)
        case t.Compare():
            operator = _NEGATED[condition.operator] if is_negated else condition.operator
            return [(operator, condition.left, condition.right)]
        case t.Binary(operator=operator) | t.ShortCircuit(operator=operator):
            joins = ("OR", "OR_ELSE") if is_negated else ("AND", "AND_THEN")
            if operator in joins:
                return _parts(condition.left, is_negated) + _parts(condition.right, is_negated)
            return []
        case _:
            return []


def _counting(part: _Part, body: tuple[t.Statement, ...], ranges: Ranges) -> int | None:
    """`n < limit` with one `n := n + constant` in every round, or downwards."""
    for operator, counter, limit in (part, (_MIRRORED.get(part[0], ""), part[2], part[1])):
        if not isinstance(counter, t.VariableRef) or operator not in _MIRRORED:
            continue
        step = _step(counter.variable, body)
        start, end = ranges.of(counter), _fixed(limit, body, ranges)
        if step is None or start is None or end is None:
            continue
        if step > 0 and operator in ("LT", "LE"):
            distance = end.high - start.low + (1 if operator == "LE" else 0)
        elif step < 0 and operator in ("GT", "GE"):
            distance = start.high - end.low + (1 if operator == "GE" else 0)
        else:
            continue
        return max(-(-distance // abs(step)), 0)
    return None


def _fixed(node: t.Expression, body: tuple[t.Statement, ...], ranges: Ranges) -> Interval | None:
    """The interval of an expression whose variables the body leaves alone."""
    return None if walk.variables(node) & walk.assigned_variables(body) else ranges.of(node)


def _step(variable: t.Variable, body: tuple[t.Statement, ...]) -> int | None:
    """What every round adds to a variable; None when that differs. CONTINUE could skip it."""
    if any(isinstance(statement, t.Continue) for statement in walk.statements(body)):
        return None
    if sum(t.root_variable(place) is variable for place in walk.assigned_places(body)) != 1:
        return None
    for statement in body:
        match statement:
            case t.Assign(
                target=t.VariableRef(variable=target),
                value=t.Binary(
                    operator="ADD" | "SUB" as operator,
                    left=t.VariableRef(variable=source),
                    right=t.Constant(value=int() as amount),
                ),
            ) if target is variable and source is variable:
                return amount if operator == "ADD" else -amount
            case _:
                pass
    return None


def _halving(part: _Part, body: tuple[t.Statement, ...], ranges: Ranges) -> int | None:
    """`low < high` with `mid := (low + high) / 2` and then `low := mid + 1` or `high := mid` (or `mid - 1`)."""
    operator, low, high = part
    if operator in ("GT", "GE"):
        operator, low, high = _MIRRORED[operator], high, low
    if operator not in ("LT", "LE") or not (isinstance(low, t.VariableRef) and isinstance(high, t.VariableRef)):
        return None
    a, b = ranges.of(low), ranges.of(high)
    if a is None or b is None or len(body) != 2:
        return None
    middle, choice = body
    if not (isinstance(middle, t.Assign) and isinstance(middle.target, t.VariableRef)):
        return None
    if not _is_middle(middle.value, low.variable, high.variable) or not isinstance(choice, t.If):
        return None
    halves = [branch.body for branch in choice.branches] + [choice.otherwise]
    # with <= the interval must lose its middle on both sides, or the loop would not end
    if not all(_is_half(half, middle.target.variable, low.variable, high.variable, operator) for half in halves):
        return None
    return max(b.high - a.low + (1 if operator == "LE" else 0), 0).bit_length()


def _is_middle(value: t.Expression, low: t.Variable, high: t.Variable) -> bool:
    match value:
        case t.Binary(
            operator="DIV",
            left=t.Binary(operator="ADD", left=t.VariableRef(variable=first), right=t.VariableRef(variable=second)),
            right=t.Constant(value=2),
        ):
            return {first, second} == {low, high}
        case _:
            return False


def _is_half(
    body: tuple[t.Statement, ...], middle: t.Variable, low: t.Variable, high: t.Variable, operator: str
) -> bool:
    if len(body) != 1:
        return False
    match body[0]:
        case t.Assign(
            target=t.VariableRef(variable=target),
            value=t.Binary(operator=sign, left=t.VariableRef(variable=source), right=t.Constant(value=1)),
        ):
            return source is middle and (target, sign) in ((low, "ADD"), (high, "SUB"))
        case t.Assign(target=t.VariableRef(variable=target), value=t.VariableRef(variable=source)):
            return operator == "LT" and target is high and source is middle
        case _:
            return False
