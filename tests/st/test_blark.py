"""An independent parser of TwinCAT's Structured Text (GPL, so in a process of its own) agrees on what is valid.

Only what both have the same idea of is compared: texts without our refusals, and damage that no dialect allows.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from st_codegen.st import StSyntaxError
from st_codegen.st.syntax.source import read_texts
from tests.st.programs import HEADER, LOCALS
from tests.st.test_portable import GOOD
from tests.st.test_source import DUT, GVL, POU

pytestmark = pytest.mark.skipif(importlib.util.find_spec("blark") is None, reason="blark is not installed")

# One block a file, as TwinCAT stores them
TEXTS = {
    "FB_X.TcPOU": POU,
    "GVL_X.TcGVL": GVL,
    "ST_X.TcDUT": DUT,
    "good.st": GOOD,
    # Methods inside of a block are not known to it outside of XML
    "header.st": HEADER.partition("FUNCTION_BLOCK")[0],
    "locals.st": f"FUNCTION_BLOCK FB_T\n{LOCALS}fX := aF[-1] * 2.0;\nEND_FUNCTION_BLOCK\n",
    "statements.st": """
PROGRAM PRG_Main
VAR
    nX : DINT := DINT#16#FF; tX : TIME := T#1d2h3m4s5ms; sX : STRING(20) := 'a$'b'; bX AT %I* : BOOL;
    pX : POINTER TO LREAL; aX : ARRAY[0..1, 0..2] OF LREAL := [6(0.0)];
END_VAR
CASE nX OF
    1, 3..5: nX := nX MOD 2;
    E_Mode.Busy: ;
ELSE
    nX := -nX;
END_CASE;
FOR nX := 0 TO 10 BY 2 DO IF nX > 3 THEN EXIT; END_IF; CONTINUE; END_FOR;
WHILE nX < 5 AND_THEN NOT bX DO nX := nX + 1; END_WHILE;
REPEAT nX := nX - 1; UNTIL nX < 0 END_REPEAT;
fbX(IN := TRUE, PT := T#5s, Q => bX);
THIS^.Go(nX := 5);
pX^ := aX[1, 2];
RETURN;
END_PROGRAM
""",
}
BROKEN = {
    "no_then.st": "PROGRAM P IF a b := 1; END_IF END_PROGRAM",
    "no_end.st": "PROGRAM P IF a THEN b := 1; END_PROGRAM",
    "no_value.st": "PROGRAM P b := ; END_PROGRAM",
    "no_type.st": "PROGRAM P VAR a : ; END_VAR END_PROGRAM",
    "bracket.st": "PROGRAM P a[1 := 2; END_PROGRAM",
}


def blark_accepts(path: Path) -> bool:
    command = [sys.executable, "-m", "blark", "parse", str(path)]
    return subprocess.run(command, capture_output=True, timeout=600, check=False).returncode == 0


@pytest.mark.parametrize("name", TEXTS)
def test_both_accept(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(TEXTS[name], encoding="utf-8")
    read_texts({name: TEXTS[name]})
    assert blark_accepts(tmp_path / name)


@pytest.mark.parametrize("name", BROKEN)
def test_both_refuse(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(BROKEN[name], encoding="utf-8")
    with pytest.raises(StSyntaxError):
        read_texts({name: BROKEN[name]})
    assert not blark_accepts(tmp_path / name)
