"""Compositions of classifiers and regressors, detectors of anomalies and clusterings against scikit-learn."""

import warnings

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn import cluster, covariance, ensemble, mixture, multiclass, multioutput, semi_supervised
from sklearn.base import clone
from sklearn.calibration import CalibratedClassifierCV
from sklearn.dummy import DummyClassifier, DummyRegressor
from sklearn.frozen import FrozenEstimator
from sklearn.linear_model import LinearRegression, LogisticRegression, Perceptron, RidgeClassifier, SGDOneClassSVM
from sklearn.model_selection import FixedThresholdClassifier, TunedThresholdClassifierCV
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, RadiusNeighborsClassifier
from sklearn.semi_supervised import SelfTrainingClassifier
from sklearn.svm import SVC, LinearSVC
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Operator, Scale, reference
from st_codegen.proof import bounds
from tests.classifiers import SCORE, THREE, TWO, WORDS, X, loaded, verified

LABELS = np.column_stack([TWO, SCORE > 1, X[:, 1] > 0]).astype(int)
YN = np.column_stack([SCORE, SCORE**2 - X[:, 1], X[:, 0]])


def tree(depth=3, seed=0):
    return DecisionTreeClassifier(max_depth=depth, random_state=seed)


def grown(depth=3):
    return DecisionTreeRegressor(max_depth=depth, random_state=0)


