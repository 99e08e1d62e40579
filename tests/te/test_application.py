"""What belongs to the application of a bundle: programs, tasks, signals, in both dialects."""

import dataclasses
import re

import pytest

from st_codegen.st.syntax.source import read_texts
from st_codegen.te.compensation.programs import SINGLE_TASK, TWO_TASKS
from st_codegen.te.harmonics import Direction
from tests.st.helpers import violations
from tests.te.projects import BOTH, PAPER_ORDERS, PLAY, contents, described, loaded, project, texts

SHAPES = [
    ((0,), BOTH),
    ((1,), (Direction.BACKWARD,)),
    ((240, 3), BOTH),
    (PAPER_ORDERS, BOTH),
]


def test_the_signals_of_the_machine_can_be_linked():
    text = texts(project(), "twincat")["GVLs/GVL_Machine.TcGVL"].replace("\r", "")
    linked = dict(re.findall(r"^    (\w+) AT (%[IQ]\*) : (?:LREAL|BOOL);", text, re.M))
    inputs = {"fThetaOut_rad", "fSpeed_rpm", "fTorque_Nm", "fTemperature_C", "bEnable"}
    outputs = {"fTE_deg", "fCorrection_deg", "fWeight", "bActive", "bValid", "bInRange"}
    assert linked == dict.fromkeys(inputs, "%I*") | dict.fromkeys(outputs, "%Q*")
    assert "fSignedLoad AT %I* : LREAL;" in texts(project(play=PLAY), "twincat")["GVLs/GVL_Machine.TcGVL"]
    assert all(" AT %" not in other for other in texts(project(), "iec").values())


@pytest.mark.parametrize(("orders", "directions", "play"), [*((*shape, None) for shape in SHAPES), (*SHAPES[0], PLAY)])
def test_bundles_of_any_shape_give_text_that_is_checked_portable_and_narrow(orders, directions, play):
    for target in ("twincat", "iec"):
        loaded(target, orders, directions, play=play)
        for path, text in texts(project(orders, directions, play=play), target).items():
            wide = [line for line in text.splitlines() if len(line) > 100 and "<" not in line and path[-4:] != ".sln"]
            assert not wide, path
            assert "RETURN" not in text
            assert not re.search(r"[ \t]$", text, re.M), path
    (text,) = texts(project(orders, directions, play=play), "iec").values()
    assert violations(read_texts({"a.st": text})) == ()


def tasks_of(files):
    return {
        path: (re.search(r"<CycleTime>(\d+)", text)[1], re.findall(r"<Name>(\w+)</Name>", text))
        for path, text in files.items()
        if path.endswith(".TcTTO")
    }


def test_one_task_or_two_call_the_programs():
    model, te = described()
    assert tasks_of(texts(project(), "twincat")) == {"PlcTask.TcTTO": ("500", ["PRG_Experiment", "PRG_Main"])}
    two = contents(model, dataclasses.replace(te, tasks=2))
    assert tasks_of(texts(two, "twincat")) == {
        "FastTask.TcTTO": ("250", ["PRG_Fast"]),
        "SlowTask.TcTTO": ("500", ["PRG_Experiment", "PRG_Slow"]),
    }
    # a smaller number is more urgent
    assert TWO_TASKS[0].priority < TWO_TASKS[1].priority
    assert SINGLE_TASK[0].cycle_us == TWO_TASKS[1].cycle_us


def test_programs_know_the_cycle_times_of_their_tasks():
    files = texts(project(), "twincat")
    cycles = {task.cycle_us: task.programs for task in (*SINGLE_TASK, *TWO_TASKS)}
    for microseconds, programs in cycles.items():
        for program in programs:
            declared = re.findall(r"CYCLE_S : LREAL := (\S+);", files[f"POUs/{program}.TcPOU"])
            assert [float(value) for value in declared] == [microseconds * 1e-6] * (program != "PRG_Slow")


def test_an_error_number_has_one_meaning_in_all_blocks():
    projects = (project(), project(directions=(Direction.BACKWARD,)))
    text = "".join(text for contents in projects for text in texts(contents, "iec").values())
    declared = re.findall(r"\b(ERROR_\w+) : DINT := (\d+); \(\* (.+) \*\)", text)
    by_number, by_name = ({row[key]: row for row in declared} for key in (1, 0))
    assert len(declared) > len(by_number) == len(by_name) == len(set(declared))
    (enumeration,) = (text for path, text in texts(project(), "twincat").items() if path.endswith("Error.TcDUT"))
    listed = re.findall(r"(\w+) := (\d+),? \(\* (.+) \*\)", enumeration)
    assert {(f"ERROR_{name}", number, meaning) for name, number, meaning in listed} == set(declared)


def test_the_portable_file_leaves_out_what_needs_global_variables():
    (text,) = texts(project(), "iec").values()
    assert re.findall(r"^PROGRAM (\w+)", text, re.M) == ["PRG_Main", "PRG_Experiment"]
    assert "VAR_GLOBAL" not in text
    assert "E_TEError" not in text
