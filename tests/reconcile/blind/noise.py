"""Noise of the measurement: white, coloured, heavy-tailed, with drift; for harmonic tables and for curves.

`sigma` is the standard deviation of one real number that is written: of the real and of the imaginary part of a
coefficient in a table, of one sample in a curve. Each model keeps that number (for `drift` it is the white part's; the
drift comes on top), so the names differ in shape and not in size.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: samples over which coloured noise along the angle forgets itself
COLOUR_SAMPLES = 12.0
#: correlation of one run with the next in coloured noise of tables
COLOUR_RUNS = 0.7
#: degrees of freedom of Student's t; 3.5 keeps a variance and has a fourth moment without bound
HEAVY_FREEDOM = 3.5
#: standard deviation over a campaign of the drift, in units of the white part
DRIFT_SIZE = 1.0


def autoregressive(rng: np.random.Generator, shape: tuple[int, ...], rho: float) -> np.ndarray:
    """Gaussian noise of unit variance along the last axis, correlation `rho` from one number to the next."""
    white = rng.standard_normal(shape)
    out = np.empty(shape)
    out[..., 0] = white[..., 0]
    step = np.sqrt(1.0 - rho * rho)
    for index in range(1, shape[-1]):
        out[..., index] = rho * out[..., index - 1] + step * white[..., index]
    return out


def heavy(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Student's t of unit variance."""
    return rng.standard_t(HEAVY_FREEDOM, shape) * np.sqrt((HEAVY_FREEDOM - 2.0) / HEAVY_FREEDOM)


def wander(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """A random walk along the last axis, free of its mean, scaled to unit standard deviation in each series."""
    walk = np.cumsum(rng.standard_normal(shape), axis=-1)
    walk -= walk.mean(axis=-1, keepdims=True)
    return walk / walk.std(axis=-1, keepdims=True)


def _table_white(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.standard_normal(shape)


def _table_coloured(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return autoregressive(rng, shape, COLOUR_RUNS)


def _table_drift(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.standard_normal(shape) + DRIFT_SIZE * wander(rng, shape)


_TABLE: dict[str, Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]] = {
    "white": _table_white,
    "coloured": _table_coloured,
    "heavy": heavy,
    "drift": _table_drift,
}
MODELS = tuple(_TABLE)


def of_coefficients(rng: np.random.Generator, model: str, sigma: np.ndarray, directions: int, runs: int) -> np.ndarray:
    """Complex noise, shape (orders, directions, runs), for `sigma` (orders,); order 0 stands first and is real."""
    shape = (2, len(sigma), directions, runs)
    parts = _TABLE[model](rng, shape) * sigma[None, :, None, None]
    parts[1, 0] = 0.0
    return np.asarray(parts[0] + 1j * parts[1])


def of_samples(rng: np.random.Generator, model: str, sigma: float, shape: tuple[int, int, int]) -> np.ndarray:
    """Noise of curves, shape (directions, runs, samples): along the angle, with drift within and between runs."""
    directions, runs, samples = shape
    if model == "heavy":
        return sigma * heavy(rng, shape)
    if model == "coloured":
        return sigma * autoregressive(rng, shape, float(np.exp(-1.0 / COLOUR_SAMPLES)))
    noise = sigma * rng.standard_normal(shape)
    if model == "drift":
        ramp = np.linspace(-0.5, 0.5, samples)
        slope = 0.2 * sigma * rng.standard_normal((directions, runs, 1))
        level = 0.2 * DRIFT_SIZE * sigma * wander(rng, (directions, runs))[..., None]
        noise = noise + slope * ramp + level
    return noise
