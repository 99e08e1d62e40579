"""The independent checker: accepts what `prove` proves, in every layout and dialect, and nothing that was changed."""

import ast
import functools
import hashlib
import json
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import lightgbm
import numpy as np
import pytest
import skops.io
from sklearn.ensemble import (
    ExtraTreesClassifier,
    HistGradientBoostingClassifier,
    HistGradientBoostingRegressor,
    RandomForestClassifier,
    RandomForestRegressor,
)
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.prove.certificate import certificate
from st_codegen.proof.prove.prove import prove
from st_codegen.proof.runner import GeneratedCode
from tests.changes import change_once
from tests.classifiers import THREE, TWO, X
from tests.proof import mutants

ROOT = Path(__file__).resolve().parents[2]
CHECKER = ROOT / "checker" / "check_certificate.py"
GOLDEN = ROOT / "golden" / "lone"
#: Golden tree models that the checker does not know, and what it says.
OUTSIDE = {
    "hist_gradient_boosting_category.skops": "link or categories",
    "lightgbm_category.txt": "categories and linear leaves are not known",
    "lightgbm_zero_missing.txt": "missing_type Zero is not known",
    "onnx_ensemble.onnx": "the operator TreeEnsemble is not known",
    "onnx_trees.onnx": "modes or aggregates",
    "xgboost_category.ubj": "categories are not known",
    "xgboost_poisson.json": "only reg:squarederror is known",
    "xgboost_two_outputs.json": "leaves with several numbers are not known",
}
KNOWN = ("decision_tree.skops", "extra_trees.skops", "gradient_boosting.skops", "hist_gradient_boosting.skops")
KNOWN += (
    "lightgbm_gbdt.txt",
    "lightgbm_missing.txt",
    "random_forest.skops",
    "xgboost_gbtree.json",
    "xgboost_missing.ubj",
)
KNOWN += ("extra_tree.skops", "extra_trees_ranked.skops", "hist_gradient_boosting_missing.skops")
KNOWN += ("lightgbm_dart.txt", "lightgbm_rf.txt", "random_forest_two_outputs.skops", "xgboost_dart.json")


@pytest.fixture(scope="module", autouse=True)
def golden_text_is_read_once():
    """Proofs of few models read the text of all; that of golden/, which nobody changes, is kept."""
    kept = functools.cache(GeneratedCode)
    with pytest.MonkeyPatch.context() as patch:
        read = lambda folder: (kept if GOLDEN in folder.parents else GeneratedCode)(folder)  # noqa: E731
        patch.setattr("st_codegen.proof.prove.prove.GeneratedCode", read)
        yield


def folder_of(tmp_path, names):
    folder = tmp_path / "models"
    folder.mkdir()
    for name in names:
        shutil.copy(GOLDEN / "models" / name, folder)
    return folder


def written(tmp_path, models, out):
    bundle = load(models)
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps(certificate(bundle, models, out, prove(bundle, out))))
    return path


