"""From text to trees: scan, LALR(1) parse, and a limit on nesting."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from re import ASCII
from typing import Any

from lark import Lark, Token
from lark.exceptions import UnexpectedCharacters, UnexpectedInput

from st_codegen.st import tree as t
from st_codegen.st.errors import Problem, StSyntaxError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.builder import Builder
from st_codegen.st.syntax.scan import Scanned, Segment, scan

# Deeper trees would exceed Python's recursion limit in the passes that follow; hand-written code stays below 20.
MAX_DEPTH = 100
STARTS = ("file", "head", "body", "globals", "types")
_SHOWN = 6
# Words that are reserved everywhere, so that a missing END_IF is found at the next END_, not at the end of the file
_SOFT = {"NAME", "MODIFIER", "CONSTANT", "RETAIN", "PERSISTENT", "POINTER", "REFERENCE", "METHOD", "UNION", "SUPER"}
_SOFT |= {"_CONFIGURATION", "_RESOURCE", "_ON", "_TASK", "_INTERVAL", "_PRIORITY", "_WITH"}
_SYMBOL_NAMES = {
    "NAME": "a name",
    "INTEGER": "a number",
    "ADDRESS": "an address",
    "MODIFIER": "a modifier",
    "TABLE": "a table of numbers",
    "$END": "the end of the text",
}
_EXPRESSIONS = frozenset(
    {"NAME", "INTEGER", "BASED", "REAL", "TYPED", "CHARACTERS", "WIDE_CHARACTERS", "TRUE", "FALSE"}
    | {"THIS", "SUPER", "NOT", "PLUS", "MINUS", "_LPAR"}
)
_STATEMENTS = _EXPRESSIONS | {"IF", "CASE", "FOR", "WHILE", "REPEAT", "EXIT", "CONTINUE", "RETURN", "_SEMICOLON"}
_OPERATORS = frozenset(
    {"OR", "OR_ELSE", "AND", "AND_THEN", "XOR", "MOD", "SLASH", "STAR", "POWER", "AMPERSAND", "_CARET", "_DOT"}
    | {"EQUAL", "NOT_EQUAL", "LESS", "LESS_EQUAL", "GREATER", "GREATER_EQUAL"}
)
_STARTERS = frozenset({"IF", "REAL"})
#: A text with what most texts have: lark makes the patterns of a place in the grammar when it first comes there.
_USUAL = """
TYPE A : STRUCT a : ARRAY[0..1] OF LREAL; END_STRUCT END_TYPE TYPE B : (A := 0, B); END_TYPE VAR_GLOBAL a : A; END_VAR
FUNCTION F : LREAL VAR_INPUT a, b : LREAL; END_VAR F := a - LREAL#1.0 / b; END_FUNCTION
PROGRAM P VAR a : F; b : C := (d := 1, e := -1); END_VAR a(b := c, d => e); P1(b, 1 + 2); END_PROGRAM
FUNCTION_BLOCK F VAR CONSTANT a, b : ARRAY[0..1] OF LREAL := [1.0, 2.0]; c : LREAL := -1.0; END_VAR
a[0] := NOT b[c + 1] AND (c.d ** 2 > -1.0); a.b := f(b, -c * 2, c := d)[1]; ;
IF a = b THEN RETURN; ELSIF c THEN EXIT; ELSE CONTINUE; END_IF
CASE a OF 1, 2..3: a := 1; A.b: b := 1; ELSE a := T#1s; END_CASE
FOR a := 0 TO b - 1 BY 2 DO c := 1; END_FOR WHILE a DO b := 1; END_WHILE REPEAT a := 1; UNTIL b END_REPEAT
END_FUNCTION_BLOCK
"""


class _Reserved:
    """Tells lark's contextual lexer which words to recognise in every state."""

    always_accept: tuple[str, ...] = ()

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        """Pass the tokens on unchanged, which is what lark asks of this method."""
        return stream


@cache
def _grammar() -> str:
    return (files("st_codegen.st.syntax") / "grammar.lark").read_text(encoding="utf-8")


@cache
def _lark() -> Lark:
    reserved = _Reserved()
    reserved.always_accept = _reserved_names()
    return Lark(
        _grammar(),
        parser="lalr",
        lexer="contextual",
        start=list(STARTS),
        transformer=Builder(),
        maybe_placeholders=True,
        g_regex_flags=ASCII,
        postlex=reserved,
    )


