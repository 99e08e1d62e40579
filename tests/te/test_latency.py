"""Delays through tasks: the paper's, and cases small enough to count by hand."""

import json
import re

import pytest

from st_codegen.cli.main import main
from st_codegen.errors import InputError
from st_codegen.rig.tasks import TaskSettings
from st_codegen.te.latency import Exchange, TaskTiming, latency

BUS, FAST, SLOW = TaskTiming("bus", 250.0), TaskTiming("fast", 250.0), TaskTiming("slow", 500.0)


def test_the_papers_delay_and_frequency():
    found = latency([BUS, FAST, SLOW, FAST], output_us=75.3)
    assert found.best_us == pytest.approx(1325.3)
    assert round(found.frequency_hz, 1) == 754.5
    assert round(found.output_speed_rpm(240), 1) == 188.6
    # each correction is used in two fast cycles
    assert found.worst_us == pytest.approx(1575.3)
    assert found.mean_us == pytest.approx(1450.3)


def test_one_task_hands_over_at_its_next_start():
    assert latency([FAST]).worst_us == 250.0
    assert latency([FAST], output_us=75.3).worst_us == pytest.approx(325.3)
    assert latency([BUS, FAST], output_us=75.3).worst_us == pytest.approx(575.3)
    assert latency([SLOW]).best_us == latency([SLOW]).worst_us == 500.0


def test_handing_over_at_the_end_saves_the_rest_of_each_cycle():
    fast, slow = TaskTiming("fast", 250.0, run_us=40.0), TaskTiming("slow", 500.0, 100.0, 120.0)
    found = latency([fast, slow, fast], exchange=Exchange.AT_END)
    # read at 0: handed over at 40, read by slow at 100, ready at 220, read by fast at 250, ready at 290;
    # fast uses it again at 500, ready at 540
    assert (found.best_us, found.worst_us, found.mean_us) == (290.0, 540.0, 415.0)


def test_values_that_are_overwritten_do_not_count():
    # of those read at 0, 250, .. the slow task gets every second one: handed over by fast at 500, read by slow at 500
    assert latency([FAST, SLOW]).worst_us == latency([FAST, SLOW]).best_us == 750.0
    # a first task that is slower than the second is read twice
    assert (latency([SLOW, FAST]).best_us, latency([SLOW, FAST]).worst_us) == (750.0, 1000.0)


def test_an_offset_of_the_slow_task_changes_who_waits():
    aligned = latency([TaskTiming("fast", 500.0), TaskTiming("slow", 500.0, 100.0), TaskTiming("fast", 500.0)])
    # 0 -> 500, 600 -> 1100, 1500 -> 2000
    assert aligned.best_us == aligned.worst_us == 2000.0
    # 0 -> 250, 350 -> 850, 1000 -> 1250, and again at 1500
    late = latency([FAST, TaskTiming("slow", 500.0, 350.0), FAST])
    assert (late.best_us, late.worst_us) == (1250.0, 1500.0)


def test_new_values_of_cycles_that_are_no_multiples_have_different_ages(capsys):
    options = "--fast 250 --slow 600 --output 75.3 --exchange end --fast-run 30 --slow-run 200"
    assert run(*options.split()) == 0
    # slow starts at 0, 600, .. 2400, is ready 200 later, and what it reads was latched before 0, 500, 1000, 1750, 2250;
    # fast takes it at 250, 1000, 1500, 2000, 2750 and hands over 30 later: four times 750 + 30 us after latching
    # (-500, 250, 750, 2000), and once 500 + 30 (1500)
    printed = capsys.readouterr().out
    assert "delay: 605.3 to 855.3 us of a new value, 980.3 us in the mean, 1355.3 us at most" in printed
    assert "1169.1 Hz" in printed  # 1169.18, rounded down


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TaskTiming("a", 0.0), "cycle time"),
        (lambda: TaskTiming("a", 0.09), "cycle time"),
        (lambda: TaskTiming("a", float("nan")), "cycle time"),
        (lambda: TaskTiming("a", 1e308), r"give 0\.1 \.\. 10000000"),
        (lambda: TaskTiming("a", 100.0, 1e308), "offset"),
        (lambda: TaskTiming("a", 100.0, 0.0, 1e308), "run time"),
        (lambda: TaskTiming("a", 100.0, 100.0), "offset"),
        (lambda: TaskTiming("a", 100.0, 0.0, 101.0), "run time"),
        (lambda: latency([]), "no task"),
        (lambda: latency([FAST], output_us=-1.0), "output time"),
        (lambda: latency([TaskTiming("a", 99999.9), TaskTiming("b", 77777.3)]), "common period"),
        (lambda: latency([TaskTiming("a", 9999.0), TaskTiming("b", 9998.0)]), "multiples of each other"),
        (lambda: latency([FAST]).output_speed_rpm(0), "order 0"),
    ],
)
def test_times_that_make_no_sense_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_the_ends_of_what_makes_a_task_are_part_of_it():
    assert latency([TaskTiming("a", 0.1, 0.0, 0.1)]).worst_us == 0.1


