"""TwinCAT's solution: its structure against that of real ones, and its files against each other."""

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest
from lxml import etree

from st_codegen.driver import generate
from st_codegen.emit.blocks.application import Packaging, ProjectForm
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError, TargetError
from st_codegen.project.bundle import load
from tests.cli.helpers import run
from tests.emit.targets.projects import APPLICATION, written

TWINCAT = TARGETS["twincat"]
MSBUILD = "{http://schemas.microsoft.com/developer/msbuild/2003}"
SYSTEM_PROJECT = "{B1E792BE-AA5F-4E3C-8C82-674BF9C0715B}"
SKELETONS = tomllib.loads(Path(__file__).with_name("xae_skeletons.toml").read_text(encoding="utf-8"))
NOT_OURS = SKELETONS.pop("not_ours")
KINDS = ("tsproj", "plcproj", "TcTTO", "TcPOU")
OPTIONS = "Project/ProjectExtensions/PlcProjectOptions/XmlArchive/Data"
LIBRARY = Packaging(ProjectForm.LIBRARY, "1.2.3.0", "Plant & Co.", "Plant")
FORMS = {
    "solution": APPLICATION,
    "one_task": dataclasses.replace(APPLICATION, tasks=APPLICATION.tasks[:1]),
    "no_task": dataclasses.replace(APPLICATION, tasks=()),
    "plc": dataclasses.replace(APPLICATION, packaging=Packaging(ProjectForm.PLC)),
    "library": dataclasses.replace(APPLICATION, packaging=LIBRARY),
}


@pytest.fixture(scope="module", params=FORMS)
def files(request):
    return written(TWINCAT, FORMS[request.param])


def xml(text):
    return etree.fromstring(text.lstrip("\ufeff").encode())


def skeleton(text):
    """The paths of all elements and attributes, without namespaces."""
    found = set()

    def visit(element, above):
        path = f"{above}/{etree.QName(element).localname}" if above else etree.QName(element).localname
        path = re.sub(r"^TcSmProject/Project/Plc/Project", "PLC", path)
        path = re.sub(
            r"^(?:Project/ProjectExtensions/PlcProjectOptions/XmlArchive/Data|OPTIONS(?:/\w)+)/o$", "OPTIONS", path
        )
        found.add(path)
        found.update(f"{path}@{etree.QName(name).localname}" for name in element.attrib)
        for child in element.iterchildren(etree.Element):
            visit(child, path)

    visit(xml(text), "")
    return found


def of_kind(kind):
    """The skeleton of all of our files of a kind, in all forms of a project."""
    return {
        path
        for application in FORMS.values()
        for name, text in written(TWINCAT, application).items()
        if name.endswith(f".{kind}")
        for path in skeleton(text)
    }


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_written_that_no_reference_has(kind):
    known = {path for reference in SKELETONS.values() for path in reference.get(kind, "").split()}
    assert of_kind(kind) - known == set()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reference", SKELETONS)
def test_what_a_reference_has_is_written_or_left_out_for_a_reason(reference, kind):
    missing = set(SKELETONS[reference].get(kind, "").split()) - of_kind(kind)
    assert {path for path in missing if not any(path.startswith(known) for known in NOT_OURS)} == set()


def test_every_reason_is_needed():
    known = {path for reference in SKELETONS.values() for kind in KINDS for path in reference.get(kind, "").split()}
    ours = {path for kind in KINDS for path in of_kind(kind)}
    assert set(NOT_OURS) <= known - ours


def test_the_sections_of_the_solution_are_those_of_the_references():
    sections = re.findall(r"\tGlobalSection\((\w+)\)", written(TWINCAT)["everything.sln"])
    assert all(set(reference["sections"]) <= set(sections) for reference in SKELETONS.values())
    assert sections == SKELETONS["zeugwerk_demo"]["sections"]


