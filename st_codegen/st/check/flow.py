"""Rules about a project as a whole: no recursion, no block inside of itself, results that are set, counters kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.errors import Problem
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, StructType, Type


def check_flow(project: t.Project) -> list[Problem]:
    """All violations of these rules in a checked project."""
    return [
        *_check_circles(project.pous, lambda key: reachable_units(project, key), project, "calls itself"),
        *_check_circles(project.pous, lambda key: _contained(project, key), project, "contains itself"),
        *_check_results(project),
        *_check_counters(project),
    ]


def reachable_units(project: t.Project, key: str) -> set[str]:
    """The keys of all units that the body of a unit may call directly, overriding methods included."""
    found: set[str] = set()
    for call in walk.calls(project.pous[key].body):
        found.add(call.callee)
        if call.is_virtual:
            found |= overriding(project, call.callee)
    return found


def all_reached(project: t.Project, key: str) -> set[str]:
    """A unit and all that it calls or holds an instance of, native ones aside, by key."""
    found: set[str] = set()
    pending = [key]
    while pending:
        unit = project.pous[pending.pop()]
        if unit.key not in found and not unit.is_native:
            found.add(unit.key)
            pending += [call.callee for call in walk.calls(unit.body)]
            pending += [v.type.name.upper() for v in unit.variables if isinstance(v.type, BlockType)]
    return found


def overriding(project: t.Project, key: str) -> set[str]:
    """The keys of the units that a virtual call may reach instead: methods, or bodies of derived blocks."""
    callee = project.pous[key]
    block = callee.block or callee.key
    found: set[str] = set()
    for pou in project.pous.values():
        if pou.kind is PouKind.FUNCTION_BLOCK and any(base.key == block for base in project.lineage(pou.key)):
            if callee.block is None:
                found.add(pou.key)
            elif callee.name.upper() in pou.methods:
                found.add(pou.methods[callee.name.upper()])
    return found


def _contained(project: t.Project, key: str) -> set[str]:
    pou = project.pous[key]
    found = {name for variable in pou.variables for name in _block_types(variable)}
    return found | ({pou.base} if pou.base is not None else set())


def _block_types(variable: t.Variable) -> Iterator[str]:
    if variable.section is t.Section.IN_OUT:
        return
    stack: list[Type] = [variable.type]
    while stack:
        type_ = stack.pop()
        if isinstance(type_, BlockType):
            yield type_.name.upper()
        elif isinstance(type_, ArrayType):
            stack.append(type_.element)
        elif isinstance(type_, StructType):
            stack.extend(entry.type for entry in type_.fields)


def _check_circles(
    keys: Iterable[str], follow: Callable[[str], set[str]], project: t.Project, verb: str
) -> Iterator[Problem]:
    """One problem for each circle of a graph, found depth first without recursion."""
    done: set[str] = set()
    for start in keys:
        path: list[str] = []
        stack: list[tuple[str, bool]] = [(start, False)]
        while stack:
            key, is_leaving = stack.pop()
            if is_leaving:
                path.pop()
                done.add(key)
            elif key in path:
                circle = [*path[path.index(key) :], key]
                names = " -> ".join(project.pous[item].full_name for item in circle)
                yield Problem(project.pous[key].position, f"'{project.pous[key].full_name}' {verb}: {names}")
            elif key not in done:
                path.append(key)
                stack.append((key, True))
                stack.extend((other, False) for other in sorted(follow(key)))


def _check_results(project: t.Project) -> Iterator[Problem]:
    for pou in project.pous.values():
        is_checked = pou.result is not None and not pou.is_native and "ABSTRACT" not in pou.modifiers
        if is_checked and pou.result not in walk.assigned_variables(pou.body):
            yield Problem(pou.position, f"'{pou.name}' never sets its result: {pou.name} := ..;")


def _check_counters(project: t.Project) -> Iterator[Problem]:
    """A method that is called in a loop must not touch the counter, which is a variable of its block."""
    for pou in project.pous.values():
        for loop in walk.statements(pou.body):
            if isinstance(loop, t.For) and loop.variable.storage is t.Storage.INSTANCE:
                for key in _own_calls(project, loop.body):
                    if loop.variable in walk.assigned_variables(project.pous[key].body):
                        name = loop.variable.name
                        yield Problem(
                            loop.position, f"'{project.pous[key].full_name}' assigns '{name}', which counts this loop"
                        )


def _own_calls(project: t.Project, body: Iterable[t.Statement]) -> set[str]:
    """The keys of what a body calls on its own instance, directly or not."""
    found: set[str] = set()
    pending = [body]
    while pending:
        for call in walk.calls(pending.pop()):
            if isinstance(call.receiver, t.ThisRef):
                for key in (call.callee, *(sorted(overriding(project, call.callee)) if call.is_virtual else ())):
                    if key not in found:
                        found.add(key)
                        pending.append(project.pous[key].body)
    return found
