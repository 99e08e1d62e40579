"""Walkers for what scikit-learn computes by `transform`: selections, projections, unions, powers, kernels.

Projections add products through BLAS, whose order is not specified: equal within the bound of `proof/bounds.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import reduce
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import AnyArray, Clip, Distances, Exceeds, FloatArray, Kernel, KernelSum, Linear, SummationOrder
from st_codegen.walkers.base import GraphBuilder, NoColumnError, transforms, walk_transform
from st_codegen.walkers.fitted import SPARSE, Fitted
from st_codegen.walkers.sklearn.linear import block_sums, squares

KERNELS = {name: Kernel(name.replace("poly", "polynomial")) for name in ("linear", "poly", "rbf", "sigmoid")}


def weighted(builder: GraphBuilder, value: int, weights: Any, name: str, fitted: Fitted) -> int:
    """A part of a composition, times its weight where it has one (`transformer_weights`)."""
    if weights is None or weights.get(name) is None:
        return value
    weight = float(fitted.floats_of("transformer_weights", weights[name], ()))
    return builder.scale(value, "*", weight, precision=builder.precision(value))


@transforms("FeatureUnion", single=True)
def walk_union(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """All transformers on the same columns, results side by side."""
    given = [(name, part, None) for name, part in fitted.items("transformer_list") if part != "drop"]
    found, sparse = side_by_side(fitted, builder, value, given, "FeatureUnion drops every transformer")
    builder.sparse[found] = sparse
    return found


def walk_or_pass(step: Any, builder: GraphBuilder, value: int) -> int:
    """A step of a composition; 'passthrough' and None hand their input on."""
    return value if step is None or isinstance(step, str) else walk_transform(step, builder, value)


def side_by_side(
    fitted: Fitted, builder: GraphBuilder, value: int, given: Iterable[tuple[str, Any, AnyArray | None]], nothing: str
) -> tuple[int, bool]:
    """The results of named transformers of columns (None: all) side by side, and whether one of them is sparse.

    Those that keep no column add none, but what they refuse has no answer. `nothing`: what is said of none at all.
    """
    parts: list[int] = []
    refusing: list[int] = []
    sparse, empty = False, None
    for name, transformer, columns in given:
        before = len(builder.ops)
        try:
            found = walk_or_pass(transformer, builder, value if columns is None else builder.select(columns, value))
        except NoColumnError as error:
            refusing += builder.drop_since(before)
            sparse, empty = sparse or error.sparse, error
            continue
        sparse = sparse or builder.is_sparse(found)
        parts.append(weighted(builder, found, fitted.get("transformer_weights"), name, fitted))
    if not parts:
        raise NoColumnError(nothing, sparse)
    if empty is not None and all(map(builder.is_single, parts)):  # the type of what is empty decides on that of all
        raise UnsupportedModelError(f"{empty} beside columns of float32 only: leave it out") from empty
    return builder.select(np.arange(sum(map(builder.width, parts))), *parts, *refusing), sparse


@transforms(
    """
    GenericUnivariateSelect RFE RFECV SelectFdr SelectFpr SelectFromModel SelectFwe SelectKBest SelectPercentile
    SequentialFeatureSelector VarianceThreshold
    """,
    # functions that score features: none of them is called when features are selected
    trusts=tuple(
        f"sklearn.feature_selection.{name}"
        for name in (
            *("_univariate_selection.f_classif", "_univariate_selection.f_regression", "_univariate_selection.chi2"),
            *("_mutual_info.mutual_info_classif", "_mutual_info.mutual_info_regression"),
            "_univariate_selection.r_regression",
        )
    ),
    single=True,
)
def walk_selection(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The columns that are kept (`feature_selection/_base.py: SelectorMixin.transform`)."""
    kept = fitted.flags_of("get_support()", fitted.estimator.get_support(), (builder.width(value),))
    if not fitted.estimator.__sklearn_tags__().input_tags.allow_nan:
        builder.refuse_special(value)
    return builder.select(np.flatnonzero(kept), value)


