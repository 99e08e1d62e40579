"""Declarations as they are written: types, variables, units and initial values, before any name has a meaning."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.tree import Expression, Node, PouKind, Range, Section, Statement

# --- initial values ---------------------------------------------------------------------------------------------------


class TableKind(Enum):
    """Which literals a table of numbers holds."""

    INTEGER = "integer"
    REAL = "real"
    MIXED = "integer and real"
    BOOL = "bool"


class NumberTable(Node):
    """An array initialiser of plain numbers, read as one token; `values` is int64, uint64, float64 or bool."""

    values: NDArray[np.generic]
    kind: TableKind

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, NumberTable):
            return NotImplemented
        same_type = self.kind is other.kind and self.values.dtype == other.values.dtype
        return same_type and self.values.tobytes() == other.values.tobytes()

    def __hash__(self) -> int:
        return hash((self.kind, self.values.size))


class Repeated(Node):
    """A value that is repeated in an array initialiser, written `50(0.0)`."""

    count: int
    value: Initial | None


class ArrayInitial(Node):
    """The initialiser of an array with anything but plain numbers in it."""

    items: tuple[Initial | Repeated, ...]


class MemberInitial(Node):
    """One field in the initialiser of a structure, written `name := value`."""

    name: str
    value: Initial


class StructInitial(Node):
    """The initialiser of a structure, written `(a := 1, b := 2)`."""

    members: tuple[MemberInitial, ...]


Initial = Expression | NumberTable | ArrayInitial | StructInitial


# --- types ------------------------------------------------------------------------------------------------------------


class NamedType(Node):
    """A type by its name; of a library it may be qualified by a namespace."""

    name: str


class StringSpec(Node):
    """A string type, written `STRING(80)`; without a length it holds 80 characters."""

    length: Expression | None
    wide: bool = False


class ArraySpec(Node):
    """An array type, written `ARRAY[0..1, 1..3] OF element`."""

    ranges: tuple[Range, ...]
    element: TypeSpec


class SubrangeSpec(Node):
    """A subrange type, written `DINT(0..10)`."""

    base: str
    range: Range


class PointerSpec(Node):
    """A type that points at another, written `POINTER TO target` or `REFERENCE TO target`."""

    target: TypeSpec
    is_reference: bool = False


TypeSpec = NamedType | StringSpec | ArraySpec | SubrangeSpec | PointerSpec


# --- variables, types and units ---------------------------------------------------------------------------------------


class VariableDeclaration(Node):
    """One declared name; `a, b : DINT` makes two of them."""

    name: str
    type: TypeSpec
    initial: Initial | None = None
    address: str | None = None
    attributes: tuple[str, ...] = ()


class VariableBlock(Node):
    """The variables from VAR to END_VAR; the qualifiers are CONSTANT, RETAIN, PERSISTENT."""

    section: Section
    qualifiers: frozenset[str]
    variables: tuple[VariableDeclaration, ...]


class StructDeclaration(Node):
    """A structure or, with `is_union`, a union."""

    name: str
    base: str | None
    fields: tuple[VariableDeclaration, ...]
    is_union: bool = False
    attributes: tuple[str, ...] = ()


class Enumerator(Node):
    """One value of an enumeration with its number, if that is written."""

    name: str
    value: Expression | None


class EnumDeclaration(Node):
    """An enumeration, written `(A, B := 5) UINT := B`."""

    name: str
    values: tuple[Enumerator, ...]
    base: str | None
    default: Expression | None
    attributes: tuple[str, ...] = ()


class AliasDeclaration(Node):
    """A name for a type, written `T : ARRAY[0..3] OF LREAL := [..]`."""

    name: str
    type: TypeSpec
    initial: Initial | None
    attributes: tuple[str, ...] = ()


TypeDeclaration = StructDeclaration | EnumDeclaration | AliasDeclaration


class PouDeclaration(Node):
    """A function, function block, program or method with its variables and body."""

    kind: PouKind
    name: str
    blocks: tuple[VariableBlock, ...]
    body: tuple[Statement, ...]
    return_type: TypeSpec | None = None
    base: str | None = None
    modifiers: frozenset[str] = frozenset()
    methods: tuple[PouDeclaration, ...] = ()
    attributes: tuple[str, ...] = ()


class GlobalDeclarations(Node):
    """The VAR_GLOBAL blocks of one file; `name` is the list's name, by which its variables can be qualified."""

    name: str
    blocks: tuple[VariableBlock, ...]
    attributes: tuple[str, ...] = ()


class TaskDeclaration(Node):
    """A task with the time between its calls; of two that wait, the one with the smaller priority goes first."""

    name: str
    interval: Expression
    priority: Expression


class ProgramInstance(Node):
    """A program that a task calls."""

    name: str
    task: str
    program: str


class ConfigurationDeclaration(Node):
    """A CONFIGURATION of one RESOURCE: its tasks, and the programs that they call, in order."""

    name: str
    resource: str
    platform: str
    tasks: tuple[TaskDeclaration, ...]
    programs: tuple[ProgramInstance, ...]


Declaration = TypeDeclaration | PouDeclaration | GlobalDeclarations | ConfigurationDeclaration
