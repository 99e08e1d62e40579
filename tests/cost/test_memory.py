"""Lines of the cache, counted by hand: 8 LREAL a line."""

import pytest

from st_codegen.cost.memory import lines_by_place
from tests.cost.helpers import CONSTANTS, VARIABLES, cost, unit

LINES = {
    # one element, the same one again, another one; T has 13 lines
    "x := T[i];": 1,
    "x := T[i] + T[i];": 1,
    "x := T[i] + T[n];": 2,
    "x := T[i]; i := i + 1; x := T[i];": 2,
    "IF b THEN x := T[i]; ELSE x := T[n]; END_IF;": 2,
    # neighbours in a record are one line, farther ones lie in as many lines as fit between them
    "x := T[2 * i] + T[2 * i + 1];": 1,
    "x := T[i] + T[i + 20];": 2,
    "x := T[i - 3] + T[i + 20] + T[i + 5];": 3,
    "n := 4; x := T[n] + T[5];": 1,
    # a walk along the table, a part of it, with a stride, and many places that are not known
    "FOR i := 0 TO 99 DO x := x + T[i]; END_FOR;": 13,
    "FOR i := 0 TO 15 DO x := x + T[i]; END_FOR;": 3,
    "FOR i := 0 TO 3 DO x := x + T[20 * i]; END_FOR;": 4,
    "FOR i := 0 TO 4 DO x := x + T[K[n]]; END_FOR;": 1,
    "FOR i := 0 TO 3 DO x := x + T[25 * K[i]]; END_FOR;": 4,
    "FOR i := 0 TO 99 DO n := n + 1; x := x + T[n]; END_FOR;": 13,
    "FOR i := 0 TO 4 DO n := K[n]; x := x + T[n]; END_FOR;": 5,
    # a walk that starts anew in every round of a loop around it, or where a table says
    "FOR i := 0 TO 2 DO n := K[i]; FOR m := 0 TO 1 DO x := x + T[n]; n := n + 9; END_FOR; END_FOR;": 6,
    "FOR i := 0 TO 2 DO FOR n := K[i] TO K[i] + 1 DO x := x + T[n]; END_FOR; END_FOR;": 6,
    # rows that are found, and read from end to end
    "m := 0; FOR i := 0 TO 1 DO FOR n := 0 TO 7 DO x := x + T[m + n]; END_FOR; m := m + 30; END_FOR;": 4,
    "FOR i := 0 TO 1 DO FOR n := 0 TO 7 DO x := x + T[30 * i + n]; END_FOR; END_FOR;": 6,
}


@pytest.mark.parametrize(("body", "lines"), LINES.items(), ids=range(len(LINES)))
def test_lines_of_a_table(body, lines):
    places = lines_by_place(unit(body).cost.touches)
    assert {place.name: number for place, number in places.items()}["T"] == lines


def test_the_table_of_a_block_is_shared_by_its_instances_and_its_memory_is_not():
    inner = "FUNCTION_BLOCK FB_I VAR_INPUT x : LREAL; END_VAR VAR a : ARRAY[0..15] OF LREAL; i : DINT; END_VAR\n"
    inner += "VAR CONSTANT T : ARRAY[0..31] OF LREAL := [32(1.5)]; END_VAR\n"
    inner += "FOR i := 0 TO 15 DO a[i] := x * T[i]; END_FOR; FOR i := 16 TO 31 DO x := x + T[i]; END_FOR;\n"
    inner += "END_FUNCTION_BLOCK\n"
    variables = VARIABLES + "fb : FB_I; other : FB_I;" + CONSTANTS
    places = lines_by_place(unit("fb(x := x); other(x := y);", before=inner, variables=variables).cost.touches)
    found = {}
    for place, number in places.items():
        found.setdefault(place.name, []).append(number)
    assert found["T"] == [4]
    assert found["A"] == [2, 2]
    assert len(found["FB_I variables"]) == 2


def test_tables_beyond_the_first_cache_wait_for_the_second_one_even_when_warm():
    def text(rows):
        return (
            f"FUNCTION_BLOCK FB_T VAR i : DINT; x : LREAL; END_VAR VAR CONSTANT T : ARRAY[0..{rows - 1}] OF LREAL := "
            f"[{rows}(1.5)]; END_VAR FOR i := 0 TO {rows - 1} DO x := x + T[i]; END_FOR; END_FUNCTION_BLOCK"
        )

    small, large = cost(text(1000)), cost(text(4000))
    assert large.warm_us > 4.2 * small.warm_us
    assert large.cold_us > large.warm_us
