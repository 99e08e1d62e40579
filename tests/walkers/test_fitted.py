"""Estimators that `fit` did not make: refused, or predicted as the library predicts; never a crash, never a number."""

import copy
import os
import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")

import joblib
from sklearn.cluster import KMeans
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.ensemble import (
    GradientBoostingRegressor,
    HistGradientBoostingClassifier,
    HistGradientBoostingRegressor,
    RandomForestRegressor,
    VotingRegressor,
)
from sklearn.feature_selection import SelectFromModel
from sklearn.impute import SimpleImputer
from sklearn.linear_model import Lasso, LogisticRegression, Perceptron, Ridge, SGDClassifier
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, SplineTransformer, StandardScaler
from sklearn.svm import SVR, LinearSVC
from sklearn.tree import DecisionTreeRegressor
from threadpoolctl import threadpool_limits

from st_codegen.errors import InputError, StCodegenError
from st_codegen.ir import digest, reference
from st_codegen.project.bundle import load
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.objects import from_estimator, load_pickle, load_skops
from tests.fuzz.models import agrees
from tests.fuzz.objects import mutant as mutant_of
from tests.fuzz.process import Outcome, outcome

RANDOM = np.random.default_rng(3)
X = np.column_stack([RANDOM.integers(0, 5, 120), RANDOM.normal(size=(120, 2))])
Y = X[:, 0] ** 2 + X[:, 1]
SCALERS = ColumnTransformer([("a", RobustScaler(), [2, 0]), ("b", MaxAbsScaler(clip=True), [1])])
ESTIMATORS = {
    "svr": SVR(),
    "tree": DecisionTreeRegressor(max_depth=4),
    "forest": RandomForestRegressor(3, max_depth=3, random_state=0),
    "boosting": GradientBoostingRegressor(n_estimators=3, random_state=0),
    "histogram": HistGradientBoostingRegressor(max_iter=3),
    "categories": HistGradientBoostingRegressor(max_iter=3, categorical_features=[0]),
    "network": MLPRegressor(hidden_layer_sizes=(4, 3), max_iter=5, random_state=0),
    "linear": Ridge(),
    "composed": TransformedTargetRegressor(make_pipeline(SCALERS, Ridge()), transformer=StandardScaler()),
    "scaled": make_pipeline(MinMaxScaler(clip=True), StandardScaler(with_mean=False), DecisionTreeRegressor()),
}


#: Estimators that are only damaged in one way each, below.
OTHERS = {
    "selection of trees": make_pipeline(SelectFromModel(ESTIMATORS["forest"], threshold=-np.inf), Ridge()),
    "selection of weights": make_pipeline(SelectFromModel(LinearSVC(), threshold=-np.inf), Ridge()),
    "neighbours": KNeighborsRegressor(3, algorithm="brute"),
    "splines": make_pipeline(SplineTransformer(), Ridge()),
    "clusters": KMeans(2, n_init=1, random_state=0),
}


def tree_holder(other):
    """An estimator of another kind with all that stands in one."""
    holder = KMeans()
    names = ("tree_", "n_features_in_", "nodes", "raw_left_cat_bitsets")
    vars(holder).update({name: getattr(other, name) for name in names if hasattr(other, name)})
    return holder


@pytest.fixture(scope="module")
def fitted():
    # a child that is forked behind a loop of several threads hangs in its own
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        found = {name: estimator.fit(X, Y) for name, estimator in ESTIMATORS.items()}
        # positive inputs, so that knots are; labels where there have to be some
        found |= {name: copy.deepcopy(one).fit(X + 10, np.round(Y)) for name, one in OTHERS.items()}
        yield found


def check(estimator, mutants):
    """Whether an estimator, and what is accepted of its mutants, is predicted as the library does; some are refused."""
    warnings.simplefilter("ignore")
    assert agrees(from_estimator(estimator, "m"))
    seen = set()
    for number, mutant in enumerate(mutants):
        os.write(1, f"mutant {number}\n".encode())  # the last one that is shown is the one that ends the process
        try:
            assert agrees(from_estimator(mutant, "m")), "accepted, but different"
            seen.add("accepted")
        except StCodegenError as error:
            assert str(error).strip()
            seen.add("refused")
    return seen == {"accepted", "refused"}


