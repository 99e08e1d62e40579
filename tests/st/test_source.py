from __future__ import annotations

from pathlib import Path

import pytest

from st_codegen.errors import InputError
from st_codegen.st import Machine, StCheckError, StSyntaxError, load_project, parse_project
from st_codegen.st.syntax import source as module
from st_codegen.st.syntax.source import read_paths, read_texts

GUID = "{00000000-0000-0000-0000-000000000001}"
POU = f"""\ufeff<?xml version="1.0" encoding="utf-8"?>
<TcPlcObject Version="1.1.0.1">
  <POU Name="FB_X" Id="{GUID}" SpecialFunc="None">
    <Declaration><![CDATA[{{attribute 'hide'}}
FUNCTION_BLOCK FB_X
VAR_INPUT
    fIn : LREAL;
END_VAR
VAR_OUTPUT
    fOut : LREAL;
END_VAR
]]></Declaration>
    <Implementation>
      <ST><![CDATA[fOut := Scaled(fIn) + GVL_X.OFFSET;
]]></ST>
    </Implementation>
    <Method Name="Scaled" Id="{GUID}">
      <Declaration><![CDATA[METHOD Scaled : LREAL
VAR_INPUT
    f : LREAL;
END_VAR
]]></Declaration>
      <Implementation>
        <ST><![CDATA[Scaled := f * 2.0;]]></ST>
      </Implementation>
    </Method>
  </POU>
</TcPlcObject>"""
GVL = f"""<?xml version="1.0" encoding="utf-8"?>
<TcPlcObject Version="1.1.0.1">
  <GVL Name="GVL_X" Id="{GUID}">
    <Declaration><![CDATA[{{attribute 'qualified_only'}}
VAR_GLOBAL CONSTANT
    OFFSET : LREAL := 0.5;
END_VAR
]]></Declaration>
  </GVL>
</TcPlcObject>"""
DUT = f"""<?xml version="1.0" encoding="utf-8"?>
<TcPlcObject Version="1.1.0.1">
  <DUT Name="ST_X" Id="{GUID}">
    <Declaration><![CDATA[TYPE ST_X :
STRUCT
    a : LREAL;
END_STRUCT
END_TYPE
]]></Declaration>
  </DUT>
</TcPlcObject>"""


def folder(tmp_path: Path) -> Path:
    (tmp_path / "POUs").mkdir()
    (tmp_path / "POUs" / "FB_X.TcPOU").write_text(POU, encoding="utf-8")
    (tmp_path / "GVL_X.TcGVL").write_text(GVL, encoding="utf-8")
    (tmp_path / "ST_X.TcDUT").write_text(DUT, encoding="utf-8")
    (tmp_path / "Main.TcTTO").write_text("<TcPlcObject><Task/></TcPlcObject>", encoding="utf-8")
    (tmp_path / "X.plcproj").write_text("<Project/>", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("not Structured Text", encoding="utf-8")
    return tmp_path


def test_a_twincat_folder_is_loaded_and_runs(tmp_path: Path) -> None:
    block = Machine(load_project([folder(tmp_path)])).instance("FB_X")
    block(fIn=3.0)
    assert block["fOut"] == 6.5


def test_a_folder_and_single_files_give_the_same(tmp_path: Path) -> None:
    root = folder(tmp_path)
    names = ["GVL_X.TcGVL", "POUs/FB_X.TcPOU", "ST_X.TcDUT"]
    assert read_paths([root]).declarations == read_paths([root / name for name in names]).declarations


def test_attributes_of_lists_are_kept(tmp_path: Path) -> None:
    block = next(item for item in read_paths([folder(tmp_path)]).declarations if item.name == "FB_X")
    assert block.attributes == ("hide",)
    with pytest.raises(StCheckError, match="unknown name 'OFFSET'"):
        parse_project({"GVL_X.TcGVL": GVL, "FB_X.TcPOU": POU.replace("GVL_X.OFFSET", "OFFSET")})


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("fOut := Scaled(fIn)", "fOut := := ", "FB_X.TcPOU:14:28 (FB_X): unexpected ':='"),
        ("Scaled := f * 2.0;", "Scaled := f * 2.0", "FB_X.TcPOU:24:39 (FB_X.Scaled): the text ends too early"),
        ("    fIn : LREAL;", "    fIn ; LREAL;", "FB_X.TcPOU:7:9 (FB_X): unexpected ';'"),
    ],
)
def test_positions_are_those_of_the_xml_file(old: str, new: str, where: str) -> None:
    with pytest.raises(StSyntaxError) as caught:
        read_texts({"FB_X.TcPOU": POU.replace(old, new)})
    assert str(caught.value).startswith(where)