def get_ready() -> None:
    """Make the tables and patterns of the grammar now, which the first text would have to wait for."""
    parse_segment(Segment(_USUAL, "usual"))


def _reserved_names() -> tuple[str, ...]:
    """What the grammar calls the words that cannot be names."""
    words = (line.partition(": ") for line in _grammar().splitlines() if line.endswith('"i'))
    return tuple(name for name, _, _ in words if name not in _SOFT)


@cache
def reserved_words() -> frozenset[str]:
    """The words that cannot be names, upper case."""
    return frozenset(name.lstrip("_") for name in _reserved_names())


def parse_segment(segment: Segment, start: str = "file") -> Any:
    """Parse a piece of Structured Text by one of the grammar's `STARTS`.

    Returns a list of declarations (`file`, `types`), a `PouDeclaration` without a body (`head`), a tuple of
    statements (`body`) or of variable blocks (`globals`). Raises `StSyntaxError` whatever the text.
    """
    return parse_scanned(scan(segment), start)


def parse_scanned(scanned: Scanned, start: str = "file") -> Any:
    """`parse_segment` for a text whose comments were blanked before."""
    token = Builder.parsing.set(scanned)
    try:
        result = _lark().parse(scanned.segment.text, start=start)
    except UnexpectedInput as error:
        raise _explain(error, scanned.segment) from None
    finally:
        Builder.parsing.reset(token)
    _check_depth(result)
    return result


def _explain(error: UnexpectedInput, segment: Segment) -> StSyntaxError:
    offset: int | None = getattr(error, "pos_in_stream", None)
    if isinstance(error, UnexpectedCharacters):
        return segment.error(offset or 0, f"unexpected character {error.char!r}")
    accepted: set[str] = error.interactive_parser.accepts()  # type: ignore[no-untyped-call]
    expected = _expectation(accepted)
    token: Token | None = getattr(error, "token", None)
    if token is not None and token.type != "$END" and offset is not None:
        shown = str(token)
        shown = f"{shown[:37]}..." if len(shown) > 40 else shown
        if "NAME" in accepted and shown.upper() in reserved_words() and not _STARTERS & accepted:
            return segment.error(offset, f"'{shown}' is a keyword and cannot be a name")
        return segment.error(offset, f"unexpected '{shown}'{expected}")
    return segment.error(len(segment.text), f"the text ends too early{expected}")


def _expectation(accepted: set[str]) -> str:
    """What could have stood there, with statements and expressions as a whole; operators go without saying."""
    names = accepted - _OPERATORS
    groups = []
    if names >= {"IF", "WHILE"}:
        groups.append("a statement")
        names -= _STATEMENTS
    elif names >= {"REAL", "NAME"}:
        groups.append("an expression")
        names -= _EXPRESSIONS
    plain = groups + sorted((_readable(name) for name in names), key=lambda text: (not text.startswith("'END"), text))
    if not plain:
        return ""
    more = f" or {len(plain) - _SHOWN} more" if len(plain) > _SHOWN else ""
    return f"; expected {', '.join(plain[:_SHOWN])}{more}"


def _readable(terminal: str) -> str:
    if terminal in _SYMBOL_NAMES:
        return _SYMBOL_NAMES[terminal]
    pattern = _lark().get_terminal(terminal).pattern
    return f"'{pattern.value}'" if pattern.type == "str" else terminal.lower()


def _check_depth(root: object) -> None:
    """Refuse trees that are nested too deeply; a long chain of operators counts as one level."""
    stack: list[tuple[object, int]] = [(root, 0)]
    while stack:
        item, depth = stack.pop()
        if isinstance(item, tuple | list):
            stack.extend((part, depth) for part in item)
        elif isinstance(item, t.Node) and not isinstance(item, d.NumberTable):
            if depth > MAX_DEPTH:
                raise StSyntaxError([Problem(item.position, f"more than {MAX_DEPTH} levels of nesting")])
            chain = item.left if isinstance(item, t.Infix) else None
            for value in vars(item).values():
                if isinstance(value, t.Node | tuple):
                    stack.append((value, depth if value is chain else depth + 1))
