"""XGBoost: the reference evaluation of walked models equals the library, bit for bit."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen import ir
from st_codegen.errors import InputError, MissingExtraError, UnsupportedModelError
from st_codegen.ir import FLOAT32_OVERFLOW, Activation, FillMissing, Function, Operator, Scale, TreeEnsemble, reference
from st_codegen.ir.arrays import FloatArray
from st_codegen.walkers.base import GraphBuilder, LoadedModel, walk_estimator
from st_codegen.walkers.xgboost import model as walker
from tests.examples import examples

xgb = pytest.importorskip("xgboost")

DATA = Path(__file__).parent / "data"
QUIET = {"nthread": 1, "seed": 3, "max_depth": 4, "verbosity": 0, "tree_method": "hist"}


def table(seed: int = 0, rows: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Numbers around zero with gaps, a coarse set-point, a category code; and a target above zero."""
    rng = np.random.default_rng(seed)
    x = np.column_stack(
        [
            np.where(rng.uniform(size=rows) < 0.3, 0.0, rng.normal(size=rows)),
            rng.integers(0, 18, rows) * 100.0,
            rng.integers(0, 70, rows).astype(float),
        ]
    )
    y = 2 + np.abs(x[:, 0]) + np.sin(x[:, 1] / 300) + (x[:, 2] % 5) / 4 + rng.normal(size=rows) / 50
    x[rng.uniform(size=rows) < 0.15, 0] = np.nan
    x[rng.uniform(size=rows) < 0.15, 2] = np.nan
    return x, y


def matrix(x: np.ndarray, **options: Any) -> Any:
    return xgb.DMatrix(x, nthread=1, **options)


def train(parameters: dict[str, Any], data: Any, rounds: int = 8) -> Any:
    return xgb.train(QUIET | parameters, data, rounds)


def saved(model: Any, tmp_path: Path, suffix: str = "json") -> LoadedModel:
    path = tmp_path / f"model.{suffix}"
    model.save_model(path)
    return walker.load_file(path, "model")


def both_paths(booster: Any, tmp_path: Path) -> list[LoadedModel]:
    """The model as saved by Booster and as saved by XGBRegressor."""
    first = saved(booster, tmp_path)
    booster.set_attr(scikit_learn='{"_estimator_type": "regressor"}')
    return [first, saved(booster, tmp_path, "ubj")]


def ensemble(model: LoadedModel) -> TreeEnsemble:
    op = model.ir.ops[0]
    assert isinstance(op, TreeEnsemble)
    return op


