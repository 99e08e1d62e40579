import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.errors import InputError, Problems
from st_codegen.files.csv_tables import read_csv
from st_codegen.files.number_text import parse_number, parse_whole


def table(tmp_path, text, wanted=()):
    path = tmp_path / "t.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_csv(path, wanted)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_is_read_as_it_was_written(value):
    for text in (repr(value), f"{value:.17g}", f" {value:.17e}\t"):
        assert parse_number(text) == value
        assert parse_number(text.replace(".", ","), decimal_comma=True) == value


@given(st.text(max_size=12))
def test_what_is_taken_as_a_number_python_takes_with_the_same_value(text):
    try:
        value = parse_number(text, is_finite=False)
    except ValueError:
        return
    assert value == float(text) or math.isnan(float(text))
    assert text.isascii()
    assert "_" not in text


NO_NUMBERS = "1_0,\u0661\u0662,\uff11,0x10,, ,--1,1e,.,1 2,nan,inf,1e999,\xbd,1;5".split(",")


@pytest.mark.parametrize("text", NO_NUMBERS)
def test_what_is_no_number(text):
    with pytest.raises(ValueError, match=re.escape(repr(text))):
        parse_number(text)


@pytest.mark.parametrize("text", ["1_0", "\u0661", "1.0", "", "0x1"])
def test_what_is_no_whole_number(text):
    with pytest.raises(ValueError, match="not a whole number"):
        parse_whole(text)


def test_a_whole_number_of_many_digits_is_one_and_is_refused_for_these():
    assert parse_whole(" -" + "9" * 18) == 1 - 10**18
    with pytest.raises(ValueError, match="has more than 18 digits"):
        parse_whole("9" * 19)


@pytest.mark.parametrize(
    "text",
    [
        "a,b\n1.5,2\n\n3,4\n",
        "a;b\r\n1,5;2\r\n3;4",
        'a;b\r1.5;"2"\r3;4',
        "\ufeff a , b\n1.5,2\n ,\n3,4",
        "b,a,\n2,1.5,remark\n4,3,",
        "sep=;\r\na;b\r\n1,5;2\r\n3;4\r\n",
        "sep=,\na,b\n1.5,2\n3,4\n",
        "SEP=\t\na\tb\n1.5\t2\n3\t4\n",
        '\ufeff"sep=|"\na|b\n1.5|2\n3|4\n',
    ],
)
def test_all_layouts_give_the_same_numbers(tmp_path, text):
    problems = Problems("t")
    assert table(tmp_path, text, ("a", "b")).numbers(("a", "b"), problems).tolist() == [[1.5, 2.0], [3.0, 4.0]]
    problems.raise_if_any()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the file is empty"),
        ("\n \n", "the file is empty"),
        ("a,c\n1,2\n", "the column 'b' is missing; the table needs a,b"),
        ("c,d\n1,2\n", "the columns 'a', 'b' are missing; the table needs a,b"),
        ("a,b,a\n", "the column 'a' is there twice"),
        ("a,b\n" + "x" * 140_000 + ",1\n", "line 2: not readable as a table (field larger"),
        ('a,b\n"1,2\n3,4\n' + "x" * 140_000, "not readable as a table (field larger"),
        ("a,b\nä,1\n".encode("latin-1"), "not UTF-8 (byte 0xe4 at 4)"),
        ("a,b\n1,2\n".encode("utf-16"), "the text is UTF-16"),
    ],
)
def test_what_is_no_table(tmp_path, text, reason):
    with pytest.raises(InputError, match=re.escape(reason)):
        table(tmp_path, text, ("a", "b"))


def test_a_comma_among_tabs_is_one_of_decimals_only_where_it_cannot_group_thousands(tmp_path):
    problems = Problems("t")
    surely = table(tmp_path, "a\tb\n1,5\t1,234\n", ("a", "b")).numbers(("a", "b"), problems)
    assert surely.tolist() == [[1.5, 1.234]]
    problems.raise_if_any()
    table(tmp_path, "a\tb\n1,234\t2.5\n", ("a", "b")).numbers(("a", "b"), problems)
    with pytest.raises(InputError, match="1,234"):
        problems.raise_if_any()


def test_a_tab_behind_a_comma_is_a_blank(tmp_path):
    problems = Problems("t")
    read = table(tmp_path, "a,\tb\n1.5,\t2\n", ("a", "b")).numbers(("a", "b"), problems)
    assert read.tolist() == [[1.5, 2.0]]