@transforms(
    "FastICA TruncatedSVD NeighborhoodComponentsAnalysis GaussianRandomProjection SparseRandomProjection",
    trusts=SPARSE,
    finite=True,
)
def walk_projection(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Weighted sums of the columns, which FastICA centres where it whitens: `transform` of these classes."""
    weights = fitted.floats("components_", (None, builder.width(value)))
    if fitted.kind == "FastICA" and fitted.get("whiten") is not False:
        value = builder.scale(value, "-", fitted.floats("mean_", (builder.width(value),)))
    dense = fitted.kind != "SparseRandomProjection" or fitted.flag("dense_output")
    found = builder.linear(value, weights)
    return found if dense else builder.held_like(value, found)


@transforms("LinearDiscriminantAnalysis", finite=True)
def walk_discriminant(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The first directions between the classes (`discriminant_analysis.py: transform`)."""
    if fitted.estimator.solver not in ("svd", "eigen"):
        raise UnsupportedModelError(
            f"LinearDiscriminantAnalysis with solver={fitted.estimator.solver!r} has no transform"
        )
    if fitted.estimator.solver == "svd":
        value = builder.scale(value, "-", fitted.floats("xbar_", (builder.width(value),)))
    count = fitted.integer("_max_components", 1, 2**31 - 1)
    return builder.linear(value, fitted.floats("scalings_", (builder.width(value), None)).T[:count])


@transforms("PCA IncrementalPCA", finite=True, double="components_")
def walk_principal_components(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Projected columns, then minus the projected mean: that order (`decomposition/_base.py: _transform`).

    On demand the squared distance of what is read to `inverse_transform` of the columns.
    """
    width = builder.width(value)
    weights = fitted.floats("components_", (None, width))
    mean = fitted.floats("mean_", (width,))
    # products of the mean that cancel in the sum err in the library as much as they are large
    lost = np.abs(weights) @ np.abs(mean)
    columns = builder.linear(value, weights, -(weights @ mean), bias_terms=lost)
    scale = np.ones(len(weights))
    if fitted.flag("whiten"):
        scale = np.sqrt(fitted.floats("explained_variance_", (len(weights),)))
        columns = builder.scale(columns, "/", np.maximum(scale, np.finfo(np.float64).eps))

    def error() -> int:
        back = builder.linear(columns, (weights * scale[:, None]).T, mean)
        return block_sums(builder, squares(builder, builder.combine(value, "-", back)), 1, 1.0, np.zeros(1))

    builder.on_demand[columns] = error
    return columns


@transforms("FactorAnalysis", finite=True, double="components_")
def walk_factors(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The expected factors (`decomposition/_factor_analysis.py: transform`), which inverts a matrix at each call.

    Any inverse C of A by triangles T, U with T.U = A, in any order of additions, has |C.A - 1| <= g.|C|.|T|.|U|, where
    g is the relative error of some sums (Higham, Accuracy and Stability of Numerical Algorithms, chapter 14). Two of
    them, of matrices that lie D apart, differ by 2.g.|C|.|T|.|U|.|C| + |C|.D.|C| and terms of the second order.
    """
    from scipy import linalg

    width = builder.width(value)
    components = fitted.floats("components_", (None, width))
    noise = fitted.floats("noise_variance_", (width,))
    if np.any(noise <= 0):
        raise fitted.fail("noise_variance_", "not above 0")
    weights, count = components / noise, len(components)
    matrix = np.eye(count) + np.dot(weights, components.T)
    inverse = linalg.inv(matrix)
    rounding = 8 * (count + width + 4) * 2.0**-53
    apart = rounding * (np.eye(count) + np.abs(weights) @ np.abs(components.T))
    order, lower, upper = linalg.lu(matrix)
    root = np.abs(linalg.cholesky(matrix, lower=True))
    triangles = np.maximum(order @ np.abs(lower) @ np.abs(upper), root @ root.T)
    size = np.abs(inverse)
    doubt = size @ (2 * rounding * triangles + apart)
    if np.max(np.sum(doubt, axis=1), initial=0.0) >= 0.01:
        raise UnsupportedModelError("FactorAnalysis whose factors have no inverse in 64 bits: fewer n_components")
    value = builder.linear(builder.scale(value, "-", fitted.floats("mean_", (width,))), weights)
    return builder.add(Linear((value,), inverse.T, np.zeros(count), doubt=1.1 * (doubt @ size).T))


@transforms("FeatureAgglomeration", trusts=("numpy.mean",), finite=True)
def walk_pooled(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean of the columns of each group, added in their order (`cluster/_feature_agglomeration.py: transform`)."""
    if fitted.get("pooling_func") is not np.mean:
        raise UnsupportedModelError("FeatureAgglomeration with a pooling_func other than numpy.mean")
    groups = fitted.integers("labels_", (builder.width(value),), low=0, high=builder.width(value) - 1)
    sizes = np.bincount(groups)
    if not sizes.all():
        raise fitted.fail("labels_", "a group without columns")
    own = (groups == np.arange(len(sizes))[:, None]).astype(np.float64)
    return builder.scale(builder.linear(value, own, order=SummationOrder.SEQUENTIAL), "/", sizes.astype(np.float64))


@transforms("KernelPCA", trusts=("sklearn.preprocessing._data.KernelCenterer",), finite=True, double="X_fit_")
def walk_kernel_components(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Kernels with the training rows, less their means, weighted (`decomposition/_kernel_pca.py: transform`)."""
    vectors = fitted.floats("X_fit_", (None, builder.width(value)))
    count = len(vectors)
    values = fitted.floats("eigenvalues_", (None,))
    if np.any(values < 0):
        raise fitted.fail("eigenvalues_", "a negative number")
    weights = fitted.floats("eigenvectors_", (count, len(values)))
    weights = np.where(values > 0, weights / np.sqrt(np.where(values > 0, values, 1.0)), 0.0)
    kernels = _kernel_columns(fitted, builder, value, vectors)
    centerer = Fitted(fitted.get("_centerer"))
    mean = builder.scale(builder.linear(kernels, np.ones((1, count))), "/", float(count))
    centred = builder.scale(kernels, "-", centerer.floats("K_fit_rows_", (count,)))
    centred = builder.combine(centred, "-", builder.select(np.zeros(count, np.int32), mean))
    return builder.linear(builder.scale(centred, "+", centerer.number("K_fit_all_")), weights.T)


def _kernel_columns(fitted: Fitted, builder: GraphBuilder, value: int, vectors: FloatArray) -> int:
    """The kernel with each vector as a column (`metrics/pairwise.py: linear_kernel`, `rbf_kernel` and the like)."""
    kernel = fitted.choice("kernel", KERNELS)
    if kernel is Kernel.RBF:
        distances = builder.add(Distances((value,), vectors, expands=True))
        return builder.function(builder.scale(distances, "*", -fitted.number("gamma_")), "exp")
    products = builder.linear(value, vectors)
    if kernel is Kernel.LINEAR:
        return products
    products = builder.chain(products, ("*", fitted.number("gamma_")), ("+", fitted.number("coef0")))
    if kernel is Kernel.SIGMOID:
        return builder.function(products, "tanh")
    degree = fitted.number("degree")
    if degree != int(degree) or not 1 <= degree <= 64:
        raise UnsupportedModelError(f"{fitted.kind} with degree={degree}: supported are the whole numbers 1 .. 64")
    return builder.function(products, "power", degree)


@transforms("PolynomialFeatures", finite=True)
def walk_polynomial(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Products of columns, each the product of a shorter one and the column in front of it (`_polynomial.py`).

    In a sparse matrix it is the column behind it.
    """
    width, sparse = builder.width(value), builder.is_sparse(value)
    if not fitted.integer("n_output_features_", 0, 2**31 - 1):  # of which the library's own `powers_` makes an error
        return builder.held_like(value, builder.select([], value))
    powers = fitted.integers_of("powers_", fitted.estimator.powers_, (None, width), low=0, high=100)
    products = [tuple(np.repeat(np.arange(width), row).tolist()) for row in powers]

    def shortened(product: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
        return (product[:-1], product[-1]) if sparse else (product[1:], product[0])

    needed, longest = set(products), max(map(len, products), default=0)
    for degree in range(longest, 1, -1):
        needed |= {shortened(product)[0] for product in needed if len(product) == degree}
    places: dict[tuple[int, ...], tuple[int, int]] = {(column,): (value, column) for column in range(width)}
    for degree in range(2, longest + 1):
        longer = sorted(product for product in needed if len(product) == degree)
        shorter = places[shortened(longer[0])[0]][0]
        pairs = [
            builder.select(columns, source)
            for source, columns in (
                (shorter, [places[shortened(product)[0]][1] for product in longer]),
                (value, [shortened(product)[1] for product in longer]),
            )
        ]
        made = builder.combine(pairs[0], "*", pairs[1])
        places |= {product: (made, column) for column, product in enumerate(longer)}
    if () in products:
        first = builder.select(np.zeros(1, np.int32), value)
        places[()] = builder.add(Clip((first,), np.ones(1), np.ones(1))), 0
    sources = sorted({source for source, _ in places.values()})
    start = dict(zip(sources, np.cumsum([0, *(builder.width(source) for source in sources)]).tolist(), strict=False))
    columns = [start[places[product][0]] + places[product][1] for product in products]
    return builder.held_like(value, builder.select(columns, *sources))


@transforms("Normalizer", finite=True)
def walk_normalizer(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Columns divided by their norm; norms below ten units of rounding count as 1 (`_data.py: normalize`).

    In a sparse matrix only a norm of 0 does.
    """
    width, kind = builder.width(value), fitted.choice("norm", {"l1": "l1", "l2": "l2", "max": "max"})
    parts = squares(builder, value) if kind == "l2" else builder.function(value, "leaky_relu", -1.0)
    if kind == "max":
        norm = reduce(
            lambda one, n: builder.combine(one, "max", builder.select([n], parts)),
            range(1, width),
            builder.select([0], parts),
        )
    else:
        norm = builder.linear(parts, np.ones((1, width)))
    if kind == "l2":
        norm = builder.function(norm, "sqrt")
    least = math.ulp(0.0) if builder.is_sparse(value) else 10 * np.finfo(np.float64).eps
    large = builder.add(Exceeds((norm,), np.full(1, least), inclusive=True))
    kept = builder.combine(norm, "*", large)
    other = builder.scale(large, "-", 1.0, reverse=True)
    divisor = builder.combine(kept, "+", other)
    repeated = builder.select(np.zeros(width, np.int32), divisor)
    return builder.held_like(value, builder.combine(value, "/", repeated))


@transforms("PowerTransformer", double="lambdas_")
def walk_power(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Yeo and Johnson's, or Box and Cox's power of each column (`scipy/stats/_morestats.py: yeojohnson`, `boxcox`).

    A column's part above 0 and its part below 0 have powers of their own; one of the two is 0, and so is its power.
    """
    builder.refuse_magnitude(math.inf)
    powers = fitted.floats("lambdas_", (builder.width(value),))
    if fitted.estimator.method == "box-cox":
        value = _powered(builder, builder.function(value, "log"), powers)
    else:
        turned = builder.scale(value, "*", -1.0)
        parts = []
        for part, power in ((value, powers), (turned, 2.0 - powers)):
            positive = builder.function(part, "relu")
            logarithm = builder.function(positive, "log1p")
            parts.append(_powered(builder, logarithm, power))
        value = builder.combine(parts[0], "-", parts[1])
    return walk_transform(fitted.get("_scaler"), builder, value) if fitted.flag("standardize") else value


def _powered(builder: GraphBuilder, logarithm: int, powers: FloatArray) -> int:
    """(exp(power * logarithm) - 1) / power; the logarithm itself where the power is 0."""
    zero = np.abs(powers) <= np.finfo(np.float64).eps
    some = np.where(zero, 1.0, powers)
    exponent = builder.scale(logarithm, "*", some)
    power = builder.function(exponent, "expm1")
    shared = builder.scale(power, "/", some)
    if not zero.any():
        return shared
    columns = np.arange(len(powers)) + np.where(zero, len(powers), 0)
    return builder.select(columns, shared, logarithm)


def inverse_power(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """What a PowerTransformer makes numbers of (`preprocessing/_data.py: PowerTransformer.inverse_transform`).

    scipy's `inv_boxcox` is exp(log1p(power * x) / power). Yeo and Johnson's is a power of its own on each side of 0.
    """
    if fitted.flag("standardize"):
        scaler = Fitted(fitted.get("_scaler"))
        scale, mean = (scaler.floats(name, (builder.width(value),)) for name in ("scale_", "mean_"))
        value = builder.chain(value, ("*", scale), ("+", mean))
    powers = fitted.floats("lambdas_", (builder.width(value),))
    if fitted.estimator.method == "box-cox":
        columns = []
        for column, power in enumerate(powers.tolist()):
            exponent = builder.select([column], value)
            if power != 0.0:
                exponent = builder.scale(builder.function(builder.scale(exponent, "*", power), "log1p"), "/", power)
            columns.append(builder.function(exponent, "exp"))
        return builder.beside(*columns)
    turned = builder.scale(value, "*", -1.0)
    sides = []
    for side, given in ((value, powers), (turned, 2.0 - powers)):
        positive = builder.function(side, "relu")
        columns = []
        for column, power in enumerate(given.tolist()):
            own = builder.select([column], positive)
            if abs(power) <= np.finfo(np.float64).eps:
                columns.append(builder.function(own, "exp"))
            else:
                columns.append(builder.function(builder.chain(own, ("*", power), ("+", 1.0)), "power", 1.0 / power))
        sides.append(builder.scale(builder.beside(*columns), "-", 1.0))
    return builder.combine(sides[0], "-", sides[1])


@transforms(
    "KMeans MiniBatchKMeans BisectingKMeans",
    trusts=(
        "sklearn.cluster._bisect_k_means._BisectingTree",
        "sklearn.cluster._kmeans._kmeans_single_elkan",
        "sklearn.cluster._kmeans._kmeans_single_lloyd",
    ),
    finite=True,
)
def walk_centre_distances(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The distance to each centre (`metrics/pairwise.py: euclidean_distances`)."""
    centres = fitted.floats("cluster_centers_", (None, builder.width(value)))
    return euclidean(builder, value, centres, expands=True)


def euclidean(builder: GraphBuilder, value: int, vectors: FloatArray, *, expands: bool = False) -> int:
    """The Euclidean distance to each of some vectors."""
    return builder.add(Distances((value,), vectors, expands=expands, root=True))


@transforms("RBFSampler", finite=True)
def walk_random_features(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Cosines of random projections (`kernel_approximation.py: RBFSampler.transform`)."""
    weights = fitted.floats("random_weights_", (builder.width(value), None)).T
    angles = builder.linear(value, weights, fitted.floats("random_offset_", (len(weights),)))
    cosines = builder.function(angles, "cos")
    factor = (2.0 / fitted.integer("n_components", 1, 2**31 - 1)) ** 0.5
    return builder.scale(cosines, "*", factor)


@transforms("Nystroem", finite=True)
def walk_nystroem(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """Kernels with the components, then weighted sums of them (`kernel_approximation.py: Nystroem.transform`)."""
    if fitted.get("kernel_params"):
        raise UnsupportedModelError("Nystroem with kernel_params: give gamma, coef0 and degree by their own parameters")
    vectors = fitted.floats("components_", (None, builder.width(value)))
    return add_kernels(fitted, builder, value, vectors, fitted.floats("normalization_", (len(vectors), len(vectors))))


def add_kernels(fitted: Fitted, builder: GraphBuilder, value: int, vectors: FloatArray, weights: FloatArray) -> int:
    """Sums of kernels with vectors, weighted (sums, vectors): `pairwise_kernels` by the parameters of an estimator."""

    def given(name: str, default: float) -> float:
        return default if fitted.get(name) is None else fitted.number(name)

    degree = given("degree", 3.0)
    if degree != int(degree) or degree < 0:
        raise UnsupportedModelError(f"{fitted.kind} with degree={degree}: supported are whole numbers")
    return builder.add(
        KernelSum(
            inputs=(value,),
            # the kernel functions, though no SVC, take the long name for the same
            kernel=fitted.choice("kernel", KERNELS | {"polynomial": Kernel.POLYNOMIAL}),
            support_vectors=vectors,
            coefficients=weights,
            intercept=np.zeros(len(weights)),
            gamma=given("gamma", 1.0 / builder.width(value)),
            coef0=given("coef0", 1.0),
            degree=int(degree),
            expands=True,
        )
    )
