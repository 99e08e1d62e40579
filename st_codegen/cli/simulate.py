"""`st-codegen simulate`: measurements and motions of the simulated rig; one file a subcommand."""

from __future__ import annotations

import click

from st_codegen.cli.lazy import Lazy, LazyGroup

_SUBCOMMANDS = {
    "campaign": Lazy("st_codegen.cli.simulate_campaign", "Write curve files of the simulated rig."),
    "motion": Lazy("st_codegen.cli.simulate_motion", "Move the rig with the generated code in its loop."),
}


@click.group("simulate", cls=LazyGroup, lazy=_SUBCOMMANDS)
def command() -> None:
    """Simulate the rig: measured campaigns, and motions with the generated code in the loop."""
