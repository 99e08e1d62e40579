"""Errors of shafts and encoders: a few waves a revolution of the output."""

from __future__ import annotations

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray
from st_codegen.rig.effects.base import Form, Phasor, Scalar, Wave


class _Eccentricity(Wave):
    """A wave a revolution."""

    def touched_orders(self) -> tuple[int, ...]:
        return (1,)


class OutputShaftEccentricity(_Eccentricity):
    """The output shaft runs out, more so under load."""

    name = "output_shaft_eccentricity"
    title = "eccentricity of the output shaft"
    scalars = (
        Scalar("growth_per_kNm", "1/kNm", 0, 5, "relative growth with the load", 0.0, Form.SHAPE, (0.05, 0.3, 1.0)),
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude without load"),)

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        growth = 1 + self.scalar("growth_per_kNm") * at.torque_Nm / 1000
        return super().coefficient(at, order) * growth


class EncoderEccentricity(_Eccentricity):
    """The output encoder's ring sits off centre."""

    name = "encoder_eccentricity"
    title = "eccentricity of the output encoder"
    experiment = (
        "turn the output encoder by 90 deg against the shaft and measure again: the phase of order 1 turns with an "
        "eccentric encoder, and stays with an eccentric shaft"
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude"),)


class OutputShaftOvality(Wave):
    """Shaft, bearing seat or encoder ring are oval."""

    name = "output_shaft_ovality"
    title = "ovality of the output shaft"
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude"),)

    def touched_orders(self) -> tuple[int, ...]:
        return (2,)


class CrankMisalignment(Wave):
    """The crankshafts do not share the load evenly."""

    name = "crank_misalignment"
    title = "misalignment of the crankshafts"
    phasors = (
        Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude without load", own_flanks=True),
        Phasor(
            "slope_deg_per_kNm",
            "slope_phase_rad",
            "deg/kNm",
            100,
            "load part",
            required=False,
            own_flanks=True,
            typical=1,
        ),
    )

    def touched_orders(self) -> tuple[int, ...]:
        return (self.constants.cranks,)

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        load = self.complex_at("slope_deg_per_kNm", at) * at.torque_Nm / 1000
        return super().coefficient(at, order) + load
