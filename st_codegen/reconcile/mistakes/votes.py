"""Votes of orders: whether a mistake that touches all orders alike explains what is measured better than none.

Each order of a direction has one vote, however large it is, and those that noise hides have none: a missing effect
moves only its own orders.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.kept import KeptAnswers
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.data.observations import SIGNS, Observations
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_Array = TypeVar("_Array", FloatArray, ComplexArray)


def told_power(noise: FloatArray) -> FloatArray:
    """The power of a gap that the mean of rows with this noise (n, K) tells, (K,)."""
    return np.asarray(SETTINGS.told / np.sqrt(len(noise)) * noise.mean(axis=0))


def loud_orders(data: Observations, rig: RigModel, *, of_one: bool = False) -> BoolArray:
    """Orders in which the rig is loud in both directions, bool (K,): those have a vote.

    of_one: whether data of one direction have such orders, too.
    """
    model, noise = expected_of(data, rig), noise_power(data)
    found = np.ones(len(data.orders), bool)
    for sign in SIGNS:
        rows = data.at.sign == sign
        if not rows.any():
            if of_one:
                continue
            return np.zeros(len(data.orders), bool)
        power, measured = ((np.abs(part[rows]) ** 2).mean(axis=0) for part in (model, data.values))
        both = (power > 0) & (measured > 0)
        # in the unit of the data, whatever it is
        unit = float(np.median(measured[both] / power[both])) if both.any() else 1.0
        found &= unit * power > told_power(noise[rows])
    return found


def enough_orders(data: Observations, loud: BoolArray) -> bool:
    """Whether there are orders enough to tell a mistake from an effect."""
    return data.both_directions() and int((loud & (data.orders > 0)).sum()) >= SETTINGS.least_votes


def noise_power(data: Observations) -> FloatArray:
    """Power of the noise of each coefficient, (n, K): of its curve, or by its neighbours, at most a part of it all.

    It is not to be changed: many questions are asked of the same data, whose noise is kept.
    """
    return _NOISE.of((data,), lambda: _fixed(_noise_power(data)))


def expected_of(data: Observations, rig: RigModel) -> ComplexArray:
    """What the rig lets expect of the data, (n, K), deg. It is kept for the next question, and not to be changed."""
    asked = (rig, data.at, data.orders)
    return _EXPECTED.of(asked, lambda: _fixed(rig.coefficients(data.at, data.orders.tolist())))


#: of the last data that were asked for their noise, and of the last rig, operating points and orders
_NOISE, _EXPECTED = KeptAnswers[FloatArray](), KeptAnswers[ComplexArray]()


def _fixed(found: _Array) -> _Array:
    found.setflags(write=False)
    return found


def _noise_power(data: Observations) -> FloatArray:
    if data.spectral_deg is not None:
        return np.asarray(data.parts * data.spectral_deg**2)
    sigma = estimate(data, data.values).sigma
    return np.asarray(data.parts * np.minimum(sigma**2, SETTINGS.most_noise * np.abs(data.values) ** 2))


@dataclass(frozen=True)
class PowerSums:
    """Mean powers by direction and order: of what is measured, of the model, and their product; noise power.

    least: the power of a gap that the mean of the runs tells; rows: how many there are of a direction, (2, 1).
    """

    orders: IntArray
    measured: FloatArray
    model: FloatArray
    product: ComplexArray
    noise: FloatArray
    least: FloatArray
    rows: FloatArray

    @property
    def scatter(self) -> FloatArray:
        """Power by which runs differ from the model with a factor and a turn of its order, (2, K): the noise at least.

        Where TE wanders within a turn the lowest orders have more of it than the noise within curves says.
        """
        left = self.measured - np.abs(self.product) ** 2 / np.maximum(self.model, 1e-300)
        return np.maximum(left, self.noise)

    @property
    def size(self) -> FloatArray:
        """How many times the model's size each order has, (2, K)."""
        return np.asarray(np.maximum(np.abs(self.product) / np.maximum(self.model, 1e-300), 1e-12))

    @property
    def error(self) -> FloatArray:
        """The error of a factor on the model, and of a turn of an order in rad, as each order tells it, (2, K)."""
        return np.asarray(np.sqrt(self.scatter / np.maximum(2 * self.rows * self.model, 1e-300)))

    @property
    def worth(self) -> FloatArray:
        """What each order tells of a factor, (2, K): by its error, as long as that is larger than what is sought."""
        error = self.noise / np.maximum(2 * self.rows * self.model, 1e-300)
        return np.asarray(1 / (error + np.log(SETTINGS.column_factor) ** 2))

    def gap(self, scale: FloatArray, turn: ComplexArray) -> FloatArray:
        """The power that is left with a factor a direction and a turn an order, noise and all, (2, K)."""
        return self.measured + scale**2 * self.model - 2 * scale * (self.product * turn.conj()).real

    def beyond_noise(self, left: FloatArray) -> FloatArray:
        """What of a power is more than noise; never less than the mean of many runs can tell."""
        return np.maximum(left - self.noise, 0.0) + self.least

    def gap_falls(self, before: FloatArray, after: FloatArray, effects: int = 2) -> bool:
        """Whether gaps (2, K) with all noise in them are better after than before.

        Where noise hides most orders they are asked together, but for the `effects` that gain most: so many may be
        missing.
        """
        left, right = self.beyond_noise(before), self.beyond_noise(after)
        told = np.maximum(left, right) > 2.0 * self.least
        if 2 * told.sum() >= told.size:
            return gaps_fall(left, right, self.least)
        saved = np.sort((self.rows * (before - after) / self.scatter).sum(axis=0))
        return bool(saved[:-effects].sum() > SETTINGS.order_gain)


