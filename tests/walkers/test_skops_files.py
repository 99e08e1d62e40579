"""`.skops` files from strangers: nothing of them reaches a native parser, or memory without limits, unchecked."""

import io
import json
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from st_codegen.errors import InputError, UntrustedFileError
from st_codegen.walkers import limits, skops_file
from st_codegen.walkers.files import load_model
from tests.cli.helpers import run

pytestmark = pytest.mark.thorough

skops = pytest.importorskip("skops.io")
lightgbm = pytest.importorskip("lightgbm")
xgboost = pytest.importorskip("xgboost")
base = pytest.importorskip("sklearn.base")
pipeline = pytest.importorskip("sklearn.pipeline")
preprocessing = pytest.importorskip("sklearn.preprocessing")
linear_model = pytest.importorskip("sklearn.linear_model")

ROOT = Path(__file__).parents[2]


def _estimators():
    light = lightgbm.LGBMRegressor(n_estimators=3, num_leaves=5, verbose=-1, n_jobs=1)
    extreme = xgboost.XGBRegressor(n_estimators=3, max_depth=2, n_jobs=1)
    return {
        "lightgbm": light,
        "xgboost": extreme,
        "lightgbm_pipeline": pipeline.make_pipeline(preprocessing.StandardScaler(), base.clone(light)),
        "xgboost_pipeline": pipeline.make_pipeline(preprocessing.StandardScaler(), base.clone(extreme)),
    }


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A file and the fitted estimator for each name of `_estimators`."""
    folder = tmp_path_factory.mktemp("skops")
    x = np.random.default_rng(0).normal(size=(200, 3))
    result = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, estimator in _estimators().items():
            skops.dump(estimator.fit(x, x[:, 0] + x[:, 1] ** 2), folder / f"{name}.skops")
            result[name] = (folder / f"{name}.skops", estimator)
    return result


@pytest.fixture
def linear(tmp_path):
    path = tmp_path / "m.skops"
    skops.dump(linear_model.LinearRegression().fit(np.eye(3), [1.0, 2.0, 3.0]), path)
    return path


def _rewrite(path, change=None, more=(), compression=zipfile.ZIP_DEFLATED):
    """The archive again, with `change` applied to the schema and more members."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    schema = json.loads(members["schema.json"])
    if change is not None:
        schema = change(schema) or schema
    members["schema.json"] = json.dumps(schema).encode()
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in (members | dict(more)).items():
            archive.writestr(name, data)
    return path


def _booster(value):
    """The node of the Booster in a schema."""
    if isinstance(value, dict):
        if value.get("__class__") == "Booster":
            return value
        value = list(value.values())
    found = [_booster(entry) for entry in value] if isinstance(value, list) else []
    return next((one for one in found if one), None)


@pytest.mark.parametrize("name", list(_estimators()))
@pytest.mark.filterwarnings("ignore")
def test_a_model_read_by_our_readers_first_predicts_as_the_estimator(trained, name):
    path, estimator = trained[name]
    x = np.random.default_rng(1).normal(size=(50, 3))
    assert np.array_equal(load_model(path, "m").predict(x)[:, 0], estimator.predict(x))


def test_damaged_copies_are_refused_or_read_and_end_no_process(trained):
    count, files = 10, [str(path) for path, _ in trained.values()]
    program = [sys.executable, "-W", "ignore", "-m", "tests.walkers.mutants", str(count), "15", *files]
    ended = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=True)
    outcomes = json.loads(ended.stdout)
    assert outcomes.keys() == trained.keys()
    for name, found in outcomes.items():
        assert set(found) == {"refused", "accepted"}, (name, found, ended.stderr[-3000:])
        assert sum(found.values()) == count


def test_lightgbm_text_that_ends_the_process_is_refused_before_the_library_sees_it(trained, tmp_path, monkeypatch):
    monkeypatch.setattr(lightgbm.Booster, "__init__", lambda *_, **__: pytest.fail("the library saw the text"))
    monkeypatch.setattr(lightgbm.Booster, "__setstate__", lambda *_: pytest.fail("the library saw the text"))
    path = tmp_path / "m.skops"
    path.write_bytes(trained["lightgbm"][0].read_bytes())

    def change(schema):
        node = _booster(schema)["content"]["content"]["_handle"]
        node["content"] = node["content"].replace("objective=regression", "objective=")

    with pytest.raises(InputError, match=r"^m\.skops: Booster: objective: empty"):
        load_model(_rewrite(path, change), "m")


