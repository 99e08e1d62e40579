"""Convolutions, poolings and the normalization of a batch: what slides over the columns of a row.

onnxruntime turns a convolution into a product of matrices (core/providers/cpu/nn/conv.cc), whose order of additions is
open; the places and the padding are those of conv_attributes.h and pool_attributes.h. A maximum is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, BoolArray, Function, IntArray, Operator, Scale, SlidingLinear
from st_codegen.walkers.onnx.file import GraphNode
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, operator
from st_codegen.walkers.onnx.operands import Operand, Tensor, check_size, require_tensor, together
from st_codegen.walkers.onnx.operators import (
    apply_activation,
    combined,
    extreme_of,
    mean_of,
    product_of,
    total_of,
    with_constant,
)

#: Operations that one node may become: a convolution in groups is one operation a group.
_MAX_GROUPS = 64

#: The largest exponent of a norm over windows.
_MAX_NORM = 8

#: Roundings of the library between the numbers of the file and a constant that it computes of them.
_ROUNDINGS = 8


@dataclass(frozen=True)
class _Window:
    """Where a kernel is laid: for each spatial axis its length, its steps, and the zeros before and behind."""

    kernel: tuple[int, ...]
    strides: tuple[int, ...]
    dilations: tuple[int, ...]
    before: tuple[int, ...]
    behind: tuple[int, ...]
    places: tuple[int, ...]

    def along(self, axis: int) -> IntArray:
        """What each place reads along an axis, counted with the zeros in front, shape (places, kernel)."""
        starts = np.arange(self.places[axis]) * self.strides[axis]
        return starts[:, None] + np.arange(self.kernel[axis]) * self.dilations[axis]


def _steps(node: GraphNode, rank: int, kernel: Sequence[int]) -> tuple[list[int], list[int], list[int], list[int]]:
    """Kernel, strides, dilations and pads that a node names, or what stands for those that it does not name."""
    if rank not in (1, 2):
        raise UnsupportedModelError(f"slides over {rank} dimensions; 1 and 2 are supported")
    given = node.integers("kernel_shape").tolist() or list(kernel)
    strides, dilations = (node.integers(name).tolist() or [1] * rank for name in ("strides", "dilations"))
    pads = node.integers("pads").tolist() or [0] * (2 * rank)
    if node.text("auto_pad", "NOTSET") == "VALID":
        pads = [0] * (2 * rank)
    whole = [*given, *strides, *dilations]
    if len(whole) != 3 * rank or len(pads) != 2 * rank or min(whole) < 1 or min(pads) < 0 or max(whole + pads) > 2**16:
        raise InputError(
            f"kernel_shape {given}, strides {strides}, dilations {dilations}, pads {pads} for "
            f"{counted(rank, 'dimension')}; the model file is damaged"
        )
    return given, strides, dilations, pads


def window_of(call: NodeCall, lengths: Sequence[int], kernel: Sequence[int]) -> _Window:
    """The attributes of a node for an input of spatial lengths."""
    node, rank = call.node, len(lengths)
    given, strides, dilations, pads = _steps(node, rank, kernel)
    reach = [(length - 1) * step + 1 for length, step in zip(given, dilations, strict=True)]
    kind = node.text("auto_pad", "NOTSET")
    if kind in ("SAME_UPPER", "SAME_LOWER"):
        if max(dilations) > 1:  # onnxruntime pads for a kernel without them, which leaves places out
            raise UnsupportedModelError(f"auto_pad with dilations {dilations}; export the model with pads")
        needed = [
            max((-(-length // step) - 1) * step + wide - length, 0)
            for length, step, wide in zip(lengths, strides, reach, strict=True)
        ]
        pads = [(n + (kind == "SAME_LOWER")) // 2 for n in needed]
        pads += [n - first for n, first in zip(needed, pads, strict=True)]
    elif kind not in ("NOTSET", "VALID"):
        raise InputError(f"auto_pad {kind} is not known; the model file is damaged")
    left = [length + pads[axis] + pads[rank + axis] - reach[axis] for axis, length in enumerate(lengths)]
    if min(left) < 0:
        raise InputError(f"a kernel of {given} does not fit into {list(lengths)} columns; the model file is damaged")
    if node.integer("ceil_mode") and any(room % step for room, step in zip(left, strides, strict=True)):
        raise UnsupportedModelError("ceil_mode with a last window that is cut; export the model with ceil_mode=False")
    places = tuple(room // step + 1 for room, step in zip(left, strides, strict=True))
    return _Window(tuple(given), tuple(strides), tuple(dilations), tuple(pads[:rank]), tuple(pads[rank:]), places)


def _grid(window: _Window) -> tuple[IntArray, IntArray]:
    """For each place and each element of the kernel, where it reads along each axis: two such arrays, the first zeros
    for one dimension. Shape of each (places, elements).
    """
    last = window.along(len(window.kernel) - 1)
    first = window.along(0) if len(window.kernel) == 2 else np.zeros((1, 1), np.int64)
    shape = (first.shape[0] * last.shape[0], first.shape[1] * last.shape[1])
    rows = np.broadcast_to(first[:, None, :, None], (first.shape[0], last.shape[0], first.shape[1], last.shape[1]))
    columns = np.broadcast_to(last[None, :, None, :], rows.shape)
    return rows.reshape(shape), columns.reshape(shape)


def image_of(walk: GraphWalk, tensor: Tensor) -> Tensor:
    """A tensor as (channels, rows, columns), one row where there is one dimension."""
    if len(tensor.shape) not in (3, 4) or tensor.shape[0] != 1:
        raise UnsupportedModelError(
            f"slides over a tensor of shape {tensor.shape} (for one row); (1, channels, length) and (1, channels, "
            "height, width) are supported"
        )
    walk.refuse_special(tensor)
    return replace(tensor.moved(lambda array: array.reshape(array.shape[1], -1, array.shape[-1])), special=False)


def padded(walk: GraphWalk, image: Tensor, window: _Window, apart: Sequence[int] = (1, 1)) -> Tensor:
    """The image with zeros around it, and with its rows and columns so far apart, zeros between them."""
    before, behind, apart = (
        (other, *given)[-2:] for other, given in ((0, window.before), (0, window.behind), (1, apart))
    )
    lengths = [(length - 1) * step + 1 for length, step in zip(image.shape[1:], apart, strict=True)]
    shape = [image.shape[0], *(sum(parts) for parts in zip(before, lengths, behind, strict=True))]
    if shape == list(image.shape):
        return image
    check_size(shape)
    zero = walk.numbers(np.zeros(1, image.dtype), image)
    inside = [slice(first, first + n, step) for first, n, step in zip(before, lengths, apart, strict=True)]

    def spread(array: AnyArray, other: AnyArray) -> AnyArray:
        result = np.full(shape, other[0], array.dtype)
        result[:, *inside] = array
        return result

    return replace(image, value=spread(image.value, zero.value), column=spread(image.column, zero.column))


def _kernel(call: NodeCall, image: Tensor) -> tuple[AnyArray, AnyArray | None, int]:
    """The kernel, the bias and the number of groups of a convolution."""
    kernel, bias = call.constant(1, "the kernel"), call.constant(2, "the bias")
    if kernel is None or kernel.dtype != image.dtype or kernel.ndim != len(call.computed().shape):
        raise InputError("the kernel is missing, or not of the type and the dimensions of the input")
    return kernel, bias, call.node.integer("group", 1)


@operator("Conv", 1, 11, 22)
def _convolution(call: NodeCall) -> Operand:
    image = image_of(call.walk, call.computed())
    kernel, bias, groups = _kernel(call, image)
    window = window_of(call, call.computed().shape[2:], kernel.shape[2:])
    return convolved(call.walk, padded(call.walk, image, window), kernel, bias, groups, window)


@operator("ConvTranspose", 1, 11, 22)
def _transposed_convolution(call: NodeCall) -> Operand:
    """A convolution by the turned kernel of the image with zeros between its numbers, as many as the strides say."""
    image, node, rank = image_of(call.walk, call.computed()), call.node, len(call.computed().shape) - 2
    kernel, bias, groups = _kernel(call, image)
    given, strides, dilations, pads = _steps(node, rank, kernel.shape[2:])
    extra = node.integers("output_padding").tolist() or [0] * rank
    if len(extra) != rank or not all(
        0 <= more < max(steps) for more, *steps in zip(extra, strides, dilations, strict=True)
    ):
        raise InputError(f"output_padding {extra} for strides {strides} and dilations {dilations}")
    reach = [(length - 1) * step + 1 for length, step in zip(kernel.shape[2:], dilations, strict=True)]
    before = tuple(n - 1 - less for n, less in zip(reach, pads[:rank], strict=True))
    behind = tuple(n - 1 - less + more for n, less, more in zip(reach, pads[rank:], extra, strict=True))
    if (
        node.text("auto_pad", "NOTSET").startswith("SAME")
        or len(node.integers("output_shape"))
        or min(*before, *behind) < 0
    ):
        raise UnsupportedModelError(
            "auto_pad, output_shape, or pads beyond the kernel; export the model with other pads"
        )
    if groups < 1 or kernel.shape[0] % groups or kernel.shape[0] != image.shape[0]:
        raise InputError(
            f"a kernel of shape {kernel.shape} in {counted(groups, 'group')} for {counted(image.shape[0], 'channel')}"
        )
    lengths = [(n - 1) * step + 1 for n, step in zip(call.computed().shape[2:], strides, strict=True)]
    places = tuple(sum(parts) - n + 1 for *parts, n in zip(before, lengths, behind, reach, strict=True))
    window = _Window(tuple(given), (1,) * rank, tuple(dilations), before, behind, places)
    turned = np.flip(kernel, tuple(range(2, 2 + rank))).reshape(groups, -1, *kernel.shape[1:]).swapaxes(1, 2)
    turned = turned.reshape(-1, *turned.shape[2:])
    return convolved(call.walk, padded(call.walk, image, window, strides), turned, bias, groups, window)


def convolved(
    walk: GraphWalk,
    image: Tensor,
    kernel: AnyArray,
    bias: AnyArray | None,
    groups: int,
    window: _Window,
    *,
    integers: bool = False,
) -> Tensor:
    """Sums of products of a padded image and a kernel (outputs, channels of a group, spatial)."""
    outputs, depth = kernel.shape[:2]
    if groups < 1 or outputs % groups or depth * groups != image.shape[0] or not kernel.size:
        raise InputError(
            f"a kernel of shape {kernel.shape} in {counted(groups, 'group')} for {counted(image.shape[0], 'channel')}"
        )
    if groups > _MAX_GROUPS:
        raise UnsupportedModelError(f"a convolution in {groups} groups; at most {_MAX_GROUPS} are supported")
    if bias is not None and bias.shape != (outputs,):
        raise InputError(f"a bias of shape {bias.shape} for {counted(outputs, 'output')}; the model file is damaged")
    if kernel.shape[2:] != window.kernel:
        raise InputError(f"kernel_shape {list(window.kernel)} of a kernel of shape {kernel.shape}")
    check_size([outputs, *window.places])
    walk.charge(kernel.size)
    rows, columns = _grid(window)
    at = rows * image.shape[2] + columns
    whole, size = walk.settle(image), image.shape[1] * image.shape[2]
    own, results = outputs // groups, []
    for group in range(groups):
        part = slice(group * own, (group + 1) * own)
        op = SlidingLinear(
            inputs=(whole,),
            weights=kernel[part].reshape(own, -1).astype(np.float64),
            bias=np.zeros(own) if bias is None else bias[part].astype(np.float64),
            starts=at[:, 0] + group * depth * size,
            offsets=np.ravel(np.arange(depth)[:, None] * size + at[0]),
            precision=image.precision,
            whole=integers,
        )
        results.append(walk.computed(op, (len(at), own), image.dtype).moved(np.transpose))
    return together(results, np.concatenate).moved(lambda array: array.reshape(1, outputs, *window.places))


def _windows(call: NodeCall) -> tuple[Tensor, _Window, IntArray, BoolArray]:
    """What a pooling reads: the image, its window, and for each channel and place the columns and which of them lie
    inside.
    """
    if call.node.has_more_outputs:
        raise UnsupportedModelError("the second output, where each maximum stands; leave it out")
    image, lengths = image_of(call.walk, call.computed()), call.computed().shape[2:]
    window = window_of(call, lengths, ())
    before = (0, *window.before)[-2:]
    rows, columns = (found - less for found, less in zip(_grid(window), before, strict=True))
    inside = (rows >= 0) & (rows < image.shape[1]) & (columns >= 0) & (columns < image.shape[2])
    at = np.clip(rows, 0, image.shape[1] - 1) * image.shape[2] + np.clip(columns, 0, image.shape[2] - 1)
    if not np.all(np.any(inside, axis=1)):
        raise UnsupportedModelError("a window that lies in the padding alone; use less padding")
    return image, window, at, inside


@operator("MaxPool", 1, 8, 10, 11, 12, 22)
def _max_pool(call: NodeCall) -> Operand:
    image, window, at, inside = _windows(call)
    first = np.take_along_axis(at, np.argmax(inside, axis=1)[:, None], axis=1)
    at = np.where(inside, at, first)  # a number twice does not change the largest
    check_size([image.shape[0], at.size])
    rows = image.moved(lambda array: array.reshape(array.shape[0], -1)[:, at].reshape(-1, at.shape[1]))
    found = extreme_of(call.walk, rows, Operator.MAXIMUM)
    return found.moved(lambda array: array.reshape(1, image.shape[0], *window.places))


@operator("AveragePool", 1, 7, 10, 11, 19, 22)
def _average_pool(call: NodeCall) -> Operand:
    image, window, at, inside = _windows(call)
    walk, channels = call.walk, image.shape[0]
    counts = np.full(len(at), at.shape[1]) if call.node.integer("count_include_pad") else np.sum(inside, axis=1)
    sums = _window_sums(walk, image, window)
    return _divided(walk, sums, np.tile(counts, channels), image, (1, channels, *window.places))


def _window_sums(walk: GraphWalk, image: Tensor, window: _Window) -> int:
    """For each channel and place the sum of what lies in the window, of zeros where that is outside."""
    wide = padded(walk, image, window)
    channels, size = wide.shape[0], wide.shape[1] * wide.shape[2]
    rows, columns = _grid(window)
    at = rows * wide.shape[2] + columns
    check_size([channels, len(at)])
    starts = np.ravel(np.arange(channels)[:, None] * size + at[:, 0])
    ones = np.ones((1, at.shape[1]))
    return walk.builder.add(SlidingLinear((walk.settle(wide),), ones, np.zeros(1), starts, at[0], image.precision))


def _divided(walk: GraphWalk, sums: int, counts: AnyArray, image: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Sums by their counts; a library may multiply by the reciprocal."""
    divisor = counts.astype(np.float64)
    doubt = _ROUNDINGS * float(np.finfo(image.dtype).epsneg) * divisor
    op = Scale((sums,), Operator.DIVIDE, divisor, image.precision, doubt=doubt)
    return walk.computed(op, shape, image.dtype)


