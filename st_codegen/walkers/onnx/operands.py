"""What the operators of an ONNX graph read: constants, tensors computed for one row, and checks of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir import AnyArray, FloatArray, IntArray, Label, Precision

#: Columns of one computed tensor, and features of one model.
MAX_COLUMNS = 2**16
#: Numbers of one constant that the graph computes from others.
MAX_FOLDED = 2**24

FLOAT32 = np.dtype(np.float32)
FLOAT64 = np.dtype(np.float64)
TRUTH = np.dtype(np.bool_)


@dataclass(frozen=True)
class ConstantOperand:
    """A tensor whose numbers stand in the file."""

    array: AnyArray

    @property
    def shape(self) -> tuple[int, ...]:
        return self.array.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.array.dtype

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> ConstantOperand:
        """The result of an operator that only moves numbers about."""
        return ConstantOperand(move(self.array))


@dataclass(frozen=True)
class Tensor:
    """A tensor computed from the inputs: each element is column `column` of value `value` of the representation.

    `dtype` is int64 for integer inputs, int32 for those of INT32 without their fractions. `unrounded`: the elements
    still have to be rounded to float32, `uncut`: the fractions to be cut off. `special`: NaN and infinite inputs come
    through to this tensor. `given`: integers of an input, which onnxruntime is given as numbers that may have
    fractions.
    """

    value: IntArray
    column: IntArray
    dtype: np.dtype[Any]
    unrounded: bool = False
    special: bool = True
    uncut: bool = False
    given: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    @property
    def size(self) -> int:
        return self.value.size

    @property
    def precision(self) -> Precision:
        return Precision.FLOAT32 if self.dtype == FLOAT32 else Precision.FLOAT64

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> Tensor:
        """The result of an operator that only moves numbers about."""
        return replace(self, value=move(self.value), column=move(self.column))


@dataclass(frozen=True)
class LabelOperand:
    """A tensor of one element, which is one of the labels: column 0 of value `value` has its number.

    `number_type`: the type of labels that are numbers, where it is not that of Python's own.
    """

    value: int
    labels: tuple[Label, ...]
    shape: tuple[int, ...] = (1,)
    number_type: np.dtype[Any] | None = None

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.number_type or np.dtype(object if isinstance(self.labels[0], str) else type(self.labels[0]))

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> LabelOperand:
        """The result of an operator that only moves numbers about."""
        return replace(self, shape=move(np.zeros(self.shape, np.int64)).shape)


@dataclass(frozen=True)
class PickedOperand:
    """What belongs to the `count` smallest columns of value `value`: as many elements of `whole`, one for each column.

    Operators that compute each element by itself do so with `whole`; only a sum or a mean of the elements is computed.
    """

    value: int
    count: int
    whole: ConstantOperand | Tensor
    shape: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.whole.dtype

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> PickedOperand:
        """The result of an operator that changes the shape only."""
        found = move(np.arange(self.count).reshape(self.shape))
        if not np.array_equal(np.ravel(found), np.arange(self.count)):
            raise UnsupportedModelError("takes a part of what TopK picks; sums and means of all of it are supported")
        return replace(self, shape=found.shape)


@dataclass(frozen=True)
class MedianOperand:
    """What exporters compute of the numbers that are `picked`, weights of all columns in rising order, for a median.

    `step` says what: the sums of the weights up to each, that of all, half of it, whether a sum lies below that, the
    first that does not, the column that this is.
    """

    picked: PickedOperand
    step: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> MedianOperand:
        """The result of an operator that changes the shape only."""
        return replace(self, shape=self.picked.moved(move).shape)


@dataclass(frozen=True)
class BetweenOperand:
    """Constants that the graph computes itself, each in its own way in each library: all lie between these numbers."""

    low: FloatArray
    high: FloatArray
    dtype: np.dtype[Any]

    @property
    def shape(self) -> tuple[int, ...]:
        return self.low.shape

    def moved(self, move: Callable[[AnyArray], AnyArray]) -> BetweenOperand:
        """The result of an operator that only moves numbers about."""
        return replace(self, low=move(self.low), high=move(self.high))


Operand = ConstantOperand | Tensor | LabelOperand | PickedOperand | MedianOperand | BetweenOperand


def together(parts: Sequence[Tensor], join: Callable[[Sequence[AnyArray]], AnyArray]) -> Tensor:
    """Tensors of one type as one, by what joins arrays."""
    value, column = (join([getattr(part, name) for part in parts]) for name in ("value", "column"))
    return replace(parts[0], value=value, column=column, special=any(part.special for part in parts))


#: Integers of these types are computed, each as a number that has no fraction.
INTEGERS = (np.dtype(np.int64), np.dtype(np.int32))
#: From here on not every whole number is a double.
MAX_WHOLE = 2**53


def as_doubles(array: AnyArray) -> FloatArray:
    """Constants as doubles. Raises UnsupportedModelError for integers that a double may not hold."""
    doubles = array.astype(np.float64)
    if array.dtype in INTEGERS and np.any(np.abs(doubles) >= MAX_WHOLE):
        raise UnsupportedModelError("calculates with whole numbers from 2**53 on, which LREAL does not hold")
    return doubles


def require_finite(constants: FloatArray) -> FloatArray:
    """The constants themselves; raises UnsupportedModelError where infinity or NaN is among them."""
    bad = constants[~np.isfinite(constants)]
    if bad.size:
        raise UnsupportedModelError(
            f"puts {bad[0]} beside computed numbers; train the model without NaN and infinite values, and export a "
            "mask with -1E9 instead of them"
        )
    return constants


def require_float(tensor: Tensor) -> Tensor:
    """The tensor itself; raises UnsupportedModelError where it holds integers or truth values."""
    if tensor.dtype not in (FLOAT32, FLOAT64):
        kind = "truth values" if tensor.dtype == TRUTH else "integers"
        raise UnsupportedModelError(f"reads {kind}; cast them to float, or export the model with float inputs")
    return tensor


def require_tensor(operand: Operand) -> Tensor:
    """The operand itself; raises UnsupportedModelError unless it holds numbers computed from the inputs."""
    if isinstance(operand, ConstantOperand):
        raise UnsupportedModelError("reads a constant; fold constants when exporting")
    if isinstance(operand, BetweenOperand):
        raise UnsupportedModelError(
            "reads a constant that the graph computes by functions; fold constants when exporting"
        )
    if isinstance(operand, PickedOperand):
        raise UnsupportedModelError("reads what TopK picks; sums and means of it are supported")
    if isinstance(operand, MedianOperand):
        raise UnsupportedModelError("reads sums of what TopK picks; the weighted median of all of it is supported")
    if isinstance(operand, LabelOperand):
        raise UnsupportedModelError("computes with labels of classes; they can be chosen among and cast only")
    return operand


def require_same_type(*operands: Operand) -> np.dtype[Any]:
    """The type of all operands; raises UnsupportedModelError where one is an input of integers, of whatever type."""
    if any(isinstance(operand, Tensor) and operand.given for operand in operands):
        raise UnsupportedModelError("reads the integers of an input; cast them to float, or export with float inputs")
    types = list(dict.fromkeys(operand.dtype for operand in operands))
    if len(types) > 1:
        raise InputError(
            f"the inputs have different types, {' and '.join(map(str, types))}, which onnxruntime refuses; export the "
            "model with float inputs"
        )
    return types[0]


def one_row(tensor: Tensor) -> Tensor:
    """The tensor as a matrix of one row; operators of ai.onnx.ml read vectors and matrices so."""
    if len(tensor.shape) not in (1, 2) or (len(tensor.shape) == 2 and tensor.shape[0] != 1):
        raise UnsupportedModelError(
            f"reads a tensor of shape {tensor.shape} (for one row); expected one row of numbers, "
            "export the model with a symbolic batch dimension"
        )
    return tensor.moved(lambda array: array.reshape(1, -1))


def axis_of(axis: int, rank: int) -> int:
    """An axis counted from the front; raises InputError where there is none."""
    if not -rank <= axis < max(rank, 1):
        raise InputError(f"axis {axis} of a tensor with {counted(rank, 'dimension')}; the model file is damaged")
    return axis % rank if rank else 0


def check_size(shape: Iterable[int], limit: int = MAX_COLUMNS) -> None:
    """Raise UnsupportedModelError where a result has too many elements, or a computed one has none."""
    size = math.prod(shape)
    if size == 0 and limit <= MAX_COLUMNS:
        raise UnsupportedModelError(
            "the result has no elements (a dimension is 0); leave such tensors out of the graph"
        )
    if size > limit:
        raise UnsupportedModelError(f"the result has {size} numbers for one row, at most {limit} are supported")
