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
#: Standard functions that are one operation each; those that are not named are an INTEGER
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
    "SEL": Operation.SELECT,
}


def no_counts() -> Counts:
    """A vector of counts in which every operation is counted zero times."""
    return np.zeros(len(Operation), np.int64)


def position(operation: Operation) -> int:
    """Where an operation stands in a vector of counts."""
    return _POSITION[operation]


def as_mapping(counts: Counts) -> dict[str, int]:
    """The counts that are not zero, by the names of the operations."""
    return {operation.value: int(counts[number]) for operation, number in _POSITION.items() if counts[number]}


def weighted(counts: Counts, weights: Mapping[Operation, float]) -> float:
    """The sum of counts times weights."""
    return float(sum(int(counts[number]) * weights[operation] for operation, number in _POSITION.items()))


def of_expression(node: t.Expression) -> tuple[Operation, ...]:  # noqa: PLR0911 - one return a case
    """What an operator, conversion or standard function does itself, its operands left out."""
    match node:
        case t.Unary():
            return (Operation.INTEGER,)
        case t.Binary(operator=operator):
            return (_REAL[operator] if node.type.is_real else _INTEGRAL.get(operator, Operation.INTEGER),)
        case t.ShortCircuit():
            return (Operation.BRANCH,)
        case t.Comparison(left=left):
            return (Operation.REAL_COMPARE if left.type.is_real else Operation.COMPARE,)
        case t.Conversion(operand=operand):  # between integers it is a move
            return (Operation.CONVERT if node.type.is_real or operand.type.is_real else Operation.INTEGER,)
        case t.StandardCall(function=function, arguments=arguments):
            if function in ("MIN", "MAX", "LIMIT", "MUX"):
                return (Operation.SELECT,) * max(len(arguments) - 1, 1)
            return (_FUNCTIONS.get(function, Operation.INTEGER),)
        case _:
            return ()


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
