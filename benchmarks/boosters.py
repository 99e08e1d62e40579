"""Time and peak memory to read forests of a million nodes: LightGBM text, XGBoost JSON and UBJSON.

python benchmarks/boosters.py            trains the forests in a temporary folder and measures each in a new process
python benchmarks/boosters.py FILE       measures one file
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TREES, LEAVES, ROWS = 500, 1000, 60_000
FILES = ("forest.txt", "forest.json", "forest.ubj")


def train(folder: Path) -> None:
    import lightgbm
    import xgboost

    rng = np.random.default_rng(0)
    x = rng.normal(size=(ROWS, 3))
    y = np.sin(3 * x[:, 0]) * x[:, 1] + x[:, 2] + rng.normal(size=ROWS) * 0.3
    paths = [folder / name for name in FILES]
    parameters = {"num_leaves": LEAVES, "min_data_in_leaf": 5, "verbosity": -1}
    lightgbm.train(parameters, lightgbm.Dataset(x, y), TREES).save_model(paths[0])
    growth = {"max_leaves": LEAVES, "max_depth": 0, "grow_policy": "lossguide", "tree_method": "hist"}
    booster = xgboost.train(growth, xgboost.DMatrix(x, label=y), TREES)
    for path in paths[1:]:
        booster.save_model(path)


def measure(path: Path) -> None:
    from st_codegen.ir import TreeEnsemble
    from st_codegen.walkers.lightgbm import model as lightgbm
    from st_codegen.walkers.xgboost import model as xgboost

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    model = (lightgbm if path.suffix == ".txt" else xgboost).load_file(path, "model")
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    forest = model.ir.ops[0]
    assert isinstance(forest, TreeEnsemble)
    print(
        f"{path.name:12} {path.stat().st_size / 1e6:6.1f} MB  {forest.n_trees} trees  {forest.n_nodes} nodes  "
        f"{seconds:5.2f} s  peak {peak / 1024:.0f} MB (imports alone: {before / 1024:.0f} MB)"
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        target = Path(sys.argv[1])
        train(target) if target.is_dir() else measure(target)
    else:
        with tempfile.TemporaryDirectory() as name:
            # a process of its own each: the peak of a parent counts for its children
            subprocess.run([sys.executable, __file__, name], check=True)
            for file in FILES:
                subprocess.run([sys.executable, __file__, str(Path(name) / file)], check=True)
