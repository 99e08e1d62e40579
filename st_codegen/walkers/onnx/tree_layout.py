"""From the nodes of an ONNX tree ensemble to the flat trees of the intermediate representation.

The representation knows the comparisons `<` and `<=` whose true side is the left child. The other modes become these:

- `x > t` and `x >= t` are `x <= t` and `x < t` with the children exchanged.
- `x == v` is `x <= v` followed by `x < v`: the value lies in the interval [v, v]. Both tests share the child "else".
- `x != v` is `x == v` with the children exchanged.
- `x in {v, w, ..}` is a chain of such intervals from the largest value down, all with the same two children.
- `x < t` is `x <= p`, p the largest number below t, where an ensemble needs both comparisons.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, IntArray, next_single
from st_codegen.ir.preorder import Preorder, preorder
from st_codegen.walkers.onnx.equality import check_merges, merge_equality_chains
from st_codegen.walkers.onnx.forest import Forest, Mode, NumberType

#: Leaves times outputs of one ensemble: 1 GiB of leaf values.
MAX_LEAF_VALUES = 2**27
#: Splits from a root to a leaf. onnxruntime builds trees by recursion and crashes on far deeper ones.
MAX_DEPTH = 1000


def build_ensemble(
    forest: Forest, inputs: tuple[int, ...], columns: AnyArray, input_precision: ir.Precision
) -> ir.TreeEnsemble:
    """The ensemble in the intermediate representation; `columns[feature]` is where a feature stands in the inputs.

    Raises InputError for damaged trees, UnsupportedModelError where the arrays would not fit.
    """
    _check_features(forest, len(columns))
    forest = merge_equality_chains(forest)
    flat = _laid_out(forest)
    check_merges(forest, flat.order)
    tests = _Tests(forest, flat)
    comparison, threshold = tests.canonical()
    order = flat.order[tests.owner]
    is_leaf = forest.mode[order] == Mode.LEAF
    used, split = np.unique(forest.feature[order][~is_leaf], return_inverse=True)
    column = np.full(len(order), -1, np.int64)
    column[~is_leaf] = split
    leaf_value, tree_output = _leaf_values(forest, flat)
    return ir.TreeEnsemble(
        inputs=inputs,
        columns=tuple(ir.TreeColumn(int(columns[feature])) for feature in used),
        roots=tests.start[flat.roots].astype(np.int32),
        split=column.astype(np.int32),
        threshold=threshold,
        left=tests.left.astype(np.int32),
        right=tests.right.astype(np.int32),
        missing_left=tests.missing_left,
        leaf=np.where(is_leaf, forest.leaf[order], -1).astype(np.int32),
        leaf_value=leaf_value,
        tree_output=tree_output.astype(np.int32),
        base=forest.base,
        comparison=comparison,
        input_precision=input_precision,
        sum_precision=ir.Precision.FLOAT32 if forest.number_type is np.float32 else ir.Precision.FLOAT64,
        aggregate=forest.aggregate,
        base_last=True,
        divisor=float(len(forest.roots)) if forest.average else 1.0,
    )


def _check_features(forest: Forest, total: int) -> None:
    bad = np.flatnonzero((forest.mode != Mode.LEAF) & ((forest.feature < 0) | (forest.feature >= total)))
    if bad.size:
        raise InputError(
            f"{forest.where(bad[0])} reads feature {forest.feature[bad[0]]} of {total} (counted from 0); "
            "the model file is damaged"
        )


def _laid_out(forest: Forest) -> Preorder:
    """Parents first, left child next; "left" is the side below the threshold, or "else" for a test of equality."""
    below_is_true = np.isin(forest.mode, (Mode.LEQ, Mode.LT, Mode.NEQ))
    left = np.where(below_is_true, forest.true, forest.false)
    right = np.where(below_is_true, forest.false, forest.true)
    flat = preorder(forest.roots, left, right)
    if len(flat.order) < len(forest.mode):
        reached = np.zeros(len(forest.mode), np.bool_)
        reached[flat.order] = True
        lost = np.flatnonzero(~reached)
        raise InputError(
            f"{forest.where(lost[0])}: no path leads here from the root of its tree "
            f"({counted(len(lost), 'such node')}; the root is the node listed first); the model file is damaged"
        )
    _check_depth(forest, flat)
    return flat


def _check_depth(forest: Forest, flat: Preorder) -> None:
    """Refuse trees on which onnxruntime overflows its stack; it unrolls sets before it descends into a tree."""
    length = np.diff(forest.member_start)[flat.order]
    length = np.where(forest.mode[flat.order] == Mode.MEMBER, length, 1)
    depth = np.zeros(len(flat.order), np.int64)
    level = flat.roots.astype(np.int64)
    while level.size:
        inner = level[flat.left[level] >= 0]
        below = depth[inner] + length[inner]
        if np.any(below > MAX_DEPTH):
            node = flat.order[inner[np.argmax(below)]]
            raise UnsupportedModelError(
                f"{forest.where(node)}: more than {MAX_DEPTH} splits deep, where onnxruntime runs out of stack; "
                "train the model again with a limited depth"
            )
        level = np.concatenate([flat.left[inner], flat.right[inner]]).astype(np.int64)
        depth[level] = np.concatenate([below, below])


class _Tests:
    """The splits and leaves of a forest after every test of equality became two comparisons for each interval.

    `owner` is the laid-out node that a new node comes from, `start` the first new node of a laid-out node.
    """

    def __init__(self, forest: Forest, flat: Preorder) -> None:
        self.forest = forest
        mode = forest.mode[flat.order]
        value = forest.value[flat.order]
        self._check_thresholds(flat.order, mode, value)
        intervals = _intervals(forest, flat.order)
        count = np.ones(len(mode), np.int64)
        count[np.isin(mode, (Mode.EQ, Mode.NEQ, Mode.MEMBER, Mode.MEMBER_INTEGER))] = 0
        np.add.at(count, intervals.node, 2)
        self.start: IntArray = np.concatenate([[0], np.cumsum(count)[:-1]])
        self.owner: IntArray = np.repeat(np.arange(len(mode)), count)
        if len(self.owner) > np.iinfo(np.int32).max:
            raise UnsupportedModelError(f"the trees need {len(self.owner)} comparisons, more than fit in 32 bits")
        self.value = value[self.owner]
        self.strict: BoolArray = np.isin(mode, (Mode.LT, Mode.GTE))[self.owner]
        split = flat.left >= 0
        self.left: IntArray = np.where(split, self.start[flat.left], -1)[self.owner]
        self.right: IntArray = np.where(split, self.start[flat.right], -1)[self.owner]
        self.missing_left = self._missing_left(flat.order, mode)[self.owner]
        self._expand(intervals, flat)

    def _check_thresholds(self, order: IntArray, mode: NDArray[np.int8], value: FloatArray) -> None:
        compares = ~np.isin(mode, (Mode.LEAF, Mode.MEMBER, Mode.MEMBER_INTEGER))
        bad = np.flatnonzero(compares & (np.isnan(value) | (value == -np.inf)))
        if bad.size:
            raise InputError(
                f"{self.forest.where(order[bad[0]])}: the threshold is {value[bad[0]]}; "
                "the model file is damaged, or train the model again without NaN and infinite values"
            )

    def _missing_left(self, order: IntArray, mode: NDArray[np.int8]) -> BoolArray:
        """Where NaN goes: every comparison but `!=` is false for it, unless the node tracks missing values as true.

        A test of equality passes NaN on to its hit through the left child, see `_expand`.
        """
        true = self.forest.missing_true[order]
        left_on_true = np.isin(mode, (Mode.LEQ, Mode.LT, Mode.EQ, Mode.MEMBER, Mode.MEMBER_INTEGER))
        left_on_false = np.isin(mode, (Mode.GT, Mode.GTE))
        return (left_on_true & true) | (left_on_false & ~true)

    def _expand(self, intervals: _Intervals, flat: Preorder) -> None:
        """Upper and lower test of each interval: above the upper bound is "else", from the lower bound up is a hit.

        The next interval, or at last "else", is what lies below the lower bound, so the left child is the next node.
        """
        within = np.arange(len(intervals.node)) - np.searchsorted(intervals.node, intervals.node)
        upper = self.start[intervals.node] + 2 * within
        lower = upper + 1
        self.value[upper], self.value[lower] = intervals.high, intervals.low
        self.strict[upper], self.strict[lower] = intervals.high_open, ~intervals.low_open
        self.left[upper], self.left[lower] = lower, lower + 1
        self.right[upper] = self.start[flat.left[intervals.node]]
        self.right[lower] = self.start[flat.right[intervals.node]]
        self.missing_left[lower] = False

    def canonical(self) -> tuple[ir.Comparison, FloatArray]:
        """One comparison for all nodes, and the thresholds for it."""
        split = self.left >= 0
        if np.all(self.strict[split]) and not np.any(np.isinf(self.value[split])):
            return ir.Comparison.LESS, np.where(split, self.value, 0.0)
        below = largest_below(self.value, self.forest.number_type)
        threshold = np.where(split, np.where(self.strict, below, self.value), 0.0)
        if np.any(threshold == -np.inf):
            raise UnsupportedModelError("a threshold lies at the lowest number of its type, nothing is below it")
        return ir.Comparison.LESS_OR_EQUAL, threshold


def largest_below(value: FloatArray, number_type: NumberType) -> FloatArray:
    """The largest number of a type below each value, so that x < value is x <= result for all x of the type.

    Below the lowest float32 only minus infinity is left; the float64 below it serves as well.
    """
    single = next_single(value, up=False, strict=True)
    with np.errstate(over="ignore"):
        below = np.nextafter(value, -np.inf)
    return below if number_type is np.float64 else np.where(np.isinf(single), below, single)


@dataclass(frozen=True)
class _Intervals:
    """What the tests of equality accept: intervals whose bounds belong to them unless marked open.

    `node` is the laid-out node of each interval, rising; the intervals of a node go from the highest to the lowest.
    """

    node: IntArray
    low: FloatArray
    high: FloatArray
    low_open: BoolArray
    high_open: BoolArray


def _intervals(forest: Forest, order: IntArray) -> _Intervals:
    """The intervals of all tests of equality."""
    mode = forest.mode[order]
    single = np.flatnonzero(np.isin(mode, (Mode.EQ, Mode.NEQ)))
    value = forest.value[order[single]]
    closed = np.zeros(len(single), np.bool_)
    parts = [_Intervals(single, value, value, closed, closed)]
    for node in np.flatnonzero(np.isin(mode, (Mode.MEMBER, Mode.MEMBER_INTEGER))):
        parts.append(_member_intervals(forest, int(node), int(order[node])))
    rank = np.argsort(np.concatenate([part.node for part in parts]), kind="stable")
    return _Intervals(*(np.concatenate([getattr(p, entry.name) for p in parts])[rank] for entry in fields(_Intervals)))


def _member_intervals(forest: Forest, position: int, node: int) -> _Intervals:
    values = np.unique(forest.members(node))[::-1]
    if not np.all(np.isfinite(values)):
        raise InputError(f"{forest.where(node)}: a value of its set is infinite; the model file is damaged")
    if forest.mode[node] == Mode.MEMBER:
        closed = np.zeros(len(values), np.bool_)
        return _Intervals(np.full(len(values), position), values, values, closed, closed)
    # the integer part of x is v: [v, v+1) above zero, (v-1, v] below, (-1, 1) at zero; neighbours make one interval
    gap = np.flatnonzero(values[:-1] - values[1:] > 1)
    high = values[np.append(0, gap + 1)]
    low = values[np.append(gap, len(values) - 1)]
    return _Intervals(
        node=np.full(len(high), position),
        low=np.where(low > 0, low, low - 1),
        high=np.where(high < 0, high, high + 1),
        low_open=low <= 0,
        high_open=high >= 0,
    )


def _leaf_values(forest: Forest, flat: Preorder) -> tuple[FloatArray, IntArray]:
    """Leaf values (rows, width) and the output of each tree.

    Width 1 where every tree serves one target; else a leaf has a number for each target, where the file has none one
    that changes nothing.
    """
    rows, n_targets = forest.n_leaves, forest.n_targets
    tree, target, complete = targets_of_trees(forest, flat.roots, forest.leaf[flat.order])
    if n_targets > 1:
        _check_coverage(forest, np.unique(target[complete]))
    if len(tree) == len(flat.roots):
        leaf_value = np.zeros((rows, 1))
        leaf_value[forest.weight_leaf, 0] = forest.weight
        return leaf_value, target
    if rows * n_targets > MAX_LEAF_VALUES:
        raise UnsupportedModelError(
            f"{counted(rows, 'leaf', 'leaves')} with {counted(n_targets, 'number')} each: at most {MAX_LEAF_VALUES} "
            "leaf values; export one model for each target"
        )
    largest = float(np.finfo(forest.number_type).max)
    neutral = {ir.Aggregate.SUM: 0.0, ir.Aggregate.MINIMUM: largest, ir.Aggregate.MAXIMUM: -largest}[forest.aggregate]
    leaf_value = np.full((rows, n_targets), neutral)
    leaf_value[forest.weight_leaf, forest.weight_target] = forest.weight
    return leaf_value, np.zeros(len(flat.roots), np.int64)


def targets_of_trees(forest: Forest, roots: AnyArray, leaf: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Each tree with each of its targets, and whether all leaves of the tree have a weight for the target.

    `roots` and `leaf` (of each node) are those of the trees as they are laid out.
    """
    position = np.flatnonzero(leaf >= 0)
    tree = np.searchsorted(roots, position, side="right") - 1
    start = np.searchsorted(forest.weight_leaf, np.arange(forest.n_leaves + 1))
    count = np.diff(start)[leaf[position]]
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    weight = np.repeat(start[leaf[position]], count) + within
    key, times = np.unique(np.repeat(tree, count) * forest.n_targets + forest.weight_target[weight], return_counts=True)
    tree_of_key, target_of_key = np.divmod(key, forest.n_targets)
    return tree_of_key, target_of_key, times == np.bincount(tree)[tree_of_key]


def _check_coverage(forest: Forest, covered: IntArray) -> None:
    """A target that no leaf of a row sets is 0 to onnxruntime, whatever its base value (ScoreValue::has_score).

    So a minimum, a maximum and a base value need a tree that always has a number for the target.
    """
    needed = np.flatnonzero((forest.base != 0) | (forest.aggregate is not ir.Aggregate.SUM))
    missing = np.setdiff1d(needed, covered)
    if missing.size:
        raise UnsupportedModelError(
            f"target {missing[0]} is not set by all leaves of any tree, and onnxruntime then forgets its base value or "
            "has no number at all; export one model for each target, or with base value 0 and SUM"
        )
