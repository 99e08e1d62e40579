"""Every effect of the catalogue: its formula in angle, its bounds, its keys; the rig file."""

import re
from pathlib import Path

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.rig.effects import Conditions, Constants, Form, Stage, catalogue
from st_codegen.rig.effects.axis import ControlLag, CouplingCompliance
from st_codegen.rig.effects.empirical import TERMS, term_values
from st_codegen.rig.effects.resonance import StructuralResonance
from st_codegen.rig.model import RigModel, parse_rig, read_rig

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = ROOT / "examples" / "rv160n" / "rig.toml"
CONSTANTS = Constants()
KNOWN = catalogue()
THETA = np.linspace(0, 360, 721)
#: theta in rad
X = np.deg2rad(THETA)

NAMES = """backlash torsional_compliance hanging_load_compliance friction_windup output_shaft_eccentricity
output_shaft_ovality crank_misalignment cycloid_tooth_error pin_error input_shaft_misalignment
carrier_modulation structural_resonance thermal_drift measurement_delay encoder_eccentricity
load_dependent_mesh wear local_defect local_mesh_defect control_lag coupling_compliance
empirical"""


def te(*effects, sign=1.0, speed=1000.0, torque=500.0, temperature=35.0):
    rig = RigModel(effects=tuple(KNOWN[name](values, CONSTANTS) for name, values in effects))
    return rig.te_deg(THETA, sign, speed, torque, temperature)


@pytest.mark.parametrize(
    ("order", "part"),
    [
        (78, "2 x 39 teeth of the cycloid"),
        (40, "1 x 40 pins"),
        (161, "2 x 80.5 turns of the input shaft"),
        (1560, ""),  # the 40th of the teeth and the 39th of the pins, both above the tenth
        (81, ""),
        (0, ""),
    ],
)
def test_the_part_that_has_an_order(order, part):
    assert Constants(reduction_ratio=80.5).part_of(order) == part


def test_an_order_of_two_parts():
    assert Constants(cycloid_teeth=20).part_of(40) == "2 x 20 teeth of the cycloid or 1 x 40 pins"
    assert Constants(reduction_ratio=1000 / 3).part_of(1000) == "3 x 333.3333333 turns of the input shaft"


def test_the_catalogue_has_the_names_of_the_design():
    assert set(KNOWN) == set(NAMES.split())


def test_every_effect_is_documented_with_its_keys():
    text = (ROOT / "docs" / "effects.md").read_text()
    for name, effect in KNOWN.items():
        assert f"`{name}`" in text
        for key in effect.known_keys():
            assert f"`{key}`" in text or f"`{key.removeprefix('backward_')}`" in text, key


