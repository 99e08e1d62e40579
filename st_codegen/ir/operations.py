"""Operations on vectors: columns, scaling, sums, functions, kernels."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.arrays import FloatArray, Int32Array
from st_codegen.ir.base import (
    ColumnFunction,
    Elementwise,
    Function,
    Kernel,
    Norm,
    Operator,
    Precision,
    Quotient,
    ReadsColumns,
    ReadsWhole,
    SummationOrder,
    Towards,
    check_columns,
    freeze,
    freeze_finite,
)


@dataclass(frozen=True)
class Select(ReadsColumns):
    """Columns picked from one or several values laid end to end (concatenation, reordering, column transformers)."""

    inputs: tuple[int, ...]
    columns: Int32Array
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, "columns", np.int32, (None,))

    @property
    def width(self) -> int:
        return len(self.columns)

    def check_operands(self, total: int) -> None:
        check_columns(self, self.columns, total)

    def source(self, number: int, width_of: Callable[[int], int]) -> tuple[int, int]:
        """The value that a column is picked from, and which of its columns it is; `width_of` has the width of each."""
        at = int(self.columns[number])
        for value in self.inputs[:-1]:
            if at < width_of(value):
                return value, at
            at -= width_of(value)
        return self.inputs[-1], at


@dataclass(frozen=True)
class Scale(Quotient):
    """`x <operator> constant` for each column, rounded to `precision`; `reverse` gives `constant <operator> x`.

    A chain of these says exactly what a scaler does: (x - mean) / scale is two of them, x * scale + min is two others.
    `doubt` (columns) is how far the library's own constant may lie from this one, where it computes it anew each time
    that it predicts; it may also leave out a rounding between such a step and the next one.
    """

    inputs: tuple[int, ...]
    operator: Operator
    constant: FloatArray
    precision: Precision = Precision.FLOAT64
    reverse: bool = False
    limit: float = math.inf
    doubt: FloatArray | None = None

    def __post_init__(self) -> None:
        freeze_finite(self, "constant", (None,))
        if self.doubt is not None:
            freeze_finite(self, "doubt", (len(self.constant),))
        if self.operator is Operator.DIVIDE and not self.reverse and not np.all(self.constant):
            raise InputError("Scale: division by a constant that is zero")

    @property
    def width(self) -> int:
        return len(self.constant)

    @property
    def refuses(self) -> bool:
        """Whether there are numbers without an answer."""
        return self.reverse and self.operator is Operator.DIVIDE

    @property
    def exact(self) -> bool:
        return self.doubt is None and self.precision is not Precision.REAL


@dataclass(frozen=True)
class Combine(Quotient):
    """`a <operator> b` for two computed values of one width, column by column, rounded to `precision`."""

    inputs: tuple[int, ...]
    operator: Operator
    width: int
    precision: Precision = Precision.FLOAT64
    limit: float = math.inf

    @property
    def refuses(self) -> bool:
        """Whether there are numbers without an answer."""
        return self.operator is Operator.DIVIDE

    @property
    def exact(self) -> bool:
        return self.precision is not Precision.REAL


@dataclass(frozen=True)
class Round(Elementwise):
    """Rounding to float32: a library's cast. A value too large for float32 makes the row invalid."""

    inputs: tuple[int, ...]
    width: int
    exact: ClassVar[bool] = True


@dataclass(frozen=True)
class FillMissing(ColumnFunction):
    """NaN, and every number equal to `sentinel` where there is one, replaced by the column's `fill`.

    XGBoost's gblinear, scikit-learn's SimpleImputer.
    """

    inputs: tuple[int, ...]
    fill: FloatArray
    sentinel: float | None = None
    computes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze_finite(self, "fill", (None,))
        if self.sentinel is not None and not math.isfinite(self.sentinel):
            raise InputError(f"FillMissing: the sentinel {self.sentinel} is not finite")

    @property
    def width(self) -> int:
        return len(self.fill)

    @property
    def keeps_missing(self) -> list[bool]:
        """False for every column: a number stands in the place of each missing value."""
        return [False] * self.width

    def value(self, x: FloatArray) -> FloatArray:
        missing = np.isnan(x) if self.sentinel is None else np.isnan(x) | (x == self.sentinel)
        return np.where(missing, self.fill, x)

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray | float:
        """1, and infinite where a number that counts as missing lies within `difference`."""
        if self.sentinel is None:
            return 1.0
        return np.where((difference > 0) & (np.abs(x - self.sentinel) <= difference), np.inf, 1.0)

    def largest(self, magnitude: FloatArray) -> FloatArray:
        return np.maximum(magnitude, np.abs(self.fill))


@dataclass(frozen=True)
class Clip(ColumnFunction):
    """Each column limited to [lower, upper] (MinMaxScaler(clip=True), ONNX Clip)."""

    inputs: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray
    computes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze_finite(self, "lower", (None,))
        freeze_finite(self, "upper", (len(self.lower),))

    @property
    def width(self) -> int:
        return len(self.lower)

    def value(self, x: FloatArray) -> FloatArray:
        return np.clip(x, self.lower, self.upper)

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray:
        outside = (x + difference <= self.lower) | (x - difference >= self.upper)
        return np.where(outside, 0.0, 1.0)

    def largest(self, magnitude: FloatArray) -> FloatArray:
        return np.minimum(magnitude, np.maximum(np.abs(self.lower), np.abs(self.upper)))


