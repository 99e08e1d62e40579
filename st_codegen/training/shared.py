"""Models that several axes share: learned on the runs of all of them, with a correction for each axis and order.

A polynomial of second degree in the operating point is fitted to the training runs of all axes together, of which each
has its own multiple, by alternating least squares: of every order a complex factor, of the mean a factor and an offset.
The models learn the runs of all axes divided by these, and the multiple is the correction of what they predict.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable, joined
from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.te.harmonics import AxisCorrection, Direction
from st_codegen.training.export import FittedModel
from st_codegen.training.faulty import faulty_runs
from st_codegen.training.learn import LEAST_POINTS, LearningPlan, chosen_models, learn
from st_codegen.training.search import Fitting
from st_codegen.training.study import operating_points, study
from st_codegen.training.targets import mean_direction

#: A factor of the mean beyond this, or below its inverse, is taken for one that the runs do not show: 1 in its place.
_MOST_OF_MEAN = 2.0
#: Rounds of alternating least squares.
_ROUNDS = 10


@dataclass(frozen=True)
class SharedLesson:
    """Models of several axes, and by name of the axis its corrections and what they leave on the runs held out.

    learned_from: by axis, the rows that the models are learned from, faulty ones left out; errors: mean square of the
    transmission error that is left of each held-out run, float64 (runs,), deg^2.
    """

    models: tuple[FittedModel, ...]
    corrections: Mapping[str, tuple[AxisCorrection, ...]]
    learned_from: Mapping[str, HarmonicTable]
    errors: Mapping[str, FloatArray]


def held_out_points(tables: Mapping[str, HarmonicTable], share: float, seed: int) -> FloatArray:
    """Operating points at which no run of any axis is learned from, float64 (points, 3): a random share of all."""
    points = np.unique(np.concatenate([table.conditions for table in tables.values()]), axis=0)
    chosen = np.random.default_rng(seed).permutation(len(points))[: max(1, round(share * len(points)))]
    return points[np.sort(chosen)]


def held_out_rows(table: HarmonicTable, points: FloatArray) -> BoolArray:
    """Which rows are at one of the points, bool (n,)."""
    found: BoolArray = (table.conditions[:, None] == points).all(axis=2).any(axis=1)
    return found


def squared_errors(orders: tuple[int, ...], predicted: ComplexArray, truth: ComplexArray) -> FloatArray:
    """Mean square over a turn of the transmission error that wrong coefficients (n, orders) leave, (n,), deg^2."""
    weight = np.where(np.array(orders) == 0, 1.0, 0.5)
    return np.asarray((np.abs(predicted - truth) ** 2 * weight).sum(axis=1), np.float64)


def own_errors(table: HarmonicTable, plan: LearningPlan, points: FloatArray, fitting: Fitting) -> FloatArray:
    """What models of the axis alone leave on the same held-out runs, as in `SharedLesson.errors`.

    Of an axis with too few runs for models, what the average of its training runs leaves. Raises InputError where
    none of its runs is held out, or all are.
    """
    found = []
    for direction in table.directions():
        rows = table.direction(direction)
        is_test = held_out_rows(rows, points)
        if is_test.all() or not is_test.any():
            raise InputError(
                f"at the operating points held out: {is_test.sum()} of {counted(len(rows), 'run')} {direction}"
            )
        test = rows.rows(is_test)
        if operating_points(rows) < LEAST_POINTS:
            predicted = np.broadcast_to(rows.coefficients[~is_test].mean(axis=0), test.coefficients.shape)
        else:
            lesson = learn(table, direction, replace(plan, test_points=test.conditions), fitting)
            predicted = np.stack([solution.test for solution in lesson.choice.solutions], axis=1)
        found.append(squared_errors(rows.orders, predicted, test.coefficients))
    return np.concatenate(found)


def learn_shared(
    tables: Mapping[str, HarmonicTable], plan: LearningPlan, points: FloatArray, fitting: Fitting
) -> SharedLesson:
    """Learn on the runs of all axes but those at the points. Raises InputError where axes differ in orders or
    directions, nothing is left to learn from, or nothing fits the cost limit."""
    directions = {tuple(table.directions()) for table in tables.values()}
    if len(directions) != 1 or len({table.orders for table in tables.values()}) != 1:
        raise InputError("the axes differ in their orders or directions: they cannot share models")
    models: list[FittedModel] = []
    corrections: dict[str, tuple[AxisCorrection, ...]] = dict.fromkeys(tables, ())
    rows: dict[str, list[HarmonicTable]] = {name: [] for name in tables}
    errors: dict[str, list[FloatArray]] = {name: [] for name in tables}
    for direction in directions.pop():
        parts = {name: _Part.of(table.direction(direction), plan, points) for name, table in tables.items()}
        own_models, own = _learned(parts, direction, plan, fitting)
        models += own_models
        for name, (correction, error) in own.items():
            corrections[name] += correction
            rows[name].append(parts[name].every)
            errors[name].append(error)
    return SharedLesson(
        tuple(models),
        corrections,
        {name: joined(own) for name, own in rows.items()},
        {name: np.concatenate(own) for name, own in errors.items()},
    )


@dataclass(frozen=True)
class _Part:
    """The rows of an axis in one direction: to learn from, held out, and all that are good."""

    train: HarmonicTable
    test: HarmonicTable
    every: HarmonicTable

    @classmethod
    def of(cls, rows: HarmonicTable, plan: LearningPlan, points: FloatArray) -> _Part:
        is_test = held_out_rows(rows, points)
        train, test = rows.rows(~is_test), rows.rows(is_test)
        every = rows
        if not plan.keep_faulty:
            train, every = (part.rows(~faulty_runs(part).rows) for part in (train, rows))
        if not len(train):
            raise InputError("an axis has no run beside those held out")
        return cls(train, test, every)


def _corrections(tables: Sequence[HarmonicTable], direction: Direction) -> list[tuple[AxisCorrection, ...]]:
    """What each axis has of the polynomial that all have in common, for each order; the median of sizes is 1."""
    points = np.concatenate([table.conditions for table in tables])
    spread = np.ptp(points, axis=0)
    at = (points - points.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    second = [at[:, i] * at[:, j] for i in range(3) for j in range(i + 1)]
    powers = np.column_stack([np.ones(len(at)), at, *second])
    rows = [slice(*pair) for pair in pairwise(np.cumsum([0, *map(len, tables)]))]
    found: list[list[AxisCorrection]] = [[] for _ in tables]
    for order in tables[0].orders:
        columns = [table.column(order) for table in tables]
        average = float(np.median([column.real.mean() for column in columns]))
        own = [
            AxisCorrection(direction, order, 1.0, turn_rad=mean_direction(column))
            if order
            else AxisCorrection(direction, order, 1.0, offset_deg=float(column.real.mean()) - average)
            for column in columns
        ]
        for _ in range(_ROUNDS):
            factors = np.concatenate([np.full(len(c), complex(*f.parts)) for f, c in zip(own, columns, strict=True)])
            wanted = np.concatenate([c - f.offset_deg for f, c in zip(own, columns, strict=True)])
            common = powers @ np.linalg.lstsq(factors[:, None] * powers, wanted, rcond=None)[0]
            common *= float(np.median([f.factor for f in own])) or 1.0
            if order:  # the models learn phases around 0
                common *= np.exp(-1j * mean_direction(common))
            own = [_of_common(direction, order, common[part], c) for part, c in zip(rows, columns, strict=True)]
        for number, correction in enumerate(own):
            found[number].append(correction)
    return [tuple(own) for own in found]


def _learned(
    parts: Mapping[str, _Part], direction: Direction, plan: LearningPlan, fitting: Fitting
) -> tuple[list[FittedModel], dict[str, tuple[tuple[AxisCorrection, ...], FloatArray]]]:
    """One direction: models, and by axis its corrections and its errors."""
    corrections = _corrections([part.train for part in parts.values()], direction)

    def together(tables: Iterable[HarmonicTable]) -> HarmonicTable:
        """The rows of all axes as if they were of one."""
        return joined([_without(table, own) for table, own in zip(tables, corrections, strict=True)])

    train, test, every = (
        together([getattr(part, kind) for part in parts.values()]) for kind in ("train", "test", "every")
    )
    choice, models = chosen_models(study(train, test, plan.settings, fitting), every, direction, plan)
    ends = np.cumsum([0, *(len(part.test) for part in parts.values())])
    found = {}
    for number, (name, part) in enumerate(parts.items()):
        predicted = [
            complex(*own.parts) * solution.test[ends[number] : ends[number + 1]] + own.offset_deg
            for own, solution in zip(corrections[number], choice.solutions, strict=True)
        ]
        errors = squared_errors(part.test.orders, np.stack(predicted, axis=1), part.test.coefficients)
        found[name] = corrections[number], errors
    return list(models), found


def _without(table: HarmonicTable, corrections: Sequence[AxisCorrection]) -> HarmonicTable:
    """What the models learn of an axis: its coefficients (n, orders) with the corrections undone."""
    factors = np.array([complex(*own.parts) or 1.0 for own in corrections])
    offsets = np.array([own.offset_deg for own in corrections])
    return replace(table, coefficients=(table.coefficients - offsets) / factors)


def _of_common(direction: Direction, order: int, common: ComplexArray, truth: ComplexArray) -> AxisCorrection:
    """Least squares of what an axis has (n,) on what all have in common at its operating points (n,), deg."""
    if order == 0:
        around, away = common.real - common.real.mean(), truth.real - truth.real.mean()
        power = float((around**2).sum())
        factor = float((around * away).sum()) / power if power else 1.0
        if not 1.0 / _MOST_OF_MEAN <= factor <= _MOST_OF_MEAN:
            factor = 1.0
        offset = float(truth.real.mean() - factor * common.real.mean())
        return AxisCorrection(direction, order, factor, offset_deg=offset)
    power = float((np.abs(common) ** 2).sum())
    found = complex((common.conj() * truth).sum()) / power if power else 1.0 + 0.0j
    return AxisCorrection(direction, order, abs(found), turn_rad=float(np.angle(found)))
