"""Classifiers of ONNX: trees, linear models and support vector machines of ai.onnx.ml, ArgMax and Softmax.

Rules of onnxruntime (core/providers/cpu/ml: tree_ensemble_aggregator.h, linearclassifier.cc, svmclassifier.cc,
ml_common.h). Parameters are float32; a label is decided by the scores before they are transformed. With two labels
there are rules of their own, which depend on the signs of all weights.
"""

from __future__ import annotations

import math

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.walkers.classes import above, largest, pair_coefficients, pair_votes, whole_sums
from st_codegen.walkers.onnx.elementwise import equals
from st_codegen.walkers.onnx.file import GraphNode, plain
from st_codegen.walkers.onnx.forest import Forest, NumberType
from st_codegen.walkers.onnx.graph import GraphWalk, NodeCall, Result, operator
from st_codegen.walkers.onnx.ml import kernel_sum, transformed, trees
from st_codegen.walkers.onnx.operands import FLOAT32, LabelOperand, Operand, Tensor, axis_of, one_row
from st_codegen.walkers.onnx.operators import apply_linear, apply_softmax, with_constant
from st_codegen.walkers.onnx.shapes import joined
from st_codegen.walkers.onnx.tree_layout import targets_of_trees
from st_codegen.walkers.onnx.tree_lists import numbers, read_lists

_DOMAIN = "ai.onnx.ml"
_LEFT_OUT = (
    "probabilities are left out: onnxruntime couples those of the pairs by an iteration whose end rounding decides; "
    "the class does not depend on them"
)


def _labels(node: GraphNode, integers: str) -> tuple[ir.Label, ...]:
    """The labels of a classifier, texts before integers."""
    labels: list[ir.Label] = [*node.texts("classlabels_strings")] or [*node.integers(integers).tolist()]
    if len(labels) < 2:
        raise UnsupportedModelError(f"{counted(len(labels), 'label')}, a classifier has two or more")
    return tuple(labels)


def _post_transform(node: GraphNode) -> str:
    name = node.text("post_transform", "NONE")
    if name not in ("NONE", "LOGISTIC", "SOFTMAX"):
        raise UnsupportedModelError(
            f"post_transform {name}: known are NONE, LOGISTIC and SOFTMAX; SOFTMAX_ZERO divides zero by zero where all "
            "scores are 0, and PROBIT gives no number beyond 0 and 1 and loses all digits near 0.5"
        )
    return name


def _beside(walk: GraphWalk, one: Tensor, other: Tensor) -> Tensor:
    found = joined(walk, (one, other), 1)
    assert isinstance(found, Tensor)
    return found


def _column(tensor: Tensor, number: int) -> Tensor:
    return tensor.moved(lambda array: array[:, number : number + 1])


# --- trees ---------------------------------------------------------------------------------------------------------


@operator("TreeEnsembleClassifier", 1, 3, domain=_DOMAIN)
def _tree_classifier(call: NodeCall) -> Result:
    """`TreeEnsembleCommonClassifier` and `TreeAggregatorClassifier`."""
    labels, walk = _labels(call.node, "classlabels_int64s"), call.walk
    transform, count = _post_transform(call.node), len(labels)
    found: list[Forest] = []

    def read(node: GraphNode, number_type: NumberType) -> Forest:
        found.append(read_lists(node, number_type, "class", count))
        return found[0]

    scores = trees(call, call.floating(), read)
    forest = found[0]
    if len(call.node.integers("class_ids")) > len(forest.weight):
        raise UnsupportedModelError("weights at nodes that are no leaves; export the model again without them")
    base = numbers(call.node, "base_values", forest.number_type, 0, count, 1 if count == 2 else count)
    if count == 2:
        return _two_classes(walk, labels, scores, base, forest, transform)
    always, _ = _given(forest)
    if not (len(base) or np.all(always) or np.all(forest.weight > 0)):
        raise UnsupportedModelError(
            f"label {labels[int(np.argmin(always))]!r} is not set by all leaves of any tree, and onnxruntime does not "
            "choose it where none sets it; export the model with a weight for each label in each leaf"
        )
    if len(base):
        scores = with_constant(walk, scores, ir.Operator.ADD, base)
    return LabelOperand(largest(walk.builder, walk.settle(scores)), labels), transformed(walk, scores, transform)


def _given(forest: Forest) -> tuple[BoolArray, BoolArray]:
    """For each class whether all leaves of some tree have a weight for it, and whether any leaf has one."""
    _, target, complete = targets_of_trees(forest, forest.roots, forest.leaf)
    classes = np.arange(forest.n_targets)
    return np.isin(classes, target[complete]), np.isin(classes, target)


