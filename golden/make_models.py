"""Trains the golden models once, and computes their golden outputs by the source libraries alone.

The files below `golden/` are committed; run this only to add a model:

    python golden/make_models.py            # makes what is missing
    python golden/make_models.py NAME ..    # makes these again

`monitoring` is a project of its own. Each other model gets `lone/models/NAME.*`, `lone/inputs/NAME.csv` and
`lone/outputs/NAME.csv`. The expected Structured Text is written by `pytest tests/emit/test_golden.py --update-golden`.
"""

from __future__ import annotations

import sys
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lightgbm
import numpy as np
import onnx
import onnxruntime
import skops.io
import xgboost
from onnx import TensorProto, helper, numpy_helper
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.ensemble import (
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingRegressor,
    IsolationForest,
    RandomForestClassifier,
    RandomForestRegressor,
)
from sklearn.linear_model import ElasticNet, Lasso, LinearRegression, Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, MinMaxScaler, RobustScaler, StandardScaler
from sklearn.svm import SVR, LinearSVR, NuSVR
from sklearn.tree import DecisionTreeRegressor, ExtraTreeRegressor

HERE = Path(__file__).parent / "lone"
RANDOM = np.random.default_rng(2026)
GRID = np.stack(np.meshgrid(np.arange(1, 10) * 200.0, np.arange(7) * 300.0, [25.0, 30.0, 35.0]), -1).reshape(-1, 3)
TARGET = 0.02 + 1e-5 * GRID[:, 1] + 0.01 * np.sin(GRID[:, 0] / 300.0) + 1e-4 * GRID[:, 2]
TWO_TARGETS = np.column_stack([TARGET, np.cos(GRID[:, 0] / 200.0)])
WITH_GAPS = GRID.copy()
WITH_GAPS[RANDOM.random(GRID.shape) < 0.15] = np.nan
WITH_CATEGORY = np.column_stack([GRID[:, :2], RANDOM.integers(0, 6, len(GRID)).astype(float)])
CATEGORY_TARGET = TARGET + 0.02 * np.isin(WITH_CATEGORY[:, 2], [1, 4])
#: So many inputs that a table of all cells between a few thresholds is too large.
SCATTERED = np.round(np.random.default_rng(17).uniform(0.0, 3.0, (150, 5)), 2)


def rows(x: np.ndarray, *, missing: bool = False) -> np.ndarray:
    """Sixty rows in and around the range of `x`, set-points and points between them; with NaN where asked."""
    random = np.random.default_rng(7)
    low, high = np.nanmin(x, axis=0), np.nanmax(x, axis=0)
    between = low + (high - low) * random.uniform(-0.1, 1.1, (30, x.shape[1]))
    points = np.vstack([np.nan_to_num(x[random.choice(len(x), 30)], nan=1.0), between])
    if missing:
        points[random.random(points.shape) < 0.2] = np.nan
    return points


# --- scikit-learn -------------------------------------------------------------------------------------------------


def scikit(estimator: Any, x: np.ndarray = GRID, y: np.ndarray = TARGET, **options: Any) -> Callable[[str], Any]:
    """A fitted estimator, saved with skops."""

    def make(name: str) -> tuple[np.ndarray, np.ndarray]:
        estimator.fit(x, y)
        skops.io.dump(estimator, HERE / "models" / f"{name}.skops", compression=zipfile.ZIP_DEFLATED)
        points = rows(x, **options)
        return points, estimator.predict(points)

    return make


# --- LightGBM -----------------------------------------------------------------------------------------------------


def light(
    parameters: dict[str, Any], x: np.ndarray = GRID, y: np.ndarray = TARGET, **options: Any
) -> Callable[[str], Any]:
    """A LightGBM text file."""
    categories = options.pop("categories", "auto")

    def make(name: str) -> tuple[np.ndarray, np.ndarray]:
        settings = {"verbose": -1, "num_leaves": 6, "num_threads": 1, "seed": 1, "deterministic": True, **parameters}
        data = lightgbm.Dataset(x, y, categorical_feature=categories, params={"min_data_in_bin": 1})
        path = HERE / "models" / f"{name}.txt"
        lightgbm.train(settings, data, 4).save_model(path)
        points = rows(x, **options)
        return points, lightgbm.Booster(model_file=path).predict(points, num_threads=1)

    return make


