"""report.json, the new rig.toml and its diff: what other programs read."""

from __future__ import annotations

import difflib
import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from st_codegen.reconcile.data.chances import digits
from st_codegen.reconcile.judge.claims import Claim, Retuned
from st_codegen.reconcile.report.sentences import form_error, left_text, together_text
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.rig.effects import Effect

if TYPE_CHECKING:
    from st_codegen.reconcile.models.update import Update
    from st_codegen.reconcile.plan.next_runs import NextRuns


def report(result: Reconciliation, update: Update | None = None, ahead: NextRuns | None = None) -> dict[str, Any]:
    """The content of report.json: keys in docs/reconcile.md."""
    claims = result.conclusions.claims
    names = dict.fromkeys(claim.piece.effect.name for claim in claims)
    return {
        "verdict": result.verdict,
        "effects": [_group([claim for claim in claims if claim.piece.effect.name == name], result) for name in names],
        "retuned": [_retuned(entry) for entry in result.conclusions.retuned],
        "unexplained": [
            {
                "order": None if s.order < 0 else s.order,
                "frequency_Hz": s.hertz or None,
                "periods_per_turn": s.periods or None,
                "dependence": {name: round(share, 4) for name, share in s.dependence.items()},
                "direction": s.direction,
                "size": s.rms_deg,
                "at_least": s.at_least,
                "share_of_gap": s.share,
                "amplitude_deg": s.amplitude_deg,
                "formula": None if s.formula is None else {
                    name: [[c.real, c.imag] for c in sides] for name, sides in s.formula.terms.items()
                },
                "text": s.text,
                "would_be": s.would_be or None,
            }
            for s in result.unexplained
        ],
        "unexplained_together": together_text(result) or None,
        "gap": {"fitted": asdict(result.fitted), "held_out": asdict(result.held_out)},
        "noise_floor_at_most": result.floor_is_bound,
        "noise_floor_without_scatter": result.scatter_beside_floor_deg > 0.0,
        "held_out_at_least": result.held_out_is_bound,
        "held_out_scatters": result.held_out_scatters,
        "held_out_because": left_text(result) or None,
        "gap_by_order": [asdict(gap) for gap in result.orders],
        "suspect_runs": [f"{result.data.labels[row]}: {times:.1f} times the usual distance from what is expected"
                         for row, times in result.suspects]
        + [f"{result.data.labels[row]}: {mistake.name}" for mistake in result.mistakes for row in mistake.rows],
        "held_out_curves_unseen": result.unseen_curves,
        "held_out_between_temperatures_deg": result.between_deg,
        "taken_back": None if result.taken_back is None else asdict(result.taken_back),
        "cannot_show": list(result.cannot_show),
        "not_looked_at": list(result.data.not_looked_at),
        "measurement": {
            "mistakes": [{"name": m.name, "text": m.text, "runs": [result.data.labels[row] for row in m.rows]}
                         for m in result.mistakes],
            "in_place_of_changes": [one.text for one in result.conclusions.misread],
        },
        "zero_offset_deg": {
            "rig": result.rig.zero_offset_deg,
            "new": result.new_rig.zero_offset_deg,
            "changed": result.conclusions.offset_changed,
            "alternatives": list(result.conclusions.of_offset),
        },
        "curves": len(result.data),
        "orders": result.data.orders.tolist(),
        "ranking": [
            {"name": c.name, "orders": list(c.piece.effect.orders), "passed": e.passed, **_evidence(e)}
            for c, e in result.judged
        ],
        **({} if ahead is None else {"next_runs": ahead.as_json()}),
        **({} if update is None else {"models": update.as_json()}),
    }  # fmt: skip


