"""What scikit-learn computes by `transform`: alone, in pipelines, and with missing values, against the library."""

import contextlib
import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")

import sklearn
from scipy import sparse
from sklearn import (
    cluster,
    decomposition,
    discriminant_analysis,
    feature_selection,
    linear_model,
    metrics,
    random_projection,
)
from sklearn.cluster import KMeans
from sklearn.compose import ColumnTransformer
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.feature_selection import RFE, SelectKBest, VarianceThreshold
from sklearn.frozen import FrozenEstimator
from sklearn.impute import KNNImputer, MissingIndicator, SimpleImputer
from sklearn.isotonic import IsotonicRegression
from sklearn.kernel_approximation import Nystroem, RBFSampler
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import (
    Binarizer,
    FunctionTransformer,
    KBinsDiscretizer,
    MaxAbsScaler,
    MinMaxScaler,
    Normalizer,
    OneHotEncoder,
    OrdinalEncoder,
    PolynomialFeatures,
    PowerTransformer,
    QuantileTransformer,
    RobustScaler,
    SplineTransformer,
    StandardScaler,
    TargetEncoder,
)
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
    "PolynomialFeatures": (PolynomialFeatures(3), None),
    "PolynomialFeatures of pairs": (PolynomialFeatures((2, 3), interaction_only=True, include_bias=False), None),
    "Normalizer": (Normalizer(), None),
    "Normalizer, l1": (Normalizer("l1"), None),
    "Normalizer, maximum": (Normalizer("max"), None),
    "frozen": (FrozenEstimator(StandardScaler().fit(X)), None),
    "sines": (FunctionTransformer(np.sin), None),
    "arc tangents": (FunctionTransformer(np.arctan), None),
    "cosines": (FunctionTransformer(np.cos), None),
    "PowerTransformer": (PowerTransformer(), None),
    "PowerTransformer, plain": (PowerTransformer(standardize=False), None),
    "KMeans": (KMeans(3, random_state=0, n_init=1), None),
    "RBFSampler": (RBFSampler(gamma=0.3, n_components=5, random_state=0), None),
    "Nystroem": (Nystroem(gamma=0.2, n_components=6, random_state=0), None),
    "Nystroem, polynomial": (Nystroem("poly", n_components=4, degree=2, random_state=0), None),
    "Nystroem, polynomial in full": (Nystroem("polynomial", n_components=4, degree=2, random_state=0), None),
    "SparseRandomProjection": (random_projection.SparseRandomProjection(2, random_state=1, density=0.7), None),
    "FactorAnalysis": (decomposition.FactorAnalysis(2), None),
    "FeatureAgglomeration": (cluster.FeatureAgglomeration(2), None),
    **{
        f"KernelPCA, {kernel}": (decomposition.KernelPCA(2, kernel=kernel, gamma=0.3, degree=2), None)
        for kernel in ("linear", "poly", "rbf", "sigmoid")
    },
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


GAPS = np.where(np.random.default_rng(5).random(X.shape) < 0.2, np.nan, X)
CODES = np.column_stack([np.digitize(X[:, 0], [-1, 0, 1]) * 1.5 - 2.0, np.round(X[:, 1] / 5), THREE])
CODES_WITH_GAPS = np.where(np.isnan(GAPS), np.nan, CODES)
#: Beside, between and far from categories.
NEAR_CODES = np.vstack([CODES, np.nextafter(CODES, 9.0), CODES + 0.5, 100.0 - CODES, CODES_WITH_GAPS])

INFINITE = np.where(SCORE[:, None] > 0.5, -np.inf, X)
UNKNOWN_IS_MISSING = OrdinalEncoder(handle_unknown="use_encoded_value", unknown_value=np.nan)

#: Hours of days, and numbers on, beside and between them, some days before and behind.
HOURS = np.arange(len(X))[:, None] % 24.0
AROUND = np.concatenate([HOURS, HOURS - 48.0, HOURS + 24.0 * 365, np.nextafter(HOURS, 99.0), HOURS + 0.37, HOURS - 0.1])
#: Rows of which many have no column in common, and one has none at all.
SPARSE = np.where(np.random.default_rng(6).random(X.shape) < 0.6, np.nan, X)
SPARSE[0] = np.nan

