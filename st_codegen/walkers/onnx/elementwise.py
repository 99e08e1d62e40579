"""Operators of the standard ONNX domain that are made of others: activations, comparisons, choices, norms.

Each is what onnxruntime computes step by step, with one rounding a step (core/providers/cpu/activation,
core/providers/cpu/math/element_wise_ops.cc, core/providers/cpu/nn/layer_norm_impl.cc). Truth values are 0 and 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce
from operator import itemgetter

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    Exceeds,
    Function,
    Operator,
    Piecewise,
    Precision,
    Scale,
    Towards,
    WholeNumber,
)
from st_codegen.walkers.onnx.between import as_between, function_of
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    INTEGERS,
    TRUTH,
    ConstantOperand,
    LabelOperand,
    Operand,
    Tensor,
    as_doubles,
    axis_of,
    check_size,
    require_finite,
    require_float,
    require_same_type,
    require_tensor,
)
from st_codegen.walkers.onnx.operators import apply_activation, combined, mean_of, norm_of, product_of, with_constant

# --- activations ---------------------------------------------------------------------------------------------------


@operator("Reciprocal", 6, 13)
def _reciprocal(call: NodeCall) -> Operand:
    return with_constant(call.walk, call.computed(), Operator.DIVIDE, 1.0, left=True)


@operator("Sign", 9, 13)
def _sign(call: NodeCall) -> Operand:
    return _sign_of(call.walk, call.computed())


def _sign_of(walk: GraphWalk, tensor: Tensor) -> Tensor:
    """1 above 0, -1 below it, 0 between."""
    value, cut = walk.settle_finite(tensor), np.zeros(tensor.size)
    passed, reached = (walk.builder.add(Exceeds((value,), cut, inclusive)) for inclusive in (False, True))
    found = walk.builder.scale(walk.builder.combine(passed, "+", reached), "-", 1.0)
    return walk.computed(found, tensor.shape, tensor.dtype)


@operator("ThresholdedRelu", 10, 22)
def _thresholded(call: NodeCall) -> Operand:
    """The number itself above alpha, else 0."""
    tensor, walk = call.computed(), call.walk
    value = walk.settle_finite(tensor)
    above = walk.builder.add(Exceeds((value,), np.full(tensor.size, call.node.number("alpha", 1.0))))
    # 0 is added since a negative number times 0 has a sign; -0 above a negative number loses its own
    walk.builder.open_zeros |= call.node.number("alpha", 1.0) < 0
    kept = walk.builder.scale(walk.builder.combine(value, "*", above), "+", 0.0)
    return walk.computed(kept, tensor.shape, tensor.dtype)


@operator("Swish", 24)
def _swish(call: NodeCall) -> Operand:
    tensor, walk = call.computed(), call.walk
    scaled = with_constant(walk, tensor, Operator.MULTIPLY, call.node.number("alpha", 1.0))
    return product_of(walk, tensor, apply_activation(walk, scaled, Function.LOGISTIC))


@operator("Gelu", 20)
def _gelu(call: NodeCall) -> Operand:
    kind, tensor, walk = call.node.text("approximate", "none"), call.computed(), call.walk
    if kind == "none":
        return apply_activation(walk, tensor, Function.GELU)
    if kind != "tanh":
        raise InputError(f"approximate {kind} is not known; the model file is damaged")
    if tensor.dtype == FLOAT64:
        raise UnsupportedModelError("onnxruntime computes the approximation of Gelu in float; cast the input to float")
    # core/providers/cpu/tensor/gelu.cc: 0.5 x (tanh(x (0.044715 c x x + c)) + 1) with c = sqrt(2 / pi)
    square = product_of(walk, with_constant(walk, tensor, Operator.MULTIPLY, 0.035677408136300125), tensor)
    inner = product_of(walk, tensor, with_constant(walk, square, Operator.ADD, 0.7978845608028654))
    above = with_constant(walk, apply_activation(walk, inner, Function.TANH), Operator.ADD, 1.0)
    return product_of(walk, with_constant(walk, tensor, Operator.MULTIPLY, 0.5), above)


@operator("Mish", 18, 22)
def _mish(call: NodeCall) -> Operand:
    tensor, walk = call.computed(), call.walk
    if tensor.dtype == FLOAT64:
        raise UnsupportedModelError(
            "onnxruntime's double version takes the logarithm of 1 + exp(x), which loses small results; cast the input "
            "to float"
        )
    soft = apply_activation(walk, tensor, Function.SOFTPLUS)
    return product_of(walk, tensor, apply_activation(walk, soft, Function.TANH))


@operator("Tan", 7, 22)
def _tangent(call: NodeCall) -> Operand:
    """The sine by the cosine; the library's own lies within what the bound allows for both and their quotient."""
    tensor, walk = call.computed(), call.walk
    sine, cosine = (apply_activation(walk, tensor, function) for function in (Function.SIN, Function.COS))
    return combined(walk, Operator.DIVIDE, sine, cosine)


