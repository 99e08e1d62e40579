"""TwinCAT's files of a whole application: the project lists all of them, tasks call programs, all of it runs."""

import dataclasses

import pytest
from lxml import etree

from st_codegen.emit.blocks.application import Application, Task
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError
from st_codegen.st import Machine, parse_project
from tests.emit.targets.projects import APPLICATION, MAIN, written

TWINCAT = TARGETS["twincat"]
MSBUILD = "{http://schemas.microsoft.com/developer/msbuild/2003}"


@pytest.fixture(scope="module")
def files():
    return written(TWINCAT)


def xml(text):
    return etree.fromstring(text.lstrip("\ufeff").encode())


#: What surrounds the objects of a project.
AROUND = {"everything.plcproj", "everything.sln", "everything.tsproj", ".gitattributes"}


def test_the_project_lists_every_file_and_every_folder(files):
    project = xml(files["everything.plcproj"])
    listed = {item.get("Include").replace("\\", "/") for item in project.iter(f"{MSBUILD}Compile")}
    assert listed == set(files) - AROUND
    folders = {item.get("Include") for item in project.iter(f"{MSBUILD}Folder")}
    assert folders == {"POUs", "DUTs", "GVLs"}
    linked = [item.get("Include") for item in project.iter(f"{MSBUILD}Compile") if len(item) == 2]
    assert linked == ["GVLs\\GVL_Plant.TcGVL", "GVLs\\GVL_State.TcGVL"]


def test_every_object_has_an_identifier_of_its_own(files):
    ids = [child.get("Id") for name, text in files.items() if "Tc" in name for child in xml(text)]
    assert len(ids) == len(set(ids)) == len(set(files) - AROUND)
    assert all(
        text.startswith("\ufeff<?xml") and not text.endswith("\n") for name, text in files.items() if "Tc" in name
    )


def test_tasks_have_their_time_priority_and_program(files):
    task = xml(files["PlcTask.TcTTO"])[0]
    assert (task.findtext("CycleTime"), task.findtext("Priority"), task.findtext("PouCall/Name")) == (
        "500",
        "1",
        "PRG_Main",
    )
    assert xml(files["SlowTask.TcTTO"])[0].findtext("CycleTime") == "10000"


def test_the_files_are_valid_text_and_run(files):
    project = parse_project({name: text for name, text in files.items() if name.endswith(("POU", "GVL", "DUT"))})
    counter = Machine(project, rows=1).instance("FB_Counter")
    counter()
    assert counter["fOut1"][0] == -2.0
    assert counter["SMALLEST"] == -2.5e-3
    assert counter["bValid"][0]


def test_the_lines_are_short(files):
    for name, text in files.items():
        if name.endswith((".sln", ".tsproj")):
            continue  # an element of these is a line, whatever its length
        assert all(len(line) <= 100 or line.startswith("    <Implicit") for line in text.splitlines()), name


@pytest.mark.parametrize("bad", [{"cycle_us": 0}, {"priority": 32}, {"programs": ()}])
def test_a_task_that_cannot_be_is_refused(bad):
    with pytest.raises(InputError, match="task Fast: cycle time"):
        Task(**({"name": "Fast", "cycle_us": 250, "priority": 1, "programs": ("PRG_Main",)} | bad))


def test_tasks_call_programs_of_the_project():
    with pytest.raises(InputError, match="task PlcTask: no program FB_Counter in the project"):
        dataclasses.replace(APPLICATION, tasks=(Task("PlcTask", 250, 1, ("FB_Counter",)),))


def test_names_are_taken_once_whatever_their_case():
    with pytest.raises(InputError, match="two objects of the project would be called prg_main"):
        Application("twice", blocks=(MAIN, Block("prg_main", ("x",))))
