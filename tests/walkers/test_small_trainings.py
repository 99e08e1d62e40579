"""Trainings that ended with less than usual: one estimator, one class; and files of what is said to be compiled."""

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("skops")

import skops.io
from sklearn.cluster import BisectingKMeans
from sklearn.ensemble import AdaBoostRegressor
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


def test_a_network_of_one_class_is_refused(tmp_path):
    """Its probability may exceed 0.5, and there is no second class."""
    network = MLPClassifier((5,), max_iter=5, random_state=0).fit(X, np.zeros(60, int))
    with pytest.raises(InputError, match="MLPClassifier with one class"):
        load(saved(network, tmp_path))
