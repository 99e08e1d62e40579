"""Walkers for scikit-learn's scalers, pipelines and compositions.

Scalers are chains of elementwise operations in the library's own order (`sklearn/preprocessing/_data.py`), so they are
exact: StandardScaler and RobustScaler subtract, then divide; MinMaxScaler multiplies, then adds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import Activation, Clip, FloatArray, Function, Operator, Scale, Select
from st_codegen.walkers.base import GraphBuilder, require_fitted, walk_estimator, walks

Steps = list[tuple[Operator, FloatArray]]


@walks("sklearn.Pipeline")
def walk_pipeline(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The steps, one after another."""
    for _, step in estimator.steps:
        value = _walk_or_pass(step, builder, value)
    return value


@walks("sklearn.ColumnTransformer")
def walk_columns(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Each transformer on its own columns; results side by side in the order of `transformers_`."""
    require_fitted(estimator, "transformers_")
    parts = []
    for name, transformer, _ in estimator.transformers_:
        columns = np.asarray(estimator._transformer_to_input_indices[name], np.int32)
        if len(columns) == 0 or transformer == "drop":
            continue
        parts.append(_walk_or_pass(transformer, builder, builder.add(Select((value,), columns))))
    if not parts:
        raise UnsupportedModelError("ColumnTransformer drops every column")
    total = sum(builder.width(part) for part in parts)
    return builder.add(Select(tuple(parts), np.arange(total, dtype=np.int32)))


@walks("sklearn.MultiOutputRegressor")
def walk_multi_output(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """One regressor an output, side by side."""
    require_fitted(estimator, "estimators_")
    parts = tuple(walk_estimator(part, builder, value) for part in estimator.estimators_)
    return builder.add(Select(parts, np.arange(len(parts), dtype=np.int32)))


@walks("sklearn.TransformedTargetRegressor")
def walk_transformed_target(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The regressor, then the inverse of the target's transformation."""
    require_fitted(estimator, "regressor_")
    value = walk_estimator(estimator.regressor_, builder, value)
    transformer = estimator.transformer_
    name = type(transformer).__name__
    if name == "FunctionTransformer":
        return _add_function(transformer.inverse_func, "inverse_func", builder, value)
    if name not in _SCALERS:
        raise UnsupportedModelError(
            f"TransformedTargetRegressor with transformer={name}: supported are {', '.join(_SCALERS)} and functions"
        )
    inverse = {Operator.ADD: Operator.SUBTRACT, Operator.SUBTRACT: Operator.ADD}
    inverse |= {Operator.MULTIPLY: Operator.DIVIDE, Operator.DIVIDE: Operator.MULTIPLY}
    return _add_steps(
        [(inverse[op], constant) for op, constant in reversed(_SCALERS[name](transformer))], builder, value
    )


@walks("sklearn.StandardScaler", "sklearn.MinMaxScaler", "sklearn.RobustScaler", "sklearn.MaxAbsScaler")
def walk_scaler(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The forward transformation of a scaler."""
    builder.refuse_magnitude(math.inf)
    value = _add_steps(_SCALERS[type(estimator).__name__](estimator), builder, value)
    if getattr(estimator, "clip", False):
        low, high = estimator.feature_range
        width = builder.width(value)
        value = builder.add(Clip((value,), np.full(width, float(low)), np.full(width, float(high))))
    return value


@walks("sklearn.FunctionTransformer")
def walk_function(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """A NumPy function of each column."""
    if estimator.kw_args:
        raise UnsupportedModelError(
            f"FunctionTransformer with kw_args={estimator.kw_args}: arguments are not supported"
        )
    return _add_function(estimator.func, "func", builder, value)


def _walk_or_pass(step: Any, builder: GraphBuilder, value: int) -> int:
    """A step of a composition; 'passthrough' and None hand their input on."""
    return value if step is None or isinstance(step, str) else walk_estimator(step, builder, value)


def _standard(scaler: Any) -> Steps:
    require_fitted(scaler, "n_features_in_")
    return _given((Operator.SUBTRACT, scaler.mean_ if scaler.with_mean else None), (Operator.DIVIDE, scaler.scale_))


def _robust(scaler: Any) -> Steps:
    require_fitted(scaler, "n_features_in_")
    return _given((Operator.SUBTRACT, scaler.center_), (Operator.DIVIDE, scaler.scale_))


def _min_max(scaler: Any) -> Steps:
    require_fitted(scaler, "scale_")
    return _given((Operator.MULTIPLY, scaler.scale_), (Operator.ADD, scaler.min_))


def _max_abs(scaler: Any) -> Steps:
    require_fitted(scaler, "scale_")
    return _given((Operator.DIVIDE, scaler.scale_))


def _given(*steps: tuple[Operator, Any]) -> Steps:
    """The steps that a scaler really takes: its attribute is None for one that is switched off."""
    return [(operator, np.asarray(constant, np.float64)) for operator, constant in steps if constant is not None]


_SCALERS: dict[str, Callable[[Any], Steps]] = {
    "StandardScaler": _standard,
    "MinMaxScaler": _min_max,
    "RobustScaler": _robust,
    "MaxAbsScaler": _max_abs,
}


def _add_steps(steps: Steps, builder: GraphBuilder, value: int) -> int:
    for operator, constant in steps:
        value = builder.add(Scale((value,), operator, constant))
    return value


_UFUNCS = {np.log1p: Function.LOG1P, np.expm1: Function.EXPM1, np.exp: Function.EXP}


def _add_function(function: Any, role: str, builder: GraphBuilder, value: int) -> int:
    if function is None:
        return value
    if not isinstance(function, np.ufunc) or function not in _UFUNCS:
        supported = ", ".join(f"numpy.{known.__name__}" for known in _UFUNCS)
        raise UnsupportedModelError(
            f"{role}={getattr(function, '__name__', function)!s}: a Python function cannot be compiled; "
            f"supported are None (identity), {supported}"
        )
    return builder.add(Activation((value,), _UFUNCS[function], builder.width(value)))