# --- XGBoost ------------------------------------------------------------------------------------------------------


def boost(
    parameters: dict[str, Any], x: np.ndarray = GRID, y: np.ndarray = TARGET, **options: Any
) -> Callable[[str], Any]:
    """An XGBoost file; the prediction goes through a DMatrix."""
    suffix = options.pop("suffix", "json")
    types = options.pop("types", None)

    def matrix(points: np.ndarray, label: np.ndarray | None = None) -> xgboost.DMatrix:
        return xgboost.DMatrix(points, label, feature_types=types, enable_categorical=types is not None)

    def make(name: str) -> tuple[np.ndarray, np.ndarray]:
        settings = {"max_depth": 3, "nthread": 1, "seed": 1, **parameters}
        path = HERE / "models" / f"{name}.{suffix}"
        xgboost.train(settings, matrix(x, y), 4).save_model(path)
        points = rows(x, **options)
        booster = xgboost.Booster({"nthread": 1}, model_file=path)
        return points, np.vstack([booster.predict(matrix(point[None])) for point in points])

    return make


# --- ONNX ---------------------------------------------------------------------------------------------------------


def graph(nodes: list[Any], constants: dict[str, np.ndarray], outputs: int, ml: int = 3) -> Callable[[str], Any]:
    """A hand-made ONNX graph from x (one row of three numbers) to y."""

    def make(name: str) -> tuple[np.ndarray, np.ndarray]:
        model = helper.make_model(
            helper.make_graph(
                nodes,
                name,
                [helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, 3])],
                [helper.make_tensor_value_info("y", TensorProto.FLOAT, [None, outputs])],
                [numpy_helper.from_array(value.astype(np.float32), key) for key, value in constants.items()],
            ),
            opset_imports=[helper.make_opsetid("", 17), helper.make_opsetid("ai.onnx.ml", ml)],
            ir_version=8,
        )
        path = HERE / "models" / f"{name}.onnx"
        onnx.save_model(model, path)
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        points = rows(GRID)
        return points, np.vstack([session.run(None, {"x": point[None].astype(np.float32)})[0] for point in points])

    return make


def onnx_trees() -> Callable[[str], Any]:
    """Two trees that mix the comparisons of TreeEnsembleRegressor (ai.onnx.ml 3)."""
    modes = ["BRANCH_LEQ", "LEAF", "BRANCH_GT", "LEAF", "LEAF", "BRANCH_LT", "LEAF", "LEAF"]
    node = helper.make_node(
        "TreeEnsembleRegressor",
        ["x"],
        ["y"],
        domain="ai.onnx.ml",
        n_targets=1,
        base_values=[0.25],
        nodes_treeids=[0, 0, 0, 0, 0, 1, 1, 1],
        nodes_nodeids=[0, 1, 2, 3, 4, 0, 1, 2],
        nodes_featureids=[0, 0, 1, 0, 0, 2, 0, 0],
        nodes_modes=modes,
        nodes_values=[700.0, 0.0, 900.0, 0.0, 0.0, 30.0, 0.0, 0.0],
        nodes_truenodeids=[1, 0, 3, 0, 0, 1, 0, 0],
        nodes_falsenodeids=[2, 0, 4, 0, 0, 2, 0, 0],
        nodes_missing_value_tracks_true=[1, 0, 0, 0, 0, 0, 0, 0],
        target_treeids=[0, 0, 0, 1, 1],
        target_nodeids=[1, 3, 4, 1, 2],
        target_ids=[0, 0, 0, 0, 0],
        target_weights=[0.1, -0.2, 0.3, 0.01, -0.02],
    )
    return graph([node], {}, 1)


