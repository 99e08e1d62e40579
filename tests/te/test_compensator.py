"""What the compensation does, case by case: numbers, direction, law, fading, error codes."""

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.st import Machine
from st_codegen.te.harmonics import Direction
from tests.te.projects import BOTH, ORDERS, RATIO, error_codes, loaded, parts, project, texts

TARGETS = ["twincat", "iec"]
POINT = {"fSpeed_rpm": 500.0, "fTorque_Nm": 300.0, "fTemperature_C": 30.0}
CODE = error_codes()
#: A cycle, and how many a ramp (0.5 s) and a blend (0.1 s) take.
CYCLE, RAMP, BLEND = 0.005, 100, 20


def compensator(target, directions=BOTH, **inputs):
    block = Machine(loaded(target, directions=directions, slope=0.0)).instance("FB_Compensator")
    for name, value in {**POINT, "bEnable": True, "fThetaOut_rad": 0.0, "fCycle_s": CYCLE, **inputs}.items():
        block[name] = value
    return block


def te(theta, direction=0):
    cosine, sine = parts(direction)
    angle = np.array(ORDERS) * theta
    return float(cosine @ np.cos(angle) - sine @ np.sin(angle))


def steady(block, cycles=RAMP + 20, **inputs):
    """Call until nothing ramps any more; returns the correction."""
    for _ in range(cycles):
        block(**inputs)
    return block["fCorrection_deg"]


@pytest.mark.parametrize("target", TARGETS)
def test_the_sum_and_the_correction_are_those_of_eq_3_and_6(target):
    block = compensator(target)
    for speed, direction in ((500.0, 0), (-500.0, 1)):
        for theta in (0.3, -4.0, 1234.5, 1e8):
            block = compensator(target, fSpeed_rpm=speed)
            correction = steady(block, fThetaOut_rad=theta)
            assert block["fTE_deg"] == pytest.approx(te(theta, direction), abs=1e-12)
            assert correction == pytest.approx(-RATIO * te(theta, direction), abs=1e-9)
            assert (block["bValid"], block["bActive"], block["bInRange"], block["eError"]) == (True, True, True, 0)


@pytest.mark.parametrize("target", TARGETS)
def test_enabling_and_disabling_ramp_without_a_step(target):
    block = compensator(target, bEnable=False)
    assert steady(block, 10) == 0.0
    assert not block["bActive"]
    assert block["fTE_deg"] == pytest.approx(te(0.0), abs=1e-12)  # the prediction is there all the same
    full = -RATIO * te(0.0)
    values = [0.0]
    for enable, cycles in ((True, RAMP + 10), (False, RAMP + 10)):
        for _ in range(cycles):
            block(bEnable=enable)
            values.append(block["fCorrection_deg"])
        assert values[-1] == pytest.approx(full if enable else 0.0, rel=1e-12)
    assert np.max(np.abs(np.diff(values))) == pytest.approx(abs(full) / RAMP, rel=1e-6)
    assert not block["bActive"]


@pytest.mark.parametrize(
    ("speed", "published", "weight"),
    [
        *((100.0, True, 1.0), (99.9, True, 0.666), (50.0, True, 1 / 3), (100.0, False, 1.0), (50.0, False, 0.5)),
        *((0.0, True, 0.0), (-0.0, False, 0.0), (-75.0, False, 0.75), (-75.0, True, 0.5), (1800.0, False, 1.0)),
    ],
)
def test_both_laws(speed, published, weight):
    block = compensator("iec", fSpeed_rpm=speed, bPublishedLaw=published)
    correction = steady(block)
    assert block["fWeight"] == pytest.approx(weight, rel=1e-12)
    assert correction == pytest.approx(-RATIO * weight * te(0.0, int(speed < 0)), rel=1e-9)


