"""The ten families with the parameters that the authors of the paper tuned, trained on a harmonic table."""

import csv
from pathlib import Path

import numpy as np

SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)


def harmonic_table(direction):
    """Operating points (speed rpm, torque N m, oil degC) and columns of the measured table in one direction."""
    with (SHARED / "rv160n_harmonics.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["direction"] == direction]
    x = np.array([[float(row[name]) for name in ("speed_rpm", "torque_Nm", "temperature_C")] for row in rows])
    columns = {
        name: np.array([float(row[name]) for row in rows])
        for name in rows[0]
        if name[0] == "A" or name[:3] == "phi"
        if name != "A0_sign"
    }
    return x, columns


def families():
    """Name -> unfitted estimator."""
    import lightgbm
    import xgboost
    from sklearn.ensemble import (
        ExtraTreesRegressor,
        GradientBoostingRegressor,
        HistGradientBoostingRegressor,
        RandomForestRegressor,
    )
    from sklearn.neural_network import MLPRegressor
    from sklearn.svm import SVR
    from sklearn.tree import DecisionTreeRegressor, ExtraTreeRegressor

    return {
        "svr": SVR(C=1, epsilon=1e-4, gamma=1.1e-6),
        "mlp": MLPRegressor(
            hidden_layer_sizes=(200, 50),
            activation="tanh",
            learning_rate="adaptive",
            early_stopping=True,
            random_state=0,
        ),
        "rf": RandomForestRegressor(90, max_depth=14, min_samples_split=3, random_state=0),
        "dt": DecisionTreeRegressor(max_depth=16, min_samples_split=6, random_state=0),
        "et": ExtraTreeRegressor(max_depth=15, min_samples_split=5, random_state=0),
        "ert": ExtraTreesRegressor(60, max_depth=15, min_samples_split=3, random_state=0),
        "gbm": GradientBoostingRegressor(
            learning_rate=0.1, max_depth=14, min_samples_split=14, n_estimators=36, random_state=0
        ),
        "hgbm": HistGradientBoostingRegressor(learning_rate=0.21, max_depth=11, max_leaf_nodes=27, random_state=0),
        "lgbm": lightgbm.LGBMRegressor(
            learning_rate=0.39, max_depth=12, subsample=0.1, random_state=0, verbose=-1, n_jobs=1
        ),
        "xgbm": xgboost.XGBRegressor(
            reg_lambda=20, reg_alpha=0.01, max_depth=16, colsample_bytree=0.8, random_state=0, n_jobs=1
        ),
    }


#: order -> families of amplitude and phase, as the paper chose them (Table 6)
CHOICE = {
    0: ("svr",),
    1: ("rf", "lgbm"),
    3: ("hgbm", "hgbm"),
    39: ("hgbm", "hgbm"),
    40: ("ert", "gbm"),
    78: ("hgbm", "rf"),
    81: ("rf", "rf"),
    156: ("ert", "rf"),
    162: ("ert", "ert"),
    240: ("ert", "ert"),
}


def write_bundle(folder, choice=CHOICE):
    """Train the 38 models of the paper on the measured table and write them as a bundle."""
    import joblib
    from sklearn.base import clone

    folder.mkdir(parents=True, exist_ok=True)
    lines = ['[bundle]\nname = "rig"\nreduction_ratio = 81.0\nspeed_feature = "speed_rpm"']
    lines.append(f'directions = ["forward", "backward"]\norders = {list(ORDERS)}\n')
    for name, unit, low, high in (
        ("speed_rpm", "rpm", 100, 1800),
        ("torque_Nm", "N m", 0, 1800),
        ("temperature_C", "degC", 25, 35),
    ):
        lines.append(f'[[feature]]\nname = "{name}"\nunit = "{unit}"\nmin = {low}\nmax = {high}\n')
    for direction in ("forward", "backward"):
        x, columns = harmonic_table(direction)
        for order, chosen in choice.items():
            lines.append(f'[[harmonic]]\ndirection = "{direction}"\norder = {order}')
            for family, quantity, letter in zip(chosen, ("amplitude", "phase"), ("A", "phi"), strict=False):
                stem = f"{letter}{order}_{direction}"
                model = clone(families()[family]).fit(x, columns[f"{letter}{order}"])
                joblib.dump(model, folder / f"{stem}.joblib")
                lines.append(f'{quantity} = "{stem}.joblib"')
            lines.append("")
    (folder / "bundle.toml").write_text("\n".join(lines), encoding="utf-8")
