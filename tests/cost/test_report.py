"""Budgets, profiles and calibration."""

import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.cli.costs import cost_table, price_table, times_text
from st_codegen.cli.pages import _worst_text
from st_codegen.cost.calibrate import Calibration, Measurement, calibrate, read_measurements, with_factors
from st_codegen.cost.operations import CostClass
from st_codegen.cost.profile import load_profile, profiles_folder
from st_codegen.cost.profile_files import profile_names
from st_codegen.cost.report import BlockCost, ProjectCost, UnitPart, project_cost
from st_codegen.errors import InputError, at_most
from st_codegen.proof.explain import EmittedCost, Price
from tests.cost.helpers import CONSTANTS, PROFILE, VARIABLES, block, cost, project
from tests.cost.test_counts import STATEMENTS

TWO = """FUNCTION_BLOCK FB_Inner VAR i : DINT; x : LREAL; END_VAR
FOR i := 1 TO 50 DO x := SQRT(x); END_FOR; END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_Outer VAR fb : FB_Inner; y : LREAL; END_VAR
fb(); y := y + 1.0; END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_Other VAR y : LREAL; END_VAR y := y / 2.0; END_FUNCTION_BLOCK
"""


def test_a_cycle_runs_what_nobody_calls_and_names_who_spends():
    whole = cost(TWO)
    assert whole.entries == ("FB_Outer", "FB_Other")
    outer = whole.blocks["FB_Outer"]
    assert [part.unit for part in outer.parts] == ["FB_Inner", "FB_Outer"]
    assert sum(part.cold_us for part in outer.parts) == pytest.approx(outer.cold_us)
    assert whole.cold_us == pytest.approx(outer.cold_us + whole.blocks["FB_Other"].cold_us)
    assert whole.fits(whole.cold_us)
    assert not whole.fits(0.99 * whole.cold_us)
    assert cost(TWO, entries=["fb_other"]).cold_us == whole.blocks["FB_Other"].cold_us
    # 50 rounds of load, root, store and loop, one more test and the start
    cycles = PROFILE.cycles
    rounds = 50 * (cycles[CostClass.LOAD] + cycles[CostClass.SQRT] + cycles[CostClass.STORE] + cycles[CostClass.LOOP])
    expected = rounds + cycles[CostClass.LOOP] + cycles[CostClass.STORE]
    assert whole.blocks["FB_Inner"].warm_us == pytest.approx(expected / PROFILE.machine["clock_MHz"])
    assert whole.as_json()["blocks"]["FB_Outer"]["parts"]["FB_Inner"]["operations"] == 50 * 4 + 2


def test_what_several_blocks_call_has_its_tables_and_code_once():
    shared = (
        "FUNCTION F_Sum : LREAL VAR CONSTANT A : ARRAY[0..9] OF LREAL := [10(1.0)]; END_VAR F_Sum := A[3]; END_FUNCTION"
    )
    callers = [f"FUNCTION_BLOCK FB_{n} VAR y : LREAL; END_VAR y := F_Sum(); END_FUNCTION_BLOCK" for n in (1, 2)]
    whole = cost("\n".join([shared, *callers]))
    (part,) = [part for part in whole.parts if part.unit == "F_Sum"]
    (one, other) = [part for block in whole.cycle for part in block.parts if part.unit == "F_Sum"]
    assert part.table_bytes == one.table_bytes == other.table_bytes == 80
    assert part.code_bytes == one.code_bytes
    assert part.total_operations == 2 * one.total_operations
    assert sum(part.cold_us for part in whole.parts) == pytest.approx(whole.cold_us)
    assert list(cost_table("all", whole.parts).columns[2].cells)[-1] == "80"


def test_where_there_are_programs_a_cycle_runs_them():
    whole = cost(TWO + "PROGRAM PRG_Main VAR fb : FB_Outer; END_VAR fb(); END_PROGRAM")
    assert whole.entries == ("PRG_Main",)
    assert whole.cold_us > whole.blocks["FB_Outer"].cold_us


