"""Lines of the cache, counted by hand: 8 LREAL a line."""

import pytest

from st_codegen.cost.memory import lines_by_region
from tests.cost.helpers import CONSTANTS, VARIABLES, block, cost, counts, unit

LINES = {
    # one element, the same one again, another one; T has 13 lines
    "x := T[i];": 1,
    "x := T[i] + T[i];": 1,
    "x := T[i] + T[n];": 2,
    "x := T[i]; i := i + 1; x := T[i];": 2,
    "x := T[n]; IF b THEN n := n + 1; END_IF; x := T[n];": 2,
    "IF b THEN x := T[i]; ELSE x := T[n]; END_IF;": 2,
    # neighbours in a record are one line, farther ones lie in as many lines as fit between them
    "x := T[2 * i] + T[2 * i + 1];": 1,
    "x := T[i] + T[i + 20];": 2,
    "x := T[i - 3] + T[i + 20] + T[i + 5];": 3,
    "n := 4; x := T[n] + T[5];": 1,
    "x := T[2 + (n + 10)] + T[n + 10 + 2];": 1,
    "x := T[2 * (n + 20)] + T[40 + 2 * n];": 1,
    # a walk along the table, a part of it, with a stride, and many elements that are not known
    "FOR i := 0 TO 99 DO x := x + T[i]; END_FOR;": 13,
    "FOR i := 0 TO 15 DO x := x + T[i]; END_FOR;": 3,
    "FOR i := 0 TO 3 DO x := x + T[20 * i]; END_FOR;": 4,
    "FOR i := 0 TO 15 DO x := x + T[i + i]; END_FOR;": 5,
    "FOR i := 0 TO 15 DO x := x + T[50 - (i + i)]; END_FOR;": 5,
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
    regions = lines_by_region(unit(body).cost.touches)
    assert {region.name: number for region, number in regions.items()}["T"] == lines


LONG = "x := x + y; " * 32  # four operations of six bytes: 12 lines
CODE = {
    LONG: 12,
    # one of two branches, whichever is the longer, with the line of the test and the one in which the branch ends
    f"IF b THEN {LONG} ELSE {LONG} END_IF;": 14,
    f"IF b THEN {LONG} ELSE x := y; END_IF;": 13,
    f"IF b THEN IF c THEN {LONG} END_IF; ELSE {LONG} END_IF;": 14,
    f"IF b THEN {LONG} END_IF; IF c THEN {LONG} END_IF;": 25,
    # one round takes one branch, several rounds take all of them
    f"FOR i := 1 TO 1 DO IF b THEN {LONG} ELSE {LONG} END_IF; END_FOR;": 14,
    f"FOR i := 1 TO 2 DO IF b THEN {LONG} ELSE {LONG} END_IF; END_FOR;": 25,
    f"WHILE b DO IF b THEN {LONG} ELSE {LONG} END_IF; END_WHILE;": 25,
    # a number in the text takes eight bytes beside the code
    "x := 1.5; " * 32: 10,
}


@pytest.mark.parametrize(("body", "lines"), CODE.items(), ids=range(len(CODE)))
def test_lines_of_code_on_the_worst_path(body, lines):
    (part,) = cost(block(body, VARIABLES + CONSTANTS)).cycle[0].parts
    assert part.code_lines == lines
    assert part.code_lines <= -(-part.code_bytes // 64)


def test_a_block_that_is_called_again_may_go_another_way():
    inner = "FUNCTION_BLOCK FB_I VAR_INPUT b : BOOL; END_VAR VAR x : LREAL; y : LREAL; END_VAR\n"
    inner += f"IF b THEN {LONG} ELSE {LONG} END_IF;\nEND_FUNCTION_BLOCK\n"
    for body, lines in (
        ("fb(b := b);", 14),
        ("fb(b := b); fb(b := c);", 25),
        ("FOR i := 1 TO 2 DO fb(b := b); END_FOR;", 25),
    ):
        text = inner + block(body, VARIABLES + "fb : FB_I;" + CONSTANTS)
        parts = cost(text, entries=["FB_T"]).cycle[0].parts
        assert next(part for part in parts if part.unit == "FB_I").code_lines == lines, body


def test_the_table_of_a_block_is_shared_by_its_instances_and_its_memory_is_not():
    inner = "FUNCTION_BLOCK FB_I VAR_INPUT x : LREAL; END_VAR VAR a : ARRAY[0..15] OF LREAL; i : DINT; END_VAR\n"
    inner += "VAR CONSTANT T : ARRAY[0..31] OF LREAL := [32(1.5)]; END_VAR\n"
    inner += "FOR i := 0 TO 15 DO a[i] := x * T[i]; END_FOR; FOR i := 16 TO 31 DO x := x + T[i]; END_FOR;\n"
    inner += "END_FUNCTION_BLOCK\n"
    variables = VARIABLES + "fb : FB_I; other : FB_I;" + CONSTANTS
    regions = lines_by_region(unit("fb(x := x); other(x := y);", before=inner, variables=variables).cost.touches)
    found = {}
    for region, number in regions.items():
        found.setdefault(region.name, []).append(number)
    assert found["T"] == [4]
    assert found["A"] == [2, 2]
    assert len(found["FB_I variables"]) == 2


@pytest.mark.parametrize(
    ("body", "lines"),
    [("x := p^ + o^;", 2), ("FOR i := 0 TO 7 DO p := ADR(a[i]); x := x + p^; END_FOR;", 8)],
)
def test_pointers_may_point_anywhere_each_time(body, lines):
    """All that the pointers of a unit point to was one line."""
    found = unit(body, variables=VARIABLES + "p : POINTER TO LREAL; o : POINTER TO LREAL;")
    regions = {region.name: number for region, number in lines_by_region(found.cost.touches).items()}
    assert regions["pointer"] == lines


def test_tables_beyond_the_first_cache_wait_for_the_second_one_even_when_warm():
    def text(rows):
        return (
            f"FUNCTION_BLOCK FB_T VAR i : DINT; x : LREAL; END_VAR VAR CONSTANT T : ARRAY[0..{rows - 1}] OF LREAL := "
            f"[{rows}(1.5)]; END_VAR FOR i := 0 TO {rows - 1} DO x := x + T[i]; END_FOR; END_FUNCTION_BLOCK"
        )

    small, large = cost(text(1000)), cost(text(4000))
    assert large.warm_us > 4.2 * small.warm_us
    assert large.cold_us > large.warm_us


SETTER = "FUNCTION_BLOCK FB_S VAR_OUTPUT k : DINT; END_VAR k := k + 1; END_FUNCTION_BLOCK\n"


@pytest.mark.parametrize(
    ("body", "lines"),
    [("x := T[n]; fb(k => n); x := T[n];", 2), ("x := T[fb.k]; fb(); x := T[fb.k];", 2), ("x := T[n]; x := T[n];", 1)],
)
def test_a_call_moves_what_it_assigns(body, lines):
    found = lines_by_region(unit(body, before=SETTER, variables=VARIABLES + "fb : FB_S;" + CONSTANTS).cost.touches)
    assert {region.name: number for region, number in found.items()}["T"] == lines


def test_a_structure_that_is_copied_lies_in_as_many_lines_as_its_bytes():
    record = "TYPE ST_R : STRUCT a : ARRAY[0..15] OF LREAL; END_STRUCT END_TYPE\n"
    variables = VARIABLES + "records : ARRAY[0..9] OF ST_R; st : ST_R;" + CONSTANTS
    found = lines_by_region(unit("st := records[i];", before=record, variables=variables).cost.touches)
    # 128 bytes from anywhere, copied eight at a time
    assert counts("st := records[i];", before=record, variables=variables) == {"load": 1 + 16, "store": 16, "index": 1}
    assert {region.name: number for region, number in found.items()}["RECORDS"] == 3


@pytest.mark.parametrize(
    ("body", "regions"),
    [
        ("x := y;", {"FB_T variables"}),
        ("x := G;", {"FB_T variables", "G"}),
        ("i := fb.k;", {"FB_T variables", "K"}),
        ("x := a[i];", {"FB_T variables", "A"}),
    ],
)
def test_the_scalars_of_a_unit_are_one_region_and_all_else_is_its_own(body, regions):
    before = "VAR_GLOBAL G : LREAL; END_VAR\n" + SETTER
    found = unit(body, before=before, variables=VARIABLES + "fb : FB_S;" + CONSTANTS).cost.touches
    assert {touch.region.name for touch in found.values()} == regions


def reading(name, lines):
    """A block that reads a table of so many lines."""
    last = 8 * lines - 1
    return (
        f"FUNCTION_BLOCK {name} VAR i : DINT; x : LREAL; END_VAR VAR CONSTANT T : ARRAY[0..{last}] OF LREAL := "
        f"[{last + 1}(1.5)]; END_VAR FOR i := 0 TO {last} DO x := x + T[i]; END_FOR; END_FUNCTION_BLOCK\n"
    )


#: Lines of the tables of three blocks, of 20, 30 and 40 lines, that a call of FB_T touches at most.
BRANCHES = {
    "one(); two(); three();": 90,
    "IF b THEN one(); ELSE two(); END_IF;": 30,
    "IF b THEN one(); ELSIF c THEN two(); ELSE three(); END_IF;": 40,
    "IF b THEN one(); two(); ELSE three(); END_IF;": 50,
    "IF b THEN IF c THEN one(); ELSE two(); END_IF; ELSE three(); END_IF;": 40,
    "CASE i OF 0: one(); 1: three(); ELSE two(); END_CASE;": 40,
    "IF b THEN one(); RETURN; END_IF; three();": 40,
    "IF b THEN one(); END_IF; IF c THEN two(); END_IF;": 50,
    # what is touched on both ways, or before, is there whichever is taken
    "IF b THEN one(); ELSE two(); END_IF; one();": 50,
    "two(); IF b THEN one(); ELSE two(); END_IF;": 50,
    "IF b THEN one(); ELSE again(); END_IF;": 20,
    # rounds may take one branch after the other
    "FOR i := 1 TO 2 DO IF b THEN one(); ELSE two(); END_IF; END_FOR;": 50,
    "WHILE b DO IF c THEN one(); CONTINUE; END_IF; two(); END_WHILE;": 50,
    "outer();": 30,
    "IF b THEN outer(); ELSE three(); END_IF;": 40,
}


@pytest.mark.parametrize(("body", "lines"), BRANCHES.items(), ids=range(len(BRANCHES)))
def test_a_call_touches_the_tables_of_one_branch(body, lines):
    outer = "FUNCTION_BLOCK FB_O VAR b : BOOL; one : FB_1; two : FB_2; END_VAR\n"
    outer += "IF b THEN one(); ELSE two(); END_IF; END_FUNCTION_BLOCK\n"
    text = reading("FB_1", 20) + reading("FB_2", 30) + reading("FB_3", 40) + outer
    variables = VARIABLES + "one : FB_1; again : FB_1; two : FB_2; three : FB_3; outer : FB_O;"
    found = unit(body, variables=variables, before=text).cost.of_one_way()
    regions = lines_by_region(found.touches)
    assert sum(number for region, number in regions.items() if region.name == "T") == lines


CALLED = {
    "IF b THEN short(); ELSE long(); END_IF;": {"FB_L"},
    "IF b THEN short(); ELSE long(); END_IF; short();": {"FB_S", "FB_L"},
    "FOR i := 1 TO 2 DO IF b THEN short(); ELSE long(); END_IF; END_FOR;": {"FB_S", "FB_L"},
    "FOR i := 1 TO 2 DO short(); END_FOR; IF b THEN short(); ELSE long(); END_IF;": {"FB_S", "FB_L"},
    "IF b THEN FOR i := 1 TO 2 DO long(); END_FOR; ELSE short(); END_IF;": {"FB_L"},
    "outer();": {"FB_O", "FB_L"},
    # what is run at two places is counted
    "IF b THEN outer(); ELSE short(); END_IF;": {"FB_O", "FB_S", "FB_L"},
    "IF b THEN outer(); ELSE c := b; END_IF; short();": {"FB_O", "FB_S", "FB_L"},
}


@pytest.mark.parametrize(("body", "units"), CALLED.items(), ids=range(len(CALLED)))
def test_a_call_runs_the_code_of_one_branch(body, units):
    variables = "x : LREAL; y : LREAL;"
    text = block("x := y;", variables).replace("FB_T", "FB_S") + block(LONG, variables).replace("FB_T", "FB_L")
    outer = "IF b THEN short(); ELSE long(); END_IF;"
    text += block(outer, "b : BOOL; short : FB_S; long : FB_L;").replace("FB_T", "FB_O")
    found = unit(body, variables=VARIABLES + "short : FB_S; long : FB_L; outer : FB_O;", before=text).cost.of_one_way()
    assert found.code.keys() - {"FB_T"} == units
