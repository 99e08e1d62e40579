# ruff: noqa: E501 - a case a line
from __future__ import annotations

import dataclasses
from dataclasses import replace

import pytest

from st_codegen.errors import InputError
from st_codegen.st import StCheckError, parse_project, walk
from st_codegen.st import tree as t
from st_codegen.st.check.coercion import common_type, converts_implicitly
from st_codegen.st.dialects import IEC, TWINCAT
from st_codegen.st.types import DINT, INT, LREAL, NUMBERS, REAL
from tests.st.helpers import block, problems, project

VARIABLES = (
    "bX : BOOL; nX : DINT; nY : DINT; fX : LREAL; rX : REAL; iX : INT; uX : UDINT; wX : WORD; lX : LINT; tX : TIME;"
    " aX : ARRAY[0..2] OF LREAL; aM : ARRAY[1..2, 0..3] OF DINT; eX : E_Mode; stX : ST_A; fbX : FB_A; sX : STRING(5);"
    " pX : POINTER TO LREAL; uB : U_B;"
)
CONSTANTS = "END_VAR VAR CONSTANT N : DINT := 3;"
BEFORE = """
TYPE E_Mode : (Idle, Busy); E_Other : (Red); ST_A : STRUCT fA : LREAL; nA : DINT; END_STRUCT END_TYPE
TYPE U_B : UNION fV : LREAL; nV : ULINT; END_UNION END_TYPE
FUNCTION FC_A : DINT
VAR_INPUT a : DINT; b : LREAL := 1.0; END_VAR
VAR_IN_OUT io : DINT; END_VAR
VAR_OUTPUT o : DINT; END_VAR
FC_A := a; o := a;
END_FUNCTION
FUNCTION FC_N
VAR_INPUT a : DINT; END_VAR
END_FUNCTION
FUNCTION_BLOCK FB_A
VAR_INPUT fIn : LREAL; END_VAR
VAR_OUTPUT fOut : LREAL; END_VAR
VAR_IN_OUT nIo : DINT; END_VAR
VAR fOwn : LREAL; END_VAR
METHOD PRIVATE Hidden : BOOL
Hidden := TRUE;
END_METHOD
METHOD Open : BOOL
VAR_INPUT n : DINT; END_VAR
Open := n > 0;
END_METHOD
fOut := fIn;
END_FUNCTION_BLOCK
"""


def text(body: str) -> str:
    return block(body, VARIABLES + CONSTANTS, BEFORE)


