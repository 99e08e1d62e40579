"""Executes the typed text for all inputs at once: on intervals of each input, and on boxes of several.

Comparisons are decided for whole intervals and boxes, which are cut where they have to be; integers, truth values and
elements of tables are then numbers of their box. Sums of several trees are kept as expressions. Whatever is not known
here, and whatever would stop a controller (an index out of range, a comparison with NaN, an overflow), raises
NotProvedError: silence is never taken for a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray
from st_codegen.proof.prove.axis import (
    HIGHEST,
    LOWEST,
    AxisValue,
    InputAxis,
    NotProvedError,
    bisected,
    input_value,
    run_chain,
)
from st_codegen.proof.prove.boxes import Lanes, Slots, Space
from st_codegen.proof.prove.by_case import follow
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import compute
from st_codegen.proof.prove.terms import Term
from st_codegen.proof.prove.terms import Value as Number
from st_codegen.proof.prove.values import (
    LOST,
    NOTHING,
    All,
    Bits,
    ComputedError,
    Conditional,
    Kept,
    Value,
    is_scalar,
    parts_of,
)
from st_codegen.st import Project
from st_codegen.st import tree as t
from st_codegen.st.types import ArrayType, Elementary, StructType, Type

_COMPARE: dict[str, Callable[..., BoolArray]] = {
    "LT": np.less,
    "LE": np.less_equal,
    "GT": np.greater,
    "GE": np.greater_equal,
    "EQ": np.equal,
    "NE": np.not_equal,
}
_FLIPPED = {"LT": "GT", "LE": "GE", "GT": "LT", "GE": "LE", "EQ": "EQ", "NE": "NE"}
_FLOAT = {"ADD": "add", "SUB": "sub", "MUL": "mul", "DIV": "div", "MIN": "min", "MAX": "max"}
_MAGNITUDE = 0x7FFF_FFFF_FFFF_FFFF
_INFINITY = 0x7FF0_0000_0000_0000


#: Names a value that differs from box to box when it enters a sum: a leaf of a tree.
Recogniser = Callable[[Lanes | Slots], Term]


class Executor:
    """One call of a function block for all inputs.

    `recognise` names a value that differs from box to box when it enters a sum (a leaf of a tree).
    """

    def __init__(
        self, project: Project, block: str, axes: Sequence[InputAxis], inputs: InputTerms, recognise: Recogniser
    ) -> None:
        self.project, self.inputs, self.terms, self.recognise = project, inputs, inputs.terms, recognise
        self._terms: dict[int, tuple[Value, Number]] = {}
        #: The boxes of the statement that is executed: both sides of an IF are to assign on the same ones.
        self._open: Space | None = None
        unit = project.pous[block.upper()]
        declared = unit.section(t.Section.INPUT)
        if len(axes) != len(declared):
            raise NotProvedError("the block has another number of inputs than the model has features")
        self.axes = axes
        self.unit = unit
        self.variables: dict[t.Variable, Value] = {}
        self.untouched: set[tuple[t.Variable, int]] = set()
        for variable in unit.variables:
            self._declare(variable)
        for axis, variable in zip(self.axes, declared, strict=True):
            self.variables[variable] = input_value(axis)

    def run(self) -> dict[str, Value]:
        """Execute the body; the outputs by name."""
        self._block(self.unit.body, True)
        outputs = self.unit.section(t.Section.OUTPUT)
        return {variable.name: self.variables[variable] for variable in outputs}

    def _declare(self, variable: t.Variable, *, fresh: bool = False) -> None:
        kind = variable.type
        if variable.is_constant:
            self.variables[variable] = variable.initial
        elif isinstance(kind, ArrayType):
            self.variables[variable] = [NOTHING] * kind.size
        elif variable.section is t.Section.OUTPUT:
            self.variables[variable] = Kept(variable.name)
        elif fresh and isinstance(kind, Elementary):
            self.variables[variable] = variable.initial
        else:
            self.variables[variable] = NOTHING

    # --- statements -------------------------------------------------------------------------------------------------

    def _block(self, statements: Sequence[t.Statement], mask: Value) -> Value:
        """Execute statements where `mask` holds; returns where an EXIT was met (False: nowhere)."""
        left: Value = False
        for statement in statements:
            gone = self._statement(statement, mask)
            if gone is not False:
                left = gone if left is False else self._logic("OR", left, gone)
                mask = self._logic("AND", mask, self._not(gone))
                if not self._any(mask):
                    break
        return left

    def _statement(self, statement: t.Statement, mask: Value) -> Value:
        if mask is True:
            self._open = None
        try:
            return self._followed(statement, mask)
        except ComputedError:
            if mask is not True:
                raise
        # it raised before it changed anything: what it needs first is what it decides or computes with
        follow(self, statement)
        return False

    def _followed(self, statement: t.Statement, mask: Value) -> Value:
        if isinstance(statement, t.Assign):
            value = self._value(statement.value, mask)
            if mask is True and isinstance(statement.target, t.VariableRef) and isinstance(value, Lanes):
                value = _own_walk(statement.value, value)
            self._store(statement.target, value, mask)
        elif isinstance(statement, t.If):
            return self._if(statement, mask)
        elif isinstance(statement, t.For):
            self._for(statement, mask)
        elif isinstance(statement, t.Exit):
            return mask
        else:
            raise NotProvedError(f"{statement.position}: {type(statement).__name__} is not followed")
        return False

    def _if(self, statement: t.If, mask: Value) -> Value:
        left: Value = False
        rest = mask
        for branch in statement.branches:
            condition = self._value(branch.condition, rest)
            if isinstance(condition, All) and (len(statement.branches) > 1 or statement.otherwise):
                raise self._undecided(branch, statement)
            if isinstance(condition, Term):
                raise self._undecided(branch, statement)
            self._require_known(condition, rest)
            taken = self._logic("AND", rest, condition)
            if self._any(taken):
                gone = self._block(branch.body, taken)
                left = gone if left is False else left if gone is False else self._logic("OR", left, gone)
            if isinstance(condition, All):
                return left
            rest = self._logic("AND", rest, self._not(condition))
            if not self._any(rest):
                return left
        gone = self._block(statement.otherwise, rest)
        return gone if left is False else left if gone is False else self._logic("OR", left, gone)

    def _require_known(self, condition: Value, mask: Value) -> None:
        """Raise NotProvedError for a condition that has no value everywhere in a mask."""
        if isinstance(condition, AxisValue) and condition.lift().known is not None:
            active = self._active_on_axis(mask, condition.axis)
        elif isinstance(condition, Lanes) and condition.lift().known is not None:
            active = self._active(mask, condition.space)
        else:
            return
        if np.any(active & ~np.asarray(condition.lift().known)):
            raise NotProvedError("a decision is read before it is assigned")

    @staticmethod
    def _undecided(branch: t.Branch, statement: t.If) -> NotProvedError:
        """A condition that boxes do not decide: terms may, as long as no branch before it was executed."""
        kind = ComputedError if branch is statement.branches[0] else NotProvedError
        return kind("a condition on computed numbers or several inputs", statement.position)

    def _for(self, statement: t.For, mask: Value) -> None:
        bounds = [self._value(part, mask) for part in (statement.start, statement.stop, statement.step)]
        if not all(isinstance(bound, int) for bound in bounds):
            raise ComputedError("a loop whose bounds depend on the inputs", statement.position)
        if not isinstance(statement.counter, t.VariableRef):
            raise NotProvedError(f"{statement.position}: a counter that is no variable")
        start, stop, step = (int(bound) for bound in bounds)  # type: ignore[call-overload]
        counter = start
        while counter <= stop if step > 0 else counter >= stop:
            self.variables[statement.counter.variable] = counter
            gone = self._block(statement.body, mask)
            if gone is not False:
                mask = self._logic("AND", mask, self._not(gone))
                if not self._any(mask):
                    break
            counter += step
        self.variables[statement.counter.variable] = LOST

    def _store(self, target: t.Expression, value: Value, mask: Value) -> None:
        if isinstance(target, t.VariableRef):
            old = self.variables.get(target.variable)
            if old is None:
                raise NotProvedError("a global variable is assigned")
            self.touch(target.variable, 0)
            if isinstance(old, list):
                raise NotProvedError(f"{target.position}: an array is assigned as a whole")
            self.variables[target.variable] = self._merged(value, old, mask)
        elif isinstance(target, t.ElementRef) and isinstance(target.base, t.VariableRef):
            items = self.variables.get(target.base.variable)
            place = self._position(target, mask)
            if not isinstance(items, list) or not isinstance(place, int):
                raise NotProvedError(f"{target.position}: an element whose place depends on the inputs is assigned")
            if not 0 <= place < len(items):
                raise NotProvedError(f"{target.position}: an index out of range")
            self.touch(target.base.variable, place)
            items[place] = self._merged(value, items[place], mask)
        elif isinstance(target, t.FieldRef) and isinstance(target.base, t.VariableRef) and mask is True:
            self.variables[target.base.variable] = (target.name, value)
        else:
            raise NotProvedError(f"{target.position}: an assignment that is not followed")

    def _merged(self, new: Value, old: Value, mask: Value) -> Value:
        """`new` where the mask holds, else `old`."""
        if mask is True:
            return new
        if new is False and isinstance(mask, AxisValue) and isinstance(old, bool | AxisValue | All):
            return self._logic("AND", old, self._not(mask))
        if isinstance(mask, All) or isinstance(new, Term | Kept) or isinstance(old, Kept | Term):
            return Conditional(mask, new, old)
        stale = isinstance(old, type(NOTHING) | type(LOST) | Slots | Bits) or (
            isinstance(old, Lanes) and not any(isinstance(v, Lanes) and v.space is old.space for v in (new, mask))
        )
        if isinstance(new, AxisValue) and new.chain is not None:
            stale = stale or (not (isinstance(old, AxisValue) and old.axis is new.axis) and not is_scalar(old))
        if isinstance(mask, AxisValue) and isinstance(old, AxisValue) and old.axis is not mask.axis:
            # what another input gave before is forgotten: in loops over columns each branch assigns
            stale = stale or is_scalar(new) or (isinstance(new, AxisValue) and new.axis is mask.axis)
        return self._where(mask, new, None if stale else old)

    def _where(self, mask: Value, new: Value, old: Value) -> Value:
        axis_values = [value for value in (mask, new, old) if isinstance(value, AxisValue)]
        only_axis = axis_values and not any(isinstance(value, Lanes | Slots) for value in (mask, new, old))
        if only_axis and len({id(value.axis) for value in axis_values}) == 1:
            return self._where_on_axis(axis_values[0].axis, mask, new, old)
        parts = [mask, new] if old is None else [mask, new, old]
        space, arrays = self.joined(parts, True, needed=False)
        active = np.asarray(arrays[0], np.bool_)
        known = self._known_of(parts[1], space)
        if old is None:
            return Lanes(space, arrays[1], active & known)
        kept = self._known_of(old, space)
        return Lanes(space, np.where(active, arrays[1], arrays[2]), np.where(active, known, kept))

    @staticmethod
    def _known_of(value: Value, space: Space) -> BoolArray:
        if isinstance(value, Lanes) and value.space is space and value.lift().known is not None:
            return np.asarray(value.known)
        return np.ones(space.lanes, np.bool_)

    def _where_on_axis(self, axis: InputAxis, mask: Value, new: Value, old: Value) -> AxisValue:
        active = np.asarray(self._on_axis(mask, axis).constant, np.bool_)
        first = self._on_axis(new, axis)
        if old is None:
            there = active if first.known is None else active & first.known
            return AxisValue(axis, first.constant, first.chain, first.chains, there)
        second = self._on_axis(old, axis)
        known: BoolArray | None = None
        if first.known is not None or second.known is not None:
            sides = [np.ones(axis.lanes, np.bool_) if v.known is None else v.known for v in (first, second)]
            known = np.where(active, sides[0], sides[1])
        constant = np.where(active, first.constant, second.constant)
        if first.chain is None and second.chain is None:
            return AxisValue(axis, constant, known=known)
        none = np.zeros(axis.lanes, np.int64)
        one = none if first.chain is None else first.chain
        other = none if second.chain is None else second.chain
        shifted = np.where(other > 0, other + len(first.chains), 0)
        chain = np.where(active, one, shifted)
        return AxisValue(axis, constant, chain, (*first.chains, *second.chains), known)

    # --- expressions ------------------------------------------------------------------------------------------------

    def _value(self, expression: t.Expression, mask: Value) -> Value:  # noqa: PLR0911, PLR0912 - one return a kind
        try:
            if isinstance(expression, t.Constant):
                return expression.value
            if isinstance(expression, t.VariableRef):
                value = self.variables.get(expression.variable, LOST)
                if value is LOST:
                    raise NotProvedError(f"{expression.variable.name} is no variable of the block that holds a value")
                return self._initial(expression.variable, 0) if value is NOTHING else value
            if isinstance(expression, t.ElementRef):
                return self._element(expression, mask)
            if isinstance(expression, t.FieldRef):
                return self._field(expression)
            if isinstance(expression, t.Unary):
                return self._unary(expression, mask)
            if isinstance(expression, t.Binary):
                if isinstance(expression.left, t.Compare) and expression.left.is_number_test:
                    return self._is_number(self._value(expression.left.left, mask))
                left, right = self._value(expression.left, mask), self._value(expression.right, mask)
                return self._binary(expression.operator, left, right, mask, expression.type)
            if isinstance(expression, t.Compare):
                left, right = self._value(expression.left, mask), self._value(expression.right, mask)
                return self._compare(expression.operator, left, right, mask)
            if isinstance(expression, t.Conversion):
                return self._converted(
                    self._value(expression.operand, mask), expression.operand.type, expression.type, mask
                )
            if isinstance(expression, t.StandardCall):
                arguments = [self._value(argument, mask) for argument in expression.arguments]
                return self._standard(expression.function, arguments, mask, expression.type)
            if isinstance(expression, t.Call):
                return self._call(expression, mask)
        except NotProvedError as error:
            raise error.at(expression.position) from None
        raise NotProvedError(f"{expression.position}: {type(expression).__name__} is not followed")

    def touch(self, variable: t.Variable, place: int) -> None:
        if (variable, place) in self.untouched:
            raise NotProvedError(f"{variable.name} is read before this call has assigned it")

    def _initial(self, variable: t.Variable, place: int) -> Value:
        """The initial value of something that no call assigns; that this one does not is held to the end."""
        self.untouched.add((variable, place))
        initial = variable.initial
        value = initial[place].item() if isinstance(initial, np.ndarray) else initial
        if not is_scalar(value):
            raise NotProvedError(f"{variable.name} is read before this call has assigned it")
        return value

    def _position(self, element: t.ElementRef, mask: Value) -> Value:
        kind = element.base.type
        if not isinstance(kind, ArrayType) or len(element.indices) != 1:
            raise NotProvedError("an element of something that is no plain array")
        index = self._value(element.indices[0], mask)
        low = kind.bounds[0][0]
        return self._binary("SUB", index, low, mask, None) if low else index

    def _element(self, expression: t.ElementRef, mask: Value) -> Value:
        if not isinstance(expression.base, t.VariableRef):
            raise NotProvedError("an element of something that is no variable")
        items = self.variables.get(expression.base.variable)
        index = self._position(expression, mask)
        if isinstance(index, Slots):
            index = self._settled(index, mask)
        if isinstance(index, int):
            if not isinstance(items, list | np.ndarray) or not 0 <= index < len(items):
                raise NotProvedError("an index out of range")
            if isinstance(items, np.ndarray):
                return items[index].item()
            value = items[index]
            return self._initial(expression.base.variable, index) if value is NOTHING else value
        if isinstance(items, list):
            if all(is_scalar(item) for item in items):
                items = np.array(items)
            else:
                return self._slots(expression.base.variable, items, index, mask)
        if not isinstance(items, np.ndarray):
            raise NotProvedError("an index into something that is no table")
        table = items

        def looked_up(position: AnyArray, active: BoolArray) -> AnyArray:
            if np.any(((position < 0) | (position >= len(table))) & active):
                raise NotProvedError("an index out of range")
            return np.asarray(table[np.clip(position, 0, len(table) - 1)])

        return self._elementwise(looked_up, [index], mask)

    def _slots(self, variable: t.Variable, items: list[object], index: Value, mask: Value) -> Value:
        space, (positions,) = self.joined([index], mask)
        reached = np.unique(positions[self._active(mask, space)])
        if np.any((reached < 0) | (reached >= len(items))):
            raise NotProvedError("an index out of range")
        items = list(items)
        for place in reached.tolist():
            if items[place] is NOTHING:
                items[place] = self._initial(variable, place)
        return Slots(space, Lanes(space, positions), items)

    def _settled(self, slots: Slots, mask: Value) -> Value:
        """Slots as a number for each lane."""
        space = slots.space
        result: Lanes | None = None
        for number in np.unique(slots.index.lift().value).tolist():
            item = slots.items[number] if 0 <= number < len(slots.items) else NOTHING
            active = self._active(mask, space) & (slots.index.lift().value == number)
            if not np.any(active):
                continue
            if isinstance(item, AxisValue):
                value, known = space.resolve(item, active)
                if not np.all(known[self._active(mask, space) & (slots.index.lift().value == number)]):
                    raise NotProvedError("an element is read before it is assigned")
            elif is_scalar(item):
                value = np.full(space.lanes, item)
            else:
                raise NotProvedError("an element that depends on several inputs")
            here = slots.index.lift().value == number
            old = np.zeros(space.lanes, value.dtype) if result is None else result.lift().value
            result = Lanes(space, np.where(here, value, old))
        if result is None:
            raise NotProvedError("nothing is read")
        return result

    def _field(self, expression: t.FieldRef) -> Value:
        base = expression.base
        if not isinstance(base, t.VariableRef) or not isinstance(base.type, StructType) or not base.type.is_union:
            raise NotProvedError("a field of a structure")
        stored = self.variables[base.variable]
        if not isinstance(stored, tuple):
            raise NotProvedError("a union is read before it is assigned")
        name, value = stored
        if name == expression.name:
            return value
        kinds = {entry.name.upper(): entry.type for entry in base.type.fields}
        source, wanted = kinds[name], kinds[expression.name]
        if str(source) == "LREAL" and str(wanted) in ("LWORD", "ULINT"):
            return Bits(value)
        raise NotProvedError("a union is read in another way than as the bits of an LREAL")

    def _unary(self, expression: t.Unary, mask: Value) -> Value:
        value = self._value(expression.operand, mask)
        if expression.operator == "NOT":
            return self._not(value)
        if isinstance(expression.type, Elementary) and expression.type.is_real:
            return self._float("neg", [value], mask)
        return self._binary("SUB", 0, value, mask, expression.type)

    def _binary(self, operator: str, left: Value, right: Value, mask: Value, kind: Type | None) -> Value:
        if isinstance(kind, Elementary) and kind.is_real:
            return self._float(_FLOAT[operator], [left, right], mask)
        if isinstance(left, Bits) or isinstance(right, Bits):
            bits, other = (left, right) if isinstance(left, Bits) else (right, left)
            if operator == "AND" and other == _MAGNITUDE and isinstance(bits, Bits):
                return Bits(bits.value, magnitude=True)
            raise NotProvedError("arithmetic on the bits of a number")
        if isinstance(kind, Elementary) and kind.name == "BOOL":
            if operator in ("AND", "OR"):
                for side in (left, right):
                    self._require_known(side, mask)
                return self._logic(operator, left, right)
            raise NotProvedError(f"{operator} of truth values")
        lower, upper = (
            (kind.lower, kind.upper) if isinstance(kind, Elementary) and kind.is_integral else (-(2**31), 2**31 - 1)
        )
        upper = min(upper, 2**62)

        def integers(a: AnyArray, b: AnyArray, active: BoolArray) -> AnyArray:
            a, b = a.astype(np.int64), b.astype(np.int64)
            if operator in ("DIV", "MOD"):
                if np.any((b == 0) & active):
                    raise NotProvedError("a division by zero")
                b = np.where(b == 0, 1, b)
                quotient = np.abs(a) // np.abs(b) * np.sign(a) * np.sign(b)
                result = quotient if operator == "DIV" else a - quotient * b
            else:
                compute = {
                    "ADD": np.add,
                    "SUB": np.subtract,
                    "MUL": np.multiply,
                    "AND": np.bitwise_and,
                    "OR": np.bitwise_or,
                    "XOR": np.bitwise_xor,
                }
                if operator not in compute:
                    raise NotProvedError(f"{operator} is not followed")
                if operator == "MUL" and np.any((np.abs(a).astype(np.float64) * np.abs(b) > 2.0**61) & active):
                    raise NotProvedError("an integer overflows")
                result = compute[operator](a, b)
            if np.any(((result < lower) | (result > upper)) & active):
                raise NotProvedError("an integer overflows")
            return np.asarray(result)

        return self._elementwise(integers, [left, right], mask)

    def _float(self, name: str, values: list[Value], mask: Value) -> Value:
        """A floating point operation: on constants and on chains of one input as it is, else as an expression."""
        if all(is_scalar(value) for value in values):
            return compute(name, *(float(value) for value in values))  # type: ignore[arg-type]
        axis_values = [value for value in values if isinstance(value, AxisValue)]
        # what is constant in each lane is the leaf of a tree or an element of a table: a term of a sum
        terms = name in ("add", "min", "max") and any(value.chain is None for value in axis_values)
        if (
            not terms
            and len(axis_values) + sum(map(is_scalar, values)) == len(values)
            and len({id(value.axis) for value in axis_values}) == 1
        ):
            found = self._float_on_axis(name, values, axis_values[0].axis, mask)
            if found is not None:
                return found
        return self.terms.real(name, *(self.as_term(value) for value in values))

    def _float_on_axis(self, name: str, values: list[Value], axis: InputAxis, mask: Value) -> AxisValue | None:
        if name == "abs" and isinstance(values[0], AxisValue):
            whole = np.arange(axis.lanes)
            while values[0].cut_where(lambda x, _: x < 0, whole):
                whole = np.arange(axis.lanes)
        on_axis = [self._on_axis(value, axis) for value in values]
        moving = [value for value in on_axis if value.chain is not None and np.any(value.chain > 0)]
        active = self._active_on_axis(mask, axis)
        numbers = [value.constant.astype(np.float64) for value in on_axis]
        with np.errstate(all="ignore"):
            if len(numbers) == 1:
                result = run_chain(((name, 0.0),), numbers[0])
            else:
                operation = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide}
                operation |= {"min": np.minimum, "max": np.maximum}
                result = operation[name](numbers[0], numbers[1])
        still = active.copy()
        for value in moving:
            still &= np.asarray(value.chain) == 0
        for value in on_axis:
            if value.known is not None and np.any(active & ~value.known):
                raise NotProvedError("a number is read before it is assigned")
        finite = np.all([np.isfinite(number) for number in numbers], axis=0)
        if np.any(still & finite & ~np.isfinite(result)) or np.any(still & np.isnan(result)):
            raise NotProvedError(f"the operation {name} can overflow or meet NaN")
        if not moving:
            return AxisValue(axis, np.asarray(result))
        if len(moving) > 1:
            return None
        if len(on_axis) == 1:
            return moving[0].with_links(name, np.zeros(axis.lanes), np.asarray(result), active)
        constants = numbers[1] if moving[0] is on_axis[0] else numbers[0]
        if name == "div" and moving[0] is on_axis[1]:
            return None
        link = name if moving[0] is on_axis[0] else f"r{name}"
        return moving[0].with_links(link, constants, np.asarray(result), active)

    def as_term(self, value: Value) -> Number:
        """A value as a term. What differs from box to box must be a tree's."""
        if isinstance(value, Term):
            return value
        if isinstance(value, bool | int | float):
            return float(value)
        if id(value) not in self._terms:
            self._terms[id(value)] = value, self._as_term(value)
        return self._terms[id(value)][1]

    def as_number(self, value: Value) -> Number:
        """A value as a term; integers and truth values stay what they are."""
        return value if isinstance(value, bool | int | float) else self.as_term(value)

    def _as_term(self, value: Value) -> Number:
        if isinstance(value, Slots) and any(isinstance(item, AxisValue) for item in value.items):
            value = self._settled(value, True)
        if isinstance(value, Lanes | Slots):
            return self.recognise(value)
        if isinstance(value, AxisValue) and value.lift().chain is None:
            space = Space(self.axes)
            found, known = space.resolve(value, np.ones(1, np.bool_))
            return self.recognise(Lanes(space, found, known))
        if isinstance(value, AxisValue):
            return self.inputs.number(value)
        raise NotProvedError(f"arithmetic on {type(value).__name__}")

    def _compare(self, operator: str, left: Value, right: Value, mask: Value) -> Value:
        if isinstance(left, Bits):
            if left.magnitude and operator == "GT" and right == _INFINITY:
                return self._not(self._is_number(left.value))
            raise NotProvedError("a comparison of the bits of a number")
        if isinstance(right, Slots) and not isinstance(left, Slots):
            left, right, operator = right, left, _FLIPPED[operator]
        if isinstance(right, Slots):
            right = self._settled(right, mask)
        if isinstance(left, Slots):
            if operator in ("EQ", "NE"):
                left = self._settled(left, mask)
            else:
                return self._compare_slots(operator, left, right, mask)
        if isinstance(left, Term) or isinstance(right, Term):
            raise ComputedError("a comparison of a computed number")
        values = [left, right]
        axis_values = [value for value in values if isinstance(value, AxisValue)]
        if (
            axis_values
            and len(axis_values) + sum(map(is_scalar, values)) == 2
            and len({id(value.axis) for value in axis_values}) == 1
        ):
            return self._compare_on_axis(operator, left, right, axis_values[0].axis, mask)

        def compared(a: AnyArray, b: AnyArray, active: BoolArray) -> AnyArray:
            if np.any((np.isnan(a) | np.isnan(b)) & active):
                raise NotProvedError("a comparison with NaN")
            return _COMPARE[operator](a, b)

        return self._elementwise(compared, values, mask)

    def _compare_on_axis(self, operator: str, left: Value, right: Value, axis: InputAxis, mask: Value) -> AxisValue:
        one, other = self._on_axis(left, axis), self._on_axis(right, axis)
        if one.chain is None and other.chain is not None:
            one, other, operator = other, one, _FLIPPED[operator]
        if other.chain is not None:
            active = self._active_on_axis(mask, axis)
            if np.any((other.chain > 0) & active):
                raise NotProvedError("a comparison of two numbers that vary with one input")
        compare = _COMPARE[operator]
        steps = [compare] if operator not in ("EQ", "NE") else [np.less, np.less_equal]
        for step in steps:
            while one.cut_where(
                lambda x, lanes, step=step: step(x, other.lift().constant[lanes]),  # type: ignore[misc]
                np.flatnonzero(self._active_on_axis(mask, axis)),
            ):
                pass
        first, _ = one.ends()
        number = other.lift().constant
        active = self._active_on_axis(mask, axis)
        for value in (one, other):
            if value.known is not None and np.any(active & ~value.known):
                raise NotProvedError("a number is read before it is assigned")
        if np.any((np.isnan(first) | np.isnan(number)) & active):
            raise NotProvedError("a comparison with NaN")
        return AxisValue(axis, np.asarray(compare(first, number), np.bool_))

    def _is_number(self, value: Value) -> Value:
        if isinstance(value, float):
            return not np.isnan(value)
        if isinstance(value, AxisValue):
            value.lift()
            number = ~np.isnan(value.constant.astype(np.float64))
            if value.chain is not None:
                number |= value.chain > 0
            return AxisValue(value.axis, number, known=value.known)
        raise NotProvedError("a test for NaN of a computed number")

    def _compare_slots(self, operator: str, slots: Slots, right: Value, mask: Value) -> Value:
        space = slots.space
        while True:
            space_found, (thresholds,) = self.joined([right], mask, space=space)
            assert space_found is space
            active = self._active(mask, space)
            index = slots.index.lift().value
            if len(thresholds) == space.lanes == len(active):
                break
        feature = np.zeros(space.lanes, np.int64)
        last = np.full(space.lanes, LOWEST - 1, np.int64)
        nan = np.zeros(space.lanes, np.bool_)
        below = np.zeros(space.lanes, np.bool_)
        for number in np.unique(index[active]).tolist():
            lanes = np.flatnonzero(active & (index == number))
            item = slots.items[number]
            if is_scalar(item):
                feature[lanes] = 0
                decided = _COMPARE[operator](item, thresholds[lanes])
                below[lanes], nan[lanes], last[lanes] = decided, decided, HIGHEST
                continue
            if not isinstance(item, AxisValue):
                raise NotProvedError("a comparison of an element that depends on several inputs")
            found = _changeovers(operator, item, thresholds[lanes])
            if found is None:
                return self._compare_settled(operator, slots, right, mask)
            feature[lanes] = item.axis.feature
            last[lanes], below[lanes], nan[lanes] = found
            if np.any(np.isnan(np.float64(item.lift().constant[-1]))) and np.any(
                space.nan[lanes, item.axis.feature] & active[lanes]
            ):
                raise NotProvedError("a comparison with NaN")
        return Lanes(space, space.decide(feature, last, below, nan, active))

    def _compare_settled(self, operator: str, slots: Slots, right: Value, mask: Value) -> Value:
        """Slots whose values neither rise nor fall along their input: every comparison for itself."""
        space = slots.space
        _, (thresholds,) = self.joined([right], mask, space=space)
        keys = np.unique(
            np.column_stack([slots.index.lift().value, thresholds])[self._active(mask, space)], axis=0
        ).tolist()
        limit = Lanes(space, thresholds)
        result = Lanes(space, np.zeros(space.lanes, np.bool_))
        for number, threshold in keys:
            item = slots.items[int(number)]
            if not isinstance(item, AxisValue):
                raise NotProvedError("a comparison of an element that depends on several inputs")
            decision = self._compare_on_axis(operator, item, threshold, item.axis, True)

            def here(number: float = number, threshold: float = threshold) -> BoolArray:
                chosen = (slots.index.lift().value == number) & (limit.lift().value == threshold)
                return np.asarray(chosen & self._active(mask, space), np.bool_)

            value, _ = space.resolve(decision, here())
            result = Lanes(space, np.where(here(), value, result.lift().value).astype(np.bool_))
        return result

    def _converted(self, value: Value, source: Type, target: Type, mask: Value) -> Value:
        if not isinstance(source, Elementary) or not isinstance(target, Elementary):
            raise NotProvedError(f"a conversion from {source} to {target}")
        if source.is_real and target.is_real:
            return value if target.bits >= source.bits else self._float("single", [value], mask)
        if source.is_real:
            raise NotProvedError(f"a conversion from {source} to {target}")
        if target.is_real:
            if target.bits < 64 or source.bits > 32:
                raise NotProvedError(f"a conversion from {source} to {target}")
            return self._elementwise(lambda a, _: a.astype(np.float64), [value], mask)

        def integers(a: AnyArray, active: BoolArray) -> AnyArray:
            a = a.astype(np.int64)
            same_size = source.bits == target.bits and source.name != "BOOL"
            if np.any(((a < target.lower) | (a > target.upper)) & active):
                if not same_size or target.bits > 32:
                    raise NotProvedError(f"a conversion from {source} to {target} that loses bits")
                a = a & ((1 << target.bits) - 1)
                a = np.where(a > target.upper, a - (1 << target.bits), a)
            return a

        return self._elementwise(integers, [value], mask)

    def _standard(self, name: str, arguments: list[Value], mask: Value, kind: Type) -> Value:
        if isinstance(kind, Elementary) and kind.is_real:
            if name == "ABS":
                return self._float("abs", arguments, mask)
            if name in ("MIN", "MAX"):
                result = arguments[0]
                for argument in arguments[1:]:
                    result = self._float(_FLOAT[name], [result, argument], mask)
                return result
            return self.terms.real(name.lower(), *(self.as_term(argument) for argument in arguments))
        if name == "TRUNC" and isinstance(kind, Elementary):
            # in all boxes: the condition may be one on inputs that are refused
            return self._elementwise(truncated(kind), arguments, True)
        raise NotProvedError(f"{name} is not followed")

    def _call(self, call: t.Call, mask: Value) -> Value:
        unit = self.project.pous[call.callee]
        if call.receiver is not None or unit.result is None or unit.is_native:
            raise NotProvedError(f"the call of {unit.name} is not followed")
        if any(argument.passing is not t.Passing.INPUT for argument in call.arguments):
            raise NotProvedError(f"the call of {unit.name} changes its arguments")
        saved = dict(self.variables)
        for variable in unit.variables:
            self._declare(variable, fresh=True)
        self._declare(unit.result, fresh=True)
        for argument in call.arguments:
            self.variables[argument.parameter] = self._value(argument.value, mask)
        self._block(unit.body, True)
        result = self.variables[unit.result]
        self.variables = saved
        return result

    # --- truth values and masks -------------------------------------------------------------------------------------

    def _not(self, value: Value) -> Value:
        if isinstance(value, bool):
            return not value
        if isinstance(value, AxisValue):
            value.lift()
            return AxisValue(value.axis, ~value.constant.astype(np.bool_), known=value.known)
        if isinstance(value, Slots):
            value = self._settled(value, True)
        if isinstance(value, Lanes):
            value.lift()
            return Lanes(value.space, ~value.value.astype(np.bool_), value.known)
        raise ComputedError("NOT of a condition on several inputs")

    def _logic(self, operator: str, left: Value, right: Value) -> Value:
        for one, other in ((left, right), (right, left)):
            if isinstance(one, bool):
                return other if one is (operator == "AND") else one
        if operator == "AND" and all(isinstance(value, AxisValue | All) for value in (left, right)):
            parts: dict[int, AxisValue] = {}
            for value in (left, right):
                for axis, part in parts_of(value).items():
                    known = parts.get(axis)
                    parts[axis] = part if known is None else self._where_on_axis(part.axis, part, known, False)
            return next(iter(parts.values())) if len(parts) == 1 else All(parts)
        if isinstance(left, All) or isinstance(right, All):
            raise ComputedError("a condition on several inputs")

        def combined(a: AnyArray, b: AnyArray, _: BoolArray) -> AnyArray:
            return a.astype(np.bool_) & b.astype(np.bool_) if operator == "AND" else a.astype(np.bool_) | b

        return self._elementwise(combined, [left, right], True, needed=False)

    def _any(self, mask: Value) -> bool:
        if isinstance(mask, bool):
            return mask
        if isinstance(mask, AxisValue):
            return bool(np.any(mask.lift().constant))
        if isinstance(mask, Lanes):
            return bool(np.any(mask.lift().value))
        if isinstance(mask, All):
            return all(self._any(part) for part in mask.parts.values())
        raise NotProvedError("a condition that is not followed")

    # --- bringing values together -----------------------------------------------------------------------------------

    def _on_axis(self, value: Value, axis: InputAxis) -> AxisValue:
        if isinstance(value, AxisValue):
            return value.lift()
        return AxisValue(axis, np.full(axis.lanes, value))

    def _active_on_axis(self, mask: Value, axis: InputAxis) -> BoolArray:
        """The lanes of an axis in which a mask may hold."""
        if isinstance(mask, AxisValue) and mask.axis is axis:
            return np.asarray(mask.lift().constant, np.bool_)
        return np.ones(axis.lanes, np.bool_)

    def _active(self, mask: Value, space: Space) -> BoolArray:
        """The lanes of a space in which a mask holds; the space may be split for it."""
        if mask is True:
            return np.ones(space.lanes, np.bool_)
        if isinstance(mask, Lanes):
            if mask.space is not space:
                raise NotProvedError("conditions on two different trees")
            return np.asarray(mask.lift().value, np.bool_)
        if isinstance(mask, AxisValue):
            value, _ = space.resolve(mask, np.ones(space.lanes, np.bool_))
            return value.astype(np.bool_)
        raise NotProvedError("a condition that is not followed")

    def joined(
        self, values: Sequence[Value], mask: Value, *, needed: bool = True, space: Space | None = None
    ) -> tuple[Space, list[AnyArray]]:
        """Values on the lanes of one space; `needed`: they must have been assigned wherever the mask holds."""
        values = [self._settled(value, mask) if isinstance(value, Slots) else value for value in values]
        for value in (*values, mask):
            if isinstance(value, Lanes):
                if space is not None and value.space is not space:
                    raise NotProvedError("arithmetic on values of two different trees")
                space = value.space
        self._open = space = space or self._open or Space(self.axes)
        self._active(mask, space)
        parts: list[Lanes] = []
        for value in values:
            if isinstance(value, AxisValue):
                found, known = space.resolve(value, self._active(mask, space))
                parts.append(Lanes(space, found, known))
            elif isinstance(value, Lanes):
                parts.append(value)
            elif is_scalar(value):
                parts.append(Lanes(space, np.full(space.lanes, value)))
            else:
                raise NotProvedError(f"arithmetic on {type(value).__name__}")
        active = self._active(mask, space)
        for part in parts:
            part.lift()
            if needed and part.known is not None and np.any(active & ~part.known):
                raise NotProvedError("a number is read before it is assigned")
        return space, [part.value for part in parts]

    def _elementwise(
        self, compute: Callable[..., AnyArray], values: Sequence[Value], mask: Value, *, needed: bool = True
    ) -> Value:
        """An operation on numbers, lane by lane; `compute` also takes the lanes in which it has to succeed."""
        values = [self._settled(value, mask) if isinstance(value, Slots) else value for value in values]
        if any(
            isinstance(value, Term | All | Bits | Kept | Conditional | type(NOTHING) | type(LOST)) for value in values
        ):
            raise ComputedError("an operation on a computed number that is not followed")
        if all(is_scalar(value) for value in values):
            result = compute(*(np.array([value]) for value in values), np.ones(1, np.bool_))
            return result[0].item()
        axes = {id(value.axis): value.axis for value in values if isinstance(value, AxisValue)}
        if len(axes) == 1 and not any(isinstance(value, Lanes) for value in values):
            axis = next(iter(axes.values()))
            on_axis = [self._on_axis(value, axis) for value in values]
            active = self._active_on_axis(mask, axis)
            for value in on_axis:
                if value.chain is not None and np.any((value.chain > 0) & active):
                    raise NotProvedError("a number that varies with an input where a constant is needed")
                if needed and value.known is not None and np.any(active & ~value.known):
                    raise NotProvedError("a number is read before it is assigned")
            return AxisValue(axis, np.asarray(compute(*(value.constant for value in on_axis), active)))
        space, arrays = self.joined(values, mask, needed=needed)
        return Lanes(space, np.asarray(compute(*arrays, self._active(mask, space))))


