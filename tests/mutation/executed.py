"""Which tests a mutant is tried with: those that execute what it changes, as runs below coverage saw it."""

from __future__ import annotations

import ast
import collections
import json
import re
import sqlite3
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from coverage.numbits import numbits_to_nums

from tests.mutation.mutants import Mutant

ROOT = Path(__file__).resolve().parents[2]
#: Tests of templates: the golden files first, they notice most.
_OF_TEMPLATES = ("tests/emit/test_golden.py", "tests/emit", "tests/te", "tests/beckhoff_ml")
_OF_SOURCES = "tests/test_architecture.py"
#: Tests that compare whole generated files with committed ones.
_OF_TEXTS = "tests/emit/test_golden.py::test_the_generated"
#: Most tests of one mutant, and the seconds that they take unchanged: what these do not notice counts as survived.
_MOST_TESTS = 2000
_MOST_SECONDS = 60.0


def _file_of(test: str) -> str:
    return test.partition("::")[0]


@cache
def _parsed(name: str) -> ast.Module:
    """Return the tree of a file of the repository; an empty one where there is no such file."""
    file = ROOT / name
    return ast.parse(file.read_text(encoding="utf-8") if file.exists() else "")


def _innermost(name: str, line: int) -> ast.stmt | None:
    around = [
        node
        for node in ast.walk(_parsed(name))
        if isinstance(node, ast.stmt) and line in range(*_lines(node, whole=True))
    ]
    return max(around, key=lambda node: node.lineno, default=None)


def _lines(node: ast.stmt, *, whole: bool) -> tuple[int, int]:
    """First and last line (not included) of a statement, or of its head alone."""
    first = min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", []))])
    body = getattr(node, "body", None)
    return first, body[0].lineno if body and not whole else (node.end_lineno or node.lineno) + 1


def _statement(name: str, line: int) -> list[int]:
    """The lines of the statement that a line is part of: coverage sees a statement of several lines at some of them."""
    node = _innermost(name, line)
    return [line] if node is None else sorted({line, *range(*_lines(node, whole=False))})


def _uses(name: str, line: int) -> list[tuple[str, int]]:
    """Where what a declaration names is used: the body of a function, or the lines with the name of a constant."""
    node = _innermost(name, line)
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return [(name, line) for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1)]
    if not isinstance(node, ast.Assign | ast.AnnAssign):
        return []
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    names = {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
    used = re.compile(rf"\b({'|'.join(map(re.escape, names))})\b") if names else re.compile("(?!)")
    files = [name, *(file.relative_to(ROOT).as_posix() for file in sorted((ROOT / "st_codegen").rglob("*.py")))]
    return [
        (file, number)
        for file in dict.fromkeys(files)
        if (ROOT / file).exists()
        for number, text in enumerate((ROOT / file).read_text(encoding="utf-8").splitlines(), 1)
        if used.search(text)
    ]


class Executed:
    """Which tests execute a line, from runs below coverage: of these rooms, or of all that were measured."""

    def __init__(self, folder: Path, rooms: Sequence[str] = ()) -> None:
        self._tests: dict[tuple[str, int], set[str]] = collections.defaultdict(set)
        self._size: collections.Counter[str] = collections.Counter()
        self._seconds: dict[str, float] = {}
        measured = [path for path in sorted(folder.glob("*.coverage")) if not rooms or path.stem in rooms]
        for path in measured:
            self._seconds |= json.loads(Path(f"{path}.seconds").read_text())
        for path in measured:
            with sqlite3.connect(path) as data:
                rows = data.execute(
                    "select path, context, numbits from line_bits join file on file.id = file_id "
                    "join context on context.id = context_id"
                )
                for name, context, bits in rows:
                    if context and context not in self._seconds:
                        continue  # a test that fails unchanged
                    for line in numbits_to_nums(bits):
                        self._tests[name, line].add(context)
                        self._size[context] += 1

    def tests(self, mutant: Mutant) -> list[str]:
        """The tests to run, those of the mutant's own room first, then by how little else they execute."""
        if mutant.path.endswith(".j2"):
            ordered = [test for tests in _OF_TEMPLATES for test in self._seconds if test.startswith(tests)]
            return list(dict.fromkeys(ordered))
        name, own = mutant.path, f"tests/{mutant.path.split('/')[1]}/"
        found = set().union(*(self._tests[name, line] for line in _statement(name, mutant.line)))
        imported = "" in found
        named = {test for test in found if test}
        if imported:  # a declaration: the tests that execute what uses it
            named |= {test for line in _uses(name, mutant.line) for test in self._tests[line] if test}
        of_lines = bool(named)
        if not named:  # where coverage does not see it: any test that uses the file
            named = {test for (file, _), tests in self._tests.items() if file == name for test in tests if test}
            named = named or {test for test in self._seconds if test.startswith(own)}
        size = self._size if of_lines else self._seconds
        # a changed text is what the tests of whole texts notice, few as they are
        ordered = sorted(
            named,
            key=lambda test: (not test.startswith(_OF_TEXTS), not test.startswith(own), size.get(test, 0.0), test),
        )
        # what a fixture of several tests executes counts as the first one's, so the others of a file follow
        beside = collections.defaultdict(list)
        for test in self._seconds:
            beside[_file_of(test)].append(test)
        ordered += [test for file in dict.fromkeys(map(_file_of, ordered)) for test in beside[file]]
        if imported:  # declarations are held by tests that read sources, too
            ordered = [*beside[_OF_SOURCES], *ordered]
        chosen, seconds = [], 0.0
        for test in list(dict.fromkeys(ordered))[:_MOST_TESTS]:
            if not chosen or seconds + self._seconds.get(test, 0.0) <= _MOST_SECONDS:
                chosen.append(test)
                seconds += self._seconds.get(test, 0.0)
        return chosen

    def seconds(self, tests: list[str]) -> dict[str, float]:
        """Processor time of each of these tests in the unchanged program."""
        return {test: self._seconds.get(test, 0.0) for test in tests}
