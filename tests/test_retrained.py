"""A model that is trained and saved again, from equal data and from other data, into the same generated folder."""

import dataclasses
import difflib
import pickle
import re
import shutil

import numpy as np
import pytest

from st_codegen.driver import differences, generate
from st_codegen.emit import output
from st_codegen.emit.blocks.listing import Listing
from st_codegen.ir import digest
from st_codegen.passes.choose import CallCost, Choices, Layout, Options, PricedLayout, preferred
from st_codegen.passes.pipeline import Location, compile_models
from st_codegen.project.bundle import load
from tests.cli.helpers import run

RANDOM = np.random.default_rng(3)
X = np.round(RANDOM.uniform(0.0, 60.0, (200, 3)), 1)
Y = np.sin(X[:, 0] / 9.0) + 0.1 * X[:, 1]


def skops_forest(folder):
    ensemble, skops = pytest.importorskip("sklearn.ensemble"), pytest.importorskip("skops.io")
    model = ensemble.RandomForestRegressor(5, max_depth=4, random_state=0).fit(X, Y)
    skops.dump(model, folder / "model.skops")
    return model


def skops_pipeline(folder):
    pytest.importorskip("sklearn")
    skops = pytest.importorskip("skops.io")
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    model = make_pipeline(StandardScaler(), MLPRegressor(hidden_layer_sizes=(4,), max_iter=20, random_state=0)).fit(
        X, Y
    )
    skops.dump(model, folder / "model.skops")
    return model


def pickled_forest(folder):
    ensemble = pytest.importorskip("sklearn.ensemble")
    model = ensemble.ExtraTreesRegressor(5, max_depth=4, random_state=0).fit(X, Y)
    (folder / "model.pkl").write_bytes(pickle.dumps(model))
    return model


def lightgbm_text(folder):
    lightgbm = pytest.importorskip("lightgbm")
    model = lightgbm.train({"verbose": -1, "num_leaves": 7, "num_threads": 1, "seed": 1}, lightgbm.Dataset(X, Y), 5)
    model.save_model(folder / "model.txt")
    return model


def xgboost_json(folder):
    xgboost = pytest.importorskip("xgboost")
    model = xgboost.XGBRegressor(n_estimators=5, max_depth=3, random_state=0, n_jobs=1).fit(X, Y)
    model.save_model(folder / "model.json")
    return model


def onnx_file(folder):
    skl2onnx, linear = pytest.importorskip("skl2onnx"), pytest.importorskip("sklearn.linear_model")
    model = linear.Ridge().fit(X, Y)
    graph = skl2onnx.to_onnx(model, X[:1].astype(np.float32), target_opset=17)
    (folder / "model.onnx").write_bytes(graph.SerializeToString())
    return model


FORMATS = (skops_forest, skops_pipeline, pickled_forest, lightgbm_text, xgboost_json, onnx_file)


@pytest.mark.parametrize("train", FORMATS)
@pytest.mark.filterwarnings("ignore")
def test_a_model_trained_again_on_equal_data_is_no_difference(train, tmp_path):
    kept = [train(tmp_path)]  # what lives has its addresses to itself
    (path,) = tmp_path.iterdir()
    first = path.read_bytes()
    out = tmp_path / "out"
    generate(load(path, trust_pickle=True), "twincat", out)
    kept.append(train(tmp_path))
    again = load(path, trust_pickle=True)
    assert list(differences(again, "twincat", out)) == []
    assert bool(list(differences(again, "twincat", out, provenance=True))) == (path.read_bytes() != first)


def test_a_skops_file_that_is_saved_again_has_other_bytes(tmp_path):
    # else the test above tries nothing
    kept = skops_forest(tmp_path)
    first = (tmp_path / "model.skops").read_bytes()
    assert skops_forest(tmp_path) is not kept
    assert (tmp_path / "model.skops").read_bytes() != first


def test_the_digest_is_that_of_the_numbers_not_of_the_file(tmp_path):
    pytest.importorskip("lightgbm")
    lightgbm_text(tmp_path)
    path = tmp_path / "model.txt"
    model = load(path).models[0].ir
    (tmp_path / "other_name.txt").write_bytes(path.read_bytes())
    other = load(tmp_path / "other_name.txt").models[0].ir
    assert digest(other) == digest(model)
    number = re.search(r"leaf_value=(\S+)", path.read_text())[1]
    path.write_text(path.read_text().replace(number, number[:-1] + ("1" if number[-1] != "1" else "2"), 1))
    assert load(path).models[0].ir.source.digest != model.source.digest


def test_the_manifest_names_the_file_by_its_own_hash(tmp_path):
    lightgbm_text(tmp_path)
    folder = generate(load(tmp_path / "model.txt"), "twincat", tmp_path / "out").folder
    manifest = output.read_manifest(folder)
    (block,) = (folder / "POUs").glob("FB_Model.TcPOU")
    assert len(manifest.facts[output.PROVENANCE]["model.txt"]) == 64
    assert manifest.facts["models"]["model"]["digest"] in block.read_text(encoding="utf-8")
    assert manifest.facts[output.PROVENANCE]["model.txt"] not in block.read_text(encoding="utf-8")


def changed_lines(before, after):
    """Lines that are not in both of two generated folders' texts."""
    lines = [
        [line for path in sorted(folder.rglob("*.TcPOU")) for line in path.read_text("utf-8").splitlines()]
        for folder in (before, after)
    ]
    return sum(line[:2] in ("+ ", "- ") for line in difflib.ndiff(*lines))


