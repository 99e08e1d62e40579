"""Which columns of a model rise or fall with one input, and where exactly on the input a comparison changes over.

Rounding to float32 and the arithmetic of scalers are monotone in floating point too: a larger input never gives a
smaller result (for a positive factor). A split behind such steps therefore divides the float64 numbers of its input in
two at one number, and bisection over the representable numbers finds it without any error analysis: the generated code
compares the raw input with that number and decides as the library does, for every input.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from enum import StrEnum
from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.ir import reference
from st_codegen.ir.arrays import BoolArray, FloatArray, bisected, from_order, next_single, to_order
from st_codegen.ir.operations import one_column

#: Stands for infinity among the neighbours of a float32 number: as far behind the largest one as that is from the next.
_BEYOND = 2.0**128


class Dependence(StrEnum):
    """How a computed column depends on the inputs, where it is not a chain on one of them."""

    STEPS = "steps"  # only through comparisons: piecewise constant
    OTHER = "other"


@dataclass(frozen=True)
class Chain:
    """A column that rises (or falls) with one feature; `steps` are operations of width 1, none for the input itself."""

    feature: int
    steps: tuple[ir.Operation, ...] = ()

    def value(self, x: FloatArray) -> FloatArray:
        """The column for numbers `x` of the feature, shape (rows,)."""
        with np.errstate(all="ignore"):
            for step in self.steps:
                x = reference.apply(step, [x[:, None]])[:, 0]
        return x

    def then(self, step: ir.Operation) -> Chain:
        """The chain with one more operation of width 1."""
        return Chain(self.feature, (*self.steps, step))


Column = Chain | Dependence


def columns_of(model: ir.ModelIR, rising: Collection[ir.Function] = ()) -> list[list[Column]]:
    """For every value of a model (0: the inputs) and every column, how it depends on the inputs.

    Functions in `rising` are taken as steps of a chain although they are inexact.
    """
    values: list[list[Column]] = [[Chain(feature) for feature in range(len(model.features))]]
    for op in model.ops:
        given = [column for number in op.inputs for column in values[number]]
        if isinstance(op, ir.Activation) and op.function in rising and op.precision is ir.Precision.FLOAT64:
            values.append(_extended(op, given, is_monotone=True))
        else:
            values.append(_after(op, given))
    return values


@singledispatch
def _after(op: ir.Operation, given: list[Column]) -> list[Column]:
    """How the columns of an operation's result depend on the inputs, from how those of its operands (`given`) do."""
    steps = all(column is Dependence.STEPS for column in given)
    return [Dependence.STEPS if steps else Dependence.OTHER] * op.width


def _extended(op: ir.Operation, given: list[Column], *, is_monotone: bool) -> list[Column]:
    """The columns behind an operation that works column by column."""
    result: list[Column] = []
    for number, column in enumerate(given):
        if isinstance(column, Chain):
            result.append(column.then(one_column(op, number)) if is_monotone else Dependence.OTHER)
        else:
            result.append(column)
    return result


@_after.register
def _(op: ir.Select, given: list[Column]) -> list[Column]:
    return [given[column] for column in op.columns]


@_after.register
def _(op: ir.Scale | ir.Round | ir.Clip | ir.FillMissing, given: list[Column]) -> list[Column]:
    if isinstance(op, ir.Scale):
        is_monotone = op.exact and not (op.reverse and op.operator is ir.Operator.DIVIDE)
    else:
        is_monotone = not isinstance(op, ir.FillMissing) or op.sentinel is None
    return _extended(op, given, is_monotone=is_monotone)


@_after.register
def _(op: ir.Rank, given: list[Column]) -> list[Column]:
    whole = all(given[column.column] is not Dependence.OTHER for column in op.columns)
    return [Dependence.STEPS if whole else Dependence.OTHER] * op.width


@_after.register
def _(op: ir.TreeEnsemble, given: list[Column]) -> list[Column]:
    steps = op.linear is None and all(given[column.column] is not Dependence.OTHER for column in op.columns)
    return [Dependence.STEPS if steps else Dependence.OTHER] * op.width


@dataclass(frozen=True)
class Domain:
    """The float64 numbers, from `lower` to `upper`, that a feature can have when a block computes with it."""

    lower: float
    upper: float

    @property
    def inside(self) -> float:
        """A number that lies in the domain: 0, or the end that is nearest to it."""
        return min(max(0.0, self.lower), self.upper)


def domain_of(model: ir.ModelIR, feature: int) -> Domain:
    """What is left of a feature's numbers by the declared range and by what is refused."""
    declared, limit = model.features[feature], model.magnitude_limits[feature]
    lower, upper = -np.inf, np.inf
    if limit is not None:
        upper = float(np.nextafter(limit, 0.0))
        lower = -upper
    for ends in ((declared.lower, declared.upper), model.accepted_numbers[feature] or (None, None)):
        if ends[0] is not None and ends[1] is not None:
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
    return Domain(lower, upper)


