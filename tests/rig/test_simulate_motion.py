"""`st-codegen simulate motion`: files, faults, and its page in a real browser."""

import csv
import json
import re
import shutil
import subprocess
from types import SimpleNamespace

import pytest

pytest.importorskip("numba")
pytest.importorskip("matplotlib")

from st_codegen.cli.choices import DIALECTS
from st_codegen.cli.main import main
from st_codegen.errors import InputError
from st_codegen.rig import motion_files, study
from st_codegen.rig.motion import CompensationCase
from st_codegen.rig.tasks import TaskForm
from tests.browser import faults
from tests.rig.conftest import LINEAR_RIG

PROFILE = "t,theta_out,torque_Nm\n0,0,100\n0.2,3,200\n0.4,9,200\n0.6,12,100\n0.7,12,100\n"
ROW = {"profile", "orders", "law", "tasks", "rms_before", "rms_after", "max_before", "max_after"}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motion")
    (folder / "rig.toml").write_text(LINEAR_RIG)
    (folder / "pick.csv").write_text(PROFILE)
    return folder


def arguments(files, models, **changes):
    options = {"--models": models, "--rig": files / "rig.toml", "--profile": files / "pick.csv", "--out": files / "out"}
    return ["simulate", "motion", *(str(part) for pair in (options | changes).items() for part in pair)]


@pytest.fixture(scope="module")
def out(files, linear_folder):
    wanted = ["--orders", "0,1", "--orders", "all", "--law", "full", "--recording", "-q"]
    with pytest.raises(SystemExit) as caught:
        main([*arguments(files, linear_folder), *wanted])
    assert caught.value.code == 0
    return files / "out"


def test_all_that_is_wrong_with_a_wish_is_said_at_once(files, linear_folder, capsys):
    wrong = {"--profile": "nope", "--out": files / "no", "--lead": "soon", "--set": "fX", "--orders": "7"}
    with pytest.raises(SystemExit) as caught:
        main(arguments(files, linear_folder, **wrong))
    said = " ".join(capsys.readouterr().err.split())
    assert caught.value.code == 2 and said.startswith("error: 4 problems")
    assert all(part in said for part in ("no model for order 7", "lead 'soon'", "'fX': give", "profile 'nope'")), said
    assert not (files / "no").exists()


def test_no_two_cases_of_a_study_have_one_label():
    """Sets of five orders and more are counted, and those of one size are listed."""
    cases = [((1, 2, 3, 4, 5), 0.0), ((1, 2, 3, 4, 6), 0.0), (tuple(range(9)), 0.0), ((1, 39), 0.0)]
    outcomes = [
        SimpleNamespace(case=CompensationCase(orders, "full", TaskForm.ONE, lead_s=lead)) for orders, lead in cases
    ]
    names = [motion_files.label(SimpleNamespace(outcomes=outcomes), outcome) for outcome in outcomes]
    assert names == [
        "orders 1 2 3 4 5, full, one", "orders 1 2 3 4 6, full, one", "9 orders, full, one", "orders 1 39, full, one",
    ]  # fmt: skip


def test_the_page_says_how_many_cases_its_picture_has():
    """Of two sets of orders by two laws and two forms two cases were in the table alone."""
    assert motion_files._drawn(SimpleNamespace(outcomes=[None] * 8)) == "Of 8 cases the first 6 are drawn."
    assert not motion_files._drawn(SimpleNamespace(outcomes=[None] * 6))


