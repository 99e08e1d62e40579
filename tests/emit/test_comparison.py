"""`--with-comparison`: the program runs the rows it is given, keeps to its cycle, and nothing else changes."""

import json
import re

import numpy as np
import pytest

from st_codegen import generate, verify
from st_codegen.driver import differences
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import TargetError
from st_codegen.project.bundle import load
from st_codegen.proof.arithmetic import libraries_of
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st import Machine


def comparing(folder):
    code = GeneratedCode(folder, "twincat")
    machine = Machine(code.project, libraries=libraries_of(folder))
    return code, machine, machine.program("PRG_Comparison")


def test_the_program_runs_rows_a_few_at_a_time_and_answers_as_the_block_does(lone_folder, tmp_path):
    made = generate(lone_folder, "twincat", tmp_path, with_comparison=True)
    code, machine, program = comparing(made.folder)
    rows = 13
    x = np.random.default_rng(0).uniform([100, 0, 25], [1800, 1800, 35], size=(rows, 3))
    x[4, 1] = np.nan
    signals = machine.globals
    inputs = np.zeros(1500)
    inputs[: 3 * rows] = x.ravel()
    signals["GVL_Comparison.fInputs"] = inputs
    for name, value in {"nBlock": 1, "nRows": rows, "nPerCycle": 5, "nRequest": 7}.items():
        signals[f"GVL_Comparison.{name}"] = value
    cycles = 0
    while signals["GVL_Comparison.nAnswer"] != 7:
        program()
        cycles += 1
    assert cycles == 3
    expected = code.run_model("FB_Te", x, 1)
    got = signals["GVL_Comparison.fOutputs"][:rows]
    assert np.array_equal(got, expected.values[:, 0], equal_nan=True)
    assert np.array_equal(signals["GVL_Comparison.bValid"][:rows], expected.valid)
    assert np.all(signals["GVL_Comparison.nTime"][:rows] < 10_000_000)
    program()
    assert signals["GVL_Comparison.nAnswer"] == 7


@pytest.mark.parametrize("request_", [{"nRows": -3}, {"nRows": 2**31 - 1}, {"nBlock": 99}, {"nPerCycle": -1}])
def test_a_request_that_makes_no_sense_ends(lone_folder, tmp_path, request_):
    _, machine, program = comparing(generate(lone_folder, "twincat", tmp_path, with_comparison=True).folder)
    given = {"nBlock": 1, "nRows": 3, "nPerCycle": 500, "nRequest": 1, **request_}
    for name, value in given.items():
        machine.globals[f"GVL_Comparison.{name}"] = value
    for _ in range(3):
        program()
    assert machine.globals["GVL_Comparison.nAnswer"] == 1
    assert request_ != {"nBlock": 99} or not machine.globals["GVL_Comparison.bValid"].any()


def test_only_what_is_asked_for_is_added_and_verify_leaves_its_task_out(bundle_folder, tmp_path):
    bundle = load(bundle_folder)
    plain = generate(bundle, "twincat", tmp_path / "plain").folder
    more = generate(bundle, "twincat", tmp_path / "more", with_comparison=True).folder
    own = {path.relative_to(plain) for path in plain.rglob("*.TcPOU")} | {
        path.relative_to(plain) for path in plain.rglob("*.TcGVL")
    }
    assert all((plain / name).read_bytes() == (more / name).read_bytes() for name in own)
    added = {path.name for path in more.rglob("*") if path.is_file()} - {path.name for path in plain.rglob("*")}
    assert added == {
        *("ComparisonTask.TcTTO", "GVL_Comparison.TcGVL", "PRG_Comparison.TcPOU"),
        *("GVL_Record.TcGVL", "PRG_Record.TcPOU"),
    }
    assert verify(bundle, tmp_path / "more", rows=200).passed
    assert not list(differences(bundle, "twincat", tmp_path / "more", with_comparison=True))
    assert list(differences(bundle, "twincat", tmp_path / "more"))


def test_the_fingerprint_is_that_of_the_text(lone_folder, tmp_path):
    def fingerprint(out):
        folder = generate(lone_folder, "twincat", out, with_comparison=True).folder
        known = json.loads((folder / "st-codegen.json").read_text())["comparison"]["fingerprint"]
        assert f"16#{known.upper()}" in (folder / "GVLs/GVL_Comparison.TcGVL").read_text(encoding="utf-8-sig")
        return known

    first = fingerprint(tmp_path / "a")
    assert first == fingerprint(tmp_path / "b")
    path = lone_folder / "te.txt"
    text = path.read_text()
    value = text.split("leaf_value=")[1].split()[0]
    digit = next(number for number in range(len(value) - 1, 0, -1) if value[number] in "1234")
    path.write_text(text.replace(value, f"{value[:digit]}{int(value[digit]) + 1}{value[digit + 1 :]}", 1))
    assert fingerprint(tmp_path / "a") != first


def test_targets_without_a_clock_refuse(lone_folder, tmp_path):
    for name, target in TARGETS.items():
        if not target.has_comparison:
            with pytest.raises(TargetError, match="--with-comparison"):
                generate(lone_folder, name, tmp_path, with_comparison=True)


def test_every_choice_of_a_block_has_an_answer_for_no_block(bundle_folder, tmp_path):
    made = generate(bundle_folder, "twincat", tmp_path, with_comparison=True)
    (path,) = made.folder.rglob("PRG_Comparison.TcPOU")
    choices = re.findall(r"\bCASE\b.*?\bEND_CASE\b", path.read_text(encoding="utf-8"), re.DOTALL)
    assert len(choices) == 2  # how many rows a request has, and which block runs
    assert all(re.search(r"^ *ELSE\r?$", choice, re.MULTILINE) for choice in choices)
