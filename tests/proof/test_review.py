import json
import re
from pathlib import Path

import numpy as np
import pytest
import skops.io
from sklearn.ensemble import HistGradientBoostingRegressor

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError
from st_codegen.project.bundle import load
from st_codegen.proof.review import _operating_points, diff, tried_text
from tests.changes import change_once
from tests.cli.helpers import run


def make(models, out, *targets):
    for target in targets or ("twincat",):
        generate(load(models), TARGETS[target], out)
    return out


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_equal_folders_have_no_difference(lone_folder, tmp_path, target):
    found = diff(make(lone_folder, tmp_path / "a", target), make(lone_folder, tmp_path / "b", target))
    assert not found.changed
    assert found.as_json()["changed"] is False


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_a_changed_leaf_moves_the_output_where_the_leaf_is(lone_folder, lightgbm_text, tmp_path, target):
    old = make(lone_folder, tmp_path / "a", target)
    first = re.search(r"leaf_value=(\S+)", lightgbm_text)
    value = float(first[1])
    changed = repr(value + 0.25)[: len(first[1])].ljust(len(first[1]), "0")  # the file says how long each tree is
    (lone_folder / "te.txt").write_text(lightgbm_text.replace(first[0], f"leaf_value={changed}", 1))
    found = diff(old, make(lone_folder, tmp_path / "b", target))
    (model,) = found.models
    assert found.changed
    assert model.facts == ()
    (output,) = model.outputs
    assert output.largest == pytest.approx(0.25, rel=1e-9)
    assert 0 < output.mean < 0.25
    # the largest change lies in the region of the changed leaf: the old and the new model differ there
    from st_codegen.ir import reference

    point = [[output.where[name] for name in ("speed_rpm", "torque_Nm", "temperature_C")]]
    after = reference.evaluate(load(lone_folder).models[0].ir, point)
    (lone_folder / "te.txt").write_text(lightgbm_text)
    assert after - reference.evaluate(load(lone_folder).models[0].ir, point) == pytest.approx(0.25, rel=1e-9)


def test_names_units_and_plausible_ranges_of_a_block_are_told(lone_folder, tmp_path, capsys):
    """Two inputs whose names were exchanged were "text changed, no output moved": their callers give each the other."""

    def configured(inputs, output):
        named = "".join(f'[[input]]\nfeature = "{f}"\nname = "{n}"\n' for f, n in inputs.items())
        (lone_folder / "st-codegen.toml").write_text(f'{named}[[model]]\nfile = "te.txt"\noutputs = [{output}]\n')
        return lone_folder

    first = configured(
        {"speed_rpm": "fLeft", "torque_Nm": "fRight"}, '{name = "fP", unit = "kW", min = 0.0, max = 3.0}'
    )
    old = make(first, tmp_path / "a")
    second = configured(
        {"speed_rpm": "fRight", "torque_Nm": "fLeft"}, '{name = "fQ", unit = "W", min = 0.0, max = 4.0}'
    )
    assert run("diff", old, make(second, tmp_path / "b"), "-n", 50) == 1
    shown = capsys.readouterr().out
    assert "te: inputs of the block: fLeft, fRight, fTemperature_C -> fRight, fLeft, fTemperature_C\n" in shown
    assert "te: outputs of the block, with what is plausible: fP [kW] 0 .. 3 -> fQ [W] 0 .. 4\n" in shown
    assert "no output moved" not in shown


def test_a_range_of_one_value_is_told_as_it_is_and_not_left(bundle_folder, tmp_path, capsys):
    """It was told as one below to one above it, and points were taken there, at which the block's input is limited."""
    change_once(bundle_folder / "bundle.toml", "max = 35.0", "max = 25.0")
    old = make(bundle_folder, tmp_path / "a")
    change_once(bundle_folder / "bundle.toml", "max = 1800.0", "max = 1700.0")
    assert run("diff", old, make(bundle_folder, tmp_path / "b"), "-n", 50, "--html", tmp_path / "review.html") == 1
    assert "temperature_C [°C] 25 only (configuration, limited)" in capsys.readouterr().out
    (model, *_) = diff(old, tmp_path / "b", rows=50).models
    assert {output.where["temperature_C"] for output in model.outputs} == {25.0}


