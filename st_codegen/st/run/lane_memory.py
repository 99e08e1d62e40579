"""The objects of a machine with many lanes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.run.natives import as_lanes
from st_codegen.st.run.runtime import Access, Composite, Runtime
from st_codegen.st.run.storage import LaneArray, LaneStruct, LaneUnion, Mask, all_lanes, ld, own, put
from st_codegen.st.types import ArrayType, Elementary, EnumType, PointerType, StructType, Value, storage_type


class LaneRuntime(Runtime):
    """Variables as `storage` has them; `k` are the composite constants of functions and methods."""

    base: type[Composite] = LaneStruct
    k: tuple[Any, ...] = ()

    def make_array(self, type_: ArrayType, initial: NDArray[np.generic] | None) -> LaneArray:
        """An array of elementary values; of pointers when `initial` is None."""
        return LaneArray(np.full(type_.size, None, dtype=object) if initial is None else np.array(initial), self.lanes)

    def make_table(self, initial: NDArray[np.generic]) -> LaneArray:
        """A constant array, which may share memory."""
        return LaneArray(initial, self.lanes)

    def make_union(self, type_: StructType, values: Mapping[str, Value]) -> LaneUnion:
        """A union; values are written in their order."""
        layout = []
        for entry in type_.fields:
            is_array = isinstance(entry.type, ArrayType)
            element = entry.type.element if isinstance(entry.type, ArrayType) else entry.type
            count = entry.type.size if isinstance(entry.type, ArrayType) else None
            layout.append((storage_type(element).dtype, count if is_array else None))
        union = LaneUnion(tuple(layout), self.lanes)
        keys = [entry.name.upper() for entry in type_.fields]
        for key, value in values.items():
            for k, item in enumerate(value.tolist() if isinstance(value, np.ndarray) else [value]):
                union.set(keys.index(key), k, item, None)
        return union

    def native_unit(self, key: str) -> Callable[..., Any]:
        """A Python function with the signature of compiled code that calls a native unit."""
        return lambda rt, s, m, *atoms: rt.call_native(key, s, m, atoms)

    def run_unit(self, code: Callable[..., Any], instance: Composite, lanes: NDArray[np.int64]) -> None:
        """Run compiled code in some lanes."""
        code(self, instance, None if lanes.size == self.lanes else lanes)

    def call_native(self, key: str, instance: Any, m: Mask, atoms: tuple[Any, ...]) -> Any:
        """Call Python for a unit, in the active lanes."""
        return self.run_native(key, instance, all_lanes(self.lanes) if m is None else m, m, atoms)

    def access(self, variable: t.Variable, owner: Any, name: str, m: Mask) -> LaneAccess:
        """How native code gets at an attribute that holds a variable."""
        return LaneAccess(self, variable, owner, name, m)


class LaneAccess(Access):
    """A variable of an instance holds all lanes, an argument or result only the active ones."""

    def __init__(self, rt: LaneRuntime, variable: t.Variable, owner: Any, name: str, m: Mask) -> None:
        self._rt, self._variable, self._owner, self._name, self._m = rt, variable, owner, name, m
        self._count = rt.lanes if m is None else m.size
        self._is_slot = isinstance(owner, Composite)

    def get(self) -> Any:
        """The variable as arrays of the active lanes; arrays and pointers as something to read and write."""
        value, type_ = getattr(self._owner, self._name), self._variable.type
        if isinstance(type_, PointerType) or isinstance(value, LaneArray):
            return None if value is None else LanePointer(value, self._m, self._count)
        if not isinstance(type_, Elementary | EnumType):
            return value
        if self._variable.section is t.Section.IN_OUT:
            value = value.get(self._m)
        elif self._is_slot:
            value = ld(value, self._m)
        return as_lanes(value, self._count, storage_type(type_).dtype)

    def set(self, values: Any) -> None:
        """Assign the variable in the active lanes."""
        dtype = storage_type(self._variable.type).dtype
        new, old = as_lanes(values, self._count, dtype), getattr(self._owner, self._name)
        if self._variable.section is t.Section.IN_OUT:
            old.set(new, self._m)
        else:
            setattr(self._owner, self._name, put(old, new, self._m, self._rt.lanes, dtype) if self._is_slot else new)


class LanePointer:
    """A variable or array of the project in native code."""

    def __init__(self, target: Any, m: Mask, count: int) -> None:
        self._target, self._m, self._count = target, m, count

    def read(self) -> Any:
        """The variable, shape (lanes,), or the array, shape (lanes, elements), in the active lanes."""
        if not isinstance(self._target, LaneArray):
            value = self._target.get(self._m)
            return np.broadcast_to(np.asarray(value), (self._count,)).copy()
        data = self._target.data
        if data.ndim == 1:
            return np.tile(data, (self._count, 1))
        return own(data.T if self._m is None else data.T[self._m])

    def write(self, values: Any) -> None:
        """Assign the active lanes."""
        if not isinstance(self._target, LaneArray):
            self._target.set(np.broadcast_to(np.asarray(values), (self._count,)).copy(), self._m)
            return
        self._target.widen()
        rows = np.broadcast_to(values, (self._count, self._target.data.shape[0]))
        self._target.data[:, slice(None) if self._m is None else self._m] = rows.T
