"""Sensors that read wrong: the torque, the angle within a turn, and a low pass that TE went through.

Orders tell of them by how they depend on the load, by their sidebands and by the frequency at which they pass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import SIGNS, Observations, rows_that_tell
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.mistakes.each_run import MOST_TURN, Distorted, distortion, own_steps, without_strays
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.mistakes.votes import agreed_gain, expected_of, noise_power, told_power
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.effects.resonance import StructuralResonance
from st_codegen.rig.model import RigModel

_GAIN = "all torques seem to be {:.3g} times what they were: most orders that depend on the load agree"
_ZERO_TORQUE = "all torques seem to be off by {:.3g} N m: most orders that depend on the load agree"
_BY_DIRECTION = (
    "the torques of the runs seem to be read wrong, forward by another than backward, as where friction lies between "
    "the sensor and the gear: by {:+.2f} N m and {:+.2f} % forward, {:+.2f} N m and {:+.2f} % backward; most orders "
    "that depend on the load agree with the others on it"
)
_OWN_TORQUES = (
    "torques seem to be read wrong by amounts that differ from run to run, up to {:.0f} N m and {:.0f} N m RMS: most "
    "orders that depend on the load agree with the others on it"
)
_BY_A_LAW = (
    "; by how much is a smooth function of the torque: a sensor that is not linear does so, and so does a machine in "
    "which all that depends on the load follows another law than the rig's, and then --accept as_is is right"
)
_OWN_BY_DIRECTION = _OWN_TORQUES.replace("run to run", "run to run and between forward and backward")
_TAKE_OWN = "take the torques that the orders tell (what the load does to all orders alike cannot be seen then)"
#: part of what orders tell of a response below which rounding is what is left of it
_DIGITS = 1e-12
#: added to what orders tell of a factor, so that there is an inverse of nothing
_TELLS_NOTHING = 1e-12
_LOW_PASS = (
    "TE seems to have passed a low pass of {:.3g} Hz: most orders are smaller and later, the faster they are the more"
)
_FILTER = (
    "TE seems to have passed a filter: what is left of most orders depends on the frequency alone, most at {:.3g} Hz, "
    "where it is {:.2g} times as large and {:.0f} deg ahead"
)
_UNDO = "undo it, as far as the orders tell it"
_OVER_ANGLE = (
    "TE seems to have passed a filter over the angle, as a resampling or a smoothing is: what is left of most orders "
    "depends on their number alone, at all speeds alike, most at order {:.0f}, where it is {:.2g} times as large and "
    "{:.0f} deg ahead"
)
_MEAN = (
    "each value of TE{} seems to be a mean over {:.3g} deg of the angle: most orders are smaller, the higher they are "
    "the more, at all speeds alike"
)
_ANY_AXIS = "in this noise an angle that is read wrong once a turn may not show, by whatever size"
_HIDDEN_AXIS = (
    "in this noise an angle that is read wrong by up to about {:.2g} deg once a turn may not show: its sidebands are "
    "too small"
)
_AXIS = (
    "the angle seems to be read wrong by {} a turn: most orders k have sidebands that grow with k in the mean of the "
    "runs, as an encoder off centre makes them, or all parts of the gear off centre alike"
)


def wrong_torques(data: Observations, rig: RigModel) -> list[Mistake]:
    """Torques that are read wrong by one factor, one offset, or each by its own: what depends on the load says so."""
    if not np.ptp(data.at.torque_Nm) or not data.both_directions():
        return []
    noise = noise_power(data)
    gain, said, right = _wrong_by_one(data, rig, noise)
    plain = rig.coefficients(right if gain else data.at, data.orders.tolist())
    own = _wrong_by_their_own(data, rig, noise, plain)
    said, right, remedy = own or (said, right, "correct them")
    reading = "" if own else "misread_torque"
    found = Mistake("torque", said, lambda given: replace(given, at=right), remedy=remedy, reading=reading)
    return [found] if gain or own else []


def _wrong_by_one(data: Observations, rig: RigModel, noise: FloatArray) -> tuple[float, str, Conditions]:
    """What the votes gain by one factor, or one offset, on all torques, what is said of it, and the conditions then."""
    torque, reach, orders = data.at.torque_Nm, float(np.ptp(data.at.torque_Nm)), data.orders.tolist()
    # what scales all of TE, whether it depends on the load or not, is no torque
    expected, every = expected_of(data, rig), np.ones(len(data.orders), np.bool_)
    scaled = expected * (1.0 + _common_step(data.values - expected, expected, noise))
    found: list[tuple[float, str, Conditions]] = []
    for shape, text in ((torque, _GAIN), (np.full(len(data), reach), _ZERO_TORQUE)):

        def at(size: float, shape: FloatArray = shape) -> Conditions:
            return replace(data.at, torque_Nm=torque + size * shape)

        size = 0.0
        # steps after the first are those of a model that is not linear in the torque
        for _ in range(3):
            model, higher = (rig.coefficients(at(size + more), orders) for more in (0.0, SETTINGS.torque_step))
            step = _common_step(data.values - model, (higher - model) / SETTINGS.torque_step, noise)
            # the torque keeps its sign
            size = max(size + step, -0.95)
        right = at(size)
        seen = rig.coefficients(right, orders)
        beyond = rig.coefficients(replace(right, torque_Nm=right.torque_Nm + SETTINGS.torque_step * shape), orders)
        gain = min(agreed_gain(data, rig, seen, every, plain) for plain in (None, scaled))
        alike = _orders_agree(data.values - seen, (beyond - seen) / SETTINGS.torque_step, noise, size)
        said = text.format(1.0 / (1.0 + size) if text is _GAIN else -size * reach)
        found.append((gain if alike else 0.0, said, right))
    return max(found, key=lambda one: one[0])


def _wrong_by_their_own(
    data: Observations, rig: RigModel, noise: FloatArray, plain: ComplexArray
) -> tuple[str, Conditions, str] | None:
    """What is said of torques of their own of the runs, or of each direction of these, the conditions, and a remedy.

    None where they have none: every order must be predicted by what the others say of the run, and clearly better than
    by a factor or an offset. plain: what the rig says with one of these, (n, K).
    """
    torque, orders, expected = data.at.torque_Nm, data.orders.tolist(), expected_of(data, rig)
    found, of_runs = None, torque
    for number, text in ((data.number_of_run, _OWN_TORQUES), (np.arange(len(data)), _OWN_BY_DIRECTION)):
        # the directions of a run have torques of their own where these differ from the one of both
        its, seen, told = _torque_of_each(data, rig, noise, number, of_runs)
        of_runs, off = its.torque_Nm, its.torque_Nm - torque
        # as many runs as may carry a wrong label say nothing
        most = np.abs(off) <= np.quantile(np.abs(off), 1.0 - SETTINGS.most_labels)
        again = _told_by_others(data, plain, seen, most) if told > SETTINGS.most_labels else 0.0
        steps = own_steps(data.values - expected, expected, noise, number, SETTINGS.torque_step)
        scaled = expected * (1.0 + steps.others)
        # nor is what one factor and one offset of all torques would tell as well: orders that the load moves by another
        # amount than the rig's need not agree on these
        linear = replace(data.at, torque_Nm=torque + _linear(torque, off, most))
        own = again and _told_by_others(data, rig.coefficients(linear, orders), seen, most)
        if not own or _told_by_others(data, seen, scaled, most):
            continue
        said = text.format(np.abs(off).max(), np.sqrt((off**2).mean())) + (_BY_A_LAW if _follows(off, torque) else "")
        plain, found = seen, (said, its, _TAKE_OWN)
        # of each direction one factor and one offset may be all that there is
        turned = _off_in_each(data, rig, noise, _linear(torque, off, most, data.at.sign), most)
        in_each = replace(data.at, torque_Nm=torque + turned)
        if not _told_by_others(data, rig.coefficients(in_each, orders), seen, most):
            said = _BY_DIRECTION.format(*_laws(torque, turned, data.at.sign))
            found = said, in_each, "correct them"
    return found


def _linear(torque: FloatArray, off: FloatArray, most: BoolArray, sign: FloatArray | None = None) -> FloatArray:
    """What torques are off by, (n,), as one offset and one factor, or as those of each direction; most: rows asked."""
    basis = np.stack([np.ones(len(torque)), torque], axis=1)
    if sign is not None:
        basis = np.concatenate([basis, basis * sign[:, None]], axis=1)
    return np.asarray(basis @ np.linalg.lstsq(basis[most], off[most], rcond=None)[0])


def _off_in_each(data: Observations, rig: RigModel, noise: FloatArray, off: FloatArray, most: BoolArray) -> FloatArray:
    """By how much the torques of each direction are off, (n,), along the line that the orders agree on.

    What runs say by the mean of their orders holds what an effect that is missing makes of one of these. off: where to
    begin, (n,); most: rows that are asked.
    """
    torque, orders, reach = data.at.torque_Nm, data.orders.tolist(), float(np.ptp(data.at.torque_Nm))
    step, basis = SETTINGS.torque_step * reach, np.stack([np.full(len(torque), reach), torque], axis=1)
    # steps after the first are those of a model that is not linear in the torque
    for _ in range(3):
        model, higher = (
            rig.coefficients(replace(data.at, torque_Nm=torque + off + more), orders) for more in (0.0, step)
        )
        gap, slope = data.values - model, (higher - model) / step
        for rows in (most & (data.at.sign == sign) for sign in SIGNS):
            own, power = basis[rows], np.maximum(noise[rows], 1e-300)
            told = np.einsum("np,nk,nq->kpq", own, np.abs(slope[rows]) ** 2 / power, own)
            # an order that tells nothing has an error beyond all others
            error = np.linalg.inv(told + _TELLS_NOTHING * np.eye(2))
            wanted = np.einsum("kpq,nq,nk->pk", error, own, (gap * slope.conj()).real[rows] / power)
            # none says more than another whose error is what torques may be off by anyway
            weight = 1.0 / (error[:, [0, 1], [0, 1]].T + SETTINGS.torque_step**2)
            steps = np.average(wanted, axis=1, weights=without_strays(wanted, weight))
            off = off + np.where(data.at.sign == data.at.sign[rows][0], basis @ steps, 0.0)
    return off


def _laws(torque: FloatArray, off: FloatArray, sign: FloatArray) -> list[float]:
    """By how much torques are read too high: N m, and per cent, forward and then backward; off: along two lines."""
    found = []
    for own in (sign > 0, sign < 0):
        slope, offset = np.polyfit(torque[own], -off[own], 1)
        # no -0
        found += [round(float(offset), 2) + 0.0, round(100.0 * float(slope), 2) + 0.0]
    return found


def _follows(off: FloatArray, torque: FloatArray) -> bool:
    """Whether what torques are off by is one smooth function of the torque that is read."""
    load, sign = np.abs(torque) / max(float(np.abs(torque).max()), 1e-300), np.sign(torque)
    design = np.stack([np.ones(len(torque)), *(sign * load**power for power in (0.5, 1.0, 2.0))], axis=1)
    rest = off - made_of(design, off)
    return bool((rest**2).mean() < SETTINGS.left_of_unit * ((off - off.mean()) ** 2).mean())


def _told_by_others(data: Observations, plain: ComplexArray, seen: ComplexArray, most: BoolArray) -> float:
    """By how much orders are told better by `seen` than by `plain` (n, K), a log likelihood; 0 where it may be chance.

    most: the rows that are asked, bool (n,).
    Asked together but for the two that gain most, which an effect may explain: what others say of an order that has
    nothing to do with it makes it worse by as much as it would be better.
    """
    before, after = (
        np.array([(np.abs(data.values - one)[most & (data.at.sign == sign)] ** 2).sum(axis=0) for sign in SIGNS])
        for one in (plain, seen)
    )
    rows = np.array([[(most & (data.at.sign == sign)).sum()] for sign in SIGNS])
    gain = np.sort((rows * np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))).sum(axis=0))
    rest = float(gain[:-2].sum())
    return float(gain.sum()) if rest > SETTINGS.order_gain else 0.0


def _torque_of_each(
    data: Observations, rig: RigModel, noise: FloatArray, number: IntArray, believed: FloatArray
) -> tuple[Conditions, ComplexArray, float]:
    """Runs at the torques that their orders tell, what each order is by those of the others (n, K), and a share.

    That is how many torques are off those that are believed, (n,), by more than their error leaves open.
    """
    torque, reach, orders = data.at.torque_Nm, float(np.ptp(data.at.torque_Nm)), data.orders.tolist()
    step, its = SETTINGS.torque_step * reach, torque
    # steps after the first are those of a model that is not linear in the torque
    for _ in range(3):
        model = rig.coefficients(replace(data.at, torque_Nm=its), orders)
        slope = (rig.coefficients(replace(data.at, torque_Nm=its + step), orders) - model) / step
        found = own_steps(data.values - model, slope, noise, number, step, its - torque)
        seen, its = model + slope * (found.others - (its - torque)[:, None]), torque + found.off
    told = float(np.mean(np.abs(its - believed) > SETTINGS.told * found.error))
    return replace(data.at, torque_Nm=its), seen, told


def low_pass(data: Observations, rig: RigModel) -> list[Mistake]:
    """A low pass of first order that TE went through: every order is smaller and late by its frequency, not late alone.

    Effects could not say so: a delay and smaller sizes of all that is fast would stand for it.
    """
    if not data.both_directions():
        return []
    model, noise, rate = expected_of(data, rig), noise_power(data), _rate(data, rig)

    def passed(seconds: float) -> ComplexArray:
        return np.asarray(1.0 / (1.0 + rate * seconds))

    every, seconds = data.orders > 0, _fitted(data, model, noise, passed)
    seen = model * passed(seconds)
    # one that leaves nothing is nearer to waves that are all smaller alike than what the rig says
    alike = model * (1.0 + _common_step(data.values - model, model, noise))
    is_best = all(agreed_gain(data, rig, seen, every, other) for other in (_late(data, rig), alike))
    gain = agreed_gain(data, rig, seen, every) if is_best else 0.0
    over_angle = _over_the_angle(data, rig) if gain else None
    if not gain or (over_angle is not None and over_angle[0] > gain):
        return []

    def corrected(given: Observations) -> Observations:
        return given.divided(passed(seconds))

    text = _LOW_PASS.format(1.0 / (2.0 * np.pi * seconds))
    return [Mistake("low_pass", text, corrected, remedy="undo it")]


def _rate(data: Observations, rig: RigModel) -> ComplexArray:
    """i times the angular frequency of each order in each curve, rad/s, negative backward, (n, K)."""
    turns = data.at.sign * data.at.speed_rpm / (60.0 * rig.constants.reduction_ratio)
    return np.asarray(2j * np.pi * turns[:, None] * data.orders)


def _late(data: Observations, rig: RigModel) -> ComplexArray:
    """What a chain of measurement that is late, as fits best, makes of what the rig says, (n, K)."""
    model, rate = expected_of(data, rig), _rate(data, rig)

    def late(seconds: float) -> ComplexArray:
        return np.asarray(np.exp(-rate * seconds))

    return model * late(_fitted(data, model, noise_power(data), late))


def any_filter(data: Observations, rig: RigModel) -> list[Mistake]:
    """A filter of any kind that TE went through: of every order what passes depends on its frequency alone, or on its
    number alone where it is one over the angle.

    A resonance of some orders lifts these alone, an effect changes those that it makes: they share no response. A delay
    is none, nor is a load behind a spring, which lifts all orders.
    """
    if not data.both_directions():
        return []
    ratio = rig.constants.reduction_ratio

    def hertz(given: Observations) -> FloatArray:
        return np.asarray(given.at.speed_rpm[:, None] / (60.0 * ratio) * given.orders)

    mode = partial(_with_a_mode, data, rig, hertz(data))
    found = [_filter_over(data, rig, hertz, "filter", _FILTER, mode=mode), _over_the_angle(data, rig)]
    told = [one for one in found if one is not None]
    return [max(told, key=lambda one: one[0])[1]] if told else []


def _over_the_angle(data: Observations, rig: RigModel) -> tuple[float, Mistake] | None:
    """A filter of which the number of an order alone tells what passes, and what the votes gain by it."""

    def number(given: Observations) -> FloatArray:
        return np.tile(given.orders.astype(np.float64), (len(given), 1))

    # no data tell it from a machine whose waves are all of another size
    remedy = f"{_UNDO}, or --accept as_is if all these parts of the machine are of another size"
    return _filter_over(data, rig, number, "smoothing", _OVER_ANGLE, remedy)


def _filter_over(
    data: Observations,
    rig: RigModel,
    place: Callable[[Observations], FloatArray],
    name: str,
    text: str,
    remedy: str = _UNDO,
    mode: Callable[[], ComplexArray] | None = None,
) -> tuple[float, Mistake] | None:
    """A filter whose response depends on the place (n, K) of each coefficient, and what the votes gain by it.

    mode: what the orders are with another mode of the structure, which may do as well.
    """
    model, noise, at = expected_of(data, rig), noise_power(data), place(data)
    knots = np.linspace(0.0, float(at.max(initial=0.0)), SETTINGS.knots_of_filter + 1)
    passes, seen = _predicted(data, model, noise, at, knots)
    if not passes.any():
        return None
    every = data.orders > 0
    turn = -2j * np.pi * data.at.sign[:, None] * at
    late = model * np.exp(turn * _fitted(data, model, noise, lambda by: np.exp(turn * by)))
    # nor is one factor of all
    alike = model * (1.0 + _common_step(data.values - model, model, noise))
    # nor what the mesh does alike in all its orders at one speed or load, as behind a film of oil
    mesh, of_runs = data.orders > SETTINGS.wander_orders, []
    for column in (data.at.speed_rpm, np.abs(data.at.torque_Nm)):
        by = np.tile(column[:, None], (1, len(data.orders)))
        if by.any():
            steps = np.linspace(0.0, float(by.max()), len(knots))
            of_runs.append(np.where(mesh, _predicted(data, mesh * model, noise, by, steps)[1], model))
    gain = min(agreed_gain(data, rig, seen, every, plain) for plain in (None, late, alike, *of_runs))
    if gain >= SETTINGS.vote and mode is not None:
        gain = min(gain, agreed_gain(data, rig, seen, every, mode()))
    if gain < SETTINGS.vote:
        return None

    def corrected(given: Observations) -> Observations:
        response = _between_knots(place(given), given.at.sign, knots, passes)
        told = np.abs(response) > SETTINGS.acts
        whole = given.divided(np.where(told, response, 1.0))
        return whole if told.all() else replace(whole, seen=told if given.seen is None else told & given.seen)

    # between the orders that tell it the response is anybody's guess
    response = np.where(np.abs(model) ** 2 > noise, _between_knots(at, data.at.sign, knots, passes), 1.0)
    if np.abs(np.abs(response) - 1.0).max() < SETTINGS.of_a_filter:
        return None
    most = np.unravel_index(int(np.abs(response - 1.0).argmax()), response.shape)
    # no -0 degrees
    ahead = round(float(np.degrees(np.angle(response[most])) * data.at.sign[most[0]])) + 0.0
    return gain, Mistake(name, text.format(at[most], abs(response[most]), ahead), corrected, remedy=remedy)


def _with_a_mode(data: Observations, rig: RigModel, hertz: FloatArray) -> ComplexArray:
    """What the orders are, (n, K), with one mode of the structure that lifts them all, as it fits best.

    hertz: the frequency of each coefficient, (n, K). A load behind a spring follows all waves of its gear, each by its
    frequency alone, as a filter lets them pass. Where the rig has that mode at another frequency, what one more does is
    the same: 1 + g r^2 / (1 - r^2 + 2 i D r) is the quotient of the two, g the part by which the squares differ.
    """
    model = expected_of(data, rig)
    gap, turn = data.values - model, np.where(data.at.sign[:, None] > 0, 2j, -2j)
    # where the rig makes nothing, a mode lifts nothing
    whole = (np.abs(gap) ** 2 + noise_power(data)).mean(axis=0)
    weight = np.where((data.orders > 0) & model.any(axis=0), 1.0 / np.maximum(whole, 1e-300), 0.0)

    def added(at: FloatArray) -> ComplexArray:
        frequency, damping = np.exp(at)
        r = hertz / frequency
        own = model * r**2 / (1.0 - r**2 + turn * damping * r)
        size = (own.conj() * gap * weight).real.sum() / max(float((np.abs(own) ** 2 * weight).sum()), 1e-300)
        return np.asarray(size * own)

    def left(at: FloatArray) -> float:
        return float((np.abs(gap - added(at)) ** 2 * weight).sum())

    lowest, highest = (float(np.log(hertz.max() * times)) for times in SETTINGS.modes_over_highest)
    least = next(scalar.lower for scalar in StructuralResonance.scalars if scalar.key == "damping_ratio")
    narrowest, broadest = (float(np.log(damping)) for damping in (least, SETTINGS.broadest))
    middle = (narrowest + broadest) / 2
    # steps as fine as a peak is wide meet one peak after the other
    width = float(np.exp(middle))
    starts = [np.array([one, middle]) for one in np.arange(lowest, highest, width)]
    bounds = [(lowest, highest), (narrowest, broadest)]
    # a part of a logarithm, the usual first step, depends on the unit of the frequency
    steps = np.array([[0.0, 0.0], [width, 0.0], [0.0, (broadest - narrowest) / 4]])
    found = [
        minimize(
            left, one, method="Nelder-Mead", bounds=bounds, options={"maxiter": 100, "initial_simplex": one + steps}
        )
        for one in sorted(starts, key=left)[: SETTINGS.resonance_starts]
    ]
    return model + added(min(found, key=lambda one: float(one.fun)).x)


def _predicted(
    data: Observations, model: ComplexArray, noise: FloatArray, at: FloatArray, knots: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """A response over places (n, K) at the knots, and what each order is with that which the others tell, (n, K).

    A rig that is a little wrong has none in common.
    """
    passes, of_others = _response(data, model, noise, at, knots)
    columns = [_between_knots(at[:, k], data.at.sign, knots, of_others[k]) for k in range(len(data.orders))]
    return passes, model * np.stack(columns, axis=1)


def _between_knots(at: FloatArray, sign: FloatArray, knots: FloatArray, passes: ComplexArray) -> ComplexArray:
    """A response at places (n, ..) of rows in a direction (n,), by what it is at knots; backward conjugate."""
    found = np.interp(at, knots, passes.real) + 1j * np.interp(at, knots, passes.imag)
    forward = sign.reshape(-1, *[1] * (at.ndim - 1)) > 0
    return np.asarray(np.where(forward, found, found.conj()))


def _response(
    data: Observations, model: ComplexArray, noise: FloatArray, at: FloatArray, knots: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """What all orders share of a response over their places (n, K), at the knots (N,), and all but one each, (K, N).

    It is 1 at 0. Each order has about one vote: an order is weighed by its gap and its noise. Zeros where the data tell
    no response.
    """
    sign = data.at.sign[:, None] > 0
    gap, own = (np.where(sign, part, part.conj()) for part in (data.values - model, model))
    power = (np.abs(gap) ** 2 + noise).mean(axis=0)
    waves = np.flatnonzero((data.orders > 0) & (np.abs(own) ** 2).any(axis=0))
    if len(waves) < SETTINGS.least_votes:
        return np.zeros(len(knots), np.complex128), np.ones((len(power), len(knots)), np.complex128)
    count = len(knots) - 1
    matrix, pull = np.zeros((len(power), count, count)), np.zeros((len(power), count), np.complex128)
    for k in waves:
        hats = np.maximum(0.0, 1.0 - np.abs(at[:, k, None] - knots[None, 1:]) / knots[1])
        weight = np.abs(own[:, k]) ** 2 / power[k]
        matrix[k] = (hats * weight[:, None]).T @ hats
        pull[k] = hats.T @ (own[:, k].conj() * gap[:, k] / power[k])
    # where no order tells the response it is 1, nor where it is the difference of sums that have no more digits
    whole, along = matrix.sum(axis=0), pull.sum(axis=0)
    whole += np.diag(SETTINGS.huber + _DIGITS * np.diag(whole))
    passes = np.linalg.solve(
        np.concatenate([whole[None], whole - matrix]), np.concatenate([along[None], along - pull])[..., None]
    )
    found = np.concatenate([np.ones((len(passes), 1)), 1.0 + passes[..., 0]], axis=1)
    return found[0], found[1:]


def mean_of_angles(data: Observations, rig: RigModel) -> list[Mistake]:
    """TE that is its own mean over a piece of the turn: every order is smaller, the higher it is, at all speeds alike.

    The mean over a width w of the turn is sinc(k w) times order k. What is left of orders that lose most of themselves
    is not looked at.
    """
    if not data.both_directions() or not data.orders.max(initial=0):
        return []
    return next((found for signs in ((1.0, -1.0), (1.0,), (-1.0,)) if (found := _mean_in(data, rig, signs))), [])


def _mean_in(data: Observations, rig: RigModel, signs: tuple[float, ...]) -> list[Mistake]:
    """A mean over a part of the turn in the curves of some directions: one column of a file may be processed alone."""
    model, noise, highest = expected_of(data, rig), noise_power(data), int(data.orders.max())
    own = np.isin(data.at.sign, signs)[:, None]

    def mean(square: float) -> ComplexArray:
        return np.where(own, np.sinc(data.orders / highest * np.sqrt(square))[None, :], 1.0).astype(np.complex128)

    every, square = data.orders > 0, _fitted(data, model, noise, mean)
    seen = model * mean(square)
    alike = model * (1.0 + own * _common_step((data.values - model) * own, model * own, noise))
    slope = model * (mean(square + _SMALL) - mean(square)) / _SMALL
    told = _orders_agree(data.values - seen, slope, noise, square)
    if not (told and agreed_gain(data, rig, seen, every) and agreed_gain(data, rig, seen, every, alike)):
        return []
    # what is later at each speed is smaller in the mean of all
    if not agreed_gain(data, rig, seen, every, _late(data, rig)):
        return []

    def corrected(given: Observations) -> Observations:
        kept = np.sinc(given.orders / highest * np.sqrt(square))
        factor = np.where(np.isin(given.at.sign, signs)[:, None], np.where(kept, kept, 1.0), 1.0)
        whole = given.divided(factor)
        told = kept > SETTINGS.acts
        lost = f"orders from {given.orders[~told].min(initial=highest)} on: a mean over the angle leaves little of them"
        return whole if told.all() else whole.of_orders(told, lost)

    which = "" if len(signs) > 1 else " forward" if signs[0] > 0 else " backward"
    text = _MEAN.format(which, 360.0 * np.sqrt(square) / highest)
    return [Mistake("smoothing", text, corrected, remedy="undo it")]


#: step of a derivative by the parameter of a response
_SMALL = 1e-6


def _fitted(
    data: Observations, model: ComplexArray, noise: FloatArray, response: Callable[[float], ComplexArray]
) -> float:
    """The parameter, 0 or more, of a response (n, K) or (1, K) that TE went through and that is 1 at 0."""
    found, before = 0.0, np.inf
    # from nothing a response that leaves hardly anything of most waves is reached by steps that double
    for _ in range(SETTINGS.long_steps):
        if np.isclose(found, before, atol=0.0):
            break
        seen = model * response(found)
        slope = (model * response(found + _SMALL) - seen) / _SMALL
        found, before = max(found + _common_step(data.values - seen, slope, noise), 0.0), found
    return found


def _common_step(gap: ComplexArray, slope: ComplexArray, noise: FloatArray) -> float:
    """The step along a slope (n, K) that the middle one of the orders wants; none says more than a sensor can."""
    power = np.maximum((np.abs(slope) ** 2).sum(axis=0), 1e-300)
    error = 1.0 / np.maximum((np.abs(slope) ** 2 / np.maximum(noise, 1e-300)).sum(axis=0), 1e-300)
    own = (gap * slope.conj()).real.sum(axis=0) / power
    return float(np.quantile(own, 0.5, method="inverted_cdf", weights=1.0 / (error + SETTINGS.torque_step**2)))


def _orders_agree(gap: ComplexArray, slope: ComplexArray, noise: FloatArray, size: float) -> bool:
    """Whether most orders that tell a size along a slope (n, K) want about this one; gap: what it leaves of them.

    A rig whose numbers are all a little wrong has gaps in all orders that one size makes smaller, each another.
    """
    power = np.maximum((np.abs(slope) ** 2).sum(axis=0), 1e-300)
    error = 1.0 / np.sqrt(np.maximum((np.abs(slope) ** 2 / np.maximum(noise, 1e-300)).sum(axis=0), 1e-300))
    more = np.abs((gap * slope.conj()).real.sum(axis=0) / power)
    told = SETTINGS.told * error < abs(size)
    near = more < np.hypot(SETTINGS.of_a_size * size, SETTINGS.told * error)
    return bool(told.any() and near[told].mean() >= SETTINGS.most_orders)


def wrong_angle(data: Observations, rig: RigModel) -> list[Mistake]:
    """An angle that is read wrong within the turn, by the same waves of it in all runs."""
    its = np.array(rig.orders(), np.int64)
    known, noise = rig.coefficients(data.at, its.tolist()), noise_power(data)
    some = rows_that_tell(len(data))
    found = distortion(data.values[some], noise[some], data.orders, known[some], its)
    waves = data.orders > 0
    if found is None or not data.both_directions() or not waves.any():
        return []
    seen = found.seen(known, its, data.orders)
    if not (agreed_gain(data, rig, seen, waves) and _sidebands_show(data, found, known, its)):
        return []
    # the sidebands of a single order are its own, as those of a crack are
    saved = np.abs(data.values - expected_of(data, rig)) ** 2 - np.abs(data.values - seen) ** 2
    around = np.abs(data.orders - its[:, None]) <= 2
    loudest = around[int((around @ np.maximum(saved.sum(axis=0), 0.0)).argmax())]
    if not agreed_gain(data, rig, seen, waves & ~loudest):
        return []

    def corrected(given: Observations) -> Observations:
        # sidebands that were not looked at are those that the rig lets expect
        orders = np.unique(np.concatenate([given.orders, *(np.abs(its + off) for off in range(-2, 3))]))
        values, there = found.seen(known, its, orders), np.searchsorted(orders, given.orders)
        seen = given.told
        values[:, there] = np.where(seen, given.values, values[:, there])
        return replace(given, values=np.where(seen, found.corrected(values, orders)[:, there], given.values))

    sizes = np.degrees(np.abs(found.error))
    told = [
        f"{size:.2g} deg {often}"
        for size, often in zip(sizes, ("once", "twice"), strict=True)
        if SETTINGS.said_of_axis * size > max(sizes)
    ]
    text = _AXIS.format(" and ".join(told))
    return [Mistake("axis", text, corrected, remedy="take it out of the angle")]


def _sidebands_show(data: Observations, found: Distorted, known: ComplexArray, its: IntArray) -> bool:
    """Whether most sidebands that an angle read wrong would lift above the noise of curves were seen above it.

    What stands on orders of the rig alone may be the rig's own. known: coefficients (n, R) of its orders (R,). A table
    has no orders but its own, so that what it lacks says nothing.
    """
    if data.spectral_deg is None:
        return True
    sides = np.setdiff1d(np.abs(its[:, None] + np.array([-2, -1, 1, 2])), [0, *its])
    near = np.abs(data.orders[None, :] - sides[:, None]).argmin(axis=1)
    expected, noise = np.abs(found.seen(known, its, sides)) ** 2, noise_power(data)[:, near]
    loud = (expected.mean(axis=0) > noise.mean(axis=0)) & (sides <= data.orders.max())
    return not loud.any() or float(np.isin(sides[loud], data.orders).mean()) >= SETTINGS.most_orders


def hidden_wrong_angle(data: Observations, rig: RigModel) -> tuple[str, ...]:
    """What is said where noise hides the sidebands of an angle that is read wrong by what turns the highest order.

    They show where as many as a vote asks for stand above what the mean of the runs tells, beside those of the order
    that has the largest, which may have a crack; a table has few of them.
    """
    its = np.array([order for order in rig.orders() if order > 0], np.int64)
    if not data.both_directions() or not len(its) or data.spectral_deg is None:
        return ()
    near = np.abs(data.orders[None, :] - its[:, None]).argmin(axis=1)
    size, noise = np.abs(rig.coefficients(data.at, its.tolist())) * its / 2.0, noise_power(data)
    asked = its != its[(size**2).sum(axis=0).argmax()] if len(its) > 1 else its > 0
    needed = []
    for rows in data.at.by_direction():
        # order k has two sidebands
        told, power = told_power(noise[rows])[near], np.maximum((size[rows] ** 2).mean(axis=0), 1e-300)
        needed += 2 * list(np.sqrt(2.0 * told / power)[asked])
    hidden = float(np.sort(needed)[: SETTINGS.least_orders_of_zero][-1])
    if hidden * data.orders.max() > MOST_TURN:
        return (_ANY_AXIS,)
    return (_HIDDEN_AXIS.format(np.degrees(hidden)),) if hidden * its.max() > SETTINGS.hidden_turn else ()
