"""The next measurement: where runs are proposed, what they are expected to give, and that they give it."""

import csv
import sys
from dataclasses import astuple, replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.harmonic_table import HarmonicTable, write_table
from st_codegen.cli.main import cli
from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.plan import questions
from st_codegen.reconcile.plan.next_runs import NextRun, NextRuns, is_known, next_runs
from st_codegen.reconcile.plan.points import _peak_speeds, rows_at
from st_codegen.reconcile.plan.questions import Unknown, unexplained
from st_codegen.reconcile.report.summary import next_runs_summary
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.campaign import read_conditions
from st_codegen.rig.effects import Conditions, Constants, catalogue
from st_codegen.rig.model import RigModel

from .test_core import KNOWN, RIG, effect, grid, observed

RESONANCE = effect(
    "structural_resonance", orders=[39, 40, 78], frequency_Hz=12.0, damping_ratio=0.012,
    amplitude_deg=[2e-3, 3e-3, 2e-3], phase_rad=[0.3, 1.0, -2.0],
    backward_amplitude_deg=[2e-3, 2e-3, 3e-3], backward_phase_rad=[0.3, 2.0, -1.0],
)  # fmt: skip
BACKLASH = effect("backlash", gap_arcmin=1.0, seating_torque_Nm=60.0)
#: speeds at which the orders of the resonance peak, rpm
PEAKS = 60 * 81 * 12.0 / np.array([39, 40, 78])


def found(missing, at, seed=0, rig=RIG, sigma=2e-5):
    return reconcile_observations(rig, observed(replace(rig, effects=(*rig.effects, missing)), at, seed=seed,
                                                sigma=sigma), KNOWN)  # fmt: skip


def with_runs(at, ahead):
    points = np.array([astuple(run.point) for run in ahead.runs]).T
    parts = (np.repeat([1.0, -1.0], len(ahead.runs)), *np.concatenate([points, points], axis=1))
    return Conditions(*(np.concatenate(pair) for pair in zip(astuple(at), parts, strict=True)))


@pytest.fixture(scope="module")
def coarse():
    """Six speeds, of which none is within three half widths of a peak."""
    return grid(6, 3, 2)


@pytest.fixture(scope="module")
def resonance(coarse):
    return found(RESONANCE, coarse)


def test_runs_go_to_the_peaks_and_their_errors_fall_as_expected(resonance, coarse):
    ahead = next_runs(resonance)
    assert 1 < len(ahead.runs) <= SETTINGS.most_next_runs
    speeds = np.array([run.point.speed_rpm for run in ahead.runs])
    # half width of a peak: 1.2 % of its speed; flanks count
    near = np.abs(speeds[:, None] / PEAKS - 1).min(axis=1) < 4.5 * 0.012
    assert near.mean() > 0.7
    again = found(RESONANCE, with_runs(coarse, ahead))
    [claim] = again.conclusions.claims
    [expected] = [n for n in ahead.narrowed if n.key == "frequency_Hz"]
    assert expected.then < 0.5 * expected.now
    # the expectation is that of a linear model at the values of the coarse grid
    assert claim.stderr["frequency_Hz"] < 3 * expected.then
    assert claim.piece.effect.scalar("frequency_Hz") == pytest.approx(12.0, rel=2e-3)


def test_proposals_stay_inside_what_was_measured_and_are_new(resonance, coarse):
    measured = {tuple(row) for row in np.stack(astuple(coarse)[1:], axis=1).tolist()}
    for run in next_runs(resonance).runs:
        assert astuple(run.point) not in measured
        for value, column in zip(astuple(run.point), astuple(coarse)[1:], strict=True):
            assert column.min() <= value <= column.max()


def test_no_more_points_are_weighed_than_memory_holds(resonance, monkeypatch):
    """Of many findings each of 29,000 points took a matrix of 171 numbers squared: 6.3 GB, behind the whole search."""
    module, seen = sys.modules[next_runs.__module__], []
    monkeypatch.setattr(module, "rows_at", lambda points, final: seen.append(points) or rows_at(points, final))
    every = next_runs(resonance)
    monkeypatch.setattr(module, "SETTINGS", replace(SETTINGS, most_numbers_of_points=5e3))
    fewer = next_runs(resonance)
    coordinates = len(resonance.conclusions.final.prior)
    assert 0 < len(seen[1]) * max(coordinates**2, 4 * len(resonance.data.orders)) <= 5e3
    assert set(seen[1]) < set(seen[0]) and len(fewer.runs) == len(every.runs)


