"""SCL: what is written, what is read of it, and that it says what the portable text says."""

import re

import pytest

from st_codegen.driver import generate
from st_codegen.emit.blocks.application import Application
from st_codegen.emit.blocks.listing import Block, BlockVariable
from st_codegen.emit.render import _templates, templates_folder
from st_codegen.emit.scl_text import scl_code, scl_section
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError, TargetError
from st_codegen.project.bundle import load
from st_codegen.proof.prove.prove import prove
from st_codegen.proof.verify import verify
from st_codegen.st import Machine, parse_project
from st_codegen.st.errors import StSyntaxError
from st_codegen.st.syntax.source import read_texts
from tests.emit.targets.projects import APPLICATION, written

SCL = TARGETS["scl"]
WORDS = _templates(templates_folder(), "iec").get_template("scl/words.st.j2").module
#: Names of variables that stand without their mark: fields, names of arguments, and what is in comments.
BARE = re.compile(r"(?<![#\w.\"])([a-z][a-z]?[A-Z]\w*)\b(?!\s*(?::=|=>))")
BLOCK = Block(
    name="FB_A",
    header=("x",),
    inputs=(BlockVariable("fIn", "LREAL"),),
    variables=(BlockVariable("fbB", "FB_B"), BlockVariable("nX", "DINT")),
)


@pytest.fixture(scope="module")
def text():
    return written(SCL)["everything.scl"]


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("nX := TRUNC(fIn) + 1;", "#nX := TRUNC_DINT(#fIn) + 1;"),
        ("fbB(fIn := fIn * 2.0, nOut => nX);", "#fbB(fIn := #fIn * LREAL#2.0, nOut => #nX);"),
        ("nX := fbB.nX; (* fIn, 1.0 *)", "#nX := #fbB.nX; (* fIn, 1.0 *)"),
        ("nX := MIN(MAX(nX, -1), 16#F);", "#nX := MIN(IN1 := MAX(IN1 := #nX, IN2 := -1), IN2 := 16#F);"),
        ("IF F_X(fValue := fIn) THEN", 'IF "F_X"(fValue := #fIn) THEN'),
        ("fIn := 1.5E-3;", "#fIn := LREAL#1.5E-3;"),
    ],
)
def test_portable_code_gets_the_marks_of_scl(code, expected):
    assert scl_code(code, BLOCK, {"F_X", "FB_A", "FB_B"}, WORDS) == expected


def test_a_function_marks_its_result():
    function = Block(name="F_X", header=("x",), kind="FUNCTION", result="LREAL")
    assert (
        scl_code("F_X := F_Y(fValue := 1.0);", function, {"F_X", "F_Y"}, WORDS) == '#F_X := "F_Y"(fValue := LREAL#1.0);'
    )


def test_a_section_that_ends_within_a_statement_is_no_region():
    assert scl_section("IF nX > 0 THEN\n", BLOCK, (), "open", WORDS).startswith("(* open *)\nIF")
    assert scl_section("nX := 0;\n", BLOCK, (), "whole", WORDS) == "REGION whole\n#nX := 0;\nEND_REGION\n"


def test_what_scl_has_not_is_not_written(text):
    code = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
    assert not re.search(r"\b(?:PROGRAM|UNION|VAR_GLOBAL|CONFIGURATION|T_Values|E_Mode)\b", code)
    for section in re.findall(r"VAR CONSTANT\n(.*?)END_VAR", code, re.S):
        assert "ARRAY" not in section
    assert "{ S7_Optimized_Access := 'TRUE' }" in code
    assert 'DATA_BLOCK "DB_Counter"' in code
    assert "aValues : ARRAY[0..2] OF LREAL" in code
    assert 'stState : "ST_State"' in code


def test_the_text_is_read_and_runs(text):
    counter = Machine(parse_project({"a.scl": text}, "scl"), rows=1).instance("FB_Counter")
    counter()
    assert counter["fOut1"][0] == -2.0
    assert counter["SMALLEST"] == -2.5e-3


def test_every_variable_of_a_bundle_is_marked(bundle_folder, tmp_path):
    (path,) = generate(load(bundle_folder), "scl", tmp_path).folder.glob("*.scl")
    code = re.sub(r"(?s:\(\*.*?\*\))|REGION.*", "", path.read_text(encoding="utf-8"))
    bodies = re.findall(r"\nBEGIN\n(.*?)\nEND_FUNCTION", code, re.S)
    assert len(bodies) > 5
    assert not [name for body in bodies for name in BARE.findall(body)]
    assert "FB_" not in re.sub(r'"FB_\w+"', "", code)


def test_a_bundle_is_verified_and_proved(lone_folder, tmp_path):
    bundle = load(lone_folder)
    generate(bundle, "scl", tmp_path)
    assert verify(bundle, tmp_path, rows=200).passed
    report = prove(bundle, tmp_path)
    assert [result.verdict.value for result in report.results if result.model] == ["proved"] * len(bundle.models)


def test_what_is_changed_is_found(lone_folder, tmp_path):
    bundle = load(lone_folder)
    path = generate(bundle, "scl", tmp_path).folder / "FB_Te.scl"
    text = path.read_text(encoding="utf-8")
    table = re.search(r"OF LREAL := \[\s*(?:\(\*.*?\*\)\s*)?(-?\d+\.\d+)", text)
    path.write_text(text[: table.start(1)] + "12345.5" + text[table.end(1) :], encoding="utf-8")
    assert not verify(bundle, tmp_path, rows=200).passed


def test_a_table_that_is_written_to_is_no_table(text):
    broken = text.replace("REGION outputs & more\n", "REGION outputs & more\n#WEIGHT[0] := LREAL#1.0;\n")
    assert broken != text
    with pytest.raises(Exception, match="constant"):
        parse_project({"a.scl": broken}, "scl")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('DATA_BLOCK "D"\nVAR\n x : DINT;\nEND_VAR\nBEGIN\nEND_DATA_BLOCK', r"a.scl:1:1.*only instances"),
        ('FUNCTION_BLOCK "A B"\nBEGIN\nEND_FUNCTION_BLOCK', r'a.scl:1:16.*"A B" is not read'),
        ('FUNCTION_BLOCK "A"\nBEGIN\n#x := ;\nEND_FUNCTION_BLOCK', r"a.scl:3:7.*unexpected ';'"),
        (
            'FUNCTION_BLOCK "A"\nBEGIN\n#x := MIN(IN1 := 1, IN2 := );\nEND_FUNCTION_BLOCK',
            r"a.scl:3:28.*unexpected '\)'",
        ),
    ],
)
def test_what_is_not_read_is_named_at_its_place(text, message):
    with pytest.raises(StSyntaxError, match=message):
        read_texts({"a.scl": text})


def test_what_cannot_be_said_is_refused():
    late = Block(
        name="F_X", header=("x",), kind="FUNCTION", result="DINT", variables=(BlockVariable("n", "DINT", None, "1"),)
    )
    with pytest.raises(TargetError, match="no start values"):
        list(SCL.files(Application("x", blocks=(late,))))
    with pytest.raises(TargetError, match="no inheritance"):
        list(SCL.files(Application("x", blocks=(Block("FB_B", ("x",), extends="FB_A"),))))
    with pytest.raises(InputError, match="instance of FB_B would be called DB_B"):
        list(SCL.files(Application("x", blocks=(Block("FB_B", ("x",)), Block("DB_B", ("x",))))))
    assert APPLICATION.connected
