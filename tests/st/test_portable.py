# ruff: noqa: E501 - a case a line
from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st import StCheckError
from st_codegen.st.check import portable
from st_codegen.st.syntax.scan import Segment
from st_codegen.st.syntax.source import read_texts
from tests.st.helpers import violations

GOOD = """
(* a forest *)
TYPE T_Row : ARRAY[0..2] OF LREAL; END_TYPE
TYPE ST_State : STRUCT fA : LREAL; nB : DINT; END_STRUCT END_TYPE
FUNCTION FC_Sum : LREAL
VAR_INPUT aX : T_Row; END_VAR
VAR i : DINT; END_VAR
FC_Sum := 0.0;
FOR i := 0 TO 2 DO
    FC_Sum := FC_Sum + aX[i];
END_FOR;
END_FUNCTION
FUNCTION_BLOCK FB_Rf
VAR_INPUT
    fSpeed : LREAL; (* rpm *)
END_VAR
VAR_OUTPUT
    fOut1 : LREAL;
    bValid : BOOL;
END_VAR
VAR
    aX : T_Row;
    nNode : DINT;
    fSingle : REAL;
    stState : ST_State := (fA := 1.0, nB := 2);
    aZero : ARRAY[0..3] OF LREAL := [0.0, 0.0, 0.0, 0.0];
END_VAR
VAR CONSTANT
    THRESHOLD : ARRAY[0..3] OF LREAL := [0.5, 1.0E-300, -2.5, 7.0];
END_VAR
IF fSpeed < 1.0 OR fSpeed > -1.0 THEN
    aX[0] := fSpeed * 1.0E37;
    nNode := nNode + 1;
    fSingle := LREAL_TO_REAL(FC_Sum(aX) + THRESHOLD[0]);
    fOut1 := REAL_TO_LREAL(fSingle);
    bValid := TRUE;
ELSE
    bValid := FALSE;
END_IF;
END_FUNCTION_BLOCK
"""


def messages(text: str) -> list[str]:
    return [problem.message for problem in violations(read_texts({"a.st": text}))]


def test_the_emitted_style_is_portable() -> None:
    assert messages(GOOD) == []


