"""Rows that take different ways, compared with the same algorithm in plain Python, row by row."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from st_codegen.st import Machine, StRuntimeError
from tests.st.helpers import block, project

ROWS = np.arange(-20, 60)


def collatz(n: int) -> tuple[int, int]:
    steps = largest = 0
    while n > 1:
        n = n // 2 if n % 2 == 0 else 3 * n + 1
        largest = max(largest, n)
        steps += 1
        if steps >= 100:
            break
    return steps, largest


COLLATZ = """
nCurrent := n; nOut := 0; nOther := 0;
WHILE nCurrent > 1 DO
    IF nCurrent MOD 2 = 0 THEN nCurrent := nCurrent / 2; ELSE nCurrent := 3 * nCurrent + 1; END_IF;
    nOther := MAX(nOther, nCurrent);
    nOut := nOut + 1;
    IF nOut >= 100 THEN EXIT; END_IF;
END_WHILE;
"""


def nested(n: int) -> tuple[int, int]:
    total = rounds = 0
    for i in range(1, 8):
        if (n + i) % 5 == 0:
            continue
        for j in range(n % 3, 6):
            rounds += 1
            if (i * j + n) % 7 == 3:
                break
            if (i + j + n) % 4 == 1:
                continue
            total += i * j
            if total > 60:
                return total, rounds
        if i == 6 and n % 2 == 0:
            break
    return total - 1, rounds


NESTED = """
nOut := 0; nOther := 0;
FOR i := 1 TO 7 DO
    IF (n + 100 + i) MOD 5 = 0 THEN CONTINUE; END_IF;
    FOR j := (n + 99) MOD 3 TO 5 DO
        nOther := nOther + 1;
        IF (i * j + n + 70) MOD 7 = 3 THEN EXIT; END_IF;
        IF (i + j + n + 40) MOD 4 = 1 THEN CONTINUE; END_IF;
        nOut := nOut + i * j;
        IF nOut > 60 THEN RETURN; END_IF;
    END_FOR;
    IF i = 6 AND n MOD 2 = 0 THEN EXIT; END_IF;
END_FOR;
nOut := nOut - 1;
"""


def counters(n: int) -> tuple[int, int]:
    i = n % 4
    stop, step = (n % 9, 1) if n % 2 else (-(n % 5), -2)
    rounds = 0
    while (i <= stop) if step > 0 else (i >= stop):
        rounds += 10
        if rounds > 40:
            break
        i += step
    return rounds, i


COUNTERS = """
nOut := 0;
IF (n + 100) MOD 2 = 1 THEN nStop := (n + 90) MOD 9; nStep := 1; ELSE nStop := -((n + 100) MOD 5); nStep := -2; END_IF;
FOR i := (n + 100) MOD 4 TO nStop BY nStep DO
    nOut := nOut + 10;
    IF nOut > 40 THEN EXIT; END_IF;
END_FOR;
nOther := i;
"""


def repeats(n: int) -> tuple[int, int]:
    x, rounds = n, 0
    while True:
        rounds += 1
        if x % 3 != 0 or rounds >= 20:
            x += 7
            if x % 11 == 0:
                break
        else:
            x -= 1
        if x > 50 or rounds > 25:
            break
    return x, rounds


REPEATS = """
nOut := n; nOther := 0;
REPEAT
    nOther := nOther + 1;
    IF (nOut + 300) MOD 3 = 0 AND nOther < 20 THEN nOut := nOut - 1; CONTINUE; END_IF;
    nOut := nOut + 7;
    IF (nOut + 330) MOD 11 = 0 THEN EXIT; END_IF;
UNTIL nOut > 50 OR nOther > 25
END_REPEAT;
"""


def cases(n: int) -> tuple[int, int]:
    state = visited = 0
    x = n % 13
    for _ in range(12):
        visited = visited * 2 % 100003 + state
        if state == 0:
            state = 2 if x > 6 else 1
        elif state == 1:
            x += 3
            state = 3 if x > 9 else 1
        elif state in (2, 4, 5):
            x -= 1
            if x == 5:
                return x, visited
            state = 5 if x % 2 else 3
        else:
            break
    return x, visited


CASES = """
nOther := 0; nState := 0; nOut := (n + 130) MOD 13;
FOR i := 1 TO 12 DO
    nOther := (nOther * 2) MOD 100003 + nState;
    CASE nState OF
        0: IF nOut > 6 THEN nState := 2; ELSE nState := 1; END_IF;
        1: nOut := nOut + 3; nState := SEL(nOut > 9, 1, 3);
        2, 4..5:
            nOut := nOut - 1;
            IF nOut = 5 THEN RETURN; END_IF;
            IF (nOut + 100) MOD 2 = 1 THEN nState := 5; ELSE nState := 3; END_IF;
    ELSE
        EXIT;
    END_CASE;
