"""Models without trees: that the text computes the very expression of the model, and nothing in it can fail.

The block is executed on terms twice. With inputs that the model takes, its outputs must be the terms that the model
demands, and bValid must be where it has an answer. With all inputs, NaN and infinities included, nothing may overflow,
divide by zero or meet NaN, the outputs must change only where bValid is TRUE, and bValid must be FALSE for every input
that the model refuses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.ir import FactoredKernel, FloatArray, Kernel, KernelSum, ModelIR
from st_codegen.passes.kernels import factored
from st_codegen.proof.bounds import unfactored
from st_codegen.proof.prove.axis import from_keys
from st_codegen.proof.prove.demand import Demand
from st_codegen.proof.prove.disagree import OtherExpressionError, SearchedInputs, parts_of
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.intervals import WHOLE, Interval
from st_codegen.proof.prove.model import InputDomain, domain_of
from st_codegen.proof.prove.range_bound import range_bound
from st_codegen.proof.prove.symbolic import Held, Path, Symbolic, anything
from st_codegen.proof.prove.terms import Term, Terms, Value
from st_codegen.st import Project
from st_codegen.st import tree as t

EXPRESSION = "the model's expression"

#: Said of a block whose bValid is FALSE for all inputs.
NEVER = "the block has no answer to any input (bValid is always FALSE): there are no numbers to compare"
_PATH: Path = ("BLOCK",)


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a proof found: `method` says how, `trees` and `boxes`, or an expression's `operations`, how large it was.

    `bound`: how far an expression may lie from the library's answer anywhere in the declared range, for each output;
    empty where no range is declared. `claims`: what else holds, as in every call of a block around models.
    """

    method: str = ""
    trees: int = 0
    boxes: int = 0
    operations: int = 0
    bound: tuple[float, ...] = ()
    claims: tuple[str, ...] = ()


def prove_arithmetic(model: ModelIR, project: Project, block: str, outputs: tuple[int, ...]) -> Findings:
    """Prove a model without trees. Raises NotProvedError with what is missing."""
    candidates = [model]
    on_grid = factored(model)
    if on_grid is not None and _is_the_same(model, on_grid):
        candidates.append(on_grid)
    operations, differences = 0, []
    for candidate in candidates:
        try:
            operations = _compared(candidate, project, block, outputs)
        except OtherExpressionError as difference:
            differences.append(difference)
        else:
            break
    else:
        raise min(differences, key=lambda difference: difference.apart)
    _check_all_inputs(model, project, block, outputs)
    return Findings(method=EXPRESSION, operations=operations, bound=range_bound(model))


def _is_the_same(model: ModelIR, on_grid: ModelIR) -> bool:
    """Whether kernels on a grid stand for the same support vectors and coefficients."""
    for op, other in zip(model.ops, on_grid.ops, strict=True):
        if isinstance(op, KernelSum) and isinstance(other, FactoredKernel):
            if op.kernel is not Kernel.RBF or op.inputs != other.inputs:
                return False
            whole = unfactored(other)
            if _weighted(whole) != _weighted(op) or op.gamma != whole.gamma or op.precision is not whole.precision:
                return False
            if not np.array_equal(op.intercept, whole.intercept):
                return False
        elif op is not other:
            return False
    return True


def _weighted(op: KernelSum) -> dict[tuple[float, ...], tuple[float, ...]]:
    """The coefficients of each vector, those of equal vectors added up in their order; none that are all 0."""
    found: dict[tuple[float, ...], FloatArray] = {}
    for vector, coefficients in zip(op.support_vectors.tolist(), op.coefficients.T, strict=True):
        found[tuple(vector)] = found.get(tuple(vector), 0.0) + coefficients
    return {vector: tuple(total.tolist()) for vector, total in found.items() if np.any(total)}


