"""From the last fit to claims: names that hold, parameters of the rig that changed, names that the data cannot tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.reconcile.data.observations import rms_deg
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.parameters import Coordinate, Piece
from st_codegen.reconcile.fit.state import OFFSET, State
from st_codegen.reconcile.judge import discrepancy
from st_codegen.reconcile.judge.candidates import STAGES, Candidate, Search
from st_codegen.reconcile.judge.evidence import Evidence
from st_codegen.reconcile.judge.held_out import unmeasured_states
from st_codegen.reconcile.judge.lookalikes import (
    by_order_alone,
    gains_one_sideband,
    is_a_constant_wave,
    is_a_knee,
    left_of_a_delay,
    left_of_a_smoothing,
    left_of_filters,
    may_be_another_power,
    may_be_friction,
    may_be_of_a_law,
    may_be_of_the_turn,
    may_be_time,
    told_sides,
)
from st_codegen.reconcile.judge.misread import Misread, covariance_of_corrections, in_place_of_a_move, misread
from st_codegen.reconcile.judge.peaks import bracket, chance_of_bracket, frequencies_in, has_a_frequency, spread
from st_codegen.reconcile.judge.plausible import (
    bounds_met,
    followers,
    inside_bounds,
    is_a_peak,
    misfit,
    with_its_orders,
)
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
from st_codegen.reconcile.judge.selection import founded
from st_codegen.reconcile.judge.states import in_forms_as_good, in_one_piece
from st_codegen.reconcile.judge.structure import is_lacking
from st_codegen.reconcile.judge.surroundings import left_of_place, may_be_a_start, told_order
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Effect, Form, Stage
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Other:
    """Another name that explains the data as well, and the rig that it gives."""

    name: str
    rig: RigModel


@dataclass(frozen=True)
class Claim:
    """An effect that is missing in the rig: its piece, evidence, and equally good names.

    share: of the gap (power) that the effect explains; own_gap: RMS (deg) of the gap of its orders alone, before and
    after all changes; peaks: the frequencies (Hz) between which the peaks of a resonance's orders put it, where their
    shape is not that of one oscillator; counted: how many names of this kind were true, of how many, if that is known.
    """

    piece: Piece
    stderr: dict[str, float]
    evidence: Evidence
    alternatives: tuple[str, ...]
    others: tuple[Other, ...]
    share: float
    own_gap: tuple[float, float]
    extrapolates: tuple[str, ...]
    peaks: tuple[float, float] | None = None
    counted: tuple[int, int] | None = None

    @property
    def probability(self) -> float | None:
        """Chance that the name is true, by how many of its kind were (rule of succession); None where none is known."""
        return None if self.counted is None else (self.counted[0] + 1) / (self.counted[1] + 2)

    def in_doubt(self) -> Claim:
        """The claim with `something_else` among its alternatives."""
        if SOMETHING_ELSE in self.alternatives:
            return self
        counted = self.counted and SETTINGS.names_by_order
        return replace(self, alternatives=(*self.alternatives, SOMETHING_ELSE), counted=counted)


@dataclass(frozen=True)
class Retuned:
    """An effect of the rig whose parameters the data contradict; other effects that would do in place of the change.

    misread: names of mistakes of measuring, and of links of the axis that were not measured, that would do so as well.
    is_gone: the data show nothing of it; its sizes are at nothing then, and its shapes are the rig's.
    """

    before: Effect
    after: Effect
    stderr: dict[str, float]
    p: float
    others: tuple[Other, ...] = ()
    is_open: bool = False
    misread: tuple[str, ...] = ()
    is_gone: bool = False

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Names of effects, and those of `misread`, that explain the data as well as the change does.

        `something_else` is among them (is_open) where its orders stay unexplained: what is there may have moved it.
        """
        named = sorted({other.name for other in self.others} | set(self.misread))
        return (*named, *((SOMETHING_ELSE,) if self.is_open else ()))


