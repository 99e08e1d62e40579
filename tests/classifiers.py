"""Data of classes, and the way from a fitted classifier to the text that was verified."""

import numpy as np

from st_codegen.driver import generate
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.outputs import with_outputs
from st_codegen.project.bundle import Bundle
from st_codegen.proof.verify import verify
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator

RANDOM = np.random.default_rng(11)
X = np.round(RANDOM.normal(size=(300, 3)) * [1.0, 5.0, 0.2], 2)
SCORE = X[:, 0] + np.sin(X[:, 1]) + 3 * X[:, 2] ** 2
TWO = SCORE > 0.2
THREE = np.digitize(SCORE, [-0.5, 0.7])
MANY = np.digitize(SCORE, np.linspace(-2.0, 2.0, 16))
WORDS = np.array(["good part", "*) ]]> bad", "ungenau, schlecht"])[THREE]
GAPS = np.where(RANDOM.random(X.shape) < 0.1, np.nan, X)


def loaded(estimator, outputs=None):
    """A fitted estimator as a bundle of one, with the outputs that are wanted (None: all that it has)."""
    model = estimator if isinstance(estimator, LoadedModel) else from_estimator(estimator, "m")
    wanted = set(model.ir.kinds) if outputs is None else outputs
    ir, columns = with_outputs(model.ir, wanted)
    return LoadedModel(limit_inputs(ir), lambda x: model.predict(x)[:, columns])


def verified(model, folder, target="twincat", rows=1500):
    """The report of a model that was generated for a target and verified."""
    bundle = Bundle((model,))
    generate(bundle, target, folder)
    (report,) = verify(bundle, folder, rows=rows, jobs=1).models
    assert report.passed, report.failures
    return report