#: Units in the last place by which a function of a library in float and this one may differ (`proof/bounds.py`).
_FUNCTION_UNITS = 12


def _as_function(walk: GraphWalk, tensor: Tensor, number: float) -> Tensor:
    """Numbers in double times a constant, as one function of a library in float has them."""
    constant = np.full(tensor.size, number)
    doubt = np.abs(constant) * _FUNCTION_UNITS * float(np.finfo(np.float32).epsneg)
    op = Scale((walk.settle(tensor),), Operator.MULTIPLY, constant, Precision.FLOAT32, doubt=doubt)
    return walk.computed(op, tensor.shape, FLOAT32)


def _in_double(call: NodeCall) -> Tensor:
    """The input of a function that onnxruntime has in float only: steps to it in double lose next to nothing."""
    tensor = call.computed()
    if tensor.dtype == FLOAT64:
        raise UnsupportedModelError(f"onnxruntime has {call.node.op_type} in float only; cast the input to float")
    call.walk.refuse_special(tensor)
    return call.walk.as_type(tensor, FLOAT64)


@operator("Asin Acos", 7, 22)
def _arc(call: NodeCall) -> Operand:
    """Twice the arc tangent of x / (1 + sqrt((1 - x) (1 + x))), and what a right angle has beyond it."""
    tensor, walk = _in_double(call), call.walk
    rest = with_constant(walk, tensor, Operator.SUBTRACT, 1.0, left=True)
    both = product_of(walk, rest, with_constant(walk, tensor, Operator.ADD, 1.0))
    beside = with_constant(walk, apply_activation(walk, both, Function.SQRT), Operator.ADD, 1.0)
    quotient = require_tensor(combined(walk, Operator.DIVIDE, tensor, beside))
    half = apply_activation(walk, quotient, Function.ATAN)
    if call.node.op_type == "Acos":
        half = with_constant(walk, half, Operator.SUBTRACT, math.pi / 4, left=True)
    return _as_function(walk, half, 2.0)


@operator("Sinh Cosh", 9, 22)
def _hyperbolic(call: NodeCall) -> Operand:
    """Half of the difference, or of the sum, of exp(x) and exp(-x)."""
    tensor, walk = _in_double(call), call.walk
    turned = with_constant(walk, tensor, Operator.MULTIPLY, -1.0)
    sides = (apply_activation(walk, side, Function.EXP) for side in (tensor, turned))
    code = Operator.SUBTRACT if call.node.op_type == "Sinh" else Operator.ADD
    return _as_function(walk, require_tensor(combined(walk, code, *sides)), 0.5)