def onnx_ensemble() -> Callable[[str], Any]:
    """TreeEnsemble (ai.onnx.ml 5) with a set membership."""
    node = helper.make_node(
        "TreeEnsemble",
        ["x"],
        ["y"],
        domain="ai.onnx.ml",
        n_targets=1,
        aggregate_function=1,
        tree_roots=[0],
        nodes_featureids=[2, 0],
        nodes_modes=numpy_helper.from_array(np.array([6, 0], np.uint8), "nodes_modes"),
        nodes_splits=numpy_helper.from_array(np.array([0.0, 800.0], np.float32), "nodes_splits"),
        nodes_truenodeids=[1, 1],
        nodes_trueleafs=[0, 1],
        nodes_falsenodeids=[0, 2],
        nodes_falseleafs=[1, 1],
        leaf_targetids=[0, 0, 0],
        leaf_weights=numpy_helper.from_array(np.array([0.5, -0.25, 1.5], np.float32), "leaf_weights"),
        membership_values=numpy_helper.from_array(np.array([25.0, 35.0, np.nan], np.float32), "membership_values"),
    )
    return graph([node], {}, 1, ml=5)


def onnx_network() -> Callable[[str], Any]:
    """A small feed-forward network as exporters write it."""
    random = np.random.default_rng(11)
    nodes = [
        helper.make_node(
            "Scaler", ["x"], ["s"], domain="ai.onnx.ml", offset=[900.0, 900.0, 30.0], scale=[0.002, 0.002, 0.2]
        ),
        helper.make_node("Gemm", ["s", "w1", "b1"], ["h1"], transB=1),
        helper.make_node("Tanh", ["h1"], ["t1"]),
        helper.make_node("MatMul", ["t1", "w2"], ["h2"]),
        helper.make_node("Add", ["h2", "b2"], ["h3"]),
        helper.make_node("LeakyRelu", ["h3"], ["t2"], alpha=0.1),
        helper.make_node("Gemm", ["t2", "w3", "b3"], ["y"]),
    ]
    constants = {
        "w1": random.normal(size=(5, 3)),
        "b1": random.normal(size=5),
        "w2": random.normal(size=(5, 4)),
        "b2": random.normal(size=4),
        "w3": random.normal(size=(4, 2)),
        "b3": random.normal(size=2),
    }
    return graph(nodes, constants, 2)


def onnx_svm() -> Callable[[str], Any]:
    """SVMRegressor with an RBF kernel on normalised inputs."""
    random = np.random.default_rng(13)
    nodes = [
        helper.make_node("Normalizer", ["x"], ["n"], domain="ai.onnx.ml", norm="L2"),
        helper.make_node(
            "SVMRegressor",
            ["n"],
            ["y"],
            domain="ai.onnx.ml",
            kernel_type="RBF",
            kernel_params=[1.5, 0.0, 3.0],
            n_supports=6,
            support_vectors=random.uniform(0, 1, 18).tolist(),
            coefficients=random.normal(size=6).tolist(),
            rho=[0.1],
        ),
    ]
    return graph(nodes, {}, 1)


