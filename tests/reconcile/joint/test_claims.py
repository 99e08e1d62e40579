"""Sentences on joints that other physics showed to be false: each stands for one that was said."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.joint import findings as findings_module
from st_codegen.reconcile.joint import page, waves
from st_codegen.reconcile.joint import parts as joint_parts
from st_codegen.reconcile.joint import run as joint_run
from st_codegen.reconcile.joint.findings import cannot_show, findings, joint_report, number, signatures, verdict
from st_codegen.reconcile.joint.mode import JointMode, JointResponse, _is_braked, find_mode, is_rigid
from st_codegen.reconcile.joint.page import joint_summary
from st_codegen.reconcile.joint.parts import KINDS, Chosen, _of_own_load, crossed, rigid, stacked
from st_codegen.reconcile.joint.reading import JointRecording, _unseen, read_joints
from st_codegen.reconcile.joint.rows import JointRows, rows_of
from st_codegen.reconcile.joint.run import JointResult, reconcile_joints
from st_codegen.reconcile.joint.settings import JOINT
from st_codegen.reconcile.outcome import Outcome
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


def test_a_floor_that_is_a_bound_is_rounded_up():
    """Of 0.12345 it said "at most 0.123"."""
    gap = {"before": 1.0, "after": 0.2, "noise_floor": 0.12345}
    joint = {
        "joint": "1",
        "verdict": "unexplained",
        "measurement": [],
        "effects": [],
        "unexplained": [],
        "cannot_show": [],
    }
    said = joint_summary({"joints": [joint | {"gap": {"held_out": gap}}]})
    assert said.endswith("noise floor at most 0.124 N m")
    assert "at most 1240 N m" in joint_summary(
        {"joints": [joint | {"gap": {"held_out": gap | {"noise_floor": 1234.5}}}]}
    )


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


@pytest.mark.parametrize("noise", [0.02, 1.0])
def test_delays_that_do_as_well_hold_the_true_one(tmp_path, noise):
    (joint,) = report(
        simulate(Joint(dry=1.0, viscous=0.5), Measured(torque_noise=noise, late=12, seed=2, seconds=20.0)), tmp_path
    )
    (late,) = (text for text in joint["measurement"] if "later" in text)
    least, most = map(float, re.search(r"\(([\d.]+) to ([\d.]+) ms do as well\)", late).groups())
    assert least <= 12.0 <= most
    assert (most - least > 5.0) is (noise > 0.1)


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


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_load_that_is_taken_up_or_put_down_is_named_and_friction_told_beside_it(tmp_path, sign):
    """Of a load of a tenth friction was 0.82 +- 0.7 N m per rad/s, and a zero drifted; of more nothing had a name."""
    columns = plain()
    load = 0.3 * np.gradient(columns["dq"], columns["t"]) + 1.2 * np.cos(columns["q"])
    (joint,) = report(columns | {"tau": columns["tau"] + sign * load * (columns["t"] > 12.3)}, tmp_path)
    found = named(joint)
    assert set(found) == {"dry_friction", "viscous_friction", "changed_load"}
    for name, key, true in (
        ("changed_load", "inertia_kg_m2", sign * 0.3),
        ("changed_load", "gravity_Nm", 1.2),
        ("dry_friction", "dry_friction_Nm", 1.0),
        ("viscous_friction", "viscous_friction_Nm_s", 0.5),
    ):
        value = found[name]["parameters"][key]
        assert abs(value["value"] - true) < 3 * value["stderr"] < 0.3 * abs(true)
    assert found["changed_load"]["parameters"]["begin_s"]["value"] == pytest.approx(12.3, abs=0.3)
    assert f"{'more' if sign > 0 else 'less'} inertia" in found["changed_load"]["text"]


def test_a_load_is_named_wherever_in_a_stretch_it_changes(tmp_path):
    """The stretch in which it lies does not know when, while it is left out: two of eleven had no name."""
    columns = plain()
    load = 0.3 * np.gradient(columns["dq"], columns["t"]) + 1.2 * np.cos(columns["q"])
    (joint,) = report(columns | {"tau": columns["tau"] + load * (columns["t"] > 14.6)}, tmp_path)
    assert named(joint)["changed_load"]["parameters"]["begin_s"]["value"] == pytest.approx(14.6, abs=0.1)


def test_an_inertia_below_its_error_is_neither_more_nor_less(monkeypatch):
    """At one speed nothing tells it: "0.882 +- 7 kg m^2 more inertia"."""
    monkeypatch.setattr(findings_module, "_share", lambda result, name: 0.5)
    part = SimpleNamespace(name="changed_load", shape=1.5)
    for value, said in ((0.9, "0.9 +- 0.3 kg m^2 more inertia"), (-0.2, "an inertia that nothing tells from the one")):
        fitted = SimpleNamespace(values=np.array([value, 3.0, 4.0]), errors=np.array([0.3, 0.1, 0.1]))
        chosen = SimpleNamespace(place=lambda name: slice(0, 3), fit=fitted, by_law=None, parts=[part])
        assert f"on: {said}" in findings_module._changed_load(SimpleNamespace(chosen=chosen)).text


@pytest.mark.parametrize("kind", ["a zero that steps", "a load now and then", "more friction"])
def test_what_is_no_load_from_a_time_on_is_not_called_one(tmp_path, kind):
    columns = plain()
    t, q, dq = (columns[name] for name in ("t", "q", "dq"))
    load, later = 0.3 * np.gradient(dq, t) + 1.2 * np.cos(q), t > 12.3
    added = {
        "a zero that steps": 1.0 * later,
        "a load now and then": load * ((t // 2.0) % 2),
        "more friction": (0.6 * np.sign(dq) + 0.4 * dq) * later,
    }[kind]
    (joint,) = report(columns | {"tau": columns["tau"] + added}, tmp_path)
    assert "changed_load" not in named(joint)


def test_a_link_that_is_light_is_no_rigid_joint():
    """In a band that was wide enough its mode was small in the mean: an elasticity could be above the band only."""
    frequency, random = np.linspace(1.0, 400.0, 1600), np.random.default_rng(0)
    s, w = 2j * np.pi * frequency, 2 * np.pi * 20.0
    spring = 0.05 * (0.04 * s / w + 1) / ((s / w) ** 2 + 0.04 * s / w + 1)
    noise = 0.01 * (random.standard_normal(1600) + 1j * random.standard_normal(1600))
    assert is_rigid(response(1.0 + 0.05 + noise, frequency))
    assert not is_rigid(response(1.0 + spring + noise, frequency))


def test_no_mode_is_seen_where_the_motion_does_not_explain_the_torque():
    """It named the last frequency only: "an elasticity above 90 Hz", though nothing was told from 2 to 30 Hz."""
    frequency = np.concatenate([np.arange(0.5, 1.1, 0.25), np.arange(10.0, 15.1, 0.25), np.arange(30.0, 90.1, 0.25)])
    assert response(1.0 + 0j * frequency, frequency).bands() == ((10.0, 15.0), (30.0, 90.0))
    assert response(1.0 + 0j * frequency[3:24], frequency[3:24]).bands() == ((10.0, 15.0),)


def test_a_mode_of_a_few_frequencies_far_apart_is_no_second_one(tmp_path):
    """It was named, and beside it stood that the motion explains the torque in no band, or below the mode alone."""
    frequency = np.concatenate([[1.0, 1.25, 1.5, 1.75], np.geomspace(2.0, 60.0, 14)])
    s, w = 2j * np.pi * frequency, 2 * np.pi * 14.0
    found = response((s / w) ** 2 + 0.4 * s / w + 1, frequency)
    mode = find_mode(found)
    ((low, high),) = found.bands(mode.damping)
    assert low < mode.resonance_Hz < high
    rows = rows_of(read_joints([write(plain(), tmp_path / "joint.csv")]), "")
    chosen = Chosen((rigid(rows),), crossed(stacked([rigid(rows)]), rows))
    result = JointResult("", rows, chosen, (), mode, 0.0, (0.0, 0.0), 0, (), False, False, ())
    assert any(text.startswith("a second elasticity (one is looked for): no band") for text in cannot_show(result))


def test_a_low_mode_of_a_joint_whose_friction_is_shaken(tmp_path):
    """Read through the kernel that leaves the mode out, friction hid it: the joint was called rigid up to 90 Hz."""
    (joint,) = report(shaken(6.0), tmp_path)
    mode = named(joint)["elasticity"]["parameters"]
    assert mode["resonance_Hz"]["value"] == pytest.approx(6.0 * 2**0.5, rel=0.02)
    assert mode["antiresonance_Hz"]["value"] == pytest.approx(6.0, rel=0.02)
    assert any("a second elasticity" in text for text in joint["cannot_show"])


def shaken(spring_Hz, count=40_000, step=1e-3):
    """Two inertias of 1 kg m^2 and a spring between them, on a path and shaken, by their linear response."""
    random, t = np.random.default_rng(3), np.arange(count) * step
    frequency = np.fft.rfftfreq(count, step)
    s, w = 2j * np.pi * frequency, 2 * np.pi * spring_Hz
    inertia = 1.0 + (0.04 * s / w + 1) / ((s / w) ** 2 + 0.04 * s / w + 1)
    drive = np.fft.rfft(random.standard_normal(count)) * ((frequency > 1.0) & (frequency < 150.0))
    moved = np.zeros(len(s), complex)
    moved[1:] = drive[1:] / (inertia * s**2)[1:]
    for f, size in ((4, 0.8), (9, 0.4), (17, 0.15)):
        # whole waves in the recording
        moved[f] += size * count / 2 * np.exp(1j * f)
    q, v, tau = (np.fft.irfft(x, count) for x in (moved, moved * s, moved * inertia * s**2))
    noise = random.standard_normal((2, count))
    tau = tau + np.tanh(v / 0.003) + 0.8 * v + 0.02 * noise[0]
    return {"t": t, "q": q + 1e-6 * noise[1], "dq": v, "tau": tau}


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
    note, _ = read_joints([write(columns, tmp_path / "a.csv")])[0].notes
    assert "dq never changes and is not looked at" in note
    del columns["dq"]
    note, _ = read_joints([write(columns, tmp_path / "b.csv")])[0].notes
    assert note.endswith("which is taken to be in rad")


@pytest.mark.parametrize(("name", "has_speed"), [("t", False), ("t", True), ("t_s", False)])
def test_a_time_that_neither_its_name_nor_a_speed_tells_is_said_to_be_taken_in_s(tmp_path, name, has_speed):
    """Steps of 0.25 ms pass for 0.25 s: viscous friction was 805 +- 30 N m per rad/s, and nothing was asked."""
    columns = plain(count=800)
    if not has_speed:
        del columns["dq"]
    (one,) = read_joints([write(columns, tmp_path / "joint.csv", {"t": name})])
    said = [note for note in one.notes if note.endswith("t is taken to be in s: a sample every 0.005 s")]
    assert len(said) == (name == "t" and not has_speed)


def test_a_time_of_another_unit_than_that_in_its_name_is_asked_about(tmp_path):
    """Seconds under the name t_ms were asked about as another side of a gear, milliseconds of t_us as well."""
    for name, factor, words in (("t_ms", 1.0, "t_ms in seconds"), ("t_us", 1e3, "t_us in milliseconds")):
        columns = plain(count=800)
        columns["t"] = factor * columns["t"]
        with pytest.raises(InputError, match=words):
            read_joints([write(columns, tmp_path / "joint.csv", {"t": name})])


def test_an_angle_in_degrees_beside_a_speed_in_degrees_a_second(tmp_path):
    """They agree with each other: friction of 0.5 N m per rad/s was said to be 0.0087."""
    columns = plain()
    small = columns | {"tau": columns["tau"] - 4.0 * np.cos(columns["q"])}
    for weight, stroke, what in ((4.0, 0.2, "asked"), (0.0, 0.2, "said"), (4.0, 0.02, "said")):
        q = stroke * columns["q"]
        tau = stroke * (small["tau"] - np.sign(columns["dq"])) + np.sign(columns["dq"]) + weight * np.sin(q + 0.5)
        degrees = {"t": columns["t"], "q": np.degrees(q), "dq": stroke * np.degrees(columns["dq"]), "tau": tau}
        if what == "asked":
            with pytest.raises(InputError, match="name the column q_deg or q_rad"):
                report(degrees, tmp_path)
        else:
            (joint,) = report(degrees, tmp_path)
            assert any(text.startswith("the unit of q: its name has none") for text in joint["cannot_show"])
    # gravity of a whole turn, or the name, tells it
    for told in (columns, {"q_rad" if name == "q" else name: value for name, value in small.items()}):
        (joint,) = report(told, tmp_path)
        assert not any("the unit of" in text for text in joint["cannot_show"])


def test_a_joint_without_a_number_beside_others_is_asked_about(tmp_path):
    """It ended in a ValueError."""
    columns = plain(count=800)
    columns |= {"q2": columns["q"], "tau2": columns["tau"]}
    with pytest.raises(InputError, match="stands beside q2: number all of them"):
        read_joints([write(columns, tmp_path / "joint.csv")])


def test_short_strokes_are_no_standing(tmp_path):
    """A joint that goes back and forth by 0.008 rad was refused as one that does not move."""
    t = np.arange(0.0, 20.0, 1e-3)
    bell = np.hanning(41) / np.hanning(41).sum()
    v = np.convolve(0.02 * np.sign(np.sin(2 * np.pi * t / 0.8)), bell, "same")
    q = np.cumsum(v) * 1e-3
    noise = np.random.default_rng(0).standard_normal((2, len(t)))
    tau = 2.0 * np.gradient(v, 1e-3) + 6.0 * np.cos(0.5 + q) + np.sign(v) + 0.02 * noise[1]
    (joint,) = report({"t": t, "q_rad": q + 1e-8 * noise[0], "tau": tau}, tmp_path)
    assert np.ptp(q) < 0.009
    assert named(joint).keys() & {"dry_friction", "friction"}


def test_radians_under_a_name_of_degrees_are_no_standing_joint(tmp_path):
    """Seen as degrees the joint hardly travels, and was said to stand."""
    columns = changed(q=lambda c: 0.05 * c["q"], dq=lambda c: 0.05 * c["dq"])
    with pytest.raises(InputError, match="q in rad while named deg"):
        read_joints([write(columns, tmp_path / "joint.csv", {"q": "q_deg"})])


def test_a_clock_that_jitters_is_told_from_a_gap(tmp_path):
    columns = plain(count=800)
    columns["t"][300] += 0.004
    with pytest.raises(InputError, match=r"lines 302 to 801 .* by up to 0.8 of one\. Where the clock jitters"):
        read_joints([write(columns, tmp_path / "a.csv")])


def test_a_clock_that_jitters_by_less_than_half_a_step_is_read(tmp_path):
    """Held against the first sample of a piece, which jitters too, it was off by 0.77 of a step in place of 0.4."""
    columns = plain(count=4000)
    jitter = np.random.default_rng(4).uniform(-0.4, 0.4, 4000)
    jitter[0] = 0.4
    columns["t"] += 0.005 * 0.5 * jitter
    columns["t"][2000:2002] += 0.005 * np.array([-0.4, 0.4])
    (recording, *_) = read_joints([write(columns, tmp_path / "a.csv")])
    assert any("off even steps by up to 0." in note for note in recording.notes)
    # no sample is missing where a step is 1.8 of the others
    assert any("none were taken, or the clock jitters by more, in 1 place" in note for note in recording.notes)


def test_columns_of_other_names_are_shown_beside_those_that_are_wanted(tmp_path, capsys):
    path = write(plain(count=800), tmp_path / "joint.csv", {"q": "position", "tau": "torque"})
    assert run("reconcile", "--measured", path, "--out", tmp_path / "out") == 2
    assert "has t,position,dq,torque" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("t,q,tau,größe\n".encode("latin-1"), "the text is not UTF-8"),
        ("t,q,tau\n".encode("utf-16"), "the text is UTF-16; save it as UTF-8"),
        (b"", "joint.csv is empty"),
    ],
)
def test_a_file_without_a_first_line_is_named_for_what_it_is(tmp_path, capsys, content, words):
    """It said that --rig is missing, and no more."""
    path = tmp_path / "joint.csv"
    path.write_bytes(content)
    assert run("reconcile", "--measured", path, "--out", tmp_path / "out") == 2
    assert words in capsys.readouterr().err.replace("\n", " ")


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


def test_three_speeds_tell_friction_that_falls_and_rises(tmp_path):
    """Square, viscous and dry friction make any curve of these: 8.6 +- 0.1 N m of 6 N m were "dry", the others gone."""
    random, t = np.random.default_rng(0), np.arange(0.0, 40.0, 1e-3)
    levels = np.repeat([0.2, -0.2, 0.5, -0.5, 1.0, -1.0, 0.2, -0.2, 0.5, -0.5], 4000)
    v = np.convolve(np.pad(levels, 100, mode="edge"), np.hanning(202)[1:-1] / np.hanning(202).sum(), "same")[100:-100]
    friction = np.sign(v) * (6.0 + 4.0 * np.exp(-np.abs(v) / 0.2)) + 4.0 * v
    q = np.cumsum(v) * 1e-3
    tau = 1.2 * np.gradient(v, 1e-3) + 12.0 * np.cos(q) + friction + 0.05 * random.standard_normal(len(t))
    (joint,) = report({"t": t, "q": q, "dq": v, "tau": tau}, tmp_path)
    found = named(joint)
    for name, key, truth in (
        ("dry_friction", "dry_friction_Nm", 6.0),
        ("viscous_friction", "viscous_friction_Nm_s", 4.0),
        ("stribeck", "least_at_rad_s", 0.2 * np.log(5.0)),
    ):
        own = found[name]["parameters"][key]
        assert own["value"] == pytest.approx(truth, abs=own["stderr"] or 0.02)


def two_joints(**columns):
    """A second joint beside one that moves."""
    found = {("t" if key == "t" else f"{key}1"): value for key, value in plain().items()}
    return found | {f"{key}2": value for key, value in columns.items()}


@pytest.mark.parametrize("coarse", [False, True])
def test_a_joint_that_stands_is_said_to_and_its_noise_is_no_wrong_speed(tmp_path, coarse):
    """Its dq was refused as not the speed of q, and with it the whole file; where it was not, nobody heard of it."""
    noise = np.random.default_rng(0).standard_normal((3, len(plain()["t"])))
    angle = 2 * np.pi / 1024 * (noise[0] > 1.0) if coarse else 0.5 + 1e-6 * noise[0]
    columns = two_joints(q=angle, dq=1e-3 * noise[1], tau=5.0 + 0.05 * noise[2])
    (joint,) = report(columns, tmp_path)
    assert joint["joint"] == "1" and {"dry_friction", "viscous_friction"} <= set(named(joint))
    assert any(text.startswith("of joint 2 nothing is told") for text in joint["measurement"])


def test_a_folder_in_which_one_joint_moves_in_each_file(tmp_path):
    """It was refused: the joint that stands in one file hid the other one's, and no joint moved."""
    noise = np.random.default_rng(0).standard_normal((4, len(plain()["t"])))
    still = {"q": 0.5 + 1e-6 * noise[0], "dq": 1e-3 * noise[1], "tau": 5.0 + 0.05 * noise[2]}
    first = two_joints(**still)
    moves = {1: 2, 2: 1}
    second = {key if key == "t" else f"{key[:-1]}{moves[int(key[-1])]}": value for key, value in first.items()}
    files = [write(first, tmp_path / "a.csv"), write(second, tmp_path / "b.csv")]
    joints = joint_report(reconcile_joints(read_joints(files)), None)["joints"]
    assert [joint["joint"] for joint in joints] == ["1", "2"]
    for joint, file in zip(joints, ("b.csv", "a.csv"), strict=True):
        assert named(joint)["dry_friction"]["parameters"]["dry_friction_Nm"]["value"] == pytest.approx(1.0, rel=0.03)
        assert any(f"stands in {file}: nothing is taken from there" in text for text in joint["measurement"])


