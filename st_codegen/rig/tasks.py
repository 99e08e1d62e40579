"""The PLC's tasks in time: who sees which value when (section 4.2 of the paper).

Rules, as the paper states them: signals go over the fieldbus once in a main cycle, and variables are exchanged at the
beginning of tasks. So at each tick the tasks that start publish what they computed in their last cycle, then read what
is published. `st_codegen/te/latency.py` counts what that takes; the paper's 1325.3 us leave 75.3 us for the transfer
to the drive, which is our split: the parts of its time diagram are not in the text.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

from st_codegen.errors import InputError
from st_codegen.files.toml_tables import TomlTable
from st_codegen.rig.axis_parameters import parameter, read_parameters
from st_codegen.te.latency import PAPER_OUTPUT_US, Latency, TaskTiming, latency


class TaskForm(StrEnum):
    """In which of the PLC's tasks the blocks of the compensation run."""

    ONE = "one"  # all of it in the main task
    TWO = "two"  # all of it in the slow task, as published
    SPLIT = "split"  # coefficients in the slow task, their sum in the main task


@dataclass(frozen=True)
class TaskSettings:
    """Cycle times of the PLC; table `[tasks]` of a rig file."""

    main_us: float = parameter(250.0, 10.0, 1e5, "[P]")
    slow_us: float = parameter(500.0, 10.0, 1e6, "[P]")
    transfer_us: float = parameter(PAPER_OUTPUT_US, 0.0, 1e5, "what 1325.3 us [P] leave beside whole cycles")
    jitter_us: float = parameter(0.0, 0.0, 1e4, "standard deviation of the instants of sampling, none unless asked for")

    def __post_init__(self) -> None:
        if abs(self.slow_us / self.main_us - self.ratio) > 1e-9 or self.ratio < 1:
            raise InputError(f"slow_us = {self.slow_us:g} is no multiple of main_us = {self.main_us:g}")
        if self.transfer_us >= self.main_us:
            raise InputError(f"transfer_us = {self.transfer_us:g} does not fit main_us = {self.main_us:g}")
        self.latency(TaskForm.TWO)  # times of which no age can be told are refused here, before anything moves

    @property
    def ratio(self) -> int:
        """The number of main cycles in a slow one."""
        return round(self.slow_us / self.main_us)

    def latency(self, form: TaskForm) -> Latency:
        """Age of an angle when its correction gets to the drive, by the form's chain of bus and tasks."""
        bus, main = TaskTiming("bus", self.main_us), TaskTiming("main", self.main_us)
        chain = [bus, main, TaskTiming("slow", self.slow_us), main] if form is TaskForm.TWO else [bus, main]
        return latency(chain, output_us=self.transfer_us)


def read_tasks(table: TomlTable) -> TaskSettings:
    """The tasks of a rig file from its table `[tasks]`; everything that is wrong is noted."""
    with table.collect():
        return read_parameters(TaskSettings, table)
    return TaskSettings()


class TaskInputs(NamedTuple):
    """What the blocks are given: the output's angle by its encoder, the rest by the profile and the oil's sensor.

    `torque_Nm` opposes the motion, `load_Nm`, where the blocks are given it, is above 0 against forward motion.
    """

    theta_rad: float
    speed_rpm: float
    torque_Nm: float
    temperature_C: float
    load_Nm: float = 0.0


class TaskedCompensator(Protocol):
    """The compensator as the tasks call it."""

    def correct(self, inputs: TaskInputs) -> float:
        """The correction of the motor's reference, deg."""

    def prepare(self, inputs: TaskInputs) -> None:
        """The slow part of the split form, which leaves its result to the fast one."""


@dataclass
class Plc:
    """The tasks, tick by tick; without an application the motor's reference goes out as it is."""

    settings: TaskSettings
    form: TaskForm
    application: TaskedCompensator | None
    _latched: TaskInputs | None = None
    _main_inputs: TaskInputs | None = None
    _setpoint: float | None = None
    _from_slow: float = 0.0
    _slow_result: float = 0.0

    def tick(self, number: int, sample: TaskInputs, reference_deg: float) -> float | None:
        """One main cycle, in which `sample` is latched; the set-point published now, deg, None in the first cycle."""
        slow_starts = self.form is not TaskForm.ONE and number % self.settings.ratio == 0
        # all tasks that start publish what their last cycle computed
        published, to_slow = self._setpoint, self._main_inputs
        if slow_starts:
            self._from_slow = self._slow_result
        # then they read and run, the main task first: it has the higher priority
        inputs, self._latched = self._latched or sample, sample
        self._main_inputs = inputs
        self._setpoint = reference_deg + self._main(inputs)
        if slow_starts and to_slow is not None and self.application is not None:
            if self.form is TaskForm.SPLIT:
                # the blocks hand their sets on in shared memory themselves
                self.application.prepare(to_slow)
            else:
                self._slow_result = self.application.correct(to_slow)
        return published

    def _main(self, inputs: TaskInputs) -> float:
        if self.application is None:
            return 0.0
        return self._from_slow if self.form is TaskForm.TWO else self.application.correct(inputs)
