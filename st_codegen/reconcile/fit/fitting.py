"""The joint fit: all parameters of the rig and of the added effects at once, robust, within their bounds.

Gauss-Newton on the complex coefficients, weighted by the noise of each order, with Huber's loss. Normal equations are
gathered order by order, since an effect touches few orders, and group by group of runs, since held-out fits and
cluster-robust errors are made from them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.processes import shared_out
from st_codegen.reconcile.data.contrasts import AXES
from st_codegen.reconcile.fit.normal import Normal, by_group, gather, inverse, root_of_inverse
from st_codegen.reconcile.fit.propagation import Propagation
from st_codegen.reconcile.fit.state import Numbers, Piece, State
from st_codegen.reconcile.fit.target import Column, FitData
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Form, Stage


@dataclass(frozen=True)
class Fold:
    """One left-out block: its rows (n,), the parameters fitted without it, and whether the others identify them all.

    variance: (p,), what the noise lets each parameter move when the block is left out.
    """

    rows: BoolArray
    vector: FloatArray
    identified: bool
    variance: FloatArray


@dataclass(frozen=True, eq=False)
class Fit:
    """A finished fit; one is equal to itself alone, so that what is computed of it can be kept."""

    target: FitData
    state: State
    residual: ComplexArray
    loss: float
    columns: tuple[Column, ...]
    prior: FloatArray
    centre: FloatArray

    @property
    def packed(self) -> Packed:
        """What tells this fit from another one of the same data and pieces, as it travels between processes."""
        return self.state.numbers, self.residual, self.loss, self.prior, self.centre

    @cached_property
    def _whole(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and right side at the solution, with the prior, (p, p) and (p,)."""
        weights = self.target.weights(self.residual)
        matrix, pull = gather(self.target, self.columns, self.residual, weights, by_cell=False).total()
        return matrix + np.diag(self.prior), pull - self.prior * (self.state.vector() - self.centre)

    @cached_property
    def inverse(self) -> FloatArray:
        """Inverse of the whole normal matrix with the prior, (p, p)."""
        return inverse(self._whole[0])

    @cached_property
    def open_step(self) -> FloatArray:
        """The step that the coordinates would still take, (p,): nothing at a solution."""
        return self.inverse @ self._whole[1]

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

    def explained(self, effect: Effect) -> ComplexArray:
        """What an effect contributes to the measured coefficients, (n, K)."""
        return self.propagation.measured(self.propagation.change(effect), effect.stage)

    def shown_change(self, piece: Piece) -> ComplexArray:
        """What the change of a piece of the rig makes of the measured coefficients, (n, K)."""
        change = self.propagation.change(piece.effect) - self.propagation.change(piece.own)
        return self.propagation.measured(change, piece.effect.stage)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the coordinates that allows for any correlation within clusters of runs (sandwich), (p, p)."""
        g = by_group(self.normal.gradient, self.target.groups.clusters)
        g = g[np.abs(g).sum(axis=1) > 0]
        count = len(g)
        # few clusters underestimate, and fewer than coordinates say nothing of some directions at all: in none of them
        # is it below what independent runs would give
        root = root_of_inverse(self._whole[0])
        pulled = g @ root
        ratio, directions = np.linalg.eigh(pulled.T @ pulled * (count / max(count - 1, 1)))
        spread = root @ directions
        found: FloatArray = (spread * np.maximum(ratio, 1.0)) @ spread.T
        return found

    @cached_property
    def covariance_with_form(self) -> FloatArray:
        """The covariance, larger for what moves farther than by noise when whole levels are left out, (p, p).

        Where the form of the model is right they move as far as their errors say; where it is not, each part of the
        data wants other values, and the errors must say that.
        """
        times, known = np.ones(len(self.inverse)), np.diag(self.inverse)
        for axis in AXES:
            # what a block alone knows cannot be compared with what the others say
            told = [(f, f.variance * SETTINGS.kept_knowledge < known) for f in self.folds(axis)]
            moved = np.sum([(f.vector - self.state.vector()) ** 2 * kept for f, kept in told], axis=0)
            by_noise = np.sum([np.maximum(f.variance, 1e-3 * known) * kept for f, kept in told], axis=0)
            ratio = moved / np.maximum(by_noise, 1e-300)
            times = np.where(ratio > SETTINGS.moved, np.maximum(times, ratio), times)
        root = np.sqrt(times)
        return self.covariance * root[:, None] * root[None, :]

    def folds(self, axis: str) -> list[Fold]:
        """The folds of an axis (one of AXES), each with the parameters that the other runs give.

        None where there are fewer than three.
        """
        groups = self.target.groups
        folds = groups.folds[axis]
        if len(np.unique(folds)) < 3:
            return []
        matrix, gradient = (by_group(part, folds) for part in (self.normal.matrix, self.normal.gradient))
        whole, vector = matrix.sum(axis=0) + np.diag(self.prior), self.state.vector()
        # priors and bounds hold a fit where its runs still pull: that pull is no news, and stays out of the steps
        pull = gradient.sum(axis=0) - self.prior * (vector - self.centre)
        known = np.diag(inverse(whole))
        found = []
        for number, (own, g) in enumerate(zip(matrix, gradient, strict=True)):
            rows = (folds == number)[groups.cells]
            if not (rows & self.target.good).any():
                continue
            step = bounded_step(whole - own, pull - g, vector, self.bounds)
            variance = np.maximum(np.diag(inverse(whole - own)) - known, 0.0)
            found.append(Fold(rows, vector + step, _identified(whole, own), variance))
        return found


#: numbers of the state, residual, loss, prior and centre of a fit
Packed = tuple[Numbers, ComplexArray, float, FloatArray, FloatArray]


def unpacked(made: Packed, target: FitData, state: State) -> Fit:
    """The fit of which `packed` has come back; state: one with the same pieces, but for values and what is free."""
    numbers, residual, loss, prior, centre = made
    state = state.with_numbers(numbers)
    return Fit(target, state, residual, loss, _columns(target, state), prior, centre)


def _identified(whole: FloatArray, own: FloatArray) -> bool:
    """Whether every combination of parameters keeps a part of what is known of it when the fold is left out."""
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    scaled, without = (part / size[:, None] / size[None, :] for part in (whole, whole - own))
    scaled[np.diag_indices_from(scaled)] += 1e-10
    root = np.linalg.cholesky(scaled)
    half = np.linalg.solve(root, without)
    kept = np.linalg.eigvalsh(np.linalg.solve(root, half.T))
    return bool(kept[0] > SETTINGS.kept_knowledge)


def _prior(state: State) -> tuple[FloatArray, FloatArray]:
    """Weak beliefs: centre and inverse variance of each coordinate. What is added has none, but for its range."""
    # an offset that is not free is held by a belief that no data overrule
    centre, weight = [state.offset], [1e-6 if state.offset_free else 1e30]
    for piece in state.pieces:
        own = Piece(piece.own, piece.free & frozenset(piece.own.values)) if piece.origin else piece
        values = dict(zip(own.coordinates(), own.vector(), strict=True))
        for c, x in zip(piece.coordinates(), piece.vector(), strict=True):
            believed = values.get(c)
            if piece.origin is not None and believed is not None:
                known = abs(believed)
                if c.part:
                    of_back = c.key.startswith("backward_")
                    known = abs(piece.origin.complex_value(c.key.removeprefix("backward_"), of_back, c.place))
                # a size of zero is one that nobody knew, or of what is not there; so is a delay, though it is a shape
                is_open = not known and (c.linear or piece.effect.stage is Stage.MEASURING)
                size = c.scale if is_open else SETTINGS.prior * max(known, 1e-3 * c.scale)
                centre.append(believed)
            else:
                size = c.scale
                centre.append(x if c.form is Form.SHAPE else 0.0)
            weight.append(1 / size**2)
    return np.array(centre), np.array(weight)


def fit(target: FitData, state: State, *, steps: int = 12, tolerance: float = 1e-3) -> Fit:
    """Fit all free coordinates of a state. `tolerance`: of twice the loss, absolute (1 is one standard deviation)."""
    centre, prior = _prior(state)
    bounds = _bounds(state)
    vector = np.clip(state.vector(), *bounds)
    state = state.with_vector(vector)
    residual = target.residual(state.model())
    loss = _penalised(target, residual, vector, centre, prior)
    damping = 1e-6
    columns: tuple[Column, ...] = ()
    normal = None
    for _ in range(steps):
        if normal is None:
            columns = _columns(target, state)
            normal = gather(target, columns, residual, target.weights(residual), by_cell=False)
        step = _damped_step(normal, prior, centre, vector, bounds, damping)
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
            if damping > SETTINGS.most_damping:
                break
    if normal is None:
        columns = _columns(target, state)
    plain = float(target.losses(residual).sum())
    return Fit(target, state, residual, plain, columns, prior, centre)


def fits(target: FitData, states: Sequence[State], *, steps: int = 12, tolerance: float = 1e-3) -> list[Fit]:
    """The fits of several states to the same data, in their order; all processors share them where these are large."""
    fitted = partial(fit, target, steps=steps, tolerance=tolerance)
    if target.at_once == 1:
        return [fitted(state) for state in states]
    found = shared_out(lambda state: fitted(state).packed, states, is_large=True, at_once=target.at_once)
    return [unpacked(made, target, state) for made, state in zip(found, states, strict=True)]


def _columns(target: FitData, state: State) -> tuple[Column, ...]:
    propagation = Propagation(state.model(), target.data)
    own = (propagation.cached_columns(piece, target.cache) for piece in state.pieces)
    return (propagation.offset_column(), *itertools.chain(*own))


def _penalised(
    target: FitData, residual: ComplexArray, vector: FloatArray, centre: FloatArray, prior: FloatArray
) -> float:
    return float(target.losses(residual).sum() + (prior * (vector - centre) ** 2).sum())


def _bounds(state: State) -> tuple[FloatArray, FloatArray]:
    lower = [-np.inf if c is None else c.lower for c in state.coordinates()]
    upper = [np.inf if c is None else c.upper for c in state.coordinates()]
    return np.array(lower), np.array(upper)


def _damped_step(
    normal: Normal,
    prior: FloatArray,
    centre: FloatArray,
    vector: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    damping: float,
) -> FloatArray:
    """A Levenberg-Marquardt step within bounds.

    Every coordinate is damped: sizes of a mesh and of its sidebands are products, in which the model is not linear.
    """
    matrix, gradient = normal.total()
    matrix = matrix + np.diag(prior)
    gradient = gradient - prior * (vector - centre)
    matrix = matrix + np.diag(damping * np.maximum(np.diag(matrix), 1e-30))
    return bounded_step(matrix, gradient, vector, bounds)


def bounded_step(
    matrix: FloatArray, gradient: FloatArray, vector: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """The step from `vector` that solves normal equations within bounds.

    Coordinates that would leave their bounds are put there, and the others solved again.
    """
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
    return np.clip(vector + step, *bounds) - vector
