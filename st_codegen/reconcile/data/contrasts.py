"""Contrasts of runs with their neighbours: what a run has that those beside it do not let expect.

A contrast has the variance of the noise of one run, plus what the measured quantity does between neighbours that no
straight line or plane follows. So each kind of contrast bounds the noise from above, and the smallest says most.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.kept import KeptAnswers
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions


@dataclass(frozen=True)
class Contrasts:
    """Local contrasts: e_i = (y_i - sum_j w_ij y_j) / norm_i has the variance of the noise.

    index: int (n, m) neighbours; weight: float64 (n, m), 0 for none; norm: float64 (n,), inf where there are too few.
    """

    index: IntArray
    weight: FloatArray
    norm: FloatArray

    def apply(self, values: ComplexArray) -> ComplexArray:
        """Contrasts of values (n, K)."""
        predicted = np.einsum("nm,nmk->nk", self.weight, values[self.index])
        return np.asarray((values - predicted) / self.norm[:, None])

    @property
    def usable(self) -> BoolArray:
        """Rows that have neighbours enough."""
        return np.isfinite(self.norm)


def contrasts(at: Conditions, good: BoolArray) -> Contrasts:
    """Contrasts of each run against good runs of the same direction. The last few are kept."""
    asked = (at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C)
    return _KEPT.of(asked, lambda: _contrasts(at, good), good.tobytes())


#: of the last conditions
_KEPT = KeptAnswers[Contrasts](9)


def _contrasts(at: Conditions, good: BoolArray) -> Contrasts:
    n = len(at)
    scaled = np.stack([4.0 * in_steps(at.speed_rpm), in_steps(at.torque_Nm), in_steps(at.temperature_C)], axis=1)
    count = SETTINGS.neighbours
    index = np.zeros((n, count), np.int64)
    weight = np.zeros((n, count))
    norm = np.full(n, np.inf)
    for rows in map(np.flatnonzero, at.by_direction()):
        pool = rows[good[rows]]
        if len(pool) <= count:
            continue
        distance = ((scaled[rows][:, None] - scaled[pool][None]) ** 2).sum(axis=2)
        distance[rows[:, None] == pool[None]] = np.inf
        nearest = np.argpartition(distance, count, axis=1)[:, :count]
        chosen = pool[nearest]
        offsets = scaled[chosen] - scaled[rows][:, None]
        # coordinates that do not vary among the neighbours drop out of the pseudo-inverse
        design = np.concatenate([np.ones((len(rows), count, 1)), offsets], axis=2)
        index[rows] = chosen
        weight[rows] = np.linalg.pinv(design, rcond=1e-6)[:, 0]
        norm[rows] = np.sqrt(1 + (weight[rows] ** 2).sum(axis=1))
    # an extrapolated prediction says little
    norm[norm > SETTINGS.most_extrapolated] = np.inf
    return Contrasts(index, weight, norm)


def along_axes(at: Conditions, good: BoolArray) -> Iterator[tuple[str, Contrasts]]:
    """Contrasts of good runs with those that differ in one condition alone, and with repeats of the same conditions.

    A run between two others is compared with the straight line through them. Where an axis has two levels the other
    run of the pair is all there is to compare with, so that kind holds where the axis does not matter.
    """
    for name, order, same, own in _lines_along(at, good):
        index, weight, norm = np.zeros((len(at), 2), np.int64), np.zeros((len(at), 2)), np.full(len(at), np.inf)
        _write_lines(order, same, own, index, weight, norm)
        yield name, Contrasts(index, weight, norm)


def _lines_along(at: Conditions, good: BoolArray) -> Iterator[tuple[str, IntArray, BoolArray, FloatArray]]:
    """For repeats and for each condition its name, the good rows in groups that differ in it alone, rising in it.

    With them: of all rows but the last, whether the next one is of the same group, and the condition of each row.
    """
    for name, order, group, own in _KEPT_LINES.of((at.sign, *at.axes), lambda: _lines(at)):
        chosen = order[good[order]]
        yield name, chosen, np.diff(group[chosen]) == 0, own


#: of the last conditions
_KEPT_LINES = KeptAnswers[list[tuple[str, IntArray, IntArray, FloatArray]]](9)


def _lines(at: Conditions) -> list[tuple[str, IntArray, IntArray, FloatArray]]:
    """For repeats and for each condition its name, all rows in groups that differ in it alone, rising in it.

    With them: the group and the condition of each row.
    """
    found = []
    for name, axis in (("repeats", None), ("speed", 0), ("torque", 1), ("temperature", 2)):
        others = [at.sign, *(column for i, column in enumerate(at.axes) if i != axis)]
        group = np.unique(np.stack(others), axis=1, return_inverse=True)[1].ravel()
        own = np.zeros(len(at)) if axis is None else at.axes[axis]
        found.append((name, np.lexsort((own, group)), group, own))
    return found


def _write_lines(
    rows: IntArray, same: BoolArray, own: FloatArray, index: IntArray, weight: FloatArray, norm: FloatArray
) -> None:
    """Contrasts of rows (rising along one axis) with the lines through their neighbours, written in place.

    same: of all but the last row, whether the next differs along this axis alone.
    """
    ends = np.concatenate([[False], same, [False]])
    pair = np.flatnonzero(same & ~ends[:-2] & ~ends[2:])
    # the second of a pair: one number of its own
    index[rows[pair + 1]], weight[rows[pair + 1]] = rows[pair][:, None], (1.0, 0.0)
    norm[rows[pair + 1]] = np.sqrt(2.0)
    inner = np.flatnonzero(same[:-1] & same[1:])
    before, here, after = rows[inner], rows[inner + 1], rows[inner + 2]
    span = own[after] - own[before]
    share = np.divide(own[here] - own[before], span, out=np.full(len(span), 0.5), where=span != 0)
    index[here], weight[here] = np.stack([before, after], axis=1), np.stack([1.0 - share, share], axis=1)
    norm[here] = np.sqrt([1.0 + (1.0 - s) ** 2 + s**2 for s in share.tolist()])


def neighbours(at: Conditions, good: BoolArray) -> Iterator[tuple[str, IntArray]]:
    """Pairs (pairs, 2) of good rows next to each other along one axis, all else the same; repeats among them.

    Off any grid each row has one of its ten nearest for a neighbour. No pair comes twice: what is counted twice would
    seem to be shared.
    """
    for name, order, same, _ in _lines_along(at, good):
        yield name, np.stack([order[:-1][same], order[1:][same]], axis=1).astype(np.int64)
    local = contrasts(at, good)
    rows = np.flatnonzero(good & local.usable)
    yield "nearest", np.unique(np.sort(np.stack([rows, local.index[rows, 0]], axis=1), axis=1), axis=0)


def repeats(at: Conditions, deviation: ComplexArray, row: int) -> bool:
    """Whether runs at other temperatures (all else the same) deviate as this one does: then it is no bad run.

    deviation: (n, K) in noises.
    """
    others = np.flatnonzero(
        (at.sign == at.sign[row])
        & (at.speed_rpm == at.speed_rpm[row])
        & (at.torque_Nm == at.torque_Nm[row])
        & (at.temperature_C != at.temperature_C[row])
    )
    if not len(others):
        return False
    own, size = deviation[row], float(np.linalg.norm(deviation[row]))
    alike = 0
    for other in others:
        length = float(np.linalg.norm(deviation[other]))
        product = float((own * deviation[other].conj()).real.sum())
        alike += product > SETTINGS.coherent * size * length and length > SETTINGS.comparable * size
    return 2 * alike >= len(others)


def of_whole_levels(at: Conditions, bad: BoolArray) -> BoolArray:
    """Which bad rows (n,) lie at a speed, torque or temperature at which most rows of a direction are bad, bool (n,).

    What all runs of a level have, whatever it is in each of them, is no fault of these runs: something happens there.
    """
    found = np.zeros(len(at), bool)
    for level in levels_by_condition(at).values():
        code = 2 * level + (at.sign > 0)
        count, wrong = (np.bincount(code, weights=weight) for weight in (np.ones(len(at)), bad.astype(float)))
        found |= ((wrong >= SETTINGS.least_block) & (2 * wrong > count))[code]
    return found & bad


@dataclass(frozen=True)
class Undecided:
    """Rows of which nobody can tell whether they are bad: the machine may do something of its own there.

    condition: one of AXES along which they lie beside each other, closer than by chance, or `load` for rows of a
    smaller load than all good ones; none for rows that are off in nothing but orders that stay unexplained.
    is_fitted: numbers were fitted to them.
    """

    rows: tuple[int, ...]
    condition: str = ""
    is_fitted: bool = False


def below_all_loads(at: Conditions, bad: BoolArray, good: BoolArray) -> list[Undecided]:
    """The bad rows (n,) of each direction whose load is less than that of all its good ones; none where it has none.

    Play, friction and contact do at small loads what they do at no larger one: no other run shows it.
    """
    load, found = np.abs(at.torque_Nm), np.zeros(len(at), bool)
    for side in at.by_direction():
        found |= side & bad & (load < min(load[side & good], default=0.0))
    return [Undecided(tuple(np.flatnonzero(found).tolist()), "load")] if found.any() else []


def beside_each_other(at: Conditions, bad: BoolArray) -> list[Undecided]:
    """The bad rows (n,) of each direction that lie closer together along a condition than wrong runs would by chance.

    So lies what the machine does there (at small loads, near a speed). The chance is that of as many runs, drawn from
    all of the direction, within as many neighbouring places of their ranking by the condition, times how many choices
    of runs, of their count, of a condition and of a direction there are.
    """
    found = []
    sides = [side for side in map(np.flatnonzero, at.by_direction()) if bad[side].sum() >= SETTINGS.least_block]
    for side in sides:
        best, least = None, SETTINGS.p_beside / len(sides)
        for name, values in zip(AXES, at.axes, strict=True):
            ranked = np.sort(values[side])
            rows = side[bad[side]][np.argsort(values[side[bad[side]]], kind="stable")]
            first, last = (np.searchsorted(ranked, values[rows], side=end) for end in ("left", "right"))
            for i, j in itertools.combinations(range(len(rows)), 2):
                count, places = j - i + 1, int(last[j] - first[i])
                if count < SETTINGS.least_block:
                    continue
                tried = len(AXES) * (len(rows) - SETTINGS.least_block + 1) * math.comb(len(rows), count)
                within = (len(side) - places) * math.comb(places - 1, count - 1) + math.comb(places, count)
                chance = tried * within / math.comb(len(side), count)
                if chance < least:
                    best, least = Undecided(tuple(rows[i : j + 1].tolist()), name), chance
        found += [best] if best is not None else []
    return found


# --- which conditions go together

#: names of the conditions, in the order of `Conditions`: as keys, and in words; units by key
AXES = ("speed", "torque", "temperature")
CONDITIONS = ("speed", "torque", "oil temperature")
UNITS = {"speed": "rpm", "torque": "N m", "temperature": "degC"}


def axes_together(at: Conditions) -> list[tuple[str, str]]:
    """Pairs of conditions of which each is told by the other: what depends on the one may depend on the other.

    Values may go together, or the ranks of their levels: oil that warms up ever slower in runs sorted by speed.
    """
    columns, found = at.axes, []
    for one, other in itertools.combinations(range(3), 2):
        if np.ptp(columns[one]) > 0 and np.ptp(columns[other]) > 0:
            ranks = [np.unique(columns[axis], return_inverse=True)[1].ravel() for axis in (one, other)]
            pairs = (columns[one], columns[other]), (ranks[0], ranks[1])
            told = max(float(np.corrcoef(a, b)[0, 1]) ** 2 for a, b in pairs)
            found += [(CONDITIONS[one], CONDITIONS[other])] if told > SETTINGS.together else []
    return found


# --- which runs count as run at the same speed, torque or temperature


def step_between(values: FloatArray) -> float:
    """The median step between levels, a twentieth of their range at least; 1 where the values never varied."""
    levels = np.unique(values)
    return max(float(np.median(np.diff(levels))), float(np.ptp(levels)) / 20) if len(levels) > 1 else 1.0


def in_steps(values: FloatArray) -> FloatArray:
    """Values in steps of their grid (or a twentieth of their range)."""
    return values / step_between(values) if len(np.unique(values)) > 1 else np.zeros(len(values))


def equal_parts(values: FloatArray, count: int, side: Literal["left", "right"] = "left") -> IntArray:
    """The number of the group of each value, of so many groups of equal size; side: of a cut on which a value lies."""
    cuts = np.quantile(values, np.linspace(0, 1, count + 1)[1:-1])
    return np.searchsorted(cuts, values, side=side).astype(np.int64)


def speed_levels(speed_rpm: FloatArray) -> IntArray:
    """The speed level of each run: the grid's, or 12 groups of equal size where speeds do not repeat."""
    levels, index = np.unique(speed_rpm, return_inverse=True)
    return index.astype(np.int64) if len(levels) <= 40 else equal_parts(speed_rpm, 12)


def levels_by_condition(at: Conditions) -> dict[str, IntArray]:
    """The level of each row by condition, (n,).

    Speeds that hardly repeat at other loads and oils are no levels: each would tell all that its one run has.
    """
    speed, *others = at.axes
    points = np.unique(np.column_stack(at.axes), axis=0)
    is_scattered = len(np.unique(speed)) > len(points) / 2 and any(np.ptp(values) > 0.0 for values in others)
    return dict(
        zip(AXES, (levels_of(speed) if is_scattered else speed_levels(speed), *map(levels_of, others)), strict=True)
    )


def levels_of(values: FloatArray) -> IntArray:
    """The level of each value: those that there are, or eight groups of equal size where there are more."""
    levels, index = np.unique(values, return_inverse=True)
    return index.astype(np.int64) if len(levels) <= 8 else equal_parts(values, 8, "right")
