"""An independent parser of TwinCAT's Structured Text (GPL, so in a process of its own) agrees on what is valid.

Only what both have the same idea of is compared: texts without our refusals, and damage that no dialect allows.
"""

from __future__ import annotations

import importlib.util
import json
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


#: `blark parse FILE` for each file, in one process; says with what exit code each ends.
BLARK = """
import contextlib, io, json, sys
from blark.main import main
codes = {}
for path in sys.argv[1:]:
    sys.argv[1:] = ["parse", path]
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            codes[path] = main() or 0
    except SystemExit as end:
        codes[path] = end.code
print(json.dumps(codes))
"""


@pytest.fixture(scope="module")
def accepted(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names of the texts that blark accepts."""
    folder = tmp_path_factory.mktemp("blark")
    for name, text in (TEXTS | BROKEN).items():
        (folder / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-c", BLARK, *map(str, folder.iterdir())]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    codes = json.loads(result.stdout)
    assert len(codes) == len(TEXTS | BROKEN)
    return {Path(path).name for path, code in codes.items() if code == 0}


@pytest.mark.parametrize("name", TEXTS)
def test_both_accept(accepted: set[str], name: str) -> None:
    read_texts({name: TEXTS[name]})
    assert name in accepted


@pytest.mark.parametrize("name", BROKEN)
def test_both_refuse(accepted: set[str], name: str) -> None:
    with pytest.raises(StSyntaxError):
        read_texts({name: BROKEN[name]})
    assert name not in accepted
