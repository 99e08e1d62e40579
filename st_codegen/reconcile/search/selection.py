"""Greedy search: add what explains most, stop when nothing passes; what was refused for its size alone has no name."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from st_codegen.errors import counted
from st_codegen.ir.arrays import ComplexArray
from st_codegen.processes import Progress
from st_codegen.reconcile.data.noise import Noise, estimate
from st_codegen.reconcile.fit.fitting import Fit, fit, fits
from st_codegen.reconcile.fit.state import State
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.structure import is_lacking
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.search.candidates import Candidate, Search
from st_codegen.reconcile.search.evidence import Evidence, judge
from st_codegen.reconcile.search.peaks import has_a_frequency, load_keys
from st_codegen.reconcile.search.plausible import (
    are_two,
    at_nobodys_expense,
    at_two_frequencies,
    beats_waves,
    inside_bounds,
    is_no_form_error,
    is_one_that_stays,
    law_holds,
    two_that_stay,
)
from st_codegen.reconcile.search.states import in_their_forms
from st_codegen.reconcile.search.surroundings import is_of_its_place, stands_out
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Effect


def search(
    target: FitData, state: State, known: Catalogue, progress: Progress | None = None
) -> tuple[Fit, list[tuple[Candidate, Evidence]]]:
    """Add effects until nothing passes. Returns the last fit, and everything that was judged, in order."""
    target = target.as_quiet_as_others()
    current = fit(target, state)
    current = fit(target.about(current.residual), current.state, steps=SETTINGS.long_steps)
    judged: list[tuple[Candidate, Evidence]] = []
    refused: dict[object, float] = {}
    softly: dict[object, float] = {}
    formed: dict[object, float] = {}
    has_merged = False
    for number in range(SETTINGS.most_effects):
        if progress is not None:
            progress(number, SETTINGS.most_effects, counted(len(current.state.pieces), "effect"))
        found = _next(current, current, known, refused, judged)
        if found is None and is_lacking(target, current.residual).any():
            found = _next(current, current, known, formed, judged, formed=True)
            found = found or _next(_softer(current), current, known, softly, judged) or _moved(current, known, judged)
        if found is None and not has_merged:
            # once: what stands in place of two may be found beside another one again
            found = _one_in_place_of_two(current, known, judged)
            has_merged = found is not None
        if found is None:
            found = _with_two_in_place_of_one(current, judged)
        if found is None:
            break
        current = in_their_forms(found)
        # on coarse grids a missing effect passes for noise until it is named
        target = with_noise_of(current)[0].as_quiet_as_others()
        current = fit(target.about(current.residual), current.state, steps=SETTINGS.long_steps)
    return current, judged


def _softer(current: Fit) -> Fit:
    """The fit with no order weighed more sharply than by a part of what the loudest one keeps.

    What touches many orders at once starts with a shape that is not quite right: in clean data the quiet orders would
    refuse that, however much of the loud ones it explains.
    """
    target, good = current.target, current.target.good
    loudest = float(np.sqrt((np.abs(current.residual[good]) ** 2).mean(axis=0)).max(initial=0.0))
    return fit(replace(target, wide=np.maximum(target.spread, SETTINGS.form * loudest)), current.state)


def _moved(current: Fit, known: Catalogue, judged: list[tuple[Candidate, Evidence]]) -> Fit | None:
    """The fit with a resonance that moves by more than its width, where nothing simpler is left, or None.

    One that does not move, or two, may have been found at the levels where most of its peaks are: it stands in place
    of these where it explains more.
    """
    added = [i for i, piece in enumerate(current.state.pieces) if piece.added and has_a_frequency(piece.effect)]
    found = _next(current, current, known, dict[object, float](), judged, moved=True)
    for gone in ([[i] for i in added] + [added] * (len(added) > 1)) if found is None else ():
        without = fit(current.target, current.state.without(*gone), steps=SETTINGS.quick_steps)
        one = _next(without, without, known, dict[object, float](), judged, moved=True)
        if one is not None and one.loss < current.loss - SETTINGS.order_gain:
            return one
    return found


def _one_in_place_of_two(current: Fit, known: Catalogue, judged: list[tuple[Candidate, Evidence]]) -> Fit | None:
    """The fit with one resonance that moves where two whose heights follow the load do no better, or None.

    Of two loads each may have a resonance of its own, which is gone at the other one.
    """
    penalty = Search(known, current).penalty
    added = [(i, piece.effect) for i, piece in enumerate(current.state.pieces) if piece.added]
    follow = [i for i, effect in added if load_keys(type(effect)) & effect.values.keys()]
    for two in itertools.combinations(follow, 2):
        without = fit(current.target, current.state.without(*two), steps=SETTINGS.quick_steps)
        one = _next(without, without, known, dict[object, float](), judged, moved=True)
        if one is not None and one.loss - current.loss < penalty * (len(current.prior) - len(one.prior)):
            return one
    return None


def _two_in_place_of_one(without: Fit, one: Fit, number: int, judged: list[tuple[Candidate, Evidence]]) -> Fit | None:
    """The fit with two resonances beside each other in place of the one of a number that stays, or None.

    Where one leaves much of its orders, two are tried: both against the fit without any, the second against the one.
    """
    effect = one.state.pieces[number].effect
    if not is_one_that_stays(effect) or not _lack(one, effect):
        return None
    two: Fit | None = two_that_stay(one, number)
    for place in (number, len(one.state.pieces)):
        two = two and inside_bounds(two, place)
    if two is None or not are_two(one, two, number, len(one.state.pieces)):
        return None
    candidate = Candidate(two.state.pieces[-1])
    second = candidate.places(two.state)
    first = two.state.slices()[number]
    both = judge(without, two, [*range(first.start, first.stop), *second], number)
    evidence, stands = founded(one, two, candidate.place(two.state), second)
    judged.append((candidate, evidence))
    return two if stands and both.passed else None


def _with_two_in_place_of_one(current: Fit, judged: list[tuple[Candidate, Evidence]]) -> Fit | None:
    """The fit with two resonances in place of the first added one that is two, or None."""
    for number, piece in enumerate(current.state.pieces):
        if piece.added and is_one_that_stays(piece.effect) and _lack(current, piece.effect):
            without = fit(current.target, current.state.without(number), steps=SETTINGS.quick_steps)
            if (two := _two_in_place_of_one(without, current, number, judged)) is not None:
                return two
    return None


def _lack(current: Fit, effect: Effect) -> bool:
    """Whether orders of an effect keep more than noise."""
    lacking = is_lacking(current.target, current.residual)
    return bool(np.isin(current.target.data.orders[lacking], effect.orders).any())


def _next(
    seen: Fit,
    current: Fit,
    known: Catalogue,
    refused: dict[object, float],
    judged: list[tuple[Candidate, Evidence]],
    *,
    moved: bool = False,
    formed: bool = False,
) -> Fit | None:
    """The fit with one more effect, or None; seen: the fit by whose weights candidates are found and tried."""
    finder = Search(known, seen, moved=moved, formed=formed)
    ranked = [c for c in finder.ranked() if finder.net(c) > 0 and finder.is_told(c)]
    for _ in range(SETTINGS.rounds):
        ranked = [c for c in ranked if not _failed_before(c, refused)]
        if not ranked:
            break
        found = _first_that_passes(seen, current, finder, ranked, refused, judged)
        if found is not None:
            return found
    return None


def _failed_before(candidate: Candidate, refused: dict[object, float]) -> bool:
    """Whether a candidate was refused when it gained about as much: beside a missing effect it may have gained less."""
    then = refused.get(candidate.identity)
    return then is not None and 1 / SETTINGS.changed_gain < candidate.gain / then < SETTINGS.changed_gain


def _first_that_passes(
    seen: Fit,
    current: Fit,
    finder: Search,
    ranked: list[Candidate],
    refused: dict[object, float],
    judged: list[tuple[Candidate, Evidence]],
) -> Fit | None:
    # a clear first needs no comparison with others
    likely = [c for c in ranked[: SETTINGS.tries] if finder.net(c) > SETTINGS.clear * finder.net(ranked[0])]
    steps, tolerance = SETTINGS.quick_steps, SETTINGS.quick_tolerance
    states = [c.put_into(seen.state) for c in likely]
    tried = list(zip(fits(seen.target, states, steps=steps, tolerance=tolerance), likely, strict=True))
    # weighed by how far coefficients scatter about the model as it is, a poor candidate loses little to a good one:
    # they are compared by how far they scatter about the best
    spreads = [seen.target.about(fitted.residual).spread for fitted, _ in tried]
    sharp = replace(seen.target, wide=np.min(spreads, axis=0)) if spreads else seen.target
    tried.sort(
        key=lambda pair: float(sharp.losses(pair[0].residual).sum()) + finder.penalty * len(pair[1].coordinates())
    )
    for fitted, raw in tried:
        refused[raw.identity] = raw.gain
        without = current
        if raw.piece.effect.least_foreign:
            # what its form lacks is of one angle as well, and of one size in all orders: weighed by what each keeps
            # without it, the many quiet orders would bend it
            without = fit(current.target.about(fitted.residual), current.state, steps=SETTINGS.long_steps)
        # what is judged has reached where it goes
        reached = fit(without.target, fitted.state, steps=SETTINGS.long_steps, tolerance=tolerance)
        number = raw.place(reached.state)
        reached = _of_one_height(reached, number, finder.penalty)
        inside = inside_bounds(reached, number)
        if inside is None:
            continue
        candidate = replace(raw, piece=inside.state.pieces[number])
        places = candidate.places(inside.state)
        if not places:
            continue
        evidence, stands = founded(without, inside, number, places)
        judged.append((candidate, evidence))
        if stands:
            del refused[raw.identity]
            return inside
        # what is none by itself may be two
        if raw.number is None and (two := _two_in_place_of_one(without, inside, number, judged)) is not None:
            return two
    return None


def _of_one_height(fitted: Fit, number: int, penalty: float) -> Fit:
    """The fit with a resonance of one height at all loads, where parts that follow the load take little off.

    penalty: what a number must save. What one height leaves beyond the noise must be down to a part as well: of a form
    that is not quite the machine's, all that is free takes some.
    """
    piece = fitted.state.pieces[number]
    idle = load_keys(type(piece.effect)) & piece.effect.values.keys()
    if not piece.added or not idle:
        return fitted
    found = fit(fitted.target, fitted.state.replaced(number, piece.without(idle)), steps=SETTINGS.long_steps)
    target, fewer = fitted.target, len(fitted.prior) - len(found.prior)
    counted = target.counts & np.isin(target.data.orders, piece.effect.orders)
    noise = 2.0 * SETTINGS.tails * float((target.sigma**2)[counted].sum())
    left, follows = (max(float((np.abs(one.residual[counted]) ** 2).sum()) - noise, 0.0) for one in (found, fitted))
    worth_it = found.loss - fitted.loss > penalty * fewer and follows < SETTINGS.left_of_height * left
    return fitted if worth_it else found


def founded(without: Fit, with_it: Fit, number: int, places: list[int]) -> tuple[Evidence, bool]:
    """Evidence of piece `number` of a fit (its coordinates `places`) against the fit without, and whether it stands."""
    evidence = judge(without, with_it, places, number)
    return evidence, evidence.passed and is_sound(without, with_it, number)


def is_sound(without: Fit, with_it: Fit, number: int) -> bool:
    """Whether piece `number` of a fit is of its form, at nobody's expense, and more than what lies around it."""
    # a part that grows on an effect is no other effect
    grown = len(without.state.pieces) == len(with_it.state.pieces)
    sound = at_two_frequencies(without, with_it, number) and at_nobodys_expense(without, with_it, number)
    sound = sound and (grown or is_no_form_error(without, with_it, number))
    if sound and with_it.state.pieces[number].effect.least_foreign:
        sound = is_of_its_place(with_it, number)
    elif sound:
        sound = stands_out(with_it, added(without, with_it, number))
    return sound and law_holds(without, with_it, number)


