"""Sidebands of mesh orders: the carrier turns once a revolution and modulates the mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, IntArray
from st_codegen.rig.effects.base import Constants, Effect, Phasor, Stage


class CarrierModulation(Effect):
    """Sidebands of plus and minus `cranks` around a mesh order, in proportion to it or of constant size.

    What the carrier modulates may be the unloaded part of the mesh alone, or the path to the sensor (McFadden and
    Smith, Proc. IMechE C 199, 1985): then the sidebands stay as they are while the mesh order grows with the load.
    """

    name = "carrier_modulation"
    title = "modulation of a mesh order by the carrier (sidebands)"
    orders_key = "order"
    stage = Stage.MODULATION
    phasors = (
        Phasor("lower_ratio", "lower_phase_rad", "", 5, "lower sideband over the mesh order", required=False),
        Phasor("upper_ratio", "upper_phase_rad", "", 5, "upper sideband over the mesh order", required=False),
        Phasor("lower_deg", "lower_deg_phase_rad", "deg", 1, "constant lower sideband", False, beside="upper_deg"),
        Phasor("upper_deg", "upper_deg_phase_rad", "deg", 1, "constant upper sideband", False, beside="lower_deg"),
    )

    @classmethod
    def allowed_orders(cls, constants: Constants) -> tuple[int, ...]:
        return constants.mesh_orders()

    def sidebands(self) -> tuple[tuple[str, int], ...]:
        """`lower` or `upper`, and the order, of the sidebands."""
        order, step = self.orders[0], self.constants.cranks
        return tuple((side, k) for side, k in (("lower", order - step), ("upper", order + step)) if k > 0)

    def touched_orders(self) -> tuple[int, ...]:
        return tuple(order for _, order in self.sidebands())

    def needed_orders(self, order: int) -> tuple[int, ...]:
        return self.orders if order in self.touched_orders() else ()

    def transfer(self, order: int) -> Mapping[int, complex]:
        return {self.orders[0]: self._part("ratio", order)}

    def constant(self, order: int) -> complex:
        return self._part("deg", order)

    def _part(self, unit: str, order: int) -> complex:
        return sum((self.complex_value(f"{side}_{unit}") for side, k in self.sidebands() if k == order), 0j)

    def passed_on(self, at: Conditions, orders: IntArray, coefficients: ComplexArray) -> ComplexArray:
        constant = np.zeros(len(orders), np.complex128)
        for order in self.touched_orders():
            constant[orders == order] = self.constant(order)
        return self.passed_on_change(at, orders, coefficients) + constant

    def passed_on_change(self, at: Conditions, orders: IntArray, change: ComplexArray) -> ComplexArray:
        """Sidebands are made from the mesh order as it arrives; several tables must not see each other's."""
        carrier = np.flatnonzero(orders == self.orders[0])
        if not len(carrier):
            return change
        found = change.copy()
        for _, order in self.sidebands():
            found[:, orders == order] += (self._part("ratio", order) * change[:, carrier[0]])[:, None]
        return found
