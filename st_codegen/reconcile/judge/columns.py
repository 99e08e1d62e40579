"""Columns that hold something else than the rig model means: conditions in other units, curves that were processed.

Each is one of a few things that people do to tables, and shows in all runs at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.judge.mistakes import Mistake
from st_codegen.reconcile.judge.votes import SIGNS, noise_power, told_power
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel

_UNIT = "the {} seem to be {}: with that the rig predicts every order on which it matters, and as they are it does not"
_TAKEN_OFF = (
    "hardly anything is left of {} in the runs, where the rig has {:.2g} deg RMS: {} seems to have been taken off the "
    "curves"
)
_COPIED = (
    "forward and backward have the same digits in {} of {} runs, noise included: one of the columns seems to be a copy "
    "of the other"
)


def other_conditions(data: Observations, rig: RigModel) -> list[Mistake]:
    """Speeds, torques or temperatures in another unit, of the other shaft, or of the other sign; at most one of them.

    Only what takes nearly all that the rig leaves off all orders on which it matters, together.
    """
    orders, noise = data.orders.tolist(), noise_power(data)
    plain = rig.coefficients(data.at, orders)
    best: tuple[float, list[Mistake]] = (SETTINGS.order_gain, [])
    for column, text, changed in _readings(rig.constants.reduction_ratio):
        right = changed(data.at)
        gain = _gain(data, noise, plain, rig.coefficients(right, orders))
        if gain > best[0]:
            said = _UNIT.format(column, text)
            best = (gain, [Mistake("conditions", said, partial(_with_conditions, changed), remedy="read them so")])
    return best[1]


def _with_conditions(changed: Callable[[Conditions], Conditions], given: Observations) -> Observations:
    return replace(given, at=changed(given.at))


def _readings(ratio: float) -> list[tuple[str, str, Callable[[Conditions], Conditions]]]:
    """What a column may hold in place of what the rig means: its name, that, and the conditions that it means."""

    def scaled(key: str, factor: float, off: float = 0.0) -> Callable[[Conditions], Conditions]:
        return lambda at: replace(at, **{key: (getattr(at, key) + off) * factor})

    return [
        ("temperatures", "in degF", scaled("temperature_C", 1 / 1.8, -32.0)),
        ("temperatures", "in K", scaled("temperature_C", 1.0, -273.15)),
        ("speeds", "those of the output", scaled("speed_rpm", ratio)),
        ("speeds", "in turns a second", scaled("speed_rpm", 60.0)),
        ("speeds", "in rad/s", scaled("speed_rpm", 60.0 / (2 * np.pi))),
        ("speeds", "in deg/s of the output", scaled("speed_rpm", ratio / 6.0)),
        ("torques", "those of the input", scaled("torque_Nm", ratio)),
        ("torques", "of the other sign", scaled("torque_Nm", -1.0)),
        ("torques", "in kN m", scaled("torque_Nm", 1000.0)),
    ]


def _gain(data: Observations, noise: FloatArray, plain: ComplexArray, seen: ComplexArray) -> float:
    """The logarithm by which another model takes power off the gaps of the orders that it changes; 0 where it leaves
    more than a part of any.

    A mean that is off by the same in all runs of a direction speaks for none: a zero may have moved.
    """
    gain, mean = 0.0, data.orders == 0
    for sign in SIGNS:
        rows = data.at.sign == sign
        if not rows.any():
            continue
        before, after, changes = (
            (np.abs(part[rows] - mean * part[rows].mean(axis=0)) ** 2).mean(axis=0)
            for part in (data.values - plain, data.values - seen, seen - plain)
        )
        least = told_power(noise[rows])
        left, right = (np.maximum(power - noise[rows].mean(axis=0), 0.0) + least for power in (before, after))
        asked = changes > SETTINGS.acts_of_unit * least
        if (right > SETTINGS.left_of_unit * left)[asked].any():
            return 0.0
        gain += float(rows.sum() * np.log(left[asked] / right[asked]).sum())
    return gain


def taken_off(data: Observations, rig: RigModel) -> list[Mistake]:
    """The mean, and the lowest orders above it, that no run has though the rig makes them: processing took them off."""
    model = rig.coefficients(data.at, data.orders.tolist())
    noise = noise_power(data)
    measured, known = ((np.abs(part) ** 2).mean(axis=0) for part in (data.values, model))
    made = np.flatnonzero(known > 0.0)
    # in the unit of the data, whatever it is; what the runs could tell must be far below the rig's as well
    unit = float(np.median(measured[made] / known[made])) if len(made) else 0.0
    left = np.maximum(measured - noise.mean(axis=0), told_power(noise))
    gone = left < SETTINGS.taken_off**2 * unit * known
    if not len(gone) or data.orders[0] != 0 or not gone[0]:
        return []
    # an order that the rig does not make tells nothing of a filter
    count = int(np.argmin(gone[made]))
    last = int(data.orders[made[count - 1]])
    chosen = data.orders <= last
    what = "the mean" if last == 0 else f"the orders up to {last}"
    size = float(np.sqrt(known[0] + known[chosen][1:].sum() / 2))
    text = _TAKEN_OFF.format(what, size, "it" if last == 0 else "all of that")
    why = f"{what}: taken off the curves"

    def without(given: Observations) -> Observations:
        return given.of_orders(given.orders > last, why)

    return [Mistake("taken_off", text, without, remedy=f"leave {what} out")]


def copied_columns(data: Observations, _rig: RigModel) -> list[Mistake]:
    """Runs whose both directions have the same digits: two measurements never have."""
    pairs = [rows for rows in data.runs if len(rows) == 2]
    same = sum(bool(np.array_equal(data.values[first], data.values[second])) for first, second in pairs)
    if 2 * same <= len(pairs):
        return []
    text = _COPIED.format(same, len(pairs))
    return [Mistake("copied", text, _forward, remedy="compare the forward runs alone")]


def _forward(given: Observations) -> Observations:
    return given.rows(given.at.sign > 0)
