"""Walkers for scikit-learn's detectors of anomalies, clusterings and projections."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError, counted
from st_codegen.ir import FloatArray, SummationOrder
from st_codegen.walkers.base import Classified, GraphBuilder, walks
from st_codegen.walkers.classes import above, largest, last_below, softmax, whole_sums
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.sklearn.linear import block_sums, negative_square_distances, squares
from st_codegen.walkers.sklearn.pieces import add_pieces
from st_codegen.walkers.sklearn.trees import TreeSum, add_float32_trees
from st_codegen.walkers.sklearn.wrappers import constants

_INLIERS = (-1, 1)


@walks("IsolationForest", trusts=("sklearn.tree._tree.Tree",), single=True)
def walk_isolation_forest(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Lengths of paths, added in order; the score is 2 to the minus their mean, in units of what is usual.

    The label is 1 where the score does not lie below `offset_` (`_iforest.py: _compute_score_samples, predict`). The
    sum of the lengths at which that changes is found by bisection, so that labels are exact.
    """
    trees = fitted.items("estimators_")
    width, count = builder.width(value), len(trees)
    columns = None
    if fitted.integer("_max_features", 1, width) != width:
        columns = [
            fitted.integers_of("estimators_features_", part, (None,), low=0, high=width - 1)
            for part in fitted.items("estimators_features_", count)
        ]
    paths = [np.asarray(path, np.float64) for path in fitted.items("_decision_path_lengths", count)]
    usual = [np.asarray(path, np.float64) for path in fitted.items("_average_path_length_per_tree", count)]
    for tree, path, mean in zip(trees, paths, usual, strict=True):
        if path.shape != (tree.tree_.node_count,) or mean.shape != path.shape:
            raise fitted.fail("_decision_path_lengths", "not one number a node")
    leaves = [(path + mean - 1.0)[:, None] for path, mean in zip(paths, usual, strict=True)]
    depth = add_float32_trees(builder, value, trees, fitted, TreeSum(leaves=leaves, columns=columns))
    samples, offset = fitted.integer("_max_samples", 1, 2**53), fitted.number("offset_")
    unit = count * _usual_length(samples)
    longest = sum(float(np.max(lengths)) for lengths in leaves)
    if not unit > 0.0:
        raise UnsupportedModelError("IsolationForest of trees of one sample each, whose score is the same for all rows")
    if longest * math.log(2.0) > 8.0 * unit:
        raise UnsupportedModelError(f"IsolationForest with paths longer than any in trees of {samples} samples each")
    cut = last_below(
        lambda depth: (-(2 ** (-np.divide(np.full(1, depth), unit))) - offset >= 0)[0],
        np.float64,
        (-1.0, 2.0 * longest + 1.0),
    )
    # 2 ** x as exp(x * log(2)): |x * log(2)| is below 8, so that the roundings before the exponential are few units
    score = builder.function(builder.chain(depth, ("/", unit), ("*", -math.log(2.0))), "exp")
    decision = builder.chain(score, ("*", -1.0), ("-", offset))
    return Classified(_INLIERS, above(builder, depth, cut), decision=decision)


def _usual_length(samples: int) -> float:
    """`_iforest.py: _average_path_length` of one number of samples."""
    if samples <= 2:
        return float(samples == 2)
    return float(2.0 * (np.log(samples - 1.0) + np.euler_gamma) - 2.0 * (samples - 1.0) / samples)


