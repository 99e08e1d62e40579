"""Which lines of the cache a path touches, at most.

An access is followed symbolically: its address is a sum of versions of variables times bytes. A version is a
variable between two assignments, so that two accesses with the same versions are the same line. Leaving a loop, an
access that moves with the loop's counter covers a span, one that moves with anything else that the loop changes may
be somewhere else in every round.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from itertools import count

from st_codegen.st import tree as t

LINE = 64
#: Neighbours this near are a record, which is taken to be aligned: it lies in one line
_RECORD = 12

_versions = count(1)


def new_version() -> int:
    """A number that is larger than all before it."""
    return next(_versions)


@dataclass(frozen=True)
class Region:
    """A piece of memory: `path` leads to the instance it belongs to, `owner` is the unit that declares it."""

    path: tuple[str, ...]
    name: str
    owner: str
    size: int
    is_shared: bool

    @property
    def lines(self) -> int:
        """Lines that it lies in, at least one; its start is taken to be aligned."""
        return max(-(-self.size // LINE), 1)

    def inside(self, path: tuple[str, ...]) -> Region:
        """This region as a caller sees it that reaches the instance by `path`."""
        return self if self.is_shared else replace(self, path=path + self.path)


@dataclass(frozen=True)
class Loop:
    """A loop: its `first` version, the one of its counter (None: no counter), which moves by `step`.

    `is_anchored`: the counter always starts at the same number.
    """

    first: int
    counter: int | None = None
    step: int = 1
    is_anchored: bool = True


@dataclass(frozen=True)
class Touch:
    """Accesses to one region: `count` unrelated positions, each a span of bytes, in so many `executions` in all.

    `affine` maps versions to bytes: where the position moves evenly. `varies`: versions it depends on otherwise. `low`
    and `high` are the first and the last byte that is asked for at one position, less the size of an element. An
    execution reads or writes eight bytes at most.
    """

    region: Region
    affine: Mapping[int, int] = field(default_factory=dict)
    varies: frozenset[int] = frozenset()
    span: int = 0
    count: int = 1
    executions: int = 1
    low: int = 0
    high: int = 0

    @property
    def lines(self) -> int:
        """How many distinct lines are touched, at most."""
        length = self.span + self.high - self.low
        each = 1 if length == 0 or (self.span == 0 and length <= _RECORD) else 1 + -(-length // LINE)
        return min(self.region.lines, self.executions, self.count * each)

    def with_(self, other: Touch) -> Touch:
        """Two accesses to the same position, at distances that are known."""
        return replace(
            self,
            span=max(self.span, other.span),
            count=max(self.count, other.count),
            executions=self.executions + other.executions,
            low=min(self.low, other.low),
            high=max(self.high, other.high),
        )

    def repeated(self, rounds: int, loop: Loop) -> Touch:
        """All rounds of a loop.

        What depends on something that the loop changes keeps a version of it: in a loop around this one it may start
        anywhere, and a counter does where its first value is not always the same.
        """
        span = self.span
        moves = dict(self.affine)
        inner: set[int] = set()
        if loop.counter is not None and loop.counter in moves:
            span += abs(moves.pop(loop.counter) * loop.step) * max(rounds - 1, 0)
            inner = set() if loop.is_anchored else {loop.counter}
        changing = {version for version in (*moves, *self.varies) if version >= loop.first}
        return replace(
            self,
            affine={version: step for version, step in moves.items() if version < loop.first},
            varies=frozenset(version for version in self.varies if version < loop.first) | changing | inner,
            span=span,
            count=self.count * (rounds if changing else 1),
            executions=self.executions * rounds,
        )

    def called(self, path: tuple[str, ...]) -> Touch:
        """Seen from a caller: what depends on the callee's variables may be elsewhere in every call."""
        depends = bool(self.affine or self.varies)
        return replace(
            self,
            region=self.region.inside(path),
            affine={},
            varies=frozenset({new_version()}) if depends else frozenset(),
        )


Touches = dict[Hashable, Touch]


def joined(first: Touches, second: Touches) -> Touches:
    """The touches of two paths together; an access that both have is one touch."""
    together = dict(first)
    for key, touch in second.items():
        known = together.get(key)
        together[key] = touch if known is None or known is touch else known.with_(touch)
    return together


def lines_by_region(touches: Touches) -> dict[Region, int]:
    """How many distinct lines of each region are touched, at most."""
    lines: dict[Region, int] = {}
    for touch in touches.values():
        lines[touch.region] = min(lines.get(touch.region, 0) + touch.lines, touch.region.lines)
    return lines


class Versions:
    """The current version of every variable; those of the start of a unit are negative."""

    def __init__(self, initial: dict[t.Variable, int] | None = None, known: dict[t.Variable, int] | None = None):
        self._initial: dict[t.Variable, int] = {} if initial is None else initial
        self._known: dict[t.Variable, int] = {} if known is None else known

    def __getitem__(self, variable: t.Variable) -> int:
        if variable in self._known:
            return self._known[variable]
        return self._initial.setdefault(variable, -new_version())

    def change(self, variable: t.Variable) -> int:
        """Give a variable a new version, after an assignment."""
        self._known[variable] = new_version()
        return self._known[variable]

    def copy(self) -> Versions:
        """The versions, copied for a branch that then changes its own."""
        return Versions(self._initial, dict(self._known))

    def differs(self, other: Versions) -> set[t.Variable]:
        """The variables that do not have the same version in both."""
        return {v for v in self._known.keys() | other._known.keys() if self[v] != other[v]}
