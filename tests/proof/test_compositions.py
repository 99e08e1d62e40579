"""Whole pipelines, from estimator to executed text: what one part refuses or misses must reach the other end."""

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.ensemble import (
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingRegressor,
    RandomForestRegressor,
)
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    MinMaxScaler,
    RobustScaler,
    StandardScaler,
)
from sklearn.svm import SVR
from sklearn.tree import DecisionTreeRegressor

import st_codegen
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import Bundle
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator

RANDOM = np.random.default_rng(0)
X = RANDOM.normal(size=(200, 4))
X_MISSING = np.where(RANDOM.random(X.shape) < 0.1, np.nan, X)
Y = X[:, 0] * 2 + np.sin(X[:, 1] * 3)
POSITIVE = np.exp(Y / 3)

CASES = {
    # scaling lifts inputs that are just below the largest float32 above it, where trees refuse them
    "columns apart": (
        make_pipeline(
            ColumnTransformer([("a", StandardScaler(), [0, 2]), ("b", MinMaxScaler(), [1])], remainder="passthrough"),
            GradientBoostingRegressor(n_estimators=5, random_state=0),
        ),
        X,
        Y,
    ),
    "columns left out": (
        make_pipeline(
            ColumnTransformer([("a", StandardScaler(), [0, 2]), ("d", "drop", [1])], remainder=RobustScaler()),
            RandomForestRegressor(3, random_state=0),
        ),
        X,
        Y,
    ),
    # a logarithm that does not exist beside an input that is missing
    "functions before a tree": (
        make_pipeline(
            FunctionTransformer(np.log1p), FunctionTransformer(np.expm1), DecisionTreeRegressor(random_state=0)
        ),
        np.abs(X),
        Y,
    ),
    "missing values through scalers": (
        TransformedTargetRegressor(
            make_pipeline(StandardScaler(), HistGradientBoostingRegressor(max_iter=5)), transformer=RobustScaler()
        ),
        X_MISSING,
        Y,
    ),
    "a target's logarithm": (
        TransformedTargetRegressor(ExtraTreesRegressor(4, random_state=0), func=np.log1p, inverse_func=np.expm1),
        X,
        POSITIVE,
    ),
    "several scaled targets": (
        TransformedTargetRegressor(Ridge(), transformer=MinMaxScaler()),
        X,
        np.column_stack([Y, POSITIVE]),
    ),
    # raw amplitudes of 1e-4 within an epsilon of 0.1
    "a machine without support vectors": (SVR(), X, 1e-4 * Y),
    "a link function": (HistGradientBoostingRegressor(loss="poisson", max_iter=5), X_MISSING, POSITIVE),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_the_text_of_a_composition_is_verified(name, tmp_path):
    estimator, x, y = CASES[name]
    loaded = from_estimator(estimator.fit(x, y), "model")
    bundle = Bundle((LoadedModel(limit_inputs(loaded.ir), loaded.predict),), None)
    for target in ("twincat", "iec", "plcopen"):
        st_codegen.generate(bundle, target, tmp_path)
    report = st_codegen.verify(bundle, tmp_path, rows=500)
    assert report.passed, report.models[0].failures


def test_results_beyond_float32_do_not_stop_the_blocks_of_model_files(tmp_path):
    estimator, x, y = CASES["several scaled targets"]
    loaded = from_estimator(estimator.fit(x, y), "model")
    bundle = Bundle((LoadedModel(limit_inputs(loaded.ir), loaded.predict),), None)
    st_codegen.generate(bundle, "beckhoff-ml", tmp_path)
    report = st_codegen.verify(bundle, tmp_path, rows=500)
    assert report.passed, report.models[0].failures
