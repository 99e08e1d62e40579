"""Classes: what a model says of its labels, and the operations by which scores become a decision."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import FloatArray
from st_codegen.ir.base import ColumnFunction, Precision, ReadsWhole, freeze_finite

#: A label as the library has it.
Label = str | bool | int | float


#: Training rows of a Gaussian process up to which its standard deviation is compiled: a square matrix of them.
MAX_DEVIATION_ROWS = 512


class OutputKind(StrEnum):
    """What an output is that is computed on demand, and what stands in front of those."""

    CLASS = "class"  # the number of the label, from 0; always the first output
    PROBABILITY = "probability"
    DECISION = "decision"  # the library's own score
    MEAN = "mean"  # of a Gaussian process; always there
    DEVIATION = "deviation"  # its standard deviation
    COLUMN = "column"  # of what transforms; always there
    RECONSTRUCTION = "reconstruction"  # how far the inputs of a PCA lie from what its columns say of them, squared


@dataclass(frozen=True)
class Classes:
    """The labels of a classifier in the order of their numbers, and what each output of the model is."""

    labels: tuple[Label, ...]
    kinds: tuple[OutputKind, ...]

    def __post_init__(self) -> None:
        if not self.labels or len(set(self.labels)) < len(self.labels):
            raise InputError(
                f"{counted(len(self.labels), 'label')}, {len(set(self.labels))} of them different; the file is damaged"
            )
        if OutputKind.CLASS in self.kinds[1:] or self.kinds[:1] != (OutputKind.CLASS,):
            raise InputError("the first output of a classifier, and no other, is the number of its class")


@dataclass(frozen=True)
class ArgMax(ReadsWhole):
    """The number of the largest column, counted from 0; of equal ones the first.

    Libraries that take the largest probability see two as equal whose scores are not: `merged` is the distance below
    the largest score up to which a column certainly counts as equal to it. Beyond it, up to `open_below`, only the
    rounding of an exponential says whether it does, so that the library's choice between such columns is not known.
    """

    inputs: tuple[int, ...]
    n_columns: int
    merged: float = 0.0
    open_below: float = 0.0
    width: ClassVar[int] = 1

    def __post_init__(self) -> None:
        if self.n_columns < 1 or not 0 <= self.merged <= max(self.merged, self.open_below) < math.inf:
            raise InputError(
                f"ArgMax of {counted(self.n_columns, 'column')}, merged {self.merged}, open below {self.open_below}"
            )

    @property
    def operand_width(self) -> int:
        return self.n_columns

    @property
    def exact(self) -> bool:
        return self.open_below == 0.0


@dataclass(frozen=True)
class Exceeds(ColumnFunction):
    """1.0 in each column that is larger than its `cut` (or equal to it, where `inclusive`), else 0.0."""

    inputs: tuple[int, ...]
    cut: FloatArray
    inclusive: bool = False
    computes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze_finite(self, "cut", (None,))

    @property
    def width(self) -> int:
        return len(self.cut)

    def value(self, x: FloatArray) -> FloatArray:
        reached = x >= self.cut if self.inclusive else x > self.cut
        return np.where(np.isnan(x), np.nan, reached)

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray:
        """As steep as a whole step within `difference`, where the cut lies so near."""
        with np.errstate(all="ignore"):
            steepest = (1.0 + 4 * np.finfo(np.float64).eps) / difference
        return np.where((difference > 0) & (np.abs(x - self.cut) <= difference), steepest, 0.0)

    def largest(self, magnitude: FloatArray) -> FloatArray:
        return np.ones_like(magnitude)


@dataclass(frozen=True)
class Softmax(ReadsWhole):
    """exp(x_i) / (exp(x_1) + exp(x_2) + ..), as libraries compute it: the largest x is taken from all first.

    `logarithm`: the logarithm of that, x_i less the logarithm of the sum.
    """

    inputs: tuple[int, ...]
    width: int
    precision: Precision = Precision.FLOAT64
    logarithm: bool = False
    exact: ClassVar[bool] = False

    @property
    def operand_width(self) -> int:
        return self.width
