"""The PLC code in this repository is that of the models in it, and computes the same numbers."""

from pathlib import Path

from st_codegen.testing import assert_equals_library

ROOT = Path(__file__).parents[1]


def test_the_plc_code_is_up_to_date(generated_golden):
    generated_golden(ROOT / "models", ROOT / "plc")


def test_the_plc_code_computes_what_lightgbm_computes():
    assert_equals_library(ROOT / "models", ROOT / "plc", rows=2000)
