"""Ranks and cell tables: what piecewise constant models are rewritten to.

Walkers never make these; the passes derive them from trees, exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.base import FloatArray, IntArray, check_columns, freeze, require_finite


@dataclass(frozen=True)
class RankColumn:
    """A column of ranks: how many of the rising `edges` lie below the number in column `column` of the input.

    A number equal to an edge lies not above it: rank r means edges[r-1] < x <= edges[r]. `descending` gives
    len(edges) minus that. A missing value (NaN) has the rank `missing`, whatever else holds.
    """

    column: int
    edges: FloatArray
    missing: int = 0
    descending: bool = False

    def __post_init__(self) -> None:
        edges = freeze(self, "edges", np.float64, (None,))
        require_finite(self, "edges")
        if np.any(np.diff(edges) <= 0):
            raise InputError("RankColumn.edges: not strictly rising")

    @property
    def highest(self) -> int:
        """The largest rank of a number."""
        return len(self.edges)


@dataclass(frozen=True)
class Rank:
    """Numbers replaced by their ranks among sorted thresholds, so that later steps compare integers.

    The ranks are whole numbers; generated code keeps them as integers.
    """

    inputs: tuple[int, ...]
    columns: tuple[RankColumn, ...]
    exact: ClassVar[bool] = True

    @property
    def width(self) -> int:
        return len(self.columns)

    @property
    def operand_width(self) -> None:
        return None

    def check_operands(self, total: int) -> None:
        check_columns(self, (column.column for column in self.columns), total)


@dataclass(frozen=True)
class CellTable:
    """One row of numbers for each cell of a grid; column `d` of the input is the cell number along axis `d`.

    `shape` has the number of cells of each axis. `values` (cells, stored numbers) is in row-major order of the axes,
    the last one fastest. Output `o` is number `stored[o]` of the cell's row, or `constant[o]` where `stored[o]` is -1.
    `exact`: the values are those of the source library to the bit (no inexact operation was folded into the table).
    """

    inputs: tuple[int, ...]
    shape: tuple[int, ...]
    values: FloatArray
    stored: IntArray
    constant: FloatArray
    exact: bool = True

    def __post_init__(self) -> None:
        values = freeze(self, "values", np.float64, (math.prod(self.shape), None))
        stored = freeze(self, "stored", np.int32, (None,))
        freeze(self, "constant", np.float64, (len(stored),))
        require_finite(self, "values", "constant")
        if np.any(stored < -1) or np.any(stored >= values.shape[1]):
            raise InputError("CellTable.stored: a column that the table does not have")

    @property
    def width(self) -> int:
        return len(self.stored)

    @property
    def operand_width(self) -> int:
        return len(self.shape)

    def check_operands(self, total: int) -> None:
        """Nothing beyond the width."""

    @property
    def strides(self) -> tuple[int, ...]:
        """How many rows one step along each axis skips."""
        return tuple(math.prod(self.shape[axis + 1 :]) for axis in range(len(self.shape)))
