"""What a fit predicts for runs that it has not seen: whole levels of speed, torque or temperature left out in turn.

Each fold is predicted by parameters fitted to the other runs, within their bounds. A fold whose runs alone tell some
combination of parameters cannot be predicted by anybody: it says so and does not vote.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.fit.fitting import Fit, bounded_step
from st_codegen.reconcile.fit.normal import by_group
from st_codegen.reconcile.settings import SETTINGS

AXES = ("speed", "torque", "temperature")


@dataclass(frozen=True)
class Fold:
    """One left-out block: its rows (n,), the parameters fitted without it, and whether the others identify them all."""

    rows: BoolArray
    vector: FloatArray
    identified: bool


def folds_of(fit: Fit, axis: str) -> list[Fold]:
    """The folds of an axis (`speed`, `torque`, `temperature`), each with the parameters that the other runs give.

    None where there are fewer than three.
    """
    groups = fit.target.groups
    folds = groups.folds[axis]
    if len(np.unique(folds)) < 3:
        return []
    matrix, gradient = (by_group(part, folds) for part in (fit.normal.matrix, fit.normal.gradient))
    whole, vector = matrix.sum(axis=0) + np.diag(fit.prior), fit.state.vector()
    # priors and bounds hold a fit where its runs still pull: that pull is no news, and stays out of the steps
    pull = gradient.sum(axis=0) - fit.prior * (vector - fit.centre)
    found = []
    for number, (own, g) in enumerate(zip(matrix, gradient, strict=True)):
        rows = (folds == number)[groups.cells]
        if not (rows & fit.target.good).any():
            continue
        step = bounded_step(whole - own, pull - g, vector, fit.bounds)
        found.append(Fold(rows, vector + step, _identified(whole, own)))
    return found


def _identified(whole: FloatArray, own: FloatArray) -> bool:
    """Whether every combination of parameters keeps a part of what is known of it when the fold is left out."""
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    scaled, without = (part / size[:, None] / size[None, :] for part in (whole, whole - own))
    scaled[np.diag_indices_from(scaled)] += 1e-10
    root = np.linalg.cholesky(scaled)
    half = np.linalg.solve(root, without)
    kept = np.linalg.eigvalsh(np.linalg.solve(root, half.T))
    return bool(kept[0] > SETTINGS.kept_knowledge)


def predicted(fit: Fit, fold: Fold) -> ComplexArray:
    """What the parameters fitted without a fold leave of its own rows, complex128 (rows of the fold, K), deg."""
    return fit.target.residual(fit.state.with_vector(fold.vector).model(), fold.rows)


def compared(without: Fit, with_it: Fit, axis: str) -> Iterator[tuple[int, float]]:
    """For each fold that both fits identify: its good rows, and the loss that the larger fit saves there."""
    for smaller, larger in zip(folds_of(without, axis), folds_of(with_it, axis), strict=True):
        if not (smaller.identified and larger.identified):
            continue
        losses = [
            float(fit.target.losses(predicted(fit, fold), fold.rows).sum())
            for fit, fold in ((without, smaller), (with_it, larger))
        ]
        yield int((larger.rows & with_it.target.good).sum()), losses[0] - losses[1]


def held_out_rms(fit: Fit) -> FloatArray:
    """RMS (deg) of each order on left-out levels that the others identify, float64 (K,), all axes together."""
    weight = np.where(fit.target.data.orders == 0, 1.0, 0.5)
    powers = []
    for axis in AXES:
        parts = [predicted(fit, fold)[fit.target.good[fold.rows]] for fold in folds_of(fit, axis) if fold.identified]
        if parts:
            powers.append(weight * (np.abs(np.concatenate(parts)) ** 2).mean(axis=0))
    if not powers:
        powers = [weight * (np.abs(fit.residual[fit.target.good]) ** 2).mean(axis=0)]
    found: FloatArray = np.sqrt(np.mean(powers, axis=0))
    return found
