"""`st-codegen.toml` beside lone models, and `st-codegen init`, which writes it."""

import dataclasses
import hashlib
import re
import tomllib

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit import output
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from st_codegen.project.configuration import BUILD_KEYS, Configuration, read_configuration
from st_codegen.project.initial import initial_configuration
from st_codegen.proof.probes import operating_range
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.review import diff
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from tests.cli.helpers import run

FEATURES = ["speed_rpm", "torque_Nm", "temperature_C"]
WHOLE = """
[project]
name = "Pumps"
prefix = "P1_"
leave_out = ["notes.txt", "old_*"]
attributes = ["no_check"]

[[input]]
feature = "speed_rpm"
name = "fSpeed"
unit = "1/min"
min = 300.0
max = 1500.0

[[input]]
feature = "torque_Nm"
name = "fTorque"
min = 100.0
max = 900.0
outside = "flag"

[[model]]
file = "te.txt"
name = "Power"
layout = "trees"
outputs = [{name = "fPower_kW", unit = "kW", min = 0.0, max = 1.1}]
"""


@pytest.mark.parametrize(
    "name",
    ["/victim/Plant", "../../evil", "a/b", "a\\b", "a:b", "a*b", "a&b<c>", "CON", "nul.x", "LPT1", "a ", "a.", "."],
)
def test_a_project_is_called_as_files_can_be_on_every_system(name, lone_folder):
    """A name with a way up or a root wrote over files of others, with exit code 0."""
    (lone_folder / "st-codegen.toml").write_text(f"[project]\nname = '{name}'\n")
    with pytest.raises(InputError, match=r"project name|files have this name"):
        load(lone_folder)


def test_no_generated_file_leaves_its_folder(lone_folder, tmp_path):
    """Whatever gives a project its name, and not through the configuration alone."""
    (tmp_path / "plc").mkdir()
    bundle = dataclasses.replace(load(lone_folder), configuration=Configuration(name="../../evil"))
    for target in ("twincat", "plcopen", "codesys", "beckhoff-ml"):
        with pytest.raises(InputError, match=r"'\.\./\.\./evil\.\w+' would leave the folder"):
            generate(bundle, target, tmp_path / "plc" / "out")
    assert not list(tmp_path.rglob("*evil*"))


