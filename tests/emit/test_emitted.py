"""The emitted text, executed: every kind of model, in both dialects, against the reference evaluation."""

import dataclasses
import itertools
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.contents import Contents
from st_codegen.emit.render import render
from st_codegen.emit.targets import TARGETS
from st_codegen.ir import reference
from st_codegen.ir.model import Feature
from st_codegen.passes.domain import limit_inputs
from st_codegen.proof import bounds
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st.check.portable import single_rounds
from tests.examples import examples
from tests.models import MISSING_BEHIND, SMALL_MODELS, tree_models
from tests.st.leftovers import unused_variables


def rendered(model, target, limits=None):
    return render(Contents((model,)), TARGETS[target], limits)


def generated(model, target, folder, limits=None):
    """The checked text of a model's block."""
    for file in rendered(model, target, limits):
        path = folder / target / file.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(file.pieces), encoding="utf-8")
    return GeneratedCode(folder / target, TARGETS[target].dialect)


def run(model, target, folder, x, limits=None):
    """Generate, parse and run a model's block on rows; NaN where it flags a row."""
    code = generated(model, target, folder, limits)
    assert (*single_rounds(code.project), *unused_variables(code.project)) == ()
    result = code.run_model(block_name(model.name), x, len(model.outputs))
    return np.where(result.valid[:, None], result.values, np.nan)


def assert_same(model, target, folder, rows=700, seed=0):
    x = probe_rows(model, rows, seed)
    expected = reference.evaluate(model, x)
    got = run(model, target, folder, x)
    bound = np.where(np.isfinite(expected), bounds.difference_bound(model, x), 0.0)
    same = (expected == got) | (np.isnan(expected) & np.isnan(got)) | (np.abs(expected - got) <= bound)
    wrong = np.flatnonzero(~np.all(same, axis=1))
    assert not wrong.size, f"{x[wrong[0]]}: {expected[wrong[0]]} expected, {got[wrong[0]]} computed"
    if model.exact:
        assert np.array_equal(expected, got, equal_nan=True)
    return expected


@pytest.mark.parametrize(
    ("name", "target"),
    [
        *itertools.product(SMALL_MODELS, ["iec", "twincat"]),
        *itertools.product(itertools.islice(SMALL_MODELS, 0, None, 4), ["plcopen"]),
    ],
)
def test_each_operation_computes_what_the_reference_computes(name, target, tmp_path):
    expected = assert_same(limit_inputs(SMALL_MODELS[name]), target, tmp_path)
    # one of the models has no number for most of its pieces; all others answer more than a third of the rows
    assert np.isfinite(expected).all(axis=1).mean() > (0.2 if name == "piecewise constant" else 0.3)
    # it alone refuses what some of its pieces and knots would answer
    refuses = any("_REFUSED" in path.read_text("utf-8") for path in tmp_path.rglob("*") if path.is_file())
    assert refuses == (name == "piecewise constant")


@pytest.mark.parametrize("target", ["iec", "twincat"])
@pytest.mark.parametrize("name", MISSING_BEHIND)
def test_a_missing_value_is_no_fault_where_what_stands_for_it_has_no_answer(name, target, tmp_path):
    expected = assert_same(limit_inputs(MISSING_BEHIND[name]), target, tmp_path)
    assert np.isfinite(expected).all(axis=1).mean() > 0.2


@pytest.mark.parametrize("name", SMALL_MODELS)
def test_plcopen_has_the_bodies_of_the_portable_text(name):
    model = limit_inputs(SMALL_MODELS[name])
    portable, plcopen = ("\n".join("".join(file.pieces) for file in rendered(model, t)) for t in ("iec", "plcopen"))
    bodies = re.findall(r"<!\[CDATA\[\n(.*?)\]\]>", plcopen, re.S)
    assert len(bodies) == len(re.findall(r"^END_(?:FUNCTION|FUNCTION_BLOCK|PROGRAM)$", portable, re.M))
    assert all(body.strip() in portable for body in bodies)


@examples(suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(model=tree_models(), target=st.sampled_from(["iec", "twincat", "plcopen"]), seed=st.integers(0, 2**31))
def test_any_tree_ensemble_is_equal_to_the_bit(model, target, seed, tmp_path_factory):
    assert_same(limit_inputs(model), target, tmp_path_factory.mktemp("trees"), rows=300, seed=seed)


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_an_input_that_is_limited_to_a_range_is_refused_by_no_magnitude(target, tmp_path):
    """Its header said "magnitude below ..", where every number is taken: the range comes first."""
    features = (Feature("a", lower=-1.0, upper=2.0), Feature("b"), Feature("c", lower=0.0, upper=1e300))
    ranged = dataclasses.replace(SMALL_MODELS["linear"], features=features, magnitude_limits=(1e100, 1e100, 1e100))
    assert ranged.refused_from == (None, 1e100, 1e100)
    text = "".join(itertools.chain.from_iterable(file.pieces for file in rendered(ranged, target)))
    headers = re.findall(r"Input \d+: .*", text)
    assert ["magnitude below" in line for line in headers] == [False, True, True]
    huge = np.array([[1e200, 0.0, 0.0], [np.inf, 0.0, 0.0], [0.0, 1e200, 0.0], [0.0, 0.0, 1e200]])
    assert np.isfinite(run(ranged, target, tmp_path, huge)[:, 0]).tolist() == [True, True, False, False]
    infinite = dataclasses.replace(ranged, magnitude_limits=(1e100, np.inf, 1e100))
    rows = np.array([[0.0, np.inf, 0.0], [0.0, -np.inf, 0.0], [0.0, 1.0, 1e200], [np.inf, 1.0, 0.0]])
    assert np.isfinite(run(infinite, target, tmp_path / "infinite", rows)[:, 0]).tolist() == [False] * 3 + [True]
    alone = dataclasses.replace(ranged, magnitude_limits=(1e100, None, None))
    assert not any("INPUT_LIMIT" in "".join(file.pieces) for file in rendered(alone, target))
