"""The angle of the other shaft: TE over what the fast shaft has turned, in place of what the output has.

That is the angle of the output without TE, so that every order is turned by as much as TE is there, the mean first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import ComplexArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.mistakes.votes import agreed_gain, expected_of
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_SHAFT = (
    "the angle seems to be that of the fast shaft over the reduction ratio, in place of the output's: every order is "
    "turned by what TE is at its run, up to {:.2g} deg, and within the turn"
)


def other_shaft(data: Observations, rig: RigModel) -> list[Mistake]:
    """An angle of the fast shaft, where most orders agree with the rig over the angle without TE's part of it.

    It has no parameter: an angle that is off by what TE is, but for another factor, has another reason, and so has one
    that another zero of each direction and a shaft that the load winds up would explain as well.
    """
    if not data.both_directions() or not (data.orders > 0).any():
        return []
    # both directions of some runs
    step = -(-len(data) // SETTINGS.rows_that_tell)
    some = data.rows(data.number_of_run % step == 0)
    if not some.both_directions():
        return []
    expected, waves = expected_of(some, rig), some.orders > 0

    def gain(share: float, plain: ComplexArray = expected) -> float:
        return agreed_gain(some, rig, expected + some.values - over_the_output(some, share).values, waves, plain)

    whole, size = gain(1.0), SETTINGS.of_a_size
    if not whole or max(gain(1.0 - size), gain(1.0 + size)) >= whole or not gain(1.0, _wound(some, expected)):
        return []

    def corrected(given: Observations) -> Observations:
        values = np.where(given.told, given.values, rig.coefficients(given.at, given.orders.tolist()))
        read = over_the_output(replace(given, values=values))
        return replace(given, values=np.where(given.told, read.values, given.values))

    most = float(np.abs(data.values[:, data.orders == 0]).max(initial=0.0))
    return [Mistake("shaft", _SHAFT.format(most), corrected, remedy="take TE out of the angle")]


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
    orders, count = data.orders, 1 << (2 * int(data.orders.max()) + 16).bit_length()
    spectrum = np.zeros((len(data), count // 2 + 1), np.complex128)
    spectrum[:, orders] = data.values * np.where(orders == 0, count, count / 2)
    te, slope = (np.fft.irfft(part, count) for part in (spectrum, 1j * np.arange(count // 2 + 1) * spectrum))
    grid = np.arange(count) * (2.0 * np.pi / count)
    found = np.empty(data.values.shape, np.complex128)
    for row, (own, its) in enumerate(zip(te, slope, strict=True)):
        # even steps of the one angle are none of the other
        weight = own * (1.0 + share * np.radians(its)) * (2.0 / count)
        found[row] = np.exp(-1j * np.outer(orders, grid + share * np.radians(own))) @ weight
    found[:, orders == 0] /= 2.0
    return replace(data, values=found)