def test_joints_that_stand_are_named_in_their_order(tmp_path):
    columns = {("t" if key == "t" else f"{key}1"): value for key, value in plain().items()}
    noise = np.random.default_rng(0).standard_normal((2, len(columns["t"])))
    for joint in (2, 10):
        columns |= {f"q{joint}": 0.5 + 1e-6 * noise[0], f"tau{joint}": noise[1]}
    (joint,) = report(columns, tmp_path)
    assert any(text.startswith("of joints 2, 10 nothing is told: they do not") for text in joint["measurement"])


def test_a_torque_of_the_wrong_sign_beside_another_joint(tmp_path):
    """Beside all columns of the other joint, and friction that rises with speed, nothing was sure: it was not asked."""
    t = plain()["t"]
    w = 2 * np.pi * np.array([[0.17], [0.37]])
    q = np.array([0.7, 0.2]) @ np.sin(w * t)
    dq = np.array([0.7, 0.2]) @ (w * np.cos(w * t))
    ddq = -np.array([0.7, 0.2]) @ (w**2 * np.sin(w * t))
    tau = 2.0 * ddq + 20.0 * np.cos(q) + 4.0 * np.sign(dq) + 3.0 * dq
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(t))
    with pytest.raises(InputError, match="tau2 has the opposite sign"):
        report(two_joints(q=q, dq=dq, tau=noise - tau), tmp_path)


