"""A natural frequency of the rig's structure, excited by the mesh."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import ComplexArray, IntArray
from st_codegen.rig.effects.base import Effect, Form, Phasor, Scalar, Stage

#: how steeply a resonance comes and goes at the temperature of its state
_STEP_PER_K = 100.0
#: a law of the frequency is one of where it was measured: elsewhere it must not give none at all
_LEAST_SHIFT = 0.1
#: the key of what follows the load of a height, and those of all that make it
LOAD_PART = "slope_deg_per_kNm"
_HEIGHTS = ("amplitude_deg", LOAD_PART)


class StructuralResonance(Effect):
    """Orders that peak where their frequency meets the structure's.

    A structure that has two states (a seat that closes when it is warm) is two resonances, each with its temperatures.
    """

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
            -1000,
            1000,
            "relative change of the frequency with the load, from none on",
            0.0,
            Form.SHAPE,
            (-0.1, -0.05, 0.05, 0.1),
            typical=40,
        ),
        Scalar(
            "levels_off_per_kNm",
            "1/kNm",
            0,
            10000,
            "the inverse of the load that makes half of the change that any load does",
            0.0,
            Form.SHAPE,
            shapes="frequency_per_kNm",
            typical=200,
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
        Scalar(
            "static_share",
            "",
            0,
            1,
            "0: excited by a motion of its base, 1: by a force",
            0.0,
            Form.FIXED,
            (1,),
            shapes="frequency_Hz",
        ),
        Scalar("above_C", "degC", -100, 200, "oil temperature from which on it is there", -100.0, Form.FIXED),
        Scalar("below_C", "degC", -100, 200, "oil temperature up to which it is there", 200.0, Form.FIXED),
        Scalar("growth_per_kNm", "1/kNm", 0, 5, "relative growth of all orders with the load", 0.0, Form.FIXED),
    )
    phasors = (
        Phasor("amplitude_deg", "phase_rad", "deg", 1, "height at the resonance without load", own_flanks=True),
        Phasor(LOAD_PART, "slope_phase_rad", "deg/kNm", 100, "load part", required=False, own_flanks=True, typical=1),
    )

    def response(self, at: Conditions, order: Any) -> Any:
        """H at the frequencies of an order, conjugate backward; (n,), or (n, orders) for an array of orders (1, K)."""
        speed, sign, torque, temperature = at.speed_rpm, at.sign, at.torque_Nm, at.temperature_C
        if isinstance(order, np.ndarray):
            speed, sign, torque, temperature = (part[:, None] for part in (speed, sign, torque, temperature))
        ratio = speed * (order / (60 * self.constants.reduction_ratio * self.scalar("frequency_Hz")))
        if "frequency_per_kNm" in self.values or "frequency_per_10K" in self.values:
            ratio = ratio / self.shift(torque, temperature)
        damping, square = self.scalar("damping_ratio"), ratio * ratio
        driven = square + self.scalar("static_share") * (1 - square) if "static_share" in self.values else square
        return 2 * damping * driven / (1 - square + (2j * damping * sign) * ratio)

    def shift(self, torque: Any, temperature: Any) -> Any:
        """The frequency at loads (N m) and oil temperatures (degC) over that at no load and the reference temperature.

        It is at least a tenth.
        """
        load, change = np.abs(torque) / 1000.0, self.scalar("frequency_per_kNm")
        of_load = change * load / (1.0 + self.scalar("levels_off_per_kNm") * load)
        warmer = (temperature - self.constants.reference_temperature_C) / 10.0
        return np.maximum(1.0 + of_load + self.scalar("frequency_per_10K") * warmer, _LEAST_SHIFT)

    @property
    def state_text(self) -> str:
        parts = (("above_C", "above"), ("below_C", "below"))
        return "".join(f", {word} {self.scalar(key):g} degC" for key, word in parts if key in self.values)

    def presence(self, at: Conditions) -> Any:
        """1 at the temperatures at which the resonance is there, 0 at others, (n,)."""
        found: Any = 1.0
        # steps within some hundredths of a kelvin, written so that they are formulas for a controller as well
        for key, side in (("above_C", 1.0), ("below_C", -1.0)):
            if key in self.values:
                warmer = (at.temperature_C - self.scalar(key)) * (side * _STEP_PER_K)
                found = found * (0.5 + 0.5 * np.tanh(warmer))
        return found

    def height(self, at: Conditions, place: int) -> Any:
        """What an order, by its place in the list, has where it meets the frequency: complex128 (n,), deg."""
        forward, backward = self._sides[place]
        return self._under_load(at, *(np.where(at.sign > 0, *sides) for sides in zip(forward, backward, strict=True)))

    def _under_load(self, at: Conditions, without_load: Any, of_load: Any) -> Any:
        load = at.torque_Nm / 1000
        return (without_load * (1 + self.scalar("growth_per_kNm") * load) + of_load * load) * self.presence(at)

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        found: ComplexArray = self.height(at, self.orders.index(order)) * self.response(at, order)
        return found

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        """What is added to the coefficients of some orders, complex128 (n, K), deg."""
        found = np.zeros((len(at), len(orders)), np.complex128)
        wanted = set(orders.tolist())
        acting = {order: sides for order, sides in self._acting.items() if order in wanted}
        if acting:
            own = np.array(list(acting))
            forward, backward = np.moveaxis(np.array(list(acting.values())), 0, -1)
            sides = np.where(at.sign > 0, forward[..., None], backward[..., None])
            # orders are rising wherever coefficients are computed
            found[:, np.searchsorted(orders, own)] = self._under_load(at, *sides).T * self.response(at, own[None, :])
        return found

    @cached_property
    def _acting(self) -> dict[int, list[tuple[complex, ...]]]:
        """The heights of the orders that have one: without load and the load part, forward and backward."""
        heights = zip(self.orders, self._sides, strict=True)
        return {order: sides for order, sides in heights if any(map(any, sides))}

    @cached_property
    def _sides(self) -> list[list[tuple[complex, ...]]]:
        """The height of each order: without load and the load part, forward and backward.

        A class that is made of this one may have the one without the other.
        """
        own, none = {phasor.key for phasor in self.phasors}, (0.0,) * len(self.orders)
        sides = (
            zip(*(self.complex_values(key, side) if key in own else none for key in _HEIGHTS), strict=True)
            for side in (False, True)
        )
        return [list(both) for both in zip(*sides, strict=True)]
