"""`--help` is quick: it imports nothing large."""

import subprocess
import sys

import pytest

from st_codegen.cli.main import _COMMANDS, cli
from st_codegen.cli.simulate import _SUBCOMMANDS
from tests.cli.helpers import run

#: What the list of commands may load of ours, and of others whose import takes more than a moment.
OURS = {
    "st_codegen",
    "st_codegen.__main__",
    "st_codegen.cli",
    "st_codegen.cli.lazy",
    "st_codegen.cli.main",
    "st_codegen.entries",
    "st_codegen.errors",
    "st_codegen.reconcile",
}
LARGE = {"numpy", "scipy", "rich", "jinja2", "lark", "lxml", "sklearn", "polars", "numba", "matplotlib", "joblib"}
PROGRAM = """
import sys
from st_codegen.cli.main import main
try:
    main(sys.argv[1:])
finally:
    print(*sorted(sys.modules), sep="\\n", file=sys.stderr)
"""


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["simulate", "--help"]])
def test_what_the_list_of_commands_imports(arguments):
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert {name for name in loaded if name.startswith("st_codegen")} <= OURS | {"st_codegen.cli.simulate"}
    assert not {name.partition(".")[0] for name in loaded} & LARGE


@pytest.mark.parametrize("lazy", [*_COMMANDS.values(), *_SUBCOMMANDS.values()], ids=lambda lazy: lazy.module)
def test_every_summary_is_a_sentence_and_every_module_has_its_command(lazy):
    import importlib

    assert lazy.summary.endswith(".")
    assert importlib.import_module(lazy.module).command.help


@pytest.mark.parametrize("command", ["", *_COMMANDS])
def test_help_has_examples(command, capsys):
    assert run(*([command] if command else []), "--help") == 0
    shown = capsys.readouterr().out
    assert "Examples:" in shown or "Commands:" in shown
    assert list(cli.lazy) == list(_COMMANDS)
