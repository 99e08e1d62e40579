"""What could be missing: every effect of the catalogue, in every form that the rig does not have yet.

A candidate is a piece with its linear coordinates at zero and its other parameters at a start. Its score is what it
would take off the loss, together with all that is fitted already, in one linear step.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS
from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.state import Coordinate, Piece, State
from st_codegen.reconcile.fit.target import Column, FitData, by_place
from st_codegen.reconcile.search.peaks import Frequencies, follows_load, worth
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Constants, Effect, Form, Scalar, Stage
from st_codegen.rig.effects.base import BACKWARD

#: of an effect at one angle of the turn, that angle
_CENTRE = "centre_deg"
#: whether the carrier modulates it
MODULATED = "modulated"
STAGES = (Stage.ADDITIVE, Stage.MODULATION, Stage.STRUCTURE, Stage.MEASURING)


@dataclass(frozen=True)
class Candidate:
    """A piece to add, or to put in place of piece `number` with more of its keys free.

    grown: the keys that are new. gain: what it takes off twice the loss, linearised.
    """

    piece: Piece
    number: int | None = None
    grown: frozenset[str] = frozenset()
    gain: float = 0.0

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.piece.effect.name

    def coordinates(self) -> list[tuple[int, Coordinate]]:
        """The new coordinates and their places among the piece's."""
        return [
            (i, c)
            for i, c in enumerate(self.piece.coordinates())
            if not self.grown or {c.key, c.phase_key} & self.grown
        ]

    @cached_property
    def identity(self) -> tuple[str, tuple[int, ...], frozenset[str]]:
        """What makes two candidates the same but for their starts."""
        orders = self.piece.effect.orders if self.piece.effect.orders_key == "order" else ()
        return self.name, orders, self.grown or self.piece.free

    def put_into(self, state: State) -> State:
        """The state with this candidate."""
        return state.with_piece(self.piece) if self.number is None else state.replaced(self.number, self.piece)

    def places(self, state: State) -> list[int]:
        """Where the new coordinates stand in the state with it."""
        start = state.slices()[self.place(state)].start
        return [start + i for i, _ in self.coordinates()]

    def place(self, state: State) -> int:
        """Where the piece stands in the state with it."""
        return len(state.pieces) - 1 if self.number is None else self.number


def price_of_number(target: FitData) -> float:
    """Loss that a number must save: Schwarz's criterion on the number of runs."""
    return float(np.log(max(target.good.sum(), 10))) + 2.0


def variants(effect: type[Effect], both_directions: bool) -> list[frozenset[str]]:
    """Keys that are free together: what is required, and every choice of optional parts that gives a size."""
    always = {scalar.key for scalar in effect.scalars if scalar.default is None}
    parts = [frozenset({s.key, s.beside} - {""}) for s in effect.scalars
             if s.default is not None and not s.shapes and s.form is not Form.FIXED]  # fmt: skip
    sizes = set(always) | {key for part in parts for key in part}
    for phasor in effect.phasors:
        backward = (False, True) if phasor.own_flanks and both_directions else (False,)
        together = (phasor, *(other for other in effect.phasors if other.key == phasor.beside))
        keys = frozenset(key for one in together for b in backward for key in one.keys(b))
        if phasor.required and len(effect.phasors) == 1:
            always |= keys
        else:
            parts += [keys] * (keys not in parts)
    if effect.phasors:
        sizes = {phasor.key for phasor in effect.phasors}
    found = []
    for count in range(len(parts) + 1):
        for chosen in itertools.combinations(parts, count):
            keys = frozenset(always).union(*chosen)
            if count > 1 and any(phasor.beside and phasor.key in keys for phasor in effect.phasors):
                continue
            if keys & sizes:
                found.append(keys | {s.key for s in effect.scalars if s.shapes in keys and s.form is not Form.FIXED})
    return list(dict.fromkeys(found))


def is_a_form(scalar: Scalar) -> bool:
    """Whether a scalar says which of several forms a part of an effect has; one that is not said is the usual one."""
    return scalar.form is Form.FIXED and bool(scalar.starts) and bool(scalar.shapes)


