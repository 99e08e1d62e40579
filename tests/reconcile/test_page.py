"""The page: what it says of findings, and, in a browser, that nothing is cut and no labels overlap."""

import html
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.hum import Hum
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.plan.next_runs import next_runs
from st_codegen.reconcile.report.findings import findings, share_text
from st_codegen.reconcile.report.output import report
from st_codegen.reconcile.report.pages import report_page
from st_codegen.reconcile.report.ranking import outcome, ranking_section
from st_codegen.reconcile.report.sentences import (
    _between_loads,
    _compliance,
    _defect,
    _times,
    _where_measured,
    _worn,
    between_text,
    left_text,
    together_text,
    verdict_text,
)
from st_codegen.reconcile.report.summary import summary
from st_codegen.reconcile.rest.unexplained import of_a_hum, signatures
from st_codegen.reconcile.result import OrderGap
from st_codegen.rig.effects import Conditions
from tests import browser

from .test_core import KNOWN, RIG, effect, grid, observed

pytest.importorskip("matplotlib")

ORDERS = (0, 1, 2, 3, 36, 39, 40, 42, 78)
RESONANCE = effect(
    "structural_resonance", orders=[40, 78], frequency_Hz=12.0, damping_ratio=0.03, amplitude_deg=[2e-3, 3e-3],
    phase_rad=[0.3, 1.0], backward_amplitude_deg=[2e-3, 2e-3], backward_phase_rad=[0.3, 2.0],
)  # fmt: skip
SIDEBANDS = effect(
    "carrier_modulation", order=39, lower_ratio=0.3, lower_phase_rad=0.0, upper_ratio=0.2, upper_phase_rad=0.5
)


@pytest.fixture(scope="module")
def result():
    """A softer transmission, a resonance, sidebands, and a wave of order 3 that nothing makes."""
    soft = effect("torsional_compliance", stiffness_Nm_per_arcmin=400.0)
    at = grid(12, 5, 2)
    data = observed(replace(RIG, effects=(soft, *RIG.effects[1:], RESONANCE, SIDEBANDS)), at, ORDERS)
    values = data.values.copy()
    values[:, ORDERS.index(3)] += 4e-4 * np.cos(at.speed_rpm / 90) * np.exp(1j * at.torque_Nm / 300)
    return reconcile_observations(RIG, replace(data, values=values), KNOWN)


@pytest.fixture(scope="module")
def page(result):
    return report_page(result, None, next_runs(result))


def test_the_documentation_lists_the_keys_of_the_report(result):
    """`gap_by_order` was said to hold what `gap` does."""
    pages = Path(__file__).parents[2] / "docs" / "reconcile.md"
    section = pages.read_text(encoding="utf-8").partition("\n## report.json")[2].partition("\n## ")[0]
    content = report(result, None, next_runs(result))
    wanted = {*content, *content["effects"][0], *content["gap"], *content["gap"]["fitted"], *content["gap_by_order"][0]}
    assert wanted | {"models"} <= {*re.findall(r"`(\w+)`", section)}


def test_nothing_stands_in_place_of_a_zero_that_is_the_rigs(result):
    """`something_else` did, beside any change that turns with the direction."""
    zero = report(result)["zero_offset_deg"]
    assert report(result)["retuned"][0]["name"] == "torsional_compliance"
    assert zero["rig"] == zero["new"] and not zero["changed"] and zero["alternatives"] == []


def test_the_page_says_which_mistakes_of_measuring_were_corrected(result):
    """The text of the command alone did: "nothing was found missing" stood over data that had been turned."""
    said = [
        "TE seems to have the opposite sign of the rig's (corrected)",
        "2 runs seem to carry the label of another run",
    ]
    shown = html.unescape(report_page(replace(result, mistakes=tuple(Mistake("sign", one) for one in said))))
    assert shown.index("The measurement") < shown.index(f"{said[0]}.") < shown.index("Findings")
    assert f"{said[1]}." in shown and all(one in summary(replace(result, mistakes=(Mistake("", one),))) for one in said)
    assert ">The measurement<" not in html.unescape(report_page(result))