@pytest.mark.thorough
@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_changed_estimators_are_refused_or_predicted_as_the_library_does(fitted, name):
    random = np.random.default_rng(1)
    result, shown = outcome(check, fitted[name], [mutant_of(fitted[name], random) for _ in range(40)])
    assert result == Outcome.ACCEPTED, shown


def svr(**changes):
    return lambda m: vars(m).update({key: value(getattr(m, key)) for key, value in changes.items()})


def node(field, number, *, leaf=False):
    """One number of the first split of a tree, or of its first leaf."""
    return lambda m: getattr(m.tree_, field).__setitem__(
        np.flatnonzero((m.tree_.children_left == -1) == leaf)[0], number
    )


def tree_of(width):
    return DecisionTreeRegressor(max_depth=1, random_state=0).fit(RANDOM.normal(size=(20, width)), np.arange(20.0))


#: name -> (estimator, what is done to it, part of the message)
CASES = {
    "a leaf with a child": ("tree", node("children_left", -5, leaf=True), r"children_left: a child number outside the"),
    "a leaf with a right child": ("tree", node("children_right", 1, leaf=True), r"children_right: a child number"),
    "a left child before the root": ("tree", node("children_left", -5), r"Tree.children_left: a child number outside"),
    "a right child behind the last": ("tree", node("children_right", 10**6), r"Tree.children_right: a child number"),
    "a feature below the first": ("tree", node("feature", -2), r"Tree.feature: a split of a feature that does not"),
    "a feature behind the last": ("tree", node("feature", 3), r"Tree.feature: a split of a feature that does not"),
    "a tree of more features": (
        "tree",
        svr(tree_=lambda v: tree_of(9).tree_),
        r"tree_: splits of 9 features, expected",
    ),
    "a tree behind a list of trees": (
        "tree",
        lambda m: vars(m).update(estimators_=[copy.deepcopy(m)], tree_=tree_of(9).tree_),
        r"tree_: splits of 9 features, expected 3",
    ),
    "nodes in another estimator": (
        "forest",
        lambda m: m.estimators_.__setitem__(0, tree_holder(m.estimators_[0])),
        r"KMeans.tree_: not a tree of scikit-learn",
    ),
    "columns that are not there": (
        "boosting",
        lambda m: vars(m).update(init_="zero", n_trees_per_iteration_=0),
        r"init_: shape \(2, 0\), expected \(2, 1\)",
    ),
    "a start without columns": (
        "boosting",
        lambda m: svr(n_outputs_=lambda v: 0)(m.init_),
        r"init_: shape \(2, 0\), expected \(2, 1\)",
    ),
    "a category of no feature": (
        "histogram",
        lambda m: m._bin_mapper.is_categorical_.__setitem__(0, 1),
        r"is_categorical_: not the features that have categories",
    ),
    "nodes of something else": (
        "histogram",
        lambda m: m._predictors.__setitem__(0, [tree_holder(m._predictors[0][0])]),
        r"KMeans.nodes: not those of a tree",
    ),
    "columns that nothing hands on": (
        "categories",
        lambda m: svr(transformers_=lambda v: v[:1])(m._preprocessor),
        r"transformers_: not an encoder of categories",
    ),
    "columns that a function makes": (
        "categories",
        lambda m: svr(func=lambda v: np.abs)(m._preprocessor.transformers_[1][1]),
        r"transformers_: not an encoder of categories",
    ),
    "a split that no walker reads": (
        "selection of trees",
        lambda m: node("feature", 10**12)(m.steps[0][1].estimator_.estimators_[0]),
        r"Tree.feature: a split of a feature that does not exist",
    ),
    "an index that no walker reads": (
        "selection of weights",
        lambda m: m.steps[0][1].estimator_.sparsify().coef_.indices.__setitem__(0, 10**9),
        r"indices",
    ),
    "norms of fewer rows": (
        "neighbours",
        svr(effective_metric_params_=lambda v: {"Y_norm_squared": np.zeros(1)}),
        r"KNeighborsRegressor with metric_params",
    ),
    "two metrics": ("neighbours", svr(p=lambda v: 1), r"KNeighborsRegressor with metric_params, or with a metric that"),
    "knots that a function turns": (
        "splines",
        lambda m: vars(m.steps[0][1].bsplines_[0]).update(_asarray=np.abs, _t=-m.steps[0][1].bsplines_[0]._t),
        r"knots that are equal or fall",
    ),
    "the intercept that predicts is another": ("svr", svr(_intercept_=lambda v: v + 1), r"SVR.intercept_: differs"),
    "an intercept too many": ("svr", svr(_intercept_=lambda v: np.append(v, 0)), r"shape \(2,\), expected \(1,\)"),
    "a coefficient too few": ("svr", svr(_dual_coef_=lambda v: v[:, 1:]), r"SVR._dual_coef_: shape"),
    "more classes than coefficients": ("svr", svr(_n_support=lambda v: np.ones(9, np.int32)), r"SVR._n_support: shape"),
    "fewer indices than vectors": ("svr", svr(support_=lambda v: v[1:]), r"SVR.support_: shape"),
    "an index beyond 32 bits": (
        "svr",
        svr(support_=lambda v: v.astype(np.int64) + 2**31),
        r"SVR.support_: number 0 is 2147483648, expected 0 \.\. 2147483647",
    ),
    "a method that is hidden": ("svr", svr(predict=lambda v: 1), r"SVR.predict: hides what the class defines"),
    "the method of another model": ("svr", svr(predict=copy.deepcopy), r"SVR.predict: hides what the class defines"),
    "texts": ("linear", svr(coef_=lambda v: v.astype(str)), r"Ridge.coef_: values of type <U32, expected numbers"),
    "another intercept": ("linear", svr(intercept_=lambda v: np.zeros(2)), r"Ridge.intercept_: shape \(2,\), expected"),
    "not a number": ("linear", svr(coef_=lambda v: v * np.nan), r"Ridge.coef_: number 0 is nan, not finite"),
    "objects": ("network", lambda m: m.coefs_.__setitem__(0, m.coefs_[0].astype(object)), r"coefs_\[0\]: values of"),
    "no layers": ("network", svr(coefs_=lambda v: []), r"MLPRegressor.coefs_: 0 entries, expected some"),
    "one layer less": ("network", svr(n_layers_=lambda v: v - 1), r"MLPRegressor.n_layers_: number 0 is 3, expected 4"),
    "an empty start": (
        "boosting",
        lambda m: svr(constant_=lambda v: v[:0])(m.init_),
        r"DummyRegressor.constant_: shape",
    ),
    "two trees a round": ("boosting", svr(estimators_=lambda v: np.hstack([v, v])), r"not an array of 1 tree an"),
    "no node": ("histogram", lambda m: svr(nodes=lambda v: v[:0])(m._predictors[0][0]), r"TreePredictor.nodes: not a"),
    "a category without a bit": (
        "categories",
        lambda m: m._bin_mapper.bin_thresholds_.__setitem__(0, np.array([300.0])),
        r"bin_thresholds_: a category without a bit",
    ),
    "a scale for another width": (
        "scaled",
        lambda m: svr(scale_=lambda v: v[:1])(m.steps[0][1]),
        r"MinMaxScaler.scale_: shape \(1,\), expected \(3,\)",
    ),
    "columns of another transformer": (
        "composed",
        lambda m: m.regressor_.steps[0][1]._transformer_to_input_indices.update(a=[0, 2]),
        r"the columns of one of them are not",
    ),
}


