import dataclasses
import json
import os
import subprocess
import sys

import pytest

from st_codegen.driver import differences, generate
from st_codegen.emit import output
from st_codegen.emit.render import RenderedFile
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError, InputError, TargetError
from st_codegen.files import folders
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
from tests.cli.helpers import run

TWINCAT = TARGETS["twincat"]


def snapshot(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_input_gives_the_same_bytes(lone_folder, tmp_path):
    for target in TARGETS.values():
        generate(load(lone_folder), target, tmp_path / "one")
        generate(load(lone_folder), target, tmp_path / "two")
    assert snapshot(tmp_path / "one") == snapshot(tmp_path / "two")


def test_the_users_own_files_stay_and_orphans_go(lone_folder, lightgbm_text, tmp_path):
    (lone_folder / "second.txt").write_text(lightgbm_text)
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / "POUs" / "MAIN.TcPOU").write_text("mine")
    (folder / "notes").mkdir()
    (folder / "notes" / "todo.txt").write_text("mine too")
    (folder / "empty").mkdir()
    (folder / "link").symlink_to("notes/todo.txt")
    (lone_folder / "second.txt").unlink()
    generate(load(lone_folder), TWINCAT, tmp_path)
    assert (folder / "POUs" / "MAIN.TcPOU").read_text() == "mine"
    assert (folder / "notes" / "todo.txt").read_text() == "mine too"
    assert (folder / "empty").is_dir()
    assert (folder / "link").is_symlink()
    assert not (folder / "POUs" / "FB_Second.TcPOU").exists()
    assert (folder / "POUs" / "FB_Te.TcPOU").exists()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".st-codegen")] == []


