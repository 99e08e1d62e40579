"""What stands behind the numbers of a target: how far its blocks may lie from the library, and what they answer.

Text that computes a model itself does so by the model's operations. A target whose text hands the work to something
else (a runtime with files of its own) enters here what that computes; one that is not entered is of the first kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from st_codegen.emit.blocks.comparison import PROGRAM
from st_codegen.entries import Entries
from st_codegen.ir import BoolArray, FloatArray, ModelIR
from st_codegen.proof.bounds import text_bound

if TYPE_CHECKING:
    from st_codegen.st import Library


@dataclass(frozen=True)
class Arithmetic:
    """How the blocks of a target compute their models.

    `bound` says how far a model's block may lie from the reference for rows (rows, features), shape (rows, outputs),
    and `answers` for which of the rows it gives an answer where the library does, shape (rows,). `note` says what
    verification does not show, where that is less than the text that runs on the controller.
    """

    bound: Callable[[ModelIR, FloatArray], FloatArray] = text_bound
    answers: Callable[[ModelIR, FloatArray], BoolArray] = lambda _, x: np.ones(len(x), np.bool_)
    note: str = ""


_OWN_TEXT = Arithmetic()
#: The arithmetic of the targets whose text does not compute the models itself, by the target's name.
ARITHMETIC: Entries[Arithmetic] = Entries()


def arithmetic_of(target: str) -> Arithmetic:
    """The arithmetic of a target, by its name."""
    return ARITHMETIC.get(target, _OWN_TEXT)


def _beside(library: str, pattern: str) -> Callable[[Path], Library | None]:
    """A library (of `st.run.library`) that is needed where a folder has files of a pattern."""

    def offered(folder: Path) -> Library | None:
        from st_codegen.st.run import library as known

        found: Library = getattr(known, library)
        return found if any(folder.glob(pattern)) else None

    return offered


#: For each library that generated text may call, whether (and with which contents) a generated folder needs it.
LIBRARIES: Entries[Callable[[Path], Library | None]] = Entries(
    {
        "unit tests": _beside("TCUNIT", "Tests/*"),
        "strings": _beside("TC2_STANDARD", "Tests/*"),
        "system": _beside("TC2_SYSTEM", f"**/{PROGRAM}.*"),
    }
)


def libraries_of(folder: Path) -> tuple[Library, ...]:
    """The libraries that the text of a generated folder may call."""
    found = (offered(folder) for offered in LIBRARIES.values())
    return tuple(library for library in found if library is not None)
