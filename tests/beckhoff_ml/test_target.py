"""Model files for TwinCAT's machine learning runtime: what they say, and that they read back as the same models."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import skops.io
from hypothesis import assume, given
from hypothesis import strategies as st
from lxml import etree
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.beckhoff_ml.blocks import engine_limits
from st_codegen.beckhoff_ml.bounds import engine_answers, engine_bound
from st_codegen.beckhoff_ml.engines import engines_of
from st_codegen.beckhoff_ml.model import read_model
from st_codegen.driver import generate
from st_codegen.emit.contents import Contents
from st_codegen.emit.render import render
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import (
    Activation,
    Aggregate,
    Clip,
    Combine,
    Comparison,
    Function,
    Kernel,
    KernelSum,
    Linear,
    Operator,
    OutputKind,
    Precision,
    Scale,
    Select,
    TreeColumn,
    reference,
)
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.monotone import last_on_the_left
from st_codegen.project.bundle import load
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.runner import GeneratedCode
from tests.classifiers import MANY, TWO, WORDS, X, loaded, verified
from tests.examples import examples
from tests.models import VECTORS, W, model, random_trees

TARGET = TARGETS["beckhoff-ml"]
GOLDEN = Path(__file__).resolve().parents[2] / "golden"


def model_files(ir):
    """The model files of one model, by name."""
    files = {file.path: "".join(file.pieces) for file in render(Contents((limit_inputs(ir),)), TARGET)}
    return {Path(path).name: text for path, text in files.items() if path.startswith("Models/")}


def only_file(ir):
    (text,) = model_files(ir).values()
    return text


def rng():
    return np.random.default_rng(8)


def trees(**options):
    return random_trees(rng(), **({"comparison": Comparison.LESS_OR_EQUAL} | options))


def after(op, **changes):
    return dataclasses.replace(op, **changes)


MLP = (
    Linear((0,), W, [0.25, -1.0]),
    Activation((1,), Function.TANH, 2),
    Linear((2,), np.array([[1.5, -0.5]]), [0.125]),
)
SVM = KernelSum((0,), Kernel.RBF, VECTORS, [[1.0, -2.0, 0.5]], [0.1], gamma=0.7)

#: Every kind of model that an engine can say, and what stands before and behind it.
MODELS = {
    "trees": model(trees()),
    "trees below": model(trees(comparison=Comparison.LESS)),
    "trees float32": model(trees(input_precision=Precision.FLOAT32)),
    "trees float32 below": model(trees(comparison=Comparison.LESS, input_precision=Precision.FLOAT32)),
    "trees of XGBoost": model(
        trees(
            comparison=Comparison.LESS, input_precision=Precision.FLOAT32, sum_precision=Precision.FLOAT32, trees=9
        )
    ),
    "averaged": model(trees(divisor=3.0, trees=3)),
    "base last": model(trees(base_last=True)),
    "one leaf": model(trees(splits=0, trees=1)),
    "two outputs": model(trees(outputs=2)),
    "wide leaves": model(trees(outputs=3, wide=True)),
    "trees on some columns": model(Select((0,), [2, 0]), after(trees(features=2), inputs=(1,))),
    "scaled trees": model(
        Scale((0,), Operator.SUBTRACT, [0.1, 0.2, 0.3]),
        Scale((1,), Operator.DIVIDE, [2.0, 3.0, 0.7]),
        after(trees(), inputs=(2,)),
    ),
    "scaled result": model(trees(), Scale((1,), Operator.MULTIPLY, [0.3]), Scale((2,), Operator.ADD, [7.0])),
    "network": model(*MLP),
    "linear": model(Linear((0,), W, [0.25, -1.0])),
    **{
        f"network {function.value}": model(
            Linear((0,), W, [0.25, -1.0]), Activation((1,), function, 2), Linear((2,), np.eye(2), [0.0, 1.0])
        )
        for function in (Function.LOGISTIC, Function.RELU, Function.SOFTPLUS, Function.IDENTITY, Function.TANH)
    },
    "scaled network": model(
        Select((0,), [2, 0, 1]),
        Scale((1,), Operator.SUBTRACT, [0.1, 0.2, 0.3]),
        Scale((2,), Operator.DIVIDE, [2.0, 3.0, 0.7]),
        *(after(op, inputs=(number + 3,)) for number, op in enumerate(MLP)),
        Scale((6,), Operator.MULTIPLY, [4.0]),
        Scale((7,), Operator.SUBTRACT, [1.0], reverse=True),
    ),
    **{
        f"svm {kernel.value}": model(
            KernelSum((0,), kernel, VECTORS, [[1.0, -2.0, 0.5]], [0.1], gamma=0.7, coef0=-0.2, degree=3)
        )
        for kernel in Kernel
    },
    "scaled svm": model(
        Scale((0,), Operator.MULTIPLY, [0.1, 0.2, 0.3]), Scale((1,), Operator.ADD, [1.0, -1.0, 0.5]),
        after(SVM, inputs=(2,)),
    ),
    "svm on some columns": model(
        Select((0,), [2, 0]),
        KernelSum((1,), Kernel.RBF, VECTORS[:, :2], [[1.0, -2.0, 0.5]], [0.1], gamma=0.7),
    ),
    "svm one vector": model(KernelSum((0,), Kernel.RBF, VECTORS[:1], [[1.0]], [0.1])),
    "one input": model(KernelSum((0,), Kernel.RBF, VECTORS[:, :1], [[1.0, -2.0, 0.5]], [0.1]), features=1),
    "svm two outputs": model(KernelSum((0,), Kernel.RBF, VECTORS, [[1.0, -2.0, 0.5], [0.0, 1.0, 1.0]], [0.1, 0.2])),
}  # fmt: skip


def rows_of(ir, count=400):
    x = probe_rows(ir, count)
    return x[engine_answers(ir, x) & np.all(np.isfinite(reference.evaluate(ir, x)), axis=1)]


@pytest.mark.parametrize("name", MODELS)
def test_a_model_reads_back_from_its_file(name):
    """The file's numbers give the same predictions: as its reader evaluates them, and as compiled from the file."""
    ir = limit_inputs(MODELS[name])
    if not engines_of(ir)[0].compares_only:
        ir = dataclasses.replace(ir, magnitude_limits=engine_limits(ir, engines_of(ir)[0]))
    x = rows_of(ir)
    assert len(x) > 100
    files = model_files(ir)
    loaded = [read_model(text.encode(), file, name) for file, text in files.items()]
    direct = np.hstack([one.predict(x) for one in loaded])
    compiled = np.hstack([reference.evaluate(limit_inputs(one.ir), x) for one in loaded])
    expected = reference.evaluate(ir, x)
    bound = engine_bound(ir, x)
    finite = np.all(np.isfinite(bound), axis=1)
    assert finite.mean() > 0.9
    assert np.all(np.abs(direct - expected)[finite] <= bound[finite])
    assert np.all(np.abs(compiled - expected)[finite] <= bound[finite])
    engine = engines_of(ir)[0]
    if engine.folder == "trees":
        assert np.array_equal(direct, compiled)
        assert not np.any(bound) or name in {
            "trees of XGBoost",
            "averaged",
            "base last",
            "scaled trees",
            "scaled result",
        }
    # a wrong weight or threshold would do far more: float32 has seven digits
    assert np.median(bound[np.all(np.abs(x) <= 10.0, axis=1)]) < 1e-4


