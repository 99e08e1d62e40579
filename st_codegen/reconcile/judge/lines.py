"""What no effect explains of samples over time: waves of the output's angle that stand above the noise."""

from __future__ import annotations

import numpy as np

from st_codegen.ir.arrays import ComplexArray
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.judge.unexplained import Signature
from st_codegen.reconcile.settings import SETTINGS


def lines_in_samples(target: FitData, residual: ComplexArray, gap_power: float, highest: int = 300) -> list[Signature]:
    """Signatures of samples over time: waves of the output's angle that stand above the noise."""
    data = target.data
    angle = np.zeros(len(data)) if data.angle_rad is None else data.angle_rad
    r, sigma = residual[:, 0].real, float(target.sigma[0, 0])
    left = r.copy()
    out = []
    for _ in range(SETTINGS.most_lines):
        waves = np.exp(-1j * np.outer(np.arange(highest + 1), angle))
        sums = waves @ left * (2.0 / len(left))
        sums[0] /= 2.0
        order = int(np.argmax(np.abs(sums)))
        size = float(np.abs(sums[order])) * (1.0 if order == 0 else np.sqrt(0.5))
        # noise of a line: sigma*sqrt(2/n); autocorrelation may double it
        if size < 10 * sigma / np.sqrt(len(left)) or size < 0.5 * sigma:
            break
        left -= (sums[order] * np.conj(waves[order])).real
        share = min(1.0, size**2 / max(gap_power, 1e-300))
        name = f"order {order}" if order else "the mean"
        text = f"{name}: {size:.2g} deg RMS over the recordings"
        out.append(Signature(order, size, share, {"constant": 1.0}, "both", text))
    return out
