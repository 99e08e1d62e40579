"""An effect of one's own: the cogging of the motor, one wave each pole pair and turn of the motor.

st-codegen reconcile --rig rig.toml --measured campaign/ --out found --effects motor_cogging.py
"""

from st_codegen.rig.effects import Effect, Phasor

POLE_PAIRS = 5


class MotorCogging(Effect):
    """A wave of the order pole pairs times reduction ratio, that grows as the motor turns slower."""

    name = "motor_cogging"
    title = "cogging of the motor"
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude at 1000 rpm"),)

    def touched_orders(self):
        """The orders to which it contributes."""
        return (round(POLE_PAIRS * self.constants.reduction_ratio),)

    def coefficient(self, at, order):  # noqa: ARG002 - there is only one
        """c_k in deg at operating points `at`, complex (len(at),)."""
        return self.complex_at("amplitude_deg", at) * 1000 / at.speed_rpm
