import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError
from st_codegen.ir import (
    Activation,
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
    Source,
    reference,
)
from st_codegen.passes.domain import limit_inputs
from tests.examples import examples

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
    exponential = function in (Function.EXP, Function.EXPM1)
    for number, value in enumerate(values):
        if number >= 2 and (exponential or function is Function.LOG1P):
            break  # guarded at run time
        assert np.all(np.isfinite(value))


def test_models_that_only_compare_take_everything():
    assert limit_inputs(model(Scale((0,), Operator.ADD, [0.0, 0.0]))).magnitude_limits == (1e300, 1e300)


def test_float32_models_are_limited_to_float32():
    limited = limit_inputs(model(Round((0,), 2), Scale((1,), Operator.MULTIPLY, [1e10, 1.0], Precision.FLOAT32)))
    assert limited.magnitude_limits == (1e28, 1e28)


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


def test_a_model_that_always_overflows_is_refused():
    huge = model(Linear((0,), [[1e300, 1e300]], [0.0]), Linear((1,), [[1e300]], [0.0]))
    with pytest.raises(InputError, match="overflows for inputs of magnitude 1"):
        limit_inputs(huge)


def test_a_declared_range_beyond_the_limit_is_refused():
    steep = model(Linear((0,), [[1e290, 0.0]], [0.0]))
    ranged = dataclasses.replace(steep, features=(Feature("a", "", -1e20, 1e20), Feature("b", "", 0, 1)))
    with pytest.raises(InputError, match="feature 'a': within the range"):
        limit_inputs(ranged)
