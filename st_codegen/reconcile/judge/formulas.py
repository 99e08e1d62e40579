"""The simplest expression that the data hold for what no effect explains: sparse regression over a small library.

Each term is a function of the operating point with a complex amplitude of its own for each direction. Terms are taken
one after the other as long as they predict left-out runs better by more than their parameters cost. Terms that the
runs cannot tell from one that was taken are said beside it: of two temperatures nobody can say whether something grows
in proportion or with the square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.effects.empirical import TERMS, term_values

_CONDITIONS = ("speeds", "torques", "oil temperatures")


@dataclass(frozen=True)
class Formula:
    """An expression for one order.

    terms: name -> complex amplitude (deg) forward and backward, of the term at 1; explains: share of the power that
    is no noise; stable: share of left-out blocks that it predicts better than nothing does; text: a sentence without
    its subject; amplitude_deg: the largest over the measured runs.
    """

    terms: dict[str, tuple[complex, complex]]
    explains: float
    stable: float
    text: str
    amplitude_deg: float


def formula_of(target: FitData, r: ComplexArray, column: int) -> Formula | None:
    """The formula of the residual r (n,) of one order (its column), or None where no short one holds."""
    good = target.good
    at, y = target.data.at.rows(good), r[good]
    sigma = target.sigma[good, column]
    parts = 1 if target.data.orders[column] == 0 else 2
    library = {name: term_values(name, at, target.reference_temperature_C) for name in TERMS}
    library = {name: values for name, values in library.items() if name == "constant" or np.ptp(values) > 1e-9}
    chosen: list[str] = []
    noise = parts * len(y)
    loss = float((np.abs(y / sigma) ** 2).sum())
    whole = loss
    price = SETTINGS.term_price * (np.log(len(y)) + 2.0) * parts * len(np.unique(at.sign))
    while len(chosen) < SETTINGS.most_terms:
        trials = {
            name: _loss([*(library[n] for n in chosen), values], at, y, sigma)
            for name, values in library.items()
            if name not in chosen
        }
        best = min(trials, key=lambda name: trials[name])
        # what is still structure after a term must be worth another one
        if loss - trials[best] < max(price, SETTINGS.term_share * max(whole - noise, 0.0)):
            break
        chosen.append(best)
        loss = trials[best]
    if not chosen:
        return None
    margin = price * max(loss / noise, 1.0)
    # what is said beside a term holds beside the simplest of the others: a second time, when these are known
    as_well = [_as_well(chosen, library, at, y, sigma, margin) for _ in range(2)][-1]
    loss = _loss([library[name] for name in chosen], at, y, sigma)
    explains = float(np.clip((whole - loss) / max(whole - noise, 1e-300), 0.0, 1.0))
    if explains < SETTINGS.formula_explains:
        return None
    return _formula(chosen, as_well, library, at, y, sigma, explains)


def _as_well(
    chosen: list[str], library: dict[str, FloatArray], at: Conditions, y: ComplexArray, sigma: FloatArray, margin: float
) -> dict[str, list[str]]:
    """The terms in whose place others lose no more than `margin`, with these; the simplest of them is `chosen` then."""
    found = {}
    for place, name in enumerate(list(chosen)):
        others = [library[other] for other in chosen if other != name]
        free = [other for other in library if other == name or other not in chosen]
        losses = {other: _loss([*others, library[other]], at, y, sigma) for other in free}
        good = [other for other in free if losses[other] <= min(losses.values()) + margin]
        chosen[place], *rest = sorted(good, key=lambda other: (sum(map(abs, TERMS[other][0])), losses[other]))
        found[chosen[place]] = rest
    return found


def _solved(columns: list[FloatArray], at: Conditions, y: ComplexArray, sigma: FloatArray) -> dict[float, ComplexArray]:
    """Amplitudes of terms for each direction, by weighted least squares."""
    found = {}
    for sign in np.unique(at.sign):
        rows = at.sign == sign
        design = np.stack([column[rows] / sigma[rows] for column in columns], axis=1)
        found[float(sign)] = np.linalg.lstsq(design.astype(np.complex128), y[rows] / sigma[rows], rcond=1e-10)[0]
    return found


def _predicted(columns: list[FloatArray], at: Conditions, amplitudes: dict[float, ComplexArray]) -> ComplexArray:
    design = np.stack(columns, axis=1)
    found = np.zeros(len(at), np.complex128)
    for sign, values in amplitudes.items():
        rows = at.sign == sign
        found[rows] = design[rows] @ values
    return found


def _loss(columns: list[FloatArray], at: Conditions, y: ComplexArray, sigma: FloatArray) -> float:
    return float((np.abs((y - _predicted(columns, at, _solved(columns, at, y, sigma))) / sigma) ** 2).sum())


def _formula(
    chosen: list[str],
    as_well: dict[str, list[str]],
    library: dict[str, FloatArray],
    at: Conditions,
    y: ComplexArray,
    sigma: FloatArray,
    explains: float,
) -> Formula | None:
    columns = [library[name] for name in chosen]
    amplitudes = _solved(columns, at, y, sigma)
    block = np.arange(len(y)) * SETTINGS.formula_blocks // len(y)
    shuffled = np.random.default_rng(0).permutation(block)
    better = []
    for number in range(SETTINGS.formula_blocks):
        out = shuffled == number
        if not out.any() or len(np.unique(at.sign[~out])) < len(np.unique(at.sign)):
            continue
        own = _solved([c[~out] for c in columns], at.rows(~out), y[~out], sigma[~out])
        left = y[out] - _predicted([c[out] for c in columns], at.rows(out), own)
        better.append(float((np.abs(left / sigma[out]) ** 2).sum() < (np.abs(y[out] / sigma[out]) ** 2).sum()))
    stable = float(np.mean(better)) if better else 0.0
    if stable < SETTINGS.stable:
        return None
    size = np.abs(_predicted(columns, at, amplitudes))
    row = int(np.argmax(size))
    one, other = amplitudes[max(amplitudes)], amplitudes[min(amplitudes)]
    terms = {name: (complex(one[i]), complex(other[i])) for i, name in enumerate(chosen)}
    parts = [_words(name, as_well[name]) for name in sorted(chosen, key=lambda name: name == "constant")]
    law = " and ".join(parts)
    powers = np.array([TERMS[name][0] for name in chosen])
    varying = np.flatnonzero(powers.any(axis=0))
    words = (f"{at.speed_rpm[row]:g} rpm", f"{at.torque_Nm[row]:g} N m", f"{at.temperature_C[row]:g} degC")
    where = "at " + ", ".join(words[i] for i in varying) if len(varying) else "at every operating point"
    text = f"{law}: {size[row]:.3g} deg {where}"
    levels = [len(np.unique(axis)) for axis in (at.speed_rpm, at.torque_Nm, at.temperature_C)]
    if few := [_CONDITIONS[i] for i in varying if levels[i] == 2]:
        text += f" (two {' and two '.join(few)} tell no law between them)"
    if explains < SETTINGS.formula_whole:
        text += f" (that is {100 * explains:.0f} % of it)"
    return Formula(terms, explains, stable, text, float(size[row]))


def _words(name: str, others: list[str]) -> str:
    """What a term does, and what the runs allow in its place."""
    if not others:
        return TERMS[name][1]
    more = f", and {len(others) - 1} more" if len(others) > 1 else ""
    return f"{TERMS[name][1]} (the runs tell as little against: {TERMS[others[0]][1]}{more})"
