"""RBF kernels on a grid: one exponential for each value of a column instead of one for each support vector."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from st_codegen.ir import FactoredKernel, FloatArray, Kernel, KernelSum, ModelIR, Operation

#: A grid may have this many times more points than there are support vectors on it: a point costs two operations, a
#: support vector an exponential.
_SPARSE = 8


def grid_of(op: KernelSum) -> tuple[FloatArray, ...] | None:
    """The distinct values of each column where an RBF kernel is worth factoring, else None."""
    if op.kernel is not Kernel.RBF or op.expands:
        return None
    vectors, columns = op.support_vectors.shape
    axes = tuple(np.unique(op.support_vectors[:, column]) for column in range(columns))
    points = math.prod(len(axis) for axis in axes)
    if points > _SPARSE * vectors or sum(len(axis) for axis in axes) >= vectors:
        return None
    return axes


def factored(model: ModelIR) -> ModelIR | None:
    """The model with every RBF kernel on a grid factored; None where there is none."""
    ops = tuple(_factored(op) if isinstance(op, KernelSum) else op for op in model.ops)
    if all(new is old for new, old in zip(ops, model.ops, strict=True)):
        return None
    return dataclasses.replace(model, ops=ops)


def _factored(op: KernelSum) -> Operation:
    axes = grid_of(op)
    if axes is None:
        return op
    # the longest axis last: it is summed first, and leaves the fewest sums
    order = sorted(range(len(axes)), key=lambda column: (len(axes[column]), column))
    shape = tuple(len(axes[column]) for column in order)
    position = tuple(np.searchsorted(axes[column], op.support_vectors[:, column]) for column in order)
    coefficients = np.zeros((op.width, math.prod(shape)))
    at = np.ravel_multi_index(position, shape)
    for output in range(op.width):
        np.add.at(coefficients[output], at, op.coefficients[output])
    return FactoredKernel(
        op.inputs,
        tuple(order),
        tuple(axes[column] for column in order),
        coefficients,
        op.intercept,
        op.gamma,
        op.precision,
    )
