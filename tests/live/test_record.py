"""Recording against the soft PLC with the simulated rig behind it: a campaign, a break, and every way to end early."""

import dataclasses
import math
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import st_codegen.live.record as record_module
from st_codegen import generate
from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import Curve, Run, read_run, scan, write_run
from st_codegen.campaign.orders import curve_sums, fit_orders
from st_codegen.campaign.reader import read_campaign
from st_codegen.cli.record import _setting, _settings
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.live.controller import Signal, connected
from st_codegen.live.failures import ControllerError, MeasurementError, OtherClientError
from st_codegen.live.plant import plant_behind
from st_codegen.live.plc import PlcState
from st_codegen.live.record import (
    RecordedProject,
    RecordSettings,
    _curves,
    open_campaign,
    planned,
    record,
    recorded_project,
)
from st_codegen.rig.campaign import Measuring, simulate_run
from st_codegen.rig.model import read_rig
from st_codegen.te.compensation.codes import EXPERIMENT_STATE
from st_codegen.te.harmonics import Direction
from tests.live.conftest import Running, soft_plc

pytest.importorskip("pyads")
pytest.importorskip("numba")

RIG = """
[rig]
name = "small"
reduction_ratio = 81.0

[axis.thermal]
start_C = 25.0

[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.0172
phase_rad = 0.7

[[effect]]
name = "backlash"
gap_arcmin = 1.0
seating_torque_Nm = 100.0
"""
#: A quick rig: little is waited for.
QUICK = RecordSettings(
    samples=500,
    inputs={"fAcceleration_rpm_s": 10000.0, "fHomingSpeed_rpm": 200.0, "fBacklashSpeed_rpm": 10.0},
    alive_s=600.0,
    poll_s=0.01,
    stop_s=600.0,
)
POINT = OperatingPoint(1800.0, 200.0, 25.0)


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(RIG)
    return path


@pytest.fixture(scope="module")
def plc(bundle, rig_file):
    """A PLC with the rig, for all tests that leave it at rest."""
    made = soft_plc(bundle[1], speed=0.0)
    made.connect(plant_behind(made, rig_file))
    with Running(made) as running:
        yield running


@pytest.fixture
def controller(plc):
    with connected(plc.ads, None, 600.0) as found:
        yield found
    at_rest(plc)


def at_rest(running):
    """Nothing moves, nobody owns the controller, and it is ready for the next measurement."""
    wanted = {"GVL_Experiment.bBusy": False, "GVL_Record.nOwner": 0, "GVL_Experiment.bAbort": False}
    end = time.monotonic() + 600
    signals = running.plc.machine.globals
    while any(signals[name] != value for name, value in wanted.items()) and time.monotonic() < end:
        time.sleep(0.01)
    assert {name: signals[name] for name in wanted} == wanted
    assert signals["GVL_Experiment.fMotorSpeed_rpm"] == 0.0
    assert signals["GVL_Experiment.eState"] == EXPERIMENT_STATE["IDLE"].value


@pytest.mark.parametrize(("count", "after"), [(-5, -5), (-(2**31), -(2**31)), (0, 1), (2_000_000_000, 2_000_000_000)])
def test_a_count_that_others_wrote_leads_to_no_place_outside_of_the_arrays(bundle, count, after):
    machine = soft_plc(bundle[1], speed=0.0).machine
    program, signals = machine.program("PRG_Record"), machine.globals
    signals["GVL_Experiment.bBusy"] = True
    program()
    signals["GVL_Experiment.bDataValid"] = True
    signals["GVL_Record.nSamples"] = count
    program()
    assert signals["GVL_Record.nSamples"] == after


@pytest.fixture(scope="module")
def project(bundle):
    return recorded_project(bundle[1])


