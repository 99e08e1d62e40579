"""Four times of what runs Structured Text: `python benchmarks/interpreter.py [CHECKOUT ..]`.

Each row is the command of a user in a process of its own, for each checkout in turn (default: this one), so that two
versions can be compared in one run. Shown are seconds on the clock and seconds of processors. The row of the real
bundle needs the measured tables beside the checkout (see tests/families.py); its models are trained once, into build/.
"""

from __future__ import annotations

import contextlib
import io
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "rv160n"
TRAINED = ROOT / "build" / "interpreter" / "real"
Command = Callable[..., tuple[float, float]]


def command(checkout: Path, *arguments: object) -> tuple[float, float]:
    """Run st-codegen of a checkout; seconds on the clock and of processors."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "st_codegen", *map(str, arguments)], env=environment, check=True, capture_output=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processors = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - start, processors


def verification(checkout: Path, folder: Path, models: Path) -> tuple[float, float]:
    """Verify a bundle that has been generated before."""
    command(checkout, "generate", models, "--out", folder, "--trust-pickle", "--max-bytes", 2**40)
    return command(checkout, "verify", models, "--generated", folder, "--trust-pickle")


def motion(checkout: Path, folder: Path) -> tuple[float, float]:
    """A motion of 20 s with the code called each 250 us, and the same without it."""
    inputs = ("--models", EXAMPLE / "models", "--rig", EXAMPLE / "rig.toml", "--profile", "cycloidal")
    return command(
        checkout, "simulate", "motion", *inputs, "--tasks", "one", "--law", "continuous", "--out", folder / "motion"
    )


def small_predict(checkout: Path, folder: Path) -> tuple[float, float]:
    """Two rows through one model: mostly what it takes to start."""
    rows = folder / "rows.csv"
    rows.write_text("f0,f1,f2\n500.0,100.0,30.0\n1500.0,900.0,27.5\n")
    model = folder / "te.skops"
    shutil.copy(EXAMPLE / "models" / "A0_forward.skops", model)
    return command(checkout, "predict", model, "--input", rows, "--output", folder / "y.csv", "--engine", "st")


def real_bundle() -> Path | None:
    """The 38 models of the paper, trained on the table measured on the real rig; None without that table."""
    sys.path.insert(0, str(ROOT))
    from tests.families import SHARED, write_bundle

    if not SHARED.is_dir():
        return None
    if not (TRAINED / "bundle.toml").is_file():
        with contextlib.redirect_stderr(io.StringIO()):
            write_bundle(TRAINED)
    return TRAINED


def main() -> None:
    """Print the table."""
    checkouts = [Path(name).resolve() for name in sys.argv[1:]] or [ROOT]
    rows: dict[str, Command] = {
        "verify the example bundle": lambda c, f: verification(c, f, EXAMPLE / "models"),
        "motion of 20 s, each 250 us": motion,
        "small predict": small_predict,
    }
    real = real_bundle()
    if real is None:
        print("the measured tables are not beside this checkout: the real bundle is left out")
    else:
        rows["verify the real bundle"] = lambda c, f: verification(c, f, real)
    for label, work in rows.items():
        for checkout in checkouts:
            with tempfile.TemporaryDirectory() as folder:
                clock, processors = work(checkout, Path(folder))
            print(f"{label:28} {checkout.name:12} {clock:7.1f} s, {processors:7.1f} s of processors", flush=True)


if __name__ == "__main__":
    main()
