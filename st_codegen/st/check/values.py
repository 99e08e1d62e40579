"""Constant values of every type: what initialises a variable."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.check.types import ArrayType, BlockType, Elementary, EnumType, Kind, PointerType, Type

Scalar = bool | int | float | str | None
# An elementary array is a flat read-only ndarray, an array of anything else a flat list, a structure or a block a
# dictionary by upper-case field name (for a block only what differs from its own initial values); None is no pointer.
Value = Scalar | NDArray[np.generic] | list["Value"] | dict[str, "Value"]


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
    """A flat array of one elementary value."""
    table = np.full(type_.size, value, dtype=storage_type(type_.element).dtype)
    table.flags.writeable = False
    return table
