import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError
from st_codegen.ir import Activation, Comparison, Exceeds, Feature, Function, Operator, Piecewise, Scale, reference
from st_codegen.passes.choose import Layout
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import Bundle, load
from st_codegen.project.purpose import BlockCheck
from st_codegen.proof import verify as verify_module
from st_codegen.proof.agreement import block_report, ulps_between
from st_codegen.proof.probes import operating_range, origin, probe_rows
from st_codegen.proof.verify import verify
from st_codegen.proof.verify_report import merged
from st_codegen.walkers.base import LoadedModel
from tests.changes import change_once
from tests.models import model, random_trees


@pytest.fixture
def generated(generated_once):
    return generated_once("lone", layout=Layout.TREES)


@pytest.fixture
def changed(generated_once, tmp_path):
    """Changes the text of the block of one target; returns the folder in which this target is alone."""

    def make(target, pattern, by, layout=Layout.TREES):
        copy = tmp_path / "changed"
        shutil.copytree(generated_once("lone", layout=layout) / target, copy / target)
        change_once(copy / target / {"twincat": "POUs/FB_Te.TcPOU", "iec": "FB_Te.st"}[target], pattern, by)
        return copy

    return make


def test_generated_code_passes_and_the_report_says_on_what(lone_folder, generated):
    report = verify(load(lone_folder), generated, rows=500)
    (model,) = report.models
    assert report.passed
    assert model.exact
    assert model.must_be_exact
    assert (model.max_abs_err, model.max_ulp, model.bound) == (0.0, 0, 0.0)
    assert model.n >= 500
    assert sorted(model.targets) == sorted(TARGETS)
    assert len(model.worst_input) == 3
    content = json.loads(json.dumps(report.as_json()))
    assert set(content["models"]["te"]) >= {"n", "max_abs_err", "max_ulp", "exact", "worst_input", "passed"}


