"""How far a sum of trees jumps where an inexact step in front of a split may send a row to the other side.

Two evaluations of a model that err by a unit in the last place part at a split of an inexact column and end in two
leaves below it. So a tree differs by the range of the leaves below one of these splits at most, and a sum by the sum of
these.
"""

from __future__ import annotations

import numpy as np

from st_codegen.ir import BoolArray, ModelIR, Operation, Select, TreeEnsemble
from st_codegen.ir.base import Elementwise
from st_codegen.ir.trees import added_up


def inexact_columns(model: ModelIR) -> list[BoolArray]:
    """For every value of a model (0: the inputs), which of its columns may differ from the library's."""
    values = [np.zeros(len(model.features), np.bool_)]
    for op in model.ops:
        values.append(_after(op, [values[number] for number in op.inputs]))
    return values


def _after(op: Operation, given: list[BoolArray]) -> BoolArray:
    if not op.exact:
        return np.ones(op.width, np.bool_)
    if isinstance(op, Select):
        return np.asarray(np.concatenate(given)[op.columns], np.bool_)
    if isinstance(op, Elementwise):
        return np.asarray(np.any(given, axis=0), np.bool_)
    return np.full(op.width, np.any(np.concatenate(given)), np.bool_)


def unsure_columns(op: TreeEnsemble, values: list[BoolArray]) -> list[int]:
    """The columns of an ensemble that it splits behind an inexact step: numbers of `op.columns`.

    `values`: the `inexact_columns` of the model, once for all of its ensembles.
    """
    given = np.concatenate([values[number] for number in op.inputs])
    return [number for number in np.unique(op.split[op.split >= 0]).tolist() if given[op.columns[number].column]]


def largest_jump(model: ModelIR) -> float:
    """The largest change of a sum of trees by rounding in front of its splits; 0.0 where it cannot change so."""
    values = inexact_columns(model)
    jumps = [_jump(op, unsure_columns(op, values)) for op in model.ops if isinstance(op, TreeEnsemble)]
    return max(jumps, default=0.0)


def _jump(op: TreeEnsemble, columns: list[int]) -> float:
    if not columns:
        return 0.0
    if op.linear is not None:
        return float("inf")
    leaf = op.split < 0
    low = np.full((op.n_nodes, op.leaf_value.shape[1]), np.inf)
    low[leaf] = op.leaf_value[op.leaf[leaf]]
    high = np.where(leaf[:, None], low, -np.inf)
    for node in np.flatnonzero(~leaf)[::-1].tolist():  # children come after their parents
        for child in (op.left[node], op.right[node]):
            low[node], high[node] = np.minimum(low[node], low[child]), np.maximum(high[node], high[child])
    unsure = np.isin(op.split, columns)
    spread = np.where(unsure[:, None], high - low, 0.0)
    total = added_up(op, np.maximum.reduceat(spread, op.roots, axis=0))
    return float(np.max(total)) / abs(op.divisor)