# what docs/effects.md says, written as functions of the angle: an independent way to the same numbers
FORMULAS = {
    "torsional_compliance": ({"stiffness_Nm_per_arcmin": 400}, lambda s, n, M, T: -s * M / 400 / 60 + 0 * X),
    "hanging_load_compliance": ({"stiffness_Nm_per_arcmin": 400}, lambda s, n, M, T: -M / 400 / 60 + 0 * X),
    "backlash": (
        {"gap_arcmin": 1.2, "seating_torque_Nm": 50},
        lambda s, n, M, T: -s * 0.01 * np.tanh(M / 50) + 0 * X,
    ),
    "friction_windup": (
        {
            "coulomb_arcmin": 0.6,
            "viscous_arcmin_per_krpm": 0.3,
            "viscosity_decay_per_K": 0.05,
            "stribeck_arcmin": 1.2,
            "stribeck_speed_rpm": 400,
            "stribeck_exponent": 2,
        },
        lambda s, n, M, T: (
            -s
            * (
                0.01
                + 0.005 * n / 1000 * np.exp(-0.05 * (T - 30))
                + 0.02 * np.exp(-((n / 400 * np.exp(-0.05 * (T - 30))) ** 2))
            )
            + 0 * X
        ),
    ),
    "thermal_drift": ({"drift_arcmin_per_K": 0.6}, lambda s, n, M, T: 0.01 * (T - 30) + 0 * X),
    "output_shaft_eccentricity": (
        {"amplitude_deg": 0.02, "phase_rad": 0.5, "growth_per_kNm": 0.4},
        lambda s, n, M, T: 0.02 * (1 + 0.4 * M / 1000) * np.cos(X + 0.5),
    ),
    "encoder_eccentricity": (
        {"amplitude_deg": 0.02, "phase_rad": -2},
        lambda s, n, M, T: 0.02 * np.cos(X - 2),
    ),
    "output_shaft_ovality": ({"amplitude_deg": 0.02}, lambda s, n, M, T: 0.02 * np.cos(2 * X)),
    "crank_misalignment": (
        {
            "amplitude_deg": 0.02,
            "phase_rad": 1,
            "slope_deg_per_kNm": 0.01,
            "slope_phase_rad": 2,
            "backward_slope_deg_per_kNm": 0.02,
        },
        lambda s, n, M, T: (
            0.02 * np.cos(3 * X + 1)
            + M / 1000 * (0.01 * np.cos(3 * X + 2) if s > 0 else 0.02 * np.cos(3 * X))
        ),
    ),
    "cycloid_tooth_error": (
        {"order": 78, "amplitude_deg": 0.02, "phase_rad": 1, "backward_amplitude_deg": 0.01, "backward_phase_rad": 3},
        lambda s, n, M, T: 0.02 * np.cos(78 * X + 1) if s > 0 else 0.01 * np.cos(78 * X + 3),
    ),
    "pin_error": ({"order": 80, "amplitude_deg": 0.02}, lambda s, n, M, T: 0.02 * np.cos(80 * X)),
    "input_shaft_misalignment": ({"order": 81, "amplitude_deg": 0.02}, lambda s, n, M, T: 0.02 * np.cos(81 * X)),
    "load_dependent_mesh": (
        {"order": 78, "slope_deg_per_kNm": 0.02, "phase_rad": 1},
        lambda s, n, M, T: 0.02 * M / 1000 * np.cos(78 * X + 1),
    ),
    "structural_resonance": (
        {"orders": [240, 156], "frequency_Hz": 54, "damping_ratio": 0.02, "amplitude_deg": [0.1, 0.0],
         "phase_rad": [1.0, 0.0], "growth_per_kNm": 0.5},
        lambda s, n, M, T: response(s, n, M),
    ),
    "wear": (
        {"depth_arcmin": 1.2, "centre_deg": 100, "width_deg": 10},
        lambda s, n, M, T: -s * 0.02 * np.exp((np.cos(X - np.deg2rad(100)) - 1) / np.deg2rad(10) ** 2),
    ),
    "local_defect": (
        {"height_deg": 0.02, "turning_deg": 0.01, "slope_deg_per_kNm": 0.004, "turning_slope_deg_per_kNm": 0.002,
         "centre_deg": 359, "width_deg": 4},
        lambda s, n, M, T: (0.02 + 0.004 * M / 1000 + s * (0.01 + 0.002 * M / 1000)) * bell(359, 4),
    ),
    "local_mesh_defect": (
        {"order": 195, "amplitude_deg": 0.02, "phase_rad": 1, "slope_deg_per_kNm": 0.004, "slope_phase_rad": -2,
         "centre_deg": 70, "width_deg": 5},
        lambda s, n, M, T: (0.02 * np.cos(195 * X + 1) + 0.004 * M / 1000 * np.cos(195 * X - 2)) * bell(70, 5),
    ),
    "measurement_delay": (
        {"skew_us": 300, "delay_us": 100},
        lambda s, n, M, T: -np.rad2deg(s * n / 60 / 81 * 2 * np.pi) * 300e-6 + 0 * X,
    ),
}  # fmt: skip


def bell(centre, width):
    distance = np.angle(np.exp(1j * (X - np.deg2rad(centre))))
    return np.exp(-0.5 * (distance / np.deg2rad(width)) ** 2)


def response(s, n, M):
    """The steady answer of the oscillator, from the equation of motion in time: x'' + 2 D w0 x' + w0^2 x = -2 D e''."""
    w0, damping = 2 * np.pi * 54, 0.02
    w = s * 240 * n / 60 / 81 * 2 * np.pi  # frequency at which the wave of theta = s*|w_out|*t runs
    excitation = 0.1 * np.exp(1j) * (1 + 0.5 * M / 1000)
    answer = 2 * damping * w**2 * excitation / (w0**2 - w**2 + 2j * damping * w0 * w)
    return (answer * np.exp(240j * X)).real


