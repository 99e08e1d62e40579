"""Executes the typed text for all inputs at once: on intervals of each input, and on boxes of several.

Comparisons are decided for whole intervals and boxes, which are cut where they have to be; integers, truth values and
elements of tables are then numbers of their box. Sums of several trees are kept as expressions. Whatever is not known
here, and whatever would stop a controller (an index out of range, a comparison with NaN, an overflow), raises
NotProvedError: silence is never taken for a proof.

Behind sums of trees nothing can be decided: which score is the largest, or whether an exponential is too large, are
choices between terms. Such a statement is executed by `Symbolic` (`follow`), its variables converted, its results given
back as terms. Integers that differ from box to box (the number of a leaf) are taken one by one: each of their
combinations is a case.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray
from st_codegen.proof.prove.axis import AxisValue, InputAxis, input_value
from st_codegen.proof.prove.boxes import Lanes, Slots
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import bits
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import rounds
from st_codegen.proof.prove.operations import Recogniser, ValueOperations
from st_codegen.proof.prove.symbolic import Held, Path, Symbolic, anything
from st_codegen.proof.prove.terms import Term
from st_codegen.proof.prove.terms import Value as Number
from st_codegen.proof.prove.values import LOST, NOTHING, All, Bits, ComputedError, Conditional, Kept, Value, is_scalar
from st_codegen.st import Project, walk
from st_codegen.st import tree as t
from st_codegen.st.types import ArrayType, Elementary, StructType

_PATH: Path = ("BLOCK",)

#: More cases than this are given up.
_MOST_CASES = 20_000

_HISTORY = "{} is read before this call has assigned it: what calls leave to the next is not followed (--self-check)"


class Executor(ValueOperations):
    """One call of a function block for all inputs.

    `recognise` names a value that differs from box to box when it enters a sum (a leaf of a tree).
    """

    def __init__(
        self, project: Project, block: str, axes: Sequence[InputAxis], inputs: InputTerms, recognise: Recogniser
    ) -> None:
        super().__init__(axes, inputs, recognise)
        self.project = project
        unit = project.pous[block.upper()]
        declared = unit.section(t.Section.INPUT)
        if len(axes) != len(declared) + len(inputs.computed):
            raise NotProvedError("the block has another number of inputs than the model has features")
        self.unit = unit
        self.variables: dict[t.Variable, Value] = {}
        self.untouched: set[tuple[t.Variable, int]] = set()
        for variable in unit.variables:
            self._declare(variable)
        for axis, variable in zip(self.axes, declared, strict=False):
            self.variables[variable] = input_value(axis)
        self.standing = {
            term: input_value(axis, counted_as_zero=True)
            for term, axis in zip(inputs.computed, self.axes[len(declared) :], strict=True)
        }

    def run(self) -> dict[str, Value]:
        """Execute the body; the outputs by name."""
        if not self.standing:
            self._block(self.unit.body, True)
        for statement in self.unit.body if self.standing else ():
            before = {name: list(v) if isinstance(v, list) else v for name, v in self.variables.items()}
            try:
                self._block((statement,), True)
            except NotProvedError:  # boxes do not decide a step in front of trees: terms may
                self.variables = before
                follow(self, statement)
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
                left = self._logic("OR", left, gone)
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
            taken = self._inside(rest, condition)
            if self._any(taken):
                left = self._logic("OR", left, self._block(branch.body, taken))
            if isinstance(condition, All):
                return left
            rest = self._inside(rest, self._not(condition))
            if not self._any(rest):
                return left
        return self._logic("OR", left, self._block(statement.otherwise, rest))

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
        self.touch(statement.variable, 0)
        for counter in rounds(bounds, statement.variable.type):
            self.variables[statement.variable] = counter
            gone = self._block(statement.body, mask)
            if gone is not False:
                mask = self._logic("AND", mask, self._not(gone))
                if not self._any(mask):
                    break
        self.variables[statement.variable] = LOST

    def _store(self, target: t.Expression, value: Value, mask: Value) -> None:
        value = self.stand_in(value)
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

    def stand_in(self, value: Value) -> Value:
        """A number that is computed in front of trees as any number of its axis; other values as they are."""
        return self.standing.get(value, value) if isinstance(value, Term) else value

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
            raise NotProvedError(_HISTORY.format(variable.name))

    def _initial(self, variable: t.Variable, place: int) -> Value:
        """The initial value of something that no call assigns; that this one does not is held to the end."""
        self.untouched.add((variable, place))
        initial = variable.initial
        value = initial[place].item() if isinstance(initial, np.ndarray) else initial
        if not is_scalar(value) or variable.section is t.Section.TEMP:  # some controllers leave these as they find them
            raise NotProvedError(_HISTORY.format(variable.name))
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
        reached = positions[self._active(mask, space)]
        if np.any((reached < 0) | (reached >= len(items))):
            raise NotProvedError("an index out of range")
        items = list(items)
        for place in np.flatnonzero(np.bincount(reached)).tolist():
            if items[place] is NOTHING:
                items[place] = self._initial(variable, place)
        return Slots(space, Lanes(space, positions), items)

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


# --- statements on terms ----------------------------------------------------------------------------------------------


def follow(executor: Executor, statement: t.Statement) -> None:
    """Execute a statement on terms and store what it assigns."""
    named = (part.variable for part in walk.all_expressions((statement,)) if isinstance(part, t.VariableRef))
    held = {variable: executor.variables[variable] for variable in named if not variable.is_constant}
    cases = {variable: value for variable, value in held.items() if _is_case(value)}
    if cases:  # a number of the same boxes is one of the case
        cases |= {variable: value for variable, value in held.items() if _differs_by_box(value)}
    others = {variable: value for variable, value in held.items() if variable not in cases}
    before = {variable: converted(executor, value, variable) for variable, value in others.items()}
    if not cases:
        _give_back(executor, before, _executed(executor, statement, before))
        return
    space, arrays = executor.joined(list(cases.values()), True)
    keys = np.column_stack([bits(array) for array in arrays])
    rows, first, back = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    if len(rows) > _MOST_CASES:
        raise NotProvedError(f"more than {_MOST_CASES:,} cases")
    starts = [{**before, **{v: a[lane].item() for v, a in zip(cases, arrays, strict=True)}} for lane in first.tolist()]
    # what a case does not assign is what it was: a leaf without terms keeps its constant
    found = [(start, _executed(executor, statement, start)) for start in starts]
    for variable in dict.fromkeys(variable for _, changes in found for variable in changes):
        both = [{**start, **changes} for start, changes in found]
        if not all(variable in values and not isinstance(values[variable], tuple) for values in both):
            raise NotProvedError(f"{variable.name} is assigned in some boxes only")
        executor.touch(variable, 0)
        items = [values[variable] for values in both]
        if None in items:  # the counter of a loop
            executor.variables[variable] = LOST
            continue
        executor.variables[variable] = Slots(space, Lanes(space, np.ravel(back)), items)


def _executed(executor: Executor, statement: t.Statement, before: dict[t.Variable, Held]) -> dict[t.Variable, Held]:
    """The variables that a statement changes, with their values."""
    run = Symbolic(executor.project, executor.terms)
    run.held = {(_PATH, variable): value for variable, value in before.items()}
    run.block(_PATH, (statement,))
    return {
        variable: value
        for (path, variable), value in run.held.items()
        if path == _PATH and value is not before.get(variable)
    }


def _give_back(executor: Executor, before: dict[t.Variable, Held], changes: dict[t.Variable, Held]) -> None:
    for variable, value in changes.items():
        if not isinstance(value, tuple):
            executor.touch(variable, 0)
            executor.variables[variable] = LOST if value is None else executor.stand_in(value)
            continue
        items, old = executor.variables[variable], before[variable]
        assert isinstance(items, list) and isinstance(old, tuple)
        for place, (new, known) in enumerate(zip(value, old, strict=True)):
            if new is not known:
                executor.touch(variable, place)
                items[place] = executor.stand_in(new)


def _is_case(value: object) -> bool:
    """Whether a value is an integer, or a decision, that differs from box to box."""
    if isinstance(value, Lanes):
        return value.value.dtype.kind in "bi"
    return isinstance(value, AxisValue) and value.chain is None and value.constant.dtype.kind == "i"


def _differs_by_box(value: object) -> bool:
    """Whether a value is a number for each box."""
    return isinstance(value, Lanes) or (
        isinstance(value, AxisValue) and value.lift().chain is None and value.constant.dtype.kind != "b"
    )


def converted(executor: Executor, value: object, variable: t.Variable) -> Held:
    """A value of the executor as a term, or a function that gives it when it is read; None for what may not be read."""
    if isinstance(value, list):
        return tuple(converted(executor, item, variable) for item in value)
    if isinstance(value, Kept):
        kind = {"BOOL": "bool", "LREAL": "real", "REAL": "real"}.get(str(variable.type), "int")
        low, high, _ = anything(_PATH, variable, 0)
        # outputs are numbers before the call: initially, and as each call leaves them
        return executor.terms.leaf(("before", value.name), kind, (low, high, False))
    if isinstance(value, Conditional):
        return executor.terms.choice(
            executor.inputs.truth(value.condition),
            _number(executor, value.value, variable),
            _number(executor, value.otherwise, variable),
        )
    if isinstance(value, All) or (isinstance(value, AxisValue) and value.constant.dtype.kind == "b"):
        return executor.inputs.truth(value)
    if isinstance(value, AxisValue | Lanes | Slots):
        return lambda: executor.as_term(value)
    return value if isinstance(value, bool | int | float | Term) else None


def _number(executor: Executor, value: object, variable: t.Variable) -> Number:
    """A number of boxes of which only its interval is known; any other value as it is."""
    numbers = None
    if isinstance(value, Lanes):
        numbers = value.lift().value
    elif isinstance(value, AxisValue) and value.lift().chain is None:
        numbers = value.constant
    if numbers is not None:
        ends = (float(np.min(numbers)), float(np.max(numbers)), bool(np.any(np.isnan(numbers))))
        return executor.terms.leaf(("number", id(value)), "real" if numbers.dtype.kind == "f" else "int", ends)
    found = converted(executor, value, variable)
    if callable(found):
        found = found()
    if not isinstance(found, bool | int | float | Term):
        raise NotProvedError(f"{variable.name} has no value that is known")
    return found
