"""The numbers a model can be computed for without overflow.

On a PLC an overflow may stop the controller, so inputs beyond the limit found here are refused by the generated block.
Interval arithmetic on magnitudes: each operation maps a bound on its inputs to a bound on its intermediate results.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError
from st_codegen.ir.arrays import FloatArray
from st_codegen.ir.base import EXPONENTIALS
from st_codegen.ir.trees import added_up, ends_of, of_each_tree

#: Limits tried for the arguments of exponentials, largest first: e**690 is about 1e299, e**88 about 1.7e38.
_EXP_LIMITS = {
    ir.Precision.FLOAT64: (690.0, 345.0, 170.0, 80.0, 40.0),
    ir.Precision.FLOAT32: (88.0, 44.0, 22.0, 11.0, 5.0),
}
_EXP_LIMITS[ir.Precision.REAL] = _EXP_LIMITS[ir.Precision.FLOAT32]

#: Limits tried at the same time for quotients of computed numbers.
_QUOTIENT_LIMITS = {
    ir.Precision.FLOAT64: (1e300, 1e150, 1e75, 1e37, 1e18),
    ir.Precision.FLOAT32: (3e38, 1e19, 1e9, 1e5, 1e3),
}
_QUOTIENT_LIMITS[ir.Precision.REAL] = _QUOTIENT_LIMITS[ir.Precision.FLOAT32]

#: The largest result of an operation. The sum of ten thousand results, as the blocks around a model may form it, does
#: not overflow either.
_LARGEST = {**ir.CEILING, ir.Precision.FLOAT64: 1e305}

#: Limits of inputs that are tried, rising: numbers of one digit, so that a model trained again rarely has another one.
_LIMITS = tuple(float(f"{digit}e{exponent}") for exponent in range(305) for digit in range(1, 10))

#: A range of inputs beyond this is no better: of limits for exponentials that leave as much, the largest is taken.
_WIDE = 1e37


def limit_inputs(model: ir.ModelIR) -> ir.ModelIR:
    """The model with `magnitude_limits`, and `limit` of exponentials and quotients, narrowed: no operation overflows.

    Models that only compare their inputs stay as they are, and so do inputs that no arithmetic reads. Every output is
    then finite. Raises InputError where not even inputs of magnitude 1, or not all of the declared ranges, are safe.
    """
    unlimited = np.full(len(model.features), np.inf)
    if _is_safe(model, unlimited):
        return model
    count = len(_EXP_LIMITS[ir.Precision.FLOAT64])
    candidates = [
        dataclasses.replace(model, ops=tuple(_limited(op, number) for op in model.ops)) for number in range(count)
    ]
    ranges = [_widest(candidate) for candidate in candidates]
    best = max(range(count), key=lambda number: min(ranges[number], _WIDE))
    if not ranges[best]:
        double, single = _LARGEST[ir.Precision.FLOAT64], _LARGEST[ir.Precision.FLOAT32]
        raise InputError(
            f"model '{model.name}': its numbers are so large that a result beyond {double:g}, or one in float32 beyond "
            f"{single:g}, is possible for inputs of magnitude 1; check the training data and scale the target"
        )
    needed = np.full(len(model.features), ranges[best])
    chosen = _raised(candidates[best], needed)
    for feature in range(len(needed)):
        without = np.where(np.arange(len(needed)) == feature, np.inf, needed)
        needed = without if _is_safe(chosen, without) else needed
    _check_ranges(model, needed)
    # what the library refuses, infinities or more, stays refused
    limits = tuple(
        known if math.isinf(limit) else min(limit, math.inf if known is None else known)
        for limit, known in zip(needed.tolist(), model.magnitude_limits, strict=True)
    )
    return dataclasses.replace(chosen, magnitude_limits=limits)


def _raised(model: ir.ModelIR, inputs: FloatArray) -> ir.ModelIR:
    """The model with the limit of each exponential, the last one first, as large as is safe for inputs of this range.

    Exponentials behind one another need not have the same limit: what the last one leaves is often the output.
    """
    for number, op in reversed(tuple(enumerate(model.ops))):
        if isinstance(op, ir.Activation) and op.function in EXPONENTIALS:
            largest = _EXP_LIMITS[op.precision][0]
            tried = [
                dataclasses.replace(
                    model,
                    ops=(*model.ops[:number], dataclasses.replace(op, limit=float(limit)), *model.ops[number + 1 :]),
                )
                for limit in range(int(op.limit) + 1, int(largest) + 1)
            ]
            safe = bisect.bisect_left(tried, True, key=lambda other: not _is_safe(other, inputs))
            model = tried[safe - 1] if safe else model
    return model


def _widest(model: ir.ModelIR) -> float:
    """The largest limit for the magnitudes of all inputs with which no operation overflows; 0.0 where there is none."""
    safe = bisect.bisect_left(_LIMITS, True, key=lambda limit: not _is_safe(model, np.full(len(model.features), limit)))
    return _LIMITS[safe - 1] if safe else 0.0


def _limited(op: ir.Operation, attempt: int) -> ir.Operation:
    """An exponential or a quotient with the limit of an attempt; any other operation as it is."""
    if isinstance(op, ir.Activation) and op.function in EXPONENTIALS:
        return dataclasses.replace(op, limit=_EXP_LIMITS[op.precision][attempt])
    if isinstance(op, ir.Quotient):  # all of them are dataclasses
        return dataclasses.replace(op, limit=_QUOTIENT_LIMITS[op.precision][attempt])  # type: ignore[type-var]
    return op


def _check_ranges(model: ir.ModelIR, limits: FloatArray) -> None:
    for feature, limit in zip(model.features, limits.tolist(), strict=True):
        if feature.lower is not None and feature.upper is not None and max(-feature.lower, feature.upper) >= limit:
            raise InputError(
                f"model '{model.name}', feature '{feature.name}': within the range {feature.lower} .. {feature.upper} "
                f"the computation can overflow (limit {limit:g}); narrow the range or scale the feature"
            )


def _is_safe(model: ir.ModelIR, limits: FloatArray) -> bool:
    """Whether no operation overflows for inputs of magnitudes up to `limits`, one for each feature."""
    bounds = [limits]
    with np.errstate(all="ignore"):
        for op in model.ops:
            operands = [bounds[value] for value in op.inputs]
            peak, bound = magnitudes(op, operands)
            if op.inputs != (0,) and _refuses_overflow(op, operands):
                return False
            ceiling = _LARGEST[getattr(op, "precision", ir.Precision.FLOAT64)]
            if not peak <= ceiling:  # NaN is not safe either
                return False
            bounds.append(bound)
    return bool(np.all(np.isfinite(bounds[-1])))


def _refuses_overflow(op: ir.Operation, operands: list[FloatArray]) -> bool:
    """Trees that compare in float32 after other operations: libraries refuse what overflows in the conversion.

    For trees that read the inputs themselves the model's own `magnitude_limits` say so.
    """
    single = isinstance(op, ir.TreeEnsemble) and op.input_precision is ir.Precision.FLOAT32
    return single and not all(float(np.max(operand)) < ir.FLOAT32_OVERFLOW for operand in operands)


@singledispatch
def magnitudes(op: ir.Operation, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    """Largest magnitude of any intermediate result, and bounds on the magnitude of each output column."""
    raise NotImplementedError(type(op).__name__)


def _peak(bound: FloatArray) -> tuple[float, FloatArray]:
    return float(np.max(bound)), bound


@magnitudes.register
def _(op: ir.Select, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return 0.0, np.concatenate(operands)[op.columns]


@magnitudes.register
def _(op: ir.Scale | ir.Combine, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    one, other = operands if isinstance(op, ir.Combine) else (operands[0], np.abs(op.constant))
    if op.operator in (ir.Operator.ADD, ir.Operator.SUBTRACT):
        return _peak(one + other)
    if op.operator is ir.Operator.MULTIPLY:
        return _peak(one * other)
    if op.operator in (ir.Operator.MAXIMUM, ir.Operator.MINIMUM):
        return _peak(np.maximum(one, other))
    # a quotient by a computed number is guarded at run time against results above the ceiling
    guarded = isinstance(op, ir.Combine) or op.reverse
    return _peak(np.full(op.width, op.ceiling) if guarded else one / other)


@magnitudes.register
def _(_: ir.Round, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    largest = float(np.max(operands[0]))
    return (largest if largest < ir.FLOAT32_OVERFLOW else math.inf), operands[0]


@magnitudes.register
def _(op: ir.ColumnFunction, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    bound = op.largest(operands[0])
    return _peak(bound) if op.computes else (0.0, bound)


@magnitudes.register
def _(op: ir.ArgMax, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return 2.0 * float(np.max(operands[0])), np.array([op.n_columns - 1.0])


@magnitudes.register
def _(op: ir.Softmax, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    span = 2.0 * float(np.max(operands[0])) + np.log(op.width)
    return span, np.full(op.width, span if op.logarithm else 1.0)


@magnitudes.register
def _(op: ir.Linear, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return _peak(np.abs(op.weights) @ operands[0] + np.abs(op.bias))


@magnitudes.register
def _(op: ir.SlidingLinear, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return _peak(np.ravel(operands[0][op.columns] @ np.abs(op.weights).T + np.abs(op.bias)))


@magnitudes.register
def _(op: ir.Scan, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    state, found, peak = np.abs(op.initial), [], 0.0
    for start in op.starts.tolist():
        bounds = [np.concatenate([operands[0][start : start + op.columns], state])]
        for part in op.body:
            highest, bound = magnitudes(part, [bounds[value] for value in part.inputs])
            peak = highest if np.isnan(highest) else max(peak, highest)
            bounds.append(bound)
        state = bounds[-1]
        found.append(state)
    # all that is computed is a number of float32
    return (peak if peak <= _LARGEST[ir.Precision.FLOAT32] else math.inf), np.concatenate(found)


@magnitudes.register
def _(op: ir.Activation, operands: list[FloatArray]) -> tuple[float, FloatArray]:  # noqa: PLR0911 - one return a function
    x = operands[0]
    if op.function in (ir.Function.TANH, ir.Function.LOGISTIC):
        return 0.0, np.ones(op.width)
    if op.function is ir.Function.SIGNED_SQUARE:
        return _peak(x * x)
    if op.function in (ir.Function.EXP, ir.Function.EXPM1):
        return _peak(np.exp(np.minimum(x, op.limit)))
    if op.function is ir.Function.POWER:
        end = op.furthest
        bound = (np.minimum(x, end) if op.parameter > 0 else np.full(op.width, end)) ** op.parameter
        return float(np.max([x, bound])), bound  # infinities are refused, whatever their power is
    if op.function in (
        ir.Function.LOG,
        ir.Function.LOG1P,
    ):  # LN of the smallest number is -744.4, of 2**-53 it is -36.7
        return float(np.max(x)), np.maximum(np.log1p(x), 745.0 if op.function is ir.Function.LOG else 37.0)
    if op.function in (ir.Function.ERF, ir.Function.GELU, ir.Function.SOFTSIGN):
        return float(np.max(x * x)), x if op.function is ir.Function.GELU else np.ones(op.width)
    if op.function in (ir.Function.SIN, ir.Function.COS, ir.Function.ATAN):
        return 0.0, np.full(op.width, 2.0)
    if op.function is ir.Function.NORMAL_QUANTILE:
        return float(np.max(x)), np.full(op.width, 8.0)
    return _peak((1.0 + abs(op.parameter)) * x + 1.0)


@magnitudes.register
def _(op: ir.Normalize, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    peak = float(np.sum(operands[0] * operands[0]) + np.sum(operands[0]))
    return peak, np.full(op.width, op.ceiling if op.norm is ir.Norm.MAX else 2.0)


@magnitudes.register
def _(op: ir.KernelSum, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    vectors = np.abs(op.support_vectors)
    weights = np.sum(np.abs(op.coefficients), axis=1)
    if op.kernel is ir.Kernel.RBF:
        distance = np.max(np.sum((operands[0] + vectors) ** 2, axis=1))
        return max(float(distance) * max(op.gamma, 1.0), float(np.max(weights))), weights + np.abs(op.intercept)
    argument = vectors @ operands[0]
    kernel = argument
    if op.kernel is not ir.Kernel.LINEAR:
        argument = abs(op.gamma) * argument + abs(op.coef0)
        kernel = np.ones(len(argument)) if op.kernel is ir.Kernel.SIGMOID else argument**op.degree
    total = np.abs(op.coefficients) @ kernel + np.abs(op.intercept)
    return max(float(np.max(argument)), float(np.max(kernel)), float(np.max(total))), total


@magnitudes.register
def _(op: ir.Distances, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    reach = operands[0] + np.abs(op.vectors)
    peak, bound = _peak(np.sum(reach**2 if op.squared else reach, axis=1))
    return peak, np.sqrt(bound) if op.root else bound


@magnitudes.register
def _(op: ir.NearestMean, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    bound = np.max(np.abs(op.values) * (operands[1] if len(operands) > 1 else 1.0), axis=1)
    return op.count * (float(np.max(bound)) + 1.0), bound if op.divides else op.count * bound


@magnitudes.register
def _(op: ir.CoupledPairs, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    # a share grows by at most 1 / Q(t, t), which is 1e14 where pairs keep 1e-7 from 0 and 1
    return 1e16 * op.count, np.full(op.count, 1.0 + 1e-9)


@magnitudes.register
def _(op: ir.WeightedMedian, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return float(np.sum(op.weights)), np.array([np.max(operands[0])])


@magnitudes.register
def _(op: ir.TreeEnsemble, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    value = np.abs(op.leaf_value)
    if op.linear is not None:
        products = np.abs(op.linear.coefficient) * operands[0][op.linear.column]
        linear = np.abs(op.linear.constant)
        np.add.at(linear, np.repeat(np.arange(len(linear)), np.diff(op.linear.start)), products)
        value = np.maximum(value, linear[:, None])
    base, ceiling = np.abs(op.base), _LARGEST[op.sum_precision]
    if op.aggregate is ir.Aggregate.SUM:
        total = base + added_up(op, of_each_tree(op, np.maximum, value))
        bound = total / abs(op.divisor) + (base if op.adds_base_last else 0.0)
    else:  # a leaf without a number has a very large one, which is never chosen
        bound = np.maximum(*map(np.abs, ends_of(op)))
        total = (bound + base) * abs(op.divisor)
    return (float(np.max(total)) if np.max(total) <= ceiling else math.inf), np.broadcast_to(bound, (op.width,))


@magnitudes.register
def _(op: ir.Rank, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    return 0.0, np.array([float(max(column.highest, abs(column.missing))) for column in op.columns])


@magnitudes.register
def _(op: ir.CellTable, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    bound = np.abs(op.constant)
    kept = np.flatnonzero(op.stored >= 0)
    bound[kept] = np.max(np.abs(op.values), axis=0)[op.stored[kept]]
    return 0.0, bound


@magnitudes.register
def _(op: ir.FactoredKernel, operands: list[FloatArray]) -> tuple[float, FloatArray]:
    distance = max(
        float(np.max((operands[0][column] + np.abs(axis)) ** 2))
        for column, axis in zip(op.columns, op.axes, strict=True)
    )
    weights = np.sum(np.abs(op.coefficients), axis=1)
    return max(distance * max(op.gamma, 1.0), float(np.max(weights))), weights + np.abs(op.intercept)
