"""Changes that no order shows by a pattern over the conditions: runs scatter, and the mean is a little too loud."""

import numpy as np
import pytest

from st_codegen.reconcile.core import Reconciliation, reconcile_observations
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.report.summary import summary
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import parse_rig

from .test_form_errors import HEAD as GEAR
from .test_form_errors import KNOWN

ORDERS = [0, 1, 2, 3, 39, 40, 57, 78, 80, 90, 110, 130]
HEAD = (
    GEAR
    + """[noise]
run_offset_deg = {run_offset_deg}
[[effect]]
name = "backlash"
gap_arcmin = 0.3
seating_torque_Nm = 45.0
[[effect]]
name = "friction_windup"
coulomb_arcmin = 0.25
viscous_arcmin_per_krpm = 0.1
[[effect]]
name = "thermal_drift"
drift_arcmin_per_K = 0.008
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.02
phase_rad = 1.0
[[effect]]
name = "cycloid_tooth_error"
order = 39
amplitude_deg = 7e-4
phase_rad = 0.3
[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = """
)


def reconciled(
    seed: int, stiffness: float, runs: int, scatter_deg: float, *, gain: float = 1.0, said: float | None = None
) -> Reconciliation:
    """Scattered runs, curves of quiet noise, of a machine with another stiffness and gain than the rig (600, 1).

    scatter_deg: of the mean from run to run; said: what the rig says of that.
    """
    random = np.random.default_rng(seed)
    speed, torque, oil = (np.tile(random.uniform(*ends, runs), 2) for ends in ((150, 1700), (0, 1600), (22, 42)))
    at = Conditions.of(np.repeat([1.0, -1.0], runs), speed, torque, oil)
    head = HEAD.format(run_offset_deg=scatter_deg if said is None else said)
    values = gain * parse_rig(f"{head}{stiffness}\n", known=KNOWN).coefficients(at, ORDERS)
    values = values + 3e-5 * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    values[:, 0] = values[:, 0].real + scatter_deg * random.standard_normal(2 * runs)
    data = Observations(at, labels(at), np.array(ORDERS), values, spectral_deg=np.full(values.shape, 3e-5))
    return reconcile_observations(parse_rig(f"{head}600.0\n", known=KNOWN), data, KNOWN)


@pytest.mark.parametrize("stiffness", [552.0, 655.0])
def test_a_change_that_only_the_size_of_what_is_left_shows_has_a_name(stiffness):
    """The mean was unexplained, "most of it the same in all runs of a direction"; nothing was said to have changed."""
    result = reconciled(1, stiffness, 30, 2e-3)
    (changed,) = result.conclusions.retuned
    error = changed.stderr["stiffness_Nm_per_arcmin"]
    assert changed.after.scalar("stiffness_Nm_per_arcmin") == pytest.approx(stiffness, abs=3.0 * error)
    assert error < 25.0 and result.verdict == "explained"


@pytest.mark.parametrize("runs", [6, 12, 20])
def test_what_the_rig_says_that_means_differ_by_is_noise_in_a_dozen_runs_as_well(runs):
    """Of 6 runs the stiffness had changed; of 12 or 20 the mean was unexplained, and "what is left is no noise"."""
    result = reconciled(1, 450.0, runs, 1e-3)
    (changed,) = result.conclusions.retuned
    error = changed.stderr["stiffness_Nm_per_arcmin"]
    assert changed.after.scalar("stiffness_Nm_per_arcmin") == pytest.approx(450.0, abs=2.0 * error)
    assert error < 15.0 and changed.is_open and not result.unexplained


def test_what_takes_off_a_pattern_has_a_name_where_runs_differ_by_more_as_well():
    """Runs differed three times as much as the rig says: the mean depended "on the conditions", and nothing changed."""
    result = reconciled(1, 500.0, 40, 3e-3, said=1e-3)
    (changed,) = result.conclusions.retuned
    error = changed.stderr["stiffness_Nm_per_arcmin"]
    assert changed.after.scalar("stiffness_Nm_per_arcmin") == pytest.approx(500.0, abs=2.0 * error) and error < 40.0
    (rest,) = result.unexplained
    assert "with no pattern over the conditions" in rest.text and result.verdict == "partly_explained"


def test_a_reading_leaves_no_noise_where_it_would_be_said_to_be_unexplained():
    """All TE too high left "nothing but noise" of the mean, in which runs differed beyond the noise once accepted."""
    said = summary(reconciled(3, 600.0, 30, 1e-3, gain=1.045, said=0.0))
    assert "% too high would explain the change of" in said
    assert "would leave no more than runs differ by of what is unexplained in the mean" in said
    assert "nothing but noise" not in said
