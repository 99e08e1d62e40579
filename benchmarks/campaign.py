"""The campaign reader against a bare `polars.read_csv`, and order analysis against a plain FFT; `make bench`.

Writes a campaign of the rig's shape (fewer runs) to a temporary folder. Rates are rows of the files a second; a row has
a sample of each direction. Each reader is a process of its own, so that its peak memory is its own.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)


def write_campaign(folder: Path, runs: int) -> int:
    """Runs of all speeds with 194,400 samples at 100 rpm, down to 10,800 at 1800; returns the number of rows."""
    from st_codegen.campaign.curves import Conditions, Curve, Run, write_run
    from st_codegen.ir import Direction

    random = np.random.default_rng(0)
    sizes = np.array([-0.03, 1.7e-2, 8e-4, 1e-3, 8e-4, 9e-4, 3e-4, 3e-4, 1e-3, 3e-4])
    rows = 0
    for number in range(runs):
        speed = 100.0 * (1 + number % 18)
        samples = int(194_400 * 100 / speed)
        theta = np.linspace(0, 2 * np.pi, samples, endpoint=False)
        theta += 0.002 * np.sin(5 * theta)
        curves = {}
        for direction in Direction:
            angle = theta if direction is Direction.FORWARD else 2 * np.pi - theta
            te = (np.exp(1j * np.outer(angle, ORDERS)) @ sizes).real + 1e-4 * random.normal(size=samples)
            curves[direction] = Curve(np.rad2deg(angle), te)
        conditions = Conditions(speed, 100.0 * (number // 18), 25.0)
        write_run(Run(conditions, curves), folder / conditions.rig_path(), digits=9)
        rows += samples
    return rows


def bare_polars(folder: Path, _cache: Path) -> None:
    import polars

    for path in sorted(folder.rglob("*.csv")):
        polars.read_csv(path)


def reader(folder: Path, cache: Path, jobs: int = 1, keep: bool = False) -> None:
    from st_codegen.campaign.reader import read_campaign

    read_campaign(folder, jobs=jobs, cache=cache if keep else None)


def plain_fft(folder: Path, _cache: Path) -> None:
    """Reading and an FFT over the number of the sample, both directions."""
    from st_codegen.campaign.curves import find_runs, read_run

    for file in find_runs(folder):
        for curve in read_run(file.path, file.conditions).curves.values():
            np.fft.rfft(curve.te_deg)


def analysed(folder: Path, cache: Path) -> None:
    """Reading what is kept, and least squares of ten orders with everything else that stands out."""
    from st_codegen.campaign.reader import read_campaign

    read_campaign(folder, jobs=1, cache=cache).fits(ORDERS)


def measured(work: Callable[[Path, Path], None], folder: Path, cache: Path, results: Any) -> None:
    import polars  # noqa: F401 - its import is not measured
    import scipy  # noqa: F401

    started = time.perf_counter()
    work(folder, cache)
    elapsed = time.perf_counter() - started
    memory = [resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    results.put((elapsed, memory[0] / 1024, memory[1] / 1024))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=54, help="of the rig's 1026")
    runs = parser.parse_args().runs
    cases = {
        "polars.read_csv": bare_polars,
        "reader, 1 process, no cache": reader,
        "reader, 2 processes, no cache": partial(reader, jobs=2),
        "reader, 2 processes, writes the cache": partial(reader, jobs=2, keep=True),
        "reader, from the cache": partial(reader, keep=True),
        "reader, from the cache, and least squares": analysed,
        "reading, 1 process, and a plain FFT": plain_fft,
    }
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as name:
        folder, cache = Path(name) / "campaign", Path(name) / "curves.parquet"
        rows = write_campaign(folder, runs)
        size = sum(path.stat().st_size for path in folder.rglob("*.csv"))
        print(f"{runs} files, {rows:,} rows, {size / 1e6:.0f} MB")
        for title, work in cases.items():
            results = context.Queue()
            process = context.Process(target=measured, args=(work, folder, cache, results))
            process.start()
            elapsed, own, children = results.get()
            process.join()
            print(
                f"{title:<45} {elapsed:8.2f} s {rows / elapsed / 1e6:8.2f} million rows/s "
                f"{own:6.0f} MB, largest worker {children:.0f} MB"
            )


if __name__ == "__main__":
    main()
