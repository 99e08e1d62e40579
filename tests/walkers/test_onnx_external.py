"""ONNX files whose weights stand in other files: read where they lie beside the model, refused elsewhere."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import onnx
import pytest
from onnx import helper

from st_codegen import generate, load, prove, verify
from st_codegen.emit.output import PROVENANCE
from st_codegen.errors import InputError
from st_codegen.proof.prove.certificate import certificate
from st_codegen.walkers import limits
from st_codegen.walkers.files import load_model
from tests.walkers.onnx_builders import assert_within_bound, constant, graph_model, info, rows

pytestmark = pytest.mark.usefixtures("tried_in_place")


def network(width=8):
    """Two layers."""
    rng = np.random.default_rng(0)
    given = [
        constant("W", rng.normal(size=(3, width))),
        constant("B", rng.normal(size=width)),
        constant("V", np.ones((width, 1))),
    ]
    nodes = [
        helper.make_node("Gemm", ["X", "W", "B"], ["H"]),
        helper.make_node("Tanh", ["H"], ["T"]),
        helper.make_node("MatMul", ["T", "V"], ["Y"]),
    ]
    return graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], given)


def saved(folder, name="m.onnx", width=8, **options):
    folder.mkdir(exist_ok=True)
    options = {"all_tensors_to_one_file": True, "location": f"{name}.data", "size_threshold": 0} | options
    onnx.save_model(network(width), folder / name, save_as_external_data=True, **options)
    return folder / name


def changed(path, name="W", **entries):
    """What a file says of where the numbers of an initializer stand, changed (None: left out)."""
    model = onnx.load(path, load_external_data=False)
    tensor = next(one for one in model.graph.initializer if one.name == name)
    said = {entry.key: entry.value for entry in tensor.external_data} | entries
    tensor.ClearField("external_data")
    for key, value in said.items():
        if value is not None:
            tensor.external_data.add(key=key, value=value)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize("together", [True, False])
def test_weights_in_other_files_are_those_of_the_model(tmp_path, together):
    inside = tmp_path / "inside.onnx"
    inside.write_bytes(network().SerializeToString())
    whole = load_model(inside, "m")
    options = {} if together else {"all_tensors_to_one_file": False, "location": None}
    found = load_model(saved(tmp_path / "models", **options), "m")
    assert found.ir.source.digest == whole.ir.source.digest
    assert_within_bound(found, rows(3))
    x = rows(3)
    assert np.array_equal(found.predict(x), whole.predict(x))
    files = sorted(path.name for path in (tmp_path / "models").iterdir() if path.suffix != ".onnx")
    assert [name for name, _ in found.ir.source.data_files] == files and len(files) == (1 if together else 3)


def test_a_folder_is_compiled_verified_and_certified_with_its_data(tmp_path):
    path = saved(tmp_path / "models")
    bundle, out = load(tmp_path / "models"), tmp_path / "out"
    generate(bundle, "iec", out)
    assert verify(bundle, out, rows=100, jobs=1).passed
    hashes = {name: hashlib.sha256((path.parent / name).read_bytes()).hexdigest() for name in ("m.onnx", "m.onnx.data")}
    manifest = json.loads((out / "iec" / "st-codegen.json").read_text("utf-8"))
    assert manifest[PROVENANCE] == hashes
    assert certificate(bundle, tmp_path / "models", out, prove(bundle, out))["models"] == hashes


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"location": "/etc/hostname"}, "no path inside the folder"),
        ({"location": "../m.onnx.data"}, "no path inside the folder"),
        ({"location": "a/../../m.onnx.data"}, "no path inside the folder"),
        ({"location": "..\\m.onnx.data"}, "no path inside the folder"),
        ({"location": "C:\\m.onnx.data"}, "no path inside the folder"),
        ({"location": "\\m.onnx.data"}, "no path inside the folder"),
        ({"location": ""}, "no path inside the folder"),
        ({"location": None}, "no path inside the folder"),
        ({"location": "m\0.data"}, "no path inside the folder"),
        ({"location": "."}, "which is not there"),
        ({"location": "other.data"}, "which is not there"),
        ({"offset": "-4"}, "the offset of its numbers is '-4'"),
        ({"offset": "1e3"}, "the offset of its numbers is '1e3'"),
        ({"length": "9" * 30}, "the length of its numbers is '999"),
        ({"offset": "1000000"}, "bytes 1000000 to 1000096 of m.onnx.data, which has"),
        ({"offset": "1000000", "length": None}, "bytes 1000000 to 1000000 of m.onnx.data, which has"),
        ({"length": "1000000"}, "to 1000000 of m.onnx.data, which has"),
        ({"length": "92"}, r"its shape \(3, 8\) needs 96 bytes, it has 92"),
        ({"length": "0"}, r"its shape \(3, 8\) needs 96 bytes, it has 0"),
    ],
)
def test_other_data_is_refused_in_one_line(tmp_path, entries, message):
    path = changed(saved(tmp_path / "models"), **entries)
    (tmp_path / "m.onnx.data").write_bytes(bytes(4096))
    with pytest.raises(InputError, match=rf"^m\.onnx: initializer 'W': .*{message}") as caught:
        load_model(path, "m")
    assert "\n" not in str(caught.value)


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    path = saved(tmp_path / "models")
    outside = tmp_path / "outside.data"
    (path.parent / "m.onnx.data").replace(outside)
    (path.parent / "m.onnx.data").symlink_to(outside)
    with pytest.raises(InputError, match="a link that leaves the folder of the model"):
        load_model(path, "m")
    (path.parent / "up").symlink_to(tmp_path)
    with pytest.raises(InputError, match="a link that leaves the folder of the model"):
        load_model(changed(path, location="up/outside.data"), "m")


def test_data_counts_as_bytes_of_the_model_however_often_it_is_named(tmp_path, monkeypatch):
    path = saved(tmp_path / "models", width=2048)
    model = onnx.load(path, load_external_data=False)
    for number in range(4):
        model.graph.initializer.add().CopyFrom(model.graph.initializer[0])
        model.graph.initializer[-1].name = f"again{number}"
    path.write_bytes(model.SerializeToString())
    assert load_model(path, "m").ir.source.data_files
    monkeypatch.setattr(limits._Limit, "size", 65536)
    with pytest.raises(InputError, match="bytes with the weights in other files, at most"):
        load_model(path, "m")
    (path.parent / "m.onnx.data").write_bytes(bytes(70_000))
    with pytest.raises(InputError, match="initializer 'W': 70000 bytes, at most"):
        load_model(path, "m")