@pytest.mark.thorough
def test_a_campaign_is_what_the_rig_is_and_another_client_is_turned_away(controller, project, plc, rig_file, tmp_path):
    told, refused = [], []
    runs = planned([POINT])

    def tell(done, total, what):
        told.append(what.rsplit(": ", 1)[1])
        if told[-1] == "HOMING":
            with connected(plc.ads, None, 600.0) as second, pytest.raises(OtherClientError, match="measures") as caught:
                record(second, project, runs, tmp_path / "second", QUICK)
            refused.append(caught.value.codes)

    assert record(controller, project, runs, tmp_path / "c", QUICK, tell) == 1
    assert {"MEASURE", "DONE"} <= set(told)
    assert refused == [("STC1709",)]
    assert record(controller, project, runs, tmp_path / "c", QUICK) == 0
    assert len(read_campaign(tmp_path / "c", jobs=1).curves) == 2
    simulated = simulate_run(read_rig(rig_file), POINT, Measuring(2048, 0.0), 0)
    for direction, curve in read_run(tmp_path / "c" / POINT.rig_path(), POINT).curves.items():
        assert len(curve.angle_deg) >= QUICK.samples
        got, expected = (
            fit_orders(curve_sums(each, 5), (0, 1)).coefficients for each in (curve, simulated.curves[direction])
        )
        assert abs(got[1] - expected[1]) < 2e-5
        # the error counts from where the homing has stopped: there its own value is taken for zero
        assert abs(got[0] - (expected[0] - expected[1].real)) < math.degrees(1e-3 / 81 + 3.5e-5) + 2e-4
    # inputs are as they were found
    assert controller.read(Signal("GVL_Experiment.fHomingSpeed_rpm")) == 50.0


@pytest.mark.thorough
def test_a_measurement_may_begin_between_two_requests(controller, project, plc, tmp_path, monkeypatch):
    """What was not busy before the controller has begun is no end without a result."""
    read, write, late = controller.read_all, controller.write_all, []

    def write_later(pairs):
        if (Signal("GVL_Experiment.bStart", "|b1"), True) in pairs:
            late.append(pairs)
        else:
            write(pairs)

    def read_then_write(wanted):
        found = read(wanted)
        while late:
            write(late.pop())
            while not plc.plc.machine.globals["GVL_Experiment.bBusy"]:
                time.sleep(0.005)
        return found

    monkeypatch.setattr(controller, "write_all", write_later)
    monkeypatch.setattr(controller, "read_all", read_then_write)
    assert record(controller, project, planned([POINT]), tmp_path / "c", QUICK) == 1


@pytest.mark.thorough
def test_conditions_that_repeat_have_numbered_files_and_a_campaign_goes_on(controller, project, tmp_path):
    runs = planned([POINT, POINT])
    record(controller, project, planned([]), tmp_path / "other", QUICK)
    open_campaign(tmp_path / "c", runs)
    (tmp_path / "c" / "run_00001.csv").write_text("finished earlier")
    assert record(controller, project, runs, tmp_path / "c", QUICK) == 1
    assert (tmp_path / "c" / "run_00001.csv").read_text() == "finished earlier"
    assert (tmp_path / "c" / "conditions.csv").read_text().splitlines()[1:] == [
        "run_00001.csv,1800.0,200.0,25.0",
        "run_00002.csv,1800.0,200.0,25.0",
    ]


@pytest.mark.parametrize(
    ("point", "inputs", "reason"),
    [
        (dataclasses.replace(POINT, speed_rpm=1900.0), {}, "SPEED: speed outside of the limits"),
        (dataclasses.replace(POINT, torque_Nm=float("nan")), {}, "TORQUE: torque outside of its limits"),
        (dataclasses.replace(POINT, temperature_C=10.0), {}, "TEMPERATURE: .*oil too warm"),
        (POINT, {"fStepTimeOut_s": 0.5}, "PARAMETER"),
        (POINT, {"fStepTimeOut_s": 1.0, "fBacklashSpeed_rpm": 0.1}, "TIME_OUT"),
    ],
)
def test_a_measurement_that_ends_early_says_why_and_nothing_is_written(
    controller, project, tmp_path, monkeypatch, point, inputs, reason
):
    settings = dataclasses.replace(QUICK, inputs={**QUICK.inputs, **inputs})
    monkeypatch.setattr(record_module, "_check_plan", lambda *_: None)  # as of a block with other limits
    with pytest.raises(MeasurementError, match=rf"\(1 of 1\): ended early, {reason}.*the axis stands") as caught:
        record(controller, project, planned([point]), tmp_path / "c", settings)
    assert caught.value.codes == ("STC1710",)
    assert [path.name for path in (tmp_path / "c").rglob("*") if path.is_file()] == ["record.json"]


