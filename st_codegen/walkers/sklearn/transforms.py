"""Walkers for what scikit-learn computes by `transform`: selections, projections, unions.

Projections add products through BLAS, whose order is not specified: equal within the bound of `bounds.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import FloatArray, Linear, Operator, Scale, Select
from st_codegen.walkers.base import GraphBuilder, transforms, walk_transform
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.sklearn.linear import refuse_nan_and_infinity


def side_by_side(builder: GraphBuilder, values: list[int]) -> int:
    """All columns of several values, one value after another."""
    total = sum(builder.width(value) for value in values)
    return builder.add(Select(tuple(values), np.arange(total, dtype=np.int32)))


def weighted(builder: GraphBuilder, value: int, weights: Any, name: str, fitted: Fitted) -> int:
    """A part of a composition, times its weight where it has one (`transformer_weights`)."""
    if weights is None or weights.get(name) is None:
        return value
    weight = float(fitted.floats_of("transformer_weights", weights[name], ()))
    return builder.add(Scale((value,), Operator.MULTIPLY, np.full(builder.width(value), weight)))


@transforms("sklearn.FeatureUnion")
def walk_union(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """All transformers on the same columns, results side by side."""
    fitted = Fitted(estimator)
    parts = []
    for name, part in fitted.items("transformer_list"):
        if part != "drop":
            found = value if part == "passthrough" else walk_transform(part, builder, value)
            parts.append(weighted(builder, found, fitted.get("transformer_weights"), name, fitted))
    if not parts:
        raise UnsupportedModelError("FeatureUnion drops every transformer")
    return side_by_side(builder, parts)


@transforms(
    *(
        f"sklearn.{name}"
        for name in """
        GenericUnivariateSelect RFE RFECV SelectFdr SelectFpr SelectFromModel SelectFwe SelectKBest SelectPercentile
        SequentialFeatureSelector VarianceThreshold
        """.split()
    ),
    # functions that score features: none of them is called when features are selected
    trusts=tuple(
        f"sklearn.feature_selection.{name}"
        for name in (
            *("_univariate_selection.f_classif", "_univariate_selection.f_regression", "_univariate_selection.chi2"),
            *("_mutual_info.mutual_info_classif", "_mutual_info.mutual_info_regression"),
        )
    ),
)
def walk_selection(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The columns that are kept (`feature_selection/_base.py: SelectorMixin.transform`)."""
    fitted = Fitted(estimator)
    kept = fitted.flags_of("get_support()", estimator.get_support(), (builder.width(value),))
    if not kept.any():
        raise UnsupportedModelError(f"{fitted.kind} keeps no column")
    if not estimator.__sklearn_tags__().input_tags.allow_nan:
        refuse_nan_and_infinity(builder, value)
    return builder.add(Select((value,), np.flatnonzero(kept).astype(np.int32)))


#: Before the projection: what is done to each column, and the names of the arrays.
Before = tuple[tuple[Operator, str], ...]


def _centred(fitted: Fitted, builder: GraphBuilder, value: int, before: Before) -> int:
    for operator, name in before:
        value = builder.add(Scale((value,), operator, fitted.floats(name, (builder.width(value),))))
    return value


def _matrix(fitted: Fitted, name: str, width: int, *, turned: bool) -> FloatArray:
    """A matrix (outputs, columns) that stands in an attribute so, or `turned` (columns, outputs)."""
    given = fitted.get(name)
    dense = given.toarray() if type(given).__module__.startswith("scipy.sparse") else given
    return fitted.floats_of(name, dense, (width, None)).T if turned else fitted.floats_of(name, dense, (None, width))


#: What is done to each column before the weighted sums.
_PROJECTIONS: dict[str, Before] = {
    "FastICA": ((Operator.SUBTRACT, "mean_"),),
    "TruncatedSVD": (),
    "GaussianRandomProjection": (),
    "SparseRandomProjection": (),
}


@transforms(*(f"sklearn.{name}" for name in _PROJECTIONS), trusts=("scipy.sparse._csr.csr_matrix",))
def walk_projection(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Columns centred (or scaled, or as they are), then weighted sums: `transform` of these classes."""
    fitted = Fitted(estimator)
    before = _PROJECTIONS[fitted.kind]
    fitted.get("components_")
    refuse_nan_and_infinity(builder, value)
    if fitted.kind == "FastICA" and fitted.get("whiten") is False:
        before = ()
    value = _centred(fitted, builder, value, before)
    weights = _matrix(fitted, "components_", builder.width(value), turned=False)
    return builder.add(Linear((value,), weights, np.zeros(len(weights))))


@transforms("sklearn.LinearDiscriminantAnalysis")
def walk_discriminant(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The first directions between the classes (`discriminant_analysis.py: transform`)."""
    fitted = Fitted(estimator)
    if estimator.solver not in ("svd", "eigen"):
        raise UnsupportedModelError(f"LinearDiscriminantAnalysis with solver={estimator.solver!r} has no transform")
    refuse_nan_and_infinity(builder, value)
    if estimator.solver == "svd":
        value = _centred(fitted, builder, value, ((Operator.SUBTRACT, "xbar_"),))
    count = fitted.integer("_max_components", 1, 2**31 - 1)
    weights = _matrix(fitted, "scalings_", builder.width(value), turned=True)[:count]
    return builder.add(Linear((value,), weights, np.zeros(len(weights))))


@transforms("sklearn.PCA", "sklearn.IncrementalPCA")
def walk_principal_components(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Projected columns, then minus the projected mean: that order (`decomposition/_base.py: _transform`)."""
    fitted = Fitted(estimator)
    refuse_nan_and_infinity(builder, value)
    width = builder.width(value)
    weights = fitted.floats("components_", (None, width))
    mean = fitted.floats("mean_", (width,))
    # products of the mean that cancel in the sum err in the library as much as they are large
    lost = np.abs(weights) @ np.abs(mean)
    value = builder.add(Linear((value,), weights, -(weights @ mean), bias_terms=lost))
    if not fitted.flag("whiten"):
        return value
    scale = np.sqrt(fitted.floats("explained_variance_", (len(weights),)))
    return builder.add(Scale((value,), Operator.DIVIDE, np.maximum(scale, np.finfo(np.float64).eps)))
