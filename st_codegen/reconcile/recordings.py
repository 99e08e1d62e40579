"""Recordings over time: from the reference to the output, link by link.

theta_ref -> theta_mot is the servo's (control lag), theta_mot -> theta_in the coupling's, theta_in -> theta_out the
reducer's. The two links of the axis are fitted here; the reducer's transmission error goes to the common core, sample
by sample. Columns and signs: docs/effects.md.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems
from st_codegen.reconcile.conclusions import Claim, Retuned
from st_codegen.reconcile.evidence import LEAST_SIZE, P_CHANCE, Evidence, chi_square_tail
from st_codegen.reconcile.observations import Observations
from st_codegen.reconcile.parameters import Piece
from st_codegen.rig.effects import Conditions, Effect
from st_codegen.rig.effects.axis import ControlLag, CouplingCompliance
from st_codegen.rig.effects.base import FloatArray
from st_codegen.rig.model import RigModel

ANGLES = ("theta_ref", "theta_mot", "theta_in", "theta_out")
#: angles of the fast side, the one nearest to the reducer first
_FAST = ("theta_in", "theta_mot", "theta_ref")
_CONDITIONS = ("speed_rpm", "torque_Nm", "temperature_C")
#: samples of the transmission error that the common core is given at most
_MOST_SAMPLES = 6000
_LEAST_SAMPLES = 200
_FOLDS = 5


@dataclass(frozen=True)
class Recording:
    """One recording: float64 (n,) each; angles that are not there are missing in `angles`."""

    name: str
    time_s: FloatArray
    angles: dict[str, FloatArray]
    at: Conditions


@dataclass(frozen=True)
class Link:
    """What was found on a link of the axis: RMS in deg at the output before, after, and of the noise."""

    claim: Claim | None
    retuned: Retuned | None
    before: float
    after: float
    floor: float
    unexplained: str


def is_recording(path: Path) -> bool:
    """Whether a file has the columns of a recording."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            names = {cell.strip() for cell in file.readline().replace(";", ",").split(",")}
    except (OSError, UnicodeDecodeError):
        return False
    return "t" in names and bool(names & set(ANGLES))


def read_recordings(paths: Sequence[Path]) -> tuple[Recording, ...]:
    """Read recordings. Raises one InputError that lists what is wrong."""
    problems = Problems("recordings")
    found = []
    for path in paths:
        with problems.collect():
            found.append(_read(path))
    problems.raise_if_any()
    return tuple(found)


def _read(path: Path) -> Recording:
    columns = _columns(path)
    problems = Problems(str(path))
    if missing := [name for name in ("t", "torque_Nm", "temperature_C") if name not in columns]:
        problems.add(f"the columns {', '.join(missing)} are missing")
    angles = {name: columns[name] for name in ANGLES if name in columns}
    if len(angles) < 2 or not angles.keys() & set(_FAST):
        problems.add(
            f"the angles {', '.join(angles)} do not suffice: two of {', '.join(ANGLES)} are needed to tell a difference"
        )
    bad = [name for name, values in columns.items() if not np.isfinite(values).all()]
    if bad:
        problems.add(f"values of {', '.join(bad)} are not finite")
    time = columns.get("t", np.arange(float(_LEAST_SAMPLES)))
    if len(time) < _LEAST_SAMPLES:
        problems.add(f"{len(time)} samples are too few: {_LEAST_SAMPLES} at least")
    if not bad and (np.diff(time) <= 0).any():
        problems.add(f"the time does not rise from row {int(np.argmax(np.diff(time) <= 0)) + 2} to the next")
    problems.raise_if_any()
    smooth = next(angles[name] for name in ("theta_ref", "theta_in", "theta_mot") if name in angles)
    speed = np.gradient(smooth, time)
    if "theta_ref" not in angles:
        speed = _smoothed(speed, 15)
    given = columns.get("speed_rpm", np.abs(speed) / 6.0)
    at = Conditions(_directions(speed), np.abs(given), columns["torque_Nm"], columns["temperature_C"])
    return Recording(path.name, time, angles, at)


