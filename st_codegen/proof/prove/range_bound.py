"""A bound of the difference to the library on the whole declared range, by intervals.

The range is cut into boxes. On each box an interval holds every intermediate number, and the row-wise derivation of
`bounds` is taken for the largest magnitudes in it, for it grows with magnitudes. So the bound holds for every input of
the range, not for rows that were tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.emit.blocks.model import real_lines
from st_codegen.ir import reference
from st_codegen.ir.arrays import FloatArray
from st_codegen.proof import bounds
from st_codegen.proof.prove.errors import NotProvedError

#: Boxes that the range is cut into, at most.
_BOXES = 4096

#: What intervals of intermediate numbers are widened by: far more than the roundings that led to them.
_MARGIN = 1e-9
#: Likewise where they are rounded to REAL.
_MARGIN_REAL = 1e-5

#: Functions whose largest result does not lie at an end of an interval, or whose slope may be without a limit.
_NOT_MONOTONE = (ir.Function.ABS, ir.Function.SIN, ir.Function.COS, ir.Function.ERF, ir.Function.GELU)
_STEEP = (ir.Function.SQRT, ir.Function.LOG, ir.Function.POWER, ir.Function.NORMAL_QUANTILE)

#: The ends of intervals: (boxes, width) each.
Ends = tuple[FloatArray, FloatArray]


def range_bound(model: ir.ModelIR) -> tuple[float, ...]:
    """For each output the largest |library - text| on the declared ranges; empty where a feature declares none.

    Infinite where an operation has none that is known.
    """
    if model.exact:
        return (0.0,) * len(model.outputs)
    ends = [(feature.lower, feature.upper) for feature in model.features]
    if any(low is None or high is None for low, high in ends):
        return ()
    values = [_boxes(np.array(ends, np.float64))]
    found = [np.zeros_like(values[0][0])]
    try:
        for op in model.ops:
            operands = [values[number] for number in op.inputs]
            with np.errstate(all="ignore"):
                result = _widened(op, interval(op, operands), _MARGIN_REAL if model.is_real else _MARGIN)
                difference = _difference(op, operands, [found[number] for number in op.inputs], result)
            values.append(result)
            found.append(np.where(np.isnan(difference), np.inf, difference))
    except NotProvedError:
        return (np.inf,) * len(model.outputs)
    return tuple(np.max(found[-1], axis=0).tolist())


def largest_loss(model: ir.ModelIR) -> tuple[float, ...]:
    """For each output of a model in REAL how far it may lie from the library's, infinite where no bound is known.

    Of trees for all inputs, else in the declared ranges.
    """
    if all(isinstance(op, ir.TreeEnsemble | ir.Select) for op in model.ops):
        return tuple(bounds.difference_bound(model, np.zeros((1, len(model.features))))[0].tolist())
    return range_bound(model) or (np.inf,) * len(model.outputs)


def real_remarks(models: Sequence[ir.ModelIR]) -> dict[str, str]:
    """What models lose that are computed in REAL, by their names."""
    return {model.name: " ".join(real_lines(model, largest_loss(model))) for model in models if model.is_real}


def _boxes(ends: FloatArray) -> Ends:
    parts = max(int(_BOXES ** (1 / len(ends))), 1)
    edges = [np.linspace(low, high, parts + 1) for low, high in ends]
    low = np.stack(np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij"), -1).reshape(-1, len(ends))
    high = np.stack(np.meshgrid(*(edge[1:] for edge in edges), indexing="ij"), -1).reshape(-1, len(ends))
    return low, high


def _widened(op: ir.Operation, ends: Ends, share: float) -> Ends:
    if isinstance(op, ir.Select):
        return ends
    margin = share * magnitude(ends) + 1e-300
    return ends[0] - margin, ends[1] + margin


def magnitude(ends: Ends) -> FloatArray:
    """The largest magnitudes in intervals."""
    return np.maximum(np.abs(ends[0]), np.abs(ends[1]))


def _difference(op: ir.Operation, operands: list[Ends], given: list[FloatArray], result: Ends) -> FloatArray:
    if isinstance(op, ir.KernelSum):

        def kernel(vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            x = operands[0]
            return _largest_kernel(op, x, vector), magnitude(x), _distance(x, vector)[1]

        return bounds.kernel_difference(op, kernel, given[0], magnitude(result))
    sizes = [magnitude(operand) for operand in operands]
    if isinstance(op, ir.Activation):
        # the slope is largest at the upper end, for a logarithm at the lower one
        sizes = [operands[0][0] if op.function is ir.Function.LOG1P else operands[0][1]]
        if op.function is ir.Function.SIGNED_SQUARE:
            sizes = [magnitude(operands[0])]
    elif not isinstance(op, ir.Select | ir.Scale | ir.Round | ir.Clip | ir.FillMissing | ir.Linear):
        raise NotProvedError(f"no bound on the whole range is known for {type(op).__name__}")
    return bounds.step(op, sizes, given, magnitude(result))


@singledispatch
def interval(op: ir.Operation, _: list[Ends]) -> Ends:
    """The interval of an operation's results, without its roundings."""
    raise NotProvedError(f"no bound on the whole range is known for {type(op).__name__}")


