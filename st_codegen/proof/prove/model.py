"""What the trees of a model demand, from its intermediate representation: decisions on boxes of inputs.

The rules of the library (comparison, rounding of inputs, missing values, categories, order and precision of the sum)
are data of the representation. The layouts of the compiler are not used, and of its passes only how far sums of trees
may jump behind inexact steps (`passes.jumps`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from st_codegen import ir
from st_codegen.errors import at_most
from st_codegen.ir import reference
from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray, bisected
from st_codegen.ir.base import Elementwise
from st_codegen.ir.operations import one_column
from st_codegen.passes.jumps import largest_jump
from st_codegen.proof.prove.axis import HIGHEST, LOWEST, AxisValue, InputAxis, from_keys, to_keys
from st_codegen.proof.prove.boxes import Lanes, Space
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.intervals import Interval


@dataclass(frozen=True)
class Column:
    """A column that depends on one input: its value for numbers of that input.

    It is monotone in the input (`steps` None), or constant between the keys `steps`, behind which it may change.
    """

    feature: int
    value: Callable[[FloatArray], FloatArray]
    steps: IntArray | None = None


@dataclass(frozen=True)
class InputDomain:
    """The inputs for which a model has an answer: keys from `low` to `high` of each input, and NaN where it may be."""

    low: IntArray
    high: IntArray
    nan: tuple[bool, ...]

    def lanes_within(self, axis: InputAxis) -> BoolArray:
        """The lanes of the axis of an input that lie in the domain."""
        number = axis.feature
        return axis.within(self.low[number], self.high[number], nan=self.nan[number])

    def nearest_to_zero(self) -> FloatArray:
        """The row of the domain whose numbers are 0, or as near to it as they may be."""
        return from_keys(np.clip(0, self.low, self.high))


def domain_of(model: ir.ModelIR) -> InputDomain:
    """The domain of a model: inputs are limited to the declared ranges first, and refused from a magnitude on."""
    low, high = [], []
    for feature, limit, accepted in zip(model.features, model.magnitude_limits, model.accepted_numbers, strict=True):
        ends = [-np.inf, np.inf]
        if limit is not None:
            if feature.lower is None or feature.lower <= -limit:
                ends[0] = float(np.nextafter(-limit, 0.0))
            if feature.upper is None or feature.upper >= limit:
                ends[1] = float(np.nextafter(limit, 0.0))
        # what lies outside of the declared range has the answer of its end
        if accepted is not None:
            if feature.lower is None or feature.lower < accepted[0]:
                ends[0] = max(ends[0], accepted[0])
            if feature.upper is None or feature.upper > accepted[1]:
                ends[1] = min(ends[1], accepted[1])
        keys = to_keys(np.array(ends))
        low.append(int(keys[0]))
        high.append(int(keys[1]))
    return InputDomain(np.array(low), np.array(high), tuple(map(model.takes_nan, range(len(model.features)))))


class ModelSide:
    """The columns of all values of a model, as far as they depend on one input each, and its ensembles.

    Another column that trees compare has an axis of its own behind those of the inputs, on which it is any number of an
    interval: `computed` gives the number of that axis and the interval for a column that an ensemble reads.
    """

    def __init__(self, model: ir.ModelIR, computed: Callable[[ir.TreeEnsemble, int], tuple[int, Interval]]) -> None:
        self.model, self.computed = model, computed
        self.domain = domain_of(model)
        columns: list[list[Column | str]] = [[Column(f, self._limited(f)) for f in range(len(model.features))]]
        self.ensembles: dict[int, Ensemble] = {}
        refusals: list[Column] = []
        jump = largest_jump(model)
        for number, op in enumerate(model.ops, 1):
            given = [column for value in op.inputs for column in columns[value]]
            columns.append(_columns_after(op, given, self.domain, refusals))
            if isinstance(op, ir.TreeEnsemble):
                for place in sorted(
                    {op.columns[split].column for split in np.unique(op.split[op.split >= 0]).tolist()}
                ):
                    given[place] = self._standing(op, place, given[place])
                self.ensembles[number] = Ensemble(op, given, self.domain, jump)

        #: Which numbers within the domain are taken, of inputs of which it refuses some: categories that nobody knows.
        self.accepted = {
            f: _accepted(f, refusals, nan=self.domain.nan[f]) for f in dict.fromkeys(c.feature for c in refusals)
        }
        # NaN is followed with them: it need not count as 0.0 does
        nan = tuple(there or feature in self.accepted for feature, there in enumerate(self.domain.nan))
        self.domain = dataclasses.replace(self.domain, nan=nan)

    def _standing(self, op: ir.TreeEnsemble, place: int, column: Column | str) -> Column | str:
        """A column that an ensemble reads, on an axis of its own where it is not followed on that of an input."""
        if isinstance(column, Column):
            return column
        try:
            axis, (low, high, _) = self.computed(op, place)
        except NotProvedError as error:
            return f"{column} ({error.reason})"
        if axis == len(self.domain.nan):
            keys = to_keys(np.array([low if low < 0 else -0.0, max(high, 0.0)]))
            first, last = (np.append(*pair) for pair in zip((self.domain.low, self.domain.high), keys, strict=True))
            self.domain = InputDomain(first, last, (*self.domain.nan, False))
        return Column(axis, lambda x: x)

    def _limited(self, feature: int) -> Callable[[FloatArray], FloatArray]:
        declared = self.model.features[feature]
        low = -np.inf if declared.lower is None else declared.lower
        high = np.inf if declared.upper is None else declared.upper
        return lambda x: np.clip(x, low, high)

    def cuts(self, feature: int) -> IntArray:
        """All keys of an input behind which a decision of the model may change."""
        found = [ensemble.cuts(feature) for ensemble in self.ensembles.values()]
        found += [value.axis.ends[:-1] for number, value in self.accepted.items() if number == feature]
        return np.unique(np.concatenate([*found, np.zeros(0, np.int64)]))


def _accepted(feature: int, refusals: list[Column], *, nan: bool) -> AxisValue:
    axis = InputAxis(feature)
    own = [column for column in refusals if column.feature == feature]
    for column in own:
        assert column.steps is not None
        axis.cut(column.steps)
    accepted = ~np.any([column.value(axis.low) > 0 for column in own], axis=0)
    accepted[-1] &= nan
    return AxisValue(axis, accepted)


def _columns_after(
    op: ir.Operation, given: list[Column | str], domain: InputDomain, refusals: list[Column]
) -> list[Column | str]:
    """The columns of a result; the reason for what depends on several inputs, or is neither monotone nor in steps.

    `refusals` takes those of which some numbers are refused, as whether they are.
    """
    if isinstance(op, ir.Select):
        return [given[column] for column in op.columns]
    if isinstance(op, ir.Combine):
        half = len(given) // 2
        return [_combined(op, one, other) for one, other in zip(given[:half], given[half:], strict=True)]
    kind = f"{type(op).__name__} ({op.function.value})" if isinstance(op, ir.Activation) else type(op).__name__
    if not isinstance(op, Elementwise):
        return [f"{kind} computes of several inputs together"] * op.width
    result: list[Column | str] = []
    for number, column in enumerate(given):
        step = None if isinstance(column, str) else _step(op, number, monotone=column.steps is None)
        if isinstance(column, str) or step is None:
            reason = f"{kind} makes, which is inexact, or neither monotone nor constant between numbers of an input"
            result.append(column if isinstance(column, str) else reason)
            continue
        steps = column.steps
        if isinstance(step, ir.Piecewise | ir.Exceeds) and steps is None:
            at = np.repeat(step.knots if isinstance(step, ir.Piecewise) else step.cut, 2)
            steps, _ = changes(column, at, np.arange(len(at)) % 2 == 0, domain)
        if isinstance(step, ir.Piecewise) and step.refuses:
            refusals.append(Column(column.feature, _refused(step, column), steps))
            step = step.without_refusals()
        result.append(Column(column.feature, _after(step, column), steps))
    return result


def _refused(step: ir.Operation, column: Column) -> Callable[[FloatArray], FloatArray]:
    return lambda x: (np.isnan(_after(step, column)(x)) & ~np.isnan(column.value(x))).astype(np.float64)


def _step(op: ir.Operation, number: int, *, monotone: bool) -> ir.Operation | None:
    """One column of an operation that keeps a column monotone, or in steps; None where it does not."""
    if (
        (isinstance(op, ir.Scale) and not (monotone and op.reverse and op.operator is ir.Operator.DIVIDE))
        or isinstance(op, ir.Round | ir.Clip | ir.Exceeds | ir.WholeNumber)
        or (isinstance(op, ir.FillMissing) and op.sentinel is None)
    ):
        step: ir.Operation = one_column(op, number)
        return step
    if isinstance(op, ir.Piecewise) and op.degree == 0:
        first, last = op.start[number : number + 2]
        missing = None if op.missing is None else op.missing[number : number + 1]
        pieces = op.pieces[first + number : last + number + 1]
        return ir.Piecewise((0,), np.array([0, last - first]), op.knots[first:last], op.at[first:last], pieces, missing)
    return None


def _after(step: ir.Operation, *before: Column) -> Callable[[FloatArray], FloatArray]:
    def value(x: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            return reference.apply(step, [column.value(x)[:, None] for column in before])[:, 0]

    return value


def _combined(op: ir.Combine, one: Column | str, other: Column | str) -> Column | str:
    """Two columns in steps of the same input."""
    reason = f"'{op.operator.value}' computes of two numbers on the way"
    if isinstance(one, str) or isinstance(other, str) or one.feature != other.feature:
        return reason
    if one.steps is None or other.steps is None or op.operator not in (ir.Operator.ADD, ir.Operator.SUBTRACT):
        return reason
    step = dataclasses.replace(op, inputs=(0, 1), width=1)
    return Column(one.feature, _after(step, one, other), np.union1d(one.steps, other.steps))


def changes(
    column: Column, thresholds: FloatArray, strict: BoolArray | bool, domain: InputDomain
) -> tuple[IntArray, BoolArray]:
    """The last key up to which a comparison with each threshold is as for the smallest number, and what it is.

    Below the threshold where `strict`, else not above it.
    """
    strict = np.broadcast_to(strict, thresholds.shape)

    def decide(x: FloatArray, chosen: IntArray) -> BoolArray:
        value, limit = column.value(x), thresholds[chosen]
        return np.asarray(np.where(strict[chosen], value < limit, value <= limit) | (limit == np.inf), np.bool_)

    ends = domain.low[column.feature], domain.high[column.feature]
    low, high = (np.full(len(thresholds), end, np.int64) for end in ends)
    everything = np.arange(len(thresholds))
    first = decide(from_keys(low), everything)
    changing = np.flatnonzero(decide(from_keys(high), everything) != first)
    last = np.full(len(thresholds), HIGHEST, np.int64)
    last[changing] = bisected(lambda keys: decide(from_keys(keys), changing), low[changing], high[changing])
    return last, first


def _read(rule: ir.TreeColumn, value: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Numbers as trees read a column, 0.0 in place of NaN, and which of them count as missing."""
    missing = np.isnan(value) & (rule.nan is ir.NanRule.MISSING)
    value = np.where(np.isnan(value), 0.0, value)
    if rule.missing_interval is not None:
        low, high = rule.missing_interval
        missing |= (value >= low) & (value <= high)
    return value, missing