@pytest.mark.parametrize("name", ["trees", "two outputs", "scaled network", "svm rbf"])
def test_the_text_that_calls_the_runtime_gives_the_files_numbers(name, tmp_path):
    ir = limit_inputs(MODELS[name])
    for file in render(Contents((ir,)), TARGET):
        path = tmp_path / file.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(file.pieces), encoding="utf-8")
    x = probe_rows(ir, 300)
    result = GeneratedCode(tmp_path, TARGET.dialect).run_model("FB_M", x, len(ir.outputs))
    files = model_files(ir)
    direct = np.hstack([read_model(text.encode(), file, "m").predict(x) for file, text in files.items()])
    assert np.array_equal(result.valid, engine_answers(ir, x) & np.all(np.isfinite(direct), axis=1))
    # the order of a float32 sum depends on the number of rows, so a network may differ within its bound
    assert np.all(np.abs(result.values - direct)[result.valid] <= 2 * engine_bound(ir, x)[result.valid])


@pytest.mark.parametrize("damage", ["gone", "damaged", "another"])
def test_a_file_that_cannot_be_read_leaves_the_block_invalid(damage, tmp_path):
    for file in render(Contents((MODELS["network"], dataclasses.replace(MODELS["linear"], name="other"))), TARGET):
        path = tmp_path / file.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(file.pieces), encoding="utf-8")
    path = tmp_path / "Models" / "mlp" / "M.xml"
    code = GeneratedCode(tmp_path, TARGET.dialect)
    assert code.run_model("FB_M", np.zeros((2, 3)), 1).valid.all()
    if damage == "gone":
        path.unlink()
    else:
        path.write_text("<x/>" if damage == "damaged" else (path.parent / "Other.xml").read_text())
    result = code.call("FB_M", {name: np.zeros(2) for name in ("fF0", "fF1", "fF2")}, 2)
    assert not result["bValid"].any()
    assert result["nErrorCode"].all()
    assert list(result["bLoaded"]) == [damage == "another"] * 2
    assert not np.any(result["fOut1"])


