"""Cell tables: a piecewise constant model as sorted thresholds and a table of its exact values.

Trees compare inputs with thresholds and nothing else. Between neighbouring thresholds of every feature, in a cell of
the grid that they span, the result cannot change: one evaluation by the rules of `reference` gives it for the whole
cell, in the library's own order of additions, whatever else the model does behind its trees. Cells are bounded by the
exact numbers at which a split changes over (`monotone`), so the lookup needs no rounding and no scaling.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from st_codegen import ir
from st_codegen.ir import reference
from st_codegen.ir.arrays import FloatArray, Int32Array
from st_codegen.passes import grids
from st_codegen.passes.monotone import Chain, Column, Dependence, columns_of, domain_of, step_edges

#: Rows that are evaluated at once, about: bounds the memory.
_BATCH = 20_000


@dataclass(frozen=True)
class CellAxis:
    """One feature's cells: `edges` between them, and the cell of a missing value (0 where none is accepted)."""

    feature: int
    edges: FloatArray
    missing: int

    @property
    def cells(self) -> int:
        """How many cells, that of missing values included where it is one of its own."""
        return max(len(self.edges), self.missing) + 1


@dataclass(frozen=True)
class Cells:
    """A piecewise constant model: its axes, and its outputs in every cell, shape (cells of each axis.., outputs)."""

    axes: tuple[CellAxis, ...]
    values: FloatArray
    exact: bool

    @property
    def n_bytes(self) -> int:
        """Bytes of the table as it is written."""
        return 8 * self.values.size


def cells_of(model: ir.ModelIR, most: int) -> Cells | None:
    """The cells of a model, or None: not piecewise constant, no answer in some cell, or more than `most` numbers."""
    axes = _axes(model, most)
    if axes is None:
        return None
    grid = [_representatives(model, axis) for axis in axes]
    shape = tuple(len(points) for points in grid)
    values = np.vstack(
        [reference.evaluate(model, x, partial(grids.apply, shape=cut)) for x, cut in _rows(model, axes, grid)]
    )
    if not np.all(np.isfinite(values)):
        return None
    return without_equal_slices(Cells(axes, values.reshape(*shape, len(model.outputs)), model.exact))


def _axes(model: ir.ModelIR, most: int) -> tuple[CellAxis, ...] | None:
    """The axes of a model, those with few cells first: neighbours along the longest one are neighbours in memory."""
    values = columns_of(model)
    if any(column is not Dependence.STEPS for column in values[-1]):
        return None
    if any(isinstance(op, ir.TreeEnsemble) and _too_many_thresholds(op, most) for op in model.ops):
        return None
    edges: dict[int, list[FloatArray]] = {}
    for op in model.ops:
        if isinstance(op, ir.TreeEnsemble):
            given = [column for number in op.inputs for column in values[number]]
            for number, column in enumerate(op.columns):
                _collect(model, op, number, given[column.column], edges)
        elif isinstance(op, ir.Rank):
            return None  # already rewritten
    joined = {feature: np.unique(np.concatenate(parts)) for feature, parts in edges.items()}
    if any(np.any(np.isinf(found)) for found in joined.values()):
        return None
    # a missing value gets a cell of its own; where it equals another one, that one is used in the end
    axes = [CellAxis(f, e, len(e) + 1 if model.takes_nan(f) else 0) for f, e in joined.items()]
    axes = [axis for axis in axes if axis.cells > 1]
    size = len(model.outputs)
    for axis in axes:
        size *= axis.cells
        if size > most:
            return None
    return tuple(sorted(axes, key=lambda axis: (axis.cells, axis.feature)))


def _too_many_thresholds(op: ir.TreeEnsemble, most: int) -> bool:
    """Whether the thresholds of one column alone are far too many: spares the exact count for large ensembles."""
    numbers = [np.unique(op.threshold[op.split == number]) for number in range(len(op.columns))]
    with np.errstate(over="ignore"):  # beyond float32 all are alike: LightGBM has 1e300 for infinity
        return any(len(np.unique(found.astype(np.float32))) > most for found in numbers)


