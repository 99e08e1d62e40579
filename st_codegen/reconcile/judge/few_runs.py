"""What curves at fewer operating points than tell a noise say of changes of the rig.

Runs that lie far from each other do not tell how far they would scatter. Several parameters follow so few of them
though none of them is what changed, so that more is asked of a change than elsewhere.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.chances import f_tail
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.judge.claims import Conclusions
from st_codegen.reconcile.rest.formulas import formula_of
from st_codegen.reconcile.rest.structure import structure
from st_codegen.reconcile.search.peaks import has_a_frequency
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Stage


def with_scatter(last: Fit) -> Fit:
    """The fit, of whose orders each run may differ by what it leaves of them without a pattern (`scatter_deg`).

    Of curves at few operating points alone. An order of a resonance has none: its runs may differ by as much as its
    peak in the one that meets that.
    """
    target = last.target
    data, residual = target.data, target.data.with_real_mean(last.residual)
    if not data.few_points or data.spectral_deg is None:
        return last
    free = _left_free(last)
    peaks = [order for one in last.state.pieces if has_a_frequency(one.effect) for order in one.effect.touched_orders()]
    told = (free >= SETTINGS.least_beside_a_law) & ~np.isin(data.orders, peaks)
    told &= ~structure(target, last.residual).significant
    power = (np.abs(residual) ** 2 * target.counts).sum(axis=0) / np.maximum(free, 1.0)
    return replace(last, target=replace(target, scatter_deg=np.where(told, np.sqrt(power), 0.0)))


def without_scatter(found: Conclusions) -> Conclusions:
    """The conclusions, of whose fits no more is known of how far runs differ than the rig says."""
    joint, final = (
        one if one.target.scatter_deg is None else replace(one, target=replace(one.target, scatter_deg=None))
        for one in (found.joint, found.final)
    )
    return replace(found, joint=joint, final=final)


def _left_free(one: Fit) -> FloatArray:
    """How many more numbers were measured of each order than the fit has free for it, float64 (K,)."""
    count = len(one.target.data.orders)
    numbers = sum((np.bincount(places, minlength=count) for places, _ in one.columns), start=np.zeros(count))
    return np.asarray(one.target.data.parts * one.target.counts.sum(axis=0) - numbers)


def unsure_together(final: Fit, changed: Collection[int]) -> list[int]:
    """The changes of few runs that show on an order together, where that keeps more than what is noise for sure.

    Two parameters of the mean follow so few runs whatever moved it: stiffness and backlash did for a play. A table does
    not tell what is noise for sure.
    """
    data = final.target.data
    if not data.few_points:
        return []
    shows = {i: np.abs(final.shown_change(final.state.pieces[i])).max(axis=0) > 0.0 for i in changed}
    shared = np.sum(list(shows.values()), axis=0) > 1 if shows else np.zeros(len(data.orders), bool)
    if data.spectral_deg is not None:
        target = replace(final.target, scatter_deg=None)
        left = (np.abs(data.with_real_mean(final.residual)) ** 2 * target.counts / target.sure_sigma**2).sum(axis=0)
        numbers = data.parts * target.counts.sum(axis=0)
        shared &= left > numbers + SETTINGS.told * np.sqrt(2.0 * numbers)
    return [i for i in changed if (shows[i] & shared).any()]


def follows_another_law(final: Fit, held: Fit, number: int) -> bool:
    """Whether formulas leave clearly less of the orders of few curves than the change of an effect (its number) does.

    held: the fit without the change.
    """
    target, piece = final.target, final.state.pieces[number]
    if not target.data.few_points or target.data.spectral_deg is None or piece.effect.stage is Stage.MEASURING:
        return False
    before, other = target.data.with_real_mean(held.residual), held.residual.copy()
    directions, more = len(np.unique(target.data.at.sign)), -len(piece.coordinates())
    noise = np.sqrt((target.sure_sigma[target.good] ** 2).mean(axis=0))
    columns = np.flatnonzero(final.shown_change(piece).any(axis=0))
    for k in columns:
        formula = formula_of(target, before[:, k].astype(np.complex128), int(k), float(noise[k]))
        if formula is not None:
            other[:, k] -= formula.values(target.data.at, target.reference_temperature_C)
            more += directions * len(formula.terms) * int(target.data.parts[k])
    saved = float((target.losses(final.residual) - target.losses(other))[:, columns].sum())
    return saved > SETTINGS.as_good * max(more, 1)


def may_be_scatter(final: Fit, held: Fit, number: int) -> bool:
    """Whether few runs that differ by an unknown scatter look like the change of an effect (its number) by chance.

    By what the fit leaves of the orders whose scatter nobody told; held: the fit without the change.
    """
    target, piece = final.target, final.state.pieces[number]
    if target.scatter_deg is None:
        return False
    sure = np.sqrt((replace(target, scatter_deg=None).sure_sigma[target.good] ** 2).mean(axis=0))
    unknown = final.shown_change(piece).any(axis=0) & (target.scatter_deg > sure)
    if not unknown.any():
        return False
    scale = target.counts[:, unknown] / target.scatter_deg[unknown] ** 2
    before, left = (
        float((np.abs(target.data.with_real_mean(one.residual)[:, unknown]) ** 2 * scale).sum())
        for one in (held, final)
    )
    numbers, free = len(piece.coordinates()), max(float(_left_free(final)[unknown].sum()), 1.0)
    return float(f_tail((before - left) / numbers / (max(left, 1e-300) / free), numbers, free)) > SETTINGS.p_changed
