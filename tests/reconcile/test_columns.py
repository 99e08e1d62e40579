"""Columns in another unit, curves whose lowest orders were taken off, and a direction that is a copy of the other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from st_codegen.campaign.harmonic_table import read_table
from st_codegen.errors import InputError
from st_codegen.reconcile.data.observations import from_table
from st_codegen.reconcile.mistakes.columns import other_conditions, taken_off
from st_codegen.reconcile.mistakes.examine import _of_other_sign, examine
from st_codegen.reconcile.mistakes.sensors import mean_of_angles
from st_codegen.rig.model import RigModel, read_rig

from .blind import cases, generator
from .test_core import RIG, effect, grid, observed

PATH = Path("campaign")
RICH = RigModel(
    effects=(
        *RIG.effects,
        effect("thermal_drift", drift_arcmin_per_K=0.02),
        effect("friction_windup", coulomb_arcmin=0.2, viscous_arcmin_per_krpm=0.1, viscosity_decay_per_K=0.03),
        effect("load_dependent_mesh", order=78, slope_deg_per_kNm=1e-3),
    )
)


def asked(data, rig=RICH, accept=()):
    """What is asked, or the data with what is accepted."""
    try:
        return examine(data, rig, PATH, accept=accept)
    except InputError as error:
        return str(error)


READINGS = {
    "temperatures seem to be in degF": lambda at: replace(at, temperature_C=at.temperature_C * 1.8 + 32),
    "temperatures seem to be in K": lambda at: replace(at, temperature_C=at.temperature_C + 273.15),
    "speeds seem to be those of the output": lambda at: replace(at, speed_rpm=at.speed_rpm / 81),
    "speeds seem to be in turns a second": lambda at: replace(at, speed_rpm=at.speed_rpm / 60),
    "speeds seem to be in rad/s": lambda at: replace(at, speed_rpm=at.speed_rpm * 2 * np.pi / 60),
    "speeds seem to be in deg/s of the output": lambda at: replace(at, speed_rpm=at.speed_rpm * 6 / 81),
    "speeds seem to be in rad/s of the output": lambda at: replace(at, speed_rpm=at.speed_rpm * 2 * np.pi / 60 / 81),
    "speeds seem to be in deg/s": lambda at: replace(at, speed_rpm=at.speed_rpm * 6),
    "speeds seem to be in 1000 rpm": lambda at: replace(at, speed_rpm=at.speed_rpm / 1000),
    "torques and temperatures seem to be exchanged": lambda at: replace(
        at, torque_Nm=at.temperature_C, temperature_C=at.torque_Nm
    ),
    "speeds and torques seem to be exchanged": lambda at: replace(at, speed_rpm=at.torque_Nm, torque_Nm=at.speed_rpm),
    "torques seem to be those of the input": lambda at: replace(at, torque_Nm=at.torque_Nm / 81),
    "torques seem to be of the other sign": lambda at: replace(at, torque_Nm=-at.torque_Nm),
    "torques seem to be those of the shaft, negative where a load opposes a backward motion": lambda at: replace(
        at, torque_Nm=at.torque_Nm * at.sign
    ),
    "torques seem to be those of the shaft, negative where a load opposes a forward motion": lambda at: replace(
        at, torque_Nm=-at.torque_Nm * at.sign
    ),
    "torques seem to be in kN m": lambda at: replace(at, torque_Nm=at.torque_Nm / 1000),
}


def test_temperatures_that_no_oil_has_are_in_kelvin_whatever_else_moves_the_mean():
    """Friction that the rig lacks, or a mean whose zero may have moved, left 298 degC as they were."""
    data = observed(RICH, grid())
    at = replace(data.at, temperature_C=data.at.temperature_C + 273.15)
    for wrong in (replace(data, at=at), replace(data, at=replace(at, speed_rpm=at.speed_rpm / 60))):
        text = asked(wrong, RIG)
        assert "the temperatures seem to be in K: no oil has" in text and "--accept conditions" in text
    rich = asked(wrong, RICH)
    assert "in K" in rich and "the speeds seem to be in turns a second" in rich
    examined = asked(wrong, RICH, ["conditions"])
    assert np.allclose(examined.data.at.axes, data.at.axes)


def test_temperatures_that_no_oil_has_in_kelvin_either_are_not_said_to_be_in_kelvin():
    """Of 500 it was asked twice: "no oil has 226.85 degC and more" stood beside what they had been read as."""
    at = grid()
    for hotter, times in ((500.0, 0), (200.0, 1)):
        data = observed(RIG, replace(at, temperature_C=at.temperature_C - at.temperature_C.min() + hotter + 1.0))
        assert sum("no oil has" in one.text for one in other_conditions(data, RIG)) == times


@pytest.mark.thorough
@pytest.mark.parametrize("said", READINGS)
def test_conditions_in_another_unit_are_asked_about_and_read_so(said):
    data = observed(RICH, grid())
    wrong = replace(data, at=READINGS[said](data.at))
    text = asked(wrong)
    assert f"the {said}" in text and "--accept conditions" in text
    right = asked(wrong, accept=["conditions"]).data.at
    for key in ("speed_rpm", "torque_Nm", "temperature_C"):
        assert getattr(right, key) == pytest.approx(getattr(data.at, key), abs=1e-9)


def test_torques_that_never_act_may_be_another_unit_or_none():
    """Of an arm whose load turns its sign within the turn, or a brake that was off, they were "in N mm"."""
    at = grid()
    unloaded = observed(RICH, replace(at, torque_Nm=np.zeros(len(at))), sigma=1e-5)
    text = asked(replace(unloaded, at=at))
    assert "the torques seem to be none that the gear carries in the mean of a turn (a brake that is off" in text
    assert "or in N mm:" in text
    assert "torques seem to be in N mm:" in asked(observed(RICH, at).under(torque_Nm=1e3 * at.torque_Nm))


def test_a_run_that_nothing_tells_is_not_read_as_those_that_lie_on_the_other_side_of_all_others():
    """Of torques in N mm when the oil was warm, the least ones of cold oil were read as thousandths of themselves."""
    softer = RigModel(
        effects=tuple(
            effect(one.name, stiffness_Nm_per_arcmin=350.0) if one.name == "torsional_compliance" else one
            for one in RICH.effects
        )
    )
    points = grid(4, 4, 2)
    at = replace(points, torque_Nm=np.choose((points.torque_Nm / 600.0).round().astype(int), [20.0, 200, 600, 1200]))
    data = observed(softer, at)
    wrong = data.under(torque_Nm=np.where(at.temperature_C > 30.0, 1e3, 1.0) * at.torque_Nm)
    assert "the torques of 16 of 32 runs seem to be in N mm" in asked(wrong)
    assert asked(wrong, accept=["conditions"]).data.at.torque_Nm == pytest.approx(at.torque_Nm)


@pytest.mark.parametrize("said", [said for said in READINGS if "other sign" in said or "shaft" in said])
def test_orders_that_noise_hides_refuse_no_reading(said):
    """Its noise was a fiftieth of the mesh at most: torques of the other sign were three meshes that had turned."""
    data = observed(RICH, grid(), sigma=4e-4)
    assert f"the {said}" in asked(replace(data, at=READINGS[said](data.at)))
    assert asked(data).mistakes == ()


def test_curves_of_the_other_sign_are_no_torques_of_the_other_sign():
    """Most of their mean is what torques of the other sign give it: 35 of 38 runs were to be read so."""
    data = observed(RICH, grid(), sigma=1e-4)
    rows = np.concatenate(data.runs[88:])
    sign = np.ones((len(data), 1))
    sign[rows] = -1.0
    (found,) = asked(replace(data, values=sign * data.values)).mistakes
    assert found.name == "block" and set(found.rows) == set(rows)


def test_half_a_turn_is_told_from_another_sign_by_the_mean():
    """Where noise hides the even orders, curves of the other sign had a zero of the angle of their own, 178 deg off."""
    data, half = observed(RICH, grid(), sigma=4e-4), np.full(252, np.pi)
    model, odd = RICH.coefficients(data.at, data.orders.tolist()), np.where(data.orders % 2, -1.0, 1.0)
    assert _of_other_sign(replace(data, values=-data.values), model, half).all()
    assert not _of_other_sign(replace(data, values=odd * data.values), model, half).any()


def test_of_right_conditions_and_of_a_missing_effect_nothing_is_asked():
    """A drift that the rig does not have is no other unit of the temperature."""
    drift = effect("thermal_drift", drift_arcmin_per_K=0.05)
    for truth in (RICH, RigModel(effects=(*RICH.effects, drift))):
        assert asked(observed(truth, grid())).mistakes == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_zero_that_moved_is_no_other_unit(seed):
    """In noise that hides the drift with the oil, what degF would shift all means by was said to be degF."""
    data = observed(RICH, grid(), seed=seed, sigma=3e-3)
    moved = replace(data, values=data.values + np.where(data.orders == 0, -0.012, 0.0))
    assert asked(moved).mistakes == ()


@pytest.mark.parametrize(("last", "what"), [(0, "the mean"), (1, "the orders up to 1")])
def test_orders_that_were_taken_off_are_asked_about_and_left_out(last, what):
    data = observed(RICH, grid())
    gone = data.orders <= last
    cut = replace(data, values=np.where(gone, 1e-9, data.values))
    text = asked(cut)
    assert f"hardly anything is left of {what} in the runs" in text and "--accept taken_off" in text
    found = asked(cut, accept=["taken_off"]).data
    assert found.orders.tolist() == data.orders[~gone].tolist()
    assert found.not_looked_at == (f"{what}: taken off the curves",)


def test_a_mean_that_is_there_in_half_of_the_runs_was_not_taken_off():
    """Where half of the runs were in arcsec, the mean of the others was less than nothing in their unit."""
    rig = replace(RICH, zero_offset_deg=0.004)  # some runs have hardly any mean
    data = observed(rig, grid())
    times = np.where(np.arange(len(data)) // 2 % 2, 3600.0, 1.0)
    assert taken_off(replace(data, values=data.values * times[:, None]), rig) == []


def test_noise_that_hides_all_orders_says_nothing_of_a_mean_that_was_taken_off():
    """Curves of a thousand degrees of noise had "hardly anything left of the mean": their noise was the data's unit."""
    at = grid()
    noise = observed(RICH, at, sigma=100.0)
    assert taken_off(replace(noise, values=np.where(noise.orders == 0, 0.1 * noise.values, noise.values)), RICH) == []


