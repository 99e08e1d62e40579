"""Writes rig.toml: the default rig, a Nabtesco RV 160N with the sizes of docs/effects.md."""

from pathlib import Path
from typing import Any

from st_codegen.rig.effects import Constants, Effect, catalogue
from st_codegen.rig.model import MeasuringNoise, RigModel

# effect, order, forward (deg, rad), backward (deg, rad) or None for the same; from `benchmarks/rig_sizes.py`
MESH: list[tuple[str, int, tuple[float, float], tuple[float, float] | None]] = [
    ("cycloid_tooth_error", 39, (7.12e-4, -1.75), (5.70e-4, -1.49)),
    ("cycloid_tooth_error", 78, (8.77e-5, 1.69), (6.66e-5, -1.46)),
    ("cycloid_tooth_error", 156, (1.82e-4, 1.24), (1.50e-4, 1.49)),
    ("pin_error", 40, (8.99e-4, 0.17), (3.81e-4, 0.34)),
    ("pin_error", 80, (2.06e-4, 0.0), None),
    ("pin_error", 120, (1.70e-4, 0.0), None),
    ("pin_error", 240, (1.91e-4, -3.05), (2.37e-4, 2.59)),
    ("input_shaft_misalignment", 81, (2.80e-4, -0.84), (1.17e-4, 0.33)),
    ("input_shaft_misalignment", 162, (8.46e-5, -3.09), (4.08e-5, 2.82)),
    ("load_dependent_mesh", 39, (7.04e-4, -0.49), (5.99e-4, 2.26)),
    ("load_dependent_mesh", 40, (8.23e-5, -2.79), (7.96e-5, -2.76)),
    ("load_dependent_mesh", 78, (1.06e-3, -0.20), (1.31e-3, 0.45)),
    ("load_dependent_mesh", 81, (2.07e-4, -2.70), (2.65e-5, 2.50)),
    ("load_dependent_mesh", 156, (1.40e-4, -2.34), (2.31e-4, 0.30)),
    ("load_dependent_mesh", 162, (1.10e-4, 2.05), (1.51e-4, 1.17)),
    ("load_dependent_mesh", 240, (4.87e-4, -0.86), (3.30e-4, 1.71)),
]
OTHERS: list[tuple[str, dict[str, Any]]] = [
    ("torsional_compliance", {"stiffness_Nm_per_arcmin": 454.0}),
    ("backlash", {"gap_arcmin": 0.3, "seating_torque_Nm": 60.0}),
    (
        "friction_windup",
        {"coulomb_arcmin": 0.25, "viscous_arcmin_per_krpm": 0.02, "viscosity_decay_per_K": 0.04},
    ),
    ("thermal_drift", {"drift_arcmin_per_K": 0.008}),
    ("output_shaft_eccentricity", {"amplitude_deg": 0.0172, "phase_rad": 0.0}),
    ("output_shaft_ovality", {"amplitude_deg": 2.73e-4, "phase_rad": 0.0}),
    (
        "crank_misalignment",
        {
            "amplitude_deg": 5.61e-4,
            "phase_rad": 1.54,
            "backward_amplitude_deg": 8.24e-4,
            "backward_phase_rad": 1.82,
            "slope_deg_per_kNm": 3.34e-4,
            "slope_phase_rad": 2.42,
            "backward_slope_deg_per_kNm": 4.34e-4,
            "backward_slope_phase_rad": 0.25,
        },
    ),
    (
        "carrier_modulation",
        {"order": 39, "lower_ratio": 0.11, "lower_phase_rad": 0.0, "upper_ratio": 0.14, "upper_phase_rad": 0.0},
    ),
    ("carrier_modulation", {"order": 162, "lower_ratio": 1.9, "lower_phase_rad": 0.0}),
    (
        "carrier_modulation",
        {"order": 240, "lower_ratio": 0.23, "lower_phase_rad": 0.0, "upper_ratio": 0.036, "upper_phase_rad": 0.0},
    ),
    (
        "structural_resonance",
        {
            "orders": [156, 162, 240],
            "frequency_Hz": 54.3,
            "damping_ratio": 0.012,
            "amplitude_deg": [4.5e-3, 8.0e-3, 2.7e-3],
            "phase_rad": [-2.3, 0.6, -2.4],
            "backward_amplitude_deg": [7.5e-3, 8.0e-3, 2.6e-3],
            "backward_phase_rad": [1.2, 1.6, 1.1],
        },
    ),
    ("measurement_delay", {"delay_us": 250.0}),
    ("control_lag", {"lag_ms": 4.0}),
    ("coupling_compliance", {"stiffness_Nm_per_rad": 8000.0}),
]


def rig() -> RigModel:
    """The default rig."""
    constants, known = Constants(), catalogue()
    effects: list[Effect] = [known[name](values, constants) for name, values in OTHERS]
    for name, order, forward, backward in MESH:
        key = known[name].phasors[0].key
        values = {"order": order, key: forward[0], "phase_rad": forward[1]}
        if backward is not None:
            values |= {f"backward_{key}": backward[0], "backward_phase_rad": backward[1]}
        effects.append(known[name](values, constants))
    noise = MeasuringNoise(white_deg=0.0005, run_offset_deg=0.001)
    return RigModel("rv160n", constants, -0.0174, noise, tuple(effects))


if __name__ == "__main__":
    rig().write(Path(__file__).with_name("rig.toml"))
