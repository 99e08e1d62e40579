"""Standard errors of what was found, with what the forms of effects lack.

That is a Gaussian process over the operating point of each order (Kennedy and O'Hagan, 2001): a model without it is
confidently wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.target import by_place
from st_codegen.reconcile.judge.misread import covariance_of_corrections
from st_codegen.reconcile.rest.lasting import power_of_mean
from st_codegen.reconcile.rest.structure import floors, is_lacking
from st_codegen.reconcile.search.candidates import Search
from st_codegen.reconcile.search.states import in_forms_as_good, vector_in_form
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Catalogue, Conditions, Form, Stage


@lru_cache(maxsize=4)
def covariance_with_discrepancy(fit: Fit, *, at_most: bool = False) -> FloatArray:
    """Covariance of the coordinates of a fit, (p, p), that allows for forms which are not quite the machine's.

    Beside what leaving levels out shows, each order that keeps structure has a discrepancy: a Gaussian process as
    large as what is left there, and as smooth as the range of the conditions is wide. What it makes of a coordinate
    is linear at the solution. Samples over time have no operating points to tell one by. Noise that lasts over runs has
    a mean, what both directions have of it and what turns with them; see `power_of_mean` for at_most.
    """
    found: FloatArray = fit.covariance_with_form
    if fit.target.data.angle_rad is not None:
        return found
    left, means = left_power(fit), power_of_mean(fit.target, fit.residual, at_most=at_most)
    pulled = np.zeros_like(found)
    weights = fit.target.weights(fit.residual)
    root = _root_of_kernel(fit.target.data.at) if left.any() else np.zeros((len(weights), 0))
    sides = np.stack([np.ones(len(weights)), fit.target.data.at.sign], axis=1) * fit.target.good[:, None]
    for place, (index, values) in by_place(fit.columns).items():
        if not left[place] and not means[place]:
            continue
        block = weights[:, place, None] * values
        parts = [block.real] if fit.target.data.orders[place] == 0 else [block.real, block.imag]
        pulled[np.ix_(index, index)] += left[place] * sum(s.T @ s for s in (root.T @ part for part in parts))
        pulled[np.ix_(index, index)] += means[place] * sum(s.T @ s for s in (sides.T @ part for part in parts))
    return found + fit.inverse @ pulled @ fit.inverse


def left_power(fit: Fit) -> FloatArray:
    """The power of one component (deg^2) that orders with structure keep beyond their noise, (K,); 0 for others."""
    target, residual = fit.target, fit.residual
    parts = target.data.parts
    lacking = is_lacking(target, residual)
    if not lacking.any() or not target.good.any():
        return np.zeros(len(parts))
    r = target.data.with_real_mean(residual)[target.good]
    noise = floors(target, residual, estimate(target.data, residual).floor_rms)
    return np.where(lacking, np.maximum((np.abs(r) ** 2).mean(axis=0) / parts - noise**2, 0.0), 0.0)


def _root_of_kernel(at: Conditions) -> FloatArray:
    """L (n, m) with L @ L.T the kernel between rows: by as many points as Nystroem's approximation is given at most.

    Squared exponential, its length the range of each condition; the directions have discrepancies of their own.
    """
    axes = [axis / max(float(np.ptp(axis)), 1e-300) for axis in at.axes]
    points = np.stack(axes, axis=1)
    chosen = np.sort(np.random.default_rng(0).permutation(len(points))[: SETTINGS.most_of_kernel])
    square = ((points[:, None, :] - points[None, chosen, :]) ** 2).sum(axis=2)
    kernel = np.exp(-0.5 * square) * (at.sign[:, None] == at.sign[None, chosen])
    # rows of one point make it singular
    inner = kernel[chosen] + 1e-8 * np.eye(len(chosen))
    found: FloatArray = np.linalg.solve(np.linalg.cholesky(inner), kernel.T).T
    return found


def with_the_other_half(joint: Fit, final: Fit, number: int, known: Catalogue) -> Iterator[Fit]:
    """The fits in which a wave has beside it what is rather there than not, though too small for a name.

    A mesh order has a constant part and one that grows with the load: where one of them stands alone, it takes up what
    it can of the other, be that missing or a part of the rig that is held.
    """
    effect = final.state.pieces[number].effect
    order, is_wave = effect.touched_orders(), effect.stage is Stage.ADDITIVE or effect.orders_key == "order"
    if not is_wave or len(order) != 1 or 0 in order or final.target.data.angle_rad is not None:
        return
    finder = Search(known, final, stages=(Stage.ADDITIVE,), touching=order)
    missing = [c for c in finder.ranked() if c.number != number and c.piece.effect.touched_orders() == order]
    states = [candidate.put_into(final.state) for candidate in missing[:1]]
    for i, piece in enumerate(joint.state.pieces):
        if i != number and piece.effect.touched_orders() == order and not final.state.pieces[i].free:
            states.append(final.state.replaced(i, piece))
    for state in states:
        both = fit(final.target, state, steps=SETTINGS.quick_steps)
        if both.loss < final.loss - finder.penalty * (len(both.prior) - len(final.prior)):
            yield both


def standard_errors(joint: Fit, number: int, final: Fit | None = None, others: Sequence[Fit] = ()) -> dict[str, float]:
    """Standard errors of the free keys of a piece, from the covariance of the joint fit; lists: `key[order]`.

    final: the fit with what did not change held, by which corrections of the data are told, and other forms of the
    piece that do as well. others: fits with what may be there as well, or read wrong, of which nobody knows whether it
    is: the coordinates would be others then.
    """
    piece, place = joint.state.pieces[number], joint.state.slices()[number]
    # what looks like a step may be noise that wanders, and of a step the size is another one on both sides
    covariance = covariance_with_discrepancy(joint, at_most=True)[place, place]
    if final is not None and final.state.pieces[number].coordinates() == piece.coordinates():
        own = final.state.slices()[number]
        covariance = covariance + covariance_of_corrections(final)[own, own]
        # what the data want changed and is held, since it leaves structure, may be what moved all the same
        kept = is_lacking(final.target, final.residual)
        own_orders = np.isin(final.target.data.orders, piece.effect.touched_orders())
        held = [joint] if (kept & own_orders).any() else []
        order, pieces = piece.effect.touched_orders(), final.state.pieces
        forms = [
            i for i, one in enumerate(pieces) if i == number or (len(order) == 1 and order[0] in one.effect.orders)
        ]
        for fitted in (*held, *others, *(fitted for i in forms for fitted in in_forms_as_good(final, i))):
            other = fitted.state.pieces[number]
            if other.coordinates() == piece.coordinates():
                ours = final.state.pieces[number]
                moved = vector_in_form(other, ours, final.target.data.at) - ours.vector()
                covariance = covariance + np.outer(moved, moved)
    coordinates, vector = piece.coordinates(), piece.vector()
    found: dict[str, float] = {}
    listed = piece.effect.orders_key == "orders"
    for i, c in enumerate(coordinates):
        suffix = f"[{piece.effect.orders[c.place]}]" if listed and c.part else ""
        spread = float(np.sqrt(max(float(covariance[i, i]), 0.0)))
        if c.part == 0:
            found[c.key] = spread / vector[i] ** 2 if c.form is Form.INVERSE else spread
        elif c.part == 1:
            re, im = float(vector[i]), float(vector[i + 1])
            size = max(float(np.hypot(re, im)), 1e-300)
            along, across = np.array([re, im]) / size, np.array([-im, re]) / size
            block = covariance[i : i + 2, i : i + 2]
            found[c.key + suffix] = float(np.sqrt(max(float(along @ block @ along), 0.0)))
            found[c.phase_key + suffix] = float(np.sqrt(max(float(across @ block @ across), 0.0)) / size)
    return found


def shares_of_prior(joint: Fit, number: int) -> dict[str, float]:
    """How much of each free key of a piece is what was known before: 1 where the data say nothing of it, 0 where all.

    Keys are those of `standard_errors`.
    """
    piece, place = joint.state.pieces[number], joint.state.slices()[number]
    shares, found = (joint.prior * np.diag(joint.inverse))[place], dict[str, float]()
    for i, c in enumerate(piece.coordinates()):
        if c.part == 0:
            found[c.key] = float(shares[i])
        elif c.part == 1:
            suffix = f"[{piece.effect.orders[c.place]}]" if piece.effect.orders_key == "orders" else ""
            found[c.key + suffix] = found[c.phase_key + suffix] = float(shares[i : i + 2].mean())
    return found
