"""How a campaign is measured: layouts, noise, encoders, and mistakes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .points import DIRECTIONS, Array, Points, angles

#: one noise, in deg: the standard deviation of a sample at level 1
NOISE_UNIT = 1e-4
#: a step of an encoder of 18 bits, and its lines, between which it interpolates
STEP_18_BITS = 360.0 / 2**18
ENCODER_LINES = 2048
SHARE_OF_WRONG_LABELS = 0.08


# ------------------------------------------------------------------------------------------------ layouts


def plan(random: np.random.Generator, layout: str, many_speeds: bool, temperatures: Sequence[float]) -> Points:
    """Operating points in the order in which they are measured, which is random; speed, torque, oil as a log says."""
    if layout == "grid":
        speeds = np.linspace(200, 1700, 16 if many_speeds else 6)
        torques = np.array([0, 600, 1200] if many_speeds else [0, 400, 800, 1200, 1600])
        oil = (temperatures[0], temperatures[-1]) if many_speeds and len(temperatures) > 1 else temperatures
        table = np.array([(s, m, t) for s in speeds for m in torques for t in oil])
    elif layout == "scattered":
        count = 64 if many_speeds else 45
        low, high = [200, 0, min(temperatures)], [1700, 1600, max(temperatures)]
        table = low + (np.array(high) - low) * _latin(random, count, 3)
    elif layout == "twelve":
        ends = (temperatures[0], temperatures[-1])
        table = np.array([(s, m, t) for s in (300, 900, 1600) for m in (100, 1300) for t in ends])
        table = table + random.uniform(-1, 1, table.shape) * [80, 80, 0]
    else:
        raise ValueError(f"unknown layout {layout}")
    table = random.permutation(np.round(table))
    count = len(table)
    when = np.arange(count) / max(count - 1, 1)
    return Points(table[:, 0], table[:, 1], table[:, 2], when, np.arange(count))


def fresh(random: np.random.Generator, points: Points, count: int = 24) -> Points:
    """Runs that nobody measured, inside of what was measured, at times of the campaign."""
    columns = [
        np.round(random.uniform(values.min(), values.max(), count), 1)
        for values in (points.speed, points.torque, points.temperature)
    ]
    return Points(*columns, random.uniform(0, 1, count), 10_000 + np.arange(count))


def _latin(random: np.random.Generator, count: int, axes: int) -> Array:
    """Latin hypercube: each axis has one point in each of `count` equal parts."""
    cells = np.stack([random.permutation(count) for _ in range(axes)], axis=1)
    return np.asarray((cells + random.uniform(0, 1, cells.shape)) / count)


# ------------------------------------------------------------------------------------------------ noise


def white(random: np.random.Generator, te: Array, sigma: float) -> Array:
    return te + sigma * random.standard_normal(te.shape)


def coloured(random: np.random.Generator, te: Array, sigma: float) -> Array:
    """First-order autoregression with a correlation of 0.8 from sample to sample, of standard deviation sigma."""
    from scipy.signal import lfilter

    rho = 0.8
    drive = sigma * np.sqrt(1 - rho**2) * random.standard_normal((*te.shape[:-1], te.shape[-1] + 50))
    return np.asarray(te + lfilter([1.0], [1.0, -rho], drive, axis=-1)[..., 50:])


def drifting(random: np.random.Generator, te: Array, sigma: float) -> Array:
    """White noise, and a random walk within each run that ends some three sigma away from its start."""
    walk = np.cumsum(random.standard_normal(te.shape), axis=-1) / np.sqrt(te.shape[-1])
    return white(random, te + 3 * sigma * (walk - walk.mean(axis=-1, keepdims=True)), sigma)


def encoder(random: np.random.Generator, te: Array, sigma: float) -> Array:
    """Steps of 18 bits, an interpolation error of 0.3 steps between the lines, white noise before the rounding.

    Each run starts at another angle between two lines, so the interpolation error is not locked from run to run.
    """
    start = random.uniform(0, 360.0 / ENCODER_LINES, (*te.shape[:-1], 1))
    position = start + angles(te.shape[-1])
    inside = 0.3 * STEP_18_BITS * np.sin(np.radians(ENCODER_LINES * (position + te)))
    read = position + te + inside + sigma * random.standard_normal(te.shape)
    return np.asarray(np.round(read / STEP_18_BITS) * STEP_18_BITS - position)


Noise = Callable[[np.random.Generator, Array, float], Array]
NOISES: dict[str, Noise] = {"white": white, "encoder": encoder, "coloured": coloured, "drifting": drifting}


# ------------------------------------------------------------------------------------------------ mistakes


@dataclass(frozen=True)
class Measured:
    """What the files say: conditions as labelled, angle (deg, forward and backward), TE in the unit of the file.

    `wrong` holds the rows that a mistake has spoilt, where it is not all of them.
    """

    points: Points
    angle: Array
    te: Array
    wrong: tuple[int, ...] = ()


def plainly(points: Points, te: Array) -> Measured:
    """Measured without a mistake."""
    return Measured(points, np.broadcast_to(angles(te.shape[-1]), te.shape[1:]), te)


Mistake = Callable[[np.random.Generator, Measured, int], Measured]


def arcsec(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    return replace(data, te=data.te * 3600.0)


def arcmin(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    return replace(data, te=data.te * 60.0)


def rad(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    return replace(data, te=np.radians(data.te))


def sign(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    return replace(data, te=-data.te)


def direction(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """The columns of forward and backward are exchanged."""
    return replace(data, te=data.te[:, ::-1], angle=data.angle[::-1])


def home_offset(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """The output's zero is elsewhere: all angles are off by the same."""
    off = random.uniform(5.0, 40.0) * random.choice([-1.0, 1.0])
    return replace(data, angle=np.mod(data.angle + off, 360.0))


