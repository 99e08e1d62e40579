"""What happens at one angle of the output: a worn sector, a local defect."""

from __future__ import annotations

import math

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, IntArray
from st_codegen.rig.effects.base import ARCMIN, Constants, Effect, Form, Phasor, Scalar, Stage


class Wear(Effect):
    """A notch at a fixed angle, whose sign turns with the direction of motion."""

    name = "wear"
    title = "worn sector of the pin ring or the output bearing"
    scalars = (
        Scalar("depth_arcmin", "arcmin", 0, 10, "depth of the notch", None),
        Scalar(
            "centre_deg", "deg", -30, 390, "its angle of the output shaft", None, Form.SHAPE, tuple(range(15, 360, 30))
        ),
        Scalar("width_deg", "deg", 4, 60, "its half width", None, Form.SHAPE, (8, 20, 40)),
    )

    def touched_orders(self) -> tuple[int, ...]:
        """From the mean to where the spectrum has fallen by exp(-18)."""
        return tuple(range(math.ceil(6 / math.radians(self.scalar("width_deg"))) + 2))

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        from scipy.special import ive  # exp(-kappa) * I_k(kappa), I_k the modified Bessel functions

        centre, width = math.radians(self.scalar("centre_deg")), math.radians(self.scalar("width_deg"))
        count = len(self.touched_orders())
        spectrum = np.zeros(max(count, int(orders.max(initial=0)) + 1))
        spectrum[:count] = ive(np.arange(count), 1 / width**2)
        spectrum[1:] *= 2
        shape = spectrum[orders] * np.exp(-1j * orders * centre)
        depth = -at.sign * self.scalar("depth_arcmin") * ARCMIN
        found: ComplexArray = depth[:, None] * shape
        return found


def bump(orders: IntArray, centre_deg: float, width_deg: float) -> ComplexArray:
    """The waves of exp(-(theta - centre)^2 / (2 width^2)) over a turn, as one-sided sums have them, (len(orders),)."""
    centre, width = math.radians(centre_deg), math.radians(width_deg)
    shape = width / math.sqrt(2 * math.pi) * np.exp(-0.5 * (orders * width) ** 2 - 1j * orders * centre)
    return np.where(np.abs(orders) * width <= _FALLEN, shape, 0.0)


#: orders times width (rad) at which the waves of a bump have fallen by exp(-18)
_FALLEN = 6.0
_CENTRE = Scalar("centre_deg", "deg", -30, 390, "its angle of the output shaft", None, Form.SHAPE)


class LocalDefect(Effect):
    """A bump or a dip at a fixed angle, too short for any wave: it stands in all orders alike."""

    name = "local_defect"
    title = "local defect at one angle of the output"
    stage = Stage.STRUCTURE
    least_foreign = 8
    scalars = (
        Scalar("height_deg", "deg", -1, 1, "height of the bump, in both directions", None),
        Scalar("turning_deg", "deg", -1, 1, "part whose sign turns with the direction"),
        Scalar("slope_deg_per_kNm", "deg/kNm", -1, 1, "growth of the height with the torque"),
        Scalar("turning_slope_deg_per_kNm", "deg/kNm", -1, 1, "growth of the part whose sign turns"),
        _CENTRE,
        Scalar("width_deg", "deg", 0.5, 6, "its half width", None, Form.SHAPE, (0.7, 1.5, 3)),
    )

    def touched_orders(self) -> tuple[int, ...]:
        return tuple(range(math.ceil(_FALLEN / math.radians(self.scalar("width_deg"))) + 1))

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        load = at.torque_Nm / 1000.0
        same = self.scalar("height_deg") + self.scalar("slope_deg_per_kNm") * load
        turning = self.scalar("turning_deg") + self.scalar("turning_slope_deg_per_kNm") * load
        shape = bump(orders, self.scalar("centre_deg"), self.scalar("width_deg"))
        return (same + at.sign * turning)[:, None] * np.where(orders == 0, 1.0, 2.0) * shape


class LocalMeshDefect(Effect):
    """A mesh order that is larger at one angle of the output: it has sidebands at every distance."""

    name = "local_mesh_defect"
    title = "local defect of teeth or pins: a mesh order that is larger at one angle of the output"
    stage = Stage.STRUCTURE
    orders_key = "order"
    least_foreign = 8
    # of a few teeth: what is wider modulates the whole turn
    scalars = (
        _CENTRE,
        Scalar("width_deg", "deg", 0.5, 20, "its half width", None, Form.SHAPE, (0.7, 1.5, 3, 7)),
    )
    phasors = (
        Phasor("amplitude_deg", "phase_rad", "deg", 1, "its wave at that angle without load", own_flanks=True),
        Phasor("slope_deg_per_kNm", "slope_phase_rad", "deg/kNm", 1, "load part", required=False, own_flanks=True),
    )

    @classmethod
    def allowed_orders(cls, constants: Constants) -> tuple[int, ...]:
        return constants.mesh_orders()

    def touched_orders(self) -> tuple[int, ...]:
        reach = math.ceil(_FALLEN / math.radians(self.scalar("width_deg")))
        return tuple(range(max(self.orders[0] - reach, 1), self.orders[0] + reach + 1))

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        shape = bump(orders - self.orders[0], self.scalar("centre_deg"), self.scalar("width_deg"))
        wave = self.complex_at("amplitude_deg", at) + self.complex_at("slope_deg_per_kNm", at) * at.torque_Nm / 1000.0
        return wave[:, None] * np.where(orders == 0, 0.0, shape)
