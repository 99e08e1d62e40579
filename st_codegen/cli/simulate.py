"""`st-codegen simulate`: measurements and motions of the simulated rig; one file a subcommand."""

from __future__ import annotations

import importlib

import click

#: Subcommand -> module with a click command of the name `command`. Loaded when used.
_SUBCOMMANDS = {
    "campaign": "st_codegen.cli.simulate_campaign",
    "motion": "st_codegen.cli.simulate_motion",
}


class _Subcommands(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_SUBCOMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        module = _SUBCOMMANDS.get(cmd_name)
        return None if module is None else importlib.import_module(module).command


@click.group("simulate", cls=_Subcommands)
def command() -> None:
    """Simulate the rig: measured campaigns, and motions with the generated code in the loop."""
