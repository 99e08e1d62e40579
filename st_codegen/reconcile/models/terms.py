"""What reconcile found, as terms of a bundle of models: which orders they enter, decided on the measured data.

A term is the difference between the new rig and the old one, effect by effect, as a formula. A bundle may have been
learned from data that hold the effect already; so an order is changed only where the bundle then comes closer to what
was measured.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.emit.blocks.model import input_variables
from st_codegen.errors import InputError, Problems
from st_codegen.ir import ModelIR, reference
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.project.bundle import Bundle
from st_codegen.reconcile.data.observations import rms_deg
from st_codegen.reconcile.models.formula import (
    QUANTITIES,
    FormulaNode,
    Graph,
    NoFormulaError,
    Symbol,
    addends,
    evaluate,
    operating_point,
)
from st_codegen.reconcile.result import Reconciliation
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.compensator import roles_of
from st_codegen.te.harmonics import Direction, Quantity, TransmissionError
from st_codegen.te.purpose import transmission_error

SIGN = {Direction.FORWARD: 1.0, Direction.BACKWARD: -1.0}


@dataclass(frozen=True)
class Part:
    """What one effect (by name) gives to one harmonic."""

    name: str
    direction: Direction
    order: int
    cosine: FormulaNode
    sine: FormulaNode


@dataclass(frozen=True)
class Decision:
    """An order that the findings change: whether it enters the bundle, and why not.

    new: the bundle has no such order yet. before_deg, after_deg: RMS of measured - bundle of this order over all good
    runs inside the bundle's ranges (None where the order was not measured).
    """

    order: int
    effects: tuple[str, ...]
    new: bool
    entered: bool
    reason: str
    before_deg: float | None = None
    after_deg: float | None = None
    parts: tuple[Part, ...] = ()


def inputs_of(te: TransmissionError) -> tuple[str, ...]:
    """Which quantity of the operating point each feature of a bundle is, by their names and units.

    Raises InputError where that is not clear.
    """
    roles = roles_of(te)
    known = dict(zip((roles.speed, roles.torque, roles.temperature), QUANTITIES, strict=True))
    return tuple(known[variable.name] for variable in input_variables(te.features))


def check_bundle(bundle: Bundle, result: Reconciliation) -> None:
    """Raise one InputError with all that keeps a bundle from taking terms of this rig."""
    te = transmission_error(bundle)
    problems = Problems(f"bundle '{te.name}'")
    with problems.collect():
        inputs = inputs_of(te)
        if _inside(te, inputs, result).sum() < SETTINGS.least_rows:
            ranges = ", ".join(f"{f.name} {f.lower:g} .. {f.upper:g}" for f in te.features)
            raise InputError(
                f"fewer than {SETTINGS.least_rows} measured rows lie inside the ranges of its features ({ranges})"
            )
    problems.raise_if_any()


def decide(bundle: Bundle, result: Reconciliation) -> list[Decision]:
    """Every order that the findings change, and what becomes of it. Raises InputError (see `check_bundle`)."""
    check_bundle(bundle, result)
    te = transmission_error(bundle)
    inputs, data = inputs_of(te), result.data
    rows = np.flatnonzero(_inside(te, inputs, result))
    data = data.rows(rows)
    # samples over time: what a wave of the whole recording shares with their noise
    noise = result.target.sigma[rows] / (1.0 if data.angle_rad is None else np.sqrt(len(rows) / 2))
    orders = np.array(sorted({*te.orders, *data.model_orders()}), np.int64)
    measured = np.isin(orders, data.model_orders())
    x = np.column_stack([getattr(data.at, name) for name in inputs])
    residual = data.values - data.observed(_by_bundle(bundle, te, orders, data.at.sign, x)[:, measured])
    decisions = []
    for change in _changes(te, result, inputs):
        if change.reason:
            decisions.append(change)
            continue
        if change.order not in data.model_orders():
            decisions.append(replace(change, reason="the order was not measured", parts=()))
            continue
        added = np.zeros((len(rows), len(data.model_orders())), np.complex128)
        added[:, data.model_orders().index(change.order)] = _values(change.parts, data.at.sign, x, inputs)
        after = residual - data.observed(added)
        columns = data.orders == change.order if data.angle_rad is None else slice(None)
        sizes = [rms_deg(part[:, columns], data.orders[columns]) for part in (residual, after)]
        reason = not_worth(residual[:, columns], after[:, columns], noise[:, columns], data.orders[columns])
        entered = not reason
        decisions.append(replace(change, entered=entered, reason=reason, before_deg=sizes[0], after_deg=sizes[1]))
        if entered:
            residual = after
    return decisions


def not_worth(before: ComplexArray, after: ComplexArray, noise: FloatArray, orders: IntArray) -> str:
    """Why a term stays out: the bundle comes no closer, by chance only, or by less than one run scatters; else empty.

    The power that it takes off must be sure, three standard errors of its mean over the rows, and at least that of the
    noise of one coefficient: less could be seen in no run, and costs the controller a formula all the same.
    """
    weight = np.where(orders == 0, 1.0, 0.5)
    saved = (weight * (np.abs(before) ** 2 - np.abs(after) ** 2)).sum(axis=1)
    mean, error = float(saved.mean()), float(saved.std() / np.sqrt(max(len(saved) - 1, 1)))
    if mean <= 0.0:
        return (
            "the bundle comes no closer to what was measured: it knows the effect already, learned from a machine that "
            "was not as the old rig says, or has errors of its own that make up for it"
        )
    if mean < SETTINGS.sure_term * error:
        return "the bundle comes closer to what was measured by no more than chance does"
    scatter = float((noise**2).mean(axis=0).sum())
    if mean < scatter:
        return "the bundle comes closer by less than one run scatters"
    return ""


def _inside(te: TransmissionError, inputs: Sequence[str], result: Reconciliation) -> BoolArray:
    """Good rows of the bundle's directions inside its declared ranges."""
    at = result.data.at
    found: BoolArray = result.target.good & np.isin(at.sign, [SIGN[direction] for direction in te.directions])
    for feature, name in zip(te.features, inputs, strict=True):
        values: FloatArray = getattr(at, name)
        if feature.lower is not None and feature.upper is not None:
            found &= (values >= feature.lower) & (values <= feature.upper)
    return found


