"""The race itself: one contender that fails takes nobody else along, and every row is kept."""

import json
import os
import shutil
import signal
import sys
import time

import numpy as np
import pytest

from benchmarks import race
from benchmarks.harness import Harness, Result
from benchmarks.isolated import FailedError, all_isolated, isolated
from benchmarks.race_cases import cases
from st_codegen.st import Machine, load_project
from tests import families
from tests.cost.test_translator import GOLDEN, library


def test_results_errors_crashes_and_hangs_come_back():
    assert isolated(lambda: {"a": 1}, 600.0) == {"a": 1}
    with pytest.raises(FailedError, match=r"ZeroDivisionError: .*by zero"):
        isolated(lambda: 1 // 0, 600.0)
    with pytest.raises(FailedError, match="SystemExit: 3"):
        isolated(lambda: sys.exit(3), 600.0)
    with pytest.raises(FailedError, match="crashed: SIGKILL"):
        isolated(lambda: os.kill(os.getpid(), signal.SIGKILL), 600.0)
    with pytest.raises(FailedError, match="crashed: exit code 7"):
        isolated(lambda: os._exit(7), 600.0)
    with pytest.raises(FailedError, match="stopped after 0 s"):
        isolated(lambda: time.sleep(60), 0.2)


def test_several_at_a_time_swallow_errors(tmp_path):
    def good(name):
        return lambda: (tmp_path / name).write_text("done")

    all_isolated([good("a"), lambda: 1 // 0, good("b")], 600.0)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def test_every_row_is_in_the_file_as_soon_as_it_is_known(tmp_path, capsys):
    report = race.Report(tmp_path / "build" / "race.json")
    rows = [
        Result("c", race.OURS, 10.0, 100.0, 50.0, 1, 2, 0.1, 0.2, True, expected_most=90),
        Result("c", "peer", 1000.0, 300.0, exact=False),
        Result("c", "other", error="ValueError: no"),
        Result("d", "peer", 5.0, 5.0),
    ]
    for count, row in enumerate(rows, 1):
        report.add(row)
        kept = json.loads(report.path.read_text())
        assert [entry["contender"] for entry in kept] == [r.contender for r in rows[:count]]
    assert not list(report.path.parent.glob("*.partial"))
    expected = set("case contender ns_warm ns_cold instructions code_bytes data_bytes".split())
    assert expected | {"generate_s", "compile_s", "exact"} <= kept[0].keys()
    text = race.summary(report.results)
    assert "| c | 10 | 100 | 50 | 90 | peer | 1,000 | 100.00 | peer | 300 | 3.00 | yes |" in text
    assert "| d |" not in text
    assert "ValueError: no" in capsys.readouterr().out


def test_without_the_measured_table_the_public_cases_are_left(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(families, "SHARED", tmp_path / "missing")
    names = [name for name, _ in cases()]
    assert names
    assert not any(name.startswith("rig-") for name in names)
    assert "left out" in capsys.readouterr().out


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc: apt-get install gcc")
def test_the_whole_compensation_in_c(tmp_path):
    """Blocks in blocks, arrays as inputs, enumerations: cycle by cycle what the interpreter computes.

    SIN, COS and ATAN are each machine's own; harmonics of order 39 multiply an error of the angle by 39.
    """
    project = load_project([GOLDEN.parent / "bundle" / "generated" / "twincat"], "twincat")
    random = np.random.default_rng(0)
    n = 60
    speed, torque = random.uniform(-1900, 1900, n), random.uniform(0, 1900, n)
    names = [v.name for v in project.pous["FB_COMPENSATOR"].variables if v.section.name == "INPUT"]
    rows = np.column_stack(
        [np.full(n, float(v.initial)) for v in project.pous["FB_COMPENSATOR"].variables[: len(names)]]
    )
    for name, column in {
        "fThetaOut_rad": random.uniform(-50, 50, n),
        "fSpeed_rpm": np.where(np.arange(n) == 7, np.nan, speed),
        "fTorque_Nm": torque,
        "fTemperature_C": random.uniform(20, 40, n),
        "bEnable": np.ones(n),
    }.items():
        rows[:, names.index(name)] = column
    got = Harness(tmp_path).values(library(project, "FB_Compensator", tmp_path), rows, tmp_path)
    machine = Machine(project, rows=1)
    instance = machine.instance("FB_Compensator")
    for row, values in zip(rows, got, strict=True):
        inputs = dict(zip(names, row, strict=True))
        instance(**{k: bool(v) if k[0] == "b" else v for k, v in inputs.items()})
        for at, name in enumerate(("fTE_deg", "fCorrection_deg", "fWeight")):
            assert values[at] == pytest.approx(instance[name][0], rel=1e-11, abs=1e-13)
        assert [values[3], values[4], values[6]] == [instance[b][0] for b in ("bActive", "bValid", "bInRange")]
        assert values[5] == instance["eError"][0]
