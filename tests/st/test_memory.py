# ruff: noqa: E501 - a case a line
"""Structures, unions, references, instances and methods, in one copy and in rows."""

from __future__ import annotations

import gc
import math
import os
import struct
import weakref
from pathlib import Path

import numpy as np
import pytest

from st_codegen.st import Machine, StCheckError, StRuntimeError, StUsageError, parse_project
from tests.st.helpers import block, project, run

UNION = "TYPE U : UNION fValue : LREAL; nBits : ULINT; wBits : LWORD; aBytes : ARRAY[0..7] OF BYTE; aHalf : ARRAY[0..1] OF UDINT; rLow : REAL; nInt : INT; END_UNION END_TYPE"


def bits_of(value: float) -> int:
    return struct.unpack("<Q", struct.pack("<d", value))[0]


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, -2.5, math.inf, math.nan, 5e-324, 1e308])
def test_a_union_is_one_piece_of_memory(value: float) -> None:
    body = "u.fValue := f; n := u.nBits; w := u.wBits; b := u.aBytes[7]; h := u.aHalf[1];"
    text = block(body, "u : U; n : ULINT; w : LWORD; b : BYTE; h : UDINT;", UNION, "f : LREAL;")
    bits = bits_of(value)
    assert run(text, ("n", "w", "b", "h"), f=value) == (bits, bits, bits >> 56, bits >> 32)


def test_a_union_written_in_parts() -> None:
    body = "u.nBits := n; u.aBytes[i] := 16#FF; f := u.fValue; k := u.nInt;"
    text = block(body, "u : U; f : LREAL; k : INT;", UNION, "n : ULINT; i : DINT;")
    bits = bits_of(1.5)
    f, k = run(text, ("f", "k"), n=bits, i=0)
    assert (bits_of(f), k) == (bits | 0xFF, 0xFF)


def test_nan_test_on_bits_never_compares_a_nan() -> None:
    body = "u.fValue := f; bNan := (u.wBits AND 16#7FF0000000000000) = 16#7FF0000000000000 AND (u.wBits AND 16#000FFFFFFFFFFFFF) <> 0;"
    text = block(body, "u : U; bNan : BOOL;", UNION, "f : LREAL;")
    assert [run(text, "bNan", f=value) for value in (1.0, math.inf, -math.inf, math.nan, 5e-324)] == [
        False,
        False,
        False,
        True,
        False,
    ]


def test_a_union_differs_between_rows() -> None:
    text = block(
        "IF n > 1 THEN u.fValue := f; END_IF; w := u.nBits;", "u : U; w : ULINT;", UNION, "f : LREAL; n : DINT;"
    )
    instance = Machine(project(text), 4).instance("FB_T")
    values = np.array([1.0, 2.0, 3.0, -4.0])
    instance(f=values, n=np.arange(4))
    assert instance["w"].tolist() == [0, 0, bits_of(3.0), bits_of(-4.0)]
    assert instance["u.aBytes"].shape == (4, 8)
    assert instance["u"]["fValue"].tolist() == [0.0, 0.0, 3.0, -4.0]


def test_bits_of_real_numbers_are_kept_when_they_are_moved() -> None:
    text = block("u.nBits := n; v.rLow := u.rLow; k := v.nBits;", "u : U; v : U; k : ULINT;", UNION, "n : ULINT;")
    assert run(text, "k", n=0x7F800001) == 0x7F800001


STRUCTS = """
TYPE ST_In : STRUCT fA : LREAL := 1.0; aN : ARRAY[0..1] OF DINT := [7, 8]; END_STRUCT END_TYPE
TYPE ST_Out : STRUCT stA : ST_In; aB : ARRAY[1..3] OF ST_In; nC : DINT; END_STRUCT END_TYPE
"""


def test_structures_are_copied_as_a_whole() -> None:
    body = "a.stA.fA := 5.0; a.aB[2].aN[1] := 3; b := a; a.stA.fA := 6.0; a.aB[2].aN[1] := 4; c := b.aB[2];"
    names = ("b.stA.fA", "b.aB[2].aN[1]", "a.aB[2].aN[1]", "c.aN[1]", "c.fA", "b.aB[1].aN[0]")
    text = block(body, "a : ST_Out; b : ST_Out; c : ST_In;", STRUCTS)
    assert run(text, names) == (5.0, 3, 4, 3, 1.0, 7)


