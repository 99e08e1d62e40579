"""Linear, Bayesian, kernel and network models of classes against scikit-learn, and linear models of numbers."""

import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn import (
    cross_decomposition,
    discriminant_analysis,
    dummy,
    ensemble,
    linear_model,
    multiclass,
    multioutput,
    naive_bayes,
    neighbors,
    svm,
    tree,
)
from sklearn.feature_extraction.text import CountVectorizer
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import WhiteKernel
from sklearn.kernel_ridge import KernelRidge
from sklearn.model_selection import FixedThresholdClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import OutputKind, reference
from st_codegen.project.bundle import Bundle
from st_codegen.proof import bounds
from st_codegen.proof.prove.prove import prove
from st_codegen.walkers.objects import from_estimator
from tests.classifiers import SCORE, THREE, TWO, WORDS, X, loaded, verified

COUNTS = np.abs(np.round(X * [2.0, 1.0, 20.0]))
YN = np.column_stack([SCORE, SCORE**2 - X[:, 1]])

CLASSIFIERS = {
    "logistic": (linear_model.LogisticRegression(), X, TWO),
    "logistic of words": (linear_model.LogisticRegression(), X, WORDS),
    "logistic, cross-validated": (linear_model.LogisticRegressionCV(Cs=3, use_legacy_attributes=False), X, THREE),
    "scaled logistic": (make_pipeline(StandardScaler(), linear_model.LogisticRegression()), X, WORDS),
    "ridge": (linear_model.RidgeClassifier(), X, WORDS),
    "ridge of two": (linear_model.RidgeClassifierCV(), X, TWO),
    "gradient descent": (linear_model.SGDClassifier(random_state=0), X, THREE - 1),
    "gradient descent, logistic": (linear_model.SGDClassifier(loss="log_loss", random_state=0), X, TWO),
    "gradient descent, huber": (linear_model.SGDClassifier(loss="modified_huber", random_state=0), X, TWO),
    "perceptron": (linear_model.Perceptron(random_state=0), X, WORDS),
    "passive aggressive": (linear_model.PassiveAggressiveClassifier(random_state=0), X, TWO),
    "linear machine": (svm.LinearSVC(random_state=0), X, THREE),
    "discriminant": (discriminant_analysis.LinearDiscriminantAnalysis(), X, WORDS),
    "discriminant of two": (discriminant_analysis.LinearDiscriminantAnalysis(solver="lsqr"), X, TWO),
    "quadratic": (discriminant_analysis.QuadraticDiscriminantAnalysis(), X, WORDS),
    "quadratic of two": (discriminant_analysis.QuadraticDiscriminantAnalysis(), X, TWO),
    "gaussian bayes": (naive_bayes.GaussianNB(), X, WORDS),
    "bernoulli bayes": (naive_bayes.BernoulliNB(binarize=0.25), X, WORDS),
    "bernoulli bayes of flags": (naive_bayes.BernoulliNB(binarize=None), (X > 0).astype(float), TWO),
    "multinomial bayes": (naive_bayes.MultinomialNB(), COUNTS, THREE),
    "complement bayes": (naive_bayes.ComplementNB(), COUNTS, WORDS),
    "centroid": (neighbors.NearestCentroid(), X, WORDS),
    "machine": (svm.SVC(), X, TWO),
    "machine with probabilities": (svm.SVC(probability=True, random_state=0), X, WORDS),
    "machine with probabilities of two": (svm.SVC(probability=True, random_state=0), X, TWO),
    "machine of words": (svm.SVC(C=3.0), X, WORDS),
    "polynomial machine, pairs": (svm.SVC(kernel="poly", decision_function_shape="ovo"), X / 5, THREE),
    "machine with ties broken": (svm.SVC(break_ties=True), X, THREE),
    "linear machine of four": (svm.SVC(kernel="linear"), X, np.digitize(SCORE, [-0.5, 0.2, 0.9])),
    "nu machine": (svm.NuSVC(nu=0.2, kernel="sigmoid"), X, TWO),
    "network": (MLPClassifier((6,), max_iter=60, random_state=0), X, TWO),
    "network of words": (MLPClassifier((5, 4), "tanh", max_iter=60, random_state=0), X, WORDS),
    "outliers by a machine": (svm.OneClassSVM(nu=0.2), X, None),
}
NUMBERS = {
    **{
        name: (getattr(linear_model, name)(), SCORE)
        for name in """ARDRegression BayesianRidge HuberRegressor Lars LarsCV LassoLars LassoLarsCV LassoLarsIC
        OrthogonalMatchingPursuit OrthogonalMatchingPursuitCV PassiveAggressiveRegressor QuantileRegressor SGDRegressor
        TheilSenRegressor RANSACRegressor""".split()
    },
    **{
        name: (getattr(linear_model, name)(), YN)
        for name in "MultiTaskElasticNet MultiTaskElasticNetCV MultiTaskLasso MultiTaskLassoCV".split()
    },
    "PoissonRegressor": (linear_model.PoissonRegressor(), np.abs(SCORE)),
    "GammaRegressor": (linear_model.GammaRegressor(), np.abs(SCORE) + 0.1),
    "TweedieRegressor": (linear_model.TweedieRegressor(power=1.5), np.abs(SCORE)),
    "TweedieRegressor, identity": (linear_model.TweedieRegressor(power=0), SCORE),
    "PLSRegression": (cross_decomposition.PLSRegression(2), YN),
    "PLSCanonical": (cross_decomposition.PLSCanonical(2), YN),
    **{
        f"KernelRidge {kernel}": (KernelRidge(kernel=kernel, gamma=0.05, degree=2), SCORE)
        for kernel in ("linear", "rbf", "poly", "sigmoid")
    },
}


