"""A two-mass oscillator with clearance and Stribeck friction, integrated in time.

Equation of motion of the load against the driven side, in deg of the output, after Kahraman and Singh, "Non-linear
dynamics of a spur gear pair", J. Sound and Vibration 142 (1990) 49-75, with the friction of Armstrong-Helouvry,
Dupont and Canudas de Wit, "A survey of models, analysis tools and compensation methods", Automatica 30 (1994)
1083-1138:

    x'' = -w0^2 * g(x - e) - 2 * zeta * w0 * (x' - e') - w0^2 * (M + Mf(v)) / K

with the kinematic excitation e(theta), and g the play: 0 inside the clearance, the excess outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .points import DIRECTIONS, Array, Complex, Points, Waves

#: integration: steps of one revolution, and how much of a revolution passes before it, so that transients are gone
STEPS = 6720
WARM_UP = 2688


@dataclass(frozen=True)
class Stribeck:
    """Friction torque at a speed of the output: Mc + (Ms - Mc) * exp(-(v/vs)^2) + viscous * v (N m, rpm)."""

    coulomb: float
    static: float
    stribeck_rpm: float
    viscous: float

    def torque(self, output_rpm: Array) -> Array:
        drop = np.exp(-((output_rpm / self.stribeck_rpm) ** 2))
        return np.asarray(self.coulomb + (self.static - self.coulomb) * drop + self.viscous * output_rpm)


@dataclass(frozen=True)
class Oscillator:
    """`stiffness` in N m per deg; `clearance_deg` is half the play; `excitation`: order -> complex deg."""

    frequency_Hz: float
    damping: float
    stiffness: float
    clearance_deg: float
    excitation: dict[int, complex]
    friction: Stribeck | None = None

    def run(self, points: Points, ratio: int, steps: int = STEPS, warm_up: int = WARM_UP) -> Array:
        """x in deg at even angles of one revolution, (points, 2, steps), by the Runge-Kutta method of order 4."""
        w0 = 2 * np.pi * self.frequency_Hz
        output_rpm = points.speed / ratio
        omega = (2 * np.pi * output_rpm / 60.0)[:, None]
        dt = (60.0 / output_rpm / steps)[:, None]
        # both sides in their own sense of turning: the angle of the backward run falls
        sense = DIRECTIONS[None, :]
        load = points.torque[:, None] / self.stiffness
        orders = np.array(list(self.excitation), dtype=np.float64)
        size = np.array(list(self.excitation.values()))
        half = self.clearance_deg
        friction = self.friction

        # every half step of a revolution, for both senses; the angle repeats itself
        turned = np.exp(1j * np.arange(2 * steps)[:, None, None] * (np.pi / steps) * orders * DIRECTIONS[:, None])
        wave = size * turned
        moved, slope = wave.real.sum(axis=-1), -(orders * wave).imag.sum(axis=-1)

        def pull(x: Array, v: Array, half_steps: int) -> Array:
            row = half_steps % (2 * steps)
            stretch = x - moved[row]
            spring = stretch - np.clip(stretch, -half, half)
            drag = 2 * self.damping * w0 * (v - slope[row] * sense * omega)
            force = -(w0**2) * (spring + load) - drag
            if friction is not None:
                turning = np.abs(output_rpm[:, None] + sense * v / 6.0)
                force = force - w0**2 * sense * friction.torque(turning) / self.stiffness
            return np.asarray(force)

        start = -(load + np.zeros((1, 2))) - half * np.sign(load + 1e-12)
        if friction is not None:
            start = start - sense * friction.torque(output_rpm[:, None]) / self.stiffness
        x, v = start, np.zeros_like(start)
        out = np.empty((*start.shape, steps))
        for step in range(-warm_up, steps):
            if step >= 0:
                out[..., step] = x
            at = 2 * step
            k1 = pull(x, v, at)
            k2 = pull(x + 0.5 * dt * v, v + 0.5 * dt * k1, at + 1)
            k3 = pull(x + 0.5 * dt * v + 0.25 * dt**2 * k1, v + 0.5 * dt * k2, at + 1)
            k4 = pull(x + dt * v + 0.5 * dt**2 * k2, v + dt * k3, at + 2)
            x = x + dt * v + dt**2 / 6.0 * (k1 + k2 + k3)
            v = v + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        # at the same angles for both senses of turning
        out[:, 1] = np.concatenate([out[:, 1, :1], out[:, 1, :0:-1]], axis=-1)
        return out

    def static(self, points: Points) -> Array:
        """What load and clearance alone make: the part that a rig model without an oscillator has already."""
        load = points.both(points.torque / self.stiffness)
        return np.asarray(-load - self.clearance_deg * np.sign(load + 1e-12))

    def waves(self, points: Points, ratio: int) -> Waves:
        """Mean beyond `static` and the orders of the excitation, their neighbours by intermodulation included."""
        te = self.run(points, ratio)
        te = te - self.static(points)[..., None]
        found: Complex = np.fft.rfft(te, axis=-1) * (2.0 / te.shape[-1])
        found[..., 0] /= 2.0
        lines = {0, *self.excitation}
        first = min(self.excitation)
        # clearance mixes orders: multiples of their distance around the lowest, and harmonics
        for one in self.excitation:
            lines |= {abs(one - other) for other in self.excitation} | {2 * one, 2 * first - one, 2 * one - first}
        return {float(order): found[..., order] for order in sorted(lines) if 0 <= order <= 2 * max(self.excitation)}
