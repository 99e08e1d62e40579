"""What the compiler has written is read back before anybody gets it.

Who reads loads the reader of Structured Text: mostly a copy, while this process loads models.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING

from st_codegen.errors import DefectError, GeneratedCodeError
from st_codegen.processes import can_be_copied, make_copy, other_processors

if TYPE_CHECKING:
    from st_codegen.proof.runner import GeneratedCode

#: Problems that a message lists.
_NAMED = 5


def check_emitted(folder: Path, dialect: str, *, portable: bool) -> GeneratedCode:
    """Read the text of a folder as a strict compiler would, and look for what no generated text may have.

    `portable`: the text claims to be of the portable subset as a whole. Returns the text; raises DefectError that lists
    what is wrong.
    """
    from st_codegen.proof.runner import GeneratedCode
    from st_codegen.st.check.portable import single_rounds, violations_in

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
    return code


class Reader:
    """Who reads generated text: a copy of this process that reads each file while the next ones are written, or nobody.

    The copy only spares time: where it does not find a folder in order, `check_emitted` says why.
    """

    def __init__(self, child: int | None = None, told: int = -1, answers: int = -1) -> None:
        self._child, self._told, self._answers = child, told, answers

    @classmethod
    def made(cls) -> Reader:
        """A copy that reads; nobody where a copy would have no processor."""
        if not (can_be_copied() and other_processors()):
            return cls()
        reading, told = os.pipe()
        answers, answering = os.pipe()

        def read() -> None:
            os.close(told)
            os.close(answers)
            from st_codegen.st.syntax.parser import get_ready
            from st_codegen.st.syntax.source import read_ahead

            get_ready()
            import st_codegen.proof.runner  # noqa: F401 - the rest of what reads

            with os.fdopen(reading) as lines:
                for path, dialect, portable in map(json.loads, lines):
                    if dialect is None:
                        read_ahead(Path(path))
                    else:
                        check_emitted(Path(path), dialect, portable=portable)
                        os.write(answering, b"\n")

        child = make_copy(read)
        os.close(reading)
        os.close(answering)
        return cls(child, told, answers)

    def tell(self, path: Path) -> None:
        """Say that a file is written."""
        self._say(path, None, portable=False)

    def finds_in_order(self, folder: Path, dialect: str, *, portable: bool) -> bool:
        """Whether the copy has read a whole folder, and `check_emitted` raised nothing."""
        self._say(folder, dialect, portable=portable)
        return self._child is not None and os.read(self._answers, 1) != b""  # it ends where it finds something

    def _say(self, path: Path, dialect: str | None, *, portable: bool) -> None:
        if self._child is not None:
            with suppress(BrokenPipeError):  # it has ended
                os.write(self._told, f"{json.dumps([str(path), dialect, portable])}\n".encode())

    def end(self) -> None:
        """Leave no copy behind."""
        if self._child is not None:
            os.kill(self._child, signal.SIGKILL)
            os.waitpid(self._child, 0)
            os.close(self._told)
            os.close(self._answers)
            self._child = None


@contextmanager
def read_meanwhile(generated: Path) -> Iterator[None]:
    """Have a copy of this process read generated text while the block loads models.

    It only spares time: what is wrong with the text, or with the copy, is found when the text is read here.
    """
    if not (can_be_copied() and other_processors()):
        yield
        return
    with os.fdopen(os.memfd_create("read"), "w+b") as file:

        def read() -> None:
            from st_codegen.proof.runner import target_folders
            from st_codegen.st.syntax.source import pass_on, read_ahead

            for folder in target_folders(generated):
                for path in sorted(folder.rglob("*")):
                    read_ahead(path)
            pass_on(file)
            file.flush()

        child = make_copy(read)
        try:
            yield
            status = os.waitpid(child, 0)[1]
        except BaseException:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise
        if not status:
            from st_codegen.st.syntax.source import take_over

            file.seek(0)
            take_over(file)


#: Who reads all that is written, where `one_reader` says so.
_ONE: ContextVar[Reader | None] = ContextVar("_ONE", default=None)


@contextmanager
def one_reader() -> Iterator[None]:
    """Have all text that is written inside the block read by one copy, which gets ready while models are loaded."""
    made = Reader.made()
    token = _ONE.set(made)
    try:
        yield
    finally:
        _ONE.reset(token)
        made.end()


@contextmanager
def reader(*, is_large: bool) -> Iterator[Reader]:
    """One who reads text as `check_emitted` does: that of `one_reader`, or a new one where the text `is_large`."""
    one = _ONE.get()
    if one is not None:
        yield one
        return
    if is_large:
        import st_codegen.proof.runner  # noqa: F401 - a copy cannot finish what another thread had begun to import
    made = Reader.made() if is_large else Reader()
    try:
        yield made
    finally:
        made.end()
