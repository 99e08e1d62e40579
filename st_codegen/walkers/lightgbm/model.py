"""LightGBM: text model files, LGBMRegressor and Booster objects.

Rules of prediction, from LightGBM 4.7: the row buffer (`RowPairFunctionFromDenseMatrix`, src/c_api.cpp) drops numbers
of magnitude `kZeroThreshold` or less, so that trees see 0; comparison and missing types (`Tree::NumericalDecision`,
`CategoricalDecision`, `Tree::Predict`, include/LightGBM/tree.h); sums in tree order, the average of random forests and
the objective's output function (`GBDT::Predict`, src/boosting/gbdt_prediction.cpp). All in float64; equal bits need a
build that does not fuse multiplication and addition, as the x86-64 wheels are (only linear leaves multiply).
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, MissingExtraError, UnsupportedModelError, errors_name
from st_codegen.ir import (
    Activation,
    Comparison,
    Feature,
    FloatArray,
    Function,
    NanRule,
    Precision,
    Source,
    TreeColumn,
)
from st_codegen.walkers.base import GraphBuilder, LoadedModel, walks
from st_codegen.walkers.forest import FlatForest, category_note, flatten
from st_codegen.walkers.lightgbm.text import READ_CATEGORY, READ_NAN_MISSING, READ_ZERO_MISSING, TextModel, parse

#: `kZeroThreshold`: 1e-35 rounded to float32.
ZERO_MAGNITUDE = float(np.float32(1e-35))

#: What `ConvertOutput` of an objective does to the sum of the trees.
_LINKS: dict[str, Function] = {
    "regression": Function.IDENTITY,
    "regression_l2": Function.IDENTITY,
    "regression_l1": Function.IDENTITY,
    "huber": Function.IDENTITY,
    "fair": Function.IDENTITY,
    "quantile": Function.IDENTITY,
    "mape": Function.IDENTITY,
    "custom": Function.IDENTITY,
    "poisson": Function.EXP,
    "gamma": Function.EXP,
    "tweedie": Function.EXP,
    "cross_entropy": Function.LOGISTIC,
    "xentropy": Function.LOGISTIC,
}

#: Objectives whose word "sqrt" (reg_sqrt=True) squares the output; the others ignore it.
_SQUARED = frozenset({"regression", "regression_l2", "regression_l1", "fair", "quantile", "mape"})


def load_file(path: Path, name: str) -> LoadedModel:
    """Read a LightGBM text model. `predict` of the result needs the package lightgbm; reading does not.

    Raises InputError for a file that is no such model or is damaged, UnsupportedModelError for a classifier or ranker.
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
        return _loaded(_model_of(booster), name, lambda: booster)


