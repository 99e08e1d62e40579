"""Commands: what is being run, for headers and the foot of pages (a date only on demand), and what to run next."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from contextvars import ContextVar
from datetime import datetime
from pathlib import Path

VERSION = "0.2.0"
#: As in `st-codegen 1.0: st-codegen verify models --html page.html`; empty where no command runs.
MADE_BY: ContextVar[str] = ContextVar("made_by", default="")


def set_command(arguments: Sequence[str], *, dated: bool) -> None:
    """Pages that are written from now on name this command, and the day where they are to be `dated`."""
    day = f", {datetime.now().astimezone().date().isoformat()}" if dated else ""
    MADE_BY.set(f"st-codegen {VERSION}: {command_line('st-codegen', *arguments)}{day}")


# none of @ and ~, which PowerShell replaces, nor a comma, at which it parts words
_PLAIN_FOR_WINDOWS = re.compile(r"[\w+=:./\\-]+")


def command_line(*words: Path | str, windows: bool = os.name == "nt") -> str:
    """The words of a command as a shell reads them; a path that begins as an option does is told from one.

    windows: of cmd and PowerShell there, of which the first knows double quotes alone; else of any other system.
    """
    told = [str(f"./{word}" if isinstance(word, Path) and str(word)[0] == "-" else word) for word in words]
    return " ".join(map(_quoted_for_windows, told)) if windows else shlex.join(told)


def _quoted_for_windows(word: str) -> str:
    if _PLAIN_FOR_WINDOWS.fullmatch(word):
        return word
    # a backslash in front of the last quote would be taken as one of the quote's
    last = word[len(word.rstrip("\\")) :]
    return f'"{word}{last}"'
