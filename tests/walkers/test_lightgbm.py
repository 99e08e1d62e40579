"""LightGBM: the reference evaluation of walked models equals the library, bit for bit."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError, MissingExtraError
from st_codegen.ir import Activation, Function, Operator, Scale, TreeEnsemble, reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.proof import bounds
from st_codegen.walkers.base import GraphBuilder, LoadedModel, walk_estimator
from st_codegen.walkers.lightgbm import model as walker
from st_codegen.walkers.objects import from_estimator
from tests.examples import examples

lgb = pytest.importorskip("lightgbm")

DATA = Path(__file__).parent / "data"
QUIET = {"verbosity": -1, "num_threads": 1, "seed": 3, "num_leaves": 12, "min_data_in_leaf": 5}


def table(seed: int = 0, rows: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Numbers around zero (0 itself included), a coarse set-point, a category code; and a target above zero."""
    rng = np.random.default_rng(seed)
    x = np.column_stack(
        [
            np.where(rng.uniform(size=rows) < 0.3, 0.0, rng.normal(size=rows)),
            rng.integers(0, 18, rows) * 100.0,
            rng.integers(0, 70, rows).astype(float),
        ]
    )
    y = 2 + np.abs(x[:, 0]) + np.sin(x[:, 1] / 300) + (x[:, 2] % 5) / 4 + rng.normal(size=rows) / 50
    return x, y


def with_gaps(x: np.ndarray, share: float = 0.15) -> np.ndarray:
    """`x` with NaN in some places."""
    gaps = x.copy()
    gaps[np.random.default_rng(1).uniform(size=x.shape) < share] = np.nan
    return gaps


def train(parameters: dict[str, Any], data: Any, rounds: int = 12) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lgb.train(QUIET | parameters, data, rounds)


def saved(booster: Any, tmp_path: Path, **options: Any) -> LoadedModel:
    path = tmp_path / "model.txt"
    booster.save_model(path, **options)
    return walker.load_file(path, "model")


def ensemble(model: LoadedModel) -> TreeEnsemble:
    op = model.ir.ops[0]
    assert isinstance(op, TreeEnsemble)
    return op


