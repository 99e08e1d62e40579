"""Portable Structured Text: the subset that strict compilers outside TwinCAT accept."""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.emit.blocks.application import Application, DataType
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FilePlan, Target, enter_target


class IecTarget(Target):
    """One `.st` file a model; a bundle is one file, in the order in which strict compilers want declarations.

    Global variables and tasks belong into a CONFIGURATION, which every tool writes in its own way: they are left out.
    """

    name = "iec"
    summary = "portable Structured Text (.st)"
    dialect = "iec"
    is_portable = True
    templates = "iec"
    limits = Limits(max_array=65_536, real_range=(1e-37, 1e37), data_bytes=16 * 1024 * 1024)

    def files(self, application: Application) -> Iterable[FilePlan]:
        if application.connected:
            types = tuple(item for item in application.types if item.portable)
            blocks = tuple(block for block in application.blocks if not block.needs_globals)
            return [_file(application.name, types, blocks)]
        return [_file(block.name, (), (block,)) for block in application.blocks]


def _file(name: str, types: tuple[DataType, ...], blocks: tuple[Block, ...]) -> FilePlan:
    return FilePlan(f"{name}.st", "iec/blocks.st.j2", {"types": types, "blocks": blocks})


enter_target(IecTarget())
