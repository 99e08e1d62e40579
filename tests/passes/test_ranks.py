"""Trees on ranks, and pruned: every row gets the bits that the plain trees give it."""

import dataclasses
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.emit.blocks.model import Limits, block_name
from st_codegen.ir import (
    Comparison,
    Feature,
    Operator,
    Precision,
    Rank,
    Scale,
    TreeEnsemble,
    depth_of,
    digest,
    reference,
)
from st_codegen.ir.subtrees import _numbered, subtrees
from st_codegen.passes import boxes
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.pipeline import compile_models
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.proof.probes import probe_rows
from tests.emit.test_emitted import run
from tests.examples import examples
from tests.models import PRECISIONS, SMALL_MODELS, model, random_trees, tree_models
from tests.passes.test_tables import SLOW, assert_same_bits, ranged


@examples(suppress_health_check=SLOW)
@given(model=ranged(tree_models(thresholds_only=True)), seed=st.integers(0, 2**31))
def test_ranks_and_pruning_keep_every_bit(model, seed):
    model = limit_inputs(model)
    on_ranks = ranked(model)
    x = probe_rows(model, 400, seed)
    expected = reference.evaluate(model, x)
    assert_same_bits(expected, reference.evaluate(on_ranks, x))
    small = pruned(on_ranks)
    assert_same_bits(expected, reference.evaluate(small, x))
    assert_same_bits(expected, reference.evaluate(pruned(small), x))
    with mock.patch.object(boxes, "_KEPT", 1):  # tree by tree, as large ensembles are
        assert digest(pruned(on_ranks)) == digest(small)


@pytest.mark.thorough
@examples(40, suppress_health_check=SLOW)
@given(
    model=ranged(tree_models(thresholds_only=True)),
    seed=st.integers(0, 2**31),
    target=st.sampled_from(["iec", "twincat"]),
    prune=st.booleans(),
)
def test_the_emitted_trees_keep_every_bit(model, seed, target, prune, tmp_path_factory):
    model = limit_inputs(model)
    on_ranks = ranked(model)
    x = probe_rows(model, 300, seed)
    got = run(pruned(on_ranks) if prune else on_ranks, target, tmp_path_factory.mktemp("ranks"), x)
    assert np.array_equal(reference.evaluate(model, x), got, equal_nan=True)


@examples(suppress_health_check=SLOW)
@given(model=tree_models())
def test_ensembles_have_ranks_unless_something_else_than_a_threshold_decides(model):
    (trees,) = (op for op in model.ops if isinstance(op, TreeEnsemble))
    used = [trees.columns[number] for number in set(trees.split[trees.split >= 0])]
    special = trees.linear is not None or trees.has_categories
    special |= any(column.missing_interval is not None for column in used)
    assert (ranked(model) is None) == special


@examples(suppress_health_check=SLOW)
@given(
    seed=st.integers(0, 2**31),
    factor=st.sampled_from([0.3, -2.0, 1e-3, -1 / 3]),
    precision=st.sampled_from(PRECISIONS),
    comparison=st.sampled_from(Comparison),
    accepts_nan=st.booleans(),
)
def test_scalers_in_front_vanish(seed, factor, precision, comparison, accepts_nan):
    trees = random_trees(np.random.default_rng(seed), comparison=comparison, input_precision=precision)
    scaled = limit_inputs(
        model(
            Scale((0,), Operator.SUBTRACT, [0.1, 0.2, -0.3]),
            Scale((1,), Operator.MULTIPLY, [factor, 0.7, -factor]),
            dataclasses.replace(trees, inputs=(2,)),
            accepts_nan=accepts_nan,
        )
    )
    new = pruned(ranked(scaled))
    assert [type(op) for op in new.ops] == [Rank, TreeEnsemble]
    edges = [[np.zeros(0)], [np.zeros(0)], [np.zeros(0)]]
    for column in new.ops[0].columns:
        edges[column.column].append(column.edges)
    x = [probe_rows(scaled, 300, seed)]
    for column, found in enumerate(map(np.concatenate, edges)):
        around = np.concatenate([found, np.nextafter(found, np.inf), np.nextafter(found, -np.inf)])
        rows = np.random.default_rng(seed).normal(size=(len(around), 3))
        rows[:, column] = around
        x.append(rows)
    rows = np.vstack(x)
    assert_same_bits(reference.evaluate(scaled, rows), reference.evaluate(new, rows))