def test_findings_stand_by_size_with_what_the_larger_ones_leave(result):
    found = findings(result)
    assert [f.effect.name for f in found] == ["torsional_compliance", "structural_resonance", "carrier_modulation"]
    # 454 to 400 is nearly all of the gap; the others explain parts of the rest
    assert found[0].share > 0.9
    assert found[1].share > 0.5
    assert share_text(found[0], first=True).endswith("% of the gap")
    assert share_text(found[1], first=False).endswith("% of what the larger findings leave")
    # shares of what is left multiply to what is left after all
    before, after = result.fitted.before, result.fitted.after
    assert np.prod([1 - f.share for f in found]) == pytest.approx((after / before) ** 2, rel=1e-6)


def test_a_changed_parameter_shows_old_and_new(result, page):
    changed = findings(result)[0]
    [number] = changed.numbers
    assert re.fullmatch(r"stiffness_Nm_per_arcmin 454 -> (399|400|401)(\.\d)? \+- \S+ Nm/arcmin", number)
    assert html.escape(number) in page
    assert number in summary(result)


def test_each_finding_says_what_is_next(result, page):
    for finding in findings(result, next_runs(result)):
        assert finding.todo
        assert html.escape(finding.todo) in page


def test_a_share_near_all_is_no_power_of_ten(result):
    """99.6 % of the gap was "1e+02 %"."""
    most = replace(result, unexplained=(replace(result.unexplained[0], share=0.996),))
    text = report_page(most)
    assert "more than 99 %" in text and "e+02 %" not in text


def test_held_out_levels_are_those_that_can_be_left_out(result):
    """Of a temperature that never varied it said that each was predicted by parameters fitted without it."""
    text = report_page(replace(result, unseen_curves=0))
    assert "left out in turn and predicted by parameters fitted without them, where the others tell these" in text


def test_the_largest_torque_may_pull_the_other_way(result):
    """Of -1800 to 200 N m it was the twist by 200 N m, a tenth of what the machine had."""
    soft = effect("torsional_compliance", stiffness_Nm_per_arcmin=450.0)
    at = result.data.at
    pulled = replace(at, torque_Nm=at.torque_Nm / at.torque_Nm.max() * 2000.0 - 1800.0)
    assert "4.0 arcmin at the largest torque" in _compliance(
        soft, replace(result, data=replace(result.data, at=pulled))
    )


@pytest.mark.parametrize(
    ("says", "found", "text"),
    [
        (_worn, effect("wear", depth_arcmin=0.6, centre_deg=200.0, width_deg=9.0),
         "a worn sector around 200 deg of the output, 0.6 arcmin (0.01 deg) deep"),
        (_defect, effect("local_defect", height_deg=2e-3, turning_deg=5e-4, slope_deg_per_kNm=1e-3, centre_deg=380.0,
                         width_deg=1.5),
         "a bump at 20.0 deg of the output, about 3.0 deg wide and in the mean of the runs 0.0031 deg forward, 0.0007 "
         "deg backward high: not a harmonic"),
    ],
    ids=["wear", "local_defect"],
)  # fmt: skip
def test_a_place_of_the_turn_is_said_with_its_sizes_in_both_directions(says, found, text):
    at = Conditions.of(np.array([1.0, 1.0, -1.0, -1.0]), 900.0, np.array([400.0, 800.0, -400.0, -1200.0]), 30.0)
    assert says(found, SimpleNamespace(data=SimpleNamespace(at=at))) == text


@pytest.mark.parametrize(
    ("moves", "where"),
    [
        ({}, "at 12.0 Hz"),
        ({"frequency_per_10K": -0.1}, "at 10.8 Hz at 40 degC"),
        ({"frequency_per_10K": -0.1, "frequency_per_kNm": -0.5}, "at 9.6 Hz at 200 N m at 40 degC"),
    ],
    ids=["it stays", "oil", "oil and load"],
)
def test_a_resonance_stands_where_it_was_measured(moves, where):
    """Not at the reference temperature of 30 degC and without load, where no run was."""
    at = Conditions.of(np.ones(4), 900.0, np.array([200.0, 600.0, 200.0, 600.0]), np.array([40.0, 40.0, 50.0, 50.0]))
    assert _where_measured(effect("structural_resonance", **RESONANCE.values | moves), at) == where