def _columns(path: Path) -> dict[str, FloatArray]:
    """The columns of a file by name. Raises InputError for what is no table of numbers."""
    text = path.read_text(encoding="utf-8-sig")
    first = text.partition("\n")[0]
    separator = ";" if ";" in first else ","
    names = [cell.strip() for cell in next(csv.reader([first], delimiter=separator))]
    if separator == ";":
        text = text.replace(",", ".")
    try:
        table = np.loadtxt(text.splitlines()[1:], delimiter=separator, ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: not readable as numbers ({error})") from None
    if table.shape[1] != len(names):
        raise InputError(f"{path}: rows of {table.shape[1]} values do not fit the header with {len(names)}")
    return dict(zip(names, table.T, strict=True))


def _smoothed(values: FloatArray, count: int) -> FloatArray:
    kernel = np.ones(count) / count
    found: FloatArray = np.convolve(np.pad(values, count // 2, mode="edge"), kernel, mode="valid")[: len(values)]
    return found


def _directions(speed: FloatArray) -> FloatArray:
    """+1 or -1; at standstill the last direction, forward before the first motion."""
    moving = np.abs(speed) > 1e-3 * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), 0))
    found: FloatArray = np.where(moving[last], np.sign(speed[last]), 1.0)
    return found


def observations(recordings: Sequence[Recording], rig: RigModel) -> Observations:
    """The transmission error of recordings as samples for the common core."""
    parts = []
    for r in recordings:
        if "theta_out" in r.angles:
            out = r.angles["theta_out"]
            te = out - _input_angle(r, rig) / rig.constants.reduction_ratio
        else:
            # nothing is measured of the reducer: nothing differs there
            out = next(iter(r.angles.values())) / rig.constants.reduction_ratio
            te = rig.te_deg(out, r.at.sign, r.at.speed_rpm, r.at.torque_Nm, r.at.temperature_C)
        # standstill says nothing of the direction, and little of anything else
        moving = r.at.speed_rpm > 0.02 * r.at.speed_rpm.max()
        parts.append((r, out, te, np.flatnonzero(moving)))
    step = max(1, -(-sum(len(rows) for *_, rows in parts) // _MOST_SAMPLES))
    labels, values, angles, conditions = [], [], [], []
    for r, out, te, rows in parts:
        chosen = rows[::step]
        labels += [f"{r.name}, t = {r.time_s[i]:g} s" for i in chosen]
        values.append(te[chosen])
        angles.append(np.deg2rad(out[chosen]))
        conditions.append(r.at.rows(chosen))
    at = Conditions(*(np.concatenate([getattr(c, name) for c in conditions]) for name in ("sign", *_CONDITIONS)))
    constants = rig.constants
    highest = 3.1 * max(constants.cycloid_teeth, constants.pins)
    mesh = [k for k in constants.mesh_orders() if k <= highest]
    sides = [k + d for k in mesh for d in (-constants.cranks, constants.cranks)]
    inside = tuple(sorted({0, 1, 2, constants.cranks, *rig.orders(), *mesh, *sides, *range(13)}))
    column = np.concatenate(values).astype(np.complex128)[:, None]
    return Observations(at, tuple(labels), np.zeros(1, np.int64), column, np.concatenate(angles), inside)


def _input_angle(r: Recording, rig: RigModel) -> FloatArray:
    """theta_in, deg: measured, or by the rig's own links from the next angle of the fast side that is there."""
    if "theta_in" in r.angles:
        return r.angles["theta_in"]
    angle = r.angles.get("theta_mot")
    if angle is None:
        angle = r.angles["theta_ref"]
        for effect in rig.effects:
            angle = effect.motor_angle(r.time_s, angle) if isinstance(effect, ControlLag) else angle
    for effect in rig.effects:
        angle = angle + effect.twist(r.at) if isinstance(effect, CouplingCompliance) else angle
    return angle


#: what the coupling does to the angles, seen from the motor
_LIKE_COUPLING = ("torsional_compliance", "backlash")


def with_unmeasured_links(claims: Sequence[Claim], recordings: Sequence[Recording]) -> tuple[Claim, ...]:
    """Claims with what cannot be told from them where theta_in was not measured: the coupling twists as well."""
    if all("theta_in" in r.angles for r in recordings):
        return tuple(claims)
    remark = "theta_in was not measured: the coupling's part is not told from the reducer's; record it"
    return tuple(
        replace(
            claim,
            alternatives=tuple(sorted({*claim.alternatives, "coupling_compliance"})),
            extrapolates=(*claim.extrapolates, remark),
        )
        if claim.piece.effect.name in _LIKE_COUPLING
        else claim
        for claim in claims
    )


# ---------------------------------------------------------------------------------------------- links of the axis


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
        moving = r.at.speed_rpm > 0.02 * r.at.speed_rpm.max()
        twist = -r.at.sign * np.rad2deg(r.at.torque_Nm / rig.constants.reduction_ratio)
        columns.append(np.stack([twist, -r.at.sign / 120.0], axis=1) * moving[:, None])
    design, y = np.concatenate(columns), np.concatenate(measured)
    use = np.abs(design).sum(axis=1) > 0
    design, y = design[use], y[use]
    both = np.linalg.lstsq(design, y, rcond=None)[0]
    sigma = _noise([y - design @ both])
    spread = sigma * np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    values: dict[str, float] = {}
    if both[1] > 5 * spread[1]:
        values["backlash_arcmin"] = float(both[1])
    else:
        both = np.array([float(design[:, 0] @ y / max(design[:, 0] @ design[:, 0], 1e-300)), 0.0])
        spread[0] = sigma / max(float(np.sqrt(design[:, 0] @ design[:, 0])), 1e-300)
    values["stiffness_Nm_per_rad"] = float(np.clip(1 / max(both[0], 1e-9), 50, 1e6))
    effect = CouplingCompliance(values, rig.constants, check=False)
    best = [part - effect.twist(r.at) for part, r in zip(measured, usable, strict=True)]
    masks = [r.at.speed_rpm > 0.02 * r.at.speed_rpm.max() for r in usable]
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
    """Standard deviation of white noise, from third differences."""
    smooth = np.concatenate([np.diff(part, n=3) / np.sqrt(20.0) for part in parts])
    return float(max(np.median(np.abs(smooth)) / 0.67449, 1e-9))


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
    blocks = np.array_split(np.arange(len(x)), _FOLDS)
    stable = float(np.mean([(x[b] ** 2).sum() > (y[b] ** 2).sum() for b in blocks]))
    size = float(np.sqrt(max(before**2 - after**2, 0.0)) / sigma)
    p = chi_square_tail(saved, len(stderr))
    evidence = Evidence(saved, len(stderr), p, p, {"time": saved / len(x)}, stable, size)
    left = max(after**2 - sigma**2, 0.0)
    fits = left < 0.3 * max(before**2 - after**2, 1e-300)
    found = p < P_CHANCE and stable > 0.7 and size >= 0.3 * LEAST_SIZE and fits
    wrong = after > 1.5 * sigma and before > 1.5 * sigma
    unexplained = ""
    if wrong:
        unexplained = f"{effect.title}: {after:.2g} deg RMS are left at the fast side, noise is {sigma:.2g} deg"
    share = float(np.clip(1 - (after**2 - sigma**2) / max(before**2 - sigma**2, 1e-300), 0, 1)) if found else 0.0
    claim = retuned = None
    if found and own is None:
        piece, gap = Piece(effect, frozenset(effect.values), True), (before / ratio, after / ratio)
        claim = Claim(piece, stderr, evidence, (), (), share, gap, ())
    elif found and own is not None:
        retuned = Retuned(own, effect, stderr, p)
    final = after if found else before
    return Link(claim, retuned, before / ratio, final / ratio, sigma / ratio, unexplained)
