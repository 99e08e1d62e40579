"""Other explanations of the same data than the one that reconcile gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.parameters import Piece
from st_codegen.reconcile.judge.candidates import Search
from st_codegen.reconcile.run import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Effect
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Rival:
    """Another explanation of the data than `one`: its rig, and the odds (logarithm) still wanted to tell them apart."""

    one: str
    other: str
    rig: RigModel
    wanted: float


def other_models(result: Reconciliation, known: Catalogue) -> list[Rival]:
    """Other explanations of the same data.

    Names that are as good, effects in place of a changed parameter, and refused effects on unexplained orders.
    """
    final, claims = result.conclusions.final, result.conclusions.claims
    found = [Rival(e.name, e.other, e.rival, SETTINGS.told_apart) for claim in claims for e in claim.experiments]
    for entry in result.conclusions.retuned[: SETTINGS.most_rivals]:
        found += _instead_of(final, entry.after, entry.before, known)
    return [*found, *_refused(result)]


def _instead_of(final: Fit, after: Effect, before: Effect, known: Catalogue) -> Iterator[Rival]:
    """Missing effects that explain about what a changed parameter of the rig does."""
    number = next((i for i, piece in enumerate(final.state.pieces) if piece.effect is after), None)
    if number is None:
        return
    held = fit(final.target, final.state.replaced(number, Piece(before, frozenset(), False, before)))
    seen: set[str] = set()
    for c in Search(known, held, touching=after.touched_orders()).ranked(least=SETTINGS.as_good):
        if c.name == after.name or c.name in seen or len(seen) == SETTINGS.most_rivals:
            continue
        seen.add(c.name)
        other = fit(final.target, c.put_into(held.state), steps=SETTINGS.quick_steps)
        wanted = SETTINGS.told_apart - 0.5 * (other.loss - final.loss)
        if wanted > 0:
            yield Rival(f"changed {after.name}", c.name, other.state.model(), min(wanted, SETTINGS.told_apart))


def _refused(result: Reconciliation) -> Iterator[Rival]:
    """Effects that were refused although they gain on orders that are still unexplained."""
    final = result.conclusions.final
    open_orders = {signature.order for signature in result.unexplained}
    taken = {(piece.effect.name, piece.effect.orders) for piece in final.state.pieces}
    for candidate, _ in sorted(result.judged, key=lambda pair: -pair[1].loss_saved):
        effect = candidate.piece.effect
        kind = (effect.name, effect.orders)
        if candidate.number is None and kind not in taken and open_orders & set(effect.touched_orders()):
            taken.add(kind)
            other = fit(final.target, candidate.put_into(final.state), steps=SETTINGS.quick_steps)
            yield Rival("nothing", f"{effect.name} (refused so far)", other.state.model(), SETTINGS.told_apart)
        if len(taken) == len(final.state.pieces) + SETTINGS.most_rivals:
            return
