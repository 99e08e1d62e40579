"""Other methods on the same cases: plain stepwise regression, and sparse regression by `pysindy` where installed.

Neither knows a machine: both fit, order by order, a polynomial in speed, torque, temperature and direction to the
difference of the data and the rig model. They name nothing, so what can be compared is: which orders they speak of,
whether they are silent where nothing is missing, and what is left on fresh runs, free of noise. They are given the
measured curves; files that cannot be read are left out for them.
"""

from __future__ import annotations

import importlib.util
import itertools
import json
import shutil
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from . import cases, comparison
from .make import Truth, make
from .points import DIRECTIONS, Array, Complex, Points, rms_by_order, spectrum

DEGREE = 3
#: chance of a false order in a whole case, shared by all orders and terms
CHANCE = 0.01
MOST_TERMS = 12

#: (library at the measured points, parts of each order's amplitude) -> coefficients (terms, columns)
Fit = Callable[[Array, Array, int], Array]


def library(points: Points, like: Points) -> Array:
    """Monomials up to degree 3, (2 * points, terms); conditions are scaled by the ranges of `like`."""
    columns = []
    for key in ("speed", "torque", "temperature"):
        low, high = getattr(like, key).min(), getattr(like, key).max()
        if high > low:
            columns.append(points.both(2 * (getattr(points, key) - low) / (high - low) - 1).ravel())
    direction = np.tile(DIRECTIONS, len(points))
    terms = []
    for degree in range(DEGREE + 1):
        for chosen in itertools.combinations_with_replacement(range(len(columns)), degree):
            value = np.prod([columns[c] for c in chosen], axis=0) if chosen else np.ones(len(direction))
            terms.append(value)
            if degree < DEGREE:
                terms.append(value * direction)
    return np.stack(terms, axis=1)


def stepwise(terms: Array, values: Array, tests: int) -> Array:
    """Forward selection by the F-test: a term enters for all columns of an order (cosine and sine) together."""
    from scipy.stats import f as distribution

    count, width = values.shape
    out = np.zeros((terms.shape[1], width))
    chosen: list[int] = []
    left = values
    while len(chosen) < min(MOST_TERMS, count // 4):
        # what is orthogonal to the terms chosen already
        base = np.linalg.qr(terms[:, chosen])[0] if chosen else np.zeros((count, 0))
        rest = terms - base @ (base.T @ terms)
        size = np.linalg.norm(rest, axis=0)
        usable = size > 1e-6 * np.linalg.norm(terms, axis=0)
        gain = np.zeros(terms.shape[1])
        gain[usable] = np.sum((rest[:, usable].T @ left / size[usable, None]) ** 2, axis=1)
        best = int(np.argmax(gain))
        freedom = width * (count - len(chosen) - 1)
        spread = (np.sum(left**2) - gain[best]) / freedom
        if gain[best] <= 0 or distribution.sf(gain[best] / width / spread, width, freedom) > CHANCE / tests:
            break
        chosen.append(best)
        out[chosen] = np.linalg.lstsq(terms[:, chosen], values, rcond=None)[0]
        left = values - terms @ out
    return out


def sparse(terms: Array, values: Array, tests: int) -> Array:
    """Sequentially thresholded least squares of `pysindy` on terms of unit norm, threshold at the level of chance."""
    from pysindy.optimizers import STLSQ
    from scipy.stats import norm

    size = np.linalg.norm(terms, axis=0)
    scaled = terms / size
    fitted = scaled @ np.linalg.lstsq(scaled, values, rcond=None)[0]
    spread = np.sqrt(np.sum((values - fitted) ** 2) / values.shape[1] / max(1, len(values) - terms.shape[1]))
    model = STLSQ(threshold=float(norm.isf(CHANCE / tests / 2) * spread))
    with warnings.catch_warnings():
        # it warns wherever nothing passes, which is the rule here
        warnings.simplefilter("ignore")
        model.fit(scaled, values)
    return np.asarray(model.coef_).T / size[:, None]


PEERS: dict[str, Fit] = {"stepwise": stepwise, "pysindy": sparse}


def parts_of(amplitudes: Complex) -> Array:
    """(runs, 2) complex -> (2 * runs, 2): cosine and sine part."""
    flat = amplitudes.ravel()
    return np.stack([flat.real, flat.imag], axis=1)


def explain(truth: Truth, fit: Fit) -> tuple[list[int], Complex, Array]:
    """Orders that the method speaks of; what it adds at fresh runs (runs, 2, orders); RMS of that at the measured."""
    limit = truth.samples // 4
    runs = np.array([row for row in range(len(truth.points)) if row not in truth.unreadable])
    labels = truth.data.points.take(runs)
    found = spectrum((truth.data.te - truth.known)[runs])[..., :limit]
    here, there = library(labels, labels), library(truth.new_points, labels)
    added = np.zeros((len(truth.new_points), 2, limit), dtype=np.complex128)
    measured = np.zeros((len(runs), 2, limit), dtype=np.complex128)
    orders = []
    for order in range(limit):
        values = parts_of(found[..., order])
        values = values[:, :1] if order == 0 else values
        coefficients = fit(here, values, limit * here.shape[1])
        if not np.any(coefficients):
            continue
        orders.append(order)
        for terms, out in ((there, added), (here, measured)):
            value = terms @ coefficients
            whole = value[:, 0] if order == 0 else value[:, 0] + 1j * value[:, 1]
            out[..., order] = whole.reshape(-1, 2)
    return orders, added, rms_by_order(measured)


def run_case(case: cases.Case, work: Path, fit: Fit) -> dict[str, Any]:
    folder = work / f"{case.number}-peer"
    shutil.rmtree(folder, ignore_errors=True)
    truth = make(case, folder)
    orders, added, _ = explain(truth, fit)
    shutil.rmtree(folder, ignore_errors=True)
    return {"case": case.plain(), "truth": truth.plain()} | comparison.judge(truth, orders, added)


def main(peer: str, wanted: Sequence[cases.Case], work: Path, jobs: int, path: Path, say: Callable[[str], None]) -> int:
    """Run a peer over the cases; exit code 0 with a message where it is not installed."""
    if peer == "pysindy" and importlib.util.find_spec("pysindy") is None:
        say("pysindy is not installed: skipped (pip install pysindy)")
        return 0
    results = []
    with ThreadPoolExecutor(jobs) as pool:
        for result in pool.map(lambda case: run_case(case, work, PEERS[peer]), wanted):
            results.append(result)
            after, before, _ = result["fresh_gap"]
            say(f"[{len(results)}/{len(wanted)}] {result['case']['name']}: orders {result['orders'][:8]}, "
                f"gap on fresh runs {before:.2g} -> {after:.2g} deg")  # fmt: skip
    rates = comparison.table(results)
    path.write_text(json.dumps({"peer": peer, "summary": rates, "cases": results}, indent=1) + "\n")
    say("\n".join([*comparison.lines(rates), f"written to {path}"]))
    return 0
