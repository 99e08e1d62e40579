"""Texts that mean something else than they seem to say: `prove` accepts none of them, and neither does the checker."""

import re
import shutil
from pathlib import Path

import pytest

from st_codegen.driver import generate
from st_codegen.emit.output import block_of
from st_codegen.errors import StCodegenError
from st_codegen.project.bundle import load
from st_codegen.proof.prove.prove import Verdict, prove
from tests.proof.mutants import accepted_by_checker

GOLDEN = Path(__file__).resolve().parents[3] / "golden" / "lone"

#: A forest laid out as a table, and support vectors, in each of two targets.
TEXTS = {
    "iec": ("random_forest.skops", "iec"),
    "iec kernel": ("svr.skops", "iec"),
    "twincat": ("random_forest.skops", "twincat"),
    "twincat kernel": ("svr.skops", "twincat"),
}
FIRST, LAST = r"(bUsable := TRUE;\n)", r"(bValid := bUsable;\n)"
LOOP = r"(FOR nColumn := 0 TO 2 DO\n)"
CONSTANTS = r"(\nVAR CONSTANT\n)"
FEWER = "IF fMore < 16777216.5 THEN bUsable := FALSE; END_IF;\n"
STATE = r"\1IF nCalls > 5 THEN bUsable := FALSE; END_IF;\n"


def declared(line, *changes):
    """Changes with a variable more."""
    return ((r"(\nVAR\n)", rf"\1    {line}\n"), *changes)


