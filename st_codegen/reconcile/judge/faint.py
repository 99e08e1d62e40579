"""What passes every test of an effect but that of its size: it has no name, and is no noise either."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.evidence import Evidence, judge
from st_codegen.reconcile.search.plausible import beats_waves
from st_codegen.reconcile.search.selection import added, is_sound
from st_codegen.reconcile.settings import SETTINGS


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
