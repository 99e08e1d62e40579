"""The simulated rig behind the signals of a soft PLC: axis, reducer with its transmission error, load, encoders, oil.

What it does not have: ripple of the load, jitter of sampling, drift of the oil. The load follows its set-point with a
lag of first order. The oil warms while the input shaft turns fast, up to the temperature of the measurement, and does
not cool: a measuring rig would take hours for what is seconds here.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from st_codegen.emit.output import read_manifest
from st_codegen.errors import InputError
from st_codegen.ir import AnyArray
from st_codegen.live.plc import SoftPlc
from st_codegen.rig.axis import Axis, Harmonics
from st_codegen.rig.machine import read_machine
from st_codegen.rig.motion import Rig
from st_codegen.st import Machine
from st_codegen.st.run.layout import dtype_of
from st_codegen.te.compensation.load_torque import LOAD_RATIO
from st_codegen.te.compensation.programs import EXPERIMENT_SIGNALS, SIGNALS

#: Where the output shaft stands at the start, rad.
_START_RAD = 0.05
#: The oil warms by so much, and at speeds from so many rpm on.
_WARM_K_PER_S, _WARM_RPM, _WARM_ABOVE_K = 0.5, 500.0, 0.05
#: Changes of the operating point within which the harmonics are not computed anew while it moves: rpm, N m, K.
_NEAR = (10.0, 5.0, 0.05)
_DRAWN = 4096
#: What a client writes beyond it (rpm, N m) is no command but a fault, and the axis comes to rest: of far larger ones
#: the state of the rig would be no number any more.
_MOST = 1e6
_SENSORS = tuple(
    f"{EXPERIMENT_SIGNALS}.{name}"
    for name in ("fThetaIn_rad", "fThetaOut_rad", "bEncodersReady", "fOil_C", "fShaftTorque_Nm")
)
_BUSY, _SPEED, _TORQUE, _WANTED_C = (
    f"{EXPERIMENT_SIGNALS}.{name}" for name in ("bBusy", "fMotorSpeed_rpm", "fMotorTorque_Nm", "fTemperature_C")
)
_ANGLE, _CORRECTION = f"{SIGNALS}.fThetaOut_rad", f"{SIGNALS}.fCorrection_deg"


class SimulatedRig:
    """A rig of a rig file that follows the commands of PRG_Experiment, or else the motion that a client writes.

    While no measurement is going on, the speed and the torque of GVL_Machine are the motion profile: a client that sets
    them moves the axis, and the correction is added to the motor's reference.
    """

    def __init__(self, plc: SoftPlc, rig: Rig, seed: int = 0) -> None:
        names = {variable.name for variable in plc.code.project.globals.get(EXPERIMENT_SIGNALS.upper(), ())}
        if not names:
            raise InputError(f"{plc.code.folder}: no {EXPERIMENT_SIGNALS}, to which a rig could be connected")
        own = [variable.name for variable in plc.code.project.globals.get(SIGNALS.upper(), ())]
        self._motion = {
            role: next((f"{SIGNALS}.{name}" for name in own if name.lower().startswith(f"f{role}")), "")
            for role in ("speed", "torque", "temperature")
        }
        driven = [*_SENSORS, _ANGLE, *filter(None, [self._motion["temperature"]])]
        self.drives = frozenset(name.upper() for name in driven)
        used = {*driven, _BUSY, _SPEED, _TORQUE, _WANTED_C, _CORRECTION, *filter(None, self._motion.values())}
        self._signals = {name: _value_of(plc.machine, name) for name in used}
        self._rig = rig
        self._ratio = rig.model.reduction_ratio
        self.axis = Axis(rig.axis, self._ratio, cycle_s=plc.tick_us * 1e-6)
        self._oil = rig.axis.thermal.start_C
        self._load = 0.0
        self._reference = math.degrees(_START_RAD) * self._ratio
        self._point = self._last = (0.0, 0.0, self._oil)
        self._harmonics = self._at(self._point)
        self._random = np.random.default_rng(seed)
        self._drawn: list[list[float]] = []
        self.encoders_ready = True
        self.axis.place(self._reference, self._harmonics)
        self._sense()

    def _at(self, point: tuple[float, float, float]) -> Harmonics:
        speed, load, oil = (np.array([value]) for value in point)
        return Harmonics.along(self._rig.model, np.abs(speed), load, oil)

    def step(self, cycle_s: float, *, is_enabled: bool) -> None:
        """One tick of motion."""
        signals, motion = self._signals, self._motion
        speed = torque = correction = 0.0
        if is_enabled and signals[_BUSY].item():
            speed = signals[_SPEED].item()
            torque = signals[_TORQUE].item() * LOAD_RATIO
        elif is_enabled and motion["speed"]:
            speed = signals[motion["speed"]].item()
            # a motion's torque opposes it, in both directions
            torque = math.copysign(signals[motion["torque"]].item(), speed) if speed and motion["torque"] else 0.0
            correction = signals[_CORRECTION].item()
        # NaN is none of these, either
        speed, torque, correction = (value if abs(value) <= _MOST else 0.0 for value in (speed, torque, correction))
        self._reference += speed * 6.0 * cycle_s
        before = self._load
        self._load += (torque - self._load) * -math.expm1(
            -2.0 * math.pi * self._rig.axis.load.torque_bandwidth_Hz * cycle_s
        )
        if abs(speed) > _WARM_RPM and self._oil < self._signals[_WANTED_C].item() + _WARM_ABOVE_K:
            self._oil += _WARM_K_PER_S * cycle_s
        self._update((speed, self._load, self._oil))
        self.axis.advance(
            self._reference + correction,
            np.array([before, self._load]),
            self._harmonics.orders,
            self._harmonics.parts[0],
        )
        self._sense()

    def _update(self, point: tuple[float, float, float]) -> None:
        """New harmonics where the operating point has moved far enough, or has come to rest somewhere else."""
        if point == self._point:
            return
        moved = [abs(a - b) for a, b in zip(point, self._point, strict=True)]
        step = max(abs(a - b) for a, b in zip(point, self._last, strict=True))
        self._last = point
        far = moved[0] > _NEAR[0] or moved[1] > _NEAR[1] or moved[2] > _NEAR[2]
        if far or (step < 1e-6 and max(moved) > 1e-3):
            self._point, self._harmonics = point, self._at(point)

    def _sense(self) -> None:
        """What the encoders and sensors show."""
        encoders = self._rig.axis.encoders
        if not self._drawn:
            self._drawn = self._random.normal(size=(_DRAWN, 2)).tolist()
        noise = self._drawn.pop()
        noise_deg = noise[0] * encoders.input_noise_deg, noise[1] * encoders.output_noise_deg
        inner, outer = self.axis.seen_deg(encoders.delay_s, *noise_deg)
        values = (math.radians(inner), math.radians(outer), self.encoders_ready, self._oil, self._load)
        for name, value in zip(_SENSORS, values, strict=True):
            self._signals[name][0] = value
        if self._motion["speed"]:
            self._signals[_ANGLE][0] = math.radians(outer)
        if self._motion["temperature"]:
            self._signals[self._motion["temperature"]][0] = self._oil


def _value_of(machine: Machine, name: str) -> AnyArray:
    """The memory of a number, an array of one: the plant reads and sets it each tick."""
    memory, place = machine.find(name)
    return memory.view(place.offset, dtype_of(place.type), ())


def plant_behind(plc: SoftPlc, path: Path, seed: int = 0) -> SimulatedRig:
    """The rig of a file behind a PLC. Raises InputError for a rig that does not fit its cycle, or its text's ratio."""
    _, rig = read_machine(path)
    made_for = read_manifest(plc.code.folder).purpose.get("reduction_ratio")
    if made_for not in (None, rig.model.reduction_ratio):
        raise InputError(
            f"{path}: reduction ratio {rig.model.reduction_ratio:g}, and the text was generated for {made_for:g}"
        )
    return SimulatedRig(plc, rig, seed)
