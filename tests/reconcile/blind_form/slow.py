"""Changes of the mean: springs that are not linear, friction, heat that lags, a zero that creeps.

Springs: ISO 76-like contact with the power 2/3 (Johnson 1985), stiffness by steps as the vendors of strain wave gears
give it (K1, K2, K3 over torque). Friction: Stribeck, see oscillator.py. Heat: one body with a first-order lag,
Incropera and DeWitt, "Fundamentals of Heat and Mass Transfer", chapter 5 (lumped capacitance).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .oscillator import Stribeck
from .points import DIRECTIONS, Array, Part, Points, Waves


def mean_part(
    title: str,
    names: tuple[str, ...],
    value: Callable[[Points], Array],
    signed: bool = False,
    touches: tuple[str, ...] = (),
    in_time: bool = False,
) -> Part:
    """A mean in deg over the points; `signed`: it changes its sign with the direction."""

    def waves(points: Points) -> Waves:
        sign = DIRECTIONS if signed else np.ones(2)
        return {0.0: np.asarray(value(points)[:, None] * sign[None, :], dtype=np.complex128)}

    return Part(title, names, (0,), waves, touches=touches, in_time=in_time)


def linear_spring(stiffness: float) -> Callable[[Points], Array]:
    """-M / K in deg; stiffness in N m per arcmin."""
    return lambda points: -points.torque / stiffness / 60.0


def hertz_spring(full_deg: float, full_load: float) -> Callable[[Points], Array]:
    return lambda points: -full_deg * (points.torque / full_load) ** (2.0 / 3.0)


def stepped_spring(stiffness: tuple[float, float, float], torques: tuple[float, float]) -> Callable[[Points], Array]:
    """K1 up to the first torque, K2 up to the second, then K3 (N m per arcmin)."""

    def at(points: Points) -> Array:
        load = points.torque
        low = np.minimum(load, torques[0]) / stiffness[0]
        middle = np.clip(load - torques[0], 0.0, torques[1] - torques[0]) / stiffness[1]
        high = np.maximum(load - torques[1], 0.0) / stiffness[2]
        return np.asarray(-(low + middle + high) / 60.0)

    return at


def stribeck_windup(friction: Stribeck, stiffness: float, ratio: int) -> Callable[[Points], Array]:
    """Wind-up of the drive train by friction: it lags behind the direction of turning."""
    return lambda points: -friction.torque(points.speed / ratio) / stiffness / 60.0


def shifted_by(moved: float, half_load: float) -> Callable[[Points], Array]:
    """Half of a play that a load takes up gradually, as contacts close one after the other (arctan law)."""
    return lambda points: moved * (1.0 - 2.0 / np.pi * np.arctan(points.torque / half_load))


def lagging_oil(campaign: Points, lag: float, start_C: float = 22.0) -> Callable[[Points], Array]:
    """Temperature of a body that follows the oil with a time constant `lag`, in lengths of the campaign.

    Its history is the campaign's; at other times it is interpolated.
    """
    order = np.argsort(campaign.when, kind="stable")
    when, oil = campaign.when[order], campaign.temperature[order]
    out = np.empty(len(campaign))
    body, last = start_C, 0.0
    for row, (now, around) in enumerate(zip(when, oil, strict=True)):
        body += (1.0 - np.exp(-(now - last) / lag)) * (around - body)
        last = now
        out[row] = body
    return lambda points: np.interp(points.when, when, out)


def thermal_lag(campaign: Points, per_K: float, lag: float) -> Callable[[Points], Array]:
    """Mean in deg that follows the temperature of the lagging body, 0 at 30 deg C."""
    body = lagging_oil(campaign, lag)
    return lambda points: per_K * (body(points) - 30.0)


def creep(size: float, pace: float) -> Callable[[Points], Array]:
    """A mount that settles: size * (1 - exp(-t / pace)) over the time of the campaign."""
    return lambda points: size * (1.0 - np.exp(-points.when / pace))
