"""Recordings over time: which angles suffice, and all that is wrong with a file at once."""

import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.data.recordings import (
    ANGLES,
    Recording,
    _directions,
    is_recording,
    is_whole_turn,
    observations,
    read_recordings,
    speed_of,
    step_of,
)
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.claims import Claim, Conclusions, Retuned
from st_codegen.reconcile.judge.lookalikes import is_a_knee
from st_codegen.reconcile.judge.recorded import with_doubts
from st_codegen.reconcile.mistakes.recorded import _jumps, _least_at, _other_angle, _other_speed, check_recordings
from st_codegen.reconcile.outcome import Gap, Outcome
from st_codegen.reconcile.report.findings import _how_sure, findings, share_text
from st_codegen.reconcile.report.sentences import _few_samples, _sidebands, floor_text, left_text, verdict_text
from st_codegen.reconcile.rest.lines import _slow, _while_it_changes, lines_in_samples, stand_out, waves_of_angle
from st_codegen.reconcile.run import _is_left_of_mean, reconcile_files, reconcile_recordings
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, catalogue
from st_codegen.rig.model import parse_rig

RIG = """
[rig]
reduction_ratio = 81.0
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.01
phase_rad = 0.0
[[effect]]
name = "control_lag"
lag_ms = 5.0
[[effect]]
name = "coupling_compliance"
stiffness_Nm_per_rad = 5000.0
"""


def recorded(path, columns=("t", *ANGLES, "torque_Nm", "temperature_C")):
    """Half a turn at 600 rpm of the motor, by the rig's own links."""
    rig = parse_rig(RIG)
    lag, coupling = rig.effects[1:]
    time = np.arange(4000) * 1e-3
    reference = 3600.0 * time
    at = Conditions.of(np.ones(len(time)), 600.0, 400.0, 30.0)
    motor = lag.motor_angle(time, reference)
    fast = motor + coupling.twist(at)
    out = fast / 81.0
    for _ in range(5):
        out = fast / 81.0 + rig.te_deg(out, 1.0, 600.0, 400.0, 30.0)
    every = dict(zip(ANGLES, (reference, motor, fast, out), strict=True))
    every |= {"t": time, "torque_Nm": at.torque_Nm, "temperature_C": at.temperature_C}
    np.savetxt(path, np.column_stack([every[c] for c in columns]), "%.12g", ",", header=",".join(columns), comments="")
    return rig


@pytest.mark.parametrize("fast", ["theta_ref", "theta_mot", "theta_in"])
def test_any_angle_of_the_fast_side_gives_the_error(fast, tmp_path):
    """By the rig's own links: the error is the rig's, whichever angle was recorded beside the output."""
    rig = recorded(tmp_path / "r.csv", ("t", fast, "theta_out", "torque_Nm", "temperature_C"))
    data = observations(read_recordings([tmp_path / "r.csv"]), rig)
    te = 0.01 * np.cos(data.angle_rad)
    assert data.values[:, 0].real == pytest.approx(te, abs=1e-5)


def test_one_angle_does_not_suffice(tmp_path):
    recorded(tmp_path / "r.csv", ("t", "theta_out", "torque_Nm", "temperature_C"))
    assert is_recording(tmp_path / "r.csv")
    with pytest.raises(InputError, match="do not suffice"):
        read_recordings([tmp_path / "r.csv"])


def test_all_problems_of_all_files_at_once(tmp_path):
    recorded(tmp_path / "a.csv", ("t", "theta_in", "theta_out"))
    recorded(tmp_path / "b.csv")
    lines = (tmp_path / "b.csv").read_text().splitlines()
    (tmp_path / "b.csv").write_text("\n".join([*lines[:50], lines[10]]) + "\n")
    (tmp_path / "c.csv").write_text("t,theta_in,theta_out\n1,2\n")
    with pytest.raises(InputError) as caught:
        read_recordings([tmp_path / name for name in ("a.csv", "b.csv", "c.csv")])
    for text in (
        "torque_Nm, temperature_C are missing",
        "50 samples only, at least",
        "does not rise from row 50",
        "c.csv",
    ):
        assert text in str(caught.value), text


def test_cells_of_a_recording_that_are_empty_or_not_finite_are_named_alike(tmp_path):
    """Of an empty one it was said that it is to be nan, of nan that it is not finite."""
    recorded(tmp_path / "r.csv")
    head, first, second, *others = (tmp_path / "r.csv").read_text().splitlines()
    first, second = ("".join([line.rpartition(",")[0], ",", cell]) for line, cell in ((first, ""), (second, "nan")))
    (tmp_path / "r.csv").write_text("\n".join([head, first, second, *others]) + "\n")
    name = head.rpartition(",")[2]
    with pytest.raises(
        InputError, match=f"(?s)line 2: {name}: '' is not a number\n.*line 3: {name}: 'nan' is not finite"
    ):
        read_recordings([tmp_path / "r.csv"])


def test_a_wave_over_the_angle_has_to_stand_out_of_what_is_around():
    """Steps and wanders hold all orders, the low ones most; every one of these was an unexplained order."""
    order = np.arange(80)
    falling = 1e-6 / np.maximum(order, 1.0) ** 2
    everywhere = np.ones(80, bool)
    assert not stand_out(falling, falling, everywhere).any()
    lines = falling.copy()
    lines[[7, 40]] *= (40.0, 20.0)
    assert np.flatnonzero(stand_out(lines, lines, everywhere)).tolist() == [7, 40]
    # what leaks beside it does not hide it, nor is it a line; orders that the rig makes are no surroundings
    lines[[6, 8]] = lines[7] / 5
    assert stand_out(lines, lines, everywhere)[7] and not stand_out(lines, lines, everywhere)[[6, 8]].any()
    busy = falling.copy()
    busy[[38, 42, 43]] = 1.0
    assert not stand_out(lines, busy, everywhere)[40]
    assert stand_out(lines, busy, ~np.isin(order, [38, 42, 43]))[40]


def test_samples_have_the_waves_that_were_put_in(tmp_path):
    rig = recorded(tmp_path / "r.csv")
    data = observations(read_recordings([tmp_path / "r.csv"]), rig)
    angle = np.linspace(0.0, 6 * np.pi, 9000, endpoint=False) ** 1.0
    turns = replace(data.rows(np.arange(len(data))[np.zeros(9000, int)]), angle_rad=angle)
    samples = 0.3 + 2e-3 * np.cos(5 * angle + 0.4) + 1e-3 * np.cos(77 * angle - 2.0)
    waves = waves_of_angle(turns, samples, 90)
    assert waves[0].real == pytest.approx(0.3)
    assert waves[5] == pytest.approx(2e-3 * np.exp(0.4j), abs=1e-12)
    assert waves[77] == pytest.approx(1e-3 * np.exp(-2.0j), abs=1e-12)
    # each as one RMS: that of the mean is its size
    target = FitData(turns, np.full((9000, 1), 1e-9), np.ones(9000, bool), groups_of(turns.at))
    noise = 1e-9 * np.random.default_rng(0).standard_normal(9000)
    lines = lines_in_samples(target, (samples + noise)[:, None].astype(complex), 90)
    assert {one.order: one.rms_deg for one in lines} == {
        0: pytest.approx(0.3, rel=1e-6),
        5: pytest.approx(2e-3 / np.sqrt(2), rel=1e-4),
        77: pytest.approx(1e-3 / np.sqrt(2), rel=1e-4),
    }


