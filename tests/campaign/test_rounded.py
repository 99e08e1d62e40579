"""Angles that are rounded to coarse steps are taken without them; others stay as they are, bit by bit."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("polars")

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import Curve, Run, write_run
from st_codegen.campaign.orders import curve_sums, fit_orders
from st_codegen.campaign.reader import read_campaign
from st_codegen.campaign.rounded import without_steps
from st_codegen.te.harmonics import Direction
from st_codegen.training.measured import measured_table

from .test_orders import ORDERS, a_curve, coefficients

STEPS = (0.1, 0.4, 360 / 3300)


def angles(count, wander=0.0):
    """Angles of a turn, with the speed off by a wave once a turn and one of the fast shaft."""
    even = np.arange(count) / count
    return 360 * even + wander * (np.sin(2 * np.pi * even) + 0.1 * np.cos(2 * np.pi * 81 * even))


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("count", [1000, 4096])
@pytest.mark.parametrize("wander", [0.0, 0.5])
@pytest.mark.parametrize("rounds", [np.round, np.floor])
def test_angles_come_nearer_to_what_they_were(step, count, wander, rounds):
    true = angles(count, wander)
    read = np.round(rounds(true / step + 1e-9) * step, 6)
    off, before = without_steps(read, 240) - true, read - true
    assert off.std() < (0.8 if wander else 0.02) * before.std()
    # what is cut off is so in the mean as well: nobody knows which way angles were rounded
    assert off.mean() == pytest.approx(before.mean(), abs=0.02 * step)


@pytest.mark.parametrize(
    "read",
    [
        angles(1000),
        angles(1000, 0.5),
        np.round(angles(1000), 3),
        np.delete(angles(1000), [100]),
        np.delete(angles(1000), np.arange(100, 125)),
        np.delete(angles(1000), np.random.default_rng(0).choice(1000, 30, replace=False)),
        angles(1000)[::-1],
        angles(1000) + 0.02 * np.random.default_rng(0).standard_normal(1000),
        np.delete(np.round(angles(1000), 1), np.arange(100, 125)),
        np.round(angles(1000)),
    ],
    ids=["even", "wander", "digits", "one_lost", "gap", "many_lost", "backward", "jitter", "rounded_gap", "degrees"],
)
def test_angles_without_coarse_steps_stay_as_they_are(read):
    assert without_steps(read, 240) is read


@pytest.mark.parametrize("step", [0.1, 360 / 4096])
def test_orders_are_those_of_angles_that_are_not_rounded(step):
    """Order 240 was a tenth smaller, and its power stood in orders that nothing makes."""
    curve = a_curve(coefficients())
    even = np.arange(len(curve.te_deg) // 8) * 8
    curve = replace(curve, angle_deg=curve.angle_deg[even], te_deg=curve.te_deg[even])
    read = replace(curve, angle_deg=np.round(np.round(curve.angle_deg / step) * step, 6))
    orders = [order for order in ORDERS if order <= curve_sums(curve).band]
    whole, rounded = (fit_orders(curve_sums(one), orders).coefficients for one in (curve, read))
    assert np.abs(rounded - whole).max() < 2e-3 * np.abs(whole).max()


def over(angle_deg, seed=0):
    """A curve with four loud orders over these angles."""
    theta, random = np.deg2rad(angle_deg), np.random.default_rng(seed)
    te = 1e-2 * np.cos(theta) + 1e-3 * np.cos(39 * theta + 1) + 9e-4 * np.cos(40 * theta) + 5e-4 * np.cos(240 * theta)
    return te + 1e-6 * random.standard_normal(len(theta))


#: each is the nearest of 3600 samples, 3 or 4 of them further than the last
THINNED = np.round(np.round(np.arange(1000) * 3.6) * 0.1, 6)


def test_exact_angles_of_a_curve_that_was_thinned_out_stay():
    """Order 40 was 0.000878, and nine orders stood above the noise."""
    sums = curve_sums(Curve(THINNED, over(THINNED)))
    assert not sums.moved_deg and without_steps(THINNED, 240) is not THINNED
    fit = fit_orders(sums, [1, 39, 40, 240])
    assert np.abs(fit.coefficients) == pytest.approx([1e-2, 1e-3, 9e-4, 5e-4], abs=5e-7)
    assert np.count_nonzero(fit.spectrum > 5 * fit.spectrum_floor) == 4


def test_what_steps_make_of_a_curve_below_its_noise_does_not_add_up_over_curves():
    """No curve told that it was rounded, and the mean of 60 had orders 21 and 99, which nothing makes, of 5e-5 deg."""
    true, random = np.arange(1180) * (360 / 1180), np.random.default_rng(0)
    theta, read = np.deg2rad(true), np.round(np.round(true / 0.1) * 0.1, 6)
    te = 1e-2 * np.cos(theta) + 5e-3 * np.cos(39 * theta + 1)
    sums = [curve_sums(Curve(read, te + 2e-4 * random.standard_normal(1180))) for _ in range(20)]
    means = np.mean([fit_orders(one, [1, 21, 39, 99]).coefficients for one in sums], axis=0)
    assert np.abs(means[[1, 3]]).max() < 5 * 2e-4 * np.sqrt(2 / 1180 / 20)


def test_curves_whose_angles_are_changed_are_listed(tmp_path):
    """Three forward curves have rounded angles, the others exact ones of the same steps."""
    for number in range(25):
        true = 0.36 * np.arange(1000)
        forward = Curve(THINNED, over(true if number < 3 else THINNED, number))
        backward = Curve(360.0 - THINNED, over(360.0 - THINNED, number + 100))
        conditions = OperatingPoint(100.0 * (number + 1), 100.0, 25.0)
        curves = {Direction.FORWARD: forward, Direction.BACKWARD: backward}
        write_run(Run(conditions, curves), tmp_path / conditions.rig_path())
    cache = tmp_path / "kept.parquet"
    found, again = (read_campaign(tmp_path, jobs=1, cache=cache) for _ in range(2))
    assert found.rounded == again.rounded
    said = (
        "the rounded angles of 3 curves, in whose place smooth ones stand, up to 0.041 deg off: Test_25degree/100rpm/"
    )
    assert found.rounded.startswith(said)
    assert found.rounded in measured_table(tmp_path, [0, 1], 2).left_out
