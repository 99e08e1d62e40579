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
    CoupledPairs,
    Function,
    Kernel,
    KernelSum,
    Linear,
    Operator,
    Piecewise,
    Precision,
    Scale,
    Select,
    Softmax,
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


def test_where_a_number_is_surely_below_zero_nothing_of_its_error_is_left():
    """Slopes on either side of 0 are those of the function there."""
    for function, below in ((Function.RELU, 0.0), (Function.LEAKY_RELU, 0.25)):
        unsure = Linear((0,), [[1.0, 1.0, 1.0]], [0.0])
        behind = model(unsure, Activation((1,), function, 1, 0.25))
        x = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], [1.0, 1.0, -2.0]])
        bound, moved = difference_bound(behind, x)[:, 0], difference_bound(model(unsure), x)[:, 0]
        assert moved[0] * below <= bound[0] <= moved[0] * below * 1.5
        assert np.all(bound[1:] >= moved[1:])


def test_a_product_of_what_differs_may_lose_a_digit_below_the_normal_numbers():
    unsure = Linear((0,), [[1.0, 1.0, 1.0]], [0.0])
    behind = model(unsure, Scale((1,), Operator.MULTIPLY, [1e-320]))
    assert difference_bound(behind, np.array([[0.1, 0.2, 0.3]])) >= 2.0**-1074


def test_a_line_between_two_knots_may_be_computed_from_either():
    op = Piecewise((0,), [0, 2], [0.0, 1.0], [0.1, 0.7], [[0.1, 0.0], [0.1, 0.6], [0.7, 0.0]])
    x = np.random.default_rng(0).random((500, 1))
    values = reference.apply(op, [x])
    bound = step(op, [x], [np.zeros_like(x)], values)
    difference = np.abs(0.1 * (1 - x) + 0.7 * x - values)
    assert difference.max() > 0 and np.all(difference <= bound) and bound.max() < 1e-14


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
                # another choice is as far as its numbers are, another round as far as any shares; half of these weights
                # is reached by a rounding or not
                jumps = isinstance(op, ArgMax | CoupledPairs) or name == "median in float32"
                assert jumps or not np.any(worst) or np.mean(bound[known]) <= 10 * np.mean(worst[known])


#: Roundings mostly cancel, which no bound may count on; an operator that is wrong is off by 2**24.
FAR = 1000


def kernel_sum(op, x, number, order):
    """The sum of kernels in a format of numbers, its vectors and columns in some order."""
    total = np.full(len(x), op.intercept[0], number)
    for vector, coefficient in zip(op.support_vectors.astype(number), op.coefficients[0].astype(number), strict=True):
        one, other = x.astype(number)[:, order], vector[order]
        inner = [
            sum(a * b for a, b in zip(left, right, strict=True))
            for left, right in ((one.T, other), (one.T, one.T), (other, other), ((one - other).T, (one - other).T))
        ]
        distance = inner[1] - number(2) * inner[0] + inner[2] if op.expands else inner[3]
        argument = number(op.gamma) * inner[0] + number(op.coef0)
        kernel = {
            Kernel.RBF: lambda d=distance: np.exp(number(-op.gamma) * d),
            Kernel.LINEAR: lambda p=inner[0]: p,
            Kernel.POLYNOMIAL: lambda a=argument: a * a * a,
            Kernel.SIGMOID: lambda a=argument: np.tanh(a),
        }[op.kernel]()
        total = total + coefficient * kernel
    return total.astype(np.float64)


@pytest.mark.parametrize("expands", [False, True])
@pytest.mark.parametrize("kernel", Kernel)
def test_a_sum_of_kernels_in_float32_is_within_its_bound_of_the_exact_one_which_is_not_far(kernel, expands):
    random = np.random.default_rng(2)
    around = 20.0 if expands else 0.0
    vectors, x, coefficients, intercept = (
        np.float64(np.float32(random.normal(size=shape))) for shape in ((6, 3), (400, 3), (1, 6), 1)
    )
    vectors, x = (np.float64(np.float32(numbers + around)) for numbers in (vectors, x))
    gamma = 0.25 if kernel is Kernel.RBF else 0.25 / (1 + around**2)
    op = KernelSum((0,), kernel, vectors, coefficients, intercept, gamma=gamma, precision=Precision.FLOAT32)
    op = dataclasses.replace(op, expands=expands, coef0=0.5)
    exact = kernel_sum(dataclasses.replace(op, expands=False), x, np.longdouble, [0, 1, 2])
    bound = step(op, [x], [np.zeros_like(x)], exact[:, None])[:, 0]
    orders = itertools.permutations(range(3))
    worst = np.max([np.abs(kernel_sum(op, x, np.float32, list(order)) - exact) for order in orders], axis=0)
    assert np.all(worst <= bound)
    assert np.mean(bound) <= FAR * np.mean(worst)


