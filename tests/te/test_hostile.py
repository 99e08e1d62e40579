"""A small number of hostile sequences, the long run being `make soak`; and that the checks notice what they should."""

import numpy as np
import pytest

from st_codegen.st import StRuntimeError
from tests.te import hostile
from tests.te.hostile import KINDS, run_compensator, run_year
from tests.te.projects import PLAY


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["twincat", "iec"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_input_whatever_breaks_a_limit(kind, target):
    assert KINDS[kind](target, 300, 7) >= 300 * 60


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_nothing_drifts_in_a_year(target):
    assert run_year(target, 20, 3, 400) == 8000


def test_every_input_of_a_block_is_among_those_that_are_tried():
    for block in ("FB_Compensator", "FB_CompensatorFast"):
        assert {"fFullSpeed_rpm", "fSlewLimit_deg_s", "fCycle_s"} <= hostile.parameters_of(block).keys()
        assert hostile.declared(block)["fThetaOut_rad"] is None
    assert hostile.declared("FB_CompensatorFast")["fAgeLimit_s"] == hostile.Parameter(0.0, 10.0, 0.02)
    block = hostile.Machine(hostile.loaded_with("iec", hostile.pair("iec")), rows=1).instance("FB_Pair")
    with pytest.raises(AssertionError, match="fLead_s"):
        hostile.all_inputs(block, {port.name: 0 for port in block.inputs if port.name != "fLead_s"})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ("MIN(MAX(fTarget, fCorrection_deg - fStep), fCorrection_deg + fStep)", "fTarget"),
        ("MIN(MAX(fTarget, -fLimit), fLimit)", "fTarget * 1.1"),
        ("MIN(MAX(fTarget, MIN(fCorrection_deg, 0.0)), MAX(fCorrection_deg, 0.0))", "fTarget"),
        ("F_IsWithin(fValue := fThetaOut_rad, fLower := -1000000000.0, fUpper := 1000000000.0)", "TRUE"),
        ("bFading := TRUE", "bFading := FALSE"),
        ("fFade := MAX(fFade - fStep, 0.0)", "fFade := MAX(fFade - fStep, 0.01)"),
        ("fStep := fCycle / MAX(fRamp, fCycle);", "fStep := 4.0 * fCycle / MAX(fRamp, fCycle);"),
        ("fAge_s > fAgeLimit", "FALSE"),
        ("bSound := bSound AND", "bSound := TRUE OR"),
        ("MAX(ABS(fTorque_Nm), LEAST_TORQUE)", "ABS(fTorque_Nm)"),
        ("F_IsWithin(fValue := fSignedLoad, fLower := -1000000000.0, fUpper := 1000000000.0)", "TRUE"),
    ],
)
def test_the_checks_notice_a_mutation(good, bad, monkeypatch):
    from tests.te import projects

    original = projects.texts

    def mutated(ir, target):
        texts = original(ir, target)
        assert any(good in text for text in texts.values())
        return {path: text.replace(good, bad) for path, text in texts.items()}

    monkeypatch.setattr(projects, "texts", mutated)
    monkeypatch.setattr(hostile, "loaded_with", projects.loaded_with.__wrapped__)
    with pytest.raises((AssertionError, StRuntimeError)):
        run_compensator("iec", 300, 7, two_tasks="fAge" in good or "bSound" in good, play=PLAY)


def test_hostile_values_hold_what_the_description_says():
    values = hostile.hostile(np.random.default_rng(0), 20_000)
    tiny = (np.abs(values) < 2.2e-308) & (values != 0)
    zero = (values == 0) & np.signbit(values)
    for kind in (np.isnan(values), values == np.inf, values == -np.inf, tiny, zero, np.abs(values) > 1e200):
        assert kind.sum() > 100
