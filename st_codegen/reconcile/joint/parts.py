"""Parts of a joint's torque: which of them predict stretches of time that they were not fitted to.

torque = I ddq + a cos q + b sin q + c + the parts; a part is a few columns, with one number that shapes them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.joint.rows import JointRows
from st_codegen.reconcile.joint.settings import JOINT

#: parts that are no claim of a cause: the rigid joint, and what the motion of others explains
RIGID, OTHERS = "rigid", "other_joints"
#: a rigid joint that is another one from a time on, as with a load in its hand
LOADED = "changed_load"
#: parts of several columns that no friction is
BODIES = (RIGID, OTHERS, LOADED)


@dataclass(frozen=True)
class TorquePart:
    """A part of the torque: a name, the number that shapes it (0: none), columns (n, p), which of its laws it is."""

    name: str
    shape: float
    columns: FloatArray
    law: int = 0


@dataclass(frozen=True)
class Crossed:
    """A model: left-out loss and that of the rest by block, coefficients, standard errors by leaving blocks out."""

    held: FloatArray
    trained: FloatArray
    values: FloatArray
    errors: FloatArray


@dataclass(frozen=True)
class PartGain:
    """What a part adds: share of the left-out loss, whether surely, share of blocks; its best variant, its loss."""

    share: float
    is_sure: bool
    blocks: float
    part: TorquePart
    held: FloatArray

    def is_worse_than(self, other: PartGain) -> bool:
        """Whether left-out stretches tell the two apart."""
        return surely(self.held - other.held, self.held)

    @property
    def passed(self) -> bool:
        """Whether the part predicts what it was not fitted to."""
        return self.is_sure and self.blocks >= JOINT.most and self.share > JOINT.share


def crossed(columns: FloatArray, rows: JointRows) -> Crossed:
    """Least squares with each block left out in turn."""
    scale = np.sqrt((columns**2).mean(axis=0))
    together = np.argsort(rows.block, kind="stable")
    x = columns[together] / np.where(scale > 0, scale, 1.0)
    y = rows.torque[together]
    count = JOINT.blocks
    edges = np.searchsorted(rows.block[together], np.arange(count + 1))
    cut = [slice(*pair) for pair in itertools.pairwise(edges.tolist())]
    grams = np.array([x[own].T @ x[own] for own in cut])
    pulls = np.array([x[own].T @ y[own] for own in cut])
    power = np.array([y[own] @ y[own] for own in cut])
    small = 1e-10 * np.eye(x.shape[1]) * len(y)
    whole = np.linalg.solve(grams.sum(axis=0) + small, pulls.sum(axis=0))
    gram, pull = grams.sum(axis=0) - grams, pulls.sum(axis=0) - pulls
    without = np.linalg.solve(gram + small, pull[..., None])[..., 0]
    held, trained = (
        total - 2 * (without * h).sum(axis=1) + np.einsum("bi,bij,bj->b", without, g, without)
        for total, h, g in ((power, pulls, grams), (power.sum() - power, pull, gram))
    )
    errors = np.sqrt((count - 1) / count * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    divisor = np.where(scale > 0, scale, 1.0)
    return Crossed(held, trained, whole / divisor, errors / divisor)


def gain_of(variants: Sequence[TorquePart], chosen: Sequence[TorquePart], rows: JointRows, before: Crossed) -> PartGain:
    """What one of the variants adds to the chosen parts; each block is predicted by the variant best for the others."""
    base = stacked(chosen)
    fits = [crossed(np.hstack([base, part.columns]), rows) for part in variants]
    trained = np.array([fit.trained for fit in fits])
    held = np.array([fit.held for fit in fits])[trained.argmin(axis=0), np.arange(JOINT.blocks)]
    saved = before.held - held
    best = variants[int(trained.sum(axis=1).argmin())]
    share = float(saved.sum() / before.held.sum())
    return PartGain(share, surely(saved, before.held), float((saved > 0).mean()), best, held)


def surely(saved: FloatArray, before: FloatArray) -> bool:
    """Whether stretches save loss beyond their standard error; or all of them, and most of it, however unlike."""
    error = float(saved.std(ddof=1)) / np.sqrt(len(saved))
    most = bool((saved > 0).all()) and float(saved.sum()) > JOINT.most * float(before.sum())
    return most or float(saved.mean()) > JOINT.better * error


def stacked(parts: Sequence[TorquePart]) -> FloatArray:
    """The columns of parts side by side."""
    return np.hstack([part.columns for part in parts])


def told(part: TorquePart, basis: FloatArray) -> float:
    """Share of a part's power that other parts do not make; basis: orthonormal columns that span those."""
    left = part.columns - basis @ (basis.T @ part.columns)
    return float((left**2).sum() / max(float((part.columns**2).sum()), 1e-300))


