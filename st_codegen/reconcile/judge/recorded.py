"""What stays open of the names that recordings over time give: torques that are read wrong, and what else is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import Conclusions
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect

#: effects of which a torque that is read wrong by a factor or an offset makes as much
_LIKE_TORQUE = frozenset({"torsional_compliance", "hanging_load_compliance", "friction_windup", "backlash"})
_MISREAD_TORQUE = "misread_torque"


def with_doubts(found: Conclusions, *, is_whole_turn: bool, is_more_left: bool) -> Conclusions:
    """Findings with what would do as well beside them.

    is_whole_turn: some recording goes over a turn of the output: of less, orders that are near each other make one
    another. is_more_left: what stays may be the mean's, whatever its parts are called.
    """

    def doubt(effect: Effect) -> str:
        touched = set(effect.touched_orders())
        if touched - {0} and not is_whole_turn:
            return "no recording goes over a whole turn of the output"
        return "more than noise is left of the mean" if is_more_left and 0 in touched else ""

    claims = [claim.in_doubt(why) if (why := doubt(claim.piece.effect)) else claim for claim in found.claims]
    retuned = [replace(one, is_open=one.is_open or bool(doubt(one.after))) for one in found.retuned]
    together = _all_by_torque(found.final, [one.before for one in found.retuned])
    for piece in found.final.state.pieces:
        if piece.own not in together and not _may_be_torque(found.final, piece):
            continue
        for i, claim in enumerate(claims):
            if claim.piece.effect is piece.effect:
                claims[i] = replace(claim, alternatives=tuple(dict.fromkeys((_MISREAD_TORQUE, *claim.alternatives))))
        for i, one in enumerate(retuned):
            if one.before is piece.own:
                retuned[i] = replace(one, misread=tuple(sorted({*one.misread, _MISREAD_TORQUE})))
    return replace(found, claims=tuple(claims), retuned=tuple(retuned))


def _may_be_torque(final: Fit, piece: Piece) -> bool:
    """Whether a factor and an offset of the torques, read by the rig as it was, leave no more than a change does."""
    if piece.effect.name not in _LIKE_TORQUE:
        return False
    twists = [one.own for one in final.state.pieces if not one.added and one.own.name in _LIKE_TORQUE]
    return bool(twists) and _leaves_as_little(final, twists, [piece])


def _all_by_torque(final: Fit, changed: Sequence[Effect]) -> list[Effect]:
    """Effects whose changes a factor and an offset of the torques make together, read by the rig as it was."""
    own = [one for one in final.state.pieces if not one.added]
    loaded = [one for one in own if _slope(final, [one.own]).any()]
    # friction takes what an offset makes of a twist
    pieces = [one for one in own if one.own in changed and (one in loaded or one.own.name in _LIKE_TORQUE)]
    is_all = len(pieces) > 1 and _leaves_as_little(final, [one.own for one in loaded], pieces)
    return [one.own for one in pieces] if is_all else []


def _slope(final: Fit, effects: Sequence[Effect]) -> FloatArray:
    """What one more N m makes of the samples by effects of the rig, deg (n,)."""
    data = final.target.data
    more, found = replace(data.at, torque_Nm=data.at.torque_Nm + 1.0), np.zeros(len(data.at))
    assert data.angle_rad is not None
    for effect in effects:
        for order in effect.touched_orders():
            change = effect.coefficient(more, order) - effect.coefficient(data.at, order)
            found = found + (change * np.exp(1j * order * data.angle_rad)).real
    return found


def _leaves_as_little(final: Fit, loaded: Sequence[Effect], pieces: Sequence[Piece]) -> bool:
    """Whether other torques of the rig's own effects leave no more than changed pieces do."""
    good, rest = final.target.good, final.residual[:, 0].real
    change = np.zeros(len(rest))
    for piece in pieces:
        change += final.explained(piece.effect)[:, 0].real
        if piece.origin is not None:
            change -= final.explained(piece.origin)[:, 0].real
    slope = _slope(final, loaded)
    columns = np.stack([slope, slope * final.target.data.at.torque_Nm], axis=1)[good]

    def left(samples: FloatArray) -> float:
        return float(((samples - made_of(columns, samples)) ** 2).sum())

    unit = max(float((rest[good] ** 2).mean()), 1e-300)
    return left((rest + change)[good]) < left(rest[good]) + SETTINGS.as_good * unit
