"""The links of the axis in recordings over time: the servo's (control lag) and the coupling's.

theta_ref -> theta_mot is the servo's, theta_mot -> theta_in the coupling's. Each is fitted by itself and judged; the
reducer's transmission error behind them goes to the common core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.chances import chi_square_tail
from st_codegen.reconcile.data.noise import MEDIAN_1
from st_codegen.reconcile.data.recordings import Recording
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import Claim, Conclusions, Retuned
from st_codegen.reconcile.outcome import Gap
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect
from st_codegen.rig.effects.axis import ControlLag, CouplingCompliance
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Link:
    """What was found on a link of the axis, and the gap that it makes at the output."""

    claim: Claim | None
    retuned: Retuned | None
    gap: Gap
    unexplained: str


#: what the coupling does to the angles, seen from the motor
_LIKE_COUPLING = ("torsional_compliance", "backlash")


def with_unmeasured_links(found: Conclusions, recordings: Sequence[Recording]) -> Conclusions:
    """Findings with what cannot be told from them where theta_in was not measured: the coupling twists as well."""
    if all("theta_in" in r.angles for r in recordings):
        return found
    remark = "theta_in was not measured: the coupling's part is not told from the reducer's; record it"
    claims, retuned = list(found.claims), list(found.retuned)
    for i, claim in enumerate(claims):
        if claim.piece.effect.name in _LIKE_COUPLING:
            names = tuple(sorted({*claim.alternatives, "coupling_compliance"}))
            claims[i] = replace(claim, alternatives=names, extrapolates=(*claim.extrapolates, remark))
    for i, one in enumerate(retuned):
        if one.after.name in _LIKE_COUPLING:
            retuned[i] = replace(one, misread=(*one.misread, "coupling_compliance"))
    return replace(found, claims=tuple(claims), retuned=tuple(retuned))


def servo_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_ref -> theta_mot: is there a lag that the rig does not have?"""
    usable = [r for r in recordings if {"theta_ref", "theta_mot"} <= r.angles.keys()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, ControlLag)), None)
    start = own.scalar("lag_ms") if own else 0.0

    def residual(lag: float) -> list[FloatArray]:
        effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
        return [r.angles["theta_mot"] - effect.motor_angle(r.time_s, r.angles["theta_ref"]) for r in usable]

    first = residual(start)
    lag = _least(lambda x: float(sum((part**2).sum() for part in residual(x))), start)
    best = residual(lag)
    sigma = _noise(best)
    slope = np.concatenate(residual(lag * 1.01 + 1e-3)) - np.concatenate(best)
    stderr = sigma * (0.01 * lag + 1e-3) / max(float(np.sqrt((slope**2).sum())), 1e-300)
    effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
    return _judged(first, best, sigma, rig, effect, own, {"lag_ms": stderr})


