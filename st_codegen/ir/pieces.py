"""Functions of one number in pieces: encoders, bins, quantiles, splines, isotonic regression."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray
from st_codegen.ir.base import ColumnFunction, freeze


@dataclass(frozen=True)
class Piecewise(ColumnFunction):
    """For each column a polynomial between each two of its rising `knots`, and a number on each knot.

    Column `c` owns knots `start[c] .. start[c+1]-1`, and a piece below, between and above them: rows
    `start[c] + c .. start[c+1] + c` of `pieces` (pieces, degree + 1), whose coefficients are those of rising powers of
    `x - origin`; the origin is the knot below. The outermost pieces are constant. `at` (knots) holds on the knots
    themselves. `missing` (columns) stands for NaN; NaN there: it stays missing. Infinity in `at` or as the first
    coefficient of a piece: the library has no answer there.

    Constant pieces are picked, and exact. Others are computed by libraries in forms of their own: within a bound.
    """

    inputs: tuple[int, ...]
    start: IntArray
    knots: FloatArray
    at: FloatArray
    pieces: FloatArray
    missing: FloatArray | None = None

    def __post_init__(self) -> None:
        start = freeze(self, "start", np.int64, (None,))
        knots = freeze(self, "knots", np.float64, (int(start[-1]),))
        freeze(self, "at", np.float64, (len(knots),))
        pieces = freeze(self, "pieces", np.float64, (len(knots) + self.width, None))
        if self.missing is not None:
            freeze(self, "missing", np.float64, (self.width,))
        if start[0] != 0 or np.any(np.diff(start) < 0) or (self.degree and np.any(np.diff(start) == 0)):
            raise InputError("Piecewise.start: not where the knots of each column start")
        rises = np.diff(knots) > 0
        rises[start[1:-1][(start[1:-1] > 0) & (start[1:-1] < len(knots))] - 1] = True
        if not np.all(np.isfinite(knots)) or not np.all(rises):
            raise InputError("Piecewise.knots: not rising finite numbers in each column")
        if np.any(pieces[self._outermost(), 1:]):
            raise InputError("Piecewise: a piece that has no end is not constant")
        if np.any(np.isnan(self.at)) or np.any(np.isnan(pieces)) or np.any(np.isinf(pieces[:, 1:])):
            raise InputError("Piecewise: a value or a coefficient is no number; train the model again")

    @property
    def width(self) -> int:
        return len(self.start) - 1

    @property
    def degree(self) -> int:
        """The largest power of any piece."""
        return int(self.pieces.shape[1]) - 1

    @property
    def computes(self) -> bool:  # type: ignore[override]
        """Whether any piece is more than a constant."""
        return self.degree > 0

    @property
    def exact(self) -> bool:
        return self.degree == 0

    @property
    def keeps_missing(self) -> list[bool] | None:
        """In columns in which nothing stands for NaN."""
        return None if self.missing is None else [bool(stays) for stays in np.isnan(self.missing)]

    @property
    def refuses(self) -> bool:
        """Whether there are numbers without an answer."""
        return not (np.all(np.isfinite(self.pieces)) and np.all(np.isfinite(self.at)))

    def without_refusals(self) -> Piecewise:
        """This operation with 0.0 in place of the answers that it refuses."""
        at, pieces = (np.where(np.isfinite(values), values, 0.0) for values in (self.at, self.pieces))
        return replace(self, at=at, pieces=pieces)

    def _outermost(self) -> IntArray:
        """The rows of the lowest and of the highest piece of each column."""
        return np.concatenate([self.start[:-1], self.start[1:]]) + np.tile(np.arange(self.width), 2)

    def place(self, x: FloatArray, column: int) -> tuple[IntArray, BoolArray]:
        """For numbers of a column, the first knot that does not lie below (counted in all), and whether it is equal."""
        first, stop = self.start[column], self.start[column + 1]
        own = self.knots[first:stop]
        below = np.searchsorted(own, x, side="left")
        on = (below < len(own)) & (np.append(own, np.inf)[below] == x)
        return below + first, on

    def _spans(self) -> tuple[FloatArray, FloatArray]:
        """The knot at which each piece starts, and its length; 0 for the outermost pieces."""
        origins, lengths = np.zeros(len(self.pieces)), np.zeros(len(self.pieces))
        for column in range(self.width):
            own = self.knots[self.start[column] : self.start[column + 1]]
            rows = slice(self.start[column] + column + 1, self.start[column + 1] + column)
            origins[rows], lengths[rows] = own[:-1], np.diff(own)
        return origins, lengths

    def value(self, x: FloatArray) -> FloatArray:
        result, (origins, _) = np.empty_like(x), self._spans()
        missing = np.full(self.width, np.nan) if self.missing is None else self.missing
        for column in range(self.width):
            knot, on = self.place(x[:, column], column)
            row = knot + column
            inner = np.any(self.pieces[row, 1:] != 0, axis=1)
            argument = np.where(inner, x[:, column] - origins[row], 0.0)
            total = self.pieces[row, self.degree]
            for power in range(self.degree - 1, -1, -1):
                total = total * argument + self.pieces[row, power]
            total = np.where(on, np.append(self.at, 0.0)[knot], total)
            result[:, column] = np.where(np.isnan(x[:, column]), missing[column], total)
        return np.where(np.isinf(result), np.nan, result)

    def sizes(self) -> FloatArray:
        """For each piece the largest sum of the magnitudes of its terms."""
        lengths = self._spans()[1]
        coefficients = np.where(np.isinf(self.pieces), 0.0, np.abs(self.pieces))
        return np.asarray(np.sum(coefficients * lengths[:, None] ** np.arange(self.degree + 1), axis=1), np.float64)

    def terms(self, x: FloatArray) -> FloatArray:
        """The largest magnitude of what is added around numbers `x`, shape (rows, width)."""
        result, sizes = np.empty_like(x), np.append(self.sizes(), 0.0)
        for column in range(self.width):
            knot, on = self.place(x[:, column], column)
            result[:, column] = np.maximum(sizes[knot + column], np.where(on, sizes[knot + column + 1], 0.0))
        return result

    def largest(self, magnitude: FloatArray) -> FloatArray:
        sizes, values = self.sizes(), np.where(np.isinf(self.at), 0.0, np.abs(self.at))
        missing = np.zeros_like(magnitude) if self.missing is None else np.nan_to_num(np.abs(self.missing))
        ends = zip(self.start[:-1].tolist(), self.start[1:].tolist(), strict=True)
        return np.array(
            [
                max(missing[column], *sizes[low + column : high + column + 1], *values[low:high])
                for column, (low, high) in enumerate(ends)
            ]
        )

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray:
        """The steepest piece within `difference`, and the jumps at the knots that lie there."""
        result = np.zeros_like(x)
        powers = np.arange(1, self.degree + 1)
        steep = np.sum(powers * np.abs(self.pieces[:, 1:]) * self._spans()[1][:, None] ** (powers - 1), axis=1)
        steep = np.where(np.isinf(self.pieces[:, 0]), np.inf, steep)
        with np.errstate(all="ignore"):
            for column in range(self.width):
                moved, first, stop = difference[:, column], self.start[column], self.start[column + 1]
                low, _ = self.place(x[:, column] - moved, column)
                high, on = self.place(x[:, column] + moved, column)
                jumps = self._jumps(column)
                finite = np.isfinite(jumps)  # others lie beside a number without an answer, and count within reach
                total = np.concatenate([[0.0], np.cumsum(np.where(finite, jumps, 0.0))])
                refused = np.concatenate([[0], np.cumsum(~finite)])
                ends = high + on - first, low - first
                jump = np.where(refused[ends[0]] > refused[ends[1]], np.inf, total[ends[0]] - total[ends[1]])
                jump = np.where(moved > 0, jump, 0.0)
                steepest = np.zeros(len(x))
                for knot in range(first, stop + 1):
                    here = (low <= knot) & (knot <= high + on) & (moved > 0)
                    steepest = np.where(here, np.maximum(steepest, steep[knot + column]), steepest)
                found = steepest + np.where(moved > 0, jump * (1.0 + 1e-12) / moved, 0.0)
                result[:, column] = np.where(np.isnan(found), np.inf, found)
        return result

    def _jumps(self, column: int) -> FloatArray:
        """How far a column moves on each knot: from the piece below to the knot's own value, to the piece above."""
        first, stop = self.start[column], self.start[column + 1]
        lengths = self._spans()[1]
        below = np.array([np.polyval(self.pieces[n + column, ::-1], lengths[n + column]) for n in range(first, stop)])
        at, above = self.at[first:stop], self.pieces[first + column + 1 : stop + column + 1, 0]
        with np.errstate(all="ignore"):
            return np.asarray(np.abs(at - below) + np.abs(above - at), np.float64)
