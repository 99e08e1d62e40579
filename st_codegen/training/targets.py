"""What models learn of a harmonic: amplitude and phase, or cosine and sine part.

A bare phase jumps from pi to -pi where a harmonic turns past it; the parts A*cos(phi) and A*sin(phi) do not. Where a
phase is learned all the same, it is turned to lie around the mean direction of the training rows, so that it jumps
where few rows are. Values are handed to the families in robust units: (y - median) / (interquartile range / 1.349).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.te.harmonics import Quantity


class Coordinates(StrEnum):
    """The pair of quantities that describes a harmonic."""

    POLAR = "amplitude and phase"
    PARTS = "cosine and sine part"

    def quantities(self, order: int) -> tuple[Quantity, ...]:
        """The quantities in the order of their targets; the mean has only its (signed) amplitude."""
        if order == 0:
            return (Quantity.AMPLITUDE,)
        return (Quantity.AMPLITUDE, Quantity.PHASE) if self is Coordinates.POLAR else (Quantity.COSINE, Quantity.SINE)


def kinds(order: int) -> tuple[Coordinates, ...]:
    """The ways to learn an order: the mean has one, all others two."""
    return (Coordinates.POLAR, Coordinates.PARTS) if order else (Coordinates.POLAR,)


def values(coefficients: ComplexArray, quantity: Quantity, order: int, turn: float = 0.0) -> FloatArray:
    """The values of one quantity, float64 (n,); phases are around `turn`, in turn - pi to turn + pi."""
    made: dict[Quantity, FloatArray] = {
        Quantity.AMPLITUDE: coefficients.real if order == 0 else np.abs(coefficients),
        Quantity.PHASE: np.angle(coefficients * np.exp(-1j * turn)) + turn,
        Quantity.COSINE: coefficients.real,
        Quantity.SINE: coefficients.imag,
    }
    return np.ascontiguousarray(made[quantity], np.float64)


def learned_values(coefficients: ComplexArray, kind: Coordinates, order: int, *, turned: bool) -> list[FloatArray]:
    """The values of the kind's quantities; phases are around their mean direction where `turned`, else around 0."""
    turn = mean_direction(coefficients) if turned else 0.0
    return [values(coefficients, quantity, order, turn) for quantity in kind.quantities(order)]


def mean_direction(coefficients: ComplexArray) -> float:
    """The angle (rad) around which the phases lie."""
    size = np.abs(coefficients)
    # what is smaller has no inverse in float64, and counts as nothing
    return float(np.angle((coefficients / np.where(size >= np.finfo(np.float64).tiny, size, 1.0)).sum()))


def combined(order: int, kind: Coordinates, parts: tuple[FloatArray, ...]) -> ComplexArray:
    """Coefficients (n,) from the values of the kind's quantities."""
    if order == 0:
        return parts[0].astype(np.complex128)
    first, second = parts
    if kind is Coordinates.PARTS:
        return np.asarray(first + 1j * second, np.complex128)
    return np.asarray(first * np.exp(1j * second), np.complex128)


@dataclass(frozen=True)
class RobustUnit:
    """Robust units of a target: value = centre + size * scaled."""

    centre: float
    size: float

    @classmethod
    def of(cls, y: FloatArray) -> RobustUnit:
        """Median, and the standard deviation that the quartiles of normal numbers have; 1 where all are equal."""
        low, centre, high = (float(q) for q in np.percentile(y, [25, 50, 75]))
        size = (high - low) / 1.349 or float(np.std(y)) or 1.0
        return cls(centre, size)

    def scaled(self, y: FloatArray) -> FloatArray:
        """Values of the target in robust units."""
        return (y - self.centre) / self.size
