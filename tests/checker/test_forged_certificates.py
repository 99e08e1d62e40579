"""Certificates that are made to pass for other files than those that the checker is given."""

import hashlib
import json
import shutil

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from tests.checker.test_check_certificate import GOLDEN, check, folder_of, written
from tests.proof import mutants

MODEL = "lightgbm_gbdt.txt"
BLOCK = "FB_Lightgbm_gbdt"


@pytest.fixture
def proved(tmp_path):
    """A folder with a model, one with its text, and a certificate: (path of the certificate, models, out)."""
    models = folder_of(tmp_path, [MODEL])
    generate(load(models), "iec", tmp_path / "out", options=Options(layout=Layout.TREES))
    return written(tmp_path, models, tmp_path / "out"), models, tmp_path / "out"


def changed(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def spoilt(text):
    """Make a text give another number."""
    before = text.read_text()
    text.write_text(before.replace("bValid := bUsable;", "fOut1 := 1.0;\nbValid := bUsable;"))
    assert text.read_text() != before


@pytest.mark.parametrize("name", ["../good/iec", "iec/../../good/iec", "{absolute}"])
def test_texts_of_another_folder(name, proved, tmp_path):
    path, models, out = proved
    shutil.copytree(out, tmp_path / "good")
    spoilt(out / "iec" / f"{BLOCK}.st")
    name = name.format(absolute=tmp_path / "good" / "iec")

    def elsewhere(content):
        content["texts"] = {name: content["texts"]["iec"]}
        content["proofs"][0]["target"] = name

    changed(path, elsewhere)
    result = check(path, models, out)
    assert (result.returncode, "confirmed" in result.stdout) == (1, False), result.stdout


@pytest.mark.parametrize("name", ["../good/{}", "{absolute}/{}", "./{}"])
def test_a_model_of_another_folder(name, proved, tmp_path):
    path, models, out = proved
    shutil.copytree(models, tmp_path / "good")
    (models / MODEL).write_text("damaged")
    name = name.format(MODEL, absolute=tmp_path / "good")

    def elsewhere(content):
        content["models"] = {name: content["models"][MODEL]}
        content["proofs"][0]["file"] = name

    changed(path, elsewhere)
    result = check(path, models, out)
    assert (result.returncode, "confirmed" in result.stdout) == (1, False), result.stdout


def test_a_model_behind_a_link_that_leaves_its_folder(proved, tmp_path):
    path, models, out = proved
    shutil.move(models / MODEL, tmp_path / "elsewhere.txt")
    (models / MODEL).symlink_to(tmp_path / "elsewhere.txt")
    assert "leads out of the folder" in check(path, models, out).stdout


def test_text_behind_a_link(proved, tmp_path):
    path, models, out = proved
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "FB_Other.st").write_text("FUNCTION_BLOCK FB_Other\nEND_FUNCTION_BLOCK\n")
    (out / "iec" / "more").symlink_to(tmp_path / "more")
    assert "a link" in check(path, models, out).stdout


def test_a_text_whose_name_ends_in_capitals_is_held_to_its_hash(proved):
    path, models, out = proved
    text = out / "iec" / f"{BLOCK}.st"
    text.rename(text.with_suffix(".ST"))
    changed(path, lambda content: content["texts"]["iec"].pop(text.name))
    assert "other texts" in check(path, models, out).stdout


def test_another_file_as_the_model_of_a_block(proved):
    path, models, out = proved
    (models / MODEL).rename(models / "other.txt")
    shutil.copy(GOLDEN / "models" / "lightgbm_missing.txt", models / MODEL)

    def renamed(content):
        content["models"] = {"other.txt": content["models"][MODEL]}
        content["proofs"][0] |= {"model": "other", "file": "other.txt"}

    changed(path, renamed)
    assert "another model's block" in check(path, models, out).stdout


def test_a_file_that_is_named_otherwise_than_its_block_is_printed(proved):
    path, models, out = proved
    (models / MODEL).rename(models / "other.txt")

    def renamed(content):
        content["models"] = {"other.txt": content["models"][MODEL]}
        content["proofs"][0]["file"] = "other.txt"

    changed(path, renamed)
    assert "lightgbm_gbdt, iec (other.txt): confirmed" in check(path, models, out).stdout


def test_a_pattern_in_place_of_a_block(proved):
    path, models, out = proved
    changed(path, lambda content: content["proofs"][0].update(block="FB_\\w+_gbdt"))
    assert "the name of the block" in check(path, models, out).stdout


