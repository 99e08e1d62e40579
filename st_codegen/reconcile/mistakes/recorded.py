"""What is asked of recordings over time before anything is compared: units, signs, zeros and other angles.

The output follows the fast side over the reduction ratio. Where it is off by more than half a turn of the fast side, no
error of a reducer is the cause: nobody could tell which turn it was.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.recordings import (
    FAST,
    Recording,
    error_of,
    expected_error,
    reference_of,
    turned,
    with_motor,
)
from st_codegen.reconcile.mistakes.columns import readings
from st_codegen.reconcile.mistakes.single_runs import AS_IS
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_TURN_DEG = 360.0


def check_accepted(scale: float | None, accept: Collection[str], measured: Path) -> None:
    """Raise InputError for corrections that nobody makes: of recordings there are none."""
    if scale is not None or set(accept) - {AS_IS}:
        raise InputError(
            f"{measured}: recordings over time are not corrected; convert their columns (--accept {AS_IS} alone asks "
            "nothing)"
        )


def check_recordings(recordings: Sequence[Recording], rig: RigModel, measured: Path) -> None:
    """Raise one InputError that asks about all that no machine does."""
    problems = Problems(str(measured))
    for r in recordings:
        found = _jumps(r) or _other_angle(r, rig) or _other_motor(r) or _other_speed(r)
        coldest = float(r.at.temperature_C.min())
        if coldest > SETTINGS.hottest_oil_C:
            found = [*found, f"no oil has {coldest:g} degC; is temperature_C in K?"]
        for text in found:
            problems.add(f"{r.name}: {text}")
    gears = [r for r in recordings if "theta_out" in r.angles]
    turns = turned(gears, rig) * rig.constants.reduction_ratio
    if gears and not problems.errors and turns < 1.0:
        problems.add(
            f"the fast side turns by {turns:.2g} of a turn at most: a reducer's error cannot be told from so little"
        )
    if not problems.errors:
        for text in _other_reading(recordings, rig):
            problems.add(text)
    if problems.errors:
        problems.add(f"convert the columns, or give --accept {AS_IS} to take them as they are")
    problems.raise_if_any()


def _jumps(r: Recording) -> list[str]:
    """Where angles begin anew after a turn."""
    found = []
    # over a gap an angle may well turn as far
    waits = np.diff(r.time_s)
    usual = waits < SETTINGS.jump * np.median(waits)
    for name, angle in r.angles.items():
        steps = np.diff(angle)
        # fast moves between pauses have large steps as well, and none that is a turn off both beside it
        turns = np.diff(np.pad(steps, 1, mode="reflect")) / _TURN_DEG
        is_turn = np.abs(np.abs(turns) - np.maximum(np.round(np.abs(turns)), 1.0)) < SETTINGS.near_a_turn
        jumps = usual & is_turn[:-1] & is_turn[1:]
        if jumps.any() and float(np.median(np.abs(steps))) < _TURN_DEG / 4:
            row = int(np.argmax(jumps))
            found.append(
                f"{name} jumps by {steps[row]:.4g} deg from row {row + 2} to the next; angles run on over whole turns"
            )
    return found


def _other_angle(r: Recording, rig: RigModel) -> list[str]:
    """What theta_out is in place of the angle of the output in deg."""
    if "theta_out" not in r.angles:
        return []
    ratio, out = rig.constants.reduction_ratio, r.angles["theta_out"]
    half_turn, off = _TURN_DEG / (2 * ratio), error_of(r, rig) - expected_error(r, out, rig)
    if float(np.abs(off).max()) < half_turn:
        return []
    fast = r.fast
    follows = out - error_of(r, rig)
    moves = follows - follows.mean()
    slope = float(moves @ out / max(moves @ moves, 1e-300))
    known = (
        (np.pi / 180, "theta_out is in rad"), (180 / np.pi, f"{fast} is in rad"), (60.0, "theta_out is in arcmin"),
        (3600.0, "theta_out is in arcsec"), (1 / 360, "theta_out is in turns"), (360.0, f"{fast} is in turns"),
        (-1.0, "one of the two has the other sign"), (ratio, "both are of the fast side"),
        (1 / ratio, f"{fast} was multiplied by the ratio"), (ratio**2, "the two are exchanged"),
    )  # fmt: skip
    apart = [abs(slope / factor - 1) for factor, _ in known]
    if min(apart) < SETTINGS.exact_factor:
        # a ratio may be one of the units
        why = [
            text for far, (_, text) in zip(apart, known, strict=True) if far < min(apart) + SETTINGS.exact_factor / 10
        ]
        return [
            f"theta_out turns {slope:.5g} times as far as {fast} over the ratio, {ratio:g}: as if {' or '.join(why)}"
        ]
    # the servo lags as far as it likes
    return [] if fast == "theta_ref" else [_not_a_gear(r, f"{fast} over the ratio", off, slope, ratio)]


def _not_a_gear(r: Recording, fast: str, off: FloatArray, slope: float, ratio: float) -> str:
    """What is wrong with theta_out that is `off` by more than half a turn of the fast side (n,), in known units."""
    half_turn, jumps = _TURN_DEG / (2 * ratio), np.diff(off)
    row, others = int(np.abs(jumps).argmax()), float(np.sort(np.abs(jumps))[-3])
    if not np.ptp(r.angles["theta_out"]):
        return f"theta_out never changes, {fast} does"
    if abs(jumps[row]) > max(half_turn / 2, SETTINGS.jump * others):
        at = f"t = {r.time_s[row + 1]:g} s"
        return f"theta_out jumps by {jumps[row]:.3g} deg against {fast}, {ratio:g}, at {at}: were turns lost?"
    driven = r.angles["theta_out"] - off
    rest = off + (1 - slope) * driven
    if float(np.abs(rest - rest.mean()).max()) > half_turn * abs(slope):
        return f"theta_out does not follow {fast}, {ratio:g}, nor over any other"
    if float(np.ptp(driven)) * abs(slope - 1) > half_turn:
        return f"theta_out follows {fast} with a ratio of about {ratio / slope:.4g}, the rig has {ratio:g}"
    middle = float(np.median(off))
    return (
        f"theta_out is {middle:.3g} deg, {abs(middle) / (2 * half_turn):.2g} turns of the fast side, off {fast}: the "
        "zeros of the two differ, or one of them is late"
    )


def _other_motor(r: Recording) -> list[str]:
    """Whether theta_mot and theta_in are angles of one shaft, which a coupling parts by less than half a turn."""
    if not {"theta_mot", "theta_in"} <= r.angles.keys():
        return []
    apart = np.abs(r.angles["theta_in"] - r.angles["theta_mot"]).max()
    if apart < _TURN_DEG / 2:
        return []
    return [f"theta_mot and theta_in are up to {apart:.3g} deg apart, as no coupling is: their units or zeros differ"]


def _other_speed(r: Recording) -> list[str]:
    """Whether speed_rpm is the rate of the fast side's angle."""
    if min(float(np.ptp(angle)) for name, angle in r.angles.items() if name in FAST) < _TURN_DEG:
        return []
    waits, steps = np.diff(r.time_s), np.diff(reference_of(r.angles))
    time, way = _over_some(waits), _over_some(np.abs(steps))
    # noise is no way: of a measured angle only where it goes one way, so that noise adds less than is asked about
    told = (np.abs(_over_some(steps)) > (1.0 - SETTINGS.one_rate) * way) | ("theta_ref" in r.angles)
    given = (_over_some(waits * (r.at.speed_rpm[1:] + r.at.speed_rpm[:-1]) / 2.0) / time)[told]
    derived = (way / time / 6.0)[told]
    moves = derived > SETTINGS.fast_enough * derived.max(initial=0.0)
    if not moves.any():
        return []
    factor = float(np.median(given[moves]) / np.median(derived[moves]))
    if abs(factor - 1) < SETTINGS.one_rate:
        return []
    return [f"speed_rpm is {factor:.4g} times the rate of the fast side over t: one of them is in another unit"]


