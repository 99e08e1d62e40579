from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st.syntax.literals import parse_characters, parse_duration, parse_integer, parse_real


@given(s.integers(0, 2**64 - 1), s.sampled_from([(2, "b"), (8, "o"), (16, "x")]))
def test_based_integers(value: int, base: tuple[int, str]) -> None:
    assert parse_integer(f"{base[0]}#{value:{base[1]}}") == value
    assert (
        parse_integer(f"{base[0]}#{value:_{base[1]}}".upper() if base[0] == 16 else f"{base[0]}#{value:{base[1]}}")
        == value
    )


@given(s.integers(-(2**63), 2**64 - 1))
def test_decimal_integers(value: int) -> None:
    assert parse_integer(f"{value:_}") == value


@given(s.floats(min_value=0, allow_nan=False, allow_infinity=False))
def test_reals_keep_every_bit(value: float) -> None:
    text = f"{value:.17E}"
    assert struct.pack("<d", parse_real(text)) == struct.pack("<d", value)


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("250us", 250_000),
        ("1d2h3m4s5ms6us7ns", ((((24 + 2) * 60 + 3) * 60 + 4) * 1_000_000_000) + 5_006_007),
        ("1.5s", 1_500_000_000),
        ("-2ms", -2_000_000),
        ("1h_30m", 5_400_000_000_000),
        ("0s", 0),
        ("0.000000001s", 1),
    ],
)
def test_durations(text: str, nanoseconds: int) -> None:
    assert parse_duration(text) == nanoseconds
    assert parse_duration(text.upper()) == nanoseconds


@pytest.mark.parametrize("text", ["", "5", "5x", "1s1s", "1ms1s", "1.5h2m", "0.1ns", "1" * 500 + "s"])
def test_wrong_durations(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_duration(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("'abc'", "abc"),
        ("'$$$'$\"'", "$'\""),
        ("'$L$N$P$R$T'", "\n\n\f\r\t"),
        ("'$l$n$p$r$t'", "\n\n\f\r\t"),
        ("'$41$7Ab'", "Azb"),
        ('"$0041b"', "Ab"),
        ("''", ""),
    ],
)
def test_characters(text: str, value: str) -> None:
    assert parse_characters(text) == value


@pytest.mark.parametrize("text", ["'$Q'", "'$4'", '"$041"'])
def test_wrong_escapes(text: str) -> None:
    with pytest.raises(ValueError, match="no escape sequence"):
        parse_characters(text)
