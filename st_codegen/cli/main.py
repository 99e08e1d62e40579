"""The command `st-codegen`; `st-codegen MODELS --target NAME` is short for `st-codegen generate MODELS ..`."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import click

from st_codegen import __version__
from st_codegen.cli.console import console
from st_codegen.errors import StCodegenError

#: Command -> module with a click command of that name. Loaded when used, so that `--help` is fast.
_COMMANDS = {
    "train": "st_codegen.cli.train",
    "tables": "st_codegen.cli.tables",
    "generate": "st_codegen.cli.generate",
    "verify": "st_codegen.cli.verify",
    "predict": "st_codegen.cli.predict",
    "diff": "st_codegen.cli.diff",
    "latency": "st_codegen.cli.latency",
    "simulate": "st_codegen.cli.simulate",
    "reconcile": "st_codegen.cli.reconcile",
    "calibrate": "st_codegen.cli.calibrate",
}


class _Commands(click.Group):
    """Loads commands lazily; an argument that names no command is the folder to generate from."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        module = _COMMANDS.get(cmd_name)
        return None if module is None else importlib.import_module(module).command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        own = {"--help", "-h", "--version"}
        if args and args[0] not in _COMMANDS and args[0] not in own:
            args = ["generate", *args]
        return super().parse_args(ctx, args)


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="""\b
Examples:
  st-codegen models/ --target twincat              compile a folder of models
  st-codegen verify models/ --generated generated  prove that the code computes the same numbers
  st-codegen predict models/ --input X.csv --output Y.csv
  st-codegen diff old/ new/                        what changed, for the reviewer""",
)
@click.version_option(__version__, prog_name="st-codegen")
def cli() -> None:
    """Compile trained models to IEC 61131-3 Structured Text and prove that the code computes the same numbers.

    A folder without a command is compiled: `st-codegen models/ --target twincat`.
    """


def main(arguments: list[str] | None = None) -> Any:
    """Run the command line; input errors end it with exit code 2 and one message, without a traceback."""
    try:
        return cli.main(args=arguments, prog_name="st-codegen")
    except StCodegenError as error:
        console.print(f"[bold red]error:[/] {_escaped(str(error))}", highlight=False, soft_wrap=True)
        sys.exit(2)


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")
