"""Names of other languages: recognised in any case, and kept out of generated text."""

import re
import shutil
import subprocess

import pytest

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.classes import _names
from st_codegen.emit.blocks.listing import Block, BlockVariable
from st_codegen.emit.blocks.model import Limits, feature_text, header_lines, input_variables, model_block
from st_codegen.emit.foreign_names import is_foreign
from st_codegen.errors import InputError
from st_codegen.ir import Feature
from tests.models import SMALL_MODELS

HEADERS = ("errno.h", "math.h", "limits.h", "float.h", "stdint.h", "signal.h", "complex.h")


@pytest.mark.parametrize(
    "name", ["eFault", "EFAULT", "efault", "fLt_max", "nan", "Infinity", "sIgabrt", "fLoat", "goto"]
)
def test_names_are_recognised_in_any_case(name):
    assert is_foreign(name)


@pytest.mark.parametrize(
    "name",
    [
        "eReason",
        "fOut1",
        "bValid",
        "nColumn",
        "fSpeed_rpm",
        "EDGE_1_0",
        "fSpeed_max",
        "fP_bar",
        "sA_forward",
        "LOWER_2",
        "fMaximum",
    ],
)
def test_ordinary_names_are_not(name):
    assert not is_foreign(name)


@pytest.mark.parametrize("header", HEADERS)
def test_every_macro_of_the_headers_is_recognised(header):
    """What the compiler of this machine knows; names that start with an underscore are no names of ours."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc to ask")
    text = subprocess.run(
        [compiler, "-std=c11", "-dM", "-E", "-"],
        input=f"#include <{header}>",
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    names = re.findall(r"^#define ([A-Za-z]\w*)", text, re.MULTILINE)
    lower = re.compile("sa_|si_|sigev_|math_errhandling")  # fields, which nobody else names
    assert [name for name in names if not is_foreign(name) and not lower.match(name)] == []


def test_inputs_of_such_names_are_renamed():
    names = [variable.name for variable in input_variables((Feature("lt_max"), Feature("p_nan"), Feature("speed")))]
    assert names == ["fInput_Lt_max", "fInput_P_nan", "fSpeed"]


@pytest.mark.parametrize(("name", "shown"), [("x]]>y", r"x\x5d]>y"), ("*) a", r"\x2a) a"), ("speed", "speed")])
def test_a_feature_whose_name_would_end_a_comment_stands_escaped_in_the_header(name, shown):
    assert feature_text(Feature(name)) == shown
    assert header_lines(f"Input 1: {feature_text(Feature(name))}") == (f"Input 1: {shown}",)


def test_two_inputs_of_one_name_are_refused():
    with pytest.raises(InputError, match="two inputs would be called fInput_Lt_max"):
        input_variables((Feature("lt_max"), Feature("Input_lt_max")))


def test_a_feature_that_makes_no_name_may_be_named_in_a_file():
    """Nothing told who compiled a lone file that there is another way than to train the model again."""
    with pytest.raises(InputError, match=r"printable ASCII characters only, or name it in a folder's st-codegen\.toml"):
        input_variables((Feature("Öl_degC"),))


def test_other_variables_of_such_names_are_refused():
    block = Block("FB_A", ("x",), variables=(BlockVariable("eFault", "DINT"),))
    with pytest.raises(InputError, match="FB_A: eFault"):
        Application("a", blocks=(block,))


def test_no_block_of_any_operation_has_one():
    blocks = tuple(model_block(model, Limits(10_000)) for model in SMALL_MODELS.values())
    for block in blocks:
        assert Application("a", blocks=(block,)).blocks == (block,)


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (("Öl", "außen", "kühl", "压力"), ["Oel", "Aussen", "Kuehl", "Class_3"]),  # were L, Au_en, K_hl
        (("A", "A_number_2", "a"), ["A", "A_number_2", "a_number_2_number_2"]),
        ((-1, 1), ["Minus_1", "Class_1"]),
    ],
)
def test_names_of_labels_are_spelt_in_ascii_and_differ(labels, names):
    assert [name.lower() for name in _names(labels)] == [name.lower() for name in names]
