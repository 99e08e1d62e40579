"""Steps with copy=False, which write into the rows that they are given."""

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn import ensemble, multiclass, multioutput
from sklearn.calibration import CalibratedClassifierCV
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.decomposition import PCA
from sklearn.feature_selection import RFE
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LinearRegression, LogisticRegression, Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import FunctionTransformer, PowerTransformer, StandardScaler

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.proof import bounds
from tests.classifiers import SCORE, TWO, WORDS, X, loaded

BOTH = np.column_stack([SCORE, -SCORE])


def scaled(estimator):
    return make_pipeline(StandardScaler(copy=False), estimator)


ALONE = {
    "scaler": (scaled(Ridge()), SCORE),
    "classes": (scaled(LogisticRegression()), WORDS),
    "columns of a PCA": (scaled(PCA(2)), SCORE),
    "one estimator": (ensemble.VotingRegressor([("one", scaled(Ridge()))]), SCORE),
    "the best one": (GridSearchCV(scaled(Ridge()), {"ridge__alpha": [0.1, 1.0]}, cv=2), SCORE),
    "target": (TransformedTargetRegressor(scaled(Ridge()), transformer=StandardScaler(copy=False)), SCORE),
    "bag": (ensemble.BaggingRegressor(scaled(Ridge()), 3, random_state=0), SCORE),
    "bag of sums": (ensemble.BaggingRegressor(make_pipeline(scaled(Ridge())), 2, random_state=0), SCORE),
    "one against the rest": (multiclass.OneVsRestClassifier(scaled(LogisticRegression())), TWO),
    "one soft vote": (ensemble.VotingClassifier([("a", scaled(LogisticRegression()))], voting="soft"), WORDS),
    "one slice": (ColumnTransformer([("a", StandardScaler(copy=False), slice(0, 2))]), SCORE),
    "selected columns in a vote": (
        ensemble.VotingRegressor(
            [("a", RFE(scaled(Ridge()), importance_getter="named_steps.ridge.coef_")), ("b", LinearRegression())]
        ),
        SCORE,
    ),
    "columns": (
        ColumnTransformer([("a", StandardScaler(copy=False), [0, 1]), ("b", StandardScaler(copy=False), [0])]),
        SCORE,
    ),
    "behind what makes rows of its own": (
        ensemble.VotingRegressor(
            [("a", make_pipeline(PCA(2), StandardScaler(copy=False), Ridge())), ("b", LinearRegression())]
        ),
        SCORE,
    ),
    "what is inside a preparation": (make_union(PowerTransformer(), StandardScaler()), SCORE),
    "before the last of a stack": (
        ensemble.StackingRegressor([("a", Ridge()), ("b", LinearRegression())], scaled(Ridge())),
        SCORE,
    ),
}  # fmt: skip
SHARED = {
    "votes": (ensemble.VotingRegressor([("a", scaled(Ridge())), ("b", LinearRegression())]), SCORE),
    "behind the same rows": (
        ensemble.VotingRegressor(
            [("a", make_pipeline(FunctionTransformer(), "passthrough", scaled(Ridge()))), ("b", LinearRegression())]
        ),
        SCORE,
    ),
    "union": (make_union(SimpleImputer(copy=False), StandardScaler()), SCORE),
    "vote in a bag": (
        ensemble.BaggingRegressor(
            ensemble.VotingRegressor([("a", scaled(Ridge())), ("b", LinearRegression())]), 2, random_state=0
        ),
        SCORE,
    ),
    "chain of one": (multioutput.RegressorChain(scaled(Ridge())), BOTH[:, :1]),
    "one against one": (multiclass.OneVsOneClassifier(scaled(LogisticRegression())), TWO),
    "slices": (
        ColumnTransformer([("a", StandardScaler(copy=False), slice(0, 2)), ("b", "passthrough", [0])]),
        SCORE,
    ),
    "stack": (ensemble.StackingRegressor([("a", scaled(Ridge()))], passthrough=True), SCORE),
    "outputs": (multioutput.MultiOutputRegressor(scaled(Ridge())), BOTH),
    "chain": (multioutput.RegressorChain(scaled(Ridge())), BOTH),
    "rest": (multiclass.OneVsRestClassifier(scaled(LogisticRegression())), WORDS),
    "calibrated": (CalibratedClassifierCV(scaled(LogisticRegression())), TWO),
    "boosted": (ensemble.AdaBoostRegressor(scaled(Ridge()), n_estimators=3, random_state=0), SCORE),
}  # fmt: skip


@pytest.mark.parametrize("name", ALONE)
def test_the_library_is_asked_with_rows_of_its_own(name):
    """What was compared after it, or asked of it next, read rows that it had scaled."""
    estimator, y = ALONE[name]
    model = loaded(estimator.fit(X.copy(), y))
    rows = X[:50].copy()
    library = model.predict(rows)
    assert np.array_equal(rows, X[:50])
    assert np.all(np.abs(library - reference.evaluate(model.ir, rows)) <= bounds.difference_bound(model.ir, rows))


@pytest.mark.parametrize("name", SHARED)
def test_a_step_that_writes_into_the_rows_of_others_is_refused(name):
    """The library's answer to an array differs from that to a table: 4e5 in place of 2e2 for an average of two."""
    estimator, y = SHARED[name]
    with pytest.raises(UnsupportedModelError, match=r"\(copy=False\), which writes into rows that other parts"):
        loaded(estimator.fit(X.copy(), y))