def test_unchanged_files_keep_their_times(lone_folder, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    path = folder / "POUs" / "FB_Te.TcPOU"
    os.utime(path, (1, 1))
    generate(load(lone_folder), TWINCAT, tmp_path)
    assert path.stat().st_mtime == 1


def test_a_file_of_the_user_with_a_generated_name_is_not_overwritten(lone_folder, tmp_path):
    path = tmp_path / "twincat" / "POUs" / "FB_Te.TcPOU"
    path.parent.mkdir(parents=True)
    path.write_text("hand-made")
    with pytest.raises(InputError, match="was not generated, but a generated file has the same name"):
        generate(load(lone_folder), TWINCAT, tmp_path)
    assert path.read_text() == "hand-made"
    assert snapshot(tmp_path / "twincat") == {"POUs/FB_Te.TcPOU": b"hand-made"}


def test_an_error_writes_nothing(lone_folder, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match="--max-array"):
        generate(load(lone_folder), TWINCAT, out, max_array=3)
    assert not out.exists()


def test_tables_beyond_the_limit_are_an_error_that_names_the_largest(lone_folder, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(TargetError, match=r"target twincat is 100; the largest: FB_Te [\d,]+.*--max-bytes"):
        generate(load(lone_folder), TWINCAT, out, options=Options(data_bytes=100))
    assert not out.exists()
    small = dataclasses.replace(TWINCAT.limits, data_bytes=100)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(TWINCAT), "limits", small)
        with pytest.raises(TargetError, match="--max-bytes"):
            generate(load(lone_folder), TWINCAT, out)
        generate(load(lone_folder), TWINCAT, out, options=Options(data_bytes=2**20))


def test_a_changed_manifest_cannot_remove_files_elsewhere(lone_folder, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    manifest = json.loads((folder / output.MANIFEST).read_text())
    manifest["files"]["../../victim.txt"] = "0"
    (folder / output.MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(GeneratedCodeError, match="delete it and generate again"):
        generate(load(lone_folder), TWINCAT, tmp_path)


def test_a_manifest_that_names_a_file_of_the_user_does_not_remove_it(lone_folder, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / "POUs" / "Mine.TcPOU").write_text("mine")
    manifest = json.loads((folder / output.MANIFEST).read_text())
    manifest["files"]["POUs/Mine.TcPOU"] = "0" * 64
    (folder / output.MANIFEST).write_text(json.dumps(manifest))
    assert generate(load(lone_folder), TWINCAT, tmp_path).changed == ("POUs/Mine.TcPOU",)
    assert (folder / "POUs" / "Mine.TcPOU").read_text() == "mine"
    assert generate(load(lone_folder), TWINCAT, tmp_path).changed == ()
    assert (folder / "POUs" / "Mine.TcPOU").read_text() == "mine"


@pytest.mark.parametrize("edit", ["changed", "line ends", "a folder", "a link", "gone"])
def test_an_orphan_that_was_changed_stays_with_a_warning(lone_folder, lightgbm_text, tmp_path, capsys, edit):
    (lone_folder / "second.txt").write_text(lightgbm_text)
    out = tmp_path / "out"
    path = generate(load(lone_folder), TWINCAT, out).folder / "POUs" / "FB_Second.TcPOU"
    text = path.read_bytes()
    path.unlink()
    if edit == "changed":
        path.write_bytes(text + b"(* mine *)")
    elif edit == "line ends":
        path.write_bytes(text.replace(b"\r\n", b"\n"))
    elif edit == "a folder":
        path.mkdir()
        (path / "notes").write_text("mine")
    elif edit == "a link":
        path.symlink_to("FB_Te.TcPOU")
    (lone_folder / "second.txt").unlink()
    assert run(lone_folder, "--out", out) == 0
    stays = edit in ("changed", "a folder", "a link")
    assert os.path.lexists(path) == stays
    shown = " ".join(capsys.readouterr().err.split())
    assert (f"warning: {path} is no longer generated; it stays" in shown) == stays
    if edit == "a folder":
        assert (path / "notes").read_text() == "mine"


@pytest.mark.parametrize("target", ["elsewhere", "nowhere"])
def test_a_link_in_place_of_the_folder_is_refused(lone_folder, tmp_path, target):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "mine.txt").write_text("mine")
    (tmp_path / "twincat").symlink_to(tmp_path / target)
    for command in (generate, lambda *given: list(differences(*given))):
        with pytest.raises(InputError, match="is a symbolic link"):
            command(load(lone_folder), TWINCAT, tmp_path)
    assert (tmp_path / "twincat").is_symlink()
    assert snapshot(tmp_path / "elsewhere") == {"mine.txt": b"mine"}


def test_a_folder_or_link_of_the_user_with_a_generated_name_is_refused(lone_folder, tmp_path):
    (tmp_path / "twincat").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "twincat" / "POUs").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="has the same name"):
        generate(load(lone_folder), TWINCAT, tmp_path)
    assert (tmp_path / "twincat" / "POUs").is_symlink()


def test_names_that_differ_in_case_only_are_refused(lone_folder, tmp_path):
    path = tmp_path / "twincat" / "POUs" / "fb_te.TcPOU"
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(InputError, match=r"fb_te\.TcPOU differs from the generated POUs/FB_Te\.TcPOU in case only"):
        generate(load(lone_folder), TWINCAT, tmp_path)
    assert path.read_text() == "mine"
    files = [RenderedFile("FB_C.st", ("x",)), RenderedFile("fb_c.st", ("x",))]
    with (
        pytest.raises(InputError, match=r"FB_C\.st and fb_c\.st differ"),
        output.staged(tmp_path, files, {}),
    ):
        pass


def test_check_writes_nothing_not_even_a_folder(lone_folder, tmp_path):
    assert list(differences(load(lone_folder), TWINCAT, tmp_path / "deep" / "out"))
    assert not (tmp_path / "deep").exists()
    generate(load(lone_folder), TWINCAT, tmp_path / "out")
    (tmp_path / "out").chmod(0o500)
    try:
        assert list(differences(load(lone_folder), TWINCAT, tmp_path / "out")) == []
    finally:
        (tmp_path / "out").chmod(0o700)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 99, "files": {}, "models": {}, "transmission_error": {}}'])
