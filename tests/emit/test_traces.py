"""Generated files that editors, version control and engineers have touched."""

import re

import pytest

from st_codegen.driver import check, generate
from st_codegen.emit.traces import without_traces
from st_codegen.errors import InputError
from st_codegen.project.bundle import load
from tests.cli.helpers import run, snapshot

BLOCK = "POUs/FB_Te.TcPOU"
LINE_IDS = """    <LineIds Name="FB_Te">
      <LineId Id="3" Count="25" />
      <LineId Id="2" Count="0" />
    </LineIds>
"""


def saved_in_xae(folder):
    """What the development environment makes of the files when it saves them."""
    block = folder / BLOCK
    text = block.read_text(encoding="utf-8-sig")
    text = text.replace('Version="1.1.0.1"', 'Version="1.1.0.1" ProductVersion="3.1.4024.12"')
    text = re.sub(r' Id="\{[^}]*\}"', ' Id="{0F1E2D3C-0000-4444-8888-123456789ABC}"', text)
    text = text.replace("  </POU>", f"{LINE_IDS}  </POU>")
    block.write_text(text, encoding="utf-8", newline="\r\n")
    project = folder / "Models.plcproj"
    guid = "{d2b27ef5-3a1c-4f7b-9d9f-8e2a51b2c3d4}"
    added = f"    <ProgramVersion>3.1.4024.0</ProgramVersion>\n    <TypeSystem>{guid}</TypeSystem>\n"
    text = project.read_text(encoding="utf-8").replace("    <Name>", f"{added}    <Name>")
    project.write_text("\ufeff" + text, encoding="utf-8", newline="\r\n")


def test_what_the_development_environment_leaves_is_no_difference_and_stays(lone_folder, tmp_path):
    bundle = load(lone_folder)
    folder = generate(bundle, "twincat", tmp_path).folder
    fresh = (folder / BLOCK).read_bytes()
    saved_in_xae(folder)
    before = snapshot(folder)
    assert before[BLOCK] != fresh
    assert list(check(bundle, "twincat", tmp_path)) == []
    generate(bundle, "twincat", tmp_path)
    assert snapshot(folder) == before


def test_a_retrained_model_replaces_a_file_that_has_only_traces(lone_folder, lightgbm_text, tmp_path):
    folder = generate(load(lone_folder), "twincat", tmp_path / "one").folder
    saved_in_xae(folder)
    (lone_folder / "te.txt").write_text(other_model(lightgbm_text))
    bundle = load(lone_folder)
    generate(bundle, "twincat", tmp_path / "one")
    other = generate(bundle, "twincat", tmp_path / "other").folder
    assert (folder / BLOCK).read_bytes() == (other / BLOCK).read_bytes()


def other_model(text):
    """The model with another leaf of the same length."""
    leaf = re.search(r"leaf_value=(\S+)", text)[1]
    return text.replace(leaf, leaf[:-1] + ("1" if leaf[-1] != "1" else "2"), 1)


def test_a_change_by_hand_is_shown_and_not_overwritten(lone_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(lone_folder, "--out", out) == 0
    block = out / "twincat" / BLOCK
    changed = block.read_text(encoding="utf-8").replace("bUsable := TRUE;", "bUsable := bEnable;", 1)
    assert "bEnable" in changed
    block.write_text(changed, encoding="utf-8")
    before = snapshot(out)
    capsys.readouterr()
    assert run(lone_folder, "--out", out) == 2
    message = capsys.readouterr().err
    assert f"1 generated file was changed by hand and would be overwritten: {block}" in message
    assert "-    bUsable := bEnable;" in message.replace("-bUsable", "-    bUsable")
    assert "--force" in message
    assert snapshot(out) == before
    assert run(lone_folder, "--out", out, "--force") == 0
    assert "bEnable" not in block.read_text(encoding="utf-8")


def test_a_change_by_hand_that_the_generator_makes_too_is_kept(lone_folder, lightgbm_text, tmp_path):
    folder = generate(load(lone_folder), "twincat", tmp_path / "one").folder
    (lone_folder / "te.txt").write_text(other_model(lightgbm_text))
    bundle = load(lone_folder)
    other = generate(bundle, "twincat", tmp_path / "other").folder
    (folder / BLOCK).write_bytes((other / BLOCK).read_bytes())
    generate(bundle, "twincat", tmp_path / "one")


def test_a_long_change_is_cut_in_the_message(lone_folder, tmp_path):
    bundle = load(lone_folder)
    folder = generate(bundle, "twincat", tmp_path).folder
    (folder / BLOCK).write_text("nothing that was here")
    with pytest.raises(InputError, match=r"\.\. and \d+ more lines"):
        generate(bundle, "twincat", tmp_path)


@pytest.mark.parametrize(
    ("options", "lines"), [(["--stat"], 2), (["--limit", "5"], 6), (["--limit", "0"], None), ([], None)]
)
def test_check_prints_no_more_than_asked(lone_folder, lightgbm_text, tmp_path, capsys, options, lines):
    assert run(lone_folder, "--out", tmp_path) == 0
    (lone_folder / "te.txt").write_text(other_model(lightgbm_text))
    capsys.readouterr()
    assert run("generate", lone_folder, "--out", tmp_path, "--check", "-q", *options) == 1
    printed = capsys.readouterr().out.splitlines()
    if lines is None:
        assert any(line.startswith("-") for line in printed)
        assert not any("more lines" in line for line in printed)
    else:
        assert len(printed) == lines
    if options == ["--stat"]:
        assert re.fullmatch(rf"{re.escape(str(tmp_path / 'twincat' / BLOCK))}: \+\d+ -\d+ lines", printed[0])
    if options == ["--limit", "5"]:
        assert re.fullmatch(
            r"\.\. \d+ more lines in 2 file\(s\); --limit 0 shows all, --stat a line a file", printed[5]
        )


def test_structured_text_of_other_targets_has_no_traces_but_line_ends():
    text = b'x := 1; (* <LineIds Name="a"></LineIds> ProductVersion="3" *)\n'
    assert without_traces("a.st", text.replace(b"\n", b"\r\n")) == text
    assert without_traces("a.TcPOU", text) != text