@pytest.mark.thorough
def test_a_step_in_the_middle_of_a_recording_is_no_order_and_no_changed_parameter(tmp_path):
    for number, torque in enumerate((200.0, 800.0)):
        t, turns = np.arange(1200) * 6.7e-3, 1.6
        fast = 81.0 * 360.0 * turns * t / t[-1]
        out = fast / 81.0
        at = np.deg2rad(out)
        wave = 0.01 * np.cos(at) + 2e-4 * np.random.default_rng(number).standard_normal(len(t))
        step = 0.012 * (t > 5.0 + number)
        rows = np.column_stack([t, fast, fast, out + wave + step, np.full(len(t), torque), np.full(len(t), 30.0)])
        names = "t,theta_mot,theta_in,theta_out,torque_Nm,temperature_C"
        np.savetxt(tmp_path / f"{number}.csv", rows, "%.12g", ",", header=names, comments="")
    result = reconcile_files(parse_rig(RIG), tmp_path, catalogue(()))
    assert not result.conclusions.claims
    assert all(entry.before.name == "coupling_compliance" for entry in result.conclusions.retuned)
    assert all(one.order == 0 for one in result.unexplained)
    assert "floors; only waves of the angle that stand out of it are listed" in left_text(result)
    assert result.verdict != "explained" and result.held_out.after > 5 * result.held_out.noise_floor


def test_a_changed_wave_is_told_of_samples_and_other_names_are_asked(tmp_path):
    """All orders are one column of samples: the question which names do as well ended in an error of the program."""
    known, paths = catalogue(), []
    for number, (speed, torque) in enumerate([(1500.0, 100.0), (900.0, 1500.0)]):
        time = np.arange(800) * 1e-2
        fast = 6.0 * speed * time
        out = fast / 81.0
        rig = parse_rig(RIG.replace("0.01", "0.02"), known=known)
        te = rig.te_deg(out, 1.0, speed, torque, 30.0) + 1e-4 * np.random.default_rng(number).standard_normal(len(time))
        paths.append(tmp_path / f"r{number}.csv")
        columns = np.column_stack([time, fast, out + te, np.full(len(time), torque), np.full(len(time), 30.0)])
        np.savetxt(paths[-1], columns, "%.12g", ",", header="t,theta_in,theta_out,torque_Nm,temperature_C", comments="")
    result = reconcile_recordings(parse_rig(RIG, known=known), read_recordings(paths), known)
    assert "output_shaft_eccentricity" in [entry.after.name for entry in result.conclusions.retuned]


def test_behind_a_reversal_the_output_stands_until_the_play_is_travelled(tmp_path):
    """Its samples had the mean of the other direction: a sound axis that turns back had "something differs"."""
    known, time = catalogue(()), np.arange(4000) * 5e-3
    rig = parse_rig(RIG + '[[effect]]\nname = "friction_windup"\ncoulomb_arcmin = 1.5\n', known=known)
    speed = np.clip(np.abs((time % 10.0) - 5.0) * 1200.0 - 3000.0, -600.0, 600.0)  # rpm, a ramp through 0
    fast = np.cumsum(6.0 * speed) * 5e-3
    turned = np.diff(fast, prepend=fast[0]) / 81.0
    back = rig.coefficients(Conditions.of([1.0, -1.0], 600.0, 400.0, 30.0), (0,)).real[:, 0]
    side, te = back[0], np.empty(len(time))
    for i, step in enumerate(turned):
        side = np.clip(side - step, back.min(), back.max())
        te[i] = side
    out = fast / 81.0 + te
    for _ in range(5):
        out = fast / 81.0 + te + 0.01 * np.cos(np.deg2rad(out))
    out += 1e-4 * np.random.default_rng(0).standard_normal(len(time))
    rows = np.column_stack([time, fast, out, np.full(len(time), 400.0), np.full(len(time), 30.0)])
    np.savetxt(
        tmp_path / "r.csv", rows, "%.12g", ",", header="t,theta_in,theta_out,torque_Nm,temperature_C", comments=""
    )
    result = reconcile_files(rig, tmp_path / "r.csv", known)
    assert result.verdict == "nothing_missing"
    assert result.held_out.after == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("acts", [False, True])
@pytest.mark.parametrize("stiffness", [200.0, 90.0])
def test_what_a_sensor_scatters_by_is_no_load_unless_te_follows_it(acts, stiffness):
    """At one torque, read to 1 N m, a sound axis had no compliance at all, and another backlash.

    A rig that is over twice too soft leaves more with the load than without it.
    """
    text = RIG + '[[effect]]\nname = "torsional_compliance"\nstiffness_Nm_per_arcmin = {}\n'
    rig, assumed = (parse_rig(text.format(value)) for value in (200.0, stiffness))
    random, time = np.random.default_rng(0), np.arange(4000) * 5e-3
    fast, out = 3600.0 * time, 3600.0 * time / 81.0
    torque = 400.0 + random.standard_normal(len(time))
    for _ in range(5):
        out = fast / 81.0 + rig.te_deg(out, 1.0, 600.0, torque if acts else 400.0, 30.0)
    out += 2e-5 * random.standard_normal(len(time))
    at = Conditions.of(1.0, 600.0, torque, 30.0)
    data = observations([Recording("r", time, {"theta_in": fast, "theta_out": out}, at)], assumed)
    assert bool(np.ptp(data.at.torque_Nm) > 0.0) == acts


#: one direction, both, and both at several speeds: rpm with the sign of the direction, and N m


def test_a_wander_of_the_mean_and_turns_that_are_not_whole_make_no_orders():
    """Nine and a half turns there and back: order 5 leaked into 1, 2 and 4; a third of the wander was said."""
    count, random = 6000, np.random.default_rng(1)
    time = np.arange(count) / 115.0
    speed = np.deg2rad(6.0) * np.where(time < 20, 7.4, np.where(time < 30, -11.0, 14.0))
    angle = np.cumsum(speed) / 115.0
    wander = 3e-3 * np.sin(2 * np.pi * time / 70)
    te = wander + 8e-4 * np.cos(5 * angle + 0.3) + 1e-4 * random.standard_normal(count)
    at = Conditions.of(np.sign(speed), 900.0, 500.0, 30.0)
    data = Observations(at, ("",) * count, np.zeros(1, np.int64), te[:, None] + 0j, angle, (0, 1))
    target = SimpleNamespace(data=data, sigma=np.full((count, 1), 1e-4))
    found = {one.order: one.rms_deg for one in lines_in_samples(target, data.values)}
    assert found == {
        0: pytest.approx(np.sqrt((wander**2).mean()), rel=0.01),
        5: pytest.approx(8e-4 / np.sqrt(2), rel=0.01),
    }


