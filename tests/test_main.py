"""The command as it is started."""

import contextlib
import gc
import signal

import pytest

from st_codegen import __main__ as started
from st_codegen.cli import main as cli
from st_codegen.processes import interruptible


def test_no_garbage_is_looked_for_among_what_libraries_make_when_they_are_imported(monkeypatch):
    looked = []

    def imports() -> None:
        gc.collect()  # which counts from here
        gc.callbacks.append(looks)
        kept = [[] for _ in range(20_000)]
        gc.callbacks.remove(looks)
        assert kept

    def looks(phase, _) -> None:
        looked.append(phase)

    before = gc.get_threshold()
    monkeypatch.setattr(cli, "main", imports)
    gc.set_threshold(700, 10, 10)  # as Python has it
    try:
        started.main()
    finally:
        gc.set_threshold(*before)
    assert not looked


@pytest.mark.parametrize("before", [signal.SIG_DFL, signal.SIG_IGN])
def test_sigterm_ends_a_command_as_ctrl_c_does_unless_it_is_ignored(monkeypatch, before):
    """It ended the process at once: workers of `train` went on for minutes, a folder that was begun stayed."""
    ended = []

    def command() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            ended.append(True)

    monkeypatch.setattr(cli, "main", command)
    handler = signal.signal(signal.SIGTERM, before)
    looks_after = gc.get_threshold()
    try:
        started.main()
    finally:
        signal.signal(signal.SIGTERM, handler)
        gc.set_threshold(*looks_after)
    assert ended == ([True] if before is signal.SIG_DFL else [])


@pytest.mark.parametrize("surroundings", [contextlib.nullcontext, interruptible])
def test_sigterm_ends_a_command_for_which_ctrl_c_is_ignored(monkeypatch, surroundings):
    """A shell starts what a script leaves in its background so: nothing but SIGKILL ended it."""

    def command() -> None:
        with pytest.raises(KeyboardInterrupt), surroundings():
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(cli, "main", command)
    on_term = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    on_int = signal.signal(signal.SIGINT, signal.SIG_IGN)
    looks_after = gc.get_threshold()
    try:
        started.main()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, on_term)
        signal.signal(signal.SIGINT, on_int)
        gc.set_threshold(*looks_after)