#: What is changed in each text: pairs of a pattern and what stands in its place.
TRICKS = {
    "a plus in front of numbers of the other sign": (
        (
            r"(?s)((?:CELL_2|COEFFICIENT_3) : .*?:= \[)(.*?\])",
            lambda m: m[1] + re.sub(r"(?<![\w.])-?(\d+\.\d+)", r"-\1", m[2]),
        ),
        (r"fOut1 := aStep", "fOut1 := +aStep"),
    ),
    "the largest of three numbers": (
        (
            r"(anRank1\[0\] := )nRank;",
            r"nMore := 8;\nIF fX > EDGE_1_0[1] THEN nMore := 9; END_IF;\n\1MAX(nRank, 0, nMore);",
        ),
        (r"(\nVAR\n)", r"\1    nMore : DINT;\n"),
    ),
    "a comparison with bits": (
        (CONSTANTS, r"\1    MORE : DWORD := DWORD#16#5;\n"),
        (LAST, r"IF nCell > MORE THEN bUsable := bUsable; END_IF;\n\1"),
    ),
    "NOT of a whole number": declared("bMore : BOOL;", (LAST, r"bMore := NOT nRank >= 0;\n\1")),
    "OR of whole numbers": ((LAST, r"IF (nRank OR nCell) < 0 THEN bUsable := bUsable; END_IF;\n\1"),),
    "a whole number as a condition": ((LAST, r"IF nRank THEN bUsable := bUsable; END_IF;\n\1"),),
    "a whole number below a fraction": ((LAST, r"IF nRank < 2.5 THEN bUsable := bUsable; END_IF;\n\1"),),
    "a sum with a truth value": declared("nMore : DINT;", (LAST, r"nMore := bUsable + 1;\n\1")),
    "a place that is a truth value": declared("fMore : LREAL;", (LAST, r"fMore := CELL_2[bUsable];\n\1")),
    "a test for NaN that stops": (
        (r"F_IsNan\(aInput\[nColumn\]\)", "NOT (aInput[nColumn] < 1.0 OR aInput[nColumn] > -1.0)"),
    ),
    "hexadecimal digits of a narrow type": ((r"(SKIP_2_0 [^;]*?)8, 16", r"\1SINT#16#8, 16"),),
    "a variable named as the test for NaN": ((r"(?s)(\nVAR\n)(?=.*F_IsNan)", r"\1    f_isnan : DINT;\n"),),
    "a variable named as a truth value": declared("FALSE : BOOL;"),
    "a negative number without a sign": declared(
        "nMore : UDINT;", (LAST, r"nMore := DINT_TO_UDINT(-1);\nIF nMore = 0 THEN bUsable := FALSE; END_IF;\n\1")
    ),
    "two as a truth value": ((LAST, r"IF NOT DINT_TO_BOOL(2) THEN bUsable := FALSE; END_IF;\n\1"),),
    "a number that survives a restart by its attribute": declared(
        "{attribute 'TcRetain' := '1'} nCalls : DINT;", (FIRST, STATE)
    ),
    "a loop of one round": declared(
        "nMore : DINT;", (FIRST, "bUsable := FALSE;\nFOR nMore := 0 TO 0 DO\n    bUsable := TRUE;\nEND_FOR;\n")
    ),
    "an assignment before the result": ((FIRST, r"\1fOut1 := 9.0;\n"),),
    "a rank of one input that another one changes": (
        (r"(    nRank := nRank \+ 1;\n)(END_IF;\nanRank1\[1\])", r"\1IF bUsable THEN nRank := 1; END_IF;\n\2"),
    ),
    "a loop whose end it assigns": declared(
        "nEnd : DINT;", (LOOP, "nEnd := 2;\nFOR nColumn := 0 TO nEnd DO\n    nEnd := 1;\n")
    ),
    "a loop whose step it assigns": declared(
        "nEnd : DINT;", (LOOP, "nEnd := 1;\nFOR nColumn := 0 TO 2 BY nEnd DO\n    nEnd := 2;\n")
    ),
    "a loop that ends at its counter": ((LOOP, "nColumn := 2;\nFOR nColumn := 0 TO nColumn DO\n"),),
    "an input that is assigned": ((LAST, r"\1fF0 := 0.0;\n"),),
    "halves that compilers round differently": declared(
        "nHalf : DINT;", (FIRST, "nHalf := LREAL_TO_DINT(2.5);\nbUsable := nHalf = 2;\n")
    ),
    "a temporary number that is read first": (
        (r"(\nVAR\n)", "\nVAR_TEMP\n    nOld : DINT;\nEND_VAR\nVAR\n"),
        (FIRST, r"\1IF nOld > 0 THEN bUsable := FALSE; END_IF;\n"),
    ),
    "a number that all instances share": (
        (r"(\nVAR\n)", "\nVAR_STAT\n    nCalls : DINT;\nEND_VAR\nVAR\n"),
        (FIRST, r"\1IF nCalls > 0 THEN bUsable := FALSE; END_IF;\nnCalls := nCalls + 1;\n"),
    ),
    "what Python takes for a comment": ((FIRST, "bUsable := TRUE # AND FALSE;\n"),),
    "a division of integers": ((FIRST, "IF 3 / 2 > 1 THEN bUsable := TRUE; ELSE bUsable := FALSE; END_IF;\n"),),
    "a remainder of a negative number": declared(
        "nHalf : DINT;", (FIRST, "nHalf := -3;\nbUsable := nHalf MOD 2 = 1;\n")
    ),
    "truncation of a negative number": declared(
        "nHalf : DINT;", (FIRST, "nHalf := TRUNC(-2.5);\nbUsable := nHalf = -3;\n")
    ),
    "powers from the left": ((FIRST, "bUsable := 2.0 ** 3.0 ** 2.0 > 100.0;\n"),),
    "a difference from the right": ((FIRST, "bUsable := 5.0 - 3.0 - 1.0 > 2.0;\n"),),
    "NOT before a comparison": ((LAST, r"bUsable := NOT bUsable = FALSE AND bUsable = FALSE;\n\1"),),
    "an exclusive OR": ((LAST, r"bUsable := bUsable XOR TRUE;\n\1"),),
    "a case that another one hides": (
        (LAST, r"CASE 3 OF 0..5: bUsable := FALSE; 3: bUsable := bUsable; END_CASE;\n\1"),
    ),
    "a range of cases from above": (
        (r"(anRank1\[0\] := nRank;)", r"\1\nCASE nRank OF 3..0: ; ELSE anRank1[0] := 2; END_CASE;"),
    ),
    "a number of fewer digits on the way": ((r"\b(fX|fSum) : LREAL", r"\1 : REAL"),),
    "inputs of fewer digits on the way": ((r"(aInput : ARRAY\[0\.\.2\] OF )LREAL", r"\1REAL"),),
    "constants of fewer digits": ((r"((?:CELL_2|VECTOR_3) : ARRAY\[0\.\.\d+\] OF )LREAL", r"\1REAL"),),
    "a table that is counted from 1": (
        (r"(CELL_2|VECTOR_3) : ARRAY\[0\.\.(\d+)\]", lambda m: f"{m[1]} : ARRAY[1..{int(m[2]) + 1}]"),
    ),
    "a type that is too narrow": ((r"nRank : DINT", "nRank : DINT(0..1)"),),
    "a pointer to the result": declared("pOut : POINTER TO LREAL;", (LAST, r"\1pOut := ADR(fOut1);\npOut^ := 0.0;\n")),
    "a reference to the result": declared("rOut : REFERENCE TO LREAL;", (LAST, r"\1rOut REF= fOut1;\nrOut := 0.0;\n")),
    "a line that ends for some": ((LAST, "\\1// \u2028bValid := TRUE;\n"),),
    "a line that a form feed ends": ((LAST, "\\1// \x0cbValid := TRUE;\n"),),
    "a jump": ((LAST, r"JMP over;\nbUsable := TRUE;\nover:\n\1"),),
    "a limit of another magnitude": ((r"(INPUT_LIMIT[^;]*?)(3\.40282356|9\.99999999)\d*E", r"\g<1>\g<2>7E"),),
    "a limit that no number is": ((r"(INPUT_LIMIT[^;]*?)\d\.\d+E\d+", r"\g<1>1.0E400"),),
    "a letter of another alphabet": (
        (r"(\n    bUsable : BOOL;)", r"\1\n    bUsаble : BOOL := TRUE;"),  # noqa: RUF001
        (LAST, "bValid := bUsаble;\n"),  # noqa: RUF001
    ),
    "an assignment behind the result": ((LAST, r"\1fOut1 := 0.0;\n"),),
    "an assignment in other letters": ((LAST, r"\1FOUT1 := 0.0;\n"),),
    "bValid is set again": ((LAST, r"\1bValid := TRUE;\n"),),
    "two names of one place": ((r"\b(fX|fSum|nColumn) : (\w+);", r"\1 AT %MD0 : \2;"),),
    "an input at an address": ((r"fF0 : LREAL", "fF0 AT %ID0 : LREAL"),),
    "RETURN before the end": ((FIRST, r"\1IF bUsable THEN RETURN; END_IF;\n"),),
    "EXIT outside of a loop": ((LAST, r"IF bUsable THEN EXIT; END_IF;\n\1"),),
    "EXIT in a loop": ((LOOP, r"\1IF nColumn = 1 THEN EXIT; END_IF;\n"),),
    "CONTINUE in a loop": ((LOOP, r"\1IF nColumn = 1 THEN CONTINUE; END_IF;\n"),),
    "a counter that its loop assigns": ((LOOP, r"\1nColumn := nColumn + 1;\nnColumn := nColumn - 1;\n"),),
    "a loop in a loop with its counter": ((LOOP, rf"\1{LOOP[1:-1]}bUsable := bUsable;\nEND_FOR;\n"),),
    "a loop that never ends": declared(
        "nEnd : SINT;", (FIRST, r"\1FOR nEnd := 120 TO 127 DO\nbUsable := TRUE;\nEND_FOR;\n")
    ),
    "a loop to the largest number": declared(
        "nEnd : DINT;", (FIRST, r"\1FOR nEnd := 2147483646 TO 2147483647 DO\nbUsable := TRUE;\nEND_FOR;\n")
    ),
    "a step of zero": ((LOOP, "FOR nColumn := 0 TO 2 BY 0 DO\n"),),
    "a counter before its loop": ((FIRST, "bUsable := nColumn = 0;\n"),),
    "a counter behind its loop": ((LAST, r"bUsable := bUsable AND nColumn = 3;\n\1"),),
    "a number that calls add up": declared("nCalls : DINT;", (FIRST, STATE), (LAST, r"\1nCalls := nCalls + 1;\n")),
    "a number that a later loop counts": declared(
        "nCalls : DINT;", (FIRST, STATE), (LAST, r"\1FOR nCalls := 0 TO 9 DO\nbValid := bUsable;\nEND_FOR;\n")
    ),
    "a number that survives a restart": (
        (r"(\nVAR\n)", "\nVAR RETAIN\n    nCalls : DINT;\nEND_VAR\nVAR\n"),
        (FIRST, STATE),
    ),
    "an output of the call before": (
        (r"(    bValid : BOOL;)", r"    bOld : BOOL;\n\1"),
        (FIRST, r"\1IF bOld THEN bUsable := FALSE; END_IF;\n"),
        (LAST, r"\1bOld := bUsable;\n"),
    ),
    "conditional compilation": ((FIRST, r"{IF defined(NEVER)}\n\1{END_IF}\n"),),
    "a pragma that leaves out initial values": declared("{attribute 'no_init'} nCalls : DINT;", (FIRST, STATE)),
    "a comment in a comment": ((FIRST, r"\1(* (* *) bUsable := FALSE; (* *) *)\n"),),
    "a comment of another kind in a comment": ((FIRST, r"\1(* /* *) bUsable := bUsable; (* */ *)\n"),),
    "an input of fewer digits": ((r"fF0 : LREAL", "fF0 : REAL"),),
    "inputs in another order": ((r"\bfF0\b", "fF9"), (r"\bfF1\b", "fF0"), (r"\bfF9\b", "fF1")),
    "an input of another name": ((r"\bfF0\b", "fZ"),),
    "an output of another name": ((r"\bfOut1\b", "fOut2"),),
    "a parameter that is changed": ((r"(\nVAR_OUTPUT\n)", r"\nVAR_IN_OUT\n    fMore : LREAL;\nEND_VAR\1"),),
    "an index that runs over": ((r"nCell := (.*);", r"nCell := \1 + 2147483647 - 2147483647;"),),
    "two assignments in one": declared("bMore : BOOL;", (LAST, r"bMore := bUsable := FALSE;\n\1")),
    "an input that is a whole number": ((r"fF0 : LREAL", "fF0 : DINT"),),
    "an integer that runs over": declared("nMore : DINT;", (LAST, r"\1nMore := 2147483647;\nnMore := nMore + 1;\n")),
    "a division by zero": declared("fMore, fZero : LREAL;", (LAST, r"\1fMore := 1.0 / fZero;\n")),
    "a constant that is assigned": ((FIRST, r"\1INPUT_LIMIT[0] := 5.0;\n"),),
    "a constant that is declared twice": declared("INPUT_LIMIT : ARRAY[0..2] OF LREAL;"),
    "a whole number that takes a fraction": declared(
        "nHalf : DINT;", (FIRST, r"\1nHalf := 2.5;\nIF nHalf < 2.4 THEN bUsable := FALSE; END_IF;\n")
    ),
    "a number that a constant of another file may be": (
        (CONSTANTS, r"\1    MORE : ARRAY[0..0] OF LREAL := [inf];\n"),
        (LAST, r"IF ABS(aInput[0]) > MORE[0] THEN bUsable := FALSE; END_IF;\n\1"),
    ),
    "a number beyond the largest": ((LAST, r"IF ABS(aInput[0]) > 1.0E400 THEN bUsable := FALSE; END_IF;\n\1"),),
    "a whole number that its type cannot hold": (
        (CONSTANTS, r"\1    MORE : ARRAY[0..0] OF SINT := [300];\n"),
        (LAST, r"IF SINT_TO_DINT(MORE[0]) < 299 THEN bUsable := FALSE; END_IF;\n\1"),
    ),
    "a sum of whole numbers that its type cannot hold": (
        (CONSTANTS, r"\1    MORE : ARRAY[0..0] OF SINT := [100];\n"),
        (LAST, r"IF MORE[0] + MORE[0] < 199 THEN bUsable := FALSE; END_IF;\n\1"),
    ),
    "a sum of fewer digits": declared(
        "fMore : LREAL;",
        (FIRST, r"\1fMore := REAL_TO_LREAL(LREAL_TO_REAL(16777216.0) + LREAL_TO_REAL(1.0));\n" + FEWER),
    ),
    "an overflow that two inputs start beside a refused one": declared(
        "fMore : LREAL;",
        (
            LAST,
            r"IF NOT bUsable AND aInput[0] > 5.0 AND aInput[1] > 5.0 THEN fMore := fX * 1.0E308 * 1.0E308; END_IF;\n\1",
        ),
    ),
    "a test that no number passes": ((r"OR (aInput\[nColumn\] > -1.0)", r"AND \1"),),
    "no test for NaN": ((r"F_IsNan\(.*?\)", "FALSE"),),
}