def rigid(rows: JointRows) -> TorquePart:
    """Inertia, gravity, a constant."""
    # as the kernel leaves a wave that passes at this speed: the cosine of a smooth angle is no smooth cosine
    kept = np.exp(-((rows.speed * rows.kernel_s) ** 2) / 2)
    columns = [rows.acceleration, kept * np.cos(rows.angle), kept * np.sin(rows.angle), np.ones(len(rows.time))]
    return TorquePart(RIGID, 0.0, np.stack(columns, axis=1))


def others(rows: JointRows) -> TorquePart | None:
    """What the motion of other joints may add, as far as it was varied; None for a joint alone."""
    known = rows.others
    if not known.shape[1]:
        return None
    # as few columns as hold what there is: of two joints that move alike one is enough
    whitened = known - known.mean(axis=0)
    u, size, _ = np.linalg.svd(whitened / np.maximum(whitened.std(axis=0), 1e-12), full_matrices=False)
    return TorquePart(OTHERS, 0.0, u[:, size > JOINT.least_acting * size[0]] * np.sqrt(len(u)))


def changed_load(rows: JointRows, beside: Sequence[TorquePart]) -> TorquePart | None:
    """What a load adds that the joint carries from a time on, its shape (s); None where none is told.

    A zero of the torque that steps there, or drifts of friction and of zero, leave most of it. What is wrong in any way
    is a little less so in two pieces: that is no load.
    """
    body, parts = rigid(rows).columns, [*beside, *drifts_of(rows)]
    before, step = crossed(stacked(parts), rows), float(np.ptp(rows.time)) / (4 * JOINT.blocks)

    def best_of(times: Sequence[float]) -> PartGain:
        steps = [TorquePart(LOADED, s, body * (rows.time > s)[:, None]) for s in times]
        return gain_of(steps, parts, rows, before)

    coarse = best_of((float(rows.time.min()) + step * np.arange(1, 4 * JOINT.blocks)).tolist())
    fine = best_of((coarse.part.shape + step * np.linspace(-1.0, 1.0, 41)).tolist())
    # when within a stretch a load changed is not known where that stretch is left out
    gain = best_of([fine.part.shape])
    if not gain.passed or gain.share < JOINT.most:
        return None
    zero = [*parts, replace(gain.part, columns=gain.part.columns[:, -1:])]
    gain = gain_of([replace(gain.part, columns=gain.part.columns[:, :-1])], zero, rows, crossed(stacked(zero), rows))
    if not gain.passed or gain.share < JOINT.most:
        return None
    return TorquePart(LOADED, gain.part.shape, body * (rows.time > gain.part.shape)[:, None])


@dataclass(frozen=True)
class Acting:
    """Columns of the other joints' motion that predict, and by how much other choices of them move friction."""

    columns: tuple[int, ...]
    moves: Mapping[str, float]