NAMED = [("a", tree(2)), ("b", tree(4, 1)), ("c", GaussianNB())]
EXACT = {
    "hard votes": (ensemble.VotingClassifier([("a", tree(1)), ("b", tree(2)), ("c", tree(3))]), WORDS),
    "weighted votes": (
        ensemble.VotingClassifier([("a", tree(1)), ("b", tree(2)), ("c", tree(3))], weights=[0.1, 0.2, 0.3]),
        THREE,
    ),
    "soft votes of trees": (
        ensemble.VotingClassifier([("a", tree(2)), ("b", tree(3))], voting="soft", weights=[1.0, 0.7]),
        WORDS,
    ),
    "bag of trees": (ensemble.BaggingClassifier(tree(4), 5, max_features=2, random_state=0, n_jobs=2), WORDS),
    "bag of small samples": (ensemble.BaggingClassifier(tree(4), 5, max_samples=6, random_state=3), THREE - 1),
    # neighbours have no weights, so that the first of them sees two of the labels alone
    "bag of few labels": (
        ensemble.BaggingClassifier(KNeighborsClassifier(1), 3, max_samples=6, random_state=3),
        THREE - 1,
    ),
    "boosted": (ensemble.AdaBoostClassifier(tree(1), n_estimators=6, random_state=0), TWO),
    "boosted, three": (ensemble.AdaBoostClassifier(tree(2), n_estimators=5, random_state=0), WORDS),
    "rest of trees": (multiclass.OneVsRestClassifier(tree(3)), WORDS),
    "rest of numbers": (multiclass.OneVsRestClassifier(grown(4)), WORDS),
    "rest of numbers, two": (multiclass.OneVsRestClassifier(grown(4)), TWO),
    "isolation": (ensemble.IsolationForest(n_estimators=12, max_samples=40, random_state=0), None),
    "isolation of some features": (ensemble.IsolationForest(n_estimators=9, max_features=2, random_state=0), None),
    "isolation of one feature": (ensemble.IsolationForest(n_estimators=9, max_features=1, random_state=0), None),
    "isolation, contamination": (ensemble.IsolationForest(n_estimators=8, contamination=0.2, random_state=1), None),
    "bagged regressors": (ensemble.BaggingRegressor(grown(4), 4, max_features=2, random_state=0), SCORE),
    "most frequent": (
        ensemble.VotingClassifier([("a", DummyClassifier()), ("b", tree(3))], voting="soft", weights=[1, 9]),
        WORDS,
    ),
    "threshold": (FixedThresholdClassifier(tree(3), threshold=0.3, response_method="predict_proba"), TWO),
    "threshold of the first": (FixedThresholdClassifier(tree(3), threshold=0.3, pos_label=False), TWO),
    "tuned threshold": (TunedThresholdClassifierCV(tree(3), scoring="f1", cv=2), TWO.astype(int)),
    "frozen forest": (
        FrozenEstimator(ensemble.RandomForestRegressor(9, random_state=0, n_jobs=2).fit(X, SCORE)),
        SCORE,
    ),
    "frozen, calibrated": (
        CalibratedClassifierCV(FrozenEstimator(tree(3).fit(X, WORDS)), method="isotonic"),
        WORDS,
    ),
    "own labels": (SelfTrainingClassifier(tree(3)), np.where(np.arange(len(X)) % 3, THREE, -1)),
    "chain of tree classes": (
        multioutput.ClassifierChain(tree(3), order=[1, 2, 0], chain_method="predict_proba"),
        LABELS,
    ),
    "chain of trees": (multioutput.RegressorChain(grown(4), order=[2, 0, 1]), YN),
}
WITHIN = {
    "soft votes": (ensemble.VotingClassifier(NAMED, voting="soft"), WORDS),
    "soft votes of a machine": (
        ensemble.VotingClassifier([("a", SVC(probability=True, random_state=0)), ("b", tree(2))], voting="soft"),
        WORDS,
    ),
    "votes of machines": (ensemble.VotingClassifier([("a", SVC()), ("b", RidgeClassifier()), ("c", tree(3))]), TWO),
    "bag of perceptrons": (ensemble.BaggingClassifier(Perceptron(), 3, random_state=0), WORDS),
    "rest": (multiclass.OneVsRestClassifier(LogisticRegression()), WORDS),
    "rest of two": (multiclass.OneVsRestClassifier(LinearSVC()), TWO),
    "rest of lines": (multiclass.OneVsRestClassifier(LinearRegression()), WORDS),
    "pairs": (multiclass.OneVsOneClassifier(LinearSVC()), WORDS),
    "pairs of two": (multiclass.OneVsOneClassifier(GaussianNB()), TWO),
    "calibrated": (CalibratedClassifierCV(LinearSVC(), cv=2), TWO),
    "calibrated probabilities": (CalibratedClassifierCV(GaussianNB(), cv=2, ensemble=False), TWO),
    "calibrated, three": (CalibratedClassifierCV(GaussianNB(), cv=2), WORDS),
    "calibrated in steps": (CalibratedClassifierCV(LinearSVC(), method="isotonic", cv=2), TWO),
    "calibrated in steps, three": (CalibratedClassifierCV(LogisticRegression(), method="isotonic", cv=2), WORDS),
    "stack": (ensemble.StackingClassifier(NAMED, LogisticRegression(), cv=2), WORDS),
    "stack of two": (ensemble.StackingClassifier([("a", tree(3)), ("b", SVC())], tree(2), cv=2, passthrough=True), TWO),
    "envelope": (covariance.EllipticEnvelope(random_state=0), None),
    "clusters": (cluster.KMeans(4, n_init=1, random_state=0), None),
    "clusters of subclusters": (cluster.Birch(n_clusters=3, threshold=0.4), None),
    "subclusters": (cluster.Birch(n_clusters=None, threshold=0.9), None),
    "clusters by bisection": (cluster.BisectingKMeans(6, random_state=0), None),
    "codes": (multiclass.OutputCodeClassifier(LogisticRegression(), code_size=2.0, random_state=0), WORDS),
    "a code of all": (multiclass.OutputCodeClassifier(LogisticRegression(), code_size=1.5, random_state=1), THREE),
    "codes of trees": (multiclass.OutputCodeClassifier(tree(2), code_size=3.0, random_state=0), THREE),
    "propagation": (semi_supervised.LabelPropagation(gamma=2.0), np.where(np.arange(len(X)) % 3, THREE, -1)),
    "spreading": (semi_supervised.LabelSpreading("knn", n_neighbors=5), np.where(np.arange(len(X)) % 3, THREE, -1)),
    "clusters in batches": (cluster.MiniBatchKMeans(3, n_init=1, random_state=0), None),
    **{
        f"expected mixture, {kind}, {prior}": (
            mixture.BayesianGaussianMixture(
                n_components=3, covariance_type=kind, weight_concentration_prior_type=prior, random_state=0
            ),
            None,
        )
        for kind, prior in zip(
            ("full", "tied", "diag", "spherical"), ("dirichlet_process", "dirichlet_distribution") * 2, strict=True
        )
    },
    "linear one class": (SGDOneClassSVM(nu=0.2, random_state=0), None),
    "threshold of a score": (FixedThresholdClassifier(LinearSVC(), threshold=0.4, pos_label=False), TWO),
    "chain of other labels": (multioutput.ClassifierChain(GaussianNB(), chain_method="predict_proba"), 2 + LABELS),
    "chain of machines": (multioutput.ClassifierChain(LinearSVC(), chain_method="decision_function"), LABELS),
    "mixture": (mixture.GaussianMixture(3, random_state=0), None),
    "tied mixture": (mixture.GaussianMixture(2, covariance_type="tied", random_state=0), None),
    "voting regressor": (ensemble.VotingRegressor([("a", grown()), ("b", LinearRegression())], weights=[2, 1]), SCORE),
    "stacked regressor": (ensemble.StackingRegressor([("a", grown()), ("b", LinearRegression())], cv=2), SCORE),
}