@pytest.mark.thorough
def test_what_was_finished_before_a_fault_stays(controller, project, plc, tmp_path):
    runs = planned([POINT, dataclasses.replace(POINT, torque_Nm=100.0)])

    def break_encoder(done, total, what):
        if done == 1 and what.endswith("MEASURE"):
            plc.do(lambda: setattr(plc.plc.plant, "encoders_ready", False))

    try:
        with pytest.raises(MeasurementError, match=r"\(2 of 2\): ended early, ENCODER"):
            record(controller, project, runs, tmp_path / "c", QUICK, break_encoder)
    finally:
        plc.do(lambda: setattr(plc.plc.plant, "encoders_ready", True))
    assert (tmp_path / "c" / runs[0].file).is_file()
    assert not (tmp_path / "c" / runs[1].file).exists()
    assert open_campaign(tmp_path / "c", runs) == [runs[1]]


@pytest.mark.parametrize("place", [0, 2])
def test_samples_that_are_no_numbers_are_no_curve(place):
    angle = np.linspace(0.0, 2.0 * np.pi, 50)
    samples = [angle * 81.0, angle.copy(), angle.copy(), angle, angle, np.zeros(50, np.bool_)]
    samples[place][7] = np.nan
    with pytest.raises(MeasurementError, match=r"1 of 50 samples no numbers .* first sample 7"):
        _curves(samples, 81.0)


def test_a_part_of_the_revolution_that_is_lost_is_no_curve():
    """It was written, and `train` refused the file when the whole campaign was measured."""
    up = np.linspace(0.0, 2.0 * np.pi, 400)
    lost = up[(up < 2.0) | (up > 2.4)]
    for forward in (up, lost):
        angle = np.concatenate([forward, up[::-1]])
        backward = np.arange(len(angle)) >= len(forward)
        samples = [angle * 81.0, angle, angle, angle, angle, backward]
        if forward is up:
            assert len(_curves(samples, 81.0)) == 2
        else:
            with pytest.raises(MeasurementError, match=r"2\d\.\d deg of the revolution forward are without a sample"):
                _curves(samples, 81.0)


def test_a_client_that_is_gone_leaves_nothing_moving(plc, project, tmp_path):
    """The connection is lost in the middle: no farewell, and the controller ends the measurement by itself."""
    with connected(plc.ads, None, 600.0) as controller:

        class GoneError(Exception):
            pass

        def vanish(*_):
            raise GoneError

        def lose(done, total, what):
            if what.endswith("MEASURE"):
                # only now: however slow this machine is, the client is not taken for gone before
                controller.write(Signal("GVL_Record.fAliveTimeOut_s"), 0.5)
                for name in ("read", "write", "read_all", "write_all"):
                    setattr(controller, name, vanish)

        with pytest.raises(GoneError):
            record(controller, project, planned([POINT]), tmp_path / "c", QUICK, lose)
    at_rest(plc)


