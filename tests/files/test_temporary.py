import subprocess
import sys
from pathlib import Path

import pytest

from st_codegen.files import temporary
from st_codegen.files.temporary import PREFIX, temporary_folder
from st_codegen.files.text import write_text

pytest.importorskip("fcntl")

OWNER = """
import sys
from pathlib import Path
from st_codegen.files.temporary import temporary_folder
with temporary_folder(Path(sys.argv[1])) as folder:
    (folder / "half").write_text("x")
    print(folder, flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _nothing_swept(monkeypatch):
    monkeypatch.setattr(temporary, "_swept", set())


def left(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_of_a_killed_run_is_removed_and_one_of_a_live_run_stays(tmp_path):
    program = [sys.executable, "-c", OWNER, str(tmp_path)]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        path = Path(owner.stdout.readline().strip())
        with temporary_folder(tmp_path) as folder:
            assert left(tmp_path) == sorted([path.name, folder.name])
        owner.kill()
    assert left(tmp_path) == [path.name]
    temporary._swept.clear()
    write_text(tmp_path / "a.txt", "x")
    assert left(tmp_path) == ["a.txt"]


def test_files_and_links_of_such_a_name_stay(tmp_path):
    (tmp_path / f"{PREFIX}file").write_text("mine")
    (tmp_path / "mine").mkdir()
    (tmp_path / f"{PREFIX}link").symlink_to(tmp_path / "mine")
    with temporary_folder(tmp_path):
        pass
    assert left(tmp_path) == [f"{PREFIX}file", f"{PREFIX}link", "mine"]


def test_a_folder_that_another_run_took_for_stale_is_made_again(tmp_path, monkeypatch):
    """Between its making and its locking a folder belongs to nobody."""
    made, make = [], temporary.tempfile.mkdtemp

    def removed_once(**options):
        made.append(make(**options))
        if len(made) == 1:
            Path(made[0]).rmdir()
        return made[-1]

    monkeypatch.setattr(temporary.tempfile, "mkdtemp", removed_once)
    with temporary_folder(tmp_path) as folder:
        assert folder.is_dir()
    assert len(made) == 2
    assert left(tmp_path) == []


def test_without_locks_nothing_is_removed(tmp_path, monkeypatch):
    (tmp_path / f"{PREFIX}old").mkdir()
    monkeypatch.setattr(temporary, "_locks", None)
    with temporary_folder(tmp_path):
        assert len(left(tmp_path)) == 2
    assert left(tmp_path) == [f"{PREFIX}old"]
