"""The generated Structured Text itself as the compensator: emitted files, read back, compiled to Python once.

FB_TEPredict needs most of the time and depends on speed, torque and temperature only, which the motion profile and the
oil's sensor give
without the loop. So it is run for all cycles of a motion in advance, by the interpreter over lanes, from the same
text; in the loop a call
with exactly these inputs takes its outputs from there, any other call runs the text. Both interpreters give the same
bits (see the tests).
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.blocks.model import input_variables
from st_codegen.bundle import Bundle
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.generate import generate
from st_codegen.ir import TransmissionError
from st_codegen.rig.tasks import Inputs
from st_codegen.st import LaneMachine, ScalarMachine, StError, StRuntimeError, load_project
from st_codegen.st.typed import Project
from st_codegen.targets import target_named

FloatArray = NDArray[np.float64]

_PREDICT, _COMPENSATE = "FB_TEPredict", "FB_Compensator"
#: Rows that the interpreter takes at once; larger batches fall out of the caches.
_BATCH = 20_000


@dataclass(frozen=True)
class Roles:
    """Which input of the blocks is which quantity."""

    speed: str
    torque: str
    temperature: str


def roles_of(te: TransmissionError) -> Roles:
    """Which feature is the torque and which the temperature, by name or unit. Raises InputError where that is not
    clear."""
    names = [variable.name for variable in input_variables(te.features)]
    found: dict[str, str] = {}
    units = {"torque": ("Nm",), "temperature": ("°C", "degC", "C", "K")}
    for number, (feature, name) in enumerate(zip(te.features, names, strict=True)):
        if number == te.speed_feature:
            found["speed"] = name
            continue
        for role, known in units.items():
            if feature.name.lower().startswith(role) or feature.unit.replace(" ", "") in known:
                if role in found:
                    raise InputError(
                        f"bundle '{te.name}': two features look like a {role}; name them torque_Nm and temperature_C"
                    )
                found[role] = name
                break
        else:
            raise InputError(
                f"bundle '{te.name}': the rig does not know the feature '{feature.name}' ({feature.unit}); it "
                f"simulates speed, torque "
                "and oil temperature"
            )
    for role in ("torque", "temperature"):
        found.setdefault(role, "")
    return Roles(**found)


def restricted(bundle: Bundle, orders: Sequence[int]) -> Bundle:
    """The same bundle with some of its orders only. Raises InputError for orders that it does not have."""
    te = transmission_error(bundle)
    unknown = sorted(set(orders) - set(te.orders))
    if unknown:
        raise InputError(
            f"bundle '{te.name}' has no model for order {', '.join(map(str, unknown))}; "
            f"it has {', '.join(map(str, te.orders))}"
        )
    chosen = tuple(order for order in te.orders if order in set(orders))
    outputs = tuple(output for output in te.outputs if output.order in chosen)
    used = {output.model for output in outputs}
    return Bundle(
        tuple(model for model in bundle.models if model.ir.name in used),
        dataclasses.replace(te, orders=chosen, outputs=outputs),
    )


def transmission_error(bundle: Bundle) -> TransmissionError:
    """What the models of a bundle are for. Raises InputError for a folder of lone models."""
    if bundle.transmission_error is None:
        raise InputError(
            "the models have no bundle.toml, so they do not say which harmonics they predict: there is nothing to "
            "simulate"
        )
    return bundle.transmission_error


class EmittedCompensator:
    """The blocks of one bundle, generated to files for a target and read back.

    Raises GeneratedCodeError where the text is not valid, or where a controller would stop.
    """

    def __init__(self, bundle: Bundle, target: str = "twincat") -> None:
        self.te = transmission_error(bundle)
        self.roles = roles_of(self.te)
        with tempfile.TemporaryDirectory(prefix="st-codegen-rig-") as name:
            generated = generate(bundle, target_named(target), Path(name))
            self.project = _read(generated.folder, target)
        self._known: dict[tuple[float, ...], tuple[Any, ...]] = {}
        self._names = [variable.name for variable in input_variables(self.te.features)]
        self._machine = ScalarMachine(self.project, replaced={_PREDICT: self._predict})
        self._slots: list[str] = []
        self._arrays: list[bool] = []

    def foresee(self, speed_rpm: FloatArray, torque_Nm: FloatArray, temperature_C: FloatArray) -> None:
        """Run FB_TEPredict at operating points, (rows,) each, so that the loop need not."""
        by_role = dict(
            zip(
                (self.roles.speed, self.roles.torque, self.roles.temperature),
                (speed_rpm, torque_Nm, temperature_C),
                strict=True,
            )
        )
        rows = np.stack([np.abs(by_role[n]) if n == self.roles.speed else by_role[n] for n in self._names], axis=1)
        rows = np.unique(rows, axis=0)
        for start in range(0, len(rows), _BATCH):
            part = rows[start : start + _BATCH]
            instance = LaneMachine(self.project, lanes=len(part)).instance(_PREDICT)
            for name, column in zip(self._names, part.T, strict=True):
                instance[name] = np.ascontiguousarray(column)
            _guarded(instance)
            ports = [port.name for port in instance.outputs]
            values = [np.asarray(instance[port]) for port in ports]
            self._slots = [f"v_{port.upper()}" for port in ports]
            self._arrays = [value.ndim == 2 for value in values]
            valid = values[ports.index("bValid")]
            lists = [value.tolist() for value in values]
            for number, key in enumerate(map(tuple, part.tolist())):
                if valid[number]:  # otherwise its outputs depend on the calls before
                    self._known[key] = tuple(column[number] for column in lists)

    def _predict(self, body: Callable[..., Any], runtime: Any, memory: Any) -> Any:
        key = tuple(getattr(memory, f"v_{name.upper()}") for name in self._names)
        row = self._known.get(key)
        if row is None:
            return body(runtime, memory)
        for slot, value, is_array in zip(self._slots, row, self._arrays, strict=True):
            setattr(memory, slot, list(value) if is_array else value)
        return ()

    def start(self, *, published: bool, cycle_s: float, lead_s: float = 0.0) -> RunningCompensator:
        """A new instance of FB_Compensator, enabled, called each `cycle_s`; `lead_s`: how far ahead the angle is
        taken."""
        instance = self._machine.instance(_COMPENSATE)
        instance["fCycle_s"] = cycle_s
        instance["bEnable"] = True
        instance["bPublishedLaw"] = published
        return RunningCompensator(instance, self.roles, self.te.reduction_ratio, lead_s)


class RunningCompensator:
    """One instance in the loop. What it said last: `te_deg`, `weight`."""

    def __init__(self, instance: Any, roles: Roles, ratio: float, lead_s: float) -> None:
        self._instance = instance
        self._roles = roles
        self._rad_per_rpm = lead_s * 2.0 * np.pi / 60.0 / ratio

    def __call__(self, inputs: Inputs) -> float:
        """One call. Raises GeneratedCodeError where the controller would stop."""
        block, roles = self._instance, self._roles
        block["fThetaOut_rad"] = inputs.theta_rad + self._rad_per_rpm * inputs.speed_rpm
        block[roles.speed] = inputs.speed_rpm
        if roles.torque:
            block[roles.torque] = inputs.torque_Nm
        if roles.temperature:
            block[roles.temperature] = inputs.temperature_C
        _guarded(block)
        return float(block["fCorrection_deg"])

    @property
    def te_deg(self) -> float:
        """The predicted transmission error."""
        return float(self._instance["fTE_deg"])

    @property
    def weight(self) -> float:
        """Weight of the law."""
        return float(self._instance["fWeight"])


def _read(folder: Path, dialect: str) -> Project:
    try:
        return load_project([folder], dialect)
    except StError as error:
        raise GeneratedCodeError(f"the generated text is not valid Structured Text\n{error}") from error


def _guarded(instance: Any) -> None:
    try:
        instance()
    except StRuntimeError as error:
        raise GeneratedCodeError(f"the controller would stop\n{error}") from error