def test_what_a_measurement_does_is_waited_for_until_its_time_is_up(monkeypatch):
    """A clock that goes on by the pauses alone: an answer in time is taken, after it the operator is called."""
    now = [100.0]
    monkeypatch.setattr(record_module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(record_module.time, "sleep", lambda pause: now.append(now.pop() + pause))
    here = SimpleNamespace(address="a controller")
    client = record_module.MeasuringClient(here, None, dataclasses.replace(QUICK, stop_s=10.0, poll_s=1.0))
    told = []
    monkeypatch.setattr(client, "_tell_alive", lambda: told.append(now[0]))
    client._wait(lambda: now[0] >= 110.0)
    assert told == [100.0 + pause for pause in range(10)]
    with pytest.raises(ControllerError, match="a controller: the measurement does not end: stop the axis by hand"):
        client._wait(lambda: now[0] >= 121.5)


def test_a_controller_in_config_or_with_another_project(controller, project, plc, tmp_path):
    other = dataclasses.replace(project, fingerprint=1)
    with pytest.raises(ControllerError, match="fingerprint"):
        record(controller, other, planned([POINT]), tmp_path / "a", QUICK)
    plc.do(lambda: plc.plc.set_state(PlcState.CONFIG))
    with pytest.raises(ControllerError, match="in CONFIG, not in RUN"):
        record(controller, project, planned([POINT]), tmp_path / "b", QUICK)
    plc.do(lambda: plc.plc.set_state(PlcState.RUN))


def test_folders_that_are_not_of_this_plan(controller, project, bundle, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        record(controller, project, planned([POINT]), tmp_path / "full", QUICK)
    record(controller, project, planned([]), tmp_path / "c", QUICK)
    with pytest.raises(InputError, match="another plan"):
        record(controller, project, planned([POINT]), tmp_path / "c", QUICK)
    plain = generate(bundle[0], "twincat", tmp_path).folder
    with pytest.raises(GeneratedCodeError, match="--with-comparison"):
        recorded_project(plain)


def test_the_sensors_of_the_rig_are_no_inputs_of_clients(controller):
    with pytest.raises(ControllerError, match="may not be written"):
        controller.write(Signal("GVL_Experiment.fThetaOut_rad"), 0.0)


def test_a_motion_that_a_client_writes(controller, plc):
    """Speed and torque of GVL_Machine move the axis; the speed is that of the input shaft, rpm."""
    angle = Signal("GVL_Machine.fThetaOut_rad")
    begin = controller.read(angle)
    controller.write(Signal("GVL_Machine.fSpeed_rpm"), 600.0)
    end = time.monotonic() + 600
    while controller.read(angle) < begin + 0.5 and time.monotonic() < end:
        time.sleep(0.005)
    assert plc.plc.plant.axis.speed_in_deg_s == pytest.approx(600.0 * 6.0, rel=0.02)
    controller.write(Signal("GVL_Machine.fSpeed_rpm"), float("nan"))
    rested = plc.plc.time_s + 1.0
    while plc.plc.time_s < rested and time.monotonic() < end:
        time.sleep(0.005)
    assert abs(plc.plc.plant.axis.speed_in_deg_s) < 6.0
    controller.write(Signal("GVL_Machine.fSpeed_rpm"), 0.0)


@pytest.mark.parametrize(("speed", "torque"), [(1e308, 1e308), (1e9, 0.0), (1e6, -1e6), (math.nan, math.inf)])
def test_no_number_that_a_client_writes_is_left_in_the_rig(bundle, rig_file, speed, torque):
    """1e308 rpm made NaN of all that the encoders showed from then on."""
    plc = soft_plc(bundle[1])
    plc.connect(plant_behind(plc, rig_file))
    signals = plc.machine.globals
    for written in ((speed, torque), (0.0, 0.0)):
        signals["GVL_Machine.fSpeed_rpm"], signals["GVL_Machine.fTorque_Nm"] = written
        for _ in range(100):
            plc.tick()
    assert math.isfinite(signals["GVL_Machine.fThetaOut_rad"])


def test_the_rig_follows_its_operating_point(bundle, rig_file):
    """A load puts the axis on one side of the play of 1 arcmin."""
    plc = soft_plc(bundle[1])
    plc.connect(plant_behind(plc, rig_file))
    signals, shown = plc.machine.globals, []
    for torque in (0.0, 1000.0):
        signals["GVL_Machine.fSpeed_rpm"], signals["GVL_Machine.fTorque_Nm"] = 100.0, torque
        for _ in range(int(0.2e6 / plc.tick_us)):
            plc.tick()
        te_rad = signals["GVL_Machine.fThetaOut_rad"] - signals["GVL_Experiment.fThetaIn_rad"] / 81.0
        shown.append(math.degrees(te_rad) * 60.0)
    assert abs(shown[1] - shown[0]) == pytest.approx(0.5, abs=0.1)


def test_a_stop_by_the_operator_brings_the_axis_to_rest_first(plc, bundle, tmp_path):
    plan = tmp_path / "plan.csv"
    plan.write_text("speed_rpm,torque_Nm,temperature_C\n20,0,25\n")
    arguments = ["record", "--generated", str(bundle[1]), "--ads", plc.ads, "--plan", str(plan)]
    settings = ["--out", str(tmp_path / "c"), "--alive", "600", "--timeout", "600", "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-m", "st_codegen", *arguments, *settings], stderr=subprocess.PIPE, text=True
    )
    plc.do(lambda: setattr(plc.plc, "speed", 1.0))  # less to do here while the other process starts
    try:
        end = time.monotonic() + 600
        while not plc.plc.machine.globals["GVL_Experiment.bBusy"] and time.monotonic() < end:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.02)
        plc.do(lambda: setattr(plc.plc, "speed", 0.0))
        process.send_signal(signal.SIGTERM)
        message = process.communicate(timeout=600)[1]
    finally:
        plc.do(lambda: setattr(plc.plc, "speed", 0.0))
        process.kill()
    assert process.returncode == 130, message
    assert "Traceback" not in message
    assert "(1 of 1): stopped; the axis stands, and what was measured before is kept\n" in message
    at_rest(plc)


