"""The paper's protocol on the measured table: its own test points, its errors beside ours.

Reads the authors' errors of all families (`method,quantity,harmonic,MAE,RMSE`) and their predictions at the test points
(a harmonic table, which also says which points these are). Their best family is the one with the least error *on the
test points*, cell by cell; `PaperComparison.best` is ours by the same rule, `chosen` is what cross-validation alone
chooses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from st_codegen.campaign.harmonic_table import HarmonicTable, read_table
from st_codegen.errors import Problems
from st_codegen.files.csv_tables import read_csv
from st_codegen.ir.arrays import ComplexArray
from st_codegen.te.harmonics import Direction
from st_codegen.training.choice import Choice, choose
from st_codegen.training.errors import Errors, errors_of
from st_codegen.training.families import FAMILIES
from st_codegen.training.faulty import Faulty, faulty_runs
from st_codegen.training.faulty_gain import Gain, gains
from st_codegen.training.learn import (
    ConfidenceInterval,
    LearningPlan,
    authors_candidates,
    predictions,
    repeated,
    split_rows,
)
from st_codegen.training.search import Fitting
from st_codegen.training.shared import squared_errors
from st_codegen.training.study import SearchSettings, Study, study
from st_codegen.training.targets import Coordinates

QUANTITIES = ("ampl", "phase", "complex")
#: the row of errors.csv that holds what cross-validation chooses among all families
CHOSEN = "chosen"
#: orders of the paper's own validation runs
PAPER_SUBSET = (0, 1, 39, 40)


@dataclass(frozen=True)
class PaperErrors:
    """MAE and RMSE by (family, quantity, order); `predictions`: their HGBM's coefficients at the test points."""

    mae: Mapping[tuple[str, str, int], float]
    rmse: Mapping[tuple[str, str, int], float]
    predictions: HarmonicTable

    def best(self, quantity: str, order: int) -> tuple[str, float]:
        """Family with the least MAE, and the MAE (nan where none is known)."""
        known = [(mae, family) for (family, of, k), mae in self.mae.items() if (of, k) == (quantity, order)]
        known = [(mae, family) for mae, family in known if family in FAMILIES]
        return (min(known)[1], min(known)[0]) if known else ("", math.nan)


def read_paper(errors: Path, predicted: Path) -> PaperErrors:
    """Read the two files of the authors' results. Raises InputError."""
    table = read_table(predicted)
    problems = Problems(str(errors))
    rows = read_csv(errors, ("method", "quantity", "harmonic", "MAE", "RMSE"))
    mae: dict[tuple[str, str, int], float] = {}
    rmse: dict[tuple[str, str, int], float] = {}
    for row in rows.rows:
        with problems.collect():
            key = rows.text(row, "method"), rows.text(row, "quantity"), int(rows.number(row, "harmonic"))
            mae[key], rmse[key] = rows.number(row, "MAE"), rows.number(row, "RMSE")
    problems.raise_if_any()
    return PaperErrors(mae, rmse, table)


@dataclass(frozen=True)
class ErrorRow:
    """One line of errors.csv: an error of ours and the authors', by order, quantity and family."""

    order: int
    quantity: str
    family: str
    ours_mae: float
    ours_rmse: float
    paper_mae: float
    paper_rmse: float


@dataclass(frozen=True)
class PaperComparison:
    """Our results on the paper's training and test points beside the authors', for all tables."""

    rows: tuple[ErrorRow, ...]
    authors: tuple[ErrorRow, ...]
    paper: PaperErrors
    train_rows: int
    faulty: Faulty
    train: HarmonicTable
    test: HarmonicTable
    choice: Choice
    chosen_errors: Mapping[int, Errors]
    paper_complex: Mapping[int, Errors]
    with_faulty: Mapping[int, Errors]
    gains: Mapping[int, Gain]
    intervals: Mapping[int, ConfidenceInterval]
    reconstruction: Mapping[str, tuple[float, float, float]]

    def cell(self, order: int, quantity: str, family: str) -> ErrorRow | None:
        """The errors of a family for an order and a quantity, or None."""
        for row in self.rows:
            if (row.order, row.quantity, row.family) == (order, quantity, family):
                return row
        return None

    def best(self, order: int, quantity: str) -> ErrorRow:
        """Our family with the least MAE on the test points, as the authors chose theirs."""
        rows = [row for row in self.rows if (row.order, row.quantity) == (order, quantity) and row.family != CHOSEN]
        return min(rows, key=lambda row: row.ours_mae)


