"""Ramps of TE over a turn: c_k = i s / (pi k) exp(-i k start) of a rise s that begins at an angle, for all orders k."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations, rows_that_tell
from st_codegen.reconcile.settings import SETTINGS


def ramp(gap: ComplexArray, noise: FloatArray, orders: IntArray) -> FloatArray:
    """The ramp over a turn (deg) that most orders of each row of a gap (n, K) agree on, (n,).

    They are weighed by the power of their noise, (n, K): of a ramp s an order k above 0 has i s / (pi k), so that only
    the lowest show it above the noise. Where there is no order there is none.
    """
    if not orders.size:
        return np.zeros(len(gap))
    sure = 1.0 / (orders * np.sqrt(np.maximum(noise, 1e-300)))
    size = np.pi * orders * gap.imag
    return np.asarray(np.quantile(size, 0.5, axis=1, method="inverted_cdf", weights=sure))


def ramp_waves(size: FloatArray | float, orders: IntArray, start: float = 0.0) -> ComplexArray:
    """Coefficients of a ramp (deg over a turn) from an angle (rad) on; that of the mean is none of it."""
    return np.asarray(1j * size / (np.pi * np.maximum(orders, 1)) * np.exp(-1j * start * orders))


def in_steps(orders: IntArray, samples: int) -> FloatArray:
    """How many times a ramp's coefficients those of so many samples a turn of it are, (orders,); of 0 samples once.

    It begins between two of them, wherever that is: half of a step before the one.
    """
    return np.asarray(1.0 / np.sinc(orders / samples) if samples else np.ones(len(orders)))


def without_ramp(data: Observations, size: float, start: float = 0.0) -> Observations:
    """Data without a rise (deg) over each turn, from an angle (rad) on."""
    waves = ramp_waves(size, data.orders, start) * in_steps(data.orders, data.samples)
    of_ramp = np.where(data.orders == 0, size / 2, waves)
    return replace(data, values=data.values - of_ramp)


def ramp_deg(orders: IntArray, coefficients: ComplexArray) -> tuple[float, float, float]:
    """The ramp over a turn (deg) that all orders share, the scatter of single ones, and where it begins (rad).

    A ramp s is c_k = i s / (pi k) exp(-i k start). coefficients: complex (n, K) of orders (K,). Single waves have any
    phase: only a ramp has one slope at all orders.
    """
    chosen = orders > 0
    k, own = orders[chosen], coefficients[:, chosen]
    if not k.size:
        return 0.0, np.inf, 0.0
    start = start_of_ramp(own, np.zeros(own.shape), k)
    slopes = (own * np.exp(1j * start * k)).imag * np.pi * k
    size = float(np.median(slopes))
    scatter = float(np.median(np.abs(slopes - size))) / 0.6745
    return (size, scatter, start) if is_one_slope(slopes, k, size) else (0.0, np.inf, 0.0)


def is_one_slope(slopes: FloatArray, orders: IntArray, size: float) -> bool:
    """Whether the lowest of the orders tell about the same slope (n, K) as the others, where there are enough of them.

    What settles after the turn begins jumps there as a ramp does, and comes back: low orders see less of it.
    """
    above = np.flatnonzero(orders >= SETTINGS.ramp_orders[0])
    if len(above) < SETTINGS.least_orders_of_slope:
        return True
    parts = np.split(above, [SETTINGS.lowest_of_slope])
    low, high = (float(np.median(slopes[:, part])) for part in parts)
    return abs(high - low) < SETTINGS.one_slope * abs(size)


def start_of_ramp(gap: ComplexArray, noise: FloatArray, orders: IntArray) -> float:
    """The angle (rad) at which ramps over the turn begin that explain most of gaps (n, K), 0 where that does as well.

    noise: power, (n, K). Few orders have the phases of a ramp by chance, as many angles as there are to try.
    """
    waves = orders > 0
    if waves.sum() < SETTINGS.least_orders_of_zero:
        return 0.0
    some = rows_that_tell(len(gap))
    k, own = orders[waves], gap[some][:, waves]
    # one vote an order, however large it is, as far as it is more than noise
    power = np.maximum((np.abs(own) ** 2).mean(axis=0), 1e-300)
    weighed = own / np.sqrt(power) * np.maximum(1.0 - noise[some][:, waves].mean(axis=0) / power, 0.0)

    def explained(angles: FloatArray) -> FloatArray:
        return np.asarray((np.imag(weighed @ np.exp(1j * np.outer(k, angles))) ** 2).sum(axis=0))

    grid = np.arange(0.0, 2 * np.pi, 2 * np.pi / (8 * int(k.max())))
    best, at_zero = float(grid[explained(grid).argmax()]), float(explained(np.zeros(1))[0])
    if at_zero > SETTINGS.stable * float(explained(np.array([best]))[0]):
        return 0.0
    for step in (grid[1], grid[1] / 20, grid[1] / 400):
        near = best + step * np.linspace(-1, 1, 41)
        best = float(near[explained(near).argmax()])
    return best


def begin_text(start: float) -> str:
    """Where a ramp begins, if not at the zero of the angle."""
    return f" from {np.degrees(start):.1f} deg on" if start else ""