#: effects of the mean that turn with the direction, and those of the same law that do not
_TURNING = frozenset({"torsional_compliance", "friction_windup", "backlash"})
_ONE_SIDED = frozenset({"torsional_compliance", "hanging_load_compliance"})


@dataclass(frozen=True)
class Conclusions:
    """What is claimed, and the fit behind it (all parameters free: `joint`; unchanged ones held: `final`).

    misread: what may be read wrong in place of changes of the rig; offset_is_open: what is unexplained reaches it too.
    """

    joint: Fit
    final: Fit
    claims: tuple[Claim, ...]
    retuned: tuple[Retuned, ...]
    offset_changed: bool
    misread: tuple[Misread, ...] = ()
    offset_is_open: bool = False

    def changes_for(self, one: Misread) -> list[str]:
        """Names of what need not have changed where something is read wrong, each once, with how often."""
        pieces = self.final.state.pieces
        names = Counter(pieces[i].effect.name for i in one.instead_of if i != OFFSET)
        several = [name if times == 1 else f"{times} of {name}" for name, times in sorted(names.items())]
        return [*several, *(["zero_offset_deg"] if OFFSET in one.instead_of else [])]

    def with_misread(self, more: Sequence[Misread]) -> Conclusions:
        """These, with readings that come before those that are known, among the alternatives of what they stand for."""
        pieces = self.final.state.pieces
        retuned = []
        for entry in self.retuned:
            names = {
                one.reading.name
                for one in more
                if any(i != OFFSET and _origin(pieces[i]) is entry.before for i in one.instead_of)
            }
            retuned.append(replace(entry, misread=tuple(sorted(names | {*entry.misread}))))
        return replace(self, misread=(*more, *self.misread), retuned=tuple(retuned))

    @property
    def of_offset(self) -> tuple[str, ...]:
        """Names of what would do in place of another zero offset, mistakes of measuring first.

        Beside a change that turns with the direction it may be the other half of what changed in one direction alone.
        """
        read = sorted({one.reading.name for one in self.misread if OFFSET in one.instead_of})
        return (*read, *((SOMETHING_ELSE,) if self.names & _TURNING or self.offset_is_open else ()))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that are missing or changed, as they are now."""
        claimed = (claim.piece.effect for claim in self.claims)
        return (*claimed, *(one.after for one in self.retuned if not one.is_gone))

    @property
    def names(self) -> set[str]:
        """Names of the effects that are missing or changed."""
        return {effect.name for effect in self.effects}


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
    free, changed, offset_changed = _told_apart(joint)
    if free is not joint:
        again, kept = settled(free)
        # a form in which an effect does not stand is none that does as well, but for constants that the other form has
        if len(kept) - len(_constants_beside(again)) == len(standing) - len(_constants_beside(joint)):
            joint, standing = again, kept
        else:
            changed, offset_changed = changes(joint)
    final = fit(joint.target, _held(joint, changed, offset_changed))
    if offset_changed and not offset_is_large(final):
        # it made up for what is held at the rig's own values now
        offset_changed = False
        final = fit(joint.target, _held(joint, changed, offset_changed))
    final, left = changed_as_well(joint, final, changed)
    changed |= {i: one.p for i, one in left.items()}
    final, stand, offset_changed = without_misfits(final, changed, offset_changed)
    changed = {i: p for i, p in changed.items() if i in stand}
    for i in standing:
        # with the rest of the rig held, a shape may be none that the data need
        final = inside_bounds(final, i) or final
    outside = [i for i in standing if bounds_met(final.state.pieces[i]) or not is_a_peak(final.state.pieces[i])]
    if outside:
        # what holds the rest of the rig put it there: then it was a part of the rest
        return conclude(rig, fit(joint.target, joint.state.without(outside[0])), known)
    for i in standing:
        # what is smaller than its error leaves open is no part of what is named
        if _top_is_unsure(joint, i) and (simpler := _simpler(joint.state.pieces[i])) is not None:
            return conclude(rig, fit(joint.target, joint.state.replaced(i, simpler)), known)
    if (alike := in_one_piece(joint)) is not None:
        return conclude(rig, alike, known)
    wrong = misread(final, changed, offset_changed)
    claims = tuple(_claim(rig, joint, final, i, one, known, wrong) for i, one in standing.items())
    rivals = {i: _own_rivals(final, one) for i, one in left.items()}
    retuned = tuple(_retuned(joint, final, i, p, known, rivals.get(i, ()), wrong) for i, p in changed.items())
    return Conclusions(joint, final, claims, retuned, offset_changed, wrong)


def _own_rivals(final: Fit, one: Needed) -> tuple[Other, ...]:
    """Effects of the rig of which a change would do in place of another one's."""
    return tuple(Other(final.state.pieces[i].effect.name, fitted.state.model()) for i, fitted in one.as_good.items())


