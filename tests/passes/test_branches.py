"""A small tree as nested IFs: every row keeps its bits, and nothing that is in use becomes one by itself."""

import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.ir import BranchedTree, Comparison, Operator, Scale, TreeEnsemble, depth_of, reference
from st_codegen.passes import branches
from st_codegen.passes.branches import as_branches
from st_codegen.passes.choose import SAVES_MUCH, Choices, Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.pipeline import BRANCHES, compile_models
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.prove.prove import prove
from tests.classifiers import SCORE, X, loaded
from tests.emit.test_emitted import run
from tests.models import model, random_trees
from tests.passes.certified import certified


def tree(seed=0, *before, splits=9, features=3, comparison=Comparison.LESS_OR_EQUAL, **options):
    """A random tree, behind the operations `before`, in a model that takes missing values."""
    op = random_trees(
        np.random.default_rng(seed), trees=1, splits=splits, comparison=comparison, features=features, **options
    )
    return limit_inputs(model(*before, replace(op, inputs=(len(before),)), features=features, accepts_nan=True))


def branched(whole, **options):
    return as_branches(pruned(ranked(whole)), **options)


@pytest.mark.parametrize("target", ["iec", "twincat", "scl"])
@pytest.mark.parametrize("comparison", [Comparison.LESS, Comparison.LESS_OR_EQUAL])
def test_every_row_keeps_its_bits_missing_values_included(target, comparison, tmp_path):
    for seed in range(4):
        whole = tree(seed, comparison=comparison)
        made = branched(whole)
        assert [type(op) for op in made.ops] == [BranchedTree]
        x = probe_rows(whole, 500)
        expected = reference.evaluate(whole, x)
        assert np.isnan(x).any(axis=0).all()
        assert np.array_equal(reference.evaluate(made, x), expected, equal_nan=True)
        assert np.array_equal(run(made, target, tmp_path / str(seed), x), expected, equal_nan=True)


def test_falling_steps_leaves_of_several_numbers_and_no_missing_values(tmp_path):
    turned = Scale((0,), Operator.MULTIPLY, np.array([-2.0, 3.0, -0.1]))
    cases = {
        "falling": tree(1, turned),
        "wide": tree(2, outputs=3, wide=True),
        "refusing": replace(tree(3), accepts_nan=False),
        "leaf": tree(4, splits=0),
    }
    for name, whole in cases.items():
        made = branched(whole)
        x = probe_rows(whole, 600)
        expected = reference.evaluate(whole, x)
        assert np.array_equal(reference.evaluate(made, x), expected, equal_nan=True), name
        assert np.array_equal(run(made, "iec", tmp_path / name, x), expected, equal_nan=True), name
        assert ("abMissing" in (tmp_path / name / "iec" / "FB_M.st").read_text()) == (name != "refusing")


def test_a_split_of_missing_values_from_numbers_tests_the_flag_alone(tmp_path):
    whole = tree(5)
    (op,) = whole.ops
    split = np.flatnonzero(op.split >= 0)[0]
    threshold = op.threshold.copy()
    threshold[split] = np.inf
    for left in (True, False):
        missing_left = op.missing_left.copy()
        missing_left[split] = left
        changed = replace(whole, ops=(replace(op, threshold=threshold, missing_left=missing_left),))
        made = branched(changed)
        x = probe_rows(changed, 500)
        expected = reference.evaluate(changed, x)
        assert np.array_equal(run(made, "iec", tmp_path / str(left), x), expected, equal_nan=True)
        text = (tmp_path / str(left) / "iec" / "FB_M.st").read_text()
        assert bool(re.search(rf"IF (NOT )?abMissing\[{op.split[split]}\] THEN", text[text.index("nLeaf") :])) != left


