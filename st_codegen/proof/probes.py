"""Rows that try a model where it can go wrong: its range, its thresholds with neighbours, and what is no number."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import singledispatch
from itertools import pairwise

import numpy as np

from st_codegen import ir
from st_codegen.ir.arrays import FloatArray

#: Values that libraries and controllers treat in special ways. They are tried in every column.
SPECIAL = np.array(
    [
        *(np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, -5e-324, 1e-35, 1.0000000180025095e-35, -1e-36),
        *(1.0, -1.0, -0.5, 2.5, 255.0, 256.0, 16777216.0, -16777217.0, 2147483648.0),
        *(3.4028234663852886e38, 3.4028235677973366e38, -3.5e38, 1e300, -1.7976931348623157e308),
    ]
)


def probe_rows(
    model: ir.ModelIR, rows: int, seed: int = 0, *, sampled: bool = False, again: bool = False
) -> FloatArray:
    """At least `rows` rows (rows, features), deterministic: special values, thresholds, and the rest at random.

    Every threshold that can be traced back to an input is there with its two neighbours in float64 and in float32, even
    where that takes more rows; the points where rounding to float32 changes over are there as far as there is room.
    Special values stand one at a time in a row, thresholds of different columns share rows. `sampled`: of the rows with
    thresholds only as many as there is room for, drawn at random. `again`: half of the rows at random hold thresholds
    in the range again, beside other values of the other columns, which may decide whether a wrong answer there is seen.
    """
    random = np.random.default_rng(seed)
    lower, upper = operating_range(model)
    points = _critical_points(model)
    usual = _Usual(lower, upper, _only_categories(model))
    special = _special_rows(usual, random)
    edges = _rows_of([near for near, _ in points], usual, random)
    more = _rows_of([changeover for _, changeover in points], usual, random)
    room = max(rows - len(special), 0)
    if sampled and len(edges) > room:
        edges = edges[np.sort(random.choice(len(edges), room, replace=False))]
    room = max(room - len(edges), 0)
    if len(more) > room:
        more = more[np.sort(random.choice(len(more), room, replace=False))]
    inside = _random_rows(max(room - len(more), 0), usual, random)
    if again:
        _put_into(inside[: len(inside) // 2], [near for near, _ in points], usual, random)
    return np.vstack([special, edges, more, inside])


@dataclass(frozen=True)
class _Usual:
    """Where rows are drawn: between two ends, and from the categories of a feature that takes nothing else."""

    lower: FloatArray
    upper: FloatArray
    categories: dict[int, FloatArray]

    def rows(self, count: int, random: np.random.Generator) -> FloatArray:
        """So many rows."""
        rows = self.lower + (self.upper - self.lower) * random.random((count, len(self.lower)))
        return self.with_categories(rows, random)

    def with_categories(self, rows: FloatArray, random: np.random.Generator) -> FloatArray:
        """The rows, in which columns that take nothing else have categories."""
        for column, known in self.categories.items():
            rows[:, column] = random.choice(known, len(rows))
        return rows


def _only_categories(model: ir.ModelIR) -> dict[int, FloatArray]:
    """The categories of each feature that an encoder refuses between and beyond them."""
    found: dict[int, FloatArray] = {}
    for op in model.ops:
        if not isinstance(op, ir.Piecewise):
            continue
        for column, (first, stop) in enumerate(pairwise(op.start.tolist())):
            own = slice(first, stop)
            known = _categories(op.knots[own], op.at[own], op.pieces[first + column : stop + column + 1])
            feature, steps = origin(model, op.inputs[0], column)
            if feature is not None and len(inputs := undone(known, steps)):
                found[feature] = inputs
    return found


def _categories(knots: FloatArray, at: FloatArray, pieces: FloatArray) -> FloatArray:
    """Numbers for all that a column takes: its knots, or of stretches from knot to knot those that stand for them."""
    answered = np.isfinite(at)
    if np.all(np.isinf(pieces[:, 0])):
        return knots[answered]
    # an encoder that cuts numbers to integers; a knot itself may be an end that float32 rounds out of the stretch
    stretches = np.isinf(pieces[0, 0]) and np.array_equal(pieces[1:, 0], at) and not np.any(pieces[:, 1:])
    inside = np.searchsorted(knots, at[answered], "right") - 1
    return at[answered] if stretches and np.array_equal(inside, np.flatnonzero(answered)) else np.zeros(0)


def _random_rows(count: int, usual: _Usual, random: np.random.Generator) -> FloatArray:
    """Rows in the declared range; one in ten may leave it by half its width, and have numbers that are no category."""
    wide = random.random(count) < 0.1
    margin = 0.5 * (usual.upper - usual.lower) * wide[:, None]
    width = usual.upper - usual.lower + 2 * margin
    inside: FloatArray = usual.lower - margin + width * random.random((count, len(usual.lower)))
    inside[~wide] = usual.with_categories(inside[~wide], random)
    return inside


def _rows_of(points: list[FloatArray], usual: _Usual, random: np.random.Generator) -> FloatArray:
    """Rows that hold every point of every column, each column's in an order of its own."""
    rows = usual.rows(max((len(p) for p in points), default=0), random)
    for column, values in enumerate(points):
        rows[: len(values), column] = random.permutation(values)
    return rows


