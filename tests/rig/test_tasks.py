"""Who sees which value when: the latency by running the tasks, against the sum and the paper's number."""

import math

import pytest

from st_codegen.errors import InputError, Problems
from st_codegen.rig.tasks import Form, Inputs, Plc, TaskSettings, read_tasks


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
        published = plc.tick(n, Inputs(float(n), 0.0, 0.0, 0.0), 0.0)
        if published is not None and n > 20:
            echo.append(n - published)
    return echo


def test_the_papers_timing():
    settings = TaskSettings()
    assert settings.latency_us(Form.TWO) == pytest.approx(1325.3)
    assert settings.limit_hz(Form.TWO) == pytest.approx(754.5, abs=0.05)
    # highest order 240 of the paper: 188.6 rpm at the output
    assert settings.limit_hz(Form.TWO) / 240 * 60 == pytest.approx(188.6, abs=0.05)


def test_one_task_answers_in_less_than_half_the_time():
    settings = TaskSettings()
    assert settings.latency_us(Form.ONE) == pytest.approx(575.3)
    assert settings.latency_us(Form.SPLIT) == settings.latency_us(Form.ONE)
    assert settings.limit_hz(Form.ONE) == pytest.approx(1738.2, abs=0.05)


@pytest.mark.parametrize("slow_us", [250.0, 500.0, 1000.0])
def test_the_simulated_exchange_has_the_stated_latency(slow_us):
    settings = TaskSettings(slow_us=slow_us)
    seen = ages(Form.TWO, settings)
    assert min(seen) == settings.cycles(Form.TWO)
    # held for a slow cycle: the last main cycle of it carries the oldest value
    assert max(seen) == settings.cycles(Form.TWO) + settings.ratio - 1
    mean = sum(seen) / len(seen) * settings.main_us + settings.transfer_us
    assert mean == pytest.approx(settings.latency_us(Form.TWO) + settings.hold_us(Form.TWO), rel=0.02)


@pytest.mark.parametrize("form", [Form.ONE, Form.SPLIT])
def test_the_main_task_carries_the_angle_of_two_cycles_ago(form):
    assert set(ages(form, TaskSettings())) == {2}


def test_the_slow_part_runs_in_the_slow_task():
    plc, echo = Plc(TaskSettings(), Form.SPLIT, Echo()), None
    echo = plc.application
    for n in range(40):
        plc.tick(n, Inputs(float(n), 0.0, 0.0, 0.0), 0.0)
    assert echo.calls == 40
    assert len(echo.prepared) in (19, 20)
    two = Plc(TaskSettings(), Form.TWO, Echo())
    for n in range(40):
        two.tick(n, Inputs(float(n), 0.0, 0.0, 0.0), 0.0)
    assert two.application.calls in (19, 20)


def test_without_a_compensator_the_reference_goes_out():
    plc = Plc(TaskSettings(), Form.ONE, None)
    sent = [plc.tick(n, Inputs(0.0, 0.0, 0.0, 0.0), 10.0 * n) for n in range(4)]
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
    read_tasks(table, problems)
    with pytest.raises(InputError, match=part):
        problems.raise_if_any()
