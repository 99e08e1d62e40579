"""A fitted scikit-learn estimator as a model: its features, its provenance, its own predictions."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir import Feature, FloatArray, OutputKind, Source
from st_codegen.walkers.base import (
    LIBRARIES,
    Classified,
    Estimated,
    GraphBuilder,
    LoadedModel,
    Predictor,
    Walked,
    is_known,
    unsupported,
    walk_any,
)
from st_codegen.walkers.classes import numbers_of
from st_codegen.walkers.limits import MAX_COLUMNS
from st_codegen.walkers.sklearn.native import check_native, objects_in
from st_codegen.walkers.sklearn.overwritten import check_rows_are_kept


def load_object(estimator: Any, name: str) -> LoadedModel:
    """A fitted estimator of scikit-learn as a model, with the estimators of other libraries that it is composed of.

    What predicts nothing is compiled by its `transform`, with an output for each column. Raises UnsupportedModelError
    for classes without a walker, InputError for an estimator that is not fitted.
    """
    check_native(estimator)
    features = _features(estimator)
    builder = GraphBuilder(len(features))
    result = walk_any(estimator, builder, 0)
    check_rows_are_kept(estimator)
    if isinstance(result, Classified) and not hasattr(estimator, "decision_function"):
        result = replace(result, decision=None)  # XGBClassifier has margins, a Pipeline that ends in it has none
    if isinstance(result, Estimated) and not hasattr(_last(estimator), "L_"):  # whose predict takes no return_std
        result = result.mean
    if isinstance(result, int) and type(_last(estimator)).__name__ in ("PCA", "IncrementalPCA"):
        kinds = (OutputKind.COLUMN, OutputKind.RECONSTRUCTION)
        result = Estimated(result, builder.on_demand[result], kinds)
    notes: tuple[str, ...] = ()
    if not hasattr(estimator, "predict"):
        builder.refuse_nan(len(builder.ops))  # the library hands NaN on, and the block has no output for it
        notes = ("computes transform; a row with NaN is not valid",)
    if _one_job(estimator):
        # a forest adds its trees in the order in which its jobs finish: two calls differ in their last bits
        notes += ("as the library predicts with n_jobs=1; with more, its own last bits may vary from call to call",)
    source = Source(LIBRARIES["sklearn"], _version(estimator), _description(estimator), notes=notes)
    return LoadedModel(builder.model(name, features, source, result), _predictor(estimator, result))


def _last(estimator: Any) -> Any:
    """What predicts at the end of a Pipeline, or the estimator itself."""
    return _last(estimator.steps[-1][1]) if hasattr(estimator, "steps") else estimator


def _version(estimator: Any) -> str:
    """The version that trained the model where the object tells, else the installed one."""
    trained = getattr(estimator, "__dict__", {}).get("_sklearn_version")
    return str(trained or importlib.import_module("sklearn").__version__)


def _parts(estimator: Any) -> Iterator[tuple[str, Any]]:
    """The estimators inside a composition."""
    if hasattr(estimator, "steps"):
        yield from estimator.steps
    elif hasattr(estimator, "transformer_list"):
        yield from estimator.transformer_list
    elif hasattr(estimator, "transformers_"):
        yield from ((name, part) for name, part, _ in estimator.transformers_)
    elif hasattr(estimator, "regressor_"):
        yield from (("regressor", estimator.regressor_), ("transformer", estimator.transformer_))


def _description(estimator: Any) -> str:
    """The class, and for compositions what they are made of."""
    parts = [_description(part) for _, part in _parts(estimator) if part is not None and not isinstance(part, str)]
    return type(estimator).__name__ + (f"({', '.join(parts)})" if parts else "")


def _features(estimator: Any) -> tuple[Feature, ...]:
    """Feature names where the model knows them, else f0, f1, .."""
    count = _first(estimator, "n_features_in_")
    if count is None and hasattr(estimator, "X_thresholds_"):  # IsotonicRegression takes one column and does not say so
        count = 1
    if count is None and isinstance(weights := getattr(estimator, "__dict__", {}).get("coef_"), np.ndarray):
        count = np.atleast_1d(weights).shape[-1]  # nor does ElasticNet after fit(.., check_input=False)
    if count is None:
        name = type(estimator).__name__
        for part in objects_in(estimator):  # a class of the user's own need not say it
            package, kind = type(part).__module__.partition(".")[0], type(part).__name__
            works = not isinstance(part, type) and (hasattr(part, "predict") or hasattr(part, "transform"))
            if (works and package not in LIBRARIES) or (part is estimator and not is_known(package, kind)):
                raise unsupported(package, kind)
        if not _is_fitted(estimator):
            raise InputError(f"{name} is not fitted: call fit() before saving it")
        kernel = ", with a kernel of sklearn that reads the inputs" if hasattr(estimator, "kernel") else ""
        raise InputError(f"{name} does not say how many features it takes: fit it on an array of numbers{kernel}")
    if not isinstance(count, int | np.integer) or not 1 <= count <= MAX_COLUMNS:
        raise InputError(f"{type(estimator).__name__}.n_features_in_: {str(count)[:40]}, expected 1 .. {MAX_COLUMNS}")
    names = _first(estimator, "feature_names_in_")
    if names is None:
        return tuple(Feature(f"f{number}") for number in range(int(count)))
    if not isinstance(names, np.ndarray) or names.shape != (count,) or not all(isinstance(n, str) for n in names):
        raise InputError(f"{type(estimator).__name__}.feature_names_in_: not {counted(int(count), 'text')}")
    return tuple(Feature(str(name)) for name in names)


def _is_fitted(estimator: Any) -> bool:
    from sklearn.exceptions import NotFittedError
    from sklearn.utils.validation import check_is_fitted

    try:
        check_is_fitted(estimator)
    except NotFittedError:
        return False
    return True


def _first(estimator: Any, attribute: str) -> Any:
    """An attribute of an estimator, or of the first part of a composition that has it."""
    try:
        found = getattr(estimator, attribute, None)
    except Exception:  # a property of an unfitted estimator may raise anything
        found = None
    if found is not None:
        return found
    for _, part in _parts(estimator):
        found = _first(part, attribute)
        if found is not None:
            return found
    return None


def _predictor(estimator: Any, result: Walked) -> Predictor:
    """The library's own answers, single-threaded: the order in which a forest adds its trees is fixed only then.

    That is `predict`, whose labels become their numbers, and of a classifier its probabilities and scores beside it;
    of a scaler or another preparation that stands alone it is `transform`.
    """
    names = _first(estimator, "feature_names_in_")
    compute = estimator.predict if hasattr(estimator, "predict") else estimator.transform

    def answer(method: Callable[..., Any], x: FloatArray, **options: bool) -> Any:
        # each call has rows of its own: a step with copy=False writes into those that it is given
        return method(_with_names(x.copy(), names), **options)

    def predict(x: FloatArray) -> FloatArray:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if isinstance(result, Estimated) and OutputKind.RECONSTRUCTION in result.kinds:
                return _reconstructed(estimator, _with_names(x.copy(), names))
            if isinstance(result, Estimated) and result.on_demand is not None:
                return np.hstack([np.reshape(part, (len(x), -1)) for part in answer(compute, x, return_std=True)])
            found = answer(compute, x)
            if not isinstance(result, Classified):
                dense = found.toarray() if hasattr(found, "toarray") else found
                return np.asarray(dense, np.float64).reshape(len(x), -1)
            parts = [numbers_of(result.labels, found)]
            if result.probability is not None:
                parts.append(np.asarray(answer(estimator.predict_proba, x), np.float64))
            if result.decision is not None:
                parts.append(np.asarray(answer(estimator.decision_function, x), np.float64).reshape(len(x), -1))
            return np.hstack(parts)

    return predict


def _reconstructed(estimator: Any, rows: Any) -> FloatArray:
    """The columns of a PCA, alone or at the end of a Pipeline, and how far what it read lies from them, squared."""
    while hasattr(estimator, "steps"):
        rows = estimator[:-1].transform(rows) if len(estimator.steps) > 1 else rows
        estimator = estimator.steps[-1][1]
    columns = estimator.transform(rows)
    missed = np.asarray(rows, np.float64) - estimator.inverse_transform(columns)
    return np.column_stack([columns, (missed * missed).sum(axis=1)])


def _one_job(estimator: Any) -> bool:
    """Let an estimator, and whatever predicts inside it, run one job; whether any ran several.

    `set_params` reaches the templates of a composition, not the fitted copies, and neither inside FrozenEstimator.
    """
    several = False
    for part in objects_in(estimator):
        own = vars(part) if hasattr(part, "__dict__") and not isinstance(part, type) else {}
        if "n_jobs" in own:
            several |= own["n_jobs"] not in (None, 1)
            part.n_jobs = 1
    return several


def _with_names(x: FloatArray, names: Any) -> Any:
    """Rows as a data frame where the model was fitted on one and pandas is there: it may select columns by name."""
    if names is None:
        return x
    try:
        import pandas
    except ImportError:
        return x
    return pandas.DataFrame(x, columns=list(names))
