"""Evaluates checked constant expressions; with `arithmetic`, this defines what a computation gives."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, cast

from st_codegen.st import tree as t
from st_codegen.st.check import arithmetic as a
from st_codegen.st.types import BOOL, REAL, Elementary, EnumType, Kind, Scalar, Type, storage_type


class NotConstantError(Exception):
    """An expression depends on something that is not constant; `expression` is that part."""

    def __init__(self, expression: t.Expression) -> None:
        self.expression = expression
        super().__init__("not constant")


def convert(value: Scalar, source: Type, target: Type) -> Scalar:
    """What an explicit or implicit conversion makes of a value. Raises `Fault` like a controller."""
    source, target = storage_type(source), storage_type(target)
    if source == target or source.kind is Kind.STRING:
        return value
    if target.kind is Kind.BOOL:
        return value != 0
    if source.is_real:
        number = cast(float, value)
        if target is REAL:
            return a.to_single(number)
        return number if target.is_real else a.to_integer(number, target.lower, target.upper)
    number = int(cast(int, value))
    if target.is_real:
        return a.round_single(float(number)) if target is REAL else float(number)
    return a.wrap(number, target.lower, target.upper)


def evaluate(expression: t.Expression) -> Scalar:  # noqa: PLR0911 - one return a case
    """The value of a constant expression. Raises `NotConstantError` or `Fault`."""
    match expression:
        case t.Constant():
            return expression.value
        case t.VariableRef(variable=variable) if variable.is_constant and isinstance(
            variable.type, Elementary | EnumType
        ):
            return cast(Scalar, variable.initial)
        case t.Conversion():
            return convert(evaluate(expression.operand), expression.operand.type, expression.type)
        case t.Unary():
            return _unary(expression, evaluate(expression.operand))
        case t.Binary():
            return _chain(expression)
        case t.Compare():
            return compare(expression.operator, evaluate(expression.left), evaluate(expression.right))
        case t.StandardCall(function=function) if function in a.FUNCTIONS:
            value = a.FUNCTIONS[function](cast(float, evaluate(expression.arguments[0])))
            return a.stored(value, storage_type(expression.type))
        case _:
            raise NotConstantError(expression)


def _chain(expression: t.Binary) -> Scalar:
    """A chain of operators of any length, from left to right."""
    pending: list[t.Binary] = []
    current: t.Expression = expression
    while isinstance(current, t.Binary):
        pending.append(current)
        current = current.left
    value = evaluate(current)
    for node in reversed(pending):
        value = binary(node.operator, storage_type(node.type), node.overflow, value, evaluate(node.right))
    return value


def _unary(node: t.Unary, value: Scalar) -> Scalar:
    type_ = storage_type(node.type)
    if node.operator == "NOT":
        return not value if type_ is BOOL else a.wrap(~cast(int, value), type_.lower, type_.upper)
    if type_.is_real:
        return -cast(float, value)
    return _fit(-cast(int, value), type_, node.overflow, (cast(int, value),))


def _fit(value: int, type_: Elementary, overflow: t.Overflow, operands: tuple[int, ...]) -> int:
    if overflow is t.Overflow.WRAP:
        return a.wrap(value, type_.lower, type_.upper)
    return a.exact(value, type_.lower, type_.upper, *operands)


_RING: dict[str, Callable[[int, int], int]] = {"ADD": operator.add, "SUB": operator.sub, "MUL": operator.mul}
_DIVISION: dict[str, Callable[[int, int, int], int]] = {"DIV": a.integer_div, "MOD": a.integer_mod}
_LOGIC: dict[str, Callable[[int, int], int]] = {"AND": operator.and_, "OR": operator.or_, "XOR": operator.xor}
_COMPARE: dict[str, Callable[[Any, Any], bool]] = {
    name: getattr(operator, name.lower()) for name in ("EQ", "NE", "LT", "LE", "GT", "GE")
}


def binary(name: str, type_: Elementary, overflow: t.Overflow, left: Scalar, right: Scalar) -> Scalar:
    """An arithmetic or logical operator. Raises `Fault`."""
    if type_.is_real:
        return a.stored(a.REAL_OPERATORS[name](cast(float, left), cast(float, right)), type_)
    x, y = cast(int, left), cast(int, right)
    if name in _RING:
        return _fit(_RING[name](x, y), type_, overflow, (x, y))
    return _DIVISION[name](x, y, type_.upper) if name in _DIVISION else _LOGIC[name](x, y)


def compare(name: str, left: Scalar, right: Scalar) -> bool:
    """A comparison of two values of one type. Raises `Fault` for a NaN."""
    if isinstance(left, float) and isinstance(right, float):
        a.compared(left, right)
    return _COMPARE[name](left, right)
