"""Classifiers and anomaly models: the label, the scores and the decision, for every input."""

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.cluster import KMeans
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis, QuadraticDiscriminantAnalysis
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.naive_bayes import BernoulliNB, GaussianNB
from sklearn.neighbors import NearestCentroid
from sklearn.neural_network import MLPClassifier
from sklearn.svm import SVC, OneClassSVM

from st_codegen.driver import generate
from st_codegen.ir import Output
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.arithmetic import METHOD
from st_codegen.proof.prove.prove import Verdict, prove
from tests.classifiers import SCORE, THREE, TWO, X, loaded

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
    assert (result.verdict, result.method, result.reason) == (Verdict.PROVED, METHOD, "")
    assert result.operations > 0 and result.bound == ()


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
    changed, count = re.subn(pattern, change, path.read_text(), count=1)
    assert count == 1
    path.write_text(changed)
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is not Verdict.PROVED


def ranged(model, *ports):
    return dataclasses.replace(model, ir=dataclasses.replace(model.ir, ports=ports))


@pytest.mark.parametrize(
    "change", [None, ("fTorque > ", "fTorque >= "), ("bPlausible := bUsable", "bPlausible := TRUE")]
)
def test_an_output_outside_of_its_plausible_range_is_told(change, tmp_path):
    model = ranged(loaded(Ridge().fit(X, SCORE)), Output("fTorque", "N m", -2.0, 2.0))
    assert proved(model, tmp_path).verdict is Verdict.PROVED
    if change is not None:
        (path,) = (tmp_path / "iec").glob("FB_M.st")
        assert change[0] in path.read_text()
        path.write_text(path.read_text().replace(*change))
        (result,) = prove(Bundle((model,)), tmp_path).results
        assert result.verdict is Verdict.NOT_PROVED and "bPlausible" in result.reason


def test_a_table_of_labels_is_proved_cell_by_cell(tmp_path):
    from sklearn.ensemble import RandomForestClassifier

    model = loaded(RandomForestClassifier(5, max_depth=3, random_state=0).fit(np.round(X), THREE), outputs=())
    result = proved(model, tmp_path, Layout.TABLE)
    assert (result.verdict, result.method) == (Verdict.PROVED, "all cells")