def _retuned(
    joint: Fit,
    final: Fit,
    number: int,
    p: float,
    known: Catalogue,
    rivals: tuple[Other, ...],
    wrong: Sequence[Misread],
) -> Retuned:
    """What is said of a changed effect of the rig."""
    smaller, larger = with_piece_held(joint, number), joint
    if smaller.loss - joint.loss < SETTINGS.as_good:
        # what the rest of the rig could do hides what is missing: asked with the rest at the rig's own values
        smaller, larger = with_piece_held(final, number), final
        moved = fit(smaller.target, replace(smaller.state, offset_free=True), steps=SETTINGS.quick_steps)
        if moved.loss - final.loss < SETTINGS.as_good:
            rivals = (*rivals, Other("zero_offset_deg", moved.state.model()))
    others = (*_as_good(smaller, larger, number, known), *rivals)
    before, after = _origin(joint.state.pieces[number]), final.state.pieces[number].effect
    names = {one.reading.name for one in wrong if number in one.instead_of}
    names |= left_of_filters(final, number) | left_of_a_delay(final, number) | left_of_a_smoothing(final, number)
    errors = standard_errors(joint, number, final, wrong)
    is_open = gains_one_sideband(before, after) or is_a_knee(final, after) or may_be_friction(final, after)
    # another size of a constant wave is what a wave from elsewhere would make
    is_open |= may_be_time(final, after) or may_be_of_the_turn(after) or by_order_alone(final, number)
    is_open |= may_be_of_a_law(final, number) or may_be_another_power(final, number)
    return Retuned(before, after, errors, p, others, is_open, tuple(sorted(names)))


def gone(joint: Fit, found: Conclusions) -> tuple[Retuned, ...]:
    """The effects of the rig of which the data show nothing; what was found beside them names what else would do."""
    entries = []
    for number, p in not_there(joint).items():
        before = _origin(joint.state.pieces[number])
        known = next((one for one in found.retuned if one.before is before), Retuned(before, before, {}, p))
        names = {*known.misread, *left_of_a_smoothing(joint, number)}
        nothing = Piece(before, frozenset()).unit(None)
        entries.append(replace(known, after=nothing, stderr={}, p=p, misread=tuple(sorted(names)), is_gone=True))
    return tuple(entries)