@pytest.mark.parametrize(
    "parameters",
    [
        {"boosting": "gbdt"},
        {"boosting": "dart", "drop_rate": 0.5},
        {"boosting": "rf", "bagging_freq": 1, "bagging_fraction": 0.6},
        {"data_sample_strategy": "goss", "learning_rate": 0.5},
        {"extra_trees": True},
        {"max_depth": 3, "monotone_constraints": [1, 0, -1]},
        {"linear_tree": True},
        {"linear_tree": True, "boosting": "dart", "drop_rate": 0.5},
    ],
    ids=lambda parameters: "-".join(map(str, parameters.values())),
)
def test_booster_types_equal_the_library(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    model = saved(train(parameters, lgb.Dataset(with_gaps(x), y)), tmp_path)
    assert_same(model)
    assert model.ir.accepts_nan
    assert set(model.ir.magnitude_limits) == {None}


@pytest.mark.parametrize(
    ("objective", "link"),
    [
        ("regression", None),
        ("regression_l1", None),
        ("huber", None),
        ("fair", None),
        ("quantile", None),
        ("mape", None),
        ("poisson", Function.EXP),
        ("gamma", Function.EXP),
        ("tweedie", Function.EXP),
        ("cross_entropy", Function.LOGISTIC),
    ],
)
def test_objectives_equal_the_library(objective: str, link: Function | None, tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    target = y / y.max() if objective == "cross_entropy" else y
    model = saved(train({"objective": objective}, lgb.Dataset(with_gaps(x), target)), tmp_path)
    functions = [op.function for op in model.ir.ops if isinstance(op, Activation)]
    assert functions == ([] if link is None else [link])
    # exp and division, each rounded once by either side, and one ulp between two math libraries
    assert_same(model, bound=None if link is None else lambda value: 4 * np.finfo(float).eps * np.abs(value))


@pytest.mark.parametrize("objective", ["regression", "regression_l1", "quantile", "fair", "mape"])
def test_square_root_target_is_squared_with_its_sign(objective: str, tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    model = saved(train({"objective": objective, "reg_sqrt": True}, lgb.Dataset(x, y - y.max())), tmp_path)
    assert [op.function for op in model.ir.ops[1:]] == [Function.SIGNED_SQUARE]
    assert_same(model)
    assert np.any(reference.evaluate(model.ir, x) < 0)


def test_huber_ignores_the_square_root_as_the_library_does(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    path = tmp_path / "model.txt"
    train({"objective": "huber"}, lgb.Dataset(x, y)).save_model(path)
    path.write_text(path.read_text().replace("objective=huber\n", "objective=huber sqrt\n"))
    model = walker.load_file(path, "model")
    assert len(model.ir.ops) == 1
    assert_same(model)


@pytest.mark.parametrize(
    "parameters",
    [{"use_missing": False}, {"zero_as_missing": True}, {}],
    ids=["none", "zero", "nan"],
)
def test_missing_types_equal_the_library(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    assert_same(saved(train(parameters, lgb.Dataset(with_gaps(x), y)), tmp_path))


def test_missing_types_that_differ_between_nodes_of_one_feature(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    booster = train({}, lgb.Dataset(with_gaps(x), y), 4)
    for parameters in ({"zero_as_missing": True}, {"use_missing": False}):
        data = lgb.Dataset(with_gaps(x), y, free_raw_data=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            booster = lgb.train(QUIET | parameters, data, 4, init_model=booster)
    model = saved(booster, tmp_path)
    readings = [(column.nan, column.missing_interval) for column in ensemble(model).columns if column.column == 0]
    assert len(set(readings)) == 3
    assert_same(model)


@pytest.mark.parametrize("parameters", [{"max_cat_to_onehot": 200}, {"min_data_per_group": 1, "cat_smooth": 1.0}])
def test_categories_equal_the_library(parameters: dict[str, Any], tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    gaps = with_gaps(x)
    model = saved(train(parameters, lgb.Dataset(gaps, y, categorical_feature=[2])), tmp_path)
    [column] = [column for column in ensemble(model).columns if column.categorical]
    assert column.n_categories > 32  # the bit sets have several words
    assert_same(model)


def test_zero_band_of_hand_made_thresholds(tmp_path: Path, assert_same: Any) -> None:
    """The library drops |x| <= 1e-35 before it compares; thresholds inside the band show it."""
    x, y = table()
    path = tmp_path / "model.txt"
    booster = train({"num_leaves": 2, "max_depth": 1}, lgb.Dataset(x[:, :1], y), 1)
    limit = walker.ZERO_MAGNITUDE
    for threshold in (0.0, -0.0, 5e-36, -5e-36, limit, -limit, np.nextafter(limit, 1), np.nextafter(-limit, -1)):
        text = booster.model_to_string()
        line = next(line for line in text.splitlines() if line.startswith("threshold="))
        changed = text.replace(line, f"threshold={float(threshold)!r}")
        size = next(line for line in text.splitlines() if line.startswith("tree_sizes="))
        new_size = int(size.partition("=")[2]) + len(changed) - len(text)
        path.write_text(changed.replace(size, f"tree_sizes={new_size}"))
        assert_same(walker.load_file(path, "model"))


def test_threshold_of_infinity_sends_everything_left(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    path = tmp_path / "model.txt"
    booster = train({"num_leaves": 2}, lgb.Dataset(x[:, :1], y), 1)
    text = booster.model_to_string()
    line = next(line for line in text.splitlines() if line.startswith("threshold="))
    size = next(line for line in text.splitlines() if line.startswith("tree_sizes="))
    new_size = int(size.partition("=")[2]) + len("threshold=inf") - len(line)
    path.write_text(text.replace(line, "threshold=inf").replace(size, f"tree_sizes={new_size}"))
    assert_same(walker.load_file(path, "model"))


@pytest.mark.parametrize("linear", [False, True])
def test_trees_of_a_single_leaf(linear: bool, tmp_path: Path, assert_same: Any) -> None:
    x, _ = table()
    model = saved(train({"linear_tree": linear}, lgb.Dataset(x, np.full(len(x), 1.75)), 2), tmp_path)
    assert ensemble(model).n_nodes == ensemble(model).n_trees
    assert_same(model)


def test_lines_in_leaves_that_grow_beyond_the_exponential_of_the_library_have_no_answer(tmp_path: Path) -> None:
    x, y = table()
    share = (y - y.min()) / np.ptp(y)
    found = saved(train({"linear_tree": True, "objective": "cross_entropy_lambda"}, lgb.Dataset(x, share)), tmp_path)
    rows = np.vstack(
        [x[~np.isnan(x).any(axis=1)][:40], np.array([[1e12], [-1e12], [1e5], [-1e5]]) * np.ones(x.shape[1])]
    )
    made = limit_inputs(found.ir)
    library, ours = found.predict(rows), reference.evaluate(made, rows)
    answered = np.isfinite(ours)
    assert answered[:40].all() and not np.isfinite(library).all()
    assert np.all(np.isfinite(library[answered]))
    assert np.all(np.abs(library - ours)[answered] <= bounds.difference_bound(made, rows)[answered])


def test_custom_objective_with_several_outputs(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    targets = np.column_stack([y, -y, y**2])

    def squared_error(raw: np.ndarray, _: Any) -> tuple[np.ndarray, np.ndarray]:
        return raw - targets, np.ones_like(raw)

    booster = train({"objective": squared_error, "num_class": 3}, lgb.Dataset(with_gaps(x), y), 5)
    model = saved(booster, tmp_path)
    assert model.ir.outputs == ("out1", "out2", "out3")
    assert any("custom objective" in note for note in model.ir.source.notes)
    assert_same(model)


def test_best_iteration_is_what_the_file_and_the_object_predict(tmp_path: Path, assert_same: Any) -> None:
    x, y = table()
    data = lgb.Dataset(x, y)
    booster = lgb.train(
        QUIET | {"learning_rate": 0.9},
        data,
        60,
        valid_sets=[lgb.Dataset(x[:50], y[:50] + 0.3 * np.sin(99 * y[:50]), reference=data)],
        callbacks=[lgb.early_stopping(3, verbose=False)],
        keep_training_booster=True,
    )
    best = booster.best_iteration
    assert 0 < best < booster.current_iteration()
    for model in (walker.load_object(booster, "model"), saved(booster, tmp_path)):
        assert ensemble(model).n_trees == best
        assert_same(model)
    everything = saved(booster, tmp_path, num_iteration=-1)
    assert ensemble(everything).n_trees == booster.current_iteration()
    assert_same(everything)


def test_regressor_object_equals_its_own_predict(assert_same: Any) -> None:
    x, y = table()
    regressor = lgb.LGBMRegressor(n_estimators=6, n_jobs=1, verbosity=-1).fit(with_gaps(x), y)
    model = walker.load_object(regressor, "model")
    assert_same(model)
    assert np.array_equal(model.predict(x)[:, 0], regressor.predict(x))


def test_estimator_behind_a_scaler_reads_the_scaled_value() -> None:
    x, y = table()
    regressor = lgb.LGBMRegressor(n_estimators=5, n_jobs=1, verbosity=-1).fit(x / 7, y)
    builder = GraphBuilder(3)
    scaled = builder.add(Scale((0,), Operator.DIVIDE, np.full(3, 7.0)))
    result = walk_estimator(regressor, builder, scaled)
    model = builder.model("model", tuple(walker.Feature(f"f{i}") for i in range(3)), walker.Source("", "", ""))
    assert result == len(model.ops)
    assert np.array_equal(reference.evaluate(model, x)[:, 0], regressor.booster_.predict(x / 7))


def test_coarse_grid_of_set_points(tmp_path: Path, assert_same: Any) -> None:
    speed, torque, oil = np.meshgrid(np.arange(1, 18) * 100.0, np.arange(19) * 100.0, [25.0, 30.0, 35.0])
    x = np.column_stack([speed.ravel(), torque.ravel(), oil.ravel()])
    y = 1e-3 * np.sin(x[:, 0] / 250) * x[:, 1] / 1800 + 1e-5 * x[:, 2]
    model = saved(train({"learning_rate": 0.39, "max_depth": 12, "num_leaves": 31}, lgb.Dataset(x, y), 60), tmp_path)
    assert_same(model)
    assert_same(model, x)


def test_pandas_categories_are_codes_named_in_the_notes(tmp_path: Path, assert_same: Any) -> None:
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(0)
    frame = pandas.DataFrame(
        {"x": rng.normal(size=300), "kind": pandas.Categorical(rng.choice(["low", "mid", "high"], 300))}
    )
    y = frame["x"] + frame["kind"].cat.codes
    regressor = lgb.LGBMRegressor(n_estimators=8, n_jobs=1, verbosity=-1, min_data_per_group=1).fit(frame, y)
    path = tmp_path / "model.txt"
    regressor.booster_.save_model(path)
    model = walker.load_file(path, "model")
    assert [feature.name for feature in model.ir.features] == ["x", "kind"]
    assert "feature 'kind' is a category code: 0 = high, 1 = low, 2 = mid" in model.ir.source.notes
    assert_same(model)
    coded = np.column_stack([frame["x"], frame["kind"].cat.codes])
    assert np.array_equal(reference.evaluate(model.ir, coded)[:, 0], regressor.predict(frame))


@pytest.mark.parametrize("path", sorted(DATA.glob("lightgbm-*.txt")), ids=lambda path: path.stem)
def test_files_of_older_versions(path: Path, assert_same: Any) -> None:
    model = walker.load_file(path, "model")
    assert model.ir.source.version == "text format v3"
    assert_same(model, bound=(lambda value: 4 * np.finfo(float).eps * value) if "poisson" in path.name else None)


def test_source_says_what_was_read(tmp_path: Path) -> None:
    x, y = table()
    model = saved(train({"boosting": "dart", "linear_tree": True}, lgb.Dataset(x, y)), tmp_path)
    source = model.ir.source
    assert (source.library, source.version) == ("LightGBM", "text format v4")
    assert source.model_class == "LightGBM text model (dart)"
    assert "linear models in the leaves" in source.notes
    assert [feature.name for feature in model.ir.features] == ["Column_0", "Column_1", "Column_2"]
    assert (source.file, source.digest) == ("", "")


def test_features_of_objects() -> None:
    x, y = table()
    regressor = lgb.LGBMRegressor(n_estimators=2, n_jobs=1, verbosity=-1).fit(x, y, feature_name=["a", "b", "c"])
    for model in (regressor, regressor.booster_):
        assert [feature.name for feature in walker.load_object(model, "m").ir.features] == ["a", "b", "c"]


def test_unfitted_estimator_is_refused() -> None:
    with pytest.raises(InputError, match=r"LGBMRegressor: not fitted: call fit\(\)"):
        walker.load_object(lgb.LGBMRegressor(), "model")


def test_width_of_the_input_is_checked() -> None:
    x, y = table()
    regressor = lgb.LGBMRegressor(n_estimators=2, n_jobs=1, verbosity=-1).fit(x, y)
    with pytest.raises(InputError, match="LGBMRegressor: the model has 3 features, its input 2 columns"):
        walker.walk(regressor, GraphBuilder(2), 0)


def test_reading_needs_no_package_but_predicting_does(tmp_path: Path, without_package: Any) -> None:
    x, y = table()
    path = tmp_path / "model.txt"
    train({}, lgb.Dataset(x, y)).save_model(path)
    without_package("lightgbm")
    model = walker.load_file(path, "model")
    assert np.all(np.isfinite(reference.evaluate(model.ir, x)))
    with pytest.raises(
        MissingExtraError, match=r'model\.txt by LightGBM needs .* pip install "st-codegen\[lightgbm\]"'
    ):
        model.predict(x)


def test_rows_are_predicted_one_by_one_as_together(tmp_path: Path) -> None:
    x, y = table()
    model = saved(train({"linear_tree": True}, lgb.Dataset(with_gaps(x), y)), tmp_path)
    assert np.array_equal(np.vstack([model.predict(row[None, :]) for row in x[:40]]), model.predict(x)[:40])


def test_no_rows_give_no_predictions(tmp_path: Path) -> None:
    x, y = table()
    assert saved(train({}, lgb.Dataset(x, y)), tmp_path).predict(np.zeros((0, 3))).shape == (0, 1)


@examples()
@given(
    seed=st.integers(0, 10**6),
    columns=st.integers(1, 4),
    digits=st.integers(0, 12),
    gaps=st.sampled_from([0.0, 0.3]),
    parameters=st.fixed_dictionaries(
        {"num_leaves": st.integers(2, 20), "boosting": st.sampled_from(["gbdt", "dart"])},
        optional={"linear_tree": st.just(True), "use_missing": st.just(False), "extra_trees": st.just(True)},
    ),
)
def test_random_small_models(
    seed: int, columns: int, digits: int, gaps: float, parameters: dict[str, Any], request: pytest.FixtureRequest
) -> None:
    rng = np.random.default_rng(seed)
    x = np.round(rng.normal(size=(120, columns)) * 10.0 ** rng.integers(-3, 4), digits)
    x[:, 0] = np.abs(np.trunc(x[:, 0]))
    y = rng.normal(size=120) + x[:, -1]
    data = lgb.Dataset(with_gaps(x, gaps), y, categorical_feature=[0] if seed % 2 else "auto")
    booster = train({"min_data_in_leaf": 1, "max_bin": 15, "min_data_per_group": 1, **parameters}, data, 4)
    folder = request.getfixturevalue("tmp_path_factory").mktemp("random")
    request.getfixturevalue("assert_same")(saved(booster, folder))


def test_in_a_sparse_matrix_the_lower_end_of_the_band_of_zero_is_a_number():
    """What LightGBM does with rows of the pipeline: a threshold just below 0 is met by the float32 next to -1e-35."""
    compose, preprocessing = pytest.importorskip("sklearn.compose"), pytest.importorskip("sklearn.preprocessing")
    pipeline = pytest.importorskip("sklearn.pipeline")
    random = np.random.default_rng(0)
    x = np.column_stack([random.normal(size=400), np.arange(400) % 12])
    x[::5, 0] = 0.0
    front = compose.ColumnTransformer([("kinds", preprocessing.OneHotEncoder(), [1])], remainder="passthrough")
    trees = lgb.LGBMRegressor(n_estimators=10, verbose=-1, n_jobs=1)
    loaded = from_estimator(pipeline.make_pipeline(front, trees).fit(x, x[:, 0] + (x[:, 0] == 0.0)), "m")
    end = float(np.float32(1e-35))
    near = [0.0, *(sign * value for sign in (1.0, -1.0) for value in (end, 1e-35, 1e-36, 5e-324, np.nextafter(end, 1)))]
    rows = np.column_stack([near, np.full(len(near), 4.0)])
    assert np.array_equal(reference.evaluate(loaded.ir, rows), loaded.predict(rows))
    assert loaded.predict(rows[[0]]) != loaded.predict(np.array([[-end, 4.0]]))
