"""The page and the tables of a fleet, from made-up results of axes."""

import csv
import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.fleet.axes import AxisOptions, FleetAxis
from st_codegen.fleet.estimates import Estimate
from st_codegen.fleet.output import FleetReport
from st_codegen.fleet.stages import CHECK, COMPILE, RECONCILE, TRAIN, AxisResult, changes_of
from tests import browser

COUNT = 20


def result(number):
    """An axis with a stiffness, a play and their scatter; the fourth plays much, the sixth has a bad tooth."""
    random = np.random.default_rng(number)
    gap = random.normal(0.3, 0.015) + 0.6 * (number == 4)
    found = [
        Estimate("backlash", "gap_arcmin", gap, 0.004, "arcmin", 1, False, False),
        Estimate("torsional_compliance", "stiffness", random.normal(450, 20), 3.0, "Nm/arcmin", -1, False, False),
    ]
    for order in range(100, 112):
        size = random.normal(1e-3, 5e-5)
        found.append(Estimate("structural_resonance", f"amplitude_deg[{order}]", size, 1e-5, "deg", 1, False, False))
    if number == 6:
        found.append(Estimate("cycloid_tooth_error of order 39", "amplitude_deg", 1e-3, 1e-5, "deg", 1, False, True))
    reconciled = {
        "measured": str(number),
        "verdict": "explained",
        "effects": ["cycloid_tooth_error"] if number == 6 else [],
        "changed": ["changed backlash"] if number in (4, 6) else [],
        "gap": {"before": 2e-3, "after": 1e-3, "noise_floor": 1e-3},
        "not_looked_at": ["orders above 128"],
        "estimates": [asdict(one) for one in found],
    }
    if number == 9:
        return AxisResult({}, {TRAIN: "<b>bad.csv</b>: 2 problems\n  - one\n  - two"})
    trained = {"models": 12, "left_out": []}
    checked = {
        "passed": number != 8,
        "how": "12 texts (proved: 11, not proved: 1)" if number == 8 else "12 texts (proved: 12)",
    }
    return AxisResult({TRAIN: trained, COMPILE: {}, CHECK: checked, RECONCILE: reconciled})


@pytest.fixture(scope="module")
def report():
    axes = [FleetAxis(f"r{i}", "small", Path("c"), (), Path("rig.toml"), AxisOptions()) for i in range(COUNT)]
    return FleetReport.of(axes, {axis.name: result(i) for i, axis in enumerate(axes)})


def test_in_short(report):
    assert report.summary() == (
        "20 axes; failed: 1 (r9); text that did not pass its check: 1 (r8). Stand out: 1 (r4); with an effect that "
        "fewer than half have: 1 (r6)."
    )
    assert not report.passed
    assert report.not_looked_at[-2:] == (
        "orders above 128: 19 (r0, r1, r2, r3, r4, r5, r6, r7, and 11 more)",
        "the newest campaign, which was not reconciled: 1 (r9)",
    )


def test_numbers_of_the_rig_that_changed_are_found_as_what_it_lacks_is(report, tmp_path):
    """Axes were "explained" with nothing "found", where their changes had made the gap a tenth."""
    report.write(tmp_path)
    rows = list(csv.DictReader((tmp_path / "fleet.csv").read_text().splitlines()))
    assert [rows[number]["found"] for number in (3, 4, 6)] == [
        "",
        "changed backlash",
        "cycloid_tooth_error, changed backlash",
    ]


def test_an_effect_of_which_data_show_nothing_is_not_one_that_changed():
    names = {"backlash": True, "pin_error": False}
    retuned = [SimpleNamespace(before=SimpleNamespace(name=name), is_gone=gone) for name, gone in names.items()]
    found = SimpleNamespace(retuned=[*retuned, retuned[1]], offset_changed=True)
    assert changes_of(found) == ["no backlash", "changed pin_error", "changed zero_offset_deg"]


