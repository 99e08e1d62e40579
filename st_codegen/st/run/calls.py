"""Calls of native code from a run: finds the Python object, and shows it the frames that the code has filled."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError
from st_codegen.st import tree as t
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.layout import MemoryLayout, dtype_of
from st_codegen.st.run.memory import Memory, shown, view
from st_codegen.st.run.module import Module, NativeSite
from st_codegen.st.run.natives import Host, Library, NativeBlock, NativeCall, NativeFunction, Values
from st_codegen.st.run.paths import Place, resolve, split_path
from st_codegen.st.types import ArrayType, BlockType, Elementary, EnumType, Type

#: Called by code with a row, the number of a place, and the address of a frame; gives 0, or 1 to stop the run.
CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)
Frames = NDArray[np.uint8]


@dataclass(frozen=True)
class FramePointer:
    """What native code is given for an address: the variable itself, in the frames of the calling rows."""

    frames: Frames
    offset: int
    type: Type

    def _view(self) -> Values:
        element, shape = (self.type.element, (self.type.size,)) if isinstance(self.type, ArrayType) else (self.type, ())
        if not isinstance(element, Elementary | EnumType):
            raise StUsageError(f"native code reads numbers behind an address, not {self.type}")
        return view(self.frames, self.offset, dtype_of(element), shape)

    def read(self) -> Values:
        """The variable in the calling rows, shape (rows,), or the array, shape (rows, elements)."""
        return self._view().copy()

    def write(self, values: Any) -> None:
        """Assign the variable or the array in the calling rows."""
        self._view()[...] = values


class NativeCalls:
    """The native side of one machine."""

    def __init__(self, host: Host, module: Module, libraries: Iterable[Library]) -> None:
        self._host = host
        self._module = module
        self._blocks: dict[str, type[NativeBlock]] = {}
        self._functions: dict[str, NativeFunction] = {}
        for library in libraries:
            self._blocks |= {name.upper(): cls for name, cls in library.blocks.items()}
            self._functions |= {name.upper(): function for name, function in library.functions.items()}
        pous = module.project.pous.values()
        known = self._blocks.keys() | self._functions.keys()
        missing = [pou.name for pou in pous if pou.is_native and pou.block is None and pou.key not in known]
        if missing:
            raise InputError(f"give the machine the libraries the project was checked with: {', '.join(missing)}")
        # What a run may change. Code may have kept the address of another instance: all live as long as the machine
        self.memories: list[Memory] = []
        self._owners: dict[int, tuple[Memory, int, BlockType]] = {}
        self._sites: dict[str, NativeSite] = {}
        self.raised: Exception | None = None
        self.callback = CALLBACK(self._called)

    def attach(self, memory: Memory, type_: Type, at: int = 0) -> None:
        """Make the Python objects of the native blocks in a variable."""
        if memory not in self.memories[-1:]:
            self.memories.append(memory)
        for offset, block, pou in self._module.layout.natives(type_, at):
            memory.natives[offset] = self._blocks[pou.key](self._host)
            self._owners[id(memory.natives[offset])] = (memory, offset, block)

    def owner(self, native: NativeBlock) -> tuple[Memory, int, BlockType]:
        """The instance that a native block belongs to: its memory, its offset, its type."""
        return self._owners[id(native)]

    @property
    def may_run_bodies(self) -> bool:
        """Whether native code of the libraries may call bodies of instances that no code refers to."""
        return bool(self._functions) or any(not block.is_pure for block in self._blocks.values())

    @property
    def are_pure(self) -> bool:
        """Whether all native code that compiled units call may be called more often than they say."""
        sites = self._module.native_sites
        return all(site.block is not None and self._blocks[site.block.name.upper()].is_pure for site in sites)

    def _called(self, row: int, number: int, frame: int) -> int:
        site = self._module.native_sites[number]
        content = np.ctypeslib.as_array((ctypes.c_uint8 * site.size).from_address(frame)).reshape(1, -1)
        try:
            self.answer(site, content, np.array([row], np.int64))
        except Exception as error:  # what Python raises must not pass through machine code
            self.raised = error
            return 1
        return 0

    def answer(self, site: NativeSite, frames: Frames, rows: NDArray[np.int64]) -> None:
        """Run native code for one place in some rows; it changes their frames."""
        if site.block is None:
            self._functions[site.pou.key](self._call(site, frames, rows))
            return
        addresses = np.array(view(frames, 0, np.dtype(np.uint64), ()))
        memory = self._memory_of(int(addresses[0]), site)
        offsets = addresses - memory.addresses()[rows]
        for offset in np.unique(offsets):
            chosen = np.flatnonzero(offsets == offset)
            part = frames if len(chosen) == len(frames) else frames[chosen]
            native = memory.natives[int(offset)]
            method = native.body if site.pou.block is None else getattr(native, site.pou.name)
            method(self._call(site, part, rows[chosen]))
            if part is not frames:
                frames[chosen] = part

    def _memory_of(self, address: int, site: NativeSite) -> Memory:
        for memory in self.memories:
            if 0 <= address - memory.address < memory.bytes.size:
                return memory
        raise StUsageError(f"an instance of {site.block} as a local variable is not supported")

    def _call(self, site: NativeSite, frames: Frames, rows: NDArray[np.int64]) -> NativeCall:
        variables = _Variables(self._module.layout, site, frames)
        return NativeCall(self._host, rows, variables.get, variables.set)

    def site_of(self, pou: t.Pou) -> NativeSite:
        """The place from which a user calls the body of a native block."""
        if pou.key not in self._sites:
            self._sites[pou.key] = self._module.native_site(pou, (), {}, is_listed=False)
        return self._sites[pou.key]


class _Variables:
    """What native code sees of a frame, by name."""

    def __init__(self, layout: MemoryLayout, site: NativeSite, frames: Frames) -> None:
        self._layout = layout
        self._site = site
        self._frames = frames

    def _place(self, name: str) -> Place:
        site, first = self._site, str(split_path(name)[0])
        if first in site.types:
            start = Place(site.types[first], site.offsets[first])
            rest = name[len(first) :]
            return resolve(self._layout, start, rest.removeprefix(".")) if rest else start
        if site.block is None:
            raise KeyError(name)
        return resolve(self._layout, Place(site.block, site.block_offset), name)

    def get(self, name: str) -> Any:
        """A variable as an array with one entry a row, or an address."""
        if name in self._site.pointers:
            return FramePointer(self._frames, self._site.offsets[name], self._site.types[name])
        if name in self._site.null_pointers:
            return None
        place = self._place(name)
        return shown(self._layout, partial(view, self._frames), place.offset, place.type, is_plain=False)

    def set(self, name: str, values: Any) -> None:
        """Assign a variable."""
        place = self._place(name)
        element = place.type.element if isinstance(place.type, ArrayType) else place.type
        shape = place.type.shape if isinstance(place.type, ArrayType) else ()
        view(self._frames, place.offset, dtype_of(element), shape)[...] = values