@dataclass(frozen=True)
class WholeNumber(ColumnFunction):
    """The whole number beside each number, -0 as 0: ONNX Round, Floor, Ceil, a cast to integers, quantization."""

    inputs: tuple[int, ...]
    width: int
    towards: Towards = Towards.NEAREST
    computes: ClassVar[bool] = False

    def value(self, x: FloatArray) -> FloatArray:
        return np.asarray(_WHOLE[self.towards](x) + 0.0, np.float64)

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray:
        """The whole numbers within `difference` that the function may jump to, for each unit of it."""
        with np.errstate(all="ignore"):
            here = self.value(x)
            high = self.value(np.nextafter(x + difference, np.inf)) - here
            low = here - self.value(np.nextafter(x - difference, -np.inf))
            steepest = np.maximum(high, low) / difference * (1.0 + 4 * np.finfo(np.float64).eps)
        return np.where(difference > 0, np.where(np.isnan(steepest), np.inf, steepest), 0.0)

    def largest(self, magnitude: FloatArray) -> FloatArray:
        return np.ceil(magnitude)


_WHOLE = {Towards.NEAREST: np.rint, Towards.BELOW: np.floor, Towards.ABOVE: np.ceil, Towards.ZERO: np.trunc}


@dataclass(frozen=True)
class Linear(ReadsWhole):
    """`weights @ x + bias`; weights has shape (outputs, inputs).

    `bias_terms` (outputs): the sum of the magnitudes of the terms (as many as there are inputs) from which the library
    computes the bias when it predicts, in an order of its own. None: the bias is a number of the model.
    `doubt` (outputs, inputs): the library solves equations where these weights are rounded: its result lies within
    `doubt @ abs(x)` of theirs. None: it multiplies by the weights.
    """

    inputs: tuple[int, ...]
    weights: FloatArray
    bias: FloatArray
    order: SummationOrder = SummationOrder.UNSPECIFIED
    precision: Precision = Precision.FLOAT64
    bias_terms: FloatArray | None = None
    doubt: FloatArray | None = None

    def __post_init__(self) -> None:
        weights = freeze_finite(self, "weights", (None, None))
        freeze_finite(self, "bias", (weights.shape[0],))
        if self.bias_terms is not None:
            freeze_finite(self, "bias_terms", (weights.shape[0],))
        if self.doubt is not None:
            freeze_finite(self, "doubt", weights.shape)

    @property
    def operand_width(self) -> int:
        return int(self.weights.shape[1])

    @property
    def width(self) -> int:
        return int(self.weights.shape[0])

    @property
    def exact(self) -> bool:
        return self.order is SummationOrder.SEQUENTIAL and self.precision is not Precision.REAL


@dataclass(frozen=True)
class SlidingLinear(ReadsColumns):
    """Equal weighted sums at several places of a value: a convolution, a matrix times several rows, a mean of each.

    The place that starts at `starts[p]` reads the columns `starts[p] + offsets` and gives `weights @ columns + bias`,
    added in any order; weights has shape (outputs, offsets). The result has all outputs of the first place, then those
    of the next. `whole`: all numbers are whole, and so small that no sum is rounded.
    """

    inputs: tuple[int, ...]
    weights: FloatArray
    bias: FloatArray
    starts: Int32Array
    offsets: Int32Array
    precision: Precision = Precision.FLOAT64
    whole: bool = False

    def __post_init__(self) -> None:
        weights = freeze_finite(self, "weights", (None, None))
        freeze_finite(self, "bias", (weights.shape[0],))
        freeze(self, "starts", np.int32, (None,))
        freeze(self, "offsets", np.int32, (weights.shape[1],))
        if not weights.size or not len(self.starts):
            raise InputError("SlidingLinear: no weights, or no places")

    def check_operands(self, total: int) -> None:
        reached = [int(self.starts.min()) + int(self.offsets.min()), int(self.starts.max()) + int(self.offsets.max())]
        check_columns(self, reached, total)

    @property
    def width(self) -> int:
        return len(self.starts) * int(self.weights.shape[0])

    @property
    def exact(self) -> bool:
        return self.whole

    @property
    def columns(self) -> Int32Array:
        """The columns that each place reads, shape (places, offsets)."""
        return np.asarray(self.starts[:, None] + self.offsets, np.int32)