def test_what_is_slow_is_slow_over_the_angle():
    """Two turns in half of the rows and a hundred in the others: an order of the slow half was called the mean."""
    count = 3000
    random, is_slow = np.random.default_rng(0), np.arange(2 * count) < count
    # even steps show any order as others too
    angle = np.cumsum(np.where(is_slow, 2.0, 200.0 * random.uniform(size=2 * count)) * 2 * np.pi / count)
    te = 1e-3 * np.cos(3 * angle) * is_slow + 1e-5 * random.standard_normal(2 * count)
    at = Conditions.of(np.ones(2 * count), 900.0, 500.0, 30.0)
    data = Observations(at, ("",) * (2 * count), np.zeros(1, np.int64), te[:, None] + 0j, angle, (0, 1))
    target = SimpleNamespace(data=data, sigma=np.full((2 * count, 1), 1e-5))
    found = {one.order: one.rms_deg for one in lines_in_samples(target, data.values)}
    # half of the rows have it, and so half of its power is over all of them
    assert max(found, key=found.get) == 3 and found[3] == pytest.approx(5e-4, rel=0.1)


def test_a_mean_that_wanders_has_few_waves_and_none_of_what_lies_between_two_files():
    """Of 1600 turns each second row was the mean's; between files the angle jumps, and nothing is travelled."""
    angle, files = np.linspace(0.0, 1600 * 2 * np.pi, 3000), np.zeros(3000, np.int64)
    assert _slow(angle, np.ones(3000), files).shape[1] <= SETTINGS.most_waves_of_mean + 1
    angle, files = np.linspace(0.0, 4 * np.pi, 3000), np.repeat([0, 1], 1500)
    jumps = _slow(angle + 100.0 * files, np.ones(3000), files)
    assert jumps.shape[1] == 2 and np.isfinite(_slow(np.zeros(3000), np.ones(3000), files)).all()


def _left_of_two_recordings(wave, last=1, turns=6):
    """A target of two recordings, and a residual: noise of 1e-4 deg that lasts over samples, and a wave."""
    random, count = np.random.default_rng(1), 3000
    noise = np.convolve(random.standard_normal(2 * count + last - 1), np.ones(last) / np.sqrt(last), "valid")
    angle = np.tile(np.linspace(0.0, 2.0 * np.pi * turns, count), 2)
    phase = np.repeat([0.3, 2.0], count)
    samples = 1e-4 * noise + 5e-4 * (np.cos(wave * angle + phase) if wave else 0.0)
    at = Conditions.of(np.ones(2 * count), 600.0, 400.0, 30.0)
    labels = tuple(f"{name}.csv, t = {n} s" for name in "ab" for n in range(count))
    data = Observations(at, labels, np.zeros(1, np.int64), samples[:, None].astype(complex), angle, (0, 1))
    return FitData(data, np.full((len(data), 1), 1e-4), np.ones(len(data), bool), groups_of(at)), data.values


@pytest.mark.thorough
@pytest.mark.parametrize("wave", [39.77, 23.41, 57.3, 39.5])
def test_a_wave_between_two_orders_is_found_once_and_by_its_own_number(wave):
    """It was noise: "nothing was found missing", with a floor of 13 times the noise."""
    (one,) = lines_in_samples(*_left_of_two_recordings(wave))
    assert one.periods == pytest.approx(wave, abs=0.01) and f"about {wave:.1f} periods a turn" in one.text
    assert one.rms_deg == pytest.approx(5e-4 / np.sqrt(2), rel=0.02)


@pytest.mark.thorough
def test_a_wave_that_does_not_come_back_has_no_whole_number_of_periods():
    """One of 23.04 was "a wave of about 23.0 periods a turn: it does not come back after a turn"."""
    (one,) = lines_in_samples(*_left_of_two_recordings(23.04, turns=36))
    assert "about 23.04 periods a turn" in one.text


@pytest.mark.parametrize("last", [1, 4, 20, 100])
def test_noise_that_lasts_over_samples_is_no_wave(last):
    """As behind a low pass, of any width."""
    assert lines_in_samples(*_left_of_two_recordings(0.0, last)) == []


def test_a_whole_order_is_none_between_two():
    (one,) = lines_in_samples(*_left_of_two_recordings(40.0))
    assert one.order == 40 and one.periods == 0.0


def test_the_noise_of_neighbours_is_that_of_all_samples(tmp_path):
    """By the samples beside each other, not by those that were looked at; the machine's own waves are none of it."""
    rig = recorded(tmp_path / "r.csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    values[:, 4] += 1e-4 * np.random.default_rng(1).standard_normal(len(values))
    np.savetxt(tmp_path / "r.csv", values, "%.12g", ",", header=lines[0], comments="")
    assert observations(read_recordings([tmp_path / "r.csv"]), rig).neighbours_deg == pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize(("floor", "near", "is_said"), [(5e-4, 5e-4, False), (2.9e-3, 5e-4, True), (2.9e-3, 0.0, None)])
def test_a_hum_above_the_orders_is_not_called_nothing(floor, near, is_said):
    """Of a hum of 50 Hz, 405 waves a turn, it said that nothing was found missing, and no more."""
    data = SimpleNamespace(
        angle_rad=np.zeros(1), neighbours_deg=near, few_points=False, beyond_deg=None, rounded_deg=0.0
    )
    result = SimpleNamespace(
        verdict=Outcome.NOTHING_MISSING,
        data=data,
        unexplained=(),
        mistakes=(),
        noise=SimpleNamespace(suspects=()),
        held_out=SimpleNamespace(noise_floor=floor),
    )
    said = verdict_text(result)
    assert said.startswith("Nothing was found missing")
    if is_said is None:
        assert "0.0029 deg, is more than the noise from sample to sample, 0 deg" in said
        return
    assert ("0.0029 deg, is more than the noise from sample to sample, 0.0005 deg" in said) == is_said
    assert ("no line among the orders" in floor_text(result)) == is_said


def _asked(tmp_path, changes, accept=()):
    """What is asked of a recording whose columns are changed, and that has speeds as well."""
    rig = recorded(tmp_path / "r.csv")
    (r,) = read_recordings([tmp_path / "r.csv"])
    columns = {"t": r.time_s, **r.angles, "torque_Nm": r.at.torque_Nm, "temperature_C": r.at.temperature_C}
    columns |= {"speed_rpm": r.at.speed_rpm}
    columns |= {name: change(columns[name]) for name, change in changes.items()}
    rows = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "r.csv", rows, "%.12g", ",", header=",".join(columns), comments="")
    with pytest.raises(InputError) as caught:
        reconcile_files(rig, tmp_path / "r.csv", catalogue(()), accept=accept)
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"theta_out": np.deg2rad}, "as if theta_out is in rad"),
        ({"theta_out": lambda x: 3600 * x}, "as if theta_out is in arcsec"),
        ({"theta_out": np.negative}, "as if one of the two has the other sign"),
        ({"theta_in": lambda x: x % 360}, "theta_in jumps by -35"),
        (
            {"theta_in": lambda x: x * 79 / 81, "theta_mot": lambda x: x * 79 / 81},
            "a ratio of about 79.01, the rig has 81",
        ),
        ({"theta_out": lambda x: x + 40 / 9}, "theta_out is 4.44 deg, 1 turns of the fast side, off theta_in"),
        ({"theta_out": lambda x: x + 4.0 * (np.arange(len(x)) > 2000)}, "at t = 2.001 s: were turns lost?"),
        ({"theta_out": lambda x: np.minimum(x, 100.0)}, "theta_out does not follow theta_in over the ratio, 81, nor"),
        ({"theta_out": lambda x: 0.0 * x}, "theta_out never changes"),
        ({"theta_mot": lambda x: 1.001 * x + 200.0}, "theta_mot and theta_in are up to"),
        ({"speed_rpm": lambda x: x / 81}, "speed_rpm is 0.01235 times the rate"),
        ({"t": lambda x: 1000 * x}, "speed_rpm is 1000 times the rate"),
        ({"temperature_C": lambda x: x + 273.15}, "no oil has 303.15 degC; is temperature_C in K?"),
    ],
)
def test_units_zeros_and_signs_are_asked_about(changes, said, tmp_path):
    """It listed orders of a thousand degrees each, and no word of the unit."""
    found = _asked(tmp_path, changes)
    assert said in found and "give --accept as_is" in found


