"""Maps of the residual for the report: order against speed, torque and temperature, and angle against speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.levels import speed_levels
from st_codegen.reconcile.run import Reconciliation
from st_codegen.report.html import PageSection
from st_codegen.report.picture import Draw, panels

_MOST_ORDERS = 20
_LEVELS = 12
_ANGLES = 120
#: the scale ends here, in noise units, or higher where something is
_TOP = 10.0
_DIRECTIONS = (("forward", 1.0), ("backward", -1.0))
_AXES = (
    ("speed_rpm", "speed, rpm"),
    ("torque_Nm", "torque, N m"),
    ("temperature_C", "oil, degC"),
)


def map_sections(result: Reconciliation) -> list[PageSection]:
    """The maps, before and after; nothing for recordings, which have no rows of one operating point each."""
    if result.data.angle_rad is not None:
        return []
    before, after = result.target.residual(result.rig), result.conclusions.final.residual
    return [_orders(result, before, after), _angles(result, before, after)]


def _orders(result: Reconciliation, before: ComplexArray, after: ComplexArray) -> PageSection:
    """Rows of panels: direction, before and after; columns: speed, torque, temperature."""
    data, good = result.data, result.target.good
    places = _loudest(result, before)
    shown: list[tuple[str, Draw]] = []
    top = max(_TOP, float((np.abs(before[good][:, places]) / result.target.sigma[good][:, places]).max(initial=0.0)))
    for direction, sign in _DIRECTIONS:
        rows = good & (data.at.sign == sign)
        if not rows.any():
            continue
        for when, residual in (("before", before), ("after", after)):
            size = np.abs(residual[rows][:, places]) / result.target.sigma[rows][:, places]
            for field, label in _AXES:
                levels, names = _levels(getattr(data.at, field)[rows], by_speed=field == "speed_rpm")
                shown.append(
                    (
                        f"{direction}, {when}",
                        _heat(_by_level(size, levels, len(names)).T, top, names, label, data.orders[places], "order"),
                    )
                )
    text = (
        "RMS of the residual over the noise of one coefficient, by order and operating point, on a logarithmic scale; "
        f"noise alone gives 1.4 (the mean: 1). The {len(places)} orders that stood out most before."
    )
    height = 2.2 + 0.28 * len(places)
    return PageSection("Where: orders and operating points", text, figures=panels(shown, size_cm=(9, height)))


def _angles(result: Reconciliation, before: ComplexArray, after: ComplexArray) -> PageSection:
    """Maps of the residual over the angle of the output and the speed, summed over orders, mean included."""
    data, good = result.data, result.target.good
    theta = (np.arange(_ANGLES) + 0.5) * (2 * np.pi / _ANGLES)
    # high orders alias on so few angles; their size does not
    waves = np.exp(1j * np.outer(data.orders, theta))
    curves = [(residual @ waves).real for residual in (before, after)]
    top = float(np.percentile(np.abs(curves[0][good]), 99)) if good.any() else 1.0
    shown: list[tuple[str, Draw]] = []
    for direction, sign in _DIRECTIONS:
        rows = good & (data.at.sign == sign)
        if not rows.any():
            continue
        levels, names = _levels(data.at.speed_rpm[rows], by_speed=True)
        for when, curve in zip(("before", "after"), curves, strict=True):
            size = _by_level(curve[rows], levels, len(names))
            shown.append((f"{direction}, {when}", _angle_map(size, names, top)))
    text = f"RMS of measured - simulated over the angle of the output, by speed; the scale ends at {top:.2g} deg."
    return PageSection("Where: angle", text, figures=panels(shown, size_cm=(11, 6.5)))


def _loudest(result: Reconciliation, before: ComplexArray) -> IntArray:
    """Places of the orders that stand out most, rising."""
    good = result.target.good
    size = np.sqrt(((np.abs(before[good]) / result.target.sigma[good]) ** 2).mean(axis=0))
    found: IntArray = np.sort(np.argsort(-size)[:_MOST_ORDERS])
    return found


def _levels(values: FloatArray, *, by_speed: bool) -> tuple[IntArray, list[str]]:
    """The level of each row, and the names of levels; many different values are put into groups."""
    unique, index = np.unique(values, return_inverse=True)
    if by_speed and len(unique) > _LEVELS:
        index = np.unique(speed_levels(values), return_inverse=True)[1]
    elif len(unique) > 2 * _LEVELS:
        cuts = np.quantile(values, np.linspace(0, 1, _LEVELS + 1)[1:-1])
        index = np.unique(np.searchsorted(cuts, values), return_inverse=True)[1]
    names = [f"{np.median(values[index == level]):g}" for level in range(index.max() + 1)]
    return index.astype(np.int64), names


def _by_level(values: FloatArray, levels: IntArray, count: int) -> FloatArray:
    """RMS of rows (n, m) by level, (count, m)."""
    return np.stack([np.sqrt((values[levels == level] ** 2).mean(axis=0)) for level in range(count)])


def _heat(values: FloatArray, top: float, columns: Sequence[str], xlabel: str, rows: IntArray, ylabel: str) -> Draw:
    def draw(axes: Any) -> None:
        image = axes.imshow(
            np.maximum(values, 1.0),
            cmap="viridis",
            norm="log",
            vmin=1,
            vmax=top,
            aspect="auto",
            interpolation="nearest",
        )
        axes.grid(visible=False)
        every = -(-len(columns) // 5)
        axes.set_xticks(range(0, len(columns), every), columns[::every])
        axes.set_yticks(range(len(rows)), [str(order) for order in rows])
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.figure.colorbar(image, ax=axes)

    return draw


def _angle_map(values: FloatArray, rows: Sequence[str], top: float) -> Draw:
    def draw(axes: Any) -> None:
        extent = (0, 360, len(rows) - 0.5, -0.5)
        image = axes.imshow(
            values, cmap="viridis", vmin=0, vmax=top, aspect="auto", interpolation="nearest", extent=extent
        )
        axes.grid(visible=False)
        every = -(-len(rows) // 9)
        axes.set_yticks(range(0, len(rows), every), rows[::every])
        axes.set_xticks(range(0, 361, 90))
        axes.set(xlabel="angle of the output, deg", ylabel="speed, rpm")
        axes.figure.colorbar(image, ax=axes)

    return draw
