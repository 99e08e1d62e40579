"""Walkers for scikit-learn's estimators that keep the training rows: nearest neighbours and Gaussian processes.

Which of several rows is nearer may hang on the rounding of distances, and of equally near ones libraries take any: the
bound (`proof/bounds.py`) then spans all answers that are possible.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

from st_codegen.errors import UnsupportedModelError, counted
from st_codegen.ir import (
    MAX_DEVIATION_ROWS,
    Clip,
    Distances,
    Exceeds,
    FillMissing,
    FloatArray,
    Kernel,
    KernelSum,
    Linear,
    NearestMean,
)
from st_codegen.walkers.base import Classified, Estimated, GraphBuilder, transforms, walk_classifier, walks
from st_codegen.walkers.classes import above, complement, label_of, labels_of, largest, whole_sums
from st_codegen.walkers.fitted import Fitted
from st_codegen.walkers.sklearn.linear import block_sums, squares
from st_codegen.walkers.sklearn.pieces import add_pieces, indicated, indicators, missing_value
from st_codegen.walkers.sklearn.transforms import euclidean
from st_codegen.walkers.sklearn.wrappers import constants

#: Names of the Manhattan distance, and that of the largest difference.
_SUMS, _LARGEST = ("manhattan", "cityblock", "l1"), "chebyshev"
#: Classes of search trees by the method that an estimator names.
_TREES = {"kd_tree": "KDTree", "ball_tree": "BallTree"}


class StoredSearchTree:
    """A search tree in a `.skops` file, or its metric: numbers that scikit-learn's native code would follow unchecked.

    A tree finds rows faster and changes no distance, so it is built anew of the rows that the file holds.
    """

    def __setstate__(self, state: Any) -> None:
        """Keep the rows, which stand first."""
        self.data = state[0] if isinstance(state, tuple) and state else None


def _distances(fitted: Fitted, builder: GraphBuilder, value: int) -> tuple[int, int]:
    """The distance to each training row, and their number."""
    builder.refuse_special(value)
    metric, method = fitted.get("effective_metric_"), fitted.get("_fit_method")
    rows = fitted.get("_fit_X")
    if type(rows).__module__.startswith("scipy.sparse"):
        raise UnsupportedModelError(f"{fitted.kind} was fitted on a sparse matrix: fit it on a dense array")
    if metric not in ("euclidean", "l2", _LARGEST, *_SUMS) or not isinstance(rows, np.ndarray):
        power = f", p={fitted.get('p')}" if metric == "minkowski" else ""
        said = repr(metric) if isinstance(metric, str) else f"the object {type(metric).__name__}"
        raise UnsupportedModelError(
            f"{fitted.kind} with metric={said}{power}: supported are Euclidean, Manhattan and Chebyshev distances, by "
            "their names"
        )
    # native code takes the metric from either name, and numbers beside it that it reads without a look
    given = fitted.get("metric")
    meant = {1: "manhattan", 2: "euclidean", math.inf: _LARGEST}.get(fitted.get("p")) if given == "minkowski" else given
    if fitted.get("metric_params") or fitted.get("effective_metric_params_") or meant != metric:
        raise UnsupportedModelError(f"{fitted.kind} with metric_params, or with a metric that is not {metric}")
    vectors = fitted.floats("_fit_X", (None, builder.width(value)))
    if method != "brute":
        kind, tree = fitted.choice("_fit_method", _TREES), fitted.get("_tree")
        if type(tree).__name__ not in (kind, "StoredSearchTree") or not np.array_equal(np.asarray(tree.data), vectors):
            raise fitted.fail("_tree", "does not hold the training rows")
        # as `fit` builds it (`neighbors/_base.py: NeighborsBase._fit`)
        build = getattr(importlib.import_module("sklearn.neighbors"), kind)
        fitted.estimator._tree = build(vectors, fitted.integer("leaf_size", 1, 2**31 - 1), metric=metric)
    if metric in (_LARGEST, *_SUMS):
        distances = Distances((value,), vectors, squared=False, largest=metric == _LARGEST)
        return builder.add(distances), len(vectors)
    return euclidean(builder, value, vectors, expands=method == "brute"), len(vectors)


def _inverse(fitted: Fitted, supported: tuple[str, ...] = ("uniform", "distance")) -> bool:
    if fitted.get("weights") not in supported:
        given = fitted.get("weights") if isinstance(fitted.get("weights"), str) else "a function"
        raise UnsupportedModelError(f"{fitted.kind} with weights={given}: supported are {', '.join(supported)}")
    return bool(fitted.get("weights") == "distance")


def _nearest(fitted: Fitted, count: int) -> int:
    """How many of the training rows a row is compared with."""
    nearest = fitted.integer("n_neighbors", 1, 2**31 - 1)
    if nearest > count:
        raise UnsupportedModelError(
            f"{fitted.kind} with n_neighbors={nearest} of {counted(count, 'training row')}: scikit-learn raises, too; "
            "fit it on more rows, or with fewer neighbours"
        )
    return nearest


@walks("KNeighborsRegressor", trusts=(f"{__name__}.StoredSearchTree",), double="_y")
def walk_nearest(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean over the nearest training rows (`neighbors/_regression.py: predict`)."""
    distances, count = _distances(fitted, builder, value)
    targets = fitted.floats("_y", (count,), (count, None)).reshape(count, -1)
    nearest = _nearest(fitted, count)
    return builder.add(NearestMean((distances,), targets.T, nearest, _inverse(fitted)))


