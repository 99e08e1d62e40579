"""Where a type is asked for: literals take it on, allowed conversions become nodes, the rest is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import Fault, stored
from st_codegen.st.check.constants import convert
from st_codegen.st.check.symbols import failure
from st_codegen.st.types import (
    ANY_INT_LITERAL,
    ANY_REAL_LITERAL,
    BOOL,
    DINT,
    LINT,
    LREAL,
    ULINT,
    Dialect,
    Elementary,
    EnumType,
    Kind,
    PointerType,
    Type,
    common_type,
    converts_implicitly,
)

_RING = frozenset({"ADD", "SUB", "MUL"})


def settle(expression: t.Expression) -> t.Expression:
    """A literal without a type gets the one it has by itself: DINT, LINT or ULINT by its size, LREAL."""
    if expression.type is ANY_REAL_LITERAL:
        return replace(expression, type=LREAL)
    if expression.type is ANY_INT_LITERAL:
        value = cast(int, cast(t.Constant, expression).value)
        fitting = next((type_ for type_ in (DINT, LINT, ULINT) if type_.holds(value)), None)
        if fitting is None:
            raise failure(expression.position, f"{value} fits no integer type")
        return replace(expression, type=fitting)
    return expression


def coerce(expression: t.Expression, target: Type, dialect: Dialect, is_stored: bool = False) -> t.Expression:
    """An expression as a value of `target`; `is_stored` says that it goes into a variable of that type.

    Raises `StCheckError` when the dialect does not allow it.
    """
    source = expression.type
    if source == target:
        return wrapping(expression) if is_stored else expression
    if isinstance(expression, t.Constant):
        adapted = _adapt(expression, target, dialect)
        if adapted is not None:
            return adapted
    if converts_implicitly(source, target, dialect):
        if isinstance(target, PointerType):
            return replace(expression, type=target)
        return conversion(expression, target, is_implicit=True)
    raise failure(expression.position, _refusal(expression, target))


def conversion(expression: t.Expression, target: Type, is_implicit: bool = False) -> t.Expression:
    """A conversion node, or the converted constant."""
    if isinstance(expression, t.Constant):
        try:
            value = convert(expression.value, expression.type, target)
        except Fault as fault:
            raise failure(expression.position, f"{fault.kind}: {expression.value} as {target}") from None
        return replace(expression, type=target, value=value)
    return t.Conversion(expression, is_implicit, type=target, position=expression.position)


def _adapt(constant: t.Constant, target: Type, dialect: Dialect) -> t.Constant | None:  # noqa: PLR0911 - one return a case
    """A literal as a value of the type asked for; None when it is not a matter of literals."""
    if isinstance(target, PointerType) and constant.value == 0 and constant.type is ANY_INT_LITERAL:
        return replace(constant, type=target, value=None)
    if not isinstance(target, Elementary) or not isinstance(constant.type, Elementary):
        return None
    value, is_twincat = constant.value, dialect is Dialect.TWINCAT
    if constant.type is ANY_INT_LITERAL and isinstance(value, int):
        if target.is_integral and target.kind is not Kind.TIME:
            if not target.holds(value):
                raise failure(constant.position, f"{value} does not fit {target} ({target.lower}..{target.upper})")
            return replace(constant, type=target)
        if target.is_real and is_twincat:
            return _real(constant, float(value), target)
        if target is BOOL and is_twincat and value in (0, 1):
            return replace(constant, type=BOOL, value=bool(value))
    if constant.type is ANY_REAL_LITERAL and target.is_real:
        return _real(constant, cast(float, value), target)
    if constant.type.kind is Kind.STRING and target.kind is Kind.STRING and constant.type.name[0] == target.name[0]:
        if len(cast(str, value)) > target.bits:
            raise failure(constant.position, f"a string of {len(cast(str, value))} characters does not fit {target}")
        return replace(constant, type=target)
    return None


def _real(constant: t.Constant, value: float, target: Elementary) -> t.Constant:
    try:
        return replace(constant, type=target, value=stored(value, target))
    except Fault:
        raise failure(constant.position, f"{value} is larger than the largest {target}") from None


def _refusal(expression: t.Expression, target: Type) -> str:
    source = expression.type
    if (
        isinstance(source, Elementary)
        and isinstance(target, Elementary)
        and Kind.STRING not in (source.kind, target.kind)
    ):
        if source.is_untyped:
            hint = "write a dot in the number" if target.is_real else f"a {source} does not fit there"
        else:
            hint = f"convert it with {source}_TO_{target}"
        return f"{source} where {target} is needed: {hint}"
    return f"{source} where {target} is needed"


def unify(left: t.Expression, right: t.Expression, dialect: Dialect) -> tuple[t.Expression, t.Expression, Elementary]:
    """Both operands of an operator in their common type. Raises `StCheckError` when they have none."""
    if not (isinstance(left.type, EnumType) and isinstance(right.type, EnumType)):
        left, right = _plain(left, dialect), _plain(right, dialect)
    if not isinstance(left.type, Elementary) or not isinstance(right.type, Elementary):
        raise failure(left.position, f"no operation between {left.type} and {right.type}")
    left_type, right_type = left.type, right.type
    if left_type.is_untyped and right_type.is_untyped:
        return _unify_literals(left, right, dialect)
    if left_type.is_untyped:
        right, left, common = _with_literal(right, left, dialect)
        return left, right, common
    if right_type.is_untyped:
        return _with_literal(left, right, dialect)
    if left_type.kind is Kind.STRING and right_type.kind is Kind.STRING:
        return left, right, left_type
    common_ = common_type(left_type, right_type, dialect)
    if common_ is None:
        raise failure(left.position, f"no operation between {left.type} and {right.type}: convert one of them")
    return coerce(left, common_, dialect), coerce(right, common_, dialect), common_


def _plain(expression: t.Expression, dialect: Dialect) -> t.Expression:
    """In TwinCAT an enumeration counts as its base type."""
    if isinstance(expression.type, EnumType) and dialect is Dialect.TWINCAT:
        return conversion(expression, expression.type.base, is_implicit=True)
    return expression


def _unify_literals(
    left: t.Expression, right: t.Expression, dialect: Dialect
) -> tuple[t.Expression, t.Expression, Elementary]:
    if left.type == right.type:
        return left, right, cast(Elementary, left.type)
    if dialect is Dialect.IEC:
        raise failure(left.position, "no operation between an integer and a real literal: write a dot in both")
    return _as_real(left), _as_real(right), ANY_REAL_LITERAL


def _as_real(literal: t.Expression) -> t.Expression:
    constant = cast(t.Constant, literal)
    return replace(constant, type=ANY_REAL_LITERAL, value=float(cast(float, constant.value)))


def _with_literal(
    typed: t.Expression, literal: t.Expression, dialect: Dialect
) -> tuple[t.Expression, t.Expression, Elementary]:
    """A typed operand with a literal that has no type: the literal adapts, or both go to a wider type."""
    type_ = cast(Elementary, typed.type)
    value = cast(t.Constant, literal).value
    if dialect is Dialect.TWINCAT:
        if literal.type is ANY_REAL_LITERAL and type_ is not LREAL:
            # An untyped real literal of TwinCAT is LREAL, and so is what is computed with it
            return coerce(typed, LREAL, dialect), coerce(literal, LREAL, dialect), LREAL
        if type_.is_integral and not type_.holds(cast(int, value)):
            own = settle(literal)
            common = common_type(type_, cast(Elementary, own.type), dialect)
            if common is not None:
                return coerce(typed, common, dialect), coerce(own, common, dialect), common
    return typed, coerce(literal, type_, dialect), type_


def wrapping(expression: t.Expression) -> t.Expression:
    """The same sum, difference or product for a place that keeps only the low bits."""
    if isinstance(expression, t.Unary) and expression.operator == "NEG":
        return replace(expression, operand=wrapping(expression.operand), overflow=t.Overflow.WRAP)
    pending: list[t.Binary] = []
    current = expression
    while isinstance(current, t.Binary) and current.operator in _RING and current.overflow is t.Overflow.ERROR:
        pending.append(current)
        current = current.left
    if not pending:
        return expression
    result = wrapping(current) if isinstance(current, t.Unary) else current
    for node in reversed(pending):
        result = replace(node, left=result, right=wrapping(node.right), overflow=t.Overflow.WRAP)
    return result


def is_wrapping_operator(operator: str, type_: Elementary) -> bool:
    """Whether an operator's result may leave its type, with a value that depends on the target."""
    return operator in _RING and type_.is_integral and type_.bits < 64
