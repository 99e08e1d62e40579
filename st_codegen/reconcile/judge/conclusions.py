"""From the last fit to claims: names that hold, parameters of the rig that changed, names that the data cannot tell."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.state import OFFSET, Piece, State
from st_codegen.reconcile.judge.claims import SOMETHING_ELSE, Claim, Conclusions, Other, Retuned
from st_codegen.reconcile.judge.errors import standard_errors, with_the_other_half
from st_codegen.reconcile.judge.lookalikes import (
    FEW,
    KNEE,
    LOOK_ALIKES,
    OF_CHANGES,
    OF_ONE_ORDER,
    OF_SPEED,
    START,
    by_order_alone,
    corrections_left,
    extrapolates,
    is_a_knee,
    left_of_a_response,
    left_of_a_smoothing,
    may_be_of_the_speed,
    of_its_order,
    of_its_shape,
    told_sides,
)
from st_codegen.reconcile.judge.misread import Misread, in_place_of_a_move, in_place_of_additions, misread
from st_codegen.reconcile.judge.retuned import (
    Needed,
    changed_as_well,
    changes,
    not_there,
    offset_is_large,
    with_piece_held,
    with_shapes_inside,
    without_misfits,
)
from st_codegen.reconcile.search.candidates import STAGES, Candidate, Search
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.search.peaks import bracket, chance_of_bracket, has_a_frequency, spread
from st_codegen.reconcile.search.plausible import bounds_met, inside_bounds, is_a_peak, misfit, with_its_orders
from st_codegen.reconcile.search.selection import founded
from st_codegen.reconcile.search.states import in_one_piece, is_a_constant_wave
from st_codegen.reconcile.search.surroundings import left_of_place, may_be_a_start, told_order
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Stage
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Standing:
    """An added effect against the fit without it: that fit, its evidence, and whether it stands."""

    without: Fit
    evidence: Evidence
    stands: bool


def settled(current: Fit) -> tuple[Fit, dict[int, Standing]]:
    """Take back additions that fail what let them in, now that other runs and other effects are there.

    Returns the fit of those that stay, and how each stands.
    """
    while True:
        current = _without_misfits(current)
        standing = {i: _standing(current, i) for i, piece in enumerate(current.state.pieces) if piece.added}
        failing = [i for i, one in standing.items() if not one.stands]
        if not failing:
            return current, standing
        weakest = min(failing, key=lambda i: standing[i].evidence.loss_saved)
        simpler = _simpler(current.state.pieces[weakest])
        state = current.state
        current = fit(current.target, state.without(weakest) if simpler is None else state.replaced(weakest, simpler))


def _simpler(piece: Piece) -> Piece | None:
    """The piece without what comes on top of another part of it; None where nothing does."""
    scalars = piece.effect.scalars
    top = {scalar.key for scalar in scalars if scalar.beside in piece.free and scalar.key in piece.free}
    top |= {scalar.key for scalar in scalars if scalar.shapes in top}
    return piece.without(top) if top else None


def _top_is_unsure(joint: Fit, number: int) -> bool:
    """Whether what comes on top of another part of an effect is smaller than its error leaves open."""
    piece, errors = joint.state.pieces[number], standard_errors(joint, number)
    tops = [s.key for s in piece.effect.scalars if s.beside in piece.free and s.key in piece.free]
    return any(abs(piece.effect.scalar(key)) < SETTINGS.told * errors.get(key, 0.0) for key in tops)


def _standing(current: Fit, number: int) -> Standing:
    without = fit(current.target, current.state.without(number), steps=SETTINGS.quick_steps, tolerance=0.1)
    place = current.state.slices()[number]
    return Standing(without, *founded(without, current, number, list(range(place.start, place.stop))))


def _without_misfits(current: Fit) -> Fit:
    """Take back additions at a bound, and those whose orders keep too much: the data want something else there."""
    while True:
        added = [i for i, piece in enumerate(current.state.pieces) if piece.added]
        for i in added:
            # a shape that another form of the effect does not need is left out of it
            current = inside_bounds(current, i) or current
            current = with_its_orders(current, i)
        over = {i: _over_its_limit(current, current.state.pieces[i]) for i in added}
        worst = max(over, key=lambda i: over[i], default=None)
        if worst is None or not over[worst]:
            return current
        current = fit(current.target, current.state.without(worst))


def _over_its_limit(current: Fit, piece: Piece) -> float:
    """The misfit of an addition that keeps too much; infinite at a bound, 0 for one that may stay.

    A resonance may keep what it likes where the peaks of several orders agree on its frequency.
    """
    if bounds_met(piece) or not is_a_peak(piece):
        return np.inf
    ratio, of_peaks = misfit(current, piece), has_a_frequency(piece.effect)
    limit = SETTINGS.misfit_of_peaks if of_peaks else SETTINGS.misfit
    if current.target.data.few_points and (of_peaks or current.target.data.spectral_deg is not None):
        # a dozen runs tell an effect by its form alone
        limit, of_peaks = SETTINGS.form**2, False
    if ratio <= limit:
        return 0.0
    if not of_peaks or chance_of_bracket(current.target, piece.effect.orders) > SETTINGS.p_agree:
        return ratio
    return ratio if _peaks(current, piece) is None else 0.0


def conclude(rig: RigModel, joint: Fit, known: Catalogue) -> Conclusions:
    """Claims with evidence, changed parameters, alternatives."""
    joint, standing = settled(with_shapes_inside(joint))
    joint, standing, changed = _in_the_form_that_holds(joint, standing)
    final, changed, needed = _with_the_rest_held(joint, changed)
    for i in standing:
        # with the rest of the rig held, a shape may be none that the data need
        final = inside_bounds(final, i) or final
    if (less := _with_less(joint, final, standing)) is not None:
        return conclude(rig, less, known)
    wrong = (*misread(final, changed), *in_place_of_additions(final))
    claims = tuple(_claim(rig, joint, final, i, one, known, wrong) for i, one in standing.items())
    retuned = tuple(
        _retuned(joint, final, i, p, known, needed.get(i), wrong) for i, p in changed.items() if i != OFFSET
    )
    for_offset = _for_the_offset(joint, final, known) if OFFSET in changed else ()
    return Conclusions(joint, final, claims, retuned, OFFSET in changed, wrong, for_offset)


def _in_the_form_that_holds(
    joint: Fit, standing: dict[int, Standing]
) -> tuple[Fit, dict[int, Standing], dict[int, float]]:
    """The fit with added resonances in the form that leaves least changed, what stands there, and what changed.

    A form in which an effect does not stand is none that does as well, but for constants that the other form has.
    """
    free, changed = _told_apart(joint)
    if free is joint:
        return joint, standing, changed
    again, kept = settled(free)
    if len(kept) - len(_constants_beside(again)) == len(standing) - len(_constants_beside(joint)):
        return again, kept, changed
    return joint, standing, changes(joint)


def _with_the_rest_held(joint: Fit, changed: dict[int, float]) -> tuple[Fit, dict[int, float], dict[int, Needed]]:
    """The fit with all that did not change at the rig's own values, what changed, and what is needed beside that."""
    final = fit(joint.target, _held(joint, changed))
    if OFFSET in changed and not offset_is_large(final):
        # it made up for what is held at the rig's own values now
        changed = {i: p for i, p in changed.items() if i != OFFSET}
        final = fit(joint.target, _held(joint, changed))
    final, needed = changed_as_well(joint, final, changed)
    changed = changed | {i: one.p for i, one in needed.items()}
    final, stand = without_misfits(final, changed)
    return final, {i: p for i, p in changed.items() if i in stand}, needed


