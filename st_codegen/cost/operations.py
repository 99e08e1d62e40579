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


class CostClass(Enum):
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


_POSITION = {operation: number for number, operation in enumerate(CostClass)}

_REAL = {
    "ADD": CostClass.ADD,
    "SUB": CostClass.ADD,
    "MUL": CostClass.MULTIPLY,
    "DIV": CostClass.DIVIDE,
}
_INTEGRAL = {
    "MUL": CostClass.INTEGER_MULTIPLY,
    "DIV": CostClass.INTEGER_DIVIDE,
    "MOD": CostClass.INTEGER_DIVIDE,
}
#: Standard functions that are one operation each; those that are not named are an INTEGER
_FUNCTIONS = {
    "SQRT": CostClass.SQRT,
    "EXP": CostClass.EXP,
    "LN": CostClass.LN,
    "LOG": CostClass.LN,
    "SIN": CostClass.SIN,
    "COS": CostClass.COS,
    "TAN": CostClass.TAN,
    "ATAN": CostClass.ATAN,
    "ATAN2": CostClass.ATAN,
    "ASIN": CostClass.ATAN,
    "ACOS": CostClass.ATAN,
    "EXPT": CostClass.POWER,
    "TRUNC": CostClass.CONVERT,
    "SEL": CostClass.SELECT,
}


def no_counts() -> Counts:
    """A vector of counts in which every operation is counted zero times."""
    return np.zeros(len(CostClass), np.int64)


def position(operation: CostClass) -> int:
    """Where an operation stands in a vector of counts."""
    return _POSITION[operation]


def as_mapping(counts: Counts) -> dict[str, int]:
    """The counts that are not zero, by the names of the operations."""
    return {operation.value: int(counts[number]) for operation, number in _POSITION.items() if counts[number]}


def weighted(counts: Counts, weights: Mapping[CostClass, float]) -> float:
    """The sum of counts times weights."""
    return float(sum(int(counts[number]) * weights[operation] for operation, number in _POSITION.items()))


def of_expression(node: t.Expression) -> tuple[CostClass, ...]:  # noqa: PLR0911 - one return a case
    """What an operator, conversion or standard function does itself, its operands left out."""
    match node:
        case t.Unary():
            return (CostClass.INTEGER,)
        case t.Binary(operator=operator):
            return (_REAL[operator] if node.type.is_real else _INTEGRAL.get(operator, CostClass.INTEGER),)
        case t.ShortCircuit():
            return (CostClass.BRANCH,)
        case t.Compare(left=left):
            return (CostClass.REAL_COMPARE if left.type.is_real else CostClass.COMPARE,)
        case t.Conversion(operand=operand):  # between integers it is a move
            return (CostClass.CONVERT if node.type.is_real or operand.type.is_real else CostClass.INTEGER,)
        case t.StandardCall(function=function, arguments=arguments):
            if function in ("MIN", "MAX", "LIMIT", "MUX"):
                return (CostClass.SELECT,) * max(len(arguments) - 1, 1)
            return (_FUNCTIONS.get(function, CostClass.INTEGER),)
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
