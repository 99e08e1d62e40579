"""Samples of a joint in motion: angle and its two rates through one smooth kernel, and the torque through the same.

Smoothing both sides of an equation with one kernel leaves it true, so the rates need no filter of their own.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.reconcile.joint.reading import JointRecording, noise_of
from st_codegen.reconcile.joint.settings import JOINT

#: joints whose motion may act together with that of another: those of one arm
_NEAREST = 6
#: rows that are kept at most: neighbours share most of what they say
_MOST_ROWS = 12_000


@dataclass(frozen=True)
class JointRows:
    """A joint where it moves, (n,) each: s, rad, rad/s, rad/s^2, N m, N m/s.

    travel, since: angle and time since the last reversal, infinite before the first; others: columns that the other
    joints' motion could act by, (n, p); block: stretch of time, from 0; kernel_s: width of the kernel; noise: of the
    smoothed torque (N m) and of the acceleration (rad/s^2), from what changes from sample to sample.
    """

    time: FloatArray
    angle: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    torque_rate: FloatArray
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
        return np.sign(self.speed)

    def where(self, kept: np.ndarray) -> JointRows:
        """The rows that a mask or an index array chooses, of every column."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: x[kept] for name, x in own.items() if isinstance(x, np.ndarray)})


def rows_of(
    recordings: Sequence[JointRecording],
    joint: str,
    shift: int = 0,
    least_kernel_s: float = 0.0,
    acting: Sequence[int] | None = None,
) -> JointRows | None:
    """The rows of one joint of recordings; shift: samples by which the torque is taken later. None without motion.

    acting: which of the columns of the other joints' motion are wanted; None: all.
    """
    narrow = _kernel([one.angle[joint] for one in recordings])
    kernel = max(narrow, int(np.ceil(least_kernel_s / recordings[0].step_s)))
    parts, reversals = [], 0
    for one, start in zip(recordings, starts_of(recordings), strict=True):
        part, count = _rows(one, joint, (narrow, kernel), shift, acting)
        parts.append([part[0] + start, *part[1:]])
        reversals += count
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    time = columns[0]
    every = max(1, -(-len(time) // _MOST_ROWS))
    chosen = slice(None, None, every)
    count = len(time[chosen])
    if count < JOINT.samples // 10:
        return None
    block = (np.arange(count) * JOINT.blocks) // count
    if (period := _period_s(recordings)) is not None:
        # what is left out must not come back in the next round
        block = (time[chosen] % period * (JOINT.blocks / period)).astype(np.int64)
    step = recordings[0].step_s
    noise = _together([one.torque[joint] for one in recordings])
    shaken = _together([one.angle[joint] for one in recordings])
    time, angle, speed, acceleration, torque, rate, travel, since, others = (column[chosen] for column in columns)
    noises = (
        noise / np.sqrt(2 * np.sqrt(np.pi) * kernel),
        shaken * np.sqrt(3 / (8 * np.sqrt(np.pi) * kernel**5)) / step**2,
    )
    return JointRows(
        time, angle, speed, acceleration, torque, rate, travel, since, others, block, kernel * step, noises, reversals,
        step,
    )  # fmt: skip


def starts_of(recordings: Sequence[JointRecording]) -> list[float]:
    """The time at which each begins, s: files one after another, pieces of a file as far apart as they were."""
    starts, start, end, file = [], 0.0, 0.0, None
    for one in recordings:
        if one.name != file:
            start, file = end, one.name
        starts.append(start + one.at_s)
        end = starts[-1] + one.step_s * (len(next(iter(one.angle.values()))) + 1)
    return starts


def _period_s(recordings: Sequence[JointRecording]) -> float | None:
    """The time after which all joints of one file do the same again, once at least; None: they do not."""
    if len({one.name for one in recordings}) > 1:
        return None
    step = recordings[0].step_s
    angles = [np.stack(list(one.angle.values())) for one in recordings]
    every = np.concatenate(angles, axis=1)
    mean, size = every.mean(axis=1)[:, None], np.maximum(every.std(axis=1), 1e-300)[:, None]
    firsts = [round(start / step) for start in starts_of(recordings)]
    count = firsts[-1] + angles[-1].shape[1]
    moved, is_there = np.zeros((len(every), count)), np.zeros(count)
    for first, angle in zip(firsts, angles, strict=True):
        own = slice(first, first + angle.shape[1])
        moved[:, own], is_there[own] = (angle - mean) / size, 1.0
    # sum of squares of what lies a lag apart, where both are there, by way of correlations
    length = next_fast_len(2 * count, real=True)
    waves, power, there = (np.fft.rfft(one, length) for one in (moved, (moved**2).sum(axis=0), is_there))
    alike = (np.abs(waves) ** 2).sum(axis=0)
    apart = np.fft.irfft(2 * (power * there.conj()).real - 2 * alike, length)[: count // 2 + 1]
    pairs = np.fft.irfft(np.abs(there) ** 2, length)[: count // 2 + 1]
    off = np.where(pairs > 0.5, apart / np.maximum(len(every) * pairs, 1.0), np.inf)
    far = np.flatnonzero(off > JOINT.repeats)
    if not len(far):
        return None
    back = np.flatnonzero(off[far[0] :] < JOINT.repeats)
    if not len(back):
        return None
    start = int(far[0] + back[0])
    near = off[start : start + max(start // 50, 2)]
    return float(start + np.argmin(near)) * step


def _kernel(angles: Sequence[FloatArray]) -> int:
    """The width (samples) at which the noise of the angle no longer matters in the acceleration of all pieces."""
    noise, (least, most) = _together(angles), JOINT.kernel
    for width in range(least, most):
        # the ends know nothing of what comes next to them
        inner = [gaussian_filter1d(angle, width)[4 * width : -4 * width] for angle in angles]
        seconds = np.concatenate([np.diff(angle, 2) for angle in inner])
        noisy = noise**2 * 3 / (8 * np.sqrt(np.pi) * width**5)
        # where nothing is left a wider one leaves nothing either
        if not len(seconds) or noisy <= JOINT.dilution * float(seconds.var()):
            return width
    return most


def _together(columns: Sequence[FloatArray]) -> float:
    """The noise of all pieces of a column."""
    return float(np.sqrt(np.mean([noise_of(column) ** 2 for column in columns])))


def _rows(
    one: JointRecording, joint: str, kernels: tuple[int, int], shift: int, acting: Sequence[int] | None
) -> tuple[list[FloatArray], int]:
    narrow, kernel = kernels

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

    def direction(speed: FloatArray, width: int) -> FloatArray:
        noise = noise_of(raw) / one.step_s / np.sqrt(4 * np.sqrt(np.pi) * width**3)
        slow = np.abs(speed) < max(JOINT.standing * float(np.abs(speed).max()), JOINT.sure_speed * noise)
        return np.where(slow, 0.0, np.sign(speed))

    sign = direction(speed, kernel)
    window = 6 * kernel + 1
    steady = (minimum_filter1d(sign, window) == maximum_filter1d(sign, window)) & (sign != 0)
    if narrow < kernel:
        # a joint that is shaken goes both ways where its smooth speed is low: its dry friction is less in the mean
        own = direction(np.gradient(gaussian_filter1d(raw, narrow), one.step_s), narrow)
        steady &= (minimum_filter1d(own, window) == maximum_filter1d(own, window)) & (own != 0)
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
    moved = angle[moving], speed[moving], acceleration[moving]
    nearest = sorted(set(one.angle) - {joint}, key=lambda name: (abs(int(name) - int(joint)), int(name)))
    smoothed = ([smooth(one.angle[name], order)[moving] for order in range(3)] for name in nearest)
    beside = [(q, v, a) for q, v, a in smoothed]
    others = _acting(moved, beside, acting)
    torque = smooth(np.roll(one.torque[joint], -shift))
    clock = np.asarray(index * one.step_s, np.float64)
    values: list[FloatArray] = [clock, angle, speed, acceleration, torque, np.gradient(torque, one.step_s)]
    found: list[FloatArray] = [column[moving] for column in values]
    found += [travel, since, others]
    return found, len(turned)


#: Angle, speed and acceleration of a joint, (n,) each.
_Motion = tuple[FloatArray, FloatArray, FloatArray]


def _acting(own: _Motion, beside: Sequence[_Motion], chosen: Sequence[int] | None) -> FloatArray:
    """What the other joints' motion may add to a joint's torque, (n, p), whatever the arm looks like.

    In a chain of rigid links inertias are sums of waves of the angles, so the torque is one of accelerations, products
    of speeds, and gravity, each times such waves: here those of two other joints at most.
    """
    (q0, v0, a0), one = own, np.ones(len(own[0]))
    terms: list[tuple[FloatArray, FloatArray]] = []

    def waves(*angles: FloatArray) -> list[FloatArray]:
        return [wave(angle) for angle in angles for wave in (np.cos, np.sin)]

    for q, v, a in beside:
        outer = waves(q, 2 * q)
        terms += itertools.product((a0,), outer)
        terms += itertools.product((a, v * v, v * v0), (one, *outer, *waves(q0, 2 * q0, q0 + q, q0 - q)))
        terms += itertools.product((one,), (*outer, *waves(q0 + q, q0 - q)))
    for (q, v, a), (r, w, b) in itertools.combinations(beside[:_NEAREST], 2):
        terms.append((v * w, one))
        terms += itertools.product((a0, a, b, v * w, one), waves(q + r, q - r, q0 + q + r))
    chosen = range(len(terms)) if chosen is None else chosen
    found = [terms[place][0] * terms[place][1] for place in chosen]
    return np.stack(found, axis=1) if found else np.zeros((len(q0), 0))
