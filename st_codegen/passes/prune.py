"""Trees without what makes no difference: branches no input reaches, equal subtrees, constant trees.

Works on ranked ensembles (`ranks`). A row still meets the same leaf values in the same order, so every sum is the
library's to the bit. Two things change the sum itself, and both are exact: constant trees at the very beginning are
added to `base` (as the library does first), and trees that only ever add +0.0 to a sum that cannot be -0.0 are dropped.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from st_codegen.ir import Aggregate, Int32Array, IntArray, ModelIR, Precision, Rank, TreeEnsemble
from st_codegen.ir.preorder import Preorder, preorder
from st_codegen.ir.subtrees import distinct_rows, follow, subtrees
from st_codegen.ir.trees import with_nodes
from st_codegen.passes.ranks import compact

#: Numbers kept at once for the reachable ranks of the nodes of one level.
_BOXES = 8_000_000


def pruned(model: ModelIR) -> ModelIR:
    """The model with every ensemble behind ranks pruned, and ranks among those thresholds only that are left."""
    ops = list(model.ops)
    for number, op in enumerate(ops):
        if isinstance(op, TreeEnsemble) and len(op.inputs) == 1 and op.inputs[0]:
            rank = ops[op.inputs[0] - 1]
            readers = sum(op.inputs[0] in other.inputs for other in model.ops)
            if isinstance(rank, Rank) and readers == 1:
                ops[op.inputs[0] - 1], ops[number] = _pruned_pair(rank, op, accepts_nan=model.accepts_nan)
    return dataclasses.replace(model, ops=tuple(ops))


def _pruned_pair(rank: Rank, op: TreeEnsemble, *, accepts_nan: bool) -> tuple[Rank, TreeEnsemble]:
    live = _reachable(op, *rank.ends(accepts_nan=accepts_nan))
    trees = _rebuilt(op, live, subtrees(op, live).forward)
    trees = _without_constant_trees(trees)
    return _compacted(rank, trees)


def _reachable(op: TreeEnsemble, low: Int32Array, high: Int32Array) -> IntArray:
    """The node that stands in for each node: itself, or the only child that rows reach.

    It is -1 for nodes that no row reaches. `low` and `high` are the ranks that each column can have.
    """
    substitute = np.full(op.n_nodes, -1, np.int64)
    step = max(_BOXES // (len(low) * max(op.n_nodes // op.n_trees, 1)), 1)
    for first in range(0, op.n_trees, step):
        roots = op.roots[first : first + step].astype(np.int64)
        shape = (len(roots), len(low))
        _reach(op, roots, np.broadcast_to(low, shape), np.broadcast_to(high, shape), substitute)
    follow(substitute)
    return substitute


def _reach(op: TreeEnsemble, node: IntArray, low: Int32Array, high: Int32Array, substitute: IntArray) -> None:
    """Walk down level by level with the ranks that lead to each node."""
    while node.size:
        column = op.split.take(node)
        inner, leaves = np.flatnonzero(column >= 0), node[column < 0]
        substitute[leaves] = leaves
        node, column, low, high = (
            node.take(inner),
            column.take(inner),
            low.take(inner, axis=0),
            high.take(inner, axis=0),
        )
        at = np.arange(len(node)) * low.shape[1] + column
        threshold = op.threshold.take(node).astype(np.int32)
        lowest, highest = low.take(at), high.take(at)
        goes_left, goes_right = lowest <= threshold, highest > threshold
        left, right = op.left.take(node).astype(np.int64), op.right.take(node).astype(np.int64)
        substitute[node] = np.where(goes_left & goes_right, node, np.where(goes_left, left, right))
        upper, lower = high.copy(), low.copy()
        upper.reshape(-1)[at] = np.minimum(highest, threshold)
        lower.reshape(-1)[at] = np.maximum(lowest, threshold + 1)
        onward_left, onward_right = np.flatnonzero(goes_left), np.flatnonzero(goes_right)
        node = np.concatenate([left.take(onward_left), right.take(onward_right)])
        low = np.concatenate([low.take(onward_left, axis=0), lower.take(onward_right, axis=0)])
        high = np.concatenate([upper.take(onward_left, axis=0), high.take(onward_right, axis=0)])


def _laid_out(roots: IntArray, left: IntArray, right: IntArray) -> Preorder:
    return preorder(np.asarray(roots, np.int64), np.asarray(left, np.int64), np.asarray(right, np.int64))


def _rebuilt(op: TreeEnsemble, substitute: IntArray, forward: IntArray) -> TreeEnsemble:
    """The ensemble with only those nodes that stay, in preorder; equal leaf values are kept once."""
    inner = op.split >= 0
    left = np.where(inner, forward[np.maximum(op.left, 0)], -1)
    right = np.where(inner, forward[np.maximum(op.right, 0)], -1)
    layout = _laid_out(forward[op.roots], left, right)
    node = layout.order
    leaf = layout.left < 0
    values = op.leaf_value[op.leaf[node[leaf]]]
    first, kind = distinct_rows(values)
    leaves = np.full(len(node), -1, np.int32)
    leaves[leaf] = kind
    threshold = np.where(leaf, 0.0, op.threshold.take(node))
    return with_nodes(op, layout, node, threshold=threshold, leaf=leaves, leaf_value=values[first])


def _without_constant_trees(op: TreeEnsemble) -> TreeEnsemble:
    """Without the constant trees that come first, added to `base`, and without those that add nothing."""
    if op.aggregate is not Aggregate.SUM or op.leaf_value.shape[1] != 1:
        return op
    value = np.where(op.split[op.roots] < 0, op.leaf_value[np.maximum(op.leaf[op.roots], 0), 0], np.nan)
    dtype = np.float32 if op.sum_precision is Precision.FLOAT32 else np.float64
    base = op.base.astype(dtype)
    keep = np.ones(op.n_trees, np.bool_)
    if not op.base_last:
        for output in range(op.width):
            for tree in np.flatnonzero(op.tree_output == output):
                if np.isnan(value[tree]):
                    break
                base[output] += dtype(value[tree])
                keep[tree] = False
    # x + 0.0 is x, except that -0.0 + 0.0 is +0.0; a sum is -0.0 only if it starts so
    minus_zero = np.zeros(op.width, np.bool_) if op.base_last else (base == 0) & np.signbit(base)
    keep &= ~((value == 0) & ~minus_zero[op.tree_output])
    if not keep.any():
        keep[-1] = True  # an ensemble has a tree
        if not op.base_last:
            return op
    if keep.all():
        return op
    layout = _laid_out(op.roots[keep].astype(np.int64), op.left.astype(np.int64), op.right.astype(np.int64))
    return with_nodes(op, layout, layout.order, tree_output=op.tree_output[keep], base=base.astype(np.float64))


def _compacted(rank: Rank, op: TreeEnsemble) -> tuple[Rank, TreeEnsemble]:
    """Columns that no split reads and edges that no split compares with dropped."""
    used = np.unique(op.split[op.split >= 0])
    if not used.size:
        column = dataclasses.replace(rank.columns[0], edges=np.zeros(0), missing=0)
        return Rank(rank.inputs, (column,)), dataclasses.replace(op, columns=op.columns[:1])
    nodes = [np.flatnonzero(op.split == number) for number in used]
    columns, thresholds = compact(
        tuple(rank.columns[number] for number in used), [op.threshold[at].astype(np.int64) for at in nodes]
    )
    threshold, split = op.threshold.copy(), op.split.copy()
    for number, (at, new) in enumerate(zip(nodes, thresholds, strict=True)):
        threshold[at] = new
        split[at] = number
    return Rank(rank.inputs, columns), dataclasses.replace(
        op, split=split, threshold=threshold, columns=op.columns[: len(columns)]
    )
