"""Errors of shafts and encoders: a few waves a revolution of the output."""

from __future__ import annotations

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray
from st_codegen.rig.effects.base import Effect, Form, Phasor, Scalar


class _Wave(Effect):
    """An effect on one low order."""

    def wave_order(self) -> int:
        """The order."""
        raise NotImplementedError

    def touched_orders(self) -> tuple[int, ...]:
        return (self.wave_order(),)

    def wave(self, at: Conditions) -> ComplexArray:
        """The coefficient, complex128 (n,), deg."""
        return self.complex_at("amplitude_deg", at)

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        return self.wave(at)


class OutputShaftEccentricity(_Wave):
    """The output shaft runs out, more so under load."""

    name = "output_shaft_eccentricity"
    title = "eccentricity of the output shaft"
    scalars = (
        Scalar("growth_per_kNm", "1/kNm", 0, 5, "relative growth with the load", 0.0, Form.SHAPE, (0.05, 0.3, 1.0)),
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude without load"),)

    def wave_order(self) -> int:
        return 1

    def wave(self, at: Conditions) -> ComplexArray:
        growth = 1 + self.scalar("growth_per_kNm") * at.torque_Nm / 1000
        return self.complex_at("amplitude_deg", at) * growth


class EncoderEccentricity(_Wave):
    """The output encoder's ring sits off centre."""

    name = "encoder_eccentricity"
    title = "eccentricity of the output encoder"
    experiment = (
        "turn the output encoder by 90 deg against the shaft and measure again: the phase of order 1 turns with an "
        "eccentric encoder, and stays with an eccentric shaft"
    )
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude"),)

    def wave_order(self) -> int:
        return 1


class OutputShaftOvality(_Wave):
    """Shaft, bearing seat or encoder ring are oval."""

    name = "output_shaft_ovality"
    title = "ovality of the output shaft"
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude"),)

    def wave_order(self) -> int:
        return 2


class CrankMisalignment(_Wave):
    """The crankshafts do not share the load evenly."""

    name = "crank_misalignment"
    title = "misalignment of the crankshafts"
    phasors = (
        Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude without load", own_flanks=True),
        Phasor("slope_deg_per_kNm", "slope_phase_rad", "deg/kNm", 1, "load part", required=False, own_flanks=True),
    )

    def wave_order(self) -> int:
        return self.constants.cranks

    def wave(self, at: Conditions) -> ComplexArray:
        load = self.complex_at("slope_deg_per_kNm", at) * at.torque_Nm / 1000
        return self.complex_at("amplitude_deg", at) + load
