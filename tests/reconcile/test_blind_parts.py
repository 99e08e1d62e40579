"""The blind suite's own parts: noise as stated, layouts, files, scoring of hand-made reports."""

import math

import numpy as np
import pytest

from .blind import layout, noise, score, write

SIGMA = 3e-4


# ------------------------------------------------------------------------------------------------ noise


@pytest.mark.parametrize("model", ["white", "coloured", "heavy"])
def test_noise_of_coefficients_has_the_stated_size(model):
    sigma = np.array([SIGMA, 2 * SIGMA, 3 * SIGMA])
    drawn = noise.of_coefficients(np.random.default_rng(1), model, sigma, 2, 20000)
    # 40000 numbers: the standard deviation of Gaussian noise is known to 0.4 %, of coloured noise (correlation time
    # about 6 runs) to 0.9 %, of Student's t with 3.5 degrees of freedom to a few percent (no fourth moment)
    wide = 0.15 if model == "heavy" else 0.03
    assert drawn.real.std(axis=(1, 2)) == pytest.approx(sigma, rel=wide)
    assert drawn[1:].imag.std(axis=(1, 2)) == pytest.approx(sigma[1:], rel=wide)
    assert not drawn[0].imag.any()


def test_drift_of_coefficients_comes_on_top():
    drawn = noise.of_coefficients(np.random.default_rng(1), "drift", np.array([SIGMA]), 2, 5000)
    together = SIGMA * math.hypot(1.0, noise.DRIFT_SIZE)
    assert drawn.real.std() == pytest.approx(together, rel=0.05)
    # neighbours in time share the drift: half of the variance, at DRIFT_SIZE = 1
    series = drawn.real[0, 0]
    shared = np.corrcoef(series[1:], series[:-1])[0, 1]
    assert shared == pytest.approx(noise.DRIFT_SIZE**2 / (1 + noise.DRIFT_SIZE**2), abs=0.06)


@pytest.mark.parametrize("model", noise.MODELS)
def test_noise_of_samples(model):
    drawn = noise.of_samples(np.random.default_rng(2), model, SIGMA, (2, 40, 2048))
    assert drawn.shape == (2, 40, 2048)
    assert drawn.std() == pytest.approx(SIGMA, rel=0.06)
    lag = np.mean(drawn[..., 1:] * drawn[..., :-1]) / np.mean(drawn**2)
    expected = {"coloured": math.exp(-1 / noise.COLOUR_SAMPLES), "drift": 0.04}.get(model, 0.0)
    assert lag == pytest.approx(expected, abs=0.03)


def test_heavy_tails_are_heavy():
    drawn = noise.heavy(np.random.default_rng(3), (200_000,))
    assert np.mean(np.abs(drawn) > 4.0) > 20 * math.erfc(4.0 / math.sqrt(2.0))


# ------------------------------------------------------------------------------------------------ layouts and files


@pytest.mark.parametrize("name", layout.LAYOUTS)
@pytest.mark.parametrize("density", ["dense", "fine", "sparse"])
def test_layouts_stay_in_the_machine_s_range(name, density):
    runs = layout.conditions(np.random.default_rng(4), name, density)
    assert 30 <= len(runs) <= 250
    assert runs.speed_rpm.min() >= 100 and runs.speed_rpm.max() <= 1800
    assert runs.torque_Nm.min() >= 0 and runs.torque_Nm.max() <= 1800
    assert min(runs.levels()) >= 2
    assert np.any(np.diff(runs.speed_rpm) < 0), "in the order of time, not sorted"


