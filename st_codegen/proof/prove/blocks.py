"""Blocks around models: what holds in every call, for all inputs and whatever was called before.

The state of an instance starts in its initial values. One call is executed on terms, with all inputs unknown and every
variable of the state in an interval; the intervals grow until a call leads out of none of them. What they are then is
an invariant: it holds before the first call, and each call keeps it. In that last execution nothing overflowed, divided
by zero, met NaN, left an array, or looped other than between constant bounds, for inputs of any 64 bits.

The models' own blocks are not executed again: they are proved, and stand for any numbers that their models can give.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.emit.blocks.model import AGE
from st_codegen.errors import at_least, at_most
from st_codegen.ir import ModelIR
from st_codegen.passes.domain import magnitudes
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.intervals import LARGEST, Interval, hull
from st_codegen.proof.prove.symbolic import Held, Path, Summary, Symbolic, anything
from st_codegen.proof.prove.terms import Term, Terms, Value, arguments_of
from st_codegen.st import Project
from st_codegen.st import tree as t
from st_codegen.st.types import ArrayType, BlockType, Elementary, Type

_PATH: Path = ("BLOCK",)

#: Rounds after which an interval that still grows is taken much wider (of counters, which others wait for, after half
#: as many as of numbers), and after which none may grow any more.
_PATIENCE, _ROUNDS = 6, 40

#: Limits from here on are those of the models' arithmetic and not worth a sentence.
_FAR = 1e30

#: What magnitudes of models are widened by: more than their roundings.
_MARGIN = 1.001


@dataclass(frozen=True)
class Limit:
    """An output that no call ever sets outside of an interval."""

    output: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Slew:
    """An output that no call changes by more than `step`, which is at most `largest`, but for the sum's rounding.

    `target`: it moves towards a number within plus and minus this; empty where no such number is seen.
    """

    output: str
    step: str
    largest: float
    target: str


@dataclass(frozen=True)
class BlockProof:
    """What was found of a block: its outputs' limits, and which of them change by a bounded step."""

    block: str
    limits: tuple[Limit, ...]
    slews: tuple[Slew, ...]
    rounds: int

    @property
    def claims(self) -> tuple[str, ...]:
        """What holds in every call, in sentences."""
        near = [limit for limit in self.limits if max(-limit.lower, limit.upper) < _FAR]
        said = ["no call stops the controller or loops without a bound"]
        said += [
            f"{limit.output} stays within {at_least(limit.lower, 7)} .. {at_most(limit.upper, 7)}" for limit in near
        ]
        said += [
            f"{slew.output} changes by at most {slew.step} in a call (and a rounding), which is at most "
            f"{at_most(slew.largest, 7)}" + (f", towards a number within +-{slew.target}" if slew.target else "")
            for slew in self.slews
        ]
        return tuple(said)


def prove_block(
    project: Project, block: str, models: Mapping[str, Sequence[tuple[ModelIR, tuple[int, ...]]]]
) -> BlockProof:
    """The invariant of a block. `models` are the blocks of proved models, and the outputs of each that are a model's.

    Raises NotProvedError with what may fail, or is not followed.
    """
    summaries = {name.upper(): _summary(project, name, members) for name, members in models.items()}
    state = _initial(project, block)
    for number in range(1, _ROUNDS + 1):
        run, intervals = _called(project, block, summaries, state)
        grown = {key: hull(interval, intervals[key]) for key, interval in state.items()}
        if grown == state:
            return BlockProof(block, _limits(project, block, run), _slews(project, block, run), number)
        for key, interval in grown.items():
            if number > (_PATIENCE if _is_counter(key) else 2 * _PATIENCE):
                grown[key] = _wider(state[key], interval)
        state = grown
    raise NotProvedError("no invariant was found")


#: A number of the state: where its instance lies, its variable and its place in an array.
Number = tuple[Path, t.Variable, int]


