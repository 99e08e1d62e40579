import dataclasses
import functools
import pickle
import re

import numpy as np
import pytest

from st_codegen.emit.blocks.model import feature_text
from st_codegen.errors import InputError, UntrustedFileError
from st_codegen.project.bundle import load
from st_codegen.te.harmonics import Direction, Quantity
from tests.cli.helpers import run


def test_a_folder_without_bundle_toml_gives_a_model_a_file(lone_folder):
    bundle = load(lone_folder)
    assert bundle.purpose is None
    (model,) = bundle.models
    assert model.ir.name == "te"
    assert [f.name for f in model.ir.features] == ["speed_rpm", "torque_Nm", "temperature_C"]
    assert all(f.lower is None for f in model.ir.features)
    assert model.ir.source.file == "te.txt"
    assert len(model.ir.source.digest) == len(model.ir.source.file_sha256) == 64


def test_a_single_file_may_be_given(lone_folder):
    assert load(lone_folder / "te.txt").models[0].ir.name == "te"


def test_a_model_whose_result_overflows_for_any_input_is_refused(lone_folder):
    path = lone_folder / "te.txt"
    old = re.search(r"leaf_value=(\S+)", path.read_text())[1]
    path.write_text(path.read_text().replace(old, "1e308".ljust(len(old), " ")[: len(old)], 1))
    with pytest.raises(InputError, match="'te': its numbers are so large"):
        load(lone_folder)


def test_a_bundle_has_features_ranges_and_harmonics(bundle_folder):
    bundle = load(bundle_folder)
    te = bundle.purpose.te
    assert [model.ir.name for model in bundle.models] == ["a", "b"]
    assert (te.orders, te.reduction_ratio, te.speed_feature) == ((0, 1), 81.0, 0)
    assert [(f.name, f.unit, f.lower, f.upper) for f in bundle.models[0].ir.features] == [
        ("speed_rpm", "rpm", 100.0, 1800.0),
        ("torque_Nm", "N m", 0.0, 1800.0),
        ("temperature_C", "°C", 25.0, 35.0),
    ]
    assert set(te.quantities(Direction.BACKWARD, 1)) == {Quantity.COSINE, Quantity.SINE}
    assert set(te.quantities(Direction.FORWARD, 0)) == {Quantity.AMPLITUDE}


def test_equal_ends_are_the_one_value_that_a_model_knows(bundle_folder):
    path = bundle_folder / "bundle.toml"
    path.write_text(bad(path.read_text(encoding="utf-8"), "min = 25.0", "min = 35.0"), encoding="utf-8")
    oil = load(bundle_folder).models[0].ir.features[2]
    assert (oil.lower, oil.upper) == (35.0, 35.0)
    assert feature_text(oil).startswith(
        "temperature_C, degC, limited to 35.0 only, training data said to reach from 25.0"
    )


def test_a_header_says_where_the_training_data_of_the_models_end_inside_of_the_range(bundle_folder):
    for name, ends in {"a": "[200:1700]", "b": "[150:1600]"}.items():
        file = bundle_folder / f"{name}.txt"
        file.write_text(re.sub(r"feature_infos=\S+", f"feature_infos={ends}", file.read_text(), count=1))
    path = bundle_folder / "bundle.toml"
    path.write_text(bad(path.read_text(encoding="utf-8"), "max = 1800.0", "max = 2500.0"), encoding="utf-8")
    speed, *_ = load(bundle_folder).purpose.te.features
    limited = "speed_rpm, rpm, limited to 100.0 .. 2500.0"
    assert feature_text(speed) == f"{limited}, training data said to reach from 200.0 to 1600.0 at least"
    wide = dataclasses.replace(speed, seen=(100.0, 2500.0))
    assert feature_text(wide) == limited


