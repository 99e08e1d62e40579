"""Models as skl2onnx writes them: trees equal to the bit, the others within their bound."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import helper, numpy_helper
from sklearn.calibration import CalibratedClassifierCV
from sklearn.compose import ColumnTransformer
from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis
from sklearn.ensemble import (
    AdaBoostClassifier,
    AdaBoostRegressor,
    BaggingRegressor,
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingRegressor,
    IsolationForest,
    RandomForestRegressor,
    StackingRegressor,
    VotingRegressor,
)
from sklearn.feature_selection import SelectKBest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.linear_model import Lasso, LinearRegression, LogisticRegression, Ridge, SGDOneClassSVM
from sklearn.multioutput import MultiOutputClassifier
from sklearn.naive_bayes import BernoulliNB, CategoricalNB
from sklearn.neighbors import KNeighborsClassifier, KNeighborsRegressor, LocalOutlierFactor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    KBinsDiscretizer,
    MaxAbsScaler,
    MinMaxScaler,
    Normalizer,
    OneHotEncoder,
    OrdinalEncoder,
    PolynomialFeatures,
    PowerTransformer,
    RobustScaler,
    StandardScaler,
)
from sklearn.svm import SVR, LinearSVR, NuSVR, OneClassSVM
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor, ExtraTreeRegressor

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import TreeEnsemble, reference
from st_codegen.proof.bounds import difference_bound
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import assert_equal_bits, assert_within_bound

skl2onnx = pytest.importorskip("skl2onnx")
from skl2onnx.common.data_types import (  # noqa: E402
    DoubleTensorType,
    FloatTensorType,
    Int64TensorType,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.usefixtures("tried_in_place"),
]
RNG = np.random.default_rng(0)
X = RNG.uniform(-2, 2, size=(300, 3)).astype(np.float32)
Y = np.column_stack([X[:, 0] * X[:, 1] + np.sin(3 * X[:, 2]), X[:, 1] ** 2 - X[:, 0]])
SINGLE = Y[:, 0]
ROWS = np.vstack([RNG.uniform(-3, 3, size=(200, 3)), X[:50].astype(np.float64)])


def seeded(kind, *arguments, **keywords):
    return kind(*arguments, random_state=0, **keywords)


def stack(*steps):
    return make_pipeline(ColumnTransformer([("s", StandardScaler(), [2, 0]), ("m", MinMaxScaler(), [1])]), *steps)


TREES = {
    "decision tree": seeded(DecisionTreeRegressor, max_depth=8),
    "extra tree": seeded(ExtraTreeRegressor, max_depth=8),
    "random forest": seeded(RandomForestRegressor, n_estimators=30, max_depth=6),
    "extra trees": seeded(ExtraTreesRegressor, n_estimators=30, max_depth=6),
    "gradient boosting": seeded(GradientBoostingRegressor, n_estimators=40, max_depth=3),
    "histogram gradient boosting": seeded(HistGradientBoostingRegressor, max_iter=40, max_leaf_nodes=15),
    "scaled tree": make_pipeline(RobustScaler(), seeded(DecisionTreeRegressor, max_depth=5)),
    "columns": stack(seeded(GradientBoostingRegressor, n_estimators=20)),
}
OTHERS = {
    "svr": SVR(),
    "svr poly": NuSVR(kernel="poly"),
    "svr linear": SVR(kernel="linear"),
    "svr sigmoid": SVR(kernel="sigmoid", C=0.01),
    "linear svr": seeded(LinearSVR, max_iter=10000),
    **{
        f"mlp {name}": seeded(
            MLPRegressor, hidden_layer_sizes=(15, 7), activation=name, max_iter=80, early_stopping=True
        )
        for name in ("tanh", "relu", "logistic", "identity")
    },
    "linear": LinearRegression(),
    "ridge": Ridge(),
    "lasso": Lasso(0.01),
    "standard": make_pipeline(StandardScaler(), LinearRegression()),
    "min max": make_pipeline(MinMaxScaler(), LinearRegression()),
    "min max clipped": make_pipeline(MinMaxScaler(clip=True), LinearRegression()),
    "max abs": make_pipeline(MaxAbsScaler(), LinearRegression()),
    "function": make_pipeline(FunctionTransformer(), LinearRegression()),
    "columns linear": stack(LinearRegression()),
    "normalized": make_pipeline(Normalizer(), LinearRegression()),
    "normalized l1": make_pipeline(Normalizer("l1"), LinearRegression()),
    "normalized max": make_pipeline(Normalizer("max"), LinearRegression()),
    "vote": VotingRegressor([("a", LinearRegression()), ("b", seeded(DecisionTreeRegressor, max_depth=3))]),
    "bag": seeded(BaggingRegressor, seeded(DecisionTreeRegressor, max_depth=3), 3),
    "stack": StackingRegressor([("a", LinearRegression()), ("b", seeded(DecisionTreeRegressor, max_depth=3))]),
}
#: These keep training rows: a Scan over them, and what belongs to the nearest.
NEAREST = {
    "nearest": KNeighborsRegressor(4),
    "nearest weighted": KNeighborsRegressor(4, weights="distance"),
    "nearest Manhattan": KNeighborsRegressor(4, p=1),
    "process": GaussianProcessRegressor(2.0 * RBF(1.5) + WhiteKernel(0.1), optimizer=None),
}
#: These give columns.
COLUMNS = {
    "bins": KBinsDiscretizer(4, encode="ordinal"),
    "squares": PolynomialFeatures(2),
    "cubes": PolynomialFeatures(3, interaction_only=True, include_bias=False),
}
TWO_OUTPUTS = {
    "decision tree": seeded(DecisionTreeRegressor, max_depth=6),
    "random forest": seeded(RandomForestRegressor, n_estimators=10, max_depth=5),
    "linear": LinearRegression(),
    "mlp": seeded(MLPRegressor, hidden_layer_sizes=(10,), max_iter=60),
}


def export(model, tensor_type=FloatTensorType, target_opset=None):
    initial = [("X", tensor_type([None, 3]))]
    return skl2onnx.convert_sklearn(model, initial_types=initial, target_opset=target_opset)


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("target_opset", [None, {"": 15, "ai.onnx.ml": 3}])
def test_tree_families_are_equal_to_the_bit(tmp_path, name, target_opset):
    model = TREES[name].fit(X, SINGLE)
    loaded = build.load(export(model, target_opset=target_opset), tmp_path)
    op = loaded.ir.ops[-1]
    assert isinstance(op, TreeEnsemble)
    build.check_layout(op)
    thresholds = op.threshold[op.split >= 0]
    assert_equal_bits(loaded, build.special_rows(3, thresholds[:200], np.random.default_rng(1), n=800))
    assert_equal_bits(loaded, ROWS)
    np.testing.assert_allclose(loaded.predict(X.astype(np.float64))[:, 0], model.predict(X), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", OTHERS)
def test_other_families_stay_within_their_bound(tmp_path, name):
    model = OTHERS[name].fit(X, SINGLE)
    loaded = build.load(export(model), tmp_path)
    assert_within_bound(loaded, ROWS)
    if name != "normalized max":  # ONNX divides by the largest number, scikit-learn by the largest magnitude
        ours = reference.evaluate(loaded.ir, X.astype(np.float64))[:, 0]
        np.testing.assert_allclose(ours, model.predict(X), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["linear", "linear svr", "mlp tanh", "mlp relu", "standard", "min max clipped"])
def test_double_graphs_stay_within_their_bound(tmp_path, name):
    model = OTHERS[name].fit(X.astype(np.float64), SINGLE)
    loaded = build.load(export(model, DoubleTensorType), tmp_path)
    np.testing.assert_allclose(reference.evaluate(loaded.ir, ROWS)[:, 0], model.predict(ROWS), rtol=1e-11, atol=1e-11)
    assert_within_bound(loaded, ROWS)


@pytest.mark.parametrize("tensor_type", [FloatTensorType, DoubleTensorType])
@pytest.mark.parametrize("name", NEAREST)
def test_models_that_keep_training_rows(tmp_path, name, tensor_type):
    model = NEAREST[name].fit(X[:60], SINGLE[:60])
    loaded = build.load(export(model, tensor_type), tmp_path)
    assert_within_bound(loaded, ROWS)
    near = np.abs(reference.evaluate(loaded.ir, ROWS)[:, 0] - model.predict(ROWS)) < 1e-3
    assert near.mean() > 0.98 or "weighted" in name  # the exporter weights all of the nearest alike


@pytest.mark.parametrize("tensor_type", [FloatTensorType, DoubleTensorType])
@pytest.mark.parametrize("name", ["nearest", "process"])
def test_distances_by_an_operator_of_onnxruntime(tmp_path, name, tensor_type):
    """`optim='cdist'` of the exporter: distances by products, whose digits cancel near a training row."""
    model = NEAREST[name].fit(X[:60], SINGLE[:60])
    exported = skl2onnx.convert_sklearn(
        model, initial_types=[("X", tensor_type([None, 3]))], options={id(model): {"optim": "cdist"}}
    )
    assert "CDist" in {node.op_type for node in exported.graph.node}
    loaded = build.load(exported, tmp_path)
    assert_within_bound(loaded, ROWS)
    if tensor_type is DoubleTensorType:
        np.testing.assert_allclose(reference.evaluate(loaded.ir, ROWS)[:, 0], model.predict(ROWS), rtol=1e-5, atol=1e-5)


def test_a_distance_that_onnxruntime_does_not_know(tmp_path):
    model = KNeighborsRegressor(3, metric="manhattan").fit(X[:60], SINGLE[:60])
    exported = skl2onnx.to_onnx(model, X[:1], options={id(model): {"optim": "cdist"}})
    with pytest.raises(UnsupportedModelError, match="the metric manhattan, which onnxruntime refuses; skl2onnx writes"):
        build.load(exported, tmp_path)


@pytest.mark.parametrize("name", ["scaler", "shares"])
def test_integers_are_rounded_to_float32_by_scalers(tmp_path, name):
    large = 2**24 + np.arange(-3, 5)
    x = np.column_stack([large, -large, large % 3])
    model = {"scaler": MaxAbsScaler(), "shares": Normalizer("l1")}[name].fit(x)
    exported = skl2onnx.convert_sklearn(model, initial_types=[("X", Int64TensorType([None, 3]))])
    loaded = build.load(exported, tmp_path)
    assert assert_equal_bits(loaded, x + 0.5).shape == (8, 3)  # the fractions are cut off
    assert "integer inputs are read without fractions that they may have: X" in loaded.ir.source.notes


@pytest.mark.parametrize("labels", [np.array(["low", "middle", "high"]), np.arange(3)])
def test_a_list_of_the_labels_as_an_output_is_left_out(tmp_path, labels):
    """`output_class_labels=True` of the exporter."""
    model = LogisticRegression().fit(X, labels[np.digitize(SINGLE, [-0.5, 0.8])])
    exported = skl2onnx.to_onnx(model, X[:1], options={id(model): {"zipmap": False, "output_class_labels": True}})
    assert len(exported.graph.output) == 3
    loaded = build.load(exported, tmp_path)
    assert loaded.ir.classes.labels == tuple(model.classes_.tolist())
    assert "the output 'class_labels' is a constant and left out" in loaded.ir.source.notes
    bound = difference_bound(loaded.ir, ROWS)
    assert np.all(np.abs(reference.evaluate(loaded.ir, ROWS) - loaded.predict(ROWS)) <= bound)


@pytest.mark.parametrize("weights", ["uniform", "distance"])
def test_classes_of_the_nearest(tmp_path, weights):
    model = KNeighborsClassifier(5, weights=weights).fit(X[:80], np.digitize(SINGLE[:80], [-0.5, 0.8]))
    loaded = build.load(export(model), tmp_path)
    assert loaded.ir.classes.labels == (0, 1, 2)
    bound = difference_bound(loaded.ir, ROWS)
    assert np.all(np.abs(reference.evaluate(loaded.ir, ROWS) - loaded.predict(ROWS)) <= bound)
    assert np.mean(bound[:200, 0] > 0) < (0.02 if weights == "uniform" else 0.3)  # equal sums of rounded weights
    assert np.mean(loaded.predict(ROWS)[:, 0] == model.predict(ROWS)) > (0.98 if weights == "uniform" else 0.8)


def test_a_graph_of_local_outliers_is_refused_with_the_file_to_take_instead(tmp_path):
    model = LocalOutlierFactor(4, novelty=True).fit(X[:60].astype(np.float64))
    with pytest.raises(UnsupportedModelError, match=r"LocalOutlierFactor as \.skops"):
        build.load(export(model, target_opset={"": 17, "ai.onnx.ml": 3}), tmp_path)


@pytest.mark.parametrize("target_opset", [None, {"": 12, "ai.onnx.ml": 2}])
@pytest.mark.parametrize("count", [1, 2, 30])
def test_weighted_medians_of_boosting(tmp_path, count, target_opset):
    """The weights are added in float32, one after another, so that the very tree is chosen that onnxruntime chooses."""
    model = seeded(AdaBoostRegressor, n_estimators=count).fit(X, SINGLE)
    loaded = build.load(export(model, target_opset=target_opset), tmp_path)
    ours, bound = reference.evaluate(loaded.ir, ROWS), difference_bound(loaded.ir, ROWS)
    np.testing.assert_array_equal(ours, loaded.predict(ROWS))
    assert np.mean(bound == 0) > 0.9
    assert np.mean(np.abs(ours[:, 0] - model.predict(ROWS)) < 1e-5) > 0.95


@pytest.mark.parametrize("change", ["half", "sums", "first", "column"])
def test_medians_that_are_written_otherwise_are_refused(tmp_path, change):
    model = export(seeded(AdaBoostRegressor, n_estimators=4).fit(X, SINGLE))
    if change == "half":
        half = next(tensor for tensor in model.graph.initializer if tensor.name.startswith("half"))
        half.CopyFrom(numpy_helper.from_array(np.float32(0.25), half.name))
    elif change == "sums":
        sums = next(node for node in model.graph.node if node.op_type == "CumSum")
        sums.attribute.append(helper.make_attribute("reverse", 1))
    elif change == "first":
        first = next(node for node in model.graph.node if node.op_type == "ArgMin")
        next(own for own in first.attribute if own.name == "axis").i = 0
    else:
        model.graph.node[-1].input[0] = "negated_labels"
    with pytest.raises(UnsupportedModelError, match=r"sums of what TopK picks, other than|reads what TopK"):
        build.load(model, tmp_path)


@pytest.mark.parametrize("tensor_type", [FloatTensorType, DoubleTensorType])
def test_labels_of_several_outputs(tmp_path, tensor_type):
    """Numbers, as of the trained model; the list of their probabilities is left out."""
    labels = np.column_stack([SINGLE > 0, np.digitize(SINGLE, [-0.5, 0.8]) + 3])
    model = MultiOutputClassifier(LogisticRegression()).fit(X.astype(np.float64), labels)
    loaded = build.load(export(model, tensor_type), tmp_path)
    assert loaded.ir.outputs == ("out1", "out2") and loaded.ir.classes is None
    assert any("probabilities is left out" in note for note in loaded.ir.source.notes)
    ours = reference.evaluate(loaded.ir, ROWS)
    assert np.all(np.abs(ours - loaded.predict(ROWS)) <= difference_bound(loaded.ir, ROWS))
    assert np.mean(ours == model.predict(ROWS)) > 0.99


def test_labels_of_several_outputs_that_are_texts_are_refused(tmp_path):
    labels = np.column_stack([np.where(SINGLE > 0, "worn", "good"), np.where(SINGLE > 0.5, "hot", "cold")])
    model = MultiOutputClassifier(LogisticRegression()).fit(X.astype(np.float64), labels)
    with pytest.raises(UnsupportedModelError, match=r"joins labels that are texts; several labels of a row have to be"):
        build.load(export(model), tmp_path)


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_that_are_equal_to_the_bit(tmp_path, name):
    loaded = build.load(export(COLUMNS[name].fit(X)), tmp_path)
    assert loaded.ir.classes is None
    assert_equal_bits(loaded, ROWS)
    np.testing.assert_allclose(reference.evaluate(loaded.ir, ROWS), COLUMNS[name].transform(ROWS), rtol=1e-5)


@pytest.mark.parametrize("name", TWO_OUTPUTS)
def test_two_outputs(tmp_path, name):
    model = TWO_OUTPUTS[name].fit(X, Y)
    loaded = build.load(export(model), tmp_path)
    assert loaded.ir.outputs == ("out1", "out2")
    np.testing.assert_allclose(reference.evaluate(loaded.ir, X.astype(float)), model.predict(X), rtol=1e-3, atol=1e-3)
    if loaded.ir.exact:
        assert_equal_bits(loaded, ROWS)
    else:
        assert_within_bound(loaded, ROWS)


def test_missing_values_of_histogram_gradient_boosting(tmp_path):
    x = np.where(RNG.random(X.shape) < 0.2, np.nan, X)
    model = seeded(HistGradientBoostingRegressor, max_iter=20).fit(x, SINGLE)
    loaded = build.load(export(model), tmp_path)
    assert loaded.ir.accepts_nan
    assert_equal_bits(loaded, x.astype(np.float64))
    np.testing.assert_allclose(loaded.predict(x.astype(np.float64))[:, 0], model.predict(x), rtol=1e-4, atol=1e-4)


def test_one_input_for_each_column(tmp_path):
    columns = [("speed", FloatTensorType([None, 1])), ("torque", FloatTensorType([None, 1]))]
    columns.append(("gear", Int64TensorType([None, 1])))
    whole = np.column_stack([X[:, :2], np.round(X[:, 2])])
    model = make_pipeline(StandardScaler(), seeded(GradientBoostingRegressor, n_estimators=10)).fit(whole, SINGLE)
    loaded = build.load(skl2onnx.convert_sklearn(model, initial_types=columns), tmp_path)
    assert [feature.name for feature in loaded.ir.features] == ["speed", "torque", "gear"]
    rows = np.column_stack([ROWS[:, :2], np.round(ROWS[:, 2])])
    assert_equal_bits(loaded, rows)


def test_integer_matrix(tmp_path):
    model = TREES["random forest"].fit(np.round(X * 3), SINGLE)
    loaded = build.load(export(model, Int64TensorType), tmp_path)
    assert_equal_bits(loaded, np.round(ROWS * 3))


def test_tree_exports_with_double_inputs_are_refused_with_advice(tmp_path):
    model = TREES["decision tree"].fit(X, SINGLE)
    with pytest.raises(UnsupportedModelError, match=r"'variable' is declared as DOUBLE.*FloatTensorType"):
        build.load(export(model, DoubleTensorType), tmp_path)


#: Whole numbers as categories, and what reads the codes of them.
CODES = np.round(X * 2).astype(np.float32)
UNKNOWN = {"handle_unknown": "use_encoded_value", "unknown_value": -1}
ENCODED = {
    "one column each": OneHotEncoder(handle_unknown="ignore", sparse_output=False),
    "codes": OrdinalEncoder(**UNKNOWN),
    "codes in a tree": make_pipeline(OrdinalEncoder(**UNKNOWN), seeded(DecisionTreeRegressor, max_depth=5)),
    "one column each in a sum": make_pipeline(OneHotEncoder(handle_unknown="ignore"), Ridge()),
    "of one of the columns": make_pipeline(
        ColumnTransformer([("c", OneHotEncoder(handle_unknown="ignore"), [0]), ("n", StandardScaler(), [1, 2])]),
        Ridge(),
    ),
    "bins": make_pipeline(KBinsDiscretizer(4, encode="onehot-dense"), Ridge()),
}


@pytest.mark.parametrize("name", ENCODED)
@pytest.mark.parametrize("tensor_type", [FloatTensorType, Int64TensorType])
def test_categories_that_are_numbers(tmp_path, name, tensor_type):
    if name in ("bins", "of one of the columns") and tensor_type is Int64TensorType:
        return  # skl2onnx casts these to float
    model = ENCODED[name].fit(CODES if tensor_type is FloatTensorType else CODES.astype(np.int64), SINGLE)
    loaded = build.load(export(model, tensor_type), tmp_path)
    x = np.vstack([CODES[:100], CODES[:100] + 6.0, np.full((1, 3), 99.0), np.full((1, 3), -99.0)]).astype(np.float64)
    if name in ("one column each", "codes", "codes in a tree"):
        assert_equal_bits(loaded, np.vstack([x, ROWS]))
    else:
        assert_within_bound(loaded, np.vstack([x, ROWS]))
    ours = reference.evaluate(loaded.ir, CODES.astype(np.float64))
    wanted = model.predict(CODES) if hasattr(model, "predict") else model.transform(CODES)
    np.testing.assert_allclose(ours, np.reshape(wanted, ours.shape), rtol=1e-4, atol=1e-4)


BOOSTED = {
    "two classes": (AdaBoostClassifier(n_estimators=5, random_state=0), [0.0]),
    "three classes": (AdaBoostClassifier(n_estimators=5, random_state=0), [-0.5, 0.8]),
    "three classes of trees": (
        AdaBoostClassifier(DecisionTreeClassifier(max_depth=3), n_estimators=5, random_state=0),
        [-0.5, 0.8],
    ),
}


@pytest.mark.parametrize("name", BOOSTED)
def test_boosted_classifiers(tmp_path, name):
    kind, cuts = BOOSTED[name]
    model = kind.fit(X, np.digitize(SINGLE, cuts))
    loaded = build.load(export(model), tmp_path)
    ours, bound = reference.evaluate(loaded.ir, ROWS), difference_bound(loaded.ir, ROWS)
    assert np.all(np.abs(ours - loaded.predict(ROWS)) <= bound)
    assert np.mean(bound[:, 1:] < 1e-5) > 0.98
    assert np.mean(ours[:, 0] == model.predict(ROWS)) > 0.98


BY_CONSTANTS = {
    "two sides of each number": BernoulliNB(),
    "Gaussian discriminants": QuadraticDiscriminantAnalysis(),
    "isotonic calibration": CalibratedClassifierCV(seeded(LogisticRegression), method="isotonic", cv=2),
    "categories": CategoricalNB(min_categories=8),
}


@pytest.mark.parametrize("cuts", [[0.0], [-0.5, 0.8]], ids=["two classes", "three classes"])
@pytest.mark.parametrize("name", BY_CONSTANTS)
def test_classifiers_by_constants_that_the_graph_computes_and_by_lists(tmp_path, name, cuts):
    """Logarithms and powers of constants were refused, and isotonic calibration was called damaged."""
    codes = name == "categories"
    x = np.abs(np.round(X * 3)).astype(np.float32) if codes else X
    model = BY_CONSTANTS[name].fit(x, np.digitize(SINGLE, cuts))
    loaded = build.load(export(model), tmp_path)
    rows = x.astype(np.float64) if codes else ROWS
    library, ours, bound = loaded.predict(rows), reference.evaluate(loaded.ir, rows), difference_bound(loaded.ir, rows)
    assert np.all(np.abs(ours - library) <= bound)
    assert np.mean(bound[:, 1:] < 1e-4) > 0.95
    if not name.startswith("iso"):  # of the calibrator the graph takes the nearest knot, the library a line between two
        assert np.mean(ours[:, 0] == model.predict(rows)) > 0.98


@pytest.mark.parametrize("model", [OneClassSVM(), SGDOneClassSVM(random_state=0)], ids=["kernels", "sums"])
def test_detectors_give_their_side_beside_the_score(tmp_path, model):
    model = model.fit(X)
    loaded = build.load(export(model), tmp_path)
    assert loaded.ir.outputs == ("out1", "out2")
    assert_within_bound(loaded, ROWS)
    assert np.mean(reference.evaluate(loaded.ir, ROWS)[:, 0] == model.predict(ROWS)) > 0.98


def test_isolation_of_rows(tmp_path):
    model = IsolationForest(n_estimators=10, random_state=0).fit(X)
    loaded = build.load(export(model, target_opset={"": 17, "ai.onnx.ml": 3}), tmp_path)
    assert_within_bound(loaded, ROWS)
    ours = reference.evaluate(loaded.ir, ROWS)
    assert np.mean(ours[:, 0] == model.predict(ROWS)) > 0.98
    np.testing.assert_allclose(ours[:, 1], model.decision_function(ROWS), atol=1e-4)


@pytest.mark.parametrize("method", ["yeo-johnson", "box-cox"])
def test_a_graph_that_imputes_what_it_made_nan_is_refused(tmp_path, method):
    model = make_pipeline(PowerTransformer(method), Ridge()).fit(np.abs(X) + 0.1, SINGLE)
    with pytest.raises(UnsupportedModelError, match=r"in a PowerTransformer.*from a \.skops file"):
        build.load(export(model), tmp_path)


def test_texts_of_a_decision_path_are_refused_by_what_they_are(tmp_path):
    tree = DecisionTreeClassifier(max_depth=2).fit(X, np.median(SINGLE) < SINGLE)
    initial = [("X", FloatTensorType([None, 3]))]
    exported = skl2onnx.convert_sklearn(
        tree, initial_types=initial, options={id(tree): {"decision_path": True, "zipmap": False}}
    )
    with pytest.raises(UnsupportedModelError, match=r"gives texts for numbers.*export the model without that output"):
        build.load(exported, tmp_path)


def test_an_export_that_lost_columns_is_no_damage_of_the_user_s(tmp_path):
    """skl2onnx lets a selection pick from the first of several inputs."""
    model = make_pipeline(SelectKBest(k=2), LogisticRegression()).fit(X, np.median(SINGLE) < SINGLE)
    exported = skl2onnx.convert_sklearn(model, initial_types=[(name, FloatTensorType([None, 1])) for name in "abc"])
    with pytest.raises(
        InputError, match=r"positions outside 0 \.\. 0; .* or its exporter lost columns; compile the nati"
    ):
        build.load(exported, tmp_path)
