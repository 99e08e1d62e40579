"""Generated files that editors, version control and engineers have touched."""

import re

import pytest

from st_codegen.driver import differences, generate
from st_codegen.emit.blocks.application import Packaging, ProjectForm
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
#: Settings of other parts of the environment, in place of those that were written.
OPTIONS = """  <ProjectExtensions>
    <PlcProjectOptions>
      <XmlArchive>
  <Data>
    <o xml:space="preserve" t="OptionKey">
      <v n="Name">"&lt;ProjectRoot&gt;"</v>
    </o>
  </Data>
</XmlArchive>
    </PlcProjectOptions>
  </ProjectExtensions>
"""
BUILT = """  <ItemGroup>
    <None Include="Models.tmc">
      <SubType>Content</SubType>
    </None>
  </ItemGroup>
"""
DATA_TYPES = """\t<DataTypes>
\t\t<DataType>
\t\t\t<Name GUID="{481A0C15-D2DB-59F6-F498-C30AA9C1998C}" IecBaseType="true">ARRAY [0..7] OF BOOL</Name>
\t\t</DataType>
\t</DataTypes>
"""
VARIABLES = """\t\t\t\t\t<Vars VarGrpType="2" AreaNo="1">
\t\t\t\t\t\t<Name>PlcTask Outputs</Name>
\t\t\t\t\t\t<Var>
\t\t\t\t\t\t\t<Name>GVL_Machine.fCorrection_deg</Name>
\t\t\t\t\t\t\t<Type>LREAL</Type>
\t\t\t\t\t\t</Var>
\t\t\t\t\t</Vars>
"""
GUID = "{0F1E2D3C-0000-4444-8888-123456789ABC}"


def saved(path, change):
    """Save a file with a change of its text, as the environment does it."""
    has_mark = path.suffix != ".tsproj"
    text = change(path.read_text(encoding="utf-8-sig"))
    path.write_text("\ufeff" * has_mark + text, encoding="utf-8", newline="\r\n")


def saved_in_xae(folder):
    """What the development environment makes of the files when it builds and saves them."""

    def block(text):
        text = text.replace('Version="1.1.0.1"', 'Version="1.1.0.1" ProductVersion="3.1.4024.12"')
        text = re.sub(r' Id="\{[^}]*\}"', f' Id="{GUID}"', text)
        return text.replace("  </POU>", f"{LINE_IDS}  </POU>")

    def project(text):
        text = text.replace("3.1.4024.0<", "3.1.4026.18<")
        text = re.sub(r"(<(?:TypeSystem|Application)>){.*?}", rf"\g<1>{GUID}", text)
        text = text.replace("  </PropertyGroup>", f"    <Implicit_Other>{GUID}</Implicit_Other>\n  </PropertyGroup>")
        return re.sub(r"  <ProjectExtensions>.*</ProjectExtensions>\n", BUILT + OPTIONS, text, flags=re.S)

    def system(text):
        text = text.replace('TcVersion="3.1.4024.55"', 'TcVersion="3.1.4026.18"')
        text = text.replace("\t<Project ProjectGUID", f"{DATA_TYPES}\t<Project ProjectGUID")
        text = text.replace("\t\t\t\t\t<Contexts>", f"{VARIABLES}\t\t\t\t\t<Contexts>")
        text = text.replace("\t\t</Plc>\n", "\t\t</Plc>\n\t\t<Io/>\n")
        text = text.replace("<Id>0</Id>", '<Id NeedCalleeCall="true">0</Id>')
        return text.replace('Links="2">', f'Links="2" TmcHash="{GUID}" TmcPath="Models.tmc">')

    def solution(text):
        text = text.replace("# TcXaeShell Solution File, Format Version 11.00", "# Visual Studio Version 17")
        return re.sub(r"\nVisualStudioVersion = .*", "\nVisualStudioVersion = 17.14.36930.0", text)

    def task(text):
        text = re.sub(r"(<\w+>)\{.*?\}", rf"\g<1>{GUID}", text)
        return text.replace("  </Task>", "    <ObjectProperties />\n  </Task>")

    changes = {"TcPOU": block, "plcproj": project, "tsproj": system, "sln": solution, "TcTTO": task}
    for suffix, change in changes.items():
        for path in folder.rglob(f"*.{suffix}"):
            before = path.read_bytes()
            saved(path, change)
            assert path.read_bytes() != before


def test_what_the_development_environment_leaves_is_no_difference_and_stays(lone_folder, tmp_path):
    bundle = load(lone_folder)
    folder = generate(bundle, "twincat", tmp_path).folder
    fresh = (folder / BLOCK).read_bytes()
    saved_in_xae(folder)
    before = snapshot(folder)
    assert before[BLOCK] != fresh
    assert list(differences(bundle, "twincat", tmp_path)) == []
    generate(bundle, "twincat", tmp_path)
    assert snapshot(folder) == before


def test_a_bundle_whose_tasks_were_saved_in_xae_has_no_difference_either(bundle_folder, tmp_path):
    bundle = load(bundle_folder)
    folder = generate(bundle, "twincat", tmp_path).folder
    saved_in_xae(folder)
    assert list(differences(bundle, "twincat", tmp_path)) == []


@pytest.mark.parametrize(
    ("suffix", "old", "new"),
    [
        ("tsproj", 'Target64Bit="true"', 'TargetNetId="10.0.2.15.1.1" Target64Bit="true"'),
        ("tsproj", "\t\t<Plc>", '\t\t<Io>\n\t\t\t<Device Id="1"/>\n\t\t</Io>\n\t\t<Plc>'),
        ("tsproj", 'AmsPort="851"', 'AmsPort="852"'),
        ("sln", "EndProject\n", 'EndProject\nProject("{A}") = "Scope", "Scope.tcmproj", "{B}"\nEndProject\n'),
        ("plcproj", "<Name>Models", "<Name>Other"),
    ],
)
def test_what_an_engineer_adds_to_the_solution_is_a_change_and_is_kept(lone_folder, tmp_path, suffix, old, new):
    bundle = load(lone_folder)
    folder = generate(bundle, "twincat", tmp_path).folder
    saved(folder / f"Models.{suffix}", lambda text: text.replace(old, new, 1))
    assert list(differences(bundle, "twincat", tmp_path)) != []
    if suffix == "plcproj":
        return
    kept = (folder / f"Models.{suffix}").read_bytes()
    with pytest.raises(InputError, match="a solution that is yours from now on stays as it is with --project plc; --f"):
        generate(bundle, "twincat", tmp_path)
    made = generate(bundle, "twincat", tmp_path, packaging=Packaging(ProjectForm.PLC))
    assert made.changed == (f"Models.{suffix}",)
    assert (folder / "Models.sln").exists()  # what belongs together stays together
    assert (folder / "Models.tsproj").exists()
    assert (folder / f"Models.{suffix}").read_bytes() == kept


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
    assert (folder / BLOCK).read_bytes() == (other / BLOCK).read_bytes()


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
        assert re.fullmatch(r"\.\. \d+ more lines in 2 files; --limit 0 shows all, --stat a line a file", printed[5])


def test_structured_text_of_other_targets_has_no_traces_but_line_ends():
    text = b'x := 1; (* <LineIds Name="a"></LineIds> ProductVersion="3" *)\n'
    assert without_traces("a.st", text.replace(b"\n", b"\r\n")) == text
    assert without_traces("a.TcPOU", text) != text
