"""The findings on a terminal: a few lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from st_codegen.errors import at_least, at_most, counted
from st_codegen.reconcile.report.findings import findings, share_text
from st_codegen.reconcile.report.sentences import (
    between_text,
    floor_text,
    left_text,
    misread_texts,
    taken_back_text,
    together_text,
    verdict_text,
)
from st_codegen.reconcile.result import Reconciliation

if TYPE_CHECKING:
    from st_codegen.reconcile.models.update import Update
    from st_codegen.reconcile.plan.next_runs import NextRuns
    from st_codegen.reconcile.report.findings import Finding


def summary(result: Reconciliation, next_steps: Sequence[str] = ()) -> str:
    """The findings as a few lines: the verdict and what was found, what to do next, and last what cannot be told."""
    lines = [verdict_text(result)]
    lines += [f"- the measurement: {mistake.text}" for mistake in result.mistakes]
    lines += [f"- {finding_text(finding, first=number == 0)}" for number, finding in enumerate(findings(result))]
    lines += [f"- {text}" for text in misread_texts(result)]
    if common := together_text(result):
        lines.append(f"- {common}")
    # a line that counts one says less than that one
    listed = 8 if len(result.unexplained) > 9 else 9
    lines += [f"- unexplained: {signature.text}" for signature in result.unexplained[:listed]]
    if more := result.unexplained[listed:]:
        orders, together = [one.order for one in more if one.order >= 0], math.hypot(*(one.rms_deg for one in more))
        span = f"from {min(orders)} to {max(orders)}, " if orders else ""
        which = f"{span}together {together:.2g} deg RMS"
        lines.append(f"- and {counted(len(more), 'more unexplained order')} {which}")
    if result.taken_back is not None:
        lines.append(f"- {taken_back_text(result.taken_back)}")
    gap = result.held_out
    floor = f"at most {at_most(gap.noise_floor, 3)} deg" if result.floor_is_bound else f"{gap.noise_floor:.3g} deg"
    floor += " beside what runs differ by without a pattern" if result.scatter_beside_floor_deg else ""
    after = f"{'about ' if result.held_out_scatters else ''}{gap.after:.3g}"
    after = f"at least {at_least(gap.after, 3)}" if result.held_out_is_bound else after
    lines.append(f"Gap on held-out runs: {gap.before:.3g} -> {after} deg RMS, noise floor {floor}")
    lines += filter(None, (left_text(result), between_text(result)))
    if suspects := result.suspects:
        worst = result.data.labels[suspects[0][0]]
        runs = len({int(result.data.number_of_run[row]) for row, _ in suspects})
        also = "; or what is unexplained is strongest in them" if result.unexplained else ""
        lines.append(f"Suspected bad runs: {runs}, the worst {worst}{also}")
    lines += next_steps
    lines += filter(None, (floor_text(result),))
    lines += [f"Cannot be shown: {text}" for text in result.cannot_show]
    lines += [f"Not looked at: {text}" for text in result.data.not_looked_at]
    return "\n".join(lines)


def finding_text(finding: Finding, *, first: bool) -> str:
    """One finding in a line: words, numbers of a changed one, other names, share."""
    is_change = finding.before is not None or finding.effect is None
    changed = f": {', '.join(finding.numbers)}" if is_change and finding.numbers else ""
    others = f" (also possible: {', '.join(finding.others)})" if finding.others else ""
    share = share_text(finding, first=first)
    return f"{finding.text}{changed}{others}" + (f"; {share}" if share else "")


def next_runs_summary(ahead: NextRuns, result: Reconciliation) -> str:
    """What to measure next, in one line."""
    if not ahead.runs:
        return f"Next measurement: none proposed; {ahead.none_because}"
    first, at = ahead.runs[0], ahead.runs[0].point
    text = f"Next measurement: {counted(len(ahead.runs), 'run')} in next_runs.csv, the first at "
    text += f"{at.speed_rpm:g} rpm, {at.torque_Nm:g} N m, "
    text += f"{at.temperature_C:g} degC, which {first.purpose}"
    if {"torque", "misread_torque"} & {mistake.name for mistake in result.mistakes if mistake.is_taken_out}:
        text += "; the torques are corrected ones, not those that the sensor shows"
    return text


def update_summary(update: Update) -> str:
    """What became of the models, as a few lines."""
    entered = [d for d in update.decisions if d.entered]
    lines = []
    if entered:
        new, added = ([str(d.order) for d in entered if d.new is kind] for kind in (True, False))
        parts = [f"new orders {', '.join(new)}"] if new else []
        parts += [f"terms on orders {', '.join(added)}"] if added else []
        lines.append(f"Models: {'; '.join(parts)}; compiled for {update.target} and verified")
    else:
        lines.append("Models: nothing to add")
    for reason in sorted({d.reason for d in update.decisions if not d.entered}):
        orders = [str(d.order) for d in update.decisions if not d.entered and d.reason == reason]
        lines.append(f"- left out: order {', '.join(orders)}: {reason}")
    if update.motion is not None:
        sizes = [
            f"{_COMPENSATOR[case.name]} {case.full.rms:.3g} (maximum {case.full.maximum:.3g})"
            for case in update.motion.cases
        ]
        lines.append(
            f"Error of the output on the profile {update.motion.profile}, deg RMS at full correction: "
            f"{', '.join(sizes)}"
        )
    return "\n".join(lines)


_COMPENSATOR = {"none": "without compensation", "old": "with the old models", "new": "with the new models"}
