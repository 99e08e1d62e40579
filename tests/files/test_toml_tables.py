import math
import re
from enum import StrEnum

import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError, Problems
from st_codegen.files.text import read_text
from st_codegen.files.toml_tables import TomlTable, nearest, parse_toml, read_toml, shown
from st_codegen.files.toml_text import table_lines, toml_value


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


KEYS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=12)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just(10**400) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


def read(values):
    """Everything that a reader can ask a table for, and the problems."""
    problems = Problems("file.toml")
    with TomlTable(values, "[part]", problems) as table:
        found = {
            "number": table.number("number", 1.0, low=-2.0, high=2.0),
            "whole": table.whole("whole", 3, low=1, high=5),
            "text": table.text("text", ""),
            "choice": table.choice("choice", Colour),
            "list": table.list_of("list", table.whole_of),
        }
        with table.table("inner") as inner:
            found["deep"] = inner.number("deep", 0.0)
        for entry in table.tables("rows"):
            with entry:
                entry.text("name")
    return found, problems


@given(
    st.dictionaries(
        st.sampled_from(["number", "whole", "text", "choice", "list", "inner", "rows", "numbr"]) | KEYS, VALUES
    )
)
def test_anything_is_read_or_noted_and_nothing_raises_but_the_problems(values):
    found, problems = read(values)
    assert -2.0 <= found["number"] <= 2.0
    assert 1 <= found["whole"] <= 5
    assert isinstance(found["text"], str)
    assert all(isinstance(entry, int) and not isinstance(entry, bool) for entry in found["list"])
    known = {"number", "whole", "text", "choice", "list", "inner", "rows"}
    message = "\n".join(map(str, problems.errors))
    assert message.count("unknown key") >= len(set(values) - known)
    assert all(str(error).startswith(("[part", "[[rows]]")) for error in problems.errors)
    if not problems.errors:
        assert found["number"] == values.get("number", 1.0)
        assert found["whole"] == values.get("whole", 3)
        assert found["choice"] == values["choice"]
        assert list(found["list"]) == values["list"]


@given(st.text(max_size=200))
def test_any_text_is_toml_or_an_input_error(text):
    try:
        content = parse_toml(text, "f.toml")
    except InputError as error:
        assert str(error).startswith("f.toml: not readable as TOML")
    else:
        assert isinstance(content, dict)


@given(st.binary(max_size=60))
def test_any_bytes_are_text_or_an_input_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "f.toml"
    path.write_bytes(content)
    try:
        read_toml(path)
    except InputError as error:
        assert str(error).startswith(str(path))