def acting_of(rows: JointRows) -> Acting:
    """The columns beside the rigid joint and its friction, the best first, as many as predict left-out stretches best.

    Other numbers of them that predict no worse give friction another size: nobody knows which are the true ones.
    """
    names = RICH
    parts = [rigid(rows), *first_of_kinds(rows, *names)]
    size = np.sqrt((rows.others**2).mean(axis=0))
    free = rows.others / np.where(size > 0, size, 1.0)
    basis = np.linalg.qr(stacked(parts))[0]
    free, left = (x - basis @ (basis.T @ x) for x in (free, rows.torque))
    chosen, fits = list[int](), [crossed(stacked(parts), rows)]
    while len(chosen) < min(JOINT.acting, rows.others.shape[1]):
        power = (free**2).sum(axis=0)
        told = power > JOINT.told * len(left)
        score = np.where(told, (free.T @ left) ** 2 / np.where(told, power, 1.0), 0.0)
        place = int(score.argmax())
        if not score[place]:
            break
        chosen.append(place)
        parts.append(TorquePart(OTHERS, 0.0, rows.others[:, [place]]))
        # several together may predict where none of them does alone
        fits.append(crossed(stacked(parts), rows))
        new = free[:, place] / np.sqrt(power[place])
        free, left = (x - (np.outer(new, new @ x) if x.ndim == 2 else new * (new @ x)) for x in (free, left))
    count = int(np.argmin([fit.held.sum() for fit in fits]))
    best = fits[count]
    alike = np.array([fit.values[4:7] for fit in fits if not surely(fit.held - best.held, fit.held)])
    moves = np.abs(alike - best.values[4:7]).max(axis=0)
    return Acting(tuple(chosen[:count]), dict(zip(names, moves.tolist(), strict=True)))


def base_of(rows: JointRows) -> list[TorquePart]:
    """The rigid joint, and what the motion of others may add."""
    group = others(rows)
    return [rigid(rows), *([] if group is None else [group])]


Columns = Callable[[JointRows, float, FloatArray], FloatArray]


@dataclass(frozen=True)
class PartLaw:
    """A law of a part: its column from rows, shape and the load; shapes that are tried."""

    column: Columns
    shapes: Callable[[JointRows], FloatArray] = lambda _: np.zeros(1)


@dataclass(frozen=True)
class PartKind:
    """A kind of part: the laws that it may follow."""

    laws: tuple[PartLaw, ...]

    def variants(self, name: str, rows: JointRows, load: FloatArray | None = None) -> list[TorquePart]:
        """The part with each law and shape; load: see `load_of`, nothing where it is not known yet."""
        load = np.zeros((len(rows.time), 2)) if load is None else load
        return [
            TorquePart(name, float(s), law.column(rows, float(s), load)[:, None], number)
            for number, law in enumerate(self.laws)
            for s in law.shapes(rows)
        ]


def _between(low: float, high: float) -> FloatArray:
    return np.geomspace(low, max(high, 1.01 * low), 8)


def _speeds(rows: JointRows) -> FloatArray:
    size = np.abs(rows.speed)
    return _between(float(np.quantile(size, 0.05)), 0.25 * float(size.max()))


def _fading(since: FloatArray) -> FloatArray:
    """Angles or times within which something fades, from those since the last reversal."""
    known = since[np.isfinite(since)]
    if not len(known):
        return np.ones(1)
    return _between(max(float(np.quantile(known, 0.02)), 1e-9), float(np.quantile(known, 0.5)))


def _clock(rows: JointRows) -> FloatArray:
    """The time, from 0 at the start of the recording to 1 at its end."""
    return np.asarray((rows.time - rows.time.min()) / np.ptp(rows.time))


def _drift(of: Callable[[JointRows], FloatArray]) -> PartKind:
    """What changes by 1 from the start to the end, evenly or as what warms up does, and is 0 in the mean."""

    def changed(rows: JointRows, by_now: FloatArray) -> FloatArray:
        return np.asarray(of(rows) * (by_now - by_now.mean()))

    def warmed(rows: JointRows, share: float, _: FloatArray) -> FloatArray:
        return changed(rows, np.expm1(-_clock(rows) / share) / np.expm1(-1.0 / share))

    even = PartLaw(lambda rows, _s, _: changed(rows, _clock(rows)))
    return PartKind((even, PartLaw(warmed, lambda _: _between(*JOINT.warming))))


