"""Tree ensembles that are damaged, or that onnxruntime reads in another way than the ONNX standard."""

from __future__ import annotations

import numpy as np
import onnx
import pytest

from st_codegen.errors import InputError, UnsupportedModelError
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, Branch, assert_equal_bits, leaf

REFUSALS = {
    "post_transform LOGISTIC of one target": {"post_transform": "LOGISTIC"},
    "aggregate_function MEDIAN: known are": {"aggregate_function": "MEDIAN"},
    "n_targets is 0": {"n_targets": 0},
    r"nodes_values has 2 entries, expected 3": {"nodes_values": [0.0, 0.0]},
    r"nodes_modes has 1 entry, expected 3": {"nodes_modes": ["LEAF"]},
    "nodes_modes: 'BRANCH_XX' is not known": {"nodes_modes": ["BRANCH_XX", "LEAF", "LEAF"]},
    "nodes_missing_value_tracks_true has 1 entry": {"nodes_missing_value_tracks_true": [1]},
    "tree 0, node 0: the threshold is nan": {"nodes_values": [np.nan, 0.0, 0.0]},
    "tree 0, node 0: the threshold is -inf": {"nodes_values": [-np.inf, 0.0, 0.0]},
    "leaf_value: 1 coefficient not finite": {"target_weights": [np.inf, 0.0]},
    "base_values has 2 entries, expected 0 or 1": {"base_values": [1.0, 2.0]},
    "base: 1 coefficient not finite": {"base_values": [np.nan]},
    "tree 0, node 0: nodes_truenodeids names node 9": {"nodes_truenodeids": [9, 0, 0]},
    "tree 0, node 0 reads feature 5 of 1": {"nodes_featureids": [5, 0, 0]},
    "tree 0, node 0 reads feature -1 of 1": {"nodes_featureids": [-1, 0, 0]},
    "tree 0 has two nodes 1": {"nodes_nodeids": [0, 1, 1]},
    r"nodes_nodeids\[0\] is -4": {"nodes_nodeids": [-4, 1, 2]},
    r"nodes_treeids\[2\] is -1": {"nodes_treeids": [0, 0, -1]},
    "the nodes of tree 0 do not stand together": {"nodes_treeids": [0, 1, 0]},
    "target_treeids, target_nodeids, target_ids and target_weights have 1, 2, 2 and 2": {"target_treeids": [0]},
    r"target_ids\[1\] is 3, expected 0 to 0": {"target_ids": [0, 3]},
    r"target_nodeids\[0\] names node 8 of tree 0": {"target_nodeids": [8, 2]},
    "leaf 2 has no weight: onnxruntime and the ONNX standard disagree": {"target_nodeids": [1, 1]},
    "leaf 1 has two weights for one target": {
        "target_treeids": [0, 0, 0],
        "target_nodeids": [1, 1, 2],
        "target_ids": [0, 0, 0],
        "target_weights": [1.0, 2.0, 3.0],
    },
    r"tree 0, node 1: no path leads here from the root of its tree \(2 such nodes": {
        "nodes_modes": ["LEAF", "LEAF", "LEAF"],
        "target_treeids": [0, 0, 0],
        "target_nodeids": [0, 1, 2],
        "target_ids": [0, 0, 0],
        "target_weights": [1.0, 2.0, 3.0],
    },
    "tree 0, node 1: 2 splits or trees lead to this node": {"nodes_falsenodeids": [1, 0, 0]},
    "tree 0, node 3: 2 splits or trees lead to this node": {
        "nodes_treeids": [0, 0, 0, 0],
        "nodes_nodeids": [0, 1, 2, 3],
        "nodes_modes": ["LEAF", "BRANCH_EQ", "BRANCH_EQ", "LEAF"],
        "nodes_featureids": [0, 0, 0, 0],
        "nodes_values": [0.0, 1.0, 2.0, 0.0],
        "nodes_truenodeids": [0, 3, 3, 0],
        "nodes_falsenodeids": [0, 2, 1, 0],
        "nodes_missing_value_tracks_true": None,
        "target_nodeids": [0, 3],
    },
    "nodes_treeids is empty": {"nodes_treeids": None},
    "both nodes_values and nodes_values_as_tensor": {
        "nodes_values_as_tensor": build.constant("values", [0.0, 0.0, 0.0])
    },
    "nodes_values_as_tensor is float64 of 1 dimension for float32 inputs": {
        "nodes_values": None,
        "nodes_values_as_tensor": build.constant("values", [0.0, 0.0, 0.0], np.float64),
    },
}


@pytest.mark.parametrize("message", REFUSALS)
def test_refusals_name_node_and_attribute(tmp_path, message):
    model = build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0))], changes=REFUSALS[message])
    with pytest.raises(InputError, match=message) as caught:
        build.load(model, tmp_path)
    assert str(caught.value).startswith("model.onnx: node 'trees' (TreeEnsembleRegressor, opset 3): ")


def test_equality_tests_of_two_features_cannot_share_a_child(tmp_path):
    hit = leaf(1.0)
    tree = Branch("EQ", 0, 1.0, hit, Branch("EQ", 1, 2.0, hit, leaf(2.0)))
    with pytest.raises(UnsupportedModelError, match="tree 0, node 1: 2 splits or trees lead to this node; only"):
        build.load(build.regressor([tree], 2), tmp_path)


