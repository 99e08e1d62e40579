"""Factored kernels: within the bound that is derived for them, in the reference and in the emitted text."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.ir import FactoredKernel, Kernel, KernelSum, Operator, Precision, Round, Scale, reference
from st_codegen.passes.domain import limit_inputs, magnitudes
from st_codegen.passes.kernels import factored, grid_of
from st_codegen.proof import bounds
from st_codegen.proof.probes import probe_rows
from tests.emit.test_emitted import run
from tests.examples import examples
from tests.models import model
from tests.passes.test_tables import SLOW


def kernel_on_grid(random, shape, outputs=1, kept=1.0, gamma=0.4, **options):
    """An RBF kernel whose support vectors are points of a grid."""
    axes = [np.sort(random.normal(size=n)) for n in shape]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(shape))
    vectors = grid[random.random(len(grid)) < kept]
    vectors = vectors if len(vectors) else grid[:1]
    return KernelSum(
        (options.pop("value", 0),),
        Kernel.RBF,
        vectors,
        random.normal(size=(outputs, len(vectors))),
        random.normal(size=outputs),
        gamma=gamma,
        **options,
    )


@pytest.mark.thorough
@examples(suppress_health_check=SLOW)
@given(
    seed=st.integers(0, 2**31),
    gamma=st.sampled_from([1e-6, 0.4, 30.0]),
    outputs=st.integers(1, 2),
    scaled=st.booleans(),
    target=st.sampled_from(["iec", "twincat"]),
)
def test_a_factored_kernel_stays_within_the_bound(seed, gamma, outputs, scaled, target, tmp_path_factory):
    random = np.random.default_rng(seed)
    shape = (5, 3, 4)
    if scaled:
        ops = [
            Scale((0,), Operator.DIVIDE, [2.0, 0.5, 3.0]),
            kernel_on_grid(random, shape, outputs, 0.8, gamma, value=1),
        ]
    else:
        ops = [kernel_on_grid(random, shape, outputs, 0.8, gamma)]
    made = limit_inputs(model(*ops))
    new = factored(made)
    assert isinstance(new.ops[-1], FactoredKernel)
    x = probe_rows(made, 120, seed)
    expected = reference.evaluate(made, x)
    bound = bounds.difference_bound(made, x)
    for got in (reference.evaluate(new, x), run(new, target, tmp_path_factory.mktemp("kernel"), x)):
        assert np.array_equal(np.isnan(expected), np.isnan(got))
        near = np.isfinite(expected)
        assert np.all(np.abs(expected - got)[near] <= bound[near])
    inside = np.all(np.abs(x) < 3, axis=1)
    assert np.max(bound[inside]) < 1e-11


def test_no_number_of_a_factored_kernel_is_larger_than_its_magnitude():
    """Inputs up to 5 and 6, points up to 1 and 2 away from zero: 2 * (6 + 2)**2, and 3 + 4 kernels of at most 1."""
    op = FactoredKernel((0,), (0, 1), (np.array([0.0, 1.0]), np.array([-2.0])), [[3.0, -4.0]], [-0.5], gamma=2.0)
    assert magnitudes(op, [np.array([5.0, 6.0])]) == (128.0, [7.5])


def test_the_bound_knows_of_the_factors():
    """More factors, more roundings: the bound of a kernel on a grid is larger than that of the same sum off it."""
    random = np.random.default_rng(0)
    on_grid = kernel_on_grid(random, (5, 4, 3))
    off_grid = KernelSum(
        (0,),
        Kernel.RBF,
        on_grid.support_vectors + 1e-9 * random.normal(size=on_grid.support_vectors.shape),
        on_grid.coefficients,
        on_grid.intercept,
        gamma=on_grid.gamma,
    )
    x = random.normal(size=(20, 3))
    assert grid_of(on_grid) is not None
    assert grid_of(off_grid) is None
    one, other = (bounds.difference_bound(model(op), x) for op in (on_grid, off_grid))
    assert np.all(one > other)
    assert np.all(one < 5 * other)


@pytest.mark.parametrize("kept", [1.0, 0.05])
def test_a_sparse_grid_is_left_alone(kept):
    op = kernel_on_grid(np.random.default_rng(1), (12, 12, 12), kept=kept)
    assert (factored(model(op)) is None) == (kept < 0.1)


def test_other_kernels_are_left_alone():
    op = KernelSum((0,), Kernel.LINEAR, np.ones((4, 3)), np.ones((1, 4)), [0.0])
    assert factored(model(op)) is None


def test_float32_kernels_are_rounded_once():
    op = kernel_on_grid(np.random.default_rng(2), (5, 4, 3), precision=Precision.FLOAT32, value=1)
    made = limit_inputs(model(Round((0,), 3), op))
    x = np.random.default_rng(3).normal(size=(50, 3))
    expected, got = reference.evaluate(made, x), reference.evaluate(factored(made), x)
    assert np.array_equal(got.astype(np.float32), got)
    assert np.all(np.abs(expected - got) <= bounds.difference_bound(made, x))
