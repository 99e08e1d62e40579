"""Trees behind logarithms and exponentials compare the inputs themselves, as the library's own comparison falls."""

import dataclasses

import numpy as np
import pytest

import st_codegen
from st_codegen.emit.blocks.model import Limits, model_block
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import at_most
from st_codegen.ir import Activation, Comparison, Feature, Function, Operator, Scale, TreeEnsemble, reference
from st_codegen.passes import inexact
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.inexact import without_inexact_steps
from st_codegen.passes.jumps import largest_jump
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.runner import GeneratedCode
from st_codegen.walkers.base import LoadedModel
from tests.models import model, random_trees


def around(values, count=24):
    """Numbers with `count` neighbours on each side."""
    found = [values]
    for direction in (-np.inf, np.inf):
        near = values
        for _ in range(count):
            near = np.nextafter(near, direction)
            found.append(near)
    return np.unique(np.concatenate(found))


def behind(*steps, seed=0, features=1, **changes):
    trees = random_trees(np.random.default_rng(seed), features=features, splits=12, comparison=Comparison.LESS_OR_EQUAL)
    ops = []
    for number, step in enumerate(steps):
        ops.append(dataclasses.replace(step, inputs=(number,)))
    return limit_inputs(model(*ops, dataclasses.replace(trees, inputs=(len(steps),), **changes), features=features))


LOG1P, EXPM1 = (Activation((0,), function, width=1) for function in (Function.LOG1P, Function.EXPM1))
SCALED, HALVED = (Scale((0,), Operator.MULTIPLY, [factor]) for factor in (3.0, 0.5))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("steps", [(LOG1P,), (EXPM1,), (SCALED, LOG1P, HALVED), (LOG1P, EXPM1)])
def test_the_rewritten_model_has_the_bits_of_the_functions_around_every_changeover(steps, seed):
    before = behind(*steps, seed=seed)
    after = without_inexact_steps(before)
    assert [type(op) for op in after.ops] == [TreeEnsemble]
    assert after.exact
    edges = after.ops[0].threshold[after.ops[0].split >= 0]
    x = np.concatenate([around(edges[np.isfinite(edges)]), around(np.array([-1.0, -1 / 3, 0.0, 690.0])), [np.nan]])
    x = np.append(x, np.random.default_rng(seed).normal(size=500) * 5)[:, None]
    expected, got = reference.evaluate(before, x), reference.evaluate(after, x)
    assert np.array_equal(np.isnan(expected), np.isnan(got))
    there = ~np.isnan(got)
    assert there.any()
    assert np.array_equal(expected[there].view(np.int64), got[there].view(np.int64))


def test_the_note_names_the_function_and_the_numpy():
    notes = " ".join(without_inexact_steps(behind(LOG1P)).source.notes)
    assert f"log1p compare the input itself, with the numbers at which NumPy {np.__version__}" in notes


def test_a_function_that_goes_to_and_fro_stays_and_the_jump_is_stated(monkeypatch):
    def shaken(x, _):
        return np.log1p(x) * (1 + 2.0**-51 * (np.ascontiguousarray(x).view(np.int64) % 2))

    monkeypatch.setitem(reference._FUNCTIONS, Function.LOG1P, shaken)
    before = behind(LOG1P)
    after = without_inexact_steps(before)
    assert after.ops == before.ops
    header = " ".join(" ".join(model_block(after, Limits(30_000)).header).split())
    assert f"by at most {at_most(largest_jump(before), 3)}" in header


def test_the_jump_holds_for_every_pair_of_sides():
    found = behind(LOG1P, seed=1)
    trees = found.ops[-1]
    limit = largest_jump(found)
    thresholds = trees.threshold[trees.split >= 0]
    x = np.concatenate([np.nextafter(thresholds, -np.inf), np.nextafter(thresholds, np.inf)])
    values = reference.apply(trees, [x[:, None]])
    half = len(thresholds)
    change = np.abs(values[:half] - values[half:])
    assert np.max(change) > 0
    assert np.max(change) <= limit


