"""Which input's NaN reaches each column of each value."""

from __future__ import annotations

from collections.abc import Sequence

from st_codegen.ir.base import ColumnFunction, Operation
from st_codegen.ir.cells import Rank
from st_codegen.ir.operations import Select
from st_codegen.ir.trees import TreeEnsemble

#: For each column of a value the input that is missing where the column is; None where the column never is.
Origins = tuple[int | None, ...]


def origins_after(op: Operation, operands: Sequence[Origins]) -> Origins:
    """The origins of an operation's result.

    What mixes columns hands no missing value on: walkers refuse NaN in all that reaches it.
    """
    if isinstance(op, Select):
        joined = [column for operand in operands for column in operand]
        return tuple(joined[column] for column in op.columns)
    if isinstance(op, Rank | TreeEnsemble):
        return (None,) * op.width
    if isinstance(op, ColumnFunction):
        kept = op.keeps_missing
        return tuple(origin if kept is None or kept[column] else None for column, origin in enumerate(operands[0]))
    return operands[0] if op.width == len(operands[0]) else (None,) * op.width