def test_a_split_that_a_range_leaves_nothing_to_tell_is_dropped(tmp_path):
    from sklearn.tree import DecisionTreeRegressor

    whole = loaded(DecisionTreeRegressor(max_depth=4, random_state=0).fit(X, SCORE)).ir
    limited = replace(whole, features=tuple(replace(one, lower=-1.0, upper=1.0) for one in whole.features))
    made = branched(limited)
    x = probe_rows(limited, 500)
    expected = reference.evaluate(limited, x)
    assert np.array_equal(run(made, "iec", tmp_path, x), expected, equal_nan=True)
    (op,), (before,) = made.ops, (op for op in pruned(ranked(limited)).ops if isinstance(op, TreeEnsemble))
    assert op.n_nodes < before.n_nodes


def test_what_is_no_small_single_tree_stays_as_it_is(monkeypatch):
    assert branched(tree()) is not None
    two = random_trees(np.random.default_rng(0), trees=2, comparison=Comparison.LESS)
    assert branched(limit_inputs(model(two))) is None
    # a tree for one output of two, as is left where the other's are constant
    assert branched(tree(outputs=2, wide=False)) is None
    (op,) = branched(tree()).ops
    leaves, depth = int(np.sum(op.split < 0)), depth_of(op)
    for name, limit in (("_LEAVES", leaves), ("_DEEPEST", depth)):
        with monkeypatch.context() as patch:
            patch.setattr(branches, name, limit)
            assert branched(tree()) is not None
            patch.setattr(branches, name, limit - 1)
            assert branched(tree()) is None
            assert (branched(tree(), may_grow=1.25) is not None) == (name == "_LEAVES")
    # thresholds stand in the text, where portable compilers read no tiny numbers
    whole = tree()
    (op,) = whole.ops
    tiny = replace(op, threshold=np.where(op.split >= 0, op.threshold * 1e-39, op.threshold))
    assert branched(replace(whole, ops=(tiny,))) is None


@pytest.fixture
def many_inputs():
    """A tree for which there is no small table, and of which each row needs few inputs."""
    return tree(6, splits=25, features=12)


def test_they_are_taken_where_they_save_much_and_nothing_was_there_before(many_inputs):
    options = Options(table_bytes=512)
    (decision,) = compile_models([many_inputs], options).decisions
    assert decision.chosen == BRANCHES
    others = {c.layout: c.cost.nanoseconds for c in decision.candidates[1:]}
    assert decision.candidates[0].cost.nanoseconds <= SAVES_MUCH * min(others.values())
    name = many_inputs.name
    for layout in others:
        (kept,) = compile_models([many_inputs], options, earlier=Choices({name: layout})).decisions
        assert kept.chosen != BRANCHES
        assert BRANCHES not in {candidate.layout for candidate in kept.candidates}
    (kept,) = compile_models([many_inputs], options, earlier=Choices({name: BRANCHES})).decisions
    assert kept.chosen == BRANCHES
    (asked,) = compile_models([many_inputs], Options(Layout.IFS), earlier=Choices({name: "table"})).decisions
    assert [candidate.layout for candidate in asked.candidates] == [BRANCHES]
    assert "new layout 'nested IFs' for 'table'" in asked.change


def test_models_that_share_searches_keep_their_tables():
    whole = tree(7, splits=5, features=5)
    assert compile_models([whole]).decisions[0].chosen == BRANCHES
    together = compile_models([whole, replace(whole, name="other")], together=True)
    assert [decision.chosen for decision in together.decisions] == ["table"] * 2


def test_prove_follows_them_and_the_checker_confirms_it(tmp_path):
    from sklearn.tree import DecisionTreeRegressor

    random = np.random.default_rng(0)
    x = random.uniform(-5.0, 10.0, (400, 3))
    x[random.uniform(size=x.shape) < 0.1] = np.nan
    fitted = DecisionTreeRegressor(max_depth=7, random_state=0).fit(x, np.nansum(x[:, :2], axis=1) ** 2)
    bundle, out, file = certified(fitted, Layout.IFS, BRANCHES, tmp_path)
    text = file.read_text()
    for old, new in (("nLeaf := 3;", "nLeaf := 4;"), (" <= ", " < "), (" OR abMissing", " AND NOT abMissing")):
        assert old in text
        file.write_text(text.replace(old, new, 1))
        assert not prove(bundle, out).proved, old