#: Estimator, training data, answers, rows to try.
PIECES = {
    "imputer": (SimpleImputer(add_indicator=True), GAPS, GAPS),
    "imputer, median": (SimpleImputer(strategy="median"), GAPS, GAPS),
    "imputer of a number": (SimpleImputer(missing_values=0.0, strategy="constant", fill_value=-3.5), CODES, NEAR_CODES),
    "imputer of a number, indicated": (
        SimpleImputer(missing_values=1.0, strategy="most_frequent", add_indicator=True),
        CODES,
        NEAR_CODES,
    ),
    "imputer, an empty column": (SimpleImputer(), np.column_stack([GAPS, np.full(len(GAPS), np.nan)]), None),
    "indicator": (MissingIndicator(features="all"), GAPS, GAPS),
    "indicator of some": (MissingIndicator(), np.column_stack([X[:, 0], GAPS[:, 1:]]), GAPS),
    "ordinal": (OrdinalEncoder(), CODES, NEAR_CODES),
    "ordinal, unknown": (
        OrdinalEncoder(handle_unknown="use_encoded_value", unknown_value=-1, encoded_missing_value=-2),
        CODES_WITH_GAPS,
        NEAR_CODES,
    ),
    "ordinal, missing stays missing": (OrdinalEncoder(), CODES_WITH_GAPS, NEAR_CODES),
    "ordinal, rare": (OrdinalEncoder(min_frequency=30), CODES, NEAR_CODES),
    "one hot": (OneHotEncoder(), CODES, NEAR_CODES),
    "one hot, ignoring": (OneHotEncoder(handle_unknown="ignore", drop="first"), CODES_WITH_GAPS, NEAR_CODES),
    "one hot, rare": (
        OneHotEncoder(handle_unknown="infrequent_if_exist", min_frequency=40, sparse_output=False),
        CODES,
        NEAR_CODES,
    ),
    "one hot, binary dropped": (OneHotEncoder(drop="if_binary"), (CODES > 0) * 1.0, (NEAR_CODES > 0) * 1.0),
    "target": (TargetEncoder(random_state=0), CODES, NEAR_CODES),
    "bins": (KBinsDiscretizer(4, encode="ordinal"), X, None),
    "bins, one hot": (KBinsDiscretizer([2, 3, 4], encode="onehot"), X, None),
    "binarizer": (Binarizer(threshold=0.25), X, None),
    "quantiles": (QuantileTransformer(n_quantiles=30), X, None),
    "quantiles of a normal distribution": (
        QuantileTransformer(n_quantiles=30, output_distribution="normal"),
        X,
        np.vstack([X, *(X + one for one in (1e-7, -1e-7, 0.999e-7, -0.999e-7))]),
    ),
    "quantiles of a normal distribution of few numbers": (
        QuantileTransformer(n_quantiles=50, output_distribution="normal"),
        np.round(CODES),
        NEAR_CODES,
    ),
    "quantiles of large numbers beside a constant": (
        QuantileTransformer(n_quantiles=7, output_distribution="normal"),
        np.column_stack([1e12 + np.round(X[:, 0]), np.full(len(X), 5.0), 1e-8 * np.round(X[:, 2])]),
        None,
    ),
    "quantiles of few numbers": (QuantileTransformer(n_quantiles=50), np.round(CODES), NEAR_CODES),
    "splines": (SplineTransformer(), X, None),
    "splines, quadratic": (SplineTransformer(6, degree=2, knots="quantile", include_bias=False), X, None),
    "splines, on lines": (SplineTransformer(extrapolation="linear", include_bias=False), X, None),
    "quadratic splines, on lines": (
        SplineTransformer(4, degree=2, knots="quantile", extrapolation="linear", handle_missing="zeros"),
        np.where(X[3, 0] == X, np.nan, X),
        None,
    ),
    "splines and no more": (SplineTransformer(extrapolation="error"), X, None),
    **{
        f"splines of hours, degree {degree}, {missing}": (
            SplineTransformer(
                degree=degree,
                knots=np.linspace(0.0, 24.0, 7)[:, None],
                extrapolation="periodic",
                include_bias=degree == 3,
                handle_missing=missing,
            ),
            HOURS if missing == "error" else np.where(HOURS == 7.0, np.nan, HOURS),
            AROUND,
        )
        for degree, missing in ((1, "error"), (2, "zeros"), (3, "error"))
    },
    "imputer by neighbours": (KNNImputer(n_neighbors=3), GAPS, GAPS),
    "imputer by one neighbour": (KNNImputer(n_neighbors=1, add_indicator=True), GAPS, GAPS + 0.01),
    "imputer by weighted neighbours": (KNNImputer(n_neighbors=4, weights="distance"), GAPS, GAPS + 0.013),
    "imputer by neighbours of complete rows": (KNNImputer(n_neighbors=4), X, GAPS),
    "imputer by neighbours, of a number": (
        KNNImputer(missing_values=-9.0),
        np.where(np.isnan(GAPS), -9.0, X),
        np.where(np.isnan(GAPS), -9.0, 1.1 * X),
    ),
    "imputer by neighbours, an empty column": (
        KNNImputer(n_neighbors=2, keep_empty_features=True),
        np.column_stack([GAPS[:, :2], np.full(len(GAPS), np.nan)]),
        GAPS,
    ),
    "imputer by neighbours that are few": (KNNImputer(n_neighbors=300), SPARSE, np.vstack([SPARSE, GAPS])),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PIECES)
