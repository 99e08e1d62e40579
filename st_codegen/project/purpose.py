"""What models are for, as far as the compiler has to know.

A lone folder of models has no purpose: every model is a block of its own. With a purpose the models are called
together, and it adds to each stage what belongs to it. The stages know this protocol; what a purpose is (the
transmission error of a reducer, say) is known in its own room alone, which enters the reader of its configuration file
into a table (`bundle.READERS`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.comparison import CalledBlock
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.entries import Entries
from st_codegen.ir import BoolArray, ComplexArray, FloatArray, ModelIR
from st_codegen.passes.choose import Options
from st_codegen.passes.pipeline import Compiled
from st_codegen.walkers.base import LoadedModel

#: A bound on |library - generated code| of a model for rows (rows, features), shape (rows, outputs).
DifferenceBound = Callable[[ModelIR, FloatArray], FloatArray]


@dataclass(frozen=True)
class BlockCheck:
    """Rows for one block, its expected and its actual outputs, and how far these may lie apart."""

    block: str
    inputs: FloatArray
    expected: FloatArray
    got: FloatArray
    bound: FloatArray


class RunsBlocks(Protocol):
    """Generated text that can be run (`proof.runner.GeneratedCode`)."""

    folder: Path

    def call(
        self, block: str, inputs: Mapping[str, FloatArray], lanes: int, *, calls: int = 1
    ) -> dict[str, FloatArray]:
        """All outputs of a block, called `calls` times with an array for each named input."""
        ...


#: What `diff` compares of a block around the models, by the block's name: it runs the block with its named inputs, and
#: gives a complex number for each thing that the block answers, and where it answers at all.
ANSWERS: Entries[Callable[[RunsBlocks, Mapping[str, FloatArray]], tuple[dict[str, ComplexArray], BoolArray]]] = (
    Entries()
)


class Purpose(Protocol):
    """What a purpose adds to the stages of the compiler."""

    def settled(self, compiled: Compiled, options: Options) -> Purpose:
        """The purpose of the compiled models, which may compute several of the user's models in one."""
        ...

    def application(self, *, recorded: bool = False) -> Application:
        """The project's name and all that surrounds the models' blocks; `recorded`: with what `record` needs.

        Raises InputError for names that clash.
        """
        ...

    def uses(self) -> Mapping[str, str]:
        """For each model, in a word that may be part of a folder's name, what it predicts."""
        ...

    def facts(self) -> dict[str, Any]:
        """What a reviewer asks first, for the manifest and for the comparison of two projects."""
        ...

    def remarks(self) -> tuple[str, ...]:
        """Sentences that a user should read before the generated code is used."""
        ...

    def served(self, models: Sequence[ModelIR]) -> tuple[str, ...]:
        """Which file, and which of its outputs, serves what: a verification compares numbers and cannot see it."""
        ...

    def vectors(self, models: Sequence[LoadedModel]) -> tuple[ReferenceVectors, ...]:
        """What the blocks around the models must answer, by the models' libraries, for test suites."""
        ...

    def called_blocks(self) -> tuple[CalledBlock, ...]:
        """The blocks around the models that a controller's program calls, of which `prove` shows what always holds.

        Their inputs are those that `checks` sets.
        """
        ...

    def checks(
        self,
        models: Sequence[ModelIR],
        code: RunsBlocks,
        seed: int,
        bound: DifferenceBound,
        names: Collection[str] = (),
    ) -> Sequence[BlockCheck]:
        """The blocks around the models, or those of some names, run and compared with what they must compute from the
        models alone."""
        ...
