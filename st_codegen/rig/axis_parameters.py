"""Parameters of the servo axis in time: units in the names, bounds and sources beside the values.

In `rig.toml` they stand in the tables `[axis]`, `[axis.motor]`, `[axis.drive]`, `[axis.coupling]`, `[axis.reducer]`,
`[axis.load]`, `[axis.encoders]` and `[axis.thermal]`; each key may be left out and has the value given here then.

Sources: [P] the paper, [R] the real rig's data, [C] catalogues and handbooks of such machines (order of size only; the
rig's own values are not published).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, TypeVar

from st_codegen.files.toml_tables import TomlTable


def parameter(default: float, low: float, high: float, source: str) -> Any:
    """A number with its bounds (both allowed) and where its value comes from."""
    return dataclasses.field(default=default, metadata={"low": low, "high": high, "source": source})


@dataclass(frozen=True)
class Motor:
    """The servomotor, at its shaft."""

    inertia_kgm2: float = parameter(2.9e-3, 1e-6, 10.0, "[C] servomotors with 50 N m peak")
    viscous_Nms_per_rad: float = parameter(1e-3, 0.0, 10.0, "[C]")
    coulomb_Nm: float = parameter(0.1, 0.0, 100.0, "[C]")
    torque_limit_Nm: float = parameter(50.0, 0.1, 1e5, "[P] limit of the motor side")


@dataclass(frozen=True)
class Drive:
    """Position loop (P), speed loop (PI), current loop (first order), with feedforward of speed and acceleration."""

    position_gain_per_s: float = parameter(150.0, 0.0, 1e5, "[C] stiff servo drives")
    speed_gain_Nms_per_rad: float = parameter(5.0, 0.0, 1e5, "[C] 50 Hz with the inertia of the default rig")
    speed_integral_time_s: float = parameter(0.01, 1e-4, 1e3, "[C]")
    current_time_constant_s: float = parameter(1.6e-4, 0.0, 1.0, "[C] current loop of 1 kHz")
    speed_feedforward: float = parameter(1.0, 0.0, 1.5, "[C] as a commissioned axis has it")
    acceleration_feedforward: float = parameter(1.0, 0.0, 1.5, "[C]")
    cycle_s: float = parameter(125e-6, 1e-6, 0.01, "[C] position and speed loop of digital drives")


@dataclass(frozen=True)
class Coupling:
    """The bellows coupling between motor and reducer."""

    stiffness_Nm_per_rad: float = parameter(8000.0, 1.0, 1e7, "[C] bellows couplings of 50 N m")
    damping_Nms_per_rad: float = parameter(0.5, 0.0, 1e4, "[C] a few per cent of critical")
    backlash_arcmin: float = parameter(0.0, 0.0, 600.0, "[C] bellows couplings have none")


@dataclass(frozen=True)
class Reducer:
    """What stands at the reducer's fast shaft; its transmission error comes from the effects of the rig."""

    inertia_kgm2: float = parameter(5e-4, 1e-8, 10.0, "[C] fast shaft, gears and crankshafts of an RV 160")
    coulomb_Nm: float = parameter(0.6, 0.0, 100.0, "[C] no-load running torque")
    viscous_Nms_per_rad: float = parameter(4e-3, 0.0, 10.0, "[C] no-load running torque against speed")
    load_friction: float = parameter(0.15, 0.0, 10.0, "[C] loss in proportion to the load, efficiency near 0.87")
    friction_speed_rpm: float = parameter(2.0, 1e-3, 1e3, "numerical: dry friction changes its sign over this speed")


@dataclass(frozen=True)
class Load:
    """Central shaft and torque-controlled load side, at the output shaft."""

    inertia_kgm2: float = parameter(
        40.0, 0.0, 1e6, "[C] a motor of 1.6e-3 kg m2 behind the ratio 156 of the load side [P]"
    )
    torque_bandwidth_Hz: float = parameter(40.0, 0.1, 1e4, "[C] torque control through a reducer")
    torque_damping: float = parameter(0.7, 0.1, 10.0, "[C]")
    torque_ripple_Nm: float = parameter(1.0, 0.0, 1e4, "[C] standard deviation of what the torque control leaves")


@dataclass(frozen=True)
class Encoders:
    """Ring encoders at the fast and the slow shaft, and the motor's own."""

    motor_steps_per_rev: float = parameter(2.0**23, 100.0, 2.0**40, "[C] absolute motor encoders")
    input_steps_per_rev: float = parameter(2.0**26, 100.0, 2.0**40, "[C] optical ring encoders")
    output_steps_per_rev: float = parameter(2.0**26, 100.0, 2.0**40, "[C] optical ring encoders")
    input_noise_deg: float = parameter(1e-5, 0.0, 1.0, "[C] standard deviation of a reading")
    output_noise_deg: float = parameter(1e-5, 0.0, 1.0, "[C] standard deviation of a reading")
    delay_s: float = parameter(0.0, 0.0, 0.1, "age of both readings when they are latched")


@dataclass(frozen=True)
class Thermal:
    """The oil during a run, and its sensor."""

    start_C: float = parameter(30.0, -40.0, 150.0, "[P] middle of the campaign")
    drift_K_per_min: float = parameter(0.0, -60.0, 60.0, "none unless asked for")
    sensor_offset_K: float = parameter(0.0, -20.0, 20.0, "none unless asked for")
    sensor_time_constant_s: float = parameter(20.0, 0.0, 1e4, "[C] screw-in resistance thermometers in oil")


@dataclass(frozen=True)
class AxisParameters:
    """The servo axis; `step_s` is the integration step."""

    step_s: float = parameter(31.25e-6, 1e-7, 1e-3, "numerical: an eighth of a PLC cycle")
    motor: Motor = Motor()
    drive: Drive = Drive()
    coupling: Coupling = Coupling()
    reducer: Reducer = Reducer()
    load: Load = Load()
    encoders: Encoders = Encoders()
    thermal: Thermal = Thermal()

    def total_inertia_kgm2(self, ratio: float) -> float:
        """Everything that the motor turns, at its shaft."""
        return self.motor.inertia_kgm2 + self.reducer.inertia_kgm2 + self.load.inertia_kgm2 / ratio**2

    def coupling_frequency_rad_s(self, ratio: float) -> float:
        """The two-mass resonance on the coupling, the fastest motion there is."""
        behind = self.reducer.inertia_kgm2 + self.load.inertia_kgm2 / ratio**2
        return math.sqrt(self.coupling.stiffness_Nm_per_rad * (1.0 / self.motor.inertia_kgm2 + 1.0 / behind))


_T = TypeVar("_T")


def read_parameters(kind: type[_T], table: TomlTable) -> _T:
    """An object of a class whose fields are made by `parameter`, from a table of a rig file.

    Everything that is wrong with the table is noted in it; what `kind` itself refuses is raised as InputError.
    """
    values: dict[str, Any] = {}
    with table:
        for field in dataclasses.fields(kind):  # type: ignore[arg-type]
            if dataclasses.is_dataclass(field.default):
                values[field.name] = read_parameters(type(field.default), table.table(field.name))
            else:
                bounds, default = field.metadata, float(field.default)  # type: ignore[arg-type]
                values[field.name] = table.number(field.name, default, low=bounds["low"], high=bounds["high"])
    return kind(**values)


def read_axis(table: TomlTable) -> AxisParameters:
    """The axis of a rig file from its table `[axis]` (an empty one gives the defaults)."""
    return read_parameters(AxisParameters, table)
