"""Processor time and peak memory of every command on large inputs: `python benchmarks/limits.py [NAME..] [--size 1]`.

Each command runs in a process of its own; the memory is that of its largest process.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
RIG = ROOT / "examples" / "rv160n" / "rig.toml"


def measured(name: str, *arguments: object, expected: tuple[int, ...] = (0,)) -> None:
    """Run a command of st-codegen and print what it took."""
    command = [sys.executable, "-W", "ignore", "-m", "st_codegen", *map(str, arguments), "-q"]
    started = time.monotonic()
    child = os.fork()
    if not child:
        process = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = time.monotonic() - started
        cpu = used.ru_utime + used.ru_stime
        print(f"| {name} | {cpu:.1f} | {seconds:.1f} | {used.ru_maxrss / 1024:.0f} |", flush=True)
        os._exit(process.returncode)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code not in expected:
        sys.exit(f"{' '.join(command)}: exit code {code}")


def models(folder: Path, count: int) -> Path:
    """Small models of three features: three in four of LightGBM, the others linear."""
    import lightgbm
    import skops.io
    from sklearn.linear_model import Ridge

    made = folder / f"models{count}"
    made.mkdir()
    random = np.random.default_rng(0)
    x = random.uniform([100, 0, 25], [1800, 1800, 35], size=(400, 3))
    for number in range(count):
        y = np.sin(x[:, 0] / random.uniform(100, 500)) + x[:, 1] * random.uniform(1e-4, 1e-3)
        if number % 4 == 3:
            skops.io.dump(Ridge().fit(x, y), made / f"m{number:03d}.skops")
            continue
        options = {"verbose": -1, "num_leaves": 15, "num_threads": 1}
        lightgbm.train(options, lightgbm.Dataset(x, y), 20).save_model(made / f"m{number:03d}.txt")
    return made


def conditions(folder: Path, count: int) -> Path:
    """So many runs, spread over the rig's range."""
    random = np.random.default_rng(0)
    rows = np.round(random.uniform([100, 0, 20], [1800, 1800, 40], size=(count, 3)), 1)
    path = folder / f"conditions{count}.csv"
    lines = ["speed_rpm,torque_Nm,temperature_C", *(",".join(map(str, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def many_models(folder: Path, size: float) -> None:
    """A folder of models through the compiler."""
    for count in (round(125 * size), round(250 * size), round(500 * size)):
        made, out = models(folder, count), folder / f"out{count}"
        measured(f"generate, {count} models", "generate", made, "--out", out)
        measured(f"generate --check, {count} models", "generate", made, "--out", out, "--check")
        measured(f"verify --rows 200, {count} models", "verify", made, "--generated", out, "--rows", 200)
        measured(f"prove, {count} models", "prove", made, "--generated", out)
        measured(f"diff, {count} models", "diff", out, out)


def campaigns(folder: Path, size: float) -> None:
    """Measured campaigns, simulated first, through what reads them."""
    for count in (round(750 * size), round(1500 * size), round(3000 * size)):
        points, curves, table = conditions(folder, count), folder / f"curves{count}", folder / f"table{count}.csv"
        simulated = ("--rig", RIG, "--conditions", points, "--out", curves, "--samples", 1024)
        measured(f"simulate campaign, {count} runs of 1,024 samples", "simulate", "campaign", *simulated)
        reconciled = ("reconcile", "--rig", RIG, "--measured", curves)
        measured(f"reconcile, {count} runs of 1,024 samples", *reconciled, "--out", folder / f"found{count}")
        trained = (
            "train",
            curves,
            "--families",
            "DT",
            "--folds",
            2,
            "--jobs",
            2,
            "--orders",
            "0,1,39",
            "--table",
            table,
        )
        kept = ("--cache", folder / f"{count}.parquet", "--work", folder / f"{count}.sqlite")
        measured(f"train, {count} runs of 1,024 samples", *trained, *kept, "--out", folder / f"bundle{count}")


CASES = {"models": many_models, "campaigns": campaigns}


def main() -> None:
    """Measure the named cases, else all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(CASES), choices=CASES)
    parser.add_argument(
        "--size", type=float, default=1.0, help="of the inputs, as a share of those in docs/robustness.md"
    )
    given = parser.parse_args()
    print("| command | CPU s | s | peak MB |\n|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in given.names:
            CASES[name](Path(folder), given.size)


if __name__ == "__main__":
    main()