@walks("KNeighborsClassifier")
def walk_nearest_classes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The first class of most among the nearest training rows (`neighbors/_classification.py: predict`)."""
    labels = labels_of(fitted)
    distances, count = _distances(fitted, builder, value)
    codes = fitted.integers("_y", (count,), low=0, high=len(labels) - 1)
    nearest = _nearest(fitted, count)
    shares = builder.add(NearestMean((distances,), np.eye(len(labels))[codes].T, nearest, _inverse(fitted)))
    return Classified(labels, largest(builder, shares), shares)


@walks("LocalOutlierFactor")
def walk_local_outliers(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """How dense the nearest training rows lie beside this one (`neighbors/_lof.py: score_samples`); 1 from 0 on."""
    if not fitted.flag("novelty"):
        raise UnsupportedModelError("LocalOutlierFactor predicts new rows with novelty=True only: fit it so")
    distances, count = _distances(fitted, builder, value)
    nearest = fitted.integer("n_neighbors_", 1, count)
    own = fitted.floats("_distances_fit_X_", (count, nearest))[:, -1]
    reached = builder.scale(distances, "max", own)
    mean = builder.add(NearestMean((distances, reached), np.ones((1, count)), nearest))
    density = builder.scale(builder.scale(mean, "+", 1e-10), "/", 1.0, reverse=True)
    others = builder.add(NearestMean((distances,), fitted.floats("_lrd", (count,))[None, :], nearest))
    ratio = builder.combine(others, "/", density)
    decision = builder.chain(ratio, ("*", -1.0), ("-", fitted.number("offset_")))
    return Classified((-1, 1), above(builder, decision, inclusive=True), decision=decision)


@walks("RadiusNeighborsRegressor", double="_y")
def walk_radius(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean over all training rows within the radius; without any no answer (`neighbors/_regression.py`)."""
    distances, count = _distances(fitted, builder, value)
    return _within(fitted, builder, distances, fitted.floats("_y", (count,), (count, None)).reshape(count, -1))


