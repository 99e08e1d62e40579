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


def _square(number):
    time.sleep(0.2)  # longer than the others take to begin
    return os.getpid(), np.full(3, number * number)


def _reciprocal(number):
    time.sleep(0.05)
    return 1 / number


def _ends_elsewhere(here, number):
    if os.getpid() != here:
        os._exit(1)
    return number


@pytest.mark.parametrize("copies", [True, False])
def test_results_are_in_order_and_those_of_others_read_only(copies, monkeypatch):
    if joblib.cpu_count() < 2:
        pytest.skip("one processor: work stays in this process")
    if not copies:
        monkeypatch.setattr(processes, "can_be_copied", lambda: False)
    found = shared_out(_square, range(5), is_large=True)
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
    found = shared_out(_square, range(2), is_large=lack == "processors")
    assert {process for process, _ in found} == {os.getpid()}


def test_a_worker_that_ends_is_no_answer():
    assert shared_out(partial(_ends_elsewhere, os.getpid()), range(3), is_large=True) == [0, 1, 2]


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


def test_who_watches_is_told_of_what_this_process_takes(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    told = []
    found = shared_out(_square, range(10, 15), is_large=True, begun=lambda *given: told.append(given))
    here = [n for n, (process, _) in enumerate(found) if process == os.getpid()]
    assert told == [(n, 10 + n) for n in here]


@pytest.mark.parametrize("copies", [True, False])
def test_no_more_is_done_at_once_than_is_asked_for(copies, monkeypatch):
    monkeypatch.setattr(processes, "can_be_copied", lambda: copies)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 8)
    running, most = [], []

    def watched(number):
        running.append(number)
        most.append(len(running))
        time.sleep(0.05)
        running.remove(number)
        return os.getpid(), threading.get_ident()

    for at_once in (1, 2):
        found = shared_out(watched, range(6), is_large=True, at_once=at_once, can_travel=False)
        assert len(set(found)) <= at_once
        assert max(most) <= at_once


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
def test_an_interruption_ends_the_copies_at_once(monkeypatch):
    """Ctrl-C in `verify` waited for the rows of the models that were tried."""
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    home = os.getpid()
    before = processes.children(home)

    def work(number):
        if os.getpid() != home:
            time.sleep(6000)
        time.sleep(0.3)  # the copy has taken the other one
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        shared_out(work, range(2), is_large=True)
    assert time.monotonic() - started < 600
    assert processes.children(home) == before


@pytest.mark.skipif(not processes.can_be_copied(), reason="no copies here")
def test_an_interruption_of_who_waits_for_the_last_copy_ends_it(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    home = os.getpid()
    before = processes.children(home)

    def work(number):
        time.sleep(6000 if os.getpid() != home else 0.3)

    # what a shell starts in the background ignores it, and so would what it starts
    before_here = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(1.5, os.kill, (home, signal.SIGINT)).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            shared_out(work, range(2), is_large=True)
    finally:
        signal.signal(signal.SIGINT, before_here)
    assert processes.children(home) == before


def test_the_first_of_several_failures_is_told_wherever_it_was(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)

    def work(number):
        time.sleep(0.0 if number else 0.5)
        if number:
            raise ValueError(number)

    with pytest.raises(ValueError, match=r"^1$"):
        shared_out(work, range(5), is_large=True)


def test_no_item_is_taken_twice(monkeypatch, tmp_path):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 4)
    file = os.open(tmp_path / "taken", os.O_CREAT | os.O_APPEND | os.O_WRONLY)
    shared_out(lambda number: os.write(file, number.to_bytes(4)), range(5000), is_large=True)
    os.close(file)
    taken = np.frombuffer((tmp_path / "taken").read_bytes(), ">u4")
    assert np.array_equal(np.sort(taken), np.arange(5000))


def test_copies_share_no_work_out(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)

    def work(_):
        time.sleep(0.2)
        return os.getpid(), processes.other_processors()

    found = shared_out(work, range(2), is_large=True)
    assert dict(found) == {process: int(process == os.getpid()) for process, _ in found}


@pytest.mark.skipif(not processes.can_be_copied(), reason="no copies of a process here")
def test_copies_of_a_killed_process_begin_no_other_item(monkeypatch, tmp_path):
    """They took all that was left, with nobody to tell."""
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    file = os.open(tmp_path / "begun", os.O_CREAT | os.O_APPEND | os.O_WRONLY)

    def work(number):
        os.write(file, bytes([number]))
        if number == 1:
            time.sleep(0.3)
            os.kill(maker, signal.SIGKILL)
        time.sleep(0.3 if os.getpid() != maker else 60.0)

    if not (maker := processes.fork()):
        maker = os.getpid()
        shared_out(work, range(20), is_large=True)
        os._exit(0)
    assert os.WTERMSIG(os.waitpid(maker, 0)[1]) == signal.SIGKILL
    time.sleep(1.5)
    assert len((tmp_path / "begun").read_bytes()) <= 3


def test_a_copy_computes_in_the_surroundings_of_its_maker(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)

    def work(_):
        time.sleep(0.2)
        return os.getpid(), np.geterr()["divide"]

    with np.errstate(divide="raise"):
        found = shared_out(work, range(2), is_large=True)
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
