"""What one campaign says of each parameter of each effect: value and standard error, comparable from axis to axis."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from st_codegen.reconcile.judge.errors import shares_of_prior, standard_errors
from st_codegen.reconcile.report.output import parameters_of
from st_codegen.reconcile.result import Reconciliation
from st_codegen.rig.effects import Effect, Form, Stage

#: From this share on a value is more what was known before than what was measured.
_MOST_OF_RIG = 0.5


@dataclass(frozen=True)
class Estimate:
    """A parameter of an effect, as a campaign has it with all parameters free.

    effect: name and order; stderr: None where nothing is known of it, or where the value is more the rig file's than
    the campaign's, as of an order that was not measured; grows: 1 where the effect grows with the size of
    the value, -1 where it shrinks (a stiffness), 0 where the parameter says nothing of a size (a frequency, a phase);
    is_phase: an angle that depends on how the axis was mounted; added: the rig has no such effect.
    """

    effect: str
    key: str
    value: float
    stderr: float | None
    unit: str
    grows: int
    is_phase: bool
    added: bool


class _Fitted(NamedTuple):
    effect: Effect
    stderr: dict[str, float]
    added: bool
    shares: dict[str, float]


def estimates(result: Reconciliation) -> list[Estimate]:
    """The parameters of all effects of the rig, changed or not, and of those that were found."""
    found, numbers = [], dict[str, int]()
    for fitted in _fitted(result):
        effect = fitted.effect
        name = effect.name + effect.state_text
        if effect.orders_key == "order":
            name += f" of order {effect.orders[0]}"
        numbers[name] = numbers.get(name, 0) + 1
        label = name if numbers[name] == 1 else f"{name}, no. {numbers[name]}"
        forms = {scalar.key: scalar.form for scalar in effect.scalars}
        phases = {phasor.keys(backward)[1] for phasor in effect.phasors for backward in (False, True)}
        for key, entry in parameters_of(effect, fitted.stderr).items():
            own = key.partition("[")[0]
            form = forms.get(own, Form.SHAPE if own in phases else Form.LINEAR)
            if form is Form.FIXED:
                continue
            grows = {Form.LINEAR: 1, Form.INVERSE: -1}.get(form, 0)
            stderr = float(math.inf if entry["stderr"] is None else entry["stderr"])
            is_measured = fitted.shares.get(key, 0.0) < _MOST_OF_RIG
            known = stderr if is_measured and 0.0 < stderr < math.inf else None  # of 0 nothing is measured
            is_phase = own in phases
            found.append(Estimate(label, key, entry["value"], known, entry["unit"], grows, is_phase, fitted.added))
    return found


def _fitted(result: Reconciliation) -> Iterator[_Fitted]:
    """Effects with the values of the fit in which all are free; links of the axis from recordings, from their own."""
    joint, claims = result.conclusions.joint, result.conclusions.claims
    for number, piece in enumerate(joint.state.pieces):
        if not piece.added or result.taken_back is None:
            yield _Fitted(piece.effect, standard_errors(joint, number), piece.added, shares_of_prior(joint, number))
    for claim in claims:
        if claim.piece.effect.stage is Stage.AXIS:
            yield _Fitted(claim.piece.effect, claim.stderr, True, {})
    for entry in result.conclusions.retuned:
        if entry.after.stage is Stage.AXIS:
            yield _Fitted(entry.after, entry.stderr, False, {})
