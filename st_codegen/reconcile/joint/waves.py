"""Waves of the torque over the joint's angle (ripple) or over time (a hum): found in two halves of the data apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.reconcile.joint.parts import Chosen, PartGain, TorquePart, crossed, gain_of, stacked
from st_codegen.reconcile.joint.rows import JointRows
from st_codegen.reconcile.joint.settings import JOINT

#: what a wave goes over, and how its number is counted
ANGLE, TIME = "wave_of_angle", "wave_of_time"


@dataclass(frozen=True)
class TorqueWave:
    """A wave: over ANGLE (N per revolution) or TIME (Hz), how exactly that is known; its reading over the other."""

    over: str
    number: float
    resolution: float
    gain: PartGain
    rival: PartGain

    @property
    def has_rival(self) -> bool:
        """Whether a wave over the other one would do as well, or so nearly that a form error could make the rest."""
        more = float((self.rival.held - self.gain.held).sum())
        return more <= JOINT.share * float(self.gain.held.sum()) or not self.rival.is_worse_than(self.gain)


def find_wave(rows: JointRows, chosen: Chosen) -> TorqueWave | None:
    """The wave that predicts best what the parts leave; None where none is the same in both halves of the blocks."""
    left = rows.torque - chosen.of(set(chosen.names()))
    found = []
    for over in (ANGLE, TIME):
        number = _agreed(rows, left, over, float(chosen.fit.values[0]))
        if number is not None:
            found.append((over, _gain(rows, chosen, over, number)))
    if not found:
        return None
    over, gain = max(found, key=lambda pair: pair[1].share)
    if not gain.passed:
        return None
    other = TIME if over == ANGLE else ANGLE
    # at one speed this wave is as good over the other one; what stands out there itself may be another wave
    mean = [float(np.median(_phase(rows, one)[1])) for one in (over, other)]
    rival = _gain(rows, chosen, other, gain.part.shape * mean[0] / mean[1])
    return TorqueWave(over, gain.part.shape, _resolution(rows, over), gain, rival)


def _gain(rows: JointRows, chosen: Chosen, over: str, number: float) -> PartGain:
    """What a wave near this number adds: its number is as exact as predicts better.

    What a number that is a little off leaves would be another wave beside it, and its size would be too small.
    """
    base = list(chosen.parts)
    before, width = crossed(stacked(base), rows), _resolution(rows, over)
    gain: PartGain | None = None
    while True:
        center = number if gain is None else gain.part.shape
        near = center + width * np.linspace(-0.5, 0.5, 11)
        variants = [TorquePart(f"{over}:{n:.6g}", float(n), columns(rows, over, float(n))) for n in near]
        finer = gain_of(variants, base, rows, before)
        saves = gain is None or finer.held.sum() < (1 - JOINT.share) * gain.held.sum() or gain.is_worse_than(finer)
        if gain is not None and not saves:
            return gain
        gain, width = finer, width / 5


def columns(rows: JointRows, over: str, number: float) -> FloatArray:
    """A wave: cosine and sine, as the kernel leaves them of a wave that passes at this speed."""
    phase, rate = _phase(rows, over)
    kept = np.exp(-((number * rate * rows.kernel_s) ** 2) / 2)
    return np.stack([kept * np.cos(number * phase), kept * np.sin(number * phase)], axis=1)


def _phase(rows: JointRows, over: str) -> tuple[FloatArray, FloatArray]:
    if over == ANGLE:
        return rows.angle, np.abs(rows.speed)
    return 2 * np.pi * rows.time, np.full(len(rows.time), 2 * np.pi)


def _resolution(rows: JointRows, over: str) -> float:
    return 2 * np.pi / float(np.ptp(_phase(rows, over)[0]))


def most_waves(rows: JointRows, over: str) -> float:
    """The largest number of a wave that the kernel does not take away."""
    return 1.5 / (float(np.median(_phase(rows, over)[1])) * rows.kernel_s)


def spectrum(
    rows: JointRows, left: FloatArray, over: str, kept: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Numbers of waves and the amplitude of what is left there, from the fewest that are told to the most."""
    kept = np.ones(len(left), np.bool_) if kept is None else kept
    phase, _ = _phase(rows, over)
    resolution = _resolution(rows, over)
    most = most_waves(rows, over)
    cells = 1 << int(np.ceil(np.log2(8 * max(most / resolution, 8.0))))
    place = np.minimum(((phase - phase.min()) * cells * resolution / (2 * np.pi)).astype(np.int64), cells - 1)
    sums = np.bincount(place[kept], left[kept] - left[kept].mean(), minlength=cells)
    power = np.abs(np.fft.rfft(sums, 4 * cells)) / max(int(kept.sum()), 1)
    number = np.arange(len(power)) * resolution / 4
    inside = (number >= JOINT.least_waves * resolution) & (number <= most)
    return number[inside], 2 * power[inside]


def _agreed(rows: JointRows, left: FloatArray, over: str, inertia: float) -> float | None:
    """The number of the loudest wave that stands out in both halves of the blocks, at the same place.

    Over time, a wave that the motion itself has much larger is an error of what depends on the motion.
    """
    # waves of noise stand out of their surroundings as exponential powers do
    tops = []
    for half in (0, 1):
        number, size = spectrum(rows, left, over, rows.block % 2 == half)
        if len(number) < 40:
            return None
        reach = int(4 * JOINT.around[over == TIME])
        around = median_filter(size**2, 2 * reach + 1, mode="nearest") / np.log(2.0)
        stands = size**2 > JOINT.stands_out * around
        if over == TIME:
            moved = spectrum(rows, inertia * rows.acceleration, over, rows.block % 2 == half)[1]
            stands &= maximum_filter1d(moved, 9) < JOINT.own * size
        tops.append(np.where(stands, size, 0.0))
    reach = int(4 * JOINT.agree)
    wide = [np.array([top[max(0, i - reach) : i + reach + 1].max() for i in range(len(top))]) for top in tops]
    both = np.minimum(*wide)
    if not both.any():
        return None
    at = int(np.argmax(both * (np.maximum(*tops) > 0)))
    low, high = max(0, at - reach), at + reach + 1
    return float(number[low + int(np.argmax(tops[0][low:high] + tops[1][low:high]))])