def test_samples_that_a_revolution_does_not_have_are_refused(tmp_path):
    project = RecordedProject(81.0, 1)
    with pytest.raises(InputError, match=r"1800 rpm: a revolution has 5,400 samples at most, .*10,000 are wanted"):
        record(None, project, planned([POINT]), tmp_path / "c", RecordSettings(10_000))
    assert not (tmp_path / "c").exists()


def test_what_the_block_would_refuse_is_said_at_once_and_of_all_runs(tmp_path):
    """The last run of a plan ended a campaign after hours; a speed of 1e-308 rpm ended in an OverflowError."""
    points = [
        POINT,
        *(OperatingPoint(*point) for point in ((1900.0, 200.0, 25.0), (1e-308, 2500.0, 298.0), (0.0, 9.0, 25.0))),
    ]
    points += [dataclasses.replace(POINT, torque_Nm=math.nan)]
    inputs = {"fHomingSpeed": 50.0, "fAcceleration_rpm_s": 5.0, "fMotorSpeed_rpm": 100.0, "fOilBand_C": 0.1}
    with pytest.raises(InputError) as caught:
        record(None, RecordedProject(81.0, 1), planned(points), tmp_path / "c", RecordSettings(500, inputs))
    assert caught.value.codes == ("STC1714",)
    subject, *lines = str(caught.value).splitlines()
    assert subject == "record: 9 problems"
    assert {line.removeprefix("  - ").partition(": FB")[0].partition(" is no ")[0] for line in lines} == {
        *("fSpeed_rpm 1900", "fTorque_Nm nan", "fSpeed_rpm 1e-308", "fTorque_Nm 2500", "fTemperature_C 298"),
        *("fSpeed_rpm 0", "fHomingSpeed", "fAcceleration_rpm_s 5", "fMotorSpeed_rpm"),
    }
    assert "did you mean 'fHomingSpeed_rpm'" in str(caught.value)
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("on", ["bEnable", "bActive"])
def test_an_axis_that_is_corrected_is_not_measured(on):
    """FB_Experiment takes over the reference: the correction, left out at once, would be a step of the motor."""

    class Corrects(_StuckController):
        def read_all(self, signals):
            return [one.name == f"GVL_Machine.{on}" or one.name.endswith("nFingerprint") for one in signals]

        def state(self):
            return "RUN"

    controller = Corrects(0)
    with pytest.raises(ControllerError, match=r"set GVL_Machine\.bEnable to FALSE, and wait until") as caught:
        record_module.MeasuringClient(controller, RecordedProject(81.0, 1), QUICK).claim()
    assert caught.value.codes == ("STC1715",)
    assert not controller.written


def test_all_settings_that_are_wrong_are_named_at_once():
    with pytest.raises(InputError) as caught:
        _settings(["fA=1", "fA=2", "x=1", "fB=1,5"])
    assert [line[:13] for line in str(caught.value).splitlines()[1:]] == [
        "  - --set fA=",
        "  - --set x=1",
        "  - --set fB=",
    ]
    assert _settings(["fA=1", "fB=2"]) == {"fA": 1.0, "fB": 2.0}


def test_the_conditions_of_a_file_whose_run_was_killed_are_written_at_last(tmp_path):
    runs = planned([POINT, POINT])
    open_campaign(tmp_path / "c", runs)
    for run in runs:
        write_run(Run(run.point, dict.fromkeys(Direction, Curve(np.zeros(3), np.zeros(3)))), tmp_path / "c" / run.file)
    assert record(None, RecordedProject(81.0, 1), runs, tmp_path / "c", QUICK) == 0
    files, bad = scan(tmp_path / "c")
    assert [file.conditions for file in files] == [POINT, POINT] and not bad


@pytest.mark.parametrize("name", ["fSpeed_rpm", "ftorque_nm", "FTEMPERATURE_C"])
def test_what_the_plan_says_is_not_set_beside_it(name):
    """The files would be named by the plan's conditions, and measured at others."""
    with pytest.raises(InputError, match="the plan gives it"):
        _setting(f"{name}=5")
    assert _setting("fAcceleration_rpm_s =5") == ("fAcceleration_rpm_s", 5.0)


