"""A natural frequency of the rig's structure, excited by the mesh."""

from __future__ import annotations

from typing import Any

from st_codegen.rig.effects.base import (
    ComplexArray,
    Conditions,
    Effect,
    Form,
    Phasor,
    Scalar,
    Stage,
)


class StructuralResonance(Effect):
    """Orders that peak where their frequency meets the structure's."""

    name = "structural_resonance"
    title = "resonance of the structure"
    orders_key = "orders"
    stage = Stage.STRUCTURE
    scalars = (
        Scalar("frequency_Hz", "Hz", 5, 500, "natural frequency", None, Form.SHAPE),
        Scalar("damping_ratio", "", 0.003, 0.3, "damping ratio", None, Form.SHAPE, (0.01, 0.03, 0.1)),
        Scalar("growth_per_kNm", "1/kNm", 0, 5, "relative growth with the load", 0.0, Form.SHAPE, (0.0, 0.5, 2.0)),
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "height at the resonance", own_flanks=True),)

    def response(self, at: Conditions, order: int) -> ComplexArray:
        """H at the frequency of an order, conjugate backward, complex128 (n,)."""
        ratio: Any = at.speed_rpm * (order / (60 * self.constants.reduction_ratio * self.scalar("frequency_Hz")))
        damping, square = self.scalar("damping_ratio"), ratio * ratio
        found: ComplexArray = 2 * damping * square / (1 - square + (2j * damping * at.sign) * ratio)
        return found

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        height = self.complex_at("amplitude_deg", at, self.orders.index(order))
        growth = 1 + self.scalar("growth_per_kNm") * at.torque_Nm / 1000
        found: ComplexArray = height * growth * self.response(at, order)
        return found
