"""The next measurement: the operating points that would tell most of what the data leave open.

Runs are chosen greedily, each beside those before it. What is left of them goes to where models that learn from the
runs alone would miss most of what was found: peaks between the measured speeds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS, OperatingPoint
from st_codegen.files.csv_tables import csv_text
from st_codegen.reconcile.plan.points import a_sample, points_of, rows_at
from st_codegen.reconcile.plan.questions import (
    Name,
    Parameters,
    Question,
    other_models,
    other_orders,
    peaks_between,
    told_apart,
    unexplained,
)
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Form
from st_codegen.threads import one_thread


@dataclass(frozen=True)
class NextRun:
    """A proposed run (both directions): where, what for, and what it is expected to add (nats); whether it was made."""

    point: OperatingPoint
    purpose: str
    gain: float
    repeats: bool = False

    @property
    def file(self) -> str:
        """The name of its file: a repeat must not stand in the place of the run that it repeats."""
        return f"{'repeat_' * self.repeats}{self.point.file_name()}"


@dataclass(frozen=True)
class Narrowed:
    """A parameter of what was found: its standard error now, and as expected with the proposed runs."""

    effect: str
    orders: tuple[int, ...]
    key: str
    now: float
    then: float


@dataclass(frozen=True)
class NextRuns:
    """The proposed runs, as they were chosen; how much they are expected to narrow; why there are none."""

    runs: tuple[NextRun, ...] = ()
    narrowed: tuple[Narrowed, ...] = ()
    none_because: str = ""

    def as_json(self) -> dict[str, Any]:
        """The key `next_runs` of report.json."""
        return {
            "runs": [{**asdict(run.point), "purpose": run.purpose, "gain_nats": run.gain} for run in self.runs],
            "expected": [
                {"name": n.effect, "orders": list(n.orders), "key": n.key, "stderr": n.now, "with_runs": n.then}
                for n in self.narrowed
            ],
            "none_because": self.none_because,
        }

    def csv_text(self) -> str:
        """The runs as conditions of a campaign, each with what it is for."""
        rows = ([run.file, *(f"{x:g}" for x in astuple(run.point)), run.purpose] for run in self.runs)
        return csv_text([["file", *CONDITION_COLUMNS, "purpose"], *rows])


@one_thread()
def next_runs(result: Reconciliation) -> NextRuns:
    """The runs that would tell most of what a reconciliation leaves open."""
    data, final = result.data, result.conclusions.final
    if data.angle_rad is not None:
        return NextRuns(none_because="recordings over time have no operating points that could be chosen")
    rivals = other_models(result)
    points = points_of(result, [rival.rig for rival in rivals])
    if not points:
        repeated = tuple(_repeats(result))
        return NextRuns(repeated, none_because="" if repeated else "every point between the measured ones was measured")
    # a thousand coordinates at ten thousand points are more than memory holds
    numbers = max(len(final.prior) ** 2, 4 * len(data.orders))
    points = a_sample(points, int(SETTINGS.most_numbers_of_points / numbers))
    rows = rows_at(points, final)
    parameters = Parameters.of(final, rows)
    questions = [
        *told_apart(final, rows, rivals),
        *unexplained(result, rows),
        *other_orders(result, rows),
        *([] if parameters is None else [parameters]),
    ]
    company = _Company(result)
    chosen = _chosen(points, questions, company, least=SETTINGS.least_gain if is_known(result) else 0.0)
    rest = SETTINGS.most_next_runs - len(chosen)
    chosen += _chosen(points, peaks_between(result, rows), company, rest, {run.point for run in chosen})
    chosen += _repeats(result)[: SETTINGS.most_next_runs - len(chosen)]
    if not chosen:
        return NextRuns(none_because="no single run inside what was measured would add much")
    return NextRuns(tuple(chosen), () if parameters is None else _narrowed(result, parameters.ratios()))


def _repeats(result: Reconciliation) -> list[NextRun]:
    """Runs that were made already, where what runs differ by without a pattern is largest: repeated they tell noise."""
    orders = {one.order for one in result.unexplained if one.is_scatter}
    if not orders or result.data.repeated:
        return []
    columns, at = np.isin(result.data.orders, sorted(orders)), result.data.at
    power = (np.abs(result.conclusions.final.residual[:, columns] / result.target.sigma[:, columns]) ** 2).sum(axis=1)
    loudest = [rows[0] for rows in sorted(result.data.runs, key=lambda rows: -float(power[rows].sum()))]
    why = "repeats a run that was made: what differs again is noise, or changes from run to run"
    points = [OperatingPoint(*at.points[row].tolist()) for row in loudest]
    return [NextRun(point, why, 0.0, repeats=True) for point in points[: SETTINGS.repeats]]


def is_known(result: Reconciliation) -> bool:
    """Whether the sizes of what was found are known well enough: each error is a small share of the largest like it."""
    for effect, errors in result.conclusions.told:
        units = {s.key: s.unit for s in effect.scalars if s.form in (Form.LINEAR, Form.INVERSE)}
        units |= {phasor.keys(side)[0]: phasor.unit for phasor in effect.phasors for side in (False, True)}
        largest: dict[str, float] = {}
        for key, unit in units.items():
            if key in effect.values:
                largest[unit] = max(largest.get(unit, 0.0), float(np.abs(effect.values[key]).max()))
        own = [(error, units.get(key.partition("[")[0])) for key, error in errors.items()]
        if any(error > SETTINGS.well_known * largest.get(unit, np.inf) for error, unit in own if unit is not None):
            return False
    return True


def _narrowed(result: Reconciliation, ratios: Mapping[Name, float]) -> tuple[Narrowed, ...]:
    """The standard errors of what was found, now and with the runs."""
    return tuple(
        Narrowed(effect.name, effect.orders, key, now, now * ratios[effect.name, effect.orders, key])
        for effect, errors in result.conclusions.told
        for key, now in errors.items()
        if (effect.name, effect.orders, key) in ratios
    )


class _Company:
    """How many runs there are of about a speed and an oil temperature: they may have noise in common."""

    def __init__(self, result: Reconciliation) -> None:
        at = result.data.at.rows(result.target.good & (result.data.at.sign == result.data.at.sign[0]))
        self.step = max(float(np.ptp(at.speed_rpm)) / SETTINGS.speeds_apart, 1e-9)
        self.runs = Counter(map(self._place, at.speed_rpm.tolist(), at.temperature_C.tolist()))

    def _place(self, speed_rpm: float, temperature_C: float) -> tuple[int, float]:
        return round(speed_rpm / self.step), temperature_C

    def of(self, point: OperatingPoint) -> int:
        """The number of runs beside a point."""
        return self.runs[self._place(point.speed_rpm, point.temperature_C)]

    def add(self, point: OperatingPoint) -> None:
        """Count a point among the runs."""
        self.runs[self._place(point.speed_rpm, point.temperature_C)] += 1


def _chosen(
    points: Sequence[OperatingPoint],
    questions: Sequence[Question],
    company: _Company,
    most: int = SETTINGS.most_next_runs,
    taken: Collection[OperatingPoint] = (),
    *,
    least: float = SETTINGS.least_gain,
) -> list[NextRun]:
    """Points by what they add, each beside those before it; of those that add about as much the one with least company.

    What only runs of one speed and oil tell is believed less.
    """
    found: list[NextRun] = []
    free = np.array([point not in taken for point in points])
    while len(found) < most and free.any() and questions:
        gains = np.stack([question.gains() for question in questions]) * free
        whole = gains.sum(axis=0)
        if whole.max() <= least:
            break
        about = np.flatnonzero(whole >= SETTINGS.about_as_much * whole.max())
        number = min(about.tolist(), key=lambda i: (company.of(points[i]), -whole[i]))
        reasons = [question.take(number) for question in questions]
        free[number] = False
        company.add(points[number])
        found.append(NextRun(points[number], reasons[int(gains[:, number].argmax())], float(whole[number])))
    return found
