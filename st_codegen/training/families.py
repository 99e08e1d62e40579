"""The ten families of the paper and the extreme learning machine: how each is fitted, and with which parameters.

Two sets of parameters a family: `authors`, as the paper's authors tuned them on bare targets, and `grid`, what our
search tries. There the families that are sensitive to the size of a target (SVM, MLP, XGBM) see it in robust units
(see `targets`), so that an epsilon or a loss means the same for an amplitude of 1e-4 deg and a phase.
Every fit is in one thread and seeded: the same bits on every run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.errors import InputError, MissingExtraError, Problems, extra_package
from st_codegen.ir.arrays import FloatArray
from st_codegen.training.targets import RobustUnit

Params = Mapping[str, Any]
#: (parameters, x (n, features), y (n,), seed) -> fitted estimator
Fit = Callable[[Params, FloatArray, FloatArray, int], Any]


@dataclass(frozen=True)
class Family:
    """A family of regressors. `name` is the paper's; `robust_units`: our search hands it targets in robust units.

    forms: in which form its models can be saved (see `export.FORMATS`).
    """

    name: str
    title: str
    fit: Fit
    authors: Params
    grid: tuple[Params, ...]
    robust_units: bool = False
    forms: tuple[str, ...] = ("native", "skops", "onnx")


def family_named(name: str) -> Family:
    """The family of a name, in any case. Raises InputError."""
    known = {key.lower(): family for key, family in FAMILIES.items()} | {"svr": FAMILIES["SVM"]}
    if name.lower() not in known:
        raise InputError(f"unknown family '{name}'; known are {', '.join(FAMILIES)}")
    return known[name.lower()]


def _scaled(x: FloatArray, lengths: Any) -> Any:
    """A StandardScaler that divides each feature by a length in its own unit (None: its standard deviation)."""
    from sklearn.preprocessing import StandardScaler

    scaler = StandardScaler().fit(x)
    if lengths is not None:
        scaler.scale_ = np.array(lengths, np.float64)
        scaler.var_ = scaler.scale_**2
    return scaler


def _svm(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:  # noqa: ARG001 - no random numbers
    """`lengths`: how far the kernel reaches in each feature, in its unit (rpm, N m, degC)."""
    from sklearn.pipeline import Pipeline
    from sklearn.svm import SVR

    own = {key: value for key, value in params.items() if key != "lengths"}
    if "lengths" not in params:
        return SVR(**own).fit(x, y)
    scaler = _scaled(x, params["lengths"])
    # exp(-|difference in lengths|^2 / 2)
    svr = SVR(gamma=0.5, cache_size=100, **own).fit(scaler.transform(x), y)
    return Pipeline([("scale", scaler), ("svr", svr)])


def _mlp(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import Pipeline

    own = {key: value for key, value in params.items() if key != "scaled"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the number of steps is a parameter like others
        if not params.get("scaled"):
            return MLPRegressor(random_state=seed, **own).fit(x, y)
        scaler = _scaled(x, None)
        mlp = MLPRegressor(random_state=seed, **own).fit(scaler.transform(x), y)
    return Pipeline([("scale", scaler), ("mlp", mlp)])


def _sklearn(module: str, name: str, *, one_thread: bool = False) -> Fit:
    def fit(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
        import importlib

        kind = getattr(importlib.import_module(f"sklearn.{module}"), name)
        fixed = {"n_jobs": 1} if one_thread else {}
        return kind(random_state=seed, **fixed, **params).fit(x, y)

    return fit


def _extra_trees(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
    """`speed_copies`: how many of the random thresholds of a node are in speed (the first feature), one in each other.

    Where a structure resonates, speed decides more than the rest together, and one random threshold in it is too few.
    """
    fit = _sklearn("ensemble", "ExtraTreesRegressor", one_thread=True)
    if "speed_copies" not in params:
        return fit(params, x, y, seed)
    from sklearn.compose import ColumnTransformer
    from sklearn.pipeline import Pipeline

    own = {key: value for key, value in params.items() if key != "speed_copies"}
    columns = [0] * (int(params["speed_copies"]) - 1) + list(range(x.shape[1]))
    copied = ColumnTransformer([("columns", "passthrough", columns)]).fit(x)
    return Pipeline([("columns", copied), ("trees", fit(own, copied.transform(x), y, seed))])


def _lgbm(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
    lightgbm = extra_package("lightgbm", "lightgbm", "the family LGBM")
    learner = lightgbm.LGBMRegressor(
        random_state=seed, n_jobs=1, verbose=-1, deterministic=True, force_row_wise=True, **params
    )
    return learner.fit(x, y)


def _xgbm(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
    try:
        import xgboost
    except ImportError:
        raise MissingExtraError("xgboost-cpu", "xgboost", "the family XGBM") from None
    return xgboost.XGBRegressor(random_state=seed, n_jobs=1, **params).fit(x, y)


class ExtremeLearningMachine:
    """Random hidden neurons, output weights by least squares. For comparison only: TwinCAT has none."""

    def __init__(self, neurons: int, x: FloatArray, y: FloatArray, seed: int) -> None:
        random = np.random.default_rng(seed)
        self._scaler = _scaled(x, None)
        self._weights = random.normal(size=(x.shape[1], neurons))
        self._bias = random.normal(size=neurons)
        self._output, *_ = np.linalg.lstsq(self._hidden(x), y, rcond=1e-8)

    def _hidden(self, x: FloatArray) -> FloatArray:
        hidden: FloatArray = np.tanh(self._scaler.transform(x) @ self._weights + self._bias)
        return np.column_stack([hidden, np.ones(len(x))])

    def predict(self, x: FloatArray) -> FloatArray:
        """Values (n,) of inputs (n, features)."""
        return self._hidden(x) @ self._output


def _elm(params: Params, x: FloatArray, y: FloatArray, seed: int) -> Any:
    return ExtremeLearningMachine(int(params["neurons"]), x, y, seed)


@dataclass(frozen=True)
class Learner:
    """A family with parameters. `by_authors`: fitted on bare targets, as the paper did."""

    family: str
    params: Params
    by_authors: bool = False

    @property
    def key(self) -> str:
        """One text for one candidate, the same in every process."""
        return json.dumps([self.family, self.params, self.by_authors], sort_keys=True)

    def fit(self, x: FloatArray, y: FloatArray, seed: int) -> Any:
        """A fitted estimator whose `predict` gives values in the unit of y (n,); x (n, features)."""
        family = family_named(self.family)
        if self.by_authors or not family.robust_units:
            return family.fit(self.params, x, y, seed)
        unit = RobustUnit.of(y)
        return _in_units(family.fit(self.params, x, unit.scaled(y), seed), unit)


def candidates(names: Sequence[str]) -> tuple[Learner, ...]:
    """All that our search tries of these families. Raises one InputError for all unknown ones."""
    found, problems = list[Learner](), Problems("families")
    for name in names:
        with problems.collect():
            family = family_named(name)
            found += [Learner(family.name, params) for params in family.grid]
    problems.raise_if_any()
    return tuple(found)


def _in_units(estimator: Any, unit: RobustUnit) -> Any:
    """An estimator of scaled values as one of values: put together by hand, since it is fitted already."""
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.preprocessing import StandardScaler

    scaler = StandardScaler().fit(np.array([[unit.centre], [unit.centre + 1.0]]))
    scaler.mean_, scaler.scale_, scaler.var_ = np.array([unit.centre]), np.array([unit.size]), np.array([unit.size**2])
    whole = TransformedTargetRegressor(regressor=estimator, transformer=scaler)
    whole.regressor_, whole.transformer_, whole._training_dim = estimator, scaler, 1
    return whole


#: how far the kernel reaches in speed, torque and temperature: rpm, N m, degC
_LENGTHS = (
    (170.0, 300.0, 8.0),
    (170.0, 500.0, 8.0),
    (330.0, 500.0, 12.0),
    (80.0, 300.0, 8.0),
    (40.0, 400.0, 8.0),
    (170.0, 2000.0, 4.0),
)

#: name in the paper -> family, in the order of its tables
FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "SVM",
            "support vector machine",
            _svm,
            {"C": 1.0, "epsilon": 1e-4, "gamma": 1.1e-6},
            tuple({"C": 10.0, "epsilon": 0.05, "lengths": lengths} for lengths in _LENGTHS),
            robust_units=True,
        ),
        Family(
            "MLP",
            "multi-layer perceptron",
            _mlp,
            {
                "activation": "tanh",
                "hidden_layer_sizes": (200, 50),
                "learning_rate": "adaptive",
                "early_stopping": True,
            },
            (
                {
                    "scaled": True,
                    "activation": "tanh",
                    "hidden_layer_sizes": (16, 8),
                    "solver": "lbfgs",
                    "alpha": 0.1,
                    "max_iter": 200,
                },
            ),
            robust_units=True,
        ),
        Family(
            "RF",
            "random forest",
            _sklearn("ensemble", "RandomForestRegressor", one_thread=True),
            {"max_depth": 14, "min_samples_split": 3, "n_estimators": 90},
            ({"max_depth": 14, "min_samples_split": 3, "n_estimators": 90}, {"n_estimators": 100, "max_features": 2}),
        ),
        Family(
            "DT",
            "decision tree",
            _sklearn("tree", "DecisionTreeRegressor"),
            {"max_depth": 16, "min_samples_split": 6},
            ({"min_samples_leaf": 2}, {"min_samples_leaf": 2, "criterion": "absolute_error"}),
        ),
        Family(
            "ET",
            "extra tree",
            _sklearn("tree", "ExtraTreeRegressor"),
            {"max_depth": 15, "min_samples_split": 5},
            ({"min_samples_leaf": 2}, {"min_samples_split": 4, "max_features": None}),
        ),
        Family(
            "ERT",
            "extremely randomised trees",
            _extra_trees,
            {"max_depth": 15, "min_samples_split": 3, "n_estimators": 60},
            (
                {"max_depth": 15, "min_samples_split": 3, "n_estimators": 60},
                {"n_estimators": 100, "min_samples_split": 2},
                {"n_estimators": 100, "min_samples_split": 2, "speed_copies": 3},
            ),
        ),
        Family(
            "GBM",
            "gradient boosting",
            _sklearn("ensemble", "GradientBoostingRegressor"),
            {"learning_rate": 0.1, "max_depth": 14, "min_samples_split": 14, "n_estimators": 36},
            ({"learning_rate": 0.07, "max_depth": 6, "n_estimators": 150, "min_samples_split": 8, "subsample": 0.5},),
        ),
        Family(
            "HGBM",
            "histogram gradient boosting",
            _sklearn("ensemble", "HistGradientBoostingRegressor"),
            {"learning_rate": 0.21, "max_depth": 11, "max_leaf_nodes": 27},
            (
                {
                    "learning_rate": 0.1,
                    "max_iter": 150,
                    "max_leaf_nodes": 31,
                    "min_samples_leaf": 5,
                    "loss": "absolute_error",
                    "early_stopping": False,
                },
            ),
        ),
        Family(
            "LGBM",
            "LightGBM",
            _lgbm,
            {"learning_rate": 0.39, "max_depth": 12, "subsample": 0.1},
            (
                {"learning_rate": 0.39, "max_depth": 12, "subsample": 0.1},
                {"learning_rate": 0.07, "n_estimators": 200, "num_leaves": 15, "min_child_samples": 5},
                {
                    "learning_rate": 0.1,
                    "n_estimators": 300,
                    "num_leaves": 31,
                    "min_child_samples": 4,
                    "objective": "l1",
                },
            ),
            forms=("native", "skops"),
        ),
        Family(
            "XGBM",
            "XGBoost",
            _xgbm,
            {"reg_lambda": 20.0, "reg_alpha": 0.01, "max_depth": 16, "colsample_bytree": 0.8},
            ({"learning_rate": 0.07, "n_estimators": 200, "max_depth": 5, "subsample": 0.7, "reg_lambda": 1.0},),
            # XGBoost splits only where the loss falls by 1e-6 (kRtEps), more than an amplitude of 1e-4 deg has to give
            robust_units=True,
            forms=("native", "skops"),
        ),
        Family("ELM", "extreme learning machine", _elm, {"neurons": 250}, ({"neurons": 250},), forms=()),
    )
}