def _numbers(project: Project, block: str, path: Path = _PATH) -> list[tuple[Path, t.Variable, int, Type]]:
    """The state of an instance and of those in it: all that a call leaves behind, inputs aside."""
    found: list[tuple[Path, t.Variable, int, Type]] = []
    for variable in project.block_variables(block):
        kind = variable.type
        if isinstance(kind, BlockType):
            found += _numbers(project, kind.name, (*path, variable.key))
        elif not variable.is_constant and not (path == _PATH and variable.section is t.Section.INPUT):
            element = kind.element if isinstance(kind, ArrayType) else kind
            count = kind.size if isinstance(kind, ArrayType) else 1
            found += [(path, variable, place, element) for place in range(count)]
    return found


def _is_counter(number: Number) -> bool:
    """Whether a number of the state is an integer."""
    kind = number[1].type
    element = kind.element if isinstance(kind, ArrayType) else kind
    return isinstance(element, Elementary) and element.is_integral


def _initial(project: Project, block: str) -> dict[Number, Interval]:
    state: dict[Number, Interval] = {}
    for path, variable, place, kind in _numbers(project, block):
        if not isinstance(kind, Elementary) and not hasattr(kind, "base"):
            continue  # structures and unions must be assigned before they are read
        value = variable.initial
        if isinstance(value, np.ndarray | list):
            value = value[place]
        if isinstance(value, bool | int | float | np.generic):
            state[path, variable, place] = (float(value), float(value), bool(value != value))  # noqa: PLR0124 - NaN
    return state


def _called(
    project: Project, block: str, summaries: Mapping[str, Summary], state: dict[Number, Interval]
) -> tuple[Symbolic, dict[Number, Interval]]:
    """One call from a state; the intervals of the state behind it."""
    terms = Terms()
    run = Symbolic(project, terms, summaries)

    def before(path: Path, variable: t.Variable, place: int) -> Interval:
        return state.get((path, variable, place), anything(path, variable, place))

    run.declare(_PATH, block, before)
    run.run(_PATH, block)
    after = {}
    for path, variable, place in state:
        held: Held = run.held[path, variable]
        value = held[place] if isinstance(held, tuple | np.ndarray) else held
        if not isinstance(value, bool | int | float | Term | np.generic):  # a counter behind its loop
            after[path, variable, place] = anything(path, variable, place)
            continue
        after[path, variable, place] = terms.interval(value.item() if isinstance(value, np.generic) else value)
    return run, after


def _wider(before: Interval, after: Interval) -> Interval:
    """An interval that grows, taken to the next power of ten that holds it."""
    low, high, nan = after
    if low < before[0]:
        low = -_power(-low) if low < 0 else 0.0
    if high > before[1]:
        high = _power(high) if high > 0 else 0.0
    return low, high, nan


def _power(number: float) -> float:
    return min(10.0 ** math.ceil(math.log10(number) + 1), LARGEST) if number < 1e300 else math.inf


def _summary(project: Project, block: str, members: Sequence[tuple[ModelIR, tuple[int, ...]]]) -> Summary:
    """Any answer that the models of a block can give: numbers as large as theirs, or what the outputs held before."""
    unit = project.pous[block.upper()]
    largest: dict[str, float] = {}
    for model, outputs in members:
        sizes = output_magnitudes(model)
        largest |= {f"fOut{output + 1}": size for output, size in zip(outputs, sizes, strict=True)}

    def assign(run: Symbolic, path: Path) -> None:
        run.calls += 1
        for variable in unit.section(t.Section.OUTPUT):
            size = largest.get(variable.name)
            name = (*path, variable.key, run.calls)
            if size is not None:
                run.held[path, variable] = run.terms.leaf(name, "real", (-size, size, False))
            elif isinstance(variable.type, Elementary) and variable.type.name == "BOOL":
                run.held[path, variable] = run.terms.leaf(name, "bool", (0.0, 1.0, False))
            elif variable.name == AGE:
                run.held[path, variable] = run.terms.leaf(name, "int", anything(path, variable, 0))
            else:
                raise NotProvedError(f"the output {variable.name} of {unit.name} belongs to no proved model")

    return assign