def test_a_gap_of_a_whole_turn_is_no_angle_that_begins_anew(tmp_path):
    recorded(tmp_path / "r.csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    rig = parse_rig(RIG)
    (r,) = read_recordings([tmp_path / "r.csv"])
    assert rows[100, 1] - rows[0, 1] == pytest.approx(360.0)
    check_recordings([r.rows(np.delete(np.arange(len(rows)), np.arange(1000, 1099)))], rig, tmp_path)


@pytest.mark.parametrize(
    ("factor", "said"), [(-1.0, "of the other sign"), (1 / 81, "those of the input"), (1e-3, "in kN m"), (0.8, None)]
)
def test_loads_in_another_unit_are_asked_about(factor, said):
    """The compliance was said to be 81 times as soft, with something_else."""
    rig = parse_rig(RIG + """[[effect]]\nname = "torsional_compliance"\nstiffness_Nm_per_arcmin = 450.0\n""")
    time = np.arange(1000) * 1e-2
    at = Conditions.of(np.ones(1000), 600.0, 400.0 + 100.0 * time, 30.0)
    out = 3600.0 / 81.0 * time
    te = rig.te_deg(out, at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C)
    read = replace(at, torque_Nm=factor * at.torque_Nm)
    r = Recording("r.csv", time, {"theta_in": 81.0 * (out - te), "theta_out": out}, read)
    is_asked = pytest.raises(InputError, match=f"the torques look like .*{said}") if said else nullcontext()
    with is_asked:
        check_recordings([r], rig, Path("r.csv"))


@pytest.mark.parametrize(("late", "said"), [(0.3, "0.3 s late"), (-0.05, "0.05 s early"), (0.0, None)])
def test_loads_that_are_late_are_asked_about(late, said):
    """Most of the gap was unexplained, and nothing told why."""
    rig = parse_rig(RIG + """[[effect]]\nname = "torsional_compliance"\nstiffness_Nm_per_arcmin = 450.0\n""")
    time = np.arange(2000) * 5e-3
    torque = [600.0 + 400.0 * np.sin(3.0 * t) + 100.0 * np.sin(7.0 * t) for t in (time, time - late)]
    at = Conditions.of(np.ones(2000), 600.0, torque[0], 30.0)
    out = 3600.0 / 81.0 * time
    te = rig.te_deg(out, at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C)
    r = Recording("r.csv", time, {"theta_in": 81.0 * (out - te), "theta_out": out}, replace(at, torque_Nm=torque[1]))
    with pytest.raises(InputError, match=f"torque_Nm looks {said}") if said else nullcontext():
        check_recordings([r], rig, Path("r.csv"))


def _even(rig, te=None, count=1000, step_s=1e-2, fast="theta_in"):
    """A recording at 600 rpm with the rig's transmission error, or another, and its output's angle."""
    time = np.arange(count) * step_s
    at = Conditions.of(np.ones(count), 600.0, 400.0, 30.0)
    out = 3600.0 / 81.0 * time
    te = rig.te_deg(out, at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C) if te is None else te * np.ones(count)
    return Recording("r.csv", time, {fast: 81.0 * (out - te), "theta_out": out}, at)


COMPLIANT = RIG + """[[effect]]\nname = "torsional_compliance"\nstiffness_Nm_per_arcmin = 450.0\n"""


@pytest.mark.parametrize("part", [0.0, 0.1, 0.2, 1.0])
def test_a_gear_that_errs_less_than_the_rig_has_its_angles_in_degrees(part):
    """Reading them as rad makes the error 57 times as large: nearer to the rig's, by the rig's own power alone."""
    rig = parse_rig(COMPLIANT)
    te = _even(rig).angles
    te = part * (te["theta_out"] - te["theta_in"] / 81.0) + 1e-5 * np.random.default_rng(0).standard_normal(1000)
    check_recordings([_even(rig, te)], rig, Path("r.csv"))


def test_angles_in_rad_are_asked_about_with_what_is_left_in_degrees():
    """1.8e-06 deg were said of 1e-4."""
    rig = parse_rig(COMPLIANT)
    r = _even(rig)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(1000)
    angles = {"theta_in": r.angles["theta_in"], "theta_out": r.angles["theta_out"] + noise}
    angles = {name: np.deg2rad(angle) for name, angle in angles.items()}
    read = replace(r, angles=angles, at=replace(r.at, speed_rpm=np.deg2rad(r.at.speed_rpm)))
    with pytest.raises(
        InputError, match=r"look like in rad: read so, the rig leaves (0.0001|9\.\de-05|1\.\d?e-04) deg"
    ):
        check_recordings([read], rig, Path("r.csv"))


def test_nothing_is_asked_where_nothing_is_left_and_a_lag_is_that_of_all_samples():
    """degF were asked about with 0 deg; and rows that came twice made the lag, and what is left, no number."""
    check_recordings([_even(parse_rig("[rig]\nreduction_ratio = 81.0\n"), 0.0)], parse_rig(RIG), Path("r.csv"))
    nothing = parse_rig("[rig]\nreduction_ratio = 81.0\n")
    check_recordings([_even(nothing, 0.0)], nothing, Path("r.csv"))
    rig = parse_rig(RIG)
    for count in (300, 3000):
        time = np.arange(count) * 1e-2
        reference = 3600.0 * time + 300.0 * np.sin(3.0 * time)
        out = rig.effects[1].motor_angle(time, reference) / 81.0
        at = Conditions.of(np.ones(count), 600.0, 0.0, 30.0)
        angles = {"theta_ref": reference, "theta_out": out + rig.te_deg(out, 1.0, 600.0, 0.0, 30.0)}
        r = Recording("r.csv", time, angles, replace(at, speed_rpm=np.abs(np.gradient(reference, time)) / 6.0))
        check_recordings([r], rig, Path("r.csv"))


@pytest.mark.parametrize("moved", [300.0, 340.0])
def test_fast_moves_between_pauses_are_no_angle_that_begins_anew(moved):
    """10 ms a sample, three fifths of the time at rest: 5000 rpm are 300 deg a step."""
    steps = np.where(np.arange(1000) % 50 < 20, moved, 0.0)
    angle = np.cumsum(steps)
    at = Conditions.of(np.ones(1000), 5000.0, 0.0, 30.0)
    r = Recording("r.csv", np.arange(1000) * 1e-2, {"theta_in": angle}, at)
    assert _jumps(r) == []
    assert "theta_in jumps by -3" in _jumps(replace(r, angles={"theta_in": (0.1 * angle) % 360.0}))[0]


@pytest.mark.parametrize(
    ("ratio", "factor", "said"),
    [
        (57.0, 180.0 / np.pi, "as if theta_in is in rad$"),
        (57.0, 57.0, "as if both are of the fast side$"),
        (60.0, 60.0, "as if theta_out is in arcmin or both are of the fast side$"),
    ],
)
def test_a_ratio_that_is_near_the_factor_of_a_unit_is_not_taken_for_it(ratio, factor, said):
    rig, out = parse_rig(f"[rig]\nreduction_ratio = {ratio}\n"), np.linspace(0.0, 500.0, 1000)
    at = Conditions.of(np.ones(1000), 600.0, 0.0, 30.0)
    r = Recording("r.csv", np.arange(1000) * 1e-2, {"theta_in": ratio * out, "theta_out": factor * out}, at)
    assert re.search(said, _other_angle(r, rig)[0])


def test_an_axis_at_rest_that_is_taken_as_it_is_ends_in_a_message(tmp_path):
    """It ended in an error of the program; and links alone need no turn of the fast side."""
    rest = {name: lambda x: 0.0 * x for name in (*ANGLES, "speed_rpm")}
    assert "the axis does not move" in _asked(tmp_path, rest, accept=("as_is",))
    rig, time = parse_rig(RIG), np.arange(1000) * 1e-3
    at = Conditions.of(np.ones(1000), 10.0, 0.0, 30.0)
    link = Recording("r.csv", time, {"theta_ref": 60.0 * time, "theta_mot": 60.0 * time}, at)
    check_recordings([link], rig, Path("r.csv"))


def test_a_delay_is_looked_for_within_its_limits():
    low, high = SETTINGS.delays_s
    for goal in (2.0 * high, -2.0 * high, 0.5 * low, 0.3):
        found = _least_at(lambda x, goal=goal: (x - goal) ** 2)
        assert low <= abs(found) <= high and found * goal > 0.0


def test_corrections_of_recordings_are_refused(tmp_path):
    """They were passed over in silence."""
    assert "recordings over time are not corrected" in _asked(tmp_path, {}, accept=("sign",))


@pytest.mark.thorough
def test_files_beside_recordings_are_named(tmp_path):
    """They were left out without a word."""
    rig = recorded(tmp_path / "r.csv")
    (tmp_path / "other.csv").write_text("time,theta_in,theta_out\n0,1,2\n")
    (tmp_path / "a_folder.csv").mkdir()
    assert (
        "other.csv: no recordings, which have the column t and one of"
        in (reconcile_files(rig, tmp_path, catalogue(())).data.not_looked_at[-1])
    )


def _left_of_a_resonance(first, last, centre, damping, turns, beside=()):
    """A target of one recording of a ramp of speed, and a residual: order 39 with its resonance, and constant waves."""
    random, count = np.random.default_rng(0), 6000
    time = np.sort(random.uniform(size=count))
    speed = first + (last - first) * time
    angle = (first * time + (last - first) * time**2 / 2) / (first + last) * turns * 4.0 * np.pi
    lifted = 1.0 / (1.0 - (speed / centre) ** 2 + 1j * damping * speed / centre)
    te = 1e-3 * (lifted * np.exp(39j * angle)).real + 1e-4 * random.standard_normal(count)
    te += sum(size * np.cos(order * angle + 0.7) for order, size in beside)
    at = Conditions.of(np.ones(count), speed, 500.0, 30.0)
    labels = tuple(f"a.csv, t = {n} s" for n in range(count))
    data = Observations(at, labels, np.zeros(1, np.int64), te[:, None] + 0j, angle, (0, 1), neighbours_deg=1e-4)
    return SimpleNamespace(data=data, sigma=np.full((count, 1), 1e-4)), data.values


def test_a_wave_that_grows_and_fades_has_its_whole_size():
    """Of a resonance that was passed the mean wave alone was said, four tenths of it."""
    target, left = _left_of_a_resonance(200.0, 1500.0, 750.0, 0.12, 20.0)
    (one,) = lines_in_samples(target, left)
    power = float((left.real**2).mean())
    assert one.order == 39 and one.rms_deg == pytest.approx(np.sqrt(power - 1e-8), rel=0.05)
    around = float(one.text.partition("around ")[2].partition(" rpm")[0])
    assert "order 39: " in one.text and "of a size or phase that changes: largest, 0.008" in one.text
    assert around == pytest.approx(750.0, rel=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "passed",
    [(100.0, 3000.0, 200.0, 0.12, 60.0), (200.0, 1500.0, 750.0, 0.02, 20.0), (1500.0, 200.0, 750.0, 0.03, 20.0)],
)
def test_a_resonance_that_is_passed_is_one_wave_and_orders_that_do_as_well_are_named(passed):
    """Its phase turns while it is passed: orders 38 and 36, or 38 and 39, were said of 39."""
    target, left = _left_of_a_resonance(*passed)
    (one,) = lines_in_samples(target, left)
    orders = [int(order) for order in re.findall(r"\d+", one.text.partition(":")[0])]
    assert 39 in orders and orders[0] == one.order and len(orders) <= 5
    assert one.rms_deg == pytest.approx(np.sqrt((left.real**2).mean()), rel=0.15)


@pytest.mark.thorough
def test_constant_waves_beside_a_resonance_and_beside_each_other_stay():
    target, left = _left_of_a_resonance(200.0, 1500.0, 750.0, 0.12, 20.0, [(37, 3e-3)])
    found = {one.order: one.rms_deg for one in lines_in_samples(target, left)}
    assert found == {37: pytest.approx(3e-3 / np.sqrt(2), rel=0.05), 39: pytest.approx(1.9e-3, rel=0.05)}
    target, left = _left_of_a_resonance(200.0, 1500.0, 1e6, 0.02, 20.0, [(38, 5e-4), (40, 5e-4)])
    assert sorted(one.order for one in lines_in_samples(target, left)) == [38, 39, 40]


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_what_an_angle_is_rounded_by_is_told_and_an_even_motion_is_no_rounding(noise):
    """The noise from sample to sample was said to be the floor, two fifths of it."""
    angle = 9000.0 * np.arange(3000) / 500.0 + noise * np.random.default_rng(0).standard_normal(3000)
    assert step_of(angle) == 0.0
    for step in (1e-2, 360.0 / 2**20, 360.0 / 10000):
        written = np.array([float(f"{x:.10g}") for x in step * np.round(angle / 81.0 / step)])
        assert step_of(written) == pytest.approx(step)


def test_waves_below_what_angles_are_rounded_by_are_not_told():
    target, samples = _left_of_two_recordings(40.0)
    coarse = replace(target, data=replace(target.data, rounded_by=np.full(len(target.data), 5e-4)))
    assert lines_in_samples(target, samples) and not lines_in_samples(coarse, samples)
    assert estimate(coarse.data, samples).floor_rms == pytest.approx(5e-4)


def test_where_few_samples_hold_what_is_left_is_said():
    """Of spikes, and of a place of the turn, nothing was said."""
    count = 6000
    angle = np.linspace(0.0, 20.0 * np.pi, count)
    labels = tuple(f"a.csv, t = {n} s" for n in range(count))
    at = Conditions.of(np.ones(count), 600.0, 400.0, 30.0)
    data = Observations(at, labels, np.zeros(1, np.int64), np.zeros((count, 1), complex), angle, (0,))
    left = 1e-4 * np.random.default_rng(0).standard_normal(count)

    def said(values, of_links=0.0):
        final = SimpleNamespace(residual=values[:, None].astype(complex))
        gap = SimpleNamespace(after=max(float(np.sqrt((values**2).mean())), of_links))
        return _few_samples(SimpleNamespace(data=data, conclusions=SimpleNamespace(final=final), held_out=gap))

    spikes = left + 0.3 * np.isin(np.arange(count), [100, 2500, 4001])
    assert said(left) == "" and "a.csv, t = " in said(spikes) and "of the output" not in said(spikes)
    one = left + 0.3 * (np.arange(count) == 2500)
    assert said(one) == (
        " One of 6000 samples that were looked at holds half of the power of what is left: 0.3 deg, "
        "at a.csv, t = 2500 s."
    )
    # of a gap that is the servo's or the coupling's the reducer's samples say nothing
    assert said(spikes, of_links=0.1) == ""
    bump = left + 5e-3 * np.exp(-0.5 * ((np.rad2deg(angle) % 360.0 - 120.0) / 1.0) ** 2)
    assert "of 120.0 deg of the output" in said(bump)
    # what stood at 124.22 deg was "within 0 deg of 124 deg"
    two = left + 0.3 * np.isin(np.arange(count), [207, 208]) + 0.1 * (np.arange(count) == 206)
    found = re.search(r"within ([\d.]+) deg of ([\d.]+) deg", said(two))
    reach, place = map(float, found.groups())
    assert (np.abs(np.rad2deg(angle[207:209]) - place) <= reach).all()


@pytest.mark.thorough
def test_a_zero_beside_a_mean_that_moves_may_be_something_else():
    """A step in mid-recording was called another zero of the encoders, without a doubt."""
    count = 3000
    angle = np.linspace(0.0, 12.0 * np.pi, count)
    step = 5e-3 * (np.arange(count) > count / 2)
    te = 0.01 * np.cos(angle) + step + 1e-4 * np.random.default_rng(0).standard_normal(count)
    rig = parse_rig(RIG)
    r = Recording(
        "r.csv",
        np.arange(count) * 0.01,
        {"theta_in": np.rad2deg(angle - np.deg2rad(te)) * 81.0, "theta_out": np.rad2deg(angle)},
        Conditions.of(np.ones(count), 600.0, 400.0, 30.0),
    )
    result = reconcile_recordings(rig, [r], catalogue(()))
    assert result.conclusions.offset_changed and result.conclusions.offset_is_open
    assert result.floor_is_bound and [one.order for one in result.unexplained] == [0]


def test_of_an_axis_that_stands_nothing_is_told(tmp_path):
    """Its noise was an error of the pins of half a degree."""
    found = _asked(tmp_path, {name: lambda x: 0.0 * x for name in ANGLES} | {"speed_rpm": lambda x: 0.0 * x})
    assert "the fast side turns by 0 of a turn at most" in found


def test_of_less_than_a_wave_no_order_is_told(tmp_path):
    rig = recorded(tmp_path / "r.csv")
    (r,) = read_recordings([tmp_path / "r.csv"])
    data = observations([r.rows(np.arange(1000))], rig)
    assert data.inside == (0, 1, *(order for order in data.inside if order >= 8)) and len(data.inside) > 10
    assert "orders below 7.33 but those of the rig: the output turns by 0.12 of a turn at most" in data.not_looked_at[0]
    angle = np.linspace(0.0, 0.8 * np.pi, 3000)
    slow = replace(data.rows(np.zeros(3000, int)), angle_rad=angle, neighbours_deg=1e-6)
    samples = 1e-3 * np.cos(angle) + 1e-6 * np.random.default_rng(0).standard_normal(3000)
    target = FitData(slow, np.full((3000, 1), 1e-6), np.ones(3000, bool), groups_of(slow.at))
    assert not {1, 2} & {one.order for one in lines_in_samples(target, samples[:, None].astype(complex))}


def test_each_recording_has_its_own_noise():
    """Of one of 1e-2 and one of 1e-5 deg the floor was said to be 1.5e-4 deg."""
    count = 3000
    level = np.repeat([1e-2, 1e-5], count)
    labels = tuple(f"{name}.csv, t = {n} s" for name in "ab" for n in range(count))
    at = Conditions.of(np.ones(2 * count), 600.0, 400.0, 30.0)
    values = (level * np.random.default_rng(0).standard_normal(2 * count))[:, None] + 0j
    found = estimate(Observations(at, labels, np.zeros(1, np.int64), values, np.zeros(2 * count), (0,)), values)
    assert found.sigma[[0, -1], 0] == pytest.approx([1e-2, 1e-5], rel=0.1)
    assert found.floor_rms == pytest.approx(1e-2 / np.sqrt(2), rel=0.1)


def test_what_one_recording_is_rounded_by_is_not_the_noise_of_another():
    """One that was written in steps of 0.02 deg set the noise of all."""
    rig, fine = parse_rig(COMPLIANT), _even(parse_rig(COMPLIANT))
    random = np.random.default_rng(0)
    angles = {name: angle + 1e-4 * random.standard_normal(1000) for name, angle in fine.angles.items()}
    fine = replace(fine, angles=angles)
    written = {**angles, "theta_out": 0.02 * np.round(angles["theta_out"] / 0.02)}
    coarse = replace(fine, name="coarse.csv", angles=written)
    data = observations([fine, coarse], rig)
    size = 0.02 / np.sqrt(12.0)
    assert data.rounded_by[[0, -1]] == pytest.approx([0.0, size])
    assert data.rounded_deg == pytest.approx(size / np.sqrt(2))
    assert data.rows(np.arange(10)).rounded_deg == 0.0
    left = 1e-4 * random.standard_normal((len(data), 1)) + 0j
    assert estimate(data, left).sigma[[0, -1], 0] == pytest.approx([1e-4, size], rel=0.1)


def test_recordings_without_the_output_say_nothing_of_the_noise_from_sample_to_sample():
    """They differ from the rig by nothing: with as many of them the noise was said to be 0.7 of what it is."""
    rig = parse_rig(COMPLIANT)
    r = _even(rig)
    noisy = r.angles["theta_out"] + 1e-4 * np.random.default_rng(0).standard_normal(1000)
    measured = replace(r, angles={**r.angles, "theta_out": noisy})
    fast = r.angles["theta_in"]
    link = Recording("link.csv", r.time_s, {"theta_ref": fast, "theta_mot": fast}, r.at)
    assert observations([measured, link], rig).neighbours_deg == pytest.approx(1e-4, rel=0.05)
    assert observations([link], rig).neighbours_deg == np.inf


def test_the_size_of_a_wave_that_changes_is_over_all_samples():
    """Pieces that do not tell it counted for nothing: a third of the recording was all of it."""
    target, _ = _left_of_two_recordings(0.0)
    angle = np.where(np.arange(6000) < 2000, target.data.angle_rad, 3.0)
    data = replace(target.data, angle_rad=angle)
    wave = 1e-3 * np.cos(40 * angle) * (np.arange(6000) < 2000)
    size = _while_it_changes(replace(target, data=data), wave, np.zeros(6000, np.int64), 40, 0.125)[0]
    assert size == pytest.approx(1e-3 / np.sqrt(6), rel=0.02)


def test_recordings_without_the_output_say_nothing_of_the_reducer(tmp_path):
    """Their samples agreed with any rig: with them an eccentricity three times the rig's was no change of it."""
    rig = recorded(tmp_path / "a.csv")
    recorded(tmp_path / "b.csv", ("t", "theta_mot", "theta_in", "torque_Nm", "temperature_C"))
    both = read_recordings([tmp_path / "a.csv", tmp_path / "b.csv"])
    found = observations(both, rig)
    assert {label.partition(",")[0] for label in found.labels} == {"a.csv"}
    assert found.not_looked_at[0] == "b.csv: without theta_out it says nothing of the reducer"
    assert {label.partition(",")[0] for label in observations(both[1:], rig).labels} == {"b.csv"}


def test_many_waves_of_constant_size_are_none_that_changes():
    """Of twelve beside each other the four that were not told made one of those that were "of a size that changes"."""
    count, random = 6000, np.random.default_rng(12)
    angle = np.linspace(0.0, 6.0 * np.pi, count)
    sizes = random.uniform(0.5e-3, 1.5e-3, 12) * np.exp(2j * np.pi * random.uniform(size=12))
    te = (np.exp(1j * np.outer(angle, np.arange(60, 72))) @ sizes).real + 1e-4 * random.standard_normal(count)
    at = Conditions.of(np.ones(count), 600.0, 500.0, 30.0)
    labels = tuple(f"a.csv, t = {n} s" for n in range(count))
    data = Observations(at, labels, np.zeros(1, np.int64), te[:, None] + 0j, angle, (0, 1), neighbours_deg=1e-4)
    lines = lines_in_samples(SimpleNamespace(data=data, sigma=np.full((count, 1), 1e-4)), data.values)
    assert len(lines) == SETTINGS.most_lines and not any("changes" in one.text for one in lines)


def _fit_of(pieces, at, change):
    """A fit of samples whose noise is 1e-4 deg: `change` of pieces is what they explain."""
    noise = 1e-4 * np.random.default_rng(0).standard_normal((len(at), 1))
    data = SimpleNamespace(at=at, angle_rad=np.zeros(len(at)), orders=np.zeros(1, np.int64))
    target = SimpleNamespace(data=data, good=np.ones(len(at), bool), sigma=np.full((len(at), 1), 1e-4))
    return SimpleNamespace(target=target, state=SimpleNamespace(pieces=pieces), residual=noise + 0j, explained=change)


def _to_and_fro(count=3000):
    torque = 500.0 + 450.0 * np.sin(np.arange(count) * 0.01)
    return Conditions.of(np.where(np.arange(count) % 700 < 350, 1.0, -1.0), 600.0, torque, 30.0)


def _friction(dry, **more):
    values = {"coulomb_arcmin": dry, **more}
    return catalogue()["friction_windup"](values, parse_rig(RIG).constants)


@pytest.mark.parametrize(("more", "alike"), [({}, True), ({"viscous_arcmin_per_krpm": 0.4}, False)])
def test_dry_friction_may_be_a_zero_of_the_torque(more, alike):
    """A torque that was 60 N m off was less dry friction, with no other name beside it."""
    soft = catalogue()["torsional_compliance"]({"stiffness_Nm_per_arcmin": 450.0}, parse_rig(RIG).constants)
    at = _to_and_fro()
    at = replace(at, speed_rpm=600.0 + 500.0 * np.sin(np.arange(len(at)) * 0.017))
    before, after = _friction(0.25), _friction(0.12, **more)
    pieces = (Piece(soft, frozenset()), Piece(after, frozenset(), origin=before))
    final = _fit_of(pieces, at, lambda effect: effect.coefficient(at, 0)[:, None])
    found = Conclusions(final, final, (), (Retuned(before, after, {}, 0.0),), False)
    (one,) = with_doubts(found, is_whole_turn=True, is_more_left=False).retuned
    assert ("misread_torque" in one.alternatives) == alike and not one.is_open


@pytest.mark.parametrize(("factor", "slope", "alike"), [(1.15, 1.2, True), (1.15, 0.5, False), (1.0, 0.9, False)])
def test_a_mesh_order_that_follows_torques_read_wrong_may_be_these(factor, slope, alike):
    """A factor and an offset of the torques were another slope of order 78, and that alone had no other name."""
    rig, at = parse_rig(RIG), _to_and_fro()
    angle = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, len(at))

    def of(name, **values):
        return catalogue()[name](values, rig.constants)

    def mesh(slope):
        return of("load_dependent_mesh", order=78, slope_deg_per_kNm=slope * 1e-3, phase_rad=0.8)

    def change(effect):
        waves = [effect.coefficient(at, k) * np.exp(1j * k * angle) for k in effect.touched_orders()]
        return np.sum(waves, axis=0).real[:, None] + 0j

    def soft(factor):
        return of("torsional_compliance", stiffness_Nm_per_arcmin=400.0 * factor)

    before = (soft(1.0), _friction(0.3), mesh(1.2))
    # what an offset of 30 N m makes of the twist looks like friction
    after = (soft(factor), _friction(0.3 - 30.0 / 400.0 / factor), mesh(slope / factor))
    pairs = list(zip(before, after, strict=True))[0 if factor > 1.0 else 2 :]
    pieces = tuple(Piece(new, frozenset(), origin=old) for old, new in zip(before, after, strict=True))
    final = _fit_of(pieces, at, change)
    final.target.data.angle_rad = angle
    # no slope makes what the offset makes of the order
    final.residual += change(mesh(slope / factor * 30.0)) / -at.torque_Nm[:, None]
    found = Conclusions(final, final, (), tuple(Retuned(old, new, {}, 0.0) for old, new in pairs), False)
    *_, last = with_doubts(found, is_whole_turn=True, is_more_left=False).retuned
    assert ("misread_torque" in last.alternatives) == alike


