"""The rules of the house, read from the imports."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "st_codegen"
FILES = sorted(PACKAGE.rglob("*.py"))
COMPILER = {"ir", "walkers", "passes", "emit", "te", "beckhoff_ml"}
ON_TOP = {"campaign", "training", "rig", "reconcile", "report", "cli"}
#: Rooms that may be used by each room; those not named here stand on top and may use all.
MAY_USE = {
    "ir": {"errors"},
    "walkers": {"ir", "errors"},
    "passes": {"ir", "errors"},
    "st": {"errors"},  # and so nothing of `cost`, which judges what `st` has read
    "cost": {"st", "files", "errors"},
    "files": {"errors"},
}


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
    if here in MAY_USE:
        assert used <= MAY_USE[here] | {here}
    if here in COMPILER:
        assert not used & ON_TOP


def test_only_render_knows_jinja():
    users = [path for path in FILES if "jinja2" in path.read_text()]
    assert [path.stem for path in users] == ["render"]


def test_no_structured_text_in_python_of_the_generator():
    """Templates lay out, Python decides: no statement of ST stands in a Python string."""
    for path in FILES:
        if room(path) not in COMPILER or path.name == "library.py":  # what the vendor's library declares
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert ":=" not in node.value, f"{path}:{node.lineno}"
                assert "END_" not in node.value or path.stem == "literals", f"{path}:{node.lineno}"


#: Rooms of reconcile, from the floor up: each uses only what stands before it, `settings`, and itself.
RECONCILE = ("data", "fit", "judge", "run", "models", "report")


@pytest.mark.parametrize("path", sorted((PACKAGE / "reconcile").rglob("*.py")), ids=lambda path: path.stem)
def test_floors_of_reconcile(path):
    here = path.relative_to(PACKAGE / "reconcile").parts[0].removesuffix(".py")
    if here not in RECONCILE:
        return
    used = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("st_codegen.reconcile."):
            used.add(node.module.split(".")[2])
    assert used <= {"settings", *RECONCILE[: RECONCILE.index(here) + 1]}