@operator("LpPool", 2, 11, 18, 22)
def _norm_pool(call: NodeCall) -> Operand:
    """The root of the sum of powers of magnitudes in each window, of zeros where it lies outside."""
    image, power = image_of(call.walk, call.computed()), call.node.integer("p", 2)
    window, walk = window_of(call, call.computed().shape[2:], ()), call.walk
    if not 1 <= power <= _MAX_NORM:
        raise UnsupportedModelError(f"p is {power}; 1 to {_MAX_NORM} are supported")
    sizes = apply_activation(walk, image, Function.ABS)
    powers = sizes if power == 1 else apply_activation(walk, sizes, Function.POWER, float(power))
    sums = walk.computed(_window_sums(walk, powers, window), (1, image.shape[0], *window.places), image.dtype)
    root = float(np.float32(1.0) / np.float32(power))  # as the library has it (core/providers/cpu/nn/pool_functors.h)
    return sums if power == 1 else apply_activation(walk, sums, Function.POWER, root)


@operator("GlobalMaxPool GlobalAveragePool", 1, 22)
def _global(call: NodeCall) -> Operand:
    image, walk = image_of(call.walk, call.computed()), call.walk
    rows = image.moved(lambda array: array.reshape(array.shape[0], -1))
    shape = (1, image.shape[0], *[1] * (len(call.computed().shape) - 2))
    if call.node.op_type == "GlobalMaxPool":
        return extreme_of(walk, rows, Operator.MAXIMUM).moved(lambda array: array.reshape(shape))
    total = walk.settle(total_of(walk, rows))
    return _divided(walk, total, np.full(rows.shape[0], rows.shape[1]), image, shape)


