"""Bounds on the difference between a block and its library."""

import dataclasses
import itertools

import numpy as np
import pytest

from st_codegen.ir import (
    Activation,
    ArgMax,
    Combine,
    Comparison,
    Function,
    Linear,
    Operator,
    Precision,
    Scale,
    Select,
    SummationOrder,
    reference,
)
from st_codegen.proof.bounds import UNIT, difference_bound, step
from tests.models import SMALL_MODELS, model, random_trees

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


def test_units_of_roundoff_are_those_of_the_formats():
    assert UNIT[Precision.FLOAT32] == np.finfo(np.float32).eps / 2
    assert UNIT[Precision.FLOAT64] == np.finfo(np.float64).eps / 2
    assert 2 * UNIT[Precision.FLOAT32] < UNIT[Precision.REAL] < 2.0001 * UNIT[Precision.FLOAT32]


@pytest.mark.parametrize("size", [1e-3, 0.5])
@pytest.mark.parametrize("name", SMALL_MODELS)
def test_operands_that_moved_change_a_result_by_no_more_than_its_bound_which_is_not_far(name, size):
    """Operands are moved in random directions; the bound is for the worst of all, which may not occur together."""
    random = np.random.default_rng(0)
    whole = SMALL_MODELS[name]
    with np.errstate(all="ignore"):
        values = reference.trace(whole, random.normal(size=(40, len(whole.features))))
        for op, result in zip(whole.ops, values[1:], strict=True):
            operands = [values[number] for number in op.inputs]
            bound = step(op, operands, [np.full_like(operand, size) for operand in operands], result)
            worst = np.zeros_like(result)
            for _ in range(32):
                moved = [operand + size * random.choice([-1.0, 1.0], operand.shape) for operand in operands]
                worst = np.fmax(worst, np.abs(reference.apply(op, moved) - result))
            known = np.isfinite(bound) & np.isfinite(worst)
            assert np.all(worst[known] <= bound[known] + 1e-12)  # the sums that move an operand are rounded, too
            if size < 0.1:
                assert np.mean(known) > 0.3
                assert (
                    isinstance(op, ArgMax) or not np.any(worst) or np.mean(bound[known]) <= 10 * np.mean(worst[known])
                )


@pytest.mark.parametrize("precision", [Precision.FLOAT32, Precision.FLOAT64])
@pytest.mark.parametrize(("outputs", "wide"), [(1, False), (2, False), (2, True)])
@pytest.mark.parametrize(("base", "around", "divisor"), [(0.0, 0.0, 1.0), (0.0, 3e4, 1.0), (1e6, 0.0, 2.5)])
def test_trees_that_take_any_of_their_leaves_stay_within_their_bound(precision, outputs, wide, base, around, divisor):
    """Each choice of one leaf a tree is summed up forwards and backwards; the bound is above, and not far above."""
    random = np.random.default_rng(1)
    op = random_trees(
        random, trees=4, splits=3, outputs=outputs, wide=wide, sum_precision=precision, comparison=Comparison.LESS
    )
    number = np.float32 if precision is Precision.FLOAT32 else np.float64
    leaves = (op.leaf_value + around).astype(number)
    op = dataclasses.replace(op, leaf_value=leaves, base=np.full(outputs, base), divisor=divisor)
    x = np.zeros((1, 3))
    (bound,) = step(op, [x], [np.full_like(x, np.inf)], np.zeros((1, outputs)))
    stops = [*op.roots[1:], op.n_nodes]
    numbers = [op.leaf[root:stop][op.split[root:stop] < 0] for root, stop in zip(op.roots, stops, strict=True)]
    for output in range(outputs):
        own = [tree for tree in range(op.n_trees) if wide or op.tree_output[tree] == output]
        sums = []
        for chosen in itertools.product(*(leaves[numbers[tree], output if wide else 0] for tree in own)):
            for order in (chosen, chosen[::-1]):
                total = number(base)
                for leaf in order:
                    total += leaf
                sums.append(float(total) / divisor)
        spread = max(sums) - min(sums)
        assert spread <= bound[output] <= spread + 40 * UNIT[precision] * (abs(base) + 4 * around + 10)
