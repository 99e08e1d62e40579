"""Trees cut down to what rows in boxes of ranks meet, against a walk that follows a box of each node by itself."""

import itertools
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from st_codegen.ir import Comparison, Rank, RankColumn, TreeColumn, TreeEnsemble, digest
from st_codegen.ir.preorder import ends_in_preorder, preorder
from st_codegen.ir.trees import with_nodes
from st_codegen.passes.boxes import Boxes, Parts
from st_codegen.passes.prune import pruned
from st_codegen.project.bundle import load
from tests.models import model, random_trees

GOLDEN = Path(__file__).resolve().parents[2] / "golden"
RANKS = 9


def by_levels(columns, depth, trees=1, seed=0):
    """Complete trees on ranks, level by level: parents before children, but not in preorder."""
    random = np.random.default_rng(seed)
    one = 2 ** (depth + 1) - 1
    nodes, inner = trees * one, np.arange(trees * one) % one < one // 2
    start = np.arange(nodes) // one * one
    left = np.where(inner, start + 2 * (np.arange(nodes) - start) + 1, -1)
    return TreeEnsemble(
        inputs=(1,),
        columns=tuple(map(TreeColumn, range(columns))),
        roots=np.arange(trees) * one,
        split=np.where(inner, random.integers(0, columns, nodes), -1),
        threshold=np.where(inner, random.integers(0, RANKS, nodes), 0),
        left=left,
        right=np.where(inner, left + 1, -1),
        missing_left=np.zeros(nodes, bool),
        leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
        leaf_value=random.normal(size=(np.count_nonzero(~inner), 1)),
        tree_output=np.zeros(trees),
        base=[0.0],
        comparison=Comparison.LESS_OR_EQUAL,
    )


def in_preorder(op):
    layout = preorder(op.roots, op.left, op.right)
    return with_nodes(op, layout, layout.order)


def walked(op, node, low, high):
    """The splits and leaves that rows with ranks from `low` to `high` meet, in preorder."""
    column, at = op.split[node], op.threshold[node]
    if column < 0:
        return [("leaf", op.leaf[node])]
    below, above = high.copy(), low.copy()
    below[column], above[column] = min(high[column], at), max(low[column], at + 1)
    left = walked(op, op.left[node], low, below) if low[column] <= at else []
    right = walked(op, op.right[node], above, high) if high[column] > at else []
    return [(column, at), *left, *right] if left and right else left + right


def nodes_of(op):
    return [
        ("leaf", leaf) if column < 0 else (column, at)
        for column, at, leaf in zip(op.split, op.threshold, op.leaf, strict=True)
    ]


def boxes_of(parts, low, high):
    """The ranks of each cell of a grid."""
    for cell in itertools.product(*(range(len(part.low)) for part in parts)):
        lowest, highest = low.copy(), high.copy()
        for part, number in zip(parts, cell, strict=True):
            lowest[part.columns], highest[part.columns] = part.low[number], part.high[number]
        yield lowest, highest


@pytest.mark.parametrize("seed", range(40))
def test_each_cell_has_what_its_rows_meet_and_nothing_else(seed):
    random = np.random.default_rng(seed)
    columns = int(random.integers(2, 7))
    op = random_trees(
        random,
        features=columns,
        splits=int(random.integers(1, 60)),
        thresholds=np.arange(-1.0, RANKS + 2),
        comparison=Comparison.LESS_OR_EQUAL,
    )
    low, high = random.integers(-1, 2, columns, np.int32), random.integers(RANKS - 1, RANKS + 2, columns, np.int32)
    chosen = np.array_split(random.permutation(columns)[: random.integers(2, columns + 1)], 2)
    axes = []
    for group in chosen:
        cuts = np.sort(random.choice(np.arange(2, RANKS - 1), 2, replace=False)).astype(np.int32)[:, None]
        ends = np.ones((1, len(group)), np.int32)
        lowest = np.concatenate([low[group][None], cuts * ends])
        axes.append(Parts(group.tolist(), lowest, np.concatenate([(cuts - 1) * ends, high[group][None]])))
    boxes = Boxes.of(op, low, high)
    for given in ((), axes[:1], axes):
        cut = boxes.cut(given)
        expected = [walked(op, root, *box) for root in op.roots for box in boxes_of(given, low, high)]
        assert nodes_of(cut) == list(itertools.chain(*expected))
        assert np.diff(cut.roots, append=cut.n_nodes).tolist() == list(map(len, expected))
        assert digest(model(replace(in_preorder(cut), inputs=(0,)), features=columns)) == digest(
            model(replace(cut, inputs=(0,)), features=columns)
        )


def test_trees_in_another_order_are_pruned_to_the_same():
    op = by_levels(columns=3, depth=6, trees=2)
    assert not np.array_equal(op.left, in_preorder(op).left)
    rank = Rank((0,), tuple(RankColumn(number, np.arange(float(RANKS))) for number in range(3)))
    small, expected = (pruned(model(rank, trees)) for trees in (op, in_preorder(op)))
    assert small.ops[1].n_nodes < op.n_nodes
    assert digest(small) == digest(expected)


@pytest.mark.parametrize("seed", range(40))
def test_preorder_is_told_from_every_other_order_that_has_parents_first(seed):
    random = np.random.default_rng(seed)
    op = random_trees(random, trees=3, splits=int(random.integers(1, 12)), comparison=Comparison.LESS)
    end = ends_in_preorder(op.roots, op.left, op.right)
    assert np.array_equal(end, np.arange(op.n_nodes) + preorder(op.roots, op.left, op.right).size)
    for _ in range(20):
        number = np.empty(op.n_nodes, np.int64)  # the new number of each node
        made = 0
        for root in op.roots:
            todo = [root]
            while todo:
                node = todo.pop(random.integers(len(todo)))
                number[node], made = made, made + 1
                todo += [child for child in (op.left[node], op.right[node]) if child >= 0]
        left, right = np.full((2, op.n_nodes), -1)
        left[number], right[number] = (np.where(child < 0, -1, number[child]) for child in (op.left, op.right))
        found = ends_in_preorder(op.roots, left, right)
        assert (found is not None) == np.array_equal(number, np.arange(op.n_nodes))
    more = (np.append(child, -1) for child in (op.left, op.right))
    assert ends_in_preorder(op.roots, *more) is None  # a node that no root reaches


def test_memory_does_not_grow_with_the_columns():
    columns = 400
    op = in_preorder(by_levels(columns, depth=10, trees=8))
    low, high = np.zeros(columns, np.int32), np.full(columns, RANKS, np.int32)
    tracemalloc.start()
    Boxes.of(op, low, high).cut()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < columns * op.n_nodes  # not even a byte of each node for each column


@pytest.mark.parametrize("project", sorted(path.parent.name for path in GOLDEN.glob("*/models")))
def test_walkers_lay_all_trees_out_in_preorder(project):
    for library in ("skops", "lightgbm", "xgboost", "onnxruntime"):
        pytest.importorskip(library)
    found = [op for one in load(GOLDEN / project / "models").models for op in one.ir.ops]
    forests = [op for op in found if isinstance(op, TreeEnsemble) and op.is_forest]
    assert forests
    for op in forests:
        assert ends_in_preorder(op.roots, op.left, op.right) is not None
