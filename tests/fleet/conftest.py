"""Small simulated axes, measured as harmonic tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("skops")
pytest.importorskip("polars")
pytest.importorskip("matplotlib")

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.harmonic_table import HarmonicTable, write_table
from st_codegen.rig.model import parse_rig

ORDERS = (0, 1)
RIG = """[rig]
name = "small"
reduction_ratio = 81.0

[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = 450.0

[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.017
phase_rad = 0.0
"""
DEFAULTS = """[defaults]
rig = "rig.toml"
families = ["DT"]
folds = 2
target = "iec"
"""


def write_campaign(path, seed=0, **changed):
    """A harmonic table of the rig with other values of some parameters."""
    rig = parse_rig(RIG)
    effects = [e.with_values({k: changed.get(k, v) for k, v in e.values.items()}) for e in rig.effects]
    grid = np.meshgrid([200.0, 1400.0], np.linspace(0, 1200, 6), [25.0, 35.0], [1.0, -1.0], indexing="ij")
    speed, torque, oil, sign = (part.ravel() for part in grid)
    c = replace(rig, effects=tuple(effects)).coefficients(Conditions(sign, speed, torque, oil), ORDERS)
    random = np.random.default_rng(seed)
    c = c + 2e-5 * (random.standard_normal(c.shape) + 1j * random.standard_normal(c.shape))
    c[:, 0] = c[:, 0].real
    path.parent.mkdir(parents=True, exist_ok=True)
    write_table(HarmonicTable(sign < 0, speed, torque, oil, ORDERS, c), path)
    return path


def fleet_file(folder, text, rig=RIG):
    """A fleet.toml beside its rig."""
    (folder / "rig.toml").write_text(rig)
    path = Path(folder) / "fleet.toml"
    path.write_text(text)
    return path
