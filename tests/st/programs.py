# ruff: noqa: PLR0911, PLR0912 - one case for each kind of expression and statement
"""Random programs for the engine and a plain evaluator: every kind of statement and type, with bounded loops."""

from __future__ import annotations

from hypothesis import strategies as s

HEADER = """
TYPE E_Mode : (Idle, Busy := 4, Done) DINT; END_TYPE
TYPE ST_Pair : STRUCT fValue : LREAL; nCount : DINT := 3; aIn : ARRAY[0..1] OF INT; END_STRUCT END_TYPE
TYPE U_Bits : UNION fValue : LREAL; nBits : LWORD; aBytes : ARRAY[0..7] OF BYTE; rHalf : REAL; END_UNION END_TYPE
FUNCTION FC_Mix : LREAL
VAR_INPUT a : LREAL; n : DINT; END_VAR
VAR_IN_OUT io : DINT; END_VAR
VAR_OUTPUT nTwice : DINT; END_VAR
VAR i : DINT; END_VAR
FC_Mix := a;
FOR i := 1 TO n MOD 4 DO
    FC_Mix := FC_Mix + 0.5;
    io := io + i;
    IF io > 50 THEN RETURN; END_IF;
END_FOR;
nTwice := io * 2;
END_FUNCTION
FUNCTION_BLOCK FB_Base
VAR_INPUT fIn : LREAL; nStep : DINT := 1; END_VAR
VAR_OUTPUT fOut : LREAL; nCalls : DINT; END_VAR
VAR fLast : LREAL; END_VAR
METHOD Bump : DINT
VAR_INPUT n : DINT; END_VAR
nCalls := nCalls + n;
Bump := nCalls;
END_METHOD
METHOD Count : DINT
VAR_INPUT n : DINT; END_VAR
nCalls := nCalls + 2 * n;
Count := nCalls;
END_METHOD
METHOD Twice : DINT
Twice := THIS^.Count(n := 1) + Count(1);
END_METHOD
fOut := fLast + fIn;
fLast := fIn;
nCalls := nCalls + nStep;
END_FUNCTION_BLOCK
FUNCTION_BLOCK FB_Derived EXTENDS FB_Base
METHOD Bump : DINT
VAR_INPUT n : DINT; END_VAR
Bump := SUPER^.Bump(n) + 100;
END_METHOD
SUPER^();
fOut := fOut * 2.0;
END_FUNCTION_BLOCK
"""
LOCALS = """
VAR
    fX : LREAL := 1.5; fY : LREAL; rX : REAL; nX : DINT; nY : DINT := 7; nS : SINT; nU : UINT; nL : LINT;
    bX : BOOL; bZ : BOOL := TRUE; wX : WORD := 16#A5; dX : DWORD; eX : E_Mode;
    aF : ARRAY[-1..3] OF LREAL := [0.5, 1.5, 2.5, -3.5, 4.5];
    aN : ARRAY[1..2, 0..2] OF DINT := [1, 2, 3, 4, 5, 6];
    aP : ARRAY[0..2] OF ST_Pair; stP : ST_Pair; uB : U_Bits;
    fbA : FB_Base; fbD : FB_Derived; aB : ARRAY[0..1] OF FB_Base;
    i : DINT; j : DINT; k : INT; n : DINT; fHuge : LREAL := 1.0E300; rHuge : REAL := 3.0E38; fMinus : LREAL := -2.0;
END_VAR
VAR CONSTANT
    TABLE : ARRAY[0..4] OF LREAL := [0.0, -1.0, 2.0, 1.0E10, 0.25];
    STEPS : ARRAY[0..4] OF DINT := [3, 1, 4, 1, 5];
    LIMIT_N : DINT := 4;
END_VAR
"""
INPUTS = ("fA", "fB", "nA", "nB", "bA")

# Places and simple values by type; indices are written so that some of them leave the array
_PLACES = {
    "LREAL": ["fX", "fY", "aF[{index}]", "stP.fValue", "aP[{small}].fValue", "uB.fValue", "fbA.fIn"],
    "REAL": ["rX", "uB.rHalf"],
    "DINT": ["nX", "nY", "aN[{one}, {small}]", "stP.nCount", "aP[{small}].nCount", "n"],
    "SINT": ["nS"],
    "INT": ["stP.aIn[{bit}]", "aP[{small}].aIn[{bit}]"],
    "UINT": ["nU"],
    "LINT": ["nL"],
    "BOOL": ["bX", "bZ"],
    "WORD": ["wX"],
    "DWORD": ["dX"],
    "BYTE": ["uB.aBytes[{index}]"],
    "E_Mode": ["eX"],
}
_VALUES = {
    "LREAL": ["fA", "fB", "TABLE[{small}]", "fbA.fOut", "fbD.fOut", "LREAL#0.5", "fMinus", "fHuge", "LREAL#0.0"],
    "REAL": ["REAL#1.5", "rHuge"],
    "DINT": ["nA", "nB", "STEPS[{small}]", "i", "j", "LIMIT_N", "DINT#3", "DINT#-7", "DINT#2147483647", "fbA.nCalls"],
    "SINT": ["SINT#100", "SINT#-3"],
    "INT": ["INT#300", "k"],
    "UINT": ["UINT#65535", "UINT#2"],
    "LINT": ["LINT#9000000000", "LINT#-1"],
    "BOOL": ["bA", "TRUE", "FALSE"],
    "WORD": ["WORD#16#F00F", "WORD#1"],
    "DWORD": ["DWORD#16#80000001"],
    "BYTE": ["BYTE#200"],
    "E_Mode": ["E_Mode.Idle", "E_Mode.Busy", "E_Mode.Done"],
}
_REAL_FORMS = (
    "+",
    "-",
    "*",
    "/",
    "neg",
    "SQRT",
    "EXP",
    "SIN",
    "LN",
    "ABS",
    "ATAN",
    "MIN",
    "MAX",
    "LIMIT",
    "SEL",
    "MUX",
)
_REAL_FORMS += ("int", "real", "call", "EXPT")
_INTEGERS = ("DINT", "SINT", "INT", "UINT", "LINT")
_BITS = ("WORD", "DWORD", "BYTE")


