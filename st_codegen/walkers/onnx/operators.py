"""Arithmetic, linear maps and activations of the standard ONNX domain.

Arithmetic of two tensors is rounded once and exact. Sums of products (Gemm, MatMul, reductions) are added in an order
that onnxruntime's kernels choose by the machine, so they are equal within a bound only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import reference
from st_codegen.ir.arrays import AnyArray, FloatArray
from st_codegen.walkers.onnx.between import arithmetic_of, as_between, as_doubted, function_of, sum_of
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    INTEGERS,
    MAX_FOLDED,
    BetweenOperand,
    ConstantOperand,
    Operand,
    PickedOperand,
    Tensor,
    as_doubles,
    axis_of,
    check_size,
    require_finite,
    require_float,
    require_same_type,
    require_tensor,
    together,
)
from st_codegen.walkers.onnx.ranges import keep_below

#: Operations that one Softmax of a matrix may become: one a row.
_MAX_SHARES = 64
#: Below it a double holds each whole number, and the quotient of two rounds to no other one.
_WHOLE = 2.0**53
_SYMBOLS = {"Add": ir.Operator.ADD, "Sub": ir.Operator.SUBTRACT, "Mul": ir.Operator.MULTIPLY, "Div": ir.Operator.DIVIDE}


@operator("Add Sub Mul Div", 7, 13, 14)
def _arithmetic(call: NodeCall) -> Operand:
    code, pair = _SYMBOLS[call.node.op_type], [call.walk.numbered(call.required(number)) for number in (0, 1)]
    if any(isinstance(side, Tensor) and side.dtype in INTEGERS and not side.given for side in pair):
        return _of_integers(call.walk, code, pair)
    return combined(call.walk, code, *pair)


def _of_integers(walk: GraphWalk, code: ir.Operator, pair: list[Operand]) -> Operand:
    """Sums and products of computed integers; those that leave their type or a double have no answer."""
    dtype = pair[0].dtype
    if code is ir.Operator.DIVIDE or any(side.dtype != dtype for side in pair):
        raise UnsupportedModelError("divides computed integers, or mixes types of them; cast them to float")
    sides = [
        side.moved(as_doubles) if isinstance(side, ConstantOperand) else walk.as_type(require_tensor(side), FLOAT64)
        for side in pair
    ]
    found = require_tensor(combined(walk, code, *sides))
    walk.builder.open_zeros |= code is ir.Operator.MULTIPLY  # of integers 0 has no sign
    return replace(keep_below(walk, found, 2.0**31 if dtype == np.int32 else _WHOLE), dtype=dtype)


@operator("Sum Mean", 6, 8, 13)
def _total(call: NodeCall) -> Operand:
    """All inputs, added in order; the mean is that times what 1 / count is in float
    (core/providers/cpu/math/element_wise_ops.cc: Mean_8).
    """
    total = call.required()
    for number in range(1, len(call.operands)):
        total = combined(call.walk, ir.Operator.ADD, total, call.required(number))
    if call.node.op_type == "Sum":
        return total
    share = np.float32(1.0) / np.float32(len(call.operands))
    return with_constant(call.walk, require_tensor(total), ir.Operator.MULTIPLY, float(share))


def combined(walk: GraphWalk, code: ir.Operator, left: Operand, right: Operand) -> Operand:
    """`left <code> right` with broadcasting, rounded once."""
    left, right = walk.numbered(left), walk.numbered(right)
    require_same_type(left, right)
    try:
        shape = np.broadcast_shapes(left.shape, right.shape)
    except ValueError:
        raise InputError(
            f"shapes {left.shape} and {right.shape} (for one row) do not fit: the first dimension of an input is taken "
            "for rows; give each input one, or, where all have it, the model file is damaged"
        ) from None
    sides = as_between(left), as_between(right)
    if any(isinstance(side, BetweenOperand) for side in (left, right)):
        if sides[0] is not None and sides[1] is not None:
            check_size(shape, MAX_FOLDED)
            return arithmetic_of(code, sides[0], sides[1])
        numbers, doubt = as_doubted(next(side for side in sides if side is not None))
        tensor = require_tensor(right if sides[0] is not None else left)
        return _scaled(walk, code, tensor, numbers, shape, reverse=sides[0] is not None, doubt=doubt)
    if isinstance(left, ConstantOperand):
        if isinstance(right, ConstantOperand):
            check_size(shape, MAX_FOLDED)
            return ConstantOperand(_folded(code, left.array, right.array))
        return _scaled(walk, code, require_tensor(right), left.array, shape, reverse=True)
    if isinstance(right, ConstantOperand):
        return _scaled(walk, code, require_tensor(left), right.array, shape, reverse=False)
    check_size(shape)
    left, right = require_tensor(left), require_tensor(right)
    values = tuple(walk.settle(_spread(require_float(side), shape)) for side in (left, right))
    op = ir.Combine(inputs=values, operator=code, width=math.prod(shape), precision=left.precision)
    return walk.computed(op, shape, left.dtype, left.special or right.special)


def _scaled(
    walk: GraphWalk,
    code: ir.Operator,
    tensor: Tensor,
    constant: AnyArray,
    shape: tuple[int, ...],
    reverse: bool,
    doubt: FloatArray | None = None,
) -> Tensor:
    check_size(shape)
    if code is ir.Operator.DIVIDE and not reverse and not np.all(constant):
        raise UnsupportedModelError("divides by a constant that is 0, which gives infinity or NaN")
    scale = ir.Scale(
        inputs=(walk.settle(_spread(require_float(tensor), shape)),),
        operator=code,
        constant=require_finite(np.broadcast_to(constant, shape).astype(np.float64).ravel()),
        precision=tensor.precision,
        reverse=reverse,
        doubt=None if doubt is None else np.broadcast_to(doubt, shape).ravel(),
    )
    return walk.computed(scale, shape, tensor.dtype, tensor.special)


def _spread(tensor: Tensor, shape: tuple[int, ...]) -> Tensor:
    return tensor.moved(lambda array: np.broadcast_to(array, shape))


def _folded(code: ir.Operator, left: AnyArray, right: AnyArray) -> AnyArray:
    if left.dtype in (FLOAT32, FLOAT64):
        with np.errstate(all="ignore"):
            return np.asarray(reference.OPERATORS[code](left, right))
    # lengths are computed in whole numbers; a division rounds towards zero
    if left.dtype.kind != "i":
        raise UnsupportedModelError(f"computes with constants of {left.dtype}; fold constants when exporting")
    if code is ir.Operator.DIVIDE and not np.all(right):
        raise InputError("divides whole numbers by 0; the model file is damaged")
    found = np.trunc(reference.OPERATORS[code](left.astype(np.float64), right.astype(np.float64)))
    if np.any(np.abs(found) >= min(_WHOLE, np.iinfo(left.dtype).max)):
        raise UnsupportedModelError("computes with constants of more than 53 bits; fold constants when exporting")
    return found.astype(left.dtype)


@operator("Mod", 10, 13, 28)
def _remainder(call: NodeCall) -> Operand:
    left, right = call.constant(0, "a remainder"), call.constant(1, "a divisor")
    if left is None or right is None or left.dtype.kind != "i" or not np.all(right):
        raise UnsupportedModelError("remainders of whole-number constants by others than 0 are supported")
    return ConstantOperand(np.asarray((np.fmod if call.node.integer("fmod") else np.mod)(left, right)))


@operator("Neg", 6, 13)
def _negate(call: NodeCall) -> Operand:
    operand = call.walk.numbered(call.required())
    if isinstance(operand, Tensor):
        operand = require_float(operand)
    return combined(call.walk, ir.Operator.MULTIPLY, operand, ConstantOperand(np.array(-1.0, operand.dtype)))


def apply_linear(
    walk: GraphWalk,
    tensor: Tensor,
    weights: AnyArray,
    bias: AnyArray,
    shape: Sequence[int],
    doubt: FloatArray | None = None,
) -> Tensor:
    """weights @ row + bias for each row of so many elements of a tensor, added in any order."""
    walk.charge(weights.size)
    count, own = weights.shape[1], (walk.settle_finite(tensor),)
    op: ir.Linear | ir.SlidingLinear
    if tensor.size == count:
        op = ir.Linear(own, weights, bias, precision=tensor.precision, doubt=doubt)
    elif doubt is not None:
        raise UnsupportedModelError("multiplies several rows by constants that the graph computes by functions")
    else:
        check_size([tensor.size // count, len(weights)])
        starts, offsets = np.arange(0, tensor.size, count, dtype=np.int32), np.arange(count, dtype=np.int32)
        op = ir.SlidingLinear(own, weights, bias, starts, offsets, tensor.precision)
    return walk.computed(op, shape, tensor.dtype)


def _matrix(constant: ConstantOperand, tensor: Tensor) -> FloatArray:
    if constant.dtype != tensor.dtype:
        raise InputError(f"the weights are {constant.dtype}, the input {tensor.dtype}; the model file is damaged")
    return constant.array.astype(np.float64)


@operator("MatMul", 1, 9, 13)
def _matmul(call: NodeCall) -> Operand:
    return _factored(call.walk, call.required(), call.required(1))


def _factored(walk: GraphWalk, left: Operand, right: Operand) -> Operand:
    """The product of two tensors; with constant weights in two dimensions, on either side, it is a layer."""
    if (
        isinstance(left, Tensor)
        and isinstance(right, BetweenOperand)
        and (*left.shape[-1:], 2) == (*right.shape[:1], len(right.shape))
    ):
        numbers, doubt = as_doubted(right)
        weights = _matrix(ConstantOperand(numbers), require_float(left)).T
        return apply_linear(walk, left, weights, np.zeros(len(weights)), (*left.shape[:-1], len(weights)), doubt.T)
    if isinstance(left, Tensor) and isinstance(right, ConstantOperand) and right.array.ndim < 3:
        weights = _matrix(right, require_float(left))
        if right.array.ndim and left.shape[-1:] == weights.shape[:1]:
            shape = (*left.shape[:-1], *weights.shape[1:])
            weights = weights.reshape(len(weights), -1).T
            return apply_linear(walk, left, weights, np.zeros(len(weights)), shape)
    elif isinstance(left, ConstantOperand) and isinstance(right, Tensor) and left.array.ndim < 3:
        weights = _matrix(left, require_float(right))
        matrix = right.moved(lambda array: array.swapaxes(-1, -2) if array.ndim > 1 else array)
        if left.array.ndim and matrix.shape[-1:] == weights.shape[-1:]:
            shape = (*matrix.shape[:-1], *weights.shape[:-1])
            weights = weights.reshape(-1, matrix.shape[-1])
            found = apply_linear(walk, matrix, weights, np.zeros(len(weights)), shape)
            both = right.size > matrix.shape[-1] or len(right.shape) > 1
            return found.moved(lambda array: array.swapaxes(-1, -2)) if both and left.array.ndim > 1 else found
    return _matrix_product(walk, left, right)


def _matrix_product(walk: GraphWalk, left: Operand, right: Operand) -> Operand:
    """The product of any two tensors, as the sums of the products of their numbers."""
    try:
        shape = np.matmul(*(np.broadcast_to(np.int8(0), side.shape) for side in (left, right))).shape
    except ValueError:
        raise InputError(
            f"multiplies tensors of shapes {left.shape} and {right.shape} (for one row); export the model with a "
            "symbolic batch dimension"
        ) from None
    if isinstance(left, ConstantOperand) and isinstance(right, ConstantOperand):
        if left.dtype == right.dtype and left.array.ndim == right.array.ndim == 2 and left.shape[1] == 1:
            return combined(walk, ir.Operator.MULTIPLY, left, right)  # one product each, rounded once
        if all(map(np.any, (left.array, right.array))) or not np.all(
            np.isfinite([left.array.sum(), right.array.sum()])
        ):
            raise UnsupportedModelError("multiplies constants, in an order that is open; fold constants when exporting")
        return ConstantOperand(np.zeros(shape, left.dtype))
    rows = left.moved(lambda array: np.atleast_2d(array)[..., :, None, :])
    columns = right.moved(
        lambda array: np.atleast_2d(array.swapaxes(-1, -2) if array.ndim > 1 else array)[..., None, :, :]
    )
    products = require_tensor(combined(walk, ir.Operator.MULTIPLY, rows, columns))
    return total_of_last(walk, products, 1).moved(lambda array: array.reshape(shape))


def total_of_last(walk: GraphWalk, tensor: Tensor, count: int) -> Tensor:
    """The sums over the last so many axes."""
    shape = tensor.shape[: len(tensor.shape) - count]
    if not count:
        return tensor
    rows = tensor.moved(lambda array: array.reshape(math.prod(shape), -1))
    return total_of(walk, rows).moved(lambda array: array.reshape(shape))


@operator("Gemm", 7, 9, 11, 13)
def _gemm(call: NodeCall) -> Operand:
    left, right = call.required(), call.required(1)
    if isinstance(left, ConstantOperand):
        return _gemm_of_constant(call, left, right)
    tensor = call.computed()
    if not isinstance(right, ConstantOperand):
        raise UnsupportedModelError("both factors are computed; one of them has to be constant weights")
    weights = _matrix(right, tensor)
    if weights.ndim != 2 or len(tensor.shape) != 2:
        raise InputError(f"shapes {tensor.shape} and {weights.shape}, expected matrices; the model file is damaged")
    row = tensor.moved(np.transpose) if call.node.integer("transA") else tensor
    weights = weights if call.node.integer("transB") else weights.T
    if row.shape[1] != weights.shape[1]:
        raise InputError(f"multiplies shapes {row.shape} and {weights.T.shape}; the model file is damaged")
    shape = (row.shape[0], len(weights))
    alpha, added = call.node.number("alpha", 1.0), call.optional(2)
    if isinstance(added, Tensor):
        if row.shape[0] > 1:
            raise UnsupportedModelError("C is computed from the inputs, which is supported for one row only")
        return _gemm_sum(call, row, weights, added, alpha)
    bias = _gemm_bias(call, row, len(weights))
    if alpha == 1.0:
        return apply_linear(call.walk, row, weights, bias, shape)
    product = apply_linear(call.walk, row, weights, np.zeros(len(weights)), shape)
    scaled = combined(call.walk, ir.Operator.MULTIPLY, product, ConstantOperand(np.array(alpha, row.dtype)))
    return combined(call.walk, ir.Operator.ADD, scaled, ConstantOperand(bias.astype(row.dtype)))


def _gemm_of_constant(call: NodeCall, left: ConstantOperand, right: Operand) -> Operand:
    """A constant times constants, as the states are with which a loop begins, or times the columns of a tensor.

    What is added to constants may be computed; in a product of a tensor it would be one more term of the sum.
    """
    sides = (("transA", left), ("transB", right))
    found = _factored(call.walk, *(one.moved(np.transpose) if call.node.integer(key) else one for key, one in sides))
    added = call.optional(2)
    scaled = [
        key for key, one in (("alpha", found), ("beta", added)) if one is not None and call.node.number(key, 1.0) != 1.0
    ]
    if not isinstance(right, ConstantOperand) and (added is not None or scaled):
        more = "adds C to" if added is not None else "multiplies by alpha"
        raise UnsupportedModelError(f"{more} a product whose first factor is constant; write it as nodes of its own")
    if scaled:
        raise UnsupportedModelError(f"multiplies constants, and then by {scaled[0]}; fold constants when exporting")
    return found if added is None else combined(call.walk, ir.Operator.ADD, found, added)


def _gemm_sum(call: NodeCall, row: Tensor, weights: FloatArray, added: Tensor, alpha: float) -> Operand:
    """A sum in any order with computed numbers as further terms; a power of two as factor rounds nothing."""
    shape = (1, len(weights))
    if call.node.number("beta", 1.0) != 1.0 or abs(math.frexp(alpha)[0]) != 0.5 or added.dtype != row.dtype:
        raise UnsupportedModelError("C is computed from the inputs, which needs beta 1 and a power of two as alpha")
    try:
        spread = added.moved(lambda array: np.broadcast_to(array, shape))
    except ValueError:
        raise InputError(
            f"C has shape {added.shape} for {counted(len(weights), 'column')}; the model file is damaged"
        ) from None
    value = np.repeat([call.walk.settle(row), call.walk.settle(spread)], [row.size, spread.size])
    column = np.concatenate([np.arange(row.size), np.arange(spread.size)])
    whole = Tensor(value, column, row.dtype, special=row.special or added.special)
    return apply_linear(
        call.walk, whole, np.hstack([alpha * weights, np.eye(len(weights))]), np.zeros(len(weights)), shape
    )


def _gemm_bias(call: NodeCall, row: Tensor, width: int) -> FloatArray:
    """beta * C for each column, rounded to the type of the graph."""
    constant = call.constant(2, "C")
    if constant is None:
        return np.zeros(width)
    if constant.ndim == 2 and len(constant) == row.shape[0] > 1:
        raise UnsupportedModelError("C differs from row to row; one row for all is supported")
    try:
        spread = np.broadcast_to(constant, (1, width)).ravel()
    except ValueError:
        raise InputError(
            f"C has shape {constant.shape} for {counted(width, 'column')}; the model file is damaged"
        ) from None
    with np.errstate(all="ignore"):
        return np.asarray(spread * np.array(call.node.number("beta", 1.0), row.dtype), np.float64)


def apply_activation(walk: GraphWalk, tensor: Tensor, function: ir.Function, parameter: float = 1.0) -> Tensor:
    """A function of each number."""
    op = ir.Activation((walk.settle_finite(tensor),), function, tensor.size, parameter, tensor.precision)
    return walk.computed(op, tensor.shape, tensor.dtype)


def apply_softmax(walk: GraphWalk, scores: Tensor, logarithm: bool = False) -> Tensor:
    """The softmax of each row of a matrix, or its logarithm."""
    walk.refuse_special(scores)
    count, width = scores.shape
    if count > _MAX_SHARES:
        raise UnsupportedModelError(f"shares within each of {count} rows; at most {_MAX_SHARES} are supported")
    found = []
    for number in range(count):
        row = scores.moved(partial(np.take, indices=number, axis=0))
        op = ir.Softmax((walk.settle(row),), width, scores.precision, logarithm)
        found.append(walk.computed(op, (1, width), scores.dtype))
    return together(found, np.concatenate)


def with_constant(
    walk: GraphWalk, tensor: Tensor, code: ir.Operator, number: FloatArray | float, left: bool = False
) -> Tensor:
    """Arithmetic with constants in the precision of the tensor; `left`: the constant stands there."""
    pair = (tensor, ConstantOperand(np.asarray(number, tensor.dtype)))
    found = combined(walk, code, *(pair[::-1] if left else pair))
    return require_tensor(found)


#: Functions whose results are the nearest numbers everywhere, so that graphs may compute them of their constants.
_CORRECT: dict[ir.Function, Callable[[AnyArray], AnyArray]] = {ir.Function.SQRT: np.sqrt, ir.Function.ABS: np.abs}
#: Functions of which libraries find other numbers, one of them for each, that rise everywhere.
_RISING: dict[ir.Function, Callable[[AnyArray], AnyArray]] = {
    ir.Function.EXP: np.exp,
    ir.Function.LOG: np.log,
    ir.Function.SQRT: np.sqrt,
}


def _activation(function: ir.Function, name: str, *versions: int, alpha: float | None = None) -> None:
    """Register an operator that is one function of each number."""

    def handler(call: NodeCall) -> Operand:
        operand = call.required()
        if isinstance(operand, ConstantOperand) and operand.dtype in (FLOAT32, FLOAT64) and function in _CORRECT:
            with np.errstate(invalid="ignore"):
                return operand.moved(_CORRECT[function])
        if (limits := as_between(operand)) is not None and function in _RISING:
            return function_of(_RISING[function], limits)
        tensor = call.computed()
        if function is ir.Function.SOFTPLUS and tensor.dtype == FLOAT64:
            raise UnsupportedModelError("onnxruntime's double version overflows above 709; cast the input to float")
        parameter = 1.0 if alpha is None else call.node.number("alpha", alpha)
        # onnxruntime makes a Where of it for doubles, which may give 0 for -0
        call.walk.builder.open_zeros |= function is ir.Function.LEAKY_RELU and tensor.dtype == FLOAT64
        return apply_activation(call.walk, tensor, function, parameter)

    operator(name, *versions)(handler)


_activation(ir.Function.TANH, "Tanh", 6, 13)
_activation(ir.Function.LOGISTIC, "Sigmoid", 6, 13)
_activation(ir.Function.RELU, "Relu", 6, 13, 14)
_activation(ir.Function.LEAKY_RELU, "LeakyRelu", 6, 16, alpha=0.01)
_activation(ir.Function.ELU, "Elu", 6, 22, alpha=1.0)
_activation(ir.Function.SOFTPLUS, "Softplus", 1, 22)
_activation(ir.Function.EXP, "Exp", 6, 13)
_activation(ir.Function.ABS, "Abs", 6, 13)
_activation(ir.Function.SOFTSIGN, "Softsign", 1, 22)
_activation(ir.Function.SQRT, "Sqrt", 6, 13)
_activation(ir.Function.LOG, "Log", 6, 13)
_activation(ir.Function.ERF, "Erf", 9, 13)
_activation(ir.Function.SIN, "Sin", 7, 22)
_activation(ir.Function.COS, "Cos", 7, 22)
_activation(ir.Function.ATAN, "Atan", 7, 22)


@operator("Clip", 6, 11, 12, 13)
def _clip(call: NodeCall) -> Operand:
    tensor = call.computed()
    limits = np.finfo(tensor.dtype)
    bounds = [float(limits.min), float(limits.max)]
    for number, name in enumerate(("min", "max")):
        if call.node.version < 11:
            bounds[number] = float(np.clip(call.node.number(name, bounds[number]), limits.min, limits.max))
            continue
        bound = call.constant(number + 1, name)
        if bound is not None:
            if bound.size != 1 or bound.dtype != tensor.dtype:
                raise InputError(f"{name} is {bound.dtype} of shape {bound.shape}, expected one {tensor.dtype}")
            bounds[number] = float(np.clip(bound.ravel()[0], limits.min, limits.max))
    lower, upper = (np.full(tensor.size, bound) for bound in bounds)
    op = ir.Clip(inputs=(call.walk.settle_finite(tensor),), lower=lower, upper=upper)
    return call.walk.computed(op, tensor.shape, tensor.dtype)


@operator("ReduceSum", 1, 11, 13)
@operator("ReduceMax ReduceMin", 1, 11, 12, 13, 18, 20)
@operator("ReduceMean ReduceSumSquare ReduceL1 ReduceL2 ReduceProd ReduceLogSumExp ReduceLogSum", 1, 11, 13, 18, 28)
def _reduction(call: NodeCall) -> Operand:
    name, given = call.node.op_type, call.required()
    limits = as_between(given) if name == "ReduceSum" else None
    lengths = given if isinstance(given, ConstantOperand) and given.dtype in INTEGERS and name in _OF_LENGTHS else None
    tensor = given if isinstance(given, PickedOperand) else lengths or limits or call.computed()
    by_input = call.node.version >= (13 if name == "ReduceSum" else 18)
    axes = call.integers(1, "axes") if by_input else call.node.integers("axes").tolist()
    rank, none = len(tensor.shape), not axes and call.node.integer("noop_with_empty_axes")
    if none and name not in _FUNCTIONS_OF_ONE:
        return tensor
    reduced = set() if none else {axis_of(axis, rank) for axis in axes or range(rank)}
    groups = tuple(1 if axis in reduced else length for axis, length in enumerate(tensor.shape))
    kept = (
        groups if call.node.integer("keepdims", 1) else tuple(n for axis, n in enumerate(groups) if axis not in reduced)
    )
    if isinstance(tensor, PickedOperand):
        if math.prod(groups) != 1 or name not in ("ReduceSum", "ReduceMean"):
            raise UnsupportedModelError("reads what TopK picks; its sum and its mean are supported")
        return _mean_of_picked(call.walk, tensor, name == "ReduceMean").moved(lambda array: array.reshape(kept))
    group = np.broadcast_to(np.arange(math.prod(groups)).reshape(groups), tensor.shape).ravel()
    order = np.argsort(group, kind="stable")
    each = math.prod(length for axis, length in enumerate(tensor.shape) if axis in reduced)
    rows = tensor.moved(lambda array: np.ravel(array)[order].reshape(math.prod(groups), each))
    found: Operand
    if isinstance(rows, ConstantOperand):
        found = rows.moved(lambda array: _of_lengths(name, array))
    else:
        found = sum_of(rows) if isinstance(rows, BetweenOperand) else _REDUCTIONS[name](call.walk, rows)
    return found.moved(lambda array: array.reshape(kept))


def _of_lengths(name: str, array: AnyArray) -> AnyArray:
    """Rows of whole numbers, (n, m), reduced to one each. Raises where onnxruntime may round, clip or have no answer.

    It adds and multiplies integers in other types (core/providers/cpu/reduction/reduction_ops.h), which hold what stays
    below 2**53, and below 2**31 of INT32.
    """
    reduce = _OF_LENGTHS[name]
    picks = name in ("ReduceMax", "ReduceMin")
    if picks and not array.shape[1]:
        raise UnsupportedModelError(f"{name} of no number has no answer")
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(reduce(array.astype(np.float64) if picks else np.abs(array.astype(np.float64)), axis=1))
    if not (size < (2.0**31 if array.dtype == np.int32 else _WHOLE)).all():
        raise UnsupportedModelError(f"{name} of whole numbers that leaves INT32, or 2**53 in INT64")
    return np.asarray(reduce(array, axis=1, dtype=array.dtype))


def _mean_of_picked(walk: GraphWalk, picked: PickedOperand, divides: bool) -> Tensor:
    """The mean or the sum of what belongs to the nearest rows."""
    whole, inputs = picked.whole, [picked.value]
    values = np.ones((1, walk.builder.width(picked.value)))
    if isinstance(whole, ConstantOperand):
        values = whole.array.astype(np.float64).reshape(1, -1)
    else:
        inputs.append(walk.settle_finite(whole))
    dtype = whole.dtype if whole.dtype in (FLOAT32, FLOAT64) else FLOAT64
    precision = ir.Precision.FLOAT32 if dtype == FLOAT32 else ir.Precision.FLOAT64
    mean = ir.NearestMean(tuple(inputs), values, picked.count, precision=precision, divides=divides)
    return walk.computed(mean, (1,), dtype)


def total_of(walk: GraphWalk, rows: Tensor) -> Tensor:
    """The sum of each row."""
    return apply_linear(walk, rows, np.ones((1, rows.shape[1])), np.zeros(1), rows.shape[:1])


def mean_of(walk: GraphWalk, rows: Tensor) -> Tensor:
    """The mean of each row."""
    return with_constant(walk, total_of(walk, rows), ir.Operator.DIVIDE, rows.shape[1])


def product_of(walk: GraphWalk, one: Tensor, other: Tensor) -> Tensor:
    """The product of two tensors, number by number."""
    return require_tensor(combined(walk, ir.Operator.MULTIPLY, one, other))


def _product(walk: GraphWalk, rows: Tensor) -> Tensor:
    """The product of each row, in order."""
    if rows.shape[1] > 3:
        raise UnsupportedModelError(
            "the product of more than 3 numbers, whose order onnxruntime chooses by the machine"
        )
    parts = [rows.moved(partial(np.take, indices=number, axis=1)) for number in range(rows.shape[1])]
    return reduce(partial(product_of, walk), parts)


def norm_of(walk: GraphWalk, rows: Tensor, kind: int) -> Tensor:
    """The sum of the magnitudes of each row (1), or the root of that of the squares (2)."""
    if kind == 1:
        return total_of(walk, apply_activation(walk, rows, ir.Function.ABS))
    return apply_activation(walk, total_of(walk, product_of(walk, rows, rows)), ir.Function.SQRT)


def extreme_of(walk: GraphWalk, rows: Tensor, code: ir.Operator) -> Tensor:
    """The largest or the smallest of each row, by halves."""
    walk.refuse_special(rows)
    while rows.shape[1] > 1:
        half = (rows.shape[1] + 1) // 2
        ends = slice(half), slice(-half, None)
        sides = (replace(rows, value=rows.value[:, part], column=rows.column[:, part]) for part in ends)
        rows = replace(require_tensor(combined(walk, code, *sides)), special=False)
    return rows


def _log_sum_exp(walk: GraphWalk, rows: Tensor) -> Tensor:
    """What a logarithm of a softmax takes from each number: the largest one less its own, which is the largest, too.

    Of any other one the digits would be lost that it is away from the largest.
    """
    parts = (rows, apply_softmax(walk, rows, logarithm=True))
    pair = (extreme_of(walk, part, ir.Operator.MAXIMUM).moved(lambda array: array[:, 0]) for part in parts)
    return require_tensor(combined(walk, ir.Operator.SUBTRACT, *pair))


_REDUCTIONS: dict[str, Callable[[GraphWalk, Tensor], Tensor]] = {
    "ReduceSum": total_of,
    "ReduceMean": mean_of,
    "ReduceSumSquare": lambda walk, rows: total_of(walk, product_of(walk, rows, rows)),
    "ReduceL1": partial(norm_of, kind=1),
    "ReduceL2": partial(norm_of, kind=2),
    "ReduceProd": _product,
    "ReduceMax": partial(extreme_of, code=ir.Operator.MAXIMUM),
    "ReduceMin": partial(extreme_of, code=ir.Operator.MINIMUM),
    "ReduceLogSumExp": _log_sum_exp,
    "ReduceLogSum": lambda walk, rows: apply_activation(walk, total_of(walk, rows), ir.Function.LOG),
}
#: Reductions of whole numbers that are constants, such as lengths: sums and products in any order.
_OF_LENGTHS: dict[str, Callable[..., AnyArray]] = {
    "ReduceSum": np.add.reduce,
    "ReduceProd": np.multiply.reduce,
    "ReduceMax": np.maximum.reduce,
    "ReduceMin": np.minimum.reduce,
}


#: Reductions that are a function of a number where they are of this number alone.
_FUNCTIONS_OF_ONE = frozenset({"ReduceSumSquare", "ReduceL1", "ReduceL2", "ReduceLogSumExp", "ReduceLogSum"})
