"""Mistakes of measuring are named before any effect is looked for, and corrected when that is accepted."""

import contextlib
import itertools
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from st_codegen.campaign.curves import Curve
from st_codegen.campaign.orders import curve_sums
from st_codegen.errors import InputError
from st_codegen.reconcile.data.hum import Hum, _waves, without_hums, without_waves_between
from st_codegen.reconcile.data.observations import Observations, labels, order_of_runs, rows_that_tell
from st_codegen.reconcile.data.ramps import ramp_deg
from st_codegen.reconcile.mistakes import sensors
from st_codegen.reconcile.mistakes.each_run import _most_gain, ramps
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.reconcile.mistakes.other_shaft import other_shaft, over_the_output
from st_codegen.reconcile.mistakes.sensors import hidden_wrong_angle, low_pass
from st_codegen.reconcile.mistakes.votes import PowerSums, expected_of, noise_power, told_power
from st_codegen.reconcile.rest.unexplained import Signature, _with_hums
from st_codegen.rig.effects import Conditions, catalogue
from st_codegen.rig.model import read_rig

from .blind_form.machine import draw_machine
from .test_core import effect

KNOWN = catalogue()
RIG = read_rig(Path(__file__).resolve().parents[2] / "examples" / "rv160n" / "rig.toml", KNOWN)
ORDERS = np.array(RIG.orders())
PATH = Path("measured")
RUNS = 210


def measured(sigma=3e-5, seed=0):
    """A campaign in any order: 10 speeds, 7 torques, 3 temperatures, both directions of a run at the same place."""
    random = np.random.default_rng(seed)
    axes = np.meshgrid(np.linspace(100, 1800, 10), np.linspace(0, 1800, 7), [25.0, 30.0, 35.0])
    points = random.permutation(np.stack([axis.ravel() for axis in axes], axis=1))
    at = Conditions.of(np.repeat([1.0, -1.0], RUNS), *np.tile(points, (2, 1)).T)
    values = RIG.coefficients(at, ORDERS.tolist())
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    return Observations(
        at, labels(at), ORDERS, values + np.where(ORDERS == 0, noise.real, noise), run=order_of_runs(at)
    )


def turned(data, degrees):
    return replace(data, values=data.values * np.exp(-1j * np.deg2rad(degrees) * ORDERS))


def exchanged(data):
    at = data.at
    return replace(data, at=Conditions(-at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C))


def column(data, factor):
    return replace(data, values=data.values * np.where(data.at.sign > 0, factor, 1.0)[:, None])


def ramp(data, used, start_deg=0.0):
    size = 360 * (1 - 81 / used)
    waves = 1j * size / (np.pi * np.maximum(ORDERS, 1)) * np.exp(-1j * np.deg2rad(start_deg) * ORDERS)
    return replace(data, values=data.values + np.where(ORDERS == 0, size / 2, waves))


def misread(data, error_deg, often=1):
    """The same curves where an angle theta is read as theta + error_deg * cos(often * theta + 0.4), by samples."""
    read = 2 * np.pi * np.arange(4096) / 4096
    true = read
    for _ in range(50):
        true = read - np.deg2rad(error_deg) * np.cos(often * true + 0.4)
    curves = (data.values @ np.exp(1j * np.outer(data.orders, true))).real
    seen = np.fft.rfft(curves, axis=1)[:, ORDERS] * np.where(ORDERS == 0, 1, 2) / 4096
    return replace(data, values=seen)


def of_the_fast_shaft(data, share=1.0):
    """The same curves over an angle that lacks a share of TE itself, by samples: with all of it the other shaft's."""
    seen = np.empty(data.values.shape, np.complex128)
    for row, own in enumerate(data.values):
        true = read = 2 * np.pi * np.arange(1024) / 1024
        for _ in range(4):
            te = (own @ np.exp(1j * np.outer(data.orders, true))).real
            true = read + share * np.deg2rad(te)
        seen[row] = np.fft.rfft(te)[data.orders] * np.where(data.orders == 0, 1, 2) / 1024
    return replace(data, values=seen)


def wound_up(data, degrees):
    """The same curves over an angle that the load winds up, by so much at the largest."""
    load = data.at.sign * data.at.torque_Nm / data.at.torque_Nm.max()
    return replace(data, values=data.values * np.exp(1j * np.radians(degrees) * load[:, None] * ORDERS))


def torques(data, factor=1.0, offset=0.0):
    return replace(data, at=replace(data.at, torque_Nm=factor * data.at.torque_Nm + offset))


def lagging(data, size):
    """A torque sensor with hysteresis: what it reads is off by where the torque came from, from run to run."""
    torque = data.at.torque_Nm[:RUNS]
    came = np.sign(np.diff(torque, prepend=900.0))
    return replace(data, at=replace(data.at, torque_Nm=data.at.torque_Nm - size * of_runs(came)[:, 0]))


def saturating(data, most):
    return replace(data, at=replace(data.at, torque_Nm=np.minimum(data.at.torque_Nm, most)))


def rubbing(data, share):
    """A torque sensor with friction of its own: it reads too little forward and too much backward."""
    true = replace(data.at, torque_Nm=data.at.torque_Nm * (1 + share * data.at.sign))
    more = RIG.coefficients(true, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist())
    return replace(data, values=data.values + more)


def braked(data, torque_Nm):
    """Friction between a torque sensor and the gear: it reads too little forward, too much backward, at all loads."""
    return replace(data, at=replace(data.at, torque_Nm=data.at.torque_Nm - torque_Nm * data.at.sign))


def smoothed(data, degrees):
    """The same curves, each value the mean of 501 over so many degrees around it."""
    steps = np.radians(degrees) * np.linspace(-0.5, 0.5, 501)
    return replace(data, values=data.values * np.exp(1j * np.outer(steps, data.orders)).mean(axis=0))


def through(data, hertz):
    """What a low pass of first order makes of the curves."""
    frequency = data.orders * (data.at.sign * data.at.speed_rpm / 60 / 81)[:, None]
    return replace(data, values=data.values / (1 + 1j * frequency / hertz))


def led(data, hertz):
    """What a lead filter makes of the curves: all is larger and earlier from one frequency on, to three times that."""
    f = data.orders * (data.at.sign * data.at.speed_rpm / 60 / 81)[:, None] / hertz
    return replace(data, values=data.values * (1 + 1j * f) / (1 + 1j * f / 3))


def over_the_angle(data, order, power):
    """What a filter over the angle, forward and back again, leaves of curves; with power 1 one that makes them late."""
    if power == 1:
        return replace(data, values=data.values / (1 + 1j * data.at.sign[:, None] * data.orders / order))
    return replace(data, values=data.values / (1 + (data.orders / order) ** power))


MADE = {
    "home_offset": lambda data: turned(data, 17.2),
    "sign": lambda data: data.scaled(-1.0),
    "direction": exchanged,
    "column_scale": lambda data: column(data, 0.8),
    "ratio": lambda data: ramp(data, 82),
    "ratio from 130": lambda data: ramp(data, 81.01, 130.0),
    "shaft": of_the_fast_shaft,
    "axis": lambda data: misread(data, 0.3),
    "axis twice a turn": lambda data: misread(data, 0.3, 2),
    "torque 0.95 times": lambda data: torques(data, factor=0.95),
    "torque 9.81 times": lambda data: torques(data, factor=9.81),
    "torque by 40 N m": lambda data: torques(data, offset=40.0),
    "torque by amounts that differ from run to run": lambda data: lagging(data, 18.0),
    "torque by amounts that differ from run to run, up to 600 N m": lambda data: saturating(data, 1200.0),
    "torque forward by another than backward, as where friction": lambda data: rubbing(data, 0.015),
    "torque forward by another than backward": lambda data: braked(data, 6.0),
    "low_pass of 60": lambda data: through(data, 60.0),
    "smoothing over 1": lambda data: smoothed(data, 1.0),
    "filter": lambda data: led(data, 20.0),
    "smoothing or --accept as_is if all these parts of the machine are of another size": lambda data: over_the_angle(
        data, 150.0, 8
    ),
    "smoothing at all speeds alike": lambda data: over_the_angle(data, 70.0, 1),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", MADE)
def test_a_mistake_is_asked_about_and_corrected(name):
    made, (name, *how) = MADE[name](measured(3e-6)), name.split(maxsplit=1)
    with pytest.raises(InputError, match=f"--accept {name}") as asked:
        examine(made, RIG, PATH)
    assert "problems" not in str(asked.value), "one mistake is one question"
    assert all(word in str(asked.value) for word in how)
    examined = examine(made, RIG, PATH, accept=[name])
    assert [mistake.name for mistake in examined.mistakes] == [name]
    # half a step of the grid of angles at order 240 is 0.1 deg of home
    told = True if examined.data.seen is None else examined.data.seen
    left, wrong = (
        (np.abs(one.values - RIG.coefficients(one.at, ORDERS.tolist())) * told).mean(axis=0)
        for one in (examined.data, made)
    )
    assert left.sum() < 0.3 * wrong.sum()


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [3e-6, 3e-7, 3e-9])
def test_torques_of_each_direction_have_their_size_beside_an_effect_that_is_missing(sigma):
    """A compliance that the rig lacks pulled the mean: in clean data torques were 23 N m off, too."""
    rig = replace(RIG, effects=tuple(one for one in RIG.effects if one.name != "torsional_compliance"))
    (found,) = sensors.wrong_torques(rubbing(measured(sigma), 0.06), rig)
    sizes = re.search(r"by (\S+) N m and (\S+) % forward, (\S+) N m and (\S+) % backward", found.text)
    assert sizes, found.text
    assert np.array(sizes.groups(), float) == pytest.approx([0.0, -6.0, 0.0, 6.0], abs=0.3)


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [3e-7, 3e-9])
def test_torques_of_each_run_have_their_size_beside_an_effect_that_is_missing(sigma):
    """They were off by thousands of N m where the mean, of which the rig lacks a compliance, hardly knew the load."""
    rig = replace(RIG, effects=tuple(one for one in RIG.effects if one.name != "torsional_compliance"))
    true = measured(sigma)
    data = lagging(true, 18.0)
    (found,) = sensors.wrong_torques(data, rig)
    # every seventh run has the torque of the one before
    assert re.search("up to 1[89] N m and 17 N m RMS", found.text), found.text
    assert np.abs(found.corrected(data).at.torque_Nm - true.at.torque_Nm).max() < 2.0