def test_curve_files_run_backward_from_360(tmp_path):
    runs = layout.Conditions(np.array([100.0]), np.array([200.0]), np.array([25.0]))
    theta = np.arange(16) * 22.5
    te = np.stack([np.cos(np.radians(theta)), np.sin(np.radians(theta))])[:, None, :]
    (name,) = write.curves(tmp_path, runs, te, names_in_file=True)
    assert name == "100.0rpm200.0Nm25.0deg.csv"
    table = np.loadtxt(tmp_path / name, delimiter=",", skiprows=1)
    assert table[:, 1] == pytest.approx(np.cos(np.radians(table[:, 0])), abs=1e-8)
    assert table[0, 2] == 360.0 and np.all(np.diff(table[:, 2]) < 0)
    assert table[:, 3] == pytest.approx(np.sin(np.radians(table[:, 2])), abs=1e-8)


def test_harmonic_table_holds_amplitude_phase_and_a_signed_mean(tmp_path):
    runs = layout.Conditions(np.array([100.0]), np.array([200.0]), np.array([25.0]))
    numbers = np.array([[[-0.02 + 0j], [0.01 + 0j]], [[-3e-3j], [2e-3 + 0j]]])
    write.harmonic_table(tmp_path / "t.csv", runs, (0, 39), numbers)
    head, forward, backward = (tmp_path / "t.csv").read_text().split()
    assert head == "direction,speed_rpm,torque_Nm,temperature_C,A0,A39,phi39"
    assert forward.startswith("forward,100,200,25,-0.02,0.003,") and float(forward.split(",")[-1]) == pytest.approx(
        -math.pi / 2
    )
    assert backward == "backward,100,200,25,0.01,0.002,0"


# ------------------------------------------------------------------------------------------------ scoring


def effect(name, alternatives=(), **parameters):
    table = {key: {"value": value, "stderr": stderr, "unit": ""} for key, (value, stderr) in parameters.items()}
    return {"name": name, "orders": [], "parameters": table, "evidence": {}, "alternatives": list(alternatives)}


def report(*effects, verdict="explained", unexplained=(), after=1.0):
    part = {"before": 5.0, "after": after, "noise_floor": 1.0}
    entries = [{"order": order} for order in unexplained]
    text = {"verdict": verdict, "effects": effects, "unexplained": entries, "gap": {"fitted": part, "held_out": part}}
    return score.read_report(text)


COMPLIANCE = score.Expected("single", hidden={"torsional_compliance": {"stiffness_Nm_per_arcmin": 450.0}})


def test_right_name_and_parameter_pass():
    found = score.score(report(effect("torsional_compliance", stiffness_Nm_per_arcmin=(455.0, 1.0))), COMPLIANCE)
    assert found.passed and found.named and found.parameters_right
    assert found.gap_ratio == 1.0


def test_wrong_name_fails():
    found = score.score(report(effect("backlash")), COMPLIANCE)
    assert not found.passed and not found.named
    assert found.false_additions == ("backlash",) and found.missed == ("torsional_compliance",)


def test_a_false_addition_beside_the_right_name_fails():
    found = score.score(report(effect("torsional_compliance"), effect("wear")), COMPLIANCE)
    assert found.named and not found.passed and found.false_additions == ("wear",)


def test_a_name_only_among_the_alternatives_is_not_exact_and_not_false():
    found = score.score(report(effect("backlash", alternatives=["torsional_compliance"])), COMPLIANCE)
    assert not found.passed and not found.named and not found.false_additions
    assert found.hedged == ("torsional_compliance",)


@pytest.mark.parametrize(
    ("value", "stderr", "right"), [(472, 0.1, True), (474, 0.1, False), (500, 17, True), (500, 16, False)]
)
def test_parameters_within_5_percent_or_3_standard_errors(value, stderr, right):
    found = score.score(report(effect("torsional_compliance", stiffness_Nm_per_arcmin=(value, stderr))), COMPLIANCE)
    assert found.parameters_right is right


def test_phases_wrap():
    assert score.judge_parameter("phase_deg", 179.0, -180.0, None)["error"] == pytest.approx(1.0)
    assert score.judge_parameter("phase_deg", 179.0, -180.0, None)["right"]
    assert score.judge_parameter("phase_rad", math.pi - 0.01, 0.01 - math.pi, None)["error"] == pytest.approx(0.02)
    assert not score.judge_parameter("phase_deg", 10.0, 14.0, 1.0)["right"]


