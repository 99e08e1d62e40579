"""Every estimator of scikit-learn is compiled and agrees with the library, or is refused in one line."""

import contextlib
import inspect
import io
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("skops")

import skops.io
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor
from sklearn.utils import all_estimators

from st_codegen.errors import InputError
from st_codegen.ir import digest, reference
from st_codegen.proof import bounds
from st_codegen.walkers.base import _NEAR, is_known, walks
from st_codegen.walkers.objects import from_estimator, load_skops
from st_codegen.walkers.supported import table
from tests.classifiers import SCORE, THREE, X, loaded

ROOT = Path(__file__).resolve().parents[2]
ESTIMATORS = dict(all_estimators())
PARTS = [("a", DecisionTreeClassifier(max_depth=3)), ("b", LogisticRegression())]
NUMBERS = [("a", DecisionTreeRegressor(max_depth=3)), ("b", Ridge())]
#: What estimators need beyond their defaults.
ARGUMENTS = {
    "estimators": lambda kind: NUMBERS if "Regressor" in kind else PARTS,
    "transformers": lambda kind: [("all", "passthrough", [0, 1, 2])],
    "transformer_list": lambda kind: [("all", "passthrough")],
    "steps": lambda kind: [("tree", DecisionTreeRegressor(max_depth=3))],
    "estimator": lambda kind: Ridge() if any(w in kind for w in ("Regressor", "RFE", "From")) else LogisticRegression(),
    "base_estimator": lambda kind: Ridge(),
    "param_grid": lambda kind: {},
    "param_distributions": lambda kind: {},
}
SMALLER = {"n_estimators": 5, "max_iter": 50, "n_components": 2, "max_depth": 4, "bin_seeding": True}
#: These build a model that is not fitted by rows of numbers and their answers.
OTHER_DATA = {
    "SparseCoder": "takes a dictionary",
    "FrozenEstimator": "is fitted before it is made",
}
#: skops does not write the tree of these.
NO_SKOPS = {"Birch"}


def built(name):
    """A small estimator of a class."""
    kind = ESTIMATORS[name]
    parameters = inspect.signature(kind).parameters
    given = {
        key: make(name)
        for key, make in ARGUMENTS.items()
        if key in parameters and (parameters[key].default is inspect.Parameter.empty or key == "estimators")
    }
    given |= {key: value for key, value in SMALLER.items() if key in parameters and "Theil" not in name}
    # the rounds of the one are trees, not steps of a solver; the others are refused however well they are fitted
    if any(part in name for part in ("HistGradient", "Dictionary", "LatentDirichlet")):
        given["max_iter"] = 5
    return kind(**given)


def fitted(estimator, name, dtype="float64"):
    """The estimator after `fit` on data that it takes, of a type; skips where it takes none of these."""
    answers = [
        THREE,
        SCORE,
        np.abs(SCORE) + 0.1,
        np.column_stack([SCORE, X[:, 0]]),
        np.column_stack([THREE, THREE > 1]),
    ]
    if "Classifier" not in name and "Cross" not in name:
        answers = [SCORE, THREE, *answers[2:]]
    if getattr(estimator, "_estimator_type", None) == "classifier" or hasattr(estimator, "decision_function"):
        answers = [THREE, *answers]
    for y in answers:
        for x in (X.astype(dtype), np.abs(X).astype(dtype)):
            with contextlib.suppress(Exception), contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return estimator.fit(x, y.astype(dtype) if y.dtype.kind == "f" else y), x.astype(np.float64)
    pytest.skip("fits none of the data of this test")


@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", [name for name in ESTIMATORS if name not in OTHER_DATA])
def test_an_estimator_is_compiled_or_refused_in_one_line(name, dtype, tmp_path):
    estimator, x = fitted(built(name), name, dtype)
    try:
        model = loaded(estimator)
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 6000
        known = name in walks.of("sklearn") if hasattr(estimator, "predict") else is_known("sklearn", name)
        assert not known or "is not supported" not in str(error)
        return
    if name not in NO_SKOPS:
        skops.io.dump(estimator, tmp_path / "saved.skops")
        saved = load_skops(tmp_path / "saved.skops", "m")
        assert digest(saved.ir) == digest(from_estimator(estimator, "m").ir)
    rows = x[:80]
    library = model.predict(rows)
    found, bound = reference.evaluate(model.ir, rows), bounds.difference_bound(model.ir, rows)
    same = (np.abs(library - found) <= bound) | (np.isnan(library) & np.isnan(found)) | np.isinf(bound)
    assert np.all(same)
    assert np.isfinite(found).all(axis=1).mean() > 0.9


@pytest.mark.parametrize(
    "name",
    """GaussianMixture GaussianNB KMeans KNeighborsRegressor PCA PowerTransformer
    QuadraticDiscriminantAnalysis RadiusNeighborsRegressor""".split(),
)
def test_what_computes_in_float32_where_it_was_fitted_on_it_is_refused(name):
    loaded(fitted(built(name), name)[0])
    with pytest.raises(InputError, match=f"^{name} was fitted on float32, .* fit it on X.astype"):
        loaded(fitted(built(name), name, "float32")[0])


def test_most_estimators_that_predict_are_compiled():
    predicting = {name for name, kind in ESTIMATORS.items() if hasattr(kind, "predict")}
    assert len(predicting & set(walks.of("sklearn"))) >= 75


def test_the_page_of_models_is_what_the_command_prints():
    pytest.importorskip("onnx")
    page = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    assert page.endswith("\n\n" + table() + "\n"), "docs/models.md: replace its table by that of `st-codegen models`"


def test_the_table_of_libraries_names_no_class_that_is_not_compiled():
    lines = (ROOT / "docs" / "models.md").read_text(encoding="utf-8").splitlines()
    row = next(line for line in lines if "| scikit-learn |" in line)
    named = {word for word in re.findall(r"\b[A-Z]\w+", row) if word in ESTIMATORS}
    assert named and all(is_known("sklearn", name) for name in named)


@pytest.mark.parametrize("name", sorted(_NEAR))
def test_what_a_refusal_names_instead_is_compiled(name):
    words = re.findall(r"[A-Z]\w+", _NEAR[name].partition("(")[0])
    assert words and all(is_known("sklearn", word) for word in words) and name not in walks.of("sklearn")