@pytest.mark.parametrize("target", TARGETS)
def test_the_direction_changes_beyond_the_hysteresis_and_without_a_step(target):
    block = compensator(target, fSpeed_rpm=500.0, fThetaOut_rad=0.7)
    steady(block)
    forward, backward = te(0.7, 0), te(0.7, 1)
    for noise in (1.9, -1.9, 0.0, -0.0, -1.0):
        block(fSpeed_rpm=noise)
        assert block["fTE_deg"] == pytest.approx(forward, abs=1e-12)
    values = [block["fTE_deg"]]
    for _ in range(BLEND + 6):
        block(fSpeed_rpm=-2.1)
        values.append(block["fTE_deg"])
    assert values[-1] == pytest.approx(backward, abs=1e-12)
    assert np.max(np.abs(np.diff(values))) == pytest.approx(abs(forward - backward) / BLEND, rel=1e-6)
    block(fSpeed_rpm=1.0)
    assert block["fTE_deg"] == pytest.approx(backward, abs=1e-12)


def test_the_first_call_knows_its_direction_at_once():
    for speed, direction in ((1.0, 0), (-1.0, 1), (900.0, 0), (-900.0, 1), (0.0, 0)):
        block = compensator("iec", fSpeed_rpm=speed, fThetaOut_rad=0.7)
        block()
        assert block["fTE_deg"] == pytest.approx(te(0.7, direction), abs=1e-12)
        assert abs(block["fCorrection_deg"]) <= RATIO * abs(te(0.7, direction)) / (RAMP - 1)


BAD_INPUTS = [
    *(("fThetaOut_rad", value, "ANGLE") for value in (np.nan, np.inf, -np.inf, 1.1e9)),
    *((name, value, "OPERATING_POINT") for name in POINT for value in (np.nan, np.inf, -1e300)),
    *(("fCycle_s", value, "CYCLE_TIME") for value in (np.nan, 0.0, -0.0, -0.0005, 1.1, np.inf, 1e-300)),
    *(("fCorrectionLimit_deg", value, "PARAMETER") for value in (np.nan, -1.0, 361.0)),
    *(("fSlewLimit_deg_s", value, "PARAMETER") for value in (np.nan, 0.0, np.inf)),
    *(("fRampTime_s", -0.1, "PARAMETER"), ("fHysteresis_rpm", np.nan, "PARAMETER")),
    *(("fBlendTime_s", np.inf, "PARAMETER"), ("fLead_s", 0.11, "PARAMETER")),
]


@pytest.mark.parametrize("target", TARGETS)
def test_a_bad_input_says_which_and_fades_out_and_back(target):
    """One row for each bad input."""
    rows = len(BAD_INPUTS)
    block = Machine(loaded(target, slope=0.0), rows=rows).instance("FB_Compensator")
    good = {name: np.full(rows, value) for name, value in POINT.items()}
    good |= {"fThetaOut_rad": np.zeros(rows), "fCycle_s": np.full(rows, CYCLE)}
    good |= {name: np.asarray(block[name]).copy() for name, *_ in BAD_INPUTS if name not in good}
    bad = {name: value.copy() for name, value in good.items()}
    for row, (name, value, _) in enumerate(BAD_INPUTS):
        bad[name][row] = value
    full = steady(block, **good, bEnable=True).copy()
    assert np.all(full == full[0])
    values = [full]
    for _ in range(RAMP + 1):
        block(**bad)
        values.append(block["fCorrection_deg"].copy())
        assert not np.any(block["bValid"])
        assert block["eError"].tolist() == [CODE[error] for *_, error in BAD_INPUTS]
    assert not np.any(values[-1])
    assert not np.any(block["bActive"])
    for _ in range(RAMP + 1):
        block(**good)
        values.append(block["fCorrection_deg"].copy())
        assert np.all(block["bValid"])
    assert values[-1] == pytest.approx(full, rel=1e-9)
    assert np.max(np.abs(np.diff(values, axis=0))) <= abs(full[0]) / RAMP * (1 + 1e-6)


