"""scikit-learn's own predictions against the reference evaluation of what the walkers make."""

import math

import numpy as np
import pytest

sklearn = pytest.importorskip("sklearn")

from hypothesis import HealthCheck, given  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from sklearn.base import BaseEstimator  # noqa: E402
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor  # noqa: E402
from sklearn.ensemble import (  # noqa: E402
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingRegressor,
    RandomForestRegressor,
)
from sklearn.linear_model import ElasticNet, Lasso, LinearRegression, Ridge  # noqa: E402
from sklearn.multioutput import MultiOutputRegressor  # noqa: E402
from sklearn.neural_network import MLPRegressor  # noqa: E402
from sklearn.pipeline import FeatureUnion, make_pipeline  # noqa: E402
from sklearn.preprocessing import (  # noqa: E402
    FunctionTransformer,
    MaxAbsScaler,
    MinMaxScaler,
    PowerTransformer,
    QuantileTransformer,
    RobustScaler,
    StandardScaler,
)
from sklearn.svm import SVR, LinearSVR, NuSVR  # noqa: E402
from sklearn.tree import DecisionTreeRegressor, ExtraTreeRegressor  # noqa: E402

from st_codegen.errors import InputError, UnsupportedModelError  # noqa: E402
from st_codegen.ir import Piecewise, reference  # noqa: E402
from st_codegen.passes.domain import limit_inputs  # noqa: E402
from st_codegen.proof import bounds  # noqa: E402
from st_codegen.proof.probes import probe_rows  # noqa: E402
from st_codegen.walkers.objects import from_estimator  # noqa: E402
from tests.examples import examples  # noqa: E402

RANDOM = np.random.default_rng(7)
X = np.abs(RANDOM.normal(size=(240, 3))) * [500.0, 900.0, 10.0]
Y = np.abs(np.sin(X[:, 0] / 300) + X[:, 1] * 1e-3) + 0.01
Y2 = np.column_stack([Y, Y**2, -Y])
GRID = np.stack(np.meshgrid(np.arange(1, 9) * 100.0, np.arange(6) * 300.0, [25.0, 30.0, 35.0]), -1).reshape(-1, 3)
GRID_Y = np.cos(GRID[:, 0] / 200) + GRID[:, 1] * 1e-4 + GRID[:, 2] * 0.01