def test_branches_outside_the_declared_range_go():
    trees = random_trees(np.random.default_rng(3), trees=6, splits=12, comparison=Comparison.LESS_OR_EQUAL)
    free = model(trees)
    narrow = dataclasses.replace(free, features=tuple(Feature(f.name, "", 0.05, 0.15) for f in free.features))
    before, after = (pruned(ranked(m)).ops[-1].n_nodes for m in (free, narrow))
    assert after < before <= trees.n_nodes
    # a lone model declares no range: nothing is cut off there but contradictions
    x = probe_rows(free, 300)
    assert_same_bits(reference.evaluate(free, x), reference.evaluate(pruned(ranked(free)), x))


def made_of(values, **options):
    """An ensemble of stumps with given leaves (a pair) and constants (a number)."""
    left, right, split, leaf_of, leaves, roots = [], [], [], [], [], []
    for value in values:
        start = len(split)
        roots.append(start)
        pair = isinstance(value, tuple)
        left += [start + 1, -1, -1] if pair else [-1]
        right += [start + 2, -1, -1] if pair else [-1]
        split += [0, -1, -1] if pair else [-1]
        for number in value if pair else (value,):
            leaves.append([number])
        leaf_of += [-1, len(leaves) - 2, len(leaves) - 1] if pair else [len(leaves) - 1]
    nodes = len(split)
    base = options.pop("base", [0.5])
    frame = random_trees(np.random.default_rng(0), features=1, trees=1, splits=0, comparison=Comparison.LESS_OR_EQUAL)
    return dataclasses.replace(
        frame,
        roots=roots,
        split=split,
        threshold=np.where(np.array(split) >= 0, 1.0, 0.0),
        left=left,
        right=right,
        missing_left=np.zeros(nodes, bool),
        leaf=leaf_of,
        leaf_value=np.array(leaves),
        tree_output=np.zeros(len(values), np.int32),
        base=np.array(base),
        **options,
    )


@pytest.mark.parametrize(
    ("values", "options", "trees", "base"),
    [
        ((0.1, 0.2, (1.0, 2.0), 0.3), {}, 2, 0.5 + 0.1 + 0.2),
        ((0.0, (1.0, 2.0), 0.0, -0.0), {}, 1, 0.5),
        (((1.0, 2.0), (3.0, 3.0), 0.0), {}, 2, 0.5),
        ((0.1, 0.2), {}, 2, 0.5),
        (((1.0, 2.0), 0.0), {"base": [-0.0]}, 2, -0.0),
        ((0.1, (1.0, 2.0), 0.0), {"base_last": True}, 2, 0.5),
        ((0.1, (1.0, 2.0)), {"sum_precision": Precision.FLOAT32}, 1, float(np.float32(0.5) + np.float32(0.1))),
    ],
    ids=["first ones", "zeros", "equal leaves", "all", "minus zero", "base last", "float32"],
)
def test_constant_trees_are_folded_where_that_is_exact(values, options, trees, base):
    if "sum_precision" in options:
        values = tuple(
            tuple(map(float, np.float32(v))) if isinstance(v, tuple) else float(np.float32(v)) for v in values
        )
    before = model(made_of(values, **options), features=1)
    after = pruned(ranked(before))
    assert after.ops[-1].n_trees == trees
    assert np.array_equal(np.array(after.ops[-1].base).view(np.int64), np.array([base]).view(np.int64))
    x = np.array([[0.0], [1.0], [1.5]])
    assert_same_bits(reference.evaluate(before, x), reference.evaluate(after, x))