#: Certificates name inputs as models do, the checker knows no names that a user gives to the block's.
RENAMED = {"an input of another name"}


def changed(text, changes):
    """The text with all changes, or None where the first of them has no place in it."""
    for number, (pattern, new) in enumerate(changes):
        text, count = re.subn(pattern, new, text, count=0 if pattern.startswith(r"\b") else 1)
        if not count:
            assert number == 0
            return None
    return text


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """For each text: its bundle, the folder of the model, that of the target, and the block's file."""
    found = {}
    for name, (model, target) in TEXTS.items():
        folder = tmp_path_factory.mktemp("tricks")
        (folder / "models").mkdir()
        shutil.copy(GOLDEN / "models" / model, folder / "models")
        shutil.copytree(GOLDEN / "generated" / target, folder / target)
        bundle = load(folder / "models")
        block, _ = block_of(folder / target, bundle.models[0].ir)
        (path,) = (folder / target).rglob(f"{block}.*")
        others = [p for p in path.parent.iterdir() if p.stem.startswith("FB_") and p != path]
        for other in others:
            other.unlink()
        found[name] = bundle, folder / "models", folder / target, path
    return found


def verdicts(bundle, models, out, path, text):
    """Whether `prove` and the checker accept a text in the place of another."""
    original = path.read_text("utf-8")
    path.write_text(text, "utf-8")
    try:
        (result,) = prove(bundle, out).results
        proved = result.verdict is Verdict.PROVED
    except StCodegenError:
        proved = False
    try:
        return proved, accepted_by_checker(bundle, models, out, path)
    finally:
        path.write_text(original, "utf-8")


