"""What verify did not compare is said, on the console and on the page."""

import pytest

from st_codegen.driver import generate
from st_codegen.project.bundle import load
from tests.cli.helpers import run

RANGE = '[[input]]\nfeature = "f{}"\nmin = {}\nmax = {}\n'


@pytest.fixture
def reciprocal(tmp_path):
    """One divided by a difference of numbers so large that it may be rounding only."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper

    graph = helper.make_graph(
        [helper.make_node("MatMul", ["x", "w"], ["z"]), helper.make_node("Div", ["one", "z"], ["y"])],
        "g",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, 2])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [None, 1])],
        [
            helper.make_tensor("w", TensorProto.FLOAT, (2, 1), [1.0, -1.1]),
            helper.make_tensor("one", TensorProto.FLOAT, (1,), [1.0]),
        ],
    )
    folder = tmp_path / "models"
    folder.mkdir()
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, folder / "m.onnx")
    ranges = [RANGE.format(0, 1.1e8, 1.1e8 + 1), RANGE.format(1, 1e8, 1e8 + 1)]
    (folder / "st-codegen.toml").write_text("".join(ranges))
    generate(load(folder), "iec", tmp_path / "out")
    return folder


def test_rows_on_which_no_bound_is_known_are_counted(reciprocal, tmp_path, capsys):
    pytest.importorskip("onnxruntime")
    page = tmp_path / "page.html"
    assert run("verify", reciprocal, "--generated", tmp_path / "out", "-n", "300", "--html", page) == 0
    said = capsys.readouterr().err
    assert "of 300 rows no bound is known" in said
    assert "were not judged" in said
    assert "were not judged" in page.read_text(encoding="utf-8")
