"""`make commissioning` on a small scale; minutes, since a campaign is measured."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).resolve().parents[2] / "examples" / "commissioning" / "run.py"


@pytest.mark.slow
def test_the_whole_loop_over_ads(tmp_path):
    done = subprocess.run(
        [sys.executable, str(RUN), "--quick", "--out", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=3000,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    record = json.loads((tmp_path / "commissioning.json").read_text())
    assert record["passed"]
    assert all(model["passed"] for model in record["models"].values())
    motion = json.loads((tmp_path / "motion.json").read_text())
    assert motion["rms_after_deg"] < 0.3 * motion["rms_before_deg"]
    effects = json.loads((tmp_path / "reconciled" / "report.json").read_text())["effects"]
    assert "output_shaft_eccentricity" in {effect["name"] for effect in effects}
    assert len(list((tmp_path / "campaign").rglob("*rpm*.csv"))) == 24


def test_the_example_says_what_it_takes():
    done = subprocess.run(
        [sys.executable, str(RUN), "--help"], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--quick" in done.stdout
