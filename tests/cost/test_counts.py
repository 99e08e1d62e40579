"""The worst path of small programs, counted by hand."""

import pytest

from st_codegen.cost.units import Units
from st_codegen.st import Machine
from tests.cost.helpers import CONSTANTS, PROFILE, VARIABLES, block, counts, project, unit

STATEMENTS = {
    # assignments and expressions
    "x := y;": {"load": 1, "store": 1},
    "x := 1.0;": {"load": 1, "store": 1},
    "i := 1;": {"store": 1},
    "i := L;": {"store": 1},
    "x := W;": {"load": 1, "store": 1},
    "x := x + y * 2.0 - x / y;": {"load": 5, "store": 1, "add": 2, "multiply": 1, "divide": 1},
    "i := i + 1;": {"load": 1, "store": 1, "integer": 1},
    "i := i * n / m MOD 3;": {"load": 3, "store": 1, "integer_multiply": 1, "integer_divide": 2},
    "x := -x;": {"load": 1, "store": 1, "integer": 1},
    "b := NOT b AND c OR b;": {"load": 3, "store": 1, "integer": 3},
    "b := x < y;": {"load": 2, "store": 1, "real_compare": 1},
    "b := i >= n;": {"load": 2, "store": 1, "compare": 1},
    "b := b AND_THEN c;": {"load": 2, "store": 1, "branch": 1},
    "x := a[3];": {"load": 1, "store": 1},
    "x := a[i];": {"load": 2, "store": 1, "index": 1},
    "a[i + 1] := x;": {"load": 2, "store": 1, "index": 1, "integer": 1},
    "x := q[i, n];": {"load": 3, "store": 1, "index": 2},
    "x := T[K[i]];": {"load": 3, "store": 1, "index": 2},
    "r := LREAL_TO_REAL(x);": {"load": 1, "store": 1, "convert": 1},
    "x := DINT_TO_LREAL(i);": {"load": 1, "store": 1, "convert": 1},
    "i := TRUNC(x);": {"load": 1, "store": 1, "convert": 1},
    "x := SQRT(x) + EXP(y) + LN(x);": {"load": 3, "store": 1, "add": 2, "sqrt": 1, "exp": 1, "ln": 1},
    "x := SIN(x) * COS(x) / ATAN(y);": {
        "load": 3,
        "store": 1,
        "multiply": 1,
        "divide": 1,
        "sin": 1,
        "cos": 1,
        "atan": 1,
    },
    "x := MAX(MIN(x, y), 0.0);": {"load": 3, "store": 1, "select": 2},
    "x := LIMIT(0.0, x, 1.0);": {"load": 3, "store": 1, "select": 2},
    "x := SEL(b, x, y);": {"load": 3, "store": 1, "select": 1},
    "x := ABS(x);": {"load": 1, "store": 1, "integer": 1},
    "a := s;": {"load": 8, "store": 8},
    # branches: the slower side
    "IF b THEN x := y; END_IF;": {"load": 2, "store": 1, "branch": 1},
    "IF b THEN x := y; ELSE x := SQRT(y); END_IF;": {"load": 2, "store": 1, "branch": 1, "sqrt": 1},
    "IF b THEN x := SQRT(y); ELSIF c THEN x := y; END_IF;": {"load": 2, "store": 1, "branch": 1, "sqrt": 1},
    "IF b THEN i := 1; ELSIF c THEN x := x / y; ELSE i := 2; END_IF;": {
        "load": 4,
        "store": 1,
        "branch": 2,
        "divide": 1,
    },
    "CASE i OF 1: x := y; 2, 4..6: x := SQRT(y); ELSE i := 0; END_CASE;": {
        "load": 2,
        "store": 1,
        "compare": 4,
        "branch": 3,
        "sqrt": 1,
    },
    # loops: counter, test and jump of each round, and the last test
    "FOR i := 0 TO 3 DO x := x + 1.0; END_FOR;": {"load": 8, "store": 5, "add": 4, "loop": 5},
    "FOR i := 7 TO 0 BY -2 DO x := y; END_FOR;": {"load": 4, "store": 5, "loop": 5},
    "FOR i := 3 TO 0 DO x := y; END_FOR;": {"store": 1, "loop": 1},
    "FOR i := 0 TO 1 DO FOR n := 0 TO L - 1 DO x := y; END_FOR; END_FOR;": {
        "load": 10,
        "store": 1 + 2 + 10,
        "loop": 3 + 2 * 6,
        "integer": 2,
    },
    # a round that leaves is the last one: three whole rounds and a test, or four whole ones
    "FOR i := 0 TO 3 DO IF b THEN EXIT; END_IF; x := y; END_FOR;": {"load": 8, "store": 5, "branch": 4, "loop": 5},
    "FOR i := 0 TO 3 DO IF b THEN x := SQRT(y); EXIT; END_IF; END_FOR;": {
        "load": 5,
        "store": 2,
        "branch": 4,
        "loop": 4,
        "sqrt": 1,
    },
    # the only round may leave, too
    "FOR i := 0 TO 0 DO IF b THEN x := SQRT(y); EXIT; END_IF; END_FOR;": {
        "load": 2,
        "store": 2,
        "branch": 1,
        "loop": 1,
        "sqrt": 1,
    },
    "FOR i := 0 TO 3 DO IF b THEN CONTINUE; END_IF; x := y; END_FOR;": {"load": 8, "store": 5, "branch": 4, "loop": 5},
    "i := 0; WHILE i < 3 DO i := i + 1; END_WHILE;": {"load": 7, "store": 4, "compare": 4, "branch": 4, "integer": 3},
    "i := 0; WHILE b AND i < 3 DO i := i + 1; END_WHILE;": {
        "load": 11,
        "store": 4,
        "compare": 4,
        "branch": 4,
        "integer": 7,
    },
    "i := 5; REPEAT i := i - 2; UNTIL i <= 0 END_REPEAT;": {
        "load": 6,
        "store": 4,
        "compare": 3,
        "branch": 3,
        "integer": 3,
    },
    # what cannot be reached costs nothing
    "x := y; RETURN; x := SQRT(y);": {"load": 1, "store": 1},
    "IF b THEN RETURN; END_IF; x := y;": {"load": 2, "store": 1, "branch": 1},
    "IF b THEN x := SQRT(y); RETURN; END_IF; x := y;": {"load": 2, "store": 1, "branch": 1, "sqrt": 1},
}


