"""What a fit predicts for runs that it has not seen: whole levels of speed, torque or temperature left out in turn.

Each fold is predicted by parameters fitted to the other runs, within their bounds. A fold whose runs alone tell some
combination of parameters cannot be predicted by anybody: it says so and does not vote.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.data.contrasts import AXES
from st_codegen.reconcile.fit.fitting import Fit, Fold
from st_codegen.reconcile.fit.target import Groups
from st_codegen.reconcile.search.peaks import has_a_frequency
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect


def predicted(fit: Fit, fold: Fold) -> ComplexArray:
    """What the parameters fitted without a fold leave of its own rows, complex128 (rows of the fold, K), deg.

    Of the model in its linear form, in which they were fitted: a size times a size that both move would be neither.
    """
    found = fit.residual[fold.rows].copy()
    for (places, values), moved in zip(fit.columns, fold.vector - fit.state.vector(), strict=True):
        found[:, places] -= values[fold.rows] * moved
    return found


def held_out(without: Fit, with_it: Fit) -> tuple[dict[str, float], tuple[int, int]]:
    """Loss saved per run on left-out levels of speed, torque and temperature, and the votes of the folds: for, of.

    Of the folds that both fits identify.
    """
    found, votes = {}, []
    for axis in AXES:
        folds = []
        for smaller, larger in zip(without.folds(axis), with_it.folds(axis), strict=True):
            if smaller.identified and larger.identified:
                before, after = (
                    float(fit.target.losses(predicted(fit, fold), fold.rows).sum())
                    for fit, fold in ((without, smaller), (with_it, larger))
                )
                folds.append((int((larger.rows & with_it.target.good).sum()), before - after))
        if folds:
            found[axis] = sum(saved for _, saved in folds) / sum(rows for rows, _ in folds)
            votes += [saved > 0 for _, saved in folds]
    return found, (sum(votes), len(votes))


def held_out_rms(fit: Fit) -> FloatArray:
    """RMS (deg) of each order on left-out levels that the others identify, float64 (K,), of the axis with the most."""
    weight = 1.0 / fit.target.data.parts
    powers = []
    for axis in AXES:
        parts = [predicted(fit, fold)[fit.target.good[fold.rows]] for fold in fit.folds(axis) if fold.identified]
        if parts:
            powers.append(weight * (np.abs(np.concatenate(parts)) ** 2).mean(axis=0))
    if not powers:
        powers = [weight * (np.abs(fit.residual[fit.target.good]) ** 2).mean(axis=0)]
    return np.asarray(np.sqrt(max(powers, key=lambda power: float(power.sum()))))


def untested_axes(fit: Fit) -> tuple[str, ...]:
    """The axes of which most left-out levels cannot be predicted by anybody: each of them tells some number by itself.

    A load tells what the same one of the other sign does.
    """
    found, sizes = [], np.unique(np.abs(fit.target.data.at.torque_Nm), return_inverse=True)[1].astype(np.int64)
    levels = np.arange(sizes.max() + 1)
    by_size = replace(fit.target, groups=Groups(sizes, levels, {"torque": levels}))
    if len(levels) == 2 and any(p.effect.values.get("frequency_per_kNm") for p in fit.state.pieces):
        # of two none can be left out, and a peak that moves from the one to the other is somewhere between them
        found.append("torque")
    for axis in AXES:
        few = axis == "torque" and len(levels) < SETTINGS.many_levels
        folds = (replace(fit, target=by_size) if few else fit).folds(axis)
        unknown = sum(int(fold.rows.sum()) for fold in folds if not fold.identified)
        if axis not in found and 2 * unknown > sum(int(fold.rows.sum()) for fold in folds):
            found.append(axis)
    return tuple(found)


def unmeasured_states(at: Conditions, effects: Sequence[Effect]) -> list[tuple[float, float]]:
    """Neighbouring measured temperatures (degC) between which resonances change their frequency, no run says how."""
    levels = np.unique(at.temperature_C)
    edges = {effect.scalar(key) for effect in effects for key in ("above_C", "below_C") if key in effect.values}
    if len(levels) == 2 and any("frequency_per_10K" in effect.values for effect in effects):
        edges.add(float(levels.mean()))
    inside = [edge for edge in edges if levels[0] < edge < levels[-1]]
    return sorted({(float(levels[levels < edge].max()), float(levels[levels > edge].min())) for edge in inside})


def between_states(fit: Fit) -> FloatArray:
    """Power (deg^2), by order (K,), by which a resonance may be off between temperatures where nothing was measured.

    Its frequency is known on both sides; where between them it changes, and whether in a step, no run says. On average
    half the temperatures between them have the one while the rig has the other.
    """
    at, orders = fit.target.data.at.rows(fit.target.good), fit.target.data.orders
    found = np.zeros(len(orders))
    own = [piece.effect for piece in fit.state.pieces if piece.added and has_a_frequency(piece.effect)]
    for low, high in unmeasured_states(at, own) if fit.target.data.angle_rad is None else ():
        sides = [replace(at, temperature_C=np.full(len(at), level)) for level in (low, high)]
        apart = sum(effect.contribution(sides[0], orders) - effect.contribution(sides[1], orders) for effect in own)
        share = (high - low) / float(np.ptp(at.temperature_C))
        found += 0.5 * share * (1.0 / fit.target.data.parts) * (np.abs(apart) ** 2).mean(axis=0)
    return found
