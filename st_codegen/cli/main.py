"""The command `st-codegen`; `st-codegen MODELS --target NAME` is short for `st-codegen generate MODELS ..`.

This module and what it imports are loaded by every start, `--help` included: nothing large is among them.
"""

from __future__ import annotations

import contextlib
import csv
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

import click

from st_codegen import __version__
from st_codegen.cli.codes import codes_of, show_codes
from st_codegen.cli.lazy import Lazy, LazyGroup
from st_codegen.errors import InputError, StCodegenError, meant
from st_codegen.files.made_by import set_command

_COMMANDS = {
    "train": Lazy("st_codegen.cli.train", "Learn from measured curves or a harmonic table; write a bundle of models."),
    "tables": Lazy("st_codegen.cli.tables", "Write the paper's tables 2 to 6 with our errors beside the authors'."),
    "generate": Lazy("st_codegen.cli.generate", "Compile a folder of models (or one file) to Structured Text."),
    "doctor": Lazy("st_codegen.cli.doctor", "Show what is installed, what is missing, and how to get it."),
    "init": Lazy("st_codegen.cli.init", "Write the configuration of a folder of models from what its files know."),
    "verify": Lazy("st_codegen.cli.verify", "Compare the generated text with the models' libraries; check its time."),
    "prove": Lazy("st_codegen.cli.prove", "Prove that the generated text equals its models for every input."),
    "predict": Lazy("st_codegen.cli.predict", "Predict the rows of a table by text, reference or library."),
    "diff": Lazy("st_codegen.cli.diff", "Say what changed between two generated folders."),
    "latency": Lazy("st_codegen.cli.latency", "Tell the age of an angle when the correction made from it arrives."),
    "simulate": Lazy("st_codegen.cli.simulate", "Simulate the rig: measured campaigns, and motions."),
    "reconcile": Lazy("st_codegen.cli.reconcile", "Name the effects that a rig model lacks, and add them."),
    "fleet": Lazy("st_codegen.cli.fleet", "Train, compile, prove and reconcile many axes, and compare them."),
    "compare": Lazy("st_codegen.cli.compare", "Compare the models on a running controller with their libraries."),
    "record": Lazy("st_codegen.cli.record", "Measure a campaign on a running controller."),
    "serve": Lazy("st_codegen.cli.serve", "Run generated text as a controller does; answer ADS and OPC UA clients."),
    "models": Lazy("st_codegen.cli.models", "List the classes, objectives and operators that are compiled."),
    "explain": Lazy("st_codegen.cli.explain", "Say what the code of a message means, and what to do."),
    "calibrate": Lazy("st_codegen.cli.calibrate", "Fit a profile to times measured on the controller."),
}
#: Exit codes beside 0 (yes) and 1 (the answer is no).
_WRONG_USE, _DEFECT, _INTERRUPTED, _UNREAD = 2, 70, 130, 141
_TRACEBACK = "--traceback"
_DATED = "--dated"
_TRACEBACK_VARIABLE = "ST_CODEGEN_TRACEBACK"


class _UnreadError(Exception):
    """Who read our output has closed the pipe."""


@contextlib.contextmanager
def _unread_told_apart() -> Iterator[None]:
    """Tell a reader that went away, of which click makes exit code 1 (an answer here), from other broken pipes."""
    try:
        yield
    except BrokenPipeError as error:
        if traceback.extract_tb(error.__traceback__)[-1].name in ("echo", "_write_buffer"):  # click's, rich's
            raise _UnreadError from error
        raise InputError(_system_message(error)) from error