def is_carried(state: State, orders: Sequence[int], measured: IntArray) -> bool:
    """Whether the carrier modulates one of these orders, and a sideband of it is among those that were measured."""
    carriers = (one.effect for one in state.pieces if one.effect.stage is Stage.MODULATION)
    own = (effect for effect in carriers if set(orders) & set(effect.orders))
    return any(np.isin(effect.touched_orders(), measured).any() for effect in own)


class Search:
    """Candidates for a fit, with their scores."""

    def __init__(
        self,
        known: Catalogue,
        fit: Fit,
        *,
        stages: Sequence[Stage] = STAGES,
        touching: Sequence[int] = (),
        moved: bool = False,
        formed: bool = False,
    ) -> None:
        """moved: of what peaks at a frequency, only what moves by more than its width, and nothing else.

        formed: of what has several forms, all but the usual one, and nothing else.
        """
        self.moved = moved
        self.formed = formed
        self.known = known
        self.fit = fit
        self.stages = tuple(stages)
        self.touching = np.array(touching, np.int64)
        self.target = fit.target
        self.data = fit.target.data
        self.constants: Constants = fit.state.rig.constants
        self.scorer = Scorer(fit)

    def ranked(self) -> list[Candidate]:
        """The best start of every candidate that gains something, by gain less penalty, best first."""
        best: dict[object, Candidate] = {}
        for candidate in self.all():
            scored = self.scorer.scored(candidate)
            known = best.get(scored.identity)
            # starts that the data do not tell apart: the first one
            is_better = known is None or scored.gain > known.gain + SETTINGS.tie
            if scored.gain >= SETTINGS.least_candidate_gain and is_better:
                best[scored.identity] = scored
        return sorted(best.values(), key=lambda c: -self.net(c))

    def net(self, candidate: Candidate) -> float:
        """Gain less the penalty of the parameters."""
        return candidate.gain - self.penalty * len(candidate.coordinates())

    def is_told(self, candidate: Candidate) -> bool:
        """Whether no size of a candidate is the same in all runs only since a condition never varied.

        Skew at one speed, drift at one temperature and compliance under one load look like any constant.
        """
        at, orders = self.data.at, self.data.orders
        for key in self._never_varied:
            other = replace(at, **{key: 1.5 * getattr(at, key) + 10.0})
            for _, c in candidate.coordinates():
                if not c.linear:
                    continue
                unit = candidate.piece.unit(c)
                now, then = (unit.contribution(conditions, orders) for conditions in (at, other))
                # to within roundings: numbers of another condition differ by far more, and units may be small
                is_same = partial(np.allclose, rtol=1e-9, atol=0.0)
                is_constant = all(is_same(side, side[0]) for side in map(now.__getitem__, at.by_direction()))
                if is_constant and not is_same(now, then):
                    return False
        return True

    @cached_property
    def _never_varied(self) -> tuple[str, ...]:
        if self.data.angle_rad is not None:
            return ()
        return tuple(key for key in CONDITION_COLUMNS if len(np.unique(getattr(self.data.at, key))) == 1)

    @cached_property
    def penalty(self) -> float:
        """Loss that a parameter must save."""
        return price_of_number(self.target)

    def all(self) -> Iterator[Candidate]:
        """Every candidate at every start."""
        for effect in self.known.values():
            if effect.stage not in self.stages or not effect.searched or len(self._foreign) < effect.least_foreign:
                continue
            # what peaks at a frequency has its form asked once it is found
            if self.formed and (effect.orders_key == "orders" or not any(map(is_a_form, effect.scalars))):
                continue
            if effect.orders_key == "orders":
                if any(s.unit == "Hz" for s in effect.scalars) and not self.moved:
                    yield from self._moving(effect)
                # lists of orders are searched where a frequency says which belong together
                if self.data.angle_rad is None and any(s.unit == "Hz" for s in effect.scalars):
                    yield from self._many_orders(effect)
            elif not self.moved:
                yield from self._growths(effect)
                yield from self._additions(effect)

    def _additions(self, effect: type[Effect]) -> Iterator[Candidate]:
        present = {piece.effect.orders for piece in self.fit.state.pieces if piece.effect.name == effect.name}
        for orders in self._order_choices(effect):
            if orders in present and all(scalar.key != _CENTRE for scalar in effect.scalars):
                continue  # a turn may have several places
            for variant in variants(effect, self.data.both_directions()):
                for starts in self._starts(effect, variant, orders):
                    piece = _started(effect, variant, starts, orders, self.constants)
                    if self._is_seen(piece):
                        yield Candidate(piece)

    def _growths(self, effect: type[Effect]) -> Iterator[Candidate]:
        """Optional parts that an effect of the rig does not have yet."""
        for number, piece in enumerate(self.fit.state.pieces):
            if piece.effect.name != effect.name:
                continue
            have = set(piece.effect.values)
            groups = {v - have for v in variants(effect, self.data.both_directions())} - {frozenset()}
            if self.data.both_directions():
                groups |= _untied(effect, have)
            for group in sorted(groups, key=sorted):
                if group & have:
                    continue
                for starts in self._starts(effect, group, piece.effect.orders):
                    values = dict(piece.effect.values) | _zeros(effect, group) | starts
                    for key in group:
                        if key.startswith(BACKWARD) and key[len(BACKWARD) :] in have:
                            values[key] = piece.effect.values[key[len(BACKWARD) :]]
                    yield Candidate(piece.with_values(values, group), number, group)

    def _order_choices(self, effect: type[Effect]) -> list[tuple[int, ...]]:
        if effect.orders_key is None:
            return [()]
        allowed = effect.allowed_orders(self.constants) or tuple(self.data.orders[self.data.orders > 0].tolist())
        return [(order,) for order in allowed]

    def _is_seen(self, piece: Piece) -> bool:
        """Whether the effect touches an order that was measured; one of many orders, enough of those around its own.

        A mesh order that is larger at one angle has sidebands at every distance: where only some are measured, any
        sidebands of the mesh order look like it.
        """
        touched = piece.effect.touched_orders()
        if piece.effect.least_foreign:
            around = (self._is_around(k, piece.effect.orders) for k in self._foreign.intersection(touched))
            if sum(around) < piece.effect.least_foreign:
                return False
        seen = bool(np.isin(touched, self.data.model_orders()).any())
        wanted = not len(self.touching) or bool(np.isin(touched, self.touching).any())
        return piece.effect.stage is Stage.MEASURING or (seen and wanted)

    def _is_around(self, order: int, own: tuple[int, ...]) -> bool:
        return all(k in self.data.model_orders() and abs(order - k) <= SETTINGS.around_order for k in own)

    @cached_property
    def _foreign(self) -> set[int]:
        """The orders that were measured and that the rig does not make."""
        return set(self.data.model_orders()) - set(self.fit.state.rig.orders())

    def _starts(
        self, effect: type[Effect], keys: frozenset[str], orders: tuple[int, ...]
    ) -> Iterator[dict[str, float]]:
        shapes = [s for s in effect.scalars if s.form is Form.SHAPE and s.key in keys]
        located = _CENTRE in keys and self.data.angle_rad is None
        if located:
            shapes = [s for s in shapes if s.key != _CENTRE]
        forms = [s for s in effect.scalars if is_a_form(s) and s.shapes in keys] if self.formed else []
        if not is_carried(self.fit.state, orders, self.data.orders):
            forms = [s for s in forms if s.key != MODULATED]
        # a form that is not said is the usual one, and one is said of what is `formed`
        usual = [None] * len(forms)
        for values in itertools.product(
            *(s.starts or ((s.lower + s.upper) / 2,) for s in shapes), *((None, *s.starts) for s in forms)
        ):
            if self.formed and [*values[len(shapes) :]] == usual:
                continue
            told = zip((*shapes, *forms), values, strict=True)
            start = {s.key: float(value) for s, value in told if value is not None}
            if located:
                gain, angle = self._loudest_angle(effect, keys, start, orders)
                start[_CENTRE] = angle
                if gain < SETTINGS.order_gain:
                    continue
            yield start

    def _loudest_angle(
        self, effect: type[Effect], keys: frozenset[str], start: dict[str, float], orders: tuple[int, ...]
    ) -> tuple[float, float]:
        """What an effect of this shape would take off the loss, each of its sizes alone, and at which angle (deg)."""
        piece = _started(effect, keys, start | {_CENTRE: 0.0}, orders, self.constants)
        angles, turn = self._turns
        gain = np.zeros(len(angles))
        for c in piece.coordinates():
            if c.linear:
                unit = piece.unit(c).contribution(self.data.at, self.data.orders)
                pull = (self.scorer.weights * unit.conj() * self.fit.residual).sum(axis=0)
                gain += (turn @ pull).real ** 2 / max(float((self.scorer.weights * np.abs(unit) ** 2).sum()), 1e-300)
        return float(gain.max()), float(angles[np.argmax(gain)])

    @cached_property
    def _turns(self) -> tuple[FloatArray, ComplexArray]:
        """Angles (deg) that are tried, and by what each turns each order, (angles, K)."""
        angles = np.arange(0.0, 360.0, 0.25)
        return angles, np.exp(1j * np.outer(np.radians(angles), self.data.orders))

    # -- effects on several orders at once

    def _many_orders(self, effect: type[Effect]) -> Iterator[Candidate]:
        """One start for each promising frequency: the orders that gain by it."""
        frequencies = Frequencies(effect, self.fit, self.scorer.weights, self.scorer.powers)
        for start in frequencies.moved() if self.moved else frequencies.starts():
            # where the height follows the load nothing of one height may explain enough to begin with
            of_load = self._sizes(effect, of_load=True)
            keys = frozenset(start.values) | self._sizes(effect, of_load=False)
            for chosen in (keys, keys | of_load)[: 1 + bool(of_load)]:
                yield Candidate(_started(effect, chosen, start.values, start.orders, self.constants))

    def _sizes(self, effect: type[Effect], *, of_load: bool) -> frozenset[str]:
        """The keys of the load part of a resonance's heights, or of all other sizes of an effect."""
        sides = (False, True)[: 1 + self.data.both_directions()]
        own = [phasor for phasor in effect.phasors if follows_load(effect, phasor.key) == of_load]
        return frozenset(key for phasor in own for side in sides[: 1 + phasor.own_flanks] for key in phasor.keys(side))

    def _moving(self, effect: type[Effect]) -> Iterator[Candidate]:
        """A frequency of a piece that is there and may move with a condition, from where it does not, or a size."""
        shapes = [s for s in effect.scalars if s.default == 0.0 and s.form is Form.SHAPE]
        for number, piece in enumerate(self.fit.state.pieces):
            if piece.effect.name != effect.name:
                continue
            for s in shapes:
                if s.key not in piece.effect.values and s.shapes in ("", *piece.effect.values):
                    own = frozenset({s.key})
                    yield Candidate(piece.with_values({**piece.effect.values, s.key: 0.0}, own), number, own)
            keys = self._sizes(effect, of_load=True)
            if keys and not keys & set(piece.effect.values):
                none = {key: (0.0,) * len(piece.effect.orders) for key in sorted(keys)}
                yield Candidate(piece.with_values({**piece.effect.values, **none}, keys), number, keys)


