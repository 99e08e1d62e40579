# ruff: noqa: E501 - a case a line
"""The reader of PLCopen XML: what other tools write, and whatever else a file may hold."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError
from st_codegen.st import Machine, StError, parse_project
from st_codegen.st.syntax.source import read_paths, read_texts
from tests.emit.targets.projects import written
from tests.examples import examples

WHOLE = written(TARGETS["plcopen"])["everything.xml"]
HEAD = '<project xmlns="http://www.plcopen.org/xml/tc6_0200"><types><dataTypes/><pous>'
TAIL = "</pous></types></project>"


def unit(local, body="fY := 1.0;", attributes='pouType="functionBlock"'):
    """A project with one block whose local variables are given as XML."""
    return (
        f'{HEAD}<pou name="FB_X" {attributes}><interface><outputVars><variable name="fY"><type><LREAL/></type></variable>'
        f"</outputVars><localVars>{local}</localVars></interface><body><ST>"
        f'<xhtml xmlns="http://www.w3.org/1999/xhtml">{body}</xhtml></ST></body></pou>{TAIL}'
    )


def variable(kind, initial=""):
    value = f"<initialValue>{initial}</initialValue>" if initial else ""
    return f'<variable name="aX"><type>{kind}</type>{value}</variable>'


def array(upper, *values, lower="0"):
    dimension = f'<dimension lower="{lower}" upper="{upper}"/>'
    kind = f"<array>{dimension}<baseType><LREAL/></baseType></array>"
    return variable(kind, f"<arrayValue>{''.join(values)}</arrayValue>" if values else "")


def value(text, repeat=None):
    count = "" if repeat is None else f' repetitionValue="{repeat}"'
    return f'<value{count}><simpleValue value="{text}"/></value>'


def output(text):
    instance = Machine(parse_project({"x.xml": text}, "iec"), rows=1).instance("FB_X")
    instance()
    return instance["fY"].item()


@pytest.mark.parametrize(
    ("text", "result"),
    [
        (unit("", "fY := 2.5;"), 2.5),
        (unit("", "IF 1 &lt; 2 THEN fY := 3.0; END_IF;"), 3.0),
        (unit("", "<p>fY := 4.0;</p>\n<p>fY := fY + 1.0;</p>"), 5.0),
        (unit(array(3, value("1.5"), value("2.0", 3)), "fY := aX[0] + aX[3];"), 3.5),
        (unit(array("2 - 1", value("1.5"), value("1.0 + 1.0"), lower="-1 + 1"), "fY := aX[1];"), 2.0),
        (unit(variable("<string length='9'/>", '<simpleValue value="&apos;a&apos;"/>')), 1.0),
        (unit("").replace("tc6_0200", "tc6_0201"), 1.0),
    ],
)
def test_what_other_tools_write_is_read(text, result):
    assert output(text) == result


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not well-formed XML"),
        ("<project/>", "not the 'project' of PLCopen XML"),
        (unit("").replace("tc6_0200", "tc6_0300"), "not the 'project' of PLCopen XML"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + unit("", "&a;"), "'<!DOCTYPE' is not allowed"),
        (unit("", "&a;"), "not well-formed XML"),
        (unit("", attributes='pouType="class"'), "'FB_X' is a 'class', not one of function"),
        (unit("", attributes=""), "<pou> has no attribute 'pouType'"),
        (unit("").replace("ST>", "LD>"), "implemented in LD; only ST is read"),
        (unit("").replace("<body>", "<actions><action name='a'/></actions><body>"), "has actions, which are not supported"),
        (unit("").replace("localVars>", "accessVars>"), "<accessVars> is not supported"),
        (unit("", "fY := ;"), "unexpected ';'"),
        (unit(array(1, value("1.0"))), "1"),
        (unit(array(1, value("1.0"), value("2.0"), value("3.0"))), "3"),
        (unit(array(1, value("1.0, 2.0"))), "'1.0, 2.0' is no value"),
        (unit(array(1, value("1.0; fY := 2.0"), value("1"))), "is no value"),
        (unit(array(1, value("NaN"), value("1.0"))), "NaN"),
        (unit(array(1, value("1e999"), value("1.0"))), "1e999"),
        (unit(array(1, value("1.0", "-1"), value("1.0"))), "repetitionValue '-1' is no count"),
        (unit(array(1, value("1.0", "9" * 30))), "is no count"),
        (unit(array(1, value("1.0", 999999999))), "this initialiser goes beyond them"),
        (
            unit(variable('<subrangeSigned><range lower="0" upper="5"/><baseType><DINT/></baseType></subrangeSigned>')),
            "subrange types are not supported",
        ),
        (unit(array("999999999999")), "999999999999"),
        (unit(array("9" * 5000)), "9999"),
        (unit(array("2147483647")), "2147483647"),
        (unit(variable("<array><baseType><LREAL/></baseType></array>")), "an array without a dimension"),
        (unit(variable("<LREAL/><DINT/>")), "a type is one element, here are 2"),
        (unit(variable("<struct/>")), "needs a name of its own"),
        (unit(variable("<LREAL/>", "<LREAL/>")), "<LREAL> is no value"),
        (unit(variable("<array>" * 300)), "not well-formed XML"),
        (unit("").replace("</body>", "</body><body><ST/></body>"), "needs exactly one <body>, it has 2"),
        (
            unit("").replace("</pou>", '<addData><data name="http://x/method" handleUnknown="discard"/></addData></pou>'),
            "additional data 'method' is not supported",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(text, message):
    with pytest.raises(StError, match=r"x\.xml:\d+:\d+") as caught:
        parse_project({"x.xml": text}, "iec")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_types_of_other_tools_are_read():
    values = '<value name="Idle" value="0"/><value name="Busy" value="2 + 3"/><value name="Bad"/>'
    number = variable("<LREAL/>", '<simpleValue value="1.5"/>')
    kinds = (
        f'<dataType name="E_Mode"><baseType><enum><values>{values}</values><baseType><DINT/></baseType></enum></baseType>'
        '<initialValue><simpleValue value="Busy"/></initialValue></dataType>'
        f'<dataType name="ST_All"><baseType><struct>{number}</struct>'
        "</baseType></dataType>"
    )
    state = (
        '<variable name="stAll"><type><derived name="ST_All"/></type><initialValue><structValue><value member="aX">'
        '<simpleValue value="2.5"/></value></structValue></initialValue></variable>'
        '<variable name="eMode"><type><derived name="E_Mode"/></type></variable>'
    )
    body = "IF eMode = E_Mode.Busy THEN fY := stAll.aX; END_IF;"
    text = unit(state, body).replace("<dataTypes/>", f"<dataTypes>{kinds}</dataTypes>")
    instance = Machine(parse_project({"x.xml": text}, "twincat"), rows=1).instance("FB_X")
    instance()
    assert instance["fY"].item() == 2.5
    assert instance["eMode"].item() == 5


def test_a_million_entities_are_refused_before_they_are_expanded():
    levels = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 10))
    bomb = f'<!DOCTYPE project [<!ENTITY e0 "x">{levels}]>{unit("", "&e9;")}'
    with pytest.raises(StError, match="is not allowed"):
        read_texts({"x.xml": bomb})
    hidden = f'<?xml version="1.0" encoding="UTF-7"?>{bomb}'.encode("utf-7").decode("ascii")
    with pytest.raises(StError):
        read_texts({"x.xml": hidden})
    with pytest.raises(StError):
        read_texts({"x.TcPOU": hidden})


def test_every_cut_of_a_file_is_an_error_with_its_place():
    for at in range(0, len(WHOLE) - len("</project>\n"), 211):
        with pytest.raises(StError, match=r"x\.xml:\d+"):
            parse_project({"x.xml": WHOLE[:at]}, "iec")


@examples()
@given(seed=st.integers(0, 2**32))
def test_a_damaged_file_is_read_or_refused(seed):
    chance = random.Random(seed)
    text = WHOLE
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(text))
        length = chance.choice([0, 1, 1, 20, 200])
        other = chance.randrange(len(text))
        text = text[:at] + chance.choice(["", "9", "<", "&", "]]>", text[other : other + length]]) + text[at + length :]
    try:
        parse_project({"x.xml": text}, "iec")
    except StError as error:
        assert str(error)


def test_other_xml_in_the_folder_is_left_alone(tmp_path):
    (tmp_path / "everything.xml").write_text(WHOLE, encoding="utf-8")
    (tmp_path / "other.xml").write_text("<MLlib_XML_File/>", encoding="utf-8")
    assert len(read_paths([tmp_path]).declarations) == 5
    (tmp_path / "everything.xml").unlink()
    with pytest.raises(InputError, match=r"no \.st, \.scl, \.TcPOU, \.TcGVL, \.TcDUT or PLCopen's \.xml file"):
        read_paths([tmp_path])
