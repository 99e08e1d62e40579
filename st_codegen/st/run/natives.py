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
    """What native code sees of the machine: the clock, the number of lanes, and all instances of native blocks."""

    time_ns: int
    lanes: int
    natives: list[NativeBlock]

    def run_body(self, native: NativeBlock, lanes: NDArray[np.int64]) -> None:
        """Call the body of the instance that a native block belongs to, in some lanes."""


class NativePointer(Protocol):
    """What ADR gives to native code: a variable, or an array, of the project."""

    def read(self) -> Values:
        """The variable in the active lanes, shape (lanes,), or the array, shape (lanes, elements)."""

    def write(self, values: Any) -> None:
        """Assign the variable or the array in the active lanes."""


@dataclass
class NativeCall:
    """One call of native code in the active lanes.

    `call["IN"]` is an input, in-out or own output as an array with one entry for each active lane (for a pointer a
    `NativePointer`, None when it is null); `call["Q"] = values` sets an output, in-out or, by the name of the function
    or method, the result. A method also sees the variables of its block. Names are those of the declaration, in upper
    case.
    """

    machine: Host
    lanes: NDArray[np.int64]
    getters: Mapping[str, Callable[[], Any]]
    setters: Mapping[str, Callable[[Any], None]]

    def __getitem__(self, name: str) -> Any:
        return self.getters[name]()

    def __setitem__(self, name: str, values: Any) -> None:
        self.setters[name](values)


class NativeBlock:
    """Base of native function blocks; one object for each instance in the project, whatever the number of lanes.

    A subclass has a method of the same name and spelling for each method it declares, and `body` for a call of the
    instance itself; each takes a `NativeCall`. State is kept in arrays of length `machine.lanes`.
    """

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


def as_lanes(value: Any, count: int, dtype: Any) -> Values:
    """A value of the active lanes as an array with one entry for each of them."""
    return np.broadcast_to(np.asarray(value, dtype), (count,)).copy()
