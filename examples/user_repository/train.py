"""Trains the example's model: the power of a pump over speed and pressure, from made-up measurements."""

from pathlib import Path

import lightgbm
import numpy as np

random = np.random.default_rng(1)
x = np.column_stack([random.uniform(300.0, 3000.0, 400), random.uniform(1.0, 10.0, 400)])
power = 1e-3 * x[:, 0] * x[:, 1] + random.normal(0.0, 0.2, 400)
data = lightgbm.Dataset(x, power, feature_name=["speed_rpm", "pressure_bar"])
parameters = {"num_leaves": 6, "learning_rate": 0.3, "num_threads": 1, "seed": 1, "verbose": -1}
lightgbm.train(parameters, data, 8).save_model(Path(__file__).parent / "models" / "power.txt")