def single_precision(value: FloatArray) -> FloatArray:
    """Bound of models with a link function.

    Up to 8 sums of magnitude below 4 that start from a logarithm one ulp (2**-22) off may each round apart by another;
    exp passes that on as a relative error, the sigmoid less. The library's expf is at most one ulp off, its sum, its
    quotient and our rounding half an ulp each (2**-24 of the value); its sigmoid stops falling at exp(-88.7).
    """
    return (9 * 2.0**-22 + 5 * 2.0**-24) * np.abs(value) + 3.1e-39


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"tree_method": "exact"},
        {"tree_method": "approx", "grow_policy": "lossguide", "max_leaves": 20},
        {"booster": "dart", "rate_drop": 0.5, "one_drop": 1},
        {"booster": "dart", "rate_drop": 0.5, "normalize_type": "forest", "base_score": 1e-3},
        {"num_parallel_tree": 3, "subsample": 0.6, "colsample_bynode": 0.7},
        {"tree_method": "exact", "gamma": 3.0},
        {"base_score": -7.25},
        {"booster": "gblinear"},
        {"booster": "gblinear", "updater": "coord_descent", "base_score": 0.3, "alpha": 0.1},
    ],
    ids=lambda parameters: "-".join(map(str, parameters.values())) or "default",
)
def test_boosters_equal_the_library_on_both_paths(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    if parameters.get("booster") == "gblinear":
        parameters = {"tree_method": "auto"} | parameters
    booster = train(parameters, matrix(x, label=y))
    by_matrix, in_place = both_paths(booster, tmp_path)
    assert_same(by_matrix)
    assert_same(in_place)
    assert by_matrix.ir.accepts_nan
    assert set(by_matrix.ir.magnitude_limits) == {FLOAT32_OVERFLOW}
    linear = parameters.get("booster") == "gblinear"
    assert set(in_place.ir.magnitude_limits) == {(FLOAT32_OVERFLOW if linear else None)}
    assert by_matrix.ir.source.notes[0] == "predicts as Booster.predict on a DMatrix"
    assert in_place.ir.source.notes[0] == "predicts as XGBRegressor.predict"


def test_dart_paths_differ_and_each_is_reproduced(tmp_path: Path) -> None:
    x, y = table()
    booster = train({"booster": "dart", "rate_drop": 0.5, "base_score": 1e3}, matrix(x, label=y), 20)
    by_matrix, in_place = both_paths(booster, tmp_path)
    one, other = reference.evaluate(by_matrix.ir, x), reference.evaluate(in_place.ir, x)
    assert np.any(one != other)
    assert np.array_equal(one, by_matrix.predict(x))
    assert np.array_equal(other, in_place.predict(x))


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e39, -1e39, FLOAT32_OVERFLOW])
def test_matrix_refuses_what_overflows_float32_and_in_place_takes_it(value: float, tmp_path: Path) -> None:
    x, y = table()
    by_matrix, in_place = both_paths(train({}, matrix(x, label=y)), tmp_path)
    row = np.array([[value, 0.0, 0.0]])
    assert not reference.valid_rows(by_matrix.ir, row)[0]
    with pytest.raises(InputError, match=r"XGBoost cannot predict: .*inf"):
        by_matrix.predict(row)
    assert reference.valid_rows(in_place.ir, row)[0]
    assert np.array_equal(in_place.predict(row), reference.evaluate(in_place.ir, row))
    largest = np.nextafter(abs(value) if np.isfinite(value) else FLOAT32_OVERFLOW, 0) if abs(value) < 1e39 else 3.4e38
    accepted = np.array([[largest, 0.0, 0.0]])
    assert reference.valid_rows(by_matrix.ir, accepted)[0]
    assert np.array_equal(by_matrix.predict(accepted), reference.evaluate(by_matrix.ir, accepted))


@pytest.mark.parametrize(
    ("objective", "link"),
    [
        ("reg:squarederror", None),
        ("reg:squaredlogerror", None),
        ("reg:pseudohubererror", None),
        ("reg:absoluteerror", None),
        ("reg:quantileerror", None),
        ("reg:logistic", Function.LOGISTIC),
        ("reg:gamma", Function.EXP),
        ("reg:tweedie", Function.EXP),
        ("count:poisson", Function.EXP),
    ],
)
@pytest.mark.parametrize("base_score", [None, 0.37])
def test_objectives_equal_the_library(
    objective: str, link: Function | None, base_score: float | None, tmp_path: Path, assert_same: Any
) -> None:
    x, y = table()
    target = y / y.max() if objective == "reg:logistic" else y
    parameters = {"objective": objective, "quantile_alpha": 0.3} | ({"base_score": base_score} if base_score else {})
    for model in both_paths(train(parameters, matrix(x, label=target)), tmp_path):
        functions = [op.function for op in model.ir.ops if isinstance(op, Activation)]
        assert functions == ([] if link is None else [link])
        assert_same(model, bound=None if link is None else single_precision)


@pytest.mark.parametrize("objective", ["reg:logistic", "count:poisson", "reg:gamma", "reg:tweedie"])
def test_base_score_passes_the_inverse_link(objective: str, tmp_path: Path) -> None:
    """Against the library's own margins, which start at the logarithm of the base score, one ulp off at times."""
    x, y = table(rows=60)
    path = tmp_path / "model.json"
    equal = 0
    base_scores = [1e-7, 0.5, 0.9999999, *np.random.default_rng(5).uniform(0.01, 0.99, 40)]
    for base_score in base_scores:
        parameters = {"objective": objective, "base_score": float(base_score), "max_depth": 2}
        booster = train(parameters, matrix(x, label=y / y.max()), 1)
        booster.save_model(path)
        margin = booster.predict(matrix(x), output_margin=True)
        found = reference.trace(walker.load_file(path, "model").ir, x)[1][:, 0]
        assert np.max(np.abs(found - margin)) <= 2 * np.spacing(np.max(np.abs(margin)))
        equal += np.array_equal(found, margin)
    assert equal > 0.9 * len(base_scores)


