"""Blocks and functions of libraries that the text only refers to: declared in Structured Text, executed by Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.source import read_texts
from st_codegen.st.tree import PouKind

Values = NDArray[Any]


class Host(Protocol):
    """What native code sees of the machine: the number of rows, and all instances of native blocks."""

    natives: list[NativeBlock]

    @property
    def row_count(self) -> int:
        """How many rows there are."""

    def run_body(self, native: NativeBlock, row: int) -> None:
        """Call the body of the instance that a native block belongs to, in one row."""


@dataclass
class NativeCall:
    """One call of native code, from one row or from several at once.

    `call["IN"]` is an input, in-out or own output as an array with one entry for each of the `rows` (for a pointer a
    `calls.FramePointer`, None when it is null); `call["Q"] = values` sets an output, in-out or, by the name of the
    function or method, the result. A method also sees the variables of its block. Names are paths in upper case.
    """

    machine: Host
    rows: NDArray[np.int64]
    get: Callable[[str], Any]
    set: Callable[[str, Any], None]

    def __getitem__(self, name: str) -> Any:
        return self.get(name)

    def __setitem__(self, name: str, values: Any) -> None:
        self.set(name, values)


class NativeBlock:
    """Base of native function blocks; one object for each instance in the project, whatever the number of rows.

    A subclass has a method of the same name and spelling for each method it declares, and `body` for a call of the
    instance itself; each takes a `NativeCall`. State is kept in arrays of length `machine.row_count`.

    Where `is_pure`, what a call gives depends on nothing but its arguments and the variables of the block, and does
    nothing else: the machine may then make the calls of many rows at once, and more of them than the text makes.
    """

    is_pure = False

    def __init__(self, machine: Host) -> None:
        self.machine = machine
        machine.natives.append(self)

    def body(self, call: NativeCall) -> None:
        """A call of the instance."""


NativeFunction = Callable[[NativeCall], None]


@dataclass(frozen=True)
class Library:
    """Declarations in Structured Text, whose blocks and functions are executed by Python.

    What `blocks` and `functions` (by name) do not name is ordinary text, types and globals for example.
    """

    name: str
    text: str
    blocks: Mapping[str, type[NativeBlock]] = field(default_factory=dict)
    functions: Mapping[str, NativeFunction] = field(default_factory=dict)

    def declarations(self) -> tuple[list[d.Declaration], list[d.Declaration]]:
        """The native and the ordinary declarations. Raises `StSyntaxError`, `InputError` for what Python lacks."""
        native: list[d.Declaration] = []
        ordinary: list[d.Declaration] = []
        classes = {name.upper(): cls for name, cls in self.blocks.items()}
        names = {*classes, *(name.upper() for name in self.functions)}
        for declaration in read_texts({f"{self.name}.st": self.text}).declarations:
            key = declaration.name.upper()
            is_native = isinstance(declaration, d.PouDeclaration) and key in names
            (native if is_native else ordinary).append(declaration)
            if is_native and isinstance(declaration, d.PouDeclaration) and declaration.kind is PouKind.FUNCTION_BLOCK:
                missing = [method.name for method in declaration.methods if not hasattr(classes[key], method.name)]
                if missing:
                    raise InputError(f"library {self.name}: the class of {declaration.name} lacks {', '.join(missing)}")
        return native, ordinary