def test_given_names_are_taken_or_refused_but_never_others(lone_folder, tmp_path):
    """An input that was given the name of an output was called fInput_A, and its callers did not compile."""
    text = '[[input]]\nfeature = "speed_rpm"\nname = "{}"\n[[model]]\nfile = "te.txt"\noutputs = [{{name = "fA"}}]\n'
    (lone_folder / "st-codegen.toml").write_text(text.format("fA"))
    with pytest.raises(InputError, match="the input fA has the name of another variable"):
        generate(load(lone_folder), "iec", tmp_path / "out")
    (lone_folder / "st-codegen.toml").write_text(text.format("fB"))
    generate(load(lone_folder), "iec", tmp_path / "out")
    assert "fB : LREAL;" in (tmp_path / "out" / "iec" / "FB_Te.st").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[input]]\nfeature = "speed_rpm"\noutside = "clamp"\n', "outside says what is done beyond min and max"),
        ("[build]\ncycle_us = -1\n", "cycle_us = -1 is not above 0"),
        ("[project]\nreal = true\n", "real stands in [build]"),
        ('[[model]]\nfile = "te.txt"\noutputs = ["a"]\n', "write [[model.outputs]] above each"),
        ('[[model]]\nfile = "te.txt"\ngives = ["class"]\n', "te is no classifier"),
        ('[[model]]\nfile = "te.txt"\nmetrics = 5\n', "write [model.metrics]"),
        ('[[model]]\nfile = "te.txt"\n[[model]]\nfile = "te.txt"\n', "[[model]] file = 'te.txt' is there twice"),
        (
            '[[input]]\nfeature = "a"\nmin = 1\nmax = 2\n[[input]]\nfeature = "a"\n',
            "[[input]] feature = 'a' is there twice",
        ),
        (
            '[[input]]\nfeature = "a"\nfile = "te.txt"\n[[input]]\nfeature = "a"\nfile = "te.txt"\n',
            "feature = 'a', file = 'te.txt' is there twice",
        ),
        ('[[model]]\nfile = "te.txt"\noutputs = [{name = "fA"}, {name = "fA"}]\n', "two outputs have the same name"),
        ('[[input]]\nfeature = "speed_rpm"\nfile = "tee.txt"\n', "file = 'tee.txt': no such model; did you mean"),
        ('[[input]]\nfeature = "speed_rpm"\ntrained = [2.0, 1.0]\n', "trained: the lowest and the highest value"),
        ('[[input]]\nfeature = "speed_rpm"\nname = "fUNCTION"\n', "'fUNCTION' is a reserved word of a compiler"),
        ('[[input]]\nfeature = "\u00d6l"\n', "feature '\u00d6l' is not ASCII: give it a name"),
        (f'[names]\ninput = "f{"X" * 100}{{feature}}"\n', "give the feature a name in [[input]]"),
    ],
)
def test_what_has_no_effect_or_stands_elsewhere_is_said(text, said, lone_folder):
    (lone_folder / "st-codegen.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(lone_folder)
    assert said in str(caught.value) and "known are name, prefix, leave_out, attributes, real" not in str(caught.value)


@pytest.fixture
def configured(lone_folder):
    (lone_folder / "notes.txt").write_text("to do")
    (lone_folder / "old_1.txt").write_text("no model")
    (lone_folder / "st-codegen.toml").write_text(WHOLE)
    return lone_folder


@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_names_ranges_and_outputs_are_those_of_the_configuration(configured, tmp_path, target):
    bundle = load(configured)
    generated = generate(bundle, target, tmp_path)
    code = GeneratedCode(generated.folder, target)
    text = code.text("FB_P1_Power")
    assert re.search(r"fSpeed : LREAL; .*speed_rpm, 1/min, limited to 300\.0 \.\. 1500\.0", text)
    assert re.search(r"fPower_kW : LREAL; .*prediction: out1, kW", text)
    assert ("{attribute 'no_check'}" in text) == (target == "twincat")
    x = np.array([[100.0, 500.0, 30.0], [300.0, 500.0, 30.0], [600.0, 1e4, 30.0], [600.0, 500.0, 30.0]])
    got = code.call("FB_P1_Power", dict(zip(["fSpeed", "fTorque", "fTemperature_C"], x.T, strict=True)), 4)
    assert got["bValid"].all()
    assert list(got["bInRange"]) == [False, True, False, True]
    without_a_range = code.call("FB_P1_Power", {"fSpeed": np.full(3, 600.0), "fTorque": np.full(3, 500.0),
                                                "fTemperature_C": np.array([1e300, np.inf, -np.inf])}, 3)  # fmt: skip
    assert list(without_a_range["bInRange"]) == [True, False, False]
    expected = bundle.models[0].predict(np.array([[300.0, *x[0, 1:]], *x[1:]]))[:, 0]
    assert np.array_equal(got["fPower_kW"], expected)  # the first row is limited, the third is not
    assert list(got["bPlausible"]) == list((expected >= 0.0) & (expected <= 1.1))
    assert len(set(got["bPlausible"])) == 2
    assert verify(bundle, tmp_path, rows=500).passed
    assert generated.facts["models"]["P1_Power"]["layout"] != "table"


def test_the_project_has_the_name(configured, tmp_path):
    assert (generate(load(configured), "twincat", tmp_path).folder / "Pumps.plcproj").is_file()


def test_configured_blocks_are_proved_and_tested(configured, tmp_path):
    # a plausible range is a comparison of a computed number, which prove does not follow and says so
    (configured / "st-codegen.toml").write_text(WHOLE.replace(", min = 0.0, max = 1.1", ""))
    bundle = load(configured)
    folder = generate(bundle, "twincat", tmp_path, with_tests=True).folder
    (result,) = prove(bundle, tmp_path).results
    assert result.verdict is Verdict.PROVED, result.reason
    suite = (folder / "Tests" / "FB_P1_Power_Test.TcPOU").read_text(encoding="utf-8")
    assert "fbBlock.fPower_kW" in suite


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[project]", '[project]\nreal = "REAL"'), "real stands in [build]"),
        (('"fSpeed"', '"Speed"'), "f and a capital letter"),
        (('"fSpeed"', f'"fS{"p" * 100}"'), "is longer than"),
        (('"fTorque"', '"fSpeed"'), "its input would be called fSpeed"),
        (('"te.txt"', '"tee.txt"'), "did you mean 'te.txt'"),
        (('feature = "speed_rpm"', 'feature = "speed"'), "did you mean 'speed_rpm'"),
        (("max = 1500.0", "max = 15.0"), "min = 300 is not below max = 15"),
        (('layout = "trees"', 'layout = "tree"'), "did you mean 'trees'"),
        (('unit = "1/min"', "units = 3"), "did you mean 'unit'"),
        (('"P1_"', '"1_"'), "prefix = '1_'"),
        (('"no_check"', '"x\'y"'), "no name of a pragma"),
        (("outputs = [", 'outputs = [{name = "fB"}, '), "2 outputs described, it has 1"),
        (('"fPower_kW"', '"fX"'), "the output fX has the name of a variable"),
    ],
)
def test_what_is_wrong_is_named_with_the_place(configured, tmp_path, change, message):
    assert change[0] in WHOLE
    (configured / "st-codegen.toml").write_text(WHOLE.replace(*change))
    with pytest.raises(InputError, match=re.escape(message)):
        generate(load(configured), "twincat", tmp_path)