def test_a_manifest_that_tells_nothing_of_outputs_is_no_change_of_them(lone_folder, tmp_path, capsys):
    """Those of earlier versions: each unit was told as new in a project of which nothing had changed."""
    (lone_folder / "st-codegen.toml").write_text('[[model]]\nfile = "te.txt"\noutputs = [{name = "fP", unit = "kW"}]\n')
    old, new = make(lone_folder, tmp_path / "a"), make(lone_folder, tmp_path / "b")
    manifest = next(Path(old).rglob("st-codegen.json"))
    told = json.loads(manifest.read_text())
    assert told["models"]["te"].pop("ports") == [{"unit": "kW"}]
    manifest.write_text(json.dumps(told))
    assert run("diff", old, new, "-n", 50) == 0, capsys.readouterr().out


def test_features_in_another_order_are_the_same_points(lone_folder, lightgbm_text, tmp_path):
    old = make(lone_folder, tmp_path / "a")
    names, infos = (re.search(rf"{key}=(.*)", lightgbm_text) for key in ("feature_names", "feature_infos"))
    text = lightgbm_text
    for found in (names, infos):
        first, second, third = found[1].split()
        text = text.replace(found[1], f"{second} {first} {third}", 1)

    def exchanged(found):
        split = " ".join({"0": "1", "1": "0"}.get(number, number) for number in found[1].split())
        return f"split_feature={split}"

    (lone_folder / "te.txt").write_text(re.sub(r"split_feature=(.*)", exchanged, text))
    (model,) = diff(old, make(lone_folder, tmp_path / "b"), rows=500).models
    assert model.text_changed
    assert "features" in [change.what for change in model.facts]
    assert [(output.largest, output.moved) for output in model.outputs] == [(0.0, 0.0)]
    assert "at which no input is missing; a larger change may lie elsewhere" in tried_text([model], "twincat")
    assert "Every third point has whole numbers" in tried_text([model], "twincat")  # a share of 1/3 in range 0 .. 1


def test_sizes_models_and_files_before_and_after(lone_folder, lightgbm_text, tmp_path):
    (lone_folder / "gone.txt").write_text(lightgbm_text)
    old = make(lone_folder, tmp_path / "a")
    (lone_folder / "gone.txt").rename(lone_folder / "come.txt")
    trees = lightgbm_text.split("Tree=")
    shorter = "Tree=".join(trees[:-1]) + trees[-1][trees[-1].index("end of trees") :]
    shorter = re.sub(r"tree_sizes=(.*) \d+", r"tree_sizes=\1", shorter)
    (lone_folder / "te.txt").write_text(shorter)
    found = diff(old, make(lone_folder, tmp_path / "b"))
    assert (found.added, found.removed) == (("come",), ("gone",))
    facts = {change.what: (change.before, change.after) for change in found.models[0].facts}
    assert facts["trees"] == (5, 4)
    assert facts["nodes"][0] > facts["nodes"][1]
    assert facts["bytes of tables"][0] > facts["bytes of tables"][1]
    assert found.files == {
        "Models.plcproj": "changed",
        "POUs/FB_Come.TcPOU": "added",
        "POUs/FB_Gone.TcPOU": "removed",
        "POUs/FB_Te.TcPOU": "changed",
    }


def test_labels_are_compared_by_what_they_say(tmp_path):
    pytest.importorskip("sklearn")
    from sklearn.tree import DecisionTreeClassifier

    from st_codegen.cli.diff import _lines
    from st_codegen.project.bundle import Bundle
    from tests.classifiers import THREE, X, loaded

    def made(labels, name, outputs=()):
        model = loaded(DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, labels), outputs)
        generate(Bundle((model,)), "twincat", tmp_path / name)
        return tmp_path / name

    words = np.array(["cold", "good", "hot"])
    old = made(words[THREE], "old")
    # the same decisions under numbers that are another order of the same labels
    (same,) = diff(old, made(np.array(["cold", "good", "hot"])[THREE], "same"), rows=500).models
    assert not same.labels
    renamed = diff(old, made(np.array(["a", "good", "hot"])[THREE], "renamed"), rows=500)
    (model,) = renamed.models
    assert {(change.before, change.after) for change in model.labels} == {("cold", "a")}
    assert [change.what for change in model.facts] == ["labels"]
    # another order of numbers, and probabilities beside the label
    turned = diff(old, made(np.array(["z cold", "good", "hot"])[THREE], "turned"), rows=500)
    assert {change.after for change in turned.models[0].labels} == {"z cold"}
    wider = diff(old, made(words[np.where(X[:, 1] > 0, 2, THREE)], "wider", None), rows=500)
    share = sum(change.share for change in wider.models[0].labels)
    assert 0 < share < 1 and wider.models[0].outputs == ()
    assert any(f"another label at {share:.1%} of 500 points" in line for line in _lines(wider))


