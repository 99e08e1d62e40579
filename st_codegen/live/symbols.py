"""The variables of a running project by name, as bytes in the layout of a controller.

The engine keeps strings and structures in a layout of its own; a TwinCAT controller aligns every field of a structure
to its own size, as C does, and ends a string with a zero byte.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.errors import counted
from st_codegen.st import Machine, StUsageError
from st_codegen.st import tree as t
from st_codegen.st.run.layout import dtype_of
from st_codegen.st.run.memory import Memory
from st_codegen.st.run.paths import Place
from st_codegen.st.types import ArrayType, BlockType, Elementary, EnumType, Kind, PointerType, StructType, Type
from st_codegen.st.walk import assigned_places


@dataclass(frozen=True)
class WirePart:
    """Bytes that are copied as they are, or a text of at most `characters`."""

    wire: int
    memory: int
    size: int
    characters: int = 0


@dataclass
class WireVariable:
    """A variable: where it is, how it looks on the wire, and whether a client may write it."""

    name: str
    type: Type
    memory: Memory
    size: int
    parts: tuple[WirePart, ...]
    is_input: bool

    def read(self) -> bytes:
        """The present value as a controller would send it."""
        row = self.memory.bytes[0]
        if len(self.parts) == 1 and not self.parts[0].characters:
            part = self.parts[0]
            return bytes(row[part.memory : part.memory + part.size])
        found = bytearray(self.size)
        for part in self.parts:
            content = row[part.memory : part.memory + part.size].tobytes()
            if part.characters:
                text = content.decode("utf-32-le").rstrip("\0")
                content = text.encode("cp1252", "replace")
            found[part.wire : part.wire + len(content)] = content
        return bytes(found)

    def write(self, data: bytes) -> None:
        """Set the value. Raises ValueError for bytes of another length, or which no variable of the type has."""
        if len(data) != self.size:
            raise ValueError(f"{self.name} has {counted(self.size, 'byte')}, not the {len(data)} that were sent")
        row = self.memory.bytes[0]
        for part in self.parts:
            if part.characters:
                content = data[part.wire : part.wire + part.characters].split(b"\0", 1)[0].decode("cp1252", "replace")
                raw = content.encode("utf-32-le").ljust(part.size, b"\0")
            else:
                raw = data[part.wire : part.wire + part.size]
            row[part.memory : part.memory + part.size] = np.frombuffer(raw, np.uint8)
        if _is_of(self.type, Kind.BOOL):
            at = slice(self.parts[0].memory, self.parts[0].memory + self.size)
            row[at] = row[at] != 0


def _is_of(type_: Type, kind: Kind) -> bool:
    inner = type_.element if isinstance(type_, ArrayType) else type_
    return isinstance(inner, Elementary) and inner.kind is kind


class WireVariables:
    """All variables of a machine; names are found whatever their case."""

    def __init__(self, machine: Machine, inputs: frozenset[str], spelling: Mapping[str, str]) -> None:
        self._spelling = spelling
        self._machine = machine
        self._inputs = inputs
        self._found: dict[str, WireVariable] = {}
        self._declared = {name.upper(): name for name in self.names()}

    def __getitem__(self, name: str) -> WireVariable:
        """The variable of a name such as `GVL_X.aY[3]`. Raises KeyError where there is none."""
        key = name.upper()
        if key not in self._found:
            try:
                memory, place = self._machine.find(name)
                if place.constant is not None:  # a constant stands in the code
                    raise KeyError(name)
                size, parts = self._laid_out(place)
            except StUsageError as error:
                raise KeyError(name) from error
            root = ".".join(key.split(".")[:2]).split("[", maxsplit=1)[0]
            self._found[key] = WireVariable(
                self._declared.get(key, name), place.type, memory, size, parts, root in self._inputs
            )
        return self._found[key]

    def names(self) -> Iterator[str]:
        """The names of all variables that have a value as a whole, those of instances one by one."""
        project = self._machine.project
        for list_name, variables in project.globals.items():
            for variable in variables:
                yield from self._inside(f"{self._spelling.get(list_name, list_name)}.{variable.name}", variable)
        for key in self._machine.layout.programs:
            pou = project.pous[key]
            for variable in project.block_variables(pou.name):
                yield from self._inside(f"{pou.name}.{variable.name}", variable)

    def _inside(self, name: str, variable: t.Variable) -> Iterator[str]:
        if variable.is_constant or variable.section is t.Section.IN_OUT:
            return
        if isinstance(variable.type, BlockType):
            for inner in self._machine.project.block_variables(variable.type.name):
                yield from self._inside(f"{name}.{inner.name}", inner)
        elif _has_value(variable.type):
            yield name

    def _laid_out(self, place: Place) -> tuple[int, tuple[WirePart, ...]]:
        """The bytes on the wire and where they come from, neighbours together. Raises StUsageError."""
        if not _has_value(place.type):
            raise StUsageError(f"{place.type} has no value of its own")
        found: list[WirePart] = []
        for part in self._parts(place.type, 0, place.offset):
            last = found[-1] if found else None
            if (
                last is not None
                and not last.characters
                and not part.characters
                and last.wire + last.size == part.wire
                and last.memory + last.size == part.memory
            ):
                found[-1] = WirePart(last.wire, last.memory, last.size + part.size)
            else:
                found.append(part)
        return wire_dtype(place.type).itemsize, tuple(found)

    def _parts(self, type_: Type, wire: int, memory: int) -> Iterator[WirePart]:
        layout = self._machine.layout
        if isinstance(type_, ArrayType):
            size = wire_dtype(type_.element).itemsize
            if isinstance(type_.element, Elementary | EnumType) and not _is_of(type_.element, Kind.STRING):
                yield WirePart(wire, memory, size * type_.size)
                return
            for number in range(type_.size):
                yield from self._parts(type_.element, wire + number * size, memory + number * layout.stride(type_))
        elif isinstance(type_, StructType):
            members, fields = layout.record(type_).members, dict(wire_dtype(type_).fields or {})
            for entry in type_.fields:
                own, offset = members[entry.name.upper()].offset, fields[entry.name][1]
                yield from self._parts(entry.type, wire + offset, memory + own)
        elif isinstance(type_, Elementary) and type_.kind is Kind.STRING:
            yield WirePart(wire, memory, layout.size_of(type_), type_.bits)
        else:
            yield WirePart(wire, memory, dtype_of(type_).itemsize)


def _has_value(type_: Type) -> bool:
    """Whether a variable has a value as a whole: an instance has none, nor has an address."""
    if isinstance(type_, ArrayType):
        return _has_value(type_.element)
    if isinstance(type_, StructType):
        return all(_has_value(entry.type) for entry in type_.fields)
    return isinstance(type_, Elementary | EnumType) and not isinstance(type_, PointerType)


def wire_dtype(type_: Type) -> np.dtype[Any]:
    """The bytes of a variable on a controller, whose C aligns as that of 64-bit machines does."""
    if isinstance(type_, ArrayType):
        return np.dtype((wire_dtype(type_.element), (type_.size,)))
    if isinstance(type_, StructType):
        names, formats = [entry.name for entry in type_.fields], [wire_dtype(entry.type) for entry in type_.fields]
        if type_.is_union:
            return np.dtype({"names": names, "formats": formats, "offsets": [0] * len(names)}, align=True)
        return np.dtype({"names": names, "formats": formats}, align=True)
    if isinstance(type_, Elementary) and type_.kind is Kind.STRING:
        return np.dtype(f"S{type_.bits + 1}")
    return dtype_of(type_)


def type_name(type_: Type) -> str:
    """The name of a type as TwinCAT tells it to clients."""
    if isinstance(type_, ArrayType):
        bounds = ",".join(f"{low}..{high}" for low, high in type_.bounds)
        return f"ARRAY [{bounds}] OF {type_name(type_.element)}"
    return str(type_)


def assigned_globals(project: t.Project, but_by: frozenset[str]) -> frozenset[str]:
    """The global variables that the text assigns or hands to a block as VAR_IN_OUT, as `LIST.NAME` in upper case.

    `but_by`: programs that do not count, in upper case.
    """
    roots = (
        t.root_variable(place)
        for key, pou in project.pous.items()
        if key not in but_by
        for place in assigned_places(pou.body)
    )
    return frozenset(f"{root.owner}.{root.key}" for root in roots if root and root.storage is t.Storage.GLOBAL)