def fit(estimator, y):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return estimator.fit(X, y)


def rows_of(model):
    thresholds = [op.threshold[op.split >= 0] for op in model.ir.ops if hasattr(op, "threshold")]
    points = np.concatenate([*thresholds, np.zeros(1)])
    near = np.concatenate([points, np.nextafter(points, np.inf), np.nextafter(points.astype(np.float32), -np.inf)])
    drawn = np.random.default_rng(0).choice(near, (400, X.shape[1]))
    return np.vstack([X, drawn, 3 * X[::-1, ::-1]])


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXACT)
def test_what_trees_decide_together_is_exact(name):
    model = loaded(fit(*EXACT[name]))
    rows = rows_of(model)
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    bound = bounds.difference_bound(model.ir, rows)
    assert np.all(np.abs(library - found) <= bound)
    assert not np.any(bound[:, 0])
    kinds = ["class"] if model.ir.classes is None else list(model.ir.classes.kinds)
    numbers = [number for number, kind in enumerate(kinds) if kind == "class" or "isolation" not in name]
    if "boosted" not in name:
        assert np.array_equal(library[:, numbers], found[:, numbers])
    assert len(np.unique(library[:, 0])) > 1


def test_equal_scores_of_one_against_the_rest_are_decided_as_the_library_decides():
    """Grown trees give 0 or 1, so that on rows between those of training no class, or several, may have the most."""
    labels = np.random.default_rng(1).integers(0, 4, len(X))
    whole = multiclass.OneVsRestClassifier(tree(None)).fit(X, labels)
    model = loaded(whole)
    rows = np.vstack([1.3 * X, X + 0.1, X[::-1, ::-1]])
    scores = np.column_stack([part.predict_proba(rows)[:, 1] for part in whole.estimators_])
    equal = np.sum(scores == scores.max(axis=1, keepdims=True), axis=1) > 1
    assert np.sum(equal) > 20 and np.array_equal(model.predict(rows), reference.evaluate(model.ir, rows))


@pytest.mark.parametrize("name", WITHIN)
def test_other_compositions_lie_within_the_bound(name):
    model = loaded(fit(*WITHIN[name]))
    library, found = model.predict(X), reference.evaluate(model.ir, X)
    bound = bounds.difference_bound(model.ir, X)
    assert np.all(np.abs(library - found) <= bound)
    if model.ir.classes is not None:
        assert np.mean(bound[:, 0] == 0) > 0.97
    assert np.max(bound[:, 1:], initial=0.0) < 1e-6 * (1 + np.max(np.abs(found)))
    assert len(np.unique(library[:, 0])) > 1


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", ["clusters of subclusters", "clusters by bisection", "codes", "propagation", "spreading"]
)
def test_they_are_verified(name, tmp_path):
    verified(loaded(fit(*WITHIN[name])), tmp_path, rows=100)


def test_one_cluster_has_all_rows():
    model = loaded(cluster.BisectingKMeans(1).fit(X))
    assert not model.predict(X).any() and not reference.evaluate(model.ir, X).any()


def test_rows_far_from_all_others_have_no_share_of_any_class(tmp_path):
    model = loaded(fit(*WITHIN["propagation"]))
    far = np.array([[200.0, 0.0, 0.0], [0.0, 0.0, 19.5]])
    assert np.isnan(reference.evaluate(model.ir, far)).all()


@pytest.mark.parametrize(
    "name",
    [
        "soft votes of trees",
        "bag of trees",
        "chain of trees",
        "boosted, three",
        "isolation",
        "pairs",
        "stack of two",
        "calibrated in steps, three",
        "mixture",
        "expected mixture, tied, dirichlet_distribution",
        "linear one class",
        "threshold of the first",
        "threshold of a score",
        "most frequent",
        "chain of tree classes",
    ],
)
def test_the_text_of_compositions(name, tmp_path):
    verified(loaded(fit(*(EXACT | WITHIN)[name])), tmp_path, rows=300)


