"""TwinCAT 3 source files (TcPOU, TcDUT, TcGVL, TcTTO), the PLC project, and the solution that opens by a double click.

The structure of the project files is that of files which the development environment (XAE) saved itself, read from
public repositories: tcunit/TcUnit, Zeugwerk/Demo-Twincat-Application-CI, Zeugwerk/Plaincat,
pcdshub/lcls-twincat-motion; the form with several tasks from TcOpenGroup/TcOpen, the PLC project beside its system
project from eponce00/TcForge. Identifiers are made from names, so that they never change.
"""

from __future__ import annotations

import dataclasses
import uuid
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import Any

from st_codegen.emit.blocks.application import Application, DataType, GlobalList, Overlay, ProjectForm, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FileForm, FilePlan, Target, enter_target

#: Object identifiers are derived from names.
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "st-codegen")

#: Who offers a library; all others come from the first.
_COMPANY = "Beckhoff Automation GmbH"
_COMPANIES = {"TcUnit": "www.tcunit.org"}

#: Objects and PLC projects; solutions; system projects.
OBJECT = FileForm(has_mark=True, line_end="\r\n", ends_last_line=False)
_SOLUTION = FileForm(has_mark=True, line_end="\r\n")
_SYSTEM = FileForm(line_end="\r\n")

#: Kinds of files that XAE writes with the line ends of Windows.
_SUFFIXES = (".sln", ".tsproj", ".plcproj", ".TcPOU", ".TcDUT", ".TcGVL", ".TcTTO")

#: What a PLC project has an identifier for beside itself.
_PARTS = (
    "Application",
    "TypeSystem",
    "Implicit_Task_Info",
    "Implicit_KindOfTask",
    "Implicit_Jitter_Distribution",
    "LibraryReferences",
)
_PLATFORMS = ("TwinCAT CE7 (ARMV7)", "TwinCAT OS (ARMT2)", "TwinCAT RT (x64)", "TwinCAT RT (x86)")

#: Numbers of the first task, its ADS port and its object; the first object below the PLC's instance.
_FIRST_TASK, _FIRST_PORT, _TASK_OBJECT, _POU_OBJECT = 3, 350, 0x0201_0000, 0x0850_2001


class TwinCatTarget(Target):
    """One file an object, in the folders that TwinCAT projects use, and the files of project and solution."""

    name = "twincat"
    summary = "TwinCAT 3 solution (.sln, .tsproj, .plcproj, .TcPOU, .TcDUT, .TcGVL, .TcTTO)"
    dialect = "twincat"
    templates = "twincat"
    limits = Limits(data_bytes=32 * 1024 * 1024)
    has_tests = True
    has_comparison = True
    has_project_forms = True

    def files(self, application: Application) -> Iterable[FilePlan]:
        if application.packaging.form is ProjectForm.LIBRARY:
            application = as_library(application)
        application = with_bit_test(application)
        files = [
            *(_pou("POUs", block, application.attributes) for block in application.blocks),
            *(_type(data_type) for data_type in application.types),
            *(_globals(variables) for variables in application.globals),
            *(_pou("Tests", block) for block in application.tests),
            *(_task(task) for task in application.tasks),
        ]
        return [*files, *project_files(application, files)]


def as_library(application: Application) -> Application:
    """The application without its programs, and without what only programs use."""
    return dataclasses.replace(
        application,
        blocks=tuple(block for block in application.blocks if block.kind != "PROGRAM"),
        globals=tuple(variables for variables in application.globals if not variables.of_programs),
        tasks=(),
        tests=(),
    )


def with_bit_test(application: Application) -> Application:
    """The application with F_IsNan and its type, by which this dialect finds NaN."""
    value = BlockVariable("fValue", "LREAL")
    is_nan = Block(
        name="F_IsNan",
        header=(
            "TRUE for a value that is not a number. Looks at the bits, since comparing such a value stops the",
            "controller.",
        ),
        kind="FUNCTION",
        result="BOOL",
        inputs=(value,),
        variables=(BlockVariable("uBits", "U_LrealBits"),),
        constants=(
            BlockVariable("MAGNITUDE", "LWORD", initial="16#7FFFFFFFFFFFFFFF", comment="all bits but the sign"),
            BlockVariable("INFINITY_BITS", "LWORD", initial="16#7FF0000000000000", comment="bits of +infinity"),
        ),
        sections=(CodeSection("above infinity lie the numbers that are none", "is_nan", {}),),
    )
    bits = Overlay(
        "U_LrealBits", ("A number and its bits at the same place in memory.",), (value, BlockVariable("nBits", "LWORD"))
    )
    return dataclasses.replace(application, types=(bits, *application.types), blocks=(is_nan, *application.blocks))


