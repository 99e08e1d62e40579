"""The translator of the race: its C computes what the interpreter computes, NaN, infinities and thresholds included."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks.contenders import Built
from benchmarks.harness import Harness
from benchmarks.st_to_c import UntranslatableError, ports, translate
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st import Machine, parse_project

GOLDEN = Path(__file__).resolve().parent.parent.parent / "golden" / "lone"
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc: apt-get install gcc")


def library(project, block, folder):
    (folder / "model.c").write_text(translate(project, block, "race"))
    built = folder / f"{block}.so"
    command = ["gcc", "-O1", "-w", "-fwrapv", "-ffp-contract=off", "-shared", "-fPIC", "-o", built]
    subprocess.run([*command, folder / "model.c", "-lm"], check=True)
    return Built(0.0, library=built, outputs=ports(project, block)[1])


@pytest.fixture(scope="module")
def harness(tmp_path_factory):
    return Harness(tmp_path_factory.mktemp("harness"))


@pytest.fixture(scope="module")
def code():
    return GeneratedCode(GOLDEN / "generated" / "twincat", "twincat")


@pytest.mark.parametrize(
    "model",
    ["decision_tree", "extra_trees", "hist_gradient_boosting_missing", "lightgbm_category", "xgboost_gbtree", "svr"],
)
def test_c_and_interpreter_agree(model, code, harness, tmp_path):
    block = f"FB_{model.capitalize()}"
    rows = np.genfromtxt(GOLDEN / "inputs" / f"{model}.csv", delimiter=",", skip_header=1)
    rows = np.vstack([rows, np.full((1, rows.shape[1]), np.nan), np.full((1, rows.shape[1]), -np.inf)])
    got = harness.values(library(code.project, block, tmp_path), rows, tmp_path)
    expected = code.run_model(block, rows, 1)
    assert np.array_equal(got[:, 1] != 0.0, expected.valid)
    mine, theirs = got[expected.valid, 0], expected.values[expected.valid, 0]
    if model == "svr":  # EXP is the library's own: half a unit in the last place for each of its terms
        assert np.allclose(mine, theirs, rtol=1e-12, atol=0.0)
    else:
        assert np.array_equal(mine, theirs)


def test_every_statement_and_operator_is_translated(harness, tmp_path):
    text = """TYPE U_Bits : UNION f : LREAL; n : LWORD; END_UNION END_TYPE
    FUNCTION F : DINT VAR_INPUT a : DINT; b : DINT := 3; END_VAR VAR c : DINT := 2; END_VAR
    IF a > 5 THEN F := a - c; RETURN; END_IF; F := a * b MOD 7; END_FUNCTION
    FUNCTION_BLOCK FB_In VAR_INPUT x : LREAL; END_VAR VAR_OUTPUT y : LREAL; END_VAR VAR k : DINT := 4; END_VAR
    k := k + 1; y := x * DINT_TO_LREAL(k); END_FUNCTION_BLOCK
    FUNCTION_BLOCK FB_T VAR_INPUT x : LREAL; END_VAR
    VAR_OUTPUT y : LREAL; r : REAL; b : BOOL; n : DINT; a : ARRAY[0..3] OF LREAL; END_VAR
    VAR i : DINT; j : DINT; u : U_Bits; fb : FB_In; q : ARRAY[1..2, 0..2] OF DINT; w : DWORD; END_VAR
    VAR s : ARRAY[0..3] OF LREAL; END_VAR
    VAR CONSTANT T : ARRAY[0..2] OF DINT := [3, -1, 7]; K : LREAL := -0.1; END_VAR
    y := 0.0; n := 0;
    FOR i := 1 TO 2 DO FOR j := 2 TO 0 BY -1 DO q[i, j] := i * 10 + T[j]; END_FOR; END_FOR;
    i := 0;
    WHILE TRUE DO i := i + 1; IF i = 2 THEN CONTINUE; END_IF; CASE i OF 1: n := n + 1; 3..5: n := n + 10; 6: EXIT;
    ELSE n := n - 1; END_CASE; END_WHILE;
    REPEAT n := n + q[2, 1]; i := i - 2; UNTIL i < 0 OR_ELSE n > 100 END_REPEAT;
    u.f := x; w := LWORD_TO_DWORD(SHR(u.n, 52)); b := (w AND 16#7FF) > 1023 XOR x < 0.0;
    fb(x := x, y => y);
    y := y + K * MAX(x, 1.0) - MIN(ABS(x), 2.0) + LIMIT(-1.0, x, 1.0) + SEL(b, x, -x) + SQRT(ABS(x));
    r := LREAL_TO_REAL(y); n := n + F(n) + F(a := 2, b := 4) + LREAL_TO_DINT(x) + TRUNC(x) + ABS(T[1]);
    s[1] := y; s[3] := x; a := s;
    b := NOT b AND NOT (x > 0.5 AND_THEN x < 1.5);
    END_FUNCTION_BLOCK
    """
    project = parse_project({"t.st": text}, "twincat")
    rows = np.array([[0.0], [0.5], [1.5], [2.5], [-2.5], [-1e3], [1e-300]])
    got = harness.values(library(project, "FB_T", tmp_path), rows, tmp_path)
    machine = Machine(project, rows=1)
    instance = machine.instance("FB_T")  # one instance, as in C: the block inside counts its calls
    for row, values in zip(rows, got, strict=True):
        instance(x=row)
        expected = [instance[name][0] for name in ("y", "r", "b", "n")] + list(np.ravel(instance["a"]))
        assert np.array_equal(values, np.array(expected, np.float64))


def test_what_is_not_emitted_is_refused():
    text = "FUNCTION_BLOCK FB_T VAR p : LREAL; q : POINTER TO LREAL; END_VAR q := ADR(p); END_FUNCTION_BLOCK"
    with pytest.raises(UntranslatableError):
        translate(parse_project({"t.st": text}, "twincat"), "FB_T", "race")
