"""LightGBM and XGBoost: classes, rankings and survival, against the libraries themselves."""

import numpy as np
import pytest

lightgbm = pytest.importorskip("lightgbm")
xgboost = pytest.importorskip("xgboost")

from st_codegen.errors import UnsupportedModelError  # noqa: E402
from st_codegen.ir import OutputKind, reference  # noqa: E402
from st_codegen.proof import bounds  # noqa: E402
from st_codegen.walkers.files import load_model  # noqa: E402
from tests.classifiers import GAPS, THREE, TWO, WORDS, X, loaded, verified  # noqa: E402

NUMBER = TWO.astype(float)
ROWS = np.vstack([GAPS, X, X + 1e-9, 3 * X[::-1, ::-1]])


def light(objective, y, path, **parameters):
    """A LightGBM text model of an objective."""
    classes = {"num_class": int(y.max()) + 1} if objective.startswith("multi") else {}
    data = lightgbm.Dataset(GAPS, y, group=[100, 200] if "rank" in objective else None)
    settings = {"objective": objective, "verbose": -1, "num_leaves": 6, "min_data_in_leaf": 5, "num_threads": 1}
    booster = lightgbm.train(settings | classes | parameters, data, 7)
    booster.save_model(path / "m.txt")
    return loaded(load_model(path / "m.txt", "m"))


def extreme(objective, y, path, rounds=6, **parameters):
    """An XGBoost JSON model of an objective."""
    data = xgboost.DMatrix(GAPS, y)
    if "rank" in objective:
        data.set_group([100, 200])
    if objective == "survival:aft":
        data = xgboost.DMatrix(GAPS)
        data.set_float_info("label_lower_bound", y)
        data.set_float_info("label_upper_bound", y + 1)
    classes = {"num_class": int(y.max()) + 1} if objective.startswith("multi") else {}
    booster = xgboost.train({"objective": objective, "max_depth": 3, "nthread": 1} | classes | parameters, data, rounds)
    booster.save_model(path / "m.json")
    return loaded(load_model(path / "m.json", "m"))


def assert_exact(model, *kinds):
    """Outputs of these kinds equal the library's to the bit."""
    rows = ROWS[reference.valid_rows(model.ir, ROWS)]
    library, found = model.predict(rows), reference.evaluate(model.ir, rows)
    chosen = np.isin(np.array(model.ir.classes.kinds), kinds)
    assert np.array_equal(library[:, chosen], found[:, chosen])
    return library


@pytest.mark.parametrize(
    ("objective", "y", "parameters"),
    [
        ("binary", NUMBER, {}),
        ("binary", NUMBER, {"sigmoid": 0.7}),
        ("multiclass", THREE, {}),
        ("multiclassova", THREE, {}),
        ("multiclass", THREE, {"boosting": "rf", "bagging_freq": 1, "bagging_fraction": 0.5}),
    ],
)
def test_classes_of_lightgbm(objective, y, parameters, tmp_path):
    model = light(objective, y, tmp_path, **parameters)
    report = verified(model, tmp_path / "out")
    exact = [OutputKind.DECISION] if objective == "multiclassova" else [OutputKind.DECISION, OutputKind.CLASS]
    library = assert_exact(model, *exact)
    assert report.open_rows <= 0.02 * report.n
    assert model.ir.classes.labels == tuple(range(int(y.max()) + 1))
    assert len(np.unique(library[:, 0])) > 1


@pytest.mark.parametrize("objective", ["cross_entropy", "cross_entropy_lambda", "lambdarank", "rank_xendcg"])
def test_numbers_of_lightgbm_s_other_objectives(objective, tmp_path):
    model = light(objective, THREE if "rank" in objective else NUMBER, tmp_path)
    assert model.ir.classes is None and model.ir.exact == ("rank" in objective)
    verified(model, tmp_path / "out")


