"""FB_Experiment and FB_LoadTorque on a simulated rig: the whole sequence, and every way to end early."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from st_codegen.st import Machine, parse_project
from st_codegen.te.compensation.codes import EXPERIMENT_STATE, TE_ERROR
from tests.te.projects import RATIO, loaded, project, texts

CYCLE = 0.01
STATES = {code.value: code.name for code in EXPERIMENT_STATE.all}
ERRORS = {code.name: code.value for code in TE_ERROR.all}
TURN = 2 * np.pi


@dataclass
class Rig:
    """An ideal motor, a reducer with backlash, oil that warms while it turns, a loading side that follows."""

    experiment: object
    load: object
    backlash_rad: float = 6e-4
    theta_in: float = 40.0
    theta_out: float = 0.49
    oil: float = 20.0
    torque: float = 0.0
    overrides: dict = field(default_factory=dict)

    def step(self):
        """One cycle: plant, then blocks."""
        block = self.experiment
        speed = block["fMotorSpeed_rpm"]
        self.theta_in += speed / 60.0 * TURN * CYCLE
        push = self.theta_in / RATIO
        self.theta_out = min(max(self.theta_out, push - self.backlash_rad / 2), push + self.backlash_rad / 2)
        self.oil += (0.5 if abs(speed) > 500 else 0.0) * CYCLE
        self.torque += (self.load["fShaftTorque_Nm"] - self.torque) * 0.1
        given = {
            "fThetaIn_rad": self.theta_in,
            "fThetaOut_rad": self.theta_out,
            "fOil_C": self.oil,
            "fShaftTorque_Nm": self.torque,
            "bEncodersReady": True,
            "bAbort": False,
            "fCycle_s": CYCLE,
            **self.overrides,
        }
        block(**given)
        self.load(fTorque_Nm=block["fLoadTorque_Nm"], bEnable=block["bLoadEnable"], fCycle_s=CYCLE)
        return STATES[block["eState"]]


def rig(target="iec", **inputs):
    machine = Machine(loaded(target))
    made = Rig(machine.instance("FB_Experiment"), machine.instance("FB_LoadTorque"))
    settings = {"fSpeed_rpm": 900.0, "fTorque_Nm": 300.0, "fTemperature_C": 25.0, "fHomingSpeed_rpm": 200.0}
    for name, value in {**settings, **inputs}.items():
        made.experiment[name] = value
    return made


def run_to(made, goal, cycles=60_000):
    """Step until a state is reached; the states on the way, each once in order."""
    seen = []
    for _ in range(cycles):
        state = made.step()
        if not seen or seen[-1] != state:
            seen.append(state)
        if state == goal:
            return seen
    raise AssertionError(f"{goal} was not reached: {seen}, error {made.experiment['eError']}")


ONE_DIRECTION = ["RUN_UP", "WAIT_ZERO", "MEASURE", "RUN_DOWN"]


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_a_measurement_goes_through_all_steps_and_covers_one_revolution_each_way(target):
    made = rig(target)
    block = made.experiment
    assert made.step() == "IDLE"
    block["bStart"] = True
    seen, valid = [], {False: [], True: []}
    for _ in range(60_000):
        state = made.step()
        entered = not seen or seen[-1] != state
        if entered:
            seen.append(state)
        assert abs(block["fMotorSpeed_rpm"]) <= 1000.0
        if state in ("WARM_UP", "HOMING", "BACKLASH_PLUS", "BACKLASH_MINUS", "CENTRING"):
            assert block["fLoadTorque_Nm"] == 0.0
            assert block["bLoadEnable"] or entered
        if block["bDataValid"]:
            valid[block["bBackward"]].append((block["fOut_rad"], block["fMotorSpeed_rpm"], made.torque))
        if state == "DONE":
            break
    start = ["CHECK", "WARM_UP", "HOMING", "BACKLASH_PLUS", "BACKLASH_MINUS", "CENTRING"]
    assert seen == [*start, *ONE_DIRECTION, *ONE_DIRECTION, "DONE"]
    assert made.oil >= 25.0
    move = 900.0 / RATIO / 60.0 * TURN * CYCLE
    for backward, sign in ((False, 1.0), (True, -1.0)):
        out, speed, torque = np.array(valid[backward]).T
        assert np.all(speed == sign * 900.0)
        assert np.all(np.abs(torque - sign * 300.0) <= 10.0)
        # from the first sample behind a zero angle to the last within a revolution: no sample twice, none missing
        assert np.all(np.sign(np.diff(out)) == sign)
        assert 0.0 <= (sign * out[0]) % TURN < move * (1 + 1e-9)
        span = abs(out[-1] - out[0])
        assert TURN - move * (1 + 1e-9) <= span + (sign * out[0]) % TURN + 1e-12 < TURN
        assert len(out) in (int(TURN / move), int(TURN / move) + 1)
    made.step()
    assert (block["bDone"], block["bBusy"], block["eError"]) == (True, False, 0)
    block["bStart"] = False
    assert run_to(made, "IDLE", 3)


def test_homing_finds_the_zero_angle_and_the_middle_of_the_backlash():
    made = rig(fTorque_Nm=0.0)
    made.experiment["bStart"] = True
    run_to(made, "RUN_UP")
    # the slow shaft stopped at its zero angle and was pushed once to each side
    away = (made.theta_out + np.pi) % TURN - np.pi
    assert abs(away) < 1e-4 + made.backlash_rad + 1e-4
    middle = made.theta_in / RATIO - made.theta_out
    # in the middle to the band of the motor and half of what the shaft moved before it was noticed
    assert abs(middle) <= 1e-3 / RATIO + 3.5e-5 + 2 * 1.0 / 60 * TURN / RATIO * CYCLE
    assert made.experiment["fOut_rad"] == 0.0
    assert made.experiment["fIn_rad"] == 0.0


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        *(("fSpeed_rpm", value, "SPEED") for value in (np.nan, 1801.0, -100.0, 0.0, np.inf)),
        *(("fTorque_Nm", value, "TORQUE") for value in (np.nan, 2000.1, -1.0)),
        *(("fTemperature_C", value, "TEMPERATURE") for value in (np.nan, 70.0, 17.0)),  # 17: the oil is too warm
        *((name, np.nan, "PARAMETER") for name in ("fWarmUpSpeed_rpm", "fAcceleration_rpm_s", "fStepTimeOut_s")),
        ("fHomingSpeed_rpm", 500.0, "PARAMETER"),
    ],
)
def test_parameters_outside_of_their_limits_stop_the_measurement_before_it_moves(name, value, error):
    made = rig(**{name: value})
    made.experiment["bStart"] = True
    run_to(made, "FAILED", 10)
    assert made.experiment["eError"] == ERRORS[error]
    assert made.experiment["fMotorSpeed_rpm"] == 0.0
    made.experiment["bStart"] = False
    run_to(made, "IDLE", 2)
    made.experiment[name] = {"fSpeed_rpm": 900.0, "fTorque_Nm": 300.0, "fTemperature_C": 25.0}.get(name, 100.0)
    made.experiment["bStart"] = True
    run_to(made, "WARM_UP", 5)
    assert made.experiment["eError"] == ERRORS["NONE"]


STEPS = [
    "WARM_UP",
    "HOMING",
    "BACKLASH_PLUS",
    "BACKLASH_MINUS",
    "CENTRING",
    "RUN_UP",
    "WAIT_ZERO",
    "MEASURE",
    "RUN_DOWN",
]


@pytest.mark.parametrize(
    ("overrides", "error"),
    [
        ({"bAbort": True}, "ABORTED"),
        ({"bEncodersReady": False}, "ENCODER"),
        ({"fThetaOut_rad": np.nan}, "ENCODER"),
        ({"fThetaIn_rad": np.inf}, "ENCODER"),
        ({"fThetaOut_rad": -3.0}, "ENCODER_JUMP"),
        ({"fOil_C": np.nan}, "SENSOR"),
        ({"fShaftTorque_Nm": -np.inf}, "SENSOR"),
        ({"fCycle_s": 0.0}, "CYCLE_TIME"),
    ],
)
def test_errors_in_any_step_take_torque_and_speed_to_zero(overrides, error):
    made = rig()
    made.experiment["bStart"] = True
    for step in STEPS[:: 1 if error == "ABORTED" else 4]:
        made.oil = 24.9
        run_to(made, step)
        made.overrides = overrides
        speeds = [made.experiment["fMotorSpeed_rpm"]]
        for _ in range(5):
            made.step()
            speeds.append(made.experiment["fMotorSpeed_rpm"])
            assert not made.experiment["bDataValid"]
            assert made.experiment["fLoadTorque_Nm"] == 0.0
        made.overrides = {}
        run_to(made, "FAILED", 2000)
        assert made.experiment["eError"] == ERRORS[error], step
        assert made.experiment["fMotorSpeed_rpm"] == 0.0
        assert np.max(np.abs(np.diff(speeds))) <= 200.0 * CYCLE * (1 + 1e-12)
        made.experiment["bStart"] = False
        run_to(made, "IDLE", 2)
        made.experiment["bStart"] = True


def test_oil_that_is_too_warm_is_refused_at_the_start_only_as_the_comment_says():
    made = rig()
    made.experiment["bStart"] = True
    run_to(made, "MEASURE")
    made.overrides = {"fOil_C": 55.0}
    run_to(made, "DONE")
    assert made.experiment["eError"] == ERRORS["NONE"]
    made.experiment["bStart"] = False
    run_to(made, "IDLE", 3)
    made.experiment["bStart"] = True
    run_to(made, "FAILED", 10)
    assert made.experiment["eError"] == ERRORS["TEMPERATURE"]
    assert any("warmer than wanted at the start; not looked at" in text for text in texts(project(), "iec").values())


def test_a_load_that_is_left_goes_down_before_anything_moves():
    made = rig(fTorque_Nm=1500.0, fOilBand_C=50.0)
    made.oil = 25.0
    made.experiment["bStart"] = True
    run_to(made, "MEASURE")
    made.overrides = {"bAbort": True}
    run_to(made, "FAILED")
    made.overrides = {}
    made.experiment["bStart"] = False
    run_to(made, "IDLE", 2)
    assert made.torque > 500.0
    made.experiment["bStart"] = True
    while made.step() in ("IDLE", "CHECK"):
        assert made.experiment["fMotorSpeed_rpm"] == 0.0
    assert made.torque <= 10.0
    run_to(made, "RUN_UP")


def test_a_load_that_does_not_go_down_is_given_up_at_rest():
    made = rig(fStepTimeOut_s=5.0)
    made.overrides = {"fShaftTorque_Nm": -50.0}
    made.experiment["bStart"] = True
    assert run_to(made, "FAILED") == ["CHECK", "STOPPING", "FAILED"]
    assert made.experiment["eError"] == ERRORS["TIME_OUT"]


@pytest.mark.parametrize(
    ("fastest", "ratio"), [("fWarmUpSpeed_rpm", 30.0), ("fSpeed_rpm", 30.0), ("fHomingSpeed_rpm", 7.0)]
)
def test_no_step_turns_the_loading_motor_beyond_its_limit(fastest, ratio):
    """As the header says; it turns with the output, whatever the step."""
    (text,) = texts(project(), "iec").values()
    machine = Machine(
        parse_project(
            {"x.st": text.replace("REDUCTION_RATIO : LREAL := 81.0", f"REDUCTION_RATIO : LREAL := {ratio}")}, "iec"
        )
    )
    limit = 4000.0 * ratio / 156.0
    for speed, error in ((0.999 * limit, "NONE"), (1.001 * limit, "SPEED")):
        block = machine.instance("FB_Experiment")
        block(bStart=True)
        given = {"fSpeed_rpm": 20.0, "fWarmUpSpeed_rpm": 20.0, "fTemperature_C": 25.0, "fOil_C": 20.0}
        block(**given | {fastest: speed}, bEncodersReady=True)
        assert block["eError"] == ERRORS[error]


def test_running_down_the_speed_does_not_rise_again_where_the_torque_does():
    """As a reducer with much friction does, or a torque meter with noise."""
    made = rig()
    made.oil = 25.0
    made.experiment["bStart"] = True
    run_to(made, "RUN_DOWN")
    speeds = []
    for cycle in range(1000):
        made.overrides = {"fShaftTorque_Nm": 12.0 if speeds and speeds[-1] < 450.0 and cycle % 3 else 0.0}
        if made.step() != "RUN_DOWN":
            break
        speeds.append(made.experiment["fMotorSpeed_rpm"])
    assert speeds[-1] == 0.0
    assert np.all(np.diff(speeds) <= 0.0)


@pytest.mark.parametrize("speed", [20.0, -20.0])
def test_no_load_is_wanted_before_the_motor_turns_against_it(speed):
    made = rig(fSpeed_rpm=10.0)
    made.oil = 25.0
    made.experiment["bStart"] = True
    run_to(made, "RUN_UP")
    made.experiment["fMotorSpeed_rpm"] = speed
    made.step()
    assert made.experiment["fLoadTorque_Nm"] == (300.0 if speed > 0 else 0.0)


@pytest.mark.parametrize(
    ("step", "overrides", "settings"),
    [
        ("WARM_UP", {"fOil_C": 20.0}, {"fWarmUpTimeOut_s": 3.0}),
        ("BACKLASH_PLUS", {"fThetaOut_rad": 0.0}, {"fStepTimeOut_s": 60.0}),
        ("RUN_UP", {"fShaftTorque_Nm": 100.0}, {"fStepTimeOut_s": 60.0}),
    ],
)
def test_a_step_that_does_not_end_is_given_up(step, overrides, settings):
    made = rig(**settings)
    made.experiment["bStart"] = True
    run_to(made, step)
    if "fThetaOut_rad" in overrides:
        overrides = {"fThetaOut_rad": made.theta_out}
    made.overrides = overrides
    run_to(made, "FAILED", 40_000)
    assert made.experiment["eError"] == ERRORS["TIME_OUT"]


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_the_load_is_limited_ramped_and_divided_by_its_ratio(target):
    block = Machine(loaded(target)).instance("FB_LoadTorque")
    values = [0.0]
    for _ in range(1100):
        block(fTorque_Nm=1000.0, bEnable=True, fCycle_s=0.005, fRate_Nm_s=200.0)
        values.append(block["fShaftTorque_Nm"])
    assert values[-1] == 1000.0
    assert block["bReached"]
    assert np.max(np.abs(np.diff(values))) == pytest.approx(1.0)
    assert block["fMotorTorque_Nm"] == 1000.0 / 156.0
    for _ in range(2000):
        block(fTorque_Nm=3000.0)
    assert (block["fShaftTorque_Nm"], block["bLimited"], block["bReached"]) == (2000.0, True, True)
    block(fTorque_Nm=np.nan)
    assert (block["bValid"], block["eError"], block["fShaftTorque_Nm"]) == (False, ERRORS["LOAD_TORQUE"], 1999.0)
    for _ in range(2000):
        block(fTorque_Nm=100.0, bEnable=False)
    assert block["fShaftTorque_Nm"] == 0.0


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_prg_experiment_runs_through_thousands_of_cycles(target):
    machine = Machine(loaded(target))
    program = machine.program("PRG_Experiment")
    holder, path = (machine.globals, "GVL_Experiment.{}") if target == "twincat" else (program, "{}")
    settings = {"fSpeed_rpm": 900.0, "fTorque_Nm": 300.0, "fTemperature_C": 25.0, "fOil_C": 26.0, "bStart": True}
    for name, value in {**settings, "bEncodersReady": True}.items():
        holder[path.format(name)] = value
    theta, states = 0.0, set()
    for _ in range(6000):
        theta += holder[path.format("fMotorSpeed_rpm")] / 60.0 * TURN * 0.0005
        holder[path.format("fThetaIn_rad")] = theta
        holder[path.format("fThetaOut_rad")] = theta / RATIO
        program()
        states.add(STATES[holder[path.format("eState")]])
        assert holder[path.format("eError")] == 0
    assert states >= {"CHECK", "WARM_UP", "HOMING", "BACKLASH_PLUS", "BACKLASH_MINUS", "CENTRING", "RUN_UP"}
    assert holder[path.format("fMotorSpeed_rpm")] > 0.0
