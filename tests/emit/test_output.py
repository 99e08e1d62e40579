import dataclasses
import json
import os
import subprocess
import sys

import pytest

from st_codegen.driver import check, generate
from st_codegen.emit import output
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError, InputError, TargetError
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load

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


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 99, "files": {}, "models": {}, "transmission_error": {}}'])
def test_a_damaged_manifest_is_named(lone_folder, tmp_path, text):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / output.MANIFEST).write_text(text)
    with pytest.raises(GeneratedCodeError, match=r"st-codegen\.json"):
        output.read_manifest(folder)


@pytest.mark.parametrize("exchange", [True, False])
def test_without_an_exchange_of_folders_two_renames_do(lone_folder, tmp_path, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(output, "_exchange", lambda one, other: False)
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    (folder / "mine.txt").write_text("mine")
    before = snapshot(folder)
    generate(load(lone_folder), TWINCAT, tmp_path)
    assert snapshot(folder) == before


TREES = Options(Layout.TREES)  # quick to generate
#: Generates one of two bundles when it is told to, in a child that is killed when it touches the output for the n-th
#: time; says whether it was killed or had finished before.
WRITER = """
import os, signal, sys
from pathlib import Path
from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import load
bundles = [load(Path(folder)) for folder in sys.argv[1:3]]
out = sys.argv[3]

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
    program = [sys.executable, "-c", WRITER, str(lone_folder), str(other), str(out)]
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
    assert seen.count(False) > 1


def test_check_is_silent_when_the_files_are_up_to_date(lone_folder, tmp_path):
    generate(load(lone_folder), TWINCAT, tmp_path)
    before = snapshot(tmp_path)
    assert list(check(load(lone_folder), TWINCAT, tmp_path)) == []
    assert snapshot(tmp_path) == before


def test_check_shows_a_unified_diff(lone_folder, lightgbm_text, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    path = folder / "POUs" / "FB_Te.TcPOU"
    path.write_text(path.read_text(encoding="utf-8").replace("bUsable := TRUE", "bUsable := FALSE"), encoding="utf-8")
    (lone_folder / "new.txt").write_text(lightgbm_text)
    lines = list(check(load(lone_folder), TWINCAT, tmp_path))
    assert "-bUsable := FALSE;\n" in lines
    assert "+bUsable := TRUE;\n" in lines
    assert any("FB_New.TcPOU (generated)" in line for line in lines)


def test_check_does_not_mind_line_ends(lone_folder, tmp_path):
    folder = generate(load(lone_folder), TWINCAT, tmp_path).folder
    path = folder / "POUs" / "FB_Te.TcPOU"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert list(check(load(lone_folder), TWINCAT, tmp_path)) == []
