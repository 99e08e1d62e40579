"""TwinCAT 3 source files: TcPOU, TcDUT, TcGVL, TcTTO, and the plcproj that lists them."""

from __future__ import annotations

import dataclasses
import uuid
from collections.abc import Iterable
from pathlib import PurePosixPath

from st_codegen.emit.blocks.application import Application, DataType, GlobalList, Overlay, Task
from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FilePlan, Target, enter_target

#: Object identifiers are derived from names, so that they never change.
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_DNS, "st-codegen")

#: Who offers a library; all others come from the first.
_COMPANY = "Beckhoff Automation GmbH"
_COMPANIES = {"TcUnit": "www.tcunit.org"}


def object_id(name: str) -> str:
    """The identifier of an object in TwinCAT's files."""
    return f"{{{uuid.uuid5(_NAMESPACE, name)}}}"


class TwinCatTarget(Target):
    """One file an object, in the folders that TwinCAT projects use, and the project file."""

    name = "twincat"
    summary = "TwinCAT 3 PLC project (.plcproj, .TcPOU, .TcDUT, .TcGVL, .TcTTO)"
    dialect = "twincat"
    templates = "twincat"
    limits = Limits(max_array=65_536, data_bytes=32 * 1024 * 1024)
    has_tests = True
    has_comparison = True

    def files(self, application: Application) -> Iterable[FilePlan]:
        application = with_bit_test(application)
        files = [
            *(_pou("POUs", block, application.attributes) for block in application.blocks),
            *(_type(data_type) for data_type in application.types),
            *(_globals(variables) for variables in application.globals),
            *(_pou("Tests", block) for block in application.tests),
            *(_task(task) for task in application.tasks),
        ]
        return [*files, project_file(application, files)]


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
    return _object("", task.name, "task.TcTTO", task=task)


def _object(folder: str, name: str, template: str, **values: object) -> FilePlan:
    path = PurePosixPath(folder, name + PurePosixPath(template).suffix)
    return FilePlan(str(path), f"twincat/{template}.j2", {"id": object_id(name), **values}, twincat_xml=True)


def project_file(application: Application, files: list[FilePlan]) -> FilePlan:
    """The project that lists all other files and the libraries they need."""
    paths = [PurePosixPath(file.path) for file in files]
    names = dict.fromkeys(("Tc2_Standard", "Tc2_System", "Tc3_Module", *application.libraries))
    values = {
        "id": object_id(f"project {application.name}"),
        "name": application.name,
        "files": [
            {"path": "\\".join(path.parts), "link_always": path.suffix == ".TcGVL"} for path in sorted(paths, key=str)
        ],
        "folders": sorted({str(path.parent) for path in paths if path.parent.parts}),
        "libraries": [{"name": name, "company": _COMPANIES.get(name, _COMPANY)} for name in names],
    }
    return FilePlan(f"{application.name}.plcproj", "twincat/project.plcproj.j2", values)


enter_target(TwinCatTarget())
