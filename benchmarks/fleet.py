"""A fleet of simulated axes on a local Dask cluster of which a worker is killed: who is named, memory, cost an axis.

The axes are one small rig with sizes that differ by 5 % (standard deviation), measured in a few runs. Three have a
hidden fault: an output shaft that is three times as oval, a bad cycloid tooth, a stiffness that has lost a third since
its last campaign. One of the two workers is killed when a quarter of the axes is done; no memory limit is set.

    python benchmarks/fleet.py 20 60
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import psutil
from distributed import LocalCluster

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.fleet.axes import read_fleet
from st_codegen.fleet.output import FleetReport
from st_codegen.fleet.run import run_fleet
from st_codegen.fleet.stages import AxisResult
from st_codegen.rig.campaign import Measuring, simulate_campaign
from st_codegen.rig.model import RigModel, parse_rig
from st_codegen.training.search import Backend

RIG = """[rig]
name = "small"
reduction_ratio = 81.0

[noise]
white_deg = 0.0005
run_offset_deg = 0.001

[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = 454.0

[[effect]]
name = "backlash"
gap_arcmin = 0.3
seating_torque_Nm = 60.0

[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.0172
phase_rad = 0.3

[[effect]]
name = "output_shaft_ovality"
amplitude_deg = 0.000273
phase_rad = 1.0

[[effect]]
name = "pin_error"
order = 40
amplitude_deg = 0.0009
phase_rad = 0.17
"""
TOOTH = """
[[effect]]
name = "cycloid_tooth_error"
order = 39
amplitude_deg = 0.0006
phase_rad = -1.75
"""
FLEET = """[defaults]
rig = "rig.toml"
target = "iec"
orders = [0, 1, 2, 40]
families = ["DT", "ET"]
as_is = true
folds = 2

[[axis]]
campaign = "robots/*/new"
earlier = ["robots/*/old"]
"""
POINTS = [OperatingPoint(s, m, t) for s in (200, 600, 1000, 1400) for m in (0, 400, 800, 1200) for t in (25, 35)]
SIZES = ("stiffness_Nm_per_arcmin", "gap_arcmin", "amplitude_deg")
OVAL, TOOTHED, SOFT = 1, 4, 7


def axis(number: int) -> tuple[RigModel, RigModel]:
    """An axis as it was and as it is."""
    random = np.random.default_rng([1, number])
    rig = parse_rig(RIG + (TOOTH if number == TOOTHED else ""))
    was = rig.with_effects(
        effect.with_values(
            {key: value * random.normal(1.0, 0.05) if key in SIZES else value for key, value in effect.values.items()}
        )
        for effect in rig.effects
    )
    worse = {OVAL: ("output_shaft_ovality", "amplitude_deg", 3.0), SOFT: ("torsional_compliance", SIZES[0], 0.67)}
    name, key, factor = worse.get(number, ("", "", 1.0))
    now = was.with_effects(
        effect.with_values({**effect.values, key: effect.values[key] * factor}) if effect.name == name else effect
        for effect in was.effects
    )
    return (now if number == OVAL else was), now


def write_fleet(folder: Path, axes: int) -> Path:
    """The campaigns of a fleet, two of each axis, and its file."""
    (folder / "rig.toml").write_text(RIG)
    for number in range(axes):
        for year, rig in zip(("old", "new"), axis(number), strict=True):
            measuring = Measuring(512, seed=2 * number + (year == "new"))
            simulate_campaign(rig, POINTS, folder / "robots" / f"r{number:03}" / year, measuring)
    (folder / "fleet.toml").write_text(FLEET)
    return folder / "fleet.toml"


class Watch(threading.Thread):
    """Peak of the resident memory of any process below this one but the nannies, and their processor times."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.peak, self.cpu, self.going = 0, dict[int, float](), True

    def run(self) -> None:
        while self.going:
            for process in psutil.Process().children(recursive=True):
                try:
                    times = process.cpu_times()
                    self.cpu[process.pid] = times.user + times.system
                    self.peak = max(self.peak, process.memory_info().rss)
                except psutil.Error:
                    continue
            time.sleep(0.2)


def measured(axes: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        fleet = read_fleet(write_fleet(Path(name), axes))
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
        ) as cluster:
            killed: list[int] = []

            def kill(done: int, total: int, _name: str, _result: AxisResult) -> None:
                if 4 * done >= total and not killed:
                    killed.append(next(iter(cluster.workers.values())).pid)
                    os.kill(killed[0], signal.SIGKILL)

            watch = Watch()
            watch.start()
            started = time.perf_counter()
            results = run_fleet(fleet, Path(name) / "out", Backend(1, cluster.scheduler_address), kill)
            seconds = time.perf_counter() - started
            watch.going = False
            watch.join()
        started = time.perf_counter()
        report = FleetReport.of(fleet, results)
        report.write(Path(name) / "out")
        across = time.perf_counter() - started
        found = json.loads((Path(name) / "out" / "fleet.json").read_text())
        print(f"{axes} axes, a worker killed: {bool(killed)}; {report.summary()}")
        costs = f"{sum(watch.cpu.values()) / axes:.2f} CPU s and {seconds / axes:.2f} s an axis"
        print(f"  {costs}, {watch.peak / 1e6:.0f} MB the largest process, {across:.1f} s to compare")
        print("  stand out:", [(one["axis"], one["effect"], one["parameter"]) for one in found["outliers"]])
        print("  few have: ", [(one["effect"], one["axes"]) for one in found["rare"]])
        print("  grown:    ", [(one["axis"], one["effect"], one["key"]) for one in found["growth"]], flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("axes", type=int, nargs="*", default=[20, 60], help="sizes of fleets")
    for axes in parser.parse_args().axes:
        measured(axes)


if __name__ == "__main__":
    main()
