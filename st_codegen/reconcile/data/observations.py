"""Measured runs as complex harmonic coefficients: what all of reconcile works on.

A row is one direction of one run at constant conditions. TE(theta) = Re(sum over k of c_k * exp(i*k*theta)), deg.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.errors import counted
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import AXES
from st_codegen.reconcile.data.hum import Hum
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions

#: of forward and backward, in the order of every axis of two directions
SIGNS = (1.0, -1.0)
#: fields that hold something of each row, and of each order as the second axis
_BY_ROW = ("values", "angle_rad", "run", "spectral_deg", "left_out", "seen", "begins_rad", "rounded_by")
_BY_ORDER = ("values", "spectral_deg", "seen")


@dataclass(frozen=True, eq=False)
class Observations:
    """Measured coefficients; they are equal to themselves alone.

    at: conditions (n,); labels: name of each row for messages; orders: int (K,), rising; values: complex128 (n, K),
    deg. spectral_deg: the noise of each value by its own curve's spectrum, (n, K), where that is known; seen: bool
    (n, K), whether a curve tells the order at all; left_out: bool (n,), rows that the search does not look at;
    not_looked_at: what was left aside, as sentences. Samples over time are rows of their own, with the TE in the place
    of order 0: then `angle_rad` (n,) is the angle of each and `inside` the orders of which its TE is the sum. run: int
    (n,), the number of each run in the order of measuring, where that is known; sorted_by: the condition by which
    their list is sorted first, which may be the time as well, where it is. samples: of each curve, where all have as
    many, else 0. hums: waves of a frequency of their own that were taken out of the values. begins_rad: the angle at
    which each curve begins, (n,). beyond_deg: RMS that the curves hold beside the orders that are looked at, where that
    is more than the noise below lets expect; else 0. neighbours_deg: of samples over time the noise by what each has
    beside those right before and after it, before any were left out; inf where it is not known. rounded_by: of
    samples over time the RMS, deg, of what the angles of each one's recording are rounded by, (n,).
    """

    at: Conditions
    labels: tuple[str, ...]
    orders: IntArray
    values: ComplexArray
    angle_rad: FloatArray | None = None
    inside: tuple[int, ...] = ()
    run: IntArray | None = None
    spectral_deg: FloatArray | None = None
    left_out: BoolArray | None = None
    seen: BoolArray | None = None
    not_looked_at: tuple[str, ...] = ()
    samples: int = 0
    hums: tuple[Hum, ...] = ()
    sorted_by: str = ""
    begins_rad: FloatArray | None = None
    beyond_deg: float = 0.0
    neighbours_deg: float = np.inf
    rounded_by: FloatArray | None = None

    @cached_property
    def parts(self) -> IntArray:
        """How many numbers a coefficient of each order is, (K,): the mean is one, a wave two."""
        return np.where(self.orders == 0, 1, 2)

    def with_real_mean(self, values: ComplexArray) -> ComplexArray:
        """Values (n, K) without an imaginary part of the mean, which has none."""
        return np.where(self.orders == 0, values.real, values)

    def under(self, **conditions: FloatArray) -> Observations:
        """These values under other conditions, given by their names."""
        return replace(self, at=replace(self.at, **conditions))

    def divided(self, factor: FloatArray | ComplexArray) -> Observations:
        """The values, and the noise within their curves, divided by factors for rows (n, 1) or coefficients (n, K)."""
        spectral = None if self.spectral_deg is None else self.spectral_deg / np.abs(factor)
        return replace(self, values=self.values / factor, spectral_deg=spectral)

    @property
    def rounded_deg(self) -> float:
        """RMS of what the angles of samples over time are rounded by; else 0."""
        return 0.0 if self.rounded_by is None else float(np.sqrt((self.rounded_by**2).mean()))

    def hum_power(self, orders: Sequence[int] | IntArray) -> FloatArray:
        """The power (deg^2) that hums had in orders before they were taken out of the values, (orders,)."""
        return sum((one.by_order[orders] ** 2 for one in self.hums), np.zeros(len(orders)))

    def model_orders(self) -> tuple[int, ...]:
        """The orders whose coefficients a model must give."""
        return tuple(self.orders.tolist()) if self.angle_rad is None else self.inside

    def observed(self, coefficients: ComplexArray) -> ComplexArray:
        """What is measured of coefficients (n, model orders): themselves, or their sum at the angle of each row."""
        if self.angle_rad is None:
            return coefficients
        # of most changes nearly all orders are zero
        some = coefficients.any(axis=0)
        found: ComplexArray = (coefficients[:, some] * self._waves[:, some]).sum(axis=1, keepdims=True)
        return found.real.astype(np.complex128)

    @cached_property
    def _waves(self) -> ComplexArray:
        angle = np.zeros(len(self)) if self.angle_rad is None else self.angle_rad
        return np.asarray(np.exp(1j * np.outer(angle, self.inside)))

    def __len__(self) -> int:
        return len(self.labels)

    def rows(self, choice: Any) -> Observations:
        """The rows that a mask or an index array chooses."""
        index = np.arange(len(self))[choice]
        at, labels = self.at.rows(index), tuple(self.labels[i] for i in index)
        return replace(self, at=at, labels=labels, **self._parts(_BY_ROW, index))

    def of_orders(self, choice: BoolArray, why: str) -> Observations:
        """The orders that a mask (K,) chooses; `why` says which the others are and why they are not looked at."""
        said = (*self.not_looked_at, why)
        return replace(self.with_columns(choice), orders=self.orders[choice], not_looked_at=said)

    def with_columns(self, choice: BoolArray | IntArray) -> Observations:
        """What was measured of the orders that a mask or an index array chooses, in the place of the orders' own."""
        return replace(self, **self._parts(_BY_ORDER, (slice(None), choice)))

    def _parts(self, names: Sequence[str], choice: Any) -> dict[str, Any]:
        """The chosen part of the fields that there are."""
        return {name: part[choice] for name in names if (part := getattr(self, name)) is not None}

    def without_copies(self) -> Observations:
        """The rows but those that repeat an earlier one digit by digit: as repeated runs they would have no noise.

        Of a few curves with the digits of another one at another operating point none stays: which label is right
        nobody knows. Where many are equal, nothing that is measured depends on the conditions.
        """
        at, values = self.at, np.concatenate([self.at.sign[:, None], self.values.real, self.values.imag], axis=1)
        if self.angle_rad is not None:
            return self
        rows = np.concatenate([at.points, values], axis=1)
        first = np.sort(np.unique(rows, axis=0, return_index=True)[1])
        alike = np.unique(values[first], axis=0, return_inverse=True, return_counts=True)
        elsewhere = first[alike[2][alike[1].ravel()] > 1]
        if 0 < len(elsewhere) <= SETTINGS.most_suspects * len(self):
            named = first_of([self.labels[row] for row in elsewhere], 4)
            text = f"{counted(len(elsewhere), 'curve')} that have the digits of one at another operating point: {named}"
            kept = np.setdiff1d(np.arange(len(self)), elsewhere)
            return replace(self.rows(kept), not_looked_at=(*self.not_looked_at, text)).without_copies()
        if len(first) == len(self):
            return self
        copies = np.setdiff1d(np.arange(len(self)), first)
        more = f" and {counted(len(copies) - 1, 'more curve')}" if len(copies) > 1 else ""
        text = f"{self.labels[copies[0]]}{more}: the digits of an earlier curve, which counts once"
        return replace(self.rows(first), not_looked_at=(*self.not_looked_at, text))

    @property
    def few_points(self) -> bool:
        """Whether there are too few operating points to tell noise from what differs between them."""
        return self.angle_rad is None and self.at.count_of_points < SETTINGS.least_contrasts

    @cached_property
    def repeated(self) -> bool:
        """Whether an operating point was measured more than once in one direction."""
        return len(np.unique(np.column_stack([self.at.sign, self.at.points]), axis=0)) < len(self)

    @cached_property
    def number_of_run(self) -> IntArray:
        """The number of the run of each row, from 0 on, (n,).

        A run is one or both directions: of one file, or of one place among those of a table.
        """
        at = self.at
        point = np.unique(at.points, axis=0, return_inverse=True)[1].ravel()
        side = 2 * point + (at.sign > 0)
        order = np.argsort(side, kind="stable")
        place = np.empty(len(at), np.int64)
        place[order] = np.arange(len(at)) - np.searchsorted(side[order], side[order])
        kinds = (point, place) if self.run is None else (self.run, point)
        return np.unique(np.stack(kinds), axis=1, return_inverse=True)[1].ravel()

    @cached_property
    def number_of_recording(self) -> IntArray:
        """The number of the recording of each sample over time, (n,)."""
        names = [label.rpartition(", t = ")[0] for label in self.labels]
        return np.unique(names, return_inverse=True)[1].astype(np.int64)

    @cached_property
    def runs(self) -> tuple[IntArray, ...]:
        """The rows of each run."""
        number = self.number_of_run
        return tuple(np.flatnonzero(number == n) for n in range(number.max(initial=-1) + 1))

    @property
    def told(self) -> BoolArray:
        """Which coefficients the curves tell, bool (n, K): all where nothing else is known."""
        return np.ones(self.values.shape, bool) if self.seen is None else self.seen

    def both_directions(self) -> bool:
        """Whether there are rows of both directions."""
        return bool((self.at.sign > 0).any() and (self.at.sign < 0).any())

    def scaled(self, factor: float) -> Observations:
        """The values times a factor (units)."""
        spectral = None if self.spectral_deg is None else self.spectral_deg * abs(factor)
        hums, beyond = tuple(hum.scaled(abs(factor)) for hum in self.hums), self.beyond_deg * abs(factor)
        return replace(self, values=self.values * factor, spectral_deg=spectral, hums=hums, beyond_deg=beyond)