@pytest.mark.parametrize(("name", "factor"), [("t_s", 1.0), ("t_ms", 1e3), ("t_us", 1e6)])
def test_units_of_the_time_may_stand_in_its_name(tmp_path, name, factor):
    columns = plain(count=800)
    columns["t"] = factor * (1.0 + columns["t"])
    (one,) = read_joints([write(columns, tmp_path / "joint.csv", {"t": name})])
    assert one.step_s == pytest.approx(0.005)


def test_a_time_in_milliseconds_is_asked_about(tmp_path):
    """Friction was called 3000 N m per rad/s, or dq that of another side of a gear."""
    columns = plain(count=800)
    columns["t"] = 1e3 * columns["t"]
    with pytest.raises(InputError, match="is it in milliseconds"):
        read_joints([write(columns, tmp_path / "joint.csv")])
    with pytest.raises(InputError, match="t_ms are all the time; keep one"):
        read_joints([write(columns | {"t_ms": columns["t"]}, tmp_path / "joint.csv")])


def test_a_clock_may_count_from_any_date(tmp_path):
    columns = plain(count=800)
    columns["t"] = columns["t"] + 1.7e9
    path = tmp_path / "joint.csv"
    np.savetxt(path, np.stack(list(columns.values()), 1), "%.17g", ",", header=",".join(columns), comments="")
    (one,) = read_joints([path])
    assert one.step_s == pytest.approx(0.005)


