"""Compiles units to machine code just in time: each one when it is first called, with the functions that it calls.

Blocks and methods are compiled once in a project and called by their address; functions are compiled together with
each unit that calls them, so that small ones cost nothing there.
"""

from __future__ import annotations

import ctypes
import sys
import time
from dataclasses import dataclass
from functools import cache
from threading import RLock
from typing import Any

import llvmlite.binding as llvm

from st_codegen.st import tree as t
from st_codegen.st.run import prelude
from st_codegen.st.run.module import Module, absolute
from st_codegen.st.run.unit import Unit, is_body, is_by_value, parameters
from st_codegen.st.run.writer import stored_type, value_type
from st_codegen.st.tree import PouKind

#: How much is optimised: nothing, for what runs a few times; or what pays off in a simulation or for many rows.
QUICK, FAST = 0, 2
_LONG, _POINTER = ctypes.c_int64, ctypes.c_void_p
#: Runs a unit: context, unit, then the address and the bytes a row of the memory, instances and arguments; the rows.
_ROWS = ctypes.CFUNCTYPE(_LONG, *(_POINTER, _POINTER), *(_POINTER, _LONG) * 3, *(_LONG, _LONG))


@dataclass(frozen=True)
class CompiledUnit:
    """Machine code of a unit: where it begins, where it finds its arguments (by name), and their bytes.

    `seconds` is what it took to compile, with what it calls as far as that was not compiled before.
    """

    address: int
    arguments: dict[str, int]
    argument_bytes: int
    seconds: float


class Program:
    """The compiled units of a project; machines share it."""

    def __init__(self, project: t.Project, loop_limit: int, level: int) -> None:
        self.rows, functions = _library()
        self._level = level
        self.module = Module(project, loop_limit, functions)
        self._codes: dict[str, CompiledUnit] = {}
        self._units: dict[str, int] = {}
        self._engines: list[Any] = []
        self._lock = RLock()

    def code(self, pou: t.Pou) -> CompiledUnit:
        """The machine code of a unit that is no native one. Raises `StCheckError` for pointers."""
        with self._lock:
            if pou.key not in self._codes:
                start = time.perf_counter()
                offsets, size = self.module.arguments(parameters(pou))
                address = self._unit(pou) if is_body(pou) else self._compiled(pou, offsets)
                self._codes[pou.key] = CompiledUnit(address, offsets, size, time.perf_counter() - start)
            return self._codes[pou.key]

    def _unit(self, pou: t.Pou) -> int:
        """Where a block or method is."""
        if pou.key not in self._units:
            self._units[pou.key] = self._compiled(pou, None)
        return self._units[pou.key]

    def _compiled(self, pou: t.Pou, offsets: dict[str, int] | None) -> int:
        """Compile a unit, callees first; with `offsets` a function takes its arguments from a record."""
        project, parts, inside = self.module.project, [], {pou.key: name_of(pou.key)}
        pending = [pou]
        while pending:
            current = pending.pop()

            def called(key: str) -> str:
                if project.pous[key].kind is not PouKind.FUNCTION:
                    return absolute(self._unit(project.pous[key]))
                if key not in inside:
                    inside[key] = name_of(key)
                    pending.append(project.pous[key])
                return inside[key]

            parts.append(Unit(self.module, current, called).text(is_internal=current is not pou))
        name = name_of(pou.key)
        if offsets is not None:
            parts.append(_entry(pou, offsets))
            name = "@entry"
        self._engines.append(_engine("\n".join([prelude.INTRINSICS, *parts]), self._level))
        address: int = self._engines[-1].get_function_address(name.strip('@"'))
        return address


_LOCK = RLock()


def program_of(project: t.Project, loop_limit: int, level: int = FAST) -> Program:
    """The program of a project, made once for each limit of loops and each level."""
    key = (Program, loop_limit, level)
    with _LOCK:
        # a program knows its project, so a table beside the project would keep both for ever
        if key not in project.kept:
            project.kept[key] = Program(project, loop_limit, level)
        program: Program = project.kept[key]
        return program


def name_of(key: str) -> str:
    """The name of a unit's function."""
    return f'@"u.{key}"'


def _entry(pou: t.Pou, offsets: dict[str, int]) -> str:
    lines, given = [], []
    for number, variable in enumerate(parameters(pou)):
        lines.append(f"  %p{number} = getelementptr i8, ptr %a, i64 {offsets[variable.key]}")
        if not is_by_value(variable):
            given.append(f", ptr %p{number}")
            continue
        kind = value_type(variable.type)
        lines.append(f"  %v{number} = load {stored_type(variable.type)}, ptr %p{number}")
        if kind == "i1":
            lines.append(f"  %b{number} = icmp ne i8 %v{number}, 0")
        given.append(f", {kind} %{'b' if kind == 'i1' else 'v'}{number}")
    call = f"  %e = call i32 {name_of(pou.key)}(ptr %c, ptr %g, ptr %s{''.join(given)})"
    return "\n".join(["define i32 @entry(ptr %c, ptr %g, ptr %s, ptr %a) {", *lines, call, "  ret i32 %e", "}"])


#: Machine code that lives as long as the process.
_KEPT: list[Any] = []


@cache
def _library() -> tuple[Any, dict[str, str]]:
    """The function that runs rows, and what units call: the prelude, and functions of the C library."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    engine = _engine(prelude.TEXT, level=QUICK)
    addresses = {name: engine.get_function_address(name) for name in prelude.EXPORTED}
    library = ctypes.CDLL("ucrtbase") if sys.platform == "win32" else ctypes.CDLL(None)
    for name, function in prelude.C_FUNCTIONS.items():
        addresses[name] = ctypes.cast(getattr(library, function), ctypes.c_void_p).value
    _KEPT.append(engine)
    return _ROWS(addresses["rows"]), {name: absolute(address) for name, address in addresses.items()}


def _engine(text: str, level: int) -> Any:
    """Machine code of a module; nothing is added, contracted or reordered that changes a bit of a result."""
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    # the engine owns its target machine
    machine = target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=level, jit=True)
    module = llvm.parse_assembly(text)
    if level:
        builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=level))
        builder.getModulePassManager().run(module, builder)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine
