"""Cell tables: equal to the trees to the bit, on every threshold, every neighbour and everything that is no number."""

import dataclasses
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as st

from st_codegen.emit.blocks.model import Limits
from st_codegen.ir import (
    CellTable,
    Clip,
    Comparison,
    Feature,
    Operator,
    Rank,
    Scale,
    TreeColumn,
    reference,
)
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.monotone import Chain, Domain, changeovers, split_edges
from st_codegen.passes.pipeline import compile_models
from st_codegen.passes.tables import as_model, cells_of, united
from st_codegen.proof.probes import probe_rows
from st_codegen.te.harmonics import Direction, HarmonicOutput, Quantity, TransmissionError
from st_codegen.te.purpose import Compensation
from tests.emit.test_emitted import run
from tests.examples import examples
from tests.models import PRECISIONS, SMALL_MODELS, model, random_trees, tree_models

SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
MOST = 100_000


def assert_same_bits(expected, got):
    assert np.array_equal(expected.view(np.int64), got.view(np.int64))


@st.composite
def ranged(draw, models):
    """A model some of whose features declare a range."""
    made = draw(models)
    features = []
    for feature in made.features:
        low = draw(st.sampled_from([None, -3.0, -1.0, 0.1]))
        features.append(Feature(feature.name) if low is None else Feature(feature.name, "", low, low + 2.75))
    return dataclasses.replace(made, features=tuple(features))


@examples(suppress_health_check=SLOW)
@given(model=ranged(tree_models(thresholds_only=True)), seed=st.integers(0, 2**31))
def test_a_table_answers_as_the_trees_do(model, seed):
    model = limit_inputs(model)
    cells = cells_of(model, MOST)
    assume(cells is not None)  # the grid of several features can be too large
    table = as_model(model, cells)
    x = probe_rows(model, 400, seed)
    assert_same_bits(reference.evaluate(model, x), reference.evaluate(table, x))


@examples(25, suppress_health_check=SLOW)
@given(
    model=ranged(tree_models(thresholds_only=True)),
    target=st.sampled_from(["iec", "twincat"]),
    seed=st.integers(0, 2**31),
)
def test_the_emitted_table_answers_as_the_trees_do(model, target, seed, tmp_path_factory):
    model = limit_inputs(model)
    cells = cells_of(model, MOST)
    assume(cells is not None)  # the grid of several features can be too large
    x = probe_rows(model, 300, seed)
    got = run(as_model(model, cells), target, tmp_path_factory.mktemp("table"), x)
    assert np.array_equal(reference.evaluate(model, x), got, equal_nan=True)


@examples(suppress_health_check=SLOW)
@given(
    seed=st.integers(0, 2**31),
    factor=st.sampled_from([0.3, -2.0, 1e-3, 7.0, -1 / 3]),
    precision=st.sampled_from(PRECISIONS),
    comparison=st.sampled_from(Comparison),
    accepts_nan=st.booleans(),
)
def test_scalers_in_front_of_trees_are_folded_into_exact_thresholds(seed, factor, precision, comparison, accepts_nan):
    random = np.random.default_rng(seed)
    trees = random_trees(random, comparison=comparison, input_precision=precision)
    scaled = limit_inputs(
        model(
            Scale((0,), Operator.SUBTRACT, [0.1, 0.2, -0.3], reverse=bool(seed % 2)),
            Scale((1,), Operator.MULTIPLY, [factor, 0.7, -factor], precision),
            Scale((2,), Operator.DIVIDE, [3.0, factor, 0.3]),
            dataclasses.replace(trees, inputs=(3,)),
            Scale((4,), Operator.MULTIPLY, [1.7]),
            accepts_nan=accepts_nan,
        )
    )
    cells = cells_of(scaled, MOST)
    table = as_model(scaled, cells)
    assert [type(op) for op in table.ops] in ([Rank, CellTable], [CellTable])
    edges = [np.array([edge for axis in cells.axes if axis.feature == n for edge in axis.edges]) for n in range(3)]
    rows = max(map(len, edges))
    x = random.normal(size=(3 * rows + 50, 3))
    for column, found in enumerate(edges):
        around = np.concatenate([found, np.nextafter(found, np.inf), np.nextafter(found, -np.inf)])
        x[: len(around), column] = around
    x = np.vstack([x, probe_rows(scaled, 300, seed)])
    assert_same_bits(reference.evaluate(scaled, x), reference.evaluate(table, x))


@examples()
@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from(Comparison),
    st.sampled_from(PRECISIONS),
)
def test_the_changeover_is_the_last_number_that_goes_left(threshold, comparison, precision):
    random = np.random.default_rng(0)
    trees = random_trees(random, features=1, trees=1, comparison=comparison, thresholds=[threshold], splits=3)
    assume(np.any(trees.split >= 0))
    trees = dataclasses.replace(trees, input_precision=precision)
    found = split_edges(trees, 0, Chain(0), Domain(-np.inf, np.inf))
    compare = np.less if comparison is Comparison.LESS else np.less_equal

    def left(x):
        with np.errstate(over="ignore"):
            return bool(compare(reference.rounded(np.array([x]), precision), threshold)[0])

    (edge,) = found.edge
    if np.isnan(edge):
        assert left(-np.inf) == left(np.inf)
    else:
        assert left(edge)
        with np.errstate(over="ignore"):
            assert not left(np.nextafter(edge, np.inf))
        assert found.left_below[0]


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300))
def test_changeovers_are_found_in_any_domain(one, other):
    low, high = min(one, other), max(one, other)
    if low == high:
        return
    for place in (low, high, np.nextafter(low, high), np.nextafter(high, low), low / 2 + high / 2):
        edge, first = changeovers(lambda x, place=place: x <= place, 1, Domain(low, high))
        if place >= high:
            assert first[0]
            assert np.isnan(edge[0])
        elif place >= low:
            assert first[0]
            assert edge[0] == place


def test_what_is_not_piecewise_constant_has_no_table():
    for name in ("linear", "kernel rbf degree 1", "scale add float64", "clip"):
        assert cells_of(limit_inputs(SMALL_MODELS[name]), MOST) is None
    linear = random_trees(np.random.default_rng(0), linear=True, comparison=Comparison.LESS_OR_EQUAL)
    assert cells_of(model(linear), MOST) is None


def test_a_table_above_the_limit_is_not_made():
    trees = model(random_trees(np.random.default_rng(1), trees=20, comparison=Comparison.LESS))
    size = cells_of(trees, MOST).values.size
    assert cells_of(trees, size - 1) is None
    compiled = compile_models([trees], Options(Layout.TABLE, table_bytes=8 * size - 8))
    assert compiled.decisions[0].chosen != "table"


def test_equal_slices_and_constant_outputs_take_no_room():
    trees = random_trees(np.random.default_rng(2), outputs=2, wide=True, comparison=Comparison.LESS_OR_EQUAL)
    flat = dataclasses.replace(
        trees,
        leaf_value=trees.leaf_value * [1.0, 0.0],
        columns=(TreeColumn(0), TreeColumn(0), TreeColumn(2)),
    )
    cells = cells_of(model(flat), MOST)
    assert 1 not in [axis.feature for axis in cells.axes]
    (table,) = [op for op in as_model(model(flat), cells).ops if isinstance(op, CellTable)]
    assert table.values.shape[1] == 1
    assert list(table.stored) == [0, -1]
    for axis, edges in enumerate(cells.values.shape[:-1]):
        slices = np.moveaxis(cells.values, axis, 0).reshape(edges, -1)
        assert len(np.unique(slices, axis=0)) == edges or not np.any(np.all(slices[1:] == slices[:-1], axis=1))


