"""A block of a model whose numbers are REAL: the same listing with other types.

The model was made for it (`passes.real`), so that every number of its tables is a REAL already. What is left are the
types, the conversions to REAL, which are none any more, and the numbers that stand for missing and infinite ones.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection, Table
from st_codegen.emit.blocks.trees import LARGEST_THRESHOLD, MISSING_VALUE
from st_codegen.errors import DefectError
from st_codegen.ir import FLOAT32_OVERFLOW, FloatArray

_LARGEST = float(np.finfo(np.float32).max)
#: What is no number of the model, from so large on, and what stands for it; beyond the two of trees: no end.
_STAND_INS = (
    (1e307, _LARGEST),
    (MISSING_VALUE, float(np.float32(3.4e38))),
    (LARGEST_THRESHOLD, float(np.float32(3e38))),
)


def in_real_types(block: Block) -> Block:
    """The block with REAL in place of LREAL."""
    return dataclasses.replace(
        block,
        inputs=tuple(map(_variable, block.inputs)),
        outputs=tuple(map(_variable, block.outputs)),
        variables=tuple(map(_variable, block.variables)),
        constants=tuple(map(_variable, block.constants)),
        tables=tuple(map(_table, block.tables)),
        sections=tuple(map(_section, block.sections)),
    )


def _variable(variable: BlockVariable) -> BlockVariable:
    return dataclasses.replace(variable, type="REAL") if variable.type == "LREAL" else variable


def _table(table: Table) -> Table:
    return dataclasses.replace(table, type="REAL", values=_values(table)) if table.type == "LREAL" else table


def _values(table: Table) -> FloatArray:
    values = np.array(table.values, np.float64)
    size = np.abs(values)
    for least, stand_in in _STAND_INS:
        values = np.where((size >= least), np.copysign(stand_in, values), values)
        size = np.abs(values)
    # the largest number below the one that overflows: a limit of inputs
    values = np.where((size > _LARGEST) & (size < FLOAT32_OVERFLOW), np.copysign(_LARGEST, values), values)
    if not np.array_equal(values.astype(np.float32), values):
        raise DefectError(f"table {table.name}: a number is no REAL")
    return values


def _section(section: CodeSection) -> CodeSection:
    """Conversions to REAL are left out: what is converted is a REAL."""
    values: dict[str, Any] = {
        name: False if name in ("single", "function_single") else value for name, value in section.values.items()
    }
    if "sums" in values:
        values["sums"] = {**values["sums"], "single": False}
    return dataclasses.replace(section, values=values)
