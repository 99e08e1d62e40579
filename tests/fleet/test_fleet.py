"""A fleet as a user runs it: what is written, what is not done twice, and what one axis does to the others."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import pytest

from st_codegen.cli.main import main
from st_codegen.errors import InputError
from st_codegen.fleet import run, stages
from st_codegen.fleet.axes import read_fleet
from st_codegen.fleet.compare import LEAST_AXES, Campaigns, compare
from st_codegen.fleet.estimates import estimates
from st_codegen.fleet.output import PAGE, FleetReport
from st_codegen.fleet.run import MARK, run_fleet
from st_codegen.fleet.stages import CHECK, COMPILE, RECONCILE, TRAIN, AxisResult, do_axis
from st_codegen.project.bundle import load
from st_codegen.reconcile.run import reconcile_files
from st_codegen.rig.effects import catalogue
from st_codegen.rig.model import parse_rig
from st_codegen.training.search import Backend
from tests.cli.helpers import snapshot
from tests.fleet.conftest import DEFAULTS, RIG, fleet_file, write_campaign

TEXT = f"""{DEFAULTS}
[[axis]]
name = "worn"
campaign = "worn/2026.csv"
earlier = ["worn/2025.csv"]

[[axis]]
name = "odd"
campaign = "odd.csv"
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """An axis whose output shaft has got worse, and one whose campaign is no table."""
    folder = tmp_path_factory.mktemp("fleet")
    write_campaign(folder / "worn" / "2025.csv", 1)
    write_campaign(folder / "worn" / "2026.csv", 2, amplitude_deg=0.019)
    (folder / "odd.csv").write_text("direction,speed_rpm\nforward,1\n")
    return fleet_file(folder, TEXT)


@pytest.fixture(scope="module")
def done(inputs):
    """The folder of results."""
    out = inputs.parent / "out"
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(inputs), "--out", str(out), "--jobs", "1"])
    assert end.value.code == 1
    return out


def facts(out):
    return json.loads((out / "fleet.json").read_text())


def test_what_is_written(done):
    files = {path.relative_to(done / "worn").parts[0] for path in (done / "worn").rglob("*")}
    assert files == {"models", "plc", "certificate.json", "reconcile", "earlier", "stages.json"}
    assert (done / "worn/plc/iec/worn.st").is_file()
    assert (done / "worn/earlier/1/report.html").is_file()
    assert load(done / "worn/models").purpose.te.orders == (0, 1)
    worn, odd = facts(done)["axes"]
    assert worn["check"]["passed"]
    assert worn["check"]["how"] == "8 texts (proved: 6, never fails: 2)"
    assert worn["errors"] == {}
    page = json.loads((done / "worn/reconcile/report.json").read_text())
    assert page["verdict"] == worn["reconcile"]["verdict"]
    assert set(odd["errors"]) == {TRAIN, COMPILE, CHECK, RECONCILE}
    assert not facts(done)["passed"]


def test_an_axis_that_fails_is_a_line_and_stops_no_other(done):
    rows = list(csv.DictReader((done / "fleet.csv").read_text().splitlines()))
    assert [row["axis"] for row in rows] == ["worn", "odd"]
    assert rows[0]["error"] == ""
    assert "odd.csv" in rows[1]["error"]
    assert "\n" not in rows[1]["error"]
    assert "compile: not done, since train failed" in rows[1]["error"]
    assert not (done / "odd" / "models").exists()


def test_growth_is_named(done):
    growth = {(one["axis"], one["effect"], one["key"]) for one in facts(done)["growth"]}
    assert growth == {("worn", "output_shaft_eccentricity", "amplitude_deg")}
    page = (done / "fleet.html").read_text()
    for part in (
        "What has grown, or was not found in the last campaign before: 1",
        "odd.csv",
        "nothing can be said of who",
        "its size (of a stiffness its inverse) is larger",
        "What was not looked at",
    ):
        assert part in page


def test_every_parameter_has_its_row(done):
    rows = list(csv.DictReader((done / "effects.csv").read_text().splitlines()))
    own = {(row["effect"], row["parameter"]): row for row in rows if row["axis"] == "worn"}
    row = own["output_shaft_eccentricity", "amplitude_deg"]
    assert float(row["value"]) == pytest.approx(0.019, abs=1e-4)
    assert 0 < float(row["stderr"]) < 1e-4
    assert (row["unit"], row["limit"], row["stands_out"]) == ("deg", "", "False")
    assert own["output_shaft_eccentricity", "phase_rad"]["median"] == ""