@pytest.mark.parametrize(("body", "expected"), STATEMENTS.items(), ids=range(len(STATEMENTS)))
def test_hand_counts(body, expected):
    assert counts(body) == expected
    assert not unit(body).unbounded


FUNCTION = "FUNCTION F : LREAL VAR_INPUT u : LREAL; v : LREAL; END_VAR F := u / v; END_FUNCTION\n"
INNER = """FUNCTION_BLOCK FB_I
VAR_INPUT u : LREAL; END_VAR VAR_OUTPUT w : LREAL; END_VAR VAR_IN_OUT z : LREAL; END_VAR
w := SQRT(u);
z := w;
END_FUNCTION_BLOCK
"""


def test_calls_are_followed():
    # arguments: two loads, two stores; body: two loads, a division, a store; call and result
    assert counts("x := F(x, y);", before=FUNCTION) == {"load": 5, "store": 4, "divide": 1, "call": 1}
    inner = counts(
        "fb(u := x, z := y, w => x); y := fb.w;", before=INNER, variables=VARIABLES + "fb : FB_I;" + CONSTANTS
    )
    # u: load, store; z: its address stored; body: load, root, store, then load, address of z, store;
    # w => x: load, store; and a load and a store behind it
    assert inner == {"load": 1 + 3 + 1 + 1, "store": 2 + 2 + 1 + 1, "sqrt": 1, "call": 1}


def test_a_virtual_call_costs_its_worst_override():
    blocks = """FUNCTION_BLOCK FB_A
    METHOD Run : LREAL Run := 1.0; END_METHOD
    METHOD Go : LREAL Go := Run(); END_METHOD
    END_FUNCTION_BLOCK
    FUNCTION_BLOCK FB_B EXTENDS FB_A
    METHOD Run : LREAL Run := EXP(1.0); END_METHOD
    END_FUNCTION_BLOCK
    """
    assert counts("x := fb.Go();", before=blocks, variables="x : LREAL; fb : FB_A;")["exp"] == 1


