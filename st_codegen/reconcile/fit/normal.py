"""Normal equations of complex columns, order by order and group by group of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.fit.target import Column, FitData, by_place

#: What a scaled matrix has in its diagonal beside 1, so that it has an inverse.
_LEAST = 1e-10


@dataclass(frozen=True)
class Normal:
    """Normal equations by cell: matrix (G, p, p), gradient (G, p); cells numbered 0 .. G-1."""

    matrix: FloatArray
    gradient: FloatArray

    def total(self) -> tuple[FloatArray, FloatArray]:
        """Matrix (p, p) and gradient (p,) of the normal equations of all cells together."""
        return self.matrix.sum(axis=0), self.gradient.sum(axis=0)


def gather(
    target: FitData, columns: Sequence[Column], residual: ComplexArray, weights: FloatArray, *, by_cell: bool = True
) -> Normal:
    """Normal equations of columns against residuals, by cell, or of all runs as one cell."""
    count = len(columns)
    cells = target.groups.cells
    groups = len(target.groups.clusters) if by_cell else 1
    matrix, gradient = np.zeros((groups, count, count)), np.zeros((groups, count))
    order_of_rows = np.argsort(cells, kind="stable") if by_cell else slice(None)
    starts = np.append(np.searchsorted(cells[order_of_rows], np.arange(groups)) if by_cell else [0], len(cells))
    for place, (index, values) in by_place(columns).items():
        block = values[order_of_rows]
        r, w = residual[order_of_rows, place], weights[order_of_rows, place]
        parts = (
            [(block.real, r.real)] if target.data.orders[place] == 0 else [(block.real, r.real), (block.imag, r.imag)]
        )
        square = (slice(None), index[:, None], index[None, :])
        local, pull = np.zeros((groups, len(index), len(index))), np.zeros((groups, len(index)))
        for part, right in parts:
            design = np.ascontiguousarray(part)
            weighted = design * w[:, None]
            for group in range(groups):
                rows = slice(starts[group], starts[group + 1])
                local[group] += weighted[rows].T @ design[rows]
                pull[group] += right[rows] @ weighted[rows]
        matrix[square] += local
        gradient[:, index] += pull
    return Normal(matrix, gradient)


def by_group(values: FloatArray, groups: IntArray) -> FloatArray:
    """Sums of values (cells, ..) over the cells of each group, (groups, ..)."""
    member = (np.arange(int(groups.max(initial=0)) + 1)[:, None] == groups[None, :]).astype(np.float64)
    return np.tensordot(member, values, 1)


def made_of(columns: FloatArray, values: FloatArray) -> FloatArray:
    """The combination of columns (n, p) that is nearest to values (n,), by least squares."""
    return columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a positive matrix whose rows have very different sizes."""
    scaled, size = _scaled(matrix)
    return np.linalg.inv(scaled) / size[:, None] / size[None, :]


def root_of_inverse(matrix: FloatArray) -> FloatArray:
    """A matrix L with L @ L.T the inverse, also where rounding leaves of some direction nothing."""
    scaled, size = _scaled(matrix)
    values, vectors = np.linalg.eigh(scaled)
    root: FloatArray = vectors / np.sqrt(np.maximum(values, _LEAST)) / size[:, None]
    return root


def _scaled(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A matrix with 1 in its diagonal and a little more, and the sizes of its rows."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / size[:, None] / size[None, :]
    scaled[np.diag_indices_from(scaled)] += _LEAST
    return scaled, size
