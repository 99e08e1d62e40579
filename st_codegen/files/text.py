"""Text files: one message for whatever is wrong with them, and writing that leaves a whole file or none."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from st_codegen.errors import InputError
from st_codegen.files.temporary import errors_of_disk, temporary_folder


def read_text(path: Path) -> str:
    """The text of a UTF-8 file, with or without a byte order mark; all line ends become newlines.

    Raises InputError for a file that is not there, is no file, cannot be read, or is not UTF-8.
    """
    try:
        if not path.exists():
            raise InputError(f"{path}: no such file")
        if not path.is_file():
            raise InputError(f"{path} is {'a folder' if path.is_dir() else 'no ordinary file'}; a file is wanted")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    return _decoded(path, content).replace("\r\n", "\n").replace("\r", "\n")


def file_sha256(path: Path) -> str:
    """The SHA-256 of the bytes of a file, which is read in parts. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _decoded(path: Path, content: bytes) -> str:
    if fault := encoding_fault(content):
        raise InputError(f"{path}: {fault}")
    return content.decode("utf-8-sig")


def encoding_fault(content: bytes) -> str:
    """What a text that is not UTF-8 is, and what to do; empty for one that is UTF-8."""
    try:
        content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        is_utf16 = content[:2] in (b"\xff\xfe", b"\xfe\xff")
        found = "UTF-16" if is_utf16 else f"not UTF-8 (byte 0x{content[error.start]:02x} at {error.start})"
        return f"the text is {found}; save it as UTF-8"
    return ""


def make_folder(path: Path) -> None:
    """Make a folder and those above it where they are missing. Raises InputError where one is a file or a dead link."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        found = "a file" if path.exists() else "a link to nothing"
        raise InputError(f"{path} is {found}; a folder is wanted there") from None


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path to write to, in a temporary folder beside `path`; it takes its place when the block ends without an error.

    The folder is made where it is missing. A link is followed; a device or a pipe is written to as it is. Raises
    InputError where `path` is a folder.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder; a file is to be written there")
    path = Path(os.path.realpath(path))
    if path.exists() and not path.is_file():
        with errors_of_disk(path):
            yield path
        return
    make_folder(path.parent)
    with temporary_folder(path.parent, becomes=path) as stage:
        partial = stage / path.name
        yield partial
        partial.replace(path)


def inert(text: str) -> str:
    """A text in which nothing acts on a terminal: what is not printable, but for tabs and line ends, is escaped."""
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8 with newlines; the file appears whole or not at all."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