def test_the_solution_knows_both_projects_by_their_identifiers(files):
    names = {name.rpartition(".")[2]: text for name, text in files.items()}
    plc = xml(names["plcproj"]).findtext(f"{MSBUILD}PropertyGroup/{MSBUILD}ProjectGuid")
    if "sln" not in names:
        assert "tsproj" not in names
        return
    kind, name, path, system = re.search(
        r'^Project\("(.*?)"\) = "(.*?)", "(.*?)", "(.*?)"', names["sln"], re.M
    ).groups()
    assert (kind, name) == (SYSTEM_PROJECT, "everything")
    assert path in files
    project = xml(names["tsproj"]).find("Project")
    inner = project.find("Plc/Project")
    assert project.get("ProjectGUID") == system == system.upper()
    assert inner.get("GUID") == plc.upper()
    assert inner.get("PrjFilePath") in files
    assert inner.get("TmcFilePath") == inner.get("PrjFilePath").replace(".plcproj", ".tmc")
    offered = re.findall(r"^\t\t((?:Debug|Release).*?) = ", names["sln"], re.M)
    chosen = re.findall(r"^\t\t({.*?})\.(.*?)\.(ActiveCfg|Build\.0) = (.*?)\r$", names["sln"], re.M)
    assert chosen == [
        (guid, configuration, what, configuration)
        for guid in (system, plc.upper())
        for configuration in offered
        for what in ("ActiveCfg", "Build.0")
    ]


def test_tasks_are_the_same_in_three_files_and_three_units(files):
    (system,) = [xml(text) for name, text in files.items() if name.endswith(".tsproj")] or [None]
    tasks = {name: xml(text)[0] for name, text in files.items() if name.endswith(".TcTTO")}
    if system is None:
        return
    listed = system.findall("Project/System/Tasks/Task")
    contexts = system.findall("Project/Plc/Project/Instance/Contexts/Context")
    called = system.findall("Project/Plc/Project/Instance/TaskPouOids/TaskPouOid")
    if not tasks:
        assert (listed, called) == ([], [])
        assert [(c.findtext("Id"), c.findtext("Name")) for c in contexts] == [("1", "Default")]
        return
    assert [f"{task.findtext('Name')}.TcTTO" for task in listed] == list(tasks)
    for number, (task, context, pou) in enumerate(zip(listed, contexts, called, strict=True)):
        own = tasks[f"{task.findtext('Name')}.TcTTO"]
        microseconds = int(own.findtext("CycleTime"))
        assert int(task.get("CycleTime")) == microseconds * 10
        assert int(context.findtext("CycleTime")) == microseconds * 1000
        priorities = {own.findtext("Priority"), task.get("Priority"), context.findtext("Priority"), pou.get("Prio")}
        assert len(priorities) == 1
        assert context.findtext("Name") == task.findtext("Name") == own.get("Name")
        assert (task.get("Id"), task.get("AmsPort")) == (str(3 + number), str(350 + number))
        assert context.findtext("Id") == str(number)
        assert context.findtext("ManualConfig/OTCID") == f"#x{0x02010000 + 16 * (3 + number):08x}"
        assert pou.get("OTCID") == f"#x{0x08502001 + number:08x}"


def test_the_project_lists_what_is_there(files):
    (project,) = [xml(text) for name, text in files.items() if name.endswith(".plcproj")]
    listed = [item.get("Include").replace("\\", "/") for item in project.iter(f"{MSBUILD}Compile")]
    assert sorted(listed) == sorted(name for name in files if re.search(r"\.Tc\w+$", name))
    folders = [item.get("Include") for item in project.iter(f"{MSBUILD}Folder")]
    assert set(folders) == {name.partition("/")[0] for name in listed if "/" in name}


def test_identifiers_are_distinct_and_stay(files):
    own = [re.findall(r"[>\"]({[0-9a-f-]{36}})[<\"]", text) for name, text in files.items() if "Tc" in name]
    (project,) = [text for name, text in files.items() if name.endswith(".plcproj")]
    parts = re.findall(r"<(\w+)>({[0-9a-f-]{36}})<", project)
    identifiers = [guid for found in own for guid in found] + [guid for _, guid in parts]
    assert len(set(identifiers)) == len(identifiers)
    assert len(parts) == 7
    assert dict(parts)["ProjectGuid"] == PROJECT


#: The identifier of the project `everything`: it may never change, or solutions lose the project.
PROJECT = "{edaa9d02-6f96-5be9-8b48-3774b1439e5a}"