def _two_classes(
    walk: GraphWalk,
    labels: tuple[ir.Label, ...],
    scores: Tensor,
    base: FloatArray,
    forest: Forest,
    transform: str,
) -> Result:
    """One score decides: that of the second class where leaves set it, else that of the first (`FinalizeScores`)."""
    always, ever = _given(forest)
    advice = "export the model with a weight for each label in each leaf"
    if ever[1] and not always[1]:
        raise UnsupportedModelError(
            f"label {labels[1]!r} is set by some leaves only, and the rule then changes from row to row; {advice}"
        )
    alone, positive = not ever[1], bool(np.all(forest.weight >= 0))
    if len(base) and ever[0] and not always[0]:
        raise UnsupportedModelError(
            f"label {labels[0]!r} is set by some leaves only, for which alone onnxruntime adds base_values; {advice}"
        )
    first, second = _column(scores, 0), _column(scores, 1)
    if len(base) and ever[0] and (alone or len(base) == 1):
        first = with_constant(walk, first, ir.Operator.ADD, base[0])
    if len(base) == 2 and not alone:  # the score of the first class becomes that of the second
        second = with_constant(walk, first, ir.Operator.ADD, base[1])
        first = with_constant(walk, second, ir.Operator.MULTIPLY, -1.0) if ever[0] else _column(scores, 0)
    one_given = bool(np.sum(ever) == 1)
    decides = first if alone else second
    index = above(walk.builder, walk.settle(decides), 0.5 if one_given and positive else 0.0)
    # with weights of both classes onnxruntime answers 1 and 0, whatever integers the labels are
    choice = LabelOperand(index, labels if one_given or isinstance(labels[0], str) else (0, 1))
    if alone and len(base) < 2:
        return choice, _pair(walk, first, positive, transform)
    return choice, transformed(walk, _beside(walk, first, second), transform)


def _pair(walk: GraphWalk, score: Tensor, positive: bool, transform: str) -> Tensor:
    """Two scores made of one (`write_scores`): its distance from 1 where all weights are positive, else its negative.

    A softmax is not taken of them; a sigmoid is taken of the score and of its negative. Of trees of double numbers the
    distance is one of these, and rounded once.
    """
    if positive and transform != "LOGISTIC":
        rest = with_constant(walk, score, ir.Operator.SUBTRACT, 1.0, left=True)
        return _beside(walk, *(walk.as_type(one, FLOAT32) for one in (rest, score)))
    score = walk.as_type(score, FLOAT32)
    both = _beside(walk, with_constant(walk, score, ir.Operator.MULTIPLY, -1.0), score)
    return transformed(walk, both, transform if transform == "LOGISTIC" else "NONE")


# --- sums and kernels ----------------------------------------------------------------------------------------------


def _float32_row(call: NodeCall) -> Tensor:
    return call.walk.as_type(one_row(call.floating()), FLOAT32)


@operator("LinearClassifier", 1, domain=_DOMAIN)
def _linear_classifier(call: NodeCall) -> Result:
    tensor, walk = _float32_row(call), call.walk
    labels, transform = _labels(call.node, "classlabels_ints"), _post_transform(call.node)
    bias = call.node.floats("intercepts", 1, len(labels))
    weights = call.node.floats("coefficients", len(bias) * tensor.size)
    scores = apply_linear(walk, tensor, weights.reshape(len(bias), -1), bias, (1, len(bias)))
    if len(bias) > 1:
        return LabelOperand(largest(walk.builder, walk.settle(scores)), labels), transformed(walk, scores, transform)
    index = above(walk.builder, walk.settle(scores))
    if len(labels) > 2:
        return LabelOperand(index, ("0", "1") if isinstance(labels[0], str) else (0, 1)), scores
    return LabelOperand(index, labels), _pair(walk, scores, positive=True, transform=transform)


@operator("SVMClassifier", 1, domain=_DOMAIN)
def _svm_classifier(call: NodeCall) -> Result:
    tensor, walk, node = _float32_row(call), call.walk, call.node
    labels, transform = _labels(node, "classlabels_ints"), _post_transform(node)
    count, coupled = len(labels), len(node.floats("prob_a")) > 0
    per_class = node.integers("vectors_per_class", 0, count)
    if not np.sum(per_class):
        return _linear_machine(call, tensor, labels, coupled, transform)
    if np.any(per_class < 0):
        raise InputError("vectors_per_class has a number below 0; the model file is damaged")
    total, pairs = int(np.sum(per_class)), count * (count - 1) // 2
    weights, rho = node.floats("coefficients", (count - 1) * total), node.floats("rho", pairs)
    vectors = node.floats("support_vectors", total * tensor.size).reshape(total, tensor.size)
    coefficients = pair_coefficients(weights.reshape(count - 1, total), per_class)
    op = kernel_sum(node, walk.settle_finite(tensor), vectors, coefficients, rho)
    scores = walk.computed(op, (1, pairs), FLOAT32)
    choice = LabelOperand(largest(walk.builder, pair_votes(walk.builder, walk.settle(scores), count)), labels)
    if coupled:
        walk.notes.append(_LEFT_OUT)
        return choice, None
    if count > 2:
        return choice, transformed(walk, scores, transform)
    return choice, _pair(walk, scores, transform != "NONE", transform)


