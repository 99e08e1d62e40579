"""Classifiers of ONNX: onnxruntime's label on every row on which rounding leaves one, its scores within their bound."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import TensorProto, helper
from sklearn.base import clone
from sklearn.calibration import CalibratedClassifierCV
from sklearn.cluster import KMeans
from sklearn.ensemble import GradientBoostingClassifier, RandomForestClassifier
from sklearn.linear_model import LogisticRegression, Perceptron, RidgeClassifier
from sklearn.multiclass import OneVsRestClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC, LinearSVC

from st_codegen.driver import generate
from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import OutputKind, reference
from st_codegen.project.bundle import Bundle
from st_codegen.proof.bounds import difference_bound
from tests.classifiers import loaded as with_all_outputs
from tests.classifiers import verified
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, FLOAT, INT64, Branch, Leaf, constant, graph_model, info, leaf, ml

pytestmark = pytest.mark.usefixtures("tried_in_place")

TRANSFORMS = ("NONE", "LOGISTIC", "SOFTMAX")
NUMBERS, TEXTS = (7, 3, 5, -1), ("good", "*) bad", "ünsure", "2")


def agree(loaded, x):
    """Labels are equal but where the bound leaves them open, numbers within their bound; the rows that are open."""
    x = np.asarray(x, np.float64)
    x = x[reference.valid_rows(loaded.ir, x)]
    library, ours, bound = loaded.predict(x), reference.evaluate(loaded.ir, x), difference_bound(loaded.ir, x)
    finite = np.all(np.isfinite(ours), axis=1)
    assert np.mean(finite) > 0.5
    difference = np.abs(ours - library)[finite]
    assert np.all(difference <= bound[finite]), (difference.max(axis=0), bound[finite].max(axis=0))
    return np.flatnonzero(bound[:, 0] > 0)


def kinds(loaded):
    return [kind.value for kind in dict.fromkeys(loaded.ir.classes.kinds)]


LEAVES = {
    "all": lambda rng, n, draw: Leaf(dict(enumerate(draw(rng, n)))),
    "first": lambda rng, n, draw: Leaf({0: draw(rng, 1)[0]}),
    "last": lambda rng, n, draw: Leaf({n - 1: draw(rng, 1)[0]}),
}
DRAWS = {
    "positive": lambda rng, n: (rng.integers(0, 9, n) / 16).tolist(),
    "mixed": lambda rng, n: (rng.integers(-8, 9, n) / 8).tolist(),
}


@pytest.mark.parametrize("seed", range(72))
def test_tree_classifiers(tmp_path, seed):
    """Equal to the bit with NaN, infinities, thresholds and their neighbours; ties are common."""
    rng = np.random.default_rng(seed)
    n = (2, 2, 3, 4)[seed % 4]
    given = "all" if n > 2 else ("all", "first", "last")[seed % 3]
    draw = DRAWS[("positive", "mixed")[seed // 2 % 2]]
    transform, elem_type = TRANSFORMS[seed // 4 % 3], (FLOAT, DOUBLE)[seed // 3 % 2]
    labels = (NUMBERS if seed % 5 else TEXTS)[:n]
    values = [0.1, -1.5, 0.0, 2.0]
    trees = [
        build.random_tree(
            rng, ("LEQ", "LT", "GT"), values, 4, n_features=2, weights=lambda r: LEAVES[given](r, n, draw)
        )
        for _ in range(int(rng.integers(1, 6)))
    ]
    base = [None, (0.25, -0.5, 1.0, 0.125)[:n], (0.5,) if n == 2 else None][seed // 7 % 3]
    options = {"post_transform": transform} | ({} if base is None else {"base_values": base})
    model = build.classifier(
        trees, labels, n_features=2, elem_type=elem_type, zipped=bool(seed % 2), ml_opset=1 + 2 * (seed % 2), **options
    )
    loaded = build.load(model, tmp_path)
    assert not agree(loaded, build.special_rows(2, values, rng)).size
    assert loaded.ir.accepts_nan
    assert set(loaded.ir.classes.labels) <= {*labels, 0, 1}


@pytest.mark.parametrize("seed", range(12))
def test_two_classes_by_weights_of_many_digits(tmp_path, seed):
    """What the other class has is 1 less the score: of double numbers, before it is rounded to float."""
    rng = np.random.default_rng(seed)
    digits = lambda r, n: r.uniform(0.01 if seed % 2 else -0.4, 0.4, n).tolist()  # noqa: E731
    trees = [
        build.random_tree(
            rng,
            ("LEQ",),
            [0.1, 0.7],
            3,
            n_features=2,
            weights=lambda r: LEAVES[("first", "last")[seed % 4 // 2]](r, 2, digits),
        )
        for _ in range(7)
    ]
    options = {"post_transform": TRANSFORMS[seed % 3]} | ({"base_values": (0.3,)} if seed > 5 else {})
    for elem_type, tensors in ((FLOAT, False), (DOUBLE, False), (DOUBLE, True)):
        if tensors and "base_values" in options:
            options["base_values_as_tensor"] = constant("base", options.pop("base_values"), np.float64)
        loaded = build.load(
            build.classifier(trees, (0, 1), n_features=2, elem_type=elem_type, tensors=tensors, **options), tmp_path
        )
        agree(loaded, build.special_rows(2, [0.1, 0.7], rng))


def test_classes_to_which_each_tree_gives_alone(tmp_path):
    trees = [
        Branch("LEQ", 0, float(t % 2), Leaf({t % 3: 0.5}), Leaf({t % 3: -0.5 * t}), missing=True) for t in range(6)
    ]
    loaded = build.load(build.classifier(trees, TEXTS[:3]), tmp_path)
    assert loaded.ir.exact
    assert not agree(loaded, build.special_rows(1, [0.0, 1.0], np.random.default_rng(0))).size


def test_two_labels_that_are_no_zero_and_one(tmp_path):
    """With weights of both classes onnxruntime answers 0 and 1, and so does the block."""
    tree = Branch("LEQ", 0, 0.0, leaf(0.75, 0.25), leaf(1.0, 0.0))
    loaded = build.load(build.classifier([tree], (5, 7)), tmp_path)
    assert loaded.ir.classes.labels == (0, 1)
    assert loaded.predict(np.array([[-1.0], [1.0]]))[:, 0].tolist() == [1.0, 0.0]
    assert not agree(loaded, build.special_rows(1, [0.0], np.random.default_rng(0))).size


def test_tree_classifiers_with_double_thresholds(tmp_path):
    tree = Branch("LT", 0, 0.1, Leaf({0: 0.1}), Leaf({0: 1 / 3}))
    model = build.classifier([tree, tree, tree], (0, 1), elem_type=DOUBLE, tensors=True)
    x = np.nextafter([0.1, 0.1, 0.1], [-1.0, 0.1, 1.0])[:, None]
    loaded = build.load(model, tmp_path)
    assert not agree(loaded, x).size
    assert loaded.predict(x)[:, 0].tolist() == [0.0, 1.0, 1.0]


def linear(labels, weights, bias, **options):
    weights = np.asarray(weights)
    model = ml("LinearClassifier", weights.shape[1], coefficients=np.ravel(weights), intercepts=list(bias), **options)
    return build.with_labels(model, labels, "classlabels_ints", zipped=len(labels) == max(len(bias), 2))


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize(("labels", "targets"), [(TEXTS, 4), (NUMBERS[:2], 2), (TEXTS[:2], 1), (NUMBERS[:2], 1)])
@pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE])
def test_linear_classifiers(tmp_path, labels, targets, transform, elem_type):
    rng = np.random.default_rng(targets)
    weights, bias = rng.normal(size=(targets, 3)).astype(np.float32), rng.normal(size=targets).astype(np.float32)
    loaded = build.load(linear(labels, weights, bias, post_transform=transform, elem_type=elem_type), tmp_path)
    x = np.vstack([build.rows(3), build.special_rows(3, [0.0, 1.0], rng)])
    assert agree(loaded, x[np.all(np.abs(x) < 1e6, axis=1)]).size < 30


def test_scores_that_are_equal(tmp_path):
    """The first of two equal ones; the bound knows that it may be the other one only where sums are not exact."""
    loaded = build.load(linear((4, 5, 6), [[0.0], [1.0], [1.0]], [0.0, 0.0, 0.0]), tmp_path)
    x = np.array([[1.0], [-1.0], [0.0], [3.5]])
    assert loaded.predict(x)[:, 0].tolist() == reference.evaluate(loaded.ir, x)[:, 0].tolist() == [1, 0, 0, 1]


def machine(rng, labels, kernel, per_class, positive=False, prob=False, **options):
    n, total = len(labels), sum(per_class)
    draw = rng.random if positive else rng.normal
    values = {
        "kernel_type": kernel,
        "kernel_params": [0.3, 0.5, 3.0],
        "vectors_per_class": per_class,
        "support_vectors": rng.normal(size=3 * total).astype(np.float32),
        "coefficients": draw(size=(n - 1) * total if total else 3 * n).astype(np.float32),
        "rho": rng.normal(size=n * (n - 1) // 2).astype(np.float32),
    }
    if prob:
        values |= {name: rng.normal(size=len(values["rho"])) for name in ("prob_a", "prob_b")}
    model = ml("SVMClassifier", 3, **{k: v for k, v in values.items() if len(v)}, **options)
    return build.with_labels(model, labels, "classlabels_ints")


@pytest.mark.parametrize("kernel", ["LINEAR", "POLY", "RBF", "SIGMOID"])
@pytest.mark.parametrize(
    ("labels", "per_class"), [(TEXTS[:2], [2, 3]), (NUMBERS[:3], [1, 0, 4]), (TEXTS, [2, 1, 3, 1])]
)
@pytest.mark.parametrize("transform", TRANSFORMS)
def test_support_vector_classifiers(tmp_path, kernel, labels, per_class, transform):
    rng = np.random.default_rng(len(labels))
    model = machine(rng, labels, kernel, per_class, post_transform=transform, elem_type=DOUBLE)
    assert agree(build.load(model, tmp_path), rng.normal(size=(300, 3))).size < 30


@pytest.mark.parametrize("elem_type", [INT64, TensorProto.INT32])
@pytest.mark.parametrize("op_type", ["trees", "linear", "machine"])
def test_integers_are_rounded_to_float32_by_classifiers(tmp_path, op_type, elem_type):
    """A tree compares 2**24 + 1, which is no number of float32, with 2**24."""
    rng = np.random.default_rng(3)
    tree = Branch("LEQ", 0, 2.0**24, Branch("LT", 2, 0.5, leaf(0.25, 0.75), leaf(1.0, 0.5)), leaf(0.5, 0.625))
    model = {
        "trees": lambda: build.classifier([tree, tree], (5, 9), n_features=3, elem_type=elem_type),
        "linear": lambda: linear((5, 9), [[0.5, -1.5, 3.0]], [0.1], elem_type=elem_type),
        "machine": lambda: machine(rng, (5, 9, 2), "RBF", [1, 2, 1], elem_type=elem_type),
    }[op_type]()
    large = 2**24 + np.arange(-3, 5)
    x = np.vstack([rng.integers(-6, 7, (200, 3)), rng.permuted(np.column_stack([large, -large, large % 3]), axis=1)])
    x = x + rng.choice([0.0, 0.5, 0.9375], x.shape)  # the fractions are cut off
    loaded = build.load(model, tmp_path)
    assert agree(loaded, x).size < (12 if op_type == "machine" else 5)
    if op_type == "trees":
        assert loaded.predict(np.array([[2.0**24 + 1, 0.0, 0.0], [2.0**24 + 2, 0.0, 0.0]]))[:, 1].tolist() == [0.5, 1.0]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("positive", [False, True])
def test_machines_without_support_vectors(tmp_path, seed, positive):
    rng = np.random.default_rng(seed)
    labels = (NUMBERS[:2], TEXTS[:2], NUMBERS[:3])[seed % 3]
    loaded = build.load(machine(rng, labels, "RBF", [], positive, prob=seed > 2 and len(labels) == 2), tmp_path)
    assert agree(loaded, np.vstack([rng.normal(size=(300, 3)), np.zeros((1, 3)), -np.ones((1, 3))])).size < 30


def test_coupled_probabilities_are_left_out_with_a_note(tmp_path):
    rng = np.random.default_rng(3)
    loaded = build.load(machine(rng, TEXTS[:3], "RBF", [2, 2, 2], prob=True), tmp_path)
    assert kinds(loaded) == ["class"]
    assert any("probabilities are left out" in note for note in loaded.ir.source.notes)
    assert agree(loaded, rng.normal(size=(200, 3))).size < 20
    model = machine(rng, TEXTS[:3], "RBF", [2, 2, 2], prob=True)
    del model.graph.output[0]
    with pytest.raises(InputError, match="no outputs that are compiled; probabilities are left out"):
        build.load(model, tmp_path)


def network(*ends, outputs, constants=(), opset=18):
    nodes = [helper.make_node("MatMul", ["X", "W"], ["S"]), *ends]
    weights = constant("W", np.random.default_rng(5).normal(size=(3, 4)))
    return graph_model(nodes, [info("X", (None, 3))], outputs, [weights, *constants], opset)


@pytest.mark.parametrize("op_type", ["ArgMax", "ArgMin"])
@pytest.mark.parametrize("last", [0, 1])
@pytest.mark.parametrize("keepdims", [0, 1])
def test_the_number_of_the_largest_and_of_the_smallest(tmp_path, op_type, last, keepdims):
    end = helper.make_node(op_type, ["S"], ["Y"], axis=1, keepdims=keepdims, select_last_index=last)
    loaded = build.load(network(end, outputs=[info("Y", None, INT64)]), tmp_path)
    assert loaded.ir.classes.labels == (0, 1, 2, 3)
    x = np.random.default_rng(6).normal(size=(300, 3))
    assert agree(loaded, x).size < 10
    ties = np.zeros((1, 3))
    assert loaded.predict(ties)[0, 0] == reference.evaluate(loaded.ir, ties)[0, 0] == (3 if last else 0)


@pytest.mark.parametrize("op_type", ["ArgMax", "ArgMin"])
def test_the_axis_of_the_columns_is_kept_as_one_number(tmp_path, op_type):
    """Squeeze drops no axis of another length."""
    ends = [helper.make_node(op_type, ["S"], ["I"], axis=1), helper.make_node("Squeeze", ["I", "axes"], ["Y"])]
    model = network(*ends, outputs=[info("Y", None, INT64)], constants=[constant("axes", [1], np.int64)])
    assert agree(build.load(model, tmp_path), np.random.default_rng(6).normal(size=(300, 3))).size < 10


@pytest.mark.parametrize("labels", [("a", "b", "*) c", "d"), (10, 20, 30, 40)])
@pytest.mark.parametrize("pick", ["ArrayFeatureExtractor", "Gather"])
def test_labels_picked_from_a_constant_list(tmp_path, labels, pick):
    texts = isinstance(labels[0], str)
    kind = TensorProto.STRING if texts else INT64
    listed = helper.make_tensor("L", kind, [4], [label.encode() if texts else label for label in labels])
    nodes = [
        helper.make_node("Softmax", ["S"], ["P"], axis=1),
        helper.make_node("ArgMax", ["P"], ["I"], axis=1),
        helper.make_node(pick, ["L", "I"], ["picked"], domain="" if pick == "Gather" else "ai.onnx.ml"),
        helper.make_node("Reshape", ["picked", "one"], ["flat"]),
        helper.make_node("Cast", ["flat"], ["Y"], to=kind),
    ]
    outputs = [info("Y", None, kind), info("P", None), info("S", None)]
    model = network(*nodes, outputs=outputs, constants=[listed, constant("one", [-1], np.int64)])
    loaded = build.load(model, tmp_path)
    assert loaded.ir.classes.labels == labels
    assert kinds(loaded) == ["class", "probability", "decision"]
    assert agree(loaded, np.random.default_rng(7).normal(size=(300, 3))).size < 10


@pytest.mark.parametrize("op_type", ["Softmax", "LogSoftmax"])
@pytest.mark.parametrize("opset", [9, 11, 18])
def test_a_graph_that_ends_with_softmax_is_a_classifier(tmp_path, op_type, opset):
    loaded = build.load(
        network(helper.make_node(op_type, ["S"], ["Y"]), outputs=[info("Y", None)], opset=opset), tmp_path
    )
    assert loaded.ir.classes.labels == (0, 1, 2, 3)
    assert kinds(loaded) == ["class", "probability" if op_type == "Softmax" else "decision"]
    rng = np.random.default_rng(8)
    for spread in (1.0, 30.0, 1e4):
        assert agree(loaded, rng.normal(size=(200, 3)) * spread).size < 40


def test_softmax_in_double_and_of_scores_far_apart(tmp_path):
    for op_type in ("Softmax", "LogSoftmax"):
        loaded = build.load(build.single(op_type, 3, elem_type=DOUBLE), tmp_path)
        agree(loaded, np.random.default_rng(9).normal(size=(200, 3)) * 300.0)
        assert np.isfinite(reference.evaluate(loaded.ir, np.array([[1e300, -1e300, 0.0]]))).all()


def test_from_the_file_to_verified_text(tmp_path):
    labels = ("good", "*) ]]> bad", "ungenau, schlecht")
    trees = [
        Branch("LEQ", number % 2, 0.5 * number, leaf(0.5, 0.25, 0.25), leaf(0.0, 0.5, 0.5), missing=number > 1)
        for number in range(5)
    ]
    model = build.load(build.classifier(trees, labels, n_features=2, zipped=True), tmp_path)
    for target in ("twincat", "iec"):
        report = verified(with_all_outputs(model), tmp_path / target, target)
        assert report.exact and report.open_rows == 0
    net = build.load(network(helper.make_node("LogSoftmax", ["S"], ["Y"]), outputs=[info("Y", None)]), tmp_path)
    assert verified(with_all_outputs(net), tmp_path / "net").open_rows < 100
    generate(Bundle((with_all_outputs(model, {OutputKind.CLASS}),)), "iec", tmp_path / "class")


EXPORTED = {
    "forest": RandomForestClassifier(5, max_depth=4, random_state=0),
    "boosting": GradientBoostingClassifier(n_estimators=6, max_depth=2, random_state=0),
    "logistic": make_pipeline(StandardScaler(), LogisticRegression()),
    "perceptron": Perceptron(random_state=0),
    "network": MLPClassifier((4,), max_iter=60, early_stopping=True, random_state=0),
    "support vectors": SVC(),
    "linear machine": LinearSVC(random_state=0),
    "ridge": RidgeClassifier(),
    "bayes": GaussianNB(),
    "one against the rest": OneVsRestClassifier(LogisticRegression()),
    "calibrated": CalibratedClassifierCV(LinearSVC(random_state=0), cv=2),
}


@pytest.mark.parametrize("name", EXPORTED)
@pytest.mark.parametrize("labels", [(5, 7), ("a", "b", "c")])
def test_classifiers_as_skl2onnx_writes_them(tmp_path, name, labels):
    skl2onnx = pytest.importorskip("skl2onnx")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(150, 3)).astype(np.float32)
    y = np.array(labels)[np.digitize(x[:, 0] + x[:, 1] ** 2, [0.3, 1.2][: len(labels) - 1])]
    estimator = clone(EXPORTED[name]).fit(x, y)
    loaded = build.load(skl2onnx.to_onnx(estimator, x[:1]), tmp_path)
    assert loaded.ir.classes.labels == labels
    assert agree(loaded, np.vstack([x, rng.normal(size=(200, 3)) * 3])).size < 10
    assert loaded.ir.exact == (name == "forest")
    if name in ("forest", "boosting", "logistic", "network"):
        assert kinds(loaded) == ["class", "probability"]


def test_clusters_as_skl2onnx_writes_them(tmp_path):
    """The square of a distance as a sum to which computed numbers are added, the smallest, and its root."""
    skl2onnx = pytest.importorskip("skl2onnx")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(150, 3)).astype(np.float32)
    loaded = build.load(skl2onnx.to_onnx(KMeans(4, n_init=1, random_state=0).fit(x), x[:1]), tmp_path)
    assert loaded.ir.classes.labels == (0, 1, 2, 3)
    assert kinds(loaded) == ["class", "decision"]
    assert agree(loaded, np.vstack([x, rng.normal(size=(200, 3)) * 3])).size < 10


REFUSED = {
    "post_transform PROBIT: known are NONE, LOGISTIC and SOFTMAX": {"post_transform": "PROBIT"},
    "SOFTMAX_ZERO divides zero by zero": {"post_transform": "SOFTMAX_ZERO"},
    "base_values has 3 entries, expected 0 or 1 or 2": {"base_values": [1.0, 2.0, 3.0]},
    "class_ids\\[0\\] is 9, expected 0 to 1": {"changes": {"target_ids": [9, 0]}},
}


@pytest.mark.parametrize("message", REFUSED)
def test_tree_classifiers_that_are_refused(tmp_path, message):
    tree = Branch("LEQ", 0, 0.0, Leaf({0: 1.0}), Leaf({0: 2.0}))
    with pytest.raises(InputError, match=message):
        build.load(build.classifier([tree], (0, 1), **REFUSED[message]), tmp_path)


def test_leaves_that_set_some_labels_only(tmp_path):
    some = Branch("LEQ", 0, 0.0, Leaf({0: -1.0}), Leaf({1: 2.0}))
    with pytest.raises(UnsupportedModelError, match="label 1 is set by some leaves only"):
        build.load(build.classifier([some], (0, 1)), tmp_path)
    with pytest.raises(UnsupportedModelError, match="label 'good' is not set by all leaves of any tree"):
        build.load(build.classifier([some], TEXTS[:3]), tmp_path)
    with pytest.raises(UnsupportedModelError, match="1 label, a classifier has two or more"):
        build.load(build.classifier([Branch("LEQ", 0, 0.0, leaf(1.0), leaf(2.0))], (3,)), tmp_path)
    positive = Branch("LEQ", 0, 0.0, Leaf({0: 1.0}), Leaf({1: 2.0}))
    x = build.special_rows(1, [0.0], np.random.default_rng(0))
    assert not agree(build.load(build.classifier([positive], TEXTS[:3]), tmp_path), x).size
    assert not agree(build.load(build.classifier([some], TEXTS[:3], base_values=[0.0, 0.5, -0.25]), tmp_path), x).size


def test_what_labels_cannot_be_used_for(tmp_path):
    ends = {
        "reads integers; cast them to float": helper.make_node("Neg", ["I"], ["Y"]),
        "casts labels between text and numbers": helper.make_node("Cast", ["I"], ["Y"], to=TensorProto.STRING),
        "can be picked from": helper.make_node("Gather", ["X", "I"], ["Y"]),
    }
    first = helper.make_node("ArgMax", ["S"], ["I"], axis=1)
    for message, end in ends.items():
        with pytest.raises(UnsupportedModelError, match=message):
            build.load(network(first, end, outputs=[info("Y", None, INT64)]), tmp_path)
    with pytest.raises(UnsupportedModelError, match="several outputs are labels: I, J"):
        second = helper.make_node("ArgMin", ["S"], ["J"], axis=1)
        build.load(network(first, second, outputs=[info("I", None, INT64), info("J", None, INT64)]), tmp_path)
