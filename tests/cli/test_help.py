"""`--help` is quick: it imports nothing large."""

import importlib
import inspect
import itertools
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from st_codegen.cli import choices
from st_codegen.cli.main import _COMMANDS, cli
from st_codegen.cli.simulate import _SUBCOMMANDS
from st_codegen.project.build_options import LAYOUTS, PROJECT_FORMS, TABLE_KILOBYTES
from tests.cli.helpers import run

ROOT = Path(__file__).resolve().parents[2]
#: What the list of commands may load of ours, and of others whose import takes more than a moment.
OURS = {
    "st_codegen",
    "st_codegen.__main__",
    "st_codegen.cli",
    "st_codegen.cli.codes",
    "st_codegen.cli.lazy",
    "st_codegen.cli.main",
    "st_codegen.diagnostics",
    "st_codegen.entries",
    "st_codegen.errors",
    "st_codegen.files",
    "st_codegen.files.made_by",
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


def test_help_of_single_commands_imports_nothing_large_but_what_prints_tables():
    """Each command names what its options offer without the room that does it (`cli/choices.py`)."""
    program = (
        "import contextlib, io, sys\nfrom st_codegen.cli.main import main\n"
        "for words in [arguments.split() for arguments in sys.argv[1:]]:\n"
        "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "        main([*words, '--help'])\n"
        "print(*sorted(sys.modules))"
    )
    commands = [*_COMMANDS, *(f"simulate {name}" for name in _SUBCOMMANDS)]
    done = subprocess.run([sys.executable, "-c", program, *commands], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "rich" in loaded
    assert not loaded & (LARGE | {"llvmlite"}) - {"rich"}


def command_of(words):
    """A command and what it is called in."""
    command, context = cli, click.Context(cli, info_name="st-codegen", **cli.context_settings)
    for word in words.split():
        command = command.get_command(context, word)
        context = click.Context(command, info_name=word, parent=context)
    return command, context


def test_help_shows_every_number_that_is_taken_where_none_is_given():
    shown = 0
    for words in [*_COMMANDS, *(f"simulate {name}" for name in _SUBCOMMANDS)]:
        command, context = command_of(words)
        text = " ".join(command.get_help(context).split())
        assert "None" not in text
        for option in command.params:
            if isinstance(option.default, int | float) and not isinstance(option.default, bool):
                assert f"[default: {option.default}" in text, option.name
                shown += 1
    assert shown > 20


@pytest.mark.parametrize(
    ("words", "module", "function"),
    [
        ("verify", "st_codegen", "verify"),
        ("verify", "st_codegen.testing", "assert_equals_library"),
        ("diff", "st_codegen", "diff"),
        ("simulate campaign", "st_codegen", "simulate"),
        ("compare", "st_codegen.live.compare", "compare"),
    ],
)
def test_a_command_takes_the_same_numbers_as_its_function_where_none_is_given(words, module, function):
    options = {option.name: option.default for option in command_of(words)[0].params}
    taken = {
        name: (parameter.default, options[name])
        for name, parameter in inspect.signature(getattr(importlib.import_module(module), function)).parameters.items()
        if type(parameter.default) in (int, float) and name in options
    }
    assert taken
    assert all(one == other for one, other in taken.values()), taken


def test_every_kind_of_pickle_is_named_where_trust_is_asked_for():
    from st_codegen.walkers.files import PICKLES, known_formats

    texts = (known_formats(), next(o.help for o in command_of("verify")[0].params if o.name == "trust_pickle"))
    assert all(suffix in text for suffix in PICKLES for text in texts)


def test_options_offer_what_the_rooms_have():
    from st_codegen.driver import Evaluator
    from st_codegen.emit.blocks.application import ProjectForm
    from st_codegen.emit.targets import TARGETS
    from st_codegen.ir import OutputKind
    from st_codegen.passes.choose import Layout, Options
    from st_codegen.reconcile.judge.misread import READINGS
    from st_codegen.reconcile.mistakes.examine import AS_IS, NAMES
    from st_codegen.reconcile.models.update import CODE, MODELS
    from st_codegen.rig.tasks import TaskForm
    from st_codegen.st.dialects import DIALECTS
    from st_codegen.te.latency import Exchange
    from st_codegen.training.export import FORMATS
    from st_codegen.training.families import FAMILIES
    from st_codegen.training.study import LARGEST_SEED

    assert tuple(TARGETS) == choices.TARGETS
    assert tuple(Layout) == LAYOUTS
    assert tuple(ProjectForm) == PROJECT_FORMS
    assert Options().table_bytes == TABLE_KILOBYTES * 1024
    assert tuple(OutputKind) == choices.OUTPUTS
    assert tuple(Evaluator) == choices.EVALUATORS
    assert tuple(Exchange) == choices.EXCHANGES
    assert tuple(TaskForm) == choices.TASK_FORMS
    assert set(DIALECTS) == set(choices.DIALECTS)
    assert tuple(FAMILIES) == choices.FAMILIES
    assert LARGEST_SEED == choices.LARGEST_SEED
    assert choices.MODEL_FORMS == FORMATS
    assert sorted(itertools.chain(*choices.MISTAKES.values())) == sorted({*NAMES, *(one.name for one in READINGS)})
    assert choices.AS_IS == AS_IS
    assert (choices.UPDATED_MODELS, choices.UPDATED_CODE) == (MODELS, CODE)


@pytest.mark.parametrize("lazy", [*_COMMANDS.values(), *_SUBCOMMANDS.values()], ids=lambda lazy: lazy.module)
def test_every_summary_is_a_sentence_and_every_module_has_its_command(lazy):
    assert lazy.summary.endswith(".")
    assert importlib.import_module(lazy.module).command.help


@pytest.mark.parametrize("lazy", [*_COMMANDS.values(), *_SUBCOMMANDS.values()], ids=lambda lazy: lazy.module)
def test_an_option_may_be_left_out_where_the_command_takes_none_or_a_default(lazy):
    """Else the command would begin its work with None where it expects a path or a number."""
    command = importlib.import_module(lazy.module).command
    known = inspect.signature(inspect.unwrap(command.callback)).parameters
    given = command.make_context("command", [], resilient_parsing=True).params
    for parameter in command.params:
        if parameter.name in known:
            may_be_none = "None" in str(known[parameter.name].annotation)
            assert may_be_none == (not parameter.required and given[parameter.name] is None), parameter


@pytest.mark.parametrize("command", ["", *_COMMANDS])
def test_help_has_examples(command, capsys):
    assert run(*([command] if command else []), "--help") == 0
    shown = capsys.readouterr().out
    assert "Examples:" in shown
    assert list(cli.lazy) == list(_COMMANDS)


PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/*/README.md")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_on_a_page_have_the_options_that_they_are_shown_with(page):
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    unknown = []
    for line in re.findall(r"\bst-codegen ([^`#|\n]+)", text):
        words = line.split()
        shown = [words[0], " ".join(words[:2])]
        known = [name for name in (*_COMMANDS, *(f"simulate {name}" for name in _SUBCOMMANDS)) if name in shown]
        command, context = command_of(max(known, key=len, default="generate"))
        own = {option for parameter in (*command.get_params(context), *cli.params) for option in parameter.opts}
        unknown += [
            f"{line}: {option}" for option in re.findall(r"(?<!\S)-{1,2}[a-z][a-z-]*", line) if option not in own
        ]
    assert unknown == []
