"""What an addition or a change must be beside what lies around it: between orders, and between angles of the turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.chances import f_tail
from st_codegen.reconcile.data.noise import MEDIAN_1
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.lines import stand_out, waves_of_angle
from st_codegen.reconcile.rest.structure import wander_within_turns
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Stage
from st_codegen.rig.effects.wear import bump

#: samples of a turn at which a place is looked at
_ANGLES = np.radians(np.arange(0.0, 360.0, 0.25))


def stands_out(current: Fit, own: ComplexArray, lacking: BoolArray | None = None) -> bool:
    """Whether a contribution (n, K) is clearly larger on one of its orders than what nobody explains on those around.

    Where all orders hold about as much that no effect makes, one of them says nothing of the effect that it belongs to.
    Where the loudest of those around is one that a part of the machine makes by itself, the others tell.
    lacking: bool (K,), the orders that keep more than noise, where that is known: others hold nothing, however far
    single runs lie off.
    """
    target = current.target
    orders, rows = target.data.orders, target.good
    if target.data.angle_rad is not None:
        return _lines_stand_out(current, own)
    left = np.abs(current.residual[rows]) ** 2 - target.data.parts * target.sigma[rows] ** 2
    left = left if lacking is None else left * lacking
    # an effect of one angle reaches all orders: what is left of them is its form's
    waves = [piece.effect for piece in current.state.pieces if not piece.effect.least_foreign]
    made = {order for effect in waves for order in effect.touched_orders()}
    size, left = (np.abs(own[rows]) ** 2).mean(axis=0), np.maximum(left.mean(axis=0), 0.0)
    # orders of curves that are not looked at are no louder than noise; what a table lacks nobody knows
    known = orders if target.data.spectral_deg is None else np.arange(1, orders.max(initial=0) + 1)
    around = np.zeros(len(known))
    around[np.isin(known, orders)] = left[np.isin(orders, known)]
    nobodys, of_parts = ~np.isin(known, list(made)), np.isin(known, current.state.rig.constants.part_orders())
    for k in np.flatnonzero(size > SETTINGS.part_of_change * size.max(initial=0.0)):
        near = np.flatnonzero(nobodys & (np.abs(known - orders[k]) <= SETTINGS.around_order))
        near = near[np.argsort(np.abs(known[near] - orders[k]), kind="stable")][: SETTINGS.shared_orders]
        if len(near) < SETTINGS.shared_orders:
            return True
        most = around[near].mean()
        if of_parts[near[around[near].argmax()]]:
            most = min(most, _without_largest(around[near]))  # the loudest may lack an effect of its own
        if size[k] > SETTINGS.stands_out * most:
            return True
    return False


def _without_largest(powers: FloatArray) -> float:
    """The mean that powers of random waves have, told by all but the largest.

    Of n that are exponential, the largest has 1 + 1/2 + .. 1/n times their mean (Renyi).
    """
    count = len(powers)
    rest = count - (1.0 / np.arange(1, count + 1)).sum()
    return float((powers.sum() - powers.max()) / rest)


def _lines_stand_out(current: Fit, own: ComplexArray) -> bool:
    """Whether a contribution to samples over time stands out, by its waves over the output's angle.

    What is none of a few waves, as a mean that follows speed and torque, has no order, and nothing around it.
    """
    data = current.target.data
    highest = max(data.inside) + SETTINGS.around_line[1]
    size, left = (np.abs(waves_of_angle(data, part[:, 0].real, highest)) ** 2 for part in (own, current.residual))
    nobodys = ~np.isin(np.arange(highest + 1), list(current.state.rig.orders()))
    much = size > SETTINGS.part_of_change * size.max()
    in_waves = size[0] + size[1:].sum() / 2 > 0.5 * float((np.abs(own) ** 2).mean())
    return bool(not in_waves or (much & stand_out(size, left, nobodys)).any())


def is_of_its_place(current: Fit, number: int) -> bool:
    """Whether the curves have the form of an effect of one angle there, and no other one stands beside it."""
    piece, target = current.state.pieces[number], current.target
    centre, width = _place(piece.effect)
    if abs(_turned(centre)) < SETTINGS.reach_of_place * width and wander_within_turns(target, current.residual):
        return False  # where curves begin and end, they jump
    for other in current.state.pieces[:number]:
        if other.effect.least_foreign:
            beside, its_width = _place(other.effect)
            if abs(_turned(beside - centre)) < SETTINGS.reach_of_place * (width + its_width):
                return False
    if _would_be_seen_elsewhere(target, piece.effect):
        return False
    if not (_is_told_by_others(current, piece) and _is_no_peak_of_many(current, piece)):
        return False
    is_its_order = not piece.effect.orders or told_order(current, piece) > 0.0
    return is_its_order and left_of_place(current, piece) <= SETTINGS.left_of_place


def _is_told_by_others(current: Fit, piece: Piece) -> bool:
    """Whether an effect of one angle is there on the orders beside the two that gain most by it as well.

    These gain what it has there, and by chance none of it where it is not: the middle decides. Asked are orders that
    the rig does not make, since its own take up what they can. Two sidebands that the rig lacks have the sizes and
    phases of some narrow bump.
    """
    target = current.target
    own = current.explained(piece.effect)
    weights = target.weights(current.residual)
    gain = (weights * (np.abs(current.residual + own) ** 2 - np.abs(current.residual) ** 2)).sum(axis=0)
    foreign = ~np.isin(target.data.orders, list(current.state.rig.orders())) & (np.abs(own).max(axis=0) > 0.0)
    others = np.flatnonzero(foreign)[np.argsort(gain[foreign])[:-2]]
    return bool(gain[others].sum() > 0.5 * (weights * np.abs(own) ** 2).sum(axis=0)[others].sum())


def _is_no_peak_of_many(current: Fit, piece: Piece) -> bool:
    """Whether an effect of one angle is more than what its form meets by chance somewhere in the turn.

    A profile that each turn repeats, as the texture of a surface, has a highest peak. The form is moved over the turn
    on what the fit leaves (a matched filter, in which an order that is louder than those beside it counts as they do):
    that is how much it meets where it is not, and of as many such numbers as the turn has widths the largest must be
    no chance.
    """
    target, (_, width), rows = current.target, _place(piece.effect), current.target.good
    columns = (target.data.orders > 0) & ~np.isin(target.data.orders, list(current.state.rig.orders()))
    own, left = (values[np.ix_(rows, columns)] for values in (current.explained(piece.effect), current.residual))
    power = np.maximum((np.abs(left) ** 2).mean(axis=0), 1e-300)
    weights = np.minimum(median_filter(power, 2 * SETTINGS.shared_orders + 1) / power, 1.0)
    met = (own.conj() * left).sum(axis=0) * weights
    turned = _ANGLES[np.abs(_turned(_ANGLES)) > SETTINGS.reach_of_place * width]
    if not len(turned):
        return True
    elsewhere = np.abs((met @ np.exp(1j * np.outer(target.data.orders[columns], turned))).real)
    here = float(met.sum().real + ((np.abs(own) ** 2).sum(axis=0) * weights).sum())
    times = min(here * MEDIAN_1 / max(float(np.median(elsewhere)), 1e-300), 1e100)  # its square is a number
    # of few orders that the form has in common with what is left, the fit has taken a good part of that
    shares = (np.abs(own.conj() * left) ** 2).sum(axis=0) * weights**2
    numbers = max(2.0 * float(shares.sum() ** 2 / max((shares**2).sum(), 1e-300)), 2.0)
    return bool(f_tail(times**2, 1, numbers - 1.0) * 2.0 * np.pi / width < SETTINGS.p_chance)


def _would_be_seen_elsewhere(target: FitData, effect: Effect) -> bool:
    """Whether an effect of one angle would stand above the noise on orders of curves that were found to be quiet.

    Waves of a few orders that the rig lacks meet at some angle as if there was a bump, which has all orders.
    """
    data, good = target.data, target.good
    if data.spectral_deg is None:
        return False
    reached = [k for k in effect.touched_orders() if 0 < k <= data.orders.max()]
    quiet = np.setdiff1d(reached, data.orders)
    noise = 2.0 * float(np.median(data.spectral_deg[good][:, data.orders > 0])) ** 2
    power = (np.abs(effect.contribution(data.at.rows(good), quiet)) ** 2).mean(axis=0)
    loud = power > SETTINGS.quiet_order / np.sqrt(good.sum()) * noise
    return bool(loud.sum() > SETTINGS.left_of_place * len(reached))


def may_be_a_start(current: Fit, effect: Effect) -> bool:
    """Whether an effect may be what dies away behind the start of curves: an axis that settles, a filter that runs in.

    A place where curves begin and end, or a resonance that lifts many orders of which the rig makes none. Only curves
    have a start.
    """
    if current.target.data.spectral_deg is None:
        return False
    if effect.least_foreign:
        centre, width = _place(effect)
        reach = max(np.radians(SETTINGS.reach_of_start_deg), SETTINGS.reach_of_place * width)
        return bool(abs(_turned(centre)) < reach)
    orders = set(effect.touched_orders()) - set(current.state.rig.orders())
    return effect.stage is Stage.STRUCTURE and len(orders) >= SETTINGS.shared_orders


def left_of_place(current: Fit, piece: Piece) -> float:
    """The share of its power by which the form of an effect of one angle is not that of the curves there.

    Seen are the orders that the rig does not make, within some widths; how large it is in each run may be as it will.
    """
    target, (centre, width) = current.target, _place(piece.effect)
    foreign = ~np.isin(target.data.orders, current.state.rig.orders())
    angles = _ANGLES[np.abs(_turned(_ANGLES - centre)) < SETTINGS.reach_of_place * width]
    turn = np.exp(1j * np.outer(target.data.orders[foreign], angles))
    left, power = 0.0, 0.0
    for rows in target.data.at.by_direction(target.good):
        own = current.explained(piece.effect)[np.ix_(rows, foreign)]
        form = (own @ turn).real
        there = ((own + current.residual[np.ix_(rows, foreign)]) @ turn).real
        # the one form that curves share most of, whatever its size in each
        alike = float(np.linalg.svd(form)[2][0] @ np.linalg.svd(there)[2][0]) ** 2
        left, power = left + (form**2).sum() * (1.0 - alike), power + (form**2).sum()
    return left / max(power, 1e-300)


def angle_of_rest(target: FitData, residual: ComplexArray, orders: Sequence[int]) -> tuple[float, float, float] | None:
    """Where the waves of many orders stand together in the mean curve of all runs, and nowhere else; None for most.

    Returns the angle of the output, to how far on both sides most of their power lies, and the largest deviation there
    in a direction, all in deg. residual: (n, K); orders: those that keep more than noise.
    """
    columns = np.flatnonzero(np.isin(target.data.orders, [k for k in orders if k > 0]))
    if target.data.angle_rad is not None or len(columns) < SETTINGS.shared_orders:
        return None
    turn = np.exp(1j * np.outer(target.data.orders[columns], _ANGLES))
    sides = target.data.at.by_direction(target.good)
    curves = np.array([(residual[np.ix_(rows, columns)].mean(axis=0) @ turn).real for rows in sides])
    power = (curves**2).sum(axis=0)
    for reach in SETTINGS.reaches_of_place_deg:
        width = 2 * round(reach * len(_ANGLES) / 360.0) + 1
        inside = np.convolve(
            np.concatenate([power[-(width // 2) :], power, power[: width // 2]]), np.ones(width), "valid"
        )
        if inside.max() > SETTINGS.most_of_gap * power.sum():
            centre = int(np.argmax(inside))
            return float(np.degrees(_ANGLES[centre])), reach, float(np.abs(curves).max())
    return None


def told_order(current: Fit, piece: Piece) -> float:
    """By which share a burst of its mesh order leaves less of the form of the curves than one of any foreign order.

    Either at its angle, as wide as fits best. Below 0 it is none of a mesh order: a pulse that is shorter than a wave
    has about the form of all of them. Seen are the orders that the rig does not make.
    """
    target, effect, (centre, width) = current.target, piece.effect, _place(piece.effect)
    foreign = ~np.isin(target.data.orders, current.state.rig.orders())
    angles = _ANGLES[np.abs(_turned(_ANGLES - centre)) < SETTINGS.reach_of_place * width]
    orders, mesh = target.data.orders[foreign], set(current.state.rig.constants.mesh_orders())
    turn, curves = np.exp(1j * np.outer(orders, angles)), []
    for rows in target.data.at.by_direction(target.good):
        there = ((current.explained(piece.effect) + current.residual)[np.ix_(rows, foreign)] @ turn).real
        size, form = np.linalg.svd(there, full_matrices=False)[1:]
        curves.append(size[0] * form[0])
    power = max(sum(float(curve @ curve) for curve in curves), 1e-300)

    def left(order: int) -> float:
        found = []
        for wide in width * np.array(SETTINGS.widths_of_burst):
            wave = bump(orders - order, effect.scalar("centre_deg"), float(np.degrees(wide))) @ turn
            basis = np.linalg.qr(np.stack([wave.real, wave.imag], axis=1))[0]
            found.append(1.0 - sum(float(((curve @ basis) ** 2).sum()) for curve in curves) / power)
        return min(found)

    (own,), reach = effect.orders, round(1.0 / width)
    others = [left(k) for k in range(max(own - reach, 1), own + reach + 1) if k not in mesh]
    least = min(others, default=1.0)
    return 1.0 - left(own) / max(least, 1e-12)


def _place(effect: Effect) -> tuple[float, float]:
    """Centre and width of an effect of one angle, rad."""
    return np.radians(effect.scalar("centre_deg")), np.radians(effect.scalar("width_deg"))


def _turned(angle: FloatArray | float) -> FloatArray:
    """An angle in -pi .. pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))
