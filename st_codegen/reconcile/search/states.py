"""The form of what was found: what excites a resonance, with which power of the load a mesh order grows, and the like.

A resonance that a force excites deflects under a slow force as well. One whose orders keep more than noise may be two,
with another frequency above a temperature. Each temperature between two levels is tried, and for the part of the runs
on either side of it each frequency around the one that was found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.rest.structure import is_lacking
from st_codegen.reconcile.search.candidates import MODULATED, Candidate, Scorer, is_carried
from st_codegen.reconcile.search.evidence import judge, p_of_more
from st_codegen.reconcile.search.peaks import has_a_frequency, load_keys
from st_codegen.reconcile.search.plausible import at_nobodys_expense, bounds_met, is_a_peak, leaves_less_than_two
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect, Form, Stage
from st_codegen.rig.effects.base import Value

_SIDES = ("above_C", "below_C")
#: the effect that grows with a power of the load, its key of that, and its growth
_MESH, _POWER, _GROWTH = "load_dependent_mesh", "exponent", "slope_deg_per_kNm"


def in_their_forms(current: Fit) -> Fit:
    """The fit with each added effect in the form that the data show."""
    formed = _in_other_forms(current)
    split = _with_states(formed)
    return split if split is formed else _in_other_forms(split)


def _in_other_forms(current: Fit) -> Fit:
    """The fit with added effects in another of the forms that their class has, where that does clearly better.

    Effects that touch many orders take a form together; a power of the load is that of one order.
    """
    forms = {
        (scalar.key, float(start))
        for piece in current.state.pieces
        for scalar in piece.effect.scalars
        if scalar.form is Form.FIXED and piece.effect.name != _MESH
        for start in scalar.starts
    }
    for key, start in sorted(forms):
        state = current.state
        for number, piece in enumerate(state.pieces):
            if _may_take(piece, key):
                state = state.replaced(number, piece.with_values({**piece.effect.values, key: start}))
        if state is not current.state:
            found = fit(current.target, state, steps=SETTINGS.long_steps)
            current = found if _is_better(found, current) else current
    for number, piece in enumerate(current.state.pieces):
        if piece.added and piece.effect.name == _MESH:
            current = _beside_the_carrier(_of_another_power(current, number), number)
    return current


def _beside_the_carrier(current: Fit, number: int) -> Fit:
    """The fit with a growth that the carrier modulates, or does not, the other way round where that does better."""
    piece = current.state.pieces[number]
    if not is_carried(current.state, piece.effect.orders, current.target.data.orders):
        return current
    rest = {key: x for key, x in piece.effect.values.items() if key != MODULATED}
    moved = piece.with_values(rest if MODULATED in piece.effect.values else rest | {MODULATED: 0.0})
    found = fit(current.target, current.state.replaced(number, moved), steps=SETTINGS.long_steps)
    return found if _is_better(found, current) else current


def _of_another_power(current: Fit, number: int) -> Fit:
    """The fit with a mesh order that grows with another power of the load, where that does clearly better.

    Beside a constant, be it found yet or not: a power may do as well as growth in proportion and a constant would.
    """
    piece = current.state.pieces[number]
    powers = (1.0, *next(scalar.starts for scalar in piece.effect.scalars if scalar.key == _POWER))
    others = [power for power in powers if not is_one_form(power, piece.effect.scalar(_POWER))]
    if current.target.data.angle_rad is None:
        left = left_by_power(current, piece, beside_constant=True)
        best = min(others, key=left)
        others = [best] if left(best) < left(piece.effect.scalar(_POWER)) - SETTINGS.as_good else []
    for power in others:
        rest = {key: x for key, x in piece.effect.values.items() if key != _POWER}
        moved = piece.with_values(rest if power == 1.0 else rest | {_POWER: power})
        found = fit(current.target, current.state.replaced(number, moved), steps=SETTINGS.long_steps)
        current = found if _is_better(found, current) else current
    return current


def is_one_form(one: float, other: float) -> bool:
    """Whether two numbers that say a form are the same but for the digits that somebody wrote."""
    return math.isclose(one, other, rel_tol=SETTINGS.one_form)


def vector_in_form(other: Piece, piece: Piece, at: Conditions) -> FloatArray:
    """The coordinates of a piece in another form, as sizes of its own: a growth is the same at the largest load."""
    if piece.effect.name != _MESH:
        return other.vector()
    largest = max(float(np.abs(at.torque_Nm).max(initial=0.0)) / 1000.0, 1e-300)
    ratio: float = largest ** (other.effect.scalar(_POWER) - piece.effect.scalar(_POWER))
    return other.vector() * ratio


def left_by_power(final: Fit, piece: Piece, *, beside_constant: bool = False) -> Callable[[float], float]:
    """What a mesh order leaves where it grows with a power of the load, in noises squared, as a function of that power.

    A wave of each direction; beside a constant, where that is free as well or is asked for.
    """
    data, good = final.target.data, final.target.good
    others = [one for one in final.state.pieces if one is not piece and one.free]
    order = set(piece.effect.orders)
    constant = beside_constant or any(order & set(e.effect.orders) for e in others if is_a_constant_wave(e.effect))
    column = np.isin(data.orders, piece.effect.orders)
    sigma = final.target.sigma[good][:, column]
    wanted = (final.residual + final.explained(piece.effect))[good][:, column] / sigma
    load, sign = data.at.torque_Nm[good], data.at.sign[good]
    load = load / max(float(np.abs(load).max(initial=0.0)), 1e-300)

    def left(power: float) -> float:
        law = np.sign(load) * np.abs(load) ** power
        laws = np.stack([law, *([np.ones(len(law))] if constant else [])], axis=1).astype(np.complex128)
        found = 0.0
        for side, k in product(np.unique(sign), range(wanted.shape[1])):
            rows = sign == side
            design, values = laws[rows] / sigma[rows, k : k + 1], wanted[rows, k]
            found += float((np.abs(values - design @ np.linalg.lstsq(design, values, rcond=None)[0]) ** 2).sum())
        return found

    return left


def is_a_constant_wave(effect: Effect) -> bool:
    """Whether an effect is a wave of one order, the same at all conditions: of any, or of that of the cranks."""
    if effect.name == "crank_misalignment":
        return _GROWTH not in effect.values
    return effect.orders_key == "order" and effect.stage is Stage.ADDITIVE and effect.name != _MESH


@lru_cache(maxsize=8)
def in_forms_as_good(final: Fit, number: int) -> tuple[Fit, ...]:
    """The fits with a piece in each other form of one of its free parts that the data do not refuse.

    Its numbers are others in each of them: nobody knows which form is the machine's.
    """
    piece, found = final.state.pieces[number], list[Fit]()
    for scalar in piece.effect.scalars:
        if scalar.form is not Form.FIXED or scalar.shapes not in piece.free:
            continue
        if scalar.key == MODULATED and not is_carried(final.state, piece.effect.orders, final.target.data.orders):
            continue
        rest = {key: x for key, x in piece.effect.values.items() if key != scalar.key}
        own = piece.effect.scalar(scalar.key)
        for start in (scalar.default, *scalar.starts):
            if start is not None and not is_one_form(start, own):
                values = rest if start == scalar.default else rest | {scalar.key: float(start)}
                state = final.state.replaced(number, piece.with_values(values))
                fitted = fit(final.target, state, steps=SETTINGS.quick_steps)
                if not _is_better(final, fitted):
                    found.append(fitted)
    return tuple(found)


def _is_better(found: Fit, current: Fit) -> bool:
    """Whether a fit is clearly better than another of the same target, weighed by how far runs scatter about the best.

    Weighed by how far they scatter about the worse one, the better one would save little.
    """
    target = found.target
    spreads = [target.about(one.residual).spread for one in (found, current)]
    sharp = replace(target, wide=np.minimum(*spreads))
    after, before = (float(sharp.losses(one.residual).sum()) for one in (found, current))
    return after < before - SETTINGS.as_good


def _may_take(piece: Piece, key: str) -> bool:
    """Whether a piece has no form by this key yet, and has what the form is one of beyond what the rig says."""
    effect, own = piece.effect, () if piece.origin is None else piece.origin.values
    known = {scalar.key: scalar for scalar in effect.scalars}
    if key not in known or key in effect.values:
        return False
    shaped = known[key].shapes
    return shaped in ("", *effect.values) if piece.added else shaped in effect.values and shaped not in own


def _with_states(current: Fit) -> Fit:
    """The fit with each added resonance in two states where the data show two."""
    for number, piece in enumerate(current.state.pieces):
        if not (piece.added and has_a_frequency(piece.effect)) or set(_SIDES) & piece.effect.values.keys():
            continue
        own = np.isin(current.target.data.orders, piece.effect.orders)
        if not (own & is_lacking(current.target, current.residual)).any():
            continue
        found = _split(current, number)
        if found is not None:
            return _with_states(found)
    return current


def _split(current: Fit, number: int) -> Fit | None:
    """The fit with one resonance as two, if that is as well founded as a name of its own.

    Where one whose frequency moves with the oil does as well, as of two temperatures any does, that is the simpler one.
    """
    piece = current.state.pieces[number]
    # a state takes the place of what moves with temperature
    piece = piece.without({"frequency_per_10K"})
    scorer = Scorer(current)
    starts = [scorer.scored(Candidate(one)) for one in _starts(current, piece)]
    if not starts:
        return None
    best = max(starts, key=lambda candidate: candidate.gain)
    side = next(key for key in _SIDES if key in best.piece.effect.values)
    edge = best.piece.effect.scalar(side)
    rest = piece.with_values({**piece.effect.values, _SIDES[side == _SIDES[0]]: edge})
    state = current.state.replaced(number, rest).with_piece(best.piece)
    new = len(state.pieces) - 1
    found = _at_its_edge(fit(current.target, state, steps=SETTINGS.long_steps), (number, new))
    moved = _moving(current, number, found, (number, new))
    if p_of_more(moved, found) > SETTINGS.p_changed:
        one = moved.state.pieces[number]
        better = moved.loss < current.loss - SETTINGS.order_gain and at_nobodys_expense(current, moved, number)
        better = better and is_a_peak(one) and not bounds_met(one)
        return moved if better and leaves_less_than_two(moved, number) else None
    place = found.state.slices()[new]
    both = [found.state.pieces[i] for i in (number, new)]
    if not _have_their_own_frequencies(*(one.effect for one in both)):
        return None
    evidence = judge(current, found, list(range(place.start, place.stop)), new)
    sound = all(is_a_peak(one) and not bounds_met(one) for one in both) and at_nobodys_expense(current, found, new)
    return found if evidence.passed and sound else None


def _have_their_own_frequencies(one: Effect, other: Effect) -> bool:
    """Whether two states differ by more than half the width of the narrower peak.

    Else one structure's damping, or height, may have changed with the oil.
    """
    apart = abs(one.scalar("frequency_Hz") / other.scalar("frequency_Hz") - 1.0)
    return apart > min(effect.scalar("damping_ratio") for effect in (one, other))


def in_one_piece(joint: Fit) -> Fit | None:
    """The fit with one resonance in place of two that are the same; None where none are.

    Two states have come to be the same, or one resonance was found on some of its orders and on the others later. The
    data must not refuse it, by the chance that takes to say that something has changed.
    """
    added = [(i, piece) for i, piece in enumerate(joint.state.pieces) if piece.added and has_a_frequency(piece.effect)]
    for (i, one), (j, other) in combinations(added, 2):
        values = _of_both_states(one.effect, other.effect) or _of_both_orders(one.effect, other.effect)
        if values is None:
            continue
        state = joint.state.replaced(i, one.with_values(values)).without(j)
        found = fit(joint.target, state, steps=SETTINGS.long_steps)
        if p_of_more(found, joint) > SETTINGS.p_changed:
            return found
    return None


def _of_both_states(one: Effect, other: Effect) -> dict[str, Value] | None:
    """What is set of the first of two states that meet at one temperature, without the state."""
    edges = [one.values.get(key, other.values.get(key)) for key in _SIDES]
    are_states = all(set(_SIDES) & effect.values.keys() for effect in (one, other))
    if not are_states or one.orders != other.orders or edges[0] != edges[1]:
        return None
    return {key: x for key, x in one.values.items() if key not in _SIDES}


def _of_both_orders(one: Effect, other: Effect) -> dict[str, Value] | None:
    """What is set of the first of two resonances of one frequency, with the orders of both."""
    apart = abs(one.scalar("frequency_Hz") / other.scalar("frequency_Hz") - 1.0)
    fixed = [[effect.values.get(s.key) for s in effect.scalars if s.form is Form.FIXED] for effect in (one, other)]
    # a height that does not follow the load has a load part of nothing
    both_have = [_with_load_part(a, b) for a, b in ((one, other), (other, one))]
    # the damping ratio is half the width of a peak, as part of its frequency
    are_one = (
        apart < one.scalar("damping_ratio") and fixed[0] == fixed[1] and both_have[0].keys() == both_have[1].keys()
    )
    if not are_one or set(one.orders) & set(other.orders):
        return None
    values, rising = dict(both_have[0]), np.argsort([*one.orders, *other.orders])
    for key, value in both_have[0].items():
        if isinstance(value, tuple):
            both = (*value, *both_have[1][key])  # type: ignore[misc]
            values[key] = tuple(both[place] for place in rising)
    return values


def _with_load_part(effect: Effect, like: Effect) -> dict[str, Value]:
    """What is set of a resonance, and a load part of nothing where another one has any."""
    keys = load_keys(type(effect)) & like.values.keys()
    return {key: (0.0,) * len(effect.orders) for key in sorted(keys)} | dict(effect.values)


def _at_its_edge(split: Fit, two: tuple[int, int]) -> Fit:
    """The fit of two states with the temperature between them moved to where both leave least."""
    target = split.target
    trials = [split]
    for edge in _edges(target.data.at.temperature_C[target.good]):
        state = split.state
        for i in two:
            piece = state.pieces[i]
            values = {**piece.effect.values, **{key: edge for key in _SIDES if key in piece.effect.values}}
            state = state.replaced(i, piece.with_values(values))
        residual = target.residual(state.model())
        trials.append(replace(split, state=state, residual=residual, loss=float(target.losses(residual).sum())))
    best = min(trials, key=lambda trial: trial.loss)
    return split if best is split else _at_its_edge(fit(target, best.state, steps=SETTINGS.long_steps), two)


def _moving(current: Fit, number: int, split: Fit, two: tuple[int, int]) -> Fit:
    """The fit with one resonance whose frequency moves with the oil temperature, from what two states say of it."""
    piece = current.state.pieces[number]
    low, high = sorted((split.state.pieces[i].effect for i in two), key=lambda effect: "above_C" in effect.values)
    oil, edge = current.target.data.at.temperature_C, low.scalar("below_C")
    warmer = float(oil[oil > edge].mean() - oil[oil < edge].mean()) / 10.0
    slope = (high.scalar("frequency_Hz") / low.scalar("frequency_Hz") - 1.0) / warmer
    middle = (high.scalar("frequency_Hz") + low.scalar("frequency_Hz")) / 2
    values = {**piece.effect.values, "frequency_per_10K": slope, "frequency_Hz": middle}
    moved = piece.with_values(values, frozenset({"frequency_per_10K"}))
    return fit(current.target, current.state.replaced(number, moved), steps=SETTINGS.long_steps)


def _starts(current: Fit, piece: Piece) -> Iterator[Piece]:
    """One of the two states at each temperature of the change and each frequency, without a height yet."""
    oil = current.target.data.at.temperature_C[current.target.good]
    frequency = piece.effect.scalar("frequency_Hz")
    heights = {
        key: (0.0,) * len(x) for key, x in piece.effect.values.items() if isinstance(x, tuple) and key != "orders"
    }
    steps = int(SETTINGS.state_reach / SETTINGS.state_step)
    for edge in _edges(oil):
        rows = {"above_C": int((oil > edge).sum()), "below_C": int((oil < edge).sum())}
        for side in rows:
            if min(rows.values()) < SETTINGS.least_rows_of_state:
                continue
            for step in range(-steps, steps + 1):
                moved = {side: edge, "frequency_Hz": frequency * (1.0 + step * SETTINGS.state_step)}
                yield Piece(piece.effect.with_values(dict(piece.effect.values) | heights | moved), piece.free, True)


def _edges(oil: np.ndarray) -> list[float]:
    """Temperatures between levels, or between parts of equal size where there are many levels."""
    levels = np.unique(oil)
    if len(levels) > SETTINGS.most_states:
        levels = np.unique(np.quantile(oil, np.linspace(0, 1, 2 * SETTINGS.most_states + 1), method="nearest"))
    return [float(x) for x in (levels[1:] + levels[:-1]) / 2]
