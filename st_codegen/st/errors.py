"""Where something is in the Structured Text, and the errors that say so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from st_codegen.errors import InputError, StCodegenError

MAX_LISTED = 50


@dataclass(frozen=True, slots=True, order=True)
class Position:
    """A position in a source file: line and column count from 1, `pou` is empty outside of units of code."""

    file: str
    line: int
    column: int
    pou: str = ""

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}"
        return f"{where} ({self.pou})" if self.pou else where


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """A message about one position in the text."""

    position: Position
    message: str

    def __str__(self) -> str:
        return f"{self.position}: {self.message}"


class StError(InputError):
    """Structured Text that cannot be used; `problems` has all that is wrong, in the order of the text."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(set(problems)))
        lines = [str(problem) for problem in self.problems[:MAX_LISTED]]
        if len(self.problems) > MAX_LISTED:
            lines.append(f"and {len(self.problems) - MAX_LISTED} more")
        super().__init__(lines[0] if len(lines) == 1 else f"{len(self.problems)} problems\n  " + "\n  ".join(lines))


class StSyntaxError(StError):
    """Text that does not follow the grammar."""


class StCheckError(StError):
    """Text that parses, but whose names, types or rules are wrong."""


class StRuntimeError(StCodegenError):
    """What would stop a real controller: a floating point exception, an index out of range, an endless loop.

    `kind` is a short fixed name of the cause (`division by zero`, `index out of range`, ..), `row` the first row that
    is affected, `operands` the values that caused it.
    """

    def __init__(self, kind: str, position: Position, detail: str, row: int, operands: tuple[object, ...] = ()) -> None:
        self.kind = kind
        self.position = position
        self.detail = detail
        self.row = row
        self.operands = operands
        super().__init__(f"{position}: {kind}: {detail}, row {row}")


class StUsageError(StCodegenError):
    """A machine was asked for something its project does not have."""
