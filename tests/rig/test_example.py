"""`make example` on a small scale: the whole way, what it writes, and what it keeps."""

import importlib.util
import itertools
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.harmonic_table import HarmonicTable, read_table, write_table
from st_codegen.errors import InputError
from st_codegen.rig.model import read_rig

pytestmark = pytest.mark.thorough

pytest.importorskip("numba")
pytest.importorskip("sklearn")
pytest.importorskip("matplotlib")

RUN = Path(__file__).resolve().parents[2] / "examples" / "motion" / "run.py"
NAMES = ("motion", "limits", "gains")
#: What others read of motion.json.
ROW = {
    "profile": str,
    "orders": list,
    "law": str,
    "tasks": str,
    "rms_before": float,
    "rms_after": float,
    "max_before": float,
    "max_after": float,
}


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("example_motion", RUN)
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(RUN.parent)
        patch.setitem(sys.modules, spec.name, module)  # dataclasses look their module up
        spec.loader.exec_module(module)
        yield module


@pytest.fixture(scope="module")
def out(example, tmp_path_factory):
    folder = tmp_path_factory.mktemp("example") / "out"
    with pytest.MonkeyPatch.context() as patch:
        for name, step in (("limit_jobs", 6), ("gain_jobs", 21)):
            every = getattr(example, name)
            patch.setattr(example, name, lambda *given, every=every, step=step: every(*given)[::step])
        example.main(["--quick", "--jobs", "1", "--out", str(folder)])
    return folder


def test_rows_have_the_columns_that_others_read(out):
    rows = json.loads((out / "motion.json").read_text())
    assert len(rows) == 5
    for row in rows:
        for name, kind in ROW.items():
            assert type(row[name]) is kind, name
        assert all(type(order) is int for order in row["orders"])
        assert row["law"] in ("published", "continuous", "full")
        assert row["tasks"] in ("one", "two", "split")
        assert 0.0 < row["rms_before"] <= row["max_before"]
        assert 0.0 < row["rms_after"] <= row["max_after"]


def test_the_generated_code_takes_the_error_down(out):
    """32 runs are a poor campaign: at least it gets better, most with the full law."""
    rows = json.loads((out / "motion.json").read_text())
    best = [row for row in rows if row["law"] == "full"]
    assert all(row["rms_after"] < 0.75 * row["rms_before"] for row in best)
    assert max(r["rms_after"] for r in best) < min(r["rms_after"] for r in rows if r["law"] == "published")


def test_proposed_runs_are_measured_beside_those_of_the_campaign(example, out):
    names = {folder: {path.name for path in (out / folder).rglob("*.csv")} for folder in ("campaign", "measured")}
    proposed = (out / "reconciled_1" / "next_runs.csv").read_text().splitlines()[1:]
    assert 0 < len(proposed) <= 12
    assert names["measured"] == names["campaign"] | {line.split(",")[0] for line in proposed}
    assert "structural_resonance" not in (out / "known.toml").read_text()


def test_what_limits_it_is_written_in_all_forms(out):
    rows = json.loads((out / "limits.json").read_text())
    names = [row["what"] for row in rows]
    assert len(set(names)) == len(names) == 3
    assert len((out / "limits.csv").read_text().splitlines()) == 1 + len(rows)
    assert all(name in (out / "limits.html").read_text() for name in names)
    assert (out / "limits.md").read_text().count("\n") == 2 + len(rows)


def test_what_was_found_is_taken_from_the_table(example, out):
    rig, known = read_rig(example.RIG), read_rig(out / "known.toml")
    table = read_table(out / "measured.csv")
    table = replace(table, orders=(156, 162), coefficients=rig.coefficients(table.at, (156, 162)))
    rest = example.rest_of(table, rig, known)
    assert np.allclose(rest.coefficients, known.coefficients(table.at, (156, 162)), atol=1e-15)
    assert np.abs(table.coefficients - rest.coefficients).max() > 1e-3


def test_where_nothing_was_found_the_models_stay_and_the_play_is_there(out):
    plain, new = ((out / name / "bundle.toml").read_text() for name in ("models_rest", "models"))
    assert plain == new
    assert "[play]" in new
    table = (out / "gains.md").read_text()
    assert "the campaign; the speed decides the direction" in table
    assert len(json.loads((out / "gains.json").read_text())) == 2