def test_a_rig_of_another_ratio_is_not_put_behind_the_signals(bundle, rig_file, tmp_path):
    other = rig_file.read_text().replace("reduction_ratio = 81.0", "reduction_ratio = 80.0")
    (tmp_path / "other.toml").write_text(other)
    with pytest.raises(InputError, match=r"other\.toml: reduction ratio 80, and the text was generated for 81"):
        plant_behind(soft_plc(bundle[1]), tmp_path / "other.toml")


@pytest.mark.parametrize("wrong", ["fMotorSpeed_rpm", "fNoSuchInput"])
def test_an_input_that_may_not_be_set_leaves_the_controller_to_others(
    controller, project, plc, tmp_path, monkeypatch, wrong
):
    """The others have their old values again, and the next client need not wait."""
    monkeypatch.setattr(record_module, "_check_plan", lambda *_: None)
    homing = Signal("GVL_Experiment.fHomingSpeed_rpm")
    before = controller.read(homing)
    inputs = {**QUICK.inputs, "fHomingSpeed_rpm": before + 1.0, wrong: 5.0}
    settings = dataclasses.replace(QUICK, inputs=inputs)
    with pytest.raises(ControllerError) as caught:
        record(controller, project, planned([POINT]), tmp_path / "c", settings)
    assert re.findall(r"GVL_Experiment\.(\w+)", str(caught.value)) == [wrong]
    assert plc.plc.machine.globals["GVL_Record.nOwner"] == 0
    assert controller.read(homing) == before


class _StuckController:
    """A controller whose variables are zero, and whose axis does not come to rest; it notes what is written."""

    address = "a controller"

    def __init__(self, owner):
        self.owner, self.written = owner, []

    def read_all(self, signals):
        return [self.owner if one.name.endswith("nOwner") else one.name.endswith("bBusy") for one in signals]

    def read(self, one):
        return self.read_all([one])[0]

    def write(self, one, value):
        self.written.append((one.name.rpartition(".")[2], value))

    def write_all(self, pairs):
        for pair in pairs:
            self.write(*pair)


def _client(controller, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(record_module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(record_module.time, "sleep", lambda pause: now.append(now.pop() + pause))
    client = record_module.MeasuringClient(controller, RecordedProject(81.0, 1), RecordSettings(stop_s=1.0))
    client._owner, client._is_mine = 7, True
    return client


def test_a_stop_that_fails_is_said_however_the_measurement_ended(monkeypatch):
    client = _client(_StuckController(7), monkeypatch)

    def interrupt(_):
        raise KeyboardInterrupt

    with pytest.raises(ControllerError, match=r"interrupted; whether the axis stands is not known .*stop the axis by"):
        client.measure(POINT, "run", interrupt)


def test_what_another_client_has_begun_is_not_stopped(monkeypatch):
    controller = _StuckController(8)
    client = _client(controller, monkeypatch)
    with pytest.raises(OtherClientError, match=r"number 8.*was not stopped"):
        client.measure(POINT, "run", lambda _: None)
    client.release()
    assert ("bAbort", True) not in controller.written and ("nOwner", 0) not in controller.written


@pytest.mark.parametrize("address", ["300.1.1.1.1.1:851", "5.1.1.1.1.1:70000", "5.1.1.1.1.1:851@localhost:70000"])
def test_an_address_that_cannot_be_is_refused_before_anybody_is_asked(address):
    with pytest.raises(InputError, match="go up to 255"):
        connected(address, None)


def test_a_campaign_that_goes_on_is_measured_as_it_was_begun(tmp_path):
    """Files of other samples, inputs and ratios came into one campaign without a word."""
    runs = planned([POINT, dataclasses.replace(POINT, torque_Nm=100.0)])
    open_campaign(tmp_path, runs, {"samples": 500.0, "fHomingSpeed_rpm": 50.0})
    # nothing is measured: all may still be another
    assert open_campaign(tmp_path, runs, {"samples": 600.0}) == list(runs)
    assert open_campaign(tmp_path, runs, {"samples": 500.0, "fHomingSpeed_rpm": 50.0}) == list(runs)
    write_run(Run(POINT, dict.fromkeys(Direction, Curve(np.zeros(3), np.zeros(3)))), tmp_path / runs[0].file)
    assert open_campaign(tmp_path, runs, {"samples": 500.0, "fHomingSpeed_rpm": 50.0}) == [runs[1]]
    with pytest.raises(InputError, match=r"begun otherwise \(fHomingSpeed_rpm 50.0, samples 500.0\)"):
        open_campaign(tmp_path, runs, {"samples": 600.0})
