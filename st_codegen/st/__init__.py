"""Structured Text: parser, checker and engine. Knows nothing of the code generator, whose output it judges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from st_codegen.st.check.check import check
from st_codegen.st.dialects import DIALECTS, TWINCAT, Dialect, find_dialect
from st_codegen.st.errors import Position, Problem, StCheckError, StError, StRuntimeError, StSyntaxError, StUsageError
from st_codegen.st.run.machine import Machine
from st_codegen.st.run.natives import Library, NativeBlock, NativeCall
from st_codegen.st.syntax.source import ParsedFiles, read_paths, read_texts
from st_codegen.st.tree import Project

__all__ = [
    "DIALECTS",
    "Dialect",
    "Library",
    "Machine",
    "NativeBlock",
    "NativeCall",
    "Position",
    "Problem",
    "Project",
    "StCheckError",
    "StError",
    "StRuntimeError",
    "StSyntaxError",
    "StUsageError",
    "check_source",
    "load_project",
    "parse_project",
    "read_paths",
]


def load_project(
    paths: Iterable[Path | str], dialect: Dialect | str = TWINCAT, libraries: Iterable[Library] = ()
) -> Project:
    """Read and check files and folders of Structured Text.

    Folders are searched for `.st`, `.TcPOU`, `.TcGVL`, `.TcDUT` and PLCopen's `.xml` files. Raises `StSyntaxError` or
    `StCheckError` with all problems, `InputError` for paths that cannot be read.
    """
    return check_source(read_paths(paths), dialect, libraries)


def parse_project(
    texts: Mapping[str, str], dialect: Dialect | str = TWINCAT, libraries: Iterable[Library] = ()
) -> Project:
    """Check texts given by file name. Raises `StSyntaxError` or `StCheckError` with all problems."""
    return check_source(read_texts(texts), dialect, libraries)


def check_source(source: ParsedFiles, dialect: Dialect | str, libraries: Iterable[Library]) -> Project:
    """Check what was read (`read_paths`). Raises `StCheckError` with all problems."""
    native, ordinary = [], []
    libraries = tuple(libraries)
    for library in libraries:
        parts = library.declarations()
        native += parts[0]
        ordinary += parts[1]
    together = ParsedFiles((*ordinary, *source.declarations), source.scans)
    return check(together, find_dialect(dialect), native, (library.name for library in libraries))