ENSEMBLE_REFUSALS = {
    "post_transform 2: only 0 is compiled .1 is LOGISTIC and 2 SOFTMAX to onnxruntime": {"post_transform": 2},
    "aggregate_function 9: known are": {"aggregate_function": 9},
    "nodes_modes: 9 is not a known mode": {"nodes_modes": build.constant("modes", [9], np.uint8)},
    "nodes_modes is int64, expected uint8": {"nodes_modes": build.constant("modes", [0], np.int64)},
    "nodes_splits is float64, expected float32": {"nodes_splits": build.constant("splits", [0.0], np.float64)},
    "nodes_splits has 2 entries, expected 1": {"nodes_splits": build.constant("splits", [0.0, 1.0])},
    r"nodes_truenodeids\[0\] is 5, expected 0 to 1": {"nodes_truenodeids": [5]},
    r"tree_roots\[0\] is 1, expected 0 to 0": {"tree_roots": [1]},
    r"leaf_targetids\[1\] is 4": {"leaf_targetids": [0, 4]},
    "leaf_weights has 1 entry, expected 2": {"leaf_weights": build.constant("weights", [0.0])},
    "node 0: 2 splits or trees lead to this node": {"tree_roots": [0, 0]},
    "membership_values has 1 set for 0 MEMBER nodes": {"membership_values": build.constant("members", [1.0])},
    "is empty: there are no trees": {"tree_roots": None, "nodes_featureids": [0]},
}


@pytest.mark.parametrize("message", ENSEMBLE_REFUSALS)
def test_refusals_of_opset_5(tmp_path, message):
    changes = ENSEMBLE_REFUSALS[message]
    model = build.ensemble([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0))], changes=changes)
    if "tree_roots" in changes and changes["tree_roots"] is None:
        attributes = model.graph.node[0].attribute
        attributes.append(onnx.helper.make_attribute("tree_roots", [], attr_type=onnx.AttributeProto.INTS))
    with pytest.raises(InputError, match=message):
        build.load(model, tmp_path)


def test_members_that_onnxruntime_would_cut_are_refused(tmp_path):
    for members in ((2.5, 40.0), (3e9, 1.0), (-2147483648.0,)):
        model = build.ensemble([Branch("MEMBER", 0, members, leaf(1.0), leaf(2.0))])
        with pytest.raises(UnsupportedModelError, match="must be whole numbers of 32 bits"):
            build.load(model, tmp_path)
    infinite = build.ensemble([Branch("MEMBER", 0, (np.inf,), leaf(1.0), leaf(2.0))])
    with pytest.raises(InputError, match="must be whole numbers"):
        build.load(infinite, tmp_path)
    empty = build.ensemble([Branch("MEMBER", 0, (), leaf(1.0), leaf(2.0))])
    with pytest.raises(InputError, match="an empty set in membership_values"):
        build.load(empty, tmp_path)


def chain_of_splits(depth):
    """A tree whose false children are splits down to the last."""
    number = np.arange(2 * depth + 1)
    split = (number % 2 == 0) & (number < 2 * depth)
    leaves = number[~split].tolist()
    changes = {
        "nodes_treeids": [0] * len(number),
        "nodes_nodeids": number.tolist(),
        "nodes_modes": np.where(split, "BRANCH_LEQ", "LEAF").tolist(),
        "nodes_featureids": [0] * len(number),
        "nodes_values": (number / 2.0).tolist(),
        "nodes_truenodeids": np.where(split, number + 1, 0).tolist(),
        "nodes_falsenodeids": np.where(split, number + 2, 0).tolist(),
        "nodes_missing_value_tracks_true": None,
        "target_treeids": [0] * len(leaves),
        "target_nodeids": leaves,
        "target_ids": [0] * len(leaves),
        "target_weights": [float(value) for value in leaves],
    }
    return build.regressor([leaf(0.0)], changes=changes)


def test_trees_deeper_than_onnxruntimes_stack_are_refused(tmp_path):
    assert_equal_bits(build.load(chain_of_splits(1000), tmp_path), [[0.0], [450.5], [999.0], [1e4]])
    with pytest.raises(UnsupportedModelError, match=r"node 2000: more than 1000 splits deep.*limited depth"):
        build.load(chain_of_splits(1001), tmp_path)


def test_lowest_double_has_nothing_below_it(tmp_path):
    lowest = float(np.finfo(np.float64).min)
    tree = Branch("LT", 0, lowest, leaf(1.0), Branch("LEQ", 0, 0.0, leaf(2.0), leaf(3.0)))
    with pytest.raises(UnsupportedModelError, match="nothing is below it"):
        build.load(build.ensemble([tree], elem_type=DOUBLE), tmp_path)


def test_leaf_values_beyond_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("st_codegen.walkers.onnx.tree_layout.MAX_LEAF_VALUES", 3)
    model = build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0, 2.0), leaf(3.0, 4.0))], n_targets=2)
    with pytest.raises(UnsupportedModelError, match="2 leaves with 2 numbers each: at most 3 leaf values"):
        build.load(model, tmp_path)
    monkeypatch.setattr("st_codegen.walkers.onnx.tree_layout.MAX_LEAF_VALUES", 4)
    build.load(model, tmp_path)