@pytest.mark.parametrize("name", TEXTS)
def test_the_texts_are_proved_as_they_are(name, made):
    case = made[name]
    assert verdicts(*case, case[-1].read_text("utf-8")) == (True, "kernel" not in name)


def test_signals_of_the_machine_have_addresses(made):
    bundle, _, out, _ = made["twincat"]
    signals = "VAR_GLOBAL\n    fSpeed AT %I* : LREAL;\nEND_VAR\n"
    path = out / "GVL_Machine.TcGVL"
    head = '<TcPlcObject Version="1.1.0.1"><GVL Name="GVL_Machine" Id="{00000000-0000-5000-8000-000000000001}">'
    tail = "<Declaration><![CDATA[" + signals + "]]></Declaration></GVL></TcPlcObject>"
    path.write_text('<?xml version="1.0" encoding="utf-8"?>' + head + tail, "utf-8")
    try:
        assert prove(bundle, out).proved
    finally:
        path.unlink()


@pytest.mark.thorough
@pytest.mark.parametrize("trick", TRICKS)
def test_a_text_that_means_something_else_is_accepted_by_nobody(trick, made):
    tried = 0
    for case in (made[name] for name in TEXTS if name != "twincat kernel"):
        text = case[-1].read_text("utf-8")
        new = changed(text, TRICKS[trick])
        if new is not None and new != text:
            tried += 1
            proved, checked = verdicts(*case, new)
            assert not proved and (not checked or trick in RENAMED), case[-1]
    assert tried