BOTH = [
    ("nX := zz;", "unknown name 'zz'"),
    ("fX := zz.fOut;", "unknown name 'zz'"),
    ("zz.Open(n := 1);", "unknown name 'zz'"),
    ("fX := FB_A.fOut;", "unknown name 'FB_A'"),
    ("nX := nXX;", "unknown name 'nXX'; did you mean 'nX'?"),
    ("N := 1;", "'N' is a constant"),
    ("nX := fX;", "LREAL where DINT is needed: convert it with LREAL_TO_DINT"),
    ("rX := fX;", "LREAL where REAL is needed: convert it with LREAL_TO_REAL"),
    ("iX := nX;", "DINT where INT is needed: convert it with DINT_TO_INT"),
    ("uX := nX;", "DINT where UDINT is needed"),
    ("nX := bX;", "BOOL where DINT is needed"),
    ("bX := nX;", "DINT where BOOL is needed"),
    ("nX := 2.5;", "real literal where DINT is needed"),
    ("nX := 2147483648;", "2147483648 does not fit DINT"),
    ("iX := 16#FFFF;", "65535 does not fit INT"),
    ("nX := nX + bX;", "no operation between DINT and BOOL"),
    ("bX := bX + bX;", "no ADD of BOOL"),
    ("bX := bX < bX;", "BOOL values are compared with = and <> only"),
    ("fX := fX MOD 2.0;", "no MOD of LREAL"),
    ("nX := 5 / 0;", "division by zero in a constant"),
    ("fX := 1.0E300 * 1.0E300;", "overflow in a constant"),
    ("bX := NOT fX;", "no NOT of LREAL"),
    ("nX := -bX;", "no sign in front of BOOL"),
    ("bX := fX AND bX;", "no operation between LREAL and BOOL"),
    ("bX := nX AND_THEN bX;", "AND_THEN needs BOOL on both sides, not DINT and BOOL"),
    ("bX := eX = E_Other.Red;", "no operation between E_Mode and E_Other"),
    ("eX := E_Mode.Bussy;", "'E_Mode' has no value 'Bussy'; did you mean 'Busy'?"),
    ("eX := E_Nope#Busy;", "'E_Nope' is no enumeration"),
    ("stX.fAA := 1.0;", "'ST_A' has no field 'fAA'; did you mean 'fA'?"),
    ("nX := fX.a;", "LREAL has no members"),
    ("fX := fbX.fOwn;", "'fOwn' of 'FB_A' is VAR and cannot be read from outside"),
    ("fX := fbX.fNope;", "'FB_A' has no variable 'fNope'"),
    ("fbX.fOut := 1.0;", "'fOut' of 'FB_A' is VAR_OUTPUT and cannot be assigned from outside"),
    ("fX := aX[3];", "index 3 is outside of 0..2"),
    ("fX := aX[0, 1];", "has 1 dimension, not 2"),
    ("fX := aX[fX];", "an index is an integer, not LREAL"),
    ("fX := fX[0];", "LREAL is no array"),
    ("aX := aM;", "where ARRAY[0..2] OF LREAL is needed"),
    ("fX := fX^;", "LREAL cannot be dereferenced"),
    ("fbX := fbX;", "instances of 'FB_A' cannot be assigned"),
    ("FC_A(1, 2.0, nX) := 3;", None),
    ("nX := FC_A(1);", "the argument 'io' of 'FC_A' is missing"),
    ("nX := FC_A(io := nX);", "the argument 'a' of 'FC_A' is missing"),
    ("nX := FC_A(a := 1, a := 2, io := nX);", "'a' is given twice"),
    ("nX := FC_A(1, 2.0, nX, 4);", "'FC_A' takes 3 arguments, not 4"),
    ("nX := FC_A(aa := 1, io := nX);", "'FC_A' has no parameter 'aa'; did you mean 'a'?"),
    ("nX := FC_A(a := 1, io := 5);", "only a variable can be assigned"),
    ("nX := FC_A(a := 1, io := fX);", "'io' is DINT, not LREAL"),
    ("nX := FC_A(a := 1, io := N);", "'N' is a constant"),
    ("nX := FC_A(a := 1, io := nX, o := nX);", "'o' of 'FC_A' is VAR_OUTPUT: use =>"),
    ("nX := FC_A(a => nX, io := nX);", "'a' of 'FC_A' is VAR_INPUT: use :="),
    ("nX := FC_N(1);", "this call has no result"),
    ("nX := FC_AA(1);", "unknown function 'FC_AA'; did you mean 'FC_A'?"),
    ("nX := FB_A(1);", "'FB_A' is a function block: declare an instance"),
    ("fbX(1.0);", "arguments of 'FB_A' are given by name"),
    ("fbX(fIn := 1.0);", "the argument 'nIo' of 'FB_A' is missing"),
    ("fbX.Hidden();", "'Hidden' is a private method of 'FB_A'"),
    ("fbX.Nope();", "'FB_A' has no method 'Nope'"),
    ("nX();", "DINT cannot be called"),
    ("SIN(fX);", "the result of this function is not used"),
    ("fX := SIN(bX);", "SIN takes REAL or LREAL, not BOOL"),
    ("fX := SIN(fX, fX);", "SIN takes 1 argument, not 2"),
    ("fX := SIN(X := fX);", "not, or no longer, an argument of SIN(IN)"),
    ("nX := SIZEOF(nX);", "SIZEOF depends on how a target aligns memory"),
    ("nX := LEN(sX);", "functions of strings are not supported"),
    ("fX := FLOOR(fX);", "not supported: use TRUNC"),
    ("sX := DINT_TO_STRING(nX);", "conversions from and to strings are not supported"),
    ("sX := 'abcdef';", "a string of 6 characters does not fit STRING(5)"),
    ("sX := 5;", "integer literal where STRING(5) is needed"),
    ("IF nX THEN nX := zz; END_IF;", "a condition is BOOL, not DINT"),
    ("CASE fX OF 1: nX := 1; END_CASE;", "CASE selects by an integer or an enumeration, not by LREAL"),
    ("CASE nX OF 1, 3..5: nX := 1; 4: nX := 2; END_CASE;", "the label 4 stands in this CASE already"),
    ("CASE nX OF 5..3: nX := 1; END_CASE;", "the range 5..3 is empty"),
    ("CASE nX OF nY: nX := 1; END_CASE;", "only constants are allowed here"),
    ("FOR nX := 0 TO 3 DO nX := 1; END_FOR;", "'nX' counts the FOR loop around and cannot be assigned in it"),
    ("FOR nX := 0 TO 3 DO FOR nX := 0 TO 1 DO ; END_FOR; END_FOR;", "'nX' counts the FOR loop around"),
    ("FOR nX := 0 TO nY DO nY := 1; END_FOR;", "'nY' bounds this FOR loop and is assigned in it"),
    ("FOR nX := 0 TO 3 BY 0 DO ; END_FOR;", "a FOR loop with a step of zero never ends"),
    ("FOR fX := 0.0 TO 3.0 DO ; END_FOR;", "a FOR loop counts with an integer, not with LREAL"),
    ("FOR stX.nA := 0 TO 3 DO ; END_FOR;", "a FOR loop counts with a variable of its own unit"),
    ("EXIT;", "EXIT outside of a loop"),
    ("CONTINUE;", "CONTINUE outside of a loop"),
    ("SUPER^();", "'FB_T' extends nothing, so there is no SUPER^"),
    ("pX := 5;", "integer literal where POINTER TO LREAL is needed"),
    ("pX := ADR(5);", "ADR takes a variable"),
    ("pX := ADR(nX);", "POINTER TO DINT where POINTER TO LREAL is needed"),
    ("fX := REAL_TO_LREAL(fX);", "LREAL where REAL is needed"),
    ("tX := T#5ms + 1;", "integer literal where TIME is needed"),
    ("tX := T#1s * 1.5;", "a duration is multiplied and divided by integers"),
    ("fX := MIN(fX, bX);", "no operation between LREAL and BOOL"),
    ("nX := SEL(nX, 1, 2);", "DINT where BOOL is needed"),
    ("fX := MUX(fX, 1.0, 2.0);", "the first argument of MUX is an integer"),
    ("wX := SHL(wX, fX);", "SHL shifts by an integer, not by LREAL"),
    ("fX := EXPT(bX, 2.0);", "the base of a power is REAL or LREAL, not BOOL"),
    ("fX := LREAL#1.0E400;", None),
    ("fX := SUPER^;", "SUPER^ can only be called, or stand in front of a method"),
    ("WHILE 99999999999999999999 DO ; END_WHILE;", "99999999999999999999 fits no integer type"),
    ("sX := INT#'abc';", "a string is no INT"),
    ("bX := INT#TRUE;", "is no INT"),
    ("nX := FOO#5;", "'FOO#' is no type of numbers"),
    ("tX := T#99999999999d;", "this duration does not fit TIME"),
    ("stX := -stX;", "no - of ST_A"),
    ("nX := 1.5 MOD 2.0;", "MOD is for integers"),
    ("fX := EXPT(fX, bX);", "no power with an exponent of type BOOL"),
    ("stX := SEL(bX, stX, stX);", "SEL chooses between elementary values, not ST_A"),
    ("nX := LREAL_TO_DINT(1.0E10);", "conversion out of range: 10000000000.0 as DINT"),
    ("rX := LREAL_TO_REAL(1.0E300);", "conversion out of range: 1e+300 as REAL"),
]


