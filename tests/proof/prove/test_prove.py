"""The proof for all inputs: golden projects in every dialect and layout, and texts that were changed by hand."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from st_codegen.cli.main import main
from st_codegen.driver import generate
from st_codegen.ir import TreeEnsemble
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.prove.axis import InputAxis, to_keys
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.tree_proof import SUMS, TAIL
from tests.changes import change_once

GOLDEN = Path(__file__).resolve().parents[3] / "golden"


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_golden_models_are_proved(target):
    report = prove(load(GOLDEN / "lone" / "models"), GOLDEN / "lone" / "generated" / target)
    for result in report.results:
        assert result.verdict is Verdict.PROVED, result


#: Golden models of trees with an exponential behind their sum, or with linear models in their leaves.
LINKED = {"xgboost_poisson", "lightgbm_linear"}


@pytest.mark.thorough
@pytest.mark.parametrize("ranks", [True, False])
def test_trees_are_proved_tree_by_tree(ranks, tmp_path):
    bundle = load(GOLDEN / "lone" / "models")
    trees = [model for model in bundle.models if any(isinstance(op, TreeEnsemble) for op in model.ir.ops)]
    bundle = Bundle(tuple(trees))
    generate(bundle, "iec", tmp_path, options=Options(layout=Layout.RANKED if ranks else Layout.TREES))
    results = prove(bundle, tmp_path).results
    assert len(results) == len(trees) > 20
    for result in results:
        method = TAIL if result.model in LINKED else SUMS
        assert (result.verdict, result.method) == (Verdict.PROVED, method), result


def test_tables_that_models_share_are_proved():
    report = prove(load(GOLDEN / "bundle" / "models"), GOLDEN / "bundle" / "generated" / "iec")
    assert {result.verdict for result in report.results} == {Verdict.PROVED}


def copied(tmp_path, name="random_forest"):
    folder = tmp_path / "out" / "iec"
    shutil.copytree(GOLDEN / "lone" / "generated" / "iec", folder)
    models = tmp_path / "models"
    models.mkdir()
    source = next((GOLDEN / "lone" / "models").glob(f"{name}.*"))
    shutil.copy(source, models)
    return models, folder / f"FB_{name.capitalize()}.st"


def test_a_constant_changed_by_hand_is_refuted_with_an_input(tmp_path, capsys):
    models, text = copied(tmp_path)
    number = re.search(r"EDGE_1_0 : .*\n\s+([0-9.]+)", text.read_text())[1]
    changed = float(np.nextafter(float(number), np.inf))
    text.write_text(text.read_text().replace(number, repr(changed), 1))
    with pytest.raises(SystemExit) as end:
        main(["prove", str(models), "--generated", str(tmp_path / "out"), "--quiet"])
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert "refuted" in said
    # the only number that the two thresholds tell apart
    assert repr(changed) in said


def test_a_tree_of_linear_models_is_no_constant_where_its_plain_values_are_all_the_same(tmp_path):
    """It counted as that number: its own text was not proved, and a text that adds the number was."""
    (tmp_path / "models").mkdir()
    head, first, second, *others = (GOLDEN / "lone" / "models" / "lightgbm_linear.txt").read_text().split("Tree=")
    head = re.sub("tree_sizes=.*\n", "", head)
    second = re.sub("leaf_value=.*", "leaf_value=" + " ".join(["0.5"] * 6), second)
    (tmp_path / "models" / "m.txt").write_text("Tree=".join([head, first, second, *others]))
    bundle = load(tmp_path / "models")
    generate(bundle, "iec", tmp_path, options=Options(Layout.TREES))
    assert prove(bundle, tmp_path).results[0].verdict is Verdict.PROVED
    number = "IF nTree = 1 THEN fX := 0.5; END_IF;\n"
    change_once(tmp_path / "iec" / "FB_M.st", r"aStep1\[0\] := aStep1\[0\] \+ fX;", number + r"\g<0>")
    assert prove(bundle, tmp_path).results[0].verdict is Verdict.REFUTED


def test_an_unknown_statement_is_never_proved(tmp_path):
    models, text = copied(tmp_path)
    text.write_text(text.read_text().replace("bValid := bUsable;", "bValid := bUsable;\nWHILE FALSE DO\n;\nEND_WHILE;"))
    (result,) = prove(load(models), tmp_path / "out").results
    assert result.verdict is Verdict.NOT_PROVED
    assert "While" in result.reason


def test_a_bound_that_is_missing_has_its_reason(tmp_path, capsys):
    models, _ = copied(tmp_path, "svr")
    with pytest.raises(SystemExit) as end:
        main(["prove", str(models), "-g", str(tmp_path / "out")])
    assert end.value.code == 0
    assert "no range known" in capsys.readouterr().err


def test_the_command_proves_and_writes_the_same_certificate_twice(tmp_path, capsys):
    models, _ = copied(tmp_path)
    contents = []
    for name in ("one.json", "two.json"):
        with pytest.raises(SystemExit) as end:
            main(["prove", str(models), "-g", str(tmp_path / "out"), "--certificate", str(tmp_path / name)])
        assert end.value.code == 0
        contents.append((tmp_path / name).read_bytes())
        table = capsys.readouterr().err
        assert "proved" in table and "[" not in table
    assert contents[0] == contents[1]


def test_the_numbers_that_a_model_takes_fill_lanes_of_their_own():
    first, last = to_keys(np.array([-2.0, 3.0])).tolist()
    axis = InputAxis(0, first, last)
    assert {-2.0, np.nextafter(3.0, np.inf)} <= set(axis.low)
    assert {np.nextafter(-2.0, -np.inf), 3.0} <= set(axis.high)


@pytest.mark.parametrize("name", ["torch_gru", "keras_lstm", "torch_lstm_both_ways", "torch_rnn"])
def test_recurrent_layers_are_followed(name, tmp_path):
    pytest.importorskip("onnx")
    shutil.copy(GOLDEN.parent / "tests" / "walkers" / "data" / "networks" / f"{name}.onnx", tmp_path)
    bundle = load(tmp_path)
    generate(bundle, "iec", tmp_path / "out")
    (result,) = prove(bundle, tmp_path / "out").results
    assert result.verdict is Verdict.PROVED, result
