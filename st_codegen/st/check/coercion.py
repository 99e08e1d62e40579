"""Where a type is asked for: literals take it on, allowed conversions become nodes, the rest is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import Fault, stored
from st_codegen.st.check.constants import convert
from st_codegen.st.check.symbols import failure
from st_codegen.st.dialects import Dialect
from st_codegen.st.types import (
    ANY_INT_LITERAL,
    ANY_REAL_LITERAL,
    BOOL,
    DINT,
    INT,
    LINT,
    LREAL,
    REAL,
    ULINT,
    Elementary,
    EnumType,
    Kind,
    PointerType,
    Type,
)

_RING = frozenset({"ADD", "SUB", "MUL"})
_UNSIGNED = frozenset({Kind.BITS, Kind.UNSIGNED})
_NUMERIC = _UNSIGNED | {Kind.SIGNED}


def converts_implicitly(source: Type, target: Type, rules: Dialect) -> bool:  # noqa: PLR0911 - one return a case
    """Whether a value of one type may stand where another one is asked for: where the dialect widens, if none is lost.

    Bit strings count as unsigned integers, enumerations as their base; every pointer is a PVOID in all dialects.
    """
    if isinstance(target, PointerType) and isinstance(source, PointerType):
        return target.target is None
    if isinstance(source, EnumType):
        return rules.has_widening and (source.base == target or converts_implicitly(source.base, target, rules))
    if not rules.has_widening or not isinstance(source, Elementary) or not isinstance(target, Elementary):
        return False
    if source.kind is Kind.STRING and target.kind is Kind.STRING:
        return source.name.split("(")[0] == target.name.split("(")[0]
    if source.kind in _NUMERIC and target.kind in _NUMERIC:
        return target.lower <= source.lower and source.upper <= target.upper
    if target.is_real and source.kind in _NUMERIC:
        return source.bits < target.bits
    return source is REAL and target is LREAL


def common_type(left: Elementary, right: Elementary, rules: Dialect) -> Elementary | None:
    """The smallest type that both operands of an operator convert to; None when there is none.

    Where a sign meets a type without, as DINT and DWORD, no documentation says which type is taken: one must hold the
    values of the other.
    """

    def fits(type_: Elementary) -> bool:
        return all(side == type_ or converts_implicitly(side, type_, rules) for side in (left, right))

    mixes_signs = Kind.SIGNED in (left.kind, right.kind) and not {left.kind, right.kind}.isdisjoint(_UNSIGNED)
    return next(filter(fits, (right, left) if mixes_signs else (right, left, INT, DINT, LINT, LREAL)), None)


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


def coerce(expression: t.Expression, target: Type, rules: Dialect, is_stored: bool = False) -> t.Expression:
    """An expression as a value of `target`; `is_stored` says that it goes into a variable of that type.

    Raises `StCheckError` when the dialect does not allow it.
    """
    source = expression.type
    if source == target:
        return wrapping(expression) if is_stored else expression
    if isinstance(expression, t.Constant):
        adapted = _adapt(expression, target, rules)
        if adapted is not None:
            return adapted
    if converts_implicitly(source, target, rules):
        if isinstance(target, PointerType):
            return replace(expression, type=target)
        return conversion(expression, target)
    raise failure(expression.position, _refusal(source, target))


def conversion(expression: t.Expression, target: Type) -> t.Expression:
    """A conversion node, or the converted constant."""
    if isinstance(expression, t.Constant):
        try:
            value = convert(expression.value, expression.type, target)
        except Fault as fault:
            raise failure(expression.position, f"{fault.kind}: {expression.value} as {target}") from None
        return replace(expression, type=target, value=value)
    return t.Conversion(expression, type=target, position=expression.position)


def _adapt(constant: t.Constant, target: Type, rules: Dialect) -> t.Constant | None:  # noqa: PLR0911 - one return a case
    """A literal as a value of the type asked for; None when it is not a matter of literals."""
    source, value = constant.type, constant.value
    if isinstance(target, PointerType) and value == 0 and source is ANY_INT_LITERAL:
        return replace(constant, type=target, value=None)
    if not isinstance(target, Elementary):
        return None
    if source is ANY_INT_LITERAL and isinstance(value, int) and target.is_integral and target.kind is not Kind.TIME:
        if not target.holds(value):
            raise failure(constant.position, f"{value} does not fit {target} ({target.lower}..{target.upper})")
        return replace(constant, type=target)
    if source is ANY_INT_LITERAL and rules.has_loose_literals and target is BOOL and value in (0, 1):
        return replace(constant, type=BOOL, value=bool(value))
    if target.is_real and (source is ANY_REAL_LITERAL or (source is ANY_INT_LITERAL and rules.has_loose_literals)):
        try:
            return replace(constant, type=target, value=stored(float(cast(float, value)), target))
        except Fault:
            raise failure(constant.position, f"{value} is larger than the largest {target}") from None
    if source.kind is Kind.STRING and target.kind is Kind.STRING and str(source)[0] == target.name[0]:
        if len(cast(str, value)) > target.bits:
            raise failure(constant.position, f"a string of {len(cast(str, value))} characters does not fit {target}")
        return replace(constant, type=target)
    return None


def _refusal(source: Type, target: Type) -> str:
    if {source.kind, target.kind} & {Kind.COMPOUND, Kind.STRING}:
        return f"{source} where {target} is needed"
    if source.is_untyped:
        hint = "write a dot in the number" if target.is_real else f"a {source} does not fit there"
    else:
        hint = f"convert it with {source}_TO_{target}"
    return f"{source} where {target} is needed: {hint}"


def unify(left: t.Expression, right: t.Expression, rules: Dialect) -> tuple[t.Expression, t.Expression, Elementary]:
    """Both operands of an operator in their common type. Raises `StCheckError` when they have none."""
    if not (isinstance(left.type, EnumType) and isinstance(right.type, EnumType)):
        left, right = _plain(left, rules), _plain(right, rules)
    first, second = left.type, right.type
    if not isinstance(first, Elementary) or not isinstance(second, Elementary):
        raise failure(left.position, f"no operation between {first} and {second}")
    if first.is_untyped and second.is_untyped:
        if first == second:
            return left, right, first
        if not rules.has_loose_literals:
            raise failure(left.position, "no operation between an integer and a real literal: write a dot in both")
        return _as_real(left), _as_real(right), ANY_REAL_LITERAL
    if first.is_untyped:
        right, left, common = _with_literal(right, second, left, rules)
        return left, right, common
    if second.is_untyped:
        return _with_literal(left, first, right, rules)
    if first.kind is Kind.STRING and second.kind is Kind.STRING:
        return left, right, first
    found = common_type(first, second, rules)
    if found is None:
        raise failure(left.position, f"no operation between {first} and {second}: convert one of them")
    return coerce(left, found, rules), coerce(right, found, rules), found


def _plain(expression: t.Expression, rules: Dialect) -> t.Expression:
    """Where a dialect widens, an enumeration counts as its base type."""
    if isinstance(expression.type, EnumType) and rules.has_widening:
        return conversion(expression, expression.type.base)
    return expression


def _as_real(literal: t.Expression) -> t.Expression:
    constant = cast(t.Constant, literal)
    return replace(constant, type=ANY_REAL_LITERAL, value=float(cast(float, constant.value)))


def _with_literal(
    typed: t.Expression, type_: Elementary, literal: t.Expression, rules: Dialect
) -> tuple[t.Expression, t.Expression, Elementary]:
    """A typed operand with a literal that has no type: the literal adapts, or both go to a wider type."""
    common = type_
    if rules.has_widening and literal.type is ANY_REAL_LITERAL:
        # A real literal without a type is LREAL there, and so is what is computed with it
        common = LREAL
    elif rules.has_widening and type_.is_integral and not type_.holds(cast(int, cast(t.Constant, literal).value)):
        own = settle(literal)
        wider = common_type(type_, cast(Elementary, own.type), rules)
        if wider is not None:
            common, literal = wider, own
    return coerce(typed, common, rules), coerce(literal, common, rules), common


def wrapping(expression: t.Expression) -> t.Expression:
    """A sum, difference or product as it is for a variable that keeps only the low bits: nothing overflows."""
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


def overflow_of(operator: str, type_: Elementary) -> t.Overflow:
    """What an operator does whose result may leave its type: beyond 32 bits the value depends on the target."""
    may_differ = operator in _RING and type_.is_integral and type_.bits < 64
    return t.Overflow.ERROR if may_differ else t.Overflow.WRAP