def _with_less(joint: Fit, final: Fit, standing: Collection[int]) -> Fit | None:
    """The fit without an addition, or a part of one, that is none beside what else was found; None where all stand."""
    for i in standing:
        piece = final.state.pieces[i]
        if _over_its_limit(final, piece) or _is_nothing(final, piece):
            # what holds the rest of the rig put it there, or shows what it keeps: then it was a part of the rest
            return fit(joint.target, joint.state.without(i))
    for i in standing:
        # what is smaller than its error leaves open is no part of what is named
        if _top_is_unsure(joint, i) and (simpler := _simpler(joint.state.pieces[i])) is not None:
            return fit(joint.target, joint.state.replaced(i, simpler))
    return in_one_piece(joint)


def _is_nothing(final: Fit, piece: Piece) -> bool:
    """Whether taking an addition out, with all else as it is, leaves no more than another name may."""
    left = final.residual + final.explained(piece.effect)
    more = final.target.losses(left) - final.target.losses(final.residual)
    return float(more.sum()) < SETTINGS.as_good


def _retuned(
    joint: Fit, final: Fit, number: int, p: float, known: Catalogue, needed: Needed | None, wrong: Sequence[Misread]
) -> Retuned:
    """What is said of a changed effect of the rig; needed: where it is told to have changed with all others held."""
    # effects of the rig of which a change would do in its place
    as_good = {} if needed is None else needed.as_good
    rivals = tuple(Other(final.state.pieces[i].effect.name, one.state.model()) for i, one in as_good.items())
    smaller, larger = _with_and_without(joint, final, number)
    if larger is final:
        moved = fit(smaller.target, replace(smaller.state, offset_free=True), steps=SETTINGS.quick_steps)
        if moved.loss - final.loss < SETTINGS.as_good:
            rivals = (*rivals, Other("zero_offset_deg", moved.state.model()))
    others = (*_as_good(smaller, larger, joint.state.pieces[number], known), *rivals)
    before, piece = joint.state.pieces[number].own, final.state.pieces[number]
    names = {one.reading.name for one in wrong if number in one.instead_of} | corrections_left(final, piece)
    errors = standard_errors(joint, number, final, _otherwise(joint, final, number, known, wrong))
    is_open = final.target.data.few_points or any(looks_alike(final, piece) for looks_alike in OF_CHANGES)
    return Retuned(before, piece.effect, errors, p, others, is_open, tuple(sorted(names)))