def test_errors_of_all_files_are_reported_at_once() -> None:
    with pytest.raises(StSyntaxError) as caught:
        read_texts({"a.st": "x", "FB_X.TcPOU": "<a/>", "b.st": "PROGRAM"})
    assert [problem.position.file for problem in caught.value.problems] == ["FB_X.TcPOU", "a.st", "b.st"]


BOMB = '<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (POU.replace("<TcPlcObject", BOMB + "<TcPlcObject", 1), "'<!DOCTYPE' is not allowed"),
        ("<!-- <TcPlcObject> -->" + BOMB + "<TcPlcObject>&c;</TcPlcObject>", "'<!DOCTYPE' is not allowed"),
        ('<TcPlcObject><!ENTITY x "y"></TcPlcObject>', "'<!ENTITY' is not allowed"),
        ("<TcPlcObject>&unknown;</TcPlcObject>", "not well-formed XML"),
        (POU[:600], "not well-formed XML"),
        ("", "not well-formed XML"),
        ("<Project/>", "the root element is 'Project', not 'TcPlcObject'"),
        ("<TcPlcObject/>", "the file holds no POU, GVL or DUT"),
        ("<TcPlcObject><Banana/></TcPlcObject>", "unknown element 'Banana'"),
        ('<TcPlcObject><Itf Name="I"/></TcPlcObject>', "interfaces are not supported"),
        (
            POU.replace("<Method ", "<Property ").replace("</Method>", "</Property>"),
            "FB_X.Scaled: properties are not supported",
        ),
        (POU.replace("<Method ", "<Action ").replace("</Method>", "</Action>"), "actions are not supported"),
        (POU.replace("<ST>", "<FBD>").replace("</ST>", "</FBD>"), "'FB_X' is implemented in FBD; only ST is supported"),
        (POU.replace('POU Name="FB_X"', 'POU Name="FB_Y"'), "the file says 'FB_Y', its declaration says 'FB_X'"),
        (GVL.replace("<Declaration>", "<Declaration/><Declaration>"), "'GVL_X' needs exactly one <Declaration>"),
    ],
)
def test_what_is_no_twincat_file_is_refused(text: str, message: str) -> None:
    with pytest.raises(StSyntaxError) as caught:
        read_texts({"X.TcPOU": text})
    assert message in str(caught.value)


def test_cdata_may_hold_what_elsewhere_would_be_markup() -> None:
    text = POU.replace("fOut := Scaled(fIn)", "(* <!DOCTYPE <a> & *) fOut := Scaled(fIn)")
    assert read_texts({"FB_X.TcPOU": text}).declarations == read_texts({"FB_X.TcPOU": POU}).declarations


def test_escaped_text_is_as_good_as_cdata() -> None:
    text = GVL.replace("<![CDATA[", "").replace("]]>", "").replace("0.5", "0.5 (* &lt; *)")
    assert read_texts({"GVL_X.TcGVL": text}).declarations == read_texts({"GVL_X.TcGVL": GVL}).declarations


@pytest.mark.parametrize("name", ["a.st", "a.TcPOU"])
def test_text_that_is_not_utf_8_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"PROGRAM P \xff END_PROGRAM")
    with pytest.raises(StSyntaxError, match="not UTF-8 text"):
        read_paths([tmp_path / name])


def test_byte_order_mark_and_windows_lines_are_fine(tmp_path: Path) -> None:
    (tmp_path / "a.st").write_bytes(b"\xef\xbb\xbfPROGRAM P\r\nVAR a : DINT; END_VAR\r\na := 1;\r\nEND_PROGRAM\r\n")
    (program,) = read_paths([tmp_path]).declarations
    assert program.body[0].position.line == 3
    crlf = read_texts({"FB_X.TcPOU": POU.replace("\n", "\r\n")}).declarations
    assert crlf == read_texts({"FB_X.TcPOU": POU}).declarations
    assert str(crlf[0].methods[0].body[0].position) == "FB_X.TcPOU:24:22 (FB_X.Scaled)"


@pytest.mark.parametrize(
    ("name", "message"),
    [("missing.st", "no such file or folder"), ("notes.txt", "not Structured Text"), ("empty", "no .st, .scl, .TcPOU")],
)
def test_paths_that_cannot_be_read(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "notes.txt").write_text("x", encoding="utf-8")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=message):
        read_paths([tmp_path / name])


def test_size_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_BYTES", 10)
    (tmp_path / "a.st").write_text("PROGRAM P END_PROGRAM", encoding="utf-8")
    with pytest.raises(InputError, match="21 bytes are more than the limit of 10"):
        read_paths([tmp_path])
