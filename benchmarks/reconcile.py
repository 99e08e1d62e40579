"""Reconcile on a full campaign: 1026 runs, both directions, 4096 samples a revolution, three effects hidden.

python benchmarks/reconcile.py --out build/bench_reconcile

The campaign is simulated once and kept in --out. Times are of the wall clock and of the processor, BLAS on --threads.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

RIG = Path(__file__).resolve().parent.parent / "examples" / "rv160n" / "rig.toml"
#: what the rig under test lacks
HIDDEN = ("structural_resonance", "carrier_modulation", "torsional_compliance")


def progress(text: str) -> Callable[[int, int, str], None]:
    """A line that says where a step is, on a terminal."""

    def show(done: int, total: int, what: str) -> None:
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{text}: {done}/{total} {what[:50]:50}")

    return show


@contextmanager
def timed(results: dict[str, Any], name: str) -> Iterator[None]:
    """Wall and processor seconds of a step."""
    wall, own = time.perf_counter(), time.process_time()
    yield
    results[name] = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - own}
    print(f"{name:28} {results[name]['wall_s']:7.1f} s, {results[name]['cpu_s']:7.1f} s of the processor", flush=True)


def campaign(folder: Path) -> None:
    """The paper's grid of the example rig, with its noise."""
    from st_codegen.campaign.conditions import OperatingPoint
    from st_codegen.rig.campaign import Measuring, simulate_campaign
    from st_codegen.rig.model import read_rig

    grid = itertools.product(range(100, 1801, 100), range(0, 1801, 100), (25, 30, 35))
    points = [OperatingPoint(*map(float, point)) for point in grid]
    simulate_campaign(read_rig(RIG), points, folder, Measuring(samples=4096, seed=1), progress("simulating"))


def main() -> None:
    """Simulate, read, reconcile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/bench_reconcile"))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--profile", action="store_true", help="show where the time goes")
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = str(options.threads)

    from st_codegen.reconcile.core import reconcile_observations
    from st_codegen.reconcile.data.reading import read_measured
    from st_codegen.reconcile.report.output import report
    from st_codegen.reconcile.report.pages import report_page
    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.model import read_rig

    results: dict[str, Any] = {}
    folder = options.out / "campaign"
    if not folder.exists():
        with timed(results, "simulating the campaign"):
            campaign(folder)
    known, whole = catalogue(), read_rig(RIG)
    rig = whole.with_effects(effect for effect in whole.effects if effect.name not in HIDDEN)
    with timed(results, "reading"):
        data = read_measured(folder, rig, progress("reading"))
    print(f"{len(data)} curves, {len(data.orders)} orders")
    if options.profile:
        import cProfile
        import pstats

        own = cProfile.Profile()
        own.enable()
    with timed(results, "reconciling"):
        result = reconcile_observations(rig, data, known, progress("reconciling"))
    if options.profile:
        own.disable()
        pstats.Stats(own).sort_stats("cumulative").print_stats(45)
    with timed(results, "writing the report"):
        report_page(result)
    found = report(result)
    named = {effect["name"]: effect["orders"] for effect in found["effects"]}
    print(found["verdict"], named, {key: round(value, 7) for key, value in found["gap"]["held_out"].items()})
    if options.json is not None:
        options.json.write_text(json.dumps(results | {"named": named, "curves": len(data)}, indent=1) + "\n")


if __name__ == "__main__":
    main()
