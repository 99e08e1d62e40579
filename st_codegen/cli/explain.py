"""`st-codegen explain`: what the code of a message means."""

from __future__ import annotations

import textwrap

import click

from st_codegen.diagnostics import DIAGNOSTICS, diagnostic


@click.command(
    "explain",
    epilog="""\b
Examples:
  st-codegen explain STC1201
  st-codegen explain               all codes, a line each""",
)
@click.argument("code", required=False)
def command(code: str | None) -> None:
    """Say what the CODE of a message means: its cause, and what to do."""
    if code is None:
        for entry in sorted(DIAGNOSTICS, key=lambda entry: entry.code):
            click.echo(f"{entry.code}  {entry.title}")
        return
    found = diagnostic(code)
    if found is None:
        raise click.BadParameter(f"'{code}' is no code; without one, all are listed.", param_hint="CODE")
    click.echo("\n\n".join(textwrap.fill(part, 100, break_on_hyphens=False) for part in found.text().split("\n\n")))