@pytest.mark.parametrize(
    ("estimator", "y", "message"),
    [
        (CalibratedClassifierCV(GaussianNB(), method="temperature", cv=2), TWO, "supported are 'sigmoid'"),
        (DummyClassifier(strategy="stratified"), TWO, "draws its answers at random"),
        *(
            (
                whole(RadiusNeighborsClassifier(200.0, outlier_label=-1)),
                THREE,
                "answers with -1, as an outlier_label may be",
            )
            for whole in (
                multiclass.OneVsOneClassifier,
                lambda one: ensemble.VotingClassifier([("a", one), ("b", tree(2))]),
                lambda one: ensemble.BaggingClassifier(one, 2),
                lambda one: CalibratedClassifierCV(one, cv=2),
            )
        ),
        (
            ensemble.GradientBoostingClassifier(n_estimators=2, init=GaussianNB()),
            THREE,
            "with init=GaussianNB: that is fitted on float32 whatever the data are, .* parts: take another init$",
        ),
        (
            multioutput.ClassifierChain(GaussianNB(), chain_method="predict_log_proba"),
            LABELS,
            "by the predict_log_proba",
        ),
    ],
)
def test_what_is_not_supported_says_so(estimator, y, message):
    with pytest.raises(UnsupportedModelError, match=message):
        loaded(fit(estimator, y))


def test_a_threshold_never_answers_with_the_label_of_rows_without_a_neighbour(tmp_path):
    model = loaded(FixedThresholdClassifier(RadiusNeighborsClassifier(1.0, outlier_label=9)).fit(X, TWO.astype(int)))
    rows = np.vstack([X, 10 * X])
    assert not model.predict(rows)[:, 1:].any(axis=1).all()
    assert np.array_equal(model.predict(rows), reference.evaluate(model.ir, rows))
    verified(model, tmp_path, rows=100)


def test_a_positive_label_that_does_not_exist_is_named():
    """The library raises for every row."""
    whole = FixedThresholdClassifier(tree(3), threshold=0.3).fit(X, TWO)
    whole.pos_label = "good"
    with pytest.raises(UnsupportedModelError, match="pos_label='good', which is none of its labels"):
        loaded(whole)


@pytest.mark.parametrize("strategy", ["mean", "median", "quantile", "constant"])
def test_a_constant_is_the_answer_to_every_row(strategy, tmp_path):
    given = {"quantile": 0.3} if strategy == "quantile" else {}
    model = loaded(DummyRegressor(strategy=strategy, constant=[2.5, -0.0, 1e-300], **given).fit(X, YN))
    rows = np.array([[1.0, 2.0, 3.0], [np.nan, np.inf, -np.inf], [np.inf, 0.0, np.nan], [-np.inf, 1e300, -1e300]])
    assert np.array_equal(model.predict(rows), reference.evaluate(model.ir, rows))
    verified(model, tmp_path, rows=300)


@pytest.mark.parametrize("strategy", ["most_frequent", "prior", "constant"])
def test_a_constant_label_and_its_shares(strategy):
    model = loaded(DummyClassifier(strategy=strategy, constant=WORDS[0]).fit(X, WORDS))
    rows = np.array([[1.0, 2.0, 3.0], [np.nan, np.inf, -np.inf]])
    assert np.array_equal(model.predict(rows), reference.evaluate(model.ir, rows))


def test_forests_run_one_job_wherever_they_stand():
    """With several jobs two calls of the library differ in their last bits, and no reference equals both."""
    forest = ensemble.RandomForestClassifier(4, random_state=0, n_jobs=2).fit(X, TWO)
    calibrated = CalibratedClassifierCV(clone(forest), cv=2).fit(X, TWO)
    inside = calibrated.calibrated_classifiers_[0].estimator
    for whole, inner in ((calibrated, inside), (FrozenEstimator(forest), forest)):
        assert inner.n_jobs == 2
        model = loaded(whole)
        assert inner.n_jobs == 1 and any("n_jobs=1" in note for note in model.ir.source.notes)


@pytest.mark.parametrize("kind", [ensemble.BaggingClassifier, ensemble.BaggingRegressor])
def test_a_bag_that_divides_by_another_number_than_it_has_is_refused(kind):
    bag = kind(n_estimators=5, random_state=0).fit(X, THREE)
    bag.n_estimators = 4
    with pytest.raises(InputError, match=rf"^{kind.__name__}\.n_estimators: number 0 is 4, expected 5 .. 5"):
        loaded(bag)


def test_boosting_that_ended_early_divides_by_the_sum_of_all_weights():
    """NumPy adds the zeros of the estimators that are not there in an order of its own."""
    model = ensemble.AdaBoostClassifier(tree(1), n_estimators=13, random_state=0).fit(X, TWO)
    model.estimator_weights_ = np.pad(model.estimator_weights_, (0, 20))
    divisors = [op.constant for op in loaded(model).ir.ops if isinstance(op, Scale) and op.operator is Operator.DIVIDE]
    assert model.estimator_weights_.sum() != model.estimator_weights_[:13].sum()
    assert any(np.all(divisor == model.estimator_weights_.sum()) for divisor in divisors)