@operator("Asinh Acosh Atanh", 9, 22)
def _area(call: NodeCall) -> Operand:
    """Logarithms of one plus a number that is computed without loss near 0, or, of Acosh, near 1."""
    tensor, walk, name = _in_double(call), call.walk, call.node.op_type

    def root(number: Tensor) -> Tensor:
        return apply_activation(walk, number, Function.SQRT)

    if name == "Acosh":  # x - 1 + sqrt(x - 1) * sqrt(x + 1)
        inner = with_constant(walk, tensor, Operator.SUBTRACT, 1.0)
        both = product_of(walk, root(inner), root(with_constant(walk, tensor, Operator.ADD, 1.0)))
        found = combined(walk, Operator.ADD, inner, both)
    elif name == "Atanh":  # half of that of 2 x / (1 - x)
        rest = with_constant(walk, tensor, Operator.SUBTRACT, 1.0, left=True)
        found = combined(walk, Operator.DIVIDE, with_constant(walk, tensor, Operator.MULTIPLY, 2.0), rest)
    else:  # of |x| + x x / (1 + sqrt(x x + 1)), with the sign of x
        square = product_of(walk, tensor, tensor)
        beside = with_constant(walk, root(with_constant(walk, square, Operator.ADD, 1.0)), Operator.ADD, 1.0)
        size = apply_activation(walk, tensor, Function.ABS)
        found = combined(walk, Operator.ADD, size, combined(walk, Operator.DIVIDE, square, beside))
    logarithm = apply_activation(walk, require_tensor(found), Function.LOG1P)
    if name == "Asinh":
        logarithm = product_of(walk, logarithm, _sign_of(walk, tensor))
    return _as_function(walk, logarithm, 0.5 if name == "Atanh" else 1.0)


@operator("Selu", 6, 22)
def _selu(call: NodeCall) -> Operand:
    alpha, gamma = call.node.number("alpha", 1.67326319), call.node.number("gamma", 1.05070102)
    below = apply_activation(call.walk, call.computed(), Function.ELU, alpha)
    return with_constant(call.walk, below, Operator.MULTIPLY, gamma)


@operator("Celu", 12, 28)
def _celu(call: NodeCall) -> Operand:
    alpha, walk = call.node.number("alpha", 1.0), call.walk
    if alpha <= 0:  # max(0, x) + min(0, alpha * (exp(x / alpha) - 1)) is then no branch of an Elu
        raise UnsupportedModelError(f"alpha {alpha:g}; it is supported above 0")
    tensor = call.computed()
    if tensor.dtype == FLOAT64:
        raise UnsupportedModelError("Celu of doubles, which other operators make up; cast the input to float")
    scaled = with_constant(walk, tensor, Operator.DIVIDE, alpha)
    return with_constant(walk, apply_activation(walk, scaled, Function.ELU), Operator.MULTIPLY, alpha)


@operator("Shrink", 9)
def _shrink(call: NodeCall) -> Operand:
    """x + bias below -lambd, x - bias above lambd, 0 between (core/providers/cpu/nn/shrink.cc)."""
    tensor, walk = call.computed(), call.walk
    bias, reach = call.node.number("bias"), call.node.number("lambd", 0.5)
    if tensor.dtype == FLOAT64:
        raise UnsupportedModelError("onnxruntime computes Shrink of doubles in float; cast the input to float")
    if reach < 0:
        raise UnsupportedModelError(f"lambd {reach} is negative, so that a number may lie below and above")
    walk.builder.open_zeros = True
    value, cut, parts = walk.settle_finite(tensor), np.full(tensor.size, reach), []
    for sign, code in ((-1.0, Operator.ADD), (1.0, Operator.SUBTRACT)):
        beyond = walk.builder.add(Exceeds((walk.builder.scale(value, "*", sign),), cut))
        moved = walk.settle(with_constant(walk, tensor, code, bias))
        parts.append(walk.builder.combine(moved, "*", beyond))
    return walk.computed(walk.builder.combine(parts[0], "+", parts[1]), tensor.shape, tensor.dtype)


def _hard_sigmoid(walk: GraphWalk, tensor: Tensor, alpha: float, beta: float) -> Tensor:
    walk.refuse_special(tensor)
    line = with_constant(walk, with_constant(walk, tensor, Operator.MULTIPLY, alpha), Operator.ADD, beta)
    return with_constant(walk, with_constant(walk, line, Operator.MINIMUM, 1.0), Operator.MAXIMUM, 0.0)


@operator("HardSigmoid", 6, 22)
def _hard_sigmoid_node(call: NodeCall) -> Operand:
    return _hard_sigmoid(call.walk, call.computed(), call.node.number("alpha", 0.2), call.node.number("beta", 0.5))


