"""Motion profiles: angle of the output and resisting torque over time.

- `cycloidal`: Eq. 7 of the paper, T = 20 s, h = 360 deg; the load rises by the same law to 370 N m.
- `robot`: pick and place of the first joint of a large robot, of our own making: fast moves with a limited jerk, a
  short approach, reversals and dwells, a heavier load on the way with the part. (The paper's own recording is not
  published.)
- a CSV file with the columns `t,theta_out,torque_Nm` (s, deg, N m; `;` or tabs, and decimal commas, are read too).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import read_csv
from st_codegen.ir.arrays import FloatArray

_COLUMNS = ("t", "theta_out", "torque_Nm")
#: Longest recording: half an hour at 250 us are 7 million cycles.
_LONGEST_S = 1800.0


@dataclass(frozen=True)
class MotionProfile:
    """A motion of the output, all (n,): evenly spaced times from 0 s, angle, speed, torque against the motion."""

    name: str
    time_s: FloatArray
    angle_deg: FloatArray
    speed_deg_s: FloatArray
    torque_Nm: FloatArray

    @property
    def duration_s(self) -> float:
        """Length of the motion."""
        return float(self.time_s[-1])

    @property
    def direction(self) -> FloatArray:
        """+1 or -1, (n,): that of the motion, at standstill the last one, before the first move that of the first."""
        signs = np.sign(np.where(np.abs(self.speed_deg_s) > 1e-9, self.speed_deg_s, 0.0))
        moving = np.flatnonzero(signs)
        if not len(moving):
            return np.ones_like(signs)
        last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), moving[0]))
        return signs[last]

    def facts(self, ratio: float) -> dict[str, float]:
        """What characterises it, as in Table 8: largest speeds, acceleration, load, and travel."""
        step = self.time_s[1] - self.time_s[0]
        return {
            "duration_s": self.duration_s,
            "travel_deg": float(np.abs(np.diff(self.angle_deg)).sum()),
            "speed_out_rpm": float(np.abs(self.speed_deg_s).max() / 6.0),
            "speed_in_rpm": float(np.abs(self.speed_deg_s).max() / 6.0 * ratio),
            "acceleration_deg_s2": float(np.abs(np.diff(self.speed_deg_s)).max() / step),
            "torque_Nm": float(np.abs(self.torque_Nm).max()),
        }


def _times(count: int, cycle_s: float) -> FloatArray:
    return np.arange(count, dtype=np.float64) * cycle_s


def cycloidal(
    cycle_s: float, *, period_s: float = 20.0, height_deg: float = 360.0, torque_Nm: float = 370.0
) -> MotionProfile:
    """Eq. 7: theta = h (t/T - sin(2 pi t/T) / (2 pi)), the load likewise up to its maximum."""
    time = _times(round(period_s / cycle_s) + 1, cycle_s)
    phase = 2.0 * np.pi * time / period_s
    rise = time / period_s - np.sin(phase) / (2.0 * np.pi)
    return MotionProfile(
        "cycloidal", time, height_deg * rise, height_deg / period_s * (1.0 - np.cos(phase)), torque_Nm * rise
    )


#: Moves of the pick and place: travel (deg), time (s), then a dwell (s), and the load on the way (N m).
_MOVES = (
    (100.0, 1.9, 0.25, 240.0),
    (8.0, 0.6, 0.25, 240.0),
    (-138.0, 2.2, 0.3, 370.0),
    (30.0, 1.0, 0.25, 200.0),
)


def robot(cycle_s: float) -> MotionProfile:
    """Pick and place: each move is a polynomial of fifth order (jerk without jumps), the load swells and fades with it.

    Largest speed 19.6 rpm at the output (1590 rpm at the motor), acceleration up to 173 deg/s2, two reversals, four
    dwells.
    """
    angle, parts = 0.0, []
    for travel, duration, dwell, load in _MOVES:
        u = np.arange(round(duration / cycle_s)) * (cycle_s / duration)
        smooth, rate = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2 / duration
        # friction of the joint and the arm's inertia want most where it moves; at rest next to nothing is left
        swell = load * (0.1 + 0.9 * np.sin(np.pi * u) ** 2)
        parts.append(np.stack([angle + travel * smooth, travel * rate, swell]))
        angle += travel
        rest = round(dwell / cycle_s)
        parts.append(np.stack([np.full(rest, angle), np.zeros(rest), np.full(rest, 0.1 * load)]))
    angles, speeds, torques = np.concatenate(parts, axis=1)
    time = _times(len(angles), cycle_s)
    return MotionProfile("robot", time, angles, speeds, _smooth(torques, round(0.05 / cycle_s)))


def _smooth(values: FloatArray, width: int) -> FloatArray:
    """A running mean: no jumps between moves."""
    padded = np.concatenate([np.full(width, values[0]), values, np.full(width, values[-1])])
    kernel = np.ones(2 * width + 1) / (2 * width + 1)
    return np.convolve(padded, kernel, mode="valid")


#: Profiles by name.
PROFILES: dict[str, Callable[[float], MotionProfile]] = {"cycloidal": cycloidal, "robot": robot}


def profile_named(name: str, cycle_s: float) -> MotionProfile:
    """A profile by name, or from a CSV file.

    Raises InputError for an unknown name, and lists what is wrong with a file.
    """
    maker = PROFILES.get(name)
    if maker is not None:
        return maker(cycle_s)
    path = Path(name)
    if path.suffix.lower() != ".csv":
        raise InputError(f"profile '{name}': known are {', '.join(PROFILES)}, or the path of a .csv file")
    return read_profile(path, cycle_s)


def read_profile(path: Path, cycle_s: float) -> MotionProfile:
    """A profile from a CSV on the PLC's cycles: piecewise cubic through the angles (no overshoot), linear in torque."""
    from scipy.interpolate import PchipInterpolator

    problems = Problems(str(path))
    time, angle, torque = read_csv(path, _COLUMNS).numbers(_COLUMNS, problems).T
    problems.raise_if_any()
    _check(time, angle, torque, problems)
    problems.raise_if_any()
    grid = np.arange(math.floor((time[-1] - time[0]) / cycle_s + 1e-9) + 1) * cycle_s
    if len(grid) < 2:
        raise InputError(f"{path}: {time[-1] - time[0]:g} s long, and a cycle of the main task takes {cycle_s:g} s")
    curve = PchipInterpolator(time - time[0], angle)
    return MotionProfile(
        path.stem, grid, curve(grid), curve.derivative()(grid), np.interp(grid, time - time[0], torque)
    )


#: Speed and torque of no reducer's output: in a profile that has more, something has another unit.
_FASTEST_RPM, _LARGEST_NM = 1000.0, 1e6


def _check(time: FloatArray, angle: FloatArray, torque: FloatArray, problems: Problems) -> None:
    if len(time) < 4:
        raise InputError(f"{problems.subject}: {counted(len(time), 'row')}; a profile has at least 4")
    step = np.diff(time)
    if (step <= 0.0).any():
        row = int(np.argmax(step <= 0.0)) + 3
        raise InputError(f"{problems.subject}: line {row}: the time must rise from row to row")
    if time[-1] - time[0] > _LONGEST_S:
        problems.add(f"{time[-1] - time[0]:g} s long; the longest profile is {_LONGEST_S:g} s")
    speed = np.abs(np.diff(angle) / step) / 6.0
    if speed.max() > _FASTEST_RPM:
        row = int(np.argmax(speed)) + 2
        problems.add(f"line {row}: {speed.max():.4g} rpm at the output: t is in s, theta_out in deg")
    if np.abs(torque).max() > _LARGEST_NM:
        row = int(np.argmax(np.abs(torque))) + 2
        problems.add(f"line {row}: {torque[row - 2]:g} at the output: torque_Nm is in N m")
