"""What paths through a body cost, and which of them is the worst."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from st_codegen.cost.memory import LINE, Choice, Touches, joined
from st_codegen.cost.operations import CostClass, Counts, no_counts, position, weighted


class Flow(Enum):
    """Where a path goes on."""

    NEXT = "next"
    EXIT = "exit"
    CONTINUE = "continue"
    RETURN = "return"


@dataclass(frozen=True)
class CodeLines:
    """Lines of one unit's code that a path runs: those that are `known`, a bit each, and at most so many `others`."""

    known: int = 0
    others: int = 0

    @classmethod
    def between(cls, start: int, stop: int) -> CodeLines:
        """The lines of the bytes from `start` to before `stop`, counted from the unit's first."""
        if stop <= start:
            return cls()
        first, last = start // LINE, (stop - 1) // LINE
        return cls((1 << (last + 1)) - (1 << first))

    @property
    def number(self) -> int:
        """How many they are, at most."""
        return self.known.bit_count() + self.others

    def then(self, other: CodeLines) -> CodeLines:
        """The lines of a path followed by another one."""
        return CodeLines(self.known | other.known, self.others + other.others)

    def or_else(self, other: CodeLines) -> CodeLines:
        """The lines of either of two paths: those that both run, and the most that one has beside them."""
        both = self.known & other.known
        return CodeLines(both, max(self.number, other.number) - both.bit_count())


@dataclass(frozen=True, eq=False)
class PathCost:
    """What one path costs: counts by the unit whose text they stand in, the memory it touches, and the code it runs.

    Of several branches `touches` has what any of them touches. `called` are those of it that stand in a call, which is
    there once in the text, and `choices` which of those belong to one or the other of two branches.
    """

    counts: Mapping[str, Counts] = field(default_factory=dict)
    touches: Touches = field(default_factory=dict)
    code: Mapping[str, CodeLines] = field(default_factory=dict)
    called: frozenset[Hashable] = frozenset()
    choices: tuple[Choice, ...] = ()

    def then(self, other: PathCost) -> PathCost:
        """The cost of this path followed by another one."""
        if not other.counts and not other.touches and not other.code:
            return self
        counts = dict(self.counts)
        for unit, more in other.counts.items():
            counts[unit] = counts[unit] + more if unit in counts else more
        code = dict(self.code)
        for unit, lines in other.code.items():
            code[unit] = code[unit].then(lines) if unit in code else lines
        together = joined(self.touches, other.touches)
        return PathCost(counts, together, code, self.called | other.called, _both(self, other))

    def times(self, rounds: int) -> PathCost:
        """The counts of the path taken `rounds` times; what it touches and runs stays the same."""
        return replace(self, counts={unit: counts * rounds for unit, counts in self.counts.items()})

    @property
    def total(self) -> Counts:
        """The counts of all units together."""
        return sum(self.counts.values(), start=no_counts())


def _both(first: PathCost, second: PathCost) -> tuple[Choice, ...]:
    """The choices of two paths, which may have a part in common."""
    return tuple(dict.fromkeys((*first.choices, *second.choices)))


Outcomes = dict[Flow, PathCost]


class Costs:
    """Makes and compares costs in one unit; paths are compared by `weights`, the cycles of the operations."""

    def __init__(self, unit: str, weights: Mapping[CostClass, float]) -> None:
        self.unit = unit
        self._weights = weights

    def of(self, *operations: CostClass) -> PathCost:
        """The cost of some operations of this unit."""
        counts = no_counts()
        for operation in operations:
            counts[position(operation)] += 1
        return PathCost({self.unit: counts})

    def worse(self, first: PathCost | None, second: PathCost | None) -> PathCost | None:
        """The counts of the slower path, what either touches, and the most lines of code; None is no path."""
        if first is None or second is None:
            return first or second
        slower = first if self._cycles(first) >= self._cycles(second) else second
        none = CodeLines()
        code = {
            unit: first.code.get(unit, none).or_else(second.code.get(unit, none))
            for unit in {**first.code, **second.code}
        }
        choices, ways = _both(first, second), (first.called - second.called, second.called - first.called)
        together = joined(first.touches, second.touches)
        return PathCost(
            slower.counts, together, code, first.called | second.called, (*choices, ways) if all(ways) else choices
        )

    def _cycles(self, cost: PathCost) -> float:
        return weighted(cost.total, self._weights)

    def worst(self, costs: Iterable[PathCost | None]) -> PathCost | None:
        """The worst of several paths, None when there is none."""
        result: PathCost | None = None
        for cost in costs:
            result = self.worse(result, cost)
        return result

    def choose(self, ways: Iterable[Outcomes]) -> Outcomes:
        """The worst of several branches for each way to go on."""
        ways = list(ways)
        worst = {flow: self.worst(way.get(flow) for way in ways) for flow in Flow}
        return {flow: cost for flow, cost in worst.items() if cost is not None}

    def sequence(self, steps: Iterable[Callable[[], Outcomes]]) -> Outcomes:
        """The cost of statements one after the other; what cannot be reached costs nothing."""
        done: Outcomes = {}
        here: PathCost | None = PathCost()
        for step in steps:
            if here is None:
                break
            onward: PathCost | None = None
            for flow, cost in step().items():
                total = here.then(cost)
                if flow is Flow.NEXT:
                    onward = total
                else:
                    done = self.choose([done, {flow: total}])
            here = onward
        return done if here is None else self.choose([done, {Flow.NEXT: here}])

    def loop(self, rounds: int, body: Outcomes, *, each: PathCost, last: PathCost) -> Outcomes:
        """`rounds` times a body after `each`, then `last`: every way out of it, the touches being those of all rounds.

        A round that leaves by EXIT or RETURN is the last one, so that rounds - 1 whole ones may have gone before.
        """
        touched = PathCost()
        for cost in (each, last, *body.values()):
            touched = touched.then(PathCost({}, cost.touches))
        stay = self.worse(body.get(Flow.NEXT), body.get(Flow.CONTINUE))
        whole = PathCost() if stay is None else each.then(stay)
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