def test_two_explanations_are_told_apart(coarse):
    """From 100 N m on backlash looks like dry friction in much noise: runs where the flanks seat tell them apart."""
    torque = np.array([100.0, 950.0, 1800.0])[np.searchsorted([0.0, 900.0, 1800.0], coarse.torque_Nm)]
    at = replace(coarse, torque_Nm=torque)
    first = found(BACKLASH, at, sigma=4e-4)
    [claim] = first.conclusions.claims
    # and so do torques that are read wrong in one direction
    assert {claim.piece.effect.name, *claim.alternatives} == {"friction_windup", "backlash", "misread_torque"}
    ahead = next_runs(first)
    assert ahead.runs[0].purpose.startswith(f"tells {claim.piece.effect.name} from {claim.alternatives[0]}")
    assert 100 <= ahead.runs[0].point.torque_Nm < 500
    # in a twentieth of the noise the part of the play that is still open at 100 N m tells them apart by itself,
    # but not from a twist that is softer at low loads: one torque lies there
    [claim] = found(BACKLASH, at).conclusions.claims
    assert claim.piece.effect.name == "backlash" and claim.alternatives == ("something_else",)


def test_no_run_tells_two_names_of_one_wave_apart(coarse):
    """Teeth and the fast shaft share an order: runs were to tell them apart, where the means of both fits differed."""
    constants = Constants(reduction_ratio=78.0)
    effects = [catalogue()[one.name](one.values, constants) for one in (*RIG.effects, BACKLASH)]
    rig = RigModel(constants=constants, effects=tuple(effects))
    wave = catalogue()["cycloid_tooth_error"]({"order": 78, "amplitude_deg": 1e-3, "phase_rad": 1.0}, constants)
    result = found(wave, coarse, rig=rig)
    [claim] = result.conclusions.claims
    names = {claim.piece.effect.name, *claim.alternatives}
    assert {"cycloid_tooth_error", "input_shaft_misalignment"} <= names
    for run in next_runs(result).runs:
        assert "from input_shaft_misalignment" not in run.purpose and "from cycloid_tooth_error" not in run.purpose


def test_a_late_chain_is_told_by_all_orders():
    """Its own list of orders is that of the mean, where a skew does something."""
    late = RigModel(effects=(*RIG.effects, effect("measurement_delay", delay_us=500.0)))
    final = SimpleNamespace(
        state=SimpleNamespace(model=lambda: RIG), target=SimpleNamespace(data=observed(RIG, grid(), (0, 1, 39)))
    )
    assert questions._rival(final, "another zero", (0,), "measurement_delay", late).orders == (0, 1, 39)


def test_refused_effects_that_gain_most_on_open_orders_are_rivals_each_once(monkeypatch):
    def piece(name, order):
        return SimpleNamespace(
            effect=SimpleNamespace(name=name, orders=(order,), stage=None, touched_orders=lambda: (order,))
        )

    def candidate(name, order):
        return SimpleNamespace(piece=piece(name, order), number=None, put_into=lambda _: None)

    refused = [
        (candidate(name, order), SimpleNamespace(loss_saved=gain))
        for name, order, gain in (
            ("fourth", 3, 1.0), ("third", 3, 2.0), ("second", 3, 4.0), ("first", 3, 8.0), ("first", 3, 7.0),
            ("there", 3, 9.0), ("elsewhere", 5, 9.0),
        )
    ]  # fmt: skip
    model = SimpleNamespace(state=SimpleNamespace(model=lambda: RIG))
    monkeypatch.setattr(questions, "fits", lambda _, states, **__: [model] * len(states))
    final = SimpleNamespace(state=SimpleNamespace(pieces=(piece("there", 3),), model=lambda: RIG), target=None)
    result = SimpleNamespace(
        judged=refused,
        unexplained=[SimpleNamespace(order=3)],
        conclusions=SimpleNamespace(final=final, claims=(), retuned=(), for_offset=()),
    )
    found = [rival.other for rival in questions.other_models(result)]
    assert found == [f"{name} as well, which the data refused so far" for name in ("first", "second", "third")]


@pytest.mark.parametrize(("order", "parts"), [(0, 1), (1, 2)])
def test_what_is_unexplained_counts_by_its_power_over_the_noise(order, parts):
    """The noise of a mean has one part, that of a wave two."""
    data = observed(RIG, grid(3, 3, 1))
    sigma, good = np.full(data.values.shape, 1e-5), np.ones(len(data), bool)
    target = SimpleNamespace(data=data, sigma=sigma, good=good)
    final = SimpleNamespace(target=target, residual=np.full(data.values.shape, 4e-5))
    conclusions = SimpleNamespace(final=final)
    signature = SimpleNamespace(order=order, dependence={}, is_scatter=False)
    result = SimpleNamespace(conclusions=conclusions, verdict="unexplained", unexplained=[signature])
    (*_, question) = unexplained(result, SimpleNamespace(data=data))  # of few runs the gaps stand in front
    assert question.weight == pytest.approx((4.0**2 - parts) / parts)


