"""Small files that would become large objects: counted and refused before they do, in every format."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.walkers import limits
from st_codegen.walkers.files import load_model
from st_codegen.walkers.limits import DEFAULT_MAX_MODEL_BYTES, most

LIMIT = 2**20
TREE = (
    b"tree\nversion=v4\nnum_class=1\nnum_tree_per_iteration=1\nlabel_index=0\nmax_feature_idx=0\n"
    b"objective=regression\nfeature_names=a\nfeature_infos=[0:1]\n\nTree=0\nnum_leaves=2\nnum_cat=0\n"
)


def members(count):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for number in range(count):
            archive.writestr(zipfile.ZipInfo(str(number)), b"")
    return file.getvalue()


def sized(tag, content):
    """A field of protobuf."""
    length, size = b"", len(content)
    while size > 127:
        length, size = length + bytes([size & 127 | 128]), size >> 7
    return bytes([tag]) + length + bytes([size]) + content


HALF = LIMIT // 2
BOMBS = {
    "numbers.txt": (TREE + b"leaf_value=" + b"0 " * (HALF - 400) + b"\n\nend of trees\n", "numbers in tree 0"),
    "header.txt": (b"tree\n" + b"".join(b"%x=\n" % number for number in range(999)) + b"Tree=0\n", "in the header"),
    "words.txt": (
        b"tree\nmax_feature_idx=200000\nfeature_names=" + b"a " * 200_001 + b"\nTree=0\n",
        "than 100000 feat",
    ),
    "categories.txt": (
        TREE + b"leaf_value=0 1\nsplit_feature=0\nthreshold=0\ndecision_type=2\nleft_child=-1\nright_child=-2\n\n"
        b"end of trees\npandas_categorical:[" + b"[]," * 9999 + b"[]]\n",
        "pandas_categorical: 10001 objects",
    ),
    "objects.json": (b'{"learner":[' + b"{}," * 99_999 + b"{}]}", "objects, at most 4096"),
    "lists.json": (b'{"learner":[' + b"[]," * 99_999 + b"[]]}", "objects, at most 4096"),
    "numbers.json": (b'{"learner":[' + b"0," * 99_999 + b"0]}", "numbers, at most 65536"),
    "lists.ubj": (b"{U\x07learner[" + b"[]" * 99_999 + b"]}", "objects, at most 4096"),
    "objects.ubj": (b"{U\x07learner[" + b"{}" * 99_999 + b"]}", "objects, at most 4096"),
    "nulls.ubj": (b"{U\x07learner[" + b"Z" * 99_999 + b"]}", "numbers in UBJSON"),
    "nodes.onnx": (sized(0x3A, b"\x0a\x00" * 99_999), "objects, at most 4096"),
    "texts.onnx": (sized(0x3A, sized(0x0A, b"\x0a\x00" * 99_999)), "texts, at most 16384"),
    "packed.onnx": (sized(0x3A, sized(0x2A, sized(0x3A, bytes(99_999)))), "numbers, at most 65536"),
    "elements.xml": (b"<MLlib_XML_File>" + b"<a/>" * 99_999 + b"</MLlib_XML_File>", "objects, at most 4096"),
    "attributes.xml": (b"<a>" + b"<a b='' c=''/>" * 3000 + b"</a>", "objects with values"),
    "numbers.xml": (b"<MLlib_XML_File a='" + b"0," * 99_999 + b"0'/>", "numbers, at most 65536"),
    "members.skops": (members(999), "members, at most 256"),
}


@pytest.mark.parametrize("name", list(BOMBS))
def test_what_would_become_large_is_refused_before_it_does(tmp_path, name, monkeypatch):
    content, message = BOMBS[name]
    path = tmp_path / name
    path.write_bytes(content)
    assert len(content) < LIMIT
    for package in {"onnx": ["onnx", "onnxruntime"], "skops": ["skops"]}.get(path.suffix[1:], []):
        pytest.importorskip(package)
    monkeypatch.setattr(limits._Limit, "size", LIMIT)
    with pytest.raises(InputError, match=message) as caught:
        load_model(path, "m")  # imports what it needs
    assert str(caught.value).startswith(name)
    assert "\n" not in str(caught.value)
    tracemalloc.start()
    with pytest.raises(InputError, match=message):
        load_model(path, "m")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * LIMIT


def test_counts_grow_with_the_limit(monkeypatch):
    assert most(256) == DEFAULT_MAX_MODEL_BYTES // 256
    monkeypatch.setattr(limits._Limit, "size", 1024)
    assert most(256) == 4
    assert most(4096) == 1


def test_long_lists_are_read_piece_by_piece(tmp_path):
    from st_codegen.walkers.lightgbm import text

    numbers = " ".join(map(repr, np.random.default_rng(0).normal(size=30_000).tolist())).encode()
    assert len(numbers) > 4 * text._PIECE
    assert list(text._numbers(float, numbers, "x")) == list(map(float, numbers.split()))
    assert b"".join(text._pieces(numbers)) == numbers


def test_messages_are_counted_as_protobuf_makes_them():
    onnx = pytest.importorskip("onnx")
    from st_codegen.walkers.onnx.wire import _Counter
    from tests.walkers.test_onnx_fuzz import SEEDS

    def count(message):
        inside = [value for field, value in message.ListFields() if field.message_type is not None]
        return 1 + sum(
            count(one) for value in inside for one in ([value] if hasattr(value, "DESCRIPTOR") else list(value))
        )

    for data in SEEDS:
        counter = _Counter(data)
        counter.message(0, len(data), onnx.ModelProto.DESCRIPTOR, 0)
        assert counter.messages == count(onnx.ModelProto.FromString(data))


def test_numbers_are_passed_over_in_runs(monkeypatch):
    onnx = pytest.importorskip("onnx")
    from st_codegen.walkers.onnx import wire

    attributes = [onnx.helper.make_attribute("a", [1.5] * 30_000), onnx.helper.make_attribute("b", [-7] * 30_000)]
    data = onnx.ModelProto(graph=onnx.GraphProto(node=[onnx.NodeProto(attribute=attributes)])).SerializeToString()
    steps, read = [], wire._Counter.varint
    monkeypatch.setattr(wire._Counter, "varint", lambda *given: steps.append(1) or read(*given))
    wire.check_messages(data, onnx.ModelProto.DESCRIPTOR)
    assert len(steps) < 30


@pytest.mark.parametrize("data", [b"\x3a\x05", b"\x3b\x3c", b"\x80" * 12, b"\x3a" + b"\xff" * 9 + b"\x01"])
def test_what_is_no_protobuf_is_refused(data):
    onnx = pytest.importorskip("onnx")
    from st_codegen.walkers.onnx.wire import check_messages

    with pytest.raises(InputError, match="not an ONNX model"):
        check_messages(data, onnx.ModelProto.DESCRIPTOR)