def test_a_bundle_of_transmission_error_keeps_its_own_description(bundle_folder):
    (bundle_folder / "st-codegen.toml").write_text('[build]\nlayout = "trees"\n')
    assert load(bundle_folder).configuration.build == {"layout": "trees"}
    (bundle_folder / "st-codegen.toml").write_text(WHOLE)
    with pytest.raises(InputError, match=r"bundle\.toml describes these models"):
        load(bundle_folder)


def test_build_gives_options_their_defaults(lone_folder, tmp_path, capsys):
    out = tmp_path / "plc"
    (lone_folder / "st-codegen.toml").write_text(
        f'[build]\ntarget = ["iec", "twincat"]\nout = {str(out)!r}\nlayout = "trees"\n'
    )
    assert run(lone_folder, "-q") == 0
    assert sorted(path.name for path in out.iterdir()) == ["iec", "twincat"]
    assert output.read_manifest(out / "iec").facts["models"]["te"]["layout"] != "table"
    assert run("verify", lone_folder, "-n", "50", "-q") == 0
    assert run(lone_folder, "-q", "--layout", "table", "--relayout") == 0
    assert output.read_manifest(out / "iec").facts["models"]["te"]["layout"] == "table"
    (lone_folder / "st-codegen.toml").write_text('[build]\nlayot = "trees"\n')
    assert run(lone_folder, "-q") == 2
    assert "did you mean 'layout'" in capsys.readouterr().err
    (lone_folder / "st-codegen.toml").write_text('[build]\nlayout = "tree"\n')
    assert run(lone_folder, "-q") == 2


VALUES = ["5", "-1", "1.5", "true", '"x"', '"\\u0000"', "[]", '["x"]', "[[]]", "{a = 1}", "nan", "1979-05-27", "9" * 30]


@pytest.mark.parametrize("key", sorted(BUILD_KEYS))
def test_a_value_in_build_that_its_option_does_not_take_is_refused(lone_folder, capsys, key):
    """Whatever type it has: options take texts from a command line, and some fail on anything else."""
    refused = 0
    for value in VALUES:
        (lone_folder / "st-codegen.toml").write_text(f"[build]\n{key} = {value}\n")
        code = run("prove", lone_folder, *([] if key == "out" else ["-g", lone_folder / "none"]))
        shown = capsys.readouterr().err
        assert code == 2 and "defect" not in shown
        refused += f"[build]: {key}" in shown
    assert refused >= 9


def test_reserved_words_are_refused_only_as_whole_names(lone_folder, tmp_path):
    (lone_folder / "te.txt").rename(lone_folder / "log.txt")
    folder = generate(load(lone_folder), "twincat", tmp_path).folder
    assert (folder / "POUs" / "FB_Log.TcPOU").is_file()


def test_two_files_of_one_name_are_told_with_their_suffixes(lone_folder):
    (lone_folder / "te.json").write_text("{}")
    with pytest.raises(InputError, match=r"called FB_Te: te\.json and te\.txt; rename one"):
        load(lone_folder)


def umlauts(folder):
    """A model whose file and features no compiler takes by name."""
    ensemble = pytest.importorskip("sklearn.ensemble")
    joblib = pytest.importorskip("joblib")
    pandas = pytest.importorskip("pandas")
    x = np.random.default_rng(0).uniform(3.0, 60.0, (80, 2))
    table = pandas.DataFrame(x, columns=["Öltemperatur °C", "Drehzahl"])
    folder.mkdir()
    joblib.dump(ensemble.RandomForestRegressor(3, max_depth=3, random_state=0).fit(table, x[:, 0]), folder / "kühl.pkl")
    (folder / "notes.txt").write_text("[nan: no model")
    table.to_csv(folder / "data.csv", index=False)
    return x