def test_elements_of_arrays_of_structures_by_an_index_that_differs_between_rows() -> None:
    body = "a[n].fA := f; IF n <> 2 THEN a[n].aN[n] := n; END_IF; g := a[2 - n].fA; c := a[n];"
    text = block(body, "a : ARRAY[0..2] OF ST_In; g : LREAL; c : ST_In;", STRUCTS, "n : DINT; f : LREAL;")
    checked = project(text)
    many = Machine(checked, 4).instance("FB_T")
    rows = [(0, 10.0), (1, 11.0), (2, 12.0), (1, 13.0)]
    many(n=np.array([n for n, _ in rows]), f=np.array([f for _, f in rows]))
    machine = Machine(checked)
    for row, (n, f) in enumerate(rows):
        single = machine.instance("FB_T")
        single(n=n, f=f)
        for name in ("g", "c.fA", "c.aN", "a[0].fA", "a[1].fA", "a[2].fA", "a[1].aN"):
            assert np.array_equal(many[name][row], single[name]), name


def test_arrays_have_any_bounds_and_dimensions() -> None:
    body = "FOR i := -1 TO 1 DO FOR j := 2 TO 4 DO a[i, j] := i * 10 + j; END_FOR; END_FOR; b := a; x := b[n, n + 3];"
    text = block(
        body,
        "a : ARRAY[-1..1, 2..4] OF DINT; b : ARRAY[-1..1, 2..4] OF DINT; i : DINT; j : DINT; x : DINT;",
        inputs="n : DINT;",
    )
    assert run(text, "x", n=0) == 3
    assert run(text, "x", n=1) == 14
    assert run(text, "b", n=0).tolist() == [[-8, -7, -6], [2, 3, 4], [12, 13, 14]]
    with pytest.raises(StRuntimeError, match=r"2 is outside of -1..1"):
        run(text, "x", n=2)


def test_arrays_of_arrays() -> None:
    body = "a[1][n] := 5.0; b := a[1]; x := a[n][2];"
    text = block(
        body, "a : ARRAY[0..1] OF ARRAY[0..2] OF LREAL; b : ARRAY[0..2] OF LREAL; x : LREAL;", inputs="n : DINT;"
    )
    assert run(text, ("x",), n=1) == (0.0,)
    assert run(text, "b", n=1).tolist() == [0.0, 5.0, 0.0]


REFERENCES = """
FUNCTION FC_Both : DINT
VAR_IN_OUT a : DINT; b : DINT; END_VAR
a := a + 1;
b := b * 2;
FC_Both := a;
END_FUNCTION
FUNCTION FC_Fill
VAR_IN_OUT aX : ARRAY[0..2] OF LREAL; stX : ST_In; END_VAR
aX[1] := 9.0;
stX.fA := 8.0;
END_FUNCTION
FUNCTION_BLOCK FB_Ref
VAR_IN_OUT nIo : DINT; stIo : ST_In; END_VAR
VAR nOwn : DINT; END_VAR
nOwn := nOwn + nIo;
nIo := nIo + 1;
stIo.aN[0] := nIo;
END_FUNCTION_BLOCK
"""


def test_two_references_to_one_variable_see_each_other() -> None:
    text = block("x := FC_Both(a := n, b := n);", "x : DINT; n : DINT := 3;", STRUCTS + REFERENCES)
    assert run(text, ("n", "x")) == (8, 8)


def test_references_to_elements_fields_and_union_parts() -> None:
    body = "x := FC_Both(t[k], s.aN[1]) + FC_Both(g[k].aN[0], t[0]) + FC_Both(o.nC, u.aN[1]);"
    variables = (
        "x : DINT; t : ARRAY[0..2] OF DINT := [1, 2, 3]; s : ST_In; g : ARRAY[0..2] OF ST_In; o : ST_Out; u : V;"
    )
    text = block(
        body,
        variables,
        STRUCTS + REFERENCES + "TYPE V : UNION n : LINT; aN : ARRAY[0..1] OF DINT; END_UNION END_TYPE",
        "k : DINT;",
    )
    assert run(text, ("x", "t", "s.aN[1]", "g[1].aN[0]", "o.nC"), k=1)[0] == 3 + 8 + 1
    assert run(text, "t", k=1).tolist() == [2, 3, 3]
    assert run(text, ("s.aN[1]", "g[2].aN[0]", "o.nC"), k=2) == (16, 8, 1)


