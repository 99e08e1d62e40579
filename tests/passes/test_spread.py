"""Models spread over several calls: the same answer after a whole round, and never half a set."""

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from st_codegen.st import Machine


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