def test_what_is_unexplained_draws_runs_to_where_it_is_large(coarse):
    """A line in one order at one speed, which no effect makes: runs go between that speed and its neighbours."""
    data = observed(RIG, coarse)
    speed = np.unique(coarse.speed_rpm)[2]
    bump = 40 * 2e-5 * np.exp(-0.5 * ((coarse.speed_rpm - speed) / 150.0) ** 2) * np.exp(1j * coarse.sign)
    values = data.values.copy()
    values[:, list(data.orders).index(3)] += bump
    result = reconcile_observations(RIG, replace(data, values=values), KNOWN)
    assert [s.order for s in result.unexplained] == [3]
    runs = next_runs(result).runs
    step = np.diff(np.unique(coarse.speed_rpm))[0]
    assert "order 3" in runs[0].purpose
    assert 0 < abs(runs[0].point.speed_rpm - speed) < 1.1 * step


def test_with_nothing_missing_runs_go_far_from_all_others(coarse):
    result = reconcile_observations(RIG, observed(RIG, coarse), KNOWN)
    assert result.verdict == "nothing_missing"
    ahead = next_runs(result)
    speeds = np.unique(coarse.speed_rpm)
    away = [np.abs(speeds - run.point.speed_rpm).min() for run in ahead.runs[:4]]
    assert all("lies far from all runs" in run.purpose for run in ahead.runs)
    assert min(away) > 0.2 * np.diff(speeds)[0]


def test_runs_that_tell_as_much_spread_over_speeds_and_oil():
    """Two speeds and two temperatures: what only four places tell may be noise that they have in common."""
    at = grid(2, 6, 2)
    data = observed(RIG, at)
    values = data.values.copy()
    values[:, list(data.orders).index(3)] += 1e-3 * np.exp(1j * at.torque_Nm / 400.0)
    ahead = next_runs(reconcile_observations(RIG, replace(data, values=values), KNOWN))
    assert "order 3" in ahead.runs[0].purpose
    places = {(run.point.speed_rpm, run.point.temperature_C) for run in ahead.runs}
    assert len(places) >= 6
    assert len({place[0] for place in places} - set(at.speed_rpm)) >= 2


