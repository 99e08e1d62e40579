"""Libraries that raise, or end their process: one line, and the other models are verified all the same."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import st_codegen
import st_codegen.proof.isolated as isolated_module
from st_codegen import processes
from st_codegen.errors import InputError
from st_codegen.project.bundle import Bundle
from st_codegen.proof.isolated import LibraryRefusesError, isolated
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
import lightgbm
from pathlib import Path
import numpy as np
from st_codegen.proof.isolated import LibraryRefusesError, isolated
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


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a thread answers on this system")
def test_a_library_that_ends_its_process_is_one_line_and_the_next_model_is_asked(lone_folder):
    program = [sys.executable, "-c", PROGRAM, str(lone_folder / "te.txt")]
    shown = subprocess.run(program, capture_output=True, text=True, check=True, timeout=600).stdout
    line = "the library refuses the model: the library ended its process (SIGKILL)\n(9, 1)\n"
    assert shown == 2 * line + "no child is left\n"


on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a thread answers on this system")


@pytest.mark.thorough
@on_linux
def test_libraries_that_have_computed_with_many_threads_answer_in_a_copy():
    """The copy has none of these threads, and must not wait for them."""
    pytest.importorskip("lightgbm")
    program = [sys.executable, "-W", "ignore", "-c", THREADS]
    shown = subprocess.run(program, capture_output=True, text=True, check=True, timeout=600).stdout
    assert shown == "copied 1\ncopied 1\ncopied 1\nSIGKILL\n"


THREADS = """
import os, signal
import lightgbm
import numpy as np
from sklearn.cluster import KMeans
from sklearn.ensemble import HistGradientBoostingRegressor
from st_codegen.errors import StCodegenError
from st_codegen.proof.isolated import isolated
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator
os.environ["OMP_NUM_THREADS"] = "2"
x = np.random.default_rng(0).normal(size=(2000, 3))
booster = lightgbm.train({"num_threads": 2, "verbose": -1}, lightgbm.Dataset(x, x[:, 0]), 2)
booster.predict(x, num_threads=2)
kinds = [KMeans(3, n_init=1), HistGradientBoostingRegressor(max_iter=3)]
fitted = [booster, *(kind.fit(x, x[:, 0]) for kind in kinds)]
models = [from_estimator(one, "m") for one in fitted]
expected = [model.predict(x) for model in models]
home = os.getpid()
def crash(rows):
    assert os.getpid() != home
    os.kill(os.getpid(), signal.SIGKILL)
with isolated([*models, LoadedModel(models[0].ir, crash)]) as (*asked, bad):
    for model, numbers in zip(asked, expected):
        print("copied", int(np.array_equal(model.predict(x), numbers)))
    try:
        bad.predict(x)
    except StCodegenError as error:
        print(str(error).partition("(")[2].rstrip(")"))