def test_one_speed_does_not_tell_a_ripple_from_a_hum(tmp_path, monkeypatch):
    """It was a wave over time which no wave over the angle explains as well, where that one had not stood out."""
    agreed = waves._agreed
    monkeypatch.setattr(waves, "_agreed", lambda *given: agreed(*given) if given[2] == waves.TIME else None)
    t = np.arange(0.0, 40.0, 2e-3)
    noise = np.random.default_rng(0).standard_normal((2, len(t)))
    q = 0.7 * t + 0.002 * np.sin(1.3 * t)
    tau = 4.0 + 2.0 * np.cos(q) + 0.5 * np.cos(40.0 * q) + 0.05 * noise[1]
    (joint,) = report({"t": t, "q_rad": q + 1e-6 * noise[0], "tau": tau}, tmp_path)
    # beside it stand the waves over time that a change of the speed makes of one over the angle
    text, *_ = [text for text in joint["unexplained"] if "wave of" in text]
    assert "or of 40" in text and "per revolution" in text and "no wave over the angle" not in text


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.05, 0.01])
def test_one_ripple_at_one_speed_is_one_wave_with_its_size(tmp_path, noise):
    """Its number was taken from ten places: it came back as two waves side by side, the ripple 0.0285 N m of 0.3."""
    t = np.arange(0.0, 30.0, 2e-3)
    rng = np.random.default_rng(3)
    q = 0.5 * t
    tau = 1.4 + 15.0 * np.sin(q) + 0.3 * np.sin(7.0 * q) + noise * rng.standard_normal(len(t))
    q = q + 1e-5 * rng.standard_normal(len(t))
    (result,) = reconcile_joints(read_joints([write({"t_s": t, "q_rad": q, "tau": tau}, tmp_path / "joint.csv")]))
    (wave,) = result.waves
    assert wave.has_rival
    part = wave.gain.part
    angle = 7.0 if wave.over == waves.ANGLE else 7.0 * 0.5 / (2 * np.pi)
    assert part.shape == pytest.approx(angle, rel=0.001)
    (joint,) = joint_report((result,), None)["joints"]
    said = [*joint["unexplained"], *(f"{effect['parameters']}" for effect in joint["effects"])]
    assert len(said) == 1 and re.search(r"\b0\.(3|30\d*|29[5-9]\d*)\b", said[0])


def test_a_hum_and_a_ripple_that_are_both_there_are_not_one_wave(tmp_path):
    """It said "a wave of 7.301 Hz over time, or of 30.05 per revolution", beside a ripple of 30.05 that had a name."""
    columns = plain(ripple=0.15)
    columns["tau"] += 0.152 * np.sin(2 * np.pi * 7.3 * columns["t"])
    (joint,) = report(columns, tmp_path)
    ripple = named(joint)["torque_ripple"]
    assert ripple["parameters"]["order_per_revolution"]["value"] == pytest.approx(40.0, rel=0.02)
    assert not any("Hz" in text for text in ripple["alternatives"])
    (text,) = [text for text in joint["unexplained"] if "wave of" in text]
    assert text.startswith("a wave of 7.3") and "no wave over the angle explains as well" in text


@pytest.mark.slow
def test_a_ripple_through_pieces_of_the_data_stands_out_of_what_it_leaks(tmp_path):
    """In a motion of one sine its own surroundings hid it: the torque was called 7 ms early."""
    joint = Joint(gravity=20.0, dry=4.0, viscous=3.0, ripple=1.0, order=160.0)
    (joint,) = report(simulate(joint, Measured(path="sine", torque_noise=0.05, angle_noise=1e-6)), tmp_path)
    value = named(joint)["torque_ripple"]["parameters"]
    assert value["order_per_revolution"]["value"] == pytest.approx(160.0, abs=1.6)
    assert value["amplitude_Nm"]["value"] == pytest.approx(1.0, rel=0.2)
    assert not any("earlier" in text for text in joint["measurement"])


def test_waves_that_a_wide_kernel_takes_away_are_not_fitted():
    """They were, to next to nothing: a left-out stretch was missed by 1000 times what all others were."""
    columns = plain(ripple=0.3)
    one = JointRecording("a", 0.005, {"": columns["q"]}, {"": None}, {"": columns["tau"]})
    narrow, wide = rows_of([one], ""), rows_of([one], "", 0, 0.1)
    seen = [(waves.ANGLE, 40.0), (waves.TIME, 7.3)]
    names = [{part.name for part in joint_run._rich(rows, seen)} for rows in (narrow, wide)]
    assert names[0] - names[1] == {"wave_of_angle:40", "wave_of_time:7.3"}


def test_a_ripple_that_what_is_left_could_make_has_no_name(tmp_path, monkeypatch):
    """Of friction that grows with the load it said 0.035 N m of a ripple of 18 per revolution, with 0.2 N m left."""
    (result,) = reconcile_joints(read_joints([write(plain(ripple=0.2), tmp_path / "joint.csv")]))
    assert "torque_ripple" in [one.name for one in findings(result, None)]
    monkeypatch.setattr(Chosen, "amplitude", lambda *_: (0.035, 0.2))
    assert "torque_ripple" not in [one.name for one in findings(result, None)]
    end = "0.035 +- 0.2 N m): what else is left could make all of it"
    (text,) = [text for text in signatures(result) if text.endswith(end)]
    assert "Hz" not in text
    # it said "the rest is more than noise", of 0.1 N m beside a floor of 0.1 N m
    for after, outcome in ((0.1, Outcome.EXPLAINED), (0.2, Outcome.PARTLY_EXPLAINED)):
        monkeypatch.setattr(JointResult, "gap", (1.0, after, 0.1))
        assert verdict(result, findings(result, None)) == outcome
    monkeypatch.setattr(waves.TorqueWave, "has_rival", True)
    (text,) = [text for text in signatures(result) if text.endswith(end)]
    assert re.search(r"per revolution of the joint, or of [\d.]+ Hz over time, \(", text)


def test_what_friction_shakes_and_the_drive_brakes_is_no_mode_of_the_joint():
    """Stribeck's friction of a rigid joint was an elasticity at 30.4 +- 1 Hz: it was the drive's own response."""
    frequency = np.linspace(1.0, 60.0, 200)
    w = 2 * np.pi * frequency
    drive = (1 + 2j * 0.7 * w / 60.0) / (w / 60.0) ** 2
    lower, upper = 2 * np.pi * 19.0, 2 * np.pi * 23.0
    peak = (1 - (w / upper) ** 2 + 0.2j * w / upper) / (1 - (w / lower) ** 2 + 0.1j * w / lower)
    p = np.array([2.0, 0.0, 0.0, 0.0, upper, 0.1, lower, 0.05])
    assert _is_braked(p, drive * peak, w) and not _is_braked(p, 2.0 * peak, w)
    assert find_mode(response(2.0 * peak, frequency)) is not None
    assert find_mode(response(2.0 * drive * peak, frequency)) is None