def _claim(
    rig: RigModel,
    joint: Fit,
    final: Fit,
    number: int,
    standing: Standing,
    known: Catalogue,
    wrong: Sequence[Misread],
) -> Claim:
    """What is said of an added effect."""
    others = _as_good(standing.without, joint, number, known)
    piece = final.state.pieces[number]
    stderr, peaks = standard_errors(joint, number, final, wrong), _peaks(final, piece)
    if peaks is not None:
        # the shape fails, so the errors of the fit say little: what the speeds of the peaks leave open counts
        frequency = piece.effect.scalar("frequency_Hz")
        stderr["frequency_Hz"] = float(np.hypot(stderr["frequency_Hz"], spread(frequency, peaks)))
    if piece.effect.least_foreign:
        # a bump of another form is higher, or lower, than the bell by as much as its form differs
        share = np.sqrt(left_of_place(final, piece))
        sizes = {c.key for c in piece.coordinates() if c.linear}
        stderr |= {key: float(np.hypot(stderr[key], share * piece.effect.values[key])) for key in sizes & stderr.keys()}
    names = sorted({other.name for other in others} - {piece.effect.name} | in_place_of_a_move(final, number))
    few = final.target.data.few_points
    starts, is_burst = may_be_a_start(final, piece.effect), bool(piece.effect.least_foreign and piece.effect.orders)
    unsure = starts or (is_burst and told_order(final, piece) < SETTINGS.told_order)
    knee = is_a_knee(final, piece.effect)
    alone = few or by_order_alone(final, number) or knee or unsure
    # nobody has counted how often a sideband without its twin is one
    one_side = piece.effect.stage is Stage.MODULATION and len(told_sides(piece, stderr)) < 2
    is_open = alone or one_side or may_be_friction(final, piece.effect) or may_be_time(final, piece.effect)
    is_open |= may_be_of_the_turn(piece.effect) or may_be_another_power(final, number)
    counted = SETTINGS.names_by_order if alone else SETTINGS.names_by_more
    return Claim(
        piece=piece,
        stderr=stderr,
        evidence=standing.evidence,
        alternatives=(*names, *((SOMETHING_ELSE,) if is_open else ())),
        others=others,
        share=_share(rig, final, piece),
        own_gap=_own_gap(rig, final, piece),
        extrapolates=(
            *_extrapolates(joint, piece),
            *_of_its_shape(piece, peaks),
            *_of_its_order(final, number),
            *((_FEW,) if few else ()),
            *((_KNEE,) if knee else ()),
            *((_START,) if starts else ()),
        ),
        peaks=peaks,
        counted=None if one_side or joint.target.data.angle_rad is not None else counted,
    )


def _told_apart(joint: Fit) -> tuple[Fit, dict[int, float], bool]:
    """The fit, and what the data refuse of the rig, where no form of an added resonance does as well.

    One excited by a force differs from one excited by a motion by a constant on each of its orders, which the rig's own
    waves would take up, or waves that were added.
    """
    changed, offset_changed = changes(joint)
    found = [i for i, piece in enumerate(joint.state.pieces) if piece.added and has_a_frequency(piece.effect)]
    orders = {order for i in found for order in joint.state.pieces[i].effect.orders}
    beside = [i for i in changed if orders & set(joint.state.pieces[i].effect.touched_orders())]
    if not beside and not _constants_beside(joint):
        return joint, changed, offset_changed
    state = joint.state.held(beside)
    held = min((fit(joint.target, _excited(state, found, share)) for share in (1.0, 0.0)), key=lambda one: one.loss)
    good, at = joint.target.good, np.isin(joint.target.data.orders, sorted(orders))
    power = sum(float((np.abs(held.explained(held.state.pieces[i].effect)[good][:, at]) ** 2).sum()) for i in found)
    lost = float((np.abs(held.residual[good][:, at]) ** 2 - np.abs(joint.residual[good][:, at]) ** 2).sum())
    return (held, *changes(held)) if lost < SETTINGS.form**2 * power else (joint, changed, offset_changed)


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


def _of_its_shape(piece: Piece, peaks: tuple[float, float] | None) -> tuple[str, ...]:
    """What the width of a resonance and the shape of its peaks leave open."""
    if peaks is None:
        damping = piece.effect.values.get("damping_ratio")
        narrow = isinstance(damping, float) and damping < SETTINGS.narrow
        text = "narrower than the steps of speed: height and damping are uncertain"
        return (text,) if narrow else ()
    return (
        f"the peaks are not those of one oscillator; the speeds at which they stand put it between {peaks[0]:.1f} "
        f"and {peaks[1]:.1f} Hz, height and damping are uncertain",
    )


#: what is said beside every name that few runs give
_FEW = "so few runs cannot tell one law of the conditions from another: measure more levels"
#: what is said beside play that a transmission without any would show at these torques
_KNEE = "a transmission without play that is softer at low loads does as well"
#: what is said beside a name that what happens at the start of each curve may have
_START = "what dies away behind the start of each curve (an axis that settles, a filter that runs in) looks like it"
#: the alternative to a name that only an order, or few runs, give
SOMETHING_ELSE = "something_else"


