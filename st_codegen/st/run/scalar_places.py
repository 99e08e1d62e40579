"""Where values live in the code for a single lane, and what is known about the range of integers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, cast

from st_codegen.st import tree as t
from st_codegen.st.errors import Position
from st_codegen.st.run.emit import Writer, is_inlined, literal
from st_codegen.st.run.lane_places import is_elementary, is_union_field, refusal
from st_codegen.st.types import ArrayType, PointerType, StructType, storage_type

if TYPE_CHECKING:
    from st_codegen.st.run.scalar_code import ScalarCode

Range = tuple[int, int]
# What is known while a local variable keeps its value: its name comes second. ("check", name, low, high) is an index
# that was compared with its bounds, ("load", name, code) an element of a constant table that a temporary has.
Fact = tuple[str, str, object, object]


class ScalarPlaces(Writer):
    """Writes code that reads and assigns places.

    Values are Python expressions that have no effect, raise nothing and cost little, so that they may be repeated.
    Elementary variables of the instance are held in Python's local variables while the unit runs.
    """

    def __init__(self, compiler: ScalarCode, pou: t.Pou, boxed: set[t.Variable], cached: set[t.Variable]) -> None:
        super().__init__(compiler.source)
        self.compiler = compiler
        self.pou = pou
        self.boxed = boxed
        self.cached = cached
        self.counter_ranges: dict[t.Variable, Range] = {}
        self.facts: dict[Fact, str] = {}
        self.is_unstable = False

    def expression(self, expression: t.Expression) -> str:
        """Code for the value of an elementary expression."""
        raise NotImplementedError

    # --- temporaries and faults ---

    def temporary(self, code: str, position: Position) -> str:
        """A name for the value of a piece of code."""
        name = self.fresh()
        self.line(f"{name} = {code}", position)
        return name

    def atom(self, expression: t.Expression) -> str:
        """A name or literal for the value of an expression."""
        code = self.expression(expression)
        return code if _is_atom(code) else self.temporary(code, expression.position)

    def place_id(self, position: Position) -> str:
        """The number under which a fault finds its position."""
        positions = self.compiler.positions
        positions.append(position)
        return str(len(positions) - 1)

    # --- facts ---

    def forget(self, name: str) -> None:
        """Drop what was known about a local variable."""
        self.facts = {fact: value for fact, value in self.facts.items() if fact[1] != name}

    @contextmanager
    def branch(self) -> Iterator[None]:
        """Code that may not run: what it finds out holds inside only, what it makes wrong is forgotten outside."""
        before = dict(self.facts)
        yield
        self.facts = {fact: value for fact, value in before.items() if fact in self.facts}

    # --- ranges ---

    def range_of(self, expression: t.Expression, depth: int = 4) -> Range:
        """Bounds of an integer expression, from its type and from the loops around it; looks `depth` levels down."""
        type_ = storage_type(expression.type)
        full = (type_.lower, type_.upper)
        match expression:
            case t.Constant(value=value):
                return int(cast(int, value)), int(cast(int, value))
            case t.VariableRef(variable=variable) if is_inlined(variable):
                return cast(int, variable.initial), cast(int, variable.initial)
            case t.VariableRef(variable=variable):
                return self.counter_ranges.get(variable, full)
            case t.Conversion(operand=operand) if depth and storage_type(operand.type).is_integral:
                low, high = self.range_of(operand, depth - 1)
                return (low, high) if full[0] <= low and high <= full[1] else full
            case t.Binary(operator="ADD" | "SUB" | "MUL") if depth:
                low, high = self.exact_range(expression, depth - 1)
                return (low, high) if full[0] <= low and high <= full[1] else full
            case _:
                return full

    def exact_range(self, expression: t.Binary, depth: int = 4) -> Range:
        """Bounds of a sum, difference or product before it overflows."""
        (a, b), (c, d) = self.range_of(expression.left, depth), self.range_of(expression.right, depth)
        if expression.operator == "ADD":
            return a + c, b + d
        if expression.operator == "SUB":
            return a - d, b - c
        products = (a * c, a * d, b * c, b * d)
        return min(products), max(products)

    # --- objects ---

    def slot(self, variable: t.Variable) -> str:
        """Where a variable is, as Python source that can be assigned."""
        if variable in self.cached:
            return f"v_{variable.key}"
        match variable.storage:
            case t.Storage.INSTANCE:
                return f"s.v_{variable.key}"
            case t.Storage.GLOBAL:
                return f"rt.g.v_{variable.owner}__{variable.key}"
        if variable.is_constant:
            return self.compiler.constant(variable)
        return f"v_{variable.key}.v" if variable in self.boxed else f"v_{variable.key}"

    def object(self, place: t.Expression) -> str:  # noqa: PLR0911 - one return a case
        """The object that a place of a composite type is, or the slot of an elementary one."""
        match place:
            case t.VariableRef():
                return self._table(place.variable) or self.slot(place.variable)
            case t.ThisRef():
                return "s"
            case t.ProgramRef():
                return f"rt.p_{str(place.type).upper()}"
            case t.InstanceVariable():
                return f"{self.object(place.base)}.v_{place.variable.key}"
            case t.FieldRef():
                return f"{self.object(place.base)}.v_{place.name}"
            case t.ElementRef():
                return self.element(place)
            case t.Call():
                return self.expression(place)
            case _:
                raise refusal(place)

    def _table(self, variable: t.Variable) -> str | None:
        """A constant of a composite type, held by the code itself where it is a table of numbers."""
        return (
            self.compiler.constant(variable) if variable.is_constant and isinstance(variable.type, ArrayType) else None
        )

    def element(self, place: t.ElementRef) -> str:
        """Code for an element of an array; repeatable only where `index` left nothing to check."""
        return f"{self.object(place.base)}[{self.index(place)}]"

    def index(self, place: t.ElementRef) -> str:
        """Code for a checked flat index, counted from zero."""
        array = cast(ArrayType, place.base.type)
        total, factor_rest = "", list(array.shape)
        for item, (low, high) in zip(place.indices, array.bounds, strict=True):
            size = factor_rest.pop(0)
            part = self._index_part(item, low, high)
            total = part if not total else f"({total}) * {size} + {part}"
        return total

    def _index_part(self, item: t.Expression, low: int, high: int) -> str:
        if isinstance(item, t.Constant):
            return str(cast(int, item.value) - low)
        smallest, largest = self.range_of(item)
        code = self.expression(item) if low <= smallest and largest <= high else self.atom(item)
        test = f"not {low} <= {code} <= {high}" if smallest < low else f"{code} > {high}"
        fact = ("check", code, low, high)
        if (smallest < low or largest > high) and fact not in self.facts:
            where = self.place_id(item.position)
            self.line(f"if {test}: index_fault({where}, {code}, {low}, {high})", item.position)
            self.facts[fact] = ""
        return f"{code} - {low}" if low > 0 else f"{code} + {-low}" if low < 0 else code

    # --- reading and assigning ---

    def read(self, place: t.Expression) -> str:
        """Code for the value of an elementary place."""
        code = self._read(place)
        return self.temporary(code, place.position) if self.is_unstable and not _is_literal(code) else code

    def _read(self, place: t.Expression) -> str:
        if isinstance(place, t.VariableRef | t.InstanceVariable) and is_inlined(place.variable):
            return literal(cast(int, place.variable.initial))
        if isinstance(place, t.VariableRef) and place.variable.section is t.Section.IN_OUT:
            return self.temporary(f"{self.slot(place.variable)}.get()", place.position)
        union = self.union_field(place)
        if union is not None:
            return self.temporary(f"{union[0]}.get({union[1]}, {union[2]})", place.position)
        if isinstance(place, t.ElementRef):
            return self._read_element(place)
        if isinstance(place, t.PointerTarget):
            raise refusal(place)
        return self.object(place)

    def _read_element(self, place: t.ElementRef) -> str:
        owner, index = self.object(place.base), self.index(place)
        fact = ("load", index, owner, None)
        if index.isidentifier() and isinstance(place.base, t.VariableRef) and place.base.variable.is_constant:
            if fact not in self.facts:
                self.facts[fact] = self.temporary(f"{owner}[{index}]", place.position)
            return self.facts[fact]
        return self.temporary(f"{owner}[{index}]", place.position)

    def union_field(self, place: t.Expression) -> tuple[str, int, str] | None:
        """The union, number of the field and index in it, if a place is part of a union."""
        field = place.base if isinstance(place, t.ElementRef) else place
        if not is_union_field(field) or not isinstance(field, t.FieldRef):
            return None
        names = [entry.name.upper() for entry in cast(StructType, field.base.type).fields]
        owner = self.object(field.base)
        return owner, names.index(field.name), self.index(place) if isinstance(place, t.ElementRef) else "0"

    def store(self, place: t.Expression, code: str) -> None:
        """Assign an elementary place."""
        where = place.position
        if isinstance(place.type, PointerType) or isinstance(place, t.PointerTarget):
            raise refusal(place)
        union = self.union_field(place)
        if union is not None:
            self.line(f"{union[0]}.set({union[1]}, {union[2]}, {code})", where)
        elif isinstance(place, t.VariableRef) and place.variable.section is t.Section.IN_OUT:
            self.line(f"{self.slot(place.variable)}.set({code})", where)
        else:
            slot = self.object(place)
            self.line(f"{slot} = {code}", where)
            self.forget(slot)

    def reference(self, place: t.Expression) -> str:
        """Code for what a VAR_IN_OUT parameter gets."""
        if not is_elementary(place.type):
            return self.object(place)
        if isinstance(place, t.VariableRef) and place.variable.section is t.Section.IN_OUT:
            return self.slot(place.variable)
        union = self.union_field(place)
        if union is not None:
            return f"UnionReference({union[0]}, {union[1]}, {union[2]})"
        if isinstance(place, t.ElementRef):
            k = self.index(place)
            return f"ElementReference({self.object(place.base)}, {k})"
        owner, _, name = self.object(place).rpartition(".")
        return f"SlotReference({owner}, {name!r})"


def _is_atom(code: str) -> bool:
    return code.isidentifier() or _is_literal(code)


def _is_literal(code: str) -> bool:
    return code[0] in "0123456789'\"" or code in ("True", "False", "None") or code.startswith("(-")