@operator("BatchNormalization", 7, 9, 14, 15)
def _batch_normalization(call: NodeCall) -> Operand:
    """x * s + (bias - mean * s) with s = scale / sqrt(variance + epsilon) (core/providers/cpu/nn/batch_norm.h).

    The library computes both constants when it predicts, with the roundings of its machine.
    """
    tensor, walk = call.computed(), call.walk
    if call.node.integer("training_mode") or call.node.has_more_outputs:
        raise UnsupportedModelError(
            "BatchNormalization in training mode; export the model for inference (model.eval())"
        )
    if call.node.version < 9 and call.node.integer("spatial", 1) != 1:
        raise UnsupportedModelError("BatchNormalization of each element (spatial=0); export with a newer opset")
    names = ("scale", "bias", "mean", "variance")
    given = [call.constant(number, name) for number, name in enumerate(names, 1)]
    channels = tensor.shape[1] if len(tensor.shape) > 1 else 1
    scale, bias, mean, variance = (np.asarray(array) for array in given)
    if any(array.shape != (channels,) or array.dtype != tensor.dtype for array in (scale, bias, mean, variance)):
        raise InputError(
            f"scale, bias, mean and variance are not {counted(channels, 'number')} of the type of the input each"
        )
    with np.errstate(all="ignore"):
        factor = scale * (1 / np.sqrt(variance + tensor.dtype.type(call.node.number("epsilon", 1e-5))))
        added = bias - mean * factor
    size = {Operator.MULTIPLY: np.abs(factor), Operator.ADD: np.abs(bias) + np.abs(mean * factor)}
    value, unit = walk.settle_finite(tensor), _ROUNDINGS * float(np.finfo(tensor.dtype).epsneg)
    spread = (1, channels, *[1] * (len(tensor.shape) - 2))
    for code, constant in ((Operator.MULTIPLY, factor), (Operator.ADD, added)):
        numbers, doubts = (
            np.broadcast_to(array.reshape(spread), tensor.shape).astype(np.float64).ravel()
            for array in (constant, unit * size[code].astype(np.float64))
        )
        value = walk.builder.scale(value, code, numbers, precision=tensor.precision, doubt=doubts)
    return walk.computed(value, tensor.shape, tensor.dtype)


