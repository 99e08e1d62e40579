"""Walkers for what scikit-learn computes of each column by itself, in pieces: imputers, encoders, bins, splines.

What an encoder makes of a category is asked of the encoder itself, so that its rules on unknown, missing, rare and
dropped categories are the library's own.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import (
    AnyArray,
    Clip,
    Exceeds,
    FillMissing,
    FloatArray,
    Piecewise,
    Precision,
    Round,
    Towards,
    WholeNumber,
)
from st_codegen.walkers.base import GraphBuilder, transforms, walks
from st_codegen.walkers.fitted import Fitted

#: Knots, the values on them, the pieces, and what stands for NaN, of one column.
Column = tuple[Any, Any, Any, float]


def add_pieces(builder: GraphBuilder, value: int, columns: Sequence[Column]) -> int:
    """One function in pieces for each column of a value."""
    missing = np.array([column[3] for column in columns])
    degree = max(np.atleast_2d(column[2]).shape[-1] for column in columns)
    pieces = [np.pad(column[2], ((0, 0), (0, degree - column[2].shape[1]))) for column in columns]
    return builder.add(
        Piecewise(
            (value,),
            start=np.cumsum([0, *(len(column[0]) for column in columns)]),
            knots=np.concatenate([column[0] for column in columns]),
            at=np.concatenate([column[1] for column in columns]),
            pieces=np.concatenate(pieces),
            missing=None if np.all(np.isnan(missing)) else missing,
        )
    )


def _rising(fitted: Fitted, name: str, values: FloatArray) -> FloatArray:
    if np.any(np.diff(values) <= 0):
        raise fitted.fail(name, "not rising")
    return values


@transforms("Binarizer", finite=True)
def walk_binarizer(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """1 above the threshold, else 0."""
    return builder.held_like(
        value, builder.add(Exceeds((value,), np.full(builder.width(value), fitted.number("threshold"))))
    )


def missing_value(fitted: Fitted, builder: GraphBuilder, value: int) -> float:
    """The number that counts as missing; where it is not NaN, NaN is refused."""
    given = fitted.get("missing_values")
    if not isinstance(given, float | int | np.number):
        raise UnsupportedModelError(f"{fitted.kind} with missing_values={given!r}: supported are NaN and numbers")
    builder.refuse_magnitude(math.inf)
    if not np.isnan(given):
        builder.refuse_nan(value)
        return float(fitted.floats_of("missing_values", given, ()))
    return math.nan


def indicators(builder: GraphBuilder, value: int, missing: float, columns: Any) -> int:
    """1 in columns that are missing, else 0."""
    picked = builder.select(columns, value)
    here, nowhere = (np.array([missing]), np.zeros(1)) if not np.isnan(missing) else (np.zeros(0), np.zeros(0))
    pieces = np.zeros((len(here) + 1, 1))
    stays = 1.0 if np.isnan(missing) else math.nan
    return add_pieces(builder, picked, [(here, nowhere + 1.0, pieces, stays)] * len(columns))


@transforms("MissingIndicator")
def walk_missing(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Which columns are missing (`impute/_base.py: MissingIndicator.transform`)."""
    columns = fitted.integers("features_", (None,), low=0, high=builder.width(value) - 1)
    missing = missing_value(fitted, builder, value)
    if not len(columns):
        raise UnsupportedModelError("MissingIndicator without a column that was missing in training")
    if fitted.estimator.features == "missing-only" and fitted.flag("error_on_new"):
        # other columns that are missing raise
        others = sorted(set(range(builder.width(value))) - set(columns.tolist()))
        if others:
            if not np.isnan(missing):
                raise UnsupportedModelError("MissingIndicator with error_on_new and missing_values other than NaN")
            builder.refuse_nan(builder.select(others, value))
    found = indicators(builder, value, missing, columns)
    builder.sparse[found] = fitted.estimator.sparse is True
    return found