def test_a_resonance_that_moves_less_and_less_is_said_at_a_low_and_a_high_load():
    at = Conditions.of(np.ones(4), np.array([900.0, 1800.0] * 2), np.array([100.0, 100.0, -900.0, -900.0]), 30.0)
    moves = {"frequency_per_kNm": -4.0, "levels_off_per_kNm": 20.0}
    mode = effect("structural_resonance", **RESONANCE.values | moves)
    assert _between_loads(mode, at, 12.0) == "at 10.4 Hz at 100 N m and at 9.7 Hz at 900 N m"


@pytest.mark.parametrize(
    ("centre", "curves", "said"),
    [(20.0, True, "20 deg, within 4 deg"), (358.0, True, "begin and end there"), (358.0, False, "358 deg, within")],
)
def test_where_what_is_unexplained_stands_in_the_turn_is_said(centre, curves, said):
    """Of a table nobody knows where its curves began."""
    orders = np.arange(1, 200)
    wave = 1e-4 * np.sin(orders * np.radians(4.0)) / orders * np.exp(-1j * orders * np.radians(centre))
    at = Conditions.of(np.ones(3), 900.0, 400.0, 30.0)
    data = SimpleNamespace(orders=orders, angle_rad=None, at=at, spectral_deg=orders if curves else None)
    result = SimpleNamespace(
        target=SimpleNamespace(data=data, good=np.ones(3, bool)),
        data=data,
        unexplained=[SimpleNamespace(order=order) for order in orders.tolist()],
        conclusions=SimpleNamespace(final=SimpleNamespace(residual=np.tile(wave, (3, 1)))),
    )
    text = together_text(result)
    assert said in text and "pins, teeth and bearings" in text
    assert ("begin and end there" in text) == (curves and centre == 358.0)


def test_half_as_much_again_is_not_twice():
    assert [_times(factor) for factor in (1.51, 1.94, 1.96, 7.4, 132.0)] == ["1.5", "1.9", "2", "7", "132"]


def test_bounds_of_gaps_are_rounded_as_bounds(result):
    gap = replace(result.held_out, after=0.00123999, noise_floor=0.000123456)
    few = replace(result, held_out=gap, untested=("torque",))
    assert few.floor_is_bound and few.held_out_is_bound
    assert "-> at least 0.00123 deg RMS, noise floor at most 0.000124 deg" in summary(few)


def test_the_verdict_stands_first_then_what_to_do_and_last_what_cannot_be_told(result):
    unshown = replace(result, cannot_show=("one", "two"))
    lines = summary(unshown, ["Next measurement: none"]).splitlines()
    assert lines[0] == verdict_text(result)
    gap, following, first, second = (
        next(number for number, line in enumerate(lines) if line.startswith(words))
        for words in ("Gap on held-out runs", "Next measurement", "Cannot be shown: one", "Cannot be shown: two")
    )
    assert gap < following < first < second
    assert not any(line.startswith("- ") for line in lines[gap:])


def test_a_gap_well_above_the_floor_has_its_reason(result, page):
    text = left_text(result)
    size = result.held_out.after / result.held_out.noise_floor
    assert text.startswith(f"The gap on held-out runs is {size:.3g} noise floors: ")
    assert re.search(r" 9\d % of its power is order 3, 0\.000\d+ deg RMS \(of the .* both directions share", text)
    assert html.escape(text) in page and text in summary(result)
    assert left_text(replace(result, held_out=replace(result.held_out, noise_floor=result.held_out.after))) == ""
    # where most of the gap is none of the orders', those that make nothing of it are not listed
    wide = replace(result, held_out=replace(result.held_out, after=20 * result.held_out.after))
    assert left_text(wide).count("% of its power") == 1
    # nor are those whose own noise it is
    quiet = replace(result, orders=tuple(replace(one, noise_floor=one.held_out) for one in result.orders))
    assert left_text(quiet) == f"The gap on held-out runs is {size:.3g} noise floors: no order alone makes it."


def test_a_gap_between_temperatures_that_does_not_move_the_whole_is_not_worth_a_sentence(result):
    assert "Between temperatures" in between_text(replace(result, between_deg=0.5 * result.held_out.after))
    assert between_text(replace(result, between_deg=1e-3 * result.held_out.after)) == between_text(result)