class _Commands(LazyGroup):
    """An argument that names no command is the folder to generate from."""

    def make_context(self, *args: Any, **options: Any) -> click.Context:
        with _unread_told_apart():
            return super().make_context(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        with _unread_told_apart():
            return super().invoke(ctx)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        own = {"--help", "-h", "--version"}
        is_command = bool(args) and args[0] in _COMMANDS
        if args[:1] == ["models"] and args[1:] and args[1] not in own:  # the command takes nothing: a folder is meant
            is_command = False
        if args and not is_command and args[0] not in own:
            self._refuse_misspelt(ctx, args[0])
            args = ["generate", *args]
        return super().parse_args(ctx, args)

    @staticmethod
    def _refuse_misspelt(ctx: click.Context, word: str) -> None:
        """Raises UsageError for a word that is no command, and no path."""
        if word not in _COMMANDS and word.isidentifier() and not os.path.lexists(word):
            ctx.fail(f"no such command, file or folder: '{word}'{meant(word, _COMMANDS, 0.7) or '.'}")


@click.group(
    cls=_Commands,
    lazy=_COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
    epilog="""\b
Examples:
  st-codegen models/ --target twincat              compile a folder of models
  st-codegen verify models/ --generated generated  compare its numbers with those of the models' libraries
  st-codegen prove models/ --generated generated   say what is proved of it for every input
  st-codegen predict models/ --input X.csv --output Y.csv
  st-codegen diff old/ new/                        what changed, for the reviewer

\b
Exit codes: 0 yes, 1 the answer is no, 2 wrong use or input, 70 a defect of st-codegen, 130 stopped,
141 nobody reads the output any more.""",
)
@click.option(
    _TRACEBACK, is_flag=True, expose_value=False, help=f"Show where an error arose; also {_TRACEBACK_VARIABLE}=1."
)
@click.option(_DATED, is_flag=True, expose_value=False, help="Pages name the day on which they were made.")
@click.version_option(__version__, prog_name="st-codegen")
def cli() -> None:
    """Compile trained models to IEC 61131-3 Structured Text, and check it against the models' own libraries.

    A folder without a command is compiled: `st-codegen models/ --target twincat`.
    """


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line. What a user can mend ends it with exit code 2 and one message, a defect with 70."""
    given = sys.argv[1:] if arguments is None else arguments
    rest = [argument for argument in given if argument not in (_TRACEBACK, _DATED)]
    shows_traceback = _TRACEBACK in given or os.environ.get(_TRACEBACK_VARIABLE, "") not in ("", "0")
    set_command(rest, dated=_DATED in given)
    try:
        code = cli.main(args=rest, obj=rest, prog_name="st-codegen", standalone_mode=False)
    except _UnreadError:
        for stream in (sys.stdout, sys.stderr):  # what they still hold is lost, and said by nobody at the end
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        sys.exit(_UNREAD)
    except click.exceptions.Abort as error:
        _fail(str(error.__cause__ or "") or "stopped", _INTERRUPTED)
    except click.ClickException as error:
        if isinstance(error, click.BadParameter) and error.param is not None:
            error = _of_all(error, rest)
        with contextlib.suppress(OSError):
            error.show()
            show_codes(codes_of(error))
        sys.exit(error.exit_code)
    except Exception as error:
        if shows_traceback:
            traceback.print_exc()
        message = _expected(error)
        if message is not None:
            _fail(message, _WRONG_USE, codes_of(error))
        hint = "" if shows_traceback else f"; {_TRACEBACK} shows where it arose"
        _fail(
            f"{type(error).__name__}: {error}\n"
            f"This is a defect of st-codegen {__version__}, not of what you gave it: please report it{hint}.",
            _DEFECT,
            ("STC9001",),
        )
    sys.exit(code or 0)


def _of_all(error: click.BadParameter, words: list[str]) -> click.ClickException:
    """Name every parameter that is missing or has a value that it does not take; click ends at the first."""
    context = error.ctx
    if context is None:
        return error
    # what stands behind the name of the command; without one it is that of `generate`
    path = context.command_path.split()[1:]
    own = words[len(path) :] if words[: len(path)] == path else words
    given, more, _ = context.command.make_parser(context).parse_args(list(own))
    found = []
    for param in context.command.params:
        try:
            param.handle_parse_result(context, given, more)
        except click.BadParameter as one:
            found.append(one.format_message())
    return click.UsageError("\n".join(found), context) if found else error


def _system_message(error: OSError) -> str:
    names = [str(name) for name in (error.filename, error.filename2) if name is not None]
    if not names and traceback.extract_tb(error.__traceback__)[-1:][0].name == "echo":  # what prints all results
        names = ["standard output"]
    reason = error.strerror or " ".join(map(str, error.args))
    return f"{' -> '.join(names)}: {reason}" if names else reason or type(error).__name__


#: What a user can mend (input, disk, memory), and its message.
_EXPECTED: tuple[tuple[type[Exception], Callable[[Any], str]], ...] = (
    (StCodegenError, str),
    (OSError, _system_message),
    (UnicodeError, lambda error: f"a text or a file's name is not UTF-8 ({error})"),
    (csv.Error, lambda error: f"a table is not readable ({error})"),
    (RecursionError, lambda _: "something in the input is nested too deeply"),
    (MemoryError, lambda error: f"not enough memory: {error}".removesuffix(": ")),
)


def _expected(error: Exception) -> str | None:
    """The message for what a user can mend, None for a defect of ours."""
    return next((message(error) for kind, message in _EXPECTED if isinstance(error, kind)), None)


def _fail(message: str, code: int, codes: Sequence[str] = ()) -> NoReturn:
    """One message on standard error, in which nothing of the data acts on the terminal, its codes, and the end.

    The code is the same where the message cannot be written: the log may be on the disk that is full.
    """
    from st_codegen.files.text import inert

    with contextlib.suppress(OSError):
        click.echo(f"{click.style('error:', fg='red', bold=True)} {inert(message)}", err=True)
        show_codes(codes)
    sys.exit(code)