@pytest.mark.parametrize(
    ("is_whole_turn", "is_more_left", "open_"), [(False, False, "wave"), (True, True, "mean"), (True, False, "")]
)
def test_names_of_little_travel_and_beside_a_rest_have_something_else(is_whole_turn, is_more_left, open_):
    """Of order 5 in 0.6 of a turn misaligned cranks and a worn sector were said; a late encoder was friction."""
    wave = parse_rig(RIG).effects[0]
    lag = parse_rig(RIG).effects[1]
    # a lag is of no order
    entries = (
        Retuned(wave, wave, {}, 0.0),
        Retuned(_friction(0.1), _friction(0.2), {}, 0.0),
        Retuned(lag, lag, {}, 0.0),
    )
    final = SimpleNamespace(state=SimpleNamespace(pieces=()))
    found = Conclusions(final, final, (), entries, False)
    found = with_doubts(found, is_whole_turn=is_whole_turn, is_more_left=is_more_left)
    assert [one.is_open for one in found.retuned] == [open_ == "wave", open_ == "mean", False]


def _claim_of(effect, alternatives=()):
    evidence = Evidence(1.0, 1, 0.0, 0.0, {}, (1, 1), 1.0, 1.0)
    return Claim(Piece(effect, frozenset(), True), {}, evidence, alternatives, (), 0.0, ())


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("torsional_compliance", {"stiffness_Nm_per_arcmin": 450.0}, "more than noise is left of the mean"),
        ("thermal_drift", {"drift_arcmin_per_K": 0.01}, "more than noise is left of the mean"),
        ("pin_error", {"order": 40, "amplitude_deg": 1e-3, "phase_rad": 0.0}, "no recording goes over a whole turn"),
    ],
)
def test_a_doubt_is_said_with_its_own_reason(name, values, said):
    """Of loads of both signs it said "named by runs whose load keeps its sign"; of a short arc "its order alone"."""
    claim = _claim_of(catalogue()[name](values, parse_rig(RIG).constants))
    final = SimpleNamespace(state=SimpleNamespace(pieces=()))
    found = Conclusions(final, final, (claim,), (), False)
    (claim,) = with_doubts(found, is_whole_turn=False, is_more_left=True).claims
    assert _how_sure(claim).startswith(said) and "named by" not in _how_sure(claim)