def _with_and_without(joint: Fit, final: Fit, number: int) -> tuple[Fit, Fit]:
    """The fit with a change held at the rig's own value, and the one with it: all else free where that needs it.

    What the rest of the rig could do hides what is missing: then it is asked with the rest at the rig's own values.
    """
    smaller, larger = with_piece_held(joint, number), joint
    if smaller.loss - joint.loss < SETTINGS.as_good:
        smaller, larger = with_piece_held(final, number), final
    return smaller, larger


def _for_the_offset(joint: Fit, final: Fit, known: Catalogue) -> tuple[Other, ...]:
    """Effects that would do in place of another zero: missing ones, and those of the rig's that are held."""
    smaller, larger = _with_and_without(joint, final, OFFSET)
    found, held = {one.name: one for one in _as_good(smaller, larger, None, known)}, with_piece_held(final, OFFSET)
    for i, piece in enumerate(joint.state.pieces):
        if piece.origin is None or final.state.pieces[i].free or 0 not in piece.effect.touched_orders():
            continue
        moved = fit(held.target, held.state.replaced(i, piece), steps=SETTINGS.quick_steps)
        if moved.loss - final.loss < SETTINGS.as_good:
            found.setdefault(piece.effect.name, Other(piece.effect.name, moved.state.model()))
    return tuple(found.values())


def _otherwise(joint: Fit, final: Fit, number: int, known: Catalogue, wrong: Sequence[Misread]) -> list[Fit]:
    """Fits in which a piece has other numbers, though nobody knows whether they hold."""
    return [*(one.best for one in wrong), *with_the_other_half(joint, final, number, known)]


def gone(joint: Fit, found: Conclusions) -> tuple[Retuned, ...]:
    """The effects of the rig of which the data show nothing; what was found beside them names what else would do."""
    entries = []
    for number, p in not_there(joint).items():
        before = joint.state.pieces[number].own
        known = next((one for one in found.retuned if one.before is before), Retuned(before, before, {}, p))
        names = {*known.misread, *left_of_a_smoothing(joint, joint.state.pieces[number])}
        nothing = Piece(before, frozenset()).absent
        entries.append(replace(known, after=nothing, stderr={}, p=p, misread=tuple(sorted(names)), is_gone=True))
    return tuple(entries)


def _claim(
    rig: RigModel, joint: Fit, final: Fit, number: int, standing: Standing, known: Catalogue, wrong: Sequence[Misread]
) -> Claim:
    """What is said of an added effect."""
    piece, few = final.state.pieces[number], final.target.data.few_points
    others, peaks = _as_good(standing.without, joint, joint.state.pieces[number], known), _peaks(final, piece)
    read = {one.reading.name for one in wrong if number in one.instead_of} | in_place_of_a_move(final, number)
    read |= left_of_a_response(final, piece.effect)
    names = sorted({other.name for other in others} - {piece.effect.name} | read)
    errors = standard_errors(joint, number, final, _otherwise(joint, final, number, known, wrong))
    stderr = _with_errors_of_form(final, piece, errors, peaks)
    knee, starts = is_a_knee(final, piece), may_be_a_start(final, piece.effect)
    of_speed = may_be_of_the_speed(final, piece)
    speeds = OF_SPEED if len(piece.effect.orders) > 1 else OF_ONE_ORDER
    alone = few or by_order_alone(final, piece) or knee or starts or of_speed or _is_hardly_told_burst(final, piece)
    # nobody has counted how often a sideband without its twin is one
    one_side = piece.effect.stage is Stage.MODULATION and len(told_sides(piece, stderr)) < 2
    is_open = alone or one_side or any(looks_alike(final, piece) for looks_alike in LOOK_ALIKES)
    counted = SETTINGS.names_by_order if alone else SETTINGS.names_by_more
    return Claim(
        piece=piece,
        stderr=stderr,
        evidence=standing.evidence,
        alternatives=(*names, *((SOMETHING_ELSE,) if is_open else ())),
        others=others,
        share=_share(rig, final, piece),
        extrapolates=(
            *extrapolates(joint, piece),
            *of_its_shape(joint, piece, peaks),
            *of_its_order(final, piece),
            *(text for is_so, text in ((few, FEW), (knee, KNEE), (starts, START), (of_speed, speeds)) if is_so),
        ),
        peaks=peaks,
        counted=None if one_side or joint.target.data.angle_rad is not None else counted,
    )


