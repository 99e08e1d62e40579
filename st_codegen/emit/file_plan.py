"""What a target hands to the printer: a file with its template, and the form of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.blocks.listing import Block


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
