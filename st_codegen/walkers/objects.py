"""Estimators in files: `.skops`, and pickles where the user trusts them."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from st_codegen.errors import (
    InputError,
    StCodegenError,
    UnsupportedModelError,
    UntrustedFileError,
    extra_package,
    with_subject,
)
from st_codegen.walkers.base import LIBRARIES, LoadedModel, is_known, trusted_types, unsupported
from st_codegen.walkers.skops_file import checked_archive, classes_in

#: For each library, the module whose `load_object` makes a model of an object of that library.
_LOADERS = {
    "sklearn": "st_codegen.walkers.sklearn.estimator",
    "lightgbm": "st_codegen.walkers.lightgbm.model",
    "xgboost": "st_codegen.walkers.xgboost.model",
    "statsmodels": "st_codegen.walkers.statsmodels.results",
}


#: How the names of estimators end, as against those of their parts.
_ESTIMATORS = ("Regressor", "Classifier", "Ridge", "SVC", "Features", "Transformer", "Encoder", "Imputer", "PCA", "CV")
#: In every classifier that is made of others; its labels are read elsewhere.
_PART = "LabelEncoder"

#: What raises in walkers where an object is not built as its library builds it: a file may hold any object.
NOT_AS_MADE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


def load_skops(path: Path, name: str) -> LoadedModel:
    """Load a `.skops` file. Raises UntrustedFileError where it names a type that is not known to be harmless."""
    extra_package("sklearn", "sklearn", f"{path.name}: reading .skops files")
    skops = extra_package("skops.io", "sklearn", f"{path.name}: reading .skops files")
    try:
        data = checked_archive(path)
        unknown = skops.get_untrusted_types(data=data)
        foreign = sorted(set(unknown) - trusted_types())
        if foreign:
            for number, (package, kind) in enumerate(classes_in(data)):
                if (
                    package in LIBRARIES
                    and not is_known(package, kind)
                    and (number == 0 or kind.endswith(_ESTIMATORS))
                    and kind != _PART
                    and not kind.startswith("_")  # a part of an estimator, which stands in the file, too
                ):
                    raise unsupported(package, kind)
            raise UntrustedFileError(
                "the file names types that no supported model needs, and loading them could run code: "
                f"{', '.join(foreign)}; {_way_out(foreign)}"
            )
        estimator = skops.loads(data, trusted=unknown)
    except InputError as error:
        raise with_subject(error, path.name) from None
    except Exception as error:  # skops raises whatever zip, json or the classes raise
        raise InputError(f"{path.name}: not a readable .skops file ({type(error).__name__}: {error})") from error
    return from_estimator(estimator, name)


#: how a model is saved without what comes from these packages
_WITHOUT = {
    "scipy.stats.": "of a search over distributions its best_estimator_",
    "joblib.": "of a pipeline with memory, after set_params(memory=None)",
}


def _way_out(foreign: list[str]) -> str:
    """What to do about types that a file may not name: those of libraries often belong to the model."""
    if all(name.partition(".")[0] in LIBRARIES for name in foreign):
        return "save the model without them, or train it without them"
    named = [text for package, text in _WITHOUT.items() if any(name.startswith(package) for name in foreign)]
    return f"save the model without them{''.join(f' ({text})' for text in named)}"


def load_pickle(path: Path, name: str, *, trusted: bool) -> LoadedModel:
    """Load a `.joblib` or `.pkl` file. Raises UntrustedFileError unless the caller trusts it: a pickle can run code."""
    if not trusted:
        raise UntrustedFileError(
            f"{path.name}: loading a pickle can run any code that its author put into it. Save the model as .skops "
            "(skops.io.dump) or .onnx instead, or pass --trust-pickle if you made this file yourself"
        )
    joblib = extra_package("joblib", "sklearn", f"{path.name}: reading pickles")
    try:
        estimator = joblib.load(path)
    except ImportError as error:
        raise InputError(
            f"{path.name}: the model needs a package that is not installed, or another version of one ({error})"
        ) from error
    except Exception as error:  # a damaged pickle can raise anything
        raise InputError(
            f"{path.name}: not a readable pickle, or one of another version of its library "
            f"({type(error).__name__}: {error})"
        ) from error
    return from_estimator(estimator, name)


def from_estimator(estimator: Any, name: str) -> LoadedModel:
    """A fitted estimator of scikit-learn, LightGBM, XGBoost or statsmodels as a model.

    Raises UnsupportedModelError for classes without a walker, InputError for an estimator that is not fitted.
    """
    package = type(estimator).__module__.partition(".")[0]
    if package not in LIBRARIES:
        above = (base for base in type(estimator).__mro__ if base.__module__.partition(".")[0] in LIBRARIES)
        base = next((base for base in above if hasattr(base, "predict") or hasattr(base, "transform")), None)
        raise UnsupportedModelError(
            f"this is a {type(estimator).__module__}.{type(estimator).__qualname__}, not a model of "
            "scikit-learn, LightGBM, XGBoost or statsmodels"
            + (f"; what a class made of {base.__name__} changes is not known: give a {base.__name__}" if base else "")
        )
    if package == "sklearn":
        extra_package(package, package, "compiling this model")
    module = importlib.import_module(_LOADERS[package])
    try:
        loaded: LoadedModel = module.load_object(estimator, name)
    except StCodegenError:
        raise
    except NOT_AS_MADE as error:
        raise InputError(
            f"the model is not as {type(estimator).__name__} makes it ({type(error).__name__}: {error})"
        ) from error
    return loaded