BLOCK = "FUNCTION_BLOCK FB_A VAR {} END_VAR {} END_FUNCTION_BLOCK"
VARIABLES = "x : LREAL; r : REAL; n : DINT; i : INT; w : WORD; b : BOOL; a : ARRAY[0..1] OF LREAL;"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("// line\nPROGRAM P END_PROGRAM", "a comment of the form //"),
        ("(* a (* b *) *) PROGRAM P END_PROGRAM", "a comment of the form (* (* *) *)"),
        ("{attribute 'hide'} PROGRAM P END_PROGRAM", "pragmas and attributes are not portable"),
        (BLOCK.format(VARIABLES, "IF b THEN n := 1; END_IF"), "'END_IF' is not followed by a semicolon"),
        (BLOCK.format(VARIABLES, "FOR n := 0 TO 1 DO ; END_FOR"), "'END_FOR' is not followed by a semicolon"),
        (BLOCK.format(VARIABLES, "x := 1E5;"), "'1E5' is a real literal without a dot"),
        (BLOCK.format(VARIABLES, "x := x ** 2.0;"), "'**' is not portable"),
        (BLOCK.format(VARIABLES, "FOR n := 0 TO 1 DO CONTINUE; END_FOR;"), "'CONTINUE' is not portable"),
        (BLOCK.format(VARIABLES, "b := b AND_THEN b;"), "'AND_THEN' is not portable"),
        (BLOCK.format(VARIABLES, "b := b OR_ELSE b;"), "'OR_ELSE' is not portable"),
        (BLOCK.format("n__x : DINT;", ""), "'n__x' has two underscores in a row"),
        (BLOCK.format("p : POINTER TO LREAL;", ""), "'POINTER TO' is not portable"),
        (BLOCK.format("p : REFERENCE TO LREAL;", ""), "'REFERENCE TO' is not portable"),
        (BLOCK.format(VARIABLES + " p : POINTER TO LREAL;", "p := ADR(x);"), "'ADR(' is not portable"),
        ("FUNCTION FLOOR : LREAL VAR_INPUT x : LREAL; END_VAR FLOOR := x; END_FUNCTION", "'FLOOR' is no standard function"),
        ("FUNCTION TANH : LREAL VAR_INPUT x : LREAL; END_VAR TANH := x; END_FUNCTION", "'TANH' is no standard function"),
        (BLOCK.format("a : ARRAY[0..1] OF LREAL := [2(0.0)];", ""), "the initialiser 2(..) is not portable"),
        (BLOCK.format("x AT %I* : LREAL;", ""), "an address needs a number"),
        (BLOCK.format(VARIABLES, "x := 1.0E-38;"), "the literal 1e-38 is outside of"),
        (BLOCK.format(VARIABLES, "x := 1.1E37;"), "the literal 1.1e+37 is outside of"),
        (BLOCK.format("a : ARRAY[0..N] OF LREAL; END_VAR VAR CONSTANT N : DINT := 3;", ""), "the bounds of an array are numbers"),
        (BLOCK.format("a : ARRAY[0..1+1] OF LREAL;", ""), "the bounds of an array are numbers"),
        (BLOCK.format("a : ARRAY[0..1] OF ARRAY[0..1] OF LREAL;", ""), "arrays of arrays are not portable"),
        ("TYPE S : STRUCT x : LREAL; END_STRUCT END_TYPE " + BLOCK.format("a : ARRAY[0..1] OF S := [(x := 1.0), (x := 2.0)];", ""),
         "arrays of structures with initial values are not portable"),
        ("TYPE S : STRUCT x : LREAL; y : LREAL; END_STRUCT END_TYPE " + BLOCK.format("a : S := (x := 1.0);", ""),
         "'a': no initial value for 1 field"),
        ("FUNCTION F : DINT VAR_INPUT a : ARRAY[0..1] OF DINT; END_VAR F := a[0]; END_FUNCTION", "its array type needs a name"),
        ("TYPE T : ARRAY[0..1] OF DINT; END_TYPE FUNCTION F : DINT VAR_INPUT q : T; END_VAR F := q[0]; END_FUNCTION "
         + BLOCK.format("a : ARRAY[0..1] OF DINT; n : DINT;", "n := F(a);"), "'a' is passed: its array type needs a name"),
        ("TYPE T : ARRAY[0..1] OF DINT; END_TYPE " + BLOCK.format("a : T;", ""), "the type 'T' says only what a plain array says"),
        ("VAR_GLOBAL n : DINT; END_VAR", "VAR_GLOBAL outside of a CONFIGURATION"),
        ("FUNCTION F : DINT VAR CONSTANT A : ARRAY[0..1] OF DINT := [1, 2]; END_VAR F := A[0]; END_FUNCTION",
         "the table 'A' belongs into the VAR CONSTANT of a block"),
        (BLOCK.format("A : ARRAY[0..1] OF DINT := [1, 2];", ""), "the table 'A' is not CONSTANT"),
        ("FUNCTION_BLOCK A METHOD M END_METHOD END_FUNCTION_BLOCK", "the method 'M' is not portable"),
        ("FUNCTION_BLOCK A END_FUNCTION_BLOCK FUNCTION_BLOCK B EXTENDS A SUPER^(); END_FUNCTION_BLOCK", "'EXTENDS' is not portable"),
        ("TYPE U : UNION a : LREAL; b : LWORD; END_UNION END_TYPE", "'UNION' is not portable"),
        (BLOCK.format(VARIABLES, "i := i + 1;"), "arithmetic of INT differs between compilers: use DINT"),
        (BLOCK.format(VARIABLES, "FOR i := 0 TO 1 DO ; END_FOR;"), "a FOR loop counts with INT: use DINT"),
        (BLOCK.format(VARIABLES, "r := r * 2.0 + r;"), "arithmetic of REAL differs between targets"),
        (BLOCK.format(VARIABLES, "IF r + r > 1.0 THEN r := 0.0; END_IF;"), "arithmetic of REAL differs between"),
        (BLOCK.format(VARIABLES, "b := x = x;"), "a number is compared with itself"),
        (BLOCK.format(VARIABLES, "b := a[n] <> a[n];"), "a number is compared with itself"),
        (BLOCK.format(VARIABLES, "r := SIN(r);"), "SIN of REAL: compute in LREAL and convert"),
        (BLOCK.format(VARIABLES, "n := LREAL_TO_DINT(x);"), "LREAL_TO_DINT depends on how .5 rounds: use TRUNC"),
    ],
)  # fmt: skip
def test_every_rule_finds_its_violation(text: str, message: str) -> None:
    found = messages(text)
    assert any(message in problem for problem in found), found