def _kind(*columns: Columns, shapes: Callable[[JointRows], FloatArray] = lambda _: np.zeros(1)) -> PartKind:
    return PartKind(tuple(PartLaw(column, shapes) for column in columns))


KINDS: Mapping[str, PartKind] = {
    "dry_friction": _kind(lambda r, _s, _: r.sign),
    "viscous_friction": _kind(lambda r, _s, _: r.speed),
    "square_friction": _kind(lambda r, _s, _: r.speed * np.abs(r.speed)),
    "curved_friction": _kind(
        lambda r, s, _: r.sign * np.exp(-np.abs(r.speed) / s),
        lambda r, s, _: r.sign * np.exp(-((r.speed / s) ** 2)),
        lambda r, s, _: r.sign / (1 + np.abs(r.speed) / s),
        shapes=_speeds,
    ),
    "direction_dependent_friction": _kind(lambda r, _s, _: np.abs(r.speed)),
    "load_dependent_friction": _kind(
        lambda r, _, load: r.sign * np.abs(load[:, 0]), lambda r, _, load: r.sign * np.abs(load[:, 1])
    ),
    "dry_friction_drift": _drift(lambda r: r.sign),
    "viscous_friction_drift": _drift(lambda r: r.speed),
    "torque_zero_drift": _drift(lambda r: np.ones(len(r.time))),
    "reversal_travel": _kind(lambda r, s, _: r.sign * np.exp(-r.travel / s), shapes=lambda r: _fading(r.travel)),
    "reversal_time": _kind(lambda r, s, _: r.sign * np.exp(-r.since / s), shapes=lambda r: _fading(r.since)),
}


#: friction of a joint of which nothing is known yet
RICH = ("dry_friction", "viscous_friction", "curved_friction")


def first_of_kinds(rows: JointRows, *names: str) -> list[TorquePart]:
    """Parts of some kinds, each by its first law and shape."""
    return [KINDS[name].variants(name, rows)[0] for name in names]


def drifts_of(rows: JointRows) -> list[TorquePart]:
    """All that friction and zero may do over the recording."""
    return [one for name in KINDS if name.endswith("_drift") for one in KINDS[name].variants(name, rows)]


#: what friction may be over speed: forms of which one may take the place of another
OVER_SPEED = ("dry_friction", "viscous_friction", "square_friction", "curved_friction")
#: where the load follows the speed, as in a motion of one sine, friction by the load may look like these together
_FORMS = (*OVER_SPEED, "load_dependent_friction")
_LEVEL = {"dry_friction", "load_dependent_friction"}
#: forms that may hide each other, of which the first one found need not be the true one
_ALIKE = {"viscous_friction", "square_friction"}
_CHANGES = {"viscous_friction", "square_friction", "curved_friction"}


