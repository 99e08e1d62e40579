"""Elasticity: torque per acceleration over frequency, as the quotient of quadratics that a mode makes of an inertia."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.joint.settings import JOINT

#: a fit that is stopped before it has converged ends elsewhere on another processor
_MOST_STEPS = 400
#: frequencies near a mode that tell it
_FEWEST = 4
#: Torque per acceleration from parameters at angular frequencies.
Form = Callable[[FloatArray, FloatArray], ComplexArray]


@dataclass(frozen=True)
class JointResponse:
    """Torque per acceleration (kg m^2) at frequencies (Hz) where the motion explains the torque; errors; two halves."""

    frequency: FloatArray
    value: ComplexArray
    error: FloatArray
    halves: tuple[ComplexArray, ComplexArray]
    half_error: FloatArray

    def bands(self, damping: float = 0.0) -> tuple[tuple[float, float], ...]:
        """Bands (Hz) in which a mode would be seen: no wider gap than it is, and as many frequencies as tell one.

        damping: ratio of the mode, where it is known; of others the narrowest counts.
        """
        wide = (np.diff(self.frequency) > JOINT.gap * float(np.diff(self.frequency).min())) & (
            self.frequency[1:] > (1 + 3 * max(damping, JOINT.narrowest)) * self.frequency[:-1]
        )
        runs = np.split(self.frequency, np.flatnonzero(wide) + 1)
        return tuple((float(run[0]), float(run[-1])) for run in runs if len(run) >= _FEWEST)


@dataclass(frozen=True)
class JointMode:
    """A resonance (the torque needed is least), the antiresonance below it where seen: Hz, damping ratio, errors."""

    resonance_Hz: float
    damping: float
    resonance_error: float
    damping_error: float
    antiresonance_Hz: float | None
    response: JointResponse
    fitted: ComplexArray


def response(pieces: Sequence[tuple[FloatArray, FloatArray]], step_s: float) -> JointResponse | None:
    """From pieces of even samples of (angle, torque less what is no inertia); None where too little is coherent."""
    # short pieces are no longer than a window, but there are many of them
    sizes = [len(angle) for angle, _ in pieces]
    length = min(4096, max(sizes) - 4, sum(sizes) // 8)
    length = 1 << max(int(np.log2(max(length, 1))), 0)
    if length < 128:
        return None
    window = np.hanning(length)
    sums = []
    for angle, torque in (piece for piece in pieces if len(piece[0]) > length):
        acceleration = np.gradient(np.gradient(angle, step_s), step_s)
        for start in range(2, len(angle) - length - 1, length // 2):
            own = slice(start, start + length)
            a, m = (np.fft.rfft(window * (x[own] - x[own].mean())) for x in (acceleration, torque))
            sums.append((np.abs(a) ** 2, m * a.conj(), np.abs(m) ** 2))
    if len(sums) < 6:
        return None
    frequency = np.fft.rfftfreq(length, step_s)
    # the double central difference is this part of the second derivative
    turn = 2 * np.pi * frequency * step_s
    part = np.where(turn > 0, (np.sin(turn) / np.where(turn > 0, turn, 1.0)) ** 2, 1.0)
    aa, ma, mm = (np.array(column) for column in zip(*sums, strict=True))
    coherence = np.abs(ma.sum(axis=0)) ** 2 / np.maximum(aa.sum(axis=0) * mm.sum(axis=0), 1e-300)
    told = (coherence > JOINT.coherence) & (np.arange(len(frequency)) > 1) & (turn < JOINT.told_band * np.pi)
    if told.sum() < JOINT.frequencies:
        return None
    # half of the pieces overlap, so that two count as little more than one
    count = len(sums) / 1.5
    value, *halves = (
        (ma[own].sum(axis=0) / np.maximum(aa[own].sum(axis=0), 1e-300) * part)[told]
        for own in (slice(None), slice(0, len(sums) // 2), slice(len(sums) // 2, None))
    )
    error = np.abs(value) * np.sqrt((1 - coherence[told]) / coherence[told] / (2 * count) + 1e-6)
    return JointResponse(frequency[told], value, error, (halves[0], halves[1]), np.sqrt(2) * error)


def _plain(p: FloatArray, w: FloatArray) -> ComplexArray:
    """Inertia, damping, stiffness, late by a time: all that a rigid joint under control shows."""
    return np.asarray((p[0] + p[1] / (1j * w) - p[2] / w**2) * np.exp(-1j * w * p[3]))


def _upper(p: FloatArray, w: FloatArray) -> ComplexArray:
    """A resonance alone: an encoder behind the spring."""
    return np.asarray(_plain(p, w) * (p[4] ** 2 - w**2 + 2j * p[5] * p[4] * w) / p[4] ** 2)


def _both(p: FloatArray, w: FloatArray) -> ComplexArray:
    """Antiresonance and resonance: an encoder before the spring; or a resonance, and a filter above it."""
    return np.asarray(_upper(p, w) * p[6] ** 2 / (p[6] ** 2 - w**2 + 2j * p[7] * p[6] * w))


def find_mode(found: JointResponse) -> JointMode | None:
    """The mode that a response shows; None where a rigid joint does as well, or the mode is not inside what is told."""
    w = 2 * np.pi * found.frequency
    inertia = max(float(np.median(np.abs(found.value[: max(3, len(w) // 6)]))), 1e-12)
    error = np.maximum(found.error, JOINT.least_error * np.abs(found.value))
    rigid, p0 = _fit(_plain, np.array([inertia, 0.0, 0.0, 0.0]), found.value, error, w)
    if _is_within_errors(rigid, p0, found, error):
        return None
    # what is fitted without a mode may be far from what is there beside one
    plain = np.array([inertia, 0.0, 0.0, 0.0])
    begins = [(p0, place) for place in np.geomspace(1.3 * w[0], 0.95 * w[-1], 5)]
    begins.append((plain, w[int(np.abs(found.value).argmin())]))
    tried: list[tuple[float, Any, FloatArray, Form]] = []
    for beside, place in begins:
        forms: list[tuple[Form, list[float]]] = [(_upper, [place, 0.05])]
        forms.append((_both, [1.15 * place, 0.05, place / 1.15, 0.05]))
        for model, tail in forms:
            done, p = _fit(model, np.concatenate([beside, tail]), found.value, error, w)
            tried.append((done.cost + JOINT.price * len(p), done, p, model))
    # a mode counts that is one; what is none may fit a little better
    modes = [one for one in tried if _is_mode(one[2], w)]
    if not modes or min(one[0] for one in modes) > JOINT.as_good * min(one[0] for one in tried):
        return None
    _, done, p, model = min(modes, key=lambda one: one[0])
    before, after, apart = _held_out(model, p, p0, found, w)
    if after > (1 - JOINT.mode) * before or _is_braked(p, found.value, w):
        return None
    try:
        spread = np.sqrt(np.diag(np.linalg.inv(done.jac.T @ done.jac)) * max(2 * done.cost / (2 * len(w)), 1.0))
    except np.linalg.LinAlgError:
        return None
    lower = float(p[6] / (2 * np.pi)) if model is _both and not _is_filter(p) else None
    to_hertz = 1 / (2 * np.pi)
    # what no mode explains may move its peak by as much of its width
    spread[4] = np.sqrt(spread[4] ** 2 + apart[0] ** 2 + (after * p[5] * p[4]) ** 2)
    spread[5] = np.sqrt(spread[5] ** 2 + apart[1] ** 2 + (after * p[5]) ** 2)
    return JointMode(
        float(p[4] * to_hertz), float(p[5]), float(spread[4] * to_hertz), float(spread[5]), lower,
        found, model(p, w),
    )  # fmt: skip


def is_rigid(found: JointResponse) -> bool:
    """Whether an inertia, a damper and a spring, late by a time, are all that a response shows."""
    w = 2 * np.pi * found.frequency
    inertia = max(float(np.median(np.abs(found.value[: max(3, len(w) // 6)]))), 1e-12)
    error = np.maximum(found.error, JOINT.least_error * np.abs(found.value))
    rigid, p = _fit(_plain, np.array([inertia, 0.0, 0.0, 0.0]), found.value, error, w)
    return _is_within_errors(rigid, p, found, error)


def _is_within_errors(rigid: Any, p: FloatArray, found: JointResponse, error: FloatArray) -> bool:
    """Whether a rigid joint is off by errors alone, in the mean and side by side: a mode may be small in the mean."""
    w = 2 * np.pi * found.frequency
    off = np.abs((_plain(p, w) - found.value) / error) ** 2
    beside = np.convolve(off, np.ones(_FEWEST), mode="valid")
    # half of a chi-square of two numbers each; of those side by side the window makes about one number
    most = 2 * chi2.isf(JOINT.by_chance / len(w), _FEWEST)
    return bool(rigid.cost < JOINT.rigid * len(w) and beside.max() < JOINT.rigid * most)


def _is_mode(p: FloatArray, w: FloatArray) -> bool:
    """Whether parameters are those of a mode that is narrow, damped, and inside of the frequencies."""
    both = len(p) > 6 and not _is_filter(p)
    wide = p[5] > JOINT.broadest or (both and p[7] > JOINT.broadest)
    negative = p[5] <= 0 or p[0] <= 0 or (both and not (0 < p[6] < p[4] and p[7] > 0))
    if wide or negative or not w[1] < p[4] < w[-2]:
        return False
    near = np.abs(w / p[4] - 1) < 3 * max(p[5], JOINT.narrowest)
    return bool(near.sum() >= _FEWEST and (w[near] < p[4]).any() and (w[near] > p[4]).any())


def _is_filter(p: FloatArray) -> bool:
    """Whether what falls off beside a resonance lies above it, and has no sharp peak, as a filter of the torque."""
    return len(p) > 6 and bool(p[6] > p[4] and p[7] > JOINT.broadest)


def _is_braked(p: FloatArray, value: ComplexArray, w: FloatArray) -> bool:
    """Whether the torque leads the acceleration below a mode: then the drive brakes what shakes, and does not drive it.

    A joint takes power. Where friction shakes it, as at reversals, the drive takes it: its own response is seen. The
    mode's own damping is no such lead. A torque that is early counts: it has been shifted before, and the time in the
    fit may be the drive's response.
    """
    lowest = min(p[4], p[6]) if len(p) > 6 else p[4]
    here = (w > lowest / 3) & (w < JOINT.lead_below * lowest)
    # a filter and an early time beside it undo each other's phase: neither is taken off alone
    form = _both if len(p) > 6 and not _is_filter(p) else _upper
    below = (value * _plain(p, w) / form(p, w))[here]
    return bool(below.imag.sum() > JOINT.lead * np.abs(below).sum())


def _fit(
    model: Form, start: FloatArray, value: ComplexArray, error: FloatArray, w: FloatArray
) -> tuple[Any, FloatArray]:
    """A robust fit: what the optimiser says, and the parameters."""
    inertia = max(abs(float(start[0])), 1e-12)
    unit = np.array([inertia, inertia * w[0], inertia * w[0] ** 2, 1e-3, *np.ones(len(start) - 4)])

    def off(p: FloatArray) -> FloatArray:
        left = (model(p * unit, w) - value) / error
        return np.concatenate([left.real, left.imag])

    done = least_squares(off, start / unit, loss="soft_l1", x_scale="jac", max_nfev=_MOST_STEPS)
    p = done.x * unit
    # a frequency and its damping that are both negative are the same mode
    for place in range(4, len(p), 2):
        p[place : place + 2] *= np.sign(p[place]) or 1.0
    return done, p


def _held_out(
    model: Form, p: FloatArray, p0: FloatArray, found: JointResponse, w: FloatArray
) -> tuple[float, float, FloatArray]:
    """Relative misfit (RMS) of each half by the other, without and with the mode; how far the halves' modes differ."""
    sums, modes = np.zeros(2), []
    for own, other in (found.halves, found.halves[::-1]):
        error = np.maximum(found.half_error, JOINT.least_error * np.abs(own))
        for place, (form, start) in enumerate([(_plain, p0), (model, p)]):
            _, fitted = _fit(form, start, own, error, w)
            off = np.abs((form(fitted, w) - other) / np.maximum(np.abs(other), found.half_error))
            sums[place] += float(np.minimum(off, JOINT.most_off) @ np.minimum(off, JOINT.most_off)) / (2 * len(w))
        modes.append(fitted[4:6])
    return float(np.sqrt(sums[0])), float(np.sqrt(sums[1])), np.abs(modes[0] - modes[1]) / 2