def compare(table: HarmonicTable, paper: PaperErrors, plan: LearningPlan, fitting: Fitting) -> PaperComparison:
    """Search on the paper's training points, predict its test points, and set the authors' errors beside.

    The test points of the plan are replaced by the authors' own. Raises InputError where these are not in the table.
    """
    rows = table.direction(Direction.FORWARD)
    settings, repeats = plan.settings, plan.repeats
    names = tuple(dict.fromkeys(candidate.family for candidate in settings.candidates))
    plan = replace(plan, test_points=paper.predictions.conditions)
    is_test = split_rows(rows, plan)
    train, test = rows.rows(~is_test), rows.rows(is_test)
    faulty = faulty_runs(train)
    good = train.rows(~faulty.rows)
    searched = study(good, test, settings, fitting)
    bare = SearchSettings(authors_candidates(names), 0, settings.seed, (Coordinates.POLAR,), turned=False)
    theirs = study(train, test, bare, fitting)
    choice = choose(searched)
    again = predictions(train, test.conditions, choice.solutions, settings, fitting)
    with_faulty = {order: errors_of(order, predicted, test.column(order)) for order, predicted in again.items()}
    order_of_test = _same_points(paper.predictions, test)
    theirs_at_test = paper.predictions.rows(order_of_test)
    return PaperComparison(
        tuple(_rows(searched, paper, theirs_at_test)),
        tuple(_authors_rows(theirs, paper)),
        paper,
        len(train),
        faulty,
        train,
        test,
        choice,
        {s.order: errors_of(s.order, s.test, test.column(s.order)) for s in choice.solutions},
        {k: errors_of(k, theirs_at_test.column(k), test.column(k)) for k in test.orders},
        with_faulty,
        gains(train, faulty, choice.solutions, settings, fitting),
        repeated(rows, choice, replace(plan, test_points=None), fitting) if repeats else {},
        dict(_reconstructions(choice, theirs_at_test, test)),
    )


def _same_points(table: HarmonicTable, wanted: HarmonicTable) -> npt.NDArray[np.intp]:
    """Rows of a table in the order of another one's operating points."""
    row_of = {tuple(row): number for number, row in enumerate(table.conditions.tolist())}
    return np.array([row_of[tuple(row)] for row in wanted.conditions.tolist()])


def _rows(searched: Study, paper: PaperErrors, theirs: HarmonicTable) -> Iterator[ErrorRow]:
    """Every family's errors, its parameters and way of learning chosen by cross-validation for each quantity."""
    for order in searched.learn.orders:
        truth = searched.test.column(order)
        solutions = list(searched.solutions(order))
        hgbm = errors_of(order, theirs.column(order), truth)
        for quantity in QUANTITIES:
            if quantity == "phase" and order == 0:
                continue
            for family in (*FAMILIES, CHOSEN):
                own = [s for s in solutions if family == CHOSEN or {c.family for c in s.candidates} == {family}]
                if not own:
                    continue
                ours = errors_of(order, min(own, key=lambda s: s.errors.mae(quantity)).test, truth)
                yield ErrorRow(
                    order, quantity, family, ours.mae(quantity), ours.rmse(quantity),
                    *_paper_cell(paper, quantity, order, family, hgbm),
                )  # fmt: skip


def _paper_cell(paper: PaperErrors, quantity: str, order: int, family: str, hgbm: Errors) -> tuple[float, float]:
    """MAE and RMSE of the authors; complex errors are known of their HGBM only, from its predictions."""
    if quantity == "complex":
        return (hgbm.complex_mae, hgbm.complex_rmse) if family in ("HGBM", CHOSEN) else (math.nan, math.nan)
    name = paper.best(quantity, order)[0] if family == CHOSEN else family
    key = (name, quantity, order)
    return paper.mae.get(key, math.nan), paper.rmse.get(key, math.nan)


def _authors_rows(theirs: Study, paper: PaperErrors) -> Iterator[ErrorRow]:
    """The families with the authors' parameters, fitted here as they did: bare phases, bare units, all runs."""
    for order in theirs.learn.orders:
        truth = theirs.test.column(order)
        for solution in theirs.solutions(order, mixed=False):
            family = solution.candidates[0].family
            ours = errors_of(order, solution.test, truth)
            for quantity in ("ampl", "phase") if order else ("ampl",):
                key = (family, quantity, order)
                mae = ours.bare_phase_mae if quantity == "phase" else ours.amplitude_mae
                yield ErrorRow(
                    order, quantity, family, mae, ours.rmse(quantity), paper.mae.get(key, math.nan),
                    paper.rmse.get(key, math.nan),
                )  # fmt: skip


def _reconstructions(
    choice: Choice, theirs: HarmonicTable, test: HarmonicTable
) -> Iterator[tuple[str, tuple[float, float, float]]]:
    """RMS error of the reconstructed TE at the test points: median in deg, median and 95th percentile in % of TE."""
    ours = np.stack([solution.test for solution in choice.solutions], axis=1)
    subset = [order for order in PAPER_SUBSET if order in test.orders]
    for name, predicted in (("ours", ours), ("HGBM of the authors", theirs.coefficients)):
        yield f"{name}, all {len(test.orders)} orders", reconstruction(test, test.orders, predicted)
        columns = [test.orders.index(order) for order in subset]
        listed = ", ".join(map(str, subset))
        yield f"{name}, orders {listed} of {len(test.orders)}", reconstruction(test, subset, predicted[:, columns])


def reconstruction(table: HarmonicTable, orders: Sequence[int], predicted: ComplexArray) -> tuple[float, float, float]:
    """Median RMS error in deg, and median and 95th percentile of it in % of the RMS of the TE, over the rows.

    predicted: complex128 (rows, orders); orders of the table that are not predicted count as error in full. The mean
    square of a curve is that of its mean plus half that of its amplitudes.
    """
    missing = np.zeros_like(table.coefficients)
    for column, order in enumerate(orders):
        missing[:, table.orders.index(order)] = predicted[:, column]
    error = np.sqrt(squared_errors(table.orders, missing, table.coefficients))
    size = np.sqrt(squared_errors(table.orders, np.zeros_like(missing), table.coefficients))
    percent = 100.0 * error / size
    return float(np.median(error)), float(np.median(percent)), float(np.percentile(percent, 95))