def test_labels_of_other_numbers_are_told_beside_how_many_points_have_another_label(tmp_path):
    """Such a model decides as before, and every program that knows its classes by number is wrong."""
    from sklearn.tree import DecisionTreeClassifier

    from st_codegen.cli.diff import _lines, _table
    from tests.classifiers import THREE, X

    def made(labels, name, order=slice(None)):
        model = DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, labels)
        model.tree_.value[:] = model.tree_.value[:, :, order]
        model.classes_ = model.classes_[order]
        generate({"m": model}, "iec", tmp_path / name)
        return tmp_path / name

    words = np.array(["cold", "good", "hot"])
    old = made(words[THREE], "old")
    turned = diff(old, made(words[THREE], "turned", [2, 0, 1]), rows=500)
    (model,) = turned.models
    assert model.renumbered == {"cold": (0, 1), "good": (1, 2), "hot": (2, 0)}
    assert any("classes have other numbers: cold 0 -> 1, good 1 -> 2, hot 2 -> 0; " in line for line in _lines(turned))
    assert "m: no other label at 500 points" in _lines(turned)
    # a class that comes in between moves those behind it
    wider = diff(old, made(np.where(X[:, 1] > 5, "fine", words[THREE]), "wider"), rows=500)
    (model,) = wider.models
    assert model.renumbered == {"good": (1, 2), "hot": (2, 3)}
    assert "no other label" not in " ".join(_lines(wider))
    (output,) = model.outputs
    assert output.moved == pytest.approx(sum(change.share for change in model.labels)) and output.sizes == ("", "")
    assert list(_table([model]).columns[1].cells) == [""]


def test_ranges_and_the_bundle_before_and_after(bundle_folder, tmp_path):
    old = make(bundle_folder, tmp_path / "a")
    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8").replace("max = 35.0", "max = 40.0").replace("81.0", "156.0")
    path.write_text(text, encoding="utf-8")
    found = diff(old, make(bundle_folder, tmp_path / "b"))
    assert [(c.what, c.before, c.after) for c in found.project] == [("reduction ratio", 81.0, 156.0)]
    features = next(change for change in found.models[0].facts if change.what == "features")
    assert (features.before[2]["range"], features.after[2]["range"]) == ([25.0, 35.0], [25.0, 40.0])
    assert found.models[0].rows > 0


def test_what_a_term_and_another_form_of_an_order_do_is_told_by_order(bundle_folder, tmp_path, capsys):
    """No model changed, and nothing said by how much the harmonics did."""
    old = make(bundle_folder, tmp_path / "a")
    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8")
    form = 'amplitude = "a.txt"\nphase = "b.txt"'
    assert text.count(form) == 1
    text = text.replace(form, 'cosine = "a.txt"\nsine = "b.txt"').replace("max = 35.0", "max = 45.0")
    term = '[[term]]\ndirection = "backward"\norder = 0\namplitude = "b.txt"\n'
    path.write_text(f"{text}\n{term}", encoding="utf-8")
    new = make(bundle_folder, tmp_path / "b")
    (block,) = diff(old, new, rows=300).around
    assert (block.name, block.rows, block.rows_lost) == ("FB_TEPredict", 300, 0)
    found = {output.output: output for output in block.outputs}
    assert sorted(found) == ["order 0 backward", "order 1 forward"]
    model = next(one for one in load(bundle_folder).models if one.ir.name == "b")
    for part, of in {
        "order 0 backward": abs,
        "order 1 forward": lambda value: abs(value * np.exp(1j * value) - (value + 1j * value)),
    }.items():
        where = found[part].where
        assert where["temperature_C"] <= 35.0  # of the ranges what both have
        assert found[part].largest == pytest.approx(of(model.predict(np.array([list(where.values())]))[0, 0]))
        assert 0 < found[part].mean <= found[part].largest
    capsys.readouterr()
    assert run("diff", old, new, "-n", 50, "--markdown", tmp_path / "r.md") == 1
    assert "FB_TEPredict[order 0 backward]" in capsys.readouterr().err
    assert "2 harmonics changed." in (tmp_path / "r.md").read_text()
    path.write_text(text.replace("min = 25.0", "min = 40.0"), encoding="utf-8")
    assert run("diff", old, make(bundle_folder, tmp_path / "c"), "-n", 50) == 1
    shown = capsys.readouterr().out
    assert "FB_TEPredict: other inputs or no range in common: its numbers were not compared\n" in shown
    assert "FB_TEPredict: text changed" not in shown


