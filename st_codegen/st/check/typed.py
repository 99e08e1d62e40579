"""The typed tree: names resolved, types known, every conversion explicit. All back ends read this and nothing else.

Objects of declarations (`Variable`, `Pou`) are compared by identity. A `Pou` is referred to by its key, the upper-case
qualified name (`FB_X`, `FB_X.RESET`), and found in `Project.pous`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType

from st_codegen.st.check.types import Dialect, Type
from st_codegen.st.check.values import Scalar, Value
from st_codegen.st.errors import Position
from st_codegen.st.syntax.nodes import PouKind

# --- declarations -----------------------------------------------------------------------------------------------------


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
    qualifiers: frozenset[str] = frozenset()
    address: str | None = None
    attributes: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """The name in upper case."""
        return self.name.upper()

    def __repr__(self) -> str:
        return f"<{self.owner}.{self.name} : {self.type}>"


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
    attributes: tuple[str, ...] = ()
    is_native: bool = False

    def section(self, *sections: Section) -> tuple[Variable, ...]:
        """The variables of some kinds, in order."""
        return tuple(variable for variable in self.variables if variable.section in sections)


@dataclass(frozen=True, eq=False)
class Project:
    """A checked project."""

    dialect: Dialect
    pous: Mapping[str, Pou]
    types: Mapping[str, Type]
    globals: Mapping[str, tuple[Variable, ...]]

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

    def find_method(self, block: str, name: str) -> Pou | None:
        """The method that a call of `name` on a `block` reaches, inherited ones included."""
        for pou in self.lineage(block):
            if name.upper() in pou.methods:
                return self.pous[pou.methods[name.upper()]]
        return None


# --- expressions ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Typed:
    """Base of all expressions."""

    type: Type = field(repr=False)
    position: Position = field(compare=False, repr=False)


@dataclass(frozen=True)
class Constant(Typed):
    """A literal or enumeration value, as a value of `type`; REAL values are already rounded."""

    value: Scalar


@dataclass(frozen=True)
class VariableRef(Typed):
    """A variable of the unit itself, of the instance it runs on, or a global one."""

    variable: Variable


@dataclass(frozen=True)
class InstanceVariable(Typed):
    """`base.variable` where `base` is an instance of a block."""

    base: Expression
    variable: Variable


@dataclass(frozen=True)
class FieldRef(Typed):
    """`base.name` where `base` is a structure or union; `name` is in upper case."""

    base: Expression
    name: str


@dataclass(frozen=True)
class ElementRef(Typed):
    """`base[indices]`; the index types are integers, the bounds those of the type of `base`."""

    base: Expression
    indices: tuple[Expression, ...]


@dataclass(frozen=True)
class ThisRef(Typed):
    """The instance a body or method runs on."""


@dataclass(frozen=True)
class ProgramRef(Typed):
    """The one instance of a program; `type` is its `BlockType`."""


@dataclass(frozen=True)
class PointerTarget(Typed):
    """`pointer^`."""

    pointer: Expression


@dataclass(frozen=True)
class AddressOf(Typed):
    """`ADR(target)`."""

    target: Expression


class Overflow(Enum):
    """What happens when an integer result leaves its type.

    WRAP where the result is stored in a variable of that type, or has 64 bits: two's complement. ERROR elsewhere:
    controllers keep wider intermediate results, so the value would depend on the target.
    """

    WRAP = "wrap"
    ERROR = "error"


@dataclass(frozen=True)
class Unary(Typed):
    """`operator` is NEG or NOT."""

    operator: str
    operand: Expression
    overflow: Overflow = Overflow.WRAP


@dataclass(frozen=True)
class Binary(Typed):
    """`operator` is ADD, SUB, MUL, DIV, MOD, AND, OR or XOR; both operands have the type of the result.

    The exception: durations are multiplied and divided by integers, which are of type DINT then.
    """

    operator: str
    left: Expression
    right: Expression
    overflow: Overflow = Overflow.WRAP


@dataclass(frozen=True)
class ShortCircuit(Typed):
    """AND_THEN or OR_ELSE: the right operand is evaluated only where the left one does not decide."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Comparison(Typed):
    """`operator` is EQ, NE, LT, LE, GT or GE; `is_self_test` marks the portable NaN test `x = x`."""

    operator: str
    left: Expression
    right: Expression
    is_self_test: bool = False


