"""Short addition chains: with cos and sin of theta, one complex multiplication gives each further multiple of theta.

A chain is a rising list of numbers from 1 in which each is the sum of two earlier ones (perhaps the same twice). The
shortest chain that contains given numbers is hard to find in general (the problem is NP-complete: Downey, Leong, Sethi,
1981), so the search is bounded by a number of steps, never by time: the same orders give the same chain everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

#: Chains that the search looks at for each length before it tries a longer one.
_BUDGET = 6_000


@dataclass(frozen=True)
class ChainLink:
    """`number = first + second`, both earlier in the chain; first >= second."""

    number: int
    first: int
    second: int


def addition_chain(targets: Iterable[int]) -> tuple[ChainLink, ...]:
    """The links of a chain from 1 that contains all `targets` (positive numbers), in rising order.

    Raises ValueError for a target below 1.
    """
    wanted = frozenset(targets) | {1}
    if min(wanted) < 1:
        raise ValueError(f"no chain leads to {min(wanted)}")
    fallback = _by_doubling(wanted)
    targets = tuple(sorted(wanted - {1}))
    for extra in range(len(fallback) - len(wanted)):
        chain = _ChainSearch(targets, _BUDGET).complete((1,), 0, extra)
        if chain is not None:
            return tuple(_links(frozenset(chain)))
    return tuple(_links(fallback))


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


def _links(numbers: frozenset[int]) -> Iterator[ChainLink]:
    for number in sorted(numbers - {1}):
        pair = _pair(number, numbers)
        if pair is None:
            raise AssertionError(f"{sorted(numbers)} is no chain at {number}")
        yield ChainLink(number, *pair)


class _ChainSearch:
    """Rising chains through all targets, with a bounded number of other numbers and of steps."""

    def __init__(self, targets: tuple[int, ...], budget: int) -> None:
        self.targets = targets
        self.budget = budget

    def complete(self, chain: tuple[int, ...], at: int, extra: int) -> tuple[int, ...] | None:
        """The chain continued to the last target; `at` is the next one, `extra` how many others may be added.

        None where there is no such chain, or none was found within the budget.
        """
        if at == len(self.targets):
            return chain
        self.budget -= 1
        target, last = self.targets[at], chain[-1]
        # no step more than doubles the last number
        if self.budget < 0 or last << (extra + 1) < target:
            return None
        sums = {a + b for i, a in enumerate(chain) for b in chain[i:] if last < a + b <= target}
        if target in sums:
            found = self.complete((*chain, target), at + 1, extra)
            if found is not None:
                return found
        if extra > 0:
            for number in sorted(sums - {target}, reverse=True):
                found = self.complete((*chain, number), at, extra - 1)
                if found is not None:
                    return found
        return None