def test_rows_curves_and_a_recording(out):
    rows = json.loads((out / "motion.json").read_text())
    assert [(row["orders"], row["tasks"]) for row in rows] == [
        ([0, 1], "two"),
        ([0, 1], "one"),
        ([0, 1, 39], "two"),
        ([0, 1, 39], "one"),
    ]
    assert all(set(row) >= ROW for row in rows)
    # exact models: with all orders latency is left, without order 39 that order besides
    assert max(row["rms_after"] for row in rows[2:]) < 0.5 * min(row["rms_after"] for row in rows[:2])
    assert rows[0]["latency_us"] == pytest.approx(1325.3)
    assert rows[2]["limit_output_rpm"] == pytest.approx(754.5 / 39 * 60, rel=1e-4)
    with (out / "motion.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [float(row["rms_after"]) for row in table] == [row["rms_after"] for row in rows]
    lines = (out / "curves.csv").read_text().splitlines()
    assert len(lines) == 1 + 701
    recording = (out / "recording.csv").read_text().splitlines()
    assert recording[0] == "t,theta_ref,theta_mot,theta_in,theta_out,speed_rpm,torque_Nm,temperature_C"
    assert len(recording) == 1 + 2801
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "in the simulation: of case orders 0 1 39, full, two." in page and ">measured<" not in page


def test_models_are_spread_as_they_will_be(files, linear_folder, monkeypatch, capsys):
    def asked(bundle, target, outputs_per_cycle):
        raise InputError(f"spread by {outputs_per_cycle}")

    monkeypatch.setattr(study, "EmittedCompensator", asked)
    with pytest.raises(SystemExit):
        main([*arguments(files, linear_folder), "--outputs-per-cycle", "7"])
    assert "spread by 7" in capsys.readouterr().err


def test_the_page_in_a_browser(out, tmp_path):
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("no browser: install chromium to have the page drawn (apt-get install chromium)")
    page = (out / "report.html").resolve().as_uri()
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        f"--user-data-dir={tmp_path}",
    ]

    def browse(*more):
        return subprocess.run([*command, *more, page], capture_output=True, text=True, timeout=600, check=False)

    shown = browse("--dump-dom")
    assert shown.returncode == 0, shown.stderr
    for width in (400, 1200):
        count, found = faults((out / "report.html").read_text(encoding="utf-8"), width, tmp_path)
        assert count > 20
        assert found == []
    for text in ("Motion pick", "Error of the output", "not compensated", "1325.3 us", "754.5 Hz"):
        assert text in shown.stdout
    assert shown.stdout.count("<svg") == 3
    picture = tmp_path / "page.png"
    browse(f"--screenshot={picture}", "--window-size=1000,1800")
    pixels = pytest.importorskip("matplotlib.image").imread(picture)
    assert pixels.shape[:2] == (1800, 1000)
    # the pictures are there: blue of the first curve, and grey of the uncompensated one
    colours = pixels[..., :3].reshape(-1, 3) * 255
    assert (abs(colours - (0x00, 0x72, 0xB2)).max(axis=1) < 12).sum() > 200
    assert (abs(colours - (0x99, 0x99, 0x99)).max(axis=1) < 12).sum() > 200


@pytest.mark.thorough
@pytest.mark.parametrize("target", DIALECTS)
def test_each_dialect_that_is_offered_moves_the_axis_alike(files, linear_folder, out, target, capsys):
    """plcopen and beckhoff-ml were offered, and refused as unknown dialects."""
    place = files / target
    with pytest.raises(SystemExit) as caught:
        wanted = ["--orders", "0,1", "--law", "full", "-q"]
        main([*arguments(files, linear_folder, **{"--target": target, "--out": place}), *wanted])
    assert caught.value.code == 0, capsys.readouterr().err
    moved, known = (json.loads((folder / "motion.json").read_text()) for folder in (place, out))
    same = [row["rms_after"] for row in known if row["orders"] == [0, 1]]
    assert [row["rms_after"] for row in moved] == pytest.approx(same, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"--rig": "none.toml"}, "no such file"),
        ({"--models": "none"}, "no such file or folder"),
        ({"--profile": "sine"}, "cycloidal, robot"),
        ({"--orders": "0,2"}, "order 2"),
        ({"--lead": "long"}, "microseconds"),
        ({"--set": "fWrong=1"}, "fWrong"),
        ({"--set": "fLead_s=0.01"}, "give --lead"),
        ({"--set": "fFullSpeed_rpm=10"}, "give --law"),
        ({"--target": "basic"}, "basic"),
    ],
)
def test_faults_give_one_message_and_write_nothing(files, linear_folder, tmp_path, capsys, changes, part):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as caught:
        main(arguments(files, linear_folder, **({"--out": out} | changes)))
    assert caught.value.code == 2
    text = capsys.readouterr().err
    assert part in text
    assert "Traceback" not in text
    assert not out.exists()


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[axis]\nspeed = 3\n", "speed"),
        ("[axis.drive]\nspeed_gain_Nms_per_rad = 500.0\n", "unstable"),
        ("[tasks]\nslow_us = 510.0\n", "multiple"),
        ("[wrong]\n", "wrong"),
    ],
)
def test_faulty_rigs(files, linear_folder, tmp_path, capsys, text, part):
    rig, out = tmp_path / "rig.toml", tmp_path / "out"
    rig.write_text(LINEAR_RIG + "\n" + text if "[axis]" not in text else text + "[rig]\nreduction_ratio = 81.0\n")
    with pytest.raises(SystemExit) as caught:
        main(arguments(files, linear_folder, **{"--rig": rig, "--out": out}))
    assert caught.value.code == 2
    assert part in capsys.readouterr().err
    assert not out.exists()


