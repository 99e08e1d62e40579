"""Work in other processes: large work on all processors, and native code that may fail in copies of this process.

What ends a copy does not end this process, which says it in one line.

A copy (`fork`) has all that is loaded, at no cost, but of the threads only the one that made it. The OpenMP of GCC
gives each thread that computes its own helpers, and would wait for ever for those that its first thread had before. So
a new thread computes in a copy: it has had none.
"""

from __future__ import annotations

import contextlib
import contextvars
import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from types import FrameType
from typing import IO, Any, TypeVar

from st_codegen.errors import StCodegenError

#: Told while long work goes on: how much is done, of how much, and what is next.
Progress = Callable[[int, int, str], None]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

#: Nodes of all trees together from which on work on them takes seconds.
_MANY_NODES = 500_000

#: how long the end of a worker may come before this process is told of the interruption that ended it
_INTERRUPTED_WITHIN_S = 1.0

#: how often a worker looks whether its parent is there
_LOOKED_AFTER_S = 1.0

#: Whether this process is a worker that looks after its parent.
_is_watched = False

#: Whether this process is a copy, which computes on the processor that it was made for.
_is_copy = False


def shared_out(
    work: Callable[[_Item], _Result],
    items: Iterable[_Item],
    *,
    is_large: bool,
    at_once: int | None = None,
    can_travel: bool = True,
    begun: Callable[[int, _Item], None] = lambda _, __: None,
) -> list[_Result]:
    """What a function makes of each item, in their order, computed on all processors where the work `is_large`.

    Work stays in this process where it is small and where there are no `other_processors`; the results are the same.
    Arrays that come from another process are read-only. `at_once`: so many items at the same time at most. Where this
    process cannot be copied the work is sent to others, or is done by threads where it holds what cannot travel.
    `begun` is told of the items that this process takes: how many are done or being done, and the item.
    """
    items = list(items)
    others = min(other_processors(), len(items) - 1, (at_once or len(items)) - 1) if is_large else 0
    if others > 0 and can_be_copied():
        return _in_copies(work, items, others, begun)
    if others > 0 and not can_travel:
        with ThreadPoolExecutor(others + 1) as pool:
            runs = [pool.submit(work, item) for item in items]
            results = []
            try:
                for number, run in enumerate(runs):
                    begun(number, items[number])
                    results.append(run.result())
            finally:
                pool.shutdown(cancel_futures=True)
            return results
    if others > 0:
        with contextlib.suppress(BrokenProcessPool, ImportError):  # the end of a worker is no answer
            import joblib

            parallel = joblib.Parallel(n_jobs=others + 1, batch_size=1, max_nbytes=None)
            return [_unpacked(*made) for made in parallel(joblib.delayed(_packed)(work, item) for item in items)]
    results = []
    for number, item in enumerate(items):
        begun(number, item)
        results.append(work(item))
    return results


def has_many_nodes(nodes: Iterable[int]) -> bool:
    """Whether trees with so many nodes are worth sharing out."""
    return sum(nodes) > _MANY_NODES


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Work by joblib that may be interrupted: what its thread says of workers that were, too, is not shown.

    The signal reaches the workers as well. Outside of the main thread, which is the one that is interrupted, nothing is
    changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    told, shown, handler = threading.Event(), threading.excepthook, signal.getsignal(signal.SIGINT)

    def hook(args: threading.ExceptHookArgs) -> None:
        of_joblib = args.thread is not None and args.thread.name.startswith("ExecutorManagerThread")
        if not of_joblib or not told.wait(_INTERRUPTED_WITHIN_S):
            shown(args)

    def interrupted(number: int, frame: FrameType | None) -> None:
        told.set()
        if callable(handler):
            handler(number, frame)

    threading.excepthook = hook
    signal.signal(signal.SIGINT, interrupted)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if not told.is_set():  # else the thread may still say it
            threading.excepthook = shown


def end_with_parent() -> None:
    """In a worker of joblib: end with the process that gives it its work, also where that one is killed.

    A worker that waits to hand over its result would else wait for ever: it and the others hold the pipe open.
    """
    global _is_watched  # noqa: PLW0603 - of this process
    if not _is_watched and multiprocessing.current_process().name.startswith("LokyProcess"):
        _is_watched = True
        threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOKED_AFTER_S)
    os._exit(1)


def other_processors() -> int:
    """How many processors work may be shared out to beside the one of this process.

    None where this process is a worker or a copy itself, and where `LOKY_MAX_CPU_COUNT` (or the system) leaves one.
    """
    if _is_copy or multiprocessing.current_process().name != "MainProcess":
        return 0
    try:
        import joblib
    except ImportError:
        return len(os.sched_getaffinity(0)) - 1 if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1) - 1
    return int(joblib.cpu_count()) - 1