@pytest.mark.thorough
@examples(40, suppress_health_check=SLOW)
@given(seed=st.integers(0, 2**31), accepts_nan=st.booleans(), target=st.sampled_from(["iec", "twincat"]))
def test_one_search_serves_several_models(seed, accepts_nan, target, tmp_path_factory):
    random = np.random.default_rng(seed)
    models = []
    for number in range(4):
        features = tuple(Feature(f"f{n}", "", -2.0, 2.0) for n in range(3))
        made = model(
            random_trees(
                random, comparison=random.choice(list(Comparison)), thresholds=np.round(random.normal(size=4), 1)
            ),
            name=f"m{number}",
            accepts_nan=accepts_nan,
        )
        models.append(dataclasses.replace(made, features=features))
    parts = [cells_of(made, MOST) for made in models]
    both = united(parts)
    assert both.values.shape[-1] == 4
    te = TransmissionError(
        "te",
        models[0].features,
        0,
        81.0,
        (0, 1),
        (Direction.FORWARD,),
        (
            HarmonicOutput(Direction.FORWARD, 0, Quantity.AMPLITUDE, "m0", 0),
            HarmonicOutput(Direction.FORWARD, 1, Quantity.AMPLITUDE, "m2", 0),
            HarmonicOutput(Direction.FORWARD, 1, Quantity.PHASE, "m3", 0),
        ),
    )
    options = Options(Layout.TABLE)
    compiled = compile_models(models, options, together=True)
    (printed,) = compiled.models
    assert sum(isinstance(op, Rank) for op in printed.ops) <= 1
    assert [o.model for o in Compensation(te).settled(compiled, options).te.outputs] == [printed.name] * 3
    x = np.vstack([probe_rows(made, 100, seed) for made in models])
    together = reference.evaluate(printed, x)
    for made in models:
        location = compiled.locations[made.name]
        assert_same_bits(reference.evaluate(made, x), np.ascontiguousarray(together[:, location.outputs]))
    if seed % 4 == 0:
        got = run(printed, target, tmp_path_factory.mktemp("shared"), x)
        assert np.array_equal(together, got, equal_nan=True)


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_a_table_longer_than_an_array_is_cut(target, tmp_path):
    numbers = np.linspace(-1.0, 1.0, 30)
    many = {"trees": 9, "splits": 9, "thresholds": numbers, "comparison": Comparison.LESS}
    trees = model(random_trees(np.random.default_rng(5), outputs=2, wide=True, **many))
    table = as_model(trees, cells_of(trees, MOST))
    assert table.ops[-1].values.size > 3 * 64
    x = probe_rows(trees, 500)
    got = run(table, target, tmp_path, x, Limits(64))
    assert np.array_equal(reference.evaluate(trees, x), got, equal_nan=True)


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_many_columns_are_searched_in_a_loop(target, tmp_path):
    random = np.random.default_rng(6)
    columns = tuple(TreeColumn(n) for n in range(12))
    trees = random_trees(
        random, features=12, trees=40, splits=1, columns=columns, comparison=Comparison.LESS, thresholds=[0.5]
    )
    made = model(trees, features=12, accepts_nan=True)
    table = as_model(made, cells_of(made, MOST * 100))
    assert len(table.ops[0].columns) > 8
    x = probe_rows(made, 300)
    for limits in (None, Limits(4096)):
        got = run(table, target, tmp_path, x, limits)
        assert np.array_equal(reference.evaluate(made, x), got, equal_nan=True)


def test_the_infinity_of_lightgbm_is_a_threshold_like_others():
    """LightGBM writes 1e300 for infinity, which has no float32: no warning, and a table all the same."""
    trees = random_trees(
        np.random.default_rng(0), features=1, thresholds=(1.0, 2.0, 1e300), comparison=Comparison.LESS_OR_EQUAL
    )
    assert (trees.threshold == 1e300).any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cells_of(model(trees, features=1), MOST) is not None


def test_zeros_that_are_compared_only_have_no_sign_that_counts():
    """A limit at 0 in front of trees does not; behind them it does, in the table, too."""
    trees, limit = (
        random_trees(np.random.default_rng(0), comparison=Comparison.LESS),
        Clip((0,), np.zeros(3), np.ones(3)),
    )
    before = model(limit, dataclasses.replace(trees, inputs=(1,)))
    behind = model(trees, Clip((1,), np.zeros(trees.width), np.ones(trees.width)))
    assert (before.signs_zeros, behind.signs_zeros) == (True, False)
    for one in (before, behind):
        cells = cells_of(one, 10**6)
        assert cells is not None
        assert as_model(one, cells).signs_zeros == one.signs_zeros
