"""The servo axis in time: theta_ref -> theta_mot (drive) -> theta_in (coupling) -> theta_out (reducer with friction
and TE).

Fixed step, reproducible. Angles of the fast side are motor-side degrees, theta_out is in output degrees, all unwrapped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Protocol

import numpy as np

from st_codegen.errors import InputError, MissingExtraError
from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.rig.axis_parameters import AxisParameters, Load

#: A loop whose disturbances grow by more than this in a cycle is unstable; below it lies the rounding of the finite
#: differences.
_MARGINAL = 1.0 + 1e-6
_DEG = math.pi / 180.0


class ErrorModel(Protocol):
    """What the axis needs of a rig: the harmonics of its transmission error at operating points."""

    @property
    def reduction_ratio(self) -> float:
        """theta_in / theta_out."""

    def harmonics(
        self, backward: bool, speed_rpm: FloatArray, torque_Nm: FloatArray, temperature_C: FloatArray
    ) -> tuple[FloatArray, ComplexArray]:
        """Orders (K,), 0 first, and c_k in deg (points, K): TE = Re sum c_k exp(i k theta_out)."""


@dataclass(frozen=True)
class Harmonics:
    """c_k along a motion, deg: `orders` (K,), `parts` (cycles, 4, K) forward cosine, sine, backward cosine, sine."""

    orders: FloatArray
    parts: FloatArray

    @classmethod
    def along(
        cls, model: ErrorModel, speed_rpm: FloatArray, load_Nm: FloatArray, temperature_C: FloatArray
    ) -> Harmonics:
        """The harmonics of a rig model at operating points, one a cycle; `load_Nm` opposes positive motion.

        It opposes forward motion and drives backward motion: while it turns over at a reversal, each direction has its
        own sign of it, and what depends on the load alone (compliance, seating) is the same in both.
        """
        orders, forward = model.harmonics(False, speed_rpm, load_Nm, temperature_C)
        also, backward = model.harmonics(True, speed_rpm, -load_Nm, temperature_C)
        if not np.array_equal(orders, also):
            raise InputError("the rig model has different orders forward and backward")
        parts = np.stack([forward.real, forward.imag, backward.real, backward.imag], axis=1)
        return cls(np.asarray(orders, np.float64), np.ascontiguousarray(parts, np.float64))

    @classmethod
    def none(cls, cycles: int) -> Harmonics:
        """The harmonics of a perfect reducer, which has no transmission error."""
        return cls(np.zeros(0), np.zeros((cycles, 4, 0)))


def load_kernel() -> ModuleType:
    """The compiled part. Raises MissingExtraError without numba."""
    try:
        from st_codegen.rig import kernel
    except ImportError as error:
        if error.name != "numba":
            raise
        raise MissingExtraError("numba", "rig", "the simulation of the servo axis") from None
    return kernel


class Axis:
    """The axis between PLC cycles of `cycle_s`.

    Raises InputError for steps that do not fit the cycle, for a step that the coupling's resonance makes unstable, and
    for control loops that are unstable.
    """

    def __init__(self, parameters: AxisParameters, ratio: float, *, cycle_s: float = 250e-6) -> None:
        self.parameters = parameters
        self.ratio = ratio
        self.cycle_s = cycle_s
        self._kernel = load_kernel()
        self._steps = _whole(cycle_s, parameters.step_s, "the PLC cycle")
        every = _whole(parameters.drive.cycle_s, parameters.step_s, "axis.drive.cycle_s")
        if self._steps % every:
            raise InputError(f"a PLC cycle of {cycle_s * 1e6:g} us is no multiple of axis.drive.cycle_s")
        self._counts = np.array([self._steps, every, 0], np.int64)
        self.packed = self._pack()
        self.state = np.zeros(self._kernel.STATES)
        self.state[self._kernel.SIDE] = 1.0
        self._check_step()
        self._check_loops()

    def _pack(self) -> FloatArray:
        p, k = self.parameters, self._kernel
        packed = np.zeros(k.PARAMETERS)
        inertia = p.total_inertia_kgm2(self.ratio)
        values = {
            k.J_MOT: p.motor.inertia_kgm2,
            k.J_IN: p.reducer.inertia_kgm2,
            k.J_OUT: p.load.inertia_kgm2,
            k.RATIO: self.ratio,
            k.STIFFNESS: p.coupling.stiffness_Nm_per_rad,
            k.DAMPING: p.coupling.damping_Nms_per_rad,
            k.HALF_PLAY: p.coupling.backlash_arcmin / 120.0 * _DEG,
            k.MOT_VISCOUS: p.motor.viscous_Nms_per_rad,
            k.MOT_COULOMB: p.motor.coulomb_Nm,
            k.RED_VISCOUS: p.reducer.viscous_Nms_per_rad,
            k.RED_COULOMB: p.reducer.coulomb_Nm,
            k.LOAD_FRICTION: p.reducer.load_friction,
            k.FRICTION_SPEED: p.reducer.friction_speed_rpm * 2.0 * math.pi / 60.0,
            k.TORQUE_LIMIT: p.motor.torque_limit_Nm,
            k.KV: p.drive.position_gain_per_s,
            k.KP: p.drive.speed_gain_Nms_per_rad,
            k.KI: p.drive.speed_gain_Nms_per_rad / p.drive.speed_integral_time_s,
            k.CURRENT_GAIN: -math.expm1(-p.step_s / p.drive.current_time_constant_s)
            if p.drive.current_time_constant_s
            else 1.0,
            k.SPEED_FF: p.drive.speed_feedforward,
            k.ACC_FF: p.drive.acceleration_feedforward * inertia,
            k.STEP: p.step_s,
            k.ENCODER_STEP: 2.0 * math.pi / p.encoders.motor_steps_per_rev,
        }
        for entry, value in values.items():
            packed[entry] = value
        return packed

    # --- stability ---

    def _check_step(self) -> None:
        """Velocity Verlet holds a frequency w up to h w = 2; damping takes part of that."""
        p = self.parameters
        frequency = p.coupling_frequency_rad_s(self.ratio)
        behind = p.reducer.inertia_kgm2 + p.load.inertia_kgm2 / self.ratio**2
        decay = p.coupling.damping_Nms_per_rad * (1.0 / p.motor.inertia_kgm2 + 1.0 / behind)
        if p.step_s * frequency >= 2.0 or p.step_s * decay >= 2.0:
            longest = min(2.0 / frequency, 2.0 / decay if decay else math.inf)
            raise InputError(
                f"axis.step_s = {p.step_s:g} s is unstable: the coupling swings at {frequency / 2 / math.pi:.0f} Hz "
                f"and needs steps below {longest:.3g} s; make the step shorter or the coupling softer"
            )

    def _check_loops(self) -> None:
        growth = self.growth()
        if not growth <= _MARGINAL:
            raise InputError(
                f"the control loops are unstable: a disturbance grows by {growth:.4g} in each "
                f"cycle of {self.cycle_s * 1e6:g} us; "
                "lower axis.drive.speed_gain_Nms_per_rad or position_gain_per_s, or lengthen speed_integral_time_s"
            )

    def growth(self) -> float:
        """Largest factor by which a small disturbance grows in a cycle: spectral radius of the map over one cycle.

        Without friction, play and TE, and far from the torque limit, the map is linear: its columns are differences,
        exact to rounding.
        """
        k = self._kernel
        linear = self.packed.copy()
        for entry in (k.HALF_PLAY, k.MOT_COULOMB, k.RED_COULOMB, k.LOAD_FRICTION, k.ENCODER_STEP):
            linear[entry] = 0.0
        linear[k.TORQUE_LIMIT] = math.inf
        free = [k.TH_MOT, k.W_MOT, k.TH_IN, k.W_IN, k.TORQUE, k.INTEGRAL, k.SETPOINT, k.SEEN]
        image = np.zeros((len(free), len(free)))
        for column, entry in enumerate(free):
            state = np.zeros(k.STATES)
            state[entry] = 1.0
            k.advance(state, linear, np.zeros(0), np.zeros((4, 0)), np.zeros(2), 0.0, self._counts)
            image[:, column] = state[free]
        if not np.isfinite(image).all():
            return math.inf
        return float(np.abs(np.linalg.eigvals(image)).max())

    # --- motion ---

    def place(
        self, theta_mot_deg: float, harmonics: Harmonics, *, backward: bool = False, load_Nm: float = 0.0
    ) -> None:
        """Put the axis at rest at an angle of the motor, on the flank of a direction, in balance with a load."""
        k, angle = self._kernel, theta_mot_deg * _DEG
        self.state[:] = 0.0
        torque = load_Nm / self.ratio
        for entry in (k.TORQUE, k.INTEGRAL, k.SETPOINT):
            self.state[entry] = torque
        wound = torque / self.packed[k.STIFFNESS] + math.copysign(self.packed[k.HALF_PLAY], torque)
        for entry in (k.TH_MOT, k.TH_IN, k.SEEN, k.REF_FROM, k.REF_TO):
            self.state[entry] = angle
        self.state[k.TH_IN] -= wound
        self.state[k.SIDE] = -1.0 if backward else 1.0
        for _ in range(8):  # each round leaves about TE'**2 = 1e-5 of the error
            k.transmission(self.state, self.packed, harmonics.orders, harmonics.parts[0])

    def set_arrival(self, delay_s: float) -> None:
        """When within a cycle the reference gets to the drive, rounded to integration steps."""
        step = round(delay_s / self.parameters.step_s)
        if not 0 <= step < self._steps:
            raise InputError(
                f"a transfer of {delay_s * 1e6:g} us to the drive does not fit a cycle of {self.cycle_s * 1e6:g} us"
            )
        self._counts[2] = step

    def advance(self, reference_deg: float, load_Nm: FloatArray, orders: FloatArray, parts: FloatArray) -> None:
        """One cycle; `load_Nm` (2,) is the torque against positive motion at its begin and end, `parts` (4, K)."""
        self._kernel.advance(self.state, self.packed, orders, parts, load_Nm, reference_deg * _DEG, self._counts)

    @property
    def theta_mot_deg(self) -> float:
        """Angle of the motor, deg."""
        return float(self.state[self._kernel.TH_MOT]) / _DEG

    @property
    def theta_in_deg(self) -> float:
        """Angle of the reducer's fast shaft, deg."""
        return float(self.state[self._kernel.TH_IN]) / _DEG

    @property
    def te_deg(self) -> float:
        """TE = theta_out - theta_in / ratio, deg."""
        return float(self.state[self._kernel.TE]) / _DEG

    @property
    def theta_out_deg(self) -> float:
        """Angle of the output, deg."""
        return (float(self.state[self._kernel.TH_IN]) / self.ratio + float(self.state[self._kernel.TE])) / _DEG

    @property
    def speed_in_deg_s(self) -> float:
        """Speed of the fast shaft, deg/s."""
        return float(self.state[self._kernel.W_IN]) / _DEG

    def seen_deg(self, age_s: float, noise_in_deg: float, noise_out_deg: float) -> tuple[float, float]:
        """What both encoders show: the angles of some time ago with noise, in whole steps, deg."""
        encoders, speed = self.parameters.encoders, self.speed_in_deg_s
        step_in, step_out = 360.0 / encoders.input_steps_per_rev, 360.0 / encoders.output_steps_per_rev
        inner = self.theta_in_deg - age_s * speed + noise_in_deg
        outer = self.theta_out_deg - age_s * speed / self.ratio + noise_out_deg
        return float(np.floor(inner / step_in) * step_in), float(np.floor(outer / step_out) * step_out)