def test_help_has_examples(capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "motion", "--help"])
    assert "--lead auto" in capsys.readouterr().out


def test_the_page_lists_the_tasks_that_moved_and_no_others(files, linear_folder, tmp_path):
    with pytest.raises(SystemExit) as caught:
        main([*arguments(files, linear_folder, **{"--out": tmp_path / "o"}), "--law", "full", "--tasks", "one", "-q"])
    assert caught.value.code == 0
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert "A simulation, with the generated text in its loop" in page
    timing = page.split("<h2>Timing")[1]
    rows = re.findall(r"<tr><td>(\w+)</td>", timing)
    assert rows == ["one"]


def test_a_correction_that_reaches_its_limit_is_said(files, linear_folder, tmp_path, capsys):
    """Models in arcsec left seven times the error, and nothing said why."""
    said = []
    for limit in (0.01, 20.0):
        changes = {"--out": tmp_path / "out", "--law": "full", "--set": f"fCorrectionLimit_deg={limit}"}
        with pytest.raises(SystemExit) as caught:
            main([*arguments(files, linear_folder, **changes), "--tasks", "one"])
        assert caught.value.code == 0
        (row,) = json.loads((tmp_path / "out" / "motion.json").read_text())
        said.append(row["limited"])
        assert said[-1] in capsys.readouterr().err.replace("\n", " ")
    assert re.fullmatch(r"the correction is at its limit, fCorrectionLimit_deg = 0.01, in \d.*% of the calls", said[0])
    assert said[1] == ""


def test_what_the_blocks_refused_and_what_nobody_knows_is_said(files, linear_folder, tmp_path, capsys):
    """At rest no weight is 1 under the published law, and a blend of 11 s is refused by the block, call after call."""
    rest = tmp_path / 'at, "rest".csv'
    rest.write_text("t,theta_out,torque_Nm\n" + "".join(f"{0.01 * row},0,0\n" for row in range(5)))
    changes = {"--profile": rest, "--out": tmp_path / "out", "--law": "published", "--set": "fBlendTime_s=11"}
    with pytest.raises(SystemExit) as caught:
        main([*arguments(files, linear_folder, **changes), "--tasks", "one"])
    assert caught.value.code == 0
    said = (
        "an error in 100.0% of the calls, by which the correction fades to zero (PARAMETER: a limit, rate or time "
        "outside of its range)"
    )
    assert said in capsys.readouterr().err.replace("\n", " ")
    assert said in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    (row,) = json.loads((tmp_path / "out" / "motion.json").read_text())
    assert row["refused"] == said
    assert [row[f"full_{key}"] for key in ("rms_before", "rms_after", "max_before", "max_after")] == [None] * 4
    with (tmp_path / "out" / "motion.csv").open(newline="") as file:
        (cells,) = csv.DictReader(file)
    assert (cells["profile"], cells["full_rms_before"]) == ('at, "rest"', "")
