"""Runs a checked project, in one copy or in many rows at once.

    project = load_project(["out/iec"], dialect="iec")
    machine = Machine(project, rows=10_000)
    block = machine.instance("FB_Forest")
    block(fSpeed_rpm=speeds, fTorque_Nm=torques)      # arrays of length rows, or single values
    block["fOut1"]                                    # array of length rows

Without `rows` there is one copy, whose variables are single values.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.calls import NativeCalls
from st_codegen.st.run.layout import dtype_of, is_scalar
from st_codegen.st.run.memory import CompiledUnit, Memory, given, shown, view
from st_codegen.st.run.natives import Library, NativeBlock
from st_codegen.st.run.paths import Place, Port, find_block, find_global, ports, resolve
from st_codegen.st.run.prelude import CONTEXT
from st_codegen.st.types import ArrayType, BlockType, PointerType

LOOP_LIMIT = 10_000_000
#: Where nothing else is known, fewer rows run faster than they are optimised; the results are the same.
_FEW_ROWS = 2_000
#: Fewer rows are not worth a thread.
_ROWS_A_THREAD = 500
#: Memory for the answers of native code to rows that ask at the same time.
_ANSWER_BYTES = 64_000_000


class _Context:
    """What compiled code is told besides variables, and where it notes a fault; see `prelude.CONTEXT`."""

    def __init__(self, entries: dict[str, int]) -> None:
        self.entries = np.zeros(len(CONTEXT), np.int64)
        self.address = self.entries.ctypes.data
        self.set(entries)

    def set(self, entries: dict[str, int]) -> None:
        """Set some entries."""
        for name, value in entries.items():
            self.entries[CONTEXT.index(name)] = value


class Machine:
    """A project that runs in `rows` independent copies; variables are read as arrays whose first axis is the rows.

    `loop_limit` is the number of rounds after which a single run of a loop is an error. `libraries` are those the
    project was checked with. `workers` are the threads that rows are shared among (None: one for each processor).
    `optimised` code takes about four times as long to compile and runs about four times as fast (None: by the number
    of rows). Results depend on neither. After an error the variables of the machine are of no use.
    """

    def __init__(
        self,
        project: t.Project,
        rows: int | None = None,
        *,
        loop_limit: int = LOOP_LIMIT,
        libraries: Iterable[Library] = (),
        workers: int | None = None,
        optimised: bool | None = None,
    ) -> None:
        if rows is not None and rows < 1:
            raise StUsageError(f"a machine has at least one row, not {rows}")
        self.project = project
        self.rows = rows
        self.natives: list[NativeBlock] = []
        if optimised is None:
            optimised = rows is None or rows >= _FEW_ROWS
        # LLVM takes a moment to load, and who only checks text does without it
        from st_codegen.st.run.compiler import FAST, QUICK, program_of

        self.program_code = program_of(project, loop_limit, FAST if optimised else QUICK)
        self.module = self.program_code.module
        self.layout = self.module.layout
        self.calls = NativeCalls(self, self.module, libraries)
        self._workers = workers or processors()
        self.memory = Memory(self.row_count, self.layout.global_image())
        for variable, offset in self.layout.globals.items():
            self.calls.attach(self.memory, variable.type, offset)
        self._programs: Memory | None = None
        self._frames = [Memory(self.row_count, bytes(self.module.frame_bytes))]
        self._context: _Context | None = None
        self.globals = GlobalVariables(self)
        if self.calls.may_run_bodies:
            self._program_memory()

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return self.rows or 1

    def instance(self, block: str) -> Instance:
        """A new instance of a function block. Raises `StUsageError` when there is no such block."""
        type_ = find_block(self.project, block)
        memory = Memory(self.row_count, self.layout.image(type_, {}))
        self.calls.attach(memory, type_)
        return Instance(self, type_, memory, 0)

    def program(self, name: str) -> Instance:
        """The instance of a program. Raises `StUsageError` when there is no such program."""
        if name.upper() not in self.layout.programs:
            raise StUsageError(f"the project has no program '{name}'")
        memory, at = self._program_memory(), self.layout.programs[name.upper()]
        return Instance(self, find_block(self.project, name), memory, at)

    def find(self, path: str) -> tuple[Memory, Place]:
        """Where a global variable, or `PROGRAM.name` of a program, is kept. Raises `StUsageError`."""
        first, _, rest = path.partition(".")
        at = self.layout.programs.get(first.upper())
        if at is None or not rest:
            return self.memory, find_global(self.layout, path)
        return self._program_memory(), resolve(self.layout, Place(find_block(self.project, first), at), rest)

    def _program_memory(self) -> Memory:
        """The programs, made when they are first needed."""
        if self._programs is None:
            self._programs = Memory(self.row_count, self.layout.program_image())
            for key, offset in self.layout.programs.items():
                self.calls.attach(self._programs, BlockType(self.project.pous[key].name), offset)
            self._context = None
        return self._programs

    # --- runs ---

    def run(self, code: CompiledUnit, memory: Memory, at: int) -> None:
        """Run a unit in all rows. Raises `StRuntimeError` for the first row in which a controller would stop."""
        has_natives = bool(self.module.native_sites)
        if has_natives and self.row_count > 1 and self.calls.are_pure:
            self._run_with_answers(code, memory, at)
        elif has_natives or self._workers < 2 or self.row_count < 2 * _ROWS_A_THREAD:
            if (
                self._context is None
                or self.module.frame_bytes > self._frames[-1].stride
                or (self.module.uses_programs and self._programs is None)
            ):
                self._context = self._new_context()
            self._run_rows(self._context, code, memory, at, 0, self.row_count)
        else:
            self._run_in_threads(code, memory, at)

    def _run_in_threads(self, code: CompiledUnit, memory: Memory, at: int) -> None:
        parts = min(self._workers, self.row_count // _ROWS_A_THREAD)
        ends = np.linspace(0, self.row_count, parts + 1).astype(int).tolist()

        def part(number: int) -> None:
            self._run_rows(self._new_context(), code, memory, at, ends[number], ends[number + 1])

        runs = [_threads().submit(part, number) for number in range(parts)]
        wait(runs)  # all of them, so that the error is that of the first row, and nobody writes afterwards
        for run in runs:
            run.result()

    def _run_rows(self, context: _Context, code: CompiledUnit, memory: Memory, at: int, first: int, last: int) -> None:
        stopped = self.program_code.rows(
            context.address,
            code.address,
            self.memory.address,
            self.memory.stride,
            memory.address + at,
            memory.stride,
            first,
            last,
        )
        if self.calls.raised is not None:
            error, self.calls.raised = self.calls.raised, None
            raise error
        if stopped >= 0:
            kind, site, *operands = (int(value) for value in context.entries[:4])
            raise self.module.sites[site].error(kind, operands, stopped)

    def _new_context(self) -> _Context:
        if self.module.frame_bytes > self._frames[-1].stride:
            # A block may have kept the address of something in the frames before
            self._frames.append(Memory(self.row_count, bytes(self.module.frame_bytes)))
        entries = {
            "frames": self._frames[-1].address,
            "frame_bytes": self._frames[-1].stride,
            "host": ctypes.cast(self.calls.callback, ctypes.c_void_p).value or 0,
        }
        if self.module.uses_programs:
            programs = self._program_memory()
            entries |= {"programs": programs.address, "program_bytes": programs.stride}
        return _Context(entries)

    # --- native code ---

    def _run_with_answers(self, code: CompiledUnit, memory: Memory, at: int) -> None:
        """Try all rows, answer what they asked native code at once, and try again until nothing new is asked."""
        size = max(site.size for site in self.module.native_sites)
        asked = len(self.module.native_sites)
        part = max(1, min(self.row_count, _ANSWER_BYTES // (2 * size * asked)))
        for begin in range(0, self.row_count, part):
            end = min(begin + part, self.row_count)
            self._answer_rows(code, memory, at, np.arange(begin, end), (size, asked))

    def _answer_rows(
        self, code: CompiledUnit, memory: Memory, at: int, rows: NDArray[np.int64], sizes: tuple[int, int]
    ) -> None:
        size, asked = sizes
        first, last = int(rows[0]), int(rows[-1]) + 1
        before = [(item, item.bytes[first:last].copy()) for item in self.calls.memories]
        answers = np.zeros((len(rows), asked, 2, size), np.uint8)
        known = np.zeros((len(rows), asked), np.int64)
        status = np.zeros(len(rows), np.uint8)
        while True:
            context = self._new_context()
            entries = {"is_trial": 1, "answers": answers.ctypes.data, "answer_bytes": size, "answers_a_row": asked}
            entries |= {"known": known.ctypes.data, "begin": first, "status": status.ctypes.data}
            context.set(entries)
            self._run_rows(context, code, memory, at, first, last)
            if not status.any():
                return
            if not (known < 0).any():  # there are more calls than room for answers
                more = np.zeros((len(rows), asked, 2, size), np.uint8)
                answers, known = np.concatenate([answers, more], 1), np.concatenate([known, np.zeros_like(known)], 1)
                asked *= 2
            for number in np.unique(known[known < 0]):
                where = np.nonzero(known == number)
                site = self.module.native_sites[-int(number) - 1]
                frames = answers[where][:, 0, : site.size].copy()
                self.calls.answer(site, frames, rows[where[0]])
                answers[where[0], where[1], 1, : site.size] = frames
                known[where] = -number
            for item, content in before:
                item.bytes[first:last] = content

    def run_body(self, native: NativeBlock, row: int) -> None:
        """Call the body of the instance that a native block belongs to, in one row."""
        memory, at, block = self.calls.owner(native)
        code = self.program_code.code(self.project.pous[block.name.upper()])
        self._run_rows(self._new_context(), code, memory, at, row, row + 1)

    def _run_native(self, pou: t.Pou, memory: Memory, at: int) -> None:
        """Call the body of a native block from outside."""
        site = self.calls.site_of(pou)
        frames = np.zeros((self.row_count, site.size), np.uint8)
        view(frames, 0, np.dtype(np.uint64), ())[...] = memory.addresses() + np.uint64(at)
        size = site.size - site.block_offset
        frames[:, site.block_offset :] = memory.bytes[:, at : at + size]
        self.calls.answer(site, frames, np.arange(self.row_count))
        memory.bytes[:, at : at + size] = frames[:, site.block_offset :]

    def call_body(self, block: str, memory: Memory, at: int) -> None:
        """Call an instance of a block once."""
        pou = self.project.pous[block]
        if pou.is_native:
            self._run_native(pou, memory, at)
        else:
            self.run(self.program_code.code(pou), memory, at)

    # --- variables ---

    def read(self, memory: Memory, place: Place) -> Any:
        """A variable for the user."""
        if place.constant is not None:
            image = self.layout.image(place.constant.type, place.constant.initial)
            memory = Memory(self.row_count, image)
        return shown(self.layout, memory.view, place.offset, place.type, self.rows is None)

    def write(self, memory: Memory, place: Place, path: str, value: Any) -> None:
        """Set a variable. Raises `StUsageError` for a constant or a wrong value."""
        if place.constant is not None:
            raise StUsageError(f"'{path}' is a constant")
        numbers = given(value, place.type, self.rows, path)
        shape = place.type.shape if isinstance(place.type, ArrayType) else ()
        memory.view(place.offset, numbers.dtype, shape)[...] = numbers


class _Named:
    """Variables by their paths, read and set."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._places: dict[str, tuple[Memory, Place]] = {}
        self._numbers: dict[str, NDArray[Any]] = {}

    def _find(self, path: str) -> tuple[Memory, Place]:
        """Where a path leads. Raises `StUsageError`."""
        raise NotImplementedError

    def _place(self, path: str) -> tuple[Memory, Place]:
        if path not in self._places:
            memory, found = self._places[path] = self._find(path)
            is_number = is_scalar(found.type) and not isinstance(found.type, PointerType)
            if is_number and self._machine.rows is None and found.constant is None:
                self._numbers[path] = memory.view(found.offset, dtype_of(found.type), ())
        return self._places[path]

    def __getitem__(self, path: str) -> Any:
        if path in self._numbers:  # the usual case in a simulation
            return self._numbers[path].item()
        return self._machine.read(*self._place(path))

    def __setitem__(self, path: str, value: Any) -> None:
        number = self._numbers.get(path) if type(value) is float else None
        if number is not None and number.dtype == np.float64:
            number[...] = value
        else:
            self._machine.write(*self._place(path), path, value)