def _pou(folder: str, block: Block, attributes: tuple[str, ...] = ()) -> FilePlan:
    return _object(folder, block.name, "pou.TcPOU", block=block, attributes=attributes)


def _type(data_type: DataType) -> FilePlan:
    return _object("DUTs", data_type.name, "type.TcDUT", type=data_type)


def _globals(variables: GlobalList) -> FilePlan:
    return _object("GVLs", variables.name, "globals.TcGVL", list=variables)


def _task(task: Task) -> FilePlan:
    parts = ("TaskFBGuid", "Fb_init", "Fb_exit", "CycleUpdate", "PostCycleUpdate")
    return _object(
        "", task.name, "task.TcTTO", task=task, parts=[(part, object_id(f"{part} of {task.name}")) for part in parts]
    )


def _object(folder: str, name: str, template: str, **values: object) -> FilePlan:
    path = PurePosixPath(folder, name + PurePosixPath(template).suffix)
    return FilePlan(str(path), f"twincat/{template}.j2", {"id": object_id(name), **values}, OBJECT)


def object_id(name: str) -> str:
    """The identifier of an object in TwinCAT's files."""
    return f"{{{uuid.uuid5(_NAMESPACE, name)}}}"


def project_files(application: Application, objects: Sequence[FilePlan]) -> list[FilePlan]:
    """The PLC project that lists all objects, the solution around it where one is wanted, and attributes for git."""
    files = [_plc_project(application, objects)]
    if application.packaging.form is not ProjectForm.PLC:
        files += _solution(application)
    return [*files, FilePlan(".gitattributes", "twincat/gitattributes.j2", {"suffixes": _SUFFIXES})]


def _plc_id(application: Application) -> str:
    return object_id(f"project {application.name}")


def _plc_project(application: Application, objects: Sequence[FilePlan]) -> FilePlan:
    paths = [PurePosixPath(file.path) for file in objects]
    names = dict.fromkeys(("Tc2_Standard", "Tc2_System", "Tc3_Module", *application.libraries))
    packaging = application.packaging
    values: dict[str, Any] = {
        "id": _plc_id(application),
        "name": application.name,
        "parts": [(part, object_id(f"{part} of {application.name}")) for part in _PARTS],
        "packaging": packaging,
        "is_library": packaging.form is ProjectForm.LIBRARY,
        "files": [
            {"path": "\\".join(path.parts), "link_always": path.suffix == ".TcGVL"} for path in sorted(paths, key=str)
        ],
        "folders": sorted({str(path.parent) for path in paths if path.parent.parts}),
        "libraries": [{"name": name, "company": _COMPANIES.get(name, _COMPANY)} for name in names],
    }
    return FilePlan(f"{application.name}.plcproj", "twincat/project.plcproj.j2", values, OBJECT)


def _solution(application: Application) -> list[FilePlan]:
    """The solution and its system project, which stand beside the PLC project."""
    name = application.name
    system, plc = object_id(f"system of {name}").upper(), _plc_id(application).upper()
    ids = {"name": name, "system": system, "plc": plc}
    configurations = [f"{build}|{platform}" for build in ("Debug", "Release") for platform in _PLATFORMS]
    solution = {"id": object_id(f"solution {name}").upper(), "configurations": configurations, **ids}
    tasks = [_numbered(number, task) for number, task in enumerate(application.tasks)]
    return [
        FilePlan(f"{name}.sln", "twincat/solution.sln.j2", solution, _SOLUTION),
        FilePlan(f"{name}.tsproj", "twincat/system.tsproj.j2", {"tasks": tasks, **ids}, _SYSTEM),
    ]


def _numbered(number: int, task: Task) -> dict[str, object]:
    """A task of the PLC as the system project has it; its cycle time stands there in two units."""
    own = _FIRST_TASK + number
    return {
        "id": own,
        "context": number,
        "port": _FIRST_PORT + number,
        "name": task.name,
        "priority": task.priority,
        "cycle_100ns": task.cycle_us * 10,
        "cycle_ns": task.cycle_us * 1000,
        "task_object": f"#x{_TASK_OBJECT + 16 * own:08x}",
        "pou_object": f"#x{_POU_OBJECT + number:08x}",
    }


enter_target(TwinCatTarget())
