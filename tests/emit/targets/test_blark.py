"""An independent parser of TwinCAT's files (GPL, so in a process of its own) reads what is generated.

It is slow on long arrays, so these are cut to a few elements first; all other text stays as it is.
"""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from st_codegen.driver import generate
from st_codegen.project.bundle import load

pytestmark = pytest.mark.skipif(importlib.util.find_spec("blark") is None, reason="blark is not installed")
GOLDEN = Path(__file__).resolve().parents[3] / "golden"
ARRAY = re.compile(r"ARRAY\[0\.\.\d+\] OF (\w+) := \[(.*?)\]", re.DOTALL)
OBJECTS = {".TcPOU", ".TcDUT", ".TcGVL"}


def cut(text):
    """The text with arrays of three elements at most; comments between the elements go."""

    def short(match):
        cells = [cell.strip() for cell in re.sub(r"\(\*.*?\*\)", "", match[2], flags=re.DOTALL).split(",")][:3]
        return f"ARRAY[0..{len(cells) - 1}] OF {match[1]} := [{', '.join(cells)}]"

    return ARRAY.sub(short, text)


def cut_project(folder, to, of="plcproj"):
    """The generated files of a folder with short arrays; returns the file of the project, or of the solution."""
    for path in folder.rglob("*"):
        if path.suffix in {*OBJECTS, ".TcTTO", ".plcproj", ".tsproj", ".sln"}:
            copy = to / path.relative_to(folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(cut(path.read_text(encoding="utf-8")), encoding="utf-8")
    (project,) = to.glob(f"*.{of}")
    return project


def parsed(path):
    """The names of the files that blark read, a project's files included. Fails where it refuses one."""
    command = [sys.executable, "-m", "blark", "parse", "--print-filename", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-2000:]
    assert "Failed" not in result.stdout
    return {Path(name).name for name in re.findall(r"^\[\d+\] Parsing (.*?): ", result.stdout, re.MULTILINE)}


def objects(folder):
    return {path.name for path in folder.rglob("*") if path.suffix in OBJECTS}


def test_arrays_are_cut_and_nothing_else():
    text = "A : ARRAY[0..4] OF LREAL := [\n  (* row, 0 *)\n 1.0, 2.0,\n (* [x *) 3.0, 4.0\n];\nB : ARRAY[0..9] OF DINT;"
    assert cut(text) == "A : ARRAY[0..2] OF LREAL := [1.0, 2.0, 3.0];\nB : ARRAY[0..9] OF DINT;"


@pytest.mark.parametrize(
    "name",
    ["twincat/POUs/PRG_Main.TcPOU", "twincat/DUTs/E_TEError.TcDUT", "beckhoff-ml/POUs/FB_Parts39_backward.TcPOU"],
)
def test_one_of_each_kind_is_read(name, tmp_path):
    path = tmp_path / Path(name).name
    path.write_text(cut((GOLDEN / "bundle" / "generated" / name).read_text(encoding="utf-8")), encoding="utf-8")
    assert parsed(path) == {path.name}


@pytest.mark.slow
def test_every_file_is_read_through_the_solution(lone_folder, tmp_path):
    folder = generate(load(lone_folder), "twincat", tmp_path / "out").folder
    assert parsed(cut_project(folder, tmp_path / "cut", "sln")) == objects(folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lone/generated/twincat", "bundle/generated/twincat", "bundle/generated/beckhoff-ml"])
def test_every_file_of_the_golden_projects_is_read_through_the_project_file(name, tmp_path):
    assert parsed(cut_project(GOLDEN / name, tmp_path)) == objects(GOLDEN / name)


@pytest.mark.slow
def test_every_test_suite_is_read(bundle_folder, tmp_path):
    folder = generate(load(bundle_folder), "twincat", tmp_path / "out", with_tests=True).folder
    assert parsed(cut_project(folder, tmp_path / "cut")) == objects(folder)
