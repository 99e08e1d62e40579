"""Trees in all cells of a grid at once: every node is met in a box of cells, and every leaf fills its box.

The reference sends each cell down each tree. Here each node is visited once, however many cells there are. What a split
says of a cell and how leaves become sums stays with the reference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from st_codegen.ir import BoolArray, FloatArray, Int32Array, IntArray, Operation, TreeEnsemble, reference

#: Cells of trees that are filled at once: they fit a processor's cache.
_CELLS = 100_000
#: Splits that a cell meets in a tree, about.
_DEPTH = 8


def apply(op: Operation, operands: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """What `reference.apply` gives for rows that are the cells of a grid of a shape, the last axis the fastest."""
    if isinstance(op, TreeEnsemble) and 3 ** len(shape) * op.n_nodes <= _DEPTH * op.n_trees * len(operands[0]):
        trees = _GridTrees(op, np.hstack(operands))
        splits = trees.splits(shape) if shape else None
        if splits is not None:
            trees.fill(splits, shape)
            return trees.total()
    return reference.apply(op, operands)


@dataclass(frozen=True)
class _Splits:
    """Which cells each split sends left: of its `axis` the first `cut` before the last cell, and `last` of the last.

    The last cell of an axis is apart, since it may be that of missing values.
    """

    axis: IntArray
    cut: IntArray
    last: BoolArray


@dataclass(frozen=True)
class _Boxes:
    """Nodes, their trees, and the cells that reach them: of each axis those from `low` to before `high`, and `last`."""

    node: IntArray
    tree: IntArray
    low: IntArray
    high: IntArray
    last: BoolArray

    @classmethod
    def whole(cls, roots: IntArray, shape: tuple[int, ...]) -> _Boxes:
        """Roots, which all cells reach."""
        low = np.zeros((len(roots), len(shape)), np.int64)
        return cls(roots, np.arange(len(roots)), low, low + shape - 1, np.ones(low.shape, np.bool_))

    @classmethod
    def joined(cls, parts: Sequence[_Boxes]) -> _Boxes:
        """All boxes of several parts."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def chosen(self, which: BoolArray) -> _Boxes:
        """The boxes that a mask chooses."""
        at = np.flatnonzero(which)
        return _Boxes(*(getattr(self, field.name).take(at, axis=0) for field in fields(self)))


class _GridTrees(reference.TreeEvaluator):
    """One ensemble on rows that are the cells of a grid."""

    _found: Int32Array

    def leaves(self, tree: int) -> IntArray:
        found: IntArray = self._found[tree].astype(np.int64)
        return found

    def splits(self, shape: tuple[int, ...]) -> _Splits | None:
        """All splits as cuts of one axis; None where one is something else."""
        op = self.op
        axis, cut = np.zeros(op.n_nodes, np.int64), np.zeros(op.n_nodes, np.int64)
        last = np.zeros(op.n_nodes, np.bool_)
        for number in range(len(op.columns)):
            nodes = np.flatnonzero(op.split == number)
            if not nodes.size:
                continue
            found = self._axis_of(number, shape)
            if found is None:
                return None
            axis[nodes] = found
            rows = math.prod(shape[found + 1 :]) * np.arange(shape[found])
            if op.columns[number].categorical or np.any(self.missing[number, rows[:-1]]):
                return None
            last[nodes] = self.goes_left(nodes, op.split[nodes], np.broadcast_to(rows[-1], nodes.shape))
            _, first, kind = np.unique(op.threshold[nodes], return_index=True, return_inverse=True)
            one = np.repeat(nodes[first], len(rows) - 1)
            left = self.goes_left(one, op.split[one], np.tile(rows[:-1], len(first))).reshape(len(first), -1)
            count = np.count_nonzero(left, axis=1)
            if np.any(left != (np.arange(len(rows) - 1) < count[:, None])):
                return None
            cut[nodes] = count[kind]
        return _Splits(axis, cut, last)

    def _axis_of(self, number: int, shape: tuple[int, ...]) -> int | None:
        """The axis along which a column changes, and along no other."""
        for axis in range(len(shape)):
            one = tuple(slice(None) if at == axis else slice(1) for at in range(len(shape)))
            given = (self.value[number].reshape(shape), self.missing[number].reshape(shape))
            if all(np.array_equal(np.broadcast_to(values[one], shape), values) for values in given):
                return axis
        return None

    def fill(self, splits: _Splits, shape: tuple[int, ...]) -> None:
        """Find the leaves of all cells in all trees."""
        self._found = np.empty((self.op.n_trees, math.prod(shape)), np.int32)
        step = max(_CELLS // math.prod(shape), 1)
        for first in range(0, self.op.n_trees, step):
            trees = np.arange(first, min(first + step, self.op.n_trees))
            self._found[trees] = self._filled(trees, splits, shape)

    def _filled(self, trees: IntArray, splits: _Splits, shape: tuple[int, ...]) -> IntArray:
        """The leaves of all cells, shape (trees, cells): sums along all axes of where boxes of leaves begin and end."""
        boxes = self._boxes(trees, splits, shape)
        place, weight = boxes.tree[:, None], boxes.node[:, None].astype(np.float64)
        for axis, count in enumerate(shape):
            low, high, last = (array[:, axis, None] for array in (boxes.low, boxes.high, boxes.last))
            place = place * count
            place = np.concatenate([place + low, place + high, place + (count - 1)], axis=1)
            weight = np.concatenate([weight, -weight, weight * last], axis=1)
        size = len(trees) * math.prod(shape)
        found = np.bincount(place.ravel(), weight.ravel(), size).reshape(len(trees), *shape)
        for axis in range(len(shape)):
            np.cumsum(found, axis=axis + 1, out=found)  # whole numbers: exact
        return found.reshape(len(trees), -1).astype(np.int64)

    def _boxes(self, trees: IntArray, splits: _Splits, shape: tuple[int, ...]) -> _Boxes:
        """The boxes of all leaves that a cell reaches."""
        op = self.op
        here = _Boxes.whole(op.roots[trees].astype(np.int64), shape)
        leaves = []
        while here.node.size:
            is_leaf = op.split[here.node] < 0
            leaves.append(here.chosen(is_leaf))
            here = here.chosen(~is_leaf)
            row, axis = np.arange(len(here.node)), splits.axis[here.node]
            cut = np.clip(splits.cut[here.node], here.low[row, axis], here.high[row, axis])
            last = splits.last[here.node]
            high, low, left, right = here.high.copy(), here.low.copy(), here.last.copy(), here.last.copy()
            high[row, axis] = low[row, axis] = cut
            left[row, axis] &= last
            right[row, axis] &= ~last
            here = _Boxes.joined(
                [
                    _Boxes(op.left[here.node].astype(np.int64), here.tree, here.low, high, left),
                    _Boxes(op.right[here.node].astype(np.int64), here.tree, low, here.high, right),
                ]
            )
            here = here.chosen(np.all((here.low < here.high) | here.last, axis=1))
        return _Boxes.joined(leaves)
