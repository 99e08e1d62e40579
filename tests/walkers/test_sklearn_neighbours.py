"""Neighbours, Gaussian processes, what PCA leaves, weighted medians, chains and mixtures against scikit-learn."""

import warnings
from fractions import Fraction
from operator import mul

import numpy as np
import pytest

pytest.importorskip("sklearn")

from scipy.sparse import csr_matrix
from sklearn.compose import ColumnTransformer
from sklearn.decomposition import PCA, IncrementalPCA
from sklearn.ensemble import AdaBoostRegressor, VotingRegressor
from sklearn.gaussian_process import GaussianProcessClassifier, GaussianProcessRegressor
from sklearn.gaussian_process import kernels as gp
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.metrics import DistanceMetric
from sklearn.mixture import GaussianMixture
from sklearn.model_selection import GridSearchCV
from sklearn.multioutput import ClassifierChain, MultiOutputClassifier
from sklearn.neighbors import (
    KNeighborsClassifier,
    KNeighborsRegressor,
    LocalOutlierFactor,
    RadiusNeighborsClassifier,
    RadiusNeighborsRegressor,
)
from sklearn.pipeline import FeatureUnion, Pipeline, make_pipeline
from sklearn.preprocessing import PowerTransformer, StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import MAX_DEVIATION_ROWS, NearestMean, OutputKind, WeightedMedian, reference
from st_codegen.proof import bounds
from tests.classifiers import SCORE, THREE, TWO, WORDS, X, loaded, verified

#: Rows with many equal distances, and rows that stand twice with different answers.
GRID = np.round(X * [1.0, 0.2, 5.0])
HALVES = GRID + 0.5
NUMBERS = np.column_stack([SCORE, X[:, 1]])

REGRESSORS = {
    "nearest": (KNeighborsRegressor(4), X, SCORE),
    "nearest, brute": (KNeighborsRegressor(3, algorithm="brute"), X, NUMBERS),
    "nearest, Manhattan, weighted": (KNeighborsRegressor(5, p=1, weights="distance"), X, SCORE),
    "nearest, weighted, brute": (KNeighborsRegressor(5, weights="distance", algorithm="brute"), X, SCORE),
    "nearest of a grid": (KNeighborsRegressor(3), GRID, SCORE),
    "nearest of a grid, weighted": (KNeighborsRegressor(6, weights="distance"), GRID, SCORE),
    "nearest by names of the distances": (KNeighborsRegressor(4, metric="cityblock"), X, SCORE),
    "radius": (RadiusNeighborsRegressor(1.5), X, SCORE),
    "nearest by the largest difference": (KNeighborsRegressor(4, metric="chebyshev"), X, SCORE),
    "nearest by it on a grid, brute": (KNeighborsRegressor(3, p=np.inf, algorithm="brute"), GRID, SCORE),
    "median": (AdaBoostRegressor(n_estimators=12, random_state=0), X, SCORE),
    "median of equal weights": (AdaBoostRegressor(Ridge(), n_estimators=4, random_state=0), X, SCORE),
}
KERNELS = {
    "default": None,
    "sum": gp.ConstantKernel(2.0) * gp.RBF([1.0, 2.0, 0.5]) + gp.WhiteKernel(0.1),
    "Matern 1/2": gp.Matern(nu=0.5) + gp.WhiteKernel(0.1),
    "Matern 3/2": gp.Matern(1.5, nu=1.5) * gp.DotProduct() + gp.WhiteKernel(0.1),
    "Matern 5/2": gp.ConstantKernel(0.5) + gp.Matern([1.0, 4.0, 0.3], nu=2.5) + gp.WhiteKernel(0.1),
    "Matern without end": gp.Matern(nu=np.inf) + gp.WhiteKernel(0.1),
    "rational": gp.RationalQuadratic(1.2, 0.7) + gp.WhiteKernel(0.1),
    "periodic": gp.ExpSineSquared(0.8, 2.5) * gp.RBF(3.0) + gp.WhiteKernel(60.0),
}