def _is_hardly_told_burst(final: Fit, piece: Piece) -> bool:
    """Whether an effect is a burst of a mesh order of which one of another order has about the form."""
    is_burst = bool(piece.effect.least_foreign and piece.effect.orders)
    return is_burst and told_order(final, piece) < SETTINGS.told_order


def _with_errors_of_form(
    final: Fit, piece: Piece, stderr: dict[str, float], peaks: tuple[float, float] | None
) -> dict[str, float]:
    """Standard errors of a piece, with what a form that is not quite the machine's leaves open.

    A number that is held has none: it is not the data that tell it.
    """
    stderr = {key: error for key, error in stderr.items() if key.partition("[")[0] in piece.told_keys()}
    if peaks is not None:
        # the shape fails, so the errors of the fit say little: what the speeds of the peaks leave open counts
        frequency = piece.effect.scalar("frequency_Hz")
        stderr["frequency_Hz"] = float(np.hypot(stderr.get("frequency_Hz", 0.0), spread(frequency, peaks)))
    if piece.effect.least_foreign:
        # a bump of another form is higher, or lower, than the bell by as much as its form differs
        share = np.sqrt(left_of_place(final, piece))
        sizes = {c.key for c in piece.coordinates() if c.linear}
        values = piece.effect.values
        stderr |= {key: float(np.hypot(error, share * values[key])) for key, error in stderr.items() if key in sizes}
    return stderr


def _told_apart(joint: Fit) -> tuple[Fit, dict[int, float]]:
    """The fit, and what the data refuse of the rig, where no form of an added resonance does as well.

    One excited by a force differs from one excited by a motion by a constant on each of its orders, which the rig's own
    waves would take up, or waves that were added.
    """
    changed = changes(joint)
    found = [i for i, piece in enumerate(joint.state.pieces) if piece.added and has_a_frequency(piece.effect)]
    orders = {order for i in found for order in joint.state.pieces[i].effect.orders}
    own = [
        i for i, piece in enumerate(joint.state.pieces) if not piece.added and orders & {*piece.effect.touched_orders()}
    ]
    beside = [i for i in own if i in changed]
    if not beside and not _constants_beside(joint):
        return joint, changed
    good, at = joint.target.good, np.isin(joint.target.data.orders, sorted(orders))
    power = sum(float((np.abs(joint.explained(joint.state.pieces[i].effect)[good][:, at]) ** 2).sum()) for i in found)

    @cache
    def excited(static_share: float, held: tuple[int, ...] = ()) -> Fit:
        return fit(joint.target, _excited(joint.state.held(held), found, static_share))

    def in_the_better_form(held: list[int], told_by: list[int]) -> Fit:
        """The fit in the form that does better while the waves that tell the two apart are held as well.

        One of the rig that is free takes up the constant and tells nothing, also where that is no change yet.
        """
        return excited(min((1.0, 0.0), key=lambda share: excited(share, (*told_by,)).loss), (*held,))

    def does_as_well(other: Fit) -> bool:
        """Whether a form leaves no more of the orders than any form of a resonance may lack."""
        lost = float((np.abs(other.residual[good][:, at]) ** 2 - np.abs(joint.residual[good][:, at]) ** 2).sum())
        return lost < SETTINGS.form**2 * power

    held = in_the_better_form(beside, own)
    if does_as_well(held):
        return held, changes(held)
    # some of it did change, as what grows with the load beside constants that only one form of the resonance moves
    fewest = min((changes(excited(share)) for share in (1.0, 0.0)), key=lambda one: len(one.keys() & set(beside)))
    rest = [i for i in beside if i not in fewest]
    held = in_the_better_form(rest, [i for i in own if i not in fewest]) if rest else joint
    return (held, changes(held)) if rest and does_as_well(held) else (joint, changed)