@interval.register
def _(op: ir.Select, operands: list[Ends]) -> Ends:
    low, high = (np.hstack([operand[end] for operand in operands])[:, op.columns] for end in (0, 1))
    return low, high


@interval.register
def _(op: ir.Scale, operands: list[Ends]) -> Ends:
    if op.reverse and op.operator is ir.Operator.DIVIDE:
        raise NotProvedError("no bound on the whole range is known for a quotient by a computed number")
    return _of_ends(op, operands[0])


def _of_ends(op: ir.Operation, operand: Ends) -> Ends:
    """What a monotone operation makes of both ends, in order."""
    one, other = (reference.apply(op, [end]) for end in operand)
    return np.minimum(one, other), np.maximum(one, other)


@interval.register
def _(op: ir.Round | ir.Clip | ir.FillMissing, operands: list[Ends]) -> Ends:
    if isinstance(op, ir.FillMissing) and op.sentinel is not None:
        low, high = operands[0]
        return np.minimum(low, op.fill), np.maximum(high, op.fill)
    return _of_ends(op, operands[0])


@interval.register
def _(op: ir.Linear, operands: list[Ends]) -> Ends:
    (low, high), positive, negative = operands[0], np.maximum(op.weights, 0).T, np.minimum(op.weights, 0).T
    # without a small number more a sum that cancels would be narrower than its roundings
    room = 1e-12 * (magnitude(operands[0]) @ np.abs(op.weights).T + np.abs(op.bias))
    if op.precision is not ir.Precision.FLOAT64:
        room *= 1e9
    return low @ positive + high @ negative + op.bias - room, high @ positive + low @ negative + op.bias + room


@interval.register
def _(op: ir.Activation, operands: list[Ends]) -> Ends:
    if op.function in (*_NOT_MONOTONE, *_STEEP):
        raise NotProvedError(f"no bound on the whole range is known for {op.function.value}")
    if op.function in (ir.Function.LOG1P, ir.Function.EXP, ir.Function.EXPM1):
        beyond = operands[0][0] <= -1.0 if op.function is ir.Function.LOG1P else operands[0][1] > op.limit
        if np.any(beyond):
            raise NotProvedError(f"{op.function.value} does not exist on the whole range")
    ends = _of_ends(op, operands[0])
    if op.function in (ir.Function.LEAKY_RELU, ir.Function.ELU) and op.parameter < 0:
        inside = (operands[0][0] < 0) & (operands[0][1] > 0)
        return np.where(inside, np.minimum(ends[0], 0.0), ends[0]), np.where(inside, np.maximum(ends[1], 0.0), ends[1])
    return ends


@interval.register
def _(op: ir.KernelSum, operands: list[Ends]) -> Ends:
    """By magnitudes only: no step behind a kernel needs more."""
    size = np.broadcast_to(np.abs(op.intercept), (len(operands[0][0]), op.width)).copy()
    for vector, coefficients in zip(op.support_vectors, np.abs(op.coefficients.T), strict=True):
        size += _largest_kernel(op, operands[0], vector)[:, None] * coefficients
    return -size, size


def _largest_kernel(op: ir.KernelSum, x: Ends, vector: FloatArray) -> FloatArray:
    if op.kernel is ir.Kernel.RBF:
        return np.asarray(np.exp(-op.gamma * np.sum(_distance(x, vector)[0] ** 2, axis=1)) * (1 + _MARGIN))
    argument = magnitude(x) @ np.abs(vector)
    if op.kernel is ir.Kernel.LINEAR:
        return np.asarray(argument)
    argument = abs(op.gamma) * argument + abs(op.coef0)
    return np.ones(len(argument)) if op.kernel is ir.Kernel.SIGMOID else np.asarray(argument**op.degree)


def _distance(x: Ends, vector: FloatArray) -> Ends:
    """The smallest and the largest distance of each column of boxes from a vector."""
    low, high = x
    nearest = np.maximum(np.maximum(low - vector, vector - high), 0.0)
    return nearest, np.maximum(np.abs(low - vector), np.abs(high - vector))
