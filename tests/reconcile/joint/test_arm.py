"""A two-link arm: torques by Lagrange's equations of both links, friction and ripple of each joint on top of them."""

import numpy as np
import pytest

from st_codegen.reconcile.joint.findings import findings, measurement, signatures
from st_codegen.reconcile.joint.reading import JointRecording
from st_codegen.reconcile.joint.rows import rows_of
from st_codegen.reconcile.joint.run import reconcile_joints

pytestmark = pytest.mark.thorough

STEP, SECONDS, GRAVITY = 2e-3, 40.0, 9.81
#: kg, m, m, kg m^2 of the links; kg m^2 of the motors; dry (N m), viscous (N m s), ripple (N m, per revolution)
FIRST = {"dry": 6.0, "viscous": 5.0, "ripple": 1.2, "order": 200}
SECOND = {"dry": 2.5, "viscous": 2.0, "ripple": 0.5, "order": 160}
NOISE = (0.3, 0.1)


def path(t, seed, size, period, harmonics=5):
    """Angle, speed and acceleration of a sum of harmonics."""
    random = np.random.default_rng(seed)
    found = np.zeros((3, len(t)))
    for k in range(1, harmonics + 1):
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
        _, after, floor = result.gap
        assert (f"{np.sqrt(after**2 - floor**2):.2g} N m RMS on left-out stretches" in said) == (after > 1.25 * floor)
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


#: Six joints: axis, way to the next joint (m), mass (kg), motor (kg m^2), friction dry (N m) and viscous, ripple (N m)
CHAIN = (
    ((0, 0, 1), (0, 0, 0.35), 20.0, 3.0, 9.0, 8.0, 1.5, 160),
    ((0, 1, 0), (0, 0, 0.45), 15.0, 3.0, 10.0, 9.0, 1.5, 160),
    ((0, 1, 0), (0.05, 0, 0.1), 8.0, 1.2, 6.0, 5.0, 0.0, 0),
    ((1, 0, 0), (0.3, 0, 0), 5.0, 0.4, 2.5, 2.0, 0.4, 100),
    ((0, 1, 0), (0.08, 0, 0), 2.5, 0.3, 2.0, 1.5, 0.0, 0),
    ((1, 0, 0), (0.05, 0, 0), 1.0, 0.15, 1.2, 0.8, 0.2, 100),
)


def turned(axis, angle):
    """Rotations about a unit axis (Rodrigues), (n, 3, 3)."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]], float)
    return np.eye(3) + np.sin(angle)[:, None, None] * k + (1 - np.cos(angle))[:, None, None] * (k @ k)


def chain_torques(moves):
    """Inverse dynamics of the chain by the recursion of Newton and Euler, N m (6, n); x, y, z of the world."""
    random, n = np.random.default_rng(4), moves[0].shape[1]
    frame = np.tile(np.eye(3), (n, 1, 1))
    turn, spin, lift = np.zeros((n, 3)), np.zeros((n, 3)), np.tile([0.0, 0.0, GRAVITY], (n, 1))
    links = []
    for (q, v, a), (axis, way, mass, *_) in zip(moves, CHAIN, strict=True):
        z = frame @ np.array(axis, float)
        spin = spin + z * a[:, None] + np.cross(turn, z * v[:, None])
        turn = turn + z * v[:, None]
        frame = frame @ turned(axis, q)
        end, middle = frame @ np.array(way, float), frame @ (np.array(way) / 2 + 0.02 * random.normal(size=3))
        inertia = frame @ np.diag(mass * random.uniform(0.005, 0.03, 3)) @ frame.transpose(0, 2, 1)
        own = (inertia @ turn[:, :, None])[..., 0]
        force = mass * (lift + np.cross(spin, middle) + np.cross(turn, np.cross(turn, middle)))
        links.append((z, end, middle, force, (inertia @ spin[:, :, None])[..., 0] + np.cross(turn, own)))
        lift = lift + np.cross(spin, end) + np.cross(turn, np.cross(turn, end))
    found, force, moment = [], np.zeros((n, 3)), np.zeros((n, 3))
    for z, end, middle, own, own_moment in reversed(links):
        moment = own_moment + moment + np.cross(middle, own) + np.cross(end, force)
        force = force + own
        found.append((z * moment).sum(axis=1))
    return found[::-1]


@pytest.mark.slow
def test_six_joints_of_an_arm_have_their_own_friction_and_ripple():
    """Before, two of the six had a friction at all, and one of the ripples was found."""
    t = np.arange(0, 80.0, 4e-3)
    random = np.random.default_rng(21)
    moves = [path(t, 30 + number, 0.8, 20.0, 8) for number in range(6)]
    angle, torque = {}, {}
    for name, (q, v, a), pure, joint in zip("123456", moves, chain_torques(moves), CHAIN, strict=True):
        *_, motor, dry, viscous, ripple, order = joint
        torque[name] = pure + motor * a + dry * np.tanh(v / 0.003) + viscous * v + ripple * np.sin(order * q)
        torque[name] += 0.01 * torque[name].std() * random.standard_normal(len(t))
        angle[name] = np.round(q / 1e-5) * 1e-5
    results = reconcile_joints([JointRecording("arm.csv", 4e-3, angle, dict.fromkeys("123456"), torque)])
    for result, joint in zip(results, CHAIN, strict=True):
        *_, dry, viscous, ripple, order = joint
        found = {one.name: one.parameters for one in findings(result, None)}
        assert set(found) == {"dry_friction", "viscous_friction", *(["torque_ripple"] if ripple else [])}
        for name, key, true in (
            ("dry_friction", "dry_friction_Nm", dry),
            ("viscous_friction", "viscous_friction_Nm_s", viscous),
        ):
            value, error, _ = found[name][key]
            assert abs(value - true) < 3 * error and error < 0.5 * true
        if ripple:
            assert found["torque_ripple"]["order_per_revolution"][0] == pytest.approx(order, rel=0.02)
            assert found["torque_ripple"]["amplitude_Nm"][0] == pytest.approx(ripple, rel=0.1)


def test_many_joints_stay_within_bounds():
    """Two arms in one file: pairs of joints are those of the six nearest, so that columns grow as the joints do."""
    one = arm(10.0)
    many = {str(number): one.angle["12"[number % 2]][:4000] * (1 + 0.01 * number) for number in range(1, 15)}
    torque = {name: np.zeros(4000) for name in many}
    rows = rows_of([JointRecording("arms.csv", STEP, many, dict.fromkeys(many), torque)], "3")
    fewer = {name: many[name] for name in list(many)[:8]}
    less = rows_of([JointRecording("arm.csv", STEP, fewer, dict.fromkeys(fewer), torque)], "3")
    pairs = 6 * 5 // 2 * 31
    assert rows.others.shape[1] - pairs == 13 * (less.others.shape[1] - pairs) // 7 < 1000
