"""Networks of small integers: numbers divided by a scale and rounded, sums of products of integers, and numbers again.

Rules of onnxruntime (core/mlas/lib/quantize.cpp, core/providers/cpu/quantization): a quotient in float is limited,
rounded to the nearest whole number, of a tie to the even one, and moved by the zero point. Integers here are numbers
that have no fraction, and their sums stay below 2**31, so that nothing is rounded.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir.arrays import AnyArray, FloatArray
from st_codegen.walkers.onnx.convolution import convolved, image_of, padded, window_of
from st_codegen.walkers.onnx.elementwise import equals
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, Result, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    MAX_FOLDED,
    ConstantOperand,
    Operand,
    Tensor,
    axis_of,
    check_size,
    require_same_type,
    require_tensor,
)
from st_codegen.walkers.onnx.operators import combined, extreme_of, with_constant

#: Types of quantized numbers, and that of sums of their products, which are numbers again only.
_SMALL = tuple(np.dtype(kind) for kind in (np.uint8, np.int8, np.uint16, np.int16))
_SUMS = np.dtype(np.int32)
_VERSIONS = (10, 13, 19, 21, 23, 24, 25)
#: Machines without instructions for it add two products of 8 bits each in 16 bits, and cut what does not fit.
_LARGEST_PAIR = 2**15 - 1


def _small(dtype: np.dtype[Any], *more: np.dtype[Any]) -> np.dtype[Any]:
    if dtype not in (*_SMALL, *more):
        raise UnsupportedModelError(f"quantized numbers of {dtype}; integers of 8 and 16 bits are supported")
    return dtype


def _spread(call: NodeCall, number: int, what: str, shape: tuple[int, ...]) -> FloatArray:
    """A constant scale or zero point for each element of a shape: one for all, or one for each place of an axis."""
    array = call.constant(number, what)
    if array is None:
        return np.zeros(shape)
    if call.node.integer("block_size"):
        raise UnsupportedModelError("a scale for each block; one for all or for each place of an axis are supported")
    if array.size == 1:
        return np.full(shape, float(array.ravel()[0]))
    axis = axis_of(call.node.integer("axis", 1), len(shape))
    if array.shape != shape[axis : axis + 1]:
        raise InputError(f"{what} has shape {array.shape}, expected one for axis {axis} of {shape}")
    lengths = [-1 if at == axis else 1 for at in range(len(shape))]
    return np.broadcast_to(array.astype(np.float64).reshape(lengths), shape)


def _scale(call: NodeCall, shape: tuple[int, ...]) -> FloatArray:
    operand = call.required(1)
    if operand.dtype != FLOAT32:
        raise UnsupportedModelError(f"a scale of {operand.dtype}; float is supported")
    found = _spread(call, 1, "the scale", shape)
    if not np.all((found > 0) & np.isfinite(found)):
        raise UnsupportedModelError("a scale that is not above 0")
    return found


def _quantized(walk: GraphWalk, tensor: Tensor, zero: FloatArray, dtype: np.dtype[Any]) -> Tensor:
    """Quotients limited, rounded and moved by the zero point."""
    ends, moved = np.iinfo(dtype), np.ravel(zero)
    clipped = walk.builder.add(ir.Clip((walk.settle(tensor),), ends.min - moved, ends.max - moved))
    rounded = walk.builder.add(ir.WholeNumber((clipped,), tensor.size))
    return walk.computed(walk.builder.scale(rounded, "+", moved) if np.any(moved) else rounded, tensor.shape, dtype)


@operator("QuantizeLinear", *_VERSIONS)
def _quantize(call: NodeCall) -> Operand:
    operand, zero = call.required(), call.optional(2)
    if operand.dtype != FLOAT32:
        raise UnsupportedModelError(f"quantizes numbers of {operand.dtype}; float is supported")
    if call.node.integer("output_dtype") or call.node.integer("precision"):
        raise UnsupportedModelError("output_dtype or precision; give the type by a zero point")
    dtype = _small(np.dtype(np.uint8) if zero is None else zero.dtype)
    scale = _scale(call, operand.shape)
    moved = _spread(call, 2, "the zero point", operand.shape)
    if isinstance(operand, ConstantOperand):
        check_size(operand.shape, MAX_FOLDED)
        ends = np.iinfo(dtype)
        with np.errstate(over="ignore"):
            quotient = operand.array / scale.astype(np.float32)
        whole = np.rint(np.clip(quotient.astype(np.float64), ends.min - moved, ends.max - moved))
        if np.any(np.isnan(whole)):
            raise UnsupportedModelError("quantizes NaN")
        return ConstantOperand((whole + moved).astype(dtype))
    tensor, walk = require_tensor(operand), call.walk
    walk.refuse_special(tensor)
    return _quantized(walk, with_constant(walk, tensor, ir.Operator.DIVIDE, scale), moved, dtype)


@operator("DequantizeLinear", *_VERSIONS)
def _dequantize(call: NodeCall) -> Operand:
    operand = call.required()
    _small(require_same_type(operand), _SUMS)
    if call.node.integer("output_dtype"):
        raise UnsupportedModelError("output_dtype; float is what a scale of float gives")
    scale, zero = _scale(call, operand.shape), _spread(call, 2, "the zero point", operand.shape)
    if isinstance(operand, ConstantOperand):
        check_size(operand.shape, MAX_FOLDED)
        return ConstantOperand((operand.array - zero).astype(np.float32) * scale.astype(np.float32))
    walk, tensor = call.walk, require_tensor(operand)
    value = walk.settle(tensor)
    value = walk.builder.scale(value, "-", zero.ravel()) if np.any(zero) else value
    numbers = walk.computed(value, tensor.shape, _SUMS if tensor.dtype == _SUMS else FLOAT32)
    return with_constant(walk, walk.as_type(numbers, FLOAT32), ir.Operator.MULTIPLY, scale)


@operator("DynamicQuantizeLinear", 11)
def _quantize_by_range(call: NodeCall) -> Result:
    """Scale and zero point from the smallest and the largest of all numbers, and of 0 (dynamicquantizelinear.cc).

    Where these lie so near that float has no scale for them (1E-43), there is no answer.
    """
    tensor, walk = call.computed(), call.walk
    flat = tensor.moved(lambda array: array.reshape(1, -1))
    low, high = (
        with_constant(walk, extreme_of(walk, flat, code).moved(np.ravel), code, 0.0)
        for code in (ir.Operator.MINIMUM, ir.Operator.MAXIMUM)
    )
    span = require_tensor(combined(walk, ir.Operator.SUBTRACT, high, low))
    step = with_constant(walk, span, ir.Operator.DIVIDE, 255.0)
    absent = walk.computed(equals(walk, walk.settle(span), np.zeros(1)), (1,), FLOAT32)
    step = require_tensor(combined(walk, ir.Operator.ADD, step, absent))
    below = require_tensor(combined(walk, ir.Operator.DIVIDE, low, step))
    turned = with_constant(walk, below, ir.Operator.SUBTRACT, 0.0, left=True)
    zero = _quantized(walk, turned, np.zeros(1), np.dtype(np.uint8))
    quotient = require_tensor(combined(walk, ir.Operator.DIVIDE, tensor, step))
    # limited to what is left beside the zero point: rounded first it is the same, since both ends are whole
    limited = walk.builder.add(ir.Clip((walk.settle(quotient),), *(np.full(tensor.size, end) for end in (-256, 256))))
    whole = walk.computed(walk.builder.add(ir.WholeNumber((limited,), tensor.size)), tensor.shape, FLOAT32)
    moved = require_tensor(combined(walk, ir.Operator.ADD, whole, walk.as_type(zero, FLOAT32)))
    ends = (np.full(tensor.size, end) for end in (0.0, 255.0))
    found = walk.computed(ir.Clip((walk.settle(moved),), *ends), tensor.shape, zero.dtype)
    return found, step.moved(lambda array: array.reshape(())), zero.moved(lambda array: array.reshape(()))


def _sums(call: NodeCall, b: int, b_zero: int) -> Tensor:
    """The sums of products of integers with constant ones, each less its zero point."""
    left, walk = require_tensor(call.required()), call.walk
    weights = call.constant(b, "the second matrix")
    eight, _ = (np.dtype(np.uint8), np.dtype(np.int8)), require_same_type(left)
    if weights is None or weights.dtype not in eight or left.dtype not in eight or weights.ndim != 2:
        raise UnsupportedModelError("multiplies other than integers of 8 bits by a constant matrix of them")
    if left.shape[-1:] != weights.shape[:1] or left.size != left.shape[-1]:
        raise UnsupportedModelError(f"multiplies shapes {left.shape} and {weights.shape}; one row is supported")
    zero = call.constant(b_zero, "the zero point of the weights")
    if zero is not None and zero.size not in (1, weights.shape[1]):
        raise InputError(
            f"zero points of shape {zero.shape} for {counted(weights.shape[1], 'column')}; the model file is damaged"
        )
    _check_pairs(weights)
    own = weights.astype(np.float64) - (0.0 if zero is None else zero.astype(np.float64).ravel())
    if 255.0 * np.max(np.sum(np.abs(own), axis=0)) >= 2.0**31:
        raise UnsupportedModelError("sums of more than 31 bits")
    walk.charge(own.size)
    total = walk.builder.linear(_moved(call, left), own.T, order=ir.SummationOrder.SEQUENTIAL)
    return walk.computed(total, (*left.shape[:-1], weights.shape[1]), _SUMS)


def _moved(call: NodeCall, tensor: Tensor) -> int:
    """Integers less their zero point, which may be computed."""
    walk, moved = call.walk, call.optional(2)
    value = walk.settle(tensor)
    if isinstance(moved, Tensor):
        row = moved.moved(lambda array: np.broadcast_to(np.ravel(array), tensor.size))
        return walk.builder.combine(value, "-", walk.settle(row))
    if moved is None:
        return value
    numbers = call.constant(2, "the zero point")
    if numbers is None or numbers.size != 1:
        raise UnsupportedModelError("a zero point for each row; one for all is supported")
    return walk.builder.scale(value, "-", float(numbers.ravel()[0])) if np.any(numbers) else value


def _check_pairs(weights: AnyArray) -> None:
    """Raise UnsupportedModelError where two products may be more than machines keep of a pair of them."""
    if weights.dtype != np.int8 or len(weights) < 2:
        return
    ordered = np.sort(weights.astype(np.int64), axis=0)
    if 255 * max(np.max(ordered[-2:].sum(axis=0)), -np.min(ordered[:2].sum(axis=0))) > _LARGEST_PAIR:
        raise UnsupportedModelError(
            "signed weights beyond 64: of their products with unsigned numbers onnxruntime keeps 16 bits a pair on "
            "machines with AVX2 but without VNNI, and all bits on others; quantize with weight_type=QUInt8 or "
            "reduce_range=True, or in the QDQ format"
        )


@operator("MatMulInteger", 10)
def _integer_product(call: NodeCall) -> Operand:
    return _sums(call, 1, 3)


def _convolution_sums(call: NodeCall, b: int, b_zero: int, bias: int | None) -> Tensor:
    """The sums of products of an image of integers and a constant kernel, each less its zero point, and the bias."""
    tensor, walk, kernel = require_tensor(call.required()), call.walk, call.constant(b, "the kernel")
    eight, _ = (np.dtype(np.uint8), np.dtype(np.int8)), require_same_type(tensor)
    if kernel is None or kernel.dtype not in eight or tensor.dtype not in eight or kernel.ndim != len(tensor.shape):
        raise UnsupportedModelError("slides a kernel over other than integers of 8 bits; both have to be such")
    array = call.constant(b_zero, "the zero point of the kernel")
    zero = np.zeros(1) if array is None else array.astype(np.float64).ravel()
    if zero.size not in (1, len(kernel)):
        raise InputError(f"zero points of shape {zero.shape} for {counted(len(kernel), 'output')}")
    _check_pairs(kernel.reshape(len(kernel), -1).T)
    own = kernel.astype(np.float64) - zero.reshape(-1, *[1] * (kernel.ndim - 1))
    given = None if bias is None else call.constant(bias, "the bias")
    added = np.zeros(1) if given is None else np.abs(given.astype(np.float64))
    if 255.0 * np.max(np.sum(np.abs(own), axis=tuple(range(1, own.ndim)))) + np.max(added) >= 2.0**31:
        raise UnsupportedModelError("sums of more than 31 bits")
    image = image_of(walk, walk.computed(_moved(call, tensor), tensor.shape, tensor.dtype))
    window = window_of(call, tensor.shape[2:], kernel.shape[2:])
    groups = call.node.integer("group", 1)
    found = convolved(walk, padded(walk, image, window), own, given, groups, window, integers=True)
    return replace(found, dtype=_SUMS)


@operator("ConvInteger", 10)
def _integer_convolution(call: NodeCall) -> Operand:
    return _convolution_sums(call, 1, 3, None)


@operator("QLinearConv", 10)
def _quantized_convolution(call: NodeCall) -> Operand:
    totals = _convolution_sums(call, 3, 5, 8)
    return _requantized(call, totals, 1)


@operator("QLinearMatMul", 10, 21)
def _quantized_product(call: NodeCall) -> Operand:
    totals = _sums(call, 3, 5)
    return _requantized(call, totals, len(totals.shape) - 1)


def _requantized(call: NodeCall, totals: Tensor, axis: int) -> Operand:
    """Sums times a factor in float, rounded as quotients are (core/mlas/lib/quantize.cpp: MlasRequantizeOutput).

    Along an axis there may be a scale of the weights for each place.
    """
    zero, lengths = call.required(7), [-1 if at == axis else 1 for at in range(len(totals.shape))]
    scales = []
    for number in (1, 4, 6):
        array = call.constant(number, "a scale")
        if (
            array is None
            or array.dtype != FLOAT32
            or array.size not in (1, *((totals.shape[axis],) if number == 4 else ()))
        ):
            raise UnsupportedModelError("scales other than one float for all, or one for each output of the weights")
        scales.append(np.ravel(array))
    factor = np.broadcast_to((scales[0] * scales[1] / scales[2]).reshape(lengths), totals.shape)
    numbers = with_constant(call.walk, call.walk.as_type(totals, FLOAT32), ir.Operator.MULTIPLY, factor)
    moved = _spread(call, 7, "the zero point", totals.shape)
    return _quantized(call.walk, numbers, moved, _small(zero.dtype))
