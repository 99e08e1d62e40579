"""Tables 2 to 6 of the paper, ours beside theirs: errors.csv, Markdown and an HTML page with pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.files.csv_tables import csv_text
from st_codegen.files.folders import write_texts
from st_codegen.ir.arrays import FloatArray
from st_codegen.report import COLOURS, PageSection, PageTable, figures, page
from st_codegen.training.families import FAMILIES, Learner
from st_codegen.training.faulty import RULE
from st_codegen.training.paper import CHOSEN, QUANTITIES, ErrorRow, PaperComparison

COLUMNS = ("order", "quantity", "family", "ours_mae", "ours_rmse", "paper_mae", "paper_rmse")
_UNITS = {"ampl": "deg", "phase": "rad", "complex": "deg"}
#: number and title in the paper -> quantity and error
_PAPER_TABLES = (
    ("Table 2: MAE of the amplitudes, deg", "ampl", "mae"),
    ("Table 3: RMSE of the amplitudes, deg", "ampl", "rmse"),
    ("Table 4: MAE of the phases, rad", "phase", "mae"),
    ("Table 5: RMSE of the phases, rad", "phase", "rmse"),
)


def errors_csv(rows: Sequence[ErrorRow]) -> str:
    """The lines of errors.csv; a number that is not known is empty."""
    made = []
    for row in rows:
        numbers = [row.ours_mae, row.ours_rmse, row.paper_mae, row.paper_rmse]
        made.append([row.order, row.quantity, row.family, *("" if math.isnan(n) else f"{n:.6g}" for n in numbers)])
    return csv_text([COLUMNS, *made])


def write_tables(comparison: PaperComparison, folder: Path) -> list[Path]:
    """Write errors.csv, authors.csv, tables.md and tables.html; returns their paths."""
    sections = report_sections(comparison)
    texts = {
        "errors.csv": errors_csv(comparison.rows),
        "authors.csv": errors_csv(comparison.authors),
        "tables.md": _markdown(sections),
        "tables.html": page("The paper's tables, ours beside theirs", sections, summary=_summary(comparison)),
    }
    write_texts(folder, texts)
    return [folder / name for name in texts]


def _summary(comparison: PaperComparison) -> str:
    cells = [(k, q) for k in comparison.test.orders for q in ("ampl", "phase") if k or q == "ampl"]
    ahead = sum(comparison.best(k, q).ours_mae <= comparison.paper.best(q, k)[1] for k, q in cells)
    chosen = sum(_chosen_ahead(comparison, k, q) for k, q in cells)
    return (
        f"{comparison.train_rows} operating points to learn from, {len(comparison.test)} to test on: the authors' own. "
        f"MAE at or ahead of the authors' best family in {ahead} of {len(cells)} cells when the best family is chosen "
        f"on the test points, as they did; in {chosen} when it is chosen by cross-validation alone."
    )


def _chosen_ahead(comparison: PaperComparison, order: int, quantity: str) -> bool:
    row = comparison.cell(order, quantity, CHOSEN)
    return row is not None and row.ours_mae <= row.paper_mae


def report_sections(comparison: PaperComparison) -> list[PageSection]:
    """The sections of the page, in the order of the paper's tables."""
    sections = [_best_section(comparison)]
    sections += [_paper_table(comparison, *table) for table in _PAPER_TABLES]
    sections += [
        _table_6(comparison),
        _complex_section(comparison),
        _reconstruction_section(comparison),
        _faulty_section(comparison),
        _gain_section(comparison),
        _authors_section(comparison),
    ]
    sections += [_picture_section(comparison, order) for order in comparison.test.orders]
    return sections


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _best_section(comparison: PaperComparison) -> PageSection:
    rows: list[list[Any]] = []
    strong: set[tuple[int, int]] = set()
    for order in comparison.test.orders:
        for quantity in ("ampl", "phase") if order else ("ampl",):
            best, (family, mae) = comparison.best(order, quantity), comparison.paper.best(quantity, order)
            chosen = comparison.cell(order, quantity, CHOSEN)
            by_validation = chosen.ours_mae if chosen else math.nan
            if best.ours_mae <= mae:
                strong.add((len(rows), 4))
            if by_validation <= mae:
                strong.add((len(rows), 6))
            ours = [best.family, _number(best.ours_mae), f"{mae / best.ours_mae:.2f}"]
            validated = [_number(by_validation), f"{mae / by_validation:.2f}"]
            rows.append([order, f"{quantity}, {_UNITS[quantity]}", f"{family} {_number(mae)}", *ours, *validated])
    columns = ("order", "quantity", "authors' best MAE", "our best", "MAE", "factor", "by cross-validation", "factor")
    text = (
        "MAE at the authors' test points. Both bests are chosen on these points, as the paper did; the last two "
        "columns are what cross-validation on the training points alone would choose, which is what a user gets. "
        "Bold: at or ahead of the authors' best. Phases are compared around the circle."
    )
    return PageSection("Best against best", text, PageTable(columns, rows, strong))


