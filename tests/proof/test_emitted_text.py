"""Generated text is read back before it is handed out."""

import os
import signal
from pathlib import Path

import pytest

from st_codegen import driver
from st_codegen.errors import DefectError
from st_codegen.processes import can_be_copied, children
from st_codegen.proof import emitted
from st_codegen.proof.emitted import check_emitted, one_reader, reader

MODEL = Path(__file__).resolve().parents[2] / "golden" / "lone" / "models" / "lightgbm_gbdt.txt"
GOOD = """FUNCTION_BLOCK FB_A
VAR_OUTPUT x : LREAL; END_VAR
x := {};
END_FUNCTION_BLOCK
"""
LOOP = """FUNCTION_BLOCK FB_A
VAR_OUTPUT x : LREAL; END_VAR
VAR i : DINT; END_VAR
FOR i := 0 TO 0 DO
    x := x + 1.0;
END_FOR;
END_FUNCTION_BLOCK
"""


def checked(tmp_path, text, dialect="iec", portable=True):
    (tmp_path / "FB_A.st").write_text(text)
    check_emitted(tmp_path, dialect, portable=portable)


def test_good_text_passes(tmp_path):
    checked(tmp_path, GOOD.format("1.0"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LOOP, "a loop from 0 to 0"),
        (GOOD.format("1E5"), "without a dot"),
        (GOOD.format("y"), "cannot read itself"),
        (GOOD.format("1.0E-300"), "outside of"),
    ],
)
def test_bad_text_is_a_defect(text, message, tmp_path):
    with pytest.raises(DefectError, match=message):
        checked(tmp_path, text)


def test_only_targets_that_say_so_are_held_to_the_portable_subset(tmp_path):
    checked(tmp_path, GOOD.format("1.0E-300"), "twincat", portable=False)
    with pytest.raises(DefectError, match="a loop from 0 to 0"):
        checked(tmp_path, LOOP, "twincat", portable=False)


def test_nothing_is_written_where_the_text_is_wrong(tmp_path, monkeypatch):
    def found(*_, **__):
        raise DefectError("wrong")

    monkeypatch.setattr(driver, "check_emitted", found)
    with pytest.raises(DefectError):
        driver.generate(MODEL, "iec", tmp_path / "out")
    assert not list(tmp_path.rglob("*.st"))


@pytest.fixture
def two_processors(monkeypatch):
    """Readers have a processor of their own, and leave no process behind."""
    if not can_be_copied():
        pytest.skip("this system cannot copy a process")
    monkeypatch.setattr(emitted, "other_processors", lambda: 1)
    before = set(children(os.getpid()))
    yield
    # a process that an earlier test left behind may end meanwhile
    assert set(children(os.getpid())) <= before


@pytest.mark.parametrize("is_large", [True, False])
def test_a_reader_along_finds_what_is_in_order(is_large, two_processors, tmp_path):
    with reader(is_large=is_large) as other:
        for name in "AB":
            (tmp_path / f"FB_{name}.st").write_text(GOOD.format("1.0").replace("FB_A", f"FB_{name}"))
            other.tell(tmp_path / f"FB_{name}.st")
        assert other.finds_in_order(tmp_path, "iec", portable=True) == is_large  # nobody reads what is small


@pytest.mark.parametrize("bad", [LOOP, GOOD.format("1E5"), GOOD.format("y"), "no text"])
@pytest.mark.parametrize("later", [False, True])
def test_a_reader_along_finds_what_is_wrong(bad, later, two_processors, tmp_path):
    """Also what was in order when it was told of it."""
    file = tmp_path / "FB_A.st"
    file.write_text(GOOD.format("1.0") if later else bad)
    with reader(is_large=True) as other:
        other.tell(file)
        if later:
            assert other.finds_in_order(tmp_path, "iec", portable=True)
            file.write_text(bad)
        assert not other.finds_in_order(tmp_path, "iec", portable=True)


def test_a_reader_that_ends_is_no_answer(two_processors, tmp_path):
    (tmp_path / "FB_A.st").write_text(GOOD.format("1.0"))
    before = set(children(os.getpid()))
    with reader(is_large=True) as other:
        (child,) = set(children(os.getpid())) - before
        os.kill(child, signal.SIGKILL)
        os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
        other.tell(tmp_path / "FB_A.st")
        assert not other.finds_in_order(tmp_path, "iec", portable=True)


def test_a_reader_ends_with_what_it_reads_for(two_processors, tmp_path):
    with pytest.raises(ZeroDivisionError), reader(is_large=True) as other:
        other.tell(tmp_path / "FB_A.st")
        raise ZeroDivisionError


def test_what_was_read_along_is_not_read_again(two_processors, tmp_path, monkeypatch):
    monkeypatch.setattr(driver, "_LARGE_TABLES", -1)
    monkeypatch.setattr(driver, "check_emitted", lambda *_, **__: pytest.fail("read twice"))
    assert driver.generate(MODEL, "twincat", tmp_path / "out").files


def test_one_reader_reads_all_that_is_written(two_processors, tmp_path, monkeypatch):
    """Also what is small, and several projects, one after another."""
    monkeypatch.setattr(driver, "check_emitted", lambda *_, **__: pytest.fail("read twice"))
    # other tests of the same process may have left helpers of libraries behind
    others = set(children(os.getpid()))
    with one_reader():
        (child,) = set(children(os.getpid())) - others
        for target in ("iec", "twincat"):
            assert driver.generate(MODEL, target, tmp_path / "out").files
            assert set(children(os.getpid())) - others == {child}


def test_what_the_one_reader_finds_wrong_is_said(two_processors, tmp_path):
    (tmp_path / "FB_A.st").write_text(LOOP)
    with one_reader(), reader(is_large=False) as other:
        assert not other.finds_in_order(tmp_path, "iec", portable=True)
        assert not other.finds_in_order(tmp_path, "iec", portable=True)  # it has ended