def in_a_variable(text):
    """The right number in a variable of the block, and another in its output."""
    return text.replace("fOut1 := ", "fRight := ").replace("\nVAR\n", "\nVAR\n    fRight : LREAL;\n", 1)


def beside_another(text):
    """The right number, and another output that no entry speaks of."""
    return text.replace("VAR_OUTPUT\n", "VAR_OUTPUT\n    fOut0 : LREAL;\n", 1).replace(
        "bValid := bUsable;", "fOut0 := 1.0;\nbValid := bUsable;"
    )


@pytest.mark.parametrize(("change", "outputs"), [(in_a_variable, ["fRight"]), (beside_another, ["fOut1"])])
def test_outputs_that_are_not_those_of_the_block(change, outputs, proved):
    path, models, out = proved
    text = out / "iec" / f"{BLOCK}.st"
    before = text.read_text()
    text.write_text(change(before))
    assert text.read_text() != before
    digest = hashlib.sha256(text.read_bytes()).hexdigest()

    def forged(content):
        content["texts"]["iec"][text.name] = digest
        content["proofs"][0]["outputs"] = outputs

    changed(path, forged)
    result = check(path, models, out)
    assert (result.returncode, "other outputs than the block's" in result.stdout) == (1, True), result.stdout


def test_a_name_that_stands_twice(proved):
    path, models, out = proved
    assert check(path, models, out).returncode == 0
    text = path.read_text()
    path.write_text(text.replace('"models": {', f'"models": {{"{MODEL}": "0", ', 1))
    assert "a name twice" in check(path, models, out).stdout


def test_what_is_no_number(proved):
    path, models, out = proved
    changed(path, lambda content: content["proofs"][0].update(bound=[np.nan], method="the model's expression"))
    assert "NaN in the certificate" in check(path, models, out).stdout


#: Texts beside those of a block by which its words would mean something else, hidden from who takes `(*` as it stands.
HIDDEN = {
    "behind a line's comment": "// (*\n{}\n// *)\n",
    "behind a string": "VAR_GLOBAL s : STRING := '(*'; END_VAR\n{}\n(* ' *)\n",
    "behind a pragma": "{{info '(*'}}\n{}\n(* *)\n",
    "behind a comment of another kind": "/* (* */\n{}\n/* *) */\n",
}
OTHER = {
    "a type": "TYPE LREAL : REAL; END_TYPE",
    "a function": "FUNCTION ABS : LREAL\nVAR_INPUT x : LREAL; END_VAR\nABS := x + 1.0;\nEND_FUNCTION",
    "the block": f"FUNCTION_BLOCK PUBLIC {BLOCK}\nEND_FUNCTION_BLOCK",
}
FUNCTION = ": LREAL\nVAR_INPUT x : LREAL; END_VAR\nABS := x + 1.0;\nEND_FUNCTION"
#: Such texts as they stand, or hidden from who takes a line, a word, a comment, a string or a pragma for another one.
FORMS = {
    "words around a line's comment": "TYPE LREAL // x\n : REAL; END_TYPE",
    "words around a pragma": "TYPE LREAL {attribute 'x'} : REAL; END_TYPE",
    "words around a known pragma": "TYPE LREAL {attribute 'strict'} : REAL; END_TYPE",
    "a structure around a line's comment": "TYPE LREAL // x\n : STRUCT a : INT; END_STRUCT END_TYPE",
    "a function around a line's comment": f"FUNCTION // x\nABS {FUNCTION}",
    "a function without blanks": f"FUNCTION ABS(* x *){FUNCTION}",
    "the block around a line's comment": f"FUNCTION_BLOCK // x\n{BLOCK}\nEND_FUNCTION_BLOCK",
    "the block around a pragma": f"FUNCTION_BLOCK {{attribute 'x'}} {BLOCK}\nEND_FUNCTION_BLOCK",
    "the block around known pieces": f"FUNCTION_BLOCK {{attribute 'hide'}} (* *) {BLOCK}\nEND_FUNCTION_BLOCK",
    "the block, overridden": f"FUNCTION_BLOCK OVERRIDE {BLOCK}\nEND_FUNCTION_BLOCK",
    "the block in capitals": f"FUNCTION_BLOCK\t{BLOCK.upper()}\nEND_FUNCTION_BLOCK",
    "a type as the block": f"TYPE {BLOCK} : INT; END_TYPE",
    "a program as the block": f"PROGRAM {BLOCK}\nEND_PROGRAM",
    "a method of the block": f"METHOD {BLOCK}.FB_init : BOOL\nEND_METHOD",
    "a variable as the block": f"VAR_GLOBAL {BLOCK} : INT; END_VAR",
    "a variable as a function": "VAR_GLOBAL ABS : INT; END_VAR",
    "a value as a type": "TYPE E : (LREAL, x); END_TYPE",
    "a value as a function": "TYPE E : (ABS := 1, x); END_TYPE",
    "one of two types": "TYPE A : INT; LREAL : REAL; END_TYPE",
    "comments of two kinds": "(* /* *) TYPE LREAL : REAL; END_TYPE (* */ *)",
    "a comment that begins as it ends": "(*) TYPE LREAL : REAL; END_TYPE (* *)",
    "a string with the end of a line": "VAR_GLOBAL s : STRING := 'a$\nTYPE LREAL : REAL; END_TYPE '; END_VAR",
    "a pragma with a condition": "{IF defined (x)}\nTYPE LREAL : REAL; END_TYPE\n{END_IF}",
    **{f"U+{ord(end):04X}": f"// x{end}TYPE LREAL : REAL; END_TYPE" for end in "\r\v\f\x1c\x85\u2028\u2029"},
    **{f"U+{ord(end):04X} in a comment": f"(* x{end} *)" for end in "\r\v\f\x1c\x85\u2028\u2029\xa0"},
}


