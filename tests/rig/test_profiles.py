"""Motion profiles: the paper's law, the robot's traits, files of the user and their faults."""

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.rig.profiles import PROFILES, cycloidal, profile_named, read_profile, robot

CYCLE = 1e-3


def test_eq_7():
    profile = cycloidal(CYCLE)
    t, h, period = profile.time_s, 360.0, 20.0
    assert t[-1] == pytest.approx(period)
    assert profile.angle_deg[0] == 0.0
    assert profile.angle_deg[-1] == pytest.approx(h)
    assert profile.torque_Nm.max() == pytest.approx(370.0)
    # speed 2 h / T in the middle: 36 deg/s, 6 rpm, 486 rpm at the motor
    facts = profile.facts(81.0)
    assert facts["speed_in_rpm"] == pytest.approx(486.0)
    assert facts["acceleration_deg_s2"] == pytest.approx(2 * np.pi * h / period**2, rel=1e-4)


def test_the_robot_has_the_traits_it_is_for():
    profile = robot(CYCLE)
    facts = profile.facts(81.0)
    assert facts["speed_out_rpm"] == pytest.approx(138 * 15 / 8 / 2.2 / 6, rel=1e-4)
    assert facts["speed_out_rpm"] < 22.2
    assert facts["acceleration_deg_s2"] > 150.0
    assert (np.diff(profile.direction) != 0.0).sum() == 2  # reversals
    assert (np.abs(profile.speed_deg_s) < 1e-9).mean() > 0.1  # dwells
    assert 360.0 < profile.torque_Nm.max() <= 370.0
    assert (profile.torque_Nm >= 0.0).all()


@pytest.mark.parametrize("name", PROFILES)
def test_speed_is_the_derivative_of_the_angle(name):
    profile = profile_named(name, CYCLE)
    middle = (profile.speed_deg_s[1:] + profile.speed_deg_s[:-1]) / 2
    # trapezoidal rule: T^2 / 12 times the third derivative, at most 60 * 8 / 0.6^3 deg/s3
    np.testing.assert_allclose(np.diff(profile.angle_deg) / CYCLE, middle, atol=CYCLE**2 / 12 * 2223 * 1.01)
    assert set(np.unique(profile.direction)) <= {-1.0, 1.0}


def test_direction_at_rest_is_the_last_one(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("t,theta_out,torque_Nm\n0,0,0\n1,0,0\n2,-10,50\n3,-10,50\n4,-5,0\n5,-5,0\n")
    profile = read_profile(path, 0.1)
    assert profile.direction[0] == -1.0
    assert profile.direction[25] == -1.0
    assert profile.direction[-1] == 1.0


def test_a_file_with_semicolons_and_commas(tmp_path):
    plain, other = tmp_path / "a.csv", tmp_path / "b.csv"
    plain.write_text("t,theta_out,torque_Nm\n0,0,1.5\n1,2.5,2\n2,5,2\n3,6,2\n")
    other.write_text("torque_Nm;t;theta_out;note\n1,5;10;0;x\n2;11;2,5;\n2;12;5;\n2;13;6;\n", encoding="utf-8-sig")
    one, two = read_profile(plain, 0.01), read_profile(other, 0.01)
    np.testing.assert_allclose(one.angle_deg, two.angle_deg)
    np.testing.assert_allclose(one.torque_Nm, two.torque_Nm)
    assert one.angle_deg.max() <= 6.0  # no overshoot
    assert len(one.time_s) == 301


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "missing"),
        ("t,theta,torque_Nm\n0,0,0\n", "theta_out"),
        ("t,theta_out,torque_Nm\n0,0,0\n1,1,0\n", "at least 4"),
        ("t,theta_out,torque_Nm\n0,0,0\n1,x,0\n2,1\n3,3,nan\n4,1,1\n", "line 4"),
        ("t,theta_out,torque_Nm\n0,0,0\n1,1,0\n1,2,0\n2,3,0\n", "line 4: the time must rise"),
        ("t,theta_out,torque_Nm\n0,0,0\n1,10000,0\n2,10001,0\n3,10002,0\n", "1667 rpm at the output: t is in s"),
        ("t,theta_out,torque_Nm\n0,0,0\n1,1,9e6\n2,2,0\n3,3,0\n", "line 3: 9e+06 at the output: torque_Nm is in N m"),
        ("t,theta_out,torque_Nm\n0,0,0\n1000,1,0\n2000,2,0\n3000,3,0\n", "longest"),
        ("t,theta_out,torque_Nm\n0,0,0\n1e-6,0,0\n2e-6,0,0\n3e-6,0,0\n", "a cycle of the main task"),
    ],
)
def test_faulty_files(tmp_path, text, part):
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_profile(path, CYCLE)
    assert part in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_profile_for_a_faster_and_stronger_reducer_than_the_papers_is_taken(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("t,theta_out,torque_Nm\n0,0,0\n1,300,9000\n2,600,9000\n3,900,0\n")
    profile = read_profile(path, CYCLE)
    assert (profile.angle_deg[-1], profile.torque_Nm.max()) == (900.0, 9000.0)


def test_unknown_names_and_missing_files(tmp_path):
    with pytest.raises(InputError, match="cycloidal, robot"):
        profile_named("sine", CYCLE)
    with pytest.raises(InputError, match="no such file"):
        profile_named(str(tmp_path / "none.csv"), CYCLE)
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="save it as UTF-8"):
        profile_named(str(tmp_path / "b.csv"), CYCLE)