def over_a_grid(speeds, torques, least_Nm=-1500.0, orders=ORDERS):
    """A table in the order of its speeds and torques, of curves over the angle of the fast shaft."""
    points = np.meshgrid(np.linspace(100, 1700, speeds), np.linspace(least_Nm, 1500, torques), [30.0], indexing="ij")
    count, random = speeds * torques, np.random.default_rng(1)
    at = Conditions.of(np.repeat([1.0, -1.0], count), *(np.tile(axis.ravel(), 2) for axis in points))
    values = RIG.coefficients(at, orders.tolist())
    noise = 3e-6 * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    values = values + np.where(orders == 0, noise.real, noise)
    return of_the_fast_shaft(Observations(at, labels(at), orders, values, spectral_deg=np.full(values.shape, 3e-6)))


@pytest.mark.thorough
@pytest.mark.parametrize("least_Nm", [-1500.0, 0.0])
@pytest.mark.parametrize("grid", [(20, 6), (25, 10), (50, 10)])
def test_the_other_shaft_is_told_from_runs_that_are_in_step_with_their_torques(grid, least_Nm):
    """Of every fifth run of ten torques there are two, which a shaft that is wound up would explain."""
    assert [mistake.name for mistake in other_shaft(over_a_grid(*grid, least_Nm), RIG)] == ["shaft"]


@pytest.mark.thorough
def test_the_other_shaft_has_no_size_where_the_mean_was_not_looked_at():
    """It was turned by up to 0 deg."""
    whole, waves = (other_shaft(over_a_grid(20, 6, orders=orders), RIG) for orders in (ORDERS, ORDERS[ORDERS > 0]))
    assert "by what TE is at its run, up to 0.08 deg, and within" in whole[0].text
    assert all("by what TE is at its run, and within" in mistake.text for mistake in waves)
    turned = replace(over_a_grid(20, 6), values=over_a_grid(20, 6).values * (ORDERS > 0))
    assert all("by what TE is at its run, and within" in mistake.text for mistake in other_shaft(turned, RIG))


def test_hundreds_of_orders_over_the_angle_of_the_output_are_those_of_the_sum_over_samples():
    """A row took 30 to 50 ms."""
    random, orders = np.random.default_rng(0), np.arange(401)
    values = 1e-3 * (random.standard_normal((100, 401)) + 1j * random.standard_normal((100, 401)))
    values[:, 0] = values[:, 0].real
    at = Conditions.of(np.ones(100), np.full(100, 1000.0), np.full(100, 100.0), np.full(100, 30.0))
    began = time.process_time()
    found = over_the_output(Observations(at, labels(at), orders, values)).values
    assert time.process_time() - began < 1.0
    theta = np.arange(1024) * (2 * np.pi / 1024)
    for row in (0, 99):
        te, slope = (
            (part @ np.exp(1j * np.outer(orders, theta))).real for part in (values[row], 1j * orders * values[row])
        )
        direct = np.exp(-1j * np.outer(orders, theta + np.radians(te))) @ (te * (1 + np.radians(slope))) / 512
        direct[0] /= 2
        assert np.abs(found[row] - direct).max() < 1e-15, "to the last bits"


def test_the_rows_that_tell_are_in_step_with_no_grid():
    assert rows_that_tell(70).tolist() == [*range(70)]
    for count in (240, 500, 1000):
        some = rows_that_tell(count)
        assert len(some) == 100 and (np.diff(some) > 0).all() and (some == rows_that_tell(count)).all()
        assert all(len(np.unique(some % level)) == level for level in range(2, 11))


@pytest.mark.thorough
@pytest.mark.parametrize("share", [-1.0, 0.5, 1.5])
def test_an_angle_that_is_off_by_another_part_of_te_is_not_the_other_shafts(share):
    examined = examine(of_the_fast_shaft(measured(3e-6), share), RIG, PATH, accept=["all"])
    assert "shaft" not in [mistake.name for mistake in examined.mistakes]


@pytest.mark.thorough
@pytest.mark.parametrize("degrees", [-0.08, -0.065, 0.065, 0.08])
def test_a_shaft_that_the_load_winds_up_as_far_as_the_gear_is_not_the_other_one(degrees):
    examined = examine(wound_up(measured(3e-6), degrees), RIG, PATH, accept=["all"])
    assert "shaft" not in [mistake.name for mistake in examined.mistakes]


def at_a_rate(data, hertz):
    """Curves sampled at a rate in time: fast ones have few samples a turn, and tell a quarter as many orders."""
    seen = ORDERS[None, :] <= hertz * 60 * 81 / data.at.speed_rpm[:, None] / 4
    return replace(data, values=data.values * seen, spectral_deg=3e-6 * seen, seen=seen)


@pytest.mark.parametrize("hertz", [60.0, 200.0])
def test_of_curves_sampled_at_a_rate_nothing_is_asked(hertz):
    """Orders that fast runs do not tell were taken for what a filter had left of them, and for another label."""
    assert examine(at_a_rate(measured(3e-6), hertz), RIG, PATH).mistakes == ()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["home_offset", "sign", "direction", "column_scale", "ratio", "torque 9.81 times"])
def test_of_curves_sampled_at_a_rate_a_mistake_is_asked_about_as_of_others(name):
    with pytest.raises(InputError, match=f"--accept {name.split()[0]}") as asked:
        examine(at_a_rate(MADE[name](measured(3e-6)), 60.0), RIG, PATH)
    assert "problems" not in str(asked.value)


def of_curves(sigma=3e-5):
    """A campaign of curves, each of which tells its noise."""
    data = measured(sigma)
    return replace(data, spectral_deg=np.full(data.values.shape, sigma))


def of_runs(numbers):
    """A number for each run, for both of its rows."""
    return np.tile(numbers, 2)[:, None]


@pytest.mark.thorough
@pytest.mark.parametrize("some", [True, False])
def test_runs_with_a_zero_of_their_own_are_turned_back(some):
    random, data = np.random.default_rng(0), of_curves()
    angle = np.where(np.arange(RUNS) > 150, 25.0, 0.0) if some else random.uniform(1, 359, RUNS)
    made = replace(data, values=data.values * np.exp(-1j * np.radians(of_runs(angle)) * ORDERS))
    with pytest.raises(InputError, match="--accept home_offset") as asked:
        examine(made, RIG, PATH)
    assert f"{59 if some else RUNS} of {RUNS} runs" in str(asked.value)
    back = examine(made, RIG, PATH, accept=["home_offset"]).data
    # beside 0.003 deg of turn, order 240 of 2e-3 deg moves by 3e-5: one noise
    assert np.abs(back.values - data.values).max() < 1e-4


@pytest.mark.parametrize(
    ("name", "reading", "wrong"),
    [
        ("torque", "misread_torque", lambda data: torques(data, 1.12)),
        ("home_offset", "misread_angle", lambda data: turned(data, 17.2)),
        ("ratio", "misread_ratio", lambda data: ramp(data, 81.01)),
        ("column_scale", "misread_te", lambda data: column(data, 1.5)),
        ("direction", "exchanged_directions", exchanged),
    ],
)
def test_who_accepted_a_reading_is_not_asked_for_the_same_mistake_by_another_name(name, reading, wrong):
    """With the rig that `--accept misread_torque` had written the same command asked for `--accept torque`."""
    with pytest.raises(InputError, match=f"--accept {name}"):
        examine(wrong(measured()), RIG, PATH)
    found = examine(wrong(measured()), RIG, PATH, accept=[reading])
    assert [one.name for one in found.mistakes] == [name] and found.mistakes[0].is_taken_out


