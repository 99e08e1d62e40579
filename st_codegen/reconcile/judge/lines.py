"""What no effect explains of samples over time: waves of the output's angle that stand above all that is around."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from st_codegen.campaign.moments import moments
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.judge.structure import orthogonal_basis
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
    """Signatures of samples over time: waves of the output's angle that stand above the noise.

    All that was found is fitted together with a mean that wanders slowly: where turns are not whole, each of them leaks
    into other orders.
    """
    left, sigma, angle = residual[:, 0].real, float(target.sigma[0, 0]), target.data.angle_rad
    assert angle is not None
    files = np.unique([label.rpartition(", t = ")[0] for label in target.data.labels], return_inverse=True)[1]
    mean = _slow(angle, target.data.at.sign, files)
    own, found = left - mean @ (mean.T @ left), list[int]()
    everywhere = np.ones(highest + 1, np.bool_)
    while True:
        orders = [order for order in found if order]
        waves = np.exp(1j * np.outer(angle, orders))
        columns = np.hstack([waves.real, waves.imag])
        beside = columns - mean @ (mean.T @ columns)
        values = np.linalg.lstsq(beside, own, rcond=None)[0]
        amplitudes = np.linalg.norm(values.reshape(2, -1), axis=0)
        sizes = dict(zip(orders, (amplitudes / np.sqrt(2)).tolist(), strict=True))
        sizes[0] = float(np.linalg.norm(mean.T @ (left - columns @ values)) / np.sqrt(len(left)))
        power = np.abs(waves_of_angle(target.data, own - beside @ values, highest)) ** 2
        power[0] = sizes[0] ** 2
        stands = stand_out(power, power, everywhere)
        stands[found] = False
        order = int(np.argmax(np.where(stands, power, 0.0)))
        size = float(np.sqrt(power[order] / (2 if order else 1)))
        # noise of a line: sigma*sqrt(2/n); autocorrelation may double it
        is_noise = not stands[order] or size < 10 * sigma / np.sqrt(len(left)) or size < 0.5 * sigma
        if is_noise or len(found) == SETTINGS.most_lines:
            break
        found.append(order)
    out = []
    for order in sorted(found, key=lambda order: -sizes[order]):
        share = min(1.0, sizes[order] ** 2 / max(gap_power, 1e-300))
        name = f"order {order}" if order else "the mean"
        text = f"{name}: {sizes[order]:.2g} deg RMS over the recordings"
        out.append(Signature(order, sizes[order], share, {"constant": 1.0}, "both", text))
    return out


def rest_that_lasts(
    target: FitData, residual: ComplexArray, told: Sequence[Signature], gap_power: float
) -> list[Signature]:
    """The signature of what samples hold beyond the noise of neighbours and the waves that were told; or none."""
    noise = target.data.neighbours_deg
    left = float((residual[:, 0].real ** 2).mean()) - sum(one.rms_deg**2 for one in told)
    if left <= (SETTINGS.clearly_larger * noise) ** 2:
        return []
    size = math.sqrt(left - noise**2)
    text = (
        f"the samples lie {size:.2g} deg RMS off beside noise of {noise:.2g} deg from one to the next: something that "
        "lasts over samples and is no wave of a whole number of periods a turn, or noise that lasts"
    )
    return [Signature(-1, size, min(1.0, size**2 / max(gap_power, 1e-300)), {"combination": 1.0}, "both", text)]


def _slow(angle: FloatArray, sign: FloatArray, files: IntArray) -> FloatArray:
    """Orthonormal columns of a mean that differs by direction and wanders, no faster than once in two turns, (n, p).

    It wanders over the angle that is travelled inside of the files, so that no order is slow where the machine is.
    """
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)) * (np.diff(files) == 0))])
    count = min(int(travelled[-1] / (2 * np.pi)), SETTINGS.most_waves_of_mean)
    waves = np.cos(np.outer(travelled, np.arange(count + 1)) * (np.pi / max(travelled[-1], 1e-300)))
    return orthogonal_basis(np.hstack([waves, sign[:, None]]))