@transforms("SimpleImputer", trusts=("numpy.dtype",))
def walk_imputer(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """A number of its own for each column in place of missing values (`impute/_base.py: SimpleImputer.transform`)."""
    width = builder.width(value)
    given = fitted.get("statistics_")
    kind = np.dtype(fitted.get("_fill_dtype"))
    plain = isinstance(given, np.ndarray) and given.shape == (width,)
    if not plain or kind.kind not in "fiu" or not all(isinstance(v, int | float | np.number) for v in given):
        raise UnsupportedModelError("SimpleImputer of columns that are no numbers")
    given = given.astype(np.float64)
    kept = np.arange(width) if fitted.estimator.keep_empty_features else np.flatnonzero(~np.isnan(given))
    missing = missing_value(fitted, builder, value)
    fill = fitted.floats_of("statistics_", given[kept].astype(kind), (len(kept),))
    if not len(kept):
        raise UnsupportedModelError("SimpleImputer of columns that were all missing in training")
    everything = np.array_equal(kept, np.arange(width))
    picked = value if everything else builder.select(kept, value)
    filled = builder.add(FillMissing((picked,), fill, None if np.isnan(missing) else missing))
    return indicated(fitted, builder, value, missing, filled)


def indicated(fitted: Fitted, builder: GraphBuilder, value: int, missing: float, filled: int) -> int:
    """What an imputer makes, and behind it which columns were missing where the imputer adds that."""
    if not fitted.flag("add_indicator"):
        return filled
    inner = Fitted(fitted.get("indicator_"))
    columns = inner.integers("features_", (None,), low=0, high=builder.width(value) - 1)
    if not len(columns):
        return filled
    return builder.beside(filled, indicators(builder, value, missing, columns))


def _categories(fitted: Fitted, builder: GraphBuilder, value: int) -> list[tuple[FloatArray, bool]]:
    """The rising categories of each column, and whether NaN is one of them."""
    found = []
    for number, given in enumerate(fitted.items("categories_", builder.width(value))):
        if not isinstance(given, np.ndarray) or given.dtype.kind not in "fiub":
            raise UnsupportedModelError(
                f"{fitted.kind}: column {number} has categories that are no numbers; a PLC block takes numbers: encode "
                "them as integers before training"
            )
        numbers = given.astype(np.float64)
        if given.dtype.kind in "iu" and np.any(numbers[1:] == numbers[:-1]) and np.all(given[1:] > given[:-1]):
            raise UnsupportedModelError(
                f"{fitted.kind}: column {number} has categories that are equal as LREAL, which holds all integers up "
                "to 2**53 only: encode them as smaller integers before training"
            )
        known = _rising(fitted, "categories_", fitted.floats_of("categories_", numbers[~np.isnan(numbers)], (None,)))
        found.append((known, bool(np.isnan(numbers).any())))
    builder.refuse_magnitude(math.inf)
    return found


#: An encoder is asked about so many rows at once: what it makes of them is as wide as it has categories.
_AT_ONCE = 256


def _answers(estimator: Any, rows: FloatArray, width: int) -> FloatArray:
    """What an encoder makes of rows (rows, outputs), or 0 of none; infinity where it refuses one, found by halving."""
    found = np.full((len(rows), max(width, 1)), math.inf)
    left = np.array_split(np.arange(len(rows)), -(-len(rows) // _AT_ONCE))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while left:
            asked = left.pop()
            try:
                given = estimator.transform(rows[asked])
            except ValueError:
                left += np.array_split(asked, 2) if len(asked) > 1 else []
                continue
            dense = given.toarray() if hasattr(given, "toarray") else given
            found[asked] = np.asarray(dense, np.float64).reshape(len(asked), -1) if width else 0.0
    return found


def _codes(fitted: Fitted, builder: GraphBuilder, value: int, width: int) -> list[FloatArray]:
    """For each column the answers on its categories, an unknown number and NaN, shape (categories + 2, outputs)."""
    categories = _categories(fitted, builder, value)
    first = np.array([known[0] if len(known) else math.nan for known, _ in categories])
    found = []
    for column, (known, _) in enumerate(categories):
        unknown = known[-1] + max(1.0, abs(known[-1])) if len(known) else 0.0
        rows = np.tile(first, (len(known) + 2, 1))
        rows[:, column] = [*known, unknown, math.nan]
        found.append(_answers(fitted.estimator, rows, width))
    return found


def _encoded(builder: GraphBuilder, value: int, fitted: Fitted, columns: Sequence[tuple[int, FloatArray]]) -> int:
    """For pairs of a column and its codes (on its categories, an unknown number, NaN) the code of the number."""
    categories = _categories(fitted, builder, value)
    missing = [column for column, codes in columns if np.isinf(codes[-1])]
    if missing:  # NaN is an unknown category, which is refused
        builder.refuse_nan(builder.select(missing, value))
    parts: list[Column] = []
    absent: list[float | None] = []
    for column, codes in columns:
        known, unknown = categories[column][0], float(codes[-2])
        absent.append(None)
        if np.isnan(unknown):  # a number that is no code
            absent[-1] = unknown = max(0.0, *codes[np.isfinite(codes)].tolist()) + 1.0
        nan = math.nan if np.isinf(codes[-1]) else float(codes[-1])
        parts.append((known, codes[:-2], np.full((len(known) + 1, 1), unknown), nan))
    found = add_pieces(builder, builder.select([column for column, _ in columns], value), parts)
    if any(one is not None for one in absent):
        builder.absent[found] = tuple(absent)
    return found


def _made(fitted: Fitted, dtype: Any = None) -> Precision:
    """What the numbers that an encoder makes are held in; from integers scikit-learn goes on in float64."""
    kind = np.dtype(fitted.get("dtype") if dtype is None else dtype)
    if kind.kind == "f" and kind.itemsize < 4:
        raise UnsupportedModelError(f"{fitted.kind} with dtype={kind}: take float64")
    return Precision.FLOAT32 if kind == np.float32 else Precision.FLOAT64


@transforms("OrdinalEncoder TargetEncoder")
def walk_codes(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """A number for each category (`preprocessing/_encoders.py`, `_target_encoder.py`)."""
    width = builder.width(value)
    classes = len(fitted.get("classes_")) if getattr(fitted.estimator, "target_type_", "") == "multiclass" else 1
    answers = _codes(fitted, builder, value, width * classes)
    columns = [(output // classes, answers[output // classes][:, output]) for output in range(width * classes)]
    codes = _encoded(builder, value, fitted, columns)
    if fitted.kind == "TargetEncoder" or _made(fitted) is Precision.FLOAT64:
        return codes
    return builder.add(Round((codes,), builder.width(codes)))


@transforms("OneHotEncoder")
def walk_one_hot(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """1 in the column of the category, 0 in the others (`preprocessing/_encoders.py: OneHotEncoder.transform`)."""
    sizes = [int(size) for size in fitted.items("_n_features_outs", builder.width(value))]
    ends = np.cumsum([0, *sizes])
    columns = []
    for column, answers in enumerate(_codes(fitted, builder, value, int(ends[-1]))):
        own = answers[:, ends[column] : ends[column + 1]]
        refused = np.isinf(answers[:, 0])
        place = np.argmax(own, axis=1) if own.shape[1] else np.zeros(len(own))
        columns.append((column, np.where(refused, math.inf, np.where(np.any(own > 0, axis=1), place, -1.0))))
    found = _one_hot(builder, _encoded(builder, value, fitted, columns), sizes, _made(fitted))
    builder.sparse[found] = fitted.flag("sparse_output")
    return found


def _one_hot(builder: GraphBuilder, codes: int, sizes: Sequence[int], precision: Precision = Precision.FLOAT64) -> int:
    """For each column of codes so many columns, of which that of the code is 1 and the others are 0."""
    repeated = builder.select(np.repeat(np.arange(len(sizes)), sizes), codes)
    places = np.concatenate([np.arange(float(size)) for size in sizes])
    reached = builder.add(Exceeds((repeated,), places - 0.5))
    passed = builder.add(Exceeds((repeated,), places + 0.5))
    return builder.combine(reached, "-", passed, precision=precision)


@transforms("KBinsDiscretizer", trusts=("numpy.dtype",), finite=True)
def walk_bins(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """How many inner edges of bins do not lie above (`preprocessing/_discretization.py: transform`)."""
    if _made(fitted, np.float64 if fitted.estimator.dtype is None else fitted.estimator.dtype) is Precision.FLOAT32:
        raise UnsupportedModelError("KBinsDiscretizer with dtype=float32, which rounds what it reads: take float64")
    columns: list[Column] = []
    for given in fitted.get("bin_edges_"):
        inner = np.asarray(given)[1:-1]
        edges = _rising(fitted, "bin_edges_", fitted.floats_of("bin_edges_", inner, (None,)))
        count = len(edges) + 1
        columns.append((edges, np.arange(1.0, count), np.arange(float(count))[:, None], math.nan))
    if len(columns) != builder.width(value):
        raise fitted.fail("bin_edges_", "not one list a column")
    binned = add_pieces(builder, value, columns)
    if fitted.estimator.encode == "ordinal":
        return binned
    found = _one_hot(builder, binned, [len(column[0]) + 1 for column in columns])
    builder.sparse[found] = fitted.estimator.encode == "onehot"
    return found


@transforms("QuantileTransformer")
def walk_quantiles(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The share of the training data below, linear between quantiles (`preprocessing/_data.py: _transform_col`).

    On a quantile that several references have, the library takes the mean of the first and the last of them. For a
    normal distribution it takes the number below which such a share of that lies.
    """
    builder.refuse_magnitude(math.inf)
    quantiles = fitted.floats("quantiles_", (None, builder.width(value)))
    references = fitted.floats("references_", (len(quantiles),))
    is_normal = fitted.choice("output_distribution", {"uniform": False, "normal": True})
    if builder.is_sparse(value) and (is_normal or np.any(quantiles < 0)):
        raise UnsupportedModelError(
            f"{fitted.kind} of a sparse matrix, of which it leaves the zeros as they are: set the encoder in front "
            "of it to dense output (sparse_output=False, encode='onehot-dense', sparse_threshold=0)"
        )
    columns: list[Column] = []
    for own in quantiles.T:
        if np.any(np.diff(own) < 0):
            raise fitted.fail("quantiles_", "not rising")
        knots, first, count = np.unique(own, return_index=True, return_counts=True)
        low, high = references[first], references[first + count - 1]
        at = 0.5 * (low + high)
        at[-1], at[0] = 1.0, 0.0
        # of a single quantile the only reference is 0
        ends = (0.0, 1.0 if is_normal else float(references[-1]))
        if is_normal:
            knots, at, low, high = _cut_to_normal(knots, low, high)
        columns.append((knots, at, _linear(knots, low, high, ends), math.nan))
    found = add_pieces(builder, value, columns)
    if not is_normal:
        return found
    limits = (np.full(builder.width(found), end) for end in (_LEAST_NORMAL, 1.0 - _LEAST_NORMAL))
    return builder.function(builder.add(Clip((found,), *limits)), "normal_quantile")


#: How near to 0 and 1 a share of a normal distribution is taken for the end (`preprocessing/_data.py`).
_BOUNDS_THRESHOLD = 1e-7


#: The share of the smallest number that a normal distribution is given.
_LEAST_NORMAL = _BOUNDS_THRESHOLD - float(np.spacing(1.0))


def _cut_to_normal(
    knots: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Knots, and what lies on, before and behind them, cut where the library takes a number for one of the ends.

    That is where it lies less than a threshold above the first quantile, or below the last one, in numbers as they
    round; where both hold, it is the first. Among large numbers the quantiles themselves may be taken for neither.
    """
    _widths(knots)
    first, last = float(knots[0]), float(knots[-1])
    start = _last_number(first, lambda x: x - _BOUNDS_THRESHOLD < first)
    stop = -_last_number(-last, lambda x: -x + _BOUNDS_THRESHOLD > last)
    if stop <= start:
        return np.array([max(start, first)]), np.zeros(1), np.zeros(1), np.zeros(1)
    inside = (knots > start) & (knots < stop)

    def between(x: float, piece: int) -> float:
        if len(knots) == 1:  # a large one, beside which no number is between the ends
            return 0.0
        at = min(max(piece, 0), len(knots) - 2)
        share = (x - knots[at]) / (knots[at + 1] - knots[at])
        return float(high[at] + (low[at + 1] - high[at]) * share)

    before = between(stop, int(np.searchsorted(knots, stop, "left")) - 1)
    behind = between(start, int(np.searchsorted(knots, start, "right")) - 1)
    ends = np.array([start]), np.array([stop])
    return (
        np.concatenate([ends[0], knots[inside], ends[1]]),
        np.array([0.0, *(0.5 * (low + high))[inside], 1.0]),
        np.array([0.0, *low[inside], before]),
        np.array([behind, *high[inside], 1.0]),
    )


def _last_number(start: float, holds: Callable[[float], bool]) -> float:
    """The last number for which holds what holds for smaller ones; it lies not far from `start`, or just before it."""
    low, high = math.nextafter(start, -math.inf), start + 4.0 * max(_BOUNDS_THRESHOLD, math.ulp(start))
    high = min(high, sys.float_info.max)
    while math.nextafter(low, high) < high:
        middle = low + (high - low) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def inverse_quantiles(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The number below which a share of the training data lies (`preprocessing/_data.py: _transform_col`, inverse)."""
    width = builder.width(value)
    quantiles = fitted.floats("quantiles_", (None, width))
    references = _rising(fitted, "references_", fitted.floats("references_", (len(quantiles),)))
    knots = references
    if fitted.estimator.output_distribution == "normal":
        value = builder.chain(builder.function(builder.scale(value, "*", 0.5**0.5), "erf"), ("+", 1.0), ("*", 0.5))
        last = 1.0 - _BOUNDS_THRESHOLD
        while last + _BOUNDS_THRESHOLD > 1.0:
            last = math.nextafter(last, 0.0)
        while math.nextafter(last, 1.0) + _BOUNDS_THRESHOLD <= 1.0:
            last = math.nextafter(last, 1.0)
        inside = references[(references > _BOUNDS_THRESHOLD) & (references < last)]
        knots = np.array([_BOUNDS_THRESHOLD, *inside, last])
    columns: list[Column] = []
    for own in quantiles.T:
        values = np.interp(knots, references, own)
        columns.append((knots, values, _linear(knots, values, values, (own[0], own[-1])), math.nan))
    return add_pieces(builder, value, columns)


def _widths(knots: FloatArray) -> FloatArray:
    """How far each knot lies before the next one; beyond the largest number libraries have no slope for it."""
    with np.errstate(over="ignore"):
        widths: FloatArray = np.diff(knots)
    if not np.all(np.isfinite(widths)):
        raise UnsupportedModelError(
            "knots that lie further apart than the largest number: scale the data down before training"
        )
    return widths


def _linear(knots: FloatArray, left: FloatArray, right: FloatArray, ends: tuple[float, float]) -> FloatArray:
    """Pieces from the right end at each knot to the left end at the next one; constant `ends` beyond."""
    pieces = np.zeros((len(knots) + 1, 2))
    pieces[0, 0], pieces[-1, 0] = ends
    pieces[1:-1, 0] = right[:-1]
    with np.errstate(over="ignore"):
        pieces[1:-1, 1] = (left[1:] - right[:-1]) / _widths(knots)
    if not np.all(np.isfinite(pieces[:, 1])):
        raise UnsupportedModelError(
            "knots that lie too near to each other for a slope: scale the data up before training"
        )
    return pieces


@walks("IsotonicRegression", finite=True, single=True)
@transforms("IsotonicRegression", finite=True, single=True)
def walk_isotonic(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Linear between thresholds (`isotonic.py: _transform`); beyond them the ends, or no answer."""
    given = fitted.get("X_thresholds_")
    knots = _rising(fitted, "X_thresholds_", fitted.floats("X_thresholds_", (None,)))
    values = fitted.floats("y_thresholds_", (len(knots),))
    if not len(knots) or builder.width(value) != 1:
        raise fitted.fail("X_thresholds_", "not the thresholds of one column")
    single = given.dtype == np.float32
    if single:
        value, knots, values = builder.add(Round((value,), 1)), given, values.astype(np.float32)
    clips = fitted.estimator.out_of_bounds == "clip" or len(knots) == 1
    ends = (float(values[0]), float(values[-1])) if clips else (math.inf, math.inf)
    value = add_pieces(builder, value, [(knots, values, _linear(knots, values, values, ends), math.nan)])
    if not single:
        return value
    # scipy's slope * (x - knot) + y in float32: the product is at most twice the largest y and rounded with its factor,
    # the sum is rounded once
    doubt = 6 * 2.0**-24 * np.abs(values).max().astype(np.float64) + 2.0**-148
    return builder.add(Round((builder.scale(value, "+", 0.0, doubt=np.array([doubt])),), 1))


@transforms(
    "SplineTransformer",
    # the second is how scipy makes arrays, of which a spline keeps the name
    trusts=("scipy.interpolate._bsplines.BSpline", "scipy._lib.array_api_compat.numpy._aliases.asarray"),
)
def walk_splines(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The basis splines of each column (`preprocessing/_polynomial.py: SplineTransformer.transform`)."""
    width, mode = builder.width(value), fitted.estimator.extrapolation
    degree = fitted.integer("degree", 0, 10)
    if degree < {"constant": 1, "error": 1, "periodic": 1, "linear": 2}.get(mode, math.inf):
        # how far the library's polynomials err where they go on without end is not derived; of degree 1 its lines
        # are not those of the splines
        raise UnsupportedModelError(
            f"SplineTransformer with extrapolation={mode!r} and degree={degree}: supported are 'constant', 'error' and "
            "'periodic' with a degree from 1 on, and 'linear' with one from 2 on"
        )
    if getattr(fitted.estimator, "handle_missing", "error") == "zeros":
        builder.refuse_magnitude(math.inf)
        missing = 0.0
    else:
        builder.refuse_special(value)
        missing = math.nan
    columns: list[Column] = []
    repeated: list[int] = []
    lines: list[_Lines] = []
    spans: list[tuple[float, float]] = []
    for number, spline in enumerate(fitted.items("bsplines_", width)):
        own = Fitted(spline)
        # what native code takes; the public ones are what a function in the object makes of these
        inside = "_" if hasattr(spline, "_t") else ""
        knots = own.floats(f"{inside}t", (None,))
        if np.any(np.diff(knots) <= 0):  # so `fit` leaves them where the column was constant
            is_constant = np.ptp(knots[degree : len(knots) - degree]) <= 0
            fewer = "" if is_constant else ", or take fewer n_knots or knots='uniform'"
            raise UnsupportedModelError(
                f"SplineTransformer: column {number} has knots that are equal or fall, as a constant column and "
                f"quantiles of few numbers give them: leave it out{fewer}"
            )
        count = len(knots) - degree - 1
        spans.append((knots[degree], knots[count]))
        made = count - degree if mode == "periodic" else count
        if own.integer("k", degree, degree) != degree or not np.array_equal(
            own.floats(f"{inside}c", (count, None)), np.eye(made)[np.arange(count) % made]
        ):
            raise own.fail("c", "not the basis")
        kept = made if fitted.flag("include_bias") else made - 1
        basis = _basis([Fraction(float(knot)) for knot in knots], degree)
        if mode == "periodic":  # the last splines go on as the first ones
            basis = [[sum(row[place:count:made], 0 * row[0]) for place in range(made)] for row in basis]
        columns += [_spline(knots[degree : count + 1], basis, place, mode, missing) for place in range(kept)]
        lines += [_lines(knots[degree : count + 1], basis, place) for place in range(kept)]
        repeated += [number] * kept
    if not columns:
        raise UnsupportedModelError("SplineTransformer gives no column")
    if mode == "periodic":
        value = _in_one_period(builder, value, np.array(spans))
    picked = builder.select(repeated, value)
    found = add_pieces(builder, picked, columns)
    if mode == "linear":
        found = _on_lines(builder, picked, found, lines)
    builder.sparse[found] = bool(getattr(fitted.estimator, "sparse_output", False))
    return found


#: Periods beyond which a number is not led back.
_PERIODS = 2.0**20


def _in_one_period(builder: GraphBuilder, value: int, spans: FloatArray) -> int:
    """Numbers moved by whole periods to between the two ends of each column, as `first + (x - first) % period`.

    NumPy's remainder is exact but for the last addition of a period to a negative one, and so is this for a period of
    few digits, such as 24: multiples of it are numbers, and a quotient that was rounded to the next whole number leaves
    a negative rest, which is moved once more. Of other periods multiples are rounded. Numbers further than 2**20
    periods away have no answer.
    """
    first, last = spans.T
    period = last - first
    whole = np.frexp(period)[0] * 2.0**33
    short = whole == np.trunc(whole)
    moved = builder.scale(value, "-", first)
    turns = builder.add(WholeNumber((builder.scale(moved, "/", period),), len(period), Towards.BELOW))
    within = np.array([-_PERIODS, _PERIODS]), np.zeros(2), np.array([[math.inf], [0.0], [math.inf]]), math.nan
    turns = builder.combine(turns, "+", add_pieces(builder, turns, [within] * len(period)))
    doubt = None if short.all() else np.where(short, 0.0, np.spacing(period))
    rest = builder.combine(moved, "-", builder.scale(turns, "*", period, doubt=doubt))
    reached = builder.add(Exceeds((rest,), np.zeros(len(period)), inclusive=True))
    again = builder.scale(builder.scale(reached, "-", 1.0, reverse=True), "*", period)
    # the library may come to lie beyond the last knot by a rounding, where its polynomials go on
    end = np.where(first + period > last, first + period - last, 0.0)
    return builder.scale(builder.combine(rest, "+", again), "+", first, doubt=end if end.any() else None)


#: Coefficients of rising powers, an array of fractions.
_Polynomial = AnyArray


def _basis(knots: list[Fraction], degree: int) -> list[list[_Polynomial]]:
    """The basis splines between inner knots: for each interval all of them, in powers of the distance to its start.

    The recursion of de Boor and Cox in fractions, so that a coefficient is rounded once.
    """
    count = len(knots) - degree - 1
    found = []
    for interval in range(degree, count):
        origin = knots[interval]
        row: list[_Polynomial] = [np.array([Fraction(int(place == interval))]) for place in range(len(knots) - 1)]
        for power in range(1, degree + 1):
            # each rises from 0 at its own first knot, and falls to 0 at its last
            rising = [
                _times(row[place], origin - knots[place], 1) / (knots[place + power] - knots[place])
                for place in range(len(row))
            ]
            falling = [
                _times(row[place], knots[place + power] - origin, -1) / (knots[place + power] - knots[place])
                for place in range(len(row))
            ]
            row = [one + other for one, other in zip(rising[:-1], falling[1:], strict=True)]
        found.append(row)
    return found


def _times(polynomial: _Polynomial, constant: Fraction, slope: int) -> _Polynomial:
    none = np.array([Fraction(0)])
    return np.asarray(np.concatenate([constant * polynomial, none]) + np.concatenate([none, slope * polynomial]))


def _spline(knots: FloatArray, basis: list[list[_Polynomial]], place: int, mode: str, missing: float) -> Column:
    """One basis spline: on the inner knots, between them, and beyond them as the extrapolation says."""
    inner = [basis[interval][place] for interval in range(len(basis))]
    length = Fraction(float(knots[-1])) - Fraction(float(knots[-2]))
    end = sum((c * length**power for power, c in enumerate(inner[-1])), Fraction(0))
    zero = [Fraction(0)] * (len(inner[0]) - 1)
    pieces = np.array([[inner[0][0], *zero], *inner, [end, *zero]]).astype(np.float64)
    if mode == "error":
        pieces[[0, -1]] = 0.0
        pieces[[0, -1], 0] = math.inf
    return knots, np.array([*(float(polynomial[0]) for polynomial in inner), float(end)]), pieces, missing


#: Of the first and of the last knot of a spline: the knot, the slope beyond it, and how far that of scipy may be off.
_Lines = tuple[tuple[float, float, float], tuple[float, float, float]]


def _lines(knots: FloatArray, basis: list[list[_Polynomial]], place: int) -> _Lines:
    """The lines on which a basis spline goes on beyond its ends.

    scipy computes their slopes in a form of its own: as of a piece, no more than sixteen roundings for each power, of
    numbers as large as the terms.
    """
    found = []
    for interval, first, last in ((0, 0, 1), (-1, -2, -1)):
        inner = basis[interval][place]
        length = Fraction(float(knots[last])) - Fraction(float(knots[first]))
        terms = [power * inner[power] * length ** (power - 1) for power in range(1, len(inner))]
        slope = sum(terms, Fraction(0)) if interval else inner[1]
        size = float(sum(map(abs, terms), Fraction(0)))
        found.append((float(knots[interval]), float(slope), 32 * len(inner) * float(np.finfo(np.float64).eps) * size))
    return found[0], found[1]


def _on_lines(builder: GraphBuilder, value: int, found: int, lines: Sequence[_Lines]) -> int:
    """Splines that are constant beyond their knots, and the lines there (`SplineTransformer.transform`)."""
    # what is missing lies on a knot
    value = builder.add(FillMissing((value,), np.array([low[0] for low, _ in lines])))
    for side, operator in enumerate(("min", "max")):
        knots, slopes, doubts = np.array([line[side] for line in lines]).T
        beyond = builder.chain(value, ("-", knots), (operator, 0.0))
        found = builder.combine(found, "+", builder.scale(beyond, "*", slopes, doubt=doubts))
    return found