@walks("EllipticEnvelope", finite=True)
def walk_envelope(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Minus the square of Mahalanobis' distance against `offset_` (`_elliptic_envelope.py: predict`)."""
    width = builder.width(value)
    precision = fitted.floats("precision_", (width, width))
    centred = builder.scale(value, "-", fitted.floats("location_", (width,)))
    # x.P.x is the sum over the columns of P of (x.P) * x
    turned = builder.linear(centred, precision.T)
    products = builder.combine(turned, "*", centred)
    distance = block_sums(builder, products, 1, -1.0, np.zeros(1))
    decision = builder.scale(distance, "-", fitted.number("offset_"))
    return Classified(_INLIERS, above(builder, decision, inclusive=True), decision=decision)


@walks("SGDOneClassSVM", finite=True)
def walk_linear_one_class(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """A weighted sum less `offset_`; 1 from 0 on (`linear_model/_stochastic_gradient.py: SGDOneClassSVM`)."""
    total = builder.linear(value, fitted.floats("coef_", (builder.width(value),))[None, :])
    decision = builder.scale(total, "-", fitted.floats("offset_", (1,)))
    return Classified(_INLIERS, above(builder, decision, inclusive=True), decision=decision)


@walks("KMeans MiniBatchKMeans MeanShift AffinityPropagation", finite=True, double="cluster_centers_")
def walk_clusters(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The nearest centre, the first of equal ones (`cluster/_k_means_lloyd.pyx: lloyd_iter_chunked_dense`)."""
    if hasattr(
        fitted.estimator, "_n_threads"
    ):  # of the machine that trained it; native code starts as many, however many
        fitted.estimator._n_threads = 1
    centres = fitted.floats("cluster_centers_", (None, builder.width(value)))
    if not len(centres):
        raise UnsupportedModelError(f"{fitted.kind} found no clusters, since it did not converge: more max_iter")
    near = negative_square_distances(builder, value, centres)
    return Classified(tuple(range(len(centres))), largest(builder, near))


@walks("Birch", finite=True, double="subcluster_centers_")
def walk_subclusters(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The label of the nearest subcluster, the first of equal ones (`cluster/_birch.py: Birch._predict`)."""
    centres = fitted.floats("subcluster_centers_", (None, builder.width(value)))
    given = fitted.integers("subcluster_labels_", (len(centres),), low=-(2**31), high=2**31 - 1)
    labels, codes = np.unique(given, return_inverse=True)
    nearest = largest(builder, negative_square_distances(builder, value, centres))
    knots, pieces = np.arange(float(len(centres))), np.zeros((len(centres) + 1, 1))
    found = add_pieces(builder, nearest, [(knots, codes.astype(np.float64), pieces, math.nan)])
    return Classified(tuple(labels.tolist()), found)


@walks("BisectingKMeans", finite=True, double="cluster_centers_")
def walk_bisections(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """Down a tree to the nearer of two centres, of equal ones to the left (`_bisect_k_means.py: _predict_recursive`).

    A leaf is reached where all decisions above it are its own: the number of those, less that of all above it, is 0
    there and negative for every other leaf.
    """
    fitted.estimator._n_threads = 1  # as of KMeans
    width, count = builder.width(value), fitted.integer("n_clusters", 1, 2**31 - 1)
    moved = fitted.floats("_X_mean", (width,)) if hasattr(fitted.estimator, "_X_mean") else 0.0
    centres: list[FloatArray] = []
    paths: dict[int, list[tuple[int, float]]] = {}
    waiting: list[tuple[Any, list[tuple[int, float]]]] = [(fitted.get("_bisecting_tree"), [])]
    while waiting:
        node, path = waiting.pop()
        own = Fitted(node)
        if own.get("left") is None:
            paths[own.integer("label", 0, count - 1)] = path
            continue
        number = len(centres) // 2
        if number >= count:
            raise fitted.fail("_bisecting_tree", f"more than {counted(count - 1, 'decision')}")
        for side in ("left", "right"):
            centres.append(Fitted(own.get(side)).floats("center", (width,)) + moved)
            waiting.append((own.get(side), [*path, (number, float(side == "right"))]))
    if sorted(paths) != list(range(count)):
        raise fitted.fail("_bisecting_tree", f"not {counted(count, 'leaf', 'leaves')}")
    if count == 1:
        return Classified((0,), constants(builder, value, np.zeros(1)))
    near = negative_square_distances(builder, value, np.array(centres))
    left, right = (builder.select(np.arange(side, len(centres), 2), near) for side in (0, 1))
    turns = above(builder, builder.combine(right, "-", left))
    table, met = np.zeros((count, len(centres) // 2)), np.zeros(count)
    for leaf, path in paths.items():
        for number, turned in path:
            table[leaf, number], met[leaf] = 2.0 * turned - 1.0, met[leaf] - turned
    return Classified(tuple(range(count)), largest(builder, whole_sums(builder, turns, table, met)))


@walks("GaussianMixture BayesianGaussianMixture", finite=True, double="precisions_cholesky_")
def walk_mixture(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The most probable component (`mixture/_gaussian_mixture.py: _estimate_log_gaussian_prob`)."""
    width = builder.width(value)
    means = fitted.floats("means_", (None, width))
    count = len(means)
    full = fitted.estimator.covariance_type in ("full", "tied")
    norms, determinants = (_turned if full else _straight)(fitted, builder, value, means)
    of_components = _of_components if fitted.kind == "GaussianMixture" else _of_expected_components
    scores = builder.chain(norms, ("*", -0.5), ("+", determinants), *of_components(fitted, means))
    return Classified(tuple(range(count)), largest(builder, scores), softmax(builder, scores))


def _of_components(fitted: Fitted, means: FloatArray) -> list[tuple[str, FloatArray]]:
    """What is added for the share of each component."""
    weights = fitted.floats("weights_", (len(means),))
    if np.any(weights <= 0):
        raise fitted.fail("weights_", "a component without weight")
    return [("+", np.log(weights))]


def _of_expected_components(fitted: Fitted, means: FloatArray) -> list[tuple[str, FloatArray]]:
    """As `_of_components`, for shares and precisions that have distributions of their own.

    `mixture/_bayesian_mixture.py: _estimate_log_prob, _estimate_log_weights`, step by step.
    """
    from scipy.special import digamma

    count, width = means.shape
    degrees = fitted.floats("degrees_of_freedom_", (), (count,))  # one where the precisions are tied
    precision = fitted.floats("mean_precision_", (count,))
    given = fitted.get("weight_concentration_")
    if fitted.estimator.weight_concentration_prior_type == "dirichlet_process":
        one, other = (fitted.floats_of("weight_concentration_", part, (count,)) for part in given)
        both = digamma(one + other)
        shares = digamma(one) - both + np.hstack((0, np.cumsum(digamma(other) - both)[:-1]))
    else:
        one = fitted.floats_of("weight_concentration_", given, (count,))
        shares = digamma(one) - digamma(np.sum(one))
    turns = digamma(0.5 * (degrees - np.arange(width)[:, None]))
    spread = 0.5 * (width * np.log(2.0) + np.sum(turns, 0) - width / precision)
    return [("-", 0.5 * width * np.log(degrees)), ("+", spread), ("+", shares)]


def _turned(fitted: Fitted, builder: GraphBuilder, value: int, means: FloatArray) -> tuple[int, FloatArray]:
    """Distances from the means by whole covariances, plus the constant of the density, and their determinants."""
    count, width = means.shape
    shape = (count, width, width) if fitted.get("covariance_type") == "full" else (width, width)
    roots = np.broadcast_to(fitted.floats("precisions_cholesky_", shape), (count, width, width))
    if np.any(np.diagonal(roots, axis1=1, axis2=2) <= 0):
        raise fitted.fail("precisions_cholesky_", "a component without extent")
    parts = []
    for mean, root in zip(means, roots, strict=True):
        # the mean as a value of its own: the library multiplies it by the root, and errs in proportion to both
        fixed = builder.linear(value, np.zeros((width, width)), mean, order=SummationOrder.SEQUENTIAL)
        both = builder.beside(value, fixed)
        moved = builder.linear(both, np.hstack([root.T, -root.T]))
        parts.append(block_sums(builder, squares(builder, moved), 1, 1.0, np.full(1, width * math.log(2 * math.pi))))
    norms = builder.beside(*parts)
    return norms, np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1)


def _straight(fitted: Fitted, builder: GraphBuilder, value: int, means: FloatArray) -> tuple[int, FloatArray]:
    """As `_turned`, for a variance a column, or one for all: squares are expanded, as the library does."""
    count, width = means.shape
    diagonal = fitted.get("covariance_type") == "diag"
    roots = fitted.floats("precisions_cholesky_", (count, width) if diagonal else (count,))
    roots = np.broadcast_to(roots if diagonal else roots[:, None], means.shape)
    if np.any(roots <= 0):
        raise fitted.fail("precisions_cholesky_", "a component without extent")
    precisions = roots**2
    both = builder.beside(squares(builder, value), value)
    fixed = np.sum(means**2 * precisions, axis=1) + width * math.log(2 * math.pi)
    weights = np.hstack([precisions, -2.0 * means * precisions])
    return builder.linear(both, weights, fixed, bias_terms=fixed), np.sum(np.log(roots), axis=1)
