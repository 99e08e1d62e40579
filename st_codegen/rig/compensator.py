"""The generated Structured Text itself as the compensator: emitted files, read back, compiled once, run each cycle."""

from __future__ import annotations

import dataclasses
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from st_codegen.driver import generate, wishes_of
from st_codegen.emit.blocks.model import input_variables
from st_codegen.emit.targets import target_named
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.files.temporary import temporary_folder
from st_codegen.project.bundle import Bundle
from st_codegen.rig.tasks import TaskForm, TaskInputs, TaskSettings
from st_codegen.st import Machine, StRuntimeError, load_project
from st_codegen.te.compensation.correction import SIGNED_LOAD
from st_codegen.te.compensation.parts import names_of
from st_codegen.te.compensation.programs import FAST_US, SIGNALS
from st_codegen.te.harmonics import TransmissionError
from st_codegen.te.latency import LONGEST_LEAD_S
from st_codegen.te.purpose import Compensation, transmission_error

_COMPENSATE = "FB_Compensator"
PRG_FAST, PRG_SLOW = "PRG_FAST", "PRG_SLOW"
#: Laws by name, as inputs of the blocks: Eq. 6; speed / 100 rpm below 100 rpm; full correction at all speeds.
LAWS: dict[str, dict[str, Any]] = {
    "published": {"bPublishedLaw": True},
    "continuous": {"bPublishedLaw": False},
    "full": {"bPublishedLaw": False, "fFullSpeed_rpm": 0.0},
}


@dataclass(frozen=True)
class Roles:
    """Which input of the blocks is which quantity."""

    speed: str
    torque: str
    temperature: str


def roles_of(te: TransmissionError) -> Roles:
    """Which feature is the torque and which the temperature, by name or unit. Raises InputError where it is unclear."""
    names = names_of(input_variables(te.features))
    found = {"torque": "", "temperature": ""}
    units = {"torque": ("Nm",), "temperature": ("°C", "degC", "C", "K")}
    for number, (feature, name) in enumerate(zip(te.features, names, strict=True)):
        if number == te.speed_feature:
            found["speed"] = name
            continue
        for role, known in units.items():
            if feature.name.lower().startswith(role) or feature.unit.replace(" ", "") in known:
                if found[role]:
                    raise InputError(
                        f"bundle '{te.name}': two features look like a {role}; name them torque_Nm and temperature_C"
                    )
                found[role] = name
                break
        else:
            raise InputError(
                f"bundle '{te.name}': the rig does not know the feature '{feature.name}' ({feature.unit}); it "
                "simulates speed, torque and oil temperature"
            )
    return Roles(**found)


def restricted(bundle: Bundle, orders: Sequence[int]) -> Bundle:
    """The bundle with some of its orders only. Raises InputError for orders that it does not have."""
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
    own = tuple(correction for correction in te.corrections if correction.order in chosen)
    play = te.play if 0 in chosen else None
    return Bundle(
        tuple(model for model in bundle.models if model.ir.name in used),
        Compensation(dataclasses.replace(te, orders=chosen, outputs=outputs, play=play, corrections=own)),
    )


