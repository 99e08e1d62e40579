"""Time and memory of `prove`: python benchmarks/prove.py TREES LEAVES, for one LightGBM model of that size."""

import resource
import sys
import tempfile
import time
from pathlib import Path

import lightgbm
import numpy as np

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.prove import prove
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator


def main(trees: int, leaves: int) -> None:
    """Train, generate and prove; print what it took."""
    random = np.random.default_rng(0)
    x = random.normal(size=(20_000, 6))
    y = np.sin(3 * x[:, 0]) + x[:, 1] * x[:, 2] + 0.1 * random.normal(size=len(x))
    options = {"n_estimators": trees, "num_leaves": leaves, "min_child_samples": 2, "verbose": -1, "n_jobs": 1}
    model = from_estimator(lightgbm.LGBMRegressor(**options).fit(x, y), "m")
    bundle = Bundle((LoadedModel(limit_inputs(model.ir), model.predict),))
    nodes = sum(getattr(op, "n_nodes", 0) for op in model.ir.ops)
    with tempfile.TemporaryDirectory() as folder:
        generate(bundle, "iec", Path(folder), options=Options(layout=Layout.TREES, data_bytes=10**9))
        wall, processor = time.perf_counter(), time.process_time()
        (result,) = prove(bundle, folder).results
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{trees} trees, {nodes:,} nodes: {result.verdict.value}; {wall:.1f} s, of the processor {processor:.1f} s")
    print(f"{processor / trees:.1e} s a tree, {processor / nodes:.1e} s a node; {memory:.0f} MB with the training")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
