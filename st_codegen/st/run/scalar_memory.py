"""The objects of a machine with a single lane: plain Python values, lists and attributes."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.run.natives import as_lanes
from st_codegen.st.run.runtime import Access, Composite, Runtime
from st_codegen.st.types import ArrayType, Elementary, EnumType, PointerType, StructType, Type, Value, storage_type

# From this length on a constant table is kept as packed numbers: 8 bytes instead of 32 for each
PACKED = 1 << 16
_LANE = np.zeros(1, np.int64)


class ScalarUnion:
    """Fields over the same bytes; `formats` has the packing of one element of each field."""

    __slots__ = ("data", "formats")

    def __init__(self, formats: tuple[Struct, ...], size: int) -> None:
        self.formats = formats
        self.data = bytearray(size)

    def get(self, number: int, k: int) -> Any:
        """A field, or element `k` of one."""
        packing = self.formats[number]
        return packing.unpack_from(self.data, k * packing.size)[0]

    def set(self, number: int, k: int, value: Any) -> None:
        """Assign a field, or an element of one."""
        packing = self.formats[number]
        packing.pack_into(self.data, k * packing.size, value)


class SlotReference:
    """A reference to a variable or field."""

    __slots__ = ("name", "owner")

    def __init__(self, owner: Any, name: str) -> None:
        self.owner = owner
        self.name = name

    def get(self, _m: None = None) -> Any:
        """The value."""
        return getattr(self.owner, self.name)

    def set(self, value: Any, _m: None = None) -> None:
        """Assign it."""
        setattr(self.owner, self.name, value)


class ElementReference:
    """A reference to an element of an array."""

    __slots__ = ("items", "k")

    def __init__(self, items: list[Any], k: int) -> None:
        self.items = items
        self.k = k

    def get(self, _m: None = None) -> Any:
        """The value."""
        return self.items[self.k]

    def set(self, value: Any, _m: None = None) -> None:
        """Assign it."""
        self.items[self.k] = value


class UnionReference:
    """A reference to a field of a union."""

    __slots__ = ("k", "number", "union")

    def __init__(self, union: ScalarUnion, number: int, k: int) -> None:
        self.union = union
        self.number = number
        self.k = k

    def get(self, _m: None = None) -> Any:
        """The value."""
        return self.union.get(self.number, self.k)

    def set(self, value: Any, _m: None = None) -> None:
        """Assign it."""
        self.union.set(self.number, self.k, value)


def assign(target: Any, source: Any) -> None:
    """Copy a structure, union or array."""
    if isinstance(target, list):
        if target and isinstance(target[0], Composite | ScalarUnion | list):
            for inner, other in zip(target, source, strict=True):
                assign(inner, other)
        else:
            target[:] = source
    elif isinstance(target, ScalarUnion):
        target.data[:] = source.data
    else:
        for name in target.fields:
            value = getattr(source, name)
            if isinstance(value, Composite | ScalarUnion | list):
                assign(getattr(target, name), value)
            else:
                setattr(target, name, value)


def _packing(type_: Type) -> Struct:
    dtype = storage_type(type_).dtype
    return Struct("<" + {"l": "q", "L": "Q"}.get(dtype.char, dtype.char))


def _layout(type_: StructType) -> tuple[tuple[Struct, ...], int, dict[str, int]]:
    """Packing of the fields of a union, its bytes, and the number of each field."""
    elements = [entry.type.element if isinstance(entry.type, ArrayType) else entry.type for entry in type_.fields]
    counts = [entry.type.size if isinstance(entry.type, ArrayType) else 1 for entry in type_.fields]
    formats = tuple(_packing(element) for element in elements)
    size = max((packing.size * count for packing, count in zip(formats, counts, strict=True)), default=0)
    return formats, size, {entry.name.upper(): number for number, entry in enumerate(type_.fields)}


def packed(table: NDArray[np.generic]) -> Any:
    """A constant table for single accesses: a list, or packed numbers when it is long."""
    if table.size < PACKED or table.dtype.kind not in "iuf":
        return table.tolist()
    return array({"l": "q", "L": "Q"}.get(table.dtype.char, table.dtype.char), table.tobytes())


class ScalarRuntime(Runtime):
    """Variables as plain Python values; there is one lane."""

    def __init__(self, *arguments: Any) -> None:
        self._constants: dict[t.Variable, Any] = {}
        self._layouts: dict[str, tuple[tuple[Struct, ...], int, dict[str, int]]] = {}
        super().__init__(*arguments)

    def make_array(self, type_: ArrayType, initial: NDArray[np.generic] | None) -> list[Any]:
        """An array of elementary values; of pointers when `initial` is None."""
        return [None] * type_.size if initial is None else list(initial.tolist())

    def make_table(self, initial: NDArray[np.generic]) -> Any:
        """A constant array, which may share memory."""
        return packed(initial)

    def constant(self, variable: t.Variable) -> Any:
        """A composite constant of a function or method, made once."""
        if variable not in self._constants:
            self._constants[variable] = self.make_constant(variable)
        return self._constants[variable]

    def make_union(self, type_: StructType, values: Mapping[str, Value]) -> ScalarUnion:
        """A union; values are written in their order."""
        if type_.name not in self._layouts:  # functions make theirs in each call
            self._layouts[type_.name] = _layout(type_)
        formats, size, places = self._layouts[type_.name]
        union = ScalarUnion(formats, size)
        for key, value in values.items():
            for k, item in enumerate(value.tolist() if isinstance(value, np.ndarray) else [value]):
                union.set(places[key], k, item)
        return union

    def native_unit(self, key: str) -> Callable[..., Any]:
        """A Python function with the signature of compiled code that calls a native unit."""
        return lambda rt, s, *atoms: rt.call_native(key, s, atoms)

    def run_unit(self, code: Callable[..., Any], instance: Composite, lanes: NDArray[np.int64]) -> None:
        """Run compiled code."""
        del lanes  # there is only one
        code(self, instance)

    def call_native(self, key: str, instance: Any, atoms: tuple[Any, ...]) -> Any:
        """Call Python for a unit."""
        return self.run_native(key, instance, _LANE, None, atoms)

    def access(self, variable: t.Variable, owner: Any, name: str, m: Any) -> ScalarAccess:
        """How native code gets at an attribute that holds a variable."""
        del m  # there is only one lane
        return ScalarAccess(variable, SlotReference(owner, name))


class ScalarAccess(Access):
    """Native code sees arrays of one entry."""

    def __init__(self, variable: t.Variable, slot: SlotReference) -> None:
        self._variable, self._slot = variable, slot

    def get(self) -> Any:
        """The variable as an array of one entry; arrays and pointers as something to read and write."""
        value, type_ = self._slot.get(), self._variable.type
        if isinstance(type_, PointerType) or isinstance(value, list):
            return None if value is None else ScalarPointer(value)
        if not isinstance(type_, Elementary | EnumType):
            return value
        if self._variable.section is t.Section.IN_OUT:
            value = value.get()
        return as_lanes(value, 1, storage_type(type_).dtype)

    def set(self, values: Any) -> None:
        """Assign the variable."""
        target = self._slot.get() if self._variable.section is t.Section.IN_OUT else self._slot
        target.set(as_lanes(values, 1, storage_type(self._variable.type).dtype).tolist()[0])


class ScalarPointer:
    """A variable or array of the project in native code."""

    def __init__(self, target: Any) -> None:
        self._target = target

    def read(self) -> Any:
        """The variable, shape (1,), or the array, shape (1, elements)."""
        return np.array([self._target if isinstance(self._target, list) else self._target.get()])

    def write(self, values: Any) -> None:
        """Assign the variable or array."""
        if isinstance(self._target, list):
            self._target[:] = np.broadcast_to(values, (1, len(self._target)))[0].tolist()
        else:
            self._target.set(np.broadcast_to(np.asarray(values), (1,)).tolist()[0])