@pytest.mark.parametrize("y", [WORDS, TWO, THREE - 1])
@pytest.mark.parametrize("objective", [None, "cross_entropy", "multiclassova"])
def test_lgbm_classifier_has_its_own_labels(y, objective, tmp_path):
    if (objective == "cross_entropy") != (len(np.unique(y)) == 2) and objective is not None:
        pytest.skip("an objective of another number of classes")
    model = loaded(lightgbm.LGBMClassifier(n_estimators=5, objective=objective, verbose=-1, n_jobs=1).fit(X, y))
    assert model.ir.classes.labels == tuple(np.unique(y).tolist())
    verified(model, tmp_path)


def test_a_sigmoid_that_rounds_to_a_half_decides_as_the_library(tmp_path):
    """Scores just above 0 have the probability 0.5, with which LGBMClassifier takes the first class."""
    x = np.arange(12.0)[:, None]
    scores = [0.0, 5e-17, 1e-16, 1.6e-16, 1.7e-16, 2.3e-16, 3e-16, 1e-15, -1e-17, -1e-16, -3e-16, 1.0]
    settings = {"objective": "binary", "verbose": -1, "num_leaves": 12, "boost_from_average": False, "max_bin": 50}
    settings |= {"min_data_in_leaf": 1, "min_data_in_bin": 1, "min_sum_hessian_in_leaf": 0.0}
    booster = lightgbm.train(settings, lightgbm.Dataset(x, np.arange(12) % 2), 1)
    for leaf, score in enumerate(scores):
        booster.set_leaf_output(0, leaf, score)
    booster.save_model(tmp_path / "m.txt")
    model = loaded(load_model(tmp_path / "m.txt", "m"))
    library = model.predict(x)
    assert np.array_equal(library[:, 0], reference.evaluate(model.ir, x)[:, 0])
    assert np.any((library[:, 0] == 0) & (library[:, -1] > 0))  # a positive score, and yet the first class


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("objective", "y", "parameters"),
    [
        ("binary:logistic", NUMBER, {}),
        ("binary:logistic", NUMBER, {"booster": "dart", "rate_drop": 0.5}),
        ("binary:logistic", NUMBER, {"booster": "gblinear"}),
        ("binary:hinge", NUMBER, {}),
        ("multi:softmax", THREE, {}),
        ("multi:softprob", THREE, {}),
        ("multi:softprob", NUMBER, {}),
    ],
)
def test_classes_of_xgboost(objective, y, parameters, tmp_path):
    model = extreme(objective, y, tmp_path, **parameters)
    report = verified(model, tmp_path / "out")
    assert report.open_rows == 0
    assert_exact(model, OutputKind.DECISION, OutputKind.CLASS)
    assert (OutputKind.PROBABILITY in model.ir.classes.kinds) == (objective in ("binary:logistic", "multi:softprob"))


@pytest.mark.parametrize("prior", np.linspace(0.02, 0.98, 25).round(3))
def test_margins_start_as_the_library_starts_them(prior, tmp_path):
    model = extreme("binary:logistic", NUMBER, tmp_path, rounds=1, base_score=prior)
    assert_exact(model, OutputKind.DECISION)


@pytest.mark.parametrize(
    ("objective", "y"),
    [
        ("binary:logitraw", NUMBER),
        ("rank:ndcg", THREE),
        ("rank:pairwise", THREE),
        ("rank:map", NUMBER),
        ("survival:cox", 3 + X[:, 0]),
        ("survival:aft", 10 + np.abs(X[:, 0])),
    ],
)
def test_numbers_of_xgboost_s_other_objectives(objective, y, tmp_path):
    model = extreme(objective, y, tmp_path)
    assert model.ir.classes is None
    assert model.ir.exact == (not objective.startswith("survival"))
    verified(model, tmp_path / "out")


@pytest.mark.parametrize(
    "objective", ["binary:logistic", "reg:logistic", "binary:logitraw", "binary:hinge", "multi:softmax"]
)
def test_xgb_classifier_decides_as_the_library(objective, tmp_path):
    y = THREE if objective == "multi:softmax" else TWO.astype(int)
    estimator = xgboost.XGBClassifier(n_estimators=5, max_depth=3, objective=objective, n_jobs=1).fit(X, y)
    model = loaded(estimator)
    verified(model, tmp_path)
    assert np.array_equal(model.predict(X)[:, 0], estimator.predict(X))
    estimator.save_model(tmp_path / "file.json")
    other = loaded(load_model(tmp_path / "file.json", "m"))
    assert np.array_equal(other.predict(X)[:, 0], estimator.predict(X))


