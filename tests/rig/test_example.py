"""`make example` on a small scale: the whole way, what it writes, and what it keeps."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba")
pytest.importorskip("sklearn")
pytest.importorskip("matplotlib")

RUN = Path(__file__).resolve().parents[2] / "examples" / "motion" / "run.py"
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
    every = example.limit_jobs
    example.limit_jobs = lambda scale: every(scale)[::6]
    example.main(["--quick", "--jobs", "1", "--out", str(folder)])
    example.limit_jobs = every
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
