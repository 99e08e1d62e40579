"""Code of trees at the ends of the range of numbers, and of nodes on ranks."""

import dataclasses

import numpy as np
import pytest

from st_codegen.emit.blocks.model import Limits, model_block
from st_codegen.errors import InputError
from st_codegen.ir import Comparison, Precision, Rank, RankColumn, TreeColumn, reference
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.passes.real import in_real
from tests.emit.test_emitted import run
from tests.models import model, random_trees

LARGEST = 1e305
SMALLER = float(np.nextafter(LARGEST, 0.0))


def with_threshold(value):
    trees = random_trees(np.random.default_rng(5), trees=2, splits=4, comparison=Comparison.LESS_OR_EQUAL)
    inner = np.flatnonzero(trees.split >= 0)
    threshold = trees.threshold.copy()
    threshold[inner[0]], threshold[inner[-1]] = value, np.inf
    return model(dataclasses.replace(trees, threshold=threshold), accepts_nan=True)


def test_the_number_that_stands_for_infinity_is_no_threshold():
    for value in (LARGEST, -LARGEST):
        with pytest.raises(InputError, match="leaves no room for missing values"):
            model_block(with_threshold(value), Limits(1000))


@pytest.mark.parametrize("value", [SMALLER, -SMALLER])
def test_thresholds_below_it_are_told_from_infinity(value, tmp_path):
    made = with_threshold(value)
    numbers = [value, np.nextafter(value, 0), np.nextafter(value, 2 * value), LARGEST, 1e307, np.inf, -np.inf, np.nan]
    x = np.stack(np.meshgrid(numbers, numbers, [0.0, value, np.nan]), -1).reshape(-1, 3)
    assert np.array_equal(reference.evaluate(made, x), run(made, "twincat", tmp_path, x), equal_nan=True)


@pytest.mark.parametrize(("limit", "compared"), [(None, True), (1e39, True), (1e38, False)])
def test_only_inputs_that_may_lie_beyond_real_are_compared_with_its_range(limit, compared):
    """REAL ends at 3.4e38."""
    trees = random_trees(np.random.default_rng(5), trees=1, splits=4, comparison=Comparison.LESS)
    made = model(dataclasses.replace(trees, input_precision=Precision.FLOAT32))
    block = model_block(dataclasses.replace(made, magnitude_limits=(limit,) * len(made.features)), Limits(1000))
    assert any("REAL_LIMIT" in table.name for table in block.tables) == compared


def test_a_threshold_without_end_keeps_its_side_in_real(tmp_path):
    made = in_real(with_threshold(0.5))
    numbers = np.float64(np.float32([0.5, 2.9e38, 3.3e38, -3.3e38, np.nan]))
    x = np.stack(np.meshgrid(numbers, numbers, numbers), -1).reshape(-1, 3)
    assert np.array_equal(reference.evaluate(made, x), run(made, "twincat", tmp_path, x), equal_nan=True)


def test_a_tree_whose_nodes_all_equal_those_of_an_earlier_one_has_no_lines_of_its_own(tmp_path):
    trees = random_trees(np.random.default_rng(8), trees=1, splits=6, comparison=Comparison.LESS_OR_EQUAL)
    n = trees.n_nodes
    twice = dataclasses.replace(
        trees,
        roots=[0, n],
        **{name: np.tile(getattr(trees, name), 2) for name in ("split", "threshold", "missing_left", "leaf")},
        **{
            name: np.concatenate([child, np.where(child >= 0, child + n, -1)])
            for name, child in (("left", trees.left), ("right", trees.right))
        },
        tree_output=[0, 0],
    )
    on_ranks = pruned(ranked(model(twice)))
    (nodes,) = (table for table in model_block(on_ranks, Limits(1000)).tables if table.name.startswith("NODE"))
    assert [group.label for group in nodes.groups] == ["roots", "tree 0"]
    x = np.random.default_rng(1).normal(size=(200, 3))
    assert np.array_equal(reference.evaluate(on_ranks, x), run(on_ranks, "iec", tmp_path, x))


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_ranks_that_no_tree_compares(target, tmp_path):
    leaves = random_trees(np.random.default_rng(8), trees=2, splits=0, comparison=Comparison.LESS_OR_EQUAL)
    on_ranks = ranked(model(leaves))
    trees = dataclasses.replace(on_ranks.ops[1], columns=tuple(TreeColumn(number) for number in range(3)))
    rank = Rank((0,), tuple(RankColumn(number, np.array([0.5])) for number in range(3)))
    made = dataclasses.replace(on_ranks, ops=(rank, trees))
    x = np.random.default_rng(1).normal(size=(20, 3))
    assert np.array_equal(reference.evaluate(made, x), run(made, target, tmp_path, x))


@pytest.mark.parametrize("target", ["iec", "twincat"])
@pytest.mark.parametrize("categorical", [(0,), (0, 1, 2)])
def test_answers_of_categorical_splits_are_cut_with_their_trees(categorical, target, tmp_path):
    random = np.random.default_rng(11)
    trees = random_trees(random, trees=9, splits=5, comparison=Comparison.LESS, categorical=categorical)
    made = model(trees, accepts_nan=True)
    limits = Limits(45)
    assert len(trees.category_left) > limits.max_array
    tables = {table.name: len(table.values) for table in model_block(made, limits).tables}
    assert {"CATEGORY_LEFT_0_1", "CATEGORY_LEFT_1_1"} <= {*tables}
    assert max(tables.values()) <= limits.max_array
    x = np.stack([random.choice([-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.5, np.nan], 400) for _ in range(3)], axis=1)
    assert np.array_equal(reference.evaluate(made, x), run(made, target, tmp_path, x, limits))


def test_a_tree_with_more_answers_than_an_array_holds_is_refused():
    trees = random_trees(np.random.default_rng(3), trees=2, splits=5, comparison=Comparison.LESS, categorical=(0, 1, 2))
    with pytest.raises(
        InputError, match=r"tree \d needs 28 elements .* the limit is 20: number .* \(their codes reach 4\), .*--max"
    ):
        model_block(model(trees), Limits(20))
