"""Measured harmonics as a part of a rig: `[measured] table` in `rig.toml` names a harmonic table (CSV).

Between the runs of the table c_k is interpolated linearly in speed, torque and temperature, direction by direction;
beyond them the value of the nearest run stands. The measuring chain's delay is a part of what was measured and stays.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.harmonic_table import HarmonicTable, read_table
from st_codegen.errors import InputError
from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.te.harmonics import Direction


@dataclass(frozen=True, eq=False)
class _Flank:
    """The coefficients of one direction: `values` (speeds, torques, temperatures, orders) at the levels of each."""

    levels: tuple[FloatArray, ...]
    values: ComplexArray

    @classmethod
    def of(cls, table: HarmonicTable) -> _Flank:
        """Repeated runs count as their mean. Raises InputError where a combination of levels is missing."""
        pairs = [np.unique(column, return_inverse=True) for column in table.conditions.T]
        levels, places = tuple(level for level, _ in pairs), tuple(place for _, place in pairs)
        sizes, there = [len(level) for level in levels], set(zip(*(place.tolist() for place in places), strict=True))
        # without the grid itself: of conditions that are no levels, such as measured temperatures, it has no end
        if missing := math.prod(sizes) - len(there):
            first = next(point for point in itertools.product(*map(range, sizes)) if point not in there)
            speed, torque, temperature = (level[index] for level, index in zip(levels, first, strict=True))
            raise InputError(
                f"the grid of speeds, torques and temperatures lacks {missing} of its {math.prod(sizes)} points, the "
                f"first of them {speed:g} rpm, {torque:g} N m, {temperature:g} degC; measure them, or leave their "
                "levels out"
            )
        runs = np.zeros(sizes, np.int64)
        np.add.at(runs, places, 1)
        sums = np.zeros((*runs.shape, len(table.orders)), np.complex128)
        np.add.at(sums, places, table.coefficients)
        sums /= runs[..., np.newaxis]
        return cls(levels, sums)

    def coefficients(self, points: FloatArray) -> ComplexArray:
        """At operating points (n, 3), complex128 (n, orders)."""
        from scipy.interpolate import RegularGridInterpolator

        varied = [axis for axis, level in enumerate(self.levels) if len(level) > 1]
        if not varied:
            return np.tile(self.values.reshape(1, -1), (len(points), 1))
        grid = [self.levels[axis] for axis in varied]
        inside = np.clip(points[:, varied], [level[0] for level in grid], [level[-1] for level in grid])
        values = self.values.reshape(*map(len, grid), self.values.shape[-1])
        return RegularGridInterpolator(grid, values)(inside)


@dataclass(frozen=True, eq=False)
class MeasuredHarmonics:
    """The harmonics that were measured on a complete grid of operating points, in both directions."""

    path: Path
    orders: tuple[int, ...]
    flanks: Mapping[Direction, _Flank]

    @classmethod
    def read(cls, path: Path) -> MeasuredHarmonics:
        """Read a harmonic table. Raises InputError where it is none, or no complete grid in both directions."""
        table = read_table(path)
        flanks = {}
        for direction in Direction:
            one = table.direction(direction)
            if not len(one):
                raise InputError(f"{path}: has no row of direction {direction.value}; a rig needs both")
            try:
                flanks[direction] = _Flank.of(one)
            except InputError as error:
                raise InputError(f"{path}: {direction.value}, {error}") from None
        return cls(path.resolve(), table.orders, flanks)

    def coefficients(self, at: Conditions, orders: IntArray) -> ComplexArray:
        """c_k at operating points, complex128 (len(at), len(orders)), deg; 0 for orders that the table has not."""
        found = np.zeros((len(at), len(orders)), np.complex128)
        places = {order: column for column, order in enumerate(self.orders)}
        there = [(column, places[order]) for column, order in enumerate(orders.tolist()) if order in places]
        for direction, rows in ((Direction.FORWARD, at.sign > 0), (Direction.BACKWARD, at.sign <= 0)):
            if rows.any() and there:
                columns, known = map(list, zip(*there, strict=True))
                found[np.ix_(rows, columns)] = self.flanks[direction].coefficients(at.points[rows])[:, known]
        return found
