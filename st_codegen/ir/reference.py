"""Evaluates the intermediate representation in NumPy by the source library's exact rules.

This is the middle of the proof: library = reference pins an error on a walker, reference = emitted text pins it on the
back end. It shares no code with either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property, singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, IntArray
from st_codegen.ir.base import CENTRAL, CENTRAL_SHARE, COS_REACH, LEAST_SHARE, TAILS

#: What evaluates an operation on its operands, each (rows, width).
Evaluation = Callable[[ir.Operation, list[FloatArray]], FloatArray]


def evaluate(model: ir.ModelIR, x: FloatArray, by: Evaluation | None = None) -> FloatArray:
    """Predict rows of `x` (rows, features) -> (rows, outputs), each operation evaluated `by` a function or `apply`.

    A row that the library refuses (NaN where it takes none, too large a number), in which a number ceases to exist on
    the way (a logarithm of a negative number) or whose result is infinite gives NaN in every output.
    """
    x = limited(model, x)
    values = trace(model, x, by)
    usable = valid_rows(model, x)
    for op, result in zip(model.ops, values[1:], strict=True):
        usable &= ~_lost(op, result, [values[number] for number in op.inputs])
    usable &= np.all(np.isfinite(values[-1]), axis=1)
    return np.where(usable[:, None], values[-1], np.nan)


def _lost(op: ir.Operation, result: FloatArray, operands: list[FloatArray]) -> BoolArray:
    """Rows in which an operation made NaN of numbers; where columns stay apart, each for itself."""
    missing = [np.isnan(operand) for operand in operands]
    lost: BoolArray
    if isinstance(op, ir.Elementwise):
        lost = np.any(np.isnan(result) & ~np.any(missing, axis=0), axis=1)
        return lost
    lost = np.any(np.isnan(result), axis=1) & ~np.any(np.hstack(missing), axis=1)
    return lost


def limited(model: ir.ModelIR, x: FloatArray) -> FloatArray:
    """Rows as the generated block reads them, every feature limited to its declared range; NaN stays NaN."""
    lower = [-np.inf if feature.lower is None else feature.lower for feature in model.features]
    upper = [np.inf if feature.upper is None else feature.upper for feature in model.features]
    with np.errstate(over="ignore"):
        given = rounded(np.array(x, dtype=np.float64), ir.Precision.REAL if model.is_real else ir.Precision.FLOAT64)
    return np.clip(given, lower, upper)


def valid_rows(model: ir.ModelIR, x: FloatArray) -> BoolArray:
    """Which rows the source library accepts, shape (rows,)."""
    refused = np.isnan(x) & [not model.takes_nan(column) for column in range(x.shape[1])]
    for column, limit in enumerate(model.magnitude_limits):
        if limit is not None:
            refused[:, column] |= np.abs(x[:, column]) >= limit
    for column, interval in enumerate(model.accepted_numbers):
        if interval is not None:
            refused[:, column] |= (x[:, column] < interval[0]) | (x[:, column] > interval[1])
    accepted: BoolArray = ~np.any(refused, axis=1)
    return accepted


def trace(model: ir.ModelIR, x: FloatArray, by: Evaluation | None = None) -> list[FloatArray]:
    """All values of the model for rows of `x`: the inputs, then the result of each operation, each (rows, width)."""
    values = [np.array(x, dtype=np.float64)]
    with np.errstate(all="ignore"):
        for op in model.ops:
            values.append((by or apply)(op, [values[number] for number in op.inputs]))
    return values


def rounded(value: FloatArray, precision: ir.Precision) -> FloatArray:
    """`value` rounded to `precision`, as float64."""
    return value if precision is ir.Precision.FLOAT64 else value.astype(np.float32).astype(np.float64)


def _each_step(op: ir.KernelSum) -> ir.Precision:
    """To what every operation inside a sum of kernels is rounded; libraries say nothing of it, so it is bounded."""
    return ir.Precision.REAL if op.precision is ir.Precision.REAL else ir.Precision.FLOAT64


#: What each operator does to two numbers.
OPERATORS: dict[ir.Operator, Callable[[FloatArray, FloatArray], FloatArray]] = {
    ir.Operator.ADD: np.add,
    ir.Operator.SUBTRACT: np.subtract,
    ir.Operator.MULTIPLY: np.multiply,
    ir.Operator.DIVIDE: np.divide,
    ir.Operator.MAXIMUM: np.maximum,
    ir.Operator.MINIMUM: np.minimum,
}


@singledispatch
def apply(op: ir.Operation, operands: list[FloatArray]) -> FloatArray:
    """The result of one operation on its operands, each (rows, width)."""
    raise NotImplementedError(type(op).__name__)


@apply.register
def _(op: ir.Select, operands: list[FloatArray]) -> FloatArray:
    return np.hstack(operands)[:, op.columns]


@apply.register
def _(op: ir.Scale, operands: list[FloatArray]) -> FloatArray:
    left, right = (op.constant[None, :], operands[0]) if op.reverse else (operands[0], op.constant[None, :])
    # + - * / of two float32 numbers computed in float64 and rounded once equal the float32 operation
    result = rounded(OPERATORS[op.operator](left, right), op.precision)
    return _guarded(result, left, right, op) if op.reverse and op.operator is ir.Operator.DIVIDE else result


@apply.register
def _(op: ir.Combine, operands: list[FloatArray]) -> FloatArray:
    left, right = operands
    result = rounded(OPERATORS[op.operator](left, right), op.precision)
    return _guarded(result, left, right, op) if op.operator is ir.Operator.DIVIDE else result


def _guarded(
    quotient: FloatArray, left: FloatArray, right: FloatArray, op: ir.Scale | ir.Combine | ir.Normalize
) -> FloatArray:
    """A quotient, NaN where the divisor is too small for it."""
    return np.where(np.abs(right) <= np.abs(left) * (1.0 / op.ceiling), np.nan, quotient)


@apply.register
def _(_: ir.Round, operands: list[FloatArray]) -> FloatArray:
    return rounded(operands[0], ir.Precision.FLOAT32)


@apply.register
def _(op: ir.ColumnFunction, operands: list[FloatArray]) -> FloatArray:
    return op.value(operands[0])


@apply.register
def _(op: ir.ArgMax, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    reached = np.max(x, axis=1, keepdims=True) - x <= op.merged
    first: FloatArray = np.argmax(reached, axis=1, keepdims=True).astype(np.float64)
    return first


@apply.register
def _(op: ir.Softmax, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    below = x - np.max(x, axis=1, keepdims=True)
    powers = rounded(np.exp(below), op.precision)
    total = np.sum(powers, axis=1, keepdims=True)
    return rounded(below - np.log(total) if op.logarithm else powers / total, op.precision)


@apply.register
def _(op: ir.Linear, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    total = np.broadcast_to(op.bias, (len(x), op.width)).copy()
    if op.order is ir.SummationOrder.SEQUENTIAL:
        for column in range(x.shape[1]):
            product = rounded(x[:, column, None] * op.weights[None, :, column], op.precision)
            total = rounded(total + product, op.precision)
        return total
    for column in range(x.shape[1]):
        total += x[:, column, None] * op.weights[None, :, column]
    return rounded(total, op.precision)


@apply.register
def _(op: ir.SlidingLinear, operands: list[FloatArray]) -> FloatArray:
    read, columns = operands[0], op.columns
    total = np.broadcast_to(op.bias, (len(read), len(op.starts), len(op.bias))).copy()
    for number in range(columns.shape[1]):
        total += read[:, columns[:, number], None] * op.weights[:, number]
    return rounded(total.reshape(len(read), op.width), op.precision)


@apply.register
def _(op: ir.Scan, operands: list[FloatArray]) -> FloatArray:
    return np.hstack([values[-1] for values in rounds(op, operands[0])])


def rounds(op: ir.Scan, x: FloatArray) -> Iterator[list[FloatArray]]:
    """All values of the body in each round, for rows `x` of the operand."""
    state = np.broadcast_to(op.initial, (len(x), len(op.initial)))
    for start in op.starts.tolist():
        values = [np.hstack([x[:, start : start + op.columns], state])]
        for part in op.body:
            values.append(apply(part, [values[number] for number in part.inputs]))
        state = values[-1]
        yield values


@apply.register
def _(op: ir.Activation, operands: list[FloatArray]) -> FloatArray:
    x, power = operands[0], op.function is ir.Function.POWER
    beyond = x > op.limit if not power else np.abs(x) > op.furthest if op.parameter > 0 else np.abs(x) < op.furthest
    x = np.where(beyond, np.nan, x)
    return rounded(_FUNCTIONS[op.function](x, op.parameter), op.precision)


def _logistic(x: FloatArray, _: float) -> FloatArray:
    decay = np.exp(-np.abs(x))  # never overflows
    return np.where(x >= 0, 1.0, decay) / (1.0 + decay)


def _erf(x: FloatArray) -> FloatArray:
    return np.asarray(np.vectorize(math.erf, otypes=[np.float64])(x))


def _ratio(x: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    """The quotient of two polynomials, whose coefficients stand one list behind the other."""
    half, sides = len(coefficients) // 2, []
    for part in (coefficients[:half], coefficients[half:]):
        side = np.zeros_like(x)
        for coefficient in part:
            side = side * x + coefficient
        sides.append(side)
    return np.asarray(sides[0] / sides[1])


def normal_quantile(x: FloatArray) -> FloatArray:
    """The numbers below which shares of a normal distribution lie."""
    share = np.minimum(x, 1.0 - x)
    share = np.where(share >= LEAST_SHARE, share, np.nan)
    q = x - 0.5
    central = (q + q * (q * q * _ratio(q * q, CENTRAL))) * math.sqrt(2.0 * math.pi)
    z = np.sqrt(-2.0 * np.log(share))
    tail = z - np.log(z) / z - 1.0 / z * _ratio(1.0 / z, TAILS)
    return np.where(share > CENTRAL_SHARE, central, np.where(q < 0.0, -tail, tail))


def _power(x: FloatArray, exponent: float) -> FloatArray:
    return np.power(np.where((x == 0) & (exponent < 0), np.nan, x), exponent)


_FUNCTIONS: dict[ir.Function, Callable[[FloatArray, float], FloatArray]] = {
    ir.Function.IDENTITY: lambda x, _: x,
    ir.Function.TANH: lambda x, _: np.tanh(x),
    ir.Function.LOGISTIC: _logistic,
    ir.Function.RELU: lambda x, _: np.maximum(x, 0.0),
    ir.Function.LEAKY_RELU: lambda x, slope: np.where(x < 0, slope * x, x),
    ir.Function.ELU: lambda x, scale: np.where(x < 0, scale * np.expm1(np.minimum(x, 0.0)), x),
    ir.Function.SOFTPLUS: lambda x, _: np.maximum(x, 0.0) + np.log1p(np.exp(-np.abs(x))),
    ir.Function.EXP: lambda x, _: np.exp(x),
    ir.Function.EXPM1: lambda x, _: np.expm1(x),
    ir.Function.LOG1P: lambda x, _: np.log1p(np.where(x > -1.0, x, np.nan)),
    ir.Function.ABS: lambda x, _: np.abs(x),
    ir.Function.SQRT: lambda x, _: np.sqrt(x),
    ir.Function.LOG: lambda x, _: np.log(np.where(x > 0.0, x, np.nan)),
    ir.Function.SOFTSIGN: lambda x, _: x / (1.0 + np.abs(x)),
    ir.Function.ERF: lambda x, _: _erf(x),
    ir.Function.GELU: lambda x, _: 0.5 * x * (1.0 + _erf(x * math.sqrt(0.5))),
    ir.Function.SIN: lambda x, _: np.sin(np.where(np.abs(x) <= COS_REACH, x, np.nan)),
    ir.Function.COS: lambda x, _: np.cos(np.where(np.abs(x) <= COS_REACH, x, np.nan)),
    ir.Function.ATAN: lambda x, _: np.arctan(x),
    ir.Function.SIGNED_SQUARE: lambda x, _: np.sign(x) * x * x,
    ir.Function.NORMAL_QUANTILE: lambda x, _: normal_quantile(x),
    ir.Function.POWER: _power,
}


@apply.register
def _(op: ir.Normalize, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    if op.norm is ir.Norm.MAX:
        size = np.max(x, axis=1)
    else:
        terms = np.abs(x) if op.norm is ir.Norm.L1 else rounded(x * x, op.precision)
        size = np.zeros(len(x))
        for column in range(op.width):
            size = rounded(size + terms[:, column], op.precision)
    divisor = np.where(size == 0, 1.0, size)[:, None]
    if op.norm is ir.Norm.L2:
        root = rounded(np.sqrt(rounded(terms / divisor, op.precision)), op.precision)
        quotient = np.where(x < 0, -root, root)
    else:
        quotient = _guarded(rounded(x / divisor, op.precision), x, divisor, op)
    return np.where((size == 0)[:, None], x, quotient)


@apply.register
def _(op: ir.KernelSum, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    total = np.broadcast_to(op.intercept, (len(x), op.width)).copy()
    for vector, coefficients in zip(op.support_vectors, op.coefficients.T, strict=True):
        term = rounded(kernel_value(op, x, vector)[:, None] * coefficients[None, :], _each_step(op))
        total = rounded(total + term, _each_step(op))
    return rounded(total, op.precision)


@apply.register
def _(op: ir.Distances, operands: list[FloatArray]) -> FloatArray:
    if op.largest:
        return np.column_stack([np.max(np.abs(operands[0] - vector), axis=1) for vector in op.vectors])
    power = 2 if op.squared else 1
    sums = np.column_stack([np.sum(np.abs(operands[0] - vector) ** power, axis=1) for vector in op.vectors])
    return np.sqrt(sums) if op.root else sums


@apply.register
def _(op: ir.NearestMean, operands: list[FloatArray]) -> FloatArray:
    x, factors = operands[0], operands[1] if len(operands) > 1 else np.ones_like(operands[0])
    nearest = np.argsort(x, axis=1, kind="stable")[:, : op.count]
    weights = np.ones(nearest.shape)
    if op.inverse:
        own = np.take_along_axis(x, nearest, axis=1)
        with np.errstate(invalid="ignore"):  # a neighbour at distance 0: its quotients are not taken
            weights = np.where(own[:, :1] > 0, own[:, :1] / own, own <= 0)
    total = np.zeros((len(x), op.width))
    divisor = np.zeros((len(x), 1))
    for place in range(op.count):
        weight = weights[:, place, None]
        total += weight * op.values[:, nearest[:, place]].T * factors[np.arange(len(x)), nearest[:, place], None]
        divisor += weight
    return np.where(np.isnan(x + factors).any(axis=1, keepdims=True), np.nan, total / divisor if op.divides else total)


def pair_matrix(op: ir.CoupledPairs, x: FloatArray) -> FloatArray:
    """The matrix Q of each row, shape (rows, classes, classes)."""
    first, second = np.triu_indices(op.count, 1)
    found = np.zeros((len(x), op.count, op.count))
    for pair, (one, other) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        own, rest = x[:, pair], 1.0 - x[:, pair]
        found[:, one, one] += rest * rest
        found[:, other, other] += own * own
        found[:, one, other] = found[:, other, one] = -(rest * own)
    return found


def coupled_products(matrix: FloatArray, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q p and p Q p of each row."""
    products, total = np.zeros_like(shares), np.zeros(len(shares))
    for column in range(shares.shape[1]):
        products += matrix[:, :, column] * shares[:, column, None]
    for column in range(shares.shape[1]):
        total += shares[:, column] * products[:, column]
    return products, total


