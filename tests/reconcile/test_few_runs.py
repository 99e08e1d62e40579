"""A dozen runs, whose means differ from run to run: what they name, and what they leave open."""

import numpy as np
import pytest

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.report.sentences import verdict_text
from st_codegen.reconcile.report.summary import summary
from st_codegen.rig.effects import Conditions, catalogue
from st_codegen.rig.model import parse_rig
from tests.reconcile.test_form_errors import HEAD

KNOWN = catalogue()
ORDERS = [0, 1, 2, 3, 39, 40, 78, 240]
RIG = (
    HEAD
    + """[noise]
run_offset_deg = {said}
[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = {stiffness}
[[effect]]
name = "backlash"
gap_arcmin = {gap}
seating_torque_Nm = 60.0
[[effect]]
name = "friction_windup"
coulomb_arcmin = 0.25
viscous_arcmin_per_krpm = 0.02
viscosity_decay_per_K = 0.04
[[effect]]
name = "thermal_drift"
drift_arcmin_per_K = {drift}
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = {eccentricity}
phase_rad = 0.3
[[effect]]
name = "crank_misalignment"
amplitude_deg = 0.00056
phase_rad = 1.5
backward_amplitude_deg = 0.00082
backward_phase_rad = 1.8
slope_deg_per_kNm = 0.00033
slope_phase_rad = 2.4
backward_slope_deg_per_kNm = 0.00043
backward_slope_phase_rad = 0.25
[[effect]]
name = "pin_error"
order = 240
amplitude_deg = 2e-4
phase_rad = 2.0
"""
)
OWN = {"stiffness": 454.0, "gap": 0.3, "drift": 0.008, "eccentricity": 0.0172}


def reconciled(truth, *, said=0.0, scatter=1e-3, wave_scatter=0.0, points=12, seed=0, added=None):
    """Curves of scattered runs of a machine that differs from the rig (OWN) by `truth`, and by `added` in its mean.

    scatter: of the mean from run to run, deg; said: what the rig says of it; wave_scatter: of waves, a share of each.
    """
    random = np.random.default_rng(seed)
    torque, speed = np.linspace(0.0, 1200.0, points), random.permutation(np.linspace(300.0, 1800.0, points))
    oil = random.choice([25.0, 35.0, 45.0], points)
    at = Conditions.of(np.repeat([1.0, -1.0], points), *(np.tile(part, 2) for part in (speed, torque, oil)))
    values = parse_rig(RIG.format(said=said, **{**OWN, **truth}), known=KNOWN).coefficients(at, ORDERS)

    def normal(shape):
        return random.standard_normal(shape) + 1j * random.standard_normal(shape)

    values[:, 1:] *= 1.0 + wave_scatter * normal((len(at), len(ORDERS) - 1))
    values += 1e-5 * normal(values.shape)
    values[:, 0] = values[:, 0].real + scatter * random.standard_normal(len(at))
    if added is not None:
        values[:, 0] += added(at)
    data = Observations(at, labels(at), np.array(ORDERS), values, spectral_deg=np.full(values.shape, 1e-5))
    return reconcile_observations(parse_rig(RIG.format(said=said, **OWN), known=KNOWN), data, KNOWN)


@pytest.mark.parametrize("said", [0.0, 1e-3])
@pytest.mark.parametrize(
    ("own", "value", "key"),
    [
        ("stiffness", 380.0, "stiffness_Nm_per_arcmin"),
        ("gap", 1.1, "gap_arcmin"),
        ("drift", 0.05, "drift_arcmin_per_K"),
    ],
)
def test_another_parameter_of_the_mean_has_a_name_though_runs_differ(own, value, key, said):
    """No effect of the catalogue was said to be found, though the law of the one that changed was told beside it."""
    result = reconciled({own: value}, said=said)
    (changed,) = result.conclusions.retuned
    assert changed.after.scalar(key) == pytest.approx(value, abs=3.0 * changed.stderr[key])
    assert changed.stderr[key] < 0.25 * value
    assert "something_else" in changed.alternatives
    assert verdict_text(result).startswith("What is named fits, and other causes may fit so few operating points")
    # what the rig says of its runs is no news
    assert ("runs differ by more than the noise within their curves" in verdict_text(result)) == (said == 0.0)


