"""The command as it is started."""

import gc

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
