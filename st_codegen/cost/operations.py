"""What a controller does, in classes that cost about the same."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st import tree as t
from st_codegen.st.types import ArrayType, BlockType, Elementary, EnumType, StructType, Type

Counts = NDArray[np.int64]


class Operation(Enum):
    """One class of machine work; a profile gives each its cycles.

    The classes follow what a compiler without registers across statements emits, as the ones of controllers do: every
    read of a variable is a LOAD, every assignment a STORE, and every index an INDEX (multiply and add of an address).
    LOOP is one round of FOR: count, compare, jump.
    """

    LOAD = "load"
    STORE = "store"
    INDEX = "index"
    INTEGER = "integer"
    INTEGER_MULTIPLY = "integer_multiply"
    INTEGER_DIVIDE = "integer_divide"
    COMPARE = "compare"
    REAL_COMPARE = "real_compare"
    ADD = "add"
    MULTIPLY = "multiply"
    DIVIDE = "divide"
    SELECT = "select"
    CONVERT = "convert"
    SQRT = "sqrt"
    EXP = "exp"
    LN = "ln"
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ATAN = "atan"
    POWER = "power"
    BRANCH = "branch"
    LOOP = "loop"
    CALL = "call"
    NATIVE = "native"


_POSITION = {operation: number for number, operation in enumerate(Operation)}

_REAL = {"ADD": Operation.ADD, "SUB": Operation.ADD, "MUL": Operation.MULTIPLY, "DIV": Operation.DIVIDE}
_INTEGRAL = {
    "MUL": Operation.INTEGER_MULTIPLY,
    "DIV": Operation.INTEGER_DIVIDE,
    "MOD": Operation.INTEGER_DIVIDE,
}
#: Standard functions that are one operation each
_FUNCTIONS = {
    "SQRT": Operation.SQRT,
    "EXP": Operation.EXP,
    "LN": Operation.LN,
    "LOG": Operation.LN,
    "SIN": Operation.SIN,
    "COS": Operation.COS,
    "TAN": Operation.TAN,
    "ATAN": Operation.ATAN,
    "ATAN2": Operation.ATAN,
    "ASIN": Operation.ATAN,
    "ACOS": Operation.ATAN,
    "EXPT": Operation.POWER,
    "TRUNC": Operation.CONVERT,
}


def no_counts() -> Counts:
    """All zero."""
    return np.zeros(len(Operation), np.int64)


def position(operation: Operation) -> int:
    """Where an operation stands in a vector of counts."""
    return _POSITION[operation]


def as_mapping(counts: Counts) -> dict[str, int]:
    """The counts that are not zero, by name."""
    return {operation.value: int(counts[number]) for operation, number in _POSITION.items() if counts[number]}


def weighted(counts: Counts, weights: Mapping[Operation, float]) -> float:
    """The sum of counts times weights."""
    return float(sum(int(counts[number]) * weights[operation] for operation, number in _POSITION.items()))


def is_real(type_: Type) -> bool:
    """REAL or LREAL."""
    return isinstance(type_, Elementary) and type_.is_real


def of_binary(node: t.Binary) -> Operation:
    """The class of an arithmetic or logical operator."""
    return _REAL[node.operator] if is_real(node.type) else _INTEGRAL.get(node.operator, Operation.INTEGER)


def of_comparison(node: t.Comparison) -> Operation:
    """The class of a comparison."""
    return Operation.REAL_COMPARE if is_real(node.left.type) else Operation.COMPARE


def of_conversion(node: t.Conversion) -> Operation:
    """The class of a change of type; between integers it is a move."""
    return Operation.CONVERT if is_real(node.type) or is_real(node.operand.type) else Operation.INTEGER


def of_function(node: t.StandardCall) -> tuple[Operation, int]:
    """The class of a standard function, and how many of it a call is."""
    if node.function in _FUNCTIONS:
        return _FUNCTIONS[node.function], 1
    if node.function in ("MIN", "MAX"):
        return Operation.SELECT, len(node.arguments) - 1
    if node.function in ("LIMIT", "MUX"):
        return Operation.SELECT, max(len(node.arguments) - 1, 1)
    if node.function == "SEL":
        return Operation.SELECT, 1
    return Operation.INTEGER, 1


def size_of(type_: Type, blocks: Mapping[str, t.Pou]) -> int:
    """Bytes of a value; a BOOL takes one, padding is not counted. Blocks are found by key in `blocks`."""
    if isinstance(type_, Elementary):
        return max(type_.bits // 8, 1)
    if isinstance(type_, EnumType):
        return size_of(type_.base, blocks)
    if isinstance(type_, ArrayType):
        return type_.size * size_of(type_.element, blocks)
    if isinstance(type_, StructType):
        sizes = [size_of(field.type, blocks) for field in type_.fields]
        return max(sizes, default=0) if type_.is_union else sum(sizes)
    if isinstance(type_, BlockType):
        pou: Any = blocks.get(type_.name.upper())
        return 0 if pou is None else sum(size_of(v.type, blocks) for v in pou.variables if not v.is_constant)
    return 8
