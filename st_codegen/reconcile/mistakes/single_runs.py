"""A mistake of measuring, and those of single runs: exchanged directions, a factor of their own, wrong labels.

The mistakes that touch all runs are looked for by `examine`.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.contrasts import beside_each_other, of_whole_levels
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.data.observations import Observations, first_of, rows_that_tell
from st_codegen.reconcile.mistakes.votes import expected_of, noise_power
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Stage
from st_codegen.rig.model import RigModel

#: what `--accept` takes so that none but those named is corrected, and nothing is asked
AS_IS = "as_is"


@dataclass(frozen=True)
class Mistake:
    """A mistake of measuring: its name for `--accept`, a sentence, what corrects the data, and rows to leave out.

    remedy: what is done where it is accepted, to stand behind "to"; is_taken_out: whether data are corrected for it.
    reading: the name of the same mistake where the finished fit tells it (`judge.misread`): who accepted that has
    accepted this, which the rig that was written then may tell.
    """

    name: str
    text: str
    corrected: Callable[[Observations], Observations] | None = None
    rows: tuple[int, ...] = ()
    remedy: str = ""
    is_taken_out: bool = False
    reading: str = ""

    def is_in(self, accept: Collection[str]) -> bool:
        """Whether one of its names was accepted."""
        return self.name in accept or self.reading in accept

    @property
    def question(self) -> str:
        """The sentence with what to do."""
        return f"{self.text}; give --accept {self.name} to {self.remedy}" if self.remedy else self.text


def mistaken_runs(data: Observations, rig: RigModel) -> list[Mistake] | None:
    """Curves of the other sign, or whose angle counts the other way, runs with exchanged directions, a block with a
    factor of its own, and runs that agree with the rig under another label than theirs.

    None where too few orders tell.
    """
    seen = data.told
    turned_over = _turned_over(data, rig, seen)
    # how others scatter, and what they are, is told with those of their own sign, in their own directions
    data = _with_sign(data, [row for mistake in turned_over for row in mistake.rows])
    counted_back = _counted_back(data, rig, seen)
    data = _read_back(data, [row for mistake in counted_back for row in mistake.rows])
    exchanged = _exchanged(data, rig, seen)
    data = _with_exchanged(data, [row for mistake in exchanged for row in mistake.rows])
    wrong = [*turned_over, *counted_back, *exchanged]
    turned = _block_of_no_effect(data, expected_of(data, rig), seen)
    asked = _asked(data, rig, seen)
    if turned or asked.sure.sum() < SETTINGS.least_votes:
        return [*wrong, *turned] or None
    blocks = [*wrong, *_block(data, asked.values, asked.known, asked.weight)]
    out = {row for mistake in blocks for row in mistake.rows}
    rest = np.array([row not in out for row in range(len(data))])
    labels = _labels(asked, rest)
    rest[[row for mistake in labels for row in mistake.rows]] = False
    return [*blocks, *labels, *_torques(asked, rest)]


def hidden_labels(data: Observations, rig: RigModel) -> tuple[str, ...]:
    """What is said where noise hides that runs carry the label of another one, or a factor of their own.

    It does where few orders judge single runs, or most exchanges of two labels change them by too little.
    """
    asked = _asked(data, rig, data.told)
    if asked.sure.sum() < SETTINGS.least_votes:
        return (
            f"fewer than {SETTINGS.least_votes} orders of the rig are right for most runs and above the noise of a "
            "single one: runs that carry the label of another one, or a factor of their own, cannot be told from "
            "effects, and few of them may be noticed",
        )
    hidden, tried = _exchanges(asked)
    if 2 * hidden <= tried:
        return ()
    percent = 100 * hidden // tried
    which = f"at least about {percent} % of runs" if percent < 100 else "runs"
    return (
        f"in this noise {which} with the label of another one would not be noticed: of the orders that are right for "
        "most runs too few are expected to differ enough between the two",
    )


def _exchanges(asked: _Asked) -> tuple[int, int]:
    """How many runs would hardly be noticed under the label of another one, of so many pairs that were tried."""
    data = asked.data
    usual, limit = _usual_and_limit(asked, np.ones(len(data), bool))
    by_directions: dict[tuple[float, ...], list[IntArray]] = {}
    for run in data.runs:
        rows = run[np.argsort(data.at.sign[run], kind="stable")]
        by_directions.setdefault(tuple(data.at.sign[rows].tolist()), []).append(rows)
    hidden = tried = 0
    for runs in by_directions.values():
        of = np.array(runs)[rows_that_tell(len(runs), SETTINGS.labels_tried)]
        gain = asked.weight[of][:, None] * np.abs(asked.known[of][:, None] - asked.known[of][None]) ** 2
        by_order = gain.sum(axis=2)
        told = usual + gain.sum(axis=3).min(axis=2) > limit
        told &= by_order.sum(axis=2) - by_order.max(axis=2) > SETTINGS.order_gain
        labels = np.stack([axis[of[:, 0]] for axis in data.at.axes], axis=1)
        others = (labels[:, None] != labels[None]).any(axis=2)
        hidden, tried = hidden + int((others & ~told).sum()), tried + int(others.sum())
    return hidden, tried


def _turned_over(data: Observations, rig: RigModel, seen: BoolArray) -> list[Mistake]:
    """Curves of which nearly all orders that tell have the other sign than the rig, and most other curves its own.

    No effect turns all orders; a column whose sign was changed does, and it turns the mean: another zero of the angle
    may turn all odd orders, and leaves the mean as it is.
    """
    model = expected_of(data, rig)
    power = np.abs(model) ** 2
    tells = seen & (power > SETTINGS.loud_order * noise_power(data))
    along = (data.values * model.conj()).real / np.maximum(power, 1e-300)
    enough = tells[:, data.orders > 0].sum(axis=1) >= SETTINGS.least_votes
    each = np.array([np.median(row[told]) if told.any() else 0.0 for row, told in zip(along, tells, strict=True)])
    own, other = (
        enough
        & ~_far_from(each, sign)
        & ((tells & (along * sign > 0.0)).sum(axis=1) > SETTINGS.most_orders * tells.sum(axis=1))
        for sign in (1.0, -1.0)
    )
    if data.orders[0] == 0:
        other &= ~(tells[:, 0] & (along[:, 0] > 0.0))
    if not other.any() or other.sum() > SETTINGS.most_of_block * len(data) or own.sum() < other.sum():
        return []
    rows = np.flatnonzero(other)
    touched = [of for of in data.runs if other[of].any()]
    if len(touched) >= SETTINGS.least_block and all(other[of].all() for of in touched):
        # a block of whole runs is said to be one
        return []
    said = f"{len(rows)} curves have" if len(rows) > 1 else "a curve has"
    shown = first_of([data.labels[row] for row in rows], 6, "; ")
    return [
        Mistake("block", f"{said} the opposite sign of the rig's in most orders: {shown}", rows=tuple(map(int, rows)))
    ]


def _counted_back(data: Observations, rig: RigModel, seen: BoolArray) -> list[Mistake]:
    """Curves of which nearly all orders that tell are the rig's with phases of the other sign, and most others its own.

    No effect mirrors all orders; an angle that counts the other way does, or TE that was stored from its end, which is
    a sample off where the angle stands once at 0 and not at 360 deg.
    """
    model, noise = expected_of(data, rig), noise_power(data)
    tells = seen & (np.abs(model - model.conj()) ** 2 > SETTINGS.loud_order * noise)
    turns = [np.ones(len(data.orders), np.complex128), *samples_off(data)]
    own, other, *mirrored = (
        np.where(tells, np.abs(data.values - known) ** 2 / np.maximum(noise, 1e-300), 0.0)
        for known in (model, -model, *(turn * model.conj() for turn in turns))
    )
    best = np.argmin([part.sum(axis=1) for part in mirrored], axis=0)
    after = np.array(mirrored)[best, np.arange(len(data))]
    enough, most = tells.sum(axis=1) >= SETTINGS.least_votes, SETTINGS.most_orders * tells.sum(axis=1)
    nearer = (tells & (after < own)).sum(axis=1)
    lost = np.minimum(own.sum(axis=1), other.sum(axis=1))
    back = enough & (nearer > most) & (after.sum(axis=1) < SETTINGS.label_gain * lost)
    right = enough & (tells.sum(axis=1) - nearer > most)
    if not back.any() or back.sum() > SETTINGS.most_of_block * len(data) or right.sum() < back.sum():
        return []
    rows = np.flatnonzero(back)
    said = f"the angle of {len(rows)} curves seems" if len(rows) > 1 else "the angle of a curve seems"
    shown = first_of([data.labels[row] for row in rows], 6, "; ")
    text = f"{said} to count the other way than its TE, by the phases of most orders: {shown}"
    return [Mistake("block", text, rows=tuple(map(int, rows)))]


def samples_off(data: Observations) -> list[ComplexArray]:
    """How orders turn, (K,), where TE is a sample before or behind its angle; none where the samples are not known."""
    return [np.exp(2j * np.pi * step * data.orders / data.samples) for step in (1, -1) if data.samples]


def _exchanged(data: Observations, rig: RigModel, seen: BoolArray) -> list[Mistake]:
    """Runs of which each direction agrees with the rig's other one, in most orders that tell.

    In each of these orders the run has a vote: a missing effect makes some of them look so, hardly most.
    """
    runs = [rows for rows in data.runs if sorted(data.at.sign[rows]) == [-1.0, 1.0]]
    orders = data.orders.tolist()
    model = expected_of(data, rig)
    gap = np.abs(data.values - model)
    closer = np.abs(data.values - rig.coefficients(_with_exchanged(data, np.arange(len(data))).at, orders)) < gap
    nearer = [rows for rows in runs if closer[rows][seen[rows]].sum() * 2 > seen[rows].sum()]
    if not nearer:
        return []
    turned = _with_exchanged(data, np.concatenate(nearer))
    left = data.values - rig.coefficients(turned.at, orders)
    weight = seen / estimate(turned, left).sigma ** 2
    wrong, texts = [], []
    for rows in nearer:
        own, other, turned_over = (
            (weight[rows] * part[rows] ** 2).sum(axis=0) for part in (gap, np.abs(left), np.abs(data.values + model))
        )
        tells = np.abs(own - other) > SETTINGS.order_gain
        agree = (own > other) & tells
        most = agree.sum() > max(SETTINGS.least_votes - 1, SETTINGS.most_orders * tells.sum())
        # what turns with the direction has the other sign then
        if most and other.sum() < SETTINGS.label_gain * min(own.sum(), turned_over.sum()):
            wrong.append(rows)
            # a label ends with its direction, within the brackets where it names a file
            texts.append(re.sub(r", \w+(?=\)?$)", "", data.labels[rows[0]]))
    if not wrong or 2 * len(wrong) > len(data.runs):
        return []
    text = _seem(texts, "to have forward and backward exchanged")
    rows = np.concatenate(wrong)
    if _loads_turn_with(data, rows):
        text += "; theirs are the loads of the other sign: the other flanks may bear there, which the rig does not know"
    return [Mistake("direction", text, rows=tuple(map(int, rows)))]


def _loads_turn_with(data: Observations, rows: IntArray) -> bool:
    """Whether the loads of some rows have the one sign, and those of all others the other one, or none."""
    theirs, others = data.at.torque_Nm[rows], np.delete(data.at.torque_Nm, rows)
    return bool(theirs.all() and len(np.unique(np.sign(theirs))) == 1 and (others * theirs[0] <= 0.0).all())


def _with_sign(data: Observations, rows: list[int]) -> Observations:
    """The data with the other sign in some rows."""
    values = data.values.copy()
    values[rows] *= -1.0
    return replace(data, values=values) if rows else data


def _read_back(data: Observations, rows: list[int]) -> Observations:
    """The data with phases of the other sign in some rows."""
    values = data.values.copy()
    values[rows] = values[rows].conj()
    return replace(data, values=values) if rows else data


def _with_exchanged(data: Observations, rows: IntArray | list[int]) -> Observations:
    """The data with rows under the other direction than theirs."""
    sign = data.at.sign.copy()
    sign[rows] *= -1.0
    return data.under(sign=sign) if len(rows) else data


def _block_of_no_effect(data: Observations, model: ComplexArray, seen: BoolArray) -> list[Mistake]:
    """A block of runs in another unit, or of the other sign: so many of them that neighbours tell no noise.

    The rig must be right in some of the others.
    """
    parts = data.parts
    sigma = np.sqrt(noise_power(data) / parts)
    if data.spectral_deg is None:
        # what they are measured to be says nothing of the noise of those in another unit
        sigma = np.minimum(sigma, np.sqrt(SETTINGS.most_noise / parts) * np.abs(model))
    z = np.abs(data.values - model) / np.maximum(sigma, 1e-150)
    right = np.quantile(np.where(seen, z, np.inf), SETTINGS.most_labels, axis=0, method="inverted_cdf")
    # the noise of those in another unit is in that unit as well
    usual = np.quantile(sigma, SETTINGS.most_labels, axis=0, method="inverted_cdf")
    sure = (right < SETTINGS.sure_order) & (np.median(np.abs(model), axis=0) > SETTINGS.shown_order * usual)
    if sure.sum() < SETTINGS.least_votes:
        return []
    weight = seen[:, sure] / np.maximum(sigma[:, sure], 1e-150) ** 2
    found = _block(data, data.values[:, sure], model[:, sure], weight, only_no_effect=True)
    return found if all(len(one.rows) > SETTINGS.most_labels * len(data) for one in found) else []


def _block(
    data: Observations, values: ComplexArray, known: ComplexArray, weight: FloatArray, *, only_no_effect: bool = False
) -> list[Mistake]:
    runs = data.runs
    size = np.array([_factor_of(values[rows], known[rows], weight[rows]) for rows in runs])
    off = np.isfinite(size) & _far_from(size, 1.0)
    if off.sum() < SETTINGS.least_block:
        return []
    common = float(np.median(size[off]))
    # no effect makes most orders ten times as large, or turns all of them
    is_no_effect = not SETTINGS.like_an_effect[0] < common < SETTINGS.like_an_effect[1]
    if off.mean() > (1.0 - SETTINGS.most_labels if is_no_effect else SETTINGS.most_of_block):
        return []
    if only_no_effect and not is_no_effect:
        return []
    near = off & ~_far_from(size, common)
    if near.sum() < SETTINGS.least_block:
        return []
    rows = np.concatenate([runs[i] for i in np.flatnonzero(near)])
    where = ""
    if data.run is not None:
        first, last = int(np.flatnonzero(near)[0]), int(np.flatnonzero(near)[-1])
        is_one = last - first + 1 <= SETTINGS.runs_of_block * near.sum()
        if not is_one and not is_no_effect:
            return []
        where = "" if not is_one else f", run {first + 1} to run {last + 1} in their order"
    text = f"a block of {int(near.sum())} runs is {common:.3g} times as large as the rig in most orders{where}"
    return [Mistake("block", text, rows=tuple(map(int, rows)))]


def _factor_of(values: ComplexArray, known: ComplexArray, weight: FloatArray) -> float:
    """The factor of most loud orders of a run (rows, K) over what is known; NaN where few tell or most differ."""
    times = values * known.conj() / np.maximum(np.abs(known) ** 2, 1e-300)
    worth = weight * np.abs(known) ** 2
    # a factor is told by how far it lies from none, too
    loud = worth * np.maximum(1.0, times.real**2) > SETTINGS.loud_order
    if loud.sum() < SETTINGS.least_votes:
        return np.nan
    factor = float(np.median(times[loud].real))
    # orders that are turned are smaller along what is known, each by its own
    error = SETTINGS.told * max(1.0, abs(factor)) / np.sqrt(worth[loud])
    agree = np.abs(times[loud] - factor) < np.maximum(error, (SETTINGS.block_factor - 1.0) * abs(factor))
    return factor if 2 * agree.sum() > len(agree) else np.nan


def _far_from(size: FloatArray, factor: float) -> BoolArray:
    """Which factors are another one, whatever its sign, by more than what makes a block."""
    ratio = np.where(np.isfinite(size), size, 1.0) / (factor or 1e-9)
    return np.asarray(np.abs(np.log(np.maximum(ratio, 1e-6))) > np.log(SETTINGS.block_factor))


@dataclass(frozen=True)
class _Asked:
    """Data and the rig, and of the orders that judge labels (sure, bool (K,)) what is measured, what the rig says, and
    what it counts, (n, sure)."""

    data: Observations
    rig: RigModel
    sure: BoolArray
    values: ComplexArray
    known: ComplexArray
    weight: FloatArray

    @cached_property
    def loss(self) -> FloatArray:
        """What each row leaves under its own label, (n,)."""
        return np.asarray((self.weight * np.abs(self.values - self.known) ** 2).sum(axis=1))


def _asked(data: Observations, rig: RigModel, seen: BoolArray) -> _Asked:
    """What judges labels: orders in which the rig is right for most runs, and loud.

    seen: (n, K), the coefficients that a curve tells; another one says nothing of its label.
    """

    def of_most(values: FloatArray) -> FloatArray:
        """The median of each order over the rows that tell it."""
        return np.array([np.median(own[of]) if of.any() else np.inf for own, of in zip(values.T, seen.T, strict=True)])

    model = expected_of(data, rig)
    left, sigma = np.abs(data.values - model), estimate(data, data.values - model).sigma
    # wrong runs beside right ones make the noise between neighbours large: it is no more than what most runs keep, of
    # which half is below 1.2 sigma of a complex number, and below 0.7 of the mean
    most = np.where(data.orders == 0, 1.5, 1.0) * of_most(left) / np.median(sigma, axis=0)
    sigma = sigma * np.clip(most, 1e-9, 1.0)
    usual = of_most(left / sigma)
    power = np.median(np.abs(model), axis=0)
    sure = (usual < SETTINGS.sure_order) & (power > SETTINGS.shown_order * np.median(sigma, axis=0))
    return _Asked(data, rig, sure, data.values[:, sure], model[:, sure], seen[:, sure] / sigma[:, sure] ** 2)


def _usual_and_limit(asked: _Asked, rest: BoolArray) -> tuple[float, float]:
    """The usual loss of a row, of those (n,) that are asked, and the one from which on its label is doubted."""
    usual = float(np.median(asked.loss[rest])) if rest.any() else 0.0
    return usual, SETTINGS.label_loss * max(usual, 2.0 * asked.values.shape[1])


def _most_left(asked: _Asked, rows: IntArray, limit: float) -> float:
    """What a run may leave under what is its own: a part of what it does under its label, and no reason to doubt that.

    limit: of `_usual_and_limit`.
    """
    return min(SETTINGS.label_gain * float(asked.loss[rows].sum()), limit * len(rows))


def _labels(asked: _Asked, rest: BoolArray) -> list[Mistake]:
    """Runs that the rig explains well under the label of another run, and badly under their own.

    rest: the rows that are asked.
    """
    data, at = asked.data, asked.data.at
    _, limit = _usual_and_limit(asked, rest)
    wrong: list[int] = []
    texts = []
    runs, near = data.runs, dict[int, list[tuple[float, int]]]()
    for number, rows in enumerate(runs):
        if not rest[rows].all() or asked.loss[rows].min() < limit:
            continue
        if found := _nearest_labels(asked, rows, _most_left(asked, rows, limit)):
            near[number] = found
    passed_on = _passed_on(data, near) if len(near) <= SETTINGS.most_labels * len(runs) else {}
    for number, found in near.items():
        rows, label = runs[number], passed_on.get(number, found[0])
        if _is_elsewhere(asked, rows, label, is_passed_on=number in passed_on):
            continue
        row = label[1]
        wrong += map(int, rows)
        texts.append(
            f"{data.labels[rows[0]]} agrees with {at.speed_rpm[row]:g} rpm, {at.torque_Nm[row]:g} N m, "
            f"{at.temperature_C[row]:g} degC"
        )
    if not wrong or len(texts) > SETTINGS.most_labels * len(runs):
        return []
    return [Mistake("labels", _seem(texts, "to carry the label of another run"), rows=tuple(wrong))]


def _torques(asked: _Asked, rest: BoolArray) -> list[Mistake]:
    """Runs that the rig explains well at another torque than their label's, and badly at that one.

    Many of them, those that lie together, and those of the least and the largest torques are left: the machine may do
    there what the rig does not. rest: the rows that are asked.
    """
    data, at = asked.data, asked.data.at
    _, limit = _usual_and_limit(asked, rest)
    doubted = rest & (asked.loss > limit)
    right = at.torque_Nm[~doubted]
    if not len(right) or doubted.sum() > SETTINGS.most_suspects * len(data):
        return []
    may = doubted & (right.min() < at.torque_Nm) & (at.torque_Nm < right.max()) & ~of_whole_levels(at, doubted)
    may[[row for group in beside_each_other(at, doubted) for row in group.rows]] = False
    wrong, texts = list[int](), list[str]()
    for rows in data.runs:
        if not may[rows].all():
            continue
        left, torque = _by_one_condition(asked, rows, "torque_Nm")
        as_if = replace(at.rows(rows), torque_Nm=np.full(len(rows), torque))
        there = asked.rig.coefficients(as_if, data.orders.tolist())[:, asked.sure]
        if left <= _most_left(asked, rows, limit) and _gains_in_orders(asked, rows, there):
            wrong += map(int, rows)
            # three digits, without a power of ten: the places that are tried lie no closer
            about = f"{float(f'{torque:.3g}'):g}"
            texts.append(f"{data.labels[rows[0]]} agrees with about {about} N m, if not with another label")
    return [Mistake("labels", _seem(texts, "to have had another torque"), rows=tuple(wrong))] if wrong else []


def _nearest_labels(asked: _Asked, rows: IntArray, most: float) -> list[tuple[float, int]]:
    """What a run leaves under the labels that suit it best, and a row with each, the best first; none where even that
    leaves more than `most`, or is a matter of one order."""
    losses = sorted((loss, row) for row, loss in _by_label(asked, rows).items())
    least = losses[0][0] if losses else np.inf
    limit = min(most, least + SETTINGS.as_good)
    near = [one for one in losses if one[0] <= limit]
    return near if near and _most_agree(asked, rows, near[0][1]) else []


def _passed_on(data: Observations, near: Mapping[int, Sequence[tuple[float, int]]]) -> dict[int, tuple[float, int]]:
    """Runs that agree with the label of another one that has a wrong label itself: what they leave under it, and a row.

    None where so many may do so by chance: of runs whose torque was read wrong each may agree with any label, so that
    the label of one other has any place among those that it agrees with, ordered by what they leave of it.
    near: of each run whose label is doubted what it leaves under the labels that suit it best, and a row with each.
    """
    points, numbers, count = data.at.points, list(near), len(near)
    owners = defaultdict[tuple[float, ...], list[int]](list)
    for i, number in enumerate(numbers):
        owners[tuple(points[data.runs[number][0]].tolist())].append(i)
    place = np.full((count, count), np.inf)
    for i, suited in enumerate(near.values()):
        for rank, (_, row) in enumerate(suited, start=1):
            place[i, [j for j in owners.get(tuple(points[row].tolist()), ()) if j != i]] = rank
    chosen = linear_sum_assignment(np.log(np.minimum(place, 1e9)))
    pairs = [(i, int(place[i, j])) for i, j in zip(*chosen, strict=True) if np.isfinite(place[i, j])]
    product = math.prod(rank for _, rank in pairs)
    if not pairs or product > SETTINGS.most_places:
        return {}
    ways = math.log(_ways(count, len(pairs))) + math.log(_places(product, len(pairs)))
    # labels that all runs may have: those of both directions
    labels = set.intersection(*(set(map(tuple, points[data.at.sign == sign])) for sign in np.unique(data.at.sign)))
    if ways - len(pairs) * math.log(max(len(labels), 1)) > math.log(SETTINGS.labels_chance):
        return {}
    return {numbers[i]: near[numbers[i]][rank - 1] for i, rank in pairs}


def _ways(count: int, pairs: int) -> int:
    """In how many ways so many of some things can each point to another one, each to one of its own."""
    terms = [math.comb(pairs, j) * math.perm(count - j, pairs - j) for j in range(pairs + 1)]
    return math.comb(count, pairs) * (sum(terms[::2]) - sum(terms[1::2]))


def _places(product: int, count: int) -> int:
    """How many lists of `count` whole numbers from 1 on have at most this product.

    So many of them are above 1 as twos have a product within it.
    """
    return sum(math.comb(count, above) * _above_one(product, above) for above in range(product.bit_length()))


@cache
def _above_one(product: int, count: int) -> int:
    """How many lists of `count` whole numbers from 2 on have at most this product."""
    return sum(_above_one(product // first, count - 1) for first in range(2, product + 1)) if count else 1


def _seem(texts: list[str], what: str) -> str:
    """What single runs seem to be, of which these are named."""
    return f"{f'{len(texts)} runs seem' if len(texts) > 1 else 'a run seems'} {what}: {first_of(texts, 6, '; ')}"


def _most_agree(asked: _Asked, rows: IntArray, other: int) -> bool:
    """Whether the label of another row explains a run better by more than the one order that gains most."""
    at, known = asked.data.at, asked.known.copy()
    for row in rows:
        same = (at.sign == at.sign[row]) & (at.speed_rpm == at.speed_rpm[other])
        same &= (at.torque_Nm == at.torque_Nm[other]) & (at.temperature_C == at.temperature_C[other])
        if same.any():
            known[row] = asked.known[np.flatnonzero(same)[0]]
    return _gains_in_orders(asked, rows, known[rows])


def _gains_in_orders(asked: _Asked, rows: IntArray, there: ComplexArray) -> bool:
    """Whether a run agrees better with other values (rows, orders) by more than the one order that gains most.

    A missing effect moves one order, the mean above all, in any way; a resonance that moves changes all of its own.
    """
    values, known = asked.values[rows], asked.known[rows]
    gain = (asked.weight[rows] * (np.abs(values - known) ** 2 - np.abs(values - there) ** 2)).sum(axis=0)
    orders = asked.data.orders[asked.sure]
    for effect in asked.rig.of_stage(Stage.STRUCTURE):
        own = np.isin(orders, effect.touched_orders())
        gain = np.append(gain * ~own, gain[own].sum())
        orders = np.append(orders, -1)
    return float(np.sort(gain)[:-1].sum()) > SETTINGS.order_gain


def _is_elsewhere(asked: _Asked, rows: IntArray, other: tuple[float, int], *, is_passed_on: bool) -> bool:
    """Whether a run lies at another speed or torque than its label's, which is not that of any label either.

    other: the loss under the label of another row, and that row. A torque that is read wrong may be near that of
    another run, whose speed has no part in it. Where conditions have levels it is no chance that a run lies at another
    one, nor where runs seem to have passed on their labels (`_passed_on`): there it must lie clearly between them.
    """
    at, (loss, row) = asked.data.at, other
    own = [_by_one_condition(asked, rows, key)[0] for key in ("speed_rpm", "torque_Nm")]
    if min(own) < loss - SETTINGS.order_gain:
        return True
    scatters = not is_passed_on and 2 * len(np.unique(at.torque_Nm)) >= len(asked.data.runs)
    is_torque = (at.speed_rpm[rows] == at.speed_rpm[row]).all() and (
        at.temperature_C[rows] == at.temperature_C[row]
    ).all()
    return bool(scatters and not is_torque and own[1] < loss + SETTINGS.order_gain)


def _by_one_condition(asked: _Asked, rows: IntArray, key: str) -> tuple[float, float]:
    """The least loss of a run at another value of one condition than its label's, and that value; a part beyond all
    labels as well."""
    data, values = asked.data, getattr(asked.data.at, key)
    beyond = SETTINGS.beyond_labels * np.abs([values.min(), values.max()])
    low, high = float(values.min() - beyond[0]), float(values.max() + beyond[1])
    found, best = np.zeros(0), 0
    # once more between those beside the best: no place on a grid is so near that noise alone is left
    for _ in range(2):
        tried = np.linspace(low, high, SETTINGS.places_tried)
        found = np.zeros(len(tried))
        for row in rows:
            as_if = replace(data.at.rows(np.full(len(tried), row)), **{key: tried})
            model = asked.rig.coefficients(as_if, data.orders.tolist())[:, asked.sure]
            found += (asked.weight[row] * np.abs(asked.values[row] - model) ** 2).sum(axis=1)
        best = int(np.argmin(found))
        low, high = float(tried[max(best - 1, 0)]), float(tried[min(best + 1, len(tried) - 1)])
    return float(found[best]), float(tried[best])


def _by_label(asked: _Asked, rows: IntArray) -> dict[int, float]:
    """The loss of a run under each label that has all of its directions, by a row that carries it."""
    at = asked.data.at
    of_each: list[dict[tuple[float, ...], tuple[float, int]]] = []
    for row in rows:
        same = np.flatnonzero(at.sign == at.sign[row])
        losses = (asked.weight[row] * np.abs(asked.values[row] - asked.known[same]) ** 2).sum(axis=1)
        points = zip(*(axis[same].tolist() for axis in at.axes), strict=True)
        of_each.append(dict(zip(points, zip(losses.tolist(), same.tolist(), strict=True), strict=True)))
    common = [point for point in of_each[0] if all(point in own for own in of_each)]
    return {of_each[-1][point][1]: sum(own[point][0] for own in of_each) for point in common}