TREES, TABLE = Layout.TREES, Layout.TABLE
CHANGES = {
    "comparison of trees": (TREES, r"aSlot1\[SPLIT_1\[nNode\]\] <=", "aSlot1[SPLIT_1[nNode]] <"),
    "tree size": (TREES, r"nRoot := nRoot \+ TREE_SIZE_1\[nTree\]", "nRoot := nRoot + TREE_SIZE_1[nTree] - 1"),
    "a threshold of a tree": (
        TREES, r"(THRESHOLD_1 [^\[]*\[[^\[]*\[\s*\(\* tree 0 \*\)\s*)(\d+)\.", r"\g<1>1\g<2>."
    ),
    "a tree less": (TREES, r"FOR nTree := 0 TO 4", "FOR nTree := 0 TO 3"),
    "validity": (TREES, r"bValid := bUsable", "bValid := TRUE AND FALSE"),
    "comparison of ranks": (TABLE, r"IF fX > EDGE_1_0\[nRank\]", "IF fX >= EDGE_1_0[nRank]"),
    "a threshold of a rank": (TABLE, r"(EDGE_1_1 [^\[]*\[[^\[]*\[\s*)(\d+)\.", r"\g<1>1\g<2>."),
    "a cell": (TABLE, r"(CELL_2 [^\[]*\[[^\[]*\[\s*\(\*[^*]*\*\)\s*)(-?\d)", r"\g<1>1\g<2>"),
    "a stride": (TABLE, r"nCell := anRank1\[0\] \* \d+", "nCell := anRank1[0]"),
    "a missing value": (TABLE, r"IF abMissing\[1\]", "IF abMissing[0]"),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_a_change_in_the_text_is_found_with_the_row_that_shows_it(lone_folder, changed, name, target):
    layout, pattern, by = CHANGES[name]
    report = verify(load(lone_folder), changed(target, pattern, by, layout), rows=2000)
    assert not report.passed
    assert any(target in failure.between and len(failure.input) == 3 for failure in report.models[0].failures)


def test_tables_pass_where_nothing_is_changed(lone_folder, generated_once):
    assert verify(load(lone_folder), generated_once("lone", layout=Layout.TABLE), rows=300).passed


@pytest.mark.parametrize(
    ("functions", "refusal"),
    [
        ((Function.TANH,), "aInput[0] := 0.0;\n    bUsable := FALSE;"),
        ((Function.TANH, Function.LOG), "bUsable := FALSE; (* the log"),
    ],
    ids=["NaN", "log"],
)
def test_a_refusal_that_is_missing_is_found_where_the_library_leaves_its_last_digits_open(tmp_path, functions, refusal):
    """Of NaN, and of the logarithm of what a tanh rounds: no bound of rounding makes an answer there right."""
    ops = [Activation((number,), function, 1) for number, function in enumerate(functions)]
    made = limit_inputs(model(*ops, features=1))
    bundle = Bundle((LoadedModel(made, lambda x: reference.evaluate(made, x)),), None)
    generate(bundle, "iec", tmp_path)
    assert verify(bundle, tmp_path, rows=300).passed
    path = tmp_path / "iec" / "FB_M.st"
    text = path.read_text()
    assert text.count(refusal) == 1
    path.write_text(text.replace(refusal, refusal.replace("FALSE", "bUsable")))
    assert not verify(bundle, tmp_path, rows=300).passed


def test_text_that_would_stop_the_controller_is_an_error_with_its_place(lone_folder, changed):
    folder = changed("twincat", r"fOut1 := aStep1\[0\];", "fOut1 := aStep1[0] / (aInput[0] - aInput[0]);")
    with pytest.raises(GeneratedCodeError, match=r"(?s)controller would stop in FB_Te.*FB_Te\.TcPOU:\d+"):
        verify(load(lone_folder), folder, rows=50)


def test_text_that_is_no_structured_text_is_an_error_with_its_place(lone_folder, changed):
    folder = changed("iec", r"END_FOR;", "END_WHILE;")
    with pytest.raises(GeneratedCodeError, match=r"(?s)not valid Structured Text.*FB_Te\.st:\d+"):
        verify(load(lone_folder), folder, rows=50)


def with_first_leaf(text, value):
    """A LightGBM text with another first leaf; the file says how long each tree is, so the length stays."""
    old = re.search(r"leaf_value=(\S+)", text)[1]
    return text.replace(f"leaf_value={old}", f"leaf_value={repr(value)[: len(old)].ljust(len(old), '0')}", 1)


def test_a_model_that_was_retrained_does_not_match_old_text(lone_folder, generated):
    path = lone_folder / "te.txt"
    text = path.read_text()
    path.write_text(with_first_leaf(text, 0.125))
    report = verify(load(lone_folder), generated, rows=500)
    assert not report.passed


def test_a_library_that_answers_otherwise_than_what_was_read_of_it_is_found(tmp_path):
    """Text and reference agree then: that the model was read rightly is the library's word alone."""
    trees = model(random_trees(np.random.default_rng(0), comparison=Comparison.LESS))
    bundle = Bundle((LoadedModel(trees, lambda x: np.nextafter(reference.evaluate(trees, x), np.inf)),), None)
    generate(bundle, "iec", tmp_path)
    (found,) = verify(bundle, tmp_path, rows=50).models
    assert not found.passed
    assert found.failures[0].between == "library and reference"


def test_the_other_sign_of_a_zero_is_not_called_exact(tmp_path):
    """Of Max(x, 0) ONNX leaves open which zero it gives for -0; the numbers are equal, the bits are not."""
    largest = limit_inputs(model(Scale((0,), Operator.MAXIMUM, np.zeros(3))))
    bundle = Bundle((LoadedModel(largest, lambda x: reference.evaluate(largest, x)),), None)
    generate(bundle, "iec", tmp_path)
    assert "Written to equal the library, but perhaps for -0:" in "".join(p.read_text() for p in tmp_path.rglob("*.st"))
    (found,) = verify(bundle, tmp_path, rows=300).models
    assert (found.passed, found.exact, found.verdict) == (True, True, "equal but for -0")
    assert 0 < found.zero_signs < found.n


#: What is done to the magnitudes of three numbers before their roots are taken, and how many rows have none.
ROOTS = {"none": (Operator.ADD, 1.0), "some": (Operator.SUBTRACT, 0.5), "all": (Operator.MULTIPLY, -1.0)}


@pytest.mark.parametrize("missing", ROOTS)
def test_rows_without_an_answer_are_counted_and_not_called_exact_alone(missing, tmp_path):
    """Of roots of numbers below 0 nobody can say that they are equal."""
    operator, number = ROOTS[missing]
    ops = (
        Activation((0,), Function.ABS, 3),
        Scale((1,), operator, np.full(3, number)),
        Scale((2,), Operator.SUBTRACT, np.full(3, 1e-3)),
        Activation((3,), Function.SQRT, 3),
    )
    roots = limit_inputs(dataclasses.replace(model(ops[0]), ops=ops))
    bundle = Bundle((LoadedModel(roots, lambda x: reference.evaluate(roots, x)),), None)
    generate(bundle, "iec", tmp_path)
    report = verify(bundle, tmp_path, rows=300)
    (found,) = report.models
    assert report.passed == found.passed == (missing != "all")
    assert found.verdict == ("FAILED" if missing == "all" else "equal bits")
    assert found.nothing_compared == ("no row that was tried" in found.not_judged) == (missing == "all")
    assert bool(found.unanswered) == ("no finite answer to them either" in found.not_judged) == (missing != "none")
    assert (found.asked, found.silent) == (found.unanswered, 0)
    assert report.as_json()["models"][found.name]["unanswered"] == found.unanswered


def test_what_the_library_answers_and_the_block_refuses_is_said(tmp_path):
    """A library that goes on where a root does not exist was not asked, and the block was called exact."""
    ops = (Activation((0,), Function.ABS, 3), Scale((1,), Operator.SUBTRACT, np.full(3, 0.5)))
    roots = limit_inputs(dataclasses.replace(model(ops[0]), ops=(*ops, Activation((2,), Function.SQRT, 3))))

    def library(x):
        known = reference.evaluate(roots, x)
        if len(x) > 1 and np.isnan(known[x[:, 0] < 0.0]).any():
            raise ValueError("not together")
        return np.where(np.isnan(known), 7.0, known)

    bundle = Bundle((LoadedModel(roots, library),), None)
    generate(bundle, "iec", tmp_path)
    (found,) = verify(bundle, tmp_path, rows=300).models
    assert found.passed and found.verdict == "equal bits where it answers"
    assert 0 < found.silent == found.asked < found.unanswered
    row, answer = found.silent_example
    assert min(map(abs, row)) < 0.5 and answer == [7.0] * 3
    assert f"the library answers the {found.asked} of them that it was asked about, as {answer}" in found.not_judged
    assert found.as_json()["silent_example"] == [row, answer]


def test_a_bound_wider_than_all_that_an_output_spans_is_called_so(tmp_path):
    """What 1e18 leaves of tanh(x) may be anything: "within bound" alone would sound as if something was known."""
    ops = (
        Activation((0,), Function.TANH, 3),
        Scale((1,), Operator.ADD, np.full(3, 1e18)),
        Scale((2,), Operator.SUBTRACT, np.full(3, 1e18)),
    )
    for some, vague in ((ops, True), (ops[:1], False)):
        cancelled = limit_inputs(dataclasses.replace(model(ops[0]), ops=some))
        bundle = Bundle((LoadedModel(cancelled, lambda x, its=cancelled: reference.evaluate(its, x)),), None)
        generate(bundle, "iec", tmp_path / str(vague))
        (found,) = verify(bundle, tmp_path / str(vague), rows=300).models
        assert found.passed and found.verdict == "within bound"
        assert (found.vague > 0) == ("more than all that it spans" in found.not_judged) == vague


def test_numbers_beyond_the_ends_of_a_piece_are_the_reason_that_is_given(tmp_path):
    """A curve that ends where its data end takes no root and divides by nothing."""
    ends = np.array([np.inf, 1.0, np.inf])[:, None]
    curve = Piecewise((0,), np.array([0, 2]), np.array([-0.1, 0.1]), np.ones(2), ends)
    one = limit_inputs(model(curve, features=1))
    bundle = Bundle((LoadedModel(one, lambda x: reference.evaluate(one, x)),), None)
    generate(bundle, "iec", tmp_path)
    (found,) = verify(bundle, tmp_path, rows=300).models
    assert found.unanswered and "since a number lies where a piece of the model has no answer" in found.not_judged
    assert "root" not in found.not_judged
    assert "a piece of the model has no" in (tmp_path / "iec" / "FB_M.st").read_text()


def test_a_range_that_reaches_beyond_the_largest_magnitude_is_the_reason_that_is_given(tmp_path):
    """The sentence had none: `the block refuses (bValid is FALSE), since : the library ..`."""
    one = model(Activation((0,), Function.ABS, 1), features=1)
    wide = dataclasses.replace(one, features=(Feature("a", lower=0.0, upper=9.0),), magnitude_limits=(6.0,))
    bundle = Bundle((LoadedModel(wide, lambda x: reference.evaluate(wide, x)),), None)
    generate(bundle, "iec", tmp_path)
    (found,) = verify(bundle, tmp_path, rows=300).models
    assert found.unanswered and "since the magnitude of an input is too large" in found.not_judged


def test_missing_blocks_and_missing_folders_are_named(lone_folder, generated, lightgbm_text, tmp_path):
    (lone_folder / "other.txt").write_text(lightgbm_text)
    with pytest.raises(GeneratedCodeError, match="no block FB_Other, but FB_Te of the same model"):
        verify(load(lone_folder), generated, rows=50)
    with pytest.raises(GeneratedCodeError, match="run st-codegen generate"):
        verify(load(lone_folder), tmp_path / "nowhere", rows=50)


def test_a_bundle_is_verified_with_its_two_blocks(bundle_folder, generated_once, tmp_path):
    bundle = load(bundle_folder)
    generated = generated_once("bundle")
    report = verify(bundle, generated, rows=300)
    assert report.passed
    assert [model.name for model in report.models] == ["a", "b", "FB_TEPredict", "FB_Compensator"]
    shutil.copytree(generated / "twincat", tmp_path / "out" / "twincat")
    change_once(
        tmp_path / "out" / "twincat" / "POUs" / "FB_HarmonicSum.TcPOU",
        r"fSum_deg \+ aCosine\[1\]",
        "fSum_deg - aCosine[1]",
    )
    report = verify(bundle, tmp_path / "out", rows=300)
    assert [model.name for model in report.models if not model.passed] == ["FB_Compensator"]


def test_the_report_does_not_depend_on_the_number_of_jobs(lone_folder, generated):
    bundle = load(lone_folder)
    told = []
    reports = [
        verify(bundle, generated, rows=50, jobs=jobs, progress=lambda *step: told.append(step)).as_json()
        for jobs in (1, 2, 5)
    ]
    assert reports[0] == reports[1] == reports[2]
    third = len(told) // 3
    assert told[:third] == told[third : 2 * third] == told[2 * third :]
    assert [name for _, _, name in told[:third]][:-1] == [model.ir.name for model in bundle.models]


def test_ulps():
    one = np.array([1.0, 0.0, -0.0, 5e-324, -1.0, 1e308])
    other = np.array([np.nextafter(1.0, 2.0), -0.0, 5e-324, -5e-324, -1.0, -1e308])
    assert list(ulps_between(one, other)) == [1, 0, 1, 2, 0, 2**62]
    assert list(ulps_between(np.array([1.0, -0.5]), np.array([1.0 + 2.0**-23, -0.5 - 2.0**-23]))) == [1, 2]


@pytest.mark.parametrize(
    ("cuts", "expected"), [([5.0], (0.0, 10.0)), ([0.25], (-0.75, 1.25)), ([2.0, 4.0], (1.8, 4.2))]
)
def test_a_model_is_tried_on_both_sides_of_its_numbers_of_a_single_one_too(cuts, expected):
    steps = (Exceeds((0,), np.array([cut]), inclusive=False) for cut in cuts)
    assert np.ravel(operating_range(model(*steps, features=1))) == pytest.approx(expected)


def test_a_column_behind_a_long_chain_of_steps_is_no_feature():
    """Each of n steps in a row was followed back over all that stand before it: 2,000 took two minutes."""
    chain = [Scale((number,), Operator.ADD, np.array([1.0])) for number in range(200)]
    made = model(*chain, features=1)
    assert origin(made, 100, 0) == (0, [(Operator.ADD, False, 1.0)] * 100)
    assert origin(made, 101, 0) == (None, [])


def test_thresholds_are_tried_beside_many_values_of_the_other_columns():
    """A `>` for a `>=` passed: at that threshold the sides differ for a seventh of the other input's values, and each
    threshold stood in a row or two."""
    cuts = (0.25, 0.5, 0.75)
    order = {"thresholds": np.array(cuts), "comparison": Comparison.LESS_OR_EQUAL}
    trees = random_trees(np.random.default_rng(0), features=2, trees=20, **order)
    x = probe_rows(model(trees, features=2), 10_000, again=True)
    assert len(x) == len(probe_rows(model(trees, features=2), 10_000)) == 10_000
    for column in (0, 1):
        ends = np.quantile(x[np.isfinite(x).all(axis=1), 1 - column], [0.4, 0.4 + 1 / 7])
        for cut in (*cuts, *np.nextafter(cuts, 1.0)):
            beside = x[x[:, column] == cut, 1 - column]
            assert ((ends[0] < beside) & (beside < ends[1])).any()


def test_categories_are_no_thresholds_that_are_tried_again():
    """Of six encoded inputs half of all rows had a number beside a category, which the model refuses."""
    codes = np.tile(np.arange(4.0), 6)
    made = model(Piecewise((0,), 4 * np.arange(7), codes, codes, np.full((30, 1), np.inf)), features=6)
    accepted = [np.isin(probe_rows(made, 5_000, again=again), codes).all(axis=1).sum() for again in (False, True)]
    assert accepted[0] == accepted[1] > 4_000


def test_thresholds_that_are_tried_again_are_those_in_the_range():
    """Where a tenth of the thresholds of six inputs is in their range, hardly one of these rows was in it."""
    order = {"thresholds": np.linspace(0.5, 99.5, 100), "comparison": Comparison.LESS_OR_EQUAL}
    trees = random_trees(np.random.default_rng(0), features=6, trees=40, **order)
    made = model(trees, features=6)
    made = dataclasses.replace(
        made, features=tuple(dataclasses.replace(f, lower=0.0, upper=10.0) for f in made.features)
    )
    low, high = operating_range(made)
    rows = (probe_rows(made, 5_000, again=again) for again in (False, True))
    inside = [((low <= x) & (x <= high)).all(axis=1).sum() for x in rows]
    assert inside[1] == pytest.approx(inside[0], rel=0.1) and inside[1] > 2_500


def test_verify_tries_thresholds_again(lone_folder, generated, monkeypatch):
    asked = []
    monkeypatch.setattr(verify_module, "probe_rows", lambda *_, **how: asked.append(how) or probe_rows(*_, **how))
    assert verify(load(lone_folder), generated, rows=300).passed
    assert {"again": True} in asked


def test_a_range_of_the_largest_numbers_is_one_that_a_manifest_can_hold(tmp_path):
    """It had an end at infinity, which no reader of the manifest takes: verify and generate refused the folder."""
    whole = model(Exceeds((0,), np.array([-1.7e308, 1.7e308]), inclusive=False), features=2)
    assert np.isfinite(np.diff(operating_range(whole))).all()
    bundle = Bundle((LoadedModel(whole, lambda x: reference.evaluate(whole, x)),), None)
    for _ in range(2):
        generate(bundle, "iec", tmp_path)
        assert verify(bundle, tmp_path, rows=100).passed


def test_a_proof_takes_the_place_of_rows_for_every_threshold(tmp_path, monkeypatch):
    """With many trees: the rows that are left are a sample, special values among them, and the report says so."""
    trees = random_trees(
        np.random.default_rng(0),
        trees=40,
        splits=60,
        thresholds=np.random.default_rng(1).normal(size=2000),
        comparison=Comparison.LESS_OR_EQUAL,
    )
    bundle = Bundle((LoadedModel(model(trees), lambda x: reference.evaluate(model(trees), x)),), None)
    generate(bundle, "iec", tmp_path)
    whole = verify(bundle, tmp_path, rows=500).models[0]
    assert whole.n > 2000
    assert not whole.proved
    for name in ("_SECONDS_A_TREE", "_SECONDS_A_NODE"):
        monkeypatch.setattr(f"st_codegen.proof.verify.{name}", 0.0)
    sampled = verify(bundle, tmp_path, rows=500).models[0]
    assert (sampled.n, sampled.proved, sampled.passed, sampled.exact) == (500, True, True, True)
    text = tmp_path / "iec" / "FB_M.st"
    change_once(text, r"( LEAF\w* : ARRAY.* OF LREAL := \[\s+(\(\*.*?\*\)\s+)?-?)", r"\g<1>9")
    damaged = verify(bundle, tmp_path, rows=500).models[0]
    assert not damaged.proved
    assert damaged.n == whole.n
    assert not damaged.passed


def _block(expected, got, bound):
    rows = np.arange(float(len(expected)))[:, None]
    return block_report(BlockCheck("FB_X", rows, *(np.array(part, np.float64) for part in (expected, got, bound))), "x")


def test_a_block_is_not_called_within_a_bound_that_there_is_none_of():
    report = _block([[1.0], [2.0]], [[1.0], [5.0]], [[0.5], [np.inf]])
    assert (report.bound, report.unbounded) == (0.5, 1)
    assert "on 1 of 2 rows no bound is known" in report.not_judged


def test_a_block_that_answers_nothing_does_not_pass():
    report = _block([[np.nan], [np.nan]], [[np.nan], [np.nan]], [[0.0], [0.0]])
    assert report.nothing_compared
    assert report.verdict == "FAILED"


def test_what_the_models_refuse_needs_no_bound():
    report = _block([[1.0, np.nan], [np.nan, np.nan]], [[1.0, np.nan], [np.nan, np.nan]], [[0.0, np.nan]] * 2)
    assert report.must_be_exact and not report.unbounded and report.verdict == "equal bits"


def test_the_bound_of_a_failure_is_that_of_the_number_that_is_wrong():
    (failure,) = _block([[1.0, 0.0]], [[2.0, 0.1]], [[0.5, 3.0]]).failures
    assert failure.bound == 0.5


def test_a_block_that_one_target_need_not_have_to_the_bit_passes_with_both():
    exact, near = _block([[1.0]], [[1.0]], [[0.0]]), _block([[1.0]], [[1.1]], [[0.5]])
    (both,) = merged([exact, near])
    assert (both.passed, both.verdict) == (True, "within bound")


def test_the_blocks_and_programs_of_which_nothing_was_run_are_named(bundle_folder, lone_folder, tmp_path):
    generate(load(bundle_folder), "twincat", tmp_path / "bundle")
    note = verify(load(bundle_folder), tmp_path / "bundle", rows=50).notes["twincat"]
    named = set(note.removeprefix("nothing was run of ").split(", "))
    assert {"FB_CompensatorFast", "FB_CompensatorSlow", "FB_LoadTorque", "FB_Experiment", "PRG_Main"} <= named
    assert not named & {"FB_TEPredict", "FB_Compensator", "FB_Correction", "FB_HarmonicSum", "FB_SelfTest"}
    generate(load(lone_folder), "twincat", tmp_path / "lone", with_tests=True, with_comparison=True)
    assert verify(load(lone_folder), tmp_path / "lone", rows=50).notes == {}
