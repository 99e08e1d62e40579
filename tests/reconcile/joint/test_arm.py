"""A two-link arm: torques by Lagrange's equations of both links, friction and ripple of each joint on top of them."""

import numpy as np
import pytest

from st_codegen.reconcile.joint.findings import findings, measurement, signatures
from st_codegen.reconcile.joint.reading import JointRecording
from st_codegen.reconcile.joint.rows import rows_of
from st_codegen.reconcile.joint.run import reconcile_joints

STEP, SECONDS, GRAVITY = 2e-3, 40.0, 9.81
#: kg, m, m, kg m^2 of the links; kg m^2 of the motors; dry (N m), viscous (N m s), ripple (N m, per revolution)
FIRST = {"dry": 6.0, "viscous": 5.0, "ripple": 1.2, "order": 200}
SECOND = {"dry": 2.5, "viscous": 2.0, "ripple": 0.5, "order": 160}
NOISE = (0.3, 0.1)


def path(t, seed, size, period):
    """Angle, speed and acceleration of a sum of five harmonics."""
    random = np.random.default_rng(seed)
    found = np.zeros((3, len(t)))
    for k in range(1, 6):
        w, c = 2 * np.pi * k / period, complex(*random.normal(size=2)) * size / k**1.2
        wave = c * np.exp(1j * w * t)
        found += [wave.real, -w * wave.imag, -(w**2) * wave.real]
    return found


def torques(one, two):
    """Inverse dynamics of two links in a vertical plane (any textbook of robotics), N m."""
    (q1, v1, a1), (q2, v2, a2) = one, two
    m1, m2, l1, c1, c2, i1, i2 = 12.0, 6.0, 0.45, 0.22, 0.2, 0.5, 0.2
    own2 = i2 + m2 * c2**2
    both = own2 + m2 * l1 * c2 * np.cos(q2)
    whole = i1 + own2 + m1 * c1**2 + m2 * (l1**2 + 2 * l1 * c2 * np.cos(q2))
    turn, weight = m2 * l1 * c2 * np.sin(q2), m2 * c2 * GRAVITY * np.cos(q1 + q2)
    return (
        (whole + 2.0) * a1 + both * a2 - turn * (v2**2 + 2 * v1 * v2) + weight
        + (m1 * c1 + m2 * l1) * GRAVITY * np.cos(q1),
        both * a1 + (own2 + 0.8) * a2 + turn * v1**2 + weight,
    )  # fmt: skip


def arm(period):
    """A recording of both joints, with noise of the torques and an encoder of 20 bits."""
    t = np.arange(0, SECONDS, STEP)
    random = np.random.default_rng(7)
    moves = [path(t, seed, size, period) for seed, size in ((1, 0.7), (2, 0.9))]
    angle, torque = {}, {}
    for name, (q, v, _), pure, joint, noise in zip("12", moves, torques(*moves), (FIRST, SECOND), NOISE, strict=True):
        friction = joint["dry"] * np.tanh(v / 0.005) + joint["viscous"] * v
        ripple = joint["ripple"] * np.sin(joint["order"] * q + 0.3)
        torque[name] = pure + friction + ripple + noise * random.standard_normal(len(t))
        angle[name] = np.round(q * 2**20 / (2 * np.pi)) * (2 * np.pi / 2**20)
    return JointRecording("arm.csv", STEP, angle, dict.fromkeys("12"), torque)


@pytest.mark.parametrize("period", [10.0, 41.0])
def test_what_the_other_link_does_hides_neither_friction_nor_ripple(period):
    """It was a shift of the torque, an inertia that depends on the frequency, and no ripple."""
    for result, joint in zip(reconcile_joints([arm(period)]), (FIRST, SECOND), strict=True):
        found = {one.name: one.parameters for one in findings(result, None)}
        assert {"dry_friction", "viscous_friction", "torque_ripple"} == set(found)
        for name, key, true in (
            ("dry_friction", "dry_friction_Nm", joint["dry"]),
            ("viscous_friction", "viscous_friction_Nm_s", joint["viscous"]),
            ("torque_ripple", "order_per_revolution", joint["order"]),
        ):
            value, error, _ = found[name][key]
            assert value == pytest.approx(true, rel=0.1)
            assert abs(value - true) < 3 * error
        assert found["torque_ripple"]["amplitude_Nm"][0] == pytest.approx(joint["ripple"], rel=0.15)
        said = " ".join(measurement(result) + signatures(result))
        assert "follows the motion of other joints" in said
        assert "shifted" not in said and "inertia that depends" not in said


def test_a_motion_that_repeats_is_left_out_in_every_round():
    recording = arm(10.0)
    rows = rows_of([recording], "1")
    phase = rows.time % 10.0
    for number in range(12):
        own = phase[rows.block == number]
        assert np.ptp(own) <= 10.0 / 12 + STEP
        assert len(np.unique((rows.time[rows.block == number] / 10.0).astype(int))) == 4
    once = rows_of([arm(41.0)], "1")
    assert (np.diff(once.block) >= 0).all()
