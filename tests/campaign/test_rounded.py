"""Angles that are rounded to coarse steps are taken without them; others stay as they are, bit by bit."""

from dataclasses import replace

import numpy as np
import pytest

from st_codegen.campaign.orders import curve_sums, fit_orders
from st_codegen.campaign.rounded import without_steps

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
