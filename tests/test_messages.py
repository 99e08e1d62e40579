"""What is said of models that cannot be compiled: the class and what is near, once; nothing of data is markup."""

import dataclasses

import numpy as np
import pytest

import st_codegen
from st_codegen import errors
from st_codegen.driver import generate
from st_codegen.errors import InputError, Problems, UnsupportedModelError
from st_codegen.project.bundle import load
from st_codegen.proof.predict import by_library, by_text, predict, read_table
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from tests.cli.helpers import run

X = np.random.default_rng(0).uniform(3.0, 60.0, (60, 2))


def save(folder, name, estimator):
    skops = pytest.importorskip("skops.io")
    folder.mkdir(exist_ok=True)
    skops.dump(estimator.fit(X, X[:, 0]), folder / f"{name}.skops")
    return folder


def test_a_class_that_is_not_supported_is_named_with_what_is_near(tmp_path):
    projections, pipeline = pytest.importorskip("sklearn.decomposition"), pytest.importorskip("sklearn.pipeline")
    from sklearn.preprocessing import StandardScaler

    alone = save(tmp_path / "a", "sparse", projections.SparsePCA(2))
    inside = save(tmp_path / "b", "sparse", pipeline.make_pipeline(StandardScaler(), projections.SparsePCA(2)))
    for folder in (alone, inside):
        with pytest.raises(UnsupportedModelError) as caught:
            load(folder)
        assert str(caught.value) == (
            f"{folder}: sparse.skops: scikit-learn's SparsePCA is not supported; near it: PCA; "
            "`st-codegen models` lists what is"
        )


def test_lines_that_stand_for_several_files_count_them():
    problems = Problems("campaign")
    for row in range(12):
        for file in ("a.csv", "b.csv", "c.csv"):
            problems.add(f"{file}: row {row}: bad")
    problems.add("no rows")
    problems.add("d.csv: no rows")
    problems.add("feature 'a.b': twice")
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert str(caught.value).splitlines() == [
        "campaign: 39 problems",
        "  - a.csv, b.csv and c.csv: row 0: bad; and 33 more that differ in names and numbers only",
        "  - no rows",
        "  - d.csv: no rows",
        "  - feature 'a.b': twice",
    ]


def test_many_problems_of_one_kind_are_one_line():
    problems = Problems("graph.onnx")
    for number in range(48):
        problems.add(f"node 'Sin_{number}': operand {number} is of type int8")
    problems.add("no output")
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert str(caught.value).splitlines() == [
        "graph.onnx: 49 problems",
        "  - node 'Sin_0': operand 0 is of type int8; and 47 more that differ in names and numbers only",
        "  - no output",
    ]


def test_a_table_of_wrong_cells_is_looked_through_once(monkeypatch):
    """Of 20,000 rows with decimal commas between commas the message took more than 15 minutes."""
    looked, subjects = [], errors._subjects
    monkeypatch.setattr(errors, "_subjects", lambda *given: looked.append(given) or subjects(*given))
    problems = Problems("joint.csv")
    for line in range(100):
        problems.add(f"line {line}: 8 values, the header has 4")
    with pytest.raises(InputError, match="and 99 more"):
        problems.raise_if_any()
    assert len(looked) == 1


def test_files_that_are_alike_wrong_are_one_line(tmp_path):
    for number in range(12):
        (tmp_path / f"n{number:02}.txt").write_text("hello")
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    _, line = str(caught.value).splitlines()
    names = ", ".join(f"n{number:02}.txt" for number in range(8))
    assert line.startswith(f"  - {names} and 4 more: not a LightGBM text model")


