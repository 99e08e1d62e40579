"""What an addition must be beside significant: of its form, a peak where it claims one, inside its bounds, and at
nobody's expense."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.contrasts import levels_of
from st_codegen.reconcile.fit.fitting import Fit, fit, fits
from st_codegen.reconcile.fit.state import Coordinate, Piece, State
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.structure import is_lacking
from st_codegen.reconcile.search.candidates import price_of_number
from st_codegen.reconcile.search.peaks import (
    frequencies_in,
    has_a_frequency,
    is_of_one_speed,
    load_keys,
    lost_over_the_speed,
)
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Form, Scalar, Stage
from st_codegen.rig.effects.empirical import TERMS, term_values
from st_codegen.rig.effects.modulation import CarrierModulation
from st_codegen.rig.effects.resonance import StructuralResonance

#: by which the frequency of a resonance moves
_MOVING = {"frequency_per_kNm", "levels_off_per_kNm", "frequency_per_10K"}


def bounds_met(piece: Piece) -> list[Coordinate]:
    """The coordinates of a piece that lie at a bound; a size of zero is no bound but the effect's absence.

    The bound of a wave is that of its amplitude, not of its real and its imaginary part.
    """
    found = []
    sizes: dict[tuple[str, int], float] = {}
    for c, x in zip(piece.coordinates(), piece.vector(), strict=True):
        if c.part:
            sizes[c.key, c.place] = float(np.hypot(sizes.get((c.key, c.place), 0.0), x))
            if c.part == 2 and sizes[c.key, c.place] > c.upper * (1.0 - SETTINGS.edge):
                found.append(c)
        edge = SETTINGS.edge * c.scale
        # an inverse spans decades: its range is as good as its upper bound, and most of its values lie near the lower
        low = x - c.lower < (SETTINGS.edge * c.lower if c.form is Form.INVERSE else edge)
        low = low and not (c.form is Form.LINEAR and c.lower == 0.0)
        if c.part == 0 and (low or c.upper - x < edge):
            found.append(c)
    return found


def inside_bounds(fitted: Fit, number: int) -> Fit | None:
    """The fit with piece `number` inside its bounds, or None where the data insist on a bound: that is no finding.

    A shape that the data do not tell, or that matters little beside the whole effect, is put to the rig's own value, or
    to a start, and held there.
    """
    piece = fitted.state.pieces[number]
    met = bounds_met(piece)
    if not met:
        return fitted
    if any(c.linear for c in met):
        return None
    scalars = {scalar.key: scalar for scalar in piece.effect.scalars}
    free = piece.free - {c.key for c in met}
    if piece.added and not free:
        return None
    trials = []
    for values in itertools.product(*(_inner(scalars[c.key], c, piece.origin) for c in met)):
        held = {key: value for key, value in piece.effect.values.items() if key not in {c.key for c in met}}
        held |= {c.key: value for c, value in zip(met, values, strict=True) if value is not None}
        inside = Piece(piece.effect.with_values(held), free, piece.added, piece.origin)
        trials.append(fit(fitted.target, fitted.state.replaced(number, inside), steps=SETTINGS.quick_steps))
    best = min(trials, key=lambda trial: trial.loss)
    costs = best.loss - fitted.loss
    if costs < SETTINGS.as_good:
        return best
    if has_a_frequency(piece.effect):
        # its width is what tells a resonance: held elsewhere it hides what else is there, as a second state
        return None
    without = fit(fitted.target, fitted.state.without(number), steps=SETTINGS.quick_steps) if piece.added else fitted
    return best if costs < SETTINGS.misfit_in_curves * (without.loss - fitted.loss) else None


def _inner(scalar: Scalar, c: Coordinate, origin: Effect | None) -> list[float | None]:
    """Where a shape is held: at the rig's own value, left out where that means none of it, else at starts in bounds."""
    if origin is not None and c.key in origin.values:
        return [origin.scalar(c.key)]
    if scalar.default == 0.0:
        return [None]
    return [float(x) for x in scalar.starts if c.lower < x < c.upper] or [(c.lower + c.upper) / 2]