def test_a_loop_without_a_bound_fits_no_budget():
    whole = cost(block("WHILE b DO x := y; END_WHILE;", VARIABLES))
    assert not whole.fits(1e9)
    assert whole.as_json()["bounded"] is False


@pytest.mark.parametrize("body", STATEMENTS, ids=range(len(STATEMENTS)))
def test_another_statement_never_makes_it_cheaper(body):
    """Before, behind, and inside of a branch and a loop that are there anyhow."""
    extra = "y := y + a[n];"
    frame = "IF c THEN {} END_IF; FOR m := 0 TO 2 DO {} END_FOR; {} {}"
    plain = cost(block(frame.format("", "", body, ""), VARIABLES + CONSTANTS))
    for position in range(4):
        parts = ["", "", "", ""]
        parts[2] = body
        parts[position] = f"{extra} {parts[position]}"
        more = cost(block(frame.format(*parts), VARIABLES + CONSTANTS))
        assert more.warm_us >= plain.warm_us
        assert more.cold_us >= plain.cold_us
        is_unreachable = position == 3 and "RETURN; x" in body
        assert is_unreachable or more.cold_us > plain.cold_us


def test_the_profile_says_where_its_numbers_are_from():
    assert "cx5140" in profile_names()
    assert set(PROFILE.cycles) == set(CostClass)
    assert all(PROFILE.sources.values())
    assert "memory_cycles" in PROFILE.estimates
    assert "add" not in PROFILE.estimates