@operator("HardSwish", 14, 22)
def _hard_swish(call: NodeCall) -> Operand:
    tensor = call.computed()
    return product_of(call.walk, tensor, _hard_sigmoid(call.walk, tensor, float(np.float32(1 / 6)), 0.5))


@operator("PRelu", 7, 9, 16)
def _prelu(call: NodeCall) -> Operand:
    tensor, walk, slope = call.computed(), call.walk, call.required(1)
    walk.refuse_special(tensor)
    below = combined(walk, Operator.MULTIPLY, with_constant(walk, tensor, Operator.MINIMUM, 0.0), slope)
    return combined(walk, Operator.ADD, with_constant(walk, tensor, Operator.MAXIMUM, 0.0), below)


#: Exponents beyond this leave hardly a number whose power is one.
_MAX_EXPONENT = 64.0


@operator("Pow", 7, 12, 13, 15)
def _power(call: NodeCall) -> Operand:
    """Products for one exponent that is 1, 2 or 3; else, and for a list of exponents, by a logarithm.

    Of rows of one number onnxruntime takes the power of the C library, which may round otherwise, for 2 and 3 too.
    """
    if isinstance(base := call.required(), ConstantOperand):
        if isinstance(fixed := call.required(1), ConstantOperand):
            return _constant_power(base, fixed)
        return _power_of_constant(call.walk, base, call.computed(1))
    tensor, exponent = call.computed(), call.constant(1, "the exponent")
    exponents = np.zeros(1) if exponent is None else exponent.astype(np.float64)
    if exponent is not None and exponent.dtype not in (FLOAT32, FLOAT64, *INTEGERS):
        raise UnsupportedModelError(f"exponents of {exponent.dtype}, which onnxruntime does not take")
    if not np.all((exponents != 0.0) & (np.abs(exponents) <= _MAX_EXPONENT)):
        raise UnsupportedModelError(
            f"exponents are constants other than 0 and of magnitude up to {_MAX_EXPONENT:g}; "
            "write others with Exp and Log"
        )
    shape = np.broadcast_shapes(tensor.shape, exponents.shape)
    check_size(shape)
    wide = tensor.moved(lambda array: np.broadcast_to(array, shape))
    if exponents.size == 1 and exponents.ravel()[0] in ((1.0, 2.0, 3.0) if tensor.shape[-1:] > (1,) else (1.0,)):
        result = wide
        for _ in range(int(exponents.ravel()[0]) - 1):
            result = product_of(call.walk, result, wide)
        return result
    each, value, column = np.broadcast_to(exponents, shape), np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    for number in np.unique(exponents):
        own = each == number
        found = apply_activation(call.walk, wide.moved(itemgetter(own)), Function.POWER, float(number))
        value[own], column[own] = found.value, found.column
    return replace(found, value=value, column=column)


def _constant_power(base: ConstantOperand, exponent: ConstantOperand) -> Operand:
    """Powers of constants above 0, of which each library has its own."""
    limits = as_between(base)
    if limits is None or exponent.array.size != 1 or not np.all(base.array > 0):
        raise UnsupportedModelError("powers of constants other than numbers above 0 by one exponent")
    power, shape = float(exponent.array.ravel()[0]), np.broadcast_shapes(base.shape, exponent.shape)
    return function_of(lambda array: array**power, limits).moved(lambda array: np.broadcast_to(array, shape))


def _power_of_constant(walk: GraphWalk, base: ConstantOperand, exponent: Tensor) -> Tensor:
    """An exponential of the exponent times the logarithm of the base, which is rounded once."""
    if base.dtype != exponent.dtype or not np.all((base.array > 0) & np.isfinite(base.array)):
        raise UnsupportedModelError("a power of a constant that is not above 0, or of another type than the exponent")
    shape = np.broadcast_shapes(base.shape, exponent.shape)
    check_size(shape)
    walk.refuse_special(exponent)
    value = walk.settle(exponent.moved(lambda array: np.broadcast_to(array, shape)))
    logarithm = np.log(np.broadcast_to(base.array.astype(np.float64), shape).ravel())
    moved = walk.builder.scale(value, "*", logarithm, doubt=np.abs(logarithm) * 2.0**-50)
    return apply_activation(walk, walk.computed(moved, shape, exponent.dtype), Function.EXP)