def test_the_checker_gives_up_on_a_comparison_that_no_cut_decides(made):
    new = re.sub(
        LAST, r"IF aInput[0] = aInput[0] THEN bUsable := bUsable; END_IF;\n\1", made["iec"][-1].read_text("utf-8")
    )
    assert verdicts(*made["iec"], new) == (False, False)


#: Changes of what the test for NaN is made of, in files beside the block's.
HELPERS = {
    "a structure is no union": ("DUTs/U_LrealBits.TcDUT", "UNION", "STRUCT"),
    "a test that finds nothing": ("POUs/F_IsNan.TcPOU", "\n]]></ST>", "\nF_IsNan := FALSE;\n]]></ST>"),
    "a test of fewer digits": ("POUs/F_IsNan.TcPOU", "fValue : LREAL", "fValue : REAL"),
}


def _unit(kind, name, declaration, body):
    head = f'<TcPlcObject Version="1.1.0.1"><{kind} Name="{name}" Id="{{00000000-0000-5000-8000-000000000009}}">'
    text = f"<Declaration><![CDATA[{declaration}]]></Declaration>"
    text += f"<Implementation><ST><![CDATA[{body}]]></ST></Implementation>" if body else ""
    return f'<?xml version="1.0" encoding="utf-8"?>{head}{text}</{kind}></TcPlcObject>'


