"""A small harmonic table of known shape, and a curve campaign made from it."""

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("polars")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import Curve, Run, write_run
from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.te.harmonics import Direction
from st_codegen.training.search import one_thread


@pytest.fixture(autouse=True)
def in_one_thread():
    with one_thread():
        yield


ORDERS = (0, 1, 39, 156)


def a_table(backward=False, speeds=9, torques=7, noise=0.0, seed=0):
    """Coefficients that are smooth in torque, with a resonance in speed at order 156 and phases that wrap."""
    speed, torque, oil = np.meshgrid(
        np.linspace(100, 1800, speeds), np.linspace(0, 1800, torques), [25.0, 35.0], indexing="ij"
    )
    speed, torque, oil = speed.ravel(), torque.ravel(), oil.ravel()
    sign = -1.0 if backward else 1.0
    mean = -0.02 - sign * 3.67e-5 * torque + 1e-4 * (oil - 25)
    first = 0.0172 * np.exp(0.01j * torque / 1000) + 0 * speed
    mesh = (8e-4 + 4e-7 * torque) * np.exp(1j * (-1.2 + 2e-4 * torque))
    ratio = 156 * speed / 81 / 60 / 54
    high = 3e-4 * np.exp(3.0j) / (1 - ratio**2 + 0.1j * ratio)
    c = np.stack([mean + 0j, first, mesh, high], axis=1)
    random = np.random.default_rng(seed)
    c = c + noise * (random.normal(size=c.shape) + 1j * random.normal(size=c.shape))
    c[:, 0] = c[:, 0].real
    return HarmonicTable(np.full(len(speed), backward), speed, torque, oil, ORDERS, c)


@pytest.fixture(scope="session")
def table():
    return a_table(noise=1e-6)


def write_campaign(folder, tables, samples=1600, noise=1e-6):
    """Curve files in the rig's layout."""
    theta = np.linspace(0, 2 * np.pi, samples, endpoint=False)
    theta = theta + 0.002 * np.sin(3 * theta)
    curves = {}
    random = np.random.default_rng(5)
    for one in tables:
        for row in range(len(one)):
            direction = Direction.BACKWARD if one.backward[row] else Direction.FORWARD
            angle = theta if direction is Direction.FORWARD else 2 * np.pi - theta
            te = one.rows([row]).curves(angle)[0] + noise * random.normal(size=samples)
            key = OperatingPoint(*one.conditions[row])
            curves.setdefault(key, {})[direction] = Curve(np.rad2deg(angle), te)
    for conditions, own in curves.items():
        write_run(Run(conditions, own), folder / conditions.rig_path())