class Ensemble:
    """Decisions of an ensemble on its model's inputs: for each node the last key of one side, and what NaN does."""

    def __init__(self, op: ir.TreeEnsemble, given: list[Column | str], domain: InputDomain, jump: float) -> None:
        self.op = op
        self.domain = domain
        nodes = op.n_nodes
        self.feature = np.zeros(nodes, np.int64)
        self.last = np.full(nodes, HIGHEST, np.int64)
        self.below = np.ones(nodes, np.bool_)
        self.nan = np.zeros(nodes, np.bool_)
        self.gap: dict[int, tuple[int, int]] = {}
        self.codes: dict[int, AxisValue] = {}
        for number in range(len(op.columns)):
            at = np.flatnonzero(op.split == number)
            if at.size:
                column = given[op.columns[number].column]
                if isinstance(column, str):
                    reason = f"a tree compares what {column}: leaves are not followed there"
                    if jump:
                        reason += (
                            f"; where rounding takes one past a threshold, a sum differs by up to {at_most(jump, 3)}"
                        )
                    raise NotProvedError(reason)
                self._read(number, column, at)

    def _rounded(self, column: Column) -> Column:
        """The column as the ensemble reads it."""

        def value(x: FloatArray) -> FloatArray:
            with np.errstate(over="ignore"):
                return reference.rounded(column.value(x), self.op.input_precision)

        return dataclasses.replace(column, value=value)

    def _read(self, number: int, column: Column, at: IntArray) -> None:
        op, rule = self.op, self.op.columns[number]
        self.feature[at] = column.feature
        column = self._rounded(column)
        if rule.categorical or column.steps is not None:
            self.codes[number] = self._category(number, column) if rule.categorical else self._numbers(rule, column)
            return
        thresholds, back = np.unique(op.threshold[at], return_inverse=True)
        last, below = changes(column, thresholds, op.comparison is ir.Comparison.LESS, self.domain)
        self.last[at], self.below[at] = last[back], below[back]
        (of_nan,), (is_missing,) = _read(rule, column.value(np.array([np.nan])))
        self.nan[at] = op.missing_left[at] if is_missing else self._decision(np.full(len(at), of_nan), op.threshold[at])
        if rule.missing_interval is not None:
            self.gap[number] = self._gap(column, *rule.missing_interval)

    def _gap(self, column: Column, low: float, high: float) -> tuple[int, int]:
        """The first and the last key at which a monotone column lies in an interval; none where the first is larger."""
        limits, strict = np.array([low, high]), np.array([True, False])
        ends, at_first = changes(column, limits, strict, self.domain)
        first, last = sorted(ends.tolist())
        # where the two comparisons differ at the smallest key, that is in the interval
        return (LOWEST, first) if at_first[0] != at_first[1] else (first + 1, last)

    def _decision(self, value: FloatArray, threshold: FloatArray) -> BoolArray:
        left = value < threshold if self.op.comparison is ir.Comparison.LESS else value <= threshold
        return np.asarray(left | (threshold == np.inf), np.bool_)

    def _numbers(self, rule: ir.TreeColumn, column: Column) -> AxisValue:
        """A column in steps, on an axis that is cut where it may change."""
        assert column.steps is not None
        axis = InputAxis(column.feature)
        axis.cut(column.steps)
        value, missing = _read(rule, column.value(axis.low))
        return AxisValue(axis, np.where(missing, np.nan, value))

    def _category(self, number: int, column: Column) -> AxisValue:
        """The code of a category column on an axis that is cut where it changes."""
        rule = self.op.columns[number]
        axis = InputAxis(column.feature)
        if rule.categories is not None:
            points = np.array(sorted(set(rule.categories)))
        else:
            points = np.arange(-1.0, rule.n_categories + 1)
        if np.any(np.abs(points) >= 2.0**40):
            raise NotProvedError("category numbers of 2**40 and more")
        if column.steps is not None:
            axis.cut(column.steps)
        else:
            gap = rule.missing_interval
            points = points if gap is None else np.append(points, gap)
            for strict in (True, False):
                axis.cut(changes(column, points, strict, self.domain)[0])
        value, missing = _read(rule, column.value(axis.low))
        with np.errstate(invalid="ignore"):
            inside = np.clip(value, -(2.0**40), 2.0**40)
        codes = np.where(missing, rule.n_categories + 1, reference.category_code(rule, inside))
        return AxisValue(axis, codes.astype(np.int64))

    def cuts(self, feature: int) -> IntArray:
        """The keys of an input behind which a decision may change."""
        found = [self.last[(self.feature == feature) & (self.op.split >= 0)]]
        for number, (low, high) in self.gap.items():
            if np.any(self.feature[self.op.split == number] == feature):
                found.append(np.array([low - 1, high]))
        found += [value.axis.ends for value in self.codes.values() if value.axis.feature == feature]
        keys = np.unique(np.concatenate(found))
        return keys[(keys >= LOWEST) & (keys < HIGHEST)]

    def leaves(self, space: Space, tree: int) -> Lanes:
        """The leaf of a tree that each box reaches; the space is split where a split divides a box."""
        op = self.op
        node = Lanes(space, np.full(space.lanes, op.roots[tree], np.int64))
        while True:
            here = node.lift().value
            if not np.any(op.split[here] >= 0):
                return Lanes(space, op.leaf[here].astype(np.int64))
            missing = self._missing(space, node)
            codes, coded = self._category_decisions(space, node)
            here = node.lift().value
            compared = (op.split[here] >= 0) & ~coded
            goes = space.decide(self.feature[here], self.last[here], self.below[here], self.nan[here], compared)
            here = node.lift().value
            inner = op.split[here] >= 0
            if missing is not None:
                goes = np.where(missing.lift().value.astype(np.bool_), op.missing_left[here], goes)
            if codes is not None:
                coded = np.asarray(codes.lift().known)
                goes = np.where(coded, codes.value, goes)
            node = Lanes(space, np.where(inner, np.where(goes, op.left[here], op.right[here]), here).astype(np.int64))

    def _missing(self, space: Space, node: Lanes) -> Lanes | None:
        """Where the number of a column lies in the interval that counts as missing."""
        result: Lanes | None = None
        for number, (low, high) in self.gap.items():
            inside = Lanes(space, self.op.split[node.lift().value] == number)
            # NaN keeps the way that `nan` has for it
            for last, below in ((high, True), (low - 1, False)):
                active = inside.lift().value.astype(np.bool_)
                lanes = space.lanes
                holds = space.decide(
                    self.feature[node.lift().value],
                    np.full(lanes, last),
                    np.full(lanes, below),
                    np.zeros(lanes, np.bool_),
                    active,
                )
                inside = Lanes(space, holds)
            result = inside if result is None else Lanes(space, inside.value | result.lift().value)
        return result

    def _category_decisions(self, space: Space, node: Lanes) -> tuple[Lanes | None, BoolArray]:
        """Whether boxes at splits of categories and of columns in steps go left, and which boxes these are."""
        op = self.op
        result: Lanes | None = None
        for number, codes in self.codes.items():
            at = op.split[node.lift().value] == number
            if not np.any(at):
                continue
            value, _ = space.resolve(codes, at)
            here = node.lift().value
            at = op.split[here] == number
            if op.columns[number].categorical:
                goes = op.category_left[np.where(at, op.category_row[here] + value, 0)]
            else:
                goes = np.where(np.isnan(value), op.missing_left[here], self._decision(value, op.threshold[here]))
            if result is None:
                result = Lanes(space, at & goes, at)
            else:
                result.lift()
                assert result.known is not None
                result = Lanes(space, np.where(at, goes, result.value), result.known | at)
        if result is None:
            return None, np.zeros(space.lanes, np.bool_)
        assert result.known is not None
        return result, result.known
