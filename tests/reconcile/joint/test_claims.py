"""Sentences on joints that other physics showed to be false: each stands for one that was said."""

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.joint import run as joint_run
from st_codegen.reconcile.joint.findings import findings, signatures
from st_codegen.reconcile.joint.mode import JointResponse, find_mode, is_rigid
from st_codegen.reconcile.joint.reading import JointRecording, read_joints
from st_codegen.reconcile.joint.rows import rows_of
from st_codegen.reconcile.joint.run import reconcile_joints
from tests.cli.helpers import run

from .machine import Joint, Measured, simulate, write
from .test_joint import changed, named, plain, report

pytestmark = pytest.mark.thorough


def sine(dry=0.0, viscous=0.0, square=0.0):
    """A motion of one sine, of which all that depends on it is a wave of few harmonics."""
    random, t = np.random.default_rng(0), np.arange(0.0, 40.0, 1e-3)
    w = 0.4 * np.pi
    q, v = np.sin(w * t), w * np.cos(w * t)
    tau = 0.3 - 1.5 * w**2 * q + 8.0 * np.cos(q) + dry * np.sign(v) + viscous * v + square * v * np.abs(v)
    noise = random.standard_normal((2, len(t)))
    return {"t": t, "q": q + 2e-6 * noise[0], "dq": v, "tau": tau + 0.02 * noise[1]}


def test_friction_of_one_sine_is_not_called_friction_by_the_load(tmp_path):
    """It said 0.296 +- 0.02 of the torque through the joint, and an inertia with an elasticity."""
    (joint,) = report(sine(dry=1.2, viscous=0.9), tmp_path)
    found = named(joint)
    assert set(found) == {"dry_friction", "viscous_friction"}
    for name, key, truth in (("dry", "_Nm", 1.2), ("viscous", "_Nm_s", 0.9)):
        value = found[f"{name}_friction"]["parameters"][f"{name}_friction{key}"]
        assert abs(value["value"] - truth) < 3 * value["stderr"]


def test_an_inertia_that_noise_of_the_angle_makes_smaller_is_no_elasticity(tmp_path):
    (joint,) = report(sine(), tmp_path)
    assert (joint["verdict"], joint["effects"], joint["unexplained"]) == ("nothing_missing", [], [])


def test_a_torque_that_is_later_than_the_first_shifts_tried(tmp_path):
    """Of 60 ms it said 32 ms, the last one that was tried, and 2.3 +- 0.7 N m per rad/s in place of 0.9."""
    columns = plain(viscous=0.9)
    (joint,) = report(columns | {"tau": np.roll(columns["tau"], 14)}, tmp_path)
    (late,) = (text for text in joint["measurement"] if "later" in text)
    assert late.startswith("tau is as if 70 ms later")
    value = named(joint)["viscous_friction"]["parameters"]["viscous_friction_Nm_s"]
    assert abs(value["value"] - 0.9) < 3 * value["stderr"]


def test_where_one_speed_tells_no_forms_apart_friction_is_one_finding(tmp_path):
    random, t = np.random.default_rng(0), np.arange(0.0, 40.0, 1e-3)
    bell = np.hanning(401) / np.hanning(401).sum()
    v = np.convolve(np.where(t % 6.0 < 3.0, 0.5, -0.5), bell, "same")
    q = np.cumsum(v) * 1e-3
    tau = 1.5 * np.gradient(v, 1e-3) + 8.0 * np.cos(q) + 1.2 * np.tanh(v / 1e-4) + 0.9 * v
    columns = {
        "t": t,
        "q": q + 2e-6 * random.standard_normal(len(t)),
        "tau": tau + 0.02 * random.standard_normal(len(t)),
    }
    (joint,) = report(columns, tmp_path)
    (found,) = (one for one in joint["effects"] if "friction" in one["name"])
    value = found["parameters"]["friction_Nm"]
    assert abs(value["value"] - 1.65) < 2 * value["stderr"] < 0.6


def test_no_direction_has_friction_that_rises_by_less_than_nothing(tmp_path):
    columns = plain()
    (joint,) = report(columns | {"tau": columns["tau"] - 0.3 * np.abs(columns["dq"])}, tmp_path)
    text = named(joint)["direction_dependent_friction"]["text"]
    assert text.startswith("friction that rises more with speed in the negative direction, by twice 0.")


def test_what_is_left_out_are_values_and_no_samples(tmp_path):
    columns = plain()
    columns["tau"][[700, 2900]] += 50.0
    (joint,) = report(columns, tmp_path)
    (text,) = (text for text in joint["measurement"] if "left out" in text)
    assert "values of the smoothed torque" in text and "at a reversal" in text


def test_the_scale_of_the_torque_is_said_to_be_taken_as_it_is(tmp_path):
    (joint,) = report(plain(), tmp_path)
    assert any("torque constant" in text for text in joint["cannot_show"])


def response(value, frequency):
    """A response with an error of one percent, the same in both halves."""
    error = 0.01 * np.abs(value)
    return JointResponse(frequency, value, error, (value, value), 2**0.5 * error)


