"""Walkers for scikit-learn's linear models, of numbers and of classes: one weighted sum, and what is made of it.

They add products through BLAS, whose order is not specified: equal within the bound of `proof/bounds.py`, not to the
bit.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import BoolArray, Clip, Distances, Exceeds, FloatArray, Precision
from st_codegen.walkers.base import Classified, GraphBuilder, Walked, walk_estimator, walks
from st_codegen.walkers.classes import above, complement, labels_of, largest, shares_of, softmax, whole_sums
from st_codegen.walkers.fitted import SPARSE, Fitted
from st_codegen.walkers.sklearn.pieces import add_pieces


@walks(
    """
    ARDRegression BayesianRidge ElasticNet ElasticNetCV HuberRegressor Lars LarsCV Lasso LassoCV LassoLars
    LassoLarsCV LassoLarsIC LinearRegression LinearSVR MultiTaskElasticNet MultiTaskElasticNetCV MultiTaskLasso
    MultiTaskLassoCV OrthogonalMatchingPursuit OrthogonalMatchingPursuitCV PassiveAggressiveRegressor
    QuantileRegressor Ridge RidgeCV SGDRegressor TheilSenRegressor
    """,
    single=True,
)
def _weighted_sum(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """`X @ coef_.T + intercept_` (`sklearn/linear_model/_base.py: LinearModel._decision_function`)."""
    width = builder.width(value)
    weights = np.atleast_2d(fitted.floats("coef_", (width,), (None, width)))
    builder.refuse_special(value)
    intercept = np.broadcast_to(fitted.floats("intercept_", (), (1,), (len(weights),)), (len(weights),))
    if not builder.is_single(value) or fitted.estimator.coef_.dtype != np.float32:
        return builder.linear(value, weights, intercept)
    single = np.result_type(np.float32, fitted.estimator.intercept_) == np.float32
    total = builder.linear(value, weights, intercept if single else 0.0, precision=Precision.FLOAT32)
    return total if single else builder.scale(total, "+", intercept)


@walks(
    "PoissonRegressor GammaRegressor TweedieRegressor",
    trusts=("sklearn._loss.loss.HalfTweedieLoss", "sklearn._loss.loss.HalfTweedieLossIdentity"),
    single=True,
)
def walk_generalized(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """A weighted sum behind the inverse of the loss's link (`linear_model/_glm/glm.py: predict`)."""
    total = _weighted_sum(fitted, builder, value)
    link = type(fitted.estimator._base_loss.link).__name__
    if link == "IdentityLink":
        return total
    if link != "LogLink":
        raise UnsupportedModelError(f"{fitted.kind} with the link {link}")
    return builder.function(total, "exp", precision=builder.precision(total))


