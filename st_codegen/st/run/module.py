"""What the units of a project share while they are compiled: names, constants, places that can stop a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.run.layout import MemoryLayout, aligned, dtype_of
from st_codegen.st.run.writer import Site
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, PointerType, Type


@dataclass(frozen=True)
class NativeSite:
    """A call of native code: what its frame holds, by upper-case name, behind the address of the instance.

    Of in-outs and of pointers to variables the frame holds the variables themselves.
    """

    number: int
    pou: t.Pou
    offsets: Mapping[str, int]
    types: Mapping[str, Type]
    pointers: frozenset[str]
    null_pointers: frozenset[str]
    block: BlockType | None
    block_offset: int
    size: int


class Module:
    """The parts of a project that its compiled units refer to."""

    def __init__(self, project: t.Project, loop_limit: int, functions: Mapping[str, str]) -> None:
        self.project = project
        self.layout = MemoryLayout(project)
        self.loop_limit = loop_limit
        self.functions = functions
        self.sites: list[Site] = []
        self.native_sites: list[NativeSite] = []
        self.frame_bytes = 16
        self.uses_programs = False
        self._kept: list[NDArray[Any]] = []
        self._tables: dict[t.Variable, str] = {}
        self._data: dict[bytes, str] = {}

    def reserve(self, size: int) -> int:
        """Room in the frame of a row; its offset."""
        offset = self.frame_bytes
        self.frame_bytes += aligned(size, 16)
        return offset

    def instance_type(self, pou: t.Pou) -> BlockType:
        """The type of the instance that a unit runs on."""
        return BlockType(self.project.pous[pou.block].name if pou.block is not None else pou.name)

    # --- constants ---

    def table(self, variable: t.Variable) -> str:
        """The address of a constant structure or array, which all rows share."""
        if variable not in self._tables:
            type_, value = variable.type, variable.initial
            if (
                isinstance(type_, ArrayType)
                and isinstance(value, np.ndarray)
                and value.dtype == dtype_of(type_.element)
            ):
                self._tables[variable] = self._address(np.ascontiguousarray(value))
            else:
                self._tables[variable] = self.data(self.layout.image(type_, value))
        return self._tables[variable]

    def data(self, content: bytes) -> str:
        """The address of some bytes that nothing changes."""
        if content not in self._data:
            self._data[content] = self._address(np.frombuffer(bytearray(content), np.uint8))
        return self._data[content]

    def _address(self, content: NDArray[Any]) -> str:
        self._kept.append(content)
        return absolute(content.ctypes.data)

    # --- native code ---

    def native_site(
        self, pou: t.Pou, variables: Iterable[t.Variable], pointees: Mapping[t.Variable, Type], is_listed: bool = True
    ) -> NativeSite:
        """A new call of native code; `pointees` are the types that given pointers point to.

        Code refers to those that are listed, by their number.
        """
        nulls: set[str] = set()
        offsets: dict[str, int] = {}
        types: dict[str, Type] = {}
        end = 8
        for variable in variables:
            type_ = pointees.get(variable, variable.type)
            if variable in pointees or not isinstance(variable.type, PointerType):
                offsets[variable.key] = end
                types[variable.key] = type_
            else:
                nulls.add(variable.key)
            end += aligned(self.layout.size_of(type_), 8)
        has_instance = pou.block is not None or pou.kind is PouKind.FUNCTION_BLOCK
        block = self.instance_type(pou) if has_instance else None
        size = end + (0 if block is None else self.layout.size_of(block))
        pointers = frozenset(variable.key for variable in pointees)
        number = len(self.native_sites) if is_listed else -1
        site = NativeSite(number, pou, offsets, types, pointers, frozenset(nulls), block, end, size)
        if is_listed:
            self.native_sites.append(site)
        return site


def absolute(address: int) -> str:
    """An address in the code."""
    return f"inttoptr (i64 {address} to ptr)"
