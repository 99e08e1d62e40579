"""Answers that are kept as long as what was asked about: many questions are put to the same arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar
from weakref import ref

_Answer = TypeVar("_Answer")


class KeptAnswers(Generic[_Answer]):
    """The answers to the last few questions; one goes with the first of the objects that it is about."""

    def __init__(self, most: int = 1) -> None:
        self._most = most
        self._entries: list[tuple[tuple[ref[object], ...], object, _Answer]] = []

    def of(self, asked: tuple[object, ...], found: Callable[[], _Answer], beside: object = None) -> _Answer:
        """What was found for these very objects, and something equal beside them; or is found now.

        The entries are taken once: of several threads each one gets what it asked for.
        """
        for refs, other, known in tuple(self._entries):
            if other == beside and all(one() is its for one, its in zip(refs, asked, strict=True)):
                return known
        known = found()
        entry = (tuple(ref(one, self._forget) for one in asked), beside, known)
        self._entries[:] = [entry, *self._entries[: self._most - 1]]
        return known

    def _forget(self, _: ref[object]) -> None:
        self._entries[:] = [entry for entry in self._entries if all(one() is not None for one in entry[0])]
