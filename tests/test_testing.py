"""The plugin for users' repositories, and the example of such a repository."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.ir import OutputKind
from st_codegen.project.bundle import load
from st_codegen.testing import assert_equals_library, assert_generated_up_to_date
from tests.cli.helpers import run

pytest.importorskip("lightgbm")

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "user_repository"


#: Runs pytest several times in one process: importing the libraries takes longer than the tests.
RUNS = """
from pathlib import Path
import numpy as np
import pytest

def run(*more):
    code = pytest.main(["-q", "-p", "st_codegen.testing", "-p", "no:cacheprovider", *more])
    print(f"<{int(code)}>")

run("--update-generated")
path = Path("models/st-codegen.toml")
path.write_text(path.read_text(encoding="utf-8").replace("max = 3000.0", "max = 2500.0"), encoding="utf-8")
run()
run("--update-generated")
run()
"""


def test_git_on_windows_leaves_the_model_of_the_example_as_it_is(tmp_path):
    """LightGBM's files count the bytes of their trees: with other line ends neither the library nor we read them."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    shutil.copytree(EXAMPLE, repository := tmp_path / "repository")

    def git(*command):
        settings = ["-c", "core.autocrlf=true", "-c", "user.name=x", "-c", "user.email=x@x"]
        subprocess.run(["git", *settings, *command], cwd=repository, check=True, capture_output=True)

    model, project = repository / "models" / "power.txt", repository / "plc" / "twincat" / "Pumps.plcproj"
    model.write_bytes(content := model.read_bytes().replace(b"\r\n", b"\n"))
    for command in (["init"], ["add", "."], ["commit", "-m", "x"]):
        git(*command)
    model.unlink()
    project.unlink()
    git("checkout", "--", ".")
    assert model.read_bytes() == content
    assert b"\r\n" in project.read_bytes()


@pytest.mark.thorough
def test_the_example_passes_and_fails_where_model_and_code_part(tmp_path):
    copy = tmp_path / "repository"  # that the committed code is up to date is tested with the golden files
    shutil.copytree(EXAMPLE, copy)
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, "-c", RUNS]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False, env=environment)
    written, parted, *again = re.findall(r"(.*?)<(\d+)>\n", done.stdout, re.DOTALL)
    assert written[1] == "0", done.stdout + done.stderr
    assert "2 passed" in written[0]
    assert parted[1] == "1"
    assert "generated files are not those of" in parted[0]
    assert "FB_PumpPower.TcPOU" in parted[0]
    assert [code for _, code in again] == ["0", "0"]


def test_a_changed_number_in_the_text_is_found(lone_folder, tmp_path):
    folder = generate(load(lone_folder), "twincat", tmp_path).folder
    assert_generated_up_to_date(lone_folder, tmp_path)
    assert_equals_library(lone_folder, tmp_path, rows=100)
    block = folder / "POUs" / "FB_Te.TcPOU"
    text = block.read_text(encoding="utf-8")
    assert "bValid := bUsable;" in text
    block.write_text(text.replace("bValid := bUsable;", "bValid := FALSE;"), encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match=r"generated files are not those of .* \(1\)"):
        assert_generated_up_to_date(lone_folder, tmp_path)
    with pytest.raises(pytest.fail.Exception, match="failed"):
        assert_equals_library(lone_folder, tmp_path, rows=100)


def test_text_with_other_outputs_than_by_default_is_compared_in_all_of_them(tmp_path):
    linear = pytest.importorskip("sklearn.linear_model")
    skops = pytest.importorskip("skops.io")
    x = np.random.default_rng(0).normal(size=(40, 2))
    (tmp_path / "models").mkdir()
    skops.dump(linear.LogisticRegression().fit(x, x[:, 0] > 0), tmp_path / "models" / "state.skops")
    kinds = (OutputKind.CLASS, OutputKind.PROBABILITY)
    folder = generate(load(tmp_path / "models", outputs=kinds), "iec", tmp_path / "out").folder
    assert_equals_library(tmp_path / "models", tmp_path / "out", rows=100)
    block = folder / "FB_State.st"
    block.write_text(re.sub(r"fOut1 := [^;]+;", "fOut1 := 2.0;", block.read_text()))
    with pytest.raises(pytest.fail.Exception, match="failed"):
        assert_equals_library(tmp_path / "models", tmp_path / "out", rows=100)


def test_all_options_of_the_build_table_count(lone_folder, tmp_path):
    """What the command writes of a folder is what the plugin wants."""
    out = tmp_path / "plc"
    (lone_folder / "st-codegen.toml").write_text(
        f'[build]\ntarget = ["twincat", "iec"]\nout = "{out}"\nproject = "library"\ncompany = "Plant"\n'
        'library_version = "1.2.0.0"\nnamespace = "Pumps"\nwith_age = true\nprofile = "cx5140"\nlayout = "trees"\n'
    )
    assert run(lone_folder, "-q") == 0
    assert "<Company>Plant</Company>" in (out / "twincat" / "Models.plcproj").read_text(encoding="utf-8-sig")
    assert_generated_up_to_date(lone_folder, out)
    (lone_folder / "st-codegen.toml").write_text(f'[build]\ntarget = ["twincat"]\nout = "{out}"\n')
    with pytest.raises(pytest.fail.Exception, match="generated files are not those of"):
        assert_generated_up_to_date(lone_folder, out)


def test_the_plugin_is_announced_by_the_name_of_its_module():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"st_codegen.testing": "st_codegen.testing"}
