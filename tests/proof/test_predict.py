import dataclasses
import shutil

import numpy as np
import pytest

from st_codegen.driver import Evaluator, predict
from st_codegen.errors import InputError
from st_codegen.files.csv_tables import with_underscores
from st_codegen.files.text import write_text
from st_codegen.project.bundle import load
from st_codegen.proof.predict import limits, read_table, table_text
from tests.cli.helpers import run

ROWS = np.array([[500.0, 300.0, 26.0], [np.nan, 10.0, 30.0], [np.inf, -np.inf, 1e300], [100.0, 0.0, 25.0]])


@pytest.mark.parametrize("names", [["speed_rpm", "torque_Nm", "temperature_C"], ["f0", "f1", "f2"]])
def test_three_engines_give_the_same_numbers(lone_folder, names):
    bundle = load(lone_folder)
    columns = dict(zip(names, ROWS.T, strict=True))
    results = [predict(bundle, columns, engine) for engine in Evaluator]
    assert list(results[0]) == ["te"]
    assert np.isfinite(results[0]["te"]).all()  # LightGBM takes NaN and infinities
    for result in results[1:]:
        assert np.array_equal(result["te"], results[0]["te"])


def test_inputs_of_a_bundle_are_limited_to_their_range(bundle_folder):
    bundle = load(bundle_folder)
    inside = {"speed_rpm": [1800.0], "torque_Nm": [0.0], "temperature_C": [35.0]}
    outside = {"speed_rpm": [9999.0], "torque_Nm": [-5.0], "temperature_C": [np.inf]}
    for engine in Evaluator:
        expected, got = (
            predict(bundle, {name: np.array(v) for name, v in columns.items()}, engine) for columns in (inside, outside)
        )
        assert expected == got


def test_inputs_that_are_limited_are_said(bundle_folder, tmp_path, capsys):
    """Asked for by the library itself, the number is not what the library gives for the row of the table."""
    write_text(tmp_path / "x.csv", "speed_rpm,torque_Nm,temperature_C\n9999,300,30\n500,-5,30\n50,300,30\n500,nan,30\n")
    words = [
        "predict",
        bundle_folder,
        "-i",
        tmp_path / "x.csv",
        "-o",
        tmp_path / "y.csv",
        "-e",
        "source",
    ]
    assert run(*words) == 0
    said = capsys.readouterr().err
    assert "speed_rpm (100 .. 1800) in 2 of 4 rows, torque_Nm (0 .. 1800) in 1 of 4 rows\n" in said
    assert "temperature_C" not in said
    assert run(*words, "-q") == 0
    assert "range" not in capsys.readouterr().err


def test_a_model_is_not_overwritten_by_its_predictions(lone_folder, tmp_path, capsys):
    models = shutil.copytree(lone_folder, tmp_path / "models")
    (file,) = (path for path in models.iterdir() if path.suffix != ".toml")
    before = file.read_bytes()
    write_text(tmp_path / "x.csv", "speed_rpm,torque_Nm,temperature_C\n500,300,30\n")
    for output in (file, models / "st-codegen.toml"):
        output.touch()
        assert run("predict", models, "-i", tmp_path / "x.csv", "-o", output) == 2
        assert "is a file of the models" in capsys.readouterr().err
    assert file.read_bytes() == before
    for _ in range(2):  # another file beside them is the user's
        assert run("predict", file, "-i", tmp_path / "x.csv", "-o", models / "y.out") == 0
    assert run("predict", models, "-i", tmp_path / "x.csv", "-o", tmp_path / "new" / "y.txt") == 0
    assert (tmp_path / "new" / "y.txt").is_file()


def test_models_that_limit_an_input_differently_are_named(lone_folder):
    (plain,) = load(lone_folder).irs

    def limited(name, upper):
        speed = dataclasses.replace(plain.features[0], lower=0.0, upper=upper)
        return dataclasses.replace(plain, name=name, features=(speed, *plain.features[1:]))

    models = [limited("a", 900.0), limited("b", 900.0)]
    columns = {"speed_rpm": np.array([800.0, 950.0]), "torque_Nm": np.zeros(2), "temperature_C": np.zeros(2)}
    assert limits(models, columns) == ["speed_rpm (0 .. 900) in 1 of 2 rows"]
    assert limits([*models, limited("c", 700.0), plain], columns) == [
        "speed_rpm (0 .. 700) in 2 of 2 rows for c", "speed_rpm (0 .. 900) in 1 of 2 rows for a, b"
    ]  # fmt: skip


def test_several_outputs_are_numbered_and_refused_rows_are_nan(tmp_path):
    sklearn = pytest.importorskip("sklearn.linear_model")
    skops = pytest.importorskip("skops.io")
    model = sklearn.LinearRegression().fit([[0.0], [1.0], [2.0]], [[0.0, 5.0], [1.0, 4.0], [2.0, 3.0]])
    skops.dump(model, tmp_path / "line.skops")
    bundle = load(tmp_path)
    for engine in Evaluator:
        result = predict(bundle, {"f0": np.array([1.0, np.nan, np.inf])}, engine)
        assert list(result) == ["line[0]", "line[1]"]
        assert result["line[0]"][0] == pytest.approx(1.0, abs=1e-14)
        assert np.isnan(result["line[1]"][1:]).all()