def _compared(model: ModelIR, project: Project, block: str, outputs: tuple[int, ...]) -> int:
    """Compare with inputs that the model takes; the number of operations of the outputs."""
    terms, domain = Terms(), domain_of(model)
    ends = zip(from_keys(domain.low).tolist(), from_keys(domain.high).tolist(), domain.nan, strict=True)
    run, inputs = _executed(terms, project, block, list(ends))
    demand = Demand.of_inputs(terms, model, inputs)
    held = {variable.name: run.held[_PATH, variable] for variable in _outputs(project, block)}
    taken = SearchedInputs(domain.low, domain.high, lambda x: dict(zip(inputs, x.T, strict=True)))
    valid: Value = held["bValid"]
    if valid is not demand.valid:
        reason = "bValid is not the condition under which the model has an answer"
        raise OtherExpressionError(reason, [valid], [demand.valid], taken)
    names = numbers_of(project, block)
    got: list[Value] = [_assigned(held[names[number]], demand.valid) for number in outputs]
    different = [n for n, pair in enumerate(zip(got, demand.put_out(), strict=True)) if not same_number(*pair)]
    if different:
        where = ", ".join(names[outputs[n]] for n in different)
        reason = f"{where}: not the expression that the model demands, which {first_missing(demand, got)}"
        raise OtherExpressionError(reason, got, demand.put_out(), taken)
    _check_range(model, terms, inputs, held)
    return len(parts_of(demand.outputs))


def first_missing(demand: Demand, got: list[Value]) -> str:
    """The first operation of a model of which a text does not compute every column."""
    there = {id(term) for term in parts_of(got)}
    for number, op in enumerate(demand.model.ops, 1):
        columns = demand.values.get(number, [])
        if any(isinstance(column, Term) and id(column) not in there for column in columns):
            return f"differs in operation {number}, {type(op).__name__}"
    return "differs behind its last operation"


def numbers_of(project: Project, block: str) -> list[str]:
    """The outputs of a block in their order, without its flags."""
    return [variable.name for variable in _outputs(project, block) if str(variable.type) != "BOOL"]


def check_plausible(model: ModelIR, terms: Terms, held: Mapping[str, Held], valid: Value) -> None:
    """bPlausible, where there is one, is bValid and that no output lies outside of its plausible range."""
    if "bPlausible" not in held:
        return
    plausible = valid
    for port in model.ports:
        if port.lower is not None and port.upper is not None:
            value: Value = held[port.variable]
            beyond = terms.either(terms.compare("LT", value, port.lower), terms.compare("GT", value, port.upper))
            plausible = terms.choice(beyond, False, plausible)
    if held["bPlausible"] is not plausible:
        raise NotProvedError("bPlausible is not what the plausible ranges demand")


def _check_range(model: ModelIR, terms: Terms, inputs: list[Term], held: dict[str, Held]) -> None:
    """bInRange, where there is one, is FALSE exactly where a number lies outside its declared range."""
    if "bInRange" not in held:
        return
    inside: Value = True
    for feature, x in zip(model.features, inputs, strict=True):
        if feature.checked is None:
            continue
        low, high = feature.checked
        is_number = terms.is_number(x)
        # what is missing is no number outside
        y = terms.where(terms.negated(is_number), 0.0, x)
        outside = terms.either(terms.compare("LT", y, low), terms.compare("GT", y, high))
        inside = terms.choice(terms.both(is_number, outside), False, inside)
    if _conditions(held["bInRange"]) != _conditions(inside):
        raise NotProvedError("bInRange is not what the declared ranges demand")


def _conditions(value: object) -> set[object]:
    if isinstance(value, Term) and value.operation == "and":
        return set().union(*(_conditions(argument) for argument in value.arguments))
    return {id(value) if isinstance(value, Term) else value}


def _executed(terms: Terms, project: Project, block: str, intervals: list[Interval]) -> tuple[Symbolic, list[Term]]:
    unit = project.pous[block.upper()]
    inputs = unit.section(t.Section.INPUT)
    if len(inputs) != len(intervals):
        raise NotProvedError("the block has another number of inputs than the model has features")
    run, given = _run(terms, project, block, intervals, set())
    outputs = [run.held[_PATH, variable] for variable in _outputs(project, block)]
    read = {term.arguments[0] for term in parts_of(outputs) if term.operation == "leaf"}
    if not read.isdisjoint(_unchanged(run)):
        # only what no call changes, with whatever inputs, is as it was initially
        everything, _ = _run(Terms(), project, block, [WHOLE] * len(inputs), set())
        run, given = _run(terms, project, block, intervals, set(_unchanged(everything)))
    return run, given