def test_files_have_the_form_in_which_they_are_saved(files):
    for name, text in files.items():
        content = text.encode()
        if name == ".gitattributes":
            assert b"\r" not in content
            continue
        assert content.count(b"\n") == content.count(b"\r\n") > 0, name
        assert content.startswith(b"\xef\xbb\xbf") != name.endswith(".tsproj"), name
        assert content.endswith(b"\r\n") == name.endswith((".sln", ".tsproj")), name
    suffixes = {Path(name).suffix for name in files} - {""}
    attributes = dict(line.split(" ", 1) for line in files[".gitattributes"].splitlines()[1:])
    assert suffixes <= {pattern.removeprefix("*") for pattern in attributes}
    assert set(attributes.values()) == {"text eol=crlf"}
    if "everything.sln" in files:
        assert files["everything.sln"].startswith(
            "\ufeff\r\nMicrosoft Visual Studio Solution File, Format Version 12.00"
        )


def test_a_library_has_blocks_alone_and_a_name_for_others():
    files = written(TWINCAT, FORMS["library"])
    project = xml(files["everything.plcproj"]).find(f"{MSBUILD}PropertyGroup")
    assert "POUs/PRG_Main.TcPOU" not in files
    assert "POUs/FB_Counter.TcPOU" in files
    assert not [name for name in files if name.endswith(".TcTTO")]
    found = {name: project.findtext(f"{MSBUILD}{name}") for name in ("Company", "Released", "Title", "ProjectVersion")}
    assert found == {"Company": "Plant & Co.", "Released": "true", "Title": "everything", "ProjectVersion": "1.2.3.0"}
    assert project.findtext(f"{MSBUILD}DefaultNamespace") == "Plant"
    assert "Released" not in written(TWINCAT)["everything.plcproj"]


def test_the_library_of_a_bundle_has_no_signals(bundle_folder, tmp_path):
    folder = generate(
        load(bundle_folder), "twincat", tmp_path, packaging=Packaging(ProjectForm.LIBRARY, company="Plant")
    ).folder
    assert {path.name for path in (folder / "GVLs").iterdir()} == {"GVL_TE.TcGVL"}
    assert not [path for path in (folder / "POUs").iterdir() if path.name.startswith("PRG_")]


def test_forms_from_the_command_line(lone_folder, tmp_path):
    names = {}
    for form in ("solution", "plc", "library"):
        assert run(lone_folder, "--project", form, "--out", tmp_path / form, "-q") == 0
        names[form] = {path.name for path in (tmp_path / form / "twincat").iterdir()}
    assert names["solution"] - names["plc"] == {"Models.sln", "Models.tsproj"}
    assert names["library"] == names["solution"]
    (lone_folder / "st-codegen.toml").write_text(
        '[build]\nproject = "library"\nlibrary_version = "2.0"\ncompany = "Plant"\ntarget = ["twincat", "iec"]\n'
    )
    assert run(lone_folder, "--out", tmp_path / "both", "-q") == 0
    text = (tmp_path / "both" / "twincat" / "Models.plcproj").read_text(encoding="utf-8")
    assert "<ProjectVersion>2.0</ProjectVersion>" in text
    assert "<Company>Plant</Company>" in text
    assert "<DefaultNamespace>Models</DefaultNamespace>" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--company", "Plant"], "--company: libraries have these; give --project library"),
        (["--project", "library", "--library-version", "one"], "version 'one': two to four numbers"),
        (["--project", "library", "--namespace", "1x"], "namespace '1x': letters, digits"),
        (["--project", "library", "--namespace", "If"], "namespace 'If': a reserved word"),
        (["--project", "library", "--with-tests"], "leave out --with-tests or --project library"),
        (["--project", "library", "--with-comparison"], "leave out --with-comparison or"),
        (["--project", "plc", "--target", "iec"], "the target iec has no forms of a project; --project goes with"),
    ],
)
def test_what_a_form_cannot_have_is_refused(lone_folder, tmp_path, capsys, options, message):
    assert run(lone_folder, "--out", tmp_path / "out", "-q", *options) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_company_is_one_line():
    with pytest.raises(InputError, match="cannot be printed"):
        Packaging(company="a\nb")
    with pytest.raises(TargetError, match="has no forms"):
        generate("nowhere", "plcopen", "nowhere", packaging=Packaging(ProjectForm.PLC))