MODELS: dict[str, Callable[[str], Any]] = {
    "svr": scikit(make_pipeline(StandardScaler(), SVR(epsilon=0.005))),
    "svr_polynomial": scikit(make_pipeline(MinMaxScaler(), SVR(kernel="poly", coef0=1.0, epsilon=0.01))),
    "nu_svr": scikit(make_pipeline(StandardScaler(), NuSVR(nu=0.1))),
    "linear_svr": scikit(make_pipeline(StandardScaler(), LinearSVR(random_state=1))),
    "mlp_tanh": scikit(
        make_pipeline(
            StandardScaler(),
            MLPRegressor(hidden_layer_sizes=(6, 4), activation="tanh", max_iter=200, random_state=1),
        )
    ),
    "mlp_logistic": scikit(
        TransformedTargetRegressor(
            make_pipeline(
                RobustScaler(),
                MLPRegressor(hidden_layer_sizes=(5,), activation="logistic", max_iter=200, random_state=1),
            ),
            transformer=StandardScaler(),
        ),
        y=TWO_TARGETS,
    ),
    "mlp_relu": scikit(
        make_pipeline(MinMaxScaler(clip=True), MLPRegressor(hidden_layer_sizes=(4,), max_iter=200, random_state=1))
    ),
    "decision_tree": scikit(DecisionTreeRegressor(max_depth=4, random_state=1)),
    "extra_tree": scikit(ExtraTreeRegressor(max_depth=4, random_state=1)),
    "random_forest": scikit(RandomForestRegressor(4, max_depth=3, random_state=1)),
    "random_forest_two_outputs": scikit(RandomForestRegressor(3, max_depth=3, random_state=1), y=TWO_TARGETS),
    "extra_trees": scikit(ExtraTreesRegressor(4, max_depth=3, random_state=1)),
    "extra_trees_ranked": scikit(
        ExtraTreesRegressor(5, max_leaf_nodes=8, random_state=1), x=SCATTERED, y=np.sin(SCATTERED).sum(axis=1)
    ),
    "gradient_boosting": scikit(GradientBoostingRegressor(n_estimators=4, random_state=1)),
    "hist_gradient_boosting": scikit(HistGradientBoostingRegressor(max_iter=4, max_leaf_nodes=6, random_state=1)),
    "hist_gradient_boosting_missing": scikit(
        HistGradientBoostingRegressor(max_iter=4, max_leaf_nodes=6, random_state=1), x=WITH_GAPS, missing=True
    ),
    "hist_gradient_boosting_category": scikit(
        HistGradientBoostingRegressor(max_iter=3, max_leaf_nodes=6, categorical_features=[2], random_state=1),
        x=WITH_CATEGORY,
        y=CATEGORY_TARGET,
        missing=True,
    ),
    "linear_regression": scikit(LinearRegression(), y=TWO_TARGETS),
    "ridge": scikit(
        make_pipeline(
            ColumnTransformer([("a", FunctionTransformer(np.log1p), [2]), ("b", "passthrough", [0])]), Ridge()
        )
    ),
    "lasso": scikit(TransformedTargetRegressor(Lasso(alpha=1e-4), func=np.log1p, inverse_func=np.expm1)),
    "elastic_net": scikit(
        make_pipeline(
            ColumnTransformer([("a", RobustScaler(), [2, 0]), ("b", FunctionTransformer(), [1])]),
            ElasticNet(alpha=1e-4),
        )
    ),
    "lightgbm_gbdt": light({}),
    "lightgbm_dart": light({"boosting": "dart"}),
    "lightgbm_rf": light({"boosting": "rf", "bagging_fraction": 0.5, "bagging_freq": 1}),
    "lightgbm_missing": light({}, x=WITH_GAPS, missing=True),
    "lightgbm_zero_missing": light({"zero_as_missing": True}, x=np.nan_to_num(WITH_GAPS), missing=True),
    "lightgbm_category": light(
        {"min_data_per_group": 5, "cat_smooth": 1}, x=WITH_CATEGORY, y=CATEGORY_TARGET, categories=[2], missing=True
    ),
    "lightgbm_linear": light({"linear_tree": True}, missing=True),
    "xgboost_gbtree": boost({}),
    "xgboost_dart": boost({"booster": "dart", "rate_drop": 0.5}),
    "xgboost_gblinear": boost({"booster": "gblinear"}),
    "xgboost_missing": boost({"num_parallel_tree": 2}, x=WITH_GAPS, missing=True, suffix="ubj"),
    "xgboost_category": boost(
        {"max_cat_to_onehot": 1},
        x=WITH_CATEGORY,
        y=CATEGORY_TARGET,
        types=["float", "float", "c"],
        suffix="ubj",
    ),
    "xgboost_two_outputs": boost({"multi_strategy": "multi_output_tree"}, y=TWO_TARGETS),
    "xgboost_poisson": boost({"objective": "count:poisson"}),
    "onnx_trees": onnx_trees(),
    "onnx_ensemble": onnx_ensemble(),
    "onnx_network": onnx_network(),
    "onnx_svm": onnx_svm(),
}