def _put_into(rows: FloatArray, points: list[FloatArray], usual: _Usual, random: np.random.Generator) -> None:
    """Put points of every column into half of some rows, drawn for each column by itself.

    Only those in its range, and none where it takes categories alone: rows hold all of these already.
    """
    for column, (values, low, high) in enumerate(zip(points, usual.lower, usual.upper, strict=True)):
        within = values[(low <= values) & (values <= high)]
        if len(within) and column not in usual.categories:
            there = random.random(len(rows)) < 0.5
            rows[there, column] = random.choice(within, int(there.sum()))


def operating_range(model: ir.ModelIR) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of each feature, between which models are tried.

    Those of `stated_range`, but where it has one value only: one below and above it are tried, too.
    """
    low, high = stated_range(model)
    one = low == high
    return np.where(one, low - 1.0, low), np.where(one, high + 1.0, high)


def stated_range(model: ir.ModelIR) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of each feature.

    As declared, else of the training data where they are known, else (`RangeSource.GUESS`) as the thresholds, vectors
    and scalers suggest.
    """
    low, high = _suggested_range(model)
    for number, feature in enumerate(model.features):
        if (known := feature.checked or feature.seen) is not None:
            low[number], high[number] = known
    return low, high


class RangeSource(StrEnum):
    """What the range of a feature is known from."""

    DECLARED = "configuration"
    DATA = "training data"
    GUESS = "guess from the model's numbers"


def range_source(feature: ir.Feature) -> RangeSource:
    """What the operating range of a feature is known from."""
    if feature.checked is not None:
        return RangeSource.DECLARED
    return RangeSource.GUESS if feature.seen is None else RangeSource.DATA


def _special_rows(usual: _Usual, random: np.random.Generator) -> FloatArray:
    """Each special value in each column, the others inside the range; then all columns at once."""
    width = len(usual.lower)
    both = zip(usual.lower, usual.upper, strict=True)
    ends = np.array([[np.nextafter(a, -np.inf), a, b, np.nextafter(b, np.inf)] for a, b in both])
    values = np.hstack([np.broadcast_to(SPECIAL, (width, len(SPECIAL))), ends])
    rows = usual.rows(values.size, random)
    column = np.repeat(np.arange(width), values.shape[1])
    rows[np.arange(values.size), column] = values.ravel()
    everywhere = np.repeat(SPECIAL[:, None], width, axis=1)
    return np.vstack([rows, everywhere])


def _critical_points(model: ir.ModelIR) -> list[tuple[FloatArray, FloatArray]]:
    """For each feature, the inputs at which some split changes its mind.

    First thresholds and neighbours, then the points around them where rounding to float32 changes over.
    """
    near: list[list[FloatArray]] = [[] for _ in model.features]
    changeover: list[list[FloatArray]] = [[] for _ in model.features]
    for op in model.ops:
        if isinstance(op, ir.Exceeds | ir.Piecewise | ir.WholeNumber):
            for place, values in enumerate(_typical(op)):
                feature, steps = origin(model, op.inputs[0], place)
                if feature is not None:
                    near[feature].append(_neighbours(undone(values, steps)))
        if not isinstance(op, ir.TreeEnsemble):
            continue
        for number, column in enumerate(op.columns):
            feature, steps = origin(model, op.inputs[0], column.column)
            if feature is None:
                continue
            if column.categorical:
                codes = np.arange(-1, column.n_categories + 2, dtype=np.float64)
                known = np.array(column.categories) if column.categories is not None else codes
                near[feature].append(np.concatenate([codes, known, known + 0.5]))
                continue
            thresholds = np.unique(op.threshold[op.split == number])
            inputs = undone(thresholds[np.isfinite(thresholds)], steps)
            near[feature].append(_neighbours(inputs))
            changeover[feature].append(_changeovers(inputs))
    return [(_unique(n), _unique(c)) for n, c in zip(near, changeover, strict=True)]


def _unique(parts: list[FloatArray]) -> FloatArray:
    values = np.unique(np.concatenate(parts)) if parts else np.zeros(0)
    return values[np.isfinite(values)]