BOUNDED = {
    "FOR i := 0 TO K[n] DO x := SQRT(x); END_FOR;": 5,
    "FOR i := 0 TO MIN(n, 9) DO x := SQRT(x); END_FOR;": 10,
    "m := 4; FOR i := 0 TO m DO x := SQRT(x); END_FOR;": 5,
    "IF b THEN m := 4; ELSE m := 6; END_IF; FOR i := 0 TO m DO x := SQRT(x); END_FOR;": 7,
    "FOR m := 1 TO 3 DO FOR i := 0 TO m DO x := SQRT(x); END_FOR; END_FOR;": 12,
    "FOR i := ROWS[n] TO ROWS[n + 1] - 1 DO x := SQRT(x); END_FOR;": 40,
    "FOR i := ROWS[n + 1] + 2 TO ROWS[n + 2] DO x := SQRT(x); END_FOR;": 39,
    "FOR i := 0 TO n MOD 4 DO x := SQRT(x); END_FOR;": 4,
    # K[n] is 1..4: what is computed from it, at the ends that make the most rounds
    "FOR i := 1 TO K[n] * 3 DO x := SQRT(x); END_FOR;": 12,
    "FOR i := 1 TO (K[n] - 2) * (K[n] - 5) DO x := SQRT(x); END_FOR;": 4,
    "FOR i := 1 TO 9 / K[n] DO x := SQRT(x); END_FOR;": 9,
    "FOR i := 1 TO (2 - K[n] * 3) / (-2) DO x := SQRT(x); END_FOR;": 5,
    "FOR i := K[n] / (-2) TO 0 DO x := SQRT(x); END_FOR;": 3,
    "FOR i := 1 TO 9 / (K[n] - 2) DO x := SQRT(x); END_FOR;": None,
    "FOR i := 1 TO K[n] MOD 3 DO x := SQRT(x); END_FOR;": 2,
    "FOR i := -K[n] TO 0 DO x := SQRT(x); END_FOR;": 5,
    "FOR i := 1 TO MAX(K[n], 6) DO x := SQRT(x); END_FOR;": 6,
    "FOR i := MAX(K[n], 3) TO 4 DO x := SQRT(x); END_FOR;": 2,
    "FOR i := MIN(K[n], 3) TO 4 DO x := SQRT(x); END_FOR;": 4,
    "FOR i := 1 TO LIMIT(2, n, 6) DO x := SQRT(x); END_FOR;": 6,
    "FOR i := LIMIT(2, n, 6) TO 6 DO x := SQRT(x); END_FOR;": 5,
    "FOR i := 1 TO SEL(b, K[n], 7) DO x := SQRT(x); END_FOR;": 7,
    "FOR i := SEL(b, K[n] + 2, 3) TO 7 DO x := SQRT(x); END_FOR;": 5,
    "FOR i := 1 TO ABS(K[n] - 6) DO x := SQRT(x); END_FOR;": 5,
    "FOR i := 1 TO MUX(K[n], 9, 9, 9, 9, 9) DO x := SQRT(x); END_FOR;": None,
    "FOR i := 0 TO 9 BY K[n] DO x := SQRT(x); END_FOR;": 10,
    "FOR i := 9 TO 0 BY -K[n] DO x := SQRT(x); END_FOR;": 10,
    # a step that may be zero, or anything, or from anywhere
    "FOR i := 0 TO 9 BY K[n] - 1 DO x := SQRT(x); END_FOR;": None,
    "FOR i := 9 TO 0 BY 1 - K[n] DO x := SQRT(x); END_FOR;": None,
    "FOR i := 0 TO 9 BY n DO x := SQRT(x); END_FOR;": None,
    "FOR i := n TO 9 DO x := SQRT(x); END_FOR;": None,
    "i := 0; n := 99; WHILE i < n DO m := (i + n) / 2; IF T[m] < x THEN i := m + 1; ELSE n := m; END_IF;"
    " x := SQRT(x); END_WHILE;": None,
    "i := 0; WHILE b AND i <= 7 DO x := SQRT(x); i := i + 2; END_WHILE;": 4,
    "i := 9; WHILE NOT (i < 1 OR b) DO x := SQRT(x); i := i - 3; END_WHILE;": 3,
    "WHILE b DO x := SQRT(x); END_WHILE;": None,
    "FOR i := 0 TO n DO x := SQRT(x); END_FOR;": None,
    "i := 0; WHILE i < 3 DO IF b THEN CONTINUE; END_IF; i := i + 1; x := SQRT(x); END_WHILE;": None,
    "i := 0; WHILE i < n DO i := i + 1; n := n + 1; x := SQRT(x); END_WHILE;": None,
}


@pytest.mark.parametrize(("body", "rounds"), BOUNDED.items(), ids=range(len(BOUNDED)))
def test_bounds_of_loops_are_derived_or_missed_aloud(body, rounds):
    found = unit(body)
    if rounds is None:
        assert "no bound known for the rounds of this" in found.unbounded[0]
        assert "FB_T, " in found.unbounded[0]
    else:
        assert found.unbounded == ()
        assert counts(body)["sqrt"] == rounds


METHODS = """VAR_GLOBAL G : DINT; END_VAR
FUNCTION_BLOCK FB_G G := 9; END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_O VAR_OUTPUT w : DINT; END_VAR w := 9; END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_T
VAR i : DINT; n : DINT; m : DINT; x : LREAL; fb : FB_G; o : FB_O; p : POINTER TO DINT; END_VAR
{} FOR i := 0 TO {} DO x := SQRT(x); END_FOR; {}
METHOD Set n := 9; END_METHOD
END_FUNCTION_BLOCK
"""


