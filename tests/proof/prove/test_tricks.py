"""Texts that mean something else than they seem to say: `prove` accepts none of them, and neither does the checker."""

import re
import shutil
from pathlib import Path

import pytest

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
STATE = r"\1IF nCalls > 5 THEN bUsable := FALSE; END_IF;\n"


def declared(line, *changes):
    """Changes with a variable more."""
    return ((r"(\nVAR\n)", rf"\1    {line}\n"), *changes)


#: What is changed in each text: pairs of a pattern and what stands in its place.
TRICKS = {
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
    "an input of fewer digits": ((r"fF0 : LREAL", "fF0 : REAL"),),
    "inputs in another order": ((r"\bfF0\b", "fF9"), (r"\bfF1\b", "fF0"), (r"\bfF9\b", "fF1")),
    "an input of another name": ((r"\bfF0\b", "fZ"),),
    "an output of another name": ((r"\bfOut1\b", "fOut2"),),
    "a parameter that is changed": ((r"(\nVAR_OUTPUT\n)", r"\nVAR_IN_OUT\n    fMore : LREAL;\nEND_VAR\1"),),
    "an index that runs over": ((r"nCell := (.*);", r"nCell := \1 + 2147483647 - 2147483647;"),),
    "an integer that runs over": declared("nMore : DINT;", (LAST, r"\1nMore := 2147483647;\nnMore := nMore + 1;\n")),
    "a division by zero": declared("fMore, fZero : LREAL;", (LAST, r"\1fMore := 1.0 / fZero;\n")),
    "a constant that is assigned": ((FIRST, r"\1INPUT_LIMIT[0] := 5.0;\n"),),
    "a constant that is declared twice": declared("INPUT_LIMIT : ARRAY[0..2] OF LREAL;"),
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


#: Changes of what the test for NaN is made of, in files beside the block's.
HELPERS = {
    "a structure is no union": ("DUTs/U_LrealBits.TcDUT", "UNION", "STRUCT"),
    "a test that finds nothing": ("POUs/F_IsNan.TcPOU", "\n]]></ST>", "\nF_IsNan := FALSE;\n]]></ST>"),
    "a test of fewer digits": ("POUs/F_IsNan.TcPOU", "fValue : LREAL", "fValue : REAL"),
}


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
