"""Classifiers and anomaly models: the label, the scores and the decision, for every input."""

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.calibration import CalibratedClassifierCV
from sklearn.cluster import KMeans
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis, QuadraticDiscriminantAnalysis
from sklearn.ensemble import (
    AdaBoostClassifier,
    GradientBoostingClassifier,
    HistGradientBoostingClassifier,
    HistGradientBoostingRegressor,
    IsolationForest,
    RandomForestClassifier,
    RandomForestRegressor,
    VotingClassifier,
)
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.multiclass import OneVsRestClassifier
from sklearn.naive_bayes import BernoulliNB, GaussianNB
from sklearn.neighbors import NearestCentroid
from sklearn.neural_network import MLPClassifier
from sklearn.preprocessing import QuantileTransformer
from sklearn.svm import SVC, OneClassSVM
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.driver import generate
from st_codegen.ir import Output
from st_codegen.passes import jumps
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.jumps import inexact_columns
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.arithmetic import EXPRESSION
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.tree_proof import SUMS, TAIL
from st_codegen.walkers.base import LoadedModel
from tests.changes import change_once, ulp
from tests.classifiers import GAPS, SCORE, THREE, TWO, X, loaded

#: Models without trees: decisions on a score, votes, softmax, sigmoids, distances.
EXPRESSIONS = {
    "logistic regression": (LogisticRegression(), THREE),
    "logistic regression of two": (LogisticRegression(), TWO),
    "support vectors, votes": (SVC(C=0.1), THREE),
    "support vectors, ties broken": (
        SVC(C=0.1, kernel="linear", break_ties=True, decision_function_shape="ovr"),
        THREE,
    ),
    "network": (MLPClassifier((4,), activation="tanh", max_iter=30, random_state=0), THREE),
    "network of two": (MLPClassifier((4,), activation="logistic", max_iter=30, random_state=0), TWO),
    "normal distributions": (GaussianNB(), THREE),
    "truth values": (BernoulliNB(), THREE),
    "linear discriminants": (LinearDiscriminantAnalysis(), THREE),
    "quadratic discriminants": (QuadraticDiscriminantAnalysis(), TWO),
    "nearest centre": (NearestCentroid(), THREE),
    "clusters": (KMeans(3, n_init=1, random_state=0), None),
    "one class": (OneClassSVM(nu=0.1), None),
}


def fitted(estimator, y, x=X):
    x = x[:80]
    return loaded(estimator.fit(x) if y is None else estimator.fit(x, y[:80]))


def proved(model, folder, layout=Layout.AUTO, target="iec"):
    """The verdict on a model that was generated."""
    generate(Bundle((model,)), target, folder, options=Options(layout=layout))
    (result,) = prove(Bundle((model,)), folder).results
    return result


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_the_label_is_the_decision_of_the_model_s_expression(name, tmp_path):
    result = proved(fitted(*EXPRESSIONS[name]), tmp_path)
    assert (result.verdict, result.method, result.reason) == (Verdict.PROVED, EXPRESSION, "")
    assert result.operations > 0 and result.bound == ()


@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize(
    "estimator",
    [
        SVC(C=0.1, probability=True),
        QuantileTransformer(n_quantiles=5, output_distribution="normal"),
    ],
)
def test_what_the_pages_say_is_not_followed(estimator, tmp_path):
    result = proved(fitted(estimator, THREE), tmp_path)
    assert result.verdict is Verdict.NOT_PROVED and "a division by what may be zero" in result.reason