@dataclass(frozen=True)
class Chosen:
    """Parts that were taken, their fit, and what could stand in the place of each.

    by_law: by how much coefficients move when a part follows another law of its kind.
    """

    parts: tuple[TorquePart, ...]
    fit: Crossed
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    not_told: tuple[str, ...] = ()
    by_law: FloatArray | None = None

    def value(self, name: str, *, law: bool = True) -> tuple[float, float]:
        """Coefficient of the part with one column, and its standard error; law: as if its law were not known."""
        own = self.place(name)
        if own is None:
            raise KeyError(name)
        spread = self.by_law[own.start] if law and self.by_law is not None else 0.0
        return float(self.fit.values[own.start]), float(np.hypot(self.fit.errors[own.start], spread))

    def amplitude(self, name: str) -> tuple[float, float]:
        """Amplitude of a part of a cosine and a sine, and its standard error."""
        own = self.place(name)
        if own is None:
            raise KeyError(name)
        values, errors = self.fit.values[own], self.fit.errors[own]
        size = float(np.hypot(*values))
        errors = errors if self.by_law is None else np.hypot(errors, self.by_law[own])
        return size, float(np.hypot(*(values * errors))) / max(size, 1e-300)

    @cached_property
    def places(self) -> list[slice]:
        """Where the coefficients of each part stand."""
        ends = itertools.accumulate((part.columns.shape[1] for part in self.parts), initial=0)
        return [slice(*pair) for pair in itertools.pairwise(ends)]

    def place(self, name: str) -> slice | None:
        """Where the coefficients of a part stand; None where it is not among the parts."""
        return next((own for part, own in zip(self.parts, self.places, strict=True) if part.name == name), None)

    def own(self, name: str) -> FloatArray:
        """What a part contributes, N m."""
        return self.of({name})

    def of(self, names: set[str]) -> FloatArray:
        """What parts contribute together, N m."""
        found = np.zeros(len(self.parts[0].columns))
        for part, own in zip(self.parts, self.places, strict=True):
            if part.name in names:
                found = found + part.columns @ self.fit.values[own]
        return found

    def names(self) -> list[str]:
        """The names of the parts."""
        return [part.name for part in self.parts]


def load_of(chosen: Chosen) -> FloatArray:
    """The torque through the joint, without its friction: all of it, and what does not accelerate it, N m (n, 2)."""
    whole, inert = chosen.of(set(BODIES)), np.zeros(len(chosen.parts[0].columns))
    for part, own in zip(chosen.parts, chosen.places, strict=True):
        if part.name in (RIGID, LOADED):
            inert = inert + chosen.fit.values[own.start] * part.columns[:, 0]
    return np.stack([whole, whole - inert], axis=1)


def floor_of(chosen: Chosen, rows: JointRows) -> float:
    """RMS of the noise of torque and angle in what is left, N m."""
    torque, acceleration = rows.noise
    return float(np.hypot(torque, chosen.fit.values[0] * acceleration))


def choose(rows: JointRows, moves: Mapping[str, float], beside: Sequence[TorquePart] = ()) -> Chosen:
    """Take parts one by one, the one that predicts best first, and test each beside all others in the end.

    moves: of `Acting`; beside: parts that are taken already (waves).
    """
    base: list[TorquePart] = [rigid(rows)]
    fit = crossed(stacked(base), rows)
    group = others(rows)
    friction = first_of_kinds(rows, "dry_friction", "viscous_friction")
    if group is not None:
        rich = [*base, *friction]
        if gain_of([group], rich, rows, crossed(stacked(rich), rows)).passed:
            # beside so many columns one kind of friction alone may predict nothing
            base += [group, *friction]
    loaded = changed_load(rows, base if base[1:] else [*base, *friction])
    if loaded is not None:
        base.append(loaded)
    parts, not_told, settled = [*base, *beside], set[str](), list[list[str]]()
    while True:
        parts = _of_own_load(rows, parts)
        fit = crossed(stacked(parts), rows)
        gains = _gains(rows, parts, fit, not_told)
        if passed := [gain for gain in gains.values() if gain.passed]:
            # what has no shape to bend goes first
            parts.append(min(passed, key=lambda gain: (gain.part.shape != 0, -gain.share)).part)
            continue
        # what hides behind another part is asked beside the right forms of friction: it would mend wrong ones
        parts = _of_own_load(rows, _of_best_form(rows, parts))
        names = sorted(part.name for part in parts)
        fit = crossed(stacked(parts), rows)
        pair = _pair(rows, parts, fit, _gains(rows, parts, fit, not_told).keys())
        if not pair or names in settled:
            break
        settled.append(names)
        parts += pair
    return _judged(rows, parts, not_told - set(names), moves)


def _gains(rows: JointRows, parts: Sequence[TorquePart], fit: Crossed, not_told: set[str]) -> dict[str, PartGain]:
    now = Chosen(tuple(parts), fit)
    load, there = load_of(now), set(now.names())
    basis = np.linalg.qr(stacked(parts))[0]
    gains = {}
    for name in KINDS:
        if name in there:
            continue
        variants = _told_variants(name, rows, basis, load)
        (not_told.discard if variants else not_told.add)(name)
        if variants:
            gains[name] = gain_of(variants, parts, rows, fit)
    return gains