def test_references_to_locals_and_through_several_calls() -> None:
    before = (
        STRUCTS
        + REFERENCES
        + """
FUNCTION FC_Outer : DINT
VAR_IN_OUT q : DINT; END_VAR
VAR z : DINT := 10; END_VAR
FC_Outer := FC_Both(q, z) + FC_Both(z, q);
END_FUNCTION
"""
    )
    text = block("x := FC_Outer(n);", "x : DINT; n : DINT := 3;", before)
    # q = 4, z = 20; then z = 21, q = 8
    assert run(text, ("x", "n")) == (4 + 21, 8)


def test_composite_references_and_blocks_with_references() -> None:
    body = "FC_Fill(aX, st); fb(nIo := n, stIo := st); fb(nIo := m, stIo := st);"
    variables = "aX : ARRAY[0..2] OF LREAL; st : ST_In; fb : FB_Ref; n : DINT := 5; m : DINT := 50;"
    text = block(body, variables, STRUCTS + REFERENCES)
    assert run(text, ("aX[1]", "st.fA", "n", "m", "st.aN[0]")) == (9.0, 8.0, 6, 51, 51)


def test_references_in_some_rows_only() -> None:
    text = block(
        "IF k > 0 THEN x := FC_Both(t[k], y); END_IF;",
        "x : DINT; y : DINT := 4; t : ARRAY[0..2] OF DINT;",
        STRUCTS + REFERENCES,
        "k : DINT;",
    )
    instance = Machine(project(text), 3).instance("FB_T")
    instance(k=np.arange(3))
    assert instance["t"].tolist() == [[0, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert instance["y"].tolist() == [4, 8, 8]


def test_inputs_of_functions_are_values() -> None:
    before = """
TYPE T_Row : ARRAY[0..2] OF DINT; END_TYPE
FUNCTION FC_Sum : DINT
VAR_INPUT a : T_Row; n : DINT; END_VAR
VAR i : DINT; nLocal : DINT := 100; END_VAR
n := n + 1; a[0] := 50;
nLocal := nLocal + 1;
FOR i := 0 TO 2 DO FC_Sum := FC_Sum + a[i]; END_FOR;
FC_Sum := FC_Sum + n + nLocal;
END_FUNCTION
FUNCTION FC_Row : T_Row
VAR_INPUT n : DINT; END_VAR
FC_Row[1] := n;
END_FUNCTION
"""
    text = block(
        "x := FC_Sum(a, n); y := FC_Sum(a, n); b := FC_Row(7);",
        "a : T_Row; b : T_Row; n : DINT := 2; x : DINT; y : DINT;",
        before,
    )
    assert run(text, ("x", "y", "n", "a[0]", "b[1]")) == (154, 154, 2, 0, 7)


STATE = """
FUNCTION_BLOCK FB_Filter
VAR_INPUT fIn : LREAL; fGain : LREAL := 0.5; END_VAR
VAR_OUTPUT fOut : LREAL; nCycle : DINT; END_VAR
VAR_TEMP nTemp : DINT := 4; END_VAR
nTemp := nTemp + 1;
fOut := fOut + fGain * (fIn - fOut);
nCycle := nCycle + nTemp;
END_FUNCTION_BLOCK
"""


def test_instances_keep_their_state_and_temporaries_do_not() -> None:
    text = block(
        "a(fIn := f); IF a.fOut > 0.9 THEN b(fIn := a.fOut, fOut => g); END_IF;",
        "a : FB_Filter; b : FB_Filter := (fGain := 1.0); g : LREAL;",
        STATE,
        "f : LREAL;",
    )
    assert run(text, ("a.fOut", "a.nCycle", "b.nCycle", "g"), calls=4, f=1.0) == (0.9375, 20, 5, 0.9375)
    instance = Machine(project(text), 2).instance("FB_T")
    for _ in range(4):
        instance(f=np.array([1.0, 0.5]))
    assert instance["a.fOut"].tolist() == [0.9375, 0.46875]
    assert instance["b.nCycle"].tolist() == [5, 0]
    assert instance["b.fIn"].tolist() == [0.9375, 0.0]


INHERITED = """
FUNCTION_BLOCK FB_Base
VAR_INPUT n : DINT; END_VAR
VAR_OUTPUT o : DINT; END_VAR
VAR CONSTANT K : ARRAY[0..1] OF DINT := [10, 20]; END_VAR
METHOD Value : DINT
VAR_INPUT a : DINT; b : DINT := 2; END_VAR
VAR_OUTPUT q : DINT; END_VAR
Value := a * b + K[1]; q := a;
END_METHOD
METHOD Chain : DINT
Chain := Value(a := n) + THIS^.Value(1, 1);
END_METHOD
o := Value(n, 1);
END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_Child EXTENDS FB_Base
VAR nMore : DINT; END_VAR
METHOD Value : DINT
VAR_INPUT a : DINT; b : DINT := 2; END_VAR
VAR_OUTPUT q : DINT; END_VAR
Value := SUPER^.Value(a, b) + 1000; nMore := nMore + 1; q := 5;
END_METHOD
SUPER^();
o := o + 1;
END_FUNCTION_BLOCK
FUNCTION FC_Call : DINT
VAR_IN_OUT fb : FB_Base; END_VAR
fb(n := 3);
FC_Call := fb.o + fb.Value(a := 1, b := 1);
END_FUNCTION
"""


def test_inherited_methods_and_bodies_and_super() -> None:
    text = block(
        "b(n := 2); x := b.Value(a := 3, q => w); y := c.Value(3); c(n := 2);",
        "b : FB_Child; c : FB_Base; x : DINT; y : DINT; w : DINT;",
        INHERITED.replace("o := Value(n, 1);", "o := n;"),
    )
    assert run(text, ("b.o", "x", "w", "b.nMore", "y", "c.o")) == (3, 1026, 5, 1, 26, 2)


@pytest.mark.parametrize("body", ["x := a.Chain();", "x := FC_Call(a);", "a();"])
def test_calls_that_more_than_one_block_may_answer_are_refused_with_a_clear_message(body: str) -> None:
    instance = Machine(project(block(body, "a : FB_Base; x : DINT;", INHERITED))).instance("FB_T")
    with pytest.raises(StCheckError, match=r"has more than one meaning here: calls of what is overridden do not run"):
        instance()


def test_methods_in_some_rows_only() -> None:
    text = block("IF k > 1 THEN x := b.Value(k); END_IF;", "b : FB_Child; x : DINT;", INHERITED, "k : DINT;")
    instance = Machine(project(text), 4).instance("FB_T")
    instance(k=np.arange(4))
    assert instance["x"].tolist() == [0, 0, 1024, 1026]
    assert instance["b.nMore"].tolist() == [0, 0, 1, 1]


PROGRAM = """
TYPE E_State : (Idle, Run := 5, Stop); END_TYPE
PROGRAM PRG_Main
VAR eState : E_State; nCycle : DINT; fb : FB_Filter; END_VAR
nCycle := nCycle + 1;
CASE eState OF
    E_State.Idle: IF GVL.bStart THEN eState := Run; END_IF;
    E_State.Run: fb(fIn := 1.0); IF fb.fOut > 0.9 THEN eState := E_State.Stop; END_IF;
ELSE
    GVL.nDone := nCycle;
    eState := E_State.Idle;
END_CASE;
PRG_Sub();
END_PROGRAM
PROGRAM PRG_Sub
VAR nSeen : DINT; END_VAR
nSeen := PRG_Main.nCycle * 2;
END_PROGRAM
"""
GLOBALS = """VAR_GLOBAL bStart : BOOL; nDone : DINT; aX : ARRAY[0..1] OF LREAL; END_VAR
VAR_GLOBAL CONSTANT MAX_N : DINT := 3; END_VAR"""


def test_programs_globals_and_enumerations_over_many_cycles() -> None:
    from st_codegen.st import parse_project

    checked = parse_project({"PRG.st": STATE + PROGRAM, "GVL.st": GLOBALS})
    many = Machine(checked, 2)
    many.globals["GVL.bStart"] = np.array([True, False])
    main = many.program("PRG_Main")
    for _ in range(6):
        main()
    assert many.globals["GVL.nDone"].tolist() == [6, 0]
    assert main["eState"].tolist() == [0, 0]
    assert many.program("PRG_Sub")["nSeen"].tolist() == [12, 12]
    single = Machine(checked)
    single.globals["bStart"] = True
    for _ in range(6):
        single.program("prg_main")()
    assert (single.globals["nDone"], single.globals["MAX_N"], single.program("PRG_Sub")["nSeen"]) == (6, 3, 12)


def test_strings_are_moved_and_cut_but_not_compared() -> None:
    variables = "s : STRING(3); u : STRING; v : STRING(2); b : BOOL;"
    text = block("s := t; u := 'abc'; v := t;", variables, inputs="t : STRING(10);")
    assert run(text, ("s", "u", "v"), t="abcdef") == ("abc", "abc", "ab")
    instance = Machine(project(block("b := u = 'abc';", variables))).instance("FB_T")
    with pytest.raises(StCheckError, match="strings are moved but not compared"):
        instance()


def test_pointers_are_refused_with_a_clear_message() -> None:
    cases = [(body, "p : POINTER TO LREAL; f : LREAL; b : BOOL;") for body in POINTER_USES]
    for body, variables in [*cases, ("r := 1.0;", "r : REFERENCE TO LREAL;")]:
        instance = Machine(project(block(body, variables))).instance("FB_T")
        with pytest.raises(StCheckError, match="pointers and references are checked but not executed"):
            instance()


POINTER_USES = ("p := ADR(f);", "f := p^;", "p^ := 1.0;", "b := p = p;")


# --- what a user of a machine can do ----------------------------------------------------------------------------------

API = """
FUNCTION_BLOCK FB_Api
VAR_INPUT fIn : LREAL; nIn : SINT; bIn : BOOL; aIn : ARRAY[0..1, 0..1] OF DINT; tIn : STRING(3); wIn : WORD; END_VAR
VAR_OUTPUT fOut : LREAL; aOut : ARRAY[0..1, 0..1] OF DINT; END_VAR
VAR nIo : DINT; aIo : ARRAY[0..1] OF LREAL; END_VAR
VAR CONSTANT K : DINT := 5; T : ARRAY[0..1] OF REAL := [1.5, 2.5]; END_VAR
fOut := fIn * 2.0; aOut := aIn; nIo := nIo + 1; aIo[0] := fIn;
END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_Refers VAR_IN_OUT nIo : DINT; END_VAR nIo := 1; END_FUNCTION_BLOCK
PROGRAM PRG END_PROGRAM
"""


def machines() -> list[Machine]:
    checked = project(API)
    return [Machine(checked, 2), Machine(checked)]


@pytest.mark.parametrize("index", [0, 1])
def test_variables_are_read_and_set_by_name(index: int) -> None:
    machine = machines()[index]
    instance = machine.instance("fb_api")
    instance["nIo"] = 7
    instance["aIo"] = [1.0, 2.0]
    instance(fIn=1.5, aIn=[[1, 2], [3, 4]])
    shown = {
        name: np.asarray(instance[name]) for name in ("fOut", "aOut", "aOut[1, 0]", "nIo", "aIo[0]", "K", "T", "T[1]")
    }
    first = {name: value[0] if index == 0 else value for name, value in shown.items()}
    assert first["fOut"] == 3.0
    assert first["aOut"].tolist() == [[1, 2], [3, 4]]
    assert [first[name] for name in ("aOut[1, 0]", "nIo", "aIo[0]", "K", "T[1]")] == [3, 8, 1.5, 5, 2.5]
    assert [port.name for port in instance.inputs] == ["fIn", "nIn", "bIn", "aIn", "tIn", "wIn"]
    assert [str(port.type) for port in instance.outputs] == ["LREAL", "ARRAY[0..1, 0..1] OF DINT"]


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    ("action", "message"),
    [
        (lambda m, i: i["zz"], "'zz': FB_Api has no 'zz'"),
        (lambda m, i: i["fIn.x"], "LREAL has no 'x'"),
        (lambda m, i: i["fIn[0]"], "LREAL has no element [0]"),
        (lambda m, i: i["aIn[0]"], "has no element [0]"),
        (lambda m, i: i["aIn[0, 2]"], "index 2 is outside of 0..1"),
        (lambda m, i: i["a b"], "is no name of a variable"),
        (lambda m, i: i[""], "an empty name"),
        (lambda m, i: i.__setitem__("K", 3), "'K' is a constant"),
        (lambda m, i: i.__setitem__("nIn", 200), "values outside of -128..127"),
        (lambda m, i: i.__setitem__("nIn", 1.5), "integers are needed, not float64"),
        (lambda m, i: i.__setitem__("bIn", 1), "True or False is needed"),
        (lambda m, i: i.__setitem__("fIn", "x"), "numbers are needed"),
        (lambda m, i: i.__setitem__("tIn", "abcd"), "text of at most 3 characters"),
        (lambda m, i: i.__setitem__("aIn", [1, 2, 3]), "shape (3,), expected (2, 2)"),
        (lambda m, i: i.__setitem__("fIn", [1.0, 2.0, 3.0]), "shape (3,)"),
        (lambda m, i: m.instance("FB_Refers")(), "'FB_Refers' has a VAR_IN_OUT: call it from Structured Text"),
        (lambda m, i: m.instance("FB_Refers")["nIo"], "'nIo' is a VAR_IN_OUT"),
        (lambda m, i: i.native, "'FB_Api' is not native"),
        (lambda m, i: m.instance("FB_Nope"), "no function block 'FB_Nope'; it has FB_Api, FB_Refers"),
        (lambda m, i: m.program("FB_Api"), "no program 'FB_Api'"),
        (lambda m, i: m.globals["nX"], "no global variable 'nX'"),
    ],
)  # fmt: skip
def test_wrong_uses_are_explained(index: int, action: object, message: str) -> None:
    machine = machines()[index]
    with pytest.raises(StUsageError) as caught:
        action(machine, machine.instance("FB_Api"))  # type: ignore[operator]
    assert message in str(caught.value)


def test_a_machine_has_rows() -> None:
    with pytest.raises(StUsageError, match="at least one row, not 0"):
        Machine(project(API), 0)
    instance = Machine(project(API), 1).instance("FB_Api")
    assert np.shape(instance["fIn"]) == (1,)


def test_values_given_by_the_user_are_copied() -> None:
    instance = Machine(project(API), 2).instance("FB_Api")
    given = np.array([1.0, 2.0])
    instance["fIn"] = given
    given[0] = 9.0
    shown = instance["fIn"]
    shown[1] = 7.0
    assert instance["fIn"].tolist() == [1.0, 2.0]


def test_assigned_variables_do_not_share_memory() -> None:
    text = block(
        "a := x; b := a; IF n > 0 THEN a := 5.0; END_IF; t[0] := x; t[1] := t[0]; IF n > 0 THEN t[0] := 7.0; END_IF;",
        "a : LREAL; b : LREAL; t : ARRAY[0..1] OF LREAL;",
        inputs="x : LREAL; n : DINT;",
    )
    instance = Machine(project(text), 2).instance("FB_T")
    instance(x=np.array([1.0, 2.0]), n=np.array([0, 1]))
    assert [instance[name].tolist() for name in ("x", "a", "b", "t[0]", "t[1]")] == [
        [1, 2],
        [1, 5],
        [1, 2],
        [1, 7],
        [1, 2],
    ]


def test_an_element_of_a_table_loaded_in_an_elsif_alone() -> None:
    """What the conditions of ELSIF need is written once to see whether it is needed, and taken out again."""
    text = block(
        "FOR i := 0 TO 2 DO IF f < LOW[i] THEN n := n + 1; ELSIF f > HIGH[i] THEN n := n + 10; END_IF;"
        " IF f > HIGH[i] THEN n := n + 100; END_IF; END_FOR;",
        "i : DINT; n : DINT; END_VAR VAR CONSTANT LOW : ARRAY[0..2] OF LREAL := [0.0, 1.0, 5.0];"
        " HIGH : ARRAY[0..2] OF LREAL := [1.0, 2.0, 9.0];",
        inputs="f : LREAL;",
    )
    assert run(text, "n", f=1.5) == 111


def test_machine_code_goes_with_its_project() -> None:
    project = parse_project({"f.st": "FUNCTION_BLOCK FB VAR_OUTPUT x : DINT; END_VAR x := x + 1; END_FUNCTION_BLOCK"})
    seen = weakref.ref(project)
    machine = Machine(project)
    machine.instance("FB")()
    del project, machine
    gc.collect()
    assert seen() is None


def test_arrays_of_zeros_take_no_memory_until_they_are_written() -> None:
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    if not Path("/proc/self/statm").is_file():
        pytest.skip("the memory of a process is counted on Linux only")
    text = """
VAR_GLOBAL nFirst : DINT := 7; aRing : ARRAY[0..39999] OF LREAL; nLast : DINT := 9; END_VAR
FUNCTION_BLOCK FB_X VAR_OUTPUT n : DINT; END_VAR n := nFirst + nLast; END_FUNCTION_BLOCK
"""
    project = parse_project({"a.st": text})
    before = resident()
    machine = Machine(project, rows=2000, optimised=False)
    block = machine.instance("FB_X")
    block()
    assert (block["n"] == 16).all()
    assert resident() - before < 200e6  # of 640 MB
    assert machine.globals["aRing[39999]"].tolist() == [0.0] * 2000