@pytest.mark.parametrize("damping", [0.05, 0.25])
def test_a_mode_s_own_damping_does_not_make_it_the_drive_s(damping):
    """It leads the acceleration below a mode: from a damping ratio of 0.2 on the mode was passed over."""
    frequency = np.linspace(1.0, 60.0, 200)
    w = frequency / 30.0
    value = 2.0 * (1 - w**2 + 2j * damping * w)
    noise = np.random.default_rng(0).standard_normal((3, 2, len(w)))
    error = 0.01 * np.abs(value)
    whole, *halves = (
        value + size * error * (real + 1j * imaginary)
        for size, (real, imaginary) in zip((1.0, 2**0.5, 2**0.5), noise, strict=True)
    )
    mode = find_mode(JointResponse(frequency, whole, error, (halves[0], halves[1]), 2**0.5 * error))
    assert mode is not None and mode.resonance_Hz == pytest.approx(30.0, rel=0.01)
    assert mode.damping == pytest.approx(damping, rel=0.1)


def test_a_filter_beside_a_mode_is_no_lead():
    """Fits have it with a time that is early by as much: without the filter alone a mode looked braked."""
    w = 2 * np.pi * np.linspace(1.0, 60.0, 200)
    mode = 2.0 * (1 - (w / 177.0) ** 2 + 2j * 0.03 * w / 177.0)
    value = mode * np.exp(0.0048j * w) / (1 - (w / 318.0) ** 2 + 2j * 0.7 * w / 318.0)
    assert not _is_braked(np.array([2.0, 0.0, 0.0, -0.0048, 177.0, 0.03, 318.0, 0.7]), value, w)


@pytest.mark.slow
def test_an_early_torque_hides_no_mode(tmp_path):
    """It leads the acceleration as well, and is shifted before the mode is judged."""
    joint = Joint(dry=1.0, viscous=0.8, spring_Hz=30.0, behind=True)
    columns = simulate(joint, Measured(seed=4, shake=3.0, seconds=15.0))
    (found,) = report(columns | {"tau": np.roll(columns["tau"], -5)}, tmp_path)
    mode = named(found)["elasticity"]["parameters"]["resonance_Hz"]
    assert mode["value"] == pytest.approx(30.0 * 2**0.5, rel=0.02)


@pytest.mark.slow
def test_the_drive_s_response_to_friction_is_no_early_mode(tmp_path):
    """A torque that is early by 18 ms in the fit hid that the drive brakes: 19.7 +- 2 Hz of a stiff joint."""
    joint = Joint(gravity=20.0, dry=4.0, viscous=0.8, breakaway=2.5, stribeck=0.1)
    columns = simulate(joint, Measured(path="sine", seed=0, torque_noise=0.01, angle_noise=5e-7, seconds=20.0))
    (found,) = report(columns, tmp_path)
    assert "elasticity" not in named(found)


def test_friction_that_changes_is_not_below_nothing_at_one_end(tmp_path):
    """Of half a second of a joint with dry friction of 4 N m it said that it changes by 35 N m from start to end."""
    columns = plain(friction=0.0, viscous=0.0)
    columns["tau"] = columns["tau"] + np.sign(columns["dq"]) * (columns["t"] / columns["t"][-1] - 0.5)
    (joint,) = report(columns, tmp_path)
    assert "dry_friction_drift" not in named(joint)
    assert any("negative at one end" in text for text in joint["unexplained"])


def one_way():
    """A joint that never reverses, with a constant of 4 N m that may be dry friction."""
    t = np.arange(0.0, 40.0, 2e-3)
    noise = np.random.default_rng(0).standard_normal((2, len(t)))
    v = 0.8 + 0.3 * np.sin(0.4 * np.pi * t) + 0.2 * np.sin(2 * np.pi * t / 1.7 + 1.0)
    q = np.cumsum(v) * 2e-3
    tau = 2.0 * np.gradient(v, 2e-3) + 6.0 * np.cos(q) + 4.0 - (t / t[-1] - 0.5) + 0.02 * noise[1]
    return {"t": t, "q_rad": q + 2e-6 * noise[0], "tau": tau}


def test_friction_that_a_constant_may_hold_is_not_below_nothing(tmp_path):
    """Of 4 N m that fall by 1 N m it said that the friction would be negative at one end."""
    (joint,) = report(one_way(), tmp_path)
    assert "torque zero drift" in named(joint)["dry_friction_drift"]["alternatives"]
    assert not any("negative" in text for text in joint["unexplained"])


def test_what_would_be_negative_friction_may_be_another_part(tmp_path):
    """The sentence left out the zero of the torque that would do in its place."""
    (result,) = reconcile_joints(read_joints([write(one_way(), tmp_path / "joint.csv")]))
    sure = replace(result, chosen=replace(result.chosen, not_told=()))
    (text,) = [text for text in signatures(sure) if "negative at one end" in text]
    assert text.startswith("a part with the form of dry friction drift, or of torque zero drift (")


@pytest.mark.slow
def test_friction_that_falls_where_a_joint_moves_at_one_speed_mostly(tmp_path):
    """Viscous friction was not looked at where its square had been taken: 2.51 +- 0.8 N m per (rad/s)^2."""
    t = np.arange(0.0, 40.0, 1e-3)
    random = np.random.default_rng(3)
    v, at = np.zeros(len(t)), 0
    while at < len(t) - 3000:
        for way in (1.0, -1.0):
            count = int(random.uniform(600, 1600))
            ramp = np.minimum(np.minimum(np.arange(count), np.arange(count)[::-1]) * 3e-3, 0.6)
            v[at : at + count], at = way * ramp, at + count + 300
    v = np.convolve(v, np.hanning(31) / np.hanning(31).sum(), "same")
    q = np.cumsum(v) * 1e-3
    friction = (4.0 + 2.5 * np.exp(-((v / 0.1) ** 2))) * np.tanh(v / 1e-3) + 3.0 * v
    tau = 2.0 * np.gradient(v, 1e-3) + 20.0 * np.cos(q) + friction + 0.05 * random.standard_normal(len(t))
    (joint,) = report({"t": t, "q_rad": q, "tau": tau}, tmp_path)
    assert "square_friction" not in named(joint) and "stribeck" in named(joint)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (13.9, 11.2, "13.9 +- 10"),
        (3012.0, 38.0, "3010 +- 40"),
        (0.012, 0.002, "0.012 +- 0.002"),
        (4.23e-5, 1e-5, "0.0000423 +- 0.00001"),
        (999_999.9, 1e4, "1000000 +- 10000"),
        (-0.0, 2.0, "0 +- 2"),
        (1e9, 2e8, "1e+09 +- 2e+08"),
    ],
)
def test_numbers_that_people_read_have_no_power_of_ten(value, error, text):
    assert number(value, error, "") == text


def test_frequencies_have_no_power_of_ten_either(tmp_path):
    """A resonance stood at 1.24e+03 +- 1e+01 Hz."""
    (result,) = reconcile_joints(read_joints([write(plain(count=800), tmp_path / "joint.csv")]))
    one = response(np.ones(3, complex), np.arange(1.0, 4.0))
    mode = JointMode(1240.0, 0.02, 12.0, 0.00005, 880.0, one, one.value)
    (text,) = [one.text for one in findings(replace(result, mode=mode), None) if one.name == "elasticity"]
    assert "at 1240 +- 10 Hz with a damping ratio of 0.02 +- 0.00005" in text


def swung(tau, count=20_000, step=0.002, torque=0.03):
    """A joint to and fro at 0.25 Hz by one radian; tau: its torque beside inertia and gravity, of t, q and dq."""
    rng = np.random.default_rng(2)
    t, w = np.arange(count) * step, 0.5 * np.pi
    q, dq, ddq = np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)
    own = 0.8 * ddq + 6.0 * np.cos(q) + tau(t, q, dq) + torque * rng.standard_normal(count)
    return {"t": t, "q": q + 2e-6 * rng.standard_normal(count), "dq": dq, "tau": own}


