"""Effects on the mean of the transmission error (order 0): elasticity, clearance, drag, heat."""

from __future__ import annotations

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.effects.base import ARCMIN, Effect, Form, Scalar


class _MeanEffect(Effect):
    """An effect on order 0 alone."""

    def touched_orders(self) -> tuple[int, ...]:
        return (0,)


class TorsionalCompliance(_MeanEffect):
    """The transmission twists in proportion to the load."""

    name = "torsional_compliance"
    title = "torsional compliance of the transmission"
    scalars = (
        Scalar(
            "stiffness_Nm_per_arcmin", "Nm/arcmin", 0.5, 20000, "torsional stiffness at the output", None, Form.INVERSE
        ),
    )

    def coefficient(self, at: Conditions, order: int) -> FloatArray:
        return -at.sign * at.torque_Nm / self.scalar("stiffness_Nm_per_arcmin") * ARCMIN


class HangingLoadCompliance(_MeanEffect):
    """The transmission twists under a load that pulls the same way whichever way it turns: a weight on an arm."""

    name = "hanging_load_compliance"
    title = "torsional compliance under a load that keeps its direction"
    scalars = TorsionalCompliance.scalars

    def coefficient(self, at: Conditions, order: int) -> FloatArray:
        return -at.torque_Nm / self.scalar("stiffness_Nm_per_arcmin") * ARCMIN


class Backlash(_MeanEffect):
    """Clearance between the flanks, closed by a small load."""

    name = "backlash"
    title = "backlash between the flanks"
    scalars = (
        Scalar("gap_arcmin", "arcmin", 0, 20, "whole clearance at the output", None),
        Scalar(
            "seating_torque_Nm", "Nm", 5, 150, "load that closes 76 % of it", None, Form.SHAPE, (50, 25, 90, 10, 140)
        ),
    )

    def coefficient(self, at: Conditions, order: int) -> FloatArray:
        seated = np.tanh(at.torque_Nm / self.scalar("seating_torque_Nm"))
        return -at.sign * (self.scalar("gap_arcmin") * ARCMIN / 2) * seated


class FrictionWindup(_MeanEffect):
    """Drag winds the transmission up; its viscous part grows with speed and fades with warmth, its mixed part falls.

    The part that falls with speed is the Stribeck curve's, with an exponent of 1 (Tustin 1947), from 0.5 to 1 (Bo and
    Pavelescu 1982) or 2 (Armstrong-Helouvry; all in Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7),
    1994); it depends on speed times viscosity, as the oil film does.
    """

    name = "friction_windup"
    title = "wind-up by friction"
    scalars = (
        Scalar("coulomb_arcmin", "arcmin", 0, 5, "wind-up by dry friction"),
        Scalar("viscous_arcmin_per_krpm", "arcmin/krpm", 0, 5, "wind-up by the oil at the reference temperature"),
        Scalar(
            "viscosity_decay_per_K",
            "1/K",
            0.01,
            0.2,
            "fall of the viscosity",
            0.04,
            Form.SHAPE,
            (0.02, 0.04, 0.08),
            "viscous_arcmin_per_krpm",
        ),
        Scalar(
            "stribeck_arcmin",
            "arcmin",
            0,
            5,
            "wind-up at standstill that a film of oil takes away with speed",
            beside="coulomb_arcmin",
        ),
        Scalar(
            "stribeck_speed_rpm",
            "rpm",
            30,
            1000,
            "speed at which it has fallen to 37 % at the reference temperature",
            300.0,
            Form.SHAPE,
            (100, 300, 800),
            "stribeck_arcmin",
        ),
        Scalar(
            "stribeck_exponent",
            "",
            0.4,
            4,
            "how suddenly it falls: 1 as an exponential, 2 as a bell, more from one level to another",
            1.0,
            Form.FIXED,
            (2,),
            "stribeck_arcmin",
        ),
    )

    def coefficient(self, at: Conditions, order: int) -> FloatArray:
        warmer = at.temperature_C - self.constants.reference_temperature_C
        fading = np.exp(-self.scalar("viscosity_decay_per_K") * warmer)
        viscous = self.scalar("viscous_arcmin_per_krpm") * at.speed_rpm / 1000 * fading
        film = at.speed_rpm / self.scalar("stribeck_speed_rpm") * fading
        mixed = self.scalar("stribeck_arcmin") * np.exp(-(film ** self.scalar("stribeck_exponent")))
        return -at.sign * (self.scalar("coulomb_arcmin") + viscous + mixed) * ARCMIN


class ThermalDrift(_MeanEffect):
    """Thermal expansion turns the encoders against each other."""

    name = "thermal_drift"
    title = "thermal drift of the mean"
    scalars = (Scalar("drift_arcmin_per_K", "arcmin/K", -2, 2, "shift of the mean a kelvin", None),)

    def coefficient(self, at: Conditions, order: int) -> FloatArray:
        warmer = at.temperature_C - self.constants.reference_temperature_C
        return self.scalar("drift_arcmin_per_K") * ARCMIN * warmer