@walks("PLSRegression PLSCanonical CCA")
def walk_partial_leastsquares(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Centred inputs, then a weighted sum an output (`cross_decomposition/_pls.py: predict`)."""
    mean = fitted.floats("_x_mean", (builder.width(value),))
    return _weighted_sum(fitted, builder, builder.scale(value, "-", mean))


@walks("RANSACRegressor", single=True)
def walk_consensus(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The regressor that was fitted on the inliers."""
    return walk_estimator(fitted.get("estimator_"), builder, value)


@walks(
    """
    LinearDiscriminantAnalysis LinearSVC LogisticRegression LogisticRegressionCV PassiveAggressiveClassifier
    Perceptron SGDClassifier
    """,
    trusts=SPARSE,
    single=True,
)
def walk_linear_classifier(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Classifiers by linear scores: the second of two classes above 0, or the first of several with the largest score
    (`LinearClassifierMixin.predict`).

    Probabilities of logistic models and of discriminant analysis: the sigmoid of the one score, the softmax of several;
    of SGDClassifier those of each class by their sum (`linear_model/_stochastic_gradient.py: predict_proba`).
    """
    labels = labels_of(fitted)
    if len(labels) == 1 and (np.any(fitted.floats("coef_")) or np.any(fitted.floats("intercept_") > 0)):
        raise UnsupportedModelError(
            f"{fitted.kind} with one class, whose own predict raises where the score is above 0: train it with two"
        )
    scores = _weighted_sum(fitted, builder, value)
    count, precision = builder.width(scores), builder.precision(scores)
    if count != (len(labels) if len(labels) > 2 else 1):
        raise UnsupportedModelError(
            f"{fitted.kind} with {counted(count, 'score')} for "
            f"{counted(len(labels), 'class', 'classes')}: train one for each"
        )
    logistic = fitted.kind in ("LogisticRegression", "LogisticRegressionCV", "LinearDiscriminantAnalysis")
    logistic &= len(labels) > 1  # of one class predict_proba raises
    if logistic:
        fitted.refuse_old("multi_class", "ovr" if count > 1 else "multinomial")
    if logistic and count > 1:
        # each class was trained against the rest by liblinear, and where an old version tells the iterations of each
        each = "multi_class" in vars(fitted.estimator) and len(getattr(fitted.estimator, "n_iter_", ())) > 1
        fitted.refuse_old("solver", fitted.get("solver") if each else "liblinear")
    loss = fitted.estimator.loss if fitted.kind == "SGDClassifier" else ""
    probability = None
    if logistic and count > 1:
        probability = softmax(builder, scores, precision)
    elif logistic or loss == "log_loss":
        probability = builder.function(scores, "logistic", precision=precision)
    elif loss == "modified_huber":
        inside = builder.add(Clip((scores,), np.full(count, -1.0), np.full(count, 1.0)))
        probability = builder.chain(inside, ("+", 1.0), ("/", 2.0))
    if probability is not None and count == 1:
        probability = complement(builder, probability, precision)
    elif probability is not None and not logistic:
        probability = shares_of(builder, probability)
    return Classified(labels, (largest if count > 1 else above)(builder, scores), probability, scores)


@walks("RidgeClassifier RidgeClassifierCV", single=True)
def walk_ridge_classifier(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """As other linear classifiers; of several labels a row 1 for each above 0 (`linear_model/_ridge.py: predict`)."""
    if Fitted(fitted.get("_label_binarizer")).get("y_type_") == "multilabel-indicator":
        return above(builder, _weighted_sum(fitted, builder, value))
    return walk_linear_classifier(fitted, builder, value)


def _most_likely(fitted: Fitted, builder: GraphBuilder, scores: int) -> Classified:
    """The first of the largest log-likelihoods; probabilities are their exponentials, divided by the sum."""
    labels = labels_of(fitted)
    if builder.width(scores) != len(labels):
        raise fitted.fail("classes_", f"{counted(len(labels), 'label')}, {counted(builder.width(scores), 'score')}")
    return Classified(labels, largest(builder, scores), softmax(builder, scores))


def squares(builder: GraphBuilder, value: int) -> int:
    """The square of each column."""
    return builder.combine(value, "*", value)


def block_sums(builder: GraphBuilder, value: int, blocks: int, weight: float, bias: FloatArray) -> int:
    """`bias + weight * sum` of each of so many equal blocks of columns."""
    weights = np.kron(np.eye(blocks), np.full(builder.width(value) // blocks, weight))
    return builder.linear(value, weights, bias)


@walks("GaussianNB", finite=True, double="var_")
def walk_gaussian_bayes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """`naive_bayes.py: GaussianNB._joint_log_likelihood`, its constants computed as there."""
    width = builder.width(value)
    means = fitted.floats("theta_", (None, width))
    variances = fitted.floats("var_", means.shape)
    prior = fitted.floats("class_prior_", (len(means),))
    _refuse_unpredicted(fitted, prior == 0)
    if not variances.any():
        raise InputError(f"{fitted.kind}: all columns were constant in training, so that the library divides by 0")
    if np.any(variances <= 0) or np.any(prior < 0):
        raise fitted.fail("var_", "a variance that is not above 0, or a negative prior")
    value = builder.select(np.tile(np.arange(width), len(means)), value)
    value = squares(builder, builder.scale(value, "-", means.ravel()))
    value = builder.scale(value, "/", variances.ravel())
    constant = np.array([-0.5 * np.sum(np.log(2.0 * np.pi * row)) for row in variances])
    value = block_sums(builder, value, len(means), -0.5, constant)
    return _most_likely(fitted, builder, builder.scale(value, "+", np.log(prior)))


def _refuse_unpredicted(fitted: Fitted, never: BoolArray) -> None:
    """Classes whose prior is 0, as where all their training rows have a weight of 0."""
    if np.any(never):
        raise UnsupportedModelError(
            f"{fitted.kind}: class number {int(np.argmax(never))} has a prior of 0, so that it is never predicted: "
            "train without it"
        )


@walks("BernoulliNB MultinomialNB ComplementNB", finite=True)
def walk_discrete_bayes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """`naive_bayes.py: _joint_log_likelihood` of these classes, constants computed as there."""
    width = builder.width(value)
    weights = fitted.floats("feature_log_prob_", (None, width))
    constant = np.zeros(len(weights))
    if fitted.kind != "ComplementNB" or len(weights) == 1:
        _refuse_unpredicted(fitted, fitted.get("class_log_prior_") == -np.inf)
        constant = fitted.floats("class_log_prior_", (len(weights),))
    if fitted.kind == "BernoulliNB":
        if fitted.get("binarize") is not None:
            value = builder.add(Exceeds((value,), np.full(width, fitted.number("binarize"))))
        absent = np.log(1 - np.exp(weights))
        weights = weights - absent
        constant = constant + absent.sum(axis=1)
    total = builder.linear(value, weights)
    return _most_likely(fitted, builder, builder.scale(total, "+", constant))


@walks("CategoricalNB", finite=True)
def walk_categorical_bayes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Logarithms of shares, added feature by feature, then those of the classes (`naive_bayes.py: CategoricalNB`).

    The library cuts numbers to integers, so that all above -1 are the category 0; it raises for categories that the
    training did not have.
    """
    _refuse_unpredicted(fitted, fitted.get("class_log_prior_") == -np.inf)
    prior, parts = fitted.floats("class_log_prior_", (None,)), []
    for number, given in enumerate(fitted.items("feature_log_prob_", builder.width(value))):
        shares = fitted.floats_of(f"feature_log_prob_[{number}]", given, (len(prior), None))
        if not shares.size:
            raise fitted.fail(f"feature_log_prob_[{number}]", "no categories")
        knots = np.array([-1.0, *range(1, shares.shape[1] + 1)])
        columns = []
        for own in shares:
            between = np.array([math.inf, *own, math.inf])
            columns.append((knots, np.delete(between, 1), between[:, None], math.nan))
        parts.append(add_pieces(builder, builder.select(np.full(len(prior), number), value), columns))
    total = reduce(lambda one, other: builder.combine(one, "+", other), parts)
    return _most_likely(fitted, builder, builder.scale(total, "+", prior))


@walks("QuadraticDiscriminantAnalysis", finite=True, double="scalings_")
def walk_quadratic(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """`discriminant_analysis.py: QuadraticDiscriminantAnalysis._decision_function`, class by class."""
    width = builder.width(value)
    means = fitted.floats("means_", (None, width))
    count = len(means)
    rotations, scalings = fitted.items("rotations_", count), fitted.items("scalings_", count)
    parts, logarithms = [], []
    for number in range(count):
        scaling = fitted.floats_of(f"scalings_[{number}]", scalings[number], (None,))
        rotation = fitted.floats_of(f"rotations_[{number}]", rotations[number], (width, len(scaling)))
        if np.any(scaling <= 0):
            raise fitted.fail(f"scalings_[{number}]", "a variance that is not above 0")
        centred = builder.scale(value, "-", means[number])
        turned = builder.linear(centred, (rotation * scaling**-0.5).T)
        logarithms.append(np.sum(np.log(scaling)))
        parts.append(block_sums(builder, squares(builder, turned), 1, 1.0, np.zeros(1)))
    prior = np.log(fitted.floats("priors_", (count,)))
    scores = builder.chain(builder.beside(*parts), ("+", np.array(logarithms)), ("*", -0.5), ("+", prior))
    decision = scores
    if count == 2:
        decision = whole_sums(builder, scores, np.array([[-1.0, 1.0]]), np.zeros(1))
    return replace(_most_likely(fitted, builder, scores), decision=decision)


@walks("NearestCentroid", finite=True)
def walk_nearest_centroid(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The nearest centre by the distance, the first of equal ones (`pairwise_distances_argmin`)."""
    labels = labels_of(fitted)
    prior = fitted.floats("class_prior_", (len(labels),))
    manhattan = fitted.estimator.metric == "manhattan"
    if not (manhattan or fitted.estimator.metric == "euclidean") or not np.isclose(prior, 1 / len(labels)).all():
        raise UnsupportedModelError(
            f"NearestCentroid with metric={fitted.estimator.metric!r} and priors {prior[:3]}: supported are "
            "the metrics 'euclidean' and 'manhattan', and equal priors (priors='uniform')"
        )
    centres = fitted.floats("centroids_", (len(labels), builder.width(value)))
    if manhattan:
        distances = builder.add(Distances((value,), centres, squared=False))
        return Classified(labels, largest(builder, builder.scale(distances, "*", -1.0)))
    return Classified(labels, largest(builder, negative_square_distances(builder, value, centres)))


def negative_square_distances(builder: GraphBuilder, value: int, centres: FloatArray) -> int:
    """-|x - c|**2 for each centre c, as -x*x + 2*x*c - c*c: the library multiplies matrices so."""
    both = builder.beside(squares(builder, value), value)
    weights = np.hstack([-np.ones_like(centres), 2.0 * centres])
    return builder.linear(both, weights, -np.sum(centres**2, axis=1))