_OF_CONSTANTS: dict[str, np.ufunc] = {"Round": np.rint, "Floor": np.floor, "Ceil": np.ceil}
_TOWARDS = {"Round": Towards.NEAREST, "Floor": Towards.BELOW, "Ceil": Towards.ABOVE}


@operator("Floor Ceil", 6, 13)
@operator("Round", 11, 22)
def _whole(call: NodeCall) -> Operand:
    """The nearest whole number, of a tie the even one, or the next one below or above. -0 becomes 0."""
    operand, walk = call.required(), call.walk
    if isinstance(operand, ConstantOperand) and operand.dtype in (FLOAT32, FLOAT64):
        return operand.moved(_OF_CONSTANTS[call.node.op_type])
    tensor = call.computed()
    walk.builder.open_zeros = True
    found = WholeNumber((walk.settle_finite(tensor),), tensor.size, _TOWARDS[call.node.op_type])
    return walk.computed(found, tensor.shape, tensor.dtype)


# --- choices -------------------------------------------------------------------------------------------------------


@operator("Max Min", 6, 8, 12, 13)
def _extreme(call: NodeCall) -> Operand:
    code = Operator.MAXIMUM if call.node.op_type == "Max" else Operator.MINIMUM
    found = call.required()
    for number in range(1, len(call.operands)):
        for operand in (found, call.required(number)):
            if isinstance(operand, Tensor):
                call.walk.refuse_special(operand)
        found = combined(call.walk, code, found, call.required(number))
    return found


def _truths(walk: GraphWalk, value: int, shape: tuple[int, ...]) -> Tensor:
    return walk.computed(value, shape, TRUTH)


def _opposite(walk: GraphWalk, truths: int) -> int:
    return walk.builder.scale(truths, "-", 1.0, reverse=True)


def as_number(walk: GraphWalk, operand: Operand) -> Operand:
    """A label that is its own number as that number, computed integers as such, and integers to compare them with."""
    if isinstance(operand, LabelOperand) and operand.labels == tuple(range(len(operand.labels))):
        zeros = np.zeros(operand.shape, np.int64)
        return Tensor(zeros + operand.value, zeros, FLOAT64, special=False)
    operand = walk.numbered(operand)
    if isinstance(operand, ConstantOperand) and operand.dtype in INTEGERS:
        return operand.moved(as_doubles)
    if isinstance(operand, Tensor) and operand.dtype in INTEGERS and not operand.given:
        return walk.as_type(operand, FLOAT64)
    return operand


#: What is done with constants, whether equal numbers count as above, and whether the answer is turned round.
_COMPARISONS: dict[str, tuple[np.ufunc, bool, bool]] = {
    "Greater": (np.greater, False, False),
    "GreaterOrEqual": (np.greater_equal, True, False),
    "Less": (np.less, True, True),
    "LessOrEqual": (np.less_equal, False, True),
    "Equal": (np.equal, True, False),
}


def _spread(walk: GraphWalk, operand: Operand, shape: tuple[int, ...]) -> int:
    """Computed numbers in a shape, as a value."""
    tensor = require_float(require_tensor(operand))
    walk.refuse_special(tensor)
    return walk.settle(tensor.moved(lambda array: np.broadcast_to(array, shape)))


@operator("Greater Less", 7, 9, 13)
@operator("GreaterOrEqual LessOrEqual", 12, 16)
@operator("Equal", 7, 11, 13, 19)
def _comparison(call: NodeCall) -> Operand:
    walk = call.walk
    left, right = (as_number(walk, call.required(number)) for number in (0, 1))
    if isinstance(left, ConstantOperand) and isinstance(right, ConstantOperand):
        return ConstantOperand(np.asarray(_COMPARISONS[call.node.op_type][0](left.array, right.array)))
    shape = np.broadcast_shapes(left.shape, right.shape)
    check_size(shape)
    if isinstance(left, ConstantOperand):  # c < x is -x < -c
        turned = ConstantOperand(-left.array)
        left, right = with_constant(walk, require_tensor(right), Operator.MULTIPLY, -1.0), turned
    cut, value = np.zeros(math.prod(shape)), _spread(walk, left, shape)
    if isinstance(right, ConstantOperand):
        cut = np.broadcast_to(right.array, shape).astype(np.float64).ravel()
    else:  # the difference of two numbers is 0 where they are equal only
        value = walk.builder.combine(value, "-", _spread(walk, right, shape))
    return _truths(walk, _compared(walk, call.node.op_type, value, cut), shape)