EXACT = {
    "decision tree": DecisionTreeRegressor(max_depth=6, random_state=0),
    "extra tree": ExtraTreeRegressor(max_depth=6, random_state=0),
    "random forest": RandomForestRegressor(11, max_depth=6, random_state=0, n_jobs=2),
    "best-first forest": RandomForestRegressor(5, max_leaf_nodes=17, random_state=0),
    "extremely randomised trees": ExtraTreesRegressor(11, max_depth=6, random_state=0),
    "gradient boosting": GradientBoostingRegressor(n_estimators=20, random_state=0),
    "gradient boosting from zero": GradientBoostingRegressor(n_estimators=5, init="zero", random_state=0),
    "gradient boosting, huber": GradientBoostingRegressor(n_estimators=20, loss="huber", random_state=0),
    "gradient boosting, quantile": GradientBoostingRegressor(n_estimators=20, loss="quantile", random_state=0),
    "gradient boosting from a tree": GradientBoostingRegressor(
        n_estimators=9, init=DecisionTreeRegressor(max_depth=3), random_state=0
    ),
    "gradient boosting from boosting": GradientBoostingRegressor(
        n_estimators=5, init=HistGradientBoostingRegressor(max_iter=4), loss="huber", random_state=0
    ),
    "histogram boosting": HistGradientBoostingRegressor(max_iter=20, random_state=0),
    "histogram boosting, early stopping": HistGradientBoostingRegressor(
        max_iter=30, early_stopping=True, random_state=0
    ),
    "constant tree": DecisionTreeRegressor(max_depth=1, min_samples_leaf=200),
    "scaled forest": make_pipeline(StandardScaler(), RandomForestRegressor(5, random_state=0)),
    "scaled target": TransformedTargetRegressor(
        make_pipeline(RobustScaler(), HistGradientBoostingRegressor(max_iter=10)), transformer=StandardScaler()
    ),
    "min-max target": TransformedTargetRegressor(DecisionTreeRegressor(max_depth=4), transformer=MinMaxScaler()),
    "robust target": TransformedTargetRegressor(DecisionTreeRegressor(max_depth=4), transformer=RobustScaler()),
    "several scalers": make_pipeline(
        ColumnTransformer(
            [("a", StandardScaler(), [2, 0]), ("b", make_pipeline(MinMaxScaler(clip=True), MaxAbsScaler()), [1])],
            remainder="passthrough",
        ),
        FunctionTransformer(),
        "passthrough",
        HistGradientBoostingRegressor(max_iter=10),
    ),
    "a function that refuses NaN": make_pipeline(
        FunctionTransformer(validate=True), HistGradientBoostingRegressor(max_iter=10)
    ),
    "scaler without mean": make_pipeline(
        StandardScaler(with_mean=False), RobustScaler(with_scaling=False), DecisionTreeRegressor(max_depth=5)
    ),
}
BOUNDED = {
    "svr": make_pipeline(StandardScaler(), SVR(C=10.0)),
    "svr raw": SVR(C=1.0, epsilon=1e-4, gamma=1.1e-6),
    "nu svr": make_pipeline(StandardScaler(), NuSVR()),
    "polynomial svr": make_pipeline(StandardScaler(), SVR(kernel="poly", degree=4, coef0=0.5)),
    "sigmoid svr": make_pipeline(StandardScaler(), SVR(kernel="sigmoid", gamma=0.1)),
    "linear kernel": make_pipeline(MinMaxScaler(), SVR(kernel="linear")),
    "linear svr": make_pipeline(StandardScaler(), LinearSVR(random_state=0)),
    **{
        f"mlp {function}": make_pipeline(
            StandardScaler(),
            MLPRegressor(hidden_layer_sizes=(13, 7), activation=function, max_iter=60, random_state=0),
        )
        for function in ("identity", "logistic", "tanh", "relu")
    },
    "poisson mlp": make_pipeline(
        StandardScaler(), MLPRegressor("poisson", hidden_layer_sizes=(5,), max_iter=60, random_state=0)
    ),
    "trees from a line, which is computed in float32": GradientBoostingRegressor(
        n_estimators=9, init=Ridge(), random_state=0
    ),
    "gradient boosting from a machine": GradientBoostingRegressor(n_estimators=4, init=SVR(), random_state=0),
    "linear": LinearRegression(),
    "ridge": Ridge(),
    "lasso": Lasso(alpha=1e-3),
    "elastic net": ElasticNet(alpha=1e-3),
    "poisson boosting": HistGradientBoostingRegressor(loss="poisson", max_iter=10),
    "logarithmic target": TransformedTargetRegressor(
        RandomForestRegressor(5, random_state=0), func=np.log1p, inverse_func=np.expm1
    ),
    **{
        f"target by {name}": TransformedTargetRegressor(
            RandomForestRegressor(5, random_state=0), transformer=transformer, check_inverse=False
        )
        for name, transformer in {
            "powers": PowerTransformer(),
            "powers alone": PowerTransformer(standardize=False),
            "powers of positive numbers": PowerTransformer("box-cox"),
            "quantiles": QuantileTransformer(n_quantiles=30),
            "steps": make_pipeline(
                FunctionTransformer(np.log1p, inverse_func=np.expm1), StandardScaler(), None, PowerTransformer()
            ),
        }.items()
    },
    "logarithmic feature": make_pipeline(FunctionTransformer(np.log1p), Ridge()),
    "logarithmic feature of trees": make_pipeline(FunctionTransformer(np.log1p), GradientBoostingRegressor()),
}
SEVERAL_OUTPUTS = {
    "tree": DecisionTreeRegressor(max_depth=5, random_state=0),
    "forest": RandomForestRegressor(7, max_depth=5, random_state=0),
    "extra trees": ExtraTreesRegressor(7, max_depth=5, random_state=0),
    "mlp": MLPRegressor(hidden_layer_sizes=(9,), max_iter=50, random_state=0),
    "linear": LinearRegression(),
    "one regressor an output": MultiOutputRegressor(HistGradientBoostingRegressor(max_iter=5)),
    "powers of each target": TransformedTargetRegressor(Ridge(), transformer=PowerTransformer()),
    "quantiles of each target": TransformedTargetRegressor(
        Ridge(), transformer=QuantileTransformer(n_quantiles=30), check_inverse=False
    ),
}


