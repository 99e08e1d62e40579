"""The checker: from declarations to a typed project, or to all of its errors at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import MappingProxyType
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.check.declare import Declarations
from st_codegen.st.check.flow import check_flow
from st_codegen.st.check.statements import Statements
from st_codegen.st.check.symbols import DeclaredUnit, Symbols, failure, noted
from st_codegen.st.dialects import Dialect
from st_codegen.st.errors import Problem, StCheckError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.source import ParsedFiles
from st_codegen.st.tree import PouKind
from st_codegen.st.types import Type


def check(
    source: ParsedFiles, dialect: Dialect, native: Iterable[d.Declaration] = (), namespaces: Iterable[str] = ()
) -> t.Project:
    """Check a project; `native` are declarations of blocks and functions that Python executes.

    `namespaces` are names that may stand in front of what a library declares. Raises `StCheckError` with every problem.
    """
    symbols = Symbols(dialect, source.declarations, native, namespaces)
    problems = symbols.problems
    declarations = Declarations(symbols)
    types = _types(symbols, declarations, problems)
    for unit in (*symbols.lists.values(), *symbols.units.values()):
        _declare(declarations, unit, problems)
    for configuration in symbols.configurations:
        problems += _configuration_problems(configuration, symbols)
    pous = {key: pou for key, unit in symbols.units.items() if (pou := _pou(declarations, unit, problems)) is not None}
    if problems:
        raise StCheckError(problems)
    lists = {key: _variables(declarations, unit) for key, unit in symbols.lists.items()}
    project = t.Project(MappingProxyType(pous), MappingProxyType(types), MappingProxyType(lists))
    problems += check_flow(project)
    if problems:
        raise StCheckError(problems)
    return project


def _configuration_problems(configuration: d.ConfigurationDeclaration, symbols: Symbols) -> Iterator[Problem]:
    """Tasks without a time, and calls of programs or by tasks that there are not."""
    tasks = {task.name.upper() for task in configuration.tasks}
    for task in configuration.tasks:
        is_time = isinstance(task.interval, t.Literal) and task.interval.kind is t.LiteralKind.TIME
        if not (is_time and cast(int, cast(t.Literal, task.interval).value) > 0):
            yield Problem(task.position, f"the task '{task.name}' needs a time above zero between its calls")
        if not (isinstance(task.priority, t.Literal) and task.priority.kind is t.LiteralKind.INTEGER):
            yield Problem(task.position, f"the priority of the task '{task.name}' is no whole number")
    for instance in configuration.programs:
        unit = symbols.units.get(instance.program.upper())
        if unit is None or unit.kind is not PouKind.PROGRAM:
            yield Problem(instance.position, f"there is no program '{instance.program}'")
        if instance.task.upper() not in tasks:
            yield Problem(instance.position, f"there is no task '{instance.task}'")


def _types(symbols: Symbols, declarations: Declarations, problems: list[Problem]) -> dict[str, Type]:
    types: dict[str, Type] = {}
    for key, declaration in symbols.types.items():
        with noted(problems):
            type_ = declarations.find_type(declaration.name)
            if type_ is not None:
                types[key] = type_
    return types


def _declare(declarations: Declarations, unit: DeclaredUnit, problems: list[Problem]) -> None:
    with noted(problems):
        _check_lineage(declarations, unit)
        declarations.result(unit)
    for entry in unit.entries.values():
        with noted(problems):
            declarations.variable(unit, entry)


def _check_lineage(declarations: Declarations, unit: DeclaredUnit) -> None:
    if unit.kind is not PouKind.FUNCTION_BLOCK:
        return
    for base in list(declarations.symbols.lineage(unit))[1:]:
        for key, entry in unit.entries.items():
            if key in base.entries:
                raise failure(entry.declaration, f"'{entry.declaration.name}' is declared already in '{base.name}'")
        for name, method in unit.methods.items():
            if name in base.methods:
                _check_override(declarations, method, base.methods[name])


def _check_override(declarations: Declarations, method: DeclaredUnit, base: DeclaredUnit) -> None:
    """An overriding method is called through the one it overrides, so both must look the same."""

    def interface(unit: DeclaredUnit) -> list[object]:
        result = declarations.result(unit)
        sections = (t.Section.INPUT, t.Section.OUTPUT, t.Section.IN_OUT)
        entries = [entry for entry in unit.entries.values() if entry.section in sections]
        parameters = [(declarations.variable(unit, entry), entry.section) for entry in entries]
        return [None if result is None else result.type, *((v.key, v.type, section) for v, section in parameters)]

    if interface(method) != interface(base):
        raise failure(
            method.position, f"'{method.name}' has other parameters or another result than the method it overrides"
        )


def _variables(declarations: Declarations, unit: DeclaredUnit) -> tuple[t.Variable, ...]:
    return tuple(declarations.variable(unit, entry) for entry in unit.entries.values())


def _pou(declarations: Declarations, unit: DeclaredUnit, problems: list[Problem]) -> t.Pou | None:
    """The typed unit; None when a declaration in it is wrong, which was reported before."""
    declaration = unit.declaration
    if declaration is None or unit.kind is None:
        return None
    try:
        body = Statements(declarations, unit, problems).body(declaration.body)
        base = declaration.base
        return t.Pou(
            unit.kind,
            unit.name,
            unit.key,
            _variables(declarations, unit),
            body,
            unit.position,
            declarations.result(unit),
            block=None if unit.block is None else unit.block.key,
            base=None if base is None else base.upper().rpartition(".")[2],
            methods=MappingProxyType({name: method.key for name, method in unit.methods.items()}),
            modifiers=declaration.modifiers,
            is_native=unit.is_native,
        )
    except StCheckError as error:
        problems += error.problems
        return None
