"""Simulated campaigns: what is written is what the campaign's reader reads, and the rig's coefficients come back."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from st_codegen.campaign.conditions import Conditions, OperatingPoint
from st_codegen.campaign.curves import RunFile, read_run, scan
from st_codegen.cli.main import cli, main
from st_codegen.errors import InputError
from st_codegen.rig.campaign import Measuring, read_conditions, simulate_campaign, simulate_run
from st_codegen.rig.model import read_rig
from st_codegen.te.harmonics import Direction

RIG = Path(__file__).resolve().parents[2] / "examples" / "rv160n" / "rig.toml"


def find_runs(folder: Path) -> tuple[RunFile, ...]:
    """The curve files of a folder, in which there is nothing else."""
    files, bad = scan(folder)
    assert not bad
    return files


def test_written_curves_hold_the_coefficients(tmp_path):
    rig = read_rig(RIG)
    (tmp_path / "C.csv").write_text("speed_rpm,torque_Nm,temperature_C\n1000,900,30\n1800,0,25.5\n")
    result = CliRunner().invoke(
        cli, ["simulate", "campaign", "--rig", str(RIG), "--conditions", str(tmp_path / "C.csv"), "--out",
              str(tmp_path / "out"), "--samples", "2000", "--noise", "0"]
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    files = find_runs(tmp_path / "out")
    assert [file.conditions for file in files] == [OperatingPoint(1000, 900, 30), OperatingPoint(1800, 0, 25.5)]
    assert files[0].path == tmp_path / "out" / "Test_30degree" / "1000rpm" / "1000.0rpm900.0Nm30.0deg.csv"
    for file in files:
        run = read_run(file.path, file.conditions)
        for direction, sign in ((Direction.FORWARD, 1), (Direction.BACKWARD, -1)):
            curve = run.curves[direction]
            at = Conditions.of(sign, *dataclasses.astuple(file.conditions))
            for order, expected in zip((1, 39, 240), rig.coefficients(at, [1, 39, 240])[0], strict=True):
                found = 2 * np.mean(curve.te_deg * np.exp(-1j * order * np.deg2rad(curve.angle_deg)))
                assert found == pytest.approx(expected, abs=1e-11)  # twelve digits are written


def test_noise_depends_on_seed_and_run_and_has_the_size_asked_for():
    rig = read_rig(RIG)
    point = OperatingPoint(1000, 900, 30)
    quiet = simulate_run(rig, point, Measuring(4096, 0.0, 1), 0).curves[Direction.FORWARD].te_deg
    loud = [simulate_run(rig, point, Measuring(4096, 0.01, seed), run).curves[Direction.FORWARD].te_deg
            for seed, run in ((1, 0), (1, 0), (2, 0), (1, 1))]  # fmt: skip
    assert (loud[0] == loud[1]).all()
    assert (loud[0] != loud[2]).any() and (loud[0] != loud[3]).any()
    # standard deviation of 4096 samples: relative error 1/sqrt(2*4096) = 1.1 %, five times that
    assert np.std(loud[0] - quiet) == pytest.approx(0.01, rel=0.055)


def test_full_size_is_that_of_the_rig():
    assert Measuring().count(100, 81.0) == 194400
    assert Measuring().count(1800, 81.0) == 10800


def test_conditions_that_no_name_holds_are_numbered(tmp_path):
    points = (OperatingPoint(1000.0, 1e-5, 30.0), OperatingPoint(1000.0, 0.0, -5.5))
    simulate_campaign(read_rig(RIG), points, tmp_path / "c", Measuring(samples=500))
    assert {file.conditions for file in find_runs(tmp_path / "c")} == set(points)
    simulate_campaign(read_rig(RIG), points[1:], tmp_path / "d", Measuring(samples=500))
    assert not (tmp_path / "d" / "conditions.csv").exists()
    assert [file.conditions for file in find_runs(tmp_path / "d")] == [points[1]]


def test_repeated_runs_are_numbered(tmp_path):
    rig = read_rig(RIG)
    point = OperatingPoint(1000, 900, 30)
    simulate_campaign(rig, [point, point], tmp_path / "out", Measuring(600))
    files = find_runs(tmp_path / "out")
    assert [file.path.name for file in files] == ["run_00001.csv", "run_00002.csv"]
    assert {file.conditions for file in files} == {point}


def test_refusals_leave_nothing_behind(tmp_path, capsys):
    rig = read_rig(RIG)
    with pytest.raises(InputError, match="486 samples a revolution: this rig needs 487 or more"):
        simulate_campaign(rig, [OperatingPoint(1000, 900, 30)], tmp_path / "out", Measuring(486))
    assert not (tmp_path / "out").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        simulate_campaign(rig, [OperatingPoint(1000, 900, 30)], tmp_path / "full", Measuring(600))
    (tmp_path / "C.csv").write_text("speed_rpm,torque_Nm,temperature_C\n0,900,30\nx,1,2\n")
    with pytest.raises(InputError, match="2 problems"):
        read_conditions(tmp_path / "C.csv")
    with pytest.raises(SystemExit) as caught:
        main(["simulate", "campaign", "--rig", str(tmp_path / "no.toml"), "--conditions", "x", "--out", "y"])
    assert caught.value.code == 2
    assert "no such file" in capsys.readouterr().err


def test_all_files_that_are_wrong_are_named_at_once(tmp_path, capsys):
    wrong = ["--rig", str(tmp_path / "no.toml"), "--conditions", str(tmp_path / "no.csv"), "--out", str(tmp_path / "c")]
    with pytest.raises(SystemExit):
        main(["simulate", "campaign", *wrong])
    said = capsys.readouterr().err
    assert "no.toml" in said and "no.csv" in said


def test_conditions_at_which_the_formulas_do_not_hold_write_nothing(tmp_path):
    """3 MN m gave files with a transmission error of -105 deg."""
    points = (OperatingPoint(1000.0, 100.0, 30.0), OperatingPoint(3000.0, 3e6, 3000.0))
    with pytest.raises(InputError, match=r"deg at 3000 rpm, .*: its formulas do not hold there"):
        simulate_campaign(read_rig(RIG), points, tmp_path / "c", Measuring(samples=500))
    # noise of 1000 deg was called a failure of the formulas alone
    with pytest.raises(InputError, match=r"deg at 1000 rpm, .*, or the noise is louder than any error of a reducer"):
        simulate_campaign(read_rig(RIG), points[:1], tmp_path / "c", Measuring(500, noise_deg=1000.0))
    assert not (tmp_path / "c").exists()