def test_points_that_lose_their_answer_are_counted(lone_folder, tmp_path):
    old = make(lone_folder, tmp_path / "a")
    new = make(lone_folder, tmp_path / "b")
    path = new / "twincat" / "POUs" / "FB_Te.TcPOU"
    path.write_text(
        path.read_text(encoding="utf-8").replace("bUsable := TRUE;", "bUsable := fSpeed_rpm < 900.0;"), encoding="utf-8"
    )
    found = diff(old, new)
    (model,) = found.models
    assert 0 < model.rows_lost < model.rows
    assert model.answered == model.rows - model.rows_lost
    assert "the points are those that both texts answer: te." in tried_text([model], "twincat")
    assert found.changed


def test_a_change_in_a_function_that_a_block_calls_is_one_of_its_model(lone_folder, tmp_path):
    old, new = make(lone_folder, tmp_path / "a"), make(lone_folder, tmp_path / "b")
    change_once(new / "twincat/POUs/F_IsNan.TcPOU", "> INFINITY_BITS", ">= 0")
    (model,) = diff(old, new, rows=100).models
    assert not model.text_changed
    assert model.changed and model.outputs[0].largest > 0


def test_categories_are_among_the_points(tmp_path):
    """Between whole numbers there is no category: a change of one alone would not show."""
    random = np.random.default_rng(0)
    x = np.column_stack([random.integers(0, 9, 500), random.random(500)])
    folders = []
    for name, odd in (("a", 3), ("b", 4)):
        fitted = HistGradientBoostingRegressor(categorical_features=[0], max_iter=3).fit(x, x[:, 0] == odd)
        (tmp_path / name).mkdir()
        skops.io.dump(fitted, tmp_path / name / "te.skops")
        folders.append(make(tmp_path / name, tmp_path / f"{name}.out"))
    (output,) = diff(*folders, rows=500).models[0].outputs
    assert output.where["f0"] in (3.0, 4.0)


def test_folders_without_generated_files_or_common_targets_are_named(lone_folder, tmp_path):
    old = make(lone_folder, tmp_path / "a", "twincat")
    with pytest.raises(GeneratedCodeError, match="none in common"):
        diff(old, make(lone_folder, tmp_path / "b", "iec"))
    with pytest.raises(GeneratedCodeError, match="no generated files"):
        diff(old, tmp_path / "nothing")


def test_every_category_of_a_range_is_tried():
    """A change at the highest one, or of one of two, was "no output moved"."""
    facts = {"features": [{"name": n, "range": r} for n, r in (("a", (0, 1)), ("b", (0, 3)), ("c", (0.2, 0.8)))]}
    points = _operating_points(facts, facts, 600, 0)
    for column, whole in ((0, {0.0, 1.0}), (1, {0.0, 1.0, 2.0, 3.0})):
        values = points[:, column]
        assert {x for x in values.tolist() if x == int(x)} == whole and 350 < np.sum(values % 1.0 != 0.0) < 450
    assert points[:, 2].min() > 0.2 and points[:, 2].max() < 0.8 and np.all(points[:, 2] % 1.0 != 0.0)