@walks("RadiusNeighborsClassifier")
def walk_radius_classes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The first class of most training rows within the radius; without any the label for outliers, or no answer.

    Where that label is a class, its share is 1, otherwise all are 0 (`neighbors/_classification.py: predict`). With
    algorithm='brute', and distances of which it counts labels in native code, the library takes the label for the
    number of the class (`RadiusNeighborsClassMode`).
    """
    labels, given = labels_of(fitted), fitted.get("outlier_label")
    distances, count = _distances(fitted, builder, value)
    codes = fitted.integers("_y", (count,), low=0, high=len(labels) - 1)
    if given is None:
        shares = _within(fitted, builder, distances, np.eye(len(labels))[codes])
        return Classified(labels, largest(builder, shares), shares)
    (chosen,) = fitted.items("outlier_label_", 1)
    outlier = label_of(chosen)
    if isinstance(outlier, int) and abs(outlier) < 2**1023 and type(labels[0]) in (int, float):  # NumPy makes it alike
        outlier = type(labels[0])(outlier)
    if type(outlier) is not type(labels[0]):
        raise fitted.fail("outlier_label_", "not a label of the type of the others")
    by_number = fitted.get("_fit_method") == "brute" and fitted.get("_fit_X").dtype == np.float64
    by_number &= fitted.get("effective_metric_") != "euclidean"
    listed = tuple(range(len(labels))) if by_number else labels
    sought = label_of(given) if by_number else outlier
    shares, none = _within_or_none(fitted, builder, distances, np.eye(len(labels))[codes])
    if sought in listed:
        shares = _marked(builder, shares, none, listed.index(sought))
        return Classified(labels, largest(builder, shares), shares)
    known = labels if outlier in labels else (*labels, outlier)
    scores = shares if outlier in labels else builder.beside(shares, none)
    return Classified(known, largest(builder, _marked(builder, scores, none, known.index(outlier))), shares)


def _marked(builder: GraphBuilder, shares: int, none: int, place: int) -> int:
    """Shares, to one of which 1 is added where there is no row."""
    count = builder.width(shares)
    return builder.combine(shares, "+", builder.scale(_each(builder, none, count), "*", np.eye(count)[place]))


def _each(builder: GraphBuilder, value: int, count: int) -> int:
    return builder.select([0] * count, value)


def _within_or_none(fitted: Fitted, builder: GraphBuilder, distances: int, targets: FloatArray) -> tuple[int, int]:
    """The shares of the classes among all rows within the radius, and 1 where there is none, of which all are 0."""
    _inverse(fitted, ("uniform",))
    count, outputs = targets.shape
    counted = whole_sums(builder, _inside(fitted, builder, distances, count), targets.T, np.zeros(outputs))
    found = whole_sums(builder, counted, np.ones((1, outputs)), np.zeros(1))
    none = builder.scale(above(builder, found), "-", 1.0, reverse=True)
    divisor = _each(builder, builder.combine(found, "+", none), outputs)
    return builder.combine(counted, "/", divisor), none


def _inside(fitted: Fitted, builder: GraphBuilder, distances: int, count: int) -> int:
    """1 for each training row within the radius, else 0."""
    turned = builder.scale(distances, "*", -1.0)
    return builder.add(Exceeds((turned,), np.full(count, -fitted.number("radius")), inclusive=True))


def _within(fitted: Fitted, builder: GraphBuilder, distances: int, targets: FloatArray) -> int:
    """The means of the targets (rows, outputs) of all rows within the radius."""
    _inverse(fitted, ("uniform",))
    count, outputs = targets.shape
    inside = _inside(fitted, builder, distances, count)
    sums = builder.linear(inside, np.vstack([targets.T, np.ones(count)]))
    total = builder.select(range(outputs), sums)
    found = builder.select(np.full(outputs, outputs, np.int32), sums)
    return builder.combine(total, "/", found)


#: A sum of kernels below which exponentials lose their digits.
_VANISHES = 1e-290


@walks("LabelPropagation LabelSpreading", finite=True, double="X_")
def walk_propagated(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The shares of the classes near a row (`semi_supervised/_label_propagation.py: predict_proba`)."""
    labels = labels_of(fitted)
    vectors = fitted.floats("X_", (None, builder.width(value)))
    shares = fitted.floats("label_distributions_", (len(vectors), len(labels)))
    if fitted.choice("kernel", {"rbf": True, "knn": False}):
        gamma = fitted.number("gamma")
        sums = builder.add(
            KernelSum((value,), Kernel.RBF, vectors, shares.T, np.zeros(len(labels)), gamma, expands=True)
        )
    else:
        near = Fitted(fitted.get("nn_fit"))
        distances, count = _distances(near, builder, value)
        nearest = _nearest(near, count)
        if count != len(vectors):
            raise near.fail("_fit_X", "not the training rows")
        sums = builder.add(NearestMean((distances,), shares.T, nearest, divides=False))
    total = builder.linear(sums, np.ones((1, len(labels))))
    # of kernels that vanish nothing is left to divide by, in the library at a smaller number than in the block
    vanishes = add_pieces(
        builder, total, [(np.array([_VANISHES]), np.zeros(1), np.array([[math.inf], [0.0]]), math.nan)]
    )
    total = builder.select([0] * len(labels), builder.combine(total, "+", vanishes))
    found = builder.combine(sums, "/", total)
    return Classified(labels, largest(builder, found), found)