def test_init_writes_what_the_files_know_and_the_result_compiles(tmp_path, capsys):
    folder = tmp_path / "models"
    x = umlauts(folder)
    with pytest.raises(InputError, match=r"use printable ASCII characters only, or give it a name in st-codegen\.toml"):
        load(folder, trust_pickle=True)
    assert run("init", folder, "--trust-pickle", "--training-data", folder / "data.csv") == 0
    content = tomllib.loads((folder / "st-codegen.toml").read_text(encoding="utf-8"))
    assert content["project"] == {"name": "Models", "leave_out": ["notes.txt"]}
    assert content["input"][0] == {
        "feature": "Öltemperatur °C",
        "name": "fInput_Oeltemperatur_degC",
        "unit": "",
        "trained": [x[:, 0].min(), x[:, 0].max()],
    }
    (entry,) = content["model"]
    assert entry.pop("training_sha256") == hashlib.sha256((folder / "data.csv").read_bytes()).hexdigest()
    assert entry == {"file": "kühl.pkl", "name": "Kuehl", "outputs": [{"name": "fOut1", "unit": ""}]}
    bundle = load(folder, trust_pickle=True)
    generated = generate(bundle, "twincat", tmp_path / "out")
    assert "FB_Kuehl" in generated.facts["blocks"]
    assert verify(bundle, tmp_path / "out", rows=300).passed
    low, high = operating_range(bundle.models[0].ir)
    assert np.array_equal([low, high], [x.min(axis=0), x.max(axis=0)])
    (folder / "st-codegen.toml").write_text("# ours\n")
    assert run("init", folder) == 2
    assert "is there already" in capsys.readouterr().err
    assert run("init", folder, "--force", "--trust-pickle") == 0
    assert "# ours" not in (folder / "st-codegen.toml").read_text(encoding="utf-8")


def test_trust_does_not_reach_what_is_left_out_and_that_is_said(lone_folder, tmp_path, capsys):
    """`init` leaves pickles out that nobody trusted then, and `generate --trust-pickle` went on without them."""
    (lone_folder / "old.pkl").write_bytes(b"x")
    assert run("init", lone_folder) == 0
    assert run(lone_folder, "--out", tmp_path / "out") == 0
    assert "old.pkl" not in capsys.readouterr().err.split("complete names")[-1]
    assert run(lone_folder, "--out", tmp_path / "out", "--trust-pickle", "-q") == 0
    assert "--trust-pickle: leave_out of st-codegen.toml leaves out old.pkl" in capsys.readouterr().err


def test_a_range_of_a_file_is_that_of_the_model_trained_last(lone_folder, capsys):
    assert run("init", lone_folder) == 0
    assert "trained" not in (lone_folder / "st-codegen.toml").read_text(encoding="utf-8")
    path = lone_folder / "te.txt"
    text = path.read_text(encoding="utf-8")
    again = re.sub(r"feature_infos=\[\S+", "feature_infos=[3:4]", text)
    assert again != text
    path.write_text(again, encoding="utf-8")
    assert load(lone_folder).irs[0].features[0].seen == (3.0, 4.0)


def test_init_wants_models_that_nothing_else_describes(bundle_folder, lone_folder, tmp_path, capsys):
    assert run("init", tmp_path / "none") == 2
    assert "none: no such folder" in capsys.readouterr().err
    assert run("init", bundle_folder) == 2
    assert "bundle.toml describes these models" in capsys.readouterr().err
    (tmp_path / "notes.txt").write_text("to do")
    assert run("init", tmp_path) == 2
    assert "no model files; supported are" in (shown := capsys.readouterr().err) and "- notes.txt: " in shown
    (tmp_path / "data.csv").write_text("speed_rpm,torque_Nm\n1,2\n")
    assert run("init", lone_folder, "--training-data", tmp_path / "data.csv") == 2
    assert "no column 'temperature_C'; there are speed_rpm, torque_Nm" in capsys.readouterr().err


def test_init_names_two_files_of_one_stem_apart(lone_folder, tmp_path):
    (lone_folder / "TE.lgb.txt").write_text((lone_folder / "te.txt").read_text())
    (lone_folder / "te-lgb.txt").write_text((lone_folder / "te.txt").read_text())
    (lone_folder / "st-codegen.toml").write_text(initial_configuration(lone_folder))
    assert len(load(lone_folder).models) == 3


def test_what_is_said_of_one_model_stands_in_the_place_of_what_is_said_of_all(lone_folder):
    """Whichever comes first in the file."""
    of_all = '[[input]]\nfeature = "speed_rpm"\nunit = "1/min"\n'
    of_one = '[[input]]\nfeature = "speed_rpm"\nfile = "te.txt"\nmin = 2.0\nmax = 4.0\n'
    for text in (of_all + of_one, of_one + of_all):
        (lone_folder / "st-codegen.toml").write_text(text)
        assert load(lone_folder).models[0].ir.features[0].checked == (2.0, 4.0)


def test_init_names_the_inputs_of_a_model_apart(tmp_path):
    """Features that differ in case, in letters that Structured Text lacks, or behind the longest name."""
    skops, linear = pytest.importorskip("skops.io"), pytest.importorskip("sklearn.linear_model")
    x, long = np.random.default_rng(1).uniform(3.0, 60.0, (20, 10)), "x" * 47
    names = ["T", "t", "压力", "温度", "", " ", f"{long}a", f"{long}A", f"{long}bc", f"{long}bd"]
    (folder := tmp_path / "models").mkdir()
    model = linear.LinearRegression().fit(x, x[:, 0])
    model.feature_names_in_ = np.array(names, object)
    skops.dump(model, folder / "linear.skops")
    skops.dump(linear.LinearRegression().fit(x[:, :1], x[:, 0]), folder / "other.skops")
    assert run("init", folder) == 0
    text = (folder / "st-codegen.toml").read_text(encoding="utf-8")
    assert text.count('name = "fT"') == 1  # the first keeps what it would be called by itself
    assert run(folder, "--out", tmp_path / "out") == 0


