"""Wrong inputs of a first day: each message has a code with a page, names what is wrong once, and changes nothing."""

import numpy as np
import pytest

from tests.cli.helpers import run

X = np.random.default_rng(0).uniform(3.0, 60.0, (80, 3))
FEATURES = ("speed_rpm", "torque_Nm", "temperature_C")
#: Files of the folder beside `te.txt`, and what the message says of them; `$MODEL` is the text of that model.
FILES = {
    "byte order mark in .txt": ({"m.txt": "\ufefftree\n"}, "m.txt: the file begins with a byte order mark"),
    "byte order mark in .json": ({"m.json": '\ufeff{"name": "gbtree"}'}, "m.json: the file begins with a byte order"),
    "empty files": ({"m.txt": "", "m2.ubj": ""}, "m.txt and m2.ubj: the file is empty: save or copy the model again"),
    "garbage in .txt": ({"m.txt": "hello"}, "m.txt: not a LightGBM text model: the first line is not 'tree'"),
    "garbage in .onnx": ({"m.onnx": "hello"}, "m.onnx: not an ONNX model"),
    "garbage in .json": ({"m.json": "{}"}, "m.json: not an XGBoost model: no object 'learner', and not CatBoost's"),
    "garbage in .ubj": ({"m.ubj": "{"}, "m.ubj: not an XGBoost model (UBJSON, byte 1: 1 byte declared, 0 left)"),
    "garbage in .skops": ({"m.skops": "PK"}, "m.skops: not a readable .skops file"),
    "garbage in .xml": ({"m.xml": "<a/>"}, "m.xml: "),
    "a model that is cut": ({"m.txt": "$HALF"}, "m.txt: the file ends inside tree"),
    "a pickle": ({"m.pkl": "x"}, "m.pkl: loading a pickle can run any code that its author put into it"),
    "two files of one stem": ({"te.json": "{}"}, "two models would be called FB_Te: te.json and te.txt; rename one"),
    "a name with umlauts": ({"kühl.txt": "$MODEL"}, "kühl.txt: model name 'kühl' contains 'ü'"),
    "a reserved word, which FB_Log is not": ({"log.txt": "$MODEL"}, None),
    "features of one name": (
        {"m.txt": "$TWICE"},
        "feature 'Speed_rpm': its input would be called fSpeed_rpm",
    ),
    "TOML that is none": ({"st-codegen.toml": "[[input\n"}, "st-codegen.toml: not readable as TOML"),
    "an unknown key": ({"st-codegen.toml": "[project]\nnmae = 'x'\n"}, "unknown key 'nmae'; did you mean 'name'?"),
    "an unknown feature": (
        {"st-codegen.toml": '[[input]]\nfeature = "spead_rpm"\n'},
        "[[input]] feature = 'spead_rpm': no model has it; did you mean 'speed_rpm'?",
    ),
    "an unknown file": ({"st-codegen.toml": '[[model]]\nfile = "tee.txt"\n'}, "no such model; did you mean 'te.txt'?"),
    "a range the wrong way round": (
        {"st-codegen.toml": '[[input]]\nfeature = "speed_rpm"\nmin = 5.0\nmax = 1.0\n'},
        "min = 5 is not below max = 1",
    ),
    "a range with one end": ({"st-codegen.toml": '[[input]]\nfeature = "speed_rpm"\nmin = 5.0\n'}, "'max' is missing"),
    "REAL": (
        {"st-codegen.toml": '[project]\nreal = "REAL"\n'},
        "real stands in [build]",
    ),
    "30 files that are no models": (
        {f"n{n}.txt": "hello" for n in range(30)},
        "n14.txt, n15.txt and 22 more: not a LightGBM text model",
    ),
}
#: Arguments behind the folder of a good model, and what the message says of them.
OPTIONS = {
    "an unknown target": (("-t", "twincta"), "no target 'twincta'; choose from"),
    "an unknown output": (("--outputs", "clas"), "'clas' is none of class, probability, decision"),
    "tables that are too large": (("--max-bytes", "10"), "the tables take"),
    "arrays that are too short": (("--max-array", "2"), "raise the limit with --max-array"),
    "suites for a target without": (
        ("-t", "iec", "--with-tests"),
        "no test suites; --with-tests goes with twincat",
    ),
    "outputs of classifiers": (
        ("--outputs", "class,probability,decision"),
        "--outputs probability, --outputs decision: without effect on models of which none is a classifier",
    ),
    "what --check shows, without it": (
        ("--stat", "--limit", "5", "--provenance"),
        "--stat, --limit, --provenance: without effect without --check; leave them out",
    ),
    "what is written, with --check": (("--check", "--force", "--explain"), "--force, --explain: without effect with"),
    "a page without --explain": (("--html", "x.html"), "--html is a page of what --explain says"),
    "an unknown profile": (("--profile", "cx9999"), "no profile 'cx9999': use one of"),
    "a profile without a name": (("--profile", ""), "no profile '': use one of"),
    "a folder without a name": (("--out", ""), "an empty text names no file and no folder"),
    "a version of no library": (("--library-version", "1.0"), "give --project library, or leave them out"),
    "a prefix that is none": (("--prefix", "1_"), "--prefix '1_': letters, digits and underscores"),
}
#: Tables for `predict`, and what the message says of them.
TABLES = {
    "a word": ("speed_rpm;torque_Nm;temperature_C\n300,5;4,x;1\n", "line 2: torque_Nm: '4,x' is not a number"),
    "a column that is missing": ("speed_rpm,torqe,temperature_C\n1,2,3\n", "no column torque_Nm; the header has"),
    "a short line": ("speed_rpm,torque_Nm,temperature_C\n300\n", "line 2: 1 value, the header has 3"),
    "nothing": ("", ""),
}