@pytest.mark.filterwarnings("error")
def test_an_order_alone_that_is_gone_is_no_filter():
    """An eccentricity may have been mended; a mean that follows no load cannot be."""
    data = observed(RICH, grid())
    mended = replace(data, values=np.where(data.orders == 1, 0.0, data.values))
    assert asked(mended).mistakes == ()


def test_a_direction_with_the_digits_of_the_other_is_asked_about():
    data = observed(RICH, grid())
    values = data.values.copy()
    for first, second in data.runs:
        values[second] = values[first]
    copied = replace(data, values=values)
    text = asked(copied, accept=["direction", "column_scale", "sign"])
    assert "the same digits in 126 of 126 runs" in text and "--accept copied" in text
    found = asked(copied, accept=["copied"]).data
    assert set(found.at.sign) == {1.0} and len(found) == len(data) / 2


@pytest.mark.thorough
def test_waves_that_are_later_at_each_speed_are_no_mean_over_the_angle(tmp_path):
    """In the mean of all speeds they are smaller: a chain 36 ms late, in noise that drifts, was a mean over 10 deg."""
    generator.make(cases.case("heldout", 3005), tmp_path)
    rig = read_rig(tmp_path / "rig.toml")
    assert mean_of_angles(from_table(read_table(tmp_path / "harmonics.csv")), rig) == []