def test_a_damaged_manifest_is_named(lone_folder, tmp_path, text):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / output.MANIFEST).write_text(text)
    with pytest.raises(GeneratedCodeError, match=r"st-codegen\.json"):
        output.read_manifest(folder)


WRONG = {
    "no table": lambda facts: [],
    "no file names": lambda facts: {**facts, "files": ["a"]},
    "a sum that is no text": lambda facts: {**facts, "files": {"a": 1}},
    "models that are none": lambda facts: {**facts, "models": {"te": 3}},
    "no block": lambda facts: with_model(facts, block=None),
    "an output without a name": lambda facts: with_model(facts, outputs=[{}]),
    "a feature without a unit": lambda facts: with_model(facts, features=[{"name": "a", "range": [0, 1]}]),
    "a range upside down": lambda facts: with_model(facts, features=[{"name": "a", "unit": "", "range": [1, 0]}]),
    "a range without an end": lambda facts: with_model(facts, features=[{"name": "a", "unit": "", "range": [1, None]}]),
    "a negative output": lambda facts: with_model(facts, block_outputs=[-1]),
    "calls in words": lambda facts: {**facts, "transmission_error": {"calls": "two"}},
    "a fingerprint in capitals": lambda facts: {**facts, "comparison": {"fingerprint": "0xAB"}},
    "a choice that is none": lambda facts: {**facts, "choices": 3},
}
ELSEWHERE = {
    "another block": lambda facts: with_model(facts, block="FB_Nothing"),
    "an output too many": lambda facts: with_model(facts, block_outputs=[77]),
}


def with_model(facts, **changes):
    """The facts with other ones of their first model."""
    name = next(iter(facts["models"]))
    model = {**facts["models"][name], **changes}
    return {**facts, "models": {**facts["models"], name: {k: v for k, v in model.items() if v is not None}}}


@pytest.mark.parametrize("name", WRONG)
def test_what_a_manifest_says_is_checked_before_it_is_used(lone_folder, tmp_path, name):
    """Nobody vouches for the folder that it is in."""
    path = generate(load(lone_folder), TWINCAT, tmp_path, options=TREES).folder / output.MANIFEST
    facts = json.loads(path.read_text())
    assert output.read_manifest(path.parent) is not None
    path.write_text(json.dumps(WRONG[name](facts)))
    with pytest.raises(GeneratedCodeError, match="delete it and generate again"):
        output.read_manifest(path.parent)


def test_a_manifest_that_does_not_fit_its_text_is_refused_in_one_line(lone_folder, tmp_path, capsys):
    path = generate(load(lone_folder), TWINCAT, tmp_path, options=TREES).folder / output.MANIFEST
    facts = json.loads(path.read_text())
    for change in ELSEWHERE.values():
        path.write_text(json.dumps(change(facts)))
        for command in (["verify", "--rows", 50], ["prove"]):
            assert run(*command, lone_folder, "--generated", path.parent, "-q") == 2
            assert capsys.readouterr().err.startswith("error: ")
    path.write_text("[" * 100_000)
    assert run("verify", lone_folder, "--generated", path.parent, "-q") == 2


@pytest.mark.parametrize("exchange", [True, False])
def test_without_an_exchange_of_folders_two_renames_do(lone_folder, tmp_path, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(folders, "_exchange", lambda one, other: False)
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / "mine.txt").write_text("mine")
    before = snapshot(folder)
    generate(load(lone_folder), TWINCAT, tmp_path)
    assert snapshot(folder) == before


