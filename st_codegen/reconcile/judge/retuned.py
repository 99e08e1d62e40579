"""Which parameters that the rig has already the data refuse."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.reconcile.data.chances import chi_square_tail
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.normal import inverse
from st_codegen.reconcile.fit.state import OFFSET, Coordinate, Piece
from st_codegen.reconcile.judge.errors import covariance_with_discrepancy
from st_codegen.reconcile.judge.few_runs import follows_another_law, may_be_scatter, unsure_together
from st_codegen.reconcile.rest.lasting import lasting_mean, power_of_mean, without_lasting
from st_codegen.reconcile.rest.structure import floors, is_lacking, is_left, structure
from st_codegen.reconcile.search.evidence import p_of_clusters, p_of_more
from st_codegen.reconcile.search.plausible import bounds_met, inside_bounds, is_its_own, misfit_of_changes
from st_codegen.reconcile.search.surroundings import stands_out
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Form, Stage


def with_shapes_inside(joint: Fit) -> Fit:
    """The fit with the effects of the rig inside their bounds, where that does as well.

    A shape of a part that is small is told by nothing: it says nothing against a change of the other parts.
    """
    for i in _own_pieces(joint):
        joint = inside_bounds(joint, i) or joint
    return joint


def changes(joint: Fit) -> dict[int, float]:
    """Pieces of the rig, and its offset (OFFSET), whose own values the data refuse, with the chance of that."""
    found = {}
    for i in _own_pieces(joint):
        piece = joint.state.pieces[i]
        places, difference = _difference(joint, i)
        p = _p_of(joint, places, difference)
        sure = p < SETTINGS.p_changed
        if sure:
            # where the model is a product (a ratio times a mesh order) standard errors at the solution say too little
            held = with_piece_held(joint, i)
            p = max(p, chi_square_tail(held.loss - joint.loss, len(places)))
            sure = p < SETTINGS.p_changed and is_its_own(joint, piece, held)
            # and not what lies around its orders as well
            sure = sure and stands_out(joint, joint.shown_change(piece))
        grown = piece.effect.values.keys() != piece.own.values.keys()
        if sure and (grown or not _lasting_noise(joint, piece)) and not _insists_on_a_bound(piece):
            found[i] = p
    shift = joint.state.vector()[:1] - joint.state.rig.zero_offset_deg
    if offset_is_large(joint) and (p := _p_of(joint, [0], shift)) < SETTINGS.p_changed:
        found[OFFSET] = p
    return found


def _insists_on_a_bound(piece: Piece) -> bool:
    """Whether a change ends at a bound that the rig's own values keep clear of: then its form is not what changed."""
    before = {c.key for c in bounds_met(replace(piece, effect=piece.own))}
    return any(c.key not in before for c in bounds_met(piece))


@dataclass(frozen=True)
class Needed:
    """A change without which an order keeps structure: its chance, and by number the pieces that would do as well."""

    p: float
    as_good: dict[int, Fit]


def not_there(joint: Fit) -> dict[int, float]:
    """Pieces of the rig that the data refuse and of which they show nothing, with the chance of the rig's own values.

    What the fit leaves of such a piece, at whatever frequency, angle or width suits the noise, is no change of it:
    without the piece nothing more is left than noise leaves of so many parameters. Together with those found before.
    Where its orders keep much of what that takes off, something else is there that may hide it.
    """
    found: dict[int, float] = {}
    for i in _own_pieces(joint):
        piece = joint.state.pieces[i]
        left = _left_of(joint, piece)
        if left >= SETTINGS.nothing_left:
            continue
        gone = [*found, i]
        without = fit(joint.target, joint.state.without(*gone), steps=SETTINGS.quick_steps)
        numbers = sum(len(joint.state.pieces[n].coordinates()) for n in gone)
        held = with_piece_held(joint, i)
        p = chi_square_tail(held.loss - without.loss, len(piece.coordinates()))
        # of a piece that is hardly there noise may take more, by choosing its shape
        chance = SETTINGS.p_chance if left < SETTINGS.form else SETTINGS.p_wander
        is_nothing = chi_square_tail(without.loss - joint.loss, numbers) > chance
        if p < SETTINGS.p_changed and is_nothing and is_its_own(joint, piece, held):
            found[i] = p
    return found


