"""Recordings of joints: what is read, refused, named, and what is not claimed."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.joint.findings import joint_report
from st_codegen.reconcile.joint.mode import JointResponse, find_mode
from st_codegen.reconcile.joint.parts import KINDS
from st_codegen.reconcile.joint.reading import joint_files, read_joints
from st_codegen.reconcile.joint.rows import JointRows
from st_codegen.reconcile.joint.run import reconcile_joints
from st_codegen.rig.effects import Constants
from tests.cli.helpers import run

from .machine import Joint, Measured, simulate, write

pytestmark = pytest.mark.thorough

COUNT, STEP = 4000, 0.005


def plain(friction=1.0, viscous=0.5, count=COUNT, torque=0.02, ripple=0.0):
    """A rigid joint by formula: fast to make, for what is not about physics."""
    rng = np.random.default_rng(1)
    t = np.arange(count) * STEP
    waves = [(0.13, 0.8, 0.1), (0.29, 0.4, 1.2), (0.53, 0.15, 2.0)]
    q, dq, ddq = (
        sum(a * (2 * np.pi * f) ** d * np.sin(2 * np.pi * f * t + p + d * np.pi / 2) for f, a, p in waves)
        for d in range(3)
    )
    tau = 2.0 * ddq + 4.0 * np.cos(q) + friction * np.sign(dq) + viscous * dq + 0.3 + ripple * np.cos(40.0 * q)
    return {"t": t, "q": q, "dq": dq, "tau": tau + torque * rng.standard_normal(count)}


def report(columns, folder, constants=None, **options):
    found = reconcile_joints(read_joints([write(columns, folder / "joint.csv")]), **options)
    return joint_report(found, constants)["joints"]


def named(joint):
    return {effect["name"]: effect for effect in joint["effects"]}


def test_each_part_is_the_torque_of_its_law():
    """Two rows, one of each direction, at the first and the last second; laws with a scale have it at 2."""
    speed, two = np.array([1.0, -3.0]), np.zeros(2)
    rows = JointRows(
        np.array([0.0, 4.0]), two, speed, two, two, two, np.array([2.0, 4.0]), np.array([6.0, 1.0]), np.zeros((2, 0)),
        np.zeros(2, int), 0.01, (0.0, 0.0), 0, STEP,
    )  # fmt: skip
    load = np.array([[5.0, 7.0], [-2.0, 3.0]])
    drift = np.array([-0.5, 0.5])  # at both ends what warms up has changed by as much as what changes evenly
    expected = {
        "dry_friction": [[1, -1]],
        "viscous_friction": [speed],
        "square_friction": [[1, -9]],
        "curved_friction": [
            [np.exp(-0.5), -np.exp(-1.5)],
            [np.exp(-0.25), -np.exp(-2.25)],
            [1 / 1.5, -1 / 2.5],
        ],
        "direction_dependent_friction": [[1, 3]],
        "load_dependent_friction": [[5, -2], [7, -3]],
        "dry_friction_drift": 2 * [[1, -1] * drift],
        "viscous_friction_drift": 2 * [speed * drift],
        "torque_zero_drift": 2 * [drift],
        "reversal_travel": [[np.exp(-1.0), -np.exp(-2.0)]],
        "reversal_time": [[np.exp(-3.0), -np.exp(-0.5)]],
    }
    found = {name: [law.column(rows, 2.0, load).tolist() for law in kind.laws] for name, kind in KINDS.items()}
    assert found == {name: [pytest.approx(np.array(law, float)) for law in laws] for name, laws in expected.items()}


def test_friction_and_ripple_with_their_sizes(tmp_path):
    (joint,) = report(plain(viscous=0.05, ripple=0.1), tmp_path, Constants())
    found = named(joint)
    # the largest first
    assert list(found) == ["dry_friction", "torque_ripple", "viscous_friction"]
    for name, key, truth in (
        ("dry_friction", "dry_friction_Nm", 1.0),
        ("viscous_friction", "viscous_friction_Nm_s", 0.05),
        ("torque_ripple", "amplitude_Nm", 0.1),
        ("torque_ripple", "order_per_revolution", 40.0),
    ):
        assert found[name]["parameters"][key]["value"] == pytest.approx(truth, rel=0.03)
    # no other friction would do in the place of one
    assert [effect["alternatives"] for effect in joint["effects"]] == [[], [], []]
    # which part of a machine makes it is said only where there is a machine, and by its order alone
    assert "the pins (40)" in found["torque_ripple"]["remarks"][0]
    assert joint["verdict"] == "explained"
    assert joint["gap"]["held_out"]["after"] < 1.25 * joint["gap"]["held_out"]["noise_floor"]


def test_drag_of_the_square_of_speed_is_not_called_viscous(tmp_path):
    columns = plain(viscous=0.0)
    columns["tau"] += 1.5 * columns["dq"] * np.abs(columns["dq"])
    (joint,) = report(columns, tmp_path)
    found = named(joint)
    assert set(found) == {"dry_friction", "square_friction"}
    assert found["square_friction"]["parameters"]["square_friction_Nm_s2"]["value"] == pytest.approx(1.5, rel=0.02)
    assert found["dry_friction"]["parameters"]["dry_friction_Nm"]["value"] == pytest.approx(1.0, rel=0.02)
    assert joint["verdict"] == "explained"


def test_forms_that_noise_does_not_tell_apart_are_both_said(tmp_path):
    """Then what one of them has taken belongs to it, and the error of the dry part holds the other one too."""
    columns = plain(viscous=0.0, torque=1.0)
    columns["tau"] += 0.6 * columns["dq"] * np.abs(columns["dq"])
    (joint,) = report(columns, tmp_path)
    found = named(joint)
    (form,) = found.keys() & {"viscous_friction", "square_friction"}
    (other,) = {"viscous friction", "square friction"} - {form.replace("_", " ")}
    assert other in found[form]["alternatives"]
    dry = found["dry_friction"]["parameters"]["dry_friction_Nm"]
    assert abs(dry["value"] - 1.0) < 2 * dry["stderr"]


def test_nothing_but_a_rigid_joint(tmp_path):
    (joint,) = report(plain(friction=0.0, viscous=0.0), tmp_path)
    assert joint["effects"] == []
    assert joint["verdict"] == "nothing_missing"


def test_a_hum_is_no_ripple(tmp_path):
    columns = plain()
    columns["tau"] += 0.2 * np.sin(2 * np.pi * 7.3 * columns["t"])
    (joint,) = report(columns, tmp_path)
    assert "torque_ripple" not in named(joint)
    assert any("7.3 Hz over time" in text for text in joint["unexplained"])
    assert joint["verdict"] == "partly_explained"


def test_what_one_direction_cannot_show(tmp_path):
    columns = plain()
    back = columns["dq"] < 0
    columns["q"] = columns["q"] + 4.0 * columns["t"]
    columns["dq"] = columns["dq"] + 4.0
    columns["tau"] = columns["tau"] + 2.0 * back + 2.0 + 4 * np.cos(columns["q"])
    path = write(columns, tmp_path / "joint.csv", {"q": "q_rad"})
    (joint,) = joint_report(reconcile_joints(read_joints([path])), None)["joints"]
    assert "dry_friction" not in named(joint)
    assert any("never reverses" in text for text in joint["cannot_show"])


def test_units_in_names_are_the_same_data(tmp_path):
    columns = plain()
    degrees = {"t": columns["t"], "q_deg": np.rad2deg(columns["q"]), "dq_rpm": columns["dq"] * 30 / np.pi}
    degrees["tau_Nm"] = columns["tau"]
    one, other = (read_joints([write(c, tmp_path / name)])[0] for c, name in ((columns, "a.csv"), (degrees, "b.csv")))
    np.testing.assert_allclose(other.angle[""], one.angle[""], rtol=1e-7)
    np.testing.assert_allclose(other.speed[""], one.speed[""], rtol=1e-7, atol=1e-9)


def changed(**values):
    columns = plain(count=800)
    return columns | {key: change(columns) for key, change in values.items()}


def with_value(column, row, value):
    found = column.copy()
    found[row] = value
    return found


BAD = {
    "nan": (
        changed(tau=lambda c: np.nan * c["tau"]),
        "line 2 and 799 more: values of tau are not finite; these samples count as lost: 0 are left",
    ),
    "repeats": (changed(t=lambda c: with_value(c["t"], 7, c["t"][6])), "does not rise from line 8"),
    "gaps": (changed(t=lambda c: np.cumsum(np.where(np.arange(800) % 90, 0.005, 0.05))), "8 wider ones only 0 of 800"),
    "deg": (changed(dq=lambda c: np.rad2deg(c["dq"])), "57.3 times the rate of q: dq in deg/s"),
    "degrees": ({key: 57.3 ** (key == "q") * plain()[key] for key in ("t", "q", "tau")}, "is it in degrees"),
    "other speed": (changed(dq=lambda c: c["dq"][::-1].copy()), "not the speed of q"),
    "short": ({key: value[:100] for key, value in plain().items()}, "100 samples only, at least"),
    "still": (changed(q=lambda c: 0 * c["q"], dq=lambda c: 0 * c["q"]), "no joint moves"),
    "no torque": (changed(tau=lambda c: 0 * c["q"]), "never changes"),
    "sign": (plain() | {"tau": -plain()["tau"]}, "--accept sign turns it"),
    "unit": ({("q_mm" if key == "q" else key): value for key, value in plain(count=800).items()}, "unit of the column"),
    "huge": (changed(tau=lambda c: with_value(c["tau"], 7, 1e300)), r"line 9: tau of 1e\+300 is no value of a joint"),
    "jump": (changed(q=lambda c: c["q"] + 0.3 * (c["t"] > 2.0)), r"q jumps by 0\.\d+ from line 402 to the next"),
    "turn": (changed(q=lambda c: c["q"] + 6.283 * ((c["t"] > 2.0) & (c["t"] < 4.0))), r"q jumps by -?6\.\d+ from line"),
    "rest": (changed(q=lambda c: c["q"] + 6.283 * (np.arange(800) % 2) * (c["t"] < 0.5)), r"q jumps by -?6\.\d+ from"),
    "missing": ({"t": plain()["t"], "q1": plain()["q"], "tau2": plain()["tau"]}, "column 'tau1' is missing"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_input_is_refused_with_its_reason(tmp_path, kind):
    columns, words = BAD[kind]
    path = write(columns, tmp_path / "joint.csv")
    assert joint_files(path) == [path]
    with pytest.raises(InputError, match=words):
        reconcile_joints(read_joints([path]))


def test_an_accepted_sign_is_turned(tmp_path):
    columns = plain()
    (joint,) = report(columns | {"tau": -columns["tau"]}, tmp_path, accept=("sign",))
    assert {"dry_friction", "viscous_friction"} <= set(named(joint))
    assert any("was turned" in text for text in joint["measurement"])


def test_the_command_writes_a_page_without_a_rig(tmp_path, capsys):
    path = write(plain(count=4000, ripple=0.2), tmp_path / "joint.csv")
    out = tmp_path / "the joints that were measured" / ("by the long name " * 8).strip()
    assert run("reconcile", "--measured", path, "--out", out) == 0
    # no line is broken where no terminal is: a path would be in two pieces
    assert f"Read next: {out / 'report.html'}" in capsys.readouterr().err.splitlines()
    content = json.loads((out / "report.json").read_text())
    assert content["kind"] == "joints"
    page = (out / "report.html").read_text()
    assert "Nm_s" not in re.sub(r"\w+_Nm_s\w*", "", page)  # names of parameters apart: "N m per rad/s" is the unit
    for effect in content["joints"][0]["effects"]:
        assert effect["text"].split(" of ")[0] in page
    assert page.count("<svg") >= 1
    assert not any("parts" in remark for one in content["joints"][0]["effects"] for remark in one["remarks"])
    (tmp_path / "rig.toml").write_text("[rig]\nreduction_ratio = 81.0\npins = 40\n")
    assert run("reconcile", "--rig", tmp_path / "rig.toml", "--measured", path, "--out", tmp_path / "out") == 0
    (joint,) = json.loads((tmp_path / "out" / "report.json").read_text())["joints"]
    assert any("of the machine's parts" in remark for one in joint["effects"] for remark in one["remarks"])
    (tmp_path / "table.csv").write_text("order,median_deg\n")
    capsys.readouterr()
    assert run("reconcile", "--measured", tmp_path / "table.csv", "--out", tmp_path / "out") == 2
    assert "--rig" in capsys.readouterr().err


@pytest.mark.slow
def test_a_spring_between_motor_and_load(tmp_path):
    joint = Joint(dry=1.0, viscous=0.8, spring_Hz=30.0)
    (found,) = report(simulate(joint, Measured(seed=4, shake=3.0, seconds=20.0)), tmp_path)
    mode = named(found)["elasticity"]["parameters"]
    assert mode["resonance_Hz"]["value"] == pytest.approx(30.0 * 2**0.5, rel=0.02)
    assert mode["antiresonance_Hz"]["value"] == pytest.approx(30.0, rel=0.02)
    assert named(found)["dry_friction"]["parameters"]["dry_friction_Nm"]["value"] == pytest.approx(1.0, rel=0.03)
    # shaken alike, a stiff joint shows none
    (stiff,) = report(simulate(replace(joint, spring_Hz=0.0), Measured(seed=4, shake=3.0, seconds=20.0)), tmp_path)
    assert "elasticity" not in named(stiff)


def test_of_the_places_where_a_mode_is_sought_the_best_one_counts():
    resonance_Hz = 60.0
    random, s = np.random.default_rng(0), 2j * np.pi * np.linspace(2.0, 100.0, 50)
    above, below = 2 * np.pi * resonance_Hz, 2 * np.pi * resonance_Hz / 1.4
    inertia = 0.01 * (1 + (s**2 + 0.1 * above * s) / above**2) / (1 + (s**2 + 0.1 * below * s) / below**2)
    error = 0.01 * np.abs(inertia)
    whole, *halves = (
        inertia + size * error * (random.standard_normal(50) + 1j * random.standard_normal(50))
        for size in (1.0, 2**0.5, 2**0.5)
    )
    found = find_mode(JointResponse(s.imag / (2 * np.pi), whole, error, tuple(halves), 2**0.5 * error))
    assert abs(found.resonance_Hz - resonance_Hz) < 4 * found.resonance_error
    assert found.damping == pytest.approx(0.05, abs=4 * found.damping_error)


def test_one_speed_does_not_tell_dry_from_viscous(tmp_path):
    (joint,) = report(simulate(Joint(dry=1.0, viscous=0.8), Measured(path="one_speed", seconds=20.0)), tmp_path)
    found = named(joint)
    assert "dry_friction" not in found
    assert found["friction"]["parameters"]["friction_Nm"]["value"] == pytest.approx(1.4, rel=0.05)


@pytest.mark.parametrize("seed", [0, 11, 12])
def test_a_part_that_may_hold_another_one_has_an_error_that_says_so(tmp_path, seed):
    """Of 0.08 of the load beside dry friction it said 0.221 +- 0.06, or 2.23 +- 0.5 N m of dry friction alone."""
    random, time = np.random.default_rng(seed), np.arange(0, 60, 1 / 500)
    angle, speed, change = np.zeros((3, len(time)))
    for harmonic in range(1, 7):
        rate, size, phase = 0.2 * np.pi * harmonic, 0.8 * random.uniform(0.5, 1) / harmonic, random.uniform(0, 6.28)
        angle += size * np.sin(rate * time + phase)
        speed += size * rate * np.cos(rate * time + phase)
        change -= size * rate**2 * np.sin(rate * time + phase)
    load = 1.5 * change + 12 * np.cos(angle + 0.3)
    torque = load + np.tanh(speed / 0.005) * (1.0 + 0.08 * np.abs(load)) + 0.7 * speed
    noise = np.random.default_rng(1).standard_normal((3, len(time))) * [[1e-5], [1e-3], [0.02]]
    columns = {"t": time, "q": angle + noise[0], "dq": speed + noise[1], "tau": torque + noise[2]}
    (joint,) = report(columns, tmp_path)
    found = named(joint)
    truth = {"dry_friction": 1.0, "load_dependent_friction": 0.08, "viscous_friction": 0.7}
    for name in truth.keys() & found.keys():
        (number,) = found[name]["parameters"].values()
        assert abs(number["value"] - truth[name]) < 2.5 * number["stderr"], (name, number)
    assert found.keys() & {"dry_friction", "load_dependent_friction"}
