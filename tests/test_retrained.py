"""A model that is trained and saved again, from equal data and from other data, into the same generated folder."""

import pickle
import re

import numpy as np
import pytest

from st_codegen.driver import check, generate
from st_codegen.emit import output
from st_codegen.ir import digest
from st_codegen.project.bundle import load

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
    assert list(check(again, "twincat", out)) == []
    assert bool(list(check(again, "twincat", out, provenance=True))) == (path.read_bytes() != first)


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