def check(*arguments):
    return subprocess.run([sys.executable, CHECKER, *map(str, arguments)], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_golden_models_are_confirmed(target, tmp_path):
    models = folder_of(tmp_path, KNOWN)
    result = check(written(tmp_path, models, GOLDEN / "generated" / target), models, GOLDEN / "generated" / target)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count(": confirmed") == len(KNOWN)


def test_tables_of_one_block_may_read_different_inputs(tmp_path):
    """Orders 78 and 81 of the example have one block: a table by speed and torque, one by torque and temperature."""
    example, models = ROOT / "examples" / "rv160n" / "models", tmp_path / "models"
    models.mkdir()
    head, *harmonics = (example / "bundle.toml").read_text().split("[[harmonic]]")
    here = [h for h in harmonics if 'direction = "backward"' in h and re.search(r"^order = (78|81)$", h, re.M)]
    head = re.sub(r"^orders = .*$", "orders = [78, 81]", head, flags=re.M)
    head = re.sub(r"^directions = .*$", 'directions = ["backward"]', head, flags=re.M)
    (models / "bundle.toml").write_text("[[harmonic]]".join([head, *here]))
    for name in re.findall(r'= "(\S+\.\w+)"', "".join(here)):
        shutil.copy(example / name, models)
    generate(load(models), "iec", tmp_path / "out")
    result = check(written(tmp_path, models, tmp_path / "out"), models, tmp_path / "out")
    assert (result.returncode, result.stdout.count(": confirmed")) == (3, 4), result.stdout  # FB_TEPredict: not checked
    for entry in json.loads((tmp_path / "certificate.json").read_text())["proofs"]:
        # whoever exchanges the outputs of two models is seen
        assert f"{entry['model']}, iec ({entry['block']}.{entry['outputs'][0]}): confirmed" in result.stdout


def test_a_folder_that_is_called_as_a_target_is_no_target(tmp_path):
    models, out = folder_of(tmp_path, ["lightgbm_gbdt.txt"]), tmp_path / "iec"
    generate(load(models), "iec", out)
    path = written(tmp_path, models, out)
    for folder in (out, out / "iec"):
        result = check(path, models, folder)
        assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("ranks", [True, False])
def test_sums_of_trees_are_confirmed(ranks, tmp_path):
    models = folder_of(tmp_path, KNOWN)
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=Layout.RANKED if ranks else Layout.TREES))
    result = check(written(tmp_path, models, tmp_path / "out"), models, tmp_path / "out")
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.RANKED, Layout.CUT])
def test_trees_of_one_leaf_among_others_are_proved_and_confirmed(layout, tmp_path):
    model = RandomForestRegressor(24, max_samples=4, max_features=1, min_samples_leaf=2, random_state=0)
    model.fit(X, X[:, 0] * X[:, 1])
    assert {tree.tree_.node_count for tree in model.estimators_} == {1, 3}
    (tmp_path / "models").mkdir()
    skops.io.dump(model, tmp_path / "models" / "m.skops")
    generate(load(tmp_path / "models"), "iec", tmp_path / "out", options=Options(layout, table_bytes=1))
    result = check(written(tmp_path, tmp_path / "models", tmp_path / "out"), tmp_path / "models", tmp_path / "out")
    assert result.returncode == 0, result.stdout


#: The sum of 0.5, which stands there once too often, one tree of two that are alike, and 0.25.
ONE_TREE_LEFT_OUT = """
aStep1[0] := 0.5;
nNode := 0;
IF aSlot1[0] <= 0.5 THEN nNode := 1; END_IF;
aStep1[0] := aStep1[0] + HALF[nNode];
nNode := 0;
IF aSlot1[1] <= 0.5 THEN nNode := 1; END_IF;
aStep1[0] := aStep1[0] + LEAVES[nNode];
nNode := 0;
IF aSlot1[1] <= 0.5 THEN nNode := 0; END_IF;
aStep1[0] := aStep1[0] + QUARTER[nNode];
aStep1[0] := aStep1[0] / DIVISOR_1;
"""