def test_all_bad_cells_are_in_one_message_and_long_ones_are_cut(tmp_path):
    problems = Problems("t.csv")
    table(tmp_path, f"a,b\n1,x\n1\n{'y' * 1000},nan\n1,inf\n1,2,3\n").numbers(("a", "b"), problems)
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    message = str(caught.value)
    for part in (
        "6 problems",
        "line 2: b: 'x' is not a number",
        "line 3: 1 value, the header has 2",
        "line 4: a: 'yyy",
        "line 4: b: 'nan' is not finite",
        "line 5: b: 'inf' is not finite",
        "line 6: 3 values, the header has 2",
    ):
        assert part in message
    assert len(message) < 500


def test_of_many_faults_alike_the_first_is_shown_with_their_count(tmp_path):
    problems = Problems("t.csv")
    table(tmp_path, "a\n" + "x\n" * 1000).numbers(("a",), problems)
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert str(caught.value) == (
        "t.csv: 1000 problems\n  - line 2: a: 'x' is not a number; and 999 more that differ in names and numbers only"
    )


@pytest.mark.parametrize(("faults", "more"), [(8, False), (9, True)])
def test_a_few_faults_alike_are_all_shown(tmp_path, faults, more):
    problems = Problems("t.csv")
    table(tmp_path, "a\n" + "x\n" * faults).numbers(("a",), problems)
    with pytest.raises(InputError, match=f"{faults} problems") as caught:
        problems.raise_if_any()
    assert str(caught.value).count("is not a number") == (1 if more else faults)
    assert (f"and {faults - 1} more that differ" in str(caught.value)) == more


@pytest.mark.parametrize(("faults", "more"), [(50, False), (51, True)])
def test_as_many_faults_as_are_shown_are_all_shown(faults, more):
    problems = Problems("t.csv")
    for number in range(faults):
        problems.add(f"fault {'x' * number}")
    with pytest.raises(InputError, match=f"{faults} problems") as caught:
        problems.raise_if_any()
    assert ("and 1 more" in str(caught.value)) == more
    assert str(caught.value).count("fault") == 50


def test_a_column_of_another_case_is_proposed(tmp_path):
    (tmp_path / "table.csv").write_text("Speed_RPM,torque_Nm\n1,2\n")
    with pytest.raises(InputError, match=r"'speed_rpm' is missing; .*; did you mean 'Speed_RPM'"):
        read_csv(tmp_path / "table.csv", ["speed_rpm", "torque_Nm"])
    with pytest.raises(InputError) as error:
        read_csv(tmp_path / "table.csv", ["torque_Nm", "torque_Nn"])
    assert "did you mean" not in str(error.value), "what is read already is not meant"
    with pytest.raises(InputError) as error:
        read_csv(tmp_path / "table.csv", ["torque_Nm", "speed_rps"])
    assert "did you mean" not in str(error.value), "nor is another unit"


def test_a_thousand_with_its_point_is_not_one_where_numbers_have_decimal_commas(tmp_path):
    """Spreadsheets export 1000 as 1.000 beside 400,5; it was read as 1 rpm."""
    problems = Problems("t.csv")
    grouped = table(tmp_path, "note;n;M\n;1.000;400\n;125;2.5\n1,2,3;-12.500;400,5\n")
    assert grouped.numbers(["n", "M"], problems).tolist()[1] == [125.0, 2.5]
    assert [str(one) for one in problems.errors] == [
        "line 2: n: '1.000' is 1000 or 1,000, since numbers have decimal commas (line 4): write one of these",
        "line 4: n: '-12.500' is -12500 or -12,500, since numbers have decimal commas (line 4): write one of these",
    ]
    # a column that has decimal points has them in all of its numbers, and one that nobody reads says nothing
    for text in ("n;M\n1.000;400\n", "n,M\n1.000,400\n", "n;M\n1.000;400,5\n0.125;1,5\n"):
        assert table(tmp_path, text).numbers(["n"], problems)[0].tolist() == [1.0]
    (tmp_path / "table.csv").write_text("n;orders\n1.000;39,40\n")
    assert read_csv(tmp_path / "table.csv", ["n"]).numbers(["n"], problems).tolist() == [[1.0]]
    assert len(problems.errors) == 2