def compare(estimator, x, y, rows=1200):
    """Library and reference on the same rows, and the model."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        estimator.fit(x, y)
    loaded = from_estimator(estimator, "m")
    model = limit_inputs(loaded.ir)
    probes = np.vstack([probe_rows(model, rows, seed=1), np.asarray(x, float)])
    if model.exact:
        usable = reference.valid_rows(model, probes)
    else:  # outside the domain of a logarithm the library may raise
        usable = np.all(np.isfinite(reference.evaluate(model, probes)), axis=1)
    assert usable.mean() > 0.5
    return model, probes[usable], loaded.predict(probes[usable]), reference.evaluate(model, probes[usable])


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("data", ["scattered", "grid"])
def test_equal_to_the_bit(name, data):
    x, y = (X, Y) if data == "scattered" else (GRID, GRID_Y)
    model, probes, library, ours = compare(sklearn.clone(EXACT[name]), x, y)
    assert model.exact
    assert np.array_equal(library, ours)
    assert not np.any(bounds.difference_bound(model, probes))


@pytest.mark.parametrize("name", BOUNDED)
def test_equal_within_the_derived_bound(name):
    model, probes, library, ours = compare(sklearn.clone(BOUNDED[name]), X, Y)
    assert not model.exact
    bound = bounds.difference_bound(model, probes)
    assert np.all(np.abs(library - ours) <= bound)
    # the bound says something: inside the range it is far below the size of the result
    inside = np.all((probes >= X.min(axis=0)) & (probes <= X.max(axis=0)), axis=1)
    assert np.median(bound[inside]) < 1e-9 * np.max(np.abs(ours[inside])) or "trees" in name


def test_a_target_of_normal_quantiles_snaps_to_its_ends():
    """Within 1e-7 of 0 and 1 the library takes the first and the last quantile, and so do the pieces."""
    target = TransformedTargetRegressor(
        LinearRegression(), transformer=QuantileTransformer(n_quantiles=30, output_distribution="normal")
    )
    x = np.linspace(-3.0, 3.0, 200)[:, None]
    target.fit(x, x[:, 0] ** 3)
    loaded = from_estimator(target, "m")
    (pieces,) = (op for op in loaded.ir.ops if isinstance(op, Piecewise))
    low, high = pieces.knots[[0, -1]]
    assert np.nextafter(low, 0.0) - 1e-7 < 0.0 <= low - 1e-7
    assert high + 1e-7 <= 1.0 < np.nextafter(high, 1.0) + 1e-7
    rows = np.linspace(-9.0, 9.0, 4001)[:, None]
    difference = np.abs(loaded.predict(rows) - reference.evaluate(loaded.ir, rows))
    bound = bounds.difference_bound(loaded.ir, rows)
    assert np.all(difference <= bound) and np.median(bound) < 1e-5
    assert {-27.0, 27.0} <= set(np.ravel(reference.evaluate(loaded.ir, rows)).tolist())


@pytest.mark.parametrize("name", SEVERAL_OUTPUTS)
def test_several_outputs(name):
    model, probes, library, ours = compare(sklearn.clone(SEVERAL_OUTPUTS[name]), X, Y2)
    assert len(model.outputs) == 3
    assert np.all(np.abs(library - ours) <= bounds.difference_bound(model, probes))


@pytest.mark.parametrize(
    "estimator",
    [
        HistGradientBoostingRegressor(max_iter=15),
        RandomForestRegressor(5, random_state=0),
        ExtraTreesRegressor(5, random_state=0),
        DecisionTreeRegressor(random_state=0),
        make_pipeline(StandardScaler(), HistGradientBoostingRegressor(max_iter=15)),
    ],
    ids=lambda e: type(e).__name__,
)
def test_missing_values_in_training_and_prediction(estimator):
    x = X.copy()
    x[RANDOM.random(x.shape) < 0.2] = np.nan
    model, probes, library, ours = compare(sklearn.clone(estimator), x, Y)
    assert model.accepts_nan
    assert np.isnan(probes).any()
    assert np.array_equal(library, ours)


def test_splits_of_missing_from_present_values():
    x = np.column_stack([np.where(np.arange(100) % 2, np.nan, 1.0), np.ones(100)])
    model, _, library, ours = compare(HistGradientBoostingRegressor(max_iter=2, min_samples_leaf=5), x, x[:, 0] == 1)
    assert np.isinf(model.ops[0].threshold).any()
    assert np.array_equal(library, ours)


@pytest.mark.parametrize("values", [[0, 1, 2, 3, 4], [-3, 0, 7, 250, 1000], [0.5, 1.5, 2.25, -1.0, 9.0]])
def test_categories(values):
    x = X.copy()
    x[:, 1] = RANDOM.choice(np.array(values, float), len(x))
    x[:20, 1] = np.nan
    y = Y + np.where(np.isin(x[:, 1], values[::2]), 3.0, 0.0)
    estimator = HistGradientBoostingRegressor(max_iter=10, categorical_features=[1], max_depth=4)
    model, probes, library, ours = compare(estimator, x, y)
    assert model.ops[0].has_categories
    assert set(values) <= set(probes[:, 1])
    assert np.array_equal(library, ours)


@examples(25, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(2, 40))
def test_random_small_models(seed, features, leaves):
    random = np.random.default_rng(seed)
    x = random.choice([random.normal(size=(60, features)), np.round(random.normal(size=(60, features)), 1)])
    y = random.normal(size=60)
    for estimator in (
        HistGradientBoostingRegressor(max_iter=3, max_leaf_nodes=leaves, min_samples_leaf=1),
        GradientBoostingRegressor(n_estimators=3, max_leaf_nodes=leaves, random_state=0),
        ExtraTreesRegressor(3, max_leaf_nodes=leaves, random_state=0),
    ):
        _, _, library, ours = compare(estimator, x, y, rows=600)
        assert np.array_equal(library, ours)


def test_feature_names_come_from_the_data_frame():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(X, columns=["speed", "torque", "oil"])
    pipeline = make_pipeline(
        ColumnTransformer([("s", StandardScaler(), ["oil", "speed"])], remainder="passthrough"),
        DecisionTreeRegressor(max_depth=4),
    )
    model, _, library, ours = compare(pipeline, frame, Y)
    assert [f.name for f in model.features] == ["speed", "torque", "oil"]
    assert np.array_equal(library, ours)


class _Own(BaseEstimator):
    def fit(self, x, y):
        self.n_features_in_ = x.shape[1]
        return self


class _Plain(BaseEstimator):
    """One of the many that do not say how many features they take."""

    def fit(self, x, y=None):
        return self

    def transform(self, x):
        return x


@pytest.mark.parametrize(
    ("estimator", "reason"),
    [
        (make_pipeline(StandardScaler(), _Own()), ".*_Own is not supported"),
        (FeatureUnion([("own", _Plain())]), r"^tests._Plain is not supported"),
        (SVR(kernel="precomputed", max_iter=10), "kernel=precomputed"),
        (make_pipeline(FunctionTransformer(np.cbrt), Ridge()), "func=cbrt: a function that is not compiled"),
        (
            make_pipeline(FunctionTransformer(np.clip, kw_args={"a_min": [0, 1, 2], "a_max": 1}), Ridge()),
            "numpy.clip with kw_args=.*: supported are two numbers",
        ),
        (
            make_pipeline(FunctionTransformer(np.clip, kw_args={"a_min": 0, "a_max": 1, "casting": "unsafe"}), Ridge()),
            "numpy.clip with kw_args=.*: supported are two numbers",
        ),
        (make_pipeline(FunctionTransformer(lambda x: x), Ridge()), "func=<lambda>: a function that is not compiled"),
    ],
    ids=["own class", "own class alone", "precomputed", "tan", "limits in lists", "clip by a rule", "lambda"],
)
def test_unsupported_models_are_named(estimator, reason):
    x = X if getattr(estimator, "kernel", "") != "precomputed" else X @ X.T
    estimator.fit(x, Y)
    with pytest.raises(UnsupportedModelError, match=reason):
        from_estimator(estimator, "m")


@pytest.mark.parametrize("estimator", [SVR(), Ridge(), RandomForestRegressor(), MLPRegressor(), StandardScaler()])
def test_unfitted_models_are_named(estimator):
    with pytest.raises(InputError, match="not fitted"):
        from_estimator(estimator, "m")


def test_a_model_with_infinite_coefficients_is_refused():
    ridge = Ridge().fit(X, Y)
    ridge.coef_ = np.array([1.0, np.inf, 0.0])
    with pytest.raises(InputError, match="not finite"):
        from_estimator(ridge, "m")


def test_a_class_of_another_library_is_refused():
    with pytest.raises(UnsupportedModelError, match="not a model of"):
        from_estimator({"a": 1}, "m")


@pytest.mark.parametrize("scaler", [MinMaxScaler(clip=True), MinMaxScaler((-3.0, 7.0), clip=True)])
def test_inputs_that_are_clipped_first_are_refused_only_where_the_library_refuses_them(scaler):
    estimator = make_pipeline(scaler, SVR(C=10.0)).fit(X, Y)
    ir = limit_inputs(from_estimator(estimator, "m").ir)
    assert ir.magnitude_limits == (math.inf,) * 3
    largest = np.finfo(np.float64).max
    numbers = [-largest, -1e300, -1e9, -1.0, 0.0, *X[:5, 0], 1e4, 1e9, 1e35, 1e300, largest]
    rows = np.stack(np.meshgrid(numbers, numbers, [0.0, 30.0, largest]), -1).reshape(-1, 3)
    got = reference.evaluate(ir, rows)
    assert np.isfinite(got).all()
    with np.errstate(over="ignore"):
        assert np.all(np.abs(got[:, 0] - estimator.predict(rows)) <= bounds.difference_bound(ir, rows)[:, 0])


def test_a_column_whose_scaler_gives_one_number_is_clipped_behind_it():
    estimator = make_pipeline(MinMaxScaler(clip=True), Ridge()).fit(np.column_stack([X, np.zeros(len(X))]), Y)
    rows = np.column_stack([X, np.linspace(-3.0, 3.0, len(X))])
    assert np.allclose(
        reference.evaluate(limit_inputs(from_estimator(estimator, "m").ir), rows)[:, 0],
        estimator.predict(rows),
        rtol=1e-13,
    )


def test_of_a_class_of_the_users_own_it_is_said_what_to_give():
    class Own(LinearRegression):
        pass

    with pytest.raises(UnsupportedModelError, match=r"not a model of .* made of LinearRegression .* give a LinearReg"):
        from_estimator(Own().fit([[0.0], [1.0]], [0.0, 1.0]), "own")
