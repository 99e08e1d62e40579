"""Decision trees."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import BoolArray, FloatArray, Int32Array, IntArray
from st_codegen.ir.base import (
    Aggregate,
    Comparison,
    NanRule,
    Precision,
    ReadsColumns,
    check_columns,
    freeze,
    freeze_finite,
)
from st_codegen.ir.preorder import Links


@dataclass(frozen=True)
class TreeColumn:
    """How the splits of an ensemble read one column of its input.

    The number is first rounded to the ensemble's `input_precision`. A number in the closed interval `missing_interval`
    counts as missing, as NaN does under `NanRule.MISSING`. With `n_categories` the column holds a category code: the
    number cut to an integer, or, where `categories` lists the known values, the position of the equal value in that
    list. Codes outside 0 .. n_categories-1 are "other", and so is every negative number, unless
    `negative_fraction_is_zero`: then numbers between -1 and 0 are cut to code 0 (a plain C cast). `seen_missing`: the
    model file says that the training data had missing values here (most files do not say).
    """

    column: int
    nan: NanRule = NanRule.MISSING
    missing_interval: tuple[float, float] | None = None
    n_categories: int = 0
    categories: tuple[float, ...] | None = None
    negative_fraction_is_zero: bool = False
    seen_missing: bool = False

    @property
    def categorical(self) -> bool:
        return self.n_categories > 0


@dataclass(frozen=True)
class LinearLeaves:
    """Linear models in leaves (LightGBM linear_tree): constant + sum of coefficient * column, in order.

    Leaf row `r` owns entries `start[r] .. start[r+1]-1` of `column` and `coefficient`. A NaN in one of these columns
    makes the leaf fall back to its plain value. An input of magnitude `zero_magnitude` or less is read as 0.
    """

    constant: FloatArray
    start: Int32Array
    column: Int32Array
    coefficient: FloatArray
    zero_magnitude: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.zero_magnitude < math.inf:
            raise InputError(f"LinearLeaves.zero_magnitude: {self.zero_magnitude}")
        constant = freeze_finite(self, "constant", (None,))
        start = freeze(self, "start", np.int32, (len(constant) + 1,))
        column = freeze(self, "column", np.int32, (None,))
        freeze_finite(self, "coefficient", (len(column),))
        if start[0] != 0 or start[-1] != len(column) or np.any(np.diff(start) < 0):
            raise InputError("LinearLeaves.start: not a rising list of positions that covers all coefficients")


@dataclass(frozen=True)
class TreeEnsemble(ReadsColumns):
    """Decision trees in flat arrays.

    Nodes of tree `t` are `roots[t] .. roots[t+1]-1` (to the end for the last), parents before children. Walkers lay
    trees out in preorder (`ir.preorder`), but nothing may rely on it unless it looks, or lays them out. A node with
    `split[n] >= 0` is a split: `split` indexes `columns`. It goes left when `value <comparison> threshold[n]`; a
    missing value goes where `missing_left[n]` says; for a category column, `category_left` has the answer for code c
    at position `category_row[n] + c`, with c = n_categories for "other" and n_categories + 1 for a missing value.
    A threshold of +infinity sends every number left (HistGradientBoosting's split of missing from present).
    A node with `split[n] < 0` is a leaf: row `leaf[n]` of `leaf_value` (leaves, width of a leaf).

    Leaves of width 1 add to output `tree_output[t]`; wider leaves have one number for each output.
    The result of an output is `(base + v1 + v2 + ...) / divisor` with every addition rounded to `sum_precision`, or
    `(v1 + v2 + ...) / divisor + base` where the base is added last (`adds_base_last`).
    """

    inputs: tuple[int, ...]
    columns: tuple[TreeColumn, ...]
    roots: Int32Array
    split: Int32Array
    threshold: FloatArray
    left: Int32Array
    right: Int32Array
    missing_left: BoolArray
    leaf: Int32Array
    leaf_value: FloatArray
    tree_output: Int32Array
    base: FloatArray
    comparison: Comparison
    input_precision: Precision = Precision.FLOAT64
    sum_precision: Precision = Precision.FLOAT64
    aggregate: Aggregate = Aggregate.SUM
    base_last: bool = False
    divisor: float = 1.0
    category_row: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    category_left: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    linear: LinearLeaves | None = None

    @property
    def exact(self) -> bool:
        """Whether the source library's result is reproduced bit for bit."""
        return self.sum_precision is not Precision.REAL

    @property
    def adds_base_last(self) -> bool:
        """Whether the base is added behind the division: as it says, and always to a smallest or largest number."""
        return self.base_last or self.aggregate is not Aggregate.SUM

    @property
    def is_forest(self) -> bool:
        """Whether no node has two parents (an ONNX membership test becomes comparisons that share their children)."""
        inner = self.split >= 0
        return not np.any(np.bincount(np.concatenate([self.left[inner], self.right[inner]])) > 1)

    def __post_init__(self) -> None:
        nodes = len(freeze(self, "split", np.int32, (None,)))
        roots = freeze(self, "roots", np.int32, (None,))
        for name, dtype in (("threshold", np.float64), ("left", np.int32), ("right", np.int32)):
            freeze(self, name, dtype, (nodes,))
        freeze(self, "missing_left", np.bool_, (nodes,))
        freeze(self, "leaf", np.int32, (nodes,))
        values = freeze_finite(self, "leaf_value", (None, None))
        freeze(self, "tree_output", np.int32, (len(roots),))
        base = freeze_finite(self, "base", (None,))
        freeze(self, "category_left", np.bool_, (None,))
        freeze(self, "category_row", np.int32, (nodes if self.has_categories else 0,))
        if self.sum_precision is not Precision.FLOAT64:
            for array in (values, base):
                with np.errstate(over="ignore"):
                    if not np.array_equal(array.astype(np.float32), array):
                        raise InputError(
                            "TreeEnsemble: a leaf or base value is no float32, but the sum is one of float32"
                        )
        if not math.isfinite(self.divisor) or self.divisor == 0:
            raise InputError(f"TreeEnsemble.divisor: {self.divisor}")
        if values.shape[1] not in (1, len(base)):
            raise InputError(f"TreeEnsemble: leaves of width {values.shape[1]} for {counted(len(base), 'output')}")
        self._check_structure(nodes)

    def _check_structure(self, nodes: int) -> None:
        """Every walk from a root ends in a leaf of the same tree: children come after their parent and inside it."""
        roots, split = self.roots, self.split
        if len(roots) == 0 or roots[0] != 0 or np.any(np.diff(roots) <= 0) or roots[-1] >= nodes:
            raise InputError("TreeEnsemble.roots: not a rising list that starts at node 0")
        if np.any(split >= len(self.columns)):
            raise InputError("TreeEnsemble.split: a column that does not exist")
        inner = np.flatnonzero(split >= 0)
        end = np.append(roots[1:], nodes)
        end_of_tree = np.repeat(end, np.diff(end, prepend=0)).take(inner)
        for child in (self.left.take(inner), self.right.take(inner)):
            if np.any(child <= inner) or np.any(child >= end_of_tree):
                raise InputError("TreeEnsemble: a child lies before its parent or outside its tree")
        leaves = self.leaf[split < 0]
        if np.any(leaves < 0) or np.any(leaves >= len(self.leaf_value)):
            raise InputError("TreeEnsemble.leaf: a leaf without a value")
        numeric = inner[~np.array([c.categorical for c in self.columns] or [False])[split[inner]]]
        thresholds = self.threshold[numeric]
        if np.any(np.isnan(thresholds)) or np.any(thresholds == -np.inf):
            raise InputError("TreeEnsemble.threshold: NaN or -infinity; the model file is damaged")
        if np.any(self.tree_output < 0) or np.any(self.tree_output >= len(self.base)):
            raise InputError("TreeEnsemble.tree_output: an output that does not exist")
        narrow = self.leaf_value.shape[1] == 1
        if self.aggregate is not Aggregate.SUM and narrow and len(np.unique(self.tree_output)) < len(self.base):
            raise InputError(f"TreeEnsemble: the {self.aggregate} of an output to which no tree adds")

    @property
    def has_categories(self) -> bool:
        return any(column.categorical for column in self.columns)

    def check_operands(self, total: int) -> None:
        check_columns(self, (column.column for column in self.columns), total)

    @property
    def width(self) -> int:
        return len(self.base)

    @property
    def n_trees(self) -> int:
        return len(self.roots)

    @property
    def n_nodes(self) -> int:
        return len(self.split)


@dataclass(frozen=True)
class RankSlabs:
    """Slabs of the ranks in one column of an operand: rank r lies in slab (r + shift) / width, of `count` slabs."""

    column: int
    width: int
    shift: int
    count: int


@dataclass(frozen=True)
class CutTrees(TreeEnsemble):
    """Trees on ranks, once more for each cell of a grid of slabs, cut down to the nodes that rows of the cell meet.

    The ensemble itself says what is computed; `cut` is how: the trees of a cell give the same leaves, in fewer steps.
    Cells are numbered with the last of `slabs` as the fastest; tree t is number `t * cells + c` of `cut` in cell c.
    What the cells do not share takes `numbers` integers; `equal` has the same number for equal subtrees of `cut`.
    """

    slabs: tuple[RankSlabs, ...] = field(kw_only=True)
    cut: TreeEnsemble = field(kw_only=True)
    numbers: int = field(kw_only=True)
    equal: IntArray = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze(self, "equal", np.int64, (self.cut.n_nodes,))
        if self.cut.n_trees != self.n_trees * self.cells:
            raise InputError(f"CutTrees: {self.cut.n_trees} trees for {self.n_trees} in {self.cells} cells")

    @property
    def cells(self) -> int:
        return math.prod(axis.count for axis in self.slabs)


@dataclass(frozen=True)
class BranchedTree(TreeEnsemble):
    """A single tree that compares the inputs themselves, and of which each split is an IF of its own."""


def with_nodes(op: TreeEnsemble, links: Links, node: IntArray, **changes: Any) -> TreeEnsemble:
    """An ensemble of other trees made of its nodes: those numbered `node`, with other links.

    `changes` are the fields that have other values yet.
    """
    own = {
        "split": op.split.take(node),
        "threshold": op.threshold.take(node),
        "missing_left": op.missing_left.take(node),
        "leaf": op.leaf.take(node),
    }
    return replace(op, roots=links.roots, left=links.left, right=links.right, **{**own, **changes})


def depth_of(op: TreeEnsemble) -> int:
    """The largest number of splits on a path from a root to a leaf."""
    return int(depths_of(op).max(initial=0))


def depths_of(op: TreeEnsemble) -> IntArray:
    """The largest number of splits on a path from the root to a leaf, for each tree."""
    depths = np.zeros(len(op.roots), np.int64)
    node, tree = op.roots.astype(np.int64), np.arange(len(depths))
    while True:
        inner = op.split[node] >= 0
        node, tree = node[inner], tree[inner]
        if not node.size:
            return depths
        depths[tree] += 1  # once for each tree, however many of its nodes are on this level
        node, tree = np.concatenate([op.left[node], op.right[node]]), np.tile(tree, 2)


def of_each_tree(op: TreeEnsemble, extreme: np.ufunc, leaf_value: FloatArray) -> FloatArray:
    """The largest or the smallest (`np.maximum`, `np.minimum`) of the leaves of each tree, shape (trees, width)."""
    leaves = np.flatnonzero(op.split < 0)
    return extreme.reduceat(leaf_value[op.leaf[leaves]], np.searchsorted(leaves, op.roots), axis=0)


def added_up(op: TreeEnsemble, of_tree: FloatArray) -> FloatArray:
    """What numbers of each tree, as `of_each_tree` gives them, add up to for each output."""
    if of_tree.shape[1] == 1:
        return np.asarray(np.bincount(op.tree_output, of_tree[:, 0], minlength=op.width), np.float64)
    return np.asarray(np.sum(of_tree, axis=0), np.float64)


#: How the numbers of trees become one, and what that starts from.
_AGGREGATES = {
    Aggregate.SUM: (np.add, 0.0),
    Aggregate.MINIMUM: (np.minimum, math.inf),
    Aggregate.MAXIMUM: (np.maximum, -math.inf),
}


def ends_of(op: TreeEnsemble) -> tuple[FloatArray, FloatArray]:
    """The smallest and the largest number of each output, but for rounding, where no leaf is linear."""
    join, start = _AGGREGATES[op.aggregate]
    found = []
    for extreme in (np.minimum, np.maximum):
        of_tree = of_each_tree(op, extreme, op.leaf_value)
        total = np.full(op.width, start)
        if of_tree.shape[1] > 1:
            total = join.reduce(of_tree, axis=0)
        else:
            join.at(total, op.tree_output, of_tree[:, 0])
        found.append(total / op.divisor + op.base if op.adds_base_last else (total + op.base) / op.divisor)
    return np.minimum(*found), np.maximum(*found)
