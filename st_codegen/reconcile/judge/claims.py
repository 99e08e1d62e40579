"""What is said of a fit: effects that are missing, effects of the rig that changed, and what else may be the cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.state import OFFSET, Piece
from st_codegen.reconcile.judge.misread import Misread
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect
from st_codegen.rig.model import RigModel

#: the alternative to a name that only an order, or few runs, give
SOMETHING_ELSE = "something_else"
#: remark on a resonance of which no run met the peak.
ONLY_FLANKS = "no run lies inside its peak: its height and width are what its flanks say of one oscillator"


@dataclass(frozen=True)
class Other:
    """Another name that explains the data as well, and the rig that it gives."""

    name: str
    rig: RigModel


@dataclass(frozen=True)
class Claim:
    """An effect that is missing in the rig: its piece, evidence, and equally good names.

    share: of the gap (power) that the effect explains; peaks: the frequencies (Hz) between which the peaks of a
    resonance's orders put it, where their shape is not that of one oscillator; counted: how many names of this kind
    were true, of how many, if that is known; doubt: why something else may have it, where that is not in the effect.
    """

    piece: Piece
    stderr: dict[str, float]
    evidence: Evidence
    alternatives: tuple[str, ...]
    others: tuple[Other, ...]
    share: float
    extrapolates: tuple[str, ...]
    peaks: tuple[float, float] | None = None
    counted: tuple[int, int] | None = None
    doubt: str = ""

    @property
    def probability(self) -> float | None:
        """Chance that the name is true, by how many of its kind were (rule of succession); None where none is known."""
        return None if self.counted is None else (self.counted[0] + 1) / (self.counted[1] + 2)

    def in_doubt(self, why: str) -> Claim:
        """The claim with `something_else` among its alternatives, and why, in words."""
        if SOMETHING_ELSE in self.alternatives:
            return self
        counted = self.counted and SETTINGS.names_by_order
        return replace(self, alternatives=(*self.alternatives, SOMETHING_ELSE), counted=counted, doubt=why)


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


ONE_SIDED = frozenset({"torsional_compliance", "hanging_load_compliance"})


@dataclass(frozen=True)
class Conclusions:
    """What is claimed, and the fit behind it (all parameters free: `joint`; unchanged ones held: `final`).

    misread: what may be read wrong in place of changes of the rig; for_offset: what would do in place of another zero;
    offset_is_open: what is unexplained reaches it too.
    """

    joint: Fit
    final: Fit
    claims: tuple[Claim, ...]
    retuned: tuple[Retuned, ...]
    offset_changed: bool
    misread: tuple[Misread, ...] = ()
    for_offset: tuple[Other, ...] = ()
    offset_is_open: bool = False

    def adds_for(self, one: Misread) -> bool:
        """Whether it is an effect that was added, not a change of the rig, that a reading would do in place of."""
        return any(i != OFFSET and self.final.state.pieces[i].added for i in one.instead_of)

    def changes_for(self, one: Misread) -> list[str]:
        """Names of what need not have changed, or be there, where something is read wrong, and how often each."""
        pieces = self.final.state.pieces
        names = Counter(pieces[i].effect.name for i in one.instead_of if i != OFFSET)
        several = [name if times == 1 else f"{times} of {name}" for name, times in sorted(names.items())]
        return [*several, *(["zero_offset_deg"] if OFFSET in one.instead_of else [])]

    def with_misread(self, more: Sequence[Misread]) -> Conclusions:
        """The conclusions with more readings, before the known ones, among the alternatives of what they replace."""
        pieces = self.final.state.pieces
        retuned = []
        for entry in self.retuned:
            names = {
                one.reading.name
                for one in more
                if any(i != OFFSET and pieces[i].own is entry.before for i in one.instead_of)
            }
            retuned.append(replace(entry, misread=tuple(sorted(names | {*entry.misread}))))
        return replace(self, misread=(*more, *self.misread), retuned=tuple(retuned))

    @property
    def of_offset(self) -> tuple[str, ...]:
        """Names of what would do in place of another zero offset; none where the zero is the rig's.

        Beside a change that turns with the direction it may be the other half of what changed in one direction alone.
        """
        if not self.offset_changed:
            return ()
        names = {one.reading.name for one in self.misread if OFFSET in one.instead_of}
        names |= {other.name for other in self.for_offset}
        return (*sorted(names), *((SOMETHING_ELSE,) if self.names & _TURNING or self.offset_is_open else ()))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that are missing or changed, as they are now."""
        claimed = (claim.piece.effect for claim in self.claims)
        return (*claimed, *(one.after for one in self.retuned if not one.is_gone))

    @property
    def told(self) -> list[tuple[Effect, dict[str, float]]]:
        """Every effect that is missing, changed or gone, with the standard errors of its parameters."""
        return [(c.piece.effect, c.stderr) for c in self.claims] + [(one.after, one.stderr) for one in self.retuned]

    @property
    def names(self) -> set[str]:
        """Names of the effects that are missing or changed."""
        return {effect.name for effect in self.effects}