def test_a_softmax_of_one_class_has_its_one_label(tmp_path):
    model = extreme("multi:softprob", np.zeros(len(X)), tmp_path)
    assert model.ir.classes.labels == (0,)
    verified(model, tmp_path / "out", rows=100)


def test_lgbm_classifier_of_one_class_is_refused_by_that():
    with pytest.raises(UnsupportedModelError, match="trained on the class 'good' alone"):
        loaded(lightgbm.LGBMClassifier(n_estimators=2, verbose=-1).fit(X, np.full(len(X), "good")))


RANKS = {"group": [len(X) // 2, len(X) - len(X) // 2]}


@pytest.mark.parametrize(("kind", "groups"), [(lightgbm.LGBMClassifier, {}), (lightgbm.LGBMRanker, RANKS)])
def test_lightgbm_that_leaves_trees_out_of_its_answers_is_refused(kind, groups):
    """A booster takes all trees, the class of the estimator does not: which, depends on the row."""
    early = {"pred_early_stop": True, "pred_early_stop_freq": 1, "pred_early_stop_margin": 0.01}
    model = kind(n_estimators=9, num_leaves=4, verbose=-1, **early).fit(X, TWO.astype(int), **groups)
    raw = {} if groups else {"raw_score": True}
    assert not np.array_equal(model.predict(X, **raw), model.booster_.predict(X, **raw))
    with pytest.raises(UnsupportedModelError, match="pred_early_stop"):
        loaded(model)
    loaded(model.set_params(pred_early_stop=False))


LABELS = np.column_stack([NUMBER, THREE > 0])


@pytest.mark.parametrize("strategy", ["one_output_per_tree", "multi_output_tree"])
@pytest.mark.parametrize("saved", [False, True])
def test_xgb_classifier_of_several_labels_has_an_output_for_each(strategy, saved, tmp_path):
    classifier = xgboost.XGBClassifier(n_estimators=6, max_depth=3, multi_strategy=strategy, nthread=1)
    classifier.fit(GAPS, LABELS).save_model(tmp_path / "m.json")
    model = loaded(load_model(tmp_path / "m.json", "m") if saved else classifier)
    rows = ROWS[reference.valid_rows(model.ir, ROWS)]
    found = reference.evaluate(model.ir, rows)
    assert model.ir.exact and np.array_equal(found, classifier.predict(rows))
    assert np.array_equal(found, model.predict(rows)) and set(found.ravel()) == {0.0, 1.0}
    assert verified(model, tmp_path, rows=300).exact


def test_a_booster_of_several_labels_gives_their_probabilities(tmp_path):
    model = extreme("binary:logistic", LABELS, tmp_path)
    rows = ROWS[reference.valid_rows(model.ir, ROWS)]
    difference = np.abs(reference.evaluate(model.ir, rows) - model.predict(rows))
    assert model.ir.classes is None and len(model.ir.outputs) == 2
    assert np.all(difference <= bounds.difference_bound(model.ir, rows)) and difference.max() < 1e-6


def test_several_labels_by_margins_of_a_hinge_are_refused(tmp_path):
    with pytest.raises(UnsupportedModelError, match="binary:hinge' with 2 outputs: train one for each"):
        extreme("binary:hinge", LABELS, tmp_path)


@pytest.mark.parametrize(
    ("call", "message"), [("save_config", "save_config gives has no trees"), ("dump", "dump_model")]
)
def test_what_else_xgboost_writes_as_json_is_refused_by_its_name(call, message, tmp_path):
    booster = xgboost.train({"max_depth": 2, "nthread": 1}, xgboost.DMatrix(GAPS, NUMBER), 2)
    if call == "dump":
        booster.dump_model(tmp_path / "m.json", dump_format="json")
    else:
        (tmp_path / "m.json").write_text(booster.save_config(), encoding="utf-8")
    with pytest.raises(UnsupportedModelError, match=rf"{message}.*save_model\('model.json'\)"):
        load_model(tmp_path / "m.json", "m")
