"""Mistakes of measuring, looked for before any effect: each has one parameter for all orders.

Unit, sign, exchanged directions, a factor on one column, another zero of the angle, a drift, another reduction ratio;
what columns hold in place of what is meant is in `columns`, what sensors read wrong in `sensors`, wrong labels and
blocks of runs in `single_runs`. A missing effect changes its own orders; a mistake changes all of them alike, so that
every order has one vote (`votes`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from st_codegen.errors import Problems
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.checks import check_units, unit_choices
from st_codegen.reconcile.data.noise import middle_of
from st_codegen.reconcile.data.observations import SIGNS, Observations
from st_codegen.reconcile.data.ramps import (
    begin_text,
    in_steps,
    is_one_slope,
    ramp,
    ramp_deg,
    ramp_waves,
    start_of_ramp,
    without_ramp,
)
from st_codegen.reconcile.mistakes.columns import (
    copied_columns,
    other_conditions,
    other_gear,
    other_waves,
    shifted_columns,
    taken_off,
)
from st_codegen.reconcile.mistakes.each_run import ramps, zeros
from st_codegen.reconcile.mistakes.other_shaft import other_shaft
from st_codegen.reconcile.mistakes.sensors import (
    any_filter,
    hidden_wrong_angle,
    low_pass,
    mean_of_angles,
    wrong_angle,
    wrong_torques,
)
from st_codegen.reconcile.mistakes.single_runs import AS_IS, Mistake, hidden_labels, mistaken_runs
from st_codegen.reconcile.mistakes.starts import settling
from st_codegen.reconcile.mistakes.votes import (
    PowerSums,
    enough_orders,
    expected_of,
    gaps_fall,
    loud_orders,
    noise_power,
    power_sums,
)
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread

#: what `--accept` takes
NAMES = (
    "sign", "direction", "home_offset", "column_scale", "ratio", "drift", "shaft", "axis", "torque", "low_pass",
    "smoothing", "filter", "block", "labels", "start", "conditions", "taken_off", "copied", "shifted", "waves",
)  # fmt: skip


@dataclass(frozen=True)
class Examined:
    """Data as they are compared with the rig: corrected, with the mistakes found, and rows that are left out.

    untold: what was not asked since noise hides the answer; as_is: nothing more is asked about them.
    """

    data: Observations
    mistakes: tuple[Mistake, ...] = ()
    left_out: tuple[int, ...] = ()
    untold: tuple[str, ...] = ()
    as_is: bool = False

    @property
    def corrected(self) -> frozenset[str]:
        """Names of the mistakes that were taken out."""
        return frozenset(mistake.name for mistake in self.mistakes if mistake.is_taken_out)


@one_thread()
def examine(
    data: Observations,
    rig: RigModel,
    path: Path,
    *,
    scale: float | None = None,
    accept: Collection[str] = (),
    corrected: Collection[str] = (),
) -> Examined:
    """Data without the mistakes that `accept` names. Raises one InputError that asks about all others, but where data
    are taken as they are (AS_IS).

    corrected: names of mistakes that were, and are not looked for again.
    Wrong labels and a scaled block touch single runs: those are left out without being asked about.
    """
    if data.angle_rad is not None or not np.isfinite(data.values).all():
        return Examined(data)
    problems = Problems(str(path))
    data, found = _looked_through(data, rig, scale, accept, corrected, problems)
    whole = _with_expected(data, rig)
    is_told = enough_orders(whole, loud_orders(whole, rig))
    if scale is None and not is_told:
        with problems.collect():
            check_units(whole, rig, path)
    # what a filter has taken from single runs says nothing of their labels
    is_filtered = any(mistake.name == "filter" for mistake in found)
    runs = [] if is_filtered else mistaken_runs(data, rig) or []
    if problems.errors:
        # what concerns single runs is told in the same message
        for mistake in runs:
            problems.add(f"{mistake.text} (they will be left out)")
    problems.raise_if_any()
    left_out = tuple(sorted({row for mistake in runs for row in mistake.rows}))
    if data.both_directions() and not is_told:
        untold: tuple[str, ...] = (_UNTOLD,)
    else:
        untold = (_UNLABELLED,) if is_filtered else hidden_labels(data, rig)
    told = loud_orders(whole, rig, of_one=True) & (whole.orders > 0)
    if not data.both_directions() and told.sum() < SETTINGS.least_votes:
        untold += (_UNTOLD_WAVES,)
    if all(mistake.name != "axis" for mistake in found):
        untold += hidden_wrong_angle(whole, rig)
    return Examined(data, (*found, *runs), left_out, untold, AS_IS in accept)


def _looked_through(
    data: Observations,
    rig: RigModel,
    scale: float | None,
    accept: Collection[str],
    corrected: Collection[str],
    problems: Problems,
) -> tuple[Observations, list[Mistake]]:
    """Data corrected for all mistakes that are found one after the other, and these; what is asked goes to `problems`.

    So each is looked for in data without those before it.
    """
    found, whole = list[Mistake](), _with_expected(data, rig)
    for look in (*_OF_FORMS, partial(_common, scale=scale), *_OF_ANGLES, *_OF_SIZES):
        # conditions are told by sizes, of which those in another unit say nothing; and waves that stand in the wrong
        # place, or are not what they are taken for, say nothing of the gear
        is_unit = any(mistake.name == "unit" for mistake in found)
        if (is_unit and look in _OF_SIZES) or (look is other_gear and found):
            continue
        for mistake in look(whole, rig):
            if mistake.name in corrected:
                continue
            if AS_IS in accept and mistake.name != "unit" and not mistake.is_in(accept):
                found.append(replace(mistake, text=f"{mistake.text} (taken as it is)"))
                continue
            if mistake.corrected is not None:
                data = mistake.corrected(data)
                whole = _with_expected(data, rig)
            found.append(replace(mistake, text=f"{mistake.text} (corrected)", is_taken_out=True))
            # a unit, and what no correction of the data mends
            if mistake.corrected is None or (not mistake.is_in(accept) and "all" not in accept):
                problems.add(mistake.question)
        if look is other_gear:
            # nothing else can be told against the rig of another gear
            problems.raise_if_any()
    return data, found


def _with_expected(data: Observations, rig: RigModel) -> Observations:
    """Data in which a coefficient that its curve does not tell is as many times the rig's as others of its order are.

    So it says what these say, and nothing by itself; its noise is theirs.
    """
    if data.seen is None:
        return data
    expected = expected_of(data, rig)
    values, spectral = data.values.copy(), None if data.spectral_deg is None else data.spectral_deg.copy()
    for rows in data.at.by_direction():
        for k in range(len(data.orders)):
            told, untold = (np.flatnonzero(rows & is_told) for is_told in (data.seen[:, k], ~data.seen[:, k]))
            power = float((np.abs(expected[told, k]) ** 2).sum())
            times = np.vdot(expected[told, k], values[told, k]) / power if power else 1.0
            values[untold, k] = times * expected[untold, k]
            if spectral is not None:
                spectral[untold, k] = np.median(spectral[told, k]) if len(told) else 0.0
    return replace(data, values=values, spectral_deg=spectral)


# --- another ratio


def _ratio(data: Observations, rig: RigModel) -> list[Mistake]:
    size, scatter, start = ramp_deg(data.orders, data.values / in_steps(data.orders, data.samples))
    # single waves have any phase: only a ramp has one slope at all orders
    if (data.orders > 0).sum() < SETTINGS.least_votes or abs(size) < SETTINGS.ramp * scatter:
        size, start = _ramp_of_gap(data, rig)
    if not size or not _is_the_same_in_all_runs(data, rig, size, start):
        return []
    ratio = rig.constants.reduction_ratio
    used = ratio / (1 - size / 360.0)
    # as many digits as it takes to tell the one from the other
    digits = max(5, 2 - int(np.floor(np.log10(abs(size) / 360.0))))
    text = (
        f"TE rises by {size:.3g} deg over a turn{begin_text(start)} at every run, as if it had been computed with a "
        f"reduction ratio of {used:.{digits}g} instead of {ratio:g}"
    )
    return [
        Mistake(
            "ratio",
            text,
            lambda given: without_ramp(given, size, start),
            remedy="take the ramp out",
            reading="misread_ratio",
        )
    ]


def _is_the_same_in_all_runs(data: Observations, rig: RigModel, size: float, start: float) -> bool:
    """Whether a ramp of this size (deg) from this angle (rad) on is as large in slow runs as in fast ones, and so on.

    That of another ratio is; what settles behind the start of a curve is not.
    """
    told = data.orders > 0
    k = data.orders[told]
    gap = (data.values - expected_of(data, rig))[:, told] * np.exp(1j * start * k) / in_steps(k, data.samples)
    each = ramp(gap, noise_power(data)[:, told], k)
    for values in (data.at.speed_rpm, np.abs(data.at.torque_Nm), data.at.temperature_C):
        low = values <= np.median(values)
        if low.all():
            continue
        off = float(each[low].mean() - each[~low].mean())
        error = float(np.hypot(each[low].std() / np.sqrt(low.sum()), each[~low].std() / np.sqrt((~low).sum())))
        if abs(off) > max(SETTINGS.same_ramp * abs(size), SETTINGS.ramp * error):
            return False
    return True


def _ramp_of_gap(data: Observations, rig: RigModel) -> tuple[float, float]:
    """The ramp over a turn (deg) that the mean gaps of the orders share, 0 where they do not, and where it begins.

    Where TE wanders within a turn each run has a ramp of its own: that of all is told by how far those of the runs
    scatter.
    """
    told = data.orders > 0
    orders, rows = data.orders[told], len(data)
    if not orders.size:
        return 0.0, 0.0
    gaps = (data.values - expected_of(data, rig))[:, told] / in_steps(orders, data.samples)
    gap = gaps.mean(axis=0)
    least = SETTINGS.told * (np.abs(gaps - gap) ** 2).mean(axis=0) / rows
    start = start_of_ramp(gap[None], least[None], orders)
    turn = np.exp(1j * start * orders)
    gaps, gap = gaps * turn, gap * turn
    size = float(ramp(gap[None], least[None], orders)[0])
    left, right = (np.abs(part) ** 2 + least for part in (gap, gap - ramp_waves(size, orders)))
    sure = 1.0 / (orders**2 * np.maximum(least, 1e-300))
    each = np.pi * (gaps.imag * orders) @ sure / sure.sum()
    if abs(size) < SETTINGS.ramp * float(each.std()) / np.sqrt(rows):
        return 0.0, 0.0
    if not is_one_slope((np.pi * gap.imag * orders)[None], orders, size):
        return 0.0, 0.0
    if not start:
        return (size, start) if gaps_fall(left[None], right[None], least[None]) else (0.0, 0.0)
    # what happens at one angle has the phases of a ramp there, but no ramp is what most orders have
    told = left > np.exp(2 * SETTINGS.vote) * 2.0 * least
    most = np.mean(left[told] > np.exp(2 * SETTINGS.vote) * right[told]) if told.any() else 0.0
    most_fall = told.sum() >= SETTINGS.least_orders_of_zero and most > SETTINGS.most_orders
    # where noise hides most orders: together they save much, and what is left of all of them is noise (of each the
    # power over its own is exponential, with mean and deviation 1)
    before, after = (float(SETTINGS.told * (part / least - 1.0).sum()) for part in (left, right))
    only_noise = after < len(orders) + SETTINGS.told * np.sqrt(len(orders))
    return (size, start) if most_fall or (only_noise and before - after > 2 * SETTINGS.order_gain) else (0.0, 0.0)


# --- what all runs have in common


@dataclass(frozen=True)
class _Common:
    """What all orders of the runs may have in common: angle of home (rad), a sign and a factor a direction (2, 1)."""

    sums: PowerSums
    sign: FloatArray
    angle: float
    factors: FloatArray

    @property
    def gap(self) -> FloatArray:
        """The gap with all of it taken into account, (2, K)."""
        return self.left(self.sign * self.factors, self.angle)

    def left(self, scale: FloatArray, angle: float) -> FloatArray:
        """The gap with other factors or another angle, (2, K)."""
        return self.sums.gap(scale, np.exp(-1j * angle * self.sums.orders))


def _best(sums: PowerSums) -> _Common:
    """Sign, angle and factors that leave least, one vote an order however large it is."""
    factors = _factors(sums, np.abs(sums.product))
    grid = np.arange(0.0, 2 * np.pi, 2 * np.pi / (8 * max(int(sums.orders.max()), 1)))
    turns = np.exp(-1j * np.outer(grid, sums.orders))
    trials = []
    for sign in _SIGNS_OF_BOTH:
        left = sums.gap(sign * factors, turns[:, None, :])
        scores = np.log(sums.beyond_noise(left)).mean(axis=(1, 2))
        place = int(np.argmin(scores))
        # no turn and no sign where they gain nothing
        place = 0 if scores[0] < scores[place] + 1e-6 else place
        trials.append((float(scores[place]), sign, float(grid[place])))
    _, sign, angle = min(trials, key=lambda trial: trial[0] + 1e-6 * int((trial[1] < 0).sum()))
    angle = _between_steps(sums, sign, angle) if angle else angle
    along = sign * (sums.product * np.exp(1j * angle * sums.orders)).real
    return _Common(sums, sign, angle, _factors(sums, along))


def _between_steps(sums: PowerSums, sign: FloatArray, angle: float) -> float:
    """The angle of home (rad) near one of a grid that the orders agree on, each by how well its noise tells it.

    What the grid is off by would be a turn of every order, and a changed phase of all that the rig has.
    """
    for _ in range(SETTINGS.quick_steps):
        waves = sums.orders > 0
        turned = (sign * sums.product * np.exp(1j * angle * sums.orders))[:, waves]
        off = -np.angle(turned) / sums.orders[waves]
        error = sums.error[:, waves] / sums.orders[waves]
        angle += float(np.quantile(off, 0.5, method="inverted_cdf", weights=1.0 / np.maximum(error, 1e-12)))
    return angle


def _factors(sums: PowerSums, product: FloatArray) -> FloatArray:
    """The factor of each direction, (2, 1), of which a noisy order tells less."""
    ratio = np.maximum(product / np.maximum(sums.model, 1e-300), 1e-12)
    middle = partial(np.quantile, q=0.5, method="inverted_cdf")
    factors = np.array([[middle(side, weights=worth)] for side, worth in zip(ratio, sums.worth, strict=True)])
    # a factor so near to one may be the rig's own
    return np.where(np.abs(np.log(factors)) < np.log(SETTINGS.column_factor), 1.0, factors)


def _common(data: Observations, rig: RigModel, scale: float | None) -> list[Mistake]:
    """Unit, sign, directions, zero of the angle and factors of columns, all at once: they hide each other."""
    loud = loud_orders(data, rig)
    if not enough_orders(data, loud):
        return []
    same, other = (_best(power_sums(data, rig, loud, swapped)) for swapped in (False, True))
    swapped = same.sums.gap_falls(same.gap, other.gap)
    found = other if swapped else same
    is_all = same.sums.gap_falls(same.left(np.ones((2, 1)), 0.0), found.gap)
    exchanged = Mistake("direction", _DIRECTION, _swapped, remedy="swap them back", reading="exchanged_directions")
    mistakes = [exchanged] if swapped and is_all else []
    mistakes += _turns(found) if is_all else []
    of_medians = _of_median_runs(_swapped(data) if swapped else data, rig, loud, found)
    column, both = _column(found, of_medians)
    mistakes += column
    # the mean of runs in several units is in none of them
    middle = float(np.sqrt(np.prod(np.maximum(of_medians, 1e-12))))
    if not is_all or abs(np.log(both / middle)) > np.log(SETTINGS.other_size):
        return mistakes
    agreed = abs(np.log(both)) > np.log(SETTINGS.other_size) and _most_have_this(found.sums, both)
    if scale is None:
        choices = unit_choices(both, rig.constants.reduction_ratio, agreed=agreed)
    else:  # 1: it is as it is
        choices = _STILL.format(scale, both, scale / both) if scale != 1.0 and agreed else ""
    return [*mistakes, Mistake("unit", choices)] if choices else mistakes


def _turns(found: _Common) -> list[Mistake]:
    """Another zero of the angle and another sign, each where all orders together leave less with it."""
    mistakes = []
    offset = float(np.rad2deg(np.angle(np.exp(1j * found.angle))))
    unturned, unsigned = found.left(found.sign * found.factors, 0.0), found.left(found.factors, found.angle)
    if abs(offset) > SETTINGS.least_home_deg and found.sums.gap_falls(unturned, found.gap):
        text, turned = _HOME.format(offset), _turned(found.angle)
        mistakes.append(Mistake("home_offset", text, turned, remedy=_TURN, reading="misread_angle"))
    if found.sign.min() < 0 and found.sums.gap_falls(unsigned, found.gap):
        forward, backward = (float(x) for x in found.sign[:, 0])
        which = "" if forward == backward else " of forward curves" if forward < 0 else " of backward curves"
        mistakes.append(Mistake("sign", _SIGN.format(which), _times(forward, backward), remedy="turn it"))
    return mistakes


def _column(found: _Common, of_medians: tuple[float, float]) -> tuple[list[Mistake], float]:
    """A factor that one direction alone has, and the factor that both have beside it.

    of_medians: the factors of the median runs of the two directions.
    """
    forward, backward = (float(x) for x in found.factors[:, 0])
    both = float(np.sqrt(forward * backward))
    alike = found.left(found.sign * both, found.angle)
    is_told = (
        abs(np.log(forward / backward)) > np.log(SETTINGS.column_factor)
        # two orders have the same factor by a mistake, hardly by two effects
        and (_directions_differ(found.sums) or found.sums.gap_falls(alike, found.gap, effects=1))
        and _median_run_has(of_medians, forward / backward)
        and all(_most_have(found.sums, ratio) for ratio in (forward / backward, of_medians[0] / of_medians[1]))
    )
    if not is_told:
        return [], both
    # runs with the label of another one make the mean run smaller, and not the median one
    ratio = of_medians[0] / of_medians[1]
    if abs(np.log(forward)) > abs(np.log(backward)):
        which, factor, both, wrong = "forward", ratio, backward, (ratio, 1.0)
    else:
        which, factor, both, wrong = "backward", 1 / ratio, forward, (1.0, 1 / ratio)
    text, remedy = _COLUMN.format(which, factor), "divide by it"
    return [Mistake("column_scale", text, _times(*wrong), remedy=remedy, reading="misread_te")], both


def _directions_differ(sums: PowerSums) -> bool:
    """Whether the orders agree that the two directions have different factors.

    Each has one vote, and a missing effect moves its own orders only; gaps say little where single runs are wrong.
    """
    forward, backward = np.log(sums.size)
    middle, error = middle_of(forward - backward)
    return abs(middle) > SETTINGS.ramp * error


def _most_have(sums: PowerSums, factor: float) -> bool:
    """Whether most orders have this factor of forward over backward, each as well as its noise tells it.

    Of those that could tell it from no factor most must lie nearer to it.
    """
    size, error = sums.size, np.linalg.norm(sums.error / sums.size, axis=0)
    own, whole = np.log(size[0] / size[1]), np.log(factor)
    apart, tells = np.abs(own - whole), SETTINGS.told * error < abs(whole)
    near = bool((apart < np.hypot(np.log(SETTINGS.column_factor), SETTINGS.told * error)).mean() > 0.5)
    return near and (not tells.any() or bool((apart < np.abs(own))[tells].mean() > 0.5))


def _median_run_has(of_medians: tuple[float, float], factor: float) -> bool:
    """Whether the median runs of the two directions have this factor of forward over backward, rather than none.

    The mean of runs of which a few have the other sign is smaller, by a factor that no run has.
    """
    if min(of_medians) <= 0.0:
        return False
    own = float(np.log(of_medians[0] / of_medians[1]))
    return bool(abs(own) > np.log(SETTINGS.column_factor) and abs(own - np.log(factor)) < abs(own))


def _of_median_runs(data: Observations, rig: RigModel, loud: BoolArray, found: _Common) -> tuple[float, float]:
    """The factors of the median runs of the two directions: 0 and below where they have none."""
    known, turn = expected_of(data, rig)[:, loud], np.exp(1j * found.angle * data.orders[loud])
    power = np.maximum(np.abs(known) ** 2, 1e-300)
    sign = np.where(data.at.sign[:, None] > 0, *found.sign)
    along = sign * (data.values[:, loud] * known.conj() * turn).real / power
    # one vote an order, as far as it tells a factor
    worth = 1.0 / (noise_power(data)[:, loud] / (2 * power) + np.log(SETTINGS.column_factor) ** 2)
    each = np.quantile(along, 0.5, axis=1, method="inverted_cdf", weights=worth)
    sides = [data.at.sign == sign for sign in SIGNS]
    forward, backward = (
        _by_those_that_agree(float(np.median(each[rows])), along[rows], noise_power(data)[rows][:, loud] / power[rows])
        for rows in sides
    )
    return forward, backward


def _by_those_that_agree(middle: float, along: FloatArray, noise: FloatArray) -> float:
    """A factor nearer than the middle one of many orders, of which those that agree with it say as much as they tell.

    along: the factors of runs and orders (n, K); noise: the power of the noise over that of the rig, (n, K).
    """
    # runs in which an order is small, as one of the load without any, say little of it
    worth = np.sqrt(2.0 / np.maximum(noise, 1e-300))
    own = np.quantile(along, 0.5, axis=0, method="inverted_cdf", weights=worth)
    error = 1.0 / np.sqrt((worth**2).sum(axis=0))
    # what the middle one is off by, by how the orders lie about it
    off = float(np.median(np.abs(own - middle))) / np.sqrt(len(own))
    agree = np.abs(own - middle) < SETTINGS.told * np.hypot(error, off)
    if not agree.any():
        return middle
    return float(np.average(own[agree], weights=1.0 / np.maximum(error[agree], 1e-12) ** 2))


def _most_have_this(sums: PowerSums, factor: float) -> bool:
    """Whether nearly all orders that can tell have this factor in both directions, each as well as it tells it.

    And in nearly all runs: of runs that differ in sign a factor of all leaves most of an order.
    """
    size, error = sums.size, sums.error / sums.size
    apart, tells = np.abs(np.log(size / factor)), SETTINGS.told * error < abs(np.log(factor))
    near = apart < np.hypot(np.log(SETTINGS.column_factor), SETTINGS.told * error)
    near &= sums.scatter < SETTINGS.left_of_factor * sums.measured
    return bool(tells.sum() >= 2 * SETTINGS.least_votes and near[tells].mean() > SETTINGS.nearly_all)


_STILL = (
    "with --scale {:.6g} the measured TE is {:.3g} times the rig's in nearly all orders alike: give --scale {:.6g}; if "
    "all parts of the machine really are of another size, take out the unit's factor from the files and give --scale 1"
)
_UNTOLD = (
    f"fewer than {SETTINGS.least_votes} orders of the rig stand above the noise in both directions: exchanged "
    "directions, another sign, another zero of the angle, a factor on one column, or waves by another convention (RMS, "
    "from peak to peak, phases of sines) cannot be told from an effect, nor a run that carries the label of another "
    "one from noise"
)
_UNTOLD_WAVES = (
    f"fewer than {SETTINGS.least_votes} orders of the rig stand above the noise, in one direction: waves by another "
    "convention (RMS, from peak to peak, phases of sines) cannot be told from an effect"
)
_UNLABELLED = (
    "what a filter took from single runs looks like another label: whether runs carry that of another one was not asked"
)
_DIRECTION = (
    "forward and backward seem to be exchanged: each direction of the data agrees with the other one of the rig"
)
_HOME = (
    "the zero of the angle (home) seems shifted: with every order k turned back by k times {:.2f} deg all orders "
    "together come nearer to the rig, and no effect turns them so"
)
_TURN = "turn all orders back"
_SIGN = "TE{} seems to have the opposite sign of the rig's: with that turned all orders together come nearer to the rig"
#: of forward and of backward curves: a TE of distances, |theta_out| - |theta_in| / tau, has the other sign backward
_SIGNS_OF_BOTH = [np.array([[a], [b]]) for a, b in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))]
_COLUMN = "the {} column is {:.3g} times what the other one lets expect, in most orders"

_ZEROS = (
    "{} of {} runs seem to have a zero of the angle (home) of their own, by up to {:.2f} deg: with every order k of "
    "such a run turned back by k times its own all orders together come nearer to the rig, and no effect turns them so"
)
_DRIFT = (
    "TE does not come back to where the turn began{}, by up to {:.2g} deg, by another amount in each {}: something "
    "drifts while a turn is measured, or a part turns more slowly than the output"
)


def _without_drift(drift: FloatArray, start: float) -> Callable[[Observations], Observations]:
    """Data without the ramp of each row, and without their mean: when within the turn the drift began nobody knows."""

    def corrected(data: Observations) -> Observations:
        waves = data.of_orders(data.orders > 0, "the mean: the drift within the turn moves it by an unknown part")
        return replace(waves, values=waves.values - ramp_waves(drift[:, None], waves.orders, start))

    return corrected


def _swapped(data: Observations) -> Observations:
    return data.under(sign=-data.at.sign)


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
    number = data.number_of_run
    model = expected_of(data, rig)
    noise, speed = noise_power(data), data.at.sign * data.at.speed_rpm
    angle, error = zeros(data.values, model, noise, data.orders, number, speed, data.spectral_deg is not None)
    angle = np.where(_of_other_sign(data, model, angle), 0.0, angle)
    if not angle.any():
        return []
    text = _ZEROS.format(len(np.unique(number[angle != 0])), number.max() + 1, np.degrees(np.abs(angle)).max())

    def corrected(given: Observations) -> Observations:
        told = given.orders * error < SETTINGS.told_turn
        turned = replace(given, values=given.values * np.exp(1j * angle[:, None] * given.orders))
        if told.all():
            return turned
        lost = f"orders from {given.orders[~told].min()} on: the zeros of the runs are not told well enough for them"
        return turned.of_orders(told, lost)

    return [Mistake("home_offset", text, corrected, remedy=_TURN)]


def _of_other_sign(data: Observations, model: ComplexArray, angle: FloatArray) -> BoolArray:
    """The rows of runs of which another sign of TE leaves less than another zero of the angle does, (n,).

    Half a turn changes the sign of all odd orders, and in noise the loudest of them may decide; a sign changes that of
    the mean as well. One vote an order. model: (n, K); angle: of the zero of each row's run, rad, (n,).
    """
    number, power = data.number_of_run, np.maximum(noise_power(data), 1e-300)
    turned, other = (
        np.log(np.maximum(np.abs(data.values - one) ** 2, power)).sum(axis=1)
        for one in (model * np.exp(-1j * angle[:, None] * data.orders), -model)
    )
    return np.asarray(np.bincount(number, other - turned)[number] < 0.0)


def _drift(data: Observations, rig: RigModel) -> list[Mistake]:
    """A drift within the turn that differs from run to run; one that all have is another ratio."""
    noise = noise_power(data)
    gap = data.values - expected_of(data, rig)
    start = start_of_ramp(gap, noise, data.orders)
    found = ramps(gap, noise, data.orders, start)
    common = ramp_waves(np.median(found), data.orders, start)
    if not found.any() or not ramps(gap - common, noise, data.orders, start).any():
        return []
    began = f" ({np.degrees(start):.1f} deg)" if start else ""
    sides = np.zeros(len(data))
    for rows in data.at.by_direction():
        sides[rows] = np.median(found[rows])
    of_sides = ramp_waves(sides[:, None], data.orders, start)
    each = "run" if ramps(gap - of_sides, noise, data.orders, start).any() else "direction"
    text = _DRIFT.format(began, np.abs(found).max(), each)
    return [Mistake("drift", text, _without_drift(found, start), remedy="take it out")]


#: What is looked for, in this order: the form of columns and curves, what all orders have in common (`_common`), the
#: angle, and what the sizes of orders tell.
_OF_FORMS = (copied_columns, shifted_columns, taken_off, other_waves, other_gear, settling, _drift, _ratio)
_OF_ANGLES = (other_shaft, _zeros, wrong_angle)
_OF_SIZES = (other_conditions, wrong_torques, low_pass, mean_of_angles, any_filter)