def _compared(walk: GraphWalk, name: str, value: int, cut: np.ndarray) -> int:
    if name == "Equal":
        reached, passed = (walk.builder.add(Exceeds((value,), cut, inclusive)) for inclusive in (True, False))
        return walk.builder.combine(reached, "-", passed)
    _, inclusive, turned = _COMPARISONS[name]
    found = walk.builder.add(Exceeds((value,), cut, inclusive))
    return _opposite(walk, found) if turned else found


def equals(walk: GraphWalk, value: int, numbers: np.ndarray) -> int:
    """1 in each column that is equal to its number, else 0."""
    return _compared(walk, "Equal", value, numbers)


def is_not_zero(walk: GraphWalk, tensor: Tensor) -> Tensor:
    """The truth value of each number."""
    equal = _compared(walk, "Equal", walk.settle_finite(tensor), np.zeros(tensor.size))
    return _truths(walk, _opposite(walk, equal), tensor.shape)


def refuse_made_nan(walk: GraphWalk, tensor: Tensor) -> None:
    """Raise UnsupportedModelError where an operator before makes NaN of numbers: such rows have no answer here."""
    todo, seen = set(np.ravel(tensor.value).tolist()), set[int]()
    while todo:
        value = todo.pop()
        if not value or value in seen:
            continue
        seen.add(value)
        op = walk.builder.ops[value - 1]
        if getattr(op, "refuses", False):
            raise UnsupportedModelError(
                "looks for NaN that an operator before it makes (a logarithm, a root, a power or a quotient), as in a "
                "PowerTransformer; rows have no answer where one arises: compile the model from a .skops file"
            )
        todo.update(op.inputs)


@operator("IsNaN", 9, 13, 20)
def _is_nan(call: NodeCall) -> Operand:
    """Whether an input is missing; infinite ones are refused."""
    tensor, walk = call.computed(), call.walk
    refuse_made_nan(walk, tensor)
    walk.builder.refuse_magnitude(FLOAT32_OVERFLOW if walk.narrows else math.inf)
    value = walk.gathered(np.ravel(tensor.value), np.ravel(tensor.column))
    start, none, missing = np.zeros(tensor.size + 1, np.int64), np.zeros(0), np.ones(tensor.size)
    return _truths(
        walk,
        walk.builder.add(Piecewise((value,), start, none, none, np.zeros((tensor.size, 1)), missing)),
        tensor.shape,
    )


@operator("IsInf", 10, 20)
def _is_infinite(call: NodeCall) -> Operand:
    """False wherever the block has an answer: rows with infinite inputs, or whose numbers overflow, are refused."""
    tensor, walk = call.computed(), call.walk
    value, most = walk.settle_finite(tensor), np.full(tensor.size, np.finfo(tensor.dtype).max)
    sides = [sign for sign, name in ((1.0, "positive"), (-1.0, "negative")) if call.node.integer(f"detect_{name}", 1)]
    found = [walk.builder.add(Exceeds((walk.builder.scale(value, "*", sign),), most)) for sign in sides]
    if not found:
        return ConstantOperand(np.zeros(tensor.shape, TRUTH))
    return _truths(walk, reduce(lambda one, other: walk.builder.combine(one, "+", other), found), tensor.shape)


def _logical(operand: Operand) -> Tensor:
    tensor = require_tensor(operand)
    if tensor.dtype != TRUTH:
        raise UnsupportedModelError("reads numbers where truth values are expected")
    return tensor


