"""What verify did not compare is said, on the console and on the page."""

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.errors import at_most
from st_codegen.passes.choose import CallCost, PricedLayout
from st_codegen.passes.pipeline import LayoutDecision
from st_codegen.project.bundle import load
from st_codegen.proof.prove.blocks import BlockProof, Limit
from st_codegen.proof.verify import verify
from st_codegen.proof.verify_report import ModelReport
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


def test_the_library_is_asked_about_refused_rows_inside_the_range_first(tmp_path):
    skops = pytest.importorskip("skops.io")
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    x = np.linspace(0.1, 10.0, 50)[:, None]
    model = make_pipeline(FunctionTransformer(np.log), LinearRegression()).fit(x, x[:, 0])
    (tmp_path / "models").mkdir()
    skops.dump(model, tmp_path / "models" / "m.skops")
    (tmp_path / "models" / "st-codegen.toml").write_text(RANGE.format(0, 0.0, 10.0))
    generate(load(tmp_path / "models"), "iec", tmp_path / "out")
    (report,) = verify(load(tmp_path / "models"), tmp_path / "out", rows=3000).models
    # 0 and what is smaller than numbers have logarithms are few among the negative numbers outside the range
    assert 0 < report.asked == report.unanswered
    assert "since a number on the way does not exist" in report.not_judged
    assert "the library has no finite answer to them either" in report.not_judged


def test_of_refused_rows_outside_the_range_it_is_said_how_many_the_library_was_asked(tmp_path, monkeypatch):
    skops = pytest.importorskip("skops.io")
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    x = np.linspace(0.1, 10.0, 50)[:, None]
    (tmp_path / "models").mkdir()
    skops.dump(
        make_pipeline(FunctionTransformer(np.log), LinearRegression()).fit(x, x[:, 0]), tmp_path / "models/m.skops"
    )
    (tmp_path / "models" / "st-codegen.toml").write_text(RANGE.format(0, 0.0, 10.0))
    generate(load(tmp_path / "models"), "iec", tmp_path / "out")
    (all_asked,) = verify(load(tmp_path / "models"), tmp_path / "out", rows=300).models
    monkeypatch.setattr("st_codegen.proof.agreement._ASKED", 1)
    (few_asked,) = verify(load(tmp_path / "models"), tmp_path / "out", rows=300).models
    assert all_asked.refused_outside == few_asked.refused_outside > few_asked.asked_outside
    assert ModelReport("m", refused_outside=9, asked_outside=4, silent_outside=2).not_judged == (
        "the block refuses 9 rows of numbers outside the range of inputs: the library answers 2 of the 4 of them that "
        "it was asked about"
    )


def test_blocks_around_models_have_rows_of_their_own(bundle_folder, tmp_path, capsys):
    assert run(bundle_folder, "--target", "iec", "--out", tmp_path / "out", "-q") == 0
    for rows, is_said in ((100, True), (2000, False)):
        capsys.readouterr()
        assert run("verify", bundle_folder, "-g", tmp_path / "out", "-n", rows) == 0
        said = "that --rows does not change: FB_TEPredict 2,000, FB_Compensator 2,000" in capsys.readouterr().err
        assert said == is_said


def test_ranges_that_nobody_knows_are_said_to_be_guesses(tmp_path, capsys):
    skops = pytest.importorskip("skops.io")
    from sklearn.linear_model import LinearRegression

    (tmp_path / "models").mkdir()
    x = np.random.default_rng(0).random((20, 1))
    skops.dump(LinearRegression().fit(x, x[:, 0]), tmp_path / "models" / "m.skops")
    page = tmp_path / "page.html"
    for ranges, is_guessed in ((RANGE.format(0, 0.0, 1.0), False), ("", True)):
        (tmp_path / "models" / "st-codegen.toml").write_text(ranges)
        assert run(tmp_path / "models", "--target", "iec", "--out", tmp_path / "out", "-q") == 0
        command = ("verify", tmp_path / "models", "-g", tmp_path / "out", "-n", 100, "--html", page)
        capsys.readouterr()
        assert run(*command) == 0
        for said in (capsys.readouterr().err, page.read_text(encoding="utf-8")):
            assert ("guessed from the model" in said) == is_guessed


def test_rows_that_the_block_refuses_are_not_said_to_agree_and_a_range_without_any_answer_is_named(tmp_path, capsys):
    """All rows in the range are refused: an error of 0 in the table is that of no row."""
    skops = pytest.importorskip("skops.io")
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer

    x = np.linspace(0.0, 1.0, 50)[:, None]
    model = make_pipeline(SplineTransformer(n_knots=4, extrapolation="error"), LinearRegression()).fit(x, x[:, 0])
    folder = tmp_path / "models"
    folder.mkdir()
    skops.dump(model, folder / "m.skops")
    (folder / "st-codegen.toml").write_text(RANGE.format(0, 10.0, 20.0) + 'outside = "flag"\n')
    generate(load(folder), "iec", tmp_path / "out")
    page = tmp_path / "page.html"
    run("verify", folder, "--generated", tmp_path / "out", "-n", "300", "--html", page)
    assert "takes no row in that range that was tried" in capsys.readouterr().err.replace("\n", " ")
    (found,) = verify(load(folder), tmp_path / "out", rows=300).models
    assert found.n > found.refused > found.unanswered > 0
    assert f"but for {found.refused:,} rows that a block refuses." in page.read_text(encoding="utf-8")


def test_a_bound_that_is_printed_is_a_bound():
    """The last digit is rounded up: "allowed 1" of 1.04, or "stays within -1 .. 1", would say what was not derived."""
    assert ModelReport("m", bound=1.04).cells[3] == "1.1"
    jump = ModelReport("m", jump=1.0004, jump_width=1.04e-9)
    assert "may differ by up to 1.01;" in jump.remarks[0] and jump.remarks[0].endswith("within 1.1e-09")
    limits = BlockProof("FB", (Limit("fOut", -1.00000001, 1.00000001),), (), 1)
    assert "fOut stays within -1.000001 .. 1.000001" in limits.claims
    assert at_most(2.7e-15) == "2.7e-15"  # as it is written
    assert (at_most(float("inf")), at_most(0.0)) == ("inf", "0")


def test_a_share_of_the_time_is_never_nothing():
    """A forest as trained against its table: the time "falls to 0%"."""
    times = (("table", 1.0), ("as trained", 900.0))
    layouts = [PricedLayout(layout, None, CallCost(time)) for layout, time in times]
    assert "falls to 0.112 % by" in LayoutDecision("m", "table", tuple(layouts), "as trained").change