@walks(
    "lightgbm.LGBMRegressor",
    "lightgbm.Booster",
    trusts=("collections.OrderedDict", f"{__name__}.LightgbmBooster", "lightgbm.sklearn.LGBMRegressor"),
)
def walk(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Add a fitted LGBMRegressor or Booster, up to its best iteration, as `predict` uses it."""
    with errors_name(type(estimator).__name__):
        return _add(_model_of(_booster(estimator)), builder, value)


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
            lightgbm = _library("a model of LightGBM in a .skops file")
            self.__class__ = lightgbm.Booster
            _load(lambda: lightgbm.Booster.__init__(self, model_str=text))
        self.__dict__["best_iteration"] = best


def features_of(estimator: Any) -> tuple[str, ...] | None:
    """Feature names of a fitted LGBMRegressor or Booster (LightGBM names unnamed ones Column_0, Column_1, ..)."""
    return tuple(_booster(estimator).feature_name())


def _booster(estimator: Any) -> Any:
    if type(estimator).__name__ == "Booster":
        return estimator
    if not estimator.__sklearn_is_fitted__():
        raise InputError("not fitted: call fit() before saving it")
    booster = estimator.booster_
    if type(booster).__name__ != "Booster":
        raise InputError("the fitted Booster is missing; the file is damaged")
    return booster


def _model_of(booster: Any) -> TextModel:
    return parse(io.BytesIO(booster.model_to_string().encode()))


def _loaded(model: TextModel, name: str, load_booster: Callable[[], Any]) -> LoadedModel:
    builder = GraphBuilder(model.n_features)
    _add(model, builder, 0)
    features = tuple(Feature(feature) for feature in model.feature_names)
    return LoadedModel(builder.model(name, features, _source(model)), _LightgbmPredictor(load_booster, model.n_outputs))


def _load_booster(path: Path) -> Any:
    lightgbm = _library(f"the prediction of {path.name} by LightGBM")
    with errors_name(path.name):
        return _load(lambda: lightgbm.Booster(model_file=str(path)))


def _library(purpose: str) -> Any:
    try:
        import lightgbm
    except ImportError:
        raise MissingExtraError("lightgbm", "lightgbm", purpose) from None
    return lightgbm


def _load(make: Callable[[], Any]) -> Any:
    """What LightGBM makes of a model; InputError with its reason where it refuses."""
    import lightgbm

    try:
        # it prints which parameters of older files it does not know; they play no part in prediction
        with contextlib.redirect_stdout(io.StringIO()):
            return make()
    except (lightgbm.basic.LightGBMError, OSError, ValueError, TypeError) as error:
        raise InputError(f"LightGBM cannot load it: {error}") from None


class _LightgbmPredictor:
    """LightGBM's own prediction; a file is loaded at the first call."""

    def __init__(self, load_booster: Callable[[], Any], n_outputs: int) -> None:
        self.load_booster = load_booster
        self.n_outputs = n_outputs

    @cached_property
    def booster(self) -> Any:
        return self.load_booster()

    def __call__(self, x: FloatArray) -> FloatArray:
        """Rows (rows, features) -> (rows, outputs)."""
        if len(x) == 0:
            return np.zeros((0, self.n_outputs))
        rows = np.ascontiguousarray(x, np.float64)
        return np.asarray(self.booster.predict(rows, num_threads=1), np.float64).reshape(len(rows), self.n_outputs)


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


def _add(model: TextModel, builder: GraphBuilder, value: int) -> int:
    """Add the ensemble and the objective's output function; returns the value of the predictions."""
    if builder.width(value) != model.n_features:
        raise InputError(f"the model has {model.n_features} features, its input {builder.width(value)} columns")
    link = _link(model)
    flat = flatten(model.trees, _column, members_left=True, zero=ZERO_MAGNITUDE)
    iterations = len(model.trees) // model.n_outputs
    result = builder.add(
        _with_zero_band(flat).ensemble(
            (value,),
            base=np.zeros(model.n_outputs),
            tree_output=np.tile(np.arange(model.n_outputs, dtype=np.int32), iterations),
            comparison=Comparison.LESS_OR_EQUAL,
            precision=Precision.FLOAT64,
            divisor=float(iterations) if model.average_output else 1.0,
        )
    )
    if link is not Function.IDENTITY:
        result = builder.add(Activation((result,), link, model.n_outputs))
    return result


def _link(model: TextModel) -> Function:
    """The output function of the objective, or UnsupportedModelError."""
    objective, *words = model.objective or ("custom",)
    if objective not in _LINKS:
        raise UnsupportedModelError(
            f"objective '{' '.join(model.objective)}' is not a regression; supported: {', '.join(sorted(_LINKS))}"
        )
    if model.n_outputs > 1 and objective != "custom":
        raise UnsupportedModelError(f"objective '{objective}' with {model.n_outputs} trees an iteration")
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


def _with_zero_band(flat: FlatForest) -> FlatForest:
    """Thresholds that do to x what the file's do to x with the band of zero taken out.

    For |x| <= z the library compares 0 <= t. With t in [-z, 0) that is false, so t moves just below -z; with t in
    [0, z] it is true, so t moves up to z. Outside the band the answer is that of x itself.
    """
    numeric = ~np.array([column.categorical for column in flat.columns] or [False])[flat.split] & (flat.split >= 0)
    t = flat.threshold
    below = numeric & (t >= -ZERO_MAGNITUDE) & (t < 0)
    above = numeric & (t >= 0) & (t <= ZERO_MAGNITUDE)
    moved = np.where(below, np.nextafter(-ZERO_MAGNITUDE, -np.inf), np.where(above, ZERO_MAGNITUDE, t))
    return replace(flat, threshold=moved)
