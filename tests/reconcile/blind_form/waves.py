"""Waves that no effect of a gear makes, and modulations of another form.

Sidebands: McFadden and Smith, "An explanation for the asymmetry of the modulation sidebands about the tooth meshing
frequency in epicyclic gear vibration", Proc. IMechE C 199 (1985) 65-70: what modulates may be the path of a sensor,
so that sidebands need not be a share of their mesh order.
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
