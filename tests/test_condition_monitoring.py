"""`examples/condition_monitoring` on a small scale: learned, compiled, verified, and replayed sample by sample."""

import importlib.util
import io
import re
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

pytest.importorskip("sklearn")
pytest.importorskip("onnxruntime")

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "condition_monitoring"


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What the program prints, and the folder that it writes."""
    out, printed = tmp_path_factory.mktemp("monitoring"), io.StringIO()
    spec = importlib.util.spec_from_file_location("condition_monitoring", FOLDER / "run.py")
    module = importlib.util.module_from_spec(spec)
    small = ["--records", "8", "--samples", "50", "--rows", "50", "--out", str(out)]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.syspath_prepend(FOLDER)
        patch.setattr(sys, "argv", ["run.py", *small])
        spec.loader.exec_module(module)
        assert module.main() == 0
    return printed.getvalue(), out


def test_states_are_recognized_and_healthy_windows_are_not_strange(said):
    rates = re.findall(r"(\w+): (\d+)% of 160 new windows recognized, (\d+)% strange", said[0])
    assert [state for state, *_ in rates] == ["healthy", "worn", "dry"]
    assert all(int(right) > 85 for _, right, _ in rates)
    assert [int(strange) > 50 for *_, strange in rates] == [False, True, True]


def test_blocks_and_windows_are_verified_in_both_targets(said):
    assert re.findall(r"(\w+): verified, \d+ rows, iec, twincat", said[0]) == [
        "state",
        "strange",
        "FB_StateWindow",
        "FB_StrangeWindow",
    ]
    names = {path.name for path in (said[1] / "plc" / "twincat" / "POUs").iterdir()}
    assert {"FB_State.TcPOU", "FB_StateWindow.TcPOU", "FB_Strange.TcPOU", "FB_StrangeWindow.TcPOU"} <= names
    assert "Worn" in (said[1] / "plc" / "twincat" / "DUTs" / "E_StateClass.TcDUT").read_text(encoding="utf-8")


def test_the_replay_finds_the_fault(said):
    assert "first answer with sample 32; wrong on 0 of 19 healthy windows" in said[0]
    for what in ("worn", "strange"):
        assert int(re.search(rf"{what} for the first time: (\d+) samples", said[0])[1]) <= 32


def test_the_page_shows_what_the_command_prints():
    """The lines of docs/monitoring.md have the form of those that the program writes."""
    page = (ROOT / "docs" / "monitoring.md").read_text(encoding="utf-8")
    source = (FOLDER / "run.py").read_text(encoding="utf-8")
    for words in ("new windows recognized", "rows, ", "first answer with sample", "for the first time: "):
        assert words in page and words in source
    assert "window = 32" in page and "WINDOW = 32" in source