def test_a_campaign_that_is_not_named_any_more_leaves_no_report(inputs, done, tmp_path):
    out = copy(done, tmp_path)
    (out / "worn" / "earlier" / "7").mkdir()
    result = do_axis((read_fleet(inputs)[0], out))
    assert result.done_now == () and [path.name for path in (out / "worn" / "earlier").iterdir()] == ["1"]
    do_axis((replace(read_fleet(inputs)[0], earlier=()), out))
    assert not list((out / "worn" / "earlier").iterdir())


def test_sizes_that_look_like_another_unit_are_asked_about_by_what_a_fleet_can_do(inputs, tmp_path):
    axis = read_fleet(inputs)[0]
    other = write_campaign(tmp_path / "arcmin.csv", amplitude_deg=0.017 * 60, stiffness_Nm_per_arcmin=450 / 60)
    axis = replace(axis, campaign=other, earlier=())
    asked = do_axis((axis, tmp_path / "out")).errors
    assert list(asked) == [RECONCILE] and "as_is = true to take them as they are" in asked[RECONCILE]
    taken = do_axis((replace(axis, options=replace(axis.options, as_is=True)), tmp_path / "out"))
    assert (taken.errors, taken.done_now) == ({}, (RECONCILE,))


def test_what_a_campaign_does_not_measure_is_no_number_of_the_axis(tmp_path):
    """An order that a table does not have had the rig file's value and about as large a standard error."""
    pins = '\n[[effect]]\nname = "pin_error"\norder = 40\namplitude_deg = 0.0009\nphase_rad = 0.1\n'
    table = write_campaign(tmp_path / "c.csv", 4, amplitude_deg=0.0175)
    found = {
        (one.effect, one.key): one for one in estimates(reconcile_files(parse_rig(RIG + pins), table, catalogue()))
    }
    unseen = found["pin_error of order 40", "amplitude_deg"]
    assert (unseen.value, unseen.stderr) == (pytest.approx(0.0009), None)
    assert 0 < found["output_shaft_eccentricity", "amplitude_deg"].stderr < 1e-4
    axes = [Campaigns(f"a{i}", "t", (tuple(found.values()),)) for i in range(LEAST_AXES)]
    compared = compare(axes)
    assert all("pin_error" not in spread.effect for spread in compared.spreads) and compared.spreads
    assert any("less than the rig file" in text and "pin_error of order 40" in text for text in compared.not_looked_at)


def copy(done, tmp_path):
    return Path(shutil.copytree(done, tmp_path / "out"))


def again(inputs, out, **changed):
    """What is done of the axis that can be done, with other options."""
    axis = read_fleet(inputs)[0]
    return do_axis((replace(axis, options=replace(axis.options, **changed)), out))


def test_what_is_done_is_not_done_again(inputs, done, tmp_path):
    out = copy(done, tmp_path)
    before = snapshot(out)
    axes = read_fleet(inputs)
    results = run_fleet(axes, out, Backend(1))
    assert [result.done_now for result in results.values()] == [(), ()]
    FleetReport.of(axes, results).write(out)
    for name in ("fleet.html", "fleet.csv", "effects.csv", "fleet.json"):
        # the foot of the page names the command
        assert (out / name).read_text().split("<footer")[0] == (done / name).read_text().split("<footer")[0], name
    after = snapshot(out)
    assert {name for name in before if before[name] != after[name]} <= {"fleet.html"}


@pytest.mark.parametrize("quiet", [False, True])
def test_each_axis_has_its_line_unless_it_is_to_be_quiet(quiet, inputs, done, tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(inputs), "--out", str(copy(done, tmp_path)), "--jobs", "1", *(["-q"] if quiet else [])])
    assert end.value.code == 1
    shown = capsys.readouterr().err
    assert [f"{axis.name}: " in shown for axis in read_fleet(inputs)] == [not quiet] * 2
    assert quiet or PAGE in shown
    assert not quiet or not shown


