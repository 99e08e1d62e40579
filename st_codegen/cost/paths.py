"""The worst of all paths through a body."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from st_codegen.cost.memory import Touches, joined
from st_codegen.cost.operations import Counts, Operation, no_counts, position, weighted


class Flow(Enum):
    """Where a path goes on."""

    NEXT = "next"
    EXIT = "exit"
    CONTINUE = "continue"
    RETURN = "return"


@dataclass(frozen=True, eq=False)
class Cost:
    """What one path costs: counts by the unit whose text they stand in, and the memory it touches."""

    counts: Mapping[str, Counts] = field(default_factory=dict)
    touches: Touches = field(default_factory=dict)

    def then(self, other: Cost) -> Cost:
        """One after the other."""
        if not other.counts and not other.touches:
            return self
        counts = dict(self.counts)
        for unit, more in other.counts.items():
            counts[unit] = counts[unit] + more if unit in counts else more
        return Cost(counts, joined(self.touches, other.touches))

    def times(self, rounds: int) -> Cost:
        """The counts so many times; what is touched stays."""
        return Cost({unit: counts * rounds for unit, counts in self.counts.items()}, self.touches)

    @property
    def total(self) -> Counts:
        """The counts of all units."""
        return sum(self.counts.values(), start=no_counts())


Outcomes = dict[Flow, Cost]


class Costs:
    """Makes and compares costs in one unit; paths are compared by `weights`, the cycles of the operations."""

    def __init__(self, unit: str, weights: Mapping[Operation, float]) -> None:
        self.unit = unit
        self._weights = weights

    def of(self, *operations: Operation) -> Cost:
        """Some operations."""
        counts = no_counts()
        for operation in operations:
            counts[position(operation)] += 1
        return Cost({self.unit: counts})

    def worse(self, first: Cost | None, second: Cost | None) -> Cost | None:
        """The counts of the slower path, with what either touches; None is no path."""
        if first is None or second is None:
            return first or second
        slower = first if self._cycles(first) >= self._cycles(second) else second
        return Cost(slower.counts, joined(first.touches, second.touches))

    def _cycles(self, cost: Cost) -> float:
        return weighted(cost.total, self._weights)

    def worst(self, costs: Iterable[Cost | None]) -> Cost | None:
        """The worst of several."""
        result: Cost | None = None
        for cost in costs:
            result = self.worse(result, cost)
        return result

    def choose(self, ways: Iterable[Outcomes]) -> Outcomes:
        """Branches: the worst for each way to go on."""
        ways = list(ways)
        worst = {flow: self.worst(way.get(flow) for way in ways) for flow in Flow}
        return {flow: cost for flow, cost in worst.items() if cost is not None}

    def sequence(self, steps: Iterable[Callable[[], Outcomes]]) -> Outcomes:
        """Statements one after the other; what cannot be reached costs nothing."""
        done: Outcomes = {}
        here: Cost | None = Cost()
        for step in steps:
            if here is None:
                break
            onward: Cost | None = None
            for flow, cost in step().items():
                total = here.then(cost)
                if flow is Flow.NEXT:
                    onward = total
                else:
                    done = self.choose([done, {flow: total}])
            here = onward
        return done if here is None else self.choose([done, {Flow.NEXT: here}])

    def loop(self, rounds: int, body: Outcomes, *, each: Cost, last: Cost) -> Outcomes:
        """`rounds` times a body after `each`, then `last`: every way out of it, the touches being those of all rounds.

        A round that leaves by EXIT or RETURN is the last one, so that rounds - 1 whole ones may have gone before.
        """
        touched = Cost()
        for cost in (each, last, *body.values()):
            touched = touched.then(Cost({}, cost.touches))
        stay = self.worse(body.get(Flow.NEXT), body.get(Flow.CONTINUE))
        whole = Cost() if stay is None else each.then(stay)
        # no round at all is a way through, too: `rounds` is only the largest number
        ends = [last] if stay is None else [last, whole.times(rounds).then(last)]
        result: Outcomes = {}
        if rounds >= 1:
            before = whole.times(rounds - 1).then(each)
            if Flow.EXIT in body:
                ends.append(before.then(body[Flow.EXIT]))
            if Flow.RETURN in body:
                result[Flow.RETURN] = touched.then(before.then(body[Flow.RETURN]))
        return {**result, Flow.NEXT: touched.then(self.worst(ends) or last)}