@pytest.mark.parametrize("name", FORMULAS)
@pytest.mark.parametrize("point", [(1, 1000, 500, 35), (-1, 1000, 500, 35), (1, 350, 0, 25), (-1, 1800, 1800, 25)])
def test_contribution_is_the_formula_of_the_document(name, point):
    values, formula = FORMULAS[name]
    # coefficients of at most 0.1 deg, sums of at most 100 terms; wear is cut off at exp(-18)
    assert te(
        (name, values), **dict(zip(("sign", "speed", "torque", "temperature"), point, strict=False))
    ) == pytest.approx(formula(*point), abs=2e-9)


@pytest.mark.parametrize(("sign", "height", "slope"), [(1, 0.1, 0.2 * np.exp(1j)), (-1, 0.05j, 0.3)])
@pytest.mark.parametrize("torque", [-500.0, 0.0, 1500.0])
def test_the_load_part_of_a_resonance_has_flanks_of_its_own(sign, height, slope, torque):
    shape = {"orders": [156, 240], "frequency_Hz": 54, "damping_ratio": 0.02}
    sizes = {
        "amplitude_deg": [0.0, 0.1], "backward_amplitude_deg": [0.0, 0.05], "backward_phase_rad": [0.0, np.pi / 2],
        "slope_deg_per_kNm": [0.0, 0.2], "slope_phase_rad": [0.0, 1.0], "backward_slope_deg_per_kNm": [0.0, 0.3],
    }  # fmt: skip
    ratio = 240 * 1000 / 60 / 81 / 54
    answer = 0.04 * ratio**2 / (1 - ratio**2 + 0.04j * ratio * sign)
    expected = ((height + slope * torque / 1000) * answer * np.exp(240j * X)).real
    assert te(("structural_resonance", shape | sizes), sign=sign, torque=torque) == pytest.approx(expected, abs=1e-12)


def test_a_class_that_is_made_of_the_resonance_may_lack_its_load_part():
    """Its contribution was an error: both parts of the height were asked for."""

    class OfOneHeight(StructuralResonance):
        name = "of_one_height"
        phasors = (StructuralResonance.phasors[0],)

    values = {"orders": (240,), "frequency_Hz": 54.0, "damping_ratio": 0.02, "amplitude_deg": (0.1,)}
    at = Conditions.of([1, -1], [900, 1100], [0, 500], [30, 30])
    own, whole = (made(values, CONSTANTS) for made in (OfOneHeight, StructuralResonance))
    for effect in (own, whole):
        assert (effect.coefficient(at, 240) == effect.contribution(at, np.array([240]))[:, 0]).all()
    assert (own.coefficient(at, 240) == whole.coefficient(at, 240)).all()


def test_sidebands_follow_the_mesh_order():
    mesh = ("load_dependent_mesh", {"order": 78, "slope_deg_per_kNm": 0.02, "phase_rad": 1})
    sides = ("carrier_modulation", {"order": 78, "lower_ratio": 0.2, "lower_phase_rad": 0.5, "upper_ratio": 0.3})
    expected = 0.01 * (np.cos(78 * X + 1) + 0.2 * np.cos(75 * X + 1.5) + 0.3 * np.cos(81 * X + 1))
    assert te(mesh, sides) == pytest.approx(expected, abs=1e-12)


def test_sidebands_do_not_make_sidebands():
    mesh = ("cycloid_tooth_error", {"order": 78, "amplitude_deg": 0.02})
    one = ("carrier_modulation", {"order": 78, "upper_ratio": 0.5})
    other = ("carrier_modulation", {"order": 81, "upper_ratio": 0.5})
    assert te(mesh, one, other) == pytest.approx(te(mesh, one), abs=1e-15)


def test_delay_moves_the_curve_along_the_angle():
    wave = ("cycloid_tooth_error", {"order": 39, "amplitude_deg": 0.02})
    moved = X + 1000 / 60 / 81 * 2 * np.pi * 500e-6
    assert te(wave, ("measurement_delay", {"delay_us": 500}), sign=-1) == pytest.approx(
        0.02 * np.cos(39 * moved), abs=1e-12
    )


