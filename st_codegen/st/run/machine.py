"""What a user sees of a machine, lanes or not: instances, variables by name, calls, errors with positions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.emit import Source, is_inlined
from st_codegen.st.run.natives import NativeBlock
from st_codegen.st.run.paths import Port, Step, find_block, find_global, ports, resolve
from st_codegen.st.run.runtime import Composite, Runtime, Slot
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, Elementary, EnumType, Type, default_value, storage_type

LOOP_LIMIT = 10_000_000


class Machine(ABC):
    """A project that runs."""

    def __init__(self, project: t.Project, rt: Runtime, source: Source) -> None:
        self.project = project
        self.rt = rt
        self.source = source
        self.globals = GlobalVariables(self)

    @property
    def time_ns(self) -> int:
        """The clock of native timers, in nanoseconds."""
        return self.rt.time_ns

    @time_ns.setter
    def time_ns(self, value: int) -> None:
        self.rt.time_ns = value

    def instance(self, block: str) -> Instance:
        """A new instance of a function block. Raises `StUsageError` when there is no such block."""
        type_ = find_block(self.project, block)
        return Instance(self, type_, self.rt.make(type_, {}))

    def program(self, name: str) -> Instance:
        """The instance of a program. Raises `StUsageError` when there is no such program."""
        found = getattr(self.rt, f"p_{name.upper()}", None)
        if found is None:
            raise StUsageError(f"the project has no program '{name}'")
        return Instance(self, find_block(self.project, name), found)

    def call(self, function: str, *arguments: Any, **named: Any) -> Any:
        """Call a function; gives its result, or a tuple of result and outputs when it has outputs."""
        pou = self.project.pous.get(function.upper())
        if pou is None or pou.kind is not PouKind.FUNCTION:
            raise StUsageError(f"the project has no function '{function}'")
        return self.call_unit(pou, None, self.rt.unit(pou.key), arguments, named)

    def call_unit(
        self, pou: t.Pou, receiver: Any, code: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]
    ) -> Any:
        """Call a function or method with values of the user."""
        parameters = pou.section(t.Section.INPUT, t.Section.IN_OUT)
        given = dict(zip((parameter.key for parameter in parameters), arguments, strict=False))
        given |= {name.upper(): value for name, value in named.items()}
        unknown = sorted(set(given) - {parameter.key for parameter in parameters})
        if unknown or len(arguments) > len(parameters):
            raise StUsageError(f"'{pou.name}' takes {len(parameters)} arguments; not known: {', '.join(unknown)}")
        atoms = []
        for parameter in parameters:
            if parameter.section is t.Section.IN_OUT:
                raise StUsageError(f"'{pou.name}' has a VAR_IN_OUT: call it from Structured Text")
            if parameter.key not in given and not parameter.has_initial:
                raise StUsageError(f"the argument '{parameter.name}' of '{pou.name}' is missing")
            slot = Slot(self.rt.make(parameter.type, parameter.initial))
            if parameter.key in given:
                self._set(slot, Step(parameter.type), "v", parameter.name, given[parameter.key])
            atoms.append(slot.v)
        result = self.run(code, receiver, *atoms)
        types = ([pou.result.type] if pou.result is not None else []) + [v.type for v in pou.section(t.Section.OUTPUT)]
        values = (result,) if len(types) == 1 else result
        shown = tuple(self.show(value, type_) for value, type_ in zip(values, types, strict=True))
        return shown[0] if len(shown) == 1 else (shown or None)

    # --- what differs ---

    @abstractmethod
    def run(self, code: Callable[..., Any], receiver: Any, *atoms: Any) -> Any:
        """Run a unit. Raises `StRuntimeError` for what would stop a controller."""

    @abstractmethod
    def show(self, value: Any, type_: Type) -> Any:
        """A variable for the user."""

    @abstractmethod
    def element(self, holder: Any, step: Step) -> Any:
        """An element of an array or a field of a union."""

    @abstractmethod
    def set_element(self, holder: Any, step: Step, value: Any) -> None:
        """Assign an element of an array or a field of a union."""

    @abstractmethod
    def single(self, value: Any, type_: Elementary) -> Any:
        """A value of the user as an elementary variable. Raises `ValueError`."""

    @abstractmethod
    def array(self, value: Any, type_: ArrayType) -> Any:
        """A value of the user as an array of elementary values. Raises `ValueError`."""

    @abstractmethod
    def reference(self, slot: Slot, type_: Elementary) -> Any:
        """What a VAR_IN_OUT of an elementary type holds."""

    # --- variables ---

    def read(self, memory: Any, steps: list[Step]) -> Any:
        """The variable that steps lead to."""
        value = memory
        for step in steps:
            value = self._follow(value, step)
        return self.show(value, steps[-1].type)

    def _follow(self, memory: Any, step: Step) -> Any:
        if step.variable is not None and is_inlined(step.variable):
            return step.variable.initial
        if step.number is not None or (step.name is None and not isinstance(memory, list)):
            return self.element(memory, step)
        if step.name is None:
            return memory[step.index]
        value = getattr(memory, f"v_{step.name}")
        is_reference = step.variable is not None and step.variable.section is t.Section.IN_OUT
        if is_reference and value is not None and isinstance(step.type, Elementary | EnumType):
            return self.element(value, step)
        return value

    def write(self, memory: Any, steps: list[Step], path: str, value: Any) -> None:
        """Set the variable that steps lead to. Raises `StUsageError` for a constant or a wrong value."""
        if any(step.variable is not None and step.variable.is_constant for step in steps):
            raise StUsageError(f"'{path}' is a constant")
        *before, last = steps
        for step in before:
            memory = self._follow(memory, step)
        self._set(memory, last, f"v_{last.name}", path, value)

    def _set(self, holder: Any, step: Step, name: str, path: str, value: Any) -> None:
        type_ = step.type
        is_table = isinstance(type_, ArrayType) and isinstance(type_.element, Elementary | EnumType)
        if not isinstance(type_, Elementary | EnumType) and not (is_table and step.number is None):
            raise StUsageError(f"'{path}' is {type_}: set its parts one by one")
        try:
            if isinstance(type_, ArrayType):
                setattr(holder, name, self.array(value, type_))
                return
            new = self.single(value, storage_type(type_))
        except (ValueError, OverflowError, TypeError) as error:
            raise StUsageError(f"'{path}' : {type_}: {error}") from None
        is_reference = step.variable is not None and step.variable.section is t.Section.IN_OUT
        if is_reference:
            self.set_element(getattr(holder, name), step, new)
        elif step.number is not None or (step.name is None and not isinstance(holder, Slot)):
            self.set_element(holder, step, new)
        else:
            setattr(holder, name, new)


class Instance:
    """An instance of a function block or program: `block["name"]` reads a variable, `block["name"] = value` sets it."""

    def __init__(self, machine: Machine, type_: BlockType, memory: Composite) -> None:
        self._machine = machine
        self._type = type_
        self._memory = memory
        self._paths: dict[str, list[Step]] = {}
        self._references = self._ports(t.Section.IN_OUT)

    def _ports(self, *sections: t.Section) -> tuple[Port, ...]:
        return ports(self._machine.project, self._type.name, *sections)

    @property
    def inputs(self) -> tuple[Port, ...]:
        """VAR_INPUT in order."""
        return self._ports(t.Section.INPUT)

    @property
    def outputs(self) -> tuple[Port, ...]:
        """VAR_OUTPUT in order."""
        return self._ports(t.Section.OUTPUT)

    @property
    def native(self) -> NativeBlock:
        """The Python object behind an instance of a native block, or of a block that extends one."""
        found: NativeBlock | None = getattr(self._memory, "native", None)
        if found is None:
            raise StUsageError(f"'{self._type}' is not native")
        return found

    def __call__(self, **inputs: Any) -> None:
        """Set inputs and call the instance once. Raises `StRuntimeError`, `StUsageError`."""
        for name, value in inputs.items():
            self[name] = value
        for port in self._references:
            if getattr(self._memory, f"v_{port.variable.key}") is None:
                raise StUsageError(f"'{port.name}' of '{self._type}' is VAR_IN_OUT: set it before the first call")
        self._machine.run(self._memory.units[""], self._memory)

    def method(self, name: str, *arguments: Any, **named: Any) -> Any:
        """Call a method; gives its result, or a tuple of result and outputs. Raises `StRuntimeError`."""
        pou = self._machine.project.find_method(self._type.name, name)
        if pou is None:
            raise StUsageError(f"'{self._type}' has no method '{name}'")
        return self._machine.call_unit(pou, self._memory, self._memory.units[name.upper()], arguments, named)

    def _steps(self, path: str) -> list[Step]:
        if path not in self._paths:
            self._paths[path] = resolve(self._machine.project, self._type, path)
        return self._paths[path]

    def __getitem__(self, path: str) -> Any:
        return self._machine.read(self._memory, self._steps(path))

    def __setitem__(self, path: str, value: Any) -> None:
        steps = self._steps(path)
        first = steps[0].variable
        if first is not None and first.section is t.Section.IN_OUT and getattr(self._memory, f"v_{first.key}") is None:
            self._bind(first)
        self._machine.write(self._memory, steps, path, value)

    def _bind(self, variable: t.Variable) -> None:
        """Give a VAR_IN_OUT a variable to refer to."""
        made = self._machine.rt.make(variable.type, default_value(variable.type))
        if isinstance(variable.type, Elementary | EnumType):
            made = self._machine.reference(Slot(made), storage_type(variable.type))
        setattr(self._memory, f"v_{variable.key}", made)


class GlobalVariables:
    """Global variables by `LIST.name` or plain name, read and set like those of an instance."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._paths: dict[str, list[Step]] = {}

    def _find(self, path: str) -> list[Step]:
        if path not in self._paths:
            self._paths[path] = self._resolved(path)
        return self._paths[path]

    def _resolved(self, path: str) -> list[Step]:
        variable, rest = find_global(self._machine.project, path)
        first = Step(variable.type, name=f"{variable.owner}__{variable.key}", variable=variable)
        return [first, *(resolve(self._machine.project, variable.type, rest) if rest else [])]

    def __getitem__(self, path: str) -> Any:
        return self._machine.read(self._machine.rt.g, self._find(path))

    def __setitem__(self, path: str, value: Any) -> None:
        self._machine.write(self._machine.rt.g, self._find(path), path, value)


def checked_numbers(value: Any, type_: Elementary) -> NDArray[Any]:
    """A user's value in the type of a variable; nothing is rounded or wrapped on the way, except to REAL.

    Raises `ValueError`.
    """
    given = np.asarray(value, dtype=object if type_.dtype == object else None)
    if type_.dtype == object:
        if not all(isinstance(text, str) and len(text) <= type_.bits for text in given.flat):
            raise ValueError(f"text of at most {type_.bits} characters is needed")
    elif type_.is_integral:
        is_whole = given.dtype.kind in "iu" or (given.dtype.kind == "O" and all(type(x) is int for x in given.flat))
        if not is_whole:
            raise ValueError(f"integers are needed, not {given.dtype}")
        if given.size and not (type_.holds(int(given.min())) and type_.holds(int(given.max()))):
            raise ValueError(f"values outside of {type_.lower}..{type_.upper}")
    elif type_.is_real and given.dtype.kind not in "fiu":
        raise ValueError(f"numbers are needed, not {given.dtype}")
    elif not type_.is_real and given.dtype.kind != "b":
        raise ValueError(f"True or False is needed, not {given.dtype}")
    return np.array(given, dtype=type_.dtype)
