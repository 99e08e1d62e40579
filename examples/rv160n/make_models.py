"""Trains the models of this example: ten families, ten harmonic orders, both directions.

The transmission error that they learn is a formula of this project's own making, with sizes like those of a Nabtesco
RV 160N: twist in proportion to the torque, an order 1 that hardly changes, mesh orders that grow with the torque, and
one structural resonance near 54 Hz that lifts the high orders at the speeds where they meet it. Run it with

    python examples/rv160n/make_models.py
"""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import lightgbm
import numpy as np
import skops.io
import xgboost
from onnx import save_model
from skl2onnx import to_onnx
from skl2onnx.common.data_types import FloatTensorType
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import (
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingRegressor,
    RandomForestRegressor,
)
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR
from sklearn.tree import DecisionTreeRegressor, ExtraTreeRegressor

MODELS = Path(__file__).parent / "models"
SPEED, TORQUE, OIL = np.arange(100.0, 1801.0, 100.0), np.arange(0.0, 1801.0, 100.0), np.array([25.0, 30.0, 35.0])
REDUCTION_RATIO = 81.0
RESONANCE_HZ, DAMPING = 54.0, 0.04

#: order -> amplitude without load (deg), growth at 1000 N m (deg), phase (rad)
ORDERS = {
    1: (0.0172, 0.0, 0.0),
    3: (0.00080, 0.00010, 1.8),
    39: (0.00080, 0.00050, -1.2),
    40: (0.00085, 0.00005, 0.2),
    78: (0.00015, 0.00110, -0.2),
    81: (0.00028, 0.00005, -1.0),
    156: (0.00012, 0.00008, 0.9),
    162: (0.00018, 0.00006, -2.6),
    240: (0.00030, 0.00012, -1.6),
}


def grid() -> np.ndarray:
    """All operating points (speed rpm, torque N m, oil temperature degC), shape (1026, 3)."""
    return np.stack(np.meshgrid(SPEED, TORQUE, OIL, indexing="ij"), -1).reshape(-1, 3)


def mean_error(x: np.ndarray, sign: float) -> np.ndarray:
    """Order 0 in deg: friction turns it against the motion, the load twists the shaft."""
    return -0.02 - sign * 3.67e-5 * x[:, 1] + 1e-4 * (x[:, 2] - 25.0) - 2e-6 * sign * x[:, 0]


def harmonic(x: np.ndarray, order: int, sign: float) -> np.ndarray:
    """A_k * exp(i * phi_k) in deg, shape (rows,)."""
    amplitude, growth, phase = ORDERS[order]
    size = amplitude + growth * x[:, 1] / 1000.0 * (1.0 - 0.004 * (x[:, 2] - 25.0))
    frequency = order * x[:, 0] / REDUCTION_RATIO / 60.0
    ratio = frequency / RESONANCE_HZ
    lifted = 1.0 / (1.0 - ratio**2 + 2j * DAMPING * ratio) if order > 100 else 1.0
    angle = phase + 0.1 * sign + 0.15 * x[:, 1] / 1800.0 - 0.10 * x[:, 0] / 1800.0
    return size * np.exp(1j * angle) * lifted


def families() -> dict[str, object]:
    """The ten families, small enough to read what is generated from them."""
    return {
        "svr": make_pipeline(
            StandardScaler(),
            TransformedTargetRegressor(SVR(C=10.0, epsilon=0.05), transformer=StandardScaler()),
        ),
        "mlp": make_pipeline(
            StandardScaler(),
            TransformedTargetRegressor(
                MLPRegressor(hidden_layer_sizes=(24, 12), activation="tanh", max_iter=400, random_state=1),
                transformer=StandardScaler(),
            ),
        ),
        "rf": RandomForestRegressor(8, max_depth=5, random_state=1),
        "dt": DecisionTreeRegressor(max_depth=7, min_samples_split=6, random_state=1),
        "et": ExtraTreeRegressor(max_depth=7, min_samples_split=5, random_state=1),
        "ert": ExtraTreesRegressor(8, max_depth=6, min_samples_split=3, random_state=1),
        "gbm": GradientBoostingRegressor(n_estimators=12, max_depth=4, random_state=1),
        "hgbm": HistGradientBoostingRegressor(learning_rate=0.21, max_depth=5, max_iter=20, random_state=1),
        "lgbm": lightgbm.LGBMRegressor(n_estimators=20, max_depth=5, random_state=1, verbose=-1, n_jobs=1),
        "xgbm": xgboost.XGBRegressor(n_estimators=20, max_depth=4, random_state=1, n_jobs=1),
    }