@operator("InstanceNormalization", 6, 22)
def _instance_normalization(call: NodeCall) -> Operand:
    """x * f + (bias - mean * f) with f = scale / sqrt(variance + epsilon), of each channel
    (core/providers/cpu/nn/instance_norm.cc).
    """
    tensor, walk = call.computed(), call.walk
    walk.refuse_special(tensor)
    scale, bias = call.required(1), call.required(2)
    if len(tensor.shape) < 3 or tensor.shape[0] != 1:
        raise UnsupportedModelError(f"a tensor of shape {tensor.shape} (for one row); (1, channels, ..) is supported")
    if any(operand.shape != (tensor.shape[1],) or operand.dtype != tensor.dtype for operand in (scale, bias)):
        raise InputError(f"scale and bias are not {counted(tensor.shape[1], 'number')} of the type of the input each")
    rows = replace(tensor.moved(lambda array: array.reshape(tensor.shape[1], -1)), special=False)
    mean = mean_of(walk, rows)
    centred = combined(walk, Operator.SUBTRACT, rows, mean.moved(lambda array: array[:, None]))
    variance = mean_of(walk, product_of(walk, require_tensor(centred), require_tensor(centred)))
    shifted = with_constant(walk, variance, Operator.ADD, call.node.number("epsilon", 1e-5))
    spread = apply_activation(walk, shifted, Function.SQRT)
    factor = combined(walk, Operator.MULTIPLY, with_constant(walk, spread, Operator.DIVIDE, 1.0, left=True), scale)
    shift = combined(walk, Operator.SUBTRACT, bias, combined(walk, Operator.MULTIPLY, mean, factor))
    found = rows
    for code, number in ((Operator.MULTIPLY, factor), (Operator.ADD, shift)):
        found = require_tensor(combined(walk, code, found, number.moved(lambda array: array[:, None])))
    return found.moved(lambda array: array.reshape(tensor.shape))
