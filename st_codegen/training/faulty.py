"""Faulty runs in a training set, found by robust statistics on that set alone.

Each row is predicted from all the others by a smooth function of the operating point (kernel ridge regression, whose
leave-one-out errors have a closed form), for every order's cosine and sine part. An error is put in relation to its own
expected size and to the scatter of the rows of the same speed. One bad number makes an outlier; a run is faulty where
most of its numbers are off together: where the *median* of its relative errors over all orders is too large, and too
large for chance, which makes more of few numbers. A faulty
run spoils the prediction of its neighbours, so the worst is taken out and the others are judged again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.ir.arrays import BoolArray, FloatArray

#: median relative error from which a run is faulty at the least; normal numbers have 0.67, and a run is 1 to 20 numbers
LIMIT = 3.0
#: chance that any sound run of a direction is called faulty, of independent normal numbers
FALSE_ALARM = 0.01
RULE = (
    "Runs of the training part of which most numbers are far from what a smooth function of the others says: by "
    f"{LIMIT:g} robust standard deviations at the least, and farther where few numbers or runs tell. Where all are "
    f"sound, about {FALSE_ALARM:.0%} of all directions lose a run, if the numbers scatter about such a function "
    "normally and independently of each other; those with long tails lose more, and so do those with few runs near the "
    "ends of what was measured."
)
#: what a median of absolute values tells of a standard deviation, by the root of the mean square (Rousseeuw and Croux,
#: Alternatives to the median absolute deviation, 1993)
_EFFICIENCY = 0.3675
#: an order of which a number is off by more is named
_OFF = 3.5
#: how far the smooth function reaches (rpm, N m, degC): shorter in speed where structures resonate
_LENGTHS = {False: (170.0, 500.0, 10.0), True: (40.0, 400.0, 8.0)}
#: orders from here on meet resonances within the speed range
_HIGH_ORDER = 100
#: variance of the scatter in units of the function's
_SCATTER = 0.05
#: from this part of the rows on no further one is taken out
_MOST = 0.05
#: rows of one speed that are enough to tell their own scatter
_LEAST_ROWS = 12


@dataclass(frozen=True)
class Faulty:
    """rows: bool (n,), the faulty ones; score: float64 (n,), median relative error; orders: the ones off, by row.

    not_judged: why there may be more of them; empty where all runs were judged.
    """

    rows: BoolArray
    score: FloatArray
    orders: tuple[tuple[int, ...], ...]
    not_judged: str = ""


def faulty_runs(table: HarmonicTable) -> Faulty:
    """Judge the rows of one direction. Where there are few (under 4 for each order), none is called faulty."""
    not_judged = ""
    count = len(table)
    rows, score = np.zeros(count, np.bool_), np.zeros(count)
    orders: list[tuple[int, ...]] = [()] * count
    if count < max(4 * len(table.orders), _LEAST_ROWS):
        return Faulty(rows, score, tuple(orders), "none was looked for, since there are too few runs to tell them")
    while True:
        kept = np.flatnonzero(~rows)
        part = table.rows(kept)
        relative, owner = relative_errors(part)
        median = np.quantile(relative, 0.5, axis=1, method="inverted_cdf")  # more than half are as large
        score[kept] = median
        beyond = median - _limits(part.speed_rpm, len(owner))
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 0.0:
            break
        if rows.sum() >= _MOST * count:
            not_judged = f"of {count} no more than {rows.sum()} are called faulty, and there are others that look so"
            break
        rows[kept[worst]] = True
        orders[kept[worst]] = tuple(dict.fromkeys(map(int, owner[relative[worst] > _OFF])))
    return Faulty(rows, score, tuple(orders), not_judged)


def relative_errors(table: HarmonicTable) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Leave-one-out errors of one direction, float64 (n, numbers), over their robust size; the order of each number."""
    columns, owners = [], []
    for order in table.orders:
        c = table.column(order)
        for part in (c.real,) if order == 0 else (c.real, c.imag):
            columns.append((part - np.median(part)) / (np.std(part) or 1.0))
            owners.append(order)
    y, owner = np.stack(columns, axis=1), np.array(owners, np.intp)
    error = np.empty_like(y)
    for high in (False, True):
        chosen = (owner >= _HIGH_ORDER) == high
        if chosen.any():
            error[:, chosen] = _left_out(table.conditions, y[:, chosen], _LENGTHS[high])
    return np.abs(error) / _scatter(error, table.speed_rpm), owner


def _left_out(x: FloatArray, y: FloatArray, lengths: tuple[float, ...]) -> FloatArray:
    """Errors (n, columns) of each row predicted from the others, over their expected size.

    With K the kernel matrix plus scatter: error = (K^-1 y)_i / (K^-1)_ii, variance 1 / (K^-1)_ii (Rasmussen and
    Williams, Gaussian Processes for Machine Learning, eq. 5.12).
    """
    scaled = x / np.array(lengths)
    square = ((scaled[:, None] - scaled[None]) ** 2).sum(axis=-1)
    inverse = np.linalg.inv(np.exp(-0.5 * square) + _SCATTER * np.eye(len(x)))
    errors: FloatArray = (inverse @ y) / np.sqrt(np.diag(inverse))[:, None]
    return errors


def _limits(speed: FloatArray, numbers: int) -> FloatArray:
    """The median from which each row (n,) is faulty: beyond it lies one of `FALSE_ALARM` of all directions by chance.

    Of independent normal numbers in units of a scatter that is known as well as its rows tell it: Student's t.
    """
    from scipy import special

    more_than_half = numbers // 2 + 1
    chance = special.betaincinv(more_than_half, numbers - more_than_half + 1, FALSE_ALARM / len(speed))
    freedom = np.empty(len(speed))
    for rows in _told_together(speed):
        freedom[rows] = _EFFICIENCY * rows.sum()
    return np.asarray(np.maximum(LIMIT, -special.stdtrit(freedom, chance / 2.0)), np.float64)


def _scatter(error: FloatArray, group: FloatArray) -> FloatArray:
    """Robust size (1.4826 * median of absolute values) of each column's errors, by group where it is large enough."""
    size = np.empty_like(error)
    for rows in _told_together(group):
        size[rows] = np.maximum(1.4826 * np.median(np.abs(error[rows]), axis=0), np.finfo(np.float64).tiny)
    return size


def _told_together(group: FloatArray) -> Iterator[BoolArray]:
    """Which rows (n,) tell a scatter together: all, then those of each group that is large enough."""
    yield np.ones(len(group), np.bool_)
    for value in np.unique(group):
        if (rows := group == value).sum() >= _LEAST_ROWS:
            yield rows
