"""Models in REAL: every row takes the library's way through the trees, and what is lost stays below the bound."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

from st_codegen import generate, load, verify
from st_codegen.emit.literals import real32
from st_codegen.errors import GeneratedCodeError, InputError, TargetError, UnsupportedModelError, at_most
from st_codegen.ir import (
    Aggregate,
    Comparison,
    Feature,
    ModelIR,
    OutputKind,
    Precision,
    Source,
    TreeColumn,
    TreeEnsemble,
    reference,
)
from st_codegen.passes.choose import Layout, Options
from st_codegen.passes.real import in_real
from st_codegen.proof import bounds
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.range_bound import largest_loss
from tests.cli.helpers import run


def forest(comparison=Comparison.LESS_OR_EQUAL, *, seed=0, trees=40, **changes):
    """Stumps at thresholds that are no REAL numbers, with leaves of both signs."""
    random = np.random.default_rng(seed)
    nodes = 3 * trees
    inner = np.arange(nodes) % 3 == 0
    threshold = np.where(inner, np.sort(random.uniform(-2, 2, nodes)), 0.0)
    threshold[0] = float(np.float32(0.1))  # one that is
    leaf_value = random.normal(size=(2 * trees, 1)) * 10.0 ** random.integers(-3, 3, (2 * trees, 1))
    op = TreeEnsemble(
        inputs=(0,),
        columns=(TreeColumn(0),),
        roots=np.arange(0, nodes, 3),
        split=np.where(inner, 0, -1),
        threshold=threshold,
        left=np.where(inner, np.arange(nodes) + 1, 0),
        right=np.where(inner, np.arange(nodes) + 2, 0),
        missing_left=inner,
        leaf=np.where(inner, -1, np.cumsum(~inner) - 1),
        leaf_value=leaf_value,
        tree_output=np.zeros(trees),
        base=np.array([0.3]),
        comparison=comparison,
    )
    op = dataclasses.replace(op, **changes)
    return ModelIR("m", (Feature("x"),), (op,), ("out",), Source("none", "1", "M"), accepts_nan=True)


def near(thresholds):
    """The REAL numbers around thresholds, and others."""
    single = np.float32(thresholds)
    ends = [np.float32(np.inf), np.float32(-np.inf)]
    around = np.concatenate([single, *(np.nextafter(single, end) for end in ends)])
    others = np.float32([0.0, -0.0, 1e-45, 1e30, -1e30, np.nan])
    return np.concatenate([around, others]).astype(np.float64)[:, None]


@pytest.mark.parametrize("comparison", list(Comparison))
def test_every_row_of_real_numbers_takes_the_same_way(comparison):
    model = forest(comparison)
    real = in_real(model)
    assert np.array_equal(np.float32(real.ops[0].threshold), real.ops[0].threshold)
    x = near(model.ops[0].threshold)
    for tree in range(model.ops[0].n_trees):
        ways = [reference.leaf_values(ir.ops[0], x, tree) for ir in (model, real)]
        assert np.array_equal(np.float32(ways[0]), ways[1])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"divisor": 40.0},
        {"divisor": 0.125, "base_last": True},
        {"divisor": 40.0, "base_last": True, "base": np.array([1e3 + 0.1])},
        {"aggregate": Aggregate.MAXIMUM},
        {"leaf_value": np.full((80, 1), 1e-44 / 3)},
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_lost_stays_below_the_bound(changes, seed):
    model = forest(seed=seed, **changes)
    real = in_real(model)
    x = near(model.ops[0].threshold)
    lost = np.abs(reference.evaluate(model, x) - reference.evaluate(real, x))
    (bound,) = largest_loss(real)
    assert 0.0 < np.max(lost) <= bound
    assert bound < 1000 * np.max(lost)  # and says something
    assert not real.exact


def test_a_library_that_computes_in_float32_loses_nothing():
    model = forest(leaf_value=np.float32(np.random.default_rng(0).normal(size=(80, 1))), base=np.zeros(1))
    model = dataclasses.replace(model, ops=(dataclasses.replace(model.ops[0], sum_precision=Precision.FLOAT32),))
    real = in_real(model)
    assert real.exact and real.is_real
    x = near(model.ops[0].threshold)
    assert np.array_equal(reference.evaluate(model, x), reference.evaluate(real, x), equal_nan=True)


def test_literals_of_real_read_back():
    random = np.random.default_rng(0)
    values = np.concatenate([random.normal(size=2000), np.exp(random.uniform(-80, 80, 2000))]).astype(np.float32)
    for value in values:
        text = real32(float(value))
        assert np.float32(float(text)) == value
        assert re.fullmatch(r"-?\d+\.\d+(E-?\d+)?", text)
    assert real32(float(np.float32(0.1))) == "0.1"


@pytest.fixture
def generated(lone_folder, tmp_path):
    bundle = load(lone_folder, real=True)
    for target in ("iec", "codesys"):
        generate(bundle, target, tmp_path / "out")
    return bundle, tmp_path / "out"


def test_the_text_is_of_real_numbers_and_is_verified_against_both(generated, lone_folder):
    bundle, out = generated
    text = (out / "iec" / "FB_Te.st").read_text()
    code = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
    assert "LREAL" not in code and "fSpeed_rpm : REAL;" in code and "fOut1 : REAL;" in code
    assert not (out / "iec" / "FB_SelfTest.st").exists()
    (bound,) = largest_loss(bundle.irs[0])
    assert f"{at_most(bound, 3)} of its own" in " ".join(text.split())
    report = verify(bundle, out, rows=500)
    (model,) = report.models
    assert report.passed and not model.exact
    assert 0.0 < model.max_abs_err <= bound == model.bound
    assert "REAL numbers every split decides as in the library" in report.notes["te"]
    assert {result.verdict for result in prove(bundle, out).results} == {Verdict.NOT_PROVED}
    with pytest.raises(GeneratedCodeError, match="real=True"):
        verify(load(lone_folder), out, rows=50)


def test_the_text_must_be_the_model_in_real_to_the_bit(generated):
    bundle, out = generated
    path = out / "iec" / "FB_Te.st"
    text = path.read_text()
    first = text.index("(* tree 0 *)", text.index("THRESHOLD_1"))
    number = re.compile(r"-?\d+\.\d+(E-?\d+)?").search(text, first)
    moved = real32(float(np.nextafter(np.float32(number[0]), np.float32(np.inf))))
    path.write_text(text[: number.start()] + moved + text[number.end() :])
    report = verify(bundle, out, rows=500)
    assert not report.passed
    assert report.models[0].failures[0].between == "reference and iec"


def test_what_runs_the_blocks_is_of_real_numbers_too(lone_folder, tmp_path):
    bundle = load(lone_folder, real=True)
    folder = generate(bundle, "iec", tmp_path, with_configuration=True, with_age=True).folder
    text = "".join(path.read_text() for path in folder.glob("*.st"))
    code = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
    assert "LREAL" not in code and "END_CONFIGURATION" in code and "nAge : DINT" in code
    assert verify(bundle, tmp_path, rows=100).passed


def test_a_range_is_that_of_its_real_numbers(lone_folder, tmp_path):
    (lone_folder / "st-codegen.toml").write_text(
        '[[input]]\nfeature = "speed_rpm"\nunit = "rpm"\nmin = 0.1\nmax = 1000.3\noutside = "clamp"\n'
    )
    bundle = load(lone_folder, real=True)
    feature = next(f for f in bundle.irs[0].features if f.name == "speed_rpm")
    assert np.float32(feature.lower) == feature.lower >= 0.1
    assert np.float32(feature.upper) == feature.upper <= 1000.3
    generate(bundle, "iec", tmp_path)
    assert verify(bundle, tmp_path, rows=500).passed


def test_what_cannot_be_computed_in_real_is_refused_with_its_reason(lone_folder, bundle_folder, tmp_path):
    with pytest.raises(InputError, match="angles of many revolutions") as caught:
        load(bundle_folder, real=True)
    assert caught.value.codes == ("STC1411",)
    bundle = load(lone_folder, real=True)
    with pytest.raises(TargetError, match="target twincat have LREAL; --real goes with iec, plcopen, codesys"):
        generate(bundle, "twincat", tmp_path)
    with pytest.raises(TargetError, match="have LREAL"):
        generate(bundle, "beckhoff-ml", tmp_path)
    for layout in set(Layout) - {Layout.AUTO, Layout.TREES}:
        with pytest.raises(TargetError, match=f"leave out the layout {layout}"):
            generate(bundle, "iec", tmp_path, options=Options(layout))
    with pytest.raises(TargetError, match="--self-check is written in LREAL"):
        generate(bundle, "iec", tmp_path, self_check=True)
    model = forest()
    for changes, reason in (
        ({"leaf_value": np.full((80, 1), 1e38)}, "are too large"),
        ({"threshold": np.where(model.ops[0].split >= 0, 1e300, 0.0)}, "are too large"),
        ({"divisor": 0.1}, "divides by 0.1"),
    ):
        with pytest.raises(UnsupportedModelError, match=reason):
            in_real(forest(**changes))
    with pytest.raises(TargetError, match="S7-300 and S7-400 know no blocks with optimised access"):
        generate(bundle, "scl", tmp_path)


def test_an_infinite_input_without_a_range_is_refused_beside_one_with_a_range(tmp_path):
    """It was limited to the largest REAL, which a tree takes, where the header says that it is refused."""
    tree, skops = pytest.importorskip("sklearn.tree"), pytest.importorskip("skops.io")
    x = np.random.default_rng(0).uniform(0.0, 10.0, (80, 2))
    skops.dump(tree.DecisionTreeRegressor(max_depth=3).fit(x, x.sum(axis=1)), tmp_path / "tree.skops")
    (tmp_path / "st-codegen.toml").write_text('[[input]]\nfeature = "f0"\nmin = 1.0\nmax = 9.0\n')
    models = load(tmp_path, real=True)
    generate(models, "iec", tmp_path / "out")
    report = verify(models, tmp_path / "out", rows=300)
    assert report.passed, [str(failure) for model in report.models for failure in model.failures]


def test_an_input_that_the_library_refuses_is_refused():
    model = dataclasses.replace(forest(), magnitude_limits=(16777217.0,), accepted=((-0.1, 1e7 + 0.3),))
    real = in_real(model)
    assert real.magnitude_limits == (16777216.0,) and real.accepted[0][0] > -0.1 and real.accepted[0][1] == 1e7
    x = np.array([[16777216.0], [16777215.0], [1e7], [-0.1], [0.0]])
    assert np.isfinite(reference.evaluate(real, x)[:, 0]).tolist() == [False, False, True, False, True]


def fitted():
    """Models of each kind, by name: a number of features, targets that are no REAL numbers."""
    sklearn = pytest.importorskip("sklearn")
    from sklearn import ensemble, linear_model, neural_network, pipeline, preprocessing, svm

    assert sklearn
    random = np.random.default_rng(3)
    x = random.uniform((100, 0, 20), (1800, 1800, 40), (60, 3))
    y = 1e-3 * np.sin(x[:, 0] / 300) + 1e-6 * x[:, 1]
    classes = np.digitize(y, np.quantile(y, [0.3, 0.6]))
    network = {"hidden_layer_sizes": (5,), "max_iter": 30, "random_state": 0}

    def scaled(model, target=y):
        return pipeline.make_pipeline(preprocessing.StandardScaler(), model).fit(x, target)

    return {
        "linear": linear_model.LinearRegression().fit(x, y),
        "scaled": scaled(linear_model.Ridge()),
        "polynomial": scaled(svm.SVR(kernel="poly", epsilon=1e-4)),
        "rbf": scaled(svm.SVR(epsilon=1e-4)),
        "rbf_raw": svm.SVR(gamma=1.1e-6, epsilon=1e-4).fit(x, y),
        "sigmoid": scaled(svm.SVR(kernel="sigmoid", epsilon=1e-4, C=1e-3)),
        "tanh": scaled(neural_network.MLPRegressor(activation="tanh", **network)),
        "relu": scaled(neural_network.MLPRegressor(**network)),
        "logistic": scaled(neural_network.MLPRegressor(activation="logistic", **network)),
        "exp": scaled(linear_model.PoissonRegressor(), np.round(1e4 * np.abs(y))),
        "chances": scaled(linear_model.LogisticRegression(), classes),
        "vectors": scaled(svm.SVC(), classes),
        "forest": ensemble.RandomForestClassifier(5, random_state=0).fit(x, classes),
    }


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """All kinds in one folder: the bundle, the folder, what verify says of each."""
    folder = tmp_path_factory.mktemp("kinds")
    given = {"chances": (OutputKind.CLASS, OutputKind.PROBABILITY)}
    bundle = load(fitted(), real=True, outputs=given)
    generate(bundle, "iec", folder)
    return bundle, folder, verify(bundle, folder, rows=300)


#: Kinds whose text has one result, whatever the controller: nothing but sums, products and comparisons.
ONE_RESULT = {"linear", "scaled", "polynomial", "relu", "forest"}


def test_every_kind_agrees_with_its_library_within_a_bound_that_says_something(kinds):
    bundle, folder, report = kinds
    assert report.passed
    assert {model.name for model in report.models} == set(fitted())
    for model, loaded in zip(report.models, bundle.models, strict=True):
        text = (folder / "iec" / f"FB_{model.name[0].upper()}{model.name[1:]}.st").read_text()
        assert "LREAL" not in re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
        if loaded.ir.classes is None:
            assert 0.0 < model.max_abs_err <= model.bound < 5e4 * model.max_abs_err, model.name
        else:
            assert model.open_rows < model.n / 4
        x = probe_rows(loaded.ir, 300, 1)
        result = bounds.text_bound(loaded.ir, reference.limited(loaded.ir, x))
        assert np.any(result > 0) != (model.name in ONE_RESULT), model.name


def test_what_has_one_result_stands_alone_in_its_statement(kinds):
    """On a controller with more digits between two operations it is the same."""
    _, folder, _ = kinds
    for name in ("Linear", "Scaled", "Polynomial", "Relu"):
        text = (folder / "iec" / f"FB_{name}.st").read_text()
        found = re.sub(r"\[[^\]]*\]", "", re.sub(r"\(\*.*?\*\)", "", text, flags=re.S))
        for target, value in re.findall(r"(\w+)\s*:=\s*([^;\[]+);", found):
            if target.startswith(("f", "aStep")):
                assert len(re.findall(r" [-+*/] ", value)) <= 1, f"{name}: {target} := {value}"


def test_a_changed_last_digit_of_a_coefficient_is_found(kinds, tmp_path):
    bundle, folder, _ = kinds
    shutil.copytree(folder, tmp_path / "out")
    path = tmp_path / "out" / "iec" / "FB_Scaled.st"
    text = path.read_text()
    number = re.compile(r"-?\d+\.\d+(E-?\d+)?").search(text, text.index("WEIGHT_"))
    moved = real32(float(np.nextafter(np.float32(number[0]), np.float32(np.inf))))
    path.write_text(text[: number.start()] + moved + text[number.end() :])
    report = verify(bundle, tmp_path / "out", rows=300)
    (failed,) = [model for model in report.models if not model.passed]
    assert failed.name == "scaled" and failed.failures[0].between == "reference and iec"


@pytest.mark.parametrize("op_type", ["Relu", "Abs", "Tanh", "Sigmoid"])
def test_layers_of_float_have_no_conversions_left(tmp_path, op_type):
    """What picks numbers stays in float, and a layer has its function in one loop: of Relu the text was no REAL."""
    onnx = pytest.importorskip("onnx")
    random, number = np.random.default_rng(0), onnx.numpy_helper.from_array
    weights = [
        number(random.normal(size=shape).astype(np.float32), name) for name, shape in (("W", (3, 4)), ("V", (4,)))
    ]
    nodes = [
        onnx.helper.make_node("Gemm", ["X", "W", "V"], ["H"]),
        onnx.helper.make_node(op_type, ["H"], ["L"]),
        onnx.helper.make_node("MatMul", ["L", "V"], ["Y"]),
    ]
    ends = [onnx.helper.make_tensor_value_info(name, 1, shape) for name, shape in (("X", (None, 3)), ("Y", None))]
    graph = onnx.helper.make_graph(nodes, "layers", ends[:1], ends[1:], weights)
    opset = onnx.helper.make_opsetid("", 18)
    onnx.save(onnx.helper.make_model(graph, opset_imports=[opset], ir_version=9), tmp_path / "layers.onnx")
    bundle = load(tmp_path, real=True)
    generate(bundle, "iec", tmp_path / "out")
    assert verify(bundle, tmp_path / "out", rows=200).passed
    text = (tmp_path / "out/iec/FB_Layers.st").read_text()
    assert "LREAL" not in re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)


def test_the_header_has_the_bound_where_the_inputs_have_ranges(tmp_path):
    linear = pytest.importorskip("sklearn.linear_model")
    joblib = pytest.importorskip("joblib")
    random = np.random.default_rng(0)
    x = random.uniform(0, 100, (50, 2))
    joblib.dump(linear.LinearRegression().fit(x, x @ [0.1, 0.7]), tmp_path / "sum.joblib")
    bundle = load(tmp_path, real=True, trust_pickle=True)
    generate(bundle, "iec", tmp_path / "out")
    assert "verify bounds for each row" in " ".join((tmp_path / "out/iec/FB_Sum.st").read_text().split())
    (tmp_path / "st-codegen.toml").write_text(
        "".join(f'[[input]]\nfeature = "f{n}"\nmin = 0.0\nmax = 100.0\noutside = "clamp"\n' for n in range(2))
    )
    bundle = load(tmp_path, real=True, trust_pickle=True)
    generate(bundle, "iec", tmp_path / "out")
    (bound,) = largest_loss(bundle.irs[0])
    assert f"in the declared range the outputs lie within {at_most(bound, 3)} of" in " ".join(
        (tmp_path / "out/iec/FB_Sum.st").read_text().split()
    )
    (model,) = verify(bundle, tmp_path / "out", rows=2000).models
    assert model.passed and 0 < model.max_abs_err <= model.bound <= bound * 1.0001 < 300 * model.max_abs_err


def test_kinds_of_models_that_are_not_written_in_real():
    linear = pytest.importorskip("sklearn.linear_model")
    from sklearn import neighbors, pipeline, preprocessing, tree

    x = np.random.default_rng(0).normal(size=(50, 2))
    for model, reason in (
        (neighbors.KNeighborsRegressor(3), "has Distances, of which no bound in REAL is derived"),
        (pipeline.make_pipeline(preprocessing.StandardScaler(), tree.DecisionTreeRegressor()), "steps in front of its"),
        (pipeline.make_pipeline(preprocessing.Normalizer(), linear.Ridge()), "no bound in REAL is derived"),
    ):
        with pytest.raises(InputError, match=reason) as caught:
            load(model.fit(x, x[:, 0]), real=True)
        assert caught.value.codes == ("STC1411",) or "STC1411" in caught.value.codes
    huge = linear.LinearRegression().fit(x, x[:, 0])
    huge.coef_ = np.array([1e39, 0.0])
    with pytest.raises(InputError, match=r"1e\+39 are too large"):
        load(huge, real=True)


@pytest.mark.parametrize("options", [["--target", "twincat"], ["--target", "iec", "--self-check"]])
def test_the_command_says_nothing_of_a_text_that_it_refuses(lone_folder, tmp_path, capsys, options):
    assert run("generate", lone_folder, "--real", "-o", tmp_path / "out", *options) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "--real" in said and "numbers between are REAL" not in said and not (tmp_path / "out").exists()


def test_the_command_says_what_is_lost_also_when_it_is_quiet(lone_folder, tmp_path, capsys):
    assert run("generate", lone_folder, "--target", "iec", "--real", "-q", "-o", tmp_path) == 0
    assert "every split decides as in the library" in " ".join(capsys.readouterr().err.split())
    facts = json.loads((tmp_path / "iec" / "st-codegen.json").read_text())["models"]["te"]
    assert len(facts["real"]) == 1 and not facts["exact"]
    assert run("verify", lone_folder, "-g", tmp_path, "-n", 100) == 0
    assert "REAL numbers" in " ".join(capsys.readouterr().err.split())
    assert run("prove", lone_folder, "-g", tmp_path) == 1
    assert "it computes in REAL" in " ".join(capsys.readouterr().err.split())
    assert run("generate", lone_folder, "--target", "plcopen", "-q", "-o", tmp_path) == 0
    capsys.readouterr()
    assert run("verify", lone_folder, "-g", tmp_path) == 2
    assert "some targets were generated with --real" in " ".join(capsys.readouterr().err.split())
    (lone_folder / "st-codegen.toml").write_text('[build]\ntarget = ["iec"]\nreal = true\n')
    assert run("generate", lone_folder, "--check", "-o", tmp_path) == 0
