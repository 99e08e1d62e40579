"""What both code generators share: Python source that grows line by line, and the place each line came from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from types import CodeType, TracebackType
from typing import Any

from st_codegen.st import tree as t
from st_codegen.st import walk
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.errors import Position, StRuntimeError
from st_codegen.st.types import Elementary, EnumType, Scalar


@dataclass
class Source:
    """Generated Python source; `positions[i]` is where line `i + 1` comes from."""

    kind: str
    lines: list[str] = field(default_factory=list)
    positions: list[Position | None] = field(default_factory=list)
    namespace: dict[str, Any] = field(default_factory=dict)
    _names: dict[Any, str] = field(default_factory=dict)

    def register(self, prefix: str, key: Any, make: Any) -> str:
        """A name for an object that the code uses; `make` is called when `key` is new."""
        if key not in self._names:
            name = f"{prefix}{len(self._names)}"
            self._names[key] = name
            self.namespace[name] = make()
        return self._names[key]

    def run(self) -> CodeType:
        """Compile and execute what was generated: its functions are in `namespace` then."""
        code = compile("\n".join(self.lines) + "\n", f"<structured text, {self.kind}>", "exec")
        exec(code, self.namespace)
        return code

    def explain(self, fault: Fault, trace: TracebackType | None) -> StRuntimeError:
        """A fault with its position and lane, from the generated code that was running."""
        position, lane = Position("", 0, 0), fault.index
        while trace is not None:
            if trace.tb_frame.f_globals is self.namespace:
                position = self.positions[trace.tb_lineno - 1] or position
                active = trace.tb_frame.f_locals.get("m")
                lane = fault.index if active is None else int(active[fault.index])
            trace = trace.tb_next
        position = fault.position or position
        detail = fault.detail or f"operands {', '.join(repr(operand) for operand in fault.operands)}"
        return StRuntimeError(fault.kind, position, detail, lane, fault.operands)


@dataclass(frozen=True)
class Compiled:
    """Python functions by the keys of units; `constants` are composite constants that a machine makes once.

    It knows nothing of the project it was made from, so that caches of it do not keep projects alive.
    """

    functions: dict[str, Callable[..., Any]]
    source: Source
    constants: tuple[t.Variable, ...] = ()


class Writer:
    """Writes the body of one function."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._indent = 1
        self._numbers = count()
        self.position: Position | None = None

    def line(self, text: str, position: Position | None = None) -> None:
        """Add a line."""
        self.source.lines.append(" " * self._indent + text)
        self.source.positions.append(position or self.position)

    def fresh(self, prefix: str = "t") -> str:
        """A new name."""
        return f"{prefix}{next(self._numbers)}"

    @contextmanager
    def indented(self, header: str, position: Position | None = None) -> Iterator[None]:
        """A header and what stands below it."""
        self.line(header, position)
        self._indent += 1
        before = len(self.source.lines)
        yield
        if len(self.source.lines) == before:
            self.line("pass")
        self._indent -= 1


def literal(value: Scalar) -> str:
    """A value as Python source."""
    if isinstance(value, float) and not math.isfinite(value):
        return f"float('{value}')"
    text = repr(value)
    return f"({text})" if text.startswith("-") else text


def is_inlined(variable: t.Variable) -> bool:
    """Whether a variable is a constant that stands in the code as a literal."""
    return variable.is_constant and isinstance(variable.type, Elementary | EnumType)


def leaves(statement: t.Statement) -> frozenset[type]:
    """Which of Exit, Continue and Return a statement may do to the code around it."""
    if isinstance(statement, t.Exit | t.Continue | t.Return):
        return frozenset({type(statement)})
    inner = frozenset(kind for body in walk.bodies(statement) for item in body for kind in leaves(item))
    return inner & {t.Return} if isinstance(statement, t.For | t.While | t.Repeat) else inner


def boxed_variables(pou: t.Pou) -> set[t.Variable]:
    """The local variables of a unit that are passed by reference."""
    boxed: set[t.Variable] = set()
    for expression in walk.all_expressions(pou.body):
        places: list[t.Expression] = []
        if isinstance(expression, t.AddressOf):
            places = [expression.target]
        elif isinstance(expression, t.Call):
            places = [item.value for item in expression.arguments if item.passing is t.Passing.IN_OUT]
        boxed |= {
            place.variable
            for place in places
            if isinstance(place, t.VariableRef)
            and place.variable.storage is t.Storage.LOCAL
            and place.variable.section is not t.Section.IN_OUT
        }
    return boxed


def has_calls(expression: t.Expression) -> bool:
    """Whether an expression runs code of the project, which may change variables."""
    return any(isinstance(part, t.Call) for part in walk.expressions(expression))