@pytest.mark.parametrize("boxes", [1, 100_000])
def test_the_terms_of_a_sum_are_the_same_trees_in_the_boxes_of_all_trees(boxes, tmp_path, monkeypatch):
    """In the boxes of one tree its first term was the number of a tree of one leaf, in those of the next one a tree."""
    rows = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    trees = [
        DecisionTreeRegressor().fit(rows, answer)
        for answer in (np.full(4, 0.5), 10.0 * rows[:, 0] + rows[:, 1], rows[:, 1], np.full(4, 0.25))
    ]
    trees[1].tree_.value[:] %= 10.0  # as the next one, but it asks for another input, too
    model = RandomForestRegressor(4).fit(rows, rows[:, 1])
    model.estimators_ = trees
    (tmp_path / "models").mkdir()
    skops.io.dump(model, tmp_path / "models" / "m.skops")
    generate(load(tmp_path / "models"), "iec", tmp_path / "out", options=Options(Layout.TREES))
    check_certificate = mutants.check_certificate
    monkeypatch.setattr(check_certificate, "BOXES", boxes)
    (text,) = tmp_path.rglob("FB_M.st")
    arguments = (check_certificate.read_model(tmp_path / "models" / "m.skops"), text.parent)
    entry = {"block": "FB_M", "outputs": ["fOut1"], "inputs": ["f0", "f1"]}
    check_certificate.Check(*arguments, entry)
    change_once(text, r"(?s)aStep1\[0\] := START.*(?=\(\* 3)", ONE_TREE_LEFT_OUT)
    pairs = {"HALF": (0.5, 0.5), "LEAVES": (1.0, 0.0), "QUARTER": (0.25, 0.25)}
    tables = "".join(f"{name} : ARRAY[0..1] OF LREAL := {list(pair)};\n" for name, pair in pairs.items())
    change_once(text, r"END_VAR\n\n\(\* 1", tables + r"\g<0>")
    with pytest.raises(check_certificate.Reject):
        check_certificate.Check(*arguments, entry)


def test_files_of_xgbregressor_take_infinities_and_end_at_the_best_iteration(tmp_path):
    xgboost = pytest.importorskip("xgboost")
    answer = X[:, 0] * X[:, 1]
    options = {"n_estimators": 12, "max_depth": 2, "early_stopping_rounds": 3, "learning_rate": 1.0}
    model = xgboost.XGBRegressor(**options).fit(X, answer, eval_set=[(X[::3], answer[::3] - X[::3, 0])], verbose=False)
    assert 0 < model.best_iteration < model.get_booster().num_boosted_rounds() - 1
    (tmp_path / "models").mkdir()
    model.save_model(tmp_path / "models" / "m.json")
    generate(load(tmp_path / "models"), "iec", tmp_path / "out")
    result = check(written(tmp_path, tmp_path / "models", tmp_path / "out"), tmp_path / "models", tmp_path / "out")
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_is_outside_is_named_and_not_confirmed(name, tmp_path):
    models = folder_of(tmp_path, [name])
    out = GOLDEN / "generated" / "iec"
    result = check(written(tmp_path, models, out), models, out)
    assert result.returncode == 3
    assert f"not checked: {OUTSIDE[name]}" in result.stdout
    assert "accepted in part only; entries confirmed: 0 of 1" in result.stdout