def test_init_describes_the_outputs_that_are_there_unasked(tmp_path, capsys):
    """It described the deviation of a Gaussian process too, and `generate` refused the file that `init` had written."""
    skops, processes = pytest.importorskip("skops.io"), pytest.importorskip("sklearn.gaussian_process")
    from sklearn.decomposition import PCA

    x = np.random.default_rng(1).uniform(3.0, 60.0, (20, 2))
    (folder := tmp_path / "models").mkdir()
    skops.dump(processes.GaussianProcessRegressor(alpha=0.1, optimizer=None).fit(x, x[:, 0]), folder / "gpr.skops")
    skops.dump(PCA(2).fit(x), folder / "pca.skops")
    assert run("init", folder) == 0
    assert [len(model.ir.outputs) for model in load(folder).models] == [1, 2]
    path = folder / "st-codegen.toml"
    path.write_text(path.read_text().replace('{name = "fOut1", unit = ""}]', '{name = "fOut1"}, {name = "fOut2"}]', 1))
    capsys.readouterr()
    assert run(folder, "--out", tmp_path / "out") == 2
    assert "model 'gpr': 2 outputs described, it has 1 (mean)" in (shown := capsys.readouterr().err)
    assert "STC1306" in shown


def test_init_writes_what_can_be_read_whatever_files_are_called(lone_folder):
    for name in ("e\x1bscape.txt", "be\x07ll.onnx", "größe.json"):
        (lone_folder / name).write_text("no model")
    (lone_folder / "st-codegen.toml").write_text(initial_configuration(lone_folder), encoding="utf-8")
    assert len(load(lone_folder).models) == 1


def test_a_range_is_claimed_only_where_it_is_known(lone_folder, tmp_path, capsys):
    joblib, tree = pytest.importorskip("joblib"), pytest.importorskip("sklearn.tree")
    x = np.random.default_rng(1).uniform(3.0, 60.0, (50, 1))
    joblib.dump(tree.DecisionTreeRegressor(max_depth=2).fit(x, x[:, 0]), lone_folder / "guess.pkl")
    bundle = load(lone_folder, trust_pickle=True)
    facts = generate(bundle, "twincat", tmp_path / "a").facts["models"]
    assert [f["range_from"] for f in facts["te"]["features"]] == ["training data"] * 3
    assert facts["guess"]["features"][0]["range_from"] == "guess from the model's numbers"
    seen = bundle.models[1].ir.features[0].seen
    assert 100 <= seen[0] < seen[1] <= 1800
    text = (tmp_path / "a/twincat/POUs/FB_Te.TcPOU").read_text(encoding="utf-8")
    assert re.search(r"speed_rpm, training data said to reach from \d", text)
    assert "training data" not in (tmp_path / "a/twincat/POUs/FB_Guess.TcPOU").read_text(encoding="utf-8")
    # the guess moves with the model: that is no change of a feature
    joblib.dump(tree.DecisionTreeRegressor(max_depth=2).fit(x + 1, x[:, 0]), lone_folder / "guess.pkl")
    generate(load(lone_folder, trust_pickle=True), "twincat", tmp_path / "b")
    (changed,) = [m for m in diff(tmp_path / "a", tmp_path / "b", rows=50).models if m.changed]
    assert (changed.name, [c.what for c in changed.facts if c.what == "features"]) == ("guess", [])


def test_no_configuration_changes_nothing(lone_folder):
    assert read_configuration(lone_folder) == read_configuration(lone_folder / "te.txt")
    assert not read_configuration(lone_folder).describes_models


def test_a_range_from_a_file_is_what_the_data_reach_at_least(tmp_path):
    """LightGBM draws some rows for its bins; numbers of the others lie outside of the range in its file."""
    lightgbm = pytest.importorskip("lightgbm")
    x = np.linspace(0.0, 1.0, 2000)
    x[::4] *= 100.0
    settings = {"verbose": -1, "bin_construct_sample_cnt": 100, "data_random_seed": 1}
    lightgbm.train(settings, lightgbm.Dataset(x[:, None], x), 2).save_model(tmp_path / "wide.txt")
    bundle = load(tmp_path)
    low, high = bundle.irs[0].features[0].seen
    assert low in x and high in x and high < x.max()
    text = (generate(bundle, "iec", tmp_path / "out").folder / "FB_Wide.st").read_text()
    assert re.search(r"training data said to reach from \S+ to \S+ at least", text)