def with_its_orders(current: Fit, number: int) -> Fit:
    """The fit with an added resonance on those of its orders alone that it explains more of than chance would.

    In the search an order may seem to gain by what another effect explains later.
    """
    piece, target = current.state.pieces[number], current.target
    if piece.effect.orders_key != "orders":
        return current
    without = target.losses(current.residual + current.explained(piece.effect)) - target.losses(current.residual)
    gains = dict(zip(target.data.orders.tolist(), without.sum(axis=0), strict=True))
    idle = [k for k in piece.effect.orders if gains.get(k, 0.0) < SETTINGS.order_gain]
    if not idle or len(idle) == len(piece.effect.orders):
        return current
    kept = [place for place, order in enumerate(piece.effect.orders) if order not in idle]
    values = {
        key: tuple(value[place] for place in kept) if isinstance(value, tuple) else value
        for key, value in piece.effect.values.items()
    }
    return fit(target, current.state.replaced(number, piece.with_values(values)))


def misfit(current: Fit, piece: Piece) -> float:
    """Power left where a piece acts, over the power that it takes off there: beyond the noise, or all of a peak's that
    few runs tell."""
    target, peaks = current.target, has_a_frequency(piece.effect)
    if peaks and target.data.few_points:
        # few runs tell a peak by its form alone, and where noise hides that, they tell nothing
        current = replace(current, target=replace(target, sigma=np.zeros_like(target.sigma), wide=target.spread))
        peaks = False
    elif not peaks and target.data.spectral_deg is not None:
        # what both directions of runs have alike, or what follows their order, is no noise, nor is what few runs leave
        # of a form: only that within the curves is noise for sure
        sure, structured = replace(target, scatter_deg=None).sure_sigma, is_lacking(target, current.residual)
        sigma = np.where(structured | target.data.few_points, sure, target.sigma)
        current = replace(current, target=replace(target, sigma=sigma, wide=target.spread))
    # a peak says nothing of what lies far from it; all else must hold where it is small too
    return _left_of(current, current.explained(piece.effect), SETTINGS.acts if peaks else 0.0)


def misfit_of_changes(target: FitData) -> float:
    """The misfit up to which a change of the rig stands: smaller where curves tell their own noise."""
    return SETTINGS.misfit if target.data.spectral_deg is None else SETTINGS.misfit_in_curves


def is_its_own(current: Fit, piece: Piece, held: Fit) -> bool:
    """Whether a changed effect of the rig is what the data want changed; `held`: the fit without the change.

    Where the change leaves much of what it takes off, something else is missing and only bends the parameter; where it
    shows on no order but those of added effects, and is small beside them, it may be what their forms lack.
    """
    seen = current.shown_change(piece)
    shows = np.abs(seen).max(axis=0) > 0.0
    target = current.target
    limit = misfit_of_changes(target)
    if target.data.few_points and target.data.spectral_deg is not None:
        # several parameters together follow a dozen runs though none of them is what changed, and what they leave
        # passes for noise
        limit = SETTINGS.form**2
        current = replace(current, target=replace(target, sigma=target.sure_sigma, wide=target.spread))
    if _left_of(current, seen, 0.0) > limit or not is_no_form_error(held, current, shows=shows):
        return False
    return piece.effect.stage is not Stage.MEASURING or _shows_elsewhere(held, current)


def _shows_elsewhere(held: Fit, current: Fit) -> bool:
    """Whether a change saves loss on orders that no added effect makes, if there are added ones.

    A chain of measurement changes all orders alike: what it takes off those of a new effect alone is that one's form.
    """
    made = {order for piece in current.state.pieces if piece.added for order in piece.effect.touched_orders()}
    saved = (current.target.losses(held.residual) - current.target.losses(current.residual)).sum(axis=0)
    others = ~np.isin(current.target.data.orders, sorted(made))
    return not made or bool(saved[others].sum() > SETTINGS.order_gain)


