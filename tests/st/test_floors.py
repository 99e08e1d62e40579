"""The rooms of `st` stand on each other: none knows one above it, and no two know each other."""

import ast
from pathlib import Path

import pytest

import st_codegen.st

FOLDER = Path(st_codegen.st.__file__).parent
#: From the ground up.
FLOORS = ("errors", "types", "tree", "walk", "syntax", "dialects", "check", "run", "__init__")
FILES = sorted(FOLDER.rglob("*.py"))


def floor(parts):
    return FLOORS.index(parts[0].removesuffix(".py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(FOLDER).as_posix())
def test_imports_go_down(path):
    here = floor(path.relative_to(FOLDER).parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("st_codegen.st"):
            parts = node.module.split(".")[2:] or [alias.name for alias in node.names]
            assert floor(parts) <= here, f"{path}:{node.lineno}"


def test_nothing_is_imported_for_annotations_alone():
    """That is how circles hide."""
    for path in FILES:
        assert "TYPE_CHECKING" not in path.read_text(), path
