"""The standard functions: which arguments they take and what type they give."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from st_codegen.st import tree as t
from st_codegen.st.check.coercion import coerce, conversion, settle, unify, wrapping
from st_codegen.st.check.standard_names import (
    ARITHMETIC,
    COMPARISONS,
    EXTENSIBLE,
    PARAMETERS,
    REAL_FUNCTIONS,
    REFUSED,
    SHIFTS,
    conversions,
)
from st_codegen.st.check.symbols import failure
from st_codegen.st.types import (
    BOOL,
    DINT,
    LREAL,
    ArrayType,
    BlockType,
    Dialect,
    Elementary,
    EnumType,
    Kind,
    PointerType,
    StructType,
)

if TYPE_CHECKING:
    from st_codegen.st.check.expressions import Expressions


def check_standard_call(checker: Expressions, name: str, node: t.Call) -> t.Expression | None:
    """A call of a standard function, None when there is none of that (upper-case) name."""
    if name in REFUSED:
        raise failure(node, f"{name}: {REFUSED[name]}")
    if name in conversions():
        source, target = conversions()[name]
        (argument,) = _arguments(checker, name, node, ("IN",))
        return _conversion(checker, source, target, argument, node)
    if name not in PARAMETERS:
        return None
    arguments = _arguments(checker, name, node, PARAMETERS[name])
    if name in REAL_FUNCTIONS:
        return _call(name, (_real(checker, name, arguments[0]),), node)
    if name in ARITHMETIC or name in COMPARISONS:
        result = arguments[0]
        for argument in arguments[1:]:
            result = checker.combine(name, result, argument, node)
        return result
    if name in SHIFTS:
        return _shift(checker, name, arguments, node)
    return _others(checker, name, arguments, node)


def _others(checker: Expressions, name: str, arguments: list[t.Expression], node: t.Call) -> t.Expression:  # noqa: PLR0911 - one return a case
    match name:
        case "MOVE":
            return settle(arguments[0])
        case "ADR":
            return _address(arguments[0], node)
        case "ABS":
            return _absolute(arguments[0], node)
        case "EXPT":
            return checker.power(arguments[0], arguments[1], node)
        case "ATAN2":
            if checker.dialect is Dialect.IEC:
                raise failure(node, "ATAN2 is not in the standard: use ATAN")
            return _call(name, tuple(coerce(x, LREAL, checker.dialect) for x in arguments), node)
        case "TRUNC":
            number = _real(checker, name, arguments[0])
            return t.StandardCall("TRUNC", (number,), type=DINT, position=node.position)
        case "SEL":
            return _selection(checker, name, coerce(arguments[0], BOOL, checker.dialect), arguments[1:], node)
        case "MUX":
            selector = settle(arguments[0])
            if not isinstance(selector.type, Elementary) or not selector.type.is_integer:
                raise failure(node, f"the first argument of MUX is an integer, not {selector.type}")
            return _selection(checker, name, selector, arguments[1:], node)
        case _:  # MIN, MAX, LIMIT
            unified = _unified(checker, arguments)
            type_ = cast(Elementary, unified[0].type)
            if not (type_.is_real or type_.is_integral):
                raise failure(node, f"no {name} of {type_}")
            return _call(name, tuple(unified), node)


def _arguments(checker: Expressions, name: str, node: t.Call, parameters: tuple[str, ...]) -> list[t.Expression]:
    given = node.arguments
    if name in EXTENSIBLE and len(given) > len(parameters):
        stem, start = parameters[-1][:2], int(parameters[-1][2:])
        parameters += tuple(f"{stem}{start + i + 1}" for i in range(len(given) - len(parameters)))
    if len(given) != len(parameters):
        raise failure(node, f"{name} takes {len(parameters)} arguments, not {len(given)}")
    values: dict[str, t.Expression] = {}
    for parameter, argument in zip(parameters, given, strict=True):
        key = parameter if argument.name is None else argument.name.upper()
        if (
            argument.passing is t.Passing.OUTPUT
            or isinstance(argument.value, t.Omitted)
            or key not in parameters
            or key in values
        ):
            raise failure(
                argument,
                f"'{argument.name or parameter}' is not, or no longer, an argument of {name}({', '.join(parameters)})",
            )
        values[key] = checker.check(argument.value)
    return [values[parameter] for parameter in parameters]


def _call(name: str, arguments: tuple[t.Expression, ...], node: t.Call) -> t.StandardCall:
    return t.StandardCall(name, arguments, type=arguments[0].type, position=node.position)


def _real(checker: Expressions, name: str, argument: t.Expression) -> t.Expression:
    argument = settle(argument)
    type_ = argument.type
    if isinstance(type_, Elementary) and type_.is_integer and checker.dialect is Dialect.TWINCAT:
        return coerce(argument, LREAL, checker.dialect)
    if not isinstance(type_, Elementary) or not type_.is_real:
        raise failure(argument.position, f"{name} takes REAL or LREAL, not {type_}")
    return argument


def _absolute(argument: t.Expression, node: t.Call) -> t.Expression:
    argument = settle(argument)
    if not isinstance(argument.type, Elementary) or not (argument.type.is_integer or argument.type.is_real):
        raise failure(node, f"no ABS of {argument.type}")
    return _call("ABS", (argument,), node)


def _address(argument: t.Expression, node: t.Call) -> t.Expression:
    if not t.is_place(argument):
        raise failure(node, "ADR takes a variable")
    return t.AddressOf(argument, type=PointerType(argument.type), position=node.position)


def _shift(checker: Expressions, name: str, arguments: list[t.Expression], node: t.Call) -> t.Expression:
    value, count = settle(arguments[0]), settle(arguments[1])
    allowed = isinstance(value.type, Elementary) and (
        value.type.kind is Kind.BITS or (value.type.is_integer and checker.dialect is Dialect.TWINCAT)
    )
    if not allowed:
        raise failure(node, f"{name} takes a bit string, not {value.type}")
    if not isinstance(count.type, Elementary) or not (count.type.is_integer or count.type.kind is Kind.BITS):
        raise failure(node, f"{name} shifts by an integer, not by {count.type}")
    return t.StandardCall(name, (value, count), type=value.type, position=node.position)


def _unified(checker: Expressions, arguments: list[t.Expression]) -> list[t.Expression]:
    """All arguments in their common type."""
    common = arguments[0]
    for argument in arguments[1:]:
        common, _, _ = unify(common, argument, checker.dialect)
    target = settle(common).type
    return [coerce(argument, target, checker.dialect) for argument in arguments]


def _selection(
    checker: Expressions, name: str, selector: t.Expression, choices: list[t.Expression], node: t.Call
) -> t.Expression:
    first = settle(choices[0])
    if all(settle(choice).type == first.type for choice in choices):
        choices = [settle(choice) for choice in choices]
    else:
        choices = _unified(checker, choices)
    type_ = choices[0].type
    if isinstance(type_, ArrayType | StructType | BlockType):
        raise failure(node, f"{name} chooses between elementary values, not {type_}")
    return t.StandardCall(name, (selector, *choices), type=type_, position=node.position)


def _conversion(
    checker: Expressions, source: str | None, target: str, argument: t.Expression, node: t.Call
) -> t.Expression:
    if "STRING" in (source, target) or "WSTRING" in (source, target):
        raise failure(node, "conversions from and to strings are not supported: their text depends on the target")
    is_twincat = checker.dialect is Dialect.TWINCAT
    goal = checker.symbols.elementary[target]
    if source is None:
        if not is_twincat:
            raise failure(node, f"TO_{target} is not portable: name the source type, too")
        origin = settle(argument).type
        if isinstance(origin, EnumType):
            origin = origin.base
        if not isinstance(origin, Elementary) or origin.kind is Kind.STRING:
            raise failure(node, f"no conversion from {origin}")
    else:
        origin = checker.symbols.elementary[source]
    value = coerce(argument, origin, checker.dialect)
    kinds = {origin.kind, goal.kind}
    if not is_twincat and (Kind.TIME in kinds or kinds == {Kind.BITS, Kind.REAL}):
        raise failure(node, f"{origin}_TO_{goal} gives different results on different controllers")
    if Kind.TIME in kinds and (kinds & {Kind.BOOL, Kind.REAL}) and not goal.is_real:
        raise failure(node, f"no conversion from {origin} to {goal}")
    if goal.is_integral and origin.is_integral and goal.bits <= origin.bits:
        value = wrapping(value)
    return conversion(value, goal)
