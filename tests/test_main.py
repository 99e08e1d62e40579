"""The command as it is started."""

import gc
import signal

import pytest

from st_codegen import __main__ as started
from st_codegen.cli import main as cli


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
