"""From encoder to correction: how long a value takes through tasks that exchange their data at fixed moments.

A chain of tasks passes a value on: each reads at the start of its cycle what the one before has handed over. With
`Exchange.AT_START` a task hands over at the start of its next cycle (the paper's controller: "variables are exchanged
at the beginning of tasks"), with `Exchange.AT_END` when its own run is over. Sampling times lie at the starts of the
first task; the delay depends on where in the common period of the tasks a sample falls.

The paper's numbers (section 4.2): a main task of 250 us, the compensation in a task of 500 us, exchange at task starts.
Main hands the angle over 250 us after it read it, the slow task starts up to 250 us later and hands over after 500 us,
main hands over after another 250 us: 1000 or 1250 us. The paper states 1325.3 us, from its Fig. 7; the 75.3 us beyond
whole cycles are what its bus and drive take after the last exchange, which is `output_us` here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from st_codegen.errors import InputError

#: Fig. 7 of the paper: what its 1325.3 us have beyond whole cycles.
PAPER_OUTPUT_US = 75.3


class Exchange(StrEnum):
    """When a task's results reach the next one."""

    AT_START = "start"
    AT_END = "end"


@dataclass(frozen=True)
class TaskTiming:
    """A cyclic task: cycle time, start of its first cycle, and time of one run, all in us.

    Times are whole multiples of 0.1 us. Raises InputError for times that make no task.
    """

    name: str
    cycle_us: float
    offset_us: float = 0.0
    run_us: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cycle_us) and self.cycle_us >= 0.1):
            raise InputError(f"task {self.name}: cycle time {self.cycle_us} us; give 0.1 or more")
        if not 0 <= self.offset_us < self.cycle_us:
            raise InputError(f"task {self.name}: offset {self.offset_us} us; give 0 .. less than {self.cycle_us}")
        if not 0 <= self.run_us <= self.cycle_us:
            raise InputError(f"task {self.name}: run time {self.run_us} us of a cycle of {self.cycle_us} us")


@dataclass(frozen=True)
class Latency:
    """Delay from a sample to the correction made from it, over all samples of the tasks' common period, in us."""

    best_us: float
    mean_us: float
    worst_us: float

    @property
    def frequency_hz(self) -> float:
        """Upper limit of what can be corrected, as the paper has it: one over the worst delay."""
        return 1e6 / self.worst_us

    def output_speed_rpm(self, order: int) -> float:
        """Output speed at which a harmonic of this order reaches `frequency_hz`. Raises InputError for order 0."""
        if order < 1:
            raise InputError(f"order {order}: the mean has no frequency; give 1 or more")
        return 60.0 * self.frequency_hz / order

    def phase_deg(self, order: int, output_speed_rpm: float, lead_s: float = 0.0) -> float:
        """Phase by which a harmonic is late after the mean delay, less the lead of `fLead_s`, in deg."""
        return order * output_speed_rpm / 60.0 * 360.0 * (self.mean_us * 1e-6 - lead_s)


_TICKS = 10  # a tick is 0.1 us: all times are integers


def latency(chain: Sequence[TaskTiming], *, output_us: float = 0.0, exchange: Exchange = Exchange.AT_START) -> Latency:
    """Delay of a value that the first task of `chain` reads and that leaves the last one, plus `output_us`.

    A task may occur several times in the chain: [main, slow, main] is the paper's. Raises InputError for an empty
    chain, and for times whose common period is longer than 10 s.
    """
    if not chain:
        raise InputError("no task: name at least the one that reads the encoder")
    if not (math.isfinite(output_us) and output_us >= 0):
        raise InputError(f"output time {output_us} us; give 0 or more")
    first = chain[0]
    period = math.lcm(*(_ticks(task.cycle_us) for task in chain))
    if period > 10_000_000 * _TICKS:
        raise InputError("the tasks' common period is longer than 10 s: give cycle times that are multiples of 1 us")
    starts = range(_ticks(first.offset_us), _ticks(first.offset_us) + period, _ticks(first.cycle_us))
    delays = [_through(chain, start, exchange) - start for start in starts]
    rest = output_us
    return Latency(min(delays) / _TICKS + rest, sum(delays) / len(delays) / _TICKS + rest, max(delays) / _TICKS + rest)


def _ticks(time_us: float) -> int:
    return round(time_us * _TICKS)


def _through(chain: Sequence[TaskTiming], sampled: int, exchange: Exchange) -> int:
    """When a sample that the first task reads at `sampled` has left the last task, in ticks."""
    time = sampled
    for task in chain:
        cycle, offset = _ticks(task.cycle_us), _ticks(task.offset_us)
        start = offset + -(-(time - offset) // cycle) * cycle  # the first start that is not earlier
        time = start + (cycle if exchange is Exchange.AT_START else _ticks(task.run_us))
    return time


def paper_latency() -> Latency:
    """The paper's controller: 1325.3 us in the worst case, 754.5 Hz."""
    main, slow = TaskTiming("main", 250.0), TaskTiming("slow", 500.0)
    return latency([main, slow, main], output_us=PAPER_OUTPUT_US)