def fit(estimator, x, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return estimator.fit(x, y)


@pytest.mark.parametrize("name", CLASSIFIERS)
def test_classifiers_have_the_library_s_labels_within_the_bound(name, tmp_path):
    estimator, x, y = CLASSIFIERS[name]
    model = loaded(fit(estimator, x, y))
    report = verified(model, tmp_path, rows=300)
    assert report.open_rows < 0.3 * report.n  # the special values, among which are numbers up to 1e308
    library, found = model.predict(x), reference.evaluate(model.ir, x)
    bound = bounds.difference_bound(model.ir, x)
    assert np.all(np.abs(library - found) <= bound)
    certain = bound[:, 0] == 0
    assert certain.mean() > 0.98 and np.array_equal(library[certain, 0], found[certain, 0])
    assert np.max(bound[:, 1:], initial=0.0) < 1e-7 * (1 + np.max(np.abs(found)))
    assert len(np.unique(library[:, 0])) > 1


@pytest.mark.parametrize(
    ("init", "classes", "loss"),
    [
        (linear_model.LogisticRegression(), WORDS, "log_loss"),
        (tree.DecisionTreeClassifier(max_depth=3), TWO, "exponential"),
        (ensemble.RandomForestClassifier(7, max_depth=3, random_state=0), TWO, "log_loss"),
        (ensemble.RandomForestClassifier(7, max_depth=3, random_state=0), THREE, "log_loss"),
    ],
)
def test_boosting_that_starts_from_another_classifier(init, classes, loss, tmp_path):
    """It is fitted on float32, so that what multiplies does so in float32."""
    boosted = ensemble.GradientBoostingClassifier(n_estimators=4, init=init, loss=loss, random_state=0)
    model = loaded(fit(boosted, X, classes))
    verified(model, tmp_path, rows=300)
    rows = np.vstack([X, 3.0 * X[::-1], X + 1e-9])
    library, found, bound = (
        model.predict(rows),
        reference.evaluate(model.ir, rows),
        bounds.difference_bound(model.ir, rows),
    )
    assert np.all(np.abs(library - found) <= bound)
    assert np.mean(bound[:, 0] == 0) > 0.98 and len(np.unique(found[:, 0])) > 1
    assert np.max(bound[:, 1:]) < (1e-3 if isinstance(init, linear_model.LogisticRegression) else 1e-13)


SHARED = {
    "logistic": linear_model.SGDClassifier(loss="log_loss", random_state=0),
    "huber": linear_model.SGDClassifier(loss="modified_huber", random_state=0),
    "rest": multiclass.OneVsRestClassifier(linear_model.LogisticRegression()),
    "rest of trees": multiclass.OneVsRestClassifier(tree.DecisionTreeClassifier(max_depth=2, random_state=0)),
    "rest of two": multiclass.OneVsRestClassifier(tree.DecisionTreeClassifier(max_depth=2, random_state=0)),
}


@pytest.mark.parametrize("name", SHARED)
def test_probabilities_of_each_class_by_their_sum(name, tmp_path):
    """Of several classes, each by itself; where all are 0 they are equal shares, or stay 0."""
    estimator = fit(SHARED[name], X, TWO if name == "rest of two" else WORDS)
    model = loaded(estimator)
    rows = np.vstack([X, 3.0 * X[::-1]])
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    columns = 1 + np.arange(len(estimator.classes_))
    assert np.array_equal(library[:, columns], estimator.predict_proba(rows))
    assert np.allclose(found, library, rtol=1e-9, atol=0.0)
    bound = bounds.difference_bound(model.ir, rows)
    assert np.all(np.abs(library - found) <= bound) and np.isfinite(bound).all(axis=1).mean() > 0.9
    assert verified(model, tmp_path, rows=300).unbounded < 0.5 * 300
    if name == "huber":
        assert (library[:, columns] == 1 / 3).all(axis=1).any()


def test_the_first_of_two_probabilities_against_the_rest_is_what_the_second_leaves(tmp_path):
    """The library takes 1 - p, whose last bits are not those of the small probability that the estimator has itself."""
    estimator = fit(multiclass.OneVsRestClassifier(naive_bayes.GaussianNB()), X, X[:, 0] > np.median(X[:, 0]))
    model = loaded(estimator)
    rows = np.vstack([X, 9.0 * X[::-1]])
    library, found = estimator.predict_proba(rows), reference.evaluate(model.ir, rows)[:, 1:]
    assert np.all(np.abs(library - found) <= bounds.difference_bound(model.ir, rows)[:, 1:])
    assert (library[:, 0] == 0.0).any() and ((library[:, 0] > 0.0) & (library[:, 0] < 1e-6)).any()
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("name", NUMBERS)
def test_linear_and_kernel_models_of_numbers(name):
    estimator, y = NUMBERS[name]
    model = loaded(fit(estimator, X, y))
    library, found = model.predict(X), reference.evaluate(model.ir, X)
    bound = bounds.difference_bound(model.ir, X)
    assert np.all(np.abs(library - found) <= bound)
    assert np.max(bound) < 1e-9 * (1 + np.max(np.abs(found)))


@pytest.mark.parametrize("kernel", ["rbf", "poly"])
def test_the_bound_of_kernel_ridge_covers_distances_that_lose_their_digits(kernel):
    x = 1000.0 + X
    model = loaded(fit(KernelRidge(kernel=kernel, gamma=0.05, degree=2), x, SCORE))
    library, found = model.predict(x), reference.evaluate(model.ir, x)
    assert np.all(np.abs(library - found) <= bounds.difference_bound(model.ir, x))


@pytest.mark.parametrize("kernel", ["linear", "poly", "sigmoid", "rbf"])
def test_the_bound_of_kernel_ridge_covers_products_below_the_normal_numbers(kernel, tmp_path):
    model = loaded(fit(KernelRidge(kernel=kernel, degree=2, coef0=0.0), X, SCORE))
    rows = np.array([[value] * 3 for value in (5e-324, -5e-324, 1.5e-323, 1e-320, 3e-310, 1e-308, 1e-162, 0.0)])
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    bound = bounds.difference_bound(model.ir, rows)
    assert np.all(np.abs(library - found) <= bound) and np.max(bound) < 1e-9
    verified(model, tmp_path, rows=300)


def test_a_row_on_the_border_is_open_and_not_wrong(tmp_path):
    """On the border of a linear machine the score is 0 but for its rounding."""
    model = loaded(fit(linear_model.LogisticRegression(), X, TWO))
    weights, bias = model.ir.ops[0].weights[0], model.ir.ops[0].bias[0]
    x = np.array(X)
    x[:, 0] = -(bias + x[:, 1:] @ weights[1:]) / weights[0]
    bound = bounds.difference_bound(model.ir, x)
    assert np.all(bound[:, 0] > 0)
    assert np.all(bounds.difference_bound(model.ir, x + np.array([1e-6, 0, 0]))[:, 0] == 0)


@pytest.mark.parametrize(
    ("estimator", "y", "message"),
    [
        (tree.DecisionTreeClassifier(), np.column_stack([WORDS, WORDS]), "labels .'.*, .. beside other outputs"),
        (neighbors.NearestCentroid(priors=[0.1, 0.9]), TWO, r"metric='euclidean' and priors .0\.1 0\.9."),
        (svm.SVC(kernel="precomputed"), TWO, "kernel=precomputed"),
    ],
)
def test_what_is_not_supported_says_so(estimator, y, message):
    x = X @ X.T if getattr(estimator, "kernel", "") == "precomputed" else X
    with pytest.raises(UnsupportedModelError, match=message):
        loaded(fit(estimator, x, y))


SEVERAL = {
    "network": MLPClassifier((4,), max_iter=60, random_state=0),
    "ridge": linear_model.RidgeClassifier(),
    "rest of scores": multiclass.OneVsRestClassifier(svm.LinearSVC()),
    "rest of trees": multiclass.OneVsRestClassifier(tree.DecisionTreeClassifier(max_depth=3, random_state=0)),
    "tree": tree.DecisionTreeClassifier(max_depth=4, random_state=0),
    "forest": ensemble.RandomForestClassifier(5, max_depth=3, random_state=0),
    "extra trees": ensemble.ExtraTreesClassifier(3, max_depth=3, random_state=0),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_several_labels_a_row_are_outputs_of_numbers(name, tmp_path):
    by_trees = name in ("tree", "forest", "extra trees")
    labels = np.column_stack([TWO, THREE if by_trees else THREE > 1, X[:, 1] > 0]).astype(int)
    model = loaded(fit(SEVERAL[name], X, labels))
    rows = np.vstack([X, 3 * X[::-1, ::-1]])
    library, found, bound = (
        model.predict(rows),
        reference.evaluate(model.ir, rows),
        bounds.difference_bound(model.ir, rows),
    )
    assert np.all(np.abs(library - found) <= bound) and np.mean(bound == 0) > 0.98
    assert np.all(np.ptp(library, axis=0) >= 1)
    assert model.ir.exact or not by_trees
    verified(model, tmp_path, rows=300)
    if by_trees:
        assert prove(Bundle((model,)), tmp_path).proved


NUMBERED = {
    "tree": tree.DecisionTreeClassifier(max_depth=4, random_state=0),
    "one an output": multioutput.MultiOutputClassifier(linear_model.LogisticRegression()),
    "chain": multioutput.ClassifierChain(tree.DecisionTreeClassifier(max_depth=3, random_state=0)),
}


@pytest.mark.parametrize("name", NUMBERED)
def test_labels_beside_others_are_any_whole_numbers(name, tmp_path):
    labels = np.column_stack([2 * TWO - 1, np.array([7, -3, 40])[THREE], np.full(len(X), 5)])
    columns = slice(0, 2 if name == "one an output" else 3)  # LogisticRegression takes no single label
    model = loaded(fit(NUMBERED[name], X, labels[:, columns]))
    library, found = model.predict(X), reference.evaluate(model.ir, X)
    assert np.array_equal(library, found) and set(found[:, 1]) == {7, -3, 40}
    assert model.ir.exact == (name != "one an output")
    verified(model, tmp_path, rows=300)
    if name == "tree":
        assert prove(Bundle((model,)), tmp_path).proved


@pytest.mark.parametrize("name", NUMBERED)
@pytest.mark.parametrize("pair", [(0, 2**31), (-(2**31), 1), (-(2**52), 2**52), (-1.0, 0.0)])
def test_labels_beside_others_reach_as_far_as_their_differences_are_exact(name, pair, tmp_path):
    labels = np.column_stack([np.where(TWO, *pair[::-1]), THREE])
    model = loaded(fit(NUMBERED[name], X, labels))
    library, found = model.predict(X), reference.evaluate(model.ir, X)
    assert np.array_equal(library, found) and set(found[:, 0]) == set(pair)
    assert np.array_equal(np.signbit(library), np.signbit(found))
    assert model.ir.exact == (name != "one an output")
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("pair", [(-0.0, 1.0), (-1.0, -0.0), (0, 2**52 + 1), (-(2**52) - 1, 0)])
def test_labels_beside_others_that_sums_do_not_give_are_refused(pair):
    """Labels of -0.0 were answered as 0.0, which the header called equal in every bit."""
    labels = np.column_stack([np.where(TWO, *pair[::-1]), THREE])
    message = r"beside other outputs: encode them as whole numbers from -2\*\*52 to 2\*\*52, and zero without a sign"
    with pytest.raises(UnsupportedModelError, match=message):
        loaded(fit(NUMBERED["tree"], X, labels))


@pytest.mark.parametrize(
    ("kind", "classes", "name", "choice"),
    [
        (ensemble.AdaBoostClassifier, 2, "algorithm", "SAMME.R"),
        (linear_model.LogisticRegression, 3, "multi_class", "ovr"),
        (linear_model.LogisticRegression, 2, "multi_class", "multinomial"),
        (linear_model.LogisticRegression, 3, "solver", "liblinear"),
        (linear_model.LogisticRegression, 3, "solver", "newton-cholesky"),
    ],
)
def test_what_older_versions_trained_with_and_newer_ones_do_not_compute_is_refused(kind, classes, name, choice):
    """A pickle of scikit-learn 1.5 with it loads, and gives other numbers without a word."""
    x = np.random.default_rng(0).normal(size=(60, 2))
    estimator = kind().fit(x, np.arange(60) % classes)
    vars(estimator)[name] = "deprecated"
    from_estimator(estimator, "model")
    vars(estimator)[name] = choice
    if choice == "newton-cholesky":
        from_estimator(estimator, "model")
        vars(estimator).update(n_iter_=np.ones(classes, np.int32), multi_class="deprecated")
    with pytest.raises(UnsupportedModelError, match=f"{kind.__name__} with {name}='{choice}'.*train it again"):
        from_estimator(estimator, "model")


@pytest.mark.parametrize(
    "estimator",
    [
        discriminant_analysis.LinearDiscriminantAnalysis(solver="lsqr"),
        discriminant_analysis.LinearDiscriminantAnalysis(solver="eigen"),
        linear_model.RidgeClassifier(fit_intercept=False),
    ],
)
def test_one_class_with_a_score_above_zero_is_refused(estimator):
    """The block answered with a second class that is not there."""
    fit(estimator, X, np.full(len(X), 7))
    with pytest.raises(IndexError):
        estimator.predict(np.vstack([9 * X, -9 * X]))
    with pytest.raises(UnsupportedModelError, match="with one class, whose own predict raises where the score"):
        loaded(estimator)


@pytest.mark.parametrize(
    "estimator", [discriminant_analysis.LinearDiscriminantAnalysis(), linear_model.RidgeClassifier()]
)
def test_one_class_that_is_always_the_answer(estimator, tmp_path):
    model = loaded(fit(estimator, X, np.full(len(X), 7)))
    assert not model.predict(9 * X)[:, 0].any() and not reference.evaluate(model.ir, 9 * X)[:, 0].any()
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 2, 0]], ids=["behind", "in front, which turns the threshold"])
def test_labels_that_all_rows_of_the_training_had_or_none(order, tmp_path):
    labels = np.column_stack([TWO, np.ones(len(X)), np.zeros(len(X))]).astype(int)[:, order]
    model = loaded(fit(multiclass.OneVsRestClassifier(svm.LinearSVC()), X, labels))
    library, found = model.predict(X), reference.evaluate(model.ir, X)
    assert np.array_equal(library, found) and np.ptp(library[:, order.index(0)]) == 1
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (tree.DecisionTreeClassifier, {"n_outputs_": 5}, "n_outputs_: number 0 is 5, expected 2 .. 2"),
        (tree.DecisionTreeClassifier, {"classes_": [np.arange(2)]}, "n_outputs_: number 0 is 2, expected 1 .. 1"),
        (tree.DecisionTreeClassifier, {"classes_": [np.arange(2), np.arange(3)]}, "leaves that do not hold 6 numbers"),
        (ensemble.RandomForestClassifier, {"classes_": []}, "n_outputs_: number 0 is 2, expected 0 .. 0"),
    ],
)
def test_several_outputs_that_do_not_fit_the_leaves_are_refused(kind, changes, message):
    model = kind(max_depth=3, random_state=0).fit(X, np.column_stack([TWO, X[:, 1] > 0]).astype(int))
    for name, value in changes.items():
        setattr(model, name, value)
    with pytest.raises(InputError, match=message):
        loaded(model)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"threshold": np.nan}, "threshold: number 0 is nan, not finite"),
        ({"threshold": "low"}, "threshold: a str, expected numbers"),
        ({"response_method": "predict"}, "FixedThresholdClassifier by the predict of LogisticRegression"),
        ({"pos_label": 7}, "pos_label=7, which is none of its labels"),
    ],
)
def test_thresholds_that_were_changed_are_refused(changes, message):
    model = FixedThresholdClassifier(linear_model.LogisticRegression()).fit(X, TWO)
    for name, value in changes.items():
        setattr(model, name, value)
    with pytest.raises(InputError, match=message):
        loaded(model)


