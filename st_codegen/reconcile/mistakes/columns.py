"""Columns that hold something else than the rig model means: conditions in other units, curves that were processed.

Each is one of a few things that people do to tables, and shows in all runs at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.noise import estimate, middle_of
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.mistakes.single_runs import AS_IS, Mistake, samples_off
from st_codegen.reconcile.mistakes.votes import (
    PowerSums,
    enough_orders,
    expected_of,
    loud_orders,
    noise_power,
    power_sums,
    told_power,
)
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel

_UNIT = (
    "the {}{} seem to be {}: with that nearly all is gone that the rig leaves of the orders on which it matters, taken "
    "together"
)
_HOT = "the temperatures seem to be in K: no oil has {:g} degC and more"
#: what torques are of which the data show nothing: a unit that makes them tiny does no better than no load
_NO_LOAD = "none that the gear carries in the mean of a turn (a brake that is off, an arm whose load turns its sign)"
_TAKEN_OFF = (
    "hardly anything is left of {} in the runs, where the rig has {:.2g} deg RMS: {} seems to have been taken off the "
    "curves"
)
_SHIFTED = (
    "the columns of waves seem to be shifted: each holds what the rig has at the order {} its own, and as they are "
    "most orders disagree with the rig"
)
_COPIED = (
    "forward and backward have the same digits in {} of {} runs, noise included: one of the columns seems to be a copy "
    "of the other"
)


def other_conditions(data: Observations, rig: RigModel) -> list[Mistake]:
    """Speeds, torques or temperatures in another unit, of the other shaft, or of the other sign; at most one of them,
    beside temperatures that no oil has.

    Only what takes nearly all that the rig leaves off all orders on which it matters, together: in all runs, or in
    those that it brings nearer to the rig by far, as where a logger was set otherwise in the course of the campaign.
    """
    every, coldest = np.ones(len(data), bool), float(data.at.temperature_C.min())
    if coldest > SETTINGS.hottest_oil_C >= _of_kelvin(data.at).temperature_C.max():
        kelvin = partial(_with_conditions, _of_kelvin, every)
        found = Mistake("conditions", _HOT.format(coldest), kelvin, remedy="read them so")
        return [found, *other_conditions(kelvin(data), rig)]
    orders, noise = data.orders.tolist(), noise_power(data)
    plain = expected_of(data, rig)
    # what turns with the direction has the other sign in curves of the other sign, and in those of the other direction
    others_of_sign = (-plain, rig.coefficients(replace(data.at, sign=-data.at.sign), orders))
    best: tuple[float, list[Mistake]] = (SETTINGS.order_gain, [])
    for column, text, changed in readings(rig.constants.reduction_ratio):
        meant = changed(data.at)
        seen = rig.coefficients(meant, orders)
        # of signs half of the runs may be those of one direction
        is_sign = all(_has_sizes(getattr(meant, key), getattr(data.at, key)) for key in CONDITION_COLUMNS)
        most = SETTINGS.most_of_block if is_sign else 1.0
        some, others = _nearer(data, noise, (plain, *others_of_sign), seen, most)
        for rows in (every, _with_untold(data.at, meant, some, others)):
            read = np.where(rows[:, None], seen, plain)
            beside = _noise_beside(data, noise, data.values - plain, data.values - read)
            gain = _gain(data, beside, plain, read)
            if gain > best[0]:
                what, remedy = text, "read them so"
                if column == "torques":
                    unloaded = rig.coefficients(replace(data.at, torque_Nm=np.zeros(len(data))), orders)
                    without = _gain(data, beside, plain, np.where(rows[:, None], unloaded, plain))
                    if without > gain - SETTINGS.order_gain:
                        what, remedy = (
                            f"{_NO_LOAD}, or {text}",
                            f"read them {text}, which tells no more than no load does",
                        )
                said = _UNIT.format(column, "" if rows.all() else _of_runs(data, rows), what)
                corrected = partial(_with_conditions, changed, rows)
                best = (gain, [Mistake("conditions", said, corrected, remedy=remedy)])
    return best[1]


def _with_conditions(changed: Callable[[Conditions], Conditions], rows: BoolArray, given: Observations) -> Observations:
    meant = changed(given.at)
    return given.under(
        **{key: np.where(rows, getattr(meant, key), getattr(given.at, key)) for key in CONDITION_COLUMNS}
    )


def _noise_beside(data: Observations, noise: FloatArray, before: ComplexArray, after: ComplexArray) -> FloatArray:
    """Power of the noise, (n, K): what neighbours differ by in what a reading leaves, where that is more.

    before, after: what is left without and with the reading, (n, K).

    As a part of what is measured it is too small for orders that noise makes much of: they would refuse any reading.
    That within curves says nothing of the mean, and little of the lowest orders. A reading that is wrong leaves more
    than its neighbours differ by.
    """
    if data.few_points or (np.abs(after) ** 2).sum() >= (np.abs(before) ** 2).sum():
        return noise
    low = data.orders <= (np.inf if data.spectral_deg is None else SETTINGS.wander_orders)
    return np.where(low, np.maximum(noise, data.parts * estimate(data, after).sigma ** 2), noise)


def _nearer(
    data: Observations, noise: FloatArray, known: tuple[ComplexArray, ...], seen: ComplexArray, most: float
) -> tuple[BoolArray, BoolArray]:
    """The rows of runs that another model brings nearer by more than chance, and of those that it takes away, (n,).

    Where they are some and not all: at most such a share. known: the rig's own model, and what else may be there. Noise
    is no less than what the nearer model leaves of an order in the middle run: that within curves says nothing of the
    mean.
    """
    found, others = np.zeros(len(data), bool), np.zeros(len(data), bool)
    nearest = np.minimum(np.abs(data.values - known[0]), np.abs(data.values - seen))
    noise = np.maximum(noise, np.median(nearest, axis=0) ** 2)
    after, *before = (
        (np.abs(data.values - model) ** 2 / np.maximum(noise, 1e-300)).sum(axis=1) for model in (seen, *known)
    )
    gains = np.array([np.min(before, axis=0)[rows].sum() - after[rows].sum() for rows in data.runs])
    chosen, untold = gains > SETTINGS.order_gain, np.abs(gains) <= SETTINGS.order_gain
    if not SETTINGS.least_block <= chosen.sum() <= most * len(chosen) or chosen.all():
        return found, others
    if data.run is not None:
        # a run that tells nothing of it, as one without a load, is what those around it are
        first, *_, last = np.flatnonzero(chosen)
        around = slice(first, last + 1)
        if (chosen | untold)[around].all():
            chosen[around] = True
    for number, rows in enumerate(data.runs):
        found[rows], others[rows] = chosen[number], not (chosen[number] or untold[number])
    return found, others


def _with_untold(read: Conditions, meant: Conditions, rows: BoolArray, beside: BoolArray) -> BoolArray:
    """The rows that are to be read otherwise, (n,), and those that nothing tells and whose numbers lie with theirs.

    None where most of their numbers do not lie outside of those of others, `beside`: of the same numbers as in other
    runs a change of the machine in mid-campaign is the cause. Those of the other sign may be the same.
    """
    alone = rows.copy()
    for key in CONDITION_COLUMNS:
        values = np.abs(getattr(read, key))
        theirs, others = (values[part & (values > 0.0)] for part in (rows, beside))
        if _has_sizes(getattr(meant, key), getattr(read, key)) or not len(theirs) or not len(others):
            continue
        # one factor moves all of them to one side
        sides = (values > others.max(), (values > 0.0) & (values < others.min()))
        outside = max(sides, key=lambda side: side[rows].sum())
        if outside[rows & (values > 0.0)].mean() <= SETTINGS.most_orders:
            return np.zeros(len(rows), bool)
        alone |= outside & ~beside
    return alone


def _has_sizes(meant: FloatArray, read: FloatArray) -> bool:
    """Whether numbers differ from others by their signs at most."""
    return np.array_equal(np.abs(meant), np.abs(read))


def _of_runs(data: Observations, rows: BoolArray) -> str:
    """How many runs some rows are of, and where in the order of the campaign if they follow each other."""
    numbers = [number for number, of in enumerate(data.runs, 1) if rows[of].all()]
    if data.run is not None and numbers[-1] - numbers[0] + 1 == len(numbers):
        return f" of run {numbers[0]} to run {numbers[-1]}"
    return f" of {len(numbers)} of {len(data.runs)} runs"


def _of_kelvin(at: Conditions) -> Conditions:
    return replace(at, temperature_C=at.temperature_C - 273.15)


def _with_speeds_of_torques(at: Conditions) -> Conditions:
    """Both columns exchanged; as they are where what would be a speed is none that turns."""
    return replace(at, speed_rpm=at.torque_Nm, torque_Nm=at.speed_rpm) if at.torque_Nm.min() > 0.0 else at


def readings(ratio: float) -> list[tuple[str, str, Callable[[Conditions], Conditions]]]:
    """What a column may hold in place of what the rig means: its name, that, and the conditions that it means."""

    def scaled(key: str, factor: float, off: float = 0.0) -> Callable[[Conditions], Conditions]:
        return lambda at: replace(at, **{key: (getattr(at, key) + off) * factor})

    return [
        ("temperatures", "in degF", scaled("temperature_C", 1 / 1.8, -32.0)),
        ("temperatures", "in K", _of_kelvin),
        ("speeds", "those of the output", scaled("speed_rpm", ratio)),
        ("speeds", "in turns a second", scaled("speed_rpm", 60.0)),
        ("speeds", "in 1000 rpm", scaled("speed_rpm", 1000.0)),
        ("speeds", "in rad/s", scaled("speed_rpm", 60.0 / (2 * np.pi))),
        ("speeds", "in rad/s of the output", scaled("speed_rpm", ratio * 60.0 / (2 * np.pi))),
        ("speeds", "in deg/s", scaled("speed_rpm", 1.0 / 6.0)),
        ("speeds", "in deg/s of the output", scaled("speed_rpm", ratio / 6.0)),
        ("torques", "those of the input", scaled("torque_Nm", ratio)),
        ("torques", "of the other sign", scaled("torque_Nm", -1.0)),
        ("torques", "in kN m", scaled("torque_Nm", 1000.0)),
        ("torques", "in N mm", scaled("torque_Nm", 1e-3)),
        (
            "torques and temperatures", "exchanged",
            lambda at: replace(at, torque_Nm=at.temperature_C, temperature_C=at.torque_Nm),
        ),
        ("speeds and torques", "exchanged", _with_speeds_of_torques),
        ("torques", f"{_OF_SHAFT} backward motion", lambda at: replace(at, torque_Nm=at.sign * at.torque_Nm)),
        ("torques", f"{_OF_SHAFT} forward motion", lambda at: replace(at, torque_Nm=-at.sign * at.torque_Nm)),
    ]  # fmt: skip


#: torques of a sensor that keeps its sign; those of a rig file are positive against the motion
_OF_SHAFT = "those of the shaft, negative where a load opposes a"


def _gain(data: Observations, noise: FloatArray, plain: ComplexArray, seen: ComplexArray) -> float:
    """The logarithm by which another model takes power off the gaps of the orders that it changes; 0 where it leaves
    more than a part of any.

    A mean that is off by the same in all runs of a direction speaks for none: a zero may have moved.
    """
    gain, mean = 0.0, data.orders == 0
    for rows in data.at.by_direction():
        before, after, changes, measured = (
            (np.abs(part[rows] - mean * part[rows].mean(axis=0)) ** 2).mean(axis=0)
            for part in (data.values - plain, data.values - seen, seen - plain, data.values)
        )
        least = told_power(noise[rows])
        left, right = (np.maximum(power - noise[rows].mean(axis=0), 0.0) + least for power in (before, after))
        asked = changes > SETTINGS.acts_of_unit * least
        if (right > SETTINGS.left_of_unit * left)[asked].any():
            return 0.0
        # a load that is read as hardly any leaves little of a far too large one, and all that is measured
        most = int(np.argmax(np.where(asked, changes / np.maximum(measured, 1e-300), 0.0)))
        if asked[most] and right[most] > SETTINGS.part_of_measured * measured[most]:
            return 0.0
        gain += float(rows.sum() * np.log(left[asked] / right[asked]).sum())
    return gain


#: what a table of waves may hold in place of sizes and phases of cosines, A*cos(k*theta + phi), and how it is read then
_Turned = Callable[[ComplexArray], ComplexArray]
_PHASES: tuple[tuple[str, _Turned], ...] = (
    ("", lambda c: c),
    ("with phases of sines, 90 deg more than those of cosines", lambda c: -1j * c),
    ("with phases 90 deg less than those of cosines", lambda c: 1j * c),
    ("with phases of the other sign, as where the angle counts the other way", np.conj),
    ("with phases of sines, of the other sign", lambda c: -1j * c.conj()),
    ("with phases of the other sign, 90 deg less than those of cosines", lambda c: 1j * c.conj()),
    ("with phases in turns in place of rad", lambda c: np.abs(c) * np.exp(2j * np.pi * np.angle(c))),
)
_SIZES = (
    ("", 1.0), ("twice as large, from peak to peak", 2.0), ("half as large, one side of a spectrum", 0.5),
    ("RMS in place of amplitudes", 2**-0.5), ("one side of a spectrum, as RMS", 8**-0.5),
    ("in mdeg, and the mean in deg", 1e3), ("in arcmin, and the mean in deg", 60.0),
    ("in arcsec, and the mean in deg", 3600.0), ("in rad, and the mean in deg", np.pi / 180),
    ("in mrad, and the mean in deg", 1e3 * np.pi / 180), ("in urad, and the mean in deg", 1e6 * np.pi / 180),
)  # fmt: skip
#: of which curves, their sign (0: all); phases, and how they are read; sizes, and their factor
_CONVENTIONS: list[tuple[str, float, str, _Turned, str, float]] = [
    *(("", 0.0, *phases, *sizes) for phases in _PHASES for sizes in _SIZES if phases[0] or sizes[0]),
    # one direction may have been evaluated otherwise, or its angle counted from where that motion began
    *(
        (f" of {side} curves", sign, *phases, *_SIZES[0])
        for side, sign in (("forward", 1.0), ("backward", -1.0))
        for phases in _PHASES[1:]
    ),
    ("", 0.0, "squared, as in a spectrum of power", lambda c: c / np.sqrt(np.maximum(np.abs(c), 1e-300)), "", 1.0),
    # the sign of TE is another question
    *(("", sign, "", np.negative, "", 1.0) for sign in (0.0, 1.0, -1.0)),
]
_WAVES = "the waves of all orders{} seem to be {}: with that most agree with the rig, and as they are they do not"


def other_waves(data: Observations, rig: RigModel) -> list[Mistake]:
    """Sizes and phases of all orders above the mean by another convention than the rig's: one for all, or none.

    Sizes have the factor of a convention, to the error by which the orders tell it; any other is none, and so is one
    that the mean has as well.
    """
    waves = data.orders > 0
    loud = loud_orders(data, rig, of_one=True) & waves
    if loud.sum() < SETTINGS.least_votes:
        return []
    sums = power_sums(data, rig, loud, swapped=False)
    best: list[tuple[float, Mistake]] = []
    ones, unturned = np.ones((len(sums.measured), 1)), np.ones(len(sums.orders), np.complex128)
    noise, known = noise_power(data), expected_of(data, rig)
    plain, before = sums.gap(ones, unturned), np.where(waves, data.values - known, 0.0)
    for which, sign, phases, turned, sizes, factor in [*_CONVENTIONS, *_stored_from_their_end(data)]:
        if sign and sign not in data.at.sign:
            continue
        text = " and ".join(part for part in (sizes, phases) if part)
        meant = _read_so(turned, factor, sign, data)
        after = np.where(waves, meant.values - known, 0.0)
        beside = noise / factor**2
        if data.spectral_deg is None:
            beside = _noise_beside(meant, beside, before, after)
        read = power_sums(meant, rig, loud, swapped=False, noise=beside)
        if sizes and not _has_factor(data, rig, read, factor):
            continue
        left = read.gap(ones, unturned)
        # what noise hides is not left, but not told either: such orders have no vote where enough others have
        hidden = read.least / SETTINGS.told / read.model
        shows = (hidden < SETTINGS.of_a_size**2).all(axis=0)
        own = shows if shows.sum() >= SETTINGS.least_votes else np.ones_like(shows)
        rest = np.median(np.maximum((left - read.noise) / read.model, hidden)[:, own], axis=1).max()
        # where some runs alone are otherwise, a part of each order seems to be, and those that are not lose by it
        lost, saved = (
            (np.abs(part[:, loud]) ** 2 / np.maximum(beside[:, loud], 1e-300)).sum(axis=1) for part in (after, before)
        )
        most = np.mean((lost < saved)[data.at.sign != -sign]) > SETTINGS.most_orders
        if most and rest < SETTINGS.of_a_size**2 and read.gap_falls(plain, left):
            said = _WAVES.format(which, text) if text else ""
            score = float(np.log(read.beyond_noise(left)).sum())
            best.append((score, Mistake("waves", said, partial(_read_so, turned, factor, sign), remedy="read them so")))
    return [found for _, found in sorted(best, key=lambda one: one[0])[:1] if found.text]


def _stored_from_their_end(data: Observations) -> Iterator[tuple[str, float, str, _Turned, str, float]]:
    """Conventions of curves whose TE was stored from its end beside an angle that was not: they are mirrored, and a
    sample off where the angle stands once at 0 and not at 360 deg, or the other way round.
    """
    for side, sign in (("forward", 1.0), ("backward", -1.0)):
        for turn in samples_off(data):
            yield f" of {side} curves", sign, "stored from their end", partial(_mirrored, turn), "", 1.0


def _mirrored(turn: ComplexArray, values: ComplexArray) -> ComplexArray:
    return np.asarray(values.conj() * turn)


def _read_so(turned: _Turned, factor: float, sign: float, given: Observations) -> Observations:
    """Waves in the rig's convention, of the curves of a direction, or of all (sign 0)."""
    rows = (given.at.sign != -sign)[:, None]
    return replace(given, values=np.where((given.orders > 0) & rows, turned(given.values) / factor, given.values))