#: A distance beyond all that are known, for rows that have no column in common with the one that is read.
_FAR = 1e300


@transforms("KNNImputer", double="_fit_X")
def walk_nearest_imputer(fitted: Fitted, builder: GraphBuilder, value: int) -> int:
    """The mean over the nearest training rows that have a column, where it is missing (`impute/_knn.py: transform`).

    Distances are those of the columns that both rows have, in proportion to their number (`metrics/pairwise.py:
    nan_euclidean_distances`, whose terms cancel). A row without a column in common does not count; where none has one,
    the mean of all training rows is taken.
    """
    width = builder.width(value)
    if fitted.get("metric") != "nan_euclidean":
        raise UnsupportedModelError("KNNImputer with a metric of its own: supported is 'nan_euclidean'")
    weighted = fitted.get("weights") is not None and _inverse(fitted)
    missing = missing_value(fitted, builder, value)
    gaps = fitted.flags("_mask_fit_X", (None, width))
    rows = fitted.floats_of("_fit_X", np.where(gaps, 0.0, fitted.get("_fit_X")), gaps.shape)
    absent = indicators(builder, value, missing, range(width))
    filled = builder.add(FillMissing((value,), np.zeros(width), None if math.isnan(missing) else missing))
    squared, own = squares(builder, filled), np.sum(rows**2, axis=1)
    terms, weights = [squared, filled, absent], [np.ones_like(rows), -2.0 * rows, -(rows**2)]
    if gaps.any():
        terms.append(squared)
        weights.append(-gaps.astype(np.float64))
    total = builder.linear(builder.beside(*terms), np.hstack(weights), own, bias_terms=own)
    here = builder.scale(absent, "-", 1.0, reverse=True)
    shared = whole_sums(builder, here, (~gaps).astype(np.float64), np.zeros(len(rows)))
    mean = builder.scale(builder.combine(total, "/", builder.scale(shared, "max", 1.0)), "*", float(width))
    known = above(builder, shared)
    far = builder.chain(known, ("*", -_FAR), ("+", _FAR))
    distances = builder.combine(_root(builder, mean), "+", far)
    kept = np.flatnonzero(~gaps.all(axis=0))
    if not len(kept):
        raise UnsupportedModelError("KNNImputer of columns that were all missing in training")
    found = []
    for column in kept.tolist():
        donors = np.flatnonzero(~gaps[:, column])
        values, near = rows[donors, column], min(fitted.integer("n_neighbors", 1, 2**31 - 1), len(donors))
        inputs = [builder.select(donors, distances), builder.select(donors, known)]
        some = above(builder, whole_sums(builder, inputs[1], np.ones((1, len(donors))), np.zeros(1)))
        none = builder.scale(some, "-", 1.0, reverse=True)
        if weighted or not gaps.any():  # without gaps in training all distances are known, or none is
            nearest = builder.add(NearestMean((inputs[0],), values[None, :], near, weighted))
        else:
            both = np.vstack([values, np.ones(len(donors))])
            sums = builder.add(NearestMean(tuple(inputs), both, near, divides=False))
            divisor = builder.combine(builder.select([1], sums), "+", none)
            nearest = builder.combine(builder.select([0], sums), "/", divisor)
        # NumPy adds the numbers of a column in an order of its own
        doubt = len(donors) * np.finfo(np.float64).eps * np.mean(np.abs(values), keepdims=True)
        usual = builder.scale(none, "*", float(np.mean(values)), doubt=doubt)
        found.append(builder.combine(builder.combine(nearest, "*", some), "+", usual))
    made = builder.combine(builder.beside(*found), "*", builder.select(kept, absent))
    result = builder.combine(builder.select(kept, filled), "+", made)
    if fitted.flag("keep_empty_features") and len(kept) < width:
        places = np.full(width, len(kept))
        places[kept] = np.arange(len(kept))
        result = builder.select(places, result, constants(builder, value, np.zeros(1)))
    return indicated(fitted, builder, value, missing, result)


