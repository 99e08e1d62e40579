"""CatBoost's JSON: files that it wrote, with its answers, and the library itself as referee where it is installed."""

import json
from pathlib import Path

import numpy as np
import pytest

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import TreeEnsemble, reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.pipeline import compile_models
from st_codegen.proof.bounds import difference_bound
from st_codegen.walkers.files import load_model
from tests.emit.test_emitted import run

DATA = Path(__file__).parent / "data"
VERSION = "catboost-1.2.10"
ANSWERS = json.loads((DATA / f"{VERSION}-answers.txt").read_text())
FILES = sorted(set(ANSWERS) - {"other-trees"})
EXACT = {"rmse", "gaps-high", "no-gaps", "scaled", "two-outputs"}


def path_of(name):
    return DATA / f"{VERSION}-{name}.json"


def rows(path):
    """As make_old_models.py makes them."""
    features = json.loads(path.read_text())["features_info"]["float_features"]
    borders = [np.float32(border) for feature in features for border in feature["borders"]][:60]
    near = [float(np.nextafter(border, np.float32(end))) for border in borders for end in (-9, 9)]
    pool = [*map(float, borders), *near, np.nan, np.inf, -np.inf, 1e300, -1e300, 0.0, 3.5e38]
    return np.random.RandomState(3).choice(pool, size=(80, len(features)))


def library(name, labels):
    """The answers in the file, labels as their numbers."""
    found = ANSWERS[name]
    if labels:
        found = [[labels.index(label), *others] for label, *others in found]
    return np.array(found, np.float64)


@pytest.mark.parametrize("name", FILES)
def test_answers_are_those_of_the_library(name):
    ir = load_model(path_of(name), "m").ir
    x = rows(path_of(name))
    expected, ours = library(name, ir.classes.labels if ir.classes else ()), reference.evaluate(ir, x)
    assert ir.exact == (name in EXACT)
    bound = difference_bound(ir, x)
    assert np.all(np.abs(ours - expected) <= bound)
    assert not np.any(bound[:, 0]) or name == "poisson"  # labels and sums are exact
    if ir.classes:
        assert not np.any(bound[:, -(ir.classes.kinds.count("decision")) :])


@pytest.mark.parametrize("name", ["rmse", "gaps-high", "text-labels", "one-vs-all"])
def test_the_text_computes_the_same(name, tmp_path):
    ir = limit_inputs(load_model(path_of(name), "m").ir)
    (compiled,) = compile_models([ir]).models
    x = rows(path_of(name))
    expected, got = reference.evaluate(ir, x), run(compiled, "iec", tmp_path, x)
    assert np.all(np.abs(got - expected) <= difference_bound(ir, x))
    assert not any(isinstance(op, TreeEnsemble) for op in compiled.ops)  # cells of a table


@pytest.mark.parametrize("name", FILES)
def test_the_installed_library_agrees(name):
    pytest.importorskip("catboost")
    model = load_model(path_of(name), "m")
    x = np.vstack([rows(path_of(name)), np.random.default_rng(0).normal(size=(200, len(model.ir.features))) * 2])
    assert np.all(np.abs(model.predict(x) - reference.evaluate(model.ir, x)) <= difference_bound(model.ir, x))


def test_without_the_library_its_answers_are_not_made_up():
    try:
        import catboost  # noqa: F401
    except ImportError:
        with pytest.raises(InputError, match="need the package catboost"):
            load_model(path_of("rmse"), "m").predict(np.zeros((1, 2)))


def changed(tmp_path, change, name="rmse"):
    document = json.loads(path_of(name).read_text())
    change(document)
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document))
    return path


REFUSED = {
    "categories": (lambda d: d["features_info"].update(categorical_features=[{}]), "categorical features"),
    "another loss": (lambda d: d["model_info"]["params"]["loss_function"].update(type="Cox"), "the loss Cox"),
    "leaves": (lambda d: d["oblivious_trees"][0]["leaf_values"].pop(), "splits with"),
    "a split": (
        lambda d: d["oblivious_trees"][0]["splits"][0].update(float_feature_index=9),
        "feature that there is not",
    ),
    "a border": (lambda d: d["oblivious_trees"][0]["splits"][0].pop("border"), "not as CatBoost writes it"),
    "a NaN": (lambda d: d["oblivious_trees"][0]["leaf_values"].__setitem__(0, float("nan")), "not finite"),
    "a kind of split": (lambda d: d["oblivious_trees"][0]["splits"][0].update(split_type="OneHot"), "splits of OneHot"),
    "a treatment": (lambda d: d["features_info"]["float_features"][0].update(nan_value_treatment=3), "not as CatBoost"),
    "a sum of models": (lambda d: d["model_info"].pop("params"), "its loss is not known"),
    "a number as bias": (lambda d: d.update(scale_and_bias=[1, 0.5]), "its bias is no list of numbers"),
    "no trees": (lambda d: d.update(oblivious_trees=[]), "no trees"),
    "the order": (lambda d: d["features_info"]["float_features"].reverse(), "not numbered"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused(tmp_path, name):
    change, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        load_model(changed(tmp_path, change), "m")


def test_other_trees_and_thresholds_are_refused(tmp_path):
    with pytest.raises(UnsupportedModelError, match="grow_policy='SymmetricTree'"):
        load_model(path_of("other-trees"), "m")
    path = changed(tmp_path, lambda d: d["model_info"].update(binclass_probability_threshold="0.3"), "text-labels")
    with pytest.raises(UnsupportedModelError, match="a probability threshold of its own"):
        load_model(path, "m")
