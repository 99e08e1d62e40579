"""Other explanations of the same data than the one that reconcile gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from st_codegen.reconcile.fit.fitting import fit
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Rival:
    """Another explanation of the data than `one`: its rig, and the odds (logarithm) still wanted to tell them apart."""

    one: str
    other: str
    rig: RigModel
    wanted: float


def other_models(result: Reconciliation) -> list[Rival]:
    """Other explanations of the same data.

    Names that are as good, also in place of a changed parameter, and refused effects on unexplained orders.
    """
    found = result.conclusions
    pairs = [(one.piece.effect.name, other) for one in found.claims for other in one.others]
    pairs += [(f"changed {one.after.name}", other) for one in found.retuned for other in one.others]
    as_good = [Rival(name, other.name, other.rig, SETTINGS.told_apart) for name, other in pairs]
    return [*as_good, *_refused(result)]


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
            yield Rival(
                "what was found",
                f"{effect.name} as well, which the data refused so far",
                other.state.model(),
                SETTINGS.told_apart,
            )
        if len(taken) == len(final.state.pieces) + SETTINGS.most_rivals:
            return
