"""PLCopen XML: valid against the official schema, deterministic, and executed through its reader."""

from pathlib import Path

import pytest
from lxml import etree

from st_codegen.driver import generate
from st_codegen.emit.blocks.application import Application, Overlay
from st_codegen.emit.blocks.listing import Block, BlockVariable
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.st import Machine, parse_project
from tests.emit.targets.projects import written

PLCOPEN = TARGETS["plcopen"]
GOLDEN = Path(__file__).resolve().parents[3] / "golden"
SCHEMA = Path(__file__).resolve().parents[4] / "shared" / "schemas" / "tc6_xml_v201.xsd"


@pytest.fixture(scope="module")
def schema():
    if not SCHEMA.is_file():
        pytest.skip("the schema of PLCopen is not part of the project: put tc6_xml_v201.xsd into ../shared/schemas")
    return etree.XMLSchema(etree.parse(str(SCHEMA)))


def valid(schema, text):
    """Against the schema, whose namespace is not the one that tools write."""
    document = etree.fromstring(text.replace("/xml/tc6_0200", "/xml/tc6_0201").encode())
    schema.assertValid(document)
    return document


def test_an_application_with_everything_is_valid(schema):
    ((name, text),) = written(PLCOPEN).items()
    assert name == "everything.xml"

    valid(schema, text)


def test_what_is_read_back_runs():
    project = parse_project(written(PLCOPEN), "iec")
    counter = Machine(project, rows=1).instance("FB_Counter")
    counter()
    assert counter["fOut1"][0] == -2.0
    assert counter["SMALLEST"] == -2.5e-3
    assert counter["nIgnored"][0] == 3
    Machine(project, rows=1).program("PRG_Main")()


@pytest.mark.parametrize("name", ["bundle", "lone"])
def test_the_files_of_the_golden_projects_are_valid(schema, name, tmp_path):
    (path,) = generate(load(GOLDEN / name / "models"), "plcopen", tmp_path).folder.glob("*.xml")
    document = valid(schema, path.read_text(encoding="utf-8"))
    assert len(document.findall(".//{*}pou")) == len({pou.get("name") for pou in document.iter("{*}pou")}) > 5


def test_tasks_are_instances_of_the_programs(schema):
    document = valid(schema, written(PLCOPEN)["everything.xml"])
    tasks = {task.get("name"): (task.get("interval"), task.get("priority")) for task in document.iter("{*}task")}
    assert tasks == {"PlcTask": ("T#500us", "1"), "SlowTask": ("T#10000us", "20")}
    assert {instance.get("typeName") for instance in document.iter("{*}pouInstance")} == {"PRG_Main"}


def test_what_the_format_cannot_say_is_refused_in_one_message():
    overlay = Overlay("U_Bits", ("Bits.",), (BlockVariable("fX", "LREAL"),))
    blocks = (
        Block("FB_Child", ("x",), extends="FB_Base"),
        Block("FB_List", ("x",), variables=(BlockVariable("aX", "LREAL", length=2, initial="[1.0, 2.0]"),)),
        Block("FB_Pointer", ("x",), variables=(BlockVariable("pX", "POINTER TO LREAL"),)),
    )
    with pytest.raises(InputError) as caught:
        written(PLCOPEN, Application("bad", types=(overlay,), blocks=blocks))
    for part in ("4 problems", "U_Bits", "FB_Child extends FB_Base", "[1.0, 2.0] is a list", "POINTER TO LREAL"):
        assert part in str(caught.value)


def test_tables_globals_and_types_are_read_back_to_the_bit():
    text = written(PLCOPEN)["everything.xml"]
    machine = Machine(parse_project({"x.xml": text}, "iec"), rows=1)
    assert machine.globals["GVL_Plant.RATIO"] == 81.0
    assert [machine.globals[f"GVL_Plant.ORDER[{n}]"].item() for n in range(3)] == [0, 1, 39]
    weights = [machine.instance("FB_Counter")[f"WEIGHT[{n}]"].item() for n in range(5)]
    assert weights == [0.1, -2.0, 1e-300, 4.0, 5.0]
