"""How far two evaluations of coupled pairs may lie apart.

A step moves class t by d = (p Q p - (Q p)_t) / Q_tt, and divides all shares by 1 + d. With p' the shares behind it, a
change of p by a and of d by b changes them by (a + b (e_t - p')) / (1 + d + b), and d changes with p by g a + a Q a /
Q_tt, where g = (2 Q p - Q_t) / Q_tt. So each step is a matrix, the steps of a round are their product, and what
rounding and other pairs do to d enters at its own step.
"""

from __future__ import annotations

import numpy as np

from st_codegen import ir
from st_codegen.ir import reference
from st_codegen.ir.arrays import FloatArray

_UNIT = 2.0**-53
#: Roundings of a step, of both evaluations, with room for operations that a compiler contracts.
_ROUNDINGS = 16


def coupled_difference(op: ir.CoupledPairs, x: FloatArray, given: FloatArray) -> FloatArray:
    """The bound for rows `x` of pairs that may differ by `given`; infinite where another round may follow."""
    count, matrix = op.count, reference.pair_matrix(op, x)
    size, doubt = np.abs(matrix), _matrix_difference(op, x, given)
    shares, found = np.full((len(x), count), 1.0 / count), np.zeros((len(x), count))
    going = np.arange(len(x))
    for _ in range(op.rounds):
        p, error = shares[going], found[going]
        products, total = reference.coupled_products(matrix[going], p)
        lost, lost_total = _evaluated(size[going], p, count)
        moved = _times(size[going], error) + _times(doubt[going], p + error) + lost
        apart = np.max(moved, axis=1) + np.sum(error * np.abs(products) + (p + error) * moved, axis=1) + lost_total
        last = np.max(np.abs(products - total[:, None]), axis=1)
        found[going[np.abs(last - op.epsilon) <= apart]] = np.inf
        on = ~(last < op.epsilon) & np.isfinite(found[going]).all(axis=1)
        going = going[on]
        if not len(going):
            break
        shares[going], found[going] = _round(matrix[going], doubt[going], p[on], error[on], products[on], total[on])
    return found


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("rij,rj->ri", matrix, vector))


def _matrix_difference(op: ir.CoupledPairs, x: FloatArray, given: FloatArray) -> FloatArray:
    """How far the matrices of two evaluations may lie apart, element by element."""
    first, second = np.triu_indices(op.count, 1)
    found = np.zeros((len(x), op.count, op.count))
    for pair, (one, other) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        own, moved = np.abs(x[:, pair]), given[:, pair] + _UNIT
        rest = np.abs(1.0 - x[:, pair])
        unit = (op.count + _ROUNDINGS) * _UNIT
        found[:, one, one] += 2 * rest * moved + moved**2 + unit * rest**2
        found[:, other, other] += 2 * own * moved + moved**2 + unit * own**2
        found[:, one, other] = found[:, other, one] = (own + rest) * moved + moved**2 + unit * own * rest
    return found


def _evaluated(size: FloatArray, p: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """What both evaluations of Q p and p Q p may lose."""
    unit, terms = 2 * (count + 2) * _UNIT, _times(size, p)
    return unit * terms, 2 * unit * np.sum(p * terms, axis=1)


def _round(
    matrix: FloatArray, doubt: FloatArray, p: FloatArray, error: FloatArray, products: FloatArray, total: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The shares behind a round, and the bound on them; infinite where a step may be off by half of itself."""
    rows, count = p.shape
    size, unit = np.abs(matrix), _ROUNDINGS * _UNIT
    lost, lost_total = _evaluated(size, p, count)
    steps, sources, here, stretch = [], [], error, np.ones(rows)
    for place in range(count):
        row, diagonal = matrix[:, place], matrix[:, place, place]
        d = (total - products[:, place]) / diagonal
        grown, slope = 1.0 + d, (2.0 * products - row) / diagonal[:, None]
        after = p.copy()
        after[:, place] += d
        after /= grown[:, None]
        direction = np.eye(count)[place] - after
        # what rounding, other pairs and the square of the change do to d, whatever p is
        off = lost[:, place] + lost_total + np.sum(p * _times(doubt, p), axis=1) + np.sum(doubt[:, place] * p, axis=1)
        off = (off + np.abs(d) * doubt[:, place, place] + np.sum(here * _times(size, here), axis=1)) / diagonal
        off += unit * np.abs(d)
        share = (np.sum(np.abs(slope) * here, axis=1) + off) / grown
        stretch /= np.where(share < 0.5, 1.0 - share, 0.0)
        steps.append((np.eye(count) + direction[:, :, None] * slope[:, None, :]) / grown[:, None, None])
        sources.append(np.abs(direction) * (off / grown)[:, None] + unit * after)
        here = _times(np.abs(steps[-1]), here) + sources[-1]
        squared = np.abs(d) * (np.abs(d) * diagonal + 2.0 * np.abs(products[:, place]))
        lost_total = (lost_total + 2.0 * np.abs(d) * lost[:, place] + unit * (np.abs(total) + squared)) / grown**2
        total = (total + d * (d * diagonal + 2.0 * products[:, place])) / grown / grown
        lost = (lost + unit * (np.abs(products) + np.abs(d[:, None] * row))) / grown[:, None]
        products = (products + d[:, None] * row) / grown[:, None]
        p = after
        lost, lost_total = lost + unit * _times(size, p), lost_total + 2 * unit * np.sum(p * _times(size, p), axis=1)
    behind, found = np.broadcast_to(np.eye(count), matrix.shape), np.zeros_like(p)
    for step, source in zip(reversed(steps), reversed(sources), strict=True):
        found = found + _times(np.abs(behind), source)
        behind = behind @ step
    found = (found + _times(np.abs(behind), error)) * stretch[:, None]
    return p, np.where(np.isnan(found), np.inf, found)