NAN = "FUNCTION F_IsNan : BOOL\nVAR_INPUT\n    fValue : LREAL;\nEND_VAR\n"
SIZE = "FUNCTION ABS : LREAL\nVAR_INPUT\n    fX : LREAL;\nEND_VAR\n"
EMPTY = "FUNCTION_BLOCK FB_Random_forest\nVAR_INPUT\n    fF0 : LREAL;\nEND_VAR\n"
#: Files beside the block's that give its names another meaning.
BESIDE = {
    "a type that is defined anew": ("iec", "Z.st", "TYPE LREAL : REAL; END_TYPE\n"),
    "a function that is defined anew": ("iec", "Z.st", SIZE + "ABS := 0.0;\nEND_FUNCTION\n"),
    "a second block": ("iec", "Z.ST", EMPTY + "END_FUNCTION_BLOCK\n"),
    "another test for NaN": ("twincat", "POUs/F_Other.TcPOU", _unit("POU", "F_IsNan", NAN, "F_IsNan := FALSE;")),
    "another union": (
        "twincat",
        "DUTs/U_Other.TcDUT",
        _unit("DUT", "U_LrealBits", "TYPE U_LrealBits : STRUCT\nfValue : LREAL;\nEND_STRUCT\nEND_TYPE", ""),
    ),
    "a block in another file": ("twincat", "POUs/A.TcPOU", _unit("POU", "FB_Random_forest", EMPTY, "bValid := TRUE;")),
    "a value named as a function": ("iec", "Z.st", "TYPE E_Size : (ABS, LREAL_TO_REAL); END_TYPE\n"),
    "a block named as a function": ("iec", "Z.st", EMPTY.replace("FB_Random_forest", "ABS") + "END_FUNCTION_BLOCK\n"),
    "another ABS": ("twincat", "POUs/ABS.TcPOU", _unit("POU", "ABS", SIZE, "ABS := 0.0;")),
}


@pytest.mark.parametrize("name", BESIDE)
def test_a_name_of_two_meanings_is_accepted_by_nobody(name, made):
    target, file, text = BESIDE[name]
    path = made[target][2] / file
    path.write_text(text, "utf-8")
    try:
        assert verdicts(*made[target], made[target][-1].read_text("utf-8")) == (False, False)
    finally:
        path.unlink()