@pytest.mark.parametrize(
    "text",
    [
        BLOCK.format("s : STRING := '// ** 1E5 { END_IF';", ""),
        BLOCK.format(VARIABLES, "w := w AND 16#1E5;"),
        BLOCK.format(VARIABLES, "n := TRUNC(x); b := NOT b; w := NOT w;"),
        BLOCK.format("a : ARRAY[-1..1] OF LREAL; _x_1 : LREAL;", "x : LREAL;"[:0]),
        "TYPE T : ARRAY[0..1] OF DINT; END_TYPE FUNCTION F : T F[0] := 1; END_FUNCTION",
    ],
)
def test_what_only_looks_like_a_violation_is_fine(text: str) -> None:
    assert messages(text) == []


def test_violations_have_their_place() -> None:
    (problem,) = violations(
        read_texts({"a.st": "FUNCTION_BLOCK A\nVAR x : LREAL; END_VAR\n  x := 2E5;\nEND_FUNCTION_BLOCK"})
    )
    assert str(problem) == "a.st:3:8 (A): '2E5' is a real literal without a dot"


NUMBERS = ", ".join(["-1.5E3"] * 20)


def test_violations_beside_and_in_long_tables_are_found() -> None:
    table = "VAR CONSTANT\n  T : ARRAY[0..20] OF LREAL := [{numbers}, {last}];\nEND_VAR\n"
    unit = "FUNCTION_BLOCK {name}\n" + table + "VAR x : LREAL; END_VAR\nx := {value};\nEND_FUNCTION_BLOCK\n"
    text = unit.format(name="A", numbers=NUMBERS, last="1.0", value="2E5")
    text += unit.format(name="B", numbers=NUMBERS, last="3E5", value="4E5")
    assert [str(problem) for problem in violations(read_texts({"a.st": text}))] == [
        f"a.st:{place}' is a real literal without a dot"
        for place in ("6:6 (A): '2E5", f"10:{33 + len(NUMBERS) + 2} (B): '3E5", "13:6 (B): '4E5")
    ]


@given(
    s.lists(s.sampled_from(["[", "]", ", ", "1", ".", "E5", "-", " ", "__", "x", "**", "TO", NUMBERS, f"[{NUMBERS}]"]))
)
def test_nothing_that_is_refused_stands_in_a_list_of_numbers(pieces: list[str]) -> None:
    text = "".join(pieces)
    for pattern, _ in portable._REFUSED:
        parts = (match.span() for span in Segment(text, "a.st").spans for match in pattern.finditer(text, *span))
        assert list(parts) == [match.span() for match in pattern.finditer(text)]


def test_text_that_the_checker_refuses_is_refused() -> None:
    with pytest.raises(StCheckError, match="where LREAL is needed"):
        messages(BLOCK.format("x : LREAL; n : DINT;", "x := n;"))
