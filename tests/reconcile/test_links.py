"""The links of a recorded axis, servo and coupling: what lag, stiffness and play are told from."""

from dataclasses import astuple, replace
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.reconcile.data.recordings import Recording
from st_codegen.reconcile.judge.claims import Conclusions, Retuned
from st_codegen.reconcile.judge.links import (
    _SERVO,
    _Change,
    _judged,
    _noise,
    _Rig,
    _Samples,
    coupling_link,
    servo_link,
    with_unmeasured_links,
)
from st_codegen.rig.effects import Conditions, catalogue
from st_codegen.rig.model import parse_rig

from .test_recordings import RIG

_ONE_WAY = ((600.0, 400.0), (950.0, 800.0))
_BOTH_WAYS = ((600.0, 400.0), (-950.0, 800.0))
_FOUR = ((300.0, 400.0), (950.0, 800.0), (-400.0, 500.0), (-1100.0, 700.0))


@pytest.mark.parametrize(("left", "claimed"), [(0.0, True), (1.9, False)])
def test_what_a_link_saves_counts_in_noises(left, claimed):
    """Half a degree of noise, two degrees before: (2 / 0.5)^2 a sample."""
    rig = parse_rig(RIG)
    lag = catalogue()["control_lag"]({"lag_ms": 5.0}, rig.constants)
    samples = _Samples(np.zeros(50), np.zeros((50, 1)), np.zeros((50, 1)), np.zeros(50, np.int64), 0.0)
    # what they tell is kept once it is known
    vars(samples)["told"] = SimpleNamespace(noise=0.5)
    own = _Rig(None, np.zeros(1), np.full(50, 2.0), "lag", _SERVO, 81.0)
    link = _judged(samples, own, _Change(lag, np.ones(1), np.full(50, left), {"lag_ms": 0.1}, is_open=False))
    assert (link.claim is not None) is claimed
    if claimed:
        assert link.claim.evidence.loss_saved == pytest.approx(50 * 16.0)
    assert astuple(link.gap) == pytest.approx((2.0 / 81, (left if claimed else 2.0) / 81, 0.5 / 81))


def _coupled(add=lambda *_: 0.0, runs=_ONE_WAY, *, step_s=1e-2, soft=1 / 5000.0, play=0.0, noise=1e-3, varies=0.3):
    """Recordings with theta_mot and theta_in: `add` of motor angle and speed on top."""
    found = []
    for number, (speed, load) in enumerate(runs):
        random, time, sign = np.random.default_rng(number), np.arange(2000) * step_s, np.sign(speed)
        reference = 6.0 * speed * time
        at = Conditions.of(np.full(2000, sign), abs(speed), load * (1.0 + varies * np.sin(time)), 30.0)
        motor = parse_rig(RIG).effects[1].motor_angle(time, reference)
        twist = -sign * (np.rad2deg(at.torque_Nm / 81.0) * soft + play / 120.0)
        measured = motor + noise * random.standard_normal((2, 2000))
        angles = {"theta_ref": reference, "theta_mot": measured[0], "theta_in": measured[1] + twist}
        angles["theta_in"] = angles["theta_in"] + add(motor, 6.0 * speed)
        found.append(Recording(f"{number}.csv", time, angles, at))
    return found


def _as_one(runs=_FOUR, **coupling):
    """One recording of several runs, one after the other."""
    parts = _coupled(runs=runs, **coupling)
    angles = {name: np.concatenate([part.angles[name] for part in parts]) for name in parts[0].angles}
    at = Conditions(*(np.concatenate(column) for column in zip(*(astuple(part.at) for part in parts), strict=True)))
    return Recording("r.csv", np.arange(len(at)) * 1e-2, angles, at)


@pytest.mark.parametrize("runs", [_ONE_WAY, _BOTH_WAYS])
def test_zeros_of_two_encoders_are_no_play_and_no_lag(runs):
    """In one direction play of 240 arcmin was "what the data refuse", beyond the bounds of the rig file."""
    rig, read = parse_rig(RIG), _coupled(lambda motor, speed: 2.0, runs)
    link = coupling_link(read, rig)
    assert link.retuned is None and "zeros of" in link.unexplained
    moved = [replace(r, angles={**r.angles, "theta_mot": r.angles["theta_mot"] + 2.0}) for r in read]
    link = servo_link(moved, rig)
    assert link.retuned is None and "zeros of theta_ref and theta_mot that are 2 deg apart" in link.unexplained


