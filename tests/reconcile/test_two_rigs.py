"""The simulated rig and the blind generator, written apart from the same page, give the same curves without noise."""

import os
import subprocess
import sys

import numpy as np
import pytest

from .blind import effects, hidden, layout, run, write

SAMPLES = 1024


def simulated(folder, runs):
    """Curves of `st-codegen simulate campaign` for `folder`/rig.toml, shape (2, runs, samples), over growing angles."""
    columns = (runs.speed_rpm, runs.torque_Nm, runs.temperature_C)
    rows = [f"{speed:g},{torque:g},{heat:g}" for speed, torque, heat in zip(*columns, strict=True)]
    (folder / "C.csv").write_text("speed_rpm,torque_Nm,temperature_C\n" + "\n".join(rows) + "\n")
    command = [sys.executable, "-m", "st_codegen", "simulate", "campaign", "--rig", folder / "rig.toml"]
    command += ["--conditions", folder / "C.csv", "--out", folder / "sim", "--samples", SAMPLES, "--noise", 0, "-q"]
    environment = {**os.environ, "PYTHONPATH": str(run.ROOT)}
    subprocess.run(list(map(str, command)), check=True, env=environment, capture_output=True)
    curves = np.empty((2, len(runs), SAMPLES))
    files = list((folder / "sim").rglob("*rpm*Nm*deg.csv"))
    assert len(files) == len(runs)
    for place in range(len(runs)):
        speed, torque, heat = (column[place] for column in columns)
        (file,) = [path for path in files if path.name == f"{speed:.1f}rpm{torque:.1f}Nm{heat:.1f}deg.csv"]
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        theta = np.arange(SAMPLES) * 360.0 / SAMPLES
        for side in (0, 1):
            angle, value = table[:, 2 * side] % 360.0, table[:, 2 * side + 1]
            order = np.argsort(angle)
            assert angle[order] == pytest.approx(theta, abs=1e-6)
            curves[side, place] = value[order]
    return curves


@pytest.mark.parametrize("seed", [0, 1])
def test_both_give_the_same_curves(seed, tmp_path):
    """A rig with every effect at once, of random sizes."""
    rng = np.random.default_rng(seed)
    ones = [hidden.MAKERS[name](rng) for name in effects.NAMES if name not in effects.IN_TIME]
    known = hidden.healthy(rng, ones, ())
    tables = [*known.true, *(one.table for one in ones)]
    # of a delay there is at most one
    tables = [table for table in tables if table["name"] != effects.DELAY or table is ones[-1].table]
    assert {table["name"] for table in tables} == set(effects.NAMES) - set(effects.IN_TIME)
    runs = layout.Conditions(np.array([100.0, 1080.0]), np.array([0.0, 1700.0]), np.array([25.0, 33.0]))
    write.rig(tmp_path / "rig.toml", {"rig": known.head}, tables)
    ours = effects.curve(effects.coefficients(known.head, tables, runs), SAMPLES)
    theirs = simulated(tmp_path, runs)
    # files carry twelve decimals; a notch is followed to order 60
    assert theirs == pytest.approx(ours, abs=1e-9)