def test_an_inertia_that_gravity_nearly_makes_is_not_read_from_noise(tmp_path):
    """In one sine the acceleration is next to what gravity is: noise of the angle decided the rest, and left waves."""
    (joint,) = report(swung(lambda t, q, dq: np.sign(dq) + 0.5 * dq + 0.015 * t), tmp_path)
    assert not joint["unexplained"]
    assert set(named(joint)) == {"dry_friction", "viscous_friction", "torque_zero_drift"}


def moves(seed=1, seconds=40, step=0.002):
    """Moves between random angles at random speeds, with stops between them; t, q, dq, ddq."""
    rng, q = np.random.default_rng(seed), [np.zeros(1)]
    while sum(map(len, q)) < seconds / step:
        start, end, speed = q[-1][-1], rng.uniform(-1.5, 1.5), rng.uniform(0.2, 2.0)
        s = np.linspace(0.0, 1.0, int(max(2 * abs(end - start) / speed, 0.4) / step))
        q += [start + (end - start) * (10 * s**3 - 15 * s**4 + 6 * s**5), np.full(int(0.2 / step), end)]
    q = np.concatenate(q)[: int(seconds / step)]
    t = np.arange(len(q)) * step
    return t, q, np.gradient(q, t), np.gradient(np.gradient(q, t), t)


def moved(tau, rng=2):
    t, q, dq, ddq = moves()
    noise = np.random.default_rng(rng).standard_normal((2, len(t)))
    return {"t": t, "q": q + 2e-6 * noise[0], "dq": dq, "tau": tau(t, q, dq, ddq) + 0.03 * noise[1]}


def test_what_comes_back_after_a_reversal_has_no_name_where_a_mode_is_shaken(tmp_path):
    """Beside a mode 0.011 +- 0.008 N m "came back over a travel of 0.2 rad": dry friction of a joint that is shaken."""
    rng, t = np.random.default_rng(5), np.arange(0.0, 40.0, 2e-3)
    q = 0.8 * np.sin(1.1 * t) + 0.5 * np.sin(2.3 * t + 1.0)
    dq = np.gradient(q, t)
    turned = np.maximum.accumulate(np.where(np.diff(np.sign(dq), prepend=0.0) != 0, np.arange(len(t)), 0))
    back = np.where(turned > 0, 0.3 * np.exp(-np.abs(q - q[turned]) / 0.1), 0.0)
    tau = 0.8 * np.gradient(dq, t) + 6.0 * np.cos(q) + np.sign(dq) * (1.0 - back) + 0.4 * dq
    noise = rng.standard_normal((2, len(t)))
    path = write(
        {"t": t, "q": q + 1e-6 * noise[0], "tau": tau + 0.02 * noise[1]}, tmp_path / "joint.csv", {"q": "q_rad"}
    )
    (result,) = reconcile_joints(read_joints([path]))
    values = {one.name: one.parameters for one in findings(result, None)}
    short, error, _ = values["reversal_hysteresis"]["short_Nm"]
    assert abs(short - 0.3) < 3 * error < 0.1
    one = response(np.ones(3, complex), np.arange(1.0, 4.0))
    shaken = replace(result, mode=JointMode(42.0, 0.02, 0.1, 0.001, 30.0, one, one.value))
    assert "reversal_hysteresis" not in {one.name for one in findings(shaken, None)}
    said = [text for text in signatures(shaken) if "over travel after each reversal" in text]
    assert said and all("as what shakes the joint at its mode" in text for text in said)


def test_parts_that_hide_each_other_are_taken_together(tmp_path):
    """Beside the drift viscous friction predicts nothing surely, and the other way round."""
    columns = moved(lambda t, q, dq, a: 0.8 * a + 6.0 * np.cos(q) + np.sign(dq) + 0.5 * dq + 0.015 * t)
    (joint,) = report(columns, tmp_path)
    found = named(joint)
    assert set(found) == {"dry_friction", "viscous_friction", "torque_zero_drift"}
    assert found["dry_friction"]["parameters"]["dry_friction_Nm"]["value"] == pytest.approx(1.0, abs=0.02)


def test_friction_by_the_load_is_by_the_load_as_it_is_known_in_the_end(tmp_path):
    """When it is taken first, the load still holds what dry and viscous friction are."""

    def torque(t, q, dq, a):
        load = 0.8 * a + 12.0 * np.cos(q)
        return load + np.sign(dq) * (0.4 + 0.15 * np.abs(load)) + 0.3 * dq

    (joint,) = report(moved(torque), tmp_path)
    found = named(joint)
    own = found["load_dependent_friction"]["parameters"]["load_dependent_friction"]
    assert own["value"] == pytest.approx(0.15, abs=3 * own["stderr"])
    assert own["stderr"] < 0.01
    assert {"dry_friction", "viscous_friction"} <= set(found)


def test_a_torque_that_is_late_by_more_than_half_of_a_short_piece(tmp_path):
    """Nothing was left of that piece, which ended in an error of the program."""
    columns = plain()
    (joint,) = report(lossy(columns | {"tau": np.roll(columns["tau"], 60)}, [105, 211]), tmp_path)
    assert set(named(joint)) == {"dry_friction", "viscous_friction"}


def test_pieces_that_are_too_short_for_the_noise_of_the_angle_are_named(tmp_path):
    """Nothing said why a joint that moves all the time "does not move for long enough"; numpy warned of nothing."""
    columns = plain()
    columns["q"] = columns["q"] + 5e-3 * np.random.default_rng(1).standard_normal(len(columns["q"]))
    with pytest.raises(InputError, match="samples are missing, or none were taken, in 33 places"):
        report(lossy(columns, range(120, len(columns["t"]), 121)), tmp_path)


def test_the_time_of_a_load_counts_from_the_begin_of_the_file(tmp_path):
    """It counted from the first piece in which the joint moves: of 12.3 s after 5 s at rest it said 12.3."""
    columns = plain()
    load = 0.3 * np.gradient(columns["dq"], columns["t"]) + 1.2 * np.cos(columns["q"])
    columns["tau"] = columns["tau"] + load * (columns["t"] > 12.3)
    columns = {name: np.concatenate([np.full(1000, column[0]), column]) for name, column in columns.items()}
    columns["t"] = 0.005 * np.arange(5000)
    del columns["dq"]
    (joint,) = report(lossy(columns, [990]), tmp_path)
    assert named(joint)["changed_load"]["parameters"]["begin_s"]["value"] == pytest.approx(17.3, abs=0.1)


def test_what_warms_up_on_a_way_in_one_direction_is_no_gravity_in_degrees(tmp_path):
    """Its angle goes with the time, of which the torque is a curve: the file was refused."""
    t = np.arange(0.0, 34.0, 0.005)
    v = 0.8 + 0.3 * np.sin(0.4 * np.pi * t) + 0.2 * np.sin(3.7 * t + 1.0)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(t))
    tau = 2.0 * np.gradient(v, t) + 0.8 * v + 1.7 + 0.4 * np.exp(-3 * t / t[-1]) + noise
    (joint,) = report({"t": t, "q": np.cumsum(v) * 0.005, "dq": v, "tau": tau}, tmp_path)
    assert any(text.startswith("the unit of q: its name has none") for text in joint["cannot_show"])