def from_table(table: HarmonicTable) -> Observations:
    """The rows of a harmonic table."""
    at = table.at
    values = np.array(table.coefficients)
    orders, run = np.array(table.orders, np.int64), order_of_runs(at)
    return Observations(at, labels(at), orders, values, run=run, sorted_by=sorted_by(at))


def order_of_runs(at: Conditions) -> IntArray | None:
    """Numbers of runs that are listed in the order of measuring, each direction for itself; None where they are sorted.

    Rows that are sorted by conditions say nothing of time, or time cannot be told from a condition.
    """
    if sorted_by(at):
        return None
    found = np.zeros(len(at), np.int64)
    for rows in map(np.flatnonzero, at.by_direction()):
        found[rows] = np.arange(len(rows))
    return found


def sorted_by(at: Conditions) -> str:
    """The condition by which runs are sorted first (`speed`, `torque`, `temperature`); empty where they are not."""
    for rows in at.by_direction():
        columns = [np.round(column[rows], 9) for column in at.axes]
        for first in itertools.permutations(range(3)):
            listed = np.stack([columns[i] for i in first], axis=1)
            if (np.lexsort(listed.T[::-1]) == np.arange(len(listed))).all():
                moves = [i for i in first if len(np.unique(columns[i])) > 1] or [0]
                return AXES[moves[0]]
    return ""


