"""Effects between the reference and the reducer's input: recordings over time only.

Angles are those of the fast side in deg, unwrapped; their contribution to the harmonic coefficients is none.
"""

from __future__ import annotations

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.effects.base import Effect, Form, Scalar, Stage


class ControlLag(Effect):
    """The drive's loops follow the reference with a lag of first order."""

    name = "control_lag"
    title = "lag of the servo loops"
    stage = Stage.AXIS
    scalars = (Scalar("lag_ms", "ms", 0, 500, "time constant", None, Form.SHAPE, (1, 5, 20, 80)),)

    def motor_angle(self, time_s: FloatArray, reference_deg: FloatArray) -> FloatArray:
        """theta_mot from theta_ref, deg (n,): exact for a reference that is linear between its samples."""
        lag = self.scalar("lag_ms") / 1000
        if lag <= 0:
            return reference_deg.copy()
        step = np.diff(time_s)
        slope = np.diff(reference_deg) / step
        decay = np.exp(-step / lag)
        behind = np.zeros(len(time_s))
        for row in range(len(step)):
            behind[row + 1] = behind[row] * decay[row] + slope[row] * lag * (1 - decay[row])
        return reference_deg - behind


class CouplingCompliance(Effect):
    """The coupling between motor and reducer twists and has play."""

    name = "coupling_compliance"
    title = "compliance of the coupling"
    stage = Stage.AXIS
    scalars = (
        Scalar("stiffness_Nm_per_rad", "Nm/rad", 50, 1e6, "stiffness, motor side", None, Form.INVERSE),
        Scalar("backlash_arcmin", "arcmin", 0, 60, "play, motor side"),
    )

    def twist(self, at: Conditions) -> FloatArray:
        """theta_in - theta_mot, deg, float64 (n,)."""
        torque = at.torque_Nm / self.constants.reduction_ratio
        twist = np.rad2deg(torque / self.scalar("stiffness_Nm_per_rad")) + self.scalar("backlash_arcmin") / 120
        return -at.sign * twist
