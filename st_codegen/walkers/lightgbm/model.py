"""LightGBM: text model files, LGBMRegressor, LGBMClassifier, LGBMRanker and Booster objects.

Rules of prediction, from LightGBM 4.7: the row buffer (`RowPairFunctionFromDenseMatrix`, src/c_api.cpp) drops numbers
of magnitude `kZeroThreshold` or less, so that trees see 0; comparison and missing types (`Tree::NumericalDecision`,
`CategoricalDecision`, `Tree::Predict`, include/LightGBM/tree.h); sums in tree order, the average of random forests and
the objective's output function (`GBDT::Predict`, src/boosting/gbdt_prediction.cpp). All in float64; equal bits need a
build that does not fuse multiplication and addition, as the x86-64 wheels are (only linear leaves multiply).
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted, errors_name, extra_package
from st_codegen.ir import Feature, FloatArray, Function, Label, NanRule, Precision, Source, TreeColumn, TreeEnsemble
from st_codegen.walkers.base import (
    BoosterPredictor,
    Classified,
    GraphBuilder,
    LoadedModel,
    Predictor,
    Walked,
    booster_of,
    walks,
)
from st_codegen.walkers.classes import (
    above,
    complement,
    labels_of,
    largest,
    last_below,
    most_probable,
    numbers_of,
    softmax,
    trained_on_one,
)
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.forest import category_note, flatten
from st_codegen.walkers.lightgbm.text import READ_CATEGORY, READ_NAN_MISSING, READ_ZERO_MISSING, TextModel, parse

#: `kZeroThreshold`: 1e-35 rounded to float32.
ZERO_MAGNITUDE = float(np.float32(1e-35))

#: What `ConvertOutput` of an objective does to the sum of the trees.
_LINKS = {
    **dict.fromkeys(
        (
            *("regression", "regression_l2", "regression_l1", "huber", "fair", "quantile", "mape", "custom"),
            *("lambdarank", "rank_xendcg"),
        ),
        Function.IDENTITY,
    ),
    **dict.fromkeys(("poisson", "gamma", "tweedie"), Function.EXP),
    **dict.fromkeys(("cross_entropy", "xentropy"), Function.LOGISTIC),
    **dict.fromkeys(("cross_entropy_lambda", "xentlambda"), Function.SOFTPLUS),
}

#: Objectives of classes; LGBMClassifier takes cross_entropy as one too.
_BINARY, _SOFTMAX, _ONE_AGAINST_REST = "binary", "multiclass", "multiclassova"
_SEVERAL = (_SOFTMAX, _ONE_AGAINST_REST)

#: All objectives; `custom` is what a file without one has.
OBJECTIVES = tuple(sorted([*_LINKS, _BINARY, *_SEVERAL]))

#: Objectives whose word "sqrt" (reg_sqrt=True) squares the output; the others ignore it.
_SQUARED = frozenset({"regression", "regression_l2", "regression_l1", "fair", "quantile", "mape"})


def load_file(path: Path, name: str) -> LoadedModel:
    """Read a LightGBM text model. `predict` of the result needs the package lightgbm; reading does not.

    Raises InputError for a file that is no such model or is damaged, UnsupportedModelError for an unknown objective.
    """
    with errors_name(path.name):
        try:
            with path.open("rb") as stream:
                model = parse(stream)
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}") from None
        return _loaded(model, name, lambda: _load_booster(path))


def load_object(estimator: Any, name: str) -> LoadedModel:
    """A fitted LGBMRegressor or Booster as a model of its own, up to its best iteration; errors as in `load_file`."""
    with errors_name(type(estimator).__name__):
        booster = _booster(estimator)
        labels = _labels(estimator)
        return _loaded(_model_of(booster), name, lambda: booster, labels, estimator if labels else None)


@walks(
    "lightgbm.LGBMRegressor",
    "lightgbm.LGBMClassifier",
    "lightgbm.LGBMRanker",
    "lightgbm.Booster",
    trusts=(
        "collections.OrderedDict",
        f"{__name__}.LightgbmBooster",
        "lightgbm.sklearn.LGBMClassifier",
        "lightgbm.sklearn.LGBMRanker",
        "lightgbm.sklearn.LGBMRegressor",
    ),
    single=True,
)
def walk(estimator: Any, builder: GraphBuilder, value: int) -> Walked:
    """Add a fitted estimator or Booster, up to its best iteration, as `predict` uses it."""
    with errors_name(type(estimator).__name__):
        return _add(_model_of(_booster(estimator)), builder, value, _labels(estimator))


def _labels(estimator: Any) -> tuple[Label, ...]:
    """The labels of a fitted LGBMClassifier; empty for what is none."""
    return labels_of(Fitted(estimator)) if type(estimator).__name__ == "LGBMClassifier" else ()


class LightgbmBooster:
    """A Booster in a `.skops` file: LightGBM reads its text after our reader has taken it, and not before."""

    def __setstate__(self, state: Any) -> None:
        """Become the library's Booster. Raises InputError for a text that our reader refuses."""
        with errors_name("Booster"):
            text = state.get("_handle", state.get("handle")) if isinstance(state, dict) else None
            if not isinstance(text, str):
                raise InputError("no model text; it was saved before training, or is damaged")
            model = parse(io.BytesIO(text.encode()))
            best = state.get("best_iteration", -1)
            if type(best) is not int or not -1 <= best <= len(model.trees) // model.n_outputs:
                raise InputError(f"best_iteration: {str(best)[:40]}, expected a number of iterations of the model")
            lightgbm = extra_package("lightgbm", "lightgbm", "a model of LightGBM in a .skops file")
            self.__class__ = lightgbm.Booster
            _load(lambda: lightgbm.Booster.__init__(self, model_str=text))
        self.__dict__["best_iteration"] = best


