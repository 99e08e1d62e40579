"""Calls of functions, methods, programs and instances of blocks, and what may be assigned."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, cast

from st_codegen.st import tree as t
from st_codegen.st.check.coercion import coerce
from st_codegen.st.check.symbols import Unit, failure
from st_codegen.st.run.standard import check_standard_call
from st_codegen.st.tree import PouKind
from st_codegen.st.types import BOOL, BlockType, Dialect, Type

if TYPE_CHECKING:
    from st_codegen.st.check.expressions import Expressions


def check_call(checker: Expressions, node: t.Call) -> t.Expression:
    """A call in an expression or as a statement. Raises `StCheckError`."""
    callee = node.function
    if isinstance(callee, t.Member) and _is_library(checker, callee.base):
        callee = t.Identifier(callee.name, position=callee.position)
    if isinstance(callee, t.Identifier):
        return _call_by_name(checker, callee, node)
    if isinstance(callee, t.Super):
        base = _base_unit(checker, callee)
        return _user_call(checker, base, checker.this(callee), node, is_virtual=False)
    if isinstance(callee, t.Member):
        method = _find_method(checker, callee)
        if method is not None:
            unit, receiver, is_virtual = method
            return _user_call(checker, unit, receiver, node, is_virtual)
    return _call_instance(checker, checker.check(callee), node)


def _is_library(checker: Expressions, base: t.Expression) -> bool:
    if not isinstance(base, t.Identifier) or base.name.upper() not in checker.symbols.namespaces:
        return False
    return checker.find_variable(base.name, base) is None


def _call_by_name(checker: Expressions, callee: t.Identifier, node: t.Call) -> t.Expression:
    key, symbols = callee.name.upper(), checker.symbols
    if checker.find_variable(callee.name, callee) is not None and key != checker.unit.name.upper():
        return _call_instance(checker, checker.check(callee), node)
    block = checker.unit.block or checker.unit
    if block.kind is PouKind.FUNCTION_BLOCK:
        method = symbols.find_method(block.name, key)
        if method is not None:
            return _user_call(checker, method, checker.this(callee), node, is_virtual=True)
    unit = symbols.units.get(key)
    if unit is not None and unit.kind is PouKind.FUNCTION:
        return _user_call(checker, unit, None, node, is_virtual=False)
    if unit is not None and unit.kind is PouKind.PROGRAM:
        return _user_call(checker, unit, checker.program(callee), node, is_virtual=False)
    standard = check_standard_call(checker, key, node)
    if standard is not None:
        return standard
    if unit is not None:
        raise failure(callee, f"'{callee.name}' is a function block: declare an instance of it and call that")
    known = [other.name for other in symbols.units.values() if other.kind is PouKind.FUNCTION]
    close = get_close_matches(callee.name, known, 1)
    raise failure(callee, f"unknown function '{callee.name}'" + (f": is '{close[0]}' meant?" if close else ""))


def _base_unit(checker: Expressions, node: t.Node) -> Unit:
    block = checker.unit.block or checker.unit
    lineage = list(checker.symbols.lineage(block))
    if len(lineage) < 2:
        raise failure(node, f"'{block.name}' extends nothing, so there is no SUPER^")
    return lineage[1]


def _find_method(checker: Expressions, callee: t.Member) -> tuple[Unit, t.Expression, bool] | None:
    """The method that `base.name` is; None when it is no method."""
    base, key = callee.base, callee.name.upper()
    if isinstance(base, t.Super):
        unit = checker.symbols.find_method(_base_unit(checker, base).name, key)
        if unit is None:
            raise failure(callee, f"SUPER^ has no method '{callee.name}'")
        return unit, checker.this(base), False
    receiver: t.Expression | None = None
    if isinstance(base, t.Identifier):
        if checker.find_variable(base.name, base) is None:
            receiver = checker.program(base)
            if receiver is None:
                return None
    elif isinstance(base, t.Member) and _is_namespace(checker, base):
        return None
    receiver = receiver or checker.check(base)
    if not isinstance(receiver.type, BlockType):
        return None
    unit = checker.symbols.find_method(receiver.type.name, key)
    if unit is None:
        if checker.symbols.find_member(receiver.type.name, key) is None:
            raise failure(callee, f"'{receiver.type}' has no method '{callee.name}'")
        return None
    modifiers = unit.declaration.modifiers if unit.declaration is not None else frozenset()
    own = checker.unit.block or checker.unit
    if "PRIVATE" in modifiers and unit.block is not own:
        raise failure(callee, f"'{callee.name}' is a private method of '{receiver.type}'")
    return unit, receiver, True


def _is_namespace(checker: Expressions, node: t.Member) -> bool:
    return isinstance(node.base, t.Identifier) and node.base.name.upper() in checker.symbols.types


def _call_instance(checker: Expressions, receiver: t.Expression, node: t.Call) -> t.Expression:
    if not isinstance(receiver.type, BlockType):
        raise failure(node, f"{receiver.type} cannot be called")
    unit = checker.symbols.units[receiver.type.name.upper()]
    return _user_call(checker, unit, receiver, node, is_virtual=not isinstance(receiver, t.ProgramRef))


def _user_call(
    checker: Expressions, unit: Unit, receiver: t.Expression | None, node: t.Call, is_virtual: bool
) -> t.Call:
    result = checker.declarations.result(unit)
    arguments = _check_arguments(checker, unit, node)
    return replace(
        node,
        arguments=tuple(arguments),
        callee=unit.key,
        receiver=receiver,
        is_virtual=is_virtual,
        has_result=result is not None,
        type=BOOL if result is None else result.type,
    )


def _parameters(checker: Expressions, unit: Unit) -> dict[str, t.Variable]:
    """Inputs, outputs and in-outs, inherited ones of a block first."""
    owners = [unit] if unit.kind is not PouKind.FUNCTION_BLOCK else list(checker.symbols.lineage(unit))[::-1]
    sections = (t.Section.INPUT, t.Section.OUTPUT, t.Section.IN_OUT)
    return {
        key: checker.declarations.variable(owner, entry)
        for owner in owners
        for key, entry in owner.entries.items()
        if entry.section in sections
    }


def _check_arguments(checker: Expressions, unit: Unit, node: t.Call) -> list[t.Argument]:
    parameters = _parameters(checker, unit)
    positional = [p for p in parameters.values() if p.section is not t.Section.OUTPUT]
    made: dict[str, t.Argument] = {}
    for index, argument in enumerate(node.arguments):
        if argument.name is None:
            if unit.has_instance:
                raise failure(argument, f"arguments of '{unit.name}' are given by name: name := value")
            if index >= len(positional):
                raise failure(argument, f"'{unit.name}' takes {len(positional)} arguments, not {len(node.arguments)}")
            parameter = positional[index]
        else:
            found = parameters.get(argument.name.upper())
            if found is None:
                close = get_close_matches(argument.name, [p.name for p in parameters.values()], 1)
                hint = f": is '{close[0]}' meant?" if close else ""
                raise failure(argument, f"'{unit.name}' has no parameter '{argument.name}'{hint}")
            parameter = found
        if parameter.key in made:
            raise failure(argument, f"'{parameter.name}' is given twice")
        if not isinstance(argument.value, t.Omitted):
            made[parameter.key] = _check_argument(checker, unit, parameter, argument)
    for parameter in parameters.values():
        needed = not unit.has_instance and not parameter.has_initial and parameter.section is t.Section.INPUT
        if parameter.key not in made and (needed or parameter.section is t.Section.IN_OUT):
            raise failure(node, f"the argument '{parameter.name}' of '{unit.name}' is missing")
    return list(made.values())


def _check_argument(checker: Expressions, unit: Unit, parameter: t.Variable, argument: t.Argument) -> t.Argument:
    value, is_output = argument.value, parameter.section is t.Section.OUTPUT
    if is_output != (argument.passing is t.Passing.OUTPUT):
        arrow = "=>" if is_output else ":="
        raise failure(argument, f"'{parameter.name}' of '{unit.name}' is {parameter.section.value}: use {arrow}")
    if parameter.section is t.Section.INPUT:
        expression = coerce(checker.check(value), parameter.type, checker.dialect, is_stored=True)
        return replace(argument, value=expression, parameter=parameter)
    place = checker.check(value)
    check_assignable(checker, place, value)
    if not _same_or_derived(place.type, parameter.type):
        raise failure(argument, f"'{parameter.name}' is {parameter.type}, not {place.type}")
    passing = t.Passing.OUTPUT if is_output else t.Passing.IN_OUT
    return replace(argument, value=place, passing=passing, parameter=parameter)


def _same_or_derived(given: Type, wanted: Type) -> bool:
    if isinstance(given, BlockType) and isinstance(wanted, BlockType):
        return wanted.name.upper() in {name.upper() for name in (given.name, *given.ancestors)}
    return given == wanted


def check_assignable(checker: Expressions, place: t.Expression, node: t.Node) -> None:
    """Whether a place may be assigned from here. Raises `StCheckError`."""
    if not t.is_place(place):
        raise failure(node, "only a variable can be assigned")
    current = place
    while isinstance(current, t.FieldRef | t.ElementRef):
        current = current.base
    if isinstance(current, t.InstanceVariable):
        _check_foreign(checker, current, node)
    if not isinstance(current, t.InstanceVariable | t.VariableRef):
        return
    variable = current.variable
    if variable.is_constant:
        raise failure(node, f"'{variable.name}' is a constant")
    if variable in checker.counters:
        raise failure(node, f"'{variable.name}' counts the FOR loop around and cannot be assigned in it")
    is_own_input = variable.section is t.Section.INPUT and isinstance(current, t.VariableRef)
    if is_own_input and checker.dialect is Dialect.IEC:
        raise failure(node, f"'{variable.name}' is an input and cannot be assigned")


def _check_foreign(checker: Expressions, place: t.InstanceVariable, node: t.Node) -> None:
    """Variables of other instances: TwinCAT lets inputs be assigned outside of the call."""
    variable, block = place.variable, cast(BlockType, place.base.type)
    if variable.section is not t.Section.INPUT:
        raise failure(
            node, f"'{variable.name}' of '{block}' is {variable.section.value} and cannot be assigned from outside"
        )
    if checker.dialect is Dialect.IEC:
        raise failure(node, f"the input '{variable.name}' of '{block}' is given in its call")
