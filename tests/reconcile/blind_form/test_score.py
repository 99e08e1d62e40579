"""The judge calls false what is false, and nothing else."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from . import cases, comparison, coverage, measuring, mesh, peers, run, summary
from .machine import Machine, st_codegen
from .make import Truth
from .points import Points, curves
from .report import read_report, says
from .score import NewRig, refused, score

SIZE = 2e-3
NOISE = 1e-5


def truth_of(*parts, mistakes=(), kind="foreign", wrong=(), bad_files=()):
    """A case with 30 runs, and a known part that is 0."""
    case = replace(next(c for c in cases.listed("dev", 60) if not c.mistakes), mistakes=mistakes, kind=kind)
    random = np.random.default_rng(5)
    speed, torque = random.uniform(200, 1700, 30), random.uniform(0, 1600, 30)
    points = Points(np.round(speed), np.round(torque), np.full(30, 30.0), np.linspace(0, 1, 30), np.arange(30))
    hidden = sum((curves(part.waves(points), 600) for part in parts), np.zeros((30, 2, 600)))
    known = np.zeros_like(hidden)
    noise = np.full(300, NOISE)
    path = Path("rig.toml")
    return Truth(
        case, Machine(81, 39, 40, ()), parts, points, points, known, hidden, points, known, hidden, noise,
        tuple(100.0 for _ in parts), bad_files, wrong, path, path, measuring.plainly(points, hidden),
    )  # fmt: skip


def wave(order=53, names=(), hedged=(), law=None):
    part = mesh.wave_part("a wave", names, order, law or mesh.one(), SIZE)
    return replace(part, hedged=hedged)


def report_of(verdict="explained", effects=(), unexplained=(), orders=(0, 1, 53), **more):
    floor = NOISE * np.sqrt(len(orders))
    gap = {"before": SIZE, "after": floor, "noise_floor": floor}
    effects = [{"parameters": {}, **effect} for effect in effects]
    text = {"verdict": verdict, "effects": effects, "unexplained": list(unexplained), "orders": list(orders)}
    return read_report(text | {"gap": {"fitted": dict(gap), "held_out": dict(gap)}} | more)


def judged(truth, report, found=True):
    """Scored with a new rig that makes all that was hidden, or nothing of it."""
    rig = NewRig(truth.known + found * truth.hidden, truth.known_fresh + found * truth.hidden_fresh)
    return score(truth, report, rig)


def kinds(marks):
    return {row.kind for row in marks.false}


def test_a_true_name_is_right():
    truth = truth_of(wave(80, ("pin_error",)))
    marks = judged(truth, report_of(effects=[{"name": "pin_error", "orders": [80]}]))
    assert marks.right, marks
    assert marks.named


def test_a_true_name_on_another_order_is_false():
    truth = truth_of(wave(80, ("pin_error",)))
    marks = judged(truth, report_of(effects=[{"name": "pin_error", "orders": [120]}]))
    assert kinds(marks) == {"name"}


def test_a_name_for_what_no_part_makes_is_false():
    truth = truth_of(wave(53))
    assert kinds(judged(truth, report_of(effects=[{"name": "pin_error", "orders": [53]}]))) == {"name"}
    described = [{"order": 53, "size": SIZE / np.sqrt(2), "direction": "both"}]
    marks = judged(truth, report_of("unexplained", unexplained=described), found=False)
    assert not marks.missing
    # its own numbers of the gap are those of a rig that explains it
    assert kinds(marks) == {"held out"}


def test_an_order_alone_is_no_name():
    truth = truth_of(wave(117, (), ("cycloid_tooth_error",)))
    plain = {"name": "cycloid_tooth_error", "orders": [117]}
    assert kinds(judged(truth, report_of(effects=[plain], orders=(0, 117)))) == {"name"}
    for more in ({"alternatives": ["something else"]}, {"probability": 0.6}, {"remarks": ["an order is no name"]}):
        assert not judged(truth, report_of(effects=[plain | more], orders=(0, 117))).false


def test_silence_is_false_where_something_is_left():
    marks = judged(truth_of(wave()), report_of("nothing_missing"), found=False)
    assert "verdict" in kinds(marks)
    assert marks.missing


def test_one_order_above_its_own_floor_is_not_explained():
    """The floor of 40 orders together is 6 times that of one."""
    part = mesh.wave_part("a wave", ("pin_error",), 53, mesh.one(), 4 * NOISE * np.sqrt(2))
    orders = tuple(range(30, 70))
    assert "verdict" in kinds(judged(truth_of(part), report_of(orders=orders), found=False))
    assert "verdict" not in kinds(judged(truth_of(part), report_of(orders=orders)))


def test_silence_is_right_where_nothing_is_missing():
    marks = judged(truth_of(kind="nothing"), report_of("nothing_missing"))
    assert marks.silent
    assert marks.right
    assert judged(truth_of(kind="nothing"), report_of("explained", [{"name": "pin_error"}])).silent is False


@pytest.mark.parametrize(("size", "is_false"), [(SIZE / np.sqrt(2), False), (0.7 * SIZE / np.sqrt(2), True)])
def test_sizes_of_what_is_left(size, is_false):
    entry = {"order": 53, "size": size, "direction": "both"}
    marks = judged(truth_of(wave()), report_of("unexplained", unexplained=[entry]), found=False)
    assert ("size" in kinds(marks)) == is_false


def test_a_wrong_floor_and_a_wrong_held_out_gap_are_false():
    truth = truth_of(wave(53, ("pin_error",)))
    gap = {"before": SIZE, "after": 2e-5, "noise_floor": 1e-3}
    report = report_of(effects=[{"name": "pin_error"}], gap={"fitted": gap, "held_out": gap})
    assert kinds(judged(truth, report)) == {"floor"}
    assert kinds(judged(truth, report, found=False)) >= {"floor", "held out"}
    gaps = {"gap": {"fitted": gap, "held_out": gap}, "noise_floor_at_most": True}
    assert not kinds(judged(truth, report_of("unexplained", **gaps)))
    assert kinds(judged(truth, report_of("unexplained", **gaps), found=False)) == {"held out"}
    assert not kinds(judged(truth, report_of("unexplained", **gaps, held_out_at_least=True), found=False))
    low = {"gap": {"fitted": gap | {"noise_floor": 1e-9}, "held_out": gap}, "noise_floor_at_most": True}
    assert kinds(judged(truth, report_of("unexplained", **low))) == {"floor"}


def test_a_size_that_is_said_to_be_the_least_may_be_larger():
    truth = truth_of(wave(53))
    for share, right in ((0.5, True), (1.0, True), (1.5, False)):
        entry = {"order": 53, "size": share * SIZE / np.sqrt(2), "at_least": True}
        marks = judged(truth, report_of("unexplained", unexplained=[entry]), found=False)
        assert ("size" not in kinds(marks)) is right, share


def test_a_new_rig_that_is_worse_is_no_progress():
    truth = truth_of(wave(53, ("pin_error",)))
    rig = NewRig(-truth.hidden, -truth.hidden_fresh)
    marks = score(truth, report_of(effects=[{"name": "pin_error"}]), rig)
    assert any("worse on fresh runs" in row.text for row in marks.false)


def test_a_rig_that_the_program_refuses_is_a_false_statement():
    truth = truth_of(wave(53, ("pin_error",)))
    rig = NewRig(truth.known, truth.known_fresh, "upper_ratio = 6.75 is outside 0 .. 5")
    assert kinds(score(truth, report_of(effects=[{"name": "pin_error"}]), rig)) == {"rig"}


def test_a_parameter_at_a_bound_is_no_finding():
    effect = {
        "name": "pin_error",
        "parameters": {"damping_ratio": {"value": 0.3, "stderr": 0.01}, "frequency_Hz": {"value": 41.23456789}},
    }
    truth = truth_of(wave(53, ("pin_error",)))
    assert kinds(judged(truth, report_of(effects=[effect]))) == {"bound"}
    effect["parameters"]["damping_ratio"]["value"] = 0.029873640234
    assert judged(truth, report_of(effects=[effect])).right


def test_a_known_parameter_that_did_not_change():
    retuned = [{"name": "backlash", "parameters": {"gap_arcmin": {"before": 0.3, "value": 0.5, "stderr": 0.01}}}]
    assert kinds(judged(truth_of(), report_of(retuned=retuned))) == {"known parameter"}
    retuned[0]["parameters"]["gap_arcmin"]["value"] = 0.301
    assert not judged(truth_of(), report_of(retuned=retuned)).false


def test_a_mistake_is_named_or_absorbed():
    truth = truth_of(mistakes=("home_offset",), kind="nothing")
    marks = judged(truth, report_of(effects=[{"name": "pin_error", "orders": [40]}]))
    assert "mistake absorbed" in kinds(marks)
    assert marks.missing
    said = {"name": "home_offset", "deg": 12.0}
    assert judged(truth, report_of("nothing_missing", measurement=[said])).right
    assert not judged(truth, report_of("nothing_missing", measurement=[said | {"found": False}])).right
    assert judged(truth, report_of("nothing_missing", measurement={"mistakes": [said]})).right
    more = [said, {"name": "sign"}]
    assert kinds(judged(truth, report_of("nothing_missing", measurement=more))) == {"measurement"}
    assert refused(truth, "Error: the home position seems to have moved by 12 deg", "").right
    assert not refused(truth, "Error: something", "").right


def test_wrong_labels_are_suspects_and_right_runs_are_not():
    truth = truth_of(mistakes=("labels",), kind="nothing", wrong=(4, 7))
    marks = judged(truth, report_of("nothing_missing", suspect_runs=["run_0005.csv", "run_0008.csv"]))
    assert marks.right
    marks = judged(truth, report_of("nothing_missing", suspect_runs=["run_0005.csv", "run_0009.csv"]))
    assert "suspect" in kinds(marks)
    points = truth.points
    text = f"{points.speed[7]:g} rpm, {points.torque[7]:g} N m, 30 deg C, forward"
    table = {"speed_rpm": points.speed[7], "torque_Nm": points.torque[7], "temperature_C": 30}
    name = f"{points.speed[7]:.1f}rpm{points.torque[7]:.1f}Nm30.0deg.csv"
    for said in (text, table, name):
        assert judged(truth, report_of("nothing_missing", suspect_runs=["run_0005.csv", said])).right


def test_a_refusal_may_not_advise_what_does_not_exist():
    truth = truth_of(bad_files=("run_0001.csv",))
    marks = refused(truth, "Error: run_0001.csv is bad; --skip-bad leaves it out", "--rig --measured")
    assert [row.kind for row in marks.false] == ["advice"]
    assert not refused(truth, "Error: run_0001.csv; --skip-bad", "--skip-bad").false


def test_what_never_varied_has_to_be_said():
    truth = truth_of(kind="one_temperature")
    assert kinds(judged(truth, report_of("nothing_missing"))) == {"unseen"}
    assert not judged(truth, report_of("nothing_missing", not_shown=["temperature: 30 deg C in all runs"])).false


def test_no_folder_gives_away_the_answer():
    for case in cases.listed("dev", 100):
        assert not [kind for kind in (case.kind, *case.mistakes, case.trouble) if kind and kind in case.number]


def test_a_mistake_that_is_said_to_be_hidden_by_noise_is_not_denied():
    truth = truth_of(mistakes=("eccentric_angle",), kind="nothing")
    assert kinds(judged(truth, report_of("nothing_missing"))) == {"verdict"}
    said = judged(truth, report_of("nothing_missing", cannot_show=["an angle that is read wrong may not show"]))
    assert not said.false and not said.right, "it is not named either"


def test_words_of_mistakes_do_not_contain_each_other():
    assert set(measuring.WORDS) == set(measuring.MISTAKES)
    assert says("the sign of TE", measuring.WORDS["sign"])
    assert not says("a design", measuring.WORDS["sign"])
    assert not refused(truth_of(mistakes=("arcmin",)), "60 times the rig's: rad? give --scale 0.017", "--scale").right


def test_results_of_the_command(tmp_path):
    truth = truth_of(wave())
    crashed = run.judged(truth, subprocess.CompletedProcess([], 70, "", "Traceback\nValueError: x"), tmp_path)
    assert crashed["status"] == "failed"
    assert "ValueError: x" in crashed["reason"]
    assert run.judged(truth, subprocess.CompletedProcess([], 0, "", ""), tmp_path)["status"] == "unreadable"


def test_a_command_over_its_time_is_ended():
    with pytest.raises(subprocess.TimeoutExpired):
        st_codegen(["reconcile", "--help"], 0.01)


def result(name, noise, right, false=(), probabilities=(), seed=1):
    marks = {"false": [{"kind": kind, "text": ""} for kind in false], "named": None, "silent": None, "sizes": [[1, 2]],
             "held_out": None, "probabilities": probabilities}  # fmt: skip
    case = {"name": f"{name}-{noise}", "label": name, "noise": noise, "seed": seed, "layout": "grid",
            "noise_form": "white", "form": "named"}  # fmt: skip
    return {"case": case, "status": "scored", "right": right, "score": marks}


def test_summary_counts_false_statements_and_worse_answers_of_better_data():
    results = [
        result("a", 0.1, False, ["name", "size"], [(0.92, True), (0.95, False)]),
        result("a", 10.0, True),
        result("b", 1.0, True, seed=2),
    ]
    table = summary.table(results)
    assert table["all"]["right"] == 2
    assert table["by_kind"]["a"]["false"] == {"name": 1, "size": 1}
    assert table["better_data_worse_answer"] == [{"label": "a", "seed": 1, "wrong_at": 0.1, "right_at": 10.0}]
    (tenth,) = table["calibration"]
    assert tenth == {"from": 0.9, "claims": 2, "stated": pytest.approx(0.935), "observed": 0.5,
                     "low": pytest.approx(0.095, abs=1e-3), "high": pytest.approx(0.905, abs=1e-3)}  # fmt: skip
    assert table["sizes_within_20_percent"] == {"hits": 0, "of": 3}
    assert len(table["false_statements"]) == 2
    assert "better data, worse answer: 1" in "\n".join(summary.lines(table))


def test_peers_find_a_polynomial_and_stay_silent_in_noise():
    random = np.random.default_rng(6)
    truth = truth_of(wave(53, law=mesh.power(2.0)))
    noise = 1e-4 * random.standard_normal(truth.hidden.shape)
    for hidden, expected in ((1.0, [53]), (0.0, [])):
        data = measuring.plainly(truth.points, hidden * truth.hidden + noise)
        orders, added, measured = peers.explain(replace(truth, data=data), peers.stepwise)
        assert orders == expected
        if orders:
            found = comparison.judge(truth, orders, added)
            assert found["spoken_of"] == [True]
            assert found["false_orders"] == 0
            assert found["fresh_gap"][0] < 0.1 * found["fresh_gap"][1]
            assert measured[53] == pytest.approx(truth.by_order()[53], rel=0.05)
    table = comparison.table([{"case": {"mistakes": []}, "truth": {"parts": [1]}} | found])
    assert table["without mistakes of measuring"]["strong_parts_spoken_of"] == [1, 1]


def test_an_order_that_is_not_there_is_a_false_order():
    truth = truth_of(wave(53))
    added = np.zeros((30, 2, 150), dtype=complex)
    assert comparison.judge(truth, [53, 81], added)["false_orders"] == 1
    assert comparison.judge(truth, [53, 81], added)["fresh_gap"][0] == pytest.approx(SIZE / np.sqrt(2))


def test_exponents_are_no_bounds_and_rounded_reports_have_none():
    truth = truth_of(wave(53))
    formula = {"name": "empirical", "orders": [53], "parameters": {"power": {"value": 2.0}}}
    other = {"name": "empirical", "orders": [53], "parameters": {"size_deg": {"value": 1.23456789e-4}}}
    assert not judged(truth, report_of(effects=[formula, other])).false
    assert kinds(judged(truth, report_of(effects=[formula | {"orders": [80]}]))) == {"name"}


def test_a_probability_is_that_of_the_name_itself():
    truth = truth_of(wave(80, ("pin_error",)))
    effect = {"name": "cycloid_tooth_error", "orders": [80], "alternatives": ["pin_error"], "probability": 0.7}
    marks = judged(truth, report_of(effects=[effect, {"name": "pin_error", "orders": [80], "probability": 0.9}]))
    assert marks.probabilities == ((0.7, False), (0.9, True))


def test_calibration_of_kept_results_is_printed(tmp_path, capsys):
    results = [result("a", 0.1, True, [], [(0.98, True)] * 19 + [(0.98, False), (0.82, True)])]
    (tmp_path / "a.json").write_text(json.dumps({"cases": results}))
    (tmp_path / "b.partial").write_text(json.dumps({"program": "x", "result": results[0]}) + "\n")
    assert run.main(["--calibration", str(tmp_path / "a.json"), str(tmp_path / "b.partial")]) == 0
    assert "| 0.9 to 1.0 | 40 | 0.98 | 0.95 | 0.83 to 0.99 |" in capsys.readouterr().out


@pytest.mark.thorough
def test_errors_are_judged_by_what_endless_data_would_give():
    chosen = coverage.cases(8)
    assert sorted(case.kind for case in chosen) == sorted(coverage.KINDS)
    (spring,) = [case for case in chosen if case.kind == "hertz_spring"]
    assert [row[-1] for row in coverage.judged(spring)] == [True]