@examples()
@given(
    threshold=st.floats(-3e38, 3e38) | st.floats(-1e-37, 1e-37) | st.floats(width=32, allow_nan=False),
    steps=st.integers(-3, 3),
    below=st.booleans(),
    single=st.booleans(),
)
def test_less_or_equal_decides_as_the_library_does(threshold, steps, below, single):
    """Around a threshold, at its float32 neighbours and at the middle between them."""
    if not np.isfinite(threshold):
        threshold = 1.0
    op = trees(
        trees=1,
        splits=1,
        thresholds=np.array([threshold]),
        features=1,
        columns=(TreeColumn(0),),
        comparison=Comparison.LESS if below else Comparison.LESS_OR_EQUAL,
        input_precision=Precision.FLOAT32 if single else Precision.FLOAT64,
    )
    assume((op.split >= 0).any())
    (limit,) = last_on_the_left(op, op.threshold)[op.split >= 0]
    near = [threshold, limit]
    with np.errstate(over="ignore"):
        singles = [np.float32(threshold)]
        singles += [np.nextafter(singles[0], np.float32(end)) for end in (-np.inf, np.inf)]
    near += [float(value) for value in singles]
    near += [(float(singles[0]) + float(value)) / 2 for value in singles[1:]]
    x = np.array([value for value in near if np.isfinite(value)])
    for _ in range(abs(steps)):
        x = np.nextafter(x, np.inf if steps > 0 else -np.inf)
    x = np.concatenate([x, [0.0, -0.0, 1e308, -1e308]])
    with np.errstate(over="ignore"):
        read = x.astype(np.float32).astype(np.float64) if single else x
    usable = np.isfinite(read)
    library = read < threshold if below else read <= threshold
    assert np.array_equal((x <= limit)[usable], library[usable])