def test_equal_subtrees_have_equal_numbers_and_are_written_once(tmp_path):
    op = made_of([(1.0, 2.0), (1.0, 2.0), (2.0, 1.0), (1.0, 2.0)])
    number = subtrees(op).number
    assert number[0] == number[3] == number[9] != number[6]
    on_ranks = ranked(model(op, features=1))
    x = np.array([[0.0], [2.0]])
    assert np.array_equal(reference.evaluate(model(op, features=1), x), run(on_ranks, "iec", tmp_path, x))
    text = next((tmp_path / "iec").glob("*.st")).read_text()
    # four roots, and two pairs of children, two integers each
    assert "NODE_2 : ARRAY[0..15] OF DINT" in text


@pytest.mark.parametrize("largest", [8, 2**30])
def test_only_equal_splits_with_equal_answers_have_equal_numbers(largest):
    """Also where a question and its answers together fit no integer."""
    random = np.random.default_rng(0)
    op = made_of([(1.0, 2.0)] * 400)
    nodes = np.flatnonzero(op.split >= 0)
    threshold = np.zeros(op.n_nodes)
    threshold[nodes] = random.choice([0, 1, largest], len(nodes))
    left, right = random.choice([0, 3, largest], (2, len(nodes)))
    number = _numbered(dataclasses.replace(op, threshold=threshold), nodes, left, right)
    splits = list(zip(threshold[nodes], left, right, strict=True))
    assert len(set(number)) == len(set(splits)) == len(set(zip(number, splits, strict=True)))


@pytest.mark.parametrize("target", ["iec", "twincat"])
@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("wide", [False, True])
def test_tables_longer_than_an_array_are_cut_between_trees(target, outputs, wide, tmp_path):
    random = np.random.default_rng(1)
    made = model(
        random_trees(random, trees=23, splits=9, outputs=outputs, wide=wide, comparison=Comparison.LESS),
        accepts_nan=True,
    )
    on_ranks = pruned(ranked(made))
    x = probe_rows(made, 300)
    got = run(on_ranks, target, tmp_path, x, Limits(128))
    assert np.array_equal(reference.evaluate(made, x), got, equal_nan=True)
    text = next(path for path in (tmp_path / target).rglob(f"{block_name(made.name)}*")).read_text("utf-8")
    assert "NODE_1_2 :" in text


def test_what_has_no_ranks_keeps_its_layout():
    for made in (
        model(random_trees(np.random.default_rng(0), categorical=(1,), comparison=Comparison.LESS_OR_EQUAL)),
        model(random_trees(np.random.default_rng(0), linear=True, comparison=Comparison.LESS_OR_EQUAL)),
        SMALL_MODELS["linear"],
    ):
        assert ranked(made) is None


def test_auto_takes_the_cheapest_and_other_layouts_are_taken_by_their_name():

    few = model(random_trees(np.random.default_rng(1), trees=20, comparison=Comparison.LESS))
    assert compile_models([few]).decisions[0].chosen == "table"
    for layout, name in ((Layout.TREES, "as trained"), (Layout.RANKED, "ranked trees"), (Layout.TABLE, "table")):
        assert compile_models([few], Options(layout)).decisions[0].chosen == name
    many = model(random_trees(np.random.default_rng(1), trees=200, splits=20, comparison=Comparison.LESS))
    assert compile_models([many], Options(table_bytes=1024)).decisions[0].chosen == "ranked trees"
    assert compile_models([many], Options(Layout.TREES, table_bytes=1024)).decisions[0].chosen == "as trained"
    (decision,) = compile_models([few]).decisions
    costs = [candidate.cost.nanoseconds for candidate in decision.candidates]
    assert costs == sorted(costs)
    assert {candidate.layout for candidate in decision.candidates} == {"table", "as trained", "ranked trees"}


def test_depth_counts_splits():
    assert depth_of(made_of([0.5])) == 0
    assert depth_of(made_of([0.5, (1.0, 2.0)])) == 1
