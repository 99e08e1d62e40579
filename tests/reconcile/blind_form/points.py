"""Operating points in the order in which they were measured, and the waves that a part of a machine makes there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: order -> complex amplitude in deg, of shape (points, 2): forward and backward; TE = sum of Re(C * exp(i*order*theta))
Waves = Mapping[float, Complex]

DIRECTIONS = np.array([1.0, -1.0])


@dataclass(frozen=True)
class Points:
    """One entry a run: input speed (rpm), output torque (N m), oil (deg C), time of the campaign (0 to 1), seed."""

    speed: Array
    torque: Array
    temperature: Array
    when: Array
    number: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.speed)

    def hertz(self, order: float, ratio: float) -> Array:
        """Frequency at which an order of the output passes."""
        return order * self.speed / 60.0 / ratio

    def both(self, values: Array) -> Array:
        """The same values for both directions, (points, 2)."""
        return np.repeat(np.asarray(values, dtype=np.float64)[:, None], 2, axis=1)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Points:
        values = (self.speed, self.torque, self.temperature, self.when, self.number)
        return Points(*(value[chosen] for value in values))


@dataclass(frozen=True)
class Part:
    """Something that the rig model lacks, and what may truly be said about it.

    `names`: effects whose naming is true of it (a right family counts). `orders`: where it is to be seen, () for an
    order that depends on the speed. `touches`: known effects whose parameters it truly changes, "zero" for the zero of
    the encoders. `hedged`: names that are true only beside alternatives, a remark or a probability below 0.95.
    `near`: orders that it may also be named by, as sidebands by their mesh order.
    `hertz`: the range of its frequency over the operating points, for a resonance. `in_time`: it changes with the time
    of the campaign, or from run to run.
    """

    title: str
    names: tuple[str, ...]
    orders: tuple[int, ...]
    waves: Callable[[Points], Waves]
    touches: tuple[str, ...] = ()
    hedged: tuple[str, ...] = ()
    near: tuple[int, ...] = ()
    hertz: tuple[float, float] | None = None
    in_time: bool = False


def angles(samples: int) -> Array:
    """Angles of the output in deg, evenly over one revolution."""
    return np.arange(samples) * (360.0 / samples)


def curves(waves: Waves, samples: int) -> Array:
    """TE in deg at `angles(samples)`, of shape (points, 2, samples)."""
    theta = np.radians(angles(samples))
    total = None
    for order, amplitude in waves.items():
        turn = np.exp(1j * order * theta)
        one = np.real(amplitude[:, :, None] * turn)
        total = one if total is None else total + one
    assert total is not None, "a part without any wave"
    return np.asarray(total)


def spectrum(te: Array) -> Complex:
    """Complex amplitudes of the integer orders 0 to N/2 - 1 of evenly sampled curves, as in `curves`."""
    samples = te.shape[-1]
    found = np.fft.rfft(te, axis=-1)[..., : samples // 2] * (2.0 / samples)
    found[..., 0] /= 2.0
    return np.asarray(found)


def rms_by_order(amplitudes: Complex) -> Array:
    """RMS in deg over all curves of each order of a `spectrum`: |A_0|, and |A_k| / sqrt(2) of a wave."""
    power = np.mean(np.abs(amplitudes.reshape(-1, amplitudes.shape[-1])) ** 2, axis=0)
    power[1:] /= 2.0
    return np.asarray(np.sqrt(power))