def fit(estimator, x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return estimator.fit(x, y)


def agrees(model, rows):
    found, bound = reference.evaluate(model.ir, rows), bounds.difference_bound(model.ir, rows)
    usable = np.isfinite(found).all(axis=1)
    assert np.all(np.abs(model.predict(rows[usable]) - found[usable]) <= bound[usable])
    return usable, bound[usable]


@pytest.mark.thorough
@pytest.mark.parametrize("name", REGRESSORS)
def test_regressors_agree_with_the_library_where_it_has_one_answer(name, tmp_path):
    estimator, x, y = REGRESSORS[name]
    model = loaded(fit(estimator, x, y))
    verified(model, tmp_path, rows=150)
    usable, bound = agrees(model, np.vstack([x, HALVES, x + 1e-9, 1.1 * x - 0.3]))
    assert usable.mean() > 0.8
    # rows beside the training rows; on a grid the nearest are often equally near
    beside = bound[-len(x) // 2 :]
    assert np.min(beside) < 1e-9 if "grid" in name else np.median(beside) < 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize("name", KERNELS)
def test_gaussian_processes(name, tmp_path):
    process = GaussianProcessRegressor(KERNELS[name], normalize_y=name == "sum", optimizer=None, alpha=1e-3)
    model = loaded(fit(process, X[:60], SCORE[:60]))
    assert model.ir.outputs == ("mean", "standard deviation")
    verified(model, tmp_path, rows=100)
    _, bound = agrees(model, np.vstack([X, X[::-1, ::-1]]))
    assert np.max(bound) < 1e-7


@pytest.mark.thorough
@pytest.mark.parametrize("kernel", [None, 2.0 * gp.RBF([1.0, 3.0, 0.5]) + gp.WhiteKernel(0.1), gp.Matern(nu=1.5)])
@pytest.mark.parametrize(("classes", "way"), [(TWO, "one_vs_rest"), (WORDS, "one_vs_rest"), (THREE + 4, "one_vs_one")])
def test_classes_of_gaussian_processes(classes, way, kernel, tmp_path):
    process = fit(GaussianProcessClassifier(kernel, optimizer=None, multi_class=way), X[:60], classes[:60])
    model = loaded(process)
    assert (OutputKind.PROBABILITY in model.ir.kinds) == (way == "one_vs_rest")
    verified(model, tmp_path, rows=100)
    agrees(model, np.vstack([X[::-1, ::-1], 100 * X]))  # kernels vanish far from all training rows, and no sign is left
    usable, bound = agrees(model, np.vstack([X[:60], X[:60] + 0.1, X[1:60] / 2 + X[:59] / 2]))
    assert usable.all() and np.mean(bound[:, 0] == 0) > 0.5 and np.max(bound[:, 1:], initial=0.0) < 1e-5


def test_classes_of_a_large_gaussian_process_are_labels_only():
    model = loaded(fit(GaussianProcessClassifier(optimizer=None), np.resize(X, (513, 3)), np.resize(TWO, 513)))
    assert set(model.ir.kinds) == {OutputKind.CLASS}
    agrees(model, X)


@pytest.mark.parametrize("alpha", [1.0, 1e3, 1e5])
def test_the_bound_of_a_rational_kernel_covers_the_sum_that_is_rounded_before_a_large_power(alpha):
    kernel = gp.RationalQuadratic(1.3, alpha)
    model = loaded(fit(GaussianProcessRegressor(kernel, optimizer=None, alpha=1e-9), X[:60], 1e3 * SCORE[:60]))
    agrees(model, np.vstack([X, X[::-1, ::-1]]))


def test_deviations_of_several_outputs_near_training_rows_and_in_a_pipeline(tmp_path):
    process = make_pipeline(StandardScaler(), GaussianProcessRegressor(normalize_y=True, optimizer=None))
    model = loaded(fit(process, X[:60], NUMBERS[:60]))
    assert model.ir.outputs == ("mean 1", "mean 2", "standard deviation 1", "standard deviation 2")
    rows = np.vstack([X[:60], X[:60] + 1e-7, X])
    _, bound = agrees(model, rows)
    # what is left of the variance on a training row is noise of 1e-10 and the rounding of the equations: its root
    # has few digits, and the bound says so
    library = model.predict(rows)
    assert np.max(library[:60, 2]) < 1e-3 < np.max(library[:, 2])
    assert np.max(bound[:, 2:]) < 1e-2 and np.median(bound[120:, 2:]) < 1e-9
    report = verified(model, tmp_path, rows=60)
    assert np.isfinite(report.max_abs_err)
    plain = loaded(process, (OutputKind.MEAN,)).ir
    assert plain.outputs == ("mean 1", "mean 2") and not any(getattr(op, "doubt", None) is not None for op in plain.ops)


@pytest.mark.parametrize(
    "components",
    [PCA(2), PCA(1, whiten=True), IncrementalPCA(2), make_pipeline(StandardScaler(), make_pipeline(PCA(2)))],
    ids=["PCA", "whitened", "incremental", "scaled"],
)
def test_what_principal_components_leave_of_their_inputs(components, tmp_path):
    components.fit(X)
    model = loaded(components, (OutputKind.RECONSTRUCTION,))
    count = len(model.ir.outputs) - 1
    assert model.ir.outputs == (*(f"out{n + 1}" for n in range(count)), "squared reconstruction error")
    verified(model, tmp_path, rows=60)
    _, bound = agrees(model, np.vstack([X, X[::-1, ::-1]]))
    assert np.max(bound) < 1e-9
    read = components[:-1].transform(X) if isinstance(components, Pipeline) else X
    last = components[-1] if isinstance(components, Pipeline) else components
    missed = read - last.inverse_transform(last.transform(read))
    error = model.predict(X)[:, count]
    assert np.allclose(error, (missed**2).sum(axis=1), rtol=1e-9) and np.max(error) > 1e-3
    assert loaded(components, (OutputKind.COLUMN,)).ir.outputs == model.ir.outputs[:count]


@pytest.mark.parametrize(
    "columns",
    [
        make_pipeline(PCA(2), "passthrough"),
        ColumnTransformer([("a", PCA(2), slice(0, 3))]),
        FeatureUnion([("a", PCA(2))]),
    ],
    ids=["passed through", "of columns", "united"],
)
def test_columns_that_do_not_come_from_a_pca_at_the_end_leave_nothing(columns, tmp_path):
    model = loaded(columns.fit(X))
    assert model.ir.outputs == ("out1", "out2")
    verified(model, tmp_path, rows=30)
    with pytest.raises(InputError, match="gives no reconstruction; it has: numbers"):
        loaded(columns, (OutputKind.RECONSTRUCTION,))


def test_the_bound_of_a_solved_equation_spans_what_substitution_in_any_order_gives():
    process = fit(GaussianProcessRegressor(gp.RBF(2.0), optimizer=None, alpha=1e-9), X[:40], SCORE[:40])
    (solved,) = (op for op in loaded(process).ir.ops if getattr(op, "doubt", None) is not None)
    lower = process.L_
    for row in process.kernel_(X[200:230], process.X_train_):
        exact = [Fraction(0)] * 40
        backwards = np.zeros(40)
        for number in range(40):
            left = sum((Fraction(lower[number, k]) * exact[k] for k in range(number)), Fraction(0))
            exact[number] = (Fraction(row[number]) - left) / Fraction(lower[number, number])
            others = 0.0
            for k in reversed(range(number)):
                others += lower[number, k] * backwards[k]
            backwards[number] = (row[number] - others) * (1.0 / lower[number, number])
        allowed = solved.doubt @ np.abs(row)
        true = np.array([float(value) for value in exact])
        inverse = np.array([float(sum(map(mul, map(Fraction, w), map(Fraction, row)))) for w in solved.weights])
        spread = np.abs(backwards - true)
        assert np.all(spread <= allowed) and np.all(np.abs(inverse - true) <= allowed)
        assert np.any(spread > 1e-6 * allowed)


def test_a_deviation_that_is_too_large_or_not_there_is_refused_and_the_mean_is_not():
    rows = np.random.default_rng(5).normal(size=(MAX_DEVIATION_ROWS + 1, 3))
    process = GaussianProcessRegressor(optimizer=None, alpha=0.1).fit(rows, rows[:, 0])
    assert loaded(process).ir.outputs == ("mean",)
    wanted = (OutputKind.MEAN, OutputKind.DEVIATION)
    with pytest.raises(InputError, match=f"gives no deviation; it has: mean .*at most {MAX_DEVIATION_ROWS} training"):
        loaded(process, wanted)
    with pytest.raises(InputError, match="Ridge gives no deviation; it has: numbers"):
        loaded(fit(Ridge(), X, SCORE), (OutputKind.DEVIATION,))
    damaged = fit(GaussianProcessRegressor(optimizer=None, alpha=0.1), X[:20], SCORE[:20])
    damaged.L_[3, 3] = 0.0
    with pytest.raises(InputError, match=r"L_.*diagonal"):
        loaded(damaged)


def test_of_a_voting_over_processes_there_is_only_the_mean():
    processes = [(str(n), GaussianProcessRegressor(gp.RBF(n), optimizer=None, alpha=0.1)) for n in (1, 2)]
    model = loaded(fit(VotingRegressor(processes), X[:40], SCORE[:40]))
    assert model.ir.outputs == ("out1",) and not any(getattr(op, "doubt", None) is not None for op in model.ir.ops)
    agrees(model, X)
    search = GridSearchCV(GaussianProcessRegressor(optimizer=None), {"alpha": [0.1]}, cv=2)
    agrees(loaded(fit(search, X[:40], SCORE[:40])), X)


@pytest.mark.thorough
@pytest.mark.parametrize("weights", ["uniform", "distance"])
@pytest.mark.parametrize("method", ["brute", "kd_tree", "ball_tree"])
def test_neighbours_of_classes_leave_a_label_open_only_where_ties_can_turn_it(weights, method, tmp_path):
    for x, labels, most in ((X, WORDS, 0.0), (GRID, THREE, 0.9)):
        model = loaded(fit(KNeighborsClassifier(5, weights=weights, algorithm=method), x, labels))
        rows = np.vstack([0.9 * x + 0.01, x + 1e-7, HALVES])
        _, bound = agrees(model, rows)
        still = np.mean(bound[: len(x), 0] > 0)
        assert still <= most
    verified(model, tmp_path, rows=150)


def test_equal_distances_to_equal_answers_leave_nothing_open():
    x = np.repeat(np.arange(20.0), 5)[:, None]
    model = loaded(KNeighborsClassifier(3).fit(x, np.repeat(np.arange(20) % 3, 5)))
    _, bound = agrees(model, x)
    assert not bound.any() and model.predict(x)[:, 0].tolist() == np.repeat(np.arange(20) % 3, 5).tolist()
    model = loaded(KNeighborsClassifier(3).fit(x, np.tile([0, 1, 0, 1, 2], 20)))
    assert agrees(model, x)[1][:, 0].all()


def test_no_neighbour_within_the_radius_is_no_answer(tmp_path):
    model = loaded(RadiusNeighborsRegressor(0.4).fit(X, SCORE))
    rows = np.vstack([X, X + 100.0])
    usable, _ = agrees(model, rows)
    assert usable[: len(X)].all() and not usable[len(X) :].any() and np.isnan(model.predict(rows[-1:])).all()


@pytest.mark.thorough
@pytest.mark.parametrize("algorithm", ["kd_tree", "brute"])
@pytest.mark.parametrize("metric", ["euclidean", "chebyshev"])
@pytest.mark.parametrize(
    ("classes", "label"),
    [
        (THREE, 1),
        (THREE, -1),
        (THREE, "most_frequent"),
        (THREE + 1, 1),
        (THREE + 1, 3),
        (THREE + 1.0, 1),
        (THREE * 2.0, -1),
        (WORDS, "none"),
        (TWO, True),
    ],
)
def test_labels_of_rows_without_a_neighbour(classes, label, metric, algorithm, tmp_path):
    """Of a class, of none, and by the number of a class, for which algorithm='brute' takes it."""
    model = RadiusNeighborsClassifier(1.0, metric=metric, algorithm=algorithm, outlier_label=label)
    model = loaded(fit(model, X, classes))
    rows = np.vstack([X, 10 * X, X + 30.0, GRID])
    usable, _ = agrees(model, rows)
    assert usable.all()
    far = usable & (model.predict(rows)[:, 1:] == 0).all(axis=1)
    by_number = algorithm == "brute" and metric != "euclidean"
    assert far.any() == (label in (-1, "none") or (by_number and label in (3, "most_frequent")))
    if metric == "chebyshev":
        verified(model, tmp_path, rows=100)


def test_classes_within_a_radius(tmp_path):
    model = loaded(RadiusNeighborsClassifier(1.5).fit(X, WORDS))
    usable, bound = agrees(model, np.vstack([X, HALVES, X + 100.0]))
    assert usable[: len(X)].all() and not usable[-len(X) :].any() and np.mean(bound[:, 0] > 0) < 0.05
    verified(model, tmp_path, rows=50)


@pytest.mark.parametrize("method", ["brute", "kd_tree"])
def test_local_outliers(method, tmp_path):
    # of training rows that stand twice the library takes any; the bound of those beside others is that of rounding
    unequal = X + np.random.default_rng(3).normal(size=X.shape) * 0.01
    model = loaded(LocalOutlierFactor(7, algorithm=method, novelty=True, contamination=0.1).fit(unequal))
    usable, bound = agrees(model, np.vstack([unequal * 1.01, unequal * 3.0]))
    assert usable.all() and np.max(bound[:, 1]) < 1e-6 and not bound[:, 0].any()
    assert 0.02 < np.mean(model.predict(unequal * 3.0)[:, 0] == 0) < 1.0
    agrees(model, np.vstack([unequal, GRID]))
    if method == "brute":
        verified(model, tmp_path, rows=50)
    with pytest.raises(UnsupportedModelError, match="novelty=True"):
        loaded(LocalOutlierFactor().fit(X))


@pytest.mark.parametrize("inverse", [False, True])
def test_the_bound_of_nearest_means_holds_for_any_numbers_within(inverse):
    random = np.random.default_rng(1)
    op = NearestMean((0,), random.integers(0, 3, (2, 9)).astype(float), 3, inverse)
    x = random.integers(0, 4, (300, 9)).astype(float) * 0.1
    moved = np.where(random.random(x.shape) < 0.3, 10.0 ** random.uniform(-12, -1, x.shape), 0.0)
    result = reference.apply(op, [x])
    bound = bounds.step(op, [x], [moved], result)
    for _ in range(40):
        other = np.maximum(x + moved * random.uniform(-1, 1, x.shape), 0.0)
        order = random.permutation(9)  # of equal ones any may be first
        turned = NearestMean((0,), op.values[:, order], 3, inverse)
        assert np.all(np.abs(reference.apply(turned, [other[:, order]]) - result) <= bound * (1 + 1e-9) + 1e-15)


@pytest.mark.parametrize("divides", [False, True])
def test_the_bound_of_nearest_means_of_computed_numbers_holds_for_any_within(divides):
    random = np.random.default_rng(1)
    x, factors = random.integers(0, 4, (300, 9)) * 0.1, random.normal(size=(300, 9))
    moved = [np.where(random.random(x.shape) < 0.3, 10.0 ** random.uniform(-12, -1, x.shape), 0.0) for _ in range(2)]
    op = NearestMean((0, 1), random.normal(size=(2, 9)), 3, divides=divides)
    result = reference.apply(op, [x, factors])
    bound = bounds.step(op, [x, factors], moved, result)
    for _ in range(40):
        order = random.permutation(9)
        other = [(a + b * random.uniform(-1, 1, x.shape))[:, order] for a, b in zip((x, factors), moved, strict=True)]
        turned = NearestMean((0, 1), op.values[:, order], 3, divides=divides)
        assert np.all(np.abs(reference.apply(turned, other) - result) <= bound * (1 + 1e-9))


def test_the_bound_of_a_weighted_median_holds_for_any_numbers_within():
    random = np.random.default_rng(2)
    weights = random.integers(1, 4, 7).astype(float)
    x = random.integers(0, 5, (300, 7)).astype(float)
    moved = np.where(random.random(x.shape) < 0.3, 10.0 ** random.uniform(-9, 0, x.shape), 0.0)
    op = WeightedMedian((0,), weights)
    result = reference.apply(op, [x])
    bound = bounds.step(op, [x], [moved], result)
    for _ in range(40):
        order = random.permutation(7)
        other = (x + moved * random.uniform(-1, 1, x.shape))[:, order]
        assert np.all(np.abs(reference.apply(WeightedMedian((0,), weights[order]), [other]) - result) <= bound + 1e-12)


def test_a_median_of_trees_is_exact_but_for_equal_predictions(tmp_path):
    model = loaded(AdaBoostRegressor(n_estimators=15, random_state=0).fit(X, SCORE))
    assert verified(model, tmp_path, rows=300).exact


def test_several_labels_a_row(tmp_path):
    y = np.column_stack([TWO, THREE, THREE == 1]).astype(int)
    for estimator in (
        ClassifierChain(LogisticRegression(), order=[2, 0, 1], chain_method="predict"),
        MultiOutputClassifier(DecisionTreeClassifier(max_depth=4, random_state=0)),
    ):
        columns = y if "Chain" not in type(estimator).__name__ else (y > 0).astype(int)
        model = loaded(fit(estimator, X, columns))
        _, bound = agrees(model, X)
        assert np.mean(bound > 0) < 0.02
        verified(model, tmp_path, rows=100)


@pytest.mark.parametrize("kind", ["diag", "spherical"])
def test_mixtures_of_straight_components(kind, tmp_path):
    model = loaded(GaussianMixture(3, covariance_type=kind, random_state=0).fit(X))
    _, bound = agrees(model, np.vstack([X, 3 * X]))
    assert np.mean(bound[:, 0] > 0) < 0.02
    verified(model, tmp_path, rows=100)


def test_box_and_cox(tmp_path):
    x = np.exp(X)
    model = loaded(PowerTransformer("box-cox").fit(x))
    verified(model, tmp_path, rows=100)
    usable, bound = agrees(model, np.vstack([x, -x, np.zeros((1, 3))]))
    assert usable[: len(x)].all() and not usable[len(x) :].any() and np.max(bound) < 1e-8


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (KNeighborsRegressor(metric="canberra"), "metric='canberra'"),
        (KNeighborsRegressor(p=3), "metric='minkowski', p=3"),
        (
            KNeighborsRegressor(metric=DistanceMetric.get_metric("euclidean")),
            "metric=the object EuclideanDistance64: supported",
        ),
        (KNeighborsRegressor(weights=lambda d: d), "weights=a function"),
        (RadiusNeighborsRegressor(weights="distance"), "supported are uniform"),
        (GaussianProcessRegressor(gp.Exponentiation(gp.RBF(), 2), optimizer=None, alpha=1.0), "Exponentiation"),
        (GaussianProcessRegressor(gp.Matern(nu=1.0), optimizer=None, alpha=1.0), "nu=1.0"),
        (SVC(break_ties=True, decision_function_shape="ovo"), "its own predict raises"),
    ],
)
def test_what_is_refused_says_why(estimator, message):
    with pytest.raises(UnsupportedModelError, match=message):
        loaded(fit(estimator, X[:50], THREE[:50] if isinstance(estimator, SVC) else SCORE[:50]))