def power_sums(
    data: Observations, rig: RigModel, loud: BoolArray, swapped: bool, noise: FloatArray | None = None
) -> PowerSums:
    """The sums of loud orders, with the rig moving in the same or in the other direction; of each one with rows.

    noise: its power, (n, K), where it is known from elsewhere.
    """
    at, noise = data.at, noise_power(data) if noise is None else noise
    model = expected_of(data.under(sign=-at.sign) if swapped else data, rig)
    tables = []
    for sign in (sign for sign in SIGNS if (at.sign == sign).any()):
        m, s, n = (part[at.sign == sign][:, loud] for part in (data.values, model, noise))
        powers = ((np.abs(m) ** 2).mean(axis=0), (np.abs(s) ** 2).mean(axis=0))
        tables.append((*powers, (m * s.conj()).mean(axis=0), n.mean(axis=0), told_power(n), [len(n)]))
    return PowerSums(data.orders[loud], *map(np.array, zip(*tables, strict=True)))


def gaps_fall(before: FloatArray, after: FloatArray, least: FloatArray, votes: int = SETTINGS.least_votes) -> bool:
    """Whether in a direction most orders have a clearly smaller gap after, and in none a clearly larger one.

    An order without a gap before or after has no vote: the question does not touch it, or noise hides it.
    """
    gain, told = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300)), np.maximum(before, after) > 2.0 * least
    sides = np.array([min(np.median(g[t]), g[t].mean()) if t.any() else 0.0 for g, t in zip(gain, told, strict=True)])
    return bool(told.sum() >= votes and sides.max() > SETTINGS.vote and sides.min() > -SETTINGS.vote)


def agreed_gain(
    data: Observations, rig: RigModel, seen: ComplexArray, asked: BoolArray, plain: ComplexArray | None = None
) -> float:
    """By how much gaps fall with `seen` (n, K) in place of what the rig says, a mean logarithm; 0 where they do not.

    asked: the orders (K,) that have a vote where it changes them visibly: what has a gap for another reason says
    nothing of it. plain: what stands against `seen` in place of the rig.
    """
    sums = power_sums(data, rig, asked, swapped=False)
    plain = expected_of(data, rig) if plain is None else plain
    before, after, changed = (
        np.array([(np.abs(part[data.at.sign == sign][:, asked]) ** 2).mean(axis=0) for sign in SIGNS])
        for part in (data.values - plain, data.values - seen, seen - plain)
    )
    left, right = (np.where(changed > sums.least, sums.beyond_noise(gap), sums.least) for gap in (before, after))
    # an order of zeros alone has neither a gap nor noise
    left, right = (np.maximum(part, 1e-300) for part in (left, right))
    better = gaps_fall(left, right, sums.least, SETTINGS.least_orders_of_zero)
    return float(np.log(left / right).mean()) if better else 0.0