def _linear_machine(
    call: NodeCall, tensor: Tensor, labels: tuple[ir.Label, ...], coupled: bool, transform: str
) -> Result:
    """A machine without support vectors: weights for each label, and one number added to all."""
    node, walk, count = call.node, call.walk, len(labels)
    weights, rho = node.floats("coefficients", count * tensor.size), node.floats("rho")
    if not len(rho):
        raise InputError("rho is empty; the model file is damaged")
    scores = apply_linear(walk, tensor, weights.reshape(count, -1), np.full(count, rho[0]), (1, count))
    value = walk.settle(scores)
    index = largest(walk.builder, value)
    if count == 2 and not coupled:  # the second label also where any score reaches the cut (`ChooseClass`)
        positive = bool(np.all(weights >= 0))
        reached = above(walk.builder, value, 0.5 if positive else 0.0, inclusive=positive)
        picked = walk.builder.beside(reached, index)
        index = above(walk.builder, whole_sums(walk.builder, picked, np.ones((1, 3)), np.zeros(1)), 0.5)
    return LabelOperand(index, labels), transformed(walk, scores, transform)


# --- the ends of graphs --------------------------------------------------------------------------------------------


@operator("ZipMap", 1, domain=_DOMAIN)
def _zip_map(call: NodeCall) -> Operand:
    """Taken off: the numbers of a map from labels to numbers, in the order of the labels."""
    tensor = one_row(call.computed())
    call.walk.zipped[call.node.proto.output[0]] = _labels(call.node, "classlabels_int64s")
    return tensor


@operator("SequenceConstruct", 11)
def _sequence(call: NodeCall) -> Result:
    """Left out: a list of tensors, as the probabilities of each output of a MultiOutputClassifier."""
    name = plain(call.node.proto.output[0])
    call.walk.notes.append(f"{name} is left out, a list of tensors: what is to be computed is an output by itself")
    return (None,)


@operator("ArgMax ArgMin", 1, 11, 12, 13)
def _number_of_the_best(call: NodeCall) -> Operand:
    tensor, walk = call.computed(), call.walk
    axis = axis_of(call.node.integer("axis"), len(tensor.shape))
    if not tensor.shape or tensor.shape[axis] != tensor.size:
        raise UnsupportedModelError(f"axis {axis} of shape {tensor.shape} (for one row) does not hold all columns")
    walk.refuse_special(tensor)
    last, count = call.node.integer("select_last_index"), tensor.size
    flat = tensor.moved(lambda array: np.ravel(array)[:: -1 if last else 1])
    if call.node.op_type == "ArgMin":
        flat = with_constant(walk, flat, ir.Operator.MULTIPLY, -1.0)
    index = largest(walk.builder, walk.settle(flat))
    if last:
        index = walk.builder.scale(index, "-", count - 1.0, reverse=True)
    kept = [1 if number == axis else n for number, n in enumerate(tensor.shape)]
    shape = kept if call.node.integer("keepdims", 1) else kept[:axis] + kept[axis + 1 :]
    return LabelOperand(index, tuple(range(count)), tuple(shape))


@operator("Hardmax", 1, 11, 13)
def _first_of_the_largest(call: NodeCall) -> Operand:
    """1 for the first of the largest numbers, 0 for all others."""
    tensor, walk = call.computed(), call.walk
    axis = axis_of(call.node.integer("axis", -1 if call.node.version >= 13 else 1), len(tensor.shape))
    taken = math.prod(tensor.shape[axis : axis + 1] if call.node.version >= 13 else tensor.shape[axis:])
    if taken != tensor.size:
        raise UnsupportedModelError(f"axis {axis} of shape {tensor.shape} (for one row) does not hold all columns")
    index = largest(walk.builder, walk.settle_finite(tensor))
    each = walk.builder.select(np.zeros(tensor.size, np.int32), index)
    return walk.computed(equals(walk, each, np.arange(float(tensor.size))), tensor.shape, tensor.dtype)


@operator("Softmax LogSoftmax", 1, 11, 13)
def _shares(call: NodeCall) -> Operand:
    tensor = call.computed()
    rank = len(tensor.shape)
    axis = axis_of(call.node.integer("axis", -1 if call.node.version >= 13 else 1), rank)
    taken = tensor.shape[axis : axis + 1] if call.node.version >= 13 else tensor.shape[axis:]
    rows = tensor.moved(lambda array: np.moveaxis(array, axis, -1)) if len(taken) == 1 else tensor
    flat = rows.moved(lambda array: array.reshape(-1, math.prod(taken)))
    found = apply_softmax(call.walk, flat, call.node.op_type == "LogSoftmax").moved(
        lambda array: array.reshape(rows.shape)
    )
    return found.moved(lambda array: np.moveaxis(array, -1, axis)) if len(taken) == 1 else found
