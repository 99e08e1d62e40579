"""Every effect that was tried, and what became of it, in words."""

from __future__ import annotations

from st_codegen.reconcile.data.observations import whole_percent
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.report.html import PageSection, PageTable


def ranking_section(result: Reconciliation) -> PageSection | None:
    """What was tried: first what is claimed, then the others by what they would have explained."""
    if not result.judged:
        return None
    ranked = sorted(
        ((candidate, evidence, outcome(result, candidate, evidence)) for candidate, evidence in result.judged),
        key=lambda entry: (not entry[2].startswith("claimed"), -entry[1].loss_saved),
    )
    rows = [
        [
            candidate.name,
            ", ".join(map(str, candidate.piece.effect.orders)),
            became,
            f"{evidence.size_in_noise:.2g} times",
            f"{whole_percent(evidence.stability)} %",
            _left_out(evidence),
        ]
        for candidate, evidence, became in ranked
    ]
    columns = ["effect", "order", "what became of it", "size over noise", "kept when resampled", "left-out runs"]
    text = "docs/reconcile_rules.md says which tests there are. An effect may have been tried several times."
    return PageSection("What was tried", text, PageTable(columns, rows))


def outcome(result: Reconciliation, candidate: Candidate, evidence: Evidence) -> str:
    """What became of a candidate: claimed, part of a changed effect of the rig, not claimed, or refused and why."""
    if not evidence.passed:
        return f"refused: {', '.join(evidence.failed)}"
    effect = candidate.piece.effect
    own = set(effect.orders)
    for kind, effects in (
        ("claimed", [claim.piece.effect for claim in result.conclusions.claims]),
        ("part of a changed effect of the rig", [entry.after for entry in result.conclusions.retuned]),
    ):
        if any(other.name == effect.name and (not own or own & set(other.orders)) for other in effects):
            return kind
    if result.taken_back is not None and effect.name in result.taken_back.names:
        return "taken back: with it the rig predicted left-out runs worse"
    return (
        "not claimed: no longer needed beside the others, seen at one frequency only, at the expense of other orders, "
        "or its orders kept too much"
    )


def _left_out(evidence: Evidence) -> str:
    """Along which axes left-out runs are predicted better."""
    better = [axis for axis, saved in evidence.held_out.items() if saved > 0]
    worse = [axis for axis, saved in evidence.held_out.items() if saved <= 0]
    parts = [f"better by {', '.join(better)}"] if better else []
    return "; ".join([*parts, *([f"not by {', '.join(worse)}"] if worse else [])])