def _left_of(current: Fit, own: ComplexArray, least: float) -> float:
    target, size = current.target, np.abs(own)
    acts = (size > least * size.max(axis=0)) & target.counts
    # one scale an order: a direction that fits badly must not weigh less for it
    scale = (target.spread**2).mean(axis=0)
    left, before = (np.abs(part) ** 2 * acts / scale for part in (current.residual, current.residual + own))
    noise = SETTINGS.tails * target.data.parts * target.sigma**2 * acts / scale
    saved = (before - left).sum(axis=0)
    beyond = np.maximum((left - noise).sum(axis=0), 0.0)
    mine = saved > SETTINGS.own_order * saved.sum()
    return float(beyond[mine].sum() / max(saved[mine].sum(), 1e-300))


def followers(piece: Piece) -> list[str]:
    """The sidebands of a modulation that follow their mesh order, by key."""
    return [key for key, x in piece.effect.values.items() if key.endswith("_ratio") and x]


def loud_sides(effect: Effect) -> list[int]:
    """The orders of the sidebands of a modulation that are not small beside the other one."""
    if not isinstance(effect, CarrierModulation):
        return []
    loud = set()
    for kind in ("ratio", "deg"):
        sizes = {side: abs(effect.complex_value(f"{side}_{kind}")) for side in ("lower", "upper")}
        loud |= {side for side, size in sizes.items() if size > SETTINGS.form * max(sizes.values())}
    return [order for side, order in effect.sidebands() if side in loud]


def law_holds(without: Fit, fitted: Fit, number: int) -> bool:
    """Whether more than its orders speaks for a name that others could have as well; true for most.

    A wave beside a mesh order, without its twin on the other side, is a sideband only where the mesh does not make that
    order itself, and as far as it follows the mesh: to within the noise, and better than a wave of its own that is
    constant and grows with the load. A resonance is one only where it explains more than constant waves would, and a
    constant wave where no single law of the conditions without a constant leaves clearly less.
    """
    piece, target = fitted.state.pieces[number], fitted.target
    if has_a_frequency(piece.effect):
        own = np.isin(target.data.orders, piece.effect.orders)
        is_one = beats_waves(without, fitted, own, np.ones((len(target.data), 1)))
        is_one = is_one and is_where_it_moves(fitted, piece) and not _is_of_one_speed(fitted, piece)
        is_one = is_one and lost_over_the_speed(fitted, piece.effect) > -1.0
        is_one = is_one and not _is_a_sideband(without, fitted, piece)
        return is_one and leaves_less_than_two(fitted, number)
    if piece.effect.stage is not Stage.MODULATION:
        return not _is_of_a_law(without, fitted, piece)
    mesh = piece.effect.constants.mesh_orders()
    if target.data.angle_rad is not None:
        # samples hold all orders at once
        sides = loud_sides(piece.effect)
        return len(sides) != 1 or sides[0] not in mesh
    size = np.sqrt((np.abs(fitted.explained(piece.effect)[target.good] / target.sigma[target.good]) ** 2).mean(axis=0))
    own = size > SETTINGS.least_size
    if own.sum() != 1:
        return bool(own.any())
    foreign = not np.isin(target.data.orders[own], mesh).any()
    loads = np.stack([np.ones(len(target.data)), target.data.at.torque_Nm], axis=1)
    follows = beats_waves(without, fitted, own, loads) and not (own & is_lacking(target, fitted.residual)).any()
    return foreign and follows


