"""Ranks and cell tables: what piecewise constant models are rewritten to.

Walkers never make these; the passes derive them from trees, exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.arrays import FloatArray, Int32Array
from st_codegen.ir.base import ReadsColumns, check_columns, freeze, freeze_finite


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
        edges = freeze_finite(self, "edges", (None,))
        if np.any(np.diff(edges) <= 0):
            raise InputError("RankColumn.edges: not strictly rising")

    @property
    def highest(self) -> int:
        """The largest rank of a number."""
        return len(self.edges)

    @property
    def search(self) -> tuple[int, bytes]:
        """What columns have in common whose ranks one search finds: a column of the input, and thresholds."""
        return self.column, self.edges.tobytes()


@dataclass(frozen=True)
class Rank(ReadsColumns):
    """Numbers replaced by their ranks among sorted thresholds, so that later steps compare integers.

    The ranks are whole numbers; generated code keeps them as integers.
    """

    inputs: tuple[int, ...]
    columns: tuple[RankColumn, ...]
    exact: ClassVar[bool] = True

    @property
    def width(self) -> int:
        return len(self.columns)

    def check_operands(self, total: int) -> None:
        check_columns(self, (column.column for column in self.columns), total)

    def ends(self, *, accepts_nan: bool) -> tuple[Int32Array, Int32Array]:
        """The lowest and the highest rank that each column can have."""
        missing = [column.missing if accepts_nan else 0 for column in self.columns]
        highest = [column.highest for column in self.columns]
        return np.minimum(missing, 0).astype(np.int32), np.maximum(highest, missing).astype(np.int32)


@dataclass(frozen=True)
class TableAxis:
    """One axis of a cell table: `offset[r]` is how many rows rank r of column `column` of the input skips."""

    column: int
    offset: Int32Array

    def __post_init__(self) -> None:
        offset = freeze(self, "offset", np.int32, (None,))
        if len(offset) == 0 or np.any(offset < 0):
            raise InputError("TableAxis.offset: empty, or before the table")

    @property
    def stride(self) -> int | None:
        """Rows that one rank skips, where that is the same for all; None where it is not."""
        stride = int(self.offset[1]) if len(self.offset) > 1 else 0
        return stride if np.array_equal(self.offset, stride * np.arange(len(self.offset))) else None


@dataclass(frozen=True)
class CellTable(ReadsColumns):
    """One row of numbers for each cell of a grid; the row is the sum of what the ranks of the input skip.

    `shape` has the number of cells of each axis; `values` (cells, stored numbers) is in row-major order of the axes,
    the last one fastest. Output `o` is number `stored[o]` of the cell's row, or `constant[o]` where `stored[o]` is -1.
    `exact`: the values are those of the source library to the bit (no inexact operation was folded into the table).
    """

    inputs: tuple[int, ...]
    axes: tuple[TableAxis, ...]
    shape: tuple[int, ...]
    values: FloatArray
    stored: Int32Array
    constant: FloatArray
    exact: bool = True

    def __post_init__(self) -> None:
        values = freeze_finite(self, "values", (math.prod(self.shape), None))
        stored = freeze(self, "stored", np.int32, (None,))
        freeze_finite(self, "constant", (len(stored),))
        if np.any(stored < -1) or np.any(stored >= values.shape[1]):
            raise InputError("CellTable.stored: a column that the table does not have")
        if sum(int(axis.offset.max()) for axis in self.axes) >= len(values):
            raise InputError("CellTable.axes: a row behind the end of the table")

    @property
    def width(self) -> int:
        return len(self.stored)

    def check_operands(self, total: int) -> None:
        check_columns(self, (axis.column for axis in self.axes), total)
