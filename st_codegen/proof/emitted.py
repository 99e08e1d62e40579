"""What the compiler has written is read back before anybody gets it."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from st_codegen.errors import DefectError, GeneratedCodeError
from st_codegen.processes import can_be_copied, make_copy, other_processors
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st.check.generated import single_rounds
from st_codegen.st.check.portable import violations_in
from st_codegen.st.syntax.source import read_ahead

#: Problems that a message lists.
_NAMED = 5


def check_emitted(folder: Path, dialect: str, *, portable: bool) -> None:
    """Read the text of a folder as a strict compiler would, and look for what no generated text may have.

    `portable`: the text claims to be of the portable subset as a whole. Raises DefectError that lists what is wrong.
    """
    try:
        code = GeneratedCode(folder, dialect)
        problems = single_rounds(code.project)
        if portable:
            problems += violations_in(code.source, code.project)
    except GeneratedCodeError as error:
        raise DefectError(f"st-codegen wrote text that it cannot read itself, please report this: {error}") from error
    if problems:
        shown = [f"  - {problem}" for problem in problems[:_NAMED]]
        shown += [f"  - and {len(problems) - _NAMED} more"] if len(problems) > _NAMED else []
        raise DefectError("\n".join(["st-codegen wrote text that it must not write, please report this:", *shown]))


class Reader:
    """Who reads generated text: a copy of this process that reads each file while the next ones are written, or nobody.

    The copy only spares time: where it does not find a folder in order, `check_emitted` says why.
    """

    def __init__(self, child: int | None = None, told: int = -1) -> None:
        self._child, self._told = child, told

    def tell(self, path: Path) -> None:
        """Say that a file is written, or a whole folder."""
        if self._child is not None:
            with suppress(BrokenPipeError):  # it has ended
                os.write(self._told, f"{json.dumps(str(path))}\n".encode())

    def finds_in_order(self, folder: Path) -> bool:
        """Whether the copy has read the folder, and `check_emitted` raised nothing."""
        if self._child is None:
            return False
        self.tell(folder)
        child, self._child = self._child, None
        return os.waitpid(child, 0)[1] == 0

    def end(self) -> None:
        """Leave no copy behind."""
        if self._child is not None:
            os.kill(self._child, signal.SIGKILL)
            os.waitpid(self._child, 0)
        if self._told >= 0:
            os.close(self._told)


@contextmanager
def reader(dialect: str, *, portable: bool, is_large: bool) -> Iterator[Reader]:
    """One who reads text as `check_emitted` does, where it `is_large` and there is a processor for it."""
    if not (is_large and can_be_copied() and other_processors()):
        yield Reader()
        return
    reading, told = os.pipe()

    def read() -> None:
        os.close(told)
        with os.fdopen(reading) as lines:
            for path in (Path(json.loads(line)) for line in lines):
                if path.is_dir():
                    check_emitted(path, dialect, portable=portable)
                    return
                read_ahead(path)
        raise EOFError

    made = Reader(make_copy(read), told)
    os.close(reading)
    try:
        yield made
    finally:
        made.end()
