"""Resonances that are not one oscillator's: drifting, split, of two states, damped by load.

Response of a mode to a kinematic excitation, Thomson and Dahleh, "Theory of Vibration with Applications" (5th ed.,
1998), chapter 3: relative motion r^2 / (1 - r^2 + 2i*zeta*r), or receptance 1 / (1 - r^2 + 2i*zeta*r), r = f / f0.
Frequencies that fall as contacts open, or rise with preload, are common in gear trains; so are pairs of modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .points import Array, Complex, Part, Points, Waves


@dataclass(frozen=True)
class Mode:
    """Frequency and damping over the operating points; `relative`: displacement relative to the base."""

    hertz: Callable[[Points], Array]
    damping: Callable[[Points], Array]
    relative: bool

    def response(self, points: Points, order: int, ratio: int) -> Complex:
        r = points.hertz(order, ratio) / self.hertz(points)
        top = r**2 if self.relative else np.ones_like(r)
        return np.asarray(top / (1.0 - r**2 + 2j * self.damping(points) * r))


def constant(value: float) -> Callable[[Points], Array]:
    return lambda points: np.full(len(points), value)


def falling(value: float, share: float, over: str, low: float, high: float) -> Callable[[Points], Array]:
    """`value` at `low`, smaller by `share` at `high` of the condition `over` (softening as contacts open)."""

    def at(points: Points) -> Array:
        part = (getattr(points, over) - low) / (high - low)
        return np.asarray(value * (1.0 - share * part))

    return at


def states(cold: float, warm: float, edge_C: float) -> Callable[[Points], Array]:
    """One value below a temperature, another above: grease that has run in, a seal that has let go."""
    return lambda points: np.where(points.temperature < edge_C, cold, warm)


def modal_part(
    title: str, modes: tuple[Mode, ...], sizes: dict[int, Complex], ratio: int, hertz: tuple[float, float]
) -> Part:
    """Each order drives each mode: `sizes[order]` has the shape (modes, 2), forward and backward.

    Turning backward the angle falls in time: exp(i*k*theta) turns the other way, and the lag is the conjugate.
    """

    def both(response: Complex) -> Complex:
        return np.stack([response, response.conj()], axis=1)

    def waves(points: Points) -> Waves:
        return {
            float(order): sum(
                both(mode.response(points, order, ratio)) * size[None, :]
                for mode, size in zip(modes, table, strict=True)
            )
            for order, table in sizes.items()
        }

    return Part(title, ("structural_resonance",), tuple(sizes), waves, hertz=hertz)


def draw_sizes(random: np.random.Generator, orders: tuple[int, ...], modes: int, damping: float) -> dict[int, Complex]:
    """Excitations such that peaks are 3e-3 to 8e-3 deg."""
    out = {}
    for order in orders:
        peak = random.uniform(3e-3, 8e-3) * random.uniform(0.7, 1.3, (modes, 2))
        phase = random.uniform(-np.pi, np.pi, (1, 2)) + random.uniform(-0.8, 0.8, (modes, 2))
        out[order] = np.asarray(2 * damping * peak * np.exp(1j * phase))
    return out