def test_untrusted_files_of_any_names_are_one_line(tmp_path):
    for name in ("A0_forward.joblib", "A0_backward.joblib", "phi1.pkl", "pump.joblib"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    head, line = str(caught.value).splitlines()
    assert head.endswith(": 4 problems")
    assert line.startswith("  - A0_backward.joblib, A0_forward.joblib, phi1.pkl and pump.joblib: loading a pickle can")


def test_files_that_are_wrong_in_different_ways_have_a_line_each():
    problems = Problems("models")
    problems.add("a.txt: no trees")
    problems.add("b.txt: no header")
    problems.add("feature 'speed': no unit")
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert str(caught.value).splitlines()[1:] == [
        "  - a.txt: no trees",
        "  - b.txt: no header",
        "  - feature 'speed': no unit",
    ]


def test_a_single_file_is_named_once(tmp_path):
    (tmp_path / "x.h5").write_text("")
    with pytest.raises(UnsupportedModelError) as caught:
        load(tmp_path / "x.h5")
    assert str(caught.value).startswith(f"{tmp_path / 'x.h5'}: not a known model format")
    assert caught.value.codes == ("STC1209",)


def test_a_few_problems_of_one_kind_are_all_shown():
    problems = Problems("x")
    for number in range(8):
        problems.add(f"node 'n{number}' is wrong")
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert len(str(caught.value).splitlines()) == 9


def test_decimal_commas_are_read_as_in_training(lone_folder, tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("f0;f1;f2\n300,5;100;nan\n", encoding="utf-8")
    table = read_table(path)
    assert table["f0"] == [300.5]
    assert np.isnan(table["f2"]).all()


def test_brackets_in_data_are_shown(lone_folder, tmp_path, capsys):
    path = tmp_path / "x.csv"
    path.write_text("f0,f1,f2\n1,2,[nan\n")
    assert run("predict", lone_folder, "-i", path, "-o", tmp_path / "y.csv") == 2
    assert "'[nan' is not a number" in capsys.readouterr().err
    (lone_folder / "[nan.txt").write_text("no model [red]at[/red] all")
    assert run(lone_folder, "--out", tmp_path) == 2
    assert "[nan.txt: not a LightGBM text model" in capsys.readouterr().err
    (lone_folder / "[nan.txt").write_text((lone_folder / "te.txt").read_text())
    assert run(lone_folder, "--out", tmp_path) == 0
    assert "[nan" in capsys.readouterr().err


def test_models_lists_what_is_supported_and_a_folder_of_that_name_compiles(lone_folder, tmp_path, capsys, monkeypatch):
    assert run("models") == 0
    printed = capsys.readouterr().out
    assert "RandomForestRegressor" in printed
    assert "LGBMRegressor" in printed
    lone_folder.rename(tmp_path / "models")
    monkeypatch.chdir(tmp_path)
    assert run("models", "--out", "plc", "-q") == 0
    assert run("models/", "--out", "plc", "-q") == 0
    assert (tmp_path / "plc" / "twincat").is_dir()


# --- transformers, and what stands in memory


def transformers():
    pytest.importorskip("sklearn")
    from sklearn.compose import ColumnTransformer
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer, MinMaxScaler, StandardScaler

    return {
        "scaler": StandardScaler(),
        "chain": make_pipeline(StandardScaler(), MinMaxScaler()),
        "columns": ColumnTransformer([("a", MinMaxScaler(), [1]), ("b", "passthrough", [0])]),
        "logarithm": FunctionTransformer(np.log1p),
    }


@pytest.mark.parametrize("name", ["scaler", "chain", "columns", "logarithm"])
def test_a_transformer_is_compiled_by_its_transform(name, tmp_path):
    estimator = transformers()[name].fit(X)
    bundle = load(estimator)
    (model,) = bundle.models
    assert model.ir.outputs == ("out1", "out2")
    assert np.array_equal(model.predict(X), estimator.transform(X))
    folder = generate(bundle, "twincat", tmp_path).folder
    assert verify(bundle, tmp_path, rows=300).passed
    columns = {"f0": np.array([3.5, np.nan]), "f1": np.array([5.0, 5.0])}
    expected = estimator.transform(np.array([[3.5, 5.0]]))[0]
    for answer in (by_library, by_text(GeneratedCode(folder, "twincat"))):
        got = predict(bundle, columns, answer)
        assert list(got) == ["model[0]", "model[1]"]
        values = np.column_stack(list(got.values()))
        assert np.allclose(values[0], expected, rtol=1e-15, atol=0)
        # the block refuses the row, the library the missing number alone
        kept = estimator.transform(np.array([[np.nan, 5.0]]))[0] if answer is by_library else [np.nan] * 2
        assert np.allclose(values[1], kept, rtol=1e-15, atol=0, equal_nan=True)


def test_estimators_are_compiled_from_memory(tmp_path):
    ensemble, linear = pytest.importorskip("sklearn.ensemble"), pytest.importorskip("sklearn.linear_model")
    forest = ensemble.RandomForestRegressor(3, max_depth=3, random_state=0).fit(X, X[:, 0])
    bundle = st_codegen.load({"forest": forest, "line": linear.Ridge().fit(X, X[:, 1])})
    generated = st_codegen.generate(bundle, "twincat", tmp_path)
    report = st_codegen.verify(bundle, tmp_path, rows=200)
    assert report.passed
    assert repr(dataclasses.replace(report, models=report.models[:1])) == "VerifyReport(1 model, all passed)"
    assert [model.name for model in bundle.irs] == ["forest", "line"]
    assert len(bundle.irs[0].source.digest) == 64
    shown = [bundle, generated, report, bundle.models[0]]
    assert [len(repr(value)) < 300 for value in shown] == [True] * 4
    assert repr(bundle) == "Bundle(forest, line)"
    assert repr(report) == "VerifyReport(2 models, all passed)"
    pages = [value._repr_html_() for value in shown[:3]]
    assert all(page.startswith("<table>") and "forest" in page for page in pages)
    assert "FB_Forest" in pages[1]
    assert "equal bits" in pages[2]


def test_an_estimator_from_memory_is_copied(tmp_path):
    ensemble = pytest.importorskip("sklearn.ensemble")
    forest = ensemble.RandomForestRegressor(3, max_depth=3, random_state=0, n_jobs=2).fit(X, X[:, 0])
    bundle = st_codegen.load(forest)
    assert forest.n_jobs == 2
    forest.fit(X, -X[:, 0])
    generated = st_codegen.generate(bundle, "iec", tmp_path)
    assert st_codegen.verify(bundle, tmp_path, rows=200).passed
    assert "n_jobs=1" in (generated.folder / "FB_Model.st").read_text()


@pytest.mark.parametrize("jobs", [None, 1])
def test_one_job_needs_no_word(jobs):
    ensemble = pytest.importorskip("sklearn.ensemble")
    forest = ensemble.RandomForestRegressor(3, max_depth=3, random_state=0, n_jobs=jobs).fit(X, X[:, 0])
    assert st_codegen.load(forest).irs[0].source.notes == ()


def test_texts_of_a_notebook_are_escaped():
    from st_codegen.files.html_text import html_table

    assert "<b>" not in html_table("<b>", ["<b>"], [["<b>"]])


def test_what_is_no_estimator_is_refused():
    with pytest.raises(InputError, match=r"this is a builtins\.list, not a model of scikit-learn"):
        load([1, 2])