def test_entries_that_are_not_checked_are_named_beside_those_that_are(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops", "ridge.skops", "lightgbm_linear.txt"])
    out = GOLDEN / "generated" / "iec"
    result = check(written(tmp_path, models, out), models, out)
    assert result.returncode == 3, result.stdout
    assert "random_forest, iec: confirmed" in result.stdout
    assert "ridge, iec: not checked: expressions" in result.stdout
    assert "lightgbm_linear, iec: not checked: expressions" in result.stdout
    assert "accepted in part only; entries confirmed: 1 of 3" in result.stdout


def test_claims_of_blocks_around_models_are_not_confirmed_and_their_verdicts_keep_their_form(tmp_path):
    models, out = ROOT / "golden" / "bundle" / "models", ROOT / "golden" / "bundle" / "generated" / "iec"
    path = written(tmp_path, models, out)
    result = check(path, models, out)
    assert (result.returncode, "FB_Compensator, iec: not checked: invariants" in result.stdout) == (3, True)
    content = json.loads(path.read_text())
    content["blocks"][0]["verdict"] = "not proved"
    path.write_text(json.dumps(content))
    assert check(path, models, out).returncode == 1


def test_wrong_use_has_an_exit_code_of_its_own():
    assert check("certificate.json").returncode == 2


def test_a_comparison_that_no_cut_decides_ends_the_check(tmp_path):
    models = folder_of(tmp_path, ["gradient_boosting.skops"])
    out = tmp_path / "out" / "iec"
    shutil.copytree(GOLDEN / "generated" / "iec", out)
    text = out / "FB_Gradient_boosting.st"
    limit = "ABS(aInput[nColumn]) > INPUT_LIMIT"
    assert limit in text.read_text()
    text.write_text(text.read_text().replace(limit, limit.replace(">", ">=")))
    content = json.loads(written(tmp_path, models, tmp_path / "out").read_text())
    entry = {"block": "FB_Gradient_boosting", "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    assert content["proofs"][0]["verdict"] == "refuted"
    check_certificate = mutants.check_certificate
    with pytest.raises(check_certificate.Reject, match="not decided"):
        check_certificate.Check(check_certificate.read_model(models / "gradient_boosting.skops"), out, entry)


def test_a_constant_model_is_confirmed(tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    rows = np.arange(12.0).reshape(6, 2)
    model = HistGradientBoostingRegressor(max_iter=2).fit(rows, np.full(6, 0.3))
    skops.io.dump(model, models / "constant.skops")
    generate(load(models), "iec", tmp_path / "out")
    result = check(written(tmp_path, models, tmp_path / "out"), models, tmp_path / "out")
    assert result.returncode == 0, result.stdout


#: Classifiers of trees, whose label is the largest of several sums, or one sum above zero.
CLASSIFIERS = {
    "tree": DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, THREE),
    "forest": RandomForestClassifier(3, max_depth=3, max_features=1, random_state=1).fit(np.round(X), THREE),
    "many": ExtraTreesClassifier(2, max_depth=5, random_state=0).fit(X, np.arange(len(X)) % 26),
    "two": HistGradientBoostingClassifier(max_iter=2, random_state=0).fit(X, TWO),
    "three": HistGradientBoostingClassifier(max_iter=1, random_state=0).fit(X, THREE),
}


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.AUTO])
def test_labels_of_classifiers_are_confirmed(layout, tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    for name, model in CLASSIFIERS.items():
        skops.io.dump(model, models / f"{name}.skops")
    (models / "st-codegen.toml").write_text('[[model]]\nfile = "tree.skops"\noutputs = [{name = "nState"}]\n')
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=layout))
    path = written(tmp_path, models, tmp_path / "out")
    assert {tuple(entry["outputs"]) for entry in json.loads(path.read_text())["proofs"]} == {("nClass",), ("nState",)}
    result = check(path, models, tmp_path / "out")
    assert result.returncode == 0, result.stdout


CHANGED_LABELS = [
    ("forest", r"(\] )>( fLargest)", r"\1>=\2"),
    ("forest", "nBest := nColumn", "nBest := 2"),
    ("forest", "FOR nColumn := 1 TO 2 DO\n    IF", "FOR nColumn := 1 TO 1 DO\n    IF"),
    ("forest", r"TRUNC\(aStep2\[0\]\)", "TRUNC(aStep1[0])"),
    ("two", "> CUT_2", ">= CUT_2"),
    ("two", r"aStep2\[0\] := 1.0", "aStep2[0] := 0.0"),
]


@pytest.mark.parametrize(("name", "pattern", "change"), CHANGED_LABELS)
def test_a_label_that_was_changed_is_rejected(name, pattern, change, tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    skops.io.dump(CLASSIFIERS[name], models / f"{name}.skops")
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=Layout.TREES))
    check_certificate = mutants.check_certificate
    model = check_certificate.read_model(models / f"{name}.skops")
    (text,) = tmp_path.rglob(f"FB_{name.capitalize()}.st")
    entry = {"block": text.stem, "outputs": ["nClass"], "inputs": [f"f{n}" for n in range(model.features)]}
    check_certificate.Check(model, text.parent, entry)
    change_once(text, pattern, change)
    with pytest.raises(check_certificate.Reject):
        check_certificate.Check(model, text.parent, entry)


