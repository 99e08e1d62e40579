"""Errors of predicted harmonics.

Phases are compared around the circle: a prediction of -3.1 rad for 3.1 rad is 0.08 rad away. For comparison with the
paper, which compared the bare numbers, `bare_phase_mae` is what that gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class Errors:
    """Mean absolute and root mean square errors: amplitude (deg; order 0 with its sign), phase (rad), complex (deg)."""

    amplitude_mae: float
    amplitude_rmse: float
    phase_mae: float
    phase_rmse: float
    complex_mae: float
    complex_rmse: float
    bare_phase_mae: float

    def mae(self, quantity: str) -> float:
        """The mean absolute error of a quantity by its name in errors.csv: ampl, phase, complex."""
        return {"ampl": self.amplitude_mae, "phase": self.phase_mae, "complex": self.complex_mae}[quantity]

    def rmse(self, quantity: str) -> float:
        """The root mean square error of a quantity by its name in errors.csv: ampl, phase, complex."""
        return {"ampl": self.amplitude_rmse, "phase": self.phase_rmse, "complex": self.complex_rmse}[quantity]


def errors_of(order: int, predicted: ComplexArray, truth: ComplexArray) -> Errors:
    """Errors of coefficients (n,), deg. Raises ValueError for no rows."""
    if not len(truth):
        raise ValueError("no rows to compare")
    away = np.abs(predicted - truth)
    size = (predicted - truth).real if order == 0 else np.abs(predicted) - np.abs(truth)
    if order == 0:
        around = bare = np.zeros(len(truth))
    else:
        bare = np.angle(predicted) - np.angle(truth)
        around = np.angle(np.exp(1j * bare))
    return Errors(_mae(size), _rmse(size), _mae(around), _rmse(around), _mae(away), _rmse(away), _mae(bare))


def _mae(error: FloatArray) -> float:
    return float(np.abs(error).mean())


def _rmse(error: FloatArray) -> float:
    return float(np.sqrt((error**2).mean()))
