"""The joint fit: all parameters of the rig and of the added effects at once, robust, within their bounds.

Gauss-Newton on the complex coefficients, weighted by the noise of each order, with Huber's loss. Normal equations are
gathered order by order, since an effect touches few orders, and group by group of runs, since held-out fits and
cluster-robust errors are made from them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from st_codegen.reconcile.noise import BoolArray, speed_levels
from st_codegen.reconcile.observations import Observations
from st_codegen.reconcile.parameters import Coordinate, Piece
from st_codegen.rig.effects import Conditions, Effect, Form, Stage
from st_codegen.rig.effects.base import ComplexArray, FloatArray, IntArray
from st_codegen.rig.model import RigModel

#: Huber's threshold, in standard deviations of one component
HUBER = 3.0
#: values of the rig are believed this far (relative) before the data speak: keeps what the data do not see in place
_PRIOR = 1.0
#: pieces whose columns are kept
_MOST_CACHED = 300


@dataclass(frozen=True)
class State:
    """A rig under fit: its constant offset, and its effects with their free keys."""

    rig: RigModel
    offset: float
    pieces: tuple[Piece, ...]
    offset_free: bool = True

    def model(self) -> RigModel:
        """The rig with the present values."""
        return replace(self.rig, zero_offset_deg=self.offset, effects=tuple(piece.effect for piece in self.pieces))

    def vector(self) -> FloatArray:
        """Offset and coordinates of all pieces."""
        return np.concatenate([[self.offset], *(piece.vector() for piece in self.pieces)])

    def coordinates(self) -> list[Coordinate | None]:
        """The coordinates; None for the offset."""
        found: list[Coordinate | None] = [None]
        for piece in self.pieces:
            found += piece.coordinates()
        return found

    def slices(self) -> list[slice]:
        """Where the coordinates of each piece stand."""
        start, found = 1, []
        for piece in self.pieces:
            count = len(piece.coordinates())
            found.append(slice(start, start + count))
            start += count
        return found

    def with_vector(self, vector: FloatArray) -> State:
        """The same with other values."""
        pieces = tuple(piece.with_vector(vector[s]) for piece, s in zip(self.pieces, self.slices(), strict=True))
        return replace(self, offset=float(vector[0]), pieces=pieces)

    def with_piece(self, piece: Piece) -> State:
        """The same with one more piece."""
        return replace(self, pieces=(*self.pieces, piece))

    def without(self, number: int) -> State:
        """The same without a piece."""
        return replace(self, pieces=self.pieces[:number] + self.pieces[number + 1 :])

    def replaced(self, number: int, piece: Piece) -> State:
        """The same with another piece in a place."""
        return replace(self, pieces=(*self.pieces[:number], piece, *self.pieces[number + 1 :]))


@dataclass(frozen=True)
class Groups:
    """Rows in cells of about the same conditions, and cells in larger groups.

    cells: int (n,), cell of a row; clusters: int (cells,), cluster of a cell: runs within one may have noise in common;
    folds: for `speed`, `torque`, `temperature` the fold (held-out block) of a cell.
    """

    cells: IntArray
    clusters: IntArray
    folds: Mapping[str, IntArray]


def groups_of(at: Conditions) -> Groups:
    """Cells of speed level, torque fold and temperature; whole levels make a fold, five folds of torques at most."""
    speed = speed_levels(at.speed_rpm)
    torque, temperature = _folds(at.torque_Nm, 5), _folds(at.temperature_C, 4)
    code = (speed * 8 + torque) * 8 + temperature
    kinds, cells = np.unique(code, return_inverse=True)
    of_speed, of_torque, of_temperature = kinds // 64, kinds // 8 % 8, kinds % 8
    clusters = np.unique(of_speed * 8 + of_temperature, return_inverse=True)[1]
    folds = {"speed": of_speed % 12, "torque": of_torque, "temperature": of_temperature}
    return Groups(cells.astype(np.int64), clusters.astype(np.int64), folds)


def _folds(values: FloatArray, count: int) -> IntArray:
    """Folds of whole levels, dealt in turn; values that hardly repeat are cut into blocks."""
    levels, index = np.unique(values, return_inverse=True)
    if len(levels) > max(25, len(values) // 4):
        cuts = np.quantile(values, np.linspace(0, 1, count + 1)[1:-1])
        return np.searchsorted(cuts, values).astype(np.int64)
    return (index % count).astype(np.int64)


@dataclass(frozen=True)
class Target:
    """What is fitted: data, their noise (n, K), the rows that count (n,), and how the rows are grouped."""

    data: Observations
    sigma: FloatArray
    good: BoolArray
    groups: Groups
    reduction_ratio: float = 81.0
    cache: dict[object, tuple[Column, ...]] = field(default_factory=dict, compare=False)
    responses: dict[object, ComplexArray] = field(default_factory=dict, compare=False)

    def subset(self, rows: BoolArray) -> Target:
        """The same with fewer rows that count."""
        return replace(self, good=self.good & rows)

    def residual(self, model: RigModel) -> ComplexArray:
        """measured - model, (n, K)."""
        return self.data.values - self.data.observed(model.coefficients(self.data.at, self.data.model_orders()))

    def losses(self, residual: ComplexArray) -> FloatArray:
        """Twice Huber's loss of each row and order, float64 (n, K); behaves like a chi-square for small residuals."""
        z = np.abs(np.where(self.data.orders == 0, residual.real, residual)) / self.sigma
        z = z * self.good[:, None]
        found: FloatArray = np.where(z <= HUBER, z**2, 2 * HUBER * z - HUBER**2)
        return found

    def weights(self, residual: ComplexArray) -> FloatArray:
        """Weights of least squares that equal Huber's loss at these residuals, by row and order, in 1/deg^2."""
        z = np.abs(np.where(self.data.orders == 0, residual.real, residual)) / self.sigma
        found: FloatArray = self.good[:, None] * np.minimum(1.0, HUBER / np.maximum(z, HUBER)) / self.sigma**2
        return found