def labels(at: Conditions, files: Sequence[str] | None = None) -> tuple[str, ...]:
    """Names of rows: file or conditions, and direction."""
    names = []
    for row in range(len(at)):
        point = f"{at.speed_rpm[row]:g} rpm, {at.torque_Nm[row]:g} N m, {at.temperature_C[row]:g} degC"
        direction = "forward" if at.sign[row] > 0 else "backward"
        names.append(f"{point}, {direction}" if files is None else f"{files[row]} ({point}, {direction})")
    return tuple(names)


def rows_that_tell(count: int, most: int | None = None) -> IntArray:
    """Some of so many rows (or runs), in their order, which tell what all have in common; all where they are few.

    They are drawn, always the same ones: every tenth row of sorted ones may have one torque.
    """
    drawn = np.random.default_rng(0).permutation(count)
    return np.sort(drawn[: SETTINGS.rows_that_tell if most is None else most])


def first_of(texts: Sequence[str], most: int, between: str = ", ") -> str:
    """The first texts, as many as are shown, and two dots where there are more."""
    return between.join(texts[:most]) + (f"{between}.." if len(texts) > most else "")


def whole_percent(share: float) -> str:
    """A share in whole percent, neither all nor nothing where it is not.

    >>> whole_percent(0.997), whole_percent(0.123), whole_percent(0.001), whole_percent(1.0)
    ('more than 99', '12', 'less than 1', '100')
    """
    if share <= 0.0:
        return "0"
    rounded = round(100 * share)
    return "more than 99" if rounded == 100 and share < 1.0 else str(rounded) if rounded else "less than 1"


def rms_deg(values: ComplexArray, orders: IntArray) -> float:
    """RMS over angle and rows of curves with these coefficients, deg."""
    power = np.where(orders == 0, 1.0, 0.5) * np.abs(values) ** 2
    if not power.size:
        return 0.0
    return float(np.sqrt(power.sum(axis=1).mean()))