def _paper_table(comparison: PaperComparison, title: str, quantity: str, error: str) -> PageSection:
    orders = [order for order in comparison.test.orders if order or quantity == "ampl"]
    rows: list[list[Any]] = []
    strong: set[tuple[int, int]] = set()
    for family in FAMILIES:
        cells: list[Any] = [family]
        for order in orders:
            row = comparison.cell(order, quantity, family)
            if row is None:
                cells.append("")
                continue
            ours, paper = getattr(row, f"ours_{error}"), getattr(row, f"paper_{error}")
            cells.append(f"{_number(ours)} ({_number(paper) or 'not given'})")
            if ours <= paper:
                strong.add((len(rows), len(cells) - 1))
        if len(set(cells)) > 2:
            rows.append(cells)
    return PageSection(title, "Ours (the authors').", PageTable(("family", *map(str, orders)), rows, strong))


def _described(candidates: Sequence[Learner]) -> str:
    parts = []
    for candidate in dict.fromkeys(candidate.key for candidate in candidates):
        own = next(c for c in candidates if c.key == candidate)
        parts.append(f"{own.family}({', '.join(f'{key}={value}' for key, value in own.params.items())})")
    return "; ".join(parts)


def _table_6(comparison: PaperComparison) -> PageSection:
    rows = []
    for solution in comparison.choice.solutions:
        order = solution.order
        theirs = [comparison.paper.best(q, order)[0] for q in (("ampl", "phase") if order else ("ampl",))]
        rows.append(
            [order, ", ".join(theirs), solution.name, _described(solution.candidates), f"{solution.cost_us:.0f}"]
        )
    columns = ("order", "authors' best (amplitude, phase)", "chosen here", "parameters", "worst case, us")
    text = "For each order the pair of models with the least complex error by cross-validation, as train chooses them."
    return PageSection("Table 6: the chosen models", text, PageTable(columns, rows))


def _complex_section(comparison: PaperComparison) -> PageSection:
    rows: list[list[Any]] = []
    strong: set[tuple[int, int]] = set()
    for solution in comparison.choice.solutions:
        order = solution.order
        ours, theirs = comparison.chosen_errors[order].complex_mae, comparison.paper_complex[order].complex_mae
        best = comparison.best(order, "complex").ours_mae
        repeated = str(comparison.intervals.get(order, ""))
        if ours <= theirs:
            strong.add((len(rows), 2))
        worst = f"{_worst_tenth(np.abs(solution.test - comparison.test.column(order))):.0%}"
        rows.append([order, _number(theirs), _number(ours), f"{theirs / ours:.2f}", _number(best), repeated, worst])
    columns = (
        "order",
        "authors' HGBM",
        "chosen",
        "factor",
        "our best family",
        "chosen, repeated splits (95 %)",
        "of the error in the worst tenth of the points",
    )
    text = (
        "Mean absolute complex error abs(A*exp(i*phi) - A'*exp(i*phi')) in deg: what compensation leaves of an order."
    )
    return PageSection("Complex error", text, PageTable(columns, rows, strong))


