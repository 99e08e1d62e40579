"""Work on all processors: the same results in the same order, wherever they are computed."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import joblib
import numpy as np
import pytest

from st_codegen import processes
from st_codegen.driver import generate
from st_codegen.errors import InputError
from st_codegen.processes import shared_out
from st_codegen.project.bundle import load


def _with_another(folder):
    """This process, as soon as another one has begun as well."""
    (folder / str(os.getpid())).touch()
    end = time.monotonic() + 60
    while len(list(folder.iterdir())) < 2:
        assert time.monotonic() < end, "one process has all the work"
        time.sleep(0.01)
    return os.getpid()


def _square(folder, number):
    return _with_another(folder), np.full(3, number * number)


def _reciprocal(number):
    time.sleep(0.05)
    return 1 / number


def _ends_elsewhere(here, folder, number):
    if _with_another(folder) != here:
        os._exit(1)
    return number


@pytest.mark.parametrize("copies", [True, False])
def test_results_are_in_order_and_those_of_others_read_only(copies, monkeypatch, tmp_path):
    if joblib.cpu_count() < 2:
        pytest.skip("one processor: work stays in this process")
    if not copies:
        monkeypatch.setattr(processes, "can_be_copied", lambda: False)
    found = shared_out(partial(_square, tmp_path), range(5), is_large=True)
    assert [value.tolist() for _, value in found] == [[n * n] * 3 for n in range(5)]
    others = [value for process, value in found if process != os.getpid()]
    assert others
    assert not any(value.flags.writeable for value in others)


def test_what_fails_in_a_copy_fails_here(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    with pytest.raises(ZeroDivisionError):
        shared_out(_reciprocal, [1, 2, 0, 4], is_large=True)


@pytest.mark.parametrize("lack", ["size", "processors"])
def test_work_stays_here_where_it_is_not_worth_a_process(lack, monkeypatch):
    if lack == "processors":
        monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    monkeypatch.setattr(processes, "make_copy", None)
    here = os.getpid()
    assert shared_out(lambda _: os.getpid(), range(2), is_large=lack == "processors") == [here, here]


def test_a_worker_that_ends_is_no_answer(monkeypatch, tmp_path):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    assert shared_out(partial(_ends_elsewhere, os.getpid(), tmp_path), range(3), is_large=True) == [0, 1, 2]


def test_all_blocks_that_cannot_be_made_are_told_on_several_processors_too(bundle_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "_MANY_NODES", 0)
    bundle, told = load(bundle_folder), set()
    for processors in ("1", "2"):
        monkeypatch.setenv("LOKY_MAX_CPU_COUNT", processors)
        with pytest.raises(InputError, match="2 problems") as refused:
            generate(bundle, "iec", tmp_path, max_array=2)
        told.add((str(refused.value), refused.value.codes))
    assert len(told) == 1


def test_layouts_are_the_same_on_one_processor_and_on_several(bundle_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "_MANY_NODES", 0)
    bundle = load(bundle_folder)
    several = generate(bundle, "iec", tmp_path / "several")
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    one = generate(bundle, "iec", tmp_path / "one")
    assert several.files == one.files
    for name in one.files:
        assert (several.folder / name).read_bytes() == (one.folder / name).read_bytes(), name
    trees = [op for model in several.compiled.models for op in model.ops if hasattr(op, "values")]
    assert trees and not any(op.values.flags.writeable for op in trees)


@pytest.mark.parametrize("interrupts", [True, False])
def test_what_joblib_says_of_interrupted_workers_is_not_shown(interrupts, monkeypatch):
    """Ctrl-C in `train` ended with a traceback of joblib's thread."""
    shown = []
    monkeypatch.setattr(threading, "excepthook", lambda args: shown.append(args.thread.name))
    monkeypatch.setattr(processes, "_INTERRUPTED_WITHIN_S", 0.5)
    before = signal.getsignal(signal.SIGINT)

    def fails():
        raise KeyError(5)

    threads = [threading.Thread(target=fails, name=name) for name in ("ExecutorManagerThread", "another")]
    with contextlib.suppress(KeyboardInterrupt), processes.interruptible():
        for thread in threads:
            thread.start()
        if interrupts:
            signal.raise_signal(signal.SIGINT)
        for thread in threads:
            thread.join()
    for thread in threads:
        thread.join()
    assert sorted(shown) == (["another"] if interrupts else ["ExecutorManagerThread", "another"])
    assert signal.getsignal(signal.SIGINT) is before


