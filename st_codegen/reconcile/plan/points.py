"""Where a proposed run may be: inside what was measured, on the levels, between them, and around peaks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel


def points_of(result: Reconciliation, rivals: Sequence[RigModel]) -> list[OperatingPoint]:
    """Points inside what was measured: on the levels, between them, and around the peaks that were found."""
    at = result.data.at.rows(result.target.good)
    speeds = _between(at.speed_rpm, SETTINGS.between)
    rigs = [result.conclusions.final.state.model(), *rivals]
    speeds = _with_inner(speeds, _peak_speeds(rigs, result.data.orders))
    torques = _with_inner(_thinned(_between(at.torque_Nm, 1), SETTINGS.most_torques), _seating_torques(rigs))
    temperatures = _thinned(np.unique(at.temperature_C), SETTINGS.most_temperatures)
    mesh = np.meshgrid(_legible(speeds), _legible(torques), temperatures, indexing="ij")
    measured = {OperatingPoint(*point) for point in at.points.tolist()}
    found = [OperatingPoint(*map(float, p)) for p in zip(*(axis.ravel() for axis in mesh), strict=True)]
    inside = [p for p in found if p.speed_rpm > 0 and p not in measured]
    return sorted(set(inside))


def a_sample(points: Sequence[OperatingPoint], most: int) -> list[OperatingPoint]:
    """So many of the points at most (one at least), in their order; the same ones each time."""
    chosen = np.sort(np.random.default_rng(0).permutation(len(points))[: max(most, 1)])
    return [points[number] for number in chosen]


def _between(values: FloatArray, count: int) -> FloatArray:
    """The levels and `count` points between neighbours; an even grid where values hardly repeat."""
    levels = np.unique(values)
    if len(levels) > 40:
        levels = np.linspace(levels[0], levels[-1], 18)
    parts = [np.linspace(a, b, count + 1, endpoint=False) for a, b in itertools.pairwise(levels)]
    return np.concatenate([*parts, levels[-1:]])


def _thinned(values: FloatArray, most: int) -> FloatArray:
    return np.asarray(values[np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))])


def _with_inner(values: FloatArray, more: FloatArray) -> FloatArray:
    """Values, and those of `more` that lie inside their range."""
    return np.concatenate([values, more[(more >= values.min()) & (more <= values.max())]])


def _legible(values: FloatArray) -> FloatArray:
    """Values with four digits, inside their own range."""
    short = np.array([float(f"{x:.4g}") for x in values])
    return np.unique(np.clip(short, values.min(), values.max()))


def _peak_speeds(rigs: Sequence[RigModel], orders: IntArray) -> FloatArray:
    """Speeds (rpm) around each peak of the rigs, and those at which other orders meet the same frequency."""
    found = [np.zeros(0)]
    for effect in (effect for rig in rigs for effect in rig.effects):
        frequency, damping = effect.values.get("frequency_Hz"), effect.values.get("damping_ratio")
        if isinstance(frequency, float) and isinstance(damping, float):
            turns = 60 * effect.constants.reduction_ratio * frequency
            peak = turns / np.array(effect.orders)
            found.append(turns / orders[orders > 0])
            found.append((peak[:, None] * (1 + damping * np.array(SETTINGS.around_peak))).ravel())
    return np.concatenate(found)


def _seating_torques(rigs: Sequence[RigModel]) -> FloatArray:
    """Torques (N m) about those at which the flanks of the rigs seat."""
    torques = [effect.values.get("seating_torque_Nm") for rig in rigs for effect in rig.effects]
    return np.outer([t for t in torques if isinstance(t, float)], SETTINGS.around_seating).ravel()


@dataclass(frozen=True)
class Rows:
    """Both directions of every point as rows, and the noise (deg) of one component there, (2 n, K)."""

    data: Observations
    sigma: FloatArray


def rows_at(points: Sequence[OperatingPoint], final: Fit) -> Rows:
    """Both directions of points as rows; the noise is what the fit's residuals scatter by at measured ones."""
    data, good = final.target.data, final.target.good
    numbers = np.array([astuple(point) for point in points]).T
    at = Conditions.of(np.repeat([1.0, -1.0], len(points)), *np.concatenate([numbers, numbers], axis=1))
    power = final.target.spread**2
    sigma = np.zeros((len(at), len(data.orders)))
    for sign in (1.0, -1.0):
        own = good & (data.at.sign == sign)
        # a direction that was never measured is believed to be like the other
        sigma[at.sign == sign] = np.sqrt(np.median(power[own if own.any() else good], axis=0))
    values = np.zeros((len(at), len(data.orders)), np.complex128)
    return Rows(Observations(at, ("",) * len(at), data.orders, values), sigma)


def summed(values: FloatArray) -> FloatArray:
    """Rows (2 n, ..) of both directions added up, (n, ..)."""
    return np.asarray(values.reshape(2, -1, *values.shape[1:]).sum(axis=0))