def _booster(estimator: Any) -> Any:
    """The booster of an estimator, or a booster itself. Raises UnsupportedModelError where trees may be left out."""
    given = estimator.get_params().get("pred_early_stop") if hasattr(estimator, "get_params") else None
    if given not in (None, False, 0, "false", "False", "-"):
        raise UnsupportedModelError(
            "pred_early_stop=True, with which classifiers and rankers leave trees out once a row seems decided, and "
            "all trees may answer otherwise: set_params(pred_early_stop=False), and save it again"
        )
    return booster_of(estimator, attrgetter("booster_"))


def _model_of(booster: Any) -> TextModel:
    return parse(io.BytesIO(booster.model_to_string().encode()))


def _loaded(
    model: TextModel,
    name: str,
    load_booster: Callable[[], Any],
    labels: tuple[Label, ...] = (),
    classifier: Any | None = None,
) -> LoadedModel:
    builder = GraphBuilder(model.n_features)
    result = _add(model, builder, 0, labels)
    features = tuple(
        Feature(feature, seen=_seen(info))
        for feature, info in zip(model.feature_names, model.feature_infos, strict=True)
    )
    predict: Predictor = _LightgbmPredictor(load_booster, model.n_outputs)
    if isinstance(result, Classified):
        predict = _ClassPredictor(load_booster, model.n_outputs, result, classifier)
    return LoadedModel(builder.model(name, features, _source(model), result), predict)


def _seen(info: str) -> tuple[float, float] | None:
    """What a word of feature_infos says that the training data reach: [lowest:highest] for numbers that were used.

    Of the rows that LightGBM drew to make its bins (`bin_construct_sample_cnt`, 200,000): others may reach further.
    Magnitudes below 1e-35 stand as 0 there, and with use_missing=false missing numbers too; with `reference=`, the
    range is that of the other data set (`BinMapper::FindBin`).
    """
    low, _, high = info.strip("[]").partition(":")
    try:
        found = float(low), float(high)
    except ValueError:
        return None
    is_range = info.startswith("[") and all(map(math.isfinite, found)) and found[0] <= found[1]
    return found if is_range else None


def _load_booster(path: Path) -> Any:
    lightgbm = extra_package("lightgbm", "lightgbm", f"the prediction of {path.name} by LightGBM")
    with errors_name(path.name):
        return _load(lambda: lightgbm.Booster(model_file=str(path)))


def _load(make: Callable[[], Any]) -> Any:
    """What LightGBM makes of a model; InputError with its reason where it refuses."""
    import lightgbm

    try:
        # it prints which parameters of older files it does not know; they play no part in prediction
        with contextlib.redirect_stdout(io.StringIO()):
            return make()
    except (lightgbm.basic.LightGBMError, OSError, ValueError, TypeError) as error:
        raise InputError(f"LightGBM cannot load it: {error}") from None


