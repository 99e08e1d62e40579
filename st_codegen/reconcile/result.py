"""What `reconcile` found: the data, the fits, what is said of them, and the gaps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from st_codegen.reconcile.data.noise import Noise
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.judge.claims import Conclusions
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.outcome import Gap, Outcome
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class OrderGap:
    """RMS in deg between model and measurement of one order; held_out: after, on conditions that the fit left out."""

    order: int
    before: float
    after: float
    noise_floor: float
    held_out: float


@dataclass(frozen=True)
class TakenBack:
    """Effects that explained the runs that were fitted and predicted others worse: gap (deg) before and with them."""

    names: tuple[str, ...]
    before: float
    after: float


@dataclass(frozen=True)
class Reconciliation:
    """What `reconcile` found, with the data and the fits that it comes from.

    unseen_curves: from how many that no search saw the held-out gap comes (0: none); between_deg: RMS by which a
    resonance may be off at temperatures between two that were measured, in the held-out gap; carriers: how many curves
    that leave equally much would tell the held-out gap as well; testers: how many equal operating points would
    tell as well what the new rig takes off the held-out runs.
    """

    rig: RigModel
    new_rig: RigModel
    data: Observations
    target: FitData
    noise: Noise
    conclusions: Conclusions
    judged: tuple[tuple[Candidate, Evidence], ...]
    unexplained: tuple[Signature, ...]
    fitted: Gap
    held_out: Gap
    orders: tuple[OrderGap, ...]
    mistakes: tuple[Mistake, ...] = ()
    cannot_show: tuple[str, ...] = ()
    unseen_curves: int = 0
    taken_back: TakenBack | None = None
    between_deg: float = 0.0
    carriers: float = math.inf
    testers: float = math.inf
    untested: tuple[str, ...] = ()

    @property
    def held_out_is_bound(self) -> bool:
        """Whether the held-out gap may be larger: few runs say too little, or at other speeds a hum meets other orders.

        Where few of many curves carry it, there may be more such places between them; where the levels of a condition
        are too few to leave one out, nothing was predicted between them; where one point meets what was added, little
        tests it.
        """
        few = self.data.few_points or (self.held_out_scatters and self.few_carry)
        return few or self.few_test or bool(self.untested) or any(one.frequency_Hz for one in self.data.hums)

    @property
    def few_carry(self) -> bool:
        """Whether fewer of the curves that tell the held-out gap carry it than do so by chance where all are alike."""
        return not self.carriers > self.unseen_curves / SETTINGS.carried_by_one_in > 0

    @property
    def few_test(self) -> bool:
        """Whether what the new rig takes off lies at fewer than two held-out points, as it were: one has no spread."""
        return self.testers < SETTINGS.least_testers

    @property
    def held_out_scatters(self) -> bool:
        """Whether so few curves tell the held-out gap that others may well have another, larger or smaller."""
        return self.carriers < SETTINGS.least_curves

    @property
    def suspects(self) -> list[tuple[int, float]]:
        """Rows that lie far from what is expected, and how far, but for those of which a mistake says what is wrong."""
        known = {row for mistake in self.mistakes for row in mistake.rows}
        return [(row, times) for row, times in self.noise.suspects if row not in known]

    @property
    def verdict(self) -> Outcome:
        """Whether what differs is named, and whether more than noise is left."""
        named = bool(self.conclusions.claims or self.conclusions.retuned or self.conclusions.offset_changed)
        found = Outcome.of(named=named, is_more_left=bool(self.unexplained) or self._is_more_than_noise)
        # what a few runs leave may be noise, or what their model lacks between them
        few = found is Outcome.EXPLAINED and self.data.few_points
        return Outcome.PARTLY_EXPLAINED if few else found

    @property
    def _is_more_than_noise(self) -> bool:
        """Whether more than noise is left: few runs, or samples over time, can leave that without a pattern."""
        return self.fitted.after > SETTINGS.clearly_larger * self.fitted.noise_floor

    @property
    def floor_is_bound(self) -> bool:
        """Whether the noise floor may be smaller.

        What runs differ by from others holds what is unexplained, or varies between few runs, as well as the noise.
        """
        return bool(self.unexplained) or self.data.few_points or self._is_more_than_noise

    @property
    def scatter_beside_floor_deg(self) -> float:
        """RMS of what differs from run to run by more than the floor, without a pattern over the conditions.

        Of the mean and the lowest orders the floor holds it.
        """
        return self._scatter(lambda order: order > SETTINGS.wander_orders)

    @property
    def scatter_in_floor_deg(self) -> float:
        """RMS of what differs from run to run without a pattern over the conditions and is a part of the floor."""
        return self._scatter(lambda order: order <= SETTINGS.wander_orders)

    def _scatter(self, chosen: Callable[[int], bool]) -> float:
        """RMS over the chosen orders, less what a hum that was taken out of the curves has in them."""
        hums = [hum.by_order for hum in self.data.hums]
        left = [one for one in self.unexplained if one.is_scatter and chosen(one.order)]
        of_hums = (sum(float(made[one.order]) ** 2 for made in hums) for one in left)
        return math.sqrt(sum(max(one.rms_deg**2 - hum, 0.0) for one, hum in zip(left, of_hums, strict=True)))
