"""What paths through a body cost, and which of them is the worst."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from st_codegen.cost.memory import LINE, Touches, joined, lines_by_region
from st_codegen.cost.operations import CostClass, Counts, no_counts, position, weighted


class Flow(Enum):
    """Where execution goes on at the end of a path: behind it, or out of a loop, its round, or the unit."""

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
        """The number of lines of code, at most."""
        return self.known.bit_count() + self.others

    def then(self, other: CodeLines) -> CodeLines:
        """The lines of a path followed by another one."""
        return CodeLines(self.known | other.known, self.others + other.others)

    def or_else(self, other: CodeLines) -> CodeLines:
        """The lines of either of two paths: those that both run, and the most that one has beside them."""
        both = self.known & other.known
        return CodeLines(both, max(self.number, other.number) - both.bit_count())


Keys = frozenset[Hashable]


@dataclass(frozen=True)
class CodeOf:
    """A key that says that a call runs a unit."""

    unit: str


def at_site(site: int, keys: Iterable[Hashable]) -> Keys:
    """The keys of a called unit, seen from its caller: those of one call."""
    return frozenset((site, key) for key in keys)


def _unit_of(key: Hashable) -> str | None:
    """The unit whose code a key stands for; seen from callers it is behind the numbers of their calls."""
    while isinstance(key, tuple) and key:
        key = key[-1]
    return key.unit if isinstance(key, CodeOf) else None


@dataclass(frozen=True, eq=False)
class PathCost:
    """What one path costs: counts by the unit whose text they stand in, the memory it touches, and the code it runs.

    Of several branches `touches` and `code` have what any of them touches and runs. `called` are the keys of what calls
    touch, and a CodeOf for each unit that they run: a call is there once in the text. `choices` are those that only
    the first, and only the second, of two branches has.
    """

    counts: Mapping[str, Counts] = field(default_factory=dict)
    touches: Touches = field(default_factory=dict)
    code: Mapping[str, CodeLines] = field(default_factory=dict)
    called: Keys = frozenset()
    choices: tuple[tuple[Keys, Keys], ...] = ()

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

    def of_one_way(self) -> PathCost:
        """The memory and the code of a path that takes one branch of each choice: that with the most lines.

        What is compared is what one branch alone touches and runs, so that all else is counted. Inner choices come
        first.
        """
        touches, code = dict(self.touches), dict(self.code)
        for choice in self.choices:
            keys_of: dict[Hashable, set[Hashable]] = {}
            for key, touch in touches.items():
                keys_of.setdefault(touch.region, set()).add(key)
            for key in self.called:
                if (unit := _unit_of(key)) in code:
                    keys_of.setdefault(unit, set()).add(key)
            lines: dict[Hashable, int] = {unit: run.number for unit, run in code.items()}
            lines.update(lines_by_region(touches).items())
            alone = [[what for what, keys in keys_of.items() if keys <= way] for way in choice]
            for what in min(alone, key=lambda parts: sum(lines[part] for part in parts)):
                if isinstance(what, str):
                    del code[what]
                for key in keys_of[what]:
                    touches.pop(key, None)
        return replace(self, touches=touches, code=code, choices=())

    @property
    def total(self) -> Counts:
        """The counts of all units together."""
        return sum(self.counts.values(), start=no_counts())


def _both(first: PathCost, second: PathCost) -> tuple[tuple[Keys, Keys], ...]:
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

    def loop(self, rounds: int, body: Outcomes, *, each: PathCost) -> Outcomes:
        """`rounds` times a body after `each`, then `each` alone: every way out, the touches being those of all rounds.

        A round that leaves by EXIT or RETURN is the last one, so that rounds - 1 whole ones may have gone before.
        """
        touched = PathCost()
        for cost in (each, each, *body.values()):
            touched = touched.then(PathCost({}, cost.touches))
        stay = self.worse(body.get(Flow.NEXT), body.get(Flow.CONTINUE))
        whole = PathCost() if stay is None else each.then(stay)
        # no round at all is a way through, too: `rounds` is only the largest number
        ends = [each] if stay is None else [each, whole.times(rounds).then(each)]
        result: Outcomes = {}
        if rounds >= 1:
            before = whole.times(rounds - 1).then(each)
            if Flow.EXIT in body:
                ends.append(before.then(body[Flow.EXIT]))
            if Flow.RETURN in body:
                result[Flow.RETURN] = touched.then(before.then(body[Flow.RETURN]))
        return {**result, Flow.NEXT: touched.then(self.worst(ends) or each)}
