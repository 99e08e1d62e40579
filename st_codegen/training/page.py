"""The HTML page of `st-codegen train`: why these orders, which models, how good, and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from st_codegen.errors import counted
from st_codegen.files.number_text import percent
from st_codegen.report import COLOURS, PageSection, PageTable, page
from st_codegen.report.picture import panels as side_by_side
from st_codegen.training.faulty import RULE
from st_codegen.training.learn import Lesson
from st_codegen.training.measured import Measured
from st_codegen.training.study import Solution

#: Orders of which the page says why they were taken or not, beside all that were taken.
_MOST_ORDERS = 60


def training_page(name: str, measured: Measured, lessons: Sequence[Lesson]) -> str:
    """The HTML page about what was learned from a harmonic table."""
    sections = []
    if measured.reasons:
        sections.append(_orders_section(measured))
    if measured.left_out:
        sections.append(PageSection("Left out", details="\n".join(measured.left_out)))
    for lesson in lessons:
        sections += [_models_section(lesson), _faulty_section(lesson), _pictures(lesson)]
    summary = f"{counted(len(measured.table), 'curve')}, orders {', '.join(map(str, measured.table.orders))}."
    return page(f"Trained models: {name}", sections, summary=summary)


def _orders_section(measured: Measured) -> PageSection:
    rows = [
        (
            reason.order,
            reason.chosen,
            f"{reason.above_noise} of {reason.curves}",
            reason.rms_deg,
            reason.noise_deg,
            percent(reason.share) if reason.order else "",
            reason.reason,
        )
        for number, reason in enumerate(measured.reasons)
        if number < _MOST_ORDERS or reason.chosen
    ]
    columns = ("order", "chosen", "above the noise", "RMS, deg", "noise, deg", "share of the TE", "reason")
    text = "From the curves, the strongest first, behind the mean (order 0), which has no part in the shares."
    if len(rows) < len(measured.reasons):
        text += f" Left out: {counted(len(measured.reasons) - len(rows), 'weaker one')}."
    return PageSection("Orders", text, PageTable(columns, rows))


def _models_section(lesson: Lesson) -> PageSection:
    rows: list[tuple[object, ...]] = []
    for solution in lesson.choice.solutions:
        errors = lesson.test_errors[solution.order]
        spread = []
        if lesson.intervals:
            spread = [str(lesson.intervals.get(solution.order, ""))]
        rows.append(
            (
                solution.order,
                solution.name,
                errors.amplitude_mae,
                errors.phase_mae if solution.order else "",
                errors.complex_mae,
                lesson.constant_mae(solution.order),
                *spread,
                f"{lesson.costs_us[solution.order]:.1f}",
            )
        )
    repeated = ("complex, repeated splits (95 %)",) if lesson.intervals else ()
    errors_of = ("amplitude MAE, deg", "phase MAE, rad", "complex MAE, deg", "of a constant", *repeated)
    columns = ("order", "models", *errors_of, "worst case, us")
    are = "is" if lesson.left_out == 1 else "are"
    but = f" but {lesson.left_out} that {are} faulty where all are judged together" if lesson.left_out else ""
    text = (
        f"Chosen by cross-validation on {len(lesson.study.learn)} runs, errors on {len(lesson.study.test)} at "
        f"operating points that were kept apart. The models of the bundle were learned again from the runs of "
        f"both{but}, so that of themselves no error is known. Their worst case: "
        f"{lesson.cost_us:.3g} us (a quick estimate from the models alone; verify counts the text). Of a constant: "
        "what the mean of the runs that it was chosen on leaves at the points kept apart."
    )
    for remark in lesson.remarks():
        text += f"\n\n{remark[0].upper()}{remark[1:]}."
    return PageSection(f"Models, {lesson.direction}", text, PageTable(columns, rows))


def _faulty_section(lesson: Lesson) -> PageSection:
    rows = [
        (*map(float, lesson.train.conditions[row]), lesson.faulty.score[row], ", ".join(map(str, orders)))
        for row in np.flatnonzero(lesson.faulty.rows)
        for orders in (lesson.faulty.orders[row],)
    ]
    columns = ("speed, rpm", "torque, N m", "oil, degC", "score", "orders that are off")
    if lesson.faulty.not_judged and not rows:
        return PageSection(f"Faulty runs, {lesson.direction}", f"{lesson.faulty.not_judged.capitalize()}.")
    title = f"Faulty runs, {lesson.direction}: {len(rows)}"
    return PageSection(title, RULE, PageTable(columns, rows) if rows else None)


def _pictures(lesson: Lesson) -> PageSection:
    """Measured against predicted, cosine and sine part, at the test points."""
    panels: list[tuple[str, Callable[[Any], object]]] = [
        (f"order {solution.order}", partial(_scatter, lesson, solution)) for solution in lesson.choice.solutions
    ]
    return PageSection(f"Measured and predicted, {lesson.direction}", figures=side_by_side(panels))


def _scatter(lesson: Lesson, solution: Solution, axes: Any) -> None:
    truth = lesson.study.test.column(solution.order)
    parts = (("cosine", np.real), ("sine", np.imag)) if solution.order else (("mean", np.real),)
    for colour, (label, part) in zip(COLOURS, parts, strict=False):
        axes.plot(part(truth), part(solution.test), "o", markersize=4, alpha=0.7, color=colour, label=label)
    low, high = axes.get_xlim()
    axes.plot([low, high], [low, high], color="black", linewidth=0.6)
    axes.locator_params(nbins=5)
    axes.ticklabel_format(style="sci", scilimits=(-2, 3))
    axes.set(xlabel="measured, deg", ylabel="predicted, deg")