def test_a_mode_is_sought_among_those_that_can_be_one():
    """Another form that fitted better, and was no mode, kept the true one from being named."""
    frequency = np.linspace(1.0, 100.0, 200)
    s = 2j * np.pi * frequency
    w = 2 * np.pi * 30.0
    behind = 1.8 * (1 + 0.06 * s / w + (s / w) ** 2) / (1 + 1.4 * s / 622.0 + (s / 622.0) ** 2)
    found = response(behind, frequency)
    mode = find_mode(found)
    assert mode is not None and mode.resonance_Hz == pytest.approx(30.0, rel=0.01)
    assert not is_rigid(found) and is_rigid(response(1.8 + 0.5 / s, frequency))


def test_a_joint_that_is_not_rigid_is_not_said_to_have_its_elasticity_elsewhere(tmp_path, monkeypatch):
    """Where no mode was resolved it said that one could be above the last frequency only."""
    monkeypatch.setattr(joint_run, "find_mode", lambda _: None)
    monkeypatch.setattr(joint_run, "is_rigid", lambda _: False)
    random = np.random.default_rng(0)
    shake = np.convolve(random.standard_normal(4000), np.hanning(7), "same")
    columns = plain(friction=0.0, viscous=0.0)
    q = columns["q"] + 1e-3 * shake
    tau = columns["tau"] + 2e-3 * np.gradient(np.gradient(shake, 0.005), 0.005)
    (joint,) = report({"t": columns["t"], "q": q, "tau": tau}, tmp_path)
    (text,) = (text for text in joint["cannot_show"] if text.startswith("an elasticity"))
    assert "is not that of one inertia, and no mode was resolved in it" in text


def test_a_joint_that_is_shaken_both_ways_does_not_move_in_one():
    """Dry friction is less in the mean there, and looked like one that builds up after a reversal."""
    t = np.arange(0.0, 40.0, 1e-3)
    q = np.sin(0.4 * np.pi * t) + 2e-3 * np.sin(40 * np.pi * t)
    one = JointRecording(
        "a", 1e-3, {"": q + 1e-7 * np.random.default_rng(0).standard_normal(len(t))}, {"": None}, {"": q}
    )
    wide, narrow = rows_of([one], "", 0, 0.03), rows_of([one], "")
    # the shaking moves it at 0.25 rad/s: below that it goes both ways
    assert np.abs(wide.speed).min() > 0.24
    assert len(narrow.time) > len(wide.time)


def test_a_speed_that_is_not_there_leaves_the_unit_of_the_angle_to_its_name(tmp_path):
    columns = changed(dq=lambda c: 0 * c["dq"])
    (note,) = read_joints([write(columns, tmp_path / "a.csv")])[0].notes
    assert "dq never changes and is not looked at" in note
    del columns["dq"]
    (note,) = read_joints([write(columns, tmp_path / "b.csv")])[0].notes
    assert note.endswith("which is taken to be in rad")


def test_a_clock_that_jitters_is_told_from_a_gap(tmp_path):
    columns = plain(count=800)
    columns["t"][300] += 0.004
    with pytest.raises(InputError, match="where the clock jitters"):
        read_joints([write(columns, tmp_path / "a.csv")])


def test_columns_of_other_names_are_shown_beside_those_that_are_wanted(tmp_path, capsys):
    path = write(plain(count=800), tmp_path / "joint.csv", {"q": "position", "tau": "torque"})
    assert run("reconcile", "--measured", path, "--out", tmp_path / "out") == 2
    assert "has t,position,dq,torque" in capsys.readouterr().err.replace("\n", " ")


def test_a_torque_that_the_motion_does_not_make_is_asked_about(tmp_path):
    """Of noise it said that nothing stands out beyond a rigid joint, and no more."""
    columns = plain()
    (joint,) = report(columns | {"tau": np.random.default_rng(0).standard_normal(len(columns["t"]))}, tmp_path)
    assert any("is it the torque of this joint?" in text for text in joint["measurement"])
    (joint,) = report(columns, tmp_path)
    assert not any("is it the torque" in text for text in joint["measurement"])


def test_the_bend_of_another_law_is_not_called_the_square_of_the_speed(tmp_path):
    """Stribeck's curve, missed, left 0.371 +- 0.3 N m per (rad/s)^2."""
    joint = Joint(dry=1.0, viscous=0.8, breakaway=0.8)
    measured = Measured(torque_noise=0.005, angle_noise=5e-7, seed=2018)
    path = write(simulate(joint, measured), tmp_path / "joint.csv", {"q": "q_rad"})
    (result,) = reconcile_joints(read_joints([path]))
    said = [one.name for one in findings(result, None)]
    assert "square_friction" not in said
    assert "dry_friction" in said
    if "square_friction" in result.chosen.names():  # it depends on the processor whether it is chosen
        assert any("friction over speed is bent" in text for text in signatures(result))
