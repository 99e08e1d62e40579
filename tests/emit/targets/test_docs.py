"""The description of the generated project names every file of it, and no other."""

import re
from pathlib import Path

import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.project.bundle import load

ROOT = Path(__file__).resolve().parents[3]
TREE = (ROOT / "docs" / "project_tree.md").read_text(encoding="utf-8")


def section(target):
    return TREE.partition(f"## `{target}/`\n")[2].partition("\n## ")[0]


@pytest.mark.parametrize("target", TARGETS)
def test_every_file_is_described(target, tmp_path):
    folder = generate(load(ROOT / "golden" / "bundle" / "models"), target, tmp_path).folder
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    described = set(re.findall(r"`((?:\w+/)*[\w-]*\.\w+)`", section(target)))
    if target == "beckhoff-ml":
        described |= set(re.findall(r"`((?:\w+/)*[\w-]*\.\w+)`", section("twincat"))) - {"POUs/FB_Tables.TcPOU"}
    described -= {name for name in described if name.startswith("Tests/")} | {"TestTask.TcTTO"}
    assert described == files


def test_all_targets_are_described():
    text = (ROOT / "docs" / "targets.md").read_text(encoding="utf-8")
    for name in TARGETS:
        assert f"\n## {name}\n" in text or f"| `{name}` |" in text
    assert "Nothing here was loaded into TwinCAT" in text
