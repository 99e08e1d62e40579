"""A model of trees as a controller without LREAL computes it: every number is a REAL.

The inputs are REAL. Of such numbers `x <= t` holds for a float64 threshold `t` exactly where it holds for the largest
REAL that is not above `t`, and `x < t` where it holds for the smallest one that is not below it: no row takes another
way through a tree. What is lost are the last digits of the leaves and of their sum, by at most `ModelIR.stray`.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    Comparison,
    Feature,
    FloatArray,
    ModelIR,
    Output,
    Precision,
    TreeColumn,
    TreeEnsemble,
)

#: Thresholds, leaves and sums stay below this: numbers above stand for missing and for infinite ones.
LARGEST = 1e38
_UNIT = 2.0**-24
#: Half of the smallest REAL: what a rounded number below the normal ones may be off.
_TINY = 2.0**-150


def in_real(model: ModelIR) -> ModelIR:
    """The model with every number a REAL, and `stray`: how far its outputs may lie from the library's."""
    op = model.ops[0]
    reason = _obstacle(model)
    if reason or not isinstance(op, TreeEnsemble):
        raise UnsupportedModelError(f"model '{model.name}': --real takes trees alone: {reason}")
    below = op.comparison is Comparison.LESS_OR_EQUAL
    threshold = np.where(np.isfinite(op.threshold), _towards(op.threshold, up=not below), op.threshold)
    leaf_value, base = (_nearest(values) for values in (op.leaf_value, op.base))
    trees = dataclasses.replace(
        op,
        columns=tuple(_column(column) for column in op.columns),
        threshold=threshold,
        leaf_value=leaf_value,
        base=base,
        input_precision=Precision.FLOAT32,
        sum_precision=Precision.FLOAT32,
    )
    same = op.sum_precision is Precision.FLOAT32  # then leaves and sums are the library's own
    return dataclasses.replace(
        model,
        ops=(trees,),
        features=tuple(_feature(feature) for feature in model.features),
        # infinities are refused, and REAL has none between its largest number and these
        magnitude_limits=tuple(None if limit is None else FLOAT32_OVERFLOW for limit in model.magnitude_limits),
        ports=tuple(_port(port) for port in model.ports),
        stray=(0.0,) * op.width if same else _stray(op),
    )


def _obstacle(model: ModelIR) -> str:
    """Why a model cannot be computed in REAL with a bound that is known; empty where it can."""
    op = model.ops[0]
    if model.classes is not None:
        return "a label or a probability is decided behind the sum, where rounding may turn it"
    if len(model.ops) > 1 or not isinstance(op, TreeEnsemble):
        kinds = ", ".join(dict.fromkeys(type(op).__name__ for op in model.ops if not isinstance(op, TreeEnsemble)))
        return f"this one has {kinds}, of which no bound in REAL is derived"
    finite = op.threshold[np.isfinite(op.threshold)]
    largest = float(max(np.max(np.abs(finite), initial=0.0), np.max(_magnitude(op) + np.abs(op.base))))
    limited = any(limit is not None and limit < FLOAT32_OVERFLOW for limit in model.magnitude_limits)
    reasons = {
        "the leaves of this one are linear models": op.linear is not None,
        "this one splits by categories, whose codes need not be REAL numbers": op.has_categories,
        "this one refuses some finite inputs, and rounding may turn which": limited or any(model.accepted),
        f"numbers of {largest:.3g} are too large": largest >= LARGEST,
        f"it divides by {op.divisor!r}, which is no REAL": float(np.float32(op.divisor)) != op.divisor,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _magnitude(op: TreeEnsemble) -> FloatArray:
    """For each output the sum of the largest magnitudes of its trees' leaves."""
    found = np.zeros(op.width)
    stops = np.append(op.roots[1:], op.n_nodes)
    for tree, (root, stop) in enumerate(zip(op.roots, stops, strict=True)):
        rows = op.leaf[root:stop][op.split[root:stop] < 0]
        largest = np.max(np.abs(op.leaf_value[rows]), axis=0)
        if len(largest) == 1:
            found[op.tree_output[tree]] += largest[0]
        else:
            found += largest
    return found


def _stray(op: TreeEnsemble) -> tuple[float, ...]:
    """How far the sum in REAL may lie from the library's in LREAL, for each output, whatever the inputs are.

    A leaf passes its own rounding, at most one addition a tree, that of the base and the division, here and in the
    library: (1 + u)**(trees + 4) - 1 of the magnitudes, u = 2**-24, holds for both together. Numbers below the normal
    ones are off by an absolute amount, at most once a leaf, once for the base and once in the division.
    """
    terms = op.n_trees + 4
    relative = math.expm1(terms * math.log1p(_UNIT))
    scale = min(abs(op.divisor), 1.0)  # a base that is added last is not divided
    sums = _magnitude(op) / abs(op.divisor) + np.abs(op.base) / (1.0 if op.base_last else scale)
    # the bound itself is computed with a few roundings
    return tuple(float(value) * (1.0 + 1e-12) for value in sums * relative + (terms / scale + 1.0) * _TINY)


def _towards(values: FloatArray, *, up: bool) -> FloatArray:
    """The nearest REAL that is not below (not above) each number; infinite where there is none."""
    with np.errstate(over="ignore"):
        single = np.asarray(values, np.float64).astype(np.float32)
    wrong = single < values if up else single > values
    end = np.float32(np.inf if up else -np.inf)
    found: FloatArray = np.where(wrong, np.nextafter(single, end), single).astype(np.float64)
    return found


def _nearest(values: FloatArray) -> FloatArray:
    return values.astype(np.float32).astype(np.float64)


def _inside(lower: float, upper: float) -> tuple[float, float]:
    """The range of the REAL numbers in a range."""
    largest = float(np.finfo(np.float32).max)
    low, high = (float(_towards(np.array(end), up=up)) for end, up in ((lower, True), (upper, False)))
    return max(low, -largest), min(high, largest)


def _column(column: TreeColumn) -> TreeColumn:
    interval = column.missing_interval
    return column if interval is None else dataclasses.replace(column, missing_interval=_inside(*interval))


def _feature(feature: Feature) -> Feature:
    ranges: dict[str, object] = {}
    if feature.lower is not None and feature.upper is not None:
        ranges["lower"], ranges["upper"] = _inside(feature.lower, feature.upper)
    if feature.flagged is not None:
        ranges["flagged"] = _inside(*feature.flagged)
    return dataclasses.replace(feature, **ranges)  # type: ignore[arg-type]


def _port(port: Output) -> Output:
    if port.lower is None or port.upper is None:
        return port
    lower, upper = _inside(port.lower, port.upper)
    return dataclasses.replace(port, lower=lower, upper=upper)
