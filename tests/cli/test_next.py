"""What a command says to run next runs as it stands; what it found stands first."""

import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from st_codegen.cli.verify import agreement_table
from tests.cli.helpers import run

pytest.importorskip("lightgbm")

MODEL = Path(__file__).resolve().parents[2] / "examples" / "user_repository" / "models" / "power.txt"


def last(capsys):
    """The words of the command in the last line of messages."""
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("next: ")
    first, *words = shlex.split(line.removeprefix("next: "))
    assert first == "st-codegen"
    return words


def test_from_generate_to_prove_by_what_the_commands_say(tmp_path, monkeypatch, capsys):
    """The models are called and read as in the first command, whatever stands in the names of folders."""
    monkeypatch.chdir(tmp_path)
    Path("two words").mkdir()
    shutil.copy(MODEL, "two words")
    options = ("--prefix", "P1", "--features", 2, "--max-model-bytes", 10_000_000, "--trust-pickle")
    assert run("two words", "--target", "iec", "--out", "the text", *options) == 0
    verifying = last(capsys)
    assert verifying[:4] == ["verify", "two words", "--generated", "the text"]
    assert verifying[4:] == [str(word) for word in options]
    assert run(*verifying, "--rows", 100) == 0
    proving = last(capsys)
    assert proving == ["prove", *verifying[1:]]
    assert run(*proving) == 0
    assert "next: " not in capsys.readouterr().err


def test_nothing_comes_next_where_the_answer_is_no_or_nobody_listens(tmp_path, capsys):
    shutil.copy(MODEL, tmp_path)
    assert run(tmp_path, "--target", "iec", "--out", tmp_path / "out", "-q") == 0
    text = next((tmp_path / "out" / "iec").glob("FB_[!S]*.st"))
    changed = text.read_text(encoding="utf-8").replace("LREAL := 0.0", "LREAL := 1.0")
    text.write_text(changed.replace("fOut1 := ", "fOut1 := 1.0 + "), encoding="utf-8")
    assert run("verify", tmp_path, "--generated", tmp_path / "out", "--rows", 100) == 1
    assert "next: " not in capsys.readouterr().err


@pytest.mark.parametrize("options", [["beckhoff-ml"], ["iec", "--real"], ["iec", "--self-check"]])
def test_nobody_is_sent_to_prove_what_it_does_not_follow(options, tmp_path, capsys):
    shutil.copy(MODEL, tmp_path)
    assert run(tmp_path, "--target", *options, "--out", tmp_path / "out") == 0
    assert run(*last(capsys), "--rows", 100) == 0
    assert "next: " not in capsys.readouterr().err


def test_what_failed_stands_first_below_how_many_have_which_result():
    def model(name, verdict):
        return SimpleNamespace(cells=(name, "1", "0", "0", "0"), verdict=verdict, passed=verdict != "FAILED")

    table = agreement_table("compared", [model("a", "within bound"), model("b", "equal bits"), model("c", "FAILED")])
    assert table.title == "compared (FAILED: 1, equal bits: 1, within bound: 1)"
    assert [*table.columns[0].cells] == ["c", "a", "b"]


def test_what_comes_next_names_what_was_written_alone(tmp_path, capsys):
    """Older text of another target in the folder may be in REAL: one command verifies no mixture."""
    shutil.copy(MODEL, tmp_path)
    out = tmp_path / "out"
    assert run(tmp_path, "--target", "iec", "--real", "--out", out, "-q") == 0
    assert run(tmp_path, "--target", "twincat", "--out", out) == 0
    verifying = last(capsys)
    assert verifying[:4] == ["verify", str(tmp_path), "--generated", str(out / "twincat")]
    assert run(*verifying, "--rows", 100) == 0


def test_a_folder_that_is_called_as_options_are_is_no_option(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("-m").mkdir()
    shutil.copy(MODEL, "-m")
    assert run("./-m", "--target", "iec", "--out", "./-o") == 0
    assert run(*last(capsys), "--rows", 100) == 0
    assert run(*last(capsys)) == 0
    assert run("init", "./-m", "--max-model-bytes", 10_000_000) == 0
    following = capsys.readouterr().err.split(", then ")[-1]
    assert shlex.split(following) == ["st-codegen", "generate", "./-m", "--max-model-bytes", "10000000"]
    assert run(*shlex.split(following)[1:], "--target", "iec", "--out", "out") == 0


def test_no_command_is_printed_that_is_another_one_than_it_looks(tmp_path, capsys):
    shutil.copy(MODEL, tmp_path)
    assert run(tmp_path, "--target", "iec", "--out", tmp_path / "a\x1b[31m") == 0
    assert "next: " not in capsys.readouterr().err
