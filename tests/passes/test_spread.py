"""Models spread over several calls: the same answer after a whole round, and never half a set."""

from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from st_codegen.st import Machine
from st_codegen.te import purpose


@pytest.fixture(params=["twincat", "iec"])
def spread(request, bundle_folder, tmp_path):
    """Two models, one in each call."""
    bundle = load(bundle_folder)
    made = generate(bundle, request.param, tmp_path, options=Options(Layout.TREES, outputs_per_cycle=1))
    assert made.facts["transmission_error"]["calls"] == 2
    return bundle, GeneratedCode(made.folder, request.param)


def test_verification_waits_for_the_round(spread):
    bundle, code = spread
    report = verify(bundle, code.folder, rows=300)
    assert report.passed, [model.failures for model in report.models]


def test_outputs_change_only_when_a_round_is_complete(spread):
    _, code = spread
    block = Machine(code.project, rows=1).instance("FB_TEPredict")
    alone = code.call("FB_TEPredict", {"fSpeed_rpm": 500.0, "fTorque_Nm": 300.0, "fTemperature_C": 30.0}, 1, calls=2)

    def call(speed):
        for name, value in (("fSpeed_rpm", speed), ("fTorque_Nm", 300.0), ("fTemperature_C", 30.0)):
            block[name] = np.array([value])
        block()
        return bool(block["bValid"][0]), np.array(block["aAmplitudeFw"]).ravel()

    assert call(500.0)[0] is False
    # the second call belongs to the operating point of the first
    valid, first = call(1700.0)
    assert valid
    assert np.array_equal(first, np.ravel(alone["aAmplitudeFw"]))
    valid, held = call(1700.0)
    assert valid
    assert np.array_equal(held, first)
    valid, second = call(500.0)
    assert valid
    assert not np.array_equal(second, first)
    # a bad operating point is told at once, and the round starts anew
    assert call(np.nan)[0] is False
    assert call(500.0)[0] is False
    valid, again = call(500.0)
    assert valid
    assert np.array_equal(again, first)


def test_the_header_states_the_delay(spread):
    _, code = spread
    assert "spread over 2 calls" in code.text("FB_TEPredict")


def test_a_bundle_that_fits_into_a_call_is_not_spread(bundle_folder, tmp_path):
    made = generate(load(bundle_folder), "iec", tmp_path, options=Options(outputs_per_cycle=50))
    assert "calls" not in made.facts["transmission_error"]
    assert made.purpose.te.cycles == ()


def shared_out(monkeypatch, costs, mean):
    """The calls that models with one output each and such costs are shared out among."""
    models = [SimpleNamespace(name=name, outputs=("y",)) for name in costs]
    te = SimpleNamespace(outputs=[SimpleNamespace(model=name) for name in costs])
    monkeypatch.setattr(purpose, "simple_cost", lambda model: SimpleNamespace(nanoseconds=costs[model.name]))
    return purpose._cycles(te, models, mean)


COSTS = {"a": 1e4, "b": 9e4, "c": 4e4, "d": 5e4, "e": 3e4, "f": 100.0}


def test_the_costliest_call_is_as_cheap_as_its_costliest_model(monkeypatch):
    calls = shared_out(monkeypatch, COSTS, 2)
    assert sorted(name for call in calls for name in call) == sorted(COSTS)
    spent = [sum(COSTS[name] for name in call) for call in calls]
    assert len(spent) == 3  # 6 outputs, 2 in the mean
    assert max(spent) == COSTS["b"]
    assert spent[-1] == min(spent)  # the last call makes harmonics of all answers


def test_the_cheapest_model_goes_where_least_is_to_do(monkeypatch):
    calls = shared_out(monkeypatch, {"a": 4e4, "b": 2.8e4, "c": 2e4, "d": 1e4}, 2)
    assert sorted(calls) == [("a", "d"), ("b", "c")]  # 50 and 48 us, where b, c and d were 58


def test_a_model_that_costs_a_little_more_stays_where_it_is(monkeypatch):
    more = COSTS | {"c": 4.3e4, "d": 4.8e4}
    assert shared_out(monkeypatch, more, 2) == shared_out(monkeypatch, COSTS, 2)


def test_no_call_is_empty(monkeypatch):
    assert sorted(shared_out(monkeypatch, {"a": 5.0, "b": 1e6}, 1)) == [("a",), ("b",)]
    assert shared_out(monkeypatch, {"a": 5.0}, 1) == ()