def _over_some(of_waits: FloatArray) -> FloatArray:
    """Sums over so many waits that a clock that jitters, or noise of an angle, makes hardly another rate of them."""
    sums = np.concatenate([[0.0], np.cumsum(of_waits)])
    over: FloatArray = sums[SETTINGS.samples_of_rate :] - sums[: -SETTINGS.samples_of_rate]
    return over


def _least_at(of: Callable[[float], float]) -> float:
    """The delay (s), of either sign, at which a function is least."""
    # only here: it takes a tenth of a second
    from scipy.optimize import minimize_scalar

    low, high, delays = *SETTINGS.delays_s, int(np.log2(SETTINGS.delays_s[1] / SETTINGS.delays_s[0])) + 1
    best = min((sign * delay for delay in np.geomspace(low, high, delays) for sign in (1.0, -1.0)), key=of)
    first, last = sorted(np.copysign(np.clip([abs(best) / 2.0, abs(best) * 2.0], low, high), best).tolist())
    return float(minimize_scalar(of, bounds=(first, last), method="bounded").x)


def _other_reading(recordings: Sequence[Recording], rig: RigModel) -> list[str]:
    """Conditions or angles in other units with which the rig leaves hardly anything of what it leaves as they are."""
    # a lag is that of all samples
    whole = [with_motor(r, rig) for r in recordings if "theta_out" in r.angles]
    some = [r.rows(np.unique(np.linspace(0, len(r.time_s) - 1, SETTINGS.samples_that_tell).astype(int))) for r in whole]
    if not some:
        return []
    degrees = [
        replace(
            r,
            angles={name: np.rad2deg(angle) for name, angle in r.angles.items()},
            at=replace(r.at, speed_rpm=np.rad2deg(r.at.speed_rpm)),
        )
        for r in some
    ]
    tried = {"the angles look like in rad": degrees}
    for name, what, meant in readings(rig.constants.reduction_ratio):
        if name != "speeds":
            tried[f"the {name} look like {what}"] = [replace(r, at=meant(r.at)) for r in some]
    warm = rig.constants.reference_temperature_C
    idle = [replace(r, at=replace(r.at, torque_Nm=0.0 * r.time_s, temperature_C=warm + 0.0 * r.time_s)) for r in some]

    def left(read: Sequence[Recording]) -> float:
        rest = [error_of(r, rig) - expected_error(r, r.angles["theta_out"], rig) for r in read]
        return float(np.mean(np.concatenate(rest) ** 2))

    def by(late_s: float) -> list[Recording]:
        """The recordings with torques that were written so much too late."""
        torques = [np.interp(few.time_s + late_s, r.time_s, r.at.torque_Nm) for few, r in zip(some, whole, strict=True)]
        return [replace(r, at=replace(r.at, torque_Nm=torque)) for r, torque in zip(some, torques, strict=True)]

    late = _least_at(lambda seconds: left(by(seconds)))
    tried[f"torque_Nm looks {abs(late):.2g} s {'late' if late > 0 else 'early'}"] = by(late)
    # what has no load, or no rig at all, predicted as well is no reading of it: an error in degrees is large beside the
    # rig's; errors of angles in other units are in other units
    none = float(np.mean(np.concatenate([error_of(r, rig) for r in some]) ** 2))
    as_is, least = left(some), min(left(some), left(idle), none)
    sizes = {text: left(read) / (np.rad2deg(1.0) ** 2 if read is degrees else 1.0) for text, read in tried.items()}
    best = min(sizes, key=lambda text: np.nan_to_num(sizes[text], nan=np.inf))
    if not sizes[best] < SETTINGS.left_of_rest * least:
        return []
    return [
        f"{best}: read so, the rig leaves {left(tried[best]) ** 0.5:.2g} deg RMS, and as they are {as_is**0.5:.2g} deg"
    ]