def test_other_orders_are_met_where_they_reach_a_frequency_that_was_found():
    """Order 78 meets 12 Hz at 748 rpm, where no run was: whether it is lifted there is asked."""
    two = effect(
        "structural_resonance", orders=[39, 40], frequency_Hz=12.0, damping_ratio=0.02, amplitude_deg=[2e-3, 3e-3],
        phase_rad=[0.3, 1.0], backward_amplitude_deg=[2e-3, 2e-3], backward_phase_rad=[0.3, 2.0],
    )  # fmt: skip
    at = grid(1, 3, 2)
    speeds = np.array([300.0, 500.0, 1000.0, 1200.0, 1400.0, 1450.0, 1480.0, 1500.0, 1540.0, 1600.0, 1700.0])
    at = Conditions(*(np.tile(column, len(speeds)) for column in astuple(at)))
    at = replace(at, speed_rpm=np.repeat(speeds, len(at) // len(speeds)))
    result = found(two, at, sigma=2e-4)
    assert [claim.piece.effect.orders for claim in result.conclusions.claims] == [(39, 40)]
    (run,) = [run for run in next_runs(result).runs if "order 78" in run.purpose]
    assert run.purpose == "tells whether order 78, which meets 12.0 Hz there, is lifted as well"
    assert run.point.speed_rpm == pytest.approx(PEAKS[2], rel=0.1)


def test_runs_go_on_until_sizes_are_known_whatever_else_is_open(resonance):
    """A frequency that moves by nothing is known to no share of itself, and asks for no runs; a height does."""
    (claim,) = resonance.conclusions.claims
    still = claim.piece.effect.with_values(dict(claim.piece.effect.values) | {"frequency_per_kNm": 1e-9})
    for height, known in ((1e-5, True), (1e-3, False)):
        errors = {"frequency_per_kNm": 1e-3, "amplitude_deg[39]": height, "phase_rad[39]": 1.0}
        other = replace(claim, piece=replace(claim.piece, effect=still), stderr=errors)
        result = replace(resonance, conclusions=replace(resonance.conclusions, claims=(other,)))
        assert is_known(result) is known


def test_the_file_is_one_of_conditions(resonance, tmp_path):
    ahead = next_runs(resonance)
    (tmp_path / "next_runs.csv").write_text(ahead.csv_text(), encoding="utf-8")
    assert read_conditions(tmp_path / "next_runs.csv") == tuple(run.point for run in ahead.runs)
    rows = list(csv.DictReader((tmp_path / "next_runs.csv").open(encoding="utf-8")))
    assert [row["purpose"] for row in rows] == [run.purpose for run in ahead.runs]
    assert NextRuns().csv_text().splitlines() == ["file,speed_rpm,torque_Nm,temperature_C,purpose"]


@pytest.mark.thorough
def test_from_the_command_line_to_the_next_campaign(resonance, coarse, tmp_path):
    data = resonance.data
    at = data.at
    table = HarmonicTable(
        at.sign < 0, at.speed_rpm, at.torque_Nm, at.temperature_C, tuple(data.orders.tolist()), data.values
    )
    write_table(table, tmp_path / "t.csv")
    (tmp_path / "rig.toml").write_text(RIG.text(), encoding="utf-8")
    run = CliRunner().invoke(cli, ["reconcile", "--rig", str(tmp_path / "rig.toml"), "--measured",
                                   str(tmp_path / "t.csv"), "--out", str(tmp_path / "found")])  # fmt: skip
    assert run.exit_code == 0, run.output
    assert "Next measurement" in run.output
    made = CliRunner().invoke(cli, ["simulate", "campaign", "--rig", str(tmp_path / "rig.toml"), "--conditions",
                                    str(tmp_path / "found" / "next_runs.csv"), "--out", str(tmp_path / "next"),
                                    "--samples", "400", "--quiet"])  # fmt: skip
    assert made.exit_code == 0, made.output
    names = {row["file"] for row in csv.DictReader((tmp_path / "found" / "next_runs.csv").open(encoding="utf-8"))}
    assert {path.name for path in (tmp_path / "next").rglob("*.csv")} == names
    assert "The next measurement" in (tmp_path / "found" / "report.html").read_text(encoding="utf-8")


def test_speeds_around_a_peak_are_those_of_its_frequency():
    """At 20 Hz of the output's order 40 the output turns at 30 rpm, and the motor 81 times as fast."""
    peak = effect("structural_resonance", frequency_Hz=20.0, damping_ratio=0.02, orders=[40],
                  amplitude_deg=[1e-3], phase_rad=[0.0])  # fmt: skip
    found = _peak_speeds([replace(RIG, effects=(*RIG.effects, peak))], np.array([0, 10, 80]))
    around = 81 * 30.0 * (1.0 + 0.02 * np.array(SETTINGS.around_peak))
    assert found == pytest.approx(np.array([81 * 120.0, 81 * 15.0, *around]))


def test_what_a_chosen_point_tells_is_what_a_measured_one_tells():
    random = np.random.default_rng(0)
    measured, points, weight = random.random((30, 3)) * 8, random.random((50, 3)) * 8, random.random(50) * 9
    why, taken = [""] * 50, [7, 3, 41]
    asked = Unknown(weight, measured, points, why)
    before = asked.gains()
    for number in taken:
        asked.take(number)
    anew = Unknown(weight, np.concatenate([measured, points[taken]]), points, why)
    assert np.allclose(asked.gains(), anew.gains(), rtol=1e-12, atol=1e-12)
    assert (asked.gains() <= before + 1e-12).all()
    # the equation of a Gaussian process: one minus what the known places tell, with the share that each leaves open
    distance = ((points[:, None] - measured[None]) ** 2).sum(axis=2)
    own = np.exp(-0.5 * ((measured[:, None] - measured[None]) ** 2).sum(axis=2)) + SETTINGS.left_open * np.eye(30)
    near = np.exp(-0.5 * distance)
    told = (near * np.linalg.solve(own, near.T).T).sum(axis=1)
    assert np.allclose(before, 2 * np.log1p(weight * (1 - told)), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("is_corrected", [True, False])
def test_torques_of_proposed_runs_are_corrected_ones_only_where_they_were_corrected(is_corrected):
    """With --accept as_is the torques stay as they are, and it was said that they are corrected."""
    ahead = NextRuns((NextRun(OperatingPoint(800.0, 400.0, 30.0), "tells noise", 0.1),))
    asked = Mistake("torque", "the torques seem to be read wrong", is_taken_out=is_corrected)
    text = next_runs_summary(ahead, SimpleNamespace(mistakes=(asked,)))
    assert ("the torques are corrected ones" in text) == is_corrected
