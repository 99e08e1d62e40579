"""The block that keeps a window of samples: filled, shifted, held and reset, in every target."""

import numpy as np
import pytest

from st_codegen import generate, load, verify
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.windows import window_checks
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import constant, graph_model, info

SOURCES = ["iec", "twincat", "scl", "codesys", "plcopen"]


def project(folder, text, shape=(None, 1, 4)):
    """Models with one network over a window, and its configuration."""
    from onnx import helper

    channels = shape[1]
    nodes = [
        helper.make_node("Conv", ["X", "W"], ["c"]),
        helper.make_node("Relu", ["c"], ["r"]),
        helper.make_node("GlobalMaxPool", ["r"], ["g"]),
        helper.make_node("Flatten", ["g"], ["Y"]),
    ]
    weights = constant("W", np.random.default_rng(channels).normal(size=(2, channels, 3)))
    build.load(graph_model(nodes, [info("X", shape)], [info("Y", None)], [weights]), folder)
    (folder / "st-codegen.toml").write_text(f'[[model]]\nfile = "model.onnx"\n{text}\n')
    return load(folder)


@pytest.mark.parametrize("target", SOURCES)
def test_a_window_is_that_of_the_model_on_each_of_its_windows(tmp_path, target):
    bundle = project(tmp_path, 'window = 4\nsamples = ["fVibration"]')
    generate(bundle, target, tmp_path / "out")
    report = verify(bundle, tmp_path / "out", rows=100, jobs=1)
    (window,) = (one for one in report.models if one.name.endswith("Window"))
    assert (window.verdict, window.bound) == ("equal bits", 0.0)
    assert report.passed
    assert [model.name for model in report.models] == ["model", "FB_ModelWindow"]


@pytest.mark.parametrize("order", ["sample", "channel"])
def test_samples_of_several_numbers(tmp_path, order):
    bundle = project(tmp_path, f'window = 5\nwindow_order = "{order}"', (None, 2, 5))
    generate(bundle, "iec", tmp_path / "out")
    assert verify(bundle, tmp_path / "out", rows=100, jobs=1).passed
    code = GeneratedCode(tmp_path / "out" / "iec", TARGETS["iec"].dialect)
    samples = np.random.default_rng(4).normal(size=(9, 2))
    always, never = np.ones(9, np.bool_), np.zeros(9, np.bool_)
    found = code.sequence(
        "FB_ModelWindow", {"fSample1": samples[:, 0], "fSample2": samples[:, 1], "bShift": always, "bReset": never}
    )
    assert found["nSamples"].tolist() == [1, 2, 3, 4, 5, 5, 5, 5, 5]
    assert found["bValid"].tolist() == [False] * 4 + [True] * 5
    windows = np.array([samples[end - 5 : end] for end in range(5, 10)])
    rows = windows.reshape(5, -1) if order == "sample" else windows.swapaxes(1, 2).reshape(5, -1)
    library = bundle.models[0].predict(rows)
    np.testing.assert_allclose(np.column_stack([found["fOut1"], found["fOut2"]])[4:], library, rtol=1e-5, atol=1e-6)


def test_a_window_that_mixes_up_samples_fails(tmp_path):
    bundle = project(tmp_path, "window = 4")
    generate(bundle, "iec", tmp_path / "out")
    (file,) = (tmp_path / "out" / "iec").glob("FB_Model.st")
    text = file.read_text()

    def differs():
        code = GeneratedCode(tmp_path / "out" / "iec", TARGETS["iec"].dialect)
        (check,) = window_checks(bundle.irs, bundle.configuration.windows(), code, 0)
        return not np.array_equal(check.expected, check.got, equal_nan=True)

    for old, new in (
        ("nAt := nNext; (* the oldest *)", "nAt := 0; (* the oldest *)"),
        ("bValid := FALSE;\nEND_IF;\nIF bShift", "bValid := TRUE;\nEND_IF;\nIF bShift"),
        ("nSamples := 0;\n", "nSamples := 1;\n"),
        ("IF bShift THEN", "IF TRUE THEN"),
    ):
        assert old in text
        file.write_text(text.replace(old, new))
        assert differs()
    file.write_text(text)
    assert not differs()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("window = 3", "a window of 3 samples for 4 features: they are not as many"),
        ('window = 2\nsamples = ["fA", "fB", "fC"]', "2 samples of 3 numbers for 4 features"),
        ('samples = ["fA"]', "say how many samples it has"),
        ('window = 2\nsamples = ["fA", "fa"]', "have the same name"),
        ('window = 4\nsamples = ["vibration"]', "f and a capital letter"),
        ("window = 1", "window"),
        ('window = 4\nwindow_order = "time"', "window_order"),
    ],
)
def test_what_is_no_window(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        project(tmp_path, text)


def test_a_sample_with_the_name_of_an_output(tmp_path):
    bundle = project(tmp_path, 'window = 4\nsamples = ["fOut1"]')
    with pytest.raises(InputError, match="fOut1 is the name of another variable"):
        generate(bundle, "iec", tmp_path / "out")
