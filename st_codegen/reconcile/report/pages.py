"""report.html: findings with their evidence, the gap, ranking, curves before and after, the new rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from st_codegen.errors import counted
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.observations import whole_percent
from st_codegen.reconcile.report.evidence import evidence_panels, unexplained_panels
from st_codegen.reconcile.report.findings import Finding, findings, share_text
from st_codegen.reconcile.report.output import parameters_of, report_text, rig_diff
from st_codegen.reconcile.report.ranking import ranking_section
from st_codegen.reconcile.report.sentences import (
    VERDICT_TEXT,
    between_text,
    floor_text,
    left_text,
    misread_texts,
    taken_back_text,
    together_text,
    verdict_text,
)
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.result import OrderGap, Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.reconcile.spectrum import SpectrumResult, sizes, spectrum_report, spectrum_summary
from st_codegen.report.html import PageSection, PageTable, page
from st_codegen.report.picture import Draw, figure, panels

if TYPE_CHECKING:
    from st_codegen.reconcile.models.update import Update
    from st_codegen.reconcile.plan.next_runs import NextRuns

_MOST_BARS = 24
_SAMPLES = 720
#: lines of a diff that are shown without a click
_SHORT = 80


def report_texts(result: Reconciliation, ahead: NextRuns, update: Update | None = None) -> dict[str, str]:
    """The files of a report, by name. Raises MissingExtraError without Matplotlib."""
    return {
        "rig.toml": result.new_rig.text(),
        "rig.diff": rig_diff(result),
        "report.json": report_text(result, update, ahead),
        "report.html": report_page(result, update, ahead),
        "next_runs.csv": ahead.csv_text(),
    }


def report_page(result: Reconciliation, update: Update | None = None, ahead: NextRuns | None = None) -> str:
    """The report as one HTML page. Raises MissingExtraError without Matplotlib."""
    found = findings(result, ahead)
    sections: list[PageSection | None] = [_measurement(result), _findings(result, found)]
    sections += [] if ahead is None else [_next_runs(ahead)]
    sections += [_evidence(result, found), _unexplained(result), _gap(result), _by_order(result), _claims(result)]
    sections += [_curves(result), ranking_section(result), _runs(result), _limits(result), _rig(result)]
    if update is not None:
        sections += [_models(update), _motion(update)]
    return page("What the rig model lacks", [s for s in sections if s is not None], summary=verdict_text(result))


def spectrum_page(result: SpectrumResult) -> str:
    """The report of an order spectrum. Raises MissingExtraError without Matplotlib."""
    rows: list[list[Any]] = [
        [one.order, one.name, one.table, one.key, one.value, ", ".join(one.others), one.chance] for one in result.named
    ]
    columns = ["order", "effect", "of order", "parameter", "value", "or", "expected coincidences"]
    shown = sizes(result)
    lines = spectrum_summary(result).splitlines()
    signatures = [entry["text"] for entry in spectrum_report(result)["unexplained"]]

    def draw(axes: Any) -> None:
        orders = [order for order, _ in shown]
        measured, simulated, floor = np.array([three for _, three in shown]).T
        axes.vlines(orders, floor, measured, color="0.8", linewidth=0.8)
        axes.plot(orders, measured, ".", label="measured, median")
        axes.plot(orders, np.where(simulated > 0, simulated, np.nan), "x", label="rig")
        axes.plot(orders, floor, "k_", label="floor")
        axes.set_yscale("log")

    return page(
        "What the rig model lacks",
        [
            PageSection("Findings", "\n\n".join([lines[0], *lines[-2:]]), PageTable(columns, rows)),
            PageSection("What stays unexplained", "", PageTable(["signature"], [[text] for text in signatures])),
            PageSection("Orders", "", None, [figure(draw, xlabel="order", ylabel="amplitude, deg")]),
        ],
        summary=VERDICT_TEXT[result.verdict],
    )


def _measurement(result: Reconciliation) -> PageSection | None:
    """Mistakes of measuring that were found, corrected or not, and runs that are left out for one."""
    if not result.mistakes:
        return None
    text = "All that follows holds for the data as they are read here."
    return PageSection("The measurement", "\n\n".join([text, *(f"{_begun(one.text)}." for one in result.mistakes)]))


def _findings(result: Reconciliation, found: Sequence[Finding]) -> PageSection:
    """The findings by size, each as a paragraph, which fits any width."""
    parts = []
    for number, finding in enumerate(found, 1):
        share = share_text(finding, first=number == 1)
        parts.append(
            f"{number}. {finding.text}."
            + (f" {_begun(share)}." if share else "")
            + (f" {_begun('; '.join(finding.numbers))}." if finding.numbers else "")
            + (f" {_begun(finding.form)}." if finding.form else "")
            + (f" The name: {finding.name}." if finding.name else "")
            + f" Next: {finding.todo}."
        )
    parts += [f"{_begun(text)}." for text in misread_texts(result)]
    if result.taken_back is not None:
        parts.append(taken_back_text(result.taken_back))
    intro = "By size. The share of each is of the power that the larger ones leave, noise included." if found else ""
    return PageSection("Findings", "\n\n".join([intro, *parts]) if parts else "No effect is claimed.")


def _begun(text: str) -> str:
    """A text as a sentence begins; the key of a parameter stays as it is."""
    return text if "_" in text.partition(" ")[0] else text[0].upper() + text[1:]


def _evidence(result: Reconciliation, found: Sequence[Finding]) -> PageSection | None:
    shown = panels(evidence_panels(result, found))
    text = (
        "The measured part from which each finding is read, less all else that the new rig has: points are medians of "
        "runs, bands hold 80 % of them. Resonances: all orders and both directions brought to the same height."
    )
    return PageSection("Evidence", text, figures=shown) if shown else None


def _gap(result: Reconciliation) -> PageSection:
    rows: list[list[Any]] = []
    for name, gap in (("fitted runs", result.fitted), ("held-out runs", result.held_out)):
        times = gap.after / gap.noise_floor if gap.noise_floor else None
        rows.append([name, gap.before, gap.after, gap.noise_floor, times])
    table = PageTable(["RMS in deg", "before", "after", "noise floor", "after / floor"], rows)
    how = (
        f"Held out: {counted(result.unseen_curves, 'curve')} that neither the search nor the fit has seen."
        if result.unseen_curves
        else "Held out: levels of speed, of torque and of temperature were left out in turn and predicted by "
        "parameters fitted without them, where the others tell these; the condition with the largest gap counts, or "
        "the fitted runs where none is told. Which effects there are was decided with all of them."
    )
    text = "The gap is the RMS difference between model and measurement over the angle and all good runs. " + how
    text += f" {reason}" if (reason := left_text(result)) else ""
    return PageSection("The gap", text, table, [_bars(result)])


def _by_order(result: Reconciliation) -> PageSection:
    shown = _largest(result)
    rows = [
        [gap.order, gap.before, gap.after, gap.held_out, gap.noise_floor, "worse" if _is_worse(gap) else ""]
        for gap in shown
    ]
    worse = [str(gap.order) for gap in result.orders if _is_worse(gap)]
    texts = [f"The new rig is worse than the old one at order {', '.join(worse)}."] if worse else []
    left = len(result.orders) - len(shown)
    texts += [f"The {len(shown)} orders with the largest gap; report.json has the other {left}."] if left else []
    columns = ["order", "before", "after", "after, held out", "noise floor", ""]
    strong = {(row, 5) for row in range(len(rows))}
    return PageSection("The gap by order, RMS in deg", " ".join(texts), PageTable(columns, rows, strong))


def _is_worse(gap: OrderGap) -> bool:
    """Whether the new rig leaves more of an order than the old one, beyond what a gap scatters by."""
    return gap.after > SETTINGS.worse * gap.before


def _largest(result: Reconciliation) -> list[OrderGap]:
    """The orders with the largest gap before, and those that got worse, by order."""
    largest = sorted(result.orders, key=lambda gap: -gap.before)[:_MOST_BARS]
    worse = [gap for gap in result.orders if _is_worse(gap) and gap not in largest]
    return sorted([*largest, *worse], key=lambda gap: gap.order)


def _bars(result: Reconciliation) -> str:
    shown = _largest(result)
    place = np.arange(len(shown))

    def draw(axes: Any) -> None:
        axes.bar(place - 0.27, [gap.before for gap in shown], 0.27, label="before")
        bars = axes.bar(place, [gap.after for gap in shown], 0.27, label="after")
        for gap, bar in zip(shown, bars, strict=True):
            if _is_worse(gap):
                bar.set(hatch="///", edgecolor="black")
        axes.bar(place + 0.27, [gap.held_out for gap in shown], 0.27, label="after, held out")
        axes.plot(place, [gap.noise_floor for gap in shown], "k_", markersize=12, label="noise floor")
        axes.set_yscale("log")
        every = -(-len(shown) // 12)
        axes.set_xticks(place[::every], [str(gap.order) for gap in shown[::every]])
        axes.margins(y=0.3)

    return figure(draw, xlabel="order (hatched: worse)", ylabel="RMS, deg", title="Gap by order")


def _claims(result: Reconciliation) -> PageSection | None:
    claims = result.conclusions.claims
    if not claims:
        return None
    rows = [
        [effect.name, ", ".join(map(str, effect.orders)), key, value["value"], value["stderr"], value["unit"]]
        for effect, errors in ((claim.piece.effect, claim.stderr) for claim in claims)
        for key, value in parameters_of(effect, errors).items()
    ]
    notes = [f"{claim.piece.effect.name}: {text}" for claim in claims for text in claim.extrapolates]
    columns = ["effect", "order", "parameter", "value", "standard error", "unit"]
    return PageSection("What is missing, with parameters", "\n\n".join(notes), PageTable(columns, rows))


def _order_of(one: Signature) -> int | str:
    """What stands in the column of orders."""
    if one.hertz or one.periods:
        return f"{one.hertz:.4g} Hz" if one.hertz else f"{one.periods:.4g} a turn"
    return "several" if one.order < 0 else one.order or "mean"


def _unexplained(result: Reconciliation) -> PageSection | None:
    if not result.unexplained:
        return None
    rows = [[_order_of(s), s.rms_deg, f"{whole_percent(s.share)} %", s.direction, s.text] for s in result.unexplained]
    text = "Parts that stand above the noise and that no effect of the catalogue explains: by their signature."
    text += f" {together}" if (together := together_text(result)) else ""
    shown = panels(unexplained_panels(result))
    text += " Pictures: medians and bands of 80 % of the runs." if shown else ""
    table = PageTable(["order", "RMS, deg", "of the gap", "direction", ""], rows)
    return PageSection("What stays unexplained", text, table, shown)


def _curves(result: Reconciliation) -> PageSection | None:
    """Two measured curves, built from their orders, with the model before and after."""
    data = result.data
    if data.angle_rad is not None:
        return None
    before = np.abs(result.target.residual(result.rig)) ** 2 * result.target.good[:, None]
    theta = np.linspace(0, 360, _SAMPLES)
    waves = np.exp(1j * np.outer(data.orders, np.deg2rad(theta)))
    shown: list[tuple[str, Draw]] = []
    # forward first
    for rows in map(np.flatnonzero, reversed(data.at.by_direction())):
        row = int(rows[np.argmax(before[rows].sum(axis=1))])
        point = data.at.rows(np.array([row]))
        models = [rig.coefficients(point, data.orders.tolist())[0] for rig in (result.rig, result.new_rig)]
        measured, before_, after_ = ((values @ waves).real for values in (data.values[row], *models))
        shown.append((data.labels[row], _lines(theta, [("measured", measured), ("rig", before_), ("new rig", after_)])))
        rest = [("measured - rig", measured - before_), ("measured - new rig", measured - after_)]
        shown.append(("what is left", _lines(theta, rest)))
    text = "The run with the largest gap in each direction; angle of the output in deg, TE in deg."
    return PageSection("Curves", text, figures=panels(shown, size_cm=(12, 7)))


def _lines(x: FloatArray, curves: Sequence[tuple[str, FloatArray]]) -> Draw:
    def draw(axes: Any) -> None:
        for name, y in curves:
            axes.plot(x, y, label=name, linewidth=0.8)

    return draw


def _runs(result: Reconciliation) -> PageSection | None:
    suspects = result.suspects
    if not suspects:
        return None
    rows = [[result.data.labels[row], times] for row, times in suspects]
    text = (
        "Runs that lie far from what model and neighbours let expect. They count neither in the gap nor in what stays "
        "unexplained."
    )
    text += " Or what is unexplained is strongest in them." if result.unexplained else ""
    return PageSection("Suspected bad runs", text, PageTable(["run", "times the usual distance"], rows))


def _next_runs(ahead: NextRuns) -> PageSection:
    """The runs to make next, and what they are expected to give."""
    title = "The next measurement"
    if not ahead.runs:
        return PageSection(title, f"No run is proposed: {ahead.none_because}.")
    first = {run.purpose: number for number, run in reversed(list(enumerate(ahead.runs, 1)))}
    rows = [
        [number, run.point.speed_rpm, run.point.torque_Nm, run.point.temperature_C,
         run.purpose if first[run.purpose] == number else f"as run {first[run.purpose]}"]
        for number, run in enumerate(ahead.runs, 1)
    ]  # fmt: skip
    columns = ["", "speed, rpm", "torque, N m", "oil, degC", "this run"]
    text = (
        "Both directions each, in the order in which they were chosen; next_runs.csv lists them as conditions of a "
        "campaign."
    )
    if ahead.narrowed:
        best = min(ahead.narrowed, key=lambda n: n.then / n.now if n.now else 1.0)
        text += (
            f" If what was found holds, the error of {best.key} of {best.effect} is expected to fall from "
            f"{best.now:.2g} to {best.then:.2g}."
        )
    return PageSection(title, text, PageTable(columns, rows))


def _limits(result: Reconciliation) -> PageSection:
    """What the verdict does not cover."""
    rows = [["cannot be shown", text] for text in result.cannot_show]
    rows += [["not looked at", text] for text in result.data.not_looked_at]
    rows.append(["noise floor", floor_text(result)])
    rows += [["held-out gap", text] for text in (between_text(result),) if text]
    return PageSection("What these data cannot show", "", PageTable(["", ""], rows))


def _rig(result: Reconciliation) -> PageSection:
    changes = rig_diff(result)
    return PageSection(
        "The new rig",
        "" if changes else "The rig stays as it is.",
        details=changes,
        open_details=changes.count("\n") < _SHORT,
    )


def _models(update: Update) -> PageSection:
    """What became of the bundle."""
    rows = [
        [
            d.order,
            ", ".join(d.effects),
            ("new order" if d.new else "term on the learned order") if d.entered else "left out",
            d.before_deg,
            d.after_deg,
            d.reason,
        ]
        for d in update.decisions
    ]
    columns = ["order", "effects", "in the bundle", "RMS before, deg", "after, deg", ""]
    text = "Measured minus what the bundle predicts, over all good runs inside its ranges, before and after. "
    if update.verified is not None:
        exact, blocks = sum(model.exact for model in update.verified.models), len(update.verified.models)
        others = "" if exact == blocks else ", the others within a derived bound"
        text += (
            f"The new bundle was compiled for {update.target}; on the rows that were tried models, reference and text "
            f"agree in each of {counted(blocks, 'block')} ({exact} bit for bit{others})."
        )
    return PageSection("The models for the controller", text, PageTable(columns, rows))


def _motion(update: Update) -> PageSection | None:
    """The rehearsal: errors over time."""
    moved = update.motion
    if moved is None:
        return None
    none = moved.cases[0]
    rows = [
        [
            c.name,
            len(c.orders),
            c.whole.rms,
            c.whole.maximum,
            c.full.rms,
            c.full.maximum,
            1 - c.full.rms / none.full.rms,
        ]
        for c in moved.cases
    ]
    columns = ["compensator", "orders", "RMS, deg", "maximum", "RMS at full weight", "maximum", "share of it gone"]
    table = PageTable(columns, rows)
    every = max(1, len(moved.time_s) // _SAMPLES)

    def draw(axes: Any) -> None:
        for case in moved.cases:
            axes.plot(moved.time_s[::every], case.error_deg[::every], label=case.name, linewidth=0.8)

    text = (
        "Another specimen of the new rig, which no model has seen (sizes differ at random by 2 %, standard deviation), "
        f"moves along the profile {moved.profile}; the generated text runs in its tasks, ahead by the "
        f"{moved.lead_s * 1e6:.0f} us that are known to pass from encoder to motor. Full weight: without the times "
        "near standstill, in which the compensator fades its correction."
    )
    picture = figure(draw, xlabel="time, s", ylabel="error of the output, deg")
    return PageSection("Rehearsal with the old and the new compensator", text, table, [picture])
