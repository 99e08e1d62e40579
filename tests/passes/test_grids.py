"""Trees in all cells of a grid at once: what the reference says of each cell, without asking it cell by cell."""

from itertools import product

import numpy as np
import pytest

from st_codegen.ir import Comparison, Precision, TreeColumn, reference
from st_codegen.passes import grids
from tests.models import random_trees

POINTS = (np.linspace(-2.0, 2.0, 9), np.array([-1.0, 0.0, 0.3, np.nan]), np.append(np.linspace(-1.5, 1.5, 6), np.nan))


def cells_of(*points):
    """The rows of a grid, the last axis the fastest, and its shape."""
    return np.array(list(product(*points))), tuple(map(len, points))


def forbid(monkeypatch):
    """Let the evaluation cell by cell fail."""
    monkeypatch.setattr(reference.TreeEvaluator, "leaves", lambda self, tree: pytest.fail("cell by cell"))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("comparison", Comparison)
@pytest.mark.parametrize("outputs", [1, 2])
def test_every_cell_is_answered_as_by_the_reference(seed, comparison, outputs, monkeypatch):
    random = np.random.default_rng(seed)
    op = random_trees(
        random,
        trees=9,
        splits=8,
        outputs=outputs,
        infinite=True,
        comparison=comparison,
        sum_precision=Precision.FLOAT32,
    )
    x, shape = cells_of(*POINTS)
    with np.errstate(all="ignore"):
        expected = reference.apply(op, [x])
        forbid(monkeypatch)
        for cells in (1, 100_000):  # the trees one after another, and together
            monkeypatch.setattr(grids, "_CELLS", cells)
            assert np.array_equal(grids.apply(op, [x], shape).view(np.int64), expected.view(np.int64))


def test_what_is_no_cut_of_an_axis_is_left_to_the_reference():
    random = np.random.default_rng(0)
    x, shape = cells_of(*POINTS)
    twisted = np.column_stack([x[:, 0] + np.nan_to_num(x[:, 2]), x[:, 1:]])  # changes along two axes
    falling, _ = cells_of(-POINTS[0], *POINTS[1:])
    categories = random_trees(random, trees=9, categorical=(0,), comparison=Comparison.LESS)
    plain = random_trees(random, trees=9, comparison=Comparison.LESS)
    column = TreeColumn(0, missing_interval=(-0.1, 0.1))  # missing in the middle of the axis
    zero = random_trees(random, trees=9, columns=(column, TreeColumn(1)), comparison=Comparison.LESS)
    for op, rows in ((plain, twisted), (plain, falling), (categories, x), (zero, x)):
        with np.errstate(all="ignore"):
            assert grids._GridTrees(op, rows).splits(shape) is None
            assert np.array_equal(grids.apply(op, [rows], shape), reference.apply(op, [rows]))
