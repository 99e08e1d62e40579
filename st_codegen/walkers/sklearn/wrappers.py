"""Walkers for scikit-learn's estimators that predict as one other does, and for those that predict constants."""

from __future__ import annotations

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Clip, FillMissing, FloatArray
from st_codegen.walkers.base import (
    Classified,
    GraphBuilder,
    Walked,
    transforms,
    walk_any,
    walk_classifier,
    walk_transform,
    walks,
)
from st_codegen.walkers.classes import above, label_of, labels_of
from st_codegen.walkers.fitted import Fitted

_FROZEN = ("sklearn.frozen._frozen.FrozenEstimator",)


@walks("FrozenEstimator", trusts=_FROZEN, single=True)
def walk_frozen(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The estimator that is not fitted again (`frozen/_frozen.py`)."""
    return walk_any(fitted.get("estimator"), builder, value)


@transforms("FrozenEstimator", single=True)
def walk_frozen_preparation(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The preparation that is not fitted again."""
    return walk_transform(fitted.get("estimator"), builder, value)


@walks("SelfTrainingClassifier", single=True)
def walk_self_training(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The classifier that was fitted on its own labels last (`semi_supervised/_self_training.py: predict`)."""
    return walk_classifier(fitted.get("estimator_"), builder, value)


@walks(
    "FixedThresholdClassifier TunedThresholdClassifierCV",
    trusts=(
        "sklearn.metrics._scorer._CurveScorer",
        "sklearn.utils._metadata_requests.MetadataRequest",
        "sklearn.utils._metadata_requests.MethodMetadataRequest",
    ),
    single=True,
)
def walk_threshold(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The positive label from a threshold of its score on (`model_selection/_classification_threshold.py: predict`)."""
    labels = labels_of(fitted)
    inner = getattr(fitted.estimator, "estimator_", fitted.get("estimator"))
    one = walk_classifier(inner, builder, value)
    if len(labels) != 2 or one.labels[:2] != labels:  # a label for outliers is never the answer
        raise fitted.fail("classes_", "not the two labels of its estimator")
    tuned = fitted.kind == "TunedThresholdClassifierCV"
    positive = label_of(fitted.get("_curve_scorer")._get_pos_label() if tuned else fitted.get("pos_label"))
    if positive is not None and positive not in labels:
        raise UnsupportedModelError(f"{fitted.kind} with pos_label={positive!r}, which is none of its labels")
    place = 1 if positive is None else labels.index(positive)
    method = fitted.get("response_method")
    if method == "auto":
        method = "predict_proba" if hasattr(inner, "predict_proba") else "decision_function"
    score = {"predict_proba": one.probability, "decision_function": one.decision}.get(method)
    if score is None:
        raise UnsupportedModelError(f"{fitted.kind} by the {method} of {type(inner).__name__}")
    if method == "predict_proba":
        score = builder.select([place], score)
    elif place == 0:
        score = builder.scale(score, "*", -1.0, precision=builder.precision(score))
    given = fitted.get("best_threshold_" if tuned else "threshold")
    cut = float(method == "predict_proba") / 2.0
    if given != "auto":
        cut = float(fitted.floats_of("threshold", given, ()))
        if builder.is_single(score) and not isinstance(given, np.generic):  # NumPy then compares in float32
            cut = float(np.float32(cut))
    reached = above(builder, score, cut, inclusive=True)
    index = reached if place else builder.scale(reached, "-", 1.0, reverse=True)
    return Classified(labels, index, one.probability, one.decision)


def constants(builder: GraphBuilder, value: int, numbers: FloatArray) -> int:
    """Numbers that hang on no input, and on no missing one."""
    first = builder.select(np.zeros(len(numbers), np.int32), value)
    return builder.add(Clip((builder.add(FillMissing((first,), numbers)),), numbers, numbers))


@walks("DummyRegressor", single=True)
def walk_constant(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean, the median or another number of the training data (`dummy.py: DummyRegressor.predict`)."""
    return constants(builder, value, fitted.floats("constant_", (1, None))[0])


@walks("DummyClassifier", single=True)
def walk_constant_class(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The most frequent label or a given one (`dummy.py: DummyClassifier.predict, predict_proba`)."""
    labels, strategy = labels_of(fitted), fitted.get("_strategy")
    prior = fitted.floats("class_prior_", (len(labels),))
    if strategy not in ("most_frequent", "prior", "constant"):
        raise UnsupportedModelError(f"DummyClassifier with strategy={strategy!r}, which draws its answers at random")
    chosen = int(np.argmax(prior))
    if strategy == "constant":
        chosen = labels.index(label_of(np.ravel(fitted.get("constant"))[0]))
    shares = prior if strategy == "prior" else np.eye(len(labels))[chosen]
    index = constants(builder, value, np.array([float(chosen)]))
    return Classified(labels, index, constants(builder, value, shares))
