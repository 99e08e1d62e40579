"""Walkers for what scikit-learn computes by `transform`: selections, projections, unions, powers, kernels.

Projections add products through BLAS, whose order is not specified: equal within the bound of `bounds.py`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import (
    Activation,
    Clip,
    Combine,
    Distances,
    Exceeds,
    FloatArray,
    Function,
    Kernel,
    KernelSum,
    Linear,
    Operator,
    Scale,
    Select,
)
from st_codegen.walkers.base import GraphBuilder, transforms, walk_transform
from st_codegen.walkers.fitted import SPARSE, Fitted
from st_codegen.walkers.sklearn.linear import refuse_nan_and_infinity, squares

KERNELS = {
    "linear": Kernel.LINEAR,
    "poly": Kernel.POLYNOMIAL,
    "rbf": Kernel.RBF,
    "sigmoid": Kernel.SIGMOID,
}


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


#: What is done to each column before the weighted sums.
_PROJECTIONS: dict[str, Before] = {
    "FastICA": ((Operator.SUBTRACT, "mean_"),),
    "NeighborhoodComponentsAnalysis": (),
    "TruncatedSVD": (),
    "GaussianRandomProjection": (),
    "SparseRandomProjection": (),
}


@transforms(*(f"sklearn.{name}" for name in _PROJECTIONS), trusts=SPARSE)
def walk_projection(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Columns centred (or scaled, or as they are), then weighted sums: `transform` of these classes."""
    fitted = Fitted(estimator)
    before = _PROJECTIONS[fitted.kind]
    fitted.get("components_")
    refuse_nan_and_infinity(builder, value)
    if fitted.kind == "FastICA" and fitted.get("whiten") is False:
        before = ()
    value = _centred(fitted, builder, value, before)
    weights = fitted.floats("components_", (None, builder.width(value)))
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
    weights = fitted.floats("scalings_", (builder.width(value), None)).T[:count]
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


