"""What all commands share: messages on standard error, progress bars, common options."""

from __future__ import annotations

import functools
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from st_codegen.cli.choices import OUTPUTS
from st_codegen.files.made_by import command_line
from st_codegen.files.number_text import parse_number, parse_whole
from st_codegen.files.text import inert
from st_codegen.project.build_options import BUILD_OPTIONS, option_name
from st_codegen.walkers.limits import (
    DEFAULT_MAX_MODEL_BYTES,
    max_model_bytes,
    set_features,
    set_max_model_bytes,
    stated_features,
)

if TYPE_CHECKING:
    from st_codegen.ir import OutputKind
    from st_codegen.live.controller import Controller
    from st_codegen.project.bundle import Bundle, Outputs
    from st_codegen.rig.effects import Effect


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Nobody reads any more: the command line decides what that means, not rich, which would exit with 1."""
        raise  # noqa: PLE0704  (called where the error is handled)

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich does it, but nothing in a text, which may hold names of files and of models, acts on the terminal."""
        super().print(*(inert(one) if isinstance(one, str) else one for one in objects), **options)


#: Messages and progress; results go to standard output. Text is shown as it is, nothing in it is taken as markup.
console = _Console(stderr=True, width=None if sys.stderr.isatty() else 120, markup=False, emoji=False, highlight=False)


def say(text: str | Text) -> None:
    """A line of messages, which a terminal may break and nobody else."""
    console.print(text, soft_wrap=True)


def tell(text: str) -> None:
    """Sentences: a terminal has them broken between words, everybody else a line each, as paths in them need."""
    console.print(text, soft_wrap=not console.is_terminal)


Command = TypeVar("Command", bound=Callable[..., Any])


def say_next(*words: Path | str) -> None:
    """The command to run next, as the last of what a command prints; none that could not be printed as it is run."""
    line = command_line("st-codegen", *words)
    if inert(line) == line:
        say(f"next: {line}")


class _Place(click.Path):
    """A path, but no empty text: `--out "$OUT"` of a variable that is not set would name the folder one stands in."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("an empty text names no file and no folder.", param, ctx)
        return super().convert(value, param, ctx)


class _Written(_Place):
    """A file to write: one that can be written, and that no other option of the command writes, too.

    Else that would be seen at the end, when the work of hours is lost. Of defaults nothing is asked: some are not used.
    """

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        found = super().convert(value, param, ctx)
        if param is None or ctx is None or str(found) == "-":
            return found
        if ctx.get_parameter_source(str(param.name)) is ParameterSource.DEFAULT:
            return found
        path = Path(os.path.realpath(found))
        folder = next(above for above in path.parents if above.exists())
        if not folder.is_dir():
            self.fail(f"{folder} is a file; a folder is wanted there.", param, ctx)
        is_device = path.exists() and not path.is_file()  # it is no file that is replaced, and takes what several write
        if not os.access(path if is_device else folder, os.W_OK):
            self.fail(f"'{found}' may not be written by you.", param, ctx)
        first = ctx.meta.setdefault(f"{__name__}.written", {}).setdefault(path, param)
        if first is not param and not is_device:
            self.fail(f"'{found}' is the file of {max(first.opts, key=len)}, too.", param, ctx)
        return found


#: Paths on the command line: of anything, of a file to write, of a folder.
PLACE, FILE = _Place(path_type=Path), _Written(path_type=Path, dir_okay=False)
FOLDER = _Place(path_type=Path, file_okay=False)


class Number(click.FloatRange):
    """A finite number in plain digits, within bounds if some are given."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return super().convert(parse_number(value) if isinstance(value, str) else value, param, ctx)
        except ValueError as error:
            self.fail(f"{error}.", param, ctx)

    def _describe_range(self) -> str:
        """What the help shows of the bounds; click's own names a bound that is not there."""
        return "" if self.min is self.max is None else super()._describe_range()