def _worst_tenth(error: FloatArray) -> float:
    """Part of the sum of errors (n,) that the largest tenth of them makes."""
    count = max(1, len(error) // 10)
    return float(np.sort(error)[-count:].sum() / (error.sum() or 1.0))


def _reconstruction_section(comparison: PaperComparison) -> PageSection:
    rows = [
        [name, f"{deg:.3g}", f"{median:.2f}", f"{high:.2f}"]
        for name, (deg, median, high) in comparison.reconstruction.items()
    ]
    columns = ("prediction", "median RMS error, deg", "median, % of RMS TE", "95th percentile, %")
    text = (
        "TE curves put together again at the test points, against the curves of all measured orders of the table. The "
        "paper gives mean percentage errors of 2.6, 3.1 and 4.7 % for orders 0, 1, 39 and 40 on three further runs."
    )
    return PageSection("Reconstructed TE", text, PageTable(columns, rows))


def _faulty_section(comparison: PaperComparison) -> PageSection:
    found = np.flatnonzero(comparison.faulty.rows)
    runs = [
        [
            *(f"{value:g}" for value in comparison.train.conditions[row]),
            f"{comparison.faulty.score[row]:.1f}",
            ", ".join(map(str, comparison.faulty.orders[row])),
        ]
        for row in found
    ]
    columns = ("speed, rpm", "torque, N m", "oil, degC", "score", "orders that are off")
    return PageSection(f"Faulty runs left out: {len(found)}", RULE, PageTable(columns, runs))


def _gain_section(comparison: PaperComparison) -> PageSection:
    rows: list[list[Any]] = []
    strong: set[tuple[int, int]] = set()
    for order, gain in comparison.gains.items():
        at_test = comparison.with_faulty[order].complex_mae, comparison.chosen_errors[order].complex_mae
        pairs = ((gain.near_with, gain.near_without), (gain.sound_with, gain.sound_without), at_test)
        strong |= {(len(rows), 2 * pair + 2) for pair, (with_them, without) in enumerate(pairs) if without < with_them}
        rows.append([order, *(_number(value) for pair in pairs for value in pair)])
    columns = ("order", "near, with them", "without", "sound, with them", "without", "test, with them", "without")
    text = (
        "Complex MAE of the chosen models, deg, learned with the faulty runs and without. Near: sound training rows "
        "within one step of speed, torque and temperature of a faulty run, by cross-validation; sound: all sound "
        "training rows; test: all of the authors' test points, which hold irregular runs of their own. Bold: better."
    )
    return PageSection("What leaving them out gains", text, PageTable(columns, rows, strong))


def _authors_section(comparison: PaperComparison) -> PageSection:
    ratios: dict[tuple[str, str], list[float]] = {}
    for row in comparison.authors:
        if not math.isnan(row.paper_mae):
            ratios.setdefault((row.family, row.quantity), []).append(row.ours_mae / row.paper_mae)
    rows = [
        [family, quantity, f"{np.median(values):.2f}", f"{min(values):.2f}", f"{max(values):.2f}"]
        for (family, quantity), values in sorted(ratios.items())
    ]
    columns = ("family", "quantity", "median", "least", "largest")
    text = (
        "The authors' parameters fitted here as they did (bare targets, bare phases, every run): MAE over their MAE, "
        "by order. Near 1 means that their table is reproduced; all numbers are in authors.csv."
    )
    return PageSection("Their models again", text, PageTable(columns, rows))


def _picture_section(comparison: PaperComparison, order: int) -> PageSection:
    quantities = [quantity for quantity in QUANTITIES if order or quantity == "ampl"]
    panels: list[tuple[str, Callable[[Any], object]]] = [
        (f"order {order}, {quantity}", partial(_bars, comparison, order, quantity)) for quantity in quantities
    ]
    return PageSection(f"Order {order}", figures=(figures(panels, columns=len(panels), size_cm=(9, 6)),))


def _bars(comparison: PaperComparison, order: int, quantity: str, axes: Any) -> None:
    """MAE of every family, ours and the authors'."""
    rows = [row for family in FAMILIES if (row := comparison.cell(order, quantity, family))]
    position = np.arange(len(rows))
    axes.bar(position - 0.2, [row.ours_mae for row in rows], 0.4, label="ours", color=COLOURS[0])
    axes.bar(position + 0.2, [row.paper_mae for row in rows], 0.4, label="authors", color=COLOURS[1])
    axes.set_yscale("log")
    axes.set_xticks(position, [row.family for row in rows], rotation=60)
    axes.set_ylabel(f"MAE, {_UNITS[quantity]}")


def _markdown(sections: Sequence[PageSection]) -> str:
    parts = ["# The paper's tables, ours beside theirs\n"]
    for section in sections:
        if section.table is None:
            continue
        parts.append(f"## {section.title}\n\n{section.text}\n\n{section.table.markdown()}")
    return "\n".join(parts)