#: What stands behind the outputs where these have plausible ranges, and changes of it.
JUDGED = r"IF fOut < PLAUSIBLE_LOWER_1 OR fOut > PLAUSIBLE_UPPER_1 THEN"
JUDGED_CHANGES = {
    "nothing": ("bPlausible := bUsable;", "bPlausible := bUsable;"),
    "reads an input, which may be NaN": (JUDGED, "IF fInput_X < PLAUSIBLE_LOWER_1 THEN"),
    "computes": (JUDGED, "IF fOut * 2.0 < PLAUSIBLE_LOWER_1 THEN"),
    "changes an output": (r"    bPlausible := FALSE;", "    fOut := 0.0;"),
    "changes bValid": (r"    bPlausible := FALSE;", "    bValid := FALSE;"),
    "and an output beside it": (r"    bPlausible := FALSE;", "    bPlausible := FALSE;\n    fOut := 0.0;"),
}


@pytest.mark.parametrize("name", JUDGED_CHANGES)
def test_plausible_ranges_of_outputs_are_no_reason_to_reject(name, tmp_path):
    """The example of the first block was proved, and the checker called its certificate rejected."""
    models = folder_of(tmp_path, ["decision_tree.skops"])
    (models / "st-codegen.toml").write_text(
        '[names]\ninput = "fInput_{feature}"\n[[model]]\nfile = "decision_tree.skops"\n'
        'outputs = [{name = "fOut", min = -1.0, max = 1.0}]\n'
    )
    generate(load(models), "iec", tmp_path / "out")
    (text,) = tmp_path.rglob("FB_Decision_tree.st")
    pattern, change = JUDGED_CHANGES[name]
    first = re.search(r"\bfInput_\w+", text.read_text())[0]
    change_once(text, pattern, change.replace("fInput_X", first))
    check_certificate = mutants.check_certificate
    model = check_certificate.read_model(models / "decision_tree.skops")
    inputs = [f"f{number}" for number in range(model.features)]
    entry = {"block": text.stem, "outputs": ["fOut"], "inputs": inputs}
    if name == "nothing":
        check_certificate.Check(model, text.parent, entry)
    else:
        with pytest.raises(check_certificate.Reject):
            check_certificate.Check(model, text.parent, entry)


