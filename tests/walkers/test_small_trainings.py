"""Trainings that ended with less than usual: one estimator, one class; and files of what is said to be compiled."""

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("skops")

import skops.io
from sklearn.cluster import BisectingKMeans
from sklearn.ensemble import AdaBoostClassifier, AdaBoostRegressor, IsolationForest
from sklearn.linear_model import Ridge
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline

from st_codegen.driver import generate
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.proof.verify import verify

X = np.random.default_rng(0).normal(size=(60, 3))


def saved(estimator, folder):
    (folder / "models").mkdir()
    skops.io.dump(estimator, folder / "models" / "m.skops")
    return folder / "models"


@pytest.mark.parametrize(
    "estimator",
    [
        AdaBoostRegressor(n_estimators=3).fit(X, np.zeros(60)),
        *(
            make_pipeline(BisectingKMeans(3, algorithm=name, random_state=0), Ridge()).fit(X, X[:, 0])
            for name in ("lloyd", "elkan")
        ),
    ],
    ids=["one estimator of a median", "lloyd", "elkan"],
)
def test_it_is_compiled(estimator, tmp_path):
    bundle = load(saved(estimator, tmp_path))
    generate(bundle, "iec", tmp_path / "out")
    assert verify(bundle, tmp_path / "out", rows=200).passed


@pytest.mark.parametrize(
    "estimator",
    [MLPClassifier((5,), max_iter=5, random_state=0), AdaBoostClassifier(n_estimators=2, random_state=0)],
)
def test_what_answers_with_its_only_class_is_refused_and_said_so(estimator, tmp_path):
    """The probability of a network's only class may exceed 0.5 or not; the refusals did not say what predict does."""
    estimator.fit(X, np.full(60, 7))
    assert np.unique(estimator.predict(50 * X)).tolist() == [7]
    name = type(estimator).__name__
    with pytest.raises(InputError, match=f"{name} trained on the class 7 alone, which is its answer to all rows"):
        load(saved(estimator, tmp_path))


def test_a_forest_of_single_samples_is_refused_and_said_so(tmp_path):
    """The refusal named paths that are too long as well, which such a forest has not."""
    forest = IsolationForest(n_estimators=3, max_samples=1, random_state=0).fit(X)
    assert len(np.unique(forest.score_samples(X))) == 1
    with pytest.raises(InputError, match=r"trees of one sample each, whose score is the same for all rows$"):
        load(saved(forest, tmp_path))


def test_paths_longer_than_the_forest_can_have_are_refused(tmp_path):
    forest = IsolationForest(n_estimators=3, max_samples=9, random_state=0).fit(X)
    forest._decision_path_lengths = [1e3 * path for path in forest._decision_path_lengths]
    with pytest.raises(InputError, match="with paths longer than any in trees of 9 samples each"):
        load(saved(forest, tmp_path))
