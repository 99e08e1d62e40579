"""Pictures of the evidence: for each finding the measured part that it is read from, with the fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.contrasts import AXES, equal_parts
from st_codegen.reconcile.report.findings import Finding
from st_codegen.reconcile.result import Reconciliation
from st_codegen.report.picture import Draw
from st_codegen.rig.effects import Effect, Stage
from st_codegen.rig.effects.resonance import StructuralResonance

Panel = tuple[str, Draw]
_DIRECTIONS = (("forward", 1.0, "C0"), ("backward", -1.0, "C1"))
_AXES = (("speed_rpm", "speed, rpm"), ("torque_Nm", "torque, N m"), ("temperature_C", "oil, degC"))
#: orders on either side of a mesh order that the spectrum shows
_AROUND = 8
_MOST_LEVELS = 24
#: width of the shown band around a resonance: half widths, and a share of its frequency at least
_HALF_WIDTHS, _BAND = 25.0, 0.2
#: part of its largest height in a direction from which on a resonance counts as being there
_THERE = 0.05


def evidence_panels(result: Reconciliation, found: Sequence[Finding]) -> list[Panel]:
    """A panel or two for each finding whose part of the data is seen order by order; none of data over time."""
    if result.data.angle_rad is not None:
        return []
    panels: list[Panel] = []
    for number, finding in enumerate(found, 1):
        effect = finding.effect
        if effect is None or effect.stage is Stage.AXIS:
            continue
        title = f"{number}: {effect.title}"
        if isinstance(effect, StructuralResonance):
            panels += _resonance(result, effect, title)
        elif effect.stage is Stage.MODULATION:
            panels.append((title, _spectrum(result, effect)))
        else:
            panels += _over_a_condition(result, effect, finding.before, title)
    return panels


# --- resonances ---


def _resonance(result: Reconciliation, effect: StructuralResonance, title: str) -> list[Panel]:
    """Amplitude and phase over the frequency, all orders and directions brought to a height of 1 at the peak."""
    measured = result.conclusions.final.residual + result.conclusions.final.explained(effect)
    points = [
        (order, *_collapsed(result, effect, order, measured)) for order in effect.orders if order in result.data.orders
    ]
    points = [point for point in points if len(point[1])]
    if not points:
        return []
    f0, damping = effect.scalar("frequency_Hz"), effect.scalar("damping_ratio")
    band = max(_HALF_WIDTHS * damping, _BAND)
    ratio = np.linspace(max(1 - band, 0.01), 1 + band, 400)
    response = 2 * damping * ratio**2 / (1 - ratio**2 + 2j * damping * ratio)

    def drawn(part: Any, ylabel: str) -> Draw:
        def draw(axes: Any) -> None:
            for order, frequency, values in points:
                inside = np.abs(frequency / f0 - 1) < band
                axes.plot(frequency[inside], part(values[inside]), ".", label=f"order {order}")
            axes.plot(ratio * f0, part(response), "k-", linewidth=1, label="fit")
            axes.set(xlabel="frequency of the order, Hz" + _moved(effect), ylabel=ylabel)

        return draw

    phase = drawn(lambda values: np.rad2deg(np.angle(values)), "phase, deg")
    return [(title, drawn(np.abs, "amplitude, 1 at the fitted peak")), (f"{title}, phase", phase)]


def _moved(effect: Effect) -> str:
    moves = any(effect.scalar(key) for key in ("frequency_per_kNm", "frequency_per_10K"))
    return ", less what load and oil move it" if moves else ""


def _collapsed(
    result: Reconciliation, effect: StructuralResonance, order: int, measured: ComplexArray
) -> tuple[FloatArray, ComplexArray]:
    """Frequency (Hz) and mean response of one order at each speed, both directions as forward."""
    data, good = result.data, result.target.good
    column, place = int(np.searchsorted(data.orders, order)), effect.orders.index(order)
    frequencies: list[FloatArray] = [np.zeros(0)]
    values: list[ComplexArray] = [np.zeros(0, np.complex128)]
    for sign in (1.0, -1.0):
        height = effect.height(data.at, place)
        # where it is all but absent its response is noise
        size = np.abs(height) * (data.at.sign == sign)
        rows = np.flatnonzero(good & (size > _THERE * size.max()))
        if not len(rows):
            continue
        at = data.at.rows(rows)
        response = measured[rows, column] / height[rows]
        hertz = order * at.speed_rpm / (60 * effect.constants.reduction_ratio)
        frequency = hertz / effect.shift(at.torque_Nm, at.temperature_C)
        level, index = np.unique(np.round(frequency, 3), return_inverse=True)
        count = np.bincount(index)
        sums = np.bincount(index, response.real) + 1j * np.bincount(index, response.imag)
        frequencies.append(level)
        mean = np.asarray(sums / count, np.complex128)
        values.append(mean if sign > 0 else mean.conj())
    return np.concatenate(frequencies), np.concatenate(values)


# --- sidebands ---


def _spectrum(result: Reconciliation, effect: Effect) -> Draw:
    """The orders around a mesh order: measured, old rig, new rig, noise."""
    data, good = result.data, result.target.good
    mesh = effect.orders[0]
    columns = np.flatnonzero(np.abs(data.orders - mesh) <= _AROUND)
    orders = data.orders[columns]
    measured = data.values[good][:, columns]
    parts = [("measured", measured, "o")]
    for name, residual in (("rig", result.target.residual(result.rig)), ("new rig", result.conclusions.final.residual)):
        parts.append((name, measured - residual[good][:, columns], "x" if name == "rig" else "+"))
    floor = [result.orders[column].noise_floor * np.sqrt(2) for column in columns]

    def draw(axes: Any) -> None:
        for (name, values, marker), shift in zip(parts, (-0.15, 0.0, 0.15), strict=True):
            size = np.sqrt((np.abs(values) ** 2).mean(axis=0))
            shown = np.where(size > 0, size, np.nan)
            axes.plot(orders + shift, shown, marker, label=name)
        axes.plot(orders, floor, "k_", markersize=12, label="noise")
        axes.set_yscale("log")
        axes.set(xlabel="order", ylabel="amplitude, deg (RMS)")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        axes.margins(y=0.35)

    return draw


# --- everything else: over the condition on which it depends ---


def _over_a_condition(result: Reconciliation, effect: Effect, before: Effect | None, title: str) -> list[Panel]:
    """The order with the largest part of an effect, less all others, over the condition on which the part depends."""
    own = result.conclusions.final.explained(effect)
    good = result.target.good
    size = (np.abs(own[good]) ** 2).mean(axis=0)
    if not size.size or not size.max():
        return []
    column = int(size.argmax())
    order = int(result.data.orders[column])
    measured = (result.conclusions.final.residual + own)[:, column]
    lines = [("fit", own[:, column])]
    if before is not None:
        lines.append(("rig", result.conclusions.final.explained(before)[:, column]))
    field, label = _condition(result, own[:, column])

    def draw(axes: Any) -> None:
        for name, sign, colour in _DIRECTIONS:
            rows = good & (result.data.at.sign == sign)
            if rows.any():
                _band(axes, result, field, rows, _size(measured, order), f"measured, {name}", colour)
                for (what, values), style in zip(lines, ("-", "--"), strict=False):
                    x, middle, _, _ = _levels(result, field, rows, _size(values, order))
                    axes.plot(x, middle, style, color=colour, linewidth=1, label=f"{what}, {name}")
        axes.set(xlabel=label, ylabel=f"{'mean' if order == 0 else f'order {order}'}, deg")

    return [(title, draw)]


def unexplained_panels(result: Reconciliation) -> list[Panel]:
    """What stays unexplained: the residual of each order over the condition on which it depends, as a band."""
    if result.data.angle_rad is not None:
        return []
    residual = result.conclusions.final.residual
    panels: list[Panel] = []
    for signature in result.unexplained[:6]:
        if signature.order not in result.data.orders:
            continue
        column = int(np.searchsorted(result.data.orders, signature.order))
        values = _size(residual[:, column], signature.order)
        shares = [signature.dependence.get(name, 0.0) for name in AXES]
        field, label = _AXES[int(np.argmax(shares))]
        # the floor that the text compares with: what runs differ by may hold what is shown
        noise = result.orders[column].noise_floor
        panels.append((f"order {signature.order}" if signature.order else "the mean",
                       _rest(result, field, label, values, noise, signature.order)))  # fmt: skip
    return panels


def _rest(result: Reconciliation, field: str, label: str, values: FloatArray, noise: float, order: int) -> Draw:
    def draw(axes: Any) -> None:
        for name, sign, colour in _DIRECTIONS:
            rows = result.target.good & (result.data.at.sign == sign)
            if rows.any():
                _band(axes, result, field, rows, values, name, colour)
        # bands of both directions are grey where they overlap, so that noise is a line
        limits = (-noise, noise) if order == 0 else (noise * np.sqrt(2.0),)
        for number, limit in enumerate(limits):
            axes.axhline(limit, color="black", linestyle="--", linewidth=1, label="" if number else "noise, RMS")
        axes.set(xlabel=label, ylabel="what is left, deg")

    return draw


def _size(values: ComplexArray, order: int) -> FloatArray:
    """The mean with its sign, of an order its amplitude."""
    return values.real if order == 0 else np.abs(values)


def _condition(result: Reconciliation, own: ComplexArray) -> tuple[str, str]:
    """The condition with whose levels a contribution varies most; the one with the most levels where it is constant."""
    good = result.target.good
    powers = []
    for field, _ in _AXES:
        _, index = np.unique(getattr(result.data.at, field)[good], return_inverse=True)
        code = 2 * index + (result.data.at.sign[good] > 0)
        count = np.maximum(np.bincount(code), 1)
        mean = (np.bincount(code, own[good].real) + 1j * np.bincount(code, own[good].imag)) / count
        powers.append(float((np.abs(mean[code] - own[good].mean()) ** 2).mean()))
    if max(powers) < 1e-6 * float((np.abs(own[good]) ** 2).mean()):
        powers = [float(len(np.unique(getattr(result.data.at, field)[good]))) for field, _ in _AXES]
    return _AXES[int(np.argmax(powers))]


def _levels(
    result: Reconciliation, field: str, rows: BoolArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """By level of a condition: its middle, and the median and the 10 % and 90 % quantiles of values there."""
    x = getattr(result.data.at, field)[rows]
    levels, index = np.unique(x, return_inverse=True)
    if len(levels) > _MOST_LEVELS:
        index = np.unique(equal_parts(x, 12), return_inverse=True)[1]
    groups = [index == level for level in range(int(index.max()) + 1)]
    middle = np.array([float(np.median(x[group])) for group in groups])
    own = values[rows]
    low, half, high = np.array([np.quantile(own[group], (0.1, 0.5, 0.9)) for group in groups]).T
    return middle, half, low, high


def _band(
    axes: Any, result: Reconciliation, field: str, rows: BoolArray, values: FloatArray, name: str, colour: str
) -> None:
    """The median of each level as a point, and a band that holds 80 % of the runs."""
    x, middle, low, high = _levels(result, field, rows, values)
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, middle, ".", color=colour, label=name)
