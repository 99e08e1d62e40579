"""Blocks around models: an invariant of every call, and texts in which there is none."""

import shutil
from pathlib import Path

import pytest

from st_codegen.driver import generate
from st_codegen.emit.output import block_of
from st_codegen.emit.targets import TARGETS
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from st_codegen.proof.prove.blocks import prove_block
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st import parse_project
from tests.changes import change_once

GOLDEN = Path(__file__).resolve().parents[3] / "golden" / "bundle"


@pytest.fixture(scope="module")
def models():
    return load(GOLDEN / "models").models


def proof(folder, models, block="FB_Compensator"):
    members = {}
    for loaded in models:
        name, outputs = block_of(folder, loaded.ir)
        members.setdefault(name, []).append((loaded.ir, outputs))
    return prove_block(GeneratedCode(folder, TARGETS[folder.name].dialect).project, block, members)


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_the_compensator_keeps_its_limits_and_its_slew(target, models):
    found = proof(GOLDEN / "generated" / target, models)
    limits = {limit.output: (limit.lower, limit.upper) for limit in found.limits}
    assert limits["fCorrection_deg"] == limits["fTE_deg"] == (-360.0, 360.0)
    assert limits["fWeight"] == (0.0, 1.0)
    (slew,) = found.slews
    assert (slew.output, slew.step, slew.largest, slew.target) == ("fCorrection_deg", "fSlew * fCycle", 1e6, "fLimit")
    assert "no call stops the controller" in found.claims[0]


@pytest.mark.parametrize("target", ["iec", "twincat"])
def test_the_prediction_has_numbers_as_large_as_its_models(target, models):
    limits = {
        limit.output: limit.upper for limit in proof(GOLDEN / "generated" / target, models, "FB_TEPredict").limits
    }
    assert 0.01 < limits["aAmplitudeFw"] < 1.0
    assert limits["aPhaseFw"] < 3.93


@pytest.mark.parametrize(
    "how",
    [{"options": Options(Layout.TREES, outputs_per_cycle=1)}, {"with_age": True}, {}],
    ids=["spread", "age", "plain"],
)
def test_a_compensator_of_any_form_keeps_its_limits(bundle_folder, tmp_path, how):
    """Of models that are spread over calls "an integer overflows" was said, of nAge that it belonged to no model."""
    bundle = load(bundle_folder)
    found = proof(generate(bundle, "iec", tmp_path / "out", **how).folder, bundle.models)
    limits = {limit.output: (limit.lower, limit.upper) for limit in found.limits}
    assert limits["fCorrection_deg"] == (-360.0, 360.0)


FAILING = {
    "a division by zero": (r"IF ABS\(fCosine\) > 0.0 THEN", "IF TRUE THEN", "division"),
    "a comparison with NaN": (
        r"IF NOT F_IsWithin\(fValue := fHysteresis_rpm, fLower := 0.0, fUpper := 1000000.0\) THEN",
        "IF FALSE THEN",
        "NaN",
    ),
    "an overflow after many calls": (
        r"fFade := MIN\(fFade \+ fStep, 1.0\)",
        "fFade := fFade * 2.0 + 1.0",
        "no invariant",
    ),
    "a conversion that overflows": (
        r"fUpper := 1000000000.0\) THEN\n    eError",
        "fUpper := 1.0E18) THEN\n    eError",
        "overflow|TRUNC",
    ),
    "an index out of range": (r"FOR nOrder := 0 TO 2 DO", "FOR nOrder := 0 TO 3 DO", "index"),
}


@pytest.mark.parametrize("name", FAILING)
def test_what_may_stop_a_controller_is_named(name, models, tmp_path):
    pattern, change, reason = FAILING[name]
    folder = tmp_path / "iec"
    shutil.copytree(GOLDEN / "generated" / "iec", folder)
    change_once(folder / "golden.st", pattern, change)
    with pytest.raises(NotProvedError, match=reason):
        proof(folder, models)


@pytest.mark.parametrize(
    ("pattern", "change"),
    [
        (r"fCorrection_deg \+ fStep\)", "fCorrection_deg + 2.0 * fStep)"),
        (r"MAX\(fTarget, fCorrection_deg - fStep\)", "MAX(fTarget, fTarget - fStep)"),
    ],
)
def test_a_step_that_is_not_limited_is_not_claimed(pattern, change, models, tmp_path):
    folder = tmp_path / "iec"
    shutil.copytree(GOLDEN / "generated" / "iec", folder)
    change_once(folder / "golden.st", pattern, change)
    assert proof(folder, models).slews == ()


def test_a_limit_that_is_left_out_shows_in_the_claims(models, tmp_path):
    folder = tmp_path / "iec"
    shutil.copytree(GOLDEN / "generated" / "iec", folder)
    text = (folder / "golden.st").read_text()
    changed = text.replace("fTE_deg := MIN(MAX(fbSum.fSum_deg, -360.0), 360.0);", "fTE_deg := fbSum.fSum_deg;")
    assert changed != text
    (folder / "golden.st").write_text(changed)
    limits = {limit.output: limit.upper for limit in proof(folder, models).limits}
    assert limits["fTE_deg"] > 360.0


@pytest.mark.parametrize(("start", "limits"), [(8.0, (0.0, 4.0)), (-8.0, (-4.0, 0.0))])
def test_a_number_that_shrinks_call_by_call_does_not_pass_zero(start, limits):
    text = f"FUNCTION_BLOCK FB_T VAR_OUTPUT fY : LREAL := {start}; END_VAR\nfY := fY * 0.5;\nEND_FUNCTION_BLOCK\n"
    (limit,) = prove_block(parse_project({"t.st": text}, "iec"), "FB_T", {}).limits
    assert (limit.lower, limit.upper) == limits


def test_what_waits_for_a_counter_is_not_taken_wider_before_it_began():
    """Of models spread over ten calls the correction was said to stay within 10000 deg, not 360."""
    text = "FUNCTION_BLOCK FB_T VAR_OUTPUT fY : LREAL; END_VAR VAR n : DINT; END_VAR\nn := n + 1;\n"
    text += "IF n >= 9 THEN n := 0; fY := MIN(fY + 1.0, 3.0); END_IF;\nEND_FUNCTION_BLOCK\n"
    (limit,) = prove_block(parse_project({"t.st": text}, "iec"), "FB_T", {}).limits
    assert (limit.lower, limit.upper) == (0.0, 3.0)


def test_every_branch_of_a_case_is_followed():
    text = "FUNCTION_BLOCK FB_T VAR_INPUT n : DINT; END_VAR VAR_OUTPUT fY : LREAL; END_VAR\n"
    text += "CASE n OF 1: fY := 2.0; 2..3: fY := -1.0; ELSE fY := 0.5; END_CASE\nEND_FUNCTION_BLOCK\n"
    (limit,) = prove_block(parse_project({"t.st": text}, "iec"), "FB_T", {}).limits
    assert (limit.lower, limit.upper) == (-1.0, 2.0)
