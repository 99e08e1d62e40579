"""The libraries' own predictions, computed in another process where that can be: what ends it is one line here.

A library reads a model file with native code of its own. Whatever our readers overlooked must not end the command.
"""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import StCodegenError
from st_codegen.ir import FloatArray
from st_codegen.threads import one_thread
from st_codegen.walkers.base import LoadedModel, Predictor


class LibraryRefusesError(StCodegenError):
    """A library has no answer for a model, or for an input that it should take; the message says why."""


@dataclass(frozen=True)
class _Refusal:
    """What a library, or the end of its process, says in place of an answer."""

    reason: str


@contextlib.contextmanager
def isolated(models: Sequence[LoadedModel]) -> Iterator[tuple[LoadedModel, ...]]:
    """The same models, whose `predict` asks a process that is a copy of this one.

    It raises LibraryRefusesError with the library's reason. The copy shares what is loaded already, computes on one
    thread, and is made anew where a library ends it. Where this process cannot be copied safely (`_can_be_copied`) a
    thread answers instead, and what ends a library ends the command.
    """
    ours, theirs = multiprocessing.Pipe()
    if _can_be_copied():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads: none of them is needed in the copy
            keeper = os.fork()
        if not keeper:
            ours.close()
            _keep(theirs, models)
        theirs.close()
    else:
        keeper = 0
        threading.Thread(target=_answers, args=(theirs, models), daemon=True).start()
    lock = threading.Lock()
    try:
        yield tuple(
            dataclasses.replace(model, predict=_remote(model, number, ours, lock))
            for number, model in enumerate(models)
        )
    finally:
        ours.close()
        if keeper:
            os.waitpid(keeper, 0)


def _can_be_copied() -> bool:
    """Whether a copy of this process can compute: not where an OpenMP library is loaded, whose threads it would lack.

    The command line loads none before it reads LightGBM text, XGBoost or ONNX files; scikit-learn brings one along.
    """
    try:
        loaded = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:  # not Linux
        return False
    return not any(name in loaded for name in ("libgomp", "libomp", "libiomp"))


def _keep(connection: Connection, models: Sequence[LoadedModel]) -> None:
    """Keep a process that answers until nobody asks any more; never returns.

    It has no thread beside its own, so that copies of it can be made safely as often as libraries end them.
    """
    try:
        while True:
            child = os.fork()
            if not child:
                _serve(connection, models)
                os._exit(0)
            status = os.waitpid(child, 0)[1]
            if not status:
                break
            ended = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"code {status >> 8}"
            connection.send(_Refusal(f"the library ended its process ({ended})"))
    finally:
        os._exit(0)


def _serve(connection: Connection, models: Sequence[LoadedModel]) -> None:
    """Answer in a process that does nothing else."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with one_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _answers(connection, models)


def _answers(connection: Connection, models: Sequence[LoadedModel]) -> None:
    """Answer requests (number of a model, rows) until the connection is closed."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            number, rows = connection.recv()
            connection.send(_answer(models[number].predict, rows))


def _answer(predict: Predictor, rows: FloatArray) -> Any:
    try:
        return np.asarray(predict(rows), np.float64)
    except StCodegenError as error:
        return _Refusal(str(error))
    except Exception as error:  # libraries raise anything
        return _Refusal(f"{type(error).__name__}: {error}")


def _remote(model: LoadedModel, number: int, connection: Connection, lock: threading.Lock) -> Predictor:
    """The predictor of a model that asks the other process."""

    def ask(rows: FloatArray) -> Any:
        with lock:
            connection.send((number, rows))
            return connection.recv()

    def predict(rows: FloatArray) -> FloatArray:
        if not len(rows):  # which some libraries refuse
            return np.zeros((0, len(model.ir.outputs)))
        answer = ask(rows)
        if isinstance(answer, _Refusal):
            raise LibraryRefusesError(_refused(ask, rows, answer.reason))
        found: FloatArray = answer
        return found

    return predict


def _refused(ask: Any, rows: FloatArray, reason: str) -> str:
    """What a library refuses: the model, or the first row without an answer, found by halving."""
    reason = " ".join(reason.split())
    if all(isinstance(ask(rows[row : row + 1]), _Refusal) for row in {0, len(rows) // 2, len(rows) - 1}):
        return f"the library refuses the model: {reason}"
    good, bad = 0, len(rows)
    while bad - good > 1:
        middle = (good + bad) // 2
        if isinstance(ask(rows[good:middle]), _Refusal):
            bad = middle
        else:
            good = middle
    return f"the library refuses the input {rows[good].tolist()}: {reason}"
