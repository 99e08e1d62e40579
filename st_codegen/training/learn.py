"""A harmonic table in, chosen and fitted models out: split, faulty runs, search, choice, errors, final fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.errors import InputError, Problems, at_least, at_most, counted
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.te.bundle_file import LARGEST_PLAY
from st_codegen.te.harmonics import CORRECTION_LIMIT_DEG, Direction
from st_codegen.threads import one_thread
from st_codegen.training.choice import Choice, choose
from st_codegen.training.cost import worst_case_us
from st_codegen.training.errors import Errors, errors_of
from st_codegen.training.export import BundleHead, FittedModel
from st_codegen.training.families import FAMILIES, Learner, family_named
from st_codegen.training.faulty import Faulty, faulty_runs
from st_codegen.training.search import LEARNERS, FitOutcome, FitTask, Fitting, point_numbers
from st_codegen.training.study import SearchSettings, Solution, Study, operating_points, study
from st_codegen.training.targets import combined, learned_values

#: fewer operating points in a direction cannot be split, cross-validated and learned from
LEAST_POINTS = 20
#: larger numbers are not learned: libraries add squares of them in float32
_LARGEST = 1e15
#: no oil of a gear is that hot throughout, degC, while every temperature in K is
_HOTTEST = 200.0

#: Pairs of runs without load, forward and backward, from which a play is read.
_LEAST_PAIRS = 4


@dataclass(frozen=True)
class LearningPlan:
    """What is to be done beside the search itself.

    test_share: part of the operating points kept apart; test_points: these instead, float64 (points, 3); limit_us:
    worst case of all models of one direction; repeats: further random splits for confidence intervals; keep_faulty:
    learn from faulty runs too.
    """

    settings: SearchSettings
    test_share: float = 0.2
    test_points: FloatArray | None = None
    limit_us: float = math.inf
    repeats: int = 0
    keep_faulty: bool = False


@dataclass(frozen=True)
class ConfidenceInterval:
    """Mean of an error over repeated splits, and half of its 95 % confidence interval: infinite for one split."""

    mean: float
    half_width: float

    def __str__(self) -> str:
        spread = f" +- {self.half_width:.2g}" if math.isfinite(self.half_width) else ", of one split"
        return f"{self.mean:.3g}{spread}"


@dataclass(frozen=True)
class Lesson:
    """One direction: the search, what was chosen, how good it is on points kept apart, and the final models.

    The final models are learned anew from all runs: `test_errors` are those of models learned without the points.
    learned_from: the rows of these, faulty ones left out; costs_us: by order, their worst case; intervals: by order, of
    the complex MAE (deg) over repeated splits, where there were any; copied: how many runs are as `copies` counts.
    """

    direction: Direction
    faulty: Faulty
    train: HarmonicTable
    study: Study
    choice: Choice
    test_errors: Mapping[int, Errors]
    models: tuple[FittedModel, ...]
    learned_from: HarmonicTable
    costs_us: Mapping[int, float]
    intervals: Mapping[int, ConfidenceInterval] = field(default_factory=dict)
    copied: int = 0

    @property
    def runs(self) -> int:
        """How many runs there are, those that are faulty or were kept apart included."""
        return len(self.train) + len(self.study.test)

    @property
    def left_out(self) -> int:
        """How many runs the final models were not learned from, since they are faulty among all."""
        return self.runs - len(self.learned_from)

    @property
    def cost_us(self) -> float:
        """Worst case of one evaluation of all final models."""
        return sum(self.costs_us.values())

    def constant_mae(self, order: int) -> float:
        """The complex MAE (deg) at the points kept apart of the mean of the rows that were learned from."""
        truth = self.study.test.column(order)
        constant = np.full(len(truth), self.study.learn.column(order).mean())
        return errors_of(order, constant, truth).complex_mae

    def remarks(self) -> list[str]:
        """Orders whose models are no better than a constant, faulty runs not looked for, runs like copies of others."""
        found = [self._no_better()]
        if self.faulty.not_judged:
            found.append(f"{self.direction}, faulty runs: {self.faulty.not_judged}")
        if self.copied:
            found.append(
                f"{self.direction}, {self.copied} of {counted(self.runs, 'run')}: the very numbers of a run at another "
                "operating point, as copies have; errors at points kept apart may be too small for it"
            )
        return [text for text in found if text]

    def beyond_limit(self, reduction_ratio: float) -> str:
        """The largest wave (or mean) where it alone takes more than the blocks correct by, as in another unit."""
        sizes = np.abs(self.learned_from.coefficients).max(axis=0)
        largest = int(sizes.argmax())
        if (motor := sizes[largest] * reduction_ratio) <= CORRECTION_LIMIT_DEG:
            return ""
        return (
            f"{self.direction}, order {self.learned_from.orders[largest]}: up to {sizes[largest]:.3g} deg, so "
            f"{motor:.3g} deg at the motor, where the blocks correct by {CORRECTION_LIMIT_DEG:g} at most "
            "(fCorrectionLimit_deg): is TE in deg?"
        )

    def _no_better(self) -> str:
        constant = {order: self.constant_mae(order) for order in self.test_errors}
        orders = [order for order, own in self.test_errors.items() if own.complex_mae >= constant[order] > 0.0]
        if not orders:
            return ""
        listed = f"{', '.join(map(str, orders))} of {counted(len(self.study.test), 'run')} kept apart"
        return (
            f"{self.direction}, order{'s' * (len(orders) > 1)} {listed}: no better predicted than by the mean of the "
            "runs that models were chosen on"
        )


def check_learnable(table: HarmonicTable, what: str = "harmonic table") -> None:
    """Raise one InputError, of `what`, where a direction has too few operating points, or numbers are not learned."""
    problems = Problems(what)
    for direction in table.directions():
        if (points := operating_points(table.direction(direction))) < LEAST_POINTS:
            problems.add(
                f"{counted(points, 'operating point')} in one direction, {direction}: at least {LEAST_POINTS} are "
                "needed to learn from"
            )
    if len(standing := table.conditions[table.speed_rpm <= 0.0]):
        speed, torque, temperature = standing[0]
        problems.add(
            f"{counted(len(standing), 'run')} with a speed of 0 rpm or less, the first at {speed:g} rpm, {torque:g} "
            f"N m and {temperature:g} degC: speeds are above 0, and the direction has a column of its own"
        )
    if (coldest := table.temperature_C.min(initial=math.inf)) > _HOTTEST and len(table):
        problems.add(f"no temperature is below {coldest:g} degC: they look like K, and the blocks are given degC")
    columns = {"speed_rpm": table.speed_rpm, "torque_Nm": table.torque_Nm, "temperature_C": table.temperature_C}
    columns |= {f"A{order}": np.abs(table.column(order)) for order in table.orders}
    for name, column in columns.items():
        if (largest := np.abs(column).max(initial=0.0)) > _LARGEST:
            problems.add(f"{name} reaches {largest:.3g}; no more than {_LARGEST:g} is learned: is the unit right?")
    problems.raise_if_any()


def split_rows(table: HarmonicTable, plan: LearningPlan) -> BoolArray:
    """Which rows of one direction are test rows, bool (n,): those at the points of the plan, or at a random share.

    Raises InputError where a test point is not in the table, or `check_learnable` finds something.
    """
    check_learnable(table)
    if plan.test_points is None:
        count = operating_points(table)
        order = np.random.default_rng(plan.settings.seed).permutation(count)
        mask = np.zeros(count, np.bool_)
        mask[order[: max(1, round(plan.test_share * count))]] = True
        return mask[point_numbers(table.conditions)]
    wanted = {tuple(map(float, point)) for point in plan.test_points}
    points = [tuple(map(float, row)) for row in table.conditions]
    if missing := sorted(wanted - set(points)):
        first = ", ".join(map(str, missing[:3]))
        raise InputError(
            f"the harmonic table lacks {len(missing)} of {counted(len(wanted), 'test point')}: {first}, ..: is it of "
            "the same measurement?"
        )
    return np.array([point in wanted for point in points])


def learn(table: HarmonicTable, direction: Direction, plan: LearningPlan, fitting: Fitting) -> Lesson:
    """Learn one direction of a table. Raises InputError (too few points, nothing fits the cost limit)."""
    rows = table.direction(direction)
    is_test = split_rows(rows, plan)
    train, test = rows.rows(~is_test), rows.rows(is_test)
    faulty = faulty_runs(train)
    good = train if plan.keep_faulty else train.rows(~faulty.rows)
    searched = study(good, test, plan.settings, fitting)
    every = rows if plan.keep_faulty else rows.rows(~faulty_runs(rows).rows)
    choice, models = chosen_models(searched, every, direction, plan)
    errors = {s.order: errors_of(s.order, s.test, test.column(s.order)) for s in choice.solutions}
    costs = {s.order: costs_us(model for model in models if model.order == s.order) for s in choice.solutions}
    intervals = repeated(rows, choice, plan, fitting) if plan.repeats else {}
    return Lesson(direction, faulty, train, searched, choice, errors, models, every, costs, intervals, copies(rows))


def copies(rows: HarmonicTable) -> int:
    """How many runs of one direction have the coefficients of one at another operating point, digit by digit."""
    numbers = np.concatenate([rows.coefficients.real, rows.coefficients.imag], axis=1)
    same = np.unique(numbers, axis=0, return_inverse=True)[1].ravel()
    pairs = np.unique(np.stack([same, point_numbers(rows.conditions)], axis=1), axis=0)
    return int((np.bincount(pairs[:, 0]) > 1)[same].sum())


def chosen_models(
    searched: Study, rows: HarmonicTable, direction: Direction, plan: LearningPlan
) -> tuple[Choice, tuple[FittedModel, ...]]:
    """The choice of a search, and its models learned from all rows, which together cost at most what the plan allows.

    Models of more rows can be larger than those of the search, so that another choice may be needed. Raises InputError
    where even the cheapest do not fit.
    """
    known: dict[tuple[object, ...], list[FittedModel]] = {}

    def learned(solution: Solution) -> list[FittedModel]:
        key = (solution.order, solution.kind, *(candidate.key for candidate in solution.candidates))
        if key not in known:
            known[key] = fitted(rows, direction, solution, plan.settings)
        return known[key]

    limit, models = plan.limit_us, tuple[FittedModel, ...]()
    while True:
        try:
            choice = choose(searched, limit_us=limit)
        except InputError:
            if not models:
                raise
            raise InputError(
                f"learned from all runs the cheapest models take {at_most(costs_us(models), 4)} us in the worst case, "
                f"and {at_least(plan.limit_us, 6)} us are allowed: model fewer orders, try cheaper families (DT, ET, "
                "MLP), or allow more"
            ) from None
        models = tuple(model for s in choice.solutions for model in learned(s))
        if costs_us(models) <= plan.limit_us:
            return choice, models
        limit = math.nextafter(choice.cost_us, 0.0)


def costs_us(models: Iterable[FittedModel]) -> float:
    """Worst case of one evaluation of some models."""
    return sum(worst_case_us(model.estimator) for model in models)


def fitted(
    rows: HarmonicTable, direction: Direction, solution: Solution, settings: SearchSettings
) -> list[FittedModel]:
    """The models of a solution, fitted on all rows."""
    order, kind = solution.order, solution.kind
    targets = learned_values(rows.column(order), kind, order, turned=settings.turned)
    models = []
    with one_thread(*LEARNERS):
        for quantity, y, candidate in zip(kind.quantities(order), targets, solution.candidates, strict=True):
            estimator = candidate.fit(rows.conditions, y, settings.seed)
            models.append(FittedModel(direction, order, quantity, estimator))
    return models


def repeated(
    rows: HarmonicTable, choice: Choice, plan: LearningPlan, fitting: Fitting
) -> dict[int, ConfidenceInterval]:
    """Complex MAE of the chosen solutions over random splits, faulty runs found anew in each training part."""
    tests, tasks, share = [], [], 0.0
    for repeat in range(plan.repeats):
        settings = replace(plan.settings, seed=plan.settings.seed + 1 + repeat)
        is_test = split_rows(rows, LearningPlan(settings, plan.test_share))
        train, test = rows.rows(~is_test), rows.rows(is_test)
        good = train if plan.keep_faulty else train.rows(~faulty_runs(train).rows)
        tests.append(test)
        share = max(share, len(test) / len(good))
        for solution in choice.solutions:
            tasks += _tasks(good, test.conditions, solution, plan.settings)
    outcomes = iter(fitting.outcomes(tasks))
    errors: dict[int, list[float]] = {solution.order: [] for solution in choice.solutions}
    for test in tests:
        for solution in choice.solutions:
            predicted = _combined(solution, outcomes)
            errors[solution.order].append(errors_of(solution.order, predicted, test.column(solution.order)).complex_mae)
    return {order: interval(values, share) for order, values in errors.items()}


def predictions(
    learn_from: HarmonicTable,
    x: FloatArray,
    solutions: Sequence[Solution],
    settings: SearchSettings,
    fitting: Fitting,
) -> dict[int, ComplexArray]:
    """What solutions predict at x (points, 3) when they are fitted on these rows, by order."""
    tasks = [task for solution in solutions for task in _tasks(learn_from, x, solution, settings)]
    outcomes = iter(replace(fitting, progress=None).outcomes(tasks))
    return {solution.order: _combined(solution, outcomes) for solution in solutions}


def _tasks(learn_from: HarmonicTable, x: FloatArray, solution: Solution, settings: SearchSettings) -> list[FitTask]:
    """One fit for each quantity of a solution."""
    order = solution.order
    targets = learned_values(learn_from.column(order), solution.kind, order, turned=settings.turned)
    return [
        FitTask(candidate, learn_from.conditions, y, x, 0, settings.seed, f"order {order} again")
        for y, candidate in zip(targets, solution.candidates, strict=True)
    ]


def _combined(solution: Solution, outcomes: Iterator[FitOutcome]) -> ComplexArray:
    """The coefficients of a solution from the next outcomes."""
    parts = tuple(next(outcomes).test for _ in solution.candidates)
    return combined(solution.order, solution.kind, parts)


def interval(errors: Sequence[float], share: float) -> ConfidenceInterval:
    """Mean and 95 % confidence interval of the errors of random splits, by Student's t.

    share: test rows for each training row. Splits have rows in common, so that more of them tell the error no better
    than one set of test rows does (Nadeau and Bengio, Inference for the Generalization Error, 2003, section 3).
    """
    from scipy import special

    count = len(errors)
    if count < 2:
        return ConfidenceInterval(float(np.mean(errors)), math.inf)
    half_width = special.stdtrit(count - 1, 0.975) * np.std(errors, ddof=1) * math.sqrt(1.0 / count + share)
    return ConfidenceInterval(float(np.mean(errors)), float(half_width))


def bundle_head(table: HarmonicTable, name: str, reduction_ratio: float) -> BundleHead:
    """Name, ratio, the ranges of the features in the rows learned from, and the play where they show one."""
    ranges = np.stack([table.conditions.min(axis=0), table.conditions.max(axis=0)], 1)
    return BundleHead(name, reduction_ratio, ranges, play_deg(table))


def play_deg(table: HarmonicTable) -> float | None:
    """Mean backward less mean forward of runs without load, at their lowest speed, deg.

    By a straight line over the speed through all pairs of runs. None where there are fewer than four pairs, or where
    chance would make it as large as often as three standard deviations of a normal number: by Student's t, since few
    pairs tell their scatter badly.
    """
    from scipy import special

    if 0 not in table.orders:
        return None
    means: list[dict[tuple[float, ...], float]] = [{}, {}]
    for backward, at, mean in zip(
        table.backward, table.conditions, table.coefficients[:, table.orders.index(0)].real, strict=True
    ):
        if at[1] == 0.0:
            means[int(backward)][tuple(at)] = float(mean)
    pairs = sorted(means[0].keys() & means[1].keys())
    if len(pairs) < _LEAST_PAIRS:
        return None
    speed = np.array([at[0] for at in pairs])
    gap = np.array([means[1][at] - means[0][at] for at in pairs])
    columns = np.stack([np.ones_like(speed), speed - speed.min()], 1)[:, : 1 + bool(np.ptp(speed))]
    found, *_ = np.linalg.lstsq(columns, gap, rcond=None)
    freedom = len(pairs) - columns.shape[1]
    scatter = float(((gap - columns @ found) ** 2).sum()) / freedom
    error = math.sqrt(scatter * float(np.linalg.inv(columns.T @ columns)[0, 0]))
    least = special.stdtrit(freedom, special.ndtr(3.0)) * error
    return float(found[0]) if least < found[0] <= LARGEST_PLAY else None


def only_exportable(settings: SearchSettings, form: str) -> SearchSettings:
    """The settings without the families that cannot be saved in a form. Raises InputError where none is left."""
    kept = tuple(c for c in settings.candidates if form in family_named(c.family).forms)
    if not kept:
        names = ", ".join(name for name, family in FAMILIES.items() if form in family.forms)
        raise InputError(f"none of these families can be saved as {form}: {names} can")
    return replace(settings, candidates=kept)


def authors_candidates(names: Sequence[str]) -> tuple[Learner, ...]:
    """The families as the paper's authors tuned them."""
    return tuple(Learner(family.name, family.authors, True) for family in map(family_named, names))
