"""Trees behind encoders, bins and flags: columns that are constant between some numbers of one input."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.compose import ColumnTransformer
from sklearn.decomposition import PCA
from sklearn.ensemble import (
    HistGradientBoostingRegressor,
    RandomForestClassifier,
    RandomForestRegressor,
    StackingClassifier,
    StackingRegressor,
)
from sklearn.impute import SimpleImputer
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    Binarizer,
    FunctionTransformer,
    KBinsDiscretizer,
    MaxAbsScaler,
    Normalizer,
    OneHotEncoder,
    OrdinalEncoder,
    PolynomialFeatures,
    SplineTransformer,
    StandardScaler,
)
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.driver import generate
from st_codegen.errors import at_most
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.jumps import largest_jump
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.tree_proof import CELLS, TAIL
from st_codegen.proof.verify import verify
from st_codegen.walkers.base import LoadedModel
from tests.changes import change_once, ulp
from tests.classifiers import GAPS, RANDOM, SCORE, THREE, X, loaded

UNKNOWN_IS_MISSING = OrdinalEncoder(handle_unknown="use_encoded_value", unknown_value=np.nan)
KINDS = np.column_stack([X[:, 0], np.digitize(X[:, 1], [-3, 0, 2]), X[:, 2]])
PAGE = Path(__file__).parents[3] / "docs" / "proof.md"
TREE = DecisionTreeRegressor(max_depth=4, random_state=0)
KINDS_WITH_GAPS = np.where(np.isnan(GAPS), np.nan, KINDS)


def boosted(categorical=None):
    return HistGradientBoostingRegressor(
        max_iter=2, min_samples_leaf=5, max_depth=3, categorical_features=categorical, random_state=0
    )


def encoded(encoder):
    return ColumnTransformer([("kind", encoder, [1])], remainder="passthrough")


STEPS = {
    "flags of missing values": (SimpleImputer(add_indicator=True), GAPS),
    "one column a category": (encoded(OneHotEncoder(handle_unknown="ignore")), KINDS),
    "numbers of categories": (encoded(OrdinalEncoder(handle_unknown="use_encoded_value", unknown_value=-1)), KINDS),
    "one column a known category": (encoded(OneHotEncoder()), KINDS),
    "numbers of known categories": (encoded(OrdinalEncoder()), KINDS - [0, 2, 0]),
    "bins": (KBinsDiscretizer(4, encode="ordinal", quantile_method="averaged_inverted_cdf"), X),
    "bins behind a scaler": (
        make_pipeline(StandardScaler(), KBinsDiscretizer(3, encode="ordinal", quantile_method="averaged_inverted_cdf")),
        X,
    ),
    "truth values": (Binarizer(threshold=0.5), X),
    "numbers of categories, or missing": (make_pipeline(encoded(UNKNOWN_IS_MISSING), boosted()), KINDS_WITH_GAPS),
    "codes of categories": (make_pipeline(encoded(UNKNOWN_IS_MISSING), boosted([0])), KINDS),
    "codes of categories, or missing": (make_pipeline(encoded(UNKNOWN_IS_MISSING), boosted([0])), KINDS_WITH_GAPS),
    "one column a category, or missing": (
        make_pipeline(encoded(OneHotEncoder(handle_unknown="ignore", sparse_output=False)), boosted()),
        KINDS_WITH_GAPS,
    ),
}


def generated(name, folder, layout=Layout.AUTO):
    before, x = STEPS[name]
    whole = before if hasattr(before, "predict") else make_pipeline(before, TREE)
    kinds = 50.0 * (x[:, 1] == 1.0) if "of categories" in name else 0.0
    model = loaded(whole.fit(x, SCORE + kinds + 9.0 * np.isnan(x).sum(axis=1)))
    model = LoadedModel(limit_inputs(model.ir), model.predict)
    generate(Bundle((model,)), "iec", folder, options=Options(layout=layout))
    return model, folder / "iec" / "FB_M.st"


@pytest.mark.thorough
@pytest.mark.parametrize("name", STEPS)
def test_trees_behind_steps_are_proved(name, tmp_path):
    model, _ = generated(name, tmp_path)
    (result,) = prove(Bundle((model,)), tmp_path).results
    assert (result.verdict, result.reason) == (Verdict.PROVED, ""), result


def test_trees_behind_steps_are_proved_node_by_node(tmp_path):
    model, _ = generated("bins behind a scaler", tmp_path, Layout.TREES)
    assert prove(Bundle((model,)), tmp_path).proved


def scaled_leaves(folder):
    lightgbm = pytest.importorskip("lightgbm")
    leaves = lightgbm.LGBMRegressor(n_estimators=3, num_leaves=4, linear_tree=True, verbose=-1, n_jobs=1)
    model = loaded(make_pipeline(StandardScaler(), leaves).fit(X, SCORE))
    model = LoadedModel(limit_inputs(model.ir), model.predict)
    generate(Bundle((model,)), "iec", folder)
    return Bundle((model,)), folder / "iec" / "FB_M.st"


def test_linear_leaves_behind_a_scaler_are_proved(tmp_path):
    bundle, path = scaled_leaves(tmp_path)
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, result.method) == (Verdict.PROVED, TAIL), result
    for change in ("aInput[LEAF_COLUMN_3", "aStep1[LEAF_COLUMN_3"):
        original = path.read_text()
        assert "aStep2[LEAF_COLUMN_3" in original
        path.write_text(original.replace("aStep2[LEAF_COLUMN_3", change))
        (result,) = prove(bundle, tmp_path).results
        assert result.verdict is not Verdict.PROVED
        path.write_text(original)


CHANGES = {
    "an end of a bin": ("bins", r"( KNOT_1 : .*\n\s+(?:\(\*.*\*\)\n\s+)?)(-?[0-9.E-]+)", ulp),
    "a number of a bin": ("bins", r"(PIECE_1 : .*\n\s+)0\.0, 1\.0", r"\g<1>0.0, 2.0"),
    "a number on the end of a bin": ("bins", r"(KNOT_VALUE_1 : .*\n\s+)1\.0", r"\g<1>0.0"),
    "a cut": ("truth values", r"(CUT_1 : .*\n\s+)(0\.5)", ulp),
    "a category that nobody knows": ("numbers of known categories", r"(PIECE_REFUSED_4 : .*\n\s+1, )1", r"\g<1>0"),
    "a known category": ("numbers of known categories", r"(KNOT_REFUSED_4 : .*\n\s+0, )0", r"\g<1>1"),
    "a number of a known category": ("numbers of known categories", r"(KNOT_VALUE_4 : .*\n\s+0\.0, )1", r"\g<1>2"),
    "no category": ("one column a known category", r"(PIECE_REFUSED_\d+ : .*\n\s+1, 1, )1", r"\g<1>0"),
    "a category that counts as missing": (
        "numbers of categories, or missing",
        r"(MISSING_LOW_\d+ : .*\n\s+4\.0, )4\.0",
        r"\g<1>1.0",
    ),
    "an unknown category that counts as one": (
        "codes of categories, or missing",
        r"(CATEGORY_MISSING_0_\d+ : .*\n\s+)4\.0, 4\.0",
        r"\g<1>0.0, 0.0",
    ),
    "a code of a category": (
        "codes of categories, or missing",
        r"(KNOT_VALUE_\d+ : .*\n\s+0\.0, )1\.0",
        r"\g<1>3.0",
    ),
    "a missing value that counts as there": ("flags of missing values", r"(FILL_[2-9] : .*\n\s+)1\.0", r"\g<1>0.0"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHANGES)
def test_a_step_that_was_changed_is_refuted(name, tmp_path):
    steps, pattern, change = CHANGES[name]
    model, path = generated(steps, tmp_path)
    change_once(path, pattern, change)
    (result,) = prove(Bundle((model,)), tmp_path).results
    assert result.verdict is Verdict.REFUTED, result


FOREST = RandomForestRegressor(3, max_depth=3, random_state=0)
#: Steps that compute of several inputs, or inexactly, or refuse numbers.
COMPUTED = {
    "components": PCA(2),
    "products": PolynomialFeatures(2),
    "lengths": Normalizer(),
    "lengths of components": make_pipeline(PCA(2), Normalizer()),
    "splines": SplineTransformer(3),
}


def behind(step, folder, last=TREE, answer=SCORE, layout=Layout.AUTO):
    model = loaded(make_pipeline(step, last).fit(X, answer))
    model = LoadedModel(limit_inputs(model.ir), model.predict)
    generate(Bundle((model,)), "iec", folder, options=Options(layout=layout))
    return Bundle((model,)), folder / "iec" / "FB_M.st"


@pytest.mark.parametrize("name", COMPUTED)
def test_trees_behind_computed_numbers_are_the_expression_and_the_jump_is_told(name, tmp_path):
    bundle, _ = behind(COMPUTED[name], tmp_path, FOREST)
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, result.method, result.reason) == (Verdict.PROVED, TAIL, "")
    jump = largest_jump(bundle.models[0].ir)
    if name == "products":  # both round them alike
        assert (jump, result.claims) == (0.0, ())
        return
    (claim,) = result.claims
    assert f"differs by up to {at_most(jump, 3)}" in claim
    assert result.bound == (np.inf,)  # none is claimed


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.RANKED])
def test_labels_behind_components_are_proved_in_every_layout(layout, tmp_path):
    classes = RandomForestClassifier(3, max_depth=3, random_state=0)
    bundle, _ = behind(PCA(2), tmp_path, classes, THREE, layout)
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, len(result.claims)) == (Verdict.PROVED, 1), result


COMPUTED_CHANGES = {
    "a weight": ("components", r"( WEIGHT_1 : .*\n\s+\(\*.*\*\)\n\s+)(-?[0-9.E-]+)", ulp),
    "a constant of a sum": ("components", r"( BIAS_1 : .*\n\s+)(-?[0-9.E-]+)", ulp),
    "a threshold": ("components", r"( THRESHOLD_2 : .*\n\s+\(\*.*\*\)\n\s+)(-?[0-9.E-]+)", r"\g<1>0.5"),
    "the comparison": ("components", r"<= (THRESHOLD_2)", r"< \1"),
    "the order of additions": (
        "components",
        r"fColumn := aInput\[nColumn\];(\s+fSum := fSum \+ fColumn \* WEIGHT_1)\[nColumn\]",
        r"fColumn := aInput[nColumn];\n    fSum := fSum + aInput[2 - nColumn] * WEIGHT_1[2 - nColumn]",
    ),
    "no rounding": ("components", r"REAL_TO_LREAL\(LREAL_TO_REAL\(fX\)\)", "fX"),
    "a column": ("components", r"(SLOT_COLUMN_2 : .*\n\s+)0", r"\g<1>1"),
    "a refusal of numbers that are not too large": (
        "components",
        r"(\(\* 3\. )",
        r"IF aStep1[0] > 1.0 THEN bUsable := FALSE; END_IF; \1",
    ),
    "no refusal": ("lengths", r"bUsable := FALSE; (\(\* the quotient)", r"\1"),
    "another refusal": ("lengths", r"<= (ABS\(aInput)", r"< \1"),
    "an answer without the tree": ("components", r"fOut1 := aStep2", "fOut1 := aStep1"),
}


ANOTHER_TERM = "a sum of the text has another term than tree 0"
#: What docs/proof.md lists as not proved, and the reason that it quotes.
NOT_FOLLOWED = {
    "filled in, then multiplied": (
        make_pipeline(SimpleImputer(), PolynomialFeatures(2, interaction_only=True)),
        "a number that is not computed from the limited input",
    ),
    "filled in, then turned": (
        make_pipeline(SimpleImputer(), PCA(2)),
        "a number that is not computed from the limited input",
    ),
    "the largest magnitude": (Normalizer("max"), "a number that depends on an input in several ways"),
    "the sum of magnitudes": (Normalizer("l1"), "a number that depends on an input in several ways"),
    "a number that stands for a gap": (SimpleImputer(missing_values=X[0, 0]), ANOTHER_TERM),
    "signs": (FunctionTransformer(np.sign), ANOTHER_TERM),
}


@pytest.mark.parametrize("name", NOT_FOLLOWED)
def test_what_the_page_says_is_not_followed_has_its_reason(name, tmp_path):
    step, reason = NOT_FOLLOWED[name]
    model = loaded(make_pipeline(step, TREE).fit(X, SCORE))
    generate(Bundle((model,)), "iec", tmp_path)
    (result,) = prove(Bundle((model,)), tmp_path).results
    assert result.verdict is Verdict.NOT_PROVED
    assert reason in result.reason and f"`{reason}" in PAGE.read_text(encoding="utf-8")


#: A line of the inputs as it is written, and another one: what it is then, of a missing number above all.
RANGE_CHANGES = {
    "outside where it is missing": (r"NOT abMissing\[nColumn\]\s+AND \(aInput", "(aInput"),
    "never outside": (r"bInside := FALSE", "bInside := TRUE"),
    "inside beyond the end": (r"aInput\[nColumn\] > (RANGE|FLAG)_UPPER\[nColumn\]\)", r"aInput[nColumn] > 1.0E9)"),
    "not limited": (r"aInput\[nColumn\] := RANGE_LOWER\[nColumn\]", "aInput[nColumn] := aInput[nColumn]"),
}


def filled_within_ranges(folder, outside):
    model = loaded(make_pipeline(SimpleImputer(), Ridge()).fit(GAPS, SCORE))
    ends = {"lower": -5.0, "upper": 5.0} if outside == "limit" else {"flagged": (1.0, 5.0)}
    within = tuple(dataclasses.replace(feature, **ends) for feature in model.ir.features)
    bundle = Bundle((LoadedModel(limit_inputs(dataclasses.replace(model.ir, features=within)), model.predict),))
    generate(bundle, "iec", folder)
    return bundle, folder / "iec" / "FB_M.st"


@pytest.mark.parametrize("outside", ["limit", "flag"])
def test_numbers_that_are_filled_in_within_a_range_are_followed(outside, tmp_path):
    """A missing number is limited as well, and is inside: nothing overflows."""
    bundle, _ = filled_within_ranges(tmp_path, outside)
    (result,) = prove(bundle, tmp_path).results
    assert result.verdict is Verdict.PROVED, result
    assert verify(bundle, tmp_path, rows=300).passed


def test_a_missing_number_is_answered_beside_a_range_of_numbers_that_are_not(tmp_path):
    """What stands for it is limited to a magnitude that trees refuse, and was refused for it."""
    model = loaded(make_pipeline(SimpleImputer(), StandardScaler(), TREE).fit(30.0 * GAPS, SCORE))
    first, *others = model.ir.features
    far = (dataclasses.replace(first, lower=3.5e38, upper=3.6e38), *others)
    bundle = Bundle((LoadedModel(limit_inputs(dataclasses.replace(model.ir, features=far)), model.predict),))
    generate(bundle, "iec", tmp_path)
    assert "RANGE_LIMIT" in (tmp_path / "iec" / "FB_M.st").read_text()
    report = verify(bundle, tmp_path, rows=300)
    assert report.passed, [str(failure) for one in report.models for failure in one.failures]


@pytest.mark.parametrize("name", RANGE_CHANGES)
def test_what_is_changed_in_a_range_of_what_is_filled_in_is_not_proved(name, tmp_path):
    bundle, path = filled_within_ranges(tmp_path, "limit")
    change_once(path, *RANGE_CHANGES[name])
    (result,) = prove(bundle, tmp_path).results
    assert result.verdict is not Verdict.PROVED


@pytest.mark.parametrize("name", COMPUTED_CHANGES)
def test_what_is_changed_in_front_of_trees_is_not_proved(name, tmp_path):
    steps, pattern, change = COMPUTED_CHANGES[name]
    bundle, path = behind(COMPUTED[steps], tmp_path)
    change_once(path, pattern, change)
    (result,) = prove(bundle, tmp_path).results
    assert result.verdict is not Verdict.PROVED
    assert result.verdict is Verdict.REFUTED or name not in ("an answer without the tree", "a threshold"), result


#: Trees behind trees: with the inputs beside them, behind a linear model, for labels.
STACKS = {
    "trees": StackingRegressor([("tree", TREE), ("few", FOREST)], FOREST, passthrough=True, cv=2),
    "a linear model": StackingRegressor([("tree", TREE), ("line", Ridge())], TREE, cv=2),
    "labels": StackingClassifier([("tree", DecisionTreeClassifier(max_depth=2))], DecisionTreeClassifier(), cv=2),
}


@pytest.mark.parametrize("layout", [Layout.AUTO, Layout.TREES, Layout.RANKED])
@pytest.mark.parametrize("name", STACKS)
def test_trees_behind_trees_are_proved(name, layout, tmp_path):
    bundle, _ = behind("passthrough", tmp_path, STACKS[name], THREE if name == "labels" else SCORE, layout)
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, len(result.claims)) == (Verdict.PROVED, name == "a linear model"), result


def small_table(folder):
    first, last = (DecisionTreeRegressor(max_depth=depth, random_state=0) for depth in (2, 1))
    stack = StackingRegressor([("tree", first), ("other", last)], DecisionTreeRegressor(max_depth=2), cv=2)
    return behind("passthrough", folder, stack, layout=Layout.TABLE)


def test_trees_behind_trees_are_proved_as_a_table(tmp_path):
    bundle, path = small_table(tmp_path)
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, result.method) == (Verdict.PROVED, CELLS)
    change_once(path, r"( CELL_\d+ : .*\n(?:\s+\(\*.*\*\)\n)?\s+)(-?[0-9.E-]+)", ulp)
    assert prove(bundle, tmp_path).results[0].verdict is Verdict.REFUTED


STACK_CHANGES = {
    "a leaf of a tree in front": (r"(?s)( THRESHOLD_1 : .*?)(-?\d+\.\d+(?:E-?\d+)?)(?=\s*\];)", ulp),
    "a threshold behind": (r"( THRESHOLD_4 : .*\n\s+\(\*.*\*\)\n\s+)(-?[0-9.E-]+)", r"\g<1>0.5"),
    "the comparison behind": (r"<= (THRESHOLD_4)", r"< \1"),
    "columns that are exchanged": (r"aStep3\[0\] := aStep1\[0\]", "aStep3[0] := aStep2[0]"),
    "the division in front": (r"aStep2\[0\] / DIVISOR_2", "aStep2[0] * (1.0 / DIVISOR_2)"),
    "no rounding behind": (r"(aStep3.*;\n(?:.*\n){1,3})(.*)REAL_TO_LREAL\(LREAL_TO_REAL\(fX\)\)", r"\1\2fX"),
    "an answer of the trees in front": (r"fOut1 := aStep4", "fOut1 := aStep1"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", STACK_CHANGES)
def test_a_stack_that_was_changed_is_not_proved(name, tmp_path):
    bundle, path = behind("passthrough", tmp_path, STACKS["trees"], layout=Layout.TREES)
    change_once(path, *STACK_CHANGES[name])
    assert prove(bundle, tmp_path).results[0].verdict is not Verdict.PROVED


#: Inputs from 0 on, a third of them 0, which trees take for missing.
COUNTS = np.where(RANDOM.random(X.shape) < 0.3, 0.0, np.abs(X))


def counts_missing(kind):
    if kind == "lightgbm":
        lightgbm = pytest.importorskip("lightgbm")
        return lightgbm.LGBMRegressor(n_estimators=3, num_leaves=6, zero_as_missing=True, verbose=-1, n_jobs=1)
    return pytest.importorskip("xgboost").XGBRegressor(n_estimators=3, max_depth=3, missing=0.0, n_jobs=1)


FALLING = MaxAbsScaler().fit(COUNTS)
FALLING.scale_ *= -1.0
BINS = KBinsDiscretizer(4, encode="ordinal", quantile_method="averaged_inverted_cdf").fit(COUNTS)
FILLED = SimpleImputer(strategy="constant", fill_value=0.0).fit(COUNTS)
#: What stands before the trees, its inputs, and the least number of their declared range.
BEFORE_GAPS = {
    "nothing": (FunctionTransformer().fit(COUNTS), COUNTS, 0.0),
    "nothing, numbers below": (FunctionTransformer().fit(COUNTS), COUNTS, -1.0),
    "numbers that fall": (FALLING, COUNTS, -1.0),
    "numbers that fall from it": (FALLING, COUNTS, 0.0),
    "bins": (BINS, COUNTS, 0.0),
    "a gap that is filled": (FILLED, np.where(COUNTS == 0, np.nan, COUNTS), 0.0),
}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["lightgbm", "xgboost"])
@pytest.mark.parametrize("name", BEFORE_GAPS)
def test_numbers_that_count_as_missing_are_followed(name, kind, tmp_path):
    step, x, lower = BEFORE_GAPS[name]
    trees = counts_missing(kind).fit(step.transform(x), SCORE + 2.0 * (COUNTS == 0).sum(axis=1))
    model = loaded(make_pipeline(step, trees))
    within = tuple(dataclasses.replace(feature, lower=lower, upper=20.0) for feature in model.ir.features)
    model = LoadedModel(limit_inputs(dataclasses.replace(model.ir, features=within)), model.predict)
    assert any(column.missing_interval for op in model.ir.ops for column in getattr(op, "columns", ()))
    bundle = Bundle((model,))
    generate(bundle, "iec", tmp_path, options=Options(layout=Layout.TREES))
    (result,) = prove(bundle, tmp_path).results
    assert (result.verdict, result.reason) == (Verdict.PROVED, ""), result


def test_an_infinite_category_is_refused_beside_an_input_that_is_limited(tmp_path):
    """Limiting the inputs made the largest number of it, which is a category that nobody knows, but a number."""
    model = loaded(boosted([1]).fit(KINDS_WITH_GAPS, SCORE))
    first, *others = model.ir.features
    features = (dataclasses.replace(first, lower=-1.0, upper=1.0), *others)
    bundle = Bundle((LoadedModel(dataclasses.replace(model.ir, features=features), model.predict),))
    generate(bundle, "iec", tmp_path)
    (result,) = prove(bundle, tmp_path).results
    assert result.verdict is Verdict.PROVED, result
