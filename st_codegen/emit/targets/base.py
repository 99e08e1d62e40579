"""What a target is, and the table of those that there are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.blocks.model import Limits, model_block
from st_codegen.emit.blocks.tests import ReferenceVectors, with_tests
from st_codegen.emit.contents import Contents
from st_codegen.entries import Entries
from st_codegen.errors import InputError


@dataclass(frozen=True)
class FileForm:
    """How a text becomes a file: a byte order mark in front, the end of each line, and whether the last line has one.

    Development environments keep the form of a file that they save, and compare badly where it is another.
    """

    has_mark: bool = False
    line_end: str = "\n"
    ends_last_line: bool = True


PLAIN = FileForm()


@dataclass(frozen=True)
class FilePlan:
    """A file to write: its path below the target's folder, the template that prints it and what that prints."""

    path: str
    template: str
    values: Mapping[str, Any]
    form: FileForm = PLAIN

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The function blocks that the file prints."""
        one = self.values.get("block")
        return tuple(self.values.get("blocks", () if one is None else (one,)))


class Target(ABC):
    """A dialect of Structured Text and the files it comes in.

    `dialect` names the rules by which the text is checked and executed. `templates` is the folder of templates whose
    `dialect.st.j2` says how the dialect writes what differs. `compiles` says whether the passes rewrite the models
    first; a target that hands the models themselves on has False. `has_tests` says whether test suites can be written,
    `has_configuration` whether a CONFIGURATION can, `has_comparison` whether programs for `compare` and `record` can,
    `has_project_forms` whether there is a choice of `ProjectForm`, `may_lack_lreal` whether controllers without LREAL
    are among those that it is for, `lreal_note` which of its vendor it is not for, `is_portable` whether all of the
    text is of the subset that strict compilers of other vendors accept.
    """

    name: str
    summary: str
    dialect: str
    templates: str
    limits: Limits
    compiles: bool = True
    has_tests: bool = False
    has_configuration: bool = False
    has_comparison: bool = False
    has_project_forms: bool = False
    is_portable: bool = False
    may_lack_lreal: bool = False
    lreal_note: str = ""

    def plan(self, contents: Contents, limits: Limits, vectors: Sequence[ReferenceVectors] = ()) -> Iterable[FilePlan]:
        """The files of a project, in a fixed order, with test suites for `vectors`.

        Raises InputError or TargetError before anything is printed.
        """
        application = contents.application(lambda model, extras: model_block(model, limits, extras))
        return self.files(with_tests(application, vectors))

    @abstractmethod
    def files(self, application: Application) -> Iterable[FilePlan]:
        """The files of an application, in a fixed order. Raises TargetError for what they cannot express."""


#: All targets by name.
TARGETS: Entries[Target] = Entries()


def enter_target(target: Target) -> None:
    """Enter a target into the table; its name is the value of `--target` and the folder of its output."""
    TARGETS[target.name] = target


def target_named(name: str) -> Target:
    """The target of a name. Raises InputError that lists all names."""
    try:
        return TARGETS[name]
    except KeyError:
        raise InputError(f"no target '{name}'; choose from {', '.join(sorted(TARGETS))}") from None
