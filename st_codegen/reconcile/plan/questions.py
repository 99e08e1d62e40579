"""What data leave open, and what a run is expected to add to each question, in nats.

How large the parameters of what was found are: by how much the volume of their errors shrinks (D-optimal design). Which
of two explanations holds: the logarithm of the odds between them (T-optimal design). What a residual does between the
runs: what a Gaussian process that is known at its neighbours learns there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.contrasts import AXES, step_between
from st_codegen.reconcile.fit.fitting import Fit, fits
from st_codegen.reconcile.fit.propagation import Propagation
from st_codegen.reconcile.fit.state import Coordinate
from st_codegen.reconcile.fit.target import by_place
from st_codegen.reconcile.outcome import Outcome
from st_codegen.reconcile.plan.points import Rows, summed
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.search.candidates import Candidate
from st_codegen.reconcile.search.peaks import has_a_frequency
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Stage
from st_codegen.rig.model import RigModel

#: effect, its orders, key
Name = tuple[str, tuple[int, ...], str]


class Question(Protocol):
    """Something that runs not yet made could tell: how much each would, and what is left once one is taken."""

    def gains(self) -> FloatArray:
        """What each point would add beside those that were taken, (n,)."""

    def take(self, number: int) -> str:
        """Count a point among the runs; returns what it is for."""


class Parameters:
    """Parameters of what was found: the volume of their errors."""

    def __init__(self, final: Fit, rows: Rows, names: list[Name], free: list[int]) -> None:
        precision = final.normal.total()[0] + np.diag(final.prior)
        own = np.ix_(free, free)
        self.names = names
        size = np.sqrt(np.diag(precision)[free])
        self.precision = precision[own] / np.outer(size, size)
        self.first = np.linalg.inv(self.precision)
        self.added = _information(final, rows)[:, free][:, :, free] / np.outer(size, size)

    @classmethod
    def of(cls, final: Fit, rows: Rows) -> Parameters | None:
        """The question; None where no parameter is free."""
        names: list[Name] = [("zero_offset", (), "zero_offset_deg")]
        for piece in final.state.pieces:
            names += [(piece.effect.name, piece.effect.orders, _key(piece.effect, c)) for c in piece.coordinates()]
        free = [i for i in range(len(names)) if i or final.state.offset_free]
        return cls(final, rows, [names[i] for i in free], free) if free else None

    def gains(self) -> FloatArray:
        sizes: FloatArray = np.linalg.slogdet(self.precision + self.added)[1]
        return np.asarray(0.5 * (sizes - np.linalg.slogdet(self.precision)[1]))

    def take(self, number: int) -> str:
        before = np.diag(np.linalg.inv(self.precision))
        self.precision = self.precision + self.added[number]
        ratio = np.sqrt(np.diag(np.linalg.inv(self.precision)) / before)
        best = int(ratio.argmin())
        effect, orders, key = self.names[best]
        where = f" (order {', '.join(map(str, orders))})" if orders else ""
        falls = 100 * (1 - ratio[best])
        if falls < SETTINGS.least_fall:
            return "narrows what was found by little: each error is expected to fall by less than 1 %"
        return f"narrows {key} of {effect}{where}: its error is expected to fall by {falls:.0f} %"

    def ratios(self) -> dict[Name, float]:
        """By effect and key: the expected error with all runs taken, over that without."""
        ratio = np.sqrt(np.diag(np.linalg.inv(self.precision)) / np.diag(self.first))
        found: dict[Name, float] = {}
        for name, value in zip(self.names, ratio.tolist(), strict=True):
            found[name] = max(found.get(name, 0.0), value)
        return found


def _key(effect: Effect, c: Coordinate) -> str:
    """The key of a coordinate, with its order where the key is a list."""
    listed = effect.orders_key == "orders" and c.part
    return f"{c.key}[{effect.orders[c.place]}]" if listed else c.key


def _information(final: Fit, rows: Rows) -> FloatArray:
    """What each point tells of the coordinates of a fit: its part of the normal matrix, (n, p, p)."""
    propagation = Propagation(final.state.model(), rows.data)
    columns = [propagation.offset_column()]
    for piece in final.state.pieces:
        columns += propagation.columns(piece)
    found = np.zeros((len(rows.data) // 2, len(columns), len(columns)))
    for place, (index, values) in by_place(columns).items():
        block = values / rows.sigma[:, [place]]
        for part in [block.real] if rows.data.orders[place] == 0 else [block.real, block.imag]:
            found[:, index[:, None], index[None, :]] += summed(part[:, :, None] * part[:, None, :])
    return found


class Apart:
    """Two explanations: where they predict different things, until they are told apart."""

    def __init__(self, rival: Rival, odds: FloatArray) -> None:
        self.rival, self.odds, self.left = rival, odds, SETTINGS.told_apart

    def gains(self) -> FloatArray:
        return np.minimum(self.odds, self.left)

    def take(self, number: int) -> str:
        self.left = max(self.left - float(self.odds[number]), 0.0)
        noises = np.sqrt(2 * self.odds[number])
        return f"tells {self.rival.one} from {self.rival.other}: the predictions differ by {noises:.2g} noises"


def told_apart(final: Fit, rows: Rows, rivals: Sequence[Rival]) -> list[Question]:
    """Every rival as a question: what the present explanation and the rival predict at the points."""
    orders = rows.data.model_orders()
    own = final.state.model().coefficients(rows.data.at, orders)
    found: list[Question] = []
    for rival in rivals:
        difference = rival.rig.coefficients(rows.data.at, orders) - own
        # of the other orders each says the same, to within what a fit of all numbers moves them
        difference = rows.data.with_real_mean(np.where(np.isin(orders, rival.orders), difference, 0.0))
        found.append(Apart(rival, 0.5 * summed((np.abs(difference) / rows.sigma) ** 2).sum(axis=1)))
    return found


class Unknown:
    """A quantity that is known where runs are: a Gaussian process, as large near each point as `weight` says.

    weight: (n,), its power there over that of the noise; measured and points: places in correlation lengths.
    """

    def __init__(self, weight: FloatArray, measured: FloatArray, points: FloatArray, why: Sequence[str]) -> None:
        self.weight, self.points, self.why = weight, points, why
        # what each known place tells of each point beside the places before it: a row of the Cholesky factor each, so
        # that one more place is one more row
        factor = np.linalg.cholesky(_kernel(measured, measured) + SETTINGS.left_open * np.eye(len(measured)))
        self.told = solve_triangular(factor, _kernel(measured, points), lower=True, overwrite_b=True)

    def gains(self) -> FloatArray:
        told = np.einsum("mn,mn->n", self.told, self.told)
        return np.asarray(2 * np.log1p(self.weight * np.clip(1.0 - told, 0.0, 1.0)))

    def take(self, number: int) -> str:
        own = self.told[:, number]
        beside = _kernel(self.points[[number]], self.points) - own @ self.told
        self.told = np.concatenate([self.told, beside / np.sqrt(1.0 + SETTINGS.left_open - own @ own)])
        return self.why[number]


def _kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    found = np.asarray(np.exp(-0.5 * cdist(a, b, "sqeuclidean")))
    # what is far away is none: products of numbers so small are subnormal, which processors are slow with
    found[found < np.finfo(np.float64).eps ** 2] = 0.0
    return found


def unexplained(result: Reconciliation, rows: Rows) -> list[Question]:
    """The unexplained orders that a run can tell something of, the largest; gaps where nothing is, or few runs are."""
    final = result.conclusions.final
    target = final.target
    steps = [step_between(axis) for axis in target.data.at.axes]
    found: list[Question] = []
    if result.verdict is Outcome.NOTHING_MISSING or target.data.few_points:
        # what hides between levels is sharp in speed (a resonance) or in torque (flanks that seat)
        for along in (0, 1):
            reach = [SETTINGS.near_along if axis == along else SETTINGS.far_along for axis in range(3)]
            length = np.array(steps) * reach
            measured, points = (at.points / length for at in (target.data.at, rows.data.at))
            points = points[: len(points) // 2]
            why = [f"lies far from all runs in {AXES[along]}: what hides between them shows there first"] * len(points)
            found.append(Unknown(np.ones(len(points)), np.unique(measured, axis=0), points, why))
    for signature in result.unexplained[: SETTINGS.most_open_orders]:
        if signature.order not in target.data.orders or "time" in signature.dependence:
            continue
        length = np.array(steps) * _lengths(signature.dependence)
        k = int(np.searchsorted(target.data.orders, signature.order))
        parts = 1 if signature.order == 0 else 2
        power = np.maximum(np.abs(final.residual[:, k]) ** 2 - parts * target.sigma[:, k] ** 2, 0.0)[target.good]
        measured = target.data.at.rows(target.good).points / length
        points = rows.data.at.points[: len(rows.data) // 2] / length
        near = _kernel(points / 2, measured / 2)
        local = near @ power / np.maximum(near.sum(axis=1), 1e-12)
        # the noise, not the scatter about the model, which is what is asked about
        noise = parts * float(np.median(target.sigma[target.good, k] ** 2))
        what = f"order {signature.order}" if signature.order else "the mean"
        reason = f"tells what {what}, which is unexplained, does between the measured runs"
        found.append(Unknown(local / noise, np.unique(measured, axis=0), points, [reason] * len(points)))
    return found


class Met:
    """Whether an order is lifted as well where it meets a frequency that was found: yes or no, ln 2 nats at most."""

    def __init__(self, order: int, hertz: float, odds: FloatArray) -> None:
        self.order, self.hertz, self.odds, self.open = order, hertz, odds, True

    def gains(self) -> FloatArray:
        return np.asarray(self.open * np.log(2.0) * np.minimum(self.odds / SETTINGS.told_apart, 1.0))

    def take(self, number: int) -> str:
        self.open = self.open and bool(self.odds[number] < SETTINGS.told_apart)
        return f"tells whether order {self.order}, which meets {self.hertz:.1f} Hz there, is lifted as well"


def other_orders(result: Reconciliation, rows: Rows) -> list[Question]:
    """Orders that no run has where they meet a resonance that was found: as loud as its quietest they would show."""
    target = result.conclusions.final.target
    found: list[Question] = []
    for effect in (claim.piece.effect for claim in result.conclusions.claims):
        if not has_a_frequency(effect):
            continue
        quietest = int(
            np.argmin([abs(effect.complex_value("amplitude_deg", index=i)) for i in range(len(effect.orders))])
        )
        own = effect.orders[quietest]
        for k in np.flatnonzero(~np.isin(target.data.orders, [0, *effect.orders])):
            order = int(target.data.orders[k])
            measured, there = (
                np.abs(effect.contribution(replace(at, speed_rpm=at.speed_rpm * order / own), np.array([own]))[:, 0])
                for at in (target.data.at.rows(target.good), rows.data.at)
            )
            odds = 0.5 * summed((there / rows.sigma[:, k]) ** 2)
            if 0.5 * float(((measured / target.sigma[target.good, k]) ** 2).max()) < SETTINGS.told_apart < odds.max():
                found.append(Met(order, effect.scalar("frequency_Hz"), odds))
    return found


def peaks_between(result: Reconciliation, rows: Rows) -> list[Question]:
    """What a straight line between the measured speeds would miss of the peaks that were found."""
    final = result.conclusions.final
    effects = [claim.piece.effect for claim in result.conclusions.claims if has_a_frequency(claim.piece.effect)]
    if not effects:
        return []
    at, orders = rows.data.at, np.array(rows.data.model_orders(), np.int64)
    levels = np.unique(final.target.data.at.speed_rpm[final.target.good])
    above = np.clip(np.searchsorted(levels, at.speed_rpm, side="right"), 1, len(levels) - 1)
    low, high = levels[above - 1], levels[above]
    share = ((at.speed_rpm - low) / (high - low))[:, None]
    missed = np.zeros((len(at), len(orders)), np.complex128)
    for effect in effects:
        here, left, right = (effect.contribution(replace(at, speed_rpm=s), orders) for s in (at.speed_rpm, low, high))
        missed += here - (1 - share) * left - share * right
    count = len(at) // 2
    deg = np.sqrt(summed(np.abs(missed) ** 2).sum(axis=1) / 4)
    why = [
        f"lies where a straight line from {a:g} to {b:g} rpm misses {d:.2g} deg RMS of what was found"
        for a, b, d in zip(low, high, deg, strict=False)
    ]
    reach = (SETTINGS.inside_peak, SETTINGS.far_along, SETTINGS.far_along)
    length = np.array([step_between(axis) for axis in final.target.data.at.axes]) * reach
    measured = np.unique(final.target.data.at.rows(final.target.good).points / length, axis=0)
    weight = summed((np.abs(missed) / rows.sigma) ** 2).sum(axis=1)
    return [Unknown(weight, measured, at.points[:count] / length, why)]


def _lengths(dependence: Mapping[str, float]) -> list[float]:
    """How far a residual reaches along speed, torque and temperature, in steps, by how it depends on them."""
    shares = [dependence.get(axis, 0.0) for axis in AXES]
    near, far = SETTINGS.near_along, SETTINGS.far_along
    return [far if share <= SETTINGS.cause else near if share == max(shares) else 1.0 for share in shares]


@dataclass(frozen=True)
class Rival:
    """Another explanation of the data than `one`, its rig, and the orders on which either does something."""

    one: str
    other: str
    rig: RigModel
    orders: tuple[int, ...]


def _reached(final: Fit, effect: Effect) -> Iterable[int]:
    """The orders on which an effect does something: a chain of measurement that is late turns all."""
    return final.target.data.model_orders() if effect.stage is Stage.MEASURING else effect.touched_orders()


def _rival(final: Fit, one: str, reached: Iterable[int], other: str, rig: RigModel) -> Rival:
    """A rival; reached: the orders of what it replaces."""
    own = final.state.model()
    known = {(effect.name, effect.orders) for effect in own.effects}
    orders = {*reached}.union(
        *(_reached(final, effect) for effect in rig.effects if (effect.name, effect.orders) not in known)
    )
    # what changes a mesh order changes its sidebands
    for rigs in (own, rig):
        for effect in rigs.of_stage(Stage.MODULATION):
            orders.update(effect.touched_orders() if orders.intersection(effect.orders) else ())
    return Rival(one, other, rig, tuple(sorted(orders)))


def other_models(result: Reconciliation) -> list[Rival]:
    """Other explanations of the same data.

    Names that are as good, also in place of a changed parameter, and refused effects on unexplained orders.
    """
    found = result.conclusions
    final = found.final
    named = [(one.piece.effect.name, _reached(final, one.piece.effect), one.others) for one in found.claims]
    named += [(f"changed {one.after.name}", _reached(final, one.after), one.others) for one in found.retuned]
    named += [("another zero", (0,), found.for_offset)]
    as_good = [_rival(final, name, orders, other.name, other.rig) for name, orders, others in named for other in others]
    return [*as_good, *_refused(result)]


def _refused(result: Reconciliation) -> list[Rival]:
    """Effects that were refused although they gain on orders that are still unexplained."""
    final = result.conclusions.final
    open_orders = {signature.order for signature in result.unexplained}
    taken = {(piece.effect.name, piece.effect.orders) for piece in final.state.pieces}
    refused = list[Candidate]()
    for candidate, _ in sorted(result.judged, key=lambda pair: -pair[1].loss_saved):
        effect = candidate.piece.effect
        kind = (effect.name, effect.orders)
        if candidate.number is None and kind not in taken and open_orders & set(effect.touched_orders()):
            taken.add(kind)
            refused.append(candidate)
    refused = refused[: SETTINGS.most_rivals]
    states = [candidate.put_into(final.state) for candidate in refused]
    said = "{} as well, which the data refused so far"
    return [
        _rival(final, "what was found", _reached(final, one), said.format(one.name), other.state.model())
        for one, other in zip(
            [candidate.piece.effect for candidate in refused],
            fits(final.target, states, steps=SETTINGS.quick_steps),
            strict=True,
        )
    ]