def test_all_refusals_are_in_one_message():
    reasons = {
        "category": (model(trees(categorical=[1])), "splits by category"),
        "missing": (
            model(trees(columns=(TreeColumn(0, seen_missing=True), TreeColumn(1)))),
            "splits trained on missing values",
        ),
        "infinite": (model(trees(infinite=True, splits=30)), "splits trained on missing values"),
        "zero": (model(trees(columns=(TreeColumn(0, missing_interval=(0.0, 0.0)),))), "numbers that count as missing"),
        "leaves": (model(trees(linear=True)), "linear models in leaves"),
        "link": (model(trees(), Activation((1,), Function.EXP, 1)), "the result is passed through exp"),
        "clip": (model(Clip((0,), [0.0] * 3, [1.0] * 3), after(SVM, inputs=(1,))), "Clip of the inputs"),
        "elu": (model(MLP[0], Activation((1,), Function.ELU, 2), MLP[2]), "no engine has the activation function elu"),
        "two": (
            model(Select((0,), [0, 1]), Select((0,), [1, 2]), Combine((1, 2), Operator.ADD, 2)),
            "the model has branches",
        ),
        "twice": (model(Select((0,), [0, 0, 1]), after(SVM, inputs=(1,))), "a feature is used twice"),
        "inverse": (
            model(Scale((0,), Operator.DIVIDE, [1.0] * 3, reverse=True), after(SVM, inputs=(1,))),
            "divided by",
        ),
        "scaler": (model(Scale((0,), Operator.ADD, [1.0] * 3)), "only scales its inputs"),
        "largest": (
            model(Scale((0,), Operator.MAXIMUM, [0.0] * 3), after(SVM, inputs=(1,))),
            "a limit of a computed number",
        ),
        "aggregate": (model(dataclasses.replace(trees(), aggregate=Aggregate.MAXIMUM)), "the maximum over trees"),
        "large": (model(Linear((0,), np.full((1, 3), 1e39), [0.0])), "too large for float32"),
    }
    good = dataclasses.replace(MODELS["trees"], name="good")
    models = tuple(dataclasses.replace(ir, name=name) for name, (ir, _) in reasons.items())
    with pytest.raises(UnsupportedModelError, match=f"{len(reasons)} problems") as caught:
        list(render(Contents((good, *models)), TARGET))
    lines = str(caught.value).splitlines()[1:]
    assert "good" not in str(caught.value)
    for line, (name, (_, reason)) in zip(lines, reasons.items(), strict=True):
        assert f"model '{name}'" in line
        assert reason in line


def test_two_models_have_no_file_of_one_name(tmp_path):
    """A model of two outputs has files a_1 and a_2: with a model a_1 one block ran on the other's file."""
    random = np.random.default_rng(0)
    x, y = random.normal(size=(60, 3)), random.normal(size=(60, 2))
    for name, target in (("a", y), ("a_1", y[:, 0])):
        skops.io.dump(DecisionTreeRegressor(max_depth=3).fit(x, target), tmp_path / f"{name}.skops")
    with pytest.raises(InputError, match=r"a and a_1 would both have the file A_1\.xml"):
        generate(load(tmp_path), "beckhoff-ml", tmp_path / "plc")


def test_the_files_have_the_structure_that_the_vendors_converter_writes():
    tree = etree.fromstring(only_file(MODELS["trees"]).encode())[0]
    assert [child.tag for child in tree] == [
        "CustomAttributes",
        "AuxiliarySpecifications",
        "Configuration",
        "Parameters",
    ]
    assert dict(tree.attrib) == {"modelName": "tree_ensemble", "defaultEngine": "rf_fp64_engine"}
    assert list(tree[2].attrib) == ["int64_inputDimension", "int64_numTrees", "str_TreeType", "str_PostTransform"]
    assert [child.tag for child in tree[3]] == ["BaseValues", "ClassWeights", "SplitValues", "SplitVars", "ChildNodes"]
    nodes = int(tree[3].find("SplitValues").get("int64_ND_1"))
    children = tree[3].find("ChildNodes").get("arrint64_TR_1").split(",")
    assert len(children) == 2 * nodes
    network = etree.fromstring(only_file(MODELS["network"]).encode())[0]
    assert [child.tag for child in network[2]] == ["MlpLayer1", "MlpLayer2"]
    assert network.find("Parameters/MlpLayer1/WeightMatrix/Row2").get("arrfp32_vals") == "1,0,-0.75,-1"
    assert network.find("Parameters/MlpLayer2/WeightMatrix").attrib["int64_columns"] == "3"
    svm = etree.fromstring(only_file(MODELS["svm rbf"]).encode())[0]
    assert svm.find("Parameters/ProbabilityInfo").get("fp64_rhoConstants") == "-0.10000000000000001"
    assert [child.tag for child in svm[3]] == [
        "ModelInfo", "ProbabilityInfo", "SupportVectors", "SupportVectorClassCoefficients",
    ]  # fmt: skip


def test_numbers_are_lists_and_a_list_of_one_is_a_scalar():
    text = only_file(MODELS["one leaf"])
    assert 'int64_ND_0="1" fp64_TR_0=' in text
    assert 'int64_ND_0="1" int64_TR_0="0"' in text
    assert 'arrint64_TR_0="0,0"' in text
    assert 'Row1 fp64_vals="' in only_file(MODELS["one input"])


