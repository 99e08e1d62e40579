"""Committed models, their expected text, and their outputs by the source libraries alone."""

import difflib
import json
import re
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import differences, generate
from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import UnsupportedModelError
from st_codegen.project.bundle import load
from st_codegen.proof import bounds
from st_codegen.proof.predict import read_table
from st_codegen.proof.runner import GeneratedCode
from st_codegen.proof.verify import verify
from st_codegen.st import load_project
from st_codegen.st.syntax.source import read_paths
from tests.st.helpers import violations

pytest.importorskip("skops")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")
pytest.importorskip("onnxruntime")

GOLDEN = Path(__file__).resolve().parents[2] / "golden"
PROJECTS = ("lone", "bundle", "monitoring")
#: The models of all kinds are too many kinds for the engines of the machine learning runtime.
REFUSED = {("lone", "beckhoff-ml"): "15 problems", ("monitoring", "beckhoff-ml"): "3 problems"}
#: PLCopen XML takes eight lines a variable: of it one model of each layout is committed, and what surrounds the blocks
#: of the bundle, with these.
PLCOPEN_KINDS = {
    "kernel": "svr",
    "factored_kernel": "nu_svr",
    "layers": "mlp_tanh",
    "table": "decision_tree",
    "trees": "hist_gradient_boosting_category",
    "ranked_trees": "extra_trees_ranked",
    "nested_ifs": "extra_tree",
}
#: Targets of which files for single models are committed: these models of `PLCOPEN_KINDS`.
SMALL = {"codesys": ("kernel",), "scl": tuple(PLCOPEN_KINDS)}
PLCOPEN_BLOCKS = {"F_IsWithin", "FB_SelfTest", "PRG_Main"}
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


@pytest.fixture(scope="module")
def plcopen_files(tmp_path_factory):
    """The expected files below golden/plcopen, by name."""
    found = {}
    self_test = re.compile(r' {6}<pou name="FB_SelfTest".*?</pou>\n', re.S)  # once is enough
    for kind, name in PLCOPEN_KINDS.items():
        (model,) = (GOLDEN / "lone" / "models").glob(f"{name}.*")
        folder = generate(load(model), "plcopen", tmp_path_factory.mktemp(kind)).folder
        found[f"{kind}.xml"] = self_test.sub("", (folder / "Models.xml").read_text(encoding="utf-8"))
    folder = generate(load(GOLDEN / "bundle" / "models"), "plcopen", tmp_path_factory.mktemp("bundle")).folder
    blocks = re.compile(r' {6}<pou name="(\w+)".*?</pou>\n', re.S)
    whole = (folder / "golden.xml").read_text(encoding="utf-8")
    found["application.xml"] = blocks.sub(lambda match: match[0] if match[1] in PLCOPEN_BLOCKS else "", whole)
    return found


