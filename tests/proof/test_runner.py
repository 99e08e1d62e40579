"""Rows through generated text: the code is optimised where the rows to come are worth it, with the same bits."""

from pathlib import Path

import numpy as np
import pytest

from st_codegen.proof import runner
from st_codegen.proof.runner import GeneratedCode

TEXT = Path(__file__).resolve().parents[2] / "golden" / "lone" / "generated" / "iec"


@pytest.mark.parametrize(("worth", "is_optimised"), [(0.0, True), (np.inf, False)])
def test_rows_behind_the_trial_run_as_its_seconds_say(monkeypatch, worth, is_optimised):
    code = GeneratedCode(TEXT, "iec")
    block = next(pou.name for pou in code.project.pous.values() if pou.name.startswith("FB_"))
    width = len(code._instance(block, 1).inputs)
    x = np.random.default_rng(0).normal(0.0, 1e3, (2 * runner._TRIAL + 1, width))
    monkeypatch.setattr(runner, "_WORTH", worth)
    levels = []
    instance = code._instance
    monkeypatch.setattr(code, "_instance", lambda *args: levels.append(instance(*args)) or levels[-1])
    found = code.run_model(block, x, 1)
    programs = [made._machine.program_code for made in levels]
    assert len(programs) == 2
    assert (programs[0] is not programs[1]) == is_optimised
    one_by_one = [code.run_model(block, x[at : at + 100], 1) for at in range(0, len(x), 100)]
    assert np.array_equal(found.values, np.vstack([part.values for part in one_by_one]), equal_nan=True)
    assert np.array_equal(found.valid, np.concatenate([part.valid for part in one_by_one]))
    assert len(found.valid) == len(x)


def test_a_block_that_many_rows_are_called_through_is_optimised_without_a_trial():
    code = GeneratedCode(TEXT, "iec")
    block = next(pou.name for pou in code.project.pous.values() if pou.name.startswith("FB_"))
    few, many = (code._instance(block, rows, calls)._machine.program_code for rows, calls in ((2000, 2), (2000, 11)))
    assert few is not many
    assert many is code._instance(block, 30_000)._machine.program_code
