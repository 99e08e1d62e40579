"""Rank-quantised trees: each input is searched once among its sorted thresholds, and nodes compare integers.

The thresholds are the exact numbers of the input at which splits change over (`monotone`), so scalers and the rounding
of inputs to float32 cost nothing at run time. Missing values become ranks below or above all others, in a column of
their own for splits that send them left and for those that send them right.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from st_codegen import ir
from st_codegen.ir.arrays import BoolArray, FloatArray, Int32Array, IntArray
from st_codegen.passes.monotone import Chain, Column, columns_of, domain_of, goes_left, split_edges
from st_codegen.passes.unread import without_unread


def ranked(model: ir.ModelIR) -> ir.ModelIR | None:
    """The model with each ensemble on ranks, and without operations that nobody reads any more.

    None where some ensemble has categories, linear leaves, shared nodes or inputs that are not monotone in one feature.
    """
    values = columns_of(model)
    ops: list[ir.Operation] = []
    moved = [0]
    found = False
    for op in model.ops:
        inputs = tuple(moved[number] for number in op.inputs)
        if isinstance(op, ir.TreeEnsemble):
            given = [column for number in op.inputs for column in values[number]]
            pair = _ranked_ensemble(model, op, given)
            if pair is None:
                return None
            rank, trees = pair
            ops += [rank, dataclasses.replace(trees, inputs=(len(ops) + 1,))]
            found = True
        else:
            ops.append(dataclasses.replace(op, inputs=inputs))  # type: ignore[type-var]
        moved.append(len(ops))
    if not found:
        return None
    return without_unread(dataclasses.replace(model, ops=tuple(ops)), answers=True)


@dataclass(frozen=True)
class _RankedSplits:
    """The splits of one column as comparisons of ranks: `rank <= threshold` goes left, missing values aside.

    `nodes` are their numbers, `edges` what ranks are counted among, `descending` whether they count from above.
    """

    nodes: IntArray
    threshold: IntArray
    edges: FloatArray
    descending: bool
    missing_left: BoolArray


def _ranked_ensemble(
    model: ir.ModelIR, op: ir.TreeEnsemble, given: list[Column]
) -> tuple[ir.Rank, ir.TreeEnsemble] | None:
    if op.linear is not None or op.has_categories or not op.is_forest:
        return None
    columns: list[ir.RankColumn] = []
    split = np.full(op.n_nodes, -1, np.int32)
    threshold = np.zeros(op.n_nodes)
    for number, column in enumerate(op.columns):
        chain = given[column.column]
        nodes = np.flatnonzero(op.split == number)
        if not isinstance(chain, Chain) or column.missing_interval is not None:
            if len(nodes):
                return None
            continue
        splits = _splits(model, op, number, chain, nodes)
        for left in (True, False):
            chosen = splits.missing_left == left
            if not chosen.any():
                continue
            highest = len(splits.edges)
            missing = 0 if not model.accepts_nan else -1 if left else highest + 1
            split[splits.nodes[chosen]] = len(columns)
            threshold[splits.nodes[chosen]] = splits.threshold[chosen]
            columns.append(ir.RankColumn(chain.feature, splits.edges, missing, splits.descending))
    if not columns:
        columns = [ir.RankColumn(0, np.zeros(0))]  # every tree is a leaf
    trees = dataclasses.replace(
        op,
        columns=tuple(ir.TreeColumn(number) for number in range(len(columns))),
        split=split,
        threshold=threshold,
        missing_left=np.zeros(op.n_nodes, np.bool_),
        comparison=ir.Comparison.LESS_OR_EQUAL,
        input_precision=ir.Precision.FLOAT64,
    )
    return ir.Rank((0,), tuple(columns)), trees


def _splits(model: ir.ModelIR, op: ir.TreeEnsemble, number: int, chain: Chain, nodes: IntArray) -> _RankedSplits:
    """The splits of column `number` in ranks."""
    found = split_edges(op, number, chain, domain_of(model, chain.feature))
    changes = ~np.isnan(found.edge)
    edges = np.unique(found.edge[changes])
    # a chain falls where the numbers below the changeover go right
    descending = bool(np.any(changes & ~found.left_below))
    below = np.searchsorted(edges, found.edge)
    rank = len(edges) - below - 1 if descending else below
    # a split that never changes sends all numbers left or right
    rank = np.where(changes, rank, np.where(found.left_below, len(edges), -1))
    at = np.searchsorted(found.thresholds, op.threshold[nodes])
    missing_left = op.missing_left[nodes]
    if op.columns[number].nan is ir.NanRule.ZERO:
        threshold = op.threshold[nodes]
        missing_left = threshold > 0 if op.comparison is ir.Comparison.LESS else threshold >= 0
    filled = chain.value(np.array([np.nan]))
    if not np.isnan(filled[0]):  # something in front of the trees replaces missing values
        missing_left = goes_left(op, filled, op.threshold[nodes])
    if not model.accepts_nan:
        missing_left = np.ones(len(nodes), np.bool_)
    return _RankedSplits(nodes, rank[at].astype(np.int64), edges, descending, missing_left)


def compact(
    columns: tuple[ir.RankColumn, ...], used: list[IntArray]
) -> tuple[tuple[ir.RankColumn, ...], list[Int32Array]]:
    """Columns with only those edges that are compared with, and the new thresholds.

    `used` are the thresholds of each column's splits. Columns that share a search go on sharing it.
    """
    shared: dict[object, list[IntArray]] = {}
    keys = [(column.search, column.descending) for column in columns]
    for key, column, thresholds in zip(keys, columns, used, strict=True):
        shared.setdefault(key, []).append(thresholds[(thresholds >= 0) & (thresholds < column.highest)])
    new_columns, new_thresholds = [], []
    for key, column, thresholds in zip(keys, columns, used, strict=True):
        is_used = np.zeros(column.highest + 1, np.bool_)
        is_used[np.concatenate(shared[key])] = True
        kept = np.flatnonzero(is_used)
        before: IntArray = np.cumsum(is_used) - is_used
        edge = column.highest - 1 - kept[::-1] if column.descending else kept
        missing = len(kept) + 1 if column.missing > column.highest else column.missing
        moved = before[np.clip(thresholds, 0, column.highest)]
        moved = np.where(thresholds >= column.highest, len(kept), np.where(thresholds < 0, -1, moved))
        new_columns.append(dataclasses.replace(column, edges=column.edges[edge], missing=missing))
        new_thresholds.append(moved.astype(np.int32))
    return tuple(new_columns), new_thresholds