def _folded(call: NodeCall, function: np.ufunc) -> ConstantOperand | None:
    """A function of truth values that stand in the file, None where any is computed."""
    given = [operand.array for operand in call.operands if isinstance(operand, ConstantOperand)]
    if len(given) < len(call.operands) or any(array.dtype != TRUTH for array in given):
        return None
    return ConstantOperand(np.asarray(function(*given)))


@operator("Not", 1)
def _not(call: NodeCall) -> Operand:
    if (known := _folded(call, np.logical_not)) is not None:
        return known
    tensor = _logical(call.required())
    return _truths(call.walk, _opposite(call.walk, call.walk.settle(tensor)), tensor.shape)


#: What is done with constants, and with truth values that are numbers; one of two is the size of their difference.
_JOINED: dict[str, tuple[np.ufunc, Operator]] = {
    "And": (np.logical_and, Operator.MINIMUM),
    "Or": (np.logical_or, Operator.MAXIMUM),
    "Xor": (np.logical_xor, Operator.SUBTRACT),
}


@operator("And Or Xor", 7)
def _joined_truths(call: NodeCall) -> Operand:
    function, code = _JOINED[call.node.op_type]
    if (known := _folded(call, function)) is not None:
        return known
    walk, pair = call.walk, [_flags(call.walk, call.required(number)) for number in (0, 1)]
    found = require_tensor(combined(walk, code, *pair))
    value = walk.settle(found)
    return _truths(walk, walk.builder.function(value, "abs") if function is np.logical_xor else value, found.shape)


def _flags(walk: GraphWalk, operand: Operand) -> Operand:
    """Truth values, also constant ones (a mask), as the numbers 0 and 1."""
    if isinstance(operand, ConstantOperand) and operand.dtype == TRUTH:
        return ConstantOperand(operand.array.astype(FLOAT64))
    tensor = _logical(operand)
    return walk.computed(walk.settle(tensor), tensor.shape, FLOAT64)


def choice_of(call: NodeCall) -> Operand:
    """condition * a + (1 - condition) * b: one of the products is zero, and -0 is no longer itself beside it.

    For a condition that is computed.
    """
    condition, walk = _logical(call.required()), call.walk
    given = [call.required(number) for number in (1, 2)]
    sides = [as_number(walk, side) for side in given]
    shape = np.broadcast_shapes(condition.shape, *(side.shape for side in sides))
    check_size(shape)
    dtype = require_same_type(*given)
    truths = walk.settle(condition.moved(lambda array: np.broadcast_to(array, shape)))
    parts = []
    for side, factor in zip(sides, (truths, _opposite(walk, truths)), strict=True):
        if isinstance(side, ConstantOperand):
            numbers = require_finite(np.broadcast_to(side.array, shape).astype(np.float64).ravel())
            parts.append(walk.builder.scale(factor, "*", numbers))
        else:
            parts.append(walk.builder.combine(_spread(walk, side, shape), "*", factor))
    chosen = walk.builder.combine(parts[0], "+", parts[1])
    walk.builder.open_zeros = True
    return walk.computed(chosen, shape, dtype)


@operator("OneHot", 9, 11, 28)
def _one_hot(call: NodeCall) -> Operand:
    """One constant at the place that an integer names, from the end below 0, another at all others and beyond them.

    Each is its product with a truth value, of which one is zero (core/providers/cpu/tensor/onehot.cc).
    """
    walk, places = call.walk, require_tensor(call.required())
    depth, pair = call.constant(1, "the depth"), call.constant(2, "the pair of values")
    if depth is None or pair is None or depth.size != 1 or pair.shape != (2,):
        raise InputError("the depth is not one number, or the values are not two; the model file is damaged")
    if not np.all(np.isfinite(np.hstack([depth.ravel(), pair]))):
        raise UnsupportedModelError("a depth or values that are infinite or NaN")
    if places.dtype not in INTEGERS or pair.dtype not in (np.float32, np.float64):
        raise UnsupportedModelError("places that are no integers, or values that are no floats; cast them")
    count, rank = int(depth.ravel()[0]), len(places.shape) + 1
    if count < 1:
        raise InputError(f"a depth of {count}; the model file is damaged")
    check_size([places.size, count])
    value = walk.settle(walk.cut(places) if places.uncut else places)
    spread = walk.builder.select(np.repeat(np.arange(places.size), count).astype(np.int32), value)
    at = np.tile(np.arange(float(count)), places.size)
    named = walk.builder.combine(equals(walk, spread, at), "+", equals(walk, spread, at - count))
    off, on = pair.astype(np.float64)
    parts = [walk.builder.scale(named, "*", on), walk.builder.scale(_opposite(walk, named), "*", off)]
    walk.builder.open_zeros = True
    found = walk.computed(walk.builder.combine(parts[0], "+", parts[1]), (*places.shape, count), pair.dtype)
    axis = axis_of(call.node.integer("axis", -1), rank)
    return found.moved(lambda array: np.moveaxis(array, -1, axis))


