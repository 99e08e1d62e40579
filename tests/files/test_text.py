import os

import pytest

from st_codegen.errors import InputError
from st_codegen.files.folders import write_texts
from st_codegen.files.made_by import command_line
from st_codegen.files.text import make_folder, whole_file, write_text


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "deep" / "a.txt"
    write_text(path, "one\n")
    with pytest.raises(ZeroDivisionError), whole_file(path) as partial:
        partial.write_text("half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"one\n"
    assert names(path.parent) == ["a.txt"]


def test_a_link_is_followed_and_a_pipe_is_written_to(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_text(tmp_path / "link", "x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "x"
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_text(tmp_path / "pipe", "y")
    assert os.read(reader, 10) == b"y"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


def test_a_folder_in_the_place_of_a_file_is_refused_and_left_as_it_is(tmp_path):
    (tmp_path / "a").mkdir()
    for write in (lambda: write_text(tmp_path / "a", "x"), lambda: write_texts(tmp_path, {"b": "y", "a": "x"})):
        with pytest.raises(InputError, match="is a folder; a file is to be written there"):
            write()
    assert names(tmp_path) == ["a"]
    (tmp_path / "f").write_text("")
    with pytest.raises(InputError, match="is a file; a folder"):
        write_texts(tmp_path / "f", {"b": "y"})
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(InputError, match="is a link to nothing; a folder is wanted there"):
        make_folder(tmp_path / "link")


def test_several_files_are_written_together(tmp_path):
    write_texts(tmp_path / "new", {"a": "1\n", "b": "2\n"})
    assert names(tmp_path / "new") == ["a", "b"]
    with pytest.raises(UnicodeEncodeError):
        write_texts(tmp_path / "new", {"a": "3\n", "b": "\ud800"})
    assert (tmp_path / "new" / "a").read_text() == "1\n"
    assert names(tmp_path / "new") == ["a", "b"]


@pytest.mark.parametrize(
    ("word", "elsewhere", "windows"),
    [
        ("models", "models", "models"),
        ("C:\\bundles\\te.json", "'C:\\bundles\\te.json'", "C:\\bundles\\te.json"),
        ("my models", "'my models'", '"my models"'),
        ("D:\\my models\\", "'D:\\my models\\'", '"D:\\my models\\\\"'),
        ("R&D", "'R&D'", '"R&D"'),
        ("sign,labels", "sign,labels", '"sign,labels"'),
        ("@rows", "@rows", '"@rows"'),
        ("it's", "'it'\"'\"'s'", '"it\'s"'),
        ("", "''", '""'),
    ],
)
def test_commands_that_are_printed_can_be_copied_into_the_shell_of_their_system(word, elsewhere, windows):
    """What quotes mean to cmd: nothing, where they are single."""
    assert command_line("st-codegen", word, windows=False) == f"st-codegen {elsewhere}"
    assert command_line("st-codegen", word, windows=True) == f"st-codegen {windows}"
