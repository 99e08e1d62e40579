"""Trees behind logarithms and exponentials, rewritten to compare the inputs themselves.

The text of a controller computes `log1p` and its like a unit in the last place beside the library, and a comparison
turns that into another leaf. But such a function rises, so a split behind it divides the numbers of its input in two,
and bisection over the representable numbers finds where the library's own comparison changes over. The tree then
compares the input with that number, and nothing inexact is left.

NumPy's functions are not proved to be monotone in the last place. What is assumed of them is an error of at most
`MOST_ULPS` units in the last place, as NumPy states. Beyond a distance of the changeover that follows from this no
error can turn a decision; within it every single number is tried. Where decisions go to and fro, the model stays as it
is. The functions of another processor or release may round otherwise, and move a changeover by a few numbers: a note
says so in the header.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np

from st_codegen import ir
from st_codegen.errors import at_most
from st_codegen.ir import reference
from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray, from_order, to_order
from st_codegen.passes.jumps import largest_jump
from st_codegen.passes.monotone import Chain, Column, Domain, changeovers, columns_of, domain_of, goes_left
from st_codegen.passes.unread import read_values, without_unread

#: Rising functions that NumPy computes for the library.
RISING = frozenset({ir.Function.LOG1P, ir.Function.EXPM1, ir.Function.EXP})

#: The largest error of these functions that is assumed, in units in the last place.
MOST_ULPS = 4

#: Two computed values are in the order of their arguments when they are this far apart: each errs by `MOST_ULPS`, and
#: a unit in the last place doubles at a power of two.
_SHIFT = 4 * MOST_ULPS

#: Numbers around one changeover, and around all of a column, that are tried at most.
_MOST_AROUND = 200_000
_MOST_TRIED = 50_000_000

_BATCH = 1_000_000

_LARGEST = float(np.finfo(np.float64).max)


class _StaysError(Exception):
    """The steps cannot be removed."""


def without_inexact_steps(model: ir.ModelIR) -> ir.ModelIR:
    """The model with its trees on the inputs themselves where logarithms and exponentials stood in front of them.

    Equal to the library in every bit then, as far as its other operations are. Where inexact steps stay in front of
    trees, since they cannot be removed, a note in the header says how far the result may jump.
    """
    jump = largest_jump(model)
    if not jump:
        return model
    try:
        return _rewritten(model, columns_of(model, rising=RISING))
    except _StaysError:
        note = (
            "trees split behind an inexact step: where the number that a split compares lies within rounding of its "
            f"threshold, the sum of the trees may be another one than the library's, by at most {at_most(jump, 3)}"
        )
        return dataclasses.replace(model, source=dataclasses.replace(model.source, notes=(*model.source.notes, note)))


def _rewritten(model: ir.ModelIR, values: list[list[Column]]) -> ir.ModelIR:
    ops = list(model.ops)
    for number, op in enumerate(model.ops):
        if isinstance(op, ir.TreeEnsemble):
            given = [column for value in op.inputs for column in values[value]]
            read = [given[op.columns[column].column] for column in np.unique(op.split[op.split >= 0])]
            functions = (step for chain in read if isinstance(chain, Chain) for step in chain.steps)
            if any(isinstance(step, ir.Activation) for step in functions):
                ops[number] = _on_inputs(model, op, given)
    changed = dataclasses.replace(model, ops=tuple(ops))
    unread = sorted(set(range(1, len(ops) + 1)) - read_values(changed))
    dropped = [column for value in unread for column in values[value]]
    chains = [column for column in dropped if isinstance(column, Chain)]
    gone = [model.ops[value - 1] for value in unread]
    removed = {op.function.value for op in gone if isinstance(op, ir.Activation)}
    if not removed or len(chains) < len(dropped):
        raise _StaysError  # something that is no chain may refuse inputs in a way that would be lost
    note = (
        f"splits behind {' and '.join(sorted(removed))} compare the input itself, with the numbers at which NumPy "
        f"{np.__version__} changed over where this was generated; another processor or release may round otherwise and "
        "move them by a few units in the last place"
    )
    source = dataclasses.replace(model.source, notes=(*model.source.notes, note))
    return dataclasses.replace(without_unread(changed), source=source, accepted=_accepted(model, chains))


def _rises(step: ir.Operation) -> bool:
    if isinstance(step, ir.Scale):
        if step.operator in (ir.Operator.MULTIPLY, ir.Operator.DIVIDE):
            return bool(step.constant[0] > 0)
        return not (step.reverse and step.operator is ir.Operator.SUBTRACT)
    return isinstance(step, ir.Round | ir.Clip | ir.FillMissing | ir.Activation)


def _value(chain: Chain, x: FloatArray, shift: int = 0) -> FloatArray:
    """The column for numbers `x` of the feature, every inexact step moved by `shift` numbers up or down."""
    with np.errstate(all="ignore"):
        for step in chain.steps:
            x = reference.apply(step, [x[:, None]])[:, 0]
            if shift and isinstance(step, ir.Activation):
                # where a moved argument has no logarithm, or too large an exponential
                x = np.where(np.isnan(x), -np.inf if step.function is ir.Function.LOG1P else np.inf, x)
                ends = to_order(np.array([-np.inf, np.inf]))
                x = from_order(np.clip(to_order(x) + shift, *ends))
    return x


#: Whether values, each for the decision of a number, are on the left of it.
Decide = Callable[[FloatArray, IntArray], BoolArray]


def _edges(chain: Chain, decide: Decide, count: int, domain: Domain) -> tuple[FloatArray, BoolArray]:
    """The last number of the domain on the left for each of `count` decisions; NaN: none changes over, and which.

    Raises _StaysError where decisions go to and fro.
    """
    everything = np.arange(count)
    ends = to_order(np.array([domain.lower, domain.upper]))

    def last_left(shift: int) -> IntArray:
        edge, left = changeovers(lambda x: decide(_value(chain, x, shift), everything), count, domain)
        order = to_order(np.where(np.isnan(edge), 0.0, edge))
        return np.where(np.isnan(edge), np.where(left, ends[1], ends[0] - 1), order)

    low, high = last_left(_SHIFT), last_left(-_SHIFT)
    around = np.maximum(high - low, 0)
    if np.any(around > _MOST_AROUND) or np.sum(around) > _MOST_TRIED:
        raise _StaysError
    last = low.copy()
    for first, stop in _batches(around):
        index = np.repeat(everything[first:stop], around[first:stop])
        offset = np.arange(len(index)) - np.repeat(
            np.cumsum(around[first:stop]) - around[first:stop], around[first:stop]
        )
        left = decide(_value(chain, from_order(low[index] + 1 + offset)), index)
        number = np.bincount(index[left] - first, minlength=stop - first)
        if np.any(left != (offset < number[index - first])):
            raise _StaysError
        last[first:stop] += number
    changes = (last >= ends[0]) & (last < ends[1])
    return np.where(changes, from_order(np.where(changes, last, 0)), np.nan), last >= ends[0]


def _batches(sizes: IntArray) -> Iterable[tuple[int, int]]:
    """Runs of decisions with not many more than `_BATCH` numbers together."""
    group = np.cumsum(sizes) // _BATCH
    stops = np.append(np.flatnonzero(np.diff(group)) + 1, len(sizes)).tolist()
    return zip([0, *stops[:-1]], stops, strict=True)


def _inside(model: ir.ModelIR, chain: Chain) -> Domain:
    """The numbers of a chain's input for which all of its functions exist."""
    domain = domain_of(model, chain.feature)
    if not all(_rises(step) for step in chain.steps):
        raise _StaysError
    for number, step in enumerate(chain.steps):
        if not isinstance(step, ir.Activation):
            continue
        least = step.function is ir.Function.LOG1P
        limit = -1.0 if least else step.limit
        edge, left = _edges(Chain(chain.feature, chain.steps[:number]), lambda v, _, c=limit: v <= c, 1, domain)  # type: ignore[misc]
        if np.isnan(edge[0]):
            if bool(left[0]) == least:
                raise _StaysError  # exists nowhere
        elif least:
            domain = dataclasses.replace(domain, lower=float(np.nextafter(edge[0], np.inf)))
        else:
            domain = dataclasses.replace(domain, upper=float(edge[0]))
    return domain


