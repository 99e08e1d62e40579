"""Which types a `.skops` file may name: each walker says so for the files of its own classes."""

import subprocess
import sys

import numpy as np
import pytest

from st_codegen import load
from st_codegen.errors import UnsupportedModelError, UntrustedFileError
from st_codegen.walkers.base import trusted_types

skops = pytest.importorskip("skops.io")
ensemble = pytest.importorskip("sklearn.ensemble")
neural_network = pytest.importorskip("sklearn.neural_network")
linear_model = pytest.importorskip("sklearn.linear_model")
pytest.importorskip("sklearn.experimental.enable_halving_search_cv")
model_selection = pytest.importorskip("sklearn.model_selection")

X = np.array([[0.0, 1.0], [1.0, 0.0], [2.0, 2.0], [3.0, 1.0]])
Y = [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    "estimator",
    [
        ensemble.RandomForestRegressor(n_estimators=2),
        ensemble.HistGradientBoostingRegressor(max_iter=2, categorical_features=[1]),
        neural_network.MLPRegressor(max_iter=2),
        neural_network.MLPRegressor(max_iter=2, solver="sgd"),
        linear_model.TweedieRegressor(power=1.5),
        model_selection.HalvingGridSearchCV(linear_model.Ridge(), {"alpha": [1.0, 2.0]}, cv=2),
        model_selection.HalvingRandomSearchCV(linear_model.Ridge(), {"alpha": [1.0, 2.0]}, cv=2),
    ],
    ids=repr,
)
@pytest.mark.filterwarnings("ignore")
def test_the_types_of_supported_estimators_are_trusted(estimator):
    unknown = set(skops.get_untrusted_types(data=skops.dumps(estimator.fit(X, Y))))
    assert unknown
    assert unknown <= trusted_types()


@pytest.mark.parametrize("score", ["chi2", "f_regression", "mutual_info_regression", "r_regression"])
def test_a_file_may_name_the_score_by_which_columns_were_selected(score, tmp_path):
    selection = pytest.importorskip("sklearn.feature_selection")
    skops.dump(selection.SelectKBest(getattr(selection, score), k=1).fit(X, Y), tmp_path / "m.skops")
    (loaded,) = load(tmp_path).models
    assert loaded.predict(X).shape == (4, 1)


def test_a_file_may_name_the_function_that_clips(tmp_path):
    """It was called a type that no supported model needs."""
    preprocessing = pytest.importorskip("sklearn.preprocessing")
    clipped = preprocessing.FunctionTransformer(np.clip, kw_args={"a_min": 0.5, "a_max": 1.5})
    skops.dump(clipped.fit(X), tmp_path / "m.skops")
    (loaded,) = load(tmp_path).models
    assert np.array_equal(loaded.predict(X), np.clip(X, 0.5, 1.5))


def test_to_know_them_no_library_is_imported():
    code = (
        "import sys; from st_codegen.walkers.base import trusted_types; assert trusted_types(); "
        "sys.exit(bool({'sklearn', 'lightgbm', 'xgboost'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_part_of_an_estimator_is_not_called_the_class_that_is_missing(tmp_path):
    calibration = pytest.importorskip("sklearn.calibration")
    linear = pytest.importorskip("sklearn.linear_model")
    model = calibration.CalibratedClassifierCV(linear.LogisticRegression(), method="temperature", cv=2)
    skops.dump(model.fit(X, [0, 1, 0, 1]), tmp_path / "m.skops")
    with pytest.raises(
        UntrustedFileError,
        match=r"run code: sklearn\.calibration\._TemperatureScaling; save the model without them, or train",
    ):
        load(tmp_path)


def test_of_a_search_and_a_pipeline_with_memory_it_is_said_what_to_save(tmp_path):
    """Their distributions and caches are no part of the model; "without them" told nobody how."""
    stats, joblib = pytest.importorskip("scipy.stats"), pytest.importorskip("joblib")
    linear, selection = pytest.importorskip("sklearn.linear_model"), pytest.importorskip("sklearn.model_selection")
    pipeline = pytest.importorskip("sklearn.pipeline")
    distributions = {"alpha": stats.loguniform(1e-3, 1.0)}
    search = selection.RandomizedSearchCV(linear.Ridge(), distributions, n_iter=2, cv=2)
    kept = pipeline.Pipeline([("ridge", linear.Ridge())], memory=joblib.Memory(tmp_path / "cache", verbose=0))
    for model, text in ((search, r"its best_estimator_\)"), (kept, r"set_params\(memory=None\)\)")):
        skops.dump(model.fit(X, [0.0, 1.0, 0.0, 1.0]), tmp_path / "m.skops")
        with pytest.raises(UntrustedFileError, match=f"save the model without them .*{text}"):
            load(tmp_path)


def test_a_file_of_a_class_that_is_not_compiled_names_it(tmp_path):
    manifold = pytest.importorskip("sklearn.manifold")
    isomap = manifold.Isomap(n_neighbors=3, n_components=1)
    skops.dump(isomap.fit(X), tmp_path / "m.skops")
    with pytest.raises(UnsupportedModelError, match="scikit-learn's Isomap is not supported"):
        load(tmp_path)


def test_early_stopping_that_a_model_was_trained_with_is_read(tmp_path):
    xgboost = pytest.importorskip("xgboost")
    stop = xgboost.callback.EarlyStopping(rounds=2, save_best=True)
    model = xgboost.XGBRegressor(n_estimators=3, n_jobs=1, callbacks=[stop])
    skops.dump(model.fit(X, Y, eval_set=[(X, Y)], verbose=False), tmp_path / "m.skops")
    (loaded,) = load(tmp_path).models
    assert np.array_equal(loaded.predict(X)[:, 0], model.predict(X))


@pytest.mark.parametrize("chosen", [{"pattern": "a"}, {"dtype_include": np.number}, {"dtype_exclude": [object]}])
def test_columns_that_a_rule_chose_are_read(chosen, tmp_path):
    pandas = pytest.importorskip("pandas")
    compose = pytest.importorskip("sklearn.compose")
    preprocessing = pytest.importorskip("sklearn.preprocessing")
    rule = compose.make_column_selector(**chosen)
    columns = compose.ColumnTransformer([("scaled", preprocessing.StandardScaler(), rule)], remainder="passthrough")
    table = pandas.DataFrame(X, columns=["a", "b"])
    skops.dump(columns.fit(table), tmp_path / "m.skops")
    (loaded,) = load(tmp_path).models
    assert np.array_equal(loaded.predict(X), columns.transform(table))