def test_after_a_short_fault_the_correction_first_reaches_zero():
    block = compensator("iec")
    steady(block)
    block(fThetaOut_rad=np.nan)
    values = []
    # another angle comes back: its correction must not appear at once
    for _ in range(2 * RAMP + 10):
        block(fThetaOut_rad=2.0)
        values.append(block["fCorrection_deg"])
    assert np.min(np.abs(values)) == 0.0
    lowest = int(np.argmin(np.abs(values)))
    assert RAMP - 5 <= lowest <= RAMP
    largest = RATIO * max(abs(te(0.0)), abs(te(2.0)))
    assert np.max(np.abs(np.diff(values))) <= largest / RAMP * (1 + 1e-6)
    assert values[-1] == pytest.approx(-RATIO * te(2.0), rel=1e-9)


def faulty_until_zero(block, longest, good_after=10**9):
    """The corrections of calls without an angle, and of good ones behind `good_after`, until zero is reached."""
    values = [block["fCorrection_deg"]]
    for cycle in range(longest):
        block(fThetaOut_rad=np.nan if cycle < good_after else 2.0)
        values.append(block["fCorrection_deg"])
        if values[-1] == 0.0:
            return np.array(values)
    raise AssertionError("not faded out")


@pytest.mark.parametrize("target", TARGETS)
def test_after_a_fault_a_correction_that_lags_behind_goes_towards_zero_only(target):
    """The slew limit, or a limit that is lifted meanwhile, kept it from the value that is faded."""
    slow = compensator(target, fSlewLimit_deg_s=1.0)
    steady(slow)
    limited = compensator(target, fCorrectionLimit_deg=0.1)
    steady(limited)
    limited(fThetaOut_rad=np.nan)
    limited["fCorrectionLimit_deg"] = 20.0
    turned = compensator(target, fSlewLimit_deg_s=1.0)
    steady(turned, 400)
    turned(fThetaOut_rad=2.0)
    assert te(0.0) * te(2.0) < 0.0
    for block in (slow, limited, turned):
        values = faulty_until_zero(block, 400)
        assert values[0] != 0.0
        assert np.all(np.diff(np.abs(values)) <= 0.0)
        assert np.all(values * values[0] >= 0.0)


@pytest.mark.parametrize("target", TARGETS)
def test_a_correction_that_fades_at_the_slew_limit_does_not_come_back_before_it_is_zero(target):
    block = compensator(target, fSlewLimit_deg_s=1.0, fRampTime_s=0.0)
    full = steady(block, 600)
    assert full == pytest.approx(-RATIO * te(0.0), rel=1e-9)
    values = faulty_until_zero(block, 600, good_after=1)
    assert np.all(np.diff(np.abs(values)) < 0.0)
    assert len(values) - 1 == np.ceil(abs(full) / CYCLE)
    steady(block, 600, fThetaOut_rad=2.0)
    assert block["fCorrection_deg"] == pytest.approx(-RATIO * te(2.0), rel=1e-9)


def test_limits_are_kept_and_a_lowered_one_is_reached_at_the_slew_limit():
    block = compensator("iec", fCorrectionLimit_deg=1.6)
    assert abs(steady(block)) == 1.6
    values = [block["fCorrection_deg"]]
    for _ in range(100):
        block(fCorrectionLimit_deg=0.5, fSlewLimit_deg_s=100.0)
        values.append(block["fCorrection_deg"])
    assert np.max(np.abs(np.diff(values))) == pytest.approx(100.0 * CYCLE, rel=1e-9)
    assert abs(values[-1]) == 0.5


def test_a_lead_takes_the_angle_later():
    lead, speed = 1325.3e-6, 1800.0
    block = compensator("iec", fSpeed_rpm=speed, fThetaOut_rad=1.0, fLead_s=lead)
    block()
    ahead = 1.0 + speed / RATIO * 2 * np.pi / 60 * lead
    assert block["fTE_deg"] == pytest.approx(te(ahead), abs=1e-12)
    assert te(ahead) != pytest.approx(te(1.0), abs=1e-4)


