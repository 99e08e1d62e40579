"""Tree ensembles: every mode, missing direction, aggregate and layout gives onnxruntime's bits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Comparison, Precision, Round, TreeEnsemble, reference
from tests.classifiers import loaded as compiled
from tests.classifiers import verified
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, FLOAT, Branch, Leaf, assert_equal_bits, leaf

pytestmark = pytest.mark.usefixtures("tried_in_place")

MODES = ("LEQ", "LT", "GTE", "GT", "EQ", "NEQ")
TYPES = pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE])


def trees_of(loaded):
    op = next(op for op in loaded.ir.ops if isinstance(op, TreeEnsemble))
    build.check_layout(op)
    return op


@pytest.mark.thorough
@TYPES
@pytest.mark.parametrize("builder", [build.regressor, build.ensemble])
@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_one_split_of_every_mode_at_its_threshold_and_beside_it(tmp_path, mode, missing, builder, elem_type):
    rng = np.random.default_rng(0)
    for value in (0.0, 1.5, -2.25, 0.1, 1e-45, 3.4e38):
        model = builder([Branch(mode, 0, value, leaf(1.0), leaf(2.0), missing)], elem_type=elem_type)
        loaded = build.load(model, tmp_path)
        answers = assert_equal_bits(loaded, build.special_rows(1, [value], rng))
        assert set(np.ravel(answers)) == {1.0, 2.0}
        trees_of(loaded)


@pytest.mark.parametrize(("outer", "inner"), list(itertools.product(MODES, MODES)))
def test_two_modes_in_one_ensemble(tmp_path, outer, inner):
    rng = np.random.default_rng(1)
    for number, (missing_outer, missing_inner) in enumerate(itertools.product([False, True], repeat=2)):
        below = Branch(inner, 0, 0.5, leaf(1.0), leaf(2.0), missing_inner)
        beside = Branch(inner, 0, -0.0, leaf(3.0), leaf(4.0), missing_inner)
        tree = Branch(outer, 0, 0.25, below, beside, missing_outer)
        model = (build.regressor, build.ensemble)[number % 2]([tree, leaf(10.0)])
        assert_equal_bits(build.load(model, tmp_path), build.special_rows(1, [0.5, 0.25, 0.0], rng))


@pytest.mark.parametrize("value", [np.inf, np.finfo(np.float32).max, np.finfo(np.float32).min])
@pytest.mark.parametrize("mode", MODES)
def test_thresholds_at_the_ends_of_the_number_line(tmp_path, mode, value):
    tree = Branch(mode, 0, float(value), leaf(1.0), leaf(2.0))
    mixed = Branch("LEQ", 0, 0.0, tree, tree) if mode == "LEQ" else Branch("LEQ", 0, 0.0, tree, leaf(3.0))
    for model in (build.ensemble([tree]), build.ensemble([mixed])):
        loaded = build.load(model, tmp_path)
        assert_equal_bits(loaded, build.special_rows(1, [value], np.random.default_rng(2)))


SMALL_SETS = [(3.0,), (0.0,), (1.0, 2.0), (2.5, 1.0), (30.0, 0.0, 7.0), (1.0, 1.0), (-0.0, 4.0)]
#: onnxruntime cuts x to an integer before it looks up these.
LARGE_SETS = [(31.0,), (-1.0, 2.0), (0.0, 40.0), (-3.0, -2.0, -1.0, 0.0, 1.0), (-5.0,), tuple(map(float, range(31)))]


@TYPES
@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("members", [*SMALL_SETS, *LARGE_SETS, (16777216.0, 100.0), (2147483520.0, 5.0)])
def test_membership(tmp_path, members, missing, elem_type):
    model = build.ensemble([Branch("MEMBER", 0, members, leaf(1.0), leaf(2.0), missing)], elem_type=elem_type)
    loaded = build.load(model, tmp_path)
    near = [value + step for value in members for step in (0.0, 0.5, -0.5, 1.0, -1.0)]
    x = build.special_rows(1, [*near, 2.5, -0.5, 1e10, -3e9, 2147483648.0, -2147483648.0], np.random.default_rng(3))
    answers = assert_equal_bits(loaded, x)
    assert set(np.ravel(answers)) == {1.0, 2.0}
    trees_of(loaded)


def test_neighbouring_categories_of_a_large_set_make_one_interval(tmp_path):
    members = tuple(map(float, range(100)))
    loaded = build.load(build.ensemble([Branch("MEMBER", 0, members, leaf(1.0), leaf(2.0))]), tmp_path)
    assert trees_of(loaded).n_nodes == 4


def equality_chain(values, hit, otherwise, missing=False):
    for value in reversed(values):
        otherwise = Branch("EQ", 0, value, hit, otherwise, missing)
    return otherwise


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("values", [(1.0, 2.0), (1.0, 5.0, 3.0, 40.0, 0.0), (0.5, 2.0, -1.0)])
def test_chain_of_equalities_that_share_their_true_child(tmp_path, values, missing):
    hit = Branch("LEQ", 0, 2.0, leaf(1.0), leaf(2.0))
    loaded = build.load(build.regressor([equality_chain(values, hit, leaf(3.0), missing)]), tmp_path)
    assert_equal_bits(loaded, build.special_rows(1, values, np.random.default_rng(4)))
    assert trees_of(loaded).n_nodes == 2 * len(values) + 4


def test_long_chain_of_categories_stays_linear(tmp_path):
    values = [float(value) for value in range(0, 1600, 2)]
    loaded = build.load(build.regressor([equality_chain(values, leaf(1.0), leaf(2.0))]), tmp_path)
    assert trees_of(loaded).n_nodes == 2 * len(values) + 2
    assert_equal_bits(loaded, np.arange(-2.0, 1602.0, 0.5)[:, None])


@pytest.mark.parametrize("seed", range(40))
def test_random_ensembles(tmp_path, seed):
    rng = np.random.default_rng(seed)
    n_features, n_targets = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    modes = MODES if seed % 2 else [str(rng.choice(MODES))]
    values = [float(v) for v in np.round(rng.normal(size=6), 1)] + [0.0, 1.0, 2.0]

    def weights(rng):
        return leaf(*rng.normal(size=n_targets).tolist())

    trees = [
        build.random_tree(rng, modes, values, int(rng.integers(0, 6)), n_features=n_features, weights=weights)
        for _ in range(int(rng.integers(1, 12)))
    ]
    model = build.regressor(
        trees,
        n_features,
        n_targets,
        elem_type=(FLOAT, DOUBLE)[seed % 3 == 0],
        tensors=seed % 6 == 0,
        base_values=rng.normal(size=n_targets).tolist() if seed % 4 else None,
        aggregate_function=("SUM", "AVERAGE", "MIN", "MAX")[seed % 5 % 4],
    )
    loaded = build.load(model, tmp_path)
    assert_equal_bits(loaded, build.special_rows(n_features, values, rng))
    trees_of(loaded)


@pytest.mark.parametrize("seed", range(30))
def test_random_ensembles_of_opset_5(tmp_path, seed):
    rng = np.random.default_rng(1000 + seed)
    n_features, n_targets = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    values = [0.0, 1.0, 2.0, 3.0, 7.0] if seed % 2 else [-2.0, -1.0, 0.0, 1.0, 2.0, 33.0]
    modes = (*MODES, "MEMBER") if seed % 3 else ("MEMBER",)

    def weights(rng):
        return Leaf({int(rng.integers(n_targets)): float(rng.normal())})

    trees = [
        build.random_tree(rng, modes, values, int(rng.integers(0, 6)), n_features=n_features, weights=weights)
        for _ in range(int(rng.integers(1, 8)))
    ]
    model = build.ensemble(
        trees, n_features, n_targets, elem_type=(FLOAT, DOUBLE)[seed % 2], aggregate_function=int(rng.integers(0, 2))
    )
    loaded = build.load(model, tmp_path)
    assert_equal_bits(loaded, build.special_rows(n_features, [*values, 0.5, 2.5, -0.5, 33.5], rng))
    trees_of(loaded)


@pytest.mark.parametrize("seed", range(60))
def test_equality_tests_that_onnxruntime_could_merge_are_equal_or_refused(tmp_path, seed):
    """Few features, values and weights, so that neighbouring subtrees are often equal to onnxruntime."""
    rng = np.random.default_rng(2000 + seed)
    n_targets = 1 + seed % 2

    def weights(rng):
        return leaf(*rng.choice([1.0, 2.0], size=n_targets).tolist())

    tree = build.random_tree(rng, ["EQ"], [1.0, 2.0, 3.0], 5, n_features=2, weights=weights, missing=0.3 * (seed % 3))
    try:
        loaded = build.load(build.regressor([tree], 2, n_targets), tmp_path)
    except UnsupportedModelError as error:
        assert "onnxruntime merges the two tests" in str(error)
        return
    assert_equal_bits(loaded, build.special_rows(2, [1.0, 2.0, 3.0], rng))


def test_merged_equality_tests_with_other_weights_are_refused(tmp_path):
    """onnxruntime answers the second target of x = 2 with that of x = 1."""
    tree = Branch("EQ", 0, 1.0, leaf(1.0, 10.0), Branch("EQ", 0, 2.0, leaf(1.0, 20.0), leaf(5.0, 6.0)))
    with pytest.raises(UnsupportedModelError, match="tree 0, node 0 and tree 0, node 2 test one feature"):
        build.load(build.regressor([tree], n_targets=2), tmp_path)
    kept = replace(tree, true=leaf(0.5, 10.0))
    assert_equal_bits(build.load(build.regressor([kept], n_targets=2), tmp_path), [[1.0], [2.0], [3.0]])


def test_merged_equality_tests_with_other_missing_directions_are_refused(tmp_path):
    hit = leaf(1.0)
    for second_hit in (hit, leaf(1.0)):
        tree = Branch("EQ", 0, 1.0, hit, Branch("EQ", 0, 2.0, second_hit, leaf(2.0), missing=True))
        with pytest.raises(UnsupportedModelError, match="onnxruntime merges the two tests"):
            build.load(build.regressor([tree]), tmp_path)


def test_sets_that_onnxruntime_keeps_apart_are_not_merged(tmp_path):
    def hit():
        return Branch("MEMBER", 1, (40.0,), leaf(1.0), leaf(2.0))

    tree = Branch("EQ", 0, 1.0, hit(), Branch("EQ", 0, 2.0, hit(), leaf(3.0), missing=True))
    loaded = build.load(build.ensemble([tree], 2), tmp_path)
    assert_equal_bits(loaded, build.special_rows(2, [1.0, 2.0, 40.0], np.random.default_rng(8)))


def test_only_one_counts_as_tracking_missing_values(tmp_path):
    for flag, answer in ((1, 1.0), (2, 2.0), (-1, 2.0)):
        changes = {"nodes_missing_value_tracks_true": [flag, 0, 0]}
        model = build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0))], changes=changes)
        assert assert_equal_bits(build.load(model, tmp_path), [[np.nan]])[0, 0] == answer


def test_sums_are_rounded_to_float32_in_the_order_of_the_trees(tmp_path):
    weights = [1e8, 1.0, -1e8, 1.0, 3.0]
    loaded = build.load(build.regressor([leaf(weight) for weight in weights], base_values=[0.5]), tmp_path)
    total = np.float32(0)
    for weight in weights:
        total = total + np.float32(weight)
    assert assert_equal_bits(loaded, [[0.0]])[0, 0] == total + np.float32(0.5) != np.float32(sum(weights) + 0.5)


def test_averages_divide_before_the_base_is_added(tmp_path):
    model = build.regressor([leaf(0.1), leaf(0.2), leaf(0.4)], base_values=[7.0], aggregate_function="AVERAGE")
    loaded = build.load(model, tmp_path)
    total = np.float32(0.1) + np.float32(0.2) + np.float32(0.4)
    assert assert_equal_bits(loaded, [[0.0]])[0, 0] == total / np.float32(3) + np.float32(7)


@pytest.mark.parametrize("aggregate", ["MIN", "MAX"])
def test_extremes_of_partial_leaves(tmp_path, aggregate):
    partial = Branch("LEQ", 0, 0.0, Leaf({0: -1.0}), Leaf({1: 5.0}))
    model = build.regressor([partial, leaf(2.0, 3.0)], n_targets=2, aggregate_function=aggregate)
    loaded = build.load(model, tmp_path)
    assert_equal_bits(loaded, [[-1.0], [1.0], [np.nan]])
    assert verified(compiled(loaded), tmp_path / "text", rows=100).exact
    for trees in ([partial], [Leaf({1: 2.0})]):
        with pytest.raises(UnsupportedModelError, match="target 0 is not set by all leaves of any tree"):
            build.load(build.regressor(trees, n_targets=2, aggregate_function=aggregate), tmp_path)


def test_the_largest_of_trees_is_not_their_sum(tmp_path):
    """It may be no integer of 32 bits where the sum is one; such rows have no answer."""
    trees = [Branch("LEQ", 0, 0.0, leaf(3e9), leaf(2.0)), Branch("LEQ", 0, 0.0, leaf(-3e9), leaf(-3e9))]
    model = build.regressor(trees, aggregate_function="MAX")
    model.graph.node.append(helper.make_node("Cast", ["Y"], ["Z"], to=TensorProto.INT32))
    model.graph.output[0].CopyFrom(build.info("Z", None, TensorProto.INT32))
    loaded = build.load(model, tmp_path)
    ours = reference.evaluate(loaded.ir, np.array([[-1.0], [1.0]]))
    np.testing.assert_array_equal(ours, [[np.nan], [2.0]])


def test_targets_that_no_leaf_sets_are_zero_or_refused(tmp_path):
    """onnxruntime leaves the base value of such a target out."""
    partial = Branch("LEQ", 0, 0.0, Leaf({0: -1.0}), Leaf({1: 5.0}))
    x = [[-1.0], [1.0]]
    loaded = build.load(build.regressor([partial], n_targets=3), tmp_path)
    assert assert_equal_bits(loaded, x).tolist() == [[-1.0, 0.0, 0.0], [0.0, 5.0, 0.0]]
    loaded = build.load(build.regressor([Leaf({2: 1.5}), Leaf({0: -0.5})], n_targets=3), tmp_path)
    assert trees_of(loaded).leaf_value.shape[1] == 1
    assert assert_equal_bits(loaded, x)[0].tolist() == [-0.5, 0.0, 1.5]
    with pytest.raises(UnsupportedModelError, match=r"target 1 is not set.*forgets its base value"):
        build.load(build.regressor([partial], n_targets=2, base_values=[0.0, 2.0]), tmp_path)
    with_base = build.regressor([partial, leaf(1.0, 1.0)], n_targets=2, base_values=[3.0, 2.0])
    assert_equal_bits(build.load(with_base, tmp_path), x)


def test_doubles_are_added_in_double_and_rounded_at_the_end(tmp_path):
    trees = [leaf(0.1), leaf(0.2), leaf(0.3)]
    loaded = build.load(build.regressor(trees, elem_type=DOUBLE, tensors=True), tmp_path)
    assert trees_of(loaded).sum_precision is Precision.FLOAT64
    assert isinstance(loaded.ir.ops[-1], Round)
    assert assert_equal_bits(loaded, [[0.0]])[0, 0] == np.float32(0.1 + 0.2 + 0.3)
    loaded = build.load(build.ensemble(trees, elem_type=DOUBLE), tmp_path)
    assert assert_equal_bits(loaded, [[0.0]])[0, 0] == 0.1 + 0.2 + 0.3


def test_inputs_of_trees_are_rounded_by_the_ensemble_itself(tmp_path):
    tree = Branch("LEQ", 0, 0.1, leaf(1.0), leaf(2.0))
    loaded = build.load(build.regressor([tree]), tmp_path)
    assert [type(op) for op in loaded.ir.ops] == [TreeEnsemble]
    assert trees_of(loaded).input_precision is Precision.FLOAT32
    assert loaded.ir.accepts_nan
    assert set(loaded.ir.magnitude_limits) == {None}


def test_floats_read_as_doubles(tmp_path):
    tree = Branch("LT", 0, 0.1, leaf(1.0), Branch("GT", 0, 0.3, leaf(2.0), leaf(3.0)))
    model = build.ensemble([tree], elem_type=DOUBLE)
    cast = onnx.helper.make_node("Cast", ["X0"], ["X"], to=DOUBLE)
    nodes = [cast, *model.graph.node]
    wide = build.graph_model(nodes, [build.info("X0", (None, 1))], model.graph.output, opset=20, ml_opset=5)
    loaded = build.load(wide, tmp_path)
    assert trees_of(loaded).input_precision is Precision.FLOAT32
    assert_equal_bits(loaded, build.special_rows(1, [0.1, 0.3], np.random.default_rng(7)))


def test_pure_ensembles_keep_the_thresholds_of_the_file(tmp_path):
    for mode, comparison in (("LEQ", "<="), ("GT", "<="), ("LT", "<"), ("GTE", "<")):
        trees = [Branch(mode, 0, value, leaf(1.0), leaf(2.0)) for value in (0.5, -0.25)]
        op = trees_of(build.load(build.regressor(trees), tmp_path))
        assert op.comparison is Comparison(comparison)
        assert op.threshold[op.split >= 0].tolist() == [0.5, -0.25]


def test_only_features_in_use_become_columns(tmp_path):
    tree = Branch("LEQ", 4, 0.1, leaf(1.0), Branch("LEQ", 2, 0.1, leaf(1.0), leaf(2.0)))
    op = trees_of(build.load(build.regressor([tree], n_features=6), tmp_path))
    assert [column.column for column in op.columns] == [2, 4]


def test_a_lone_leaf_at_the_root_of_opset_5(tmp_path):
    model = build.ensemble([leaf(3.0), Branch("LEQ", 0, 0.0, leaf(1.0), leaf(2.0))])
    assert assert_equal_bits(build.load(model, tmp_path), [[-1.0], [1.0]]).tolist() == [[4.0], [5.0]]


def test_node_and_tree_identifiers_are_arbitrary(tmp_path):
    changes = {
        "nodes_treeids": [7, 7, 7, 3],
        "nodes_nodeids": [2, 0, 3, 1],
        "nodes_truenodeids": [3, 0, 0, 0],
        "nodes_falsenodeids": [0, 0, 0, 0],
        "target_treeids": [3, 7, 7],
        "target_nodeids": [1, 3, 0],
    }
    model = build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0)), leaf(4.0)], changes=changes)
    assert assert_equal_bits(build.load(model, tmp_path), [[0.0], [1.0]]).tolist() == [[3.0], [5.0]]


def test_weights_of_inner_nodes_are_ignored(tmp_path):
    changes = {
        "target_treeids": [0, 0, 0],
        "target_nodeids": [0, 1, 2],
        "target_ids": [0, 0, 0],
        "target_weights": [9.0, 1.0, 2.0],
    }
    model = build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0))], changes=changes)
    assert assert_equal_bits(build.load(model, tmp_path), [[0.0], [1.0]]).tolist() == [[1.0], [2.0]]


@pytest.mark.slow
def test_million_nodes(tmp_path):
    """Complete trees of 2047 nodes; every level doubles."""
    n_trees, depth = 489, 11
    total, inner = 2**depth - 1, 2 ** (depth - 1) - 1
    rng = np.random.default_rng(5)
    number = np.arange(total)
    split = np.tile(number < inner, n_trees)
    tree, node = np.repeat(np.arange(n_trees), total), np.tile(number, n_trees)
    changes = {
        "nodes_treeids": tree.tolist(),
        "nodes_nodeids": node.tolist(),
        "nodes_modes": np.where(split, "BRANCH_LEQ", "LEAF").tolist(),
        "nodes_featureids": rng.integers(0, 3, len(tree)).tolist(),
        "nodes_values": rng.normal(size=len(tree)).tolist(),
        "nodes_truenodeids": np.where(split, 2 * node + 1, 0).tolist(),
        "nodes_falsenodeids": np.where(split, 2 * node + 2, 0).tolist(),
        "nodes_missing_value_tracks_true": rng.integers(0, 2, len(tree)).tolist(),
        "target_treeids": tree[~split].tolist(),
        "target_nodeids": node[~split].tolist(),
        "target_ids": [0] * int(np.sum(~split)),
        "target_weights": rng.normal(size=int(np.sum(~split))).tolist(),
    }
    loaded = build.load(build.regressor([leaf(0.0)], 3, changes=changes), tmp_path)
    assert trees_of(loaded).n_nodes == n_trees * total > 1_000_000
    assert_equal_bits(loaded, build.special_rows(3, [0.0], rng, n=50))


def test_the_comparison_of_this_file_is_not_blind(tmp_path):
    loaded = build.load(build.regressor([Branch("LEQ", 0, 0.5, leaf(1.0), leaf(2.0))]), tmp_path)
    op = trees_of(loaded)
    moved = replace(op, threshold=np.nextafter(op.threshold.astype(np.float32), np.float32(1)).astype(np.float64))
    wrong = replace(loaded, ir=replace(loaded.ir, ops=(moved,)))
    with pytest.raises(AssertionError):
        assert_equal_bits(wrong, build.special_rows(1, [0.5], np.random.default_rng(6)))


@pytest.mark.parametrize("transform", ["LOGISTIC", "SOFTMAX"])
@TYPES
def test_sums_of_several_targets_that_are_transformed(tmp_path, elem_type, transform):
    """As onnxruntime does; of one target it does nothing, against the standard, and the model is refused."""
    trees = [Branch("LEQ", n % 2, 0.3 * n, Leaf({n % 3: 2.5 - n}), Leaf({n % 3: n - 4.0})) for n in range(9)]
    loaded = build.load(build.regressor(trees, 2, 3, elem_type, post_transform=transform), tmp_path)
    build.assert_within_bound(loaded, build.rows(2, spread=1.0))
    assert np.all((loaded.predict(build.rows(2))[:, -3:] > 0) & (loaded.predict(build.rows(2))[:, -3:] < 1))


@pytest.mark.parametrize("transform", ["LOGISTIC", "SOFTMAX"])
def test_linear_sums_that_are_transformed(tmp_path, transform):
    weights = {"coefficients": [1.0, -0.5, 0.25, 2.0], "intercepts": [0.5, -1.0], "targets": 2}
    loaded = build.load(build.ml("LinearRegressor", 2, post_transform=transform, **weights), tmp_path)
    build.assert_within_bound(loaded, build.rows(2, spread=1.0))