class _LightgbmPredictor(BoosterPredictor):
    """LightGBM's own prediction."""

    def numbers(self, rows: FloatArray, *, raw: bool = False) -> FloatArray:
        found = self.booster.predict(rows, raw_score=raw, num_threads=1)
        return np.asarray(found, np.float64).reshape(len(rows), self.n_outputs)


class _ClassPredictor(_LightgbmPredictor):
    """Number of the class, probabilities and scores.

    The class is that of LGBMClassifier where there is one; of a booster, which knows no classes, by the same rule: the
    first of the largest probabilities (`LGBMClassifier.predict`).
    """

    def __init__(
        self, load_booster: Callable[[], Any], n_outputs: int, result: Classified, classifier: Any | None
    ) -> None:
        super().__init__(load_booster, n_outputs)
        self.labels, self.classifier = result.labels, classifier
        self.has_decision = result.decision is not None

    def __call__(self, x: FloatArray) -> FloatArray:
        """Rows (rows, features) -> (rows, 1 + classes + scores)."""
        if len(x) == 0:
            return np.zeros((0, 1 + len(self.labels) + self.n_outputs * self.has_decision))
        rows = np.ascontiguousarray(x, np.float64)
        probability = self.numbers(rows)
        if self.n_outputs == 1:
            probability = np.hstack([1.0 - probability, probability])
        if self.classifier is None:
            number = np.argmax(probability, axis=1)[:, None].astype(np.float64)
        else:
            number = numbers_of(self.labels, self.classifier.predict(rows, num_threads=1))
        return np.hstack([number, probability, *([self.numbers(rows, raw=True)] if self.has_decision else [])])


def _source(model: TextModel) -> Source:
    notes = ["predicts as Booster.predict"]
    if not model.objective or model.objective[0] == "custom":
        notes.append("custom objective: the output is the raw sum of the trees")
    if any(tree.linear is not None for tree in model.trees):
        notes.append("linear models in the leaves")
    # feature_infos has [lowest:highest] for numbers and 0:1:2 for categories
    categorical = [
        feature
        for feature, info in zip(model.feature_names, model.feature_infos, strict=True)
        if info != "none" and not info.startswith("[")
    ]
    if len(categorical) == len(model.categories):
        notes += [category_note(feature, names) for feature, names in zip(categorical, model.categories, strict=True)]
    return Source(
        library="LightGBM",
        version=f"text format {model.version}",
        model_class=f"LightGBM text model ({model.boosting})",
        notes=tuple(notes),
    )


def _add(model: TextModel, builder: GraphBuilder, value: int, labels: tuple[Label, ...] = ()) -> Walked:
    """Add the ensemble and what the objective makes of its sums.

    `labels` are those of an LGBMClassifier; a booster of classes numbers them 0, 1, ..
    """
    if builder.width(value) != model.n_features:
        raise InputError(
            f"the model has {counted(model.n_features, 'feature')}, its input {counted(builder.width(value), 'column')}"
        )
    objective, *_ = model.objective or ("custom",)
    is_class = objective in (_BINARY, _SOFTMAX, _ONE_AGAINST_REST) or (labels and objective != "custom")
    link = Function.IDENTITY if is_class else _link(model)
    iterations = len(model.trees) // model.n_outputs
    ensemble = flatten(
        model.trees,
        value,
        _column,
        members_left=True,
        zero=ZERO_MAGNITUDE,
        base=np.zeros(model.n_outputs),
        tree_output=np.tile(np.arange(model.n_outputs, dtype=np.int32), iterations),
        divisor=float(iterations) if model.average_output else 1.0,
    )
    result = builder.add(_with_zero_band(ensemble, sparse=builder.is_sparse(value)))
    if is_class:
        return _classified(model, builder, result, labels)
    if link is Function.SOFTPLUS and ensemble.linear is not None:
        # log1p(exp(x)) in two steps, of which the first has no end: leaves that are lines may be as large as the inputs
        return builder.function(builder.function(result, Function.EXP), Function.LOG1P)
    if link is not Function.IDENTITY:
        result = builder.function(result, link)
    return result


