"""The findings on joints on a terminal and as report.html, with a picture of the evidence of each."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from st_codegen.errors import at_most
from st_codegen.reconcile.joint.findings import UNIT_WORDS, digits, friction_curve
from st_codegen.reconcile.joint.parts import KINDS
from st_codegen.reconcile.joint.run import JointResult
from st_codegen.reconcile.joint.waves import ANGLE, TIME, spectrum
from st_codegen.reconcile.outcome import Outcome
from st_codegen.report.html import PageSection, PageTable, page
from st_codegen.report.picture import Draw, panels

_SHOWN_POINTS = 1500

#: the verdicts in words; the noise floor is a bound from above: what lies below it may be noise, and need not be
JOINT_VERDICT_TEXT = {
    Outcome.EXPLAINED: "What stands out beyond a rigid joint is named; the rest is so small that it may be noise.",
    Outcome.PARTLY_EXPLAINED: "Part of what a rigid joint leaves is named; the rest is more than noise.",
    Outcome.NOTHING_MISSING: "Nothing stands out beyond a rigid joint; what is left is so small that it may be noise.",
    Outcome.UNEXPLAINED: "A rigid joint leaves more than noise, and nothing of it has a name.",
}


def joint_summary(content: Mapping[str, Any]) -> str:
    """The findings as lines."""
    lines = []
    for joint in content["joints"]:
        lines.append(f"Joint {joint['joint']}: {JOINT_VERDICT_TEXT[joint['verdict']]}")
        lines += [f"- the measurement: {text}" for text in joint["measurement"]]
        lines += [f"- {_sentence(effect)}" for effect in joint["effects"]]
        lines += [f"- unexplained: {text}" for text in joint["unexplained"]]
        gap = joint["gap"]["held_out"]
        lines.append(
            f"Gap on held-out stretches: rigid joint {digits(gap['before'], 3)} -> {digits(gap['after'], 3)} N m RMS, "
            f"noise floor at most {digits(float(at_most(gap['noise_floor'], 3)), 3)} N m"
        )
        lines += [f"Cannot be shown: {text}" for text in joint["cannot_show"]]
    return "\n".join(lines)


def _sentence(effect: Mapping[str, Any]) -> str:
    remarks = "".join(f"; {text}" for text in effect["remarks"])
    others = effect["alternatives"]
    text: str = effect["text"] + remarks + (f" (or: {'; '.join(others)})" if others else "")
    return text


def joint_texts(results: Sequence[JointResult], content: Mapping[str, Any]) -> dict[str, str]:
    """report.json and report.html. Raises MissingExtraError without Matplotlib."""
    sections = []
    for result, joint in zip(results, content["joints"], strict=True):
        head = f"Joint {joint['joint']}"
        found = [f"{number}. {_sentence(effect)}." for number, effect in enumerate(joint["effects"], 1)]
        values = [
            [effect["name"], key, value["value"], value["stderr"], UNIT_WORDS.get(value["unit"], value["unit"])]
            for effect in joint["effects"]
            for key, value in effect["parameters"].items()
        ]
        columns = ["effect", "parameter", "value", "standard error", "unit"]
        text = "\n\n".join([JOINT_VERDICT_TEXT[joint["verdict"]], *found])
        sections.append(PageSection(f"{head}: findings", text, PageTable(columns, values) if values else None))
        about = (
            "Torque less all other parts: points are samples where the joint moves, lines the fit. Waves: what is left "
            "without them. Response: torque per acceleration where the motion explains the torque."
        )
        sections.append(PageSection(f"{head}: evidence", about, figures=panels(_pictures(result))))
        if joint["unexplained"]:
            sections.append(PageSection(f"{head}: what stays unexplained", "\n\n".join(joint["unexplained"])))
        gap = joint["gap"]["held_out"]
        table = PageTable(
            ["RMS in N m", "rigid joint", "with all parts", "noise floor, at most"], [["", *gap.values()]]
        )
        how = "Each stretch of time was predicted by parameters fitted to the others; which parts there are saw all."
        sections.append(PageSection(f"{head}: the gap on held-out stretches", how, table))
        rows = [["the measurement", text] for text in joint["measurement"]]
        rows += [["cannot be shown", text] for text in joint["cannot_show"]]
        sections.append(PageSection(f"{head}: what these data cannot show", "", PageTable(["", ""], rows)))
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    summary = JOINT_VERDICT_TEXT[content["verdict"]]
    return {"report.json": text, "report.html": page("What is in the torque of the joints", sections, summary=summary)}


def _pictures(result: JointResult) -> list[tuple[str, Draw]]:
    rows, chosen = result.rows, result.chosen
    every = slice(None, None, max(1, len(rows.time) // _SHOWN_POINTS))
    over_speed = {name for name in chosen.names() if name in KINDS and "friction" in name}
    shown: list[tuple[str, Draw]] = []
    friction = result.left + chosen.of(over_speed)

    def speeds(axes: Any) -> None:
        axes.plot(rows.speed[every], friction[every], ".", markersize=2, label="measured, less all other parts")
        speed = np.linspace(float(np.abs(rows.speed).min()), float(np.abs(rows.speed).max()), 200)
        if over_speed:
            curve = friction_curve(result, speed)
            axes.plot(speed, curve, "k-", linewidth=1, label="fit, mean of both directions")
            axes.plot(-speed, -curve, "k-", linewidth=1)
        axes.set(xlabel="speed, rad/s", ylabel="friction, N m")

    shown.append(("friction over speed", speeds))
    for name in sorted({"reversal_travel", "reversal_time"}.intersection(chosen.names())):
        shown.append(("after a reversal", _after_reversal(result, name)))
    for over, label in ((ANGLE, "waves per revolution of the joint"), (TIME, "Hz over time")):
        waves = [wave for wave in result.waves if wave.over == over]
        if waves:
            left = result.left + chosen.of({wave.gain.part.name for wave in waves})
            shown.append(("waves", _spectrum(result, left, over, label, [wave.number for wave in waves])))
    mode = result.mode
    if mode is not None:
        found, fitted = mode.response, mode.fitted

        def magnitude(axes: Any) -> None:
            axes.loglog(found.frequency, np.abs(found.value), ".", markersize=3, label="measured")
            axes.loglog(found.frequency, np.abs(fitted), "k-", linewidth=1, label="fit")
            axes.set(xlabel="frequency, Hz", ylabel="torque per acceleration, kg m^2")

        shown.append(("elasticity", magnitude))
    return shown


def _after_reversal(result: JointResult, name: str) -> Draw:
    rows = result.rows
    x = rows.travel if name == "reversal_travel" else rows.since
    own = result.chosen.own(name)
    near = np.flatnonzero(np.isfinite(x))
    near = near[x[near] < np.quantile(x[near], 0.3)]
    near = near[:: max(1, len(near) // _SHOWN_POINTS)]

    def draw(axes: Any) -> None:
        axes.plot(x[near], (rows.sign * (result.left + own))[near], ".", markersize=2, label="measured")
        place = near[np.argsort(x[near])]
        axes.plot(x[place], (rows.sign * own)[place], "k-", linewidth=1, label="fit")
        label = "travel since the reversal, rad" if name == "reversal_travel" else "time since the reversal, s"
        axes.set(xlabel=label, ylabel="along the motion, N m")

    return draw


def _spectrum(result: JointResult, left: Any, over: str, label: str, numbers: list[float]) -> Draw:
    number, size = spectrum(result.rows, left, over)
    # the loudest of each group: a wave is a few numbers wide
    groups = np.arange(0, len(number), max(1, len(number) // (4 * _SHOWN_POINTS)))

    def draw(axes: Any) -> None:
        axes.plot(
            number[groups], np.maximum.reduceat(size, groups), linewidth=0.6, label="what is left without the waves"
        )
        for place in numbers:
            axes.axvline(place, color="k", linewidth=0.6, linestyle=":")
        axes.set(xlabel=label, ylabel="amplitude, N m")

    return draw