def test_what_else_may_be_on_a_link_is_said():
    """With `something_else` in report.json the page said that no other effect was tried."""
    lag = parse_rig(RIG).effects[1]
    assert _how_sure(_claim_of(lag)).endswith("where nothing else that was tried does as well")
    assert _how_sure(_claim_of(lag, ("something_else",))).endswith("where something else may look the same")


@pytest.mark.parametrize(("count", "is_whole"), [(1000, True), (990, False)])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_one_turn_is_whole_though_its_samples_end_a_step_before(count, is_whole, noise):
    """All names had something else beside them, of less than a whole turn; or not, by the encoder's noise."""
    rig, time = parse_rig(RIG), np.arange(count) * 8.1e-3
    for seed in range(5):
        angle = 3600.0 * time + noise * np.random.default_rng(seed).standard_normal(count)
        at = Conditions.of(np.ones(count), 600.0, 400.0, 30.0)
        r = Recording("r.csv", time, {"theta_in": angle, "theta_out": angle / 81.0}, at)
        assert is_whole_turn(r, rig) is is_whole
        # a gap is no step
        parts = np.flatnonzero((np.arange(count) < 300) | (np.arange(count) > 600))
        assert is_whole_turn(r.rows(parts[:-20]), rig) is False
        # nor is the rate between two samples whose clock says nearly the same
        jittered = np.where(np.arange(count) == 500, time[499] + 1e-9, time)
        assert is_whole_turn(replace(r, time_s=jittered), rig) is is_whole