def changeovers(decide: Callable[[FloatArray], BoolArray], count: int, domain: Domain) -> tuple[FloatArray, BoolArray]:
    """Where each of `count` monotone decisions changes over: the largest number that is decided as `domain.lower` is.

    `decide` takes one number for each decision. Returns these numbers, NaN where the decision never changes, and the
    decision at the lower end of the domain.
    """
    low, high = (np.full(count, end) for end in (domain.lower, domain.upper))
    first = decide(low)
    found = bisected(lambda key: decide(from_order(key)), to_order(low), to_order(high))
    return np.where(decide(high) != first, from_order(found), np.nan), first


@dataclass(frozen=True)
class SplitEdges:
    """Where the splits of one column of an ensemble change over, on the input itself.

    For each of the rising distinct `thresholds`: `edge`, the last number of the input on the side of the domain's lower
    end (NaN: the decision never changes), and `left_below`, whether that side goes left.
    """

    thresholds: FloatArray
    edge: FloatArray
    left_below: BoolArray


def split_edges(op: ir.TreeEnsemble, number: int, chain: Chain, domain: Domain) -> SplitEdges:
    """The changeovers of column `number` of an ensemble that reads a monotone chain."""
    thresholds = np.unique(op.threshold[op.split == number])
    with np.errstate(over="ignore"):
        if chain.steps:
            edge, left = changeovers(lambda x: goes_left(op, chain.value(x), thresholds), len(thresholds), domain)
        else:
            edge, left = _direct(op, thresholds, domain)
    return SplitEdges(thresholds, edge, left)


def goes_left(op: ir.TreeEnsemble, value: FloatArray, thresholds: FloatArray) -> BoolArray:
    """Whether splits with these thresholds send numbers left."""
    value = reference.rounded(value, op.input_precision)
    if op.comparison is ir.Comparison.LESS:
        return np.asarray(value < thresholds, np.bool_)
    return np.asarray((value <= thresholds) | (thresholds == np.inf), np.bool_)


def _direct(op: ir.TreeEnsemble, thresholds: FloatArray, domain: Domain) -> tuple[FloatArray, BoolArray]:
    """What `changeovers` finds where an input is compared as it is, or rounded to float32: without a search."""
    edge = np.where(thresholds == np.inf, np.inf, last_on_the_left(op, thresholds))
    left = edge >= domain.lower
    return np.where(left & (edge < domain.upper), edge, np.nan), np.asarray(left, np.bool_)


def last_on_the_left(op: ir.TreeEnsemble, thresholds: FloatArray) -> FloatArray:
    """The largest number that splits with these thresholds send left, as it is or rounded to float32."""
    less = op.comparison is ir.Comparison.LESS
    if op.input_precision is ir.Precision.FLOAT64:
        return np.nextafter(thresholds, -np.inf) if less else thresholds
    below = next_single(thresholds, up=False, strict=less)
    above = np.nextafter(below, np.float32(np.inf))
    # halfway between neighbours the even one is taken; beyond the largest float32 comes infinity
    low, high = (np.clip(side.astype(np.float64), -_BEYOND, _BEYOND) for side in (below, above))
    halfway: FloatArray = (low + high) / 2
    with np.errstate(over="ignore"):
        kept = halfway.astype(np.float32).astype(np.float64)
    stays = kept < thresholds if less else kept <= thresholds
    return np.where(stays, halfway, np.nextafter(halfway, -np.inf))


def step_edges(op: ir.TreeEnsemble, number: int, chain: Chain, domain: Domain) -> FloatArray:
    """All numbers behind which anything that column `number` of an ensemble does may change: sorted, distinct.

    Besides thresholds these are the ends of the interval that counts as missing, and of category codes.
    """
    column = op.columns[number]
    found = [] if column.categorical else [split_edges(op, number, chain, domain).edge]
    below, up_to = _other_edges(column)
    for thresholds, strict in ((below, True), (up_to, False)):
        if not len(thresholds):
            continue

        def decide(x: FloatArray, thresholds: FloatArray = thresholds, strict: bool = strict) -> BoolArray:
            value = reference.rounded(chain.value(x), op.input_precision)
            return np.asarray(value < thresholds if strict else value <= thresholds, np.bool_)

        with np.errstate(over="ignore"):
            found.append(changeovers(decide, len(thresholds), domain)[0])
    edges = np.unique(np.concatenate(found)) if found else np.zeros(0)
    return edges[~np.isnan(edges)]


def _other_edges(column: ir.TreeColumn) -> tuple[FloatArray, FloatArray]:
    """Numbers c of a column at which `value < c` matters, and those at which `value <= c` does."""
    below: list[float] = []
    up_to: list[float] = []
    if column.missing_interval is not None:
        below.append(column.missing_interval[0])
        up_to.append(column.missing_interval[1])
    if column.categories is not None:
        below += column.categories
        up_to += column.categories
    elif column.categorical:
        below += map(float, range(column.n_categories + 1))
        up_to += [-1.0]  # a plain cast sends -1 < x < 0 to code 0
    return np.array(below), np.array(up_to)