@pytest.mark.parametrize(("body", "message"), [case for case in BOTH if case[1]])
@pytest.mark.parametrize("dialect", ["iec", "twincat"])
def test_errors_of_both_dialects(body: str, message: str, dialect: str) -> None:
    found = problems(text(body), dialect)
    assert any(message in problem for problem in found), found


# What only strict compilers refuse, and what it looks like when it is written out
STRICT = [
    ("lX := nX;", "lX := DINT_TO_LINT(nX);", "DINT where LINT is needed"),
    ("fX := rX;", "fX := REAL_TO_LREAL(rX);", "REAL where LREAL is needed"),
    ("fX := nX;", "fX := DINT_TO_LREAL(nX);", "DINT where LREAL is needed"),
    ("fX := 1;", "fX := 1.0;", "write a dot in the number"),
    ("fX := fX * 2;", "fX := fX * 2.0;", "write a dot in the number"),
    ("fX := 1 + 2.0;", "fX := 1.0 + 2.0;", "write a dot in both"),
    ("nX := nX + iX;", "nX := nX + INT_TO_DINT(iX);", "no operation between DINT and INT"),
    ("bX := nX < lX;", "bX := DINT_TO_LINT(nX) < lX;", "no operation between DINT and LINT"),
    ("fX := SIN(nX);", "fX := SIN(DINT_TO_LREAL(nX));", "SIN takes REAL or LREAL, not DINT"),
    ("nX := nX AND 3;", "wX := wX AND 3;", "no AND of DINT"),
    ("wX := wX + 1;", "nX := WORD_TO_DINT(wX) + 1;", "no ADD of WORD"),
    ("nX := SHL(nX, 1);", "wX := SHL(wX, 1);", "SHL takes a bit string, not DINT"),
    ("fX := TO_LREAL(nX);", "fX := DINT_TO_LREAL(nX);", "TO_LREAL is not portable"),
    ("fX := ATAN2(fX, fX);", "fX := ATAN(fX);", "ATAN2 is not in the standard"),
    ("bX := 1;", "bX := TRUE;", "integer literal where BOOL is needed"),
    ("nX := eX;", "eX := E_Mode#Busy;", "E_Mode where DINT is needed"),
    ("fX := WORD_TO_LREAL(wX);", "nX := WORD_TO_DINT(wX);", "gives different results on different controllers"),
    ("nX := TIME_TO_DINT(tX);", "tX := tX + T#1ms;", "gives different results on different controllers"),
    ("fbX.fIn := 1.0;", "fbX(fIn := 1.0, nIo := nX);", "the input 'fIn' of 'FB_A' is given in its call"),
]


@pytest.mark.parametrize(("loose", "strict", "message"), STRICT)
def test_the_strict_dialect_refuses_what_twincat_converts(loose: str, strict: str, message: str) -> None:
    found = problems(text(loose), "iec")
    assert any(message in problem for problem in found), found
    project(text(loose), "twincat")
    project(text(strict), "iec")


def test_own_inputs_are_read_only_in_the_strict_dialect() -> None:
    source = block("nIn := 1;", inputs="nIn : DINT;")
    assert problems(source, "iec") == ["'nIn' is an input and cannot be assigned"]
    project(source, "twincat")


def test_all_errors_are_reported_at_once_with_their_places() -> None:
    with pytest.raises(StCheckError) as caught:
        parse_project(
            {"a.st": text("nX := zz;\nIF nX THEN\n    bX := yy;\nEND_IF;"), "b.st": "FUNCTION F : X END_FUNCTION"}
        )
    found = [str(problem) for problem in caught.value.problems]
    assert len(found) == 4
    assert found[0].startswith("a.st:30:7 (FB_T): unknown name 'zz'")
    assert found[1].startswith("a.st:31:4 (FB_T): a condition is BOOL, not DINT")
    assert found[2].startswith("a.st:32:11 (FB_T): unknown name 'yy'")
    assert found[3] == "b.st:1:14 (F): unknown type 'X'"