def _left_of(joint: Fit, piece: Piece) -> float:
    """The size of a piece of the rig as a part of its own; 0 where a compliance is at the least that there is."""
    least = [c for c in bounds_met(piece) if c.form is Form.INVERSE]
    if any(_value(piece, c) < (c.lower + c.upper) / 2 for c in least):
        return 0.0
    if piece.effect.stage is Stage.MEASURING:
        # its skew does what friction that grows with the speed does: whether the chain is late the delay says
        own_us = piece.held().effect.scalar("delay_us")
        return piece.effect.scalar("delay_us") / own_us if own_us else np.inf
    good = joint.target.good
    now, own = (
        np.abs(joint.explained(one.effect)[good] / joint.target.sigma[good]) ** 2 for one in (piece, piece.held())
    )
    return float(np.sqrt(now.sum() / max(float(own.sum()), 1e-300)))


def _value(piece: Piece, wanted: Coordinate) -> float:
    return float(piece.vector()[piece.coordinates().index(wanted)])


def changed_as_well(joint: Fit, final: Fit, changed: dict[int, float]) -> tuple[Fit, dict[int, Needed]]:
    """The final fit with as many more changes of the rig as it takes that no order keeps what its own effects explain.

    Several parameters that differ a little from the rig's may each be told from it by no run, and yet all be told
    together: held at the rig's values they leave structure that is no physics the rig lacks. The change that takes most
    of it comes first; with all others held, the data must refuse the rig's values.
    """
    found: dict[int, Needed] = {}
    kept = _keeps_more(joint)
    while True:
        lacking = _keeps_more(final) & ~kept | _has_a_pattern(final) & ~_has_a_pattern(joint)
        tried = {i: one for i in _own_pieces(joint) if i not in changed and i not in found
                 if (one := _freed(joint, final, i, lacking, kept)) is not None} if lacking.any() else {}  # fmt: skip
        if not tried:
            return final, found
        # each parameter must save so much to be worth more than none
        best = min(tried, key=lambda i: tried[i].loss + SETTINGS.as_good * len(tried[i].prior))
        as_good = {i: one for i, one in tried.items() if i != best and one.loss - tried[best].loss < SETTINGS.as_good}
        final, found[best] = tried[best], Needed(p_of_more(final, tried[best]), as_good)


def _keeps_more(one: Fit) -> BoolArray:
    """The orders of which a fit leaves more than noise, and more than noise that lasts over runs may be, bool (K,)."""
    left, lacking = is_left(one.target, one.residual), is_lacking(one.target, one.residual)
    if (left & ~lacking).any():
        left &= lacking | (power_of_mean(one.target, one.residual, at_most=True) == 0.0)
    return left


def _has_a_pattern(one: Fit) -> BoolArray:
    """The orders of which a fit leaves a pattern over the conditions, bool (K,): runs may differ by more besides."""
    return structure(one.target, one.residual).significant