CHANGES = {
    "the last of the largest": ("logistic regression", r"(\] )>( fLargest)", r"\1>=\2"),
    "one column too few": ("logistic regression", r"(FOR nColumn := 1 TO )2( DO\n +IF aStep)", r"\g<1>1\2"),
    "a label by hand": ("logistic regression", r"nBest := nColumn;", "nBest := 2;"),
    "another cut": ("logistic regression of two", r"(CUT_\d : .*\n\s+)0\.0", r"\g<1>5.0E-324"),
    "a cut that is reached": ("logistic regression of two", r"> (CUT_\d)", r">= \1"),
    "a sum that is not whole": ("logistic regression", r"fSum := fSum \+ fY", "fSum := fY"),
    "another base": ("logistic regression", r"(fX := aStep\d\[nColumn\] - )fLargest", r"\1fSum"),
    "a centre": ("nearest centre", r"(BIAS_\d : .*\n\s+)(-?)", r"\g<1>\g<2>1"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_decision_changed_by_hand_is_not_proved(name, tmp_path):
    estimator, pattern, change = CHANGES[name]
    model = fitted(*EXPRESSIONS[estimator])
    generate(Bundle((model,)), "iec", tmp_path)
    (path,) = (tmp_path / "iec").glob("FB_M.st")
    change_once(path, pattern, change)
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


PLAUSIBLE_CHANGES = [None, ("fTorque > ", "fTorque >= "), ("bPlausible := bUsable", "bPlausible := TRUE")]


def ranged(model, *ports):
    return dataclasses.replace(model, ir=dataclasses.replace(model.ir, ports=ports))


@pytest.mark.parametrize("change", PLAUSIBLE_CHANGES)
def test_an_output_outside_of_its_plausible_range_is_told(change, tmp_path):
    model = ranged(loaded(Ridge().fit(X, SCORE)), Output("fTorque", "N m", -2.0, 2.0))
    assert proved(model, tmp_path).verdict is Verdict.PROVED
    if change is not None:
        (path,) = (tmp_path / "iec").glob("FB_M.st")
        assert change[0] in path.read_text()
        path.write_text(path.read_text().replace(*change))
        (result,) = prove(Bundle((model,)), tmp_path).results
        assert result.verdict is Verdict.NOT_PROVED and "bPlausible" in result.reason


#: Trees of each library and of each way to a label or to a number behind their sums.
TREES = {
    "tree": (DecisionTreeClassifier(max_depth=3, random_state=0), X, THREE),
    "forest with ties": (RandomForestClassifier(4, max_depth=2, max_features=1, random_state=1), np.round(X), THREE),
    "boosting": (GradientBoostingClassifier(n_estimators=3, max_depth=2, random_state=0), X, THREE),
    "boosting of two": (GradientBoostingClassifier(n_estimators=3, max_depth=2, random_state=0), X, TWO),
    "histogram boosting, missing values": (HistGradientBoostingClassifier(max_iter=2, random_state=0), GAPS, THREE),
    "histogram boosting, a category": (
        HistGradientBoostingClassifier(max_iter=3, categorical_features=[1], random_state=0),
        np.column_stack([X[:, 0], np.digitize(X[:, 1], [-3, 0, 2]), X[:, 2]]),
        THREE,
    ),
    "anomalies": (IsolationForest(n_estimators=4, max_samples=20, random_state=0), X, None),
    "votes of trees": (
        AdaBoostClassifier(DecisionTreeClassifier(max_depth=1), n_estimators=3, random_state=0),
        X,
        THREE,
    ),
    "votes of trees and weights": (
        VotingClassifier([("t", DecisionTreeClassifier(max_depth=2)), ("w", LogisticRegression())]),
        X,
        THREE,
    ),
    "a sigmoid of a forest": (
        CalibratedClassifierCV(RandomForestClassifier(2, max_depth=2, random_state=0), cv=2),
        X,
        TWO,
    ),
    "one against the rest": (OneVsRestClassifier(DecisionTreeClassifier(max_depth=2)), X, THREE),
    "counts": (HistGradientBoostingRegressor(loss="poisson", max_iter=2, random_state=0), X, np.abs(SCORE)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("layout", [Layout.TREES, Layout.AUTO])
def test_labels_and_numbers_of_trees_are_followed_to_the_end(name, layout, tmp_path):
    estimator, x, y = TREES[name]
    result = proved(fitted(estimator, y, x), tmp_path, layout)
    assert (result.verdict, result.reason) == (Verdict.PROVED, ""), result
    assert layout is Layout.AUTO or (result.method, result.operations > 0) == (TAIL, True)


BOOSTERS = {
    "lightgbm of two": ("LGBMClassifier", {}, TWO),
    "lightgbm": ("LGBMClassifier", {}, THREE),
    "lightgbm, one against the rest": ("LGBMClassifier", {"objective": "multiclassova"}, THREE),
    "lightgbm, linear leaves": ("LGBMRegressor", {"linear_tree": True}, SCORE),
    "lightgbm, linear leaves and classes": ("LGBMClassifier", {"linear_tree": True}, TWO),
    "lightgbm, counts": ("LGBMRegressor", {"objective": "poisson"}, np.abs(SCORE)),
    "xgboost of two": ("XGBClassifier", {}, TWO),
    "xgboost": ("XGBClassifier", {}, THREE),
    "xgboost, the larger score": ("XGBClassifier", {"objective": "multi:softmax"}, THREE),
    "xgboost, counts": ("XGBRegressor", {"objective": "count:poisson"}, np.abs(SCORE)),
}


def booster(name):
    kind, options, y = BOOSTERS[name]
    library = pytest.importorskip("lightgbm" if kind.startswith("LGBM") else "xgboost")
    options = {"n_estimators": 3, "max_depth": 2, "n_jobs": 1, **options}
    if kind.startswith("LGBM"):
        options |= {"num_leaves": 4, "min_child_samples": 5, "verbose": -1}
    return fitted(getattr(library, kind)(**options), y.astype(int) if "Classifier" in kind else y, GAPS)


@pytest.mark.thorough
@pytest.mark.parametrize("name", BOOSTERS)
@pytest.mark.parametrize("layout", [Layout.TREES, Layout.AUTO])
def test_labels_and_numbers_of_boosters_are_followed_to_the_end(name, layout, tmp_path):
    result = proved(booster(name), tmp_path, layout, "twincat" if layout is Layout.TREES else "iec")
    assert (result.verdict, result.reason) == (Verdict.PROVED, ""), result


TREE_CHANGES = {
    "the last of the largest": ("forest with ties", r"(\] )>( fLargest)", r"\1>=\2"),
    "a class too few": ("boosting", r"(FOR nColumn := 1 TO )2( DO\n +IF aStep)", r"\g<1>1\2"),
    "a cut that is not reached": ("boosting of two", r">= (CUT_\d)", r"> \1"),
    "another sigmoid": ("boosting of two", r"fExp := EXP\(-ABS\(fX\)\)", "fExp := EXP(-fX)"),
    "another divisor": ("anomalies", r"(OPERAND_\d : .*\n\s+-?)\d", r"\g<1>7"),
    "another exponential": ("counts", r"EXP\(fX\)", "EXP(-fX)"),
}


@pytest.mark.parametrize("name", TREE_CHANGES)
def test_what_stands_behind_trees_is_not_proved_when_it_was_changed(name, tmp_path):
    trained, pattern, change = TREE_CHANGES[name]
    estimator, x, y = TREES[trained]
    model = fitted(estimator, y, x)
    generate(Bundle((model,)), "iec", tmp_path, options=Options(layout=Layout.TREES))
    (path,) = (tmp_path / "iec").glob("FB_M.st")
    change_once(path, pattern, change)
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


def test_of_several_numbers_the_one_that_was_changed_is_named(tmp_path):
    forest = RandomForestRegressor(2, max_depth=2, random_state=0)
    model = loaded(forest.fit(X[:80], np.column_stack([SCORE, -SCORE, SCORE**2])[:80]))
    assert proved(model, tmp_path, Layout.TREES).method == SUMS
    path = tmp_path / "iec" / "FB_M.st"
    path.write_text(path.read_text().replace("fOut2 := aStep1[1]", "fOut2 := aStep1[1] + 0.5"))
    (result,) = prove(Bundle((model,)), tmp_path).results
    assert result.verdict is Verdict.REFUTED
    assert "fOut2: not the additions" in result.reason


@pytest.mark.parametrize("name", ["logistic regression", "counts", "boosting"])
def test_with_ranges_it_is_told_that_no_bound_is_known(name, tmp_path):
    """A label, and what stands behind trees, has none; without ranges it would be the ranges that are missing."""
    estimator, x, y = (EXPRESSIONS[name][0], X, EXPRESSIONS[name][1]) if name in EXPRESSIONS else TREES[name]
    model = fitted(estimator, y, x)
    for features, bound in ((model.ir.features, set()), (ranged_features(model), {np.inf})):
        model = LoadedModel(dataclasses.replace(model.ir, features=features), model.predict)
        result = proved(model, tmp_path / str(len(bound)), Layout.TREES)
        assert (result.verdict, set(result.bound)) == (Verdict.PROVED, bound)


def ranged_features(model):
    return tuple(dataclasses.replace(feature, lower=-4.0, upper=4.0) for feature in model.ir.features)


def test_leaves_without_terms_keep_their_constant(tmp_path):
    """Beside leaves with terms they were "assigned in some boxes only"."""
    lightgbm = pytest.importorskip("lightgbm")
    x = np.random.default_rng(0).uniform(0.0, 9.0, (60, 2))
    y = x @ (1.0, 2.0) + np.sin(3.0 * x[:, 0])
    x[np.random.default_rng(1).random(x.shape) < 0.3] = np.nan
    options = {"n_estimators": 2, "num_leaves": 6, "min_child_samples": 5, "linear_tree": True, "verbose": -1}
    model = loaded(lightgbm.LGBMRegressor(n_jobs=1, **options).fit(x, y))
    assert proved(model, tmp_path, Layout.TREES).verdict is Verdict.PROVED
    path = tmp_path / "iec" / "FB_M.st"
    text = path.read_text()
    starts, constants = (
        re.search(rf" {name}_1 : [^\[]+\[[^\[]+\[(.*?)\]", text, re.DOTALL) for name in ("LEAF_START", "LEAF_CONSTANT")
    )
    first, numbers = ([int(word) for word in starts[1].split(",")], constants[1].split(","))
    # no leaf of the first tree has terms: LightGBM begins with constants
    bare = [leaf for leaf in range(6, len(numbers)) if first[leaf] == first[leaf + 1]]
    assert 0 < len(bare) < 6
    numbers[bare[0]] = repr(float(np.nextafter(float(numbers[bare[0]]), np.inf)))
    path.write_text(text.replace(constants[1], ",".join(numbers)))
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


LEAF_CHANGES = {
    "a coefficient by an ulp": (r"(LEAF_COEFFICIENT_1 : .*\n\s+(?:\(\*.*\*\)\n\s+)?)(-?[0-9.]+)", None),
    "a missing value that is not noticed": (r"fX := THRESHOLD_1\[nNode\];", "fX := fX;"),
    "another input": (r"fTerm := aInput\[LEAF_COLUMN_1\[nTerm\]\]", "fTerm := aInput[0]"),
    "another order": (r"fX := fX \+ (LEAF_COEFFICIENT_1\[nTerm\] \* fTerm)", r"fX := \1 + fX"),
}


@pytest.mark.parametrize("name", LEAF_CHANGES)
def test_a_linear_model_in_a_leaf_that_was_changed_is_not_proved(name, tmp_path):
    pattern, change = LEAF_CHANGES[name]
    model = booster("lightgbm, linear leaves")
    generate(Bundle((model,)), "iec", tmp_path)
    (path,) = (tmp_path / "iec").glob("FB_M.st")
    change_once(path, pattern, change or ulp)
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.TABLE])
@pytest.mark.parametrize("change", PLAUSIBLE_CHANGES)
def test_the_plausible_range_of_trees_is_told(change, layout, tmp_path):
    trained = DecisionTreeRegressor(max_depth=3, random_state=0).fit(np.round(X), np.round(SCORE))
    model = ranged(loaded(trained), Output("fTorque", "N m", -1.0, 1.0))
    assert proved(model, tmp_path, layout).verdict is Verdict.PROVED
    if change is not None:
        (path,) = (tmp_path / "iec").glob("FB_M.st")
        assert change[0] in path.read_text()
        path.write_text(path.read_text().replace(*change))
        (result,) = prove(Bundle((model,)), tmp_path).results
        accepts_all = change[1].endswith("TRUE") and model.ir.accepts_nan and not any(model.ir.magnitude_limits)
        assert accepts_all or result.verdict is not Verdict.PROVED


def test_a_plausible_range_that_holds_every_cell_is_told(tmp_path):
    trained = DecisionTreeRegressor(max_depth=3, random_state=0).fit(np.round(X), np.round(SCORE))
    model = ranged(loaded(trained), Output("fTorque", "N m", -100.0, 100.0))
    assert proved(model, tmp_path, Layout.TABLE).verdict is Verdict.PROVED
    (path,) = (tmp_path / "iec").glob("FB_M.st")
    assert "PLAUSIBLE_UPPER_1 : LREAL := 100.0" in path.read_text()
    path.write_text(path.read_text().replace("PLAUSIBLE_UPPER_1 : LREAL := 100.0", "PLAUSIBLE_UPPER_1 : LREAL := 0.5"))
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


def test_a_table_of_labels_is_proved_cell_by_cell(tmp_path):
    model = loaded(RandomForestClassifier(5, max_depth=3, random_state=0).fit(np.round(X), THREE), outputs=())
    result = proved(model, tmp_path, Layout.TABLE)
    assert (result.verdict, result.method) == (Verdict.PROVED, "all cells")


def test_what_is_inexact_is_not_asked_again_for_each_of_many_ensembles(tmp_path, monkeypatch):
    """A proof of 200 boosted trees, each an ensemble of its own, took seven minutes, nearly all of it there."""
    asked = []

    def counted(model):
        asked.append(model)
        return inexact_columns(model)

    monkeypatch.setattr(jumps, "inexact_columns", counted)
    model = loaded(AdaBoostClassifier(n_estimators=20).fit(X, THREE))
    bundle = Bundle((model,))
    generate(bundle, "iec", tmp_path)
    asked.clear()
    assert prove(bundle, tmp_path).proved
    assert len(asked) < 5
