"""Fixtures that many tests share, and the option that updates golden files."""

import gc
from functools import cache

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from tests.examples import register
from tests.reading import remembered

register()


@pytest.fixture(scope="session", autouse=True)
def texts_read_once():
    """Structured Text is read once; the tests of what reads it, in `st/`, read each time."""
    with remembered():
        yield


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="rewrite the expected files in golden/ and show what changes (see tests/emit/test_golden.py)",
    )


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is imported and collected lives to the end: nobody looks through it for what could go, a third of that time.

    Trees of texts are many small objects that do not refer to themselves, so the search for circles may be rarer.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000, 20, 10)
        gc.enable()


def small_lightgbm(rows, leaves, trees):
    """A LightGBM model of the features of a rig, as text."""
    lightgbm = pytest.importorskip("lightgbm")
    random = np.random.default_rng(0)
    x = random.uniform([100, 0, 25], [1800, 1800, 35], size=(rows, 3))
    y = np.sin(x[:, 0] / 300) + x[:, 1] * 1e-3
    data = lightgbm.Dataset(x, y, feature_name=["speed_rpm", "torque_Nm", "temperature_C"])
    return lightgbm.train({"verbose": -1, "num_leaves": leaves, "num_threads": 1}, data, trees).model_to_string()


@pytest.fixture(scope="session")
def lightgbm_text():
    """A small LightGBM model as text."""
    return small_lightgbm(rows=300, leaves=7, trees=5)


BUNDLE = """
[bundle]
name = "small"
reduction_ratio = 81.0
speed_feature = "speed_rpm"
directions = ["forward", "backward"]
orders = [0, 1]

[[feature]]
name = "speed_rpm"
unit = "rpm"
min = 100.0
max = 1800.0

[[feature]]
name = "torque_Nm"
unit = "N m"
min = 0.0
max = 1800.0

[[feature]]
name = "temperature_C"
unit = "°C"
min = 25.0
max = 35.0

[[harmonic]]
direction = "forward"
order = 0
amplitude = "a.txt"

[[harmonic]]
direction = "forward"
order = 1
amplitude = "a.txt"
phase = "b.txt"

[[harmonic]]
direction = "backward"
order = 0
amplitude = "b.txt"

[[harmonic]]
direction = "backward"
order = 1
cosine = "a.txt"
sine = {file = "b.txt", output = 0}
"""


def write_bundle(folder, lightgbm_text):
    """A transmission error bundle of two models."""
    folder.mkdir()
    (folder / "a.txt").write_text(lightgbm_text)
    (folder / "b.txt").write_text(lightgbm_text)
    (folder / "bundle.toml").write_text(BUNDLE, encoding="utf-8")
    return folder


def write_lone(folder, lightgbm_text):
    """A folder with one LightGBM text file and nothing else."""
    folder.mkdir()
    (folder / "te.txt").write_text(lightgbm_text)
    return folder


@pytest.fixture
def bundle_folder(tmp_path, lightgbm_text):
    return write_bundle(tmp_path / "models", lightgbm_text)


@pytest.fixture
def lone_folder(tmp_path, lightgbm_text):
    return write_lone(tmp_path / "lone", lightgbm_text)


@pytest.fixture(scope="session")
def generated_once(tmp_path_factory, lightgbm_text):
    """Generates the `"bundle"` or the `"lone"` model for targets, once with these options; returns the folder.

    Nobody changes it: a test that needs other text changes a copy.
    """
    folder = tmp_path_factory.mktemp("generated")
    bundles = {
        "bundle": load(write_bundle(folder / "bundle", lightgbm_text)),
        "lone": load(write_lone(folder / "lone", lightgbm_text)),
    }

    @cache
    def generated(name, targets=tuple(TARGETS), layout=Layout.AUTO, **options):
        out = tmp_path_factory.mktemp("out")
        for target in targets:
            generate(bundles[name], target, out, options=Options(layout), **options)
        return out

    return generated
