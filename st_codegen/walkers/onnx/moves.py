"""Operators of the standard ONNX domain that move numbers by rules of their own: blocks of pictures, lists."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, FloatArray, IntArray, Operator, Scale
from st_codegen.walkers.onnx.file import printable
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, operator
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
    require_tensor,
)
from st_codegen.walkers.onnx.operators import combined
from st_codegen.walkers.onnx.shapes import mixed


def _block(call: NodeCall, operand: Operand) -> int:
    """The side of the square blocks of a picture (batch, channels, height, width)."""
    size = call.node.integer("blocksize")
    if len(operand.shape) != 4 or size < 1:
        raise InputError(f"blocks of {size} in shape {operand.shape}; the model file is damaged")
    return size


@operator("DepthToSpace", 1, 11, 13, 28)
def _depth_to_space(call: NodeCall) -> Operand:
    """Channels become squares of the picture; in the mode CRD those of one square stand side by side."""
    operand, mode = call.required(), call.node.text("mode", "DCR")
    size = _block(call, operand)
    batch, channels, height, width = operand.shape
    if channels % size**2 or mode not in ("DCR", "CRD"):
        raise InputError(
            f"{counted(channels, 'channel')}, blocks of {size} and the mode {printable(mode)}; the model file "
            "is damaged"
        )
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


@operator("SpaceToDepth", 1, 13, 28)
def _space_to_depth(call: NodeCall) -> Operand:
    """Squares of the picture become channels; in the mode CRD those of one channel stand side by side."""
    operand, mode = call.required(), call.node.text("mode", "DCR")
    size = _block(call, operand)
    batch, channels, height, width = operand.shape
    if height % size or width % size or mode not in ("DCR", "CRD"):
        raise InputError(
            f"blocks of {size} in shape {operand.shape} and the mode {printable(mode)}; the model file is damaged"
        )
    inside = (batch, channels, height // size, size, width // size, size)
    outside = (batch, channels * size**2, height // size, width // size)
    order = (0, 3, 5, 1, 2, 4) if mode == "DCR" else (0, 1, 3, 5, 2, 4)
    return operand.moved(lambda array: array.reshape(inside).transpose(order).reshape(outside))


@operator("Compress", 9, 11, 28)
def _compress(call: NodeCall) -> Operand:
    """The elements along an axis, or of all in one list, whose place a constant list marks."""
    operand, marks = call.required(), call.constant(1, "the list of marks")
    flat = "axis" not in call.node
    axis = None if flat else axis_of(call.node.integer("axis"), len(operand.shape))
    length = math.prod(operand.shape) if axis is None else operand.shape[axis]
    if marks is None or marks.dtype != np.bool_ or marks.ndim != 1 or len(marks) > length:
        raise InputError(f"not a list of at most {counted(length, 'truth value')}; the model file is damaged")
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


@operator("ReverseSequence", 10, 28)
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


@operator("Trilu", 14)
def _triangle(call: NodeCall) -> Operand:
    """The elements on one side of a diagonal, zeros on the other."""
    operand, diagonal = call.required(), call.integers(1, "the diagonal") or [0]
    if len(operand.shape) < 2 or operand.dtype.kind not in "fib":
        raise InputError(f"a triangle of shape {operand.shape} of {operand.dtype}; the model file is damaged")
    side = np.triu if call.node.integer("upper", 1) else np.tril
    if isinstance(operand, ConstantOperand):
        return operand.moved(lambda array: side(array, diagonal[0]))
    own = side(np.ones(operand.shape, np.bool_), diagonal[0])
    size = math.prod(operand.shape)
    zero = ConstantOperand(np.zeros(1, operand.dtype))
    return mixed(call.walk, [operand, zero], np.where(own, np.arange(size).reshape(operand.shape), size))


@operator("Scatter", 9, 11)
@operator("ScatterElements ScatterND", 11, 13, 16, 18)
def _scatter(call: NodeCall) -> Operand:
    """The first input, of which elements or parts at constant positions are those of the third."""
    operand, positions, parts = call.required(), call.positions(), call.required(2)
    shape, reduction = operand.shape, call.node.text("reduction", "none")
    if reduction != "none":
        raise UnsupportedModelError(f"the reduction {printable(reduction)}; elements are put in place without one")
    axis, taken = 0, positions.ndim == len(shape) and positions.shape == parts.shape
    if call.node.op_type != "ScatterND":
        axis = axis_of(call.node.integer("axis"), len(shape))
        lengths, depth = np.array(shape[axis : axis + 1]), 1
        taken = taken and all(positions.shape[at] <= most for at, most in enumerate(shape) if at != axis)
        each = positions[..., None]
    else:
        depth = positions.shape[-1] if positions.ndim else 0
        taken = 1 <= depth <= len(shape) and parts.shape == (*positions.shape[:-1], *shape[depth:])
        lengths, each = np.array(shape[:depth]), positions
    if not taken or np.any((each < -lengths) | (each >= lengths)):
        raise InputError(f"positions of shape {positions.shape}, or beyond those of shape {shape}, for {parts.shape}")
    each = np.where(each < 0, each + lengths, each)
    size = math.prod(shape)
    places, new = np.arange(size).reshape(shape), size + np.arange(math.prod(parts.shape)).reshape(parts.shape)
    if call.node.op_type != "ScatterND":
        at: list[AnyArray] = list(np.indices(positions.shape, sparse=True))
        at[axis] = each[..., 0]
        places[tuple(at)] = new
    else:
        places[tuple(np.moveaxis(each, -1, 0))] = new
    if np.sum(places >= size) < new.size:
        raise UnsupportedModelError("several elements for one position, of which the standard leaves open which counts")
    return mixed(call.walk, [operand, parts], places)


#: Where a place of the result lies in the input: (place, scale, length of the result, length of the input).
_COORDINATES: dict[str, Callable[[AnyArray, Any, int, int], AnyArray]] = {
    "asymmetric": lambda at, scale, _new, _old: at / scale,
    "half_pixel": lambda at, scale, _new, _old: (at + at.dtype.type(0.5)) / scale - at.dtype.type(0.5),
    "pytorch_half_pixel": lambda at, scale, new, old: (
        _COORDINATES["half_pixel"](at, scale, new, old) if new > 1 else np.zeros_like(at)
    ),
    "align_corners": lambda at, _scale, new, old: (
        at * at.dtype.type(old - 1) / at.dtype.type(new - 1) if new > 1 else np.zeros_like(at)
    ),
}
#: Roundings of the library on the way to a share of a line, and to the sum of what it multiplies.
_ROUNDINGS = 8
#: Which whole number is next.
_NEXT: dict[str, Callable[[AnyArray], AnyArray]] = {
    "floor": np.floor,
    "ceil": np.ceil,
    "round_prefer_floor": lambda at: np.ceil(at.astype(np.float64) - 0.5),
    "round_prefer_ceil": lambda at: np.floor(at.astype(np.float64) + 0.5),
}


def _sizes(call: NodeCall, shape: tuple[int, ...]) -> tuple[list[int], list[float]]:
    """The lengths of the result of a Resize or an Upsample, and what a step of it is to one of the input."""
    version, sizes = call.node.version, call.integers(3, "the sizes")
    given: AnyArray | None = call.node.floats("scales").astype(np.float32)
    if version > 7:
        given = call.constant(1 if version <= 10 else 2, "the scales")
    if sizes is None and given is not None and len(given) == len(shape) and np.all(given > 0):
        scales = given.astype(np.float64).tolist()
        return [int(np.float32(n) * np.float32(scale)) for n, scale in zip(shape, scales, strict=True)], scales
    if sizes is not None and len(sizes) == len(shape) and min(sizes) > 0:
        return sizes, [new / old for new, old in zip(sizes, shape, strict=True)]
    raise InputError(f"scales or sizes are missing for shape {shape}; the model file is damaged")


def _mode(call: NodeCall) -> tuple[str, str]:
    """The mode of a Resize or an Upsample, and by which coordinates. Raises UnsupportedModelError for other ones."""
    node = call.node
    way = "asymmetric" if node.version <= 10 else node.text("coordinate_transformation_mode", "half_pixel")
    mode = node.text("mode", "nearest")
    policy = node.text("keep_aspect_ratio_policy", "stretch")
    unknown = {
        f"the mode {printable(mode)} by {printable(way)}": mode not in ("nearest", "linear") or way not in _COORDINATES,
        "a choice of axes": "axes" in node,
        "antialias": node.integer("antialias") != 0,
        f"keep_aspect_ratio_policy='{printable(policy)}'": policy != "stretch",
    }
    if reasons := [text for text, found in unknown.items() if found]:
        raise UnsupportedModelError(
            f"{', '.join(reasons)}; of all axes, 'nearest' and 'linear' by "
            f"{', '.join(_COORDINATES)} are supported, without antialias and with keep_aspect_ratio_policy='stretch'"
        )
    return mode, way


@operator("Upsample", 7, 9)
@operator("Resize", 10, 11, 13, 18, 19)
def _resize(call: NodeCall) -> Operand:
    """The nearest elements along each axis, or numbers on the line between two (providers/cpu/tensor/upsample.cc)."""
    node, operand = call.node, call.required()
    oldest = node.version <= 10  # up by the element before, down by the one behind
    mode, way = _mode(call)
    nearest, shape = node.text("nearest_mode", "round_prefer_floor"), operand.shape
    sizes, scales = _sizes(call, shape)
    if nearest not in _NEXT:
        raise InputError(f"nearest_mode {printable(nearest)} is not known; the model file is damaged")
    check_size(sizes, MAX_COLUMNS if isinstance(operand, Tensor) else MAX_FOLDED)
    if tuple(sizes) == shape:  # then onnxruntime copies, whatever the scales
        return operand
    if mode == "linear":
        operand = call.computed()
        call.walk.refuse_special(operand)
    for axis, (new, old, scale) in enumerate(zip(sizes, shape, scales, strict=True)):
        if scale == 1.0:
            continue
        if oldest:
            nearest = "ceil" if scale < 1.0 else "floor"
        exact, rounded = (
            _COORDINATES[way](np.arange(new, dtype=kind), kind(scale), new, old) for kind in (np.float64, np.float32)
        )
        if mode == "linear":
            exact, rounded = (np.clip(at, 0, old - 1) for at in (exact, rounded))
        move = np.floor if mode == "linear" else _NEXT[nearest]
        places, others = (np.clip(move(at), 0, old - 1).astype(np.int64) for at in (exact, rounded))
        if not np.array_equal(places, others):
            raise UnsupportedModelError(
                f"lies between two of {counted(old, 'element')} along axis {axis}, where rounding to float decides; "
                "export the model with other sizes"
            )
        if isinstance(operand, Tensor) and mode == "linear":
            operand = _on_lines(call.walk, operand, axis, places, exact - places)
        else:
            operand = operand.moved(partial(np.take, indices=places, axis=axis))
    return operand


def _on_lines(walk: GraphWalk, tensor: Tensor, axis: int, places: IntArray, beyond: FloatArray) -> Tensor:
    """Numbers so far beyond places along an axis, on the line to the next one.

    The library computes shares in float, multiplies those of all axes first, and adds the products in any order.
    """
    unit, old = float(np.finfo(tensor.dtype).epsneg), tensor.shape[axis]
    lengths = [len(places) if at == axis else 1 for at in range(len(tensor.shape))]
    parts = []
    for share, at in ((1.0 - beyond, places), (beyond, np.minimum(places + 1, old - 1))):
        part = tensor.moved(partial(np.take, indices=at, axis=axis))
        constant, doubt = (
            np.broadcast_to(array.reshape(lengths), part.shape).ravel()
            for array in (share, _ROUNDINGS * (float(np.finfo(np.float32).epsneg) * (old + 1.0) + unit * share))
        )
        scale = Scale((walk.settle(part),), Operator.MULTIPLY, constant, part.precision, doubt=doubt)
        parts.append(walk.computed(scale, part.shape, part.dtype))
    return require_tensor(combined(walk, Operator.ADD, *parts))
