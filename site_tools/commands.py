"""The reference of commands, from the help of the command line itself."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import click

from st_codegen.cli.main import cli


def page() -> str:
    """All commands with their options, as Markdown."""
    lines = [
        "# Commands",
        "",
        "This page is made from the program's own help. [Commands at a glance](../commands.md) has one line for each.",
        "",
        *_command(cli, click.Context(cli, info_name="st-codegen"), 2),
    ]
    return "\n".join(lines) + "\n"


def _command(command: click.Command, context: click.Context, depth: int) -> Iterator[str]:
    yield f"{'#' * depth} {context.command_path}"
    yield ""
    yield from _code([f"{context.command_path} {' '.join(command.collect_usage_pieces(context))}"])
    yield _prose(command.help or "")
    yield ""
    options = [record for parameter in command.get_params(context) if (record := parameter.get_help_record(context))]
    if options:
        yield "| option | does |"
        yield "|---|---|"
        for name, text in options:
            yield f"| `{_cell(name)}` | {_cell(_prose(text))} |"
        yield ""
    if command.epilog:
        for block in inspect.cleandoc(command.epilog).split("\b\n"):
            if block.strip():
                head, *rest = block.strip("\n").split("\n")
                yield _prose(head)
                yield ""
                yield from _code([line[2:] if line.startswith("  ") else line for line in rest])
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            member = command.get_command(context, name)
            if member is not None and not member.hidden:
                yield from _command(member, click.Context(member, info_name=name, parent=context), min(depth + 1, 4))


def _code(lines: list[str]) -> Iterator[str]:
    if lines:
        yield "```text"
        yield from lines
        yield "```"
        yield ""


def _prose(text: str) -> str:
    """Help text as paragraphs, in which nothing is read as HTML or emphasis."""
    paragraphs = [" ".join(part.split()) for part in inspect.cleandoc(text).replace("\b", "").split("\n\n")]
    return "\n\n".join(re.sub(r"([<>*_\[\]])", r"\\\1", part) if "`" not in part else part for part in paragraphs)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
