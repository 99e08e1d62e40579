"""What dies away behind the start of every curve: an axis that has not settled yet, a filter that runs in.

In each run it is one decaying wave over the way since the start, or over the time. Every order k has a part of it, in
the proportions that 1/(p + ik) gives for the wave's pole p: no effect gives most orders such parts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import fmin

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations, rows_that_tell
from st_codegen.reconcile.data.ramps import ramp, ramp_waves
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.mistakes.votes import expected_of, noise_power, told_power
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_TEXT = (
    "TE {does} behind the start of each curve, by up to {size:.2g} deg at first in nine of ten, and is down to 1/e of "
    "that some {later}: something settles while the turn begins"
)
#: one turn a curve tells no difference
_PLACE = ", or is struck, each time it passes the angle at which all curves begin"
_REMEDY = "take it out (a turn that is measured once the axis has settled tells more)"
#: where poles are looked for, in a radian of the output: decays and waves
_DECAYS, _WAVES = np.geomspace(0.7, 120.0, 16), np.geomspace(2.0, 200.0, 20)


@dataclass(frozen=True)
class _Wave:
    """A wave that dies away: its decay and wave in a radian of the output.

    in_time: so they are of the fastest row, and alike over the time in others.
    """

    pole: complex
    in_time: bool


@dataclass(frozen=True)
class _Curves:
    """Coefficients (n, K) of the orders (K,) of curves over the way since they began, in the direction of each.

    weight: what an order counts, (K,); speed: the speed of each row over the fastest, (n,).
    """

    values: ComplexArray
    orders: IntArray
    weight: FloatArray
    speed: FloatArray

    def few(self) -> _Curves:
        """Some rows and loud orders of these, which tell a pole."""
        rows = rows_that_tell(len(self.values))
        loud = np.flatnonzero(self.weight)
        loud = loud[:: -(-len(loud) // SETTINGS.orders_of_start)]
        return _Curves(self.values[rows][:, loud], self.orders[loud], self.weight[loud], self.speed[rows])

    def dying(self, wave: _Wave, told: BoolArray | None = None) -> tuple[ComplexArray, ComplexArray]:
        """The size of a wave at the start that each row has most likely, (n,), and its coefficients (n, K).

        told: the orders that are asked, bool (K,).
        """
        speed = self.speed if wave.in_time else np.ones(len(self.values))
        poles = np.asarray(wave.pole / speed[:, None], np.complex128)
        columns = _parts(poles, self.orders)[: 2 if wave.pole.imag else 1]
        weight = self.weight if told is None else self.weight * told
        power = np.einsum("ank,bnk,k->nab", columns, columns.conj(), weight).real
        along = np.einsum("ank,nk,k->na", columns, self.values.conj(), weight).real
        # a wave that a row tells nothing of has none there
        power += 1e-9 * (np.trace(power, axis1=1, axis2=2)[:, None, None] + 1e-290) * np.eye(len(columns))
        size = np.linalg.solve(power, along[..., None])[..., 0]
        whole = size[:, 0] + 1j * size[:, -1] if len(columns) > 1 else size[:, 0] + 0j
        return whole, np.einsum("na,ank->nk", size, columns)

    def left(self, wave: _Wave) -> float:
        """The power that is left beside a wave, one vote an order."""
        return float((np.abs(self.values - self.dying(wave)[1]) ** 2 * self.weight).sum())

    def best(self) -> _Wave:
        """The wave that leaves least.

        What rings must leave clearly less than what settles, which has a number less in each row.
        """
        laws = (False, True) if np.ptp(self.speed) else (False,)
        settles, rings = (
            min((self._refined(law, waves) for law in laws), key=lambda found: found[0]) for waves in ((0.0,), _WAVES)
        )
        return (rings if rings[0] < np.exp(-SETTINGS.vote) * settles[0] else settles)[1]

    def _refined(self, in_time: bool, waves: Iterable[float]) -> tuple[float, _Wave]:
        """The least power, and the wave that leaves it, near one of those that are tried."""
        trials = [
            (self.left(_Wave(complex(decay, turns), in_time)), decay, turns)
            for decay, turns in itertools.product(_DECAYS, waves)
            if not turns or turns > SETTINGS.rings * decay
        ]
        _, decay, turns = min(trials)

        def wave(at: FloatArray) -> _Wave:
            return _Wave(complex(decay * np.exp(at[0]), turns * np.exp(at[-1]) if turns else 0.0), in_time)

        def power(at: FloatArray) -> float:
            return self.left(wave(at))

        at, least, *_ = fmin(
            power, np.zeros(2 if turns else 1), xtol=1e-4, ftol=0.0, maxiter=80, full_output=True, disp=False
        )
        return float(least), wave(at)


def _parts(poles: ComplexArray, orders: IntArray) -> ComplexArray:
    """Coefficients of the real and of the imaginary amplitude of a dying wave over one turn, (2, n, K).

    poles: (n, 1). Of Re(a exp(-p x)), c_k = 1/pi times its integral with exp(-ikx), half of it for the mean.
    """
    one, other = ((1.0 - np.exp(-2 * np.pi * p)) / (p + 1j * orders) for p in (poles, poles.conj()))
    scale = np.where(orders == 0, 4 * np.pi, 2 * np.pi)
    return np.asarray(np.stack([one + other, 1j * (one - other)]) / scale, np.complex128)


def settling(data: Observations, rig: RigModel) -> list[Mistake]:
    """What dies away behind the start of every curve, if most orders that the rig leaves say so."""
    if data.begins_rad is None:
        return []
    waves, noise = data.orders > 0, noise_power(data)
    gap = data.values - expected_of(data, rig)
    loud = waves & ((np.abs(gap) ** 2).mean(axis=0) - noise.mean(axis=0) > told_power(noise))
    if (loud & ~np.isin(data.orders, rig.orders())).sum() < SETTINGS.shared_orders:
        return []
    # a sample stands for half a step in front of it, too
    begins = data.begins_rad - data.at.sign * (np.pi / data.samples if data.samples else 0.0)
    forward, turned = data.at.sign[:, None] > 0, np.exp(1j * begins[:, None] * data.orders)
    curves = _curves(data, np.where(forward, gap * turned, (gap * turned).conj()), noise)
    wave = curves.few().best()
    pole, in_time = wave.pole, wave.in_time
    # a pole at the end of what was tried, or that only orders beyond the highest would tell, is none; and what dies
    # away within one of its waves may be a bump
    is_inside = _DECAYS[0] < pole.real < min(_DECAYS[-1], SETTINGS.told_decay * int(data.orders.max()))
    if (
        not is_inside
        or (pole.imag and pole.imag < SETTINGS.rings * pole.real)
        or not _most_orders_agree(curves, noise, wave)
    ):
        return []
    size, seen = curves.dying(wave)
    its = np.where(forward, seen, seen.conj()) * turned.conj()

    def corrected(given: Observations) -> Observations:
        return replace(given, values=given.values - its)

    turns = float(data.at.speed_rpm.max()) / (60.0 * rig.constants.reduction_ratio)
    does, later = "settles", f"{np.degrees(1.0 / pole.real):.2g} deg on"
    if pole.imag:
        does = f"rings, at {pole.imag * turns:.3g} Hz," if in_time else f"rings, {pole.imag:.3g} times a turn,"
    if in_time:
        later = f"{1.0 / (2 * np.pi * turns * pole.real):.2g} s on"
    # few rows, which tell the least of it, have sizes beyond all others
    text = _TEXT.format(does=does, size=float(np.quantile(np.abs(size), 0.9)), later=later)
    begin_together = abs(np.exp(1j * data.begins_rad).mean()) > np.cos(2 * np.pi / max(int(data.orders.max()), 1))
    text += _PLACE if begin_together else ""
    return [Mistake("start", text, corrected, remedy=_REMEDY)]


def _most_orders_agree(curves: _Curves, noise: FloatArray, wave: _Wave) -> bool:
    """Whether the even orders tell the odd ones, and these the even ones, and better than a ramp of each row does.

    noise: power, (n, K). Together, and most orders that can say so, each; and little more than noise is left.
    """
    even, waves = curves.orders % 2 == 0, curves.orders > 0
    seen = np.where(even, curves.dying(wave, ~even)[1], curves.dying(wave, even)[1])
    k, least, own = curves.orders[waves], np.maximum(noise[:, waves], 1e-300), curves.values[:, waves]
    slope = ramp_waves(ramp(own, least, k)[:, None], k)
    after, asked = own - seen[:, waves], curves.weight[waves] > 0.0
    for before in (own, own - slope):
        gain = ((np.abs(before) ** 2 - np.abs(after) ** 2) / least).sum(axis=0)[asked]
        clear = np.abs(gain) > SETTINGS.order_gain
        beyond, rest = (((np.abs(part) ** 2 / least).sum(axis=0) - len(own))[asked].sum() for part in (before, after))
        error = SETTINGS.told * np.sqrt(len(own) * asked.sum())
        if clear.sum() < SETTINGS.shared_orders or (gain[clear] > 0.0).mean() < SETTINGS.most_orders:
            return False
        if rest + error > np.exp(-2 * SETTINGS.vote) * beyond:
            return False
    return True


def _curves(data: Observations, values: ComplexArray, noise: FloatArray) -> _Curves:
    """Curves over the way since they began, (n, K); a loud order counts no more than others."""
    power = (np.abs(values) ** 2).mean(axis=0)
    beyond = np.where(data.orders > 0, np.maximum(power - noise.mean(axis=0) - told_power(noise), 0.0), 0.0)
    speed = np.abs(data.at.speed_rpm)
    speed = np.maximum(speed / max(float(speed.max()), 1e-300), 1e-3)
    return _Curves(values, data.orders, beyond / np.maximum(power, 1e-150) ** 2, speed)
