"""A worn sector: more lost motion at one angle."""

from __future__ import annotations

import math

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.rig.effects.base import ARCMIN, Effect, Form, Scalar


def bessel_ratios(kappa: float, count: int) -> FloatArray:
    """exp(-kappa) * I_k(kappa) for k = 0 .. count-1, I_k the modified Bessel functions, float64 (count,).

    Miller's backward recurrence, normalised by exp(kappa) = I_0 + 2*(I_1 + I_2 + ..); relative error below 1e-12.
    """
    start = count + 20 + int(8 * math.sqrt(kappa)) + int(kappa > 0) * 20
    values = np.zeros(start + 2)
    values[start] = 1e-300
    for k in range(start, 0, -1):
        values[k - 1] = values[k + 1] + 2 * k / kappa * values[k]
        if values[k - 1] > 1e200:
            values *= 1e-200
    found: FloatArray = values[:count] / (values[0] + 2 * values[1:].sum())
    return found


class Wear(Effect):
    """A notch at a fixed angle, whose sign turns with the direction of motion."""

    name = "wear"
    title = "worn sector of the pin ring or the output bearing"
    scalars = (
        Scalar("depth_arcmin", "arcmin", 0, 10, "depth of the notch", None),
        Scalar(
            "centre_deg", "deg", 0, 360, "its angle of the output shaft", None, Form.SHAPE, tuple(range(15, 360, 30))
        ),
        Scalar("width_deg", "deg", 4, 60, "its half width", None, Form.SHAPE, (8, 20, 40)),
    )

    def touched_orders(self) -> tuple[int, ...]:
        """From the mean to where the spectrum has fallen by exp(-18)."""
        return tuple(range(math.ceil(6 / math.radians(self.scalar("width_deg"))) + 2))

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        centre, width = math.radians(self.scalar("centre_deg")), math.radians(self.scalar("width_deg"))
        count = len(self.touched_orders())
        spectrum = np.zeros(max(count, int(orders.max(initial=0)) + 1))
        spectrum[:count] = bessel_ratios(1 / width**2, count)
        spectrum[1:] *= 2
        shape = spectrum[orders] * np.exp(-1j * orders * centre)
        depth = -at.sign * self.scalar("depth_arcmin") * ARCMIN
        found: ComplexArray = depth[:, None] * shape
        return found
