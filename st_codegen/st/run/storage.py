"""Memory of the lane machine: how a variable holds one value for each lane, or one value for all of them.

A scalar is either a Python value, equal in all lanes, or an array of length `lanes`. Code runs on a set of active
lanes `m`: None for all of them, else their sorted numbers. A value computed by code has one entry for each active
lane. Arrays in variables belong to that variable alone, so that a few lanes can be written in place.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.check.arithmetic import INDEX, Fault
from st_codegen.st.run.runtime import Composite
from st_codegen.st.types import Elementary, EnumType, PointerType, storage_type

# What generated code refers to
__all__ = [
    "EMPTY",
    "ElementReference",
    "SlotReference",
    "UnionReference",
    "assign",
    "ix",
    "join",
    "join_all",
    "ld",
    "only",
    "own",
    "put",
    "split",
    "spread",
    "tab",
]
Array = NDArray[Any]
Mask = NDArray[np.int64] | None
ndarray = np.ndarray
# No lane at all; compared by identity
EMPTY: NDArray[np.int64] = np.empty(0, np.int64)


@cache
def all_lanes(lanes: int) -> NDArray[np.int64]:
    """The numbers of all lanes."""
    numbers = np.arange(lanes)
    numbers.flags.writeable = False
    return numbers


def ld(x: Any, m: Mask) -> Any:
    """A variable in the active lanes."""
    if m is None or type(x) is not ndarray:
        return x
    return x.take(m)


def own(value: Any) -> Any:
    """A value that no variable holds."""
    return value.copy() if type(value) is ndarray else value


def _is_same(old: Any, new: Any) -> bool:
    """Whether two single values have the same bits."""
    if type(old) is float:
        return bool(old == new) and math.copysign(1.0, old) == math.copysign(1.0, new)
    return bool(old == new)


def put(old: Any, value: Any, m: Mask, lanes: int, dtype: Any) -> Any:
    """A variable after the active lanes were assigned; the value must not belong to another variable."""
    if m is None:
        return value
    if type(old) is not ndarray:
        if type(value) is not ndarray and _is_same(old, value):
            return old
        full = np.empty(lanes, dtype)
        full[...] = old
        old = full
    old[m] = value
    return old


def spread(value: Any, m: Mask, lanes: int, dtype: Any) -> Any:
    """A value of the active lanes as a new variable; what other lanes get is never read."""
    if m is None or type(value) is not ndarray:
        return value
    full = np.zeros(lanes, dtype)
    full[m] = value
    return full


def split(m: Mask, c: Any) -> tuple[Mask, Mask]:
    """The active lanes where a condition holds, and the others."""
    if c is True:
        return m, EMPTY
    if c is False:
        return EMPTY, m
    count = np.count_nonzero(c)
    if count == c.size:
        return m, EMPTY
    if count == 0:
        return EMPTY, m
    yes, no = c.nonzero()[0], (~c).nonzero()[0]
    return (yes, no) if m is None else (m.take(yes), m.take(no))


def only(m: Mask, c: Any) -> Mask:
    """The active lanes where a condition holds."""
    if c is True:
        return m
    if c is False:
        return EMPTY
    count = np.count_nonzero(c)
    if count == c.size:
        return m
    if count == 0:
        return EMPTY
    yes: NDArray[np.int64] = c.nonzero()[0]
    return yes if m is None else m.take(yes)


def join(a: Mask, b: Mask, lanes: int) -> Mask:
    """The lanes of two disjoint sets."""
    if a is EMPTY:
        return b
    if b is EMPTY or a is None or b is None:
        return a
    if a.size + b.size == lanes:
        return None
    both = np.concatenate((a, b))
    both.sort(kind="stable")
    return both


def join_all(parts: list[Mask], lanes: int) -> Mask:
    """The lanes of disjoint sets; EMPTY when there is none."""
    result: Mask = EMPTY
    for part in parts:
        result = join(result, part, lanes)
    return result


def ix(i: Any, lower: int, size: int) -> Any:
    """An index counted from zero, checked against the bounds."""
    if type(i) is not ndarray:
        k = i - lower
        if not 0 <= k < size:
            raise Fault(INDEX, (i,), f"{i} is outside of {lower}..{lower + size - 1}")
        return k
    k = i.astype(np.int64)
    if lower:
        k -= lower
    if k.view(np.uint64).max() >= size:
        wrong = int(np.flatnonzero((k < 0) | (k >= size))[0])
        raise Fault(INDEX, (int(i[wrong]),), f"{i[wrong]} is outside of {lower}..{lower + size - 1}", wrong)
    return k


def tab(table: Array, k: Any) -> Any:
    """An element of a constant table."""
    # The index is in range already; of take's modes this one is the fastest
    return table.item(k) if type(k) is not ndarray else table.take(k, mode="wrap")


class LaneArray:
    """An array of elementary values, flat: `data` has shape (size,) while equal in all lanes, else (size, lanes)."""

    __slots__ = ("data", "lanes")

    def __init__(self, data: Array, lanes: int) -> None:
        self.data = data
        self.lanes = lanes

    def get(self, k: Any, m: Mask) -> Any:
        """Elements by a checked index."""
        data = self.data
        if data.ndim == 1:
            return tab(data, k)
        if type(k) is not ndarray:
            row = data[k]
            return row if m is None else row.take(m)
        flat = k * self.lanes
        flat += all_lanes(self.lanes) if m is None else m
        return data.reshape(-1).take(flat, mode="wrap")

    def set(self, k: Any, value: Any, m: Mask) -> None:
        """Assign elements."""
        if self.data.ndim == 1:
            if m is None and type(k) is not ndarray and type(value) is not ndarray:
                self.data[k] = value
                return
            self.widen()
        if m is None:
            self.data[k, slice(None) if type(k) is not ndarray else all_lanes(self.lanes)] = value
        else:
            self.data[k, m] = value

    def widen(self) -> None:
        """Hold one value for each lane."""
        if self.data.ndim == 1:
            self.data = np.repeat(self.data[:, None], self.lanes, axis=1)

    def assign(self, other: LaneArray, m: Mask) -> None:
        """Copy another array of the same size."""
        if m is None:
            self.data = other.data.copy()
            return
        self.widen()
        self.data[:, m] = other.data[:, None] if other.data.ndim == 1 else other.data[:, m]

    def clone(self) -> LaneArray:
        """A copy with memory of its own."""
        return LaneArray(self.data.copy(), self.lanes)


class LaneUnion:
    """Fields over the same bytes: `data` has shape (1, bytes) while equal in all lanes, else (lanes, bytes).

    `layout` gives for each field its dtype and the number of elements, None for a single value.
    """

    __slots__ = ("data", "lanes", "layout")

    def __init__(self, layout: tuple[tuple[np.dtype[Any], int | None], ...], lanes: int) -> None:
        # A multiple of eight bytes lets every field be seen as a row of its own type
        size = max(dtype.itemsize * (count or 1) for dtype, count in layout)
        self.layout = layout
        self.lanes = lanes
        self.data: Array = np.zeros((1, -(-size // 8) * 8), np.uint8)

    def get(self, number: int, k: Any, m: Mask) -> Any:
        """A field, or the elements `k` of a field that is an array."""
        dtype, _ = self.layout[number]
        view = self.data.view(dtype)
        if view.shape[0] == 1 and type(k) is not ndarray:
            return _quiet(view[:, k]).item()
        if view.shape[0] == 1:
            return _quiet(view[0].take(k))
        rows = slice(None) if m is None else m
        if type(k) is ndarray and m is None:
            rows = all_lanes(self.lanes)
        return _quiet(view[rows, k].copy())

    def set(self, number: int, k: Any, value: Any, m: Mask) -> None:
        """Assign a field, or elements of one."""
        dtype, _ = self.layout[number]
        is_single = type(k) is not ndarray and type(value) is not ndarray
        if self.data.shape[0] == 1 and not (m is None and is_single):
            self.data = np.repeat(self.data, self.lanes, axis=0)
        view = self.data.view(dtype)
        rows: Any = slice(None) if m is None else m
        if type(k) is ndarray and m is None:
            rows = all_lanes(self.lanes)
        view[rows, k] = value

    def assign(self, other: LaneUnion, m: Mask) -> None:
        """Copy another union of the same type."""
        if m is None:
            self.data = other.data.copy()
            return
        if self.data.shape[0] == 1:
            self.data = np.repeat(self.data, self.lanes, axis=0)
        self.data[m] = other.data if other.data.shape[0] == 1 else other.data[m]

    def clone(self) -> LaneUnion:
        """A copy with memory of its own."""
        copy = LaneUnion(self.layout, self.lanes)
        copy.data = self.data.copy()
        return copy


def _quiet(values: Array) -> Array:
    """Bits read as REAL become a quiet NaN where they are a signalling one, as any copy through LREAL does."""
    if values.dtype == np.float32 and np.isnan(values).any():
        bits = values.view(np.uint32)
        return np.where(np.isnan(values), bits | np.uint32(1 << 22), bits).astype(np.uint32).view(np.float32)
    return values


class LaneStruct(Composite):
    """A structure or an instance of a block."""

    __slots__ = ()

    def assign(self, other: LaneStruct, m: Mask, lanes: int) -> None:
        """Copy another structure of the same type."""
        for name in self.fields:
            value, type_ = getattr(other, name), self.field_types[name]
            if isinstance(type_, Elementary | EnumType):
                mine = getattr(self, name)
                setattr(self, name, put(mine, own(ld(value, m)), m, lanes, storage_type(type_).dtype))
            elif isinstance(type_, PointerType):
                setattr(self, name, value)
            else:
                assign(getattr(self, name), value, m, lanes)


def assign(target: Any, source: Any, m: Mask, lanes: int) -> None:
    """Copy a structure, union or array in the active lanes."""
    if target is source:
        return
    if isinstance(target, list):
        for inner, other in zip(target, source, strict=True):
            assign(inner, other, m, lanes)
    elif isinstance(target, LaneStruct):
        target.assign(source, m, lanes)
    else:
        target.assign(source, m)


class Reference(Protocol):
    """What a VAR_IN_OUT of an elementary type refers to."""

    def get(self, m: Mask) -> Any:
        """The value in the active lanes."""

    def set(self, value: Any, m: Mask) -> None:
        """Assign the active lanes."""


class SlotReference:
    """A reference to a variable or field."""

    __slots__ = ("dtype", "lanes", "name", "owner")

    def __init__(self, owner: Any, name: str, lanes: int, dtype: Any) -> None:
        self.owner = owner
        self.name = name
        self.lanes = lanes
        self.dtype = dtype

    def get(self, m: Mask) -> Any:
        """The value in the active lanes."""
        return ld(getattr(self.owner, self.name), m)

    def set(self, value: Any, m: Mask) -> None:
        """Assign the active lanes."""
        setattr(self.owner, self.name, put(getattr(self.owner, self.name), value, m, self.lanes, self.dtype))


class ElementReference:
    """A reference to an element of an array, which may be another one in each lane."""

    __slots__ = ("array", "k")

    def __init__(self, array: LaneArray, k: Any, m: Mask) -> None:
        self.array = array
        self.k = spread(k, m, array.lanes, np.int64)

    def get(self, m: Mask) -> Any:
        """The value in the active lanes."""
        return self.array.get(ld(self.k, m), m)

    def set(self, value: Any, m: Mask) -> None:
        """Assign the active lanes."""
        self.array.set(ld(self.k, m), value, m)


class UnionReference:
    """A reference to a field of a union, or to an element of such a field."""

    __slots__ = ("k", "number", "union")

    def __init__(self, union: LaneUnion, number: int, k: Any, m: Mask) -> None:
        self.union = union
        self.number = number
        self.k = spread(k, m, union.lanes, np.int64)

    def get(self, m: Mask) -> Any:
        """The value in the active lanes."""
        return self.union.get(self.number, ld(self.k, m), m)

    def set(self, value: Any, m: Mask) -> None:
        """Assign the active lanes."""
        self.union.set(self.number, ld(self.k, m), value, m)