def test_other_options_and_lost_files_are_done_again(inputs, done, tmp_path, monkeypatch):
    out = copy(done, tmp_path)
    assert again(inputs, out, check=stages.TextCheck.VERIFY).done_now == (CHECK,)
    assert not (out / "worn/certificate.json").exists()
    text = out / "worn/plc/iec/worn.st"
    whole = text.read_bytes()
    text.write_bytes(whole + b" ")
    assert again(inputs, out, check=stages.TextCheck.VERIFY).done_now == (COMPILE,)
    assert text.read_bytes() == whole
    monkeypatch.setattr(stages, "VERSION", "9.9")
    monkeypatch.setattr(stages._Stages, "_train", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_compile", lambda self: 1 / 0)
    monkeypatch.setattr(stages._Stages, "_reconcile", lambda self, *_: {})
    result = again(inputs, out)
    assert result.done_now == (TRAIN, "earlier 1", RECONCILE)
    assert result.defect
    assert result.errors[COMPILE].startswith("a defect of st-codegen: ZeroDivisionError")
    assert result.errors[CHECK] == "not done, since compile failed"
    assert not (out / "worn/plc").exists()  # nothing of before is left to be taken for it
    # what failed is tried again, and a record that cannot be read is none
    (out / "worn" / stages.RECORD).write_text('{"train": 3}')
    monkeypatch.setattr(stages._Stages, "_compile", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_check", lambda self: {"passed": True, "how": "so"})
    assert again(inputs, out).done_now == (TRAIN, COMPILE, CHECK, "earlier 1", RECONCILE)


def test_a_rig_that_does_not_fit(inputs, tmp_path, monkeypatch):
    """It fails what compares with the rig, and nothing else."""
    monkeypatch.setattr(stages._Stages, "_train", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_compile", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_check", lambda self: {"passed": True, "how": "so"})
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.replace("0.017", "0.97"))
    axis = replace(read_fleet(inputs)[0], rig=rig, earlier=())
    result = do_axis((axis, tmp_path))
    assert list(result.errors) == [RECONCILE]
    assert "another unit?" in result.errors[RECONCILE]
    assert result.done_now == (TRAIN, COMPILE, CHECK)
    report = FleetReport.of([axis], {"worn": result})
    assert not report.passed
    assert "the newest campaign, which was not reconciled: 1 (worn)" in report.not_looked_at
    assert "another unit?" in report.html()


def test_an_axis_whose_sizes_all_differ_alike_can_be_taken_as_it_is(inputs, tmp_path, monkeypatch):
    """Reconcile asks whether the measurement is scaled; in a fleet nobody is there to answer."""
    monkeypatch.setattr(stages._Stages, "_train", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_compile", lambda self: {})
    monkeypatch.setattr(stages._Stages, "_check", lambda self: {"passed": True, "how": "so"})
    table = write_campaign(tmp_path / "c.csv", 3, amplitude_deg=0.017 * 1.05, stiffness_Nm_per_arcmin=450.0 / 1.05)
    axis = replace(read_fleet(inputs)[0], campaign=table, earlier=())
    assert "give --accept misread_te to correct it" in do_axis((axis, tmp_path)).errors[RECONCILE]
    taken = do_axis((replace(axis, options=replace(axis.options, as_is=True)), tmp_path))
    assert taken.errors == {}
    assert taken.done_now == (RECONCILE,)


def test_what_decides_a_stage(inputs, done, tmp_path):
    def keys(axis):
        return {stage.name: stage.decides for stage in stages._Stages(axis, tmp_path, tmp_path).all()}

    axis = read_fleet(inputs)[0]
    for name, value in (("seed", 1), ("folds", 3), ("orders", (0,)), ("limit_us", 1.0), ("keep_faulty", True)):
        other = keys(replace(axis, options=replace(axis.options, **{name: value})))
        assert [stage for stage, decides in keys(axis).items() if decides != other[stage]] == [TRAIN]
    other = keys(replace(axis, options=replace(axis.options, target="twincat")))
    assert other[COMPILE] != keys(axis)[COMPILE]
    other = keys(replace(axis, campaign=axis.earlier[0]))
    assert other[TRAIN] != keys(axis)[TRAIN]
    assert other[RECONCILE] != keys(axis)[RECONCILE]
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.replace("450.0", "451.0"))
    other = keys(replace(axis, rig=rig))
    assert [stage for stage, decides in keys(axis).items() if decides != other[stage]] == ["earlier 1", RECONCILE]


# -- where the results go


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("full", "holds something else"),
        ("rig.toml", "is a file"),
        ("worn/2026.csv/out", "stand in each other"),
        (".", "holds something else"),
    ],
)
def test_places_that_are_refused(inputs, out, message, capsys):
    (inputs.parent / "full").mkdir(exist_ok=True)
    (inputs.parent / "full" / "mine").touch()
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(inputs), "--out", str(inputs.parent / out), "--jobs", "1"])
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def test_a_scheduler_without_a_backend(inputs, tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(inputs), "--out", str(tmp_path / "o"), "--scheduler", "tcp://127.0.0.1:1"])
    assert end.value.code == 2
    assert "go together" in capsys.readouterr().err