def test_a_parameter_that_is_not_reported_is_wrong():
    found = score.score(report(effect("torsional_compliance")), COMPLIANCE)
    assert found.parameters_right is False


def test_silence_is_right_where_nothing_is_missing():
    nothing = score.Expected("none")
    assert score.score(report(verdict="nothing_missing"), nothing).passed
    assert not score.score(report(effect("wear")), nothing).passed
    assert not score.score(report(verdict="explained"), nothing).passed
    # known parameters that were off are no missing effect: they are fitted, and nothing is added
    assert score.score(report(verdict="explained"), score.Expected("none", drifted=True)).passed
    assert not score.score(report(verdict="unexplained", unexplained=[7]), nothing).passed


def test_weak_effects_must_not_be_claimed_even_by_their_name():
    weak = score.Expected("weak", hidden={"wear": {}})
    found = score.score(report(effect("wear")), weak)
    assert not found.passed and not found.false_additions
    assert score.score(report(verdict="nothing_missing"), weak).passed


def test_what_is_not_in_the_catalogue_must_not_get_a_name():
    foreign = score.Expected("foreign", orders=(7,))
    good = score.score(report(verdict="unexplained", unexplained=[7.0]), foreign)
    assert good.passed and not good.remarks
    vague = score.score(report(verdict="unexplained", unexplained=[9.0]), foreign)
    assert vague.passed and vague.remarks, "no wrong name, and the missing signature is remarked on"
    assert not score.score(report(effect("wear"), unexplained=[7.0]), foreign).passed


def test_confounded_effects_are_right_only_as_alternatives():
    group = frozenset(("output_shaft_eccentricity", "encoder_eccentricity"))
    both = score.Expected("confounded", hidden={"encoder_eccentricity": {}}, groups=(group,))
    assert score.score(report(effect("output_shaft_eccentricity", ["encoder_eccentricity"])), both).passed
    assert not score.score(report(effect("encoder_eccentricity")), both).passed, "true, but not known from these data"
    extra = report(effect("encoder_eccentricity", ["output_shaft_eccentricity"]), effect("wear"))
    assert score.score(extra, both).false_additions == ("wear",)


def test_corrupt_runs_are_recognised_by_condition_or_file():
    said = ["1120 rpm, 1350 Nm, 30 degC, backward: far from its neighbours", "run_0003.csv: a burst"]
    assert score.suspected(["1120 rpm, 1350 N m", "120 rpm, 0 N m"], said) == 1
    assert score.suspected(["run_0003.csv = 5 rpm, 6 N m", "run_0004.csv = 5 rpm, 7 N m"], said) == 1


def test_gap_in_either_order_of_keys():
    one = {
        "fitted": {"before": 3.0, "after": 1.0, "noise_floor": 0.9},
        "held_out": {"before": 3.5, "after": 1.2, "noise_floor": 1.0},
    }
    other = {key: {part: one[part][key] for part in one} for key in ("before", "after", "noise_floor")}
    base = {"verdict": "explained", "effects": [], "unexplained": []}
    assert score.read_report(base | {"gap": one}).gap == score.read_report(base | {"gap": other}).gap == one


def test_wilson_interval():
    # Wilson's interval for 10 of 10 and 0 of 10 from its closed form, and a symmetric one
    assert score.wilson(0, 10).high == pytest.approx(3.8416 / 13.8416, abs=1e-4)
    assert score.wilson(10, 10).low == pytest.approx(10 / 13.8416, abs=1e-4)
    half = score.wilson(50, 100)
    assert half.low + half.high == pytest.approx(1.0) and half.low == pytest.approx(0.4038, abs=1e-4)
    assert math.isnan(score.wilson(0, 0).share)