@transforms("sklearn.PolynomialFeatures")
def walk_polynomial(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Products of columns, each the product of a shorter one and the column in front of it (`_polynomial.py`)."""
    fitted = Fitted(estimator)
    refuse_nan_and_infinity(builder, value)
    width = builder.width(value)
    powers = fitted.integers_of("powers_", estimator.powers_, (None, width), low=0, high=100)
    products = [tuple(np.repeat(np.arange(width), row).tolist()) for row in powers]
    needed = {product[start:] for product in products for start in range(len(product))}
    places: dict[tuple[int, ...], tuple[int, int]] = {(column,): (value, column) for column in range(width)}
    for degree in range(2, max(map(len, products), default=0) + 1):
        longer = sorted(product for product in needed if len(product) == degree)
        shorter = places[longer[0][1:]][0]
        pairs = [
            builder.add(Select((source,), np.array(columns, np.int32)))
            for source, columns in (
                (shorter, [places[product[1:]][1] for product in longer]),
                (value, [product[0] for product in longer]),
            )
        ]
        made = builder.add(Combine((pairs[0], pairs[1]), Operator.MULTIPLY, len(longer)))
        places |= {product: (made, column) for column, product in enumerate(longer)}
    if () in products:
        first = builder.add(Select((value,), np.zeros(1, np.int32)))
        places[()] = builder.add(Clip((first,), np.ones(1), np.ones(1))), 0
    sources = sorted({source for source, _ in places.values()})
    start = dict(zip(sources, np.cumsum([0, *(builder.width(source) for source in sources)]).tolist(), strict=False))
    columns = [start[places[product][0]] + places[product][1] for product in products]
    return builder.add(Select(tuple(sources), np.array(columns, np.int32)))


@transforms("sklearn.Normalizer")
def walk_normalizer(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Columns divided by their norm; norms below ten units of rounding count as 1 (`_data.py: normalize`)."""
    if estimator.norm not in ("l1", "l2"):
        raise UnsupportedModelError(f"Normalizer with norm={estimator.norm!r}: supported are 'l1' and 'l2'")
    refuse_nan_and_infinity(builder, value)
    width = builder.width(value)
    parts = squares(builder, value) if estimator.norm == "l2" else _sizes(builder, value)
    norm = builder.add(Linear((parts,), np.ones((1, width)), np.zeros(1)))
    if estimator.norm == "l2":
        norm = builder.add(Activation((norm,), Function.SQRT, 1))
    large = builder.add(Exceeds((norm,), np.full(1, 10 * np.finfo(np.float64).eps), inclusive=True))
    kept = builder.add(Combine((norm, large), Operator.MULTIPLY, 1))
    other = builder.add(Scale((large,), Operator.SUBTRACT, np.ones(1), reverse=True))
    divisor = builder.add(Combine((kept, other), Operator.ADD, 1))
    repeated = builder.add(Select((divisor,), np.zeros(width, np.int32)))
    return builder.add(Combine((value, repeated), Operator.DIVIDE, width))


def _sizes(builder: GraphBuilder, value: int) -> int:
    return builder.add(Activation((value,), Function.LEAKY_RELU, builder.width(value), -1.0))


@transforms("sklearn.PowerTransformer")
def walk_power(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Yeo and Johnson's, or Box and Cox's power of each column (`scipy/stats/_morestats.py: yeojohnson`, `boxcox`).

    A column's part above 0 and its part below 0 have powers of their own; one of the two is 0, and so is its power.
    """
    fitted = Fitted(estimator)
    builder.refuse_magnitude(math.inf)
    powers = fitted.floats("lambdas_", (builder.width(value),))
    if estimator.method == "box-cox":
        builder.refuse_nan(value)
        value = _powered(builder, builder.add(Activation((value,), Function.LOG, len(powers))), powers)
    else:
        turned = builder.add(Scale((value,), Operator.MULTIPLY, np.full(len(powers), -1.0)))
        parts = []
        for part, power in ((value, powers), (turned, 2.0 - powers)):
            positive = builder.add(Activation((part,), Function.RELU, len(powers)))
            logarithm = builder.add(Activation((positive,), Function.LOG1P, len(powers)))
            parts.append(_powered(builder, logarithm, power))
        value = builder.add(Combine((parts[0], parts[1]), Operator.SUBTRACT, len(powers)))
    return walk_transform(fitted.get("_scaler"), builder, value) if fitted.flag("standardize") else value


def _powered(builder: GraphBuilder, logarithm: int, powers: FloatArray) -> int:
    """(exp(power * logarithm) - 1) / power; the logarithm itself where the power is 0."""
    zero = np.abs(powers) <= np.finfo(np.float64).eps
    some = np.where(zero, 1.0, powers)
    exponent = builder.add(Scale((logarithm,), Operator.MULTIPLY, some))
    power = builder.add(Activation((exponent,), Function.EXPM1, len(powers)))
    shared = builder.add(Scale((power,), Operator.DIVIDE, some))
    if not zero.any():
        return shared
    columns = np.arange(len(powers)) + np.where(zero, len(powers), 0)
    return builder.add(Select((shared, logarithm), columns.astype(np.int32)))


@transforms("sklearn.KMeans", "sklearn.MiniBatchKMeans", "sklearn.BisectingKMeans")
def walk_centre_distances(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """The distance to each centre (`metrics/pairwise.py: euclidean_distances`)."""
    refuse_nan_and_infinity(builder, value)
    centres = Fitted(estimator).floats("cluster_centers_", (None, builder.width(value)))
    return euclidean(builder, value, centres, expands=True)


def euclidean(builder: GraphBuilder, value: int, vectors: FloatArray, *, expands: bool = False) -> int:
    """The Euclidean distance to each of some vectors."""
    return builder.add(Distances((value,), vectors, expands=expands, root=True))


@transforms("sklearn.RBFSampler")
def walk_random_features(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Cosines of random projections (`kernel_approximation.py: RBFSampler.transform`)."""
    fitted = Fitted(estimator)
    refuse_nan_and_infinity(builder, value)
    weights = fitted.floats("random_weights_", (builder.width(value), None)).T
    angles = builder.add(Linear((value,), weights, fitted.floats("random_offset_", (len(weights),))))
    cosines = builder.add(Activation((angles,), Function.COS, len(weights)))
    factor = (2.0 / fitted.integer("n_components", 1, 2**31 - 1)) ** 0.5
    return builder.add(Scale((cosines,), Operator.MULTIPLY, np.full(len(weights), factor)))


@transforms("sklearn.Nystroem")
def walk_nystroem(estimator: Any, builder: GraphBuilder, value: int) -> int:
    """Kernels with the components, then weighted sums of them (`kernel_approximation.py: Nystroem.transform`)."""
    fitted = Fitted(estimator)
    kernel = fitted.choice("kernel", KERNELS)
    refuse_nan_and_infinity(builder, value)
    if fitted.get("kernel_params"):
        raise UnsupportedModelError("Nystroem with kernel_params: give gamma, coef0 and degree by their own parameters")
    width = builder.width(value)
    vectors = fitted.floats("components_", (None, width))
    weights = fitted.floats("normalization_", (len(vectors), len(vectors)))

    def given(name: str, default: float) -> float:
        return default if fitted.get(name) is None else fitted.number(name)

    degree = given("degree", 3.0)
    if degree != int(degree) or degree < 0:
        raise UnsupportedModelError(f"Nystroem with degree={degree}: supported are whole numbers")
    return builder.add(
        KernelSum(
            inputs=(value,),
            kernel=kernel,
            support_vectors=vectors,
            coefficients=weights,
            intercept=np.zeros(len(vectors)),
            gamma=given("gamma", 1.0 / width),
            coef0=given("coef0", 1.0),
            degree=int(degree),
            expands=True,
        )
    )