def test_every_problem_of_a_profile_is_in_one_message(tmp_path):
    text = (profiles_folder() / "cx5140.toml").read_text(encoding="utf-8")
    text = text.replace('store = { value = 1.0, source = "slm" }', "store = 1.0")
    text = text.replace('load = { value = 3.0, source = "slm" }', "")
    text = text.replace("compute = 1.0", "compute = -1.0")
    text = text.replace('add = { value = 3.0, source = "', 'add = { value = 3.0, source = "" } # "', 1)
    text = re.sub(r"clock_MHz = .*", 'clock_MHz = { value = 0.0, source = "x" }', text)
    path = tmp_path / "mine.toml"
    path.write_text(text + '\nflop = { value = 1.0, source = "x" }\n[other]\n', encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_profile(path)
    message = str(caught.value)
    for part in (
        "7 problems",
        "[cycles.add]: source is empty",
        "[cycles]: store = 1.0; write { value",
        "'load' is missing",
        "compute = -1.0 is outside",
        "[machine.clock_MHz]: value = 0.0 is outside",
        "[cycles]: unknown key 'flop'",
        "unknown table [other]",
    ):
        assert part in message
    with pytest.raises(InputError, match="no profile 'none': use one of cx5140"):
        load_profile("none")
    path.write_text("[profile", encoding="utf-8")
    with pytest.raises(InputError, match="not readable as TOML"):
        load_profile(path)


def test_calibration_finds_the_factors_that_made_the_times(tmp_path):
    checked = project(TWO)
    text = with_factors(PROFILE, Calibration(0.6, 1.7, (), True), "true")
    (tmp_path / "true.toml").write_text(text, encoding="utf-8")
    true = load_profile(tmp_path / "true.toml")
    assert true.name == "true"
    made = project_cost(checked, true)
    measurements = tuple(
        Measurement(name, is_cold, made.blocks[name].cold_us if is_cold else made.blocks[name].warm_us)
        for name in ("FB_Outer", "FB_Other")
        for is_cold in (False, True)
    )
    fit = calibrate(checked, PROFILE, measurements)
    assert (fit.compute, fit.memory) == pytest.approx((0.6, 1.7), rel=1e-4)
    assert fit.modelled == pytest.approx([measured.microseconds for measured in measurements], rel=1e-4)
    # warm times alone say nothing of memory
    fit = calibrate(checked, PROFILE, measurements[:1])
    assert not fit.is_memory_known
    assert (fit.compute, fit.memory) == pytest.approx((0.6, 1.0), rel=1e-4)


def test_a_time_below_the_wait_for_memory_scales_both_alike():
    checked = project(TWO)
    modelled = project_cost(checked, PROFILE).blocks["FB_Other"].cold_us
    fit = calibrate(checked, PROFILE, (Measurement("FB_Other", True, 1e-3 * modelled),))
    assert not fit.is_memory_known
    assert (fit.compute, fit.memory) == pytest.approx((1e-3, 1e-3))
    assert fit.modelled == pytest.approx((1e-3 * modelled,))


def test_noisy_times_give_the_least_squares_factors():
    checked = project(TWO)
    random = np.random.default_rng(0)
    made = project_cost(checked, PROFILE)
    times = [
        (name, cold, getattr(block, f"{'cold' if cold else 'warm'}_us"))
        for name, block in made.blocks.items()
        for cold in (0, 1)
    ]
    noisy = tuple(Measurement(name, bool(cold), us * random.uniform(0.9, 1.1)) for name, cold, us in times)
    fit = calibrate(checked, PROFILE, noisy)
    assert 0.85 < fit.compute < 1.15
    assert 0.85 < fit.memory < 1.15
    assert fit.modelled == pytest.approx([measured.microseconds for measured in noisy], rel=0.25)


def test_a_budget_is_not_said_to_be_kept_by_a_profile_that_was_measured_to_be_too_quick(tmp_path):
    """`calibrate` told to divide a budget by 1.5; `verify` said that a cycle fits into all of it."""
    checked = project(TWO)
    made = project_cost(checked, PROFILE).blocks["FB_Other"]
    times = [(False, 2.0 * made.warm_us), (False, 3.0 * made.warm_us), (True, 4.0 * made.cold_us)]
    fit = calibrate(checked, PROFILE, tuple(Measurement("FB_Other", cold, us) for cold, us in times))
    assert fit.is_memory_known and fit.longest > 1.1
    path = tmp_path / "quick.toml"
    path.write_text(with_factors(PROFILE, fit, "quick"), encoding="utf-8")
    quick = load_profile(path)
    assert quick.longest == float(at_most(fit.longest, 4))
    assert quick.judged(fits=True) == "fits by estimate"
    assert f"are up to {quick.longest:g} times as long; divide a budget by that" in quick.remark
    path.write_text(with_factors(quick, replace(fit, longest=1.0), "right"), encoding="utf-8")
    assert (load_profile(path).judged(fits=True), load_profile(path).remark) == ("fits", "")
    path.write_text(with_factors(quick, replace(fit, longest=4e6), "of a slip"), encoding="utf-8")
    assert load_profile(path).longest == 4e6  # was written and not read, though it is less than two times may differ by


def test_measured_times_are_read_with_all_their_problems(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("block,caches,us\nFB_A,warm,1.5\nFB_B,cold,2\n")
    assert read_measurements(path) == (Measurement("FB_A", False, 1.5), Measurement("FB_B", True, 2.0))
    path.write_text("block,caches,us\nFB_A,hot,1.5\nFB_B,cold,-2\nFB_B,cold,\n")
    with pytest.raises(InputError, match=r"(?s)3 problems.*line 2: caches.*line 3: us.*line 4"):
        read_measurements(path)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="needs block,caches,us"):
        read_measurements(path)
    with pytest.raises(InputError, match="no such file"):
        read_measurements(tmp_path / "none.csv")
    with pytest.raises(InputError, match=r"no block 'FB_None'"):
        calibrate(project(TWO), PROFILE, (Measurement("FB_None", False, 1.0),))
    path.write_text("block,caches,us\n")
    with pytest.raises(InputError, match="no rows; give one for each measured call"):
        read_measurements(path)
    with pytest.raises(InputError, match=r"block 'FB_T' has no known worst case: .*no bound known"):
        calibrate(
            project(block("WHILE x < 1.0 DO x := x * 2.0; END_WHILE;", VARIABLES)),
            PROFILE,
            (Measurement("FB_T", False, 1.0),),
        )


def test_parts_of_less_than_a_five_hundredth_are_added_up_in_one_row():
    times = {"FB_A": 995.0, "FB_B": 2.5, "FB_C": 1.5, "FB_D": 1.0}
    parts = tuple(UnitPart(name, {}, 1, 1, 0, 0, cold, cold) for name, cold in times.items())
    table = cost_table("all", parts)
    assert list(table.columns[0].cells) == ["FB_A", "FB_B", "2 others", "sum"]
    assert list(table.columns[-1].cells) == ["99.5%", "0.2%", "0.2%", "100.0%"]


def test_a_worst_case_is_rounded_up_wherever_it_is_told():
    """A page said 7.6 us on top and 7.7 us below, of 7.64; so did the sum of a table and the line below it."""
    part = UnitPart("FB_A", {}, 1, 1, 0, 0, 0.04, 7.64)
    told = ProjectCost(PROFILE, {"FB_A": BlockCost("FB_A", (part,), ())}, ("FB_A",))
    assert "7.7 us with cold ones" in times_text(told)
    assert _worst_text(told) == "7.7 us in the worst case"
    assert list(cost_table("all", told.parts).columns[-2].cells) == ["7.7", "7.7"]
    alone = Price("a", "trees", True, EmittedCost(1, 1, 0, warm_us=1.0, cold_us=7.641))
    assert list(price_table("iec", "p", [alone]).columns[-1].cells) == ["7.65"]


def test_a_profile_is_written_whatever_its_name_is(tmp_path):
    for stem in ('a"b', r"a\1", "größe", "a'b"):
        path = tmp_path / f"{stem}.toml"
        path.write_text(with_factors(PROFILE, Calibration(2.0, 0.5, (), True), stem), encoding="utf-8")
        assert (load_profile(path).name, load_profile(path).compute_factor) == (stem, 2.0)


def test_a_profile_without_factors_takes_the_model_s_times(tmp_path):
    path = tmp_path / "p.toml"
    text = (
        PROFILE.text.replace("[factors]", "")
        .replace("compute = 1.0\nmemory = 1.0\n", "")
        .replace("longest = 1.0\n", "")
    )
    path.write_text(text, encoding="utf-8")
    assert (load_profile(path).compute_factor, load_profile(path).memory_factor) == (1.0, 1.0)


@pytest.mark.parametrize(("us", "message"), [("1e-300", "is not in 0.001"), ("1e300", "is not in 0.001")])
def test_times_that_no_call_has_are_refused(tmp_path, us, message):
    (tmp_path / "t.csv").write_text(f"block,caches,us\nFB_A,warm,{us}\n")
    with pytest.raises(InputError, match=message):
        read_measurements(tmp_path / "t.csv")


def test_factors_that_no_profile_takes_are_refused():
    checked = project(TWO)
    with pytest.raises(InputError, match="times those of the model; a profile takes"):
        calibrate(checked, PROFILE, (Measurement(next(iter(project_cost(checked, PROFILE).blocks)), False, 1e9),))


def test_what_a_calibration_does_not_know_is_said():
    times = tuple(Measurement("FB_A", cold, us) for cold, us in ((False, 1.0), (True, 9.0)))
    assert Calibration(1.0, 1.0, (2.0, 9.0), True).remarks(times) == []
    (unit,) = Calibration(965.0, 1050.0, (2.0, 9.0), True).remarks(times)
    assert "the times are 965 times those of the profile: are they in us" in unit
    (alike,) = Calibration(0.5, 0.5, (2.0, 9.0), False).remarks(times)
    assert "one factor for both" in alike
    alone, longer = Calibration(0.5, 1.0, (0.8, 9.0), False, 1.25).remarks(times)
    assert "memory keeps the factor 1" in alone
    assert longer.startswith("longer than the model gives: 1 of 2 measured times, by up to 25 %: ")
    assert longer.endswith("divide a budget by 1.25 at least")