def wrong_ratio(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """TE was computed with another ratio: a ramp over the revolution (the input turns on for both directions)."""
    used = ratio + random.choice([-1.0, 1.0, 0.01, -0.01])
    ramp = angles(data.te.shape[-1]) * (1.0 - ratio / used)
    return replace(data, te=data.te + ramp)


def column_scale(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """One of the two TE columns has a wrong factor: an amplifier, or a unit in one channel only."""
    factors = np.ones(2)
    factors[random.integers(2)] = random.choice([0.5, 0.8, 1.25, 2.0])
    return replace(data, te=data.te * factors[None, :, None])


def labels(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """8 % of the runs carry the conditions of other runs."""
    count = len(data.points)
    chosen = random.choice(count, max(2, round(SHARE_OF_WRONG_LABELS * count)), replace=False)
    order = np.arange(count)
    order[chosen] = np.roll(chosen, 1)
    points = data.points
    told = Points(points.speed[order], points.torque[order], points.temperature[order], points.when, points.number)
    return replace(data, points=told, wrong=(*data.wrong, *sorted(map(int, chosen))))


def block(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """A block of runs that follow each other was measured with another amplifier range: a factor on all of them."""
    count = len(data.points)
    length = max(3, round(count * random.uniform(0.15, 0.3)))
    start = int(random.integers(0, count - length))
    te = data.te.copy()
    te[start : start + length] *= random.choice([0.5, 2.0])
    return replace(data, te=te, wrong=(*data.wrong, *range(start, start + length)))


def delay(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """The input's encoder is read later than the output's: an offset that grows with the speed (25 deg C alike)."""
    late = random.uniform(0.4e-3, 2e-3) * random.choice([-1.0, 1.0])
    turn = 6.0 * data.points.speed / ratio * late
    return replace(data, te=data.te + (turn[:, None] * DIRECTIONS)[:, :, None])


def own_zeros(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """Each run starts where the machine was switched on: its zero is another (an encoder without a reference mark)."""
    samples = data.te.shape[-1]
    te = [np.roll(run, int(random.integers(samples)), axis=-1) for run in data.te]
    return replace(data, te=np.array(te))


def eccentric_angle(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """The encoder's disc is off centre: what it reads is off once a turn (Ernst, "Digital Length and Angle Metrology").

    The TE itself comes from elsewhere.
    """
    off = random.uniform(0.05, 0.4) * np.cos(np.radians(data.angle) + random.uniform(-np.pi, np.pi))
    return replace(data, angle=data.angle + off)


def sawtooth(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """A ratio that is a little off, in recordings that begin and end somewhere within the turn."""
    ramp = np.mod(angles(data.te.shape[-1]) - random.uniform(20.0, 340.0), 360.0) / 360.0
    return replace(data, te=data.te + random.choice([-1.0, 1.0]) * random.uniform(0.004, 0.05) * ramp)


def drift(random: np.random.Generator, data: Measured, ratio: int) -> Measured:
    """Something drifts while a turn is measured, by another amount in each run and direction."""
    part = angles(data.te.shape[-1]) / 360.0 - 0.5
    return replace(data, te=data.te + 0.02 * random.standard_normal((*data.te.shape[:2], 1)) * part)


MISTAKES: dict[str, Mistake] = {
    "arcsec": arcsec, "home_offset": home_offset, "direction": direction, "labels": labels, "sign": sign,
    "column_scale": column_scale, "ratio": wrong_ratio, "block": block, "arcmin": arcmin, "delay": delay, "rad": rad,
    "own_zeros": own_zeros, "eccentric_angle": eccentric_angle, "sawtooth": sawtooth, "drift": drift,
}  # fmt: skip
#: those that came later, see cases.LONG_PASS
LATER = ("own_zeros", "eccentric_angle", "sawtooth", "drift")
#: words by which a report may name a mistake; one of them has to stand where it speaks of the measurement
WORDS: dict[str, tuple[str, ...]] = {
    "arcsec": ("arcsec", "arc second", "seconds of arc"),
    "arcmin": ("arcmin", "arc minute", "minutes of arc"),
    "rad": ("rad ", "rad:", "rad,", "rad.", "radian", "in rad", "unit rad"),
    "sign": ("sign",),
    "direction": ("direction", "swapped", "exchanged"),
    "home_offset": ("home", "origin", "angle offset", "zero of the angle"),
    "ratio": ("ratio",),
    "column_scale": ("column", "channel", "factor of one"),
    "labels": ("label",),
    "block": ("block",),
    "delay": ("delay", "late"),
    "own_zeros": ("zero of the angle", "home"),
    "eccentric_angle": ("read wrong", "off centre"),
    "sawtooth": ("ratio", "ramp"),
    "drift": ("drift", "come back"),
}
#: words by which a report may say that the noise of the data would hide a mistake
HIDDEN: dict[str, tuple[str, ...]] = {
    "eccentric_angle": ("read wrong",),
    "drift": ("wanders within a turn",),
    "labels": ("label of another",),
    "block": ("factor of their own",),
}
#: effects that are the truth of a mistake, and known effects whose parameters it truly changes
TRUE_NAMES: dict[str, tuple[str, ...]] = {"delay": ("measurement_delay",)}
