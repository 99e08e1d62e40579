"""Walkers for scikit-learn's compositions of classifiers and regressors: votes, means, chains, one against the rest.

The order of additions is the library's: NumPy adds whole arrays, estimator by estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from itertools import combinations
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Exceeds, FloatArray, Label, Precision, WeightedMedian
from st_codegen.walkers.base import (
    Classified,
    Estimated,
    GraphBuilder,
    Walked,
    walk_any,
    walk_classifier,
    walk_estimator,
    walks,
)
from st_codegen.walkers.classes import (
    above,
    complement,
    label_of,
    labels_of,
    largest,
    numbered,
    shares_of,
    softmax,
    trained_on_one,
    whole_sums,
)
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.sklearn.linear import negative_square_distances
from st_codegen.walkers.sklearn.models import votes_and_confidences
from st_codegen.walkers.sklearn.wrappers import constants


def _mean(
    builder: GraphBuilder, values: Sequence[int], divisor: float, precision: Precision = Precision.FLOAT64
) -> int:
    """The values added one after another, then divided."""
    total = values[0]
    for value in values[1:]:
        total = builder.combine(total, "+", value, precision=precision)
    return builder.scale(total, "/", divisor, precision=precision)


def _one_hot(builder: GraphBuilder, index: int, count: int) -> int:
    """1 in the column of the class, 0 in the others."""
    repeated = builder.select(np.zeros(count, np.int32), index)
    reached = builder.add(Exceeds((repeated,), np.arange(float(count)) - 0.5))
    return whole_sums(builder, reached, np.eye(count) - np.eye(count, k=1), np.zeros(count))


def _scattered(fitted: Fitted, part: Classified, value: int, labels: Sequence[Label], builder: GraphBuilder) -> int:
    """Columns of a part's classes at the places of these classes in the whole; the others are 0."""
    if tuple(labels) == part.labels:
        return value
    _check_known(fitted, part, labels)
    weights = np.array([[1.0 if own == label else 0.0 for own in part.labels] for label in labels])
    return whole_sums(builder, value, weights, np.zeros(len(labels)))


def _check_known(fitted: Fitted, part: Classified, labels: Sequence[Label]) -> None:
    """Raise UnsupportedModelError where an estimator answers with a label that is none of those it is fitted on."""
    if not set(part.labels) <= set(labels):
        other = next(label for label in part.labels if label not in labels)
        raise UnsupportedModelError(
            f"{fitted.kind} of an estimator that answers with {other!r}, as an outlier_label may be; it is fitted on "
            f"the labels {', '.join(map(repr, labels[:3]))}{', ..' * (len(labels) > 3)}: take one of these, or train "
            "the whole again"
        )


def _probability(part: Classified, estimator: Any) -> int:
    if part.probability is None:
        name = type(estimator).__name__
        if hasattr(estimator, "predict_proba"):  # a Gaussian process of many rows
            raise UnsupportedModelError(
                f"{name}: its probabilities are not compiled; take CalibratedClassifierCV({name}())"
            )
        raise UnsupportedModelError(f"{name} gives no probabilities, which the whole needs")
    return part.probability


def _response(part: Classified, estimator: Any, builder: GraphBuilder) -> int:
    """The score that says how much an estimator is for its second class (`_predict_binary`)."""
    scores_alone = part.decision is not None and part.probability is None  # a regressor's
    if scores_alone or hasattr(estimator, "decision_function"):
        if part.decision is None or builder.width(part.decision) != 1:
            raise UnsupportedModelError(f"{type(estimator).__name__} gives no single score, which the whole needs")
        return part.decision
    return builder.select([1], _probability(part, estimator))


def _weights(fitted: Fitted, count: int) -> FloatArray | None:
    """Weights of the estimators that are not dropped; None where there are none."""
    given = fitted.get("weights")
    if given is None:
        return None
    chosen = [weight for (_, kind), weight in zip(fitted.items("estimators"), given, strict=True) if kind != "drop"]
    return fitted.floats_of("weights", np.array(chosen), (count,))


#: The dictionary in which an ensemble keeps its parts by their names.
_NAMED = ("sklearn.utils._bunch.Bunch",)