def _has_factor(data: Observations, rig: RigModel, waves: PowerSums, factor: float) -> bool:
    """Whether the sizes of waves that were divided by a factor are the rig's, each order with one vote, and the mean's
    are not."""
    apart = np.log(np.maximum(np.abs(waves.product) / waves.model, 1e-12)).ravel()
    middle, error = middle_of(apart)
    if abs(middle) > SETTINGS.told * error:
        return False
    mean = (data.orders == 0) & loud_orders(data, rig, of_one=True)
    if not mean.any():
        return True
    of_mean = power_sums(data, rig, mean, swapped=False)
    own = float(np.abs(of_mean.product).sum() / of_mean.model.sum())
    return bool(abs(np.log(max(own, 1e-12))) < abs(np.log(max(own, 1e-12) / factor)))


def taken_off(data: Observations, rig: RigModel) -> list[Mistake]:
    """The mean, and the lowest orders above it, that no run has though the rig makes them: processing took them off."""
    model = expected_of(data, rig)
    noise = noise_power(data)
    # the rig's is none of the data's where a few labels are a thousand times too large
    measured, known = (np.median(np.abs(part) ** 2, axis=0) for part in (data.values, model))
    made = np.flatnonzero(known > 0.0)
    # in the unit of the data, whatever it is, which orders tell that follow the rig; what the runs could tell must be
    # far below the rig's as well
    seen = (known > 0.0) & (_share_along(data, model) > SETTINGS.along_the_rig)
    unit = float(np.median(measured[seen] / known[seen])) if seen.any() else 0.0
    left = np.maximum(measured - noise.mean(axis=0), told_power(noise))
    gone = left < SETTINGS.taken_off**2 * unit * known
    # a mean that is the rig's as it is read, in more runs than may be wrong, is there, whatever the unit of the waves
    is_there = np.abs(data.values - model) <= SETTINGS.of_a_size * np.abs(model)
    gone &= (data.orders > 0) | (is_there.mean(axis=0) < SETTINGS.most_labels)
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


