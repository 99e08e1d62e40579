"""The one table of what operations and comparisons do to numbers, by the names that the typed text and terms have.

Every part of a proof that computes takes them from here: on constants, on the ends of intervals, along a chain of
operations on an input, and on rows of inputs. Numbers are rounded to nearest, as controllers round them.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from st_codegen.ir.arrays import AnyArray, FloatArray, IntArray

#: Comparisons, what each is with its operands exchanged, and what it is where it does not hold.
COMPARE: MappingProxyType[str, Callable[..., AnyArray]] = MappingProxyType(
    {
        "LT": np.less,
        "LE": np.less_equal,
        "GT": np.greater,
        "GE": np.greater_equal,
        "EQ": np.equal,
        "NE": np.not_equal,
    }
)
FLIPPED = {"LT": "GT", "LE": "GE", "GT": "LT", "GE": "LE", "EQ": "EQ", "NE": "NE"}
NEGATED = {"LT": "GE", "LE": "GT", "GT": "LE", "GE": "LT", "EQ": "NE", "NE": "EQ"}

#: Operations on float64 numbers.
OPERATIONS: MappingProxyType[str, Callable[..., AnyArray]] = MappingProxyType(
    {
        "add": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "div": np.divide,
        "min": np.minimum,
        "max": np.maximum,
        "neg": np.negative,
        "abs": np.abs,
        "single": lambda x: np.asarray(x, np.float32).astype(np.float64),
        "exp": np.exp,
        "ln": np.log,
        "sqrt": np.sqrt,
        "sin": np.sin,
        "cos": np.cos,
        "atan": np.arctan,
    }
)

#: The bits of a float64 number without its sign, and those of infinity.
MAGNITUDE = 0x7FFF_FFFF_FFFF_FFFF
INFINITY = 0x7FF0_0000_0000_0000

#: One step of a chain of operations on an input: a name and its constant (0.0 where there is none). With an r in front
#: of the name the constant is the first operand.
Link = tuple[str, float]


def run_chain(chain: tuple[Link, ...], x: FloatArray) -> FloatArray:
    """The value of a chain for numbers `x` of its input."""
    with np.errstate(all="ignore"):
        for name, constant in chain:
            if name in ("neg", "abs", "single"):
                x = OPERATIONS[name](x)
            else:
                x = OPERATIONS[name](x, constant) if name in OPERATIONS else OPERATIONS[name[1:]](constant, x)
    return x


def bits(values: AnyArray) -> IntArray:
    """The bits of float64 numbers, which tell both zeros apart; integers as they are."""
    is_float = values.dtype == np.float64
    return np.ascontiguousarray(values).view(np.int64) if is_float else values.astype(np.int64)