METHOD = '<Method Name="fX" Id="{00000000-0000-5000-8000-000000000009}"><Declaration>METHOD fX : LREAL</Declaration>'
#: What stands in the XML file of a block beside its text.
AROUND = {
    "a statement in front of the text": ("<ST>", "<ST>fOut1 := 9.0; "),
    "a statement behind the text": ("</ST>", "fOut1 := 1.0;</ST>"),
    "a second text": ("</Implementation>", "</Implementation><Implementation><ST>fOut1 := 1.0;</ST></Implementation>"),
    "another language in front of the text": (
        "<Implementation>",
        "<Implementation><NWL /></Implementation><Implementation>",
    ),
    "a method named as a variable": (
        "</POU>",
        f"{METHOD}<Implementation><ST>fX := 1.0;</ST></Implementation></Method></POU>",
    ),
}


@pytest.mark.parametrize("name", AROUND)
def test_what_stands_around_a_text_is_read(name, made):
    text = made["twincat"][-1].read_text("utf-8")
    old, new = AROUND[name]
    assert old in text
    assert verdicts(*made["twincat"], text.replace(old, new, 1)) == (False, False)


BASE = "FUNCTION_BLOCK FB_Base\nVAR\n    nMore : DINT;\nEND_VAR\n"
HEAD = "FUNCTION_BLOCK FB_Random_forest"
#: What makes a block more than its own statements, one by one.
MORE = {
    "a block that it extends": (HEAD, f"{HEAD} EXTENDS FB_Base"),
    "a modifier": (HEAD, "FUNCTION_BLOCK ABSTRACT FB_Random_forest"),
    **{
        f"a method {name} that the controller calls": (
            "</POU>",
            METHOD.replace("fX : LREAL", f"{name} : BOOL").replace('"fX"', f'"{name}"')
            + f"<Implementation><ST>{name} := TRUE; fOut1 := 9.0;</ST></Implementation></Method></POU>",
        )
        for name in ("FB_init", "FB_reinit", "FB_exit")
    },
}


@pytest.mark.parametrize("name", MORE)
def test_a_block_that_is_more_than_its_statements_is_accepted_by_nobody(name, made):
    bundle, _, out, path = made["twincat"]
    base, original = out / "POUs" / "FB_Base.TcPOU", path.read_text("utf-8")
    base.write_text(_unit("POU", "FB_Base", BASE, "nMore := 0;"), "utf-8")
    old, new = MORE[name]
    assert old in original
    try:
        assert verdicts(*made["twincat"], original.replace(old, new, 1)) == (False, False)
        path.write_text(original.replace(old, new, 1), "utf-8")
        (result,) = prove(bundle, out).results
        assert "extends a block or has a method that nobody calls" in result.reason
    finally:
        path.write_text(original, "utf-8")
        base.unlink()


@pytest.mark.parametrize("name", ["twincat", "twincat kernel"])
@pytest.mark.parametrize("change", HELPERS)
def test_a_test_for_nan_that_was_changed_is_accepted_by_nobody(change, name, made):
    file, old, new = HELPERS[change]
    path = made[name][2] / file
    original = path.read_text("utf-8")
    assert old in original
    path.write_text(original.replace(old, new), "utf-8")
    try:
        assert verdicts(*made[name], made[name][-1].read_text("utf-8")) == (False, False)
    finally:
        path.write_text(original, "utf-8")


def test_an_output_that_is_never_assigned_is_named(tmp_path):
    """Of a model that takes every input, where `bValid` is TRUE at all times."""
    (tmp_path / "models").mkdir()
    shutil.copy(GOLDEN / "models" / "lightgbm_gbdt.txt", tmp_path / "models")
    bundle = load(tmp_path / "models")
    generate(bundle, "iec", tmp_path / "out")
    text = tmp_path / "out" / "iec" / "FB_Lightgbm_gbdt.st"
    changed, count = re.subn(r"(?m)^ *fOut1 := .*\n", "", text.read_text())
    assert count == 1
    text.write_text(changed)
    (found,) = prove(bundle, tmp_path / "out").results
    assert (found.verdict, found.reason) == (Verdict.REFUTED, "fOut1 is not assigned")
