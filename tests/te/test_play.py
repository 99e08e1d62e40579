"""A bundle that knows its play: the mean taken apart into what belongs to the direction and what follows the load."""

import dataclasses

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.proof.prove.blocks import prove_block
from st_codegen.proof.verify import verify
from st_codegen.rig.compensator import restricted
from st_codegen.st import Machine
from st_codegen.te.bundle_file import read_description
from st_codegen.te.harmonics import Play
from tests.te.projects import BOTH, PLAY, described, error_codes, loaded, parts, project, texts

TARGETS = ["twincat", "iec"]
CODE = error_codes()
CYCLE = 0.001
POINT = {"fSpeed_rpm": 500.0, "fTorque_Nm": 300.0, "fTemperature_C": 30.0, "fThetaOut_rad": 0.0, "fCycle_s": CYCLE}


def compensator(target="iec", play=PLAY, **inputs):
    block = Machine(loaded(target, slope=0.0, play=play)).instance("FB_Compensator")
    for name, value in {**POINT, "bEnable": True, "fBlendTime_s": 0.0, **inputs}.items():
        block[name] = value
    return block


def te(side, share):
    """TE at the angle 0: order 0 from both means, the others from the set of the side (0 forward, 1 backward)."""
    forward, backward = (parts(direction)[0] for direction in (0, 1))
    mean = 0.5 * (forward[0] + backward[0]) + 0.5 * (forward[0] - backward[0] + PLAY.angle_deg) * share
    return mean - 0.5 * PLAY.angle_deg * (1 - 2 * side) + parts(side)[0][1:].sum()


@pytest.mark.parametrize("target", TARGETS)
def test_without_a_load_nothing_changes(target):
    random = np.random.default_rng(1)
    plain, own = (Machine(loaded(target, slope=0.0, play=play)).instance("FB_Compensator") for play in (None, PLAY))
    speed = np.concatenate([np.linspace(300, -300, 60), np.zeros(20), np.linspace(0, 200, 40)])
    for cycle, rpm in enumerate(speed):
        given = POINT | {"fSpeed_rpm": rpm, "fTorque_Nm": random.uniform(0, 1800), "fThetaOut_rad": 0.01 * cycle}
        plain(**given, bEnable=True)
        own(**given, bEnable=True, fSignedLoad=random.normal(0, 1000))
        assert own["fTE_deg"] == pytest.approx(plain["fTE_deg"], abs=1e-14)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("speed", "side"), [(500.0, 0), (-500.0, 1)])
@pytest.mark.parametrize("torque", [300.0, 120.0, 0.0, -300.0, -900.0])
def test_the_mean_follows_the_load_and_the_play_the_direction(target, speed, side, torque):
    block = compensator(target, fSpeed_rpm=speed, bLoadGiven=True, fSignedLoad=torque)
    block()
    assert block["fTE_deg"] == pytest.approx(te(side, np.clip(torque / 300.0, -1, 1)), abs=1e-13)


def test_a_load_that_turns_over_at_standstill_tells_the_direction():
    block = compensator(bLoadGiven=True, fSignedLoad=300.0)
    for speed, torque, side in [
        *((500.0, 300.0, 0), (0.0, 300.0, 0), (0.0, -4.9, 0)),  # below fLoadChange it has no sign
        *((0.0, -300.0, 1), (0.0, 4.9, 1), (0.0, 300.0, 0), (0.0, -300.0, 1)),
        *((-500.0, -300.0, 1), (-500.0, 300.0, 1), (0.0, 300.0, 1), (0.0, 300.0, 1)),  # turned over on the way: not now
        *((500.0, 300.0, 0), (0.0, -300.0, 1)),
    ]:
        block(fSpeed_rpm=speed, fSignedLoad=torque)
        assert block["fTE_deg"] == pytest.approx(te(side, np.clip(torque / 300.0, -1, 1)), abs=1e-13), (speed, torque)
    block = compensator(fSignedLoad=300.0)
    block()
    block(fSpeed_rpm=0.0, fSignedLoad=-300.0)
    assert block["fTE_deg"] == pytest.approx(te(0, 1.0), abs=1e-13)


def test_nothing_of_a_load_stays_where_it_has_no_lag():
    """`compare` calls one instance for all rows and wants the bits of each alone."""
    random, kept = np.random.default_rng(3), compensator(bLoadGiven=True)
    for torque, theta in zip(random.uniform(-300, 300, 40), random.uniform(0, 6, 40), strict=True):
        given = {"fSignedLoad": torque, "fThetaOut_rad": theta}
        alone = compensator(bLoadGiven=True)
        kept(**given)
        alone(**given)
        assert kept["fTE_deg"] == alone["fTE_deg"]


def test_the_share_of_the_load_lags_as_the_load_does():
    block = compensator(bLoadGiven=True, fSignedLoad=300.0, fLoadTime_s=0.02)
    block()
    assert block["fTE_deg"] == pytest.approx(te(0, 1.0), abs=1e-13)  # the first call knows no past
    share = 1.0
    for _ in range(200):
        block(fSignedLoad=-300.0)
        share += (-1.0 - share) * CYCLE / (CYCLE + 0.02)
        assert block["fTE_deg"] == pytest.approx(te(0, share), abs=1e-12)
    assert share == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("speed", [-3.0, -30.0])
def test_the_sets_change_over_an_angle(speed):
    angle = 1e-3
    block = compensator(fHysteresis_rpm=0.0, fBlendAngle_deg=angle)
    block()
    travelled = 0.0
    for _ in range(60):
        block(fSpeed_rpm=0.0)
        share = min(travelled / angle, 1.0)
        assert block["fTE_deg"] == pytest.approx((1 - share) * te(0, 1.0) + share * te(1, -1.0), abs=1e-13)
        block(fSpeed_rpm=speed)
        travelled += 6.0 * abs(speed) / 81.0 * CYCLE
    assert travelled > angle
    assert block["fTE_deg"] == pytest.approx(te(1, -1.0), abs=1e-13)


