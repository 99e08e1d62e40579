"""How scikit-learn holds numbers between the parts of a composition: in float32, and as sparse matrices.

Predictions of XGBoost and what encoders with dtype=float32 make are float32, and NumPy goes on computing in it. What a
sparse matrix does not store is missing to XGBoost and zero to all others.
"""

import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("xgboost")

import xgboost
from scipy.sparse import csc_matrix, csr_matrix
from sklearn import ensemble, linear_model, multiclass, multioutput
from sklearn.calibration import CalibratedClassifierCV
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.feature_selection import VarianceThreshold
from sklearn.isotonic import IsotonicRegression
from sklearn.model_selection import GridSearchCV
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    KBinsDiscretizer,
    MaxAbsScaler,
    MinMaxScaler,
    OneHotEncoder,
    OrdinalEncoder,
    PolynomialFeatures,
    RobustScaler,
    StandardScaler,
)
from sklearn.svm import SVC, SVR, NuSVR, OneClassSVM
from sklearn.tree import DecisionTreeRegressor

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.proof import bounds
from tests.classifiers import SCORE, THREE, TWO, X, loaded, verified

ABOVE = np.exp(SCORE / 4)
THREE_NUMBERS = np.column_stack([SCORE, SCORE**2 - X[:, 1], X[:, 0]])
#: Columns of a few whole numbers, and rows of them with numbers that are no category.
CODES = np.column_stack([THREE, np.digitize(X[:, 1], [-6.0, -2.0, 1.0, 5.0]), np.digitize(X[:, 2], [0.0])]).astype(
    float
)
OTHER = np.vstack([CODES, CODES[::-1, ::-1], CODES + 0.5, -CODES])


def numbers(rate=0.3, **parameters):
    return xgboost.XGBRegressor(n_estimators=4, max_depth=3, learning_rate=rate, n_jobs=1, **parameters)


def classes(rate=0.3, **parameters):
    return xgboost.XGBClassifier(n_estimators=4, max_depth=3, learning_rate=rate, n_jobs=1, **parameters)


def target(**parameters):
    return TransformedTargetRegressor(numbers(), check_inverse=False, **parameters)


def stack(last, **parameters):
    return ensemble.StackingRegressor([("a", numbers()), ("b", numbers(0.1))], last, cv=2, **parameters)


def single(**parameters):
    return OneHotEncoder(dtype=np.float32, handle_unknown="ignore", **parameters)


def sparse(**parameters):
    return OneHotEncoder(handle_unknown="ignore", **parameters)


def ordinal():
    return OrdinalEncoder(dtype=np.float32, handle_unknown="use_encoded_value", unknown_value=-1)


TRIO = [("a", numbers()), ("b", numbers(0.1)), ("c", numbers(0.7))]
IN_SINGLE = {
    "bag": (ensemble.BaggingRegressor(numbers(), 3, random_state=0), X, SCORE),
    "bag of several outputs": (ensemble.BaggingRegressor(numbers(), 3, random_state=0), X, THREE_NUMBERS),
    "target behind a function": (target(func=np.log, inverse_func=np.exp), X, ABOVE),
    "target between two numbers": (target(transformer=MinMaxScaler()), X, SCORE),
    "standardised target": (target(transformer=StandardScaler()), X, THREE_NUMBERS),
    "target by its quartiles": (target(transformer=RobustScaler()), X, SCORE),
    "bag of targets": (ensemble.BaggingRegressor(target(func=np.log, inverse_func=np.exp), 3), X, ABOVE),
    "median": (
        TransformedTargetRegressor(
            ensemble.AdaBoostRegressor(numbers(), n_estimators=3, random_state=0), transformer=MaxAbsScaler()
        ),
        X,
        SCORE,
    ),
    "mean": (ensemble.VotingRegressor(TRIO), X, SCORE),
    "weighted mean": (ensemble.VotingRegressor(TRIO, weights=[1, 2, 3]), X, SCORE),
    "mean with others": (ensemble.VotingRegressor([*TRIO, ("d", linear_model.Ridge())]), X, SCORE),
    "soft votes": (ensemble.VotingClassifier([("a", classes()), ("b", classes(0.1))], voting="soft"), X, THREE),
    "stack": (stack(linear_model.Ridge()), X, SCORE),
    "stack with inputs": (stack(linear_model.Ridge(), passthrough=True), X, SCORE),
    "stack under a logarithm": (stack(linear_model.PoissonRegressor()), X, ABOVE),
    "stack under a scaler": (stack(make_pipeline(StandardScaler(), linear_model.Lasso(0.01))), X, SCORE),
    "stack under a machine": (stack(SVR()), X, SCORE),
    "stack under trees": (stack(DecisionTreeRegressor(max_depth=3)), X, SCORE),
    "stack of classes": (
        ensemble.StackingClassifier([("a", classes()), ("b", classes(0.1))], linear_model.LogisticRegression(), cv=2),
        X,
        THREE,
    ),
    "target of a chain": (
        TransformedTargetRegressor(multioutput.RegressorChain(numbers()), transformer=MinMaxScaler()),
        X,
        THREE_NUMBERS,
    ),
    "calibrated in steps": (CalibratedClassifierCV(classes(), method="isotonic", cv=2), X, THREE),
    "steps": (
        IsotonicRegression(out_of_bounds="clip"),
        X[:, 1:2].astype(np.float32),
        (SCORE + 0.3 * X[:, 1]).astype(np.float32),
    ),
    "categories and a sum": (make_pipeline(single(), linear_model.Ridge()), CODES, SCORE),
    "categories, scaled": (make_pipeline(single(sparse_output=False), StandardScaler()), CODES, SCORE),
    "categories, weighted": (
        make_pipeline(FeatureUnion([("a", ordinal())], transformer_weights={"a": 0.3}), linear_model.Ridge()),
        CODES,
        SCORE,
    ),
    "codes, scaled": (make_pipeline(ordinal(), StandardScaler(), linear_model.Ridge()), CODES, SCORE),
    "codes in a function": (
        make_pipeline(
            OrdinalEncoder(dtype=np.float32, handle_unknown="use_encoded_value", unknown_value=7),
            FunctionTransformer(np.log1p),
            linear_model.Ridge(),
        ),
        CODES,
        SCORE,
    ),
    "codes and classes": (make_pipeline(ordinal(), linear_model.LogisticRegression()), CODES, TWO),
    "codes and a network": (
        make_pipeline(ordinal(), MLPClassifier(hidden_layer_sizes=(4,), max_iter=20, random_state=0)),
        CODES,
        THREE,
    ),
}


