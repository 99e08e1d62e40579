"""The simplest expression that the data hold for what no effect explains: sparse regression over a small library.

Each term is a function of the operating point with a complex amplitude of its own for each direction. Terms are taken
one after the other as long as they save more than their parameters cost. A term is said only where levels of speed,
torque and oil temperature that are left out in turn are predicted better with it than without it; and the whole only
where a search among the other runs predicts those that are left out. Terms that the runs cannot tell from one that was
taken are said beside it: of two temperatures nobody can say whether something grows in proportion or with the square.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.contrasts import AXES, CONDITIONS, axes_together, levels_by_condition
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.effects.empirical import TERMS, term_values

_CONDITIONS = ("speeds", "torques", "oil temperatures")


@dataclass(frozen=True)
class Formula:
    """An expression for one order.

    terms: name -> complex amplitude (deg) forward and backward, of the term at 1; explains: share of the power that
    is no noise, of runs that were left out; text: a sentence without its subject; amplitude_deg: the largest over the
    measured runs; conditions: those that the sentence names (`speed`, `torque`, `temperature`).
    """

    terms: dict[str, tuple[complex, complex]]
    explains: float
    text: str
    amplitude_deg: float
    conditions: frozenset[str]

    def values(self, at: Conditions, reference_C: float) -> ComplexArray:
        """What it makes of the order at operating points, complex128 (n,), deg."""
        found = np.zeros(len(at), np.complex128)
        for name, (forward, backward) in self.terms.items():
            found += np.where(at.sign > 0, forward, backward) * term_values(name, at, reference_C)
        return found


@dataclass(frozen=True)
class _Rows:
    """Runs of one order, by direction: the matrices of the normal equations of the whole library.

    gram: (directions, m, m), right: complex (directions, m), power: (directions,), of rows weighed by their noise;
    count: rows; parts: numbers that each has.
    """

    gram: FloatArray
    right: ComplexArray
    power: FloatArray
    count: int
    parts: int

    def __sub__(self, other: _Rows) -> _Rows:
        return _Rows(
            self.gram - other.gram, self.right - other.right, self.power - other.power, self.count - other.count,
            self.parts,
        )  # fmt: skip

    def solved(self, terms: Sequence[int]) -> ComplexArray:
        """Amplitudes of terms, (directions, terms)."""
        found = np.zeros((len(self.gram), len(terms)), np.complex128)
        pairs = zip(self.gram, self.right, strict=True)
        for side, (gram, right) in enumerate(pairs if terms else ()):
            of_terms = gram[np.ix_(terms, terms)].astype(np.complex128)
            found[side] = np.linalg.lstsq(of_terms, right[terms], rcond=1e-10)[0]
        return found

    def tells(self, terms: Sequence[int]) -> bool:
        """Whether these rows determine the amplitudes of terms."""
        ranks = [np.linalg.matrix_rank(gram[np.ix_(terms, terms)], rtol=1e-10, hermitian=True) for gram in self.gram]
        return bool(min(ranks) == len(terms))

    def loss(self, terms: Sequence[int], amplitudes: ComplexArray) -> float:
        """The sum of squares in noises that these amplitudes leave of the rows."""
        total = float(self.power.sum())
        for gram, right, x in zip(self.gram, self.right, amplitudes, strict=True):
            total += float((x.conj() @ gram[np.ix_(terms, terms)] @ x - 2.0 * (x.conj() @ right[terms])).real)
        return max(total, 0.0)

    def best(self, count: int, size: int) -> list[int]:
        """The choice of so many of `count` terms that leaves least."""
        choices = np.array(list(itertools.combinations(range(count), size)))
        grams = self.gram[:, choices[:, :, None], choices[:, None, :]]
        # terms that these rows do not tell apart are as good as one of them
        ridge = 1e-10 * np.trace(grams, axis1=2, axis2=3)[..., None, None] * np.eye(size) + 1e-300 * np.eye(size)
        right = self.right[:, choices]
        saved = (right.conj() * np.linalg.solve(grams + ridge, right[..., None])[..., 0]).sum(axis=2).real.sum(axis=0)
        return [int(term) for term in choices[int(np.argmax(saved))]]

    def least(self, terms: Sequence[int]) -> float:
        """The loss with the best amplitudes of terms."""
        return self.loss(terms, self.solved(terms))

    @property
    def noise(self) -> float:
        """The loss to expect of these runs where noise of the known size is all there is: one a number."""
        return float(self.parts * self.count)

    @property
    def price(self) -> float:
        """The loss that a term must save to be added: more than noise would, of as many terms as are tried."""
        return float(SETTINGS.term_price * (np.log(max(self.count, 1)) + 2.0) * self.parts * len(self.gram))


@dataclass(frozen=True)
class _Fold:
    """Rows that are left out: these, the others, and whether enough levels stay to tell one law from another."""

    out: _Rows
    rest: _Rows
    tells_laws: bool


@dataclass(frozen=True)
class _Problem:
    """The good runs of one order and what terms are at each: y complex (n,), sigma (n,), columns (n, m).

    size: RMS of each term, (m,), by which its column is divided: what runs tell depends on no unit.
    """

    at: Conditions
    y: ComplexArray
    sigma: FloatArray
    columns: FloatArray
    size: FloatArray
    names: tuple[str, ...]
    parts: int

    def rows(self, choice: BoolArray) -> _Rows:
        """The runs that a mask chooses."""
        grams, rights, powers = [], [], []
        for rows in (choice & side for side in self.at.by_direction()):
            design, y = self.columns[rows] / self.sigma[rows, None], self.y[rows] / self.sigma[rows]
            grams.append(design.T @ design)
            rights.append(design.T @ y)
            powers.append(float((np.abs(y) ** 2).sum()))
        return _Rows(np.array(grams), np.array(rights), np.array(powers), int(choice.sum()), self.parts)

    @cached_property
    def all(self) -> _Rows:
        """The sums of products over all runs, none left out."""
        return self.rows(np.ones(len(self.y), bool))

    @cached_property
    def folds(self) -> dict[str, list[_Fold]]:
        """By axis the levels that are left out in turn; of two levels the one says nothing of the other."""
        found = {}
        for name, level in levels_by_condition(self.at).items():
            count = len(np.unique(level))
            block = level * SETTINGS.formula_blocks // count if count > SETTINGS.formula_blocks else level
            blocks = [block == n for n in np.unique(block)] if count > 2 else []
            tells = count > 3
            found[name] = [_Fold(rows := self.rows(out), self.all - rows, tells) for out in blocks]
        return found


def formula_of(target: FitData, r: ComplexArray, column: int, floor: float) -> Formula | None:
    """The formula of the residual r (n,) of one order (its column), or None where no short one holds.

    floor: RMS of one component of the noise; how far runs scatter may be more of what is unexplained.
    """
    good = target.good
    sigma = target.sigma[good, column]
    sigma = sigma * min(1.0, floor / float(np.sqrt((sigma**2).mean())))
    at = target.data.at.rows(good)
    library = {name: term_values(name, at, target.reference_temperature_C) for name in TERMS}
    library = {name: values for name, values in library.items() if name == "constant" or np.ptp(values) > 1e-9}
    values = np.stack(list(library.values()), axis=1)
    size, parts = np.sqrt((values**2).mean(axis=0)), 1 if target.data.orders[column] == 0 else 2
    problem = _Problem(at, r[good], sigma, values / size, size, tuple(library), parts)
    chosen = _held(problem, _search(problem.all, problem.names)[0])
    if not chosen:
        return None
    chosen, as_well = _search(problem.all, problem.names, chosen)
    explains = _explains(problem, chosen)
    # several powers of one condition follow any law of it a little
    least = SETTINGS.formula_whole if _is_a_polynomial(problem, chosen) else SETTINGS.formula_explains
    if explains < least:
        return None
    return _formula(problem, chosen, as_well, explains)


def _is_a_polynomial(problem: _Problem, chosen: Sequence[int]) -> bool:
    """Whether two terms are powers of the same condition alone."""
    powers = [np.flatnonzero(TERMS[problem.names[term]][0]).tolist() for term in chosen]
    alone = [axes[0] for axes in powers if len(axes) == 1]
    return len(set(alone)) < len(alone)


def _search(
    rows: _Rows, names: Sequence[str], given: Sequence[int] | None = None, most: int = SETTINGS.most_terms
) -> tuple[list[int], dict[int, list[int]]]:
    """The terms that rows hold, at most so many, or the `given` ones; and what does as well in the place of each.

    Each is the simplest of those that do.
    """
    chosen: list[int] = list(given or ())
    loss = whole = float(rows.power.sum())
    while given is None and len(chosen) < min(most, len(names)):
        # the best of all choices of so many: one after the other takes what two others together do
        best = rows.best(len(names), len(chosen) + 1)
        left = rows.least(best)
        # what is still structure after a term must be worth another one
        if loss - left < max(rows.price, SETTINGS.term_share * max(whole - rows.noise, 0.0)):
            break
        chosen, loss = best, left
    margin = rows.price * max(rows.least(chosen) / max(rows.noise, 1.0), 1.0) if chosen else 0.0
    found: dict[int, list[int]] = {}
    # what is said beside a term holds beside the simplest of the others: a second time, when these are known
    for _ in range(2):
        found = {}
        for place, term in enumerate(list(chosen)):
            others = [other for other in chosen if other != term]
            free = [other for other in range(len(names)) if other == term or other not in chosen]
            losses = {other: rows.least([*others, other]) for other in free}
            good = [other for other in free if losses[other] <= min(losses.values()) + margin]
            powers = {other: sum(map(abs, TERMS[names[other]][0])) for other in good}
            chosen[place], *rest = sorted(good, key=lambda other: (powers[other], losses[other]))
            found[chosen[place]] = rest
    # a simpler one in the place of another may leave nothing to a third
    needless = [term for term in chosen if rows.least([o for o in chosen if o != term]) - rows.least(chosen) < margin]
    if needless and len(chosen) > 1:
        most_needless = min(needless, key=lambda term: rows.least([other for other in chosen if other != term]))
        return _search(rows, names, [other for other in chosen if other != most_needless])
    return chosen, found


def _held(problem: _Problem, chosen: list[int]) -> list[int]:
    """The terms without which each kind of left-out runs is predicted worse; the poorest goes first."""
    while chosen:
        worth = {term: _worth(problem, chosen, term) for term in chosen}
        poorest = min(worth, key=lambda term: worth[term])
        if worth[poorest] > 0.0:
            return chosen
        chosen = [term for term in chosen if term != poorest]
    return []


def _worth(problem: _Problem, chosen: list[int], term: int) -> float:
    """What a term saves of left-out levels, on the axis where it saves least, in squared noises.

    Levels that alone determine some of the amplitudes say nothing; an axis of which all do tells no law along it.
    """
    others, worst = [one for one in chosen if one != term], np.inf
    for folds in problem.folds.values():
        told = [fold for fold in folds if fold.rest.tells(chosen)]
        saved = [
            fold.out.loss(others, fold.rest.solved(others)) - fold.out.loss(chosen, fold.rest.solved(chosen))
            for fold in told
        ]
        if folds:
            worst = min(worst, sum(saved))
    return float(worst)


def _explains(problem: _Problem, chosen: list[int]) -> float:
    """Share of what is no noise that as many terms, searched among the other runs, predict of left-out ones.

    That of the poorest axis, and no more than the chosen terms explain of all runs.
    """
    whole, noise = float(problem.all.power.sum()), problem.all.noise
    shares = []
    for folds in problem.folds.values():
        left = 0.0
        for fold in folds if all(fold.tells_laws for fold in folds) else ():
            terms = _search(fold.rest, problem.names, most=len(chosen))[0]
            left += fold.out.loss(terms, fold.rest.solved(terms))
        if left:
            shares.append((whole - left) / max(whole - noise, 1e-300))
    own = (whole - problem.all.least(chosen)) / max(whole - noise, 1e-300)
    return float(np.clip(min([own, *shares]), 0.0, 1.0))


def _formula(problem: _Problem, chosen: list[int], as_well: dict[int, list[int]], explains: float) -> Formula:
    """The sentence of a formula, and its amplitudes."""
    at, names = problem.at, problem.names
    solved = problem.all.solved(chosen)
    by_term = problem.columns[:, chosen] * solved[np.searchsorted(np.unique(at.sign), at.sign)]
    values = by_term.sum(axis=1)
    sizes = solved / problem.size[chosen]
    terms = {names[term]: (complex(sizes[-1, i]), complex(sizes[0, i])) for i, term in enumerate(chosen)}
    varying = [int(axis) for axis in np.flatnonzero(np.array([TERMS[name][0] for name in terms]).any(axis=0))]
    # 3 % of a power are a sixth of a size: what is called constant must be all of it, as far as it is shown
    is_whole = explains >= SETTINGS.formula_whole if varying else round(explains, 2) == 1.0
    # what takes from the others in most runs is said to
    takes = dict(zip(chosen, ((values.conj()[:, None] * by_term).sum(axis=0).real < 0.0).tolist(), strict=True))
    listed = sorted(chosen, key=lambda term: (takes[term], names[term] == "constant"))
    parts = [_words(names[term], [names[other] for other in as_well[term]]) for term in listed]
    if not varying and not is_whole:
        parts = [part.replace("is constant", "is mostly constant", 1) for part in parts]
    law = " and ".join(f"less what {part}" if takes[term] else part for term, part in zip(listed, parts, strict=True))
    text = _where_largest(at, values, varying, law.replace(" and less what", ", less what"))
    levels = [len(np.unique(axis)) for axis in at.axes]
    if few := [_CONDITIONS[i] for i in varying if levels[i] == 2]:
        text += f" (two {' and two '.join(few)} tell no law between them)"
    in_words = [*terms, *(names[as_well[term][0]] for term in listed if as_well[term])]
    named = {AXES[axis] for name in in_words for axis in np.flatnonzero(TERMS[name][0])}
    for one, other in axes_together(at):
        if (CONDITIONS.index(one) in varying) != (CONDITIONS.index(other) in varying):
            text += f" ({one} and {other} go together in these runs: it may depend on either)"
            named |= {AXES[CONDITIONS.index(one)], AXES[CONDITIONS.index(other)]}
    left, chance = problem.all.least(chosen) - problem.all.noise, np.sqrt(2.0 * problem.parts * problem.all.count)
    if varying and is_whole and left > SETTINGS.told * chance:
        text += (
            f" (that is {min(100 * explains, 99.9):.3g} % of it, and what is left is more than the known noise: its "
            "law may be another, or runs differ)"
        )
    elif not is_whole:
        rest = "its law may be another" if varying else "the rest may differ from one of them to another"
        text += f" (that is {100 * explains:.0f} % of it: {rest})"
    return Formula(terms, explains, text, float(np.abs(values).max()), frozenset(named))


def _where_largest(at: Conditions, values: ComplexArray, varying: list[int], law: str) -> str:
    """A law in words with its largest size and where that is, or with what a wave does that keeps its size.

    values: of the law in each run, deg; varying: the conditions (of speed, torque, oil temperature) in the law.
    """
    size = np.abs(values)
    row = int(np.argmax(size))
    keeps = varying and size.min() > (1.0 - SETTINGS.keeps_its_size) * size[row]
    turns = max(float(np.ptp(_turned(values[at.sign == sign]))) for sign in np.unique(at.sign)) if keeps else 0.0
    if turns > SETTINGS.least_turn_rad:
        # several terms may make up a wave that hardly grows
        return (
            f"keeps its size, {size.min():.3g} to {size[row]:.3g} deg, and turns its phase by {turns:.2g} rad over the "
            f"{' and the '.join(_CONDITIONS[i] for i in varying)} (in the terms of a formula it {law})"
        )
    words = (f"{at.speed_rpm[row]:g} rpm", f"{at.torque_Nm[row]:g} N m", f"{at.temperature_C[row]:g} degC")
    where = "at " + ", ".join(words[i] for i in varying) if varying else "in the mean of the operating points"
    return f"{law}: {size[row]:.3g} deg {where}"


def _turned(values: ComplexArray) -> FloatArray:
    """The phase of values (n,) against their mean direction, rad."""
    middle = complex((values / np.abs(values)).sum())
    return np.angle(values / middle) if abs(middle) > 0.0 else np.angle(values)


def _words(name: str, others: list[str]) -> str:
    """What a term does, and what the runs allow in its place."""
    if not others:
        return TERMS[name][1]
    more = f", and {len(others) - 1} more" if len(others) > 1 else ""
    return f"{TERMS[name][1]} (the runs tell as little against: {TERMS[others[0]][1]}{more})"
