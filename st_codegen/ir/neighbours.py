"""Distances to training rows, and what is made of the nearest of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import FloatArray
from st_codegen.ir.base import Precision, ReadsWhole, freeze_finite


@dataclass(frozen=True)
class Distances(ReadsWhole):
    """The distance to each of `vectors` (vectors, columns): the sum over the columns of squares, or of magnitudes.

    `root`: the square root of the sum. `expands`: the library computes squares as u.u - 2 * u.v + v.v, which loses
    digits, and takes 0 for less than 0. `largest`: the largest of the magnitudes in place of their sum, which is exact.
    """

    inputs: tuple[int, ...]
    vectors: FloatArray
    squared: bool = True
    expands: bool = False
    root: bool = False
    largest: bool = False

    def __post_init__(self) -> None:
        freeze_finite(self, "vectors", (None, None))
        if not self.vectors.size:
            raise InputError("Distances: no vectors")
        if self.largest and (self.squared or self.root):
            raise InputError("Distances: the largest of squares, or a root of it")

    @property
    def exact(self) -> bool:
        return self.largest

    @property
    def operand_width(self) -> int:
        return int(self.vectors.shape[1])

    @property
    def width(self) -> int:
        return len(self.vectors)


@dataclass(frozen=True)
class NearestMean(ReadsWhole):
    """The mean of what belongs to the `count` columns with the smallest numbers, of equal ones the first.

    `values` (outputs, columns), each times its column of a second input where there is one. `inverse`: weighted with
    one through the number; where a number is 0, only those that are 0 count. `divides`: else it is the sum of them.
    The library adds in `precision`.
    """

    inputs: tuple[int, ...]
    values: FloatArray
    count: int
    inverse: bool = False
    precision: Precision = Precision.FLOAT64
    divides: bool = True
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        values = freeze_finite(self, "values", (None, None))
        if not 1 <= self.count <= values.shape[1] or len(self.inputs) > 2:
            raise InputError(
                f"NearestMean: {self.count} of {counted(values.shape[1], 'column')}, "
                f"{counted(len(self.inputs), 'input')}"
            )

    @property
    def operand_width(self) -> int:
        return int(self.values.shape[1])

    @property
    def width(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class WeightedMedian(ReadsWhole):
    """The smallest column up to which, in rising order, half of the `weights` are reached.

    The weights are added in that order, in `precision`; of equal columns libraries add in any order.
    """

    inputs: tuple[int, ...]
    weights: FloatArray
    precision: Precision = Precision.FLOAT64
    width: ClassVar[int] = 1
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze_finite(self, "weights", (None,))
        if not len(self.weights) or np.any(self.weights < 0):
            raise InputError("WeightedMedian.weights: none, or a negative one")

    @property
    def operand_width(self) -> int:
        return len(self.weights)
