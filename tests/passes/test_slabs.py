"""Forests cut into cells: in every cell, every row meets the leaves of the whole trees, in fewer steps."""

from dataclasses import replace

import numpy as np
import pytest

from st_codegen.emit.blocks.model import Limits
from st_codegen.errors import InputError
from st_codegen.ir import Comparison, CutTrees, TreeEnsemble, depth_of, reference
from st_codegen.ir.subtrees import subtrees
from st_codegen.passes import boxes, slabs
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.pipeline import CELLS, RANKS, compile_models
from st_codegen.passes.prune import pruned
from st_codegen.passes.ranks import ranked
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.prove.prove import prove
from st_codegen.walkers.objects import from_estimator
from tests.emit.test_emitted import run
from tests.models import model, random_trees
from tests.passes.certified import certified


def forest(features=2, trees=3, rows=700):
    """A forest with random thresholds, as a model that takes missing values."""
    from sklearn.ensemble import ExtraTreesRegressor

    random = np.random.default_rng(3)
    x = random.uniform(-5.0, 5.0, (rows, features))
    fitted = ExtraTreesRegressor(trees, random_state=0).fit(x, np.sin(x[:, 0]) * x[:, -1])
    return limit_inputs(from_estimator(fitted, "model").ir)


@pytest.fixture(scope="module")
def whole():
    return forest()


@pytest.fixture(scope="module")
def cut(whole):
    return slabs.cut_into_cells(pruned(ranked(whole)), Options().max_array)


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_every_row_keeps_its_bits_missing_values_included(target, whole, cut, tmp_path):
    x = probe_rows(whole, 1_500)
    assert np.isnan(x).any(axis=0).all()
    expected = reference.evaluate(whole, x)
    assert np.array_equal(reference.evaluate(cut, x), expected, equal_nan=True)
    assert np.array_equal(run(cut, target, tmp_path, x), expected, equal_nan=True)


def test_cells_that_are_cut_a_few_at_a_time_are_the_same(whole, cut, monkeypatch):
    monkeypatch.setattr(boxes, "_KEPT", 5_000)
    again = slabs.cut_into_cells(pruned(ranked(whole)), Options().max_array)
    for name, array in vars(cut.ops[1].cut).items():
        assert np.array_equal(getattr(again.ops[1].cut, name), array), name


def test_the_trees_of_a_cell_are_shallower_and_share_what_is_equal(cut):
    rank, op = cut.ops
    assert isinstance(op, CutTrees)
    assert depth_of(op.cut) < 0.8 * depth_of(op)
    assert op.numbers <= slabs._GROWTH * slabs._numbers(op, subtrees(op).number, 1).sum()
    # missing values have a slab of their own: beside it, each slab has equal numbers of ranks
    for axis in op.slabs:
        column = rank.columns[axis.column]
        assert (column.missing + axis.shift) // axis.width == 0
        assert [(end + axis.shift) // axis.width for end in (0, column.highest)] == [1, axis.count - 1]


def test_a_model_without_missing_values_has_no_slab_for_them(whole, tmp_path):
    refusing = replace(whole, accepts_nan=False)
    cut = slabs.cut_into_cells(pruned(ranked(refusing)), Options().max_array)
    assert all(axis.shift == 0 for axis in cut.ops[1].slabs)
    x = probe_rows(refusing, 600)
    expected = reference.evaluate(refusing, x)
    assert np.array_equal(run(cut, "iec", tmp_path, x), expected, equal_nan=True)


def test_short_arrays_cut_the_trees_into_parts(cut, whole, tmp_path):
    x = probe_rows(whole, 400)
    got = run(cut, "twincat", tmp_path, x, Limits(max_array=9_000))
    assert np.array_equal(got, reference.evaluate(whole, x), equal_nan=True)
    (file,) = (tmp_path / "twincat").rglob("FB_Model.TcPOU")
    assert "NODE_1_2 : ARRAY" in file.read_text(encoding="utf-8-sig")


def test_prove_follows_the_cells_and_the_checker_confirms_it(tmp_path):
    from sklearn.ensemble import ExtraTreesRegressor

    random = np.random.default_rng(0)
    x = random.uniform(0.0, 10.0, (700, 2))
    fitted = ExtraTreesRegressor(2, random_state=0).fit(x, np.sin(3.0 * x[:, 0]) * x[:, 1])
    bundle, out, file = certified(fitted, Layout.CUT, CELLS, tmp_path)
    # one root too far: another tree's, or another cell's
    text = file.read_text()
    assert text.count("nNode1 := nCellRoot;") == 1
    file.write_text(text.replace("nNode1 := nCellRoot;", "nNode1 := nCellRoot + 2;"))
    assert not prove(bundle, out).proved


def test_what_gains_nothing_stays_whole(whole):
    few = pruned(ranked(model(random_trees(np.random.default_rng(1), trees=4, comparison=Comparison.LESS))))
    assert slabs.cut_into_cells(few, Options().max_array) is None
    many = pruned(ranked(forest(features=6, trees=2, rows=300)))
    assert any(isinstance(op, TreeEnsemble) and depth_of(op) >= 8 for op in many.ops)
    assert slabs.cut_into_cells(many, Options().max_array) is None  # two of six features decide little
    (decision,) = compile_models([whole], Options(table_bytes=1024)).decisions
    assert decision.chosen == CELLS
    (decision,) = compile_models([whole], Options(Layout.RANKED)).decisions
    assert [candidate.layout for candidate in decision.candidates] == [RANKS]


def test_trees_that_are_too_many_or_too_flat_are_not_cut(whole, cut, monkeypatch):
    found = pruned(ranked(whole))
    (trees,) = (op for op in found.ops if isinstance(op, TreeEnsemble))
    assert cut is not None
    for limit, beyond in (("_NODES", trees.n_nodes - 1), ("_DEEP", depth_of(trees) + 1)):
        with monkeypatch.context() as patched:
            patched.setattr(slabs, limit, beyond)
            assert slabs.cut_into_cells(found, Options().max_array) is None


def test_cells_give_way_where_the_tables_would_not_fit(whole):
    other = replace(whole, name="other")
    (alone,) = compile_models([whole], Options(table_bytes=1024)).decisions
    cut, ranks = (next(c.cost.table_bytes for c in alone.candidates if c.layout == name) for name in (CELLS, RANKS))
    for limit, expected in ((2 * cut, [CELLS] * 2), (2 * cut - 1, [RANKS, CELLS]), (2 * ranks, [RANKS] * 2)):
        compiled = compile_models([whole, other], Options(table_bytes=1024, data_bytes=limit))
        assert [decision.chosen for decision in compiled.decisions] == expected
        is_cut = [isinstance(made.ops[-1], CutTrees) for made in compiled.models]
        assert is_cut == [name == CELLS for name in expected]


def test_as_many_trees_as_cells_are_asked_for(cut):
    op = cut.ops[1]
    with pytest.raises(InputError, match="CutTrees: "):
        replace(op, slabs=op.slabs[:1])