@walks("VotingClassifier", trusts=_NAMED, single=True)
def walk_voting(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The first class of most votes, or of the largest mean probability (`ensemble/_voting.py: predict`)."""
    labels, parts = labels_of(fitted), fitted.items("estimators_")
    weights, numbers = _weights(fitted, len(parts)), tuple(range(len(labels)))
    found = [walk_classifier(part, builder, value) for part in parts]
    if fitted.estimator.voting == "soft":
        shares = [_probability(one, part) for one, part in zip(found, parts, strict=True)]
        if weights is not None:
            shares = [builder.scale(share, "*", weight) for share, weight in zip(shares, weights, strict=True)]
        divisor = float(len(parts)) if weights is None else float(weights.sum())
        mean = _mean(builder, shares, divisor, builder.precision(*shares))
        return Classified(labels, largest(builder, mean), mean)
    votes = [_scattered(fitted, one, _one_hot(builder, one.index, len(one.labels)), numbers, builder) for one in found]
    each = np.ones(len(parts)) if weights is None else weights
    table = np.hstack([weight * np.eye(len(labels)) for weight in each])
    return Classified(
        labels, largest(builder, whole_sums(builder, builder.beside(*votes), table, np.zeros(len(labels))))
    )


@walks("VotingRegressor", trusts=_NAMED, single=True)
def walk_voting_regressor(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The weighted mean of the regressors, which NumPy adds in an order of its own."""
    parts = fitted.items("estimators_")
    found = [walk_estimator(part, builder, value) for part in parts]
    if any(builder.width(one) != 1 for one in found):
        raise UnsupportedModelError("VotingRegressor with several outputs")
    weights = _weights(fitted, len(parts))
    each = np.ones(len(parts)) if weights is None else weights
    precision = builder.precision(*found) if weights is None else Precision.FLOAT64
    total = builder.linear(builder.beside(*found), each[None, :], precision=precision)
    return builder.scale(total, "/", each.sum(), precision=precision)


def _bagged(fitted: Fitted, builder: GraphBuilder, value: int) -> list[tuple[Any, int]]:
    """Each estimator of a bag, and the columns that it takes."""
    parts, width = fitted.items("estimators_"), builder.width(value)
    given = fitted.items("estimators_features_", len(parts))
    fitted.integer("n_estimators", len(parts), len(parts))  # the library divides by it
    found = []
    for part, columns in zip(parts, given, strict=True):
        chosen = fitted.integers_of("estimators_features_", columns, (None,), low=0, high=width - 1)
        everything = np.array_equal(chosen, np.arange(width))
        found.append((part, value if everything else builder.select(chosen, value)))
    return found


@walks("BaggingClassifier", single=True)
def walk_bagging(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The mean of probabilities, or of votes (`ensemble/_bagging.py: _parallel_predict_proba` with n_jobs=1)."""
    labels = labels_of(fitted)
    numbers = tuple(range(len(labels)))
    shares = []
    for part, columns in _bagged(fitted, builder, value):
        one = walk_classifier(part, builder, columns)
        if hasattr(part, "predict_proba"):
            shares.append(_scattered(fitted, one, _probability(one, part), numbers, builder))
        else:
            shares.append(_scattered(fitted, one, _one_hot(builder, one.index, len(one.labels)), numbers, builder))
    mean = _mean(builder, shares, float(len(shares)))
    return Classified(labels, largest(builder, mean), mean)


@walks("BaggingRegressor", single=True)
def walk_bagging_regressor(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean of the regressors, added in order."""
    found = [walk_estimator(part, builder, columns) for part, columns in _bagged(fitted, builder, value)]
    return _mean(builder, found, float(len(found)), builder.precision(*found))


@walks("AdaBoostClassifier", finite=True, single=True)
def walk_ada_boost(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Each estimator adds its weight to its class, and takes a share of it from the others (SAMME)."""
    fitted.refuse_old("algorithm", "SAMME.R")
    labels, parts = labels_of(fitted), fitted.items("estimators_")
    count = len(labels)
    if count < 2:
        raise UnsupportedModelError(f"{fitted.kind} {trained_on_one(labels)}")
    given = fitted.floats("estimator_weights_", (None,))
    weights = given[: len(parts)]
    columns, table = [], []
    for part, weight in zip(parts, weights, strict=True):
        one = walk_classifier(part, builder, value)
        chosen = _scattered(fitted, one, _one_hot(builder, one.index, len(one.labels)), labels, builder)
        other = builder.scale(chosen, "-", 1.0, reverse=True)
        columns += [chosen, other]
        table += [weight * np.eye(count), -1 / (count - 1) * weight * np.eye(count)]
    # each sum has one product that is not zero for an estimator, so that nothing is rounded but the sum itself
    total = whole_sums(builder, builder.beside(*columns), np.hstack(table), np.zeros(count))
    scores = builder.scale(total, "/", given.sum())  # with the zeros behind them NumPy adds in another order
    if count > 2:
        shares = builder.scale(scores, "/", count - 1.0)
        return Classified(labels, largest(builder, scores), softmax(builder, shares), scores)
    score = whole_sums(builder, scores, np.array([[-1.0, 1.0]]), np.zeros(1))
    halves = whole_sums(builder, score, np.array([[-0.5], [0.5]]), np.zeros(2))
    return Classified(labels, above(builder, score), softmax(builder, halves), score)


@walks("AdaBoostRegressor", finite=True, single=True)
def walk_ada_boost_regressor(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The weighted median of the estimators (`ensemble/_weight_boosting.py: _get_median_predict`)."""
    parts = fitted.items("estimators_")
    weights = fitted.floats("estimator_weights_", (None,))[: len(parts)]
    found = [walk_estimator(part, builder, value) for part in parts]
    if len(weights) != len(parts) or any(builder.width(one) != 1 for one in found):
        raise fitted.fail("estimator_weights_", "not one weight an estimator of one output")
    if len(found) == 1:  # training ends early where an estimator makes no mistake, or too large ones
        return found[0]
    return builder.add(WeightedMedian((builder.beside(*found),), weights))


@walks("OneVsRestClassifier", trusts=("sklearn.multiclass._ConstantPredictor",), single=True)
def walk_one_vs_rest(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The first (or last) of the largest scores, one a class; of two classes the second beyond the threshold.

    Of several labels a row: 1 for each whose score lies beyond it.
    """
    parts = fitted.items("estimators_")
    binarizer = Fitted(fitted.get("label_binarizer_"))
    labels = labels_of(binarizer)
    found = [_one_of_the_rest(part, builder, value) for part in parts]
    scores = [_response(one, part, builder) for one, part in zip(found, parts, strict=True)]
    cut = 0.0 if hasattr(parts[0], "decision_function") and not _is_constant(parts[0]) else 0.5
    if binarizer.get("y_type_") == "multilabel-indicator":
        return above(builder, builder.beside(*scores), cut)
    probability = _of_all(builder, [one.probability for one in found])
    if len(parts) == 1:
        return Classified(labels, above(builder, scores[0], cut), probability)
    if _chosen_of_equal(fitted.estimator, builder.width(value)) == labels[0]:
        return Classified(labels, largest(builder, builder.beside(*scores)), probability)
    turned = largest(builder, builder.beside(*scores[::-1]))
    return Classified(labels, builder.scale(turned, "-", len(parts) - 1.0, reverse=True), probability)


def _is_constant(estimator: Any) -> bool:
    """Whether an estimator stands for a label that all rows of the training had, or none."""
    return type(estimator).__name__ == "_ConstantPredictor"


def _one_of_the_rest(estimator: Any, builder: GraphBuilder, value: int, low: int = 0) -> Classified:
    """A classifier of a class against the rest (`multiclass.py: _fit_binary`), whose lower label is `low`.

    Of a regressor the number is the score (`_predict_binary`).
    """
    if not _is_constant(estimator):
        walked = walk_any(estimator, builder, value)
        if isinstance(walked, Classified):
            return walked
        number = walked.mean if isinstance(walked, Estimated) else walked
        return Classified((low, 1), above(builder, number, 0.5), decision=number)
    answer = Fitted(estimator).integers("y_", (1,), low=low, high=1).astype(np.float64)
    score = constants(builder, value, answer)
    probability = constants(builder, value, np.hstack([1.0 - answer, answer])) if low == 0 else None
    return Classified((low, 1), score, probability, score)


def _of_all(builder: GraphBuilder, probabilities: Sequence[int | None]) -> int | None:
    """That of each class by the estimator of the class, by their sum; None where one gives none (`predict_proba`)."""
    known = [probability for probability in probabilities if probability is not None]
    if len(known) < len(probabilities):
        return None
    if len(known) == 1:  # whose own first probability need not be 1 - p to the bit
        second = builder.select([1], known[0])
        return shares_of(builder, complement(builder, second), equal=False)
    return shares_of(builder, builder.beside(*(builder.select([1], one) for one in known)), equal=False)


def _chosen_of_equal(estimator: Any, width: int) -> Label:
    """The label that the library takes where all scores are equal: the first in newer versions, once the last."""
    from sklearn.multiclass import _ConstantPredictor

    equal = copy(estimator)
    equal.estimators_ = [_ConstantPredictor().fit(np.zeros((1, width)), np.zeros(1))] * len(estimator.estimators_)
    label: Label = label_of(equal.predict(np.zeros((1, width)))[0])
    return label


@walks("OneVsOneClassifier", single=True)
def walk_one_vs_one(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Votes of one estimator a pair of classes; what they leave equal is decided by their scores."""
    labels, parts = labels_of(fitted), fitted.items("estimators_")
    if fitted.get("pairwise_indices_") is not None or len(parts) != len(list(combinations(labels, 2))):
        raise UnsupportedModelError("OneVsOneClassifier of a precomputed kernel")
    found = [walk_classifier(part, builder, value) for part in parts]
    for one in found:  # another answer is a vote for neither
        _check_known(fitted, one, (0, 1))
    scores = [_response(one, part, builder) for one, part in zip(found, parts, strict=True)]
    seconds = builder.beside(*[one.index for one in found])
    decision = votes_and_confidences(builder, seconds, builder.beside(*scores), len(labels))
    if len(labels) == 2:
        cut = 0.0 if hasattr(parts[0], "decision_function") else 0.5
        decision = builder.select([1], decision)
        return Classified(labels, above(builder, decision, cut), decision=decision)
    return Classified(labels, largest(builder, decision), decision=decision)


@walks("OutputCodeClassifier", single=True)
def walk_output_code(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The class whose code lies nearest to the scores (`multiclass.py: OutputCodeClassifier.predict`)."""
    labels, parts = labels_of(fitted), fitted.items("estimators_")
    codes = fitted.floats("code_book_", (len(labels), len(parts)))
    # a code that all classes share is a constant: -1 or 1 of estimators with scores, else 0 or 1
    found = [_one_of_the_rest(part, builder, value, low=-1) for part in parts]
    scores = builder.beside(*(_response(one, part, builder) for one, part in zip(found, parts, strict=True)))
    return Classified(labels, largest(builder, negative_square_distances(builder, scores, codes)))


@walks(
    "CalibratedClassifierCV",
    trusts=("sklearn.calibration._CalibratedClassifier", "sklearn.calibration._SigmoidCalibration"),
    single=True,
)
def walk_calibrated(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The mean of calibrated scores (`calibration.py: _CalibratedClassifier.predict_proba`)."""
    labels = labels_of(fitted)
    if fitted.estimator.method not in ("sigmoid", "isotonic"):
        raise UnsupportedModelError(
            f"CalibratedClassifierCV with method={fitted.estimator.method!r}: supported are 'sigmoid' and 'isotonic'"
        )
    shares = []
    for calibrated in fitted.items("calibrated_classifiers_"):
        inner = calibrated.estimator
        one = walk_classifier(inner, builder, value)
        _check_known(fitted, one, labels)
        calibrators = Fitted(calibrated).items("calibrators", len(one.labels) if len(labels) > 2 else 1)
        if len(labels) == 2:
            score = _response(one, inner, builder)
            shares.append(complement(builder, _calibrated_score(calibrators[0], builder, score)))
            continue
        whole = one.decision if hasattr(inner, "decision_function") else _probability(one, inner)
        if whole is None or builder.width(whole) != len(calibrators):
            raise UnsupportedModelError(f"{type(inner).__name__} gives no score for each class, which the whole needs")
        found = [_calibrated_score(part, builder, builder.select([n], whole)) for n, part in enumerate(calibrators)]
        shares.append(shares_of(builder, _scattered(fitted, one, builder.beside(*found), labels, builder)))
    mean = _mean(builder, shares, float(len(shares)))
    return Classified(labels, largest(builder, mean), mean)


def _calibrated_score(calibrator: Any, builder: GraphBuilder, score: int) -> int:
    """A sigmoid of a score, or what was fitted to it in steps, which takes it whatever the inputs are."""
    fitted = Fitted(calibrator)
    if fitted.kind == "IsotonicRegression":
        limits = list(builder.magnitude_limits)
        found = walk_estimator(calibrator, builder, score)
        builder.magnitude_limits = limits
        return found
    argument = builder.chain(score, ("*", fitted.number("a_")), ("+", fitted.number("b_")), ("*", -1.0))
    return builder.function(argument, "logistic")


def _stacked(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """What the estimators of a stack give to the last one, and the inputs where they are passed through."""
    parts, methods = fitted.items("estimators_"), fitted.items("stack_method_")
    columns = []
    for part, method in zip(parts, methods, strict=True):
        if not hasattr(part, "classes_"):
            columns.append(walk_estimator(part, builder, value))
            continue
        one = walk_classifier(part, builder, value)
        given = {"predict": one.index, "decision_function": one.decision, "predict_proba": one.probability}.get(method)
        if given is None or (method == "predict" and one.labels != tuple(range(len(one.labels)))):
            raise UnsupportedModelError(f"{type(part).__name__} in a stack by its {method}")
        second = method == "predict_proba" and len(one.labels) == 2
        columns.append(builder.select([1], given) if second else given)
    if not fitted.get("passthrough"):
        return builder.beside(*columns)
    return builder.held_like(value, builder.beside(*columns, value))


@walks("StackingRegressor", trusts=_NAMED, single=True)
def walk_stack(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The last regressor on what the others give (`ensemble/_stacking.py: _concatenate_predictions`)."""
    return walk_estimator(fitted.get("final_estimator_"), builder, _stacked(fitted, builder, value))


@walks("StackingClassifier", trusts=_NAMED, single=True)
def walk_stack_of_classes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The last classifier on what the others give; it knows the classes by their numbers."""
    labels = labels_of(fitted)
    last = walk_classifier(fitted.get("final_estimator_"), builder, _stacked(fitted, builder, value))
    if last.labels != tuple(range(len(labels))):
        raise fitted.fail("final_estimator_", "other classes than the whole")
    return Classified(labels, last.index, last.probability, last.decision)


def _one_output(part: Any, builder: GraphBuilder, value: int) -> int:
    """What an estimator gives; of a classifier the label, where the labels are whole numbers."""
    one = walk_any(part, builder, value)
    if not isinstance(one, Classified):
        return one.mean if isinstance(one, Estimated) else one
    return numbered(builder, one.index, one.labels, type(part).__name__)


def _handed_on(one: Classified, part: Any, method: str, builder: GraphBuilder) -> int:
    """What those behind a classifier of a chain are given of it (`utils/_response.py: _get_response_values`)."""
    score = {"predict_proba": one.probability, "decision_function": one.decision}.get(method)
    if len(one.labels) != 2 or score is None:
        raise UnsupportedModelError(f"ClassifierChain by the {method} of {type(part).__name__}")
    return builder.select([1], score) if method == "predict_proba" else score


@walks("MultiOutputRegressor MultiOutputClassifier", single=True)
def walk_multi_output(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """One estimator an output, side by side."""
    return builder.beside(*[_one_output(part, builder, value) for part in fitted.items("estimators_")])


@walks("RegressorChain ClassifierChain", finite=True, single=True)
def walk_chain(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Each estimator takes the inputs and what those before it gave (`multioutput.py: _get_predictions`)."""
    parts = fitted.items("estimators_")
    method = fitted.get("chain_method_") if fitted.kind == "ClassifierChain" else "predict"
    order = fitted.integers_of("order_", np.asarray(fitted.get("order_")), (len(parts),), low=0, high=len(parts) - 1)
    given: list[int] = []
    found: list[int] = []
    for part in parts:
        read = builder.held_like(value, builder.beside(value, *given))
        if method == "predict":
            given.append(_one_output(part, builder, read))
            found.append(given[-1])
            continue
        one = walk_classifier(part, builder, read)
        given.append(_handed_on(one, part, method, builder))
        found.append(numbered(builder, one.index, one.labels, type(part).__name__))
    result = builder.select(np.argsort(order), builder.beside(*found))
    builder.widened.add(result)
    return result
