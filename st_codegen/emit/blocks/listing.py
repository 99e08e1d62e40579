"""What a function block consists of: variables, tables and sections of code.

Python decides here which tables and variables a block needs and what they are called; templates lay them out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from st_codegen.emit.blocks.wording import meaning
from st_codegen.emit.literals import real, real32, reals, texts_of
from st_codegen.errors import InputError, TargetError
from st_codegen.ir import AnyArray

#: Bytes of an element.
SIZES = {"LREAL": 8, "DINT": 4, "SINT": 1, "BOOL": 1, "REAL": 4}

#: Numbers on a line. Fixed, so that a changed number changes its own line only.
_PER_LINE = {"LREAL": 4, "REAL": 6, "DINT": 10, "SINT": 30}
LINE_LENGTH = 100
_INDENT = 8


@dataclass(frozen=True)
class BlockVariable:
    """A declared variable; `length` makes it an array from 0.

    `address` is where a dialect with addresses puts it: `%I*` and `%Q*` are inputs and outputs of the controller whose
    place the development environment chooses.
    """

    name: str
    type: str
    length: int | None = None
    initial: str = ""
    comment: str = ""
    address: str = ""

    @property
    def last(self) -> int:
        """Upper bound of the array."""
        return (self.length or 1) - 1

    @property
    def comment_above(self) -> bool:
        """Whether declaration and comment together are too long for a line."""
        words = [self.name, self.type, self.initial, f"ARRAY[0..{self.last}] OF " * bool(self.length)]
        words.append(f" AT {self.address}" * bool(self.address))
        own = sum(map(len, words)) + _DECLARATION_MARKS
        return bool(self.comment) and own + len(f"(* {self.comment} *)") > LINE_LENGTH


#: Indent, colon, assignment sign, semicolon and the blanks between them.
_DECLARATION_MARKS = 13


#: From so many lines of a table on they are handed to the template.
_LINES_AT_ONCE = 1000


@dataclass(frozen=True)
class ArrayElement:
    """One element of an array, which a template writes as `name[index]`."""

    name: str
    index: int


@dataclass(frozen=True)
class Group:
    """Consecutive rows of a table under one label, such as the nodes of a tree."""

    label: str
    start: int
    stop: int


@dataclass(frozen=True)
class Table:
    """A constant array, written group by group; a group starts on a new line.

    `per_line`: numbers on a line where a row of the table has a natural length (a support vector, a neuron).
    """

    name: str
    type: str
    values: AnyArray
    groups: tuple[Group, ...] = ()
    per_line: int | None = None

    def __post_init__(self) -> None:
        if self.values.ndim != 1 or len(self.values) == 0:
            raise ValueError(f"table {self.name}: shape {self.values.shape}")

    @property
    def last(self) -> int:
        return len(self.values) - 1

    @property
    def comment(self) -> str:
        return meaning(self.name)

    @property
    def n_bytes(self) -> int:
        return len(self.values) * SIZES[self.type]

    def lines(self) -> Iterator[list[str]]:
        """The lines of the initialiser, without brackets: many at a time, since forests have hundreds of thousands."""
        left, found = len(self.values), list[str]()
        step = min(self.per_line or _PER_LINE[self.type], _PER_LINE[self.type])
        for label, texts in self.labelled():
            left -= len(texts)
            if label:
                found.append(f"(* {label} *)")
            own = [", ".join(texts[at : at + step]) + "," for at in range(0, len(texts), step)]
            if not left:
                own[-1] = own[-1][:-1]
            if max(map(len, own), default=0) + _INDENT <= LINE_LENGTH:
                found += own
            else:
                for number, line in enumerate(own):
                    numbers = texts[number * step : (number + 1) * step]
                    found += _halves(numbers, final=not line.endswith(","))
            if left and len(found) >= _LINES_AT_ONCE:
                yield found
                found = []
        yield found

    def labelled(self) -> Iterator[tuple[str, list[str]]]:
        """The label of each group (empty: none) and its numbers as text."""
        for group in self.groups or (Group("", 0, len(self.values)),):
            yield group.label, self._texts(group)

    def _texts(self, group: Group) -> list[str]:
        values = self.values[group.start : group.stop]
        if self.type == "LREAL":
            return reals(values)
        return [real32(value) for value in values.tolist()] if self.type == "REAL" else texts_of(values.tolist())


def _halves(texts: Sequence[str], *, final: bool) -> Iterator[str]:
    """One line, or two halves where it would be too long."""
    line = ", ".join(texts) + ("" if final else ",")
    if len(line) + _INDENT <= LINE_LENGTH or len(texts) == 1:
        yield line
        return
    half = len(texts) // 2
    yield from _halves(texts[:half], final=False)
    yield from _halves(texts[half:], final=final)


@dataclass(frozen=True)
class CodeSection:
    """A titled piece of code: a template and what it prints."""

    title: str
    template: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Code:
    """A named number: a value of the enumeration `type`, or, where a dialect has none, the DINT constant `constant`."""

    type: str
    constant: str
    name: str
    value: int
    comment: str


#: For each list of items that were to fit arrays, the items with which further arrays begin.
Cuts = tuple[tuple[int, ...], ...]


def refuse_twins(owner: str, variables: Iterable[BlockVariable]) -> None:
    """Raise InputError for two variables of one name; those that are not ours are named by features."""
    taken: set[str] = set()
    for variable in variables:
        if variable.name.lower() in taken:
            raise InputError(f"{owner} would have two variables called {variable.name}: rename the feature")
        taken.add(variable.name.lower())


@dataclass(frozen=True)
class Block:
    """A function block, or another kind of code, ready for printing.

    `kind` is the opening keyword: FUNCTION_BLOCK, PROGRAM or FUNCTION; `result` the type that a function returns;
    `extends` the block that a function block is built on. `codes` are the named numbers that its text uses. A program
    with `needs_globals` shares variables with another; others have inputs and outputs where a dialect has no globals.
    `cuts` says where its arrays were cut (`Listing.chunks`). Raises InputError where two of its variables would have
    one name, as a feature and an output may.
    """

    name: str
    header: tuple[str, ...]
    inputs: tuple[BlockVariable, ...] = ()
    outputs: tuple[BlockVariable, ...] = ()
    variables: tuple[BlockVariable, ...] = ()
    constants: tuple[BlockVariable, ...] = ()
    tables: tuple[Table, ...] = ()
    sections: tuple[CodeSection, ...] = ()
    kind: str = "FUNCTION_BLOCK"
    result: str = ""
    extends: str = ""
    in_outs: tuple[BlockVariable, ...] = ()
    codes: tuple[Code, ...] = ()
    needs_globals: bool = False
    cuts: Cuts = ()

    def __post_init__(self) -> None:
        refuse_twins(self.name, (*self.inputs, *self.outputs, *self.in_outs, *self.variables, *self.constants))

    @property
    def table_bytes(self) -> int:
        """Bytes of constant tables."""
        return sum(table.n_bytes for table in self.tables)


@dataclass
class Listing:
    """Collects the parts of a block while its operations are laid out, one after another.

    `earlier` are the cuts that a block of an earlier run has: they stay where they can.
    """

    max_array: int
    real_range: tuple[float, float] | None = None
    earlier: Cuts = ()
    cuts: list[tuple[int, ...]] = field(default_factory=list)
    variables: dict[str, BlockVariable] = field(default_factory=dict)
    constants: list[BlockVariable] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    sections: list[CodeSection] = field(default_factory=list)

    def local(self, name: str, kind: str, length: int | None = None, initial: str = "") -> str:
        """Declare a local variable (again: the same variable); returns its name."""
        self.variables.setdefault(name, BlockVariable(name, kind, length, initial, meaning(name)))
        return name

    def locals(self, kind: str, *names: str) -> None:
        """Declare several scalar locals of one type."""
        for name in names:
            self.local(name, kind)

    def loop(self, name: str, *rounds: int) -> None:
        """Declare the variable of loops of so many rounds; those of one round are written without it."""
        if max(rounds, default=0) > 1:
            self.local(name, "DINT")

    def number(self, name: str, kind: str, value: str) -> str:
        """Declare a constant that is an integer or a bit string, as it is written; returns its name."""
        self.constants.append(BlockVariable(name, kind, initial=value, comment=meaning(name)))
        return name

    def constant(self, name: str, value: float) -> str:
        """Declare a LREAL constant. Raises TargetError for a magnitude that the target's compilers do not read."""
        if self.real_range is not None and value != 0 and not self.real_range[0] <= abs(value) <= self.real_range[1]:
            raise TargetError(
                f"the constant {name} = {value} lies outside {self.real_range[0]:g} .. {self.real_range[1]:g}, which "
                "portable compilers read: scale the model's inputs or target, or use --target twincat"
            )
        self.constants.append(BlockVariable(name, "LREAL", initial=real(value), comment=meaning(name)))
        return name

    def table(
        self,
        name: str,
        kind: str,
        values: AnyArray | Sequence[Any],
        groups: Iterable[Group] = (),
        per_line: int | None = None,
    ) -> str:
        """Declare a constant array; returns its name. Raises TargetError for one that the target cannot hold."""
        array = np.asarray(values)
        if len(array) > self.max_array:
            raise TargetError(
                f"the table {name} needs {len(array):,} elements in one array, the limit is {self.max_array:,}: "
                "train a smaller model, or raise the limit with --max-array if your controller allows it"
            )
        self.tables.append(Table(name, kind, array, tuple(groups), per_line))
        return name

    def section(self, title: str, template: str, **values: Any) -> None:
        """Append a piece of code."""
        self.sections.append(CodeSection(title, template, values))

    def chunks(
        self, sizes: AnyArray | Sequence[int], what: str, advice: str = "train a smaller model"
    ) -> list[tuple[int, int]]:
        """Split consecutive items (trees, neurons, support vectors) of the given sizes into runs that fit an array.

        Where an earlier run cut, is cut again: a model that was trained again moves nothing behind the first item
        that no longer fits. Returns (first, stop) item numbers. Raises TargetError where a single item does not fit.
        """
        runs: list[tuple[int, int]] = []
        kept = set(self.earlier[len(self.cuts)]) if len(self.cuts) < len(self.earlier) else set()
        first, total = 0, 0
        for number, size in enumerate(np.asarray(sizes).tolist()):
            if size > self.max_array:
                raise TargetError(
                    f"{what} {number} needs {size:,} elements in one array, the limit is {self.max_array:,}: "
                    f"{advice}, or raise the limit with --max-array if your controller allows it"
                )
            if number > first and (total + size > self.max_array or number in kept):
                runs.append((first, number))
                first, total = number, 0
            total += size
        runs.append((first, len(sizes)))
        self.cuts.append(tuple(start for start, _ in runs[1:]))
        return runs


def suffixes(runs: int) -> list[str]:
    """Ends of the names of tables that each run of items (`Listing.chunks`) has for itself."""
    return [""] if runs == 1 else [f"_{number}" for number in range(runs)]