def output_magnitudes(model: ModelIR) -> list[float]:
    """The largest magnitude of each output for all inputs that the model takes."""
    limits = []
    for feature, limit in zip(model.features, model.magnitude_limits, strict=True):
        declared = math.inf if feature.lower is None or feature.upper is None else max(-feature.lower, feature.upper)
        limits.append(min(declared, math.inf if limit is None else limit))
    values = [np.array(limits)]
    with np.errstate(all="ignore"):
        for op in model.ops:
            values.append(magnitudes(op, [values[number] for number in op.inputs])[1])
    sizes = [float(size) * _MARGIN for size in values[-1]]
    if not all(map(math.isfinite, sizes)):
        raise NotProvedError(f"the numbers of model '{model.name}' have no bound")
    return sizes


def _limits(project: Project, block: str, run: Symbolic) -> tuple[Limit, ...]:
    found = []
    for variable in project.pous[block.upper()].section(t.Section.OUTPUT):
        held = run.held[_PATH, variable]
        values = held if isinstance(held, tuple) else (held,)
        kind = variable.type.element if isinstance(variable.type, ArrayType) else variable.type
        if isinstance(kind, Elementary) and kind.is_real:
            ends = [run.terms.interval(value) for value in values]
            found.append(Limit(variable.name, min(end[0] for end in ends), max(end[1] for end in ends)))
    return tuple(found)


def _slews(project: Project, block: str, run: Symbolic) -> tuple[Slew, ...]:
    """Outputs that are their last value y, moved towards a target by a step at most: MIN(MAX(t, y - s), y + s)."""
    found = []
    names = {variable.key: variable.name for unit in project.pous.values() for variable in unit.variables}
    for variable in project.pous[block.upper()].section(t.Section.OUTPUT):
        held = run.held[_PATH, variable]
        step, target = _step_of(run, held), _target(run, held)
        if step is not None:
            toward = "" if target is None else _text(target, names)
            found.append(Slew(variable.name, _text(step, names), run.terms.interval(step)[1], toward))
    return tuple(found)


def _step_of(run: Symbolic, value: Held) -> Value | None:
    upper = arguments_of(value, "min")
    lower = arguments_of(upper[0], "max") if upper else None
    if not upper or not lower:
        return None
    added, taken = arguments_of(upper[1], "add"), arguments_of(lower[1], "sub")
    if not added or not taken or added[0] is not taken[0] or added[1] is not taken[1]:
        return None
    last, step = added
    is_state = isinstance(last, Term) and last.operation == "leaf"
    return step if is_state and run.terms.interval(step)[0] >= 0 else None


def _target(run: Symbolic, value: Held) -> Value | None:
    """L where the number that an output moves towards is MIN(MAX(x, -L), L) with L of zero or more."""
    moved = arguments_of(value, "min")
    limited = arguments_of(moved[0], "max") if moved else None
    target = limited[0] if limited else None
    upper = arguments_of(target, "min")
    lower = arguments_of(upper[0], "max") if upper else None
    mirrored = arguments_of(lower[1], "neg") if lower else None
    if not upper or not mirrored or mirrored[0] is not upper[1] or run.terms.interval(upper[1])[0] < 0:
        return None
    return upper[1]


def _text(value: object, names: Mapping[str, str]) -> str:
    """A step in the words of its inputs; `names` has those of variables by their keys, as they are written."""
    if isinstance(value, Term) and value.operation == "mul":
        return " * ".join(_text(argument, names) for argument in value.arguments)
    if isinstance(value, Term) and value.operation == "if":
        return _text(value.arguments[1], names)
    if isinstance(value, Term) and value.operation == "leaf":
        name = value.arguments[0]
        key = str(name[-2] if isinstance(name, tuple) else name)
        return names.get(key, key)
    return str(value)