def test_who_accepted_one_factor_of_all_torques_is_asked_about_torques_that_are_each_wrong_by_its_own():
    with pytest.raises(InputError, match="--accept torque"):
        examine(lagging(measured(), 150.0), RIG, PATH, accept=["misread_torque"])


@pytest.mark.parametrize("hertz", [0.8, 3.0, 20.0])
def test_the_frequency_of_a_low_pass_is_told_where_it_leaves_a_tenth_of_most_waves(hertz):
    """Six steps from none were not enough: 0.8 Hz were said to be 8.04 Hz."""
    (found,) = low_pass(through(measured(1e-6), hertz), RIG)
    assert float(re.search(r"low pass of (\S+) Hz", found.text)[1]) == pytest.approx(hertz, rel=0.05)


@pytest.mark.parametrize("at_one_speed", [True, False])
def test_a_delay_of_forward_curves_is_no_zero_of_each_run(at_one_speed):
    """It turns order k by k times an angle that goes with the speed; runs that tell less were of another zero."""
    data = of_curves(3e-4)
    data = data.rows(data.at.sign > 0)
    speed = np.full(len(data), 900.0) if at_one_speed else data.at.speed_rpm
    values = data.values + RIG.coefficients(data.under(speed_rpm=speed).at, ORDERS.tolist())
    values -= RIG.coefficients(data.at, ORDERS.tolist())
    late = np.exp(-1j * np.radians(0.35) * (speed / 1900.0)[:, None] * ORDERS)
    found = examine(replace(data.under(speed_rpm=speed), values=values * late), RIG, PATH)
    assert "home_offset" not in {mistake.name for mistake in found.mistakes}


@pytest.mark.thorough
def test_zeros_of_single_runs_are_told_where_noise_hides_most_orders():
    """They were called an eccentricity of another size; what they turn too far to be told is not looked at."""
    data, angle = of_curves(1.5e-3), np.random.default_rng(1).uniform(1, 359, RUNS)
    made = replace(data, values=data.values * np.exp(-1j * np.radians(of_runs(angle)) * ORDERS))
    with pytest.raises(InputError, match=f"{RUNS} of {RUNS} runs .* --accept home_offset"):
        examine(made, RIG, PATH)
    back = examine(made, RIG, PATH, accept=["home_offset"]).data
    assert {1, 3, 39} <= set(back.orders.tolist()) < set(ORDERS.tolist())
    assert "the zeros of the runs are not told well enough" in back.not_looked_at[-1]
    kept = np.isin(ORDERS, back.orders)
    mean, before = (one.values[:RUNS].mean(axis=0) for one in (back, data.rows(slice(None))))
    assert np.abs(mean - before[kept]).max() < 5e-4


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [4e-4, 1e-3])
def test_one_order_with_another_phase_in_each_run_is_no_matter_of_the_zero(sigma):
    """A coupling that was mounted anew before each run turns its own order only."""
    data, angle = of_curves(sigma), np.random.default_rng(1).uniform(1, 359, RUNS)
    turn = np.where(ORDERS == 1, np.exp(-1j * np.radians(of_runs(angle))), 1.0)
    for made in (data, replace(data, values=data.values * turn)):
        assert examine(made, RIG, PATH).mistakes == ()


@pytest.mark.thorough
@pytest.mark.parametrize("start_deg", [0.0, 77.0])
def test_a_drift_within_the_turn_is_taken_out_and_the_mean_is_not_looked_at(start_deg):
    data = of_curves()
    drift = of_runs(np.linspace(0.0, 0.1, RUNS)) * np.exp(-1j * np.deg2rad(start_deg) * ORDERS)
    made = replace(data, values=data.values + np.where(ORDERS == 0, 0, 1j * drift / (np.pi * np.maximum(ORDERS, 1))))
    with pytest.raises(InputError, match="--accept drift") as asked:
        examine(made, RIG, PATH)
    assert "by up to 0.1 deg, by another amount in each run" in str(asked.value)
    turning = 0.1 * data.at.sign[:, None] * np.exp(-1j * np.deg2rad(start_deg) * ORDERS) / np.maximum(ORDERS, 1)
    with pytest.raises(InputError, match="by another amount in each direction"):
        examine(replace(data, values=data.values + np.where(ORDERS == 0, 0, 1j * turning / np.pi)), RIG, PATH)
    examined = examine(made, RIG, PATH, accept=["drift"]).data
    assert examined.orders.tolist() == ORDERS[1:].tolist()
    assert "the mean" in examined.not_looked_at[-1]
    assert np.abs(examined.values - data.values[:, 1:]).max() < 3e-4


def test_a_drift_is_told_from_a_random_walk_where_there_is_noise_as_well():
    """Of a walk a ramp is half of each order; noise stays in each of them and says nothing against ramps."""
    random, orders, samples = np.random.default_rng(2), np.arange(1, 13), 500
    walk = 9e-3 * np.cumsum(random.standard_normal((120, samples)), axis=1) / np.sqrt(samples)
    drift = 0.02 * random.standard_normal((120, 1)) * np.arange(samples) / samples
    noise = np.full((120, 12), 3.3e-7)
    white = np.sqrt(noise / 2) * (random.standard_normal((120, 12)) + 1j * random.standard_normal((120, 12)))
    wandering, both = (2 / samples * np.fft.rfft(te, axis=1)[:, orders] + white for te in (walk, walk + drift))
    assert ramps(both, noise, orders, 0.0).std() == pytest.approx(0.022, rel=0.1)
    assert not ramps(wandering, noise, orders, 0.0).any()


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [12.0, 5.0, 1.4, 0.3])
def test_one_factor_of_all_orders_is_asked_about_whatever_its_size(factor):
    """It was fourteen parts of another size, with errors of a hundredth of a percent, or a filter over the angle."""
    data = measured(1e-5).scaled(factor)
    with pytest.raises(InputError, match=rf"{factor:.3g} times the rig's in nearly all orders alike.*--scale") as asked:
        examine(data, RIG, PATH)
    told = float(re.search(r"--scale ([0-9.]+)\.", str(asked.value))[1])
    assert told * factor == pytest.approx(1.0, abs=0.01)
    assert examine(data, RIG, PATH, scale=1.0).mistakes == ()
    # a unit that is told wrong leaves a factor
    with pytest.raises(InputError, match=r"with --scale 2 the measured TE is .* times the rig's in nearly all orders"):
        examine(data, RIG, PATH, scale=2.0)


@pytest.mark.parametrize("factor", [0.9, 1.15])
def test_a_smaller_factor_of_all_orders_is_no_filter(factor):
    assert all(mistake.name != "smoothing" for mistake in examine(measured(1e-5).scaled(factor), RIG, PATH).mistakes)


def test_a_machine_whose_parts_are_all_of_another_size_is_no_unit():
    sizes = np.exp(np.random.default_rng(3).normal(0.7, 0.4, len(ORDERS)))
    data = measured(1e-5)
    data = replace(data, values=data.values * sizes)
    assert all(mistake.name != "unit" for mistake in examine(data, RIG, PATH, accept=("as_is",)).mistakes)


@pytest.mark.parametrize(
    ("factor", "word"),
    [
        (60.0, "arcmin"),
        (3600.0, "arcsec"),
        (np.pi / 180, "in rad"),
        (1e3, "in mdeg"),
        (1e6 * np.pi / 180, "in urad"),
    ],
)
def test_units_are_asked_about_with_the_factor_that_undoes_them(factor, word):
    with pytest.raises(InputError, match=word) as asked:
        examine(measured().scaled(factor), RIG, PATH)
    assert f"--scale {1 / factor:.8g}" in str(asked.value)


@pytest.mark.parametrize(
    "made",
    [
        lambda off: of_runs(off) * np.where(ORDERS == 0, 1e-3, 0),
        lambda off: of_runs(np.sign(off)) * np.where(np.isin(ORDERS, [0, 39, 78]), 1e-3, 0),
    ],
)
def test_orders_that_differ_from_run_to_run_for_another_reason_are_no_torque(made):
    """The others do not say of a run what they would if its torque were read wrong."""
    data, off = measured(3e-6), np.random.default_rng(4).standard_normal(RUNS)
    softer = replace(data, values=data.values + made(off) - np.where(ORDERS == 0, 2e-6, 0) * data.at.torque_Nm[:, None])
    assert all(mistake.name != "torque" for mistake in examine(softer, RIG, PATH).mistakes)


