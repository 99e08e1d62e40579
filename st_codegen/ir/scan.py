"""Operations that are repeated: each round reads what the one before left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import FloatArray, Int32Array
from st_codegen.ir.base import Operation, ReadsColumns, check_columns, freeze, freeze_finite


@dataclass(frozen=True)
class Scan(ReadsColumns):
    """A recurrent layer: `body` once for each row of a value, on the row and the state that the round before left.

    Round `r` reads the columns `starts[r] .. starts[r] + columns - 1`. Value 0 of the body is that row, then the state;
    its last value is the new state, which starts as `initial`. The result has the states after all rounds, in order.
    """

    inputs: tuple[int, ...]
    body: tuple[Operation, ...]
    starts: Int32Array
    columns: int
    initial: FloatArray
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze(self, "starts", np.int32, (None,))
        freeze_finite(self, "initial", (None,))
        if not self.body or not len(self.starts):
            raise InputError("Scan: no operations, or no rounds")
        for number, op in enumerate(self.body):
            widths = [self.body_width(value) for value in op.inputs if 0 <= value <= number]
            if len(widths) < len(op.inputs) or any(op.operand_width not in (None, width) for width in widths):
                raise InputError(f"Scan, operation {number} ({type(op).__name__}): reads what is not computed, or wide")
            op.check_operands(sum(widths))
        if self.body[-1].width != len(self.initial):
            raise InputError(
                f"Scan: a state of {counted(len(self.initial), 'number')}, a round leaves {self.body[-1].width}"
            )

    def check_operands(self, total: int) -> None:
        check_columns(self, (int(self.starts.min()), int(self.starts.max()) + self.columns - 1), total)

    @property
    def width(self) -> int:
        return len(self.starts) * len(self.initial)

    def body_width(self, value: int) -> int:
        """Number of columns of a value of the body."""
        return self.columns + len(self.initial) if value == 0 else self.body[value - 1].width
