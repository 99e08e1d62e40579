"""Errors that no effect of the catalogue explains: each changes harmonics or curves in a way of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .effects import Spectrum
from .layout import Conditions


@dataclass(frozen=True)
class Foreign:
    """An error outside the catalogue: `orders` it shows at, what it adds to c_k, or what it adds to curves.

    `spectrum(rng, runs)` has unit size (1 deg where it is largest, roughly); `curve(rng, runs, samples)` likewise,
    shape (2, runs, samples). `orders` is empty where the signature is not one of fixed orders.
    """

    orders: tuple[int, ...]
    spectrum: Callable[[np.random.Generator, Conditions], Spectrum] | None = None
    curve: Callable[[np.random.Generator, Conditions, int], np.ndarray] | None = None


def _both(values: np.ndarray) -> np.ndarray:
    return np.stack([values, values]).astype(complex)


def _phase(rng: np.random.Generator) -> complex:
    return complex(np.exp(2j * np.pi * rng.random()))


def _odd_torque(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """Order 7, which belongs to no part, rising and falling with the torque."""
    return {7: _phase(rng) * _both(np.sin(2 * np.pi * runs.torque_Nm / 1500.0))}


def _temperature_squared(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """Order 55 with the square of the oil's distance from 30 degC."""
    return {55: _phase(rng) * _both(((runs.temperature_C - 30.0) / 5.0) ** 2)}


def _ageing(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """Order 23 that grows from the first run of the campaign to the last, whatever the condition: not stationary."""
    return {23: _phase(rng) * _both(np.arange(len(runs)) / len(runs))}


def _speed_hump(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """The mean rises around one speed, equally in both directions."""
    centre = rng.uniform(600.0, 1300.0)
    return {0: _both(np.exp(-(((runs.speed_rpm - centre) / 300.0) ** 2)))}


def _even_torque(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """The mean moves with the square of the torque, equally in both directions: no wind-up does that."""
    return {0: _both((runs.torque_Nm / 1800.0) ** 2)}


def _warm_mesh(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """Order 78, a mesh order, with the temperature: the order of a known effect, the law of none."""
    return {78: _phase(rng) * _both((runs.temperature_C - 30.0) / 5.0)}


def _odd_direction(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """Order 5 with opposite signs in both directions, alone: a worn sector would have its neighbours too."""
    one = np.ones(len(runs))
    return {5: _phase(rng) * np.stack([one, -one]).astype(complex)}


def _lone_order(rng: np.random.Generator, runs: Conditions) -> Spectrum:
    """A constant order 11: of no part of the machine."""
    return {11: _phase(rng) * _both(np.ones(len(runs)))}


def _chirp(rng: np.random.Generator, runs: Conditions, samples: int) -> np.ndarray:
    """A wave that gets faster over the revolution, from order 15 to order 65."""
    theta = 2 * np.pi * np.arange(samples) / samples
    wave = np.cos(15.0 * theta + 25.0 * theta**2 / np.pi / 2.0 + 2 * np.pi * rng.random())
    return np.broadcast_to(wave, (2, len(runs), samples)).copy()


def _hum(rng: np.random.Generator, runs: Conditions, samples: int) -> np.ndarray:
    """50 Hz of the mains in the signal, with a phase of its own in each run: fixed in time, not in angle."""
    f_out = runs.speed_rpm / 60.0 / 81.0
    theta = np.arange(samples) / samples
    order = (50.0 / f_out)[None, :, None]
    phase = rng.uniform(0, 2 * np.pi, (2, len(runs), 1))
    # the recording filter keeps what the samples cannot follow out of the file
    return np.asarray(np.where(order < 0.4 * samples, np.cos(2 * np.pi * order * theta + phase), 0.0))


def _half_order(rng: np.random.Generator, runs: Conditions, samples: int) -> np.ndarray:
    """Order 26.5: it does not close after a revolution (a cage that slips)."""
    theta = 2 * np.pi * np.arange(samples) / samples
    phase = rng.uniform(0, 2 * np.pi, (2, len(runs), 1))
    return np.asarray(np.cos(26.5 * theta + phase))


KINDS: dict[str, Foreign] = {
    "order7_odd_torque_law": Foreign((7,), spectrum=_odd_torque),
    "order55_temperature_squared": Foreign((55,), spectrum=_temperature_squared),
    "order23_grows_in_time": Foreign((23,), spectrum=_ageing),
    "mean_humps_at_a_speed": Foreign((0,), spectrum=_speed_hump),
    "mean_even_in_torque": Foreign((0,), spectrum=_even_torque),
    "order78_with_temperature": Foreign((78,), spectrum=_warm_mesh),
    "order5_odd_in_direction": Foreign((5,), spectrum=_odd_direction),
    "order11_constant": Foreign((11,), spectrum=_lone_order),
    "chirp_over_the_revolution": Foreign((), curve=_chirp),
    "mains_hum": Foreign((), curve=_hum),
    "order_and_a_half": Foreign((), curve=_half_order),
}