def test_several_quantiles_are_several_outputs(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    parameters = {"objective": "reg:quantileerror", "quantile_alpha": np.array([0.1, 0.5, 0.9])}
    for model in both_paths(train(parameters, xgb.QuantileDMatrix(x, label=y, nthread=1)), tmp_path):
        assert model.ir.outputs == ("out1", "out2", "out3")
        assert_same(model)


@pytest.mark.parametrize(
    "parameters",
    [
        {"multi_strategy": "one_output_per_tree"},
        {"multi_strategy": "multi_output_tree"},
        {"multi_strategy": "one_output_per_tree", "num_parallel_tree": 2, "subsample": 0.5},
        {"booster": "dart", "rate_drop": 0.5},
        {"booster": "gblinear", "tree_method": "auto"},
        {"objective": "reg:logistic"},
    ],
    ids=lambda parameters: "-".join(map(str, parameters.values())),
)
def test_several_targets(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    targets = np.column_stack([y, y**2, np.flip(y)]) / (y.max() ** 2)
    bound = single_precision if "objective" in parameters else None
    for model in both_paths(train(parameters, matrix(x, label=targets)), tmp_path):
        assert len(model.ir.outputs) == 3
        assert_same(model, bound=bound)


@pytest.mark.parametrize("parameters", [{"max_cat_to_onehot": 100}, {"max_cat_to_onehot": 1}, {"booster": "dart"}])
def test_categories_equal_the_library(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    data = matrix(x, label=y, feature_types=["q", "q", "c"], enable_categorical=True)
    for model in both_paths(train(parameters, data, 12), tmp_path):
        [column] = [column for column in ensemble(model).columns if column.categorical]
        assert column.n_categories > 32  # the bit sets have several words
        assert_same(model)


def test_pandas_categories_are_codes_named_in_the_notes(tmp_path: Path, assert_same: Any) -> None:
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(0)
    frame = pandas.DataFrame(
        {
            "x": rng.normal(size=300),
            "kind": pandas.Categorical(rng.choice(["low", "mid", "high"], 300)),
            "level": pandas.Categorical(rng.choice([5, 7, 9], 300)),
        }
    )
    y = frame["x"] + frame["kind"].cat.codes - 2 * frame["level"].cat.codes
    regressor = xgb.XGBRegressor(n_estimators=6, max_depth=3, n_jobs=1, enable_categorical=True).fit(frame, y)
    model = saved(regressor, tmp_path)
    assert [feature.name for feature in model.ir.features] == ["x", "kind", "level"]
    assert "feature 'kind' is a category code: 0 = high, 1 = low, 2 = mid" in model.ir.source.notes
    assert "feature 'level' is a category code: 0 = 5, 1 = 7, 2 = 9" in model.ir.source.notes
    assert_same(model)
    coded = np.column_stack([frame["x"], frame["kind"].cat.codes, frame["level"].cat.codes])
    assert np.array_equal(reference.evaluate(model.ir, coded)[:, 0], regressor.predict(frame))


@pytest.mark.parametrize("missing", [-999.0, 0.0, 0.1, np.nan])
@pytest.mark.parametrize("booster", ["gbtree", "dart", "gblinear"])
def test_regressor_with_a_number_for_missing_values(missing: float, booster: str, assert_same: Any) -> None:
    x, y = table()
    filled = np.where(np.isnan(x), missing, x)
    regressor = xgb.XGBRegressor(n_estimators=5, max_depth=3, booster=booster, n_jobs=1, missing=missing)
    regressor.fit(filled, y)
    model = walker.load_object(regressor, "model")
    near = np.float32(missing).astype(float)
    around = [missing, near, np.nextafter(near, -np.inf), np.nextafter(np.float32(missing), np.float32(9)), -0.0]
    awkward = np.array(np.meshgrid(around, around, [np.nan, 1.0])).reshape(3, -1).T
    assert_same(model)
    assert_same(model, np.vstack([filled, x, awkward]))
    assert np.array_equal(reference.evaluate(model.ir, filled)[:, 0], regressor.predict(filled))
    assert any("missing values" in note for note in model.ir.source.notes) == (not np.isnan(missing))


def test_category_names_that_the_library_garbles_are_left_out(tmp_path: Path, assert_same: Any) -> None:
    """XGBoost 3.2 counts the characters of pandas categories where it means bytes."""
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"kind": pandas.Categorical(["kühl", "warm", "heiß"] * 30)})
    y = frame["kind"].cat.codes * 1.5
    regressor = xgb.XGBRegressor(n_estimators=3, n_jobs=1, enable_categorical=True).fit(frame, y)
    model = saved(regressor, tmp_path)
    names = [note for note in model.ir.source.notes if "kind" in note]
    assert not names
    assert_same(model)


def test_infinity_for_missing_values_is_refused() -> None:
    x, y = table()
    regressor = xgb.XGBRegressor(n_estimators=2, missing=np.inf, n_jobs=1).fit(x, y)
    with pytest.raises(UnsupportedModelError, match="XGBRegressor: missing=inf: use NaN or a finite number"):
        walker.load_object(regressor, "model")


def test_best_iteration_counts_for_the_regressor_only(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    regressor = xgb.XGBRegressor(
        n_estimators=60, max_depth=3, learning_rate=0.9, early_stopping_rounds=4, n_jobs=1, num_parallel_tree=2
    )
    regressor.fit(x, y, eval_set=[(x[:50], y[:50] + 0.3 * np.sin(99 * y[:50]))], verbose=False)
    rounds = regressor.get_booster().num_boosted_rounds()
    best = regressor.best_iteration
    assert 0 < best < rounds - 1
    for model in (saved(regressor, tmp_path), walker.load_object(regressor, "model")):
        assert ensemble(model).n_trees == 2 * (best + 1)
        assert f"early stopping: the first {best + 1} of {rounds} rounds are used" in model.ir.source.notes
        assert_same(model)
        assert np.array_equal(model.predict(x)[:, 0], regressor.predict(x))
    everything = saved(regressor.get_booster(), tmp_path)
    assert ensemble(everything).n_trees == 2 * rounds
    assert any(note.startswith(f"early stopping: all {rounds} rounds are used") for note in everything.ir.source.notes)
    assert_same(everything)


def test_random_forest_regressor(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    forest = xgb.XGBRFRegressor(n_estimators=10, max_depth=4, n_jobs=1).fit(x, y)
    for model in (saved(forest, tmp_path), walker.load_object(forest, "model")):
        assert ensemble(model).n_trees == 10
        assert_same(model)


@pytest.mark.parametrize("booster", ["gbtree", "gblinear"])
def test_estimator_behind_a_scaler_reads_the_scaled_value(booster: str) -> None:
    x, y = table()
    regressor = xgb.XGBRegressor(n_estimators=5, n_jobs=1, booster=booster).fit(x / 7, y)
    builder = GraphBuilder(3)
    scaled = builder.add(Scale((0,), Operator.DIVIDE, np.full(3, 7.0)))
    result = walk_estimator(regressor, builder, scaled)
    model = builder.model("model", tuple(ir.Feature(f"f{i}") for i in range(3)), ir.Source("", "", ""))
    assert result == len(model.ops)
    assert set(model.magnitude_limits) == {None}
    assert np.array_equal(reference.evaluate(model, x)[:, 0], regressor.predict(x / 7))


def test_coarse_grid_of_set_points(tmp_path: Path, assert_same: Any) -> None:
    speed, torque, oil = np.meshgrid(np.arange(1, 18) * 100.0, np.arange(19) * 100.0, [25.0, 30.0, 35.0])
    x = np.column_stack([speed.ravel(), torque.ravel(), oil.ravel()])
    y = 1e-3 * np.sin(x[:, 0] / 250) * x[:, 1] / 1800 + 1e-5 * x[:, 2]
    parameters = {"reg_lambda": 20, "reg_alpha": 0.01, "max_depth": 16, "colsample_bytree": 0.8}
    regressor = xgb.XGBRegressor(n_estimators=20, n_jobs=1, **parameters).fit(x, y * 1e3)
    model = saved(regressor, tmp_path, "ubj")
    assert_same(model)
    assert_same(model, x)


def test_json_and_ubj_are_the_same_model(tmp_path: Path) -> None:
    x, y = table()
    booster = train({}, matrix(x, label=y))
    one, other = saved(booster, tmp_path), saved(booster, tmp_path, "ubj")
    assert one.ir.source == other.ir.source
    for field in ("roots", "split", "threshold", "left", "right", "missing_left", "leaf", "leaf_value", "base"):
        assert np.array_equal(getattr(ensemble(one), field), getattr(ensemble(other), field))


def test_deleted_nodes_are_dropped(tmp_path: Path) -> None:
    x, y = table()
    path = tmp_path / "model.json"
    train({"tree_method": "exact", "gamma": 3.0}, matrix(x, label=y)).save_model(path)
    trees = json.loads(path.read_text())["learner"]["gradient_booster"]["model"]["trees"]
    deleted = sum(int(tree["tree_param"]["num_deleted"]) for tree in trees)
    assert deleted > 0
    assert ensemble(walker.load_file(path, "model")).n_nodes == sum(len(tree["parents"]) for tree in trees) - deleted


@pytest.mark.parametrize(
    "path",
    sorted(path for path in DATA.glob("xgboost-*") if "vectors" not in path.name),
    ids=lambda path: path.name.removeprefix("xgboost-"),
)
def test_files_of_older_versions(path: Path, assert_same: Any) -> None:
    model = walker.load_file(path, "model")
    assert model.ir.source.version == path.name.split("-")[1]
    link = any(kind in path.name for kind in ("poisson", "logistic"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the library's warning of old files stays out of our output
        assert_same(model, bound=single_precision if link else None)


def test_a_forest_of_an_older_version_computes_as_it_did(tmp_path: Path) -> None:
    """XGBoost 1.5 saves labels and `missing`, and no trees per round: 3.2 would take the first of three trees."""
    path = DATA / "xgboost-1.5.2-logistic-forest.json"
    model = walker.load_file(path, "model")
    assert ensemble(model).n_trees == 3
    assert model.ir.classes is not None
    notes = ["predicts as XGBClassifier.predict", "missing values: NaN and 0"]
    labels = "classes 0, 1, .. are the labels 10, 20 of the library that saved the file"
    assert model.ir.source.notes == (*notes, labels)
    x = np.array([[-1.62, 1.9], [1.62, 2.89], [0.51, -1.64], [0.5, 1.4], [0.0, 1.9], [np.nan, 0.0]])
    booster = xgb.Booster(model_file=str(path))
    expected = booster.predict(xgb.DMatrix(x, missing=0.0))
    np.testing.assert_allclose(expected[:4], [0.58613783, 0.789949, 0.53298753, 0.6448296], rtol=1e-6)  # by 1.5.2
    np.testing.assert_allclose(reference.evaluate(model.ir, x)[:, 2], expected, rtol=1e-6)
    np.testing.assert_allclose(model.predict(x)[:, 2], expected, rtol=1e-6)


@pytest.mark.parametrize("told", [{"best_ntree_limit": "6"}, {"parallel": 3}, {"parallel": 10**30}, {}])
def test_the_best_rounds_of_a_file_that_does_not_count_them(told: dict[str, Any], tmp_path: Path) -> None:
    """XGBoost 1.3 saves the trees per round with the estimator alone, 1.4 and 1.5 the trees of the best rounds, too."""
    x, y = table()
    path = tmp_path / "model.json"
    train({"num_parallel_tree": 3, "subsample": 0.5}, matrix(x, label=y), rounds=4).save_model(path)
    document = json.loads(path.read_text())
    model = document["learner"]["gradient_booster"]["model"]
    del model["iteration_indptr"], model["gbtree_model_param"]["num_parallel_tree"]
    saved = {"type": "XGBRegressor", "num_parallel_tree": told.pop("parallel", None)}
    document["learner"]["attributes"] = {"best_iteration": "1", "scikit_learn": json.dumps(saved), **told}
    path.write_text(json.dumps(document))
    expected = 6 if told or saved["num_parallel_tree"] == 3 else 2
    assert ensemble(walker.load_file(path, "model")).n_trees == expected


@pytest.mark.parametrize(("version", "base"), [([1, 3, 0], np.log(np.float32(9.0))), ([1, 3, 1], 0.9)])
def test_a_base_score_of_logitraw_was_a_probability_before_1_3_1(
    version: list[int], base: float, tmp_path: Path, assert_same: Any
) -> None:
    x, y = table()
    booster = train(
        {"objective": "binary:logitraw", "base_score": 0.0, "max_depth": 2}, matrix(x, label=y > np.median(y))
    )
    path = tmp_path / "model.json"
    booster.save_model(path)
    document = json.loads(path.read_text())
    document["version"], document["learner"]["learner_model_param"]["base_score"] = version, "0.900000"
    path.write_text(json.dumps(document))
    loaded = walker.load_file(path, "model")
    margin = booster.predict(matrix(x), output_margin=True)
    np.testing.assert_allclose(reference.evaluate(loaded.ir, x)[:, 0], margin + base, atol=1e-6)
    assert_same(loaded)


@pytest.mark.parametrize("objective", ["binary:logistic", "count:poisson"])
def test_a_gblinear_file_of_before_1_5_is_read_as_it_was(objective: str, tmp_path: Path, assert_same: Any) -> None:
    """It has no number of rounds; XGBoost 3.2 then takes the base score for the margin."""
    x, y = table()
    path = tmp_path / "model.json"
    booster = train(
        {"booster": "gblinear", "objective": objective, "base_score": 0.7}, matrix(x, label=y > np.median(y))
    )
    booster.save_model(path)
    expected = booster.predict(matrix(x))
    document = json.loads(path.read_text())
    del document["learner"]["gradient_booster"]["model"]["boosted_rounds"]
    path.write_text(json.dumps(document))
    model = walker.load_file(path, "model")
    np.testing.assert_allclose(
        reference.evaluate(model.ir, x)[:, -1 if model.ir.classes is None else 2], expected, 1e-6
    )
    assert_same(model, bound=single_precision)


@pytest.mark.parametrize("kind", ["XGBClassifier", "XGBRFClassifier"])
def test_a_classifier_of_version_1_3_is_one(kind: str, tmp_path: Path) -> None:
    """Its files have the name of the class and not the kind of the estimator."""
    x, y = table()
    path = tmp_path / "model.json"
    train({"objective": "binary:logitraw"}, matrix(x, label=y > np.median(y))).save_model(path)
    document = json.loads(path.read_text())
    document["learner"]["attributes"] = {"scikit_learn": json.dumps({"type": kind})}
    path.write_text(json.dumps(document))
    model = walker.load_file(path, "model")
    assert model.ir.classes is not None
    assert "predicts as XGBClassifier.predict" in model.ir.source.notes


def test_vector_leaves_of_older_versions_are_refused() -> None:
    """XGBoost 3.2 dereferences a missing field of these files and dies."""
    with pytest.raises(UnsupportedModelError, match=r"trees\[0\]\.leaf_weights: missing; .* before XGBoost 3\.2"):
        walker.load_file(DATA / "xgboost-3.0.5-vectors.json", "model")


def test_source_and_feature_names(tmp_path: Path) -> None:
    x, y = table()
    booster = train({"booster": "dart"}, matrix(x, label=y, feature_names=["speed", "torque", "oil °C"]))
    model = saved(booster, tmp_path, "ubj")
    source = model.ir.source
    assert (source.library, source.version) == ("XGBoost", xgb.__version__)
    assert source.model_class == "XGBoost model (dart, reg:squarederror)"
    assert [feature.name for feature in model.ir.features] == ["speed", "torque", "oil °C"]
    unnamed = train({}, matrix(x, label=y))
    assert [feature.name for feature in saved(unnamed, tmp_path).ir.features] == ["f0", "f1", "f2"]


def test_unfitted_estimator_is_refused() -> None:
    with pytest.raises(InputError, match=r"XGBRegressor: not fitted: call fit\(\)"):
        walker.load_object(xgb.XGBRegressor(), "model")


def test_width_of_the_input_is_checked() -> None:
    x, y = table()
    regressor = xgb.XGBRegressor(n_estimators=2, n_jobs=1).fit(x, y)
    with pytest.raises(InputError, match="XGBRegressor: the model has 3 features, its input 2 columns"):
        walker.walk(regressor, GraphBuilder(2), 0)


def test_reading_needs_no_package_but_predicting_does(tmp_path: Path, without_package: Any) -> None:
    x, y = table()
    path = tmp_path / "model.ubj"
    train({}, matrix(x, label=y)).save_model(path)
    without_package("xgboost")
    model = walker.load_file(path, "model")
    assert np.all(np.isfinite(reference.evaluate(model.ir, x)))
    with pytest.raises(MissingExtraError, match=r'model\.ubj by XGBoost needs .* pip install "st-codegen\[xgboost\]"'):
        model.predict(x)


@pytest.mark.parametrize("parameters", [{}, {"booster": "dart"}, {"booster": "gblinear", "tree_method": "auto"}])
def test_rows_are_predicted_one_by_one_as_together(parameters: dict[str, Any], tmp_path: Path) -> None:
    x, y = table()
    for model in both_paths(train(parameters, matrix(x, label=y)), tmp_path):
        assert np.array_equal(np.vstack([model.predict(row[None, :]) for row in x[:40]]), model.predict(x)[:40])


def test_no_rows_give_no_predictions(tmp_path: Path) -> None:
    x, y = table()
    assert saved(train({}, matrix(x, label=y)), tmp_path).predict(np.zeros((0, 3))).shape == (0, 1)


@pytest.mark.parametrize(("fill", "sentinel"), [(np.inf, None), (0.0, np.inf)])
def test_fill_of_missing_values_must_be_finite(fill: float, sentinel: float | None) -> None:
    with pytest.raises(InputError, match=r"FillMissing.* not finite"):
        FillMissing((0,), np.array([fill]), sentinel)


@examples()
@given(
    seed=st.integers(0, 10**6),
    columns=st.integers(1, 4),
    digits=st.integers(0, 12),
    gaps=st.sampled_from([0.0, 0.3]),
    parameters=st.fixed_dictionaries(
        {
            "max_depth": st.integers(1, 6),
            "booster": st.sampled_from(["gbtree", "dart", "gblinear"]),
            "base_score": st.floats(-100, 100, width=32),
        }
    ),
)
def test_random_small_models(
    seed: int, columns: int, digits: int, gaps: float, parameters: dict[str, Any], request: pytest.FixtureRequest
) -> None:
    rng = np.random.default_rng(seed)
    x = np.round(rng.normal(size=(120, columns)) * 10.0 ** rng.integers(-3, 4), digits)
    x[:, 0] = np.abs(np.trunc(x[:, 0]))
    y = rng.normal(size=120) + x[:, -1]
    x[rng.uniform(size=x.shape) < gaps] = np.nan
    first = "c" if seed % 2 and parameters["booster"] != "gblinear" else "q"
    data = matrix(x, label=y, feature_types=[first] + ["q"] * (columns - 1))
    booster = train({"min_child_weight": 0, "rate_drop": 0.5, "tree_method": "auto", **parameters}, data, 4)
    folder = request.getfixturevalue("tmp_path_factory").mktemp("random")
    for model in both_paths(booster, folder):
        request.getfixturevalue("assert_same")(model)