#: columns of one coordinate: the places of the orders that it touches, and d(model)/d(coordinate) there (n, places)
Column = tuple[IntArray, ComplexArray]


class Propagation:
    """How additive contributions reach the measured coefficients: sidebands, structure, measuring chain."""

    def __init__(self, model: RigModel, data: Observations) -> None:
        self.model, self.data = model, data
        self.orders = model.closure(data.model_orders())
        self.places = np.searchsorted(self.orders, data.model_orders())
        at = data.at
        self.base = np.zeros((len(data), len(self.orders)), np.complex128)
        self.base[:, self.orders == 0] = model.zero_offset_deg
        for effect in model.of_stage(Stage.ADDITIVE):
            self.base += effect.contribution(at, self.orders)
        self.before_measuring = self.base.copy()
        for effect in model.of_stage(Stage.MODULATION):
            self.before_measuring += effect.passed_on(at, self.orders, self.base) - self.base
        for effect in model.of_stage(Stage.STRUCTURE):
            self.before_measuring += effect.contribution(at, self.orders)

    def measured(self, change: ComplexArray, stage: Stage) -> ComplexArray:
        """What a change of coefficients (n, all orders) at a stage becomes in the measured ones (n, K)."""
        at = self.data.at
        if stage is Stage.ADDITIVE:
            sidebands = [
                effect.passed_on_change(at, self.orders, change) - change
                for effect in self.model.of_stage(Stage.MODULATION)
                if change[:, self.orders == effect.orders[0]].any()
            ]
            change = change + sum(sidebands) if sidebands else change
        if stage is not Stage.MEASURING:
            for effect in self.model.of_stage(Stage.MEASURING):
                change = effect.passed_on_change(at, self.orders, change)
        return self.data.observed(change[:, self.places])

    def change(self, effect: Effect) -> ComplexArray:
        """The part of the coefficients that an effect makes, at its own stage (n, all orders)."""
        at = self.data.at
        if effect.stage is Stage.MODULATION:
            return effect.passed_on(at, self.orders, self.base) - self.base
        if effect.stage is Stage.MEASURING:
            return effect.passed_on(at, self.orders, self.before_measuring) - self.before_measuring
        return effect.contribution(at, self.orders)

    def columns(self, piece: Piece) -> list[Column]:
        """Derivatives of the measured coefficients by the coordinates of a piece."""
        found = []
        coordinates, vector = piece.coordinates(), piece.vector()
        for number, c in enumerate(coordinates):
            change = self.change(piece.unit(c)) if c.linear else self._slope(piece, vector, number, c)
            found.append(self._column(self.measured(change, piece.effect.stage)))
        return found

    def cached_columns(self, piece: Piece, cache: dict[object, tuple[Column, ...]]) -> tuple[Column, ...]:
        """The same, kept from step to step where it depends on nothing that changes."""
        effect = piece.effect
        if effect.stage not in (Stage.ADDITIVE, Stage.STRUCTURE) or not all(c.linear for c in piece.coordinates()):
            return tuple(self.columns(piece))
        later = [e for stage in (Stage.MODULATION, Stage.MEASURING) for e in self.model.of_stage(stage)]
        tables = tuple((e.name, *sorted(e.values.items())) for e in later)
        fixed = tuple(sorted((key, value) for key, value in effect.values.items() if key not in piece.free))
        key = (effect.name, effect.orders, piece.free, fixed, tables)
        if key not in cache:
            if len(cache) > _MOST_CACHED:
                cache.clear()
            cache[key] = tuple(self.columns(piece))
        return cache[key]

    def offset_column(self) -> Column:
        """Derivative by the rig's constant offset."""
        change = np.zeros_like(self.base)
        change[:, self.orders == 0] = 1.0
        return self._column(self.measured(change, Stage.ADDITIVE))

    def _slope(self, piece: Piece, vector: FloatArray, number: int, c: Coordinate) -> ComplexArray:
        step = 1e-4 * max(abs(vector[number]), 1e-3 * c.scale)
        up, down = vector.copy(), vector.copy()
        up[number], down[number] = min(up[number] + step, c.upper), max(down[number] - step, c.lower)
        changes = [self.change(piece.with_vector(v).effect) for v in (up, down)]
        found: ComplexArray = (changes[0] - changes[1]) / (up[number] - down[number])
        return found

    @staticmethod
    def _column(values: ComplexArray) -> Column:
        touched = np.flatnonzero(np.abs(values).max(axis=0, initial=0.0) > 0)
        return touched, np.ascontiguousarray(values[:, touched])


