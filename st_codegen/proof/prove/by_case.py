"""Statements on computed numbers in a block of trees: executed on terms, once for each case that boxes leave open.

The executor decides comparisons for boxes of inputs. Behind sums of trees nothing can be decided: which score is the
largest, or whether an exponential is too large, are choices between terms. Such a statement is executed by `Symbolic`,
its variables converted, its results given back as terms. Integers that differ from box to box (the number of a leaf)
are taken one by one: each of their combinations is a case.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from st_codegen.ir.arrays import AnyArray
from st_codegen.proof.prove.axis import AxisValue, NotProvedError
from st_codegen.proof.prove.boxes import Lanes, Slots, Space
from st_codegen.proof.prove.floats import bits
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.symbolic import Held, Path, Symbolic, anything
from st_codegen.proof.prove.terms import Term, Terms, Value
from st_codegen.proof.prove.values import LOST, All, Conditional, Kept
from st_codegen.st import Project
from st_codegen.st import tree as t

_PATH: Path = ("BLOCK",)

#: More cases than this are given up.
_MOST_CASES = 20_000


class Boxes(Protocol):
    """What is asked of the executor on boxes."""

    project: Project
    terms: Terms
    inputs: InputTerms
    variables: dict[t.Variable, object]

    def joined(self, values: Sequence[object], mask: object) -> tuple[Space, list[AnyArray]]:
        """Values on the lanes of one space."""
        ...

    def touch(self, variable: t.Variable, place: int) -> None:
        """Note that a variable is assigned."""
        ...

    def stand_in(self, value: object) -> object:
        """A value, or that of the axis on which it is any number."""
        ...

    def as_term(self, value: object) -> Value:
        """A value as a term."""
        ...


def follow(executor: Boxes, statement: t.Statement) -> None:
    """Execute a statement on terms and store what it assigns."""
    variables = list(dict.fromkeys(v for v in _variables(statement) if not v.is_constant))
    held = {variable: executor.variables[variable] for variable in variables}
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
    found = [
        _executed(executor, statement, {**before, **{v: a[lane].item() for v, a in zip(cases, arrays, strict=True)}})
        for lane in first.tolist()
    ]
    for variable in {variable for changes in found for variable in changes}:
        if not all(variable in changes and not isinstance(changes[variable], tuple) for changes in found):
            raise NotProvedError(f"{variable.name} is assigned in some boxes only")
        executor.touch(variable, 0)
        items = [changes[variable] for changes in found]
        if None in items:  # the counter of a loop
            executor.variables[variable] = LOST
            continue
        executor.variables[variable] = Slots(space, Lanes(space, np.ravel(back)), items)


def _executed(executor: Boxes, statement: t.Statement, before: dict[t.Variable, Held]) -> dict[t.Variable, Held]:
    """The variables that a statement changes, with their values."""
    run = Symbolic(executor.project, executor.terms)
    run.held = {(_PATH, variable): value for variable, value in before.items()}
    run.block(_PATH, (statement,))
    return {
        variable: value
        for (path, variable), value in run.held.items()
        if path == _PATH and value is not before.get(variable)
    }


def _give_back(executor: Boxes, before: dict[t.Variable, Held], changes: dict[t.Variable, Held]) -> None:
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


def _variables(node: object) -> Iterator[t.Variable]:
    """The variables that a part of the text names."""
    if isinstance(node, t.VariableRef):
        yield node.variable
    elif isinstance(node, tuple):
        for part in node:
            yield from _variables(part)
    elif isinstance(node, t.Node):
        for entry in dataclasses.fields(node):
            yield from _variables(getattr(node, entry.name))


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


def converted(executor: Boxes, value: object, variable: t.Variable) -> Held:
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
            _truth(executor, value.condition),
            _number(executor, value.value, variable),
            _number(executor, value.otherwise, variable),
        )
    if isinstance(value, All) or (isinstance(value, AxisValue) and value.constant.dtype.kind == "b"):
        return _truth(executor, value)
    if isinstance(value, AxisValue | Lanes | Slots):
        return lambda: executor.as_term(value)
    return value if isinstance(value, bool | int | float | Term) else None


def _truth(executor: Boxes, condition: object) -> Value:
    if isinstance(condition, AxisValue):
        return executor.inputs.truth(condition)
    return condition if isinstance(condition, bool | Term) else executor.inputs.condition(condition)


def _number(executor: Boxes, value: object, variable: t.Variable) -> Value:
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
