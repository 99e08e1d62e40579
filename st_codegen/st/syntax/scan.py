"""Comments and pragmas are blanked out before the grammar sees a text, so that every character keeps its place.

They are remembered: attributes belong to the declaration that follows, and the portability check asks which kinds of
comments a text uses.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import accumulate

from st_codegen.st.errors import Position, Problem, StSyntaxError

_INTERESTING = re.compile(r"""'(?:[^'$\r\n]|\$.)*+'|"(?:[^"$\r\n]|\$.)*+"|\(\*|//[^\r\n]*|'|"|\{""")
# How these begin: to look for each alone takes less time than to look for all at once
_BEGINNINGS = ("'", '"', "(*", "//", "{")
# a list of at least 16 numbers in which every exponent follows a dot; comments in it are blanks
_NUMBERS = re.compile(r"\[(?:[\s,+-]*+[0-9]++(?:\.[0-9]++(?:E[+-]?[0-9]++)?+)?+){16,}+\s*+\]")
_COMMENT_EDGE = re.compile(r"\(\*|\*\)")
#: What some compilers take for another comment.
_OTHER_EDGE = re.compile(r"/\*|\*/")
_PRAGMA = re.compile(r"\{(?:'[^'\r\n]*'|[^'}])*+\}")
_VISIBLE = re.compile(r"[^\r\n]")
_ATTRIBUTE = re.compile(r"\{\s*attribute\s+'([^']*)'\s*(?::=\s*'([^']*)'\s*)?\}", re.IGNORECASE)
_POU_START = re.compile(
    r"\b(FUNCTION_BLOCK|FUNCTION|PROGRAM|METHOD|TYPE)\s+"
    r"(?:(?:ABSTRACT|FINAL|OVERRIDE|PUBLIC|PRIVATE|PROTECTED|INTERNAL)\s+)*([A-Z_][A-Z0-9_]*)",
    re.IGNORECASE | re.ASCII,
)


class CommentKind(Enum):
    """The ways in which a comment is written."""

    BLOCK = "(* *)"
    NESTED = "(* (* *) *)"
    LINE = "//"


@dataclass(frozen=True)
class Comment:
    """A comment, which is `text[start:end]`."""

    kind: CommentKind
    start: int
    end: int


@dataclass(frozen=True)
class Pragma:
    """`{...}`: `before` is the offset of the first visible character that follows it."""

    text: str
    start: int
    before: int

    @property
    def attribute(self) -> str | None:
        """The name of an `{attribute 'name'}`, lower case, with its value after `:=` if it has one."""
        match = _ATTRIBUTE.fullmatch(self.text)
        if match is None:
            return None
        name = match[1].strip().lower()
        return name if match[2] is None else f"{name}:={match[2]}"


@dataclass(frozen=True)
class Segment:
    """A piece of Structured Text and where it starts: `line` and `column` of its first character, counted from 1.

    `pou` is the unit it belongs to; without one, the units are found in the text itself.
    """

    text: str
    file: str
    line: int = 1
    column: int = 1
    pou: str = ""

    @cached_property
    def _line_starts(self) -> list[int]:
        lengths = map(len, self.text.split("\n")[:-1])
        return list(accumulate(map((1).__add__, lengths), initial=0))

    @cached_property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """Starts and ends of what stands between long lists of numbers, of which large models consist."""
        edges = [0, *(edge for match in _NUMBERS.finditer(self.text) for edge in match.span()), len(self.text)]
        return tuple(zip(edges[::2], edges[1::2], strict=True))

    @cached_property
    def _pou_starts(self) -> tuple[list[int], list[str]]:
        offsets, names, block = [0], [self.pou], ""
        if not self.pou:
            for match in (match for span in self.spans for match in _POU_START.finditer(self.text, *span)):
                is_method = match[1].upper() == "METHOD"
                block = block if is_method else match[2]
                offsets.append(match.start())
                names.append(f"{block}.{match[2]}" if is_method and block else match[2])
        return offsets, names

    def position(self, offset: int) -> Position:
        """The position of a character."""
        row = bisect_right(self._line_starts, offset) - 1
        column = offset - self._line_starts[row] + 1
        offsets, names = self._pou_starts
        return Position(
            self.file,
            self.line + row,
            column + (self.column - 1 if row == 0 else 0),
            names[bisect_right(offsets, offset) - 1],
        )

    def error(self, offset: int, message: str) -> StSyntaxError:
        """A syntax error at a character."""
        return StSyntaxError([Problem(self.position(offset), message)])


