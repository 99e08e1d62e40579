"""Operators of the standard ONNX domain that move numbers by rules of their own: blocks of pictures, lists."""

from __future__ import annotations

import math

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import AnyArray
from st_codegen.walkers.onnx.graph import NodeCall, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    MAX_COLUMNS,
    MAX_FOLDED,
    ConstantOperand,
    Operand,
    Tensor,
    axis_of,
    check_size,
)


def _block(call: NodeCall, operand: Operand) -> int:
    """The side of the square blocks of a picture (batch, channels, height, width)."""
    size = call.node.integer("blocksize")
    if len(operand.shape) != 4 or size < 1:
        raise InputError(f"blocks of {size} in shape {operand.shape}; the model file is damaged")
    return size


@operator("DepthToSpace", 1, 11, 13)
def _depth_to_space(call: NodeCall) -> Operand:
    """Channels become squares of the picture; in the mode CRD those of one square stand side by side."""
    operand, mode = call.required(), call.node.text("mode", "DCR")
    size = _block(call, operand)
    batch, channels, height, width = operand.shape
    if channels % size**2 or mode not in ("DCR", "CRD"):
        raise InputError(f"{channels} channels, blocks of {size} and the mode {mode}; the model file is damaged")
    left = channels // size**2
    parts, order = (
        ((size, size, left), (0, 3, 4, 1, 5, 2)) if mode == "DCR" else ((left, size, size), (0, 1, 4, 2, 5, 3))
    )
    return operand.moved(
        lambda array: (
            array.reshape(batch, *parts, height, width)
            .transpose(order)
            .reshape(batch, left, height * size, width * size)
        )
    )


@operator("SpaceToDepth", 1, 13)
def _space_to_depth(call: NodeCall) -> Operand:
    """Squares of the picture become channels."""
    operand = call.required()
    size = _block(call, operand)
    batch, channels, height, width = operand.shape
    if height % size or width % size:
        raise InputError(f"blocks of {size} in shape {operand.shape}; the model file is damaged")
    inside = (batch, channels, height // size, size, width // size, size)
    outside = (batch, channels * size**2, height // size, width // size)
    return operand.moved(lambda array: array.reshape(inside).transpose(0, 3, 5, 1, 2, 4).reshape(outside))


@operator("Compress", 9, 11)
def _compress(call: NodeCall) -> Operand:
    """The elements along an axis, or of all in one list, whose place a constant list marks."""
    operand, marks = call.required(), call.constant(1, "the list of marks")
    flat = "axis" not in call.node
    axis = None if flat else axis_of(call.node.integer("axis"), len(operand.shape))
    length = math.prod(operand.shape) if axis is None else operand.shape[axis]
    if marks is None or marks.dtype != np.bool_ or marks.ndim != 1 or len(marks) > length:
        raise InputError(f"not a list of at most {length} truth values; the model file is damaged")
    if not np.any(marks):
        raise UnsupportedModelError("takes no elements; leave it out of the graph")
    return operand.moved(lambda array: np.compress(marks, array, axis))


@operator("GatherND", 11, 12, 13)
def _gather_nd(call: NodeCall) -> Operand:
    """Elements or parts by constant positions in the first axes behind those of the batch."""
    operand, positions = call.required(), call.positions()
    batch, rank = call.node.integer("batch_dims", 0), len(operand.shape)
    depth = positions.shape[-1] if positions.ndim else 0
    if not 0 <= batch < positions.ndim or not 1 <= depth <= rank - batch:
        raise InputError(f"positions of shape {positions.shape} in shape {operand.shape}; the model file is damaged")
    lengths = np.array(operand.shape[batch : batch + depth])
    if positions.shape[:batch] != operand.shape[:batch] or np.any((positions < -lengths) | (positions >= lengths)):
        raise InputError(f"positions of shape {positions.shape}, or beyond those of shape {operand.shape}")
    shape = (*positions.shape[:-1], *operand.shape[batch + depth :])
    check_size(shape, MAX_COLUMNS if isinstance(operand, Tensor) else MAX_FOLDED)
    ones = [1] * (positions.ndim - 1 - batch)
    before = [np.arange(n).reshape(*[1] * at, n, *[1] * (batch - 1 - at), *ones) for at, n in enumerate(shape[:batch])]
    places = (*before, *np.moveaxis(positions, -1, 0))
    return operand.moved(lambda array: np.asarray(array[places]))


@operator("ReverseSequence", 10)
def _reverse_sequence(call: NodeCall) -> Operand:
    """The first elements in time from back to front, as many as a constant says for each of the batch."""
    operand, lengths = call.required(), call.integers(1, "the list of lengths") or []
    rank = len(operand.shape)
    time, batch = (axis_of(call.node.integer(f"{name}_axis", at), rank) for at, name in enumerate(("time", "batch")))
    steps = operand.shape[time]
    if time == batch or len(lengths) != operand.shape[batch] or not all(0 <= length <= steps for length in lengths):
        raise InputError(f"lengths {lengths} for shape {operand.shape}; the model file is damaged")
    order = np.array([[*reversed(range(length)), *range(length, steps)] for length in lengths])
    axes = [1 if at not in (time, batch) else n for at, n in enumerate(operand.shape)]
    taken = (order if batch < time else order.T).reshape(axes)

    def reversed_(array: AnyArray) -> AnyArray:
        return np.take_along_axis(array, np.broadcast_to(taken, array.shape), time)

    return operand.moved(reversed_)


@operator("EyeLike", 9, 22)
def _eye_like(call: NodeCall) -> Operand:
    """Ones on a diagonal of a constant of the shape of the input, zeros elsewhere."""
    operand = call.required()
    if len(operand.shape) != 2 or "dtype" in call.node or operand.dtype not in (FLOAT32, FLOAT64):
        raise UnsupportedModelError("a diagonal of other than two dimensions, or with a type of its own")
    check_size(operand.shape, MAX_FOLDED)
    return ConstantOperand(np.eye(*operand.shape, k=call.node.integer("k", 0), dtype=operand.dtype))
