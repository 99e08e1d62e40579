"""Commands that are killed at random moments: nothing half-written, a second run works, nothing is left behind."""

import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("polars")
pytest.importorskip("skops")
pytest.importorskip("numba")

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.harmonic_table import joined, read_table, write_table
from st_codegen.cli.tables import ERRORS, PREDICTIONS, TABLE
from st_codegen.files.temporary import PREFIX
from st_codegen.project.bundle import load
from st_codegen.rig.campaign import Measuring, simulate_campaign
from st_codegen.rig.model import read_rig
from tests.cli.helpers import snapshot
from tests.training.conftest import ORDERS, a_table

ROOT = Path(__file__).parents[2]
RIG = ROOT / "examples" / "rv160n" / "rig.toml"
KILLS = 5
FAST = ["--folds", "2", "--jobs", "2", "--work", "fits.sqlite"]
COMMANDS = {
    "train": ["train", "t.csv", "--out", "out", "--families", "DT,ET", *FAST],
    "tables": ["tables", "data", "--out", "out", "--repeats", "1", "--families", "DT,ET", *FAST],
    "campaign": ["simulate", "campaign", "--rig", RIG, "--conditions", "c.csv", "--out", "out", "--samples", "4096"],
    "motion": [
        *("simulate", "motion", "--models", ROOT / "examples" / "rv160n" / "models", "--rig", RIG),
        *("--profile", "pick.csv", "--orders", "0,1", "--out", "out"),
    ],
    "reconcile": ["reconcile", "--rig", RIG, "--measured", "measured", "--out", "out"],
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """What the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    table = joined([a_table(noise=1e-6), a_table(backward=True, noise=1e-6)])
    write_table(table, folder / "t.csv")
    data = folder / "data"
    data.mkdir()
    write_table(table.rows(~table.backward), data / TABLE)
    forward = read_table(data / TABLE)
    write_table(forward.rows(np.arange(0, len(forward), 5)), data / PREDICTIONS)
    rows = [f"{f},{q},{k},1.0,2.0" for f in ("DT", "ET") for q in ("ampl", "phase") for k in ORDERS]
    (data / ERRORS).write_text("\n".join(["method,quantity,harmonic,MAE,RMSE", *rows]) + "\n")
    points = [(speed, torque, 30) for speed in range(200, 1800, 200) for torque in range(0, 1800, 200)]
    lines = ["speed_rpm,torque_Nm,temperature_C", *(",".join(map(str, point)) for point in points)]
    (folder / "c.csv").write_text("\n".join(lines) + "\n")
    (folder / "pick.csv").write_text("t,theta_out,torque_Nm\n0,0,100\n0.2,3,200\n0.4,9,200\n0.6,12,100\n")
    few = [OperatingPoint(*point) for point in points[::4]]
    simulate_campaign(read_rig(RIG), few, folder / "measured", Measuring(1024))
    return folder


def start(arguments, inputs, folder):
    """A command that runs in `folder`, to whose inputs it has links."""
    folder.mkdir(exist_ok=True)
    for path in inputs.iterdir():
        if not (folder / path.name).exists():
            (folder / path.name).symlink_to(path)
    command = [sys.executable, "-W", "ignore", "-m", "st_codegen", *map(str, arguments), "-q"]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def finished(process, seconds=None):
    """The process ends well, within the seconds if there are any. Raises TimeoutExpired where it still runs then."""
    assert process.wait(seconds) == 0, process.stderr.read()


def fits(folder):
    """How many fits are kept."""
    if not (folder / "fits.sqlite").exists():
        return 0
    with sqlite3.connect(folder / "fits.sqlite") as database:
        return database.execute("SELECT count(*) FROM fits").fetchone()[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_random_moments(name, inputs, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    source = random.Random(name)
    started = time.monotonic()
    finished(start(COMMANDS[name], inputs, tmp_path / "whole"))
    spent = time.monotonic() - started
    whole = snapshot(tmp_path / "whole" / "out")
    folder = tmp_path / "killed"
    kept, killed = 0, 0
    while killed < KILLS:
        process = start(COMMANDS[name], inputs, folder)
        started = time.monotonic()
        try:
            finished(process, source.uniform(0.1, 0.98) * spent)
            # it was faster than the one before: the machine has less to do, or some of the work was kept
            spent = time.monotonic() - started
        except subprocess.TimeoutExpired:
            process.kill()
            ended = process.wait()
            assert ended in (0, -signal.SIGKILL), process.stderr.read()
            killed += ended != 0
        assert fits(folder) >= kept  # what was finished is not lost
        kept = fits(folder)
        if (folder / "out").exists():
            assert_whole(name, folder / "out", whole)
            if name == "campaign":  # which writes new folders only
                shutil.rmtree(folder / "out")
    finished(start(COMMANDS[name], inputs, folder))
    assert_whole(name, folder / "out", whole)
    assert not [path for path in folder.rglob("*") if path.name.startswith(PREFIX) or path.suffix == ".part"]


def assert_whole(name, out, whole):
    """All files are there, each as it must be."""
    found = {name: content for name, content in snapshot(out).items() if not name.startswith(PREFIX)}
    assert set(found) == set(whole)
    if name == "train":  # the files of fitted models have times in them
        assert found["bundle.toml"] == whole["bundle.toml"]
        rows = a_table().conditions
        for one, other in zip(load(out).models, load(out.parents[1] / "whole" / "out").models, strict=True):
            assert np.array_equal(one.predict(rows), other.predict(rows))
    else:
        assert found == whole
