"""Names of variables as a user of a machine writes them: `fOut1`, `aAmplitude[3]`, `fbInner.nState`, `GVL_X.nY`."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.layout import MemoryLayout
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, StructType, Type

_STEP = re.compile(r"(?:\A|\.)\s*([A-Za-z_][A-Za-z0-9_]*)\s*|\[\s*(-?[0-9]+(?:\s*,\s*-?[0-9]+)*)\s*\]\s*")


@dataclass(frozen=True)
class Place:
    """Where a path leads: a type, and how far on from the start it is; or inside of a `constant`."""

    type: Type
    offset: int = 0
    constant: t.Variable | None = None

    def moved(self, offset: int, type_: Type) -> Place:
        """A place of another type, so many bytes farther on in the same memory."""
        return replace(self, type=type_, offset=self.offset + offset)

    def member(self, offset: int, variable: t.Variable) -> Place:
        """A variable of an instance or a list of globals."""
        if variable.section is t.Section.IN_OUT:
            raise StUsageError(f"'{variable.name}' is a VAR_IN_OUT: name the variable that it refers to")
        return Place(variable.type, 0, variable) if variable.is_constant else self.moved(offset, variable.type)


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


def resolve(layout: MemoryLayout, start: Place, path: str) -> Place:
    """Where a path leads to. Raises `StUsageError` for a name or index that does not exist."""
    parts = split_path(path)
    if not parts:
        raise StUsageError("an empty name")
    place = start
    for part in parts:
        place = _element(layout, place, part, path) if isinstance(part, tuple) else _member(layout, place, part, path)
    return place


def _element(layout: MemoryLayout, place: Place, indices: tuple[int, ...], path: str) -> Place:
    type_ = place.type
    if not isinstance(type_, ArrayType) or len(indices) != len(type_.bounds):
        raise StUsageError(f"'{path}': {type_} has no element {list(indices)}")
    flat = 0
    for index, (low, high) in zip(indices, type_.bounds, strict=True):
        if not low <= index <= high:
            raise StUsageError(f"'{path}': index {index} is outside of {low}..{high}")
        flat = flat * (high - low + 1) + index - low
    return place.moved(flat * layout.stride(type_), type_.element)


def _member(layout: MemoryLayout, place: Place, name: str, path: str) -> Place:
    key, type_ = name.upper(), place.type
    if isinstance(type_, StructType) and key in type_.by_key:
        member = layout.record(type_).members[key]
        return place.moved(member.offset, member.type)
    if isinstance(type_, BlockType):
        variable = layout.variable(type_.name, key)
        if variable is not None:
            offset = 0 if variable.is_constant else layout.record(type_).members[key].offset
            return place.member(offset, variable)
    raise StUsageError(f"'{path}': {type_} has no '{name}'")


def ports(project: t.Project, block: str, *sections: t.Section) -> tuple[Port, ...]:
    """The variables of some kinds of a block, in order, inherited ones first."""
    variables = project.block_variables(block)
    return tuple(Port(item.name, item.type, item) for item in variables if item.section in sections)


def find_block(project: t.Project, name: str) -> BlockType:
    """The type of a function block or program. Raises `StUsageError`."""
    pou = project.pous.get(name.upper())
    if pou is None or pou.kind not in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
        known = sorted(other.name for other in project.pous.values() if other.kind is PouKind.FUNCTION_BLOCK)
        raise StUsageError(f"the project has no function block '{name}'; it has {', '.join(known) or 'none'}")
    return BlockType(pou.name, tuple(base.name for base in list(project.lineage(pou.key))[1:]))


def find_global(layout: MemoryLayout, path: str) -> Place:
    """A global variable, by `LIST.name..` or its plain name. Raises `StUsageError`."""
    project, parts = layout.project, split_path(path)
    if not parts:
        raise StUsageError("an empty name")
    first = str(parts[0]).upper()
    match = cast("re.Match[str]", _STEP.match(path))
    if first in project.globals and len(parts) > 1:
        wanted, lists = str(parts[1]).upper(), [project.globals[first]]
        match = cast("re.Match[str]", _STEP.match(path, match.end()))
    else:
        wanted, lists = first, list(project.globals.values())
    found = [variable for variables in lists for variable in variables if variable.key == wanted]
    if len(found) != 1:
        raise StUsageError(f"the project has {'no' if not found else 'more than one'} global variable '{path}'")
    start = Place(found[0].type).member(layout.globals.get(found[0], 0), found[0])
    rest = path[match.end() :]
    return resolve(layout, start, rest) if rest else start
