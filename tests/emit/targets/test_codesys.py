"""CODESYS: the XML for its importer, the text beside it, and that both say the same."""

import re

import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.project.bundle import load
from st_codegen.proof.prove.prove import prove
from st_codegen.proof.verify import verify
from st_codegen.st.errors import StSyntaxError
from st_codegen.st.syntax.source import read_paths
from tests.emit.targets.projects import written


@pytest.fixture(scope="module")
def files():
    return written(TARGETS["codesys"])


def test_the_xml_is_that_of_plcopen_but_for_tasks_and_their_places(files):
    plcopen = written(TARGETS["plcopen"])["everything.xml"]
    own = files["everything.xml"]
    changed = [(a, b) for a, b in zip(plcopen.splitlines(), own.splitlines(), strict=True) if a != b]
    assert [re.findall(r'(?:name|interval)="(\w[\w#.]*)"', line)[:2] for _, line in changed] == [
        ["Device"],
        ["Application"],
        ["PlcTask", "PT0.0005S"],
        ["SlowTask", "PT0.01S"],
    ]


def test_both_files_say_the_same_and_one_is_read(lone_folder, tmp_path):
    bundle = load(lone_folder)
    folder = generate(bundle, "codesys", tmp_path).folder
    assert {path.name for path in folder.iterdir()} == {"Models.xml", "Models.st", "st-codegen.json"}
    assert read_paths([folder]).declarations == read_paths([folder / "Models.xml"]).declarations
    assert verify(bundle, tmp_path, rows=200).passed
    report = prove(bundle, tmp_path)
    assert [result.verdict.value for result in report.results if result.model] == ["proved"] * len(bundle.models)


@pytest.mark.parametrize("name", ["Models.st", "Models.xml"])
def test_a_difference_between_the_files_is_found(lone_folder, tmp_path, name):
    folder = generate(load(lone_folder), "codesys", tmp_path).folder
    path = folder / name
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("bUsable := TRUE;", "bUsable := FALSE;", 1), encoding="utf-8")
    with pytest.raises(StSyntaxError, match=r"Models\.st:\d+:\d+ .*FB_Te is declared otherwise than in Models\.xml"):
        read_paths([folder])


def test_a_text_that_declares_more_is_found(lone_folder, tmp_path):
    folder = generate(load(lone_folder), "codesys", tmp_path).folder
    path = folder / "Models.st"
    more = "FUNCTION F_More : DINT\nF_More := 1;\nEND_FUNCTION\n"
    path.write_text(path.read_text(encoding="utf-8") + more, encoding="utf-8")
    with pytest.raises(StSyntaxError, match="F_More is declared otherwise"):
        read_paths([folder])