def _collect(
    model: ir.ModelIR, op: ir.TreeEnsemble, number: int, column: Column, edges: dict[int, list[FloatArray]]
) -> None:
    """Add the edges that a column of an ensemble gives to its feature."""
    if isinstance(column, Chain):
        found = step_edges(op, number, column, domain_of(model, column.feature))
        edges.setdefault(column.feature, []).append(found)


def _representatives(model: ir.ModelIR, axis: CellAxis) -> FloatArray:
    """One number of the feature in each cell: the last one of the cell, for the highest cell the first one."""
    if not len(axis.edges):
        points = np.array([domain_of(model, axis.feature).inside])
    else:
        points = np.append(axis.edges, np.nextafter(axis.edges[-1], np.inf))
    return np.append(points, np.nan) if axis.missing else points


def _rows(
    model: ir.ModelIR, axes: Sequence[CellAxis], grid: Sequence[FloatArray]
) -> Iterator[tuple[FloatArray, tuple[int, ...]]]:
    """A row of inputs for each cell, in the order of the table, by slices of the first axis; and their shape."""
    shape = tuple(len(points) for points in grid)
    elsewhere = np.array([domain_of(model, feature).inside for feature in range(len(model.features))])
    slices = shape[0] if shape else 1
    step = max(_BATCH * slices // math.prod(shape), 1)
    for start in range(0, slices, step):
        cut = (min(step, slices - start), *shape[1:]) if shape else ()
        x = np.broadcast_to(elsewhere, (math.prod(cut), len(elsewhere))).copy()
        cells = np.unravel_index(np.arange(len(x)), cut) if cut else ()
        for number, (axis, points, at) in enumerate(zip(axes, grid, cells, strict=True)):
            x[:, axis.feature] = points[at if number else at + start]
        yield x, cut


def without_equal_slices(cells: Cells) -> Cells:
    """Neighbouring slices of the table that are equal to the bit merged, and axes that make no difference dropped."""
    values = cells.values
    axes: list[CellAxis] = []
    for axis in cells.axes:
        at = len(axes)
        slices = np.moveaxis(values, at, 0)
        bits = np.ascontiguousarray(slices).view(np.int64).reshape(len(slices), -1)
        number = bits[: len(axis.edges) + 1]
        keep = np.append(np.any(number[1:] != number[:-1], axis=1), True)
        chosen: list[int] = np.flatnonzero(keep).tolist()
        missing = 0
        if axis.missing:
            same = [position for position, row in enumerate(chosen) if np.array_equal(bits[row], bits[axis.missing])]
            missing = same[0] if same else len(chosen)
            chosen += [] if same else [axis.missing]
        values = np.moveaxis(slices[chosen], 0, at)
        if len(chosen) > 1:
            axes.append(CellAxis(axis.feature, axis.edges[keep[:-1]], missing))
        else:
            values = np.take(values, 0, axis=at)
    order = sorted(range(len(axes)), key=lambda n: (axes[n].cells, axes[n].feature))
    return Cells(
        tuple(axes[n] for n in order), np.ascontiguousarray(values.transpose(*order, values.ndim - 1)), cells.exact
    )


def as_model(model: ir.ModelIR, cells: Cells) -> ir.ModelIR:
    """A model of the same name, inputs and outputs that looks its answer up."""
    return dataclasses.replace(model, ops=table_operations([cells]), open_zeros=not model.signs_zeros)


def table_operations(parts: Sequence[Cells]) -> tuple[ir.Operation, ...]:
    """One search for all, and a lookup in the table of each part; the outputs stand one after another.

    The search has the edges of all parts. A part with fewer edges has a list of the rows that each rank skips.
    """
    axes = _unions(parts)
    rank = ir.Rank((0,), tuple(ir.RankColumn(axis.feature, axis.edges, axis.missing) for axis in axes))
    lookups = [_lookup(cells, axes) for cells in parts]
    if not axes:
        return (dataclasses.replace(lookups[0], inputs=(0,)),)  # a constant
    if len(parts) == 1:
        return rank, lookups[0]
    width = sum(table.width for table in lookups)
    return rank, *lookups, ir.Select(tuple(range(2, len(parts) + 2)), np.arange(width, dtype=np.int32))


def _lookup(cells: Cells, axes: Sequence[CellAxis]) -> ir.CellTable:
    """The table of one part behind a search on `axes`."""
    flat = cells.values.reshape(-1, cells.values.shape[-1])
    stored, values = _stored(flat)
    shape = tuple(axis.cells for axis in cells.axes)
    column = {axis.feature: number for number, axis in enumerate(axes)}
    lists = tuple(
        ir.TableAxis(column[own.feature], _own_cells(own, axes[column[own.feature]]) * math.prod(shape[number + 1 :]))
        for number, own in enumerate(cells.axes)
    )
    return ir.CellTable((1,), lists, shape, values, stored, flat[0], cells.exact)


def _own_cells(own: CellAxis, union: CellAxis) -> Int32Array:
    """The cell of a part's axis in which each cell of the united axis lies: every edge of the part is in the union."""
    cells = np.searchsorted(own.edges, np.append(union.edges, np.inf), side="left")
    if union.missing:
        cells = np.append(cells, own.missing)
    return cells.astype(np.int32)


def _stored(flat: FloatArray) -> tuple[Int32Array, FloatArray]:
    """Which number of a row each output is (-1: the output is constant), and the rows without repeated columns."""
    bits = np.ascontiguousarray(flat.T).view(np.int64)
    constant = np.all(bits == bits[:, :1], axis=1)
    known: dict[bytes, int] = {}
    stored = np.full(len(bits), -1, np.int32)
    for output in np.flatnonzero(~constant):
        stored[output] = known.setdefault(bits[output].tobytes(), len(known))
    first = [int(np.flatnonzero(stored == number)[0]) for number in range(len(known))]
    return stored, np.ascontiguousarray(flat[:, first])


def united(parts: Sequence[Cells]) -> Cells:
    """Several models on the same inputs as one: the axes have the edges of all, the outputs stand one after another."""
    axes = sorted(_unions(parts), key=lambda axis: (axis.cells, axis.feature))
    values = np.concatenate([_on(cells, axes) for cells in parts], axis=-1)
    return without_equal_slices(Cells(tuple(axes), values, all(cells.exact for cells in parts)))


def union_shape(parts: Sequence[Cells]) -> tuple[int, ...]:
    """The number of cells of each axis of the united table."""
    return tuple(axis.cells for axis in _unions(parts))


def _unions(parts: Sequence[Cells]) -> list[CellAxis]:
    """For each feature, in their order, an axis with the edges that any part has on it."""
    found = []
    for feature in sorted({axis.feature for cells in parts for axis in cells.axes}):
        own = [axis for cells in parts for axis in cells.axes if axis.feature == feature]
        edges = np.unique(np.concatenate([axis.edges for axis in own]))
        found.append(CellAxis(feature, edges, len(edges) + 1 if any(axis.missing for axis in own) else 0))
    return found


def _on(cells: Cells, axes: Sequence[CellAxis]) -> FloatArray:
    """The values of one part in the cells of united axes."""
    own = {axis.feature: number for number, axis in enumerate(cells.axes)}
    values = cells.values
    # axes in the united order first, those that the part does not have with a single cell
    order = [own[axis.feature] for axis in axes if axis.feature in own]
    values = values.transpose(*order, values.ndim - 1)
    for number, axis in enumerate(axes):
        if axis.feature not in own:
            values = np.repeat(np.expand_dims(values, number), axis.cells, axis=number)
            continue
        values = np.take(values, _own_cells(cells.axes[own[axis.feature]], axis), axis=number)
    return values