_KERNELS = tuple(
    "ConstantKernel DotProduct ExpSineSquared Matern Product RBF RationalQuadratic Sum WhiteKernel".split()
)
_TRUSTED_KERNELS = tuple(f"sklearn.gaussian_process.kernels.{name}" for name in _KERNELS)


@walks("GaussianProcessRegressor", trusts=_TRUSTED_KERNELS, finite=True)
def walk_gaussian_process(fitted: Fitted, builder: GraphBuilder, value: int) -> Estimated:
    """Kernels with the training rows, weighted (`gaussian_process/_gpr.py: predict`): the mean, and the deviation."""
    vectors = fitted.floats("X_train_", (None, builder.width(value)))
    weights = fitted.floats("alpha_", (len(vectors),), (len(vectors), None)).reshape(len(vectors), -1)
    outputs = weights.shape[1]
    kernels = _kernel(fitted.get("kernel_"), builder, value, vectors)
    if isinstance(kernels, float):
        raise UnsupportedModelError("GaussianProcessRegressor with a constant kernel: the model is a constant")
    mean = builder.linear(kernels, weights.T)
    factor, offset = (fitted.floats(name, (), (1,), (outputs,)) for name in ("_y_train_std", "_y_train_mean"))
    mean = builder.chain(mean, ("*", factor), ("+", offset))

    def deviation() -> int:
        weights, doubt = _solving(fitted, len(vectors))
        solved = builder.add(Linear((kernels,), weights, np.zeros(len(weights)), doubt=doubt))
        variance = _variance(fitted, builder, value, solved)
        # the library sets what is negative to 0 before it scales: with factors of at least 0 that is the same number
        each = builder.scale(builder.select([0] * outputs, variance), "*", factor**2)
        return _root(builder, each)

    return Estimated(mean, deviation if len(vectors) <= MAX_DEVIATION_ROWS else None)


#: The error functions whose weighted sum stands for a logistic function (`gaussian_process/_gpc.py`).
_SLOPES = np.array([0.41, 0.4, 0.37, 0.44, 0.39])
_SHARES = np.array([-1854.8214151, 3516.89893646, 221.29346712, 128.12323805, -2010.49422654])


