"""From encoder to correction: how old an angle is when the correction made from it gets to the drive.

A chain of tasks passes a value on: each starts with what the one before has handed over last. With `Exchange.AT_START`
a task hands over at the start of its next cycle (the paper's controller: "variables are exchanged at the beginning of
tasks"), with `Exchange.AT_END` when its own run is over. A fieldbus that latches the encoder at the start of its cycle
and delivers at the next one is the first task of the chain. Values that are overwritten before anybody reads them do
not count; a value that is used in several cycles gets older by a cycle each time.

The paper's numbers (section 4.2): bus and main task of 250 us, the compensation in a task of 500 us, exchange at task
starts. Latched at 0, read by main at 250, by the slow task at 500, handed back at 1000, on the bus at 1250 us. The
paper states 1325.3 us, from its Fig. 7; the 75.3 us beyond whole cycles are what bus and drive take after the last
exchange, which is `output_us` here. The split is ours: the parts of the figure are not in the text.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

from st_codegen.errors import InputError

#: Fig. 7 of the paper: what its 1325.3 us have beyond whole cycles.
PAPER_OUTPUT_US = 75.3

#: What fLead_s of the compensator takes at most.
LONGEST_LEAD_S = 0.1


class Exchange(StrEnum):
    """When a task's results reach the next one."""

    AT_START = "start"
    AT_END = "end"


_TICKS = 10  # a tick is 0.1 us: all times are integers
_ROUNDING = 1e-12  # of a time that is computed from others
_LONGEST_US = 1e7


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
        if not 0.1 <= self.cycle_us <= _LONGEST_US:
            raise InputError(f"task {self.name}: cycle time {self.cycle_us} us; give 0.1 .. {_LONGEST_US:.0f} (10 s)")
        if not 0 <= self.offset_us < self.cycle_us:
            raise InputError(f"task {self.name}: offset {self.offset_us} us; give 0 .. less than {self.cycle_us}")
        if not 0 <= self.run_us <= self.cycle_us:
            raise InputError(f"task {self.name}: run time {self.run_us} us of a cycle of {self.cycle_us} us")
        for time_us in (self.cycle_us, self.offset_us, self.run_us):
            if abs(time_us * _TICKS - round(time_us * _TICKS)) > _ROUNDING * max(1.0, abs(time_us)):
                raise InputError(f"task {self.name}: {time_us} us; give whole multiples of 0.1 us")


@dataclass(frozen=True)
class Latency:
    """Age of an angle when the correction made from it arrives, in us.

    best, slowest: the least and the greatest age of a new value, which is one that arrives for the first time. They
    differ where the cycles are no multiples of each other: then the tasks wait for each other now more, now less.
    worst: a value that has been repeated longest; mean: over all that arrive.
    """

    best_us: float
    slowest_us: float
    mean_us: float
    worst_us: float

    @property
    def frequency_hz(self) -> float:
        """Upper limit of what can be corrected, as the paper has it: one over the time from value to correction.

        The time is that which every new value keeps, the rare and fast ones do not make the limit.
        """
        return 1e6 / self.slowest_us

    def output_speed_rpm(self, order: int) -> float:
        """Output speed at which a harmonic of this order reaches `frequency_hz`. Raises InputError for order 0."""
        if order < 1:
            raise InputError(f"order {order}: the mean has no frequency; give 1 or more")
        return 60.0 * self.frequency_hz / order


def latency(chain: Sequence[TaskTiming], *, output_us: float = 0.0, exchange: Exchange = Exchange.AT_START) -> Latency:
    """Age of what the last task of `chain` hands over, counted from the start of the first one, plus `output_us`.

    A task may occur several times in the chain: [bus, main, slow, main] is the paper's. Raises InputError for an empty
    chain, for times whose common period is longer than 10 s, and where nothing takes any time.
    """
    if not chain:
        raise InputError("no task: name at least the one that reads the encoder")
    if not 0 <= output_us <= _LONGEST_US:
        raise InputError(f"output time {output_us} us; give 0 .. {_LONGEST_US:.0f} (10 s)")
    last = chain[-1]
    period = math.lcm(*(_ticks(task.cycle_us) for task in chain))
    if period > _LONGEST_US * _TICKS:
        raise InputError(
            "the tasks' common period is longer than 10 s: give cycle times that are multiples of each other"
        )
    starts = range(_ticks(last.offset_us), _ticks(last.offset_us) + period, _ticks(last.cycle_us))
    ages = [_age(chain, start, exchange) for start in starts]
    if min(ages) / _TICKS + output_us <= 0:
        raise InputError("nothing takes any time: give the cycle of the bus, the time of a run, or the output's")
    # a value that was used before is older by just one cycle of the last task
    new = [age for before, age in pairwise([ages[-1], *ages]) if age != before + _ticks(last.cycle_us)]
    return Latency(*(age / _TICKS + output_us for age in (min(new), max(new), sum(ages) / len(ages), max(ages))))


def _ticks(time_us: float) -> int:
    return round(time_us * _TICKS)


def _hand_over(task: TaskTiming, exchange: Exchange) -> int:
    """Ticks from a task's start until others can read what it made of it."""
    return _ticks(task.cycle_us if exchange is Exchange.AT_START else task.run_us)


def _age(chain: Sequence[TaskTiming], start: int, exchange: Exchange) -> int:
    """Age of what a run of the last task hands over that begins at `start`, in ticks: back through the chain."""
    handed_over = start + _hand_over(chain[-1], exchange)
    for task in reversed(chain[:-1]):
        cycle, offset = _ticks(task.cycle_us), _ticks(task.offset_us)
        latest = start - _hand_over(task, exchange) - offset
        start = offset + latest // cycle * cycle
    return handed_over - start