@dataclass(frozen=True)
class Normal:
    """Normal equations by cell: matrix (G, p, p), gradient (G, p); cells numbered 0 .. G-1."""

    matrix: FloatArray
    gradient: FloatArray

    def total(self) -> tuple[FloatArray, FloatArray]:
        """Of all runs together."""
        return self.matrix.sum(axis=0), self.gradient.sum(axis=0)


def gather(
    target: Target, columns: Sequence[Column], residual: ComplexArray, weights: FloatArray, *, by_cell: bool = True
) -> Normal:
    """Normal equations of columns against residuals, by cell, or of all runs as one cell."""
    count = len(columns)
    cells = target.groups.cells
    groups = len(target.groups.clusters) if by_cell else 1
    matrix, gradient = np.zeros((groups, count, count)), np.zeros((groups, count))
    order_of_rows = np.argsort(cells, kind="stable") if by_cell else slice(None)
    starts = np.append(np.searchsorted(cells[order_of_rows], np.arange(groups)) if by_cell else [0], len(cells))
    by_order: dict[int, list[tuple[int, ComplexArray]]] = {}
    for number, (places, values) in enumerate(columns):
        for j, place in enumerate(places):
            by_order.setdefault(int(place), []).append((number, values[:, j]))
    for place, entries in by_order.items():
        index = np.array([number for number, _ in entries])
        block = np.stack([values for _, values in entries], axis=1)[order_of_rows]
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


@dataclass(frozen=True)
class Fit:
    """A finished fit."""

    target: Target
    state: State
    residual: ComplexArray
    loss: float
    columns: tuple[Column, ...]
    prior: FloatArray

    @cached_property
    def inverse(self) -> FloatArray:
        """Inverse of the whole normal matrix with the prior, (p, p)."""
        weights = self.target.weights(self.residual)
        whole = gather(self.target, self.columns, self.residual, weights, by_cell=False)
        return inverse(whole.total()[0] + np.diag(self.prior))

    @cached_property
    def normal(self) -> Normal:
        """Normal equations by cell, at the solution."""
        return gather(self.target, self.columns, self.residual, self.target.weights(self.residual))

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the coordinates."""
        return _bounds(self.state)

    @cached_property
    def propagation(self) -> Propagation:
        """How effects reach the measured coefficients in this fit."""
        return Propagation(self.state.model(), self.target.data)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the coordinates that allows for any correlation within clusters of runs (sandwich), (p, p)."""
        g = by_group(self.normal.gradient, self.target.groups.clusters)
        g = g[np.abs(g).sum(axis=1) > 0]
        count = len(g)
        middle = g.T @ g * (count / max(count - 1, 1))
        sandwich = self.inverse @ middle @ self.inverse
        plain = self.inverse
        # few clusters underestimate: never below what independent runs would give
        factor = np.sqrt(np.maximum(1.0, np.diag(plain) / np.maximum(np.diag(sandwich), 1e-300)))
        found: FloatArray = sandwich * factor[:, None] * factor[None, :]
        # what no run pulls at has no sandwich at all
        np.fill_diagonal(found, np.maximum(np.diag(found), np.diag(plain)))
        return found


def by_group(values: FloatArray, groups: IntArray) -> FloatArray:
    """Sums of values (cells, ..) over the cells of each group, (groups, ..)."""
    member = (np.arange(int(groups.max(initial=0)) + 1)[:, None] == groups[None, :]).astype(np.float64)
    found: FloatArray = np.tensordot(member, values, 1)
    return found


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a positive matrix whose rows have very different sizes."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / size[:, None] / size[None, :]
    scaled[np.diag_indices_from(scaled)] += 1e-10
    found: FloatArray = np.linalg.inv(scaled) / size[:, None] / size[None, :]
    return found