def texts(folder):
    return {p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8") for p in folder.rglob("*") if p.is_file()}


def compare(expected, got):
    if got != expected:
        shown = difference(expected, got)
        pytest.fail(
            f"{shown[:4000]}\n\nif this is wanted: pytest tests/emit/test_golden.py --update-golden", pytrace=False
        )


def difference(expected, got):
    lines = []
    for name in sorted({*expected, *got}):
        before, after = expected.get(name, "").splitlines(), got.get(name, "").splitlines()
        lines += difflib.unified_diff(before, after, f"{name} (committed)", f"{name} (generated)", lineterm="")
    return "\n".join(lines)


@pytest.mark.parametrize("target", sorted({*TARGETS} - {"plcopen", *SMALL}))
def test_the_generated_text_is_the_committed_text(project, target, tmp_path, request, capsys):
    name, bundle = project
    if (name, target) in REFUSED:
        with pytest.raises(UnsupportedModelError, match=REFUSED[name, target]):
            generate(bundle, TARGETS[target], tmp_path)
        return
    committed = GOLDEN / name / "generated" / target
    expected = texts(committed)
    if request.config.getoption("--update-golden"):
        generate(bundle, TARGETS[target], committed.parent, relayout=True)
        with capsys.disabled():
            print(difference(expected, texts(committed)))  # noqa: T201 - what the option is for
        return
    compare(expected, texts(generate(bundle, TARGETS[target], tmp_path).folder))


def test_the_generated_plcopen_files_are_the_committed_ones(plcopen_files, request, capsys):
    committed = GOLDEN / "plcopen"
    expected = texts(committed)
    if not request.config.getoption("--update-golden"):
        compare(expected, plcopen_files)
        return
    for name in expected:
        (committed / name).unlink()
    for name, text in plcopen_files.items():
        (committed / name).write_text(text, encoding="utf-8")
    with capsys.disabled():
        print(difference(expected, plcopen_files))  # noqa: T201 - what the option is for


@pytest.mark.parametrize("target", SMALL)
def test_the_generated_files_of_single_models_are_the_committed_ones(target, tmp_path, request, capsys):
    committed, made = GOLDEN / target, {}
    for kind in SMALL[target]:
        (model,) = (GOLDEN / "lone" / "models").glob(f"{PLCOPEN_KINDS[kind]}.*")
        folder = generate(load(model), target, tmp_path / kind).folder
        made |= {name: text for name, text in texts(folder).items() if not name.endswith(".json")}
    if request.config.getoption("--update-golden"):
        expected = texts(committed) if committed.is_dir() else {}
        for name in expected:
            (committed / name).unlink()
        committed.mkdir(exist_ok=True)
        for name, text in made.items():
            (committed / name).write_text(text, encoding="utf-8")
        with capsys.disabled():
            print(difference(expected, made))  # noqa: T201 - what the option is for
    compare(texts(committed), made)


@pytest.mark.parametrize(("target", "kind"), [(target, kind) for target, kinds in SMALL.items() for kind in kinds])
def test_the_committed_files_of_single_models_give_the_librarys_outputs(target, kind, lone):
    name = PLCOPEN_KINDS[kind]
    x, library = (
        np.column_stack(list(read_table(GOLDEN / "lone" / folder / f"{name}.csv").values()))
        for folder in ("inputs", "outputs")
    )
    gives(GeneratedCode(GOLDEN / target, TARGETS[target].dialect), lone[name].ir, x, library)


def test_every_layout_is_among_the_golden_models():
    layouts = json.loads((GOLDEN / "lone/generated/iec/st-codegen.json").read_text())["models"]
    assert {layouts[name]["layout"] for name in PLCOPEN_KINDS.values()} == {m["layout"] for m in layouts.values()}


@pytest.mark.parametrize("name", PROJECTS)
def test_plcopen_has_the_bodies_of_the_portable_text(name, tmp_path):
    folder = generate(load(GOLDEN / name / "models"), "plcopen", tmp_path).folder
    (path,) = folder.glob("*.xml")
    portable = "\n".join(texts(GOLDEN / name / "generated" / "iec").values())
    bodies = re.findall(r"<!\[CDATA\[\n(.*?)\]\]>", path.read_text(encoding="utf-8"), re.S)
    assert len(bodies) == len(re.findall(r"^END_(?:FUNCTION|FUNCTION_BLOCK|PROGRAM)$", portable, re.M))
    assert all(body.strip() in portable for body in bodies)


def test_every_model_has_inputs_and_outputs_and_nothing_is_left_over(lone):
    inputs = sorted(path.stem for path in (GOLDEN / "lone" / "inputs").glob("*.csv"))
    assert sorted(lone) == NAMES == inputs


@pytest.mark.parametrize("target", ["twincat", "iec"])
@pytest.mark.parametrize("name", NAMES)
def test_the_committed_text_gives_the_librarys_outputs(name, target, lone):
    model = lone[name].ir
    x = np.column_stack(list(read_table(GOLDEN / "lone" / "inputs" / f"{name}.csv").values()))
    library = np.column_stack(list(read_table(GOLDEN / "lone" / "outputs" / f"{name}.csv").values()))
    gives(committed_code(target), model, x, library)
    assert model.exact == (not np.any(bounds.difference_bound(model, x)))


def gives(code, model, x, library):
    result = code.run_model(block_name(model.name), x, library.shape[1])
    assert result.valid.all()
    assert np.all(np.abs(result.values - library) <= bounds.difference_bound(model, x))


@pytest.mark.parametrize("kind", PLCOPEN_KINDS)
def test_the_committed_plcopen_text_gives_the_librarys_outputs(kind, lone, tmp_path):
    name = PLCOPEN_KINDS[kind]
    x, library = (
        np.column_stack(list(read_table(GOLDEN / "lone" / folder / f"{name}.csv").values()))
        for folder in ("inputs", "outputs")
    )
    shutil.copy(GOLDEN / "plcopen" / f"{kind}.xml", tmp_path)
    gives(GeneratedCode(tmp_path, "iec"), lone[name].ir, x, library)


def test_the_installed_libraries_still_give_these_outputs(lone):
    """A library whose rule changes shows here first."""
    for name, model in lone.items():
        x = np.column_stack(list(read_table(GOLDEN / "lone" / "inputs" / f"{name}.csv").values()))
        library = np.column_stack(list(read_table(GOLDEN / "lone" / "outputs" / f"{name}.csv").values()))
        assert np.all(np.abs(model.predict(x) - library) <= bounds.difference_bound(model.ir, x)), name


@pytest.mark.thorough
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
    for path in [*(GOLDEN / name / "generated").rglob("*"), *(GOLDEN / "plcopen").iterdir()]:
        if path.suffix in (".st", ".TcPOU", ".TcDUT", ".TcGVL", ".TcTTO", ".plcproj", ".xml"):
            text = path.read_text(encoding="utf-8")
            if "Models" in path.parts:
                continue  # the vendor's format: a list of numbers is one attribute
            assert all(
                len(line) <= 100 or line.lstrip().startswith(("<POU", "<Implicit")) for line in text.splitlines()
            ), path
            assert text.lstrip("\ufeff").isascii(), path
            assert text.count("]]>") == text.count("<![CDATA["), path
            assert "\t" not in text
            assert not any(line != line.rstrip() for line in text.splitlines()), path


def test_the_example_of_a_users_repository_is_up_to_date(request):
    example = GOLDEN.parent / "examples" / "user_repository"
    bundle = load(example / "models")
    if request.config.getoption("--update-golden"):
        generate(bundle, "twincat", example / "plc", relayout=True, force=True)
    lines = [line for change in differences(bundle, "twincat", example / "plc") for line in change.lines()]
    assert not lines, "".join(lines) + "\nif this is wanted: pytest tests/emit/test_golden.py --update-golden"