def without_misfits(final: Fit, changed: dict[int, float]) -> tuple[Fit, set[int]]:
    """The final fit without the changes whose orders keep much of what they take off, and which changes stand.

    Then something else is there, which bends what the rig has: a step in time moves a mean, a torque that is read wrong
    all that depends on it. Changes of the same orders are judged together, since two that make up for each other each
    take off what the other one adds; and by the noise of these orders, not by how far their runs scatter.
    """
    kept = set({i: p for i, p in changed.items() if i != OFFSET})
    offset = {OFFSET} & changed.keys()
    while (kept or offset) and final.target.data.angle_rad is None:
        over = _misfits(final, [*sorted(kept), *offset])
        # what made up for a change that is held now is none
        held = {i: with_piece_held(final, i) for i in sorted(kept)}
        over |= {i: np.inf for i, without in held.items() if not _stands(final, without, i)}
        over |= dict.fromkeys(unsure_together(final, sorted(kept)), np.inf)
        # of several that cannot stay the one whose absence costs least goes first
        worst = max(over, key=lambda i: (over[i], -held[i].loss if i in held else -np.inf))
        if over[worst] <= misfit_of_changes(final.target):
            break
        if worst == OFFSET:
            offset = set()
            final = fit(final.target, final.state.held({OFFSET}))
        else:
            kept.remove(worst)
            final = held[worst]
    return final, kept | offset


def _stands(final: Fit, held: Fit, number: int) -> bool:
    """Whether a change is one by itself; held: the fit without it."""
    return (
        not _insists_on_a_bound(final.state.pieces[number])
        and _is_refused(final, held)
        and not may_be_scatter(final, held, number)
        and not follows_another_law(final, held, number)
    )


def _is_refused(final: Fit, held: Fit) -> bool:
    """Whether the data refuse the rig's own values of a piece, all else being as it is, and no order refuses the new.

    What one order asks for and another one, which was noise without it, does not bear is not what changed. held: the
    fit without the change.
    """
    target, saved = final.target, held.loss - final.loss
    worse = (target.losses(final.residual) - target.losses(held.residual)).sum(axis=0) > SETTINGS.order_gain
    if (worse & is_lacking(target, final.residual) & ~is_lacking(target, held.residual)).any():
        return False
    # noise that lasts over runs has a mean of its own
    left, right = (float(target.losses(without_lasting(target, one.residual)).sum()) for one in (held, final))
    return chi_square_tail(min(saved, left - right), len(final.prior) - len(held.prior)) < SETTINGS.p_changed


def _misfits(final: Fit, changed: Collection[int]) -> dict[int, float]:
    """For each change the power beyond noise that its orders keep, over that which all changes take off them."""
    target, data = final.target, final.target.data
    of_offset = np.where(data.orders == 0, 1.0, 0.0)
    own = {
        i: of_offset if i == OFFSET else (np.abs(final.shown_change(final.state.pieces[i])) ** 2).mean(axis=0)
        for i in changed
    }
    of_runs = estimate(data, final.residual).floor_rms
    known = floors(target, final.residual, of_runs)
    # the noise within curves says nothing of a mean, which runs differ by
    known = np.where(data.orders == 0, np.maximum(known, of_runs), known)
    floor = np.maximum(known, SETTINGS.least_noise_deg) ** 2
    before, left = (
        (np.abs(data.with_real_mean(part)) ** 2 * target.counts).sum(axis=0) / floor
        for part in (target.residual(final.state.held(own).model()), final.residual)
    )
    # noise within curves is that of many samples, and has no heavy tails
    tails = SETTINGS.tails if data.spectral_deg is None else 1.0
    numbers = data.parts * target.counts.sum(axis=0)
    # the mean power of so many numbers of noise scatters: a gap below that is not told
    noise = tails * (numbers + SETTINGS.told * np.sqrt(2.0 * numbers))
    beyond, found = np.maximum(left - noise, 0.0), {}
    for i, power in own.items():
        mine = power / floor > SETTINGS.much * (power / floor).max()
        saved = float((before - left)[mine].sum())
        found[i] = float(beyond[mine].sum()) / saved if saved > 0.0 else np.inf
    return found