def _share_along(data: Observations, model: ComplexArray) -> FloatArray:
    """The share of each order's power over the runs that is the model, (n, K), times a number a direction, (K,)."""
    sides = [(data.values[rows], model[rows]) for rows in data.at.by_direction()]
    sums = ((np.abs((own * of_it.conj()).sum(axis=0)) ** 2, (np.abs(of_it) ** 2).sum(axis=0)) for own, of_it in sides)
    along = sum((both / np.maximum(size, 1e-300) for both, size in sums), np.zeros(len(data.orders)))
    return np.asarray(along / np.maximum((np.abs(data.values) ** 2).sum(axis=0), 1e-300))


def shifted_columns(data: Observations, rig: RigModel) -> list[Mistake]:
    """Columns of waves that stand one place off: that of order k holds order k - 1, or k + 1, or that beside it.

    As where a list that begins with 1 is read as one that begins with 0, or where names of columns slip by one.
    """
    best: tuple[float, list[Mistake]] = (0.0, [])
    loud = loud_orders(data, rig) & (data.orders > 0)
    for step, by_number, neighbour in (
        (1, True, "below"), (-1, True, "above"), (1, False, "listed before"), (-1, False, "listed behind"),
    ):  # fmt: skip
        place, held = _shifted_place(data, step, by_number)
        held &= data.orders > 0
        moved = replace(data, values=np.where(held, data.values[:, place], data.values))
        if not enough_orders(data, loud & held) or (loud & held).sum() <= SETTINGS.most_orders * loud.sum():
            continue
        known = expected_of(data, rig)
        noise = _noise_beside(moved, noise_power(moved), data.values - known, moved.values - known)
        plain = power_sums(data, rig, loud & held, swapped=False)
        read = power_sums(moved, rig, loud & held, swapped=False, noise=noise)
        before, after = (sums.gap(np.ones((2, 1)), np.ones(len(sums.orders), np.complex128)) for sums in (plain, read))
        rest = float(np.median(np.maximum(after - read.noise, read.least / SETTINGS.told) / read.model))
        if rest < SETTINGS.of_a_size**2 and plain.gap_falls(before, after):
            said = _SHIFTED.format(neighbour)
            found = Mistake("shifted", said, partial(_shifted_back, step, by_number), remedy="shift them back")
            best = max(best, (float(np.log(before / np.maximum(after, 1e-300)).sum()), [found]), key=lambda one: one[0])
    return best[1]


