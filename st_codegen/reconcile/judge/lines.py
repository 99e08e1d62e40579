"""What no effect explains of samples over time: waves of the output's angle that stand above all that is around."""

from __future__ import annotations

import numpy as np

from st_codegen.campaign.moments import moments
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.judge.unexplained import Signature
from st_codegen.reconcile.settings import SETTINGS


def waves_of_angle(data: Observations, samples: FloatArray, highest: int) -> ComplexArray:
    """Waves of samples over the output's angle, complex128 (highest + 1,): their mean, then amplitudes."""
    assert data.angle_rad is not None
    found: ComplexArray = moments(data.angle_rad, samples[None, :], highest)[0] * (2.0 / len(samples))
    found[0] /= 2.0
    return found


def stand_out(power: FloatArray, around: FloatArray, is_open: BoolArray) -> BoolArray:
    """The orders at which `power` (K,) is far larger than `around` on the open orders on both sides, in the mean.

    A step, a slow wander, and an angle that is not passed evenly have waves of all orders; none of them says anything.
    The mean is that of logarithms, right in a spectrum that falls; a step's falls as one over the square of the order,
    and the lowest orders, which have surroundings on one side alone, have to stand out of that.
    """
    nearest, furthest = SETTINGS.around_line
    wide = np.ones(2 * furthest + 1)
    wide[furthest - nearest + 1 : furthest + nearest] = 0.0
    count = np.maximum(np.convolve(is_open.astype(np.float64), wide, "same"), 1.0)
    order = np.maximum(np.arange(len(power)), 1.0)
    found = np.ones(len(power), np.bool_)
    for weight in (np.ones(len(power)), order**2):
        logs = np.where(is_open, np.log(np.maximum(weight * around, 1e-300)), 0.0)
        # powers of noise are exponential: the mean of their logarithms is that of their mean less Euler's constant
        level = np.exp(np.convolve(logs, wide, "same") / count + np.euler_gamma)
        found &= weight * power > SETTINGS.stands_out * level
    return found


def lines_in_samples(target: FitData, residual: ComplexArray, gap_power: float, highest: int = 300) -> list[Signature]:
    """Signatures of samples over time: waves of the output's angle that stand above the noise."""
    left, sigma = residual[:, 0].real.copy(), float(target.sigma[0, 0])
    assert target.data.angle_rad is not None
    out: list[Signature] = []
    everywhere = np.ones(highest + 1, np.bool_)
    for _ in range(SETTINGS.most_lines):
        waves = waves_of_angle(target.data, left, highest)
        power = np.abs(waves) ** 2
        stands = stand_out(power, power, everywhere)
        stands[[one.order for one in out]] = False
        order = int(np.argmax(np.where(stands, power, 0.0)))
        size = float(np.abs(waves[order])) * (1.0 if order == 0 else np.sqrt(0.5))
        # noise of a line: sigma*sqrt(2/n); autocorrelation may double it
        if not stands[order] or size < 10 * sigma / np.sqrt(len(left)) or size < 0.5 * sigma:
            break
        left -= (waves[order] * np.exp(1j * order * target.data.angle_rad)).real
        share = min(1.0, size**2 / max(gap_power, 1e-300))
        name = f"order {order}" if order else "the mean"
        text = f"{name}: {size:.2g} deg RMS over the recordings"
        out.append(Signature(order, size, share, {"constant": 1.0}, "both", text))
    return out
