"""What data cannot show, whatever the rig lacks: conditions that never varied, directions and repeats not there.

A verdict holds for what was measured; this list is its other half.
"""

from __future__ import annotations

import numpy as np

from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import CONDITIONS, axes_together
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.settings import SETTINGS


def cannot_show(data: Observations) -> tuple[str, ...]:
    """Sentences on what these data cannot show."""
    at, found = data.at, []
    axes = (
        ("speed", at.speed_rpm, "rpm", "resonances, delays, skew and friction that changes with speed"),
        ("torque", at.torque_Nm, "N m", "compliance, backlash and all that grows with the load"),
        ("temperature", at.temperature_C, "degC", "thermal drift and friction that fades as the oil warms"),
    )
    for name, values, unit, effects in axes:
        levels = np.unique(values)
        if len(levels) == 1:
            found.append(f"the {name} never varied ({levels[0]:g} {unit}): {effects} cannot be seen")
        elif len(levels) == 2:
            found.append(f"the {name} had only two values: no law of it can be told from another")
    found += [
        f"{one} and {other} go together: what depends on the one cannot be told from what depends on the other"
        for one, other in axes_together(at)
    ]
    for name in one_after_the_other(data):
        found.append(
            f"the runs go through the {name} once, one level after the other: what changes with it cannot be told from "
            "what changes in time"
        )
    if not data.both_directions():
        found.append("one direction only: what changes its sign with the direction cannot be told from a constant")
    # with the load the play changes sides, and friction does not
    of_one_sign = float(at.torque_Nm.min()) * float(at.torque_Nm.max()) > 0.0
    if of_one_sign and np.ptp(at.torque_Nm) > 0.0 and float(np.abs(at.torque_Nm).min()) > SETTINGS.near_no_load_Nm:
        found.append("no run near 0 N m: backlash cannot be told from dry friction")
    if data.angle_rad is None and data.run is None:
        text = "the order in which the runs were made is not known: steps and drifts in time cannot be seen"
        warms = len(np.unique(at.temperature_C)) > 1
        found.append(f"{text}, nor be told from what follows the oil" if warms else text)
    if data.angle_rad is None and not data.repeated:
        found.append("no two runs have equal conditions: what changes by the run cannot be told from sharp structure")
    return tuple(found)


def one_after_the_other(data: Observations) -> list[str]:
    """The conditions whose levels have all their runs, which are several, in a row, in the order of the runs."""
    if data.run is None or data.angle_rad is not None:
        return []
    in_time, found = np.argsort(data.run, kind="stable"), []
    for name, values in zip(CONDITIONS, data.at.axes, strict=True):
        level, runs = _apart(values)[in_time], len(np.unique(data.run))
        count = len(np.unique(level))
        if 1 < count <= runs / 2 and np.count_nonzero(np.diff(level)) == count - 1:
            found.append(name)
    return found


def _apart(values: FloatArray) -> IntArray:
    """The level of each value: where each has several runs that value, else what clear gaps part from one another.

    What is as wide as such a gap is no level but values that lie anywhere.
    """
    levels, index = np.unique(values, return_inverse=True)
    least = SETTINGS.clear_gap * np.ptp(levels)
    apart = np.concatenate([[0], np.cumsum(np.diff(levels) > least)])
    widest = max(np.ptp(levels[apart == one]) for one in np.unique(apart))
    if 4 * len(levels) <= len(values) or widest > least:
        return index.astype(np.int64)
    return apart[index].astype(np.int64)


def below_noise(target: FitData) -> tuple[str, ...]:
    """What is too small to be named: less than the noise of a run; a sentence, or none for samples over time.

    Its size is an RMS over the angle: that of a wave is the noise of one part of its coefficient.
    """
    data, good = target.data, target.good
    if data.angle_rad is not None or not good.any():
        return ()
    noise = np.sqrt((target.sigma[good] ** 2).mean(axis=0))
    most = int(noise.argmax())
    which = f"order {data.orders[most]}" if data.orders[most] else "the mean"
    usual = f"{np.median(noise):.2g} deg RMS of an order in the median, " if len(noise) > 1 else ""
    return (
        "what is smaller than the noise of a run has no name, however many runs hold it, but for what stands at one "
        f"angle of the turn: less than {usual}{noise[most]:.2g} deg RMS of {which}",
    )