# fmt: off
STRUCTURE = " TYPE S : STRUCT a : DINT; END_STRUCT END_TYPE"
DECLARATIONS = [
    ("FUNCTION F : DINT END_FUNCTION", "'F' never sets its result"),
    ("FUNCTION F : DINT F := F(); END_FUNCTION", "'F' calls itself: F -> F"),
    ("FUNCTION F : DINT F := G(); END_FUNCTION FUNCTION G : DINT G := F(); END_FUNCTION", "'F' calls itself: F -> G -> F"),
    ("FUNCTION_BLOCK A VAR b : B; END_VAR END_FUNCTION_BLOCK FUNCTION_BLOCK B VAR a : ARRAY[0..1] OF A; END_VAR"
     " END_FUNCTION_BLOCK", "'A' contains itself: A -> B -> A"),
    ("FUNCTION_BLOCK A EXTENDS A END_FUNCTION_BLOCK", "'A' extends itself"),
    ("FUNCTION_BLOCK A EXTENDS Nope END_FUNCTION_BLOCK", "'A' extends 'Nope', which is no known function block"),
    ("FUNCTION_BLOCK A METHOD M THIS^.M(); END_METHOD END_FUNCTION_BLOCK", "calls itself: A.M -> A.M"),
    ("TYPE S : STRUCT a : S; END_STRUCT END_TYPE", "the type 'S' contains itself"),
    ("TYPE S : STRUCT a : DINT; A : LREAL; END_STRUCT END_TYPE", "'A' is declared twice in 'S'"),
    ("TYPE S : STRUCT END_STRUCT END_TYPE", "'S' has no fields"),
    ("TYPE S EXTENDS DINT : STRUCT a : DINT; END_STRUCT END_TYPE", "'S' extends 'DINT', which is no known structure"),
    ("TYPE E : (A, B, a); END_TYPE", "'a' is declared twice in 'E'"),
    ("TYPE E : (A := 300) USINT; END_TYPE", "300 does not fit USINT"),
    ("TYPE E : (A := 127, B) SINT; END_TYPE", "128 does not fit SINT"),
    ("TYPE E : (A) LREAL; END_TYPE", "'LREAL' cannot be the base of an enumeration"),
    ("TYPE E : (A) := B; END_TYPE", "'E' has no value 'B'"),
    ("TYPE T : DINT(0..10); END_TYPE", "subrange types are not supported"),
    ("TYPE T : DATE; END_TYPE", "the type 'DATE' is not supported"),
    ("TYPE U : UNION a : LREAL; b : STRING; END_UNION END_TYPE", "STRING(80) in a union"),
    ("TYPE T : STRING(0); END_TYPE", "a string of 0 characters"),
    ("PROGRAM P VAR a : DINT; A : LREAL; END_VAR END_PROGRAM", "'A' is declared twice in 'P'"),
    ("PROGRAM P END_PROGRAM FUNCTION_BLOCK p END_FUNCTION_BLOCK", "'p' is declared already at a.st:1:9"),
    ("PROGRAM P VAR SIN : LREAL; END_VAR END_PROGRAM", "'SIN' is a word of the language"),
    ("PROGRAM P VAR DINT : LREAL; END_VAR END_PROGRAM", "'DINT' is a word of the language"),
    ("PROGRAM P VAR a : ARRAY[2..1] OF DINT; END_VAR END_PROGRAM", "a lower bound above the upper one"),
    ("PROGRAM P VAR a : ARRAY[0..1.5] OF DINT; END_VAR END_PROGRAM", "an integer constant is needed"),
    ("PROGRAM P VAR n : DINT; a : ARRAY[0..n] OF DINT; END_VAR END_PROGRAM", "only constants are allowed here"),
    ("PROGRAM P VAR a : ARRAY[0..999999999] OF DINT; END_VAR END_PROGRAM", "has more than"),
    ("PROGRAM P VAR CONSTANT A : DINT := B; B : DINT := A; END_VAR END_PROGRAM", "is needed to declare itself"),
    ("PROGRAM P VAR a : DINT := 1.5; END_VAR END_PROGRAM", "real literal where DINT is needed"),
    ("PROGRAM P VAR a : DINT := [1]; END_VAR END_PROGRAM", "DINT has a single value"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF DINT := [1, 2, 3]; END_VAR END_PROGRAM", "has 2 elements; this initialiser has 3"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF DINT := [5(0)]; END_VAR END_PROGRAM", "this initialiser goes beyond them"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF DINT := [1, 2.5]; END_VAR END_PROGRAM", "a table of integer and real literals cannot"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF SINT := [1, 200]; END_VAR END_PROGRAM", "200 does not fit SINT"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF BOOL := [1, 2]; END_VAR END_PROGRAM", "cannot initialise BOOL"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF REAL := [1.0, 1.0E39]; END_VAR END_PROGRAM", "larger than the largest REAL"),
    ("PROGRAM P VAR a : REAL := 1.0E39; END_VAR END_PROGRAM", "larger than the largest REAL"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF TIME := [1, 2]; END_VAR END_PROGRAM", "numbers cannot initialise TIME"),
    ("PROGRAM P VAR a : TIME := T#1us; END_VAR END_PROGRAM", None),
    ("PROGRAM P VAR a : Q; END_VAR END_PROGRAM PROGRAM Q END_PROGRAM", "'Q' is a program; there is only one of it"),
    ("FUNCTION F VAR a : B; END_VAR END_FUNCTION FUNCTION_BLOCK B END_FUNCTION_BLOCK", "would not outlive the call"),
    ("FUNCTION F : B END_FUNCTION FUNCTION_BLOCK B END_FUNCTION_BLOCK", "cannot return an instance of 'B'"),
    ("FUNCTION F VAR_IN_OUT a : DINT := 1; END_VAR END_FUNCTION", "VAR_IN_OUT has no initial value"),
    ("PROGRAM P VAR CONSTANT a : B; END_VAR END_PROGRAM FUNCTION_BLOCK B END_FUNCTION_BLOCK", "'a' cannot be CONSTANT"),
    ("PROGRAM P VAR a : B := (x := 1); END_VAR END_PROGRAM FUNCTION_BLOCK B END_FUNCTION_BLOCK", "'B' has no variable 'x'"),
    ("PROGRAM P VAR_GLOBAL a : DINT; END_VAR END_PROGRAM", "VAR_GLOBAL cannot stand in 'P'"),
    ("FUNCTION_BLOCK A VAR_IN_OUT x : DINT; END_VAR METHOD M x := 1; END_METHOD END_FUNCTION_BLOCK",
     "a method cannot use 'x': VAR_IN_OUT of a block exists only while the block is called"),
    ("FUNCTION_BLOCK A VAR x : DINT; END_VAR END_FUNCTION_BLOCK FUNCTION_BLOCK B EXTENDS A VAR X : DINT; END_VAR"
     " END_FUNCTION_BLOCK", "'X' is declared already in 'A'"),
    ("FUNCTION_BLOCK A METHOD M VAR_INPUT a : DINT; END_VAR END_METHOD END_FUNCTION_BLOCK FUNCTION_BLOCK B EXTENDS A"
     " METHOD M END_METHOD END_FUNCTION_BLOCK", "'M' has other parameters or another result than the method it overrides"),
    ("FUNCTION_BLOCK A METHOD M END_METHOD METHOD m END_METHOD END_FUNCTION_BLOCK", "'m' is declared twice in 'A'"),
    ("FUNCTION F THIS^.a := 1; END_FUNCTION", "THIS^ and SUPER^ exist only in function blocks"),
    ("FUNCTION_BLOCK A VAR i : DINT; END_VAR METHOD M i := 3; END_METHOD FOR i := 0 TO 1 DO M(); END_FOR;"
     " END_FUNCTION_BLOCK", "'A.M' assigns 'i', which counts this loop"),
    ("PROGRAM P VAR a : REFERENCE TO DINT := 5; END_VAR END_PROGRAM", "pointers and references have no initial value"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF ARRAY[0..1] OF DINT := [1, 2]; END_VAR END_PROGRAM", "initialised row by row: [[..], [..]]"),
    ("PROGRAM P VAR a : S := 5; END_VAR END_PROGRAM" + STRUCTURE, "this is no initial value of S"),
    ("PROGRAM P VAR a : ARRAY[0..1] OF S := [1, 2]; END_VAR END_PROGRAM" + STRUCTURE, "numbers cannot initialise S"),
    ("PROGRAM P VAR a : S := (b := 1); END_VAR END_PROGRAM" + STRUCTURE, "'S' has no field 'b'"),
    ("PROGRAM P VAR a : S := (a := 1, a := 2); END_VAR END_PROGRAM" + STRUCTURE, "'a' is given twice"),
    ("PROGRAM P VAR b : B := (x := 1); END_VAR END_PROGRAM FUNCTION_BLOCK B VAR CONSTANT x : DINT := 0; END_VAR"
     " END_FUNCTION_BLOCK", "'x' of 'B' cannot be initialised"),
    ("FUNCTION_BLOCK A END_FUNCTION_BLOCK FUNCTION_BLOCK B EXTENDS A SUPER^.M(); END_FUNCTION_BLOCK",
     "SUPER^ has no method 'M'"),
    ("FUNCTION F : DINT F := TO_DINT(a); END_FUNCTION VAR_GLOBAL a : S; END_VAR" + STRUCTURE, "no conversion from S"),
    ("FUNCTION F : BOOL F := TIME_TO_BOOL(T#1s); END_FUNCTION", "no conversion from TIME to BOOL"),
]
# fmt: on


@pytest.mark.parametrize(("source", "message"), [case for case in DECLARATIONS if case[1]])
def test_errors_of_declarations(source: str, message: str) -> None:
    with pytest.raises(StCheckError) as caught:
        parse_project({"a.st": source}, "twincat")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("type_", "expression", "value"),
    [
        ("DINT", "7 MOD 3", 1), ("DINT", "-7 MOD 3", -1), ("DINT", "-7 / 2", -3), ("DINT", "-(3 + 4)", -7),
        ("DINT", "DINT#2147483647 + 1", -2147483648), ("INT", "DINT_TO_INT(70001)", 4465),
        ("DINT", "REAL_TO_DINT(REAL#2.5)", 2), ("LREAL", "DINT_TO_LREAL(7)", 7.0), ("LREAL", "-SIN(0.0) + 1.5", 1.5),
        ("WORD", "NOT WORD#16#00F0", 0xFF0F), ("BOOL", "NOT TRUE", False), ("BOOL", "1.5 < 2.0", True),
        ("BOOL", "BOOL#1 AND 3 <> 3", False), ("DINT", "+5", 5),
        ("DINT", "7 MOD 0", "division by zero"), ("LREAL", "1.0 / 0.0", "division by zero"),
        ("DINT", "DINT#-2147483648 / DINT#-1", "integer overflow"),
        ("DINT", "DINT#-2147483648 MOD DINT#-1", "integer overflow"),
        ("LREAL", "SQRT(-1.0)", "invalid operation"), ("REAL", "REAL#1.0E38 * REAL#1.0E38", "overflow"),
    ],
)  # fmt: skip
def test_constants_are_computed(type_: str, expression: str, value: object) -> None:
    source = f"PROGRAM P VAR CONSTANT c : {type_} := {expression}; END_VAR END_PROGRAM"
    if isinstance(value, str):
        assert problems(source) == [f"{value} in a constant"]
    else:
        assert project(source).pous["P"].variables[0].initial == value


def test_durations_of_twincat_are_whole_milliseconds() -> None:
    assert problems("PROGRAM P VAR a : TIME := T#1us; END_VAR END_PROGRAM") == [
        "TIME counts whole milliseconds here: use LTIME#"
    ]
    project("PROGRAM P VAR a : TIME := T#1us; END_VAR END_PROGRAM", "iec")


def test_initialisers_are_complete_in_the_strict_dialect() -> None:
    arrays = "a : ARRAY[0..3] OF DINT := [1, 2]; b : ARRAY[0..3] OF DINT := [N, 2];"
    source = f"PROGRAM P VAR {arrays} END_VAR VAR CONSTANT N : DINT := 1; END_VAR END_PROGRAM"
    assert [message.split(",")[1] for message in problems(source, "iec")] == [" and only 2 initial values"] * 2
    project(source, "twincat")
    real = "PROGRAM P VAR a : ARRAY[0..1] OF LREAL := [1, 2.5]; END_VAR END_PROGRAM"
    assert "write a dot in every number" in problems(real, "iec")[0]
    project(real, "twincat")


def test_a_wrong_declaration_is_reported_once_however_often_it_is_used() -> None:
    found = problems("PROGRAM P VAR a : Nope; b : DINT; END_VAR b := a; b := a; a := 1; END_PROGRAM")
    assert found == ["unknown type 'Nope'"]


def test_globals_are_found_with_and_without_their_list() -> None:
    gvl = "VAR_GLOBAL nG : DINT; nH : DINT; END_VAR"
    other = "VAR_GLOBAL nH : DINT; END_VAR"
    program = "PROGRAM P nG := A.nH + B.nH; END_PROGRAM"
    parse_project({"A.st": gvl, "B.st": other, "P.st": program})
    with pytest.raises(StCheckError, match="unknown name 'nH'"):
        parse_project({"A.st": gvl, "B.st": other, "P.st": "PROGRAM P nG := nH; END_PROGRAM"})
    with pytest.raises(StCheckError, match="unknown name 'nG'"):
        parse_project({"A.st": "{attribute 'qualified_only'}\n" + gvl, "P.st": "PROGRAM P nG := 1; END_PROGRAM"})
    with pytest.raises(StCheckError, match="'A' has no variable 'nX'"):
        parse_project({"A.st": gvl, "P.st": "PROGRAM P nG := A.nX; END_PROGRAM"})


def test_enumeration_values_need_their_type_where_it_says_so() -> None:
    program = "PROGRAM P VAR eX : E; END_VAR eX := {}; END_PROGRAM"
    loose = "TYPE E : (A, B); END_TYPE "
    strict = "TYPE {attribute 'qualified_only'} E : (A, B); END_TYPE "
    project(loose + program.format("B"))
    project(strict + program.format("E.B"))
    assert problems(strict + program.format("B")) == ["unknown name 'B'"]
    assert problems(loose + "TYPE F : (B, C); END_TYPE " + program.format("B")) == ["unknown name 'B'"]


def test_units_and_variables_are_the_same_only_where_they_are_one() -> None:
    """They are keys of tables; two of equal content are still two."""
    unit = project(text("fX := 1.0;")).pous["FB_T"]
    for item in (unit, *unit.variables):
        other = dataclasses.replace(item)
        assert other != item
        assert len({item, other}) == 2


def test_implicit_conversions_become_nodes() -> None:
    body = project(text("fX := nX + iX;\nrX := 1.5;\nfX := rX;")).pous["FB_T"].body
    first = body[0]
    assert isinstance(first, t.Assign)
    assert isinstance(first.value, t.Conversion)
    assert first.value.type == LREAL
    total = first.value.operand
    assert isinstance(total, t.Binary)
    assert total.type == total.left.type == total.right.type == DINT
    assert total.overflow is t.Overflow.ERROR
    assert isinstance(total.right, t.Conversion)
    assert isinstance(body[1].value, t.Constant)
    assert (body[1].value.type, body[1].value.value) == (REAL, 1.5)


def test_every_node_of_the_typed_tree_has_a_settled_type() -> None:
    body = "nX := SEL(nY > 2 * 3, 4, 5) + 16#10; fX := MIN(1.5, 2.5, fX) * 2;"
    body += "FOR nX := 1 TO 2 * 3 BY 1 DO aX[2 - 1] := 1; END_FOR;"
    for part in walk.all_expressions(project(text(body)).pous["FB_T"].body):
        assert not getattr(part.type, "is_untyped", False), part


def test_stored_sums_wrap_and_others_do_not() -> None:
    body = (
        project(text("nX := nX + nY * 2 - (-nX); bX := nX + nY > 3; nX := nX / (nX + 1); lX := lX + lX;"))
        .pous["FB_T"]
        .body
    )
    wraps = [
        part.overflow for part in walk.all_expressions(body) if isinstance(part, t.Binary) and part.operator == "ADD"
    ]
    assert wraps == [t.Overflow.WRAP, t.Overflow.ERROR, t.Overflow.ERROR, t.Overflow.WRAP]


def test_constants_and_bounds_are_folded() -> None:
    source = """
PROGRAM P
VAR CONSTANT
    N : DINT := 2 + M * 3;
    M : DINT := 4;
    F : LREAL := SQRT(16.0) / 2.0;
    E : E_A := E_A.B;
    COPY : ARRAY[0..1] OF DINT := TABLE;
    TABLE : ARRAY[0..1] OF DINT := [M, N];
END_VAR
VAR a : ARRAY[-N..N, E_A.B..10] OF DINT; END_VAR
END_PROGRAM
TYPE E_A : (A, B := 7) DINT; END_TYPE
"""
    variables = {
        variable.name: variable for variable in project(source.replace("E_A.B..10", "1..10")).pous["P"].variables
    }
    assert [variables[name].initial for name in ("N", "M", "F", "E")] == [14, 4, 2.0, 7]
    assert variables["COPY"].initial.tolist() == [4, 14]
    assert variables["a"].type.bounds == ((-14, 14), (1, 10))


def test_initial_values_of_structures_and_blocks() -> None:
    source = """
TYPE A : STRUCT x : DINT := 5; y : LREAL; z : ARRAY[0..2] OF INT := [1, 2(7)]; END_STRUCT; T : DINT := 9; END_TYPE
FUNCTION_BLOCK B VAR_INPUT n : DINT := 3; END_VAR VAR q : A := (y := 2.0); END_VAR END_FUNCTION_BLOCK
PROGRAM P VAR a : ARRAY[0..1] OF A := [(x := 1), (y := 3.0)]; b : B := (n := 8); c : T; d : T := 4; END_VAR END_PROGRAM
"""
    variables = {variable.name: variable.initial for variable in project(source).pous["P"].variables}
    assert [item["X"] for item in variables["a"]] == [1, 5]
    assert [item["Y"] for item in variables["a"]] == [0.0, 3.0]
    assert variables["a"][0]["Z"].tolist() == [1, 7, 7]
    assert variables["b"] == {"N": 8}
    assert (variables["c"], variables["d"]) == (9, 4)


def test_lineage_of_blocks() -> None:
    source = """
FUNCTION_BLOCK A VAR_INPUT x : DINT; END_VAR METHOD M END_METHOD METHOD N END_METHOD END_FUNCTION_BLOCK
FUNCTION_BLOCK B EXTENDS A VAR_OUTPUT y : DINT; END_VAR METHOD M END_METHOD END_FUNCTION_BLOCK
"""
    checked = project(source)
    assert [pou.name for pou in checked.lineage("b")] == ["B", "A"]
    assert [variable.name for variable in checked.block_variables("B")] == ["x", "y"]


@pytest.mark.parametrize(
    ("source", "target", "allowed"),
    [
        (INT, DINT, True),
        (DINT, INT, False),
        (DINT, NUMBERS["UDINT"], False),
        (NUMBERS["UDINT"], DINT, False),
        (INT, REAL, True),
        (DINT, REAL, False),
        (DINT, LREAL, True),
        (REAL, LREAL, True),
        (LREAL, REAL, False),
    ],
)
def test_implicit_conversions_of_twincat_lose_nothing(source: object, target: object, allowed: bool) -> None:
    assert converts_implicitly(source, target, TWINCAT) is allowed
    assert converts_implicitly(source, target, IEC) is False


def test_common_type_is_the_smallest_that_holds_both() -> None:
    assert common_type(INT, DINT, TWINCAT) is DINT
    assert common_type(REAL, DINT, TWINCAT) is LREAL
    assert common_type(REAL, INT, TWINCAT) is REAL
    assert common_type(DINT, INT, IEC) is None


def test_a_sign_and_no_sign_have_a_common_type_only_where_one_holds_the_other() -> None:
    assert common_type(DINT, NUMBERS["UDINT"], TWINCAT) is None  # no documentation says which type TwinCAT computes in
    assert common_type(NUMBERS["UDINT"], INT, TWINCAT) is None
    assert common_type(TWINCAT.types["UINT"], DINT, TWINCAT) is DINT
    source = block("b := n < w;", "b : BOOL; n : DINT; w : DWORD;")
    assert problems(source, "twincat") == ["no operation between DINT and DWORD: convert one of them"]


def test_untyped_real_literals_are_lreal_in_twincat_and_adapt_in_the_standard() -> None:
    source = text("rX := rX * 2.0;")
    assert problems(source, "twincat") == ["LREAL where REAL is needed: convert it with LREAL_TO_REAL"]
    project(source, "iec")


def test_unused_expressions_and_wrong_calls_do_not_hide_later_errors() -> None:
    assert len(problems(text("nX := zz; nY := yy; fbX(); xx();"))) == 4


def test_of_very_many_problems_the_rest_is_counted() -> None:
    with pytest.raises(StCheckError, match=r"^52 problems\n(.*\n){50}  and 2 more$") as caught:
        project(text(" ".join(f"x{number}();" for number in range(52))))
    assert len(caught.value.problems) == 52


RULES = [
    ("has_widening", block("x := n;", "x : LREAL; n : DINT;"), "convert it with DINT_TO_LREAL"),
    ("has_loose_literals", block("x := 1;", "x : LREAL;"), "write a dot in the number"),
    ("has_numeric_bits", block("u := w + 1;", "u : UINT; w : WORD;"), "no ADD of WORD"),
    ("has_numeric_bits", block("n := NOT n;", "n : DINT;"), "no NOT of DINT"),
    ("has_partial_initialisers", block("", "a : ARRAY[0..2] OF DINT := [1, 2];"), "only 2 initial values"),
    ("has_assignable_inputs", block("n := 1;", inputs="n : DINT;"), "'n' is an input and cannot be assigned"),
    (
        "has_open_programs",
        block("n := P.m;", "n : DINT;", "PROGRAM P VAR m : DINT; END_VAR END_PROGRAM"),
        "cannot be read from outside",
    ),
]


@pytest.mark.parametrize(("rule", "source", "message"), RULES)
def test_the_table_of_a_dialect_decides(rule: str, source: str, message: str) -> None:
    """The checker asks for single rules, so that a dialect with any choice of them works."""
    assert parse_project({"t.st": source}, TWINCAT)
    with pytest.raises(StCheckError, match=message):
        parse_project({"t.st": source}, replace(TWINCAT, **{rule: False}))
    assert parse_project({"t.st": source}, replace(IEC, **{rule: True, "has_partial_initialisers": True}))


def test_functions_are_refused_by_the_patterns_of_the_table() -> None:
    source = block("x := LN(x) + TO_LREAL(n);", "x : LREAL; n : DINT;")
    dialect = replace(TWINCAT, refused_functions={"LOG|LN": "is not here", r"TO_\w+": "is not there"})
    with pytest.raises(StCheckError, match="LN is not here"):
        parse_project({"t.st": source}, dialect)
    with pytest.raises(StCheckError, match="TO_LREAL is not there"):
        parse_project({"t.st": source.replace("LN(x)", "x")}, dialect)


def test_an_unknown_dialect_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="unknown dialect 'logo': known are codesys, iec, scl, twincat"):
        parse_project({"t.st": block("")}, "logo")