@pytest.mark.parametrize(
    ("before", "limit", "behind", "is_bounded"),
    [
        ("n := 4;", "n", "", True),
        ("n := 4; Set();", "n", "", False),
        ("n := 4; o(w => n);", "n", "", False),
        ("n := 4; p := ADR(n); p^ := 9;", "n", "", False),
        ("G := 4; fb();", "G", "", False),
        ("n := 4; FOR m := 0 TO 1 DO", "n", "x := x + 1.0; END_FOR;", True),
        ("n := 4; FOR m := 0 TO 1 DO", "n", "Set(); END_FOR;", False),
        ("n := 4; FOR m := 0 TO 1 DO", "n", "o(w => n); END_FOR;", False),
    ],
)
def test_a_bound_is_known_only_while_nothing_else_can_assign_it(before, limit, behind, is_bounded):
    checked = project(METHODS.format(before, limit, behind))
    found = Units(checked, PROFILE).of("FB_T")
    assert bool(found.unbounded) is not is_bounded


@pytest.mark.parametrize("loop", ["WHILE b DO {} END_WHILE;", "REPEAT {} UNTIL b END_REPEAT;"])
def test_what_a_loop_assigns_is_known_neither_at_its_start_nor_behind_it(loop):
    """Rounds that follow of a number are those of this number in the first round, or behind none, only."""
    body = "FOR m := 0 TO n DO y := y + 1.0; END_FOR;"
    assert len(unit("n := 3; " + loop.format("x := y;") + body).unbounded) == 1
    assert len(unit("n := 3; " + loop.format("n := 1;") + body).unbounded) == 2
    assert len(unit("n := 3; " + loop.format(body)).unbounded) == 1
    assert len(unit("n := 3; " + loop.format(body + "n := i;")).unbounded) == 2


def test_a_search_that_halves_is_bounded():
    body = (
        "i := 0; n := 99; WHILE i < n DO m := (i + n) / 2; IF T[m] < x THEN i := m + 1; ELSE n := m; END_IF; END_WHILE;"
    )
    found = unit(body)
    assert found.unbounded == ()
    # 99 candidates: 7 rounds, and no input needs more
    assert counts(body)["branch"] == 7 + 8
    text = block(
        body.replace("m := (i + n) / 2;", "m := (i + n) / 2; nRounds := nRounds + 1;"),
        VARIABLES + "nRounds : DINT;" + "END_VAR VAR CONSTANT T : ARRAY[0..99] OF LREAL := [50(0.0), 50(1.0)];",
    )
    machine = Machine(project(text))
    for x in (-1.0, 0.5, 2.0):
        instance = machine.instance("FB_T")
        instance["x"] = x
        instance()
        assert instance["nRounds"] <= 7


SEARCH = "i := 0; n := 99; WHILE i {} n DO m := {}; IF T[m] < x THEN i := {}; ELSE n := {}; END_IF; END_WHILE;"


@pytest.mark.parametrize(
    ("compare", "middle", "low", "high", "is_bounded"),
    [
        ("<", "(i + n) / 2", "m + 1", "m", True),
        ("<", "(n + i) / 2", "m + 1", "m - 1", True),
        ("<=", "(i + n) / 2", "m + 1", "m - 1", True),
        ("<=", "(i + n) / 2", "m + 1", "m", False),
        ("<", "(i + n) / 2", "m", "m", False),
        ("<", "(i + n) / 2", "m + 1", "m + 1", False),
        ("<", "(i + n) / 2", "m - 1", "m", False),
        ("<", "(i + n) / 2", "n + 1", "m", False),
        ("<", "(i + n) / 3", "m + 1", "m", False),
        ("<", "(i - n) / 2", "m + 1", "m", False),
        ("<", "(i + i) / 2", "m + 1", "m", False),
    ],
)
def test_only_a_search_that_leaves_half_is_bounded(compare, middle, low, high, is_bounded):
    assert (unit(SEARCH.format(compare, middle, low, high)).unbounded == ()) is is_bounded


def test_a_search_whose_middle_is_an_element_is_not_bounded():
    body = SEARCH.format("<", "(i + n) / 2", "m + 1", "m").replace("m :=", "k[0] :=")
    assert unit(
        body, variables=f"{VARIABLES} k : ARRAY[0..3] OF DINT; END_VAR VAR CONSTANT T : ARRAY[0..99] OF LREAL;"
    ).unbounded


def test_no_run_takes_more_rounds_than_the_bound():
    """Loops with derived bounds, run on many values of what is not known."""
    bodies = [body for body, rounds in BOUNDED.items() if rounds is not None]
    for body in bodies:
        text = block(body.replace("x := SQRT(x);", "x := x + 1.0;"), VARIABLES + CONSTANTS)
        machine = Machine(project(text), rows=8)
        instance = machine.instance("FB_T")
        instance["n"] = list(range(4)) * 2
        instance["b"] = [False] * 4 + [True] * 4
        instance()
        assert max(instance["x"]) <= BOUNDED[body]