def test_a_wave_that_stays_is_nothing_of_the_mean():
    """A loud wave of order 40 put a doubt to a compliance."""

    def left(order):
        wave = SimpleNamespace(order=order, rms_deg=3e-3)
        return SimpleNamespace(unexplained=(wave,), fitted=Gap(5e-3, np.hypot(1e-3, 3e-3), 1e-3))

    assert not _is_left_of_mean(left(40)) and _is_left_of_mean(left(0))


def test_play_in_samples_may_be_a_transmission_that_is_softer_at_low_loads(monkeypatch):
    """It had no other name beside it, where the twist was a cube root of the load."""
    rows = []
    # some 80 fits of all samples took seconds
    monkeypatch.setitem(is_a_knee.__globals__, "made_of", lambda a, b: (rows.append(len(a)), made_of(a, b))[1])
    at, constants = _to_and_fro(), parse_rig(RIG).constants
    play = catalogue()["backlash"]({"gap_arcmin": 0.4, "seating_torque_Nm": 60.0}, constants)
    final = _fit_of((Piece(play, frozenset(), True),), at, lambda effect: effect.coefficient(at, 0)[:, None])
    assert not is_a_knee(final, final.state.pieces[0]) and max(rows) < 30
    twist = -0.01 * at.sign * np.cbrt(at.torque_Nm / 1000.0)
    final.residual = final.residual + (twist - final.explained(play)[:, 0])[:, None]
    assert is_a_knee(final, final.state.pieces[0])


