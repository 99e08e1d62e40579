"""External sources of SCL (.scl): their own words are blanked, so that the rest is read as portable text.

Read are blocks and data types; of data blocks only instances, which have no text of their own. Static arrays with start
values are tables, since SCL has no constant arrays: they are read as constants, and a text that writes to one is
refused as any that writes to a constant.
"""

from __future__ import annotations

import re
from dataclasses import replace

from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import parse_scanned
from st_codegen.st.syntax.scan import Scanned, Segment, scan
from st_codegen.st.tree import Section

_TOKEN = re.compile(
    r"\(\*.*?\*\)|//[^\r\n]*|'[^'\r\n]*'|\{[^}]*\}|\"[^\"\r\n]*\"|"
    r"[A-Za-z_]\w*(?:#[\w.]+)+|\d+#\w+|[A-Za-z_]\w*|\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|\s+|:=|=>|.",
    re.DOTALL,
)
_IGNORED = re.compile(r"\s|\(\*|//|\{")
_DATA_BLOCK = re.compile(r"DATA_BLOCK\b.*?\bEND_DATA_BLOCK\b", re.DOTALL | re.IGNORECASE)
_VERSION = re.compile(r"VERSION\s*:\s*\d+\.\d+", re.IGNORECASE)
_REGION = re.compile(r"REGION\b[^\r\n]*", re.IGNORECASE)
_VISIBLE = re.compile(r"[^\r\n]")
_BLANKED = ("BEGIN", "END_REGION")


def read_scl(name: str, text: str) -> tuple[list[d.Declaration], list[Scanned]]:
    """The declarations of one source and its scanned text. Raises `StSyntaxError` for what is not read."""
    segment = Segment(text, name)
    scanned = scan(Segment(_lowered(segment), name))
    found = parse_scanned(scanned)
    return [_with_tables(item) if isinstance(item, d.PouDeclaration) else item for item in found], [scanned]


def _blank(text: str) -> str:
    return _VISIBLE.sub(" ", text)


def _lowered(segment: Segment) -> str:
    """The text with every character at its place, and blanks for what only SCL has."""
    text, at = segment.text, 0
    pieces: list[str] = []
    calls: list[str] = []
    last = ""
    in_type = False
    while (match := _TOKEN.match(text, at)) is not None:
        token, start, at = match[0], at, match.end()
        word = token.upper()
        if _IGNORED.match(token):
            pieces.append(token)
            continue
        whole = {"DATA_BLOCK": _DATA_BLOCK, "VERSION": _VERSION, "REGION": _REGION}.get(word)
        found = whole.match(text, start) if whole is not None else None
        if found is not None:
            at = found.end()
            if word == "DATA_BLOCK" and re.search(r"\b(?:VAR|STRUCT)\b", found[0], re.IGNORECASE):
                raise segment.error(start, "of data blocks only instances of function blocks are read")
            pieces.append(_version(found[0], in_type) if word == "VERSION" else _blank(found[0]))
            continue
        in_type = (in_type or word == "TYPE") and word not in ("STRUCT", "END_TYPE")
        if token == "(":
            calls.append(last)
        elif token == ")" and calls:
            calls.pop()
        following = re.compile(r"\s*:=").match(text, at)
        if re.fullmatch(r"IN\d+", word) and calls and calls[-1] in ("MIN", "MAX") and last in ("(", ",") and following:
            at = following.end()
            pieces.append(_blank(text[start:at]))
            continue
        if token[0] == '"':
            pieces.append(_quoted(segment, token, start))
        elif token == "#" or word in _BLANKED:
            pieces.append(_blank(token))
        else:
            pieces.append("TRUNC     " if word == "TRUNC_DINT" else token)
        last = "TRUNC" if word == "TRUNC_DINT" else word
    return "".join(pieces)


def _version(text: str, in_type: bool) -> str:
    """Blanks, and in a data type the colon that separates its name from its fields."""
    at = text.index(":")
    return _blank(text[:at]) + (":" if in_type else " ") + _blank(text[at + 1 :])


def _quoted(segment: Segment, token: str, start: int) -> str:
    if re.fullmatch(r'"[A-Za-z_]\w*"', token, re.ASCII) is None:
        raise segment.error(start, f"the name {token} is not read: letters, digits and underscores, a letter first")
    return f" {token[1:-1]} "


def _with_tables(pou: d.PouDeclaration) -> d.PouDeclaration:
    """The unit with its static arrays that have start values as constants."""
    blocks: list[d.VariableBlock] = []
    for block in pou.blocks:
        tables = tuple(item for item in block.variables if _is_table(item))
        if block.section is not Section.VAR or block.qualifiers or not tables:
            blocks.append(block)
            continue
        others = tuple(item for item in block.variables if not _is_table(item))
        blocks += [replace(block, variables=others)] if others else []
        blocks.append(replace(block, variables=tables, qualifiers=frozenset({"CONSTANT"})))
    return replace(pou, blocks=tuple(blocks))


def _is_table(variable: d.VariableDeclaration) -> bool:
    return isinstance(variable.type, d.ArraySpec) and variable.initial is not None
