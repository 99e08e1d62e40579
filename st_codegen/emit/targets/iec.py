"""Portable Structured Text: the subset that strict compilers outside TwinCAT accept."""

from __future__ import annotations

from collections.abc import Iterable

from st_codegen.emit.blocks.application import Application, DataType, Task
from st_codegen.emit.blocks.configuration import with_programs
from st_codegen.emit.blocks.listing import Block
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FilePlan, Target, enter_target


class IecTarget(Target):
    """One `.st` file a model; a bundle is one file, in the order in which strict compilers want declarations.

    Global variables are left out, and tasks, too, unless a CONFIGURATION is asked for: then all is one file.
    """

    name = "iec"
    summary = "portable Structured Text (.st)"
    dialect = "iec"
    is_portable = True
    may_lack_lreal = True
    has_configuration = True
    templates = "iec"
    limits = Limits(real_range=(1e-37, 1e37), data_bytes=16 * 1024 * 1024)

    def files(self, application: Application) -> Iterable[FilePlan]:
        if application.has_configuration:
            application = with_programs(application)
        if application.connected or application.has_configuration:
            return [text_file(application)]
        return [_file(name, (), blocks) for name, blocks in application.alone()]


def text_file(application: Application) -> FilePlan:
    """A file of portable text with the types and blocks of an application and, where it says so, what runs them."""
    types = tuple(item for item in application.types if item.portable)
    blocks = tuple(block for block in application.blocks if not block.needs_globals)
    return _file(application.name, types, blocks, application.tasks if application.has_configuration else ())


def _file(name: str, types: tuple[DataType, ...], blocks: tuple[Block, ...], tasks: tuple[Task, ...] = ()) -> FilePlan:
    values = {"types": types, "blocks": blocks, "tasks": [_timed(task) for task in tasks]}
    return FilePlan(f"{name}.st", "iec/blocks.st.j2", values)


def _timed(task: Task) -> dict[str, object]:
    """A task with its cycle time as a literal; in milliseconds, since some compilers have no smaller unit."""
    return {
        "name": task.name,
        "interval": f"T#{task.cycle_us / 1000:g}ms",
        "priority": task.priority,
        "programs": task.programs,
    }


enter_target(IecTarget())
