"""What walkers of classifiers share: labels, and the rules by which scores become the number of a class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import combinations
from typing import Any

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import ArgMax, Exceeds, FloatArray, IntArray, Label, Precision, Softmax
from st_codegen.ir.base import SummationOrder
from st_codegen.walkers.base import GraphBuilder
from st_codegen.walkers.fitted import Fitted

#: How far below the largest score another one may lie so that the exponentials of both, taken after the largest score
#: was subtracted, are both 1.0 for certain (half a unit below 1.0 rounds to even), and from where on they, and their
#: quotients by one sum, differ for certain: an exponential and a quotient err by at most two units each.
_MERGED = {Precision.FLOAT64: 2.0**-54, Precision.FLOAT32: 2.0**-25}
_OPEN_BELOW = {Precision.FLOAT64: 2.0**-49, Precision.FLOAT32: 2.0**-20}


def labels_of(fitted: Fitted) -> tuple[Label, ...]:
    """The labels in `classes_`, as Python has them. Raises UnsupportedModelError for what is no plain value."""
    values = fitted.get("classes_")
    if isinstance(values, list):
        raise UnsupportedModelError(f"{fitted.kind} with several outputs of classes: train one for each of them")
    if not isinstance(values, np.ndarray) or values.ndim != 1 or not len(values):
        raise fitted.fail("classes_", "not a list of labels")
    found = tuple(label_of(value) for value in values)
    if not all(isinstance(label, str | bool | int | float) for label in found):
        raise UnsupportedModelError(f"{fitted.kind} with labels that are neither text, numbers nor truth values")
    return found


def trained_on_one(labels: tuple[Label, ...]) -> str:
    """Why a classifier of one class is refused where the library needs no score to answer."""
    return f"trained on the class {labels[0]!r} alone, which is its answer to all rows"


def label_of(value: Any) -> Any:
    """A label as Python has it."""
    return value.item() if isinstance(value, np.generic) else value


def numbers_of(labels: tuple[Label, ...], found: Iterable[Any]) -> FloatArray:
    """The number of each of a library's labels, shape (rows, 1). Raises InputError for one that is not in the list."""
    position = {label: number for number, label in enumerate(labels)}
    try:
        return np.array([[position[label_of(value)]] for value in found], np.float64).reshape(-1, 1)
    except KeyError as error:
        raise InputError(f"the library answers with the label {error}, which the model does not list") from None


#: Labels up to here have differences that are exact.
_LARGEST_LABEL = 2**52


def _is_whole(label: Any) -> bool:
    """Whether a label is a number that sums of whole numbers give: they give no -0."""
    if not isinstance(label, int | float) or label % 1 != 0 or abs(label) > _LARGEST_LABEL:
        return False
    return label != 0 or math.copysign(1.0, label) > 0


def numbered(builder: GraphBuilder, index: int, labels: Iterable[Any], kind: str) -> int:
    """The label itself, a whole number, of the number of a class that is one of several outputs.

    It is the first label and the steps up to it. Raises UnsupportedModelError for other labels, such as texts.
    """
    given = [label_of(label) for label in labels]
    if not all(map(_is_whole, given)):
        raise UnsupportedModelError(
            f"{kind} with labels {tuple(given[:3])}, .. beside other outputs: encode them as whole numbers from -2**52 "
            "to 2**52, and zero without a sign"
        )
    if given == list(range(len(given))):
        return index
    steps = np.diff(np.array(given, np.float64), append=given[-1])
    reached = builder.add(Exceeds((builder.select([0] * len(given), index),), np.arange(0.5, len(given))))
    return whole_sums(builder, reached, steps[None, :], np.array([given[0]], np.float64))


def largest(builder: GraphBuilder, scores: int) -> int:
    """The number of the largest column, the first of equal ones (`numpy.argmax`)."""
    return builder.add(ArgMax((scores,), builder.width(scores)))


def most_probable(builder: GraphBuilder, scores: int, precision: Precision) -> int:
    """The number of the largest of the probabilities that a softmax makes of exact scores."""
    return builder.add(ArgMax((scores,), builder.width(scores), _MERGED[precision], _OPEN_BELOW[precision]))


def softmax(builder: GraphBuilder, scores: int, precision: Precision = Precision.FLOAT64) -> int:
    """Probabilities of scores."""
    return builder.add(Softmax((scores,), builder.width(scores), precision))


def above(builder: GraphBuilder, score: int, cut: float = 0.0, *, inclusive: bool = False) -> int:
    """1 where each column exceeds the cut, else 0."""
    return builder.add(Exceeds((score,), np.full(builder.width(score), cut), inclusive))


def complement(builder: GraphBuilder, probability: int, precision: Precision = Precision.FLOAT64) -> int:
    """1 - p and p side by side, for the probability p of the second class."""
    other = builder.scale(probability, "-", 1.0, precision=precision, reverse=True)
    return builder.beside(other, probability)


def shares_of(builder: GraphBuilder, value: int, *, equal: bool = True) -> int:
    """Numbers from 0 on by their sum; where all are 0 they are equal shares, or stay 0."""
    count = builder.width(value)
    total = builder.select([0] * count, builder.linear(value, np.ones((1, count))))
    none = builder.scale(above(builder, total), "-", 1.0, reverse=True)
    divisor = builder.combine(total, "+", builder.scale(none, "*", float(count)))
    return builder.combine(builder.combine(value, "+", none) if equal else value, "/", divisor)


def whole_sums(builder: GraphBuilder, value: int, weights: FloatArray, bias: FloatArray) -> int:
    """Weighted sums of whole numbers with whole weights: exact in any order."""
    return builder.linear(value, weights, bias, order=SummationOrder.SEQUENTIAL)


def pair_members(count: int) -> tuple[FloatArray, FloatArray]:
    """For each class and pair (classes, pairs), whether the class is its first, and whether it is its second one."""
    pairs = np.array(list(combinations(range(count), 2)))
    return tuple((pairs[:, side] == np.arange(count)[:, None]).astype(np.float64) for side in (0, 1))


def pair_coefficients(dual: FloatArray, of_class: IntArray) -> FloatArray:
    """The coefficients of each pair of classes (pairs, vectors) of a machine of libsvm.

    Vectors stand class by class, `of_class` of each, and have a row in `dual` for each other class.
    """
    ends = np.cumsum(of_class)
    blocks = [slice(end - size, end) for end, size in zip(ends, of_class, strict=True)]
    rows = []
    for one, other in combinations(range(len(of_class)), 2):
        row = np.zeros(dual.shape[1])
        row[blocks[one]] = dual[other - 1, blocks[one]]
        row[blocks[other]] = dual[one, blocks[other]]
        rows.append(row)
    return np.array(rows)


def pair_votes(builder: GraphBuilder, pairs: int, count: int) -> int:
    """The votes for each class: a pair's score above 0 is one for its first class, any other one for its second."""
    first, second = pair_members(count)
    return whole_sums(builder, above(builder, pairs), first - second, second.sum(axis=1))


def last_below(
    reached: Callable[[Any], Any], dtype: type[np.float32] | type[np.float64], ends: tuple[float, float] = (-1.0, 1.0)
) -> float:
    """The largest number between two for which a rising condition does not hold yet, of the numbers of a type."""
    low, high = dtype(ends[0]), dtype(ends[1])
    while True:
        middle = dtype((low + high) / dtype(2))
        if middle in (low, high):
            return float(low)
        low, high = (low, middle) if bool(reached(middle)) else (middle, high)
