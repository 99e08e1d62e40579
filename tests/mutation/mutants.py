"""Single mutations of the package and its templates: small changes that a test should notice."""

from __future__ import annotations

import ast
import io
import random
import re
import tokenize
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

_COMPARED = {"==": "!=", "!=": "==", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "is": "is not", "in": "not in"}
_COMPUTED = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "@": "*"}
_JOINED = {"and": "or", "or": "and"}
_HELD = {("dataclass", "frozen"), ("zip", "strict")}
#: In templates: what stands between spaces, or a whole number.
_PRINTED = re.compile(r"(?<= )(<=|>=|<>|<|>|=|\+|-|\*|AND|OR|TRUE|FALSE)(?= |;|\))|(?<![\w#.'\"$])\d+(?![\w.])")
_PRINTED_AS = {"<=": "<", "<": "<=", ">=": ">", ">": ">=", "=": "<>", "<>": "=", "+": "-", "-": "+", "*": "+"}
_PRINTED_AS |= {"AND": "OR", "OR": "AND", "TRUE": "FALSE", "FALSE": "TRUE"}


@dataclass(frozen=True)
class Mutant:
    """One change: characters `start` to `end` of a file become `text`."""

    path: str
    line: int
    start: int
    end: int
    before: str
    text: str

    def apply(self, source: str) -> str:
        """Return the changed source."""
        assert source[self.start : self.end] == self.before
        return source[: self.start] + self.text + source[self.end :]

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: `{self.before}` -> `{self.text}`"


def sample(root: Path, count: int, seed: int, rooms: Sequence[str] = ()) -> list[Mutant]:
    """Choose `count` mutants of these rooms, or of all, every one equally likely; templates are part of `emit`."""
    files = sorted((root / "st_codegen").rglob("*.py")) + sorted((root / "templates").rglob("*.j2"))
    folders = [f"st_codegen/{room}/" for room in rooms] + ["templates/"] * ("emit" in rooms)
    everything: list[Mutant] = []
    for file in files:
        name = file.relative_to(root).as_posix()
        if not rooms or name.startswith(tuple(folders)):
            source = file.read_text(encoding="utf-8")
            everything += _of_python(name, source) if file.suffix == ".py" else _of_template(name, source)
    return sorted(random.Random(seed).sample(everything, min(count, len(everything))), key=str)


def _of_template(name: str, source: str) -> Iterator[Mutant]:
    for found in _PRINTED.finditer(re.sub(r"\{#.*?#\}|\(\*.*?\*\)|//[^\n]*", _blank, source, flags=re.S)):
        before = found[0]
        text = _PRINTED_AS.get(before) or str(int(before) + 1)
        yield Mutant(name, source.count("\n", 0, found.start()) + 1, found.start(), found.end(), before, text)


def _blank(found: re.Match[str]) -> str:
    return re.sub(r"[^\n]", " ", found[0])


def _of_python(name: str, source: str) -> Iterator[Mutant]:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    lines = source.splitlines()

    def place(line: int, column: int) -> int:
        """Return the character of a position whose column counts bytes."""
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    tokens = [
        (starts[token.start[0] - 1] + token.start[1], token.string)
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type in (tokenize.OP, tokenize.NAME)
    ]

    def replaced(after: ast.expr, before: ast.expr, table: dict[str, str]) -> Iterator[Mutant]:
        """Yield the mutant of the operator between two operands."""
        first = place(after.end_lineno or 0, after.end_col_offset or 0)
        last = place(before.lineno, before.col_offset)
        for start, text in tokens[bisect_left(tokens, (first, "")) :]:
            if start >= last:
                return
            if text in table:
                line = source.count("\n", 0, start) + 1
                yield Mutant(name, line, start, start + len(text), text, table[text])
                return

    for node in _code(ast.parse(source)):
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            for left, right, operator in zip(operands, operands[1:], node.ops, strict=False):
                if not isinstance(operator, ast.NotIn | ast.IsNot):
                    yield from replaced(left, right, _COMPARED)
        elif isinstance(node, ast.BinOp) and not isinstance(node.op, ast.BitOr):
            if not (isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)):
                yield from replaced(node.left, node.right, _COMPUTED)
        elif isinstance(node, ast.BoolOp):
            yield from replaced(node.values[0], node.values[1], _JOINED)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            start = place(node.lineno, node.col_offset)
            end = start + len("not ")  # not as far as the operand, which may begin behind a parenthesis
            yield Mutant(name, node.lineno, start, end, source[start:end], "")
        elif isinstance(node, ast.Constant) and type(node.value) in (bool, int, float):
            start, end = place(node.lineno, node.col_offset), place(node.end_lineno or 0, node.end_col_offset or 0)
            yield Mutant(name, node.lineno, start, end, source[start:end], _other_value(node.value))
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            start, end = place(node.lineno, node.col_offset), place(node.end_lineno or 0, node.end_col_offset or 0)
            yield Mutant(name, node.lineno, start, end, source[start:end], "pass")


def _other_value(value: bool | int | float) -> str:
    if isinstance(value, bool):
        return str(not value)
    return repr(value + 1) if isinstance(value, int) or value == 0.0 else repr(value * 2)


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a file that decide what it does: no annotations, nothing inside f-strings.

    Nor `frozen` of dataclasses and `strict` of zip: without them a program that is right does the same.
    """
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "type_params"):
            continue
        for node in value if isinstance(value, list) else [value]:
            called = tree.func.id if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) else ""
            held = isinstance(node, ast.keyword) and (called, node.arg) in _HELD
            if isinstance(node, ast.AST) and not isinstance(node, ast.JoinedStr) and not held:
                yield node
                yield from _code(node)
