"""Samples of a joint in motion: angle and its two rates through one smooth kernel, and the torque through the same.

Smoothing both sides of an equation with one kernel leaves it true, so the rates need no filter of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.reconcile.joint.reading import JointRecording
from st_codegen.reconcile.settings import SETTINGS

#: rows that are kept at most: neighbours share most of what they say
_MOST_ROWS = 12_000


@dataclass(frozen=True)
class JointRows:
    """A joint where it moves, (n,) each: s, rad, rad/s, rad/s^2, N m.

    travel, since: angle and time since the last reversal, infinite before the first; others: columns that the other
    joints' motion could act by, (n, p); block: stretch of time, from 0; kernel_s: width of the kernel; noise: of the
    smoothed torque (N m) and of the acceleration (rad/s^2), from what changes from sample to sample.
    """

    time: FloatArray
    angle: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    travel: FloatArray
    since: FloatArray
    others: FloatArray
    block: IntArray
    kernel_s: float
    noise: tuple[float, float]
    reversals: int
    step_s: float

    @property
    def sign(self) -> FloatArray:
        """Direction of motion, +1 or -1."""
        found: FloatArray = np.sign(self.speed)
        return found

    def where(self, kept: np.ndarray) -> JointRows:
        """Some of the rows."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: x[kept] for name, x in own.items() if isinstance(x, np.ndarray)})


def noise_of(values: FloatArray) -> float:
    """Standard deviation of what changes from sample to sample without a pattern, or more: by fourth differences."""
    size = np.sort(np.abs(np.diff(values, 4)))
    # what jumps (a reversal) is none of it; rounding steps are
    return float(np.sqrt((size[: int(0.99 * len(size)) + 1] ** 2).mean() / 70.0))


def rows_of(
    recordings: Sequence[JointRecording], joint: str, shift: int = 0, least_kernel_s: float = 0.0
) -> JointRows | None:
    """The rows of one joint of recordings; shift: samples by which the torque is taken later. None without motion."""
    kernel = max(_kernel(one.angle[joint]) for one in recordings)
    kernel = max(kernel, int(np.ceil(least_kernel_s / recordings[0].step_s)))
    parts, start, reversals = [], 0.0, 0
    for one in recordings:
        part, count = _rows(one, joint, kernel, shift)
        parts.append([part[0] + start, *part[1:]])
        start, reversals = start + one.step_s * (len(one.angle[joint]) + 1), reversals + count
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    time = columns[0]
    every = max(1, -(-len(time) // _MOST_ROWS))
    chosen = slice(None, None, every)
    count = len(time[chosen])
    if count < SETTINGS.joint_samples // 10:
        return None
    block = (np.arange(count) * SETTINGS.joint_blocks) // count
    step = recordings[0].step_s
    noise, shaken = (
        float(np.sqrt(np.mean([noise_of(values[joint]) ** 2 for values in given])))
        for given in ([one.torque for one in recordings], [one.angle for one in recordings])
    )
    time, angle, speed, acceleration, torque, travel, since, others = (column[chosen] for column in columns)
    noises = (
        noise / np.sqrt(2 * np.sqrt(np.pi) * kernel),
        shaken * np.sqrt(3 / (8 * np.sqrt(np.pi) * kernel**5)) / step**2,
    )
    return JointRows(
        time, angle, speed, acceleration, torque, travel, since, others, block, kernel * step, noises, reversals, step
    )  # fmt: skip


def _kernel(angle: FloatArray) -> int:
    """The width (samples) at which the noise of the angle no longer matters in the acceleration."""
    noise, (least, most) = noise_of(angle), SETTINGS.joint_kernel
    for width in range(least, most):
        # the ends know nothing of what comes next to them
        power = float(np.diff(gaussian_filter1d(angle, width)[4 * width : -4 * width], 2).var())
        if noise**2 * 3 / (8 * np.sqrt(np.pi) * width**5) <= SETTINGS.joint_dilution * power:
            return width
    return most


def _rows(one: JointRecording, joint: str, kernel: int, shift: int) -> tuple[list[FloatArray], int]:
    def smooth(values: FloatArray, order: int = 0) -> FloatArray:
        # differences of the smooth curve: a sampled kernel of a derivative would let a part of the angle itself pass
        found: FloatArray = gaussian_filter1d(values, kernel)
        if order == 1:
            found = np.gradient(found, one.step_s)
        elif order:
            found = np.pad(np.diff(found, 2), 1) / one.step_s**2
        return found

    raw = one.angle[joint]
    count = len(raw)
    angle, speed, acceleration = (smooth(raw, order) for order in range(3))
    noise = noise_of(raw) / one.step_s / np.sqrt(4 * np.sqrt(np.pi) * kernel**3)
    slow = np.abs(speed) < max(SETTINGS.joint_standing * float(np.abs(speed).max()), 5 * noise)
    sign = np.where(slow, 0.0, np.sign(speed))
    window = 6 * kernel + 1
    steady = (minimum_filter1d(sign, window) == maximum_filter1d(sign, window)) & (sign != 0)
    index = np.arange(count)
    edge = 4 * kernel + abs(shift)
    moving = np.flatnonzero(steady & (index >= edge) & (index < count - edge))[:: 2 * kernel]
    last = np.maximum.accumulate(np.where(sign != 0, index, 0))
    held = sign[last]
    turned = np.flatnonzero((held[1:] != held[:-1]) & (held[:-1] != 0)) + 1
    before = np.searchsorted(turned, moving, side="right") - 1
    at = turned[np.maximum(before, 0)] if len(turned) else np.zeros(len(moving), np.int64)
    known = before >= 0
    travel: FloatArray = np.where(known, np.abs(angle[moving] - angle[at]), np.inf)
    since: FloatArray = np.where(known, (moving - at) * one.step_s, np.inf)
    columns = []
    for other in sorted(set(one.angle) - {joint}):
        q, v, a = (smooth(one.angle[other], order)[moving] for order in range(3))
        both = angle[moving] + q
        columns += [a, a * np.cos(q), v * v, v * speed[moving], np.cos(q), np.sin(q), np.cos(both), np.sin(both)]
        columns += [acceleration[moving] * np.cos(q), a * np.sin(q), v * v * np.sin(q)]
    others = np.stack(columns, axis=1) if columns else np.zeros((len(moving), 0))
    torque = smooth(np.roll(one.torque[joint], -shift))
    clock = np.asarray(index * one.step_s, np.float64)
    values: list[FloatArray] = [clock, angle, speed, acceleration, torque]
    found: list[FloatArray] = [column[moving] for column in values]
    found += [travel, since, others]
    return found, len(turned)
