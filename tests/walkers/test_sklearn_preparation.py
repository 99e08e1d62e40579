"""What scikit-learn computes by `transform`: alone, in pipelines, and with missing values, against the library."""

import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn import (
    decomposition,
    discriminant_analysis,
    feature_selection,
    linear_model,
    random_projection,
)
from sklearn.compose import ColumnTransformer
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.feature_selection import RFE, SelectKBest, VarianceThreshold
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import MinMaxScaler, StandardScaler
from sklearn.tree import DecisionTreeClassifier

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.proof import bounds
from tests.classifiers import SCORE, THREE, X, loaded, verified

#: Numbers of which some lie exactly on training data, some beside it, and some far away.
ROWS = np.vstack([X, X + 1e-9, X[::-1, ::-1], 3.0 * X])

TRANSFORMERS = {
    "PCA": (decomposition.PCA(2), None),
    "PCA, whitened": (decomposition.PCA(whiten=True), None),
    "IncrementalPCA": (decomposition.IncrementalPCA(2), None),
    "TruncatedSVD": (decomposition.TruncatedSVD(2), None),
    "FastICA": (decomposition.FastICA(2, random_state=0), None),
    "FastICA of all": (decomposition.FastICA(whiten=False, random_state=0, tol=0.1), None),
    "LDA": (discriminant_analysis.LinearDiscriminantAnalysis(n_components=1), THREE),
    "LDA, eigen": (discriminant_analysis.LinearDiscriminantAnalysis("eigen"), THREE),
    "GaussianRandomProjection": (random_projection.GaussianRandomProjection(2, random_state=0), None),
    "SparseRandomProjection": (random_projection.SparseRandomProjection(2, random_state=1, density=0.7), None),
    "VarianceThreshold": (VarianceThreshold(0.5), None),
    "SelectKBest": (SelectKBest(feature_selection.f_regression, k=2), SCORE),
    "SelectFromModel": (feature_selection.SelectFromModel(linear_model.Ridge()), SCORE),
    "RFE": (RFE(linear_model.Ridge(), n_features_to_select=2), SCORE),
    "FeatureUnion": (
        FeatureUnion(
            [("a", StandardScaler()), ("b", "passthrough"), ("c", "drop"), ("d", decomposition.PCA(1))],
            transformer_weights={"a": 0.3, "b": 2.0},
        ),
        None,
    ),
}


def fit(estimator, x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return estimator.fit(x, y)


def agrees(model, rows):
    """The reference answers with the library's numbers, within the bound, and where the library does."""
    found = reference.evaluate(model.ir, rows)
    usable = np.isfinite(found).all(axis=1)
    bound = bounds.difference_bound(model.ir, rows)[usable]
    assert np.all(np.abs(model.predict(rows[usable]) - found[usable]) <= bound)
    return usable, bound


@pytest.mark.parametrize("name", TRANSFORMERS)
def test_transformers_in_front_of_a_model(name):
    estimator, y = TRANSFORMERS[name]
    model = loaded(fit(make_pipeline(StandardScaler(), estimator, linear_model.Ridge()), X, SCORE if y is None else y))
    usable, bound = agrees(model, ROWS)
    assert usable.all() and np.max(bound) < 1e-11


@pytest.mark.parametrize("name", [name for name, (e, _) in TRANSFORMERS.items() if not hasattr(e, "predict")])
def test_transformers_alone_are_verified(name, tmp_path):
    estimator, y = TRANSFORMERS[name]
    verified(loaded(fit(estimator, X, y)), tmp_path, rows=300)
    fitted = fit(estimator, X, y)
    assert np.array_equal(loaded(fitted).predict(X), np.asarray(fitted.transform(X)))


def test_the_bound_of_principal_components_covers_a_mean_that_cancels():
    x = X + 1e7
    model = loaded(decomposition.PCA(2).fit(x))
    _, bound = agrees(model, x)
    assert np.all(bound > 1e-10)


def test_a_step_that_transforms_is_not_taken_for_one_that_predicts():
    model = fit(make_pipeline(RFE(linear_model.Ridge(), n_features_to_select=2), linear_model.Ridge()), X, SCORE)
    agrees(loaded(model), ROWS)
    with pytest.raises(UnsupportedModelError, match="Birch is not supported"):
        from sklearn.cluster import Birch

        loaded(fit(make_pipeline(Birch(threshold=1.0), linear_model.Ridge()), X, SCORE))


def test_columns_apart_with_weights():
    columns = ColumnTransformer(
        [("a", decomposition.PCA(1), [0, 2]), ("b", MinMaxScaler(), [1])], transformer_weights={"b": 0.5}
    )
    agrees(loaded(fit(make_pipeline(columns, RandomForestRegressor(3, random_state=0)), X, SCORE)), X)


def test_missing_values_are_refused_where_the_library_refuses_them():
    gaps = np.where(np.random.default_rng(0).random(X.shape) < 0.2, np.nan, X)
    partly = ColumnTransformer([("a", decomposition.PCA(1), [0]), ("b", "passthrough", [1])])
    model = loaded(
        fit(
            make_pipeline(partly, HistGradientBoostingRegressor(max_iter=5)),
            np.where([True, False, True], X, gaps),
            SCORE,
        )
    )
    assert model.ir.accepts_nan and model.ir.must_be_present == (0,)
    usable, _ = agrees(model, gaps)
    assert np.array_equal(usable, ~np.isnan(gaps[:, 0]))


def test_a_label_behind_selected_columns(tmp_path):
    pipeline = make_pipeline(SelectKBest(k=2), StandardScaler(), DecisionTreeClassifier(max_depth=4, random_state=0))
    report = verified(loaded(fit(pipeline, X, THREE)), tmp_path)
    assert report.exact and not report.open_rows
