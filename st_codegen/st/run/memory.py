"""Records of many rows in one piece of memory, and the way of Python values into and out of them."""

from __future__ import annotations

import contextlib
import mmap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import counted
from st_codegen.st.errors import StUsageError
from st_codegen.st.run.layout import MemoryLayout, aligned, dtype_of
from st_codegen.st.run.natives import NativeBlock
from st_codegen.st.types import ArrayType, Elementary, EnumType, Kind, StructType, Type, storage_type

Values = NDArray[Any]
#: Gives the values at an offset: of a type of NumPy, in a shape, the rows first.
Reader = Callable[[int, "np.dtype[Any]", tuple[int, ...]], Values]


#: What an operating system gives at once, bytes.
_PAGE = 4096
#: Bytes of records from which on it matters in what pages they are.
_LARGE = 64_000_000


@dataclass(frozen=True)
class CompiledUnit:
    """Where a unit begins, and the seconds of compiling it, with what it calls as far as that was not compiled yet."""

    address: int
    seconds: float


class Memory:
    """The variables of each row, one record of bytes a row; `natives`: Python objects of native blocks, by offset."""

    def __init__(self, rows: int, image: bytes) -> None:
        padded = np.frombuffer(image + bytes(aligned(max(len(image), 1), 16) - len(image)), np.uint8)
        # memory that nobody touches costs nothing: arrays of zeros, such as a ring of samples, are not written
        self.bytes = _zeros(rows, len(padded))
        for part in _filled(padded):
            self.bytes[:, part] = padded[part]
        self.address = self.bytes.ctypes.data
        self.stride = len(padded)
        self.natives: dict[int, NativeBlock] = {}

    def view(self, offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Values:
        """The memory itself, as values."""
        return view(self.bytes, offset, dtype, shape)

    def addresses(self) -> NDArray[np.uint64]:
        """Where the record of each row is."""
        return np.uint64(self.address) + np.arange(len(self.bytes), dtype=np.uint64) * np.uint64(self.stride)


def _zeros(rows: int, size: int) -> NDArray[np.uint8]:
    """Records of zeros; large ones in small pages, since a large page is memory as soon as one byte is written."""
    if rows * size < _LARGE or not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros((rows, size), np.uint8)
    memory = mmap.mmap(-1, rows * size)
    with contextlib.suppress(OSError):  # a system without large pages
        memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, np.uint8).reshape(rows, size)


def _filled(image: NDArray[np.uint8]) -> Iterator[slice]:
    """The parts of a record that are not zero, those less than a page apart together."""
    places = np.flatnonzero(image)
    if len(places):
        gaps = np.flatnonzero(np.diff(places) > _PAGE)
        begins = places[np.concatenate([[0], gaps + 1])]
        ends = places[np.concatenate([gaps, [len(places) - 1]])]
        yield from (slice(int(begin), int(end) + 1) for begin, end in zip(begins, ends, strict=True))


def view(rows: NDArray[np.uint8], offset: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Values:
    """Values at an offset of records: the memory itself, rows first."""
    inner = np.empty(shape, dtype).strides
    return np.ndarray((len(rows), *shape), dtype, rows, offset, (rows.strides[0], *inner))


def shown(layout: MemoryLayout, read: Reader, offset: int, type_: Type, is_plain: bool) -> Any:
    """A variable for the user: arrays with the rows first (plain: single values), dictionaries for structures."""
    if isinstance(type_, Elementary | EnumType):
        values = np.array(read(offset, dtype_of(type_), ()))
        return values[0].item() if is_plain else values
    if isinstance(type_, ArrayType):
        if isinstance(type_.element, Elementary | EnumType):
            values = np.array(read(offset, dtype_of(type_.element), type_.shape))
            return values[0] if is_plain else values
        step = layout.stride(type_)
        return [shown(layout, read, offset + k * step, type_.element, is_plain) for k in range(type_.size)]
    if isinstance(type_, StructType):
        members = layout.record(type_).members
        return {
            entry.name: shown(layout, read, offset + members[key].offset, entry.type, is_plain)
            for key, entry in type_.by_key.items()
        }
    raise StUsageError(f"{type_} has no value of its own: name a variable in it")


def given(value: Any, type_: Type, rows: int | None, path: str) -> Values:
    """A user's value for a variable, in a shape that broadcasts to all rows. Raises `StUsageError`."""
    is_array = isinstance(type_, ArrayType) and isinstance(type_.element, Elementary | EnumType)
    if not is_array and not isinstance(type_, Elementary | EnumType):
        raise StUsageError(f"'{path}' is {type_}: set its parts one by one")
    shape = type_.shape if isinstance(type_, ArrayType) else ()
    try:
        numbers = checked_numbers(value, storage_type(type_.element if isinstance(type_, ArrayType) else type_))
        if numbers.shape in (shape, (rows or 1, *shape)) or (rows is None and not shape and numbers.size == 1):
            return numbers if numbers.shape != (1,) or shape else numbers.reshape(())
        expected = str(shape) if rows is None else f"{shape} or {(rows, *shape)}"
        raise ValueError(f"shape {numbers.shape}, expected {expected}")
    except (ValueError, OverflowError, TypeError) as error:
        raise StUsageError(f"'{path}' : {type_}: {error}") from None


def checked_numbers(value: Any, type_: Elementary) -> Values:
    """A user's value in the type of a variable; nothing is rounded or wrapped on the way, except to REAL.

    Raises `ValueError`.
    """
    is_text = type_.kind is Kind.STRING
    numbers = np.asarray(value, dtype=object if is_text else None)
    if is_text:
        if not all(isinstance(text, str) and len(text) <= type_.bits for text in numbers.flat):
            raise ValueError(f"text of at most {counted(type_.bits, 'character')} is needed")
    elif type_.is_integral:
        is_whole = numbers.dtype.kind in "iu" or (
            numbers.dtype.kind == "O" and all(type(x) is int for x in numbers.flat)
        )
        if not is_whole:
            raise ValueError(f"integers are needed, not {numbers.dtype}")
        if numbers.size and not (type_.holds(int(numbers.min())) and type_.holds(int(numbers.max()))):
            raise ValueError(f"values outside of {type_.lower}..{type_.upper}")
    elif type_.is_real and numbers.dtype.kind not in "fiu":
        raise ValueError(f"numbers are needed, not {numbers.dtype}")
    elif not type_.is_real and numbers.dtype.kind != "b":
        raise ValueError(f"True or False is needed, not {numbers.dtype}")
    return np.array(numbers, dtype=dtype_of(type_))
