"""What `simulate motion` writes: rows of numbers, curves, a page to look at."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.files.csv_tables import csv_text
from st_codegen.files.folders import write_texts
from st_codegen.ir.arrays import FloatArray
from st_codegen.report import PageSection, PageTable, figure, figures, page
from st_codegen.rig.motion import MotionOutcome, MotionPlan, MotionRecord, Rig, or_none

#: Columns of recordings in time (docs/effects.md): s, deg of the fast side, deg of the output, rpm, N m, degC.
RECORDING = "t,theta_ref,theta_mot,theta_in,theta_out,speed_rpm,torque_Nm,temperature_C"
_POINTS = 1500
_MOST_DRAWN = 6
#: What the error after compensation is, as the page says it.
_MEANING = (
    "Error before: theta_out - theta_in / ratio of the motion without compensation, as the encoders show it (Eq. 1). "
    "Error after: theta_out of the compensated motion against the same theta_in / ratio, so the drive's own lag, which "
    "both have, is in neither. 'Full' counts only the time in which the law's weight is 1."
)


@dataclass(frozen=True)
class MotionStudy:
    """The motion of a profile without compensation, and all cases with it, one at least.

    `outside`: where it leaves the ranges of the models.
    """

    rig: Rig
    plan: MotionPlan
    before: MotionRecord
    outcomes: tuple[MotionOutcome, ...]
    outside: str = ""


def row(study: MotionStudy, outcome: MotionOutcome) -> dict[str, Any]:
    """One case as numbers: deg, us, Hz."""
    case, tasks = outcome.case, study.rig.tasks
    highest = max(case.orders)
    timing = tasks.latency(case.form)
    return {
        "profile": study.plan.profile.name,
        "orders": list(case.orders),
        "law": case.law,
        "tasks": str(case.form),
        "lead_us": round(case.lead_s * 1e6, 3),
        "load": str(case.load),
        "ahead": case.ahead,
        "rms_before": outcome.before.rms,
        "rms_after": outcome.after.rms,
        "max_before": outcome.before.maximum,
        "max_after": outcome.after.maximum,
        "rms_reduction": or_none(outcome.reduction[0]),
        "max_reduction": or_none(outcome.reduction[1]),
        "full_rms_before": or_none(outcome.full_before.rms),
        "full_rms_after": or_none(outcome.full_after.rms),
        "full_max_before": or_none(outcome.full_before.maximum),
        "full_max_after": or_none(outcome.full_after.maximum),
        "following_rms_before": outcome.following_before.rms,
        "following_rms_after": outcome.following_after.rms,
        "latency_us": timing.best_us,
        "limit_Hz": timing.frequency_hz,
        "limit_output_rpm": timing.output_speed_rpm(highest) if highest else None,
        "refused": outcome.refused,
        "limited": outcome.limited,
        "outside": study.outside,
    }


def label(study: MotionStudy, outcome: MotionOutcome) -> str:
    """The orders, the law, the tasks and the lead of a case, as a label of a curve that no other case has."""
    case = outcome.case
    alike = {other.case.orders for other in study.outcomes if len(other.case.orders) == len(case.orders)}
    is_counted = len(case.orders) > 4 and len(alike) == 1
    orders = f"{len(case.orders)} orders" if is_counted else "orders " + " ".join(map(str, case.orders))
    lead = f", lead {case.lead_s * 1e6:.0f} us" if case.lead_s else ""
    load = "" if case.load == "none" else f", load {case.load}"
    return f"{orders}, {case.law}, {case.form}{lead}{load}{', ahead' if case.ahead else ''}"


def remarks(study: MotionStudy) -> list[str]:
    """Where the models know nothing of the motion, and where the blocks did not do what a case is called after."""
    said = [f"{label(study, one)}: {text}" for one in study.outcomes for text in (one.refused, one.limited) if text]
    return [study.outside, *said] if study.outside else said


def write(study: MotionStudy, out: Path, *, recording: bool = False) -> None:
    """Write motion.json, motion.csv, curves.csv and report.html to a folder, as `write_texts` does."""
    rows = [row(study, outcome) for outcome in study.outcomes]
    texts = {
        "motion.json": json.dumps(rows, indent=1) + "\n",
        "motion.csv": _csv(rows),
        "curves.csv": _curves(study),
        "report.html": html(study),
    }
    if recording:
        texts["recording.csv"] = recording_text(study.plan, study.before)
    write_texts(out, texts)


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    cells = [[" ".join(map(str, v)) if isinstance(v, list) else v for v in entry.values()] for entry in rows]
    return csv_text([rows[0], *cells])


def _curves(study: MotionStudy) -> str:
    """The errors of all cases over time as CSV, a row a millisecond."""
    plan, moving = study.plan, slice(study.plan.first, None)
    every = max(round(1e-3 / plan.cycle_s), 1)
    columns = [
        plan.time_s[moving],
        plan.angle_deg[moving],
        plan.speed_rpm[moving],
        plan.torque_Nm[moving],
        plan.temperature_C[moving],
    ]
    names = ["t", "theta_out", "speed_rpm", "torque_Nm", "temperature_C", "error_before_deg"]
    before = study.before
    columns.append((before.seen_out_deg - before.seen_in_deg / study.rig.model.reduction_ratio)[moving])
    for number, outcome in enumerate(study.outcomes, 1):
        names.append(f"error_after_{number}_deg")
        columns.append(outcome.error_after_deg)
    table = np.stack(columns, axis=1)[::every]
    return ",".join(names) + "\n" + "\n".join(",".join(f"{value:.9g}" for value in line) for line in table) + "\n"


def recording_text(plan: MotionPlan, recording: MotionRecord) -> str:
    """A motion as `reconcile` reads it: what drive and encoders show, a row a PLC cycle."""
    columns = (
        plan.time_s,
        recording.theta_ref_deg,
        recording.theta_mot_deg,
        recording.seen_in_deg,
        recording.seen_out_deg,
        plan.speed_rpm,
        plan.torque_Nm,
        plan.sensor_C,
    )
    table = np.stack(columns, axis=1)[plan.first :]
    return RECORDING + "\n" + "\n".join(",".join(f"{value:.12g}" for value in line) for line in table) + "\n"


# --- the page ---


def html(study: MotionStudy) -> str:
    """The page: table of cases, curves, profile, timing."""
    profile = study.plan.profile
    most = max(study.outcomes, key=lambda outcome: len(outcome.case.orders))
    sections = [
        PageSection("Before and after", "\n\n".join([_MEANING, *remarks(study)]), _table(study)),
        PageSection("Error of the output", _drawn(study), figures=[_error_picture(study)]),
        PageSection(
            "Prediction",
            f"What the generated code said the error was, over the angle, and what it was in the simulation: of case "
            f"{label(study, most)}.",
            figures=[_prediction_picture(study, most)],
        ),
        PageSection("Profile", table=_facts(study), figures=[_profile_picture(study)]),
        PageSection("Timing", _TIMING, _timing(study)),
    ]
    summary = "A simulation, with the generated text in its loop: no motion was measured on a machine."
    return page(f"Motion {profile.name} with the generated compensator", sections, summary=summary)


_TIMING = (
    "From a latched angle to the set-point at the drive, and the mean age, since a set-point may be repeated "
    "(`st-codegen latency`). The limit is one over the latency, as in the paper (1325.3 us, 754.5 Hz for two tasks); "
    "a wave at that frequency would be corrected a whole period late, and the phase error at a frequency f is 360 "
    "deg * f * latency. A lead takes the angle ahead by the known delays and removes it at constant speed."
)


def _percent(before: float, after: float) -> str:
    return f"{100.0 * (1.0 - after / before):.1f} %" if before > 0.0 else "-"


def _table(study: MotionStudy) -> PageTable:
    columns = (
        "case",
        "RMS before",
        "RMS after",
        "gone",
        "max before",
        "max after",
        "gone",
        "full: RMS gone",
        "full: max gone",
    )
    rows = []
    for o in study.outcomes:
        rows.append(
            (
                label(study, o),
                f"{o.before.rms:.5f} deg",
                f"{o.after.rms:.5f} deg",
                _percent(o.before.rms, o.after.rms),
                f"{o.before.maximum:.5f} deg",
                f"{o.after.maximum:.5f} deg",
                _percent(o.before.maximum, o.after.maximum),
                _percent(o.full_before.rms, o.full_after.rms),
                _percent(o.full_before.maximum, o.full_after.maximum),
            )
        )
    return PageTable(columns, rows)


def _facts(study: MotionStudy) -> PageTable:
    facts = study.plan.profile.facts(study.rig.model.reduction_ratio)
    return PageTable(tuple(facts), [tuple(f"{value:.4g}" for value in facts.values())])


def _timing(study: MotionStudy) -> PageTable:
    tasks = study.rig.tasks
    top = max(order for outcome in study.outcomes for order in outcome.case.orders)
    rows = []
    for form in dict.fromkeys(outcome.case.form for outcome in study.outcomes):
        timing = tasks.latency(form)
        times = (timing.best_us, timing.mean_us)
        speed = f"{timing.output_speed_rpm(top):.1f} rpm" if top else "-"
        rows.append((str(form), *(f"{time:.1f} us" for time in times), f"{timing.frequency_hz:.1f} Hz", speed))
    return PageTable(("tasks", "latency", "mean age", "limit", f"output speed at which order {top} meets it"), rows)


def _thin(count: int) -> slice:
    return slice(None, None, max(count // _POINTS, 1))


def _drawn(study: MotionStudy) -> str:
    """Which cases a picture lacks, whose curves would cover each other."""
    count = len(study.outcomes)
    return f"Of {count} cases the first {_MOST_DRAWN} are drawn." if count > _MOST_DRAWN else ""


def _error_picture(study: MotionStudy) -> str:
    time = study.plan.time_s[study.plan.first :]
    thin = _thin(len(time))

    def draw(axes: Any) -> None:
        before = study.outcomes[0].error_before_deg
        axes.plot(time[thin], before[thin], color="#999999", linewidth=1.0, label="not compensated")
        for outcome in study.outcomes[:_MOST_DRAWN]:
            axes.plot(time[thin], outcome.error_after_deg[thin], linewidth=0.8, label=label(study, outcome))
        axes.legend(fontsize=7, loc="best")

    return figure(draw, xlabel="time in s", ylabel="error of the output in deg", size_cm=(18, 9))


def _prediction_picture(study: MotionStudy, outcome: MotionOutcome) -> str:
    angle = study.plan.angle_deg[study.plan.first :]
    thin = _thin(len(angle))

    def draw(axes: Any) -> None:
        axes.plot(angle[thin], outcome.error_before_deg[thin], linewidth=1.0, label="simulated")
        axes.plot(angle[thin], outcome.predicted_deg[thin], linewidth=0.8, label="predicted")

    return figure(draw, xlabel="angle of the output in deg", ylabel="TE in deg", size_cm=(18, 7))


def _profile_picture(study: MotionStudy) -> str:
    profile = study.plan.profile
    thin = _thin(len(profile.time_s))
    panels = (
        ("angle in deg", profile.angle_deg),
        ("input speed in rpm", profile.speed_deg_s / 6.0 * study.rig.model.reduction_ratio),
        ("load in N m", profile.torque_Nm),
    )

    def drawn(values: FloatArray) -> Any:
        return lambda axes: (axes.plot(profile.time_s[thin], values[thin]), axes.set(xlabel="time in s"))

    return figures([(title, drawn(values)) for title, values in panels], columns=3, size_cm=(6, 5))
