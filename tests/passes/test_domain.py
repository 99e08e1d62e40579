import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError
from st_codegen.ir import (
    Activation,
    Aggregate,
    Comparison,
    Feature,
    Function,
    Kernel,
    KernelSum,
    Linear,
    ModelIR,
    Operator,
    Precision,
    Round,
    Scale,
    Select,
    Source,
    reference,
)
from st_codegen.ir.base import EXPONENTIALS
from st_codegen.ir.trees import ends_of
from st_codegen.passes.domain import limit_inputs, magnitudes
from tests.examples import examples
from tests.models import random_trees

SOURCE = Source("test", "1", "test")


def model(*ops, n=2):
    outputs = tuple(f"out{i}" for i in range(ops[-1].width))
    return ModelIR("m", tuple(Feature(f"f{i}") for i in range(n)), ops, outputs, SOURCE)


@examples()
@given(
    st.lists(st.floats(-1e20, 1e20), min_size=4, max_size=4),
    st.sampled_from(list(Function)),
    st.sampled_from(list(Kernel)),
    st.integers(1, 4),
)
def test_nothing_overflows_just_below_the_limit(numbers, function, kernel, degree):
    weights = np.array(numbers).reshape(2, 2)
    limited = limit_inputs(
        model(
            Linear((0,), weights, [1.0, -1.0]),
            Activation((1,), function, 2, 0.5),
            KernelSum((2,), kernel, weights, [[1.0, -2.0]], [0.5], gamma=1e-3, degree=degree),
        )
    )
    x = np.array([[a, b] for a in (-1, 1) for b in (-1, 1)]) * np.nextafter(limited.magnitude_limits[0], 0)
    values = reference.trace(limited, x)
    refusing = (Function.LOG1P, Function.LOG, Function.SQRT, Function.SIN, Function.COS)
    guarded = (*EXPONENTIALS, *refusing)
    for number, value in enumerate(values):
        if number >= 2 and function in guarded:
            break  # guarded at run time
        assert np.all(np.isfinite(value))


def test_models_that_only_compare_take_everything():
    assert limit_inputs(model(Scale((0,), Operator.ADD, [0.0, 0.0]))).magnitude_limits == (9e304, 9e304)


def test_float32_models_are_limited_to_float32():
    limited = limit_inputs(model(Round((0,), 2), Scale((1,), Operator.MULTIPLY, [1e10, 1.0], Precision.FLOAT32)))
    assert limited.magnitude_limits == (3e28, 3e28)


def test_quotients_are_limited_so_that_their_sum_does_not_overflow():
    limited = limit_inputs(
        model(
            Round((0,), 2),
            Scale((1,), Operator.DIVIDE, [1.0, 1.0], Precision.FLOAT32, reverse=True),
            Linear((2,), [[4.0, 4.0]], [0.0], precision=Precision.FLOAT32),
        )
    )
    assert limited.ops[1].ceiling == 1e19
    result = reference.evaluate(limited, [[1e-18, 1.0], [1e-20, 1.0], [0.0, 1.0]])
    assert np.isfinite(result[:, 0]).tolist() == [True, False, False]


def test_a_power_with_a_small_negative_exponent_has_no_answer_at_0_alone():
    limited = limit_inputs(model(Activation((0,), Function.POWER, 2, -0.005)))
    result = reference.evaluate(limited, [[1e-200, 3.0], [0.0, 3.0]])
    np.testing.assert_allclose(result[0], [10.0, 3.0**-0.005])
    assert np.isnan(result[1, 0])


def test_a_model_that_always_overflows_is_refused():
    huge = model(Linear((0,), [[1e300, 1e300]], [0.0]), Linear((1,), [[1e300]], [0.0]))
    with pytest.raises(InputError, match="possible for inputs of magnitude 1"):
        limit_inputs(huge)