@pytest.mark.parametrize("name", ["{}", *HIDDEN.values()], ids=["plainly", *HIDDEN])
@pytest.mark.parametrize("what", OTHER)
def test_what_gives_names_another_meaning_cannot_be_hidden(what, name, proved):
    path, models, out = proved
    with_text(path, out / "iec" / "Other.st", name.format(OTHER[what]))
    result = check(path, models, out)
    assert (result.returncode, "confirmed" in result.stdout) == (1, False), result.stdout


@pytest.mark.parametrize("what", FORMS)
def test_what_some_compiler_may_read_otherwise_is_rejected(what, tmp_path):
    shutil.copy(GOLDEN / "generated" / "iec" / f"{BLOCK}.st", tmp_path)
    assert len(mutants.check_certificate.codes(tmp_path, BLOCK)) == 1
    (tmp_path / "Other.st").write_bytes(f"{FORMS[what]}\n".encode())
    with pytest.raises(mutants.check_certificate.Reject):
        mutants.check_certificate.codes(tmp_path, BLOCK)


#: Changes of a block's text: what stands there, and what stands in its place.
END = "bValid := bUsable;\n"
CHANGES = {
    "a name that begins as the end of a block": (
        ("\nVAR\n", "\nVAR\n    END_FUNCTION_BLOCK_1 : LREAL;\n"),
        (END, END + "END_FUNCTION_BLOCK_1 := 0.0;\nfOut1 := 9.0;\n"),
    ),
    "an end of the block before its end": ((END, END + "END_FUNCTION_BLOCK\nfOut1 := 9.0;\n"),),
    "inputs that are constants": (("VAR_INPUT\n", "VAR_INPUT CONSTANT\n"),),
    "a statement without its end": ((END, f"IF bUsable THEN\nnNode := 0;\nnNode := 9\nEND_IF;\n{END}"),),
}


@pytest.mark.parametrize("target", ["iec", "twincat"])
@pytest.mark.parametrize("what", CHANGES)
def test_a_block_that_some_compiler_may_read_otherwise_is_not_confirmed(what, target, tmp_path):
    change_block(tmp_path, target, CHANGES[what])


#: Changes of a file of TwinCAT.
OBJECTS = {
    "another name": (f'Name="{BLOCK}"', 'Name="FB_Other"'),
    "text behind an element": ("</Declaration>", "</Declaration>fOut1 := 9.0;"),
    "two bodies": ("</Implementation>", "</Implementation><Implementation><ST><![CDATA[EXIT;]]></ST></Implementation>"),
    "text behind CDATA": ("]]></ST>", "]]><![CDATA[fOut1 := 9.0;]]></ST>"),
    "a block that ends where its declaration does": ("\n]]></Declaration>", "\nEND_FUNCTION_BLOCK\n]]></Declaration>"),
    "another encoding": ('encoding="utf-8"', 'encoding="cp037"'),
}


@pytest.mark.parametrize("what", OBJECTS)
def test_an_object_of_another_form_is_not_confirmed(what, tmp_path):
    change_block(tmp_path, "twincat", [OBJECTS[what]])