@dataclass(frozen=True)
class Activation(Elementwise):
    """A function of each column. Exact where it needs no transcendental function.

    Arguments above `limit` are refused (exponentials: the pass `domain` sets a limit below overflow). A power is an
    exponential of `parameter * log(x)`.
    """

    inputs: tuple[int, ...]
    function: Function
    width: int
    parameter: float = 1.0
    precision: Precision = Precision.FLOAT64
    limit: float = math.inf

    _EXACT: ClassVar[frozenset[Function]] = frozenset(
        {Function.IDENTITY, Function.RELU, Function.LEAKY_RELU, Function.SIGNED_SQUARE, Function.ABS, Function.SQRT}
    )
    _PARTIAL: ClassVar[frozenset[Function]] = frozenset(
        {
            *(Function.LOG1P, Function.SQRT, Function.LOG, Function.SIN, Function.COS, Function.POWER),
            Function.NORMAL_QUANTILE,
        }
    )

    def __post_init__(self) -> None:
        if not math.isfinite(self.parameter):
            raise InputError(f"Activation {self.function}: the parameter {self.parameter} is not finite")

    @property
    def exact(self) -> bool:
        return self.function in self._EXACT and self.precision is not Precision.REAL

    @property
    def refuses(self) -> bool:
        """Whether there are numbers without an answer."""
        return self.function in self._PARTIAL or math.isfinite(self.limit)

    @property
    def furthest(self) -> float:
        """The largest magnitude of which a power is taken; the smallest, above 0, where the parameter is negative."""
        argument = self.limit / self.parameter
        if argument >= math.log(np.finfo(np.float64).max):
            return math.inf
        return max(math.exp(argument), sys.float_info.min)


@dataclass(frozen=True)
class Normalize(Quotient):
    """The vector divided by its norm, every step rounded to `precision` (onnxruntime, ml/normalizer.cc).

    MAX: x / largest number (not largest magnitude). L1: x / (|x1| + |x2| + ...), added in order.
    L2: sign(x) * sqrt(x*x / (x1*x1 + x2*x2 + ...)), added in order. A norm of zero leaves the vector as it is.
    """

    inputs: tuple[int, ...]
    norm: Norm
    width: int
    precision: Precision = Precision.FLOAT32
    limit: float = math.inf
    exact: ClassVar[bool] = True
    refuses: ClassVar[bool] = True


@dataclass(frozen=True)
class KernelSum(ReadsWhole):
    """Support vector regression: sum of coefficient * kernel(x, support vector), plus intercept.

    `support_vectors` (vectors, columns); `coefficients` (outputs, vectors); `intercept` (outputs). `expands`: the
    library computes distances as u.u - 2 * u.v + v.v, which loses digits of those that are small beside u and v.
    """

    inputs: tuple[int, ...]
    kernel: Kernel
    support_vectors: FloatArray
    coefficients: FloatArray
    intercept: FloatArray
    gamma: float = 1.0
    coef0: float = 0.0
    degree: int = 3
    precision: Precision = Precision.FLOAT64
    expands: bool = False
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        vectors = freeze_finite(self, "support_vectors", (None, None))
        coefficients = freeze_finite(self, "coefficients", (None, vectors.shape[0]))
        freeze_finite(self, "intercept", (coefficients.shape[0],))
        if not len(vectors):
            raise InputError("KernelSum: no support vectors; the model is a constant")
        if not (math.isfinite(self.gamma) and math.isfinite(self.coef0)):
            raise InputError(f"KernelSum: gamma {self.gamma} or coef0 {self.coef0} is not finite")
        if self.kernel is Kernel.RBF and self.gamma < 0:
            raise InputError(f"KernelSum: gamma {self.gamma} is negative; an RBF kernel would grow without bound")
        if self.degree < 0:
            raise InputError(f"KernelSum: degree {self.degree} is negative")

    @property
    def operand_width(self) -> int:
        return int(self.support_vectors.shape[1])

    @property
    def width(self) -> int:
        return int(self.coefficients.shape[0])


@dataclass(frozen=True)
class FactoredKernel:
    """An RBF kernel sum whose support vectors lie on a grid: exp(-gamma * |u - v|**2) is a product over the columns.

    `axes` has the rising distinct values of each column, in the order `columns`; `coefficients` (outputs, points of the
    grid in row-major order, the last column fastest) is zero where no support vector lies. One exponential is taken for
    each value of an axis.
    """

    inputs: tuple[int, ...]
    columns: tuple[int, ...]
    axes: tuple[FloatArray, ...]
    coefficients: FloatArray
    intercept: FloatArray
    gamma: float
    precision: Precision = Precision.FLOAT64
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for axis in self.axes:
            if axis.ndim != 1 or not np.all(np.isfinite(axis)) or np.any(np.diff(axis) <= 0):
                raise InputError("FactoredKernel.axes: not strictly rising")
        points = math.prod(len(axis) for axis in self.axes)
        coefficients = freeze_finite(self, "coefficients", (None, points))
        freeze_finite(self, "intercept", (coefficients.shape[0],))

    @property
    def operand_width(self) -> int:
        return len(self.columns)

    def check_operands(self, total: int) -> None:
        check_columns(self, self.columns, total)

    @property
    def width(self) -> int:
        return int(self.coefficients.shape[0])


def one_column(op: Any, column: int) -> Any:
    """What an operation that computes each column by itself does to one of them, as an operation of width 1."""
    changes: dict[str, Any] = {"inputs": (0,)}
    for field in fields(op):
        value = getattr(op, field.name)
        if isinstance(value, np.ndarray):
            changes[field.name] = value[column : column + 1]
        elif field.name == "width":
            changes["width"] = 1
    return replace(op, **changes)