def test_coefficients_of_some_orders_equal_those_of_all():
    rig = read_rig(DEFAULT)
    at = Conditions.of([1, -1, 1], [100, 1100, 1800], [0, 900, 1800], [25, 30, 35])
    every = rig.coefficients(at, rig.orders())
    for order in (0, 36, 159, 240):
        assert rig.coefficients(at, [order])[:, 0] == pytest.approx(every[:, rig.orders().index(order)], abs=1e-15)


def test_control_lag_follows_a_ramp_and_a_sine():
    lag = ControlLag({"lag_ms": 20}, CONSTANTS)
    t = np.arange(0, 1, 1e-3)
    assert (100 * t - lag.motor_angle(t, 100 * t))[-1] == pytest.approx(100 * 0.02, rel=1e-9)
    w = 2 * np.pi * 5
    answer = lag.motor_angle(t, np.sin(w * t))[500:]
    exact = (np.exp(1j * w * t) / (1 + 1j * w * 0.02)).imag[500:]
    # linear between samples: error of (w*step)^2/12
    assert answer == pytest.approx(exact, abs=(w * 1e-3) ** 2 / 12)


def test_a_coupling_twists_under_the_torque_at_the_motor():
    """162 N m at the output of a reducer of 81 are 2 N m here; of the play it takes half."""
    coupling = CouplingCompliance({"stiffness_Nm_per_rad": 1000.0, "backlash_arcmin": 6.0}, CONSTANTS)
    twist = np.rad2deg(2e-3) + 0.05
    assert coupling.twist(Conditions.of([1, -1], 900, 162, 30)) == pytest.approx([-twist, twist])


def test_parameters_are_linear_where_they_say_so():
    """What reconcile relies on: doubling a LINEAR scalar doubles, halving an INVERSE one doubles."""
    at = Conditions.of([1, -1], [500, 1500], [300, 900], [25, 35])
    for name, (values, _) in FORMULAS.items():
        for scalar in KNOWN[name].scalars:
            if scalar.form is Form.SHAPE or scalar.key not in values:
                continue
            others = {s.key: np.inf if s.form is Form.INVERSE else 0.0 for s in KNOWN[name].scalars
                      if s.form is not Form.SHAPE}  # fmt: skip
            base = {k: v for k, v in values.items() if k not in others} | others
            factor = 2 if scalar.form is Form.LINEAR else 0.5
            one, two = (
                KNOWN[name](base | {scalar.key: values[scalar.key] * f}, CONSTANTS, check=False) for f in (1, factor)
            )
            orders = np.arange(90)
            assert two.contribution(at, orders) == pytest.approx(2 * one.contribution(at, orders), rel=1e-12)


def test_default_rig_reads_back_and_has_the_sizes_of_the_real_one():
    rig = read_rig(DEFAULT)
    assert rig.text() == DEFAULT.read_text()
    at = Conditions.of(1, 900, [0, 1800], 30)
    mean = rig.coefficients(at, [0, 1])
    assert np.diff(mean[:, 0].real)[0] / 1800 == pytest.approx(-3.67e-5, rel=0.08)
    assert abs(mean[:, 1]) == pytest.approx(0.0172, rel=1e-3)
    peak_to_peak = np.ptp(rig.curve(at, 4096), axis=1)
    assert (peak_to_peak > 0.036).all() and (peak_to_peak < 0.045).all()


def test_default_rig_is_what_its_script_writes():
    scope = {"__name__": "make_rig"}
    exec((DEFAULT.parent / "make_rig.py").read_text(), scope)
    assert scope["rig"]().text() == DEFAULT.read_text()