def test_samples_that_are_lost_under_even_times_are_counted(tmp_path):
    """The whole file was refused for them."""
    t, q, dq, a = moves()
    place = int(np.argmax(np.abs(dq)))
    kept = np.delete(np.arange(len(t)), [place, place + 1])
    columns = {"t": t[: len(kept)], "q": q[kept], "tau": (a + np.sign(dq))[kept]}
    one, other = read_joints([write(columns, tmp_path / "joint.csv")])
    (said,) = (note for note in one.notes if "steps at once" in note)
    assert f"q moves on by 3 steps at once from line {place + 1} to the next: as if 2 samples" in said
    assert len(one.angle[""]) == place and other.at_s == pytest.approx((place + 2) * t[1])


def lossy(columns, lost):
    """Columns without some of their samples."""
    kept = np.delete(np.arange(len(columns["t"])), lost)
    return {name: column[kept] for name, column in columns.items()}


def test_a_recording_that_lost_samples_tells_what_a_whole_one_does(tmp_path):
    """One lost sample of any number refused the file."""
    columns = plain(ripple=0.2)
    lost = [*range(333, 4000, 333), *range(2500, 2600)]
    columns["tau"][[100, 2200]] = np.nan
    (joint,) = report(lossy(columns, lost), tmp_path)
    found = named(joint)
    for name, key, true in (
        ("dry_friction", "dry_friction_Nm", 1.0),
        ("viscous_friction", "viscous_friction_Nm_s", 0.5),
        ("torque_ripple", "amplitude_Nm", 0.2),
    ):
        value = found[name]["parameters"][key]
        assert abs(value["value"] - true) < 3 * value["stderr"] < 0.3 * true
    assert set(found) == {"dry_friction", "viscous_friction", "torque_ripple"}
    said = " ".join(joint["measurement"])
    assert "line 102 and 1 more: values of tau are not finite" in said
    assert "or none were taken, in 15 places, first after line 101: it is read in 14 pieces of 100 samples or " in said
    assert "; without 67 samples of shorter ones" in said


def test_a_joint_that_stands_in_a_piece_of_a_file_does_not_stand_in_all_of_it(tmp_path):
    columns = plain()
    columns["q"][2000:] = columns["q"][1999]
    columns["tau"][2000:] = columns["tau"][1999]
    del columns["dq"]
    (joint,) = report(lossy(columns, [2000, 3000]), tmp_path)
    assert "dry_friction" in named(joint)
    assert not any("stands in" in text for text in joint["measurement"])


def test_a_mode_is_seen_through_lost_samples(tmp_path):
    columns = simulate(Joint(dry=1.0, viscous=0.8, spring_Hz=30.0), Measured(shake=2.0))
    (joint,) = report(lossy(columns, range(900, len(columns["t"]), 900)), tmp_path)
    assert "elasticity" in named(joint)


def test_rounds_of_a_motion_are_seen_through_lost_samples(tmp_path):
    columns = plain()
    t = columns["t"]
    columns = {"t": t, "q": np.sin(0.4 * np.pi * t) + 0.3 * np.sin(1.2 * np.pi * t), "tau": columns["tau"]}
    pieces = read_joints([write(lossy(columns, [800, 1801, *range(2300, 2400)]), tmp_path / "joint.csv")])
    assert len(pieces) == 4
    rows = rows_of(pieces, "")
    assert all(np.ptp(rows.time[rows.block == number] % 5.0) <= 5.0 / 12 + 0.02 for number in range(1, 11))


def test_two_joints_that_lost_different_samples_are_cut_at_both(tmp_path):
    columns = plain(count=2000)
    columns |= {"q2": columns["q"], "tau2": columns["tau"].copy()}
    del columns["dq"]
    columns["tau2"][1000] = np.inf
    names = {"q": "q1", "tau": "tau1"}
    pieces = read_joints([write(lossy(columns, [500]), tmp_path / "joint.csv", names)])
    assert [len(one.angle["1"]) for one in pieces] == [500, 499, 999]


@pytest.mark.parametrize("speed", [1.07, 1.2])
def test_a_coarse_encoder_of_a_joint_that_mostly_stands_has_lost_no_samples(speed):
    """Its step is now and then two of itself; in the mean over all samples, most of them at rest, it had no noise."""
    moving = np.zeros(60_000)
    moving[5_000:6_000], moving[30_000:31_000] = speed, -speed
    angle, notes = np.round(np.cumsum(moving)) * 2 * np.pi / 4096, list[str]()
    assert not _unseen("q", angle, [slice(0, len(angle))], np.arange(len(angle)), notes).any() and not notes


def spun(speed, tau, count=20_000, step=0.002):
    """A joint that turns one way at a speed, a function of t, beside another one to and fro."""
    random, t = np.random.default_rng(0), np.arange(count) * step
    q, other = np.cumsum(speed(t)) * step, np.sin(1.3 * t) + 0.5 * np.sin(2.9 * t)
    (v, w), noise = (np.gradient(x, step) for x in (q, other)), random.standard_normal((4, count))
    a, b = np.gradient(v, step), np.gradient(w, step)
    pulls = 0.5 * b * np.cos(q - other) + 0.5 * w**2 * np.sin(q - other)
    own = 0.4 * b + 3.0 * np.cos(other) + 0.5 * np.sign(w) + 0.2 * w + 0.5 * a * np.cos(q - other)
    torque = 0.8 * a + tau(t, q, v)
    columns = {"t": t, "q_rad": q + 2e-6 * noise[0], "tau": torque + 0.03 * noise[2]}
    pair = {"t": t, "q1_rad": columns["q_rad"], "q2_rad": other + 2e-6 * noise[1]}
    return columns, pair | {"tau1": torque + pulls + 0.03 * noise[2], "tau2": own + 0.03 * noise[3]}


def test_friction_that_no_motion_tells_beside_another_joint_is_not_named(tmp_path):
    """Of a joint that turns one way dry friction is a constant: no form of it was left to choose from, a crash."""
    _, columns = spun(
        lambda t: 1.0 + 0.6 * np.sin(0.7 * t) + 0.2 * np.sin(2.1 * t + 1.0),
        lambda t, q, v: 6.0 * np.cos(q) + np.sign(v) + 0.5 * v,
    )
    first, second = report(columns, tmp_path)
    assert set(named(first)) == {"viscous_friction"}
    assert set(named(second)) == {"dry_friction", "viscous_friction"}


@pytest.mark.slow
def test_a_joint_that_turns_at_one_speed_tells_no_other_part(tmp_path):
    """Beside the drift that was taken there was none to ask about, alone or with another one: a crash."""
    columns, _ = spun(lambda t: 1.0 + 0.0 * t, lambda t, q, v: 3.0 + 0.2 * t)
    (joint,) = report(columns, tmp_path)
    assert set(named(joint)) <= {"dry_friction_drift", "viscous_friction_drift", "torque_zero_drift"}


def test_friction_by_the_load_of_data_without_any_noise_comes_to_an_end(monkeypatch):
    """What rounding leaves may be less than nothing: it was never more than a share of itself, without an end."""
    for seed in range(30):
        fits = iter(range(20))
        monkeypatch.setattr(joint_parts, "crossed", lambda *given, fits=fits: (next(fits), crossed(*given))[1])
        random, count = np.random.default_rng(seed), 2400
        q, v, a = (random.uniform(-most, most, count) for most in (2.0, 2.0, 5.0))
        load, none, zero = 0.8 * a + 12.0 * np.cos(q), np.full(count, np.inf), np.zeros(count)
        torque, block = load + 0.15 * np.sign(v) * np.abs(load), np.arange(count) * JOINT.blocks // count
        rows = JointRows(zero, q, v, a, torque, zero, none, none, np.zeros((count, 0)), block, 0.01, (0, 0), 0, 0.01)
        name = "load_dependent_friction"
        part = KINDS[name].variants(name, rows, np.stack([load, load], axis=1))[0]
        assert [one.name for one in _of_own_load(rows, [rigid(rows), part])] == ["rigid", name]


