"""Short addition chains: with cos and sin of theta, one complex multiplication gives each further multiple of theta.

A chain is a rising list of numbers from 1 in which each is the sum of two earlier ones (perhaps the same twice). The
shortest chain that contains given numbers is hard to find in general (the problem is NP-complete: Downey, Leong, Sethi,
1981), so the search is bounded by a number of steps, never by time: the same orders give the same chain everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

#: Sets that the search looks at before it is content with the best chain known.
_BUDGET = 60_000


@dataclass(frozen=True)
class Link:
    """`number = first + second`, both earlier in the chain; first >= second."""

    number: int
    first: int
    second: int


def addition_chain(targets: Iterable[int]) -> tuple[Link, ...]:
    """The links of a chain from 1 that contains all `targets` (positive numbers), in rising order.

    Raises ValueError for a target below 1.
    """
    wanted = frozenset(targets) | {1}
    if min(wanted) < 1:
        raise ValueError(f"no chain leads to {min(wanted)}")
    best = _by_doubling(wanted)
    search = _Search(_BUDGET)
    for extra in range(len(best) - len(wanted)):
        found = search.complete(wanted, frozenset({1}), extra)
        if found is not None:
            best = found
            break
        if search.budget <= 0:
            break
    return tuple(_links(best))


def _by_doubling(wanted: frozenset[int]) -> frozenset[int]:
    """A chain that always exists: every gap to the next smaller number is closed by halving."""
    numbers = set(wanted)
    open_ = sorted(numbers, reverse=True)
    while open_:
        number = open_.pop(0)
        if number == 1 or _pair(number, numbers) is not None:
            continue
        below = max(n for n in numbers if n < number)
        new = {number - below} if 2 * below > number else {number // 2, number - number // 2}
        numbers |= new
        open_ = sorted({*open_, *new}, reverse=True)
    return frozenset(numbers)


def _pair(number: int, numbers: Iterable[int]) -> tuple[int, int] | None:
    """The summands of a number in a set: those that lie closest together, whose rounding errors are the smallest."""
    known = set(numbers)
    firsts = (first for first in sorted(known) if 2 * first >= number > first)
    return next(((first, number - first) for first in firsts if number - first in known), None)


def _links(numbers: frozenset[int]) -> Iterator[Link]:
    for number in sorted(numbers - {1}):
        pair = _pair(number, numbers)
        if pair is None:
            raise AssertionError(f"{sorted(numbers)} is no chain at {number}")
        yield Link(number, *pair)


class _Search:
    """Depth first from the largest number down, with a bounded number of steps over all depths."""

    def __init__(self, budget: int) -> None:
        self.budget = budget

    def complete(self, open_: frozenset[int], done: frozenset[int], extra: int) -> frozenset[int] | None:
        """A chain that contains all numbers and at most `extra` others; None where there is none, or no budget.

        `done` are numbers whose summands are in the set already.
        """
        self.budget -= 1
        numbers = open_ | done
        todo = sorted((n for n in open_ - done if _pair(n, numbers) is None), reverse=True)
        if not todo:
            return numbers
        if self.budget <= 0 or extra <= 0:
            return None
        number = todo[0]
        for new in self._candidates(number, numbers, extra):
            found = self.complete(numbers | new, done | {number}, extra - len(new))
            if found is not None:
                return found
        return None

    def _candidates(self, number: int, numbers: frozenset[int], extra: int) -> Iterator[frozenset[int]]:
        """Numbers to add so that `number` becomes a sum: one new summand first, then two."""
        single = {number - n for n in numbers if n < number}
        if number % 2 == 0:
            single.add(number // 2)
        yield from (frozenset({n}) for n in sorted(single))
        if extra > 1:
            for first in range((number + 1) // 2, number):
                pair = frozenset({first, number - first})
                if not pair & numbers and len(pair) == 2:
                    yield pair