@pytest.mark.parametrize("terms", [3, 40])
def test_a_sum_of_products_in_float32_is_within_its_bound_of_the_exact_one_which_is_not_far(terms):
    random = np.random.default_rng(3)
    weights, x = (np.float64(np.float32(random.normal(size=shape))) for shape in ((1, terms), (400, terms)))
    exact = (x * weights).sum(axis=1) + 8.0
    op = Linear((0,), weights, [8.0], precision=Precision.FLOAT32)
    bound = step(op, [x], [np.zeros_like(x)], exact[:, None])[:, 0]
    worst = np.zeros(len(x))
    for _ in range(20):
        total = np.full(len(x), 8.0, np.float32)
        for column in random.permutation(terms):
            total = total + np.float32(weights[0, column]) * x[:, column].astype(np.float32)
        worst = np.maximum(worst, np.abs(total - exact))
    assert np.all(worst <= bound)
    assert np.mean(bound) <= FAR * np.mean(worst)


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


@pytest.mark.parametrize(("base", "divisor", "base_last"), [(0.0, 1.0, False), (50.25, 3.0, False), (50.25, 3.0, True)])
def test_leaves_that_are_summed_in_real_lose_no_more_than_their_bound_which_is_not_far(base, divisor, base_last):
    op = random_trees(np.random.default_rng(4), trees=4, splits=3, comparison=Comparison.LESS)
    leaves = op.leaf_value.astype(np.float32)
    op = dataclasses.replace(op, leaf_value=leaves, base=[base], divisor=divisor, base_last=base_last)
    op = dataclasses.replace(op, sum_precision=Precision.REAL)
    x = np.zeros((1, 3))
    bound = step(op, [x], [x], np.zeros((1, 1)))[0, 0]
    stops = [*op.roots[1:], op.n_nodes]
    leaves = [op.leaf_value[op.leaf[a:b][op.split[a:b] < 0], 0] for a, b in zip(op.roots, stops, strict=True)]
    worst = 0.0
    for chosen in itertools.product(*leaves):
        exact, single = (
            sum(map(number, chosen), number(0.0 if base_last else base)) / number(divisor)
            + number(base if base_last else 0.0)
            for number in (np.float64, np.float32)
        )
        worst = max(worst, abs(float(exact) - float(single)))
    assert worst <= bound <= FAR * worst


def test_a_share_in_float32_below_the_normal_numbers_may_be_nothing():
    """onnxruntime takes 0 for it on some processors; the bound was that of a number with fewer digits."""
    ir = model(Softmax((0,), 3, precision=Precision.FLOAT32))
    x = np.array([[0.0, -90.0, -95.0]])
    values, bound = reference.evaluate(ir, x)[0], difference_bound(ir, x)[0]
    tiny = np.finfo(np.float32).tiny
    assert (values[1:] > 0).all() and (values[1:] < tiny).all()
    assert (values[1:] <= bound[1:]).all() and (bound[1:] < 5 * tiny).all()


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_bound_on_coupled_pairs_covers_other_pairs(count):
    """Also of pairs next to 0 and 1, where a step of the iteration grows by 1e14."""
    rng, op = np.random.default_rng(count), CoupledPairs((0,), count)
    pairs = 1 / (1 + np.exp(rng.normal(size=(400, op.operand_width)) * rng.choice([0.1, 2.0, 9.0], (400, 1))))
    pairs[::7] = rng.choice([1e-7, 1 - 1e-7, 0.5], pairs[::7].shape)
    pairs = np.clip(pairs, 1e-7, 1 - 1e-7)
    result = reference.apply(op, [pairs])
    np.testing.assert_allclose(result.sum(axis=1), 1.0, rtol=1e-9)
    seen = 0.0
    for size in (0.0, 1e-16, 1e-13, 1e-9):
        given = np.full(pairs.shape, size) * np.minimum(pairs, 1 - pairs)
        bound = step(op, [pairs], [given], result)
        assert np.mean(bound < 1.0) > 0.95
        for _ in range(5):
            other = pairs + given * rng.uniform(-1, 1, pairs.shape)
            difference = np.abs(reference.apply(op, [other]) - result)
            assert np.all(difference <= bound)
            seen = max(seen, np.max(difference[bound > 0] / bound[bound > 0]))
    assert seen > 0.1


def test_where_rounding_decides_of_another_round_the_bound_on_coupled_pairs_is_that_of_any_shares():
    """Of two classes with shares 0.5 + a the first check finds a / 2, of which 0.0025 is the last that goes on."""
    op = CoupledPairs((0,), 2)
    pairs = np.array([[0.5 + 2 * op.epsilon], [0.5 + 2 * op.epsilon + 1e-9], [0.5]])
    bound = step(op, [pairs], [np.full((3, 1), 1e-15)], reference.apply(op, [pairs]))
    assert np.all(bound[0] == 1.0) and np.all(bound[1:] < 1e-9)