def _prior(state: State) -> tuple[FloatArray, FloatArray]:
    """Weak beliefs: centre and inverse variance of each coordinate. What is added has none, but for its range."""
    # an offset that is not free is held by a belief that no data overrule
    centre, weight = [state.offset], [1e-6 if state.offset_free else 1e30]
    for piece in state.pieces:
        origin = piece.origin or piece.effect
        own = Piece(origin, piece.free & frozenset(origin.values)) if piece.origin else piece
        values = dict(zip(own.coordinates(), own.vector(), strict=True))
        for c, x in zip(piece.coordinates(), piece.vector(), strict=True):
            believed = values.get(c)
            if piece.origin is not None and believed is not None:
                size = _PRIOR * max(abs(believed), 1e-3 * c.scale)
                if c.part:
                    size = max(size, _PRIOR * abs(piece.origin.complex_value(c.key.removeprefix("backward_"),
                               c.key.startswith("backward_"), c.place)))  # fmt: skip
                centre.append(believed)
            else:
                size = c.scale
                centre.append(x if c.form is Form.SHAPE else 0.0)
            weight.append(1 / size**2)
    return np.array(centre), np.array(weight)


def fit(target: Target, state: State, *, steps: int = 12, tolerance: float = 1e-3) -> Fit:
    """Fit all free coordinates of a state. `tolerance`: of twice the loss, absolute (1 is one standard deviation)."""
    centre, prior = _prior(state)
    bounds = _bounds(state)
    vector = np.clip(state.vector(), *bounds)
    state = state.with_vector(vector)
    residual = target.residual(state.model())
    loss = _penalised(target, residual, vector, centre, prior)
    damping, shape = 1e-6, np.array([c is not None and not c.linear for c in state.coordinates()])
    columns: list[Column] = []
    normal = None
    for _ in range(steps):
        if normal is None:
            columns, normal = _linearised(target, state, residual)
        step = _bounded_step(normal, prior, centre, vector, bounds, damping, shape)
        trial = state.with_vector(np.clip(vector + step, *bounds))
        new_vector = trial.vector()
        new_residual = target.residual(trial.model())
        new_loss = _penalised(target, new_residual, new_vector, centre, prior)
        if new_loss <= loss:
            gained = loss - new_loss
            state, vector, residual, loss, normal = trial, new_vector, new_residual, new_loss, None
            damping = max(damping / 10, 1e-9)
            if gained < tolerance:
                break
        else:
            damping = max(damping * 30, 1e-3)
            if damping > 1e6:
                break
    if normal is None:
        columns, _ = _linearised(target, state, residual)
    plain = float(target.losses(residual).sum())
    return Fit(target, state, residual, plain, tuple(columns), prior)


def _linearised(target: Target, state: State, residual: ComplexArray) -> tuple[list[Column], Normal]:
    propagation = Propagation(state.model(), target.data)
    columns = [propagation.offset_column()]
    for piece in state.pieces:
        columns += propagation.cached_columns(piece, target.cache)
    return columns, gather(target, columns, residual, target.weights(residual), by_cell=False)


def _penalised(
    target: Target, residual: ComplexArray, vector: FloatArray, centre: FloatArray, prior: FloatArray
) -> float:
    return float(target.losses(residual).sum() + (prior * (vector - centre) ** 2).sum())


def _bounds(state: State) -> tuple[FloatArray, FloatArray]:
    lower = [-np.inf if c is None else c.lower for c in state.coordinates()]
    upper = [np.inf if c is None else c.upper for c in state.coordinates()]
    return np.array(lower), np.array(upper)


def _bounded_step(
    normal: Normal,
    prior: FloatArray,
    centre: FloatArray,
    vector: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    damping: float,
    shape: BoolArray,
) -> FloatArray:
    """A damped Gauss-Newton step; coordinates that would leave their bounds are put there, the others solved again."""
    matrix, gradient = normal.total()
    matrix = matrix + np.diag(prior)
    gradient = gradient - prior * (vector - centre)
    matrix = matrix + np.diag(damping * np.where(shape, np.maximum(np.diag(matrix), 1e-30), 0.0))
    free = np.ones(len(vector), bool)
    step = np.zeros(len(vector))
    for _ in range(6):
        fixed = gradient - matrix[:, ~free] @ step[~free]
        step[free] = inverse(matrix[np.ix_(free, free)]) @ fixed[free]
        aim = vector + step
        out = free & ((aim < bounds[0]) | (aim > bounds[1]))
        if not out.any():
            break
        step[out] = np.clip(aim[out], bounds[0][out], bounds[1][out]) - vector[out]
        free &= ~out
    return step
