"""Names of variables as a user of a machine writes them: `fOut1`, `aAmplitude[3]`, `fbInner.nState`, `GVL_X.nY`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.errors import StUsageError
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, StructType, Type

_STEP = re.compile(r"(?:\A|\.)\s*([A-Za-z_][A-Za-z0-9_]*)\s*|\[\s*(-?[0-9]+(?:\s*,\s*-?[0-9]+)*)\s*\]\s*")


@dataclass(frozen=True)
class Step:
    """One step of a path: to a variable or field by upper-case `name`, or to the element `index`, counted from zero.

    `number` is the place of a field in its union, None outside of unions.
    """

    type: Type
    name: str | None = None
    index: int = 0
    number: int | None = None
    variable: t.Variable | None = None


@dataclass(frozen=True)
class Port:
    """An input or output of a block."""

    name: str
    type: Type
    variable: t.Variable


def split_path(path: str) -> list[str | tuple[int, ...]]:
    """The names and indices of a path. Raises `StUsageError`."""
    found: list[str | tuple[int, ...]] = []
    at = 0
    while at < len(path):
        match = _STEP.match(path, at)
        if match is None:
            raise StUsageError(f"'{path}' is no name of a variable: 'a', 'a.b' or 'a[1, 2]' is expected")
        found.append(match[1] if match[1] is not None else tuple(int(part) for part in match[2].split(",")))
        at = match.end()
    return found


def resolve(project: t.Project, start: Type, path: str) -> list[Step]:
    """The steps from an instance to a variable. Raises `StUsageError` for a name or index that does not exist."""
    steps: list[Step] = []
    type_ = start
    for part in split_path(path):
        step = _element(type_, part, path) if isinstance(part, tuple) else _member(project, type_, part, path)
        steps.append(step)
        type_ = step.type
    if not steps:
        raise StUsageError("an empty name")
    return steps


def _element(type_: Type, indices: tuple[int, ...], path: str) -> Step:
    if not isinstance(type_, ArrayType) or len(indices) != len(type_.bounds):
        raise StUsageError(f"'{path}': {type_} has no element {list(indices)}")
    flat = 0
    for index, (low, high) in zip(indices, type_.bounds, strict=True):
        if not low <= index <= high:
            raise StUsageError(f"'{path}': index {index} is outside of {low}..{high}")
        flat = flat * (high - low + 1) + index - low
    return Step(type_.element, index=flat)


def _member(project: t.Project, type_: Type, name: str, path: str) -> Step:
    key = name.upper()
    if isinstance(type_, StructType) and key in type_.by_key:
        number = list(type_.by_key).index(key) if type_.is_union else None
        return Step(type_.by_key[key].type, name=key, number=number)
    if isinstance(type_, BlockType):
        variable = next((item for item in project.block_variables(type_.name) if item.key == key), None)
        if variable is not None:
            return Step(variable.type, name=key, variable=variable)
    raise StUsageError(f"'{path}': {type_} has no '{name}'")


def ports(project: t.Project, block: str, *sections: t.Section) -> tuple[Port, ...]:
    """The variables of some kinds of a block, in order, inherited ones first."""
    variables = project.block_variables(block)
    return tuple(Port(item.name, item.type, item) for item in variables if item.section in sections)


def find_block(project: t.Project, name: str) -> BlockType:
    """The type of a function block or program. Raises `StUsageError`."""
    pou = project.pous.get(name.upper())
    if pou is None or pou.kind not in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
        known = sorted(other.name for other in project.pous.values() if other.kind in (PouKind.FUNCTION_BLOCK,))
        raise StUsageError(f"the project has no function block '{name}'; it has {', '.join(known) or 'none'}")
    return BlockType(pou.name, tuple(base.name for base in list(project.lineage(pou.key))[1:]))


def find_global(project: t.Project, path: str) -> tuple[t.Variable, str]:
    """A global variable, by `LIST.name..` or its plain name, and the rest of the path. Raises `StUsageError`."""
    parts = split_path(path)
    first = str(parts[0]).upper()
    if first in project.globals and len(parts) > 1:
        wanted, lists = str(parts[1]).upper(), [project.globals[first]]
        rest = _STEP.match(path, cast("re.Match[str]", _STEP.match(path)).end())
    else:
        wanted, lists = first, list(project.globals.values())
        rest = _STEP.match(path)
    found = [variable for variables in lists for variable in variables if variable.key == wanted]
    if len(found) != 1 or rest is None:
        raise StUsageError(f"the project has {'no' if not found else 'more than one'} global variable '{path}'")
    return found[0], path[rest.end() :]