def test_names_from_the_command_line_hold_for_all_commands(lone_folder, tmp_path, capsys):
    out = tmp_path / "out"
    options = ("--prefix", "P2_", "--block-name", "Cooling")
    assert run(lone_folder / "te.txt", *options, "--out", out, "-q") == 0
    assert (out / "twincat" / "POUs" / "FB_P2_Cooling.TcPOU").is_file()
    assert run("verify", lone_folder / "te.txt", *options, "--generated", out, "-n", "50", "-q") == 0
    assert run("prove", lone_folder / "te.txt", *options, "--generated", out, "-q") == 0
    capsys.readouterr()
    assert run("verify", lone_folder / "te.txt", "--generated", out, "-n", "50", "-q") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "the same models are called te now: give --block-name P2_Cooling, or generate again" in said
    assert load(lone_folder / "te.txt", block_name="FB_Other").irs[0].name == "Other"


def test_a_prefix_takes_the_place_of_the_configured_one(configured):
    assert [model.name for model in load(configured, prefix="X_").irs] == ["X_Power"]
    assert [model.name for model in load(configured, prefix="").irs] == ["Power"]
    assert [model.name for model in load(configured, block_name="Heat").irs] == ["P1_Heat"]


@pytest.mark.parametrize(
    ("options", "message"), [({"prefix": "1_"}, "--prefix '1_': letters"), ({"block_name": "a\u00e4"}, "model name")]
)
def test_names_that_cannot_be_are_refused(lone_folder, options, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load(lone_folder, **options)


def test_a_block_name_is_for_one_model(lone_folder, lightgbm_text, bundle_folder):
    (lone_folder / "second.txt").write_text(lightgbm_text)
    with pytest.raises(InputError, match="for a single model, and there are 2"):
        load(lone_folder, block_name="X")
    with pytest.raises(InputError, match="names its blocks itself"):
        load(bundle_folder, prefix="P_")
    with pytest.raises(InputError, match="models from memory"):
        load({}, block_name="X")


RULES = '[names]\ninput = "fIn_{feature}"\noutput = "fResult{number}"\n'


def test_rules_name_what_is_given_no_name(lone_folder, tmp_path):
    text = f'{RULES}\n[[input]]\nfeature = "speed_rpm"\nname = "fSpeed"\n'
    (lone_folder / "st-codegen.toml").write_text(text)
    bundle = load(lone_folder)
    assert [feature.variable for feature in bundle.irs[0].features] == ["fSpeed", "fIn_Torque_Nm", "fIn_Temperature_C"]
    assert bundle.irs[0].variables == ("fResult1",)
    generate(bundle, "twincat", tmp_path)
    assert verify(bundle, tmp_path, rows=50).passed


def test_a_name_of_an_output_goes_before_the_rule(configured):
    path = configured / "st-codegen.toml"
    path.write_text(f"{path.read_text()}\n{RULES}")
    assert load(configured).irs[0].variables == ("fPower_kW",)


@pytest.mark.parametrize(
    "rule", ['input = "{feature}"', 'input = "fX"', 'output = "f{feature}"', 'output = "f{number} "']
)
def test_rules_that_make_no_names_are_refused(lone_folder, rule):
    (lone_folder / "st-codegen.toml").write_text(f"[names]\n{rule}\n")
    with pytest.raises(InputError, match="f, a capital letter and what follows it"):
        load(lone_folder)
    (lone_folder / "st-codegen.toml").write_text("[names]\nother = 1\n")
    with pytest.raises(InputError, match="other"):
        load(lone_folder)


def ranges_of(folder):
    (model,) = load(folder).models
    return [feature.seen for feature in model.ir.features]


def test_no_configuration_takes_back_what_a_file_knows_of_its_training_data(lone_folder):
    known = ranges_of(lone_folder)
    (lone_folder / "st-codegen.toml").write_text(
        '[[input]]\nfeature = "speed_rpm"\nname = "fSpeed"\ntrained = [900.0, 1e4]\n'
    )
    assert ranges_of(lone_folder) == [(known[0][0], 1e4), *known[1:]]


def test_init_refuses_a_table_that_a_model_was_not_trained_with(lone_folder, tmp_path, capsys):
    known = ranges_of(lone_folder)
    names = ("speed_rpm", "torque_Nm", "temperature_C")
    table = tmp_path / "rows.csv"

    def init_with(ends):
        rows = [",".join(f"{end[n]:.7g}" for end in ends) for n in range(len(ends[0]))]
        table.write_text("\n".join([",".join(names), *rows]) + "\n")
        return run("init", lone_folder, "--training-data", table)

    middle = (known[0][0], (known[0][0] + known[0][1]) / 2)
    assert init_with([middle, known[1], known[2]]) == 2
    said = capsys.readouterr().err
    assert "column 'speed_rpm' reaches" in said
    assert "te.txt was trained with" in said
    assert "torque_Nm" not in said
    assert not (lone_folder / "st-codegen.toml").exists()
    # a missing number that LightGBM read as 0, as it does with use_missing=false
    text = (lone_folder / "te.txt").read_text()
    low, high = known[1]
    infos = re.search(r"feature_infos=(.*)", text)[1].split()
    infos[1] = f"[{low - high}:0]"
    (lone_folder / "te.txt").write_text(re.sub(r"feature_infos=.*", f"feature_infos={' '.join(infos)}", text))
    shifted = [known[0], (low - high, -50.0), known[2]]
    assert init_with(shifted) == 2
    assert "column 'torque_Nm' reaches" in capsys.readouterr().err
    assert init_with([shifted[0], (float("nan"),) * 2, shifted[2]]) == 2
    assert "column 'torque_Nm' has no finite number, and te.txt was trained" in capsys.readouterr().err
    with_gap = [(*ends, ends[1]) for ends in shifted]
    with_gap[1] = (*shifted[1], float("nan"))
    assert init_with(with_gap) == 0


def test_a_table_may_have_columns_in_words_that_no_model_reads(lone_folder, tmp_path, capsys):
    """Training data have what is to be predicted, too: the labels of a classifier were refused as no numbers."""
    known, table = ranges_of(lone_folder), tmp_path / "rows.csv"
    rows = [f"{','.join(map(str, ends))},hot,2026-11-30" for ends in zip(*known, strict=True)]
    table.write_text("\n".join(["speed_rpm,torque_Nm,temperature_C,state,day", *rows]) + "\n")
    assert run("init", lone_folder, "--training-data", table) == 0
    assert ranges_of(lone_folder) == known
    assert run("predict", lone_folder, "-e", "reference", "-i", table, "-o", tmp_path / "y.csv") == 0
    table.write_text(table.read_text().replace("speed_rpm", "speed"))
    assert run("predict", lone_folder, "-e", "reference", "-i", table, "-o", tmp_path / "y.csv") == 2
    assert "the header has speed, torque_Nm, temperature_C, state, day" in capsys.readouterr().err


def test_init_claims_no_range_of_infinite_or_missing_values_and_no_table_without_rows(lone_folder, tmp_path, capsys):
    known, table = ranges_of(lone_folder), tmp_path / "rows.csv"
    header = "speed_rpm,torque_Nm,temperature_C\n"
    table.write_text(header)
    assert run("init", lone_folder, "--training-data", table) == 2
    assert "no rows below its header" in capsys.readouterr().err
    assert not (lone_folder / "st-codegen.toml").exists()
    table.write_text(header + "".join(f"{speed},{torque},nan\n" for speed, torque in zip(*known[:2], strict=True)))
    text = (lone_folder / "te.txt").read_text()
    infos = re.search(r"feature_infos=(.*)", text)[1].split()
    (lone_folder / "te.txt").write_text(text.replace(" ".join(infos), f"{infos[0]} {infos[1]} none"))
    with table.open("a") as file:
        file.write(f"-inf,{known[1][0]},nan\n")
    assert run("init", lone_folder, "--training-data", table) == 0
    written = (lone_folder / "st-codegen.toml").read_text(encoding="utf-8")
    assert written.count("trained = ") == 1
    assert "# no range: 1 of 3 values infinite" in written
    assert "# no range: no value is there" in written
    assert ranges_of(lone_folder) == [known[0], known[1], None]


def test_a_range_that_only_flags_is_not_said_to_limit(lone_folder, tmp_path):
    (lone_folder / "st-codegen.toml").write_text(
        '[[input]]\nfeature = "speed_rpm"\nmin = 900.0\nmax = 1e4\noutside = "flag"\n'
    )
    text = (generate(load(lone_folder), "iec", tmp_path).folder / "FB_Te.st").read_text()
    assert "bInside" in text
    assert "had to be limited" not in text


def test_header_has_the_training_data_and_the_metrics_that_are_given(lone_folder, tmp_path):
    digest = "5f" * 32
    (lone_folder / "st-codegen.toml").write_text(
        f'[[model]]\nfile = "te.txt"\ntraining_sha256 = "{digest}"\nmetrics = {{"MAE, kW" = 0.21, R2 = 0.983}}\n'
    )
    text = (generate(load(lone_folder), "iec", tmp_path).folder / "FB_Te.st").read_text()
    assert f"Training data given: SHA-256 {digest}" in text
    assert "Metrics, as given: MAE, kW 0.21; R2 0.983" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('training_sha256 = "5f1c"', "64 digits"),
        ('metrics = {"*)" = 1.0}', "would break the generated file"),
        ('metrics = {MAE = "small"}', "is not a number"),
        ("metrics = 0.2", "is not a table"),
    ],
)
def test_what_cannot_stand_in_a_header_is_refused(line, message, lone_folder):
    (lone_folder / "st-codegen.toml").write_text(f'[[model]]\nfile = "te.txt"\n{line}\n')
    with pytest.raises(InputError, match=re.escape(message)):
        load(lone_folder)


