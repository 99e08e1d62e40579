"""PLCopen XML (TC6, version 2.01), which most IEC 61131-3 tools import.

Declarations are elements, code is Structured Text. The schema's namespace is tc6_0201, but TwinCAT and CODESYS write
and read tc6_0200, so that is written; the structure is the same.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

from st_codegen.emit.blocks.application import Application, Enumeration
from st_codegen.emit.blocks.listing import LINE_LENGTH, Block, BlockVariable, Table
from st_codegen.emit.blocks.model import Limits
from st_codegen.emit.targets.base import FilePlan, Target, enter_target
from st_codegen.errors import Problems, TargetError

#: The schema requires a date and the files must not change from run to run: always this one.
CREATED = "2000-01-01T00:00:00"

_ELEMENTARY = frozenset(
    "BOOL BYTE WORD DWORD LWORD SINT INT DINT LINT USINT UINT UDINT ULINT REAL LREAL TIME DATE DT TOD".split()
)
_STRING = re.compile(r"STRING(?:\((\d+)\))?")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)?")
_POU_TYPES = {"FUNCTION": "function", "FUNCTION_BLOCK": "functionBlock", "PROGRAM": "program"}
_KINDS_OF_TYPES = ("array", "structure")


@dataclass(frozen=True)
class XmlType:
    """A type as an element: its tag with one attribute at most, and the upper bound where it is an array from 0."""

    tag: str
    attribute: str = ""
    value: str = ""
    last: int | None = None


@dataclass(frozen=True)
class XmlVariable:
    """A variable, its comment in lines; `table` has the initial values of a constant array."""

    name: str
    type: XmlType
    initial: str
    comment: tuple[str, ...]
    table: Table | None = None


@dataclass(frozen=True)
class XmlSection:
    """A group of variables of a unit: inputVars, outputVars, inOutVars or localVars."""

    tag: str
    constant: bool
    variables: tuple[XmlVariable, ...]


class PlcOpenTarget(Target):
    """One XML file for the whole project."""

    name = "plcopen"
    may_lack_lreal = True
    summary = "PLCopen XML, TC6 version 2.01 (.xml)"
    dialect = "iec"
    templates = "iec"
    limits = Limits(real_range=(1e-37, 1e37), data_bytes=16 * 1024 * 1024)
    #: What prints the file.
    template: ClassVar[str] = "plcopen/project.xml.j2"

    def files(self, application: Application) -> Iterable[FilePlan]:
        problems = Problems("PLCopen XML")
        blocks = tuple(block for block in application.blocks if not block.needs_globals)
        numbers = {item.name: item.base for item in application.types if isinstance(item, Enumeration)}
        writer = _Writer(numbers)
        types, units = [], []
        for item in application.types:
            if item.template not in (*_KINDS_OF_TYPES, Enumeration.template):
                problems.add(f"type {item.name}: a {item.template} cannot be expressed; use --target twincat")
            elif item.name not in numbers:
                with problems.collect():
                    types.append({"type": item, "fields": writer.variables(item.fields)})
        for block in blocks:
            if block.extends:
                problems.add(f"{block.name} extends {block.extends}: not expressible; use --target twincat")
            with problems.collect():
                units.append({"block": block, "type": _POU_TYPES[block.kind], "sections": writer.sections(block)})
        problems.raise_if_any()
        programs = {block.name for block in blocks}
        values = {
            "application": application,
            "blocks": blocks,
            "created": CREATED,
            "types": types,
            "units": units,
            "type_of": writer.type,
            # signals are inputs and outputs of programs in this dialect; lists of constants are for reading
            "globals": [
                {"list": item, "variables": writer.variables(item.variables, item.tables)}
                for item in application.globals
                if item.constant
            ],
            "seconds": lambda microseconds: f"{Decimal(microseconds).scaleb(-6).normalize():f}",
            "tasks": [task for task in application.own_tasks if programs.issuperset(task.programs)],
        }
        return [FilePlan(f"{application.name}.xml", self.template, values)]


@dataclass(frozen=True)
class _Writer:
    """Variables and types as elements; `numbers` has the integer type of each enumeration, which stands for it."""

    numbers: Mapping[str, str]

    def sections(self, block: Block) -> tuple[XmlSection, ...]:
        """The variables of a unit in their groups."""
        codes = [
            BlockVariable(code.constant, "DINT", initial=str(code.value), comment=code.comment) for code in block.codes
        ]
        sections = (
            XmlSection("inputVars", False, self.variables(block.inputs)),
            XmlSection("outputVars", False, self.variables(block.outputs)),
            XmlSection("inOutVars", False, self.variables(block.in_outs)),
            XmlSection("localVars", False, self.variables(block.variables)),
            XmlSection("localVars", True, self.variables((*codes, *block.constants), block.tables)),
        )
        return tuple(section for section in sections if section.variables)

    def variables(self, variables: Iterable[BlockVariable], tables: Iterable[Table] = ()) -> tuple[XmlVariable, ...]:
        """Variables, and constant arrays with their values."""
        plain = tuple(self._variable(variable) for variable in variables)
        return plain + tuple(
            XmlVariable(table.name, self.type(table.type, table.last), "", _lines(table.comment), table)
            for table in tables
        )

    def _variable(self, variable: BlockVariable) -> XmlVariable:
        """Raises TargetError for a type or an initial value that has no element."""
        if variable.initial[:1] in ("[", "("):
            raise TargetError(
                f"{variable.name}: the initial value {variable.initial} is a list; only tables have one here"
            )
        last = variable.last if variable.length is not None else None
        return XmlVariable(variable.name, self.type(variable.type, last), variable.initial, _lines(variable.comment))

    def type(self, name: str, last: int | None = None) -> XmlType:
        """The element of a type by its name. Raises TargetError for what is no plain name."""
        name = self.numbers.get(name, name)
        if name in _ELEMENTARY:
            return XmlType(name, last=last)
        string = _STRING.fullmatch(name)
        if string is not None:
            return XmlType("string", "length" if string[1] else "", string[1] or "", last)
        if not _NAME.fullmatch(name):
            raise TargetError(f"the type {name} has no element in PLCopen XML; use --target twincat")
        return XmlType("derived", "name", name, last)


def _lines(comment: str) -> tuple[str, ...]:
    return tuple(textwrap.wrap(comment, LINE_LENGTH - 10))


enter_target(PlcOpenTarget())
