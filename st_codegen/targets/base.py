"""What a target is: limits of its dialect, and a list of files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from st_codegen.blocks.listing import Block
from st_codegen.blocks.model import Limits
from st_codegen.ir import ProjectIR


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

    `compiles`: the passes rewrite the models first; False for a target that hands the models themselves on.
    """

    name: str
    summary: str
    limits: Limits
    compiles: bool = True

    @abstractmethod
    def plan(self, project: ProjectIR, limits: Limits) -> Iterable[FilePlan]:
        """The files of a project, in a fixed order. Raises InputError or TargetError before anything is printed."""
