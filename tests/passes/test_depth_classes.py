"""Trees visited by depth: the classes are the cheapest, every tree reaches its leaf, sums keep the library's order."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.emit.blocks import ranked_trees as emitted
from st_codegen.emit.blocks.depth_classes import Prices, depth_classes
from st_codegen.emit.blocks.model import Limits
from st_codegen.ir import Aggregate, Comparison, Rank, TreeEnsemble, reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.proof.probes import probe_rows
from tests.emit.test_emitted import run
from tests.examples import examples
from tests.models import PRECISIONS, model, random_trees
from tests.passes.test_tables import SLOW


@examples()
@given(
    depths=st.lists(st.integers(0, 9), min_size=1, max_size=24),
    abreast=st.integers(2, 5),
    loop=st.integers(0, 40),
    order=st.integers(0, 3),
)
def test_classes_are_the_cheapest_and_deep_enough(depths, abreast, loop, order):
    depths = np.array(depths)
    found = depth_classes(depths, abreast, Prices(loop, order))
    assert sorted(found.order.tolist()) == list(range(len(depths)))
    assert [run[0] for run in found.runs] == [0, *(run[1] for run in found.runs[:-1])]
    assert found.runs[-1][1] == len(depths)
    for first, stop, depth in found.runs:
        assert (depths[found.order[first:stop]] <= depth).all()
        assert stop == len(depths) or (stop - first) % abreast == 0

    def price(ends):
        rising = np.sort(depths)
        visits = sum((stop - first) * rising[stop - 1] for first, stop in itertools.pairwise((0, *ends)))
        return visits + loop * (len(ends) - 1) + (order * len(depths) if len(ends) > 1 else 0)

    middle = range(abreast, len(depths), abreast)
    ways = [(*c, len(depths)) for n in range(len(middle) + 1) for c in itertools.combinations(middle, n)]
    assert price([stop for _, stop, _ in found.runs]) == min(map(price, ways))
    assert found.visits == sum((stop - first) * depth for first, stop, depth in found.runs)


def test_a_second_loop_is_written_where_it_spares_more_nodes_than_it_costs():
    depths = np.array([9, 2] * 8)
    whole, parted = (depth_classes(depths, 4, Prices(loop, 0)) for loop in (56, 55))
    assert whole.runs == ((0, 16, 9),)
    assert not whole.is_sorted
    assert whole.order.tolist() == list(range(16))
    assert parted.runs == ((0, 8, 2), (8, 16, 9))
    assert parted.order.tolist() == [*range(1, 16, 2), *range(0, 16, 2)]


@examples(12, suppress_health_check=SLOW)
@given(
    seed=st.integers(0, 2**31),
    precision=st.sampled_from(PRECISIONS),
    comparison=st.sampled_from(Comparison),
    aggregate=st.sampled_from(Aggregate),
    accepts_nan=st.booleans(),
    small_arrays=st.booleans(),
)
def test_the_order_of_visits_changes_no_bit(
    seed, precision, comparison, aggregate, accepts_nan, small_arrays, tmp_path_factory
):
    target = "twincat" if accepts_nan else "iec"
    random = np.random.default_rng(seed)
    trees = random_trees(random, trees=30, splits=40, comparison=comparison, sum_precision=precision)
    trees = dataclasses.replace(trees, aggregate=aggregate)
    made = limit_inputs(model(trees, accepts_nan=accepts_nan))
    on_ranks = pruned(ranked(made))
    x = probe_rows(made, 200, seed)
    expected = reference.evaluate(made, x)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emitted, "PRICES", Prices(0, 0))  # a class for each depth
        limits = Limits(400) if small_arrays else None
        folder = tmp_path_factory.mktemp("depths")
        got = run(on_ranks, target, folder, x, limits)
    text = "".join(path.read_text("utf-8") for path in folder.rglob("*") if path.is_file())
    assert small_arrays or "TREE_ORDER" in text
    assert np.array_equal(expected, got, equal_nan=True)


@pytest.mark.parametrize("outputs", [1, 3])
def test_vectors_in_leaves_and_several_outputs(outputs, tmp_path, monkeypatch):
    monkeypatch.setattr(emitted, "PRICES", Prices(0, 0))
    for number, narrow in enumerate((True, False)):
        options = {"outputs": outputs, "wide": not narrow}
        trees = random_trees(
            np.random.default_rng(7), trees=12, splits=30, comparison=Comparison.LESS_OR_EQUAL, **options
        )
        made = model(trees)
        on_ranks = pruned(ranked(made))
        x = probe_rows(made, 300)
        got = run(on_ranks, "twincat", tmp_path / str(number), x)
        assert np.array_equal(reference.evaluate(made, x), got, equal_nan=True)


@examples(15, suppress_health_check=SLOW)
@given(
    counts=st.lists(st.integers(0, 20) | st.sampled_from([31, 32, 33, 63, 64]), min_size=9, max_size=14),
    seed=st.integers(0, 2**31),
    small_arrays=st.booleans(),
)
def test_many_searches_in_loops_find_every_rank(counts, seed, small_arrays, tmp_path_factory):
    """More inputs than are searched one by one: every threshold with its neighbours, infinities, missing values."""
    random = np.random.default_rng(seed)
    stumps = [(column, value) for column, count in enumerate(counts) for value in random.normal(size=count)]
    random.shuffle(stumps)
    if not stumps:
        return
    n = len(stumps)
    frame = random_trees(random, features=len(counts), trees=1, splits=0, comparison=Comparison.LESS_OR_EQUAL)
    trees = dataclasses.replace(
        frame,
        roots=3 * np.arange(n),
        split=np.ravel([[int(column), -1, -1] for column, _ in stumps]),
        threshold=np.ravel([[value, 0.0, 0.0] for _, value in stumps]),
        left=np.ravel([[3 * i + 1, -1, -1] for i in range(n)]),
        right=np.ravel([[3 * i + 2, -1, -1] for i in range(n)]),
        missing_left=np.ravel([[bool(random.integers(2)), False, False] for _ in range(n)]),
        leaf=np.ravel([[-1, 2 * i, 2 * i + 1] for i in range(n)]),
        leaf_value=random.normal(size=(2 * n, 1)),
        tree_output=np.zeros(n, np.int32),
    )
    made = model(trees, features=len(counts), accepts_nan=True)
    on_ranks = ranked(made)
    assert isinstance(on_ranks.ops[0], Rank)
    assert isinstance(on_ranks.ops[1], TreeEnsemble)
    x = probe_rows(made, 200, seed)
    got = run(on_ranks, "twincat", tmp_path_factory.mktemp("loops"), x, Limits(6 * n + 70) if small_arrays else None)
    assert np.array_equal(reference.evaluate(made, x), got, equal_nan=True)
