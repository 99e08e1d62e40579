"""What leaving faulty runs out gains, judged on the training rows that are sound.

A set of test points holds its own irregular runs, which hide the gain: a model that learned from bad neighbours is
right about bad test points. So sound training rows are predicted by cross-validation twice, from all other rows and
from all other sound rows, over the same folds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.training.faulty import Faulty
from st_codegen.training.learn import predictions
from st_codegen.training.search import Fitting, fold_numbers
from st_codegen.training.study import SearchSettings, Solution

_FOLDS = 5


@dataclass(frozen=True)
class Gain:
    """Complex MAE (deg) of an order, learned with the faulty runs and without.

    sound: over all sound rows; near: over those within one step of speed, torque and temperature of a faulty run.
    """

    sound_with: float
    sound_without: float
    near_with: float
    near_without: float


def gains(
    train: HarmonicTable,
    faulty: Faulty,
    solutions: Sequence[Solution],
    settings: SearchSettings,
    fitting: Fitting,
) -> dict[int, Gain]:
    """The gain by order, for the models that were chosen; empty where no run is faulty."""
    if not faulty.rows.any():
        return {}
    fold = fold_numbers(train.conditions, _FOLDS, settings.seed)
    error = {s.order: np.full((2, len(train)), np.nan) for s in solutions}
    for number in np.unique(fold):
        asked = (fold == number) & ~faulty.rows
        truth = train.rows(asked)
        for row, left_out in enumerate((np.zeros_like(faulty.rows), faulty.rows)):
            learn_from = train.rows((fold != number) & ~left_out)
            found = predictions(learn_from, truth.conditions, solutions, settings, fitting)
            for order, predicted in found.items():
                error[order][row, asked] = np.abs(predicted - truth.column(order))
    near = near_to(train, faulty.rows) & ~faulty.rows
    return {
        order: Gain(*(float(rows[~faulty.rows].mean()) for rows in both), *(_mean(rows[near]) for rows in both))
        for order, both in error.items()
    }


def near_to(table: HarmonicTable, rows: BoolArray) -> BoolArray:
    """Rows within one step of the table's own levels of each condition of one of these rows (themselves included)."""
    levels = [np.unique(column, return_inverse=True)[1] for column in table.conditions.T]
    steps = np.stack([np.ravel(level) for level in levels], axis=1)
    away = np.abs(steps[:, None] - steps[rows][None]).max(axis=-1)
    near: BoolArray = (away <= 1).any(axis=1)
    return near


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else float("nan")