def coupling_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_mot -> theta_in: does the coupling twist or play beyond what the rig says?"""
    usable = [r for r in recordings if {"theta_mot", "theta_in"} <= r.angles.keys()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, CouplingCompliance)), None)
    measured = [r.angles["theta_in"] - r.angles["theta_mot"] for r in usable]
    first = [part - own.twist(r.at) if own else part for part, r in zip(measured, usable, strict=True)]
    columns = []
    for r in usable:
        twist = -r.at.sign * np.rad2deg(r.at.torque_Nm / rig.constants.reduction_ratio)
        columns.append(np.stack([twist, -r.at.sign / 120.0], axis=1) * r.moves[:, None])
    design, y = np.concatenate(columns), np.concatenate(measured)
    use = np.abs(design).sum(axis=1) > 0
    design, y = design[use], y[use]
    both = np.linalg.lstsq(design, y, rcond=None)[0]
    sigma = _noise([y - design @ both])
    spread = sigma * np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    values: dict[str, float] = {}
    if both[1] > SETTINGS.sure_backlash * spread[1]:
        values["backlash_arcmin"] = float(both[1])
    else:
        both = np.array([float(design[:, 0] @ y / max(design[:, 0] @ design[:, 0], 1e-300)), 0.0])
        spread[0] = sigma / max(float(np.sqrt(design[:, 0] @ design[:, 0])), 1e-300)
    values["stiffness_Nm_per_rad"] = float(np.clip(1 / max(both[0], 1e-9), 50, 1e6))
    effect = CouplingCompliance(values, rig.constants, check=False)
    best = [part - effect.twist(r.at) for part, r in zip(measured, usable, strict=True)]
    masks = [r.moves for r in usable]
    stderr = {"stiffness_Nm_per_rad": spread[0] * values["stiffness_Nm_per_rad"] ** 2, "backlash_arcmin": spread[1]}
    keep = {key: float(x) for key, x in stderr.items() if key in values}
    first = [part[mask] for part, mask in zip(first, masks, strict=True)]
    best = [part[mask] for part, mask in zip(best, masks, strict=True)]
    return _judged(first, best, sigma, rig, effect, own, keep)


def _least(loss: Callable[[float], float], start: float) -> float:
    from scipy.optimize import minimize_scalar

    grid = np.concatenate([[start], np.geomspace(0.05, 500, 40)])
    best = int(np.argmin([loss(float(x)) for x in grid]))
    around = sorted({float(x) for x in grid})
    place = around.index(float(grid[best]))
    low, high = around[max(place - 1, 0)], around[min(place + 1, len(around) - 1)]
    found = minimize_scalar(loss, bounds=(low if low < around[place] else 0.0, high), method="bounded")
    return float(found.x)


def _noise(parts: Sequence[FloatArray]) -> float:
    """Standard deviation of white noise, from third differences.

    Those that are nothing are of an axis that stands: what the digits of a file are rounded by shows where it moves.
    """
    smooth = np.abs(np.concatenate([np.diff(part, n=3) / np.sqrt(20.0) for part in parts]))
    apart = smooth[smooth > SETTINGS.least_noise_deg]
    return float(np.median(apart) / MEDIAN_1) if apart.size else SETTINGS.least_noise_deg


def _rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _judged(
    first: Sequence[FloatArray],
    best: Sequence[FloatArray],
    sigma: float,
    rig: RigModel,
    effect: Effect,
    own: Effect | None,
    stderr: dict[str, float],
) -> Link:
    """A claim where the link's effect explains what is there, and a signature where something is left."""
    ratio = rig.constants.reduction_ratio
    before, after = _rms(first), _rms(best)
    x, y = np.concatenate(first), np.concatenate(best)
    saved = float((np.minimum(x**2, 1e6 * sigma**2).sum() - np.minimum(y**2, 1e6 * sigma**2).sum()) / sigma**2)
    blocks = np.array_split(np.arange(len(x)), SETTINGS.parts_of_link)
    stable = float(np.mean([(x[b] ** 2).sum() > (y[b] ** 2).sum() for b in blocks]))
    size = float(np.sqrt(max(before**2 - after**2, 0.0)) / sigma)
    p = chi_square_tail(saved, len(stderr))
    evidence = Evidence(saved, len(stderr), p, p, {"time": saved / len(x)}, (1, 1), stable, size)
    left = max(after**2 - sigma**2, 0.0)
    fits = left < SETTINGS.misfit * max(before**2 - after**2, 1e-300)
    found = p < SETTINGS.p_chance and stable > SETTINGS.stable_link and size >= SETTINGS.least_size_of_link and fits
    wrong = min(before, after) > SETTINGS.left_on_link * sigma
    unexplained = ""
    if wrong:
        unexplained = f"{effect.title}: {after:.2g} deg RMS are left at the fast side, noise is {sigma:.2g} deg"
    share = float(np.clip(1 - (after**2 - sigma**2) / max(before**2 - sigma**2, 1e-300), 0, 1)) if found else 0.0
    claim = retuned = None
    if found and own is None:
        claim = Claim(Piece(effect, frozenset(effect.values), True), stderr, evidence, (), (), share, ())
    elif found and own is not None:
        retuned = Retuned(own, effect, stderr, p)
    final = after if found else before
    return Link(claim, retuned, Gap(before / ratio, final / ratio, sigma / ratio), unexplained)
