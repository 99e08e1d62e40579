"""Errors of teeth, pins and the fast shaft: orders of the mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray
from st_codegen.rig.effects.base import Constants, Phasor, Wave


class _MeshError(Wave):
    """An error of shape: constant at all operating points, one order a table."""

    orders_key = "order"
    orders_of: ClassVar[Callable[[Constants], tuple[int, ...]]]
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude", own_flanks=True),)

    @classmethod
    def allowed_orders(cls, constants: Constants) -> tuple[int, ...]:
        return cls.orders_of(constants)


class CycloidToothError(_MeshError):
    """Shape and pitch of the cycloid's teeth."""

    name = "cycloid_tooth_error"
    title = "error of the cycloid's teeth"
    orders_of = Constants.tooth_orders


class PinError(_MeshError):
    """Shape and pitch of the pins."""

    name = "pin_error"
    title = "error of the pins"
    orders_of = Constants.pin_orders


class InputShaftMisalignment(_MeshError):
    """A bent or tilted fast shaft."""

    name = "input_shaft_misalignment"
    title = "misalignment of the input shaft"
    orders_of = Constants.shaft_orders


class LoadDependentMesh(_MeshError):
    """Teeth and pins give way under load once a mesh."""

    name = "load_dependent_mesh"
    title = "mesh order that grows with the load"
    phasors = (
        Phasor("slope_deg_per_kNm", "phase_rad", "deg/kNm", 100, "growth with the load", own_flanks=True, typical=1),
    )
    orders_of = Constants.mesh_orders

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        return super().coefficient(at, order) * at.torque_Nm / 1000
