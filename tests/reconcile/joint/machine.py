"""Joints by other physics than the program's: bristles (LuGre) and a torsion spring, integrated in time.

A drive (PD control of the motor) follows a path; q is the motor's or the load's angle, tau the motor's torque. Nothing
of the package is used.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

STEP, INNER = 1e-3, 8


@dataclass(frozen=True)
class Joint:
    """What a joint holds; zero leaves it out. SI units, at the joint."""

    inertia: float = 2.0
    gravity: float = 6.0
    offset: float = 0.7
    dry: float = 0.0
    breakaway: float = 0.0
    stribeck: float = 0.15
    viscous: float = 0.0
    cooling: float = 0.0  # share of the viscosity that warming takes, with a time constant of a third of the recording
    back: float = 0.0  # the dry friction in negative direction is larger by this share
    by_load: float = 0.0
    bristle: float = 1e4
    ripple: float = 0.0
    order: float = 30.0
    drift: float = 0.0  # phase of the ripple, rad per N m of load
    hum: float = 0.0  # torque of 17.3 Hz
    spring_Hz: float = 0.0  # of the load's half of the inertia against a motor held still
    damping: float = 0.02
    behind: bool = False  # the encoder is at the load


@dataclass(frozen=True)
class Measured:
    """How it is measured."""

    torque_noise: float = 0.02
    angle_noise: float = 2e-6
    quantum: float = 0.0
    late: int = 0
    lag: float = 0.0
    seed: int = 0
    seconds: float = 40.0
    path: str = "multisine"
    shake: float = 0.0  # torque that the drive adds, for modal analysis
    coupled: float = 0.0  # kg m^2 by which another joint acts


def path_of(kind: str, t: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate of the wanted motion."""
    rng = np.random.default_rng(1000 + seed)
    if kind == "oneway":
        # always forward, the speed varies
        rate = 0.8 + 0.3 * np.sin(2 * np.pi * t / 5.0) + 0.2 * np.sin(2 * np.pi * t / 1.7 + 1.0)
        return np.cumsum(rate) * (t[1] - t[0]), rate
    if kind == "sine":
        return np.sin(0.4 * np.pi * t), 0.4 * np.pi * np.cos(0.4 * np.pi * t)
    if kind == "one_speed":
        rate = np.where((t % 8.0) < 4.0, 0.5, -0.5)
        rate = np.convolve(rate, np.ones(401) / 401, mode="same")
        return np.cumsum(rate) * (t[1] - t[0]), rate
    parts = [(0.11, 0.7), (0.23, 0.35), (0.41, 0.15), (0.83, 0.05)]
    phases = rng.uniform(0, 2 * np.pi, len(parts))
    q = sum(a * np.sin(2 * np.pi * f * t + p) for (f, a), p in zip(parts, phases, strict=True))
    v = sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * t + p) for (f, a), p in zip(parts, phases, strict=True))
    return q, v


def simulate(joint: Joint, how: Measured) -> dict[str, np.ndarray]:
    """Columns t, q, dq, tau as they are measured."""
    count = int(how.seconds / STEP)
    dt = STEP / INNER
    fine = np.arange(count * INNER) * dt
    want, rate = (values.tolist() for values in path_of(how.path, fine, how.seed))
    rng = np.random.default_rng(how.seed)
    shake = (how.shake * np.repeat(rng.standard_normal(count), INNER)).tolist()
    other = 0.5 * np.sin(2 * np.pi * 0.37 * fine + 0.4) + 0.3 * np.sin(2 * np.pi * 0.61 * fine)
    act = (how.coupled * np.gradient(np.gradient(other, dt), dt)).tolist()
    two = joint.spring_Hz > 0
    motor = joint.inertia / 2 if two else joint.inertia
    load = joint.inertia / 2
    spring = load * (2 * np.pi * joint.spring_Hz) ** 2
    damper = 2 * joint.damping * load * 2 * np.pi * joint.spring_Hz
    w = 2 * np.pi * 6.0
    kp, kd = joint.inertia * w * w, 1.4 * joint.inertia * w
    q, v, z = want[0], rate[0], 0.0
    ql, vl, drive = q, v, 0.0
    out = np.zeros((count, 4))
    span = how.seconds / 3
    for i in range(count * INNER):
        if i % INNER == 0:  # the drive holds its torque from one of its cycles to the next
            drive = kp * (want[i] - q) + kd * (rate[i] - v) + joint.gravity * math.cos(q) + shake[i]
        weight = joint.gravity * math.cos(ql if two else q) + joint.offset
        dry = joint.dry * (1 + joint.back * (v < 0)) + joint.by_load * abs(weight)
        level = dry + joint.breakaway * math.exp(-((v / joint.stribeck) ** 2))
        friction = 0.0
        if level > 0:
            bend = v - joint.bristle * abs(v) / level * z
            z += dt * bend
            friction = joint.bristle * z + 2.0 * math.sqrt(joint.bristle) * 0.2 * bend
        friction += joint.viscous * (1 - joint.cooling * (1 - math.exp(-i * dt / span))) * v
        if joint.ripple:
            friction += joint.ripple * math.cos(joint.order * q + 0.5 + joint.drift * weight)
        if joint.hum:
            friction += joint.hum * math.sin(2 * math.pi * 17.3 * i * dt)
        friction += act[i]
        if two:
            twist = spring * (q - ql) + damper * (v - vl)
            v += dt * (drive - friction - twist) / motor
            vl += dt * (twist - weight) / load
            ql += dt * vl
        else:
            v += dt * (drive - friction - weight) / motor
        q += dt * v
        if i % INNER == 0:
            out[i // INNER] = (i * dt, ql if joint.behind else q, vl if joint.behind else v, drive)
    return _measured(out, how, other[::INNER])


def _measured(out: np.ndarray, how: Measured, other: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(7000 + how.seed)
    t, q, dq, tau = out.T
    tau = tau + how.torque_noise * rng.standard_normal(len(t))
    if how.quantum:
        tau = np.round(tau / how.quantum) * how.quantum
    if how.late:
        tau = np.concatenate([np.full(how.late, tau[0]), tau[: -how.late]])
    if how.lag:
        share = STEP / (how.lag + STEP)
        slow = dq.copy()
        for i in range(1, len(slow)):
            slow[i] = slow[i - 1] + share * (dq[i] - slow[i - 1])
        dq = slow
    q = q + how.angle_noise * rng.standard_normal(len(t))
    found = {"t": t, "q": q, "dq": dq, "tau": tau}
    if how.coupled:
        torque = 0.5 * np.gradient(np.gradient(other, STEP), STEP) + how.torque_noise * rng.standard_normal(len(t))
        found = {"t": t, "q1": q, "dq1": dq, "tau1": tau, "q2": other, "tau2": torque}
    return found


def write(columns: dict[str, np.ndarray], path: Path, rename: dict[str, str] | None = None) -> Path:
    """A CSV file of columns."""
    names = [(rename or {}).get(name, name) for name in columns]
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


#: the worked example of docs/joints.md
EXAMPLE = Joint(dry=1.0, viscous=0.8, breakaway=0.5, ripple=0.15, spring_Hz=30.0), Measured(seed=3, shake=2.0)

if __name__ == "__main__":
    write(simulate(*EXAMPLE), Path(sys.argv[1]))