def _of_its_order(final: Fit, number: int) -> tuple[str, ...]:
    """What is said beside a name that only an order gives."""
    if not by_order_alone(final, number):
        return ()
    piece = final.state.pieces[number]
    order = piece.effect.orders[0]
    if piece.effect.stage is Stage.MODULATION:
        what = "one sideband" if followers(piece) else "two constant sidebands"
        alike = "without the other: a wave of that order" if followers(piece) else "that do not follow it: two waves"
        return (f"{what} of order {order} {alike} from elsewhere is as likely",)
    return (
        f"order {order} is one that this part makes; a constant wave of that order from elsewhere would look the same",
    )


def _origin(piece: Piece) -> Effect:
    return piece.origin or piece.effect


def unchanged(joint: Fit) -> Fit:
    """The fit of the rig as it is: nothing added, nothing changed."""
    kept = joint.state.without(*(i for i, piece in enumerate(joint.state.pieces) if piece.added))
    return fit(joint.target, kept.held({*range(len(kept.pieces)), OFFSET}))


def _held(joint: Fit, changed: dict[int, float], offset_changed: bool) -> State:
    """The state with what did not change at the rig's own values, and not free."""
    own = {i for i, piece in enumerate(joint.state.pieces) if not piece.added}
    return joint.state.held(own - changed.keys() | (set() if offset_changed else {OFFSET}))


def standard_errors(
    joint: Fit, number: int, final: Fit | None = None, wrong: Sequence[Misread] = ()
) -> dict[str, float]:
    """Standard errors of the free keys of a piece, from the covariance of the joint fit; lists: `key[order]`.

    final: the fit with what did not change held, by which corrections of the data are told, and other forms of the
    piece that do as well. wrong: what may be read wrong, of which nobody knows whether it is: the coordinates would be
    others then.
    """
    piece, place = joint.state.pieces[number], joint.state.slices()[number]
    covariance = discrepancy.covariance(joint)[place, place]
    if final is not None and final.state.pieces[number].coordinates() == piece.coordinates():
        own = final.state.slices()[number]
        covariance = covariance + covariance_of_corrections(final)[own, own]
        # what the data want changed and is held, since it leaves structure, may be what moved all the same
        kept = is_lacking(final.target, final.residual)
        own_orders = np.isin(final.target.data.orders, piece.effect.touched_orders())
        held = [joint] if (kept & own_orders).any() else []
        for fitted in (*held, *(one.best for one in wrong), *in_forms_as_good(final, number)):
            other = fitted.state.pieces[number]
            if other.coordinates() == piece.coordinates():
                moved = other.vector() - final.state.pieces[number].vector()
                covariance = covariance + np.outer(moved, moved)
    coordinates, vector = piece.coordinates(), piece.vector()
    found: dict[str, float] = {}
    listed = piece.effect.orders_key == "orders"
    for i, c in enumerate(coordinates):
        suffix = f"[{piece.effect.orders[c.place]}]" if listed and c.part else ""
        spread = float(np.sqrt(max(float(covariance[i, i]), 0.0)))
        if c.part == 0:
            found[c.key] = spread / vector[i] ** 2 if _is_inverse(c) else spread
        elif c.part == 1:
            re, im = float(vector[i]), float(vector[i + 1])
            size = max(float(np.hypot(re, im)), 1e-300)
            along, across = np.array([re, im]) / size, np.array([-im, re]) / size
            block = covariance[i : i + 2, i : i + 2]
            found[c.key + suffix] = float(np.sqrt(max(float(along @ block @ along), 0.0)))
            found[c.phase_key + suffix] = float(np.sqrt(max(float(across @ block @ across), 0.0)) / size)
    return found


def _is_inverse(c: Coordinate) -> bool:
    return c.form.value == "inverse"