NAMED = """
[[model]]
file = "log.skops"
gives = ["class", "probability"]
outputs = [{name = "nState"}, {name = "fDry", unit = "1"}]
"""


@pytest.fixture
def classifier(tmp_path):
    """A classifier called as a function is, whose scores have no finite bound for the largest inputs."""
    linear, io = pytest.importorskip("sklearn.linear_model"), pytest.importorskip("skops.io")
    rows = np.random.default_rng(0).random((90, 2))
    folder = tmp_path / "models"
    folder.mkdir()
    io.dump(
        linear.LogisticRegression().fit(rows, np.array(["dry", "worn"])[(rows[:, 0] * 2).astype(int)]),
        folder / "log.skops",
    )
    (folder / "st-codegen.toml").write_text(NAMED)
    return folder


def test_outputs_of_a_classifier_have_the_names_that_are_given(classifier, tmp_path):
    bundle, out = load(classifier), tmp_path / "out"
    generate(bundle, "twincat", out, with_tests=True, with_comparison=True)
    assert verify(bundle, out, rows=100).passed
    assert [result.verdict for result in prove(bundle, out).results] == [Verdict.PROVED]
    texts = {path.name: path.read_text(encoding="utf-8-sig") for path in out.rglob("*.Tc*")}
    declared = re.findall(
        r"^    (\w+) : (\w+);", texts["FB_Log.TcPOU"].split("VAR_OUTPUT")[1].split("END_VAR")[0], re.M
    )
    assert declared == [("nState", "DINT"), ("fDry", "LREAL"), ("fOut2", "LREAL"), ("bValid", "BOOL")]
    assert "its output nState." in texts["E_LogClass.TcDUT"]
    for text in (texts["FB_Log_Test.TcPOU"], texts["PRG_Comparison.TcPOU"]):
        assert re.search(r"DINT_TO_LREAL\(fbBlock1?\.nState\)", text) and "nClass" not in text


