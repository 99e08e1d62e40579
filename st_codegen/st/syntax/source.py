"""Where Structured Text comes from: texts, plain `.st` files, TwinCAT files, PLCopen XML, folders of them."""

from __future__ import annotations

import contextlib
import gc
import pickle
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from st_codegen.errors import InputError
from st_codegen.st.errors import Position, Problem, StSyntaxError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import parse_scanned
from st_codegen.st.syntax.plcopen_xml import looks_like_plcopen, read_plcopen
from st_codegen.st.syntax.scan import Scanned, Segment, scan
from st_codegen.st.syntax.scl import read_scl
from st_codegen.st.syntax.twincat_xml import read_xml

MAX_BYTES = 1 << 30
_BEGINNING = 1 << 12
_XML = {".tcpou": read_xml, ".tcgvl": read_xml, ".tcdut": read_xml, ".xml": read_plcopen}
#: Suffixes of files that are plain Structured Text, and of all files that are read.
PLAIN = (".st", ".scl")
SUFFIXES = (*PLAIN, *_XML)
_EXPECTED = ".st, .scl, .TcPOU, .TcGVL, .TcDUT or PLCopen's .xml"
#: What files were when they were read ahead, and what they say.
_AHEAD: dict[str, tuple[bytes, tuple[list[d.Declaration], list[Scanned]]]] = {}


@dataclass(frozen=True)
class ParsedFiles:
    """All declarations of a project, in the order of the files, and the texts they came from."""

    declarations: tuple[d.Declaration, ...]
    scans: tuple[Scanned, ...]


def read_texts(texts: Mapping[str, str]) -> ParsedFiles:
    """Parse texts given by name; .TcPOU, .TcGVL and .TcDUT are TwinCAT's XML, .xml is PLCopen's, .scl is Siemens'.

    Raises `StSyntaxError` with the first error of every text.
    """
    return _read((name, text.encode("utf-8", "surrogatepass")) for name, text in texts.items())


def read_paths(paths: Iterable[Path | str]) -> ParsedFiles:
    """Parse files and folders; of folders all files of `SUFFIXES` by name, `.xml` where it is PLCopen's.

    Raises `StSyntaxError` with the first error of every file, `InputError` for a path that does not exist, a file that
    is no Structured Text, or a folder without any.
    """
    return _read((path.as_posix(), _content(path)) for path in _files(paths))


def read_ahead(path: Path) -> None:
    """Parse a file whose folder is read later, by `read_paths` in this process; errors are left to that."""
    if _is_structured_text(path):
        with contextlib.suppress(StSyntaxError, InputError):
            content = _content(path)
            _AHEAD[path.as_posix()] = content, _read_one(path.as_posix(), content)


def pass_on(file: IO[bytes]) -> None:
    """Write what was read ahead for another process of this program."""
    pickle.dump(_AHEAD, file, 5)


def take_over(file: IO[bytes]) -> None:
    """Read what another process of this program passed on, as if it had been read ahead here."""
    collects = gc.isenabled()
    gc.disable()  # which would look through millions of new objects, of which none is garbage
    try:
        _AHEAD.update(pickle.load(file))
    finally:
        if collects:
            gc.enable()


def _files(paths: Iterable[Path | str]) -> Iterator[Path]:
    for path in map(Path, paths):
        if path.is_dir():
            found = sorted(file for file in path.rglob("*") if _is_structured_text(file))
            if not found:
                raise InputError(f"{path}: no {_EXPECTED} file in this folder")
            yield from found
        elif not path.is_file():
            raise InputError(f"{path}: no such file or folder")
        elif path.suffix.lower() not in SUFFIXES:
            raise InputError(f"{path}: not Structured Text: {_EXPECTED} is expected")
        else:
            yield path


def _is_structured_text(path: Path) -> bool:
    """By the suffix; other XML files may stand in the same folder, so these are looked into."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES or not path.is_file():
        return False
    if suffix != ".xml":
        return True
    with path.open("rb") as file:
        return looks_like_plcopen(file.read(_BEGINNING))


def _content(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size} bytes are more than the limit of {MAX_BYTES}")
    return path.read_bytes()


def _read(files: Iterable[tuple[str, bytes]]) -> ParsedFiles:
    read: dict[str, tuple[list[d.Declaration], list[Scanned]]] = {}
    problems: list[Problem] = []
    for name, content in files:
        try:
            before, known = _AHEAD.pop(name, (None, None))
            read[name] = known if known is not None and before == content else _read_one(name, content)
        except StSyntaxError as error:
            problems += error.problems
    problems += _without_twins(read)
    if problems:
        raise StSyntaxError(problems)
    declarations = tuple(item for found, _ in read.values() for item in found)
    return ParsedFiles(declarations, tuple(item for _, scans in read.values() for item in scans))


def _without_twins(read: dict[str, tuple[list[d.Declaration], list[Scanned]]]) -> Iterator[Problem]:
    """Take out each `.st` file beside an `.xml` file of the same name: one project in two forms.

    What the text declares otherwise than the XML does is a problem.
    """
    for name in [name for name in read if name.endswith(".st") and f"{name.removesuffix('.st')}.xml" in read]:
        twin = f"{name.removesuffix('.st')}.xml"
        known = {item.name.upper(): item for item in read[twin][0]}
        for item in read.pop(name)[0]:
            if known.get(item.name.upper()) != item:
                message = f"{item.name} is declared otherwise than in {Path(twin).name}"
                yield Problem(item.position or Position(name, 1, 1), message)


def _read_one(name: str, content: bytes) -> tuple[list[d.Declaration], list[Scanned]]:
    reader = _XML.get(Path(name).suffix.lower())
    if reader is not None:
        return reader(name, content)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"not UTF-8 text ({error.reason} at byte {error.start})"
        raise StSyntaxError([Problem(Position(name, 1, 1), message)]) from None
    if Path(name).suffix.lower() == ".scl":
        return read_scl(name, text)
    scanned = scan(Segment(text, name))
    return parse_scanned(scanned), [scanned]