def test_a_fleet_of_which_nothing_was_checked_does_not_sound_as_if_all_had_passed():
    axes = [FleetAxis("r9", "small", Path("c"), (), Path("rig.toml"), AxisOptions())]
    assert FleetReport.of(axes, {"r9": result(9)}).summary().startswith("1 axis; failed: 1 (r9); no text was checked.")


def test_axes_of_small_types_are_said_not_to_be_judged_beside_those_that_are():
    types = {f"r{i}": "rare" if i > 17 else "small" for i in range(COUNT)}
    axes = [FleetAxis(name, kind, Path("c"), (), Path("rig.toml"), AxisOptions()) for name, kind in types.items()]
    small = FleetReport.of(axes, {axis.name: result(i) for i, axis in enumerate(axes)})
    assert "Stand out: 1 (r4)" in small.summary()
    assert "fewer than 8 have a parameter with an error in common: 2 (r18, r19)." in small.summary()


def test_the_files(report, tmp_path):
    report.write(tmp_path)
    facts = json.loads((tmp_path / "fleet.json").read_text())
    (outlier,) = facts["outliers"]
    assert (outlier["axis"], outlier["effect"], outlier["parameter"]) == ("r4", "backlash", "gap_arcmin")
    assert outlier["distance"] > outlier["limit"] > 3
    assert facts["rare"] == [
        {"type": "small", "effect": "cycloid_tooth_error of order 39", "axes": ["r6"], "of": COUNT - 1}
    ]
    assert facts["passed"] is False
    axes = list(csv.DictReader((tmp_path / "fleet.csv").read_text().splitlines()))
    assert len(axes) == COUNT
    assert axes[9]["error"] == "train: <b>bad.csv</b>: 2 problems - one - two"
    effects = list(csv.DictReader((tmp_path / "effects.csv").read_text().splitlines()))
    assert [row["axis"] for row in effects if row["stands_out"] == "True"] == ["r4"]
    assert len(effects) == 14 * (COUNT - 1) + 1


def test_the_page_in_a_browser(report, tmp_path):
    page = report.html()
    assert "&lt;b&gt;bad.csv" in page
    assert "<script" not in page
    assert "Parameters that stand out: 1" in page
    assert "about 5% of all fleets or fewer" in page
    count, found = browser.faults(page, 400, tmp_path)
    assert count > 5
    assert found == []


def test_an_effect_that_was_not_found_before_is_not_said_to_have_grown():
    """Its size before is not known: it may have been too small to be found."""
    play = Estimate("backlash", "gap_arcmin", 0.3, 0.004, "arcmin", 1, False, False)
    tooth = Estimate("cycloid_tooth_error of order 39", "amplitude_deg", 1e-3, 1e-5, "deg", 1, False, True)
    facts = {"verdict": "explained", "effects": [], "gap": {}}
    before, now = (
        {"estimates": [asdict(one) for one in found], "measured": str(number)} | facts
        for number, found in enumerate(([play], [replace(play, value=0.301), tooth]))
    )
    axis = FleetAxis("r", "small", Path("c"), (Path("b"),), Path("rig.toml"), AxisOptions())
    result = AxisResult({CHECK: {"passed": True}, "earlier 1": before, RECONCILE: now})
    new = AxisResult({CHECK: {"passed": True}, RECONCILE: now})
    report = FleetReport.of([axis, replace(axis, name="s", earlier=())], {"r": result, "s": new})
    grown = "With effects that have grown, of 1 axis compared with a campaign before: none."  # the other has none
    said = f"{grown} With effects that their last campaign before did not find: 1 (r)."
    assert said in report.summary()
    assert "What has grown, or was not found in the last campaign before: 1" in report.html()


def test_copies_are_told_in_short():
    axes = [FleetAxis(name, "small", Path(name), (), Path("rig.toml"), AxisOptions()) for name in "ab"]
    report = FleetReport.of(axes, dict.fromkeys("ab", result(0)))
    assert report.summary().endswith("Campaigns with the very numbers of another one, as copies have: 2 (a, b).")
