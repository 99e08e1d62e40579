"""Packages of extras: which are missing, and which are too old."""

import importlib
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from st_codegen import errors
from st_codegen.errors import MissingExtraError, extra_package, least_versions
from st_codegen.walkers.objects import from_estimator

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def asked(monkeypatch):
    """Requirements of st-codegen, and an installed package of a version."""
    required = ["click>=8.1", 'fruit-cpu>=1.30; extra == "fruit"', 'st-codegen[fruit]; extra == "all"', "other>1"]
    monkeypatch.setattr(metadata, "requires", lambda _: required)
    monkeypatch.setattr(errors, "_IMPORTED_AS", {"fruit-cpu": "fruit"})
    least_versions.cache_clear()

    def install(version):
        module = ModuleType("fruit")
        module.__version__ = version
        monkeypatch.setitem(sys.modules, "fruit", module)
        return module

    yield install
    least_versions.cache_clear()


@pytest.mark.parametrize("version", ["1.30", "1.30.0", "1.30.0+cpu", "1.31rc1", "2.0", "1.100.0", "0+unknown"])
def test_a_package_that_is_new_enough(asked, version):
    module = asked(version)
    assert extra_package("fruit", "fruit", "eating") is module


@pytest.mark.parametrize("version", ["1.29.9", "1.3.0", "0.99"])
def test_a_package_whose_rules_are_not_known_is_refused(asked, version):
    """With onnxruntime 1.27 labels of trees were others than those of the text, and nothing said so before `verify`."""
    asked(version)
    message = f"needs the package 'fruit', 1.30 or newer; {version} is installed: pip install --upgrade \"st-codegen"
    with pytest.raises(MissingExtraError, match=message):
        extra_package("fruit", "fruit", "eating")


@pytest.mark.parametrize(
    ("text", "answer", "says"),
    [
        ("import fruit_core", MissingExtraError, r"cannot be imported \(No module named 'fruit_core'\)"),
        ("raise ImportError('x.so')", MissingExtraError, r"cannot be imported \(x\.so\)"),
        (r"raise ImportError('\n\nREAD:\n\n  - a\n')", MissingExtraError, r"cannot be imported \(READ: - a\)"),
        ("raise ImportError('initialization failed') from KeyboardInterrupt()", KeyboardInterrupt, ""),
    ],
)
def test_what_cannot_be_imported_is_not_called_missing(asked, monkeypatch, tmp_path, text, answer, says):
    """Ctrl-C while onnxruntime was being imported ended with "which is not installed"."""
    (tmp_path / "fruit.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(answer, match=says or "^$"):
        extra_package("fruit", "fruit", "eating")


def test_no_requirements_and_no_version_refuse_nothing(asked, monkeypatch):
    asked("1.0")
    monkeypatch.delattr(sys.modules["fruit"], "__version__")
    assert extra_package("fruit", "fruit", "eating")
    asked("1.0")

    def no_package(_):
        raise metadata.PackageNotFoundError

    monkeypatch.setattr(metadata, "requires", no_package)
    least_versions.cache_clear()
    assert extra_package("fruit", "fruit", "eating")


def test_the_page_of_models_names_the_oldest_libraries_that_are_allowed():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    least = dict(text.split(">=") for key in ("sklearn", "lightgbm", "xgboost", "onnx") for text in extras[key])
    page = (ROOT / "docs" / "models.md").read_text()
    said = re.search(r"Needed are (.*?), or newer", page, re.DOTALL)[1]
    titles = {"lightgbm": "LightGBM", "xgboost-cpu": "XGBoost"}
    packages = ("scikit-learn", "lightgbm", "xgboost-cpu", "onnx", "onnxruntime")
    assert said.replace(" and ", ", ").split(", ") == [f"{titles.get(one, one)} {least[one]}" for one in packages]


def test_packages_are_imported_under_these_names():
    """Of a package that is asked by another name than its requirement has no version would be too old."""
    assert {"sklearn", "skops", "lightgbm", "xgboost", "onnx", "onnxruntime"} <= least_versions().keys()


@pytest.mark.parametrize(
    "name", ["lightgbm.LGBMRegressor", "xgboost.XGBRegressor", "sklearn.linear_model.LinearRegression"]
)
@pytest.mark.parametrize("is_part", [False, True])
def test_an_object_of_a_library_that_is_too_old_is_refused(monkeypatch, name, is_part):
    """Files alone were, and objects of scikit-learn: a pickle of LightGBM or XGBoost was compiled."""
    module, _, kind = name.rpartition(".")
    x = np.random.default_rng(0).random((40, 2))
    learner = getattr(importlib.import_module(module), kind)()
    estimator = make_pipeline(StandardScaler(), learner) if is_part else learner
    estimator.fit(x, x[:, 0])
    package = module.partition(".")[0]
    monkeypatch.setattr(sys.modules[package], "__version__", "0.1")
    with pytest.raises(
        MissingExtraError, match=f"compiling this model needs the package '{package}', .* or newer; 0.1"
    ):
        from_estimator(estimator, "model")
