"""The syntax tree: what the grammar finds, before names and types are known.

Positions never take part in comparisons, so two texts that differ only in layout have equal trees.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.errors import Position

_NOWHERE = Position("", 0, 0)


@dataclass(frozen=True, kw_only=True)
class Node:
    """Base of all nodes."""

    position: Position = field(default=_NOWHERE, compare=False, repr=False)


# --- expressions ------------------------------------------------------------------------------------------------------


class LiteralKind(Enum):
    """What a literal looks like."""

    INTEGER = "integer"
    REAL = "real"
    BOOL = "bool"
    STRING = "string"
    WSTRING = "wstring"
    TIME = "time"
    LTIME = "ltime"


@dataclass(frozen=True)
class Literal(Node):
    """A literal; `type_name` is the prefix of a typed one (`DINT#5`), upper case. Durations are in nanoseconds."""

    kind: LiteralKind
    value: bool | int | float | str
    type_name: str | None = None


@dataclass(frozen=True)
class EnumLiteral(Node):
    """`E_Mode#Idle`."""

    type_name: str
    name: str


@dataclass(frozen=True)
class Identifier(Node):
    """A plain name."""

    name: str


@dataclass(frozen=True)
class Member(Node):
    """`base.name`."""

    base: Expression
    name: str


@dataclass(frozen=True)
class Subscript(Node):
    """`base[i, j]`."""

    base: Expression
    indices: tuple[Expression, ...]


@dataclass(frozen=True)
class Dereference(Node):
    """`base^`."""

    base: Expression


@dataclass(frozen=True)
class This(Node):
    """`THIS^`."""


@dataclass(frozen=True)
class Super(Node):
    """`SUPER^`."""


@dataclass(frozen=True)
class Argument(Node):
    """An argument: positional (`name` is None), `name := value` or `name => value`; the value may be left out."""

    name: str | None
    value: Expression | None
    is_output: bool = False


@dataclass(frozen=True)
class Call(Node):
    """`callee(arguments)`."""

    callee: Expression
    arguments: tuple[Argument, ...]


@dataclass(frozen=True)
class Unary(Node):
    """`operator` is `-`, `+` or `NOT`."""

    operator: str
    operand: Expression


@dataclass(frozen=True)
class Binary(Node):
    """`operator` is as written, upper case; `&` is AND."""

    operator: str
    left: Expression
    right: Expression


Expression = (
    Literal | EnumLiteral | Identifier | Member | Subscript | Dereference | This | Super | Call | Unary | Binary
)


# --- initial values ---------------------------------------------------------------------------------------------------


class TableKind(Enum):
    """Which literals a table of numbers holds."""

    INTEGER = "integer"
    REAL = "real"
    MIXED = "integer and real"
    BOOL = "bool"


@dataclass(frozen=True, eq=False)
class Table(Node):
    """An array initialiser of plain numbers, read as one token; `values` is int64, uint64, float64 or bool."""

    values: NDArray[np.generic]
    kind: TableKind

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Table):
            return NotImplemented
        same_type = self.kind is other.kind and self.values.dtype == other.values.dtype
        return same_type and self.values.tobytes() == other.values.tobytes()

    def __hash__(self) -> int:
        return hash((self.kind, self.values.size))


@dataclass(frozen=True)
class Repeat(Node):
    """`50(0.0)` in an array initialiser."""

    count: int
    value: Initial | None


@dataclass(frozen=True)
class ArrayInitial(Node):
    """`[..]` with anything but plain numbers in it."""

    items: tuple[Initial | Repeat, ...]


@dataclass(frozen=True)
class MemberInitial(Node):
    """`name := value` in a structure initialiser."""

    name: str
    value: Initial


@dataclass(frozen=True)
class StructInitial(Node):
    """`(a := 1, b := 2)`."""

    members: tuple[MemberInitial, ...]


Initial = Expression | Table | ArrayInitial | StructInitial


# --- types ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NamedType(Node):
    """A type by its name; of a library it may be qualified by a namespace."""

    name: str


@dataclass(frozen=True)
class StringSpec(Node):
    """`STRING(80)`; without a length 80 characters."""

    length: Expression | None
    wide: bool = False


@dataclass(frozen=True)
class Range(Node):
    """`lower..upper`."""

    lower: Expression
    upper: Expression


@dataclass(frozen=True)
class ArraySpec(Node):
    """`ARRAY[0..1, 1..3] OF element`."""

    ranges: tuple[Range, ...]
    element: TypeSpec


@dataclass(frozen=True)
class SubrangeSpec(Node):
    """`DINT(0..10)`."""

    base: str
    range: Range


@dataclass(frozen=True)
class PointerSpec(Node):
    """`POINTER TO target`."""

    target: TypeSpec


@dataclass(frozen=True)
class ReferenceSpec(Node):
    """`REFERENCE TO target`."""

    target: TypeSpec


TypeSpec = NamedType | StringSpec | ArraySpec | SubrangeSpec | PointerSpec | ReferenceSpec


# --- statements -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Assignment(Node):
    """`target := value;`."""

    target: Expression
    value: Expression


@dataclass(frozen=True)
class CallStatement(Node):
    """A call as a statement."""

    call: Call


@dataclass(frozen=True)
class Branch(Node):
    """One IF or ELSIF."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class If(Node):
    """`otherwise` is None without ELSE."""

    branches: tuple[Branch, ...]
    otherwise: tuple[Statement, ...] | None


