"""Errors of teeth, pins and the fast shaft: orders of the mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.files.toml_tables import TomlTable
from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.rig.effects.base import Constants, Form, Phasor, Scalar, Stage, Wave


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
    """Teeth and pins give way under load once a mesh.

    In proportion to it as a spring does, with the power 2/3 as two bodies that touch in a point (Johnson, "Contact
    Mechanics", 1985, equation 4.23), or with a power above 1 where more of the path lies in play.
    """

    name = "load_dependent_mesh"
    title = "mesh order that grows with the load"
    scalars = (
        Scalar(
            "exponent",
            "",
            0.3,
            3,
            "power of the load: 1 in proportion, 2/3 as a contact in a point",
            1.0,
            Form.FIXED,
            (2 / 3, 2),
            "slope_deg_per_kNm",
        ),
        Scalar(
            "modulated",
            "",
            0,
            1,
            "1: the carrier modulates the growth with the rest of its order, 0: its sidebands do not follow",
            1.0,
            Form.FIXED,
            (0,),
            "slope_deg_per_kNm",
        ),
    )
    phasors = (
        Phasor("slope_deg_per_kNm", "phase_rad", "deg/kNm", 100, "growth with the load", own_flanks=True, typical=1),
    )
    orders_of = Constants.mesh_orders

    def __init__(self, values: Mapping[str, Any], constants: Constants, *, check: bool = True) -> None:
        super().__init__(values, constants, check=check)
        if self.values.get("modulated") == 0.0:
            self.stage = Stage.STRUCTURE

    def check(self, table: TomlTable) -> None:
        """Note whatever is wrong with the values."""
        super().check(table)
        value = self.values.get("modulated")
        if isinstance(value, float) and 0.0 < value < 1.0:
            table.note("'modulated' is neither 0 nor 1")

    def units(self) -> dict[str, str]:
        """The unit of the value of each key: that of a growth holds the power of the load."""
        power = self.scalar("exponent")
        own = {"deg/kNm": "deg/kNm" if power == 1.0 else f"deg/kNm^{power:.3g}"}
        return {key: own.get(unit, unit) for key, unit in super().units().items()}

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        exponent = self.scalar("exponent")
        wave = super().coefficient(at, order)
        if exponent == 1.0:
            return wave * at.torque_Nm / 1000
        # a load of the other sign winds the mesh up the other way
        against, along = (np.maximum(torque, 0.0) / 1000 for torque in (at.torque_Nm, -at.torque_Nm))
        load: FloatArray = against**exponent - along**exponent
        return wave * load
