"""Estimators in files: `.skops`, and pickles where the user trusts them."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, MissingExtraError, UnsupportedModelError, UntrustedFileError
from st_codegen.ir import Feature, FloatArray, Source
from st_codegen.walkers.base import GraphBuilder, LoadedModel, Predictor, walk_estimator

_LIBRARIES = {"sklearn": "scikit-learn", "lightgbm": "LightGBM", "xgboost": "XGBoost"}

#: Packages whose objects know more of themselves (boosters, categories) than a scikit-learn estimator does.
_LOADERS = {"lightgbm": "st_codegen.walkers.lightgbm.model", "xgboost": "st_codegen.walkers.xgboost.model"}

#: What regressors of the three libraries need beyond the types that skops trusts itself. None of these runs code from
#: the file; a `partial` can only hold a function that is itself trusted.
_TRUSTED = frozenset(
    {
        "collections.OrderedDict",
        "functools.partial",
        "lightgbm.basic.Booster",
        "lightgbm.sklearn.LGBMRegressor",
        "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor",
        "sklearn.neural_network._stochastic_optimizers.AdamOptimizer",
        "sklearn.neural_network._stochastic_optimizers.SGDOptimizer",
        "sklearn.tree._tree.Tree",
        "sklearn.utils.validation.check_array",
        "xgboost.core.Booster",
        "xgboost.sklearn.XGBRFRegressor",
        "xgboost.sklearn.XGBRegressor",
    }
)


def load_skops(path: Path, name: str) -> LoadedModel:
    """Load a `.skops` file. Raises UntrustedFileError where it names a type that is not known to be harmless."""
    try:
        import skops.io
    except ImportError:
        raise MissingExtraError("skops", "sklearn", f"{path.name}: reading .skops files") from None
    try:
        unknown = skops.io.get_untrusted_types(file=path)
        foreign = sorted(set(unknown) - _TRUSTED)
        if foreign:
            raise UntrustedFileError(
                f"{path.name}: the file names types that no supported model needs, and loading them could run code: "
                f"{', '.join(foreign)}; save the model without them"
            )
        estimator = skops.io.load(path, trusted=unknown)
    except UntrustedFileError:
        raise
    except Exception as error:  # skops raises whatever zip, json or the classes raise
        raise InputError(f"{path.name}: not a readable .skops file ({type(error).__name__}: {error})") from error
    return from_estimator(estimator, name)


def load_pickle(path: Path, name: str, *, trusted: bool) -> LoadedModel:
    """Load a `.joblib` or `.pkl` file. Raises UntrustedFileError unless the caller trusts it: a pickle can run code."""
    if not trusted:
        raise UntrustedFileError(
            f"{path.name}: loading a pickle can run any code that its author put into it. Save the model as .skops "
            "(skops.io.dump) or .onnx instead, or pass --trust-pickle if you made this file yourself"
        )
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("joblib", "sklearn", f"{path.name}: reading pickles") from None
    try:
        estimator = joblib.load(path)
    except ImportError as error:
        raise InputError(f"{path.name}: the model needs a package that is not installed ({error})") from error
    except Exception as error:  # a damaged pickle can raise anything
        raise InputError(f"{path.name}: not a readable pickle ({type(error).__name__}: {error})") from error
    return from_estimator(estimator, name)


def from_estimator(estimator: Any, name: str) -> LoadedModel:
    """A fitted estimator of scikit-learn, LightGBM or XGBoost as a model.

    Raises UnsupportedModelError for classes without a walker, InputError for an estimator that is not fitted.
    """
    package = type(estimator).__module__.partition(".")[0]
    if package not in _LIBRARIES:
        raise UnsupportedModelError(
            f"the file holds a {type(estimator).__module__}.{type(estimator).__qualname__}, not a model of "
            "scikit-learn, LightGBM or XGBoost"
        )
    if package in _LOADERS:
        loaded: LoadedModel = importlib.import_module(_LOADERS[package]).load_object(estimator, name)
        return loaded
    features = _features(estimator)
    builder = GraphBuilder(len(features))
    walk_estimator(estimator, builder, 0)
    source = Source(
        library=_LIBRARIES[package],
        version=_version(estimator, package),
        model_class=_description(estimator),
    )
    return LoadedModel(builder.model(name, features, source), _predictor(estimator))


def _version(estimator: Any, package: str) -> str:
    """The version that trained the model where the object tells, else the installed one."""
    trained = getattr(estimator, "__dict__", {}).get("_sklearn_version")
    return str(trained or __import__(package).__version__)


def _parts(estimator: Any) -> Iterator[tuple[str, Any]]:
    """The estimators inside a composition."""
    if hasattr(estimator, "steps"):
        yield from estimator.steps
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
    names: Iterable[Any] | None = _first(estimator, "feature_names_in_")
    if names is not None:
        return tuple(Feature(str(name)) for name in names)
    count = _first(estimator, "n_features_in_")
    if count is None:
        raise InputError(f"{type(estimator).__name__} is not fitted: call fit() before saving it")
    return tuple(Feature(f"f{number}") for number in range(int(count)))


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


def _predictor(estimator: Any) -> Predictor:
    """The library's own `predict`, single-threaded: the order in which a forest adds its trees is fixed only then."""
    if hasattr(estimator, "get_params"):
        serial = {key: 1 for key in estimator.get_params(deep=True) if key == "n_jobs" or key.endswith("__n_jobs")}
        _set_fitted_jobs(estimator)
        estimator.set_params(**serial)
    names = _first(estimator, "feature_names_in_")

    def predict(x: FloatArray) -> FloatArray:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return np.asarray(estimator.predict(_with_names(x, names)), np.float64).reshape(len(x), -1)

    return predict


def _set_fitted_jobs(estimator: Any) -> None:
    """`set_params` reaches the templates of a composition, not the fitted copies that predict: reach those too."""
    for _, part in _parts(estimator):
        if hasattr(part, "n_jobs"):
            part.n_jobs = 1
        _set_fitted_jobs(part)


def _with_names(x: FloatArray, names: Any) -> Any:
    """Rows as a data frame where the model was fitted on one and pandas is there: it may select columns by name."""
    if names is None:
        return x
    try:
        import pandas
    except ImportError:
        return x
    return pandas.DataFrame(x, columns=list(names))
