"""TwinCAT 3 source files: TcPOU, TcDUT, TcGVL, TcTTO, and the project files around them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import PurePosixPath

from st_codegen.emit.blocks.application import Application, DataType, GlobalList, Overlay, ProjectForm, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.file_plan import FilePlan
from st_codegen.emit.targets.base import Target, enter_target
from st_codegen.emit.twincat_project import OBJECT, object_id, project_files


class TwinCatTarget(Target):
    """One file an object, in the folders that TwinCAT projects use, and the files of project and solution."""

    name = "twincat"
    summary = "TwinCAT 3 solution (.sln, .tsproj, .plcproj, .TcPOU, .TcDUT, .TcGVL, .TcTTO)"
    dialect = "twincat"
    templates = "twincat"
    limits = Limits(max_array=65_536, data_bytes=32 * 1024 * 1024)
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


enter_target(TwinCatTarget())
