"""`st-codegen models`: what can be compiled."""

from __future__ import annotations

import click


@click.command(
    "models",
    epilog="""\b
Examples:
  st-codegen models
  st-codegen models/ --target iec      a folder of this name is written with its slash""",
)
def command() -> None:
    """List all classes, objectives and operators that are compiled, as a Markdown table.

    What is not in the list is refused with its reason. The list is made from the code that reads the models.
    """
    from st_codegen.walkers.supported import table

    click.echo(table())
