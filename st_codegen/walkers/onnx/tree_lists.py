"""TreeEnsembleRegressor, TreeEnsembleClassifier (ai.onnx.ml 1 to 4): nodes and weights as lists joined by identifiers.

Rules of onnxruntime (core/providers/cpu/ml/tree_ensemble_common.h): the root of a tree is its first node in the list;
weights of nodes that are not leaves are ignored; thresholds, leaves and base values have the type of the input. Where
onnxruntime and the ONNX standard disagree, the model is refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import Aggregate, BoolArray, FloatArray, IntArray
from st_codegen.walkers.onnx.file import GraphNode, checked_length
from st_codegen.walkers.onnx.forest import MAX_ID, Forest, Mode, NumberType, check_range, read_aggregate, target_count

_MODES_BY_NAME = {f"BRANCH_{mode.name}": mode for mode in list(Mode)[:6]} | {"LEAF": Mode.LEAF}


def read_regressor(attributes: GraphNode, number_type: NumberType) -> Forest:
    """TreeEnsembleRegressor (ai.onnx.ml 1 to 4) for inputs of a type.

    Raises InputError for damaged attributes, UnsupportedModelError for what has no exact counterpart.
    """
    aggregate, average = read_aggregate(attributes.text("aggregate_function", "SUM"))
    n_targets = target_count(attributes)
    base = numbers(attributes, "base_values", number_type, 0, n_targets)
    forest = read_lists(attributes, number_type, "target", n_targets)
    return replace(forest, base=base if len(base) else forest.base, aggregate=aggregate, average=average)


def read_lists(attributes: GraphNode, number_type: NumberType, what: str, n_targets: int) -> Forest:
    """The nodes, and the weights of leaves for each "target" or "class", which are added; errors as above."""
    tree_id = attributes.integers("nodes_treeids")
    total = len(tree_id)
    if total == 0:
        raise InputError("nodes_treeids is empty: there are no trees")
    node_id, feature, true, false = (
        attributes.integers(f"nodes_{name}ids", total) for name in ("node", "feature", "truenode", "falsenode")
    )
    mode = _modes(attributes.texts("nodes_modes", total))
    split = mode != Mode.LEAF
    tree, run_ids = _runs(tree_id)
    key = _NodeIndex(tree, tree_id, node_id)
    leaf = np.full(total, -1, np.int64)
    leaf[~split] = np.arange(total - int(split.sum()))
    weights = _weights(attributes, what, key, run_ids, leaf, n_targets, number_type)
    missing = attributes.integers("nodes_missing_value_tracks_true", 0, total)
    return Forest(
        roots=np.flatnonzero(np.diff(tree, prepend=-1)),  # the first node of each tree
        tree_id=tree_id,
        node_id=node_id,
        mode=mode,
        feature=np.where(split, feature, 0),
        value=numbers(attributes, "nodes_values", number_type, total),
        true=key.children("nodes_truenodeids", true, split),
        false=key.children("nodes_falsenodeids", false, split),
        missing_true=np.resize(missing, total) == 1,  # of an empty list zeros
        leaf=leaf,
        member_start=np.zeros(total + 1, np.int64),
        member=np.zeros(0),
        n_leaves=int(np.sum(~split)),
        weight_leaf=weights[0],
        weight_target=weights[1],
        weight=weights[2],
        n_targets=n_targets,
        base=np.zeros(n_targets),
        aggregate=Aggregate.SUM,
        average=False,
        number_type=number_type,
    )


def _modes(names: list[str]) -> NDArray[np.int8]:
    unknown = sorted(set(names) - set(_MODES_BY_NAME))
    if unknown:
        raise UnsupportedModelError(f"nodes_modes: {unknown[0]!r} is not known; known are {', '.join(_MODES_BY_NAME)}")
    return np.array([_MODES_BY_NAME[name] for name in names], np.int8)


def numbers(attributes: GraphNode, name: str, number_type: NumberType, *counts: int) -> FloatArray:
    """A list of floats, or the tensor that replaces it, which must have the type of the input; of one of the counts."""
    tensor = attributes.tensor(f"{name}_as_tensor")
    if tensor is None:
        return attributes.floats(name, *counts)
    listed = attributes.floats(name)
    if len(listed):
        raise InputError(f"both {name} and {name}_as_tensor are given; keep one of them")
    if tensor.dtype != number_type or tensor.ndim != 1:
        raise UnsupportedModelError(
            f"{name}_as_tensor is {tensor.dtype} of {counted(tensor.ndim, 'dimension')} for {np.dtype(number_type)} "
            "inputs; onnxruntime takes a vector of the type of the input only"
        )
    checked_length(name, len(tensor), *counts)
    return tensor.astype(np.float64)


def _runs(tree_id: IntArray) -> tuple[IntArray, IntArray]:
    """The number of each node's tree, counted from 0 in the order of the list, and the identifier of each tree."""
    _check_ids("nodes_treeids", tree_id)
    first = np.append(True, tree_id[1:] != tree_id[:-1])
    ids, count = np.unique(tree_id[first], return_counts=True)
    if np.any(count > 1):
        raise InputError(
            f"nodes_treeids: the nodes of tree {ids[count > 1][0]} do not stand together, which gives it several "
            "roots; the model file is damaged"
        )
    return np.cumsum(first) - 1, tree_id[first]