class Instance(_Named):
    """An instance of a function block or program: `block["name"]` reads a variable, `block["name"] = value` sets it."""

    def __init__(self, machine: Machine, type_: BlockType, memory: Memory, at: int) -> None:
        super().__init__(machine)
        self._type = type_
        self._memory = memory
        self._at = at
        self._has_in_outs = bool(self._ports(t.Section.IN_OUT))

    def _ports(self, *sections: t.Section) -> tuple[Port, ...]:
        return ports(self._machine.project, self._type.name, *sections)

    @property
    def inputs(self) -> tuple[Port, ...]:
        """VAR_INPUT in order."""
        return self._ports(t.Section.INPUT)

    @property
    def outputs(self) -> tuple[Port, ...]:
        """VAR_OUTPUT in order."""
        return self._ports(t.Section.OUTPUT)

    @property
    def native(self) -> NativeBlock:
        """The Python object behind an instance of a native block, or of a block that extends one."""
        found = self._memory.natives.get(self._at)
        if found is None:
            raise StUsageError(f"'{self._type}' is not native")
        return found

    def compile(self) -> float:
        """Compile what a call runs, unless that has been done; the seconds that it took, whenever that was."""
        pou = self._machine.project.pous[self._type.name.upper()]
        return 0.0 if pou.is_native else self._machine.program_code.code(pou).seconds

    def __call__(self, **inputs: Any) -> None:
        """Set inputs and call the instance once. Raises `StRuntimeError`, `StUsageError`."""
        for name, value in inputs.items():
            self[name] = value
        if self._has_in_outs:
            raise StUsageError(f"'{self._type}' has a VAR_IN_OUT: call it from Structured Text")
        self._machine.call_body(self._type.name.upper(), self._memory, self._at)

    def _find(self, path: str) -> tuple[Memory, Place]:
        return self._memory, resolve(self._machine.layout, Place(self._type, self._at), path)


class GlobalVariables(_Named):
    """Global variables by `LIST.name` or plain name, read and set like those of an instance."""

    def _find(self, path: str) -> tuple[Memory, Place]:
        return self._machine.memory, find_global(self._machine.layout, path)


def processors() -> int:
    """How many processors this process may use: a copy of another one its own alone."""
    if _is_copy:
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(processors(), "structured-text")


#: Whether this process is a copy of another one, which computes at the same time.
_is_copy = False


def _in_a_copy() -> None:
    global _is_copy  # noqa: PLW0603 - a fact of the process
    _is_copy = True
    _threads.cache_clear()  # it has none of the threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_a_copy)