def test_the_nearest_centre_by_the_manhattan_distance(tmp_path):
    model = loaded(fit(neighbors.NearestCentroid(metric="manhattan"), X, WORDS))
    assert np.array_equal(model.predict(X), reference.evaluate(model.ir, X))
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("kind", ["BernoulliNB", "CategoricalNB", "ComplementNB", "MultinomialNB"])
def test_a_class_of_rows_without_weight_is_named_where_it_is_never_predicted(kind, tmp_path):
    x = np.digitize(X, [-1.0, 0.0, 1.0]).astype(float)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        estimator = getattr(naive_bayes, kind)().fit(x, THREE, sample_weight=(THREE != 1).astype(float))
    if kind == "ComplementNB":  # which reads no priors
        verified(loaded(estimator), tmp_path, rows=300)
        return
    with pytest.raises(UnsupportedModelError, match=f"^{kind}: class number 1 has a prior of 0, so that it is never"):
        loaded(estimator)


@pytest.mark.parametrize("probability", [True, False])
def test_a_machine_without_a_class_of_rows_without_weight_is_refused(probability):
    """The library takes the numbers of the classes that are left for those of all."""
    estimator = svm.SVC(probability=probability).fit(X, THREE, sample_weight=(THREE != 1).astype(float))
    assert set(estimator.predict(X)) == {0, 1}
    with pytest.raises(UnsupportedModelError, match=r"^SVC of 3 classes, of which libsvm kept 2, as it does where all"):
        loaded(estimator)