def _share(rig: RigModel, final: Fit, piece: Piece) -> float:
    """Share of the whole gap (power, noise and all else included) that lies along what a piece contributes.

    Shares of pieces that cancel each other do not add up to more than there is.
    """
    good, parts = final.target.good, final.target.data.parts
    gap, own = final.target.residual(rig)[good], final.explained(piece.effect)[good]
    along = float(((gap * own.conj()).real / parts).sum())
    return float(np.clip(along / max(float((np.abs(gap) ** 2 / parts).sum()), 1e-300), 0.0, 1.0))


def _own_gap(rig: RigModel, final: Fit, piece: Piece) -> tuple[float, float]:
    """RMS of what the old and the new rig leave at the orders of a piece; at all where the data are over the angle."""
    data, good = final.target.data, final.target.good
    own = np.isin(data.orders, piece.effect.touched_orders())
    columns = own if data.angle_rad is None and own.any() else np.ones_like(own)
    before, after = (
        rms_deg(residual[good][:, columns], data.orders[columns])
        for residual in (final.target.residual(rig), final.residual)
    )
    return before, after


def doubted(
    found: Conclusions,
    left: Collection[int],
    beside: Collection[int],
    made: Collection[int] = (),
    *,
    in_samples: bool = False,
) -> Conclusions:
    """Conclusions whose names have the alternative `something_else` where what stays unexplained says so.

    left: orders that stay unexplained: what is there may have changed a parameter of the rig on them as well, and on
    the other side of a mesh order; beside: those of them that lie one beside the rig's orders, as where an angle is
    read wrong: what does that changes the orders between them, too; made: the rig's orders. Many others that are left,
    as a step at one angle makes them, or what dies away behind the start of a curve, reach all up to twice the highest,
    and the mean. In samples over time all that moves the mean slowly, as a step or a drift, moves what is
    found of the mean as well.
    """
    foreign = sorted(order for order in {*left, *_of_what_is_many(found)} if order > 0 and order not in made)
    is_broad = len(foreign) >= SETTINGS.shared_orders
    broad = set(range(2 * foreign[-1] + 1)) if is_broad else set()
    near = {order + off for order in beside for off in (-1, 1)}
    # what reaches all orders around one, as an effect of one angle does, reaches it as well
    reached = {k for k in range(max(left, default=0)) if {k - 1 if k else 2, k + 1} <= set(left)}
    # and so does what three in a row have in common, as an error of pitch that adds up, to the two beside them
    rows = [k for k in left if {k + 1, k + 2} <= set(left)]
    reached |= {beyond for k in rows for beyond in (k - 2, k - 1, k + 3, k + 4) if beyond > 0}

    slow = {0} & set(left) if in_samples else set()
    # what changed in one direction alone is half of what turns with it, and half of what does not
    halves = _ONE_SIDED if found.names >= _ONE_SIDED else frozenset()

    def is_open(effect: Effect, orders: Collection[int]) -> bool:
        its = set(effect.touched_orders())
        if effect.stage is Stage.MEASURING:  # it turns all orders, those that stay unexplained among them
            its |= set(left) - {0}
        return effect.name in halves or bool(its & set(orders))

    claims = [
        claim.in_doubt()
        if (is_open(claim.piece.effect, near | slow) or (is_broad and claim.piece.effect.least_foreign))
        and (claim.counted or slow)
        else claim
        for claim in found.claims
    ]
    retuned = [
        replace(
            one,
            is_open=one.is_open or is_open(one.after, near | reached | broad | set(left) | _mirrored(one.after, left)),
        )
        for one in found.retuned
    ]
    unsure = {one.after.name for one in retuned if SOMETHING_ELSE in one.alternatives}
    unsure |= {claim.piece.effect.name for claim in claims if SOMETHING_ELSE in claim.alternatives}
    if "backlash" in unsure:
        # above the load that takes play up it is dry friction's twin: what is no play is no such friction either
        claims = [claim.in_doubt() if claim.piece.effect.name == "friction_windup" else claim for claim in claims]
        retuned = [replace(one, is_open=one.is_open or one.after.name == "friction_windup") for one in retuned]
    return replace(found, claims=tuple(claims), retuned=tuple(retuned), offset_is_open=is_broad or bool(slow))