class Whole(click.IntRange):
    """A whole number in plain digits, within bounds if some are given."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return super().convert(parse_whole(value) if isinstance(value, str) else value, param, ctx)
        except ValueError as error:
            self.fail(f"{error}.", param, ctx)


def refuse_unused(where: str, *names: str, others: Iterable[str] = ()) -> None:
    """Raise UsageError that lists the options without effect `where`: those of some parameters that are on the command
    line, and `others`, which are known to be.
    """
    context = click.get_current_context()
    given = [
        max(parameter.opts, key=len)
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]
    if given := [*given, *others]:
        them = "them" if len(given) > 1 else "it"
        raise click.UsageError(f"{', '.join(given)}: without effect {where}; leave {them} out.")


#: Options of the command line by their names in [build], where these differ.
_OPTION_OF = {"target": "targets", "entry": "entries"}


def _with_defaults(context: click.Context, _: click.Parameter, models: Path) -> Path:
    from st_codegen.project.configuration import read_configuration

    build = read_configuration(models).build if models.exists() else {}
    defaults = {_OPTION_OF.get(key, key): value for key, value in build.items()}
    if "out" in defaults:  # where generate writes, the others read
        defaults["generated"] = defaults["out"]
    context.default_map = {**(context.default_map or {}), **defaults}
    return models


#: The option --quiet.
quiet_option = click.option("-q", "--quiet", is_flag=True, help="No progress, no summary: errors and warnings only.")


def generated_option(text: str) -> Callable[[Command], Command]:
    """The option that names what `generate` wrote; `text` says what becomes of it."""
    return click.option("-g", "--generated", type=PLACE, default=Path("generated"), help=text)


def together(*options: Callable[[Any], Any]) -> Callable[[Command], Command]:
    """Several options as one decorator; the first is the first in the help."""
    return lambda function: functools.reduce(lambda inner, option: option(inner), reversed(options), function)


def rows_options(text: str) -> Callable[[Command], Command]:
    """How many rows are tried, and the seed of those that are random; `text` says when they are more."""
    return together(
        click.option("-n", "--rows", type=Whole(min=1), default=10_000, help=text),
        click.option("--seed", type=Whole(min=0), default=0, help="Seed of the random rows."),
    )


#: The options by which model files are read: what is trusted, how large they may be, what they do not say.
trust_option = together(
    click.option(
        "--trust-pickle",
        is_flag=True,
        help="Load .joblib, .pkl and .pickle files. A pickle can run code: only your own.",
    ),
    click.option(
        "--features",
        type=Whole(min=1),
        metavar="N",
        expose_value=False,
        callback=lambda _context, _option, value: set_features(value),
        help="Features of a row, for ONNX graphs with an input whose number of columns is left open.",
    ),
    click.option(
        "--max-model-bytes",
        type=Whole(min=1),
        default=DEFAULT_MAX_MODEL_BYTES,
        expose_value=False,
        callback=lambda _context, _option, value: set_max_model_bytes(value),
        help="Model files with more bytes, packed or unpacked, are refused before they are unpacked.",
    ),
)


def _words(options: Mapping[str, str | int | None]) -> list[str]:
    """Options and their values as words of a command line, without those that have none."""
    return [word for option, value in options.items() if value is not None for word in (option, str(value))]


def reading_words(*, trust_pickle: bool) -> list[str]:
    """The words by which another command reads model files as this one did."""
    size = max_model_bytes()
    limit = None if size == DEFAULT_MAX_MODEL_BYTES else size
    return [*_words({"--features": stated_features(), "--max-model-bytes": limit}), *["--trust-pickle"] * trust_pickle]


def gathered(name: str, make: Callable[..., Any], *options: Callable[[Any], Any]) -> Callable[[Command], Command]:
    """Options that a command gets as one value: `make` is called with them, by their names, when the command runs."""
    taken = inspect.signature(make).parameters

    def add(function: Command) -> Command:
        @functools.wraps(function)
        def command(*arguments: Any, **given: Any) -> Any:
            value = make(**{option: given.pop(option) for option in taken})
            return function(*arguments, **{name: value}, **given)

        return cast(Command, together(*options)(command))

    return add


@dataclass(frozen=True)
class GivenModels:
    """The models of a command: where they are, what they are called, and how they are read."""

    models: Path
    prefix: str | None
    block_name: str | None
    trust_pickle: bool
    quiet: bool

    def load(self, outputs: Outputs, *, real: bool) -> Bundle:
        """The models with such outputs of classifiers, computed in LREAL or in REAL."""
        from st_codegen.project.bundle import load, others_of, pickles_left_out

        with progress_bar("loading", quiet=self.quiet) as progress:
            bundle = load(
                self.models,
                trust_pickle=self.trust_pickle,
                outputs=outputs,
                progress=progress,
                prefix=self.prefix,
                block_name=self.block_name,
                real=real,
            )
        asked = click.get_current_context().get_parameter_source("outputs") is ParameterSource.COMMANDLINE
        if asked and not isinstance(outputs, Mapping) and all(ir.classes is None for ir in bundle.irs):
            of_classes = [f"--outputs {one}" for one in outputs if one in ("probability", "decision")]
            refuse_unused("on models of which none is a classifier", others=of_classes)
        if self.trust_pickle and (left_out := pickles_left_out(self.models, bundle)):
            say(f"--trust-pickle: leave_out of st-codegen.toml leaves out {', '.join(left_out)}")
        for text in () if self.quiet else others_of(self.models, bundle):
            say(text)
        return bundle

    def asked_next(self, command: str, generated: Path) -> tuple[Path | str, ...]:
        """The words of another command on the text in a folder: of the same models, called and read in the same way."""
        names = _words({"--prefix": self.prefix, "--block-name": self.block_name})
        return command, self.models, "--generated", generated, *names, *reading_words(trust_pickle=self.trust_pickle)

    def load_generated(self, generated: Path) -> Bundle:
        """The models with the outputs and the numbers (LREAL, REAL) that text was generated with."""
        from st_codegen.emit.output import check_names, is_real, kinds_of_outputs
        from st_codegen.proof.emitted import read_meanwhile

        with read_meanwhile(generated):
            bundle = self.load(kinds_of_outputs(generated), real=is_real(generated))
        if bundle.purpose is None:
            check_names(generated, bundle.irs, bundle.configuration.prefix)
        return bundle


#: The argument MODELS and the first options of a command with models. The [build] table beside the models gives the
#: options of the command their defaults.
models_options = together(
    click.argument("models", type=PLACE, is_eager=True, callback=_with_defaults),
    click.option(
        "--prefix", metavar="TEXT", help="In front of the names of all models: FB_P1_Te. Default: that of [project]."
    ),
    click.option("--block-name", metavar="NAME", help="Of a single model: FB_NAME instead of its file's name."),
)
#: The last options of such a command; all that it is given of models is one value, `given`.
reading_options = gathered("given", GivenModels, trust_option, quiet_option)


def _catalogue(effects: tuple[Path, ...]) -> Mapping[str, type[Effect]]:
    from st_codegen.rig.effects import catalogue

    return catalogue(effects)


#: The option --effects: the effects that are known, by their names, as `known`.
effects_option = gathered(
    "known",
    _catalogue,
    click.option("--effects", type=PLACE, multiple=True, help="Python file with effects of your own."),
)


def _connection(ads: str | None, opcua: str | None, timeout: float) -> Callable[[], Controller]:
    from st_codegen.live.controller import connected

    return functools.partial(connected, ads, opcua, timeout)


#: The options by which a command reaches a controller: `connect`, which does so.
controller_options = gathered(
    "connect",
    _connection,
    click.option("--ads", metavar="NETID:PORT[@HOST[:TCPPORT]]", help="The controller over ADS."),
    click.option("--opcua", metavar="URL", help="The controller over OPC UA."),
    click.option("--timeout", type=Number(min=0.01), default=5.0, help="Seconds in which an answer must come."),
)


def _kinds(_context: click.Context, _option: click.Parameter, value: str) -> tuple[OutputKind, ...]:
    from st_codegen.ir import OutputKind

    words = [word.strip() for word in value.split(",")]
    if unknown := [word for word in words if word not in OUTPUTS]:
        raise click.BadParameter(f"{', '.join(map(repr, unknown))} is none of {', '.join(OUTPUTS)}.")
    return tuple(OutputKind(word) for word in words)


#: The option --outputs: what classifiers give beside the class.
outputs_option = click.option(
    "--outputs",
    default=OUTPUTS[0],
    callback=_kinds,
    metavar="KIND,..",
    help="What classifiers give: class (always), probability, decision (the library's scores); Gaussian processes: "
    "mean (always), deviation; a PCA: column (always), reconstruction (the squared error of it).",
)


def build_options(*names: str) -> Callable[[Command], Command]:
    """Options of generated files, as `project.build_options` has them."""
    options = []
    for name in names:
        own = BUILD_OPTIONS[name]
        kind: Any = click.Choice(own.choices) if own.choices else Whole(min=1) if own.kind is int else own.kind
        default = own.choices[0] if own.choices else own.default
        given = {"is_flag": True} if own.kind is bool else {"type": kind, "default": default, "metavar": own.metavar}
        options.append(click.option(option_name(name), help=own.help, **given))
    return together(*options)


def table_of(title: str | None, *columns: str) -> Table:
    """A table without rows; a column of numbers, which are aligned to the right, has a > in front of its name."""
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column.removeprefix(">"), justify="right" if column.startswith(">") else "left")
    return table


@contextmanager
def progress_bar(title: str, *, quiet: bool) -> Iterator[Callable[[int, int, str], None]]:
    """A bar fed by (done, total, what is next); silent with `quiet` and where standard error is no terminal."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as progress:
        task = progress.add_task(title, total=None)

        def update(done: int, total: int, what: str) -> None:
            progress.update(task, completed=done, total=total, description=f"{title} {what}".rstrip())

        yield update
