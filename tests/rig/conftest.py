"""A rig whose harmonics are linear in speed, torque and temperature, and a bundle of linear models that knows it."""

import numpy as np
import pytest

from st_codegen.project.bundle import load
from st_codegen.rig.effects import Conditions
from st_codegen.rig.machine import machine_of
from st_codegen.rig.model import parse_rig

LINEAR_RIG = """
[rig]
name = "linear"
reduction_ratio = 81.0
zero_offset_deg = -0.01

[axis.load]
torque_ripple_Nm = 0.0

[axis.encoders]
input_noise_deg = 0.0
output_noise_deg = 0.0
input_steps_per_rev = 1e12
output_steps_per_rev = 1e12

[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = 454.0

# the drag keeps the flanks apart: without it a rig changes its flank with every tremor
[[effect]]
name = "friction_windup"
coulomb_arcmin = 0.25

[[effect]]
name = "thermal_drift"
drift_arcmin_per_K = 0.01

[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.0172
phase_rad = 0.4

[[effect]]
name = "cycloid_tooth_error"
order = 39
amplitude_deg = 0.0007
phase_rad = -1.7
backward_amplitude_deg = 0.0005
backward_phase_rad = 1.0

[[effect]]
name = "load_dependent_mesh"
order = 39
slope_deg_per_kNm = 0.0007
phase_rad = 0.5
"""
ORDERS = (0, 1, 39)


def write_bundle(rig, folder, orders):
    """Linear regressions of the real and imaginary parts of a rig's coefficients."""
    skops = pytest.importorskip("skops.io")
    linear = pytest.importorskip("sklearn.linear_model")
    folder.mkdir(parents=True, exist_ok=True)
    axes = (np.linspace(0, 1800, 4), np.linspace(0, 1800, 4), np.array([20.0, 30.0, 40.0]))
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    ratio = rig.constants.reduction_ratio
    lines = ["[bundle]", 'name = "linear"', f"reduction_ratio = {ratio}", 'speed_feature = "speed_rpm"']
    lines += ['directions = ["forward", "backward"]', f"orders = {list(orders)}"]
    for name, unit, low, high in (
        ("speed_rpm", "rpm", 0, 1800),
        ("torque_Nm", "N m", 0, 1800),
        ("temperature_C", "degC", 20, 40),
    ):
        lines += ["[[feature]]", f'name = "{name}"', f'unit = "{unit}"', f"min = {low}.0", f"max = {high}.0"]
    for direction, sign in (("forward", 1.0), ("backward", -1.0)):
        c = rig.coefficients(Conditions.of(sign, *x.T), orders)
        for column, order in enumerate(orders):
            lines += ["[[harmonic]]", f'direction = "{direction}"', f"order = {order}"]
            parts = {"cosine": c[:, column].real, "sine": c[:, column].imag}
            for quantity, values in ({"amplitude": parts["cosine"]} if order == 0 else parts).items():
                file = f"{quantity}{order}_{direction}.skops"
                skops.dump(linear.LinearRegression().fit(x, values), folder / file)
                lines.append(f'{quantity} = "{file}"')
    (folder / "bundle.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def linear_model():
    return parse_rig(LINEAR_RIG)


@pytest.fixture(scope="session")
def linear_rig(linear_model):
    pytest.importorskip("numba")
    return machine_of(linear_model)


@pytest.fixture(scope="session")
def linear_folder(linear_model, tmp_path_factory):
    return write_bundle(linear_model, tmp_path_factory.mktemp("bundle") / "models", ORDERS)


@pytest.fixture(scope="session")
def linear_bundle(linear_folder):
    return load(linear_folder)
