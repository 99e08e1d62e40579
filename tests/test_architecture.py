"""The rules of the house, read from the imports."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "st_codegen"
FILES = sorted(PACKAGE.rglob("*.py"))
COMPILER = {"walkers", "passes", "blocks", "targets", "ir", "reference", "bounds", "render", "literals", "bundle"}
ON_TOP = {"campaign", "training", "rig", "reconcile", "report", "cli"}


def imports(path):
    """Modules of ours that a file imports, as parts behind `st_codegen`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        found |= {name.split(".")[1] for name in names if name.startswith("st_codegen.")}
    return found


def room(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def test_there_are_files():
    assert len(FILES) > 20


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_keep_the_rules(path):
    used, here = imports(path), room(path)
    if here == "ir":
        assert used <= {"ir", "errors"}
    if here == "walkers":
        assert used <= {"walkers", "ir", "errors", "reference"}
    if here == "passes":
        assert used <= {"passes", "ir", "errors", "reference"}
    if here == "reference":
        assert used <= {"ir"}
    if here == "blocks":
        assert used <= {"blocks", "ir", "errors", "literals", "passes"}
    if here == "st":  # and so nothing of `cost`, which judges what `st` has read
        assert used <= {"st", "errors"}
    if here == "cost":
        assert used <= {"cost", "st", "errors"}
    if here in COMPILER:
        assert not used & ({"st", "cost"} | ON_TOP)


def test_only_render_knows_jinja():
    users = [path for path in FILES if "jinja2" in path.read_text()]
    assert [room(path) for path in users] == ["render"]


def test_no_structured_text_in_python_of_the_generator():
    """Templates lay out, Python decides: no statement of ST stands in a Python string."""
    for path in FILES:
        if room(path) not in COMPILER | {"generate", "output"}:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert ":=" not in node.value, f"{path}:{node.lineno}"
                assert "END_" not in node.value or room(path) == "literals", f"{path}:{node.lineno}"