def test_the_library_answers_for_itself_where_a_block_refuses(tmp_path):
    """It was not asked, and said to have no answer: behind a logarithm that does not exist a value is missing."""
    pytest.importorskip("sklearn")
    joblib = pytest.importorskip("joblib")
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    x = np.linspace(0.1, 3.0, 100)[:, None]
    model = make_pipeline(FunctionTransformer(np.log), HistGradientBoostingRegressor(max_iter=3)).fit(x, x[:, 0])
    joblib.dump(model, tmp_path / "m.joblib")
    bundle, rows = load(tmp_path, trust_pickle=True), np.array([1.0, -2.0, np.inf])
    said = predict(bundle, {"f0": rows}, Evaluator.SOURCE)["m"]
    with np.errstate(invalid="ignore"):
        assert np.array_equal(said, model.predict(rows[:, None]))
    assert np.isnan(predict(bundle, {"f0": rows}, Evaluator.ST)["m"]).tolist() == [False, True, True]


def test_a_column_bears_its_own_name_or_the_one_that_lightgbm_makes_of_it(lone_folder):
    bundle = load(lone_folder)
    x = [np.array([value]) for value in ROWS[0]]
    plain = {"speed_rpm": x[0], "torque_Nm": x[1], "temperature_C": x[2]}
    spaced = {"speed rpm": x[0], "torque_Nm": x[1], "torque Nm": -x[1], "temperature C": x[2]}
    results = [predict(bundle, columns, Evaluator.REFERENCE)["te"] for columns in (plain, spaced)]
    assert np.array_equal(*results)
    assert sorted(with_underscores({"oil temp  C": x[0]})) == ["oil temp  C", "oil_temp__C"]
    assert list(with_underscores({"a b_c": x[0], "a_b c": x[1]})) == ["a b_c", "a_b c"]


def test_missing_columns_are_all_named(lone_folder):
    with pytest.raises(InputError, match="model 'te': no column torque_Nm, temperature_C; the header has speed_rpm"):
        predict(load(lone_folder), {"speed_rpm": np.zeros(1)}, Evaluator.REFERENCE)


def test_tables_keep_every_bit(tmp_path):
    columns = {"a": np.array([0.1, np.nan, -np.inf, 5e-324]), "b[0]": np.array([1e300, -0.0, 1 / 3, 2.0**-1074])}
    write_text(tmp_path / "new" / "t.csv", table_text(columns))
    back = read_table(tmp_path / "new" / "t.csv")
    assert list(back) == ["a", "b[0]"]
    for name in columns:
        assert np.array_equal(
            back[name].view(np.int64)[~np.isnan(back[name])], columns[name].view(np.int64)[~np.isnan(columns[name])]
        )
    assert list((tmp_path / "new").iterdir()) == [tmp_path / "new" / "t.csv"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "first line must name"),
        ("a,\n1,2\n", "a column has no name"),
        ("a,b\n1_0,\u0661\n1e999,0x1\n", "(?s)'1_0' is not.*'\u0661' is not.*too large.*'0x1' is not"),
        ("a,b\n1\n", "line 2: 1 value, the header has 2"),
        ("a,b\n1,x\n2,\n", r"(?s)line 2: b: 'x' is not a.*line 3: b: '' is not a number; a missing one is written nan"),
        ("a,a\n1,2\n", "'a' is there twice"),
        ("a,b\n1,2\n,\n3,4\n", "line 3: all cells are empty; a missing number is written nan"),
        ('a\n1\n""\n3\n', "line 3: all cells are empty"),
        ('a\n1.0\n""\n', "line 3: all cells are empty"),
        ("a,b\n1,2\n,\n", "line 3: all cells are empty"),
        ("a,b\n,\n,\n", "(?s)line 2: all cells are empty.*line 3: all cells are empty"),
    ],
)
def test_bad_tables_are_described(tmp_path, text, reason):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(InputError, match=reason):
        read_table(tmp_path / "x.csv")


def test_lines_without_cells_are_no_rows(tmp_path):
    """Rows of empty cells were left out too, and predictions stood beside other rows."""
    (tmp_path / "x.csv").write_text("\na,b\n\n1,2\n  \n3,4\n\n  \n\n")
    assert read_table(tmp_path / "x.csv")["b"].tolist() == [2.0, 4.0]


def test_a_table_without_rows_gives_a_table_without_rows(lone_folder, tmp_path):
    (tmp_path / "x.csv").write_text("f0,f1,f2\n")
    for engine in Evaluator:
        assert predict(load(lone_folder), read_table(tmp_path / "x.csv"), engine)["te"].shape == (0,)
