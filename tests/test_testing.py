"""The plugin for users' repositories, and the example of such a repository."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from st_codegen.driver import generate
from st_codegen.project.bundle import load
from st_codegen.testing import assert_equals_library, assert_generated_up_to_date

pytest.importorskip("lightgbm")

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "user_repository"


def pytest_in(folder, *arguments):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "st_codegen.testing", "-p", "no:cacheprovider", *arguments]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)


def test_the_example_of_a_users_repository_passes_its_own_tests(tmp_path):
    copy = tmp_path / "repository"  # that the committed code is up to date is tested with the golden files
    shutil.copytree(EXAMPLE, copy)
    done = pytest_in(copy, "--update-generated")
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_the_example_fails_where_model_and_code_part(tmp_path):
    copy = tmp_path / "repository"
    shutil.copytree(EXAMPLE, copy)
    assert pytest_in(copy, "--update-generated").returncode == 0
    path = copy / "models" / "st-codegen.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("max = 3000.0", "max = 2500.0"), encoding="utf-8")
    done = pytest_in(copy)
    assert done.returncode == 1
    assert "generated files are not those of" in done.stdout
    assert "FB_PumpPower.TcPOU" in done.stdout
    assert pytest_in(copy, "--update-generated").returncode == 0
    assert pytest_in(copy).returncode == 0


def test_a_changed_number_in_the_text_is_found(lone_folder, tmp_path):
    folder = generate(load(lone_folder), "twincat", tmp_path).folder
    assert_generated_up_to_date(lone_folder, tmp_path)
    assert_equals_library(lone_folder, tmp_path, rows=100)
    block = folder / "POUs" / "FB_Te.TcPOU"
    text = block.read_text(encoding="utf-8")
    assert "bValid := bUsable;" in text
    block.write_text(text.replace("bValid := bUsable;", "bValid := FALSE;"), encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match=r"1 generated files are not those of"):
        assert_generated_up_to_date(lone_folder, tmp_path)
    with pytest.raises(pytest.fail.Exception, match="failed"):
        assert_equals_library(lone_folder, tmp_path, rows=100)


def test_the_plugin_is_announced_by_the_name_of_its_module():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"st_codegen.testing": "st_codegen.testing"}