def refused(capsys, *arguments):
    """What is printed for a command that must end with exit code 2 and a code."""
    assert run(*arguments) == 2
    captured = capsys.readouterr()
    *message, last = captured.err.strip().splitlines()
    assert last.startswith("STC")
    assert last.endswith("says what to do")
    text = "\n".join(message)
    assert message
    assert "Traceback" not in text
    assert "walker" not in text
    return text


@pytest.mark.parametrize("name", FILES)
def test_files(name, lone_folder, lightgbm_text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    files, wanted = FILES[name]
    texts = {
        "$MODEL": lightgbm_text,
        "$HALF": lightgbm_text[: len(lightgbm_text) // 2],
        "$TWICE": lightgbm_text.replace("torque_Nm", "Speed_rpm"),
    }
    for file, text in files.items():
        (lone_folder / file).write_text(texts.get(text, text), encoding="utf-8")
    if wanted is None:
        assert run(lone_folder, "-q") == 0
        return
    message = refused(capsys, lone_folder)
    assert wanted in message
    if len(files) == 1:
        (file,) = files
        assert message.count(file) <= 1, message
    assert not (tmp_path / "generated").exists()


def test_names_of_all_features_of_all_models_are_told_at_once(
    lone_folder, lightgbm_text, tmp_path, monkeypatch, capsys
):
    """The first of them was told, and the next in the next run."""
    monkeypatch.chdir(tmp_path)
    for file, unit in (("a.txt", "°C"), ("b.txt", "µm")):
        text = lightgbm_text.replace("torque_Nm", f"torque_{unit}").replace("temperature_C", f"temperature_{unit}")
        (lone_folder / file).write_text(text, encoding="utf-8")
    message = refused(capsys, lone_folder)
    assert message.startswith("error: 2 problems\n  - model 'a': 2 problems\n    - feature name 'torque_°C' ")
    assert all(
        f"feature name '{name}_{unit}'" in message for name in ("torque", "temperature") for unit in ("°C", "µm")
    )
    assert not (tmp_path / "generated").exists()


def test_models_of_other_formats_beside_those_that_are_read_are_named(lone_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (lone_folder / "net.keras").write_text("")
    assert run(lone_folder) == 0
    shown = capsys.readouterr()
    assert (shown.out + shown.err).count("is not read") == 1
    assert "net.keras is not read; if it is a model: export it as .onnx (tf2onnx)" in shown.out + shown.err


@pytest.mark.parametrize("name", OPTIONS)
def test_options(name, lone_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments, wanted = OPTIONS[name]
    assert wanted in refused(capsys, lone_folder, *arguments).replace("\n", " ")
    assert not (tmp_path / "generated").exists()


@pytest.mark.parametrize("name", TABLES)
def test_tables(name, lone_folder, tmp_path, capsys):
    text, wanted = TABLES[name]
    (tmp_path / "x.csv").write_text(text)
    message = refused(capsys, "predict", lone_folder, "-i", tmp_path / "x.csv", "-o", tmp_path / "y.csv")
    assert wanted in message
    assert message.count("x.csv") == 1
    assert not (tmp_path / "y.csv").exists()


def test_folders_and_generated_code(lone_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    assert "no model files; supported are" in refused(capsys, "empty")
    (tmp_path / "m.h5").write_text("")
    assert refused(capsys, "m.h5").count("m.h5") == 1
    (tmp_path / "empty" / "net.pt").write_text("")
    assert "\n  - net.pt is not read; if it is a model: export it as .onnx (torch.onnx.export)" in refused(
        capsys, "empty"
    )
    assert "no generated files; run st-codegen generate" in refused(capsys, "prove", lone_folder, "-g", "nowhere")
    assert "Missing argument 'NEW'" in refused(capsys, "diff", "empty")
    missing = refused(capsys, "simulate", "motion", "--rig", "rig.toml")
    assert all(f"Missing option '{name}'." in missing for name in ("--models", "--profile", "--out"))
    assert "--rig" not in missing
    unused = refused(capsys, "diff", "empty", "empty", "--trust-pickle", "--features", "3")
    assert "--trust-pickle, --features: without effect on folders that are generated" in unused
    (lone_folder / "st-codegen.toml").write_text("")
    assert "is there already; --force replaces it" in refused(capsys, "init", lone_folder)
    assert run(lone_folder, "-q") == 0
    (lone_folder / "te.txt").rename(lone_folder / "other.txt")
    assert "the names te; the same models are called other now: give --block-name te, or generate again" in refused(
        capsys, "verify", lone_folder, "-g", "generated"
    )
    (lone_folder / "other.txt").rename(lone_folder / "te.txt")
    path = tmp_path / "generated" / "twincat" / "POUs" / "FB_Te.TcPOU"
    path.write_text(
        path.read_text(encoding="utf-8-sig").replace("bUsable := TRUE;", "bUsable := 1.5;", 1), encoding="utf-8"
    )
    assert "the text is not valid Structured Text" in refused(capsys, "verify", lone_folder, "-g", "generated")
    assert "changed by hand and would be overwritten" in refused(capsys, lone_folder)


def test_all_bad_values_of_options_are_named_at_once(capsys):
    """The first one was named alone, and what was missing not at all."""
    said = refused(capsys, "train", "--folds", "1", "--format", "foo", "--limit-us", "x")
    for part in ("Missing argument 'CAMPAIGN'", "'--folds': 1 is not", "'--format': 'foo' is", "'--limit-us': 'x' is"):
        assert part in said
    # without a command, too, and of a group
    said = refused(capsys, "models/", "--layout", "foo", "--max-bytes", "1,5")
    assert "'--layout': 'foo' is" in said and "'--max-bytes': '1,5' is" in said
    said = refused(capsys, "simulate", "campaign", "--samples", "0")
    assert "Missing option '--rig'" in said and "'--samples': 0 is not" in said


@pytest.mark.parametrize(
    ("given", "other", "advice"),
    [
        (("--block-name", "Wheel"), (), "--block-name Wheel"),
        (("--block-name", "Wheel"), ("--block-name", "Wheal"), "--block-name Wheel"),
        (("--block-name", "Wheel"), ("--prefix", "P2_"), "--prefix= --block-name Wheel"),
        (("--block-name", "Wheel"), ("--prefix", "P2_", "--block-name", "Wheel"), "--prefix= (none)"),
        (("--prefix", "P1_"), (), "--prefix P1_"),
        (("--prefix", "P1_"), ("--prefix", "P2_"), "--prefix P1_"),
    ],
)
def test_names_of_options_that_differ_from_those_at_generation(
    given, other, advice, lone_folder, tmp_path, monkeypatch, capsys
):
    """What is told to type is what makes the names agree."""
    monkeypatch.chdir(tmp_path)
    assert run(lone_folder, "-q", "--target", "iec", *given) == 0
    for command in ("verify", "prove"):
        message = refused(capsys, command, lone_folder, *other)
        assert "the same model" in message and message.endswith(f": give {advice}, or generate again")
    options = [word for word in advice.split() if word != "(none)"]
    assert run("verify", lone_folder, "-q", "-n", 50, *other, *options) == 0


def test_names_in_folders_that_are_no_targets_are_nobodys_matter(lone_folder, tmp_path, monkeypatch):
    """An older text that was put aside, as iec_old, refused the text beside it."""
    monkeypatch.chdir(tmp_path)
    assert run(lone_folder, "-q", "--target", "iec", "--block-name", "Old") == 0
    (tmp_path / "generated" / "iec").rename(tmp_path / "generated" / "iec_old")
    assert run(lone_folder, "-q", "--target", "iec") == 0
    assert run("verify", lone_folder, "-q", "-n", 50) == 0


def test_a_default_of_classifiers_is_none_of_the_command_line(lone_folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (lone_folder / "st-codegen.toml").write_text('[build]\noutputs = "class,probability"\n')
    assert run(lone_folder, "-q", "--target", "iec") == 0


@pytest.mark.parametrize("name", ["unfitted", "dbscan", "dictionary"])
def test_estimators(name, tmp_path, capsys):
    skops, joblib = pytest.importorskip("skops.io"), pytest.importorskip("joblib")
    from sklearn.cluster import DBSCAN
    from sklearn.linear_model import Ridge

    made, wanted = {
        "unfitted": (Ridge, "Ridge is not fitted: call fit() before saving it"),
        "dbscan": (lambda: DBSCAN().fit(X), "scikit-learn's DBSCAN is not supported"),
        "dictionary": (lambda: {"a": 1}, "this is a builtins.dict, not a model of scikit-learn"),
    }[name]
    if name == "dictionary":
        joblib.dump(made(), tmp_path / "m.pkl")
    else:
        skops.dump(made(), tmp_path / "m.skops")
    message = refused(capsys, tmp_path, "--trust-pickle")
    assert wanted in message
    assert message.count("m.pkl" if name == "dictionary" else "m.skops") == 1