def test_a_classifier_whose_name_is_another_now_is_told_how_to_be_called(classifier, tmp_path, capsys):
    """It was said to have one output in place of the two that `gives` names: the folder knows no model of that name."""
    assert run(classifier, "--out", tmp_path / "out", "-q") == 0
    capsys.readouterr()
    assert run("verify", classifier, "--prefix", "Q_", "--generated", tmp_path / "out", "-n", "50", "-q") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "the same models are called Q_log now: give --prefix= (none), or generate again" in said


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"nState"', '"fState"', "fState is the number of a class; its name begins with n"),
        ('"fDry"', '"nDry"', "nDry is a number; its name begins with f"),
        ('"fDry"', '"fOut2"', "two outputs have the same name; they are nState, fOut2, fOut2"),
        ('unit = "1"', "min = 0.0, max = 1.0", "the outputs of a classifier have no min and max"),
        ('["class", "probability"]', '["class"]', r"2 outputs described, it has 1 \(class\); --outputs or gives adds"),
        ('"nState"', '"nAge"', "name = 'nAge' is an output that blocks may have for something else"),
        ('"nState"', '"state"', "name = 'state': f, for the number of a class n, and a capital letter"),
    ],
)
def test_wrong_names_of_a_classifiers_outputs_are_refused(classifier, old, new, message):
    path = classifier / "st-codegen.toml"
    assert old in NAMED
    path.write_text(NAMED.replace(old, new))
    with pytest.raises(InputError, match=message):
        load(classifier)


def test_what_init_leaves_out_has_its_reason_once_and_is_said(lone_folder, capsys):
    (lone_folder / "notes.txt").write_text("hello")
    assert run("init", lone_folder) == 0
    text = (lone_folder / "st-codegen.toml").read_text()
    assert "    \"notes.txt\",  # not a LightGBM text model: the first line is not 'tree'\n" in text
    said = " ".join(capsys.readouterr().err.split())
    assert said.startswith("left out, with the reason beside each in ") and "st-codegen.toml: notes.txt " in said


def test_init_writes_no_empty_list(lone_folder):
    assert run("init", lone_folder) == 0
    assert "leave_out" not in (lone_folder / "st-codegen.toml").read_text()