@apply.register
def _(op: ir.CoupledPairs, operands: list[FloatArray]) -> FloatArray:
    matrix, shares = pair_matrix(op, operands[0]), np.full((len(operands[0]), op.count), 1.0 / op.count)
    going = np.flatnonzero(~np.isnan(operands[0]).any(axis=1))
    shares[np.isnan(operands[0]).any(axis=1)] = np.nan
    for _ in range(op.rounds):
        own, p = matrix[going], shares[going]
        products, total = coupled_products(own, p)
        on = ~(np.max(np.abs(products - total[:, None]), axis=1) < op.epsilon)
        going, own, p, products, total = going[on], own[on], p[on], products[on], total[on]
        if not len(going):
            break
        for place in range(op.count):
            diagonal = own[:, place, place]
            moved = (total - products[:, place]) / diagonal
            grown = 1.0 + moved
            p[:, place] += moved
            total = (total + moved * (moved * diagonal + 2.0 * products[:, place])) / grown / grown
            products = (products + moved[:, None] * own[:, place]) / grown[:, None]
            p = p / grown[:, None]
        shares[going] = p
    return shares


def weights_reached(op: ir.WeightedMedian, order: IntArray) -> FloatArray:
    """The sums of the weights up to each column in an order, of which every one is rounded."""
    precise = op.precision is ir.Precision.FLOAT64
    sums = np.cumsum(op.weights[order], axis=1, dtype=np.float64 if precise else np.float32)
    return sums.astype(np.float64)