def write(path: Path, header: list[str], values: np.ndarray) -> None:
    """A CSV file in full precision."""
    lines = [",".join(header), *(",".join(f"{value:.17g}" for value in row) for row in values)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def monitoring() -> None:
    """A classifier, a detector of anomalies, and a network over a window of samples, below `monitoring/models`."""
    folder = HERE.parent / "monitoring" / "models"
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    centres = {"healthy": (0.8, 3.0, 45.0), "worn": (1.9, 4.2, 52.0), "dry": (1.4, 6.5, 71.0)}
    x = np.vstack([random.normal(c, (0.2, 0.5, 4.0), (40, 3)) for c in centres.values()])
    y = np.repeat(list(centres), 40)
    state = RandomForestClassifier(4, max_depth=3, random_state=1).fit(x, y)
    known = IsolationForest(n_estimators=4, max_samples=16, random_state=1).fit(x[y == "healthy"])
    for name, estimator in (("state", state), ("known", known)):
        skops.io.dump(estimator, folder / f"{name}.skops", compression=zipfile.ZIP_DEFLATED)
    nodes = [
        helper.make_node("Conv", ["samples", "kernel"], ["band"]),
        helper.make_node("LSTM", ["turned", "w", "r"], ["", "last"], hidden_size=2),
        helper.make_node("Abs", ["band"], ["sizes"]),
        helper.make_node("GlobalMaxPool", ["sizes"], ["peak"]),
        helper.make_node("Flatten", ["peak"], ["flat"]),
        helper.make_node("Squeeze", ["last", "first"], ["state"]),
        helper.make_node("Concat", ["flat", "state"], ["out"], axis=1),
    ]
    nodes.insert(0, helper.make_node("Transpose", ["samples"], ["turned"], perm=[2, 0, 1]))
    constants = {"kernel": (2, 1, 3), "w": (1, 8, 1), "r": (1, 8, 2)}
    known_constants = [
        numpy_helper.from_array(random.normal(size=shape).astype(np.float32), name) for name, shape in constants.items()
    ]
    known_constants.append(numpy_helper.from_array(np.array([0], np.int64), "first"))
    inputs = [helper.make_tensor_value_info("samples", TensorProto.FLOAT, [1, 1, 6])]
    outputs = [helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, 4])]
    made = helper.make_graph(nodes, "wave", inputs, outputs, known_constants)
    network = helper.make_model(made, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    (folder / "wave.onnx").write_bytes(network.SerializeToString())
    window = '[[model]]\nfile = "wave.onnx"\nwindow = 6\nsamples = ["fVibration"]\n'
    (folder / "st-codegen.toml").write_text(f'[project]\nname = "Monitoring"\n\n{window}', encoding="utf-8")


def main(names: list[str]) -> None:
    """Make the named models, or all that are missing."""
    for folder in ("models", "inputs", "outputs"):
        (HERE / folder).mkdir(parents=True, exist_ok=True)
    for name, make in MODELS.items():
        if name in names or (not names and not (HERE / "outputs" / f"{name}.csv").exists()):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                inputs, outputs = make(name)
            outputs = np.asarray(outputs, np.float64).reshape(len(inputs), -1)
            width = outputs.shape[1]
            write(HERE / "inputs" / f"{name}.csv", [f"f{number}" for number in range(inputs.shape[1])], inputs)
            write(
                HERE / "outputs" / f"{name}.csv",
                [name] if width == 1 else [f"{name}[{number}]" for number in range(width)],
                outputs,
            )
            print(name)
    if "monitoring" in names or not (HERE.parent / "monitoring" / "models").exists():
        monitoring()


if __name__ == "__main__":
    main(sys.argv[1:])