def _run(
    terms: Terms, project: Project, block: str, intervals: list[Interval], initial: set[object]
) -> tuple[Symbolic, list[Term]]:
    """Execute a block; the variables (and places in arrays) named in `initial` have their initial values."""

    def before(path: Path, variable: t.Variable, place: int) -> Interval:
        given = variable.initial[place] if isinstance(variable.initial, np.ndarray) else variable.initial
        if (*path, variable.key, place) in initial and isinstance(given, bool | int | float | np.generic):
            return float(given), float(given), math.isnan(given)
        return _before(path, variable, place)

    inputs = project.pous[block.upper()].section(t.Section.INPUT)
    run = Symbolic(project, terms)
    run.declare(_PATH, block, before)
    given = [terms.leaf(("input", v.key), "real", ends) for v, ends in zip(inputs, intervals, strict=True)]
    run.held |= {(_PATH, variable): leaf for variable, leaf in zip(inputs, given, strict=True)}
    run.run(_PATH, block)
    return run, given


def _unchanged(run: Symbolic) -> Iterator[object]:
    """The names of local variables, and places in arrays, that the call left as they were, whatever they were."""
    for (path, variable), value in run.held.items():
        if variable.section is t.Section.VAR:
            for place, item in enumerate(value if isinstance(value, tuple) else (value,)):
                if isinstance(item, Term) and item.arguments == ((*path, variable.key, place),):
                    yield item.arguments[0]


def _before(path: Path, variable: t.Variable, place: int) -> Interval:
    """Outputs are numbers before the call: initially, and behind each call, as `_check_all_inputs` holds."""
    low, high, nan = anything(path, variable, place)
    number = isinstance(variable.initial, bool | int | float) and variable.initial == variable.initial
    return low, high, nan and not (number and variable.section is t.Section.OUTPUT)


def _outputs(project: Project, block: str) -> tuple[t.Variable, ...]:
    return project.pous[block.upper()].section(t.Section.OUTPUT)


def _assigned(held: Held, valid: Value) -> Held:
    """What an output is assigned where `valid` holds; it must keep its value elsewhere."""
    if valid is True:
        return held
    if isinstance(held, Term) and held.operation == "if" and held.arguments[0] is valid:
        kept = held.arguments[2]
        if isinstance(kept, Term) and kept.operation == "leaf":
            return held.arguments[1]
    if valid is False and isinstance(held, Term) and held.operation == "leaf":
        raise NotProvedError(NEVER)
    raise NotProvedError("an output does not keep its value exactly where bValid is FALSE")


def _check_all_inputs(model: ModelIR, project: Project, block: str, outputs: tuple[int, ...]) -> None:
    """Nothing fails for any input at all, and what the model refuses sets bValid to FALSE."""
    terms, domain = Terms(), domain_of(model)
    run, inputs = _executed(terms, project, block, [WHOLE] * len(model.features))
    held = {variable.name: run.held[_PATH, variable] for variable in _outputs(project, block)}
    valid = held["bValid"]
    names = numbers_of(project, block)
    for number in outputs:
        value = _assigned(held[names[number]], valid)
        if terms.interval(value)[2]:
            raise NotProvedError(f"{names[number]} may be NaN")
    check_plausible(model, terms, held, valid)
    for number, (feature, x) in enumerate(zip(model.features, inputs, strict=True)):
        for interval in _refused(domain, number):
            with terms.only(x, interval):
                if terms.truth(valid) is not False:
                    raise NotProvedError(f"bValid may be TRUE for an input '{feature.name}' that is refused")


def _refused(domain: InputDomain, number: int) -> list[Interval]:
    low, high = (float(from_keys(keys[number : number + 1])[0]) for keys in (domain.low, domain.high))
    found: list[Interval] = [] if domain.nan[number] else [(math.inf, -math.inf, True)]
    if low > -math.inf:
        found.append((-math.inf, math.nextafter(low, -math.inf), False))
    if high < math.inf:
        found.append((math.nextafter(high, math.inf), math.inf, False))
    return found


def same_number(one: Any, other: Any) -> bool:
    """Whether two terms are the same, or two numbers to the bit."""
    if isinstance(one, Term) or isinstance(other, Term):
        return one is other
    return one == other and math.copysign(1.0, one) == math.copysign(1.0, other)