def test_who_watches_is_told_of_what_this_process_takes(monkeypatch, tmp_path):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    told = []
    work = partial(_square, tmp_path)
    found = shared_out(work, range(10, 15), is_large=True, begun=lambda *given: told.append(given))
    here = [n for n, (process, _) in enumerate(found) if process == os.getpid()]
    assert 0 < len(here) < 5
    assert told == [(n, 10 + n) for n in here]


@pytest.mark.parametrize("copies", [True, False])
def test_no_more_is_done_at_once_than_is_asked_for(copies, monkeypatch, tmp_path):
    monkeypatch.setattr(processes, "can_be_copied", lambda: copies)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 8)

    def watched(number):
        (tmp_path / str(number)).touch()
        time.sleep(0.05)
        running = len(list(tmp_path.iterdir()))
        (tmp_path / str(number)).unlink()
        return (os.getpid(), threading.get_ident()), running

    for at_once in (1, 2):
        found = shared_out(watched, range(6), is_large=True, at_once=at_once, can_travel=False)
        assert len({who for who, _ in found}) <= at_once
        assert max(running for _, running in found) <= at_once


def test_work_that_cannot_travel_is_done_by_threads_where_nothing_can_be_copied(monkeypatch):
    monkeypatch.setattr(processes, "can_be_copied", lambda: False)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    told, both = [], threading.Barrier(2)

    def meets(number):
        both.wait(60)  # which one thread alone would wait for in vain
        return number * 2

    found = shared_out(meets, range(4), is_large=True, can_travel=False, begun=lambda *given: told.append(given))
    assert found == [0, 2, 4, 6]
    assert told == [(n, n) for n in range(4)]


@pytest.mark.skipif(not processes.can_be_copied(), reason="no copies here")
@pytest.mark.parametrize("who", ["computes", "waits for the last copy"])
def test_an_interruption_ends_the_copies_at_once(who, monkeypatch, tmp_path):
    """Ctrl-C in `verify` waited for the rows of the models that were tried."""
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    home = os.getpid()
    before = processes.children(home)
    (tmp_path / "begun").mkdir()

    def work(number):
        if _with_another(tmp_path / "begun") != home:
            if who != "computes":
                os.kill(home, signal.SIGINT)
            time.sleep(60)
            (tmp_path / "waited for").touch()
        elif who == "computes":
            raise KeyboardInterrupt

    # what a shell starts in the background ignores the signal, and so would what it starts
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            shared_out(work, range(2), is_large=True)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert not (tmp_path / "waited for").exists()
    assert processes.children(home) == before


@pytest.mark.skipif(not processes.can_be_copied(), reason="no copies of a process here")
def test_copies_of_a_killed_process_begin_no_other_item(monkeypatch):
    """They took all that was left, with nobody to tell."""
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    begun, begins = os.pipe()

    def work(number):
        os.write(begins, bytes([number]))
        if os.getpid() == maker:
            time.sleep(60)
        with contextlib.suppress(ProcessLookupError):
            os.kill(maker, signal.SIGKILL)
        while os.getppid() == maker:
            time.sleep(0.01)

    if not (maker := processes.fork()):
        maker = os.getpid()
        shared_out(work, range(20), is_large=True)
        os._exit(0)
    os.close(begins)
    assert os.WTERMSIG(os.waitpid(maker, 0)[1]) == signal.SIGKILL
    with os.fdopen(begun, "rb") as pipe:  # which ends with the copy
        assert len(pipe.read()) <= 2


def test_a_copy_computes_in_the_surroundings_of_its_maker(monkeypatch, tmp_path):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    with np.errstate(divide="raise"):
        found = shared_out(lambda _: (_with_another(tmp_path), np.geterr()["divide"]), range(2), is_large=True)
    assert len(dict(found)) == 2
    assert {told for _, told in found} == {"raise"}


_GIVES_WORK = """
import os, joblib
from tests.test_processes import large_result
print(os.getpid(), flush=True)
joblib.Parallel(2, batch_size=1, max_nbytes=None)(joblib.delayed(large_result)(n) for n in range(1000))
"""


def large_result(number):
    processes.end_with_parent()
    os.write(1, f"{os.getpid()}\n".encode())
    return bytes(5_000_000)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process keeps the number of its parent")
def test_workers_end_with_the_process_that_gave_them_work():
    """After `kill -9` one waited for ever to hand over its result, and the other one for the first.

    Both have begun: one that never had work ends as an idle one does, minutes later.
    """
    parent = subprocess.Popen([sys.executable, "-c", _GIVES_WORK], stdout=subprocess.PIPE, text=True)
    seen: set[int] = set()
    while len(seen - {parent.pid}) < 2:
        seen.add(int(parent.stdout.readline()))
    parent.kill()
    # the pipe of the output is closed when the last one that writes to it has ended
    parent.communicate(timeout=60)