def _is_of_a_law(without: Fit, fitted: Fit, piece: Piece) -> bool:
    """Whether one term of the conditions, with no constant, leaves clearly less of an order than its constant wave.

    It has as many numbers, of each direction where the wave has them: what follows a law is no constant with something
    beside it.
    """
    data, own = fitted.target.data, np.isin(fitted.target.data.orders, piece.effect.touched_orders())
    made = fitted.explained(piece.effect)[:, own]
    sides = data.at.by_direction()
    is_one_wave = own.sum() == 1 and data.orders[own][0] > 0 and data.angle_rad is None and made.all()
    if not is_one_wave or any(np.ptp(np.abs(made[rows])) > 1e-9 * np.abs(made[rows]).max() for rows in sides):
        return False
    turned = made / np.abs(made)
    if np.ptp(np.abs(made)) <= 1e-9 * np.abs(made).max():
        sides = [np.ones(len(made), np.bool_)]
    for name in (name for name in TERMS if name != "constant"):
        values = term_values(name, data.at, fitted.target.reference_temperature_C)
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            left = _left_of_waves(fitted.target, without.residual, own, values[:, None] * turned, sides)
            # about a poor model all are as good
            target = fitted.target.about(left)
            saved = target.losses(fitted.residual) - target.losses(left)
            if saved[:, own].sum() > SETTINGS.order_gain:
                return True
    return False


def _is_of_one_speed(fitted: Fit, piece: Piece) -> bool:
    """Whether a resonance stands where other orders, unexplained or of other added resonances, are loudest as well."""
    peaks = [one for one in fitted.state.pieces if one.added and has_a_frequency(one.effect)]
    others = set(fitted.target.data.orders[is_lacking(fitted.target, fitted.residual)].tolist())
    others |= {order for one in peaks for order in one.effect.orders}
    seen = fitted.residual + sum((fitted.explained(one.effect) for one in peaks), np.zeros_like(fitted.residual))
    return is_of_one_speed(fitted.target, seen, piece.effect, sorted(others - {0, *piece.effect.orders}))


def _is_a_sideband(without: Fit, fitted: Fit, piece: Piece) -> bool:
    """Whether the loudest order of a resonance may as well be what one wave makes of another, at another frequency.

    A wave of j a turn, of an angle, turns one of order i by i times its size (rad): half of that, times the wave, is on
    orders i - j and i + j. These are loud at its speeds, at no frequency of their own. Twice as much is let pass.
    """
    values, orders = fitted.target.data.values, fitted.target.data.orders
    loudest = int(np.argmax(fitted.target.losses(fitted.explained(piece.effect)).sum(axis=0)))
    varies = sum(values[rows].var(axis=0) * len(rows) for rows in fitted.target.data.at.by_direction())
    apart = np.abs(orders / orders[loudest] - 1.0) > 2.0 * piece.effect.scalar("damping_ratio")
    size = dict(zip(orders.tolist(), np.radians(np.abs(values).mean(axis=0)), strict=True))
    turned = orders * np.array([size.get(abs(int(order - orders[loudest])), 0.0) for order in orders])
    own, once = np.arange(len(orders)) == loudest, np.ones(len(values))
    others = (values[:, other] for other in np.flatnonzero(apart & (varies[loudest] < turned**2 * varies)))
    laws = (np.stack([once, other / np.abs(other).max()], axis=1) for other in others)
    return not all(beats_waves(without, fitted, own, of_other) for of_other in laws)


def is_where_it_moves(fitted: Fit, piece: Piece) -> bool:
    """Whether a frequency that moves with load or oil explains no level of these worse than nothing would.

    Where the size follows another law than its own, a peak that a level has not goes between its speeds.
    """
    target, at, own = fitted.target, fitted.target.data.at, fitted.explained(piece.effect)
    gain = (target.losses(fitted.residual + own) - target.losses(fitted.residual)).sum(axis=1)
    followed = (("frequency_per_kNm", np.abs(at.torque_Nm)), ("frequency_per_10K", at.temperature_C))
    levels = [levels_of(values) for key, values in followed if piece.effect.values.get(key)]
    return all(gain[level == number].sum() > -SETTINGS.order_gain for level in levels for number in np.unique(level))