def _whole(length: float, step: float, what: str) -> int:
    count = round(length / step)
    if count < 1 or not math.isclose(count * step, length, rel_tol=1e-9):
        raise InputError(f"{what} ({length:g} s) is no multiple of axis.step_s ({step:g} s)")
    return count


def controlled_torque(wanted_Nm: FloatArray, load: Load, cycle_s: float, random: np.random.Generator) -> FloatArray:
    """What the torque-controlled load side makes of its set-points (cycles,): a second-order lag and a ripple, N m.

    Exact for set-points that are held for a cycle.
    """
    from scipy.linalg import expm

    w, d = 2.0 * math.pi * load.torque_bandwidth_Hz, load.torque_damping
    # exp of the augmented matrix: the state after a cycle with a held input
    augmented = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * d * w, w * w], [0.0, 0.0, 0.0]]) * cycle_s
    step = expm(augmented)
    state = np.array([wanted_Nm[0], 0.0, 0.0])
    result = np.empty_like(wanted_Nm)
    ripple = (
        random.normal(0.0, load.torque_ripple_Nm, wanted_Nm.shape)
        if load.torque_ripple_Nm
        else np.zeros_like(wanted_Nm)
    )
    # the ripple passes the same lag, scaled so that its standard deviation comes out as stated: variance w / (4 d) of
    # white noise
    scale = math.sqrt(4.0 * d / (w * cycle_s))
    for number, value in enumerate(wanted_Nm + ripple * scale):
        result[number] = state[0]
        state[2] = value
        state = step @ state
    return result