def test_beside_a_curve_that_drives_the_joint_no_friction_is_dry(tmp_path):
    """Friction by the root of the speed is 0.6 N m at standstill: 1.06 N m was called dry, beside a negative curve."""
    columns = moved(lambda t, q, dq, a: 0.8 * a + 6.0 * np.cos(q) + np.sign(dq) * (0.6 + 0.8 * np.sqrt(np.abs(dq))))
    (joint,) = report(columns, tmp_path)
    assert set(named(joint)) == {"friction"}
    values = named(joint)["friction"]["parameters"]
    for key in ("slow", "fast"):
        said, truth = values[f"{key}_friction_Nm"], 0.6 + 0.8 * np.sqrt(values[f"{key}_rad_s"]["value"])
        assert said["value"] == pytest.approx(truth, abs=said["stderr"])


def test_a_wave_of_a_long_recording_stands_in_its_picture(monkeypatch):
    """There are more numbers than points: a wave between those that were shown was not in the curve that marks it."""
    number, size = np.linspace(0.0, 60.0, 100_000), np.full(100_000, 0.01)
    size[12_345] = 1.0
    monkeypatch.setattr(page, "spectrum", lambda *_: (number, size))
    shown = []
    axes = SimpleNamespace(
        plot=lambda x, y, **_: shown.append((x, y)), axvline=lambda *_, **__: None, set=lambda **_: None
    )
    page._spectrum(SimpleNamespace(rows=None), None, waves.TIME, "Hz over time", [number[12_345]])(axes)
    ((x, y),) = shown
    assert y.max() == 1.0
    assert x[y.argmax()] == pytest.approx(number[12_345], abs=0.02)
    assert len(x) < 10_000


@pytest.mark.parametrize("share", [0.2, 0.33, 0.7])
def test_friction_that_falls_as_a_joint_warms_has_its_change(tmp_path, share):
    """What does not change evenly was unexplained, since nothing even predicts the first minute from the others."""
    columns = plain(viscous=0.0, torque=0.05)
    warmed = 1.5 - 0.75 * -np.expm1(-columns["t"] / (share * columns["t"][-1]))
    (joint,) = report(columns | {"tau": columns["tau"] + warmed * columns["dq"]}, tmp_path)
    found = named(joint)
    assert set(found) == {"dry_friction", "viscous_friction", "viscous_friction_drift"}
    value = found["viscous_friction_drift"]["parameters"]["viscous_friction_drift_Nm_s"]
    assert value["value"] == pytest.approx(0.75 * np.expm1(-1 / share), abs=2 * value["stderr"])
    assert value["stderr"] < 0.6 * abs(value["value"])
    assert joint["gap"]["held_out"]["after"] < 1.1 * joint["gap"]["held_out"]["noise_floor"]


def test_gravity_is_smoothed_as_the_torque_is(tmp_path):
    """The cosine of a smooth angle is no smooth cosine: without any noise friction differed by direction."""
    t = np.arange(0.0, 20.0, 0.01)
    waves_of = [(0.11, 0.8, 0.1), (0.43, 0.6, 1.2), (0.93, 0.3, 2.0)]
    q, a = (
        sum(size * (2 * np.pi * f) ** d * np.sin(2 * np.pi * f * t + p + d * np.pi / 2) for f, size, p in waves_of)
        for d in (0, 2)
    )
    (joint,) = report({"t": t, "q": q, "tau": 1.5 * a + 8.0 * np.cos(q)}, tmp_path)
    assert not joint["effects"]
    assert joint["gap"]["held_out"]["after"] < 1e-3


@pytest.mark.parametrize("seed", [0, 2])
def test_a_shift_stands_for_no_friction_that_does_better_without_it(tmp_path, seed):
    """Beside friction by the load it said 28 ms earlier, 20 to 72 ms did as well, and left most without a name."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 40.0, 4e-3)
    sines = [(k, 0.8 * rng.normal() / k**0.7, rng.uniform(0, 6.28)) for k in range(1, 6)]
    q, dq, a = (
        sum(x * (0.2 * np.pi * k) ** d * np.sin(0.2 * np.pi * k * t + p + d * np.pi / 2) for k, x, p in sines)
        for d in range(3)
    )
    load = 1.5 * a + 8.0 * np.cos(q) + 0.4
    tau = load + (1.0 + 0.1 * np.abs(load)) * np.sign(dq) + 0.6 * dq + 0.01 * rng.standard_normal(len(t))
    (joint,) = report({"t": t, "q_rad": q, "tau": tau}, tmp_path)
    assert not any(" ms " in text for text in joint["measurement"])
    assert joint["gap"]["held_out"]["after"] < 1.2 * joint["gap"]["held_out"]["noise_floor"]


def test_what_drives_the_joint_is_not_called_friction(tmp_path):
    """It said friction of -4.59 +- 1 N m at 0.49 rad/s."""
    (joint,) = report(plain(friction=-6.0, viscous=2.7), tmp_path)
    assert not named(joint)
    viscous, dry = sorted(text for text in joint["unexplained"] if "friction" in text)[::-1]
    assert "form of viscous friction (2.7" in viscous and "drives the joint at some speeds" in viscous
    assert "form of dry friction and the wrong sign (-6" in dry


def test_at_two_speeds_viscous_and_square_friction_may_both_be_there(tmp_path):
    """It said 0.434 +- 0.003 N m by the square of the speed, or viscous friction, where it was 0.3 and both were."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 40.0, 5e-3)
    speed = np.select([t % 9 < 3.0, t % 9 < 6.0, t % 9 < 7.5], [0.5, -0.5, 1.0], -1.0)
    v = np.convolve(speed, np.hanning(41) / np.hanning(41).sum(), "same")
    q = np.cumsum(v) * 5e-3
    tau = 0.8 * np.gradient(v, t) + 15.0 * np.cos(q) + 1.6 * np.tanh(v / 1e-4) + 0.2 * v + 0.3 * v * np.abs(v)
    noise = rng.standard_normal((2, len(t)))
    columns = {"t": t, "q_rad": q + 1e-4 * noise[0], "tau": tau + 0.01 * noise[1]}
    (joint,) = report(columns, tmp_path)
    for name, key, truth in (("viscous_friction", "_Nm_s", 0.2), ("square_friction", "_Nm_s2", 0.3)):
        if name in named(joint):
            value = named(joint)[name]["parameters"][name + key]
            assert abs(value["value"] - truth) < 3 * value["stderr"]


def test_a_unit_that_is_not_known_is_one_problem(tmp_path):
    """Of `tau_Nmm` it said as well that the torque is missing; a step of 2000 s was asked about as milliseconds."""
    columns = plain(count=600)
    path = write(columns, tmp_path / "joint.csv", {"tau": "tau_Nmm"})
    with pytest.raises(InputError, match="the unit of the column 'tau_Nmm' is not known") as error:
        read_joints([path])
    assert "missing" not in str(error.value)
    for factor, unit in ((1e3, "milliseconds"), (1e6, "microseconds")):
        path = write(columns | {"t": factor * columns["t"]}, tmp_path / "joint.csv")
        with pytest.raises(InputError, match=unit):
            read_joints([path])
