"""Amplitudes of mesh orders over load, direction and the time of the campaign.

Contact laws after Johnson, "Contact Mechanics" (1985): the approach of two bodies in point contact grows with the
power 2/3 of the load; sharing of load among more teeth saturates (Blanche and Yang, "Cycloid drives with machining
tolerances", J. Mechanisms, Transmissions and Automation in Design 111 (1989) 337-344); bending of thin discs with
play grows with a power above 1. Wear that sets in: Archard, J. Applied Physics 24 (1953) 981-988.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .points import Array, Part, Points, Waves

Law = Callable[[Points], Array]
FULL_LOAD = 1600.0


def power(exponent: float) -> Law:
    return lambda points: (np.maximum(points.torque, 0.0) / FULL_LOAD) ** exponent


def saturating(half_load: float) -> Law:
    return lambda points: np.tanh(points.torque / half_load) / np.tanh(FULL_LOAD / half_load)


def one() -> Law:
    return lambda points: np.ones(len(points))


def step(at: float, after: float) -> Law:
    """1 before a moment of the campaign, `after` from then on."""
    return lambda points: np.where(points.when < at, 1.0, after)


def wave_part(
    title: str,
    names: tuple[str, ...],
    order: int,
    law: Law,
    size: complex,
    backward: complex | None = None,
    **more: object,
) -> Part:
    """One order whose amplitude follows a law; `backward` is its complex amplitude there (as forward if None)."""
    sizes = np.array([size, size if backward is None else backward])

    def waves(points: Points) -> Waves:
        return {float(order): np.asarray(law(points)[:, None] * sizes[None, :])}

    return Part(title, names, (order,), waves, **more)  # type: ignore[arg-type]


def exchange_part(title: str, names: tuple[str, ...], order: int, at: float, before: complex, after: complex) -> Part:
    """One order with another amplitude and phase after something was mounted anew."""

    def waves(points: Points) -> Waves:
        value = np.where(points.when < at, before, after)
        return {float(order): np.asarray(np.repeat(value[:, None], 2, axis=1))}

    return Part(title, names, (order,), waves, in_time=True)


def mesh_name(order: int, ratio: int, teeth: int, pins: int) -> str:
    """The effect that truly makes a wave of a mesh order, by the kinematics of the gear."""
    if order % teeth == 0:
        return "cycloid_tooth_error"
    if order % pins == 0:
        return "pin_error"
    if order % ratio == 0:
        return "input_shaft_misalignment"
    raise ValueError(f"order {order} belongs to no part of this gear")