def test_the_jump_is_the_range_of_the_leaves_below_each_split():
    found = behind(LOG1P, seed=1)
    trees = found.ops[-1]

    def leaves(node):
        if trees.split[node] < 0:
            return [float(trees.leaf_value[trees.leaf[node], 0])]
        return leaves(trees.left[node]) + leaves(trees.right[node])

    ranges = [np.ptp(leaves(root)) for root in trees.roots]
    assert largest_jump(found) == pytest.approx(sum(ranges) / abs(trees.divisor), rel=1e-12)


def test_inputs_without_a_logarithm_are_refused_and_those_in_a_narrower_range_need_no_check():
    open_end = without_inexact_steps(behind(LOG1P))
    assert open_end.accepted[0][0] == np.nextafter(-1.0, 0.0)
    before = dataclasses.replace(behind(LOG1P), features=(Feature("x", lower=0.0, upper=9.0),))
    inside = without_inexact_steps(before)
    assert (inside.accepted, [type(op) for op in inside.ops]) == ((), [TreeEnsemble])
    nowhere = dataclasses.replace(behind(LOG1P), features=(Feature("x", lower=-9.0, upper=-2.0),))
    assert Activation in map(type, without_inexact_steps(nowhere).ops)


def test_trees_that_only_read_inputs_are_left_alone():
    plain = limit_inputs(
        model(random_trees(np.random.default_rng(0), features=2, comparison=Comparison.LESS), features=2)
    )
    assert without_inexact_steps(plain) is plain


def test_too_many_numbers_around_a_changeover_leave_the_step_in_place(monkeypatch):
    monkeypatch.setattr(inexact, "_MOST_AROUND", 1)
    before = behind(LOG1P)
    assert without_inexact_steps(before).ops == before.ops


def test_numbers_that_are_tried_in_batches_give_the_same_changeovers(monkeypatch):
    together = without_inexact_steps(behind(LOG1P)).ops[0].threshold
    monkeypatch.setattr(inexact, "_BATCH", 1)
    assert np.array_equal(without_inexact_steps(behind(LOG1P)).ops[0].threshold, together)


@pytest.mark.parametrize("function", [np.log1p, np.expm1])
def test_a_pipeline_is_proved_and_equals_its_library_where_its_decisions_change(function, tmp_path):
    """While the text computed the function itself, a few of such rows had another leaf, and bValid was TRUE."""
    pytest.importorskip("sklearn")
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    from st_codegen.walkers.objects import from_estimator

    random = np.random.default_rng(7)
    x = np.abs(random.normal(size=(330, 1))) * (800.0 if function is np.log1p else 2.0)
    trees = HistGradientBoostingRegressor(max_iter=3, max_leaf_nodes=200, min_samples_leaf=1, max_bins=255)
    pipeline = make_pipeline(FunctionTransformer(function), trees).fit(x, -5 + 13 * random.random(330))
    loaded = from_estimator(pipeline, "model")
    bundle = Bundle((LoadedModel(without_inexact_steps(limit_inputs(loaded.ir)), loaded.predict),), None)
    inverse = {np.log1p: np.expm1, np.expm1: np.log1p}[function]
    thresholds = loaded.ir.ops[-1].threshold[loaded.ir.ops[-1].split >= 0]
    rows = around(inverse(thresholds), 17)[:, None]
    assert len(rows) >= 6_900
    for target in ("twincat", "iec"):
        st_codegen.generate(bundle, target, tmp_path)
        got = GeneratedCode(tmp_path / target, TARGETS[target].dialect).run_model("FB_Model", rows, (0,))
        assert got.valid.all()
        assert np.array_equal(got.values[:, 0], pipeline.predict(rows))
    assert {result.verdict for result in prove(bundle, tmp_path).results} == {Verdict.PROVED}
    assert st_codegen.verify(bundle, tmp_path, rows=500).models[0].must_be_exact
