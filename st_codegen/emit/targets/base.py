"""What a target is: limits of its dialect, and a list of files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.blocks.model import Limits, model_block
from st_codegen.emit.blocks.project import application_of
from st_codegen.emit.blocks.tests import ReferenceVectors, with_tests
from st_codegen.ir import BoolArray, FloatArray, ModelIR, ProjectIR
from st_codegen.proof import bounds


@dataclass(frozen=True)
class FilePlan:
    """A file to write: its path below the target's folder, the template that prints it and what that prints.

    `twincat_xml`: starts with a byte order mark and ends without a line end, as TwinCAT writes its files.
    """

    path: str
    template: str
    values: Mapping[str, Any]
    twincat_xml: bool = False

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The function blocks that the file prints."""
        one = self.values.get("block")
        return tuple(self.values.get("blocks", () if one is None else (one,)))


class Target(ABC):
    """A dialect of Structured Text and the files it comes in.

    `dialect` is twincat or iec: the folder of templates whose `dialect.st.j2` says how the dialect writes what differs,
    and the rules by which the text is checked and executed. `compiles`: the passes rewrite the models first; False for
    a target that hands the models themselves on. `has_tests`: test suites can be written. `proof`: what
    verification does not show, where it is less than the text that runs on the controller.
    """

    name: str
    summary: str
    dialect: str
    limits: Limits
    compiles: bool = True
    has_tests: bool = False
    proof: str = ""

    def plan(self, project: ProjectIR, limits: Limits, vectors: Sequence[ReferenceVectors] = ()) -> Iterable[FilePlan]:
        """The files of a project, in a fixed order, with test suites for `vectors`.

        Raises InputError or TargetError before anything is printed.
        """
        application = application_of(project, lambda model: model_block(model, limits))
        return self.files(with_tests(application, vectors))

    @abstractmethod
    def files(self, application: Application) -> Iterable[FilePlan]:
        """The files of an application, in a fixed order. Raises TargetError for what they cannot express."""

    def difference_bound(self, model: ModelIR, x: FloatArray) -> FloatArray:
        """How far a model's block may lie from the library for rows of `x` (rows, features), shape (rows, outputs)."""
        return bounds.difference_bound(model, x)

    def answers(self, model: ModelIR, x: FloatArray) -> BoolArray:
        """The rows of `x` for which a model's block gives an answer where the library does, shape (rows,)."""
        return np.ones(len(x), np.bool_)
