"""What a target is: limits of its dialect, and a list of files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from st_codegen.blocks.application import Application
from st_codegen.blocks.model import Limits
from st_codegen.blocks.project import application_of
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


class Target(ABC):
    """A dialect of Structured Text and the files it comes in.

    `dialect` is twincat or iec: the folder of templates whose `dialect.st.j2` says how the dialect writes what differs,
    and the rules by which the text is checked and executed.
    """

    name: str
    summary: str
    dialect: str
    limits: Limits

    def plan(self, project: ProjectIR, limits: Limits) -> Iterable[FilePlan]:
        """The files of a project, in a fixed order. Raises InputError or TargetError before anything is printed."""
        return self.files(application_of(project, limits))

    @abstractmethod
    def files(self, application: Application) -> Iterable[FilePlan]:
        """The files of an application, in a fixed order. Raises TargetError for what they cannot express."""
