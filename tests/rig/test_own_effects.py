"""Effects of one's own: from a file, and from a package with an entry point."""

import shutil
import sys
from pathlib import Path

import pytest

from st_codegen.errors import InputError
from st_codegen.rig.effects import catalogue

COGGING = Path(__file__).resolve().parents[2] / "examples" / "effects" / "motor_cogging.py"


def test_a_file_adds_its_effects_behind_those_of_the_catalogue():
    assert list(catalogue([COGGING])) == [*catalogue(), "motor_cogging"]


@pytest.mark.parametrize("target", ["cogging_package", "cogging_package:MotorCogging"])
def test_a_package_adds_its_effects_through_an_entry_point(tmp_path, monkeypatch, target):
    """As an installer leaves it: a module and the metadata of its package beside it."""
    shutil.copy(COGGING, tmp_path / "cogging_package.py")
    information = tmp_path / "cogging_package-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: cogging-package\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[st_codegen.effects]\ncogging = {target}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cogging_package", raising=False)
    found = catalogue()["motor_cogging"]
    assert found.title == "cogging of the motor"
    monkeypatch.delitem(sys.modules, "cogging_package")


def test_a_name_that_exists_is_refused(tmp_path):
    own = tmp_path / "own.py"
    own.write_text(COGGING.read_text().replace('name = "motor_cogging"', 'name = "wear"'))
    with pytest.raises(InputError, match="'wear' exists already"):
        catalogue([own])


def test_a_file_without_effects_is_refused(tmp_path):
    (tmp_path / "nothing.py").write_text("x = 1\n")
    with pytest.raises(InputError, match="no effect in it"):
        catalogue([tmp_path / "nothing.py"])