@pytest.mark.thorough
def test_a_hum_stands_with_its_frequency(result):
    hum = Hum(50.0, 2e-3, (40, 60), np.full(200, 1e-5))
    found = replace(result, unexplained=(of_a_hum(hum), *result.unexplained))
    page = report_page(found, None, next_runs(found))
    assert "<td>50 Hz</td>" in page and html.escape(hum.text) in page
    entry = report(found)["unexplained"][0]
    assert entry["order"] is None and entry["frequency_Hz"] == 50.0 and hum.text in summary(found)
    found = replace(result, unexplained=(of_a_hum(replace(hum, frequency_Hz=0.0, order=17.31962)),))
    assert "<td>17.32 a turn</td>" in report_page(found, None, next_runs(found))


def test_what_a_hum_made_of_an_order_is_unexplained_there_too(result):
    """Half of what is left was said to be all of it; and at other speeds the hum meets other orders."""
    target, orders = result.target, result.data.orders
    with_it = replace(target, data=replace(target.data, hums=(Hum(50.0, 2e-3, (40, 60), np.full(200, 4e-4)),)))
    alone, beside = (
        next(s for s in signatures(one, result.conclusions.final.residual, np.full(len(orders), 1e-6)))
        for one in (target, with_it)
    )
    assert beside.order == alone.order and beside.rms_deg == pytest.approx(np.hypot(alone.rms_deg, 4e-4))
    assert "(beside 0.0004 deg RMS of a wave of no order that was taken out" in beside.text
    humming = replace(result, data=with_it.data)
    assert humming.held_out_is_bound and not result.held_out_is_bound
    assert "at other speeds" in summary(humming)


def test_no_words_of_statisticians(page):
    for words in ("loss saved", "digits of chance", "passed"):
        assert words not in page


def test_what_is_not_claimed_is_not_called_claimed(result):
    claimed = {claim.piece.effect.name for claim in result.conclusions.claims}
    for candidate, evidence in result.judged:
        said = outcome(result, candidate, evidence)
        assert said.startswith("claimed") <= (candidate.name in claimed)
        assert said.startswith("refused") == (not evidence.passed)
    without = replace(result, conclusions=replace(result.conclusions, claims=(), retuned=()))
    assert all(not row[2].startswith("claimed") for row in ranking_section(without).table.rows)


@pytest.mark.thorough
def test_an_order_that_got_worse_is_shown_as_such(result, page):
    assert "worse than the old one" not in page
    worse = OrderGap(2, 1e-5, 3e-5, 1e-5, 3e-5)
    orders = tuple(worse if gap.order == 2 else gap for gap in result.orders)
    text = report_page(replace(result, orders=orders))
    assert "The new rig is worse than the old one at order 2." in text
    assert "<strong>worse</strong>" in text


def test_every_finding_has_its_picture(page):
    """Compliance over the torque, the resonance with its phase over Hz, the spectrum of sidebands, the rest."""
    for wanted in ("1: torsional compliance", "2: resonance of the structure", "2: resonance of the structure, phase",
                   "3: modulation of a mesh order", "order 3"):  # fmt: skip
        assert re.search(rf"<text [^>]*>{wanted}", page), wanted


@pytest.mark.parametrize("width", [1400, 400])
def test_in_a_browser_nothing_is_cut_and_no_labels_overlap(width, page, tmp_path):
    count, found = browser.faults(page, width, tmp_path)
    assert count > 100
    assert found == []


def test_many_unexplained_orders_are_counted_not_listed(result):
    one = result.unexplained[0]
    many = tuple(replace(one, order=order, rms_deg=1e-5 * order) for order in range(3, 15))
    text = summary(replace(result, unexplained=many))
    assert text.count("- unexplained: ") == 8
    together = 1e-5 * np.sqrt(11**2 + 12**2 + 13**2 + 14**2)
    assert f"- and 4 more unexplained orders from 11 to 14, together {together:.2g} deg RMS" in text
    for count in (8, 9):
        text = summary(replace(result, unexplained=many[:count]))
        assert text.count("- unexplained: ") == count and "more unexplained orders" not in text
