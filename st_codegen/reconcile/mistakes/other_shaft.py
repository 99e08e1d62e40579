"""The angle of the other shaft: TE over what the fast shaft has turned, in place of what the output has.

That is the angle of the output without TE, so that every order is turned by as much as TE is there, the mean first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from st_codegen.campaign.moments import moments
from st_codegen.ir.arrays import ComplexArray
from st_codegen.reconcile.data.observations import Observations, rows_that_tell
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.mistakes.votes import agreed_gain, expected_of
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_SHAFT = (
    "the angle seems to be that of the fast shaft over the reduction ratio, in place of the output's: every order is "
    "turned by what TE is at its run{}, and within the turn"
)


def other_shaft(data: Observations, rig: RigModel) -> list[Mistake]:
    """An angle of the fast shaft, where most orders agree with the rig over the angle without TE's part of it.

    It has no parameter: an angle that is off by what TE is, but for another factor, has another reason, and so has one
    that another zero of each direction and a shaft that the load winds up would explain as well.
    """
    if not data.both_directions() or not (data.orders > 0).any():
        return []
    # both directions of some runs
    number = data.number_of_run
    runs = int(number.max()) + 1
    some = data.rows(np.isin(number, rows_that_tell(runs, -(-SETTINGS.rows_that_tell * runs // len(data)))))
    if not some.both_directions():
        return []

    def gain(rows: Observations, share: float, plain: ComplexArray | None = None) -> float:
        seen = expected_of(rows, rig) + rows.values - over_the_output(rows, share).values
        return agreed_gain(rows, rig, seen, rows.orders > 0, plain)

    whole, part = gain(some, 1.0), SETTINGS.of_a_size
    if not whole or max(gain(some, 1.0 - part), gain(some, 1.0 + part)) >= whole:
        return []
    # what is left beside another zero and a shaft that is wound up is little: few rows do not tell it
    if not gain(data, 1.0, _wound(data, expected_of(data, rig))):
        return []

    def corrected(given: Observations) -> Observations:
        values = np.where(given.told, given.values, rig.coefficients(given.at, given.orders.tolist()))
        read = over_the_output(replace(given, values=values))
        return replace(given, values=np.where(given.told, read.values, given.values))

    most = float(np.abs(data.values[:, data.orders == 0]).max(initial=0.0))
    size = f", up to {most:.2g} deg" if most else ""
    return [Mistake("shaft", _SHAFT.format(size), corrected, remedy="take TE out of the angle")]


def _wound(data: Observations, expected: ComplexArray) -> ComplexArray:
    """What the rig lets expect, (n, K), over an angle that is off by what a line over the load, of each direction, has
    of the mean.
    """
    mean, sign = data.values[:, data.orders == 0].real.sum(axis=1), data.at.sign
    design = np.stack([np.ones(len(data)), sign, data.at.torque_Nm, sign * data.at.torque_Nm], axis=1)
    off = np.radians(design @ np.linalg.lstsq(design, mean, rcond=None)[0])
    return np.asarray(expected * np.exp(1j * np.outer(off, data.orders)))


def over_the_output(data: Observations, share: float = 1.0) -> Observations:
    """The orders of curves over their angle with a share of themselves: with all of it that of the output."""
    orders, highest = data.orders, int(data.orders.max())
    count = 1 << (2 * highest + 16).bit_length()
    spectrum = np.zeros((len(data), count // 2 + 1), np.complex128)
    spectrum[:, orders] = data.values * np.where(orders == 0, count, count / 2)
    te, slope = (np.fft.irfft(part, count) for part in (spectrum, 1j * np.arange(count // 2 + 1) * spectrum))
    grid = np.arange(count) * (2.0 * np.pi / count)
    found = np.empty(data.values.shape, np.complex128)
    for row, (own, its) in enumerate(zip(te, slope, strict=True)):
        # even steps of the one angle are none of the other
        weight = own * (1.0 + share * np.radians(its)) * (2.0 / count)
        off = share * np.radians(own)
        found[row] = moments(grid + off, weight[None], highest, off_rad=float(np.abs(off).max()))[0, orders]
    found[:, orders == 0] /= 2.0
    return replace(data, values=found)