def _told_variants(name: str, rows: JointRows, basis: FloatArray, load: FloatArray | None = None) -> list[TorquePart]:
    """The variants of a part that the motion tells from others; basis: see `told`."""
    return [one for one in KINDS[name].variants(name, rows, load) if told(one, basis) > JOINT.told]


def _of_own_load(rows: JointRows, parts: list[TorquePart]) -> list[TorquePart]:
    """The parts with friction by the load that they have now, as long as that predicts better.

    When it was taken, parts that were still to come stood in the load.
    """
    fit = crossed(stacked(parts), rows)
    while own := [part for part in parts if part.name == "load_dependent_friction"]:
        variants = KINDS[own[0].name].variants(own[0].name, rows, load_of(Chosen(tuple(parts), fit)))
        newer = [variants[part.law] if part is own[0] else part for part in parts]
        better = crossed(stacked(newer), rows)
        loss = float(fit.held.sum())
        # without any noise it is rounding alone, of either sign
        if loss - float(better.held.sum()) <= (1.0 - JOINT.settled) * abs(loss):
            break
        parts, fit = newer, better
    return parts


def _pair(rows: JointRows, parts: Sequence[TorquePart], fit: Crossed, names: Collection[str]) -> list[TorquePart]:
    """The two parts that predict best together where each alone may explain nothing, as it is hidden by the other.

    So is friction that falls and rises again with speed, or a drift beside friction that was not taken yet. None where
    no two of them predict. Of two that both bend none is tried: they take what a form lacks that was not taken yet.
    """
    load = load_of(Chosen(tuple(parts), fit))
    basis = np.linalg.qr(stacked(parts))[0]
    some = [one for name in names for one in _told_variants(name, rows, basis, load)]
    if not some:
        return []
    columns = stacked(some)
    columns -= basis @ (basis.T @ columns)
    columns /= np.sqrt((columns**2).sum(axis=0))
    left = rows.torque - basis @ (basis.T @ rows.torque)
    own, pull, power = columns.T @ columns, columns.T @ left, float(left @ left)
    best: dict[tuple[str, str], tuple[float, int, int]] = {}
    for i, j in itertools.combinations(range(len(some)), 2):
        pair = some[i].name, some[j].name
        rest = own[i, i] * own[j, j] - own[i, j] ** 2
        if pair[0] == pair[1] or (some[i].shape and some[j].shape) or rest < JOINT.told * own[i, i] * own[j, j]:
            continue
        taken = own[j, j] * pull[i] ** 2 - 2 * own[i, j] * pull[i] * pull[j] + own[i, i] * pull[j] ** 2
        best[pair] = max(best.get(pair, (0.0, 0, 0)), (float(taken / rest), i, j))
    found = list[tuple[bool, float, list[TorquePart]]]()
    # what takes little off all of the data takes less off left-out ones
    for _, i, j in (one for one in best.values() if one[0] > JOINT.share * power):
        shape = some[i].shape + some[j].shape
        joined = TorquePart("pair", shape, np.hstack([some[i].columns, some[j].columns]))
        gain = gain_of([joined], parts, rows, fit)
        if gain.passed:
            # what has no shape to bend goes first
            found.append((not shape, gain.share, [some[i], some[j]]))
    return max(found, key=lambda pair: pair[:2])[2] if found else []


def _is_apart(part: TorquePart, beside: Sequence[TorquePart]) -> bool:
    """Whether the motion tells a part from others."""
    return told(part, np.linalg.qr(stacked(beside))[0]) > JOINT.told


