"""The standard functions: which arguments they take and what type they give."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import cast

from st_codegen.errors import counted
from st_codegen.st import tree as t
from st_codegen.st.check.coercion import coerce, conversion, settle, unify, wrapping
from st_codegen.st.check.operators import combine, is_bits, power, real
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
from st_codegen.st.dialects import Dialect
from st_codegen.st.types import BOOL, DINT, LREAL, Elementary, EnumType, Kind, PointerType

Check = Callable[[t.Expression], t.Expression]


def check_standard_call(rules: Dialect, name: str, node: t.Call, check: Check) -> t.Expression | None:
    """A call of a standard function, None when there is none of that (upper-case) name; `check` checks arguments."""
    if name in REFUSED:
        raise failure(node, f"{name}: {REFUSED[name]}")
    if name not in conversions() and name not in PARAMETERS:
        return None
    for pattern, reason in rules.refused_functions.items():
        if re.fullmatch(pattern, name):
            raise failure(node, f"{name} {reason}")
    arguments = _arguments(name, node, PARAMETERS.get(name, ("IN",)), check)
    if name in conversions():
        return _conversion(rules, *conversions()[name], arguments[0], node)
    if name in ARITHMETIC or name in COMPARISONS:
        result = arguments[0]
        for argument in arguments[1:]:
            result = combine(rules, name, result, argument, node.position)
        return result
    if name == "EXPT":
        return power(rules, arguments[0], arguments[1], node.position)
    if name == "ADR":
        return _address(arguments[0], node)
    if name in (*SHIFTS, "ABS", "MOVE"):
        arguments = [settle(argument) for argument in arguments]
    return arguments[0] if name == "MOVE" else _call(rules, name, arguments, node)


def _call(rules: Dialect, name: str, arguments: list[t.Expression], node: t.Call) -> t.StandardCall:
    """A function that stays one, in its own types."""
    type_ = arguments[0].type
    if name in REAL_FUNCTIONS or name == "TRUNC":
        arguments = [_real(rules, name, arguments[0])]
        type_ = DINT if name == "TRUNC" else arguments[0].type
    elif name == "ATAN2":
        arguments = [coerce(argument, LREAL, rules) for argument in arguments]
        type_ = LREAL
    elif name in SHIFTS:
        count = arguments[1].type
        if not is_bits(type_, rules):
            raise failure(node, f"{name} takes a bit string, not {type_}")
        if not (count.is_integer or count.kind is Kind.BITS):
            raise failure(node, f"{name} shifts by an integer, not by {count}")
    elif name in ("SEL", "MUX"):
        arguments = _choices(rules, name, arguments, node)
        type_ = arguments[1].type
    elif name == "ABS":
        if not (type_.is_integer or type_.is_real):
            raise failure(node, f"no ABS of {type_}")
    else:  # MIN, MAX, LIMIT
        arguments = _unified(rules, arguments)
        type_ = arguments[0].type
        if not (type_.is_real or type_.is_integral):
            raise failure(node, f"no {name} of {type_}")
    return t.StandardCall(name, tuple(arguments), type=type_, position=node.position)


def _arguments(name: str, node: t.Call, parameters: tuple[str, ...], check: Check) -> list[t.Expression]:
    given = node.arguments
    if name in EXTENSIBLE and len(given) > len(parameters):
        stem, start = parameters[-1][:2], int(parameters[-1][2:])
        parameters += tuple(f"{stem}{start + i + 1}" for i in range(len(given) - len(parameters)))
    if len(given) != len(parameters):
        raise failure(node, f"{name} takes {counted(len(parameters), 'argument')}, not {len(given)}")
    values: dict[str, t.Expression] = {}
    for parameter, argument in zip(parameters, given, strict=True):
        key = parameter if argument.name is None else argument.name.upper()
        is_value = argument.passing is t.Passing.INPUT and not isinstance(argument.value, t.Omitted)
        if not is_value or key not in parameters or key in values:
            raise failure(
                argument,
                f"'{argument.name or parameter}' is not, or no longer, an argument of {name}({', '.join(parameters)})",
            )
        values[key] = check(argument.value)
    return [values[parameter] for parameter in parameters]


def _real(rules: Dialect, name: str, argument: t.Expression) -> t.Expression:
    number = real(rules, argument)
    if number is None:
        raise failure(argument.position, f"{name} takes REAL or LREAL, not {argument.type}")
    return number


def _address(argument: t.Expression, node: t.Call) -> t.Expression:
    if not t.is_place(argument):
        raise failure(node, "ADR takes a variable")
    return t.AddressOf(argument, type=PointerType(argument.type), position=node.position)


def _unified(rules: Dialect, arguments: list[t.Expression]) -> list[t.Expression]:
    """The arguments of a function, all in their common type."""
    common = arguments[0]
    for argument in arguments[1:]:
        common, _, _ = unify(common, argument, rules)
    target = settle(common).type
    return [coerce(argument, target, rules) for argument in arguments]


def _choices(rules: Dialect, name: str, arguments: list[t.Expression], node: t.Call) -> list[t.Expression]:
    """The arguments of SEL and MUX: what they choose by, and what they choose from in a common type."""
    first, *choices = arguments
    selector = coerce(first, BOOL, rules) if name == "SEL" else settle(first)
    if name == "MUX" and not selector.type.is_integer:
        raise failure(node, f"the first argument of MUX is an integer, not {selector.type}")
    settled = [settle(choice) for choice in choices]
    is_same = all(choice.type == settled[0].type for choice in settled)
    choices = settled if is_same else _unified(rules, choices)
    if not isinstance(choices[0].type, Elementary | EnumType | PointerType):
        raise failure(node, f"{name} chooses between elementary values, not {choices[0].type}")
    return [selector, *choices]


def _conversion(rules: Dialect, source: str | None, target: str, argument: t.Expression, node: t.Call) -> t.Expression:
    if "STRING" in (source, target) or "WSTRING" in (source, target):
        raise failure(node, "conversions from and to strings are not supported: their text depends on the target")
    goal = rules.types[target]
    if source is None:
        own = settle(argument).type
        origin = own.base if isinstance(own, EnumType) else cast(Elementary, own)
        if origin.kind in (Kind.COMPOUND, Kind.STRING):
            raise failure(node, f"no conversion from {origin}")
    else:
        origin = rules.types[source]
    value, kinds = coerce(argument, origin, rules), {origin.kind, goal.kind}
    if Kind.TIME in kinds and (kinds & {Kind.BOOL, Kind.REAL}) and not goal.is_real:
        raise failure(node, f"no conversion from {origin} to {goal}")
    if goal.is_integral and origin.is_integral and goal.bits <= origin.bits:
        value = wrapping(value)
    return conversion(value, goal)