@dataclass(frozen=True)
class Conversion(Typed):
    """A change of type; `is_implicit` when the text does not ask for it. To integers: to nearest, ties to even."""

    operand: Expression
    is_implicit: bool = False


@dataclass(frozen=True)
class StandardCall(Typed):
    """A standard function; conversions, MOVE and the functions that are operators are not among them."""

    function: str
    arguments: tuple[Expression, ...]


class Passing(Enum):
    """How an argument travels."""

    INPUT = "input"
    OUTPUT = "output"
    IN_OUT = "in_out"


@dataclass(frozen=True)
class CallArgument:
    """An argument and the parameter it belongs to; INPUT values are converted already, the others are variables."""

    parameter: Variable
    value: Expression
    passing: Passing


@dataclass(frozen=True)
class Call(Typed):
    """A call of a function, method, program or instance of a block; `type` is BOOL, unused, without a result.

    `receiver` is the instance of a block or method call. `is_virtual` calls reach the method of the receiver's real
    type, others exactly `callee`.
    """

    callee: str
    receiver: Expression | None
    arguments: tuple[CallArgument, ...]
    is_virtual: bool = False
    has_result: bool = True


Expression = (
    Constant
    | VariableRef
    | InstanceVariable
    | FieldRef
    | ElementRef
    | ThisRef
    | ProgramRef
    | PointerTarget
    | AddressOf
    | Unary
    | Binary
    | ShortCircuit
    | Comparison
    | Conversion
    | StandardCall
    | Call
)


# --- statements -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class TypedStatement:
    """Base of all statements."""

    position: Position = field(compare=False, repr=False)


@dataclass(frozen=True)
class Assign(TypedStatement):
    """`target := value`, both of the same type; structures and arrays are copied."""

    target: Expression
    value: Expression


@dataclass(frozen=True)
class CallStatement(TypedStatement):
    """A call whose result, if any, is dropped."""

    call: Call


@dataclass(frozen=True)
class Branch:
    """A condition and what runs where it holds."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class If(TypedStatement):
    """The first branch whose condition holds runs, or `otherwise`."""

    branches: tuple[Branch, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True)
class CaseBranch:
    """Labels as inclusive ranges, and what runs when the selector is in one of them."""

    labels: tuple[tuple[int, int], ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class Case(TypedStatement):
    """No two labels overlap."""

    selector: Expression
    branches: tuple[CaseBranch, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True)
class For(TypedStatement):
    """`start`, `stop` and `step` have the counter's type and are evaluated once; the body does not assign the counter.

    After the loop the counter has the first value beyond `stop`.
    """

    counter: VariableRef
    start: Expression
    stop: Expression
    step: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class While(TypedStatement):
    """Tests before each round."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class Repeat(TypedStatement):
    """Tests after each round and stops when the condition holds."""

    body: tuple[Statement, ...]
    condition: Expression


@dataclass(frozen=True)
class Exit(TypedStatement):
    """Leaves the innermost loop."""


@dataclass(frozen=True)
class Continue(TypedStatement):
    """Goes to the next round of the innermost loop."""


@dataclass(frozen=True)
class Return(TypedStatement):
    """Leaves the unit."""


Statement = Assign | CallStatement | If | Case | For | While | Repeat | Exit | Continue | Return


def is_place(expression: Expression) -> bool:
    """Whether an expression names something that can be assigned or passed by reference."""
    return isinstance(expression, VariableRef | InstanceVariable | FieldRef | ElementRef | PointerTarget)


def root_variable(expression: Expression) -> Variable | None:
    """The variable that a path of fields and indices starts from; None behind a pointer or at THIS^."""
    while isinstance(expression, FieldRef | ElementRef | InstanceVariable):
        expression = expression.base
    return expression.variable if isinstance(expression, VariableRef) else None
