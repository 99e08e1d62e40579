"""Delays of the measuring chain."""

from __future__ import annotations

import math

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, IntArray
from st_codegen.rig.effects.base import Effect, Form, Scalar, Stage


class MeasurementDelay(Effect):
    """The transmission error is stored late, or one encoder is read later than the other."""

    name = "measurement_delay"
    title = "delay of the measuring chain"
    stage = Stage.MEASURING
    scalars = (
        Scalar("delay_us", "us", 0, 20000, "of the error against its angle", 0.0, Form.SHAPE, (100, 500, 2000)),
        Scalar("skew_us", "us", -2000, 2000, "of the output encoder against the input encoder"),
    )

    def touched_orders(self) -> tuple[int, ...]:
        return (0,)

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        found = np.zeros((len(at), len(orders)), np.complex128)
        skew = -np.rad2deg(at.output_rad_s(self.constants.reduction_ratio)) * self.scalar("skew_us") * 1e-6
        found[:, orders == 0] = skew[:, None]
        return found

    def passed_on(self, at: Conditions, orders: IntArray, coefficients: ComplexArray) -> ComplexArray:
        return self.passed_on_change(at, orders, coefficients) + self.contribution(at, orders)

    def passed_on_change(self, at: Conditions, orders: IntArray, change: ComplexArray) -> ComplexArray:
        delay = self.scalar("delay_us") * 1e-6
        if math.isclose(delay, 0.0, abs_tol=1e-15):
            return change
        turned: ComplexArray = change.copy()
        # most changes touch few orders
        touched = np.flatnonzero(change.any(axis=0))
        turned[:, touched] *= np.exp(
            -1j * delay * np.outer(at.output_rad_s(self.constants.reduction_ratio), orders[touched])
        )
        return turned
