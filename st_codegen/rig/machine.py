"""A rig file as a machine in time: its effects, its axis, its tasks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import Problems
from st_codegen.files.toml_tables import TomlTable
from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.rig.axis_parameters import AxisParameters, Coupling, Drive, read_axis
from st_codegen.rig.effects import Catalogue, Conditions, Effect, Form, Stage
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.rig.motion import Rig
from st_codegen.rig.tasks import read_tasks


class RigHarmonics:
    """The transmission error of a rig as it is, without what the measuring chain adds."""

    def __init__(self, rig: RigModel) -> None:
        self._rig = rig.with_effects(
            effect for effect in rig.effects if effect.stage not in (Stage.MEASURING, Stage.AXIS)
        )

    @property
    def reduction_ratio(self) -> float:
        """theta_in / theta_out."""
        return self._rig.constants.reduction_ratio

    def harmonics(
        self, backward: bool, speed_rpm: FloatArray, torque_Nm: FloatArray, temperature_C: FloatArray
    ) -> tuple[FloatArray, ComplexArray]:
        """Orders (K,) and c_k in deg (points, K)."""
        orders = self._rig.orders()
        at = Conditions.of(-1.0 if backward else 1.0, speed_rpm, torque_Nm, temperature_C)
        return np.array(orders, np.float64), self._rig.coefficients(at, orders)


def read_machine(path: Path, known: Catalogue | None = None) -> tuple[RigModel, Rig]:
    """Read a rig file, its tables [axis] and [tasks] included. Raises one InputError that lists every problem."""
    model = read_rig(path, known)
    return model, machine_of(model, str(path))


def machine_of(model: RigModel, subject: str = "rig.toml") -> Rig:
    """The machine of a rig. Raises InputError for unknown keys and values out of bounds in [axis] and [tasks]."""
    problems = Problems(subject)
    table = model.other.get("axis", {})
    axis = read_axis(TomlTable(table, "[axis]", problems))
    tasks = read_tasks(TomlTable(model.other.get("tasks", {}), "[tasks]", problems))
    problems.raise_if_any()
    for effect in model.effects:
        axis = _with_effect(axis, effect, table)
    return Rig(RigHarmonics(model), axis, tasks)


def _with_effect(axis: AxisParameters, effect: Effect, table: Mapping[str, Any]) -> AxisParameters:
    """The effects of recordings in time are parameters of the axis, unless [axis] says otherwise."""
    parameters = effect.table()
    if effect.name == "control_lag" and "drive" not in table and parameters["lag_ms"] > 0.0:
        # at constant speed the position loop without feedforward follows 1 / gain behind
        drive = dataclasses.replace(
            Drive(),
            position_gain_per_s=1000.0 / parameters["lag_ms"],
            speed_feedforward=0.0,
            acceleration_feedforward=0.0,
        )
        return dataclasses.replace(axis, drive=drive)
    if effect.name == "coupling_compliance" and "coupling" not in table:
        coupling = Coupling(parameters["stiffness_Nm_per_rad"], backlash_arcmin=parameters.get("backlash_arcmin", 0.0))
        return dataclasses.replace(axis, coupling=coupling)
    return axis


def another_specimen(model: RigModel, known: Catalogue, spread: float, seed: int) -> RigModel:
    """A rig of the same type that differs: each size of each effect by a random share (standard deviation `spread`),
    phases by as many rad. What says the form of an effect, or where it acts, stays."""
    random = np.random.default_rng(seed)

    def other(key: str, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [other(key, item) for item in value]
        if isinstance(value, float):
            draw = float(random.normal(0.0, spread))
            return value + draw if key.endswith("phase_rad") else value * (1.0 + draw)
        return value

    effects = []
    for effect in model.effects:
        fixed = {"orders", "order", *(scalar.key for scalar in effect.scalars if scalar.form is Form.FIXED)}
        # drawn all the same, so that a form which somebody states changes none of the other sizes
        drawn = {key: (value, other(key, value)) for key, value in effect.table().items()}
        values = {key: old if key in fixed else new for key, (old, new) in drawn.items()}
        del values["name"]
        effects.append(known[effect.name](values, model.constants))
    return model.with_effects(effects)