def _own_walk(expression: t.Expression, value: Lanes) -> Lanes:
    """Where a walk begins is computed from a cell, whose boxes other walks begin with, too: each splits a copy.

    Once a table is read at such a place, the walk is under way.
    """
    if value.value.dtype.kind not in "iu" or value.space.is_walked:
        return value
    if isinstance(expression, t.ElementRef):
        value.space.is_walked = True
        return value
    value.lift()
    return Lanes(value.space.copy(), value.value, value.known)


def truncated(kind: Elementary) -> Callable[..., AnyArray]:
    """TRUNC to an integer type, on numbers of lanes. Raises NotProvedError where one does not fit."""

    def whole(a: AnyArray, active: BoolArray) -> AnyArray:
        inside = np.isfinite(a) & (np.trunc(np.where(np.isfinite(a), a, 0.0)) >= kind.lower)
        inside &= np.where(np.isfinite(a), a, 0.0) < kind.upper + 1.0
        if np.any(~inside & active):
            raise NotProvedError("TRUNC of a number that the type does not hold")
        return np.where(inside, a, 0.0).astype(np.int64)

    return whole


def _changeovers(operator: str, item: AxisValue, thresholds: FloatArray) -> tuple[AnyArray, AnyArray, AnyArray] | None:
    """Where comparisons of a rising or falling value with thresholds change over.

    Returns the last key before the change, the decision up to it, and that for NaN; None for a value that neither rises
    nor falls. Cuts the axis at these places.
    """
    axis = item.axis
    item.held_alike()
    distinct, back = np.unique(thresholds, return_inverse=True)
    while True:
        order = item.in_order()
        if order is None:
            return None
        lanes, first, last, falling = order
        sign = -1 if falling else 1
        name = _FLIPPED[operator] if falling else operator
        side: Literal["left", "right"] = "left" if name in ("LT", "GE") else "right"
        count = np.searchsorted(first, sign * distinct, side=side)  # lanes that begin below the threshold
        lane = np.maximum(count - 1, 0)
        ends_beyond = last[lane] >= sign * distinct if side == "left" else last[lane] > sign * distinct
        open_ = (count > 0) & ends_beyond
        if not np.any(open_):
            break
        at, limit = lanes[lane[open_]], distinct[open_]
        assert item.chain is not None
        cuts = []
        for number in np.unique(item.chain[at]).tolist():
            chosen = item.chain[at] == number
            chain = item.chains[number - 1]
            cuts.append(
                bisected(
                    lambda x, chain=chain, limit=limit[chosen]: _COMPARE[operator](run_chain(chain, x), limit),  # type: ignore[misc]
                    axis.starts[at[chosen]],
                    axis.ends[at[chosen]],
                )
            )
        axis.cut(np.concatenate(cuts))
    end = np.where(count > 0, axis.ends[lanes[np.maximum(count - 1, 0)]], LOWEST - 1)
    nan = _COMPARE[operator](item.lift().constant[-1], distinct)
    below = np.full(len(distinct), name in ("LT", "LE"))
    back = np.ravel(back)
    return end[back], below[back], np.asarray(nan)[back]