def _freed(joint: Fit, final: Fit, number: int, lacking: BoolArray, kept: BoolArray) -> Fit | None:
    """The final fit with one more piece free, where that takes off what orders lack, and the data ask for it.

    lacking: the orders that a change may bring to noise; kept: those that no change does, bool (K,).
    """
    piece = joint.state.pieces[number]
    one = fit(final.target, final.state.replaced(number, piece), steps=SETTINGS.quick_steps)
    saved = (one.target.losses(final.residual) - one.target.losses(one.residual)).sum(axis=0)
    if saved[lacking].sum() <= SETTINGS.order_gain:
        return None
    # where no order shows a pattern, runs may as well share noise
    chance = _p_alone if is_lacking(final.target, final.residual)[lacking].any() else _p_of
    sure = max(p_of_more(final, one), chance(one, *_difference(one, number))) < SETTINGS.p_changed
    changed = one.state.pieces[number]
    sure = sure and not _insists_on_a_bound(changed) and is_its_own(one, changed, final)
    return one if sure and stands_out(one, one.shown_change(changed), kept) else None


def offset_is_large(joint: Fit) -> bool:
    """Whether the offset of a fit is off the rig's by more than lasting noise, and what is left, could make."""
    target = joint.target
    shift = joint.state.offset - joint.state.rig.zero_offset_deg
    sigma = target.sigma[:, target.data.orders == 0]
    lasting = lasting_mean(target, joint.residual)[target.data.orders == 0].max(initial=0.0)
    if not sigma.size or abs(shift) <= max(SETTINGS.least_constant * float(np.sqrt((sigma**2).mean())), lasting):
        return False
    return stands_out(joint, np.tile(np.where(target.data.orders == 0, shift + 0j, 0.0), (len(target.data), 1)))


def _own_pieces(joint: Fit) -> list[int]:
    """Pieces that the rig has and that have something free."""
    slices = joint.state.slices()
    return [
        i
        for i, piece in enumerate(joint.state.pieces)
        if not piece.added and piece.origin is not None and slices[i].stop > slices[i].start
    ]


def _difference(joint: Fit, number: int) -> tuple[list[int], FloatArray]:
    """Places of the coordinates of a piece, and how far they are from the rig's own."""
    piece, place = joint.state.pieces[number], joint.state.slices()[number]
    own = Piece(piece.own, piece.free)
    places = list(range(place.start, place.stop))
    return places, joint.state.vector()[places] - own.vector()


def _lasting_noise(joint: Fit, piece: Piece) -> bool:
    """Whether a change is so small and so much the same in all runs that noise which lasts would look like it."""
    target = joint.target
    part = joint.shown_change(piece) / target.sigma
    parts = target.data.parts
    size, varies = 0.0, 0.0
    for rows in (part[side] for side in target.data.at.by_direction(target.good)):
        power = (np.abs(rows) ** 2).mean(axis=0) / parts
        size = max(size, float(np.sqrt(power.max(initial=0.0))))
        spread = (np.abs(rows - rows.mean(axis=0)) ** 2).mean(axis=0) / parts
        varies = max(varies, float(spread.sum() / max(float(power.sum()), 1e-300)))
    return size < SETTINGS.least_constant and varies < SETTINGS.varies


def _p_of(joint: Fit, places: list[int], difference: FloatArray) -> float:
    """The larger chance of both tests; the one by clusters is brought to the scale of the other."""
    plain, clusters = (
        _p_alone(joint, places, difference),
        p_of_clusters(joint, places, difference, covariance_with_discrepancy(joint)),
    )
    return plain if clusters < SETTINGS.p_clusters else max(plain, clusters)


def with_piece_held(joint: Fit, number: int) -> Fit:
    """The fit with one piece held at the rig's own values and all others fitted again."""
    return fit(joint.target, joint.state.held({number}), steps=SETTINGS.quick_steps)


def _p_alone(joint: Fit, places: list[int], difference: FloatArray) -> float:
    """Chance of a difference by noise that is independent from run to run."""
    block = joint.inverse[np.ix_(places, places)]
    return chi_square_tail(float(difference @ inverse(block) @ difference), len(places))