@given(
    st.dictionaries(
        st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True),
        st.booleans()
        | st.integers(-(2**63), 2**63 - 1)
        | st.floats(allow_nan=False)
        | st.text(st.characters(codec="utf-8"), max_size=10)
        | st.lists(st.floats(allow_nan=False), max_size=3),
        max_size=5,
    )
)
def test_what_is_written_reads_back_the_same(values):
    text = "\n".join(table_lines("[t]", values | {"inner": values}))
    assert parse_toml(text, "f") == {"t": values | {"inner": values}}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"name = '\xe4'", "not UTF-8 (byte 0xe4 at 8); save it as UTF-8"),
        ("name = 'ä'".encode("utf-16"), "the text is UTF-16; save it as UTF-8"),
        (b"a = " + b"[" * 3000, "nested too deeply"),
        (b"a = " + b"9" * 5000, "not readable as TOML"),
        (b"a = \x00", "not readable as TOML"),
        (b"a = 1\na = 2", "not readable as TOML"),
    ],
)
def test_what_is_no_toml_is_said_in_one_line(tmp_path, content, reason):
    path = tmp_path / "f.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(reason)) as caught:
        read_toml(path)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_and_windows_line_ends_are_read(tmp_path):
    path = tmp_path / "f.toml"
    path.write_bytes(b"\xef\xbb\xbfa = 1\r\nb = 2\r\n")
    assert read_toml(path) == {"a": 1, "b": 2}


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_text(tmp_path / "none")
    with pytest.raises(InputError, match="is a folder"):
        read_text(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_text(tmp_path / "a\0b")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"number": True}, "[part]: number = True is not a number"),
        ({"number": math.nan}, "[part]: number = nan is not finite"),
        ({"number": 10**400}, "[part]: number = a number of about 400 digits is not finite"),
        ({"number": 2.5}, "[part]: number = 2.5 is outside -2 .. 2"),
        ({"whole": 1.5}, "[part]: whole = 1.5 is not a whole number"),
        ({"whole": 6}, "[part]: whole = 6 is outside 1 .. 5"),
        ({"whole": 0x1 << 20000}, "[part]: whole = a number of about 6021 digits is outside 1 .. 5"),
        ({"text": 3}, "[part]: text = 3 is not a text"),
        ({"choice": "reed"}, "[part]: choice = 'reed'; did you mean 'red'? Known are red, blue"),
        ({"choice": []}, "[part]: choice = []; known are red, blue"),
        ({"list": 1}, "[part]: list = 1 is not a list"),
        ({"list": ["a", {}]}, "[part]: list = {} is not a whole number"),
        ({"inner": [{}]}, "[part]: [[inner]]: one table is wanted, not a list of tables; write [inner]"),
        ({"inner": 1}, "[part]: inner = 1 is not a table; write [part.inner]"),
        ({"inner": {"dep": 1}}, "[part.inner]: unknown key 'dep'; did you mean 'deep'? Known are deep"),
        ({"rows": {}}, "[part]: [rows]: a list of tables is wanted; write [[part.rows]] above each"),
        ({"rows": [1]}, "[part]: rows = [1]: tables are wanted; write [[part.rows]] above each"),
        ({"rows": [{"name": "a"}, {}]}, "[[rows]] 2: 'name' is missing"),
        ({"nummber": 1}, "[part]: unknown key 'nummber'; did you mean 'number'? Known are number, whole"),
    ],
)
def test_every_fault_has_its_own_words(values, message):
    _, problems = read({"choice": "red", "list": [1]} | values)
    messages = [str(error) for error in problems.errors]
    assert any(found.startswith(message) for found in messages), messages
    assert len(messages) == (2 if values.get("list") == ["a", {}] else 1)


def test_long_values_are_cut_and_lists_of_huge_numbers_are_shown():
    assert shown("x" * 500).endswith("x ..")
    assert len(shown(list(range(500)))) < 80
    assert shown([1 << 20000]) == "a list"


def test_the_nearest_name_is_found_in_any_case():
    assert nearest("FORWARD", ["forward", "backward"]).startswith("did you mean 'forward'?")
    assert nearest("zzz", ["forward"]) == "known are forward"
    assert nearest("zzz", []) == "nothing is known here"


def test_text_with_control_characters_is_written_as_toml():
    assert parse_toml(f"a = {toml_value(chr(127) + chr(1) + chr(34) + chr(92))}", "f") == {"a": '\x7f\x01"\\'}


@pytest.mark.parametrize(
    "values", [{"whole": 1}, {"whole": 5}, {"whole": 5.0}, {"number": -2}, {"number": 2.0}, {"list": [0, 10**6]}]
)
def test_values_at_their_bounds_are_taken(values):
    given = {"choice": "red", "list": [1]} | values
    found, problems = read(given)
    problems.raise_if_any()
    ((key, value),) = values.items()
    assert found[key] == (tuple(value) if key == "list" else value)


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_a_text_is_read_again_as_it_was_and_what_is_written_is_printable(text):
    """A mark that turns the direction of writing stood in the file that `init` wrote as the model file had it."""
    written = toml_value(text)
    assert parse_toml(f"key = {written}", "x.toml")["key"] == text
    assert written.isprintable()