def test_models_with_the_same_names_in_another_order_are_reordered(bundle_folder):
    text = (bundle_folder / "a.txt").read_text()
    swapped = text.replace("feature_names=speed_rpm torque_Nm", "feature_names=torque_Nm speed_rpm")
    (bundle_folder / "a.txt").write_text(swapped)
    bundle = load(bundle_folder)
    import numpy as np

    from st_codegen.ir import reference

    x = np.array([[700.0, 300.0, 27.0]])
    a, b = (reference.evaluate(model.ir, x) for model in bundle.models)
    assert a == reference.evaluate(bundle.models[1].ir, x[:, [1, 0, 2]])
    assert a == bundle.models[0].predict(x)
    assert a != b


def bad(text, replace, by):
    assert replace in text
    return text.replace(replace, by, 1)


@pytest.mark.parametrize(
    ("replace", "by", "reason"),
    [
        ("[bundle]", "[bundel]", "unknown table \\[bundel\\]"),
        ('name = "small"', "name = 3", r"\[bundle\]: name = 3 is not a text"),
        ("reduction_ratio = 81.0", "reduction_ratio = -1.0", "reduction_ratio = -1.0 is outside"),
        ('speed_feature = "speed_rpm"', 'speed_feature = "rpm"', "none of the features"),
        (
            'directions = ["forward", "backward"]',
            'directions = ["up"]',
            "directions = 'up'; known are forward",
        ),
        ("orders = [0, 1]", "orders = [0, 1, 39]", "without a .* order 39 forward, order 39 backward"),
        ("orders = [0, 1]", "orders = [0, 1, 1]", "names an order twice"),
        ("orders = [0, 1]", "orders = [0, 1.5]", "orders = 1.5 is not a whole number"),
        ("max = 1800.0", "max = 50.0", "range 100.0 .. 50.0 is empty"),
        ("max = 1800.0", "max = inf", "is not finite"),
        ('unit = "rpm"\n', "", "'unit' is missing"),
        ('name = "torque_Nm"', 'name = "speed_rpm"', "'speed_rpm' is used twice"),
        ('name = "torque_Nm"', 'name = "or"', "reserved word"),
        ('phase = "b.txt"\n', "", "order 1 needs amplitude and phase or cosine and sine, it has amplitude"),
        (
            'amplitude = "a.txt"\nphase',
            'amplitude = "a.txt"\nsine = "b.txt"\nphase',
            "it has amplitude and phase and sine",
        ),
        (
            'direction = "forward"\norder = 0\n',
            'direction = "forward"\norder = 0\nphase = "a.txt"\n',
            "order 0 needs amplitude",
        ),
        ('direction = "forward"\norder = 0', 'direction = "forward"\norder = 7', "order 7 forward is not announced"),
        ('direction = "backward"\norder = 0', 'direction = "forward"\norder = 0', "order 0 forward is given twice"),
        ('amplitude = "a.txt"', 'amplitude = "../a.txt"', "without a path"),
        ('amplitude = "a.txt"', 'amplitude = "missing.txt"', "missing.txt: no such file"),
        ("output = 0", "output = 3", "output 3 of 'b.txt', which has 1"),
        ("output = 0", 'output = "x"', r"\[\[harmonic\]\] 4, sine: output = 'x' is not a whole number"),
        ("output = 0", "output = -1", "sine: output = -1 is outside"),
        ("output = 0", "ouput = 1", "sine: unknown key 'ouput'; did you mean 'output'"),
        ('sine = {file = "b.txt", output = 0}', "sine = 3", "sine = 3; give a file name, or"),
        ('sine = {file = "b.txt", output = 0}', "sine = {output = 0}", "sine: 'file' is missing"),
        ("[bundle]", "[[bundle]]", r"one table is wanted, not a list of tables; write \[bundle\]"),
        ("orders = [0, 1]", 'orders = ["a", {}]', "(?s)orders = 'a' is not a whole.*orders = {} is not a whole"),
        ("orders = [0, 1]", f"orders = [0, {'9' * 400}]", "a number of about 400 digits is outside"),
        ("orders = [0, 1]", f"orders = [0, {'9' * 5000}]", "not readable as TOML"),
        ("orders = [0, 1]", f"orders = {'[' * 5000}{']' * 5000}", "nested too deeply"),
        ("max = 1800.0", f"max = {'9' * 400}", "a number of about 400 digits is not finite"),
        ("[[feature]]", '[[feature]]\nname.first = "x"', "not readable as TOML"),
        ('sine = {file = "b.txt", output = 0}', 'sine = "b.txt"\nweight = 2', "unknown key 'weight'"),
        ("[[feature]]", "[[feature", "not readable as TOML"),
    ],
)
def test_what_is_wrong_with_a_bundle_is_named(bundle_folder, replace, by, reason):
    path = bundle_folder / "bundle.toml"
    path.write_text(bad(path.read_text(encoding="utf-8"), replace, by), encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        load(bundle_folder)


TERMS = """
[[term]]
direction = "forward"
order = 0
amplitude = "b.txt"

[[term]]
direction = "forward"
order = 1
cosine = "a.txt"
sine = {file = "b.txt", output = 0}

[[term]]
direction = "backward"
order = 1
cosine = "b.txt"
sine = "a.txt"

[[term]]
direction = "backward"
order = 1
cosine = "a.txt"
sine = "a.txt"
"""


@pytest.mark.parametrize("tasks", [1, 2])
def test_terms_are_added_and_proven(bundle_folder, tmp_path, tasks):
    """To a mean, to an amplitude with a phase, and twice to cosine and sine part."""
    from st_codegen.driver import generate
    from st_codegen.proof.verify import verify

    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8").replace("orders = ", f"tasks = {tasks}\norders = ")
    path.write_text(text + TERMS, encoding="utf-8")
    bundle = load(bundle_folder)
    te = bundle.purpose.te
    assert set(te.quantities(Direction.FORWARD, 1)) == {Quantity.AMPLITUDE, Quantity.PHASE}
    assert [len(te.terms(Direction.BACKWARD, 1)[q]) for q in (Quantity.COSINE, Quantity.SINE)] == [2, 2]
    for target in ("twincat", "iec"):
        generate(bundle, target, tmp_path)
    report = verify(bundle, tmp_path, rows=200)
    assert report.passed
    assert any(model.name.startswith("FB_TEPredict") for model in report.models)


@pytest.mark.parametrize(
    ("replace", "by", "reason"),
    [
        ("order = 0", "order = 7", "no harmonic of order 7 forward to add to"),
        ('amplitude = "b.txt"', 'cosine = "b.txt"', "order 0 needs amplitude, it has cosine"),
        ('sine = {file = "b.txt", output = 0}', 'phase = "b.txt"', "unknown key 'phase'"),
        ('sine = {file = "b.txt", output = 0}', "", "order 1 needs cosine and sine"),
    ],
)
def test_what_is_wrong_with_a_term_is_named(bundle_folder, replace, by, reason):
    path = bundle_folder / "bundle.toml"
    path.write_text(path.read_text(encoding="utf-8") + bad(TERMS, replace, by), encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        load(bundle_folder)


FACTORS = [
    ("order = 0\n", "order = 0\nfactor = 1.25\noffset_deg = -0.5\n"),
    ("order = 1\n", "order = 1\nfactor = 0.8\nturn_rad = 2.5\n"),
]


@pytest.mark.parametrize("terms", ["", TERMS])
def test_an_axis_has_its_own_part_of_what_models_of_several_predict(bundle_folder, tmp_path, terms):
    """A factor and an offset of the mean, a factor and a turn of amplitude and phase, and of cosine and sine part."""
    from st_codegen.driver import generate
    from st_codegen.proof.verify import verify
    from st_codegen.reconcile.models.terms import _by_bundle
    from st_codegen.te.check import harmonics

    path = bundle_folder / "bundle.toml"
    text, plain = path.read_text(encoding="utf-8") + terms, load(bundle_folder)
    for replace, by in FACTORS:
        text = text.replace(replace, by, 2)  # of both directions, not of terms
    path.write_text(text, encoding="utf-8")
    bundle = load(bundle_folder)
    if not terms:
        x = np.array([[900.0, 300.0, 30.0]])
        for direction in Direction:
            was, now = (harmonics([m.ir for m in b.models], b.purpose.te, direction, x) for b in (plain, bundle))
            c, d = (one.amplitude * np.exp(1j * one.phase) for one in (was, now))
            assert d[0, 0] == pytest.approx(1.25 * c[0, 0] - 0.5, rel=1e-12)
            assert d[0, 1] == pytest.approx(0.8 * np.exp(2.5j) * c[0, 1], rel=1e-12)
            sign = np.array([-1.0 if direction is Direction.BACKWARD else 1.0])
            assert _by_bundle(bundle, bundle.purpose.te, np.array([0, 1]), sign, x) == pytest.approx(d, rel=1e-12)
    for target in ("twincat", "iec"):
        generate(bundle, target, tmp_path)
    report = verify(bundle, tmp_path, rows=200)
    assert report.passed
    assert any(model.name.startswith("FB_TEPredict") for model in report.models)


@pytest.mark.parametrize(
    ("order", "key", "reason"),
    [
        (0, "turn_rad = 1.0", "unknown key 'turn_rad'"),
        (1, "offset_deg = 1.0", "unknown key 'offset_deg'"),
        (1, "factor = -1.0", "factor = -1.0 is outside"),
        (1, "turn_rad = 7.0", "turn_rad = 7.0 is outside"),
    ],
)
def test_what_is_wrong_with_an_axis_s_part_is_named(bundle_folder, order, key, reason):
    path = bundle_folder / "bundle.toml"
    path.write_text(bad(path.read_text(encoding="utf-8"), f"order = {order}\n", f"order = {order}\n{key}\n"))
    with pytest.raises(InputError, match=reason):
        load(bundle_folder)


@pytest.mark.parametrize("tasks", ["3", "0", "true", '"two"', "1.5"])
def test_a_number_of_tasks_is_one_or_two(bundle_folder, tasks):
    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("orders = ", f"tasks = {tasks}\norders = "), encoding="utf-8")
    with pytest.raises(InputError, match=r"tasks = .* is (outside 1 .. 2|not a whole number)"):
        load(bundle_folder)
    path.write_text(text.replace("orders = ", "tasks = 2\norders = "), encoding="utf-8")
    assert load(bundle_folder).purpose.te.tasks == 2


def test_all_problems_are_reported_at_once(bundle_folder):
    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8").replace("reduction_ratio = 81.0", "reduction_ratio = 0")
    path.write_text(
        text.replace('unit = "rpm"\n', "").replace("orders = [0, 1]", "orders = [0, 1, 3]"), encoding="utf-8"
    )
    with pytest.raises(InputError) as caught:
        load(bundle_folder)
    for part in ("3 problems", "reduction_ratio = 0 is outside", "'unit' is missing", "order 3 forward"):
        assert part in str(caught.value)


def test_a_feature_count_that_differs_from_the_bundle_is_named(bundle_folder):
    path = bundle_folder / "bundle.toml"
    extra = '[[feature]]\nname = "load"\nunit = "N"\nmin = 0\nmax = 1\n\n[[harmonic]]'
    path.write_text(path.read_text(encoding="utf-8").replace("[[harmonic]]", extra, 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"model 'a' takes 3 features .* the bundle has 4"):
        load(bundle_folder)


def test_feature_names_that_only_partly_agree_are_refused(bundle_folder):
    path = bundle_folder / "bundle.toml"
    text = path.read_text(encoding="utf-8").replace('"torque_Nm"', '"load_Nm"')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="give them the same names"):
        load(bundle_folder)


def test_duplicate_names_are_named(lone_folder, lightgbm_text):
    (lone_folder / "TE.txt").write_text(lightgbm_text)
    with pytest.raises(InputError, match=r"two models would be called FB_Te: TE\.txt and te\.txt"):
        load(lone_folder)


@pytest.mark.parametrize("name", ["größe.txt", "a*)b.txt", "a]]>b.txt", "a\nb.txt"])
def test_file_names_that_cannot_become_blocks_are_refused(tmp_path, lightgbm_text, name):
    (tmp_path / name).write_text(lightgbm_text)
    with pytest.raises(InputError, match="model name"):
        load(tmp_path)


def test_an_empty_folder_says_what_is_supported(tmp_path):
    (tmp_path / "README.md").write_text("notes")
    with pytest.raises(InputError, match=r"no model files; supported are \.onnx, \.txt"):
        load(tmp_path)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file or folder"):
        load(tmp_path / "nowhere")


@pytest.mark.parametrize("name", ["m.joblib", "m.pkl"])
def test_pickles_are_refused_unless_trusted_and_never_opened(tmp_path, name):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    (tmp_path / name).write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(UntrustedFileError, match=r"can run any code.*skops.*onnx.*--trust-pickle") as caught:
        load(tmp_path)
    assert not (tmp_path / "exploded").exists()
    assert name in str(caught.value)


@pytest.mark.parametrize("name", ["m.onnx", "m.txt", "m.json", "m.ubj", "m.skops", "m.joblib", "m.pkl"])
@pytest.mark.parametrize("content", [b"", b"hello", b"\x80\x05garbage", b"{}", b"PK\x03\x04broken", bytes(300)])
def test_damaged_files_are_input_errors_that_name_the_file(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"(?s){name}"):
        load(tmp_path, trust_pickle=True)


def test_all_bad_files_are_reported_at_once(tmp_path):
    for name in ("a.txt", "b.json", "c.onnx"):
        (tmp_path / name).write_text("no model")
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    assert all(name in str(caught.value) for name in ("a.txt", "b.json", "c.onnx", "3 problems"))


def test_skops_files_with_foreign_types_are_refused(tmp_path):
    skops = pytest.importorskip("skops.io")
    from sklearn.linear_model import Ridge

    ridge = Ridge().fit([[0.0], [1.0]], [0.0, 1.0])
    skops.dump(ridge, tmp_path / "ridge.skops")
    assert load(tmp_path).models[0].ir.source.model_class == "Ridge"
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    for function in (eval, functools.partial(exec, "raise SystemExit")):
        pipeline = make_pipeline(FunctionTransformer(function), Ridge())
        pipeline.steps[1][1].__dict__.update(ridge.__dict__)
        skops.dump(pipeline, tmp_path / "ridge.skops")
        with pytest.raises(UntrustedFileError, match=r"ridge\.skops: .*could run code: .*e(val|xec)"):
            load(tmp_path)


def test_verification_says_which_file_and_output_serves_which_order(bundle_folder, tmp_path, capsys):
    """Another output of a file is as consistent as the right one: only a reader can see it."""
    assert run(bundle_folder, "--out", tmp_path, "-t", "iec", "-q") == 0
    assert run("verify", bundle_folder, "-g", tmp_path, "--rows", 20) == 0
    shown = capsys.readouterr().err
    assert "forward: order 0 amplitude a.txt; order 1 amplitude a.txt, phase b.txt\n" in shown
    assert "backward: order 0 amplitude b.txt; order 1 cosine a.txt, sine b.txt\n" in shown


def test_a_list_of_one_table_is_one_problem(bundle_folder):
    """What stands in it is read all the same: 25 further messages said that it is missing."""
    path = bundle_folder / "bundle.toml"
    path.write_text(path.read_text().replace("[bundle]", "[[bundle]]"))
    with pytest.raises(InputError) as caught:
        load(bundle_folder)
    assert str(caught.value) == f"{path}: [[bundle]]: one table is wanted, not a list of tables; write [bundle]"
