"""The models of the race: the ten families on the measured table of the real rig, and regressors as they are published.

The table stands beside the checkout (see tests/families.py); without it the families are left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.contenders import Case

ROWS = 2_000


def _rig(family: str) -> Case:
    from tests.families import families, harmonic_table

    x, columns = harmonic_table("forward")
    y = columns["A0" if family == "svr" else "A39"]  # the order that the paper uses SVR for
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted = families()[family].fit(x, y)
    rows = np.random.default_rng(1).uniform(x.min(axis=0), x.max(axis=0), (ROWS, 3))
    return Case(f"rig-{family}", fitted, rows)


def _friedman(name: str, make: Callable[[], Any], features: int) -> Case:
    """Friedman's first function on uniform inputs, with noise, as many public benchmarks have it."""
    from sklearn.datasets import make_friedman1

    x, y = make_friedman1(4_000, max(features, 5), noise=1.0, random_state=0)
    rows = np.random.default_rng(1).uniform(size=(ROWS, features))
    return Case(name, make().fit(x, y), rows)


def _housing(name: str, make: Callable[[], Any]) -> Case:
    """Eight features with the ranges and skew of a census of houses, and a price made of them."""
    random = np.random.default_rng(0)
    x = _houses(random, 8_000)
    price = 0.4 * x[:, 0] + 0.008 * x[:, 1] + np.log1p(x[:, 2] / x[:, 5]) - 0.3 * np.hypot(x[:, 6] - 34, x[:, 7] + 118)
    return Case(name, make().fit(x, price + random.normal(0, 0.3, len(x))), _houses(np.random.default_rng(1), ROWS))


def _parts(name: str, make: Callable[[], Any]) -> Case:
    """Three kinds of parts by twelve measurements, as public benchmarks make them; the kinds are 0, 1 and 2."""
    from sklearn.datasets import make_classification

    x, kind = make_classification(
        4_000 + ROWS, 12, n_informative=8, n_classes=3, class_sep=0.8, flip_y=0.05, random_state=0
    )
    return Case(name, make().fit(x[ROWS:], kind[ROWS:]), x[:ROWS])


def _houses(random: np.random.Generator, count: int) -> np.ndarray:
    income, age = random.lognormal(1.2, 0.5, count), random.uniform(1, 52, count)
    rooms, bedrooms = random.lognormal(1.6, 0.3, count), random.lognormal(0.05, 0.15, count)
    people, home = random.lognormal(7, 0.7, count), random.lognormal(1.0, 0.3, count)
    latitude, longitude = random.uniform(32, 42, count), random.uniform(-124, -114, count)
    return np.column_stack([income, age, rooms, bedrooms, people, home, latitude, longitude])


def cases() -> Iterator[tuple[str, Callable[[], Case]]]:
    """Name, and a function that trains."""
    from tests.families import SHARED, families

    if SHARED.is_dir():
        for family in families():
            yield f"rig-{family}", lambda family=family: _rig(family)
    else:
        print("the measured table is not beside this checkout: the cases of the rig are left out")
    yield from _public()


def _public() -> Iterator[tuple[str, Callable[[], Case]]]:
    import lightgbm
    import xgboost
    from sklearn.ensemble import (
        ExtraTreesRegressor,
        GradientBoostingRegressor,
        HistGradientBoostingRegressor,
        RandomForestClassifier,
        RandomForestRegressor,
    )
    from sklearn.svm import SVC

    def lgbm(trees: int) -> Any:
        return lightgbm.LGBMRegressor(n_estimators=trees, num_leaves=31, random_state=0, verbose=-1, n_jobs=1)

    def xgbm(trees: int) -> Any:
        return xgboost.XGBRegressor(n_estimators=trees, max_depth=4, learning_rate=0.1, random_state=0, n_jobs=1)

    makers: dict[str, tuple[Callable[[], Any], int]] = {
        "friedman10-lgbm-100": (lambda: lgbm(100), 10),
        "friedman20-lgbm-300": (lambda: lgbm(300), 20),
        "friedman30-xgb-1000": (lambda: xgbm(1000), 30),
        "friedman10-rf-100": (lambda: RandomForestRegressor(100, max_depth=8, random_state=0), 10),
        "friedman10-ert-100": (lambda: ExtraTreesRegressor(100, max_depth=8, random_state=0), 10),
        "friedman20-gbm-300": (lambda: GradientBoostingRegressor(n_estimators=300, max_depth=4, random_state=0), 20),
    }
    for name, (make, features) in makers.items():
        yield name, lambda name=name, make=make, features=features: _friedman(name, make, features)
    for name, make in {
        "houses8-hgb-200": lambda: HistGradientBoostingRegressor(max_iter=200, early_stopping=False, random_state=0),
        "houses8-xgb-100": lambda: xgbm(100),
        "houses8-lgbm-1000": lambda: lgbm(1000),
    }.items():
        yield name, lambda name=name, make=make: _housing(name, make)
    for name, make in {
        # objective multiclass: 100 rounds of a tree for each of three classes
        "parts12-lgbm-classes-300": lambda: lightgbm.LGBMClassifier(random_state=0, verbose=-1, n_jobs=1),
        "parts12-rf-classes-200": lambda: RandomForestClassifier(200, max_depth=8, random_state=0),
        "parts12-svc": SVC,
    }.items():
        yield name, lambda name=name, make=make: _parts(name, make)