def _of_best_form(rows: JointRows, parts: list[TorquePart]) -> list[TorquePart]:
    """The parts with the fewest forms of friction that predict as well as any; that by the load only where it must be.

    One by one, a form that is not the true one may come first and another one mend it. Whether a form is needed beside
    those that stay is asked elsewhere.
    """
    rest = [part for part in parts if part.name not in _FORMS]
    forms = {part.name: part for part in parts if part.name in _FORMS}
    taken, before = set(forms), crossed(stacked(parts), rows)
    by_load = forms.pop("load_dependent_friction", None)
    for name in OVER_SPEED if taken else ():
        basis = np.linalg.qr(stacked(rest))[0]
        variants = _told_variants(name, rows, basis)
        if name not in forms and variants:
            forms[name] = gain_of(variants, parts, rows, before).part
    if by_load is not None:
        forms[by_load.name] = by_load
    sets = [
        list(some)
        for count in range(len(forms) + 1)
        for some in itertools.combinations(forms.values(), count)
        # two bends at once would take what the form of the other one lacks
        if len({part.name for part in some} & {"square_friction", "curved_friction"}) < 2
        and all(not taken & kind or kind & {part.name for part in some} for kind in (_LEVEL, _CHANGES))
        and all(_is_apart(part, [*rest, *(one for one in some if one is not part)]) for part in some)
    ]
    if not sets:
        # a form that the motion does not tell was taken for others' sake: whether it stays is asked elsewhere
        return parts
    fits = [crossed(stacked([*rest, *some]), rows).held for some in sets]
    best = min(fits, key=lambda held: float(held.sum()))
    good = [n for n, held in enumerate(fits) if not surely(held - best, held)]

    def rank(n: int) -> tuple[bool, int, bool, float]:
        # what has no shape to bend goes first
        bent = any(part.shape for part in sets[n])
        return any(part is by_load for part in sets[n]), len(sets[n]), bent, float(fits[n].sum())

    return [*rest, *sets[min(good, key=rank)]]


def _judged(rows: JointRows, parts: list[TorquePart], not_told: set[str], moves: Mapping[str, float]) -> Chosen:
    """Drop what no longer helps beside the others; list what would do in place of each that stays."""
    slow, fast = np.quantile(np.abs(rows.speed), (0.1, 0.9))
    while True:
        fit = crossed(stacked(parts), rows)
        gains, alternatives, of_forms = {}, {}, np.zeros(len(fit.values))
        now = Chosen(tuple(parts), fit)
        for part in parts:
            if part.name in BODIES:
                continue
            rest = [p for p in parts if p is not part]
            before = crossed(stacked(rest), rows)
            gains[part.name] = gain_of([part], rest, rows, before)
            if part.name in KINDS:
                instead = _gains(rows, rest, before, set())
                alike = [n for n, g in instead.items() if n != part.name and not g.is_worse_than(gains[part.name])]
                alternatives[part.name] = tuple(alike)
                # beside a curved part dry friction is what is left at high speed: another number
                forms = [instead[n].part for n in alike if {n, part.name} == _ALIKE]
                of_forms = np.maximum(of_forms, _of_another(rows, parts, part, forms, fit))
                # at few speeds viscous and square friction together are as good as either; near one their sum is said
                apart = _ALIKE if fast >= JOINT.speeds * slow else set()
                both = [n for n in alike if {n, part.name} == apart or not {n, part.name} <= set(OVER_SPEED)]
                beside = [instead[n].part for n in both]
                of_forms = np.maximum(of_forms, _of_one_more(rows, parts, part, beside, fit))
        weak = [name for name, gain in gains.items() if not gain.passed or not _is_sure(now, name)]
        if not weak:
            # what is left beyond the noise may be of any form: as much of it may belong to each part
            left = max(float(fit.held.mean()) * len(fit.held) / len(rows.time) - floor_of(now, rows) ** 2, 0.0)
            size = np.sqrt((stacked(parts) ** 2).mean(axis=0))
            by_law = np.maximum(_of_laws(rows, parts, now), of_forms)
            by_law = np.hypot(by_law, np.sqrt(left) / np.maximum(size, 1e-300))
            of_parts = [moves.get(part.name, 0.0) for part in parts for _ in range(part.columns.shape[1])]
            by_law = np.hypot(np.hypot(by_law, of_parts), _of_time(rows, parts))
            return Chosen(tuple(parts), fit, alternatives, tuple(sorted(not_told)), by_law)
        worst = min(weak, key=lambda name: gains[name].share)
        parts = [p for p in parts if p.name != worst]


