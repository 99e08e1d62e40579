"""Mistakes of measuring, looked for before any effect: each has one parameter for all orders.

Unit, sign, exchanged directions, a factor on one column, another zero of the angle, an angle that is read wrong within
the turn, another reduction ratio, a block of runs with a factor of its own, wrong labels. A missing effect changes its
own orders; a mistake changes all of them alike, so that every order has one vote.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from st_codegen.errors import Problems
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.noise import MEDIAN_1, estimate
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.data.reading import begin_text, check_units, ramp_deg, start_of_ramp, unit_choices
from st_codegen.reconcile.judge.each_run import distortion, own_steps, ramp, ramps, zeros
from st_codegen.reconcile.judge.mistakes import Mistake, mistaken_runs
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread

#: what `--accept` takes
NAMES = (
    "sign", "direction", "home_offset", "column_scale", "ratio", "drift", "axis", "torque", "low_pass",
    "block", "labels",
)  # fmt: skip
_ROWS = (("forward", 1.0), ("backward", -1.0))


@dataclass(frozen=True)
class Examined:
    """Data as they are compared with the rig: corrected, with the mistakes found, and rows that are left out.

    untold: what was not asked since noise hides the answer.
    """

    data: Observations
    mistakes: tuple[Mistake, ...] = ()
    left_out: tuple[int, ...] = ()
    untold: tuple[str, ...] = ()


@one_thread()
def examine(
    data: Observations, rig: RigModel, path: Path, *, scale: float | None = None, accept: Collection[str] = ()
) -> Examined:
    """Data without the mistakes that `accept` names. Raises one InputError that asks about all others.

    Wrong labels and a scaled block touch single runs: those are left out without being asked about.
    """
    if data.angle_rad is not None or not np.isfinite(data.values).all():
        return Examined(data)
    problems = Problems(str(path))
    found: list[Mistake] = []
    for look in (_drift, _ratio, partial(_common, scale=scale), _zeros, _axis, _torque, _low_pass):
        # a torque is told by sizes, of which those in another unit say nothing
        is_unit = any(mistake.name == "unit" for mistake in found)
        for mistake in () if is_unit and look in (_torque, _low_pass) else look(data, rig):
            if mistake.corrected is not None:
                data = mistake.corrected(data)
            found.append(replace(mistake, text=f"{mistake.text} (corrected)"))
            if mistake.name == "unit" or (mistake.name not in accept and "all" not in accept):
                problems.add(mistake.question)
    can_vote = _can_vote(data, _loud(data, rig))
    if scale is None and not can_vote:
        with problems.collect():
            check_units(data, rig, path)
    runs = mistaken_runs(data, rig)
    if problems.errors:
        # what concerns single runs is told in the same message
        for mistake in runs:
            problems.add(f"{mistake.text} (they will be left out)")
    problems.raise_if_any()
    left_out = tuple(sorted({row for mistake in runs for row in mistake.rows}))
    untold: tuple[str, ...] = (_UNTOLD,) if data.both_directions() and not can_vote else ()
    if all(mistake.name != "axis" for mistake in found):
        untold += _hidden_axis(data, rig)
    return Examined(data, (*found, *runs), left_out, untold)


# --- another ratio


def _ratio(data: Observations, rig: RigModel) -> list[Mistake]:
    size, scatter, start = ramp_deg(data.orders, data.values)
    # single waves have any phase: only a ramp has one slope at all orders
    if (data.orders > 0).sum() < SETTINGS.least_votes or abs(size) < SETTINGS.ramp * scatter:
        size, start = _ramp_of_gap(data, rig)
    if not size:
        return []
    ratio = rig.constants.reduction_ratio
    used = ratio / (1 - size / 360.0)

    def corrected(given: Observations) -> Observations:
        order = given.orders
        waves = 1j * size / (np.pi * np.maximum(order, 1)) * np.exp(-1j * start * order)
        return replace(given, values=given.values - np.where(order == 0, size / 2, waves))

    # as many digits as it takes to tell the one from the other
    digits = max(5, 2 - int(np.floor(np.log10(abs(size) / 360.0))))
    text = (
        f"TE rises by {size:.3g} deg over a turn{begin_text(start)} at every run, as if it had been computed with a "
        f"reduction ratio of {used:.{digits}g} instead of {ratio:g}"
    )
    return [Mistake("ratio", text, corrected, remedy="take the ramp out")]


def _ramp_of_gap(data: Observations, rig: RigModel) -> tuple[float, float]:
    """The ramp over a turn (deg) that the mean gaps of the orders share, 0 where they do not, and where it begins.

    Where TE wanders within a turn each run has a ramp of its own: that of all is told by how far those of the runs
    scatter.
    """
    told = data.orders > 0
    orders, rows = data.orders[told], len(data)
    gaps = (data.values - rig.coefficients(data.at, data.orders.tolist()))[:, told]
    gap = gaps.mean(axis=0)
    least = SETTINGS.told * (np.abs(gaps - gap) ** 2).mean(axis=0) / rows
    start = start_of_ramp(gap[None], least[None], orders)
    turn = np.exp(1j * start * orders)
    gaps, gap = gaps * turn, gap * turn
    size = ramp(gap, least, orders)
    left, right = (np.abs(part) ** 2 + least for part in (gap, gap - 1j * size / (np.pi * orders)))
    sure = 1.0 / (orders**2 * np.maximum(least, 1e-300))
    each = np.pi * (gaps.imag * orders) @ sure / sure.sum()
    if abs(size) < SETTINGS.ramp * float(each.std()) / np.sqrt(rows):
        return 0.0, 0.0
    if not start:
        return (size, start) if _better(left[None], right[None], least[None]) else (0.0, 0.0)
    # what happens at one angle has the phases of a ramp there, but no ramp is what most orders have
    told = left > np.exp(2 * SETTINGS.vote) * 2.0 * least
    most = np.mean(left[told] > np.exp(2 * SETTINGS.vote) * right[told]) if told.any() else 0.0
    return (size, start) if told.sum() >= SETTINGS.least_orders_of_zero and most > SETTINGS.most_orders else (0.0, 0.0)


# --- what all runs have in common


@dataclass(frozen=True)
class _Sums:
    """Mean powers by direction and order: of what is measured, of the model, and their product; noise power.

    least: the power of a gap that the mean of the runs tells; rows: how many there are of a direction, (2, 1).
    """

    measured: FloatArray
    model: FloatArray
    product: ComplexArray
    noise: FloatArray
    least: FloatArray
    rows: FloatArray
    orders: IntArray

    @property
    def worth(self) -> FloatArray:
        """What each order tells of a factor, (2, K): by its error, as long as that is larger than what is sought."""
        error = self.noise / np.maximum(2 * self.rows * self.model, 1e-300)
        found: FloatArray = 1 / (error + np.log(SETTINGS.column_factor) ** 2)
        return found

    def gap(self, scale: FloatArray, turn: ComplexArray) -> FloatArray:
        """The power that is left with a factor a direction and a turn an order, noise and all, (2, K)."""
        return self.measured + scale**2 * self.model - 2 * scale * (self.product * turn.conj()).real

    def beyond_noise(self, left: FloatArray) -> FloatArray:
        """What of a power is more than noise; never less than the mean of many runs can tell."""
        found: FloatArray = np.maximum(left - self.noise, 0.0) + self.least
        return found


def _loud(data: Observations, rig: RigModel) -> BoolArray:
    """Orders in which the rig is loud in both directions, bool (K,): those have a vote."""
    model, noise = rig.coefficients(data.at, data.orders.tolist()), _noise_power(data)
    found = np.ones(len(data.orders), bool)
    for _, sign in _ROWS:
        rows = data.at.sign == sign
        if not rows.any():
            return np.zeros(len(data.orders), bool)
        power, measured = ((np.abs(part[rows]) ** 2).mean(axis=0) for part in (model, data.values))
        both = (power > 0) & (measured > 0)
        # in the unit of the data, whatever it is
        unit = float(np.median(measured[both] / power[both])) if both.any() else 1.0
        found &= unit * power > _least(noise[rows])
    return found


def _least(noise: FloatArray) -> FloatArray:
    """The power of a gap that the mean of rows with this noise (n, K) tells, (K,)."""
    found: FloatArray = SETTINGS.told / np.sqrt(len(noise)) * noise.mean(axis=0)
    return found


def _can_vote(data: Observations, loud: BoolArray) -> bool:
    """Whether there are orders enough to tell a mistake from an effect."""
    return data.both_directions() and int((loud & (data.orders > 0)).sum()) >= SETTINGS.least_votes


def _noise_power(data: Observations) -> FloatArray:
    """Power of the noise of each coefficient, (n, K): of its curve, or by its neighbours, at most a part of it all."""
    parts = np.where(data.orders == 0, 1, 2)
    if data.spectral_deg is not None:
        return np.asarray(parts * data.spectral_deg**2)
    sigma = estimate(data, data.values).sigma
    found: FloatArray = parts * np.minimum(sigma**2, SETTINGS.most_noise * np.abs(data.values) ** 2)
    return found


def _sums(data: Observations, rig: RigModel, loud: BoolArray, swapped: bool) -> _Sums:
    """The sums of loud orders, with the rig moving in the same or in the other direction."""
    at = data.at
    seen = Conditions(-at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C) if swapped else at
    model, noise = rig.coefficients(seen, data.orders.tolist()), _noise_power(data)
    tables = []
    for _, sign in _ROWS:
        m, s, n = (part[at.sign == sign][:, loud] for part in (data.values, model, noise))
        powers = ((np.abs(m) ** 2).mean(axis=0), (np.abs(s) ** 2).mean(axis=0))
        tables.append((*powers, (m * s.conj()).mean(axis=0), n.mean(axis=0), _least(n), [len(n)]))
    measured, power, product, noise_power, least, rows = (np.array(column) for column in zip(*tables, strict=True))
    return _Sums(measured, power, product, noise_power, least, rows, data.orders[loud])


@dataclass(frozen=True)
class _Common:
    """What all orders of the runs may have in common: sign, angle of home (rad), a factor a direction (2, 1)."""

    sums: _Sums
    sign: float
    angle: float
    factors: FloatArray

    @property
    def gap(self) -> FloatArray:
        """The gap with all of it taken into account, (2, K)."""
        return self.left(self.sign * self.factors, self.angle)

    def left(self, scale: FloatArray, angle: float) -> FloatArray:
        """The gap with other factors or another angle, (2, K)."""
        return self.sums.gap(scale, np.exp(-1j * angle * self.sums.orders))


def _best(sums: _Sums) -> _Common:
    """Sign, angle and factors that leave least, one vote an order however large it is."""
    factors = _factors(sums, np.abs(sums.product))
    grid = np.arange(0.0, 2 * np.pi, 2 * np.pi / (8 * max(int(sums.orders.max()), 1)))
    turns = np.exp(-1j * np.outer(grid, sums.orders))
    trials = []
    for sign in (1.0, -1.0):
        products = (sums.product[None] * turns.conj()[:, None, :]).real
        left = sums.measured + factors**2 * sums.model - 2 * sign * factors * products
        scores = np.log(sums.beyond_noise(left)).mean(axis=(1, 2))
        place = int(np.argmin(scores))
        # no turn and no sign where they gain nothing
        place = 0 if scores[0] < scores[place] + 1e-6 else place
        trials.append((float(scores[place]), sign, float(grid[place])))
    _, sign, angle = min(trials, key=lambda trial: trial[0] + 1e-6 * (trial[1] < 0))
    along = sign * (sums.product * np.exp(1j * angle * sums.orders)).real
    return _Common(sums, sign, angle, _factors(sums, along))


def _factors(sums: _Sums, product: FloatArray) -> FloatArray:
    """The factor of each direction, (2, 1), of which a noisy order tells less."""
    ratio = np.maximum(product / np.maximum(sums.model, 1e-300), 1e-12)
    middle = partial(np.quantile, q=0.5, method="inverted_cdf")
    factors = np.array([[middle(side, weights=worth)] for side, worth in zip(ratio, sums.worth, strict=True)])
    # a factor so near to one may be the rig's own
    found: FloatArray = np.where(np.abs(np.log(factors)) < np.log(SETTINGS.column_factor), 1.0, factors)
    return found


def _common(data: Observations, rig: RigModel, scale: float | None) -> list[Mistake]:
    """Unit, sign, directions, zero of the angle and factors of columns, all at once: they hide each other."""
    loud = _loud(data, rig)
    if not _can_vote(data, loud):
        return []
    same, other = (_best(_sums(data, rig, loud, swapped)) for swapped in (False, True))
    swapped = _wins(same.gap, other.gap, same.sums)
    found = other if swapped else same
    ones = np.ones((2, 1))
    is_all = _wins(same.left(ones, 0.0), found.gap, same.sums)
    mistakes = [Mistake("direction", _DIRECTION, _swapped, remedy="swap them back")] if swapped and is_all else []
    offset = float(np.rad2deg(np.angle(np.exp(1j * found.angle))))
    turned = is_all and abs(offset) > SETTINGS.least_home_deg
    if turned and _wins(found.left(found.sign * found.factors, 0.0), found.gap, found.sums):
        mistakes.append(Mistake("home_offset", _HOME.format(offset), _turned(found.angle), remedy=_TURN))
    if is_all and found.sign < 0 and _wins(found.left(found.factors, found.angle), found.gap, found.sums):
        mistakes.append(Mistake("sign", _SIGN, _times(-1.0, -1.0), remedy="turn it"))
    forward, backward = (float(x) for x in found.factors[:, 0])
    both = float(np.sqrt(forward * backward))
    alike = found.left(np.full((2, 1), found.sign * both), found.angle)
    # two orders have the same factor by a mistake, hardly by two effects
    differ = _agree(found.sums) or _wins(alike, found.gap, found.sums, effects=1)
    if abs(np.log(forward / backward)) > np.log(SETTINGS.column_factor) and differ:
        louder = abs(np.log(forward)) > abs(np.log(backward))
        which, factor, both = ("forward", forward / backward, backward) if louder else (
            "backward", backward / forward, forward)  # fmt: skip
        wrong = (factor, 1.0) if which == "forward" else (1.0, factor)
        mistakes.append(Mistake("column_scale", _COLUMN.format(which, factor), _times(*wrong), remedy="divide by it"))
    if not is_all:
        return mistakes
    choices = unit_choices(both, rig.constants.reduction_ratio) if scale is None else ""
    return [*mistakes, Mistake("unit", choices)] if choices else mistakes


def _agree(sums: _Sums) -> bool:
    """Whether the orders agree that the two directions have different factors.

    Each has one vote, and a missing effect moves its own orders only; gaps say little where single runs are wrong.
    """
    ratio = np.log(np.maximum(np.abs(sums.product) / np.maximum(sums.model, 1e-300), 1e-12))
    apart = ratio[0] - ratio[1]
    middle = float(np.median(apart))
    error = float(np.median(np.abs(apart - middle))) / MEDIAN_1 * np.sqrt(np.pi / 2 / len(apart))
    return bool(abs(middle) > SETTINGS.ramp * error)


def _better(left: FloatArray, right: FloatArray, least: FloatArray, votes: int = SETTINGS.least_votes) -> bool:
    """Whether in a direction most orders have a clearly smaller gap on the right, and in none a clearly larger one.

    An order without a gap on either side has no vote: the question does not touch it, or noise hides it.
    """
    gain, told = np.log(left / right), np.maximum(left, right) > 2.0 * least
    sides = np.array([min(np.median(g[t]), g[t].mean()) if t.any() else 0.0 for g, t in zip(gain, told, strict=True)])
    return bool(told.sum() >= votes and sides.max() > SETTINGS.vote and sides.min() > -SETTINGS.vote)


def _wins(left: FloatArray, right: FloatArray, sums: _Sums, effects: int = 2) -> bool:
    """Whether gaps with all noise in them are better on the right.

    Where noise hides most orders they are asked together, but for the `effects` that gain most: so many may be missing.
    """
    before, after = sums.beyond_noise(left), sums.beyond_noise(right)
    told = np.maximum(before, after) > 2.0 * sums.least
    if 2 * told.sum() >= told.size:
        return _better(before, after, sums.least)
    saved = np.sort((sums.rows * (left - right) / sums.noise).sum(axis=0))
    return bool(saved[:-effects].sum() > SETTINGS.order_gain)


_UNTOLD = (
    f"fewer than {SETTINGS.least_votes} orders of the rig stand above the noise in both directions: exchanged "
    "directions, another sign, another zero of the angle, or a factor on one column cannot be told from an effect"
)
_DIRECTION = (
    "forward and backward seem to be exchanged: each direction of the data agrees with the other one of the rig"
)
_HOME = (
    "the zero of the angle (home) seems to be another: every order k is turned by k times {:.2f} deg, which no effect "
    "does"
)
_TURN = "turn all orders back"
_SIGN = "TE has the opposite sign of the rig's in all orders"
_COLUMN = "the {} column is {:.3g} times what the other one lets expect, in all orders"

_ZEROS = (
    "{} of {} runs have a zero of the angle (home) of their own, by up to {:.2f} deg: every order k is turned by k "
    "times that in such a run, which no effect does"
)
_DRIFT = (
    "TE does not come back to where the turn began{}, by up to {:.2g} deg, by another amount in each run: something "
    "drifts while a turn is measured"
)


_GAIN = "all torques seem to be {:.3g} times what they were: every order that depends on the load agrees"
_ZERO_TORQUE = "all torques seem to be off by {:.3g} N m: every order that depends on the load agrees"
_OWN_TORQUES = (
    "the torques of the runs seem to be read wrong, each by its own, by up to {:.0f} N m and {:.0f} N m RMS: every "
    "order that depends on the load agrees with the others on it"
)
_OWN_BY_DIRECTION = _OWN_TORQUES.replace("each by its own", "each by its own and forward by another than backward")
_TAKE_OWN = "take the torques that the orders tell (what the load does to all orders alike cannot be seen then)"
_LOW_PASS = (
    "TE seems to have passed a low pass of {:.3g} Hz: every order is smaller and later, the faster it is the more"
)
_HIDDEN_AXIS = (
    "in this noise an angle that is read wrong by up to {:.2g} deg once a turn may not show: its sidebands are too "
    "small"
)
_AXIS = (
    "the angle seems to be read wrong by {} a turn: every order k has sidebands that grow with k in all runs, "
    "as an encoder off centre makes them, or all parts of the gear off centre alike"
)


def _without_drift(drift: FloatArray, start: float) -> Callable[[Observations], Observations]:
    """Data without the ramp of each row, and without their mean: when within the turn the drift began nobody knows."""

    def corrected(data: Observations) -> Observations:
        waves = data.of_orders(data.orders > 0, "the mean: the drift within the turn moves it by an unknown part")
        drifted = 1j * drift[:, None] / (np.pi * waves.orders) * np.exp(-1j * start * waves.orders)
        return replace(waves, values=waves.values - drifted)

    return corrected


def _swapped(data: Observations) -> Observations:
    at = data.at
    return replace(data, at=Conditions(-at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C))


def _turned(angle: float) -> Callable[[Observations], Observations]:
    return lambda data: replace(data, values=data.values * np.exp(1j * angle * data.orders))


def _times(forward: float, backward: float) -> Callable[[Observations], Observations]:
    """Data divided by a factor for each direction."""

    def corrected(data: Observations) -> Observations:
        factor = np.where(data.at.sign > 0, 1 / forward, 1 / backward)[:, None]
        spectral = None if data.spectral_deg is None else data.spectral_deg * np.abs(factor)
        return replace(data, values=data.values * factor, spectral_deg=spectral)

    return corrected


# --- single runs


def _zeros(data: Observations, rig: RigModel) -> list[Mistake]:
    """A zero of the angle of its own in some runs."""
    number = _numbers_of_runs(data)
    model = rig.coefficients(data.at, data.orders.tolist())
    found = zeros(data.values, model, _noise_power(data), data.orders, number, data.spectral_deg is not None)
    angle = found.angle
    if not angle.any():
        return []
    text = _ZEROS.format(len(np.unique(number[angle != 0])), number.max() + 1, np.degrees(np.abs(angle)).max())

    def corrected(given: Observations) -> Observations:
        told = given.orders * found.error < SETTINGS.told_turn
        turned = replace(given, values=given.values * np.exp(1j * angle[:, None] * given.orders))
        if told.all():
            return turned
        lost = f"orders from {given.orders[~told].min()} on: the zeros of the runs are not told well enough for them"
        return turned.of_orders(told, lost)

    return [Mistake("home_offset", text, corrected, remedy=_TURN)]


def _drift(data: Observations, rig: RigModel) -> list[Mistake]:
    """A drift within the turn that differs from run to run; one that all have is another ratio."""
    noise = _noise_power(data)
    gap = data.values - rig.coefficients(data.at, data.orders.tolist())
    start = start_of_ramp(gap, noise, data.orders)
    found = ramps(gap, noise, data.orders, start)
    common = 1j * np.median(found) / (np.pi * np.maximum(data.orders, 1)) * np.exp(-1j * start * data.orders)
    if not found.any() or not ramps(gap - common, noise, data.orders, start).any():
        return []
    began = f" ({np.degrees(start):.1f} deg)" if start else ""
    text = _DRIFT.format(began, np.abs(found).max())
    return [Mistake("drift", text, _without_drift(found, start), remedy="take it out")]


def _axis(data: Observations, rig: RigModel) -> list[Mistake]:
    """An angle that is read wrong within the turn, by the same waves of it in all runs."""
    its = np.array(rig.orders(), np.int64)
    known, noise = rig.coefficients(data.at, its.tolist()), _noise_power(data)
    some = slice(None, None, -(-len(data) // SETTINGS.rows_that_tell))
    found = distortion(data.values[some], noise[some], data.orders, known[some], its)
    waves = data.orders > 0
    if found is None or not data.both_directions() or not waves.any():
        return []
    if not _agreed(data, rig, found.seen(known, its, data.orders), waves):
        return []

    def corrected(given: Observations) -> Observations:
        # sidebands that were not looked at are those that the rig lets expect
        orders = np.unique(np.concatenate([given.orders, *(np.abs(its + off) for off in range(-2, 3))]))
        values, there = found.seen(known, its, orders), np.searchsorted(orders, given.orders)
        seen = np.ones(given.values.shape, bool) if given.seen is None else given.seen
        values[:, there] = np.where(seen, given.values, values[:, there])
        return replace(given, values=np.where(seen, found.corrected(values, orders)[:, there], given.values))

    sizes = np.degrees(np.abs(found.error))
    told = [
        f"{size:.2g} deg {often}" for size, often in zip(sizes, ("once", "twice"), strict=True) if 5 * size > max(sizes)
    ]
    text = _AXIS.format(" and ".join(told))
    return [Mistake("axis", text, corrected, remedy="take it out of the angle")]


def _hidden_axis(data: Observations, rig: RigModel) -> tuple[str, ...]:
    """What is said where noise hides the sidebands of an angle that is read wrong by what turns the highest order.

    They show where as many as a vote asks for stand above what the mean of the runs tells; a table has few of them.
    """
    its = np.array([order for order in rig.orders() if order > 0], np.int64)
    if not data.both_directions() or not len(its) or data.spectral_deg is None:
        return ()
    near = np.abs(data.orders[None, :] - its[:, None]).argmin(axis=1)
    size, noise = np.abs(rig.coefficients(data.at, its.tolist())) * its / 2.0, _noise_power(data)
    needed = []
    for _, sign in _ROWS:
        rows = data.at.sign == sign
        # order k has two sidebands
        needed += 2 * list(
            np.sqrt(2.0 * _least(noise[rows])[near] / np.maximum((size[rows] ** 2).mean(axis=0), 1e-300))
        )
    hidden = float(np.sort(needed)[: SETTINGS.least_orders_of_zero][-1])
    return (_HIDDEN_AXIS.format(np.degrees(hidden)),) if hidden * its.max() > SETTINGS.hidden_turn else ()


def _agreed(
    data: Observations, rig: RigModel, seen: ComplexArray, asked: BoolArray, plain: ComplexArray | None = None
) -> float:
    """By how much gaps fall with `seen` (n, K) in place of what the rig says, a mean logarithm; 0 where they do not.

    asked: the orders (K,) that have a vote where it changes them visibly: what has a gap for another reason says
    nothing of it. plain: what stands against `seen` in place of the rig.
    """
    sums = _sums(data, rig, asked, swapped=False)
    plain = rig.coefficients(data.at, data.orders.tolist()) if plain is None else plain
    before, after, changed = (
        np.array([(np.abs(part[data.at.sign == sign][:, asked]) ** 2).mean(axis=0) for _, sign in _ROWS])
        for part in (data.values - plain, data.values - seen, seen - plain)
    )
    left, right = (np.where(changed > sums.least, sums.beyond_noise(gap), sums.least) for gap in (before, after))
    better = _better(left, right, sums.least, SETTINGS.least_orders_of_zero)
    return float(np.log(left / right).mean()) if better else 0.0


def _torque(data: Observations, rig: RigModel) -> list[Mistake]:
    """Torques that are read wrong by one factor, by one offset, or each by its own: what depends on the load says so.

    A torque of its own in each run, or in each direction of it, counts where every order is predicted by what the
    others say of the run, and clearly better than by a factor or an offset.
    """
    torque, reach = data.at.torque_Nm, float(np.ptp(data.at.torque_Nm))
    if not reach or not data.both_directions():
        return []
    noise, orders, every = _noise_power(data), data.orders.tolist(), np.ones(len(data.orders), np.bool_)
    found: list[tuple[float, str, Conditions]] = []
    for shape, text in ((torque, _GAIN), (np.full(len(data), reach), _ZERO_TORQUE)):
        size = 0.0
        # steps after the first are those of a model that is not linear in the torque
        for _ in range(3):
            at = (_with_torque(data.at, torque + (size + more) * shape) for more in (0.0, SETTINGS.torque_step))
            model, higher = (rig.coefficients(one, orders) for one in at)
            step = _common_step(data.values - model, (higher - model) / SETTINGS.torque_step, noise)
            # the torque keeps its sign
            size = max(size + step, -0.95)
        right = _with_torque(data.at, torque + size * shape)
        said = text.format(1.0 / (1.0 + size) if text is _GAIN else -size * reach)
        found.append((_agreed(data, rig, rig.coefficients(right, orders), every), said, right))
    gain, said, right = max(found, key=lambda one: one[0])
    remedy = "correct them"
    plain = rig.coefficients(right if gain else data.at, orders)
    for number, text in ((_numbers_of_runs(data), _OWN_TORQUES), (np.arange(len(data)), _OWN_BY_DIRECTION)):
        its, seen, told = _torque_of_each(data, rig, noise, number)
        # as many runs as may carry a wrong label say nothing
        away = np.abs(its.torque_Nm - torque)
        most = away <= np.quantile(away, 1.0 - SETTINGS.most_labels)
        again = _told_by_others(data, plain, seen, most) if told > SETTINGS.most_labels else 0.0
        # what scales all of TE, whether it depends on the load or not, is no torque
        model = rig.coefficients(data.at, orders)
        scaled = model * (1.0 + own_steps(data.values - model, model, noise, number, SETTINGS.torque_step).others)
        if again and not _told_by_others(data, seen, scaled, most):
            off = its.torque_Nm - torque
            said, gain = text.format(np.abs(off).max(), np.sqrt((off**2).mean())), again
            right, plain, remedy = its, seen, _TAKE_OWN
    return [Mistake("torque", said, lambda given: replace(given, at=right), remedy=remedy)] if gain else []


def _told_by_others(data: Observations, plain: ComplexArray, seen: ComplexArray, most: BoolArray) -> float:
    """By how much orders are told better by `seen` than by `plain` (n, K), a log likelihood; 0 where it may be chance.

    most: the rows that are asked, bool (n,).
    Asked together but for the two that gain most, which an effect may explain: what others say of an order that has
    nothing to do with it makes it worse by as much as it would be better.
    """
    before, after = (
        np.array([(np.abs(data.values - one)[most & (data.at.sign == sign)] ** 2).sum(axis=0) for _, sign in _ROWS])
        for one in (plain, seen)
    )
    rows = np.array([[(most & (data.at.sign == sign)).sum()] for _, sign in _ROWS])
    gain = np.sort((rows * np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))).sum(axis=0))
    rest = float(gain[:-2].sum())
    return float(gain.sum()) if rest > SETTINGS.order_gain else 0.0


def _numbers_of_runs(data: Observations) -> IntArray:
    """The number of the run of each row, (n,)."""
    number = np.empty(len(data), np.int64)
    for place, rows in enumerate(data.runs):
        number[rows] = place
    return number


def _torque_of_each(
    data: Observations, rig: RigModel, noise: FloatArray, number: IntArray
) -> tuple[Conditions, ComplexArray, float]:
    """Runs at the torques that their orders tell, what each order is by those of the others (n, K), and a share.

    That is how many torques are off by more than their error leaves open.
    """
    torque, reach, orders = data.at.torque_Nm, float(np.ptp(data.at.torque_Nm)), data.orders.tolist()
    step, its = SETTINGS.torque_step * reach, torque
    # steps after the first are those of a model that is not linear in the torque
    for _ in range(3):
        model = rig.coefficients(_with_torque(data.at, its), orders)
        slope = (rig.coefficients(_with_torque(data.at, its + step), orders) - model) / step
        found = own_steps(data.values - model, slope, noise, number, step)
        seen, its = model + slope * found.others, its + found.off
    told = float(np.mean(np.abs(its - torque) > SETTINGS.told * found.error))
    return _with_torque(data.at, its), seen, told


def _low_pass(data: Observations, rig: RigModel) -> list[Mistake]:
    """A low pass of first order that TE went through: every order is smaller and late by its frequency, not late alone.

    Effects could not say so: a delay and smaller sizes of all that is fast would stand for it.
    """
    if not data.both_directions():
        return []
    model, noise = rig.coefficients(data.at, data.orders.tolist()), _noise_power(data)
    turns = data.at.sign * data.at.speed_rpm / (60.0 * rig.constants.reduction_ratio)
    rate = 2j * np.pi * turns[:, None] * data.orders

    def passed(seconds: float) -> ComplexArray:
        return np.asarray(1.0 / (1.0 + rate * seconds))

    def late(seconds: float) -> ComplexArray:
        return np.asarray(np.exp(-rate * seconds))

    def fitted(response: Callable[[float], ComplexArray]) -> float:
        seconds, small = 0.0, 1e-6
        for _ in range(SETTINGS.quick_steps):
            seen = model * response(seconds)
            slope = (model * response(seconds + small) - seen) / small
            seconds = max(seconds + _common_step(data.values - seen, slope, noise), 0.0)
        return seconds

    every, seconds = data.orders > 0, fitted(passed)
    seen = model * passed(seconds)
    if not (_agreed(data, rig, seen, every) and _agreed(data, rig, seen, every, model * late(fitted(late)))):
        return []

    def corrected(given: Observations) -> Observations:
        spectral = None if given.spectral_deg is None else given.spectral_deg / np.abs(passed(seconds))
        return replace(given, values=given.values / passed(seconds), spectral_deg=spectral)

    text = _LOW_PASS.format(1.0 / (2.0 * np.pi * seconds))
    return [Mistake("low_pass", text, corrected, remedy="undo it")]


def _common_step(gap: ComplexArray, slope: ComplexArray, noise: FloatArray) -> float:
    """The step along a slope (n, K) that the middle one of the orders wants; none says more than a sensor can."""
    power = np.maximum((np.abs(slope) ** 2).sum(axis=0), 1e-300)
    error = 1.0 / np.maximum((np.abs(slope) ** 2 / np.maximum(noise, 1e-300)).sum(axis=0), 1e-300)
    own = (gap * slope.conj()).real.sum(axis=0) / power
    return float(np.quantile(own, 0.5, method="inverted_cdf", weights=1.0 / (error + SETTINGS.torque_step**2)))


def _with_torque(at: Conditions, torque: FloatArray) -> Conditions:
    return Conditions(at.sign, at.speed_rpm, torque, at.temperature_C)