def fit(estimator, x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return estimator.fit(x, y)


def rows_for(model, x):
    rows = OTHER if x is CODES else np.vstack([x, 3 * x[::-1, ::-1]]).astype(np.float64)
    return rows[reference.valid_rows(model.ir, rows)]


@pytest.mark.thorough
@pytest.mark.parametrize("name", IN_SINGLE)
def test_what_scikit_learn_computes_in_float32_lies_within_the_bound(name, tmp_path):
    estimator, x, y = IN_SINGLE[name]
    model = loaded(fit(estimator, x, y))
    rows = rows_for(model, x)
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    bound = bounds.difference_bound(model.ir, rows)
    assert np.all(np.abs(library - found) <= bound)
    assert np.median(bound[:, model.ir.classes is not None :]) < 1e-4 * (1 + np.max(np.abs(found)))
    verified(model, tmp_path / "out", rows=300)


@pytest.mark.parametrize("name", ["bag", "target between two numbers", "bag of several outputs"])
def test_float32_is_followed_to_the_bit_where_the_order_of_additions_is_known(name):
    estimator, x, y = IN_SINGLE[name]
    model = loaded(fit(estimator, x, y))
    assert model.ir.exact
    assert np.array_equal(model.predict(x), reference.evaluate(model.ir, x))


@pytest.mark.parametrize(
    ("estimator", "kind"),
    [
        (stack(KNeighborsRegressor(3)), "KNeighborsRegressor reads numbers of float32 here"),
        (make_pipeline(ordinal(), PolynomialFeatures(2), linear_model.Ridge()), "PolynomialFeatures reads numbers of"),
        (make_pipeline(KBinsDiscretizer(3, dtype=np.float32), linear_model.Ridge()), "KBinsDiscretizer with dtype="),
        (
            make_pipeline(OrdinalEncoder(dtype=np.float16), linear_model.Ridge()),
            "OrdinalEncoder with dtype=float16",
        ),
    ],
)
def test_other_arithmetic_in_float32_is_refused(estimator, kind):
    with pytest.raises(UnsupportedModelError, match=kind):
        loaded(fit(estimator, CODES, SCORE))


def beside(**parameters):
    return ColumnTransformer([("codes", sparse(), [0]), ("numbers", "passthrough", [1, 2])], **parameters)


BINS = KBinsDiscretizer(3, quantile_method="averaged_inverted_cdf")
SPARSE = {
    "categories": (make_pipeline(sparse(), classes()), THREE),
    "dense categories": (make_pipeline(sparse(sparse_output=False), classes()), THREE),
    "bins": (make_pipeline(BINS, classes()), THREE),
    "union": (make_pipeline(FeatureUnion([("a", sparse()), ("b", sparse(sparse_output=False))]), classes()), THREE),
    "scaled": (make_pipeline(sparse(), StandardScaler(with_mean=False), MaxAbsScaler(), numbers()), SCORE),
    "selected": (make_pipeline(sparse(), VarianceThreshold(0.01), numbers()), SCORE),
    "made dense": (make_pipeline(beside(sparse_threshold=0), classes()), THREE),
    "rest": (make_pipeline(sparse(), multiclass.OneVsRestClassifier(classes())), THREE),
    "bag": (make_pipeline(sparse(), ensemble.BaggingRegressor(numbers(), 2, max_features=0.7)), SCORE),
    "linear": (make_pipeline(sparse(), xgboost.XGBRegressor(booster="gblinear", n_estimators=4)), SCORE),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", SPARSE)
def test_zeros_that_a_sparse_matrix_does_not_store_are_missing_to_xgboost(name, tmp_path):
    estimator, y = SPARSE[name]
    model = loaded(fit(estimator, CODES, y))
    rows = rows_for(model, CODES)
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    assert np.all(np.abs(library - found) <= bounds.difference_bound(model.ir, rows))
    assert np.max(bounds.difference_bound(model.ir, rows)) < 1e-4
    verified(model, tmp_path / "out", rows=300)


@pytest.mark.parametrize(
    "estimator",
    [
        make_pipeline(beside(sparse_threshold=1.0), numbers()),
        make_pipeline(sparse(), numbers(missing=5.0)),
        make_pipeline(sparse(), stack(numbers(), passthrough=True)),
        make_pipeline(sparse(), multioutput.RegressorChain(numbers())),
    ],
)
def test_numbers_in_a_sparse_matrix_are_refused_in_front_of_xgboost(estimator):
    y = THREE_NUMBERS if isinstance(estimator[-1], multioutput.RegressorChain) else SCORE
    with pytest.raises(UnsupportedModelError, match=r"XGBRegressor.* sparse matrix.*sparse_threshold=0"):
        loaded(fit(estimator, CODES, y))


SOME_ZEROS = np.where(np.abs(X) < 1.0, 0.0, X)
MACHINES = {
    "categories": (make_pipeline(OneHotEncoder(), SVC(kernel="poly", degree=2, decision_function_shape="ovo")), CODES),
    "radial": (SVC(break_ties=True), csc_matrix(SOME_ZEROS)),
    "linear": (NuSVR(kernel="linear"), csr_matrix(SOME_ZEROS)),
    "sigmoid": (SVR(kernel="sigmoid", gamma=0.1), csr_matrix(SOME_ZEROS)),
    "constant": (SVR(epsilon=100.0), csr_matrix(SOME_ZEROS)),
    "one class": (OneClassSVM(), csr_matrix(SOME_ZEROS)),
}


@pytest.mark.parametrize("name", MACHINES)
def test_machines_that_were_fitted_on_a_sparse_matrix(name, tmp_path):
    estimator, x = MACHINES[name]
    model = loaded(fit(estimator, x, THREE))
    verified(model, tmp_path / "out", target="iec", rows=300)


@pytest.mark.parametrize("kernel", ["linear", "rbf"])
def test_a_sparse_matrix_with_several_numbers_in_one_place_is_refused(kernel):
    """libsvm takes such numbers one by one, so that the machine is not that of their sums."""
    random = np.random.default_rng(0)
    twice = csr_matrix((random.normal(size=300), np.array([0, 0, 1] * 100), np.arange(0, 301, 3)), shape=(100, 3))
    y, added = random.normal(size=100), twice.copy()
    added.sum_duplicates()
    machine, other = (SVR(kernel=kernel).fit(x, y) for x in (twice, added))
    assert not np.allclose(machine.predict(X[:9]), other.predict(X[:9]))
    with pytest.raises(UnsupportedModelError, match=r"several numbers in one place.*sum_duplicates\(\).*before fit"):
        loaded(machine)
    loaded(other)


@pytest.mark.parametrize("name", ["support_vectors_", "_dual_coef_"])
@pytest.mark.parametrize("changed", [lambda matrix: matrix.toarray(), csc_matrix, lambda matrix: matrix[:, ::-1]])
def test_machines_whose_sparse_matrices_are_not_as_fit_makes_them_are_refused(name, changed):
    machine = SVR(kernel="linear").fit(csr_matrix(SOME_ZEROS), SCORE)
    setattr(machine, name, changed(getattr(machine, name)))
    with pytest.raises(InputError, match="the model was changed after it was fitted, saved by another version"):
        loaded(machine)


@pytest.mark.parametrize(
    "outer", [lambda inner: make_pipeline(StandardScaler(), inner), lambda inner: GridSearchCV(inner, {}, cv=2)]
)
@pytest.mark.parametrize("objective", ["binary:logistic", "binary:logitraw", "multi:softprob"])
def test_margins_of_xgboost_that_the_whole_does_not_give_are_no_output(objective, outer, tmp_path):
    y = THREE if "multi" in objective else TWO.astype(int)
    model = loaded(fit(outer(classes(objective=objective)), X, y))
    assert "decision" not in model.ir.kinds
    verified(model, tmp_path / "out", rows=300)