def test_files_are_grouped_by_use_and_kind_and_the_text_knows_their_paths():
    folder = GOLDEN / "bundle" / "generated" / "beckhoff-ml"
    groups = {path.parent.name for path in folder.glob("Models/*/*.xml")}
    assert groups == {
        "amplitude_svm", "amplitude_trees", "phase_trees", "cosine_trees", "sine_trees", "cosine_sine_trees",
    }  # fmt: skip
    paths = (folder / "GVLs" / "GVL_ModelFiles.TcGVL").read_text(encoding="utf-8-sig")
    for path in folder.glob("Models/*/*.xml"):
        assert f"'C:\\ML\\{path.parent.name}\\{path.name}'" in paths
    project = (folder / "golden.plcproj").read_text()
    assert '<PlaceholderReference Include="Tc3_MLL">' in project


def test_predict_and_generate_take_such_a_file(tmp_path):
    (tmp_path / "net.xml").write_text(only_file(MODELS["scaled network"]))
    bundle = load(tmp_path / "net.xml")
    x = np.random.default_rng(0).normal(size=(50, 3))
    for target in ("twincat", "beckhoff-ml"):
        code = GeneratedCode(generate(bundle, TARGETS[target], tmp_path / "out").folder, "twincat")
        result = code.run_model("FB_Net", x, 1)
        assert result.valid.all()
        assert np.all(np.abs(result.values - bundle.models[0].predict(x)) <= 1e-5)


@pytest.mark.parametrize(("labels", "kernel"), [(TWO, "linear"), (WORDS, "rbf"), (MANY % 5, "poly")])
def test_support_vectors_of_classes(labels, kernel, tmp_path):
    """The runtime's label, as the file says it and as the block gives it, is the library's."""
    machine = make_pipeline(StandardScaler(), SVC(kernel=kernel, decision_function_shape="ovo")).fit(X, labels)
    found = loaded(machine, (OutputKind.CLASS,))
    assert verified(found, tmp_path, target="beckhoff-ml", rows=50).max_abs_err == 0.0
    text = only_file(found.ir)
    file = etree.fromstring(text.encode())[0]
    own = machine[-1]
    information = file.find("Parameters/ModelInfo").attrib
    assert file.find("Configuration").get("str_operationType") == "SVM_TYPE_C_CLASSIFIER"
    assert information["arrint32_numSVsPerClass"] == ",".join(map(str, own.n_support_))
    assert information["int64_numClasses"] == str(len(own.classes_))
    read = read_model(text.encode(), "m.xml", "m")
    assert np.mean(read.predict(X)[:, 0] == found.predict(X)[:, 0]) == 1.0
    assert np.array_equal(reference.evaluate(read.ir, X), found.predict(X))


def test_labels_of_a_vendors_file_are_its_own():
    machine = SVC().fit(X, MANY % 3)
    text = only_file(loaded(machine, (OutputKind.CLASS,)).ir)
    text = text.replace('arrint32_classLabels="0,1,2"', 'arrint32_classLabels="7,-1,30"')
    assert read_model(text.encode(), "m.xml", "m").ir.classes.labels == (7, -1, 30)
    for bad, message in (('"7,-1"', "are not those of 3 classes"), ('"7,7,7"', "different")):
        with pytest.raises(InputError, match=message):
            read_model(text.replace('"7,-1,30"', bad).encode(), "m.xml", "m")


def test_classifiers_that_the_format_does_not_say():
    scores = loaded(SVC().fit(X, MANY % 3))
    forest = loaded(DecisionTreeClassifier(max_depth=3).fit(X, TWO))
    ties = loaded(SVC(break_ties=True).fit(X, MANY % 3), (OutputKind.CLASS,))
    for found, message in (
        (scores, "labels only|branches"),
        (forest, "no support vector machine"),
        (ties, "branches|most votes"),
    ):
        with pytest.raises(UnsupportedModelError, match=message):
            only_file(found.ir)
