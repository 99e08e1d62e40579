"""One direction of a harmonic table, searched: what every candidate predicts of every order, and the choice from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import ComplexArray
from st_codegen.training.errors import Errors, errors_of
from st_codegen.training.families import Learner
from st_codegen.training.search import FitOutcome, FitTask, Fitting
from st_codegen.training.targets import Coordinates, combined, kinds, learned_values

#: LightGBM takes no larger seed, scikit-learn none below 0.
LARGEST_SEED = 2**31 - 1
#: With two folds some families cannot be fitted to fewer.
_LEAST_POINTS = 10


@dataclass(frozen=True)
class SearchSettings:
    """How a search is made: candidates, folds of the cross-validation, seed, and the ways to learn a harmonic."""

    candidates: tuple[Learner, ...]
    folds: int = 10
    seed: int = 0
    kinds: tuple[Coordinates, ...] = tuple(Coordinates)
    turned: bool = True


@dataclass(frozen=True)
class Solution:
    """One way to predict an order: a candidate for each quantity of a kind, with predictions and cost.

    left_out: complex128 (rows,), of rows that the models did not see; test: complex128 (points,); cost_us: sum of both.
    """

    order: int
    kind: Coordinates
    candidates: tuple[Learner, ...]
    left_out: ComplexArray
    test: ComplexArray
    cost_us: float
    errors: Errors

    @property
    def name(self) -> str:
        """The families of the models and what they predict, for a column of a table."""
        families = list(dict.fromkeys(candidate.family for candidate in self.candidates))
        return "+".join(families) + ("" if self.order == 0 else f" ({self.kind})")


@dataclass(frozen=True)
class Study:
    """All outcomes of a search in one direction; `learn` and `test` are the rows that were used."""

    learn: HarmonicTable
    test: HarmonicTable
    settings: SearchSettings
    outcomes: dict[tuple[int, Coordinates], tuple[tuple[FitOutcome, ...], ...]]

    def solutions(self, order: int, *, mixed: bool = True) -> Iterator[Solution]:
        """All pairs of candidates for an order; `mixed`: also of two different ones."""
        truth = self.learn.column(order)
        candidates = self.settings.candidates
        for kind in self.settings.kinds:
            if (order, kind) not in self.outcomes:
                continue
            quantities = self.outcomes[order, kind]
            for pair in _pairs(len(candidates), len(quantities), mixed):
                chosen = [quantities[quantity][number] for quantity, number in enumerate(pair)]
                left_out = combined(order, kind, tuple(outcome.folds for outcome in chosen))
                yield Solution(
                    order,
                    kind,
                    tuple(candidates[number] for number in pair),
                    left_out,
                    combined(order, kind, tuple(outcome.test for outcome in chosen)),
                    sum(outcome.cost_us for outcome in chosen),
                    errors_of(order, left_out, truth),
                )


def _pairs(candidates: int, quantities: int, mixed: bool) -> Iterator[tuple[int, ...]]:
    if quantities == 1 or not mixed:
        yield from ((number,) * quantities for number in range(candidates))
        return
    yield from ((first, second) for first in range(candidates) for second in range(candidates))


def tasks_of(
    learn: HarmonicTable, test: HarmonicTable, settings: SearchSettings, orders: Sequence[int]
) -> tuple[list[tuple[int, Coordinates]], list[FitTask]]:
    """The tasks of a search, and the order and kind of each group of them: quantities by candidates."""
    groups, tasks = [], []
    for order in orders:
        for kind in kinds(order):
            if kind not in settings.kinds and order:
                continue
            groups.append((order, kind))
            targets = learned_values(learn.column(order), kind, order, turned=settings.turned)
            for quantity, y in zip(kind.quantities(order), targets, strict=True):
                tasks += [
                    FitTask(
                        candidate,
                        learn.conditions,
                        y,
                        test.conditions,
                        settings.folds,
                        settings.seed,
                        f"order {order} {quantity} {candidate.family}",
                    )
                    for candidate in settings.candidates
                ]
    return groups, tasks


def operating_points(table: HarmonicTable) -> int:
    """The number of different operating points, whatever the direction."""
    return len(np.unique(table.conditions, axis=0))


def study(learn: HarmonicTable, test: HarmonicTable, settings: SearchSettings, fitting: Fitting) -> Study:
    """Search one direction: learn from some rows, predict others. Both tables have the rows of one direction.

    Raises InputError where there are too few operating points to learn from.
    """
    if (points := operating_points(learn)) < _LEAST_POINTS:
        raise InputError(
            f"{counted(points, 'operating point')} left to learn from, and at least {_LEAST_POINTS} are needed: keep "
            "fewer for testing, or measure more"
        )
    groups, tasks = tasks_of(learn, test, settings, learn.orders)
    done = fitting.outcomes(tasks)
    outcomes, start, width = {}, 0, len(settings.candidates)
    for order, kind in groups:
        quantities = len(kind.quantities(order))
        outcomes[order, kind] = tuple(
            done[start + part * width : start + (part + 1) * width] for part in range(quantities)
        )
        start += quantities * width
    return Study(learn, test, settings, outcomes)
