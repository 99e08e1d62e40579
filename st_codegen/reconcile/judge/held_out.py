"""What a fit predicts for runs that it has not seen: whole levels of speed, torque or temperature left out in turn.

Each fold is predicted by parameters fitted to the other runs, within their bounds. A fold whose runs alone tell some
combination of parameters cannot be predicted by anybody: it says so and does not vote.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.fit.fitting import AXES, Fit, Fold


def predicted(fit: Fit, fold: Fold) -> ComplexArray:
    """What the parameters fitted without a fold leave of its own rows, complex128 (rows of the fold, K), deg."""
    return fit.target.residual(fit.state.with_vector(fold.vector).model(), fold.rows)


def compared(without: Fit, with_it: Fit, axis: str) -> Iterator[tuple[int, float]]:
    """For each fold that both fits identify: its good rows, and the loss that the larger fit saves there."""
    for smaller, larger in zip(without.folds(axis), with_it.folds(axis), strict=True):
        if not (smaller.identified and larger.identified):
            continue
        losses = [
            float(fit.target.losses(predicted(fit, fold), fold.rows).sum())
            for fit, fold in ((without, smaller), (with_it, larger))
        ]
        yield int((larger.rows & with_it.target.good).sum()), losses[0] - losses[1]


def held_out_rms(fit: Fit) -> FloatArray:
    """RMS (deg) of each order on left-out levels that the others identify, float64 (K,), of the axis with the most."""
    weight = np.where(fit.target.data.orders == 0, 1.0, 0.5)
    powers = []
    for axis in AXES:
        parts = [predicted(fit, fold)[fit.target.good[fold.rows]] for fold in fit.folds(axis) if fold.identified]
        if parts:
            powers.append(weight * (np.abs(np.concatenate(parts)) ** 2).mean(axis=0))
    if not powers:
        powers = [weight * (np.abs(fit.residual[fit.target.good]) ** 2).mean(axis=0)]
    found: FloatArray = np.sqrt(max(powers, key=lambda power: float(power.sum())))
    return found