def _mirrored(effect: Effect, left: Collection[int]) -> set[int]:
    """The sidebands on the other side of the mesh order beside each: what changes a mesh makes both."""
    mesh, reach = effect.constants.mesh_orders(), effect.constants.cranks
    return {2 * order - k for k in left for order in mesh if abs(order - k) <= reach}


def _of_what_is_many(found: Conclusions) -> set[int]:
    """The orders of claims that may be what happens where curves begin."""
    return {
        order
        for claim in found.claims
        if may_be_a_start(found.final, claim.piece.effect)
        for order in claim.piece.effect.touched_orders()
    }


def _as_good(smaller: Fit, joint: Fit, number: int, known: Catalogue) -> tuple[Other, ...]:
    """Other effects that explain what this one does about as well."""
    piece = joint.state.pieces[number]
    own = set(piece.effect.touched_orders())
    # one order more or less is no resonance; it stands against other effects on many orders only
    stages = STAGES if len(own) > 2 else tuple(stage for stage in STAGES if stage is not Stage.STRUCTURE)
    finder = Search(known, smaller, stages=stages, touching=sorted(own))
    best: dict[str, Candidate] = {}
    ranked = finder.ranked(least=20.0)
    # gains are those of a linear step at the weights of the smaller fit: compared with the largest of their kind
    clear = 0.3 * min(smaller.loss - joint.loss, max((c.gain for c in ranked), default=0.0))
    for c in ranked:
        touched = set(c.piece.effect.touched_orders())
        if c.name == piece.effect.name or not touched & own or c.name in best:
            continue
        if c.gain > clear:
            best[c.name] = c
    found = []
    data = joint.target.data
    # samples over time are one column, of all orders together
    places = np.flatnonzero(np.isin(data.orders, sorted(own)) | (data.angle_rad is not None))
    for c in list(best.values())[: SETTINGS.other_names]:
        fitted = fit(joint.target, c.put_into(smaller.state), steps=8, tolerance=0.1)
        extra = len(c.coordinates()) - len(piece.coordinates())
        # what it gains on other orders does not make it a name for this one's
        worse = joint.target.losses(fitted.residual)[:, places] - joint.target.losses(joint.residual)[:, places]
        if max(fitted.loss - joint.loss, float(worse.sum())) + 2.0 * max(extra, 0) < SETTINGS.as_good:
            found.append(Other(c.name, fitted.state.model()))
    return tuple(found)


def _extrapolates(joint: Fit, piece: Piece) -> tuple[str, ...]:
    """Remarks where a parameter lies at a bound or outside of what was measured."""
    remarks = []
    at = joint.target.data.at
    fixed = {scalar.key for scalar in piece.effect.scalars if scalar.form is Form.FIXED}
    remarks += [
        f"{key} is held at {value:g}: the data do not tell it, or put it at its bound"
        for key, value in piece.effect.values.items()
        if key not in piece.free | fixed | {"order", "orders"}
    ]
    seating = piece.effect.values.get("seating_torque_Nm")
    if isinstance(seating, float) and np.sum(np.unique(np.abs(at.torque_Nm)) < 2 * seating) < 2:
        remarks.append("too few torques near the seating torque: it is an extrapolation")
    remarks += [
        f"what it does between {low:g} and {high:g} degC is not known: no temperature between them was measured"
        for low, high in unmeasured_states(at, [piece.effect])
    ]
    if "frequency_Hz" in piece.effect.values:
        turn = at.speed_rpm / (60 * piece.effect.constants.reduction_ratio)
        lowest, highest = frequencies_in(piece.effect, at)
        outside = [k for k in piece.effect.orders if not (k * turn.min() < highest and lowest < k * turn.max())]
        if outside:
            remarks.append(f"orders {', '.join(map(str, outside))} do not reach the frequency in the measured speeds")
    return tuple(remarks)
