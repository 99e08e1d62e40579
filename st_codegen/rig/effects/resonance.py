"""A natural frequency of the rig's structure, excited by the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, IntArray
from st_codegen.rig.effects.base import Effect, Form, Phasor, Scalar, Stage


class StructuralResonance(Effect):
    """Orders that peak where their frequency meets the structure's."""

    name = "structural_resonance"
    title = "resonance of the structure"
    orders_key = "orders"
    stage = Stage.STRUCTURE
    scalars = (
        Scalar("frequency_Hz", "Hz", 5, 500, "natural frequency", None, Form.SHAPE),
        Scalar("damping_ratio", "", 0.003, 0.3, "damping ratio", None, Form.SHAPE, (0.01, 0.03, 0.1)),
        Scalar(
            "frequency_per_kNm",
            "1/kNm",
            -0.2,
            0.2,
            "relative change of the frequency with the load",
            0.0,
            Form.SHAPE,
            (-0.1, -0.05, 0.05, 0.1),
        ),
        Scalar(
            "frequency_per_10K",
            "1/10K",
            -0.2,
            0.2,
            "relative change of the frequency with the oil temperature",
            0.0,
            Form.SHAPE,
            (-0.1, -0.05, 0.05, 0.1),
        ),
        Scalar("growth_per_kNm", "1/kNm", 0, 5, "relative growth with the load", 0.0, Form.SHAPE, (0.0, 0.5, 2.0)),
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "height at the resonance", own_flanks=True),)

    def response(self, at: Conditions, order: Any) -> Any:
        """H at the frequencies of an order, conjugate backward; (n,), or (n, orders) for an array of orders (1, K)."""
        speed, sign, torque, temperature = at.speed_rpm, at.sign, at.torque_Nm, at.temperature_C
        if isinstance(order, np.ndarray):
            speed, sign, torque, temperature = (part[:, None] for part in (speed, sign, torque, temperature))
        ratio = speed * (order / (60 * self.constants.reduction_ratio * self.scalar("frequency_Hz")))
        if "frequency_per_kNm" in self.values or "frequency_per_10K" in self.values:
            warmer = (temperature - self.constants.reference_temperature_C) / 10.0
            ratio = ratio / (
                1.0 + self.scalar("frequency_per_kNm") * (torque / 1000.0) + self.scalar("frequency_per_10K") * warmer
            )
        damping, square = self.scalar("damping_ratio"), ratio * ratio
        return 2 * damping * square / (1 - square + (2j * damping * sign) * ratio)

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        height = self.complex_at("amplitude_deg", at, self.orders.index(order))
        growth = 1 + self.scalar("growth_per_kNm") * at.torque_Nm / 1000
        found: ComplexArray = height * growth * self.response(at, order)
        return found

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        """The same for all orders at once."""
        found = np.zeros((len(at), len(orders)), np.complex128)
        wanted = set(orders.tolist())
        heights = {
            order: [self.complex_value("amplitude_deg", side, index) for side in (False, True)]
            for index, order in enumerate(self.orders)
            if order in wanted
        }
        acting = {order: sides for order, sides in heights.items() if any(sides)}
        if acting:
            own = np.array(list(acting))
            height = np.where(at.sign[:, None] > 0, *np.array(list(acting.values())).T[:, None, :])
            growth = 1 + self.scalar("growth_per_kNm") * at.torque_Nm / 1000
            response = self.response(at, own[None, :])
            # orders are rising wherever coefficients are computed
            found[:, np.searchsorted(orders, own)] = height * growth[:, None] * response
        return found