"""


@on_linux
def test_a_library_that_sleeps_for_ever_is_one_line(model, monkeypatch):
    monkeypatch.setattr(isolated_module, "_PATIENCE_S", 0.3)
    sleeps = LoadedModel(model.ir, lambda rows: threading.Event().wait())
    with isolated([sleeps, model]) as (bad, good):
        with pytest.raises(LibraryRefusesError, match="refuses the model: the library waits for something"):
            bad.predict(np.zeros((1, 3)))
        assert good.predict(np.zeros((2, 3))).shape == (2, 1)


def sleeps(process):
    """Whether a process has slept for a while."""
    ticks = processes.ticks_asleep(process)
    time.sleep(0.3)
    return ticks is not None and ticks == processes.ticks_asleep(process)


@on_linux
def test_a_library_that_computes_or_is_done_is_not_taken_for_stuck():
    computes = [sys.executable, "-c", "print(1, flush=True)\nwhile True: pass"]
    waits = [sys.executable, "-c", "import sys; print(1, flush=True); sys.stdin.read()"]
    for program in (computes, waits):
        with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            assert process.pid in processes.children(os.getpid())
            if program is waits:
                end = time.monotonic() + 600  # it may take its time to get there
                while not sleeps(process.pid) and time.monotonic() < end:
                    pass
            assert sleeps(process.pid) == (program is waits)
            process.kill()
    assert processes.ticks_asleep(process.pid) is None


@on_linux
def test_each_copy_of_this_process_asks_one_of_its_own(model, monkeypatch):
    monkeypatch.setattr(processes, "other_processors", lambda: 3)
    x = np.random.default_rng(0).normal(size=(300, 3))
    expected = [model.predict(x[n::40]) for n in range(40)]
    whose = LoadedModel(model.ir, lambda rows: np.full((len(rows), 1), os.getpid()))
    with isolated([model, whose]) as (one, who):
        found = processes.shared_out(
            lambda n: (who.predict(x[:1]), one.predict(x[n::40])), range(40), is_large=True, can_travel=False
        )
    assert all(np.array_equal(numbers, other) for (_, numbers), other in zip(found, expected, strict=True))
    answering = {int(number[0, 0]) for number, _ in found}
    assert len(answering) > 1
    assert os.getpid() not in answering
    end = time.monotonic() + 60  # none outlives the copy that asked it
    while any(Path(f"/proc/{process}").exists() for process in answering) and time.monotonic() < end:
        time.sleep(0.01)
    assert not [process for process in answering if Path(f"/proc/{process}").exists()]


@on_linux
def test_what_is_opened_later_is_not_open_in_what_answers(model):
    """A connection to a controller was: closed here, it stayed open for the controller."""
    with isolated([model]) as (one,):
        ours, theirs = socket.socketpair()
        one.predict(np.zeros((1, 3)))
        ours.close()
        theirs.settimeout(60)
        assert theirs.recv(1) == b""
        theirs.close()


@on_linux
def test_what_answers_a_copy_ends_with_it_even_while_it_computes(model):
    told, tell = os.pipe()

    def busy(rows):
        os.write(tell, os.getpid().to_bytes(4))
        time.sleep(6000)

    with isolated([LoadedModel(model.ir, busy)]) as (one,):
        copy = processes.make_copy(lambda: one.predict(np.zeros((1, 3))))
        answering = int.from_bytes(os.read(told, 4))
        os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
        end = time.monotonic() + 60
        while Path(f"/proc/{answering}").exists() and time.monotonic() < end:
            time.sleep(0.01)
        assert not Path(f"/proc/{answering}").exists()


@on_linux
def test_the_end_of_a_busy_library_is_not_waited_for(model):
    told, tell = os.pipe()

    def busy(rows):
        os.write(tell, b"begun")
        time.sleep(60)
        os.write(tell, b"done")

    with isolated([LoadedModel(model.ir, busy)]) as (one,):
        threading.Thread(target=lambda: suppressed(one.predict, np.zeros((1, 3))), daemon=True).start()
        os.close(tell)
        assert os.read(told, 9) == b"begun"
    with os.fdopen(told, "rb") as pipe:
        assert pipe.read() == b""


def suppressed(call, *arguments):
    with contextlib.suppress(Exception):
        call(*arguments)


@on_linux
def test_an_onnx_file_that_ends_its_library_is_one_line(monkeypatch):
    onnxruntime = pytest.importorskip("onnxruntime")
    path = Path(__file__).parents[2] / "examples" / "rv160n" / "models" / "A81_forward.onnx"
    home = os.getpid()

    def session(*_, **__):
        assert os.getpid() != home
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(onnxruntime, "InferenceSession", session)
    line = r"^A81_forward.onnx: onnxruntime refuses the model: its process ended \(SIGKILL\)$"
    with pytest.raises(InputError, match=line):
        load_model(path, "m")


def test_where_a_process_cannot_be_copied_a_thread_answers(model, monkeypatch):
    monkeypatch.setattr(isolated_module, "can_be_copied", lambda: False)
    monkeypatch.setattr(processes, "can_be_copied", lambda: False)
    x = np.zeros((5, 3))
    with isolated([model, LoadedModel(model.ir, of_no_use)]) as (one, other):
        assert np.array_equal(one.predict(x), model.predict(x))
        answering = [thread for thread in threading.enumerate() if thread.name.endswith("(_answers)")]
        assert answering  # and a library that never does cannot keep the command from ending
        assert all(thread.daemon for thread in answering)
        with pytest.raises(LibraryRefusesError, match="is not a tag"):
            other.predict(x)
    assert processes.failure_in_copy(lambda: of_no_use(0)) == "ValueError: [nan] is not\na tag"
    assert processes.failure_in_copy(lambda: None) is None


def test_verify_reports_what_the_library_refuses_and_verifies_the_rest(model, tmp_path):
    other = LoadedModel(model.ir.__class__(**{**vars(model.ir), "name": "other"}), of_no_use)
    bundle = Bundle((model, other))
    st_codegen.generate(bundle, "twincat", tmp_path)
    report = st_codegen.verify(bundle, tmp_path, rows=200)
    assert not report.passed
    assert report.models[0].passed
    assert report.models[1].refusal == "the library refuses the model: ValueError: [nan] is not a tag"
    assert report.as_json()["models"]["other"]["refusal"] == report.models[1].refusal
    assert report.models[1].n == 0  # no row was compared


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