def test_what_is_interrupted_says_how_it_goes_on(inputs, tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "run_fleet", interrupted)
    with pytest.raises(SystemExit) as end:
        main(["fleet", str(inputs), "--out", str(tmp_path / "o"), "--jobs", "1"])
    assert end.value.code == 130
    said = " ".join(capsys.readouterr().err.split())
    assert "o: the same command goes on from there" in said and said.endswith("stopped")


# -- workers that end

GOOD = AxisResult({stage: {"passed": True, "how": "so", "verdict": "explained"} for stage in (CHECK, RECONCILE)})


def faked(monkeypatch, fatal, times):
    """`spread` of which the worker ends `times` times at one axis; returns what was tried."""
    tried = []

    def spread(work, items, backend):
        tried.append(list(items))
        for name, (_, out) in items.items():
            if name == fatal and sum(name in one for one in tried) <= times:
                raise BrokenProcessPool
            (out / name).mkdir(exist_ok=True)
            (out / name / stages.RECORD).touch()
            yield name, GOOD

    monkeypatch.setattr(run, "spread", spread)
    return tried


@pytest.mark.parametrize(
    ("times", "tried"),
    [(1, [["worn", "odd"], ["odd"]]), (9, [["worn", "odd"], ["odd"], ["odd"]])],
)
def test_axes_of_a_worker_that_ended_are_done_again(inputs, tmp_path, monkeypatch, times, tried):
    found = faked(monkeypatch, "odd", times)
    results = run_fleet(read_fleet(inputs), tmp_path / "out", Backend(2))
    assert found == tried
    assert results["worn"] is GOOD
    assert (results["odd"] is GOOD) == (times == 1)
    assert times == 1 or "ended each time" in results["odd"].errors[TRAIN]


def test_two_runs_in_one_folder(inputs, tmp_path, monkeypatch):
    """The files of one were those of the other, and an axis failed by models that "have changed"."""
    out, tried = tmp_path / "out", faked(monkeypatch, "odd", 0)
    run_fleet(read_fleet(inputs), out, Backend(2))
    code = "import sys; from pathlib import Path; from st_codegen.files.temporary import held\n"
    code += "with held(Path(sys.argv[1]), '') as mine: print(mine, flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code, out / MARK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "True\n"
        with pytest.raises(InputError, match="another run of st-codegen fleet works there; wait for it"):
            run_fleet(read_fleet(inputs), out, Backend(2))
        other.kill()
    run_fleet(read_fleet(inputs), out, Backend(2))  # a killed run holds nothing
    assert len(tried) == 2


def test_a_worker_on_another_disk(inputs, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "spread", lambda work, items, backend: iter([(name, GOOD) for name in items]))
    results = run_fleet(read_fleet(inputs), tmp_path / "out", Backend(2))
    assert all("share the disk" in result.errors[TRAIN] for result in results.values())


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [False, True])
def test_a_worker_is_killed_and_the_numbers_are_those_of_one_process(tmp_path, cluster):
    axes = "".join(f'[[axis]]\nname = "r{i}"\ncampaign = "c/r{i}.csv"\n' for i in range(6))
    for number in range(6):
        write_campaign(tmp_path / "c" / f"r{number}.csv", number)
    fleet = read_fleet(fleet_file(tmp_path, DEFAULTS + axes))
    killed = []

    def kill(pid):
        if not killed:
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)

    alone = FleetReport.of(fleet, run_fleet(fleet, tmp_path / "alone", Backend(1)))
    assert alone.passed
    if cluster:
        distributed = pytest.importorskip("distributed")
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
        ) as local:
            backend, worker = Backend(1, local.scheduler_address), next(iter(local.workers.values()))
            spread = run_fleet(fleet, tmp_path / "spread", backend, lambda *_: kill(worker.pid))
    else:
        psutil = pytest.importorskip("psutil")

        def one_of_ours(*_):
            for child in psutil.Process().children(recursive=True):
                if "LokyProcess" in " ".join(child.cmdline()) or "popen_loky" in " ".join(child.cmdline()):
                    kill(child.pid)

        spread = run_fleet(fleet, tmp_path / "spread", Backend(2), one_of_ours)
    assert killed
    together = FleetReport.of(fleet, spread)
    assert together._json() == alone._json()
    one, other = (snapshot(tmp_path / place) for place in ("alone", "spread"))
    assert set(one) == set(other)
    hashes = ("stages.json", "certificate.json", "st-codegen.json", ".skops")  # .skops files have times in them
    assert [name for name in one if one[name] != other[name] and not name.endswith(hashes)] == []


def test_a_folder_of_results_is_known_by_its_mark(done):
    assert (done / MARK).is_file()
    with pytest.raises(InputError, match="holds something else"):
        run._check_place([], done / "worn")
