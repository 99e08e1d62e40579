"""Features whose inputs have the name of a variable of the block: they get another one, and are proved by it."""

import re
from dataclasses import replace

import pytest

from st_codegen.driver import generate
from st_codegen.errors import InputError
from st_codegen.ir import Feature
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.prove.prove import Verdict, prove
from tests.proof.prove.test_prove import GOLDEN


def renamed(*names):
    (model,) = load(GOLDEN / "lone" / "models" / "ridge.skops").models
    return Bundle((replace(model, ir=replace(model.ir, features=tuple(map(Feature, names)))),))


def test_an_input_that_was_renamed_is_proved_and_no_other_is_taken_for_it(tmp_path):
    bundle = renamed("sum", "column", "b")
    generate(bundle, "iec", tmp_path)
    (text,) = (tmp_path / "iec").glob("FB_Ridge.st")
    assert "fInput_Sum : LREAL" in text.read_text()
    assert [result.verdict for result in prove(bundle, tmp_path).results] == [Verdict.PROVED]
    text.write_text(text.read_text().replace("fInput_Sum", "fOther"))
    (result,) = prove(bundle, tmp_path).results
    assert "fOther : LREAL stands where the model has fInput_Sum" in result.reason


def test_two_features_that_would_be_one_input_are_refused(tmp_path):
    with pytest.raises(InputError, match="two inputs would be called fInput_Sum"):
        generate(renamed("sum", "Input_sum", "b"), "iec", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_bundle_whose_blocks_cannot_be_called_by_the_name_of_a_feature_is_refused(tmp_path):
    models = tmp_path / "models"
    models.mkdir()
    for file in (GOLDEN / "bundle" / "models").iterdir():
        (models / file.name).write_bytes(file.read_bytes())
    text = (models / "bundle.toml").read_text(encoding="utf-8")
    (models / "bundle.toml").write_text(re.sub('"torque_Nm"', '"Sum"', text), encoding="utf-8")
    with pytest.raises(InputError, match=r"feature 'Sum': FB_A0_\w+ has a variable fSum of its own: rename"):
        generate(load(models), "iec", tmp_path / "out")
