"""A model as a controller without LREAL computes it: every number is a REAL.

The inputs are REAL. Of such numbers `x <= t` holds for a float64 threshold `t` exactly where it holds for the largest
REAL that is not above `t`, and `x < t` where it holds for the smallest one that is not below it: no row takes another
way through a tree. Coefficients become the nearest REAL, and each operation is rounded (`Precision.REAL`), sums in the
order of the text; how far that leads from the library `proof.bounds` derives.
"""

from __future__ import annotations

import dataclasses
from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.errors import UnsupportedModelError
from st_codegen.ir.arrays import FloatArray, next_single
from st_codegen.passes.domain import limit_inputs

#: Thresholds, leaves and sums stay below this: numbers above stand for missing and for infinite ones.
LARGEST = 1e38
#: Functions that only pick or turn a sign, so that nothing is rounded.
_PICKS = (ir.Function.IDENTITY, ir.Function.RELU, ir.Function.ABS)
#: Functions whose formulas keep their digits in REAL.
_COMPUTED = (
    *(ir.Function.LEAKY_RELU, ir.Function.TANH, ir.Function.LOGISTIC, ir.Function.EXP, ir.Function.ELU),
    *(ir.Function.SOFTPLUS, ir.Function.SOFTSIGN),
)


def in_real(model: ir.ModelIR) -> ir.ModelIR:
    """The model with every number a REAL. Raises UnsupportedModelError with the reason where it cannot be one."""
    try:
        ops = tuple(_operation(op) for op in model.ops)
    except UnsupportedModelError as error:
        raise UnsupportedModelError(f"model '{model.name}': --real: {error}") from None
    found = dataclasses.replace(
        model,
        ops=ops,
        features=tuple(_feature(feature) for feature in model.features),
        # infinities are refused, and REAL has none between its largest number and these
        magnitude_limits=tuple(map(_limit, model.magnitude_limits)),
        accepted=tuple(None if ends is None else _inside(*ends) for ends in model.accepted),
        ports=tuple(_port(port) for port in model.ports),
        is_real=True,
    )
    found = limit_inputs(found)
    return dataclasses.replace(found, magnitude_limits=tuple(map(_limit, found.magnitude_limits)))


def _limit(limit: float | None) -> float | None:
    """A limit of magnitudes as a REAL that is not above it."""
    return None if limit is None else ir.FLOAT32_OVERFLOW if limit >= ir.FLOAT32_OVERFLOW else _inside(0.0, limit)[1]


@singledispatch
def _operation(op: ir.Operation) -> ir.Operation:
    """An operation in REAL. Raises UnsupportedModelError where its loss has no bound that is known."""
    raise UnsupportedModelError(f"this one has {type(op).__name__}, of which no bound in REAL is derived")


@_operation.register
def _(op: ir.Select) -> ir.Operation:
    return op


@_operation.register
def _(op: ir.Round) -> ir.Operation:
    return ir.Select(op.inputs, np.arange(op.width, dtype=np.int32))  # a REAL is rounded already


@_operation.register
def _(op: ir.WholeNumber) -> ir.Operation:
    return op  # the whole number beside a REAL is a REAL


@_operation.register
def _(op: ir.ArgMax) -> ir.Operation:
    # distances below a digit of REAL: rows in which the library sees two columns as equal are open
    return dataclasses.replace(op, merged=0.0, open_below=max(op.merged, op.open_below))


@_operation.register
def _(op: ir.Exceeds) -> ir.Operation:
    return dataclasses.replace(op, cut=_kept(op.cut))


@_operation.register
def _(op: ir.Clip) -> ir.Operation:
    return dataclasses.replace(op, lower=_kept(op.lower), upper=_kept(op.upper))


@_operation.register
def _(op: ir.Scale) -> ir.Operation:
    if op.operator is ir.Operator.DIVIDE and op.reverse:
        raise UnsupportedModelError("it divides by a computed number")
    constant = _nearest(op.constant)
    if op.operator is ir.Operator.DIVIDE and not np.all(constant):
        raise UnsupportedModelError("it divides by a number that is too small for REAL")
    doubt = np.abs(op.constant - constant) + (0.0 if op.doubt is None else op.doubt)
    return dataclasses.replace(op, constant=constant, doubt=doubt, precision=ir.Precision.REAL)


@_operation.register
def _(op: ir.Combine) -> ir.Operation:
    if op.operator is ir.Operator.DIVIDE:
        raise UnsupportedModelError("it divides by a computed number")
    return dataclasses.replace(op, precision=ir.Precision.REAL)


