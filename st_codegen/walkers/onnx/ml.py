"""The operators of the domain ai.onnx.ml: preprocessing, linear and support vector regression, tree ensembles.

Rules of onnxruntime (core/providers/cpu/ml): parameters are float32; Scaler and Normalizer are exact; LinearRegressor
and SVMRegressor add products in any order.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir.arrays import AnyArray, FloatArray
from st_codegen.walkers.onnx.elementwise import as_number, refuse_made_nan
from st_codegen.walkers.onnx.file import GraphNode
from st_codegen.walkers.onnx.forest import MAX_ID, Forest, NumberType, read_post_transform
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, operator
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    MAX_WHOLE,
    ConstantOperand,
    LabelOperand,
    Operand,
    PickedOperand,
    Tensor,
    one_row,
    require_tensor,
)
from st_codegen.walkers.onnx.operators import apply_activation, apply_linear, apply_softmax, combined
from st_codegen.walkers.onnx.ranges import keep_below
from st_codegen.walkers.onnx.shapes import joined, labelled, looked_up, of_nearest, picked
from st_codegen.walkers.onnx.tree_ensemble import read_ensemble
from st_codegen.walkers.onnx.tree_layout import build_ensemble
from st_codegen.walkers.onnx.tree_lists import read_regressor

_DOMAIN = "ai.onnx.ml"
_KERNELS = {
    "LINEAR": ir.Kernel.LINEAR,
    "POLY": ir.Kernel.POLYNOMIAL,
    "RBF": ir.Kernel.RBF,
    "SIGMOID": ir.Kernel.SIGMOID,
}


@operator("Scaler", 1, domain=_DOMAIN)
def _scaler(call: NodeCall) -> Operand:
    tensor = one_row(call.floating())
    result: Operand = tensor
    offset = call.node.floats("offset", 1, tensor.size)
    for numbers, code in (
        (offset, ir.Operator.SUBTRACT),
        (call.node.floats("scale", len(offset)), ir.Operator.MULTIPLY),
    ):
        result = combined(call.walk, code, result, ConstantOperand(numbers.astype(tensor.dtype)))
    return call.walk.as_type(require_tensor(result), FLOAT32)


#: Integers of this magnitude and above have other squares as integers, which onnxruntime takes, than in float.
_SQUARED = {np.dtype(np.int64): 2.0**24, np.dtype(np.int32): 46341.0}


@operator("Normalizer", 1, domain=_DOMAIN)
def _normalizer(call: NodeCall) -> Operand:
    given, tensor = require_tensor(call.walk.numbered(call.required())), one_row(call.floating())
    name = call.node.text("norm", "MAX")
    if name not in ("MAX", "L1", "L2"):
        raise UnsupportedModelError(f"norm {name}: known are MAX, L1, L2")
    norm = ir.Norm(name.lower())
    if norm is ir.Norm.L2 and tensor.dtype == FLOAT64:
        raise UnsupportedModelError("norm L2 of double numbers; cast the input to float")
    if norm is ir.Norm.L2 and given.dtype in _SQUARED:
        tensor = keep_below(call.walk, tensor, _SQUARED[given.dtype])
    tensor = call.walk.as_type(tensor, FLOAT32)
    op = ir.Normalize(inputs=(call.walk.settle_finite(tensor),), norm=norm, width=tensor.size)
    return call.walk.computed(op, tensor.shape, FLOAT32)


def _float32_row(call: NodeCall) -> Tensor:
    tensor = one_row(call.computed())
    if tensor.dtype != FLOAT32:
        raise UnsupportedModelError("reads double numbers; onnxruntime has it for float only: cast the input to float")
    return tensor


@operator("LinearRegressor", 1, domain=_DOMAIN)
def _linear_regressor(call: NodeCall) -> Operand:
    tensor, targets = _float32_row(call), call.node.integer("targets", 1)
    if targets < 1:
        raise InputError(f"{counted(targets, 'target')}, expected 1 or more; the model file is damaged")
    transform = read_post_transform(call.node.text("post_transform", "NONE"), targets)
    weights = call.node.floats("coefficients", targets * tensor.size).reshape(targets, tensor.size)
    bias = call.node.floats("intercepts", 0, targets)
    sums = apply_linear(call.walk, tensor, weights, bias if len(bias) else np.zeros(targets), (1, targets))
    return transformed(call.walk, sums, transform)


def transformed(walk: GraphWalk, scores: Tensor, transform: str) -> Tensor:
    """What becomes of two and more scores, in float32 whatever they were computed in."""
    scores = walk.as_type(scores, FLOAT32)
    if transform == "NONE":
        return scores
    if transform == "LOGISTIC":
        return apply_activation(walk, scores, ir.Function.LOGISTIC)
    return apply_softmax(walk, scores)


@operator("SVMRegressor", 1, domain=_DOMAIN)
def _svm_regressor(call: NodeCall) -> Operand:
    tensor = _float32_row(call)
    read_post_transform(call.node.text("post_transform", "NONE"), 1)
    if call.node.integer("one_class"):
        raise UnsupportedModelError("one_class: a detector of outliers, not a regression")
    n_vectors, rho = call.node.integer("n_supports"), call.node.floats("rho", 1)
    coefficients = call.node.floats("coefficients", n_vectors or tensor.size)[None, :]
    if n_vectors == 0:
        return apply_linear(call.walk, tensor, coefficients, rho, (1, 1))
    vectors = call.node.floats("support_vectors", n_vectors * tensor.size).reshape(n_vectors, tensor.size)
    op = kernel_sum(call.node, call.walk.settle_finite(tensor), vectors, coefficients, rho)
    return call.walk.computed(op, (1, 1), FLOAT32)


def kernel_sum(
    node: GraphNode, value: int, vectors: FloatArray, coefficients: FloatArray, rho: FloatArray
) -> ir.KernelSum:
    """The sums of kernels with coefficients (sums, vectors), by the kernel that the attributes of a node name."""
    name, parameters = node.text("kernel_type", "LINEAR"), node.floats("kernel_params", 0, 3)
    if name not in _KERNELS:
        raise UnsupportedModelError(f"kernel_type {name}: known are {', '.join(_KERNELS)}")
    gamma, coef0, degree = parameters if len(parameters) else (0.0, 0.0, 0.0)
    kernel = _KERNELS[name]
    if kernel is ir.Kernel.POLYNOMIAL and not (0 <= degree <= 64 and degree == int(degree)):
        raise UnsupportedModelError(f"degree {degree} of the polynomial kernel: it has to be a whole number up to 64")
    return ir.KernelSum(
        inputs=(value,),
        kernel=kernel,
        support_vectors=vectors,
        coefficients=coefficients,
        intercept=rho,
        gamma=float(gamma),
        coef0=float(coef0),
        degree=int(degree) if kernel is ir.Kernel.POLYNOMIAL else 3,
        precision=ir.Precision.FLOAT32,
    )


@operator("ArrayFeatureExtractor", 1, domain=_DOMAIN)
def _array_feature_extractor(call: NodeCall) -> Operand:
    operand, position = call.required(), call.required(1)
    if isinstance(position, LabelOperand):
        return replace(labelled(operand, position), shape=(1, 1))
    if isinstance(position, PickedOperand):
        return replace(of_nearest(operand, position), shape=(1, position.count))
    if isinstance(position, Tensor) and len(operand.shape) == 2:
        return looked_up(call.walk, operand, position.moved(np.ravel), 1)
    positions = np.ravel(call.positions())
    if len(operand.shape) < 2:
        operand = operand.moved(lambda array: array.reshape(1, -1))
    if np.any(positions < 0):
        raise InputError("negative positions; the model file is damaged")
    return picked(operand, positions, len(operand.shape) - 1)


@operator("FeatureVectorizer", 1, domain=_DOMAIN)
def _feature_vectorizer(call: NodeCall) -> Operand:
    parts = [one_row(call.computed(number)) for number in range(len(call.operands))]
    widths = call.node.integers("inputdimensions").tolist()
    if widths != [part.size for part in parts]:
        raise UnsupportedModelError(
            f"inputdimensions {widths} for inputs of {[part.size for part in parts]} columns: onnxruntime leaves some "
            "out or adds zeros; export the model again"
        )
    return joined(call.walk, [call.walk.as_type(part, FLOAT32) for part in parts], axis=1)


def trees(call: NodeCall, tensor: Tensor, read: Callable[[GraphNode, NumberType], Forest]) -> Tensor:
    """The sum (or extreme) of an ensemble that reads a tensor, in the type of that."""
    tensor = one_row(tensor)
    forest = read(call.node, np.float32 if tensor.dtype == FLOAT32 else np.float64)
    value, column = np.ravel(tensor.value), np.ravel(tensor.column)
    if np.any(value != value[0]):
        value, column = np.array([call.walk.gathered(value, column)]), np.arange(tensor.size)
    precision = ir.Precision.FLOAT32 if tensor.unrounded else ir.Precision.FLOAT64
    ensemble = build_ensemble(forest, (int(value[0]),), column, precision)
    return call.walk.computed(ensemble, (1, forest.n_targets), tensor.dtype)


@operator("TreeEnsembleRegressor", 1, 3, domain=_DOMAIN)
def _tree_ensemble_regressor(call: NodeCall) -> Operand:
    sums = trees(call, call.computed(), read_regressor)
    return transformed(call.walk, sums, read_post_transform(call.node.text("post_transform", "NONE"), sums.size))


@operator("TreeEnsemble", 5, domain=_DOMAIN)
def _tree_ensemble(call: NodeCall) -> Operand:
    if transform := call.node.integer("post_transform", 0):
        raise UnsupportedModelError(
            f"post_transform {transform}: only 0 is compiled (1 is LOGISTIC and 2 SOFTMAX to onnxruntime, the other "
            "way round to the ONNX standard); export the model without it, and put what is meant behind"
        )
    return trees(call, call.computed(), read_ensemble)


# --- preparation ---------------------------------------------------------------------------------------------------


@operator("Binarizer", 1, domain=_DOMAIN)
def _binarizer(call: NodeCall) -> Operand:
    tensor, walk = call.computed(), call.walk
    cut = np.full(tensor.size, call.node.number("threshold"))
    return walk.computed(ir.Exceeds((walk.settle_finite(tensor),), cut), tensor.shape, tensor.dtype)


@operator("Imputer", 1, domain=_DOMAIN)
def _imputer(call: NodeCall) -> Operand:
    """NaN, or the numbers equal to another one, replaced column by column (core/providers/cpu/ml/imputer.cc)."""
    tensor, walk = one_row(call.computed()), call.walk
    fills, replaced = call.node.floats("imputed_value_floats"), call.node.number("replaced_value_float")
    if len(fills) not in (1, tensor.size) or not np.all(np.isfinite(fills)):
        raise InputError(
            f"{counted(len(fills), 'imputed value')}, or such that are not finite, for {counted(tensor.size, 'column')}"
        )
    fills = np.broadcast_to(fills, tensor.size)
    if math.isinf(replaced):  # no number that has an answer is infinite
        walk.refuse_special(tensor)
        return tensor
    if math.isnan(replaced):
        refuse_made_nan(walk, tensor)
        walk.builder.refuse_magnitude(ir.FLOAT32_OVERFLOW if walk.narrows else math.inf)
        value, sentinel = walk.gathered(np.ravel(tensor.value), np.ravel(tensor.column)), None
    else:
        value, sentinel, tensor = walk.settle_finite(tensor), replaced, replace(tensor, unrounded=False)
    filled = walk.computed(ir.FillMissing((value,), fills, sentinel), tensor.shape, tensor.dtype)
    return replace(filled, unrounded=tensor.unrounded)


@operator("OneHotEncoder", 1, domain=_DOMAIN)
def _one_hot_encoder(call: NodeCall) -> Operand:
    """1 in the column of the category that the number is, cut to an integer (cpu/ml/onehotencoder.cc)."""
    walk, operand = call.walk, call.required()
    tensor = require_tensor(as_number(walk, operand) if isinstance(operand, LabelOperand) else operand)
    tensor = replace(tensor, uncut=False)  # the categories cut what is not cut yet
    categories = call.node.integers("cats_int64s").astype(np.float64)
    if not len(categories) or len(np.unique(categories)) < len(categories) or np.any(np.abs(categories) > MAX_ID):
        raise UnsupportedModelError("categories are different integers of 32 bits")
    # cut to an integer v is [v, v + 1) above zero, (v - 1, v] below, (-1, 1) at zero
    low = np.where(categories > 0, categories, np.nextafter(categories - 1.0, np.inf))
    high = np.where(categories < 0, np.nextafter(categories, np.inf), categories + 1.0)
    shape = (*tensor.shape, len(categories))
    columns = np.repeat(np.arange(tensor.size), len(categories)).astype(np.int32)
    value = walk.settle_finite(tensor)
    if not call.node.integer("zeros", 1):  # onnxruntime fails on an unknown category
        for column in range(tensor.size):
            feature, numbers = _taken(walk, value, column, categories)
            if feature is not None:
                walk.takes[feature] = np.intersect1d(walk.takes.get(feature, numbers), numbers)
        value = walk.builder.add(_known(value, tensor.size, categories, low, high))
    number = walk.builder.select(columns, value)
    reached, passed = (
        walk.builder.add(ir.Exceeds((number,), np.tile(ends, tensor.size), inclusive=True)) for ends in (low, high)
    )
    value = walk.builder.combine(reached, "-", passed)
    return walk.computed(value, shape, FLOAT32)


def _taken(walk: GraphWalk, value: int, column: int, numbers: FloatArray) -> tuple[int | None, FloatArray]:
    """The feature that a column is made of, and numbers of it that give some of these; None: by other operations."""
    while value:
        op = walk.builder.ops[value - 1]
        if isinstance(op, ir.Select):
            value, column = op.source(column, walk.builder.width)
            continue
        if isinstance(op, ir.Round):
            numbers = numbers[numbers.astype(np.float32) == numbers]
        elif isinstance(op, ir.Piecewise):
            own = slice(op.start[column], op.start[column + 1])
            numbers = op.knots[own][np.isin(np.trunc(op.at[own]), numbers)]
        elif not isinstance(op, ir.WholeNumber):
            return None, numbers
        value = op.inputs[0]
    return column, numbers


def _known(value: int, width: int, categories: FloatArray, low: FloatArray, high: FloatArray) -> ir.Piecewise:
    """The category of each number, from `low` on and below `high`; no answer between and beyond them."""
    knots = np.unique([low, high])
    order = np.argsort(low)
    place = order[np.searchsorted(low[order], knots, side="right") - 1]
    at = np.where(knots < high[place], categories[place], math.inf)
    return ir.Piecewise(
        inputs=(value,),
        start=np.arange(width + 1) * len(knots),
        knots=np.tile(knots, width),
        at=np.tile(at, width),
        pieces=np.tile(np.append(math.inf, at), width)[:, None],
    )


@operator("LabelEncoder", 2, 4, domain=_DOMAIN)
def _label_encoder(call: NodeCall) -> Operand:
    """The label that a list has for a chosen one, or the number that it has for a number."""
    choice, node = call.required(), call.node
    if not isinstance(choice, LabelOperand | ConstantOperand):
        return _encoded_numbers(call)
    keys: list[ir.Label] = [*node.texts("keys_strings"), *node.integers("keys_int64s").tolist()]
    values: list[ir.Label] = [*node.texts("values_strings"), *node.integers("values_int64s").tolist()]
    values = values or [float(value) for value in node.floats("values_floats")]
    labels = choice.labels if isinstance(choice, LabelOperand) else choice.array.ravel().tolist()
    if not keys or len(keys) != len(values) or not set(labels) <= set(keys):
        raise UnsupportedModelError(
            f"{counted(len(keys), 'key')} and {counted(len(values), 'value')}, or not for all labels"
        )
    known = dict(zip(keys, values, strict=True))
    found = [known[label] for label in labels]
    if isinstance(choice, LabelOperand):
        return replace(choice, labels=tuple(found))
    dtype = np.dtype({str: object, int: np.int64}.get(type(found[0]), np.float32))
    return ConstantOperand(np.array(found, dtype).reshape(choice.shape))


def _encoded_numbers(call: NodeCall) -> Tensor:
    """What a list has for each number, of equal keys the first, and a default for all others."""
    tensor, walk = require_tensor(call.required()), call.walk
    if call.node.texts("values_strings"):
        raise UnsupportedModelError(
            "gives texts for numbers, as skl2onnx writes decision_path, and a block has no texts: export the model "
            "without that output"
        )
    keys, values, default = (_listed(call.node, word) for word in ("keys", "values", "default"))
    if not len(keys) or len(keys) != len(values) or len(default) != 1 or keys.dtype != tensor.dtype or tensor.given:
        raise UnsupportedModelError(
            f"{counted(len(keys), 'key')} of {keys.dtype} and {counted(len(values), 'value')} for numbers of "
            f"{tensor.dtype}; lists of numbers of one length are supported, and keys of the type of what is read"
        )
    if not np.all(np.isfinite(keys)):
        raise UnsupportedModelError("NaN or infinity among the keys; impute them before")
    if any(numbers.dtype.kind == "i" and np.any(np.abs(numbers) > MAX_WHOLE) for numbers in (keys, values, default)):
        raise UnsupportedModelError("integers of more than 53 bits")
    walk.refuse_special(tensor)
    knots, first = np.unique(keys.astype(np.float64), return_index=True)
    count, width = len(knots), tensor.size
    op = ir.Piecewise(
        inputs=(walk.settle(tensor),),
        start=np.arange(width + 1) * count,
        knots=np.tile(knots, width),
        at=np.tile(values[first].astype(np.float64), width),
        pieces=np.full((width * (count + 1), 1), float(default[0])),
    )
    return walk.computed(op, tensor.shape, values.dtype)


#: The attributes that hold keys, values or a default, and the default where none does.
_LISTED = {"floats": (np.float32, -0.0), "int64s": (np.int64, -1)}


def _listed(node: GraphNode, word: str) -> AnyArray:
    """The keys or the values of an encoder, or the default that is of the type of its values."""
    found = node.tensor(f"{word}_tensor")
    if found is not None:
        return np.ravel(found)
    if word == "default":
        values = _listed(node, "values")
        kind = next((kind for kind, (dtype, _) in _LISTED.items() if values.dtype == dtype), "floats")
        dtype, usual = _LISTED[kind]
        given = node.number("default_float", usual) if kind == "floats" else node.integer("default_int64", int(usual))
        return np.array([given]).astype(dtype if values.dtype in (np.float32, np.int64) else values.dtype)
    whole = node.integers(f"{word}_int64s")
    return whole if len(whole) else node.floats(f"{word}_floats").astype(np.float32)