def _accepted(model: ir.ModelIR, chains: Iterable[Chain]) -> tuple[tuple[float, float] | None, ...]:
    """For each input the numbers for which all chains on it exist; None: no function narrows them."""
    result: list[tuple[float, float] | None] = [None] * len(model.features)
    for chain in chains:
        whole, domain = domain_of(model, chain.feature), _inside(model, chain)
        if domain == whole:
            continue
        lower, upper = result[chain.feature] or (-_LARGEST, _LARGEST)
        if domain.lower > whole.lower:
            lower = max(lower, domain.lower)
        if domain.upper < whole.upper:
            upper = min(upper, domain.upper)
        result[chain.feature] = lower, upper
    return tuple(result) if any(result) else ()


def _on_inputs(model: ir.ModelIR, op: ir.TreeEnsemble, given: list[Column]) -> ir.TreeEnsemble:
    """The ensemble with splits of the inputs."""
    if op.linear is not None or op.has_categories:
        raise _StaysError
    columns: list[ir.TreeColumn] = []
    split, threshold = np.full(op.n_nodes, -1, np.int32), np.zeros(op.n_nodes)
    left, right, missing_left = op.left.copy(), op.right.copy(), op.missing_left.copy()
    for number in np.unique(op.split[op.split >= 0]).tolist():
        chain, column = given[op.columns[number].column], op.columns[number]
        if not isinstance(chain, Chain) or column.missing_interval is not None:
            raise _StaysError
        nodes = np.flatnonzero(op.split == number)
        thresholds, at = np.unique(op.threshold[nodes], return_inverse=True)
        decide = _decision(op, thresholds)
        edge, all_left = _edges(chain, decide, len(thresholds), _inside(model, chain))
        filled = chain.value(np.array([np.nan]))
        if not np.isnan(filled[0]):  # something in front of the trees replaces missing values
            missing_left[nodes] = decide(np.broadcast_to(filled, len(nodes)), at)
        elif column.nan is ir.NanRule.ZERO:
            missing_left[nodes] = decide(np.zeros(len(nodes)), at)
        threshold[nodes] = np.where(np.isnan(edge), np.inf, edge)[at]
        swapped = nodes[(np.isnan(edge) & ~all_left)[at]]  # all numbers go right
        left[swapped], right[swapped] = op.right[swapped], op.left[swapped]
        missing_left[swapped] = ~missing_left[swapped]
        split[nodes] = len(columns)
        columns.append(ir.TreeColumn(chain.feature, seen_missing=column.seen_missing))
    return dataclasses.replace(
        op,
        inputs=(0,),
        columns=tuple(columns),
        split=split,
        threshold=threshold,
        left=left,
        right=right,
        missing_left=missing_left,
        comparison=ir.Comparison.LESS_OR_EQUAL,
        input_precision=ir.Precision.FLOAT64,
    )


def _decision(op: ir.TreeEnsemble, thresholds: FloatArray) -> Decide:
    """Whether values go left at the splits with some of the thresholds."""

    def decide(value: FloatArray, chosen: IntArray) -> BoolArray:
        with np.errstate(over="ignore"):
            return goes_left(op, value, thresholds[chosen])

    return decide
