"""What a generated project consists of, whatever files it comes in: types, globals, blocks, programs, tasks, tests.

A target lays all of it out without knowing what any of it is for: a new program, list of globals or task is added
here and appears in every target, with its file, its entry in the project file and its place among the declarations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from st_codegen.emit.blocks.listing import Block, BlockVariable, Table, refuse_twins
from st_codegen.emit.foreign_names import is_foreign
from st_codegen.emit.literals import is_keyword
from st_codegen.errors import InputError


@dataclass(frozen=True)
class Structure:
    """STRUCT with its fields, in order."""

    name: str
    comment: tuple[str, ...]
    fields: tuple[BlockVariable, ...]
    template: ClassVar[str] = "structure"
    portable: ClassVar[bool] = True


@dataclass(frozen=True)
class Overlay:
    """UNION: all fields at one place in memory. TwinCAT only."""

    name: str
    comment: tuple[str, ...]
    fields: tuple[BlockVariable, ...]
    template: ClassVar[str] = "overlay"
    portable: ClassVar[bool] = False


@dataclass(frozen=True)
class EnumValue:
    """One name of an enumeration and its number, which is written out so that it never moves."""

    name: str
    value: int
    comment: str = ""


@dataclass(frozen=True)
class Enumeration:
    """Named numbers; `base` is the integer type that holds them. The portable subset has constants instead."""

    name: str
    comment: tuple[str, ...]
    values: tuple[EnumValue, ...]
    base: str = "DINT"
    template: ClassVar[str] = "enumeration"
    fields: ClassVar[tuple[BlockVariable, ...]] = ()
    portable: ClassVar[bool] = False


@dataclass(frozen=True)
class ArrayAlias:
    """A named array type, bounds 0 .. length - 1: strict compilers want one for arrays that blocks exchange."""

    name: str
    comment: tuple[str, ...]
    element: str
    length: int
    template: ClassVar[str] = "array"
    fields: ClassVar[tuple[BlockVariable, ...]] = ()
    portable: ClassVar[bool] = True

    @property
    def last(self) -> int:
        """The largest index of the array, which begins at 0."""
        return self.length - 1


DataType = Structure | Overlay | Enumeration | ArrayAlias


@dataclass(frozen=True)
class GlobalList:
    """VAR_GLOBAL, always used with its name in front (`GVL_X.nValue`).

    `of_programs`: signals between programs and the machine, which no function block uses.
    """

    name: str
    comment: tuple[str, ...]
    variables: tuple[BlockVariable, ...] = ()
    tables: tuple[Table, ...] = ()
    constant: bool = False
    of_programs: bool = False

    def __post_init__(self) -> None:
        refuse_twins(self.name, self.variables)


@dataclass(frozen=True)
class Task:
    """A cyclic task: its cycle time in us, its priority (smaller is more urgent) and its programs in calling order."""

    name: str
    cycle_us: int
    priority: int
    programs: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.cycle_us <= 0 or not 0 <= self.priority <= 31 or not self.programs:
            raise InputError(
                f"task {self.name}: cycle time {self.cycle_us} us, priority {self.priority}, programs "
                f"{', '.join(self.programs) or 'none'}; give a positive time, a priority of 0 .. 31 and a program"
            )


class ProjectForm(StrEnum):
    """What a development environment is given to open."""

    SOLUTION = "solution"  # opens by itself: system, tasks and the PLC project
    PLC = "plc"  # a PLC project alone, to be added to a solution
    LIBRARY = "library"  # function blocks without programs and tasks, which other projects refer to


@dataclass(frozen=True)
class Packaging:
    """The form of a project, and what a library is called by those that refer to it.

    `company` and `namespace` may be empty: the first is then left out, the second is the project's name.
    """

    form: ProjectForm = ProjectForm.SOLUTION
    version: str = "1.0.0.0"
    company: str = ""
    namespace: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"\d{1,5}(\.\d{1,5}){1,3}", self.version, re.ASCII):
            raise InputError(f"version {self.version!r}: two to four numbers with dots are wanted, such as 1.0.0.0")
        if self.namespace and not re.fullmatch(r"[A-Za-z]\w*", self.namespace, re.ASCII):
            raise InputError(f"namespace {self.namespace!r}: letters, digits and underscores, a letter first")
        if is_keyword(self.namespace):
            raise InputError(f"namespace {self.namespace!r}: a reserved word of Structured Text")
        if not self.company.isprintable():
            raise InputError(f"company {self.company!r}: a character that cannot be printed")


AS_SOLUTION = Packaging()


@dataclass(frozen=True)
class Application:
    """All of a project, each kind in the order in which strict compilers want it declared: users after what they use.

    `blocks` are functions, function blocks and programs; `tests` are test suites and the program that runs them, which
    targets without a test library leave out, with the tasks of such programs. `libraries` are names of TwinCAT
    libraries beside Tc2_Standard. Where `connected` is False, every block stands alone. With `has_configuration` the
    text says itself what runs it. `attributes` are pragmas of all blocks, where a dialect has them. `packaging` is for
    dialects whose development environment has projects.
    """

    name: str
    connected: bool = True
    types: tuple[DataType, ...] = ()
    globals: tuple[GlobalList, ...] = ()
    blocks: tuple[Block, ...] = ()
    tasks: tuple[Task, ...] = ()
    tests: tuple[Block, ...] = ()
    libraries: tuple[str, ...] = ()
    has_configuration: bool = False
    attributes: tuple[str, ...] = ()
    packaging: Packaging = AS_SOLUTION

    def __post_init__(self) -> None:
        taken: dict[str, str] = {}
        for item in (*self.types, *self.globals, *self.blocks, *self.tests, *self.tasks):
            if item.name.lower() in taken:
                raise InputError(f"two objects of the project would be called {item.name}: rename one of the models")
            taken[item.name.lower()] = item.name
        for owner, name in self._names():
            if is_foreign(name):
                raise InputError(
                    f"{owner}: {name} is a name of C, C++, SCL or CODESYS to some compilers: rename the model"
                )
        programs = {block.name for block in (*self.blocks, *self.tests) if block.kind == "PROGRAM"}
        for task in self.tasks:
            missing = [name for name in task.programs if name not in programs]
            if missing:
                raise InputError(f"task {task.name}: no program {', '.join(missing)} in the project")

    def _names(self) -> Iterator[tuple[str, str]]:
        """The names of all variables, with the object that declares each."""
        for block in (*self.blocks, *self.tests):
            ports = (*block.inputs, *block.outputs, *block.in_outs)
            yield from ((block.name, variable.name) for variable in (*ports, *block.variables, *block.constants))
            yield from ((block.name, table.name) for table in block.tables)
            yield from ((block.name, code.constant) for code in block.codes)
        for owner in self.globals:
            yield from ((owner.name, variable.name) for variable in owner.variables)
            yield from ((owner.name, table.name) for table in owner.tables)
        for type_ in self.types:
            yield from ((type_.name, variable.name) for variable in type_.fields)

    def alone(self) -> Iterator[tuple[str, tuple[Block, ...]]]:
        """Blocks that stand alone, by name, each with those that call it: what goes into one file."""
        callers = {variable.type: block for block in self.blocks for variable in block.variables}
        called = {id(block) for name, block in callers.items() if any(other.name == name for other in self.blocks)}
        for block in self.blocks:
            if id(block) not in called:
                caller = callers.get(block.name)
                yield block.name, (block,) if caller is None else (block, caller)

    @property
    def own_tasks(self) -> tuple[Task, ...]:
        """The tasks that call no test program."""
        tests = {block.name for block in self.tests}
        return tuple(task for task in self.tasks if not tests & set(task.programs))