@dataclass(frozen=True)
class CaseBranch(Node):
    """The labels of one branch and its statements."""

    labels: tuple[Expression | Range, ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class Case(Node):
    """`otherwise` is None without ELSE."""

    selector: Expression
    branches: tuple[CaseBranch, ...]
    otherwise: tuple[Statement, ...] | None


@dataclass(frozen=True)
class For(Node):
    """`step` is None without BY."""

    counter: Expression
    start: Expression
    stop: Expression
    step: Expression | None
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class While(Node):
    """WHILE."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class RepeatUntil(Node):
    """REPEAT .. UNTIL."""

    body: tuple[Statement, ...]
    condition: Expression


@dataclass(frozen=True)
class Exit(Node):
    """EXIT."""


@dataclass(frozen=True)
class Continue(Node):
    """CONTINUE."""


@dataclass(frozen=True)
class Return(Node):
    """RETURN."""


@dataclass(frozen=True)
class Empty(Node):
    """A lone semicolon."""


Statement = Assignment | CallStatement | If | Case | For | While | RepeatUntil | Exit | Continue | Return | Empty


# --- declarations -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class VariableDeclaration(Node):
    """One declared name; `a, b : DINT` makes two of them."""

    name: str
    type: TypeSpec
    initial: Initial | None = None
    address: str | None = None
    attributes: tuple[str, ...] = ()


@dataclass(frozen=True)
class VariableBlock(Node):
    """VAR .. END_VAR: `section` is the opening keyword, `qualifiers` CONSTANT, RETAIN, PERSISTENT."""

    section: str
    qualifiers: frozenset[str]
    variables: tuple[VariableDeclaration, ...]


@dataclass(frozen=True)
class StructDeclaration(Node):
    """STRUCT or, with `is_union`, UNION."""

    name: str
    base: str | None
    fields: tuple[VariableDeclaration, ...]
    is_union: bool = False
    attributes: tuple[str, ...] = ()


@dataclass(frozen=True)
class EnumValue(Node):
    """One value of an enumeration."""

    name: str
    value: Expression | None


@dataclass(frozen=True)
class EnumDeclaration(Node):
    """`(A, B := 5) UINT := B`."""

    name: str
    values: tuple[EnumValue, ...]
    base: str | None
    default: Expression | None
    attributes: tuple[str, ...] = ()


@dataclass(frozen=True)
class AliasDeclaration(Node):
    """`T : ARRAY[0..3] OF LREAL := [..]`."""

    name: str
    type: TypeSpec
    initial: Initial | None
    attributes: tuple[str, ...] = ()


TypeDeclaration = StructDeclaration | EnumDeclaration | AliasDeclaration


class PouKind(Enum):
    """The four kinds of code."""

    FUNCTION = "FUNCTION"
    FUNCTION_BLOCK = "FUNCTION_BLOCK"
    PROGRAM = "PROGRAM"
    METHOD = "METHOD"


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class GlobalList(Node):
    """The VAR_GLOBAL blocks of one file; `name` is the list's name, by which its variables can be qualified."""

    name: str
    blocks: tuple[VariableBlock, ...]
    attributes: tuple[str, ...] = ()


Declaration = TypeDeclaration | PouDeclaration | GlobalList
