"""Texts that together use every rule and every terminal of the grammar."""

from __future__ import annotations

PLAIN = {
    "types": """
TYPE
    E_Mode : (Idle, Busy := 16#0A, Done) UINT := E_Mode.Busy;
    E_Plain : (Red, Green);
    ST_Base : STRUCT fA : LREAL := 1.0; END_STRUCT
    ST_Point EXTENDS ST_Base : STRUCT
        fX, fY : LREAL;
        aRaw AT %MW10 : ARRAY[0..1, -2..2] OF INT;
    END_STRUCT;
    U_Bits : UNION fValue : LREAL; nBits : LWORD; END_UNION
    T_Row : ARRAY[1..3] OF REAL := [1.0, 2.0, 3.0];
    T_Small : DINT(-5..5);
    T_Text : STRING(20);
    T_Wide : WSTRING[30] := "wide$'$0041";
    T_Pointer : POINTER TO REFERENCE TO Tc2_Standard.TON;
END_TYPE
""",
    "globals": """
{attribute 'qualified_only'}
VAR_GLOBAL CONSTANT
    MAX_N : DINT := 10;
    PI_HALF : LREAL := 1.5707963267948966;
END_VAR
VAR_GLOBAL PERSISTENT RETAIN
    bMemory AT %I* : BOOL;
    sName : STRING := 'it''s'  ;
END_VAR
""".replace("''", "$'"),
    "function": """
FUNCTION FC_Add : DINT;
VAR_INPUT a, b : DINT; c : DINT := 3; END_VAR
VAR_IN_OUT io : ARRAY[0..3] OF LREAL; END_VAR
VAR_OUTPUT nOut : DINT; END_VAR
VAR_TEMP t : DINT; END_VAR
FC_Add := a + b - -c * 2 / 1 MOD 5;
;
END_FUNCTION
FUNCTION FC_Nothing
END_FUNCTION
""",
    "block": """
{attribute 'hide'}
FUNCTION_BLOCK ABSTRACT FINAL FB_Test EXTENDS FB_Base
VAR_INPUT
    {attribute 'displaymode' := 'hex'}
    nIn : DINT;
END_VAR
VAR CONSTANT
    TABLE : ARRAY[0..3] OF LREAL := [0.5, -1.0E-3, 2.5E+10, 7.0]; (* row (* nested *) 1 *)
    FLAGS : ARRAY[0..1] OF BOOL := [TRUE, FALSE];
    MIX : ARRAY[0..2] OF LREAL := [1.0, PI, 2.0 * PI];
    REPEATED : ARRAY[0..59] OF LREAL := [50(0.0), 9(), 1.0];
    POINTS : ARRAY[0..1] OF ST_Point := [(fX := 1.0, fY := 2.0), (fX := 3.0)];
    ROWS : ARRAY[0..1] OF T_Row := [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
END_VAR
VAR
    fbInner : FB_Inner := (nStart := 5, aIn := [1, 2]); // a comment
END_VAR
METHOD PUBLIC Reset : BOOL
VAR_INPUT bHard : BOOL; END_VAR
Reset := TRUE; /// documentation
END_METHOD
METHOD PRIVATE Stop
RETURN;
END_METHOD
fbInner(nStart := 1 + 2, nOther := , nOut => nIn, nLost => );
fbInner.Reset(TRUE);
THIS^.Reset(bHard := FALSE);
SUPER^();
SUPER^.Stop();
pNext^.aItems[1, nIn + 2].fX := -fbInner.fOut;
END_FUNCTION_BLOCK
""",
    "statements": """
PROGRAM PRG_Main
VAR
    a : DINT;
END_VAR
IF a = 1 THEN
    a := 2;
ELSIF a <> 3 AND NOT (a < 4) THEN
    a := 5;
ELSE
    ;
END_IF;
IF a > 1 THEN END_IF
CASE a OF
    1: a := 2;
    2, 4..6, -8: a := 3; a := 4;
    E_Mode.Busy, E_Mode#Idle:
        FOR a := 1 TO 10 BY 2 DO
            IF a >= 3 THEN EXIT; END_IF;
            CONTINUE;
        END_FOR;
ELSE
    a := 0;
END_CASE;
FOR a := 0 TO 3 DO END_FOR;
WHILE a <= 5 DO a := a + 1; END_WHILE;
REPEAT a := a - 1; UNTIL a < 0 END_REPEAT;
RETURN;
END_PROGRAM
""",
    "configuration": """
PROGRAM PRG_Slow END_PROGRAM
PROGRAM PRG_Fast END_PROGRAM
CONFIGURATION Config
    RESOURCE Controller ON PLC
        TASK Slow(INTERVAL := T#10ms, PRIORITY := 20);
        TASK Fast(INTERVAL := T#500us, PRIORITY := 10);
        PROGRAM Run_Slow WITH Slow : PRG_Slow;
        PROGRAM Run_Fast WITH Fast : PRG_Fast;
    END_RESOURCE
END_CONFIGURATION
""",
    "expressions": """
PROGRAM PRG_Expressions
x := a OR b XOR c AND d & e;
x := a OR_ELSE b AND_THEN c;
x := (a = b) <> (c < d);
x := 2.0 ** 3 + x ** -y - (-x) ** 2;
x := +1 - -2 + NOT 3;
x := INT#-5 + DINT#16#FF_FF + 2#1010 + 8#17 + REAL#1.0E-3 + LREAL#2 + BYTE#255;
x := T#1d2h_3m4.5s + TIME#-250us + LTIME#1ns + T#5ms;
x := BOOL#TRUE = TRUE AND FALSE;
x := STRING#'abc' = '$$100$L$N$R$T$41';
x := 1_000_000 + 1.5E3 + 12e2;
x := F(1, G(a := 2), 3).b.c[1][2, 3]^.d;
END_PROGRAM
""",
}

# The parts that TwinCAT stores apart, by the start rule that reads them
PARTS = {
    "head": "FUNCTION_BLOCK FB_X\nVAR_INPUT a : DINT; END_VAR\nVAR b : LREAL; END_VAR",
    "body": "a := 1; IF a > 0 THEN b := 2.0; END_IF;",
    "globals": "VAR_GLOBAL a : DINT; END_VAR\nVAR_GLOBAL CONSTANT B : DINT := 1; END_VAR",
    "types": "TYPE A : STRUCT x : DINT; END_STRUCT END_TYPE\nTYPE B : (C, D); END_TYPE",
    "file": "",
}
METHOD_HEAD = "METHOD PROTECTED OVERRIDE Predict : BOOL\nVAR_INPUT INTERNALS : DINT; END_VAR"

# What the grammar knows only to refuse it by its name
REFUSED = ["VAR_STAT", "VAR_INST", "VAR_EXTERNAL"]
