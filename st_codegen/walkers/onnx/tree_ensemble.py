"""TreeEnsemble (ai.onnx.ml 5): nodes and leaves in separate arrays that point into each other.

Rules of onnxruntime (core/providers/cpu/ml/tree_ensemble_attribute.h, TreeEnsembleAttributesV5): a root whose two edges
go to one leaf is that leaf; tests of membership are unrolled or cut to integers, see `_member_sets`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, BoolArray, FloatArray, IntArray
from st_codegen.walkers.onnx.file import GraphNode, checked_length
from st_codegen.walkers.onnx.forest import MAX_ID, Forest, Mode, NumberType, check_range, read_aggregate, target_count


def read_ensemble(attributes: GraphNode, number_type: NumberType) -> Forest:
    """TreeEnsemble (ai.onnx.ml 5) for inputs of a type. Leaves become nodes of their own, one for each edge to them.

    Raises InputError for damaged attributes, UnsupportedModelError for what has no exact counterpart.
    """
    aggregate, average = read_aggregate(attributes.integer("aggregate_function", 1))
    n_targets = target_count(attributes)
    feature = attributes.integers("nodes_featureids")
    total = len(feature)
    target = attributes.integers("leaf_targetids")
    edges = _Edges(attributes, total, len(target))
    check_range("leaf_targetids", target, n_targets)
    mode = _required_tensor(attributes, "nodes_modes", np.dtype(np.uint8), total)
    if np.any(mode > Mode.MEMBER):
        raise UnsupportedModelError(f"nodes_modes: {mode.max()} is not a known mode (0 to {int(Mode.MEMBER)})")
    value = _required_tensor(attributes, "nodes_splits", np.dtype(number_type), total)
    weight = _required_tensor(attributes, "leaf_weights", np.dtype(number_type), len(target))
    missing = np.resize(attributes.integers("nodes_missing_value_tracks_true", 0, total), total)  # of none zeros
    member_start, member, cuts = _member_sets(attributes, mode, number_type)
    extra = len(edges.leaf)
    mode = np.where(cuts, Mode.MEMBER_INTEGER, mode)
    mode[edges.lone] = Mode.LEAF
    leaf = np.full(total, -1)
    leaf[edges.lone] = edges.lone_leaf
    return Forest(
        roots=edges.roots,
        tree_id=np.full(total + extra, -1),
        node_id=np.arange(total + extra),
        mode=np.concatenate([mode, np.full(extra, Mode.LEAF)]).astype(np.int8),
        feature=np.concatenate([feature, np.zeros(extra, np.int64)]),
        value=np.concatenate([value.astype(np.float64), np.zeros(extra)]),
        true=np.concatenate([edges.true, np.full(extra, -1)]),
        false=np.concatenate([edges.false, np.full(extra, -1)]),
        missing_true=np.concatenate([missing == 1, np.zeros(extra, np.bool_)]),
        leaf=np.concatenate([leaf, edges.leaf]),
        member_start=np.concatenate([member_start, np.full(extra, len(member))]),
        member=member,
        n_leaves=len(target),
        weight_leaf=np.arange(len(target)),
        weight_target=target,
        weight=weight.astype(np.float64),
        n_targets=n_targets,
        base=np.zeros(n_targets),
        aggregate=aggregate,
        average=average,
        number_type=number_type,
    )


class _Edges:
    """Children of the nodes of a TreeEnsemble; leaves are numbered after the nodes, one for each edge to them.

    A root whose two edges go to one leaf is that leaf (`lone`: such nodes, `lone_leaf`: their leaves).
    """

    def __init__(self, attributes: GraphNode, total: int, n_leaves: int) -> None:
        self.roots = attributes.integers("tree_roots")
        if total == 0 or n_leaves == 0 or len(self.roots) == 0:
            raise InputError("nodes_featureids, leaf_targetids or tree_roots is empty: there are no trees")
        check_range("tree_roots", self.roots, total)
        true, true_is_leaf = self._side(attributes, "true", total, n_leaves)
        false, false_is_leaf = self._side(attributes, "false", total, n_leaves)
        root = np.isin(np.arange(total), self.roots)
        self.lone = np.flatnonzero(root & true_is_leaf & false_is_leaf & (true == false))
        self.lone_leaf = true[self.lone]
        true_is_leaf[self.lone] = false_is_leaf[self.lone] = False
        true[self.lone] = false[self.lone] = -1
        self.leaf = np.concatenate([true[true_is_leaf], false[false_is_leaf]])
        leaf_node = total + np.arange(len(self.leaf))
        n_true = int(true_is_leaf.sum())
        true[true_is_leaf] = leaf_node[:n_true]
        false[false_is_leaf] = leaf_node[n_true:]
        self.true, self.false = true, false

    @staticmethod
    def _side(attributes: GraphNode, side: str, total: int, n_leaves: int) -> tuple[IntArray, BoolArray]:
        """(child, whether it is a leaf) of each node on one side."""
        name, flag = f"nodes_{side}nodeids", f"nodes_{side}leafs"
        child, is_leaf = attributes.integers(name, total), attributes.integers(flag, total) != 0
        check_range(name, np.where(is_leaf, 0, child), total)
        check_range(name, np.where(is_leaf, child, 0), n_leaves)
        return child, is_leaf


def _required_tensor(attributes: GraphNode, name: str, dtype: np.dtype[Any], total: int) -> AnyArray:
    tensor = attributes.tensor(name)
    if tensor is None:
        raise InputError(f"{name} is missing; the model file is damaged")
    if tensor.dtype != dtype:
        raise UnsupportedModelError(f"{name} is {tensor.dtype}, expected {dtype}, the type that goes with the input")
    checked_length(name, tensor.size, total)
    return np.ravel(tensor)


def _member_sets(
    attributes: GraphNode, mode: AnyArray, number_type: NumberType
) -> tuple[IntArray, FloatArray, BoolArray]:
    """(start, values, whether onnxruntime cuts x to an integer first) of the sets of MEMBER nodes.

    onnxruntime compares x with each value of a set of at most 30 numbers from 0 to 30; for any other set it looks the
    integer part of x up (transformInputOneTree, and the sets of categories in tree_ensemble_common.h).
    """
    nodes = np.flatnonzero(mode == Mode.MEMBER)
    tensor = attributes.tensor("membership_values")
    if tensor is not None and tensor.dtype != number_type:
        raise UnsupportedModelError(f"membership_values is {tensor.dtype} for {np.dtype(number_type)} inputs")
    values = np.zeros(0) if tensor is None else np.ravel(tensor).astype(np.float64)
    ends = np.flatnonzero(np.isnan(values))
    if len(values) and not np.isnan(values[-1]):
        ends = np.append(ends, len(values))
    if len(ends) != len(nodes):
        raise InputError(
            f"membership_values has {counted(len(ends), 'set')} for {counted(len(nodes), 'MEMBER node')}; "
            "separate them by NaN"
        )
    starts = np.concatenate([[0], ends[:-1] + 1]).astype(np.int64) if len(ends) else ends
    cuts = np.zeros(len(mode), np.bool_)
    for node, start, end in zip(nodes, starts, ends, strict=True):
        cuts[node] = _is_cut(f"node {node}", values[start:end])
    member_start = np.zeros(len(mode) + 1, np.int64)
    member_start[nodes + 1] = ends - starts
    return np.cumsum(member_start), values[~np.isnan(values)], cuts


def _is_cut(where: str, members: FloatArray) -> bool:
    if len(members) == 0:
        raise InputError(f"{where}: an empty set in membership_values; the model file is damaged")
    if len(members) <= 30 and np.all((members >= 0) & (members <= 30)):
        return False
    if np.any(members != np.trunc(members)) or np.any(np.abs(members) > MAX_ID):
        raise UnsupportedModelError(
            f"{where}: membership_values of a set of more than 30 values, or beyond 0 to 30, must be whole numbers of "
            "32 bits"
        )
    return True
