"""What a variable of the executed text can hold, beside numbers, values on an axis, lanes and terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from st_codegen.proof.prove.axis import AxisValue
from st_codegen.proof.prove.errors import NotProvedError

#: A plain number or truth value, an AxisValue, Lanes, Slots, a Term, or one of the classes below.
Value = object


class ComputedError(NotProvedError):
    """A decision on a computed number: boxes of inputs do not decide it, terms may."""


class Absent(Enum):
    """What a variable holds that has no value: it is what an earlier call left, or a counter behind its loop."""

    NOTHING = "not assigned by this call"
    LOST = "read by nobody"


NOTHING, LOST = Absent


@dataclass(frozen=True)
class Kept:
    """The value of an output before the call."""

    name: str


@dataclass(frozen=True, eq=False)
class All:
    """Truth values of different inputs, all of which must hold."""

    parts: Mapping[int, AxisValue]


@dataclass(frozen=True)
class Bits:
    """The bits of a float64 value; `magnitude`: without the sign."""

    value: Any
    magnitude: bool = False


@dataclass(frozen=True)
class Conditional:
    """`value` where a condition on several inputs holds, else `otherwise`."""

    condition: object
    value: object
    otherwise: object


def is_scalar(value: Value) -> bool:
    """Whether a value is a plain number or truth value."""
    return isinstance(value, bool | int | float)


def by_input(condition: Value) -> dict[int, AxisValue]:
    """The parts of a condition by the number of the input that each one asks about; none of one that always holds."""
    if condition is True:
        return {}
    if isinstance(condition, AxisValue):
        return {condition.axis.feature: condition}
    if isinstance(condition, All):
        return dict(condition.parts)
    raise NotProvedError("a condition that does not ask about inputs one by one is not followed")