def test_xgboost_bytes_that_are_no_model_are_refused_before_the_library_sees_them(trained, tmp_path, monkeypatch):
    monkeypatch.setattr(xgboost.Booster, "__init__", lambda *_, **__: pytest.fail("the library saw the bytes"))
    monkeypatch.setattr(xgboost.Booster, "__setstate__", lambda *_: pytest.fail("the library saw the bytes"))
    path = tmp_path / "m.skops"
    path.write_bytes(trained["xgboost"][0].read_bytes())
    with zipfile.ZipFile(path) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".bin"))
        data = archive.read(name).replace(b"left_children", b"left_childrem", 1)
    with pytest.raises(InputError, match=r"^m\.skops: Booster: .*left_children: missing"):
        load_model(_rewrite(path, more={name: data}), "m")


def test_a_booster_that_is_made_by_a_call_is_refused(trained, tmp_path):
    path = tmp_path / "m.skops"
    path.write_bytes(trained["lightgbm"][0].read_bytes())

    def change(schema):
        _booster(schema)["__loader__"] = "ConstructorFromReduceNode"

    with pytest.raises(UntrustedFileError, match="ConstructorFromReduceNode"):
        load_model(_rewrite(path, change), "m")


def test_a_member_that_unpacks_to_more_than_allowed_is_refused_unopened(linear, monkeypatch):
    _rewrite(linear, more={"bomb.npy": bytes(5_000_000)})
    assert linear.stat().st_size < 50_000
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_, **__: pytest.fail("opened"))
    monkeypatch.setattr(limits._Limit, "size", 1_000_000)
    with pytest.raises(InputError, match=r"^m\.skops: 50\d+ bytes unpacked, at most"):
        load_model(linear, "m")


def test_one_member_named_by_many_nodes_counts_each_time(linear, monkeypatch):
    def change(schema):
        array = schema["content"]["content"]["coef_"]
        schema["content"]["content"]["singular_"] = {
            "__class__": "list",
            "__module__": "builtins",
            "__loader__": "ListNode",
            "content": [array] * 1000,
        }

    _rewrite(linear, change)
    load_model(linear, "m")
    monkeypatch.setattr(limits._Limit, "size", 130_000)
    with pytest.raises(InputError, match="bytes unpacked"):
        load_model(linear, "m")


def test_the_declared_size_is_all_that_is_unpacked(linear):
    packed = bytearray(_rewrite(linear, more={"x.npy": bytes(5_000_000)}).read_bytes())
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        size = archive.getinfo("x.npy").file_size.to_bytes(4, "little")
    linear.write_bytes(bytes(packed).replace(size, (100).to_bytes(4, "little")))
    with zipfile.ZipFile(linear) as archive:
        assert archive.getinfo("x.npy").file_size == 100
        with pytest.raises((zipfile.BadZipFile, InputError)):
            skops_file._unpacked(archive, archive.getinfo("x.npy"))


def test_arrays_that_declare_more_than_they_hold_are_refused(linear):
    with zipfile.ZipFile(linear) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".npy"))
        data = archive.read(name)
    changed = data.replace(b"(3,), }        ", b"(3000000000,),}")
    assert changed != data
    with pytest.raises(InputError, match="does not fill its member"):
        load_model(_rewrite(linear, more={name: changed}), "m")


def test_depth_is_limited(linear, monkeypatch):
    monkeypatch.setattr(skops_file, "MAX_DEPTH", 3)
    with pytest.raises(InputError, match="nested more than 3 deep"):
        load_model(linear, "m")


def test_identities_do_not_make_a_small_file_a_large_tree(linear):
    """Each list mentions the one before twice: 2**60 visits, were mentions followed."""

    def change(schema):
        node = {"__class__": "list", "__module__": "builtins", "__loader__": "ListNode", "content": [], "__id__": 1}
        for number in range(2, 62):
            content = [node, {"__class__": "list", "__module__": "builtins", "__loader__": "ListNode"}]
            content[1]["__id__"] = number - 1
            node = {**node, "content": content, "__id__": number}
        schema["content"]["content"]["singular_"] = node

    with pytest.raises(InputError, match="not a readable"):
        load_model(_rewrite(linear, change), "m")


def test_the_limit_holds_for_files_of_every_kind_and_is_an_option(tmp_path, capsys, monkeypatch):
    (tmp_path / "m.txt").write_bytes(b"tree\n" * 100)
    monkeypatch.setattr(limits._Limit, "size", 1)  # the option changes it
    code = run("generate", tmp_path, "--max-model-bytes", "499", "-o", tmp_path / "out")
    assert code == 2
    assert "m.txt: 500 bytes, at most 499 are read" in " ".join(capsys.readouterr().err.split())


def test_a_tuned_threshold_is_read_with_what_scored_it(tmp_path):
    search = pytest.importorskip("sklearn.model_selection")
    x = np.random.default_rng(0).normal(size=(40, 2))
    tuned = search.TunedThresholdClassifierCV(linear_model.LogisticRegression(), cv=2).fit(x, x[:, 0] > 0)
    skops.dump(tuned, tmp_path / "m.skops")
    model = load_model(tmp_path / "m.skops", "m")
    assert np.array_equal(model.predict(x)[:, 0], tuned.predict(x))
