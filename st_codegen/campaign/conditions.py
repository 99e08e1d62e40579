"""Conditions of a run: one operating point, and many of them with their directions as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.te.harmonics import Direction

#: The numbers of an operating point, as columns of files are called.
CONDITION_COLUMNS = ("speed_rpm", "torque_Nm", "temperature_C")
#: The oil of gears is no colder and no hotter, degC.
_COLDEST_C, _HOTTEST_C = -80.0, 250.0


@dataclass(frozen=True, order=True)
class OperatingPoint:
    """One operating point: speed of the input shaft (rpm), torque at the output (N m), oil temperature (degC)."""

    speed_rpm: float
    torque_Nm: float
    temperature_C: float

    def file_name(self) -> str:
        """The name that the rig gives a run: `1000.0rpm1100.0Nm25.0deg.csv`."""
        speed, torque, temperature = map(float, astuple(self))
        return f"{speed!r}rpm{torque!r}Nm{temperature!r}deg.csv"

    def rig_path(self) -> Path:
        """Where the rig puts a run below the campaign's folder: `Test_25degree/1000rpm/..`."""
        return Path(f"Test_{self.temperature_C:g}degree") / f"{self.speed_rpm:g}rpm" / self.file_name()


@dataclass(frozen=True)
class Conditions:
    """Operating points and directions, one array entry each, float64 (n,).

    sign: +1 forward, -1 backward; speed_rpm of the input shaft, positive; torque_Nm at the output, positive against
    the motion; temperature_C of the oil.
    """

    sign: FloatArray
    speed_rpm: FloatArray
    torque_Nm: FloatArray
    temperature_C: FloatArray

    @classmethod
    def of(
        cls, sign: npt.ArrayLike, speed_rpm: npt.ArrayLike, torque_Nm: npt.ArrayLike, temperature_C: npt.ArrayLike
    ) -> Conditions:
        """Broadcast scalars and arrays to one shape (n,)."""
        parts = [np.atleast_1d(np.asarray(part, np.float64)) for part in (sign, speed_rpm, torque_Nm, temperature_C)]
        return cls(*(np.array(part) for part in np.broadcast_arrays(*parts)))

    @classmethod
    def of_runs(cls, runs: Iterable[tuple[Direction, OperatingPoint]]) -> Conditions:
        """The directions and operating points of runs."""
        rows = [(1.0 if direction is Direction.FORWARD else -1.0, *astuple(point)) for direction, point in runs]
        return cls(*np.array(rows, np.float64).reshape(-1, 4).T.copy())

    def __len__(self) -> int:
        return len(self.sign)

    def rows(self, choice: Any) -> Conditions:
        """The operating points that a mask or an index array chooses."""
        return Conditions(self.sign[choice], self.speed_rpm[choice], self.torque_Nm[choice], self.temperature_C[choice])

    def by_direction(self, some: BoolArray | None = None) -> list[BoolArray]:
        """The rows, or some of them, of each direction that they have, backward first: masks, bool (n,)."""
        kept = np.ones(len(self), np.bool_) if some is None else some
        return [kept & (self.sign == sign) for sign in np.unique(self.sign[kept])]

    @property
    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speed, torque and temperature."""
        return self.speed_rpm, self.torque_Nm, self.temperature_C

    @property
    def points(self) -> FloatArray:
        """The operating points, one a row: speed, torque and temperature, float64 (n, 3)."""
        return np.stack(self.axes, axis=1)

    @cached_property
    def count_of_points(self) -> int:
        """How many operating points there are, each counted once."""
        return len(np.unique(self.points, axis=0))

    def output_rad_s(self, reduction_ratio: float) -> FloatArray:
        """Speed of the output, rad/s, with the sign of the direction."""
        return self.sign * self.speed_rpm * (2 * np.pi / 60 / reduction_ratio)


def temperatures_of_no_oil(temperature_C: FloatArray) -> BoolArray:
    """Which temperatures (n,) no oil has, of a sensor or of writing; none where most are so, as in another unit."""
    wrong: BoolArray = (temperature_C < _COLDEST_C) | (temperature_C > _HOTTEST_C)
    return wrong if 2 * wrong.sum() < len(wrong) else np.zeros_like(wrong)