def test_a_wave_that_differs_from_run_to_run_has_another_size():
    result = reconciled({"eccentricity": 0.0150}, wave_scatter=0.02)
    (changed,) = result.conclusions.retuned
    error = changed.stderr["amplitude_deg"]
    assert changed.after.scalar("amplitude_deg") == pytest.approx(0.0150, abs=3.0 * error)
    assert error < 2e-4


@pytest.mark.parametrize(("points", "share", "seed"), [(6, 0.03, 0), (6, 0.03, 1), (5, 0.0, 6)])
def test_scatter_alone_changes_nothing(points, share, seed):
    """Eight numbers of one order follow ten curves: the last were crankshafts that had changed, by chance 4e-8."""
    result = reconciled({}, wave_scatter=share, points=points, seed=seed)
    assert result.conclusions.effects == ()


def test_a_law_that_is_none_of_the_effect_is_no_change_of_it():
    """A twist by the square of the load was another stiffness, by 12 %."""
    result = reconciled({}, scatter=3e-4, said=3e-4, added=lambda at: -at.sign * 0.008 * (at.torque_Nm / 1200) ** 2)
    assert result.conclusions.retuned == ()
    assert verdict_text(result) == "Something differs; so few operating points name no effect of the catalogue for it."
    assert "the mean grows with the square of the torque" in summary(result)


def test_two_parameters_of_the_mean_changed_where_they_leave_what_is_noise_for_sure():
    result = reconciled({"stiffness": 380.0, "gap": 1.1}, scatter=3e-4, said=3e-4, points=20)
    found = {one.after.name: one for one in result.conclusions.retuned}
    assert found.keys() == {"torsional_compliance", "backlash"}
    for name, key, value in (
        ("torsional_compliance", "stiffness_Nm_per_arcmin", 380.0),
        ("backlash", "gap_arcmin", 1.1),
    ):
        assert found[name].after.scalar(key) == pytest.approx(value, abs=3.0 * found[name].stderr[key])


def test_what_is_left_beside_a_law_may_be_what_runs_differ_by():
    """It was no noise, and the law was said to be another one."""
    result = reconciled({}, scatter=8e-4, points=20, added=lambda at: 0.02 * (at.torque_Nm / 1200) ** 2)
    (one,) = result.unexplained
    assert one.order == 0 and "grows with the square of the torque" in one.text
    assert "is no noise" not in one.text


def test_a_law_that_nothing_of_the_rig_makes_is_no_new_effect():
    """A twist by the square of the speed was said to be a skew of the encoders."""
    for seed in range(3):
        result = reconciled({}, seed=seed, added=lambda at: at.sign * 0.01 * (at.speed_rpm / 1800) ** 2)
        assert result.conclusions.effects == ()
        assert "grows with the square of the speed" in summary(result)


@pytest.mark.parametrize("seed", range(3))
def test_no_two_parameters_changed_for_one_law_where_nobody_told_the_scatter(seed):
    """A twist by the root of the load was said to be another stiffness and three times the backlash."""
    result = reconciled({}, seed=seed, added=lambda at: -at.sign * 0.02 * np.sqrt(at.torque_Nm / 1200))
    assert len(result.conclusions.retuned) < 2


@pytest.mark.parametrize("said", [0.0, 3e-4])
def test_what_is_gone_is_gone_whether_the_scatter_is_told_or_not(said):
    result = reconciled({"gap": 0.001}, said=said, scatter=3e-4, points=20)
    (changed,) = result.conclusions.retuned
    assert changed.before.name == "backlash" and changed.is_gone


@pytest.mark.parametrize("seed", range(3))
def test_few_runs_are_no_quieter_than_their_curves(seed):
    """By chance they lay nearer to each other: six points said of a resonance that did not change another damping."""
    result = reconciled({}, scatter=0.0, points=6, seed=seed)
    assert (result.noise.sigma >= result.data.spectral_deg).all()
