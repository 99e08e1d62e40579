"""How far two correct evaluations of a model may lie apart, derived row by row from the model and the input.

Trees, scalers and other exact operations give equal bits for equal inputs. Sums whose order a library leaves open
(BLAS) and transcendental functions do not; standard forward error analysis bounds the difference. With unit roundoff
u, a sum of n terms in any order, fused or not, has an error of at most gamma(n) * sum of |terms|, gamma(n) = n*u / (1
- n*u) (Higham, Accuracy and Stability of Numerical Algorithms, section 4.2). Both evaluations err, so their errors
add.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import singledispatch
from typing import Literal

import numpy as np

from st_codegen import ir
from st_codegen.ir import reference
from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.ir.base import LEAST_SHARE
from st_codegen.ir.trees import added_up, of_each_tree
from st_codegen.passes.kernels import grid_of
from st_codegen.proof.coupling import coupled_difference

#: Unit roundoff of each precision.
UNIT = {ir.Precision.FLOAT64: 2.0**-53, ir.Precision.FLOAT32: 2.0**-24}
#: An operation in REAL is rounded, and so was the coefficient that it reads.
UNIT[ir.Precision.REAL] = (1.0 + UNIT[ir.Precision.FLOAT32]) ** 2 - 1.0

#: Relative error of one transcendental function, in units of roundoff: libraries document up to 4 ulp (8 u) for their
#: vectorised versions; the generated formulas have at most 8 roundings besides one EXP, LN or quotient of 2 ulp.
FUNCTION_ROUNDINGS = 12

#: How far the generated formula for erf lies from it, beside its roundings.
ERF_FORMULA = 2e-10

#: Roundings of a normal quantile beside those of other functions. Its polynomials take sixteen each, of terms of up to
#: 47 times their sum, and make at most a sixth of it (half of it, with terms of up to 9 times the sum, in the tails):
#: some 170 units in each of two evaluations, where other functions count 24 in both.
QUANTILE_TERMS = 20.0

#: onnxruntime's Tanh is x * p(x * x) / q(x * x) with p and q of 0.0049 at 0 (core/mlas/lib/tanh.cpp): where x * p lies
#: below the normal numbers, half a unit that is lost there grows by 1 / q.
TANH_FORMULA = 2.0**-150 / 0.00489

#: What is lost by taking 0 for exponentials below exp(-708).
_TINY = 1e-307

#: What two evaluations of a small exponential may differ by beyond their relative error, where it has lost digits; in
#: float32 the smallest normal number, since onnxruntime takes 0 for what lies below it on some processors.
_SMALLEST = {ir.Precision.FLOAT64: _TINY, ir.Precision.FLOAT32: 2.0**-126}
#: In REAL 0 is taken for exponentials below exp(-87).
_SMALLEST[ir.Precision.REAL] = 2e-38
#: What an operation in REAL and the coefficient that it reads may lose below the normal numbers.
_UNDERFLOW = {ir.Precision.FLOAT64: 0.0, ir.Precision.FLOAT32: 0.0, ir.Precision.REAL: 2.0**-148}
#: What two evaluations of a product may differ by where it lies below the normal numbers: half a unit each.
_LOST_PRODUCT = _UNDERFLOW | {ir.Precision.FLOAT64: 2.0**-1074, ir.Precision.FLOAT32: 2.0**-149}


def difference_bound(model: ir.ModelIR, x: FloatArray) -> FloatArray:
    """Bound on |library - generated code| for rows of `x` (rows, features), shape (rows, outputs).

    0 where the result must be equal to the bit; infinite where rounding may send a row through another leaf of a tree
    behind an inexact operation and no finite bound holds.
    """
    if model.exact:
        return np.zeros((len(x), len(model.outputs)))
    return differences(model, x)[-1]


def text_bound(model: ir.ModelIR, x: FloatArray) -> FloatArray:
    """Bound on |reference - generated code|, for the same rows: what a controller's own EXP and its like may change.

    In LREAL it is that on |library - generated code|. In REAL the reference rounds as the text does, step by step, so
    that nothing but such functions leaves a difference.
    """
    if not model.is_real:
        return difference_bound(model, x)
    return differences(model, x, of_texts=True)[-1]


def _has_one_result(op: ir.Operation) -> bool:
    """Whether text of an operation in REAL has one result only: it calls nothing that controllers compute as they like.

    Formulas of several operations in one statement count among what they compute as they like.
    """
    if isinstance(op, ir.Activation):
        return op.function in (ir.Function.IDENTITY, ir.Function.RELU, ir.Function.LEAKY_RELU, ir.Function.ABS)
    if isinstance(op, ir.KernelSum):
        return op.kernel in (ir.Kernel.LINEAR, ir.Kernel.POLYNOMIAL)
    return not isinstance(op, ir.Softmax)


def differences(model: ir.ModelIR, x: FloatArray, *, of_texts: bool = False) -> list[FloatArray]:
    """The bound for all values of a model: the inputs, then the result of each operation, each (rows, width).

    `of_texts`: between two evaluations of the text, which err in what has no one result alone.
    """
    values = reference.trace(model, x)
    with np.errstate(all="ignore"):
        return _behind(model.ops, values, np.zeros_like(values[0]), of_texts=of_texts)


def _is_root_from_zero(op: ir.Operation, ops: Sequence[ir.Operation]) -> bool:
    """Whether an operation is the square root of magnitudes, or of numbers that were limited to 0 and above."""
    if not isinstance(op, ir.Activation) or op.function is not ir.Function.SQRT or op.precision is ir.Precision.REAL:
        return False
    before = ops[op.inputs[0] - 1] if op.inputs[0] else None
    if isinstance(before, ir.Activation):
        return before.function is ir.Function.ABS
    return isinstance(before, ir.Clip) and bool(np.all(before.lower >= 0))


def _behind(
    ops: Sequence[ir.Operation], values: list[FloatArray], first: FloatArray, *, of_texts: bool = False
) -> list[FloatArray]:
    """The bounds on all values, `first` being that on value 0."""
    found = [first]
    for number, op in enumerate(ops, 1):
        operands = [values[value] for value in op.inputs]
        given = [found[value] for value in op.inputs]
        difference = step(op, operands, given, values[number])
        if _is_root_from_zero(op, ops):  # |sqrt(a) - sqrt(b)| <= sqrt(|a - b|), where the slope has no bound
            moved = np.sqrt(given[0])
            unit = UNIT[getattr(op, "precision", ir.Precision.FLOAT64)]
            rounded = 2 * FUNCTION_ROUNDINGS * unit * (values[number] + moved) + _TINY
            difference = np.fmin(difference, moved + rounded)
        if of_texts and _has_one_result(op):
            difference = np.where(np.any(np.hstack(given) > 0, axis=1, keepdims=True), difference, 0.0)
        found.append(np.where(np.isnan(difference), np.inf, difference))
    return found


def gamma(terms: int, precision: ir.Precision) -> float:
    """Relative error of a sum of so many terms, in any order."""
    unit = UNIT[precision]
    return terms * unit / (1.0 - terms * unit)


def _rounding(op: ir.Operation, result: FloatArray, difference: FloatArray) -> FloatArray:
    """Rounding after one exact elementwise operation: equal inputs round to equal results, others add an error each.

    In REAL the library rounds nothing that counts, so that equal inputs have other results, too.
    """
    precision = getattr(op, "precision", ir.Precision.FLOAT64)
    unit = UNIT[precision]
    if precision is ir.Precision.REAL:
        return np.asarray(difference * (1 + unit) + unit * (np.abs(result) + difference) + _UNDERFLOW[precision])
    rounded = difference * (1 + unit) + 2 * unit * (np.abs(result) + difference) + _LOST_PRODUCT[precision]
    return np.where(difference > 0, rounded, 0.0)


@singledispatch
def step(op: ir.Operation, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    """Bound on the difference of the results when the operands differ by at most `given`."""
    raise NotImplementedError(type(op).__name__)


@step.register
def _(op: ir.Select, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    return np.hstack(given)[:, op.columns]


@step.register
def _(op: ir.Scale, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    constant = np.broadcast_to(op.constant, operands[0].shape)
    zero = np.zeros_like(given[0]) if op.doubt is None else np.broadcast_to(op.doubt, given[0].shape)
    pair, errors = (
        ([constant, operands[0]], [zero, given[0]]) if op.reverse else ([operands[0], constant], [given[0], zero])
    )
    return _rounding(op, result, _arithmetic(op.operator, pair, errors))


@step.register
def _(op: ir.Combine, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    return _rounding(op, result, _arithmetic(op.operator, operands, given))


def _arithmetic(operator: ir.Operator, operands: list[FloatArray], given: list[FloatArray]) -> FloatArray:
    (a, b), (da, db) = operands, given
    if operator in (ir.Operator.ADD, ir.Operator.SUBTRACT):
        return da + db
    if operator is ir.Operator.MULTIPLY:
        product = np.abs(a) * db + np.abs(b) * da + da * db
        differs = (da + db > 0) & (np.abs(a) + da > 0) & (np.abs(b) + db > 0)
        product = np.where(differs, np.maximum(product, 2.0**-1074), product)
        return np.where(np.isnan(product) & (da + db > 0), np.inf, product)  # infinity times zero
    if operator in (ir.Operator.MAXIMUM, ir.Operator.MINIMUM):
        turned = 1.0 if operator is ir.Operator.MAXIMUM else -1.0
        middle = np.maximum(turned * a, turned * b)
        above, below = (np.maximum(turned * a + s * da, turned * b + s * db) for s in (1.0, -1.0))
        return np.asarray(np.maximum(above - middle, middle - below), np.float64)
    room = np.abs(b) - db
    return np.where(room > 0, (da + np.abs(a / b) * db) / room, np.inf) * (da + db > 0)


@step.register
def _(op: ir.Round, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    unit = UNIT[ir.Precision.FLOAT32]
    rounded = given[0] + 2 * unit * (np.abs(operands[0]) + given[0]) + _LOST_PRODUCT[ir.Precision.FLOAT32]
    return np.where(given[0] > 0, rounded, 0.0)


@step.register
def _(op: ir.ColumnFunction, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    moved = op.slope(operands[0], given[0]) * given[0]
    return _rounding(op, result, moved) if op.computes else moved


@step.register
def _(op: ir.Piecewise, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    moved = np.where(given[0] > 0, op.slope(operands[0], given[0]) * given[0], 0.0)
    # a power of the argument, by whatever formula: no more than sixteen roundings, of numbers as large as its terms
    return moved + 2 * gamma(16 * (op.degree + 1), ir.Precision.FLOAT64) * (op.terms(operands[0]) + moved) * op.computes


@step.register
def _(op: ir.ArgMax, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, difference = operands[0], given[0]
    rows = np.arange(len(x))
    chosen = result[:, 0].astype(np.int64)
    ahead = x[rows, chosen][:, None] - x
    moved = difference + (np.max(difference, axis=1) if op.merged else difference[rows, chosen])[:, None]
    near = (np.abs(ahead) - 2 * op.merged <= moved) & (moved > 0)
    # a column before the chosen one that the library may take for equal to the largest
    below = np.max(x, axis=1, keepdims=True) - x
    near |= (below > op.merged) & (below <= op.open_below) & (np.arange(op.n_columns) < chosen[:, None])
    near[rows, chosen] = False
    return np.where(np.any(near, axis=1, keepdims=True), op.n_columns - 1.0, 0.0)


@step.register
def _(op: ir.Softmax, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    # each exponent may be off by what its operand is, and by the roundings of x - max (or of x - log of the sum), whose
    # size is that of the largest operand and of how far x lies below it
    unit = UNIT[op.precision] + UNIT[ir.Precision.FLOAT64]
    largest = np.max(operands[0], axis=1, keepdims=True)
    rises, below = np.max(operands[0] + given[0], axis=1, keepdims=True) - largest, largest - operands[0]
    exponent = given[0] + 4 * unit * (np.abs(largest) + rises + below + given[0] + np.log(op.width))
    # the sum is off by what its terms are, each by its share of it: that far below hardly counts
    share = np.exp(-below) / np.sum(np.exp(-below), axis=1, keepdims=True)
    moved = np.sum(np.where(share > 0.0, share * np.expm1(exponent), 0.0), axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        total = np.where(moved < 1.0, -np.log1p(-np.minimum(moved, 1.0)), np.inf)
    total = np.minimum(total, np.max(exponent, axis=1, keepdims=True))
    rounding = (2 * FUNCTION_ROUNDINGS + op.width + 4) * unit
    if op.logarithm:  # what is relative to the sum is absolute in its logarithm, which is rounded itself
        logarithm: FloatArray = exponent + total + rounding * (1.0 + np.log(op.width)) + 2 * unit * np.abs(result)
        return logarithm
    relative = np.expm1(exponent + total) + rounding
    bound: FloatArray = np.minimum(relative * result + (op.width + 1) * _SMALLEST[op.precision], 1.0)
    return bound


@step.register
def _(op: ir.Linear, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    weights = np.abs(op.weights)
    difference = given[0] @ weights.T
    difference = np.where(np.isnan(difference), np.inf, difference)  # infinity times zero
    size = np.abs(operands[0]) @ weights.T + np.abs(op.bias)
    if op.exact:
        return np.where(difference > 0, difference + 2 * gamma(2 * op.operand_width + 1, op.precision) * size, 0.0)
    difference = difference + _UNDERFLOW[op.precision] * (np.sum(np.abs(operands[0]), axis=1, keepdims=True) + 1)
    if op.doubt is not None:
        difference = difference + (np.abs(operands[0]) + given[0]) @ op.doubt.T
    terms = op.operand_width + 1
    if op.bias_terms is not None:
        terms, size = terms + op.operand_width, size + op.bias_terms
    total: FloatArray = difference + sum_rounding(terms, size + difference, result, op.precision)
    return total


@step.register
def _(op: ir.SlidingLinear, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    weights, columns = np.abs(op.weights).T, op.columns
    moved = given[0][:, columns] @ weights
    moved = np.where(np.isnan(moved), np.inf, moved).reshape(result.shape)  # infinity times zero
    size = (np.abs(operands[0])[:, columns] @ weights + np.abs(op.bias)).reshape(result.shape)
    if op.exact:
        return moved
    return moved + sum_rounding(columns.shape[1] + 1, size + moved, result, op.precision)


@step.register
def _(op: ir.Scan, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    state, found = np.zeros((len(result), len(op.initial))), []
    for start, values in zip(op.starts.tolist(), reference.rounds(op, operands[0]), strict=True):
        state = _behind(op.body, values, np.hstack([given[0][:, start : start + op.columns], state]))[-1]
        found.append(state)
    return np.hstack(found)


def sum_rounding(terms: int, size: FloatArray, result: FloatArray, precision: ir.Precision) -> FloatArray:
    """One adds in a precision, the other in LREAL, with one rounding at the end where it is to equal float32."""
    library = gamma(terms, precision) * size
    generated = gamma(terms, ir.Precision.FLOAT64) * size
    last = UNIT[precision] * np.abs(result) if precision is ir.Precision.FLOAT32 else 0.0
    # of numbers that are all 0 nothing is lost
    lost = np.where(size > 0, terms * max(_LOST_PRODUCT[precision], 2 * _UNDERFLOW[precision]), 0.0)
    # in float32 a sum of some of the terms may be infinite where that of all is small
    room = ir.FLOAT32_OVERFLOW if precision is ir.Precision.FLOAT32 else np.inf
    return np.where(size + library < room, library + generated + last + lost, np.inf)


@step.register
def _(op: ir.Activation, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, difference = operands[0], given[0]
    moved = np.where(difference > 0, _slope(op, x, difference) * difference, 0.0)
    if op.exact:
        return _rounding(op, result, moved)
    roundings = FUNCTION_ROUNDINGS * (UNIT[op.precision] + UNIT[ir.Precision.FLOAT64])
    # libraries lose digits where they take 1 - y or exp(x) - 1 instead of the accurate form (onnxruntime's Sigmoid and
    # Elu), and softplus adds a part of up to log(2): the error is then one of a number of this size
    size = np.abs(result) + moved
    if op.function in (ir.Function.LOGISTIC, ir.Function.SOFTPLUS, ir.Function.SIN, ir.Function.COS, ir.Function.ERF):
        size = size + 1.0
    elif op.function is ir.Function.ELU:
        size = size + abs(op.parameter)
    elif op.function is ir.Function.GELU:
        size = np.abs(x) + moved
    elif op.function is ir.Function.NORMAL_QUANTILE:
        size = QUANTILE_TERMS * size
    formula = ERF_FORMULA if op.function in (ir.Function.ERF, ir.Function.GELU) else 0.0
    if op.function is ir.Function.POWER:  # the roundings of the argument of its exponential
        argument = np.abs(op.parameter * np.log(np.where(x == 0, 1.0, np.abs(x))))
        lost = np.expm1(8 * UNIT[ir.Precision.FLOAT64] * argument)
        power: FloatArray = moved + (roundings + lost) * size + _SMALLEST[op.precision]
        return power
    below = _SMALLEST[op.precision]
    if op.function is ir.Function.TANH and op.precision is ir.Precision.FLOAT32:
        below += TANH_FORMULA
    return moved + (roundings + formula) * size + below


#: The largest slopes of functions that are not as steep as the identity, or steeper.
_STEEPEST = {ir.Function.LOGISTIC: 0.25, ir.Function.ERF: 1.13, ir.Function.GELU: 1.13}


def _slope_of_quantile(x: FloatArray, difference: FloatArray) -> FloatArray:
    """That of the quantile of the largest magnitude within `difference` of x."""
    share = np.minimum(x, 1.0 - x) - difference
    end = reference.normal_quantile(np.where(share >= LEAST_SHARE, share, np.nan))
    slope = math.sqrt(2.0 * math.pi) * np.exp(end * end / 2.0) * (1.0 + 1e-9)
    return np.where(np.isnan(slope), np.inf, slope)


def _slope(op: ir.Activation, x: FloatArray, difference: FloatArray) -> FloatArray:  # noqa: PLR0911 - one a function
    """Largest slope of the function within `difference` of x."""
    near = np.abs(x) + difference
    if op.function in (ir.Function.EXP, ir.Function.EXPM1):
        return np.exp(x + difference)
    if op.function in (ir.Function.SQRT, ir.Function.LOG, ir.Function.LOG1P):
        room = x - difference + (op.function is ir.Function.LOG1P)
        slope = 0.5 / np.sqrt(room) if op.function is ir.Function.SQRT else 1.0 / room
        return np.where(room > 0, slope, np.where(difference > 0, np.inf, 0.0))
    if op.function is ir.Function.SIGNED_SQUARE:
        return 2.0 * near
    if op.function is ir.Function.POWER:
        steepest = near if op.parameter >= 1 else np.abs(x) - difference
        return np.where(steepest > 0, np.abs(op.parameter) * np.abs(steepest) ** (op.parameter - 1), np.inf)
    if op.function in (ir.Function.RELU, ir.Function.LEAKY_RELU):  # one slope on either side of 0
        below = 0.0 if op.function is ir.Function.RELU else abs(op.parameter)
        return np.where(x + difference <= 0, below, max(1.0, below))
    if op.function is ir.Function.NORMAL_QUANTILE:
        return _slope_of_quantile(x, difference)
    elu = op.function is ir.Function.ELU
    return np.full_like(x, max(1.0, abs(op.parameter)) if elu else _STEEPEST.get(op.function, 1.0))


@step.register
def _(op: ir.Normalize, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, difference = operands[0], given[0]
    if op.norm is ir.Norm.MAX:
        size = np.abs(np.max(x, axis=1, keepdims=True))
        moved = np.max(difference, axis=1, keepdims=True)
    else:
        size = (
            np.sum(np.abs(x), axis=1, keepdims=True)
            if op.norm is ir.Norm.L1
            else np.linalg.norm(x, axis=1, keepdims=True)
        )
        moved = np.sum(difference, axis=1, keepdims=True)
    room = size - moved
    change = np.where(room > 0, (difference + np.abs(result) * moved) / room, np.inf)
    return np.where(moved > 0, change + 2 * gamma(op.width + 5, op.precision) * (np.abs(result) + change), 0.0)


@step.register
def _(op: ir.KernelSum, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, moved = operands[0], given[0]

    def kernel(vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return reference.kernel_value(op, x, vector), np.abs(x), np.abs(x - vector)

    return kernel_difference(op, kernel, moved, result)


def kernel_difference(
    op: ir.KernelSum,
    kernel: Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]],
    moved: FloatArray,
    result: FloatArray,
) -> FloatArray:
    """The difference of two evaluations of a sum of kernels whose operands differ by at most `moved`.

    `kernel` gives for a vector the kernel of each row, the magnitudes of its numbers and their distances from the
    vector, or the largest that these can be.
    """
    size = np.broadcast_to(np.abs(op.intercept), result.shape).copy()
    difference = np.zeros_like(size)
    # generated code may take an exponential a column and multiply; then products and the sums over the columns of a
    # grid are rounded too
    axes = grid_of(op)
    factors = 1 if axes is None else len(axes)
    terms = len(op.support_vectors) + 1
    if axes is not None:
        terms = max(terms, sum(map(len, axes)) + 2 * factors + 1)
    for vector, coefficients in zip(op.support_vectors, np.abs(op.coefficients.T), strict=True):
        value, x, delta = kernel(vector)
        change = _kernel_change(op, np.abs(value), x, delta, moved, np.abs(vector), factors)
        size += (np.abs(value) + change)[:, None] * coefficients
        difference += change[:, None] * coefficients
    difference += _LOST_PRODUCT[op.precision] * len(op.support_vectors)  # each kernel times its coefficient
    return difference + sum_rounding(terms, size, result, op.precision)


def _kernel_change(
    op: ir.KernelSum,
    kernel: FloatArray,
    x: FloatArray,
    delta: FloatArray,
    moved: FloatArray,
    vector: FloatArray,
    factors: int,
) -> FloatArray:
    """The difference of two evaluations of a kernel; `x` and `vector` are magnitudes.

    One of them may be a product of `factors` exponentials: each has the error of a function, each product one rounding.
    """
    terms = len(vector)
    both = gamma(terms + 4, op.precision) + gamma(terms + 4, ir.Precision.FLOAT64)
    function = FUNCTION_ROUNDINGS * (UNIT[op.precision] + UNIT[ir.Precision.FLOAT64])
    if op.kernel is ir.Kernel.RBF:
        lost = np.sum(np.square(x + vector) if op.expands else delta**2, axis=1)
        argument = op.gamma * (both * lost + np.sum(2 * delta * moved + moved**2, axis=1))
        function += (factors - 1) * (FUNCTION_ROUNDINGS + 1) * UNIT[ir.Precision.FLOAT64]
        tiny = max(_TINY, _SMALLEST[op.precision] * (op.precision is ir.Precision.REAL))
        return np.asarray(kernel * (np.expm1(argument) + function) + factors * tiny)
    size = np.sum(x * vector, axis=1)
    change = both * size + np.sum(vector * moved, axis=1)
    lost = _LOST_PRODUCT[op.precision]
    change = change + lost * (np.sum(x, axis=1) + 2 * terms)
    if op.kernel is ir.Kernel.LINEAR:
        return np.asarray(change)
    base = np.abs(op.gamma) * size + abs(op.coef0)
    change = abs(op.gamma) * change + both * base + lost
    if op.kernel is ir.Kernel.SIGMOID:
        return np.asarray(change + function * kernel)
    larger = (base + change) ** op.degree
    # a product falls below the normal numbers only where all factors behind it are below 1, too
    return np.asarray(larger - base**op.degree + op.degree * (both * larger + lost))


@step.register
def _(op: ir.Distances, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, moved = operands[0], given[0]
    if op.largest:
        return _rounding(op, result, np.repeat(np.max(moved, axis=1, keepdims=True), op.width, axis=1))
    found = np.empty_like(result)
    both = 2 * gamma(op.operand_width + 4, ir.Precision.FLOAT64)
    for column, vector in enumerate(op.vectors):
        delta = np.abs(x - vector)
        lost, change = np.sum(delta, axis=1), np.sum(moved, axis=1)
        if op.squared:
            lost = np.sum(np.square(np.abs(x) + np.abs(vector) if op.expands else delta), axis=1)
            change = np.sum(2 * delta * moved + moved**2, axis=1)
        same = (result[:, column] == 0) & (change == 0) & (lost == 0)
        apart = np.where(same, 0.0, change + both * (lost + change) + _TINY)
        if op.root:  # |sqrt(a) - sqrt(b)| is below sqrt(|a - b|), and below |a - b| / sqrt(a)
            own = result[:, column]
            apart = np.where(apart > 0, apart / np.maximum(own, np.sqrt(apart)), 0.0) * (1.0 + 1e-15)
            apart = apart + np.where(same, 0.0, 2 * FUNCTION_ROUNDINGS * UNIT[ir.Precision.FLOAT64] * (own + apart))
        found[:, column] = apart
    return found


@step.register
def _(op: ir.NearestMean, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, moved = operands[0], given[0]
    low, high = x - moved, x + moved
    found = np.empty_like(result)
    factors, unsure = (operands[1], given[1]) if len(operands) > 1 else (np.ones_like(x), np.zeros_like(x))
    largest = np.max(np.abs(op.values) * (np.abs(factors) + unsure)[:, None, :], axis=2)
    for row in range(len(x)):
        if not np.all(np.isfinite([low[row], high[row]])):
            found[row] = np.inf
            continue
        # how many columns may stand before each one, itself included, and how many surely do
        may = np.searchsorted(np.sort(low[row]), high[row], side="right")
        must = np.searchsorted(np.sort(high[row]), low[row], side="left")
        sure, possible = may <= op.count, must < op.count
        least, most = _range_of_mean(op, op.values * factors[row], low[row], high[row], sure, possible)
        moves = np.max((np.abs(op.values) * unsure[row])[:, possible], axis=1)
        if not op.divides:
            least, most, moves = least * op.count, most * op.count, moves * op.count
        found[row] = np.maximum(most - result[row], result[row] - least) + moves
    if not op.divides:
        largest = largest * op.count
    whole = len(operands) == 1 and np.array_equal(op.values, np.trunc(op.values))
    if op.inverse or not whole:  # whole numbers are added without rounding
        found += 2 * gamma(2 * op.count + 6, op.precision) * largest + _LOST_PRODUCT[op.precision]
    else:
        found = np.where(found <= 4 * UNIT[ir.Precision.FLOAT64] * largest, 0.0, found)
        if op.precision is ir.Precision.FLOAT32 and op.divides:  # the quotient is rounded
            found += 2 * UNIT[op.precision] * np.abs(result)
    return np.maximum(found, 0.0)


def _range_of_mean(
    op: ir.NearestMean, given: FloatArray, low: FloatArray, high: FloatArray, sure: BoolArray, possible: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """The least and the largest mean of `given`, for numbers of these intervals, of what surely and possibly counts."""
    values = given[:, possible]
    if not op.inverse:
        open_places = op.count - int(np.sum(sure))
        others = np.sort(given[:, possible & ~sure], axis=1)
        fixed = np.sum(given[:, sure], axis=1)
        least = fixed + np.sum(others[:, :open_places], axis=1)
        most = fixed + np.sum(others[:, others.shape[1] - open_places :], axis=1)
        return least / op.count, most / op.count
    ends = np.min(values, axis=1), np.max(values, axis=1)
    zero = high[possible] <= 0
    certain = not np.any((low[possible] <= 0) & ~zero) and np.all(sure[possible][zero])
    if certain and 0 < np.sum(zero) <= op.count:
        mean = np.mean(values[:, zero], axis=1)
        return mean, mean
    if np.any(low[possible] <= 1e-300) or np.any(sure != possible):
        return ends
    middle = (low + high)[possible] / 2
    share = float(np.max((high - low)[possible] / (2 * low[possible]))) + 4 * UNIT[ir.Precision.FLOAT64]
    if share >= 0.5:
        return ends
    weights = np.min(middle) / middle
    mean = values @ weights / np.sum(weights)
    room = 4 * share * (ends[1] - ends[0])
    return np.maximum(mean - room, ends[0]), np.minimum(mean + room, ends[1])


@step.register
def _(op: ir.CoupledPairs, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    """Where rounding may decide whether a further round follows, only that shares lie between 0 and 1 is known."""
    inside = np.all((operands[0] > given[0]) & (operands[0] + given[0] < 1.0), axis=1, keepdims=True)
    return np.where(inside, np.minimum(coupled_difference(op, operands[0], given[0]), 1.0), np.inf)


@step.register
def _(op: ir.WeightedMedian, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    x, moved = operands[0], np.max(given[0], axis=1)
    order = np.argsort(x, axis=1, kind="stable")
    rising, reached = np.take_along_axis(x, order, axis=1), reference.weights_reached(op, order)
    unsure = (moved > 0) | np.any(np.diff(rising, axis=1) == 0, axis=1)
    # another order of additions than this one reaches half of the weights before or behind it
    slack = np.where(unsure, 4 * gamma(len(op.weights), op.precision) * reached[:, -1], 0.0)[:, None]
    half = 0.5 * reached[:, -1:]
    first = np.argmax(reached + slack >= half, axis=1)
    last = np.where(np.any(reached - slack >= half, axis=1), np.argmax(reached - slack >= half, axis=1), x.shape[1] - 1)
    ends = [np.take_along_axis(rising, place[:, None], axis=1) for place in (first, last)]
    return np.asarray(moved[:, None] + np.maximum(result - ends[0], ends[1] - result), np.float64)


@step.register
def _(op: ir.FactoredKernel, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    return step(unfactored(op), operands, given, result)


def unfactored(op: ir.FactoredKernel) -> ir.KernelSum:
    """The kernel sum over all points of the grid that a factored kernel stands for."""
    columns = np.argsort(op.columns)
    points = np.stack(np.meshgrid(*op.axes, indexing="ij"), -1).reshape(-1, len(op.axes))[:, columns]
    return ir.KernelSum(
        op.inputs, ir.Kernel.RBF, points, op.coefficients, op.intercept, gamma=op.gamma, precision=op.precision
    )


@step.register(ir.Rank)
@step.register(ir.CellTable)
def _(op: ir.Operation, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    unsure = np.any(np.hstack(given) > 0, axis=1, keepdims=True)
    return np.where(unsure, np.inf, np.zeros_like(result))


@step.register
def _(op: ir.TreeEnsemble, operands: list[FloatArray], given: list[FloatArray], result: FloatArray) -> FloatArray:
    unsure = np.zeros(len(result), np.bool_)
    for number, column in enumerate(op.columns):
        difference = given[0][:, column.column]
        value = operands[0][:, column.column]
        if column.categorical or column.missing_interval is not None:
            unsure |= difference > 0
        else:
            unsure |= _crosses(op, number, value, difference)
    if op.linear is not None:
        unsure |= np.any(given[0] > 0, axis=1)
    spread = _leaf_spread(op)
    return np.where(unsure[:, None], spread, 0.0) + (_lost(op) if op.sum_precision is ir.Precision.REAL else 0.0)


def _lost(op: ir.TreeEnsemble) -> FloatArray:
    """How far the sum in REAL may lie from the library's in LREAL, for each output, whatever the inputs are.

    A leaf passes its own rounding, at most one addition a tree, that of the base and the division, here and in the
    library: (1 + u)**(trees + 4) - 1 of the magnitudes, u = 2**-24, holds for both together. Numbers below the normal
    ones are off by an absolute amount, at most once a leaf, once for the base and once in the division.
    """
    terms = op.n_trees + 4
    relative = np.expm1(terms * np.log1p(UNIT[ir.Precision.FLOAT32]))
    scale = min(abs(op.divisor), 1.0)  # a base that is added last is not divided
    leaves = added_up(op, of_each_tree(op, np.maximum, np.abs(op.leaf_value)))
    sums = leaves / abs(op.divisor) + np.abs(op.base) / (1.0 if op.base_last else scale)
    underflow = (terms / scale + 1.0) * 2.0**-150
    # the bound itself is computed with a few roundings
    return np.asarray(sums * relative * (1.0 + 1e-12) + underflow)


def _crosses(op: ir.TreeEnsemble, number: int, value: FloatArray, difference: FloatArray) -> BoolArray:
    """Whether a threshold of the column lies between the two ends of a value's interval."""
    thresholds = np.unique(op.threshold[op.split == number])
    side: Literal["left", "right"] = "right" if op.comparison is ir.Comparison.LESS else "left"
    low = reference.rounded(value - difference, op.input_precision)
    high = reference.rounded(value + difference, op.input_precision)
    crossed: BoolArray = np.searchsorted(thresholds, low, side) != np.searchsorted(thresholds, high, side)
    return crossed


def _leaf_spread(op: ir.TreeEnsemble) -> FloatArray:
    """The largest possible change of each output: every tree goes from its largest to its smallest leaf."""
    if op.linear is not None:
        return np.full(op.width, np.inf)
    high, low = (of_each_tree(op, extreme, op.leaf_value) for extreme in (np.maximum, np.minimum))
    spread, largest = high - low, max(float(np.max(np.abs(end))) for end in (high, low))
    rounding = 2 * gamma(op.n_trees + 2, op.sum_precision) * (np.abs(op.base) + op.n_trees * largest)
    bound: FloatArray = (added_up(op, spread) + rounding) / abs(op.divisor)
    return bound