def test_with_a_given_load_the_sets_change_by_time_whatever_the_angle():
    """As the comment of the input says."""
    blocks = [compensator(bLoadGiven=True, fSignedLoad=300.0, fBlendAngle_deg=angle) for angle in (0.0, 1e-3, 10.0)]
    for speed in (30.0, *[-30.0] * 200):
        for block in blocks:
            block(fSpeed_rpm=speed)
        assert blocks[0]["fTE_deg"] == blocks[1]["fTE_deg"] == blocks[2]["fTE_deg"]
    comment = "(* least output angle over which the sets change; 0, or bLoadGiven: none, deg, 0.0 .. 10.0 *)"
    assert any(comment in text for text in texts(project(play=PLAY), "iec").values())


def test_the_angle_makes_no_change_of_sets_faster_than_the_blend_time():
    """As the comment says: it is the least angle."""
    block = compensator(fBlendAngle_deg=1e-6, fBlendTime_s=1.0)
    for speed in (30.0, *[-30.0] * 20):
        block(fSpeed_rpm=speed)
    share = 20 * CYCLE / 1.0
    assert block["fTE_deg"] == pytest.approx((1 - share) * te(0, 1.0) + share * te(1, -1.0), abs=1e-13)


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        *(("fSignedLoad", value, "OPERATING_POINT") for value in (np.nan, np.inf, -1e10)),
        *((name, np.nan, "PARAMETER") for name in ("fLoadTime_s", "fLoadChange", "fBlendAngle_deg")),
        *((name, -0.1, "PARAMETER") for name in ("fLoadTime_s", "fLoadChange", "fBlendAngle_deg")),
        *(
            ("fLoadTime_s", 10.1, "PARAMETER"),
            ("fLoadChange", 1e7, "PARAMETER"),
            ("fBlendAngle_deg", 11.0, "PARAMETER"),
        ),
    ],
)
def test_bad_inputs_are_named_and_leave_no_trace(name, value, code):
    block = compensator(bLoadGiven=True, fSignedLoad=300.0)
    block()
    good, before = block[name], block["fTE_deg"]
    block(**{name: value})
    assert (block["bValid"], block["eError"]) == (False, CODE[code])
    block(**{name: good})
    assert (block["bValid"], block["fTE_deg"]) == (True, before)


@pytest.mark.parametrize("target", TARGETS)
def test_the_limits_hold_in_every_call(target):
    model, _ = described(slope=0.0, play=PLAY)
    project = loaded(target, slope=0.0, play=PLAY)
    found = prove_block(project, "FB_Compensator", {"FB_Parts": [(model, tuple(range(10)))]})
    limits = {limit.output: (limit.lower, limit.upper) for limit in found.limits}
    assert limits["fCorrection_deg"] == limits["fTE_deg"] == (-360.0, 360.0)
    (slew,) = found.slews
    assert (slew.output, slew.step, slew.largest) == ("fCorrection_deg", "fSlew * fCycle", 1e6)


def test_a_play_needs_both_means():
    _, bundle = described(play=PLAY)
    for change in ({"orders": (1, 39)}, {"directions": BOTH[:1]}):
        with pytest.raises(InputError, match="a play needs the mean"):
            dataclasses.replace(bundle, **change)


TABLE = '[play]\nangle_deg = 0.008\ntorque_feature = "torque_Nm"\n'


def with_play(folder, text=TABLE):
    path = folder / "bundle.toml"
    path.write_text(path.read_text(encoding="utf-8") + "\n" + text, encoding="utf-8")
    return folder


def test_bundle_toml_gives_the_play(bundle_folder):
    te = load(with_play(bundle_folder)).purpose.te
    assert te.play == Play(0.008, 1)
    assert load(bundle_folder).purpose.facts()["play_deg"] == 0.008


def test_only_sets_with_the_mean_keep_it(bundle_folder):
    bundle = load(with_play(bundle_folder))
    assert restricted(bundle, (0,)).purpose.te.play
    assert restricted(bundle, (1,)).purpose.te.play is None


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("0.008", "-0.008", "angle_deg"),
        ("0.008", "nan", "angle_deg"),
        ("0.008", "11.0", "angle_deg"),
        ("torque_Nm", "speed_rpm", "torque_feature = 'speed_rpm' is none of the features beside the speed"),
        ("torque_Nm", "load", "torque_feature = 'load' is none of the features beside the speed (torque_Nm, "),
        ("angle_deg = 0.008\n", "", "angle_deg"),
        ("[play]", "[play]\nwidth = 1", "width"),
    ],
)
def test_what_is_wrong_with_the_play_is_said(bundle_folder, old, new, part):
    with_play(bundle_folder, TABLE.replace(old, new))
    with pytest.raises(InputError, match="play") as caught:
        read_description(bundle_folder / "bundle.toml")
    assert part in str(caught.value)


def test_verify_knows_the_play(bundle_folder, tmp_path):
    bundle = load(with_play(bundle_folder))
    folder = generate(bundle, "iec", tmp_path).folder
    assert verify(bundle, folder, rows=20).passed
    (path,) = folder.glob("*.st")
    text = path.read_text(encoding="utf-8")
    for good, bad in (("+ PLAY_DEG) * fLoadShare", ") * fLoadShare"), ("1.0 - 2.0 * fBlend)", "1.0)")):
        assert good in text
        path.write_text(text.replace(good, bad), encoding="utf-8")
        assert not verify(bundle, folder, rows=20).passed