def test_neighbours_of_a_sparse_matrix_are_refused_as_such():
    model = KNeighborsRegressor(3).fit(csr_matrix(X[:50]), SCORE[:50])
    with pytest.raises(UnsupportedModelError, match="was fitted on a sparse matrix"):
        loaded(model)


STORED = {
    "kd": (KNeighborsRegressor(4, algorithm="kd_tree", leaf_size=3), SCORE),
    "ball": (KNeighborsRegressor(4, algorithm="ball_tree", weights="distance", p=1), SCORE),
    "classes": (KNeighborsClassifier(5), WORDS),
    "radius": (RadiusNeighborsRegressor(3.0), SCORE),
    "outliers": (LocalOutlierFactor(7, novelty=True), None),
}


@pytest.mark.parametrize("name", STORED)
def test_a_search_tree_in_a_file_is_built_anew(name, tmp_path):
    skops_io = pytest.importorskip("skops.io")
    from st_codegen.walkers.objects import load_skops

    estimator, answers = STORED[name]
    estimator.fit(X, answers) if answers is not None else estimator.fit(X)
    assert estimator._fit_method != "brute"
    skops_io.dump(estimator, tmp_path / "m.skops")
    rows = np.vstack([0.9 * X + 0.01, HALVES])
    expected = estimator.predict(rows)
    model = load_skops(tmp_path / "m.skops", "m")
    found = model.predict(rows)[:, 0]
    if model.ir.classes is not None:
        found = np.array(model.ir.classes.labels)[found.astype(int)]
    np.testing.assert_array_equal(found, expected)
    agrees(loaded(model), rows)