@_operation.register
def _(op: ir.Linear) -> ir.Operation:
    return dataclasses.replace(
        op,
        weights=_nearest(op.weights),
        bias=_nearest(op.bias),
        order=ir.SummationOrder.SEQUENTIAL,
        precision=ir.Precision.REAL,
    )


@_operation.register
def _(op: ir.Activation) -> ir.Operation:
    if op.function in _PICKS:
        return op
    if op.function not in _COMPUTED:
        raise UnsupportedModelError(f"of the function {op.function} no bound in REAL is derived")
    return dataclasses.replace(op, parameter=float(_nearest(np.array(op.parameter))), precision=ir.Precision.REAL)


@_operation.register
def _(op: ir.Softmax) -> ir.Operation:
    return dataclasses.replace(op, precision=ir.Precision.REAL)


@_operation.register
def _(op: ir.KernelSum) -> ir.Operation:
    vectors = _nearest(op.support_vectors)
    gamma, coef0 = (float(_nearest(np.array(value))) for value in (op.gamma, op.coef0))
    return dataclasses.replace(
        op,
        support_vectors=vectors,
        coefficients=_nearest(op.coefficients),
        intercept=_nearest(op.intercept),
        gamma=gamma,
        coef0=coef0,
        precision=ir.Precision.REAL,
        # what a vector loses is relative to its own numbers, not to its distance from a row
        expands=op.expands or not np.array_equal(vectors, op.support_vectors),
    )


@_operation.register
def _(op: ir.TreeEnsemble) -> ir.Operation:
    largest = float(max(np.max(np.abs(values), initial=0.0) for values in (op.leaf_value, op.base))) * (op.n_trees + 1)
    largest = max(largest, float(np.max(np.abs(op.threshold[np.isfinite(op.threshold)]), initial=0.0)))
    reasons = {
        "there are steps in front of its trees, and rounding may turn a split": op.inputs != (0,),
        "the leaves of this one are linear models": op.linear is not None,
        "this one splits by categories, whose codes need not be REAL numbers": op.has_categories,
        f"numbers of {largest:.3g} are too large": largest >= LARGEST,
        f"it divides by {op.divisor!r}, which is no REAL": float(np.float32(op.divisor)) != op.divisor,
    }
    for reason, holds in reasons.items():
        if holds:
            raise UnsupportedModelError(reason)
    below = op.comparison is ir.Comparison.LESS_OR_EQUAL
    threshold = np.where(np.isfinite(op.threshold), next_single(op.threshold, up=not below), op.threshold)
    same = op.sum_precision is ir.Precision.FLOAT32  # then leaves and sums are the library's own
    return dataclasses.replace(
        op,
        columns=tuple(_column(column) for column in op.columns),
        threshold=threshold,
        leaf_value=_nearest(op.leaf_value),
        base=_nearest(op.base),
        input_precision=ir.Precision.FLOAT32,
        sum_precision=ir.Precision.FLOAT32 if same else ir.Precision.REAL,
    )


def _nearest(values: FloatArray) -> FloatArray:
    """The nearest REAL of each coefficient."""
    with np.errstate(over="ignore"):
        found: FloatArray = values.astype(np.float32).astype(np.float64)
    if not np.all(np.abs(found) < LARGEST):
        raise UnsupportedModelError(f"numbers of {np.max(np.abs(values)):.3g} are too large")
    return found


def _kept(values: FloatArray) -> FloatArray:
    """Limits that numbers are compared with, which may not move."""
    if not np.array_equal(_nearest(values), values):
        raise UnsupportedModelError("a number that it compares with is no REAL")
    return values


def _inside(lower: float, upper: float) -> tuple[float, float]:
    """The range of the REAL numbers in a range."""
    largest = float(np.finfo(np.float32).max)
    low, high = (float(next_single(np.array(end), up=up)) for end, up in ((lower, True), (upper, False)))
    return max(low, -largest), min(high, largest)


def _column(column: ir.TreeColumn) -> ir.TreeColumn:
    interval = column.missing_interval
    return column if interval is None else dataclasses.replace(column, missing_interval=_inside(*interval))


def _feature(feature: ir.Feature) -> ir.Feature:
    ranges: dict[str, object] = {}
    if feature.lower is not None and feature.upper is not None:
        ranges["lower"], ranges["upper"] = _inside(feature.lower, feature.upper)
    if feature.flagged is not None:
        ranges["flagged"] = _inside(*feature.flagged)
    return dataclasses.replace(feature, **ranges)  # type: ignore[arg-type]


def _port(port: ir.Output) -> ir.Output:
    if port.lower is None or port.upper is None:
        return port
    lower, upper = _inside(port.lower, port.upper)
    return dataclasses.replace(port, lower=lower, upper=upper)
