"""Chains are chains, short, and always the same."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.te.compensation.addition_chain import addition_chain
from tests.examples import examples
from tests.te.projects import PAPER_ORDERS

#: Lengths of shortest chains to a single number (OEIS A003313).
SHORTEST = {
    1: 0,
    2: 1,
    3: 2,
    5: 3,
    7: 4,
    11: 5,
    13: 5,
    15: 5,
    19: 6,
    23: 6,
    29: 7,
    39: 7,
    47: 8,
    71: 9,
    127: 10,
    240: 9,
}


def assert_chain(links, targets):
    known = {1}
    for link in links:
        assert link.first in known
        assert link.second in known
        assert link.number == link.first + link.second
        known.add(link.number)
    assert set(targets) <= known
    assert len(known) == len(links) + 1


@examples(12)
@given(st.sets(st.integers(1, 400), min_size=1, max_size=6))
def test_every_set_of_orders_has_a_chain(targets):
    links = addition_chain(targets)
    assert_chain(links, targets)
    assert links == addition_chain(sorted(targets, reverse=True))
    assert len(links) <= len(targets) * 16  # closing each gap by halving takes at most two links a bit


@pytest.mark.parametrize("number", SHORTEST)
def test_single_numbers_have_the_shortest_chain(number):
    assert len(addition_chain({number})) == SHORTEST[number]


def test_the_papers_orders_take_thirteen_multiplications():
    links = addition_chain(order for order in PAPER_ORDERS if order)
    assert_chain(links, PAPER_ORDERS[1:])
    # 7 links to 39, which no chain does in less, and one for each order above it
    assert len(links) == 13


def shortest(targets, limit):
    """The length of the shortest chain by trying all."""
    for length in itertools.count():
        stack = [((1,), length)]
        while stack:
            chain, left = stack.pop()
            if targets <= set(chain):
                return length
            if left and chain[-1] < limit:
                sums = {a + b for a in chain for b in chain if chain[-1] < a + b <= limit}
                stack += [((*chain, s), left - 1) for s in sums]
    raise AssertionError


@examples(15)
@given(st.sets(st.integers(2, 26), min_size=1, max_size=4))
def test_small_sets_have_the_shortest_chain(targets):
    assert len(addition_chain(targets)) == shortest(targets, max(targets))


def test_where_the_search_gives_up_a_number_may_lie_on_the_way_to_a_larger_one():
    """With the gap below the smallest closed first there are three links more."""
    assert len(addition_chain({91, 327})) == len(addition_chain({327}))


def test_numbers_below_one_are_refused():
    with pytest.raises(ValueError, match="0"):
        addition_chain({0, 3})