def leaves_less_than_two(fitted: Fit, number: int) -> bool:
    """Whether a resonance whose frequency moves leaves less than two that stay would; true where it does not move.

    Each order has its own share of two modes beside each other: one that moves, with heights that follow the load,
    takes off some of what one that stays leaves. A number must save as much as in the search.
    """
    piece, target = fitted.state.pieces[number], fitted.target
    effect, moving = piece.effect, _MOVING & piece.effect.values.keys()
    if not moving or not isinstance(effect, StructuralResonance):
        return True
    both = fitted, two_that_stay(fitted, number)
    # weighed by how far runs scatter about the worse of them, the better one would save little
    sharp = replace(target, wide=np.minimum(*(target.about(one.residual).spread for one in both)))
    left = [float(sharp.losses(one.residual).sum()) + price_of_number(target) * len(one.prior) for one in both]
    return left[0] < left[1]


def is_one_that_stays(effect: Effect) -> bool:
    """Whether an effect is a resonance whose frequency moves with nothing and that is there at all temperatures."""
    return isinstance(effect, StructuralResonance) and not effect.state_text and not _MOVING & effect.values.keys()


def are_two(one: Fit, two: Fit, *numbers: int) -> bool:
    """Whether two pieces of a fit are two resonances told by their peaks, and no part of one; one: the fit with that.

    Each half width ends before the other one's begins. In each direction both make more than the form of one may lack:
    a mode of either direction is one whose speeds are read wrong. And of what one leaves of their orders, which is more
    than noise, they leave a small part: what is left of one whose form is not quite an oscillator's is no second one. A
    dozen runs tell one peak by its form alone, and would follow two of any form.
    """
    if one.target.data.few_points:
        return False
    pieces = [two.state.pieces[i] for i in numbers]
    low, high = sorted((piece.effect for piece in pieces), key=lambda effect: effect.scalar("frequency_Hz"))
    ends = [
        effect.scalar("frequency_Hz") * (1.0 + side * effect.scalar("damping_ratio"))
        for side, effect in ((1.0, low), (-1.0, high))
    ]
    made = [np.abs(two.explained(piece.effect)) ** 2 for piece in pieces]
    power = [[float(part[rows].sum()) for part in made] for rows in two.target.data.at.by_direction(two.target.good)]
    own = one.target.counts & np.isin(one.target.data.orders, [*low.orders, *high.orders])
    noise = float((one.target.data.parts * one.target.sigma**2 * own).sum())
    left = [max(float((np.abs(fitted.residual[own]) ** 2).sum()) - noise, 0.0) for fitted in (one, two)]
    are_both = all(min(both) > SETTINGS.form**2 * max(both) for both in power)
    return ends[0] < ends[1] and are_both and left[0] > noise and left[1] < SETTINGS.left_of_one * left[0]


def two_that_stay(fitted: Fit, number: int) -> Fit:
    """The fit with two resonances that stay, the other one the last piece, in place of the one of a number."""
    piece, target = fitted.state.pieces[number], fitted.target
    effect = piece.effect
    assert isinstance(effect, StructuralResonance)
    load = load_keys(type(effect))
    sizes = {key for phasor in effect.phasors for key in (phasor.keys(False)[0], phasor.keys(True)[0])}
    half = {key: tuple((np.array(effect.values[key]) / 2.0).tolist()) for key in effect.values if key in sizes - load}
    moves = _MOVING & effect.values.keys()
    staying = piece.without(moves | (load if half else set()))
    at, damping = target.data.at.rows(target.good), effect.scalar("damping_ratio")
    hertz = effect.scalar("frequency_Hz") * effect.shift(at.torque_Nm, at.temperature_C)
    states = list[State]()
    # where one stays it stands between two of like phase, and at one of two that are opposed
    far = SETTINGS.same_resonance
    beside = [(1.0 - damping, 1.0 + damping), (1.0 - far, 1.0), (1.0, 1.0 + far)]
    starts = [np.median(hertz) * np.array(pair) for pair in beside]
    for ends in [np.quantile(hertz, (0.25, 0.75)), starts[0]] if moves else starts:
        low, high = (staying.with_values({**staying.effect.values, **half, "frequency_Hz": float(x)}) for x in ends)
        states.append(fitted.state.replaced(number, low).with_piece(replace(high, added=True, origin=None)))
    return min(fits(target, states, steps=SETTINGS.long_steps), key=lambda one: one.loss)