END_FOR;
"""
VARIABLES = (
    "nOut : DINT; nOther : DINT; nCurrent : DINT; i : DINT; j : DINT; nStop : DINT; nStep : DINT; nState : DINT;"
)


@pytest.mark.parametrize(
    ("body", "reference"),
    [(COLLATZ, collatz), (NESTED, nested), (COUNTERS, counters), (REPEATS, repeats), (CASES, cases)],
    ids=["collatz", "nested", "counters", "repeats", "cases"],
)
def test_rows_do_what_plain_python_does(body: str, reference: Callable[[int], tuple[int, int]]) -> None:
    instance = Machine(project(block(body, VARIABLES, inputs="n : DINT;")), len(ROWS)).instance("FB_T")
    instance(n=ROWS)
    expected = [reference(int(n)) for n in ROWS]
    assert [(int(a), int(b)) for a, b in zip(instance["nOut"], instance["nOther"], strict=True)] == expected
    assert len(set(expected)) > 10


def test_constant_tables_are_stored_once() -> None:
    text = block(
        "FOR i := 0 TO 2 DO nOut := nOut + T[i]; END_FOR; f := x;",
        "nOut : DINT; i : DINT; f : LREAL; END_VAR VAR CONSTANT T : ARRAY[0..2] OF DINT := [1, 2, 3];",
        inputs="x : LREAL;",
    )
    machine = Machine(project(text), 1000)
    instance = machine.instance("FB_T")
    instance(x=np.arange(1000.0))
    assert instance["T"].shape == (1000, 3)
    assert instance._memory.stride == 32  # x, nOut, i, f


FAULTY = {
    "IF n > 0 THEN f := 1.0 / INT_TO_LREAL(n); ELSE f := -1.0; END_IF;": "f := 1.0 / INT_TO_LREAL(n);",
    "IF n > 0 THEN f := LN(INT_TO_LREAL(n)); END_IF;": "f := LN(INT_TO_LREAL(n));",
    "IF n >= 0 AND_THEN n <= 3 THEN f := t[n]; END_IF;": "f := t[n];",
    "WHILE n <> 0 DO f := 1.0 / INT_TO_LREAL(n); EXIT; END_WHILE;": "f := 1.0 / INT_TO_LREAL(n);",
    "CASE n OF 0..3: f := t[n]; END_CASE;": "f := t[n];",
    "IF n <= 0 THEN RETURN; END_IF; f := SQRT(INT_TO_LREAL(n));": "f := SQRT(INT_TO_LREAL(n));",
    "FOR i := 1 TO 3 DO IF n = 0 THEN EXIT; END_IF; k := 10 / n; END_FOR;": "k := 10 / n;",
    "b := n = 0 OR_ELSE 10 / n > 2;": "b := 10 / n > 2;",
}


@pytest.mark.parametrize("guarded", FAULTY)
def test_nothing_is_raised_for_rows_that_a_branch_excludes(guarded: str) -> None:
    variables = "f : LREAL; t : ARRAY[0..3] OF LREAL; i : DINT; k : INT; b : BOOL;"
    values = np.array([-2, 0, 1, 2, 3, 7], np.int16)
    if "t[n]" not in guarded:
        values = np.array([-2, 0, 1, 2, 3, 7], np.int16)
    machine = Machine(project(block(guarded, variables, inputs="n : INT;")), len(values))
    machine.instance("FB_T")(n=values)
    with pytest.raises(StRuntimeError):
        Machine(project(block(FAULTY[guarded], variables, inputs="n : INT;")), len(values)).instance("FB_T")(n=values)


def test_the_row_of_an_error_is_its_number_in_the_machine() -> None:
    text = block(
        "IF n > 10 THEN\n    IF n MOD 2 = 0 THEN\n        k := 100 / (n - 14);\n    END_IF;\nEND_IF;",
        "k : DINT;",
        inputs="n : DINT;",
    )
    with pytest.raises(StRuntimeError) as caught:
        Machine(project(text), 20).instance("FB_T")(n=np.arange(20))
    assert (caught.value.row, caught.value.operands, caught.value.position.line) == (14, (100, 0), 7)


def test_an_index_out_of_range_names_row_index_bounds_and_position() -> None:
    text = block("f := t[n];", "f : LREAL; t : ARRAY[-1..3] OF LREAL;", inputs="n : DINT;")
    with pytest.raises(StRuntimeError) as caught:
        Machine(project(text), 3).instance("FB_T")(n=np.array([0, 4, 9]))
    assert str(caught.value) == "t.st:5:8 (FB_T): index out of range: 4 is outside of -1..3, row 1"


@pytest.mark.parametrize(
    "body", ["WHILE n >= 0 DO ; END_WHILE;", "REPEAT ; UNTIL n < 0 END_REPEAT;", "FOR u := 0 TO 255 DO ; END_FOR;"]
)
def test_endless_loops_are_stopped_where_they_stand(body: str) -> None:
    text = block("\n" + body, "u : USINT;", inputs="n : DINT;")
    machine = Machine(project(text), 4, loop_limit=500)
    with pytest.raises(StRuntimeError) as caught:
        machine.instance("FB_T")(n=np.array([-1, -2, 3, 4]))
    error = caught.value
    assert (error.kind, error.detail, error.position.line) == ("loop limit", "more than 500 rounds", 6)
    assert error.row == (0 if "FOR" in body else 2)


def test_loops_up_to_the_limit_are_fine() -> None:
    text = block("FOR i := 1 TO 500 DO k := k + 1; END_FOR;", "i : DINT; k : DINT;")
    machine = Machine(project(text), 2, loop_limit=500)
    instance = machine.instance("FB_T")
    instance()
    assert instance["k"].tolist() == [500, 500]


@pytest.mark.parametrize("workers", [1, 2, 3, 7])
def test_results_do_not_depend_on_the_number_of_threads(workers: int) -> None:
    text = block("y := x * DINT_TO_LREAL(n); z := 100 / n;", "y : LREAL; z : DINT;", inputs="x : LREAL; n : DINT;")
    rng = np.random.default_rng(2)
    x, n = rng.normal(size=5000), rng.integers(1, 50, 5000)
    instance = Machine(project(text), 5000, workers=workers).instance("FB_T")
    instance(x=x, n=n)
    assert instance["y"].tolist() == (x * n).tolist()
    assert instance["z"].tolist() == (100 // n).tolist()
    n[[700, 3100, 4999]] = 0
    with pytest.raises(StRuntimeError) as caught:
        instance(x=x, n=n)
    assert (caught.value.row, caught.value.operands) == (700, (100, 0))
