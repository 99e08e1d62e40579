"""Walkers for scikit-learn's support vector machines, kernel regression and neural networks.

These add products through BLAS, whose order is not specified: equal within the bound of `proof/bounds.py`, not to the
bit.
"""

from __future__ import annotations

import numpy as np

from st_codegen.errors import UnsupportedModelError, counted
from st_codegen.ir import Clip, CoupledPairs, FloatArray, Function, KernelSum, Precision
from st_codegen.walkers.base import Classified, GraphBuilder, Walked, walks
from st_codegen.walkers.classes import (
    above,
    complement,
    labels_of,
    largest,
    pair_coefficients,
    pair_members,
    pair_votes,
    softmax,
    trained_on_one,
    whole_sums,
)
from st_codegen.walkers.fitted import SPARSE, Fitted
from st_codegen.walkers.sklearn.transforms import KERNELS, add_kernels

_FUNCTIONS = {name: Function(name) for name in ("identity", "tanh", "logistic", "relu", "exp")}


class _Machine:
    """A fitted machine of libsvm, of which predictions read the private attributes; the public ones are copies.

    For two classes scikit-learn shows them with the opposite sign.
    """

    def __init__(self, fitted: Fitted, width: int, n_classes: int) -> None:
        self.fitted = fitted
        self.kernel = fitted.choice("kernel", KERNELS)
        self.vectors = fitted.floats("support_vectors_", (None, width))
        count, pairs = len(self.vectors), n_classes * (n_classes - 1) // 2
        kept = np.size(fitted.get("_n_support"))
        if kept < n_classes and np.shape(fitted.get("_intercept_")) == (kept * (kept - 1) // 2,):
            raise UnsupportedModelError(
                f"{fitted.kind} of {n_classes} classes, of which libsvm kept {kept}, as it does where all rows of a "
                "class have no weight: scikit-learn then answers with the labels of other classes; leave such rows out "
                "before fit"
            )
        self.intercept = fitted.floats("_intercept_", (pairs,))
        self.coefficients = fitted.floats("_dual_coef_", (n_classes - 1, count))
        # libsvm reads as many entries of these as it has support vectors, and of the numbers one a class
        fitted.integers("support_", (count,), low=0, high=2**31 - 1)
        self.of_class = fitted.integers("_n_support", (n_classes,), low=0, high=2**31 - 1)
        sign = -1.0 if hasattr(fitted.estimator, "classes_") and n_classes == 2 else 1.0
        for public, used in (("intercept_", self.intercept), ("dual_coef_", self.coefficients)):
            if not np.array_equal(fitted.floats(public, used.shape), sign * used):
                raise fitted.fail(public, f"differs from _{public}, with which scikit-learn predicts")
        self._check_stored()

    def _check_stored(self) -> None:
        """Whether the matrices are stored as libsvm reads them: of a sparse one row by row, and every coefficient."""
        sparse = self.fitted.flag("_sparse")
        for name in ("support_vectors_", "_dual_coef_"):
            matrix = self.fitted.get(name)
            if isinstance(matrix, np.ndarray) == sparse:
                raise self.fitted.fail(name, f"{'dense' if sparse else 'sparse'}, where _sparse is {sparse}")
            ordered = sparse and matrix.format == "csr" and matrix.has_sorted_indices
            if ordered and name == "support_vectors_" and not matrix.has_canonical_format:
                raise UnsupportedModelError(
                    f"{self.fitted.kind} was fitted on a sparse matrix with several numbers in one place, which libsvm "
                    "does not add up: call sum_duplicates() of the matrix before fit"
                )
            if sparse and not (ordered and matrix.has_canonical_format):
                raise self.fitted.fail(name, "not a sparse matrix of ordered rows")
            if sparse and name == "_dual_coef_" and matrix.nnz != self.coefficients.size:
                raise self.fitted.fail(name, f"{counted(matrix.nnz, 'number')}, expected {self.coefficients.size}")

    def add(self, builder: GraphBuilder, value: int, coefficients: FloatArray) -> int:
        """The sums of kernels with these coefficients (sums, vectors), plus the intercepts."""
        fitted = self.fitted
        builder.refuse_special(value)
        if not len(self.vectors):  # every target lies within epsilon of the mean: a constant
            return builder.linear(value, np.zeros((len(coefficients), builder.width(value))), self.intercept)
        return builder.add(
            KernelSum(
                inputs=(value,),
                kernel=self.kernel,
                support_vectors=self.vectors,
                coefficients=coefficients,
                intercept=self.intercept,
                gamma=fitted.number("_gamma"),
                coef0=fitted.number("coef0"),
                degree=fitted.integer("degree", 0, 2**31 - 1),
            )
        )


@walks("SVR NuSVR", single=True, trusts=SPARSE)
def walk_svr(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Sum of dual coefficient * kernel, plus intercept (`sklearn/svm/src/libsvm/svm.cpp: svm_predict_values`)."""
    machine = _Machine(fitted, builder.width(value), 2)
    return machine.add(builder, value, machine.coefficients)


@walks("OneClassSVM", single=True)
def walk_one_class(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """1 where the sum is above 0, else -1 (`svm.cpp: svm_predict_values`)."""
    machine = _Machine(fitted, builder.width(value), 2)
    scores = machine.add(builder, value, machine.coefficients)
    return Classified((-1, 1), above(builder, scores), decision=scores)


@walks("SVC NuSVC", single=True)
def walk_svc(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """One machine a pair of classes, of which each has a vote; the first of most votes (`svm_predict_values`).

    The score of a pair is above 0 for its first class. scikit-learn's own scores of two classes have the other sign,
    and those of more are votes and confidences (`utils/multiclass.py: _ovr_decision_function`).
    """
    if fitted.flag("break_ties") and fitted.estimator.decision_function_shape == "ovo":
        raise UnsupportedModelError(
            f"{fitted.kind} with break_ties=True and decision_function_shape='ovo', with which its own predict raises: "
            "take 'ovr' or break_ties=False"
        )
    labels = labels_of(fitted)
    count = len(labels)
    machine = _Machine(fitted, builder.width(value), count)
    if np.sum(machine.of_class) != len(machine.vectors):
        raise fitted.fail(
            "_n_support", f"{counted(int(np.sum(machine.of_class)), 'vector')} in all, expected {len(machine.vectors)}"
        )
    pairs = machine.add(builder, value, pair_coefficients(machine.coefficients, machine.of_class))
    turned = builder.scale(pairs, "*", -1.0)
    votes = pair_votes(builder, pairs, count)
    shares = _coupled(fitted, builder, pairs, count)
    if count == 2:
        return Classified(labels, largest(builder, votes), shares, turned)
    if fitted.estimator.decision_function_shape == "ovo":
        return Classified(labels, largest(builder, votes), shares, pairs)
    decision = votes_and_confidences(builder, above(builder, turned), turned, count)
    return Classified(labels, largest(builder, decision if fitted.estimator.break_ties else votes), shares, decision)


#: How near to 0 and 1 the share of a class beside another one may come.
_LEAST_SHARE = 1e-7


def _coupled(fitted: Fitted, builder: GraphBuilder, pairs: int, count: int) -> int | None:
    """Probabilities, where it was trained for them: a logistic function of each pair's score, and the pairs coupled.

    (`svm.cpp: sigmoid_predict`, `multiclass_probability`); the class does not depend on them.
    """
    if fitted.get("probability") == "deprecated" or not fitted.flag("probability"):
        return None
    width = builder.width(pairs)
    slope, offset = (fitted.floats(name, (width,)) for name in ("_probA", "_probB"))
    argument = builder.scale(builder.chain(pairs, ("*", slope), ("+", offset)), "*", -1.0)
    ends = np.full(width, _LEAST_SHARE), np.full(width, 1.0 - _LEAST_SHARE)
    shares = builder.add(Clip((builder.function(argument, "logistic"),), *ends))
    return builder.add(CoupledPairs((shares,), count))


def votes_and_confidences(builder: GraphBuilder, seconds: int, scores: int, count: int) -> int:
    """Votes of the pairs of classes and, below one vote, their confidences (`_ovr_decision_function`).

    A column a pair: `seconds` is 1 where its second class was chosen, and `scores` how much the pair is for that class.
    """
    first, second = pair_members(count)
    votes = whole_sums(builder, seconds, second - first, first.sum(axis=1))
    confidence = builder.linear(scores, second - first)
    size = builder.function(confidence, "leaky_relu", parameter=-1.0)  # |x|, and x / (3 * (|x| + 1)) below one vote
    squashed = builder.combine(confidence, "/", builder.chain(size, ("+", 1.0), ("*", 3.0)))
    return builder.combine(votes, "+", squashed)


@walks(
    "MLPRegressor MLPClassifier",
    trusts=(
        "sklearn.neural_network._stochastic_optimizers.AdamOptimizer",
        "sklearn.neural_network._stochastic_optimizers.SGDOptimizer",
    ),
    finite=True,
    single=True,
)
def walk_mlp(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """Add the dense layers of a network, each with its function (`_multilayer_perceptron.py: _forward_pass_fast`).

    Of two classes the second is taken above 0.5, of more the first of the largest probabilities (`LabelBinarizer`).
    """
    layers = fitted.items("coefs_")
    last = len(layers) - 1
    biases = fitted.items("intercepts_", len(layers))
    fitted.integers("n_layers_", (), low=len(layers) + 1, high=len(layers) + 1)
    for layer, (given, given_bias) in enumerate(zip(layers, biases, strict=True)):
        weights = fitted.floats_of(f"coefs_[{layer}]", given, (builder.width(value), None))
        bias = fitted.floats_of(f"intercepts_[{layer}]", given_bias, (weights.shape[1],))
        single = given.dtype == np.float32  # and so is the bias, which is added in place
        precision = builder.precision(value) if single else Precision.FLOAT64
        value = builder.linear(value, weights.T, bias, precision=precision)
        if layer == last and fitted.get("out_activation_") == "softmax":
            value = softmax(builder, value, builder.precision(value))
            continue
        function = fitted.choice("out_activation_" if layer == last else "activation", _FUNCTIONS)
        if function is not Function.IDENTITY:
            value = builder.function(value, function, precision=builder.precision(value))
    if fitted.kind != "MLPClassifier":
        return value
    labels, count = labels_of(fitted), builder.width(value)
    if len(labels) < 2:
        raise UnsupportedModelError(f"{fitted.kind} {trained_on_one(labels)}")
    if getattr(fitted.get("_label_binarizer"), "y_type_", "") == "multilabel-indicator":
        return above(builder, value, 0.5)
    if count != (len(labels) if len(labels) > 2 else 1) or (count > 1) != (fitted.get("out_activation_") == "softmax"):
        raise UnsupportedModelError(
            f"MLPClassifier with {counted(count, 'output')} for {counted(len(labels), 'label')}: train one for each"
        )
    if count > 1:
        return Classified(labels, largest(builder, value), value)
    return Classified(labels, above(builder, value, 0.5), complement(builder, value, builder.precision(value)))


@walks("KernelRidge", finite=True)
def walk_kernel_ridge(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Sum of dual coefficient * kernel (`kernel_ridge.py: predict`, `metrics/pairwise.py`)."""
    vectors = fitted.floats("X_fit_", (None, builder.width(value)))
    dual = fitted.floats("dual_coef_", (len(vectors),), (len(vectors), None)).reshape(len(vectors), -1)
    return add_kernels(fitted, builder, value, vectors, dual.T)
