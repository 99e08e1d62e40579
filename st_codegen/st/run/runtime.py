"""What the two machines share: making variables of every type, instances of blocks, calls of native code."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError
from st_codegen.st import tree as t
from st_codegen.st.run.emit import is_inlined
from st_codegen.st.run.natives import Library, NativeBlock, NativeCall
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType, BlockType, Elementary, EnumType, PointerType, StructType, Type, Value


class Globals:
    """Holds global variables as attributes `v_LIST__NAME`."""


class Composite:
    """A structure or an instance of a block; variables are attributes `v_NAME`.

    `fields` are the attributes of a structure, `units` what virtual calls on a block reach: methods by their
    upper-case name, the body by the empty name.
    """

    __slots__ = ()
    fields: tuple[str, ...] = ()
    field_types: Mapping[str, Type] = MappingProxyType({})
    units: Mapping[str, Callable[..., Any]] = MappingProxyType({})


class Access(ABC):
    """How native code reads and assigns one variable in the active lanes."""

    @abstractmethod
    def get(self) -> Any:
        """The variable as an array with one entry for each active lane."""

    @abstractmethod
    def set(self, values: Any) -> None:
        """Assign it."""


class Runtime(ABC):
    """What compiled code calls `rt`; `functions` are the compiled units by key."""

    base: type[Composite] = Composite

    def __init__(
        self,
        project: t.Project,
        functions: Mapping[str, Callable[..., Any]],
        libraries: Iterable[Library],
        lanes: int,
        limit: int,
    ) -> None:
        self.project = project
        self.functions = functions
        self.lanes = lanes
        self.limit = limit
        self.time_ns = 0
        self.natives: list[NativeBlock] = []
        self._owners: dict[int, Composite] = {}
        self.g = Globals()
        self._classes: dict[str, type[Composite]] = {}
        self._blocks: dict[str, type[NativeBlock]] = {}
        self._functions: dict[str, Callable[[NativeCall], None]] = {}
        for library in libraries:
            self._blocks |= {name.upper(): cls for name, cls in library.blocks.items()}
            self._functions |= {name.upper(): function for name, function in library.functions.items()}
        missing = [pou.name for key, pou in project.pous.items() if pou.is_native and self._lacks(key, pou)]
        if missing:
            raise InputError(f"give the machine the libraries the project was checked with: {', '.join(missing)}")
        for owner, variables in project.globals.items():
            for variable in variables:
                setattr(self.g, f"v_{owner}__{variable.key}", self.make(variable.type, variable.initial))
        for key, pou in project.pous.items():
            if pou.kind is PouKind.PROGRAM:
                setattr(self, f"p_{key}", self.make(BlockType(pou.name), {}))

    def _lacks(self, key: str, pou: t.Pou) -> bool:
        return pou.block is None and key not in self._blocks and key not in self._functions

    # --- what differs ---

    @abstractmethod
    def make_array(self, type_: ArrayType, initial: NDArray[np.generic] | None) -> Any:
        """An array of elementary values; of pointers when `initial` is None."""

    @abstractmethod
    def make_table(self, initial: NDArray[np.generic]) -> Any:
        """A constant array, which may share memory."""

    @abstractmethod
    def make_union(self, type_: StructType, values: Mapping[str, Value]) -> Any:
        """A union; values are written in their order."""

    @abstractmethod
    def native_unit(self, key: str) -> Callable[..., Any]:
        """A Python function with the signature of compiled code that calls a native unit."""

    @abstractmethod
    def access(self, variable: t.Variable, owner: Any, name: str, m: Any) -> Access:
        """How native code gets at an attribute that holds a variable."""

    # --- making objects ---

    def make(self, type_: Type, initial: Value) -> Any:  # noqa: PLR0911 - one return a case
        """A new variable of a type."""
        if isinstance(type_, Elementary | EnumType | PointerType):
            return initial
        if isinstance(type_, ArrayType):
            if isinstance(initial, np.ndarray):
                return self.make_array(type_, initial)
            if isinstance(type_.element, PointerType):
                return self.make_array(type_, None)
            return [self.make(type_.element, item) for item in cast("list[Value]", initial)]
        values = cast("dict[str, Value]", initial)
        if isinstance(type_, BlockType):
            return self._instance(type_, values)
        if type_.is_union:
            return self.make_union(type_, values)
        made = self._struct_class(type_)()
        for entry in type_.fields:
            setattr(made, f"v_{entry.name.upper()}", self.make(entry.type, values[entry.name.upper()]))
        return made

    def _struct_class(self, type_: StructType) -> type[Composite]:
        key = f"struct {type_.name.upper()}"
        if key not in self._classes:
            types = {f"v_{entry.name.upper()}": entry.type for entry in type_.fields}
            members = {"__slots__": tuple(types), "fields": tuple(types), "field_types": types}
            self._classes[key] = cast("type[Composite]", type(type_.name, (self.base,), members))
        return self._classes[key]

    def _instance(self, type_: BlockType, values: Mapping[str, Value]) -> Composite:
        instance = self._block_class(type_.name)()
        for variable in self.project.block_variables(type_.name):
            if not variable.is_constant:
                initial = values.get(variable.key, variable.initial)
                made = None if variable.section is t.Section.IN_OUT else self.make(variable.type, initial)
                setattr(instance, f"v_{variable.key}", made)
        native = next((pou for pou in self.project.lineage(type_.name) if pou.is_native), None)
        if native is not None:
            made = self._blocks[native.key](self)
            setattr(instance, "native", made)  # noqa: B010 - a slot of a made class
            self._owners[id(made)] = instance
        return instance

    def _block_class(self, name: str) -> type[Composite]:
        key = name.upper()
        if key not in self._classes:
            variables = self.project.block_variables(key)
            stored = tuple(f"v_{variable.key}" for variable in variables if not variable.is_constant)
            members: dict[str, Any] = {"__slots__": (*stored, "native"), "units": self._units(key)}
            for variable in variables:
                if variable.is_constant and not is_inlined(variable):
                    members[f"v_{variable.key}"] = self.make_constant(variable)
            self._classes[key] = cast("type[Composite]", type(name, (self.base,), members))
        return self._classes[key]

    def make_constant(self, variable: t.Variable) -> Any:
        """A composite constant."""
        if isinstance(variable.initial, np.ndarray):
            return self.make_table(variable.initial)
        return self.make(variable.type, variable.initial)

    def _units(self, key: str) -> dict[str, Callable[..., Any]]:
        units: dict[str, Callable[..., Any]] = {}
        lineage = list(self.project.lineage(key))
        for pou in reversed(lineage):
            for name, method in pou.methods.items():
                units[name] = self.unit(method)
        units[""] = self.unit(lineage[0].key)
        return units

    def unit(self, key: str) -> Callable[..., Any]:
        """The function of a unit."""
        return self.native_unit(key) if self.project.pous[key].is_native else self.functions[key]

    # --- native code ---

    def run_body(self, native: NativeBlock, lanes: NDArray[np.int64]) -> None:
        """Call the body of the instance that a native block belongs to, in some lanes."""
        instance = self._owners[id(native)]
        self.run_unit(instance.units[""], instance, lanes)

    @abstractmethod
    def run_unit(self, code: Callable[..., Any], instance: Composite, lanes: NDArray[np.int64]) -> None:
        """Run compiled code in some lanes."""

    def run_native(self, key: str, instance: Any, lanes: NDArray[np.int64], m: Any, atoms: tuple[Any, ...]) -> Any:
        """Call Python for a unit; `atoms` are its inputs and references (those of a body are in the instance).

        Gives the result and the outputs, as compiled functions do.
        """
        pou = self.project.pous[key]
        if pou.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
            variables = self.project.block_variables(key)
            accesses = {variable.key: self.access(variable, instance, f"v_{variable.key}", m) for variable in variables}
            instance.native.body(_native_call(self, lanes, accesses))
            return ()
        parameters = pou.section(t.Section.INPUT, t.Section.IN_OUT)
        slots = {variable: Slot(atom) for variable, atom in zip(parameters, atoms, strict=True)}
        results = (*((pou.result,) if pou.result else ()), *pou.section(t.Section.OUTPUT))
        slots |= {variable: Slot(self.make(variable.type, variable.initial)) for variable in results}
        accesses = {}
        if pou.block is not None:
            own = self.project.block_variables(pou.block)
            accesses |= {variable.key: self.access(variable, instance, f"v_{variable.key}", m) for variable in own}
        accesses |= {variable.key: self.access(variable, slot, "v", m) for variable, slot in slots.items()}
        call = _native_call(self, lanes, accesses)
        if pou.block is not None:
            getattr(instance.native, pou.name)(call)
        else:
            self._functions[key](call)
        values = tuple(slots[variable].v for variable in results)
        return values[0] if len(values) == 1 else values


class Slot:
    """Holds one variable: a local one that is passed by reference, an argument of native code."""

    __slots__ = ("v",)

    def __init__(self, v: Any) -> None:
        self.v = v


def _native_call(rt: Runtime, lanes: NDArray[np.int64], accesses: Mapping[str, Access]) -> NativeCall:
    getters = {name: access.get for name, access in accesses.items()}
    return NativeCall(rt, lanes, getters, {name: access.set for name, access in accesses.items()})