#: order -> (kind of the pair, family of each part, format of the files)
CHOICE = {
    1: ("amplitude", "rf", "lgbm"),
    3: ("amplitude", "hgbm", "hgbm"),
    39: ("amplitude", "lgbm", "hgbm"),
    40: ("amplitude", "ert", "gbm"),
    78: ("amplitude", "xgbm", "rf"),
    81: ("amplitude", "et", "dt"),
    156: ("cosine", "xgbm", "xgbm"),
    162: ("cosine", "mlp", "mlp"),
    240: ("cosine", "lgbm", "lgbm"),
}
#: these are saved as ONNX
AS_ONNX = {"dt", "et"}


def save(model: object, family: str, stem: str) -> str:
    """Save a model in its own format; returns the file name."""
    if family == "lgbm":
        name = f"{stem}.txt"
        model.booster_.save_model(MODELS / name)
    elif family == "xgbm":
        name = f"{stem}.json"
        model.save_model(MODELS / name)
    elif family in AS_ONNX:
        name = f"{stem}.onnx"
        save_model(to_onnx(model, initial_types=[("x", FloatTensorType([None, 3]))], target_opset=17), MODELS / name)
    else:
        name = f"{stem}.skops"
        skops.io.dump(model, MODELS / name, compression=zipfile.ZIP_DEFLATED)
    return name


def main() -> None:
    """Train all models and write them with their `bundle.toml`."""
    MODELS.mkdir(exist_ok=True)
    x = grid()
    lines = [
        "[bundle]",
        'name = "rv160n"',
        f"reduction_ratio = {REDUCTION_RATIO}",
        'speed_feature = "speed_rpm"',
        'directions = ["forward", "backward"]',
        f"orders = {[0, *ORDERS]}",
        "",
    ]
    for name, unit, values in (
        ("speed_rpm", "rpm", SPEED),
        ("torque_Nm", "N m", TORQUE),
        ("temperature_C", "degC", OIL),
    ):
        lines += ["[[feature]]", f'name = "{name}"', f'unit = "{unit}"']
        lines += [f"min = {values[0]}", f"max = {values[-1]}", ""]
    for direction, sign in (("forward", 1.0), ("backward", -1.0)):
        lines += ["[[harmonic]]", f'direction = "{direction}"', "order = 0"]
        model = clone(families()["svr"]).fit(x, mean_error(x, sign))
        lines += [f'amplitude = "{save(model, "svr", f"A0_{direction}")}"', ""]
        for order, (kind, first, second) in CHOICE.items():
            z = harmonic(x, order, sign)
            parts = {
                "amplitude": {"amplitude": ("A", np.abs(z)), "phase": ("phi", np.angle(z))},
                "cosine": {"cosine": ("C", z.real), "sine": ("S", z.imag)},
            }[kind]
            lines += ["[[harmonic]]", f'direction = "{direction}"', f"order = {order}"]
            for family, (quantity, (letter, target)) in zip((first, second), parts.items(), strict=True):
                model = clone(families()[family]).fit(x, target)
                lines.append(f'{quantity} = "{save(model, family, f"{letter}{order}_{direction}")}"')
            lines.append("")
    (MODELS / "bundle.toml").write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
    size = sum(path.stat().st_size for path in MODELS.iterdir())
    print(f"{MODELS}: {len(list(MODELS.iterdir()))} files, {math.ceil(size / 1024)} KB")


if __name__ == "__main__":
    main()
