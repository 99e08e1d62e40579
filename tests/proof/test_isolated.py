"""Libraries that raise, or end their process: one line, and the other models are verified all the same."""

import subprocess
import sys

import numpy as np
import pytest

import st_codegen
from st_codegen.project.bundle import Bundle
from st_codegen.proof.isolated import LibraryRefusesError, _can_be_copied, isolated
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.files import load_model
from tests.cli.helpers import run


@pytest.fixture
def model(lone_folder):
    return load_model(lone_folder / "te.txt", "te")


def particular(model):
    def predict(x):
        if np.any(x[:, 0] == 7.0):
            raise ValueError("no row with 7")
        return model.predict(x)

    return predict


def of_no_use(_):
    raise ValueError("[nan] is not\na tag")


def test_the_answers_are_those_of_the_library(model):
    x = np.random.default_rng(0).uniform(0, 1800, size=(300, 3))
    with isolated([model, model]) as (_, other):
        assert np.array_equal(other.predict(x), model.predict(x))
        assert other.ir is model.ir


@pytest.mark.parametrize("row", [0, 1, 149, 298, 299])
def test_an_input_that_is_refused_is_named(model, row):
    x = np.zeros((300, 3))
    x[row, 0] = 7.0
    given = LoadedModel(model.ir, particular(model))
    with (
        isolated([given]) as (one,),
        pytest.raises(LibraryRefusesError, match=r"refuses the input \[7\.0, 0\.0, 0\.0\]: ValueError: no row with 7"),
    ):
        one.predict(x)


def test_a_model_that_is_refused_says_why_in_few_calls(model):
    calls = []

    def predict(x):
        calls.append(len(x))
        raise ValueError(f"call {len(calls)}")

    with isolated([LoadedModel(model.ir, predict)]) as (one,):
        with pytest.raises(LibraryRefusesError, match=r"^the library refuses the model: ValueError: call 1$"):
            one.predict(np.zeros((5000, 3)))
        with pytest.raises(LibraryRefusesError, match="call 5"):  # one for all rows, three for single ones
            one.predict(np.zeros((5000, 3)))


PROGRAM = """
import os, signal, sys
from pathlib import Path
import numpy as np
from st_codegen.proof.isolated import LibraryRefusesError, _can_be_copied, isolated
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.files import load_model
model = load_model(Path(sys.argv[1]), "te")
x = np.zeros((9, len(model.ir.features)))
ends = LoadedModel(model.ir, lambda rows: os.kill(os.getpid(), signal.SIGKILL))
with isolated([ends, model]) as (bad, good):
    for _ in range(2):
        try:
            bad.predict(x)
        except LibraryRefusesError as error:
            print(error)
        print(good.predict(x).shape)
try:
    os.wait()
except ChildProcessError:
    print("no child is left")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a thread answers on this system")
def test_a_library_that_ends_its_process_is_one_line_and_the_next_model_is_asked(lone_folder):
    program = [sys.executable, "-c", PROGRAM, str(lone_folder / "te.txt")]
    shown = subprocess.run(program, capture_output=True, text=True, check=True, timeout=300).stdout
    line = "the library refuses the model: the library ended its process (SIGKILL)\n(9, 1)\n"
    assert shown == 2 * line + "no child is left\n"


def test_a_process_with_threads_of_openmp_is_not_copied(model):
    """A copy would wait for them for ever."""
    import lightgbm

    x = np.random.default_rng(0).normal(size=(500, 3))
    parameters = {"num_threads": 2, "verbose": -1}
    lightgbm.train(parameters, lightgbm.Dataset(x, x[:, 0]), 2).predict(x)
    assert not _can_be_copied()
    with isolated([model]) as (one,):
        assert np.array_equal(one.predict(x), model.predict(x))


def test_verify_reports_what_the_library_refuses_and_verifies_the_rest(model, tmp_path):
    other = LoadedModel(model.ir.__class__(**{**vars(model.ir), "name": "other"}), of_no_use)
    bundle = Bundle((model, other))
    st_codegen.generate(bundle, "twincat", tmp_path)
    report = st_codegen.verify(bundle, tmp_path, rows=200)
    assert not report.passed
    assert report.models[0].passed
    assert report.models[1].refusal == "the library refuses the model: ValueError: [nan] is not a tag"
    assert report.as_json()["models"]["other"]["refusal"] == report.models[1].refusal


def test_the_command_line_shows_the_reason_as_it_is(lone_folder, tmp_path, capsys, monkeypatch):
    assert run(lone_folder, "--out", tmp_path / "out", "-q") == 0
    lightgbm = pytest.importorskip("lightgbm")
    monkeypatch.setattr(lightgbm.Booster, "predict", lambda *_, **__: of_no_use(0))
    assert run("verify", lone_folder, "--generated", tmp_path / "out", "--rows", 100) == 1
    shown = capsys.readouterr().err
    assert "te: the library refuses the model: ValueError: [nan] is not a tag\n" in shown
    assert "FAILED" in shown
    (tmp_path / "x.csv").write_text("f0,f1,f2\n1,2,3\n")
    arguments = ["predict", lone_folder, "-i", tmp_path / "x.csv", "-o", tmp_path / "y.csv", "-e", "source"]
    assert run(*arguments) == 2
    assert "error: the library refuses the model: ValueError: [nan] is not a tag\n" in capsys.readouterr().err
    assert not (tmp_path / "y.csv").exists()
