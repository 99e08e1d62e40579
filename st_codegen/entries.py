"""Tables into which rooms enter what they bring: targets, kinds of model files, readers of bundles.

A room enters its own when it is imported. The package names the rooms that bring something (`announce`), and the first
look into any of these tables imports them: nothing is loaded by those who look into none, as `st-codegen --help`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, MutableMapping
from typing import TypeVar

_V = TypeVar("_V")
_announced: list[str] = []


def announce(*rooms: str) -> None:
    """Name the modules that enter something when they are imported."""
    _announced.extend(rooms)


class Entries(MutableMapping[str, _V]):
    """A table by name, in the order of entering."""

    def __init__(self, own: Mapping[str, _V] | None = None) -> None:
        self._entered = dict(own or {})

    def __setitem__(self, name: str, value: _V) -> None:
        self._entered[name] = value

    def __delitem__(self, name: str) -> None:
        del self._complete()[name]

    def __getitem__(self, name: str) -> _V:
        return self._complete()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._complete())

    def __len__(self) -> int:
        return len(self._complete())

    def _complete(self) -> dict[str, _V]:
        while _announced:
            room = _announced[0]
            importlib.import_module(room)  # one that fails stays, and fails again at the next look
            _announced[:] = [other for other in _announced if other != room]
        return self._entered