def _untied(effect: type[Effect], have: set[str]) -> set[frozenset[str]]:
    """Backward keys of phasors that the rig gives for both directions together."""
    return {
        frozenset(phasor.keys(True))
        for phasor in effect.phasors
        if phasor.own_flanks and phasor.key in have and phasor.keys(True)[0] not in have
    }


def _zeros(effect: type[Effect], keys: frozenset[str]) -> dict[str, float]:
    """Neutral values of linear keys."""
    inverse = {s.key for s in effect.scalars if s.form is Form.INVERSE}
    # in the catalogue's order: that of a set differs from process to process
    return {key: float("inf") if key in inverse else 0.0 for key in effect.known_keys() if key in keys}


def _started(
    effect: type[Effect], keys: frozenset[str], starts: dict[str, float], orders: tuple[int, ...], constants: Constants
) -> Piece:
    values: dict[str, object] = dict(_zeros(effect, keys))
    for phasor in effect.phasors:
        if phasor.required and phasor.key not in keys:
            values[phasor.key] = 0.0
    if effect.orders_key == "orders":
        scalars = {s.key for s in effect.scalars}
        values = {key: value if key in scalars else [0.0] * len(orders) for key, value in values.items()}
        values["orders"] = list(orders)
    elif orders:
        values["order"] = orders[0]
    return Piece(effect(values | starts, constants, check=False), keys, added=True)