def added(without: Fit, with_it: Fit, number: int) -> ComplexArray:
    """What piece `number` of a fit contributes, (n, K); by how much it contributes more where it only grew."""
    own = with_it.explained(with_it.state.pieces[number].effect)
    is_new = len(with_it.state.pieces) > len(without.state.pieces)
    return own if is_new else own - with_it.explained(without.state.pieces[number].effect)


def with_noise_of(current: Fit) -> tuple[FitData, Noise]:
    """The target with the noise estimated from what the present fit leaves."""
    noise = estimate(current.target.data, current.residual)
    target = replace(current.target, sigma=noise.sigma, good=noise.good)
    return target.about(current.residual), noise


def faint(final: Fit, judged: Sequence[tuple[Candidate, Evidence]]) -> list[Signature]:
    """The clearest of the refused candidates that only their size spoke against, and still does; one at most.

    Where nothing else is unexplained, what is left would be called noise, and has a pattern that noise has by chance no
    more often than a name may be wrong. It must do clearly better than constant waves of its orders: noise that lasts
    over runs has a mean of its own. Samples over time have no runs to tell that by.
    """
    if final.target.data.angle_rad is not None:
        return []
    own = sum(not piece.added for piece in final.state.pieces)
    likely: dict[object, tuple[float, Candidate]] = {}
    for candidate, evidence in judged:
        known = likely.get(candidate.name, (0.0, candidate))
        if evidence.passed_but_for_size and (candidate.number is None or candidate.number < own):
            likely[candidate.name] = max((evidence.loss_saved, candidate), known, key=lambda entry: entry[0])
    for _, candidate in sorted(likely.values(), key=lambda entry: -entry[0])[: SETTINGS.tries]:
        with_it = fit(final.target, candidate.put_into(final.state), steps=SETTINGS.quick_steps)
        number = candidate.place(with_it.state)
        evidence = judge(final, with_it, candidate.places(with_it.state), number)
        touched = np.abs(added(final, with_it, number)).max(axis=0) > 0.0
        varies = beats_waves(final, with_it, touched, np.ones((len(final.target.data), 1)))
        if evidence.passed_but_for_size and varies and is_sound(final, with_it, number):
            return [_signature(final, with_it, number, evidence)]
    return []


def _signature(final: Fit, with_it: Fit, number: int, evidence: Evidence) -> Signature:
    piece, orders = with_it.state.pieces[number], final.target.data.orders
    more = added(final, with_it, number)[final.target.good]
    powers = (np.abs(more) ** 2).mean(axis=0) / final.target.data.parts
    told = np.flatnonzero(powers > SETTINGS.part_of_change * powers.max(initial=0.0))
    order = int(orders[told[0]]) if len(told) == 1 else -1
    size, effect = float(np.sqrt(powers.sum())), piece.effect
    what = f"order {order}" if order > 0 else "several orders" if order else "the mean"
    text = (
        f"{what}: {size:.2g} deg RMS that {effect.title} would explain, "
        f"{evidence.size_in_noise:.2g} times the noise of a run; noise that lasts over runs may look like it"
    )
    # RMS over the angle: of a wave half the square of its amplitude
    largest = size * (np.sqrt(2) if order > 0 else 1.0)
    return Signature(
        order, size, size**2, {"combination": 1.0}, "both", text, largest, at_least=True, would_be=effect.name
    )