#: Statements behind the trees that fail for few inputs only, and what is declared for them.
FAILING = {
    "an index that two inputs drive out, one of them low": (
        "nA : DINT; nB : DINT; fDead : LREAL;",
        "nA := 0;\nIF aInput[0] > 700.0 THEN nA := 2; END_IF;\nnB := 2;\nIF aInput[1] > 700.0 THEN nB := 0; END_IF;\n"
        "fDead := DEAD[nA + nB];\n",
    ),
    "an index that two inputs drive out behind a refused one": (
        "nA : DINT; nB : DINT; fDead : LREAL;",
        "nA := 0;\nIF aInput[0] > 700.0 THEN nA := 2; END_IF;\nnB := 0;\nIF aInput[1] > 700.0 THEN nB := 2; END_IF;\n"
        "IF NOT bUsable THEN\nfDead := DEAD[nA + nB];\nEND_IF;\n",
    ),
}


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.RANKED, Layout.TABLE])
@pytest.mark.parametrize("name", FAILING)
def test_a_statement_that_fails_for_a_few_inputs_is_rejected(name, layout, tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops"])
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=layout))
    (text,) = tmp_path.rglob("FB_Random_forest.st")
    variables, statements = FAILING[name]
    changed = text.read_text().replace("\nVAR\n", f"\nVAR\n{variables}\n", 1)
    dead = "DEAD : ARRAY[0..3] OF LREAL := [1.0, 2.0, 3.0, 4.0];"
    changed = changed.replace("\nVAR CONSTANT\n", f"\nVAR CONSTANT\n{dead}\n", 1)
    changed = changed.replace("bValid := bUsable;", f"{statements}bValid := bUsable;")
    text.write_text(changed)
    check_certificate = mutants.check_certificate
    model = check_certificate.read_model(models / "random_forest.skops")
    entry = {"block": text.stem, "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    with pytest.raises(check_certificate.Reject):
        check_certificate.Check(model, text.parent, entry)
    text.write_text(changed.replace("nA + nB", "nA"))
    check_certificate.Check(model, text.parent, entry)


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.RANKED])
@pytest.mark.parametrize("condition", ["abMissing[2]", "NOT abMissing[2]", "abMissing[2] AND NOT abMissing[2]"])
def test_a_missing_value_of_an_input_that_no_tree_reads_changes_nothing(condition, layout, tmp_path):
    models = folder_of(tmp_path, ["decision_tree.skops"])
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=layout))
    (text,) = tmp_path.rglob("FB_Decision_tree.st")
    node = "nNode" if layout is Layout.TREES else "nNode1"
    change_once(text, r"(\n *fX := (?:THRESHOLD|LEAF)_\d\[)", rf"\nIF {condition} THEN {node} := 0; END_IF;\1")
    check_certificate = mutants.check_certificate
    model = check_certificate.read_model(models / "decision_tree.skops")
    assert not any(2 in tree[0] for tree in model.trees)
    entry = {"block": text.stem, "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    with pytest.raises(check_certificate.Reject):
        check_certificate.Check(model, text.parent, entry)


END = "bValid := bUsable;\n"
#: Pairs of a pattern in the text of a table and what stands in its place; each means something else to some compiler.
TYPES = {
    "two assignments in one": (END, "fX := fOut1 := 9.0;\n" + END),
    "an end of a loop that changes in a list": (
        "FOR nColumn := 0 TO 2 DO\n",
        "anRank1[0] := 2;\nFOR nColumn := 0 TO anRank1[0] DO\nanRank1[0] := 1;\n",
    ),
    "a whole number as an input": ("fF0 : LREAL", "fF0 : DINT"),
    "a real number that becomes whole": ("aInput[0] := fF0;", "aInput[0] := DINT_TO_LREAL(fF0);"),
    "a literal of a type that is too small": (END, "nRank := SINT#16#FF;\n" + END),
    "a comparison without signs": (
        ("\nVAR CONSTANT\n", "\nVAR CONSTANT\nMASK : DWORD := 3;\n"),
        (END, "nRank := -1;\nIF nRank > MASK THEN\nnRank := 0;\nEND_IF;\n" + END),
    ),
    "a variable without signs": ("\nVAR\n", "\nVAR\ndwMore : DWORD;\n"),
}


@pytest.mark.parametrize("name", TYPES)
def test_a_text_whose_types_change_its_meaning_is_rejected(name, tmp_path):
    text = (GOLDEN / "generated" / "iec" / "FB_Random_forest.st").read_text()
    changes = TYPES[name] if isinstance(TYPES[name][0], tuple) else [TYPES[name]]
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "FB_Random_forest.st").write_text(text)
    check_certificate = mutants.check_certificate
    model = check_certificate.read_model(GOLDEN / "models" / "random_forest.skops")
    entry = {"block": "FB_Random_forest", "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    with pytest.raises(check_certificate.Reject):
        check_certificate.Check(model, tmp_path, entry)


def test_a_variable_with_the_name_of_the_test_for_nan_is_rejected(tmp_path):
    for path in (GOLDEN / "generated" / "twincat").rglob("*.Tc*"):
        if path.stem in ("FB_Random_forest", "F_IsNan", "U_LrealBits"):
            (tmp_path / path.name).write_text(path.read_text())
    model = mutants.check_certificate.read_model(GOLDEN / "models" / "random_forest.skops")
    entry = {"block": "FB_Random_forest", "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    mutants.check_certificate.Check(model, tmp_path, entry)
    path = tmp_path / "FB_Random_forest.TcPOU"
    text = path.read_text()
    path.write_text(text.replace("\nVAR\n", "\nVAR\n  F_ISNAN : BOOL;\n", 1))
    assert path.read_text() != text
    with pytest.raises(mutants.check_certificate.Reject):
        mutants.check_certificate.Check(model, tmp_path, entry)


#: Statements beside the sum of the trees that stop some controllers and change nothing.
BESIDE = {
    "a product that overflows": "fX := aStep2[0] * 1.0E308 * 1.0E308;",
    "a quotient by what may be zero": "fX := 1.0 / (aStep2[0] - aStep2[0]);",
    "another tree": "fX := fX + LEAF_2[0];",
}


def test_a_sum_beside_the_sum_of_the_trees_is_rejected(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops"])
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=Layout.RANKED))
    check_certificate = mutants.check_certificate
    model, text = check_certificate.read_model(models / "random_forest.skops"), tmp_path / "out/iec/FB_Random_forest.st"
    entry = {"block": text.stem, "outputs": ["fOut1"], "inputs": ["f0", "f1", "f2"]}
    check_certificate.Check(model, text.parent, entry)
    before, original = "aStep2[0] := aStep2[0] / DIVISOR_2;\n", text.read_text()
    assert original.count(before) == 1
    for statement in BESIDE.values():
        text.write_text(original.replace(before, f"{before}{statement}\n"))
        with pytest.raises(check_certificate.Reject, match="a sum beside the model's"):
            check_certificate.Check(model, text.parent, entry)


SETTINGS = """
[project]
prefix = "P1_"
[[input]]
feature = "f0"
name = "fSpeed"
min = 500.0
max = 900.0
[[input]]
feature = "f1"
name = "fTorque"
min = -1.0
max = 1.0
outside = "flag"
"""


def test_files_with_the_numbers_of_a_model_are_held_to_their_hashes(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops"])
    generate(load(models), "iec", tmp_path / "out")
    path, data = written(tmp_path, models, tmp_path / "out"), models / "weights.data"
    content = json.loads(path.read_text())
    content["models"][data.name] = hashlib.sha256(b"1").hexdigest()
    path.write_text(json.dumps(content))
    assert "other model files" in check(path, models, tmp_path / "out").stdout  # it is not there
    data.write_bytes(b"2")
    assert "other model files" in check(path, models, tmp_path / "out").stdout
    data.write_bytes(b"1")
    assert check(path, models, tmp_path / "out").returncode == 0


def test_the_limits_of_inputs_are_part_of_what_is_claimed(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops"])
    settings = models / "st-codegen.toml"
    settings.write_text(SETTINGS)
    generate(load(models), "iec", tmp_path / "out")
    path = written(tmp_path, models, tmp_path / "out")
    result = check(path, models, tmp_path / "out")
    assert result.returncode == 0, result.stdout
    settings.write_text(SETTINGS.replace("900.0", "901.0"))
    assert "other model files" in check(path, models, tmp_path / "out").stdout
    content = json.loads(path.read_text())
    content["models"]["st-codegen.toml"] = hashlib.sha256(settings.read_bytes()).hexdigest()
    path.write_text(json.dumps(content))
    result = check(path, models, tmp_path / "out")
    assert (result.returncode, "rejected" in result.stdout) == (1, True)


@pytest.mark.parametrize(
    ("features", "names"),
    [(["a-b", "A_B", "c"], ["fA_b", "fA_B_2", "fC"]), (["f0", "f1", "f2"], ["fF1", "fF2", "fF3"])],
    ids=["features that the language cannot tell apart", "names that count from 1"],
)
def test_inputs_may_have_the_names_that_other_features_suggest(features, names, tmp_path):
    models, out = tmp_path / "models", tmp_path / "generated"
    models.mkdir()
    x = np.random.default_rng(0).normal(size=(60, 3))
    given = lightgbm.Dataset(x, x @ [1.0, -2.0, 0.5], feature_name=features)
    lightgbm.train({"verbose": -1, "num_leaves": 4, "min_data_in_leaf": 5}, given, 3).save_model(models / "te.txt")
    tables = [f'[[input]]\nfeature = "{f}"\nname = "{n}"\n' for f, n in zip(features, names, strict=True)]
    (models / "st-codegen.toml").write_text("".join(tables))
    generate(load(models), "iec", out)
    path = written(tmp_path, models, out)
    assert check(path, models, out).returncode == 0
    text = out / "iec" / "FB_Te.st"
    first, last = re.findall(r"^    (f\w+) : LREAL;", text.read_text(), re.MULTILINE)[0:3:2]
    swapped = re.sub(rf"\b({first}|{last})\b", lambda name: last if name[1] == first else first, text.read_text())
    text.write_text(swapped)
    content = json.loads(path.read_text())
    content["texts"]["iec"]["FB_Te.st"] = hashlib.sha256(text.read_bytes()).hexdigest()
    path.write_text(json.dumps(content))
    assert "inputs in another order" in check(path, models, out).stdout


def test_an_entry_that_was_proved_cannot_be_renamed_to_one_that_is_not_checked(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops", "lightgbm_dart.txt"])
    out = GOLDEN / "generated" / "iec"
    path = written(tmp_path, models, out)
    content = json.loads(path.read_text())
    content["proofs"][0]["verdict"] = "not proved"
    path.write_text(json.dumps(content))
    result = check(path, models, out)
    assert (result.returncode, "another form of entry" in result.stdout) == (1, True)


def test_the_checker_shares_nothing_with_the_package():
    allowed = {"numpy", "model_files", *sys.stdlib_module_names}
    for path in CHECKER.parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert {alias.name.split(".")[0] for alias in node.names} <= allowed
            elif isinstance(node, ast.ImportFrom):
                assert node.module.split(".")[0] in allowed


def test_a_changed_text_and_a_changed_certificate_are_rejected(tmp_path):
    models = folder_of(tmp_path, ["random_forest.skops"])
    out = tmp_path / "out" / "iec"
    shutil.copytree(GOLDEN / "generated" / "iec", out)
    path = written(tmp_path, models, tmp_path / "out")
    content = json.loads(path.read_text())
    changed = {**content, "proofs": [{**content["proofs"][0], "trees": content["proofs"][0]["trees"] + 1}]}
    path.write_text(json.dumps(changed))
    assert "proved in another way" in check(path, models, tmp_path / "out").stdout
    text = out / "FB_Random_forest.st"
    number = re.search(r"EDGE_1_0 : .*\n\s+([0-9.]+)", text.read_text())[1]
    text.write_text(text.read_text().replace(number, repr(float(np.nextafter(float(number), np.inf))), 1))
    path.write_text(json.dumps(content))
    assert "other texts" in check(path, models, tmp_path / "out").stdout
    # with the right hash of the wrong text, too
    digest = hashlib.sha256(text.read_bytes()).hexdigest()
    content["texts"]["iec"]["FB_Random_forest.st"] = digest
    path.write_text(json.dumps(content))
    result = check(path, models, tmp_path / "out")
    assert (result.returncode, "a cell is another number" in result.stdout) == (1, True), result.stdout


def test_mutants_are_rejected_or_equal():
    counts, wrong = mutants.texts(10, seed=1, names=mutants.MODELS[:1])
    assert wrong == []
    verdicts = Counter()
    for (_, verdict), count in counts.items():
        verdicts[verdict] += count
    assert verdicts["rejected"] + verdicts["shown equal"] == 10 and verdicts["rejected"] > 4
    assert mutants.certificates(20, seed=1, names=mutants.MODELS[:1]) == (20, [])


@pytest.mark.slow
def test_a_thousand_mutants_of_each_kind():
    assert mutants.main([]) == 0