@pytest.mark.parametrize("name", list(CASES))
def test_what_fit_does_not_make_is_named(fitted, name):
    kind, change, message = CASES[name]
    estimator = copy.deepcopy(fitted[kind])
    change(estimator)
    with pytest.raises(StCodegenError, match=message):
        from_estimator(estimator, "m")


def test_a_linear_model_that_was_fitted_without_a_look_at_its_input_has_as_many_features_as_weights():
    estimator = Lasso(alpha=0.1).fit(np.asfortranarray(X), Y, check_input=False)
    assert not hasattr(estimator, "n_features_in_")
    model = from_estimator(estimator, "model")
    assert [feature.name for feature in model.ir.features] == ["f0", "f1", "f2"]
    assert np.allclose(reference.evaluate(model.ir, X)[:, 0], estimator.predict(X), rtol=1e-12)


def test_early_stopping_by_a_scorer_leaves_a_method_as_the_class_has_it(tmp_path):
    """scikit-learn replaces `_raw_predict` while it scores, and then puts the method back into the object."""
    x = np.random.default_rng(0).normal(size=(200, 2))
    estimator = HistGradientBoostingClassifier(early_stopping=True, scoring="accuracy", max_iter=20).fit(x, x[:, 0] > 0)
    assert "_raw_predict" in vars(estimator)
    joblib.dump(estimator, tmp_path / "model.joblib")
    model = load_pickle(tmp_path / "model.joblib", "model", trusted=True)
    assert np.array_equal(reference.evaluate(model.ir, x)[:, 0], estimator.predict(x))
    assert digest(load({"model": estimator}).irs[0]) == digest(
        load({"model": joblib.load(tmp_path / "model.joblib")}).irs[0]
    )


