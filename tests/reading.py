"""Structured Text that was read before, in whatever folder: most of what the tests read is what another one has read.

What a text means is kept as bytes, from which a new tree is made each time: no test has a part of another one's.
"""

import contextlib
import io
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from st_codegen.st import tree
from st_codegen.st.errors import Position
from st_codegen.st.syntax import source
from st_codegen.st.types import UNKNOWN

#: What is kept, in bytes, and what a single text may take of it.
_MOST = 100_000_000
_MOST_OF_ONE = 2_000_000
#: What stands in trees before the check, and is compared by identity.
_SHARED = {"type": UNKNOWN, "parameter": tree._UNDECLARED}


class _Keeping(pickle.Pickler):
    """Leaves out the path of the file, which is another one the next time, and what all trees share."""

    def __init__(self, file: io.BytesIO, path: str) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._path = path
        self.dispatch_table = {Position: lambda at: (Position, (at.file, at.line, at.column, at.pou))}

    def persistent_id(self, thing: Any) -> str | None:
        if thing.__class__ is str:
            return "path" if thing == self._path else None
        if thing is UNKNOWN:
            return "type"
        return "parameter" if thing is tree._UNDECLARED else None


class _Giving(pickle.Unpickler):
    def __init__(self, kept: bytes, path: str) -> None:
        super().__init__(io.BytesIO(kept))
        self._path = path

    def persistent_load(self, what: str) -> Any:
        return self._path if what == "path" else _SHARED[what]


class Remembered:
    """Reads the text of a file (its path, its bytes) once for all paths that end in the same name."""

    def __init__(self, read: Callable[[str, bytes], Any]) -> None:
        self.read = read
        self._kept: dict[tuple[str, bytes], bytes] = {}
        self._size = 0

    def __call__(self, path: str, content: bytes) -> Any:
        key = Path(path).name, content
        if key in self._kept:
            return _Giving(self._kept[key], path).load()
        found = self.read(path, content)
        if len(content) < _MOST_OF_ONE:
            self._keep(key, path, found)
        return found

    def _keep(self, key: tuple[str, bytes], path: str, found: Any) -> None:
        file = io.BytesIO()
        try:
            _Keeping(file, path).dump(found)
        except RecursionError:  # a chain of thousands of operators
            return
        self._kept[key] = file.getvalue()
        self._size += len(key[1]) + len(self._kept[key])
        while self._size > _MOST:
            oldest = next(iter(self._kept))
            self._size -= len(oldest[1]) + len(self._kept.pop(oldest))


@contextlib.contextmanager
def remembered() -> Iterator[None]:
    """All that this process reads is remembered."""
    read = source._read_one
    source._read_one = Remembered(read)
    try:
        yield
    finally:
        source._read_one = read