def beats_waves(without: Fit, fitted: Fit, own: BoolArray, laws: FloatArray | ComplexArray) -> bool:
    """Whether a fit explains orders clearly better than waves of these orders and of each direction that follow laws.

    own: bool (K,); laws: (n, m), what the waves may be made of over the operating points.
    """
    target = fitted.target
    left = _left_of_waves(target, without.residual, own, laws, target.data.at.by_direction())
    return bool((target.losses(left) - target.losses(fitted.residual))[:, own].sum() > SETTINGS.order_gain)


def _left_of_waves(
    target: FitData,
    residual: ComplexArray,
    own: BoolArray,
    laws: FloatArray | ComplexArray,
    sides: Sequence[BoolArray],
) -> ComplexArray:
    """What waves of some orders, and of each of some sets of rows, that follow laws leave of a residual, (n, K)."""
    left, weights = residual.copy(), target.weights(residual)
    for rows in sides:
        for k in np.flatnonzero(own):
            root = np.sqrt(weights[rows, k])
            wave = np.linalg.lstsq(root[:, None] * laws[rows], root * left[rows, k], rcond=None)[0]
            left[rows, k] -= laws[rows] @ wave
    return left


def is_no_form_error(without: Fit, with_it: Fit, number: int | None = None, shows: BoolArray | None = None) -> bool:
    """Whether a change of the fit saves loss beyond what the forms of other added effects may lack.

    number: the addition that is judged, if it is one; shows: the orders that a change shows on, bool (K,): what others
    lose elsewhere for want of it is theirs. In each run a form may be off by a share of what the other added
    effects contribute there: so much of what is left counts for nothing.
    """
    target = _sharp(with_it)
    others = [piece for i, piece in enumerate(with_it.state.pieces) if piece.added and i != number]
    slack = _slack(with_it, others)
    left = [np.maximum(np.abs(one.residual) - slack, 0.0).astype(np.complex128) for one in (without, with_it)]
    saved = (target.losses(left[0]) - target.losses(left[1])).sum(axis=0)
    there = saved if shows is None else saved[shows]
    return bool(min(saved.sum(), there.sum()) > SETTINGS.order_gain)


def _slack(current: Fit, pieces: Sequence[Piece]) -> FloatArray:
    """By how much the forms of pieces may be off in each run, (n, K): a share of what they contribute there."""
    return SETTINGS.form * np.abs(
        sum((current.explained(one.effect) for one in pieces), np.zeros_like(current.residual))
    )


def lack_of_forms(current: Fit) -> FloatArray:
    """By how much the forms of the effects that a fit added may be off in each run, (n, K), deg.

    A resonance whose frequency is another in some runs, as in a second state, has its whole peak there.
    """
    added = [piece for piece in current.state.pieces if piece.added]
    found, data = _slack(current, added), current.target.data
    turns = 60.0 * current.target.reduction_ratio
    for effect in (piece.effect for piece in added if has_a_frequency(piece.effect)):
        frequency = effect.scalar("frequency_Hz")
        for k in np.flatnonzero(np.isin(data.orders, effect.orders)):
            order = int(data.orders[k])
            its_peak = replace(data.at, speed_rpm=np.full(len(data), turns * frequency / order))
            near = np.abs(order * data.at.speed_rpm / turns / frequency - 1.0) < SETTINGS.state_reach
            found[near, k] += np.abs(effect.contribution(its_peak, data.orders[k : k + 1])[near, 0])
    return found