TREES = Options(Layout.TREES)  # quick to generate
#: Generates one of two bundles when it is told to, in a child that is killed when it touches the output for the n-th
#: time; says whether it was killed or had finished before.
WRITER = """
import gc, os, signal, sys
from pathlib import Path
from st_codegen import driver
from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
bundles = [load(Path(folder)) for folder in sys.argv[1:3]]
out = sys.argv[3]
for bundle in bundles:  # what is imported and compiled here, no child does again
    generate(bundle, TARGETS["twincat"], Path(sys.argv[4]), options=Options(Layout.TREES))
driver.check_emitted = lambda folder, dialect, portable: None  # reads the same texts every time, and changes nothing
gc.freeze()

def killed_at(last):
    count = 0
    def touched(event, arguments):
        nonlocal count
        touches = event.startswith(("os.", "shutil.", "open")) and any(str(a).startswith(out) for a in arguments)
        if touches or (event == "ctypes.dlsym" and arguments[1] == "renameat2"):
            count += 1
            if count == last:
                os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(touched)

for line in sys.stdin:
    number, last = map(int, line.split())
    child = os.fork()
    if not child:
        killed_at(last)
        generate(bundles[number], TARGETS["twincat"], Path(out), options=Options(Layout.TREES))
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    print("killed" if os.WIFSIGNALED(status) else "finished" if status == 0 else "failed", flush=True)
"""


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_killed_run_leaves_a_whole_project(lone_folder, lightgbm_text, tmp_path):
    """Two projects overwrite each other; wherever the writer is killed, one of them is there, whole."""
    other = tmp_path / "other"
    other.mkdir()
    for name in ("te.txt", "more.txt", "most.txt"):
        (other / name).write_text(lightgbm_text)
    wholes = []
    for number, models in enumerate((lone_folder, other)):
        wholes.append(snapshot(generate(load(models), TWINCAT, tmp_path / f"whole{number}", options=TREES).folder))
    out = tmp_path / "out"
    generate(load(lone_folder), TWINCAT, out, options=TREES)
    program = [sys.executable, "-c", WRITER, str(lone_folder), str(other), str(out), str(tmp_path / "warm")]
    present, seen = 0, []
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer:
        for last in range(1, 1000):
            print(1 - present, last, file=writer.stdin, flush=True)
            answer = writer.stdout.readline()
            found = snapshot(out / "twincat")
            assert found in wholes
            seen.append(found == wholes[present])
            if answer == "finished\n":
                break
            assert answer == "killed\n"
            present = wholes.index(found)
        writer.stdin.close()
    # killed while it was written the old project stayed, killed while it tidied up the new one was there
    assert seen.count(True) > 10
    # and each run removed what the killed one before it had left
    assert [path.name for path in out.iterdir()] == ["twincat"]
    assert seen.count(False) > 1


def test_check_is_silent_when_the_files_are_up_to_date(lone_folder, tmp_path):
    generate(load(lone_folder), TWINCAT, tmp_path)
    before = snapshot(tmp_path)
    assert list(differences(load(lone_folder), TWINCAT, tmp_path)) == []
    assert snapshot(tmp_path) == before


def test_check_shows_a_unified_diff(lone_folder, lightgbm_text, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    path = folder / "POUs" / "FB_Te.TcPOU"
    path.write_text(path.read_text(encoding="utf-8").replace("bUsable := TRUE", "bUsable := FALSE"), encoding="utf-8")
    (lone_folder / "new.txt").write_text(lightgbm_text)
    lines = [line for change in differences(load(lone_folder), TWINCAT, tmp_path) for line in change.lines()]
    assert "-bUsable := FALSE;\n" in lines
    assert "+bUsable := TRUE;\n" in lines
    assert any("FB_New.TcPOU (generated)" in line for line in lines)


def test_check_does_not_mind_line_ends(lone_folder, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    path = folder / "POUs" / "FB_Te.TcPOU"
    path.write_bytes(path.read_bytes().replace(b"\r\n", b"\n"))
    assert list(differences(load(lone_folder), TWINCAT, tmp_path)) == []
