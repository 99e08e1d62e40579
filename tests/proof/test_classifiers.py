"""Classifiers from the library's own object to the text that runs: the same labels, and the numbers beside them."""

import json
import re

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.ensemble import (
    ExtraTreesClassifier,
    GradientBoostingClassifier,
    HistGradientBoostingClassifier,
    RandomForestClassifier,
)
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.tree import DecisionTreeClassifier, ExtraTreeClassifier

from st_codegen.driver import generate
from st_codegen.emit.blocks.classes import class_type, label_text
from st_codegen.errors import GeneratedCodeError, InputError, UnsupportedModelError
from st_codegen.ir import Classes, OutputKind, reference
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof import predict as predictions
from st_codegen.proof.verify import verify
from tests.classifiers import GAPS, MANY, THREE, TWO, WORDS, X, loaded, verified

#: Trees whose class, probabilities and scores are exact but for what a sigmoid or a softmax makes of them.
TREES = {
    "decision tree": (DecisionTreeClassifier(max_depth=6, random_state=0), X, WORDS),
    "extra tree": (ExtraTreeClassifier(max_depth=5, random_state=0), X, THREE - 1),
    "one class": (DecisionTreeClassifier(), X, np.full(len(X), "good")),
    "unpruned tree with weights": (DecisionTreeClassifier(class_weight="balanced", random_state=0), GAPS, TWO),
    "forest": (RandomForestClassifier(6, max_depth=4, random_state=0, n_jobs=2), X, TWO),
    "forest with ties": (RandomForestClassifier(4, max_depth=2, max_features=1, random_state=1), np.round(X), THREE),
    "forest of many classes": (RandomForestClassifier(5, max_depth=7, random_state=0), X, MANY),
    "extremely randomised trees": (ExtraTreesClassifier(5, max_depth=4, random_state=0), X, WORDS),
    "gradient boosting": (GradientBoostingClassifier(n_estimators=6, random_state=0), X, TWO),
    "gradient boosting, exponential": (
        GradientBoostingClassifier(n_estimators=6, loss="exponential", random_state=0),
        X,
        THREE > 1,
    ),
    "gradient boosting from zero": (GradientBoostingClassifier(n_estimators=4, init="zero", random_state=0), X, WORDS),
    "histogram boosting": (HistGradientBoostingClassifier(max_iter=8, random_state=0), GAPS, WORDS),
    "histogram boosting of two": (HistGradientBoostingClassifier(max_iter=8, random_state=0), X, TWO),
    "histogram boosting of a category": (
        HistGradientBoostingClassifier(max_iter=8, categorical_features=[1], random_state=0),
        np.column_stack([X[:, 0], np.digitize(X[:, 1], [-3, 0, 2]), X[:, 2]]),
        THREE,
    ),
    "scaled forest": (make_pipeline(StandardScaler(), RandomForestClassifier(4, max_depth=4, random_state=0)), X, TWO),
}


@pytest.mark.parametrize("name", TREES)
def test_trees_have_the_library_s_labels_and_scores(name, tmp_path):
    estimator, x, y = TREES[name]
    model = loaded(estimator.fit(x, y))
    report = verified(model, tmp_path)
    assert report.open_rows == 0
    kinds = np.array(model.ir.classes.kinds)
    certain = kinds != OutputKind.PROBABILITY if "boosting" in name else np.ones(len(kinds), bool)
    rows = np.vstack([x, x + 1e-9, x[::-1, ::-1]])
    rows = rows[reference.valid_rows(model.ir, rows)]
    assert np.array_equal(model.predict(rows)[:, certain], reference.evaluate(model.ir, rows)[:, certain])
    assert len(np.unique(model.predict(rows)[:, 0])) == len(np.unique(y))


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["iec", "twincat", "plcopen"])
def test_every_target_gives_the_class_and_the_numbers_beside_it(target, tmp_path):
    model = loaded(HistGradientBoostingClassifier(max_iter=5, random_state=0).fit(X, WORDS))
    assert verified(model, tmp_path, target).targets == [target]


def test_a_class_alone_is_a_table_of_small_numbers(tmp_path):
    model = loaded(RandomForestClassifier(6, max_depth=4, random_state=0).fit(np.round(X), THREE), outputs=())
    assert model.ir.outputs == ("class",) and model.ir.exact
    report = verified(model, tmp_path)
    assert report.exact
    text = (tmp_path / "twincat" / "POUs" / "FB_M.TcPOU").read_text(encoding="utf-8-sig")
    assert "nClass : DINT;" in text and "fOut1" not in text and re.search(r"CELL_2 : ARRAY\[0..\d+\] OF SINT", text)
    facts = json.loads((tmp_path / "twincat" / "st-codegen.json").read_text())["models"]["m"]
    assert facts["layout"] == "table" and facts["labels"] == [0, 1, 2] and facts["kinds"] == ["class"]


