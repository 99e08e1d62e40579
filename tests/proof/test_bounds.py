"""Bounds on the difference between a block and its library."""

import dataclasses

import numpy as np
import pytest

from st_codegen.ir import Activation, Combine, Comparison, Function, Linear, Operator, Scale, Select, SummationOrder
from st_codegen.proof.bounds import difference_bound
from tests.models import model, random_trees

THRESHOLD = 0.7
LEAVES = (1.0, 5.0)


def stump(comparison=Comparison.LESS_OR_EQUAL):
    """LEAVES[0] up to the threshold, LEAVES[1] above it."""
    frame = random_trees(np.random.default_rng(0), features=1, trees=1, splits=0, comparison=comparison)
    return dataclasses.replace(
        frame,
        split=[0, -1, -1],
        threshold=[THRESHOLD, 0.0, 0.0],
        left=[1, -1, -1],
        right=[2, -1, -1],
        missing_left=[False, False, False],
        leaf=[-1, 0, 1],
        leaf_value=np.reshape(LEAVES, (2, 1)),
        base=[0.0],
    )


@pytest.mark.parametrize("comparison", Comparison)
def test_a_split_behind_an_inexact_step_may_jump_on_either_side_of_its_threshold(comparison):
    """Just below the threshold the upper end of the value's interval crosses it, just above it the lower end."""
    trees = dataclasses.replace(stump(comparison), inputs=(1,))
    behind = model(Activation((0,), Function.LOG1P, width=1), trees, features=1)
    at = np.expm1(THRESHOLD)
    below, above = (at * (1.0 + sign * 2.0**-51) for sign in (-1.0, 1.0))
    bounds = difference_bound(behind, np.array([[below], [above], [0.99 * at], [1.01 * at], [-0.5]]))[:, 0]
    jump = LEAVES[1] - LEAVES[0]
    assert np.all((bounds[:2] >= jump) & (bounds[:2] < 1.001 * jump))
    assert not bounds[2:].any()


def test_a_split_of_an_input_itself_does_not_jump():
    x = np.array([[THRESHOLD], [np.nextafter(THRESHOLD, 0.0)], [np.nextafter(THRESHOLD, 1.0)]])
    assert not difference_bound(model(stump(), features=1), x).any()


def test_without_a_bound_there_is_none_behind_products_and_sums_either():
    """A quotient whose divisor may be zero has none; multiplied, added or voted with it has none still."""
    unsure = [
        Linear((0,), [[1.0, 1.0, 1.0], [1.0, -1.0, 0.0]], [0.0, 0.0]),
        Select((1,), [0]),
        Select((1,), [1]),
        Combine((2, 3), Operator.DIVIDE, 1),
    ]
    behind = {
        "product": Scale((4,), Operator.MULTIPLY, [2.0]),
        "product of two": Combine((4, 4), Operator.MULTIPLY, 1),
        "sum in order": Linear((4,), [[1.0], [0.0]], [0.0, 0.0], SummationOrder.SEQUENTIAL),
    }
    for name, op in behind.items():
        bound = difference_bound(model(*unsure, op), np.array([[1.0, 1.0, 3.0]]))
        assert np.all(np.isinf(bound)), name


def test_a_root_beside_zero_has_no_finite_bound():
    of_root = model(Linear((0,), [[1.0, -1.0, 1.0]], [0.0]), Activation((1,), Function.SQRT, 1))
    assert np.isinf(difference_bound(of_root, np.array([[1.0, 1.0, 0.0]])))
    assert difference_bound(of_root, np.array([[3.0, 1.0, 2.0]])) < 1e-14