def _fill(draw: s.DrawFn, text: str) -> str:
    def pick(*choices: str) -> str:
        return draw(s.sampled_from(choices))

    return text.format(
        index=pick("0", "2", "nX", "i", "nA MOD 4") if "{index}" in text else "",
        small=pick("0", "1", "2", "i", "nA MOD 3", "ABS(nB MOD 3)") if "{small}" in text else "",
        one=pick("1", "2", "i") if "{one}" in text else "",
        bit=pick("0", "1") if "{bit}" in text else "",
    )


@s.composite
def expressions(draw: s.DrawFn, kind: str, depth: int = 2) -> str:
    if depth == 0 or draw(s.integers(0, 4)) == 0:
        return _fill(draw, draw(s.sampled_from(_PLACES[kind] + _VALUES[kind])))

    def sub(other: str = kind) -> str:
        return draw(expressions(other, depth - 1))

    if kind == "LREAL":
        form = draw(s.sampled_from(_REAL_FORMS))
        match form:
            case "+" | "-" | "*" | "/":
                return f"({sub()} {form} {sub()})"
            case "neg":
                return f"(-{sub()})"
            case "MIN" | "MAX":
                return f"{form}({sub()}, {sub()})"
            case "LIMIT":
                return f"LIMIT({sub()}, {sub()}, {sub()})"
            case "SEL":
                return f"SEL({sub('BOOL')}, {sub()}, {sub()})"
            case "MUX":
                return f"MUX({sub('DINT')}, {sub()}, {sub()})"
            case "EXPT":
                return f"EXPT({sub()}, {draw(s.sampled_from(['2', '0.5', '-1.0']))})"
            case "int":
                source = draw(s.sampled_from(["DINT", "SINT", "UINT", "LINT"]))
                return f"{source}_TO_LREAL({sub(source)})"
            case "real":
                return f"REAL_TO_LREAL({sub('REAL')})"
            case "call":
                return f"FC_Mix({sub()}, {sub('DINT')}, {draw(s.sampled_from(['nX', 'n', 'stP.nCount']))})"
            case _:
                return f"{form}({sub()})"
    if kind == "REAL":
        form = draw(s.sampled_from(["+", "*", "LREAL", "DINT"]))
        if form in "+*":
            return f"({sub()} {form} {sub()})"
        return f"{form}_TO_REAL({sub(form)})"
    if kind == "BOOL":
        form = draw(
            s.sampled_from(["AND", "OR", "XOR", "NOT", "AND_THEN", "OR_ELSE", "real", "int", "enum", "word", "to"])
        )
        symbol = draw(s.sampled_from(["<", "<=", ">", ">=", "=", "<>"]))
        match form:
            case "NOT":
                return f"(NOT {sub()})"
            case "real":
                return f"({sub('LREAL')} {symbol} {sub('LREAL')})"
            case "int":
                return f"({sub('DINT')} {symbol} {sub('DINT')})"
            case "enum":
                return f"({sub('E_Mode')} = {sub('E_Mode')})"
            case "word":
                return f"({sub('WORD')} = {sub('WORD')})"
            case "to":
                return f"DINT_TO_BOOL({sub('DINT')})"
            case _:
                return f"({sub()} {form} {sub()})"
    if kind in _BITS:
        form = draw(s.sampled_from(["AND", "OR", "XOR", "NOT", "SHL", "SHR", "ROL", "ROR", "to"]))
        if form in ("AND", "OR", "XOR"):
            return f"({sub()} {form} {sub()})"
        if form == "NOT":
            return f"(NOT {sub()})"
        if form == "to":
            return f"DINT_TO_{kind}({sub('DINT')})"
        return f"{form}({sub()}, {draw(s.sampled_from(['0', '1', '3', 'nA MOD 8']))})"
    if kind == "E_Mode":
        return f"SEL({sub('BOOL')}, {sub()}, {sub()})"
    form = draw(s.sampled_from(["+", "-", "*", "/", "MOD", "neg", "MIN", "SEL", "to", "real", "TRUNC", "method"]))
    match form:
        case "neg" if kind != "UINT":
            return f"(-{sub()})"
        case "MIN":
            return f"MIN({sub()}, {sub()})"
        case "SEL":
            return f"SEL({sub('BOOL')}, {sub()}, {sub()})"
        case "real":
            return f"LREAL_TO_{kind}({sub('LREAL')})"
        case "TRUNC" if kind == "DINT":
            return f"TRUNC({sub('LREAL')})"
        case "method" if kind == "DINT":
            return draw(s.sampled_from(["fbA.Bump(2)", "fbD.Bump(n := 3)", "fbD.Twice()", "aB[nA MOD 2].Bump(1)"]))
        case "+" | "-" | "*" | "/" | "MOD":
            return f"({sub()} {form} {sub()})"
        case _:
            others = [other for other in (*_INTEGERS, "WORD") if other != kind]
            source = draw(s.sampled_from(others))
            return f"{source}_TO_{kind}({sub(source)})"


