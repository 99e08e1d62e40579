"""Where every variable is: offsets in the flat records that instances, programs and global variables are stored in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

from st_codegen.st import tree as t
from st_codegen.st import types
from st_codegen.st.tree import PouKind

POINTER_BYTES = 8


@dataclass(frozen=True)
class RecordMember:
    """A part of a structure or instance: where it begins, its type, and the variable it is (None: a field)."""

    offset: int
    type: types.Type
    variable: t.Variable | None = None

    @property
    def is_reference(self) -> bool:
        """Whether only the address of a variable is stored here."""
        return self.variable is not None and self.variable.section is t.Section.IN_OUT


@dataclass(frozen=True)
class Record:
    """Members by upper-case name, and the bytes of the whole."""

    members: dict[str, RecordMember]
    size: int


def is_scalar(type_: types.Type) -> bool:
    """Whether values of a type live in registers: numbers, BOOL, enumerations, addresses; strings do not."""
    return isinstance(type_, types.EnumType | types.PointerType) or (
        isinstance(type_, types.Elementary) and type_.kind is not types.Kind.STRING
    )


def is_inlined(variable: t.Variable) -> bool:
    """Whether a variable is a constant that stands in the code itself."""
    return variable.is_constant and is_scalar(variable.type)


def dtype_of(type_: types.Type) -> np.dtype[np.generic]:
    """How values of an elementary type or an enumeration are stored."""
    if isinstance(type_, types.PointerType):
        return np.dtype(np.uint64)
    stored = types.storage_type(type_)
    return np.dtype(f"U{max(stored.bits, 1)}") if stored.kind is types.Kind.STRING else stored.dtype


class MemoryLayout:
    """The records of one project.

    Two records exist once in a row: the global variables, and the programs. Constants are not part of any record.
    """

    def __init__(self, project: t.Project) -> None:
        self.project = project
        self.globals: dict[t.Variable, int] = {}
        self.programs: dict[str, int] = {}
        self._variables: dict[str, dict[str, t.Variable]] = {}
        self._records: dict[str, Record] = {}
        self._images: dict[str, bytes] = {}
        end = 0
        for variable in (item for variables in project.globals.values() for item in variables):
            if not variable.is_constant:
                self.globals[variable] = aligned(end, self.alignment(variable.type))
                end = self.globals[variable] + self.size_of(variable.type)
        self.global_bytes, end = end, 0
        for key, pou in project.pous.items():
            if pou.kind is PouKind.PROGRAM:
                self.programs[key] = end
                end += self.size_of(types.BlockType(pou.name))
        self.has_natives = any(pou.is_native for pou in project.pous.values())

    def variable(self, block: str, key: str) -> t.Variable | None:
        """A variable of a block by its upper-case name."""
        if block not in self._variables:
            self._variables[block] = {item.key: item for item in self.project.block_variables(block)}
        return self._variables[block].get(key)

    def size_of(self, type_: types.Type) -> int:
        """Bytes of a variable."""
        if isinstance(type_, types.ArrayType):
            return self.stride(type_) * type_.size
        if isinstance(type_, types.StructType | types.BlockType):
            return self.record(type_).size
        return dtype_of(type_).itemsize

    def stride(self, type_: types.ArrayType) -> int:
        """Bytes from one element of an array to the next."""
        return aligned(self.size_of(type_.element), self.alignment(type_.element))

    def alignment(self, type_: types.Type) -> int:
        """What the address of a variable is a multiple of."""
        if isinstance(type_, types.ArrayType):
            return self.alignment(type_.element)
        if isinstance(type_, types.StructType | types.BlockType):
            return POINTER_BYTES
        return 4 if dtype_of(type_).kind == "U" else dtype_of(type_).itemsize

    def record(self, type_: types.StructType | types.BlockType) -> Record:
        """The members of a structure, union or instance."""
        key = f"{type(type_).__name__} {type_.name.upper()}"
        if key not in self._records:
            if isinstance(type_, types.StructType):
                made = self._placed(((entry.name.upper(), entry.type, None) for entry in type_.fields), type_.is_union)
            else:
                variables = self.project.block_variables(type_.name)
                made = self._placed((item.key, item.type, item) for item in variables if not item.is_constant)
            self._records[key] = made
        return self._records[key]

    def _placed(self, entries: Iterable[tuple[str, types.Type, t.Variable | None]], is_union: bool = False) -> Record:
        members: dict[str, RecordMember] = {}
        size = end = 0
        for name, type_, variable in entries:
            is_reference = variable is not None and variable.section is t.Section.IN_OUT
            offset = aligned(0 if is_union else end, POINTER_BYTES if is_reference else self.alignment(type_))
            members[name] = RecordMember(offset, type_, variable)
            end = offset + (POINTER_BYTES if is_reference else self.size_of(type_))
            size = max(size, end)
        return Record(members, max(aligned(size, POINTER_BYTES), POINTER_BYTES))

    # --- initial contents ---

    def image(self, type_: types.Type, value: types.Value) -> bytes:
        """A variable with an initial value, as bytes."""
        if isinstance(type_, types.BlockType) and not value:
            return self._block_image(type_)
        memory = bytearray(self.size_of(type_))
        self._write(memory, 0, type_, value)
        return bytes(memory)

    def _block_image(self, type_: types.BlockType) -> bytes:
        key = type_.name.upper()
        if key not in self._images:
            record = self.record(type_)
            memory = bytearray(record.size)
            for member in record.members.values():
                if member.variable is not None and not member.is_reference:
                    self._write(memory, member.offset, member.type, member.variable.initial)
            self._images[key] = bytes(memory)
        return self._images[key]

    def _write(self, memory: bytearray, at: int, type_: types.Type, value: types.Value) -> None:
        if isinstance(type_, types.ArrayType):
            if isinstance(value, np.ndarray):
                content = value.astype(dtype_of(type_.element)).tobytes()
                memory[at : at + len(content)] = content
            elif isinstance(value, list):
                for number, item in enumerate(value):
                    self._write(memory, at + number * self.stride(type_), type_.element, item)
        elif isinstance(type_, types.BlockType):
            memory[at : at + self.size_of(type_)] = self._block_image(type_)
            self._write_members(memory, at, type_, cast("dict[str, types.Value]", value))
        elif isinstance(type_, types.StructType):
            self._write_members(memory, at, type_, cast("dict[str, types.Value]", value))
        elif not isinstance(type_, types.PointerType):
            content = np.array(value, dtype_of(type_)).tobytes()
            memory[at : at + len(content)] = content

    def _write_members(
        self, memory: bytearray, at: int, type_: types.StructType | types.BlockType, values: dict[str, types.Value]
    ) -> None:
        members = self.record(type_).members
        for name, value in values.items():
            if name in members and not members[name].is_reference:
                self._write(memory, at + members[name].offset, members[name].type, value)

    def global_image(self) -> bytes:
        """All global variables with their initial values."""
        memory = bytearray(self.global_bytes)
        for variable, offset in self.globals.items():
            self._write(memory, offset, variable.type, variable.initial)
        return bytes(memory)

    def program_image(self) -> bytes:
        """All programs with their initial values."""
        return b"".join(self._block_image(types.BlockType(self.project.pous[key].name)) for key in self.programs)

    def natives(self, type_: types.Type, at: int = 0) -> Iterator[tuple[int, types.BlockType, t.Pou]]:
        """The instances of native blocks in a variable: their offsets, types, and native units."""
        if not self.has_natives:
            return
        if isinstance(type_, types.ArrayType):
            if isinstance(type_.element, types.ArrayType | types.StructType | types.BlockType):
                for number in range(type_.size):
                    yield from self.natives(type_.element, at + number * self.stride(type_))
        elif isinstance(type_, types.StructType | types.BlockType):
            if isinstance(type_, types.BlockType):
                yield from ((at, type_, pou) for pou in self.project.lineage(type_.name) if pou.is_native)
            for member in self.record(type_).members.values():
                if not member.is_reference:
                    yield from self.natives(member.type, at + member.offset)


def aligned(size: int, alignment: int) -> int:
    """The next multiple."""
    return -(-size // alignment) * alignment