@pytest.mark.parametrize("damage", ["rows", "method", "state"])
def test_a_damaged_search_tree_is_refused(damage, tmp_path):
    skops_io = pytest.importorskip("skops.io")
    from st_codegen.walkers.objects import load_skops

    estimator = KNeighborsRegressor(algorithm="kd_tree").fit(X, SCORE)
    if damage == "rows":
        estimator._fit_X = X[::-1].copy()
    elif damage == "method":
        estimator._fit_method = "hnsw"
    else:
        estimator._tree = X
    skops_io.dump(estimator, tmp_path / "m.skops")
    with pytest.raises((InputError, UnsupportedModelError), match=r"_tree|_fit_method|training rows"):
        load_skops(tmp_path / "m.skops", "m")


def test_rows_of_neighbours_and_processes_are_loaded_from_files(tmp_path):
    skops_io = pytest.importorskip("skops.io")
    from st_codegen.walkers.objects import load_skops

    for estimator in (
        KNeighborsRegressor(algorithm="brute"),
        GaussianProcessRegressor(KERNELS["sum"], optimizer=None, alpha=0.1),
    ):
        skops_io.dump(estimator.fit(X[:40], SCORE[:40]), tmp_path / "m.skops")
        assert load_skops(tmp_path / "m.skops", "m").ir.ops


def test_more_neighbours_than_training_rows_are_no_damage():
    estimator = KNeighborsRegressor().fit(X[:4], SCORE[:4])
    with pytest.raises(ValueError, match="n_neighbors"):
        estimator.predict(X[:4])
    with pytest.raises(UnsupportedModelError, match="n_neighbors=5 of 4 training rows: scikit-learn raises, too"):
        loaded(estimator)