def test_functions_in_pieces(name, tmp_path):
    estimator, x, rows = PIECES[name]
    model = loaded(fit(estimator, x, SCORE))
    report = verified(model, tmp_path, rows=200)
    assert report.exact or any(word in name for word in ("splines", "quantiles", "neighbour"))
    rows = np.vstack([x, x * 1.0001, x * 3 - 1]) if rows is None else rows
    usable, bound = agrees(model, rows)
    # where several rows are equally near, and a column alone decides, the library takes any of them
    # a share of 1e-7 is led by a slope of 2e6
    assert np.max(bound) < (1e-10 if "normal" in name else 1e-12) or (
        "neighbour" in name and np.mean(np.max(bound, axis=1) < 1e-7) > 0.6
    )
    # what the block refuses the library refuses too, or has no number for
    refused = rows[~usable]
    for row in refused[:: max(len(refused) // 10, 1)]:
        with contextlib.suppress(ValueError):
            assert not np.isfinite(model.predict(row[None])).all()


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("large", [2.0**20, 2.0**30, -(2.0**30), 3e9, -3e9, 1e308])
def test_a_large_constant_is_neither_end_of_a_normal_distribution(large, count):
    """The library adds 1e-7, which leaves large numbers as they are."""
    estimator = QuantileTransformer(n_quantiles=count, output_distribution="normal")
    model = loaded(estimator.fit(np.full((9, 1), large)))
    beside = np.array([np.nextafter(large, -np.inf), large, np.nextafter(large, np.inf)])
    usable, _ = agrees(model, beside[:, None])
    assert usable.all()


@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_quantiles_further_apart_than_the_largest_number_are_refused(distribution):
    """The library has NaN between them, or a step."""
    estimator = QuantileTransformer(n_quantiles=2, output_distribution=distribution)
    with pytest.raises(UnsupportedModelError, match="further apart than the largest number: scale the data down"):
        loaded(fit(estimator, np.array([[-1.7e308], [0.0], [1.7e308]]), None))


def test_periods_of_many_digits_are_led_back_within_a_bound(tmp_path):
    periodic = SplineTransformer(5, extrapolation="periodic").fit(X)
    model = loaded(periodic)
    verified(model, tmp_path, rows=300)
    knots = np.array([spline.t[[3, -4]] for spline in periodic.bsplines_])
    period = knots[:, 1] - knots[:, 0]
    turns = np.random.default_rng(0).integers(-1000, 1000, X.shape)
    usable, bound = agrees(model, np.vstack([X + turns * period, knots.T, np.nextafter(knots.T, 0.0), 1e7 * X]))
    # on the ends it is open to which of them a number is led back, and further away than 2**20 periods nothing is said
    assert usable[: len(X)].all() and np.median(bound) < 1e-9
    assert np.isnan(reference.evaluate(model.ir, 1e9 * X + 1e8)).all(axis=1).all()


def test_a_number_that_is_imputed_may_lead_trees_both_ways_and_one_that_was_there_does_not(tmp_path):
    for trees in (DecisionTreeClassifier(max_depth=4, random_state=0), RandomForestRegressor(4, random_state=0)):
        model = loaded(fit(make_pipeline(KNNImputer(n_neighbors=2), trees), GAPS, THREE))
        verified(model, tmp_path, rows=200)
        assert not agrees(model, X)[1].any()
        agrees(model, np.vstack([GAPS, GAPS[::-1], np.full((1, 3), np.nan)]))


@pytest.mark.parametrize(
    "encoder",
    [OrdinalEncoder(), OneHotEncoder(), SplineTransformer(extrapolation="error"), FunctionTransformer(np.log)],
)
@pytest.mark.parametrize("trees", [DecisionTreeClassifier(max_depth=2), RandomForestRegressor(3, max_depth=2)])
@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_what_no_tree_compares_still_refuses_what_the_library_refuses(encoder, trees, target, tmp_path):
    """The trees ask for the second column only; an unknown category in the first has no answer all the same."""
    x = np.column_stack([1.0 + np.arange(len(X)) % 3, X[:, 0]])
    front = ColumnTransformer([("kinds", encoder, [0])], remainder="passthrough", sparse_threshold=0.0)
    model = loaded(fit(make_pipeline(front, trees), x, X[:, 0] > 0.2))
    report = verified(model, tmp_path, target, rows=200)
    assert report.exact
    usable, _ = agrees(model, np.vstack([x, [[-1.0, 0.3]]]))
    assert usable[:-1].all() and not usable[-1]


@pytest.mark.parametrize("bounds_rule", ["nan", "clip", "raise"])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_isotonic_regression(bounds_rule, kind, tmp_path):
    x = X[:, 1].astype(kind)
    model = loaded(IsotonicRegression(out_of_bounds=bounds_rule).fit(x, (SCORE + 0.3 * X[:, 1]).astype(kind)))
    verified(model, tmp_path, rows=300)
    rows = np.concatenate([x, np.nextafter(x, 9), [-50.0, 50.0]]).astype(float)[:, None]
    usable, bound = agrees(model, rows)
    assert usable[:-2].mean() > 0.98 and usable[-1] == (bounds_rule == "clip")
    assert np.max(bound) < (1e-12 if kind is np.float64 else 1e-5)


def test_pieces_behind_an_inexact_step_say_how_far_they_may_jump():
    model = loaded(
        fit(make_pipeline(decomposition.PCA(1), KBinsDiscretizer(4, encode="ordinal"), linear_model.Ridge()), X, SCORE)
    )
    usable, bound = agrees(model, ROWS)
    assert usable.all() and np.median(bound) < 1e-12
    # the projection of this row is the edge of a bin but for its rounding
    weights, bias = model.ir.ops[0].weights[0], model.ir.ops[0].bias[0]
    row = X[:1].copy()
    row[0, 0] = (model.ir.ops[1].knots[1] - bias - row[0, 1:] @ weights[1:]) / weights[0]
    assert bounds.difference_bound(model.ir, row)[0, 0] > 0.01


def test_missing_values_reach_trees_behind_an_imputer_as_numbers(tmp_path):
    partly = ColumnTransformer([("a", SimpleImputer(), [0]), ("b", "passthrough", [1, 2])])
    for trees in (HistGradientBoostingRegressor(max_iter=8), make_pipeline(SimpleImputer(), RandomForestRegressor(4))):
        report = verified(loaded(fit(make_pipeline(partly, trees), GAPS, SCORE)), tmp_path, rows=400)
        assert report.exact


def test_what_an_imputer_takes_is_refused_beside_it(tmp_path):
    partly = ColumnTransformer([("a", SimpleImputer(), [0]), ("b", StandardScaler(), [1, 2])])
    x = np.column_stack([GAPS[:, 0], X[:, 1:]])
    model = loaded(fit(make_pipeline(partly, linear_model.Ridge()), x, SCORE))
    assert model.ir.must_be_present == (1, 2)
    for target in ("twincat", "iec", "plcopen"):
        verified(model, tmp_path, target, rows=200)
    usable, _ = agrees(model, GAPS)
    assert np.array_equal(usable, ~np.isnan(GAPS[:, 1:]).any(axis=1))


@pytest.mark.thorough
@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize("categorical", [None, [0, 1]])
@pytest.mark.parametrize("x", [CODES, CODES_WITH_GAPS], ids=["complete", "gaps"])
def test_unknown_categories_are_missing_to_trees(precision, categorical, x, tmp_path):
    encoder = sklearn.clone(UNKNOWN_IS_MISSING).set_params(dtype=precision)
    front = ColumnTransformer([("kinds", encoder, [0, 1])], remainder="passthrough")
    trees = HistGradientBoostingRegressor(max_iter=12, min_samples_leaf=2, categorical_features=categorical)
    model = loaded(fit(make_pipeline(front, trees), x, SCORE + 5.0 * np.isnan(x).sum(axis=1)))
    assert verified(model, tmp_path, rows=300).exact
    unknown = np.vstack([[[99.0, 0.0, 1.0], [np.nan, -99.0, 1.0], [-2.0, 7.5, 0.0], [99.0, 99.0, 0.0]], NEAR_CODES])
    usable, bound = agrees(model, unknown)
    assert usable.all() and not bound.any()
    # the number that stands for them is no code: the answer to an unknown category differs from one to a known one
    known = np.where(unknown == 99.0, x[0], unknown)
    assert np.any(model.predict(unknown) != model.predict(known))


@pytest.mark.parametrize(
    "trees", [RandomForestRegressor(3, random_state=0), make_pipeline(MaxAbsScaler(), DecisionTreeClassifier())]
)
def test_trees_take_no_missing_value_in_a_sparse_matrix(trees, tmp_path):
    """The library takes NaN in dense rows only, and one-hot columns beside others are sparse where there are many."""
    x = np.column_stack([X[:, 0], np.arange(len(X)) % 12])
    front = ColumnTransformer([("kinds", OneHotEncoder(), [1])], remainder="passthrough")
    model = loaded(fit(make_pipeline(front, trees), x, THREE))
    assert model.ir.takes_nan(0) is False
    assert verified(model, tmp_path, rows=300).exact


@pytest.mark.thorough
@pytest.mark.parametrize(
    "step",
    [
        StandardScaler(with_mean=False),
        RobustScaler(with_centering=False),
        MaxAbsScaler(),
        PolynomialFeatures(3),
        PolynomialFeatures(4, interaction_only=True),
        Normalizer("max"),
    ],
)
def test_steps_on_a_sparse_matrix_round_as_the_library_does(step, tmp_path):
    """It multiplies by the reciprocal of a scale, and by columns in another order, where a dense array is divided."""
    x = np.column_stack([X, np.arange(len(X)) % 12])
    front = ColumnTransformer([("kinds", OneHotEncoder(), [3])], remainder="passthrough")
    last = RandomForestRegressor(5, max_depth=6, random_state=0)
    model = loaded(fit(make_pipeline(front, step, last), x, SCORE))
    middle = fit(make_pipeline(front, step), x, SCORE)
    assert sparse.issparse(middle.transform(x))
    columns = loaded(middle)
    rows = np.column_stack([np.vstack([X, X * 3.7, X[::-1] / 7.0]), np.arange(3 * len(X)) % 12])
    dense = middle.transform(rows).toarray()
    assert np.array_equal(reference.evaluate(columns.ir, rows), dense)
    assert verified(model, tmp_path, rows=1000).exact


ONE_CONSTANT = np.column_stack([np.ones(len(X)), X[:, :2]])
DROPPED, DENSE = (OneHotEncoder(drop="first", sparse_output=one) for one in (True, False))
EMPTY = {
    "column": ColumnTransformer([("kind", DROPPED, [0])], remainder="passthrough"),
    "only some": ColumnTransformer([("kind", DROPPED, [0]), ("rest", StandardScaler(), [2])]),
    "unknown is ignored": ColumnTransformer(
        [("kind", OneHotEncoder(drop="first", handle_unknown="ignore"), [0])], remainder=StandardScaler()
    ),
    "union": FeatureUnion([("none", SelectKBest(k=0)), ("all", StandardScaler())]),
    "union of pipelines": FeatureUnion(
        [("all", "passthrough"), ("none", make_pipeline(StandardScaler(), decomposition.PCA(0)))]
    ),
}


@pytest.mark.parametrize("target", ["iec", "scl"])
@pytest.mark.parametrize("name", EMPTY)
def test_a_part_that_keeps_no_column_adds_none(name, target, tmp_path):
    """The library takes it; what it refuses, such as an unknown category, has no answer all the same."""
    trees = DecisionTreeClassifier(max_depth=4, random_state=0)
    fitted = fit(make_pipeline(EMPTY[name], trees), ONE_CONSTANT, THREE)
    model = loaded(fitted, ())
    verified(model, tmp_path / "out", target=target, rows=300)
    usable, bound = agrees(model, ONE_CONSTANT)
    assert usable.all() and not bound.any()
    other = ONE_CONSTANT + np.array([1.0, 0.0, 0.0])
    answered = np.isfinite(reference.evaluate(model.ir, other)).all(axis=1)
    assert answered.all() if name not in ("column", "only some") else not answered.any()
    if not answered.any():
        with pytest.raises(ValueError, match="unknown categories"):
            fitted.predict(other)


@pytest.mark.parametrize("x", [X[:1], np.repeat(X[:1], 9, axis=0)], ids=["one row", "one number"])
def test_quantiles_of_one_number(x, tmp_path):
    model = loaded(QuantileTransformer(n_quantiles=5).fit(x))
    verified(model, tmp_path, rows=300)
    rows = np.vstack([X, x, np.nextafter(x, 9.0)])
    usable, _ = agrees(model, rows)
    assert usable.all()
    assert np.array_equal(reference.evaluate(model.ir, rows), model.predict(rows))


@pytest.mark.parametrize(
    ("estimator", "x", "message"),
    [
        (decomposition.PCA(0), X, "PCA keeps no column"),
        (FeatureUnion([("none", decomposition.PCA(0))]), X, "FeatureUnion drops every transformer"),
        (ColumnTransformer([("kind", DENSE, [0])]), ONE_CONSTANT, "ColumnTransformer drops every column"),
        # not the union as a whole, of which the other one keeps some
        (
            FeatureUnion(
                [
                    (
                        "inner",
                        FeatureUnion(
                            [
                                ("none", decomposition.PCA(0)),
                                ("kind", OneHotEncoder(dtype=np.float32, sparse_output=False, handle_unknown="ignore")),
                            ]
                        ),
                    ),
                    ("scaled", RobustScaler()),
                ]
            ),
            np.round(X),
            "PCA keeps no column beside columns of float32 only",
        ),
        (decomposition.KernelPCA(), X * 0.0, "KernelPCA keeps no column"),
        (decomposition.FactorAnalysis(0), X, "FactorAnalysis keeps no column"),
        (
            PolynomialFeatures((9, 9), interaction_only=True, include_bias=False),
            X,
            "PolynomialFeatures keeps no column",
        ),
        (GaussianNB(priors=[0.5, 0.5, 0.0]), X, "class number 2 has a prior of 0"),
        (RobustScaler(quantile_range=(0, 100), unit_variance=True), X, "RobustScaler divides by 0"),
        (HistGradientBoostingRegressor(max_iter=3), INFINITE, "a split at -infinity, as training data with infinities"),
        (SplineTransformer(extrapolation="continue"), X, "extrapolation='continue'"),
        (SplineTransformer(), X * [1.0, 0.0, 1.0], "column 1 has knots that are equal or fall, .*: leave it out$"),
        (SplineTransformer(knots="quantile"), (X > 1.5) * 1.0, "leave it out, or take fewer n_knots or knots='uni"),
        (
            cluster.AffinityPropagation(max_iter=1, damping=0.95, random_state=0),
            X,
            "AffinityPropagation found no clusters, since it did not converge",
        ),
        (SplineTransformer(2, degree=1, extrapolation="periodic", include_bias=False), X, "gives no column"),
        (KNNImputer(), GAPS * np.nan, "columns that were all missing in training"),
        (KNNImputer(metric=metrics.pairwise.nan_euclidean_distances), GAPS, "supported is 'nan_euclidean'"),
        (KNNImputer(weights=np.sqrt), GAPS, "weights=a function: supported are uniform, distance"),
        (decomposition.KernelPCA(2, kernel="cosine"), X, "kernel=cosine: supported are linear, poly, rbf, sigmoid"),
        (
            decomposition.KernelPCA(2, kernel="poly", degree=1.5),
            np.abs(X),
            "degree=1.5: supported are the whole numbers",
        ),
        (cluster.FeatureAgglomeration(2, pooling_func=np.max), X, "a pooling_func other than numpy.mean"),
        (SplineTransformer(extrapolation="linear", degree=1), X, "extrapolation='linear' and degree=1"),
        (OneHotEncoder(), np.array([["a"], ["b"]] * 150), "categories that are no numbers"),
        (OneHotEncoder(), np.array([[2**53], [2**53 + 1]] * 150), "column 0 has categories that are equal as LREAL"),
        (UNKNOWN_IS_MISSING, CODES, "makes NaN of unknown categories"),
        (make_pipeline(UNKNOWN_IS_MISSING, SimpleImputer(), linear_model.Ridge()), CODES, "choose a number for them"),
        (make_pipeline(UNKNOWN_IS_MISSING, linear_model.Ridge()), CODES, "choose a number for them"),
    ],
)
def test_what_is_refused_says_why(estimator, x, message):
    with pytest.raises(UnsupportedModelError, match=message):
        loaded(fit(estimator, x, THREE if isinstance(estimator, GaussianNB) else SCORE))


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


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name, (e, _) in TRANSFORMERS.items() if not hasattr(e, "predict")])
def test_transformers_alone_are_verified(name, tmp_path):
    estimator, y = TRANSFORMERS[name]
    verified(loaded(fit(estimator, X, y)), tmp_path, rows=300)
    fitted = fit(estimator, X, y)
    columns = np.asarray(fitted.transform(X))
    assert np.array_equal(loaded(fitted).predict(X)[:, : columns.shape[1]], columns)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "function",
    [
        *(np.negative, np.deg2rad, np.radians, np.rad2deg, np.degrees, np.reciprocal, np.fabs, np.positive, np.sign),
        *(np.floor, np.ceil, np.rint, np.trunc),
    ],
)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_functions_of_one_operation_are_exact(function, dtype):
    codes = np.arange(1.0, 400.0)[:, None] * [0.7, 1.3, -11.0]
    steps = [FunctionTransformer(function)]
    if dtype == np.float32:
        steps.insert(0, OrdinalEncoder(dtype=np.float32))
    model = loaded(make_pipeline(*steps).fit(codes))
    rows = codes[1:]
    if dtype == np.float64:
        rows = np.vstack([rows, [[5e-324, -1e-300, 1e300], [-0.0, 1e-310, -1e16]]])
    found, library = reference.evaluate(model.ir, rows), model.predict(rows)
    answered = np.isfinite(found).all(axis=1)
    assert model.ir.exact and answered[:-2].all() and np.array_equal(found[answered], library[answered])
    assert not np.isfinite(library[~answered]).all(axis=1).any()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_tangents_lie_within_their_bound_up_to_the_poles(dtype, tmp_path):
    poles = np.pi * (np.arange(-5, 5) + 0.5)
    x = np.concatenate([np.linspace(-9.0, 9.0, 400), poles, poles + 1e-9, [0.0, 1e-300, -1e-9, 9e5]])[:, None]
    steps = [FunctionTransformer(np.tan)]
    if dtype == np.float32:
        x = np.arange(1.0, 60.0)[:, None]
        steps.insert(0, OrdinalEncoder(dtype=np.float32))
    model = loaded(make_pipeline(*steps).fit(x))
    found, library, bound = (
        reference.evaluate(model.ir, x),
        model.predict(x),
        bounds.difference_bound(model.ir, x),
    )
    assert np.all(np.isfinite(found)) and np.all(np.abs(found - library) <= bound) and not model.ir.exact
    assert np.median(bound / np.maximum(np.abs(library), 1e-3)) < 100 * np.finfo(dtype).eps
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("function", [np.log10, np.log2, np.exp2])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_logarithms_and_powers_of_other_bases_lie_within_their_bound(function, dtype):
    """Near 1, where logarithms are small, over all magnitudes, and where a number lies beside a power of the base."""
    codes = np.sort(np.concatenate([np.geomspace(1e-30, 1e30, 200), 1.0 + np.arange(-9, 10) * 2.0**-20, [8.0, 1e3]]))
    codes = codes[codes < 1000.0] if function is np.exp2 else codes
    codes = codes.astype(dtype).astype(np.float64)[:, None]
    steps = [OrdinalEncoder(dtype=dtype), FunctionTransformer(np.log1p)] if dtype == np.float32 else []
    x = np.arange(1.0, 60.0)[:, None] if steps else codes
    model = loaded(make_pipeline(*steps, FunctionTransformer(function)).fit(x))
    x = x[1:] if steps else x
    found, library = reference.evaluate(model.ir, x), model.predict(x)
    bound = bounds.difference_bound(model.ir, x)
    answered = np.isfinite(library) & np.isfinite(found)
    assert answered.mean() > 0.1 and not model.ir.exact
    assert np.all(np.abs(found - library)[answered] <= bound[answered])
    assert np.median(bound[answered] / np.maximum(np.abs(library[answered]), 1e-3)) < 2000 * np.finfo(dtype).eps


