"""Generated text is read back before it is handed out."""

from pathlib import Path

import pytest

from st_codegen import driver
from st_codegen.errors import DefectError
from st_codegen.proof.emitted import check_emitted

MODEL = Path(__file__).resolve().parents[2] / "golden" / "lone" / "models" / "lightgbm_gbdt.txt"
GOOD = """FUNCTION_BLOCK FB_A
VAR_OUTPUT x : LREAL; END_VAR
x := {};
END_FUNCTION_BLOCK
"""
LOOP = """FUNCTION_BLOCK FB_A
VAR_OUTPUT x : LREAL; END_VAR
VAR i : DINT; END_VAR
FOR i := 0 TO 0 DO
    x := x + 1.0;
END_FOR;
END_FUNCTION_BLOCK
"""


def checked(tmp_path, text, dialect="iec", portable=True):
    (tmp_path / "FB_A.st").write_text(text)
    check_emitted(tmp_path, dialect, portable=portable)


def test_good_text_passes(tmp_path):
    checked(tmp_path, GOOD.format("1.0"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LOOP, "a loop from 0 to 0"),
        (GOOD.format("1E5"), "without a dot"),
        (GOOD.format("y"), "cannot read itself"),
        (GOOD.format("1.0E-300"), "outside of"),
    ],
)
def test_bad_text_is_a_defect(text, message, tmp_path):
    with pytest.raises(DefectError, match=message):
        checked(tmp_path, text)


def test_only_targets_that_say_so_are_held_to_the_portable_subset(tmp_path):
    checked(tmp_path, GOOD.format("1.0E-300"), "twincat", portable=False)
    with pytest.raises(DefectError, match="a loop from 0 to 0"):
        checked(tmp_path, LOOP, "twincat", portable=False)


def test_nothing_is_written_where_the_text_is_wrong(tmp_path, monkeypatch):
    def found(*_, **__):
        raise DefectError("wrong")

    monkeypatch.setattr(driver, "check_emitted", found)
    with pytest.raises(DefectError):
        driver.generate(MODEL, "iec", tmp_path / "out")
    assert not list(tmp_path.rglob("*.st"))