def test_operating_points_outside_the_declared_range_are_limited_and_flagged():
    block = compensator("iec", fTorque_Nm=1900.0)
    block()
    assert (block["bValid"], block["bInRange"]) == (True, False)
    block(fTorque_Nm=1800.0)
    assert block["bInRange"]


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("direction", "sign"), [(Direction.FORWARD, 1.0), (Direction.BACKWARD, -1.0)])
def test_a_bundle_with_one_direction_fades_out_in_the_other(target, direction, sign):
    block = compensator(target, (direction,), fSpeed_rpm=400.0 * sign)
    assert steady(block) == pytest.approx(-RATIO * te(0.0), rel=1e-9)
    values = [block["fCorrection_deg"]]
    for _ in range(RAMP + 1):
        block(fSpeed_rpm=-400.0 * sign)
        values.append(block["fCorrection_deg"])
        assert block["eError"] == CODE["DIRECTION"]
    assert values[-1] == 0.0
    assert np.max(np.abs(np.diff(values))) <= abs(values[0]) / RAMP * (1 + 1e-6)
    assert steady(block, fSpeed_rpm=400.0 * sign) == pytest.approx(values[0], rel=1e-9)


def test_features_that_are_called_as_an_input_are_refused():
    import dataclasses

    from st_codegen.te.compensation import compensation
    from tests.te.projects import described

    _, bundle = described()
    # the last two stand beside the features in the list of the signals alone
    for name in ("cycle_s", "age_s", "ageLimit_s"):
        features = (*bundle.features[:2], dataclasses.replace(bundle.features[2], name=name))
        with pytest.raises(InputError, match=f"f{name[0].upper()}{name[1:]}: rename the feature"):
            compensation(dataclasses.replace(bundle, features=features))


@pytest.mark.parametrize("ratio", [1e-4, 1e7])
def test_reduction_ratios_that_are_none_are_refused(ratio):
    import dataclasses

    from st_codegen.te.compensation import compensation
    from tests.te.projects import described

    with pytest.raises(InputError, match="reduction ratio"):
        compensation(dataclasses.replace(described()[1], reduction_ratio=ratio))
    for taken in (1e-3, 1e6):  # what the message gives as the ends
        compensation(dataclasses.replace(described()[1], reduction_ratio=taken))


def header_of(block):
    """The words of the comment above a block."""
    (text,) = texts(project(), "iec").values()
    return " ".join(text.partition(f"  {block}: ")[2].partition("*)")[0].split())


def test_a_slow_slew_limit_makes_the_fading_longer_than_the_ramp_and_the_header_says_so():
    block = compensator("iec")
    full = steady(block)
    for _ in range(RAMP + 20):
        block(fSlewLimit_deg_s=1.0, fThetaOut_rad=np.nan)
    assert abs(block["fCorrection_deg"]) == pytest.approx(abs(full) - (RAMP + 20) * CYCLE)
    assert "slew limit, which makes ramp and fading longer where it is the slower one" in header_of("FB_Correction")


def test_a_limit_of_the_load_that_is_lowered_is_reached_at_the_rate_and_the_header_says_so():
    block = Machine(loaded("iec")).instance("FB_LoadTorque")
    for _ in range(1000):
        block(fTorque_Nm=1000.0, bEnable=True, fCycle_s=0.01)
    block(fTorqueLimit_Nm=100.0)
    assert block["fShaftTorque_Nm"] == 998.0
    assert "a limit that is lowered below the present torque is reached at that rate" in header_of("FB_LoadTorque")


def test_valid_is_false_also_where_all_inputs_are_usable_and_its_comment_does_not_deny_it():
    block = compensator("iec", (Direction.FORWARD,), fSpeed_rpm=-500.0)
    block()
    assert (block["bValid"], block["eError"]) == (False, CODE["DIRECTION"])
    (text,) = texts(project(), "iec").values()
    assert "bValid : BOOL; (* nothing is wrong in this call, see eError *)" in text