def test_a_declared_range_beyond_the_limit_is_refused():
    steep = model(Linear((0,), [[1e290, 0.0]], [0.0]))
    ranged = dataclasses.replace(steep, features=(Feature("a", "", -1e20, 1e20), Feature("b", "", 0, 1)))
    with pytest.raises(InputError, match="feature 'a': within the range"):
        limit_inputs(ranged)


def stumps(*leaves, **options):
    """A tree with two leaves for each pair."""
    frame = random_trees(np.random.default_rng(0), features=1, trees=1, splits=0, comparison=Comparison.LESS_OR_EQUAL)
    n = len(leaves)
    return dataclasses.replace(
        frame,
        roots=3 * np.arange(n),
        split=[0, -1, -1] * n,
        threshold=[0.5, 0.0, 0.0] * n,
        left=np.ravel([[3 * i + 1, -1, -1] for i in range(n)]),
        right=np.ravel([[3 * i + 2, -1, -1] for i in range(n)]),
        missing_left=[False] * 3 * n,
        leaf=np.ravel([[-1, 2 * i, 2 * i + 1] for i in range(n)]),
        leaf_value=np.reshape(leaves, (2 * n, 1)),
        tree_output=[0] * n,
        base=[0.0],
        **options,
    )


def test_the_limit_of_trees_is_that_of_their_sum():
    """One tree with a leaf near the largest number is no reason to refuse, nor are many trees with small ones."""
    fine = model(stumps((3.6e300, -1.0), *[(1.0, 2.0)] * 500))
    assert limit_inputs(fine) == fine
    with pytest.raises(InputError, match=r"a result beyond 1e\+305, or one in float32 beyond 3e\+38, is"):
        limit_inputs(model(stumps((9e304, 1.0), (-9e304, 1.0))))


def test_inputs_that_no_arithmetic_reads_have_no_limit():
    limited = limit_inputs(model(Select((0,), [1]), Linear((1,), [[1e200]], [0.0]), n=3))
    assert limited.magnitude_limits == (None, 1e105, None)


def test_of_limits_of_exponentials_the_one_that_leaves_the_widest_range_is_taken():
    """Two layers of exponentials: a large limit of the first one would leave next to nothing for the second."""
    deep = model(
        Linear((0,), [[1e-3, 0.0], [0.0, 1e-3]], [0.0, 0.0]),
        Activation((1,), Function.EXP, 2),
        Linear((2,), [[1e-250, 1e-250]], [0.0]),
        Activation((3,), Function.EXP, 1),
        Linear((4,), [[1.0]], [0.0]),
    )
    limited = limit_inputs(deep)
    widest = [limit for limit in limited.magnitude_limits if limit is not None]
    assert min(widest) >= 1e37
    x = np.array([[1.0, 2.0], [-3e36, 3e36], [9e36, -9e36]])
    assert np.isfinite(reference.evaluate(limited, x)[0]).all()


@pytest.mark.parametrize("aggregate", Aggregate)
@pytest.mark.parametrize("base_last", [False, True])
def test_the_ends_of_trees_are_reached_and_bound_their_numbers(aggregate, base_last):
    """Each tree decides by a column of its own, so that every choice of leaves occurs."""
    op = random_trees(np.random.default_rng(0), trees=3, splits=1, comparison=Comparison.LESS)
    columns = np.where(op.split >= 0, np.cumsum(op.split >= 0) - 1, -1)
    changes = {"aggregate": aggregate, "base_last": base_last, "divisor": 4.0, "base": np.array([3.0])}
    op = dataclasses.replace(op, split=columns, **changes)
    values = reference.evaluate(model(op, n=3), np.array(list(itertools.product([-1e9, 1e9], repeat=3))))
    smallest, largest = ends_of(op)
    np.testing.assert_allclose([values.min(), values.max()], [smallest[0], largest[0]], rtol=1e-15)
    (bound,) = magnitudes(op, [])[1]
    assert np.abs(values).max() <= bound * (1 + 1e-15) and bound <= 3 * np.abs(values).max()
