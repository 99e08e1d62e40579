"""What was found, by size: each with its share of what the larger ones leave, its errors, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from st_codegen.reconcile.data.observations import rms_deg, whole_percent
from st_codegen.reconcile.judge.claims import SOMETHING_ELSE, Claim, Retuned
from st_codegen.reconcile.report.output import parameters_of
from st_codegen.reconcile.report.sentences import error_digits, form_text, plain, words
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Stage
from st_codegen.rig.model import RigModel

if TYPE_CHECKING:
    from st_codegen.reconcile.plan.next_runs import NextRuns

#: what is said of an effect of the rig of which the data show nothing
_GONE = ": the rig has it, and the data show nothing of it"
#: of one whose numbers are others, and of one whose only number what else is there may have moved
_REFUSED = ": the data refuse what the rig says of it"
_UNSURE = ": with another number less is left, but the rig's own lies within twice its error"
_Change = Callable[[RigModel], RigModel]
#: parameters that are shown of one finding
_MOST_NUMBERS = 4


@dataclass(frozen=True)
class Finding:
    """One finding: words, its effect now and (for a changed one) before, numbers with errors, and how sure its name is.

    form: in how far its form is not quite that of what was measured, where something of it stays.
    share: of the power that the larger findings leave, noise included; None where the data are over time.
    whose: the part of a recorded axis of whose gap the share is; empty where that is the whole gap.
    """

    text: str
    effect: Effect | None
    before: Effect | None
    numbers: tuple[str, ...]
    others: tuple[str, ...]
    name: str
    todo: str
    share: float | None
    own_gap: tuple[float, float] | None
    form: str = ""
    whose: str = ""


def findings(result: Reconciliation, ahead: NextRuns | None = None) -> list[Finding]:
    """All findings, the largest first."""
    found = result.conclusions
    entries: list[tuple[Finding, _Change]] = []
    for claim in found.claims:
        effect = claim.piece.effect
        finding = Finding(
            words(claim, result),
            effect,
            None,
            _numbers(effect, claim.stderr),
            claim.alternatives,
            _how_sure(claim),
            _todo(effect, ahead),
            claim.share if effect.stage is Stage.AXIS else None,
            _own_gap(result, effect),
            form_text(claim, result),
        )
        entries.append((finding, _added(effect)))
    for entry in found.retuned:
        finding = Finding(
            plain(entry.after, result) + (_GONE if entry.is_gone else _REFUSED if _is_clear(entry) else _UNSURE),
            entry.after,
            entry.before,
            () if entry.is_gone else _numbers(entry.after, entry.stderr, entry.before),
            entry.alternatives,
            _how_sure_of_change(entry),
            "see whether the rig model is that of this machine" if entry.is_gone else _todo(entry.after, ahead),
            None,
            _own_gap(result, entry.after),
        )
        entries.append((finding, _replaced(entry.before, entry.after)))
    if found.offset_changed:
        old, new = result.rig.zero_offset_deg, result.new_rig.zero_offset_deg
        finding = Finding(
            "the mean is off by a constant, as when the encoders' common zero moves", None, None,
            (f"zero_offset_deg {old:.4g} -> {new:.4g} deg",), found.of_offset, _in_place(found.of_offset),
            "set the zero anew, or take the new offset", None, None,
        )  # fmt: skip
        entries.append((finding, _moved(new)))
    return _by_size(result, entries)


def _added(effect: Effect) -> _Change:
    return lambda rig: rig.with_effects([*rig.effects, effect])


def _replaced(before: Effect, after: Effect) -> _Change:
    return lambda rig: rig.with_effects(after if effect is before else effect for effect in rig.effects)


def _moved(offset_deg: float) -> _Change:
    return lambda rig: replace(rig, zero_offset_deg=offset_deg)


def _by_size(result: Reconciliation, entries: Sequence[tuple[Finding, _Change]]) -> list[Finding]:
    """Findings by the power that each takes off alone; the share of each is of what those before it leave."""
    whole = _power(result, result.rig)
    alone = []
    for finding, change in entries:
        of_axis = finding.effect is not None and finding.effect.stage is Stage.AXIS
        size = (finding.share or 0.0) * whole if of_axis else whole - _power(result, change(result.rig))
        alone.append(size)
    # the gap of a recorded axis is that of its links as well
    has_links = result.data.angle_rad is not None and result.fitted.before**2 > whole * (1.0 + 1e-9)
    found, rig, left = [], result.rig, whole
    for i in np.argsort(-np.array(alone), kind="stable"):
        finding, change = entries[i]
        rig = change(rig)
        after = _power(result, rig)
        if finding.effect is None or finding.effect.stage is not Stage.AXIS:
            share = max(0.0, 1.0 - after / left) if left > 0 else None
            finding = replace(finding, share=share, whose="the reducer" if has_links else "")
        else:
            finding = replace(finding, whose="its link")
        found.append(finding)
        left = after
    return found


def _power(result: Reconciliation, rig: RigModel) -> float:
    """Power (deg^2) of what a rig leaves of the good runs."""
    return rms_deg(result.target.residual(rig)[result.target.good], result.data.orders) ** 2


def _own_gap(result: Reconciliation, effect: Effect) -> tuple[float, float] | None:
    """RMS of what the old and the new rig leave at the orders of an effect; None over time."""
    orders, good = result.data.orders, result.target.good
    own = np.isin(orders, effect.touched_orders())
    if result.data.angle_rad is not None or not own.any():
        return None
    before, after = (
        rms_deg(residual[good][:, own], orders[own])
        for residual in (result.target.residual(result.rig), result.conclusions.final.residual)
    )
    return before, after


def share_text(finding: Finding, *, first: bool) -> str:
    """The share of a finding in words, with the gap of its own orders where that says more; empty without either."""
    own = finding.own_gap
    if finding.share is not None and (finding.share >= SETTINGS.much or own is None):
        gap = f"the gap of {finding.whose}" if finding.whose else "the gap"
        of = gap if first or finding.whose == "its link" else "what the larger findings leave"
        of += f" of {gap}" if finding.whose and of != gap else ""
        return f"it explains {whole_percent(finding.share)} % of {of}"
    if own is None:
        return ""
    before, after = (f"{gap:.2g}" for gap in own)
    moves = (
        "stays at" if before == after else f"falls from {before} to" if own[1] < own[0] else f"rises from {before} to"
    )
    return f"the gap of its orders {moves} {after} deg"


def _numbers(effect: Effect, stderr: Mapping[str, float], before: Effect | None = None) -> tuple[str, ...]:
    """The parameters that matter, with standard errors; of a changed effect those that changed, old and new.

    First those that changed clearly, the surest before the others: the new rig has these as well, and what it explains
    it explains with them.
    """
    old = {} if before is None else parameters_of(before, {})
    listed, sure, beside, turned = list[str](), list[float](), list[str](), 0.0
    for key, now in parameters_of(effect, dict(stderr)).items():
        if "phase" in key:
            turn = now["value"] - old.get(key, now)["value"]
            turned = max(turned, abs(math.remainder(turn, 2 * math.pi)) / max(now["stderr"] or 0.0, 1e-300))
            continue
        value, error, unit = now["value"], now["stderr"], now["unit"]
        text = f"{value:.4g}" + ("" if error is None else f" +- {error_digits(error)}") + (f" {unit}" if unit else "")
        was = old.get(key, {}).get("value")
        if before is not None and was is not None:
            if f"{value:.4g}" == f"{was:.4g}":
                continue
            text = f"{was:.4g} -> {text}"
            if error is not None and abs(value - was) < SETTINGS.clearly * error:
                beside.append(f"{key} {text}")
                continue
        listed.append(f"{key} {text}")
        sure.append(abs(value - (was or 0.0)) / error if error else 0.0)
    if turned > SETTINGS.clearly:
        listed.append("its phases turned")
        sure.append(turned)
    if before is not None:
        listed = [listed[i] for i in np.argsort(-np.array(sure), kind="stable")]
    if before is not None and not listed and len(beside) == 1:
        return tuple(beside)
    if before is not None and not listed:
        listed = ["its numbers jointly, none clearly alone"]
    if beside:
        listed += [f"with it {beside[0]}", *beside[1:]]
    shown = listed[:_MOST_NUMBERS]
    return (*shown, *([f"and {len(listed) - len(shown)} more"] if len(listed) > len(shown) else []))


def _is_clear(entry: Retuned) -> bool:
    """Whether a change is more than the error of its number, where it has one; several may be told together alone."""
    old, now = parameters_of(entry.before, {}), parameters_of(entry.after, dict(entry.stderr))
    moved = [key for key in now if key not in old or now[key]["value"] != old[key]["value"]]
    if len(moved) != 1 or moved[0] not in old:
        return True
    error = now[moved[0]]["stderr"]
    return error is None or abs(now[moved[0]]["value"] - old[moved[0]]["value"]) >= SETTINGS.clearly * error


def _how_sure(claim: Claim) -> str:
    """What is known of other names for the same data."""
    if claim.piece.effect.stage is Stage.AXIS:
        is_open = SOMETHING_ELSE in claim.alternatives
        doubt = "something else may look the same" if is_open else "nothing else that was tried does as well"
        return f"read from its own link of the axis, where {doubt}"
    others = [name for name in claim.alternatives if name != SOMETHING_ELSE]
    parts = [f"{', '.join(others)} would do as well"] if others else []
    if SOMETHING_ELSE in claim.alternatives:
        parts.append(f"{claim.doubt or f'named by {_told_by(claim)}'}: something else may look the same")
    parts = parts or ["no other effect that was tried does as well"]
    if claim.counted is not None:
        true, of = claim.counted
        parts.append(f"{true} of {of} such names were true on simulated machines of other physics than the catalogue's")
    return "; ".join(parts)


def _told_by(claim: Claim) -> str:
    """What little tells the name of a claim that something else may have."""
    if claim.piece.effect.orders:
        return "its order alone"
    if claim.counted == SETTINGS.names_by_order:
        return "few runs"
    return _TELLS_LITTLE.get(claim.piece.effect.name, "these runs")


#: what tells the name of an effect that has a look-alike
_TELLS_LITTLE = {
    "torsional_compliance": "runs whose load keeps its sign",
    "thermal_drift": "runs listed by temperature",
}


def _in_place(others: Sequence[str]) -> str:
    """What is said of what would do in place of a change."""
    return f"{', '.join(others)} in place of the change would do as well" if others else ""


def _how_sure_of_change(entry: Retuned) -> str:
    """What else may have changed."""
    parts = ["it is in the rig already"]
    if others := _in_place([name for name in entry.alternatives if name != SOMETHING_ELSE]):
        parts.append(others)
    if entry.is_open:
        parts.append("something else may have moved its numbers")
    return "; ".join(parts)


#: what a maintenance engineer looks at first
_NEXT = {
    "torsional_compliance": "check the bolts of flange and coupling, and the scale of the torque sensor",
    "backlash": "measure the play with the motor held",
    "friction_windup": "check oil, seals and bearings",
    "thermal_drift": "measure at a second oil temperature once it has settled",
    "structural_resonance": "tap the structure and look for this frequency; check its mounts; avoid these speeds",
    "measurement_delay": "check time stamps and filters of both encoders",
    "carrier_modulation": "check the bearings of the carrier",
    "load_dependent_mesh": "measure again at other loads; compare with another unit",
    "wear": "look at the sector; measure again after some weeks",
    "local_defect": "look at pins, teeth and bearings at this angle, and at the encoder's disc",
    "local_mesh_defect": "look at the teeth and pins that meet at this angle",
    "control_lag": "check gains and feedforward of the drive",
    "coupling_compliance": "check the coupling and its clamping",
    "cycloid_tooth_error": "compare with another unit of the same kind",
    "pin_error": "compare with another unit of the same kind",
    "crank_misalignment": "check the seats of the cranks",
    "input_shaft_misalignment": "align the input shaft",
    "output_shaft_eccentricity": "check the centring of shaft and encoder",
    "output_shaft_ovality": "check the seat of shaft and encoder",
}


def _todo(effect: Effect, ahead: NextRuns | None) -> str:
    """What to do next about an effect: a look at the machine, and the proposed runs that are for it."""
    parts = [effect.experiment or _NEXT.get(effect.name, "look at the picture of its evidence")]
    where = f"(order {', '.join(map(str, effect.orders))})" if effect.orders else ""
    runs = [] if ahead is None else [
        str(number)
        for number, run in enumerate(ahead.runs, 1)
        if f" {effect.name}" in run.purpose and (where in run.purpose or "narrows" not in run.purpose)
    ]  # fmt: skip
    if runs:
        parts.append(f"make run{'s' if len(runs) > 1 else ''} {', '.join(runs)} of next_runs.csv")
    return "; ".join(parts)