@walks(
    "_BinaryGaussianProcessClassifierLaplace",
    trusts=("sklearn.gaussian_process._gpc._BinaryGaussianProcessClassifierLaplace", *_TRUSTED_KERNELS),
    finite=True,
)
def walk_binary_process(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """The second class where the mean is above 0 (`gaussian_process/_gpc.py: predict`, `predict_proba`).

    Its probability is a sum of error functions of the mean by how far it may be off. Their weights are large and
    cancel, so that what the error function of the block may err by counts some thousand times.
    """
    labels, vectors = labels_of(fitted), fitted.floats("X_train_", (None, builder.width(value)))
    count = len(vectors)
    kernels = _kernel(fitted.get("kernel_"), builder, value, vectors)
    if isinstance(kernels, float):
        raise UnsupportedModelError("GaussianProcessClassifier with a constant kernel: the model is a constant")
    mean = builder.linear(kernels, (fitted.floats("y_train_", (count,)) - fitted.floats("pi_", (count,)))[None, :])
    index = above(builder, mean)
    if count > MAX_DEVIATION_ROWS:
        return Classified(labels, index)
    weights, doubt = _solving(fitted, count, 3.0)
    scaled = builder.scale(kernels, "*", fitted.floats("W_sr_", (count,)))
    variance = _variance(fitted, builder, value, builder.add(Linear((scaled,), weights, np.zeros(count), doubt=doubt)))
    precision = builder.scale(builder.scale(variance, "*", 2.0), "/", 1.0, reverse=True)
    several = [0] * len(_SLOPES)
    beside = builder.function(builder.scale(builder.select(several, precision), "+", _SLOPES**2), "sqrt")
    root = builder.select(several, builder.function(precision, "sqrt"))  # of a variance below 0 there is none
    turned = builder.scale(builder.select(several, mean), "*", _SLOPES)
    errors = builder.function(builder.combine(turned, "*", builder.combine(root, "/", beside)), "erf")
    probability = builder.linear(errors, 0.5 * _SHARES[None, :], np.full(1, 0.5 * float(_SHARES.sum())))
    return Classified(labels, index, complement(builder, probability))


@walks("GaussianProcessClassifier", finite=True)
def walk_process_classes(fitted: Fitted, builder: GraphBuilder, value: int) -> Classified:
    """One process for two classes, else several of them, one against the rest or one against another."""
    return walk_classifier(fitted.get("base_estimator_"), builder, value)


def _variance(fitted: Fitted, builder: GraphBuilder, value: int, solved: int) -> int:
    """What the kernel of a row with itself has beyond the squares of what was solved."""
    known = block_sums(builder, squares(builder, solved), 1, 1.0, np.zeros(1))
    prior = _prior(fitted.get("kernel_"), builder, value)
    return int(_combined(builder, "+", [builder.scale(known, "*", -1.0), prior]))


def _root(builder: GraphBuilder, value: int) -> int:
    """The square roots of numbers, of which those below 0 count as 0."""
    ends = np.zeros(builder.width(value)), np.full(builder.width(value), np.finfo(np.float64).max)
    return builder.function(builder.add(Clip((value,), *ends)), "sqrt")


def _solving(fitted: Fitted, count: int, steps: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """The inverse of the lower triangle `L_`, and how far from it the library's solution may lie, for each kernel.

    Substitution in any order of additions solves (L + D).v = k with |D| <= g.|L|, where g is the relative error of a
    sum of so many terms (Higham, Accuracy and Stability of Numerical Algorithms, theorem 8.5); twice that is taken
    here, since some libraries multiply by reciprocals, and three times that (`steps`) where the library's general
    solver divides the triangle by its diagonal first. So |v - v'| <= h.(1 - h)^-1.|L^-1|.|k| with h = g.|L^-1|.|L|.
    The inverse W itself is off by at most |W|.r.(1 - r)^-1, where r bounds |1 - L.W|, with its roundings.
    """
    lower = np.tril(fitted.floats("L_", (count, count)))
    if np.any(np.diagonal(lower) <= 0):
        raise fitted.fail("L_", "a diagonal that is not above 0")
    rounding = steps * (count + 4) * 2.0**-53
    one = np.eye(count)
    inverse = np.tril(np.linalg.solve(lower, one))
    size = np.abs(lower)

    def grown(factor: FloatArray, matrix: FloatArray) -> FloatArray:
        """factor.(1 - factor)^-1.matrix of triangles that are nowhere negative, and a little more for the roundings."""
        if np.any(np.diagonal(factor) >= 0.5):
            raise UnsupportedModelError(
                "a Gaussian process whose L_ has no inverse in 64 bits: add noise to its kernel"
            )
        return np.asarray(np.tril(np.abs(np.linalg.solve(one - factor, factor @ matrix))) * 1.001)

    left = np.abs(one - lower @ inverse) + rounding * (size @ np.abs(inverse))
    off = grown(left.T[::-1, ::-1], np.abs(inverse).T[::-1, ::-1])[::-1, ::-1].T
    largest = np.abs(inverse) + off
    return inverse, off + grown(rounding * (largest @ size), largest)


def _prior(kernel: Any, builder: GraphBuilder, value: int) -> int | float:
    """The kernel of a row with itself, as `diag` of `gaussian_process/kernels.py` computes it."""
    fitted = Fitted(kernel)
    if fitted.kind in ("Sum", "Product"):
        parts = [_prior(fitted.get(name), builder, value) for name in ("k1", "k2")]
        return _combined(builder, "+" if fitted.kind == "Sum" else "*", parts)
    if fitted.kind == "DotProduct":
        return block_sums(builder, squares(builder, value), 1, 1.0, np.full(1, fitted.number("sigma_0") ** 2))
    numbers = {"ConstantKernel": "constant_value", "WhiteKernel": "noise_level"}
    return fitted.number(numbers[fitted.kind]) if fitted.kind in numbers else 1.0


def _kernel(kernel: Any, builder: GraphBuilder, value: int, vectors: FloatArray) -> int | float:
    """The kernel with each training row as a value, or the number that it is (`gaussian_process/kernels.py`)."""
    fitted = Fitted(kernel)
    if fitted.kind in ("Sum", "Product"):
        parts = [_kernel(fitted.get(name), builder, value, vectors) for name in ("k1", "k2")]
        return _combined(builder, "+" if fitted.kind == "Sum" else "*", parts)
    if fitted.kind == "ConstantKernel":
        return fitted.number("constant_value")
    if fitted.kind == "WhiteKernel":  # only a training row with itself has noise in common
        return 0.0
    if fitted.kind == "DotProduct":
        return builder.linear(value, vectors, np.full(len(vectors), fitted.number("sigma_0") ** 2))
    if fitted.kind not in _KERNELS:
        raise UnsupportedModelError(f"a Gaussian process with {fitted.kind}: supported are {', '.join(_KERNELS)}")
    return _of_distance(fitted, builder, value, vectors)


def _of_distance(fitted: Fitted, builder: GraphBuilder, value: int, vectors: FloatArray) -> int:
    """A kernel of the distances to the training rows."""
    width = builder.width(value)
    given = fitted.get("length_scale")
    if isinstance(given, list | tuple):  # as the user gave it, where no optimizer changed it
        given = np.array([float(fitted.floats_of("length_scale", one, ())) for one in given])
    length = np.broadcast_to(fitted.floats_of("length_scale", given, (), (1,), (width,)), (width,))
    if np.any(length <= 0):
        raise fitted.fail("length_scale", "not above 0")
    if fitted.kind == "RationalQuadratic":
        alpha = fitted.number("alpha")
        squared = builder.add(Distances((value,), vectors))
        scale = 2 * alpha * float(length[0]) ** 2
        # the sum is rounded before its power is taken, which a large alpha makes as large
        base = builder.chain(squared, ("/", scale), ("+", 1.0))
        logarithm = builder.function(base, "log")
        return builder.function(builder.scale(logarithm, "*", -alpha), "exp")
    if fitted.kind == "ExpSineSquared":
        distance = euclidean(builder, value, vectors)
        period = fitted.number("periodicity")
        if period <= 0:
            raise fitted.fail("periodicity", "not above 0")
        angle = builder.chain(distance, ("*", math.pi), ("/", period))
        sine = builder.scale(builder.function(angle, "sin"), "/", float(length[0]))
        return builder.function(builder.scale(squares(builder, sine), "*", -2.0), "exp")
    scaled = builder.scale(value, "/", length)
    smoothness = math.inf if fitted.kind == "RBF" else float(fitted.get("nu"))
    if smoothness == math.inf:
        squared = builder.add(Distances((scaled,), vectors / length))
        return builder.function(builder.scale(squared, "*", -0.5), "exp")
    if smoothness not in (0.5, 1.5, 2.5):
        raise UnsupportedModelError(f"Matern with nu={smoothness}: supported are 0.5, 1.5, 2.5 and infinity")
    distance = euclidean(builder, scaled, vectors / length)
    argument = builder.scale(distance, "*", math.sqrt(2.0 * smoothness)) if smoothness > 1 else distance
    decay = builder.function(builder.scale(argument, "*", -1.0), "exp")
    if smoothness < 1:
        return decay
    factor = builder.scale(argument, "+", 1.0)
    if smoothness > 2:
        third = builder.scale(squares(builder, argument), "/", 3.0)
        factor = builder.combine(factor, "+", third)
    return builder.combine(factor, "*", decay)


def _combined(builder: GraphBuilder, operator: str, parts: list[int | float]) -> int | float:
    """The sum or the product of two kernels, of which any may be a number."""
    one, other = parts
    if isinstance(one, float) and isinstance(other, float):
        return one + other if operator == "+" else one * other
    if isinstance(one, float):
        one, other = other, one
    if isinstance(other, float):
        return builder.scale(int(one), operator, other)
    return builder.combine(int(one), operator, other)
