"""What commands say of results that no sound text gives."""

import pytest

from st_codegen.cli.compare import _calibrate
from st_codegen.cli.prove import sentence
from st_codegen.cli.verify import _codes
from st_codegen.live.live_report import BlockTimes, LiveReport
from st_codegen.proof.prove.counterexample import Counterexample
from st_codegen.proof.prove.prove import ProofResult, Verdict
from st_codegen.proof.verify_report import Disagreement, ModelReport, VerifyReport

OFF = Disagreement("library and iec", (0.5,), (1.0,), (2.0,), 0.0)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (None, ""),
        (Counterexample((0.5,), None, None, stops="divides by zero"), "\n  at [0.5] divides by zero"),
        (
            Counterexample((0.5,), None, (2.0,)),
            "\n  at [0.5]: the model demands no answer, the executed text gives [2.0]",
        ),
        (
            Counterexample((0.5,), (1.0,), None, by_expression=True, allowed=(0.25,)),
            "\n  at [0.5]: the model's expression is [1.0], the executed text gives bValid = FALSE"
            "\n  so far the library, which leaves its last digits open, may lie from it: [0.25]",
        ),
    ],
)
def test_a_refuted_text_is_said_with_its_input(found, said):
    result = ProofResult("te", "iec", "FB_Te", Verdict.REFUTED, "it differs", counterexample=found)
    assert sentence(result) == f"te, iec: refuted: it differs{said}"


@pytest.mark.parametrize(
    ("model", "code"),
    [
        ({"failures": [OFF]}, "STC2001"),
        ({"refusal": "it has no answer"}, "STC1206"),
        ({"nothing_compared": True}, "STC2004"),
    ],
)
def test_each_way_to_fail_a_verification_has_its_code(model, code):
    report = VerifyReport((ModelReport("sound"), ModelReport("te", **model)))
    assert list(_codes(report)) == [code]
    assert not report.passed and repr(report) == "VerifyReport(2 models, failed: te)"


@pytest.mark.parametrize(
    ("models", "reason"),
    [
        ([ModelReport("te", refusal="it has no answer")], "the times may be those of another text"),
        ([], "all calls were quicker than the controller's clock"),
    ],
)
def test_no_profile_of_times_that_say_nothing(models, reason, tmp_path, capsys):
    report = LiveReport("ads", "RUN", "0", "out", models, times={"FB_Te": BlockTimes(10, 0.0, 0.0)})
    _calibrate(report, tmp_path, None, tmp_path / "mine.toml", quiet=False)
    assert f"mine.toml is not written: {reason}" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "mine.toml").exists()