def change_block(tmp_path, target, changes):
    """Hold that a text is confirmed, and is not once it was changed."""
    models = folder_of(tmp_path, [MODEL])
    generate(load(models), target, tmp_path / "out", options=Options(layout=Layout.TREES))
    path, (text,) = written(tmp_path, models, tmp_path / "out"), tmp_path.rglob(f"{BLOCK}.*")
    content = text.read_text()
    assert check(path, models, tmp_path / "out").returncode == 0
    for old, new in changes:
        assert content.count(old) == 1
        content = content.replace(old, new)
    with_text(path, text, content, tmp_path / "out" / target)
    result = check(path, models, tmp_path / "out")
    assert (result.returncode, "confirmed" in result.stdout) == (1, False), result.stdout


def with_text(path, text, content, folder=None):
    """Put a text into a target's folder and the certificate."""
    text.write_bytes(content.encode())
    folder = folder or text.parent
    name, digest = text.relative_to(folder).as_posix(), hashlib.sha256(text.read_bytes()).hexdigest()
    changed(path, lambda content: content["texts"][folder.name].update({name: digest}))


#: A list of variables, as it is generated.
GVL = """<?xml version="1.0" encoding="utf-8"?>
<TcPlcObject Version="1.1.0.1">
  <GVL Name="{name}" Id="{{9cbc4ec7-7322-58dc-98be-fefd77642d8f}}">
    <Declaration><![CDATA[{text}]]></Declaration>
  </GVL>
</TcPlcObject>"""
PLAIN = "VAR_GLOBAL\n    nOne : DINT;\nEND_VAR\n"
LISTS = {
    "as it is": (0, GVL.format(name="GVL_Other", text=PLAIN)),
    "a type": (1, GVL.format(name="GVL_Other", text=OTHER["a type"])),
    "the name of the block": (1, GVL.format(name=BLOCK, text=PLAIN)),
    "the name of a function": (1, GVL.format(name="ABS", text=PLAIN)),
    "the end of a line as its number": (
        1,
        "<TcPlcObject><GVL><Declaration>// x&#13;TYPE LREAL : REAL; END_TYPE</Declaration></GVL></TcPlcObject>",
    ),
    "text behind an element": (
        1,
        "<TcPlcObject><GVL><Declaration>x<ST>y</ST>TYPE LREAL : REAL; END_TYPE</Declaration></GVL></TcPlcObject>",
    ),
}


@pytest.mark.parametrize("what", LISTS)
def test_lists_of_variables_are_read_as_they_are_generated(what, tmp_path):
    models, out = folder_of(tmp_path, [MODEL]), tmp_path / "out"
    generate(load(models), "twincat", out, options=Options(layout=Layout.TREES))
    path = written(tmp_path, models, out)
    with_text(path, out / "twincat" / "Other.TcGVL", LISTS[what][1])
    result = check(path, models, out)
    assert (result.returncode, "confirmed" in result.stdout) == (LISTS[what][0], not LISTS[what][0]), result.stdout


def test_texts_of_two_kinds_in_one_folder_are_not_confirmed(proved):
    """Who imports the ones does not see the others."""
    path, models, out = proved
    with_text(path, out / "iec" / "Other.TcGVL", GVL.format(name="GVL_Other", text=PLAIN))
    result = check(path, models, out)
    assert (result.returncode, "texts of two kinds" in result.stdout) == (1, True), result.stdout


def test_strings_pragmas_and_comments_as_they_are_generated_are_no_reason_to_reject(proved):
    path, models, out = proved
    text = "{attribute 'strict'}\n(* it's // {x} *)\nVAR_GLOBAL\n    s : STRING := 'row 1: a[0]'; (* *)\nEND_VAR\n"
    with_text(path, out / "iec" / "Other.st", text)
    assert check(path, models, out).returncode == 0


def test_a_feature_whose_name_opens_a_comment_of_another_kind_is_no_reason_to_reject(tmp_path):
    (tmp_path / "models").mkdir()
    text = (GOLDEN / "models" / MODEL).read_text()
    before, names, rest = text.partition("feature_names=")
    first = rest.split()[0]
    (tmp_path / "models" / MODEL).write_text(before + names + rest.replace(first, "a/*b", 1))
    generate(load(tmp_path / "models"), "iec", tmp_path / "out")
    result = check(written(tmp_path, tmp_path / "models", tmp_path / "out"), tmp_path / "models", tmp_path / "out")
    assert result.returncode == 0, result.stdout
    assert "/*" not in (tmp_path / "out" / "iec" / f"{BLOCK}.st").read_text()


