"""The libraries' own predictions, computed in another process where that can be: what ends it is told in one line.

A library reads a model file with native code of its own. Whatever our readers overlooked must not end the command.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import multiprocessing
import os
import select
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from st_codegen.errors import StCodegenError
from st_codegen.ir import BoolArray, FloatArray
from st_codegen.processes import can_be_copied, children, fork, how_it_ended, make_copy, ticks_asleep
from st_codegen.threads import one_thread
from st_codegen.walkers.base import LoadedModel, Predictor

#: Seconds between two looks at whether who asks is still there.
_WATCHED_EVERY_S = 0.02
#: Seconds between two looks at a process that does not answer; one that slept all the time is ended.
_PATIENCE_S = 10.0


class LibraryRefusesError(StCodegenError):
    """A library has no answer for a model, or for an input that it should take; the message says why."""


@dataclass(frozen=True)
class _Refusal:
    """What a library, or the end of its process, says in place of an answer."""

    reason: str


@contextlib.contextmanager
def isolated(models: Sequence[LoadedModel]) -> Iterator[tuple[LoadedModel, ...]]:
    """These models, whose `predict` asks a process that is a copy of this one.

    It raises LibraryRefusesError with the library's reason. The copy shares what is loaded already, computes on one
    thread, and is made anew where a library ends it, or sleeps and never answers. A copy of this process that asks has
    an answering copy of its own. Where this process cannot be copied (`can_be_copied`) a thread answers instead, and
    what ends a library ends the command.
    """
    links = _Links(models)
    try:
        yield tuple(
            dataclasses.replace(model, predict=_remote(model, number, links)) for number, model in enumerate(models)
        )
    finally:
        links.end()


def answers_to(model: LoadedModel, x: FloatArray, calls: float = math.inf) -> tuple[FloatArray, BoolArray]:
    """What an isolated model answers to rows that it may refuse, and which of them it was asked.

    Rows that it refuses together are asked by halves, until it was called so often. NaN in rows without an answer.
    """
    answers, asked = np.full((len(x), len(model.ir.outputs)), np.nan), np.zeros(len(x), np.bool_)
    left = [np.arange(len(x))] if len(x) else []
    while left and calls > 0:
        rows, calls = left.pop(), calls - 1
        try:
            answers[rows] = model.predict(x[rows])
        except LibraryRefusesError:
            if len(rows) > 1:
                left += np.array_split(rows, 2)
                continue
        asked[rows] = True
    return answers, asked


def _keep(connection: Connection, models: Sequence[LoadedModel], watched: int) -> None:
    """Keep a process that answers until nobody asks any more, or `watched` is closed elsewhere; never returns.

    It has no thread beside its own, so that copies of it can be made safely as often as libraries end them, and is in a
    group of its own, so that the keys that interrupt a command reach the command alone.
    """
    try:
        os.setpgid(0, 0)
        while True:
            child = make_copy(lambda: _serve(connection, models))
            while not (ended := os.waitpid(child, os.WNOHANG))[0]:
                if select.select([watched], [], [], _WATCHED_EVERY_S)[0]:
                    os.killpg(0, signal.SIGKILL)  # who asked has ended: it may not have been able to say so
            status = ended[1]
            if not status:
                break
            connection.send(_Refusal(f"the library ended its process ({how_it_ended(status)})"))
    finally:
        os._exit(0)


def _serve(connection: Connection, models: Sequence[LoadedModel]) -> None:
    """Answer in a process that does nothing else."""
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


@dataclass(frozen=True)
class _Link:
    """The way to the process that answers, which one thread at a time may use, and the number of its keeper, or 0.

    `alive` is what this process alone holds open: the keeper ends when it is closed, whoever closes it.
    """

    connection: Connection
    keeper: int
    lock: threading.Lock
    alive: int = -1

    @classmethod
    def to(cls, models: Sequence[LoadedModel]) -> _Link:
        """The way to a new copy of this process, or to a thread."""
        ours, theirs = multiprocessing.Pipe()
        if not can_be_copied():
            threading.Thread(target=_answers, args=(theirs, models), daemon=True).start()
            return cls(ours, 0, threading.Lock())
        watched, alive = os.pipe()
        keeper = fork()
        if not keeper:
            ours.close()
            os.close(alive)
            _keep(theirs, models, watched)
        with contextlib.suppress(OSError):  # the copy was quicker, or has ended
            os.setpgid(keeper, keeper)
        theirs.close()
        os.close(watched)
        return cls(ours, keeper, threading.Lock(), alive)

    def end(self) -> None:
        """End what answers; nobody waits for it any more."""
        self.connection.close()
        if self.keeper:
            os.close(self.alive)
            with contextlib.suppress(OSError):
                os.killpg(self.keeper, signal.SIGKILL)
            os.waitpid(self.keeper, 0)

    def ask(self, number: int, rows: FloatArray) -> Any:
        """The answer of a model, or a refusal."""
        with self.lock:
            self.connection.send((number, rows))
            stuck = self.keeper and self._is_stuck()
            answer = self.connection.recv()
        return _Refusal("the library waits for something that does not come") if stuck else answer

    def _is_stuck(self) -> bool:
        """Wait for the answer; whether the library's process was ended since it slept and did not answer."""
        before: dict[int, int | None] = {}
        while not self.connection.poll(_PATIENCE_S):
            now = {child: ticks_asleep(child) for child in children(self.keeper)}
            if now == before and None not in now.values():
                for child in now:
                    os.kill(child, signal.SIGKILL)
                return bool(now)
            before = now
        return False


class _Links:
    """The links of this process and of its copies to what answers: that of a copy is made when it first asks.

    That of this process is made at once, so that what is opened later, such as a connection to a controller, is not
    open in what answers. That of a copy ends with it.
    """

    def __init__(self, models: Sequence[LoadedModel]) -> None:
        self._models, self._lock = models, threading.Lock()
        self._of_process = {os.getpid(): _Link.to(models)}

    def ask(self, number: int, rows: FloatArray) -> Any:
        """The answer of a model, or a refusal."""
        with self._lock:
            link = self._of_process.get(os.getpid())
            if link is None:
                link = self._of_process[os.getpid()] = _Link.to(self._models)
        return link.ask(number, rows)

    def end(self) -> None:
        """End the link of this process."""
        if link := self._of_process.get(os.getpid()):
            link.end()


def _remote(model: LoadedModel, number: int, links: _Links) -> Predictor:
    """The predictor of a model that asks the other process."""

    def predict(rows: FloatArray) -> FloatArray:
        if not len(rows):  # which some libraries refuse
            return np.zeros((0, len(model.ir.outputs)))
        answer = links.ask(number, rows)
        if isinstance(answer, _Refusal):
            raise LibraryRefusesError(_refused(lambda some: links.ask(number, some), rows, answer.reason))
        found: FloatArray = answer
        return found

    return predict


def _refused(ask: Callable[[FloatArray], Any], rows: FloatArray, reason: str) -> str:
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
