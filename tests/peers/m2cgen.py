"""The scikit-learn, LightGBM and XGBoost estimators on which m2cgen 0.10 tests itself, by class and parameters.

Kinds of data: numbers, counts (positive numbers), shares (0 .. 1), three classes, two classes, and those with gaps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

Entry = tuple[str, dict[str, Any], str]

TRIO = ("numbers", "three", "two")
SEED = {"random_state": 1234}
_TREES = {"n_estimators": 10, **SEED}
_LARGE = {"n_estimators": 100, **SEED}
_HUGE = {"n_estimators": 500, **SEED}

#: Families of LightGBM and XGBoost, each for numbers, three classes and two.
_LIGHTGBM: list[dict[str, Any]] = [
    _TREES,
    {**_TREES, "boosting_type": "dart", "max_drop": 30},
    {**_TREES, "boosting_type": "goss", "top_rate": 0.3, "other_rate": 0.2},
    {**_TREES, "boosting_type": "rf", "subsample": 0.7, "subsample_freq": 1},
    {**_TREES, "extra_trees": True},
    {**_LARGE, "num_leaves": 100, "max_depth": 64},
    {**_HUGE, "num_leaves": 100, "max_depth": 64},
]
_OBJECTIVES: list[tuple[dict[str, Any], str]] = [
    ({"objective": "mse", "reg_sqrt": True}, "numbers"),
    ({"objective": "mae"}, "numbers"),
    ({"objective": "huber", "alpha": 0.5}, "numbers"),
    ({"objective": "fair", "fair_c": 0.5}, "numbers"),
    ({"objective": "poisson", "poisson_max_delta_step": 0.2}, "counts"),
    ({"objective": "quantile", "alpha": 0.2}, "numbers"),
    ({"objective": "mape"}, "numbers"),
    ({"objective": "gamma"}, "counts"),
    ({"objective": "tweedie", "tweedie_variance_power": 1.7}, "counts"),
    ({"objective": lambda y, _: (np.ones(len(y)), np.ones(len(y)))}, "numbers"),
    ({"objective": "xentropy"}, "shares"),
    ({"objective": "xentlambda"}, "shares"),
    ({"objective": "ovr", "sigmoid": 0.5}, "three"),
    ({"sigmoid": 1.5}, "two"),
]
_BOOSTED_FOREST = {"num_parallel_tree": 3, "subsample": 0.8, "colsample_bynode": 0.8, "learning_rate": 1.0}
_XGBOOST: list[tuple[str, dict[str, Any]]] = [
    ("XGB", _TREES),
    ("XGB", {**_TREES, "tree_method": "hist"}),
    ("XGB", {**_TREES, "feature_selector": "shuffle", "booster": "gblinear"}),
    ("XGBRF", _TREES),
    ("XGB", {**_TREES, "n_estimators": 5, **_BOOSTED_FOREST}),
    ("XGB", {**_LARGE, "max_depth": 12}),
    ("XGB", {**_HUGE, "max_depth": 12}),
]

_OVO = {**SEED, "decision_function_shape": "ovo"}
_MACHINES: list[Entry] = [
    ("svm.LinearSVR", SEED, "numbers"),
    ("svm.LinearSVC", SEED, "three"),
    ("svm.LinearSVC", SEED, "two"),
    ("svm.NuSVR", {"kernel": "rbf"}, "numbers"),
    ("svm.SVR", {"kernel": "rbf"}, "numbers"),
    *[("svm.OneClassSVM", {"kernel": "rbf"}, kind) for kind in TRIO],
    ("svm.NuSVC", {"kernel": "rbf", **_OVO}, "three"),
    ("svm.SVC", {"kernel": "rbf", **_OVO}, "three"),
    ("svm.NuSVC", {"kernel": "rbf", **_OVO}, "two"),
    ("svm.SVC", {"kernel": "linear", **_OVO}, "two"),
    ("svm.SVC", {"kernel": "poly", "C": 1.5, "degree": 2, "gamma": 0.1, "coef0": 2.0, **_OVO}, "two"),
    ("svm.SVC", {"kernel": "rbf", **_OVO}, "two"),
    ("svm.SVC", {"kernel": "sigmoid", **_OVO}, "two"),
]
_SEEDED = ("ElasticNet", "ElasticNetCV", "Lasso", "LassoCV", "PassiveAggressiveRegressor", "Ridge", "SGDRegressor")
_LINEAR = """ARDRegression BayesianRidge ElasticNet ElasticNetCV GammaRegressor HuberRegressor Lars LarsCV Lasso LassoCV
LassoLars LassoLarsCV LassoLarsIC LinearRegression OrthogonalMatchingPursuit OrthogonalMatchingPursuitCV
PassiveAggressiveRegressor PoissonRegressor Ridge RidgeCV SGDRegressor TheilSenRegressor""".split()
_CLASSIFIERS = """LogisticRegression LogisticRegressionCV PassiveAggressiveClassifier Perceptron RidgeClassifier
RidgeClassifierCV SGDClassifier""".split()


def entries() -> Iterator[Entry]:
    """All of them: class, parameters, kind of data."""
    yield from _boosters()
    yield from _MACHINES
    for name in _LINEAR:
        positive = name in ("GammaRegressor", "PoissonRegressor")
        seeded = name in (*_SEEDED, "TheilSenRegressor")
        yield f"linear_model.{name}", SEED if seeded else {}, "counts" if positive else "numbers"
    yield "linear_model.RANSACRegressor", {"estimator": "tree.ExtraTreeRegressor", "min_samples": 50, **SEED}, "numbers"
    for power in (0.0, 1.0, 1.5, 2.0, 3.0):
        yield "linear_model.TweedieRegressor", {"power": power}, "counts"
    for kind in TRIO[1:]:
        for name in _CLASSIFIERS:
            yield f"linear_model.{name}", {} if name == "RidgeClassifierCV" else SEED, kind
    for kind in TRIO:
        end = "Regressor" if kind == "numbers" else "Classifier"
        for name, parameters in (("DecisionTree", SEED), ("ExtraTree", SEED)):
            yield f"tree.{name}{end}", parameters, kind
        for name in ("ExtraTrees", "RandomForest"):
            yield f"ensemble.{name}{end}", _TREES, kind


def _boosters() -> Iterator[Entry]:
    for parameters in (*_LIGHTGBM, {"gaps": True, **_TREES}):
        for kind in TRIO:
            name = f"lightgbm.LGBM{'Regressor' if kind == 'numbers' else 'Classifier'}"
            given = {key: value for key, value in parameters.items() if key != "gaps"}
            yield name, given, f"{kind} with gaps" if "gaps" in parameters else kind
    for parameters, kind in _OBJECTIVES:
        name = "lightgbm.LGBMClassifier" if kind in TRIO[1:] else "lightgbm.LGBMRegressor"
        yield name, {**_TREES, **parameters}, kind
    for prefix, parameters in _XGBOOST:
        for kind in TRIO:
            name = f"xgboost.{prefix}{'Regressor' if kind == 'numbers' else 'Classifier'}"
            yield name, {"base_score": 0.6, **parameters}, kind
