"""A soft PLC: the programs of a generated project, called by their tasks in the engine for Structured Text."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

from st_codegen.emit.blocks import comparison
from st_codegen.errors import InputError
from st_codegen.live.symbols import WireVariables, assigned_globals
from st_codegen.proof.runner import GeneratedCode, tasks_in
from st_codegen.st import Machine, StRuntimeError
from st_codegen.st.run.machine import Instance
from st_codegen.st.tree import PouKind
from st_codegen.te.compensation import recorder

#: Programs whose variables clients set although the program sets them too, and which ones these are.
_HANDSHAKES = {
    comparison.PROGRAM: (comparison.LIST, comparison.FROM_CLIENT),
    recorder.PROGRAM: (recorder.LIST, recorder.FROM_CLIENT),
}
#: Cycles that are run in one go, in seconds of this machine; clients wait so long at most.
_BATCH_S = 0.002
#: A clock that is so far behind is set again, in seconds.
_LATE_S = 0.1

Log = Callable[[str], None]


def host_and_port(host: str, port: int) -> str:
    """An address as it is written; that of IPv6 has colons of its own."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class PlcState(Enum):
    """What a controller says that it does."""

    RUN = "RUN"
    STOP = "STOP"
    CONFIG = "CONFIG"
    ERROR = "ERROR"


class Plant(Protocol):
    """What stands behind the signals of a controller."""

    #: The global variables that it sets, as `LIST.NAME` in upper case.
    drives: frozenset[str]

    def step(self, cycle_s: float, *, is_enabled: bool) -> None:
        """One tick: read the commands, move, set the sensors; not enabled, everything comes to rest."""


@dataclass(frozen=True)
class PlcTask:
    """A cyclic task of the project."""

    name: str
    cycle_us: int
    priority: int
    programs: tuple[str, ...]


def plc_tasks(folder: Path) -> tuple[PlcTask, ...]:
    """The tasks of a TwinCAT project, the most urgent first. Raises InputError for a file that is none."""
    found = []
    for path, root, programs in tasks_in(folder):
        cycle, priority = (str(root.findtext(f".//{tag}", "")).strip() for tag in ("CycleTime", "Priority"))
        if not (cycle.isdecimal() and int(cycle) and priority.isdecimal() and programs):
            raise InputError(f"{path}: a task has a cycle time, a priority and a program; generate again")
        found.append(PlcTask(path.stem, int(cycle), int(priority), programs))
    return tuple(sorted(found, key=lambda task: task.priority))


class SoftPlc:
    """A project that runs, tick by tick.

    `cycle_us` is the cycle time of programs that no task calls (all of them, where a target has no tasks). `speed` is
    how many times faster than the clock of this machine it runs; 0: as fast as it can. `optimised` code takes longer to
    compile. Raises InputError where there is nothing to run.
    """

    def __init__(
        self,
        folder: Path,
        *,
        cycle_us: int = 500,
        speed: float = 1.0,
        log: Log = lambda _: None,
        optimised: bool = True,
    ) -> None:
        self.code = GeneratedCode(folder)
        self.machine = Machine(self.code.project, libraries=self.code.libraries, optimised=optimised)
        self.tasks = plc_tasks(folder) or self._only_task(folder, cycle_us)
        self.tick_us = math.gcd(*(task.cycle_us for task in self.tasks))
        self.speed = speed
        self.state = PlcState.RUN
        self.ticks = 0
        self.late = 0
        self.plant: Plant | None = None
        self.after_batch: Callable[[], None] = lambda: None
        self._log = log
        self._programs: list[tuple[int, list[Instance]]] = []
        for task in self.tasks:
            instances = [self.machine.program(name) for name in task.programs]
            for instance in instances:
                instance.compile()
            self._programs.append((task.cycle_us // self.tick_us, instances))
        self._spelling = {path.stem.upper(): path.stem for path in folder.rglob("*.TcGVL")}
        self.symbols = self._symbols(frozenset())

    def _only_task(self, folder: Path, cycle_us: int) -> tuple[PlcTask, ...]:
        names = [pou.name for pou in self.code.project.pous.values() if pou.kind is PouKind.PROGRAM]
        if not names:
            raise InputError(
                f"{folder}: no program, so that nothing runs; generate with --with-comparison, or a bundle"
            )
        return (PlcTask("PlcTask", cycle_us, 0, tuple(names)),)

    def _symbols(self, driven: frozenset[str]) -> WireVariables:
        project = self.code.project
        every = {f"{name}.{variable.key}" for name, variables in project.globals.items() for variable in variables}
        own = frozenset(name.upper() for name in _HANDSHAKES)
        inputs = every - assigned_globals(project, own) - driven
        for list_name, names in _HANDSHAKES.values():
            key = list_name.upper()
            inputs = {name for name in inputs if not name.startswith(f"{key}.")}
            inputs |= {f"{key}.{name.upper()}" for name in names} & every
        return WireVariables(self.machine, frozenset(inputs), self._spelling)

    def connect(self, plant: Plant) -> None:
        """Put a plant behind the signals; what it sets is no longer an input of clients."""
        self.plant = plant
        self.symbols = self._symbols(plant.drives)

    @property
    def time_s(self) -> float:
        """Time of the controller since its start."""
        return self.ticks * self.tick_us * 1e-6

    def tick(self) -> None:
        """One tick: the plant, then the tasks whose cycle begins, the most urgent first."""
        if self.plant is not None:
            self.plant.step(self.tick_us * 1e-6, is_enabled=self.state is PlcState.RUN)
        if self.state is PlcState.RUN:
            try:
                for every, instances in self._programs:
                    if self.ticks % every == 0:
                        for instance in instances:
                            instance()
            except StRuntimeError as error:
                self.state = PlcState.ERROR
                self._log(f"the controller stops: {error}")
        self.ticks += 1

    def set_state(self, state: PlcState) -> None:
        """Start or stop the tasks."""
        if state is not self.state:
            self._log(f"state {self.state.value} -> {state.value}")
            self.state = state

    async def run(self, stopping: asyncio.Event) -> None:
        """Run in time until `stopping` is set; clients are served between batches of ticks."""
        begin, begun = time.perf_counter(), self.ticks
        while not stopping.is_set():
            now = time.perf_counter()
            if self.speed:
                due = begun + int((now - begin) * self.speed / (self.tick_us * 1e-6))
                if (due - self.ticks) * self.tick_us * 1e-6 > _LATE_S * max(self.speed, 1.0):
                    self.late += due - self.ticks
                    begin, begun, due = now, self.ticks, self.ticks + 1
                elif due < self.ticks - 1:  # it ran faster until now
                    begin, begun = now, self.ticks
                while self.ticks < due and time.perf_counter() < now + _BATCH_S:
                    self.tick()
            else:
                while time.perf_counter() < now + _BATCH_S:
                    self.tick()
            self.after_batch()
            await asyncio.sleep(0.0005 if self.speed else 0.0)
