"""Calls of functions, methods, programs and instances of blocks, and what may be assigned."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from st_codegen.errors import counted, meant
from st_codegen.st import tree as t
from st_codegen.st.check.coercion import coerce
from st_codegen.st.check.names import Scope
from st_codegen.st.check.standard import Check, check_standard_call
from st_codegen.st.check.symbols import DeclaredUnit, failure
from st_codegen.st.tree import PouKind
from st_codegen.st.types import BOOL, BlockType, Type

_PARAMETERS = (t.Section.INPUT, t.Section.OUTPUT, t.Section.IN_OUT)


def check_call(scope: Scope, node: t.Call, check: Check) -> t.Expression:
    """A call in an expression or as a statement; `check` checks expressions. Raises `StCheckError`."""
    function = node.function
    if isinstance(function, t.Member) and _is_library(scope, function.base):
        function = t.Identifier(function.name, position=function.position)
    if isinstance(function, t.Identifier):
        return _call_by_name(scope, function, node, check)
    if isinstance(function, t.Super):
        return _user_call(scope, _base_unit(scope, function), scope.this(function), node, check)
    if isinstance(function, t.Member):
        method = _find_method(scope, function, check)
        if method is not None:
            return _user_call(scope, *method, node, check, is_virtual=not isinstance(function.base, t.Super))
    return _call_instance(scope, check(function), node, check)


def _is_library(scope: Scope, base: t.Expression) -> bool:
    is_name = isinstance(base, t.Identifier) and base.name.upper() in scope.symbols.namespaces
    return is_name and scope.find_variable(cast(t.Identifier, base)) is None


def _call_by_name(scope: Scope, name: t.Identifier, node: t.Call, check: Check) -> t.Expression:
    key, symbols = name.name.upper(), scope.symbols
    if scope.find_variable(name) is not None and key != scope.unit.name.upper():
        return _call_instance(scope, check(name), node, check)
    if scope.block.kind is PouKind.FUNCTION_BLOCK:
        method = symbols.find_method(scope.block.name, key)
        if method is not None:
            return _user_call(scope, method, scope.this(name), node, check, is_virtual=True)
    unit = symbols.units.get(key)
    if unit is not None and unit.kind in (PouKind.FUNCTION, PouKind.PROGRAM):
        return _user_call(scope, unit, scope.find_program(name), node, check)
    standard = check_standard_call(scope.rules, key, node, check)
    if standard is not None:
        return standard
    if unit is not None:
        raise failure(name, f"'{name.name}' is a function block: declare an instance of it and call that")
    known = (other.name for other in symbols.units.values() if other.kind is PouKind.FUNCTION)
    raise failure(name, f"unknown function '{name.name}'{meant(name.name, known)}")


def _base_unit(scope: Scope, node: t.Node) -> DeclaredUnit:
    lineage = list(scope.symbols.lineage(scope.block))
    if len(lineage) < 2:
        raise failure(node, f"'{scope.block.name}' extends nothing, so there is no SUPER^")
    return lineage[1]


def _find_method(scope: Scope, function: t.Member, check: Check) -> tuple[DeclaredUnit, t.Expression] | None:
    """The method that `base.name` is, and its receiver; None when it is no method."""
    base, key = function.base, function.name.upper()
    if isinstance(base, t.Super):
        unit = scope.symbols.find_method(_base_unit(scope, base).name, key)
        if unit is None:
            raise failure(function, f"SUPER^ has no method '{function.name}'")
        return unit, scope.this(base)
    receiver: t.Expression | None = None
    if isinstance(base, t.Identifier) and scope.find_variable(base) is None:
        receiver = scope.find_program(base)
        if receiver is None:
            return None
    receiver = receiver or check(base)
    if not isinstance(receiver.type, BlockType):
        return None
    unit = scope.symbols.find_method(receiver.type.name, key)
    if unit is None:
        if scope.symbols.find_member(receiver.type.name, key) is None:
            raise failure(function, f"'{receiver.type}' has no method '{function.name}'")
        return None
    modifiers = unit.declaration.modifiers if unit.declaration is not None else frozenset()
    if "PRIVATE" in modifiers and unit.block is not scope.block:
        raise failure(function, f"'{function.name}' is a private method of '{receiver.type}'")
    return unit, receiver


def _call_instance(scope: Scope, receiver: t.Expression, node: t.Call, check: Check) -> t.Expression:
    if not isinstance(receiver.type, BlockType):
        raise failure(node, f"{receiver.type} cannot be called")
    unit = scope.symbols.units[receiver.type.name.upper()]
    return _user_call(scope, unit, receiver, node, check, is_virtual=not isinstance(receiver, t.ProgramRef))


def _user_call(
    scope: Scope,
    unit: DeclaredUnit,
    receiver: t.Expression | None,
    node: t.Call,
    check: Check,
    is_virtual: bool = False,
) -> t.Call:
    result = scope.declared.result(unit)
    return replace(
        node,
        arguments=tuple(_check_arguments(scope, unit, node, check)),
        callee=unit.key,
        receiver=receiver,
        is_virtual=is_virtual,
        has_result=result is not None,
        type=BOOL if result is None else result.type,
    )


def _parameters(scope: Scope, unit: DeclaredUnit) -> dict[str, t.Variable]:
    """Inputs, outputs and in-outs, inherited ones of a block first."""
    owners = [unit] if unit.kind is not PouKind.FUNCTION_BLOCK else list(scope.symbols.lineage(unit))[::-1]
    return {
        key: scope.declared.variable(owner, entry)
        for owner in owners
        for key, entry in owner.entries.items()
        if entry.section in _PARAMETERS
    }


def _check_arguments(scope: Scope, unit: DeclaredUnit, node: t.Call, check: Check) -> list[t.Argument]:
    parameters = _parameters(scope, unit)
    positional = [p for p in parameters.values() if p.section is not t.Section.OUTPUT]
    made: dict[str, t.Argument] = {}
    for index, argument in enumerate(node.arguments):
        if argument.name is None:
            if unit.has_instance:
                raise failure(argument, f"arguments of '{unit.name}' are given by name: name := value")
            if index >= len(positional):
                raise failure(
                    argument, f"'{unit.name}' takes {counted(len(positional), 'argument')}, not {len(node.arguments)}"
                )
            parameter = positional[index]
        elif argument.name.upper() in parameters:
            parameter = parameters[argument.name.upper()]
        else:
            hint = meant(argument.name, (p.name for p in parameters.values()))
            raise failure(argument, f"'{unit.name}' has no parameter '{argument.name}'{hint}")
        if parameter.key in made:
            raise failure(argument, f"'{parameter.name}' is given twice")
        if not isinstance(argument.value, t.Omitted):
            made[parameter.key] = _check_argument(scope, unit, parameter, argument, check)
    for parameter in parameters.values():
        needed = not unit.has_instance and not parameter.has_initial and parameter.section is t.Section.INPUT
        if parameter.key not in made and (needed or parameter.section is t.Section.IN_OUT):
            raise failure(node, f"the argument '{parameter.name}' of '{unit.name}' is missing")
    return list(made.values())


def _check_argument(
    scope: Scope, unit: DeclaredUnit, parameter: t.Variable, argument: t.Argument, check: Check
) -> t.Argument:
    is_output = parameter.section is t.Section.OUTPUT
    if is_output != (argument.passing is t.Passing.OUTPUT):
        arrow = "=>" if is_output else ":="
        raise failure(argument, f"'{parameter.name}' of '{unit.name}' is {parameter.section.value}: use {arrow}")
    value = check(argument.value)
    if parameter.section is t.Section.INPUT:
        value = coerce(value, parameter.type, scope.rules, is_stored=True)
        return replace(argument, value=value, parameter=parameter)
    check_assignable(scope, value, argument.value)
    if not _same_or_derived(value.type, parameter.type):
        raise failure(argument, f"'{parameter.name}' is {parameter.type}, not {value.type}")
    passing = t.Passing.OUTPUT if is_output else t.Passing.IN_OUT
    return replace(argument, value=value, passing=passing, parameter=parameter)


def _same_or_derived(given: Type, wanted: Type) -> bool:
    if isinstance(given, BlockType) and isinstance(wanted, BlockType):
        return wanted.name.upper() in {name.upper() for name in (given.name, *given.ancestors)}
    return given == wanted


def check_assignable(scope: Scope, target: t.Expression, node: t.Node) -> None:
    """Whether something may be assigned from here. Raises `StCheckError`."""
    if not t.is_place(target):
        raise failure(node, "only a variable can be assigned")
    current = target
    while isinstance(current, t.FieldRef | t.ElementRef):
        current = current.base
    if isinstance(current, t.InstanceVariable):
        _check_foreign(scope, current, node)
    if not isinstance(current, t.InstanceVariable | t.VariableRef):
        return
    variable = current.variable
    if variable.is_constant:
        raise failure(node, f"'{variable.name}' is a constant")
    if variable in scope.counters:
        raise failure(node, f"'{variable.name}' counts the FOR loop around and cannot be assigned in it")
    is_own_input = variable.section is t.Section.INPUT and isinstance(current, t.VariableRef)
    if is_own_input and not scope.rules.has_assignable_inputs:
        raise failure(node, f"'{variable.name}' is an input and cannot be assigned")


def _check_foreign(scope: Scope, target: t.InstanceVariable, node: t.Node) -> None:
    """Variables of other instances: some dialects let their inputs be assigned outside of the call."""
    variable, block = target.variable, target.base.type
    if variable.section is not t.Section.INPUT:
        raise failure(
            node, f"'{variable.name}' of '{block}' is {variable.section.value} and cannot be assigned from outside"
        )
    if not scope.rules.has_assignable_inputs:
        raise failure(node, f"the input '{variable.name}' of '{block}' is given in its call")
