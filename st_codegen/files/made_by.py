"""What is being run, for headers and for the foot of pages: the version and the command; a date only on demand."""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import ContextVar
from datetime import datetime

from st_codegen.files.text import command_line

VERSION = "0.2.0"
#: As in `st-codegen 1.0: st-codegen verify models --html page.html`; empty where no command runs.
MADE_BY: ContextVar[str] = ContextVar("made_by", default="")


def set_command(arguments: Sequence[str], *, dated: bool = False) -> None:
    """Pages that are written from now on name this command, and the day where they are to be `dated`."""
    day = f", {datetime.now().astimezone().date().isoformat()}" if dated else ""
    MADE_BY.set(f"st-codegen {VERSION}: {command_line('st-codegen', *arguments)}{day}")