def test_the_threads_of_a_file_are_not_started(fitted):
    """As many as the machine had that trained it, or as a file says: the answers are the same with one."""
    estimator = copy.deepcopy(fitted["clusters"])
    estimator._n_threads = -1
    assert agrees(from_estimator(estimator, "m"))


def test_an_estimator_that_is_not_fitted_says_so():
    for estimator in (SVR(), MLPRegressor(), DecisionTreeRegressor(), HistGradientBoostingRegressor()):
        estimator.n_features_in_ = 3
        with pytest.raises(InputError, match=r"is not fitted \(\w+ is missing\): call fit\(\)"):
            from_estimator(estimator, "m")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.array([2**60]), "an integer that float64 does not hold"),
        (np.array([1.0], ">f8"), "values of type >f8"),
        (np.array([1.0], np.float16), "numbers of type float16; .* fit it on X.astype"),
        (np.array([1j]), "values of type complex128"),
        (np.array([True]), "truth values; .* fit it on X.astype"),
        ([1.0], "a list, expected numbers"),
    ],
)
def test_numbers_are_float64_float32_or_integers(value, message):
    model = Ridge()
    model.coef_ = value
    with pytest.raises(StCodegenError, match=message):
        Fitted(model).floats("coef_", (1,))
    for good in (np.array([2], np.int8), np.array([2], np.float32), np.array([2.0])):
        model.coef_ = good
        assert Fitted(model).floats("coef_", (1,)).dtype == np.float64


@pytest.mark.parametrize("weights", [[1.0], [1.0, 2.0, 3.0]])
def test_a_weight_too_few_or_too_many(weights):
    voting = VotingRegressor([("a", Ridge()), ("b", Ridge(2.0))], weights=[1.0, 2.0]).fit(X, Y)
    voting.weights = weights
    with pytest.raises(InputError, match="the model is not as VotingRegressor makes it"):
        from_estimator(voting, "m")


@pytest.mark.parametrize("kind", [LinearSVC, SGDClassifier, LogisticRegression, Perceptron])
def test_weights_that_were_made_sparse(kind, tmp_path):
    skops_io = pytest.importorskip("skops.io")
    dense = kind(random_state=0).fit(X, Y > 1)
    dense.coef_ *= np.abs(dense.coef_) > 0.1
    expected = from_estimator(dense, "m").ir
    sparse = copy.deepcopy(dense).sparsify()
    skops_io.dump(sparse, tmp_path / "m.skops")
    for found in (from_estimator(sparse, "m"), load_skops(tmp_path / "m.skops", "m")):
        assert digest(found.ir) == digest(expected)
        assert np.array_equal(found.predict(X)[:, 0], from_estimator(dense, "m").predict(X)[:, 0])


@pytest.mark.parametrize("damage", ["indices", "shape"])
def test_sparse_weights_that_lie_outside(damage):
    estimator = LinearSVC().fit(X, Y > 1).sparsify()
    if damage == "indices":
        estimator.coef_.indices[0] = 10**6
    else:
        estimator.coef_ = type(estimator.coef_)((2**20, 2**20))
    with pytest.raises(InputError, match=r"indices|shape"):
        from_estimator(estimator, "m")


def test_what_another_version_saved_is_not_called_unfitted():
    """scikit-learn 1.5 has no `_fill_dtype`."""
    estimator = SimpleImputer().fit(X)
    del estimator._fill_dtype
    with pytest.raises(InputError, match=r"SimpleImputer has no _fill_dtype: another version .* train it again"):
        from_estimator(estimator, "model")


@pytest.mark.parametrize(
    ("text", "message"), [(b"c_loss\nX\n.", "or another version of one"), (b"?", "or one of another")]
)
def test_a_pickle_that_does_not_load_may_be_of_another_version(text, message, tmp_path):
    (tmp_path / "model.pkl").write_bytes(text)
    with pytest.raises(InputError, match=message):
        load_pickle(tmp_path / "model.pkl", "model", trusted=True)
