"""What an addition must be beside significant: a peak where it claims one, inside its bounds, at nobody's expense."""

from __future__ import annotations

import itertools

import numpy as np

from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.parameters import Coordinate, Piece
from st_codegen.reconcile.judge.peaks import has_a_frequency
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Form, Scalar


def bounds_met(piece: Piece) -> list[Coordinate]:
    """The coordinates of a piece that lie at a bound; a size of zero is no bound but the effect's absence."""
    found = []
    for c, x in zip(piece.coordinates(), piece.vector(), strict=True):
        edge = SETTINGS.edge * (c.upper - c.lower)
        low = x - c.lower < edge and not (c.form is Form.LINEAR and c.lower == 0.0)
        if c.part == 0 and (low or c.upper - x < edge):
            found.append(c)
    return found


def inside_bounds(fitted: Fit, number: int) -> Fit | None:
    """The fit with piece `number` inside its bounds, or None where the data insist on a bound: that is no finding.

    A shape that the data do not tell is put to a start of its own and held there.
    """
    piece = fitted.state.pieces[number]
    met = bounds_met(piece)
    if not met:
        return fitted
    if any(c.linear for c in met):
        return None
    scalars = {scalar.key: scalar for scalar in piece.effect.scalars}
    free = piece.free - {c.key for c in met}
    trials = []
    for values in itertools.product(*(_inner(scalars[c.key], c) for c in met)):
        held = {key: value for key, value in piece.effect.values.items() if key not in {c.key for c in met}}
        held |= {c.key: value for c, value in zip(met, values, strict=True) if value is not None}
        inside = Piece(piece.effect.with_values(held), free, piece.added, piece.origin)
        trials.append(fit(fitted.target, fitted.state.replaced(number, inside), steps=SETTINGS.quick_steps))
    best = min(trials, key=lambda trial: trial.loss)
    return best if best.loss - fitted.loss < SETTINGS.as_good else None


def _inner(scalar: Scalar, c: Coordinate) -> list[float | None]:
    """Where a shape is held: left out where that means none of it, else at its starts inside the bounds."""
    if scalar.default == 0.0:
        return [None]
    return [float(x) for x in scalar.starts if c.lower < x < c.upper] or [(c.lower + c.upper) / 2]


def at_nobodys_expense(without: Fit, with_it: Fit) -> bool:
    """Whether no order is explained clearly worse: what bends other parameters to explain an order is not its cause."""
    change = (with_it.target.losses(with_it.residual) - with_it.target.losses(without.residual)).sum(axis=0)
    allowed = max(SETTINGS.order_gain, SETTINGS.expense * (without.loss - with_it.loss))
    return bool(change.max(initial=0.0) < allowed)


def at_two_frequencies(without: Fit, with_it: Fit, number: int) -> bool:
    """A resonance must show at two different frequencies at least: one loud point can be anything."""
    effect = with_it.state.pieces[number].effect
    if not has_a_frequency(effect):
        return True
    data = with_it.target.data
    saved = with_it.target.losses(without.residual) - with_it.target.losses(with_it.residual)
    points = set()
    low, high = np.inf, 0.0
    turn = data.at.speed_rpm / (60 * effect.constants.reduction_ratio)
    for order in effect.orders:
        low, high = min(low, order * turn.min()), max(high, order * turn.max())
        for column in np.flatnonzero(data.orders == order):
            for speed in np.unique(data.at.speed_rpm):
                if saved[data.at.speed_rpm == speed, column].sum() > SETTINGS.point_gain:
                    points.add(round(order * speed / 10))
    frequency = effect.scalar("frequency_Hz")
    grown = len(without.state.pieces) == len(with_it.state.pieces)
    others = [
        piece.effect
        for i, piece in enumerate(without.state.pieces)
        if piece.effect.name == effect.name and not (grown and i == number)
    ]
    # what is left of a resonance that is not quite an oscillator's is not a second one
    apart = all(
        abs(frequency / other.scalar("frequency_Hz") - 1) > SETTINGS.same_resonance
        or not set(other.orders) & set(effect.orders)
        for other in others
    )
    return (
        len(points) >= 2 and 1.02 * low < frequency < 0.98 * high and apart and is_a_peak(with_it.state.pieces[number])
    )


def is_a_peak(piece: Piece) -> bool:
    """Whether a resonance is narrow enough to be told from other dependences on speed; true for all other effects."""
    return not has_a_frequency(piece.effect) or piece.effect.scalar("damping_ratio") < SETTINGS.broadest
