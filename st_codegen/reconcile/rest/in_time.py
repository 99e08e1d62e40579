"""What the order of the runs tells: a tool exchanged in mid-campaign, a part that wears, a body behind the oil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import orth

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.chances import chi_square_tail, f_tail
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.lasting import alike, length
from st_codegen.reconcile.rest.shapes import ramps, steps_and_ramps
from st_codegen.reconcile.rest.unseen import one_after_the_other
from st_codegen.reconcile.settings import SETTINGS

#: what is said of a course that noise may be
_MAY_LAST = ", which noise that lasts over runs may look like"


@dataclass(frozen=True)
class Course:
    """A step, a trend or a lag over the runs: its mean power (deg^2), the size of the change (deg), and a phrase.

    is_lag: whether it follows the oil; conditions: those that the phrase names (`speed`, `torque`, `temperature`);
    may_last: whether noise that lasts over runs may look like it.
    """

    power: float
    amplitude_deg: float
    text: str
    is_lag: bool = False
    conditions: frozenset[str] = frozenset()
    may_last: bool = False


def course_of(target: FitData, z: ComplexArray, whole: ComplexArray, parts: IntArray) -> list[Course | None]:
    """For each order the step, ramp or lag of its residual over the runs; None where noise may look like it.

    z: in noises (n, K), cut, so that single wild runs make no step; whole: the same as it is, which sizes come from;
    both zero for bad runs. None where the order of the runs is not known as well. Noise that lasts over runs wanders:
    a step or a trend is more than that where it takes off most of an order, or where it leaves noise that is
    independent from run to run, and the other orders do not wander either. What is of one size may come with a load,
    have its sign, and not be there without one: so play shows that wears. Else it may be in proportion to a condition.
    """
    found: list[Course | None] = [None] * z.shape[1]
    if target.data.run is None:
        return found
    usual = np.maximum(1.0, np.sqrt((np.abs(whole[target.good]) ** 2).mean(axis=0)))
    few_wild = whole * np.minimum(1.0, SETTINGS.cut * usual / np.maximum(np.abs(whole), 1e-300))
    for along in _ways(target):
        for k, course in enumerate(_courses(target, z, whole, few_wild, parts, along)):
            if found[k] is None and course is not None:
                found[k] = course if course.is_lag else _in_proportion(target, few_wild, k, course, along)
    return found


@dataclass(frozen=True)
class _Along:
    """What a course may follow beside the order of the runs: weights (n,) of at most 1, and what is said of it."""

    weights: FloatArray
    text: str = ""


def _ways(target: FitData) -> list[_Along]:
    """The ways of what is of one size, of the rows that count: the simplest first."""
    sign = np.sign(target.data.at.torque_Nm)
    with_load = [_Along(sign, ", with the load")] if len(np.unique(sign[target.good])) > 1 else []
    return [_Along(np.ones(len(sign))), *with_load]


def _in_proportion(target: FitData, few_wild: ComplexArray, k: int, course: Course, along: _Along) -> Course:
    """The course of an order in proportion to the torque or the speed where that leaves clearly less; else as it is.

    Each beside a constant and the condition itself, of which the rig's own numbers have taken off what they could.
    Where both together leave clearly less than either, its size depends on the condition, in no proportion to it.
    few_wild: in noises, (n, K); along: the way of the course.
    """
    at, good = target.data.at, target.good
    z, numbers = few_wild[:, k], _numbers(target, k)
    if along.text:
        along, course = _without_load(target, z, k, course, along)
    best = SETTINGS.order_gain, course
    # a condition that the runs go through once, times the time, is about its square: a law of it does that as well
    gone_through = one_after_the_other(target.data)
    for values, name, unit in ((at.torque_Nm, "torque", "N m"), (at.speed_rpm, "speed", "rpm")):
        most = float(np.abs(values[good]).max(initial=0.0))
        if len(np.unique(np.abs(values[good]))) < 2:
            continue
        weights = values / most
        share = float(weights[good] @ along.weights[good] / max((along.weights[good] ** 2).sum(), 1e-300))
        ways = np.stack([along.weights, weights - share * along.weights], axis=1)
        (plain, _), (left, of_load), (both, of_two) = (
            _beside(target, z, base, own)
            for base, own in ((ways[:, :1], ways[:, :1]), (weights[:, None], weights[:, None]), (ways, ways))
        )
        # of a scatter that nobody knows, likelihoods differ by the logarithm of what is left
        gain, of_both = (float(numbers * np.log(plain / one)) for one in (left, both))
        if of_both > max(best[0], gain + SETTINGS.order_gain) and name not in gone_through:
            if not _is_of_the_condition(target, z, ways, plain - both):
                continue
            # beside the mean size, which is told with the constant
            gain, found = of_both, _course_of(target, k, z - of_two[:, [2, -1]].sum(axis=1), along.weights)
            found = replace(found, power=course.power)
            said = f"{found.text}{along.text}, of another size at another {name}"
        elif gain > best[0]:
            found = _course_of(target, k, z - of_load[:, 0], weights)
            said = f"{found.text}, in proportion to the {name}: so much at {most:g} {unit}"
        else:
            continue
        said += _MAY_LAST * course.may_last
        best = gain, replace(found, text=said, conditions=frozenset([name]), may_last=course.may_last)
    return best[1]


def _is_of_the_condition(target: FitData, z: ComplexArray, ways: FloatArray, gained: float) -> bool:
    """Whether the second of two ways (n, 2) takes off twice as much of an order as its values at other runs do.

    A course is neither a step nor a ramp to the last digit: what these leave of it lasts over runs and is alike in both
    directions, and the values of any condition follow a part of it. z: (n,), in noises; gained: what both ways take off
    beyond the first, in noises squared.
    """
    run = target.data.run
    assert run is not None
    _, first, place = np.unique(run, return_index=True, return_inverse=True)
    random, plain, most = np.random.default_rng(0), _beside(target, z, ways, ways[:, :1])[0], 0.0
    for number in range(SETTINGS.other_orders_of_runs):
        if number >= SETTINGS.few_orders_of_runs and SETTINGS.beyond_few_orders * most < gained:
            break
        mixed = ways[first[random.permutation(len(first))][place], 1]
        left, _ = _beside(target, z, ways, np.stack([ways[:, 0], mixed], axis=1))
        most = max(most, plain - left)
        if 2.0 * most >= gained:
            return False
    return True


def _without_load(target: FitData, z: ComplexArray, k: int, course: Course, along: _Along) -> tuple[_Along, Course]:
    """The way and the course of what is there without a load as well, where that leaves clearly less; else as they are.

    z: (n,), in noises; along: the way of what comes with the load.
    """
    torque = target.data.at.torque_Nm
    load, alone = torque / max(float(np.abs(torque[target.good]).max(initial=0.0)), 1e-300), np.ones(len(z))
    with_load = np.stack([along.weights, load], axis=1)
    some, all_ways = (_beside(target, z, with_load, own)[0] for own in (with_load, np.column_stack([with_load, alone])))
    if _numbers(target, k) * np.log(some / all_ways) <= SETTINGS.order_gain:
        return along, course
    plain = _course_of(target, k, z, alone)
    return _Along(alone), replace(plain, text=plain.text + _MAY_LAST * course.may_last, may_last=course.may_last)


def _numbers(target: FitData, k: int) -> int:
    """How many measured numbers of an order count."""
    return int(target.good.sum()) * (2 if target.data.orders[k] else 1)


def _course_of(target: FitData, k: int, z: ComplexArray, weights: FloatArray) -> Course:
    """The step or ramp, times weights (n,), of what one order has: z (n,), in noises."""
    run = target.data.run
    assert run is not None
    places = np.unique(run[target.good])
    place = np.searchsorted(places, run)
    sums, in_deg = (_by_run(target, one[:, None], place, len(places), weights) for one in (z, z * target.sigma[:, k]))
    return _described(sums, in_deg, 0, _numbers(target, k))


def _beside(target: FitData, z: ComplexArray, base: FloatArray, ways: FloatArray) -> tuple[float, ComplexArray]:
    """What the best step or ramp, times each of some ways (n, q), leaves of an order (n,) beside a constant and a base.

    base: (n, p). In noises, squared; and the parts of the constant, the base and the ways, (n, 1 + p + q), with a size
    of each in each direction.
    """
    run, good = target.data.run, target.good
    assert run is not None
    places = np.unique(run[good])
    place, count = np.searchsorted(places, run), len(places)
    profiles = steps_and_ramps(count)
    beside = np.column_stack([np.ones(len(z)), base])
    gains, left, parts = np.zeros(profiles.shape[1]), 0.0, np.zeros((len(z), beside.shape[1] + ways.shape[1]), complex)
    directions = target.data.at.by_direction(good)
    for rows in directions:
        q = orth(beside[rows], rcond=1e-8)
        y, before = z[rows] - q @ (q.T @ z[rows]), list[FloatArray]()
        for way in ways[rows].T:
            x = way[:, None] * profiles[place[rows]]
            x = x - q @ (q.T @ x)
            for one in before:
                x = x - one * ((one * x).sum(axis=0) / np.maximum((one * one).sum(axis=0), 1e-9))
            gains += np.abs(x.T @ y) ** 2 / np.maximum((x * x).sum(axis=0), 1e-9)
            before.append(x)
        left += float((np.abs(y) ** 2).sum())
    best = int(gains.argmax())
    for rows in directions:
        own = np.column_stack([beside[rows], ways[rows] * profiles[place[rows], best][:, None]])
        parts[rows] = own * np.linalg.lstsq(own, z[rows], rcond=None)[0]
    return max(left - float(gains[best]), 1e-9), parts


def _courses(
    target: FitData, z: ComplexArray, whole: ComplexArray, few_wild: ComplexArray, parts: IntArray, along: _Along
) -> list[Course | None]:
    """The courses that follow one way, in the order of the runs; few_wild: in noises, single wild runs cut, (n, K)."""
    run, good = target.data.run, target.good
    found: list[Course | None] = [None] * z.shape[1]
    if run is None or (along.weights[good] != 0.0).sum() < SETTINGS.least_in_time:
        return found
    numbers = np.unique(run[good])
    place, count = np.searchsorted(numbers, run), len(numbers)
    own = (z, whole, whole * target.sigma)
    sums, sizes, in_deg = (_by_run(target, one, place, count, along.weights) for one in own)
    total = int((along.weights[good] != 0.0).sum())
    all_numbers = total * parts.astype(np.float64)
    (steps, cuts), (trends, bends) = _steps(sums, count), _ramps(sums, count, all_numbers)
    varying, varying_whole = _varying(sums), _varying(sizes)
    sigma = np.sqrt((target.sigma[good] ** 2).mean(axis=0))
    gains = np.maximum(steps, trends)
    # where runs were made in any order of conditions, neighbours take a step for noise: what it leaves is the noise
    lefts = np.maximum(varying - gains, 1e-300)
    # it is told by so many numbers, beside the means and what steps
    known = np.maximum(all_numbers - 2.0 * parts * len(sums), 1.0)
    scales = np.clip(lefts / known, 1e-6, 1.0)
    rest = _without_courses(sums, cuts, bends, steps >= trends)
    again = np.maximum(_steps(rest, count)[0], _ramps(rest, count, all_numbers)[0])
    degrees, tried = parts * len(sums), count + len(ramps(count))
    p_white, p_again = (f_tail(one / scales / degrees, degrees, known) * tried for one in (gains, again))
    alone = _others_are_quiet(p_white, cuts, count) & (p_again > SETTINGS.p_wander)
    lags = _lags(target, sizes, numbers, place)
    near, sure = _by_run(target, few_wild, place, count, along.weights), list[int]()
    share = total / int(good.sum())
    for k in range(z.shape[1]):
        lag = lags[k]
        least = lefts[k] / max(varying[k], 1e-300) * varying_whole[k]
        if lag is not None and lag.left < least and lag.is_sure(int(degrees[k])):
            power = (varying_whole[k] - lag.left) / total * sigma[k] ** 2
            size, text = float(sigma[k]) * lag.reach, lag.text(float(sigma[k]))
            found[k] = Course(float(power) * share, size, text, is_lag=True, conditions=frozenset(["temperature"]))
            continue
        if gains[k] < SETTINGS.least_excess_in_time * lefts[k] and not alone[k]:
            continue
        lasting = _lasting([(series[:, k], weight) for series, weight in sums], int(cuts[k]))
        if f_tail(gains[k] / (lasting * scales[k]) / degrees[k], degrees[k], known[k]) * tried > SETTINGS.p_changed:
            continue
        sure.append(k)
    of_sure = tuple((series[:, sure], weight) for series, weight in sums)
    for k in np.array(sure, np.int64)[_are_of_their_order(of_sure, gains[sure], all_numbers[sure])]:
        course = _described(near, in_deg, k, total * int(parts[k]))
        text = f"{course.text}{along.text}"
        text = text if alone[k] else f"{text}{_MAY_LAST}"
        found[k] = replace(course, text=text, power=share * course.power, may_last=not alone[k])
    return found


def _are_of_their_order(sums: _ByRun, gains: FloatArray, numbers: FloatArray) -> BoolArray:
    """Whether the runs in any other order have no step and no ramp that gains as much, of each order (K,).

    A few loud runs, as slow ones that stick and slip, make a step wherever they stand. numbers: how many an order has.
    """
    random, count, most = np.random.default_rng(0), len(sums[0][0]), np.zeros(len(gains))
    for number in range(SETTINGS.other_orders_of_runs):
        # most steps are far larger than what any other order of the runs has
        near = 2.0 * most >= gains if number >= SETTINGS.few_orders_of_runs else np.ones(len(gains), bool)
        asked = near & (most < gains)
        if not asked.any():
            break
        mixed = random.permutation(count)
        other = tuple((series[np.ix_(mixed, asked)], weight[mixed]) for series, weight in sums)
        gained = np.maximum(_steps(other, count)[0], _ramps(other, count, numbers[asked])[0])
        most[asked] = np.maximum(most[asked], gained)
    return np.asarray(most < gains)


def _described(near: _ByRun, in_deg: _ByRun, k: int, numbers: int) -> Course:
    """The step or ramp that an order has, by its residual as it is.

    Cut at some noises, as a decision needs it, what is many noises large would be a step whatever its form. near: in
    noises, of which single wild runs are cut; in_deg: as they are; numbers: how many tell the order in all.
    """
    own = tuple((series[:, k : k + 1], weight) for series, weight in near)
    count, rows = len(own[0][0]), sum(int((weight > 0.0).sum()) for _, weight in own)
    (steps, cuts), varying = _steps(own, count), _varying(own)
    trends, bends = _ramps(own, count, np.array([float(numbers)]))
    if steps[0] >= trends[0]:
        cut = int(cuts[0])
        power = _gains_of_steps(in_deg)[cut - 1, k] / rows
        size = max(abs(_difference(series[:, k], weight, cut, len(series))) for series, weight in in_deg)
        left = max(float(varying[0] - steps[0]), 0.0) / numbers
        one = [(series[:, 0], weight) for series, weight in own]
        runs = _runs_beside(own, cut, left)
        return Course(float(power), size, _step_text(size, runs, count, *_share_at_once(one, cut, left)))
    shape = ramps(count)[bends[0]]
    slopes = [_slopes(series[:, k : k + 1], weight, shape[None]) for series, weight in in_deg]
    power = sum(abs(slope[0, 0]) ** 2 * square[0] for slope, square in slopes) / rows
    size = float(max(abs(slope[0, 0]) for slope, _ in slopes)) * float(np.ptp(shape))
    return Course(float(power), size, _ramp_text(shape, size))


def _runs_beside(own: _ByRun, cut: int, scale: float) -> tuple[int, int]:
    """The numbers of the runs between which a step of one order may lie as well as behind run `cut`; scale: of noise.

    Where the step would not show, as without a load, or where it is no larger than noise, no run says on which side it
    is.
    """
    gains = _gains_of_steps(own)[:, 0]
    least = SETTINGS.told**2 * scale + 1e-9 * gains[cut - 1]
    refused = np.flatnonzero(gains[cut - 1] - gains > least) + 1
    return int(refused[refused < cut].max(initial=0)) + 1, int(refused[refused > cut].min(initial=len(gains) + 1))


def _step_text(size: float, runs: tuple[int, int], count: int, share: float, error: float) -> str:
    """What is said of a change that a step explains best, of which a share lies between the two runs beside its cut."""
    there = f"between run {runs[0]} and run {runs[1]} of {count}, in their order"
    if share - SETTINGS.told * error > SETTINGS.at_once:
        return f"a step of {size:.2g} deg {there}"
    if share + SETTINGS.told * error < 1.0:
        return f"moves by some {size:.2g} deg over the {count} runs in their order, in no single step"
    return f"a step of {size:.2g} deg {there}, or a change over some runs around"


def _others_are_quiet(p: FloatArray, cuts: IntArray, count: int) -> BoolArray:
    """Whether few of the other orders wander over the runs, (K,), of chances that each does not.

    Noise that lasts makes all orders wander, each in its own way; what was mounted anew makes them step at one run.
    False where there are too few others to tell.
    """
    wanders, near = p < SETTINGS.p_wander, np.abs(cuts[:, None] - cuts[None, :]) <= max(1, count // 50)
    others = wanders[None, :] & ~near
    few = others.sum(axis=1) <= SETTINGS.most_wandering * (len(p) - 1)
    return np.asarray(few & (len(p) > SETTINGS.near_floors))


#: Of each direction the sums by run of a residual times its weights (runs, K), and of their squares (runs,).
_ByRun = tuple[tuple[ComplexArray, FloatArray], ...]
#: a weight that divides nothing: what has no weight is zero itself
_NONE = 1e-300


def _by_run(target: FitData, z: ComplexArray, place: IntArray, count: int, weights: FloatArray) -> _ByRun:
    found = []
    for rows in target.data.at.by_direction(target.good):
        series, weight = np.zeros((count, z.shape[1]), np.complex128), np.zeros(count)
        np.add.at(series, place[rows], z[rows] * weights[rows, None])
        np.add.at(weight, place[rows], weights[rows] ** 2)
        found.append((series, weight))
    return tuple(found)


def _varying(sums: _ByRun) -> FloatArray:
    """The sum of squares of a residual about its mean in each direction, (K,): what all runs have is no step."""
    powers = [
        (np.abs(series) ** 2 / np.maximum(weight, _NONE)[:, None]).sum(axis=0)
        - np.abs(series.sum(axis=0)) ** 2 / max(float(weight.sum()), _NONE)
        for series, weight in sums
    ]
    return np.asarray(sum(powers))


def _share_at_once(sums: Sequence[tuple[ComplexArray, FloatArray]], cut: int, scale: float) -> tuple[float, float]:
    """Which part of a step lies between the runs right before and right behind it, and the error of that.

    sums: of each direction, in noises, by run, with the weights; scale: of their noise.
    """
    along, power, near = 0.0, 0.0, max(2, len(sums[0][0]) // 16)
    for series, weight in sums:
        whole, own = (_difference(series, weight, cut, reach) for reach in (len(series), near))
        along += float((whole.conjugate() * own).real)
        power += abs(whole) ** 2
    # the means of so many runs on both sides
    error = np.sqrt(2.0 * max(scale, 1e-12) / (near * max(power, 1e-300)))
    return along / max(power, 1e-300), float(error)


def _difference(series: ComplexArray, weight: FloatArray, cut: int, reach: int) -> complex:
    """The mean of so many runs behind a cut less that of as many before it."""
    parts = slice(max(cut - reach, 0), cut), slice(cut, cut + reach)
    before, after = (complex(series[part].sum() / max(float(weight[part].sum()), _NONE)) for part in parts)
    return after - before


def _gains_of_steps(sums: _ByRun) -> FloatArray:
    """The gain of one step in each order behind the first run, behind the second, ... (runs - 1, K)."""
    gains = 0.0
    for series, weight in sums:
        before, n = np.cumsum(series, axis=0)[:-1], np.cumsum(weight)[:-1, None]
        after, m = series.sum(axis=0) - before, weight.sum() - n
        whole = np.abs(series.sum(axis=0)) ** 2 / max(weight.sum(), _NONE)
        gains = gains + np.abs(before) ** 2 / np.maximum(n, _NONE) + np.abs(after) ** 2 / np.maximum(m, _NONE) - whole
    return np.asarray(gains)


def _steps(sums: _ByRun, count: int) -> tuple[FloatArray, IntArray]:
    """The largest gain of one step in each order (K,), and how many runs lie before it."""
    edge = max(2, count // 20)
    inner = _gains_of_steps(sums)[edge - 1 : count - edge]
    best = inner.argmax(axis=0)
    return inner.max(axis=0), best + edge


def _ramp_text(shape: FloatArray, size: float) -> str:
    count, moves = len(shape), np.flatnonzero(np.diff(shape))
    first, last = int(moves[0]) + 1, int(moves[-1]) + 2
    if (first, last) == (1, count):
        return f"a trend of {size:.2g} deg over the {count} runs in their order"
    where = f"from about run {first} on" if last == count else f"until about run {last}"
    return f"a trend of {size:.2g} deg {where}, of {count} in their order"


def _about(shapes: FloatArray, weight: FloatArray) -> FloatArray:
    """Shapes (.., runs) about their means."""
    share = np.maximum(weight, 1e-9)
    return np.asarray(shapes - (shapes @ share / share.sum())[..., None])


def _slopes(series: ComplexArray, weight: FloatArray, shapes: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """What of each shape (m, runs) is in each order beside a constant, (m, K), and their sums of squares, (m,)."""
    x = _about(shapes, weight)
    square = np.maximum((weight * x * x).sum(axis=1), 1e-300)
    mean = series.sum(axis=0) / max(float(weight.sum()), _NONE)
    # of real and imaginary parts as columns: shapes as complex numbers would take ten times as long
    parts = np.ascontiguousarray(series - weight[:, None] * mean).view(np.float64)
    return np.asarray((x @ parts).view(np.complex128) / square[:, None]), square


def _ramps(sums: _ByRun, count: int, numbers: FloatArray) -> tuple[FloatArray, IntArray]:
    """The gain of the best ramp over the runs in each order (K,), and which of the shapes it has.

    One the whole way stands where a bend takes off hardly more. numbers: how many an order has in all, (K,).
    """
    shapes = ramps(count)
    gains = np.zeros((len(shapes), sums[0][0].shape[1]))
    for series, weight in sums:
        slopes, square = _slopes(series, weight, shapes)
        gains += np.abs(slopes) ** 2 * square[:, None]
    best, most = gains.argmax(axis=0), gains.max(axis=0)
    clear = most - gains[0] > SETTINGS.as_good * np.maximum(_varying(sums) - most, 0.0) / numbers
    best = np.where(clear, best, 0)
    return gains[best, np.arange(gains.shape[1])], best


def _without_courses(sums: _ByRun, cuts: IntArray, bends: IntArray, is_step: BoolArray) -> _ByRun:
    """The sums by run without the best step, or the best ramp, of each order and direction."""
    found = []
    shapes = ramps(len(sums[0][0]))
    for series, weight in sums:
        before = np.arange(len(series))[:, None] < cuts[None, :]
        level, ramp = np.zeros_like(series), np.zeros_like(series)
        for part in (before, ~before):
            rows = (weight[:, None] * part).sum(axis=0)
            level += part * (series * part).sum(axis=0) / np.maximum(rows, 1e-9)
        mean = series.sum(axis=0) / max(float(weight.sum()), 1e-9)
        for bend in np.unique(bends):
            own = bends == bend
            slopes, _ = _slopes(series[:, own], weight, shapes[bend : bend + 1])
            ramp[:, own] = mean[own] + _about(shapes[bend], weight)[:, None] * slopes
        found.append((series - weight[:, None] * np.where(is_step, level, ramp), weight))
    return tuple(found)


#: runs that a body may take to come near the oil: to 63 % of a change
_LAGS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.7, 8.0, 11.0, 16.0, 23.0, 32.0, 45.0, 64.0)


@dataclass(frozen=True)
class _Lag:
    """What the temperature of a body that follows the oil late explains of an order, over what the oil's own does.

    runs: that it takes, 0 where only by how much the oil changed since the run before counts; gain, left: of the sums
    of squares, by it and by nothing; per_K, reach: in noises, by kelvin and from its least to its largest; lasting: how
    many runs the noise that is left lasts; count: numbers that tell it.
    """

    runs: float
    gain: float
    left: float
    per_K: float
    reach: float
    lasting: float
    count: int

    def is_sure(self, numbers: int) -> bool:
        """Whether noise, of which `numbers` are fitted, does not explain as much."""
        if self.gain < SETTINGS.least_excess_in_time * self.left:
            return False
        scale = self.lasting * min(max(self.left / self.count, 1e-6), 1.0)
        return chi_square_tail(self.gain / scale, numbers) * len(_LAGS) < SETTINGS.p_changed

    def text(self, sigma: float) -> str:
        """A phrase; sigma: the noise, deg."""
        if not self.runs:
            return (
                "depends on by how much the oil temperature differs from that of the run before: "
                f"{sigma * self.per_K:.2g} deg per kelvin, as a body that follows the oil late makes it, or a sensor "
                "of the oil that is late itself"
            )
        return (
            f"follows the oil temperature late, as a body that takes some {self.runs:.2g} runs to come near it: "
            f"{sigma * self.per_K:.2g} deg per kelvin"
        )


@dataclass(frozen=True)
class _Oil:
    """The temperature of the oil run by run, and the sums of residuals of each run by direction (runs, K), weights."""

    temperature_C: FloatArray
    sums: _ByRun

    def lags(self, runs: float) -> list[_Lag]:
        """What a body that takes so many runs explains of each order, (K,); of 0 the change since the run before does.

        In each direction with a size of its own, beyond a constant, the oil itself, and a start that nobody knows.
        """
        oil, kept = self.temperature_C, np.exp(-1.0 / runs) if runs else 0.0
        body = np.diff(oil, prepend=oil[0])
        if runs:
            body[0] = oil[0]
            for n in range(1, len(oil)):
                body[n] = kept * body[n - 1] + (1.0 - kept) * oil[n]
        base = np.stack([np.ones(len(oil)), oil, kept ** np.arange(len(oil))], axis=1)
        before, after, slopes, count = [], [], [], 0
        for series, weight in self.sums:
            root = np.sqrt(weight)[:, None]
            q = np.linalg.qr(base * root)[0]
            own, y = body[:, None] * root, series / np.where(root, root, 1.0)
            own, y = (part - q @ (q.T @ part) for part in (own, y))
            slopes.append((own.T @ y)[0] / max(float((own**2).sum()), 1e-12 * float((body**2).sum())))
            before.append(y)
            after.append(y - own * slopes[-1])
            count += max(int((weight > 0).sum()) - base.shape[1] - 1, 0)
        whole, left = (sum((np.abs(one) ** 2).sum(axis=0) for one in part) for part in (before, after))
        size, lasting = np.abs(slopes).max(axis=0), length(alike(after))
        columns = np.stack([whole - left, left, size, size * np.ptp(body), lasting], axis=1).tolist()
        return [
            _Lag(runs, gain, rest, per_K, reach, lasts, max(count, 1)) for gain, rest, per_K, reach, lasts in columns
        ]


def _lags(target: FitData, sums: _ByRun, numbers: IntArray, place: IntArray) -> list[_Lag | None]:
    """The lag that explains most of each order, (K,); None where the oil was never warmer or colder."""
    oil, good = np.zeros(len(numbers)), target.good
    oil[place[good]] = target.data.at.temperature_C[good]
    if np.ptp(oil) == 0.0:
        return [None] * len(target.data.orders)
    # orders that have the same lag ask for the same ones beside it
    lags, found = cache(_Oil(oil, sums).lags), list[_Lag | None]()
    for k, tried in enumerate(zip(*map(lags, _LAGS), strict=True)):
        # how much a start explains as well differs from lag to lag: what is left decides
        best = min(tried, key=lambda lag: lag.left)
        for step in (0.15, 0.05, 0.015) if best.gain > SETTINGS.least_excess_in_time * best.left else ():
            near = (lags(best.runs * float(np.exp(n * step)))[k] for n in range(-2, 3))
            best = min(near, key=lambda lag: lag.left)
        # what a body keeps of the run before last tells it from what is ahead of the oil's sensor, and its size
        change = lags(0.0)[k]
        is_told = best.count * np.log(max(change.left, 1e-300) / max(best.left, 1e-300)) > SETTINGS.as_good
        found.append(best if is_told else change)
    return found


def _lasting(sums: Sequence[tuple[ComplexArray, FloatArray]], cut: int) -> float:
    """How much longer noise lasts than one run, beside a step; sums: of one order in each direction, see `_ByRun`."""
    beside = []
    for series, weight in sums:
        left = series.copy()
        for part in (slice(cut), slice(cut, None)):
            left[part] -= weight[part] * series[part].sum() / max(float(weight[part].sum()), _NONE)
        beside.append(left[:, None])
    return float(length(alike(beside))[0])