def run(*arguments):
    with pytest.raises(SystemExit) as exit_:
        main(["latency", *arguments])
    return exit_.value.code


def test_the_command_prints_the_papers_numbers(capsys):
    assert run("--fast", "250", "--slow", "500", "--output", "75.3") == 0
    printed = capsys.readouterr().out
    assert "1325.3 us of a new value" in printed
    assert "754.5 Hz" in printed
    assert "188.6 rpm" in printed
    assert "fLead_s := 0.0014503" in printed


def test_what_is_said_to_be_the_most_is_not_less(capsys):
    """575.34 us were "575.3 us at most", and 1738.1 Hz the limit of a slower correction."""
    assert run("--fast", "250", "--output", "75.34") == 0
    assert "575.34 us at most" in capsys.readouterr().out
    assert run("--fast", "300", "--bus", "0", "--output", "11.53", "--order", "7") == 0
    said = capsys.readouterr().out
    hertz, rpm = (float(re.search(rf"([\d.]+) {unit}", said)[1]) for unit in ("Hz", "rpm"))
    assert 0 <= 1e6 / 311.53 - hertz < 0.1 and 0 <= 60e6 / 311.53 / 7 - rpm < 0.1


def test_a_lead_that_the_compensator_refuses_is_not_advised(capsys):
    assert run("--fast", "60000") == 0
    assert "fLead_s := 0.1200000, which it refuses: it takes 0.1 at most" in capsys.readouterr().out
    assert run("--fast", "50000") == 0
    assert capsys.readouterr().out.endswith("fLead_s := 0.1000000\n")


def test_the_command_prints_json(capsys):
    assert run("--fast", "250", "--bus", "0", "--json", "--order", "40") == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers == {
        "best_us": 250.0,
        "slowest_us": 250.0,
        "mean_us": 250.0,
        "worst_us": 250.0,
        "frequency_hz": 4000.0,
        "order": 40,
        "output_speed_rpm": 6000.0,
        "lead_s": 0.00025,
    }


def test_times_that_make_no_sense_end_the_command_with_a_message(capsys):
    assert run("--fast", "0") == 2
    assert "'--fast': 0.0 is not in the range" in capsys.readouterr().err
    assert run("--fast", "250", "--slow", "500", "--slow-offset", "600") == 2


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--bus", "0", "--exchange", "end"], "nothing takes any time"),
        (["--slow", "333.333"], "task slow: 333.333 us; give whole multiples of 0.1 us"),
        (["--slow", "500", "--slow-offset", "499.96"], "task slow: 499.96 us; give whole multiples of 0.1 us"),
        (["--output", "1e308"], "give 0 .. 10000000 (10 s)"),
        (["--slow-offset", "100"], "give --slow"),
        (["--slow", "125"], "--slow 125 is less than --fast 250"),
        (["--slow", "500", "--slow-run", "100"], "give --exchange end"),
    ],
)
def test_times_that_would_be_rounded_or_passed_over_are_refused(options, text, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["latency", "--fast", "250", *options])
    assert caught.value.code == 2
    assert text in capsys.readouterr().err.replace("\n", " ")


def test_the_tasks_of_a_rig_are_whole_multiples_of_a_tick():
    with pytest.raises(InputError, match=r"task bus: 250\.04 us; give whole multiples of 0\.1 us"):
        TaskSettings(main_us=250.04, slow_us=500.08)
    assert TaskSettings(main_us=0.3 * 100, slow_us=0.1 * 600, transfer_us=0.0).ratio == 2