def singles(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The float32 numbers below, at and above."""
    with np.errstate(over="ignore"):  # LightGBM has 1e300 for infinity, which float32 has as infinity
        single = values.astype(np.float32)
        below, above = np.nextafter(single, np.float32(-np.inf)), np.nextafter(single, np.float32(np.inf))
    return below.astype(np.float64), single.astype(np.float64), above.astype(np.float64)


def _neighbours(values: FloatArray) -> FloatArray:
    """Values with their neighbours in float64 and in float32."""
    return np.concatenate([values, np.nextafter(values, -np.inf), np.nextafter(values, np.inf), *singles(values)])


def _changeovers(values: FloatArray) -> FloatArray:
    """The midpoints between the float32 numbers around each value, with their neighbours."""
    below, at, above = singles(values)
    halves = np.concatenate([(below + at) / 2, (at + above) / 2])
    return np.concatenate([halves, np.nextafter(halves, -np.inf), np.nextafter(halves, np.inf)])


#: Operations from a feature to a column up to which they are followed, far more than pipelines have: all of n in a row
#: would cost n^2.
_MOST_STEPS = 100


def origin(model: ir.ModelIR, value: int, column: int) -> tuple[int | None, list[tuple[ir.Operator, bool, float]]]:
    """The feature that a column is a scaled copy of, and the scaling steps from feature to column; None if none.

    The copy may be rounded, to float32 or to whole numbers. Nor is one found behind more than `_MOST_STEPS` operations.
    """
    steps: list[tuple[ir.Operator, bool, float]] = []
    for _ in range(_MOST_STEPS + 1):
        if not value:
            return column, steps[::-1]
        op = model.ops[value - 1]
        if isinstance(op, ir.Select):
            value, column = op.source(column, model.value_width)
        elif isinstance(op, ir.Scale):
            steps.append((op.operator, op.reverse, float(op.constant[column])))
            value = op.inputs[0]
        elif isinstance(op, ir.Round | ir.WholeNumber):
            value = op.inputs[0]
        else:
            break
    return None, []


def undone(values: FloatArray, steps: list[tuple[ir.Operator, bool, float]]) -> FloatArray:
    """The inputs that scaling steps take to the given values, up to rounding."""
    with np.errstate(all="ignore"):
        for operator, reverse, constant in reversed(steps):
            if operator is ir.Operator.ADD:
                values = values - constant
            elif operator is ir.Operator.SUBTRACT:
                values = constant - values if reverse else values + constant
            elif operator in (ir.Operator.MAXIMUM, ir.Operator.MINIMUM):
                continue
            elif operator is ir.Operator.MULTIPLY:
                values = values / constant
            else:
                values = constant / values if reverse else values * constant
    return values[np.isfinite(values)]


#: The farthest end of a range that nobody declared.
_FARTHEST = 1e307


def _suggested_range(model: ir.ModelIR) -> tuple[FloatArray, FloatArray]:
    """A range for features that declare none, from the numbers inside the model."""
    low, high = np.full(len(model.features), np.inf), np.full(len(model.features), -np.inf)
    for op in model.ops:
        for column, values in enumerate(_typical(op)):
            feature, steps = origin(model, op.inputs[0], column)
            inputs = undone(values, steps)
            if feature is not None and len(inputs):
                low[feature] = min(low[feature], np.min(inputs))
                high[feature] = max(high[feature], np.max(inputs))
    unknown = ~np.isfinite(low)
    low[unknown], high[unknown] = -1.0, 1.0
    # what is drawn between the ends must not overflow
    low, high = np.clip(low, -_FARTHEST, _FARTHEST), np.clip(high, -_FARTHEST, _FARTHEST)
    margin = np.where(high > low, 0.1 * (high - low), np.maximum(np.abs(low), 1.0))
    return low - margin, high + margin


@singledispatch
def _typical(_: ir.Operation) -> list[FloatArray]:
    """For each column that the operation reads, numbers in the middle of what it was trained on."""
    return []


@_typical.register
def _(op: ir.KernelSum) -> list[FloatArray]:
    return list(op.support_vectors.T)


@_typical.register
def _(op: ir.Scale) -> list[FloatArray]:
    # what follows a scaler is of the order of 1
    if op.reverse:
        return []
    ends = np.array([-3.0, 3.0]) if op.operator in (ir.Operator.MULTIPLY, ir.Operator.DIVIDE) else np.array([-1.0, 1.0])
    return [undone(ends, [(op.operator, False, float(constant))]) for constant in op.constant]


@_typical.register
def _(op: ir.Exceeds) -> list[FloatArray]:
    return list(op.cut[:, None])


@_typical.register
def _(op: ir.WholeNumber) -> list[FloatArray]:
    return [np.arange(-4.0, 4.5, 0.5)] * op.width


@_typical.register
def _(op: ir.Piecewise) -> list[FloatArray]:
    return np.split(op.knots, op.start[1:-1])


@_typical.register
def _(op: ir.TreeEnsemble) -> list[FloatArray]:
    width = 1 + max((column.column for column in op.columns), default=-1)
    values: list[FloatArray] = [np.zeros(0)] * width
    for number, column in enumerate(op.columns):
        if column.categorical:
            known = (
                np.array(column.categories) if column.categories else np.arange(column.n_categories, dtype=np.float64)
            )
        else:
            known = op.threshold[op.split == number]
        values[column.column] = np.concatenate([values[column.column], known[np.isfinite(known)]])
    return values
