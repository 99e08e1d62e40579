"""The types of Structured Text and the values that variables of them have."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from math import prod
from typing import cast

import numpy as np
from numpy.typing import NDArray

Scalar = bool | int | float | str | None
# An elementary array is a flat read-only ndarray, an array of anything else a flat list, a structure or a block a
# dictionary by upper-case field name (for a block only what differs from its own initial values); None is no pointer.
Value = Scalar | NDArray[np.generic] | list["Value"] | dict[str, "Value"]


class Kind(Enum):
    """The groups that elementary types belong to."""

    BOOL = "BOOL"
    BITS = "ANY_BIT"
    SIGNED = "signed integer"
    UNSIGNED = "unsigned integer"
    REAL = "ANY_REAL"
    TIME = "duration"
    STRING = "ANY_STRING"
    UNTYPED_INTEGER = "integer literal"
    UNTYPED_REAL = "real literal"
    COMPOUND = "not elementary"
    UNKNOWN = "not known before the check"


class AnyType:
    """What may be asked of every type."""

    kind: Kind = Kind.COMPOUND

    @property
    def is_integer(self) -> bool:
        """Whether it is one of SINT to ULINT; bit strings are not."""
        return self.kind in (Kind.SIGNED, Kind.UNSIGNED)

    @property
    def is_integral(self) -> bool:
        """Whether it is an integer in memory: integers, bit strings and durations are."""
        return self.kind in (Kind.SIGNED, Kind.UNSIGNED, Kind.BITS, Kind.TIME)

    @property
    def is_real(self) -> bool:
        """Whether it is REAL or LREAL."""
        return self.kind is Kind.REAL

    @property
    def is_untyped(self) -> bool:
        """Whether it is the type of a literal that takes on the type its context asks for."""
        return self.kind in (Kind.UNTYPED_INTEGER, Kind.UNTYPED_REAL)


@dataclass(frozen=True)
class Elementary(AnyType):
    """An elementary type; `bits` is its size, for strings the number of characters it can hold."""

    name: str
    kind: Kind = field()
    bits: int

    def __str__(self) -> str:
        return self.name

    @property
    def is_signed(self) -> bool:
        """Whether negative values exist; durations of TwinCAT have none."""
        return self.kind is Kind.SIGNED or self is TIME_NS

    @cached_property
    def lower(self) -> int:
        """The smallest value of an integral type."""
        return -(1 << (self.bits - 1)) if self.is_signed else 0

    @cached_property
    def upper(self) -> int:
        """The largest value of an integral type."""
        return (1 << (self.bits - (1 if self.is_signed else 0))) - 1

    @cached_property
    def dtype(self) -> np.dtype[np.generic]:
        """The NumPy type that stores its values."""
        if self.kind is Kind.STRING:
            return np.dtype(object)
        if self.kind is Kind.BOOL:
            return np.dtype(np.bool_)
        if self.is_real:
            return np.dtype(f"f{self.bits // 8}")
        return np.dtype(f"{'i' if self.is_signed else 'u'}{self.bits // 8}")

    def holds(self, value: int) -> bool:
        """Whether an integral type has this value."""
        return self.lower <= value <= self.upper


def _make(kind: Kind, names: str) -> dict[str, Elementary]:
    return {name: Elementary(name, kind, bits) for name, bits in zip(names.split(), (8, 16, 32, 64), strict=True)}


BOOL = Elementary("BOOL", Kind.BOOL, 8)
REAL = Elementary("REAL", Kind.REAL, 32)
LREAL = Elementary("LREAL", Kind.REAL, 64)
# TwinCAT counts milliseconds in 32 bits; for portable text a signed count of nanoseconds is the common ground
TIME_MS = Elementary("TIME", Kind.TIME, 32)
TIME_NS = Elementary("TIME", Kind.TIME, 64)
LTIME = Elementary("LTIME", Kind.TIME, 64)
ANY_INT_LITERAL = Elementary("integer literal", Kind.UNTYPED_INTEGER, 0)
ANY_REAL_LITERAL = Elementary("real literal", Kind.UNTYPED_REAL, 0)
UNKNOWN = Elementary("unknown", Kind.UNKNOWN, 0)

NUMBERS: dict[str, Elementary] = {
    "BOOL": BOOL,
    **_make(Kind.BITS, "BYTE WORD DWORD LWORD"),
    **_make(Kind.SIGNED, "SINT INT DINT LINT"),
    **_make(Kind.UNSIGNED, "USINT UINT UDINT ULINT"),
    "REAL": REAL,
    "LREAL": LREAL,
}
INT, DINT, LINT, ULINT = (NUMBERS[name] for name in ("INT", "DINT", "LINT", "ULINT"))
UNSUPPORTED = frozenset(
    {"DATE", "TIME_OF_DAY", "TOD", "DATE_AND_TIME", "DT", "LDATE", "LTOD", "LDT"}
    | {"CHAR", "WCHAR", "ANY", "XINT", "UXINT", "XWORD"}
)
DEFAULT_STRING_LENGTH = 80


def string_type(length: int, wide: bool) -> Elementary:
    """The type STRING(length) or WSTRING(length)."""
    return Elementary(f"{'WSTRING' if wide else 'STRING'}({length})", Kind.STRING, length)


def nanoseconds_per_unit(type_: Elementary) -> int:
    """What one count of a duration type stands for."""
    return 1_000_000 if type_ is TIME_MS else 1


@dataclass(frozen=True)
class EnumType(AnyType):
    """An enumeration; `values` maps names, as declared, to numbers of the base type."""

    name: str
    base: Elementary
    values: tuple[tuple[str, int], ...]
    default: int

    def __str__(self) -> str:
        return self.name

    @cached_property
    def by_key(self) -> dict[str, int]:
        """The numbers of the values by upper-case name."""
        return {name.upper(): number for name, number in self.values}


@dataclass(frozen=True)
class ArrayType(AnyType):
    """`bounds` has the lower and upper bound of every dimension, both inclusive; row-major."""

    element: Type
    bounds: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        shown = ", ".join(f"{low}..{high}" for low, high in self.bounds)
        return f"ARRAY[{shown}] OF {self.element}"

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The number of elements in each dimension."""
        return tuple(high - low + 1 for low, high in self.bounds)

    @cached_property
    def size(self) -> int:
        """The number of elements in all dimensions together."""
        return prod(self.shape)


