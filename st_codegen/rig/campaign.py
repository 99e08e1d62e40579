"""Measured campaigns of the simulated rig: one curve file a run, as the campaign's reader takes them."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS, Conditions, OperatingPoint
from st_codegen.campaign.curves import CONDITIONS_FILE, Curve, Run, conditions_from_name, run_paths, write_run
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import RowError, read_csv
from st_codegen.files.folders import check_replaceable, replace_folder
from st_codegen.files.temporary import temporary_folder
from st_codegen.files.text import make_folder
from st_codegen.ir.arrays import FloatArray
from st_codegen.processes import Progress
from st_codegen.rig.model import RigModel
from st_codegen.te.harmonics import Direction

#: sampling of the rig: 4000 Hz, so a revolution has more samples the slower it is
SAMPLING_HZ = 4000.0
_DIGITS = 12
_LEAST_SAMPLES = 100
#: no reducer has a transmission error like this, deg
_MOST_TE_DEG = 10.0


@dataclass(frozen=True)
class Measuring:
    """How the simulated campaign measures.

    samples: of a revolution, None for the rig's 4000 Hz; noise_deg: standard deviation of a sample, None for the
    rig's own [noise]; seed: of the noise.
    """

    samples: int | None = None
    noise_deg: float | None = None
    seed: int = 0

    def count(self, speed_rpm: float, reduction_ratio: float) -> int:
        """The number of samples of a revolution of the output."""
        return self.samples or math.ceil(SAMPLING_HZ * 60 * reduction_ratio / speed_rpm)


def read_conditions(path: Path) -> tuple[OperatingPoint, ...]:
    """Read `speed_rpm,torque_Nm,temperature_C` (other columns are passed over). One InputError lists all problems."""
    problems = Problems(str(path))
    table = read_csv(path, CONDITION_COLUMNS)
    found = []
    for row in table.rows:
        with problems.collect():
            point = OperatingPoint(*(table.number(row, name) for name in CONDITION_COLUMNS))
            if point.speed_rpm <= 0:
                raise RowError(row.line, f"speed_rpm: {point.speed_rpm:g} is not positive")
            found.append(point)
    if not table.rows:
        problems.add("no rows")
    problems.raise_if_any()
    return tuple(found)


def simulate_run(rig: RigModel, conditions: OperatingPoint, measuring: Measuring, number: int) -> Run:
    """One run in both directions. The noise depends on the seed and the run's number alone."""
    count = measuring.count(conditions.speed_rpm, rig.constants.reduction_ratio)
    at = Conditions.of([1.0, -1.0], conditions.speed_rpm, conditions.torque_Nm, conditions.temperature_C)
    with np.errstate(all="ignore"):  # what is no number, or too large, is refused
        te: FloatArray = rig.curve(at, count)
    angle = np.arange(count, dtype=np.float64) * (360.0 / count)
    white = rig.noise.white_deg if measuring.noise_deg is None else measuring.noise_deg
    random = np.random.default_rng([measuring.seed, number])
    te += white * random.standard_normal(te.shape) + rig.noise.run_offset_deg * random.standard_normal((2, 1))
    # backward the same angles are passed from 360 deg down
    backward = np.concatenate([te[1, :1], te[1, :0:-1]])
    curves = {
        Direction.FORWARD: Curve(angle, te[0]),
        Direction.BACKWARD: Curve(360.0 - angle, backward),
    }
    return Run(conditions, curves)


def _check_size(run: Run, rig: RigModel) -> None:
    """Raise InputError where the transmission error of a run is none of a reducer."""
    most = max(float(np.abs(curve.te_deg).max()) for curve in run.curves.values())
    if not most < _MOST_TE_DEG:
        at = run.conditions
        raise InputError(
            f"{rig.name}: a transmission error of {most:.3g} deg at {at.speed_rpm:g} rpm, {at.torque_Nm:g} N m and "
            f"{at.temperature_C:g} degC: its formulas do not hold there, or the noise is louder than any error "
            "of a reducer"
        )


def simulate_campaign(
    rig: RigModel,
    conditions: Sequence[OperatingPoint],
    folder: Path,
    measuring: Measuring = Measuring(),
    progress: Progress | None = None,
) -> None:
    """Write a campaign: the rig's folders and names, or numbered files with `conditions.csv` (`curves.run_paths`).

    The folder appears complete or not at all. Raises InputError where it exists and is not empty, where the samples
    are too few for the rig's orders, and for conditions at which the rig gives no transmission error of a reducer.
    """
    check_replaceable(folder)
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} exists and is not empty; name a new folder, or remove this one")
    if measuring.samples is not None and measuring.samples <= max(_LEAST_SAMPLES, 2 * max(rig.orders())):
        least = max(_LEAST_SAMPLES, 2 * max(rig.orders())) + 1
        raise InputError(f"{counted(measuring.samples, 'sample')} a revolution: this rig needs {least} or more")
    paths = run_paths(conditions)
    folder = Path(os.path.realpath(folder))
    make_folder(folder.parent)
    with temporary_folder(folder.parent, becomes=folder) as made:
        stage = made / "stage"
        stage.mkdir()
        rows = []
        for number, (point, path) in enumerate(zip(conditions, paths, strict=True)):
            if progress is not None:
                progress(number, len(conditions), Path(path).name)
            run = simulate_run(rig, point, measuring, number)
            _check_size(run, rig)
            write_run(run, stage / path, digits=_DIGITS)
            rows.append([path, point.speed_rpm, point.torque_Nm, point.temperature_C])
        if not conditions_from_name(Path(paths[0])):
            with (stage / CONDITIONS_FILE).open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerows([["file", *CONDITION_COLUMNS], *rows])
        replace_folder(stage, folder)
    if progress is not None:
        progress(len(conditions), len(conditions), "")