@pytest.mark.parametrize("step_s", [1e-2, 2.5e-2])
def test_a_coupling_off_centre_is_a_wave_and_no_noise(step_s):
    """With few samples a turn the noise was twice all that was left, and nothing was found missing."""
    link = coupling_link(
        _coupled(lambda motor, _: 0.2 * np.cos(np.deg2rad(motor) + 1.0), step_s=step_s), parse_rig(RIG)
    )
    assert link.retuned is None and "a wave of 0.2 deg, once a turn of the fast shaft" in link.unexplained
    assert link.gap.noise_floor == pytest.approx(1e-3 * np.sqrt(2) / 81, rel=0.05)


def test_an_angle_that_is_late_is_no_coupling_of_another_stiffness():
    """A stiffness of 1689 +- 0.01 N m/rad and play of 13 arcmin were "what the data refuse"."""
    link = coupling_link(_coupled(lambda _, speed: -5e-5 * speed, _BOTH_WAYS), parse_rig(RIG))
    assert link.retuned is None and "as if theta_in were 0.05 ms late" in link.unexplained


def test_a_softer_coupling_is_told_within_its_error():
    link = coupling_link(_coupled(runs=_BOTH_WAYS, soft=1 / 3000.0), parse_rig(RIG))
    value, stderr = link.retuned.after.scalar("stiffness_Nm_per_rad"), link.retuned.stderr["stiffness_Nm_per_rad"]
    assert abs(value - 3000.0) < 4.0 * stderr < 100.0 and not link.unexplained


def test_a_coupling_that_is_softer_at_low_loads_has_no_sure_play():
    """Beside a play that load takes up at once, one that it takes up gradually leaves as little."""
    read = _as_one(soft=0.0, noise=2e-2)
    twist = -0.02 * read.at.sign * np.sqrt(read.at.torque_Nm)
    gradual = replace(read, angles={**read.angles, "theta_in": read.angles["theta_in"] + twist})
    link = coupling_link([gradual], parse_rig(RIG))
    assert link.retuned.after.scalar("backlash_arcmin") > 5.0 and link.retuned.alternatives == ("something_else",)
    sudden = coupling_link([_as_one(soft=1 / 3000.0, play=20.0, noise=2e-2)], parse_rig(RIG))
    assert sudden.retuned.after.scalar("backlash_arcmin") == pytest.approx(20.0, rel=0.1)
    assert sudden.retuned.alternatives == ()


def _said(link):
    return link.unexplained.partition("; it looks like ")[2]


def test_a_coupling_that_is_rigid_is_told():
    """Its stiffness has no end: that it is no number of rig files was said to be what the runs do not tell."""
    for runs in (_BOTH_WAYS, _FOUR):
        link = coupling_link(_coupled(runs=runs, soft=0.0), parse_rig(RIG))
        assert link.retuned.after.scalar("stiffness_Nm_per_rad") == 1e6 and link.retuned.stderr == {}
        assert not link.unexplained


@pytest.mark.parametrize(("of_rig", "noise"), [("", 1e-3), ("", 1e-5), (RIG, 1e-3)])
def test_play_in_a_rigid_coupling_is_told(of_rig, noise):
    """It was no name any more, and what was left was said to be what no column makes."""
    read = _coupled(runs=_FOUR, soft=0.0, play=10.0, noise=noise)
    link = coupling_link(read, parse_rig(of_rig or "[rig]\nreduction_ratio = 81.0\n"))
    effect = link.retuned.after if of_rig else link.claim.piece.effect
    assert effect.scalar("stiffness_Nm_per_rad") == 1e6
    assert effect.scalar("backlash_arcmin") == pytest.approx(10.0, rel=0.01)
    # each recording is of one direction: zeros of their own would do
    assert "something_else" in (link.retuned or link.claim).alternatives
    assert of_rig or "stiffness_Nm_per_rad is held at 1e+06" in link.claim.extrapolates[0]
    assert coupling_link([_as_one(soft=0.0, play=10.0)], parse_rig(RIG)).retuned.alternatives == ()


def test_a_torque_of_the_wrong_sign_is_said_as_what_no_machine_has():
    """It was said to be what the runs do not tell."""
    link = coupling_link(_coupled(runs=_BOTH_WAYS, soft=-1 / 5000.0), parse_rig(RIG))
    assert link.retuned is None and _said(link) == "a stiffness of -5e+03 N m/rad, which no machine has"


def test_play_beyond_the_bounds_of_rig_files_is_said_with_its_size():
    link = coupling_link(_coupled(runs=_FOUR, play=80.0), parse_rig(RIG))
    assert link.retuned is None
    assert _said(link).startswith("play of 80 arcmin, which is beyond what a rig file may have, or like zeros of each")