def test_the_tables_get_into_the_page(example, out, tmp_path):
    page = tmp_path / "motion.md"
    shutil.copy(RUN.parents[2] / "docs" / "motion.md", page)
    example.into_page(page, out, NAMES)
    text = page.read_text()
    for name in ("limits", "gains"):
        assert (out / f"{name}.md").read_text().strip() in text
    assert text.count("| quick | 0, 1 |") == 5
    example.into_page(page, out, NAMES)
    assert page.read_text() == text
    with pytest.raises(InputError, match="no such file"):
        example.into_page(page, tmp_path, NAMES)
    page.write_text(text.replace("<!-- gains:", ""))
    with pytest.raises(InputError, match="<!-- gains:"):
        example.into_page(page, out, NAMES)


@pytest.mark.slow
def test_a_measured_table_is_moved_with_and_without_its_mean(example, tmp_path):
    rig = read_rig(example.RIG)
    levels = itertools.product((1.0, -1.0), (100.0, 900.0, 1700.0), (0.0, 100.0, 400.0, 800.0), (25.0, 30.0, 35.0))
    sign, speed, torque, temperature = np.array([*levels]).T
    values = rig.coefficients(Conditions.of(sign, speed, torque, temperature), (0, 1))
    table = HarmonicTable(sign < 0, speed, torque, temperature, (0, 1), values)
    write_table(table, tmp_path / "table.csv")
    options = ["--quick", "--jobs", "1", "--out", str(tmp_path / "out"), "--real", str(tmp_path / "table.csv")]
    example.main(options)
    rows = json.loads((tmp_path / "out" / "real.json").read_text())
    gone = {row["what"]: row["rms_reduction"] for row in rows}
    assert len(gone) == 6
    assert min(share for what, share in gone.items() if "without the mean" in what) > 0.97
    assert max(share for what, share in gone.items() if "published" in what) < 0.9
    assert read_table(tmp_path / "out" / "real" / "between" / "rig.csv").temperature_C.tolist() == [30.0] * 24
    assert (tmp_path / "out" / "real.md").read_text().count("\n| ") == 6


def test_the_table_of_gains_has_all_steps_on_all_rigs(example):
    jobs = example.gain_jobs("robot", (0, 1))
    assert len({job.name for job in jobs}) == len(jobs) == 6 * 7
    rows = [
        {"what": job.name.split("/")[1], "rig": job.name.split("/")[2], "rms_reduction": 0.5, "max_reduction": 0.01 * n}
        for n, job in enumerate(jobs)
    ]
    text = example.gains_table(rows).markdown()
    assert "50.0 % (50.0 % .. 50.0 %)" in text
    assert "2.0 % (1.0 % .. 3.0 %)" in text
    assert text.count("\n") == 2 + 6


def test_the_table_of_limits_changes_one_thing_at_a_time(example):
    best, *others = example.limit_jobs(example.Scale(profiles=("robot",)))
    for word in ("lead", "noise", "jitter", "ripple", "warms", "sensor", "differ", "only", "continuous", "published"):
        assert any(word in job.name for job in others), word
    for job in others:
        assert (job.machine == best.machine) != (job.wish == best.wish), job.name
        job.machine.build()


def test_a_second_run_keeps_what_is_there(example, out, monkeypatch, capsys):
    for place in ((example, "command"), (sys.modules["jobs"], "simulate")):
        monkeypatch.setattr(*place, lambda *_, **__: pytest.fail("made again"))
    (out / "motion.json").unlink()
    example.main(["--quick", "--jobs", "1", "--out", str(out), "--only", "campaign", "--only", "more", "--only",
                  "train", "--only", "compile", "--only", "motion"])  # fmt: skip
    assert capsys.readouterr().out.count("kept") == 4
    assert len(json.loads((out / "motion.json").read_text())) == 5


def test_the_campaign_has_the_runs_that_the_pages_say(example):
    scale = example.Scale()
    assert len(scale.speeds_rpm) * len(scale.torques_Nm) * len(scale.temperatures_C) == 1188


def test_an_interrupted_stage_is_made_again(example, tmp_path):
    steps, made = [], tmp_path / "made"
    stages = example.Example(tmp_path, example.QUICK, 1)

    def make():
        steps.append("made")
        made.mkdir(exist_ok=True)
        if len(steps) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stages._once("made", made, "of this", make)
    stages._once("made", made, "of this", make)
    stages._once("made", made, "of this", make)
    assert len(steps) == 2
    stages._once("made", made, "of that", make)
    assert len(steps) == 3


def test_the_tuning_motion_goes_there_and_back(example, tmp_path):
    from st_codegen.rig.profiles import read_profile

    (tmp_path / "tuning.csv").write_text(example.tuning_profile())
    profile = read_profile(tmp_path / "tuning.csv", 250e-6)
    assert profile.angle_deg[-1] == pytest.approx(15.0)
    signs = profile.direction
    assert (signs[1:] * signs[:-1] < 0).sum() == 2
    assert profile.torque_Nm.max() == pytest.approx(150.0, rel=1e-3)
