"""Who sees which value when: the latency by running the tasks, against the sum and the paper's number."""

import math

import pytest

from st_codegen.errors import InputError, Problems
from st_codegen.files.toml_tables import TomlTable
from st_codegen.rig.tasks import Plc, TaskForm, TaskInputs, TaskSettings, read_tasks
from st_codegen.te.latency import TaskTiming, latency


class Echo:
    """Corrects by the angle it sees."""

    def __init__(self):
        self.calls = 0
        self.prepared = []

    def correct(self, inputs):
        self.calls += 1
        return inputs.theta_rad

    def prepare(self, inputs):
        self.prepared.append(inputs.theta_rad)


def ages(form, settings, ticks=60):
    """Ticks between the latching of an angle and the set-point that carries it, in each cycle after the start."""
    plc, echo = Plc(settings, form, Echo()), []
    for n in range(ticks):
        published = plc.tick(n, TaskInputs(float(n), 0.0, 0.0, 0.0), 0.0)
        if published is not None and n > 20:
            echo.append(n - published)
    return echo


def test_the_papers_timing():
    timing = TaskSettings().latency(TaskForm.TWO)
    bus, main, slow = TaskTiming("bus", 250.0), TaskTiming("main", 250.0), TaskTiming("slow", 500.0)
    assert timing == latency([bus, main, slow, main], output_us=75.3)
    assert timing.best_us == pytest.approx(1325.3)
    assert timing.frequency_hz == pytest.approx(754.5, abs=0.05)
    # highest order 240 of the paper: 188.6 rpm at the output
    assert timing.output_speed_rpm(240) == pytest.approx(188.6, abs=0.05)


def test_one_task_answers_in_less_than_half_the_time():
    timing = TaskSettings().latency(TaskForm.ONE)
    assert timing.best_us == timing.worst_us == pytest.approx(575.3)
    assert TaskSettings().latency(TaskForm.SPLIT) == timing
    assert timing.frequency_hz == pytest.approx(1738.2, abs=0.05)


@pytest.mark.parametrize("slow_us", [250.0, 500.0, 1000.0])
def test_the_simulated_exchange_has_the_stated_latency(slow_us):
    settings = TaskSettings(slow_us=slow_us)
    # whole slow cycles, so that the mean is one
    seen = [age * settings.main_us + settings.transfer_us for age in ages(TaskForm.TWO, settings, ticks=121)[-80:]]
    stated = settings.latency(TaskForm.TWO)
    assert (min(seen), max(seen)) == pytest.approx((stated.best_us, stated.worst_us))
    assert sum(seen) / len(seen) == pytest.approx(stated.mean_us)


@pytest.mark.parametrize("form", [TaskForm.ONE, TaskForm.SPLIT])
def test_the_main_task_carries_the_angle_of_two_cycles_ago(form):
    assert set(ages(form, TaskSettings())) == {2}


def test_the_slow_part_runs_in_the_slow_task():
    plc, echo = Plc(TaskSettings(), TaskForm.SPLIT, Echo()), None
    echo = plc.application
    for n in range(40):
        plc.tick(n, TaskInputs(float(n), 0.0, 0.0, 0.0), 0.0)
    assert echo.calls == 40
    assert len(echo.prepared) in (19, 20)
    two = Plc(TaskSettings(), TaskForm.TWO, Echo())
    for n in range(40):
        two.tick(n, TaskInputs(float(n), 0.0, 0.0, 0.0), 0.0)
    assert two.application.calls in (19, 20)


def test_without_a_compensator_the_reference_goes_out():
    plc = Plc(TaskSettings(), TaskForm.ONE, None)
    sent = [plc.tick(n, TaskInputs(0.0, 0.0, 0.0, 0.0), 10.0 * n) for n in range(4)]
    assert sent == [None, 0.0, 10.0, 20.0]


@pytest.mark.parametrize(
    ("table", "part"),
    [
        ({"slow_us": 600.0}, "multiple"),
        ({"transfer_us": 250.0}, "transfer_us"),
        ({"main_ms": 1.0}, "main_ms"),
        ({"main_us": math.nan}, "main_us"),
        ({"jitter_us": "much"}, "not a number"),
        ({"jitter_us": True}, "not a number"),
    ],
)
def test_faulty_tasks_are_refused(table, part):
    problems = Problems("rig.toml")
    read_tasks(TomlTable(table, "[tasks]", problems))
    with pytest.raises(InputError, match=rf"(?s)\[tasks\].*{part}"):
        problems.raise_if_any()