def _by_bundle(
    bundle: Bundle, te: TransmissionError, orders: IntArray, sign: FloatArray, x: FloatArray
) -> ComplexArray:
    """Coefficients that the bundle predicts, complex128 (n, orders); zero for orders that it does not have."""
    models: dict[str, ModelIR] = {model.ir.name: model.ir for model in bundle.models}
    used = sorted({output.model for output in te.outputs})
    values = {name: reference.evaluate(models[name], x) for name in used}
    found = np.zeros((len(x), len(orders)), np.complex128)
    for direction in te.directions:
        rows = sign == SIGN[direction]
        for place in np.flatnonzero(np.isin(orders, te.orders)):
            own = te.quantities(direction, int(orders[place]))
            value = {quantity: values[o.model][:, o.output] for quantity, o in own.items()}
            if Quantity.COSINE in value:
                total = value[Quantity.COSINE] + 1j * value[Quantity.SINE]
            else:
                total = value[Quantity.AMPLITUDE] * np.exp(1j * value.get(Quantity.PHASE, np.zeros(len(x))))
            correction = te.correction(direction, int(orders[place]))
            if correction is not None:
                total = complex(*correction.parts) * total + correction.offset_deg
            for quantity, added in te.terms(direction, int(orders[place])).items():
                turn = 1j if quantity is Quantity.SINE else 1.0
                total = total + turn * sum(values[o.model][:, o.output] for o in added)
            found[rows, place] = total[rows]
    return found


def _values(parts: Sequence[Part], sign: FloatArray, x: FloatArray, inputs: Sequence[str]) -> ComplexArray:
    """What parts of one order add up to at operating points, complex128 (n,)."""
    found = np.zeros(len(x), np.complex128)
    for part in parts:
        rows = sign == SIGN[part.direction]
        if rows.any():
            columns = {name: x[rows, place] for place, name in enumerate(inputs)}
            real, imag = evaluate([part.cosine, part.sine], columns).T
            found[rows] += real + 1j * imag
    return found


def _changes(te: TransmissionError, result: Reconciliation, inputs: Sequence[str]) -> list[Decision]:
    """The orders in which the new rig differs from the old one, with their formulas; a reason where there is none."""
    graph = Graph()
    found = []
    for order in sorted({*result.rig.orders(), *result.new_rig.orders()}):
        new = order not in te.orders
        parts: list[Part] = []
        names: set[str] = set()
        try:
            for direction in te.directions:
                at = operating_point(graph, SIGN[direction])
                change, whole = _difference(
                    addends(result.rig, order, at, graph), addends(result.new_rig, order, at, graph)
                )
                names |= set(change)
                # an order that the bundle does not have needs all that the rig knows of it
                chosen = whole if new and change else change
                parts += [Part(name, direction, order, s.real, s.imag) for name, s in chosen.items()]
            missing = {name for part in parts for node in (part.cosine, part.sine) for name in node.inputs()}
            if unknown := sorted(missing - set(inputs)):
                raise NoFormulaError(f"it depends on {' and '.join(unknown)}, which the bundle does not know")
        except NoFormulaError as error:
            if changed := sorted(names) or _named(result, order):
                found.append(Decision(order, tuple(changed), new, entered=False, reason=str(error)))
            continue
        if names:
            found.append(Decision(order, tuple(sorted(names)), new, entered=False, reason="", parts=tuple(parts)))
    return found


def _named(result: Reconciliation, order: int) -> list[str]:
    """Claimed effects on an order, by name."""
    claims = result.conclusions.claims
    return sorted({c.piece.effect.name for c in claims if order in c.piece.effect.touched_orders()})


def _difference(
    old: Sequence[tuple[str, Symbol]], new: Sequence[tuple[str, Symbol]]
) -> tuple[dict[str, Symbol], dict[str, Symbol]]:
    """What came minus what went, and all of the new, by name of the effect; equal addends cancel."""
    keys = [Counter((name, id(s.real), id(s.imag)) for name, s in side) for side in (old, new)]
    gone, came = keys[0] - keys[1], keys[1] - keys[0]
    change: dict[str, Symbol] = {}
    whole: dict[str, Symbol] = {}
    for side, left, factor in ((new, came, 1.0), (old, gone, -1.0)):
        for name, symbol in side:
            if factor > 0:
                whole[name] = whole[name] + symbol if name in whole else symbol
            key = (name, id(symbol.real), id(symbol.imag))
            if left[key]:
                left[key] -= 1
                change[name] = change[name] + symbol * factor if name in change else symbol * factor
    return change, whole
