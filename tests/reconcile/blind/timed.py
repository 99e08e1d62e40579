"""Recordings in time of an axis that moves to and fro: theta_ref -> theta_mot -> theta_in -> theta_out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from . import effects
from .layout import Conditions

RATE_HZ = 250.0
#: angles of the fast side are read with this standard deviation, in deg (a 20 bit encoder and its mounting)
FAST_NOISE_DEG = 0.01
OUT_NOISE_DEG = 5e-4
COLUMNS = ("t", "theta_ref", "theta_mot", "theta_in", "theta_out", "speed_rpm", "torque_Nm", "temperature_C")


def lagged(reference: np.ndarray, step_s: float, lag_s: float) -> np.ndarray:
    """Exact answer of a first-order lag to `reference`, straight between its samples, starting on it."""
    if lag_s <= 0.0:
        return reference.copy()
    decay = np.exp(-step_s / lag_s)
    ramp = lag_s / step_s * (1.0 - decay)
    out = np.empty_like(reference)
    out[0] = reference[0]
    for index in range(1, len(reference)):
        old, new = reference[index - 1], reference[index]
        out[index] = decay * out[index - 1] + (ramp - decay) * old + (1.0 - ramp) * new
    return out


def profile(rng: np.random.Generator, moves: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(angle of the output in deg, torque, temperature): cycloidal moves of 360 deg to and fro, each with its load."""
    angle, torque = [], []
    at, sign = 0.0, 1.0
    for _ in range(moves):
        samples = int(rng.uniform(6.0, 14.0) * RATE_HZ)
        part = np.arange(samples) / samples
        angle.append(at + sign * 360.0 * (part - np.sin(2 * np.pi * part) / (2 * np.pi)))
        level = rng.uniform(50.0, 1600.0)
        torque.append(level * (0.4 + 0.6 * np.sin(np.pi * part) ** 2))
        at, sign = at + sign * 360.0, -sign
    whole = np.concatenate(angle)
    start = rng.uniform(22.0, 28.0)
    heat = start + rng.uniform(4.0, 9.0) * (1.0 - np.exp(-2.0 * np.arange(len(whole)) / len(whole)))
    return whole, np.concatenate(torque), heat


def directions(speed: np.ndarray) -> np.ndarray:
    """+1, -1 of each sample; at standstill the last one, forward before the first motion."""
    moving = np.where(np.abs(speed) > 1e-9, np.sign(speed), 0.0)
    last = np.maximum.accumulate(np.where(moving != 0.0, np.arange(len(speed)), 0))
    held = moving[last]
    return np.where(held == 0.0, 1.0, held)


def _one(tables: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any]:
    return next((table for table in tables if table["name"] == name), {})


def record(
    rng: np.random.Generator, head: Mapping[str, Any], tables: Sequence[Mapping[str, Any]], moves: int = 4
) -> dict[str, np.ndarray]:
    """Columns of one recording, with noise on the angles."""
    tau = head["reduction_ratio"]
    out_ref, torque, heat = profile(rng, moves)
    reference = tau * out_ref
    motor = lagged(reference, 1.0 / RATE_HZ, _one(tables, "control_lag").get("lag_ms", 0.0) / 1000.0)
    speed = np.gradient(motor, 1.0 / RATE_HZ)
    sense = directions(speed)
    coupling = _one(tables, "coupling_compliance")
    twist = np.degrees(torque / (tau * coupling["stiffness_Nm_per_rad"])) if coupling else 0.0
    fast = motor - sense * (twist + coupling.get("backlash_arcmin", 0.0) / 120.0)
    at = Conditions(np.abs(speed) / 6.0, torque, heat)
    spectrum = effects.coefficients(head, tables, at)
    side = np.where(sense > 0.0, 0, 1)
    waves = {order: values[side, np.arange(len(side))] for order, values in spectrum.items()}
    out = fast / tau
    for _ in range(4):  # TE is a function of theta_out itself; a step shrinks the error by k * TE < 1e-2
        turned = np.radians(out)
        out = fast / tau + sum((values * np.exp(1j * order * turned)).real for order, values in waves.items())
    noisy = {
        "theta_mot": motor + FAST_NOISE_DEG * rng.standard_normal(len(motor)),
        "theta_in": fast + FAST_NOISE_DEG * rng.standard_normal(len(motor)),
        "theta_out": out + OUT_NOISE_DEG * rng.standard_normal(len(motor)),
    }
    still = {"speed_rpm": at.speed_rpm, "torque_Nm": torque, "temperature_C": heat}
    columns = {"t": np.arange(len(motor)) / RATE_HZ, "theta_ref": reference, **noisy, **still}
    return {name: columns[name] for name in COLUMNS}
