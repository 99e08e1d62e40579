"""Runs that are bad as a whole, found after the fit: by what the model leaves of them, and by their neighbours.

A run is measured forward and backward. Noise, even with heavy tails, is rarely large in both directions on the same
order; a run with a wrong label, a shifted zero or a slipping coupling is. A number counts as off where it is both far
from the fitted model and unlike its neighbours: what the model lacks is shared by them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import (
    AXES,
    CONDITIONS,
    UNITS,
    Undecided,
    below_all_loads,
    beside_each_other,
    in_steps,
    of_whole_levels,
    repeats,
)
from st_codegen.reconcile.data.noise import Noise
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.settings import SETTINGS


def bad_runs(
    data: Observations, residual: ComplexArray, sigma: FloatArray, structured: BoolArray, lack: FloatArray | float = 0.0
) -> dict[int, float]:
    """Rows of bad runs and how far off they are, in standard deviations; residual (n, K), sigma (n, K).

    structured: bool (K,), orders in which the model lacks something: being off in these alone is no fault of the run;
    lack: (n, K) deg, what the forms of new effects may lack in each run, which is no fault of it either.
    """
    if data.angle_rad is not None or _nothing_to_compare(data, structured):
        return {}
    if _lacks_everywhere(structured):
        residual = _beyond_shared(data, residual, sigma)
    beyond = residual * np.maximum(1.0 - lack / np.maximum(np.abs(residual), 1e-300), 0.0)
    size = np.where(_like_neighbours(data, residual), 0.0, _scaled(data, beyond, sigma))
    deviation = residual / sigma
    found: dict[int, float] = {}
    for rows in data.runs:
        off = {row: _told(size[row], structured) for row in rows}
        pair = size[rows].min(axis=0)
        is_pair = len({data.at.sign[row] for row in rows}) == 2
        both = max(_told(pair, structured), float(pair[~structured].max(initial=0.0))) if is_pair else 0.0
        again = [row for row in rows if repeats(data.at, deviation, row)]
        if both > SETTINGS.off:
            # the run is bad as a whole, unless each direction shows what others show as well
            found |= dict.fromkeys(map(int, rows) if len(again) < len(rows) else [], both)
        else:
            # one direction by itself must be off in several orders
            found |= {int(row): score for row, score in off.items() if score > SETTINGS.off and row not in again}
    level = of_whole_levels(data.at, np.isin(np.arange(len(data)), list(found)))
    few = len(found) <= SETTINGS.most_suspects * len(data)
    return {row: off for row, off in found.items() if few and not level[row]}


def excused(data: Observations, residual: ComplexArray, noise: Noise, structured: BoolArray) -> BoolArray:
    """Orders (K,) in which runs are off that are not called bad: others share it, or the form of a new effect lacks it.

    Orders in which the model is known to lack something are not among them.
    """
    found = np.zeros(len(data.orders), bool)
    if data.angle_rad is not None:
        return found
    off = _scaled(data, residual, noise.sigma) > SETTINGS.off
    for rows in data.runs:
        if noise.good[rows].all():
            alone = off[rows][off[rows].sum(axis=1) >= SETTINGS.orders_alone].any(axis=0)
            found |= alone | (off[rows].all(axis=0) if len({data.at.sign[row] for row in rows}) == 2 else False)
    return found & ~structured


def with_beside(data: Observations, noise: Noise, fitted: BoolArray) -> Noise:
    """The noise without those of its suspects that lie beside each other along a condition, or at the least load.

    A wrong run lies anywhere, what the machine does at some loads or speeds lies there. They do not become good. Both
    curves of a run are of one kind. fitted: bool (n,), rows to which numbers were fitted; of these only those of the
    least load are undecided, of those with a known mistake none.
    """
    may = np.isin(np.arange(len(data)), [row for row, _ in noise.suspects])
    if data.left_out is not None:
        may &= ~data.left_out
    groups, taken = list[Undecided](), np.zeros(len(data), bool)
    for group in (*below_all_loads(data.at, may, noise.good), *beside_each_other(data.at, may & ~fitted)):
        runs = np.isin(data.number_of_run, data.number_of_run[list(group.rows)])
        for is_fitted in (False, True) if group.condition == "load" else (False,):
            rows = np.flatnonzero(runs & may & ~taken & (fitted == is_fitted))
            taken[rows] = True
            groups += [replace(group, rows=tuple(rows.tolist()), is_fitted=is_fitted)] if len(rows) else []
    suspects = tuple(entry for entry in noise.suspects if not taken[entry[0]])
    return replace(noise, suspects=suspects, undecided=tuple(groups))


def with_rest(
    data: Observations, residual: ComplexArray, noise: Noise, fitted: BoolArray, orders: Collection[int]
) -> Noise:
    """The noise without those of its suspects that are off in nothing but orders that stay unexplained (`orders`).

    What the model lacks may be strongest in them, as at the least load of all. Rows to which numbers were fitted (n,)
    become good, the others undecided; those with a known mistake stay what they are.
    """
    again = without_structure(data, residual, noise, _with_mixed(data.orders, orders))
    known = np.zeros(len(data), bool) if data.left_out is None else data.left_out
    kept = {row for row, _ in again.suspects} | set(np.flatnonzero(known).tolist())
    rows = tuple(row for row, _ in noise.suspects if row not in kept and not fitted[row])
    good = again.good & ~(known & ~noise.good)
    good[list(rows)] = False
    suspects = tuple(entry for entry in noise.suspects if entry[0] in kept)
    undecided = (*noise.undecided, Undecided(rows)) if rows else noise.undecided
    return replace(again, suspects=suspects, good=good, undecided=undecided)


def _with_mixed(looked_at: IntArray, orders: Collection[int]) -> BoolArray:
    """Which orders (K,) are some of these, their doubles, or sums or differences of two: play mixes waves so.

    What has no whole order is -1 among `orders`, and mixes nothing.
    """
    own = np.array([order for order in orders if order >= 0], np.int64)
    sums, differences = own[:, None] + own, np.abs(own[:, None] - own)
    mixed = np.isin(looked_at, np.concatenate([own, sums.ravel(), differences[differences > 0]]))
    # of many orders they are half of all, and say nothing
    return np.isin(looked_at, own) if _lacks_everywhere(mixed) else mixed


def undecided_runs(data: Observations, noise: Noise) -> tuple[str, ...]:
    """Sentences on runs far from what others let expect of which nobody can tell whether they were measured wrong."""
    found, at = [], data.at
    for group in noise.undecided:
        where = "in nothing but orders that stay unexplained, or doubles, sums and differences of these"
        if group.condition == "load":
            where = "at a smaller load than all of these in one direction"
        elif group.condition:
            axis = AXES.index(group.condition)
            values = at.axes[axis][list(group.rows)]
            low, high = f"{values.min():g}", f"{values.max():g} {UNITS[group.condition]}"
            span = f"at {high}" if values.min() == values.max() else f"from {low} to {high}"
            where = f"and closer together in {CONDITIONS[axis]} ({span}) than wrong runs do by chance"
        labels = ", ".join(data.labels[row] for row in group.rows)
        held = "what is fitted is fitted to them as well" if group.is_fitted else "no number is fitted to them"
        found.append(
            f"whether {len(group.rows)} curves were measured wrong or the machine does something of its own there: "
            f"{labels} lie far from what all others let expect, {where}; {held}, and they count "
            "in the gap and in what stays unexplained, not in the gap on held-out runs"
        )
    return tuple(found)


def _told(size: FloatArray, structured: BoolArray) -> float:
    """How far off several orders of a row are, not counting the few in which the model lacks something."""
    largest = np.sort(size if _lacks_everywhere(structured) else size[~structured])
    return float(largest[-SETTINGS.orders_alone]) if len(largest) >= SETTINGS.orders_alone else 0.0


def without_structure(data: Observations, residual: ComplexArray, noise: Noise, structured: BoolArray) -> Noise:
    """The noise without those of its suspects that are off in nothing but orders in which the model lacks something."""
    nothing, everywhere = _nothing_to_compare(data, structured), _lacks_everywhere(structured)
    if everywhere:
        residual = _beyond_shared(data, residual, noise.sigma)
    off = _scaled(data, residual, noise.sigma) > SETTINGS.off
    # off in half of all orders is more than what a model lacks in some
    right = [
        row
        for row, _ in noise.suspects
        if nothing
        or (everywhere and off[row].sum() < SETTINGS.orders_alone)
        or (not everywhere and not (off[row] & ~structured).any() and 2 * off[row].sum() < len(structured))
    ]
    good = noise.good.copy()
    good[right] = True
    return replace(noise, good=good, suspects=tuple(entry for entry in noise.suspects if entry[0] not in right))


def _beyond_shared(data: Observations, residual: ComplexArray, sigma: FloatArray) -> ComplexArray:
    """The residual (n, K) without the forms over the orders that more rows of a direction have than there can be bad.

    A matrix of noise has no singular value above the sum of the roots of its sides: what is below that is no form.
    The largest ones count, as many as make up only a small part of any other deviation.
    """
    found = residual.copy()
    for rows in map(np.flatnonzero, data.at.by_direction()):
        carried, size, forms = np.linalg.svd(residual[rows] / sigma[rows], full_matrices=False)
        shared = 1.0 / np.maximum((np.abs(carried) ** 4).sum(axis=0), 1e-300) > SETTINGS.most_suspects * len(rows)
        shared &= size > np.sqrt(2.0) * (np.sqrt(len(rows)) + np.sqrt(residual.shape[1]))
        shared &= np.cumsum(shared) <= SETTINGS.left_of_place * residual.shape[1]
        found[rows] -= sigma[rows] * ((carried * size)[:, shared] @ forms[shared])
    return found


def _nothing_to_compare(data: Observations, structured: BoolArray) -> bool:
    """Whether runs have neither a model to be compared with nor others like them: a dozen runs, most orders wrong."""
    return data.few_points and _lacks_everywhere(structured)


def _lacks_everywhere(structured: BoolArray) -> bool:
    """Whether the model lacks something nearly everywhere: runs are then told by what others do not have as well."""
    return bool(2 * structured.sum() >= len(structured))


def _scaled(data: Observations, residual: ComplexArray, sigma: FloatArray) -> FloatArray:
    """How far off coefficients are, (n, K), over their noise: that of runs (sigma), or of their own curve if larger."""
    if data.spectral_deg is not None:
        # runs that are louder than others are no farther off for it
        sigma = np.maximum(sigma, data.spectral_deg)
    return np.where(data.orders == 0, np.abs(residual.real), np.abs(residual) / np.sqrt(2)) / sigma


def _like_neighbours(data: Observations, residual: ComplexArray) -> BoolArray:
    """Where neighbours along speed, torque or temperature have a similar residual, bool (n, K)."""
    at = data.at
    steps = np.stack([in_steps(values) for values in at.axes], axis=1)
    found = np.zeros(residual.shape, bool)
    for rows in map(np.flatnonzero, at.by_direction()):
        if len(rows) <= SETTINGS.near:
            continue
        own = residual[rows]
        for axis in range(3):
            # along one axis the others must stay as they are
            place = steps[rows] * np.where(np.arange(3) == axis, 1.0, SETTINGS.across)
            distance = ((place[:, None] - place[None]) ** 2).sum(axis=2)
            np.fill_diagonal(distance, np.inf)
            nearest = np.argpartition(distance, SETTINGS.near, axis=1)[:, : SETTINGS.near]
            apart = np.abs(own[nearest] - own[:, None])
            found[rows] |= np.sort(apart, axis=1)[:, SETTINGS.alike - 1] < SETTINGS.similar * np.abs(own)
    return found
