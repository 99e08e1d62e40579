"""The runner with stand-ins for the program: one knows the truth, one says nothing, one always says the same."""

import json
import subprocess

import pytest

from .blind import cases, run, write

CASES = 14


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    """Replaces the program; `answer(case, made)` gives verdict, effects and unexplained of its report."""
    state = {"calls": 0}
    make = run.generator.make

    def remember(case, folder):
        state["case"], state["made"] = case, make(case, folder)
        return state["made"]

    def install(answer):
        def reconcile(rig, measured, out, *more):
            state["calls"] += 1
            verdict, effects, unexplained = answer(state["case"], state["made"])
            out.mkdir()
            floor = state["made"].floor_deg
            part = {"before": 2 * floor, "after": floor, "noise_floor": floor}
            report = {"verdict": verdict, "effects": effects, "unexplained": unexplained}
            (out / "report.json").write_text(json.dumps(report | {"gap": {"fitted": part, "held_out": part}}))
            write.rig(out / "rig.toml", {"rig": state["made"].head}, state["made"].true)
            return subprocess.CompletedProcess([], 0, "", "")

        monkeypatch.setattr(run, "reconcile", reconcile)
        monkeypatch.setattr(run.generator, "make", remember)
        monkeypatch.setattr(run.generator, "SAMPLES", 512)

    def summary(*more):
        options = [
            "--seeds",
            "dev",
            "--cases",
            str(CASES),
            "--json",
            str(tmp_path / "b.json"),
            "--work",
            str(tmp_path / "w"),
        ]
        assert run.main([*options, *more]) == 0
        return json.loads((tmp_path / "b.json").read_text())["summary"]

    return install, summary, state


def truth(case, made):
    if case.kind in ("none", "weak"):
        return "nothing_missing", [], []
    effects = []
    for name, keys in made.expected.hidden.items():
        parameters = {key: {"value": value, "stderr": abs(value) / 100, "unit": ""} for key, value in keys.items()}
        alternatives = [other for group in made.expected.groups for other in group if other != name]
        effects.append({"name": name, "orders": [], "parameters": parameters, "alternatives": alternatives})
    strange = [{"order": order} for order in made.expected.orders] or (
        [{"order": None}] if case.kind == "foreign" else []
    )
    verdict = "explained" if not strange else "partly_explained" if effects else "unexplained"
    return verdict, effects, strange


def shares(summary):
    return {key: value["share"] for key, value in summary.items() if isinstance(value, dict) and "share" in value}


def test_who_knows_the_truth_gets_full_marks(stand_in):
    install, summary, _ = stand_in
    install(truth)
    found = shares(summary())
    bad = ("crashed", "false_addition_where_nothing_is_missing", "false_addition_in_any_case")
    assert {key: share for key, share in found.items() if share is not None} == {
        key: (0.0 if key in bad else 1.0) for key, share in found.items() if share is not None
    }
    assert found["exact_naming"] == 1.0 and found["gap_at_most_1.1_floors_against_truth"] == 1.0


def test_who_says_nothing_names_nothing(stand_in):
    install, summary, _ = stand_in
    install(lambda case, made: ("nothing_missing", [], []))
    found = shares(summary())
    assert found["exact_naming"] == 0.0
    assert found["false_addition_in_any_case"] == 0.0
    assert found["weak_not_claimed"] == found["silent_where_nothing_is_missing"] == 1.0


def test_who_always_says_wear_is_nearly_always_wrong(stand_in):
    install, summary, _ = stand_in
    wear = {"name": "wear", "orders": [], "parameters": {}, "alternatives": []}
    install(lambda case, made: ("explained", [wear], []))
    found = shares(summary())
    assert found["exact_naming"] == 0.0, "no wear among the first cases"
    assert found["false_addition_where_nothing_is_missing"] == 1.0
    assert found["weak_not_claimed"] == found["foreign_not_misnamed"] == found["confounded_reported"] == 0.0


@pytest.mark.thorough
def test_an_interrupted_run_goes_on_and_a_changed_program_starts_anew(stand_in, monkeypatch):
    install, summary, state = stand_in
    install(truth)
    summary()
    assert state["calls"] == CASES
    summary()
    assert state["calls"] == CASES, "all results were kept"
    monkeypatch.setattr(run, "fingerprint", lambda: "another")
    summary()
    assert state["calls"] == 2 * CASES


@pytest.mark.thorough
def test_a_crash_counts_against_the_program(stand_in, monkeypatch):
    _, summary, _ = stand_in
    failed = subprocess.CompletedProcess([], 1, "", "Traceback")
    monkeypatch.setattr(run, "reconcile", lambda *arguments: failed)
    found = shares(summary())
    assert found["crashed"] == 1.0
    assert found["exact_naming"] == found["silent_where_nothing_is_missing"] == 0.0


def test_only_picks_cases_by_name(stand_in):
    install, summary, state = stand_in
    install(truth)
    summary("--only", "none")
    assert state["calls"] == sum(case.kind == "none" for case in cases.listed("dev", CASES))