@dataclass(frozen=True)
class Scanned:
    """A segment whose comments and pragmas are blanks; `segment.text` and the original have equal offsets."""

    segment: Segment
    comments: tuple[Comment, ...]
    pragmas: tuple[Pragma, ...]

    @cached_property
    def attributes(self) -> dict[int, tuple[str, ...]]:
        """Attributes by the offset of the first character of what they belong to."""
        found: dict[int, tuple[str, ...]] = {}
        for pragma in self.pragmas:
            if pragma.attribute is not None:
                found[pragma.before] = (*found.get(pragma.before, ()), pragma.attribute)
        return found


def scan(segment: Segment) -> Scanned:
    """Blank out comments and pragmas.

    Raises `StSyntaxError` for a comment, pragma or string that never ends. Linear in the length of the text.
    """
    comments: list[Comment] = []
    pragmas: list[tuple[int, int]] = []
    pieces: list[str] = []
    done = 0
    for start, end, what in _blanks(segment):
        if what is None:
            pragmas.append((start, end))
        else:
            comments.append(Comment(what, start, end))
        pieces += (segment.text[done:start], _VISIBLE.sub(" ", segment.text[start:end]))
        done = end
    if not done:
        return Scanned(segment, (), ())
    pieces.append(segment.text[done:])
    clean = "".join(pieces)
    following = re.compile(r"\S|\Z")
    found = []
    for start, end in pragmas:
        match = following.search(clean, end)
        found.append(Pragma(segment.text[start:end], start, match.start() if match else len(clean)))
    blanked = Segment(clean, segment.file, segment.line, segment.column, segment.pou)
    return Scanned(blanked, tuple(comments), tuple(found))


def _blanks(segment: Segment) -> Iterator[tuple[int, int, CommentKind | None]]:
    """Start, end and kind (None: a pragma) of all that is to be blanked, in order."""
    text, at = segment.text, 0
    following = dict.fromkeys(_BEGINNINGS, -1)
    while True:
        for beginning, place in list(following.items()):
            if place < at and (place := text.find(beginning, at)) < 0:
                del following[beginning]
            else:
                following[beginning] = place
        if not following:
            return
        start = min(following.values())
        match = _INTERESTING.match(text, start)
        assert match is not None  # each beginning alone is one
        at, token = match.end(), match[0]
        if token == "(*":
            at, kind = _comment_end(segment, start)
            yield start, at, kind
        elif token.startswith("//"):
            yield start, at, CommentKind.LINE
        elif token == "{":
            pragma = _PRAGMA.match(text, start)
            if pragma is None:
                raise segment.error(start, "this pragma never ends: '}' is missing")
            at = pragma.end()
            yield start, at, None
        elif len(token) == 1:
            raise segment.error(start, f"this string never ends: {token} is missing on its line")


def _comment_end(segment: Segment, start: int) -> tuple[int, CommentKind]:
    """The offset behind a block comment that may hold others."""
    depth, kind, at = 1, CommentKind.BLOCK, start + 2
    while depth:
        edge = _COMMENT_EDGE.search(segment.text, at)
        if edge is None:
            raise segment.error(start, "this comment never ends: '*)' is missing")
        at = edge.end()
        if edge[0] == "(*":
            depth, kind = depth + 1, CommentKind.NESTED
        else:
            depth -= 1
    if _OTHER_EDGE.search(segment.text, start + 2, at - 2):
        kind = CommentKind.NESTED
    return at, kind
