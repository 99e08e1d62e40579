"""What the models of a transmission error bundle predict: harmonics, their quantities and directions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from st_codegen.errors import InputError, counted
from st_codegen.ir import Feature

#: The blocks correct by no more unless they are told otherwise, deg at the motor.
CORRECTION_LIMIT_DEG = 20.0


class Direction(StrEnum):
    """The direction in which the output shaft rotates."""

    FORWARD = "forward"
    BACKWARD = "backward"


class Quantity(StrEnum):
    """What a model predicts of a harmonic A*cos(k*theta + phi)."""

    AMPLITUDE = "amplitude"  # A in deg; for order 0 the signed mean
    PHASE = "phase"  # phi in rad
    COSINE = "cosine"  # A*cos(phi) in deg
    SINE = "sine"  # A*sin(phi) in deg


@dataclass(frozen=True)
class HarmonicOutput:
    """Output `output` (from 0) of model `model` predicts one quantity of one harmonic.

    added: it is a term that is added to that harmonic's own prediction: a cosine or sine part, of order 0 the mean.
    """

    direction: Direction
    order: int
    quantity: Quantity
    model: str
    output: int
    added: bool = False


@dataclass(frozen=True)
class AxisCorrection:
    """What one axis has of a harmonic that models of its type predict: c * factor * exp(i * turn_rad).

    Of the mean, order 0: factor * mean + offset_deg. Terms are added behind it.
    """

    direction: Direction
    order: int
    factor: float
    turn_rad: float = 0.0
    offset_deg: float = 0.0

    @property
    def parts(self) -> tuple[float, float]:
        """factor * cos(turn_rad) and factor * sin(turn_rad), as generated code has them."""
        return self.factor * math.cos(self.turn_rad), self.factor * math.sin(self.turn_rad)

    def __str__(self) -> str:
        """The correction in words, for headers and pages."""
        if self.order == 0:
            return f"{self.factor!r} times the mean, plus {self.offset_deg!r} deg"
        return f"{self.factor!r} times the amplitude, phase plus {self.turn_rad!r} rad"


@dataclass(frozen=True)
class Play:
    """What the means of both directions differ by without load, and the feature that holds the load's magnitude.

    `angle_deg`: mean backward less mean forward at the output, from clearance and friction; it is travelled when the
    motion turns over. What the means differ by beyond it follows the load.
    """

    angle_deg: float
    torque_feature: int


@dataclass(frozen=True)
class TransmissionError:
    """What the models of a bundle are for: TE(theta) = sum of A_k * cos(k*theta + phi_k), per direction (Eq. 2).

    `speed_feature` is the number of the feature that holds the input speed in rpm, `reduction_ratio` is
    theta_in / theta_out. `outputs` has, for every order and direction, amplitude and phase or cosine and sine part
    (order 0: amplitude only). `tasks`: 1, or 2 where the models run in a slow task and the sum in a fast one.
    `cycles`: the models that each of several successive calls computes; empty: every call computes all of them.
    `play`: None where it is not known; it needs both directions and order 0. `corrections`: of an axis whose models
    were learned on several axes of its type.
    """

    name: str
    features: tuple[Feature, ...]
    speed_feature: int
    reduction_ratio: float
    orders: tuple[int, ...]
    directions: tuple[Direction, ...]
    outputs: tuple[HarmonicOutput, ...]
    tasks: int = 1
    cycles: tuple[tuple[str, ...], ...] = ()
    play: Play | None = None
    corrections: tuple[AxisCorrection, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.reduction_ratio) and self.reduction_ratio > 0):
            raise InputError(f"reduction ratio {self.reduction_ratio}: give a positive number")
        if not 0 <= self.speed_feature < len(self.features):
            raise InputError(f"speed feature {self.speed_feature}: there are {counted(len(self.features), 'feature')}")
        if self.play and not (0 in self.orders and len(self.directions) == 2):
            raise InputError("a play needs the mean, order 0, of both directions")
        spread = sorted(name for names in self.cycles for name in names)
        if self.cycles and spread != sorted({output.model for output in self.outputs}):
            raise InputError("the cycles do not have each model once")

    def quantities(self, direction: Direction, order: int) -> dict[Quantity, HarmonicOutput]:
        """The model outputs of one harmonic, without added terms."""
        return {o.quantity: o for o in self._of(direction, order) if not o.added}

    def terms(self, direction: Direction, order: int) -> dict[Quantity, tuple[HarmonicOutput, ...]]:
        """The terms that are added to one harmonic, in their order; for none of them nothing."""
        found: dict[Quantity, tuple[HarmonicOutput, ...]] = {}
        for output in self._of(direction, order):
            if output.added:
                found[output.quantity] = (*found.get(output.quantity, ()), output)
        return found

    def correction(self, direction: Direction, order: int) -> AxisCorrection | None:
        """What the axis has of a harmonic; None where it has what the models predict."""
        own = (c for c in self.corrections if (c.direction, c.order) == (direction, order))
        return next(own, None)

    def _of(self, direction: Direction, order: int) -> list[HarmonicOutput]:
        return [o for o in self.outputs if o.direction is direction and o.order == order]