def _classified(model: TextModel, builder: GraphBuilder, raw: int, labels: tuple[Label, ...]) -> Classified:
    """Probabilities by `ConvertOutput` of the objective, and the number of the largest (`LGBMClassifier.predict`)."""
    objective = model.objective[0]
    count = max(model.n_outputs, 2)
    if len(labels) == 1:
        raise UnsupportedModelError(trained_on_one(labels))
    labels = labels or tuple(range(count))
    of_one = objective in (_BINARY, "cross_entropy", "xentropy")
    if len(labels) != count or of_one != (model.n_outputs == 1) or not (of_one or objective in _SEVERAL):
        raise UnsupportedModelError(
            f"objective '{' '.join(model.objective)}' with {counted(model.n_outputs, 'tree')} an iteration for "
            f"{counted(len(labels), 'class', 'classes')}"
        )
    decision = None if model.average_output else raw  # the raw scores of a random forest are the sums, not the mean
    if objective == _SOFTMAX:
        return Classified(labels, most_probable(builder, raw, Precision.FLOAT64), softmax(builder, raw), decision)
    slope = _sigmoid(model)
    score = builder.scale(raw, "*", slope) if slope != 1.0 else raw
    probability = builder.function(score, "logistic")
    if model.n_outputs > 1:
        return Classified(labels, largest(builder, probability), probability, decision)

    def is_second(x: Any) -> bool:
        p = 1.0 / (1.0 + math.exp(-slope * float(x)))
        return p > 1.0 - p

    cut = last_below(is_second, np.float64)
    return Classified(labels, above(builder, raw, cut), complement(builder, probability), decision)


def _sigmoid(model: TextModel) -> float:
    """The factor in the exponent of the sigmoid."""
    words = [word.partition(":")[2] for word in model.objective[1:] if word.startswith("sigmoid:")]
    try:
        slope = float(words[0]) if words else 1.0
    except ValueError:
        slope = math.nan
    if not 1e-6 <= slope <= 1e6:
        raise InputError(f"objective: '{' '.join(model.objective)[:60]}', expected a sigmoid of 1e-6 .. 1e6")
    return slope


def _link(model: TextModel) -> Function:
    """The output function of the objective, or UnsupportedModelError."""
    objective, *words = model.objective or ("custom",)
    if objective not in _LINKS:
        raise UnsupportedModelError(
            f"objective '{' '.join(model.objective)}' is not known; supported: {', '.join(OBJECTIVES)}"
        )
    if model.n_outputs > 1 and objective != "custom":
        raise UnsupportedModelError(f"objective '{objective}' with {counted(model.n_outputs, 'tree')} an iteration")
    if "sqrt" in words and objective in _SQUARED:
        return Function.SIGNED_SQUARE
    return _LINKS[objective]


def _column(feature: int, reading: int, n_categories: int) -> TreeColumn:
    if reading == READ_CATEGORY:
        return TreeColumn(feature, n_categories=n_categories, negative_fraction_is_zero=True)
    if reading == READ_NAN_MISSING:
        return TreeColumn(feature, seen_missing=True)
    missing = (-ZERO_MAGNITUDE, ZERO_MAGNITUDE) if reading == READ_ZERO_MISSING else None
    return TreeColumn(feature, nan=NanRule.ZERO, missing_interval=missing)


def _with_zero_band(flat: TreeEnsemble, *, sparse: bool) -> TreeEnsemble:
    """Thresholds that do to x what the file's do to x with the band of zero taken out.

    For |x| <= z the library compares 0 <= t. With t in [-z, 0) that is false, so t moves just below -z; with t in
    [0, z] it is true, so t moves up to z. Outside the band the answer is that of x itself. In a `sparse` matrix -z
    itself lies outside of it.
    """
    numeric = ~np.array([column.categorical for column in flat.columns] or [False])[flat.split] & (flat.split >= 0)
    t = flat.threshold
    below = numeric & (t >= -ZERO_MAGNITUDE) & (t < 0)
    above = numeric & (t >= 0) & (t <= ZERO_MAGNITUDE)
    lowest = -ZERO_MAGNITUDE if sparse else np.nextafter(-ZERO_MAGNITUDE, -np.inf)
    moved = np.where(below, lowest, np.where(above, ZERO_MAGNITUDE, t))
    return replace(flat, threshold=moved)
