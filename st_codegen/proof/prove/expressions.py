"""Floating point expressions of the text and of the model, each kept once: two that are equal are one object.

Additions and all other operations are kept in their order; nothing is regrouped. Constants are folded as the controller
would compute them. One rule of arithmetic is used: x + 0.0 is x unless x may be -0.0, and x + -0.0 is x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from st_codegen.proof.prove.axis import (
    NotProvedError,
)

_LARGEST = float(np.finfo(np.float64).max)


@dataclass(frozen=True, eq=False)
class ExpressionNode:
    """`operation` on `arguments`; leaves have a `key` instead.

    `minus_zero`: whether the value can be -0.0; `single`: whether it is a float32 number for sure.
    """

    operation: str
    arguments: tuple[ExpressionNode, ...] = ()
    key: object = None
    minus_zero: bool = True
    single: bool = False

    @property
    def is_constant(self) -> bool:
        return self.operation == "const"

    @property
    def number(self) -> float:
        """The value of a constant."""
        assert isinstance(self.key, float)
        return self.key


def compute(operation: str, *values: float) -> float:
    """One operation on numbers, rounded to nearest. Raises NotProvedError where it would stop a controller."""
    with np.errstate(all="ignore"):
        x = [np.float64(value) for value in values]
        if operation in ("add", "sub", "mul", "div"):
            symbol = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide}[operation]
            result = float(symbol(x[0], x[1]))
        elif operation in ("min", "max"):
            result = float(min(values) if operation == "min" else max(values))
        elif operation == "neg":
            result = -values[0]
        elif operation == "abs":
            result = abs(values[0])
        elif operation == "single":
            result = float(np.float32(values[0]))
        else:
            raise NotProvedError(f"{operation} of a constant")
    if not math.isfinite(result) and all(map(math.isfinite, values)):
        raise NotProvedError(f"the operation {operation} overflows")
    return result


class Pool:
    """All expressions of one proof."""

    def __init__(self) -> None:
        self._nodes: dict[object, ExpressionNode] = {}

    def constant(self, value: float) -> ExpressionNode:
        """A number."""
        value = float(value)
        name = ("const", value.hex())
        with np.errstate(over="ignore"):
            single = float(np.float32(value)) == value
        negative = value == 0 and math.copysign(1, value) < 0
        return self._nodes.setdefault(name, ExpressionNode("const", (), value, negative, single))

    def leaf(self, *key: object, minus_zero: bool = True, single: bool = False) -> ExpressionNode:
        """Something that is known by a key: a tree of the model, an input."""
        return self._nodes.setdefault(("leaf", key), ExpressionNode("leaf", (), key, minus_zero, single))

    def make(self, operation: str, *arguments: ExpressionNode) -> ExpressionNode:
        """An operation on expressions."""
        if all(argument.is_constant for argument in arguments) and operation != "if":
            return self.constant(compute(operation, *(argument.number for argument in arguments)))
        if operation == "add":
            for one, other in (arguments, arguments[::-1]):
                if one.is_constant and one.number == 0 and (one.minus_zero or not other.minus_zero):
                    return other
        if operation in ("min", "max"):
            # the largest number is where a running minimum starts: it is never the result
            start = _LARGEST if operation == "min" else -_LARGEST
            for one, other in (arguments, arguments[::-1]):
                if one.is_constant and one.number == start:
                    return other
        if operation == "single" and arguments[0].single:
            return arguments[0]
        name = (operation, *map(id, arguments))
        return self._nodes.setdefault(name, ExpressionNode(operation, arguments, None, *_facts(operation, arguments)))


def _facts(operation: str, arguments: tuple[ExpressionNode, ...]) -> tuple[bool, bool]:
    """Whether a result can be -0.0, and whether it is a float32 number for sure."""
    if operation == "add":
        return all(argument.minus_zero for argument in arguments), False
    if operation in ("min", "max"):
        return any(a.minus_zero for a in arguments), all(a.single for a in arguments)
    if operation == "single":
        below = arguments[0]
        # a sum of float32 numbers is zero or a float32 number at least: rounding it makes no zero
        exact = below.operation == "add" and all(argument.single for argument in below.arguments)
        return below.minus_zero if exact else True, True
    return True, False
