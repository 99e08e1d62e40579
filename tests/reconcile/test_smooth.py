"""Noise of runs that lie anywhere, beside a function of the conditions that nobody gave it."""

import numpy as np
import pytest

from st_codegen.reconcile.data.noise import estimate, noise_beside
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.rig.effects import Conditions

ORDERS = np.array([0, *range(30, 49)])
SIGMA = 2e-5


def scattered(count=45, seed=0):
    """Runs of a Latin hypercube, as a design of experiments gives them."""
    random = np.random.default_rng(seed)
    cells = np.stack([random.permutation(count) for _ in range(3)], axis=1)
    speed, torque, oil = (np.array([200, 0, 25]) + np.array([1500, 1600, 10]) * (cells + 0.5) / count).T
    return Conditions.of(np.ones(count), speed, torque, oil)


def noise(at, seed):
    random = np.random.default_rng(seed)
    values = SIGMA * (random.standard_normal((len(at), 20)) + 1j * random.standard_normal((len(at), 20)))
    values[:, 0] = values[:, 0].real
    return values


LAWS = {
    "nothing": lambda at: 0.0 * at.torque_Nm,
    "contact": lambda at: -0.05 * (at.torque_Nm / 1600) ** (2 / 3),
    "friction": lambda at: 0.004 * np.exp(-at.speed_rpm / 250) + 0.001 * at.speed_rpm / 1700,
    "saturating": lambda at: 2e-3 * np.tanh(at.torque_Nm / 400),
}


@pytest.mark.parametrize("law", LAWS)
def test_the_noise_of_scattered_runs_is_told_whatever_they_follow(law):
    """A plane through neighbours and a square of the conditions said up to 30 times as much."""
    ratios = []
    for seed in range(3):
        at = scattered(seed=seed)
        values = noise(at, seed + 100) + LAWS[law](at)[:, None]
        ratios.append(noise_beside(at, values, ORDERS) / SIGMA)
    middle = np.median(ratios, axis=0)
    # a contact law has a vertical slope at no load, which no smooth function has
    assert np.all(middle > 0.6) and np.all(middle < 2.0)
    assert 0.85 < np.median(ratios) < (1.4 if law == "contact" else 1.15)


def test_few_runs_say_nothing():
    at = scattered(12)
    assert np.isinf(noise_beside(at, noise(at, 0), ORDERS)).all()


def test_the_floor_of_a_campaign_is_that_of_the_smooth_function_and_says_so():
    at = scattered()
    values = noise(at, 3) + LAWS["contact"](at)[:, None]
    found = estimate(Observations(at, labels(at), ORDERS, values), values)
    assert found.kinds[0] == "smooth"
    assert found.floor_rms == pytest.approx(SIGMA, rel=1.0)