def test_a_discriminant_of_one_class_has_no_probability(tmp_path):
    """Its predict_proba raises."""
    model = loaded(fit(discriminant_analysis.LinearDiscriminantAnalysis(), X, np.ones(len(X))))
    assert model.ir.kinds == ("class", "decision") and np.array_equal(model.predict(X), np.zeros((len(X), 2)))
    verified(model, tmp_path, rows=300)


def test_what_does_not_say_how_many_features_it_takes_is_not_called_unfitted():
    said = "does not say how many features it takes: fit it on an array of numbers"
    kernel = "with a kernel of sklearn that reads the inputs"
    with pytest.raises(InputError, match=rf"^SVC {said}, {kernel}$"):
        loaded(svm.SVC(kernel=lambda a, b: a @ b.T).fit(X, TWO))
    with pytest.raises(InputError, match=rf"^GaussianProcessRegressor {said}, {kernel}$"):
        loaded(GaussianProcessRegressor(WhiteKernel()).fit(X, SCORE))
    with pytest.raises(InputError, match=rf"^DummyClassifier {said}$"):
        loaded(dummy.DummyClassifier().fit(None, TWO))
    with pytest.raises(InputError, match=r"^SVC is not fitted: call fit"):
        loaded(svm.SVC())
    with pytest.raises(UnsupportedModelError, match="CountVectorizer is not supported"):
        loaded(CountVectorizer().fit(["a word"]))


