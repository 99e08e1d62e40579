"""The reader of UBJSON against a writer of its own: every kind of value, and every kind of damage."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError
from st_codegen.walkers.xgboost.ubjson import entry, loads
from tests.examples import examples

INTEGERS = {"i": "b", "U": "B", "I": "h", "l": "i", "L": "q"}
FLOATS = {"d": "f", "D": "d"}


def number(marker, value):
    return marker.encode() + struct.pack(">" + (INTEGERS | FLOATS)[marker], value)


def text(value, kind="U"):
    raw = value.encode()
    return number(kind, len(raw)) + raw


@st.composite
def integers(draw):
    marker = draw(st.sampled_from(sorted(INTEGERS)))
    bits = 8 * struct.calcsize(">" + INTEGERS[marker])
    low, high = (0, 2**bits - 1) if marker == "U" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    value = draw(st.integers(low, high))
    return value, number(marker, value)


@st.composite
def floats(draw):
    marker = draw(st.sampled_from("dD"))
    value = draw(st.floats(width=32 if marker == "d" else 64, allow_nan=False))
    return value, number(marker, value)


@st.composite
def texts(draw):
    value = draw(st.text(max_size=20))
    return value, draw(st.sampled_from([b"S", b"H"])) + text(value, draw(st.sampled_from("UIlL")))


@st.composite
def typed(draw):
    marker, parts = draw(st.sampled_from(sorted(INTEGERS | FLOATS))), draw(st.lists(st.integers(0, 127), max_size=5))
    raw = b"".join(number(marker, part)[1:] for part in parts)
    written = b"[$" + marker.encode() + b"#" + number("l", len(parts)) + raw
    return np.array(parts, (INTEGERS | FLOATS)[marker]), written


@st.composite
def containers(draw, inside):
    """An array or object, counted or up to its end, with bytes that say nothing in it."""
    parts, is_array = draw(st.lists(inside, max_size=3)), draw(st.booleans())
    no_op = b"N" * draw(st.integers(0, 2))
    head = b"#" + number("i", len(parts)) if draw(st.booleans()) else b""
    if is_array:
        end = b"" if head else no_op + b"]"
        return [value for value, _ in parts], b"[" + head + b"".join(no_op + raw for _, raw in parts) + end
    written = b"".join(text(f"k{n}") + no_op + raw for n, (_, raw) in enumerate(parts))
    return {f"k{n}": value for n, (value, _) in enumerate(parts)}, b"{" + head + written + (b"" if head else b"}")


def values():
    """Values, each with one of the ways to write it."""
    constants = st.sampled_from([(None, b"Z"), (True, b"T"), (False, b"F")])
    characters = st.characters(max_codepoint=255).map(lambda one: (one, b"C" + one.encode("latin-1")))
    return st.recursive(integers() | floats() | constants | characters | texts() | typed(), containers, max_leaves=6)


def same(one, other):
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return isinstance(other, dict) and list(one) == list(other) and all(map(same, one.values(), other.values()))
    return type(one) is type(other) and one == other and (type(one) is not float or sign(one) == sign(other))


def sign(value):
    return math.copysign(1.0, value)


@examples()
@given(values(), st.binary(max_size=3))
def test_what_was_written_is_read(written, behind):
    value, data = written
    assert same(loads(data), value)
    assert same(loads(b"N" + data + behind), value)


@examples(30)
@given(values(), values())
def test_an_entry_is_found_with_all_its_bytes(one, other):
    data = b"{" + text("a") + one[1] + text("b") + other[1] + b"}"
    assert (entry(data, "a"), entry(data, "b")) == (one[1], other[1])
    with pytest.raises(InputError, match="0 entries 'c', expected one"):
        entry(data, "c")


@examples(30)
@given(values(), st.data())
def test_what_is_cut_is_refused(written, data):
    """Only at its end has a value all its bytes; the message names the byte where one is missing."""
    _, whole = written
    length = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(InputError, match=r"^not an XGBoost model \(UBJSON, byte \d+: ") as caught:
        loads(whole[:length])
    assert int(str(caught.value).split("byte ")[1].split(":")[0]) <= length


def deep(levels):
    return b"[" * levels + b"Z" + b"]" * levels


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"x", r"byte 1: unknown marker b'x'"),
        (b"Sd", r"byte 2: marker b'd' where a length is expected"),
        (b"Si\xff", r"byte 3: a length of -1, 0 bytes left"),
        (b"SU\x05abcd", r"byte 3: a length of 5, 4 bytes left"),
        (b"SU\x01\xff", r"byte 4: a string that is not UTF-8"),
        (b"[$U]", r"a typed container without a count"),
        (b"[$S#U\x00", r"an array of type b'S'"),
        (b"{$U#U\x00", r"an object of type b'U'"),
        (b"{U\x01aZU\x01aZ}", r"the key 'a' twice"),
        (deep(65), r"byte 66: nested more than 64 deep"),
    ],
)
def test_each_damage_has_its_message(data, message):
    with pytest.raises(InputError, match=message):
        loads(data)


def test_as_deep_as_it_may_be():
    value = loads(deep(64))
    for _ in range(64):
        (value,) = value
    assert value is None


def test_an_entry_needs_an_object_that_is_not_counted():
    for data in (b"[]", b"{#U\x01" + text("a") + b"Z", b"Z"):
        with pytest.raises(InputError, match="not an object without a count"):
            entry(data, "a")
    with pytest.raises(InputError, match="2 entries 'a', expected one"):
        entry(b"{" + (text("a") + b"Z") * 2 + b"}", "a")
