"""The tree of Structured Text: the parser makes it, the checker gives it back with all that it found out.

What stands only in a tree before the check are `Literal`, `EnumLiteral`, `Identifier`, `Member`, `Super` and `Omitted`:
names and literals whose meaning depends on what is declared. What the checker alone makes are `Constant`,
`VariableRef`, `InstanceVariable`, `FieldRef`, `ProgramRef`, `AddressOf`, `Conversion`, `StandardCall`, `Variable`,
`Pou` and `Project`. In a checked tree every expression has its type and every conversion is explicit; the engine and
the cost model read only checked trees.

Positions never take part in comparisons, so two texts that differ only in layout have equal trees. `Variable`, `Pou`
and `Project` are compared by identity. A `Pou` is referred to by its key, the upper-case qualified name (`FB_X`,
`FB_X.RESET`), and found in `Project.pous`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, dataclass_transform

from st_codegen.st.errors import Position
from st_codegen.st.types import UNKNOWN, Scalar, Type, Value

_NOWHERE = Position("", 0, 0)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
@dataclass(frozen=True)
class Node:
    """The base of all nodes. Each class below it is a frozen dataclass, too."""

    position: Position = field(default=_NOWHERE, compare=False, repr=False, kw_only=True)

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)


class Expression(Node):
    """The base of all expressions; the type is `UNKNOWN` until the checker has found it."""

    type: Type = field(default=UNKNOWN, repr=False, kw_only=True)


class Statement(Node):
    """The base of all statements."""


# --- variables --------------------------------------------------------------------------------------------------------


class Section(Enum):
    """The kind of VAR block a variable stands in; RESULT is the value of a function or method."""

    VAR = "VAR"
    INPUT = "VAR_INPUT"
    OUTPUT = "VAR_OUTPUT"
    IN_OUT = "VAR_IN_OUT"
    TEMP = "VAR_TEMP"
    GLOBAL = "VAR_GLOBAL"
    RESULT = "result"


class Storage(Enum):
    """Where a variable lives: in an instance of a block, in a call of a function or method, or once."""

    INSTANCE = "instance"
    LOCAL = "local"
    GLOBAL = "global"


@dataclass(frozen=True, eq=False)
class Variable:
    """A declared variable; `owner` is the key of its unit or the upper-case name of its list of globals."""

    name: str
    type: Type
    section: Section
    storage: Storage
    owner: str
    initial: Value
    position: Position
    is_constant: bool = False
    has_initial: bool = False

    @property
    def key(self) -> str:
        """The name of the variable in upper case."""
        return self.name.upper()

    def __repr__(self) -> str:
        return f"<{self.owner}.{self.name} : {self.type}>"


# --- expressions: names and literals as they are written --------------------------------------------------------------


class LiteralKind(Enum):
    """How a literal is written."""

    INTEGER = "integer"
    REAL = "real"
    BOOL = "bool"
    STRING = "string"
    WSTRING = "wstring"
    TIME = "time"
    LTIME = "ltime"


class Literal(Expression):
    """A literal; `type_name` is the prefix of a typed one (`DINT#5`), upper case. Durations are in nanoseconds."""

    kind: LiteralKind
    value: bool | int | float | str
    type_name: str | None = None


class EnumLiteral(Expression):
    """A value of an enumeration, written `E_Mode#Idle`."""

    type_name: str
    name: str


class Identifier(Expression):
    """A plain name, of whatever it will be."""

    name: str


class Member(Expression):
    """A name behind a dot, `base.name`."""

    base: Expression
    name: str


class Super(Expression):
    """The block that this one extends, written `SUPER^`."""


class Omitted(Expression):
    """The value of an argument that is named without one, as in `f(x := )`."""


# --- expressions: what names mean -------------------------------------------------------------------------------------


class Constant(Expression):
    """A literal or enumeration value, as a value of `type`; REAL values are already rounded."""

    value: Scalar


class VariableRef(Expression):
    """A variable of the unit itself, of the instance it runs on, or a global one."""

    variable: Variable


class InstanceVariable(Expression):
    """`base.variable` where `base` is an instance of a block."""

    base: Expression
    variable: Variable


class FieldRef(Expression):
    """`base.name` where `base` is a structure or union; `name` is in upper case."""

    base: Expression
    name: str


class ElementRef(Expression):
    """`base[indices]`; the types of checked indices are integers, the bounds those of the type of `base`."""

    base: Expression
    indices: tuple[Expression, ...]


class ThisRef(Expression):
    """`THIS^`, the instance a body or method runs on; the checker also puts it where the text leaves it out."""


class ProgramRef(Expression):
    """The one instance of a program; `type` is its `BlockType`."""


class PointerTarget(Expression):
    """`pointer^`; the checker also puts it where a reference stands for what it refers to."""

    pointer: Expression


class AddressOf(Expression):
    """The address of a variable, written `ADR(target)`."""

    target: Expression


# --- expressions: operators and calls ---------------------------------------------------------------------------------


class Overflow(Enum):
    """What happens when an integer result leaves its type.

    WRAP where the result is stored in a variable of that type, or has 64 bits: two's complement. ERROR elsewhere:
    controllers keep wider intermediate results, so the value would depend on the target.
    """

    WRAP = "wrap"
    ERROR = "error"


class Unary(Expression):
    """`operator` is NEG or NOT; a plus sign, POS, is gone after the check."""

    operator: str
    operand: Expression
    overflow: Overflow = Overflow.WRAP


class Infix(Expression):
    """The base of what stands between two operands."""

    operator: str
    left: Expression
    right: Expression


class Binary(Infix):
    """`operator` is ADD, SUB, MUL, DIV, MOD, AND, OR or XOR; both operands have the type of the result.

    The exception: durations are multiplied and divided by integers, which are of type DINT then. EXPT, as `**`, is a
    `StandardCall` after the check.
    """

    overflow: Overflow = Overflow.WRAP


class ShortCircuit(Infix):
    """AND_THEN or OR_ELSE: the right operand is evaluated only where the left one does not decide."""


class Compare(Infix):
    """`operator` is EQ, NE, LT, LE, GT or GE.

    `is_number_test` marks both halves of `x < 1.0 OR x > -1.0`: at least one holds for every number, neither for NaN.
    """

    is_number_test: bool = False


class Conversion(Expression):
    """A change of type, whether the text asks for it or not. To integers: to nearest, ties to even."""

    operand: Expression


class StandardCall(Expression):
    """A standard function; conversions, MOVE and the functions that are operators are not among them."""

    function: str
    arguments: tuple[Expression, ...]


class Passing(Enum):
    """Which way the value of an argument goes."""

    INPUT = "input"
    OUTPUT = "output"
    IN_OUT = "in_out"


_UNDECLARED = Variable("", UNKNOWN, Section.VAR, Storage.LOCAL, "", None, _NOWHERE)


class Argument(Node):
    """An argument: positional (`name` is None), `name := value` or `name => value`, which is an OUTPUT.

    The checker finds the `parameter` it belongs to, tells IN_OUT from INPUT and drops omitted ones; INPUT values are
    converted then, the others are variables.
    """

    name: str | None
    value: Expression
    passing: Passing = Passing.INPUT
    parameter: Variable = _UNDECLARED


class Call(Expression):
    """`function(arguments)`, a call of a function, method, program or instance of a block.

    The checker finds the rest: `callee` is the key of the unit, `receiver` the instance of a block or method call.
    `is_virtual` calls reach the method of the receiver's real type, others exactly `callee`. Without a result `type` is
    BOOL, unused.
    """

    function: Expression
    arguments: tuple[Argument, ...]
    callee: str = ""
    receiver: Expression | None = None
    is_virtual: bool = False
    has_result: bool = True


# --- statements -------------------------------------------------------------------------------------------------------


class Assign(Statement):
    """`target := value`, both of the same type after the check; structures and arrays are copied."""

    target: Expression
    value: Expression


class CallStatement(Statement):
    """A call whose result, if any, is dropped."""

    call: Call


class Branch(Node):
    """A condition and what runs where it holds: an IF or ELSIF."""

    condition: Expression
    body: tuple[Statement, ...]


class If(Statement):
    """The first branch whose condition holds runs, or `otherwise`."""

    branches: tuple[Branch, ...]
    otherwise: tuple[Statement, ...]


class Range(Node):
    """A range `lower..upper`; a single value is a range of one."""

    lower: Expression
    upper: Expression


class CaseBranch(Node):
    """What runs when the selector is one of the `choices`; the checker gives `labels`, the numbers of these ranges."""

    choices: tuple[Range, ...]
    body: tuple[Statement, ...]
    labels: tuple[tuple[int, int], ...] = ()


class Case(Statement):
    """A choice by a number; no two labels overlap."""

    selector: Expression
    branches: tuple[CaseBranch, ...]
    otherwise: tuple[Statement, ...]


class For(Statement):
    """A counting loop; `start`, `stop` and `step` are evaluated once, and the body does not assign the counter.

    After the check they have the counter's type. Behind the loop the counter has the first value beyond `stop`.
    """

    counter: Expression
    start: Expression
    stop: Expression
    step: Expression
    body: tuple[Statement, ...]

    @property
    def variable(self) -> Variable:
        """The variable that counts, known once the loop is checked."""
        assert isinstance(self.counter, VariableRef)
        return self.counter.variable


class While(Statement):
    """A loop that tests before each round."""

    condition: Expression
    body: tuple[Statement, ...]


class Repeat(Statement):
    """A loop that tests after each round and stops when the condition holds."""

    body: tuple[Statement, ...]
    condition: Expression


class Exit(Statement):
    """EXIT, which leaves the innermost loop."""


class Continue(Statement):
    """CONTINUE, which goes to the next round of the innermost loop."""


class Return(Statement):
    """RETURN, which leaves the unit."""


# --- the checked project ----------------------------------------------------------------------------------------------


class PouKind(Enum):
    """The kinds of units of code."""

    FUNCTION = "FUNCTION"
    FUNCTION_BLOCK = "FUNCTION_BLOCK"
    PROGRAM = "PROGRAM"
    METHOD = "METHOD"


@dataclass(frozen=True, eq=False)
class Pou:
    """A program organisation unit or method. `block` is the owning block of a method, `base` what a block extends.

    `variables` are its own, in order, without inherited ones; a native unit has no body and is executed by Python.
    """

    kind: PouKind
    name: str
    key: str
    variables: tuple[Variable, ...]
    body: tuple[Statement, ...]
    position: Position
    result: Variable | None = None
    block: str | None = None
    base: str | None = None
    methods: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    modifiers: frozenset[str] = frozenset()
    is_native: bool = False

    @property
    def full_name(self) -> str:
        """The name, of a method behind that of its block."""
        return self.name if self.block is None else f"{self.block}.{self.name}"

    def section(self, *sections: Section) -> tuple[Variable, ...]:
        """The variables of some kinds of VAR blocks, in order."""
        return tuple(variable for variable in self.variables if variable.section in sections)


@dataclass(frozen=True, eq=False)
class Project:
    """All that a checked project declares, by upper-case names."""

    pous: Mapping[str, Pou]
    types: Mapping[str, Type]
    globals: Mapping[str, tuple[Variable, ...]]
    #: What later stages keep of this project, each under a key of its own; it goes when the project goes.
    kept: dict[object, Any] = field(default_factory=dict, repr=False)

    def lineage(self, block: str) -> Iterator[Pou]:
        """A block and what it extends, nearest first."""
        key: str | None = block.upper()
        while key is not None:
            pou = self.pous[key]
            yield pou
            key = pou.base

    def block_variables(self, block: str) -> tuple[Variable, ...]:
        """All variables of an instance, those of the eldest ancestor first; VAR_TEMP is not part of it."""
        lineage = list(self.lineage(block))
        return tuple(
            variable for pou in reversed(lineage) for variable in pou.variables if variable.storage is Storage.INSTANCE
        )


# --- questions about expressions --------------------------------------------------------------------------------------


def is_place(expression: Expression) -> bool:
    """Whether an expression names something that can be assigned or passed by reference."""
    return isinstance(expression, VariableRef | InstanceVariable | FieldRef | ElementRef | PointerTarget)


def root_variable(expression: Expression) -> Variable | None:
    """The variable that a path of fields and indices starts from; None behind a pointer or at THIS^."""
    while isinstance(expression, FieldRef | ElementRef | InstanceVariable):
        expression = expression.base
    return expression.variable if isinstance(expression, VariableRef) else None
