"""Waves that no effect of a gear makes, and modulations of another form.

Sidebands: McFadden and Smith, "An explanation for the asymmetry of the modulation sidebands about the tooth meshing
frequency in epicyclic gear vibration", Proc. IMechE C 199 (1985) 65-70: what modulates may be the path of a sensor,
so that sidebands need not be a share of their mesh order. A crack: McFadden, "Detecting fatigue cracks in gears by
amplitude and phase demodulation of the meshing vibration", J. Vibration and Acoustics 108 (1986) 165-170: over a few
teeth the mesh order is another. A spall once a turn: Randall, "Vibration-based Condition Monitoring" (2011), chapter 2.
Profiles of surfaces have a power that falls with the square of the order: Sayles and Thomas, "Surface topography as a
nonstationary random process", Nature 271 (1978) 431-434.
"""

from __future__ import annotations

import numpy as np

from .mesh import Law
from .points import Array, Complex, Part, Points, Waves


def sideband_part(
    title: str, names: tuple[str, ...], order: int, distance: int, lower: complex, upper: complex, law: Law
) -> Part:
    """Two lines beside an order; their size follows a law of its own, not the order's."""

    def waves(points: Points) -> Waves:
        grown: Array = law(points)[:, None] * np.ones((1, 2))
        return {float(order - distance): grown * lower, float(order + distance): grown * upper}

    return Part(title, names, (order - distance, order + distance), waves, near=(order,))


def loose_part(title: str, order: int, size: float, seed: int) -> Part:
    """A wave whose phase is another in each run: it is not locked to the output, so no part of the gear makes it."""

    def waves(points: Points) -> Waves:
        phase = np.array([np.random.default_rng([seed, int(n)]).uniform(-np.pi, np.pi, 2) for n in points.number])
        return {float(order): size * np.exp(1j * phase)}

    return Part(title, (), (order,), waves, in_time=True)


def mains_part(hertz: float, size: float, ratio: int, seed: int) -> Part:
    """Interference at a fixed frequency in time: its order depends on the speed, its phase on the run."""

    def waves(points: Points) -> Waves:
        phase = np.array([np.random.default_rng([seed, int(n)]).uniform(-np.pi, np.pi, 2) for n in points.number])
        lines: dict[float, Complex] = {}
        for row, speed in enumerate(points.speed):
            line = float(hertz * 60.0 * ratio / speed)
            value = lines.setdefault(line, np.zeros((len(points), 2), dtype=np.complex128))
            value[row] = size * np.exp(1j * phase[row])
        return lines

    return Part(f"{hertz:g} Hz of the mains", (), (), waves, in_time=True)


def _repeated(title: str, names: tuple[str, ...], curve: Array, law: Law, **more: object) -> Part:
    """A curve over one turn (deg, even angles) that each turn repeats, its size by a law; orders up to 250."""
    waves_of = np.fft.rfft(curve)[:251] * (2.0 / len(curve))
    waves_of[0] /= 2.0

    def waves(points: Points) -> Waves:
        grown: Array = law(points)[:, None] * np.ones((1, 2))
        return {float(order): grown * wave for order, wave in enumerate(waves_of)}

    return Part(title, names, tuple(range(len(waves_of))), waves, **more)  # type: ignore[arg-type]


def _window(width: float, at: float, enters: float = 0.5) -> Array:
    """1 at the angle `at` (deg) and 0 beyond `width`: cosines in and out, `enters` the part of the way in."""
    theta = np.mod(np.arange(4000) * 0.09 - at + 180.0, 360.0) - 180.0
    into, out = 2 * width * enters, 2 * width * (1 - enters)
    x = np.where(theta < 0, theta / into, theta / out)
    return np.asarray(np.where(np.abs(x) < 1.0, 0.5 + 0.5 * np.cos(np.pi * x), 0.0))


def spall_part(size: float, width: float, at: float, touches: tuple[str, ...]) -> Part:
    """A dent that is rolled into slowly and left fast, once a turn."""
    title = f"a dent at {at:.0f} deg, {width:.1f} deg wide"
    return _repeated(title, ("local_defect", "wear"), size * _window(width, at, 0.7), lambda p: np.ones(len(p)),
                     touches=touches)  # fmt: skip


def crack_part(order: int, size: complex, width: float, at: float, law: Law, touches: tuple[str, ...]) -> Part:
    """A mesh order that is another over a few teeth."""
    theta = np.radians(np.arange(4000) * 0.09)
    curve = _window(width, at) * np.real(size * np.exp(1j * order * theta))
    title = f"order {order} is another over {width:.0f} deg at {at:.0f} deg"
    return _repeated(title, ("local_mesh_defect",), curve, law, touches=touches)


def texture_part(size: float, seed: int, touches: tuple[str, ...], hedged: tuple[str, ...]) -> Part:
    """A profile that each turn repeats: all orders from 4 on, their power falls with the square of the order."""
    random = np.random.default_rng(seed)
    orders = np.arange(4, 251)
    wave = (random.standard_normal(247) + 1j * random.standard_normal(247)) / orders
    wave *= size / np.sqrt((np.abs(wave) ** 2).sum() / 2)
    curve = (wave @ np.exp(1j * np.outer(orders, np.radians(np.arange(4000) * 0.09)))).real
    return _repeated("the texture of a surface, in all orders", (), curve, lambda p: np.ones(len(p)), touches=touches,
                     hedged=hedged)  # fmt: skip
