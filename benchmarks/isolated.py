"""Runs one contender in a process of its own: what crashes, hangs or eats memory takes nobody else's results along."""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

#: The child inherits the trained model; nothing has to be loaded or imported again
_FORK = multiprocessing.get_context("fork")


class FailedError(Exception):
    """What a contender said when it failed, or what ended its process."""


def isolated(work: Callable[[], Any], seconds: float) -> Any:
    """The result of `work` (picklable), run in a process that is ended after so many seconds. Raises FailedError."""
    here, there = _FORK.Pipe(duplex=False)
    process = _FORK.Process(target=_child, args=(work, there))
    process.start()
    there.close()
    try:
        if not here.poll(seconds):
            raise FailedError(f"stopped after {seconds:.0f} s")
        try:
            result, error = here.recv()
        except EOFError:
            process.join()
            raise FailedError(f"crashed: {_end(process.exitcode)}") from None
    finally:
        if process.is_alive():
            process.join(5.0)
        if process.is_alive() and process.pid is not None:
            with suppress(ProcessLookupError):  # where it did not come as far as a group of its own
                os.killpg(process.pid, signal.SIGKILL)  # with the compilers that it started
            process.kill()
        process.join()
        here.close()
    if error:
        raise FailedError(error)
    return result


def all_isolated(works: list[Callable[[], Any]], seconds: float) -> None:
    """Several at a time, one a core; results and errors are dropped."""

    def quietly(work: Callable[[], Any]) -> None:
        with suppress(FailedError):  # the run that counts says so again
            isolated(work, seconds)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        list(pool.map(quietly, works))


def _child(work: Callable[[], Any], there: Connection) -> None:
    os.setsid()
    try:
        answer = (work(), "")
    except BaseException as error:
        if isinstance(error, AssertionError):
            traceback.print_exc()
        answer = (None, _short(error))
    there.send(answer)
    there.close()
    os._exit(0)  # no clean-up of libraries that the parent still uses


def _short(error: BaseException) -> str:
    text = str(error) or repr(error)
    stderr = getattr(error, "stderr", None)
    if stderr:  # of a compiler the first error says more than the command
        lines = (stderr.decode(errors="replace") if isinstance(stderr, bytes) else str(stderr)).splitlines()
        text = next((line for line in lines if "error" in line), lines[-1])
    return f"{type(error).__name__}: {' '.join(text.split())[:300]}"


def _end(code: int | None) -> str:
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
