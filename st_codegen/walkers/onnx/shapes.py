"""Operators of the standard ONNX domain that only move numbers about, and constants."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import onnx

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, Exceeds, IntArray, Piecewise
from st_codegen.walkers.onnx.between import as_between, joined_constants
from st_codegen.walkers.onnx.elementwise import choice_of, is_not_zero
from st_codegen.walkers.onnx.file import type_name
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, Result, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    INTEGERS,
    MAX_COLUMNS,
    MAX_FOLDED,
    MAX_WHOLE,
    TRUTH,
    BetweenOperand,
    ConstantOperand,
    LabelOperand,
    MedianOperand,
    Operand,
    PickedOperand,
    Tensor,
    axis_of,
    check_size,
    require_float,
    require_same_type,
    require_tensor,
    together,
)
from st_codegen.walkers.onnx.ranges import keep_below

_SHAPE_VERSIONS = (13, 21, 23, 24, 25)
_CASTS: dict[int, type[np.generic]] = {
    onnx.TensorProto.FLOAT: np.float32,
    onnx.TensorProto.DOUBLE: np.float64,
    onnx.TensorProto.INT64: np.int64,
    onnx.TensorProto.INT32: np.int32,
    onnx.TensorProto.STRING: np.object_,
    onnx.TensorProto.BOOL: np.bool_,
}


@operator("Identity", 1, 13, 14, 16, 19, 21, 23, 24, 25)
def _identity(call: NodeCall) -> Operand:
    return call.required()


@operator("Dropout", 7, 10, 12, 13, 22)
def _dropout(call: NodeCall) -> Operand:
    call.constant(1, "the ratio")  # of which onnxruntime refuses some, though it does not use it
    training = call.constant(2, "training_mode")
    if call.node.has_more_outputs:
        raise UnsupportedModelError("several outputs: the mask is for training; leave it out")
    if training is not None and np.any(training):
        raise UnsupportedModelError("Dropout in training mode; export the model for inference (model.eval())")
    return call.required()


@operator("Cast", 6, 9, 13, 19, 21, 23, 24, 25, 28)
def _cast(call: NodeCall) -> Operand:
    target = _CASTS.get(call.node.integer("to"))
    if target is None:
        kind = type_name(call.node.integer("to"))
        raise UnsupportedModelError(f"casts to {kind}; FLOAT, DOUBLE, INT32, INT64 and BOOL are supported")
    return _converted(call, np.dtype(target))


@operator("CastLike", 15, 19, 21, 23, 24, 25)
def _cast_like(call: NodeCall) -> Operand:
    return _converted(call, require_same_type(call.required(1)))


def _converted(call: NodeCall, dtype: np.dtype[Any]) -> Operand:
    """The first input as numbers, truth values or text of a type."""
    operand = call.required()
    if isinstance(operand, LabelOperand):
        return _cast_labels(operand, dtype)
    if isinstance(operand, PickedOperand | MedianOperand):
        raise UnsupportedModelError("casts what TopK picks")
    if isinstance(operand, BetweenOperand):
        raise UnsupportedModelError("casts a constant that the graph computes by functions")
    if isinstance(operand, Tensor):
        return _converted_tensor(call.walk, operand, dtype)
    if "O" in (operand.dtype.kind, dtype.kind):
        raise UnsupportedModelError("casts constants from or to text; fold constants when exporting")
    if np.issubdtype(dtype, np.integer) and operand.dtype.kind == "f":
        ends = np.iinfo(dtype)
        whole = np.trunc(operand.array.astype(np.float64))
        if not np.all((whole >= ends.min) & (whole <= ends.max) & (np.abs(whole) < MAX_WHOLE)):
            raise UnsupportedModelError(f"casts constants to {dtype} that do not fit; fold constants when exporting")
    with np.errstate(over="ignore"):
        return ConstantOperand(operand.array.astype(dtype))


def _converted_tensor(walk: GraphWalk, tensor: Tensor, dtype: np.dtype[Any]) -> Tensor:
    """Computed numbers or truth values as those of a type."""
    if tensor.dtype == TRUTH:
        return replace(tensor, dtype=dtype)
    if dtype == TRUTH:
        return is_not_zero(walk, tensor)
    if dtype in (FLOAT32, FLOAT64):
        return walk.as_type(tensor, dtype)
    if dtype not in INTEGERS:
        kind = "text" if dtype.kind == "O" else f"{dtype}, which is not followed"
        raise UnsupportedModelError(f"casts numbers to {kind}; leave the cast out")
    if tensor.given:  # the numbers of an input, which may have fractions
        tensor = replace(tensor, dtype=FLOAT64, given=False)
    return as_integers(walk, tensor, dtype)


def as_integers(walk: GraphWalk, tensor: Tensor, dtype: np.dtype[Any]) -> Tensor:
    """Numbers without their fractions, as integers of a type; those that do not fit have no answer.

    What onnxruntime makes of those depends on the machine.
    """
    if tensor.dtype == dtype:
        return tensor
    bits = 63 if dtype == np.int64 else 31
    fits = keep_below(walk, replace(tensor, uncut=False), 2.0**bits)
    return replace(fits, dtype=dtype, uncut=tensor.uncut or tensor.dtype in (FLOAT32, FLOAT64), special=False)


def _cast_labels(choice: LabelOperand, dtype: np.dtype[Any]) -> LabelOperand:
    """A choice among the labels cast to a type; text only stays text."""
    texts = isinstance(choice.labels[0], str)
    if texts != (dtype.kind == "O"):
        raise UnsupportedModelError("casts labels between text and numbers; leave the cast out")
    if texts:
        return choice
    return replace(choice, labels=tuple(dtype.type(label).item() for label in choice.labels), number_type=dtype)


@operator("Constant", 1, 9, 11, 12, 13, 19, 21, 23, 24, 25)
def _constant(call: NodeCall) -> Operand:
    arrays: dict[str, Callable[[], AnyArray]] = {
        "value": lambda: np.asarray(call.node.tensor("value")),
        "value_float": lambda: np.array(call.node.number("value_float"), np.float32),
        "value_floats": lambda: call.node.floats("value_floats").astype(np.float32),
        "value_int": lambda: np.array(call.node.integer("value_int"), np.int64),
        "value_ints": lambda: call.node.integers("value_ints"),
    }
    names = [name for name in call.node.attributes if name in arrays]
    if len(names) != 1 or len(call.node.attributes) != 1:
        raise UnsupportedModelError("a constant has to be one of " + ", ".join(arrays))
    return ConstantOperand(arrays[names[0]]())


@operator("Shape", 1, 15, 19, *_SHAPE_VERSIONS)
def _shape(call: NodeCall) -> Operand:
    shape = call.required().shape
    end = call.node.integer("end", len(shape))
    return ConstantOperand(np.array(shape[call.node.integer("start") : end], np.int64))


@operator("Size", 1, 13, 19, *_SHAPE_VERSIONS)
def _size(call: NodeCall) -> Operand:
    return ConstantOperand(np.array(math.prod(call.required().shape), np.int64))


@operator("Range", 11, 27)
def _range(call: NodeCall) -> Operand:
    ends = [call.constant(number, "an end of a range") for number in range(3)]
    if any(end is None or end.size != 1 or end.dtype.kind != "i" for end in ends):
        raise UnsupportedModelError("a range other than of whole-number constants")
    start, limit, step = (int(np.ravel(end)[0]) for end in ends if end is not None)
    if step == 0:
        raise InputError("a step of 0; the model file is damaged")
    check_size([len(range(start, limit, step))], MAX_FOLDED)
    return ConstantOperand(np.arange(start, limit, step).astype(np.asarray(ends[0]).dtype))


@operator("Reshape", 5, 14, 19, *_SHAPE_VERSIONS)
def _reshape(call: NodeCall) -> Operand:
    operand = call.required()
    shape = call.integers(1, "shape") or []
    if not call.node.integer("allowzero"):
        copied = [*operand.shape, *[0] * len(shape)]
        shape = [copied[axis] if length == 0 else length for axis, length in enumerate(shape)]
    return _reshaped(operand, shape)


def _reshaped(operand: Operand, shape: Sequence[int]) -> Operand:
    if any(length < -1 for length in shape):
        raise InputError(f"the shape {list(shape)} has a negative length; the model file is damaged")
    try:
        return operand.moved(lambda array: array.reshape(tuple(shape)))
    except ValueError:
        raise InputError(
            f"{counted(math.prod(operand.shape), 'number')} (of one row, shape {operand.shape}) do not fill the shape "
            f"{list(shape)}; export the model with a symbolic batch dimension"
        ) from None


@operator("Flatten", 1, 9, 11, *_SHAPE_VERSIONS)
def _flatten(call: NodeCall) -> Operand:
    operand, axis = call.required(), call.node.integer("axis", 1)
    rank = len(operand.shape)
    axis = axis if axis == rank else axis_of(axis, rank)
    return _reshaped(operand, (math.prod(operand.shape[:axis]), math.prod(operand.shape[axis:])))


def _axes(call: NodeCall) -> list[int] | None:
    if call.node.version >= 13:
        return call.integers(1, "axes")
    return call.node.integers("axes").tolist() if "axes" in call.node else None


@operator("Squeeze", 1, 11, *_SHAPE_VERSIONS)
def _squeeze(call: NodeCall) -> Operand:
    operand, axes = call.required(), _axes(call)
    rank = len(operand.shape)
    dropped = {axis for axis, length in enumerate(operand.shape) if length == 1}
    if axes is not None:
        wanted = {axis_of(axis, rank) for axis in axes}
        if not wanted <= dropped:
            raise InputError(f"drops axes {axes} of shape {operand.shape}, which are not all of length 1")
        dropped = wanted
    return _reshaped(operand, [length for axis, length in enumerate(operand.shape) if axis not in dropped])


@operator("Unsqueeze", 1, 11, *_SHAPE_VERSIONS)
def _unsqueeze(call: NodeCall) -> Operand:
    operand, axes = call.required(), _axes(call)
    if axes is None:
        raise InputError("axes are missing; the model file is damaged")
    rank = len(operand.shape) + len(axes)
    inserted = {axis_of(axis, rank) for axis in axes}
    if len(inserted) < len(axes):
        raise InputError(f"inserts axes {axes} twice; the model file is damaged")
    lengths = iter(operand.shape)
    return _reshaped(operand, [1 if axis in inserted else next(lengths) for axis in range(rank)])


@operator("Transpose", 1, *_SHAPE_VERSIONS)
def _transpose(call: NodeCall) -> Operand:
    operand, order = call.required(), call.node.integers("perm").tolist()
    order = order or list(reversed(range(len(operand.shape))))
    if sorted(order) != list(range(len(operand.shape))):
        raise InputError(f"perm {order} for {counted(len(operand.shape), 'dimension')}; the model file is damaged")
    return operand.moved(lambda array: array.transpose(order))


@operator("Concat", 4, 11, 13)
def _concat(call: NodeCall) -> Operand:
    parts = [call.required(number) for number in range(len(call.operands))]
    rank = len(parts[0].shape)
    if rank == 0:
        raise InputError("joins numbers without dimensions; the model file is damaged")
    return joined(call.walk, parts, axis_of(call.node.integer("axis"), rank))


def joined(walk: GraphWalk, parts: Sequence[Operand], axis: int) -> Operand:
    """The parts laid end to end along an axis."""
    parts = [walk.numbered(part) for part in parts if 0 not in part.shape] or list(parts)
    if any(isinstance(part, PickedOperand) for part in parts):
        raise UnsupportedModelError("joins what TopK picks; sums and means of it are supported")
    if any(isinstance(part, LabelOperand) for part in parts):
        raise UnsupportedModelError("joins labels that are texts; several labels of a row have to be whole numbers")
    if len({(part.dtype, isinstance(part, Tensor) and part.given) for part in parts}) > 1:
        require_same_type(*parts)
    limits = [limit for part in parts if (limit := as_between(part)) is not None]
    if any(isinstance(part, BetweenOperand) for part in parts) and len(limits) == len(parts):
        return joined_constants(limits, axis)
    constants = [part.array for part in parts if isinstance(part, ConstantOperand)]
    computed = next((part for part in parts if isinstance(part, Tensor)), None)
    try:
        if computed is None:
            check_size([sum(constant.size for constant in constants)], MAX_FOLDED)
            return ConstantOperand(np.concatenate(constants, axis))
        check_size([sum(math.prod(part.shape) for part in parts)])
        tensors = [
            walk.numbers(part.array, computed) if isinstance(part, ConstantOperand) else require_tensor(part)
            for part in parts
        ]
        if len({tensor.unrounded for tensor in tensors}) > 1:
            tensors = [_rounded(walk, tensor) for tensor in tensors]
        if any(tensor.uncut for tensor in tensors):
            tensors = [walk.cut(tensor) for tensor in tensors]
        return together(tensors, partial(np.concatenate, axis=axis))
    except ValueError:
        shapes = ", ".join(str(part.shape) for part in parts)
        raise InputError(f"tensors of shapes {shapes} cannot be joined along axis {axis}") from None


def _rounded(walk: GraphWalk, tensor: Tensor) -> Tensor:
    return walk.computed(walk.settle(tensor), tensor.shape, tensor.dtype, tensor.special)


@operator("Where", 9, 16)
def _where(call: NodeCall) -> Operand:
    """A constant condition, such as a mask, picks columns; a computed one chooses between numbers.

    onnxruntime may give 0 for a -0 that is picked (core/providers/cpu/tensor/where_op.cc).
    """
    condition = call.required()
    if not isinstance(condition, ConstantOperand):
        return choice_of(call)
    if condition.dtype != np.bool_:
        raise InputError(f"the condition is of type {condition.dtype}; the model file is damaged")
    sides = [call.required(number) for number in (1, 2)]
    shape = np.broadcast_shapes(condition.shape, *(side.shape for side in sides))
    check_size(shape)
    size = math.prod(shape)
    flat = [side.moved(lambda array: np.broadcast_to(array, shape)) for side in sides]
    places = np.arange(size).reshape(shape) + np.where(condition.array, 0, size)
    call.walk.builder.open_zeros |= any(isinstance(side, Tensor) for side in sides)
    return mixed(call.walk, flat, places)


def mixed(walk: GraphWalk, parts: Sequence[Operand], places: IntArray) -> Operand:
    """Elements of all parts, by their places where these are laid end to end."""
    lists = [part.moved(np.ravel) for part in parts]
    return joined(walk, lists, 0).moved(lambda array: array[places])


@operator("Pad", 2, 11, 13, 18, 19, *_SHAPE_VERSIONS[1:])
def _pad(call: NodeCall) -> Operand:
    operand, mode, by_input = call.required(), call.node.text("mode", "constant"), call.node.version >= 11
    filler = call.constant(2, "the number to fill with") if by_input else np.full(1, call.node.number("value", 0.0))
    pads = (call.integers(1, "pads") if by_input else call.node.integers("pads").tolist()) or []
    rank = len(operand.shape)
    axes = call.integers(3, "axes") or list(range(rank))
    if len(pads) != 2 * len(axes) or (filler is not None and filler.size != 1):
        raise InputError(
            f"pads {pads} for {counted(len(axes), 'axis', 'axes')}, or not one number "
            f"to fill with; the model file is damaged"
        )
    around = dict.fromkeys(range(rank), (0, 0))
    for number, axis in enumerate(axes):
        around[axis_of(axis, rank)] = pads[number], pads[number + len(axes)]
    if any(min(pair) < 0 for pair in around.values()):
        raise UnsupportedModelError(f"pads {pads} cut something off; use Slice for it")
    width = [around[axis] for axis in range(rank)]
    shape = [length + sum(pair) for pair, length in zip(width, operand.shape, strict=True)]
    check_size(shape, MAX_COLUMNS if isinstance(operand, Tensor) else MAX_FOLDED)
    if mode in ("edge", "wrap", "reflect"):
        if mode != "edge" and any(max(pair) >= length for pair, length in zip(width, operand.shape, strict=True)):
            raise UnsupportedModelError(f"pads {pads} in the mode {mode} are longer than the tensor, {operand.shape}")
        return operand.moved(partial(np.pad, pad_width=width, mode=mode))
    if mode != "constant":
        raise InputError(f"mode {mode} is not known; the model file is damaged")
    fill = np.zeros(1, operand.dtype) if filler is None else filler.ravel().astype(operand.dtype)
    if isinstance(operand, ConstantOperand):
        return ConstantOperand(np.pad(operand.array, width, constant_values=fill[0]))
    if not np.any(width):
        return operand
    tensor = require_float(require_tensor(operand))
    tensor = _rounded(call.walk, tensor) if tensor.unrounded else tensor
    filled = call.walk.numbers(fill, tensor)
    return replace(
        tensor,
        value=np.pad(tensor.value, width, constant_values=filled.value[0]),
        column=np.pad(tensor.column, width, constant_values=filled.column[0]),
        special=False,
    )


@operator("Gather", 1, 11, 13)
def _gather(call: NodeCall) -> Operand:
    operand, position = call.required(), call.required(1)
    if isinstance(position, LabelOperand):
        return labelled(operand, position)
    if isinstance(position, PickedOperand):
        return of_nearest(operand, position)
    axis = axis_of(call.node.integer("axis"), len(operand.shape))
    if isinstance(position, Tensor):
        return looked_up(call.walk, operand, _from_the_front(call.walk, position, operand.shape[axis]), axis)
    return picked(operand, call.positions(), axis)


def _from_the_front(walk: GraphWalk, position: Tensor, length: int) -> Tensor:
    """Positions below 0, which count from the end, as those from the front."""
    value, size = walk.settle(position), position.size
    before = walk.builder.add(Exceeds((walk.builder.scale(value, "*", np.full(size, -1.0)),), np.zeros(size)))
    moved = walk.builder.combine(value, "+", walk.builder.scale(before, "*", np.full(size, float(length))))
    return replace(walk.computed(moved, position.shape, position.dtype), given=position.given)


def looked_up(walk: GraphWalk, table: Operand, position: Tensor, axis: int) -> Tensor:
    """Numbers of a constant table at positions that are computed; there is no answer for positions beyond it."""
    require_same_type(position)
    if position.dtype not in INTEGERS:
        raise UnsupportedModelError(f"picks by positions of {position.dtype}; integers are supported")
    if not isinstance(table, ConstantOperand) or table.dtype not in (FLOAT32, FLOAT64):
        raise UnsupportedModelError("picks by a computed position; it can be looked up in constants of float only")
    if not np.all(np.isfinite(table.array)):
        raise UnsupportedModelError("looks up numbers of which some are infinite or NaN")
    rows = np.moveaxis(table.array, axis, -1)
    shape = (*table.shape[:axis], *position.shape, *table.shape[axis + 1 :])
    listed, count = rows.reshape(-1, rows.shape[-1]).astype(np.float64), rows.shape[-1]
    check_size([*shape, count], MAX_FOLDED)
    walk.charge(math.prod([*shape, count]))
    places = np.arange(position.size).reshape((1,) * axis + position.shape + (1,) * (len(table.shape) - axis - 1))
    ones = [1] * len(position.shape)
    others = np.arange(len(listed)).reshape((*table.shape[:axis], *ones, *table.shape[axis + 1 :]))
    column, row = (np.broadcast_to(array, shape).ravel() for array in (places, others))
    op = Piecewise(
        (walk.builder.select(column.astype(np.int32), walk.settle(position)),),
        start=np.arange(len(row) + 1) * count,
        knots=np.tile(np.arange(float(count)), len(row)),
        at=listed[row].ravel(),
        pieces=np.full((len(row) * (count + 1), 1), np.inf),
    )
    return walk.computed(op, shape, table.dtype)


def labelled(labels: Operand, choice: LabelOperand) -> LabelOperand:
    """The element of a constant list whose position was chosen."""
    if not isinstance(labels, ConstantOperand) or math.prod(labels.shape) != max(labels.shape, default=0):
        raise UnsupportedModelError("picks by a computed position; only a constant list of labels can be picked from")
    listed = np.ravel(labels.array).tolist()
    if not all(isinstance(at, int) and 0 <= at < len(listed) for at in choice.labels):
        raise InputError(
            f"picks from {counted(len(listed), 'number')} by positions beyond them, on which onnxruntime fails"
        )
    kind = None if labels.dtype.kind == "O" else labels.dtype
    return replace(choice, labels=tuple(listed[int(at)] for at in choice.labels), number_type=kind)


def of_nearest(numbers: Operand, position: PickedOperand) -> PickedOperand:
    """The elements of a constant list that stand at the positions of the nearest rows."""
    places = position.whole
    if not isinstance(places, ConstantOperand) or not np.issubdtype(places.dtype, np.integer):
        raise UnsupportedModelError("picks by the distances of the nearest rows")
    if not isinstance(numbers, ConstantOperand) or numbers.array.dtype.kind not in "fi":
        raise UnsupportedModelError("picks by a computed position; only a constant list of numbers can be picked from")
    if math.prod(numbers.shape) != max(numbers.shape, default=0):
        raise UnsupportedModelError(
            "the nearest rows have several numbers each; export one model for each output, LocalOutlierFactor as .skops"
        )
    if np.any((places.array < 0) | (places.array >= numbers.array.size)):
        raise InputError(f"positions outside 0 .. {numbers.array.size - 1}; the model file is damaged")
    return replace(position, whole=ConstantOperand(np.ravel(numbers.array)[places.array]))


def picked(operand: Operand, indices: AnyArray, axis: int) -> Operand:
    """Elements of an operand along an axis, by constant positions (negative: from the end)."""
    if not operand.shape:
        raise InputError("picks elements of a number without dimensions; the model file is damaged")
    length = operand.shape[axis]
    if np.any((indices < -length) | (indices >= length)):
        raise InputError(
            f"positions outside 0 .. {length - 1}; the model file is damaged, or its exporter lost columns; compile "
            "the native model"
        )
    others = math.prod(operand.shape[:axis] + operand.shape[axis + 1 :])
    check_size([others, indices.size], MAX_COLUMNS if isinstance(operand, Tensor) else MAX_FOLDED)
    return operand.moved(lambda array: np.take(array, indices, axis=axis))


@operator("GatherElements", 11, 13)
def _gather_elements(call: NodeCall) -> Operand:
    """Each element by its own place and a position along one axis; fewer positions take a part of the other axes."""
    operand, positions = call.required(), call.positions()
    axis, shape = axis_of(call.node.integer("axis"), len(operand.shape)), operand.shape
    length = shape[axis] if shape else 0
    if (
        positions.ndim != len(shape)
        or np.any((positions < -length) | (positions >= length))
        or any(n > most for at, (n, most) in enumerate(zip(positions.shape, shape, strict=True)) if at != axis)
    ):
        raise InputError(f"positions of shape {positions.shape}, or beyond those of shape {shape}")
    check_size(positions.shape)
    places: list[AnyArray] = list(np.indices(positions.shape, sparse=True))
    places[axis] = positions
    return operand.moved(lambda array: np.asarray(array[tuple(places)]))


@operator("Slice", 1, 10, 11, 13)
def _slice(call: NodeCall) -> Operand:
    operand = call.required()
    if call.node.version == 1:
        given = [call.node.integers(name).tolist() or None for name in ("starts", "ends", "axes")]
    else:
        given = [call.integers(number, name) for number, name in enumerate(("starts", "ends", "axes"), 1)]
    starts, ends, axes = given
    steps = call.integers(4, "steps")
    if starts == ends == []:
        return operand
    if not starts or ends is None or len({len(part) for part in (starts, ends, axes or starts, steps or starts)}) > 1:
        raise InputError("starts, ends, axes and steps are missing or of different lengths; the model file is damaged")
    taken = [slice(None)] * len(operand.shape)
    for number, axis in enumerate(axes or range(len(starts))):
        step = steps[number] if steps else 1
        if step == 0:
            raise InputError("a step of 0; the model file is damaged")
        length = operand.shape[axis_of(axis, len(operand.shape))]
        # backwards, a start before the first is the first, and an end before the first is none
        start = max(starts[number], -length) if step < 0 else starts[number]
        end = None if step < 0 and ends[number] < -length else ends[number]
        taken[axis_of(axis, len(operand.shape))] = slice(start, end, step)
        # a shape may lose all of its lengths, numbers of a row may not
        if not isinstance(operand, ConstantOperand) and not len(range(length)[slice(start, end, step)]):
            raise UnsupportedModelError(f"takes no columns from {starts[number]} to {ends[number]} of {length}")
    return operand.moved(lambda array: array[tuple(taken)])


@operator("Split", 2, 11, 13, 18)
def _split(call: NodeCall) -> Result:
    operand, count = call.required(), len(call.node.proto.output)
    axis = axis_of(call.node.integer("axis"), len(operand.shape))
    length = operand.shape[axis]
    sizes = call.integers(1, "split") if call.node.version >= 13 else call.node.integers("split").tolist()
    if not sizes:
        each = -(-length // count)
        sizes = [max(min(each, length - each * number), 0) for number in range(count)]
    if 0 in sizes and not isinstance(operand, ConstantOperand):
        raise UnsupportedModelError(f"parts of {sizes}, of which one has no columns; leave it out of the graph")
    if len(sizes) != count or sum(sizes) != length or min(sizes) < 0:
        raise InputError(
            f"parts of {sizes} for {counted(count, 'output')} and "
            f"{counted(length, 'column')}; the model file is damaged"
        )
    ends = np.cumsum(sizes)
    return tuple(
        operand.moved(partial(np.take, indices=np.arange(end - size, end), axis=axis))
        for size, end in zip(sizes, ends, strict=True)
    )


@operator("Expand", 8, 13)
def _expand(call: NodeCall) -> Operand:
    operand, wanted = call.required(), call.integers(1, "shape") or []
    try:
        shape = np.broadcast_shapes(operand.shape, tuple(wanted))
    except ValueError:
        raise InputError(f"shape {operand.shape} does not grow to {wanted}; the model file is damaged") from None
    check_size(shape, MAX_COLUMNS if isinstance(operand, Tensor) else MAX_FOLDED)
    return operand.moved(lambda array: np.broadcast_to(array, shape))


@operator("Tile", 6, 13)
def _tile(call: NodeCall) -> Operand:
    operand, times = call.required(), call.integers(1, "repeats") or []
    if len(times) != len(operand.shape) or min(times, default=1) < 0:
        raise InputError(f"repeats shape {operand.shape} {times} times; the model file is damaged")
    check_size([*operand.shape, *times], MAX_FOLDED if isinstance(operand, ConstantOperand) else MAX_COLUMNS)
    return operand.moved(partial(np.tile, reps=times))


@operator("ConstantOfShape", 9, 20, 21, 23, 24, 25)
def _constant_of_shape(call: NodeCall) -> Operand:
    shape, value = call.integers(0, "shape") or [], call.node.tensor("value")
    check_size(shape, MAX_FOLDED)
    filler = np.zeros(1, np.float32) if value is None else value
    if filler.size != 1 or min(shape, default=1) < 0:
        raise InputError("the value is not one number, or the shape is negative; the model file is damaged")
    return ConstantOperand(np.full(tuple(shape), np.ravel(filler)[0], filler.dtype))
