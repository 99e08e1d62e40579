"""Boxes of inputs: how a value depends on several inputs, where every comparison is decided.

A space is a list of boxes that do not overlap; in each box (lane) and for each input there are the numbers from a first
to a last key, perhaps none, and perhaps NaN. A value on a space has one number for each lane. Where a comparison is not
the same for a whole lane, the space is split; values are brought up to its present lanes when they are read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, IntArray
from st_codegen.proof.prove.axis import HIGHEST, LOWEST, AxisValue, InputAxis, from_keys
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import bits

#: A space of more lanes than this is given up.
MOST_LANES = 4_000_000


class Space:
    """Boxes: `low` and `high` keys and `nan`, each (lanes, inputs); low > high: no number.

    `is_walked`: decisions of one walk split it, so that another walk from the same boxes takes a copy.
    """

    def __init__(self, axes: Sequence[InputAxis]) -> None:
        self.axes = axes
        self.low = np.array([[axis.first for axis in axes]], np.int64)
        self.high = np.array([[axis.last for axis in axes]], np.int64)
        self.nan = np.array([[axis.nan for axis in axes]], np.bool_)
        self.parents: list[IntArray] = []
        self.is_walked = False

    @property
    def lanes(self) -> int:
        return len(self.low)

    def replace(self, parent: IntArray, feature: IntArray, low: IntArray, high: IntArray, nan: BoolArray) -> None:
        """Take new lanes: each is a part of lane `parent`, with other ends of one input."""
        if len(parent) > MOST_LANES:
            raise NotProvedError(f"more than {MOST_LANES:,} boxes")
        self.low, self.high, self.nan = self.low[parent], self.high[parent], self.nan[parent]
        row = np.arange(len(parent))
        self.low[row, feature], self.high[row, feature], self.nan[row, feature] = low, high, nan
        self.parents.append(parent)

    def copy(self) -> Space:
        """A space with the same boxes that is split on its own."""
        other = Space(self.axes)
        other.low, other.high, other.nan = self.low.copy(), self.high.copy(), self.nan.copy()
        return other

    def decide(
        self, feature: IntArray, last: IntArray, below: BoolArray, nan: BoolArray, active: BoolArray
    ) -> BoolArray:
        """Split lanes by a decision that changes over behind key `last` of one input; its value on the lanes then.

        `below` is the decision up to `last`, `nan` that for NaN; lanes that are not `active` stay whole.
        """
        self.is_walked = True
        row = np.arange(self.lanes)
        low, high, has_nan = self.low[row, feature], self.high[row, feature], self.nan[row, feature]
        parts = []
        for value in (True, False):
            under = below == value
            first = np.where(under, low, np.maximum(low, last + 1))
            end = np.where(under, np.minimum(high, last), high)
            missing = has_nan & (nan == value)
            there = ((first <= end) | missing) & active
            parts.append((there, first, end, missing))
        both = parts[0][0] & parts[1][0]
        if not np.any(both):
            return np.asarray(parts[0][0], np.bool_)
        chosen = [np.flatnonzero(parts[0][0] | ~active), np.flatnonzero(parts[1][0])]
        whole = ~active[chosen[0]]
        columns = [
            np.concatenate([np.where(whole, old[chosen[0]], part0[chosen[0]]), part1[chosen[1]]])
            for old, part0, part1 in zip((low, high, has_nan), parts[0][1:], parts[1][1:], strict=True)
        ]
        parent = np.concatenate(chosen)
        decision = np.concatenate([~whole, np.zeros(len(chosen[1]), np.bool_)])
        order = np.argsort(parent, kind="stable")
        parent = parent[order]
        self.replace(parent, feature[parent], columns[0][order], columns[1][order], columns[2][order].astype(np.bool_))
        return decision[order]

    def resolve(self, value: AxisValue, active: BoolArray) -> tuple[AnyArray, BoolArray]:
        """Split lanes where a value of one input changes; the value on the lanes then, and where it has one.

        Raises NotProvedError for a value that is no constant between the changes.
        """
        value.lift()
        value.held_alike()
        feature = value.axis.feature
        ends, constant = value.axis.ends, value.constant
        key = bits(constant)
        known = np.ones(len(constant), np.bool_) if value.known is None else value.known
        varies = np.zeros(len(constant), np.bool_) if value.chain is None else value.chain > 0
        change = (key[1:-1] != key[:-2]) | (known[1:-1] != known[:-2]) | varies[1:-1] | varies[:-2]
        run = np.append(np.flatnonzero(change), len(ends) - 1)  # last lane of each run
        run_ends = ends[run]
        low, high, nan = self.low[:, feature], self.high[:, feature], self.nan[:, feature]
        numbers = low <= high
        first = np.searchsorted(run_ends, low)
        last = np.where(numbers, np.searchsorted(run_ends, high), first - 1)
        # NaN joins the run that has the same value, where the lane reaches it
        same = np.flatnonzero((key[run] == key[-1]) & (known[run] == known[-1]))
        joins = np.full(self.lanes, -1)
        if same.size:
            nearest = same[np.minimum(np.searchsorted(same, first), len(same) - 1)]
            joins = np.where((nearest >= first) & (nearest <= last) & nan, nearest, -1)
        alone = nan & (joins < 0)
        count = np.where(active, last - first + 1 + alone, 1)
        parent = np.repeat(np.arange(self.lanes), count)
        if len(parent) > MOST_LANES:
            raise NotProvedError(f"more than {MOST_LANES:,} boxes")
        offset = np.arange(len(parent)) - np.repeat(np.cumsum(count) - count, count)
        number = first[parent] + offset
        of_nan = alone[parent] & (number > last[parent]) & active[parent]
        position = np.minimum(np.where(of_nan | ~active[parent], 0, number), len(run) - 1)
        lane = np.where(of_nan, len(ends), run[position])
        if np.any(varies[lane] & active[parent]):
            raise NotProvedError("a number that varies with an input where a constant is needed")
        if len(parent) != self.lanes or np.any(of_nan):
            before = np.where(position > 0, run_ends[position - 1] + 1, LOWEST)
            inside = active[parent] & ~of_nan
            new_low = np.where(inside, np.maximum(low[parent], before), low[parent])
            new_high = np.where(inside, np.minimum(high[parent], run_ends[position]), high[parent])
            new_low = np.where(of_nan, HIGHEST, new_low)
            new_high = np.where(of_nan, LOWEST, new_high)
            new_nan = np.where(inside, joins[parent] == number, nan[parent])
            self.replace(parent, np.full(len(parent), feature), new_low, new_high, new_nan)
        return constant[lane], known[lane]

    def points(self, lanes: IntArray) -> FloatArray:
        """One row of inputs in each of some lanes."""
        low, high = self.low[lanes], self.high[lanes]
        zero = np.clip(0, low, high)
        return np.where(low <= high, from_keys(zero), np.nan)


@dataclass
class Lanes:
    """A value for each lane of a space; `known`: where it has one (None: everywhere)."""

    space: Space
    value: AnyArray
    known: BoolArray | None = None
    version: int = -1

    def __post_init__(self) -> None:
        if self.version < 0:
            self.version = len(self.space.parents)

    def lift(self) -> Lanes:
        """Bring the arrays up to the lanes that the space has now."""
        for parent in self.space.parents[self.version :]:
            self.value = self.value[parent]
            self.known = None if self.known is None else self.known[parent]
        self.version = len(self.space.parents)
        return self


@dataclass
class Slots:
    """An element of a list of values of single inputs, a number of the list for each lane of a space."""

    space: Space
    index: Lanes
    items: list[object]
