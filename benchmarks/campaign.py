"""The campaign reader against a bare `polars.read_csv`, and order analysis against a plain FFT; `make bench`.

Writes a campaign of the rig's shape (fewer runs) to a temporary folder. Rates are rows of the files a second; a row has
a sample of each direction. Each case runs in a process of its own; memory is the peak of it and all it started, of
itself alone, and of the largest that it started.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import multiprocessing
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)


def write_campaign(folder: Path, runs: int, density: float) -> int:
    """Runs of all speeds with 194,400 samples at 100 rpm, down to 10,800 at 1800; returns the number of rows.

    `density` multiplies these numbers. Runs of one speed are the same curves under another torque; no reader can tell.
    """
    from st_codegen.campaign.conditions import OperatingPoint
    from st_codegen.campaign.curves import Curve, Run, write_run
    from st_codegen.te.harmonics import Direction

    random = np.random.default_rng(0)
    sizes = np.array([-0.03, 1.7e-2, 8e-4, 1e-3, 8e-4, 9e-4, 3e-4, 3e-4, 1e-3, 3e-4])
    written: dict[float, tuple[Path, int]] = {}
    rows = 0
    for number in range(runs):
        speed = 100.0 * (1 + number % 18)
        conditions = OperatingPoint(speed, 100.0 * (number // 18), 25.0)
        path = folder / conditions.rig_path()
        if speed in written:
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(written[speed][0], path)
            rows += written[speed][1]
            continue
        samples = int(density * 194_400 * 100 / speed)
        theta = np.linspace(0, 2 * np.pi, samples, endpoint=False)
        theta += 0.002 * np.sin(5 * theta)
        curves = {}
        for direction in Direction:
            angle = theta if direction is Direction.FORWARD else 2 * np.pi - theta
            te = (np.exp(1j * np.outer(angle, ORDERS)) @ sizes).real + 1e-4 * random.normal(size=samples)
            curves[direction] = Curve(np.rad2deg(angle), te)
        write_run(Run(conditions, curves), path, digits=9)
        written[speed] = path, samples
        rows += samples
    return rows


def bare_polars(folder: Path, _cache: Path) -> None:
    import polars

    for path in sorted(folder.rglob("*.csv")):
        polars.read_csv(path)


def reader(folder: Path, cache: Path, jobs: int = 1, keep: bool = False) -> str:
    from st_codegen.campaign.reader import read_campaign

    return digest(read_campaign(folder, jobs=jobs, cache=cache if keep else None))


def on_cluster(folder: Path, _cache: Path) -> str:
    """The files read by two workers of a Dask cluster, each a process with one thread."""
    from distributed import LocalCluster

    from st_codegen.campaign.reader import AROUND, read_campaign
    from st_codegen.training.search import Backend

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        Backend(1, cluster.scheduler_address).configured(),
    ):
        return digest(read_campaign(folder, jobs=AROUND))


def digest(campaign: Any) -> str:
    """A hash of all bits that were kept of a campaign."""
    found = hashlib.sha256()
    for curve in campaign.curves:
        for sums in (curve.sums.angle, curve.sums.te, curve.sums.plain_fft):
            found.update(sums.tobytes())
    return f"bits {found.hexdigest()[:12]}"


def plain_fft(folder: Path, _cache: Path) -> None:
    """Reading and an FFT over the number of the sample, both directions."""
    from st_codegen.campaign.curves import read_run, scan

    for file in scan(folder)[0]:
        for curve in read_run(file.path, file.conditions).curves.values():
            np.fft.rfft(curve.te_deg)


def analysed(folder: Path, cache: Path) -> None:
    """Reading what is kept, and least squares of ten orders with everything else that stands out."""
    from st_codegen.campaign.reader import read_campaign

    read_campaign(folder, jobs=1, cache=cache).fits(ORDERS)


def measured(work: Callable[[Path, Path], str | None], folder: Path, cache: Path, results: Any) -> None:
    import joblib  # imports are not measured
    import polars  # noqa: F401
    import scipy  # noqa: F401

    started, before = time.perf_counter(), os.times()
    bits = work(folder, cache)
    after = os.times()
    results.put((time.perf_counter() - started, sum(after[:4]) - sum(before[:4]), bits or ""))
    joblib.externals.loky.get_reusable_executor().shutdown()  # else this process waits until its workers are tired


def peak_memory(process: Any) -> tuple[float, float, float]:
    """Most resident memory, MB: of a process and all it started, of itself, and of the largest that it started."""
    import psutil

    total, own, largest, root = 0, 0, 0, psutil.Process(process.pid)
    while process.is_alive():
        started = []
        with contextlib.suppress(psutil.NoSuchProcess):
            itself = root.memory_info().rss
            for one in root.children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess):
                    started.append(one.memory_info().rss)
            total, own, largest = max(total, itself + sum(started)), max(own, itself), max(largest, *started, 0)
        process.join(0.2)
    return total / 1e6, own / 1e6, largest / 1e6


CASES: dict[str, Callable[[Path, Path], str | None]] = {
    "polars.read_csv": bare_polars,
    "reader, 1 process, no cache": reader,
    "reader, 2 processes, no cache": partial(reader, jobs=2),
    "reader, 2 workers of a cluster": on_cluster,
    "reader, 2 processes, writes the cache": partial(reader, jobs=2, keep=True),
    "reader, from the cache": partial(reader, keep=True),
    "reader, from the cache, and least squares": analysed,
    "reading, 1 process, and a plain FFT": plain_fft,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=54, help="of the rig's 1026")
    parser.add_argument(
        "--density", type=float, default=1.0, help="with 1026 runs, 4.1 gives the rig's 160 million rows"
    )
    parser.add_argument("--only", action="append", choices=CASES, metavar="CASE", help="this one (may be repeated)")
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as name:
        folder, cache = Path(name) / "campaign", Path(name) / "curves.parquet"
        rows = write_campaign(folder, options.runs, options.density)
        size = sum(path.stat().st_size for path in folder.rglob("*.csv"))
        print(f"{options.runs} files, {rows:,} rows, {size / 1e6:.0f} MB", flush=True)
        for title in options.only or CASES:
            results = context.Queue()
            process = context.Process(target=measured, args=(CASES[title], folder, cache, results))
            process.start()
            total, own, largest = peak_memory(process)
            elapsed, seconds, bits = results.get(timeout=1)
            print(
                f"{title:<45} {elapsed:8.2f} s {seconds:8.2f} CPU s {rows / elapsed / 1e6:8.2f} million rows/s "
                f"{total:6.0f} MB, {own:.0f} MB itself, {largest:.0f} MB the largest it started {bits}",
                flush=True,
            )


if __name__ == "__main__":
    main()