def _constants_beside(joint: Fit) -> list[int]:
    """The added waves that are the same at all conditions, on orders of an added resonance."""
    added = [(i, piece.effect) for i, piece in enumerate(joint.state.pieces) if piece.added]
    orders = {order for _, effect in added if has_a_frequency(effect) for order in effect.orders}
    return [i for i, effect in added if is_a_constant_wave(effect) and orders & set(effect.orders)]


def _excited(state: State, numbers: Sequence[int], static_share: float) -> State:
    """The state with some resonances excited by a force (1) or by a motion of their base (0)."""
    for i in numbers:
        piece = state.pieces[i]
        values = {key: x for key, x in piece.effect.values.items() if key != "static_share"}
        values |= {"static_share": static_share} if static_share else {}
        state = state.replaced(i, piece.with_values(values))
    return state


def _peaks(final: Fit, piece: Piece) -> tuple[float, float] | None:
    """Where the peaks put a resonance whose orders keep as much structure as it explains; None for all others."""
    if not has_a_frequency(piece.effect) or misfit(final, piece) < SETTINGS.misfit_of_peaks:
        return None
    return bracket(final.target, final.residual + final.explained(piece.effect), piece.effect)


def unchanged(joint: Fit) -> Fit:
    """The fit of the rig as it is: nothing added, nothing changed."""
    kept = joint.state.without(*(i for i, piece in enumerate(joint.state.pieces) if piece.added))
    return fit(joint.target, kept.held({*range(len(kept.pieces)), OFFSET}))


def _held(joint: Fit, changed: Collection[int]) -> State:
    """The state with what did not change at the rig's own values, and not free."""
    own = {i for i, piece in enumerate(joint.state.pieces) if not piece.added}
    return joint.state.held((own | {OFFSET}).difference(changed))


def _share(rig: RigModel, final: Fit, piece: Piece) -> float:
    """Share of the whole gap (power, noise and all else included) that lies along what a piece contributes.

    Shares of pieces that cancel each other do not add up to more than there is.
    """
    good, parts = final.target.good, final.target.data.parts
    gap, own = final.target.residual(rig)[good], final.explained(piece.effect)[good]
    along = float(((gap * own.conj()).real / parts).sum())
    return float(np.clip(along / max(float((np.abs(gap) ** 2 / parts).sum()), 1e-300), 0.0, 1.0))


def _as_good(smaller: Fit, joint: Fit, piece: Piece | None, known: Catalogue) -> tuple[Other, ...]:
    """Other effects that explain what a piece does, or the zero (None), about as well."""
    own = {0} if piece is None else set(piece.effect.touched_orders())
    name, numbers = ("", 1) if piece is None else (piece.effect.name, len(piece.coordinates()))
    # one order more or less is no resonance; it stands against other effects on many orders only
    stages = STAGES if len(own) > 2 else tuple(stage for stage in STAGES if stage is not Stage.STRUCTURE)
    finder = Search(known, smaller, stages=stages, touching=sorted(own))
    best: dict[str, Candidate] = {}
    ranked = finder.ranked()
    # gains are those of a linear step at the weights of the smaller fit: compared with the largest of their kind
    clear = SETTINGS.clear_beside * min(smaller.loss - joint.loss, max((c.gain for c in ranked), default=0.0))
    for c in ranked:
        touched = set(c.piece.effect.touched_orders())
        if c.name == name or not touched & own or c.name in best:
            continue
        if c.gain > clear:
            best[c.name] = c
    found = []
    data = joint.target.data
    # samples over time are one column, of all orders together
    places = np.flatnonzero(np.isin(data.orders, sorted(own)) | (data.angle_rad is not None))
    for c in list(best.values())[: SETTINGS.other_names]:
        fitted = fit(joint.target, c.put_into(smaller.state), steps=8, tolerance=0.1)
        extra = len(c.coordinates()) - numbers
        # what it gains on other orders does not make it a name for this one's
        worse = joint.target.losses(fitted.residual)[:, places] - joint.target.losses(joint.residual)[:, places]
        if max(fitted.loss - joint.loss, float(worse.sum())) + 2.0 * max(extra, 0) < SETTINGS.as_good:
            found.append(Other(c.name, fitted.state.model()))
    return tuple(found)
