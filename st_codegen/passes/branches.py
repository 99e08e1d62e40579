"""A small tree as nested IFs: the inputs themselves are compared, so nothing has to be searched and no node is read.

The thresholds are the edges of the ranks (`ranks`), so scalers and the rounding of inputs to float32 cost nothing, and
what no row reaches is gone (`prune`). Each comparison is code of its own: this is for single trees whose code is small.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from st_codegen.ir import BranchedTree, Comparison, ModelIR, NanRule, Rank, TreeColumn, TreeEnsemble, depth_of
from st_codegen.passes.prune import rebuilt
from st_codegen.passes.unread import without_unread

#: Leaves of a tree, and splits on a path: more is neither fast nor read by anybody.
_LEAVES, _DEEPEST = 512, 16
#: Magnitudes of thresholds, which stand in the text: portable compilers read no others.
_SMALLEST, _LARGEST = 1e-37, 1e37


def as_branches(model: ModelIR, may_grow: float = 1.0) -> ModelIR | None:
    """The model, whose tree is on ranks, as nested IFs; None where it has several trees or a large one.

    `may_grow`: by which factor the leaves may exceed the limit.
    """
    ops = list(model.ops)
    ensembles = [number for number, op in enumerate(ops) if isinstance(op, TreeEnsemble)]
    if len(ensembles) != 1:
        return None
    op = ops[ensembles[0]]
    assert isinstance(op, TreeEnsemble)
    rank = ops[op.inputs[0] - 1]
    if op.n_trees > 1 or op.leaf_value.shape[1] != op.width:
        return None
    if np.sum(op.split < 0) > may_grow * _LEAVES or depth_of(op) > _DEEPEST:
        return None
    branched = _branched(rank, op) if isinstance(rank, Rank) else None
    if branched is None:
        return None
    ops[ensembles[0]] = branched
    return without_unread(replace(model, ops=tuple(ops)), answers=True)


def _branched(rank: Rank, op: TreeEnsemble) -> TreeEnsemble | None:
    """The tree with the edges of the ranks as thresholds."""
    inner = np.flatnonzero(op.split >= 0)
    columns = [rank.columns[number] for number in op.split[inner]]
    at = op.threshold[inner].astype(np.int64)
    highest = np.array([column.highest for column in columns], np.int64)
    descending = np.array([column.descending for column in columns], np.bool_)
    missing_left = np.array([column.missing for column in columns], np.int64) <= at
    # beyond the edges a split tells missing values from numbers: as +infinity does, with the numbers on the left
    only_missing = (at < 0) | (at >= highest)
    swapped = np.where(only_missing, at < 0, descending)
    edge = np.where(descending, highest - 1 - at, at)
    found = [
        np.inf if outside else column.edges[number]
        for column, number, outside in zip(columns, edge, only_missing, strict=True)
    ]
    # the number below zero is the threshold of `x < 0.0`
    finite = np.abs([value for value in found if np.isfinite(value) and value not in (0.0, np.nextafter(0.0, -1.0))])
    if np.any((finite < _SMALLEST) | (finite > _LARGEST)):
        return None
    changed = {name: getattr(op, name).copy() for name in ("split", "threshold", "left", "right", "missing_left")}
    changed["split"][inner] = [column.column for column in columns]
    changed["threshold"][inner] = found
    changed["left"][inner] = np.where(swapped, op.right[inner], op.left[inner])
    changed["right"][inner] = np.where(swapped, op.left[inner], op.right[inner])
    changed["missing_left"][inner] = missing_left != swapped
    features = max((column.column for column in rank.columns), default=0) + 1
    return _without_sure(
        BranchedTree(
            **vars(op)
            | changed
            | {
                "inputs": rank.inputs,
                "columns": tuple(TreeColumn(number, NanRule.MISSING) for number in range(features)),
                "comparison": Comparison.LESS_OR_EQUAL,
            }
        )
    )


def _without_sure(op: TreeEnsemble) -> TreeEnsemble:
    """The tree without splits of missing values from numbers where no missing value comes: all rows go left there.

    The ranks of an input count missing values below or above its numbers, each in a column of its own, so that no split
    of one column tells of those of the other before (`prune`).
    """
    may_miss = np.ones((op.n_nodes, len(op.columns)), np.bool_)
    inner = np.flatnonzero(op.split >= 0)
    for node in inner:  # parents come first
        column = op.split[node]
        for child, takes_missing in (
            (op.left[node], op.missing_left[node]),
            (op.right[node], not op.missing_left[node]),
        ):
            may_miss[child] = may_miss[node]
            may_miss[child, column] &= takes_missing
    forward = np.arange(op.n_nodes)
    for node in inner[::-1]:
        if np.isposinf(op.threshold[node]) and not may_miss[node, op.split[node]]:
            forward[node] = forward[op.left[node]]
    return rebuilt(op, forward)
