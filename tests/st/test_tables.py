from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st import StSyntaxError
from st_codegen.st.syntax import tables as module
from st_codegen.st.syntax.declarations import NumberTable, TableKind
from st_codegen.st.syntax.parser import parse_segment
from st_codegen.st.syntax.scan import Segment
from st_codegen.st.syntax.tables import parse_table


def block(initial: str) -> str:
    return f"FUNCTION_BLOCK FB_A\nVAR CONSTANT\n    T : ARRAY[0..9] OF LREAL := {initial};\nEND_VAR\nEND_FUNCTION_BLOCK"


def initial_of(text: str) -> object:
    return parse_segment(Segment(block(text), "a.st"))[0].blocks[0].variables[0].initial


@given(s.lists(s.integers(-(2**63), 2**63 - 1), min_size=1, max_size=20))
def test_integers(values: list[int]) -> None:
    table, kind = parse_table(f"[{', '.join(map(str, values))}]")
    assert kind is TableKind.INTEGER
    assert table.tolist() == values


@given(s.lists(s.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_reals_keep_every_bit(values: list[float]) -> None:
    table, kind = parse_table(f"[{', '.join(f'{value:.17E}' for value in values)}]")
    assert kind is TableKind.REAL
    assert table.tobytes() == np.array(values).tobytes()


@pytest.mark.parametrize(
    ("text", "values", "kind"),
    [
        ("[1, 2.5]", [1.0, 2.5], TableKind.MIXED),
        ("[ - 1 , + 2,\n3 ]", [-1, 2, 3], TableKind.INTEGER),
        ("[1_000, 2_0]", [1000, 20], TableKind.INTEGER),
        ("[1_0.5_0, 2.0E+3, 3.0e-1]", [10.5, 2000.0, 0.3], TableKind.REAL),
        ("[1E3]", [1000.0], TableKind.REAL),
        ("[TRUE, false]", [True, False], TableKind.BOOL),
        ("[16#FF, 2#10, 7, -8#17]", [255, 2, 7, -15], TableKind.INTEGER),
        ("[18446744073709551615]", [2**64 - 1], TableKind.INTEGER),
        ("[-9223372036854775808]", [-(2**63)], TableKind.INTEGER),
    ],
)
def test_kinds_of_cells(text: str, values: list[object], kind: TableKind) -> None:
    table, found = parse_table(text)
    assert (table.tolist(), found) == (values, kind)
    assert not table.flags.writeable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "a number is missing"),
        ("[1,]", "a number is missing"),
        ("[1 2]", "'1 2' is no number"),
        ("[1.]", "'1.' is no number"),
        ("[.5]", "'.5' is no number"),
        ("[1..2]", "is no number"),
        ("[--1]", "is no number"),
        ("[1__0]", "is no number"),
        ("[1, TRUE]", "either numbers or TRUE and FALSE"),
        ("[1.0E999]", "larger than the largest LREAL"),
        ("[18446744073709551616]", "no integer type holds"),
        ("[-1, 18446744073709551615]", "no integer type holds"),
    ],
)
def test_wrong_cells(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        parse_table(text)


def test_chunks_of_different_kinds_become_one_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CHUNK", 4)
    table, kind = parse_table("[1, 2, 3, 4.5, 5, 6]")
    assert (table.tolist(), kind) == ([1.0, 2.0, 3.0, 4.5, 5.0, 6.0], TableKind.MIXED)
    table, kind = parse_table("[1, 2, 3, 18446744073709551615, 5]")
    assert (table.tolist(), kind) == ([1, 2, 3, 2**64 - 1, 5], TableKind.INTEGER)
    with pytest.raises(ValueError, match="no integer type"):
        parse_table("[-1, 2, 3, 18446744073709551615, 5]")
    with pytest.raises(ValueError, match="either numbers"):
        parse_table("[1, 2, 3, TRUE]")


def test_plain_numbers_are_one_token_and_anything_else_goes_through_the_grammar() -> None:
    table = initial_of("[(* tree 0 *) 0.5, 1.0E-3, // nodes\n -2.5]")
    assert isinstance(table, NumberTable)
    assert table.values.tolist() == [0.5, 1e-3, -2.5]
    for text in ("[1.0, PI]", "[2(0.0)]", "[E1, 1.0]", "[TRUE_VALUE]", "[DINT#5]", "[A]"):
        assert not isinstance(initial_of(text), NumberTable), text


def test_wrong_table_is_an_error_at_its_bracket() -> None:
    with pytest.raises(StSyntaxError, match=r"a.st:3:33 \(FB_A\): '1 2' is no number"):
        initial_of("[1 2]")


def test_index_is_no_table() -> None:
    (assignment,) = parse_segment(Segment("a[0] := b[1, 2];", "a.st"), "body")
    assert len(assignment.value.indices) == 2


def _seconds(count: int) -> float:
    numbers = np.random.default_rng(3).normal(size=1000)
    row = ", ".join(repr(float(value)).upper() for value in numbers)
    text = block("[\n" + ",\n".join(f"    (* row {i} *)\n    {row}" for i in range(count // 1000)) + "]")
    started = time.perf_counter()
    (unit,) = parse_segment(Segment(text, "a.st"))
    seconds = time.perf_counter() - started
    values = unit.blocks[0].variables[0].initial.values
    assert values.size == count
    assert values[-1000:].tobytes() == numbers.tobytes()
    return seconds


@pytest.mark.slow
def test_five_million_numbers_are_read_in_linear_time() -> None:
    small = min(_seconds(500_000) for _ in range(2))
    large = _seconds(5_000_000)
    # Ten times the text; a quadratic step anywhere would make it a hundred times
    assert large < 30 * small


def test_memory_grows_with_the_text_and_not_with_objects_for_numbers() -> None:
    text = "[" + ", ".join(["0.123456789"] * 300_000) + "]"
    tracemalloc.start()
    table, _ = parse_table(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A Python float and a piece of text for each number would be 90 bytes
    assert peak - table.nbytes < 20 * table.size
