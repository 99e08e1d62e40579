"""Noise of runs that lie anywhere: what a smooth function of speed, torque and temperature leaves of them.

The function is a Gaussian process. How fast it changes along each condition and how loud the noise beside it is are
not chosen but averaged over, by how likely the data are under each choice, so that a plane, a bend and nothing at all
compete on equal terms (MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapters 28 and 45).
"""

from __future__ import annotations

import itertools

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.rig.effects import Conditions

#: over how much of its range a function changes along speed, torque and temperature; inf: not at all. What changes
#: faster than a fifth of a range looks like noise to runs that are scattered
_LENGTHS = ((0.2, 0.5, 1.5, np.inf), (0.2, 0.5, 1.5, np.inf), (0.7, 2.0, np.inf))
#: variance of the noise over that of the function
_RATIOS = np.geomspace(1e-8, 1e2, 31)
#: fewer runs of a direction say nothing; of more than these their neighbours say as much at less cost
LEAST, MOST = 16, 200


def noise_beside(at: Conditions, values: ComplexArray, orders: IntArray) -> FloatArray:
    """Standard deviation of one component of the noise of runs of one direction, float64 (K,); inf if not told.

    values: complex128 (n, K), deg.
    """
    count = len(values)
    if not LEAST <= count <= MOST:
        return np.full(len(orders), np.inf)
    is_mean = orders == 0
    parts = np.where(is_mean, 1, 2)
    apart = np.hstack([values.real, np.where(is_mean, 0.0, values.imag)])
    evidence, variance = [], []
    for roots, basis in _spectra(at):
        squares = (basis.T @ apart) ** 2
        power = squares[:, : len(orders)] + squares[:, len(orders) :]
        size = roots[:, None] + _RATIOS
        scale = power.T @ (1.0 / size) / (len(roots) * parts)[:, None]
        scale = np.maximum(scale, 1e-300)
        evidence.append(-0.5 * parts[:, None] * (len(roots) * np.log(scale) + np.log(size).sum(axis=0)))
        variance.append(scale * _RATIOS)
    logs, values_of = np.concatenate(evidence, axis=1), np.concatenate(variance, axis=1)
    weight = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(np.sqrt((weight * values_of).sum(axis=1) / weight.sum(axis=1)))


#: of the last conditions: their own bytes, and the spectra of all kernels
_KEPT: dict[bytes, list[tuple[FloatArray, FloatArray]]] = {}


def _spectra(at: Conditions) -> list[tuple[FloatArray, FloatArray]]:
    """For each choice of lengths the eigenvalues (n - 1,) and vectors (n, n - 1) of the kernel, the mean taken out."""
    columns = at.axes
    key = b"".join(column.tobytes() for column in columns)
    if key not in _KEPT:
        if len(_KEPT) >= 4:
            _KEPT.clear()
        count = len(at)
        apart = [((c[:, None] - c[None]) / max(float(np.ptp(c)), 1e-9)) ** 2 for c in columns]
        # a basis of all that is not the mean
        free = np.linalg.qr(np.column_stack([np.ones(count), np.eye(count)[:, 1:]]))[0][:, 1:]
        varied = [lengths if np.ptp(c) > 0 else (np.inf,) for lengths, c in zip(_LENGTHS, columns, strict=True)]
        _KEPT[key] = []
        for lengths in itertools.product(*varied):
            kernel = np.exp(-0.5 * sum(square / length**2 for square, length in zip(apart, lengths, strict=True)))
            roots, vectors = np.linalg.eigh(free.T @ kernel @ free)
            _KEPT[key].append((np.maximum(roots, 0.0), free @ vectors))
    return _KEPT[key]