def test_all_that_the_runs_do_not_tell_from_each_other_is_named_and_nothing_else():
    """Zeros were said, which do not turn with the direction, and play, which does, was not."""
    read = _coupled(runs=((600.0, 400.0), (-600.0, 400.0)), soft=1 / 3000.0, varies=0.0)
    assert _said(coupling_link(read, parse_rig(RIG))) == (
        "a stiffness of 3e+03 N m/rad, or like play of 4.5 arcmin, or like a part in proportion to the speed, as if "
        "theta_in were 0.01 ms late, or like zeros of each recording's own, which differ by up to 0.075 deg"
    )


def test_play_is_named_where_zeros_and_delays_make_it():
    """They alone were: nothing told them from it."""
    link = coupling_link(_coupled(runs=_ONE_WAY, play=30.0), parse_rig(RIG))
    assert _said(link) == "play of 30 arcmin, or like zeros of theta_mot and theta_in that are 0.25 deg apart"
    link = coupling_link(_coupled(runs=_BOTH_WAYS, soft=0.0, play=10.0), parse_rig("[rig]\nreduction_ratio = 81.0\n"))
    assert _said(link).startswith("play of 10 arcmin, or like zeros of each")
    assert _said(link).endswith("as if theta_in were 0.018 ms late")


def test_what_a_link_does_not_have_is_not_named():
    """Of the servo's the twist was said to be one of what the runs do not tell."""
    rig, time = parse_rig(RIG.replace("lag_ms = 5.0", "lag_ms = 8.0")), np.arange(2000) * 1e-2
    noise = 1e-3 * np.random.default_rng(0).standard_normal(2000)
    angles = {"theta_ref": 3600.0 * time, "theta_mot": rig.effects[1].motor_angle(time, 3600.0 * time) + noise}
    link = servo_link(
        [Recording("a.csv", time, angles, Conditions.of(np.ones(2000), 600.0, 400.0, 30.0))], parse_rig(RIG)
    )
    assert link.retuned is None and _said(link) == "a lag of 8 ms"


def test_zeros_that_differ_between_recordings_may_be_a_lag():
    """Of a lag of 4.86 ms there was no doubt."""
    rig, time, read = parse_rig(RIG), np.arange(2000) * 1e-2, []
    for number, sign in enumerate((1.0, -1.0)):
        noise = 3e-2 * np.random.default_rng(number).standard_normal(2000)
        angles = {"theta_ref": sign * 3600.0 * time}
        angles["theta_mot"] = rig.effects[1].motor_angle(time, angles["theta_ref"]) + noise - number
        read.append(Recording(f"{number}.csv", time, angles, Conditions.of(np.full(2000, sign), 600.0, 400.0, 30.0)))
    link = servo_link(read, rig)
    assert link.retuned.alternatives == ("something_else",)


def test_of_short_arcs_every_size_is_a_number():
    """Of a wave of which one column was told it said "a wave of nan deg"."""
    (r,) = _coupled(runs=((20.0, 400.0),), step_s=1e-3)
    wave = 0.5 + 0.2 * np.cos(np.deg2rad(r.angles["theta_mot"]))
    read = replace(r, angles={**r.angles, "theta_in": r.angles["theta_in"] + wave}).rows(np.arange(200))
    link = coupling_link([read], parse_rig(RIG))
    assert "a wave of" in _said(link) and "nan" not in _said(link)


def test_the_noise_of_a_link_is_what_its_digits_are_rounded_by():
    """An axis that stood most of the time left nothing: its noise was 1e-9 deg, and the rounding "unexplained"."""
    moves = np.where(np.arange(4000) % 1000 < 400, np.arange(4000) * 0.37, 0.0)
    rounded = np.round(moves + 0.1 * np.sin(moves), 5) - (moves + 0.1 * np.sin(moves))
    still = np.where(np.arange(4000) % 1000 < 400, rounded, 0.0)
    assert _noise([still]) == pytest.approx(1e-5 / np.sqrt(12), rel=0.3)
    assert _noise([np.zeros(100)]) == 1e-9


def test_a_stiffness_that_changed_may_be_the_coupling_where_its_angle_was_not_measured():
    """Only what was added had it among its alternatives."""
    known = catalogue()
    own = known["torsional_compliance"]({"stiffness_Nm_per_arcmin": 454.0}, parse_rig(RIG).constants)
    changed = [Retuned(own, own.with_values({"stiffness_Nm_per_arcmin": 420.0}), {}, 0.0)]
    without, measured = (SimpleNamespace(angles={name: 0.0}) for name in ("theta_mot", "theta_in"))
    found = Conclusions(None, None, (), changed, False)
    assert with_unmeasured_links(found, [without]).retuned[0].alternatives == ("coupling_compliance",)
    assert with_unmeasured_links(found, [measured]) is found