class EmittedCompensator:
    """The blocks of one bundle, generated to files for a target and read back.

    Raises GeneratedCodeError where a controller would stop.
    """

    def __init__(self, bundle: Bundle, target: str = "twincat", outputs_per_cycle: int | None = None) -> None:
        self.te = transmission_error(bundle)
        self.roles = roles_of(self.te)
        with temporary_folder(Path(tempfile.gettempdir())) as folder:
            form = target_named(target)
            wishes = wishes_of({"outputs_per_cycle": outputs_per_cycle}, [form])[form.name]
            generated = generate(bundle, form, folder, **wishes)
            self.project = load_project([generated.folder], target)
        #: inputs of the blocks, in the order of the features
        self.names = names_of(input_variables(self.te.features))
        self._machine = Machine(self.project)

    def start(
        self,
        form: TaskForm,
        law: str,
        tasks: TaskSettings,
        lead_s: float = 0.0,
        inputs: Mapping[str, float] = MappingProxyType({}),
        *,
        load_given: bool = False,
    ) -> RunningCompensator:
        """The blocks of a form, enabled, from their first state; `lead_s`: how far ahead the angle is taken.

        `inputs`: other inputs of the block by name, such as fBlendTime_s; `load_given`: the load's sign is one, too.

        Raises InputError for a lead time, a form or a load that the generated code does not take.
        """
        if not 0.0 <= lead_s <= LONGEST_LEAD_S:
            raise InputError(f"a lead of {lead_s * 1e6:g} us: the compensator takes 0 .. {LONGEST_LEAD_S * 1e6:g} us")
        settings = {"bEnable": True, "fLead_s": lead_s, **LAWS[law], **self._checked(inputs)}
        if load_given:
            if self.te.play is None:
                raise InputError(f"bundle '{self.te.name}' has no [play], so its blocks take no load with a sign")
            settings["bLoadGiven"] = True
        if form is not TaskForm.SPLIT:
            block = self._machine.instance(_COMPENSATE)
            for name, value in settings.items():
                block[name] = value
            block["fCycle_s"] = (tasks.slow_us if form is TaskForm.TWO else tasks.main_us) * 1e-6
            return RunningCompensator(block, block, None, self.roles, load_given)
        if PRG_FAST not in self.project.pous:
            raise InputError("two tasks that share the work exchange global variables: choose the target twincat")
        if tasks.main_us != FAST_US:
            raise InputError(f"PRG_Fast is made for a cycle of {FAST_US:g} us, [tasks] has main_us = {tasks.main_us:g}")
        machine = Machine(self.project)  # programs exist once in a machine
        signals = _Signals(machine)
        for name, value in settings.items():
            signals[name] = value
        return RunningCompensator(signals, machine.program(PRG_FAST), machine.program(PRG_SLOW), self.roles, load_given)

    def _checked(self, inputs: Mapping[str, float]) -> Mapping[str, float]:
        own = {"fThetaOut_rad", "fCycle_s", *self.names}
        ports = self._machine.instance(_COMPENSATE).inputs
        known = [port.name for port in ports if port.name.startswith("f") and port.name not in own]
        unknown = sorted(set(inputs) - set(known))
        if unknown:
            raise InputError(f"{_COMPENSATE} has no input {', '.join(unknown)} to set; it has {', '.join(known)}")
        return inputs


class _Signals:
    """The global variables of the programs, by their plain names."""

    def __init__(self, machine: Machine) -> None:
        self._globals = machine.globals

    def __getitem__(self, name: str) -> Any:
        return self._globals[f"{SIGNALS}.{name}"]

    def __setitem__(self, name: str, value: Any) -> None:
        self._globals[f"{SIGNALS}.{name}"] = value


class RunningCompensator:
    """The generated code in the loop: `correct` in each cycle of the task that corrects, `prepare` of the slow one."""

    def __init__(self, ports: Any, fast: Any, slow: Any, roles: Roles, load_given: bool) -> None:
        self._ports = ports
        self._fast = fast
        self._slow = slow
        self._roles = roles
        self._load_given = load_given
        #: calls of the correcting task, and of these those that refused their inputs, by the number of the error
        self.calls = 0
        self.refused: Counter[int] = Counter()
        #: calls in which the correction was as large as it may be
        self.limited = 0

    def correct(self, inputs: TaskInputs) -> float:
        """The correction of the motor's reference, deg. Raises GeneratedCodeError where the controller would stop."""
        self._ports["fThetaOut_rad"] = inputs.theta_rad
        self._ports[self._roles.speed] = inputs.speed_rpm
        if self._load_given:
            self._ports[SIGNED_LOAD.name] = inputs.load_Nm
        if self._slow is None or self._load_given:
            self._operating_point(inputs)
        _guarded(self._fast)
        self.calls += 1
        if not self._ports["bValid"]:
            self.refused[int(self._ports["eError"])] += 1
        correction = float(self._ports["fCorrection_deg"])
        self.limited += abs(correction) >= self.limit_deg > 0.0
        return correction

    @property
    def limit_deg(self) -> float:
        """The largest correction, deg at the motor."""
        return float(self._ports["fCorrectionLimit_deg"])

    def prepare(self, inputs: TaskInputs) -> None:
        """The slow task of the split form: new coefficients."""
        self._ports[self._roles.speed] = inputs.speed_rpm
        self._operating_point(inputs)
        _guarded(self._slow)

    def _operating_point(self, inputs: TaskInputs) -> None:
        if self._roles.torque:
            self._ports[self._roles.torque] = inputs.torque_Nm
        if self._roles.temperature:
            self._ports[self._roles.temperature] = inputs.temperature_C

    @property
    def te_deg(self) -> float:
        """The transmission error it predicted last."""
        return float(self._ports["fTE_deg"])

    @property
    def weight(self) -> float:
        """Weight of the law in the last call."""
        return float(self._ports["fWeight"])


def _guarded(instance: Any) -> None:
    try:
        instance()
    except StRuntimeError as error:
        raise GeneratedCodeError(f"the controller would stop\n{error}") from error