def test_a_table_of_more_classes_than_sint_holds(tmp_path):
    x = np.arange(400.0).reshape(-1, 1)
    model = loaded(DecisionTreeClassifier().fit(x, np.arange(400) // 2), outputs=())
    assert verified(model, tmp_path).exact
    assert "OF DINT := [" in (tmp_path / "twincat" / "POUs" / "FB_M.TcPOU").read_text(encoding="utf-8-sig")


def test_outputs_that_a_model_does_not_have_are_refused():
    with pytest.raises(InputError, match="gives no decision; it has: class, probability"):
        loaded(DecisionTreeClassifier().fit(X, TWO), outputs=[OutputKind.DECISION])


def test_a_classifier_of_several_outputs_is_refused():
    with pytest.raises(UnsupportedModelError, match="several outputs of classes"):
        loaded(KNeighborsClassifier().fit(X, np.column_stack([TWO, THREE])))


def test_text_of_other_classes_is_not_compared(tmp_path):
    trained = DecisionTreeClassifier(max_depth=2, random_state=0).fit(X, THREE)
    generate(Bundle((loaded(trained),)), "twincat", tmp_path)
    other = DecisionTreeClassifier(max_depth=2, random_state=0).fit(X, WORDS)
    for model in (loaded(other), loaded(trained, outputs=())):
        with pytest.raises(GeneratedCodeError, match="other outputs or classes"):
            verify(Bundle((model,)), tmp_path, rows=10)


@pytest.mark.parametrize(
    "labels", [np.array(["a,b", "c"]), np.array([False, True]), np.array([-1, 1]), np.array([0.0, 2.0])]
)
def test_predict_gives_the_labels_of_the_library(labels):
    estimator = DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, labels[TWO.astype(int)])
    model = loaded(estimator, outputs=[OutputKind.PROBABILITY])
    columns = {f"f{number}": X[:, number] for number in range(3)}
    found = predictions.predict(Bundle((model,)), columns, predictions.by_reference)
    assert list(found) == ["m", "m[0]", "m[1]"]
    assert found["m"].tolist() == estimator.predict(X).tolist()
    assert type(found["m"][0]) is type(estimator.predict(X).tolist()[0])
    assert np.array_equal(found["m[1]"], estimator.predict_proba(X)[:, 1])


def test_labels_of_a_table_are_quoted_where_they_need_it():
    labels = np.array(['a,"b"', True, 3, np.nan], object)
    text = predictions.table_text({"m": labels, "n": np.array([0.1, 1, 2, 3])})
    assert text == 'm,n\n"a,""b""",0.10000000000000001\nTrue,1\n3,2\nnan,3\n'


@pytest.mark.parametrize("label", ["*)", "(*", "]]>", "]]\\>", "ä", "a\nb", "{{ x }}", "$'", "<!--", "\x00", "x" * 500])
def test_no_label_ends_a_comment_or_adds_a_line(label):
    text = label_text(label)
    assert text.isascii() and text.isprintable() and len(text) < 300
    assert not any(mark in text for mark in ("*)", "(*", "]]>", "{", "}", "<", ">", "$"))


def test_hostile_labels_compile_and_each_has_a_name_of_its_own(tmp_path):
    labels = ["*) END_FUNCTION_BLOCK (*", "]]></Declaration>", "if", "IF", "a b", "a_b", "", "ü", "1", "-1", "True"]
    labels += ["SEL", "gt", "DT", "DINT_TO_LREAL", "TO_INT", "TON"]
    y = np.array(labels)[np.arange(len(X)) % len(labels)]
    model = loaded(DecisionTreeClassifier(max_depth=4, random_state=0).fit(X, y))
    names = [value.name.lower() for value in class_type(model.ir).values]
    assert len(set(names)) == len(labels) and all(name.isidentifier() and name.isascii() for name in names)
    for target in ("iec", "twincat", "plcopen"):
        verified(model, tmp_path, target, rows=200)


@pytest.mark.parametrize(("labels", "kinds"), [((), ("class",)), ((1, 1), ("class",)), ((1, 2), ("decision",))])
def test_classes_that_cannot_be_are_refused(labels, kinds):
    with pytest.raises(InputError):
        Classes(labels, tuple(map(OutputKind, kinds)))


def test_the_command_line_writes_verifies_and_predicts_labels(tmp_path, capsys):
    skops_io = pytest.importorskip("skops.io")
    from tests.cli.helpers import run

    models = tmp_path / "models"
    models.mkdir()
    skops_io.dump(DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, WORDS), models / "parts.skops")
    out = str(tmp_path / "out")
    assert run(str(models), "--out", out, "--outputs", "class,probability") == 0
    assert run("verify", str(models), "--generated", out, "--rows", "300") == 0
    (tmp_path / "x.csv").write_text("f0,f1,f2\n" + "\n".join(",".join(map(str, row)) for row in X[:5]) + "\n")
    assert run("predict", str(models), "--input", str(tmp_path / "x.csv"), "--output", str(tmp_path / "y.csv")) == 0
    lines = (tmp_path / "y.csv").read_text().splitlines()
    assert lines[0] == "parts" and set(lines[1:]) <= {f'"{word}"' if "," in word else word for word in set(WORDS)}


def test_the_configuration_says_what_single_classifiers_give(tmp_path):
    skops_io = pytest.importorskip("skops.io")
    for name in ("parts", "others"):
        skops_io.dump(DecisionTreeClassifier(max_depth=2, random_state=0).fit(X, TWO), tmp_path / f"{name}.skops")
    file = tmp_path / "st-codegen.toml"
    file.write_text('[[model]]\nfile = "parts.skops"\nname = "Worn"\ngives = ["class", "probability"]\n')
    models = {model.ir.name: model.ir.outputs for model in load(tmp_path).models}
    assert models == {"Worn": ("class", "probability of class 0", "probability of class 1"), "others": ("class",)}
    file.write_text('[[model]]\nfile = "parts.skops"\ngives = ["shade"]\n')
    with pytest.raises(InputError, match=r"gives = 'shade'; known are class, probability, decision"):
        load(tmp_path)
    file.unlink()
    (tmp_path / "bundle.toml").write_text('[outputs]\nparts = ["class"]\n')  # what describes a bundle has no such table
    with pytest.raises(InputError, match="outputs"):
        load(tmp_path)