class Scorer:
    """Gains of candidates in one linear step from a fit."""

    def __init__(self, fit: Fit) -> None:
        self.fit, self.weights = fit, fit.target.weights(fit.residual)
        self._by_place = {place: (index, _real(values)) for place, (index, values) in by_place(fit.columns).items()}

    def columns(self, candidate: Candidate) -> list[Column]:
        """The columns of the new coordinates."""
        columns = self.fit.propagation.columns(candidate.piece)
        return [columns[i] for i, _ in candidate.coordinates()]

    def scored(self, candidate: Candidate) -> Candidate:
        """The candidate with its gain, its linear coordinates where the step puts them."""
        columns = self.columns(candidate)
        step, matrix, pull = self.step(columns)
        vector = candidate.piece.vector()
        taken = np.array(step)
        for number, ((place, c), x) in enumerate(zip(candidate.coordinates(), step, strict=True)):
            if c.linear:
                # a size beyond its bounds (a negative one, say) is another effect: what is left of the gain counts
                taken[number] = np.clip(vector[place] + x, c.lower, c.upper) - vector[place]
                vector[place] += taken[number]
        gain = float(2 * taken @ pull - taken @ matrix @ taken)
        if self.fit.target.data.few_points:
            places = np.unique(np.concatenate([places for places, _ in columns]))
            gain = float(worth(gain, *(part.sum() for part in self.powers(places))))
        return Candidate(candidate.piece.with_vector(vector), candidate.number, candidate.grown, gain)

    def powers(self, places: IntArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Power of the residual and of the noise of chosen orders, in the weights of the fit, and how many numbers."""
        target = self.fit.target
        weights, parts = self.weights[:, places], np.where(target.data.orders[places] == 0, 1, 2)
        whole = (weights * np.abs(self.fit.residual[:, places]) ** 2).sum(axis=0)
        noise = (weights * parts * target.sigma[:, places] ** 2).sum(axis=0)
        return whole, noise, (target.counts[:, places] * parts).sum(axis=0)

    def step(self, columns: Sequence[Column]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear step of new columns beside all fitted ones, their reduced normal matrix, and right side."""
        count, size = len(columns), len(self.fit.inverse)
        own, cross, pull = np.zeros((count, count)), np.zeros((count, size)), np.zeros(count)
        for place, (index, values) in by_place(columns).items():
            design = _real(values)
            weighted = design * np.tile(self.weights[:, place], 2)[:, None]
            r = _real(self.fit.residual[:, place, None])[:, 0]
            own[np.ix_(index, index)] += weighted.T @ design
            pull[index] += r @ weighted
            if place in self._by_place:
                fitted, other = self._by_place[place]
                cross[index[:, None], fitted[None, :]] += weighted.T @ other
        reduced = own - cross @ self.fit.inverse @ cross.T
        # what the fitted coordinates would still gain by themselves is no gain of new ones
        pull -= cross @ self.fit.open_step
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        seen = np.diag(reduced) > 1e-6 * np.diag(own)
        step = np.zeros(count)
        if seen.any():
            matrix = (reduced / scale[:, None] / scale[None, :])[np.ix_(seen, seen)]
            right = (pull / scale)[seen]
            step[seen] = np.linalg.pinv(matrix, rcond=1e-8, hermitian=True) @ right
        return step / scale, reduced, pull


def _real(values: ComplexArray) -> FloatArray:
    """Real parts above imaginary parts, (2n, p); the mean has none, and nothing fits there either."""
    return np.concatenate([values.real, values.imag])
