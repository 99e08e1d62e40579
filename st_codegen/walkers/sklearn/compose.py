"""Walkers for scikit-learn's scalers, pipelines and compositions.

Scalers are chains of elementwise operations in the library's own order (`sklearn/preprocessing/_data.py`), so they are
exact: StandardScaler and RobustScaler subtract, then divide; MinMaxScaler multiplies, then adds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from st_codegen import ir
from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.ir.arrays import FloatArray, Int32Array
from st_codegen.walkers.base import GraphBuilder, Walked, transforms, walk_any, walk_estimator, walks
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.sklearn.pieces import inverse_quantiles
from st_codegen.walkers.sklearn.transforms import inverse_power, side_by_side, walk_or_pass, walk_selection

Steps = list[tuple[str, FloatArray]]


@transforms("Pipeline", single=True)
def walk_preparation(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The steps, one after another; none of them predicts."""
    for _, step in fitted.items("steps"):
        value = walk_or_pass(step, builder, value)
    return value


@walks("Pipeline", single=True)
def walk_pipeline(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The steps, one after another; the last one may be a classifier."""
    if not hasattr(fitted.estimator, "predict"):
        return walk_preparation(fitted, builder, value)
    steps = fitted.items("steps")
    _, last = steps[-1]
    for _, step in steps[:-1]:
        value = walk_or_pass(step, builder, value)
    return value if last is None or isinstance(last, str) else walk_any(last, builder, value)


#: What a search was told: how it divides the rows, and the scores that it compared. Only the names of functions are
#: read from a file; nothing of this is called where `best_estimator_` predicts.
_SEARCH = tuple(
    f"sklearn.{module}.{name}"
    for module, names in {
        "model_selection._split": """
            GroupKFold GroupShuffleSplit KFold LeaveOneGroupOut LeaveOneOut LeavePGroupsOut LeavePOut PredefinedSplit
            RepeatedKFold RepeatedStratifiedKFold ShuffleSplit StratifiedGroupKFold StratifiedKFold
            StratifiedShuffleSplit TimeSeriesSplit""",
        "metrics._scorer": "_MultimetricScorer _PassthroughScorer _Scorer",
        "metrics._classification": """
            accuracy_score balanced_accuracy_score brier_score_loss f1_score jaccard_score log_loss matthews_corrcoef
            precision_score recall_score""",
        "metrics._ranking": "average_precision_score roc_auc_score top_k_accuracy_score",
        "metrics._regression": """
            explained_variance_score max_error mean_absolute_error mean_absolute_percentage_error mean_gamma_deviance
            mean_poisson_deviance mean_squared_error mean_squared_log_error median_absolute_error r2_score
            root_mean_squared_error root_mean_squared_log_error""",
    }.items()
    for name in names.split()
)


@walks(
    "GridSearchCV RandomizedSearchCV HalvingGridSearchCV HalvingRandomSearchCV",
    trusts=(
        *_SEARCH,
        *(
            f"sklearn.model_selection._search_successive_halving.{name}"
            for name in ("HalvingGridSearchCV", "HalvingRandomSearchCV", "_SubsampleMetaSplitter")
        ),
    ),
    single=True,
)
def walk_search(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The estimator that the search found best and fitted again (`_search.py: BaseSearchCV.predict`)."""
    return walk_any(fitted.get("best_estimator_"), builder, value)


@walks("RFE RFECV", single=True)
def walk_elimination(fitted: Fitted, builder: GraphBuilder, value: int) -> Walked:
    """The estimator on the features that are left, which `transform` picks (`feature_selection/_rfe.py: predict`)."""
    return walk_any(fitted.get("estimator_"), builder, walk_selection(fitted, builder, value))


@transforms(
    "ColumnTransformer",
    # what chose the columns when it was fitted, and the types by which it chose them
    trusts=("sklearn.compose._column_transformer.make_column_selector", "numpy.number", "builtins.object"),
    single=True,
)
def walk_columns(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Each transformer on its own columns; results side by side in the order of `transformers_`."""
    parts = (
        (name, transformer, columns)
        for name, transformer, given in fitted.items("transformers_")
        for columns in [selected_columns(fitted, name, given, builder.width(value))]
        if len(columns) and not (isinstance(transformer, str) and transformer == "drop")
    )
    found, _ = side_by_side(fitted, builder, value, parts, "ColumnTransformer drops every column")
    builder.sparse[found] = bool(fitted.get("sparse_output_"))
    return found


def selected_columns(fitted: Fitted, name: str, given: Any, width: int) -> Int32Array:
    """Positions of the columns that a transformer takes, which stand in the object twice: as given, and as numbers."""
    where = "_transformer_to_input_indices"
    numbers = fitted.get(where)
    if not isinstance(numbers, dict) or name not in numbers:
        raise fitted.fail(where, "does not name the columns of each transformer")
    indices = np.array(numbers[name])
    columns = fitted.integers_of(where, indices, (None,), low=0, high=width - 1) if indices.size else np.zeros(0, int)
    texts = (given.start, given.stop) if isinstance(given, slice) else np.ravel(np.asarray(given))
    if not any(isinstance(text, str) for text in texts):
        meant = np.atleast_1d(np.arange(width)[given]) if np.size(given) else np.zeros(0, int)
        if not np.array_equal(meant, columns):
            raise fitted.fail("transformers_", f"the columns of one of them are not those of {where}")
    return columns.astype(np.int32)


@walks("TransformedTargetRegressor", single=True)
def walk_transformed_target(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The regressor, then the inverse of the target's transformation."""
    return _inverted(fitted.get("transformer_"), builder, walk_estimator(fitted.get("regressor_"), builder, value))


def _inverted(transformer: Any, builder: GraphBuilder, value: int) -> int:
    """What `inverse_transform` of a transformer makes of a value."""
    name, fitted = type(transformer).__name__, Fitted(transformer)
    if transformer is None or isinstance(transformer, str):  # a step that hands its input on
        return value
    if name == "Pipeline":
        for _, step in reversed(fitted.items("steps")):
            value = _inverted(step, builder, value)
        return value
    if name == "FunctionTransformer":
        if transformer.inv_kw_args:
            raise UnsupportedModelError(f"FunctionTransformer with inv_kw_args={transformer.inv_kw_args}")
        return _add_function(transformer.inverse_func, "inverse_func", builder, value)
    if name in _SCALERS:
        steps = _steps(fitted, builder.width(value))
        return _scaled(builder, value, name, [(_INVERSE[operator], constant) for operator, constant in reversed(steps)])
    if name not in _INVERTED:
        raise UnsupportedModelError(
            f"TransformedTargetRegressor with transformer={name}: supported are "
            f"{', '.join((*_SCALERS, *_INVERTED))}, functions, and a Pipeline of these"
        )
    if builder.is_single(value):
        raise UnsupportedModelError(
            f"{name} of a target that its model gives in float32, as those of XGBoost do: scikit-learn turns it back "
            "in float32; take a function, such as np.log1p and np.expm1, or a scaler"
        )
    return _INVERTED[name](fitted, builder, value)


#: Transformers of targets that are no chains of steps, and what turns their numbers back.
_INVERTED = {"PowerTransformer": inverse_power, "QuantileTransformer": inverse_quantiles}


@transforms("StandardScaler MinMaxScaler RobustScaler MaxAbsScaler", single=True)
def walk_scaler(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The forward transformation of a scaler."""
    builder.refuse_magnitude(math.inf)
    width = builder.width(value)
    steps = _steps(fitted, width)
    if builder.is_sparse(value):  # `inplace_column_scale` multiplies
        steps = [("*", 1.0 / constant) if operator == "/" else (operator, constant) for operator, constant in steps]
    if not (hasattr(fitted.estimator, "clip") and fitted.flag("clip")):
        return _scaled(builder, value, fitted.kind, steps)
    low, high = (-1.0, 1.0) if fitted.kind == "MaxAbsScaler" else fitted.items("feature_range", 2)
    low, high = (float(fitted.floats_of("feature_range", end, ())) for end in (low, high))
    reach = _reach(steps, low, high, width)
    if np.all(np.isfinite(reach)):
        value = builder.held_like(value, builder.add(ir.Clip((value,), -reach, reach)))
    value = _scaled(builder, value, fitted.kind, steps)
    return builder.held_like(value, builder.add(ir.Clip((value,), np.full(width, low), np.full(width, high))))


def _scaled(builder: GraphBuilder, value: int, kind: str, steps: Steps) -> int:
    """The steps of a scaler, one after another.

    Numbers of float32 stay in it. StandardScaler rounds its constants to it from version 1.9 of scikit-learn on, and
    did not before.
    """
    precision = builder.precision(value)
    for operator, constant in steps:
        kept, doubt = constant, None
        if precision is ir.Precision.FLOAT32 and kind == "StandardScaler":
            kept = constant.astype(np.float32).astype(np.float64)
            doubt = np.abs(kept - constant)
        value = builder.held_like(value, builder.scale(value, operator, kept, precision=precision, doubt=doubt))
    return value


def _reach(steps: Steps, low: float, high: float, width: int) -> FloatArray:
    """Magnitudes beyond which rising steps give less than `low` or more than `high`, a power of two for each column.

    Inputs may be limited to them first, which changes no result and leaves no number that overflows; infinity where
    there is no such magnitude.
    """
    reach = np.ones(width)
    while True:
        ends = np.array([-reach, reach])
        with np.errstate(all="ignore"):
            for operator, constant in steps:
                ends = reference.OPERATORS[ir.Operator(operator)](ends, constant)
        short = np.isfinite(reach) & ~((ends[0] <= low) & (ends[1] >= high))
        if not np.any(short):
            return reach
        reach[short] *= 2.0


@transforms("FunctionTransformer", trusts=("numpy.clip",), single=True)  # no ufunc, which skops knows to be harmless
def walk_function(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """A NumPy function of each column; with validate=True the library refuses NaN and infinity."""
    if fitted.flag("validate"):
        builder.refuse_special(value)
    if fitted.estimator.func is np.clip:
        return _clipped(fitted, builder, value)
    if fitted.get("kw_args"):
        raise UnsupportedModelError(
            f"FunctionTransformer with kw_args={fitted.estimator.kw_args}: arguments are not supported"
        )
    return _add_function(fitted.estimator.func, "func", builder, value)


#: Of each scaler the operators, the arrays, and the parameters that switch a step off, in the library's order.
_SCALERS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "StandardScaler": (("-", "mean_", "with_mean"), ("/", "scale_", "with_std")),
    "MinMaxScaler": (("*", "scale_", ""), ("+", "min_", "")),
    "RobustScaler": (("-", "center_", "with_centering"), ("/", "scale_", "with_scaling")),
    "MaxAbsScaler": (("/", "scale_", ""),),
}
_INVERSE = {"+": "-", "-": "+", "*": "/", "/": "*"}


def _steps(scaler: Fitted, width: int) -> Steps:
    """Operators with their constants, but for those that a parameter of the scaler switches off."""
    scaler.get("n_features_in_")  # an array that is switched off is there only after `fit`
    steps = [
        (operator, scaler.floats(attribute, (width,)))
        for operator, attribute, switch in _SCALERS[scaler.kind]
        if not switch or scaler.flag(switch)
    ]
    if any(operator == "/" and not constant.all() for operator, constant in steps):
        raise UnsupportedModelError(f"{scaler.kind} divides by 0: a number of scale_ is 0")
    return steps


#: What adds a function of each column to a builder, in the precision in which NumPy computes it.
_Adding = Callable[[GraphBuilder, int, ir.Precision], int]


def _function(kind: ir.Function) -> _Adding:
    return lambda builder, value, precision: builder.function(value, kind, precision=precision)


def _factor(function: np.ufunc) -> _Adding:
    """A function that is one product with what it makes of 1."""
    return lambda builder, value, precision: builder.scale(
        value, "*", float(function(np.dtype(precision.value).type(1.0))), precision=precision
    )


def _rebased(builder: GraphBuilder, value: int, factor: float, precision: ir.Precision) -> int:
    """A product that leads from one base of logarithms to another; the library has a formula of its own."""
    number = np.dtype(precision.value).type(factor)
    doubt = np.full(builder.width(value), float(np.spacing(number)))
    return builder.scale(value, "*", float(number), precision=precision, doubt=doubt)


def _logarithm(base: float) -> _Adding:
    return lambda builder, value, precision: _rebased(
        builder, builder.function(value, ir.Function.LOG, precision=precision), 1.0 / math.log(base), precision
    )


def _sign(builder: GraphBuilder, value: int, _: ir.Precision) -> int:
    """1 above 0, -1 below it, 0 between."""
    cut = np.zeros(builder.width(value))
    passed, reached = (builder.add(ir.Exceeds((value,), cut, inclusive)) for inclusive in (False, True))
    return builder.scale(builder.combine(passed, "+", reached), "-", 1.0)


def _tangent(builder: GraphBuilder, value: int, precision: ir.Precision) -> int:
    """The sine by the cosine; NumPy's own lies within what the bound allows for both and their quotient."""
    sine, cosine = (builder.function(value, kind, precision=precision) for kind in (ir.Function.SIN, ir.Function.COS))
    return builder.combine(sine, "/", cosine, precision=precision)


def _whole(towards: ir.Towards) -> _Adding:
    """Whole numbers, -0 as 0."""

    def add(builder: GraphBuilder, value: int, _: ir.Precision) -> int:
        builder.open_zeros = True
        return builder.add(ir.WholeNumber((value,), builder.width(value), towards))

    return add


#: Functions of NumPy that are compiled.
_FUNCTIONS: dict[Any, _Adding] = {
    np.log1p: _function(ir.Function.LOG1P),
    np.expm1: _function(ir.Function.EXPM1),
    np.exp: _function(ir.Function.EXP),
    np.log: _function(ir.Function.LOG),
    np.sqrt: _function(ir.Function.SQRT),
    np.square: lambda builder, value, precision: builder.combine(value, "*", value, precision=precision),
    np.absolute: _function(ir.Function.ABS),
    np.tanh: _function(ir.Function.TANH),
    np.sin: _function(ir.Function.SIN),
    np.cos: _function(ir.Function.COS),
    np.tan: _tangent,
    np.arctan: _function(ir.Function.ATAN),
    **{function: _factor(function) for function in (np.negative, np.deg2rad, np.radians, np.rad2deg, np.degrees)},
    np.reciprocal: lambda builder, value, precision: builder.scale(value, "/", 1.0, precision=precision, reverse=True),
    np.fabs: _function(ir.Function.ABS),
    np.positive: lambda _, value, __: value,
    np.log10: _logarithm(10.0),
    np.log2: _logarithm(2.0),
    np.exp2: lambda builder, value, precision: builder.function(
        _rebased(builder, value, math.log(2.0), precision), ir.Function.EXP, precision=precision
    ),
    np.sign: _sign,
    np.floor: _whole(ir.Towards.BELOW),
    np.ceil: _whole(ir.Towards.ABOVE),
    np.rint: _whole(ir.Towards.NEAREST),
    np.trunc: _whole(ir.Towards.ZERO),
}


def _add_function(function: Any, role: str, builder: GraphBuilder, value: int) -> int:
    if function is None:
        return value
    if not isinstance(function, np.ufunc) or function not in _FUNCTIONS:
        supported = ", ".join(f"numpy.{one.__name__}" for one in _FUNCTIONS)
        raise UnsupportedModelError(
            f"{role}={getattr(function, '__name__', function)!s}: a function that is not compiled; "
            f"supported are None (identity), {supported}, and numpy.clip with its two limits as kw_args"
        )
    return _FUNCTIONS[function](builder, value, builder.precision(value))


#: The limits of numpy.clip by their old names and by their new ones, and what each of them does.
_LIMITS = {"a_min": "max", "min": "max", "a_max": "min", "max": "min"}


def _clipped(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """`numpy.clip` with limits that are numbers; one of them may be missing."""
    given = {name: limit for name, limit in (fitted.get("kw_args") or {}).items() if limit is not None}
    known = all(name in _LIMITS and isinstance(limit, int | float | np.number) for name, limit in given.items())
    if not known or len({_LIMITS[name] for name in given}) < len(given):
        raise UnsupportedModelError(
            f"numpy.clip with kw_args={fitted.estimator.kw_args}: supported are two numbers, a_min and a_max"
        )
    # the upper limit comes last: it holds where it lies below the lower one
    for name in sorted(given, key=_LIMITS.__getitem__):
        limit = float(fitted.floats_of("kw_args", given[name], ()))
        value = builder.scale(value, _LIMITS[name], limit, precision=builder.precision(value))
    return value