def _group(group: list[Claim], result: Reconciliation) -> dict[str, Any]:
    """One entry of `effects`: all of one name; where there are several, behind a key in brackets which one it is of."""
    several = len(group) > 1
    parameters: dict[str, Any] = {}
    marks = [_mark(claim.piece.effect) for claim in group]
    for claim, mark in zip(group, marks, strict=True):
        effect = claim.piece.effect
        # an order may be raised by several resonances
        is_one_of_two = marks.count(mark) > 1 and "frequency_Hz" in effect.values
        hertz = f" at {effect.scalar('frequency_Hz'):.4g} Hz" if is_one_of_two else ""
        suffix = f"[{mark}{hertz}]" if several and mark else ""
        for key, value in parameters_of(effect, claim.stderr).items():
            parameters[key + suffix] = value
    first = group[0]
    return {
        "name": first.piece.effect.name,
        "title": first.piece.effect.title,
        "orders": sorted({order for claim in group for order in claim.piece.effect.orders}),
        "parameters": parameters,
        "evidence": [_evidence(claim.evidence) for claim in group] if several else _evidence(first.evidence),
        "probability": min((claim.probability for claim in group if claim.probability is not None), default=None),
        "alternatives": sorted({name for claim in group for name in claim.alternatives}),
        "share_of_gap": min(1.0, sum(claim.share for claim in group)),
        "remarks": sorted({text for claim in group for text in claim.extrapolates}),
        "form_error": [
            {"orders": error[0], "left_deg": error[1], "size_deg": error[2]}
            for error in (form_error(claim, result) for claim in group)
            if error is not None
        ],
    }


def _mark(effect: Effect) -> str:
    """The first order of an effect, with its state or its angle where it has one."""
    mark = f"{effect.orders[0]}{effect.state_text}" if effect.orders else ""
    if "centre_deg" in effect.values:  # a turn may have several places
        mark = f"{mark} at {effect.scalar('centre_deg'):.1f} deg".strip()
    return mark


def parameters_of(effect: Effect, stderr: dict[str, float]) -> dict[str, Any]:
    """Key -> value, standard error and unit; entries of lists as `key[order]`."""
    units = effect.units()
    found: dict[str, Any] = {}
    for key, value in effect.values.items():
        if key in {"order", "orders"}:
            continue
        entries = zip(effect.orders, value, strict=True) if isinstance(value, tuple) else [(None, value)]
        for order, number in entries:
            name = key if order is None else f"{key}[{order}]"
            if math.isfinite(number):
                found[name] = {"value": number, "stderr": stderr.get(name), "unit": units.get(key, "")}
    return found


def _retuned(entry: Retuned) -> dict[str, Any]:
    before = parameters_of(entry.before, {})
    after = parameters_of(entry.after, entry.stderr)
    return {
        "name": entry.after.name,
        "orders": list(entry.after.orders),
        "is_gone": entry.is_gone,
        "parameters": {key: {"before": _beside(key, before, value), **value} for key, value in after.items()},
        "alternatives": list(entry.alternatives),
        "digits_of_chance": round(digits(entry.p), 1),
    }


def _beside(key: str, before: dict[str, Any], after: dict[str, Any]) -> float | None:
    """The value that a parameter had; a phase within half a turn of the new one."""
    value: float | None = before.get(key, {}).get("value")
    if value is None or after["unit"] != "rad":
        return value
    turns = round((value - float(after["value"])) / (2 * math.pi))
    return value - 2 * math.pi * turns


def _evidence(e: Evidence) -> dict[str, Any]:
    return {
        "loss_saved": e.loss_saved,
        "parameters": e.parameters,
        "p_chance": e.p_chance,
        "p_clusters": e.p_clusters,
        "held_out_loss_saved_per_curve": dict(e.held_out),
        "stability": e.stability,
        "size_in_noise": e.size_in_noise,
    }


def report_text(result: Reconciliation, update: Update | None = None, ahead: NextRuns | None = None) -> str:
    """report.json as text."""
    return json.dumps(report(result, update, ahead), indent=1, allow_nan=False) + "\n"


def rig_diff(result: Reconciliation) -> str:
    """Unified diff from the rig to the new rig."""
    lines = difflib.unified_diff(
        result.rig.text().splitlines(keepends=True), result.new_rig.text().splitlines(keepends=True), "rig.toml", "new"
    )
    return "".join(lines)
