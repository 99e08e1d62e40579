"""TwinCAT's project files: the PLC project, and the solution that opens with a double click.

Their structure is that of files which the development environment (XAE) saved itself, read from public repositories:
tcunit/TcUnit, Zeugwerk/Demo-Twincat-Application-CI, Zeugwerk/Plaincat, pcdshub/lcls-twincat-motion; the form with
several tasks from TcOpenGroup/TcOpen, the PLC project beside its system project from eponce00/TcForge.
Identifiers are made from names, so that they never change.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any

from st_codegen.emit.blocks.application import Application, ProjectForm, Task
from st_codegen.emit.file_plan import FileForm, FilePlan

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