def _check_ids(name: str, ids: IntArray) -> None:
    bad = np.flatnonzero((ids < 0) | (ids > MAX_ID))
    if bad.size:
        raise InputError(f"{name}[{bad[0]}] is {ids[bad[0]]}, expected 0 to {MAX_ID}; the model file is damaged")


class _NodeIndex:
    """Finds nodes by the number of their tree and their identifier."""

    def __init__(self, tree: IntArray, tree_id: IntArray, node_id: IntArray) -> None:
        _check_ids("nodes_nodeids", node_id)
        self.tree, self.tree_id, self.node_id = tree, tree_id, node_id
        key = (tree << 32) | node_id
        self.order = np.argsort(key, kind="stable")
        self.key = key[self.order]
        twice = np.flatnonzero(self.key[1:] == self.key[:-1])
        if twice.size:
            node = self.order[twice[0]]
            raise InputError(f"tree {tree_id[node]} has two nodes {node_id[node]}; the model file is damaged")

    def find(self, tree: IntArray, node_id: IntArray) -> IntArray:
        """Positions of nodes, -1 where there is none."""
        wanted = (tree << 32) | node_id
        position = np.minimum(np.searchsorted(self.key, wanted), len(self.key) - 1)
        known = (self.key[position] == wanted) & (node_id >= 0) & (node_id <= MAX_ID)
        return np.where(known, self.order[position], -1)

    def children(self, name: str, node_id: IntArray, split: BoolArray) -> IntArray:
        """Positions of the children of splits, -1 for leaves."""
        found = np.full(len(node_id), -1, np.int64)
        inner = np.flatnonzero(split)
        found[inner] = self.find(self.tree[inner], node_id[inner])
        lost = inner[found[inner] < 0]
        if lost.size:
            node = lost[0]
            raise InputError(
                f"tree {self.tree_id[node]}, node {self.node_id[node]}: {name} names node {node_id[node]}, "
                "which its tree does not have; the model file is damaged"
            )
        return found


def _weights(
    attributes: GraphNode,
    what: str,
    index: _NodeIndex,
    run_ids: IntArray,
    leaf: IntArray,
    n_targets: int,
    number_type: NumberType,
) -> tuple[IntArray, IntArray, FloatArray]:
    """(leaf row, target, weight) of all weights, sorted by leaf row."""
    tree_id, node_id = attributes.integers(f"{what}_treeids"), attributes.integers(f"{what}_nodeids")
    target, weight = attributes.integers(f"{what}_ids"), numbers(attributes, f"{what}_weights", number_type)
    if not len(tree_id) == len(node_id) == len(target) == len(weight):
        raise InputError(
            f"{what}_treeids, {what}_nodeids, {what}_ids and {what}_weights have {len(tree_id)}, {len(node_id)}, "
            f"{len(target)} and {len(weight)} entries; the model file is damaged"
        )
    check_range(f"{what}_ids", target, n_targets)
    by_id = np.argsort(run_ids)
    run = np.minimum(np.searchsorted(run_ids[by_id], tree_id), len(run_ids) - 1)
    node = np.where(run_ids[by_id][run] == tree_id, index.find(by_id[run], node_id), -1)
    lost = np.flatnonzero(node < 0)
    if lost.size:
        raise InputError(
            f"{what}_nodeids[{lost[0]}] names node {node_id[lost[0]]} of tree {tree_id[lost[0]]}, which does not "
            "exist; the model file is damaged"
        )
    at_leaf = np.flatnonzero(leaf[node] >= 0)
    order = at_leaf[np.argsort(leaf[node[at_leaf]], kind="stable")]
    row, target, weight = leaf[node[order]], target[order], weight[order]
    _check_weights(row, target, n_targets, index, np.flatnonzero(leaf >= 0))
    return row, target, weight


def _check_weights(row: IntArray, target: IntArray, n_targets: int, index: _NodeIndex, leaves: IntArray) -> None:
    """Each leaf has a weight, and none has two for a target: onnxruntime departs from the standard there."""
    without = np.flatnonzero(np.bincount(row, minlength=len(leaves)) == 0)
    key, count = np.unique(row * n_targets + target, return_counts=True)
    twice = key[count > 1] // n_targets
    for bad, problem in ((without, "no weight"), (twice, "two weights for one target")):
        if bad.size:
            node = leaves[bad[0]]
            raise UnsupportedModelError(
                f"tree {index.tree_id[node]}, leaf {index.node_id[node]} has {problem}: onnxruntime and the ONNX "
                "standard disagree on what that means; export the model again with one weight for each leaf and target"
            )
