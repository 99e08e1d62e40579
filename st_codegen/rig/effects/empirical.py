"""What the data show and nobody has a name for: one order as an expression of speed, torque and temperature.

Not searched as a candidate: `reconcile` writes it for what no effect of the catalogue explains, when asked to.
"""

from __future__ import annotations

from typing import Any

from st_codegen.campaign.conditions import Conditions
from st_codegen.rig.effects.base import Effect, Phasor

#: term -> powers of speed (1000 rpm), torque (kNm) and temperature (10 K above T_ref), and what it does in words
TERMS: dict[str, tuple[tuple[int, int, int], str]] = {
    "constant": ((0, 0, 0), "is constant"),
    "speed": ((1, 0, 0), "grows in proportion to the speed"),
    "speed_square": ((2, 0, 0), "grows with the square of the speed"),
    "inverse_speed": ((-1, 0, 0), "falls as one over the speed"),
    "torque": ((0, 1, 0), "grows in proportion to the torque"),
    "torque_square": ((0, 2, 0), "grows with the square of the torque"),
    "torque_cube": ((0, 3, 0), "grows with the cube of the torque"),
    "temperature": ((0, 0, 1), "changes in proportion to the oil's distance from the reference temperature"),
    "temperature_square": ((0, 0, 2), "changes with the square of the oil's distance from the reference temperature"),
    "speed_torque": ((1, 1, 0), "grows with the product of speed and torque"),
    "speed_temperature": ((1, 0, 1), "changes with the product of speed and oil temperature"),
    "torque_temperature": ((0, 1, 1), "changes with the product of torque and oil temperature"),
}


def term_values(name: str, at: Conditions, reference_C: float) -> Any:
    """The values of a term at operating points, (n,)."""
    axes = (at.speed_rpm / 1000.0, at.torque_Nm / 1000.0, (at.temperature_C - reference_C) / 10.0)
    found: Any = 1.0 + 0.0 * axes[0]
    for axis, power in zip(axes, TERMS[name][0], strict=True):
        for _ in range(abs(power)):
            found = found * axis if power > 0 else found / axis
    return found


class Empirical(Effect):
    """An order (or the mean) as a sum of terms, each with an amplitude and a phase; no cause is claimed."""

    name = "empirical"
    title = "what no known effect explains, as an expression of the operating point"
    orders_key = "order"
    least_order = 0
    searched = False
    phasors = tuple(
        Phasor(f"{name}_deg", f"{name}_phase_rad", "deg", 1, f"a part that {words}", required=False, own_flanks=True)
        for name, (_, words) in TERMS.items()
    )

    def coefficient(self, at: Conditions, order: int) -> Any:
        found: Any = 0.0
        for name in TERMS:
            if f"{name}_deg" in self.values:
                size = self.complex_at(f"{name}_deg", at)
                values = term_values(name, at, self.constants.reference_temperature_C)
                found = found + (size if order else size.real) * values
        return found
