"""Committed models, their expected text, and their outputs by the source libraries alone."""

import difflib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import UnsupportedModelError
from st_codegen.project.bundle import load
from st_codegen.proof import bounds
from st_codegen.proof.predict import read_table
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from st_codegen.st import load_project
from st_codegen.st.dialects.portable import violations
from st_codegen.st.syntax.source import read_paths

pytest.importorskip("skops")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")
pytest.importorskip("onnxruntime")

GOLDEN = Path(__file__).resolve().parents[2] / "golden"
PROJECTS = ("lone", "bundle")
#: The models of all kinds are too many kinds for the engines of the machine learning runtime.
REFUSED = {("lone", "beckhoff-ml")}
NAMES = sorted(path.stem for path in (GOLDEN / "lone" / "outputs").glob("*.csv"))


@pytest.fixture(scope="module", params=PROJECTS)
def project(request):
    return request.param, load(GOLDEN / request.param / "models")


@pytest.fixture(scope="module")
def lone():
    return {model.ir.name: model for model in load(GOLDEN / "lone" / "models").models}


@cache
def committed_code(target):
    return GeneratedCode(GOLDEN / "lone" / "generated" / target, TARGETS[target].dialect)


def texts(folder):
    return {p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8") for p in folder.rglob("*") if p.is_file()}


def difference(expected, got):
    lines = []
    for name in sorted({*expected, *got}):
        before, after = expected.get(name, "").splitlines(), got.get(name, "").splitlines()
        lines += difflib.unified_diff(before, after, f"{name} (committed)", f"{name} (generated)", lineterm="")
    return "\n".join(lines)


@pytest.mark.parametrize("target", TARGETS)
def test_the_generated_text_is_the_committed_text(project, target, tmp_path, request, capsys):
    name, bundle = project
    if (name, target) in REFUSED:
        with pytest.raises(UnsupportedModelError, match="15 problems"):
            generate(bundle, TARGETS[target], tmp_path)
        return
    committed = GOLDEN / name / "generated" / target
    expected = texts(committed)
    if request.config.getoption("--update-golden"):
        generate(bundle, TARGETS[target], committed.parent)
        with capsys.disabled():
            print(difference(expected, texts(committed)))  # noqa: T201 - what the option is for
        return
    got = texts(generate(bundle, TARGETS[target], tmp_path).folder)
    if got != expected:
        shown = difference(expected, got)
        pytest.fail(
            f"{shown[:4000]}\n\nif this is wanted: pytest tests/emit/test_golden.py --update-golden", pytrace=False
        )


def test_every_model_has_inputs_and_outputs_and_nothing_is_left_over(lone):
    inputs = sorted(path.stem for path in (GOLDEN / "lone" / "inputs").glob("*.csv"))
    assert sorted(lone) == NAMES == inputs


@pytest.mark.parametrize("target", ["twincat", "iec", "plcopen"])
@pytest.mark.parametrize("name", NAMES)
def test_the_committed_text_gives_the_librarys_outputs(name, target, lone):
    model = lone[name].ir
    x = np.column_stack(list(read_table(GOLDEN / "lone" / "inputs" / f"{name}.csv").values()))
    library = np.column_stack(list(read_table(GOLDEN / "lone" / "outputs" / f"{name}.csv").values()))
    result = committed_code(target).run_model(block_name(name), x, library.shape[1])
    assert result.valid.all()
    assert np.all(np.abs(result.values - library) <= bounds.difference_bound(model, x))
    assert model.exact == (not np.any(bounds.difference_bound(model, x)))


def test_the_installed_libraries_still_give_these_outputs(lone):
    """A library whose rule changes shows here first."""
    for name, model in lone.items():
        x = np.column_stack(list(read_table(GOLDEN / "lone" / "inputs" / f"{name}.csv").values()))
        library = np.column_stack(list(read_table(GOLDEN / "lone" / "outputs" / f"{name}.csv").values()))
        assert np.all(np.abs(model.predict(x) - library) <= bounds.difference_bound(model.ir, x)), name


def test_the_committed_text_of_each_project_passes_verification(project):
    name, bundle = project
    report = verify(bundle, GOLDEN / name / "generated", rows=400)
    assert report.passed, [model.failures[:1] for model in report.models if not model.passed]


@pytest.mark.parametrize("name", PROJECTS)
def test_the_committed_iec_text_is_portable(name):
    folder = GOLDEN / name / "generated" / "iec"
    assert violations(read_paths([folder])) == ()
    if name == "lone":
        for path in folder.glob("*.st"):
            load_project([path], "iec")  # each file stands alone


@pytest.mark.parametrize("name", PROJECTS)
def test_lines_are_short_and_ascii_and_cdata_ends_once(name):
    for path in (GOLDEN / name / "generated").rglob("*"):
        if path.suffix in (".st", ".TcPOU", ".TcDUT", ".TcGVL", ".TcTTO", ".plcproj", ".xml"):
            text = path.read_text(encoding="utf-8")
            if "Models" in path.parts:
                continue  # the vendor's format: a list of numbers is one attribute
            assert all(len(line) <= 100 or line.lstrip().startswith("<POU") for line in text.splitlines()), path
            assert text.lstrip("\ufeff").isascii(), path
            assert text.count("]]>") == text.count("<![CDATA["), path
            assert "\t" not in text
            assert not any(line != line.rstrip() for line in text.splitlines()), path