STANDARD = [
    ("fX := ABS(fX); nX := ABS(nX); rX := ABS(rX);", ""),
    ("bX := ABS(bX);", "no ABS of BOOL"),
    ("wX := ABS(wX);", "no ABS of WORD"),
    ("nX := ADD(nX, nX, nX);", ""),
    ("nX := ADD(nX, bX);", "no operation between DINT and BOOL"),
    ("nX := ADD(IN1 := nX, IN2 := nX, IN3 := nX, IN4 := nX);", ""),
    ("nX := ADD(IN1 := nX, IN2 := nX, IN4 := nX);", "'IN4' is not, or no longer, an argument of ADD(IN1, IN2, IN3)"),
    ("nX := MUX(nX, nX, nX, nX);", ""),
    ("nX := MUX(K := nX, IN0 := nX, IN1 := nX, IN2 := nX);", ""),
    ("nX := MUX(nX, nX, bX);", "no operation between DINT and BOOL"),
    ("nX := MUX(K := nX, IN0 := nX, IN2 := nX);", "'IN2' is not, or no longer, an argument of MUX(K, IN0, IN1)"),
    ("nX := MUX(fX, nX, nX);", "the first argument of MUX is an integer, not LREAL"),
    ("nX := SEL(bX, nX, nX);", ""),
    ("nX := SEL(nX, nX, nX);", "DINT where BOOL is needed"),
    ("fX := SEL(bX, nX, nX);", "DINT where LREAL is needed"),
    ("wX := SHL(wX, nX);", ""),
    ("wX := SHL(wX, fX);", "SHL shifts by an integer, not by LREAL"),
    ("fX := SHL(fX, nX);", "SHL takes a bit string, not LREAL"),
    ("nX := MAX(nX, nY, nX);", ""),
    ("bX := MAX(bX, bX);", "no MAX of BOOL"),
    ("nX := SUB(nX, nX, nX);", "SUB takes 2 arguments, not 3"),
]


@pytest.mark.parametrize(("body", "message"), STANDARD)
def test_standard_functions_take_what_the_standard_says(body: str, message: str) -> None:
    if not message:
        parse_project({"t.st": text(body)}, IEC)
        return
    (found,) = problems(text(body), "iec")
    assert found.startswith(message)