def _of_laws(rows: JointRows, parts: list[TorquePart], now: Chosen) -> FloatArray:
    """By how much coefficients move when a part follows another law of its kind: none of them need be the true one."""
    found = np.zeros(len(now.fit.values))
    for place, part in enumerate(parts):
        if part.name not in KINDS or len(KINDS[part.name].laws) == 1:
            continue
        for law in range(len(KINDS[part.name].laws)):
            if law == part.law:
                continue
            variants = [v for v in KINDS[part.name].variants(part.name, rows, load_of(now)) if v.law == law]
            fits = [crossed(stacked([*parts[:place], v, *parts[place + 1 :]]), rows) for v in variants]
            other = min(fits, key=lambda fit: float(fit.held.sum()))
            found = np.maximum(found, np.abs(other.values - now.fit.values))
    return found


def _of_time(rows: JointRows, parts: list[TorquePart]) -> FloatArray:
    """By how much coefficients move when the torque is taken within a sample of its time, as far as the data allow."""
    columns = stacked(parts)
    fit = crossed(np.hstack([columns, rows.torque_rate[:, None]]), rows)
    late = min(rows.step_s / 2, abs(float(fit.values[-1])) + 2 * float(fit.errors[-1]))
    return np.asarray(np.abs(np.linalg.lstsq(columns, rows.torque_rate * late, rcond=None)[0]))


def _of_another(
    rows: JointRows, parts: list[TorquePart], part: TorquePart, instead: list[TorquePart], fit: Crossed
) -> FloatArray:
    """By how much the coefficients of the other parts move when one of `instead` stands in the place of a part."""
    found = np.zeros(len(fit.values))
    own = [part is one for one in parts for _ in range(one.columns.shape[1])]
    for other in instead:
        moved = np.abs(crossed(stacked([other if one is part else one for one in parts]), rows).values - fit.values)
        found = np.maximum(found, np.where(own, 0.0, moved))
    return found


def _of_one_more(
    rows: JointRows, parts: list[TorquePart], part: TorquePart, more: list[TorquePart], fit: Crossed
) -> FloatArray:
    """By how much the coefficients of a part move when one of `more`, which would do in its place, stands beside it.

    Both may be there: then the part that was taken has of the other one what its own form can hold.
    """
    found = np.zeros(len(fit.values))
    own = [part is one for one in parts for _ in range(one.columns.shape[1])]
    for other in more:
        moved = np.abs(crossed(stacked([*parts, other]), rows).values[: len(found)] - fit.values)
        most = JOINT.of_another * np.abs(fit.values)
        found = np.maximum(found, np.where(own, np.minimum(moved, most), 0.0))
    return found


def _is_sure(now: Chosen, name: str) -> bool:
    part = next(p for p in now.parts if p.name == name)
    if part.columns.shape[1] > 1:
        return True
    value, error = now.value(name)
    return abs(value) > JOINT.errors * error


def without_outliers(rows: JointRows) -> tuple[JointRows, int]:
    """Rows without single ones far off a rich model, where they are few."""
    friction = first_of_kinds(rows, "dry_friction", "viscous_friction", "direction_dependent_friction")
    parts = [*base_of(rows), *friction]
    left = rows.torque - stacked(parts) @ crossed(stacked(parts), rows).values
    far = np.abs(left - np.median(left)) > JOINT.far_off * 1.4826 * np.median(np.abs(left - np.median(left)))
    return (rows.where(~far), int(far.sum())) if 0 < far.mean() < JOINT.most_far_off else (rows, 0)