def test_how_far_the_motor_was_behind_before_a_recording_began_is_not_known():
    """Of one that was cut out of a longer motion, or has gaps, 0.2 deg were an unexplained lag."""
    rig, (r, *_) = parse_rig(RIG), _coupled(step_s=2e-3)
    turning = 3600.0 * r.time_s + 900.0 * np.sin(2.0 * r.time_s)
    motor = rig.effects[1].motor_angle(r.time_s, turning)
    random = np.random.default_rng(0)
    angles = {"theta_ref": turning, "theta_mot": motor + 1e-3 * random.standard_normal(len(turning))}
    whole = replace(r, angles=angles)
    kept = np.r_[200:700, 720:1200, 1500:2000]
    assert list(whole.rows(kept).starts) == [0, 500, 980]
    for cut in (whole, whole.rows(kept)):
        link = servo_link([cut], rig)
        assert (link.retuned, link.claim, link.unexplained) == (None, None, "")
        other = servo_link([cut], rig.with_effects([catalogue()["control_lag"]({"lag_ms": 7.0}, rig.constants)]))
        value, error = other.retuned.after.scalar("lag_ms"), other.retuned.stderr["lag_ms"]
        assert abs(value - 5.0) < 4 * error < 0.01


def _waits(kind, random):
    """Waits between samples, s: of pieces of one to nine samples."""
    if kind == "lost":
        return np.where(random.random(4000) < 0.25, 5e-3, 1e-3)
    return random.exponential(2e-3 if kind == "exponential" else 2e-4, 2000) + 1e-6


@pytest.mark.parametrize(("kind", "lag_ms"), [("exponential", 5.0), ("lost", 5.0), ("short", 80.0)])
@pytest.mark.parametrize("seed", range(3))
def test_pieces_of_few_samples_tell_no_zeros_of_their_own(kind, lag_ms, seed):
    """Of the rig's own lag ten times the noise was "left", and each piece took a fit; short is beside the lag."""
    rig, (r, *_), random = parse_rig(RIG), _coupled(), np.random.default_rng(seed)
    time = 1.0 + np.cumsum(_waits(kind, random))
    # the reference is known between the samples as well, or what is left is that
    fine = np.arange(time[0], time[-1] + 1e-4, 2e-5)
    turning = [3600.0 * t + 900.0 * np.sin(2.0 * t) for t in (time, fine)]
    lag = catalogue()["control_lag"]({"lag_ms": lag_ms}, rig.constants)
    motor = np.interp(time, fine, lag.motor_angle(fine, turning[1])) + 1e-3 * random.standard_normal(len(time))
    at = Conditions.of(np.ones(len(time)), 600.0, 400.0, 30.0)
    cut = replace(r, time_s=time, angles={"theta_ref": turning[0], "theta_mot": motor}, at=at)
    assert len(cut.starts) > 150
    link = servo_link([cut], rig.with_effects([lag]))
    assert (link.retuned, link.claim, link.unexplained) == (None, None, "")
    # what is told is said still
    apart = servo_link([replace(cut, angles={**cut.angles, "theta_mot": motor + 0.2})], rig.with_effects([lag]))
    said = apart.unexplained.split("zeros of theta_ref and theta_mot that are ")[1]
    assert float(said.split()[0]) == pytest.approx(0.2, abs=0.01)
    other = servo_link([cut], rig.with_effects([lag.with_values({"lag_ms": 1.4 * lag_ms})]))
    if other.retuned or kind != "short":
        value, error = other.retuned.after.scalar("lag_ms"), other.retuned.stderr["lag_ms"]
        assert abs(value - lag_ms) < 4 * error < 0.01 * lag_ms
    else:
        assert "it looks like a lag of 80 ms" in other.unexplained


def test_angles_in_coarse_steps_scatter_by_these():
    """Samples that stay on a step showed a noise of 0.0002 deg, of which 0.016 deg was said to be a coupling's."""
    (r, *_) = _coupled(runs=((30.0, 400.0),), step_s=2e-4, noise=1e-5)
    step = 360.0 / 2**13
    coarse = {name: step * np.round(angle / step) for name, angle in r.angles.items()}
    link = coupling_link([replace(r, angles=coarse)], parse_rig(RIG))
    assert (link.retuned, link.claim, link.unexplained) == (None, None, "")