@apply.register
def _(op: ir.WeightedMedian, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    order = np.argsort(x, axis=1, kind="stable")
    reached = weights_reached(op, order)
    place = np.argmax(reached >= 0.5 * reached[:, -1:], axis=1)
    return np.take_along_axis(x, np.take_along_axis(order, place[:, None], axis=1), axis=1)


@apply.register
def _(op: ir.FactoredKernel, operands: list[FloatArray]) -> FloatArray:
    x = operands[0]
    total = np.broadcast_to(op.coefficients, (len(x), *op.coefficients.shape))
    for column, axis in reversed(list(zip(op.columns, op.axes, strict=True))):
        factor = np.exp(-op.gamma * (x[:, column, None] - axis) ** 2)
        total = np.einsum("ropk,rk->rop", total.reshape(len(x), op.width, -1, len(axis)), factor)
    return rounded(total[:, :, 0] + op.intercept, op.precision)


def kernel_value(op: ir.KernelSum, x: FloatArray, vector: FloatArray) -> FloatArray:
    """The kernel between rows of `x` and one support vector, shape (rows,)."""
    step = _each_step(op)
    if op.kernel is ir.Kernel.RBF:
        distance = _sum(rounded(x - vector, step) ** 2, step)
        return rounded(np.exp(rounded(-op.gamma * distance, step)), step)
    product = _sum(x * vector, step)
    if op.kernel is ir.Kernel.LINEAR:
        return product
    argument = rounded(rounded(op.gamma * product, step) + op.coef0, step)
    if op.kernel is ir.Kernel.SIGMOID:
        return rounded(np.tanh(argument), step)
    if step is ir.Precision.FLOAT64:
        return argument**op.degree
    power = np.ones_like(argument)
    for _ in range(op.degree):
        power = rounded(power * argument, step)
    return power


def _sum(terms: FloatArray, step: ir.Precision) -> FloatArray:
    """The sum of each row, of which every operation is rounded; of float64 in an order that libraries leave open."""
    if step is ir.Precision.FLOAT64:
        return np.asarray(np.sum(terms, axis=1))
    total = np.zeros(len(terms))
    for column in range(terms.shape[1]):
        total = rounded(total + rounded(terms[:, column], step), step)
    return total


@apply.register
def _(op: ir.TreeEnsemble, operands: list[FloatArray]) -> FloatArray:
    return TreeEvaluator(op, operands[0]).total()


def leaf_values(op: ir.TreeEnsemble, x: FloatArray, tree: int) -> FloatArray:
    """What one tree gives to rows of the ensemble's operand, shape (rows, width of a leaf)."""
    with np.errstate(all="ignore"):
        return TreeEvaluator(op, x).leaf_values(tree)


class TreeEvaluator:
    """One ensemble on one set of rows."""

    def __init__(self, op: ir.TreeEnsemble, x: FloatArray) -> None:
        self.op = op
        self.raw = x
        rows = len(x)
        columns = max(len(op.columns), 1)
        self.value = np.zeros((columns, rows))
        self.missing = np.zeros((columns, rows), np.bool_)
        self.code = np.zeros((columns, rows), np.int64)
        for number, column in enumerate(op.columns):
            self._read(number, column, rounded(x[:, column.column], op.input_precision))
        self.any_missing = bool(self.missing.any())
        self.any_infinite = bool(np.isinf(op.threshold).any())

    def _read(self, number: int, column: ir.TreeColumn, value: FloatArray) -> None:
        nan = np.isnan(value)
        missing = nan & (column.nan is ir.NanRule.MISSING)
        value = np.where(nan, 0.0, value)
        if column.missing_interval is not None:
            low, high = column.missing_interval
            missing |= (value >= low) & (value <= high)
        self.value[number] = value
        self.missing[number] = missing
        if column.categorical:
            self.code[number] = np.where(missing, column.n_categories + 1, category_code(column, value))

    @cached_property
    def _following(self) -> IntArray:
        """The right and the left child of each node, one behind the other; a leaf is followed by itself."""
        op = self.op
        children = np.column_stack([op.right, op.left]).astype(np.int64)
        leaves = np.flatnonzero(op.split < 0)
        children[leaves] = leaves[:, None]
        return children.ravel()

    def leaves(self, tree: int) -> IntArray:
        """The leaf node that each row reaches in a tree, shape (rows,)."""
        found = np.full(self.value.shape[1], self.op.roots[tree], np.int64)
        node, row = found, np.arange(len(found))
        while True:
            column = self.op.split.take(node)
            on_the_way = np.count_nonzero(column >= 0)
            if 4 * on_the_way <= 3 * len(row):  # to leave rows behind takes longer than to move them on the spot
                found[row] = node
                if not on_the_way:
                    return found
                left = np.flatnonzero(column >= 0)
                node, row, column = node.take(left), row.take(left), column.take(left)
            goes_left = self.goes_left(node, np.maximum(column, 0), row)
            node = self._following.take(2 * node + goes_left)

    def goes_left(self, node: AnyArray, column: AnyArray, row: AnyArray) -> BoolArray:
        """Whether splits send rows left: node by node, with the column that each reads; of leaves nothing is said."""
        op = self.op
        at = np.multiply(column, self.value.shape[1], dtype=np.int64) + row
        value, threshold = self.value.take(at), op.threshold.take(node)
        goes_left = value < threshold if op.comparison is ir.Comparison.LESS else value <= threshold
        if self.any_infinite:
            goes_left |= threshold == np.inf
        if self.any_missing:
            goes_left = np.where(self.missing.take(at), op.missing_left.take(node), goes_left)
        if op.has_categories:
            coded = np.flatnonzero(np.array([c.categorical for c in op.columns])[column] & (op.split.take(node) >= 0))
            goes_left[coded] = op.category_left[op.category_row[node[coded]] + self.code.take(at[coded])]
        return np.asarray(goes_left, np.bool_)

    def leaf_values(self, tree: int) -> FloatArray:
        """What a tree gives each row, shape (rows, width of a leaf)."""
        op = self.op
        leaf = op.leaf.take(self.leaves(tree))
        value: FloatArray = op.leaf_value.take(leaf, axis=0)
        if op.linear is None:
            return value
        linear = op.linear
        total = linear.constant[leaf].copy()
        nan = np.zeros(len(total), np.bool_)
        counts = linear.start[leaf + 1] - linear.start[leaf]
        for term in range(int(counts.max(initial=0))):
            rows = np.flatnonzero(counts > term)
            entry = linear.start[leaf[rows]] + term
            x = self.raw[rows, linear.column[entry]]
            x = np.where(np.abs(x) <= linear.zero_magnitude, 0.0, x)
            nan[rows] |= np.isnan(x)
            total[rows] += linear.coefficient[entry] * x
        return np.where(nan[:, None], value, total[:, None])

    def total(self) -> FloatArray:
        """The ensemble's result, shape (rows, outputs), with every addition rounded as the library rounds it."""
        op = self.op
        dtype = np.float64 if op.sum_precision is ir.Precision.FLOAT64 else np.float32
        base = op.base.astype(dtype)
        combine = {ir.Aggregate.SUM: np.add, ir.Aggregate.MINIMUM: np.minimum, ir.Aggregate.MAXIMUM: np.maximum}[
            op.aggregate
        ]
        neutral = {ir.Aggregate.SUM: 0.0, ir.Aggregate.MINIMUM: np.inf, ir.Aggregate.MAXIMUM: -np.inf}[op.aggregate]
        first = np.full(op.width, neutral, dtype) if op.adds_base_last else base
        result = np.broadcast_to(first, (len(self.raw), op.width)).copy()
        for tree in range(op.n_trees):
            value = self.leaf_values(tree).astype(dtype)
            if value.shape[1] == 1 and op.width > 1:
                output = op.tree_output[tree]
                result[:, output] = combine(result[:, output], value[:, 0])
            else:
                result = combine(result, value)
        if op.divisor != 1.0:
            result = result / dtype(op.divisor)
        if op.adds_base_last:
            result = result + base
        return np.asarray(result, np.float64)


@apply.register
def _(op: ir.Rank, operands: list[FloatArray]) -> FloatArray:
    x = np.hstack(operands)
    return np.column_stack([_rank(column, x[:, column.column]) for column in op.columns])


def _rank(column: ir.RankColumn, x: FloatArray) -> FloatArray:
    below = np.searchsorted(column.edges, x, side="left")
    rank = column.highest - below if column.descending else below
    return np.where(np.isnan(x), column.missing, rank).astype(np.float64)


@apply.register
def _(op: ir.CellTable, operands: list[FloatArray]) -> FloatArray:
    ranks = np.hstack(operands).astype(np.int64)
    row = np.zeros(len(ranks), np.int64)
    for axis in op.axes:
        row += axis.offset[ranks[:, axis.column]]
    result = np.broadcast_to(op.constant, (len(row), op.width)).copy()
    kept = np.flatnonzero(op.stored >= 0)
    result[:, kept] = op.values[row[:, None], op.stored[kept]]
    return result


def category_code(column: ir.TreeColumn, value: FloatArray) -> IntArray:
    """Category codes 0 .. n_categories-1 of numbers, n_categories for all others, shape of `value`."""
    n = column.n_categories
    if column.categories is not None:
        known = np.array(column.categories)
        order = np.argsort(known, kind="stable")
        position = order[np.minimum(np.searchsorted(known[order], value), len(known) - 1)]
        return np.where(known[position] == value, position, np.int64(n))
    whole = np.trunc(value)
    not_negative = (whole if column.negative_fraction_is_zero else value) >= 0
    return np.where(not_negative & (whole < n), whole, n).astype(np.int64)