def _sharp(fitted: Fit) -> FitData:
    """What a fit was fitted to, of few runs weighed by how far they scatter about it.

    Weighed by how far they scatter about a model that lacks something, few runs could save too little.
    """
    target = fitted.target
    return target.about(fitted.residual) if target.data.few_points else target


def at_nobodys_expense(without: Fit, with_it: Fit, number: int) -> bool:
    """Whether no order is explained clearly worse: what bends other parameters to explain an order is not its cause.

    An effect of one angle reaches many orders, quiet ones too: there its form may cost what it may lack.
    """
    change = (with_it.target.losses(with_it.residual) - with_it.target.losses(without.residual)).sum(axis=0)
    allowed = max(SETTINGS.order_gain, SETTINGS.expense * (without.loss - with_it.loss))
    if change.max(initial=0.0) < allowed:
        return True
    effect = with_it.state.pieces[number].effect
    if not effect.least_foreign:
        return False
    power = (with_it.target.counts * (np.abs(with_it.residual) ** 2 - np.abs(without.residual) ** 2)).sum(axis=0)
    of_its_form = np.isin(with_it.target.data.orders, effect.touched_orders())
    worse = np.maximum(power, 0.0)
    return bool(change[~of_its_form].max(initial=0.0) < allowed and worse.sum() < SETTINGS.left_of_place * -power.sum())


def at_two_frequencies(without: Fit, with_it: Fit, number: int) -> bool:
    """A resonance must show at two different frequencies at least: one loud point can be anything."""
    effect = with_it.state.pieces[number].effect
    if not has_a_frequency(effect):
        return True
    data = with_it.target.data
    target = _sharp(with_it)
    saved = target.losses(without.residual) - target.losses(with_it.residual)
    points = set()
    low, high = np.inf, 0.0
    turn = data.at.speed_rpm / (60 * effect.constants.reduction_ratio)
    for order in effect.orders:
        low, high = min(low, order * turn.min()), max(high, order * turn.max())
        for column in np.flatnonzero(data.orders == order):
            for speed in np.unique(data.at.speed_rpm):
                if saved[data.at.speed_rpm == speed, column].sum() > SETTINGS.point_gain:
                    points.add(round(order * speed / 10))
    at_lowest, at_highest = frequencies_in(effect, data.at)
    others = {i: p.effect for i, p in enumerate(with_it.state.pieces) if p.effect.name == effect.name and i != number}
    if len(without.state.pieces) < len(with_it.state.pieces):
        # another state of the structure is no second resonance
        mine = effect.state_text
        others = {i: o for i, o in others.items() if not (mine and o.state_text) or mine == o.state_text}
    # what is left of a resonance that is not quite an oscillator's is not a second one
    apart = all(
        abs(effect.scalar("frequency_Hz") / other.scalar("frequency_Hz") - 1) > SETTINGS.same_resonance
        or not set(other.orders) & set(effect.orders)
        or are_two(without, with_it, i, number)
        for i, other in others.items()
    )
    reach = SETTINGS.inside_speeds
    is_inside = (1.0 + reach) * low < at_highest and at_lowest < (1.0 - reach) * high
    is_one = at_highest < SETTINGS.most_shift * at_lowest
    return len(points) >= 2 and is_inside and is_one and apart and is_a_peak(with_it.state.pieces[number])


def is_a_peak(piece: Piece) -> bool:
    """Whether a resonance is narrow enough to be told from other dependences on speed; true for all other effects."""
    return not has_a_frequency(piece.effect) or piece.effect.scalar("damping_ratio") < SETTINGS.broadest
