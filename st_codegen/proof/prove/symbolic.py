"""Executes one call of a block on terms: expressions of its inputs and of what earlier calls left.

Both branches of an IF are executed, each knowing its condition, and their values are joined by a choice. Loops run with
the numbers of their bounds. So what comes out is the text's very expression of each variable, and the interval that
holds it; whatever may stop a controller on the way, and whatever is not known here, raises NotProvedError.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import INFINITY, MAGNITUDE
from st_codegen.proof.prove.intervals import WHOLE, Interval, rounds
from st_codegen.proof.prove.terms import Term, Terms, Value
from st_codegen.proof.prove.values import Bits
from st_codegen.st import Project
from st_codegen.st import tree as t
from st_codegen.st.types import ArrayType, BlockType, Elementary, StructType, Type
from st_codegen.st.walk import bodies

_REAL = {"ADD": "add", "SUB": "sub", "MUL": "mul", "DIV": "div"}
_INTEGER = {"ADD": "iadd", "SUB": "isub", "MUL": "imul", "MOD": "imod"}
_FUNCTIONS = {"ABS", "EXP", "LN", "SQRT", "SIN", "COS", "ATAN"}


#: Where an instance lies: the names that lead to it.
Path = tuple[str, ...]
#: What a variable holds: a value, an array, bits, or what a union was assigned.
Held = Any
Key = tuple[Path, t.Variable]
#: Gives the outputs of a block that is not executed, for the instance at a path.
Summary = Callable[["Symbolic", Path], None]

#: More cases of one statement than this, and more conditions of one case, are given up.
_MOST_CASES, _MOST_SPLITS = 10_000, 64


class OpenCaseError(Exception):
    """A statement needs an integer that is one number where a condition holds and another one where it does not."""

    def __init__(self, condition: Value) -> None:
        super().__init__("an integer that differs by a condition")
        self.condition = condition


class Symbolic:
    """The variables of an instance and of all in it, before, during and after a call."""

    def __init__(self, project: Project, terms: Terms, summaries: Mapping[str, Summary] | None = None) -> None:
        self.project, self.terms = project, terms
        self.summaries = summaries or {}
        self.held: dict[Key, Held] = {}
        self.calls = self.cases = self.splits = 0

    # --- instances --------------------------------------------------------------------------------------------------

    def declare(self, path: Path, block: str, before: Callable[[Path, t.Variable, int], Interval] | None) -> None:
        """The variables of an instance before a call: unknown in intervals that `before` gives, or initial (None)."""
        for variable in self.project.block_variables(block):
            kind = variable.type
            if isinstance(kind, BlockType):
                self.declare((*path, variable.key), kind.name, before)
            elif variable.is_constant or before is None:
                self.held[path, variable] = self._initial(variable)
            elif isinstance(kind, ArrayType):
                places = range(kind.size)
                self.held[path, variable] = tuple(
                    self._unknown(path, variable, n, kind.element, before) for n in places
                )
            else:
                self.held[path, variable] = self._unknown(path, variable, 0, kind, before)

    def _unknown(
        self,
        path: Path,
        variable: t.Variable,
        place: int,
        kind: Type,
        before: Callable[[Path, t.Variable, int], Interval],
    ) -> Held:
        if isinstance(kind, StructType):
            return self._initial(variable)
        name, interval = _kind(kind), before(path, variable, place)
        if interval[0] == interval[1] and not interval[2]:
            return {"bool": bool, "int": int, "real": float}[name](interval[0])
        return self.terms.leaf((*path, variable.key, place), name, interval)

    def _initial(self, variable: t.Variable) -> Held:
        initial = variable.initial
        if isinstance(initial, np.ndarray):
            return initial if variable.is_constant else tuple(initial.tolist())
        return initial

    # --- statements -------------------------------------------------------------------------------------------------

    def run(self, path: Path, block: str) -> None:
        """Execute the body of a block on the instance at a path."""
        self.block(path, self.project.pous[block.upper()].body)

    def block(self, path: Path, statements: Sequence[t.Statement]) -> None:
        """Execute statements; one that needs an integer which differs by a condition, once for each case of that."""
        for statement in statements:
            before = dict(self.held)
            try:
                self._statement(path, statement)
            except OpenCaseError as case:
                self.held = before
                self._by_case(path, statement, case.condition)
            except NotProvedError as error:
                raise error.at(statement.position) from None

    def _by_case(self, path: Path, statement: t.Statement, condition: Value) -> None:
        """Execute a statement where a condition holds and where it does not; it is split again where it needs that."""
        self.cases = self.cases + 1 if self.splits else 1
        if self.cases > _MOST_CASES or self.splits > _MOST_SPLITS:
            raise NotProvedError("an integer that differs in too many cases").at(statement.position)
        self.splits += 1
        sides = [lambda: self.block(path, (statement,))] * 2
        self._branch(condition, *sides)
        self.splits -= 1

    def _statement(self, path: Path, statement: t.Statement) -> None:
        if isinstance(statement, t.Assign):
            self._store(path, statement.target, self._value(path, statement.value))
        elif isinstance(statement, t.If):
            self._if(path, statement.branches, statement.otherwise, lambda body: self.block(path, body))
        elif isinstance(statement, t.For):
            self._for(path, statement)
        elif isinstance(statement, t.CallStatement):
            self._call(path, statement.call)
        elif isinstance(statement, t.Case):
            selector = self._number(path, statement.selector)
            self._cases(path, selector, statement.branches, statement.otherwise)
        else:
            raise NotProvedError(f"{type(statement).__name__} is not followed")

    def _cases(
        self, path: Path, selector: Value, branches: Sequence[t.CaseBranch], otherwise: Sequence[t.Statement]
    ) -> None:
        if not branches:
            self.block(path, otherwise)
            return
        condition: Value = False
        for low, high in branches[0].labels:
            inside = self.terms.both(self.terms.compare("GE", selector, low), self.terms.compare("LE", selector, high))
            condition = self.terms.either(condition, inside)
        self._branch(
            condition,
            lambda: self.block(path, branches[0].body),
            lambda: self._cases(path, selector, branches[1:], otherwise),
        )

    def _if(
        self,
        path: Path,
        branches: Sequence[t.Branch],
        otherwise: Sequence[t.Statement],
        run: Callable[[Sequence[t.Statement]], None],
    ) -> None:
        if not branches:
            run(otherwise)
            return
        condition = self._number(path, branches[0].condition)
        self._branch(condition, lambda: run(branches[0].body), lambda: self._if(path, branches[1:], otherwise, run))

    def _branch(self, condition: Value, then: Callable[[], None], otherwise: Callable[[], None]) -> None:
        known = self.terms.truth(condition)
        if known is not None:
            (then if known else otherwise)()
            return
        assert isinstance(condition, Term)
        before = self.held
        ends: list[dict[Key, tuple[Held, Any]] | None] = []
        for truth, body in ((True, then), (False, otherwise)):
            with self.terms.assuming(condition, truth) as reached:
                self.held = dict(before)
                if not reached:
                    ends.append(None)
                    continue
                body()
                changed = [key for key, value in self.held.items() if value is not before.get(key)]
                ends.append({key: (self.held[key], self._intervals(self.held[key])) for key in changed})
        self.held = dict(before)
        if ends[0] is None or ends[1] is None:
            for end in ends:
                if end is not None:
                    self.held |= {key: value for key, (value, _) in end.items()}
            return
        for key in {**ends[0], **ends[1]}:
            sides = []
            for truth, end in ((True, ends[0]), (False, ends[1])):
                if key in end:
                    sides.append(end[key])
                else:
                    with self.terms.assuming(condition, truth):
                        sides.append((before.get(key), self._intervals(before.get(key))))
            self.held[key] = self._joined(condition, *sides)

    def _intervals(self, value: Held) -> Any:
        if isinstance(value, tuple):
            return tuple(self._intervals(entry) for entry in value)
        return self.terms.interval(value) if isinstance(value, Term | bool | int | float) else None

    def _joined(self, condition: Term, one: tuple[Held, Any], other: tuple[Held, Any]) -> Held:
        if one[0] is other[0]:
            return one[0]
        if isinstance(one[0], tuple) and isinstance(other[0], tuple):
            pairs = zip(one[0], one[1], other[0], other[1], strict=True)
            return tuple(self._joined(condition, (a, b), (c, d)) for a, b, c, d in pairs)
        if one[1] is None or other[1] is None:
            return None  # nobody may read it
        return self.terms.merged(condition, one, other)

    def _for(self, path: Path, statement: t.For) -> None:
        bounds = [self._number(path, part) for part in (statement.start, statement.stop, statement.step)]
        if not all(isinstance(bound, int) for bound in bounds):
            raise NotProvedError("a loop whose bounds depend on the inputs")
        counters = rounds(bounds, statement.variable.type)
        self._rounds(path, statement, counters, leaves=_leaves(statement.body))
        self.held[path, statement.variable] = None  # what a counter has behind its loop differs between compilers

    def _rounds(self, path: Path, statement: t.For, counters: range, *, leaves: bool) -> None:
        if leaves and counters:
            self.held[path, statement.variable] = counters[0]
            self._until_exit(path, statement.body, lambda: self._rounds(path, statement, counters[1:], leaves=True))
            return
        for counter in counters:
            self.held[path, statement.variable] = counter
            self.block(path, statement.body)

    def _until_exit(self, path: Path, statements: Sequence[t.Statement], after: Callable[[], None]) -> None:
        """Execute statements, and what comes `after` them where none of them is EXIT."""
        if not statements:
            after()
            return
        statement, rest = statements[0], statements[1:]
        if isinstance(statement, t.Exit):
            return
        if isinstance(statement, t.If) and _leaves((statement,)):

            def run(body: Sequence[t.Statement]) -> None:
                self._until_exit(path, body, lambda: self._until_exit(path, rest, after))

            self._if(path, statement.branches, statement.otherwise, run)
            return
        self.block(path, (statement,))
        self._until_exit(path, rest, after)

    # --- places -----------------------------------------------------------------------------------------------------

    def _owner(self, path: Path, base: t.Expression) -> Path:
        if isinstance(base, t.VariableRef):
            return (*path, base.variable.key)
        if isinstance(base, t.ThisRef):
            return path
        if isinstance(base, t.InstanceVariable):
            return (*self._owner(path, base.base), base.variable.key)
        raise NotProvedError(f"an instance by way of {type(base).__name__}")

    def _key(self, path: Path, place: t.Expression) -> Key:
        if isinstance(place, t.VariableRef):
            variable = place.variable
            if variable.storage is t.Storage.GLOBAL:
                return ("",), variable
            return (path, variable) if (path, variable) in self.held else (self._instance(path), variable)
        if isinstance(place, t.InstanceVariable):
            return self._owner(path, place.base), place.variable
        raise NotProvedError(f"{type(place).__name__} is not followed")

    @staticmethod
    def _instance(path: Path) -> Path:
        """The instance that a method with locals at `path` runs on."""
        return path[:-1] if path and path[-1].startswith("(") else path

    def _store(self, path: Path, target: t.Expression, value: Held) -> None:
        if isinstance(target, t.ElementRef):
            key = self._key(path, target.base)
            items, place = self.held.get(key), self._place(path, target)
            if not isinstance(items, tuple) or not 0 <= place < len(items):
                raise NotProvedError("an index out of range")
            self.held[key] = (*items[:place], value, *items[place + 1 :])
        elif isinstance(target, t.FieldRef):
            self.held[self._key(path, target.base)] = {target.name: value}
        else:
            key = self._key(path, target)
            if key[0] == ("",):
                raise NotProvedError("a global variable is assigned")
            self.held[key] = value

    def _place(self, path: Path, element: t.ElementRef) -> int:
        kind = element.base.type
        index = self._settled(self._number(path, element.indices[0]), needed=True)
        if not isinstance(kind, ArrayType) or len(element.indices) != 1 or not isinstance(index, int):
            raise NotProvedError("an element whose place depends on the inputs")
        return index - kind.bounds[0][0]

    def _load(self, path: Path, place: t.Expression) -> Held:
        if isinstance(place, t.ElementRef):
            items, at = self._load(path, place.base), self._place(path, place)
            if not isinstance(items, tuple | np.ndarray) or not 0 <= at < len(items):
                raise NotProvedError("an index out of range")
            return _read(items[at]) if isinstance(items, tuple) else items[at].item()
        if isinstance(place, t.FieldRef):
            stored = self._load(path, place.base)
            if not isinstance(stored, dict):
                raise NotProvedError("a structure is read before it is assigned")
            if place.name in stored:
                return stored[place.name]
            is_union = isinstance(place.base.type, StructType) and place.base.type.is_union
            if is_union and len(stored) == 1 and str(place.type) in ("LWORD", "ULINT"):
                return Bits(next(iter(stored.values())))
            raise NotProvedError("a union is read in another way than as the bits of an LREAL")
        key = self._key(path, place)
        if key not in self.held and key[1].is_constant:
            return self._initial(key[1])
        value = _read(self.held.get(key))
        if value is None:
            raise NotProvedError(f"{key[1].name} is read before it has a value that is known")
        return value

    # --- expressions ------------------------------------------------------------------------------------------------

    def _number(self, path: Path, expression: t.Expression) -> Value:
        value = self._value(path, expression)
        if not isinstance(value, bool | int | float | Term):
            raise NotProvedError("no expression is known of what is read there")
        return value

    def _value(self, path: Path, expression: t.Expression) -> Held:  # noqa: PLR0911 - one return a kind
        if isinstance(expression, t.Constant):
            return expression.value
        if t.is_place(expression):
            return self._load(path, expression)
        if isinstance(expression, t.Unary):
            value = self._number(path, expression.operand)
            if expression.operator == "NOT":
                return self.terms.negated(value)
            if _is_real(expression.type):
                return self.terms.real("neg", value)
            return self._whole("SUB", 0, value, expression.type)
        if isinstance(expression, t.Binary):
            return self._binary(path, expression)
        if isinstance(expression, t.Compare):
            return self._comparison(path, expression)
        if isinstance(expression, t.Conversion):
            return self._converted(path, expression)
        if isinstance(expression, t.StandardCall):
            return self._standard(path, expression)
        if isinstance(expression, t.Call):
            return self._call(path, expression)
        raise NotProvedError(f"{type(expression).__name__} is not followed")

    def _binary(self, path: Path, expression: t.Binary) -> Held:
        left, right = expression.left, expression.right
        if isinstance(left, t.Compare) and left.is_number_test:
            return self.terms.is_number(self._number(path, left.left))
        one, other = self._value(path, left), self._value(path, right)
        if isinstance(one, Bits) and other == MAGNITUDE and expression.operator == "AND":
            return Bits(one.value, magnitude=True)
        if not isinstance(one, bool | int | float | Term) or not isinstance(other, bool | int | float | Term):
            raise NotProvedError("arithmetic on what is no number")
        if _is_real(expression.type):
            return self.terms.real(_REAL[expression.operator], one, other)
        if isinstance(expression.type, Elementary) and expression.type.name == "BOOL":
            if expression.operator not in ("AND", "OR"):
                raise NotProvedError(f"{expression.operator} of truth values")
            return self.terms.both(one, other) if expression.operator == "AND" else self.terms.either(one, other)
        return self._whole(expression.operator, one, other, expression.type)

    def _settled(self, value: Value, *, needed: bool = False) -> Value:
        """An integer as what is known here makes it; OpenCaseError where it is `needed` and differs by a condition."""
        if not isinstance(value, Term) or value.kind != "int":
            return value
        if value.operation == "if":
            truth = self.terms.truth(value.arguments[0])
            if truth is not None:
                return self._settled(value.arguments[1 if truth else 2], needed=needed)
            if needed and _between_numbers(value.arguments[0]):
                raise NotProvedError("an element whose place is a choice between computed numbers")
            if needed:
                raise OpenCaseError(value.arguments[0])
        elif needed:
            for argument in value.arguments:
                self._settled(argument, needed=True)
        return value

    def _whole(self, operator: str, one: Value, other: Value, kind: Type) -> Value:
        one, other = (self._settled(side, needed=operator == "DIV") for side in (one, other))
        if operator == "DIV" and isinstance(one, int) and isinstance(other, int) and one >= 0 and other > 0:
            return one // other
        if operator not in _INTEGER or not isinstance(kind, Elementary):
            raise NotProvedError(f"{operator} of integers")
        return self.terms.integer(_INTEGER[operator], one, other, low=kind.lower, high=kind.upper)

    def _comparison(self, path: Path, expression: t.Compare) -> Held:
        one, other = self._value(path, expression.left), self._value(path, expression.right)
        if isinstance(one, Bits) and one.magnitude and expression.operator == "GT" and other == INFINITY:
            return self.terms.negated(self.terms.is_number(one.value))
        for value in (one, other):
            if not isinstance(value, bool | int | float | Term):
                raise NotProvedError("a comparison of what is no number")
        one, other = self._settled(one), self._settled(other)
        for side in (one, other) if _is_choice(one) and _is_choice(other) else ():
            self._settled(side, needed=True)
        return self.terms.compare(expression.operator, one, other)

    def _converted(self, path: Path, expression: t.Conversion) -> Held:
        value, source, target = self._value(path, expression.operand), expression.operand.type, expression.type
        if not isinstance(source, Elementary) or not isinstance(target, Elementary):
            return value
        if isinstance(value, Bits):
            raise NotProvedError("a conversion of bits")
        number = self._number(path, expression.operand)
        if source.is_real and target.is_real:
            return number if target.bits >= source.bits else self.terms.real("single", number)
        if source.is_real:
            raise NotProvedError(f"a conversion from {source} to {target}")
        if target.is_real:
            if not isinstance(number, Term):
                return float(number)
            return self.terms.integer("ireal", number, low=-(2**53), high=2**53)
        low, high, _ = self.terms.interval(number)
        if low < target.lower or high > target.upper:
            raise NotProvedError(f"a conversion from {source} to {target} that loses bits")
        return number

    def _standard(self, path: Path, expression: t.StandardCall) -> Held:
        arguments = [self._number(path, argument) for argument in expression.arguments]
        name = expression.function
        if name == "TRUNC" and isinstance(expression.type, Elementary):
            return self.terms.integer("itrunc", arguments[0], low=expression.type.lower, high=expression.type.upper)
        if not _is_real(expression.type):
            raise NotProvedError(f"{name} of integers is not followed")
        if name in ("MIN", "MAX"):
            result = arguments[0]
            for argument in arguments[1:]:
                result = self.terms.real(name.lower(), result, argument)
            return result
        if name not in _FUNCTIONS:
            raise NotProvedError(f"{name} is not followed")
        return self.terms.real(name.lower(), *arguments)

    def _call(self, path: Path, call: t.Call) -> Held:
        unit = self.project.pous[call.callee]
        given = {argument.parameter: argument for argument in call.arguments}
        if unit.is_native or any(argument.passing is not t.Passing.INPUT for argument in call.arguments):
            raise NotProvedError(f"the call of {unit.name} is not followed")
        values = {parameter: self._value(path, argument.value) for parameter, argument in given.items()}
        if call.receiver is not None and unit.kind is t.PouKind.FUNCTION_BLOCK:
            where = self._owner(path, call.receiver)
            for parameter, value in values.items():
                self.held[where, parameter] = value
            if unit.key in self.summaries:
                self.summaries[unit.key](self, where)
            else:
                self.block(where, unit.body)
            return None
        own = path if call.receiver is None else self._owner(path, call.receiver)
        self.calls += 1
        where = (*self._instance(own), f"({self.calls})")
        own_variables = [variable for variable in (*unit.variables, unit.result) if variable is not None]
        for variable in own_variables:
            self.held[where, variable] = values.get(variable, self._initial(variable))
        self.block(where, unit.body)
        result = None if unit.result is None else self.held[where, unit.result]
        for variable in own_variables:
            del self.held[where, variable]
        return result


def _leaves(statements: Sequence[t.Statement]) -> bool:
    """Whether some of these statements may leave the loop around them."""
    return any(
        isinstance(statement, t.Exit) or (isinstance(statement, t.If) and any(map(_leaves, bodies(statement))))
        for statement in statements
    )


def _between_numbers(condition: object) -> bool:
    """Whether a condition compares two computed numbers: the cases of several such conditions are too many."""
    if not isinstance(condition, Term) or condition.kind != "bool":
        return False
    operands = [isinstance(argument, Term) and argument.kind == "real" for argument in condition.arguments]
    return operands == [True, True] or any(map(_between_numbers, condition.arguments))


def _is_choice(value: Value) -> bool:
    """Whether an integer differs by a condition."""
    return isinstance(value, Term) and value.kind == "int" and value.operation == "if"


def _read(value: Held) -> Held:
    """What a variable holds, which may be a function that gives it once it is read."""
    return value() if callable(value) else value


def _kind(kind: Type) -> str:
    """What terms of a type are; enumerations are integers."""
    if isinstance(kind, Elementary):
        return "bool" if kind.name == "BOOL" else "real" if kind.is_real else "int"
    return "int"


def anything(_: Path, variable: t.Variable, place: int) -> Interval:  # noqa: ARG001 - one of several such functions
    """The interval of a variable of which nothing is known."""
    kind = variable.type.element if isinstance(variable.type, ArrayType) else variable.type
    ends = {"bool": (0.0, 1.0, False), "int": (-(2.0**63), 2.0**63, False)}
    if isinstance(kind, Elementary) and kind.is_integral:
        return float(kind.lower), float(kind.upper), False
    return ends.get(_kind(kind), WHOLE)


def _is_real(kind: Type) -> bool:
    return isinstance(kind, Elementary) and kind.is_real
