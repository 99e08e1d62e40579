"""Compiles units to machine code just in time: each one when it is first called, with the functions that it calls.

Blocks and methods are compiled once in a project and called by their address; functions are compiled together with
each unit that calls them, so that small ones cost nothing there.
"""

from __future__ import annotations

import ctypes
import sys
import time
from functools import cache
from threading import RLock
from typing import Any

import llvmlite.binding as llvm

from st_codegen.st import tree as t
from st_codegen.st.run import prelude
from st_codegen.st.run.memory import CompiledUnit
from st_codegen.st.run.module import Module, absolute
from st_codegen.st.run.unit import Unit
from st_codegen.st.tree import PouKind

#: How much is optimised: nothing, for what runs a few times; or what pays off in a simulation or for many rows.
QUICK, FAST = 0, 2
_LONG, _POINTER = ctypes.c_int64, ctypes.c_void_p
#: Runs a unit: context, unit, then the address and the bytes a row of the memory and of the instances; the rows.
_ROWS = ctypes.CFUNCTYPE(_LONG, *(_POINTER, _POINTER), *(_POINTER, _LONG) * 2, *(_LONG, _LONG))


class Program:
    """The compiled units of a project; machines share it."""

    def __init__(self, project: t.Project, loop_limit: int, level: int) -> None:
        self.rows, functions = _library()
        self._level = level
        self.module = Module(project, loop_limit, functions)
        self._codes: dict[str, CompiledUnit] = {}
        self._engines: list[Any] = []
        self._lock = RLock()

    def code(self, pou: t.Pou) -> CompiledUnit:
        """The machine code of a body or method that is no native one. Raises `StCheckError` for what does not run."""
        with self._lock:
            if pou.key not in self._codes:
                start = time.perf_counter()
                address = self._compiled(pou)
                self._codes[pou.key] = CompiledUnit(address, time.perf_counter() - start)
            return self._codes[pou.key]

    def _compiled(self, pou: t.Pou) -> int:
        """Compile a unit, callees first."""
        project, parts, inside = self.module.project, [], {pou.key: name_of(pou.key)}
        pending = [pou]
        while pending:
            current = pending.pop()

            def called(key: str) -> str:
                if project.pous[key].kind is not PouKind.FUNCTION:
                    return absolute(self.code(project.pous[key]).address)
                if key not in inside:
                    inside[key] = name_of(key)
                    pending.append(project.pous[key])
                return inside[key]

            parts.append(Unit(self.module, current, called).text(is_internal=current is not pou))
        self._engines.append(_engine("\n".join([prelude.INTRINSICS, *parts]), self._level))
        address: int = self._engines[-1].get_function_address(name_of(pou.key).strip('@"'))
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


#: Machine code that lives as long as the process.
_KEPT: list[Any] = []


@cache
def _library() -> tuple[Any, dict[str, str]]:
    """The function that runs rows, and what units call: the prelude, and functions of the C library."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    has_clock = sys.platform == "linux"
    engine = _engine(prelude.TEXT + prelude.CLOCK * has_clock, level=QUICK)
    exported = (*prelude.EXPORTED, *(["block.GETCPUCOUNTER"] * has_clock))
    addresses = {name: engine.get_function_address(name) for name in exported}
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