def test_a_sideband_that_nothing_tells_is_not_said():
    """Of a wave of order 117 it said that orders 117 and 123 stand beside mesh order 120."""
    values = {"order": 120, "lower_deg": 1e-3, "upper_deg": 1e-7}
    effect = catalogue()["carrier_modulation"](values, parse_rig(RIG).constants)
    piece = Piece(effect, frozenset(values) - {"order"}, True)
    claims = [SimpleNamespace(piece=piece, stderr={"lower_deg": 1e-5, "upper_deg": 1e-5})]
    said = _sidebands(effect, SimpleNamespace(conclusions=SimpleNamespace(claims=claims)))
    assert said == "order 117 stands beside mesh order 120 as a sideband of the carrier does, at constant size"


def test_a_clock_that_jitters_makes_no_speed_of_another_unit(tmp_path):
    """The rate from one sample to the next is larger in the mean: "0.86 times the rate, in another unit"."""
    rig = recorded(tmp_path / "r.csv")
    (r,) = read_recordings([tmp_path / "r.csv"])
    jitter = 4e-4 * np.random.default_rng(0).uniform(-1.0, 1.0, len(r.time_s))
    check_recordings([replace(r, time_s=r.time_s + jitter)], rig, tmp_path)
    for factor in (1 / 81.0, 2.0):
        other = replace(r.at, speed_rpm=factor * r.at.speed_rpm)
        with pytest.raises(InputError, match=f"speed_rpm is {factor:.4g} times the rate"):
            check_recordings([replace(r, at=other)], rig, tmp_path)


@pytest.mark.parametrize("period", [14.5, 15.0, 20.0, 28.0, 30.0, 200.0])
@pytest.mark.parametrize("fast", ["theta_ref", "theta_in"])
def test_a_motion_to_and_fro_within_some_samples_is_no_speed_of_another_unit(period, fast):
    """The way of the speed beside the chord of the angle: "1.348 times the rate, in another unit"."""
    time, rate = np.arange(4000) * 1e-2, 2.0 * np.pi / (period * 1e-2)
    angle = 720.0 * np.sin(rate * time)
    angles = {fast: angle, "theta_out": angle / 81.0}
    sign = _directions(speed_of(angles, time))
    for factor in (1.0, 6.0, 1.0 / 81.0):
        speed = factor * 720.0 * rate * np.abs(np.cos(rate * time)) / 6.0
        found = _other_speed(Recording("r.csv", time, angles, Conditions.of(sign, speed, 400.0, 30.0)))
        # of a measured angle that turns within each window the way is not told from noise
        is_told = factor != 1.0 and (fast == "theta_ref" or period > 20.0)
        assert bool(found) is is_told
        if found:
            assert float(found[0].split()[2]) == pytest.approx(factor, rel=0.05)


@pytest.mark.thorough
def test_a_share_of_a_gap_that_links_have_as_well_is_the_reducers(tmp_path):
    """A zero "explains more than 99 % of the gap", which fell by half: the rest was the coupling's."""
    rig = recorded(tmp_path / "r.csv")
    (r,) = read_recordings([tmp_path / "r.csv"])
    random = np.random.default_rng(0)
    angles = {name: angle + 1e-4 * random.standard_normal(len(angle)) for name, angle in r.angles.items()}
    angles["theta_out"] = angles["theta_out"] + 3e-3
    wave = 0.5 * np.sin(3.0 * np.deg2rad(r.angles["theta_mot"]))
    angles["theta_mot"] = angles["theta_mot"] + wave
    alone = {name: angles[name] for name in ("theta_in", "theta_out")}
    for measured, words in ((alone, "of the gap"), (angles, "of the gap of the reducer")):
        read = replace(r, angles=measured)
        (found,) = [one for one in findings(reconcile_recordings(rig, [read], catalogue())) if one.effect is None]
        assert share_text(found, first=True).endswith(f"% {words}")
