"""CODESYS: PLCopen XML as its importer reads it, and the same blocks as text."""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.emit.blocks.application import Application
from st_codegen.emit.targets.base import FilePlan, enter_target
from st_codegen.emit.targets.iec import text_file
from st_codegen.emit.targets.plcopen import PlcOpenTarget


class CodesysTarget(PlcOpenTarget):
    """One XML file for *Import PLCopenXML*, and beside it one `.st` file to be read, compared and copied from.

    `verify` reads both and refuses them where they do not say the same.
    """

    name = "codesys"
    summary = "CODESYS: PLCopen XML for its importer (.xml), and the same as text (.st)"
    dialect = "codesys"
    template = "codesys/project.xml.j2"

    def files(self, application: Application) -> Iterable[FilePlan]:
        return [*super().files(application), text_file(application)]


enter_target(CodesysTarget())