@pytest.mark.parametrize(
    "limits",
    [
        {"a_min": -1, "a_max": 0.5},
        {"min": 0.0, "max": None},
        {"a_min": None, "a_max": 0.25},
        {"a_min": 1.0, "a_max": -1},
    ],
)
def test_limits_of_clip(limits, tmp_path):
    """Limits that are turned around, too: the library then gives the upper one."""
    report = verified(loaded(FunctionTransformer(np.clip, kw_args=limits).fit(X)), tmp_path, rows=300)
    assert report.exact and not report.silent


def test_the_bound_of_principal_components_covers_a_mean_that_cancels():
    x = X + 1e7
    model = loaded(decomposition.PCA(2).fit(x))
    _, bound = agrees(model, x)
    assert np.all(bound[:, :2] > 1e-10)


def test_a_step_that_transforms_is_not_taken_for_one_that_predicts():
    model = fit(make_pipeline(RFE(linear_model.Ridge(), n_features_to_select=2), linear_model.Ridge()), X, SCORE)
    agrees(loaded(model), ROWS)
    with pytest.raises(UnsupportedModelError, match="Birch is compiled where it predicts, not as a step"):
        loaded(fit(make_pipeline(cluster.Birch(threshold=1.0), linear_model.Ridge()), X, SCORE))


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