@pytest.mark.parametrize("made", [lambda data: lagging(data, 25.0), lambda data: rubbing(data, 0.02)])
def test_torques_of_the_runs_are_told_where_noise_hides_them_in_most_orders(made):
    """Hysteresis was called a changed growth of one order with the load, and a shift of the encoders' zero."""
    with pytest.raises(InputError, match=r"torques (of the runs )?seem to be read wrong.* --accept torque"):
        examine(made(of_curves(2e-5)), RIG, PATH)


def test_a_part_of_the_runs_with_a_factor_of_its_own_has_no_other_torques():
    """All orders are larger there, whether they depend on the load or not."""
    data = of_curves(2e-5)
    late = of_runs(np.arange(RUNS) > RUNS // 2)
    made = replace(data, values=data.values * np.where(late, 1.12, 1.0))
    assert all(mistake.name != "torque" for mistake in examine(made, RIG, PATH).mistakes)


def test_a_delay_is_no_low_pass():
    """It makes every order later and none smaller: an effect of the catalogue."""
    data = measured(3e-6)
    late = data.orders * (data.at.sign * data.at.speed_rpm / 60 / 81)[:, None] * 2e-3
    assert examine(replace(data, values=data.values * np.exp(-2j * np.pi * late)), RIG, PATH).mistakes == ()


def test_a_resonance_of_three_orders_is_no_filter():
    data = measured(3e-6)
    f = data.orders * (data.at.speed_rpm / 60 / 81)[:, None] / 30.0
    lifted = 2e-3 * np.isin(data.orders, (156, 162, 240)) * (0.1j * f / (1 - f**2 + 0.1j * f))
    made = replace(data, values=data.values + np.where(data.at.sign[:, None] > 0, lifted, lifted.conj()))
    assert examine(made, RIG, PATH).mistakes == ()


@pytest.mark.parametrize("other", [1e9, 42.5])
def test_a_load_behind_a_spring_is_no_filter(other):
    """It lifts all orders by their frequency alone; a rig that has it at another one left what a filter leaves."""
    data = measured(3e-6)
    f, side = data.orders * (data.at.speed_rpm / 60 / 81)[:, None], np.where(data.at.sign > 0, 1j, -1j)[:, None]

    def lifted(hertz):
        return 1 + (f / hertz) ** 2 / (1 - (f / hertz) ** 2 + 0.06 * side * f / hertz)

    lifts = replace(data, values=data.values * lifted(50.0) / lifted(other))
    assert examine(lifts, RIG, PATH).mistakes == ()


def test_an_order_of_zeros_alone_has_no_vote():
    """What it would gain was no number: a load behind a spring was a filter beside it, against whatever was tried."""
    data, order = measured(3e-6), 7
    assert order not in data.orders
    orders = np.append(data.orders, order)
    f, side = orders * (data.at.speed_rpm / 60 / 81)[:, None] / 50.0, np.where(data.at.sign > 0, 1j, -1j)[:, None]
    values = np.append(data.values, np.zeros((len(data), 1)), axis=1) * (1 + f**2 / (1 - f**2 + 0.06 * side * f))
    kept = np.argsort(orders)
    lifts = Observations(data.at, data.labels, orders[kept], values[:, kept])
    assert sensors.any_filter(lifts, RIG) == []


def test_two_mistakes_at_once_are_two_questions():
    for made, words in (
        (turned(measured().scaled(-1.0), -33.0), ("home_offset", "sign")),
        (exchanged(measured()).scaled(3600.0), ("direction", "arcsec")),
    ):
        with pytest.raises(InputError, match="2 problems") as asked:
            examine(made, RIG, PATH)
        assert all(word in str(asked.value) for word in words)


@pytest.mark.thorough
def test_a_ramp_is_told_by_the_orders_that_stand_above_the_noise():
    """In noise only the lowest orders show it; a missing wave beside it has another phase."""
    sigma = 3e-4
    data = replace(measured(sigma), spectral_deg=np.full((2 * RUNS, len(ORDERS)), sigma))
    missing = replace(data, values=data.values + np.where(ORDERS == 39, 2e-3, 0.0))
    examine(missing, RIG, PATH)
    with pytest.raises(InputError, match="--accept ratio") as asked:
        examine(ramp(missing, 81.005), RIG, PATH)
    assert "rises by 0.0222 deg" in str(asked.value)


def wandering(values, orders, sigma, knee, seed):
    """Values in noise that grows from order `knee` down, as where TE wanders within a turn."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape)
    return values + np.where(orders > 0, sigma * np.hypot(1, knee / np.maximum(orders, 1)) * noise, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_that_begins_at_some_angle_is_told_by_all_orders_together(seed):
    """Noise hid it in most orders: its jump was called a damaged tooth at that angle, and the rest another zero."""
    sigma, orders, at = 5e-4, np.arange(251), measured(seed=seed).rows(slice(None, None, 5)).at
    jump = -0.015 * 1j / (np.pi * np.maximum(orders, 1)) * np.exp(-1j * np.deg2rad(213) * orders)
    known = RIG.coefficients(at, orders.tolist())
    spectral = np.full(known.shape, sigma)
    for size in (0.0, 1.0):
        values = wandering(known + size * np.where(orders > 0, jump, -0.0075), orders, sigma, 12.0, seed)
        asked = size and pytest.raises(InputError, match=r"from 21[23]\.\d deg on at every run.*--accept ratio")
        with asked or contextlib.nullcontext():
            examine(Observations(at, labels(at), orders, values, spectral_deg=spectral), RIG, PATH)


def test_a_wander_within_the_turn_is_no_factor_on_a_column():
    """Of a ramp that it hides the lowest orders, which differ by more than the noise between orders, made a factor."""
    data = ramp(measured(2e-3, 1).rows(slice(None, None, 5)), 81.0045, 213.0)
    random = np.random.default_rng(1)
    walk = random.standard_normal(data.values.shape) + 1j * random.standard_normal(data.values.shape)
    values = data.values + np.where(ORDERS > 0, 0.02 / np.maximum(ORDERS, 1) * walk, 0.0)
    assert examine(replace(data, values=values, spectral_deg=np.full(values.shape, 2e-3)), RIG, PATH).mistakes == ()


LOUD = [("home_offset", 1e-3), ("direction", 1e-3), ("column_scale", 2e-4), ("home_offset", 5e-3), ("direction", 5e-3)]
LOUD += [("column_scale", 2e-3)]


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "sigma"), LOUD)
def test_orders_that_are_noise_have_no_vote(name, sigma):
    """In loud noise the largest orders tell a mistake, and in the loudest all together: no order outvotes another."""
    data = measured(sigma)
    data = replace(data, spectral_deg=np.full(data.values.shape, sigma))
    with pytest.raises(InputError, match=f"--accept {name}") as asked:
        examine(MADE[name](data), RIG, PATH)
    assert "problems" not in str(asked.value), "one mistake is one question"


@pytest.mark.parametrize("seed", range(3))
def test_ramps_that_differ_from_run_to_run_are_no_other_ratio(seed):
    """TE that wanders within the turn: the mean of the runs is off by more than the noise between orders."""
    data = replace(measured(3e-4), spectral_deg=np.full((2 * RUNS, len(ORDERS)), 3e-4))
    slope = 0.3 * np.random.default_rng(seed).standard_normal((2 * RUNS, 1))
    wander = np.where(ORDERS > 0, 1j * slope / (np.pi * np.maximum(ORDERS, 1)), 0.0)
    with pytest.raises(InputError, match="--accept drift") as asked:
        examine(replace(data, values=data.values + wander), RIG, PATH)
    assert "ratio" not in str(asked.value)


def test_where_few_orders_tell_mistakes_are_said_not_to_be_told():
    data = measured()
    assert examine(data, RIG, PATH).untold == ()
    (said,) = examine(replace(data, orders=ORDERS[:2], values=data.values[:, :2]), RIG, PATH).untold
    assert "exchanged directions" in said and "a factor on one column" in said and "RMS" in said


@pytest.mark.thorough
def test_where_few_orders_of_one_direction_tell_conventions_are_said_not_to_be_told():
    data = measured()
    forward = data.rows(data.at.sign > 0)
    assert not any("RMS" in text for text in examine(forward, RIG, PATH).untold)
    few = replace(forward, orders=ORDERS[:2], values=forward.values[:, :2])
    assert sum("RMS" in text for text in examine(few, RIG, PATH).untold) == 1


@pytest.mark.thorough
def test_where_noise_hides_a_misread_angle_that_is_said():
    """With ten times the noise, the sidebands of an angle that is off by ten times as much; in little it is silent."""
    assert examine(of_curves(1e-5), RIG, PATH).untold == ()
    for noise, how_much in ((3e-3, " once a turn may not show, by whatever size"), (1e-4, " by up to about ")):
        said = examine(of_curves(noise), RIG, PATH).untold
        assert f"an angle that is read wrong{how_much}" in said[-1]


def test_the_sidebands_of_a_misread_angle_are_half_the_order_times_the_angle_of_its_wave():
    wave = KNOWN["pin_error"]({"order": 40, "amplitude_deg": 1e-3}, RIG.constants)
    data = measured()
    data = replace(data, orders=np.array([40]), values=data.values[:, :1], spectral_deg=np.full((2 * RUNS, 1), 1e-3))
    least = np.sqrt(2.0 * told_power(noise_power(data)[:RUNS])[0])
    (said,) = hidden_wrong_angle(data, RIG.with_effects([wave]))
    degrees = float(re.search(r"by up to about (\S+) deg once a turn", said)[1])
    assert degrees == pytest.approx(np.degrees(least / (1e-3 * 40 / 2)), rel=0.05)  # two digits are said


def test_a_misread_angle_must_show_beside_the_order_that_has_the_largest_sidebands():
    """They may be those of a crack and are not counted: what was said to hide was up to half of what did."""
    sizes = {40: 1e-2, 80: 1e-4, 120: 1e-4, 240: 1e-4}
    waves = [KNOWN["pin_error"]({"order": k, "amplitude_deg": size}, RIG.constants) for k, size in sizes.items()]
    data = measured()
    data = replace(data, orders=np.array([*sizes]), values=data.values[:, : len(sizes)])
    data = replace(data, spectral_deg=np.full(data.values.shape, 3e-6))
    (said,) = hidden_wrong_angle(data, RIG.with_effects(waves))
    # of eight sidebands four are those of order 240 in each direction, and four those of the next
    least = np.sqrt(2.0 * told_power(noise_power(data)[:RUNS])[0]) / (1e-4 * 120 / 2)
    degrees = float(re.search(r"by up to about (\S+) deg once a turn", said)[1])
    assert degrees == pytest.approx(np.degrees(least), rel=0.05)  # two digits are said


@pytest.mark.thorough
@pytest.mark.parametrize("gone", sorted({effect.name for effect in RIG.effects}))
@pytest.mark.parametrize("sigma", [3e-5, 3e-4, 5e-3])
def test_a_missing_effect_is_no_mistake_of_measuring(gone, sigma):
    rig = RIG.with_effects(effect for effect in RIG.effects if effect.name != gone)
    assert examine(measured(sigma), rig, PATH).mistakes == ()


def test_a_missing_effect_does_not_hide_a_mistake():
    rig = RIG.with_effects(effect for effect in RIG.effects if effect.name != "torsional_compliance")
    with pytest.raises(InputError, match="--accept direction"):
        examine(exchanged(measured()), rig, PATH)


@pytest.mark.parametrize("mistake", ["column", "sign", "home", "homes of runs", "axis", "low pass", "mean"])
def test_what_two_orders_do_not_show_is_not_said_of_all(mistake):
    """It was "in all orders", or of "every order", where two were as the rig has them."""
    data = measured()
    hertz = np.outer(data.at.sign * data.at.speed_rpm / 60.0 / 81.0, ORDERS)
    wrong = {
        "column": column(data, 1.5),
        "axis": misread(data, 0.4),
        "low pass": replace(data, values=data.values / (1 + 1j * hertz / 60.0)),
        "mean": replace(data, values=data.values * np.sinc(ORDERS * 2.0 / 360.0)),
        "sign": replace(data, values=-data.values),
        "home": turned(data, 1.15),
        "homes of runs": replace(
            data, values=np.where((data.number_of_run % 9 == 0)[:, None], turned(data, 2.9).values, data.values)
        ),
    }[mistake]
    values = wrong.values.copy()
    values[:, -2:] = data.values[:, -2:]
    with pytest.raises(InputError) as asked:
        examine(replace(data, values=values), RIG, PATH)
    said = str(asked.value)
    assert not any(
        text in said for text in ("in all orders", "every order k is", "every order is", "every order k has")
    )
    by_votes = mistake in ("column", "axis", "low pass", "mean")
    assert ("most orders" if by_votes else "all orders together come nearer to the rig") in said


def test_torques_of_some_runs_are_not_said_to_be_wrong_in_all():
    """Where two in five were right it said that they were wrong, "each by its own"."""
    data, random = measured(), np.random.default_rng(3)
    off = np.where(random.random(RUNS) < 0.6, random.normal(0.0, 80.0, RUNS), 0.0)[data.number_of_run]
    read = replace(data, at=replace(data.at, torque_Nm=np.maximum(data.at.torque_Nm + off, 0.0)))
    with pytest.raises(InputError, match="torques seem to be read wrong by amounts that differ from run to run"):
        examine(read, RIG, PATH)


def test_other_curves_are_spoken_of_where_there_are_some():
    """A hum in 4 of 4 curves was "weaker in others"."""
    said = [Hum(50.0, 1e-3, (seen, 4), np.zeros(5)).text for seen in (3, 4)]
    assert ["in others it is weaker" in text for text in said] == [True, False]


def test_a_factor_on_one_column_is_seen_beside_wrong_labels():
    """Runs under other labels leave a gap in all orders that no factor closes; the factor is the same for all that."""
    random = np.random.default_rng(1)
    data = column(measured(sigma=1e-4), 1.22)
    wrong = random.choice(RUNS, RUNS // 12, replace=False)
    values = data.values.copy()
    for side in (0, RUNS):
        values[wrong + side] = data.values[np.roll(wrong, 1) + side]
    with pytest.raises(InputError, match=r"column is 1.22 times .*--accept column_scale"):
        examine(replace(data, values=values), RIG, PATH)


@pytest.mark.parametrize("seed", range(4))
def test_a_factor_on_a_column_is_as_sure_as_its_orders_tell_it(seed):
    """One vote an order, it was off by up to a hundredth in noise, and the loudest order of the rig had changed."""
    sigma = 1e-4
    data = column(measured(sigma, seed), 1.25)
    # an order that is larger by an effect, however well its noise tells it, says nothing of it
    loudest = ORDERS[1:][np.abs(RIG.coefficients(data.at, ORDERS[1:].tolist())).mean(axis=0).argmax()] == ORDERS
    for changed in (1.0, 1.2):
        wrong = replace(data, values=data.values * np.where(loudest & (data.at.sign > 0)[:, None], changed, 1.0))
        found = examine(wrong, RIG, PATH, accept=["column_scale"]).data
        factor = np.median((wrong.values / found.values)[data.at.sign > 0].real)
        size = np.abs(RIG.coefficients(data.at, ORDERS[~loudest].tolist())).mean(axis=0)[1:]
        told = np.abs(RIG.coefficients(data.at, ORDERS[loudest].tolist())).mean() if changed == 1.0 else size.max()
        assert factor == pytest.approx(1.25, abs=4 * 1.25 * sigma / told / np.sqrt(RUNS))


@pytest.mark.filterwarnings("error")  # their zero is told by nothing
@pytest.mark.parametrize("seed", range(3))
def test_runs_in_which_the_rig_says_nothing_take_no_vote_from_orders_on_a_factor(seed):
    """Of orders that follow the load those without any made all errors endless: an order with an effect counted too."""
    orders, slopes = np.array([39, 40, 78, 81, 120, 156, 162, 240]), [3e-3, 2e-3, 4e-3, 2e-3, 3e-3, 3e-3, 2e-3, 2e-3]
    rig = RIG.with_effects(
        effect("load_dependent_mesh", order=order, slope_deg_per_kNm=slope)
        for order, slope in zip(orders.tolist(), slopes, strict=True)
    )
    data, sigma, random = measured(), 1e-4, np.random.default_rng(seed)
    known = rig.coefficients(data.at, orders.tolist())
    noise = sigma * (random.standard_normal(known.shape) + 1j * random.standard_normal(known.shape))
    forward, own = (data.at.sign > 0)[:, None], orders == 78
    values = known * np.where(forward & own, 1.2, 1.0) + noise
    wrong = column(replace(data, orders=orders, values=values), 1.25)
    found = examine(wrong, rig, PATH, accept=["column_scale"]).data
    factor = np.median((wrong.values / found.values)[data.at.sign > 0].real)
    error = 1.25 * sigma * np.sqrt(2.0 / (np.abs(known[data.at.sign > 0][:, ~own]) ** 2).sum())
    assert factor == pytest.approx(1.25, abs=4 * error)


def test_an_effect_of_one_direction_is_no_factor_on_its_column():
    data = measured(sigma=1e-4)
    own = np.isin(ORDERS, [39, 78, 156]) & (data.at.sign > 0)[:, None]
    assert examine(replace(data, values=data.values * np.where(own, 1.5, 1.0)), RIG, PATH).mistakes == ()


def test_a_dent_is_no_ramp_and_no_misread_angle():
    """Rolled into slowly and left fast at 266 deg: all orders have one phase there; few orders told it from neither."""
    sigma = 4.5e-6
    data = of_curves(sigma).rows(slice(None, None, 4))
    orders = np.arange(251)
    theta = np.mod(np.arange(4000) * 0.09 - 266.0 + 180, 360) - 180
    x = np.clip(np.where(theta < 0, theta / 6.7, theta / 2.9), -1, 1)
    dent = np.fft.rfft(-4e-3 * (0.5 + 0.5 * np.cos(np.pi * x)))[orders] / 2000
    values = RIG.coefficients(data.at, orders.tolist()) + np.where(orders == 0, dent.real / 2, dent)
    noise = sigma * np.random.default_rng(0).standard_normal((2, *values.shape))
    made = replace(data, orders=orders, values=values + np.where(orders == 0, noise[0], noise[0] + 1j * noise[1]),
                   spectral_deg=np.full(values.shape, sigma))  # fmt: skip
    assert examine(made, RIG, PATH).mistakes == ()


@pytest.mark.thorough
@pytest.mark.parametrize("on", [(78, 162), tuple(int(k) for k in ORDERS if k > 30)])
@pytest.mark.parametrize("sigma", [1e-5, 3e-4])
def test_sizes_that_are_modulated_once_a_turn_are_no_misread_angle(on, sigma):
    """Sidebands of +-1 on two orders or on all, of another form than those of an angle that is read wrong."""
    data = of_curves(sigma)
    orders = np.unique(np.concatenate([ORDERS, np.array(on) - 1, np.array(on) + 1]))
    values = RIG.coefficients(data.at, orders.tolist())
    own = values.copy()
    for k, side in itertools.product(on, (-1, 1)):
        part = 0.2 * np.exp((0.5 + 0.2 * k) * 1j * side) * own[:, list(orders).index(k)]
        values[:, list(orders).index(k + side)] += part
    noise = sigma * np.random.default_rng(3).standard_normal((2, *values.shape))
    values = values + np.where(orders == 0, noise[0], noise[0] + 1j * noise[1])
    made = replace(data, orders=orders, values=values, spectral_deg=np.full(values.shape, sigma))
    assert examine(made, RIG, PATH).mistakes == ()


def a_little_wrong(rig, random):
    """The rig with each of its numbers but phases off by up to a tenth."""
    effects = []
    for one in rig.effects:
        numbers = {key: value for key, value in one.values.items() if isinstance(value, float) and "phase" not in key}
        factors = {key: value * random.uniform(0.9, 1.1) for key, value in numbers.items()}
        effects.append(one.with_values(dict(one.values) | factors))
    return rig.with_effects(effects)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [6, 11, 35, 45, 85, 98])
def test_a_rig_whose_numbers_are_all_a_little_wrong_makes_no_mistake_of_measuring(seed):
    """The frequency of its resonance as well: columns with factors of 0.4 and 1e-12, runs with zeros of their own."""
    wrong = a_little_wrong(RIG, np.random.default_rng(seed))
    assert examine(of_curves(1e-5 if seed % 2 else 1e-6), wrong, PATH).mistakes == ()


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [5, 13, 17, 26, 35, 37])
def test_a_machine_whose_rig_is_a_little_wrong_makes_no_mistake_of_measuring(seed, tmp_path):
    """Of 60 such machines seven were asked about torques, zeros of the angle, or a factor on one column."""
    random, data = np.random.default_rng(seed), of_curves(4.5e-6)
    (tmp_path / "rig.toml").write_text(draw_machine(random, small=False).text())
    rig = read_rig(tmp_path / "rig.toml", KNOWN)
    orders = np.array(rig.orders())
    values = rig.coefficients(data.at, orders.tolist())
    noise = 4.5e-6 * random.standard_normal((2, *values.shape))
    values = values + np.where(orders == 0, noise[0], noise[0] + 1j * noise[1])
    made = replace(data, orders=orders, values=values, spectral_deg=np.full(values.shape, 4.5e-6))
    assert examine(made, a_little_wrong(rig, random), PATH).mistakes == ()


def test_sidebands_of_one_order_are_no_misread_angle(monkeypatch):
    """A crack changes one mesh order over a part of the turn, and noise hides all others: the angle was asked about.

    Here the noise lets expect sidebands of others; where it is louder none are.
    """
    monkeypatch.setattr(sensors, "_sidebands_show", lambda *_: True)
    orders, at = np.union1d(ORDERS, np.arange(70, 91)), measured().at
    values = RIG.coefficients(at, orders.tolist())
    theta = np.deg2rad(np.arange(0, 360, 0.25))
    there = np.exp(-0.5 * ((np.rad2deg(theta) - 173.0) / 8.0) ** 2)
    crack = (values[:, orders == 78] * np.exp(1j * (78 * theta + 1.5))).real * there
    values += np.fft.rfft(crack, axis=1)[:, orders] * np.where(orders == 0, 1, 2) / len(theta)
    random, sigma = np.random.default_rng(0), 6e-5
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    noise = np.where(orders == 0, noise.real, noise)
    made = Observations(at, labels(at), orders, values + noise, spectral_deg=np.full(values.shape, sigma))
    assert examine(made, RIG, PATH).mistakes == ()


def humming(waves, start_deg=7.0, samples=400, sigma=1e-5, more=0):
    """Sums of 20 curves of 100 orders at as many speeds (turns a second), without and with waves of (Hz, deg).

    Each holds a turn and `more` samples.
    """
    random, turns = np.random.default_rng(8), np.linspace(0.05, 0.35, 20) + 0.0013
    phi = 2 * np.pi * np.arange(samples + more) / samples
    clean, made = [], []
    for turn in turns:
        theta = phi + np.deg2rad(start_deg)
        te = 0.05 + 2e-3 * np.cos(theta) + 1e-3 * np.cos(40 * theta + 0.3)
        te += sigma * random.standard_normal(samples + more)
        hum = sum(deg * np.cos(hertz / turn * phi + random.uniform(0, 6)) for hertz, deg in waves)
        clean.append(curve_sums(Curve(np.rad2deg(theta), te), 100))
        made.append(curve_sums(Curve(np.rad2deg(theta), te + hum), 100))
    return turns, clean, made


@pytest.mark.parametrize(
    ("waves", "sigma", "more"),
    [
        ([(8.0, 1e-3)], 1e-5, 0),
        ([(8.0, 1e-3), (23.7, 5e-4)], 1e-5, 0),
        ([(150.0, 1e-3)], 1e-5, 0),
        ([(8.0, 1e-3)], 1e-8, 0),
        ([(8.0, 1e-3)], 1e-5, 4),
        ([(8.0, 1e-3), (150.0, 5e-4)], 1e-5, 120),
    ],
)
def test_a_hum_is_taken_out_of_all_curves(waves, sigma, more):
    """One of 150 Hz is above half the samples of a turn at each speed and shows mirrored.

    Where there is hardly any noise a hum is louder than that in all orders around its own. Of curves that end 1 %
    behind where they began it was said to be of 8.08 Hz.
    """
    turns, clean, made = humming(waves, sigma=sigma, more=more)
    left, hums = without_hums(made, turns, [0, 1, 40])
    assert sorted(hum.frequency_Hz for hum in hums) == pytest.approx([hertz for hertz, _ in waves], rel=1e-3)
    assert max(hum.amplitude_deg for hum in hums) == pytest.approx(waves[0][1], rel=0.05)
    off, before = (
        np.array([np.abs(one.te - two.te)[[0, 1, 2, 39, 40, 41, 60]] for one, two in zip(part, clean, strict=True)])
        for part in (left, made)
    )
    # nothing of it is left in the orders of the machine either
    assert off.mean() < 0.05 * before.mean()


def test_a_hum_that_no_curve_shows_is_told_by_all_and_left_in_them():
    turns, _, made = humming([(8.0, 2.2e-5)], sigma=1e-4)
    left, (hum,) = without_hums(made, turns, [0, 1, 40])
    assert hum.is_faint and "not taken out" in hum.text
    assert hum.frequency_Hz == pytest.approx(8.0, abs=0.02)
    assert hum.amplitude_deg == pytest.approx(2.2e-5, rel=0.2)
    assert all(one is two for one, two in zip(left, made, strict=True)) and not hum.by_order.any()
    # a curve that hardly moves makes no more trials of the others
    assert without_hums(made, np.where(turns == turns.min(), 1e-6, turns), [0, 1, 40])[1][0].is_faint
    # nor does the noise of the same curves tell of one
    assert without_hums(humming([], sigma=1e-4)[1], turns, [0, 1, 40])[1] == ()


def test_noise_waves_of_the_machine_and_a_resonance_are_no_hum():
    turns, clean, _ = humming([])
    assert without_hums(clean, turns, [0, 1])[1] == ()
    lifted = [
        replace(
            one, plain_fft=one.plain_fft + at, te=one.te + at * np.exp(-1j * np.deg2rad(7.0) * np.arange(101)) * 200
        )
        for one, turn in zip(clean, turns, strict=True)
        for at in [1e-3 * (np.arange(101) == round(8.0 / turn))]
    ]
    assert without_hums(lifted, turns, [0, 1, 40])[1] == ()


@pytest.mark.parametrize(("right", "most"), [(2.2, False), (1.9, True)])
def test_a_gain_is_what_is_left_of_power_less_the_noise(right, most):
    """From six noises to 2.2: of the five that are no noise less than a fifth is gone if noise counts, more if not."""
    before, after = (np.full((10_000, 4), np.sqrt(power), complex) for power in (6.0, right))
    assert _most_gain(before, after, np.ones((10_000, 4)), float(np.log(5.0))) is most


@pytest.mark.thorough
@pytest.mark.parametrize("angle", [0.2, 1.0, 2.0])
def test_the_zero_of_the_angle_is_told_between_the_steps_of_its_grid(angle):
    """1.00 deg was said to be 1.12, and what that is off by made eleven parameters of the rig "changed"."""
    made = turned(measured(3e-6), angle)
    with pytest.raises(InputError, match=rf"k times {angle:.2f} deg"):
        examine(made, RIG, PATH)
    right = examine(made, RIG, PATH, accept=["home_offset"]).data
    model = RIG.coefficients(right.at, ORDERS.tolist())
    off = np.angle((right.values * model.conj()).sum(axis=0)[1:]) / ORDERS[1:]
    assert np.abs(np.degrees(np.median(off))) < 2e-3


@pytest.mark.parametrize(("gap", "runs", "falls"), [(1.5, 1, True), (0.9, 1, False), (0.9, 100, True)])
def test_orders_with_a_gap_above_the_noise_vote_and_others_are_asked_together(gap, runs, falls):
    """A gap is above the noise from the least power that a mean of runs tells on, which is 1 here as the noise is."""
    one = np.ones((2, 5))
    sums = PowerSums(np.arange(5), one, 0 * one, 0j * one, one, one, np.full((2, 1), runs))
    assert sums.gap_falls(one + gap, one) is falls


def turning(periods, sigma, samples=400):
    """Sums of 20 curves of 100 orders, each with a wave of so many periods a turn for every entry of a row."""
    random, phi = np.random.default_rng(8), 2 * np.pi * np.arange(samples) / samples
    waves = [sum((5e-4 * np.cos(k * phi + random.uniform(0, 6)) for k in row), 0.0 * phi) for row in periods]
    noise = sigma * random.standard_normal((len(waves), samples))
    te = 2e-3 * np.cos(phi) + 1e-3 * np.cos(40 * phi + 0.3) + waves + noise
    return [curve_sums(Curve(np.rad2deg(phi), row), 100) for row in te]


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [1e-6, 1e-4])
def test_a_wave_of_no_whole_number_of_periods_is_taken_out_of_all_curves(sigma):
    """In its place the jump where curves begin and end was called a burst there, with a probability of 0.98."""
    clean, made = turning([[]] * 20, sigma), turning([[17.3 + 0.002 * i] for i in range(20)], sigma)
    left, (wave,) = without_waves_between(made, [0, 1, 40])
    assert wave.order == pytest.approx(17.32, abs=0.02) and wave.amplitude_deg == pytest.approx(5e-4, rel=0.1)
    assert wave.frequency_Hz == 0.0 and "17.3 periods a turn" in wave.text
    orders = [0, 1, 2, 16, 17, 18, 39, 40, 60]
    off, before = (np.mean([np.abs(one.te - two.te)[orders] for one, two in zip(part, clean, strict=True)])
                   for part in (left, made))  # fmt: skip
    assert off < 0.1 * before
    assert without_waves_between(clean, [0, 1, 40])[1] == ()


@pytest.mark.parametrize("sigma", [1e-6, 1e-4])
def test_a_wave_of_no_whole_number_of_periods_may_be_there_in_one_direction_alone(sigma):
    """It counted as noise of the orders around, 40 times that of others, and what was missing was said to be named."""
    sign, rows = np.tile([1.0, -1.0], 20), [[17.3], []] * 20
    clean, made = turning([[]] * 40, sigma), turning(rows, sigma)
    left, (wave,) = without_waves_between(made, [0, 1, 40], sign)
    assert wave.order == pytest.approx(17.3, abs=0.02) and wave.amplitude_deg == pytest.approx(5e-4, rel=0.1)
    assert wave.curves == (20, 40) and "in 20 of 40 curves" in wave.text
    took = np.array([one.plain_fft - two.plain_fft for one, two in zip(made, left, strict=True)])
    assert not took[1::2].any()
    assert wave.by_order[1:] == pytest.approx(np.sqrt((np.abs(took[:, 1:]) ** 2).mean(axis=0) / 2))
    assert wave.power == pytest.approx(5e-4**2 / 4, rel=0.2)
    assert without_waves_between(clean, [0, 1, 40], sign)[1] == ()


@pytest.mark.parametrize(("sigma", "off"), [(1e-6, 0.01), (1e-4, 0.2)])
def test_a_wave_right_between_two_orders_of_the_rig_is_told_by_those_around(sigma, off):
    """Near a whole number a large wave shows little elsewhere: of each curve alone one of 0.008 deg was as good."""
    known = [0, 1, 36, 39, 40, 42]
    clean, made = turning([[]] * 20, sigma), turning([[39.4]] * 20, sigma)
    left, (wave,) = without_waves_between(made, known)
    # noise of 1e-4 is 7e-6 of a coefficient, and the four nearest free orders hold half of a wave of 5e-4: each curve
    # tells size and order to 3 to 5 %, so that what is left around is below a fifth at three errors
    assert wave.order == pytest.approx(39.4, abs=0.03) and wave.amplitude_deg == pytest.approx(5e-4, rel=0.05)
    assert wave.curves == (20, 20)
    orders = [36, 37, 38, 39, 40, 41, 42]
    rest, before = (np.mean([np.abs(one.te - two.te)[orders] ** 2 for one, two in zip(part, clean, strict=True)])
                    for part in (left, made))  # fmt: skip
    assert rest < off**2 * before
    assert without_waves_between(clean, known)[1] == ()


def test_a_wave_of_curves_with_few_and_many_samples_is_known_in_all_orders():
    """Of 280 samples a turn 70 orders are told, of 400 a hundred: its part of the others could not be asked for."""
    rows = [[17.3]] * 10
    made = [*turning(rows, 1e-6, samples=280), *turning(rows, 1e-6)]
    assert {one.band for one in made} == {70, 100}
    left, (wave,) = without_waves_between(made, [0, 1, 40])
    power = np.zeros(101)
    for one, two in zip(made, left, strict=True):
        power[: one.band + 1] += np.abs(one.plain_fft - two.plain_fft) ** 2 / 2 / len(made)
    assert wave.by_order[1:] == pytest.approx(np.sqrt(power[1:]))
    several = Signature(-1, 1e-9, 0.1, {}, "both", "")
    assert _with_hums(several, [wave]) is several
    one = _with_hums(replace(several, order=90), [wave])
    assert one.rms_deg > wave.by_order[90] and "of a wave of no order" in one.text


def test_a_louder_order_that_the_rig_lacks_hides_no_wave_between_orders():
    (wave,) = without_waves_between(turning([[17.3, 60.0]] * 20, 1e-5), [0, 1, 40])[1]
    assert wave.order == pytest.approx(17.3, abs=0.02)


@pytest.mark.thorough
def test_whole_waves_one_beside_the_other_and_bursts_are_no_wave_between_them():
    for periods in ([17.0], [17.0, 18.0], range(12, 30)):
        assert without_waves_between(turning([list(periods)] * 20, 1e-5), [0, 1, 40])[1] == ()


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [1e-5, 1e-4])
def test_sidebands_of_an_order_whose_phase_another_wave_moves_are_no_wave_between_them(sigma):
    """Two of them beside each other were a wave of 79.9 periods, as of a bearing, in little noise and not in more."""
    phi = 2 * np.pi * np.arange(1000) / 1000
    noise = sigma * np.random.default_rng(3).standard_normal((48, 1000))
    te = 1e-3 * np.cos(41 * phi) + 8e-4 * np.cos(82 * phi + 1.2 * np.sin(phi) + 0.2) + noise
    made = [curve_sums(Curve(np.rad2deg(phi), row), 250) for row in te]
    assert without_waves_between(made, [0, 1, 41, 81, 82, 83, 84])[1] == ()


def test_curves_without_any_noise_are_no_reason_to_stop():
    """A response that one order alone tells was told by the difference of large sums, and by nothing: a crash."""
    data = replace(measured(0.0), spectral_deg=np.full((2 * RUNS, len(ORDERS)), 1e-16))
    odd = np.where(ORDERS == 0, 1e-3 * np.tanh(data.at.torque_Nm / 50.0)[:, None], 0.0)
    assert not examine(replace(data, values=data.values + odd), RIG, PATH).mistakes


@pytest.mark.parametrize("share", [-0.25, 0.25])
def test_what_the_mesh_does_alike_at_one_speed_is_no_filter(share):
    """A film of oil made all mesh orders smaller with the speed: they had "passed a filter", most at 33 Hz."""
    data = of_curves()
    film = 1.0 + share * data.at.speed_rpm[:, None] / 1800.0
    assert not examine(replace(data, values=np.where(ORDERS > 5, film, 1.0) * data.values), RIG, PATH).mistakes


def stiffening(data, power):
    """A machine of which all that depends on the load follows a power of it."""
    load = 1800.0 * (data.at.torque_Nm / 1800.0) ** power
    at = replace(data.at, torque_Nm=load)
    return replace(data, values=data.values + RIG.coefficients(at, ORDERS.tolist()) - expected_of(data, RIG))


@pytest.mark.parametrize(("made", "size", "is_a_law"), [(stiffening, 0.8, True), (lagging, 18.0, False)])
def test_torques_that_are_off_by_a_law_of_the_torque_may_be_the_machine(made, size, is_a_law):
    """A contact that gets stiffer with the load was said to be torques that are wrong from run to run."""
    with pytest.raises(InputError, match="amounts that differ from run to run") as asked:
        examine(made(measured(3e-6), size), RIG, PATH)
    assert ("then --accept as_is is right" in str(asked.value)) is is_a_law


@pytest.mark.thorough
def test_a_run_whose_torque_alone_is_read_wrong_has_the_label_of_no_other_run():
    """Where torques scatter one run is near the torque of another one, whose speed has no part in it."""
    data, random = of_curves(), np.random.default_rng(2)
    speed, torque = (
        column + np.tile(random.uniform(-20, 20, RUNS), 2) for column in (data.at.speed_rpm, data.at.torque_Nm)
    )
    at = replace(data.at, speed_rpm=speed, torque_Nm=torque)
    right = data.values + RIG.coefficients(at, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist())
    wrong = torque + np.where(np.arange(2 * RUNS) % RUNS == 3, 250.0, 0.0)
    made = replace(data, values=right, at=replace(at, torque_Nm=wrong))
    (one,) = examine(made, RIG, PATH).mistakes
    assert one.name == "labels" and set(one.rows) == {3, 3 + RUNS} and "another torque" in one.text
    assert float(re.search(r"agrees with about (\S+) N m", one.text)[1]) == pytest.approx(torque[3], abs=30)
    largest = np.tile(np.arange(RUNS) == int(np.argmax(torque[:RUNS])), 2)
    beyond = replace(data, values=right, at=replace(at, torque_Nm=torque + np.where(largest, 250.0, 0.0)))
    assert not examine(beyond, RIG, PATH).mistakes
    other = np.tile(np.where(np.arange(RUNS) == 3, (np.arange(RUNS) + 7) % RUNS, np.arange(RUNS)), 2)
    exchanged = replace(at.rows(np.where(np.arange(2 * RUNS) < RUNS, other, other + RUNS)), sign=at.sign)
    (one,) = examine(replace(data, values=right, at=exchanged), RIG, PATH).mistakes
    assert one.name == "labels" and set(one.rows) == {3, 3 + RUNS}


def test_speeds_that_are_not_held_are_no_labels_of_other_runs():
    """A run of 1500 rpm that turned at 1428 is near one of 1400 rpm at another oil, and at neither of them."""
    data, random = of_curves(3e-6), np.random.default_rng(4)
    at = replace(data.at, speed_rpm=data.at.speed_rpm * (1.0 + 0.03 * np.tile(random.standard_normal(RUNS), 2)))
    right = data.values + RIG.coefficients(at, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist())
    assert [one.name for one in examine(replace(data, values=right), RIG, PATH).mistakes] == []


@pytest.mark.thorough
def test_an_order_that_does_not_turn_hides_no_zero_of_the_others():
    """A reducer that is turned on its flange leaves the eccentricity of the encoder where it was."""
    data, sure = of_curves(3e-6), np.arange(RUNS) > 100
    turn = np.exp(-1j * np.radians(of_runs(24.0 * sure)) * np.where(ORDERS == 1, 0, ORDERS))
    made = replace(data, values=data.values * turn)
    seen = f"{sure.sum()} of {RUNS} runs seem to have a zero of the angle"
    with pytest.raises(InputError, match=f"{seen}.* by up to 24.00 deg"):
        examine(made, RIG, PATH)
    back = examine(made, RIG, PATH, accept=["home_offset"]).data
    assert np.abs(back.values - data.values)[:, ORDERS != 1].max() < 3e-5


def test_runs_of_one_start_of_the_machine_share_its_zero():
    """Each by its own, what a missing resonance turned of single orders stayed as steps and scatter of nine orders."""
    data, random = of_curves(), np.random.default_rng(3)
    off = np.where(np.arange(RUNS) > 150, 3.0, 0.0)
    made = replace(data, values=data.values * np.exp(-1j * np.radians(of_runs(off)) * ORDERS))
    foreign = 1e-4 * np.exp(1j * random.uniform(0, 6, len(data)))
    made = replace(made, values=made.values + foreign[:, None] * np.isin(ORDERS, (156, 162)))
    back = examine(made, RIG, PATH, accept=["home_offset"]).data
    turn = np.angle(back.values[:, ORDERS == 78] / made.values[:, ORDERS == 78]).ravel()
    turned = np.abs(turn) > 1e-6
    assert turned.sum() == 2 * (off > 0).sum() and np.ptp(turn[turned]) < 1e-9


def test_a_run_beyond_the_highest_speed_has_the_label_of_no_other_run():
    """At 6 % more than the highest label, out of a resonance, it was said to agree with the lowest speed."""
    data = measured()
    at, wrong = data.at, (data.at.speed_rpm == data.at.speed_rpm.max()) & (np.arange(len(data.at)) % RUNS % 4 == 0)
    true = replace(at, speed_rpm=np.where(wrong, 1.06 * at.speed_rpm, at.speed_rpm))
    rig = RIG.with_effects(
        one.with_values({**one.values, "frequency_Hz": 58.5}) if one.name == "structural_resonance" else one
        for one in RIG.effects
    )
    moved = data.values + rig.coefficients(true, ORDERS.tolist()) - RIG.coefficients(at, ORDERS.tolist())
    assert not [one for one in examine(replace(data, values=moved), rig, PATH).mistakes if one.name == "labels"]


@pytest.mark.parametrize("orders", [np.arange(5, 61), np.arange(0, 241)])
def test_what_settles_after_the_turn_begins_is_no_ramp(orders):
    """A wind-up that came back within 12 deg was "a reduction ratio of 80.9985", and so was to be corrected."""
    random, k = np.random.default_rng(1), np.maximum(orders, 1)
    noise = 1e-6 * (random.standard_normal((96, len(k))) + 1j * random.standard_normal((96, len(k))))
    height, reach = -6.5e-3, 0.2
    size, _, _ = ramp_deg(orders, 1j * height / (np.pi * k) + noise)
    assert size == pytest.approx(height, rel=1e-3)
    assert ramp_deg(orders, height / np.pi * reach / (1 + 1j * k * reach) * -1 + noise)[0] == 0.0


def test_waves_of_many_curves_are_those_of_each_alone():
    """Curves of other numbers of samples, and waves beyond what these tell, are looked for at once."""
    random, sums = np.random.default_rng(7), []
    for samples, order in ((720, 17.3), (1000, 17.3), (720, 40.0), (900, 880.4)):
        theta = 2.0 * np.pi * np.arange(samples) / samples
        te = 1e-3 * np.cos(order * theta + 0.4) + 1e-5 * random.standard_normal(samples)
        sums.append(curve_sums(Curve(np.rad2deg(theta), te), 100))
    lines, free = np.stack([one.plain_fft[:101] for one in sums]), np.ones(101, bool)
    free[[0, 1, 39, 40]] = False
    orders = np.array([17.1, 17.4, 40.1, 880.2])
    together = _waves(sums, lines, orders, free, most=1e-3)
    for row, (one, found) in enumerate(zip(sums, together, strict=True)):
        (alone,) = _waves([one], lines[row : row + 1], orders[row : row + 1], free, most=1e-3)
        assert (found.size, found.order) == (alone.size, alone.order)
        assert np.array_equal(found.wave, alone.wave)
    assert [one.size for one in together[:2]] == pytest.approx([1e-3, 1e-3], rel=0.01)
    assert [one.order for one in together[:2]] == pytest.approx([17.3, 17.3], abs=0.01)
