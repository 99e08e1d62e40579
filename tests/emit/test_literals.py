import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.emit.literals import check_text, harmless, identifier, is_keyword, real, reals, unit_text
from st_codegen.errors import InputError
from st_codegen.st.check.standard_names import PARAMETERS, conversions
from st_codegen.st.syntax.parser import reserved_words
from st_codegen.st.types import UNSUPPORTED

BITS = st.integers(0, 2**64 - 1).map(lambda bits: struct.unpack("<d", struct.pack("<Q", bits))[0])
FINITE = BITS.filter(math.isfinite)


@given(FINITE)
def test_a_real_literal_reads_back_as_the_same_bits_and_has_the_form_strict_compilers_want(value):
    text = real(value)
    assert struct.pack("<d", float(text)) == struct.pack("<d", value)
    assert re.fullmatch(r"-?\d+\.\d+(E-?\d+)?", text)


def test_many_reals_are_written_as_one_is():
    values = np.array([0.1, 1e16, 1e-5, -2.5e-7, 100.0, -0.0, 5e-324, 1.7976931348623157e308])
    assert reals(values) == [real(value) for value in values]
    assert reals(values[:0]) == []
    for wrong in (np.nan, -np.inf):
        with pytest.raises(InputError, match="cannot be written"):
            reals(np.array([1.0, wrong]))


def test_real_literals_are_the_shortest():
    assert [real(v) for v in (0.1, 1e16, 1e-5, -2.5e-7, 100.0, -0.0)] == [
        "0.1",
        "1.0E16",
        "1.0E-5",
        "-2.5E-7",
        "100.0",
        "-0.0",
    ]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_numbers_that_st_cannot_write_are_refused(value):
    with pytest.raises(InputError, match="cannot be written"):
        real(value)


def test_whatever_the_engine_reserves_is_a_keyword():
    reserved = reserved_words() | PARAMETERS.keys() | conversions().keys() | UNSUPPORTED
    assert {name for name in reserved if not is_keyword(name.lower())} == set()
    assert not is_keyword("FB_to_heat") and not is_keyword("SELL") and not is_keyword("DINT_TO_HEAT")


@given(st.text(min_size=1, max_size=80))
def test_identifiers_are_valid_or_refused(name):
    try:
        text = identifier(name, "name")
    except InputError as error:
        assert "name" in str(error)
        return
    assert re.fullmatch(r"[A-Za-z0-9]+(_[A-Za-z0-9]+)*", text)
    assert not is_keyword(text)
    assert len(text) <= 48


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("if", "reserved word"),
        ("Lreal", "reserved word"),
        ("a*)b", r"contains '\*\)'"),
        ("a]]>b", "contains ']]>'"),
        ("a\nb", "line end"),
        ("a\rb", "line end"),
        ("größe", "ASCII"),
        ("a\x00b", "ASCII"),
        ("---", "no letter or digit"),
        ("x" * 49, "longer than 48"),
    ],
)
def test_bad_names_are_refused_with_the_reason(name, reason):
    with pytest.raises(InputError, match=reason):
        identifier(name, "feature name")


def test_punctuation_becomes_single_underscores():
    assert identifier("A39 (forward) -- v1.2", "name") == "A39_forward_v1_2"


def test_units_are_written_in_ascii():
    assert unit_text("°C", "unit") == "degC"
    assert unit_text("N·m", "unit") == "N m"
    with pytest.raises(InputError, match="unit"):
        unit_text("℃", "unit")


def test_text_that_would_open_a_comment_is_refused():
    with pytest.raises(InputError, match=r"'\(\*'"):
        check_text("a (* b", "note")
    with pytest.raises(InputError, match=r"'/\*'"):
        check_text("a /* b", "note")


@pytest.mark.parametrize(
    "text", ["x*)y", "(*", "(*)", "**)(*(*)", "/*/", "(*/*)*/", "]]>", "]]]>>", "ä\n\0", "plain, 100 % [1]"]
)
def test_text_of_a_model_file_is_escaped_and_then_taken(text):
    """A category that is called `x*)y` is no reason to refuse a model."""
    shown = harmless(text)
    assert check_text(shown, "note") == shown
    assert (shown == text) == text.startswith("plain")


@pytest.mark.parametrize("name", ["o" * 10_000, "*)" * 5_000, "\n" * 10_000, "-" * 10_000, "é" * 10_000])
def test_a_message_about_a_long_name_is_short(name):
    with pytest.raises(InputError) as refused:
        identifier(name, "feature name")
    assert len(str(refused.value)) < 200