def _in_copies(
    work: Callable[[_Item], _Result], items: list[_Item], copies: int, begun: Callable[[int, _Item], None]
) -> list[_Result]:
    """What a function makes of each item, computed here and in copies of this process, which need no time to start.

    Each takes the next item when it is done with one. What a copy does not answer is computed here. No copy outlives
    an interruption. Of items that fail the first one is told, as without copies.
    """
    import fcntl

    with contextlib.ExitStack() as opened:
        turns = opened.enter_context(os.fdopen(os.memfd_create("turns"), "w+b", buffering=0))
        answers = [opened.enter_context(os.fdopen(os.memfd_create("answers"), "w+b")) for _ in range(copies)]
        turns.write(b"".join(number.to_bytes(4) for number in range(len(items))))
        turns.seek(0)  # the place in a file is common to all copies

        maker = os.getpid()

        def taken() -> Iterator[int]:
            # a copy whose maker was killed has nobody to compute for
            while maker in (os.getpid(), os.getppid()):
                fcntl.lockf(turns, fcntl.LOCK_EX)
                number = turns.read(4)
                fcntl.lockf(turns, fcntl.LOCK_UN)
                if not number:
                    return
                yield int.from_bytes(number)

        def answer(file: IO[bytes]) -> None:
            for number in taken():
                pickle.dump((number, _packed(work, items[number])), file)
                file.flush()

        found: dict[int, _Result] = {}
        children: list[int] = []
        try:
            for file in answers:
                children.append(make_copy(partial(answer, file)))
            with contextlib.suppress(Exception):  # told below, where it is the first one
                for number in taken():
                    begun(number, items[number])
                    found[number] = work(items[number])
            turns.seek(0, os.SEEK_END)  # where one fails, nobody begins another one
            while children:
                os.waitpid(children[-1], 0)
                children.pop()
        finally:
            for child in children:
                with contextlib.suppress(ProcessLookupError, ChildProcessError):  # it was waited for
                    os.kill(child, signal.SIGKILL)
                    os.waitpid(child, 0)
        for file in answers:
            file.seek(0)
            with contextlib.suppress(EOFError, pickle.UnpicklingError):
                while True:
                    number, made = pickle.load(file)
                    found[number] = _unpacked(*made)
    return [found[number] if number in found else work(item) for number, item in enumerate(items)]


def _packed(work: Callable[[_Item], object], item: _Item) -> tuple[bytes, list[bytes]]:
    """A result as it travels: bytes that cannot change take the place of its arrays."""
    end_with_parent()
    buffers: list[bytes] = []
    result = pickle.dumps(work(item), 5, buffer_callback=lambda buffer: buffers.append(buffer.raw().tobytes()))
    return result, buffers


def _unpacked(result: bytes, buffers: list[bytes]) -> Any:
    return pickle.loads(result, buffers=buffers)


def can_be_copied() -> bool:
    """Whether copies of this process can compute: on Linux. The system libraries of macOS refuse, Windows has none."""
    return sys.platform.startswith("linux")


def make_copy(action: Callable[[], object]) -> int:
    """Do something in a copy of this process, in a new thread of it; returns the copy's number.

    The copy ends with code 0 when the action does, with 1 when it raises.
    """
    child = fork()
    if child:
        return child
    code = 1

    def compute() -> None:
        global _is_copy  # noqa: PLW0603 - a fact of the process
        nonlocal code
        _is_copy = True
        with contextlib.suppress(Exception):  # the code says it
            action()
            code = 0

    try:
        thread = threading.Thread(target=contextvars.copy_context().run, args=(compute,))
        thread.start()
        thread.join()
    finally:
        os._exit(code)


def fork() -> int:
    """`os.fork`, without Python's warning about threads.

    What a copy has been given is left out of its collections: they write to each object, and so would copy all memory.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        gc.freeze()
    return child


def how_it_ended(status: int) -> str:
    """What `os.waitpid` says of the end of a process."""
    return signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"code {status >> 8}"


def failure_in_copy(action: Callable[[], object]) -> str | None:
    """How an action fails: its exception, or what ends a copy that tries it; None where it does not.

    It is tried in this process where that cannot be copied.
    """
    if not can_be_copied():
        return _failure(action)
    with os.fdopen(os.memfd_create("failure"), "w+", encoding="utf-8", errors="replace") as told:

        def try_it() -> None:
            failure = _failure(action)
            if failure is not None:
                told.write(failure or "it fails")
                told.flush()

        status = os.waitpid(make_copy(try_it), 0)[1]
        told.seek(0)
        failure = told.read()
    return failure or (f"its process ended ({how_it_ended(status)})" if status else None)


def _failure(action: Callable[[], object]) -> str | None:
    try:
        action()
    except StCodegenError as error:
        return str(error)
    except Exception as error:  # libraries raise anything
        return f"{type(error).__name__}: {error}"
    return None


def children(process: int) -> list[int]:
    """The processes that a process with one thread has made and that have not been waited for."""
    try:
        return [int(number) for number in Path(f"/proc/{process}/task/{process}/children").read_text("ascii").split()]
    except OSError:  # it has ended, or the kernel does not tell
        return []


def ticks_asleep(process: int) -> int | None:
    """The ticks that a sleeping process has computed: the same later where it slept all the time.

    None while one of its threads computes, waits for a disk, or is stopped.
    """
    ticks = 0
    try:
        for thread in Path(f"/proc/{process}/task").iterdir():
            fields = (thread / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()
            if fields[0] != "S":
                return None
            ticks += int(fields[11]) + int(fields[12])
    except OSError:
        return None
    return ticks