@pytest.mark.parametrize("form", ["with_tests", "self_check"])
def test_all_that_may_be_generated_beside_a_block_is_read(form, tmp_path):
    """A block is confirmed, or not checked; what stands around it is no reason to reject."""
    models = folder_of(tmp_path, [MODEL])
    generate(load(models), "twincat", tmp_path / "out", **{form: True})
    result = check(written(tmp_path, models, tmp_path / "out"), models, tmp_path / "out")
    assert result.returncode == (3 if form == "self_check" else 0), result.stdout


@pytest.mark.parametrize("target", ["codesys", "plcopen", "scl"])
def test_files_that_are_not_read_are_named_and_nothing_is_confirmed(target, proved, tmp_path):
    """The file that CODESYS imports is the .xml: what the .st beside it says shows nothing."""
    _, models, out = proved
    out = tmp_path / target
    generate(load(models), target, out)
    result = check(written(tmp_path, models, out), models, out)
    assert result.returncode == 3 and "is not read by this checker" in result.stdout, result.stdout
    assert "rejected" not in result.stdout


def test_blocks_of_which_nothing_is_said_are_named(proved):
    path, models, out = proved
    (out / "twincat").mkdir()
    (out / "twincat" / "FB_Wrong.TcPOU").write_text("FUNCTION_BLOCK FB_Wrong\n")
    result = check(path, models, out)
    assert result.returncode == 0, result.stdout
    assert "twincat/FB_Wrong.TcPOU: nothing is said of fb_wrong" in result.stdout
    assert "iec/FB_SelfTest.st: nothing is said of fb_selftest" in result.stdout
    assert BLOCK.lower() not in result.stdout


def test_a_certificate_of_another_file_than_the_given_one(proved):
    path, models, out = proved
    assert check(path, models / MODEL, out).returncode == 0
    shutil.copy(GOLDEN / "models" / "lightgbm_missing.txt", models)
    assert "entries of another file" in check(path, models / "lightgbm_missing.txt", out).stdout
    assert "lightgbm_missing.txt: nothing is said of this file" in check(path, models, out).stdout


@pytest.mark.parametrize("name", [MODEL, "decision_tree.skops"])
def test_the_count_of_calls_beside_the_outputs_is_no_output_of_a_model(name, tmp_path):
    """That of a model without an answer to some rows reads itself, and was rejected."""
    models = folder_of(tmp_path, [name])
    generate(load(models), "iec", tmp_path / "out", with_age=True)
    path = written(tmp_path, models, tmp_path / "out")
    result = check(path, models, tmp_path / "out")
    assert result.returncode == 0, result.stdout
    (text,) = [file for file in (tmp_path / "out").rglob("*.st") if "nAge :=" in file.read_text()]
    with_text(path, text, text.read_text().replace("nAge := 0;", "nAge := 0; fOut1 := 0.0;"))
    assert check(path, models, tmp_path / "out").returncode == 1


def test_a_prefix_and_a_name_with_punctuation(tmp_path):
    (tmp_path / "models").mkdir()
    shutil.copy(GOLDEN / "models" / MODEL, tmp_path / "models" / "my-pump.v2.txt")
    (tmp_path / "models" / "st-codegen.toml").write_text('[project]\nprefix = "P1_"\n')
    generate(load(tmp_path / "models"), "iec", tmp_path / "out")
    result = check(written(tmp_path, tmp_path / "models", tmp_path / "out"), tmp_path / "models", tmp_path / "out")
    assert "P1_my-pump.v2, iec (my-pump.v2.txt): confirmed" in result.stdout


def test_a_test_for_nan_with_an_attribute_is_the_test_for_nan():
    """A project whose units have attributes was rejected; its text is read with the first sign of each."""
    folder = GOLDEN / "generated" / "twincat"
    texts = mutants.check_certificate.codes(folder, "FB_Decision_tree")
    assert mutants.check_certificate.has_isnan(folder, texts)
    assert mutants.check_certificate.has_isnan(folder, ["{ " + text for text in texts])
    with pytest.raises(mutants.check_certificate.Reject):
        mutants.check_certificate.has_isnan(folder, ["x " + text for text in texts])


@pytest.mark.parametrize("between", ["{a}", "(*a*)", "/*a*/", "//\n"])
def test_names_behind_many_pieces_are_looked_for_in_linear_time(between, tmp_path):
    """Each two more took four times as long: 24 took 4 s."""
    path = tmp_path / "x.st"
    path.write_text("FUNCTION_BLOCK " + between * 4000 + ";")
    assert mutants.check_certificate.blocks_in(path) == set()