def test_all_problems_of_a_rig_file_in_one_message():
    text = """
[rig]
reduction_ratio = 0.5
pin = 40
[[effect]]
name = "backlsh"
[[effect]]
name = "backlash"
gap_arcmin = 30
[[effect]]
name = "pin_error"
order = 81
amplitude_deg = 0.1
phase = 3
[[effect]]
name = "structural_resonance"
orders = [40, 40]
frequency_Hz = 54
damping_ratio = 0.02
amplitude_deg = [0.1]
[efect]
"""
    with pytest.raises(InputError) as caught:
        parse_rig(text)
    message = str(caught.value)
    for part in (
        "unknown table [efect]; did you mean 'effect'?", "reduction_ratio = 0.5",
        "unknown key 'pin'; did you mean 'pins'?",
        "no effect 'backlsh'; did you mean 'backlash'?", "gap_arcmin = 30 is outside 0 .. 20 arcmin",
        "'seating_torque_Nm' is missing",
        "order: 81 is no order of this effect: ratio, teeth and pins of [rig] give 40, 80",
        "unknown key 'phase'; did you mean 'phase_rad'?",
        "an order stands there twice", "has 1 entry, orders has 2",
    ):  # fmt: skip
        assert part in message, part


def test_a_reducer_may_have_one_of_each_part():
    smallest = {"reduction_ratio": 1.0, "cycloid_teeth": 1, "pins": 1, "cranks": 1}
    rig = parse_rig("[rig]\n" + "".join(f"{key} = {number}\n" for key, number in smallest.items()))
    assert {key: getattr(rig.constants, key) for key in smallest} == smallest


OWN = """
import numpy as np
from st_codegen.rig.effects import Effect, Scalar

class Bump(Effect):
    name = "bump"
    title = "a bump"
    scalars = (Scalar("height_deg", "deg", -1, 1, "its height", None),)
    def touched_orders(self):
        return (7,)
    def contribution(self, at, orders):
        return self.scalar("height_deg") * np.outer(np.ones(len(at)), orders == 7).astype(complex)
"""


def test_an_effect_of_the_users_own(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    known = catalogue([tmp_path / "own.py"])
    text = '[rig]\nreduction_ratio = 81.0\n[[effect]]\nname = "bump"\nheight_deg = 0.5\n'
    rig = parse_rig(text, known=known)
    assert rig.te_deg([0, 90], 1, 100, 0, 30) == pytest.approx([0.5, 0.0], abs=1e-15)
    with pytest.raises(InputError, match="'bump'"):
        parse_rig(text)
    (tmp_path / "twice.py").write_text(re.sub('"bump"', '"wear"', OWN))
    with pytest.raises(InputError, match="exists already"):
        catalogue([tmp_path / "twice.py"])
    (tmp_path / "none.py").write_text("x = 1\n")
    with pytest.raises(InputError, match="no effect in it"):
        catalogue([tmp_path / "none.py"])


def test_effects_of_the_axis_leave_the_coefficients_alone():
    rig = read_rig(DEFAULT)
    without = rig.with_effects(effect for effect in rig.effects if effect.stage is not Stage.AXIS)
    at = Conditions.of(1, 900, 900, 30)
    assert (rig.coefficients(at, rig.orders()) == without.coefficients(at, rig.orders())).all()


TERMS_BY_HAND = {
    "constant": lambda n, m, t: 1.0,
    "speed": lambda n, m, t: n,
    "speed_square": lambda n, m, t: n * n,
    "inverse_speed": lambda n, m, t: 1 / n,
    "torque": lambda n, m, t: m,
    "torque_square": lambda n, m, t: m * m,
    "torque_cube": lambda n, m, t: m**3,
    "temperature": lambda n, m, t: t,
    "temperature_square": lambda n, m, t: t * t,
    "speed_torque": lambda n, m, t: n * m,
    "speed_temperature": lambda n, m, t: n * t,
    "torque_temperature": lambda n, m, t: m * t,
}


def test_terms_of_what_has_no_name_are_what_they_are_called():
    """In 1000 rpm, kNm, and 10 K above the reference temperature."""
    at = Conditions.of(1.0, [700.0, 1300.0], [900.0, 400.0], [24.0, 37.0])
    assert set(TERMS) == set(TERMS_BY_HAND)
    for name, by_hand in TERMS_BY_HAND.items():
        expected = by_hand(np.array([0.7, 1.3]), np.array([0.9, 0.4]), np.array([-0.6, 0.7]))
        np.testing.assert_allclose(term_values(name, at, 30.0), np.broadcast_to(expected, 2), rtol=1e-14)
