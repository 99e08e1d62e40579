"""Trees without what makes no difference: branches no input reaches, equal subtrees, constant trees.

Works on ranked ensembles (`ranks`). A row still meets the same leaf values in the same order, so every sum is the
library's to the bit. Two things change the sum itself, and both are exact: constant trees at the very beginning are
added to `base` (as the library does first), and trees that only ever add +0.0 to a sum that cannot be -0.0 are dropped.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from st_codegen.ir import Aggregate, IntArray, ModelIR, Precision, Rank, TreeEnsemble
from st_codegen.ir.preorder import preorder
from st_codegen.ir.subtrees import distinct_rows, subtrees
from st_codegen.ir.trees import with_nodes
from st_codegen.passes.boxes import Boxes
from st_codegen.passes.ranks import compact


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
    reached = Boxes.of(op, *rank.ends(accepts_nan=accepts_nan)).cut()
    trees = rebuilt(reached, subtrees(reached, collapse=True).forward)
    return _compacted(rank, _without_constant_trees(trees))


def rebuilt(op: TreeEnsemble, forward: IntArray) -> TreeEnsemble:
    """The ensemble with only those nodes that stay, in preorder; equal leaf values are kept once."""
    inner = op.split >= 0
    layout = preorder(forward[op.roots], np.where(inner, forward[op.left], -1), np.where(inner, forward[op.right], -1))
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
    layout = preorder(op.roots[keep], op.left, op.right)
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
