"""Writes the models of older library versions beside this file; run once for each version, with it installed.

python make_old_models.py xgboost, or lightgbm, or catboost, whose answers are written beside its models
"""

import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent


def table() -> tuple[np.ndarray, np.ndarray]:
    """Two numbers with gaps, one category code, and a target."""
    rng = np.random.RandomState(7)
    x = rng.uniform(-2, 3, size=(300, 3)).round(2)
    x[:, 2] = rng.randint(0, 40, 300)
    y = np.abs(x[:, 0]) + 0.3 * x[:, 1] ** 2 + 3 * (x[:, 2] % 3)
    x[rng.uniform(size=300) < 0.1, 0] = np.nan
    return x, y.astype(np.float32)


def write_xgboost() -> None:
    import xgboost as xgb

    version = tuple(int(part) for part in xgb.__version__.split("."))
    x, y = table()
    base = {"max_depth": 2, "eta": 0.5, "base_score": 0.7, "verbosity": 0, "nthread": 1}

    def train(name: str, data: object, rounds: int = 3, suffix: str = "json", **parameters: object) -> None:
        booster = xgb.train(dict(base, **parameters), data, rounds)
        booster.save_model(str(HERE / f"xgboost-{xgb.__version__}-{name}.{suffix}"))

    numbers = xgb.DMatrix(x[:, :2], label=y)
    train("squarederror", numbers, tree_method="exact")
    train("dart", numbers, booster="dart", rate_drop=0.5, rounds=4)
    train("gblinear", numbers, booster="gblinear")
    train("poisson", xgb.DMatrix(x[:, :2], label=np.round(y)), objective="count:poisson")
    train("logistic", xgb.DMatrix(x[:, :2], label=y / y.max()), objective="reg:logistic")
    if version >= (1, 4):
        train("pruned", numbers, tree_method="exact", max_depth=4, gamma=30.0)
    if version < (1, 6):
        forest = xgb.XGBRFClassifier(n_estimators=3, max_depth=2, n_jobs=1, missing=0.0, random_state=1)
        forest.fit(np.nan_to_num(x[:, :2]), np.where(y > 4, 20, 10))
        forest.save_model(str(HERE / f"xgboost-{xgb.__version__}-logistic-forest.json"))
    if version >= (1, 6):
        coded = xgb.DMatrix(x, label=y, feature_types=["q", "q", "c"], enable_categorical=True)
        train("category", coded, tree_method="hist", suffix="ubj")
        train("multi", xgb.DMatrix(x[:, :2], label=np.c_[y, -y]), tree_method="hist", rounds=2)
        model = xgb.XGBRegressor(n_estimators=3, max_depth=2, n_jobs=1)
        model.fit(x[:, :2], y)
        model.save_model(str(HERE / f"xgboost-{xgb.__version__}-sklearn.ubj"))
    if version >= (2, 0):
        levels = {"objective": "reg:quantileerror", "quantile_alpha": np.array([0.1, 0.9])}
        train("quantile", numbers, tree_method="hist", rounds=2, **levels)
        vectors = {"tree_method": "hist", "multi_strategy": "multi_output_tree"}
        train("vectors", xgb.DMatrix(x[:, :2], label=np.c_[y, -y]), rounds=2, **vectors)


def write_lightgbm() -> None:
    import lightgbm as lgb

    version = tuple(int(part) for part in lgb.__version__.split("."))
    x, y = table()
    base = {"verbosity": -1, "num_leaves": 4, "num_threads": 1, "min_data_in_leaf": 5, "seed": 1}

    def train(name: str, data: object, **parameters: object) -> None:
        booster = lgb.train(dict(base, **parameters), data, 3)
        booster.save_model(str(HERE / f"lightgbm-{lgb.__version__}-{name}.txt"))

    grouped = {"min_data_per_group": 1, "cat_smooth": 1.0, "cat_l2": 1.0}
    train("category", lgb.Dataset(x, y, categorical_feature=[2]), **grouped)
    forest = {"boosting": "rf", "bagging_fraction": 0.7, "bagging_freq": 1, "zero_as_missing": True}
    train("rf", lgb.Dataset(x[:, :2], y), **forest)
    train("poisson", lgb.Dataset(x[:, :2], np.round(y)), objective="poisson")
    if version >= (3, 2):
        train("linear", lgb.Dataset(x[:, :2], y), linear_tree=True)


def write_catboost() -> None:
    import catboost

    x, y = table()
    x = x[:, :2]
    whole, sizes = np.nan_to_num(x), np.digitize(y, [1.0, 2.0])
    base = {
        "depth": 2,
        "iterations": 4,
        "random_seed": 1,
        "thread_count": 1,
        "verbose": 0,
        "allow_writing_files": False,
    }
    answers = {}

    def train(name: str, x: np.ndarray, y: np.ndarray, classes: bool = False, **parameters: object) -> None:
        model = (catboost.CatBoostClassifier if classes else catboost.CatBoostRegressor)(**dict(base, **parameters))
        model.fit(x, y)
        if name == "scaled":
            model.set_scale_and_bias(0.1, 0.7)
        path = HERE / f"catboost-{catboost.__version__}-{name}.json"
        model.save_model(str(path), format="json")
        path.write_text(json.dumps(_small(json.loads(path.read_text()))) + "\n")
        rows = _rows(path)
        if not hasattr(model, "predict_proba"):
            answers[name] = [np.reshape(row, -1).tolist() for row in model.predict(rows)]
            return
        raw = model.predict(rows, prediction_type="RawFormulaVal").reshape(len(rows), -1)
        parts = zip(
            np.ravel(model.predict(rows)).tolist(), model.predict_proba(rows).tolist(), raw.tolist(), strict=True
        )
        answers[name] = [[label, *chances, *scores] for label, chances, scores in parts]

    def _small(document: dict) -> dict:
        """The export without what says how it was trained."""
        info = document["model_info"]
        kept = ("catboost_version_info", "class_params", "params")
        document["model_info"] = {key: info[key] for key in kept if key in info}
        document["model_info"]["params"] = {"loss_function": info["params"]["loss_function"]}
        return document

    train("rmse", x, y, depth=3)
    train("gaps-high", x, y, nan_mode="Max")
    train("no-gaps", whole, y)
    train("scaled", x, y)
    train("poisson", x, np.round(y), loss_function="Poisson")
    train("two-outputs", x, np.column_stack([y, -y]), loss_function="MultiRMSE")
    train("text-labels", x, np.array(["bad", "good"])[(y > 1.5).astype(int)], classes=True)
    train("multiclass", x, sizes, classes=True, loss_function="MultiClass")
    train("one-vs-all", x, sizes, classes=True, loss_function="MultiClassOneVsAll")
    train("other-trees", x, y, grow_policy="Lossguide")
    (HERE / f"catboost-{catboost.__version__}-answers.txt").write_text(json.dumps(answers) + "\n")


def _rows(path: Path) -> np.ndarray:
    """Rows around all borders of a model, of gaps and of large numbers; test_catboost.py makes the same."""
    features = json.loads(path.read_text())["features_info"]["float_features"]
    borders = [np.float32(border) for feature in features for border in feature["borders"]][:60]
    near = [float(np.nextafter(border, np.float32(end))) for border in borders for end in (-9, 9)]
    pool = [*map(float, borders), *near, np.nan, np.inf, -np.inf, 1e300, -1e300, 0.0, 3.5e38]
    return np.random.RandomState(3).choice(pool, size=(80, len(features)))


if __name__ == "__main__":
    {"xgboost": write_xgboost, "lightgbm": write_lightgbm, "catboost": write_catboost}[sys.argv[1]]()