def _shifted_place(data: Observations, step: int, by_number: bool) -> tuple[IntArray, BoolArray]:
    """The columns that hold the orders, (K,), and which are there: those of the next number, or the next ones."""
    orders, last = data.orders, len(data.orders) - 1
    place = np.searchsorted(orders, orders + step) if by_number else np.arange(last + 1) + step
    held = (place >= 0) & (place <= last)
    place = np.clip(place, 0, last)
    held &= orders[place] > 0
    if by_number:
        held &= orders[place] == orders + step
    mean = orders == 0
    return np.where(mean, np.arange(last + 1), place), held | mean


def _shifted_back(step: int, by_number: bool, given: Observations) -> Observations:
    place, held = _shifted_place(given, step, by_number)
    lost = ", ".join(map(str, given.orders[~held]))
    return given.with_columns(place).of_orders(held, f"orders {lost}: the columns beside them are not in the table")


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


# --- the rig file of another gear


def other_gear(data: Observations, rig: RigModel) -> list[Mistake]:
    """Teeth, pins or a shaft of the rig all of whose waves are missing, where multiples of other numbers are there.

    It changes no data: the rig file is that of another gear.
    """
    constants, orders, noise = rig.constants, data.orders, noise_power(data)
    most = np.maximum((np.abs(data.values) ** 2).mean(axis=0) - noise.mean(axis=0), 0.0)
    least, model = told_power(noise), (np.abs(expected_of(data, rig)) ** 2).mean(axis=0)
    loud, is_missing = loud_orders(data, rig), most + least < SETTINGS.missing_wave**2 * model
    missing = dict[str, list[int]]()
    for name, family in (
        (f"{constants.cycloid_teeth} teeth", constants.tooth_orders()),
        (f"{constants.pins} pins", constants.pin_orders()),
        (f"a shaft that turns {constants.reduction_ratio:g} times", constants.shaft_orders()),
    ):
        own = np.isin(orders, family) & loud
        if own.sum() >= SETTINGS.least_waves_of_gear and is_missing[own].all():
            missing[name] = orders[own].tolist()
    foreign = set(orders[(most > SETTINGS.loud_order * noise.mean(axis=0) + least) & (model == 0)].tolist())
    power = dict(zip(orders.tolist(), most.tolist(), strict=True))
    # in a row of orders without a peak, as what settles behind the start of a curve makes it, none is a wave of its own
    own_waves = {k for k in foreign if not {k - 1, k + 1} <= foreign or power[k] >= max(power[k - 1], power[k + 1])}
    times, least_teeth = range(1, SETTINGS.least_waves_of_gear + 1), SETTINGS.least_teeth
    numbers = [one for one in sorted(own_waves) if one >= least_teeth and all(one * n in own_waves for n in times)]
    numbers = [one for one in numbers if not any(one > other and one % other == 0 for other in numbers)]
    # where nothing is as large as the rig lets expect, another unit does that
    if not missing or is_missing[loud].all() or not 0 < len(numbers) <= SETTINGS.most_numbers_of_gear:
        return []
    lost = " and ".join(f"{', '.join(map(str, own))} ({name})" for name, own in missing.items())
    text = (
        f"orders {lost} of the rig are missing, and multiples of {' and of '.join(map(str, numbers))} are there, which "
        "it does not have, as if the rig file were that of another gear: correct cycloid_teeth, pins, reduction_ratio "
        f"and the orders of its effects; or give --accept {AS_IS}"
    )
    return [Mistake("gear", text)]