# --- norms ---------------------------------------------------------------------------------------------------------


@operator("LpNormalization", 1, 22)
def _lp_normalization(call: NodeCall) -> Operand:
    """Columns by their norm along an axis; where that is 0 all of them are (core/providers/cpu/nn/lp_norm.h)."""
    tensor, walk = call.computed(), call.walk
    axis, kind = axis_of(call.node.integer("axis", -1), len(tensor.shape)), call.node.integer("p", 2)
    if kind not in (1, 2):
        raise InputError(f"p is {kind}, expected 1 or 2; the model file is damaged")
    rows = tensor.moved(lambda array: np.moveaxis(array, axis, -1))
    lengths = rows.shape
    rows = rows.moved(lambda array: array.reshape(-1, lengths[-1]))
    norm = norm_of(walk, rows, kind)
    absent = _compared(walk, "Equal", walk.settle(norm), np.zeros(norm.size))
    zeros = walk.computed(absent, norm.shape, norm.dtype)
    divisor = require_tensor(combined(walk, Operator.ADD, norm, zeros)).moved(lambda array: array[:, None])
    present = walk.computed(_opposite(walk, absent), norm.shape, norm.dtype)
    kept = combined(walk, Operator.MULTIPLY, rows, present.moved(lambda array: array[:, None]))
    found = require_tensor(combined(walk, Operator.DIVIDE, kept, divisor))
    return found.moved(lambda array: np.moveaxis(array.reshape(lengths), -1, axis))


@operator("LayerNormalization", 17)
def _layer_normalization(call: NodeCall) -> Operand:
    """(x - mean) / sqrt(variance + epsilon) * scale + bias."""
    if call.node.has_more_outputs:
        raise UnsupportedModelError("several outputs: mean and deviation are for training; leave them out")
    scaled = _normalized(call, is_centred=True)
    return combined(call.walk, Operator.ADD, scaled, call.required(2)) if call.optional(2) is not None else scaled


@operator("RMSNormalization", 23)
def _square_normalization(call: NodeCall) -> Operand:
    """x / sqrt(mean of squares + epsilon) * scale."""
    return _normalized(call, is_centred=False)


def _normalized(call: NodeCall, *, is_centred: bool) -> Operand:
    """Numbers, or what they differ by from their mean, by the root of the mean of their squares, times a scale."""
    tensor, walk = call.computed(), call.walk
    axis = axis_of(call.node.integer("axis", -1), len(tensor.shape))
    count = math.prod(tensor.shape[:axis])
    rows = tensor.moved(lambda array: array.reshape(count, -1))
    if is_centred:
        mean = mean_of(walk, rows).moved(lambda array: array.reshape(count, 1))
        rows = require_tensor(combined(walk, Operator.SUBTRACT, rows, mean))
    variance = mean_of(walk, product_of(walk, rows, rows))
    shifted = with_constant(walk, variance, Operator.ADD, call.node.number("epsilon", 1e-5))
    spread = apply_activation(walk, shifted, Function.SQRT).moved(lambda array: array.reshape(count, 1))
    result = require_tensor(combined(walk, Operator.DIVIDE, rows, spread))
    return combined(walk, Operator.MULTIPLY, result.moved(lambda array: array.reshape(tensor.shape)), call.required(1))