def grown(rows):
    """A tree of which a table has a few cells more with each row."""
    tree = pytest.importorskip("sklearn.tree")
    x = np.stack(np.meshgrid(np.arange(12.0), np.arange(40.0)), -1).reshape(-1, 2)[:rows]
    return tree.DecisionTreeRegressor(random_state=0).fit(x, x[:, 0] * 40 + x[:, 1])


def test_a_row_more_keeps_the_layout_that_is_in_place(tmp_path):
    joblib = pytest.importorskip("joblib")
    path = tmp_path / "model.joblib"
    joblib.dump(grown(360), path)
    first = generate(load(path, trust_pickle=True), "twincat", tmp_path / "kept")
    size = first.facts["blocks"]["FB_Model"]["data_bytes"]
    assert first.facts["models"]["model"]["layout"] == "table"
    shutil.copytree(tmp_path / "kept", tmp_path / "before")
    joblib.dump(grown(361), path)
    bundle = load(path, trust_pickle=True)
    # a limit that the table meets before the row and not behind it
    limit = Options(table_bytes=8 * 12 * 30)
    kept = generate(bundle, "twincat", tmp_path / "kept", options=limit)
    afresh = generate(bundle, "twincat", tmp_path / "afresh", options=limit)
    assert kept.facts["models"]["model"]["layout"] == "table"
    other = afresh.facts["models"]["model"]["layout"]
    assert other != "table"
    assert size < kept.facts["blocks"]["FB_Model"]["data_bytes"] < 1.25 * size
    few, many = (changed_lines(tmp_path / "before", tmp_path / name) for name in ("kept", "afresh"))
    assert 4 * few < many
    assert not any(decision.change for decision in kept.compiled.decisions)
    again = generate(bundle, "twincat", tmp_path / "kept", options=limit, relayout=True)
    assert again.facts["models"]["model"]["layout"] == other
    assert list(differences(bundle, "twincat", tmp_path / "kept", options=limit)) == []


def test_a_layout_that_is_no_longer_possible_is_replaced_and_announced(tmp_path, capsys):
    joblib = pytest.importorskip("joblib")
    path = tmp_path / "model.joblib"
    joblib.dump(grown(360), path)
    assert run(path, "--trust-pickle", "--out", tmp_path) == 0
    capsys.readouterr()
    assert run(path, "--trust-pickle", "--out", tmp_path, "--table-limit", 1) == 0
    assert re.search(
        r"model: new layout '[\w ]+' for 'table', which these options and limits do not allow", capsys.readouterr().err
    )


def test_a_choice_that_saves_much_is_taken():
    def candidate(layout, time):
        return PricedLayout(layout, None, CallCost(instructions=time))

    old, little, much = candidate("old", 100.0), candidate("little", 71.0), candidate("much", 69.0)
    assert preferred([old, little], "old") is old
    assert preferred([old, little], None) is little
    assert preferred([old, little, much], "old") is much
    assert preferred([little, much], "old") is much


def test_shared_tables_keep_their_block_their_groups_and_their_places(bundle_folder):
    models = [model.ir for model in load(bundle_folder).models]
    more = [dataclasses.replace(model, name=f"a{number}") for number, model in enumerate([models[0]] * 3)]
    options = Options(Layout.TABLE)
    before = compile_models([*models, *more[1:]], options, together=True)
    assert before.shared == {"tables": [["a", "a1", "a2", "b"]]}
    earlier = Choices(before.choices.layouts, {"mine": [["b", "gone", "a"], ["a2"]]})
    after = compile_models([*models, *more], options, together=True, earlier=earlier)
    assert after.shared == {"mine": [["b", "a", "a0", "a1"], ["a2"]]}
    assert after.locations["b"] == Location("mine", (0,))


def test_only_a_loop_of_several_rounds_has_a_variable():
    """A loop of one round is written without it, and compilers warn of variables that nothing uses."""
    listing = Listing(10)
    listing.loop("nRow")
    listing.loop("nRow", 0, 1)
    assert not listing.variables
    listing.loop("nRow", 1, 2)
    assert [(variable.name, variable.type) for variable in listing.variables.values()] == [("nRow", "DINT")]


def test_arrays_are_cut_where_an_earlier_run_cut_them():
    """The tree that no longer fits moves on; arrays behind it begin where they began."""
    before, sizes = Listing(10), [4, 4, 4, 4, 4, 4]
    assert before.chunks(sizes, "tree") == [(0, 2), (2, 4), (4, 6)]
    smaller = [4, 4, 1, 4, 4, 4]
    assert Listing(10).chunks(smaller, "tree") == [(0, 3), (3, 5), (5, 6)]
    assert Listing(10, earlier=tuple(before.cuts)).chunks(smaller, "tree") == [(0, 2), (2, 4), (4, 6)]
    larger = [4, 7, 4, 4, 4, 4]
    assert Listing(10, earlier=tuple(before.cuts)).chunks(larger, "tree") == [(0, 1), (1, 2), (2, 4), (4, 6)]


def test_cuts_stay_in_the_files_until_the_limit_or_the_wish_changes(tmp_path):
    ensemble = pytest.importorskip("sklearn.ensemble")

    def cuts(depth, **wishes):
        model = ensemble.RandomForestRegressor(9, max_depth=depth, random_state=0).fit(X, Y)
        generated = generate(load(model), "twincat", tmp_path, options=Options(Layout.TREES), **wishes)
        (found,) = generated.facts["choices"].get("cuts", {}).get("FB_Model", [()])
        return found

    first = cuts(4, max_array=70)
    assert first
    kept = cuts(3, max_array=70)
    assert set(first) <= set(kept)
    afresh = cuts(3, max_array=70, relayout=True)
    assert not set(first) <= set(afresh)
    assert cuts(4) == ()