@s.composite
def assignments(draw: s.DrawFn) -> str:
    kind = draw(s.sampled_from(sorted(_PLACES)))
    place = _fill(draw, draw(s.sampled_from(_PLACES[kind])))
    return f"{place} := {draw(expressions(kind))};"


_CALLS = (
    "fbA(fIn := fX, nStep := nA);",
    "fbD(fIn := fY, fOut => fX);",
    "fbD(fIn := 1.0, nCalls => nX);",
    "aB[nA MOD 2](fIn := fA, fOut => aF[0]);",
    "stP := aP[nB MOD 3];",
    "aP[nA MOD 3] := stP;",
    "fY := FC_Mix(a := fA, n := nB, io := nX, nTwice => nY);",
    "fX := FC_Mix(fB, 2, aP[nA MOD 3].nCount);",
    "fX := FC_Mix(fB, 3, aN[1, nA MOD 3]);",
    "nX := fbD.Twice();",
    "nY := aB[0].nCalls;",
)


@s.composite
def bodies(draw: s.DrawFn, depth: int, counters: tuple[str, ...], in_loop: bool) -> list[str]:
    lines: list[str] = []
    for _ in range(draw(s.integers(1, 3))):
        lines += draw(statements(depth, counters, in_loop))
    return lines


@s.composite
def statements(draw: s.DrawFn, depth: int, counters: tuple[str, ...], in_loop: bool) -> list[str]:
    forms = ["assign", "assign", "assign", "call"]
    if depth:
        forms += ["if", "if", "case", "repeat", "while"] + (["for", "for"] if counters else [])
    if in_loop:
        forms += ["leave", "leave"]
    form = draw(s.sampled_from(forms))

    def inner(loop: bool = in_loop, free: tuple[str, ...] = counters) -> list[str]:
        return ["    " + line for line in draw(bodies(depth - 1, free, loop))]

    match form:
        case "assign":
            return [draw(assignments())]
        case "call":
            return [draw(s.sampled_from(_CALLS))]
        case "leave":
            word = draw(s.sampled_from(["EXIT", "CONTINUE", "RETURN"]))
            return [f"IF {draw(expressions('BOOL'))} THEN", f"    {word};", "END_IF;"]
        case "if":
            lines = [f"IF {draw(expressions('BOOL'))} THEN", *inner()]
            for _ in range(draw(s.integers(0, 2))):
                lines += [f"ELSIF {draw(expressions('BOOL', 1))} THEN", *inner()]
            if draw(s.booleans()):
                lines += ["ELSE", *inner()]
            return [*lines, "END_IF;"]
        case "case":
            lines = [f"CASE {draw(expressions('DINT', 1))} OF", "0, 3:", *inner(), "-2..-1, 1:", *inner()]
            if draw(s.booleans()):
                lines += ["ELSE", *inner()]
            return [*lines, "END_CASE;"]
        case "for":
            counter, *rest = counters
            low, high = draw(s.sampled_from(["0", "1", "nA MOD 3"])), draw(s.sampled_from(["2", "3", "nB MOD 5"]))
            step = draw(s.sampled_from(["", " BY 2", " BY -1"]))
            header = f"FOR {counter} := {low} TO {high}{step} DO"
            return [header, *inner(True, tuple(rest)), "END_FOR;"]
        case "while":
            condition = draw(expressions("BOOL", 1))
            return ["n := 0;", f"WHILE n < 3 AND {condition} DO", "    n := n + 1;", *inner(True), "END_WHILE;"]
        case _:
            condition = draw(expressions("BOOL", 1))
            return ["n := 0;", "REPEAT", "    n := n + 1;", *inner(True), f"UNTIL n > 2 OR {condition}", "END_REPEAT;"]


@s.composite
def programs(draw: s.DrawFn) -> str:
    body = "\n".join(draw(bodies(3, ("i", "j"), False)))
    inputs = "VAR_INPUT fA : LREAL; fB : LREAL; nA : DINT; nB : DINT; bA : BOOL; END_VAR"
    return f"{HEADER}FUNCTION_BLOCK FB_Test\n{inputs}{LOCALS}{body}\nEND_FUNCTION_BLOCK\n"