def test_categories_are_cut_to_integers_and_others_have_no_answer(tmp_path):
    codes = np.column_stack([np.digitize(X[:, 0], [-1, 0, 1]), np.digitize(X[:, 1], [0, 3]), X[:, 2] > 0]).astype(int)
    whole = fit(naive_bayes.CategoricalNB(min_categories=[5, 3, 2]), codes, WORDS)
    model = loaded(whole)
    verified(model, tmp_path, rows=300)
    near = [
        near for code in range(-1, 7) for near in (code, np.nextafter(code, 9.0), np.nextafter(code, -9.0), code + 0.5)
    ]
    near += [-0.0, 5e-324, -5e-324, 1e18, 1e19, 1e300, -1e300]
    rows = np.vstack([np.tile(np.eye(3)[place] * value, (2, 1)) for place in range(3) for value in near])
    found, bound = reference.evaluate(model.ir, rows), bounds.difference_bound(model.ir, rows)
    for row, answer, off in zip(rows, found, bound, strict=True):
        if np.isnan(answer).any():
            with pytest.raises((ValueError, IndexError)):
                whole.predict(row[None])
        else:
            assert np.all(np.abs(model.predict(row[None])[0] - answer) <= off)
    assert 0.2 < np.isnan(found[:, 0]).mean() < 0.8


def test_probabilities_are_given_where_the_library_gives_them():
    for name in ("logistic", "discriminant", "quadratic", "gaussian bayes", "network", "gradient descent, logistic"):
        estimator, x, y = CLASSIFIERS[name]
        assert OutputKind.PROBABILITY in loaded(fit(estimator, x, y)).ir.classes.kinds


def test_a_naive_bayes_of_constant_columns_is_refused_by_what_it_is():
    x = np.ones((6, 2))
    fitted = naive_bayes.GaussianNB().fit(x, [0, 1] * 3)
    with pytest.raises(InputError, match="all columns were constant in training"):
        from_estimator(fitted, "m")