@dataclass(frozen=True)
class Field:
    """A field of a structure or union with its initial value."""

    name: str
    type: Type
    initial: Value = field(compare=False, hash=False)


@dataclass(frozen=True)
class StructType(AnyType):
    """A structure or, with `is_union`, fields that all start at the same byte. Two of them are equal by name."""

    name: str
    fields: tuple[Field, ...] = field(compare=False)
    is_union: bool = False

    def __str__(self) -> str:
        return self.name

    @cached_property
    def by_key(self) -> dict[str, Field]:
        """The fields by upper-case name."""
        return {entry.name.upper(): entry for entry in self.fields}


@dataclass(frozen=True)
class BlockType(AnyType):
    """A function block or program, by its name as declared; `ancestors` are the blocks it extends, nearest first."""

    name: str
    ancestors: tuple[str, ...] = ()

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class PointerType(AnyType):
    """`POINTER TO target`, or with `is_reference` REFERENCE TO; PVOID points at anything (target None)."""

    target: Type | None
    is_reference: bool = False

    def __str__(self) -> str:
        if self.target is None:
            return "PVOID"
        return f"{'REFERENCE' if self.is_reference else 'POINTER'} TO {self.target}"


Type = Elementary | EnumType | ArrayType | StructType | BlockType | PointerType


def default_value(type_: Type) -> Value:  # noqa: PLR0911 - one return a case
    """The initial value of a variable that has none of its own."""
    if isinstance(type_, Elementary):
        if type_.kind is Kind.BOOL:
            return False
        if type_.kind is Kind.STRING:
            return ""
        return 0.0 if type_.is_real else 0
    if isinstance(type_, EnumType):
        return type_.default
    if isinstance(type_, ArrayType):
        element = default_value(type_.element)
        if isinstance(type_.element, Elementary | EnumType):
            return filled_array(type_, element)
        return [element] * type_.size
    if isinstance(type_, BlockType | PointerType):
        return {} if isinstance(type_, BlockType) else None
    return {entry.name.upper(): entry.initial for entry in type_.fields}


def storage_type(type_: Type) -> Elementary:
    """The elementary type in which a scalar of this type is stored."""
    return type_.base if isinstance(type_, EnumType) else cast(Elementary, type_)


def filled_array(type_: ArrayType, value: Value) -> NDArray[np.generic]:
    """The value of an array whose elements are all the same."""
    table = np.full(type_.size, value, dtype=storage_type(type_.element).dtype)
    table.flags.writeable = False
    return table