def test_missing_values_in_eliminated_columns_are_refused_where_the_library_refuses_them(tmp_path):
    """RFE checks all columns, also those that it leaves out; the block had an answer to such rows."""
    columns = ColumnTransformer([("a", SimpleImputer(), [0])], remainder="passthrough")
    ridge = RFE(linear_model.Ridge(), n_features_to_select=1)
    model = loaded(fit(make_pipeline(columns, ridge), X, SCORE))
    assert model.ir.must_be_present == (1, 2)
    verified(model, tmp_path, "iec", rows=200)
    trees = RFE(DecisionTreeClassifier(max_depth=3), n_features_to_select=1)  # takes missing values where they do
    assert loaded(fit(make_pipeline(columns, trees), X, THREE)).ir.must_be_present == ()


def test_a_label_behind_selected_columns(tmp_path):
    pipeline = make_pipeline(SelectKBest(k=2), StandardScaler(), DecisionTreeClassifier(max_depth=4, random_state=0))
    report = verified(loaded(fit(pipeline, X, THREE)), tmp_path)
    assert report.exact and not report.open_rows


def test_rows_are_tried_that_encoders_of_several_columns_take(tmp_path):
    """The encoders refuse all but their categories: rows of numbers between the ends would all be refused."""
    codes = np.random.default_rng(3).integers([0, 10, -3], [7, 13, 9], size=(300, 3)) * 0.5
    model = loaded(fit(make_pipeline(OneHotEncoder(), DecisionTreeClassifier(max_depth=4)), codes, THREE))
    report = verified(model, tmp_path, rows=600)
    assert report.exact and report.unanswered < 0.7 * report.n


def test_an_encoder_of_many_categories_is_asked_about_many_at_once(monkeypatch):
    x = np.arange(3000.0)[:, None]
    encoder = OrdinalEncoder().fit(x)
    transform, calls = OrdinalEncoder.transform, []
    monkeypatch.setattr(
        OrdinalEncoder, "transform", lambda self, rows: calls.append(len(rows)) or transform(self, rows)
    )
    model = loaded(encoder)
    assert len(calls) < 40
    assert np.array_equal(reference.evaluate(model.ir, x)[:, 0], x[:, 0])
    assert np.isnan(reference.evaluate(model.ir, np.array([[3000.0], [0.5], [-1.0]]))).all()
