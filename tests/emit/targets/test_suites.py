"""Test suites for the controller: they pass on the text they were made for, and fail on any other."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import TargetError
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.arithmetic import libraries_of
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from st_codegen.st import Machine, load_project
from st_codegen.st.run.library import TestSuite


def suites(folder):
    """The suites of a generated folder after one cycle."""
    libraries = libraries_of(folder)
    machine = Machine(load_project([folder], "twincat", libraries), libraries=libraries)
    machine.program("PRG_Test")()
    return [native for native in machine.natives if isinstance(native, TestSuite)]


@pytest.fixture
def folder(generated_once):
    return generated_once("bundle", ("twincat",), with_tests=True) / "twincat"


def test_the_suites_pass_on_the_controllers_text(folder, bundle_folder):
    found = suites(folder)
    assert len(found) == 4  # FB_SelfTest, two models and FB_TEPredict
    for suite in found:
        assert suite.tests
        assert suite.finished == set(suite.tests)
        assert suite.failures == []
    assert [suite.tests for suite in found].count(["reference vectors", "NaN is refused"]) >= 1
    assert verify(load(bundle_folder), folder.parent, rows=100).passed


def test_the_suites_pass_where_the_models_are_spread_over_calls(bundle_folder, tmp_path):
    spread = Options(Layout.TREES, outputs_per_cycle=1)
    folder = generate(load(bundle_folder), "twincat", tmp_path, with_tests=True, options=spread).folder
    assert "spread over 2 calls" in (folder / "POUs" / "FB_TEPredict.TcPOU").read_text(encoding="utf-8")
    for suite in suites(folder):
        assert suite.failures == []


@pytest.mark.parametrize(
    ("file", "pattern", "by"),
    [
        ("Tests/FB_A_Test.TcPOU", r"(TEST_EXPECTED .*?row 5 \*\)\s*)(-?)", r"\g<1>9"),
        ("POUs/FB_TEPredict.TcPOU", r"aAmplitudeFw\[0\] := ", "aAmplitudeFw[0] := 1.0E-6 + "),
        ("POUs/FB_SelfTest.TcPOU", r"fDivided / 49", "fDivided / 48"),
        ("POUs/FB_TEPredict.TcPOU", r"bValid := bUsable", "bValid := TRUE"),
    ],
    ids=["expected value", "amplitude", "arithmetic", "NaN taken"],
)
def test_a_change_makes_a_suite_fail(folder, tmp_path, file, pattern, by):
    folder = Path(shutil.copytree(folder, tmp_path / "twincat"))
    path = folder / file
    name = path.stem
    text = path.read_text(encoding="utf-8")
    changed = re.sub(pattern, by, text, count=1, flags=re.S)
    assert changed != text
    path.write_text(changed, encoding="utf-8")
    failures = [failure for suite in suites(folder) for failure in suite.failures]
    assert failures
    if name == "FB_A_Test":  # the message says which row it is, and which output
        assert [failure.message for failure in failures] == ["row 5: fOut1"]


def test_the_project_lists_the_suites_their_task_and_their_library(folder):
    text = (folder / "small.plcproj").read_text()
    for name in ("Tests\\FB_A_Test.TcPOU", "Tests\\PRG_Test.TcPOU", "TestTask.TcTTO"):
        assert f'<Compile Include="{name}">' in text
    assert "TcUnit, * (www.tcunit.org)" in text
    assert "<Name>PRG_Test</Name>" in (folder / "TestTask.TcTTO").read_text(encoding="utf-8")


def test_expected_values_are_the_librarys(folder, bundle_folder, lightgbm_text):
    lightgbm = pytest.importorskip("lightgbm")
    text = (folder / "Tests" / "FB_A_Test.TcPOU").read_text(encoding="utf-8")

    def table(name):
        body = re.search(rf"{name} : [^:]*:= \[(.*?)\];", text, re.S)[1]
        return np.array([float(cell) for cell in re.sub(r"\(\*.*?\*\)", "", body).split(",")])

    inputs = table("TEST_INPUT").reshape(-1, 3)
    inside = np.clip(inputs, [100.0, 0.0, 25.0], [1800.0, 1800.0, 35.0])
    assert len(inputs) > 20
    assert np.array_equal(lightgbm.Booster(model_str=lightgbm_text).predict(inside), table("TEST_EXPECTED"))
    assert not np.any(table("TEST_ALLOWED"))


def test_without_the_option_there_are_no_tests_and_a_later_run_removes_them(folder, bundle_folder, tmp_path):
    folder = Path(shutil.copytree(folder, tmp_path / "twincat"))
    assert (folder / "Tests").is_dir()
    generate(load(bundle_folder), "twincat", folder.parent)
    assert not (folder / "Tests").exists()
    assert "TcUnit" not in (folder / "small.plcproj").read_text()


@pytest.mark.parametrize("target", ["iec", "plcopen", "beckhoff-ml"])
def test_other_targets_refuse_suites(lone_folder, target, tmp_path):
    with pytest.raises(TargetError, match=f"the target {target} has no test suites; --with-tests goes with twincat"):
        generate(load(lone_folder), TARGETS[target], tmp_path, with_tests=True)
    assert not list(tmp_path.glob("*/*.st"))


def test_the_lines_are_short(folder):
    for path in (folder / "Tests").iterdir():
        lines = path.read_text(encoding="utf-8").splitlines()
        assert all(len(line) <= 100 or line.lstrip().startswith("<POU") for line in lines), path
    assert GeneratedCode(folder, "twincat").table_bytes("FB_A_Test") > 1000
